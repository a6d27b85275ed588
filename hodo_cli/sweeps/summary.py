"""Counts over all members of a sweep, and the measured errors of some."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import thread_time
from typing import Any, NamedTuple

import numpy as np

from .. import NOT_OF_A_CASE
from ..batch import Pool
from ..cases.case import Case
from ..engines import extended
from ..engines.protocol import PRECISION, Status
from ..integration import (
    Trajectory,
    choose,
    error_of_variable,
    error_over_span,
    references,
    solve,
    time_error,
    time_to_zero,
)
from ..storage import Group
from .chunk import Chunk, reason_alone
from .columns import reduced_ensemble
from .ensemble.advance import LOOSER_TOLS, advance
from .ensemble.motions import Rejection
from .members import members_as_cases, prepare

RANDOM_MEMBERS, NEAREST_MEMBERS = 256, 64
"""Members whose error is asked for: drawn at random, and nearest to the separatrix."""

MEASURED_MEMBERS = 96
"""Of these, the members whose error is measured against a reference, at milliseconds each: those
whose ends two integrations in double place farthest apart. Of the others this difference, which
costs a hundredth of that, is taken for the error."""

MEMBERS_PER_TASK = 16
"""Members of one task: of some milliseconds each, enough tasks for any number of processes, few
enough for their overhead."""

ERROR_TASKS = MEASURED_MEMBERS // MEMBERS_PER_TASK
"""The most tasks that the errors of a sweep take."""

QUANTILE_LEVELS = (0.5, 0.9, 0.99, 1.0)
"""Of the errors, these quantiles are stored."""

EXTENDED_TOL = 2.0**-60
"""The tolerance of references in long double: two hundred times below the rounding of a double, and
a third cheaper than all that a long double holds."""

LEAST_SIZE = 1e-290
"""The size of a stored number from which on its error is measured: of smaller ones, components may
be below the smallest normal double, and differ for that alone."""


class MemberEnd(NamedTuple):
    """A member as it is stored: its number, its variables at the end, with the time of its last
    event, and that of its first crossing."""

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


def differences(case: Case, ends: Sequence[MemberEnd]) -> np.ndarray:
    """The errors (n, 2) of final states and first crossings of members by an integration in double
    with other steps; infinite where only a reference can tell."""
    apart = np.full((len(ends), 2), math.inf)
    for group in prepare(case, np.array([end.number for end in ends])):
        e = replace(group, looser=LOOSER_TOLS)
        outcome = advance(e)
        again = reduced_ensemble(e, outcome, case.time)
        for row, i in enumerate(group.members[outcome.accepted].tolist()):
            end = ends[i]
            states = [part_apart(end.final[name], again[name][row]) for name in end.final]
            crossing = again.get("crossing_time", np.full(row + 1, math.nan))[row]
            if math.isnan(crossing) == math.isnan(end.crossing_time):
                apart[i] = max(states), abs(crossing - end.crossing_time)
    return apart


def part_apart(a: np.ndarray, b: np.ndarray) -> float:
    """How far two values of a variable are apart, relative to its size."""
    return float(np.abs(a - b).max() / max(np.abs(a).max(), LEAST_SIZE))


def worst_first(
    case: Case, ends: Sequence[MemberEnd]
) -> tuple[Sequence[MemberEnd], list[MemberError]]:
    """The ends of those members whose errors are to be measured, and the errors of the others by
    `differences`."""
    if len(ends) <= MEASURED_MEMBERS or reason_alone(case):
        return ends, []
    apart = differences(case, ends)
    states, crossings = np.argsort(-np.nan_to_num(apart, nan=0.0, posinf=math.inf), axis=0).T
    share = MEASURED_MEMBERS * 2 // 3
    worst = {*states[:share].tolist(), *crossings[: MEASURED_MEMBERS - share].tolist()}
    # In the order of their numbers, so that those that share their data lie together.
    others = [MemberError(*apart[i]) for i in range(len(ends)) if i not in worst]
    return [ends[i] for i in sorted(worst)], others


def probe(case: Case, ends: Sequence[MemberEnd]) -> tuple[list[MemberError], float]:
    """The errors of some members, and the seconds that they cost; an exception costs its own
    member."""
    errors, began = [], thread_time()
    singles = members_as_cases(case, np.array([end.number for end in ends]), samples=2)
    for end, single in zip(ends, singles, strict=True):
        try:
            errors.append(member_error(case, single, end))
        except NOT_OF_A_CASE:
            raise
        except Exception as error:  # of whatever kind, since the sweep itself is computed
            errors.append(MemberError(problem=str(error) or type(error).__name__))
    return errors, thread_time() - began


def member_error(case: Case, single: Case, end: MemberEnd) -> MemberError:
    """The error of a member of a sweep, which is also a case by itself.

    The error of a crossing is |D / (dD/dt)| where the reference stands at that time: a step of
    Newton's method.
    """
    crossing = end.crossing_time
    method = choose(single)[0] if reason_alone(case) else "taylor"
    tol = case.tol or PRECISION[case.precision]
    # nan where there is no crossing, and then the comparison is false. Averaged motions have no
    # function whose zero a crossing is.
    is_crossing = crossing < case.time.end and not case.system.is_quadrature
    crossings = [crossing] if is_crossing else []
    times = np.array([case.time.start, *crossings, case.time.end])
    for by in references(single, method, tol):
        by_tol = by.tol or (EXTENDED_TOL if by.precision == "extended" else None)
        reference = solve(single, by.method, by.precision, by_tol, times)
        if reference.succeeded:
            shift = crossing_error(reference) if crossings else math.nan
            return MemberError(final_error(end.final, reference), shift, by.kind)
    return MemberError(problem="no better computation reached their end")


def final_error(final: Mapping[str, np.ndarray], reference: Trajectory) -> float:
    """The largest error of the stored variables of a member at its end, and of the time of its last
    event, by the rules of `errors_against`; of a number relative to its largest value at start and
    end, since it may vanish."""
    errors = [0.0]
    if "event_time" in final:
        errors.append(error_of_last_event(float(final["event_time"]), reference))
    for name in reference.variables.keys() & final.keys():
        better = reference.variables[name]
        judged = np.concatenate((better[:-1], final[name][None]))
        errors.append(
            error_of_variable(reference.system.equations.variables[name].dims, judged, better)
        )
    return max(errors)


def error_of_last_event(time: float, reference: Trajectory) -> float:
    """The error of the time of a member's last event; infinite where its reference has none."""
    if not reference.events:
        return math.inf
    better = reference.events[-1].time
    return error_over_span(time_error(time, better), better, reference.case.time.start)


def crossing_error(reference: Trajectory) -> float:
    """How far in time the second sample of a motion is from the separatrix."""
    system, second = reference.case.system, reference.at(slice(1, 2))
    (event,) = system.class_events
    state, k = extended(second.state).T, system.constants
    return float(time_to_zero(event, system.equations, k, second.time, state, second.exponent)[0])


class Summary:
    """Sums over the chunks of a sweep, the ends of the members whose error is measured, and how
    many of these have none, by reason; with what the attributes of an `earlier` result say of the
    members that are taken over from it."""

    def __init__(self, case: Case, total: int, earlier: Mapping[str, Any]) -> None:
        self.case, self.earlier = case, earlier
        self.status, self.alone = (np.zeros(len(words), dtype=int) for words in (Status, Rejection))
        self.steps = int(self.earlier.get("steps", 0))
        self.released = int(self.earlier.get("released", 0))
        self.run_time = float(self.earlier.get("run_time", 0.0))
        self.methods = {*filter(None, str(self.earlier.get("method", "")).split(", "))}
        self.unmeasured: Counter[str] = Counter()
        # Seeded by the number of members: the same sweep has the same sample wherever it runs.
        draw = np.random.default_rng(total)
        self._drawn = draw.choice(total, min(RANDOM_MEMBERS, total), replace=False)
        self._ends: list[MemberEnd] = []
        self._near: list[tuple[float, MemberEnd]] = []

    def add(self, chunk: Chunk, group: Group) -> None:
        """Add a finished chunk."""
        columns = {name: variable.data for name, variable in group.variables.items()}
        status, taken = columns["status"], chunk.taken
        self.status += np.bincount(status, minlength=len(Status))
        self.steps += int(columns["steps"][~taken].sum())
        if "event_release" in columns:
            self.released += int(np.isfinite(columns["event_release"][~taken]).sum())
        self.run_time += float(group.attributes["run_time"])
        self.alone += np.asarray(group.attributes["rejections"])
        self.methods.update(str(group.attributes["methods"]).split())
        if not self.case.error:
            return
        ok = np.flatnonzero((status == Status.OK.code) & ~taken)
        if not self.case.system.no_axis_reason:
            separation = columns["separation"]
            nearest = ok[np.argsort(separation[ok])[:NEAREST_MEMBERS]]
            near = [(float(separation[i]), member_end(chunk, columns, i)) for i in nearest]
            ordered = sorted(self._near + near, key=lambda pair: (pair[0], pair[1].number))
            self._near = [pair for pair in ordered if pair[0] < math.inf][:NEAREST_MEMBERS]
        drawn = ok[np.isin(chunk.first + ok, self._drawn)]
        self._ends += [member_end(chunk, columns, i) for i in drawn]

    @property
    def ends(self) -> list[MemberEnd]:
        """The members whose error is asked for."""
        ends = {end.number: end for end in [*self._ends, *(end for _, end in self._near)]}
        return [ends[number] for number in sorted(ends)]


def member_end(chunk: Chunk, columns: Mapping[str, np.ndarray], i: int) -> MemberEnd:
    """The end of a member of a chunk, by its row there."""
    final = {}
    for name, variable in chunk.case.system.equations.variables.items():
        if name != "enclosed_axis":  # a label, which has no error
            values = columns[name][i]
            # A member whose samples are stored has an axis more.
            final[name] = values[-1] if values.ndim == len(variable.dims) else values
    if "event_time" in columns and not math.isnan(columns["event_time"][i]):
        final["event_time"] = columns["event_time"][i]
    crossing = math.nan if chunk.case.system.no_axis_reason else columns["crossing_time"][i]
    return MemberEnd(int(chunk.first + i), final, float(crossing))


def largest(end: MemberEnd) -> float:
    """The largest component of the stored variables of a member."""
    return float(max(np.abs(values).max() for values in end.final.values()))


def sampled_errors(
    pool: Pool, summary: Summary, report: Callable[[float], object]
) -> dict[str, Any]:
    """Quantiles of the errors of the members asked for; the summary counts members that have none.
    `report` is called with the finished share of them. The summary's run time is then with
    theirs."""
    began, asked = thread_time(), summary.ends
    sizes = [largest(end) for end in asked]
    known_ends = [end for end, size in zip(asked, sizes, strict=True) if size > LEAST_SIZE]
    ends, others = worst_first(summary.case, known_ends)
    summary.run_time += thread_time() - began
    tasks = [ends[i : i + MEMBERS_PER_TASK] for i in range(0, len(ends), MEMBERS_PER_TASK)]
    errors: list[MemberError] = []
    for i, (task, outcome) in enumerate(pool.map(partial(probe, summary.case), tasks), 1):
        report(i / len(tasks))
        if isinstance(outcome, Exception):
            outcome = [MemberError(problem=str(outcome))] * len(task), 0.0
        errors += outcome[0]
        summary.run_time += outcome[1]
    summary.unmeasured = Counter(error.problem for error in errors if error.problem)
    small, unknown = sum(x <= LEAST_SIZE for x in sizes), sum(map(math.isnan, sizes))
    summary.unmeasured[f"they end below {LEAST_SIZE:g}"] = small
    summary.unmeasured["an event ends them before their last sample"] = unknown
    states, times = (
        known(
            [getattr(error, name) for error in errors], [getattr(other, name) for other in others]
        )
        for name in ("final", "crossing_time")
    )
    states += earlier_errors(summary, "error_quantiles")
    times += earlier_errors(summary, "crossing_error_quantiles")
    kinds = sorted({error.kind for error in errors} - {"none"})
    kinds += [str(summary.earlier.get("error_kind", "none"))]
    return {
        "error": max(states, default=math.nan),
        "error_kind": kinds[0],
        "error_sample": len(states),
        "error_levels": np.array(QUANTILE_LEVELS),
        "error_quantiles": np.quantile(states or [math.nan], QUANTILE_LEVELS),
        "crossing_error_quantiles": np.quantile(times or [math.nan], QUANTILE_LEVELS),
    }


def known(measured: Sequence[float], estimated: Sequence[float]) -> list[float]:
    """Errors that are known; the largest is one that was measured."""
    largest = np.fmax.reduce(measured, initial=0.0)
    found = [*measured, *np.minimum(estimated, largest).tolist()]
    return [x for x in found if not math.isnan(x)]


def earlier_errors(summary: Summary, name: str) -> list[float]:
    """Upper bounds for the errors that an earlier run has measured, by their stored quantiles: as
    many as lie between two of these have the larger one."""
    if name not in summary.earlier:
        return []
    ranks = np.floor(np.array(QUANTILE_LEVELS) * int(summary.earlier["error_sample"])).astype(int)
    return list(np.repeat(summary.earlier[name], np.diff(ranks, prepend=0)).tolist())
