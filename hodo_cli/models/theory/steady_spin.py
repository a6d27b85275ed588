"""Steady rotation about a body axis under a sum of torques: whether a small tilt grows."""

from typing import Any

import numpy as np

from .possible_crossings import Dissipation


def tilt_growth_rates(terms: Dissipation, omega: Any) -> np.ndarray:
    """The rate (..., 3) at which a small tilt away from rotation about each body axis, at the speed
    omega (..., 3), grows on the mean over a turn; not a number for the middle axis, about which
    free rotation is unstable.

    With i the axis, j and k the others, w = |omega_i|, and M a torque fixed in the body it is

        lambda_i - (lambda_j + lambda_k)/2 + [c_i - (c_j + c_k)/2] w + e_i w - M_i/(A_i omega_i)
            - (F_j + F_k) w^2/2,    F_j = kappa (A_i - A_j)(A_i + A_j - A_k)/(A_j^2 A_k),

    the other letters as in `possible_crossings`, to first order in the torques. A torque along G
    adds nothing: it slows rotation and tilt alike. Where the rate is positive the motion leaves the
    axis, though not always for the other one: it may end as an oscillation of constant shape on the
    same side.
    """
    A, damping, quadratic, by_axes, torque, omega = (
        np.asarray(x, float) for x in (*terms[:4], terms.torque, omega)
    )
    w, kappa = np.abs(omega), np.asarray(terms.kappa, float)[..., None]
    j, k = np.roll(A, -1, -1), np.roll(A, -2, -1)
    fluid = (A - j) * (A + j - k) / (j * j * k) + (A - k) * (A + k - j) / (k * k * j)
    with np.errstate(divide="ignore", invalid="ignore"):
        driven = np.where(torque == 0, 0, torque / (A * omega))
    growth = _above_others(damping) + _above_others(quadratic) * w + by_axes * w
    growth = growth - driven - kappa * fluid * w * w / 2
    # For an axis whose moment is the middle one too, a symmetric body has no such turn.
    return np.where(np.sort(A, axis=-1)[..., 1:2] == A, np.nan, growth)


def _above_others(rates: np.ndarray) -> np.ndarray:
    """Each rate (..., 3) less the mean of the other two; 0 where it is their rounding."""
    others = (np.roll(rates, -1, -1) + np.roll(rates, -2, -1)) / 2
    rounding = 4 * np.finfo(float).eps * np.abs(rates).max(-1, keepdims=True)
    return np.where(np.abs(rates - others) <= rounding, 0, rates - others)


def driven_spin(terms: Dissipation, i: int) -> tuple[float, bool]:
    """The rotation omega_i = M_i/(lambda_i A_i) that a torque M along body axis i alone holds
    against damping, and whether it is stable.

    A tilt (w_j, w_k) has the eigenvalues x of (x + lambda_j)(x + lambda_k) = (A_k - A_i)(A_i - A_j)
    omega_i^2/(A_j A_k), which is negative but for the middle axis.
    """
    A, damping, j, k = terms.inertia, terms.damping, (i + 1) % 3, (i + 2) % 3
    omega = terms.torque[i] / (damping[i] * A[i])
    product = (A[k] - A[i]) * (A[i] - A[j]) / (A[j] * A[k]) * omega * omega
    return omega, damping[j] + damping[k] > 0 and damping[j] * damping[k] > product
