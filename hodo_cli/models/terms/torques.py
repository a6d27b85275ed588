"""The torques on a rigid body, one function each, and the rates of a body under a sum of them.

A term is a function of the time, of its coefficients then, of omega = (p, q, r), of the constants
and of state variables of its own. It is written with + - * /, ** and the functions of `arithmetic`,
so that numbers, arrays and an engine's symbols all pass through it. Of the fluid in a cavity there
are also the keys of a case, and the limits of its theory.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic import evaluate, isfinite
from ...schema.expression import parse_expression
from ...schema.kinds import Key, Number, Table
from ..rigid_body import (
    Components,
    accelerations,
    along_principal_axes,
    angular_momentum_of,
    dot,
    from_principal_axes,
    times,
    vector_product,
    vector_sum,
)
from .time_laws import (
    SPACE_COMPONENTS,
    VELOCITIES,
    coefficient_at,
    values_of_names,
)

Function = Callable[[Any, Sequence[Any], Sequence[Any], Any, Sequence[Any]], Sequence[Any]]


class Term(NamedTuple):
    """One torque N (3,) as a function of (t, c, omega, k, extra), c the values of its constants at
    the time t, and the degree in the angular velocity of what each of these multiplies.

    `by_momentum` is set where the function gives N_i/A_i: of a torque that is proportional to the
    angular momentum the moments of inertia drop out. `extra` names the term's own state variables
    with the powers of omega that they carry; `rates` are their derivatives, where not only events
    change them. `coefficients` are those of the constants, numbers or laws of time, from the value
    of a case's key.
    """

    function: Function
    degree: dict[str, int]
    by_momentum: bool = False
    extra: dict[str, int] = {}
    rates: Function | None = None
    coefficients: Callable[[Any], tuple[Any, ...]] = tuple


def alone(coefficient: Any) -> tuple[Any, ...]:
    """The coefficients of a term that has but this one."""
    return (coefficient,)


def tensor_entries(tensor: Sequence[Sequence[Any]] | Mapping[str, Any]) -> tuple[Any, ...]:
    """The entries (9,) of the tensor of resistance that a case gives, row by row."""
    if isinstance(tensor, Mapping):
        on, off = tensor["diagonal"], tensor["off_diagonal"]
        return on, off, off, off, on, off, off, off, on
    return tuple(entry for row in tensor for entry in row)


def gyroscopic(w: Sequence[Any], k: Any) -> Sequence[Any]:
    """The angular acceleration by -omega x A omega; of degree 2 by the constant g."""
    p, q, r = along_principal_axes(w, k)
    rates = (
        k.g * (k.A2 - k.A3) / k.A1 * q * r,
        k.g * (k.A3 - k.A1) / k.A2 * p * r,
        k.g * (k.A1 - k.A2) / k.A3 * p * q,
    )
    return from_principal_axes(rates, k)


def rates_under(names: Iterable[str], t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
    """The rates of omega, and of the terms' own variables behind it, under the torques of these
    names."""
    w, remaining = y[:3], y[3:]
    rates, torque, extra_rates = gyroscopic(w, k), None, list[Any]()
    for term in map(TERMS.__getitem__, names):
        extra, remaining = remaining[: len(term.extra)], remaining[len(term.extra) :]
        c = [coefficient_at(k, name, t) for name in term.degree]
        extra_rates += term.rates(t, c, w, k, extra) if term.rates else [0 * x for x in extra]
        acceleration = term.function(t, c, w, k, extra)
        if term.by_momentum:
            rates = vector_sum(rates, acceleration)
        else:
            torque = acceleration if torque is None else vector_sum(torque, acceleration)
    if torque is not None:
        rates = vector_sum(rates, accelerations(torque, k))
    return *rates, *extra_rates


def damping_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """-lambda_i omega_i: a medium that resists each component of the angular momentum."""
    return -(c[0] * w[0]), -(c[1] * w[1]), -(c[2] * w[2])


def resistance_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """-I omega, with a tensor I."""
    x, y, z = times(c, w)
    return -x, -y, -z


def quadratic_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """-c_i |omega| omega_i."""
    size = dot(w, w) ** 0.5
    return -(c[0] * size * w[0]), -(c[1] * size * w[1]), -(c[2] * size * w[2])


def fluid_torque(inertia: Iterable[Any], omega: Iterable[Any], kappa: Any) -> Components:
    """The torque of a highly viscous fluid: kappa (omega'' + omega x omega'), with the omega' of
    free motion.

    It is orthogonal to G = (Ap, Bq, Cr), and turns the body's energy into heat. For A = B it is
    that of Leshchenko and Kozachenko, eq. (2).

    Source: F. L. Chernousko, The movement of a rigid body with cavities containing a viscous fluid,
    1972.
    """
    A, B, C = inertia
    p, q, r = omega
    pp, qq, rr = p * p, q * q, r * r
    return (
        kappa / (A * B * C) * p * (C * (A - C) * (A + C - B) * rr + B * (A - B) * (A + B - C) * qq),
        kappa / (A * B * C) * q * (A * (B - A) * (B + A - C) * pp + C * (B - C) * (B + C - A) * rr),
        kappa / (A * B * C) * r * (B * (C - B) * (C + B - A) * qq + A * (C - A) * (C + A - B) * pp),
    )


def cavity_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Sequence[Any]:
    """The torque of the fluid in a cavity of the body: kappa (omega'' + omega x omega'), with
    omega' and omega'' of free motion, of a gyrostat where there is a rotor."""
    if not hasattr(k, "h1"):
        along = fluid_torque((k.A1, k.A2, k.A3), along_principal_axes(w, k), c[0])
        return from_principal_axes(along, k)
    G = angular_momentum_of(w, k)
    turning = vector_product(G, w)
    first = accelerations(turning, k)
    second = accelerations(vector_sum(vector_product(turning, w), vector_product(G, first)), k)
    return [c[0] * x for x in vector_sum(second, vector_product(w, first))]


def body_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Sequence[Any]:
    """A torque whose direction is constant in the body."""
    return c


def brake_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """-b G/|G|, which brings a free body to rest in the shortest time."""
    G = angular_momentum_of(w, k)
    rate = c[0] / dot(G, G) ** 0.5
    return -(rate * G[0]), -(rate * G[1]), -(rate * G[2])


def rotor_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """-omega x h: the reaction of a rotor whose angular momentum h is fixed in the body."""
    return vector_product(c, w)


def space_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """F e, with e fixed in space; `extra` is e in body axes."""
    return c[0] * extra[0], c[0] * extra[1], c[0] * extra[2]


def direction_rates(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """gamma x omega: how a direction fixed in space turns in the body."""
    x, y, z = vector_product(extra, w)
    return k.g * x, k.g * y, k.g * z


def expression_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """Three expressions, in the case's own units whatever those of the motion."""
    values = dict(zip(VELOCITIES, (k.velocity_unit * x for x in w), strict=True))
    values |= {**values_of_names(k, t), **space_components(getattr(k, "attitude", None))}
    factor = k.time_unit / k.velocity_unit
    texts = k.expression1, k.expression2, k.expression3
    N1, N2, N3 = (factor * evaluate(parse_expression(text), values) for text in texts)
    return N1, N2, N3


def space_components(Q: Sequence[Any] | None) -> dict[str, Any]:
    """The components along body axes of the space axes y and z, by an attitude Q; none without."""
    if Q is None:
        return {}
    a, b, c, d = Q
    y = 2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)
    z = 2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d
    return dict(zip(SPACE_COMPONENTS, (*y, *z), strict=True))


ENTRIES = tuple(f"I{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
"""The constants of a tensor of resistance, row by row."""

TERMS: Mapping[str, Term] = {
    "damping": Term(damping_torque, dict.fromkeys(("lam1", "lam2", "lam3"), 1), by_momentum=True),
    "resistance": Term(resistance_torque, dict.fromkeys(ENTRIES, 1), coefficients=tensor_entries),
    "quadratic": Term(quadratic_torque, dict.fromkeys(("c1", "c2", "c3"), 2), by_momentum=True),
    "kappa": Term(cavity_torque, {"kappa": 3}, coefficients=alone),
    "torque": Term(body_torque, dict.fromkeys(("N1", "N2", "N3"), 0)),
    "brake": Term(brake_torque, {"brake": 0}, extra={"stage_momentum": 1}, coefficients=alone),
    "rotor": Term(rotor_torque, dict.fromkeys(("h1", "h2", "h3"), 1)),
    "space_torque": Term(
        space_torque,
        {"F": 0},
        extra=dict.fromkeys(("gamma1", "gamma2", "gamma3"), 0),
        rates=direction_rates,
        coefficients=lambda space: (space["size"],),
    ),
    "expression": Term(expression_torque, {}, coefficients=lambda texts: ()),
}
"""The terms by the keys of cases; a `cavity` is a kappa."""


def degree_under(names: Iterable[str]) -> dict[str, int]:
    """The degree in the angular velocity of the terms that each constant of a sum multiplies."""
    return {"g": 2} | {constant: n for name in names for constant, n in TERMS[name].degree.items()}


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
    entries = {name: value for name, value in (cavity or {}).items() if value is not None}
    if alone is not None and entries:
        raise ValueError("kappa is given, so leave out the cavity")
    if alone is not None:
        return alone
    if set(entries) == {"kappa"}:
        return entries["kappa"]
    if set(entries) not in ({"density", "viscosity", "P0"}, {"density", "viscosity", "radius"}):
        named = f"not {', '.join(entries)}" if entries else "and none of them is given"
        raise ValueError(
            f"the cavity is density, viscosity and P0 or radius, or kappa alone, {named}"
        )
    kappa: float = entries["density"] * shape_factor(entries) / entries["viscosity"]
    if not isfinite(kappa):
        raise ValueError("kappa = rho P0/nu is too large a number")
    return kappa


def reynolds(cavity: Mapping[str, Any], omega: np.ndarray) -> float:
    """b^2 |omega|/nu, for a cavity with a viscosity and an angular velocity (3,)."""
    return float(radius_of(cavity) ** 2 * math.hypot(*omega) / cavity["viscosity"])


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


def cavity_warnings(
    cavity: Mapping[str, Any] | None, A: np.ndarray, omega: np.ndarray
) -> list[str]:
    """Warnings if the Reynolds number is not small, as the fluid's torque assumes, and if the
    fluid's own moment of inertia exceeds that of body and fluid together: there is no such body.

    With kappa alone neither is known. A sphere of fluid has 2/5 m b^2.
    """
    if cavity is None or cavity["density"] is None:
        return []
    number, b, speed = reynolds(cavity, omega), radius_of(cavity), math.hypot(*omega)
    mass = 4 / 3 * math.pi * b**3 * cavity["density"]
    moment, messages = 0.4 * mass * b * b, []
    if number > NOT_SMALL:
        messages.append(
            f"the flow is not slow: its Reynolds number b^2 |omega|/nu is {number:.3g} (b = "
            f"{b:.3g}, |omega| = {speed:.3g}, nu = {cavity['viscosity']:.3g})"
        )
    if moment > A.min():
        messages.append(
            f"no body: a sphere with this P0 has b = {b:.3g}, and its fluid a mass of {mass:.5g} "
            f"and a moment of inertia of {moment:.5g}, more than the {A.min():g} of body and fluid "
            "together"
        )
    return messages
