"""The driver of the engines: from a start through the sample times, in units that fit the motion at every moment."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .engines.protocol import Engine, Hit, Watch
from .models.base import Constants, Event, Model
from .models.constants import flatten, namespace, structure
from .trajectory import Occurrence

BLOCK = 1 << 16
"""Samples handed to an engine at once."""

LIMIT = 2**12
"""Binary orders of magnitude below 1 at which a motion is called at rest: 1e-1233, far below the smallest double."""

LARGEST, OUTGROWN = 1024, "the motion has outgrown the largest number"
"""The binary order of magnitude of the largest double, and what is said of a motion beyond it."""


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
