"""An ensemble of motions, what became of them, and their steps in columns, with the states and
zeros within these."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...engines.polynomial import TAYLOR, Zeros, isolate, to_bernstein
from ...engines.protocol import Coded
from ...engines.units import is_falling
from ...integration import Occurrence
from ...models.base import (
    UNIT,
    VELOCITY,
    Equations,
    Event,
    Structure,
    moving,
    namespace,
    stacked,
)

if TYPE_CHECKING:
    from ...engines.taylor_batch import TaylorStep

ERROR_BOUND, PER_TOLERANCE = 1e-9, 1e3
"""The error of a state is taken to stay below this part of it, or so many tolerances: where that
could turn the sign of an event's function, the sign is uncertain. It is no measured error, as
single cases have, but ERROR_BOUND is a hundred times what the rounding of all steps adds up to, and
no ensemble was off by more than three tolerances. It leaves few random motions to the
single cases: of 200,000 tensors 10, at 20 ms each, and of as many linear-diag none."""


class Rejection(Coded):
    """Why a motion is not accepted, in the words of a result."""

    NONE = ""
    EVENTS = "more than one event"
    AT_REST = "stays at rest at first"
    UNEVEN = "starts with a component that is small beside another"
    SLOW = "too many steps"
    UNIT = "rates far from 1 in the unit of time"
    OUTGROWN = "numbers beyond the largest double"
    UNCERTAIN = "the sign of an event's function is uncertain"
    ASTRAY = "a step of unknown length, over a corner, or beyond the passage of an event"
    SAMPLES = "samples of motions that go on through an event"


class Passages(NamedTuple):
    """Where (k,) motions pass from one side to another, in order of motion and time: the error that
    the time may have, how long about it the side is uncertain, the sides before and behind it, and
    the state (m, k) there in units of 2**exponent. A side is the sign of an event's function."""

    motion: np.ndarray
    time: np.ndarray
    error: np.ndarray
    uncertainty: np.ndarray
    before: np.ndarray
    after: np.ndarray
    state: np.ndarray
    exponent: np.ndarray

    def chosen(self, index: np.ndarray) -> "Passages":
        """Some of them, by position or by a mask."""
        return Passages(*(column[..., index] for column in self))

    @classmethod
    def none(cls, m: int) -> "Passages":
        """None, of motions with states (m,)."""
        whole, empty = np.empty(0, dtype=np.int64), np.empty(0)
        return cls(whole, empty, empty, empty, whole, whole, np.empty((m, 0)), whole)

    @property
    def is_first(self) -> np.ndarray:
        """Whether (k,) each is the first of its motion."""
        return np.asarray(np.diff(self.motion, prepend=-1) != 0)


@dataclass(frozen=True)
class Ensemble:
    """n motions: whose they are among the cases or members asked for, by position (n,), the
    constants of their equations (c, n), flat as its `structure` says, their states at the start
    (m, n), the times at which they begin and end, each one or (n,), their events, and the
    tolerance, of which each step takes `looser`. `searches` says whether zeros of events are looked
    for."""

    members: np.ndarray
    model: Equations
    constants: np.ndarray
    start: np.ndarray
    span: tuple[Any, Any]
    events: tuple[Event, ...]
    tol: float
    times: np.ndarray = field(default_factory=lambda: np.empty(0))
    looser: float = 1.0
    searches: bool = True

    @cached_property
    def step(self) -> "TaylorStep":
        """The compiled step of the motions."""
        from ...engines import taylor_batch  # heyoka may be missing

        # Its code is the same whether the event ends a motion or not.
        events = tuple(event._replace(terminal=False) for event in self.events)
        return taylor_batch.build(self.model, events)

    @cached_property
    def event(self) -> Event | None:
        """The event whose zeros are looked for."""
        looked_for = (event for event in self.events if self.searches and not event.passage)
        return next(looked_for, None)

    @cached_property
    def passing(self) -> Event | None:
        """The event with a passage, through which motions go on."""
        return next((event for event in self.events if event.passage), None)

    @property
    def error_bound(self) -> float:
        """The part of a state that its error is taken to stay below."""
        return max(ERROR_BOUND, PER_TOLERANCE * self.tol)

    @property
    def lengths(self) -> np.ndarray:
        """How long each motion takes, as the sum of two rows (2, n)."""
        begin, end = (np.broadcast_to(time, self.start.shape[1]) for time in self.span)
        return np.array(exact_difference(end, begin))

    def named(self, motions: Any = slice(None)) -> SimpleNamespace:
        """The constants of some motions by name."""
        return namespace(self.model.structure, list(self.constants[:, motions]))

    @cached_property
    def inertia(self) -> np.ndarray:
        """A1, A2, A3 (3, n)."""
        k = self.named()
        return np.array([k.A1, k.A2, k.A3])

    @cached_property
    def onset(self) -> np.ndarray:
        """The start (m, n), of motions at rest the rates there: what they turn along as soon as
        they turn."""
        rates = self.model.rhs(self.span[0], [*self.start], self.named())
        return np.where(self.at_rest, stacked(rates, self.start), self.start)

    @cached_property
    def at_rest(self) -> np.ndarray:
        """Whether (n,) the motions begin at rest."""
        return np.asarray((self.start[moving(self.model)] == 0).all(axis=0))

    @cached_property
    def falling(self) -> np.ndarray:
        """Whether (n,) the motions call for units of their state alone; see `is_falling`."""
        return is_falling(self.model, vars(self.named()), self.start)

    @property
    def is_one_sided(self) -> np.ndarray:
        """Whether (n,) the event is that of the separatrix of a body with two equal moments: D is
        then a single square, which touches 0 but changes no sign."""
        if self.event is None or self.event.kind != "separatrix":
            return np.zeros(self.start.shape[1], dtype=bool)
        smallest, middle, largest = np.sort(self.inertia, axis=0)
        return np.asarray((smallest == middle) | (middle == largest))

    @cached_property
    def scaled_rows(self) -> dict[str, np.ndarray]:
        """The rows (r, 1) of those constants that change with the units, by name."""
        rows = vars(namespace(self.model.structure, range(len(self.constants))))
        scaled = {*self.model.degree, UNIT, VELOCITY} & rows.keys()
        return {name: np.atleast_1d(rows[name])[:, None] for name in scaled}

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

    def side(self, event: Event, t: Any, y: np.ndarray) -> np.ndarray:
        """The sign (n,) of an event's function in states y (m, n) at the time t, 0 where it is
        uncertain."""
        k = self.named()
        value = event.function(t, [*y], k)
        return np.where(np.abs(value) > self.uncertainty(event, t, y, k), np.sign(value), 0)


class Outcome:
    """What became of n motions: states at the end (m, n) in units of 2**exponent (n,), samples (m,
    n, s) in units of 2**sample_exponent (n, s), and the zeros of the event's function, with the
    side at both ends (n,).

    A terminal event ends a motion; `events` are those that motions have passed through, by number.
    Nothing here counts where the code of a `rejection` (n,) is not 0.
    """

    def __init__(self, m: int, n: int, s: int) -> None:
        """Nothing known of n motions."""
        self.state, self.samples = np.full((m, n), np.nan), np.full((m, n, s), np.nan)
        self.exponent, self.steps, self.start_side, self.end_side = np.zeros((4, n), dtype=np.intc)
        self.sample_exponent = np.zeros((n, s), dtype=np.intc)
        self.rejection = np.full(n, Rejection.AT_REST.code, dtype=np.int8)
        self.passages = Passages.none(m)
        self.events: dict[int, list[Occurrence]] = {}

    @property
    def accepted(self) -> np.ndarray:
        """Whether (n,) each motion is accepted."""
        return np.asarray(self.rejection == 0)

    def reject(self, motions: np.ndarray, why: Rejection) -> None:
        """Reject motions, by number or by a mask (n,), unless they are rejected already."""
        rejected = np.zeros(len(self.rejection), dtype=bool)
        rejected[motions] = True
        self.rejection[rejected & self.accepted] = why.code

    @property
    def accepted_passages(self) -> Passages:
        """The passages of accepted motions."""
        return self.passages.chosen(self.accepted[self.passages.motion])


def exact_difference(a: Any, b: Any) -> tuple[Any, Any]:
    """a - b (...) as its rounded value and the rest.

    Source: D. E. Knuth, The Art of Computer Programming 2, section 4.2.2.
    """
    high = a - b
    minus_b = high - a
    return high, (a - (high - minus_b)) - (b + minus_b)


CLOCK_ROWS = 3
"""Rows of a column after its state: the time left until its end, what rounding has taken from that,
and the steps taken."""


class Columns(NamedTuple):
    """Motions under way, a column each (n,): what a compiled step takes, and whose it is.

    `rows` (m + CLOCK_ROWS, n) hold the state, in units of omega of 2**exponent and of time of
    2**-rate, and the `clock` in this unit of time. `params` (c + 2, n) are the time of the end in
    the case's own unit, the constants in these units, and the `stride` of the steps. `motion` is
    the position in the ensemble; of a column without a motion it is -1.
    """

    rows: np.ndarray
    params: np.ndarray
    motion: np.ndarray
    exponent: np.ndarray
    rate: np.ndarray

    @property
    def state(self) -> np.ndarray:
        """The states (m, n)."""
        return self.rows[:-CLOCK_ROWS]

    @property
    def clock(self) -> np.ndarray:
        """The time left, what rounding has taken from it, and the steps taken (CLOCK_ROWS, n)."""
        return self.rows[-CLOCK_ROWS:]

    @property
    def constants(self) -> np.ndarray:
        """The constants of the equations (c, n)."""
        return self.params[1:-1]

    def named(self, structure: Structure) -> SimpleNamespace:
        """The constants by name."""
        return namespace(structure, [*self.constants])

    @property
    def time_and_correction(self) -> tuple[np.ndarray, np.ndarray]:
        """The case's own times (n,), as sums of two numbers: early in a long span the time left has
        fewer digits than the time itself."""
        remaining, lost, _ = self.clock
        time, correction = exact_difference(self.params[0], np.ldexp(remaining, -self.rate))
        return time, correction - np.ldexp(lost, -self.rate)

    @property
    def time(self) -> np.ndarray:
        """The case's own times (n,)."""
        return np.asarray(sum(self.time_and_correction))

    def chosen(self, index: np.ndarray) -> "Columns":
        """Copies of some columns, by position."""
        # From a list: at every step some are chosen, and a generator takes half as long again.
        return Columns(*[values.take(index, axis=-1) for values in self])


class TakenSteps(NamedTuple):
    """Steps (k,): the columns at their start, and their lengths in the columns' units of time."""

    start: Columns
    length: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence["TakenSteps"]) -> "TakenSteps":
        """The steps of several batches."""
        starts, lengths = zip(*parts, strict=True)
        columns = (np.concatenate(arrays, axis=-1) for arrays in zip(*starts, strict=True))
        return cls(Columns(*columns), np.concatenate(lengths))

    def chosen(self, index: np.ndarray) -> "TakenSteps":
        """Some of the steps, by position."""
        return TakenSteps(self.start.chosen(index), self.length[index])

    def times_at(self, x: np.ndarray) -> np.ndarray:
        """The case's own times (k,) at parts x (k,) of the steps."""
        time, correction = self.start.time_and_correction
        return np.asarray(time + (correction + np.ldexp(x * self.length, -self.start.rate)))

    def states_at(self, step: "TaylorStep", x: np.ndarray) -> np.ndarray:
        """The states (m, k) at parts x (k,) of the steps."""
        return states_after(step, self.start, x * self.length)

    def powers(self, step: "TaylorStep", event: Event) -> np.ndarray:
        """The series (k, order + 1) of an event's function, in powers of the part of each step."""
        rows, params = padded(self.start.rows), padded(self.start.params)
        series = step.event_series(event, rows, params)[:, : len(self.length)]
        return np.asarray(series.T * self.length[:, None] ** np.arange(len(series)))


def states_after(step: "TaylorStep", columns: Columns, elapsed: np.ndarray) -> np.ndarray:
    """The states (m, n) in a step of columns, some time (n,) behind its start, in their units: at
    the end of a step of this length."""
    n, rows, params = len(elapsed), padded(columns.rows), padded(columns.params)
    remaining = rows[-CLOCK_ROWS, :n]
    # The step begins when it did: at the end of the motion less the time that remains.
    params[0, :n] += np.ldexp(elapsed - remaining, -columns.rate)
    remaining[:] = elapsed
    out = np.empty((step.rows, rows.shape[1]))
    step(rows, params, out)
    # The length of its steps is all that rounding tells of a motion that is a polynomial: this one,
    # from another rounding of the same moment, may have ended before.
    length = out[len(rows), :n]
    if (is_short := length < elapsed).any():
        params[-1, :n] *= np.where(is_short, 2 * elapsed / length, 1)
        step(rows, params, out)
    return out[: len(columns.state), :n]


def padded(columns: np.ndarray) -> np.ndarray:
    """A copy of columns (..., n), with more of the last one up to a multiple of the engine's
    width."""
    from ...engines.taylor_batch import WIDTH  # heyoka may be missing

    copies = np.repeat(columns[..., -1:], -columns.shape[-1] % WIDTH, axis=-1)
    return np.concatenate((columns, copies), axis=-1)


def zeros_of(powers: np.ndarray, noise: np.ndarray) -> Zeros:
    """The zeros in [0, 1] of series (k, order + 1), with the bounds (k,) of their rounding."""
    # Row by row: one product of all would round as the number of rows happens to be.
    matrix = to_bernstein(TAYLOR, powers.shape[1] - 1, powers.dtype)
    return isolate(np.matmul(powers[:, None], matrix)[:, 0], noise)
