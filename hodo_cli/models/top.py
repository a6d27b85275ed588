"""The Lagrange top under a small torque that changes slowly with time, full and averaged.

The first integrals of the free top are the vertical angular momentum Gz, the energy H and the
angular velocity r about the axis of symmetry. In a nutation u = cos theta swings between the roots
u1 and u2 of

    Q(u) = (2 H - C r^2 - 2 mu u)(1 - u^2) - (Gz - C r u)^2/A,     -1 <= u1 <= u <= u2 <= 1 <= u3.

A torque changes Gz, H and r slowly. Averaged over one nutation their rates depend on the mean <u>
alone. This module first has the roots, the mean <u> and the start, then the forms of the model.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..arithmetic import at_once, cos, isfinite, sin, sqrt
from ..schema.kinds import Angle, Either, Key, Mistake, Number, Rate, Table, mistakes_where
from .base import CONSTANTS_KEY, Constants, Event, Label, Model, attributes, mistake_of
from .terms.time_laws import (
    CONSTANTS,
    POLYNOMIAL,
    coefficient_at,
    coefficient_kind,
    expressions_of,
    is_law,
    law_constants,
    least_value,
    named_constants,
    resolved,
    slope_at,
    value_mistakes,
)
from .theory.exact import sum_along_mean

LAW = coefficient_kind(POLYNOMIAL, repeat=1)
"""The rule of a coefficient of resistance as a function of tau. A number is a polynomial with one
coefficient."""

ROOT_ROUNDING = 1e-13
"""The depth below 0 to which rounding of Gz, H and r may bring ((u2 - u1)/2)^2."""


def mean_cosine(e: Any, w: Any) -> Any:
    """-<cos phi>/e, the mean over one nutation u = s - e cos phi, where s = (u1 + u2)/2,
    e = (u2 - u1)/2, w = u3 - s, and dt is proportional to dphi/sqrt(w + e cos phi). The mean of u
    is <u> = s + e^2 mean_cosine(e, w).

    It is computed by the arithmetic-geometric mean, and is analytic in e^2, even at e = 0 (regular
    precession). There the elliptic integrals in v = u3 - (u3 - u1) E/K, eq. (3.5), cancel. Six
    terms of the sum reach 1e-17 down to 1 - k^2 = (w - e)/(w + e) = 1e-12.
    """
    # Only e^2 and w enter, and both are smooth at e = 0.
    return sum_along_mean(e * e, w, ((w - e) * (w + e)) ** 0.5, 5)


def nutation(y: Sequence[Any], k: Any) -> tuple[Any, Any]:
    """X and w, which with the state y = (U, Z, r, e) give the roots: u1 = 1 - X - e,
    u2 = 1 - X + e and u3 = 1 - X + w. k has A, C and mu.

    T1 = x1 + x2 + x3 and T2 = x1 x2 + x1 x3 + x2 x3 are eqs (1.5) for x_i = 1 - u_i. Since e is
    known, the cubic for the roots is a quadratic. X is written so that nothing cancels for a fast
    or for an upright top.
    """
    U, Z, r, e = y
    c = k.C * r
    # With x1, x2 = X +- e and x3 = X - w these are T1 = 3 X - w and T2 = 3 X^2 - 2 X w - e^2; X
    # drops out of T1^2 - 3 T2.
    T1 = 2 - c * c / (2 * k.A * k.mu) + Z
    T2 = c * U / (k.A * k.mu) + 2 * Z
    w = (T1 * T1 - 3 * T2 - 3 * e * e) ** 0.5
    # X = (T1 + w)/3, multiplied above and below by 3 - 3 X + 2 w. For a fast top T1 is near -w, and
    # the rounding of their sum is divided by about 2 w.
    return (T1 + w - T2 - e * e) / (3 - T1 + w), w


def first_integrals(omega: Sequence[Any], gamma: Sequence[Any], k: Any) -> tuple[Any, Any]:
    """Gz and H, eqs (1.2), from omega (3,) and the vertical gamma (3,) along body axes. k has A, C
    and mu."""
    p, q, r = omega
    Gz = k.A * (p * gamma[0] + q * gamma[1]) + k.C * r * gamma[2]
    return Gz, (k.A * (p * p + q * q) + k.C * r * r) / 2 + k.mu * gamma[2]


@np.errstate(all="ignore")  # the end of the function checks the range
def nutation_at_start(
    inertia: Mapping[str, float], mu: float, initial: Mapping[str, Any]
) -> tuple[Any, ...]:
    """The state (U, Z, r, e) of a top with these initial data, theta and r, or Gz, H and r;
    followed by X and w of `nutation`. w is nan where rounding leaves no digit of it.

    Raises ValueError, with a sentence, if no motion has these data.
    """
    theta, r, Gz, H = (initial[name] for name in ("theta", "r", "Gz", "H"))
    if (theta is None) == (Gz is None) or (Gz is None) != (H is None):
        raise ValueError("give theta and r, or Gz, H and r")
    # numpy's numbers, which give infinite results where Python's raise exceptions.
    A, C, mu = (np.float64(1) * value for value in (inertia["A"], inertia["C"], mu))
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
    state = [np.float64(1) * value for value in (U, Z, r, e)]
    if not all(map(isfinite, [*state, excess])):
        raise ValueError("the initial data are out of range")
    return *state, *nutation(state, SimpleNamespace(A=A, C=C, mu=mu))


def released(theta: Any, excess: Any) -> tuple[Any, Any]:
    """x = 1 - cos theta and e = (u2 - u1)/2 of a top that starts at theta with p = q = 0, where
    u2 = cos theta.

    `excess` is C^2 r^2/(2 A mu) - 2. No digit is lost near theta = 0 or pi.
    """
    x = 2 * sin(theta / 2) ** 2
    # The positive root of a quadratic. Of its two forms the one is taken in which nothing cancels.
    root = sqrt(excess * excess + 4 * (excess + 2) * x)
    ahead = (root + excess) / 2 if excess >= 0 else 2 * (excess + 2) * x / (root - excess)
    gap = x + ahead
    return x, sin(theta) ** 2 / (2 * gap) if gap > 0 else -excess / 2


@np.errstate(all="ignore")  # the side of np.where that is not taken may be out of range
def roots_of_cubic(U: Any, Z: Any, r: Any, A: Any, C: Any, mu: Any) -> tuple[Any, Any, Any]:
    """1 - (u1 + u2)/2, ((u2 - u1)/2)^2 and u3 - 1 of states (...) whose e is not known. The second
    is negative where u1 and u2 are not real."""
    # The coefficients of the cubic for y = u3 - 1: y^3 + T1 y^2 + T2 y = T3.
    c, scale = C * r, 2 * A * mu
    T1, T2, T3 = Z - (c * c / scale - 2), 2 * c * U / scale + 2 * Z, U * U / scale
    # From Cauchy's bound, which is above all roots, Newton's method falls to the largest root. It
    # ends where rounding stops the fall.
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
    """The roots u1, u2 and u3, eq. (1.5), from the components (...) of omega and of the vertical
    gamma along body axes. k has A, C and mu. u1 and u2 lose half of their digits where they
    meet."""
    (p, q, r), (g1, g2, g3) = omega, gamma
    # 1 - cos theta, without loss of digits for a top that is nearly upright.
    x = np.where(g3 > 0, (g1 * g1 + g2 * g2) / (1 + abs(g3)), 1 - g3)
    U, Z = k.A * (p * g1 + q * g2) - k.C * r * x, x - k.A * (p * p + q * q) / (2 * k.mu)
    X, square, y = roots_of_cubic(U, Z, r, k.A, k.C, k.mu)
    e = np.sqrt(np.maximum(square, 0))
    return 1 - X - e, 1 - X + e, 1 + y


def axial_torque(tau: Any, r: Any, k: Any) -> Any:
    """The torque M3 = m - b r about the axis of symmetry. m is 0 where a case does not give it."""
    resistance = -coefficient_at(k, "b", tau) * r
    return resistance + coefficient_at(k, "m", tau) if hasattr(k, "m") else resistance


def with_mu(k: Any, tau: Any) -> Any:
    """The constants of a top in which mu is the number that it has at tau."""
    return SimpleNamespace(**vars(k) | {"mu": coefficient_at(k, "mu", tau)})


# The forms

ROUGH_M1, UNRESOLVED_M1 = 1e-8, 1e-14
"""The values of 1 - k^2 below which the averaged forms have lost half of their digits, and all of
them."""

LAW_KEYS = ("mu", "m", "a", "b")
"""The keys of the coefficients that may change with time."""


@dataclass(frozen=True)
class Top(Model):
    """The base class of all forms: the keys and their checks."""

    inertia: Mapping[str, float]
    mu: Any
    m: Any
    a: tuple[float, ...] | str
    b: tuple[float, ...] | str
    initial: Mapping[str, float | None]

    name = "Lagrange-averaged"
    keys = {
        "inertia": Key(
            Table(
                {
                    "A": Key(Number(above=0), "equatorial moment of inertia", "moment of inertia"),
                    "C": Key(Number(above=0), "axial moment of inertia", "moment of inertia"),
                }
            ),
            "moments of inertia about the fixed point",
        ),
        "mu": Key(
            Either(
                Number(above=0), POLYNOMIAL, title=f"a positive number, or {POLYNOMIAL['title']}"
            ),
            "largest restoring moment (heavy top: mass g l); forms averaged and full take a "
            "polynomial, the others a number alone, from `defaults:` too",
            "moment of inertia / time^2",
        ),
        "m": Key(
            coefficient_kind(POLYNOMIAL),
            "torque m(tau) about the axis of symmetry; form "
            "averaged-u refuses it, from `defaults:` too",
            "moment of inertia / time^2",
            default=None,
        ),
        "constants": CONSTANTS,
        "a": Key(LAW, "equatorial coefficient of resistance a(tau)", "moment of inertia / time"),
        "b": Key(LAW, "axial coefficient of resistance b(tau)", "moment of inertia / time"),
        "initial": Key(
            Table(
                {
                    "theta": Key(
                        Angle(polar=True), "angle of nutation, with p = q = 0", "rad", None
                    ),
                    "r": Key(Rate(), "angular velocity about the axis of symmetry", "1/time"),
                    "Gz": Key(
                        Number(), "vertical angular momentum", "moment of inertia / time", None
                    ),
                    "H": Key(Number(), "energy", "moment of inertia / time^2", None),
                }
            ),
            "initial theta and r (p = q = 0), or Gz, H and r",
        ),
    }
    slow_time = True
    no_axis_reason = (
        "gravity turns G in space, so no separatrix of free motion divides its hodographs"
    )

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """The mistakes in moments that no body has, and in a start that no motion of this form
        has."""
        inertia = data.get("inertia")
        if inertia and inertia["C"] > 2 * inertia["A"]:
            yield (
                ("inertia", "C"),
                f"no body has C = {inertia['C']:g} larger than 2 A = {2 * inertia['A']:g}",
            )
        if {"inertia", "mu", "initial"} <= set(data):
            # The start depends on these three keys alone, so the others may be missing.
            known = {**dict.fromkeys(cls.keys), **data}
            top = cls(**{name: x for name, x in known.items() if name != CONSTANTS_KEY})
            yield from mistake_of(("initial",), top.check_initial_data)

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        """The mistakes in expressions without a value at the start, and in a polynomial mu."""
        known = {"t": start, **(data.get(CONSTANTS_KEY) or {})}
        yield from value_mistakes(expressions_of({name: data[name] for name in LAW_KEYS}), known)
        least = least_value(data["mu"], start, end) if is_law(data["mu"]) else 1.0
        yield from mistakes_where(
            (
                is_law(data["mu"]) and start,
                ("mu",),
                "a polynomial of mu begins with the initial data: take time.start 0, or an epoch",
            ),
            (
                least <= 0 and not start,
                ("mu",),
                f"mu falls to {least:.6g} in the span, and has to stay positive",
            ),
        )

    def check_initial_data(self) -> None:
        """Raises ValueError, with a sentence, if no motion of this form has these initial data."""
        _ = self.nutation

    @property
    def mu_at_start(self) -> Any:
        """mu at tau = 0."""
        return self.mu[0] if is_law(self.mu) else self.mu

    @cached_property
    def nutation(self) -> tuple[Any, ...]:
        """U, Z, r, e, X and w at the start. Raises ValueError as `nutation_at_start` does."""
        return nutation_at_start(self.inertia, self.mu_at_start, self.initial)

    @cached_property
    def constants(self) -> Constants:
        """The moments, the coefficients, and the constants of the case."""
        of_case = self.case_constants
        given = {name: getattr(self, name) for name in LAW_KEYS}
        laws = {name: resolved(x, of_case) for name, x in given.items() if x is not None}
        return {**self.inertia, **law_constants(laws), **named_constants(of_case)}

    @property
    def warnings(self) -> list[str]:
        """A sentence on each resistance whose polynomial has a negative coefficient."""
        return [
            f"{name} has a negative coefficient: where {name}(tau) < 0 the torque feeds energy in"
            for name, coefficient in (("a", self.a), ("b", self.b))
            if isinstance(coefficient, tuple) and min(coefficient) < 0
        ]


@dataclass(frozen=True)
class Nutating(Top):
    """The base class of the averaged forms, which need a nutation of finite period: u2 < u3."""

    variables = {
        "Gz": Label(
            ("time",), "vertical component of the angular momentum", "moment of inertia / time"
        ),
        "H": Label(("time",), "energy", "moment of inertia / time^2"),
        "r": Label(("time",), "angular velocity about the axis of symmetry", "1/time"),
        **{f"u{i}": Label(("time",), f"root u{i} of the cubic of cos theta") for i in (1, 2, 3)},
    }

    def check_initial_data(self) -> None:
        """Also raises ValueError for a start without a period."""
        if not self.m1 > UNRESOLVED_M1:
            raise ValueError(
                "u2 = u3: the top is at, or tends to, an unstable equilibrium and has no period; "
                "form full takes it"
            )

    @property
    def m1(self) -> float:
        """1 - k^2 = (u3 - u2)/(u3 - u1) at the start; nan where rounding leaves no digit of it."""
        _, _, _, e, _, w = self.nutation
        return (w - e) / (w + e) if w + e else math.nan

    @property
    def warnings(self) -> list[str]:
        """With a sentence on a start near u2 = u3."""
        near = f"1 - k^2 = {self.m1:.1e} at the start: so near u2 = u3 the mean over a nutation"
        return [*super().warnings, *([f"{near} loses digits"] if self.m1 < ROUGH_M1 else [])]


def upright_stability(t: Any, y: Sequence[Any], k: Any) -> Any:
    """C^2 r^2 - 4 A mu, which is positive while an upright top is stable, as an event."""
    return k.C * k.C * y[2] * y[2] - 4 * k.A * coefficient_at(k, "mu", t)


@dataclass(frozen=True)
class AveragedTop(Nutating):
    """The Lagrange top under linear resistance that changes slowly with time, averaged over its
    nutation.

    dGz/dtau = -[a (Gz - C r v)/A + b r v] + m v
    dH/dtau = -[a (2 H - C r^2 - 2 mu v)/A + b r^2] + m r + mu' v
    C dr/dtau = m - b r
    v = <cos theta> = u3 - (u3 - u1) E(k)/K(k)

    Gz, H, r: vertical angular momentum, energy, angular velocity about the axis of symmetry
    (`initial`). A, C: equatorial and axial moments of inertia about the fixed point (`inertia`).
    u1 <= u2 <= 1 <= u3: roots of the cubic Q(cos theta), where cos theta runs from u1 to u2, and
    k^2 = (u2 - u1)/(u3 - u1). Functions of the time tau = epsilon t are mu, the largest restoring
    moment (`mu`), the coefficients of resistance a and b (`a`, `b`), and the torque m about the
    axis of symmetry (`m`), 0 in the source. Assumed: epsilon is small; the error is O(epsilon) on
    an interval of order 1/epsilon, while u2 < u3. A = C is allowed. The motion of an upright top,
    theta = 0, ends when it becomes unstable (event `upright_unstable`), where C^2 r^2 = 4 A mu.

    Source: L. D. Akulenko, Ya. S. Zinkevich, T. A. Kozachenko, D. D. Leshchenko, evolution of
    motions of a rigid body close to the Lagrange case under a non-stationary torque (2017), eqs
    (1.2)-(1.5), (2.4), (3.1).
    """

    # The state is r, U = Gz - C r, Z = 1 - (2 H - C r^2)/(2 mu) and e = (u2 - u1)/2. U and Z are 0
    # for an upright top. Every motion ends in regular precession, u1 = u2, where (3.5) divides by
    # zero. Here it is no singularity, because e' = e F with a regular F, and u1, u2 lose no digits.

    form = "averaged"
    state = ("U", "Z", "r", "e")

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """U', Z', r' and e'. The first three follow from eqs (2.4), with mu' v in dH/dtau.

        e' follows from the derivatives of the roots. It contains M(x)/e at x = X, with
        M(x) = T1' x^2 - T2' x - T3', where T1, T2, T3 are the coefficients of the cubic. M is of
        the order of e, and the division by e is done by hand here, so that regular precession,
        e = 0, is no singularity. For the part with mu' the division uses the cubic itself,
        (U + c X)^2/(2 A mu) = X (2 - X)(X - Z) - e^2 w with c = C r.
        """
        U, Z, r, e = y
        now = with_mu(k, t)
        (X, w), A, C, mu = nutation(y, now), now.A, now.C, now.mu
        change = slope_at(k, "mu", t) / mu if isinstance(k.mu, tuple) else 0.0
        # The equatorial torque is f (p, q). f_cos and M3_cos are f and M3 times the mean <cos phi>.
        f, M3, mean = -coefficient_at(k, "a", t), axial_torque(t, r, k), mean_cosine(e, w)
        mean_cos = -e * mean
        f_cos, M3_cos = f * mean_cos, M3 * mean_cos
        # u = 1 - x turns Gz - C r u into U + c x, and 2 H - C r^2 - 2 mu u into 2 mu (x - Z).
        c, G = C * r, U + C * r * X
        # fx is the mean of f x with x = 1 - u = X + e cos phi. By C r' = M3 the factor <u> of M3 in
        # Gz' becomes <u> - 1 = -<x> in U', and M3 drops out of Z'.
        fx = X * f + e * f_cos
        dU = (U * f + c * fx) / A - X * M3 - e * M3_cos
        dZ = -2 * (fx - Z * f) / A + change * (X - Z - e * e * mean)
        # The rate T1', M(X)/e, and the derivative of M by x at X.
        dT1 = -c * M3 / (A * mu) + change * c * c / (2 * A * mu)
        M = 2 / A * (e * w * f + (X * (2 - X) - c * G / (2 * A * mu)) * f_cos)
        M = M + G * M3_cos / (A * mu) + change * e * (mean * X * (2 - X) - w)
        slope = -(c * (dU + M3 * X) + G * M3) / (A * mu) + change * c * G / (A * mu)
        slope = 2 * dZ * (X - 1) + slope
        # Singular only at w = e, where u2 = u3 and the period of a nutation is infinite.
        de = (w * (M + e * (dZ + dT1)) - e * slope) / (2 * (w - e) * (w + e))
        return dU, dZ, M3 / C, de

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        """Gz, H, r and the roots, from the state (U, Z, r, e)."""
        k = with_mu(k, t)
        U, Z, r, e = y.T
        # Complex numbers, because w is 0 where an upright top becomes unstable, and rounding may
        # make w^2 negative there.
        X, w = (value.real for value in nutation([*(y.T + 0j)], k))
        return {
            "Gz": U + k.C * r,
            "H": k.mu * (1 - Z) + k.C * r * r / 2,
            "r": r,
            "u1": 1 - X - e,
            "u2": 1 - X + e,
            "u3": 1 - X + w,
        }

    @property
    def start(self) -> tuple[float, ...]:
        """U, Z, r and e at the start."""
        return self.nutation[:4]

    @property
    def run_events(self) -> tuple[Event, ...]:
        """A top that starts upright stays so. Its averaged motion ends where it becomes
        unstable."""
        _, Z, _, e, _, _ = self.nutation
        is_upright = Z == e == 0
        return (Event("upright_unstable", upright_stability, True),) if is_upright else ()


@dataclass(frozen=True)
class AveragedU(Nutating):
    """The averaged equations for the roots u1, u2, u3, eq. (3.5) as printed; for comparison.

    du1/dtau = -1/(A Delta) {a [(Gz - C r u1)(Gz - C r v)/A + (u1^2 - 1)(2 H - C r^2 - 2 mu v)]
                             + b r (Gz - C r u1)(v - u1)}
    Delta = mu (u1 - u2)(u1 - u3), and cyclically

    The symbols are those of the form averaged. Every motion tends to regular precession, u1 = u2,
    where Delta vanishes; the solution loses its digits on the way. Gz and H follow from eqs (1.5),
    with r from (3.3). The inverse (2.5) is not used, because the signs of its R and delta change
    during a motion. This form needs r != 0.

    Source: L. D. Akulenko et al. 2017, eqs (1.5), (3.3), (3.5).
    """

    form = "averaged-u"
    state = ("u1", "u2", "u3", "r")

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Further mistakes: m and a polynomial mu, which the other forms take."""
        yield from super().check(data)
        mu_words = f"form {cls.form} takes a constant mu; averaged and full take a polynomial"
        m_words = f"form {cls.form} has no m, which all other forms have"
        yield from mistakes_where(
            (is_law(data.get("mu")), ("mu",), mu_words),
            (data.get("m") is not None, ("m",), m_words),
        )

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """u1', u2', u3' by eq. (3.5), and r'."""
        u1, u2, u3, r = y
        A, c, mu = k.A, k.C * r, k.mu
        Gz, H = integrals_from_roots(y, k)
        a, b = coefficient_at(k, "a", t), coefficient_at(k, "b", t)
        s, e = (u1 + u2) / 2, (u2 - u1) / 2
        v = s + e * e * mean_cosine(e, u3 - s)

        def rate(u: Any, delta: Any) -> Any:
            # Eq. (3.5) for one root u. The three roots differ in u and Delta = mu delta only.
            equatorial = (Gz - c * u) * (Gz - c * v) / A + (u * u - 1) * (
                2 * H - c * r - 2 * mu * v
            )
            return -(a * equatorial + b * r * (Gz - c * u) * (v - u)) / (A * mu * delta)

        return (
            rate(u1, (u1 - u2) * (u1 - u3)),
            rate(u2, (u2 - u3) * (u2 - u1)),
            rate(u3, (u3 - u1) * (u3 - u2)),
            -b * r / k.C,
        )

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        """The roots and r of the state, and Gz and H from these."""
        u1, u2, u3, r = y.T
        Gz, H = integrals_from_roots([*y.T], k)
        return {"Gz": Gz, "H": H, "r": r, "u1": u1, "u2": u2, "u3": u3}

    def check_initial_data(self) -> None:
        """Also raises ValueError for r = 0 and for regular precession, u1 = u2."""
        super().check_initial_data()
        _, _, r, e, _, _ = self.nutation
        if not (r and e):
            raise ValueError(
                f"form {self.form} divides by r and by u2 - u1, and one is 0; "
                "form averaged does not"
            )

    @property
    def start(self) -> tuple[float, ...]:
        """u1, u2, u3 and r at the start."""
        _, _, r, e, X, w = self.nutation
        return 1 - X - e, 1 - X + e, 1 - X + w, r

    @property
    def extended_start(self) -> np.ndarray:
        """The roots in long double, because they cancel in Gz and H of a fast or a slow top."""
        y = np.array(self.nutation[:4], dtype=np.longdouble)
        X, w = nutation([*y], attributes(self.constants, np.longdouble))
        return np.array([1 - X - y[3], 1 - X + y[3], 1 - X + w, y[2]])


def integrals_from_roots(y: Sequence[Any], k: Any) -> tuple[Any, Any]:
    """Gz and H from the state (u1, u2, u3, r), by the second and the first of eqs (1.5)."""
    u1, u2, u3, r = y
    c = k.C * r
    Gz = k.A * k.mu * (1 + u1 * u2 + u1 * u3 + u2 * u3) / c
    return Gz, k.mu * (u1 + u2 + u3) + c * r / 2 - c * c / (2 * k.A)


@dataclass(frozen=True)
class FullTop(Top):
    """The Lagrange top under a perturbing torque: the full equations, which the others average.

    A p' + (C - A) q r = mu gamma2 + epsilon M1
    A q' + (A - C) p r = -mu gamma1 + epsilon M2
    C r' = epsilon M3
    gamma' = gamma x omega

    p, q, r: angular velocity in body axes, 1/time. gamma: the vertical in body axes,
    (sin theta sin phi, sin theta cos phi, cos theta). The equations use gamma and not the Euler
    angles, which are singular at theta = 0 and pi. M = (-a p, -a q, m - b r) is the torque. The
    derivative is by t = tau/epsilon (`epsilon`), the stored time is tau. The other symbols are
    those of the form averaged. With `theta` the motion starts there, at phi = 0 and p = q = 0. With
    Gz, H and r it starts at phi = 0 and cos theta = (u1 + u2)/2, where theta grows; motions with
    equal Gz, H and r differ in phase alone.

    Source: L. D. Akulenko et al. 2017, eqs (1.1).
    """

    epsilon: float

    form = "full"
    keys = Top.keys | {"epsilon": Key(Number(above=0), "small parameter: tau = epsilon t")}
    state = ("p", "q", "r", "gamma1", "gamma2", "gamma3")
    variables = {
        "omega": Label(("time", "axis"), "angular velocity in body axes", "1/time"),
        "gamma": Label(("time", "axis"), "the vertical in body axes"),
    }

    @staticmethod
    def quaternion_factor(k: Any) -> Any:
        """1/epsilon, because the derivatives in `rhs` are by tau."""
        return 1 / k.epsilon

    def attitude_at(self, start: np.ndarray) -> tuple[Any, ...]:
        """The rotation by theta about x1, for which phi = psi = 0 and z is the vertical."""
        theta = math.atan2(start[4], start[5])
        return math.cos(theta / 2), math.sin(theta / 2), 0.0, 0.0

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """Euler's equations and gamma' = gamma x omega, as derivatives by tau."""
        p, q, r, g1, g2, g3 = y
        now = with_mu(k, t)
        A, C, mu, eps = k.A, k.C, now.mu, k.epsilon
        f, M3 = -coefficient_at(now, "a", t), axial_torque(t, r, now)
        return (
            # Derivatives by tau = eps t: the terms of free motion are divided by eps, and the eps
            # of the torque drops out.
            ((A - C) * q * r + mu * g2) / (A * eps) + f * p / A,
            ((C - A) * p * r - mu * g1) / (A * eps) + f * q / A,
            M3 / C,
            (g2 * r - g3 * q) / eps,
            (g3 * p - g1 * r) / eps,
            (g1 * q - g2 * p) / eps,
        )

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        """omega and gamma of the state."""
        return {"omega": y[:, :3], "gamma": y[:, 3:]}

    @cached_property
    def constants(self) -> Constants:
        """Also epsilon."""
        return {**super().constants, "epsilon": self.epsilon}

    @property
    def start(self) -> tuple[float, ...]:
        """The start at phi = 0: at the given theta, or at cos theta = (u1 + u2)/2 with growing
        theta."""
        theta, (U, Z, r, _, X, _) = self.initial["theta"], self.nutation
        if theta is not None:
            return 0.0, 0.0, r, 0.0, sin(theta), cos(theta)
        A, C = self.inertia["A"], self.inertia["C"]
        # x = 1 - cos theta, which rounding may bring out of its range for an upright top.
        x = min(max(X, 0.0), 2.0)
        sine = sqrt(x * (2 - x))
        q = (U + C * r * x) / (A * sine) if sine else 0.0
        p = sqrt(max(2 * self.mu_at_start * (x - Z) / A - q * q, 0.0))
        return p, q, r, 0.0, sine, 1 - x

    @property
    def extended_start(self) -> np.ndarray:
        """The start with the sine and cosine of a given theta in long double."""
        y, theta = super().extended_start, self.initial["theta"]
        # The sine and cosine of theta anew, because as doubles they are rounded.
        if theta is not None:
            y[4:6] = np.sin(np.longdouble(theta)), np.cos(np.longdouble(theta))
        return y
