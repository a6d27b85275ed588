"""Many motions of one model side by side: their ends, and the zeros of an event's function.

What `integrate` and `classify` do for one case is done here for arrays of them, step by step. A
motion about which anything is in doubt (too near the separatrix, too stiff, at rest, zeros that do
not alternate) is left unsettled, for these two to decide by themselves.
"""

from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..engines.polynomial import TAYLOR, to_bernstein, zeros
from ..engines.series import motion, value
from ..integration.choice import MANY_STEPS
from ..integration.units import Units
from ..models.base import Event, Model
from ..models.constants import Structure, jacobian, namespace

if TYPE_CHECKING:
    from ..engines.taylor_batch import TaylorStep

BAND, WIDE = (1 / 4, 4.0), (1 / 64, 64.0)
"""The largest component of a scaled state that needs no new units. heyoka's control of the error is
absolute below 1, so that a small motion loses digits. Units are renewed outside of BAND at every
RENEWAL-th pause, since numpy spends more on the call, some 0.1 ms, than on a thousand motions, and
at every pause outside of WIDE, where few motions ever get. When, does not hang on other motions."""

RENEWAL = 8

HOPELESS = 100 * MANY_STEPS
"""Steps that a motion needs if it stays as fast as at its start, beyond which it is not tried."""

MOST_STEPS = int(4 * MANY_STEPS)
"""Steps after which a motion is left to the driver of single cases."""

PAUSE = 4
"""Steps from one look for motions that are at their end or have outgrown their units to the next.
In one step a motion changes by a factor of e at most, so that it stays within e^4 of its band."""

FULL = 0.93
"""The part of the columns that must be under way; with fewer, the others are dropped. Copying all
columns costs about as much as one step."""

DOUBT, PER_TOLERANCE = 1e-9, 1e3
"""Where an error of this part of the state (DOUBT, or so many tolerances) could turn the sign of an
event's function, that sign is in doubt: more than the steps before it can have added up to."""


class Passages(NamedTuple):
    """Zeros (k,) of an event's function, in order of motion and time: +1 where it rises through 0,
    and the state (m, k) there in units of 2**exponent."""

    motion: np.ndarray
    time: np.ndarray
    direction: np.ndarray
    state: np.ndarray
    exponent: np.ndarray


@dataclass(frozen=True)
class Ensemble:
    """n motions: the constants of their equations (c, n), flat as `structure` says, their states at
    the start (m, n), their span of time, the event that is looked for, and the tolerance."""

    model: type[Model]
    structure: Structure
    constants: np.ndarray
    start: np.ndarray
    span: tuple[float, float]
    event: Event | None
    tol: float | None

    @property
    def doubt(self) -> float:
        """The part of a state that its error is taken to stay below."""
        return max(DOUBT, PER_TOLERANCE * (self.tol or 0.0))

    def named(self, at: Any = slice(None)) -> SimpleNamespace:
        """The constants of the motions `at` by name."""
        return namespace(self.structure, list(self.constants[:, at]))

    @cached_property
    def scaled_rows(self) -> dict[str, int]:
        """Where among the constants those stand that change with the units."""
        names = [
            name
            for name, size in self.structure
            if isinstance(size, int)
            for _ in range(max(size, 1))
        ]
        return {name: names.index(name) for name in self.model.degree}

    def feasible(self) -> np.ndarray:
        """The motions that are not at rest, nor too stiff for a Taylor series, by their number."""
        slopes = jacobian(self.model, self.named(), self.span[0], self.start)
        rate = np.abs(slopes).sum(axis=1).max(axis=0)
        steps = rate * (self.span[1] - self.span[0]) / 8  # as `choice.taylor_steps` estimates
        return np.flatnonzero((steps < HOPELESS) & (self.start != 0).any(axis=0))

    def uncertainty(self, event: Event, y: np.ndarray, k: SimpleNamespace) -> np.ndarray:
        """How far an event's function (n,) may be off in states y (m, n): its slope along each
        component, by a complex step, times the error that the largest one may have."""
        tilts = [y + 1e-100j * (np.arange(len(y)) == i)[:, None] for i in range(len(y))]
        slopes = [np.abs(np.imag(event.function(0.0, [*tilt], k))) / 1e-100 for tilt in tilts]
        return np.asarray(self.doubt * np.abs(y).max(axis=0) * sum(slopes))

    def side(self, y: np.ndarray) -> np.ndarray:
        """The sign (n,) of the event's function in states y (m, n) of any size; 0 in doubt."""
        assert self.event is not None
        k = self.named()
        off = self.event.function(0.0, [*y], k)
        return np.where(np.abs(off) > self.uncertainty(self.event, y, k), np.sign(off), 0)


@dataclass
class Outcome:
    """What became of n motions: states at the end (m, n) in units of 2**exponent (n,), and the
    zeros of the event's function, with its sign at both ends.

    A terminal event ends a motion. Where `settled` is False nothing here counts.
    """

    state: np.ndarray
    exponent: np.ndarray
    steps: np.ndarray
    settled: np.ndarray
    passages: Passages
    first: np.ndarray
    last: np.ndarray

    @classmethod
    def blank(cls, m: int, n: int) -> "Outcome":
        """Nothing known of n motions."""
        exponent, steps, first, last = np.zeros((4, n), dtype=np.int64)
        none = np.empty(0, dtype=np.int64)
        passages = Passages(none, np.empty(0), none, np.empty((m, 0)), none)
        settled = np.zeros(n, dtype=bool)
        return cls(np.full((m, n), np.nan), exponent, steps, settled, passages, first, last)


class Suspects(NamedTuple):
    """Steps (k,) in which an event's function may have zeros: of which motion, the columns at their
    start, the rest of the time left, their length, units and constants."""

    motion: np.ndarray
    before: np.ndarray
    rest: np.ndarray
    length: np.ndarray
    size: np.ndarray
    rate: np.ndarray
    k: np.ndarray


@dataclass
class Underway:
    """The motions of an ensemble that have not reached their end, in columns.

    Rows of `now`: the state, in units of its own, and the time left. The columns are a multiple of
    the engine's width; those without a motion have the number -1 and no time left.
    """

    ensemble: Ensemble
    step: "TaylorStep"
    number: np.ndarray
    outcome: Outcome
    pauses: int = 0
    suspects: list[Suspects] = field(default_factory=list)

    def __post_init__(self) -> None:
        e, m, n, width = self.ensemble, self.m, len(self.number), len(padded(self.number))
        self.number = padded(self.number)
        self.now, self.next = np.empty((self.step.rows, width)), np.empty((self.step.rows, width))
        self.now[:m], self.now[m] = e.start[:, self.number], e.span[1] - e.span[0]
        self.k = np.empty((len(e.constants) + 1, width))
        self.k[0], self.k[1:] = e.span[1], e.constants[:, self.number]
        self.size, self.rate = np.zeros((2, width), dtype=np.int64)
        self.rest, self.steps = np.zeros(width), np.zeros(width, dtype=np.int64)
        self.renew(np.arange(width))
        self.now[m, n:], self.number[n:] = 0, -1

    @property
    def m(self) -> int:
        """The number of state variables; the row of the time left."""
        return len(self.ensemble.start)

    def advance(self) -> None:
        """One step of every motion."""
        left = self.m
        self.step(self.now[: left + 1], self.k, self.next)
        self.steps += self.now[left] > 0
        # What the subtraction has rounded away is kept, so that many steps cost the time no digits.
        self.rest += (self.now[left] - self.next[left]) - self.next[left + 1]
        if self.step.rows > left + 2:
            self.watch(np.flatnonzero(self.next[left + 2] < 0))
        self.now, self.next = self.next, self.now

    def watch(self, at: np.ndarray) -> None:
        """Remember the steps just taken in the columns `at`, where the event's function may have
        zeros; a motion that is seen to have passed a terminal event stops."""
        if not at.size:
            return
        before, k, m, event = self.now[: self.m + 1, at], self.k[:, at], self.m, self.ensemble.event
        units = self.size[at], self.rate[at]
        length = self.next[m + 1, at]
        self.suspects.append(Suspects(self.number[at], before, self.rest[at], length, *units, k))
        # Only the sign at the ends is looked at here; where in the step it ended is found at the
        # end, for all at once.
        if event is not None and event.terminal:
            named = namespace(self.ensemble.structure, list(k[1:]))
            ends = (event.function(0.0, [*y[:m]], named) for y in (before, self.next[:m, at]))
            passed = at[np.multiply(*ends) < 0]
            self.next[m, passed] = 0

    def pause(self) -> None:
        """Drop the motions that are at their end, and renew units that no longer fit."""
        self.pauses += 1
        left = self.now[self.m]
        going = (left > 0) & (self.steps < MOST_STEPS)
        # What rounding took from the time left, back to it before it decides the last steps.
        whole = left + self.rest
        self.rest += left - whole
        left[going] = whole[going]
        if np.count_nonzero(going) < FULL * len(going):
            self.drop(~going)
        if self.ensemble.model.degree:
            largest = np.abs(self.now[: self.m]).max(axis=0)
            low, high = WIDE if self.pauses % RENEWAL else BAND
            outgrown = (largest < low) | (largest > high)
            self.renew(np.flatnonzero(outgrown & (self.now[self.m] > 0)))

    def drop(self, done: np.ndarray) -> None:
        """Enter the columns that are done in the outcome, and keep the others."""
        ended = np.flatnonzero(done & (self.number >= 0))
        at, outcome = self.number[ended], self.outcome
        outcome.state[:, at], outcome.exponent[at] = self.now[: self.m, ended], self.size[ended]
        outcome.steps[at] = self.steps[ended]
        outcome.settled[at] = self.now[self.m, ended] == 0
        going = np.flatnonzero(~done)
        keep = padded(going)
        # Contiguous, because compiled code reads the columns in registers.
        self.now, self.k = (np.ascontiguousarray(a[:, keep]) for a in (self.now, self.k))
        self.next = np.empty_like(self.now)
        self.number, self.size, self.rate, self.rest, self.steps = (
            a[keep] for a in (self.number, self.size, self.rate, self.rest, self.steps)
        )
        self.now[self.m, len(going) :], self.number[len(going) :] = 0, -1

    def renew(self, at: np.ndarray) -> None:
        """Fit the units of the columns `at` to their motions."""
        e, m = self.ensemble, self.m
        if not e.model.degree or not at.size:
            return
        y, k = self.now[:m, at], vars(e.named(self.number[at]))
        y = np.where(np.isfinite(y).all(axis=0), y, 1.0)  # what overflowed ends in any units
        units = Units.fit(e.model, k, y, self.size[at])
        # By powers of two throughout, so that new units change no digit.
        faster = units.rate - self.rate[at]
        self.now[:m, at] = np.ldexp(self.now[:m, at], self.size[at] - units.size)
        self.now[m, at], self.rest[at] = np.ldexp((self.now[m, at], self.rest[at]), faster)
        scaled = units.constants(e.model, k)
        for name, row in e.scaled_rows.items():
            self.k[row + 1, at] = scaled[name]
        self.size[at], self.rate[at] = units.size, units.rate


def padded(numbers: np.ndarray) -> np.ndarray:
    """Numbers (n,), with copies of the last one up to a multiple of the engine's width."""
    from ..engines.taylor_batch import WIDTH  # heyoka may be missing

    return np.asarray(np.pad(numbers, (0, -len(numbers) % WIDTH), mode="edge"))


@np.errstate(all="ignore")  # what overflows is not finite, hence unsettled
def advance(e: Ensemble) -> Outcome:
    """All motions of an ensemble through their span."""
    from ..engines import taylor_batch  # heyoka may be missing

    step = taylor_batch.build(e.model, e.structure, e.event, e.tol)  # type: ignore[arg-type]
    outcome, feasible = Outcome.blank(*e.start.shape), e.feasible()
    if feasible.size:
        underway = Underway(e, step, feasible, outcome)
        while underway.number.size:
            # Numpy's own work is in the pauses; between them a step is one call of compiled code.
            for _ in range(PAUSE):
                underway.advance()
            underway.pause()
        if e.event is not None:
            judge(e, e.event, underway.suspects, step.order, outcome)
    outcome.settled &= np.isfinite(outcome.state).all(axis=0)
    return outcome


def judge(
    e: Ensemble, event: Event, suspects: list[Suspects], order: int, outcome: Outcome
) -> None:
    """Find the zeros of an event's function in the steps that may have some.

    A motion is settled if its zeros lead, by turns, from the sign at its start to that at its end,
    and none of these is in doubt.
    """
    if suspects:
        found, undecided = passages(e, event, suspects, order)
        if event.terminal:
            found = first_of_each(found)
            outcome.state[:, found.motion] = found.state
            outcome.exponent[found.motion] = found.exponent
        outcome.passages = found
        outcome.settled[undecided] = False
    passed = outcome.passages
    outcome.first, outcome.last = e.side(e.start), e.side(outcome.state)
    if event.terminal:
        outcome.last[passed.motion] = passed.direction
    new = np.diff(passed.motion, prepend=-1) != 0
    before = np.where(new, outcome.first[passed.motion], np.roll(passed.direction, 1))
    outcome.settled[passed.motion[passed.direction != -before]] = False
    reached = outcome.first.copy()
    reached[passed.motion] = passed.direction  # of several, the last one counts
    outcome.settled &= (reached == outcome.last) & (outcome.first != 0)


def passages(
    e: Ensemble, event: Event, suspects: list[Suspects], order: int
) -> tuple[Passages, np.ndarray]:
    """The zeros in steps that may have some, and the motions that are undecided.

    The coefficients are computed anew, on arrays: these are few steps, and a second compilation
    would cost more than 100,000 motions."""
    steps = Suspects(*(np.concatenate(parts, axis=-1) for parts in zip(*suspects, strict=True)))
    k, m = namespace(e.structure, list(steps.k[1:])), len(e.start)
    start = [*steps.before[:m]]
    time, state = motion(e.model.rhs, steps.k[0] - steps.before[m], start, k)
    D = coefficients(event.function(time, state, k), order, steps.length)
    noise = e.uncertainty(event, steps.before[:m], k)
    powers = D.T * steps.length[:, None] ** np.arange(order + 1)
    # Row by row: one product of all would round as the number of rows happens to be.
    bernstein = np.matmul(powers[:, None], to_bernstein(TAYLOR, order, D.dtype))[:, 0]
    found = zeros(bernstein, noise)
    at = found.row[found.sure]
    place = found.x[found.sure] * steps.length[at]
    slope = value(D[1:, at] * np.arange(1, order + 1)[:, None], place)
    there = [value(coefficients(y, order, steps.length)[:, at], place) for y in state]
    left = (steps.before[m, at] - place) + steps.rest[at]
    # Counted from the end: the time left is what the steps keep exactly.
    times = e.span[1] - np.ldexp(left, -steps.rate[at])
    by_time = np.lexsort((times, steps.motion[at]))
    direction = np.sign(slope).astype(np.int64)
    columns = steps.motion[at], times, direction, np.array(there), steps.size[at]
    undecided = steps.motion[found.row[~found.sure]]
    return Passages(*(a[..., by_time] for a in columns)), undecided


def coefficients(series: Any, order: int, like: np.ndarray) -> np.ndarray:
    """Those of a series of arrays (order + 1, k), each as long as `like`."""
    return np.array([np.broadcast_to(series[i], like.shape) for i in range(order + 1)])


def first_of_each(passed: Passages) -> Passages:
    """The first passage of each motion."""
    first = np.diff(passed.motion, prepend=-1) != 0
    return Passages(*(a[..., first] for a in passed))
