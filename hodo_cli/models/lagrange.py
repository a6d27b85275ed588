"""The Lagrange top under a small torque that changes slowly with time."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..arithmetic import as_float, as_numpy_float, cos, isfinite, sin, sqrt
from ..schema.kinds import (
    Angle,
    Choice,
    Either,
    Integer,
    Key,
    ListOf,
    Mistake,
    Number,
    Table,
    Variant,
)
from .base import Constants, Event, Label, Model, mistake_of
from .constants import attributes

NEAR, TOO_NEAR = 1e-8, 1e-14
"""The 1 - k^2 below which the averaged forms have lost half their digits, and all."""

MOST_NODES, UNRESOLVED = 1000, 1e-12
"""The nodes beyond which no quadrature is refined, and the error of one that is worth a word."""

ROOT_ROUNDING = 1e-13
"""How far below 0 the rounding of Gz, H and r may bring ((u2 - u1)/2)^2."""

LAW = Either(
    ListOf(Number(), alone=True, title="a number, or a polynomial in tau: [a0, a1, ...]"),
    Variant(
        "law",
        {
            "exponential": {
                "value": Key(Number(), "value at tau = 0", "moment of inertia / time"),
                "rate": Key(Number(), "the law is value exp(-rate tau)"),
            },
            "power": {
                "value": Key(Number(), "value at tau = 0", "moment of inertia / time"),
                "rate": Key(Number(least=0), "the law is value (1 + rate tau)^exponent"),
                "exponent": Key(Number(), "the law is value (1 + rate tau)^exponent"),
            },
        },
        "which law",
    ),
)
"""A function of tau: a constant, the coefficients of 1, tau, tau^2, ..., or a law of LAWS with its
parameters."""


def polynomial_law(c: Sequence[Any], tau: Any) -> Any:
    """c0 + c1 tau + c2 tau^2 + ..."""
    total = c[-1]
    for coefficient in c[-2::-1]:
        total = coefficient + tau * total
    return total


def exponential_law(c: Sequence[Any], tau: Any) -> Any:
    """value exp(-rate tau), from (value, rate, e)."""
    # e comes as a constant, because equations know + - * / and ** only, and no exp.
    value, rate, e = c
    return value * e ** (-rate * tau)


def power_law(c: Sequence[Any], tau: Any) -> Any:
    """value (1 + rate tau)^exponent, from (value, rate, exponent)."""
    value, rate, exponent = c
    return value * (1 + rate * tau) ** exponent


LAWS = {"polynomial": polynomial_law, "exponential": exponential_law, "power": power_law}


def law(given: Any) -> tuple[str, tuple[float, ...]]:
    """The name and the numbers of a law as given in a case."""
    if not isinstance(given, Mapping):
        return "polynomial", tuple(given)
    name, *numbers = (given[key] for key in ("law", "value", "rate", "exponent") if key in given)
    return name, (*numbers, math.e) if name == "exponential" else tuple(numbers)


def linear_dissipation(tau: Any, Gz: Any, H: Any, r: Any, u: Any, k: Any) -> tuple[Any, Any]:
    """M = (-a p, -a q, -b r), eq. (3.1)."""
    return -LAWS[k.a_law](k.a, tau), -LAWS[k.b_law](k.b, tau) * r


def cubic_dissipation(tau: Any, Gz: Any, H: Any, r: Any, u: Any, k: Any) -> tuple[Any, Any]:
    """M = |omega|^2 (-a p, -a q, -b r)."""
    f, M3 = linear_dissipation(tau, Gz, H, r, u, k)
    square = (2 * (H - k.mu * u) - k.C * r * r) / k.A + r * r
    return square * f, square * M3


Perturbation = Callable[..., tuple[Any, Any]]

PERTURBATIONS: dict[str, Perturbation] = {
    "linear-dissipation": linear_dissipation,
    "cubic-dissipation": cubic_dissipation,
}
"""Torques epsilon (p f, q f, M3), eq. (2.3): each returns (f, M3), both functions of tau, Gz, H, r
and u = cos theta.

To add one, write it with + - * / and ** and name it here; the forms averaged-quadrature and full
take it.
"""


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
    y: Sequence[Any], k: Any, means: Sequence[Any], shape: tuple[Any, Any]
) -> tuple[Any, ...]:
    """dy/dtau of the state (U, Z, r, e) from the means <f>, <f cos phi>, <M3>, <M3 cos phi> over
    one nutation.

    The symbols are those of `AveragedTop`. U, Z and r follow from eqs (2.4). e follows from the
    roots' own derivatives, with M(x) = T1' x^2 - T2' x - T3' at x = X divided by e by hand, so that
    regular precession, e = 0, is as regular as any other motion.
    """
    U, Z, r, e = y
    X, w = shape
    f, f_cos, M3, M3_cos = means
    A, C, mu = k.A, k.C, k.mu
    # u = 1 - x turns Gz - C r u into U + c x, and 2 H - C r^2 - 2 mu u into 2 mu (x - Z).
    c, G = C * r, U + C * r * X
    # <f x> with x = X + e cos phi; U and Z lose their terms in M3 to C r' = M3.
    fx = X * f + e * f_cos
    dU = (U * f + c * fx) / A - X * M3 - e * M3_cos
    dZ = -2 * (fx - Z * f) / A
    # From here on: the derivatives of the coefficients of the cubic, and by them that of e.
    dT1 = dZ - c * M3 / (A * mu)
    M = 2 / A * (e * w * f + (X * (2 - X) - c * G / (2 * A * mu)) * f_cos) + G * M3_cos / (A * mu)
    slope = 2 * dZ * (X - 1) - (c * (dU + M3 * X) + G * M3) / (A * mu)
    # Singular only at w = e, that is u2 = u3, where a nutation takes for ever.
    de = (w * (M + e * dT1) - e * slope) / (2 * (w - e) * (w + e))
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
        e = root_spread(Z - excess, 2 * c * U / scale + 2 * Z, U * U / scale)
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


def root_spread(T1: Any, T2: Any, T3: Any) -> Any:
    """e = (u2 - u1)/2 from the coefficients of the cubic for y = u3 - 1: y^3 + T1 y^2 + T2 y = T3.

    Raises ValueError if u1 and u2 are not real numbers from -1 to 1: there is no such motion. What
    the rounding of the data does to a double root is forgiven.
    """
    # Cauchy's bound. From above, Newton's method falls to the largest root and stops where rounding
    # stops the fall.
    y = 1 + max(abs(T1), abs(T2), T3)
    while (slope := (3 * y + 2 * T1) * y + T2) > 0 and (
        lower := y - (((y + T1) * y + T2) * y - T3) / slope
    ) < y:
        y = lower
    # x1 x2 and x1 + x2: by a division where y is large, without one where it is small.
    product = T3 / y if y > 1 else T2 + (T1 + y) * y
    X = (product - T2) / (2 * y) if y > 1 else (T1 + y) / 2
    d = X * X - product
    e, slack = sqrt(max(d, 0.0)), math.sqrt(ROOT_ROUNDING)
    if d >= -ROOT_ROUNDING and -slack <= X - e and X + e <= 2 + slack:
        return e
    raise ValueError("no motion has these Gz, H and r: -1 <= u1 <= u2 <= 1 cannot be met")


INTEGRAL_LABELS = {
    "Gz": Label(("time",), "vertical component of the angular momentum"),
    "H": Label(("time",), "energy"),
    "r": Label(("time",), "angular velocity about the axis of symmetry"),
}
ROOT_LABELS = {f"u{i}": Label(("time",), f"root u{i} of the cubic of cos theta") for i in (1, 2, 3)}


PERTURBATION = Key(
    Choice(*PERTURBATIONS), "form of the torque M = (p f, q f, M3)", default="linear-dissipation"
)


@dataclass(frozen=True)
class Top(Model):
    """What the forms share: the keys and their checks."""

    inertia: Mapping[str, float]
    mu: float
    a: tuple[float, ...] | Mapping[str, Any]
    b: tuple[float, ...] | Mapping[str, Any]
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
            Number(above=0),
            "largest restoring moment (heavy top: m g l)",
            "moment of inertia / time^2",
        ),
        "a": Key(LAW, "equatorial coefficient of resistance a(tau)", "moment of inertia / time"),
        "b": Key(LAW, "axial coefficient of resistance b(tau)", "moment of inertia / time"),
        "initial": Key(
            Table(
                {
                    "theta": Key(Angle(), "angle of nutation, with p = q = 0", "rad", None),
                    "r": Key(Number(), "angular velocity about the axis of symmetry", "1/time"),
                    "Gz": Key(
                        Number(), "vertical angular momentum", "moment of inertia / time", None
                    ),
                    "H": Key(Number(), "energy", "moment of inertia / time^2", None),
                }
            ),
            "initial theta and r (p = q = 0), or Gz, H and r",
        ),
    }
    no_axis_reason = (
        "gravity turns G in space, so no separatrix of free motion divides its hodographs"
    )

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        inertia = data.get("inertia")
        if inertia and inertia["C"] > 2 * inertia["A"]:
            limit = f"2 A = {2 * inertia['A']:g}"
            yield ("inertia", "C"), f"no body has C = {inertia['C']:g} larger than {limit}"
        if {"inertia", "mu", "initial"} <= set(data):
            # Neither the start nor what a form asks of it depends on the keys that may be missing.
            top = cls(**{**dict.fromkeys(cls.keys), **data})
            yield from mistake_of(("initial",), top.refuse_start)

    def refuse_start(self) -> None:
        """Raise ValueError, with a sentence, if no motion of this form has these initial data."""
        _ = self.nutation

    @cached_property
    def nutation(self) -> Nutation:
        """The start, and the nutation there."""
        return nutation_at_start(self.inertia, self.mu, self.initial)

    @cached_property
    def constants(self) -> Constants:
        a_law, a = law(self.a)
        b_law, b = law(self.b)
        coefficients: Constants = {"a": a, "b": b, "a_law": a_law, "b_law": b_law}
        return {**self.inertia, "mu": self.mu, **coefficients}

    @property
    def warnings(self) -> list[str]:
        return [
            f"{name} has a negative coefficient: where {name}(tau) < 0 the torque feeds energy in"
            for name, given in (("a", self.a), ("b", self.b))
            if (given["value"] if isinstance(given, Mapping) else min(given)) < 0
        ]


@dataclass(frozen=True)
class Nutating(Top):
    """What the averaged forms share: they need a nutation of finite period, hence u2 < u3."""

    variables = INTEGRAL_LABELS | ROOT_LABELS

    def refuse_start(self) -> None:
        if not self.separation > TOO_NEAR:
            raise ValueError(
                "u2 = u3: the top is at, or tends to, an unstable equilibrium and has no period; "
                "form full takes it"
            )

    @property
    def separation(self) -> float:
        """1 - k^2 = (u3 - u2)/(u3 - u1) at the start; not a number where no digit of it is left."""
        e, w = self.nutation.e, self.nutation.w
        return (w - e) / (w + e) if w + e else math.nan

    @property
    def warnings(self) -> list[str]:
        if not self.separation < NEAR:
            return super().warnings
        return [
            *super().warnings,
            f"1 - k^2 = {self.separation:.1e} at the start: "
            "so near u2 = u3 the mean over a nutation loses digits",
        ]


def upright_stability(t: Any, y: Sequence[Any], k: Any) -> Any:
    """C^2 r^2 - 4 A mu: positive while a top that turns upright is stable."""
    return k.C * k.C * y[2] * y[2] - 4 * k.A * k.mu


@dataclass(frozen=True)
class AveragedTop(Nutating):
    """The Lagrange top under linear resistance that changes slowly with time, averaged over its
    nutation.

    dGz/dtau = -[a (Gz - C r v)/A + b r v]
    dH/dtau = -[a (2 H - C r^2 - 2 mu v)/A + b r^2]
    dr/dtau = -b r/C
    v = <cos theta> = u3 - (u3 - u1) E(k)/K(k)

    Gz, H, r: vertical angular momentum, energy, angular velocity about the axis of symmetry
    (`initial`); u1 <= u2 <= 1 <= u3: roots of the cubic Q(cos theta), cos theta running from u1 to
    u2, and k^2 = (u2 - u1)/(u3 - u1); A, C: equatorial and axial moments of inertia about the fixed
    point (`inertia`); mu: largest restoring moment (`mu`); a, b: coefficients of resistance,
    functions of tau (`a`, `b`); tau = epsilon t is the time. Assumed: epsilon small; right to
    O(epsilon) on an interval of order 1/epsilon, while u2 < u3. A = C is allowed: no formula
    divides by A - C. An upright top, theta = 0, ends when it becomes unstable (event
    `upright_unstable`): where C^2 r^2 = 4 A mu.

    The state is U = Gz - C r and Z = 1 - (2 H - C r^2)/(2 mu), both 0 for an upright top, r, and e
    = (u2 - u1)/2, which obeys e' = e F with F regular: so regular precession (u1 = u2, where every
    motion ends and (3.5) divides by zero) is no singularity, and u1, u2 lose no digits. With x = 1
    - cos theta = X + e cos phi, X = 1 - (u1 + u2)/2 and w = u3 - (u1 + u2)/2 the time is dt ~
    dphi/sqrt(w + e cos phi).

    Source: L. D. Akulenko, Ya. S. Zinkevich, T. A. Kozachenko, D. D. Leshchenko, evolution of
    motions of a rigid body close to the Lagrange case under a non-stationary torque (2017), eqs
    (1.2)-(1.5), (2.4), (3.1).
    """

    form = "averaged"
    state = ("U", "Z", "r", "e")

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        r, e = y[2], y[3]
        X, w = nutation(y, k)
        a, b = LAWS[k.a_law](k.a, t), LAWS[k.b_law](k.b, t)
        towards_u2 = e * mean_cosine(e, w)
        return drift(y, k, (-a, a * towards_u2, -b * r, b * r * towards_u2), (X, w))

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        U, Z, r, e = y.T
        # w is 0 where an upright top becomes unstable, and rounding may bring w^2 below.
        X, w = (value.real for value in nutation([*(y.T + 0j)], k))
        H = k.mu * (1 - Z) + k.C * r * r / 2
        return {
            "Gz": U + k.C * r,
            "H": H,
            "r": r,
            "u1": 1 - X - e,
            "u2": 1 - X + e,
            "u3": 1 - X + w,
        }

    @property
    def start(self) -> tuple[float, ...]:
        U, Z, r, e, _, _ = self.nutation
        return U, Z, r, e

    @property
    def run_events(self) -> tuple[Event, ...]:
        """For a top that starts upright: it stays so, and the averages end where it becomes
        unstable."""
        if not self.nutation.Z == self.nutation.e == 0:
            return ()
        return (Event("upright_unstable", upright_stability, terminal=True),)


@dataclass(frozen=True)
class AveragedU(Nutating):
    """The averaged equations for the roots u1, u2, u3, eq. (3.5) as printed; for comparison.

    du1/dtau = -1/(A Delta) {a [(Gz - C r u1)(Gz - C r v)/A + (u1^2 - 1)(2 H - C r^2 - 2 mu v)]
                             + b r (Gz - C r u1)(v - u1)}
    Delta = mu (u1 - u2)(u1 - u3), and cyclically

    The symbols are those of the form averaged. Delta vanishes at regular precession, u1 = u2, to
    which every motion tends, and the solution loses its digits on the way. Gz and H follow from eqs
    (1.5), with r from (3.3), and not from the inverse (2.5), whose signs of R and delta change in
    mid-motion. It needs r != 0.

    Source: L. D. Akulenko et al. 2017, eqs (1.5), (3.3), (3.5).
    """

    form = "averaged-u"
    state = ("u1", "u2", "u3", "r")

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        u1, u2, u3, r = y
        A, c, mu = k.A, k.C * r, k.mu
        Gz, H = integrals_from_roots(y, k)
        a, b = LAWS[k.a_law](k.a, t), LAWS[k.b_law](k.b, t)
        s, e = (u1 + u2) / 2, (u2 - u1) / 2
        v = s + e * e * mean_cosine(e, u3 - s)

        def rate(u: Any, delta: Any) -> Any:
            # The bracket of (3.5), the same for the three roots but for u and Delta.
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
    def output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        u1, u2, u3, r = y.T
        Gz, H = integrals_from_roots([*y.T], k)
        return {"Gz": Gz, "H": H, "r": r, "u1": u1, "u2": u2, "u3": u3}

    def refuse_start(self) -> None:
        super().refuse_start()
        if not (self.nutation.r and self.nutation.e):
            raise ValueError(
                f"form {self.form} divides by r and by u2 - u1, and one is 0; "
                "form averaged does not"
            )

    @property
    def start(self) -> tuple[float, ...]:
        _, _, r, e, X, w = self.nutation
        return 1 - X - e, 1 - X + e, 1 - X + w, r

    @property
    def extended_start(self) -> np.ndarray:
        # Gz and H come from sums of the roots that nearly cancel, as those of a fast or a slow top.
        y = np.array(self.nutation[:4], dtype=np.longdouble)
        X, w = nutation([*y], attributes(self.constants, np.longdouble))
        return np.array([1 - X - y[3], 1 - X + y[3], 1 - X + w, y[2]])


def integrals_from_roots(y: Sequence[Any], k: Any) -> tuple[Any, Any]:
    """Gz and H from (u1, u2, u3, r): the second and the first of eqs (1.5)."""
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

    p, q, r: angular velocity in body axes, 1/time; gamma: the vertical in body axes, (sin theta sin
    phi, sin theta cos phi, cos theta), in place of the Euler angles, which are singular at theta =
    0 and pi; M = (p f, q f, M3) (`perturbation`: (-a p, -a q, -b r) is linear-dissipation, that
    times |omega|^2 cubic-dissipation); the derivative is by t = tau/epsilon (`epsilon`), the stored
    time is tau. The other symbols are those of the form averaged. With `theta` the motion starts
    there, at phi = 0 and p = q = 0. Of the motions with initial Gz, H and r, which differ in phase,
    that is taken which starts at phi = 0 and cos theta = (u1 + u2)/2, where theta grows.

    Source: L. D. Akulenko et al. 2017, eqs (1.1).
    """

    epsilon: float
    perturbation: str

    form = "full"
    keys = Top.keys | {
        "epsilon": Key(Number(above=0), "small parameter: tau = epsilon t"),
        "perturbation": PERTURBATION,
    }
    state = ("p", "q", "r", "gamma1", "gamma2", "gamma3")
    variables = {
        "omega": Label(("time", "axis"), "angular velocity in body axes"),
        "gamma": Label(("time", "axis"), "the vertical in body axes"),
    }

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        p, q, r, g1, g2, g3 = y
        A, C, mu, eps = k.A, k.C, k.mu, k.epsilon
        f, M3 = PERTURBATIONS[k.perturbation](t, *first_integrals(y[:3], y[3:], k), r, g3, k)
        return (
            # By tau = eps t: the free motion is divided by eps, and the eps of the torque drops
            # out.
            ((A - C) * q * r + mu * g2) / (A * eps) + f * p / A,
            ((C - A) * p * r - mu * g1) / (A * eps) + f * q / A,
            M3 / C,
            (g2 * r - g3 * q) / eps,
            (g3 * p - g1 * r) / eps,
            (g1 * q - g2 * p) / eps,
        )

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        return {"omega": y[:, :3], "gamma": y[:, 3:]}

    @cached_property
    def constants(self) -> Constants:
        return {
            **super().constants,
            "epsilon": self.epsilon,
            "perturbation": self.perturbation,
        }

    @property
    def start(self) -> tuple[float, ...]:
        theta, r = self.initial["theta"], self.nutation.r
        if theta is not None:
            return 0.0, 0.0, r, 0.0, sin(theta), cos(theta)
        A, C = self.inertia["A"], self.inertia["C"]
        # Rounding may put an upright top a little beyond the pole.
        x = min(max(self.nutation.X, 0.0), 2.0)
        sine = sqrt(x * (2 - x))
        q = (self.nutation.U + C * r * x) / (A * sine) if sine else 0.0
        p = sqrt(max(2 * self.mu * (x - self.nutation.Z) / A - q * q, 0.0))
        return p, q, r, 0.0, sine, 1 - x


@dataclass(frozen=True)
class AveragedQuadrature(AveragedTop):
    """The averaged top under any torque M = (p f, q f, M3), f and M3 functions of tau, Gz, H, r and
    theta.

    dGz/dtau = <f (Gz - C r u)/A + M3 u>
    dH/dtau = <f (2 H - C r^2 - 2 mu u)/A + M3 r>
    dr/dtau = <M3>/C

    <.> is the mean over one nutation, u = cos theta. M = (-a p, -a q, -b r) is `perturbation:
    linear-dissipation`, that times |omega|^2 is `cubic-dissipation`; the state and the other
    symbols are those of the form averaged. The integrand is periodic in phi and analytic, so that
    the sum over n points of a half turn is right to about [(w + sqrt(w^2 - e^2))/e]^(4 - 2 n). It
    begins with `nodes` points, and where a motion comes so near to u2 = u3 that this is more than
    the tolerance, it is integrated again with twice as many.

    Source: L. D. Akulenko et al. 2017, eqs (2.3), (2.4), (2.8).
    """

    perturbation: str
    nodes: int

    form = "averaged-quadrature"
    keys = Top.keys | {
        "perturbation": PERTURBATION,
        "nodes": Key(
            Integer(least=2, most=MOST_NODES),
            "nodes of the quadrature over half a nutation; doubled until they meet the tolerance",
            default=32,
        ),
    }

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        U, Z, r, e = y
        X, w = nutation(y, k)
        Gz, H = U + k.C * r, k.mu * (1 - Z) + k.C * r * r / 2
        # dt ~ dphi/sqrt(w + e cos phi); the midpoints of a half turn serve a whole one, since all
        # is even in phi.
        weights = [1 / (w + e * cos) ** 0.5 for cos in k.cosines]
        torques = [
            PERTURBATIONS[k.perturbation](t, Gz, H, r, 1 - X - e * cos, k) for cos in k.cosines
        ]
        period = sum(weights)
        means = [
            sum(
                weight * values[i] * factor
                for weight, values, factor in zip(weights, torques, factors, strict=True)
            )
            for i in (0, 1)
            for factors in ([1] * len(weights), k.cosines)
        ]
        return drift(y, k, [mean / period for mean in means], (X, w))

    @cached_property
    def constants(self) -> Constants:
        n = self.nodes
        # Numbers, not a function of the equations: an engine's symbols would evaluate the cosine at
        # every step.
        cosines = tuple(math.cos((i + 0.5) * math.pi / n) for i in range(n))
        return {**super().constants, "perturbation": self.perturbation, "cosines": cosines}

    @property
    def refined_data(self) -> dict[str, Any]:
        # An error of the quadrature, exp(-c nodes), is seen as a whole with twice as many.
        return {"nodes": 2 * self.nodes}

    @staticmethod
    def is_accurate(y: np.ndarray, k: SimpleNamespace, tol: float) -> Any:
        return (quadrature_remainder(y, k) <= tol) | (len(k.cosines) >= MOST_NODES)

    def validity_warnings(self, t: np.ndarray, y: np.ndarray, tol: float) -> list[str]:
        remainder = quadrature_remainder(y.T, SimpleNamespace(**self.constants))
        worst = int(np.argmax(remainder))
        if remainder[worst] <= max(tol, UNRESOLVED):
            return []
        return [
            f"near u2 = u3, at tau = {t[worst]:.6g}, even {self.nodes} nodes are right to "
            f"{remainder[worst]:.0e} only"
        ]


def quadrature_remainder(y: np.ndarray, k: SimpleNamespace) -> np.ndarray:
    """The error (n,) of the quadrature at states y (4, n), relative to its means; 0 where a state
    is out of range, which no nodes would mend."""
    with np.errstate(all="ignore"):
        _, w = nutation([*y], k)
        near = np.arccosh(np.maximum(w / np.abs(y[3]), 1))
    # The torques are polynomials of u, of degree 3 at most, and cost so many of the 2 n orders.
    return np.asarray(np.nan_to_num(np.exp((4 - 2 * len(k.cosines)) * near)))
