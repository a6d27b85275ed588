"""The protocol between the driver and the engines, which have a file each."""

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
"""Steps after which a motion is given up unless its case says otherwise: some 10 s of heyoka's, one
to two minutes of those taken in Python."""

# A state between 1/8 and 8: an engine's control, absolute below 1, then costs a digit at most, and
# a decay by e^-100 meets new units some 50 times.
NORM_BAND = (1 / 8, 8.0)
"""The norm of a scaled state that needs no new units."""


class Coded(StrEnum):
    """Words, which sweeps store by their places in the order in which they are listed."""

    @property
    def code(self) -> int:
        """Its place."""
        return list(type(self)).index(self)


class Status(Coded):
    """How a motion ended; the values are what is stored."""

    OK = "ok"
    FAILED = "failed"
    TIMEOUT = "timeout"
    INVALID = "invalid"
    """Of a member of a sweep that is no body, or has no start."""
    UNDECIDED = "undecided"
    """Of a member of a sweep whose crossings its error hides; its motion is right."""


class EventRoot(NamedTuple):
    """A zero of an event's function: its place in the list of events, time and state."""

    event: int
    time: float
    state: np.ndarray


class Stretch(NamedTuple):
    """A part of a motion, integrated in fixed units: the states at the grid points passed, and
    where it ended.

    `time` is a pair whose sum is the time reached. `stop` is the terminal event, if one ended the
    stretch; `roots` are the other events, in order of time.
    """

    rows: np.ndarray
    time: tuple[Any, Any]
    state: np.ndarray
    stop: EventRoot | None = None
    roots: tuple[EventRoot, ...] = ()


Observer = Callable[[Any, Any, np.ndarray], None]
"""Called after each step as observer(start, end, series): the state's polynomial on the step, by
its coefficients (m, degree + 1) in the `basis` of the engine. They are lent, not given: heyoka
writes those of the next step into the same array."""


class Engine(Protocol):
    """A solver bound to one model's equations and events."""

    dtype: Any
    tol: float
    band: tuple[float, float]
    basis: str
    degree: int

    def integrate(
        self, k: Constants, y: np.ndarray, grid: np.ndarray, control: "StepControl"
    ) -> Stretch:
        """Integrate from `y` at grid[0] to grid[-1], or to a terminal event, or until `control`
        says stop."""


SMALL_COMPONENT = 1e-9
"""The part of the largest component of a start below which another one is lost to the control of
the error, which is relative to the largest: a series then takes steps in which what is small may
grow by many powers of e, and so does that of a higher precision."""


def uneven(y: np.ndarray) -> Any:
    """Whether states (m,) or (m, n) have a component that is small beside the largest, but not
    0."""
    size = np.abs(y)
    return ((size > 0) & (size < SMALL_COMPONENT * size.max(axis=0))).any(axis=0)


@dataclass
class StepControl:
    """Decides after each step whether to go on; `status` and `message` say why a motion was given
    up.

    With `band` = (low, high) it also ends the stretch, for new units, as soon as the norm
    of the state leaves the band: of those `rows` of it, if any are named, that carry a unit.
    """

    max_steps: float = math.inf
    max_seconds: float = math.inf
    band: tuple[float, float] | None = None
    rows: np.ndarray | None = None
    observer: Observer | None = None
    longest: float = math.inf
    """The longest step that an engine may take in the stretch, in its units: it ends where what
    needs such a limit has grown."""
    is_over: bool = False
    """Set by an observer that has seen enough of the stretch."""
    steps: int = 0
    evaluations: int = 0
    status: Status = Status.OK
    message: str = ""

    def __post_init__(self) -> None:
        self.deadline = perf_counter() + self.max_seconds
        self._next_check = 1.0

    def step(self, y: np.ndarray) -> bool:
        """Count a step that ended in `y`; False to stop."""
        if self.is_over:
            return False
        self.steps += 1
        if self.steps >= self._next_check and not self._goes_on():
            return False
        if self.rows is not None:
            y = y[self.rows]
        if self.longest < math.inf and not uneven(y.astype(float)):
            return False
        if self.band is None:
            return True
        # Of Python's own numbers: numpy's take ten times as long one by one.
        return self.band[0] < math.hypot(*y.tolist()) < self.band[1]

    def _goes_on(self) -> bool:
        """Whether there are steps and seconds left. Not asked at each step: the time of day alone
        takes about a tenth of a fast one."""
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
        """Whether there are seconds left; a motion without is given up."""
        if perf_counter() <= self.deadline:
            return True
        return self.give_up(Status.TIMEOUT, f"max_seconds: stopped after {self.max_seconds:g} s")

    def take_back(self, steps: int, evaluations: int) -> None:
        """Go back to these counts: the steps since then are of no motion, and that they failed
        counts for nothing, but their seconds are spent."""
        self.steps, self.evaluations, self._next_check = steps, evaluations, steps + 1.0
        if self.status is Status.FAILED:
            self.status, self.message = Status.OK, ""

    def give_up(self, status: Status, message: str) -> bool:
        """Record that the motion ends here, and why: the first reason counts."""
        if self.status is Status.OK:
            self.status, self.message = status, message
        return False
