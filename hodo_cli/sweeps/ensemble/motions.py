"""An ensemble of motions, its outcome, and its steps in columns, with the states and zeros within
steps."""

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
"""The assumed bound on the relative error of a state: ERROR_BOUND, or PER_TOLERANCE tolerances if
that is larger. Where such an error could change the sign of an event's function, the sign is
uncertain. Single cases have a measured error instead. ERROR_BOUND is a hundred times the rounding
of all steps together, no ensemble was off by more than three tolerances, and few random motions are
left to single cases because of it: 10 of 200,000 tensors, at 20 ms each, and none of 200,000
linear-diag."""


class Rejection(Coded):
    """Why a motion is not accepted, in the words that a result prints."""

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
    """The passages (k,) of motions from one side to another, in order of motion and time. A side is
    the sign of an event's function.

    Each has the motion, the time, a bound on the error of the time, the time around it for which
    the side is uncertain, the sides before and after it, and the state (m, k) there in units of
    2**exponent.
    """

    motion: np.ndarray
    time: np.ndarray
    error: np.ndarray
    uncertainty: np.ndarray
    before: np.ndarray
    after: np.ndarray
    state: np.ndarray
    exponent: np.ndarray

    def chosen(self, index: np.ndarray) -> "Passages":
        """Some of the passages, by position or by a mask (k,)."""
        return Passages(*(column[..., index] for column in self))

    @classmethod
    def none(cls, m: int) -> "Passages":
        """No passages, for motions with states (m,)."""
        whole, empty = np.empty(0, dtype=np.int64), np.empty(0)
        return cls(whole, empty, empty, empty, whole, whole, np.empty((m, 0)), whole)

    @property
    def is_first(self) -> np.ndarray:
        """Whether (k,) each passage is the first of its motion."""
        return np.asarray(np.diff(self.motion, prepend=-1) != 0)


@dataclass(frozen=True)
class Ensemble:
    """n motions of one model.

    `members` (n,) are their positions among the cases or members asked for, `constants` (c, n) the
    constants of their equations, flat in the order of the model's `structure`, `start` (m, n) their
    states at the start, and `span` the times of start and end, numbers or arrays (n,). `times` (s,)
    are the sample times. The error of a step is `tol_factor` tolerances. Zeros of events are
    searched for only if `searches` is true.
    """

    members: np.ndarray
    model: Equations
    constants: np.ndarray
    start: np.ndarray
    span: tuple[Any, Any]
    events: tuple[Event, ...]
    tol: float
    times: np.ndarray = field(default_factory=lambda: np.empty(0))
    tol_factor: float = 1.0
    searches: bool = True

    @cached_property
    def step(self) -> "TaylorStep":
        """The compiled step of these motions."""
        from ...engines import taylor_batch  # heyoka may be missing

        # Compiled code is shared: it is the same whether or not the event ends a motion.
        events = tuple(event._replace(terminal=False) for event in self.events)
        return taylor_batch.build(self.model, events)

    @cached_property
    def event(self) -> Event | None:
        """The event whose zeros are searched for, or None."""
        without_passage = (event for event in self.events if not event.passage)
        return next(without_passage, None) if self.searches else None

    @cached_property
    def passage_event(self) -> Event | None:
        """The event with a passage, after which a motion continues, or None."""
        return next((event for event in self.events if event.passage), None)

    @property
    def error_bound(self) -> float:
        """The assumed bound on the relative error of a state."""
        return max(ERROR_BOUND, PER_TOLERANCE * self.tol)

    @property
    def lengths(self) -> np.ndarray:
        """The lengths of the spans (2, n), each as the sum of two numbers."""
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
    def initial_direction(self) -> np.ndarray:
        """The directions (m, n) in which the states of motions point at first: the states at the
        start or, for a motion that begins at rest, the rates there."""
        rates = self.model.rhs(self.span[0], [*self.start], self.named())
        return np.where(self.at_rest, stacked(rates, self.start), self.start)

    @cached_property
    def at_rest(self) -> np.ndarray:
        """Whether (n,) the motions begin at rest."""
        return np.asarray((self.start[moving(self.model)] == 0).all(axis=0))

    @cached_property
    def falling(self) -> np.ndarray:
        """Whether (n,) the state alone determines the units of each motion; see `is_falling`."""
        return is_falling(self.model, vars(self.named()), self.start)

    @property
    def is_one_sided(self) -> np.ndarray:
        """Whether (n,) the event's function has one sign only: the event is a crossing of the
        separatrix and the body has two equal moments. The function is then a single square, which
        touches 0 without a change of sign."""
        if self.event is None or self.event.kind != "separatrix":
            return np.zeros(self.start.shape[1], dtype=bool)
        smallest, middle, largest = np.sort(self.inertia, axis=0)
        return np.asarray((smallest == middle) | (middle == largest))

    @cached_property
    def scaled_rows(self) -> dict[str, np.ndarray]:
        """The rows of `constants` that change with the units, as arrays (r, 1), by the names of the
        constants."""
        rows = vars(namespace(self.model.structure, range(len(self.constants))))
        scaled = {*self.model.degree, UNIT, VELOCITY} & rows.keys()
        return {name: np.atleast_1d(rows[name])[:, None] for name in scaled}

    @property
    def is_timed(self) -> bool:
        """Whether the motions have units of their own, and equations that contain the time."""
        return UNIT in self.scaled_rows

    def uncertainty(self, event: Event, t: Any, y: np.ndarray, k: SimpleNamespace) -> np.ndarray:
        """A bound (n,) on the error of an event's function in states y (m, n) at the time t: the
        sum of its slopes along the components, each by a complex step, times the assumed error of
        the largest component.

        The slopes are taken where all components are as large as the largest one. Digits that the
        separatrix function lost while its terms were large stay lost when the terms have become
        small, near the middle axis.
        """
        size = np.abs(y[moving(self.model)]).max(axis=0)
        tilts = [size + 1e-100j * np.eye(len(y))[:, [i]] for i in range(len(y))]
        slopes = [np.abs(np.imag(event.function(t, [*tilt], k))) / 1e-100 for tilt in tilts]
        return np.asarray(self.error_bound * size * sum(slopes))

    def side(self, event: Event, t: Any, y: np.ndarray) -> np.ndarray:
        """The signs (n,) of an event's function in states y (m, n) at the time t, 0 where
        uncertain."""
        k = self.named()
        value = event.function(t, [*y], k)
        return np.where(np.abs(value) > self.uncertainty(event, t, y, k), np.sign(value), 0)


class Outcome:
    """The results of n motions: states at the end (m, n) in units of 2**exponent (n,), samples (m,
    n, s) in units of 2**sample_exponent (n, s), the zeros of the event's function as `passages`,
    and the sides at both ends (n,).

    `events` are the events after which motions have continued, by the number of the motion. The
    results of a motion are void where its code in `rejection` (n,) is not 0.
    """

    def __init__(self, m: int, n: int, s: int) -> None:
        """An outcome of n motions without results."""
        self.state, self.samples = np.full((m, n), np.nan), np.full((m, n, s), np.nan)
        self.exponent, self.steps, self.start_side, self.end_side = np.zeros((4, n), dtype=np.intc)
        self.sample_exponent = np.zeros((n, s), dtype=np.intc)
        # A motion counts as at rest unless it is integrated.
        self.rejection = np.full(n, Rejection.AT_REST.code, dtype=np.int8)
        self.passages = Passages.none(m)
        self.events: dict[int, list[Occurrence]] = {}

    @property
    def accepted(self) -> np.ndarray:
        """Whether (n,) each motion is accepted."""
        return np.asarray(self.rejection == 0)

    def reject(self, motions: np.ndarray, why: Rejection) -> None:
        """Reject motions, by number or by a mask (n,). A motion that is rejected already keeps its
        reason."""
        rejected = np.zeros(len(self.rejection), dtype=bool)
        rejected[motions] = True
        self.rejection[rejected & self.accepted] = why.code

    @property
    def accepted_passages(self) -> Passages:
        """The passages of accepted motions."""
        return self.passages.chosen(self.accepted[self.passages.motion])


def exact_difference(a: Any, b: Any) -> tuple[Any, Any]:
    """a - b (...) as its rounded value and the rounding error; their sum is exact.

    Source: D. E. Knuth, The Art of Computer Programming 2, section 4.2.2.
    """
    high = a - b
    minus_b = high - a
    return high, (a - (high - minus_b)) - (b + minus_b)


CLOCK_ROWS = 3
"""The rows of a column after its state: the time left until its end, the rounding error of that
time, and the number of steps taken."""


class Columns(NamedTuple):
    """Motions in progress, a column (n,) each: the arguments of a compiled step, and the motion
    that each column holds.

    `rows` (m + CLOCK_ROWS, n) hold the state and the `clock`. The unit of omega is 2**exponent and
    the unit of time, in which the clock counts, 2**-rate. `params` (c + 2, n) are the time of the
    end in the case's own unit, the constants in these units, and the `stride` of the steps.
    `motion` is the position in the ensemble, or -1 for a column without a motion.
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
        """The time left, its rounding error, and the number of steps taken (CLOCK_ROWS, n)."""
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
        """The case's own times (n,), each as a number and its correction: early in a long span the
        time left has fewer digits than the time itself."""
        remaining, lost, _ = self.clock
        time, correction = exact_difference(self.params[0], np.ldexp(remaining, -self.rate))
        return time, correction - np.ldexp(lost, -self.rate)

    @property
    def time(self) -> np.ndarray:
        """The case's own times (n,)."""
        return np.asarray(sum(self.time_and_correction))

    def chosen(self, index: np.ndarray) -> "Columns":
        """Copies of some columns, by position."""
        # A list, because columns are chosen at every step and a generator takes half as long again.
        return Columns(*[values.take(index, axis=-1) for values in self])


class TakenSteps(NamedTuple):
    """Steps (k,): the columns at their starts, and their lengths (k,) in the unit of time of each
    column."""

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
        """The case's own times (k,) at fractions x (k,) of the steps."""
        time, correction = self.start.time_and_correction
        return np.asarray(time + (correction + np.ldexp(x * self.length, -self.start.rate)))

    def states_at(self, step: "TaylorStep", x: np.ndarray) -> np.ndarray:
        """The states (m, k) at fractions x (k,) of the steps."""
        return states_after(step, self.start, x * self.length)

    def powers(self, step: "TaylorStep", event: Event) -> np.ndarray:
        """The series (k, order + 1) of an event's function, in powers of the fraction of each
        step."""
        rows, params = padded(self.start.rows), padded(self.start.params)
        series = step.event_series(event, rows, params)[:, : len(self.length)]
        return np.asarray(series.T * self.length[:, None] ** np.arange(len(series)))


def states_after(step: "TaylorStep", columns: Columns, elapsed: np.ndarray) -> np.ndarray:
    """The states (m, n) at a time `elapsed` (n,) after the start of a step of each column, in the
    column's unit of time. Each state is computed as the end of a step of this length."""
    n, rows, params = len(elapsed), padded(columns.rows), padded(columns.params)
    remaining = rows[-CLOCK_ROWS, :n]
    # A step computes its start as the time of the end less the time that remains. Both change
    # alike, so that the step ends after `elapsed` and its start stays the same.
    params[0, :n] += np.ldexp(elapsed - remaining, -columns.rate)
    remaining[:] = elapsed
    out = np.empty((step.rows, rows.shape[1]))
    step(rows, params, out)
    # For a motion that is a polynomial, rounding alone determines the length of a step. This step
    # begins with another rounding of the time, so it may be shorter than `elapsed`.
    length = out[len(rows), :n]
    if (is_short := length < elapsed).any():
        params[-1, :n] *= np.where(is_short, 2 * elapsed / length, 1)
        step(rows, params, out)
    return out[: len(columns.state), :n]


def padded(columns: np.ndarray) -> np.ndarray:
    """A copy of columns (..., n), with the last one repeated up to a multiple of the engine's
    width."""
    from ...engines.taylor_batch import WIDTH  # heyoka may be missing

    copies = np.repeat(columns[..., -1:], -columns.shape[-1] % WIDTH, axis=-1)
    return np.concatenate((columns, copies), axis=-1)


def zeros_of(powers: np.ndarray, noise: np.ndarray) -> Zeros:
    """The zeros in [0, 1] of series (k, order + 1) in powers; `noise` (k,) bounds their
    rounding."""
    # Row by row: the rounding of one product of all rows depends on their number.
    matrix = to_bernstein(TAYLOR, powers.shape[1] - 1, powers.dtype)
    return isolate(np.matmul(powers[:, None], matrix)[:, 0], noise)
