"""Counts over all members of a sweep, and the measured errors of some."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from .. import NOT_OF_A_CASE
from ..batch.pool import Pool
from ..cases.case import Case
from ..engines import extended
from ..engines.protocol import PRECISION, Status
from ..integration.choice import choose
from ..integration.crossings import time_to_zero
from ..integration.error import errors_against, references
from ..integration.solve import refined, solve
from ..integration.trajectory import Trajectory
from ..models.attitude import angle_apart
from ..models.constants import rescaled
from ..storage.group import Group
from .chunk import NONE_ALONE, Chunk, fits_ensemble, group_of_members
from .columns import blank_columns
from .members import member

SAMPLE, NEAREST = 256, 64
"""Members whose error is measured: drawn at random, and nearest to the separatrix."""

PROBED = 16
"""Members of one task: of some milliseconds each, enough tasks for any number of processes, few
enough for their overhead."""

PROBES = (SAMPLE + NEAREST) // PROBED
"""The most tasks that the errors of a sweep take."""

LEVELS = (0.5, 0.9, 0.99, 1.0)
"""Of the errors, these quantiles are stored."""


class MemberEnd(NamedTuple):
    """A member as it is stored: its number, its variables at the end, its first crossing."""

    number: int
    final: Mapping[str, np.ndarray]
    crossing_time: float


class MemberError(NamedTuple):
    """The errors of the final state and of the first crossing of a member, the kind of the
    reference that they are measured against, and why there is none."""

    final: float = math.nan
    crossing_time: float = math.nan
    kind: str = "none"
    problem: str = ""


class SampledMembers(NamedTuple):
    """Members of a sweep whose error is to be measured."""

    case: Case
    ends: list[MemberEnd]


def probe(task: SampledMembers) -> list[MemberError]:
    """The errors of some members; an exception costs its own member."""
    errors = []
    for end in task.ends:
        try:
            errors.append(member_error(task.case, end))
        except NOT_OF_A_CASE:
            raise
        except Exception as error:  # of whatever kind, since the sweep itself is computed
            errors.append(MemberError(problem=str(error) or type(error).__name__))
    return errors


def member_error(case: Case, end: MemberEnd) -> MemberError:
    """The error of a crossing is |D / (dD/dt)| where the reference stands at that time: a step of
    Newton's method."""
    single, crossing = member(case, end.number), end.crossing_time
    finer = refined(single, single.system)
    method = "taylor" if fits_ensemble(case) else choose(single)[0]
    tol = case.tol or PRECISION[case.precision]
    # nan where there is no crossing, and then the comparison is false.
    crossings = [crossing] if crossing < case.time.end else []
    times = np.array([case.time.start, *crossings, case.time.end])
    for by in references(single, method, tol):
        reference = replace(solve(finer, by.method, by.precision, by.tol, times), case=single)
        if reference.whole:
            shift = crossing_error(reference) if crossings else math.nan
            return MemberError(final_error(end.final, reference), shift, by.kind)
    return MemberError()


def final_error(final: Mapping[str, np.ndarray], reference: Trajectory) -> float:
    """The largest error of the stored variables of a member at its end; of a vector relative to its
    length there, of a number to its largest value at start and end, since it may vanish."""
    case, last = reference.case, reference.at(slice(-1, None))
    errors, compared = [0.0], set()
    if not case.system.no_axis_reason:  # omega is the state, which is compared as it is
        true = rescaled(type(case.system), last.state.astype(float), last.exponent)
        state = np.concatenate((final["omega"][None], true[:, 3:]), axis=1)
        stored = replace(last, state=state, exponent=np.zeros(1, dtype=np.intc))
        errors.append(errors_against(case, stored, last)["omega"])
        compared.add("omega")
    for name, values in reference.variables.items():
        if name == "attitude" and name in final:
            errors.append(float(angle_apart(final[name] - values[-1], values[-1])))
        elif name in final and name not in compared:
            distance = np.linalg.norm(final[name] - values[-1])
            size = np.linalg.norm(values[-1]) if values.ndim > 1 else np.abs(values).max()
            errors.append(float(distance / size) if size else float(distance))
    return max(errors)


def crossing_error(reference: Trajectory) -> float:
    """How far in time the second sample of a motion is from the separatrix."""
    system, second = reference.case.system, reference.at(slice(1, 2))
    (event,) = system.class_events
    state, k = extended(second.state).T, system.constants
    distance = time_to_zero(event, type(system), k, second.time, state, second.exponent)
    return float(distance[0])


class FinishedChunk(NamedTuple):
    """A finished chunk: its attributes, and each of its variables when it is asked for."""

    attributes: Mapping[str, Any]
    variable: Callable[[str], np.ndarray]


Read = Callable[[Chunk], AbstractContextManager[FinishedChunk]]


def lost_chunk(chunk: Chunk) -> Group:
    """The columns of a chunk whose worker failed."""
    values = blank_columns(chunk.case, chunk.last - chunk.first)
    values["status"][:] = Status.FAILED.code
    return group_of_members(chunk.case, values, 0.0, NONE_ALONE, "")


@dataclass
class Summary:
    """Sums over the chunks on the disk, the ends of the members whose error is measured, and how
    many of these have none, by reason."""

    status: np.ndarray
    steps: int
    run_time: float
    alone: np.ndarray
    methods: set[str]
    ends: list[MemberEnd]
    unmeasured: Counter[str] = field(default_factory=Counter)


def summarized(case: Case, tasks: list[Chunk], read: Read) -> Summary:
    """Counts, shares and messages over all members of a sweep."""
    total = tasks[-1].last
    summary = Summary(np.zeros(len(Status), dtype=np.int64), 0, 0.0, NONE_ALONE.copy(), set(), [])
    # Seeded by the number of members: the same sweep has the same sample wherever it runs.
    drawn = np.sort(np.random.default_rng(total).choice(total, min(SAMPLE, total), replace=False))
    near: list[tuple[float, MemberEnd]] = []
    for task in tasks:
        with read(task) as chunk:
            status = chunk.variable("status")
            summary.status += np.bincount(status, minlength=len(Status))
            summary.steps += int(chunk.variable("steps").sum())
            summary.run_time += chunk.attributes["run_time"]
            summary.alone += chunk.attributes["rejections"]
            summary.methods.update(str(chunk.attributes["methods"]).split())
            if case.error == "off":
                continue
            end, separation = member_ends(case, task, chunk), np.full(len(status), math.inf)
            if not case.system.no_axis_reason:
                ok = status == Status.OK.code
                separation = np.where(ok, chunk.variable("separation"), np.inf)
        nearest = [i for i in np.argsort(separation)[:NEAREST] if separation[i] < np.inf]
        near += [(float(separation[i]), end(int(i))) for i in nearest]
        near = sorted(near, key=lambda pair: (pair[0], pair[1].number))[:NEAREST]
        within = drawn[(drawn >= task.first) & (drawn < task.last)] - task.first
        summary.ends += [end(int(i)) for i in within if status[i] == Status.OK.code]
    numbers = {end.number for end in summary.ends}
    summary.ends += [end for _, end in near if end.number not in numbers]
    # Smaller, components may be below the smallest normal double, and differ for that alone.
    summary.ends = [end for end in summary.ends if largest(end) > 1e-290]
    return summary


def largest(end: MemberEnd) -> float:
    """The largest component of the stored variables of a member."""
    return float(max(np.abs(values).max() for values in end.final.values()))


def member_ends(case: Case, task: Chunk, chunk: FinishedChunk) -> Callable[[int], MemberEnd]:
    """The end of each member of a chunk, by its row there."""
    final, crossing = {}, np.full(task.last - task.first, math.nan)
    for name, variable in case.system.variables.items():
        if name == "enclosed_axis":  # a label, which has no error
            continue
        values = chunk.variable(name)
        # A member whose samples are stored has an axis more.
        final[name] = values[:, -1] if values.ndim > len(variable.dims) else values
    if not case.system.no_axis_reason:
        crossing = chunk.variable("crossing_time")
    return lambda i: MemberEnd(
        task.first + i, {name: x[i] for name, x in final.items()}, float(crossing[i])
    )


def sampled_errors(
    case: Case, pool: Pool, summary: Summary, report: Callable[[float], object]
) -> dict[str, Any]:
    """Quantiles of the measured errors; the summary counts members that have none. `report` is
    called with the finished share of them."""
    starts = range(0, len(summary.ends), PROBED)
    tasks = [SampledMembers(case, summary.ends[i : i + PROBED]) for i in starts]
    errors: list[MemberError] = []
    for i, (task, outcome) in enumerate(pool.map(probe, tasks), 1):
        report(i / len(tasks))
        if isinstance(outcome, Exception):
            outcome = [MemberError(problem=str(outcome))] * len(task.ends)
        errors += outcome
    summary.unmeasured = Counter(error.problem for error in errors if error.problem)
    states = [error.final for error in errors if not math.isnan(error.final)]
    times = [error.crossing_time for error in errors if not math.isnan(error.crossing_time)]
    kinds = sorted({error.kind for error in errors} - {"none"})
    return {
        "error": max(states, default=math.nan),
        "error_kind": kinds[0] if kinds else "none",
        "error_sample": len(states),
        "error_levels": np.array(LEVELS),
        "error_quantiles": np.quantile(states or [math.nan], LEVELS),
        "crossing_error_quantiles": np.quantile(times or [math.nan], LEVELS),
    }
