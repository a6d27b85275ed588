"""One case by one method at one tolerance, judged by the best that can be computed of it."""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, product, repeat
from time import perf_counter, thread_time
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..engines import have_quadruple
from ..engines.protocol import Status
from ..integration import (
    ERROR_LIMIT_ASKED,
    Crossing,
    Trajectory,
    best,
    body_of,
    choose,
    cross,
    errors_against,
    motion_remarks,
    principal_omega,
    sample_times,
    solve,
    solved,
    taylor_steps,
    thinned,
    with_measured_error,
)
from ..models import rigid_body

TRIAL_VERDICTS = (
    "accurate",
    "limited by the data",
    "inaccurate, as stated",
    "failed with a message",
    "timeout",
    "SILENT",
)

ERROR_SLACK = 10
"""An error may be so many times what was asked for; from there on `remarks` warns of it."""

ULP_EFFECTS = 30
"""An error may be so many times what one ulp in the data does: hodo promises no more for motions
that magnify errors."""

QUADRUPLE_STEPS = 1e4
"""The most Taylor steps that are taken in quadruple precision, some 0.2 ms each."""

PATIENCE_OF_TRIALS = 10.0
"""Seconds that auto may take for any case; the papers' cases take milliseconds."""

SINGLE_RUN_SECONDS = 1.0
"""Seconds above which a run is timed once: what only the first one pays does not matter then."""

REPEAT_SECONDS, MAX_REPEATS = 0.05, 50
"""Seconds of repeated runs, and their number, after which the least time does not fall further."""

CONSERVED_TOL = 1e-15
"""The relative change below which a quantity counts as conserved: 1e4 steps in extended precision
round by less."""


@dataclass(frozen=True)
class ReferenceMotion:
    """The motion of a case, better than any method gives it in double precision, at samples of the
    case.

    `floor` is the change that one ulp in the data makes; `conserved` are the positions, among T and
    |G|, of the quantities that it conserves.
    """

    motion: Trajectory
    floor: float
    crossings: tuple[Crossing, ...]
    conserved: tuple[int, ...]


@dataclass(frozen=True)
class Trial:
    """A case by one method at one tolerance. Not a number stands for what does not apply.

    `method` is the one that auto took; `run_time` is the least of several, in seconds of the
    processor, without imports; `compile_time` is what the first run in the process took beyond it;
    `drift` is the largest relative change of what the motion conserves.
    """

    method: str = ""
    status: str = ""
    error: float = math.nan
    crossing_error: float = math.nan
    run_time: float = math.nan
    compile_time: float = math.nan
    steps: float = math.nan
    rhs_evaluations: float = math.nan
    drift: float = math.nan
    floor: float = math.nan
    message: str = ""


def reference_motion(case: Case) -> ReferenceMotion:
    """The best that can be computed of a case: in quadruple precision unless that takes too
    long."""
    every = sample_times(case)
    times = every[thinned(len(every))]
    method, _ = best(case, "extended")
    # In long double, where the rounding of the integration is far below one ulp of the data.
    motion, *moved = [
        solve(variant, method, "extended", times=times) for variant in (case, *perturbed(case))
    ]
    floor = max(worst(errors_against(case, perturbation, motion)) for perturbation in moved)
    if method == "taylor" and have_quadruple() and taylor_steps(case) < QUADRUPLE_STEPS:
        motion = solve(case, method, "quadruple", times=times)
    crossings = cross(case, method, "extended", None)[1] if classifiable(case) else []
    conserved = tuple(i for i, change in enumerate(drifts(motion)) if change <= CONSERVED_TOL)
    return ReferenceMotion(motion, floor, tuple(crossings), conserved)


def worst(errors: Mapping[str, float]) -> float:
    """The largest of the errors; not a number counts as infinite."""
    return max(
        (math.inf if math.isnan(error) else error for error in errors.values()), default=math.nan
    )


def classifiable(case: Case) -> bool:
    """Whether crossings are looked for: not in a motion of too many samples or steps."""
    short = case.time.samples <= QUADRUPLE_STEPS and taylor_steps(case) < QUADRUPLE_STEPS
    return short and not case.system.no_axis_reason


def perturbed(case: Case) -> Iterator[Case]:
    """The case with every number of its data moved by one ulp: all upwards, and every other one
    downwards.

    Numbers that are equal within a list stay so, and 0 stays 0.
    """
    # Moving all one way alone may cancel: a body that is scaled turns as before.
    yield replace(case, data=_moved(case.data, repeat(math.inf)))
    yield replace(case, data=_moved(case.data, cycle((-math.inf, math.inf))))


def _moved(value: Any, towards: Iterator[float]) -> Any:
    """A copy of case data in which each number goes one ulp towards the next of `towards`."""
    if isinstance(value, Mapping):
        return {key: _moved(item, towards) for key, item in value.items()}
    if isinstance(value, tuple):
        # A scalar that stands for three must stay one, and a symmetric body symmetric: its form
        # has another state.
        moved = {item: _moved(item, towards) for item in dict.fromkeys(value)}
        return tuple(moved[item] for item in value)
    if isinstance(value, float) and value != 0:
        return math.nextafter(value, next(towards))
    return value


def drifts(motion: Trajectory) -> list[float]:
    """The largest relative changes of T and |G|, for a motion whose state is the angular
    velocity."""
    if [*motion.case.system.variables] != ["omega"] or not len(motion.time):
        return []
    A, omega = body_of(motion.case).moments.astype(np.longdouble), principal_omega(motion)
    size = np.ldexp(np.longdouble(1), motion.exponent - motion.exponent[0])
    with np.errstate(all="ignore"):
        energy = rigid_body.kinetic_energy(A, omega) * size**2
        momentum = np.sqrt(np.square(rigid_body.angular_momentum(A, omega)).sum(axis=-1)) * size
        return [float(np.max(np.abs(values / values[0] - 1))) for values in (energy, momentum)]


def trial(
    case: Case,
    reference: ReferenceMotion,
    method: str,
    tol: float | None,
    repeats: int,
    max_seconds: float,
) -> Trial:
    """One case by one method at one tolerance, timed and judged."""
    case = replace(case, method=method, tol=tol, max_seconds=max_seconds)
    try:
        choose(case)  # the time does not include the trial for stiffness
        began = thread_time()
        motion = solved(case, *choose(case))
        first = thread_time() - began
    except HodoError as mistake:
        return Trial(method, "failed with a message", message=str(mistake), floor=reference.floor)
    run_time = least_time(case, motion, repeats)
    thin = compared(motion)
    error = worst(errors_against(case, thin, reference.motion)) if motion.succeeded else math.nan
    changes = drifts(thin)
    return Trial(
        method=motion.method,
        status=verdict(motion, error, reference.floor),
        error=error,
        crossing_error=error_of_crossings(motion, reference),
        run_time=run_time,
        compile_time=max(first - run_time, 0.0),
        steps=motion.steps,
        rhs_evaluations=motion.evaluations or math.nan,
        # One that ran out of time before its first sample has none.
        drift=max((changes[i] for i in reference.conserved if changes), default=math.nan),
        floor=reference.floor,
        message=motion.message,
    )


def least_time(case: Case, motion: Trajectory, repeats: int) -> float:
    """The least run time of a motion of a case and of its repeats, of which there are more than
    asked for where they are short: whatever else happens only adds to a time."""
    times = [motion.run_time]
    while motion.run_time < SINGLE_RUN_SECONDS and (
        len(times) < repeats or (sum(times) < REPEAT_SECONDS and len(times) < MAX_REPEATS)
    ):
        times.append(solve(case, motion.method, case.precision, case.tol).run_time)
    return min(times)


def compared(motion: Trajectory) -> Trajectory:
    """A motion at the samples at which its error is measured."""
    return motion.at(thinned(len(motion.time)))


def verdict(motion: Trajectory, error: float, floor: float) -> str:
    """The verdict on a result; SILENT if it is wrong and does not say so."""
    if not motion.succeeded:
        return "timeout" if motion.status is Status.TIMEOUT else "failed with a message"
    if error <= ERROR_SLACK * max(motion.tol, ERROR_LIMIT_ASKED):
        return "accurate"
    if error <= ULP_EFFECTS * floor:
        return "limited by the data"
    # Measured only now: a result that is right needs no warning.
    remarks = motion_remarks(compared(with_measured_error(motion)))
    return "inaccurate, as stated" if any(remarks) else "SILENT"


def error_of_crossings(motion: Trajectory, reference: ReferenceMotion) -> float:
    """The largest relative error of a crossing's time; infinite if the crossings are not the true
    ones, and no number where there are none to compare."""
    if not (reference.crossings and motion.succeeded):
        return math.nan
    crossings = cross(motion.case, motion.method, motion.case.precision, motion.tol)[1]
    if [(c.start, c.end) for c in crossings] != [(c.start, c.end) for c in reference.crossings]:
        # Times of crossings that are not the true ones cannot be compared.
        return math.inf
    return max(
        abs(a.time - b.time) / abs(b.time)
        for a, b in zip(crossings, reference.crossings, strict=True)
    )


def trials_of(
    case: Case, methods: Sequence[str], tols: Sequence[float], repeats: int, max_seconds: float
) -> tuple[list[Trial], float]:
    """The trials of a case, by tolerances within methods (no tolerance: each method's own), and the
    seconds they took."""
    began = perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of SciPy's solvers and overflows: the verdicts count them
        reference = reference_motion(case)
        patience = dict.fromkeys(methods, max_seconds) | {"auto": PATIENCE_OF_TRIALS}
        trials = [
            trial(case, reference, method, tol, repeats, patience[method])
            for method, tol in product(methods, tols or (None,))
        ]
    return trials, perf_counter() - began
