"""The inertia of a body by the constants k of its equations: A1, A2, A3 along the principal axes;
`principal_axes`, `tensor` and `inverse` (9,), row by row, of a body that is given by its full
tensor in the axes of its case; h1, h2, h3 of a rotor.

Vectors are three components: numbers, arrays or an engine's symbols.
"""

from collections.abc import Sequence
from typing import Any

Components = tuple[Any, Any, Any]


def times(matrix: Sequence[Any], v: Sequence[Any]) -> Components:
    """The product of a matrix, given row by row (9,), and a vector."""
    x, y, z = v
    a, b, c, d, e, f, g, h, i = matrix
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def vector_product(a: Sequence[Any], b: Sequence[Any]) -> Components:
    """The vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The scalar product a.b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def vector_sum(a: Sequence[Any], b: Sequence[Any]) -> Components:
    """The sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def along_principal_axes(v: Sequence[Any], k: Any) -> Sequence[Any]:
    """The components along the principal axes of a vector (3,) in the axes of the case."""
    return times(k.principal_axes, v) if hasattr(k, "principal_axes") else v


def from_principal_axes(v: Sequence[Any], k: Any) -> Sequence[Any]:
    """The inverse of `along_principal_axes`."""
    if not hasattr(k, "principal_axes"):
        return v
    a, b, c, d, e, f, g, h, i = k.principal_axes
    return times((a, d, g, b, e, h, c, f, i), v)


def accelerations(torque: Sequence[Any], k: Any) -> Components:
    """The angular acceleration that a torque gives a body; with a full tensor of inertia by its
    inverse."""
    if hasattr(k, "tensor"):
        return times(k.inverse, torque)
    return torque[0] / k.A1, torque[1] / k.A2, torque[2] / k.A3


def angular_momentum_of(w: Sequence[Any], k: Any) -> Components:
    """G = A omega, and h of a rotor."""
    G = times(k.tensor, w) if hasattr(k, "tensor") else (k.A1 * w[0], k.A2 * w[1], k.A3 * w[2])
    rotor = rotor_of(k)
    return G if rotor is None else vector_sum(G, rotor)


def rotor_of(k: Any) -> Components | None:
    """h of a rotor in the units of A omega, or None."""
    # As every constant of degree 1 it is in units of the time as well, and so is g.
    return (k.h1 / k.g, k.h2 / k.g, k.h3 / k.g) if hasattr(k, "h1") else None


def principal_rotor_of(k: Any) -> Sequence[Any] | None:
    """h (3,) of a rotor along the principal axes, in the units of A omega; None without."""
    rotor = rotor_of(k)
    return None if rotor is None else along_principal_axes(rotor, k)
