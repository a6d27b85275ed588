"""The very viscous fluid in a cavity: its keys, its coefficient kappa, and the limits of its
theory.

kappa = rho P0/nu for a fluid of density rho and kinematic viscosity nu. The shape factor P0 of a
sphere of radius b is 8 pi b^7/525. The theory holds where the Reynolds number b^2 |omega|/nu is
small, and the torque is small compared with |omega| |G|.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...arithmetic import isfinite
from ...schema.kinds import Key, Number, Table
from ..euler import fluid_torque

NOT_SMALL = 0.1
"""The largest ratio that a first-order theory takes as small without a warning. At this ratio it
errs by some per cent, which figures show."""

CAVITY = Key(
    Table(
        {
            "density": Key(Number(above=0), "density rho of the fluid", "mass/length^3", None),
            "viscosity": Key(Number(above=0), "kinematic viscosity nu", "length^2/time", None),
            "P0": Key(Number(above=0), "shape factor P0 of the cavity", "length^7", None),
            "radius": Key(
                Number(above=0), "radius b of a sphere: P0 = 8 pi b^7/525", "length", None
            ),
            "kappa": Key(
                Number(least=0),
                "rho P0/nu, instead of the other keys",
                "moment of inertia * time",
                None,
            ),
        }
    ),
    "density, viscosity and P0 or radius; or kappa alone",
    default=None,
)


def shape_factor(cavity: Mapping[str, Any]) -> Any:
    """P0 of the cavity, as given or from the radius b of a sphere: 8 pi b^7/525, Chernousko
    1972."""
    if cavity.get("P0") is not None:
        return cavity["P0"]
    return 8 * math.pi / 525 * math.prod((cavity["radius"],) * 7)


def radius_of(cavity: Mapping[str, Any]) -> float:
    """The radius b of the sphere that has the P0 of the cavity."""
    return math.pow(525 * shape_factor(cavity) / (8 * math.pi), 1 / 7)


def coefficient(cavity: Mapping[str, float | None] | None, alone: float | None = None) -> float:
    """kappa = rho P0/nu, from the key `cavity` or, as `alone`, from the key `kappa` beside it.

    Raises ValueError, with a sentence, unless kappa is given in exactly one way.
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
    """The Reynolds number b^2 |omega|/nu of a cavity with a viscosity, for omega (3,)."""
    return float(radius_of(cavity) ** 2 * math.hypot(*omega) / cavity["viscosity"])


def weak(A: np.ndarray, omega: np.ndarray, kappa: Any, torque: Sequence[float]) -> list[str]:
    """Warnings on torques that are not small compared with |omega| |G| at the start: that of a
    fluid, and the constant one. None for a body at rest."""
    peak, heaviest = float(np.abs(omega).max()), float(A.max())
    if not peak:
        return []
    w, body = omega / peak, A / heaviest  # of size 1, so that nothing but a ratio can overflow
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
    """Warnings on a Reynolds number that is not small, as the fluid's torque assumes, and on a
    sphere of fluid whose moment of inertia 2/5 m b^2 exceeds a moment of body and fluid together.

    There are no warnings where the case gives kappa alone, which determines neither.
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
