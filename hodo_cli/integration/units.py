"""Units that fit a motion at every moment, and the clock that runs in them."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..models.base import Constants, Model
from ..models.constants import flatten, namespace, structure


@dataclass(frozen=True)
class Units:
    """omega = 2**size W and s = 2**rate (t - origin).

    The series of an engine controls its error against max(1, |y|), so a motion far below 1 would be
    right only absolutely. With W near 1, and a unit of time in which nothing is faster than 1, it
    is right relatively at every scale. Powers of two make the change of units exact.
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
        sizes += [
            math.ceil((log - lightest) / 2) for name, log in logs.items() if model.degree[name] == 0
        ]
        new = max(sizes, default=0)
        rates = [
            log - lightest + (model.degree[name] - 1) * new
            for name, log in logs.items()
            if name != "g"
        ]
        most = cls(new, math.ceil(max([float(new), *rates])))
        return cls(
            new, most.rate + max(-1000, math.frexp(most.pace(model, k, np.ldexp(y, size - new)))[1])
        )

    def pace(self, model: type[Model], k: Constants, y: np.ndarray) -> float:
        """How fast the motion at a state y in these units, and its derivative, change; 0 where they
        do not.

        A steady rotation about an axis is not fast however large it is. A series in a unit of time
        that is 1e15 times too short has coefficients of 0.
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
        return np.concatenate(
            ([self.high * 0], ((times - self.high) - self.low) * type(self.high)(self.factor))
        )

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
    """The clock of a model without units of its own, whose equations may contain the time
    itself."""

    def grid(self, times: np.ndarray) -> np.ndarray:
        return np.concatenate(([self.high], times))

    def true(self, s: Any) -> float:
        return float(s)

    def advance(self, elapsed: tuple[Any, Any]) -> None:
        self.high = elapsed[0]
