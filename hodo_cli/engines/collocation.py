"""Radau IIA collocation with 16 stages (order 31) for stiff motions, in double and extended
precision.

In each step the motion is a polynomial whose derivative satisfies the equations at the Radau
points, one of which is the end. The method is L-stable: like Radau of order 5 it steps over decayed
components without resolving them, but it is right to the last digits and takes a tenth of the
steps. Newton's method solves the equations of a step. Its matrices are in double and its residuals
in the working precision, so its solution has the working precision too.

Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II (1996), sections IV.5
and IV.8.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from ..models.base import Equations, jacobian, kinds_of_variables, stacked
from .polynomial import LEGENDRE
from .protocol import StepControl
from .stepwise import Stepwise

# This number is the fastest on stiff motions: 26 ms, where 8, 12, 20 and 24 stages take 153, 39, 46
# and 52 ms. Fewer stages need more steps, more stages larger matrices.
STAGES = 16
PRECISIONS = {"double": np.float64, "extended": np.longdouble}
# RADAU5 gives up after 7 iterations. Here a failed step costs 16 Jacobians, so that three more
# iterations are cheaper.
ITERATIONS = 10
# Continued over several times its own length, the polynomial of a step is far from the motion.
LONGEST_CONTINUED = 2
"""The longest step, in lengths of the last one, for which Newton's method begins with the continued
polynomial."""

SIGNS = (-1.0) ** np.arange(STAGES + 1)
"""The values of Legendre's polynomials at the start of a step."""


class Collocation(Stepwise):
    """Radau IIA collocation for one model. The state is scaled to about 1."""

    def __init__(self, model: Equations, tol: float | None, precision: str) -> None:
        self.dtype, self.model = PRECISIONS[precision], model
        # A tolerance below 32 eps doubles the number of steps and gains no digit, because the error
        # estimate is then rounding.
        self.tol = max(tol or 0.0, 32 * float(np.finfo(self.dtype).eps))
        self.band = (1e-100, 1e100)  # the error is relative to the state at every size
        self.basis, self.degree = LEGENDRE, STAGES

    def series(self, solver: Any, dense: Callable[[Any], np.ndarray]) -> np.ndarray:
        """See `Stepwise.series`; the solver has the coefficients."""
        return np.asarray(solver.series)

    def solver(
        self, k: Any, y: np.ndarray, start: Any, end: Any, control: StepControl
    ) -> "RadauSolver":
        """See `Stepwise.solver`."""
        return RadauSolver(self.model, k, y, start, end, self.tol, control.longest)


class RadauSolver:
    """The solver of one stretch, with the interface of SciPy's OdeSolver. The type of `y` is the
    working precision."""

    def __init__(
        self,
        model: Equations,
        k: Any,
        y: np.ndarray,
        start: Any,
        end: Any,
        tol: float,
        longest: float = math.inf,
    ) -> None:
        self.model, self.k, self.tol, self.longest = model, k, tol, longest
        self.t = self.t_old = start
        self.y, self.end, self.status, self.nfev = y, end, "running", 0
        self.points, self.integrals, self.transform = tableau(y.dtype)
        self.kinds = kinds_of_variables(model)  # the error of each is relative to its own size
        # The first step resolves the fastest rate; steps grow when the fastest components have
        # decayed.
        fastest = float(np.abs(jacobian(model, k, start, y.astype(float))).sum(axis=1).max())
        self.h = min(end - start, y.dtype.type(1 / fastest)) if fastest else end - start

    def step(self) -> str | None:
        """Take one step, of a size that keeps its error within tolerance."""
        while True:
            h = min(self.h, self.y.dtype.type(self.longest))
            last = self.t + h >= self.end
            h = self.end - self.t if last else h
            if self.t + h <= self.t:
                self.status = "failed"
                return "the step has become too small"
            stages = self._stages(h)
            if stages is None:
                self.h = h / 4
                continue
            series = stages @ self.transform
            error = self._error(series, self.y + stages[:, -1])
            # The last coefficient of a step goes with h^STAGES. The safety factor 0.9 and the
            # limits 1/5 and 8 are as in RADAU5; 1e-300 replaces an error of 0.
            self.h = h * min(max(0.9 * (self.tol / max(error, 1e-300)) ** (1 / STAGES), 0.2), 8.0)
            if error <= self.tol:
                break
        self.series = self._through_start(series)
        self.t_old, self.y = self.t, self.y + stages[:, -1]
        self.t = self.end if last else self.t + h
        self.status = "finished" if last else "running"
        return None

    def dense_output(self) -> Callable[[Any], np.ndarray]:
        """The polynomial of the last step, as a function from times (...) to states (m, ...)."""
        start, h, series = self.t_old, self.t - self.t_old, self.series

        def dense(t: Any) -> np.ndarray:
            shape = np.shape(t)
            x = np.atleast_1d(2 * ((t - start) / h) - 1)
            return np.asarray((series @ legendre(x, STAGES)).reshape(-1, *shape))

        return dense

    def _through_start(self, series: np.ndarray) -> np.ndarray:
        """The collocation polynomial (m, STAGES + 1) of the state, as a series of Legendre's
        polynomials, from the `series` (m, STAGES) of the change since the start, which goes through
        the collocation points alone. The latter is not 0 at the start, so that functions of the
        state would jump where two steps meet.

        The difference P_s - P_(s-1), with s = STAGES, vanishes at all collocation points and is 2
        or -2 at the start.
        """
        full = np.pad(series, ((0, 0), (0, 1)))
        missed = -(series * SIGNS[:-1]).sum(axis=1)
        full[:, -1] = missed / 2 * SIGNS[-1]
        full[:, -2] -= full[:, -1]
        full[:, 0] += self.y
        return full

    def _error(self, series: np.ndarray, end: np.ndarray) -> float:
        """An estimate of the polynomial's error, relative to the smaller of the states at start and
        end. The estimate is the largest of its last two coefficients and its distance from the
        state at the start, which is no collocation point, so that a decay too fast for the step
        shows there."""
        missed = series[:, ::2].sum(axis=1) - series[:, 1::2].sum(axis=1)
        worst = np.abs([series[:, -1], series[:, -2], missed]).max(axis=0)
        before, after = np.abs(self.y), np.abs(end)
        sizes = (min(before[rows].max(), after[rows].max()) or 1 for rows in self.kinds)
        return max(
            float(worst[rows].max() / size) for rows, size in zip(self.kinds, sizes, strict=True)
        )

    def _expected(self, h: Any) -> np.ndarray:
        """The changes of the state (m, STAGES) with which Newton's method begins, from the
        continued polynomial of the last step. Without it, from changes of 0, the method takes two
        iterations more, five or six."""
        if self.t == self.t_old or h > LONGEST_CONTINUED * (self.t - self.t_old):
            return np.zeros((len(self.y), STAGES), dtype=self.y.dtype)
        return np.asarray(self.dense_output()(self.t + self.points * h) - self.y[:, None])

    def _stages(self, h: Any) -> np.ndarray | None:
        """The changes of the state (m, STAGES) from the start of a step of length h to each
        collocation point; None if Newton's method fails."""
        times, before = self.t + self.points * h, np.inf
        sizes = [float(np.abs(self.y[rows]).max()) or 1.0 for rows in self.kinds]
        z = self._expected(h)
        for _ in range(ITERATIONS):
            try:
                change = self._correction(times, h, z)
            except np.linalg.LinAlgError:
                return None
            z = z - change
            now = max(
                float(np.abs(change[rows]).max()) / size
                for rows, size in zip(self.kinds, sizes, strict=True)
            )
            # The correction is well below tolerance, or it falls no longer, because only the
            # rounding of the residual is left.
            if now <= self.tol / 10 or before / 4 <= now <= 10 * self.tol:
                return np.asarray(z)
            before = now
        return None

    def _correction(self, times: np.ndarray, h: Any, z: np.ndarray) -> np.ndarray:
        """The correction (m, STAGES) that Newton's method subtracts from the changes z (m, STAGES)
        of the state from the start of a step of length h to its collocation points, which are at
        these times.

        Raises LinAlgError where its equations have no finite numbers or no solution.
        """
        y = self.y[:, None] + z
        rates = stacked(self.model.rhs(times, list(y), self.k), y)
        self.nfev += STAGES
        # RADAU5 keeps one Jacobian for several steps. A new one at every stage and iteration lets
        # Newton's method converge quadratically, to the last digits.
        slopes = jacobian(self.model, self.k, times.astype(float), y.astype(float))
        # By (a, i, b, j): how the integral of variable a up to point i depends on variable b at j.
        coupling = np.einsum("ji,abj->aibj", float(h) * self.integrals.astype(float), slopes)
        residual = (z - h * (rates @ self.integrals)).astype(float)
        if not (np.isfinite(coupling).all() and np.isfinite(residual).all()):
            raise np.linalg.LinAlgError
        matrix = np.eye(z.size) - coupling.reshape(z.size, z.size)
        return np.linalg.solve(matrix, residual.ravel()).reshape(z.shape)


def legendre(x: np.ndarray, degree: int) -> np.ndarray:
    """The values (degree + 1, n) of Legendre's polynomials 0 to `degree` at x (n,), by their
    recurrence."""
    P = [np.ones_like(x), x]
    for k in range(1, degree):
        P.append(((2 * k + 1) * x * P[k] - k * P[k - 1]) / (k + 1))
    return np.array(P)


@lru_cache(maxsize=2)
def tableau(fp: np.dtype[Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The Radau points (s,) in (0, 1], and two matrices (s, s) by which values at these points are
    multiplied from the right.

    The product with the first matrix, A.T of Butcher's tableau, gives the integrals from 0 to each
    point of the polynomial with these values. The product with the second gives the coefficients of
    this polynomial in Legendre's polynomials of 2 t - 1.

    The points are the zeros of P_(s-1) - P_s; their weights, (1 + x)/(s P_(s-1))^2 and 2/s^2 at the
    end, make the transform a sum. P_k is the derivative of (P_(k+1) - P_(k-1))/(2 k + 1). (Hairer
    and Wanner, section IV.5.)
    """
    s, k = STAGES, np.arange(STAGES)[:, None]
    x = np.sort(np.polynomial.legendre.legroots([0] * (s - 1) + [1, -1])).astype(np.longdouble)
    for _ in range(3):  # Newton's method, from double to extended precision
        inner = x[:-1]
        P = legendre(inner, s)
        # (1 - x^2) P_k' = k (P_(k-1) - x P_k)
        scaled = (s - 1) * (P[s - 2] - inner * P[s - 1]) - s * (P[s - 1] - inner * P[s])
        x[:-1] -= (P[s - 1] - P[s]) / (scaled / (1 - inner**2))
    x[-1] = 1
    P = legendre(x, s)
    weights = np.append((1 + x[:-1]) / (s * P[s - 1, :-1]) ** 2, np.longdouble(2) / s**2)
    transform = (2 * k + 1) * P[:s] * weights / 2
    integrals = np.concatenate(([x + 1], (P[2:] - P[:-2]) / (2 * k[1:] + 1)))
    return (
        ((x + 1) / 2).astype(fp),
        (transform.T @ integrals / 2).astype(fp),
        transform.T.astype(fp),
    )
