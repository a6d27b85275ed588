"""Case -> Trajectory: the motion by the method of the case, its measured error, and remarks."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..cases.case import Case
from ..engines.protocol import Status
from ..models.attitude import warnings_of
from ..models.base import attributes, has_formula_of_time
from ..models.brake import time_of_release
from ..quantities import angle_turned
from ..text import time_digits, to_error
from .choice import choose
from .error import with_measured_error
from .solve import Trajectory, solve, with_seconds_left
from .step_checks import HELD, NOT_SMOOTH

ERROR_LIMIT_ASKED = 1e-12
"""The error that a motion may have whose tolerance is at the limit of its precision."""

PLACES_AT_REST = 2**15
"""How many intervals of the time that a brake holds a body are looked through for stronger torques:
as many as the places at which formulas are looked at in a motion."""


def integrate(case: Case) -> Trajectory:
    """Integrate a case by its method and measure its error.

    Raises HodoError if its method is not available here. A case that stops early comes back with
    status `timeout` or `failed` and the samples it reached.
    """
    if case.time.runs_backward:
        return in_time_of_case(integrate(replace(case, time=case.time.rising)), case)
    motion = solved(case, *choose(case))
    # The start alone, which a motion that fails at once is left with, has no error to measure.
    if case.error and (motion.succeeded or (motion.time > case.time.start).any()):
        motion = with_measured_error(motion)
    return motion.with_remarks(
        message=motion.message or early_end(motion),
        warnings=(*model_warnings(motion), *motion_remarks(motion)),
    )


def in_time_of_case(motion: Trajectory, case: Case) -> Trajectory:
    """The motion of a case that runs backward from one whose time has another sign."""
    events = tuple(replace(event, time=-event.time) for event in motion.events)
    return motion.with_remarks(case=case, time=-motion.time, events=events)


FAR_SPANS = 100
"""At this many spans from 0 a time counts from an epoch, and a law that names t hardly does."""


def epoch_warning(case: Case) -> list[str]:
    """The warning of expressions whose time counts from 0, far from the motion."""
    time, spans = case.time, abs(case.time.start) / (abs(case.time.end - case.time.start) or 1.0)
    if time.epoch is not None or spans <= FAR_SPANS or not has_formula_of_time(case.system):
        return []
    words = "spans before start" if time.start > 0 else "spans behind start"
    return [f"t counts from 0, {spans:.0f} {words}: write epoch: {time.start:.15g}, or epoch: 0"]


def early_end(motion: Trajectory) -> str:
    """Which of its events ends a motion before its time; an empty string if none does."""
    if not motion.events:
        return ""
    last = motion.events[-1]
    # The samples of a body that a brake has stopped go on.
    if not (motion.time[-1] < motion.case.time.end or last.kind == "stopped"):
        return ""
    digits = time_digits(last.time, motion.case.time.start)
    when = to_error(last.time, last.error, digits, digits)
    return f"ends at t = {when}: {last.kind.replace('_', ' ')}"


def model_warnings(motion: Trajectory) -> list[str]:
    """The warnings of the model of a motion about its data and its course."""
    system, state, end = motion.case.system, motion.state.astype(float), motion.time[-1:].tolist()
    if not end:
        return warnings_of(system)
    warnings = [*warnings_of(system), *epoch_warning(motion.case)]
    if not motion.case.time.mirrored:  # of coefficients as they follow each other forward
        warnings += system.warnings_within(motion.case.time.start, end[0])
    # Not read off the samples: between two of them a body may stop and a torque grow.
    stop = next((event.time for event in motion.events if event.kind == "stopped"), math.nan)
    k = attributes(system.constants)
    moves = time_of_release(k, stop, end[0], state[-1], PLACES_AT_REST)
    if not math.isnan(moves):
        warnings.append(
            "at rest the other torques are stronger than the brake from "
            f"t = {motion.case.time.text(moves)} on: the body would move again there, and here it "
            "does not"
        )
    return warnings


def motion_remarks(motion: Trajectory) -> Iterator[str]:
    """Remarks on a motion: an error larger than was asked for, or unknown, a probability far from
    its limit, and infinite values."""
    case = motion.case
    yield from excess_remark(case, error_to_judge(motion), motion.tol)
    if case.error and math.isnan(motion.error):
        yield "the error could not be measured"
    for name, values in motion.variables.items():
        if case.rests_on(name) and not np.isfinite(values).all():
            yield f"{name} exceeds the largest double, and is stored as infinite or nan there"


def error_to_judge(motion: Trajectory) -> float:
    """The largest measured error; that of an attitude, an angle, by the angle that the body has
    turned, where this is more than a radian."""
    errors, variables = dict(motion.errors), motion.variables
    if not {"attitude", "omega"} <= {*errors} & {*variables}:
        return motion.error
    errors["attitude"] /= max(1.0, angle_turned(motion.time, variables["omega"]))
    return max(errors.values())


def excess_remark(case: Case, error: float, tol: float) -> Iterator[str]:
    """The remark on an error that is larger than was asked for."""
    asked = max(tol, ERROR_LIMIT_ASKED)
    # Ten times, because a tolerance bounds the error of a step and not that of the motion.
    if error > 10 * asked:
        words = f"the {asked:.0e} {'asked for' if case.tol else 'that hodo aims at'}"
        if case.tol and case.tol < asked:
            words = f"{asked:.0e}, about as little as rounding allows"
        yield f"the measured error {error:.1e} is more than ten times {words}"


def solved(case: Case, method: str, reason: str) -> Trajectory:
    """A case by the method that was chosen for a reason: by collocation where `auto` has taken the
    series and that fails."""
    motion = solve(case, method, case.precision, case.tol)
    if (
        case.method == "auto"
        and method == "taylor"
        # Not after a timeout: the user has said how long a case may take.
        and motion.status is Status.FAILED
        and case.precision != "quadruple"
        # No method leads on from there; a series that cannot begin may know no derivatives alone.
        and not (motion.steps and motion.message.startswith((HELD, NOT_SMOOTH)))
    ):
        rest = with_seconds_left(case, motion)
        other = solve(rest, "collocation", case.precision, case.tol)
        if other.succeeded:
            reason = f"the Taylor series failed: {motion.message}"
            return replace(other, case=case, method_reason=reason)
    return replace(motion, method_reason=reason)
