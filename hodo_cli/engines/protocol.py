"""The protocol between the driver of integrations and the engines, each of which has a file."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from time import perf_counter
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..models.base import Constants

IVP = {"DOP853": 1e-12, "RK45": 1e-9, "LSODA": 1e-9, "Radau": 1e-9, "BDF": 1e-9}
"""SciPy's methods with their default tolerances."""

PRECISION = {
    "double": 2.0**-52,
    "extended": float(np.finfo(np.longdouble).eps),
    "quadruple": 2.0**-112,
}
"""The distance from 1 to the next number in each precision."""

EPS = PRECISION["double"]

LAST_STEP = {"taylor": 10_000_000, "collocation": 100_000} | dict.fromkeys(IVP, 1_000_000)
"""The number of steps after which a motion is given up unless its case says otherwise: heyoka takes
them in some 10 s, the methods in Python in one to two minutes."""

# An engine's control is absolute below 1. With a state between 1/8 and 8 it costs at most one
# digit, and a decay by e^-100 needs new units some 50 times.
NORM_BAND = (1 / 8, 8.0)
"""The bounds of the norm of a scaled state between which it needs no new units."""


class Coded(StrEnum):
    """Words that sweeps store as codes: their positions in the order in which they are listed."""

    @property
    def code(self) -> int:
        """The position of the word, from 0."""
        return list(type(self)).index(self)


class Status(Coded):
    """How a motion ended. Results store the values."""

    OK = "ok"
    FAILED = "failed"
    TIMEOUT = "timeout"
    INVALID = "invalid"
    """A member of a sweep whose data describe no body or no start."""
    UNDECIDED = "undecided"
    """A member of a sweep whose error hides its crossings; its motion is right."""


class Stretch(NamedTuple):
    """A part of a motion, integrated in fixed units: the states `rows` (points, m) at the grid
    points passed, and the time and the `state` (m,) at its end. `time` is a pair whose sum is the
    time reached."""

    rows: np.ndarray
    time: tuple[Any, Any]
    state: np.ndarray


Observer = Callable[[Any, Any, np.ndarray, np.ndarray], bool]
"""A function called after each step as observer(start, end, series, state), where the series are
the coefficients (m, degree + 1) of the state's polynomial in the `basis` of the engine, and the
state (m,) is that at the end; it returns whether the stretch goes on. An observer must copy both
arrays to keep them: heyoka writes those of the next step into the same memory."""


class Engine(Protocol):
    """A solver bound to one model's equations."""

    dtype: Any
    tol: float
    band: tuple[float, float]
    basis: str
    degree: int

    def integrate(
        self, k: Constants, y: np.ndarray, grid: np.ndarray, control: "StepControl"
    ) -> Stretch:
        """Integrate from the state `y` (m,) at grid[0] to grid[-1], or until `control` ends the
        stretch. State and grid are in the engine's units. A failure is recorded in `control`."""


SMALL_COMPONENT = 1e-9
"""The ratio to the largest component of a start below which the control of the error, which is
relative to the largest, does not see another component. A series of any precision then takes steps
in which the small component may grow by many powers of e."""


def uneven(y: np.ndarray) -> Any:
    """Whether states (m,) or (m, n) have a component that is not 0 but less than SMALL_COMPONENT of
    the largest: a bool, or (n,)."""
    size = np.abs(y)
    return ((size > 0) & (size < SMALL_COMPONENT * size.max(axis=0))).any(axis=0)


@dataclass
class StepControl:
    """Decides after each step whether to go on; `status` and `message` say why a motion was given
    up.

    With `band` = (low, high) it also ends the stretch, for new units, as soon as the norm of the
    state leaves the band. Only the `rows` that carry a unit count, if any are named.
    """

    max_steps: float = math.inf
    max_seconds: float = math.inf
    band: tuple[float, float] | None = None
    rows: np.ndarray | None = None
    observer: Observer | None = None
    longest: float = math.inf
    """The longest step that an engine may take in the stretch, in its units. With such a limit the
    stretch ends as soon as no component of the state is small any more."""
    steps: int = 0
    evaluations: int = 0
    status: Status = Status.OK
    message: str = ""

    def __post_init__(self) -> None:
        self.deadline = perf_counter() + self.max_seconds
        self._next_check = 1.0

    def step(self, y: np.ndarray) -> bool:
        """Count a step that ended in the state `y` (m,); returns whether the stretch goes on."""
        self.steps += 1
        if self.steps >= self._next_check and not self._goes_on():
            return False
        if self.rows is not None:
            y = y[self.rows]
        if self.longest < math.inf and not uneven(y.astype(float)):
            return False
        if self.band is None:
            return True
        # `math.hypot` of Python's numbers: numpy's scalars take ten times as long.
        return self.band[0] < math.hypot(*y.tolist()) < self.band[1]

    def _goes_on(self) -> bool:
        """Whether there are steps and seconds left. It is not asked at each step, because reading
        the clock takes about a tenth of a fast step."""
        if self.status is not Status.OK:  # an observer may have given up
            return False
        if self.steps >= self.max_steps:
            return self.give_up(
                Status.TIMEOUT,
                f"max_steps: stopped after {self.steps} steps; max_steps in the case allows more",
            )
        self._next_check = min(self.steps + 64, self.max_steps)
        return self.has_time()

    def has_time(self) -> bool:
        """Whether there are seconds left; gives the motion up if there are none."""
        if perf_counter() <= self.deadline:
            return True
        return self.give_up(Status.TIMEOUT, f"max_seconds: stopped after {self.max_seconds:g} s")

    def take_back(self, steps: int) -> None:
        """Go back to this number of steps. The steps since then belong to no motion, and how they
        ended is forgotten; the seconds and evaluations that they took count."""
        self.steps, self._next_check = steps, steps + 1.0
        self.status, self.message = Status.OK, ""

    def give_up(self, status: Status, message: str) -> bool:
        """Record that the motion ends here, and why; the first reason is kept. Returns False."""
        if self.status is Status.OK:
            self.status, self.message = status, message
        return False
