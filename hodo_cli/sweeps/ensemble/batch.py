"""The motions of an ensemble that are under way, and their steps."""

import numpy as np

from ...engines.polynomial import TAYLOR, rounding
from ...engines.protocol import uneven
from ...engines.units import TimeWindow, Units
from ...integration import MIN_STIFF_STEPS, Occurrence
from ...models.base import Event, moving, namespace, rescaled
from .motions import (
    Columns,
    Ensemble,
    Outcome,
    Rejection,
    TakenSteps,
    exact_difference,
    padded,
    states_after,
    zeros_of,
)

FITTING, STILL_FITTING = (1 / 16, 16.0), (1 / 256, 256.0)
"""The largest component of a scaled state that needs no new units. heyoka's control of the error is
absolute below 1, so that a motion at 1/16 has lost a digit. Outside of FITTING units are renewed at
one pause of PAUSES_PER_RENEWAL, since numpy spends more on the call, some 0.1 ms, than on a
thousand motions, and outside of STILL_FITTING, where few motions ever get, at every pause. So no
motion's units depend on other motions."""

PAUSES_PER_RENEWAL = 4

STEP_LIMIT = int(4 * MIN_STIFF_STEPS)
"""Steps after which a motion is left to the driver of single cases."""

HOPELESS_STEPS = 100 * MIN_STIFF_STEPS
"""Steps that a motion would need if all were as long as its first ones, beyond which it is left to
single cases at once."""

STEPS_PER_PAUSE = 6
"""Steps from one look for motions that are at their end or have outgrown their units to the next:
1.5 % of the steps are idle for it, and looking costs as much as a third of a step."""

FULL_ENOUGH = 0.93
"""The part of the columns that must be under way; with fewer, the others are dropped. Copying all
columns costs about as much as one step."""


def columns_at_start(e: Ensemble, motion: np.ndarray, longest: float) -> Columns:
    """The columns of some motions (n,) at their start, in the units of the case, in steps of at
    most `longest`."""
    n = len(motion)
    end = np.broadcast_to(e.span[1], e.start.shape[1])[motion]
    rows = np.array([*e.start[:, motion], *e.lengths[:, motion], np.zeros(n)])
    params = np.array([end, *e.constants[:, motion], np.full(n, longest)])
    return Columns(rows, params, motion, *np.zeros((2, n), dtype=np.intc))


class BatchState:
    """The motions of an ensemble that have not reached their end, in columns.

    A step is written to `output`, whose first rows are those of the `columns` behind it, and the
    columns before it are then `spare`. The columns are a multiple of the engine's width; one
    without a motion has no time left.
    """

    def __init__(self, e: Ensemble, outcome: Outcome) -> None:
        from ...engines.taylor_batch import AlignedCalls, stride  # heyoka may be missing

        self.ensemble, self.outcome, self.step = e, outcome, AlignedCalls(e.step)
        self.candidates, self.history = list[TakenSteps](), list[np.ndarray]()
        self.pauses = 0
        # Those of uneven starts are left to single cases, whose steps can be limited.
        turning = (e.onset[moving(e.model)] != 0).any(axis=0)
        outcome.rejection[turning] = Rejection.UNEVEN.code
        begun = np.flatnonzero(turning & ~uneven(e.start[moving(e.model)]))
        motion = padded(begun)
        self.columns = columns_at_start(e, motion, stride(e.tol, e.passing, e.looser))
        self.output, self.spare = np.empty((2, e.step.rows, len(motion)))
        self.renew(np.arange(len(motion)))
        self.empty(len(begun))
        at_start = e.times <= np.reshape(e.span[0], (-1, 1))
        np.copyto(outcome.samples, e.start[:, :, None], where=at_start)

    def empty(self, first: int) -> None:
        """Mark the columns from the `first` on as without a motion."""
        self.columns.clock[0, first:], self.columns.motion[first:] = 0, -1

    def advance(self) -> None:
        """One step of every motion."""
        e, before, end = self.ensemble, self.columns, len(self.columns.rows)
        if e.times.size:
            self.history.append(before.rows.copy())
        self.output, self.spare = self.spare, self.output
        self.step(before.rows, before.params, self.output)
        # Rows of the output: the columns anew, the length of the step, for each event a number
        # that is negative where it may have a zero in the step, and what tells the cells.
        self.columns = Columns(self.output[:end], *before[1:])
        steps, passed = TakenSteps(before, self.output[end]), np.empty(0, dtype=np.int64)
        for event, bound in zip(e.step.events, self.output[end + 1 :], strict=False):
            columns = np.flatnonzero(bound < 0)
            if columns.size and event.passage:
                passed = self.passing(event, steps, columns)
            elif columns.size and e.event is not None:
                self.note_candidates(e.event, steps, columns)
        # Behind the search for zeros in the same steps, since it changes their units.
        if passed.size:
            self.restart(passed)
            self.renew(passed)

    def sample(self) -> None:
        """Enter the states at the sample times within the steps since the last pause: a sample is a
        step that has no more time left."""
        e, columns = self.ensemble, self.columns
        history = np.stack([*self.history, columns.rows], axis=1)  # (rows, steps + 1, n)
        self.history.clear()
        # A motion at its end has none left, though rounding has taken some of it.
        past = Columns(history, *columns[1:])
        remaining, lost, _ = past.clock
        lost[remaining <= 0] = 0
        time, correction = past.time_and_correction
        step, sample = times_within(e.times, time + correction)
        rows = history[:, :-1].reshape(len(history), -1).take(step, axis=1)
        column = step % len(columns.motion)
        start = Columns(rows, *(values.take(column, axis=-1) for values in columns[1:]))
        elapsed = (e.times[sample] - time.ravel()[step]) - correction.ravel()[step]
        sampled = states_after(e.step, start, np.ldexp(elapsed, start.rate))
        entry = start.motion * len(e.times) + sample
        # Row by row, which is four times as fast as all rows at once.
        for samples, values in zip(self.outcome.samples, sampled, strict=True):
            samples.reshape(-1)[entry] = values
        self.outcome.sample_exponent.reshape(-1)[entry] = start.exponent

    def note_candidates(self, event: Event, steps: TakenSteps, columns: np.ndarray) -> None:
        """Remember the steps just taken in some columns, where an event's function may have zeros;
        a motion that is seen to have passed a terminal event stops."""
        self.candidates.append(steps.chosen(columns))
        # Where in the step it ended is found at the end, for all at once.
        if event.terminal:
            self.columns.clock[0, columns[self.changes_sign(event, steps, columns)]] = 0

    def changes_sign(self, event: Event, steps: TakenSteps, columns: np.ndarray) -> np.ndarray:
        """Whether (k,) an event's function differs in sign at the ends of the steps just taken in
        some columns."""
        e, ends = self.ensemble, (at.chosen(columns) for at in (steps.start, self.columns))
        values = (event.function(at.time, [*at.state], at.named(e.model.structure)) for at in ends)
        return np.asarray(np.multiply(*values) < 0)

    def passing(self, event: Event, steps: TakenSteps, columns: np.ndarray) -> np.ndarray:
        """Those of some columns that have passed an event in the step just taken.

        Of averaged motions the formulas of a passage begin from any state behind the zero, which is
        singular; others end their step at the first zero.
        """
        if self.ensemble.model.degree:
            return self.cut_at_zero(event, steps, columns)
        return np.asarray(columns[self.changes_sign(event, steps, columns)])

    def cut_at_zero(self, event: Event, steps: TakenSteps, columns: np.ndarray) -> np.ndarray:
        """Let the steps just taken in some columns end at the first zero of an event's function;
        returns those of the columns where there is one."""
        step, cut = self.ensemble.step, steps.chosen(columns)
        powers = cut.powers(step, event)
        zeros = zeros_of(powers, rounding(powers, TAYLOR))
        row, first = np.unique(zeros.row, return_index=True)
        x, is_sure = zeros.x[first], zeros.sure[first]
        columns, cut = columns[row], cut.chosen(row)
        self.columns.state[:, columns] = cut.states_at(step, x)
        steps.length[columns] = x * cut.length
        remaining, lost, _ = cut.start.clock
        self.columns.clock[:2, columns] = exact_difference(remaining, x * cut.length)
        self.columns.clock[1, columns] += lost
        self.columns.clock[0, columns[~is_sure]] = np.nan
        return np.asarray(columns[is_sure])

    def restart(self, columns: np.ndarray) -> None:
        """Put motions behind their passage of an event, in the case's own units."""
        e, before = self.ensemble, self.columns.chosen(columns)
        states = rescaled(e.model, before.state.T, before.exponent)
        constants = e.constants[:, before.motion]
        # A passage is one of numbers: only what is done for all takes arrays.
        rows = before.motion, before.params[0], before.time, states, constants.T
        at_end = []
        for column, *of_motion in zip(columns.tolist(), *map(np.ndarray.tolist, rows), strict=True):
            if self.pass_event(column, *of_motion):
                at_end.append(column)
        self.columns.constants[:, columns] = constants
        self.columns.exponent[columns] = self.columns.rate[columns] = 0
        # A step in the state of an end may lead anywhere.
        self.enter(np.array(at_end, dtype=np.int64))

    def pass_event(
        self, column: int, motion: int, end: float, time: float, state: list[float],
        numbers: list[float],
    ) -> bool:  # fmt: skip
        """Put one motion behind its passage of an event; returns whether it is at its end there."""
        event, columns = self.ensemble.passing, self.columns
        assert event is not None
        assert event.passage is not None
        try:
            passage = event.passage(time, state, namespace(self.ensemble.model.structure, numbers))
        except (ValueError, ArithmeticError):  # a step has led beyond the passage itself
            columns.clock[0, column] = np.nan
            return False
        if passage.details is not None:
            occurrence = Occurrence(event.kind, passage.time, passage.details)
            self.outcome.events.setdefault(motion, []).append(occurrence)
        onward = end if passage.onward is None else float(passage.onward)
        columns.state[:, column] = passage.states(min(onward, end))
        columns.clock[:2, column] = exact_difference(end, min(onward, end))
        return onward >= end

    def pause(self) -> None:
        """Drop the motions that are at their end, and renew units that no longer fit."""
        columns = self.columns
        self.pauses += 1
        if self.history:
            self.sample()
        remaining, lost, steps = columns.clock
        going = (remaining > 0) & (steps < STEP_LIMIT)
        # What rounding took from the time left, back to it before it decides the last steps.
        restored = remaining + lost
        lost += remaining - restored
        np.copyto(remaining, restored, where=going)
        # Of a step without a length the next is the same: its series is larger than doubles are.
        remaining[going & (self.output[len(columns.rows)] == 0)] = np.nan
        going &= ~np.isnan(remaining)
        # An averaged motion is slow at the separatrix only, where its steps are the shorter.
        if self.pauses == 1 and self.ensemble.passing is None:
            span = np.ldexp(self.ensemble.lengths[0, columns.motion], columns.rate)
            going &= STEPS_PER_PAUSE * span < HOPELESS_STEPS * (span - remaining)
        if np.count_nonzero(going) < FULL_ENOUGH * len(going):
            self.drop(~going)
        if self.ensemble.model.degree:
            self.renew(self.outgrown())

    def outgrown(self) -> np.ndarray:
        """The columns (k,) whose units are to be renewed at this pause."""
        largest = np.abs(self.columns.state[moving(self.ensemble.model)]).max(axis=0)
        low, high = STILL_FITTING if self.pauses % PAUSES_PER_RENEWAL else FITTING
        outgrown = (largest < low) | (largest > high)
        return np.flatnonzero(outgrown & (self.columns.clock[0] > 0))

    def drop(self, done: np.ndarray) -> None:
        """Drop the columns that are done, and keep the others."""
        self.enter(np.flatnonzero(done & (self.columns.motion >= 0)))
        going = np.flatnonzero(~done)
        columns = padded(going)
        self.columns = self.columns.chosen(columns)
        self.output, self.spare = np.empty((2, len(self.output), len(columns)))
        self.empty(len(going))

    def enter(self, columns: np.ndarray) -> None:
        """Enter some columns in the outcome; they are then without a motion."""
        outcome, ended = self.outcome, self.columns.chosen(columns)
        outcome.state[:, ended.motion], outcome.exponent[ended.motion] = ended.state, ended.exponent
        remaining, _, outcome.steps[ended.motion] = ended.clock
        why = np.where(np.isnan(remaining), Rejection.ASTRAY.code, Rejection.SLOW.code)
        outcome.rejection[ended.motion] = np.where(remaining == 0, 0, why)
        self.columns.motion[columns] = -1

    def renew(self, columns: np.ndarray) -> None:
        """Fit the units of some columns to their motions."""
        e = self.ensemble
        if not e.model.degree or not columns.size:
            return
        old = self.columns.chosen(columns)
        k, moment = vars(e.named(old.motion)), None
        y = np.where(np.isfinite(old.state).all(axis=0), old.state, 1.0)  # overflowed: any units
        if e.is_timed:
            moment = TimeWindow(old.time, e.lengths[0, old.motion])
        units = Units.fit(e.model, k, y, old.exponent, moment, e.falling[old.motion])
        # By powers of two throughout, so that new units change no digit.
        self.columns.state[:, columns] = rescaled(
            e.model, old.state.T, old.exponent - units.exponent
        ).T
        self.columns.clock[:2, columns] = np.ldexp(old.clock[:2], units.rate - old.rate)
        scaled = units.constants(e.model, k)
        for name, rows in e.scaled_rows.items():
            self.columns.constants[rows, columns] = scaled[name]
        self.columns.exponent[columns], self.columns.rate[columns] = units.exponent, units.rate


def times_within(times: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The times (s,) that steps reach, which lie between edges (steps + 1, n): the step (k,), row
    by row, and the position (k,) of the time."""
    passed = np.searchsorted(times, edges, side="right")
    count = np.diff(passed, axis=0).ravel()
    step = np.repeat(np.arange(len(count)), count)
    rank = np.arange(len(step)) - (np.cumsum(count) - count)[step]  # among the times of its step
    return step, passed[:-1].ravel()[step] + rank
