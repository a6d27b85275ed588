"""A body with a cavity full of viscous fluid, under a torque that is constant in body axes."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from ..arithmetic import isfinite, sqrt
from ..schema.kinds import Key, Mistake, Number, Table, vector
from .base import Constants, Model, mistake_of
from .rigid_body import INERTIA, INITIAL, BodyFrame, body_constants, body_mistakes, complete
from .terms.torques import CONSTANT, FLUID, fluid_torque, rates_under
from .theory.possible_crossings import Dissipation

# First-order theories are then off by some per cent, which figures show.
NOT_SMALL = 0.1
"""Where a ratio that the theory takes as small is no longer so."""

OF_THE_CAVITY = {
    "density": ("density rho of the fluid", "mass/length^3"),
    "viscosity": ("kinematic viscosity nu", "length^2/time"),
    "P0": ("shape factor P0 of the cavity", "length^7"),
    "radius": ("radius b of a sphere: P0 = 8 pi b^7/525", "length"),
}
"""The keys of a cavity that are given together: meaning and unit."""


def kappa_instead_of(others: str) -> Key:
    """The key of the coefficient rho P0/nu, by which others are left out."""
    meaning = f"rho P0/nu, instead of {others}"
    return Key(Number(least=0), meaning, "moment of inertia * time", default=None)


CAVITY = Key(
    Table(
        {
            name: Key(Number(above=0), *meaning, default=None)
            for name, meaning in OF_THE_CAVITY.items()
        }
        | {"kappa": kappa_instead_of("the other keys")}
    ),
    "density, viscosity and P0 or radius; or kappa alone",
    default=None,
)

CAVITY_INITIAL = Key(
    Table(
        {
            **cast(Table, INITIAL.kind).keys,
            "x": Key(
                Number(least=0),
                "p^2 + q^2; x and y replace p, q and r",
                unit="1/time^2",
                default=None,
            ),
            "y": Key(Number(least=0), "r^2 (then r >= 0)", unit="1/time^2", default=None),
        }
    ),
    "initial angular velocity: p, q, r, or x and y (then p = sqrt(x), q = 0, r = sqrt(y))",
)


def shape_factor(cavity: Mapping[str, float | None]) -> float:
    """P0 of the cavity, given itself or by the radius of a sphere; Chernousko 1972."""
    P0, radius = cavity.get("P0"), cavity.get("radius")
    if P0 is not None:
        return P0
    assert radius is not None  # `coefficient` has seen that one of them is given
    return 8 * math.pi / 525 * math.prod((radius,) * 7)


def radius_of(cavity: Mapping[str, float | None]) -> float:
    """b, the radius of the sphere that has the cavity's P0."""
    return math.pow(525 * shape_factor(cavity) / (8 * math.pi), 1 / 7)


def coefficient(cavity: Mapping[str, float | None] | None, alone: float | None) -> float:
    """kappa = rho P0/nu, from the cavity or given alone.

    Raises ValueError, with a sentence, unless it is given in exactly one way.
    """
    entries = {name: value for name, value in (cavity or {}).items() if value is not None}
    if alone is not None and entries:
        raise ValueError("kappa is given, so leave out the cavity")
    if alone is not None:
        return alone
    if set(entries) == {"kappa"}:
        return entries["kappa"]
    if set(entries) in ({"density", "viscosity", "P0"}, {"density", "viscosity", "radius"}):
        kappa = entries["density"] * shape_factor(entries) / entries["viscosity"]
        if isfinite(kappa):
            return kappa
        raise ValueError("kappa = rho P0/nu is too large a number")
    named = f"not {', '.join(entries)}" if entries else "and none of them is given"
    raise ValueError(f"the cavity is density, viscosity and P0 or radius, or kappa alone, {named}")


def velocity(inertia: Sequence[float], initial: Mapping[str, float | None]) -> tuple[float, ...]:
    """(p, q, r) at the start. Raises ValueError, with a sentence, unless the data say it in exactly
    one way."""
    x, y = initial.get("x"), initial.get("y")
    if x is None and y is None:
        return complete(inertia, initial)
    if x is None or y is None or any(initial.get(name) is not None for name in "pqrG"):
        raise ValueError("give x and y alone, or p, q and r")
    return sqrt(x), 0.0, sqrt(y)


@dataclass(frozen=True)
class Cavity(Model):
    """The part that the forms share: the keys, their checks and the limits of the theory."""

    inertia: tuple[float, float, float]
    initial: Mapping[str, float | None]
    cavity: Mapping[str, float | None] | None
    kappa: float | None
    torque: tuple[float, float, float]
    epsilon: float

    name = "cavity+constant"
    velocity = staticmethod(velocity)
    keys = {
        "inertia": INERTIA,
        "cavity": CAVITY,
        "kappa": kappa_instead_of("`cavity`"),
        "torque": Key(
            vector(3),
            "constant torque M1, M2, M3",
            unit="moment of inertia / time^2",
            default=(0.0, 0.0, 0.0),
        ),
        "epsilon": Key(Number(), "small parameter, the factor of the torque", default=1.0),
        "initial": CAVITY_INITIAL,
    }

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        yield from body_mistakes(cls, data)
        if {"cavity", "kappa"} <= set(data):
            cavity = data["cavity"]
            yield from mistake_of(("cavity",) if cavity else (), coefficient, cavity, data["kappa"])

    @property
    def start(self) -> tuple[float, ...]:
        return velocity(self.inertia, self.initial)

    @property
    def applied(self) -> tuple[float, ...]:
        """The constant torque, epsilon M."""
        return tuple(self.epsilon * component for component in self.torque)

    @cached_property
    def constants(self) -> Constants:
        torque = dict(zip(CONSTANT.degree, self.applied, strict=True))
        kappa = coefficient(self.cavity, self.kappa)
        return {**body_constants(self.inertia), "kappa": kappa, **torque}

    @property
    def warnings(self) -> list[str]:
        # The start of the body, also in a form whose state is something else.
        A, omega = np.array(self.inertia), np.array(velocity(self.inertia, self.initial))
        kappa = coefficient(self.cavity, self.kappa)
        limits = [*reynolds_warning(self.cavity, omega), *weak(A, omega, kappa, self.applied)]
        return [*limits, *heavy_fluid(self.cavity, A)]


def heavy_fluid(cavity: Mapping[str, float | None] | None, A: np.ndarray) -> list[str]:
    """A warning if the fluid's own moment of inertia exceeds that of body and fluid together: there
    is no such body.

    A sphere of fluid has 2/5 m b^2.
    """
    if cavity is None or cavity["density"] is None:
        return []
    b = radius_of(cavity)
    mass = 4 / 3 * math.pi * b**3 * cavity["density"]
    moment = 0.4 * mass * b * b
    if moment <= A.min():
        return []
    return [
        f"no body: a sphere with this P0 has b = {b:.3g}, and its fluid a mass of {mass:.5g} and a "
        f"moment of inertia of {moment:.5g}, more than the {A.min():g} of body and fluid together"
    ]


def reynolds_warning(cavity: Mapping[str, float | None] | None, omega: np.ndarray) -> list[str]:
    """A warning if the Reynolds number b^2 |omega|/nu is not small, as the fluid's torque assumes.

    With kappa alone the Reynolds number is unknown.
    """
    if cavity is None or cavity["viscosity"] is None:
        return []
    number = reynolds(cavity, omega)
    if number <= NOT_SMALL:
        return []
    b, speed = radius_of(cavity), math.hypot(*omega)
    size = f"b = {b:.3g}, |omega| = {speed:.3g}, nu = {cavity['viscosity']:.3g}"
    return [f"the flow is not slow: its Reynolds number b^2 |omega|/nu is {number:.3g} ({size})"]


def reynolds(cavity: Mapping[str, float | None], omega: np.ndarray) -> float:
    """b^2 |omega|/nu, for a cavity with a viscosity and an angular velocity (3,)."""
    viscosity = cavity["viscosity"]
    assert viscosity is not None  # a case with kappa alone has no Reynolds number
    return radius_of(cavity) ** 2 * math.hypot(*omega) / viscosity


def weak(A: np.ndarray, omega: np.ndarray, kappa: Any, torque: Sequence[float]) -> list[str]:
    """Warnings for torques that turn G at a rate not small beside |omega|; none for a body at
    rest."""
    peak, heaviest = float(np.abs(omega).max()), float(A.max())
    if not peak:
        return []
    w, body = omega / peak, A / heaviest  # of size 1, so that only a ratio itself can overflow
    scale = math.hypot(*w) * math.hypot(*(body * w)) * heaviest
    ratios = {
        "of the fluid": math.hypot(*fluid_torque(body, w, kappa)) / scale * peak,
        "epsilon M": math.hypot(*torque) / scale / peak / peak,
    }
    return [
        f"the torque {name} is not small: {ratio:.3g} of |omega| |G| at the start"
        for name, ratio in ratios.items()
        if ratio > NOT_SMALL
    ]


@dataclass(frozen=True)
class FullCavity(Cavity, BodyFrame):
    """A rigid body with a cavity full of a very viscous fluid, under a torque constant in body
    axes.

    A1 p' + (A3 - A2) q r = kappa/(A1 A2 A3) p [A3 (A1 - A3)(A1 + A3 - A2) r^2
                                                + A2 (A1 - A2)(A1 + A2 - A3) q^2] + epsilon M1
    and cyclically

    p, q, r: angular velocity about x1, x2, x3, 1/time (`initial`); A1, A2, A3: principal moments of
    inertia of body and fluid together (`inertia`); kappa = rho P0/nu, moment of inertia * time
    (`cavity`, or `kappa`); M1, M2, M3: constant torque (`torque`) with its factor epsilon
    (`epsilon`). Assumed: small Reynolds number, torques small beside |omega| |G|. The fluid's
    torque is internal: without M, |G| is constant and the energy falls.

    Source: D. Leshchenko and T. Kozachenko, Mechanics and Mathematical Methods V(1) (2023) 25, eq.
    (2), where A1 = A2; F. L. Chernousko 1972 for the triaxial body. Their eq. (1) has epsilon^2,
    (2) epsilon.
    """

    form = "full"
    degree = {"g": 2} | FLUID.degree | CONSTANT.degree

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        return rates_under((FLUID, CONSTANT), t, y, k)

    @property
    def dissipation(self) -> Dissipation:
        kappa = coefficient(self.cavity, self.kappa)
        return Dissipation(self.inertia, kappa=kappa, torque=self.applied)
