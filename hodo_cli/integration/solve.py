"""Case -> Trajectory: the motion of a case by one method."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import thread_time
from typing import Any

import numpy as np

from .. import HodoError, engines
from ..cases.case import Case
from ..cases.keys import NO_CLOSED_FORM, NO_RATES, finds_no_stop, wrong_precision
from ..engines.protocol import LAST_STEP, Status, StepControl
from ..engines.units import is_timed
from ..models.base import attributes, rescaled
from .driver import (
    LARGEST_EXPONENT,
    OVERFLOW_MESSAGE,
    SAMPLES_AT_ONCE,
    Occurrence,
    Propagation,
    Reader,
    SampleBuffer,
)


@dataclass(frozen=True)
class Trajectory:
    """A case, integrated by a method at a tolerance.

    `time` (n,) in the case's units; `state` (n, m) in the working
    precision, scaled: a state of a model with units of its own is in units of omega of 2**exponent,
    with `exponent` (n,). `evaluations` of the equations: for a series, one for each order of each
    step. `status` and `message` say why a motion ended before its time, if it did. `errors` holds
    the measured error of each variable.
    """

    case: Case
    method: str
    tol: float
    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    events: tuple[Occurrence, ...] = ()
    steps: int = 0
    evaluations: int = 0
    run_time: float = 0.0
    status: Status = Status.OK
    message: str = ""
    method_reason: str = "asked for"
    warnings: tuple[str, ...] = ()
    errors: Mapping[str, float] = field(default_factory=dict)
    error_kind: str = "none"

    @classmethod
    def failed(cls, case: Case, message: str) -> "Trajectory":
        """A case that could not be integrated: no samples."""
        state, tol = np.empty((0, len(case.system.equations.state))), case.tol or float("nan")
        time, exponent = np.empty(0), np.empty(0, dtype=np.int64)
        return cls(
            case, case.method, tol, time, state, exponent, status=Status.FAILED,
            message=message,
        )  # fmt: skip

    @property
    def succeeded(self) -> bool:
        """Whether the motion was not given up."""
        return self.status is Status.OK

    @property
    def error(self) -> float:
        """The largest measured error, or nan."""
        return max(self.errors.values(), default=float("nan"))

    @property
    def omega(self) -> np.ndarray:
        """The angular velocity (n, 3) of an oriented model, in units of 2**exponent."""
        return self.state[:, :3]

    @cached_property
    @np.errstate(over="ignore")  # `motion_remarks` says so
    def variables(self) -> dict[str, np.ndarray]:
        """The variables (n, ...) of its model by name, in double precision and true size."""
        system = self.case.system
        state = rescaled(system.equations, self.state.astype(float), self.exponent)
        return system.equations.output(self.time, state, attributes(system.constants))

    def with_remarks(self, **remarks: Any) -> "Trajectory":
        """The same motion with another message, other warnings or the case that was asked for."""
        motion = replace(self, **remarks)
        # Of a million samples the variables would take a tenth of the integration once more.
        vars(motion)["variables"] = self.variables
        return motion

    def at(self, rows: np.ndarray | slice) -> "Trajectory":
        """The same motion at some of its samples, with all events."""
        time, state, exponent = self.time[rows], self.state[rows], self.exponent[rows]
        return replace(self, time=time, state=state, exponent=exponent)


def distinct(numbers: Any) -> np.ndarray:
    """Numbers in ascending order, each once. Not by `np.unique`, which loads numpy's masked arrays:
    that takes as long as twenty motions."""
    ordered = np.sort(numbers)
    is_new = np.ones(len(ordered), dtype=bool)
    is_new[1:] = ordered[1:] != ordered[:-1]
    return np.asarray(ordered[is_new])


def even_times(case: Case, number: int) -> np.ndarray:
    """This many times, evenly spaced, from the start of a case to its end; fewer of a span that has
    no more doubles."""
    return distinct(np.linspace(case.time.start, case.time.end, number))


def sample_times(case: Case) -> np.ndarray:
    """The times (n,) at which a case is stored; a single sample is the end."""
    time = case.time
    if time.values:
        return np.array(time.values)
    few = time.samples == 1
    return np.array([time.end]) if few else np.linspace(time.start, time.end, time.samples)


@np.errstate(all="ignore")  # what overflows ends a motion, and its status says so
def solve(
    case: Case,
    method: str,
    precision: str = "double",
    tol: float | None = None,
    times: np.ndarray | None = None,
    reader: Reader | None = None,
) -> Trajectory:
    """The motion of a case by one method; the run time is the processor's, without imports and
    compilation.

    Raises HodoError if the method is not available here, or numbers of the case are out
    of range.
    """
    times = sample_times(case) if times is None else times
    # A case with such a method is refused when it is read; a comparison of methods may ask for one.
    if message := wrong_precision(method, precision) or finds_no_stop(method, case.system):
        raise HodoError(message)
    if method in ("exact", "quadrature") or case.system.is_quadrature:
        return closed_form(case, times, precision, method)
    return attempted(case, method, precision, tol, times, reader)


def with_seconds_left(case: Case, motion: Trajectory) -> Case:
    """A case with what a motion has left of its seconds."""
    if case.max_seconds is None:
        return case
    return replace(case, max_seconds=max(case.max_seconds - motion.run_time, math.ulp(0)))


def attempted(
    case: Case,
    method: str,
    precision: str,
    tol: float | None,
    times: np.ndarray,
    reader: Reader | None = None,
) -> Trajectory:
    """The motion of a case by a method that takes steps."""
    system = case.system
    engine = engines.engine_for(method, system, tol, precision, is_timed(system))
    # Both times from here on, since compiling and imports are paid once for all cases of a model: a
    # case must not run into its limit for being the first. `began` is of this thread's processor,
    # since the clock counts what else the machine does.
    began = thread_time()
    control = StepControl(case.max_steps or LAST_STEP[method], case.max_seconds or math.inf)
    try:
        samples = Propagation(engine, system, case.time.start, times, control, reader).run()
    except ArithmeticError as error:
        raise HodoError(f"{case.name}: its numbers exceed the range of doubles") from error
    return trajectory(case, method, engine.tol, samples, control, began)


def trajectory(
    case: Case,
    method: str,
    tol: float,
    samples: SampleBuffer,
    control: StepControl,
    began: float,
) -> Trajectory:
    """The motion that ends now: its known samples and what they cost since `began`."""
    spent, known = thread_time() - began, slice(samples.done)
    return Trajectory(
        case, method, tol,
        samples.time[known], samples.state[known], samples.exponent[known], tuple(samples.events),
        control.steps, control.evaluations, spent, control.status, control.message,
    )  # fmt: skip


def closed_form(case: Case, times: np.ndarray, precision: str, method: str) -> Trajectory:
    """The motion of a case from its closed form, or its quadrature, in double or extended
    precision.

    Raises HodoError if the case has none.
    """
    system, control = case.system, StepControl(max_seconds=case.max_seconds or math.inf)
    has_it = method == ("quadrature" if system.is_quadrature else "exact")
    if not (system.has_closed_form and has_it):
        raise HodoError(f"{case.name}: {NO_RATES if system.is_quadrature else NO_CLOSED_FORM}")
    began, fp = thread_time(), np.longdouble if precision == "extended" else np.float64
    samples = SampleBuffer.empty(times, len(system.equations.state), fp)
    # In blocks, for the memory: the closed form makes a dozen arrays of its times.
    while not samples.is_complete and control.has_time():
        block: np.ndarray = samples.time[samples.done :][:SAMPLES_AT_ONCE].astype(fp)
        elapsed = block - case.time.start
        samples.add(*system.exact_states(-elapsed if case.time.mirrored else elapsed))
    outgrown = samples.exponent > LARGEST_EXPONENT
    lost = (outgrown | ~np.isfinite(samples.state).all(axis=1))[: samples.done]
    if lost.any():
        samples.done = int(lost.argmax())
        message = f"{OVERFLOW_MESSAGE} at {case.time.text(times[samples.done])}"
        control.give_up(Status.FAILED, message)
    if end := system.exact_end(fp):
        kind, outcome = end
        time = case.time.start + outcome.time
        if time <= case.time.end:
            samples.events.append(Occurrence(kind, time, outcome.details or {}))
    return trajectory(case, method, float(np.finfo(fp).eps), samples, control, began)
