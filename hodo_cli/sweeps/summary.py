"""What is measured of a sweep as a whole: errors of sampled members, counts, shares."""

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..batch.pool import Pool
from ..cases.case import Case
from ..engines.protocol import PRECISION, Status
from ..integration.choice import choose
from ..integration.error import errors_against, references
from ..integration.solve import refined, solve
from ..integration.trajectory import Trajectory
from ..models import rigid_body
from ..models.constants import attributes
from ..storage.group import Group, Variable
from .chunk import Chunk, fits_ensemble
from .columns import columns
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


class Probe(NamedTuple):
    """Members whose error is to be measured, with what is stored of them."""

    case: Case
    members: list[int]
    final: list[dict[str, np.ndarray]]
    crossing_time: list[float]


def probe(task: Probe) -> list[tuple[float, float, str]]:
    """The error of the final state and of the first crossing of each member, and against what they
    are measured."""
    return [_probe(task.case, *each) for each in zip(*task[1:], strict=True)]


def _probe(
    case: Case, number: int, final: Mapping[str, np.ndarray], crossing: float
) -> tuple[float, float, str]:
    """The error of a crossing is |D / (dD/dt)| where the reference stands at that time: a step of
    Newton's method."""
    one = member(case, number)
    finer = refined(one, one.system)
    own = "taylor" if fits_ensemble(case) else choose(one)[0]
    tol = case.tol or PRECISION[case.precision]
    # nan where there is no crossing, and then the comparison is false.
    between = [crossing] if crossing < case.time.end else []
    times = np.array([case.time.start, *between, case.time.end])
    for by in references(one, own, tol):
        reference = replace(solve(finer, by.method, by.precision, by.tol, times), case=one)
        if reference.whole:
            error = _final_error(one, final, reference)
            off = _newton(one, reference) if between else math.nan
            return error, off, by.kind
    return math.nan, math.nan, "none"


def _final_error(case: Case, final: Mapping[str, np.ndarray], reference: Trajectory) -> float:
    """The largest error of what is stored of a member at its end; of a vector relative to its
    length there, of a number to its largest value at start and end, since it may vanish."""
    last = reference.at(slice(-1, None))
    if not case.system.no_axis_reason:  # what is stored is the state, which is compared as it is
        own = replace(last, state=final["omega"][None], exponent=np.zeros(1, dtype=np.int64))
        return errors_against(case, own, last)["omega"]
    errors = [0.0]
    for name, values in reference.variables.items():
        if name in final:
            off = np.linalg.norm(final[name] - values[-1])
            size = np.linalg.norm(values[-1]) if values.ndim > 1 else np.abs(values).max()
            errors.append(float(off / size) if size else float(off))
    return max(errors)


def _newton(case: Case, reference: Trajectory) -> float:
    """|D / (dD/dt)| at the second sample of a motion."""
    system, A = case.system, np.array(case.data["inertia"])
    state, exponent = reference.state[1], int(reference.exponent[1])
    order = rigid_body.inertia_order(A)
    outer, inner = rigid_body.separatrix_terms(A, state, order)
    k = attributes(system.constants)
    omega = np.ldexp(state.astype(float), exponent)
    rate = np.ldexp(np.array(system.rhs(0.0, list(omega), k)), -exponent)
    w = state.astype(float)
    # D is a quadratic form, so this difference of finite steps is its derivative along the motion,
    # exactly.
    faster, slower = (
        np.subtract(*rigid_body.separatrix_terms(A, w + sign * rate, order)) for sign in (1, -1)
    )
    return abs(float(outer - inner) / (float(faster - slower) / 2))


class Part(NamedTuple):
    """A finished chunk: its attributes, and each of its variables when it is asked for."""

    attributes: Mapping[str, Any]
    variable: Callable[[str], np.ndarray]


Read = Callable[[Chunk], AbstractContextManager[Part]]


def lost_part(chunk: Chunk) -> Group:
    """A chunk whose worker failed."""
    found = {}
    for name, column in columns(chunk.case).items():
        missing = 0 if column.dtype[0] == "i" else np.nan
        fill = Status.FAILED.code if name == "status" else missing
        data = np.full(
            (chunk.last - chunk.first, *(3 for _ in column.dims)), fill, dtype=column.dtype
        )
        found[name] = Variable(("member", *column.dims), data)
    return Group({"run_time": 0.0, "alone": 0, "methods": ""}, found)


@dataclass
class Summary:
    """What is gathered from the chunks as they lie on the disk, and the members to be probed."""

    status: np.ndarray
    steps: int
    run_time: float
    alone: int
    methods: set[str]
    members: list[int]
    final: list[dict[str, np.ndarray]]
    crossing_time: list[float]


def summarized(case: Case, tasks: list[Chunk], read: Read) -> Summary:
    """Counts, shares and messages over all members of a sweep."""
    total = tasks[-1].last
    found = Summary(np.zeros(len(Status), dtype=np.int64), 0, 0.0, 0, set(), [], [], [])
    # Seeded by the number of members: the same sweep has the same sample wherever it runs.
    drawn = np.sort(np.random.default_rng(total).choice(total, min(SAMPLE, total), replace=False))
    near: list[tuple[float, int, dict[str, np.ndarray], float]] = []
    for task in tasks:
        with read(task) as part:
            status = part.variable("status")
            found.status += np.bincount(status, minlength=len(Status))
            found.steps += int(part.variable("steps").sum())
            found.run_time += part.attributes["run_time"]
            found.alone += part.attributes["alone"]
            found.methods.update(str(part.attributes["methods"]).split())
            if case.error == "off":
                continue
            final = final_values(case, part)
            crossing, separation = np.full(len(status), math.nan), np.full(len(status), math.inf)
            if not case.system.no_axis_reason:
                crossing, separation = part.variable("crossing_time"), part.variable("separation")
            separation = np.where(status == Status.OK.code, separation, np.inf)
        nearest = [i for i in np.argsort(separation)[:NEAREST] if separation[i] < np.inf]
        near += [
            (float(separation[i]), task.first + int(i), final(i), float(crossing[i]))
            for i in nearest
        ]
        # By separation, then number: the arrays behind them cannot be compared.
        near = sorted(near, key=lambda one: one[:2])[:NEAREST]
        for i in drawn[(drawn >= task.first) & (drawn < task.last)] - task.first:
            if status[i] == Status.OK.code:
                _add(found, task.first + int(i), final(i), crossing[i])
    for _, number, values, time in near:
        if number not in found.members:
            _add(found, number, values, time)
    return found


def final_values(case: Case, part: Part) -> Callable[[int], dict[str, np.ndarray]]:
    """The variables of each member of a chunk at its end, by the place of the member."""
    found = {}
    for name, variable in case.system.variables.items():
        if name == "enclosed_axis":  # a label, which has no error
            continue
        values = part.variable(name)
        # A member whose samples are stored has an axis more.
        found[name] = values[:, -1] if values.ndim > len(variable.dims) else values
    return lambda i: {name: values[i] for name, values in found.items()}


def _add(found: Summary, number: int, final: dict[str, np.ndarray], time: float) -> None:
    # Smaller, components may be below the smallest normal double, and differ for that alone.
    if max(np.abs(values).max() for values in final.values()) > 1e-290:
        found.members.append(number)
        found.final.append(final)
        found.crossing_time.append(float(time))


def sampled_errors(
    case: Case, pool: Pool, summary: Summary, report: Callable[[float], object]
) -> dict[str, Any]:
    """Quantiles of the measured errors; `report` is called with the share of them that is done."""
    tasks = [
        Probe(case, summary.members[i : i + PROBED], summary.final[i : i + PROBED],
              summary.crossing_time[i : i + PROBED])
        for i in range(0, len(summary.members), PROBED)
    ]  # fmt: skip
    found: list[tuple[float, float, str]] = []
    for i, (_, outcome) in enumerate(pool.map(probe, tasks), 1):
        report(i / len(tasks))
        if isinstance(outcome, Exception):
            raise outcome
        found += outcome
    states = [one[0] for one in found if not math.isnan(one[0])]
    times = [one[1] for one in found if not math.isnan(one[1])]
    kinds = sorted({one[2] for one in found} - {"none"})
    return {
        "error": max(states, default=math.nan),
        "error_kind": kinds[0] if kinds else "none",
        "error_sample": len(states),
        "error_levels": np.array(LEVELS),
        "error_quantiles": np.quantile(states or [math.nan], LEVELS),
        "crossing_error_quantiles": np.quantile(times or [math.nan], LEVELS),
    }
