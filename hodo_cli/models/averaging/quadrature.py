"""Averages of any torque over a turn of the exact free motion, by the trapezoid, and the periodic
parts of X and Y."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .free_turn import (
    LANDEN,
    SMALLEST_M1,
    Body,
    SlowVariables,
    amplitude,
    free_motion_by_phase,
    turn_frequency,
)
from .means import turn_means

NODES = 128
"""Nodes over a turn. So little time is spent nearer the separatrix than they resolve that a
crossing time is right to 2e-13; `nodes_for` says how many a single rate takes."""

Torque = Callable[[np.ndarray], np.ndarray]
"""The perturbing torque (..., 3) of an angular velocity (..., 3), both along the sorted axes."""


def exact_rates(body: Body, omega: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """X' and Y' (...) before any averaging; omega and torque (..., 3) along the sorted axes."""
    a, b, c = body[:3]
    p, q, r = np.moveaxis(omega, -1, 0)
    N1, N2, N3 = np.moveaxis(torque, -1, 0)
    return 2 * ((a - c) * p * N1 + (b - c) * q * N2), 2 * ((a - b) * q * N2 + (a - c) * r * N3)


def nodes_for(m1: float) -> int:
    """The nodes that bring the mean over a turn to 1e-16 for m1 = 1 - m: its error is exp(-pi N
    K'/(2 K))."""
    m1 = min(max(m1, SMALLEST_M1), 1 - SMALLEST_M1)
    K, other = (
        math.pi / 2 / turn_means(1 - x, x, LANDEN).pace for x in (m1, max(1 - m1, SMALLEST_M1))
    )
    # From exp(-pi N K'/(2 K)) = 1e-16, that is N = 23.4 K/K'; whole quarters of a turn, so that the
    # nodes share the symmetry of sn and cn.
    return max(24, 4 * math.ceil(float(23.4 * K / other) / 4))


def rates_over_turn(
    body: Body, torque: Torque, slow: SlowVariables, nodes: int
) -> tuple[np.ndarray, np.ndarray]:
    """X' and Y' (..., nodes) at the phases 2 pi j/nodes of the free motion with these slow
    variables (...)."""
    wide = SlowVariables(*(np.asarray(value)[..., None] for value in slow))
    omega = free_motion_by_phase(body, wide, 2 * np.pi * np.arange(nodes) / nodes)
    return exact_rates(body, omega, torque(omega))


def mean_rates(
    body: Body, torque: Torque, slow: SlowVariables, nodes: int = NODES
) -> tuple[Any, Any]:
    """<X'> and <Y'> (...) of any torque."""
    X, Y = rates_over_turn(body, torque, slow, nodes)
    return X.mean(-1), Y.mean(-1)


def periodic_part(
    body: Body, torque: Torque, slow: SlowVariables, nodes: int = NODES
) -> tuple[Any, Any]:
    """X and Y (...) less their mean elements, at the phase of the slow variables, for any torque.

    They are the integrals, of zero mean, of the rates less their means: a Fourier coefficient of
    the rates, divided by i times its frequency, each.
    """
    pace = turn_means(1 - slow.m1, np.maximum(slow.m1, SMALLEST_M1), LANDEN).pace
    turning = turn_frequency(body, slow.pair[0], slow.side) * pace
    # Without the constant, which averaging keeps, and the last frequency, whose phase the nodes
    # cannot tell.
    k = np.arange(1, nodes // 2)
    wave = np.exp(1j * k * np.asarray(slow.phase)[..., None]) / (
        1j * k * np.asarray(turning)[..., None]
    )
    X, Y = (
        2 / nodes * (np.fft.fft(rate)[..., 1 : nodes // 2] * wave).sum(-1).real
        for rate in rates_over_turn(body, torque, slow, nodes)
    )
    return X, Y


def damped_part(body: Body, lam: Sequence[float], slow: SlowVariables) -> tuple[Any, Any]:
    """`periodic_part` relative to X_e and X_o (not X and Y) for linear resistance lam = (l1, l2,
    l3) as sorted, closed.

    (X_e - mean X_e)/X_e = -2 (l_e - l_m) Z/n,  (X_o - mean X_o)/X_o = -2 (l_o - l_m) Z/(m n), Z
    Jacobi's zeta at the phase.
    """
    l1, l2, l3 = lam
    above = np.asarray(slow.side) > 0
    n = turn_frequency(body, slow.pair[0], slow.side)
    _, zeta = amplitude(slow.phase, slow.m1)
    e, o = np.where(above, l1, l3) - l2, np.where(above, l3, l1) - l2
    return -2 * e * (1 - slow.m1) * zeta / n, -2 * o * zeta / n
