"""Euler's equations, A omega' + omega x G = N with G = A omega + h, and the torques N, each as one
function.

A torque is a function of the time t, of its coefficients c at t, of omega = (p, q, r), of the
constants k and of its own state variables. It uses + - * /, ** and the functions of `arithmetic`
only, so that numbers, arrays and an engine's symbols all pass through it.

Components are along the principal axes. k holds the principal moments A1, A2, A3. For a body given
by a full tensor k also holds `principal_axes` (9,): the components, row by row, of these axes along
the axes of the case. Some torques, and h1, h2, h3 of a rotor, are stated along the axes of the case
(`Term.in_case_axes`).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from ..arithmetic import cos, evaluate, sin
from ..schema.expression import parse_expression
from .terms.time_laws import SPACE_COMPONENTS, VELOCITIES, coefficient_at, values_of_names

Components = tuple[Any, Any, Any]

Function = Callable[[Any, Sequence[Any], Sequence[Any], Any, Sequence[Any]], Sequence[Any]]
"""A function (t, c, omega, k, extra) as `Term` describes it."""


def rates_under(names: Iterable[str], t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
    """The time derivative of the state y under the torques of these names. The state consists of
    omega and of the torques' own variables.

    The gyroscopic terms have the factor g, which is 1 in the case's own units. Its degree 2 tells
    an engine how these terms convert to other units.
    """
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
    """The angular acceleration A^-1 N of a body under a torque N (3,)."""
    return torque[0] / k.A1, torque[1] / k.A2, torque[2] / k.A3


def angular_momentum_of(w: Sequence[Any], k: Any) -> Components:
    """G = A omega + h, where h = 0 without a rotor."""
    G = k.A1 * w[0], k.A2 * w[1], k.A3 * w[2]
    return vector_sum(G, rotor_of(k)) if hasattr(k, "h1") else G


def rotor_of(k: Any) -> Sequence[Any]:
    """h of a rotor along the principal axes, in the units of A omega."""
    # h1, h2, h3 and g all have the factor 1/rho of other units of time; it drops out of h/g.
    return along_principal_axes((k.h1 / k.g, k.h2 / k.g, k.h3 / k.g), k)


# Vectors and quaternions: numbers, arrays or an engine's symbols


def matvec(matrix: Sequence[Any], v: Sequence[Any]) -> Components:
    """The product of a matrix (9,), given row by row, and a vector (3,)."""
    x, y, z = v
    a, b, c, d, e, f, g, h, i = matrix
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def along_principal_axes(v: Sequence[Any], k: Any) -> Sequence[Any]:
    """The components along the principal axes of a vector v (3,), which is given along the axes of
    the case."""
    return matvec(k.principal_axes, v) if hasattr(k, "principal_axes") else v


def in_case_axes(v: Sequence[Any], k: Any) -> Sequence[Any]:
    """The components along the axes of the case of a vector v (3,), which is given along the
    principal axes."""
    return matvec(transposed(k.principal_axes), v) if hasattr(k, "principal_axes") else v


def transposed(matrix: Sequence[Any]) -> Sequence[Any]:
    """The transpose of a matrix (9,); both are given row by row."""
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
    """The quaternion (4,) of the rotation by an angle about an axis (3,) of length 1."""
    return cos(angle / 2), *(sin(angle / 2) * x for x in axis)


def composed(first: Iterable[Any], second: Iterable[Any]) -> tuple[Any, ...]:
    """The product `first second` of two quaternions: the rotation `second`, then `first`."""
    a, b, c, d = first
    e, f, g, h = second
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g + d * f - b * h + c * e,
        a * h + b * g - c * f + d * e,
    )


def quaternion_rates(omega: Sequence[Any], Q: Sequence[Any], factor: Any) -> tuple[Any, ...]:
    """The rates Q' = factor Q (0, omega)/2 of a quaternion Q (4,)."""
    return composed(Q, (0.0, *(factor * x / 2 for x in omega)))


def turned_back(Q: Sequence[Any], v: Sequence[Any]) -> tuple[Any, ...]:
    """The components along body axes of a vector v (3,) along space axes, for the attitude Q."""
    a, b, c, d = Q
    return composed(composed((a, -b, -c, -d), (0 * a, *v)), Q)[1:]


# The torques


class Term(NamedTuple):
    """One torque N (3,).

    `function(t, c, omega, k, extra)` is the torque. c are its coefficients at the time t, which the
    constants named in `degree` hold. `degree` gives the degree in omega of the terms that each of
    these multiplies.

    With `by_momentum` the function gives N_i/A_i. The moments of inertia A_i drop out of a torque
    that is proportional to the angular momentum. With `in_case_axes` omega and N have components
    along the axes of the case.

    `extra` names the torque's own state variables, each with the power of the unit of omega that it
    carries. `rates` gives their time derivatives; without it only events change them.
    `coefficients(value)` takes the value of the case's key apart into the coefficients.
    """

    function: Function
    degree: dict[str, int]
    by_momentum: bool = False
    extra: dict[str, int] = {}
    rates: Function | None = None
    coefficients: Callable[[Any], tuple[Any, ...]] = tuple
    in_case_axes: bool = False


def tensor_entries(tensor: Sequence[Sequence[Any]] | Mapping[str, Any]) -> tuple[Any, ...]:
    """The entries (9,), row by row, of a case's tensor of resistance: all, or two numbers."""
    if isinstance(tensor, Mapping):
        on, off = tensor["diagonal"], tensor["off_diagonal"]
        return on, off, off, off, on, off, off, off, on
    return tuple(entry for row in tensor for entry in row)


def damping_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """N_i/A_i = -lambda_i omega_i: a medium resists each component of the angular momentum."""
    return -(c[0] * w[0]), -(c[1] * w[1]), -(c[2] * w[2])


def resistance_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """N = -I omega: a medium resists omega through a tensor I."""
    x, y, z = matvec(c, w)
    return -x, -y, -z


def quadratic_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """N_i/A_i = -c_i |omega| omega_i: quadratic drag."""
    size = dot(w, w) ** 0.5
    return -(c[0] * size * w[0]), -(c[1] * size * w[1]), -(c[2] * size * w[2])


def fluid_torque(inertia: Iterable[Any], omega: Iterable[Any], kappa: Any) -> Components:
    """The torque of a very viscous fluid in a cavity of the body: kappa (omega'' + omega x omega'),
    where omega' and omega'' are those of free motion.

    inertia = (A, B, C) and omega = (p, q, r) are along the principal axes. The torque is orthogonal
    to G = (Ap, Bq, Cr), so |G| stays constant while the energy of the body becomes heat. For A = B
    it is the torque of Leshchenko and Kozachenko, eq. (2).

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
    """N = kappa (omega'' + omega x omega'): the torque of a fluid in a cavity of the body. omega'
    and omega'' are those of free motion, with G = A omega + h where there is a rotor."""
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
    """N = epsilon M: a torque that is fixed in the body; c holds its components."""
    return c


def brake_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """N = -b G/|G|: a brake, which brings a free body to rest in the shortest time."""
    G = angular_momentum_of(w, k)
    rate = c[0] / dot(G, G) ** 0.5
    return -(rate * G[0]), -(rate * G[1]), -(rate * G[2])


def rotor_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """N = -omega x h: the reaction of a rotor whose angular momentum h is fixed in the body."""
    return vector_product(c, w)


def space_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """N = F e: a torque along a direction e that is fixed in space. `extra` is e in body axes."""
    return c[0] * extra[0], c[0] * extra[1], c[0] * extra[2]


def direction_rates(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """gamma' = gamma x omega: the rates in body axes of a direction gamma fixed in space, which
    `extra` holds."""
    x, y, z = vector_product(extra, w)
    return k.g * x, k.g * y, k.g * z


def expression_torque(
    t: Any, c: Sequence[Any], w: Sequence[Any], k: Any, extra: Sequence[Any]
) -> Components:
    """The torque N of three expressions. They are evaluated in the case's own units, and N is
    returned in the units of the state."""
    values = dict(zip(VELOCITIES, (k.velocity_unit * x for x in w), strict=True))
    values |= {**values_of_names(k, t), **space_components(getattr(k, "attitude", None))}
    factor = k.time_unit / k.velocity_unit
    texts = k.expression1, k.expression2, k.expression3
    N1, N2, N3 = (factor * evaluate(parse_expression(text), values) for text in texts)
    return N1, N2, N3


def space_components(Q: Sequence[Any] | None) -> dict[str, Any]:
    """The components along body axes of the space axes y and z, by name, for an attitude Q. Without
    an attitude there are none."""
    if Q is None:
        return {}
    a, b, c, d = Q
    y = 2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)
    z = 2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d
    return dict(zip(SPACE_COMPONENTS, (*y, *z), strict=True))


ENTRIES = tuple(f"I{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
"""The names of the constants that hold a tensor of resistance, row by row."""

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
"""The torques by the keys of cases. The key `cavity` is another way to give `kappa`."""
