"""The motions of an ensemble from their start to their end, the zeros of an event's function, and
which motions they leave uncertain."""

from dataclasses import replace

import numpy as np
from numpy.polynomial.polynomial import polyder

from ...arithmetic import horner
from ...engines.units import clock_rates
from ...integration import at_rest, time_to_zero
from ...models.base import REST_BITS, Event, moving
from .batch import STEPS_PER_PAUSE, BatchState
from .motions import Columns, Ensemble, Outcome, Passages, Rejection, TakenSteps, zeros_of

LOOSER_TOLS, GROWN_ERRORS = 16, 32
"""The tolerances that a step takes where the growth of errors is looked for, and the error that a
crossing may have in differences that this makes. A difference may be small by chance. For 6 of
35,000 crossings of tensors and cavities the error that steps lose was too small, and the difference
a quarter of the true one at the least. For four in five, GROWN_ERRORS differences enlarge
nothing."""


@np.errstate(all="ignore")  # what overflows is not finite, hence not accepted
def advance(e: Ensemble) -> Outcome:
    """All motions of an ensemble through their span."""
    m, n = e.start.shape
    outcome = Outcome(m, n, len(e.times))
    # One compiled step watches one event of each kind; of more, single cases keep the order.
    kinds = [event.passage is not None for event in e.events]
    if len(kinds) > len(set(kinds)):
        outcome.rejection[:] = Rejection.EVENTS.code
        return outcome
    if e.onset.any():
        batch = BatchState(e, outcome)
        while batch.columns.motion.size:
            # Numpy's own work is in the pauses; between them a step is one call of compiled code.
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
    """Put motions that have become too slow to be followed at rest, as single cases are."""
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
    """Find where motions pass from one side to another, in the steps in which they may.

    A motion is accepted if its passages lead, by turns, from the side at its start to that at its
    end, and none of these is uncertain.
    """
    resting = enter_sides(e, event, outcome)
    # With an uncertain side a motion is not accepted, whatever passages it has.
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


def enter_sides(e: Ensemble, event: Event, outcome: Outcome) -> np.ndarray:
    """Enter the sides on which motions begin and end, 0 where they are uncertain; returns which
    (n,) a brake has brought to rest, where no side is left."""
    outcome.start_side = e.side(event, e.span[0], e.onset)
    outcome.end_side = e.side(event, e.span[1], outcome.state)
    return np.asarray((outcome.state[:3] == 0).all(axis=0))


def stop_at(zeros: Passages, times: np.ndarray, outcome: Outcome) -> None:
    """Let motions end at zeros (k,) of an event's function, with samples at `times` up to there."""
    outcome.state[:, zeros.motion] = zeros.state
    outcome.exponent[zeros.motion] = zeros.exponent
    outcome.end_side[zeros.motion] = zeros.after
    for motion, time in zip(zeros.motion, zeros.time, strict=True):
        outcome.samples[:, motion, times > time] = np.nan


def reject_contradicted(outcome: Outcome, resting: np.ndarray) -> None:
    """Reject motions whose passages do not lead, by turns, from the side at their start to that at
    their end, unless they are at rest (n,) there; and those that start on none."""
    passed = outcome.passages
    before = np.where(passed.is_first, outcome.start_side[passed.motion], np.roll(passed.after, 1))
    outcome.reject(passed.motion[passed.before != before], Rejection.UNCERTAIN)
    side = outcome.start_side.copy()
    side[passed.motion] = passed.after  # of several, the last one counts
    contradicted = (side != outcome.end_side) & ~resting
    outcome.reject(contradicted | (outcome.start_side == 0), Rejection.UNCERTAIN)


def steps_of(candidates: list[TakenSteps], certain: np.ndarray) -> TakenSteps | None:
    """All steps of those motions that are `certain` (n,); None if there are none."""
    if not candidates:
        return None
    steps = TakenSteps.joined(candidates)
    wanted = np.flatnonzero(certain[steps.start.motion])
    return steps.chosen(wanted) if wanted.size else None


def zeros_within(e: Ensemble, event: Event, steps: TakenSteps) -> tuple[Passages, np.ndarray]:
    """The zeros in steps that may have some, and the motions that are undecided."""
    powers, begin = steps.powers(e.step, event), steps.start
    noise = e.uncertainty(event, begin.time, begin.state, begin.named(e.model.structure))
    zeros = zeros_of(*without_start(e, begin, powers, noise))
    undecided = begin.motion[zeros.row[~zeros.sure]]
    # From here on a row is a zero, no longer a step.
    row, x = zeros.row[zeros.sure], zeros.x[zeros.sure]
    passed = steps.chosen(row)
    times, motion, rate = passed.times_at(x), passed.start.motion, passed.start.rate
    slope = horner(polyder(powers[row].T), x) / passed.length
    uncertainty = np.ldexp(noise[row] / np.abs(slope), -rate)
    errors = e.errors_of_times(uncertainty, times, passed.start.clock[-1] + 2)
    side = np.sign(slope).astype(np.int64)
    unordered = Passages(
        motion, times, errors, uncertainty, -side, side,
        passed.states_at(e.step, x), passed.start.exponent,
    )  # fmt: skip
    return unordered.chosen(np.lexsort((times, motion))), undecided


def without_start(
    e: Ensemble, start: Columns, powers: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The series (k, order + 1) of D in steps, of those that begin at rest by its square: of a body
    set going from rest D begins with the square of the time, and that zero is no passage. And the
    bounds (k,) of their rounding."""
    at_rest = np.flatnonzero(~start.state[moving(e.model)].any(axis=0))
    later, noise = powers.copy(), noise.copy()
    later[at_rest] = np.pad(powers[at_rest, 2:], ((0, 0), (0, 2)))
    noise[at_rest] = e.error_bound * np.abs(powers[at_rest]).sum(axis=1)
    return later, noise


def measure_crossings(e: Ensemble, outcome: Outcome) -> None:
    """Enlarge the errors of first crossings to what a second integration, with other steps, shows.

    Errors grow along a motion that stays near the separatrix, some 1e4-fold: a pass by the middle
    axis turns one of D into one of the phase, and a torque that depends on the phase turns that
    into a larger one of D. No single step tells it. The second integration ends at the time of the
    crossing, and its distance from D = 0 there is the difference of the two times. A motion where
    it is larger than the time for which the sign of D is taken to be uncertain is not accepted.
    """
    passed = outcome.passages
    first = np.flatnonzero(passed.is_first & outcome.accepted[passed.motion])
    # Where no motion crosses twice, errors do not grow beside the separatrix.
    if not first.size or e.model.form.no_axis_reason or e.model.always_absorbing:
        return
    motion, time = passed.motion[first], passed.time[first]
    again = replace(
        e, members=e.members[motion], start=e.start[:, motion], constants=e.constants[:, motion],
        span=(e.span[0], time), times=np.empty(0), looser=LOOSER_TOLS, searches=False,
    )  # fmt: skip
    end, k = advance(again), vars(again.named())
    assert e.event is not None
    distance = time_to_zero(e.event, e.model, k, time, end.state, end.exponent)
    passed.error[first] = np.maximum(passed.error[first], GROWN_ERRORS * distance)
    is_sure = end.accepted & (distance <= passed.uncertainty[first])
    outcome.reject(motion[~is_sure], Rejection.UNCERTAIN)
