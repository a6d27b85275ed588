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
"""The error that counts as asked for where the tolerance is smaller: about what rounding allows."""

PLACES_AT_REST = 2**15
"""The number of intervals into which the time at rest under a brake is divided, to find torques
stronger than the brake: as many as the places at which formulas are checked in a motion."""


def integrate(case: Case) -> Trajectory:
    """Integrate a case by its method and measure its error.

    Raises HodoError if its method is not available here. A case that stops early returns the
    samples it reached, with the status `timeout` or `failed`.
    """
    if case.time.runs_backward:
        return in_time_of_case(integrate(replace(case, time=case.time.rising)), case)
    motion = solved(case, *choose(case))
    # A motion that fails at once has only its start, without an error to measure.
    if case.error and (motion.succeeded or (motion.time > case.time.start).any()):
        motion = with_measured_error(motion)
    return motion.with_remarks(
        message=motion.message or early_end(motion),
        warnings=(*model_warnings(motion), *motion_remarks(motion)),
    )


def in_time_of_case(motion: Trajectory, case: Case) -> Trajectory:
    """The motion of a case that runs backward, from the motion with the opposite sign of time."""
    events = tuple(replace(event, time=-event.time) for event in motion.events)
    return motion.with_remarks(case=case, time=-motion.time, events=events)


FAR_SPANS = 100
"""A motion that starts more than this many spans from t = 0 has times that count from some epoch.
Expressions with t hardly count from it."""


def epoch_warning(case: Case) -> list[str]:
    """The warning that expressions count t from 0, far from the motion; none where an epoch is
    given or the motion is near 0."""
    time, spans = case.time, abs(case.time.start) / (abs(case.time.end - case.time.start) or 1.0)
    if time.epoch is not None or spans <= FAR_SPANS or not has_formula_of_time(case.system):
        return []
    words = "spans before start" if time.start > 0 else "spans after start"
    return [f"t counts from 0, {spans:.0f} {words}: write epoch: {time.start:.15g}, or epoch: 0"]


def early_end(motion: Trajectory) -> str:
    """The event that ends a motion early, in words with its time; empty if none does."""
    if not motion.events:
        return ""
    last = motion.events[-1]
    # A body that a brake has stopped has samples at rest up to the end.
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
    if not motion.case.time.mirrored:  # these assume that time rises
        warnings += system.warnings_within(motion.case.time.start, end[0])
    # From the event, because a body may stop and a torque grow between two samples.
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
    """Remarks on a motion: on an error that is unknown or larger than was asked for, and on
    infinite values."""
    case = motion.case
    yield from excess_remark(case, error_to_judge(motion), motion.tol)
    if case.error and math.isnan(motion.error):
        yield "the error could not be measured"
    for name, values in motion.variables.items():
        if case.rests_on(name) and not np.isfinite(values).all():
            yield f"{name} exceeds the largest double, and is stored as infinite or nan there"


def error_to_judge(motion: Trajectory) -> float:
    """The largest measured error. The error of an attitude, an angle, is divided by the angle that
    the body has turned if that is more than a radian."""
    errors, variables = dict(motion.errors), motion.variables
    if not {"attitude", "omega"} <= {*errors} & {*variables}:
        return motion.error
    errors["attitude"] /= max(1.0, angle_turned(motion.time, variables["omega"]))
    return max(errors.values())


def excess_remark(case: Case, error: float, tol: float) -> Iterator[str]:
    """The remark on an error that is much larger than was asked for; none on a smaller one."""
    asked = max(tol, ERROR_LIMIT_ASKED)
    # Ten times, because a tolerance bounds the error of a step and not that of the motion.
    if error > 10 * asked:
        words = f"the {asked:.0e} {'asked for' if case.tol else 'that hodo aims at'}"
        if case.tol and case.tol < asked:
            words = f"{asked:.0e}, about as little as rounding allows"
        yield f"the measured error {error:.1e} is more than ten times {words}"


def solved(case: Case, method: str, reason: str) -> Trajectory:
    """The motion of a case by a method that was chosen for a `reason`. If `auto` has chosen the
    Taylor series and it fails, the motion is by collocation if that succeeds."""
    motion = solve(case, method, case.precision, case.tol)
    if (
        case.method == "auto"
        and method == "taylor"
        # Not after a timeout: the user has said how long a case may take.
        and motion.status is Status.FAILED
        and case.precision != "quadruple"
        # No method continues where formulas hold the motion or are not smooth. But a series that
        # has made no step may only lack derivatives at the start.
        and not (motion.steps and motion.message.startswith((HELD, NOT_SMOOTH)))
    ):
        rest = with_seconds_left(case, motion)
        other = solve(rest, "collocation", case.precision, case.tol)
        if other.succeeded:
            reason = f"the Taylor series failed: {motion.message}"
            return replace(other, case=case, method_reason=reason)
    return replace(motion, method_reason=reason)
