"""Case -> Solution: the motion of a case by one method."""

import math
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from .. import HodoError, engines
from ..cases.case import Case
from ..engines import exact
from ..engines.polynomial import TAYLOR
from ..engines.protocol import EPS, LAST_STEP, Engine, Status, StepControl
from ..models.base import Model
from ..models.constants import attributes
from .driver import LARGEST, OVERFLOW_MESSAGE, SAMPLES_AT_ONCE, Sampled, StepObserver, propagate
from .units import Clock, Units

REFINEMENTS, FEW = {"taylor": 5}, 2
"""How often what approximates equations is refined: it takes twice as long each time, and seconds
already by methods whose steps are taken in Python."""


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

    `case` is the one that was integrated: with `finer` data, where the motion needed them.
    `evaluations` of the equations: for a series, one for each order of each step.
    """

    case: Case
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


@dataclass
class AccuracyMonitor:
    """A `StepObserver` that checks at the start of each step whether what approximates the
    equations is right to a tolerance; `everywhere` tells whether it always was."""

    system: Model
    tol: float
    everywhere: bool = True

    def begin(self, engine: Engine, clock: Clock, units: Units) -> None:
        """See `StepObserver.begin`."""
        order = np.arange(engine.degree + 1)
        # At the start of a step only the first power is left, and polynomials of Legendre or
        # Chebyshev are 1 and -1 by turns.
        self.at_start = np.where(order, 0.0, 1.0) if engine.basis == TAYLOR else (-1.0) ** order

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        """See `Observer`."""
        state = engines.extended(series).astype(float) @ self.at_start
        k = attributes(self.system.constants)
        self.everywhere &= bool(self.system.is_accurate(state[:, np.newaxis], k, self.tol).all())

    def flush(self) -> None:
        """See `StepObserver.flush`."""


@np.errstate(all="ignore")  # what overflows ends a motion, and its status says so
def solve(
    case: Case,
    method: str,
    precision: str = "double",
    tol: float | None = None,
    times: np.ndarray | None = None,
    witness: StepObserver | None = None,
    refine: bool = True,
) -> Solution:
    """The motion of a case by one method; the run time excludes imports and compilation.

    With `refine`, what approximates the equations is refined until it meets the tolerance all along
    the motion. Raises HodoError if the method is not available here, or numbers of the case are out
    of range.
    """
    times = sample_times(case) if times is None else times
    if method == "exact":
        return closed_form(case, times, precision)
    solution, resolved = attempted(case, method, precision, tol, times, witness)
    for _ in range(REFINEMENTS.get(method, FEW) if refine else 0):
        if resolved or not solution.whole:
            break
        # As many steps as before, unless it is a singularity that ever finer data show the clearer.
        finer = refined(case, solution.case.system, max(100, 4 * solution.steps))
        better, resolved = attempted(finer, method, precision, tol, times, witness)
        if not better.whole:
            break
        solution = better
    return solution


def refined(case: Case, system: Model, limit: int | None = None) -> Case:
    """A case with the finer data of a system of its own, and so many steps at most."""
    limits = filter(None, (case.max_steps, limit))
    return replace(
        case, data={**case.data, **system.refined_data}, max_steps=min(limits, default=None)
    )


def attempted(
    case: Case,
    method: str,
    precision: str,
    tol: float | None,
    times: np.ndarray,
    witness: StepObserver | None,
) -> tuple[Solution, bool]:
    """The motion of a case as it is, and whether what approximates its equations met the
    tolerance."""
    system = case.system
    events = system.run_events
    # Before the engine, whose compilation counts towards max_seconds.
    watch = StepControl(case.max_steps or LAST_STEP[method], case.max_seconds or math.inf)
    engine = engines.engine_for(method, system, events, tol, precision)
    # From here on, since compiling and imports are paid once for all cases of a model.
    began = perf_counter()
    seen = AccuracyMonitor(system, max(engine.tol, EPS)) if system.refined_data else None
    try:
        path = propagate(engine, system, case.time.start, times, watch, witness or seen, events)
    except ArithmeticError as error:
        raise HodoError(f"{case.name}: its numbers lead beyond the range of doubles") from error
    spent = perf_counter() - began
    solution = Solution(
        case, path, engine.tol, watch.steps, spent, watch.status, watch.message, watch.evaluations
    )
    return solution, seen is None or seen.everywhere


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
    watch = StepControl(max_seconds=case.max_seconds or math.inf)
    began, fp = perf_counter(), np.longdouble if precision == "extended" else np.float64
    state, exponent = np.empty((len(times), 3), dtype=fp), np.empty(len(times), dtype=np.int64)
    # In blocks, for the memory: the closed form makes a dozen arrays of its times.
    for i in range(0, len(times), SAMPLES_AT_ONCE):
        if perf_counter() > watch.deadline:
            watch.give_up(Status.TIMEOUT, f"max_seconds: stopped after {case.max_seconds:g} s")
            times, state, exponent = times[:i], state[:i], exponent[:i]
            break
        here = slice(i, i + SAMPLES_AT_ONCE)
        state[here], exponent[here] = exact.exact_scaled(case, times[here].astype(fp))
    lost = np.flatnonzero((exponent > LARGEST) | ~np.isfinite(state).all(axis=1))
    n = int(lost[0]) if len(lost) else len(times)
    if len(lost):
        watch.give_up(Status.FAILED, f"{OVERFLOW_MESSAGE} at {times[n]:.6g}")
    path = Sampled(times[:n], state[:n], exponent[:n], ())
    spent = perf_counter() - began
    return Solution(case, path, float(np.finfo(fp).eps), 0, spent, watch.status, watch.message)


@np.errstate(over="ignore")  # `remarks` says so
def stored(case: Case, path: Sampled) -> dict[str, np.ndarray]:
    """The stored variables of a motion, in double precision and true size."""
    system, state = case.system, path.state.astype(float)
    output = system.output(path.time, state, attributes(system.constants))
    if system.degree:
        output = {name: np.ldexp(values, path.exponent[:, None]) for name, values in output.items()}
    return {name: values for name, values in output.items() if not case.store or name in case.store}
