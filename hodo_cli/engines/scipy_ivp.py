"""SciPy's initial value solvers, by name, for models without events; the only module of engines
that imports SciPy."""

import warnings
from functools import partial
from threading import Lock
from typing import Any

import numpy as np
from scipy.integrate import BDF, DOP853, LSODA, RK45, OdeSolver, Radau

from ..models.base import Constants, Equations, jacobian
from .protocol import EPS, IVP, StepControl, Stretch
from .stepwise import Stepwise

SOLVERS = {"DOP853": DOP853, "RK45": RK45, "LSODA": LSODA, "Radau": Radau, "BDF": BDF}
DEGREES = {"DOP853": 7, "RK45": 4, "LSODA": 12, "Radau": 3, "BDF": 5}
"""The degree of each solver's dense output; the largest for LSODA and BDF, which change their
order."""

LOCK = Lock()
"""One stretch at a time: LSODA of older SciPy keeps its state in the library, and warnings are
ignored in the whole process."""

LEAST_TOL = 100 * EPS
"""The smallest relative tolerance that SciPy's solvers accept."""


class Ivp(Stepwise):
    """One of SciPy's solvers. The state is scaled to about 1."""

    def __init__(self, method: str, model: Equations, tol: float | None) -> None:
        self.method, self.model = SOLVERS[method], model
        self.degree = DEGREES[method]
        self.implicit = method in ("LSODA", "Radau", "BDF")
        self.tol = max(IVP[method] if tol is None else tol, LEAST_TOL)

    def integrate(
        self, k: Constants, y: np.ndarray, grid: np.ndarray, control: StepControl
    ) -> Stretch:
        """See `Engine.integrate`."""
        with LOCK, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a solver that fails also returns a message
            return super().integrate(k, y, grid, control)

    def solver(
        self, k: Any, y: np.ndarray, start: Any, end: Any, control: StepControl
    ) -> OdeSolver:
        """See `Stepwise.solver`; the implicit methods are given the Jacobian."""
        rates = partial(self._rhs, k, control)
        # From rates that are not finite SciPy finds no length of a step, and would try for ever.
        if not np.isfinite(rates(start, y)).all():
            raise ValueError("the rates are infinite or not a number")
        options = {"jac": partial(jacobian, self.model, k)} if self.implicit else {}
        # Both tolerances are equal, because the units keep the largest component near 1.
        return self.method(
            rates, start, y, end,
            rtol=self.tol, atol=self.tol, max_step=control.longest, **options,
        )  # fmt: skip

    def _rhs(self, k: Any, control: StepControl, t: float, y: np.ndarray) -> np.ndarray:
        """The rates (m,) in a state y (m,), or nan where they are complex: the solver then tries a
        shorter step. Raises ValueError, which ends the step, if the motion has no seconds left."""
        if not control.has_time():
            raise ValueError(control.message)
        # For three numbers Python's floats take half the time of numpy's scalars. But with them a
        # root of a negative number is complex, and a solver would continue with its real part.
        rates = np.array(self.model.rhs(t, y.tolist(), k))
        return np.full(len(y), np.nan) if rates.dtype == complex else rates
