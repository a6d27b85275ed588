"""The loop of the engines that advance one step at a time and have a formula for the state within a
step."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from ..models.base import Constants, attributes
from .polynomial import CHEBYSHEV, chebyshev
from .protocol import NORM_BAND, Engine, Status, StepControl, Stretch


class Stepwise(Engine):
    """An engine that makes a solver for each stretch. The solver has the interface of SciPy's
    OdeSolver."""

    dtype: Any = np.float64
    band = NORM_BAND
    basis = CHEBYSHEV

    @abstractmethod
    def solver(self, k: Any, y: np.ndarray, start: Any, end: Any, control: StepControl) -> Any:
        """A new solver from the state `y` (m,) at the time `start` to `end`, in steps of at most
        `control.longest`. Raises ValueError, with a message for the result, if the equations allow
        no step."""

    def series(self, solver: Any, dense: Callable[[Any], np.ndarray]) -> np.ndarray:
        """The coefficients (m, degree + 1), in the engine's `basis`, of the last step's polynomial,
        from its values at Chebyshev's nodes."""
        nodes, transform = chebyshev(self.degree)
        values = dense(solver.t_old + (solver.t - solver.t_old) * nodes.astype(self.dtype))
        return np.asarray(values @ transform.astype(self.dtype))

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
        going = len(grid) > 1
        while going:
            try:
                dense = motion_of_step(solver)
            except ValueError as error:
                control.give_up(Status.FAILED, str(error))
                break
            reached = int(np.searchsorted(grid, solver.t, side="right"))
            if reached > done:
                rows[done:reached] = dense(grid[done:reached]).T
                done = reached
            if control.observer is not None:
                series = self.series(solver, dense)
                if not control.observer(solver.t_old, solver.t, series, solver.y):
                    break
            going = control.step(solver.y) and solver.status == "running"
        control.evaluations += solver.nfev
        return Stretch(rows[:done], (solver.t, self.dtype(0)), solver.y.copy())


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
