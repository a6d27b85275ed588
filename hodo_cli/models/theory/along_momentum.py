"""Torques along G change the clock of a motion, not its path.

Under N = -phi G, with phi any function of the time and the state, the motion is omega(t) = g(t)
Omega(s(t)), with Omega the free motion from the same start and

    g' = -phi g,    s' = g,    g(0) = 1,    s(0) = 0.

In A omega' + omega x A omega = N the gyroscopic terms are of degree 2, so that g^2 drops out.
G^2/2T and D/G^2 are constant, no such motion crosses the separatrix, and its attitude at t is that
of the free motion at s(t).

For phi = lambda + b/|G| + c |G| (damping, a brake, a drag) let beta = b/|G(0)| and gamma = c
|G(0)|. Then g' = -(beta + lambda g + gamma g^2), an equation of Riccati. With l = lambda/2 and
k^2 = l^2 - beta gamma its solution is

    a = exp(-l t) sinh(k t)/k,    E = a - beta int_0^t a,    g = E'/(1 + gamma E),
    s = log(1 + gamma E)/gamma.

All of it is written in l + k and beta gamma/(l + k), whose difference is 2k, so that nothing
cancels where a brake or a drag is weak. The body stops at the zero of E'.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

SERIES_TERMS = 32
"""Terms of the series of int a: of 2^n/n! the last one is below the rounding of long double."""


class ChangedClock(NamedTuple):
    """g and s at some times (...)."""

    g: Any
    s: Any


class AlongMomentum(NamedTuple):
    """The rates lambda, beta and gamma of a torque along G at the start, 1/time; numbers or arrays
    (...) in any precision, beta and gamma at least 0."""

    damping: Any
    brake: Any
    drag: Any

    @classmethod
    def of(
        cls, momentum: Any, damping: Any = 0.0, brake: Any = 0.0, drag: Any = 0.0
    ) -> "AlongMomentum":
        """The torque -(damping + brake/|G| + drag |G|) G on a body that starts with |G| = momentum
        > 0."""
        rates = np.broadcast_arrays(damping, brake / momentum, drag * momentum)
        return cls(*(np.asarray(rate, dtype=np.result_type(*rates, float)) for rate in rates))

    @property
    def stop(self) -> Any:
        """The time (...) at which the body comes to rest; infinite where it does not."""
        l, k, turning = self._roots
        # The zero of g' = ... is met where tanh(k t)/k = 1/e, or tan.
        e, last = self.brake + l, self.brake * (self.brake + self.damping + self.drag)
        with np.errstate(all="ignore"):
            x = (e + k) / last
            ends = np.where(turning, np.arctan2(k, e) / k, x * _of_log(2 * k * x))
            return np.where(turning | ((last > 0) & (e > 0)), ends, np.inf)

    def clock(self, t: Any) -> ChangedClock:
        """g and s at times t >= 0 (...); at rest g is 0 and s stands still."""
        stop = self.stop
        t, stopped = np.minimum(t, stop), np.asarray(t) >= stop
        l, k, turning = self._roots
        k_signed = np.copysign(k, l)
        product, large = self.brake * self.drag, l + k_signed
        with np.errstate(all="ignore"):
            small = np.where(large != 0, product / large, 0)
            slow, fast = np.exp(-small * t), np.exp(-l * t)
            a = np.where(turning, fast * np.sin(k * t) / k, slow * t * _of_exp(2 * k_signed * t))
            slope = np.where(
                turning,
                fast * np.cos(k * t) - (self.brake + l) * a,
                np.exp(-large * t) - (self.brake + small) * a,
            )
            area = np.where(
                turning,
                (1 - fast * np.cos(k * t) - l * a) / product,
                (t * _of_exp(small * t) - a) / large,
            )
        # Both cancel for short times.
        brief = np.where(turning, product * t * t, np.abs(large * t)) < 1
        area = np.where(brief, _area(self.damping * t, product * t * t) * t * t, area)
        E = a - self.brake * area
        return ChangedClock(
            np.where(stopped, 0, slope / (1 + self.drag * E)), E * _of_log(self.drag * E)
        )

    def time_of_exposure(self, exposure: Any) -> Any:
        """The time (...) at which the integral of g^2 is `exposure` (...), infinite where it never
        is; for one of the three rates, the others 0.

        To first order the shape of a motion with fluid depends on kappa int |G|^2 dt alone: what
        the fluid does by itself in the one time it does in the other beside a torque along G.
        Raises ValueError for more than one rate.
        """
        if sum(bool(np.any(rate)) for rate in self) > 1:
            raise ValueError("a time by a formula needs one of damping, brake and drag alone")
        damping, brake, drag = (rate * np.asarray(exposure) for rate in self)
        with np.errstate(all="ignore"):
            braked = _of_log(-3 * brake) * _of_exp(brake * _of_log(-3 * brake))
            time = exposure * _of_log(-2 * damping) * braked / (1 - drag)
            return np.where(2 * damping + 3 * brake + drag < 1, time, np.inf)

    @property
    def _roots(self) -> tuple[Any, Any, Any]:
        """l, |k|, and whether k is imaginary."""
        l = self.damping / 2
        square = l * l - self.brake * self.drag
        return l, np.sqrt(np.abs(square)), square < 0


def _of_exp(z: Any) -> Any:
    """(1 - exp(-z))/z, 1 at z = 0."""
    return np.where(z == 0, 1, -np.expm1(-z) / np.where(z == 0, 1, z))


def _of_log(z: Any) -> Any:
    """log(1 + z)/z, 1 at z = 0."""
    return np.where(z == 0, 1, np.log1p(z) / np.where(z == 0, 1, z))


def _area(z: Any, w: Any) -> Any:
    """y(1) of y'' + z y' + w y = 1 from rest, for |z| < 2 and w < 1, by its Taylor series."""
    before, last = 0 * (z + w), 0.5 + 0 * (z + w)
    total = last
    for n in range(1, SERIES_TERMS):
        before, last = last, -(z * (n + 1) * last + w * before) / ((n + 2) * (n + 1))
        total = total + last
    return total


def clock_of_law(t: Any, exponent: Callable[[Any], Any], start: float = 0.0) -> ChangedClock:
    """g and s at times t (n,) under damping whose rate is a law of time, the same for all axes, for
    a body that starts at `start`.

    `exponent(t)` is the integral of the rate, up to a constant, for times of any shape. s is a sum
    over Gauss's nodes in parts, between one time and the next, that are halved until they agree.
    """
    t = np.asarray(t, dtype=np.result_type(t, float))
    edges = np.concatenate(([t.dtype.type(start)], t))
    nodes, weights = gauss_legendre(t.dtype)

    def g(times: Any) -> Any:
        return np.exp(exponent(edges[0]) - exponent(times))

    def stretches(parts: int) -> Any:
        width = np.diff(edges)[:, None, None] / parts
        times = edges[:-1, None, None] + width * (np.arange(parts)[:, None] + nodes)
        return (width * weights * g(times)).sum((1, 2))

    parts, coarse, fine = 1, stretches(1), stretches(2)
    while parts < 2**12 and (abs(fine - coarse) > 8 * np.finfo(t.dtype).eps * abs(fine)).any():
        parts *= 2
        coarse, fine = fine, stretches(2 * parts)
    return ChangedClock(g(t), np.cumsum(fine))


def gauss_legendre(dtype: Any, n: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Gauss's nodes and weights (n,) on 0 to 1, by Newton's iteration in the precision of dtype."""
    x = np.polynomial.legendre.leggauss(n)[0].astype(dtype)
    for _ in range(3):
        before, value = np.ones_like(x), x
        for i in range(2, n + 1):
            before, value = value, ((2 * i - 1) * x * value - (i - 1) * before) / i
        slope = n * (before - x * value) / (1 - x * x)
        x = x - value / slope
    return (1 + x) / 2, 1 / ((1 - x * x) * slope * slope)
