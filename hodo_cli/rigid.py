"""A rigid body by its principal moments of inertia: pure functions of (A, omega)."""

from typing import Any

import numpy as np

UNDETERMINED, SEPARATRIX = -1, 0
LABELS = {-1: "undetermined", 0: "separatrix", 1: "x1", 2: "x2", 3: "x3"}


def angular_momentum(A: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """G = A omega, in body axes; A (3,), omega (..., 3)."""
    return np.asarray(A * omega)


def kinetic_energy(A: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """T = (A1 p^2 + A2 q^2 + A3 r^2) / 2; A (3,), omega (..., 3)."""
    return np.asarray((A * omega * omega).sum(axis=-1) / 2)


def inertia_order(A: Any) -> tuple[int, int, int]:
    """The positions of the largest, middle and smallest moment of inertia; ties keep the order given."""
    largest, middle, smallest = sorted(range(3), key=lambda i: -A[i])
    return largest, middle, smallest


def separatrix_terms(A: Any, omega: Any, order: tuple[int, int, int]) -> tuple[Any, Any]:
    """The two non-negative terms whose difference is D = G^2 - 2 T A_middle.

    D = A_l (A_l - A_m) w_l^2 - A_s (A_m - A_s) w_s^2, with l, m, s the axes of largest, middle and smallest
    inertia. The hodograph of G encloses axis l where D > 0 and axis s where D < 0. Subtracting G^2 - 2TA_m
    itself loses every digit near the separatrix; this form costs only what the data's own conditioning costs.

    Source: Rachinskaya, eqs (7)-(8), solved for D.
    """
    l, m, s = order
    return A[l] * (A[l] - A[m]) * omega[l] * omega[l], A[s] * (A[m] - A[s]) * omega[s] * omega[s]


def near_middle_axis(A: Any, omega: Any, order: tuple[int, int, int]) -> Any:
    """How the terms of D compare with what they could be: (outer + inner) / (sum of their weights * |omega|^2).

    Its root is, roughly, the angle between the rotation and the middle axis of a triaxial body.
    """
    l, m, s = order
    weight = A[l] * (A[l] - A[m]) + A[s] * (A[m] - A[s])
    return sum(separatrix_terms(A, omega, order)) / (weight * (omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2))


def enclosed_axis(A: Any, omega: np.ndarray, band: float) -> np.ndarray:
    """The axis that the hodograph of G encloses, for omega (..., 3) at any scale, as int8.

    1, 2, 3 name the body axes; 0 is the separatrix, where |D| is at most `band` times the sum of its two terms,
    or the rotation is within `band` of the middle axis, so that its error may exceed the components which decide;
    -1 is undetermined: no rotation, or no axis to go round (steady rotation of a symmetric or spherical body).
    """
    order, w = inertia_order(A), np.moveaxis(omega, -1, 0)
    largest, middle, smallest = order
    outer, inner = separatrix_terms(A, w, order)
    difference, total = outer - inner, outer + inner
    labels = np.where(difference > 0, largest + 1, smallest + 1)
    labels = np.where(np.abs(difference) <= band * total, SEPARATRIX, labels)
    known = np.isfinite(total) & (total > 0)
    if A[largest] > A[middle] > A[smallest]:
        known = np.isfinite(total) & np.any(omega != 0, axis=-1)
        with np.errstate(invalid="ignore"):
            labels = np.where(near_middle_axis(A, w, order) <= band * band, SEPARATRIX, labels)
    return np.where(known, labels, UNDETERMINED).astype(np.int8)
