"""Torques along G change the clock of a motion, not its path.

Under N = -phi G, with phi any function of the time and the state, the motion is omega(t) = g(t)
Omega(s(t)), with Omega the free motion from the same start and

    g' = -phi g,    s' = g,    g(0) = 1,    s(0) = 0.

In A omega' + omega x A omega = N the gyroscopic terms are of degree 2, so that g^2 drops out.
G^2/2T and D/G^2 are constant, no such motion crosses the separatrix, and its attitude at t is that
of the free motion at s(t).

For phi = lambda + b/|G| (damping, a brake) let beta = b/|G(0)|. Then g' = -(beta + lambda g), and

    a = int_0^t exp(-lambda t),    g = exp(-lambda t) - beta a,    s = a - beta int_0^t a.

The body stops at the zero of g.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from .closed_form import free_time

SERIES_TERMS = 20
"""Terms of the series of int a: of 2/n! the last one is below the rounding of long double."""


class AlongMomentum(NamedTuple):
    """The rates lambda and beta of a torque along G at the start, 1/time, beta at least 0."""

    damping: float
    brake: float

    @property
    def stop(self) -> float:
        """The time at which the body comes to rest; infinite where it does not."""
        if not self.brake or self.damping <= -self.brake:
            return math.inf
        if not self.damping:
            return 1 / self.brake
        return math.log1p(self.damping / self.brake) / self.damping

    def clock(self, t: Any) -> tuple[Any, Any]:
        """g and s (...) at times t >= 0 (...); at rest g is 0 and s stands still."""
        t, stopped = np.minimum(t, self.stop), np.asarray(t) >= self.stop
        with np.errstate(over="ignore", invalid="ignore"):  # of what grows beyond all doubles
            a = free_time(self.damping, t)
            g = np.where(stopped, 0, np.exp(-self.damping * t) - self.brake * a)
            return g, a - self.brake * _phi_2(self.damping * t) * t * t


def _phi_2(z: Any) -> Any:
    """(exp(-z) - 1 + z)/z^2, 1/2 at z = 0; for |z| < 1, where it cancels, by its series."""
    is_small = np.abs(z) < 1
    small, large = np.where(is_small, z, 0), np.where(is_small, 1, z)
    term = total = 0.5 + 0 * small
    for n in range(3, SERIES_TERMS + 3):
        term = -term * small / n
        total = total + term
    return np.where(is_small, total, (large + np.expm1(-large)) / large**2)
