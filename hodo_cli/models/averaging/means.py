"""Means over a turn of the free motion: in closed form, with the averaged rates of linear
resistance and of a fluid-filled cavity, and of any torque by the trapezoid, with the periodic parts
of X and Y.

The closed forms are written with + - * / and **, for numbers, arrays and the symbols of an engine.
The elliptic integrals come by the arithmetic-geometric mean as sums of positive terms:
(K - E)/(m K) loses its digits as m -> 0.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .free_turn import (
    LANDEN,
    SMALLEST_M1,
    Body,
    SlowVariables,
    free_motion_by_phase,
    turn_frequency,
)

AGM = 8
"""Steps of the mean: they bring 1 - m = 1e-16 to the last digit of a double."""


class Means(NamedTuple):
    """<sn^2>, <sn^4>, C = <cn^2>, Dn = <dn^2> = E/K, and <dn> = pi/(2K), at which the phase
    grows."""

    ss: Any
    ssss: Any
    cc: Any
    dd: Any
    dn: Any


def turn_means(m: Any, m1: Any, steps: int = AGM) -> Means:
    """The means of a turn for the modulus m = k^2 and m1 = 1 - m.

    <sn^2> = 1/2 + m S with S = sum of 2^(n-1) c_n^2/m^2, and c_{n+1} = c_n^2/(4 a_{n+1}). Then
    <sn^4> = (2(1 + m) <sn^2> - 1)/(3m) is (1 + 2(1 + m) S)/3, without its division.

    Source: M. Abramowitz and I. A. Stegun, 17.6.
    """
    # A power series of an engine has some twenty coefficients, of which only the first needs all
    # these steps.
    total, dn = (
        m.functions(lambda first: sums_of_mean(first, 1 - first, steps), slopes)
        if hasattr(m, "functions")
        else sums_of_mean(m, m1, steps)
    )
    ss = 0.5 + m * total
    return Means(ss, (1 + 2 * (1 + m) * total) / 3, 0.5 - m * total, 1 - m * ss, dn)


def slopes(m: Any, functions: Sequence[Any]) -> tuple[Any, Any]:
    """m dS/dm and m d<dn>/dm of S = (<sn^2> - 1/2)/m and <dn>, given them: nothing cancels, at
    m = 0 or elsewhere.

    Source: the derivatives of K and E, M. Abramowitz and I. A. Stegun, 17.3, in these variables.
    """
    total, dn = functions
    cc = 0.5 - m * total
    ratio = cc / (2 * (1 - m))
    return cc * ratio - 2 * total, -m * ratio * dn


def sums_of_mean(m: Any, m1: Any, steps: int) -> tuple[Any, Any]:
    """S = (<sn^2> - 1/2)/m and <dn>, by the arithmetic-geometric mean."""
    root = m1**0.5
    a, b = (1 + root) / 2, root**0.5
    square, factor = 1 / (4 * (1 + root) * (1 + root)), 1  # c_n^2/m^2 and 2^(n-1)
    total = square
    # A fixed number of steps, because symbols of an engine cannot be compared with a tolerance.
    for _ in range(steps - 1):
        a, b = (a + b) / 2, (a * b) ** 0.5
        square, factor = m * m * square * square / (16 * a * a), 2 * factor
        total = total + factor * square
    return total, a


def linear_rates(lam: Sequence[Any], mean: Means) -> tuple[Any, Any]:
    """(ln X_e)' and (ln X_o)' under linear resistance lam = (lambda_e, lambda_m, lambda_o). No
    moment of inertia occurs."""
    l_e, l_m, l_o = lam
    return -2 * (l_m + (l_e - l_m) * mean.dd), -2 * (l_m + (l_o - l_m) * mean.cc)


def shape_rate(lam: Sequence[Any], mean: Means) -> Any:
    """u' of u = |u| under linear resistance: a function of u alone, the same on both sides.

    Its terms stay apart: with <sn^2> in it, as (ln X_e)' - (ln X_o)' has through C, it cancels to
    0 at u = 0, where it tends to -2 (lambda_e - lambda_o)/K.

    Source: Akulenko, Leshchenko and Chernousko, Izv. AN SSSR MTT 1982 no. 3, 5: their k^2 equation,
    on both sides.
    """
    l_e, l_m, l_o = lam
    return -2 * ((l_e - l_m) * mean.dd + (l_m - l_o) * mean.cc)


def fluid_loss(weights: Sequence[Any], m: Any, mean: Means) -> Any:
    """-h'/(X_e X_o) of the fluid's torque, h = 2T, with the weights of cn^2 dn^2, sn^2 dn^2 and m
    sn^2 cn^2.

    X_o is a factor of h': a steady rotation about the enclosed axis loses nothing. G is kept:
    X' = -c h', Y' = a h'.
    """
    cd, sd, sc = weights
    # <sn^2 cn^2> and <sn^2 dn^2>, by sn^2 + cn^2 = 1 and dn^2 = 1 - m sn^2.
    ss_cc, ss_dd = mean.ss - mean.ssss, mean.ss - m * mean.ssss
    return cd * (mean.cc - m * ss_cc) + sd * ss_dd + sc * m * ss_cc


def fluid_weights(body: Body) -> tuple[float, float, float]:
    """The weights of `fluid_loss` on side +1, for kappa = 1; on side -1 the last two are exchanged.

    -h' = (2 kappa/abc) [(a-c)^2 (a+c-b) <p^2 r^2> + (a-b)^2 (a+b-c) <p^2 q^2>
                         + (b-c)^2 (b+c-a) <q^2 r^2>], and X_o (b-c) = m X_e (a-b) on side +1

    Source: the power N.omega of Chernousko's torque, an identity in p, q, r.
    """
    a, b, c = body[:3]
    pr, pq, qr = (
        (a + c - b) / (a * c),
        (a - b) * (a + b - c) / (a * b * (a - c)),
        (b - c) * (b + c - a) / (b * c * (a - c)),
    )
    unit = 2 / (a * b * c)
    return unit * pr, unit * pq, unit * qr


NODES = 128
"""Nodes over a turn. So little time is spent nearer the separatrix than they resolve that a
crossing time is right to 2e-13; `nodes_for` says how many a single rate takes."""

Torque = Callable[[np.ndarray], np.ndarray]
"""The perturbing torque (..., 3) of an angular velocity (..., 3), both along the sorted axes."""


def nodes_for(m1: float) -> int:
    """The nodes that bring the mean over a turn to 1e-16 for m1 = 1 - m: its error is exp(-pi N
    K'/(2 K))."""
    m1 = min(max(m1, SMALLEST_M1), 1 - SMALLEST_M1)
    K, other = (
        math.pi / 2 / turn_means(1 - x, x, LANDEN).dn for x in (m1, max(1 - m1, SMALLEST_M1))
    )
    # From exp(-pi N K'/(2 K)) = 1e-16, that is N = 23.4 K/K'; whole quarters of a turn, so that the
    # nodes share the symmetry of sn and cn.
    return max(24, 4 * math.ceil(float(23.4 * K / other) / 4))


def rates_over_turn(body: Body, torque: Torque, slow: SlowVariables, nodes: int) -> np.ndarray:
    """X_e' and X_o' (2, ..., nodes) at the phases 2 pi j/nodes of the free motion with these slow
    variables (...)."""
    wide = SlowVariables(*(np.asarray(value)[..., None] for value in slow))
    omega = free_motion_by_phase(body, wide, 2 * np.pi * np.arange(nodes) / nodes)
    p, q, r = np.moveaxis(omega, -1, 0)
    N1, N2, N3 = np.moveaxis(torque(omega), -1, 0)
    a, b, c = body[:3]
    X, Y = 2 * ((a - c) * p * N1 + (b - c) * q * N2), 2 * ((a - b) * q * N2 + (a - c) * r * N3)
    return np.where(wide.side > 0, (X, Y), (Y, X))


def periodic_part(body: Body, torque: Torque, slow: SlowVariables, nodes: int) -> np.ndarray:
    """X_e and X_o (2, ...) less their mean elements, at the phase of the slow variables, for any
    torque.

    They are the integrals, of zero mean, of the rates less their means: a Fourier coefficient of
    the rates, divided by i times its frequency, each.
    """
    mean = turn_means(1 - slow.m1, np.maximum(slow.m1, SMALLEST_M1), LANDEN)
    turning = turn_frequency(body, slow.X_e, slow.side) * mean.dn
    # Without the constant, which averaging keeps, and the last frequency, whose phase the nodes
    # cannot tell.
    k = np.arange(1, nodes // 2)
    wave = np.exp(1j * k * np.asarray(slow.phase)[..., None]) / (
        1j * k * np.asarray(turning)[..., None]
    )
    amplitudes = np.fft.fft(rates_over_turn(body, torque, slow, nodes))[..., 1 : nodes // 2]
    return np.asarray(2 / nodes * (amplitudes * wave).sum(-1).real)
