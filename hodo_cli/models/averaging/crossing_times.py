"""When an averaged motion under linear resistance comes to the separatrix, and which share of
starts has come to it by a time.

u' depends on u alone, so the time t* at which u reaches 0 is a quadrature. It is finite, as 1/K ~
2/ln(16/u) stops the motion no more than a logarithm can.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .free_turn import (
    LANDEN,
    SMALLEST_M1,
    Body,
    Means,
    turn_means,
)

NODES_PER_SIDE, LAST_NODE = 100, 4.4
"""Nodes of the quadrature on either side of its middle, for 15 digits, and its end, where the
weights are below 1e-53."""

LARGEST_U = 60.0
"""The largest u of a table: fewer than 1e-25 of all starts are nearer to an axis."""

TABLE_LENGTH = 401
"""Rows of a table. Between them it is right to 1e-5 in the middle of the range and to 2e-3 next to
u = 0, far less than the true times scatter."""


def tanh_sinh() -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n,) as fractions of an interval, exact near 0, and weights (n,).

    The integrands end in ln u at u = 0, which no rule of Gauss resolves; this one does not see it.

    Source: H. Takahasi and M. Mori, Publ. RIMS 9 (1974) 721.
    """
    x = LAST_NODE / NODES_PER_SIDE * np.arange(-NODES_PER_SIDE, NODES_PER_SIDE + 1)
    argument = np.pi * np.sinh(x)
    # As fractions of the interval they stay exact near 0, where 1 - nodes near 1 would have no
    # digits.
    nodes = 1 / (1 + np.exp(-argument))
    return nodes, LAST_NODE / NODES_PER_SIDE * np.pi * np.cosh(x) * nodes / (1 + np.exp(argument))


FRACTIONS, WEIGHTS = tanh_sinh()


def shape_rate(lam: Sequence[Any], mean: Means) -> Any:
    """u' of u = |u| under linear resistance: a function of u alone, the same on both sides.

    Its terms stay apart: with <sn^2> in it, as (ln X_e)' - (ln X_o)' has through C, it cancels to
    0 at u = 0, where it tends to -2 (lambda_e - lambda_o)/K.

    Source: Akulenko, Leshchenko and Chernousko, Izv. AN SSSR MTT 1982 no. 3, 5: their k^2 equation,
    on both sides.
    """
    l_e, l_m, l_o = lam
    return -2 * ((l_e - l_m) * mean.dd + (l_m - l_o) * mean.cc)


def steady_shape(lam: Sequence[float]) -> tuple[int, float] | None:
    """The side and the m of the shape that keeps itself, u' = 0 off the separatrix, or None; lam as
    sorted.

    C/Dn falls from 1 at m = 1 to 1/2 at m = 0, so rho = (l1 - l2)/(l3 - l2) has a root on side +1
    where it is between 1/2 and 1, and 1/rho on side -1 where rho is between 1 and 2. It repels
    where l2 is the largest of the three: a threshold; else it attracts.
    """
    l1, l2, l3 = lam
    if l3 == l2 or not 0.5 < (rho := (l1 - l2) / (l3 - l2)) < 2 or rho == 1:
        return None
    side, target = (1, rho) if rho < 1 else (-1, 1 / rho)
    # Bisected in the logarithm of 1 - m, because the root may lie as near to 1 as doubles reach.
    low, high = 0.0, -math.log(SMALLEST_M1)  # of -ln(1 - m)
    while low < (middle := (low + high) / 2) < high:
        mean = turn_means(-math.expm1(-middle), math.exp(-middle), LANDEN)
        low, high = (middle, high) if mean.cc / mean.dd < target else (low, middle)
    return side, -math.expm1(-low)


def largest_crossing_u(lam: Sequence[float], side: int) -> float:
    """The u below which a motion on this side comes to the separatrix in the end: 0 for none, inf
    for all."""
    if (lam[0] - lam[2]) * side <= 0:
        return 0.0
    steady = steady_shape(lam)
    # Without a root of u', every shape moves as those near the separatrix do.
    return -math.log(steady[1]) if steady and steady[0] == side else math.inf


@np.errstate(divide="ignore", invalid="ignore")  # beyond the last u that crosses
def crossing_time(lam: Sequence[float], side: int, u: Any) -> Any:
    """t* (...) of motions at u (...) on a side, by quadrature; inf where they never cross. It knows
    neither |omega| nor the body; lam as sorted."""
    u = np.asarray(u, dtype=float)
    nodes = u[..., None] * FRACTIONS
    mean = turn_means(np.exp(-nodes), -np.expm1(-nodes), LANDEN)
    seconds = u[..., None] * WEIGHTS / np.abs(shape_rate(lam[::side], mean))
    return np.where(u < largest_crossing_u(lam, side), seconds.sum(-1), np.inf)


def crossing_table(lam: Sequence[float], side: int) -> tuple[np.ndarray, np.ndarray]:
    """u and t* (TABLE_LENGTH,) of all shapes that come to the separatrix, from u = 0 on; lam as
    sorted.

    One table serves all starts of a body under one resistance, as t* knows nothing else of them.
    Both are empty where nothing crosses.
    """
    limit = min(largest_crossing_u(lam, side), LARGEST_U)
    # Denser towards u = 0, where t* goes as u ln u.
    u = limit * np.linspace(0, 1, TABLE_LENGTH + 1)[:-1] ** 3 if limit else np.empty(0)
    return u, np.append(u[:1], crossing_time(lam, side, u[1:]))


def share_that_crosses(body: Body, lam: Sequence[float], by: np.ndarray) -> np.ndarray:
    """The share (n,) of starts, with directions of G uniform on the sphere, that cross by the times
    (n,); lam as sorted."""
    side = 1 if lam[0] > lam[2] else -1
    u, times = crossing_table(lam, side)
    if not len(u):
        return np.zeros(len(by))
    reached = np.interp(by, times, u, right=largest_crossing_u(lam, side))
    nearest = share_beyond(body, side, 0.0)
    return np.array([nearest - share_beyond(body, side, value) for value in reached])


def share_beyond(body: Body, side: int, u: float) -> float:
    """The share of directions of G, uniform on the sphere, that lie on this side and farther than
    u.

    1 - (1/2 pi) times the integral of sqrt(B/(alpha + B)) over psi, the longitude about the
    enclosed axis.
    """
    a, b, c = body[:3][::side]
    alpha = (a - b) * (a - c) / a
    if u > LARGEST_U or not alpha:
        return 0.0
    # Near u = 0 the integrand has a corner at psi = 0, which is an end of the quarter turn that
    # stands for all four.
    psi, growth = np.pi / 2 * FRACTIONS, math.exp(u)
    B = (a - b) * (b - c) * (growth - 1) / b * np.cos(psi) ** 2 + growth * (b - c) * (
        a - c
    ) / c * np.sin(psi) ** 2
    return float(1 - (WEIGHTS * np.sqrt(B / (alpha + B))).sum())
