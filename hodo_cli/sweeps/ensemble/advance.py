"""The motions of an ensemble from start to end: their steps, the zeros of an event's function, and
the motions that remain uncertain."""

from dataclasses import replace

import numpy as np
from numpy.polynomial.polynomial import polyder

from ...arithmetic import horner
from ...engines.polynomial import TAYLOR, rounding
from ...engines.protocol import uneven
from ...engines.units import TimeWindow, Units, clock_rates
from ...integration import MIN_STIFF_STEPS, Occurrence, at_rest, time_to_zero
from ...models.base import REST_BITS, Event, moving, namespace, rescaled
from .motions import (
    Columns,
    Ensemble,
    Outcome,
    Passages,
    Rejection,
    TakenSteps,
    exact_difference,
    padded,
    states_after,
    zeros_of,
)

SECOND_TOL_FACTOR, GROWN_ERRORS = 16, 32
"""A second integration, with SECOND_TOL_FACTOR times the tolerance, measures the growth of errors.
The error of a crossing is at least GROWN_ERRORS times the difference between the two integrations.
This factor is large because a difference may be small by chance: for 6 of 35,000 crossings of
tensors and cavities the error estimated from the steps was too small, and the difference was at
least a quarter of the true error. For four in five crossings GROWN_ERRORS differences are below the
estimate from the steps."""

STEP_ROUNDING, PER_STEP = 2.0**-52, 1 / 16
"""The assumed relative error of a state in one step: STEP_ROUNDING from rounding, and PER_STEP
tolerances from the truncation of the series. The errors of crossing times that follow were two to
three times the largest error in random ensembles of all models (tests/test_sweep.py), and some
fifty times the common error."""


@np.errstate(all="ignore")  # an overflow is not finite, hence not accepted
def advance(e: Ensemble) -> Outcome:
    """Integrate all motions of an ensemble over their span. Motions with anything uncertain are
    rejected in the outcome."""
    m, n = e.start.shape
    outcome = Outcome(m, n, len(e.times))
    # A compiled step finds one event with a passage and one without; the order of more is left to
    # single cases.
    kinds = [event.passage is not None for event in e.events]
    if len(kinds) > len(set(kinds)):
        outcome.rejection[:] = Rejection.EVENTS.code
        return outcome
    if e.initial_direction.any():
        batch = BatchState(e, outcome)
        while batch.columns.motion.size:
            # numpy works in the pauses only; between them a step is one call of compiled code.
            for _ in range(STEPS_PER_PAUSE):
                batch.advance()
            batch.pause()
        if e.event:
            decide_passages(e, e.event, batch.candidates, outcome)
    if e.model.degree and e.model.form.starts_with_omega:
        stop_at_rest(outcome)
    if not e.model.degree:
        outcome.reject(clock_rates(e.model, e.named(), e.start) != 0, Rejection.UNIT)
    outcome.reject(~np.isfinite(outcome.state).all(axis=0), Rejection.OUTGROWN)
    return outcome


def stop_at_rest(outcome: Outcome) -> None:
    """Set motions that have become too slow to be integrated to rest, as `integrate` does for
    single cases."""
    for state, exponent in (
        (outcome.state, outcome.exponent),
        (outcome.samples, outcome.sample_exponent),
    ):
        if exponent.size and exponent.min() < -REST_BITS:
            resting = at_rest(np.moveaxis(state[:3], 0, -1), exponent)
            state[:3, resting], exponent[resting] = 0, -REST_BITS
    passed = outcome.passages
    outcome.passages = passed.chosen(~at_rest(passed.state[:3].T, passed.exponent))
    outcome.end_side[(outcome.state[:3] == 0).all(axis=0)] = 0


def decide_passages(
    e: Ensemble, event: Event, candidates: list[TakenSteps], outcome: Outcome
) -> None:
    """Find where motions pass from one side to another within the candidate steps.

    A motion is accepted if its passages alternate and lead from the side at its start to the side
    at its end, and no side or passage is uncertain.
    """
    outcome.start_side = e.side(event, e.span[0], e.initial_direction)
    outcome.end_side = e.side(event, e.span[1], outcome.state)
    # A body that a brake has stopped is on no side.
    resting = (outcome.state[:3] == 0).all(axis=0)
    # A motion with an uncertain side is not accepted, so its passages are not needed.
    certain = (outcome.start_side != 0) & (event.terminal | resting | (outcome.end_side != 0))
    steps = steps_of(candidates, certain & ~e.is_one_sided)
    if steps is not None:
        passages, undecided = zeros_within(e, event, steps)
        if event.terminal:
            passages = passages.chosen(passages.is_first)
            stop_at(passages, e.times, outcome)
        outcome.passages = passages
        outcome.reject(undecided, Rejection.UNCERTAIN)
    reject_contradicted(outcome, resting)


def stop_at(zeros: Passages, times: np.ndarray, outcome: Outcome) -> None:
    """End motions at zeros (k,) of an event's function; their samples at later `times` become
    nan."""
    outcome.state[:, zeros.motion] = zeros.state
    outcome.exponent[zeros.motion] = zeros.exponent
    outcome.end_side[zeros.motion] = zeros.after
    for motion, time in zip(zeros.motion, zeros.time, strict=True):
        outcome.samples[:, motion, times > time] = np.nan


def reject_contradicted(outcome: Outcome, resting: np.ndarray) -> None:
    """Reject motions whose passages do not alternate, motions whose passages do not lead to the
    side at their end (unless they are at rest there, a mask (n,)), and motions that start on no
    side."""
    passed = outcome.passages
    before = np.where(passed.is_first, outcome.start_side[passed.motion], np.roll(passed.after, 1))
    outcome.reject(passed.motion[passed.before != before], Rejection.UNCERTAIN)
    side = outcome.start_side.copy()
    side[passed.motion] = passed.after  # of several passages, the last one is assigned
    contradicted = (side != outcome.end_side) & ~resting
    outcome.reject(contradicted | (outcome.start_side == 0), Rejection.UNCERTAIN)


def steps_of(candidates: list[TakenSteps], certain: np.ndarray) -> TakenSteps | None:
    """The candidate steps of the motions that are `certain` (n,); None if there are none."""
    if not candidates:
        return None
    steps = TakenSteps.joined(candidates)
    wanted = np.flatnonzero(certain[steps.start.motion])
    return steps.chosen(wanted) if wanted.size else None


def zeros_within(e: Ensemble, event: Event, steps: TakenSteps) -> tuple[Passages, np.ndarray]:
    """The passages of motions at the zeros of an event's function in their candidate steps, and the
    motions (k,) that have uncertain zeros."""
    powers, begin = steps.powers(e.step, event), steps.start
    noise = e.uncertainty(event, begin.time, begin.state, begin.named(e.model.structure))
    zeros = zeros_of(*without_start(e, begin, powers, noise))
    undecided = begin.motion[zeros.row[~zeros.sure]]
    # From here every array has an entry for each sure zero, no longer for each step.
    row, x = zeros.row[zeros.sure], zeros.x[zeros.sure]
    passed = steps.chosen(row)
    times, motion, rate = passed.times_at(x), passed.start.motion, passed.start.rate
    slope = horner(polyder(powers[row].T), x) / passed.length
    uncertainty = np.ldexp(noise[row] / np.abs(slope), -rate)
    # `uncertainty` belongs to an error e.error_bound of the state. The error of the time is smaller
    # in proportion to the error that the steps taken have made.
    taken = passed.start.clock[-1] + 2
    proportion = (STEP_ROUNDING + PER_STEP * e.tol) * taken / e.error_bound
    errors = proportion * uncertainty + np.spacing(np.abs(times)) / 2
    side = np.sign(slope).astype(np.int64)
    unordered = Passages(
        motion, times, errors, uncertainty, -side, side,
        passed.states_at(e.step, x), passed.start.exponent,
    )  # fmt: skip
    return unordered.chosen(np.lexsort((times, motion))), undecided


def without_start(
    e: Ensemble, start: Columns, powers: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The series (k, order + 1) of an event's function D in steps, without the zero at the start of
    a motion from rest, and the bounds (k,) of their rounding. From rest D begins with the square of
    the time, and this zero is no passage: the series is divided by that square."""
    at_rest = np.flatnonzero(~start.state[moving(e.model)].any(axis=0))
    later, noise = powers.copy(), noise.copy()
    later[at_rest] = np.pad(powers[at_rest, 2:], ((0, 0), (0, 2)))
    noise[at_rest] = e.error_bound * np.abs(powers[at_rest]).sum(axis=1)
    return later, noise


def measure_crossings(e: Ensemble, outcome: Outcome) -> None:
    """Enlarge the errors of first crossings to the difference from a second integration with other
    steps.

    Errors grow some 1e4-fold along a motion that stays near the separatrix. Passing the middle axis
    turns an error of the separatrix function D into an error of the phase, and a torque that
    depends on the phase turns that into a larger error of D. No single step shows this. The second
    integration ends at the time of the crossing, and its distance in time from D = 0 there is the
    difference of the two crossing times. A motion is rejected if this is larger than the time for
    which the sign of D is assumed to be uncertain.
    """
    passed = outcome.passages
    first = np.flatnonzero(passed.is_first & outcome.accepted[passed.motion])
    # In models where no motion crosses twice, errors do not grow near the separatrix.
    if not first.size or e.model.form.no_axis_reason or e.model.always_absorbing:
        return
    motion, time = passed.motion[first], passed.time[first]
    again = replace(
        e, members=e.members[motion], start=e.start[:, motion], constants=e.constants[:, motion],
        span=(e.span[0], time), times=np.empty(0), tol_factor=SECOND_TOL_FACTOR, searches=False,
    )  # fmt: skip
    end, k = advance(again), vars(again.named())
    assert e.event is not None
    distance = time_to_zero(e.event, e.model, k, time, end.state, end.exponent)
    passed.error[first] = np.maximum(passed.error[first], GROWN_ERRORS * distance)
    is_sure = end.accepted & (distance <= passed.uncertainty[first])
    outcome.reject(motion[~is_sure], Rejection.UNCERTAIN)


# The motions in progress, and their steps

FITTING, STILL_FITTING = (1 / 16, 16.0), (1 / 256, 256.0)
"""The bounds of the largest component of a scaled state between which it needs no new units. The
control of the error is absolute below 1, so that a motion at 1/16 has lost a digit. Outside FITTING
units are renewed at every PAUSES_PER_RENEWAL-th pause only, because a call of numpy, some 0.1 ms,
costs more than a thousand motions; outside STILL_FITTING, which few motions leave, at every pause.
So the units of a motion depend on no other motion."""

PAUSES_PER_RENEWAL = 4

STEP_LIMIT = int(4 * MIN_STIFF_STEPS)
"""The number of steps after which a motion is left to be integrated as a single case."""

HOPELESS_STEPS = 100 * MIN_STIFF_STEPS
"""A motion is left to be integrated as a single case at once if it would take more steps than this,
were all as long as its first ones."""

STEPS_PER_PAUSE = 6
"""The number of steps between pauses, which look for motions that have ended or need new units.
With it 1.5 % of the steps are of ended motions, and a pause costs as much as a third of a step."""

FULL_ENOUGH = 0.93
"""The share of columns in progress below which the others are dropped. Copying all columns costs
about as much as one step."""


def columns_at_start(e: Ensemble, motion: np.ndarray, longest: float) -> Columns:
    """The columns of some motions (n,) at their start, in the units of the case. `longest` is the
    stride of their steps."""
    n = len(motion)
    end = np.broadcast_to(e.span[1], e.start.shape[1])[motion]
    steps_taken = np.zeros(n)
    rows = np.array([*e.start[:, motion], *e.lengths[:, motion], steps_taken])
    params = np.array([end, *e.constants[:, motion], np.full(n, longest)])
    exponent, rate = np.zeros((2, n), dtype=np.intc)
    return Columns(rows, params, motion, exponent, rate)


class BatchState:
    """The motions of an ensemble that have not reached their end, in columns.

    A step writes to `output`, whose first rows then become the rows of `columns`; `spare` is the
    memory for the output of the next step. The number of columns is a multiple of the engine's
    width. A column without a motion has no time left.
    """

    def __init__(self, e: Ensemble, outcome: Outcome) -> None:
        from ...engines.taylor_batch import AlignedCalls, stride  # heyoka may be missing

        self.ensemble, self.outcome, self.step = e, outcome, AlignedCalls(e.step)
        self.candidates, self.history = list[TakenSteps](), list[np.ndarray]()
        self.pauses = 0
        # Motions with uneven starts are left to single cases, whose steps can be limited.
        turning = (e.initial_direction[moving(e.model)] != 0).any(axis=0)
        outcome.rejection[turning] = Rejection.UNEVEN.code
        begun = np.flatnonzero(turning & ~uneven(e.start[moving(e.model)]))
        motion = padded(begun)
        self.columns = columns_at_start(e, motion, stride(e.tol, e.passage_event, e.tol_factor))
        self.output, self.spare = np.empty((2, e.step.rows, len(motion)))
        self.renew(np.arange(len(motion)))
        self.clear(len(begun))
        at_start = e.times <= np.reshape(e.span[0], (-1, 1))
        np.copyto(outcome.samples, e.start[:, :, None], where=at_start)

    def clear(self, first: int) -> None:
        """Mark the columns from position `first` on as columns without a motion."""
        self.columns.clock[0, first:], self.columns.motion[first:] = 0, -1

    def advance(self) -> None:
        """Take one step of every motion."""
        e, before, end = self.ensemble, self.columns, len(self.columns.rows)
        if e.times.size:
            self.history.append(before.rows.copy())
        self.output, self.spare = self.spare, self.output
        self.step(before.rows, before.params, self.output)
        # Rows of the output: the columns after the step, the length of the step, and for each event
        # a number that is negative where the event may have a zero in the step.
        self.columns = Columns(self.output[:end], *before[1:])
        steps, passed = TakenSteps(before, self.output[end]), np.empty(0, dtype=np.int64)
        for event, bound in zip(e.step.events, self.output[end + 1 :], strict=False):
            columns = np.flatnonzero(bound < 0)
            if columns.size and event.passage:
                passed = self.cut_at_zero(event, steps, columns)
            elif columns.size and e.event is not None:
                # `e.event`, because it may be terminal, and no event of the compiled step is.
                self.note_candidates(e.event, steps, columns)
        # Done after the search for zeros in the same steps, because it changes their units.
        if passed.size:
            self.restart(passed)
            self.renew(passed)

    def sample(self) -> None:
        """Store the states at the sample times within the steps since the last pause. A sample is
        computed by a step that ends at its time."""
        e, columns = self.ensemble, self.columns
        history = np.stack([*self.history, columns.rows], axis=1)  # (rows, steps + 1, n)
        self.history.clear()
        # A motion at its end has no time left, not even the rounding error of it.
        past = Columns(history, *columns[1:])
        remaining, lost, _ = past.clock
        lost[remaining <= 0] = 0
        time, correction = past.time_and_correction
        # For each sample the number of its step, counted along the columns, and its sample time.
        step, sample = times_within(e.times, time + correction)
        rows = history[:, :-1].reshape(len(history), -1).take(step, axis=1)
        column = step % len(columns.motion)
        start = Columns(rows, *(values.take(column, axis=-1) for values in columns[1:]))
        elapsed = (e.times[sample] - time.ravel()[step]) - correction.ravel()[step]
        sampled = states_after(e.step, start, np.ldexp(elapsed, start.rate))
        entry = start.motion * len(e.times) + sample  # in the samples (n, s) of a variable, flat
        # Row by row, which is four times as fast as all rows at once.
        for samples, values in zip(self.outcome.samples, sampled, strict=True):
            samples.reshape(-1)[entry] = values
        self.outcome.sample_exponent.reshape(-1)[entry] = start.exponent

    def note_candidates(self, event: Event, steps: TakenSteps, columns: np.ndarray) -> None:
        """Keep the steps just taken in some columns, where an event's function may have zeros. A
        motion stops if the function of a terminal event has changed its sign."""
        self.candidates.append(steps.chosen(columns))
        # The time within the step is found at the end, for all motions at once.
        if event.terminal:
            ends = [at.chosen(columns) for at in (steps.start, self.columns)]
            structure = self.ensemble.model.structure
            values = (event.function(at.time, [*at.state], at.named(structure)) for at in ends)
            self.columns.clock[0, columns[np.multiply(*values) < 0]] = 0

    def cut_at_zero(self, event: Event, steps: TakenSteps, columns: np.ndarray) -> np.ndarray:
        """Cut the steps just taken in some columns at the first zero of an event's function.
        Returns the columns that have one."""
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
        self.columns.clock[0, columns[~is_sure]] = np.nan  # rejects the motion
        return np.asarray(columns[is_sure])

    def restart(self, columns: np.ndarray) -> None:
        """Continue the motions of some columns after the event, in the case's own units."""
        e, before = self.ensemble, self.columns.chosen(columns)
        states = rescaled(e.model, before.state.T, before.exponent)
        constants = e.constants[:, before.motion]
        # A passage takes numbers, so the motions pass the event one by one.
        rows = before.motion, before.params[0], before.time, states, constants.T
        at_end = []
        for column, *of_motion in zip(columns.tolist(), *map(np.ndarray.tolist, rows), strict=True):
            if self.pass_event(column, *of_motion):
                at_end.append(column)
        self.columns.constants[:, columns] = constants
        self.columns.exponent[columns] = self.columns.rate[columns] = 0
        # Motions that have ended leave their columns now: no step may lead on from a final state.
        self.store(np.array(at_end, dtype=np.int64))

    def pass_event(
        self, column: int, motion: int, end: float, time: float, state: list[float],
        numbers: list[float],
    ) -> bool:  # fmt: skip
        """Continue the motion of a column after the event; returns whether the motion ends there.
        `numbers` are its constants."""
        event, columns = self.ensemble.passage_event, self.columns
        assert event is not None
        assert event.passage is not None
        try:
            passage = event.passage(time, state, namespace(self.ensemble.model.structure, numbers))
        except (ValueError, ArithmeticError):  # the step has gone too far for a passage
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
        """Store samples, drop motions that have ended, and renew units that no longer fit."""
        columns = self.columns
        self.pauses += 1
        if self.history:
            self.sample()
        remaining, lost, steps = columns.clock
        going = (remaining > 0) & (steps < STEP_LIMIT)
        # Add the rounding error to the time left, before the time left decides the last steps.
        restored = remaining + lost
        lost += remaining - restored
        np.copyto(remaining, restored, where=going)
        # After a step of length 0 all steps have length 0: the series exceeds the range of doubles.
        remaining[going & (self.output[len(columns.rows)] == 0)] = np.nan
        going &= ~np.isnan(remaining)
        # Give up motions with far too short first steps at once; but not averaged motions, whose
        # steps are short near the separatrix only.
        if self.pauses == 1 and self.ensemble.passage_event is None:
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
        """Store the motions of the columns that are `done` (n,), and keep the other columns
        only."""
        self.store(np.flatnonzero(done & (self.columns.motion >= 0)))
        going = np.flatnonzero(~done)
        columns = padded(going)
        self.columns = self.columns.chosen(columns)
        self.output, self.spare = np.empty((2, len(self.output), len(columns)))
        self.clear(len(going))

    def store(self, columns: np.ndarray) -> None:
        """Copy the motions of some columns to the outcome, and leave the columns without a
        motion."""
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
        # After an overflow any units do.
        y = np.where(np.isfinite(old.state).all(axis=0), old.state, 1.0)
        if e.is_timed:
            moment = TimeWindow(old.time, e.lengths[0, old.motion])
        units = Units.fit(e.model, k, y, old.exponent, moment, e.falling[old.motion])
        # All factors are powers of two, so that new units change no digit.
        self.columns.state[:, columns] = rescaled(
            e.model, old.state.T, old.exponent - units.exponent
        ).T
        self.columns.clock[:2, columns] = np.ldexp(old.clock[:2], units.rate - old.rate)
        scaled = units.constants(e.model, k)
        for name, rows in e.scaled_rows.items():
            self.columns.constants[rows, columns] = scaled[name]
        self.columns.exponent[columns], self.columns.rate[columns] = units.exponent, units.rate


def times_within(times: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of the times (s,) fall into which steps: the number (k,) of the step, counted row by
    row, and the position (k,) of the time. `edges` (steps + 1, n) are the times between the steps
    of n motions."""
    passed = np.searchsorted(times, edges, side="right")
    count = np.diff(passed, axis=0).ravel()
    step = np.repeat(np.arange(len(count)), count)
    # The position of each time among the times of its step.
    rank = np.arange(len(step)) - (np.cumsum(count) - count)[step]
    return step, passed[:-1].ravel()[step] + rank
