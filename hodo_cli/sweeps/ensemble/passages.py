"""The zeros of an event's function in the steps of an ensemble, and which motions they leave
uncertain."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...engines.series import value
from ...models.base import Event
from ...models.constants import namespace
from .batch import (
    END,
    NUMBER,
    STRIDE,
    CandidateSteps,
    columnwise,
    powers_within,
    shortened,
    states_after,
    time_reached,
    times_of,
    units_of,
    zeros_of,
)
from .motions import Ensemble, Outcome, Passages, Rejection

if TYPE_CHECKING:
    from ...engines.taylor_batch import TaylorStep

STEP_ROUNDING, PER_STEP = 2.0**-52, 1 / 16
"""The part of a state that a step is taken to lose to rounding, and, in tolerances, to the end of
the series. What follows for the times of crossings was two to three times the largest error in
random ensembles of all models (tests/test_sweep.py), and some fifty times the common one."""


def decide_passages(
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
    outcome.first = e.side(event, e.span[0], e.start)
    outcome.last = e.side(event, e.span[1], outcome.state)
    # A brake has brought these to rest, where no sign is left.
    resting = (outcome.state[:3] == 0).all(axis=0)
    # With an uncertain sign a motion is not accepted, whatever zeros it has.
    certain = (outcome.first != 0) & (event.terminal | resting | (outcome.last != 0))
    steps = steps_of(candidates, certain & ~e.is_one_sided(event))
    if steps is not None:
        zeros, undecided = zeros_within(e, event, steps, step)
        if event.terminal:
            zeros = zeros.chosen(zeros.is_first)
            outcome.state[:, zeros.motion] = zeros.state
            outcome.exponent[zeros.motion] = zeros.exponent
            for motion, time in zip(zeros.motion, zeros.time, strict=True):
                outcome.samples[:, motion, e.times > time] = np.nan
        outcome.passages = zeros
        outcome.reject(undecided, Rejection.UNCERTAIN)
    passed = outcome.passages
    if event.terminal:
        outcome.last[passed.motion] = passed.direction
    before = np.where(passed.is_first, outcome.first[passed.motion], np.roll(passed.direction, 1))
    outcome.reject(passed.motion[passed.direction != -before], Rejection.UNCERTAIN)
    sign = outcome.first.copy()
    sign[passed.motion] = passed.direction  # of several, the last one counts
    contradicted = (sign != outcome.last) & ~resting
    outcome.reject(contradicted | (outcome.first == 0), Rejection.UNCERTAIN)


def steps_of(candidates: list[CandidateSteps], certain: np.ndarray) -> CandidateSteps | None:
    """All steps of those motions that are `certain` (n,); None if there are none."""
    if not candidates:
        return None
    steps = CandidateSteps(
        *(np.concatenate(arrays, axis=-1) for arrays in zip(*candidates, strict=True))
    )
    wanted = np.flatnonzero(certain[steps.params[NUMBER].astype(np.int64)])
    return CandidateSteps(*(a.take(wanted, axis=-1) for a in steps)) if wanted.size else None


def zeros_within(
    e: Ensemble, event: Event, steps: CandidateSteps, step: "TaylorStep"
) -> tuple[Passages, np.ndarray]:
    """The zeros in steps that may have some, and the motions that are undecided."""
    before, params, m = steps.before, steps.params, len(e.start)
    k = namespace(e.structure, list(params[1:STRIDE]))
    noise = e.uncertainty(event, times_of(before, params, m), before[:m], k)
    powers = powers_within(step, event, steps)
    zeros = zeros_of(powers, noise)
    row = zeros.row[zeros.sure]
    place = zeros.x[zeros.sure] * steps.length[row]
    rise = powers[row, 1:].T * np.arange(1, powers.shape[1])[:, None]
    slope = value(rise, zeros.x[zeros.sure]) / steps.length[row]
    before, params = before[:, row], params[:, row]
    size, rate = units_of(params)
    begin, rest = time_reached(params[END], before[m], before[m + 1], rate)
    times = begin + (rest + np.ldexp(place, -rate))
    taken = before[m + 2] + 2
    state = columnwise(
        partial(states_after, step), *shortened(before, params[:NUMBER], place, rate)
    )
    motion = params[NUMBER].astype(np.int64)
    uncertainty = np.ldexp(noise[row] / np.abs(slope), -rate)
    certain_part = (STEP_ROUNDING + PER_STEP * e.tol) * taken / e.error_bound
    errors = certain_part * uncertainty + np.spacing(np.abs(times)) / 2
    direction = np.sign(slope).astype(np.int64)
    unordered = Passages(motion, times, errors, uncertainty, direction, state, size)
    undecided = steps.params[NUMBER, zeros.row[~zeros.sure]].astype(np.int64)
    return unordered.chosen(np.lexsort((times, motion))), undecided
