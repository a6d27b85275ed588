"""The motions of an ensemble from their start to their end, and the errors of their crossings."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...integration.crossings import time_to_zero
from ...integration.driver import LIMIT, at_rest
from ...integration.units import clock_rates
from ...models.base import Event
from .batch import PAUSE, BatchState
from .motions import Ensemble, Outcome, Rejection
from .passages import decide_passages

if TYPE_CHECKING:
    from ...engines.taylor_batch import TaylorStep

LOOSER, GROWN = 16, 32
"""The tolerances that a step takes where the growth of errors is looked for, and the error that a
crossing may have in differences that this makes. A difference may be small by chance. For 6 of
35,000 crossings of tensors and cavities the error that steps lose was too small, and the difference
a quarter of the true one at the least. For four in five, GROWN differences enlarge nothing."""


def step_of(e: Ensemble) -> "TaylorStep":
    """The compiled step of an ensemble."""
    from ...engines import taylor_batch  # heyoka may be missing

    # Its code is the same whether the event ends a motion or not.
    watched = (event._replace(terminal=False) for event in (e.passing, e.event) if event)
    return taylor_batch.build(e.model, e.structure, tuple(watched))  # type: ignore[arg-type]


@np.errstate(all="ignore")  # what overflows is not finite, hence not accepted
def advance(e: Ensemble, step: "TaylorStep") -> Outcome:
    """All motions of an ensemble through their span by a step, which may watch an event that the
    ensemble does not look for."""
    m, n = e.start.shape
    outcome = Outcome.blank(m, n, len(e.times))
    if e.start.any():
        batch = BatchState(e, step, outcome)
        while batch.params.shape[1]:
            # Numpy's own work is in the pauses; between them a step is one call of compiled code.
            for _ in range(PAUSE):
                batch.advance()
            batch.pause()
        if e.event is not None:
            decide_passages(e, e.event, batch.candidates, step, outcome)
    if e.model.degree and e.model.oriented:
        stop_at_rest(outcome)
    if not e.model.degree:
        outcome.reject(clock_rates(e.model, e.named(), e.start) != 0, Rejection.UNIT)
    outcome.reject(~np.isfinite(outcome.state).all(axis=0), Rejection.OUTGROWN)
    for state in (e.start, outcome.state):  # single cases refine what approximates the equations
        outcome.reject(~e.model.is_accurate(state, e.named(), e.tol), Rejection.COARSE)
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
    outcome.passages = passed.chosen(~at_rest(passed.state[:3].T, passed.exponent))
    outcome.last[(outcome.state[:3] == 0).all(axis=0)] = 0


def measure_crossings(e: Ensemble, event: Event, outcome: Outcome) -> None:
    """Enlarge the errors of first crossings to what a second integration, with other steps, shows.

    Errors grow along a motion that stays near the separatrix, some 1e4-fold: a pass by the middle
    axis turns one of D into one of the phase, and a torque that depends on the phase turns that
    into a larger one of D. No single step tells it. The second integration ends at the time of the
    crossing, and its distance from D = 0 there is the difference of the two times. A motion where
    it is larger than the time for which the sign of D is taken to be uncertain is not accepted.
    """
    passed = outcome.passages
    first = np.flatnonzero(passed.is_first & outcome.accepted[passed.motion])
    motion, time = passed.motion[first], passed.time[first]
    again = replace(
        e, start=e.start[:, motion], constants=e.constants[:, motion], span=(e.span[0], time),
        event=None, times=np.empty(0), looser=LOOSER,
    )  # fmt: skip
    end, k = advance(again, step_of(e)), vars(again.named())
    distance = time_to_zero(event, e.model, k, time, end.state, end.exponent)
    passed.error[first] = np.maximum(passed.error[first], GROWN * distance)
    is_sure = end.accepted & (distance <= passed.uncertainty[first])
    outcome.reject(motion[~is_sure], Rejection.UNCERTAIN)
