"""Many motions of one model side by side: their ends, and the zeros of an event's function.

What `integrate` and `classify` do for one case is done here for arrays of them, step by step. A
motion of which anything is uncertain (too near the separatrix, too stiff, at rest, zeros that do
not alternate) is left, not accepted, for these two to decide by themselves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..engines.polynomial import TAYLOR, isolate, to_bernstein
from ..engines.protocol import uneven
from ..engines.series import value
from ..integration.choice import MANY_STEPS
from ..integration.driver import LIMIT, at_rest
from ..integration.trajectory import Occurrence
from ..integration.units import TimeWindow, Units
from ..models.base import Event, Model
from ..models.constants import UNIT, VELOCITY, Structure, moving, namespace, rescaled
from ..models.rigid_body import Separatrix

if TYPE_CHECKING:
    from ..engines.taylor_batch import TaylorStep

BAND, WIDE_BAND = (1 / 16, 16.0), (1 / 256, 256.0)
"""The largest component of a scaled state that needs no new units. heyoka's control of the error is
absolute below 1, so that a motion at 1/16 has lost a digit. Units are renewed outside of BAND at
every RENEWAL-th pause, since numpy spends more on the call, some 0.1 ms, than on a thousand
motions, and at every pause outside of WIDE_BAND, where few motions ever get. When, does not hang on
other motions."""

RENEWAL = 4

MOST_STEPS = int(4 * MANY_STEPS)
"""Steps after which a motion is left to the driver of single cases."""

HOPELESS = 100 * MANY_STEPS
"""Steps that a motion would need at the pace of its first ones, beyond which it is left at once."""

PAUSE = 6
"""Steps from one look for motions that are at their end or have outgrown their units to the next:
1.5 % of the steps are idle for it, and looking costs as much as a third of a step."""

FULL = 0.93
"""The part of the columns that must be under way; with fewer, the others are dropped. Copying all
columns costs about as much as one step."""

ERROR_BOUND, PER_TOLERANCE = 1e-9, 1e3
"""The error of a state is taken to stay below this part of it, or so many tolerances: where that
could turn the sign of an event's function, the sign is uncertain. It is no measured error, as
single cases have, but ERROR_BOUND is a hundred times what the rounding of MOST_STEPS adds up to,
and no ensemble was off by more than three tolerances. It leaves one random motion in some 1e8 to
the single cases, so that a finer bound would gain nothing."""

STEP_ROUNDING, PER_STEP = 2.0**-52, 1 / 16
"""The part of a state that a step is taken to lose to rounding, and, in tolerances, to the end of
the series. What follows for the times of crossings was two to three times the largest error in
random ensembles of all models (tests/test_sweep.py), and some fifty times the common one."""

LOOSER, GROWN = 16, 32
"""The tolerances that a step takes where the growth of errors is looked for, and the error that a
crossing may have in differences that this makes. A difference may be small by chance. For 6 of
35,000 crossings of tensors and cavities the error that steps lose was too small, and the difference
a quarter of the true one at the least. For four in five, GROWN differences enlarge nothing."""


class Passages(NamedTuple):
    """Zeros (k,) of an event's function, in order of motion and time: the error that the time may
    have, how long about it the function's sign is uncertain, the direction, +1 where the function
    rises through 0, and the state (m, k) there in units of 2**exponent."""

    motion: np.ndarray
    time: np.ndarray
    error: np.ndarray
    uncertainty: np.ndarray
    direction: np.ndarray
    state: np.ndarray
    exponent: np.ndarray


class TerminalHits(NamedTuple):
    """Motions (k,) that go on through an event: the times, and their states (m, k) then."""

    motion: np.ndarray
    time: np.ndarray
    state: np.ndarray


@dataclass(frozen=True)
class Ensemble:
    """n motions: the constants of their equations (c, n), flat as `structure` says, their states at
    the start (m, n), the times at which they begin, one or (n,), and end, the event that is looked
    for, and the tolerance, of which each step takes `looser`."""

    model: type[Model]
    structure: Structure
    constants: np.ndarray
    start: np.ndarray
    span: tuple[float | np.ndarray, float]
    event: Event | None
    tol: float
    times: np.ndarray = field(default_factory=lambda: np.empty(0))
    looser: float = 1.0

    @property
    def error_bound(self) -> float:
        """The part of a state that its error is taken to stay below."""
        return max(ERROR_BOUND, PER_TOLERANCE * self.tol)

    @property
    def lengths(self) -> np.ndarray:
        """How long each motion takes, as the sum of two rows (2, n)."""
        begin = np.broadcast_to(self.span[0], self.start.shape[1])
        return np.array(exact_difference(self.span[1], begin))

    def named(self, at: Any = slice(None)) -> SimpleNamespace:
        """The constants of the motions `at` by name."""
        return namespace(self.structure, list(self.constants[:, at]))

    @cached_property
    def inertia(self) -> np.ndarray:
        """A1, A2, A3 (3, n)."""
        k = self.named()
        return np.array([k.A1, k.A2, k.A3])

    def is_one_sided(self, event: Event) -> np.ndarray:
        """Whether (n,) an event is that of the separatrix of a body with two equal moments: D is
        then a single square, which touches 0 but changes no sign."""
        if not isinstance(event.function, Separatrix):
            return np.zeros(self.start.shape[1], dtype=bool)
        smallest, middle, largest = np.sort(self.inertia, axis=0)
        return np.asarray((smallest == middle) | (middle == largest))

    @cached_property
    def scaled_rows(self) -> dict[str, slice]:
        """Where among the constants those stand that change with the units."""
        rows, first = {}, 0
        for name, size in self.structure:
            length = max(size, 1) if isinstance(size, int) else 0
            rows[name] = slice(first, first + length)
            first += length
        return {name: rows[name] for name in (*self.model.degree, UNIT, VELOCITY) if name in rows}

    @property
    def is_timed(self) -> bool:
        """Whether the motions have units of their own, and equations that contain the time."""
        return UNIT in self.scaled_rows

    def uncertainty(self, event: Event, t: Any, y: np.ndarray, k: SimpleNamespace) -> np.ndarray:
        """How far an event's function (n,) may be off in states y (m, n) at the time t: its slope
        along each component, by a complex step, times the error that the largest one may have.

        The slopes are those where all components are as large as the largest: what D has lost while
        its terms were large is still lost when they have become small, near the middle axis.
        """
        size = np.abs(y[moving(self.model)]).max(axis=0)
        tilts = [size + 1e-100j * np.eye(len(y))[:, [i]] for i in range(len(y))]
        slopes = [np.abs(np.imag(event.function(t, [*tilt], k))) / 1e-100 for tilt in tilts]
        return np.asarray(self.error_bound * size * sum(slopes))

    def side(self, t: Any, y: np.ndarray) -> np.ndarray:
        """The sign (n,) of the event's function in states y (m, n) at the time t, 0 where it is
        uncertain."""
        assert self.event is not None
        k = self.named()
        off = self.event.function(t, [*y], k)
        return np.where(np.abs(off) > self.uncertainty(self.event, t, y, k), np.sign(off), 0)


@dataclass
class Outcome:
    """What became of n motions: states at the end (m, n) in units of 2**exponent (n,), samples (m,
    n, s) in units of 2**sample_exponent (n, s), and the zeros of the event's function, with its
    sign at both ends.

    A terminal event ends a motion; one with a passage is left to `advance_through`. Nothing here
    counts where `accepted` is False.
    """

    state: np.ndarray
    exponent: np.ndarray
    steps: np.ndarray
    accepted: np.ndarray
    passages: Passages
    first: np.ndarray
    last: np.ndarray
    samples: np.ndarray
    sample_exponent: np.ndarray
    departures: Sequence[TerminalHits] = ()

    @classmethod
    def blank(cls, m: int, n: int, s: int) -> "Outcome":
        """Nothing known of n motions."""
        exponent, steps, first, last = np.zeros((4, n), dtype=np.int64)
        none = np.empty(0, dtype=np.int64)
        empty = np.empty(0)
        passages = Passages(none, empty, empty, empty, none, np.empty((m, 0)), none)
        accepted = np.zeros(n, dtype=bool)
        state, samples = np.full((m, n), np.nan), np.full((m, n, s), np.nan)
        sample_exponent = np.zeros((n, s), dtype=np.int64)
        return cls(
            state, exponent, steps, accepted, passages, first, last, samples, sample_exponent
        )


STRIDE, NUMBER, SIZE, RATE = range(-4, 0)
"""The last rows of a column's params: the `stride` of its steps, the number of its motion, and its
units."""

TIME_ROWS = 3
"""Rows of a column after its state: the time left, what rounding has taken from it, and the steps
taken."""


class CandidateSteps(NamedTuple):
    """Steps (k,) in which an event's function may have zeros: the columns at their start (m + 3,
    k), their length, and their params."""

    before: np.ndarray
    length: np.ndarray
    params: np.ndarray


@dataclass
class BatchState:
    """The motions of an ensemble that have not reached their end, in columns.

    Rows of `now`: the state, in units of its own, its TIME_ROWS, and what else a step puts out.
    Rows of `params`: the time of the end and the constants, in these units, and what stands last
    (STRIDE to RATE). The columns are a multiple of the engine's width; one without a motion has the
    number -1 and no time left.
    """

    ensemble: Ensemble
    step: "TaylorStep"
    outcome: Outcome
    pauses: int = 0
    candidates: list[CandidateSteps] = field(default_factory=list)
    departures: list[TerminalHits] = field(default_factory=list)
    history: list[np.ndarray] = field(default_factory=list)

    def __post_init__(self) -> None:
        from ..engines.taylor_batch import stride  # heyoka may be missing

        e, m = self.ensemble, self.m
        # Those of uneven starts are left to single cases, whose steps can be limited.
        omega = e.start[moving(e.model)]
        begun = np.flatnonzero((omega != 0).any(axis=0) & ~uneven(omega))
        number = padded(begun)
        self.now, self.next = np.zeros((2, self.step.rows, len(number)))
        self.now[:m], self.now[m : m + 2] = e.start[:, number], e.lengths[:, number]
        self.params = np.zeros((len(e.constants) + 5, len(number)))
        self.params[0], self.params[1:STRIDE] = e.span[1], e.constants[:, number]
        self.params[STRIDE], self.params[NUMBER] = stride(e.looser * e.tol, e.event), number
        self.renew(np.arange(len(number)))
        self.empty(len(begun))
        at_start = e.times <= np.reshape(e.span[0], (-1, 1))
        np.copyto(self.outcome.samples, e.start[:, :, None], where=at_start)

    @property
    def m(self) -> int:
        """The number of state variables; the row of the time left."""
        return len(self.ensemble.start)

    def empty(self, first: int) -> None:
        """Mark the columns from the `first` on as without a motion."""
        self.now[self.m, first:], self.params[NUMBER, first:] = 0, -1

    def advance(self) -> None:
        """One step of every motion."""
        length = self.m + TIME_ROWS
        self.step(self.now[:length], self.params[:NUMBER], self.next)
        if self.ensemble.times.size:
            self.history.append(self.now[:length].copy())
        if self.step.rows > length + 1:
            self.note_candidates(np.flatnonzero(self.next[length + 1] < 0))
        self.now, self.next = self.next, self.now

    def sample(self) -> None:
        """Enter the states at the sample times within the steps since the last pause: a sample is a
        step that has no more time left."""
        e, m = self.ensemble, self.m
        number, size, rate = self.params[NUMBER:].astype(np.int64)
        history = np.stack(
            [*self.history, self.now[: m + TIME_ROWS]], axis=1
        )  # (m + TIME_ROWS, steps + 1, n)
        self.history.clear()
        # A motion at its end has none left, though rounding has taken some of it.
        lost = np.where(history[m] > 0, history[m + 1], 0)
        time, rest = time_reached(e.span[1], history[m], lost, rate)
        step, at = map(padded, times_within(e.times, time + rest))
        column = step % len(number)
        before = history[:, :-1].reshape(m + TIME_ROWS, -1).take(step, axis=1)
        since = (e.times[at] - time.ravel()[step]) - rest.ravel()[step]
        place = np.ldexp(since, rate[column])
        k = self.params[:NUMBER].take(column, axis=1)
        # Row by row, which is four times as fast as all rows at once.
        entry = number[column] * len(e.times) + at
        there = states_after(self.step, *shortened(before, k, place, rate[column]))
        for samples, values in zip(self.outcome.samples, there, strict=True):
            samples.reshape(-1)[entry] = values
        self.outcome.sample_exponent.reshape(-1)[entry] = size[column]

    def note_candidates(self, at: np.ndarray) -> None:
        """Remember the steps just taken in the columns `at`, where the event's function may have
        zeros; a motion that is seen to have passed a terminal event stops."""
        if not at.size:
            return
        m, event = self.m, self.ensemble.event
        before, after, params = (a.take(at, axis=1) for a in (self.now, self.next, self.params))
        if event is None or not event.passage:
            self.candidates.append(
                CandidateSteps(before[: m + TIME_ROWS], after[m + TIME_ROWS], params)
            )
        # Only the sign at the ends is looked at here; where in the step it ended is found at the
        # end, for all at once.
        if event is not None and event.terminal:
            k = namespace(self.ensemble.structure, list(params[1:STRIDE]))
            times = (times_of(y, params, self.ensemble.span[1], m) for y in (before, after))
            ends = (
                event.function(t, [*y[:m]], k) for t, y in zip(times, (before, after), strict=True)
            )
            stopped = np.multiply(*ends) < 0
            if event.passage:
                self.note_hits(after[:, stopped], params[:, stopped])
            self.next[m, at[stopped]] = 0

    def note_hits(self, after: np.ndarray, params: np.ndarray) -> None:
        """Note the motions that go on through an event, in columns as they are now.

        Its formulas begin from any state behind its zero, so that this need not be found.
        """
        e, m = self.ensemble, self.m
        size, _ = units_of(params)
        state = rescaled(e.model, after[:m].T, size).T if e.model.degree else after[:m]
        time = times_of(after, params, e.span[1], m)
        self.departures.append(TerminalHits(params[NUMBER].astype(np.int64), time, state))

    def pause(self) -> None:
        """Drop the motions that are at their end, and renew units that no longer fit."""
        self.pauses += 1
        if self.history:
            self.sample()
        (left, lost, steps), params = self.now[self.m : self.m + TIME_ROWS], self.params
        going = (left > 0) & (steps < MOST_STEPS)
        # What rounding took from the time left, back to it before it decides the last steps.
        whole = left + lost
        lost += left - whole
        np.copyto(left, whole, where=going)
        event = self.ensemble.event
        # An averaged motion is slow at the separatrix only, where its steps are the shorter.
        if self.pauses == 1 and not (event and event.passage):
            number = params[NUMBER].astype(np.int64)
            span = np.ldexp(self.ensemble.lengths[0, number], units_of(params)[1])
            going &= PAUSE * span < HOPELESS * (span - left)
        if np.count_nonzero(going) < FULL * len(going):
            self.drop(~going)
        if self.ensemble.model.degree:
            largest = np.abs(self.now[: self.m][moving(self.ensemble.model)]).max(axis=0)
            low, high = WIDE_BAND if self.pauses % RENEWAL else BAND
            outgrown = (largest < low) | (largest > high)
            self.renew(np.flatnonzero(outgrown & (self.now[self.m] > 0)))

    def drop(self, done: np.ndarray) -> None:
        """Enter the columns that are done in the outcome, and keep the others."""
        ended = np.flatnonzero(done & (self.params[NUMBER] >= 0))
        number, size, _ = self.params[NUMBER:, ended].astype(np.int64)
        outcome = self.outcome
        outcome.state[:, number], outcome.exponent[number] = self.now[: self.m, ended], size
        left, _, outcome.steps[number] = self.now[self.m : self.m + TIME_ROWS, ended]
        outcome.accepted[number] = left == 0
        going = np.flatnonzero(~done)
        keep = padded(going)
        self.now, self.params = (a.take(keep, axis=1) for a in (self.now, self.params))
        self.next = np.empty_like(self.now)
        self.empty(len(going))

    def renew(self, at: np.ndarray) -> None:
        """Fit the units of the columns `at` to their motions."""
        e, m = self.ensemble, self.m
        if not e.model.degree or not at.size:
            return
        params = self.params[:, at]
        size, rate = units_of(params)
        number = params[NUMBER].astype(np.int64)
        y, k = self.now[:m, at], vars(e.named(number))
        y = np.where(np.isfinite(y).all(axis=0), y, 1.0)  # what overflowed ends in any units
        moment = None
        if e.is_timed:
            moment = TimeWindow(
                times_of(self.now[:, at], params, e.span[1], m), e.lengths[0, number]
            )
        units = Units.fit(e.model, k, y, size, moment)
        # By powers of two throughout, so that new units change no digit.
        self.now[:m, at] = rescaled(e.model, self.now[:m, at].T, size - units.size).T
        self.now[m : m + 2, at] = np.ldexp(self.now[m : m + 2, at], units.rate - rate)
        scaled = units.constants(e.model, k)
        for name, rows in e.scaled_rows.items():
            params[1:STRIDE][rows] = scaled[name]
        params[SIZE], params[RATE] = units.size, units.rate
        self.params[:, at] = params


def units_of(params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The size and the rate (k,) of the units of columns, from their params."""
    size, rate = params[[SIZE, RATE]].astype(np.int64)
    return size, rate


def exact_difference(a: Any, b: Any) -> tuple[Any, Any]:
    """a - b (...) as its rounded value and the rest.

    Source: D. E. Knuth, The Art of Computer Programming 2, section 4.2.2.
    """
    high = a - b
    minus_b = high - a
    return high, (a - (high - minus_b)) - (b + minus_b)


def time_reached(end: float, left: Any, lost: Any, rate: Any) -> tuple[Any, Any]:
    """The times (...) of columns from their TIME_ROWS and the rate of their units, as sums of two:
    early in a long span the time left has fewer digits than the time itself."""
    time, rest = exact_difference(end, np.ldexp(left, -rate))
    return time, rest - np.ldexp(lost, -rate)


def times_of(columns: np.ndarray, params: np.ndarray, end: float, m: int) -> np.ndarray:
    """The case's own times (k,) of columns with m state variables."""
    return np.asarray(sum(time_reached(end, columns[m], columns[m + 1], units_of(params)[1])))


def times_within(times: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The times (s,) that steps reach, which lie between edges (steps + 1, n): the step (k,), row
    by row, and the place (k,) of the time."""
    passed = np.searchsorted(times, edges, side="right")
    new = np.diff(passed, axis=0).ravel()
    step = np.repeat(np.arange(len(new)), new)
    before = np.cumsum(new) - new
    return step, passed[:-1].ravel()[step] + np.arange(len(step)) - before[step]


def padded(numbers: np.ndarray) -> np.ndarray:
    """Numbers (n,), with copies of the last one up to a multiple of the engine's width."""
    from ..engines.taylor_batch import WIDTH  # heyoka may be missing

    n = len(numbers)
    return numbers[np.minimum(np.arange(n + -n % WIDTH), n - 1)]


@np.errstate(all="ignore")  # what overflows is not finite, hence not accepted
def advance(e: Ensemble) -> Outcome:
    """All motions of an ensemble through their span."""
    from ..engines import taylor_batch  # heyoka may be missing

    # Its code is the same whether the event ends a motion or not.
    event = e.event and e.event._replace(terminal=False)
    step = taylor_batch.build(e.model, e.structure, event)  # type: ignore[arg-type]
    m, n = e.start.shape
    outcome = Outcome.blank(m, n, len(e.times))
    if e.start.any():
        batch = BatchState(e, step, outcome)
        while batch.params.shape[1]:
            # Numpy's own work is in the pauses; between them a step is one call of compiled code.
            for _ in range(PAUSE):
                batch.advance()
            batch.pause()
        outcome.departures = batch.departures
        if e.event is not None and not e.event.passage:
            judge(e, e.event, batch.candidates, step, outcome)
    if e.model.degree and e.model.oriented:
        stop_at_rest(outcome)
    outcome.accepted &= np.isfinite(outcome.state).all(axis=0)
    for state in (e.start, outcome.state):  # single cases refine what approximates the equations
        outcome.accepted &= e.model.is_accurate(state, e.named(), e.tol)
    return outcome


def stop_at_rest(outcome: Outcome) -> None:
    """Put motions that have become too slow to be followed at rest, as single cases are."""
    for state, exponent in (
        (outcome.state, outcome.exponent),
        (outcome.samples, outcome.sample_exponent),
    ):
        if exponent.size and exponent.min() < -LIMIT:
            resting = at_rest(np.moveaxis(state[:3], 0, -1), exponent)
            state[:3, resting], exponent[resting] = 0, -LIMIT
    passed = outcome.passages
    moved = ~at_rest(passed.state[:3].T, passed.exponent)
    outcome.passages = Passages(*(column[..., moved] for column in passed))
    outcome.last[(outcome.state[:3] == 0).all(axis=0)] = 0


def advance_through(e: Ensemble) -> tuple[Outcome, dict[int, list[Occurrence]]]:
    """All motions of an ensemble through their span and the events that take them on, with these
    events of each that has met any."""
    outcome = advance(e)
    met: dict[int, list[Occurrence]] = {}
    part, numbers = outcome, np.arange(e.start.shape[1])
    while onward := [
        going
        for left in part.departures
        for going in restart_after_event(
            e, left._replace(motion=numbers[left.motion]), outcome, met
        )
    ]:
        numbers = np.array([motion for motion, _, _ in onward])
        begin = np.array([time for _, time, _ in onward], dtype=float)
        start = np.array([state for _, _, state in onward], dtype=float).T
        constants, span = e.constants[:, numbers], (begin, e.span[1])
        part = advance(replace(e, constants=constants, start=start, span=span))
        outcome.state[:, numbers], outcome.accepted[numbers] = part.state, part.accepted
        outcome.exponent[numbers] = part.exponent
        outcome.steps[numbers] += part.steps
    outcome.accepted &= np.isfinite(outcome.state).all(axis=0)
    return outcome, met


def restart_after_event(
    e: Ensemble, hits: TerminalHits, outcome: Outcome, events: dict[int, list[Occurrence]]
) -> list[tuple[int, Any, Any]]:
    """Enter what an event does to the motions that have met it; returns those that go on, with the
    time and the state from which on."""
    assert e.event is not None
    assert e.event.passage is not None
    onward = []
    for i, time, state in zip(hits.motion, hits.time, hits.state.T, strict=True):
        k = namespace(e.structure, e.constants[:, i].tolist())
        try:
            passage = e.event.passage(float(time), state.tolist(), k)
        except (ValueError, ArithmeticError):  # a step has led beyond the passage itself
            outcome.accepted[i] = False
            continue
        if passage.details is not None:
            events.setdefault(int(i), []).append(
                Occurrence(e.event.kind, passage.time, passage.details)
            )
        outcome.state[:, i], outcome.exponent[i] = passage.state, 0
        if passage.onward is not None and passage.onward < e.span[1]:
            onward.append((int(i), passage.onward, passage.state))
    return onward


def judge(
    e: Ensemble,
    event: Event,
    candidates: list[CandidateSteps],
    step: "TaylorStep",
    outcome: Outcome,
) -> None:
    """Find the zeros of an event's function in the steps that may have some.

    A motion is accepted if its zeros lead, by turns, from the sign at its start to that at its end,
    and none of these is uncertain.
    """
    outcome.first, outcome.last = e.side(e.span[0], e.start), e.side(e.span[1], outcome.state)
    # With an uncertain sign a motion is not accepted, whatever zeros it has.
    certain = (outcome.first != 0) & (event.terminal | (outcome.last != 0))
    steps = steps_of(candidates, certain & ~e.is_one_sided(event))
    if steps is not None:
        zeros, undecided = passages(e, event, steps, step)
        if event.terminal:
            zeros = first_of_each(zeros)
            outcome.state[:, zeros.motion] = zeros.state
            outcome.exponent[zeros.motion] = zeros.exponent
        outcome.passages = zeros
        outcome.accepted[undecided] = False
    passed = outcome.passages
    if event.terminal:
        outcome.last[passed.motion] = passed.direction
    new = is_first(passed.motion)
    before = np.where(new, outcome.first[passed.motion], np.roll(passed.direction, 1))
    outcome.accepted[passed.motion[passed.direction != -before]] = False
    sign = outcome.first.copy()
    sign[passed.motion] = passed.direction  # of several, the last one counts
    outcome.accepted &= (sign == outcome.last) & (outcome.first != 0)


def steps_of(candidates: list[CandidateSteps], certain: np.ndarray) -> CandidateSteps | None:
    """All steps of those motions that are `certain` (n,); None if there are none."""
    if not candidates:
        return None
    steps = CandidateSteps(
        *(np.concatenate(parts, axis=-1) for parts in zip(*candidates, strict=True))
    )
    wanted = np.flatnonzero(certain[steps.params[NUMBER].astype(np.int64)])
    return CandidateSteps(*(a.take(wanted, axis=-1) for a in steps)) if wanted.size else None


def passages(
    e: Ensemble, event: Event, steps: CandidateSteps, step: "TaylorStep"
) -> tuple[Passages, np.ndarray]:
    """The zeros in steps that may have some, and the motions that are undecided."""
    before, params, m = steps.before, steps.params, len(e.start)
    series = columnwise(step.event_series, before, params[:NUMBER])
    k = namespace(e.structure, list(params[1:STRIDE]))
    noise = e.uncertainty(event, times_of(before, params, e.span[1], m), before[:m], k)
    order = len(series) - 1
    powers = series.T * steps.length[:, None] ** np.arange(order + 1)
    # Row by row: one product of all would round as the number of rows happens to be.
    bernstein = np.matmul(powers[:, None], to_bernstein(TAYLOR, order, series.dtype))[:, 0]
    zeros = isolate(bernstein, noise)
    at = zeros.row[zeros.sure]
    place = zeros.x[zeros.sure] * steps.length[at]
    slope = value(series[1:, at] * np.arange(1, order + 1)[:, None], place)
    size, rate = units_of(params[:, at])
    begun, rest = time_reached(e.span[1], before[m, at], before[m + 1, at], rate)
    times = begun + (rest + np.ldexp(place, -rate))
    cut = shortened(before[:, at], params[:NUMBER, at], place, rate)
    state = columnwise(partial(states_after, step), *cut)
    motion = params[NUMBER, at].astype(np.int64)
    part = (STEP_ROUNDING + PER_STEP * e.tol) * (before[m + 2, at] + 2) / e.error_bound
    uncertainty = np.ldexp(noise[at] / np.abs(slope), -rate)
    errors = part * uncertainty + np.spacing(np.abs(times)) / 2
    by_time = np.lexsort((times, motion))
    columns = motion, times, errors, uncertainty, np.sign(slope).astype(np.int64), state, size
    undecided = params[NUMBER, zeros.row[~zeros.sure]].astype(np.int64)
    return Passages(*(a[..., by_time] for a in columns)), undecided


def shortened(
    columns: np.ndarray, k: np.ndarray, place: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Columns and constants with no more time left than `place` (k,), in the arrays given; their
    unit of time is 2**-rate (k,)."""
    m = len(columns) - TIME_ROWS
    k[0] += np.ldexp(place - columns[m], -rate)  # the end, so that the step begins when it did
    columns[m] = place
    return columns, k


def states_after(step: "TaylorStep", columns: np.ndarray, k: np.ndarray) -> np.ndarray:
    """The states (m, k) a step after columns, whose number is a multiple of the engine's width."""
    out = np.empty((step.rows, columns.shape[1]))
    step(columns, k, out)
    return out[: len(columns) - TIME_ROWS]


def columnwise(
    function: Callable[[np.ndarray, np.ndarray], np.ndarray], columns: np.ndarray, k: np.ndarray
) -> np.ndarray:
    """A compiled function of columns and constants, padded to the width that it wants."""
    n = columns.shape[1]
    some = padded(np.arange(n))
    return function(*(a.take(some, axis=1) for a in (columns, k)))[:, :n]


def first_of_each(passed: Passages) -> Passages:
    """The first passage of each motion."""
    return Passages(*(a[..., is_first(passed.motion)] for a in passed))


def is_first(motion: np.ndarray) -> np.ndarray:
    """Whether (k,) the motion is another than before."""
    return np.asarray(np.diff(motion, prepend=-1) != 0)


def measure_crossings(e: Ensemble, outcome: Outcome) -> None:
    """Enlarge the errors of first crossings to what a second integration, with other steps, shows.

    Errors grow along a motion that stays near the separatrix, some 1e4-fold: a pass by the middle
    axis turns one of D into one of the phase, and a torque that depends on the phase turns that
    into a larger one of D. No single step tells it. A motion whose two times differ by more than
    the sign of D is taken to be uncertain is not accepted.
    """
    assert e.event is not None
    passed = outcome.passages
    at = np.flatnonzero(is_first(passed.motion) & outcome.accepted[passed.motion])
    motion, event = passed.motion[at], e.event._replace(terminal=True)
    start, constants = e.start[:, motion], e.constants[:, motion]
    again = advance(replace(e, start=start, constants=constants, event=event, looser=LOOSER))
    time = np.full(len(motion), np.inf)
    time[again.passages.motion] = again.passages.time
    off = np.abs(time - passed.time[at])
    passed.error[at] = np.maximum(passed.error[at], GROWN * off)
    outcome.accepted[motion] = again.accepted & (off <= passed.uncertainty[at])
