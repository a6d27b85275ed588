"""The principal axes of a body whose inertia is given as a full tensor, in other axes."""

from collections.abc import Sequence
from decimal import Decimal
from functools import lru_cache
from itertools import combinations, permutations
from typing import Any, NamedTuple

import numpy as np

ASYMMETRY = 1e-12
"""The relative difference of two entries of a symmetric tensor that is rounding."""


class PrincipalAxes(NamedTuple):
    """The tensor (3, 3), its principal moments (3,), and its axes, row by row (3, 3), as unit
    vectors in the axes of the tensor: a right-handed system.

    All are of long doubles: rounded to doubles, moments and axes belong to another tensor, along
    which a motion in extended precision goes astray as one in double does.
    """

    tensor: np.ndarray
    moments: np.ndarray
    axes: np.ndarray


def one_exceeds_others(moments: Sequence[Any] | np.ndarray) -> bool:
    """Whether one of three moments is larger than the sum of the others, which no body has.
    Equality is allowed, of a flat disc, to the rounding of the moments."""
    return bool(2 * max(moments) > sum(moments) * (1 + 4 * np.finfo(float).eps))


def excess_of_rounding(moments: Sequence[float]) -> float:
    """By how much one of three moments is larger than the sum of the others, where that is one unit
    of its last decimal at most, as rounding makes it; else 0."""
    *others, largest = sorted(moments)
    excess = largest - sum(others)
    return excess if 0 < excess <= last_digit(largest) else 0.0


def last_digit(x: float) -> float:
    """One unit of the last digit of the shortest decimal of a number, and its rounding."""
    return 10.0 ** int(Decimal(repr(float(x))).as_tuple().exponent) * (1 + 1e-9)


def symmetric(tensor: Sequence[Any]) -> Sequence[Any]:
    """A tensor whose entries differ from their transposes by one unit of the last decimal at most,
    as rounding makes it, as its symmetric part; other values as they are."""
    if not all(isinstance(row, tuple) for row in tensor):
        return tensor
    rows = [list(row) for row in tensor]
    for i, j in combinations(range(3), 2):
        a, b = rows[i][j], rows[j][i]
        if a != b and abs(a - b) <= last_digit(max(a, b, key=abs)):
            rows[i][j] = rows[j][i] = (a + b) / 2
    return tuple(map(tuple, rows))


def is_diagonal(tensor: np.ndarray) -> bool:
    """Whether a tensor has no entries besides those of its diagonal."""
    return not (tensor - np.diag(np.diag(tensor))).any()


@lru_cache(maxsize=256)
def principal_axes(tensor: tuple[tuple[float, ...], ...]) -> PrincipalAxes:
    """The principal axes of a tensor of inertia, each numbered as that of the given axes which it
    is near: those of a diagonal tensor are the given ones.

    Raises ValueError, with a sentence, for a tensor that no body has.
    """
    J = np.array(tensor, dtype=float)
    i, j = np.unravel_index(np.abs(J - J.T).argmax(), J.shape)
    if abs(J[i, j] - J[j, i]) > ASYMMETRY * np.abs(J).max():
        raise ValueError(
            f"a tensor of inertia is symmetric, and this one has {J[i, j]:g} in row {i + 1}, "
            f"column {j + 1}, and {J[j, i]:g} in the transpose"
        )
    J = (J + J.T) / 2
    axes = np.eye(3) if is_diagonal(J) else _numbered(np.linalg.eigh(J)[1])
    J = J.astype(np.longdouble)
    moments, axes = _refined(J, axes)
    named = ", ".join(f"{moment:.6g}" for moment in moments)
    if not moments.min() > 0:
        raise ValueError(f"the principal moments of this tensor are not all positive: {named}")
    if one_exceeds_others(moments):
        raise ValueError(
            f"no body has principal moments of {named}: one exceeds the sum of the other two"
        )
    return PrincipalAxes(J, moments, axes)


def _numbered(vectors: np.ndarray) -> np.ndarray:
    """Axes, the columns of `vectors`, in the order and with the signs that bring them nearest to
    the given ones."""
    order = max(permutations(range(3)), key=lambda p: sum(abs(vectors[i, p[i]]) for i in range(3)))
    axes = vectors[:, order].T
    axes = axes * np.where(np.diag(axes) < 0, -1, 1)[:, None]
    if np.linalg.det(axes) < 0:
        axes[np.abs(np.diag(axes)).argmin()] *= -1
    return axes


def _refined(J: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The moments and axes of a tensor of long doubles from axes that are right in double."""
    axes = axes.astype(np.longdouble)
    # The nearest orthogonal matrix, by Newton's method; then Jacobi's rotations. Both converge
    # quadratically.
    for _ in range(2):
        axes = (3 * axes - axes @ axes.T @ axes) / 2
        for i, j in combinations(range(3), 2):
            turned = axes @ J @ axes.T
            if turned[i, j]:
                ratio = (turned[j, j] - turned[i, i]) / (2 * turned[i, j])
                tangent = (1 if ratio >= 0 else -1) / (abs(ratio) + np.hypot(1, ratio))
                cosine = 1 / np.hypot(1, tangent)
                pair = cosine * np.array([[1, -tangent], [tangent, 1]])
                axes[[i, j]] = pair @ axes[[i, j]]
    return np.diag(axes @ J @ axes.T), axes
