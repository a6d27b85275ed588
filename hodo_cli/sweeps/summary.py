"""Counts over all members of a sweep, and the measured errors of a sample of members."""

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
from .ensemble.advance import SECOND_TOL_FACTOR, advance
from .ensemble.motions import Rejection
from .members import members_as_cases, prepare

RANDOM_MEMBERS, NEAREST_MEMBERS = 256, 64
"""The numbers of members in the sample for errors: drawn at random, and nearest to the
separatrix."""

MEASURED_MEMBERS = 96
"""The number of members in the sample whose error is measured against a reference, at milliseconds
each: the members for which two integrations in double differ most at the end. For the other members
this difference, which costs a hundredth as much, is taken as the error."""

MEMBERS_PER_TASK = 16
"""The members in one task of measuring errors, at some milliseconds each: there are enough tasks
for many processes, and few enough that their overhead does not count."""

ERROR_TASKS = MEASURED_MEMBERS // MEMBERS_PER_TASK
"""The most tasks that measure the errors of a sweep."""

QUANTILE_LEVELS = (0.5, 0.9, 0.99, 1.0)
"""The quantiles of the errors that are stored."""

EXTENDED_TOL = 2.0**-60
"""The tolerance of references in long double: 1/256 of the rounding of a double, and a third
cheaper than the full precision of a long double."""

LEAST_SIZE = 1e-290
"""The smallest final state whose error is measured. Components of smaller states may be below the
smallest normal double, and differ for that reason alone."""


class MemberEnd(NamedTuple):
    """The stored result of a member: its number, its variables at the end with the time of its last
    event, and the time of its first crossing."""

    number: int
    final: Mapping[str, np.ndarray]
    crossing_time: float


class MemberError(NamedTuple):
    """The errors of the final state and of the first crossing of a member, the kind of the
    reference, and the problem if there is no reference."""

    final: float = math.nan
    crossing_time: float = math.nan
    kind: str = "none"
    problem: str = ""


def differences(case: Case, ends: Sequence[MemberEnd]) -> np.ndarray:
    """The errors (n, 2) of final states and first crossings of members, estimated by an integration
    in double with other steps; infinite where only a reference can measure them."""
    apart = np.full((len(ends), 2), math.inf)
    for group in prepare(case, np.array([end.number for end in ends])):
        e = replace(group, tol_factor=SECOND_TOL_FACTOR)
        outcome = advance(e)
        again = reduced_ensemble(e, outcome, case.time)
        for row, i in enumerate(group.members[outcome.accepted].tolist()):
            end = ends[i]
            states = [relative_difference(end.final[name], again[name][row]) for name in end.final]
            crossing = again["crossing_time"][row] if "crossing_time" in again else math.nan
            # Both integrations cross, or neither does.
            if math.isnan(crossing) == math.isnan(end.crossing_time):
                apart[i] = max(states), abs(crossing - end.crossing_time)
    return apart


def relative_difference(a: np.ndarray, b: np.ndarray) -> float:
    """The largest difference of two values of a variable, relative to the size of the first
    value."""
    return float(np.abs(a - b).max() / max(np.abs(a).max(), LEAST_SIZE))


def choose_measured(
    case: Case, ends: Sequence[MemberEnd]
) -> tuple[Sequence[MemberEnd], list[MemberError]]:
    """The ends of the members whose errors are to be measured, and for the other members the errors
    estimated by `differences`."""
    if len(ends) <= MEASURED_MEMBERS or reason_alone(case):
        return ends, []
    apart = differences(case, ends)
    # The largest differences first; nan, of a member without a crossing, counts as 0.
    states, crossings = np.argsort(-np.nan_to_num(apart, nan=0.0, posinf=math.inf), axis=0).T
    share = MEASURED_MEMBERS * 2 // 3
    worst = {*states[:share].tolist(), *crossings[: MEASURED_MEMBERS - share].tolist()}
    # In the order of their numbers, so that members with common data are in one task.
    others = [MemberError(*apart[i]) for i in range(len(ends)) if i not in worst]
    return [ends[i] for i in sorted(worst)], others


def probe(case: Case, ends: Sequence[MemberEnd]) -> tuple[list[MemberError], float]:
    """The errors of some members, and the processor time that they took, in seconds. A member whose
    measurement raises an exception has no error, and the message as its problem."""
    errors, began = [], thread_time()
    singles = members_as_cases(case, np.array([end.number for end in ends]), samples=2)
    for end, single in zip(ends, singles, strict=True):
        try:
            errors.append(member_error(case, single, end))
        except NOT_OF_A_CASE:
            raise
        except Exception as error:  # of any kind, because the sweep itself is computed
            errors.append(MemberError(problem=str(error) or type(error).__name__))
    return errors, thread_time() - began


def member_error(case: Case, single: Case, end: MemberEnd) -> MemberError:
    """The error of a member of a sweep. `single` is the same member as a single case.

    The error of a crossing is a step of Newton's method: |D / (dD/dt)| of the reference at the
    member's crossing time, where D is the separatrix function.
    """
    crossing = end.crossing_time
    method = choose(single)[0] if reason_alone(case) else "taylor"
    tol = case.tol or PRECISION[case.precision]
    # Without a crossing the time is nan, and the comparison is false. The crossings of averaged
    # motions are not zeros of a function.
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
    """The largest error of the stored variables of a member at its end and of the time of its last
    event, by the rules of `errors_against`. The error of a scalar is relative to its largest value
    at start and end, because the scalar may vanish at the end."""
    errors = [0.0]
    if "event_time" in final:
        errors.append(error_of_last_event(float(final["event_time"]), reference))
    for name in reference.variables.keys() & final.keys():
        better = reference.variables[name]
        # Only the last row differs from the reference; the first one gives the scale.
        judged = np.concatenate((better[:-1], final[name][None]))
        dims = reference.case.system.equations.variables[name].dims
        errors.append(error_of_variable(dims, judged, better))
    return max(errors)


def error_of_last_event(time: float, reference: Trajectory) -> float:
    """The error of the time of a member's last event; infinite where its reference has none."""
    if not reference.events:
        return math.inf
    better = reference.events[-1].time
    return error_over_span(time_error(time, better), better, reference.case.time.start)


def crossing_error(reference: Trajectory) -> float:
    """The distance in time from the separatrix of the second sample of a motion."""
    system, second = reference.case.system, reference.at(slice(1, 2))
    (event,) = system.class_events
    state, k = extended(second.state).T, system.constants
    return float(time_to_zero(event, system.equations, k, second.time, state, second.exponent)[0])


class Summary:
    """Sums over the chunks of a sweep, the ends of the members in the sample for errors, and the
    number of members of the sample without an error, by reason. The sums begin with the attributes
    of an `earlier` result, for the members that are copied from it."""

    def __init__(self, case: Case, total: int, earlier: Mapping[str, Any]) -> None:
        self.case, self.earlier = case, earlier
        self.status, self.alone = (np.zeros(len(words), dtype=int) for words in (Status, Rejection))
        self.steps = int(self.earlier.get("steps", 0))
        self.released = int(self.earlier.get("released", 0))
        self.run_time = float(self.earlier.get("run_time", 0.0))
        self.methods = {*filter(None, str(self.earlier.get("method", "")).split(", "))}
        self.problem = ""  # of the first member that did not reach its end
        self.unmeasured: Counter[str] = Counter()
        # The seed is the number of members, so that a sweep has the same sample wherever it runs.
        draw = np.random.default_rng(total)
        self._drawn = draw.choice(total, min(RANDOM_MEMBERS, total), replace=False)
        self._ends: list[MemberEnd] = []
        self._near: list[tuple[float, MemberEnd]] = []

    def add(self, chunk: Chunk, group: Group) -> None:
        """Add the columns of a finished chunk to the sums, and its members to the sample."""
        columns = {name: variable.data for name, variable in group.variables.items()}
        status, taken = columns["status"], chunk.taken
        self.status += np.bincount(status, minlength=len(Status))
        self.steps += int(columns["steps"][~taken].sum())
        if "event_release" in columns:
            self.released += int(np.isfinite(columns["event_release"][~taken]).sum())
        self.run_time += float(group.attributes["run_time"])
        self.alone += np.asarray(group.attributes["rejections"])
        self.methods.update(str(group.attributes["methods"]).split())
        self.problem = self.problem or str(group.attributes["problem"])
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
        """The members in the sample for errors, in the order of their numbers."""
        ends = {end.number: end for end in [*self._ends, *(end for _, end in self._near)]}
        return [ends[number] for number in sorted(ends)]


def member_end(chunk: Chunk, columns: Mapping[str, np.ndarray], i: int) -> MemberEnd:
    """The end of a member of a chunk, from row i of the chunk's columns."""
    final = {}
    for name, variable in chunk.case.system.equations.variables.items():
        if name != "enclosed_axis":  # a label, which has no error
            values = columns[name][i]
            # If samples are stored, the time is a further axis.
            final[name] = values[-1] if values.ndim == len(variable.dims) else values
    if "event_time" in columns and not math.isnan(columns["event_time"][i]):
        final["event_time"] = columns["event_time"][i]
    crossing = math.nan if chunk.case.system.no_axis_reason else columns["crossing_time"][i]
    return MemberEnd(int(chunk.first + i), final, float(crossing))


def largest(end: MemberEnd) -> float:
    """The largest component of the final variables of a member."""
    return float(max(np.abs(values).max() for values in end.final.values()))


def sampled_errors(
    pool: Pool, summary: Summary, report: Callable[[float], object]
) -> dict[str, Any]:
    """The attributes of a sweep about its errors: the largest error, and quantiles over the sample.

    The summary receives the numbers of members without an error and the processor time that the
    errors took. `report` is called with the finished share of the tasks.
    """
    began, sample = thread_time(), summary.ends
    sizes = [largest(end) for end in sample]
    # The size of a member that an event ends early is nan.
    known_ends = [end for end, size in zip(sample, sizes, strict=True) if size > LEAST_SIZE]
    ends, others = choose_measured(summary.case, known_ends)
    summary.run_time += thread_time() - began
    tasks = [ends[i : i + MEMBERS_PER_TASK] for i in range(0, len(ends), MEMBERS_PER_TASK)]
    errors: list[MemberError] = []
    for i, (task, outcome) in enumerate(pool.map(partial(probe, summary.case), tasks), 1):
        report(i / len(tasks))
        if isinstance(outcome, Exception):
            outcome = [MemberError(problem=str(outcome))] * len(task), 0.0
        measured, seconds = outcome
        errors += measured
        summary.run_time += seconds
    summary.unmeasured = Counter(error.problem for error in errors if error.problem)
    summary.unmeasured[f"they end below {LEAST_SIZE:g}"] = sum(x <= LEAST_SIZE for x in sizes)
    summary.unmeasured["an event ends them before their last sample"] = sum(map(math.isnan, sizes))
    states = finite_errors([error.final for error in errors], [x.final for x in others])
    times = finite_errors(
        [error.crossing_time for error in errors], [x.crossing_time for x in others]
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


def finite_errors(measured: Sequence[float], estimated: Sequence[float]) -> list[float]:
    """The measured and the estimated errors that are not nan. An estimate above the largest
    measured error is replaced by that error."""
    largest = np.fmax.reduce(measured, initial=0.0)
    found = [*measured, *np.minimum(estimated, largest).tolist()]
    return [x for x in found if not math.isnan(x)]


def earlier_errors(summary: Summary, name: str) -> list[float]:
    """Upper bounds of the errors that an earlier run measured, from their stored quantiles: each
    error between two quantiles counts as the larger one."""
    if name not in summary.earlier:
        return []
    # The number of errors up to each quantile.
    ranks = np.floor(np.array(QUANTILE_LEVELS) * int(summary.earlier["error_sample"])).astype(int)
    return list(np.repeat(summary.earlier[name], np.diff(ranks, prepend=0)).tolist())
