"""The fluid in a cavity, kappa = rho P0/nu with P0 = 8 pi b^7/525 of a sphere: its keys, kappa, and
the limits of its theory: a small Reynolds number b^2 |omega|/nu and a torque small beside
|omega| |G|."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...arithmetic import isfinite
from ...schema.kinds import Key, Number, Table
from ..euler import fluid_torque

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


CAVITY = Key(
    Table(
        {
            name: Key(Number(above=0), *meaning, default=None)
            for name, meaning in OF_THE_CAVITY.items()
        }
        | {
            "kappa": Key(
                Number(least=0),
                "rho P0/nu, instead of the other keys",
                "moment of inertia * time",
                default=None,
            )
        }
    ),
    "density, viscosity and P0 or radius; or kappa alone",
    default=None,
)


def shape_factor(cavity: Mapping[str, Any]) -> Any:
    """P0 of the cavity, given itself or by the radius of a sphere; Chernousko 1972."""
    if cavity.get("P0") is not None:
        return cavity["P0"]
    return 8 * math.pi / 525 * math.prod((cavity["radius"],) * 7)


def radius_of(cavity: Mapping[str, Any]) -> float:
    """b, the radius of the sphere that has the cavity's P0."""
    return math.pow(525 * shape_factor(cavity) / (8 * math.pi), 1 / 7)


def coefficient(cavity: Mapping[str, float | None] | None, alone: float | None = None) -> float:
    """kappa = rho P0/nu, from the cavity or given alone.

    Raises ValueError, with a sentence, unless it is given in exactly one way.
    """
    given = {name: value for name, value in (cavity or {}).items() if value is not None}
    if alone is not None and given:
        raise ValueError("kappa is given, so leave out the cavity")
    given |= {} if alone is None else {"kappa": alone}
    ways = {"kappa"}, {"density", "viscosity", "P0"}, {"density", "viscosity", "radius"}
    if set(given) not in ways:
        named = f"not {', '.join(given)}" if given else "and none of them is given"
        raise ValueError(
            f"the cavity is density, viscosity and P0 or radius, or kappa alone, {named}"
        )
    if "kappa" in given:
        return given["kappa"]
    kappa: float = given["density"] * shape_factor(given) / given["viscosity"]
    if not isfinite(kappa):
        raise ValueError("kappa = rho P0/nu is too large a number")
    return kappa


def reynolds(cavity: Mapping[str, Any], omega: np.ndarray) -> float:
    """b^2 |omega|/nu, for a cavity with a viscosity and an angular velocity (3,)."""
    return float(radius_of(cavity) ** 2 * math.hypot(*omega) / cavity["viscosity"])


def weak(A: np.ndarray, omega: np.ndarray, kappa: Any, torque: Sequence[float]) -> list[str]:
    """Warnings for torques that turn G at a rate not small compared with |omega|; none for a body
    at rest."""
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


def cavity_warnings(
    cavity: Mapping[str, Any] | None, A: np.ndarray, omega: np.ndarray
) -> list[str]:
    """Warnings if the Reynolds number is not small, as the fluid's torque assumes, and if the
    fluid's own moment of inertia exceeds a moment of body and fluid together: no body has that.

    With kappa alone neither is known. A sphere of fluid has 2/5 m b^2.
    """
    if cavity is None or cavity["density"] is None:
        return []
    number, b, speed = reynolds(cavity, omega), radius_of(cavity), math.hypot(*omega)
    mass = 4 / 3 * math.pi * b**3 * cavity["density"]
    moment = 0.4 * mass * b * b
    sentences = {
        f"the flow is not slow: its Reynolds number b^2 |omega|/nu is {number:.3g} (b = "
        f"{b:.3g}, |omega| = {speed:.3g}, nu = {cavity['viscosity']:.3g})": number > NOT_SMALL,
        f"no body: a sphere with this P0 has b = {b:.3g}, and its fluid a mass of {mass:.5g} "
        f"and a moment of inertia of {moment:.5g}, more than the {A.min():g} of body and fluid "
        "together": moment > A.min(),
    }
    return [sentence for sentence, applies in sentences.items() if applies]
