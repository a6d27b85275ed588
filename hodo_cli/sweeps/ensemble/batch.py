"""The motions of an ensemble that are under way, in columns, and their steps."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...engines.protocol import uneven
from ...integration.choice import MANY_STEPS
from ...integration.units import TimeWindow, Units
from ...models.constants import moving, namespace, rescaled
from .motions import Ensemble, Outcome, Rejection, TerminalHits, exact_difference

if TYPE_CHECKING:
    from ...engines.taylor_batch import TaylorStep

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

END, STRIDE, NUMBER, SIZE, RATE = 0, *range(-4, 0)
"""Rows of a column's params: the time of the end, before the constants, and behind them the
`stride` of its steps, the number of its motion, and its units."""

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
        from ...engines.taylor_batch import stride  # heyoka may be missing

        e, m = self.ensemble, self.m
        # Those of uneven starts are left to single cases, whose steps can be limited.
        omega = e.start[moving(e.model)]
        turning = (omega != 0).any(axis=0)
        self.outcome.rejection[turning] = Rejection.UNEVEN.code
        begun = np.flatnonzero(turning & ~uneven(omega))
        number = padded(begun)
        self.now, self.next = np.zeros((2, self.step.rows, len(number)))
        self.now[:m], self.now[m : m + 2] = e.start[:, number], e.lengths[:, number]
        self.params = np.zeros((len(e.constants) + 5, len(number)))
        self.params[END] = np.broadcast_to(e.span[1], e.start.shape[1])[number]
        self.params[1:STRIDE] = e.constants[:, number]
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
        if self.ensemble.event is not None:
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
        time, rest = time_reached(self.params[END], history[m], lost, rate)
        step, sample = map(padded, times_within(e.times, time + rest))
        column = step % len(number)
        before = history[:, :-1].reshape(m + TIME_ROWS, -1).take(step, axis=1)
        since = (e.times[sample] - time.ravel()[step]) - rest.ravel()[step]
        place = np.ldexp(since, rate[column])
        k = self.params[:NUMBER].take(column, axis=1)
        entry = number[column] * len(e.times) + sample
        sampled = states_after(self.step, *shortened(before, k, place, rate[column]))
        # Row by row, which is four times as fast as all rows at once.
        for samples, values in zip(self.outcome.samples, sampled, strict=True):
            samples.reshape(-1)[entry] = values
        self.outcome.sample_exponent.reshape(-1)[entry] = size[column]

    def note_candidates(self, columns: np.ndarray) -> None:
        """Remember the steps just taken in some columns, where the event's function may have zeros;
        a motion that is seen to have passed a terminal event stops."""
        if not columns.size:
            return
        m, event = self.m, self.ensemble.event
        before, after, params = (
            a.take(columns, axis=1) for a in (self.now, self.next, self.params)
        )
        if event is None or not event.passage:
            self.candidates.append(
                CandidateSteps(before[: m + TIME_ROWS], after[m + TIME_ROWS], params)
            )
        # Only the sign at the ends is looked at here; where in the step it ended is found at the
        # end, for all at once.
        if event is not None and event.terminal:
            k = namespace(self.ensemble.structure, list(params[1:STRIDE]))
            signs = (event.function(times_of(y, params, m), [*y[:m]], k) for y in (before, after))
            stopped = np.multiply(*signs) < 0
            if event.passage:
                self.note_hits(after[:, stopped], params[:, stopped])
            self.next[m, columns[stopped]] = 0

    def note_hits(self, after: np.ndarray, params: np.ndarray) -> None:
        """Note the motions that go on through an event, in columns as they are now.

        Its formulas begin from any state behind its zero, so that this need not be found.
        """
        e, m = self.ensemble, self.m
        size, _ = units_of(params)
        state = rescaled(e.model, after[:m].T, size).T if e.model.degree else after[:m]
        time = times_of(after, params, m)
        self.departures.append(TerminalHits(params[NUMBER].astype(np.int64), time, state))

    def pause(self) -> None:
        """Drop the motions that are at their end, and renew units that no longer fit."""
        self.pauses += 1
        if self.history:
            self.sample()
        (remaining, lost, steps), params = self.now[self.m : self.m + TIME_ROWS], self.params
        going = (remaining > 0) & (steps < MOST_STEPS)
        # What rounding took from the time left, back to it before it decides the last steps.
        restored = remaining + lost
        lost += remaining - restored
        np.copyto(remaining, restored, where=going)
        event = self.ensemble.event
        # An averaged motion is slow at the separatrix only, where its steps are the shorter.
        if self.pauses == 1 and not (event and event.passage):
            number = params[NUMBER].astype(np.int64)
            span = np.ldexp(self.ensemble.lengths[0, number], units_of(params)[1])
            going &= PAUSE * span < HOPELESS * (span - remaining)
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
        remaining, _, outcome.steps[number] = self.now[self.m : self.m + TIME_ROWS, ended]
        outcome.rejection[number] = np.where(remaining == 0, 0, Rejection.SLOW.code)
        going = np.flatnonzero(~done)
        columns = padded(going)
        self.now, self.params = (a.take(columns, axis=1) for a in (self.now, self.params))
        self.next = np.empty_like(self.now)
        self.empty(len(going))

    def renew(self, columns: np.ndarray) -> None:
        """Fit the units of some columns to their motions."""
        e, m = self.ensemble, self.m
        if not e.model.degree or not columns.size:
            return
        params = self.params[:, columns]
        size, rate = units_of(params)
        number = params[NUMBER].astype(np.int64)
        y, k = self.now[:m, columns], vars(e.named(number))
        y = np.where(np.isfinite(y).all(axis=0), y, 1.0)  # what overflowed ends in any units
        moment = None
        if e.is_timed:
            moment = TimeWindow(times_of(self.now[:, columns], params, m), e.lengths[0, number])
        units = Units.fit(e.model, k, y, size, moment)
        # By powers of two throughout, so that new units change no digit.
        self.now[:m, columns] = rescaled(e.model, self.now[:m, columns].T, size - units.size).T
        self.now[m : m + 2, columns] = np.ldexp(self.now[m : m + 2, columns], units.rate - rate)
        scaled = units.constants(e.model, k)
        for name, rows in e.scaled_rows.items():
            params[1:STRIDE][rows] = scaled[name]
        params[SIZE], params[RATE] = units.size, units.rate
        self.params[:, columns] = params


def units_of(params: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The size and the rate (k,) of the units of columns, from their params."""
    size, rate = params[[SIZE, RATE]].astype(np.int64)
    return size, rate


def time_reached(end: Any, remaining: Any, lost: Any, rate: Any) -> tuple[Any, Any]:
    """The times (...) of columns from their TIME_ROWS and the rate of their units, as sums of two:
    early in a long span the time left has fewer digits than the time itself."""
    time, rest = exact_difference(end, np.ldexp(remaining, -rate))
    return time, rest - np.ldexp(lost, -rate)


def times_of(columns: np.ndarray, params: np.ndarray, m: int) -> np.ndarray:
    """The case's own times (k,) of columns with m state variables."""
    rate = units_of(params)[1]
    return np.asarray(sum(time_reached(params[END], columns[m], columns[m + 1], rate)))


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
    from ...engines.taylor_batch import WIDTH  # heyoka may be missing

    n = len(numbers)
    return numbers[np.minimum(np.arange(n + -n % WIDTH), n - 1)]


def shortened(
    columns: np.ndarray, k: np.ndarray, place: np.ndarray, rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Columns and constants with no more time left than `place` (k,), in the arrays given; their
    unit of time is 2**-rate (k,)."""
    m = len(columns) - TIME_ROWS
    k[END] += np.ldexp(place - columns[m], -rate)  # so that the step begins when it did
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
    positions = padded(np.arange(n))
    return function(*(a.take(positions, axis=1) for a in (columns, k)))[:, :n]
