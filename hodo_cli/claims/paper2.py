"""Checks for D. Leshchenko and T. Kozachenko, Evolution of dynamically symmetric gyrostat motion under the action of
constant torque (2023).

Equation numbers are the paper's; x = p^2 + q^2 and y = r^2.
"""

import math
from collections.abc import Sequence

import numpy as np

from ..models.constants import attributes
from ..results.motion import Motion
from .finding import Finding, beyond, if_true, listed
from .paper import check
from .quantities import end_of_spin, series


@check
def never_at_zero(motions: Sequence[Motion]) -> Finding:
    """y nears zero asymptotically: it does not reach it in finite time."""
    times = [end_of_spin(m) for m in motions]
    return Finding(if_true(min(times) == math.inf), max(times), f"y reaches 0 at {listed(times)}")


def x_at_end_of_spin(m: Motion) -> float:
    """x where r reaches 0, by interpolation between the samples."""
    return float(np.interp(end_of_spin(m), m.time, series(m, "x")))


@check
def transverse_torque_vanishes(motions: Sequence[Motion]) -> Finding:
    """M1 and M2 vanish on averaging: x at the end of spin is the same with them, in the full equations, and without."""
    values = [x_at_end_of_spin(m) for m in motions]
    apart = float(np.ptp(values) / np.max(values))
    return Finding(beyond(apart, 1e-12), apart, f"x at the end of spin {listed(values)}")


@check
def slow_variables(motions: Sequence[Motion]) -> Finding:
    """x and y change little in the first turn of (p, q): by at most 0.1, the epsilon of the figures."""
    changes = [change_per_turn(m) for m in motions]
    worst = max(changes)
    return Finding(
        beyond((worst - 0.1) / worst, 1e-12), worst, f"relative change in a turn {listed(changes)}"
    )


def change_per_turn(m: Motion) -> float:
    """|x'|/x or |y'|/y at the start, by the averaged equations, times the period of (p, q)."""
    A, _, C = m.inertia
    system, y = m.case.system, (math.sqrt(series(m, "x")[0]), math.sqrt(series(m, "y")[0]))
    rates = system.rhs(0.0, y, attributes(system.constants))
    period = 2 * math.pi / abs((C - A) / A * y[1])
    return float(max(abs(2 * rate / value) * period for rate, value in zip(rates, y, strict=True)))
