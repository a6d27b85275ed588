"""Case -> Trajectory: the motion by the method of the case, its measured error, and remarks."""

import math
from collections.abc import Iterator

import numpy as np

from ..cases.case import Case
from ..engines.protocol import Status
from .choice import choose
from .driver import Sampled
from .error import measured_error
from .solve import Solution, solve, stored
from .trajectory import Trajectory

ASKED = 1e-12
"""The error that a motion may have whose tolerance is at the limit of its precision."""


def integrate(case: Case) -> Trajectory:
    """Integrate a case by its method and measure its error.

    Raises HodoError if its method is not available here. A case that stops early comes back with
    status `timeout` or `failed` and the samples it reached.
    """
    judged = case.error == "on"
    method, reason, solution = solved(case)
    errors, kind = measured_error(case, method, solution) if judged else ({}, "none")
    path, variables = solution.path, stored(case, solution.path)
    system, remarked = solution.case.system, remarks(case, solution, variables, errors)
    validity_warnings = (
        system.validity_warnings(path.time, path.state.astype(float), solution.tol)
        if len(path.time)
        else []
    )
    warnings = *system.warnings, *validity_warnings, *remarked
    return Trajectory(
        case=case,
        time=path.time,
        state=path.state,
        exponent=path.exponent,
        variables=variables,
        method=method,
        method_reason=reason,
        tol=solution.tol,
        steps=solution.steps,
        run_time=solution.run_time,
        status=solution.status,
        message=solution.message or early_end(case, path),
        warnings=warnings,
        events=path.events,
        errors=errors,
        error_kind=kind,
    )


def early_end(case: Case, path: Sampled) -> str:
    """Which event ends a motion before its time; an empty string if none does."""
    if not path.events or not path.time[-1] < case.time.end:
        return ""
    last = path.events[-1]
    return f"ends at t = {last.time:.6g}: {last.kind.replace('_', ' ')}"


def remarks(
    case: Case, solution: Solution, variables: dict[str, np.ndarray], errors: dict[str, float]
) -> Iterator[str]:
    """What a result does not show by itself: an error larger than was asked for, or unknown, and
    infinite values."""
    asked, worst = max(solution.tol, ASKED), max(errors.values(), default=math.nan)
    # Ten times, because a tolerance bounds the error of a step and not that of the motion.
    if worst > 10 * asked:
        whose = "asked for" if case.tol else "that is usual"
        yield f"the measured error {worst:.1e} exceeds ten times the {asked:.0e} {whose}"
    if case.error == "on" and math.isnan(worst):
        yield "the error could not be measured"
    for name, values in variables.items():
        if not np.isfinite(values).all():
            yield f"{name} has outgrown the largest double, and is stored as infinite or nan there"


def solved(case: Case) -> tuple[str, str, Solution]:
    """Method, reason and solution of a case: by collocation where `auto` has taken the series and
    that fails."""
    method, reason = choose(case)
    solution = solve(case, method, case.precision, case.tol)
    if (
        case.method == "auto"
        and method == "taylor"
        # Not after a timeout: the user has said how long a case may take.
        and solution.status is Status.FAILED
        and case.precision != "quadruple"
    ):
        other = solve(case, "collocation", case.precision, case.tol)
        if other.whole:
            return "collocation", f"the Taylor series failed: {solution.message}", other
    return method, reason, solution
