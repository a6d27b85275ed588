"""Case -> Trajectory: the units in which a motion is integrated, the choice of engine, the measured error."""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from . import HodoError, engines, exact
from .case import Case
from .engines import Engine, Hit, Watch, flatten, jacobian, namespace, structure
from .models import find
from .models.base import Constants, Event, Model
from .trajectory import Occurrence, Trajectory

BLOCK = 1 << 16
"""Samples handed to an engine at once."""

ASKED = 1e-12
"""The error that a motion may have whose tolerance is at the limit of its precision."""

MANY_STEPS = 1e4
"""Beyond this many Taylor steps, some 10 ms, collocation is the faster one."""

RATIO, MOST_TRIED, ROUGH = 200, 5000, 1e-4
"""The cost of a step of collocation in Taylor steps; the most steps, and the tolerance, of a trial of it."""

LIMIT = 2**12
"""Binary orders of magnitude below 1 at which a motion is called at rest: 1e-1233, far below the smallest double."""

LARGEST, OUTGROWN = 1024, "the motion has outgrown the largest number"
"""The binary order of magnitude of the largest double, and what is said of a motion beyond it."""

COMPARED = 100_000
"""About how many samples, evenly spaced, an error is measured at."""

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
        most = cls(new, math.ceil(max([float(new), *rates])))
        return cls(new, most.rate + max(-1000, math.frexp(most.pace(model, k, np.ldexp(y, size - new)))[1]))

    def pace(self, model: type[Model], k: Constants, y: np.ndarray) -> float:
        """How fast the motion at a state y in these units, and its derivative, change; 0 where they do not.

        A steady rotation about an axis is not fast however large it is. A series in a unit of time that is 1e15 times
        too short has coefficients of 0.
        """
        scaled = namespace(structure(k), flatten(self.constants(model, k)))
        rate = np.array(model.rhs(0.0, [*y], scaled))
        speed = float(np.abs(rate).max())
        if not speed:
            return 0.0
        turn = np.array(model.rhs(0.0, [*(y + 1e-100j * (rate / speed))], scaled)).imag / 1e-100
        return max(speed, float(np.abs(turn).max()))

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
    watch.band = engine.band if model.degree and any(y0) and not forced else None

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
        grid = clock.grid(times[done : done + BLOCK].astype(fp))
        if not math.isfinite(float(grid[-1])):
            raise OverflowError
        leg = engine.leg(units.constants(model, k), y, grid, watch)
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
        if new.size < -LIMIT:
            rows[done:], exponent[done:], done = 0, -LIMIT, len(times)
        elif new.size > LARGEST:
            watch.give_up("failed", f"{OUTGROWN} at {clock.true(fp(0)):.6g}")
        y, units = leg.state * fp(2.0 ** (units.size - new.size)), new
    return Path(times[:done], rows[:done], exponent[:done], tuple(found))


def sample_times(case: Case) -> np.ndarray:
    """The times (n,) at which a case is stored; a single sample is the end."""
    time = case.time
    return np.array([time.end]) if time.samples == 1 else np.linspace(time.start, time.end, time.samples)


@dataclass(frozen=True)
class Solution:
    """A motion with what its integration cost; `stop` is "" or the reason why it ended before its time.

    `evaluations` of the equations: for a series, one for each order of each step.
    """

    path: Path
    tol: float
    steps: int
    run_time: float
    stop: str = ""
    message: str = ""
    evaluations: int = 0


@np.errstate(all="ignore")  # what overflows ends a motion, and its status says so
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

    Raises HodoError if the method cannot be had here, or numbers of the case are out of range.
    """
    model = find(case.model, case.form)
    times = sample_times(case) if times is None else times
    if method == "exact":
        return closed_form(case, times, precision)
    k, events = model.constants(case.data), model.run_events(case.data) if events is None else events
    engine = engines.build(method, model, k, events, tol, precision)
    watch = Watch(case.max_steps or math.inf, case.max_seconds or math.inf)
    began = perf_counter()
    try:
        path = propagate(engine, model, k, model.start(case.data), case.time.start, times, watch, witness, events)
    except ArithmeticError as error:
        raise HodoError(f"{case.name}: its numbers lead beyond the range of doubles") from error
    spent = perf_counter() - began
    return Solution(path, engine.tol, watch.steps, spent, watch.outcome, watch.message, watch.evaluations)


def closed_form(case: Case, times: np.ndarray, precision: str = "double") -> Solution:
    """The motion of a case from its closed form, in double or extended precision.

    Raises HodoError if the case has none, or for another precision.
    """
    if not exact.applies(case):
        raise HodoError(f"{case.name}: method exact needs linear-diag with three equal coefficients of damping")
    if precision == "quadruple":
        raise HodoError(f"{case.name}: method exact works in double and extended precision only")
    began, fp = perf_counter(), np.longdouble if precision == "extended" else np.float64
    state, exponent = np.empty((len(times), 3), dtype=fp), np.empty(len(times), dtype=np.int64)
    for i in range(0, len(times), BLOCK):
        here = slice(i, i + BLOCK)
        state[here], exponent[here] = exact.solve_scaled(case, times[here].astype(fp))
    lost = np.flatnonzero((exponent > LARGEST) | ~np.isfinite(state).all(axis=1))
    n = int(lost[0]) if len(lost) else len(times)
    stop = ("failed", f"{OUTGROWN} at {times[n]:.6g}") if len(lost) else ("", "")
    path = Path(times[:n], state[:n], exponent[:n], ())
    return Solution(path, float(np.finfo(fp).eps), 0, perf_counter() - began, *stop)


def integrate(case: Case) -> Trajectory:
    """Integrate a case by its method and measure its error.

    Raises HodoError if its method cannot be had here. A case that stops early comes back with status
    `timeout` or `failed` and the samples it reached.
    """
    method, reason, solution = tried(case)
    errors, kind = measure(case, method, solution) if case.error == "on" else ({}, "none")
    warnings = find(case.model, case.form).warnings(case.data)
    path, variables = solution.path, stored(case, solution.path)
    warnings += remarks(case, solution, variables, errors)
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
        status=solution.stop or "ok",
        message=solution.message,
        warnings=tuple(warnings),
        events=path.events,
        errors=errors,
        error_kind=kind,
    )


def remarks(
    case: Case, solution: Solution, variables: dict[str, np.ndarray], errors: dict[str, float]
) -> Iterator[str]:
    """What a result does not show by itself: an error larger than was asked for, or unknown, and infinite values."""
    asked, worst = max(solution.tol, ASKED), max(errors.values(), default=math.nan)
    if worst > 10 * asked:
        yield f"the measured error {worst:.1e} exceeds ten times the {asked:.0e} asked for"
    if case.error == "on" and math.isnan(worst):
        yield "the error could not be measured"
    for name, values in variables.items():
        if not np.isfinite(values).all():
            yield f"{name} is stored as infinite or not a number where it has outgrown the largest double"


def tried(case: Case) -> tuple[str, str, Solution]:
    """Method, reason and solution of a case: by collocation where `auto` has taken the series and that fails."""
    method, reason = choose(case)
    solution = solve(case, method, case.precision, case.tol)
    if case.method == "auto" and method == "taylor" and solution.stop == "failed" and case.precision != "quadruple":
        other = solve(case, "collocation", case.precision, case.tol)
        if not other.stop:
            return "collocation", f"the Taylor series failed: {solution.message}", other
    return method, reason, solution


def choose(case: Case) -> tuple[str, str]:
    """The method for a case and, in words, why."""
    return best(case, case.precision) if case.method == "auto" else (case.method, "asked for")


@np.errstate(all="ignore")
def best(case: Case, precision: str) -> tuple[str, str]:
    """The fastest method that is right to the last digits in a precision, and why.

    In quadruple precision only the Taylor series is to be had.
    """
    if precision == "quadruple":
        return "taylor", "quadruple precision"
    if exact.applies(case):
        return "exact", "closed form"
    if not engines.have_taylor():
        return "collocation", "heyoka is not installed"
    with suppress(ArithmeticError, HodoError):  # numbers out of range, as `solve` will say
        if (steps := taylor_steps(case)) > MANY_STEPS:
            times = np.linspace(case.time.start, case.time.end, 17)[1:]
            most = replace(case, max_steps=int(min(steps / RATIO, MOST_TRIED)), max_seconds=None)
            trial = solve(most, "collocation", tol=ROUGH, times=times)
            if not trial.stop and (steps := taylor_steps(case, trial.path)) > max(MANY_STEPS, RATIO * trial.steps):
                why = f"stiff: {trial.steps} steps in a trial, where a Taylor series needs some {steps:.0e}"
                return "collocation", why
    return "taylor", "not stiff"


def taylor_steps(case: Case, path: Path | None = None) -> float:
    """About how many Taylor steps a case takes if it is all the time as fast as at the start, or as on a path."""
    model = find(case.model, case.form)
    k, rates = model.constants(case.data), []
    if path is None:
        path = Path(np.array([case.time.end]), np.array([model.start(case.data)]), np.array([0]), ())
    for t, state, exponent in zip(path.time.tolist(), path.state.astype(float), path.exponent.tolist(), strict=True):
        units = Units.fit(model, k, state, exponent)
        constants = namespace(structure(k), flatten(units.constants(model, k)))
        slopes = jacobian(model, constants, t, np.ldexp(state, exponent - units.size))
        rates.append(math.ldexp(float(np.abs(slopes).sum(axis=1).max()), units.rate) if state.any() else 0.0)
    return float(np.mean(rates) * (path.time[-1] - case.time.start)) / 8


@np.errstate(over="ignore")  # `remarks` says so
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

    It is the largest over the samples, or over some COMPARED of them where there are more.
    """
    terminal = any(event.terminal for event in find(case.model, case.form).run_events(case.data))
    path, times = solution.path, solution.path.time
    if terminal and not solution.stop:
        times = sample_times(case)
    for precision, reference_method, tol in references(case, method, solution.tol):
        reference = solve(case, reference_method, precision, tol, times[thinned(times)])
        if tol is not None and reference.tol == solution.tol:
            continue
        if not reference.stop or solution.stop:
            kind = "refined" if tol is not None else "exact" if reference_method == "exact" else precision
            rows = thinned(path.time)
            thin = Path(path.time[rows], path.state[rows], path.exponent[rows], path.events)
            return difference(case, thin, reference.path), kind
    return {}, "none"


def thinned(times: np.ndarray) -> np.ndarray:
    """The positions of evenly spaced samples, and of the last one."""
    return np.unique(np.r_[0 : len(times) : -(-len(times) // COMPARED) or 1, max(len(times) - 1, 0) : len(times)])


def references(case: Case, method: str, tol: float) -> Iterator[tuple[str, str, float | None]]:
    """Precision, method and tolerance of the computations against which an error can be measured, best first.

    That is what `auto` takes, in the next precision; where that cannot be had or gives up, the same method at a
    hundredth of the tolerance, or where it is at its limit already, so that nothing changes, at a hundred times it.
    """
    finer = {"double": "extended" if EXTENDED else "quadruple", "extended": "quadruple"}.get(case.precision)
    if finer:
        better, _ = best(case, finer)
        if better != "taylor" or engines.have_taylor():
            yield finer, better, None
    if method != "exact":
        yield case.precision, method, tol / 100
        yield case.precision, method, tol * 100


def difference(case: Case, path: Path, reference: Path) -> dict[str, float]:
    """The error of each stored variable, the largest over the samples that both motions have.

    A vector is judged sample by sample, relative to its length; a scalar relative to its largest value; the
    time of a terminal event relative to the time since the start. A motion at rest (LIMIT) has no error. Quadruple
    motions are compared in long double, and no error of theirs is called smaller than that resolves.
    """
    model = find(case.model, case.form)
    n = min(len(path.time), len(reference.time))
    errors: dict[str, float] = {}
    if n and path.time[n - 1] != reference.time[n - 1]:
        end = float(reference.time[-1])
        errors["time"] = abs(path.time[-1] - end) / max(end - case.time.start, math.ulp(end))
    rows = np.r_[0 : n - 1, -1] if errors else np.arange(n)
    constants = model.constants(case.data)
    k = namespace(structure(constants), list(np.array(flatten(constants), dtype=np.longdouble)))
    ours = model.output(path.time[rows], extended(path.state)[rows], k)
    theirs = model.output(reference.time[rows], extended(reference.state)[rows], k)
    sizes = path.exponent[rows], reference.exponent[rows]
    shift = (sizes[0] - sizes[1])[:, None]
    # One of the two may be called at rest a step before the other.
    resting = (np.minimum(*sizes) <= -LIMIT) & (np.maximum(*sizes) < -LIMIT / 2)
    for name, variable in model.variables.items():
        if case.store and name not in case.store:
            continue
        a, b = ours[name], theirs[name]
        if "axis" in variable.dims:
            off = np.sqrt(np.square(np.ldexp(a, shift) - b if model.degree else a - b).sum(axis=-1))
            off[resting] = 0
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
