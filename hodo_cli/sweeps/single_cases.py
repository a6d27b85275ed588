"""Single cases of one kind, integrated side by side."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..cases.case import Case
from ..integration import Crossing, Trajectory, sample_times
from ..text import grouped
from .chunk import crossing_columns, other_method
from .ensemble.advance import advance
from .ensemble.motions import Ensemble
from .members import alike, ensemble_of

FEWEST_CASES = 32
"""Single cases of one kind, below which each by itself takes less time than compiling the step."""

CrossedMotion = tuple[Trajectory, tuple[Crossing, ...]]
"""A motion and its separatrix crossings."""


def side_by_side(cases: Sequence[Case]) -> list[CrossedMotion | None]:
    """The motions of single cases, integrated side by side where there are enough of one kind; None
    for a case that is left to `classify`."""
    motions: list[CrossedMotion | None] = [None] * len(cases)
    for e in ensembles_of(cases):
        times = sample_times(cases[e.members[0]])
        outcome = advance(replace(e, times=times))
        crossings: list[list[Crossing]] = [[] for _ in e.members]
        columns = crossing_columns(e, outcome.accepted_passages).values()
        rows = zip(*(column.tolist() for column in columns), strict=True)
        for n, (time, error, start, end, momentum) in zip(
            outcome.accepted_passages.motion, rows, strict=True
        ):
            crossings[n].append(Crossing(time, start, end, momentum, error))
        for n in np.flatnonzero(outcome.accepted):
            case, state = cases[e.members[n]], outcome.samples[:, n].T
            motion = Trajectory(
                case, case.system, "taylor", e.tol, times, state, outcome.sample_exponent[n]
            )
            motions[e.members[n]] = motion, tuple(crossings[n])
    return motions


def ensembles_of(cases: Sequence[Case]) -> Iterator[Ensemble]:
    """The ensembles that single cases make, where there are enough of one kind."""
    kinds = grouped(
        (
            (type(case.system), case.time, case.tol),
            ensemble_of(case, case.system, np.array([i]), case.system.start),
        )
        for i, case in enumerate(cases)
        if watches_separatrix(case)
    )
    for singles in kinds.values():
        yield from (e for e in alike(singles) if len(e.members) >= FEWEST_CASES)


def watches_separatrix(case: Case) -> bool:
    """Whether an ensemble finds the crossings of a case, with a step that is soon compiled."""
    system = case.system
    is_small = bool(system.degree) and not system.no_axis_reason
    return is_small and not other_method(case) and not system.run_events
