"""Euler's equations, A omega' + omega x G = N with G = A omega + h, and the torques N, one function
each.

A torque is a function of the time, of its coefficients then, of omega = (p, q, r), of the constants
k and of state variables of its own. It is written with + - * /, ** and the functions of
`arithmetic`, so that numbers, arrays and an engine's symbols all pass through it. Components are
along the principal axes, k has A1, A2, A3, and h1, h2, h3 of a rotor; of a body that is given by
its full tensor it has `principal_axes` (9,) too, row by row in the axes of the case, in which three
torques are stated.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from ..arithmetic import cos, evaluate, sin
from ..schema.expression import parse_expression
from .terms.time_laws import SPACE_COMPONENTS, VELOCITIES, coefficient_at, values_of_names

Components = tuple[Any, Any, Any]

Function = Callable[[Any, Sequence[Any], Sequence[Any], Any, Sequence[Any]], Sequence[Any]]


def rates_under(names: Iterable[str], t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
    """The rates of omega, and of the terms' own variables after it, under the torques of these
    names. The gyroscopic terms are of degree 2 by the constant g."""
    w, remaining = y[:3], y[3:]
    p, q, r = w
    rates: Components = (
        k.g * (k.A2 - k.A3) / k.A1 * q * r,
        k.g * (k.A3 - k.A1) / k.A2 * p * r,
        k.g * (k.A1 - k.A2) / k.A3 * p * q,
    )
    torque, extra_rates = None, list[Any]()
    for term in map(TERMS.__getitem__, names):
        extra, remaining = remaining[: len(term.extra)], remaining[len(term.extra) :]
        c = [coefficient_at(k, name, t) for name in term.degree]
        extra_rates += term.rates(t, c, w, k, extra) if term.rates else [0 * x for x in extra]
        if term.in_case_axes:
            N = along_principal_axes(term.function(t, c, in_case_axes(w, k), k, extra), k)
        else:
            N = term.function(t, c, w, k, extra)
        if term.by_momentum:
            rates = vector_sum(rates, N)
        else:
            torque = N if torque is None else vector_sum(torque, N)
    if torque is not None:
        rates = vector_sum(rates, accelerations(torque, k))
    return *rates, *extra_rates


def accelerations(torque: Sequence[Any], k: Any) -> Components:
    """The angular acceleration that a torque gives a body."""
    return torque[0] / k.A1, torque[1] / k.A2, torque[2] / k.A3


def angular_momentum_of(w: Sequence[Any], k: Any) -> Components:
    """G = A omega, and h of a rotor."""
    G = k.A1 * w[0], k.A2 * w[1], k.A3 * w[2]
    return vector_sum(G, rotor_of(k)) if hasattr(k, "h1") else G


def rotor_of(k: Any) -> Sequence[Any]:
    """h of a rotor in the units of A omega."""
    # As every constant of degree 1 it is in units of the time as well, and so is g.
    return along_principal_axes((k.h1 / k.g, k.h2 / k.g, k.h3 / k.g), k)


# Vectors and quaternions: numbers, arrays or an engine's symbols


def times(matrix: Sequence[Any], v: Sequence[Any]) -> Components:
    """The product of a matrix, given row by row (9,), and a vector."""
    x, y, z = v
    a, b, c, d, e, f, g, h, i = matrix
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def along_principal_axes(v: Sequence[Any], k: Any) -> Sequence[Any]:
    """The components along the principal axes of a vector in the axes of the case."""
    return times(k.principal_axes, v) if hasattr(k, "principal_axes") else v


def in_case_axes(v: Sequence[Any], k: Any) -> Sequence[Any]:
    """The inverse of `along_principal_axes`."""
    return times(transposed(k.principal_axes), v) if hasattr(k, "principal_axes") else v


def transposed(matrix: Sequence[Any]) -> Sequence[Any]:
    """The transpose of a matrix, both row by row (9,)."""
    return *matrix[0::3], *matrix[1::3], *matrix[2::3]


def vector_product(a: Sequence[Any], b: Sequence[Any]) -> Components:
    """The vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The scalar product a.b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def vector_sum(a: Sequence[Any], b: Sequence[Any]) -> Components:
    """The sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def about(axis: Iterable[Any], angle: Any) -> tuple[Any, ...]:
    """The rotation by an angle about an axis (3,) of length 1."""
    return cos(angle / 2), *(sin(angle / 2) * x for x in axis)


def composed(first: Iterable[Any], second: Iterable[Any]) -> tuple[Any, ...]:
    """The quaternion of the rotation `second` followed by the rotation `first`."""
    a, b, c, d = first
    e, f, g, h = second
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g + d * f - b * h + c * e,
        a * h + b * g - c * f + d * e,
    )


def quaternion_rates(omega: Sequence[Any], Q: Sequence[Any], factor: Any) -> tuple[Any, ...]:
    """Q' = factor Q (0, omega)/2."""
    return composed(Q, (0.0, *(factor * x / 2 for x in omega)))


def turned_back(Q: Sequence[Any], v: Sequence[Any]) -> tuple[Any, ...]:
    """A vector in space in the axes of a body with the attitude Q."""
    a, b, c, d = Q
    return composed(composed((a, -b, -c, -d), (0 * a, *v)), Q)[1:]


# The torques


class Term(NamedTuple):
    """One torque N (3,) as a function of (t, c, omega, k, extra), c the values of its constants at
    the time t, and the degree in the angular velocity of what each of these multiplies.

    `by_momentum` is set where the function gives N_i/A_i: of a torque that is proportional to the
    angular momentum the moments of inertia drop out. `extra` names the term's own state variables
    with the powers of omega that they carry; `rates` are their derivatives, where not only events
    change them. `in_case_axes` is set where omega and N have components along the axes of the case.
    `coefficients` gives the values of the constants, numbers or laws of time, from a case's key.
    """

    function: Function
    degree: dict[str, int]
    by_momentum: bool = False
    extra: dict[str, int] = {}
    rates: Function | None = None
    coefficients: Callable[[Any], tuple[Any, ...]] = tuple
    in_case_axes: bool = False


def tensor_entries(tensor: Sequence[Sequence[Any]] | Mapping[str, Any]) -> tuple[Any, ...]:
    """The entries (9,) of the tensor of resistance that a case gives, row by row."""
    if isinstance(tensor, Mapping):
        on, off = tensor["diagonal"], tensor["off_diagonal"]
        return on, off, off, off, on, off, off, off, on
    return tuple(entry for row in tensor for entry in row)


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

    It is orthogonal to G = (Ap, Bq, Cr), and turns the body's energy into heat. For A = B it is the
    torque of Leshchenko and Kozachenko, eq. (2).

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
        return fluid_torque((k.A1, k.A2, k.A3), w, c[0])
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
    """Three expressions, in the case's own units."""
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
    "resistance": Term(
        resistance_torque, dict.fromkeys(ENTRIES, 1), coefficients=tensor_entries, in_case_axes=True
    ),
    "quadratic": Term(quadratic_torque, dict.fromkeys(("c1", "c2", "c3"), 2), by_momentum=True),
    "kappa": Term(cavity_torque, {"kappa": 3}, coefficients=lambda value: (value,)),
    "torque": Term(body_torque, dict.fromkeys(("N1", "N2", "N3"), 0), in_case_axes=True),
    "brake": Term(
        brake_torque,
        {"brake": 0},
        extra={"stage_momentum": 1},
        coefficients=lambda value: (value,),
    ),
    "rotor": Term(rotor_torque, dict.fromkeys(("h1", "h2", "h3"), 1), in_case_axes=True),
    "space_torque": Term(
        space_torque,
        {"F": 0},
        extra=dict.fromkeys(("gamma1", "gamma2", "gamma3"), 0),
        rates=direction_rates,
        coefficients=lambda space: (space["size"],),
    ),
    "expression": Term(expression_torque, {}, coefficients=lambda texts: (), in_case_axes=True),
}
"""The terms by the keys of cases; a `cavity` is a kappa."""

DEGREE = {"g": 2} | {name: n for term in TERMS.values() for name, n in term.degree.items()}
"""The degree in the angular velocity of the terms that each constant multiplies."""
