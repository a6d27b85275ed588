"""The nutation of a Lagrange top: the roots of its cubic from the slow state, its mean over a turn,
the torques, whose coefficients are functions of slow time, its drift under them, and the state at
the start."""

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic import as_float, as_numpy_float, at_once, isfinite, sin, sqrt
from ..terms.time_laws import coefficient_at, coefficient_kind

ROOT_ROUNDING = 1e-13
"""How far below 0 the rounding of Gz, H and r may bring ((u2 - u1)/2)^2."""


def mean_cosine(e: Any, w: Any) -> Any:
    """-<cos phi>/e over one nutation, u = s - e cos phi and dt ~ dphi/sqrt(w + e cos phi): <u> is s
    + e^2 times it.

    By the arithmetic-geometric mean: analytic in e^2, also at e = 0 (regular precession), where the
    elliptic integrals of v = u3 - (u3 - u1) E/K, eq. (3.5), cancel. Its six terms reach 1e-17 down
    to 1 - k^2 = (w - e)/(w + e) = 1e-12.

    Source: M. Abramowitz and I. A. Stegun, 17.6, with c_{n+1} = c_n^2/(4 a_{n+1}).
    """
    # Only d and w enter, both smooth at e = 0; each step of the mean doubles the digits.
    d = e * e
    b = ((w - e) * (w + e)) ** 0.5
    a, b, c = ((w + b) / 2) ** 0.5, b**0.5, 1 / (2 * (w + b))
    total, factor = c, 1
    for _ in range(5):
        a, b = (a + b) / 2, (a * b) ** 0.5
        c, factor = d * c * c / (16 * a * a), 2 * factor
        total = total + factor * c
    return total


def nutation(y: Sequence[Any], k: Any) -> tuple[Any, Any]:
    """X and w of the state: u1, u2, u3 = 1 - X - e, 1 - X + e, 1 - X + w.

    T1 = x1 + x2 + x3 and T2 = x1 x2 + x1 x3 + x2 x3 are eqs (1.5) for x_i = 1 - u_i. With e known,
    the cubic for the roots is a quadratic; X is written so that nothing cancels for a fast or for
    an upright top.
    """
    U, Z, r, e = y
    c = k.C * r
    # With x1, x2 = X +- e and x3 = X - w these are T1 = 3 X - w and T2 = 3 X^2 - 2 X w - e^2; X
    # drops out of T1^2 - 3 T2.
    T1 = 2 - c * c / (2 * k.A * k.mu) + Z
    T2 = c * U / (k.A * k.mu) + 2 * Z
    w = (T1 * T1 - 3 * T2 - 3 * e * e) ** 0.5
    # X = (T1 + w)/3 with 3 - 3 X + 2 w above and below: a fast top has T1 near -w, and the rounding
    # of their sum is divided by 2 w.
    return (T1 + w - T2 - e * e) / (3 - T1 + w), w


def drift(
    y: Sequence[Any],
    k: Any,
    means: Sequence[Any],
    shape: tuple[Any, Any],
    by_mu: tuple[Any, Any] = (0.0, 0.0),
) -> tuple[Any, ...]:
    """dy/dtau of the state (U, Z, r, e) from the means <f>, <f cos phi>, <M3>, <M3 cos phi> over
    one nutation, and X and w of `nutation`; `by_mu` is mu'/mu and, unless that is 0, the mean of
    `mean_cosine`.

    The symbols are those of `AveragedTop`. U, Z and r follow from eqs (2.4), and dH/dtau = mu' v. e
    follows from the roots' own derivatives, with M(x) = T1' x^2 - T2' x - T3' at x = X divided by e
    by hand, so that regular precession, e = 0, is as regular as any other motion: by the cubic
    itself (U + c X)^2/(2 A mu) is X (2 - X)(X - Z) - e^2 w, so that all that is not of the order of
    e^2 cancels in the part of mu.
    """
    U, Z, r, e = y
    X, w = shape
    f, f_cos, M3, M3_cos = means
    change, mean = by_mu
    A, C, mu = k.A, k.C, k.mu
    # u = 1 - x turns Gz - C r u into U + c x, and 2 H - C r^2 - 2 mu u into 2 mu (x - Z).
    c, G = C * r, U + C * r * X
    # <f x> with x = X + e cos phi; U and Z lose their terms in M3 to C r' = M3.
    fx = X * f + e * f_cos
    dU = (U * f + c * fx) / A - X * M3 - e * M3_cos
    dZ = -2 * (fx - Z * f) / A + change * (X - Z - e * e * mean)
    # The rates of the coefficients of the cubic: T1', M(X)/e and the slope of M.
    dT1 = -c * M3 / (A * mu) + change * c * c / (2 * A * mu)
    M = 2 / A * (e * w * f + (X * (2 - X) - c * G / (2 * A * mu)) * f_cos) + G * M3_cos / (A * mu)
    M = M + change * e * (mean * X * (2 - X) - w)
    slope = -(c * (dU + M3 * X) + G * M3) / (A * mu) + change * c * G / (A * mu)
    slope = 2 * dZ * (X - 1) + slope
    # Singular only at w = e, that is u2 = u3, where a nutation takes for ever.
    de = (w * (M + e * (dZ + dT1)) - e * slope) / (2 * (w - e) * (w + e))
    return dU, dZ, M3 / C, de


def first_integrals(omega: Sequence[Any], gamma: Sequence[Any], k: Any) -> tuple[Any, Any]:
    """Gz and H, eqs (1.2), from the components of omega and of the vertical in body axes; k has A,
    C and mu."""
    p, q, r = omega
    Gz = k.A * (p * gamma[0] + q * gamma[1]) + k.C * r * gamma[2]
    return Gz, (k.A * (p * p + q * q) + k.C * r * r) / 2 + k.mu * gamma[2]


class Nutation(NamedTuple):
    """The start of a top: its state (U, Z, r, e), and X and w of `nutation`."""

    U: float
    Z: float
    r: float
    e: float
    X: float
    w: float


@np.errstate(all="ignore")  # what is out of range is said at the end
def nutation_at_start(
    inertia: Mapping[str, float], mu: float, initial: Mapping[str, Any]
) -> Nutation:
    """The nutation that the initial data make; w is not a number where no digit of it is left.

    Raises ValueError, with a sentence, if they make none.
    """
    theta, r, Gz, H = (initial[name] for name in ("theta", "r", "Gz", "H"))
    if (theta is None) == (Gz is None) or (Gz is None) != (H is None):
        raise ValueError("give theta and r, or Gz, H and r")
    A, C, mu = (as_numpy_float(value) for value in (inertia["A"], inertia["C"], mu))
    c, scale = C * r, 2 * A * mu
    excess = c * c / scale - 2
    if theta is not None:
        Z, e = released(theta, excess)
        U = -c * Z
    else:
        U, Z = Gz - c, 1 - (2 * H - c * r) / (2 * mu)
        X, square, _ = at_once(roots_of_cubic, U, Z, r, A, C, mu)
        e, slack = sqrt(max(square, 0.0)), math.sqrt(ROOT_ROUNDING)
        if not (square >= -ROOT_ROUNDING and -slack <= X - e and X + e <= 2 + slack):
            raise ValueError("no motion has these Gz, H and r: -1 <= u1 <= u2 <= 1 cannot be met")
    state = [as_numpy_float(value) for value in (U, Z, r, e)]
    if not all(map(isfinite, [*state, excess])):
        raise ValueError("the initial data are out of range")
    return Nutation(*map(as_float, (*state, *nutation(state, SimpleNamespace(A=A, C=C, mu=mu)))))


def released(theta: Any, excess: Any) -> tuple[Any, Any]:
    """x = 1 - cos theta and e = (u2 - u1)/2 of a top let go with p = q = 0, where u2 = cos theta.

    `excess` is C^2 r^2/(2 A mu) - 2. No digit is lost at theta = 0 or pi.
    """
    x = 2 * sin(theta / 2) ** 2
    # The positive root of a quadratic, in the one of its two forms that adds what has the same
    # sign.
    root = sqrt(excess * excess + 4 * (excess + 2) * x)
    ahead = (root + excess) / 2 if excess >= 0 else 2 * (excess + 2) * x / (root - excess)
    gap = x + ahead
    return x, sin(theta) ** 2 / (2 * gap) if gap > 0 else -excess / 2


@np.errstate(all="ignore")  # of both sides of a choice one may be out of range
def roots_of_cubic(U: Any, Z: Any, r: Any, A: Any, C: Any, mu: Any) -> tuple[Any, Any, Any]:
    """1 - (u1 + u2)/2, ((u2 - u1)/2)^2, which is negative where the two are no real numbers, and u3
    - 1, of states (...) whose e is not known."""
    # The coefficients of the cubic for y = u3 - 1: y^3 + T1 y^2 + T2 y = T3.
    c, scale = C * r, 2 * A * mu
    T1, T2, T3 = Z - (c * c / scale - 2), 2 * c * U / scale + 2 * Z, U * U / scale
    # Cauchy's bound. From above, Newton's method falls to the largest root and stops where rounding
    # stops the fall.
    y = 1 + np.maximum(np.maximum(abs(T1), abs(T2)), T3)
    while True:
        slope = (3 * y + 2 * T1) * y + T2
        lower = y - (((y + T1) * y + T2) * y - T3) / slope
        falls = (slope > 0) & (lower < y)
        if not np.any(falls):
            break
        y = np.where(falls, lower, y)
    # x1 x2 and x1 + x2: by a division where y is large, without one where it is small.
    product = np.where(y > 1, T3 / y, T2 + (T1 + y) * y)
    X = np.where(y > 1, (product - T2) / (2 * y), (T1 + y) / 2)
    return X, X * X - product, y


def roots_of_motion(omega: Sequence[Any], gamma: Sequence[Any], k: Any) -> tuple[Any, Any, Any]:
    """u1, u2 and u3, eq. (1.5), from the components (...) of omega and of the vertical in body
    axes; k has A, C and mu. The first two lose half of their digits where they meet."""
    (p, q, r), (g1, g2, g3) = omega, gamma
    # 1 - cos theta, without loss for a top that is nearly upright.
    x = np.where(g3 > 0, (g1 * g1 + g2 * g2) / (1 + abs(g3)), 1 - g3)
    U, Z = k.A * (p * g1 + q * g2) - k.C * r * x, x - k.A * (p * p + q * q) / (2 * k.mu)
    X, square, y = roots_of_cubic(U, Z, r, k.A, k.C, k.mu)
    e = np.sqrt(np.maximum(square, 0))
    return 1 - X - e, 1 - X + e, 1 + y


LAW = coefficient_kind(polynomial="tau", repeat=1)
"""A coefficient of resistance as a function of tau; a number is a polynomial of one."""


def axial_torque(tau: Any, r: Any, k: Any) -> Any:
    """M3 = m - b r; where a case gives no m it is 0."""
    resistance = -coefficient_at(k, "b", tau) * r
    return resistance + coefficient_at(k, "m", tau) if hasattr(k, "m") else resistance


def with_mu(k: Any, tau: Any) -> Any:
    """The constants of a top with mu as it is at tau."""
    if not isinstance(k.mu, tuple):
        return k
    return SimpleNamespace(**vars(k) | {"mu": coefficient_at(k, "mu", tau)})
