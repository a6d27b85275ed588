"""The torques on a rigid body, one function each, and the rates of a body under a sum of them.

A term is a function of the time, the state, whose first three variables are p, q, r, and the
constants. It is written with + - * / and **, so that numbers, arrays and an engine's symbols all
pass through it.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

Components = tuple[Any, Any, Any]


class Term(NamedTuple):
    """One torque N (3,) as a function of (t, y, k), and the degree in the angular velocity of what
    each of its constants multiplies.

    `by_momentum` is set where the function gives N_i/A_i: of a torque that is proportional to the
    angular momentum the moments of inertia drop out.
    """

    function: Callable[[Any, Sequence[Any], Any], Components]
    degree: dict[str, int]
    by_momentum: bool = False


def gyroscopic(y: Sequence[Any], k: Any) -> Components:
    """-omega x G by body axis, each over its moment of inertia; of degree 2 by the constant g."""
    p, q, r = y[:3]
    return (
        k.g * (k.A2 - k.A3) / k.A1 * q * r,
        k.g * (k.A3 - k.A1) / k.A2 * p * r,
        k.g * (k.A1 - k.A2) / k.A3 * p * q,
    )


def added(a: Components, b: Components) -> Components:
    """The sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def accelerations(terms: Iterable[Term], t: Any, y: Sequence[Any], k: Any) -> Components:
    """omega' of a body under a sum of torques."""
    rates, torque = gyroscopic(y, k), None
    for term in terms:
        part = term.function(t, y, k)
        if term.by_momentum:
            rates = added(rates, part)
        else:
            torque = part if torque is None else added(torque, part)
    if torque is None:
        return rates
    return added(rates, (torque[0] / k.A1, torque[1] / k.A2, torque[2] / k.A3))


def damping_torque(t: Any, y: Sequence[Any], k: Any) -> Components:
    """-lambda_i omega_i: a medium that resists each component of the angular momentum."""
    p, q, r = y[:3]
    return -(k.lam1 * p), -(k.lam2 * q), -(k.lam3 * r)


def resistance_torque(t: Any, y: Sequence[Any], k: Any) -> Components:
    """-I omega, with a tensor I."""
    p, q, r = y[:3]
    return (
        -(k.I11 * p + k.I12 * q + k.I13 * r),
        -(k.I21 * p + k.I22 * q + k.I23 * r),
        -(k.I31 * p + k.I32 * q + k.I33 * r),
    )


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


def cavity_torque(t: Any, y: Sequence[Any], k: Any) -> Components:
    """That of the fluid in a cavity of the body."""
    return fluid_torque((k.A1, k.A2, k.A3), y[:3], k.kappa)


def body_torque(t: Any, y: Sequence[Any], k: Any) -> Components:
    """A torque that is constant in the body."""
    return k.N1, k.N2, k.N3


ENTRIES = tuple(f"I{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
"""The constants of a tensor of resistance, row by row."""

DAMPING = Term(damping_torque, dict.fromkeys(("lam1", "lam2", "lam3"), 1), by_momentum=True)
RESISTANCE = Term(resistance_torque, dict.fromkeys(ENTRIES, 1))
FLUID = Term(cavity_torque, {"kappa": 3})
CONSTANT = Term(body_torque, dict.fromkeys(("N1", "N2", "N3"), 0))
