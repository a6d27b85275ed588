"""The loop of the engines that advance one step at a time and have a formula for the state within a
step."""

from abc import abstractmethod
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from ..models.base import Constants, Event, attributes
from .polynomial import CHEBYSHEV, Zeros, isolate, rounding, to_bernstein
from .protocol import NORM_BAND, Engine, EventRoot, Status, StepControl, Stretch


class Stepwise(Engine):
    """An engine that makes a solver for each stretch. The solver has the interface of SciPy's
    OdeSolver."""

    dtype: Any = np.float64
    band = NORM_BAND
    basis = CHEBYSHEV

    def __init__(self, events: tuple[Event, ...]) -> None:
        self.events = events

    @abstractmethod
    def solver(self, k: Any, y: np.ndarray, start: Any, end: Any, control: StepControl) -> Any:
        """A new solver from the state `y` (m,) at the time `start` to `end`, in steps of at most
        `control.longest`. Raises ValueError, with a message for the result, if the equations allow
        no step."""

    def series(self, solver: Any, dense: Callable[[Any], np.ndarray], end: Any) -> np.ndarray:
        """The coefficients (m, degree + 1), in the engine's `basis`, of the last step's polynomial
        up to the time `end`, from its values at Chebyshev's nodes."""
        nodes, transform = chebyshev(self.degree)
        return np.asarray(dense(solver.t_old + (end - solver.t_old) * nodes) @ transform)

    def integrate(
        self, k: Constants, y: np.ndarray, grid: np.ndarray, control: StepControl
    ) -> Stretch:
        """See `Engine.integrate`."""
        constants = attributes(k, self.dtype)
        try:
            solver = self.solver(constants, y, grid[0], grid[-1], control)
        except ValueError as error:
            control.give_up(Status.FAILED, str(error))
            return Stretch(y[None], (grid[0], self.dtype(0)), y)
        rows = np.empty((len(grid), len(y)), dtype=self.dtype)
        rows[0], done = y, 1
        going, stop = len(grid) > 1, None
        passed: list[EventRoot] = []
        while going and stop is None:
            before = solver.y.copy()
            try:
                dense = motion_of_step(solver)
            except ValueError as error:
                control.give_up(Status.FAILED, str(error))
                break
            roots = self._roots(constants, solver.t_old, solver.t, dense, before)
            stop = next((root for root in roots if self.events[root.event].terminal), None)
            passed += [root for root in roots if not self.events[root.event].terminal]
            end = solver.t if stop is None else stop.time
            reached = int(np.searchsorted(grid, end, side="right"))
            if reached > done:
                rows[done:reached] = dense(grid[done:reached]).T
                done = reached
            if control.observer is not None:
                control.observer(solver.t_old, end, self.series(solver, dense, end))
            going = control.step(solver.y) and solver.status == "running"
        control.evaluations += solver.nfev
        state, time = (solver.y, solver.t) if stop is None else (stop.state, stop.time)
        return Stretch(rows[:done], (time, self.dtype(0)), state.copy(), stop, tuple(passed))

    def _roots(
        self, k: Any, start: Any, end: Any, dense: Callable[[Any], np.ndarray], before: np.ndarray
    ) -> list[EventRoot]:
        """The zeros of every event inside a step that starts from the state `before`, in order of
        time."""
        roots: list[EventRoot] = []
        if not self.events:
            return roots
        nodes, transform = chebyshev(self.degree)
        nodal = start + (end - start) * nodes.astype(self.dtype)
        values = np.array([event.function(nodal, list(dense(nodal)), k) for event in self.events])
        c = values @ transform
        b = c @ to_bernstein(CHEBYSHEV, self.degree, np.dtype(self.dtype))
        zeros = isolate(b, rounding(c, CHEBYSHEV))
        for i, event in enumerate(self.events):

            def value(t: Any, event: Event = event) -> Any:
                return event.function(t, list(dense(t)), k)

            times = start + (end - start) * between(zeros, i)
            # The state before the step decides the sign at the start, because the dense output has
            # rounding there. A motion that starts at a zero does not pass through it.
            at_start = event.function(start, list(before), k)
            signs = np.sign([at_start, *event.function(times[1:], list(dense(times[1:])), k)])
            for j in np.flatnonzero(signs[:-1] * signs[1:] < 0):
                time = zero(value, times[j], times[j + 1])
                roots.append(EventRoot(i, time, dense(time)))
            # A zero at the end counts here: the next step starts at it and does not pass through
            # it.
            if signs[-1] == 0 and signs[-2] != 0:
                roots.append(EventRoot(i, end, dense(end)))
        return sorted(roots, key=lambda root: root.time)


def motion_of_step(solver: Any) -> Callable[[Any], np.ndarray]:
    """Take a step; returns the motion within it, a function from times (...) to states (m, ...).

    Raises ValueError if the step fails. SciPy's implicit methods raise it for a matrix that is not
    finite, and the rates, which DOP853 evaluates again within the step, when no time is left.
    """
    message = solver.step()
    # LSODA returns success with nan where an equation is not Lipschitz.
    if solver.status == "failed" or not np.isfinite(solver.y).all():
        raise ValueError(message or "the state became infinite or not a number")
    dense: Callable[[Any], np.ndarray] = solver.dense_output()
    return dense


def between(zeros: Zeros, row: int) -> np.ndarray:
    """Places in [0, 1], in order, that separate the zeros of polynomial `row`: both ends, the
    middle between two zeros, and the ends of uncertain intervals."""
    chosen = zeros.row == row
    low, high = ((zeros.x + side * zeros.width / 2)[chosen] for side in (-1, 1))
    unsure = np.append(low, high)[np.tile(~zeros.sure[chosen], 2)]
    inner = np.concatenate(((high[:-1] + low[1:]) / 2, unsure))
    return np.unique(np.concatenate(([0], inner[(inner > 0) & (inner < 1)], [1]))).astype(low.dtype)


@lru_cache(maxsize=8)
def chebyshev(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """The zeros in [0, 1] of Chebyshev's polynomial of the next degree, and the matrix from the
    values (m, degree + 1) of a polynomial there to its coefficients."""
    angles = (np.arange(degree + 1) + 0.5) * np.pi / (degree + 1)
    transform = 2 * np.cos(np.outer(angles, np.arange(degree + 1))) / (degree + 1)
    transform[:, 0] /= 2
    return (np.cos(angles) + 1) / 2, transform


def zero(f: Callable[[Any], Any], a: Any, b: Any) -> Any:
    """A zero, to the last bit, of a function f that has different signs at a and b. Bisection finds
    one whatever f does in between."""
    rising = f(b) > 0
    # The loop ends when no number lies between a and b.
    while a < (middle := a + (b - a) / 2) < b:
        if (f(middle) > 0) == rising:
            b = middle
        else:
            a = middle
    return b
