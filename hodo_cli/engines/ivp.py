"""SciPy's initial value solvers, by name; the only module that imports scipy.integrate."""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np
from scipy.integrate import BDF, DOP853, LSODA, RK45, Radau
from scipy.optimize import brentq

from ..models.base import Constants, Event, Model
from . import Hit, Leg, Structure, Watch, flatten, jacobian, namespace

SOLVERS = {"DOP853": DOP853, "RK45": RK45, "LSODA": LSODA, "Radau": Radau, "BDF": BDF}
LEAST_TOL = 100 * 2.0**-52
"""The smallest relative tolerance that SciPy's solvers accept."""

SUBSTEPS = np.linspace(0, 1, 17)
"""Where an event's sign is looked at inside a step: one step of an eighth-order method spans less than a
turn, and D changes sign at most four times in a turn."""


class Ivp:
    """One of SciPy's solvers, stepped one step at a time, with the state scaled to about 1."""

    dtype = np.float64
    eps = 2.0**-52

    def __init__(
        self, method: str, model: type[Model], structure: Structure, events: tuple[Event, ...], tol: float | None
    ) -> None:
        self.solver, self.model, self.structure, self.events = SOLVERS[method], model, structure, events
        self.implicit = method in ("LSODA", "Radau", "BDF")
        self.tol = max((1e-12 if method == "DOP853" else 1e-9) if tol is None else tol, LEAST_TOL)

    def leg(self, k: Constants, y: np.ndarray, grid: np.ndarray, watch: Watch) -> Leg:
        """See `Engine.leg`."""
        constants = namespace(self.structure, flatten(k))
        rhs = partial(self._rhs, constants)
        options = {"jac": partial(jacobian, self.model, constants)} if self.implicit else {}
        solver = self.solver(rhs, grid[0], y, grid[-1], rtol=self.tol, atol=self.tol, **options)
        rows = np.empty((len(grid), len(y)))
        rows[0], done, going, hit = y, 1, len(grid) > 1, None
        while going and hit is None:
            message = solver.step()
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                watch.give_up("failed", message or "the state became infinite or not a number")
                break
            dense = solver.dense_output()
            hits = self._hits(constants, solver.t_old, solver.t, dense)
            hit = next((h for h in hits if self.events[h.event].terminal), None)
            end = solver.t if hit is None else hit.time
            passed = int(np.searchsorted(grid, end, side="right"))
            if passed > done:
                rows[done:passed] = dense(grid[done:passed]).T
                done = passed
            if watch.observer is not None:
                watch.observer(solver.t_old, solver.t, dense, hits)
            going = watch.step(solver.y) and solver.status == "running"
        state, time = (solver.y, solver.t) if hit is None else (hit.state, hit.time)
        return Leg(rows[:done], (time, 0.0), state.copy(), hit)

    def _rhs(self, k: Any, t: float, y: np.ndarray) -> np.ndarray:
        return np.array(self.model.rhs(t, y.tolist(), k))

    def _hits(self, k: Any, start: float, end: float, dense: Callable[[Any], np.ndarray]) -> list[Hit]:
        """The zeros of every event inside a step, in order of time."""
        found: list[Hit] = []
        if not self.events:
            return found
        times = start + (end - start) * SUBSTEPS
        states = dense(times)
        for i, event in enumerate(self.events):

            def value(t: float, event: Event = event) -> float:
                return float(event.function(t, list(dense(t)), k))

            signs = np.sign(event.function(times, list(states), k))
            for j in np.flatnonzero(signs[:-1] * signs[1:] < 0):
                root = brentq(value, times[j], times[j + 1], xtol=1e-300, rtol=4 * self.eps)
                found.append(Hit(i, root, int(signs[j + 1]), dense(root)))
            for j in np.flatnonzero((signs[1:-1] == 0) & (signs[:-2] * signs[2:] < 0)) + 1:
                found.append(Hit(i, times[j], int(signs[j + 1]), states[:, j]))
        return sorted(found, key=lambda hit: hit.time)


@lru_cache(maxsize=64)
def build(method: str, model: type[Model], structure: Structure, events: tuple[Event, ...], tol: float | None) -> Ivp:
    """A solver bound to one model, its structure, events and tolerance."""
    return Ivp(method, model, structure, events, tol)
