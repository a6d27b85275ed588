"""Case -> Trajectory: the units in which a motion is integrated, the choice of engine, the measured error."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from . import HodoError, engines
from .case import Case
from .engines import Engine, Hit, Watch, flatten, jacobian, namespace, structure
from .models import find
from .models.base import Constants, Event, Model
from .trajectory import Occurrence, Trajectory

BAND = (1 / 64, 64.0)
"""The squared norm of a scaled state that needs no new units."""

BLOCK = 1 << 16
"""Samples handed to an engine at once."""

ASKED = 1e-12
"""The error that a motion may have whose tolerance is at the limit of its precision."""

MANY_STEPS = 1e5
"""Beyond this many Taylor steps another method is sought."""

REFERENCE_STEPS = 1e6
"""The most Taylor steps that the measuring of an error may take."""

RESOLUTION = {"double": 0.0, "extended": 0.0, "quadruple": float(np.finfo(np.longdouble).eps)}

EXTENDED = np.finfo(np.longdouble).eps < 1e-18
"""Whether long double is more precise than double here."""


@dataclass(frozen=True)
class Units:
    """omega = 2**size W and s = 2**rate (t - origin).

    The series of an engine controls its error against max(1, |y|), so a motion far below 1 would be right
    only absolutely. With W near 1, and a unit of time in which nothing is faster than 1, it is right
    relatively at every scale. Powers of two make the change of units exact.
    """

    size: int = 0
    rate: int = 0

    @classmethod
    def fit(cls, model: type[Model], k: Constants, y: np.ndarray, size: int = 0) -> "Units":
        """The units for a model at the state `y`, itself in units of 2**size."""
        if not model.degree:
            return cls()
        logs = {name: math.log2(abs(number(k, name))) for name in model.degree if k[name]}
        lightest = math.log2(min(number(k, name) for name in ("A1", "A2", "A3")))
        largest = float(np.max(np.abs(y)))
        sizes = [size + math.frexp(largest)[1]] if largest else []
        sizes += [math.ceil((log - lightest) / 2) for name, log in logs.items() if model.degree[name] == 0]
        new = max(sizes, default=0)
        rates = [log - lightest + (model.degree[name] - 1) * new for name, log in logs.items() if name != "g"]
        return cls(new, math.ceil(max([float(new), *rates])))

    def constants(self, model: type[Model], k: Constants) -> Constants:
        """The constants of the equations in these units."""
        return {**k} | {
            name: math.ldexp(number(k, name), (degree - 1) * self.size - self.rate)
            for name, degree in model.degree.items()
        }


def number(k: Constants, name: str) -> float:
    """A constant that is a plain number."""
    value = k[name]
    assert isinstance(value, float), f"{name} must be a number to have a degree"
    return value


class Path(NamedTuple):
    """A motion at the times passed: state (n, m) in units of 2**exponent (n,), and the events met."""

    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    events: tuple[Occurrence, ...]


class Step(NamedTuple):
    """One step as a witness sees it; `at` turns the engine's time into the true one."""

    start: Any
    end: Any
    at: Callable[[Any], float]
    units: Units
    dense: Callable[[Any], np.ndarray]
    hits: list[Hit]


@dataclass
class Clock:
    """The time reached and the leg's unit of time.

    The time is a sum of two numbers, so that many changes of units cost it no digits.
    """

    high: Any
    low: Any
    factor: float = 1.0

    def grid(self, times: np.ndarray) -> np.ndarray:
        """The present, then `times`, in the leg's units."""
        return np.concatenate(([self.high * 0], ((times - self.high) - self.low) * type(self.high)(self.factor)))

    def true(self, s: Any) -> float:
        """The true time of a moment of the leg."""
        return float(self.high + (self.low + s / type(self.high)(self.factor)))

    def advance(self, elapsed: tuple[Any, Any]) -> None:
        """Move on by a time in the leg's units."""
        for part in elapsed:
            step = part / type(self.high)(self.factor)
            total = self.high + step
            carried = total - self.high
            self.low += (self.high - (total - carried)) + (step - carried)
            self.high = total


class Calendar(Clock):
    """The clock of a model without units of its own, whose equations may contain the time itself."""

    def grid(self, times: np.ndarray) -> np.ndarray:
        return np.concatenate(([self.high], times))

    def true(self, s: Any) -> float:
        return float(s)

    def advance(self, elapsed: tuple[Any, Any]) -> None:
        self.high = elapsed[0]


def propagate(
    engine: Engine,
    model: type[Model],
    k: Constants,
    y0: tuple[float, ...],
    start: float,
    times: np.ndarray,
    watch: Watch,
    witness: Callable[[Step], None] | None = None,
    events: tuple[Event, ...] = (),
) -> Path:
    """Integrate from `y0` at `start` through `times`, changing units whenever the motion has outgrown them.

    Ends early at a terminal event, whose time and state are then the last ones, or when `watch` says so.
    """
    fp = engine.dtype
    units = Units.fit(model, k, np.array(y0))
    y = np.array([math.ldexp(value, -units.size) for value in y0]).astype(fp)
    clock = (Clock if model.degree else Calendar)(fp(start), fp(0))
    rows, exponent = np.empty((len(times), len(y0)), dtype=fp), np.full(len(times), units.size)
    done = int(np.searchsorted(times, start, side="right"))
    rows[:done] = y
    found: list[Occurrence] = []
    forced = any(k[name] for name, degree in model.degree.items() if degree == 0)
    watch.band = BAND if model.degree and any(y0) and not forced else None

    def observe(start: Any, end: Any, dense: Callable[[Any], np.ndarray], hits: list[Hit]) -> None:
        if witness is not None:
            witness(Step(start, end, clock.true, units, dense, hits))
        found.extend(occurrence(hit) for hit in hits if not events[hit.event].terminal)

    def occurrence(hit: Hit) -> Occurrence:
        state = tuple(float(value) for value in hit.state)
        return Occurrence(events[hit.event].kind, clock.true(hit.time), hit.direction, state, units.size)

    watch.observer = observe if events else None
    while done < len(times) and watch.stop in ("", "units"):
        watch.stop = ""
        clock.factor = math.ldexp(1.0, units.rate)
        leg = engine.leg(units.constants(model, k), y, clock.grid(times[done : done + BLOCK].astype(fp)), watch)
        passed = len(leg.rows) - 1
        rows[done : done + passed], exponent[done : done + passed] = leg.rows[1:], units.size
        done += passed
        if leg.hit is not None:
            end = occurrence(leg.hit)
            return Path(
                np.append(times[:done], end.time),
                np.concatenate((rows[:done], leg.hit.state[None])),
                np.append(exponent[:done], units.size),
                (*found, end),
            )
        clock.advance(leg.time)
        new = Units.fit(model, k, leg.state.astype(float), units.size)
        y, units = leg.state * fp(2.0 ** (units.size - new.size)), new
    return Path(times[:done], rows[:done], exponent[:done], tuple(found))


def sample_times(case: Case) -> np.ndarray:
    """The times (n,) at which a case is stored; a single sample is the end."""
    time = case.time
    return np.array([time.end]) if time.samples == 1 else np.linspace(time.start, time.end, time.samples)


@dataclass(frozen=True)
class Solution:
    """A motion with what its integration cost; `stop` is "" or the reason why it ended before its time."""

    path: Path
    tol: float
    steps: int
    run_time: float
    stop: str = ""
    message: str = ""


def solve(
    case: Case,
    method: str,
    precision: str = "double",
    tol: float | None = None,
    times: np.ndarray | None = None,
    events: tuple[Event, ...] | None = None,
    witness: Callable[[Step], None] | None = None,
) -> Solution:
    """The motion of a case by one method; the run time excludes imports and compilation.

    Raises HodoError if the method cannot be had here.
    """
    model = find(case.model, case.form)
    times = sample_times(case) if times is None else times
    if method == "exact":
        return closed_form(case, times)
    k, events = model.constants(case.data), model.run_events(case.data) if events is None else events
    engine = engines.build(method, model, k, events, tol, precision)
    watch = Watch(case.max_steps or math.inf, case.max_seconds or math.inf)
    began = perf_counter()
    path = propagate(engine, model, k, model.start(case.data), case.time.start, times, watch, witness, events)
    return Solution(path, engine.tol, watch.steps, perf_counter() - began, watch.outcome, watch.message)


def closed_form(case: Case, times: np.ndarray) -> Solution:
    """The motion of a case from its closed form.

    Raises HodoError if the case has none.
    """
    from . import exact

    if not exact.applies(case):
        raise HodoError(f"{case.name}: method exact needs linear-diag with three equal coefficients of damping")
    began = perf_counter()
    path = Path(times, *exact.solve_scaled(case, times), ())
    return Solution(path, 2.0**-52, 0, perf_counter() - began)


def integrate(case: Case) -> Trajectory:
    """Integrate a case by its method and measure its error.

    Raises HodoError if its method cannot be had here. A case that stops early comes back with status
    `timeout` or `failed` and the samples it reached.
    """
    method, reason = choose(case)
    solution = solve(case, method, case.precision, case.tol)
    errors, kind = measure(case, method, solution) if case.error == "on" else ({}, "none")
    warnings = find(case.model, case.form).warnings(case.data)
    asked = max(solution.tol, ASKED)
    if errors and not max(errors.values()) <= 10 * asked:
        warnings.append(f"the measured error {max(errors.values()):.1e} exceeds ten times the {asked:.0e} asked for")
    path = solution.path
    return Trajectory(
        case=case,
        time=path.time,
        state=path.state,
        exponent=path.exponent,
        variables=stored(case, path),
        method=method,
        method_reason=reason,
        tol=solution.tol,
        steps=solution.steps,
        run_time=solution.run_time,
        status=solution.stop or "ok",
        message=solution.message,
        warnings=tuple(warnings),
        events=path.events,
        errors=errors,
        error_kind=kind,
    )


def choose(case: Case) -> tuple[str, str]:
    """The method for a case and, in words, why."""
    if case.method != "auto":
        return case.method, "asked for"
    decay, turning = stiffness(case)
    if decay > MANY_STEPS:
        return "Radau", f"stiff: a Taylor series would need some {decay:.0e} steps"
    if turning > MANY_STEPS and case.model == "linear-diag":
        from . import exact

        if exact.applies(case):
            return "exact", f"closed form: a Taylor series would need some {turning:.0e} steps"
    if not engines.have_taylor():
        return "DOP853", "heyoka is not installed"
    return "taylor", "not stiff"


def stiffness(case: Case) -> tuple[float, float]:
    """About how many Taylor steps a case takes: on account of its decay, and of all that moves in it."""
    model = find(case.model, case.form)
    k, y0 = model.constants(case.data), model.start(case.data)
    units = Units.fit(model, k, np.array(y0))
    y = np.array([math.ldexp(value, -units.size) for value in y0])
    constants = namespace(structure(k), flatten(units.constants(model, k)))
    values = np.linalg.eigvals(jacobian(model, constants, case.time.start, y))
    span = (case.time.end - case.time.start) * math.ldexp(1.0, units.rate)
    return span * max(0.0, -values.real.min()) / 8.8, span * float(np.abs(values).max()) / 2


def stored(case: Case, path: Path) -> dict[str, np.ndarray]:
    """The stored variables of a motion, in double precision and true size."""
    model = find(case.model, case.form)
    k = namespace(structure(constants := model.constants(case.data)), flatten(constants))
    output = model.output(path.time, path.state.astype(float), k)
    if model.degree:
        output = {name: np.ldexp(values, path.exponent[:, None]) for name, values in output.items()}
    return {name: values for name, values in output.items() if not case.store or name in case.store}


def measure(case: Case, method: str, solution: Solution) -> tuple[dict[str, float], str]:
    """The error of each stored variable against a better computation, and what that was.

    The reference is the Taylor series in the next precision; where that cannot be had or gives up, the same
    method at a hundredth of the tolerance.
    """
    times = solution.path.time
    terminal = any(event.terminal for event in find(case.model, case.form).run_events(case.data))
    for precision, reference_method, tol in references(case, method, solution.tol):
        reference = solve(case, reference_method, precision, tol, None if terminal else times)
        if not reference.stop or solution.stop:
            kind = "refined" if tol is not None else precision
            return difference(case, solution.path, reference.path), kind
    return {}, "none"


def references(case: Case, method: str, tol: float) -> Iterator[tuple[str, str, float | None]]:
    """Precision, method and tolerance of the computations against which an error can be measured, best first."""
    finer = {"double": "extended" if EXTENDED else "quadruple", "extended": "quadruple"}
    if engines.have_taylor() and max(stiffness(case)) < REFERENCE_STEPS and case.precision in finer:
        yield finer[case.precision], "taylor", None
    if method != "exact":
        yield case.precision, method, tol / 100


def difference(case: Case, path: Path, reference: Path) -> dict[str, float]:
    """The error of each stored variable, the largest over the samples that both motions have.

    A vector is judged sample by sample, relative to its length; a scalar relative to its largest value; the
    time of a terminal event relative to itself. Quadruple motions are compared in long double, and no error of
    theirs is called smaller than that resolves.
    """
    model = find(case.model, case.form)
    n = min(len(path.time), len(reference.time))
    errors: dict[str, float] = {}
    if n and path.time[n - 1] != reference.time[n - 1]:
        errors["time"] = abs(path.time[-1] - reference.time[-1]) / abs(reference.time[-1])
    rows = np.r_[0 : n - 1, -1] if errors else np.arange(n)
    constants = model.constants(case.data)
    k = namespace(structure(constants), list(np.array(flatten(constants), dtype=np.longdouble)))
    ours = model.output(path.time[rows], extended(path.state)[rows], k)
    theirs = model.output(reference.time[rows], extended(reference.state)[rows], k)
    shift = (path.exponent[rows] - reference.exponent[rows])[:, None]
    for name, variable in model.variables.items():
        if case.store and name not in case.store:
            continue
        a, b = ours[name], theirs[name]
        if "axis" in variable.dims:
            off = np.sqrt(np.square(np.ldexp(a, shift) - b if model.degree else a - b).sum(axis=-1))
            scale = np.sqrt(np.square(b).sum(axis=-1))
        else:
            off, scale = np.abs(a - b), np.max(np.abs(b), initial=0)
        relative = np.divide(off, scale, out=off.copy(), where=scale > 0)
        errors[name] = max(float(np.max(relative, initial=0)), RESOLUTION[case.precision])
    return errors


def extended(values: np.ndarray) -> np.ndarray:
    """Values of any precision as long doubles."""
    if values.dtype.type in (np.float64, np.longdouble):
        return values.astype(np.longdouble)
    from .engines import taylor

    return taylor.longdouble(values)
