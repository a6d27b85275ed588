"""Case -> Solution: the choice of method, and the motion of a case by it."""

import math
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from .. import HodoError, engines
from ..cases.case import Case
from ..engines import exact
from ..engines.protocol import LAST_STEP, Status, Watch
from ..models.constants import attributes
from ..progress import reached
from .driver import LARGEST, OUTGROWN, SAMPLES_AT_ONCE, Sampled, Witness, propagate


def sample_times(case: Case) -> np.ndarray:
    """The times (n,) at which a case is stored; a single sample is the end."""
    time = case.time
    return (
        np.array([time.end])
        if time.samples == 1
        else np.linspace(time.start, time.end, time.samples)
    )


@dataclass(frozen=True)
class Solution:
    """A motion with what its integration cost; `status` and `message` say why it ended before its
    time, if it did.

    `evaluations` of the equations: for a series, one for each order of each step.
    """

    path: Sampled
    tol: float
    steps: int
    run_time: float
    status: Status = Status.OK
    message: str = ""
    evaluations: int = 0

    @property
    def whole(self) -> bool:
        """Whether the motion was not given up."""
        return self.status is Status.OK


@np.errstate(all="ignore")  # what overflows ends a motion, and its status says so
def solve(
    case: Case,
    method: str,
    precision: str = "double",
    tol: float | None = None,
    times: np.ndarray | None = None,
    witness: Witness | None = None,
) -> Solution:
    """The motion of a case by one method; the run time excludes imports and compilation.

    Raises HodoError if the method is not available here, or numbers of the case are out of range.
    """
    system, times = case.system, sample_times(case) if times is None else times
    if method == "exact":
        return closed_form(case, times, precision)
    events = system.run_events
    engine = engines.engine_for(method, system, events, tol, precision)
    watch = Watch(case.max_steps or LAST_STEP[method], case.max_seconds or math.inf)
    # From here on, since compiling and imports are paid once for all cases of a model.
    began = perf_counter()
    try:
        path = propagate(engine, system, case.time.start, times, watch, witness, events)
    except ArithmeticError as error:
        raise HodoError(f"{case.name}: its numbers lead beyond the range of doubles") from error
    spent = perf_counter() - began
    return Solution(
        path, engine.tol, watch.steps, spent, watch.status, watch.message, watch.evaluations
    )


def closed_form(case: Case, times: np.ndarray, precision: str = "double") -> Solution:
    """The motion of a case from its closed form, in double or extended precision.

    Raises HodoError if the case has none, or for another precision.
    """
    if not exact.applies(case):
        raise HodoError(
            f"{case.name}: method exact needs linear-diag with three equal coefficients of damping"
        )
    if precision == "quadruple":
        raise HodoError(f"{case.name}: method exact works in double and extended precision only")
    watch = Watch(max_seconds=case.max_seconds or math.inf)
    began, fp = perf_counter(), np.longdouble if precision == "extended" else np.float64
    state, exponent = np.empty((len(times), 3), dtype=fp), np.empty(len(times), dtype=np.int64)
    # In blocks, for the memory: the closed form makes a dozen arrays of its times.
    for i in range(0, len(times), SAMPLES_AT_ONCE):
        if perf_counter() > watch.deadline:
            watch.give_up(Status.TIMEOUT, f"max_seconds: stopped after {case.max_seconds:g} s")
            times, state, exponent = times[:i], state[:i], exponent[:i]
            break
        reached(i / len(times))
        here = slice(i, i + SAMPLES_AT_ONCE)
        state[here], exponent[here] = exact.exact_scaled(case, times[here].astype(fp))
    lost = np.flatnonzero((exponent > LARGEST) | ~np.isfinite(state).all(axis=1))
    n = int(lost[0]) if len(lost) else len(times)
    if len(lost):
        watch.give_up(Status.FAILED, f"{OUTGROWN} at {times[n]:.6g}")
    path = Sampled(times[:n], state[:n], exponent[:n], ())
    spent = perf_counter() - began
    return Solution(path, float(np.finfo(fp).eps), 0, spent, watch.status, watch.message)


@np.errstate(over="ignore")  # `remarks` says so
def stored(case: Case, path: Sampled) -> dict[str, np.ndarray]:
    """The stored variables of a motion, in double precision and true size."""
    system, state = case.system, path.state.astype(float)
    output = system.output(path.time, state, attributes(system.constants))
    if system.degree:
        output = {name: np.ldexp(values, path.exponent[:, None]) for name, values in output.items()}
    return {name: values for name, values in output.items() if not case.store or name in case.store}
