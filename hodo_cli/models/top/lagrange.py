"""The Lagrange top under a small torque that changes slowly with time."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...arithmetic import cos, sin, sqrt
from ...schema.kinds import Angle, Key, Mistake, Number, Rate, Table
from ..base import CONSTANTS_KEY, Constants, Event, Label, Model, attributes, mistake_of
from ..terms.time_laws import (
    CONSTANTS,
    coefficient_at,
    coefficient_kind,
    expressions_of,
    is_law,
    law_constants,
    least_value,
    length_mistakes,
    named_constants,
    resolved,
    slope_at,
    value_at,
    value_mistakes,
)
from .nutation import (
    LAW,
    Nutation,
    axial_torque,
    drift,
    mean_cosine,
    nutation,
    nutation_at_start,
    with_mu,
)

ROUGH_M1, UNRESOLVED_M1 = 1e-8, 1e-14
"""The 1 - k^2 below which the averaged forms have lost half their digits, and all."""

LAW_KEYS = ("mu", "m", "a", "b")
"""The keys of coefficients that may follow laws of time."""


@dataclass(frozen=True)
class Top(Model):
    """What the forms share: the keys and their checks."""

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
            coefficient_kind(above=0, polynomial="tau", expression=False),
            "largest restoring moment (heavy top: mass g l); forms averaged and full take a "
            "polynomial, the others a number alone, from `defaults:` too",
            "moment of inertia / time^2",
        ),
        "m": Key(
            coefficient_kind(polynomial="tau"),
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
    has_changing_mu: ClassVar[bool] = True
    has_axial_torque: ClassVar[bool] = True
    no_axis_reason = (
        "gravity turns G in space, so no separatrix of free motion divides its hodographs"
    )

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """What no body and no start of a form can be, and laws that a form does not take."""
        inertia = data.get("inertia")
        if inertia and inertia["C"] > 2 * inertia["A"]:
            yield (
                ("inertia", "C"),
                f"no body has C = {inertia['C']:g} larger than 2 A = {2 * inertia['A']:g}",
            )
        if is_law(data.get("mu")) and not cls.has_changing_mu:
            yield (
                ("mu",),
                f"form {cls.form} takes a constant mu; averaged and full take a polynomial",
            )
        if data.get("m") is not None and not cls.has_axial_torque:
            yield ("m",), f"form {cls.form} has no m, which all other forms have"
        if {"inertia", "mu", "initial"} <= set(data):
            # Neither the start nor what a form asks of it depends on the keys that may be missing.
            known = {**dict.fromkeys(cls.keys), **data}
            top = cls(**{name: x for name, x in known.items() if name != CONSTANTS_KEY})
            yield from mistake_of(("initial",), top.refuse_start)

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        yield from length_mistakes(data, LAW_KEYS)
        known = {"t": start, **(data.get(CONSTANTS_KEY) or {})}
        yield from value_mistakes(expressions_of({name: data[name] for name in LAW_KEYS}), known)
        if not is_law(data["mu"]):
            return
        if start:
            yield (
                ("mu",),
                "a polynomial of mu begins with the initial data: take time.start 0, or an epoch",
            )
        elif (least := least_value(data["mu"], start, end)) <= 0:
            yield ("mu",), f"mu falls to {least:.6g} in the span, and has to stay positive"

    def refuse_start(self) -> None:
        """Raise ValueError, with a sentence, if no motion of this form has these initial data."""
        _ = self.nutation

    @property
    def mu_at_start(self) -> Any:
        """mu at tau = 0."""
        return value_at(self.mu, 0.0)

    @cached_property
    def nutation(self) -> Nutation:
        """The start, and the nutation there."""
        return nutation_at_start(self.inertia, self.mu_at_start, self.initial)

    @cached_property
    def constants(self) -> Constants:
        constants: dict[str, Any] = {**self.inertia}
        for name in LAW_KEYS:
            if (coefficient := getattr(self, name)) is not None:
                law = resolved(coefficient, self.case_constants)
                constants |= law_constants(name, law)
        return constants | named_constants(self.case_constants)

    @property
    def warnings(self) -> list[str]:
        return [
            f"{name} has a negative coefficient: where {name}(tau) < 0 the torque feeds energy in"
            for name, coefficient in (("a", self.a), ("b", self.b))
            if isinstance(coefficient, tuple) and min(coefficient) < 0
        ]


@dataclass(frozen=True)
class Nutating(Top):
    """What the averaged forms share: they need a nutation of finite period, hence u2 < u3."""

    variables = {
        "Gz": Label(
            ("time",), "vertical component of the angular momentum", "moment of inertia / time"
        ),
        "H": Label(("time",), "energy", "moment of inertia / time^2"),
        "r": Label(("time",), "angular velocity about the axis of symmetry", "1/time"),
        **{f"u{i}": Label(("time",), f"root u{i} of the cubic of cos theta") for i in (1, 2, 3)},
    }

    def refuse_start(self) -> None:
        if not self.m1 > UNRESOLVED_M1:
            raise ValueError(
                "u2 = u3: the top is at, or tends to, an unstable equilibrium and has no period; "
                "form full takes it"
            )

    @property
    def m1(self) -> float:
        """1 - k^2 = (u3 - u2)/(u3 - u1) at the start; not a number where no digit of it is left."""
        e, w = self.nutation.e, self.nutation.w
        return (w - e) / (w + e) if w + e else math.nan

    @property
    def warnings(self) -> list[str]:
        if not self.m1 < ROUGH_M1:
            return super().warnings
        return [
            *super().warnings,
            f"1 - k^2 = {self.m1:.1e} at the start: "
            "so near u2 = u3 the mean over a nutation loses digits",
        ]


def upright_stability(t: Any, y: Sequence[Any], k: Any) -> Any:
    """C^2 r^2 - 4 A mu: positive while a top that turns upright is stable."""
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
    (`initial`); u1 <= u2 <= 1 <= u3: roots of the cubic Q(cos theta), cos theta running from u1 to
    u2, and k^2 = (u2 - u1)/(u3 - u1); A, C: equatorial and axial moments of inertia about the fixed
    point (`inertia`); mu: largest restoring moment (`mu`); a, b: coefficients of resistance (`a`,
    `b`); m: torque about the axis of symmetry (`m`), 0 in the source; all functions of tau; tau =
    epsilon t is the time. Assumed: epsilon small; right to O(epsilon) on an interval of order
    1/epsilon, while u2 < u3. A = C is allowed: no formula divides by A - C. An upright top, theta =
    0, ends when it becomes unstable (event `upright_unstable`): where C^2 r^2 = 4 A mu.

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
        now = with_mu(k, t)
        X, w = nutation(y, now)
        a, M3 = coefficient_at(k, "a", t), axial_torque(t, y[2], k)
        mean = mean_cosine(y[3], w)
        mean_cos = -y[3] * mean
        change = 0.0 if now is k else slope_at(k, "mu", t) / now.mu
        return drift(y, now, (-a, -a * mean_cos, M3, M3 * mean_cos), (X, w), (change, mean))

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        k = with_mu(k, t)
        U, Z, r, e = y.T
        # w is 0 where an upright top becomes unstable, and rounding may bring w^2 below.
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
        return self.nutation[:4]

    @property
    def run_events(self) -> tuple[Event, ...]:
        """For a top that starts upright: it stays so, and the averages end where it becomes
        unstable."""
        is_upright = self.nutation.Z == self.nutation.e == 0
        return (Event("upright_unstable", upright_stability, True),) if is_upright else ()


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
    has_changing_mu = has_axial_torque = False
    state = ("u1", "u2", "u3", "r")

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        u1, u2, u3, r = y
        A, c, mu = k.A, k.C * r, k.mu
        Gz, H = integrals_from_roots(y, k)
        a, b = coefficient_at(k, "a", t), coefficient_at(k, "b", t)
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
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
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
        """In long double: of a fast or a slow top Gz and H are sums of roots that cancel."""
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
    0 and pi; M = (-a p, -a q, m - b r); the derivative is by t = tau/epsilon (`epsilon`), the
    stored time is tau. The other symbols are those of the form averaged. With `theta` the motion
    starts there, at phi = 0 and p = q = 0. Of the motions with initial Gz, H and r, which differ in
    phase, that is taken which starts at phi = 0 and cos theta = (u1 + u2)/2, where theta grows.

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
        """1/epsilon: the derivatives are by tau."""
        return 1 / k.epsilon

    def attitude_at(self, start: np.ndarray) -> tuple[Any, ...]:
        """The turn by theta about x1, with the vertical along z: phi = psi = 0."""
        theta = math.atan2(start[4], start[5])
        return math.cos(theta / 2), math.sin(theta / 2), 0.0, 0.0

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        p, q, r, g1, g2, g3 = y
        now = with_mu(k, t)
        A, C, mu, eps = k.A, k.C, now.mu, k.epsilon
        f, M3 = -coefficient_at(now, "a", t), axial_torque(t, r, now)
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
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        return {"omega": y[:, :3], "gamma": y[:, 3:]}

    @cached_property
    def constants(self) -> Constants:
        return {**super().constants, "epsilon": self.epsilon}

    @property
    def start(self) -> tuple[float, ...]:
        """At phi = 0, where theta is given or cos theta = (u1 + u2)/2 and theta grows."""
        theta, r = self.initial["theta"], self.nutation.r
        if theta is not None:
            return 0.0, 0.0, r, 0.0, sin(theta), cos(theta)
        A, C = self.inertia["A"], self.inertia["C"]
        # Rounding may put an upright top a little beyond the pole.
        x = min(max(self.nutation.X, 0.0), 2.0)
        sine = sqrt(x * (2 - x))
        q = (self.nutation.U + C * r * x) / (A * sine) if sine else 0.0
        p = sqrt(max(2 * self.mu_at_start * (x - self.nutation.Z) / A - q * q, 0.0))
        return p, q, r, 0.0, sine, 1 - x

    @property
    def extended_start(self) -> np.ndarray:
        y = super().extended_start
        # The sine and cosine of theta have lost digits as doubles.
        if self.initial["theta"] is not None:
            theta = np.longdouble(self.initial["theta"])
            y[4:6] = np.sin(theta), np.cos(theta)
        return y
