"""Checks for D. Leshchenko and T. Kozachenko, Evolution of dynamically symmetric gyrostat motion
under the action of constant torque (2023).

Equation numbers are the paper's; x = p^2 + q^2 and y = r^2. The body has A1 = A2 = A and A3 = C.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from ..cases.case import Case
from ..claims.finding import (
    Finding,
    agreement,
    deviation_unless,
    in_groups,
    listed,
)
from ..claims.measures import end_of_spin, integrated_motion, quantity
from ..claims.verdicts import changed_case
from ..models.base import attributes
from ..models.terms.fluid import reynolds
from ..results.motion import Motion

SMALLER = (1.0, 0.3, 0.1, 0.03, 0.01)
"""The factors by which kappa and epsilon fall together, from the figures' parameters towards the
limit in which the paper averages."""


def last_power(values: Sequence[float]) -> float:
    """The power of the factor with which values at the factors of SMALLER fall between the two
    smallest."""
    return math.log(values[-2] / values[-1]) / math.log(SMALLER[-2] / SMALLER[-1])


def x_at_end_of_spin(m: Motion) -> float:
    """x where r reaches 0, interpolated between the samples."""
    return float(np.interp(end_of_spin(m), m.time, quantity(m, "x")))


def transverse_torque_vanishes(motions: Sequence[Motion]) -> Finding:
    """M1 and M2 vanish on averaging: as kappa and epsilon fall together, x at the end of spin of
    the full equations with M1 and M2 tends to its value without them.

    Of 12 directions of (M1, M2), 0.3 long, the farthest counts. Decided by the power at which the
    difference falls between the two smallest factors. It is 1/2, because the averaging fails while
    the frequency, which falls with r, is no larger than the rates. The cases after the first two
    have a transverse torque at the figures' own parameters; their x at the end of spin is listed
    too.
    """
    full, averaged, *transverse = motions
    limit = x_at_end_of_spin(averaged)
    apart = []
    for factor in SMALLER:
        ends = [x_at_end_of_spin(with_torque(full, factor, i * math.pi / 6)) for i in range(12)]
        apart.append(max(abs(x - limit) for x in ends))
    power = last_power(apart)
    ends = [x_at_end_of_spin(m) for m in transverse]
    words = (
        f"x off by {listed(apart, 3)} at factors {listed(SMALLER)}; "
        f"with a torque of the figures' size x = {listed(ends)}, without {limit:.4g}"
    )
    # Within a tenth of 1/2, and falling throughout.
    return Finding(
        deviation_unless(
            abs(power - 0.5) < 0.1 and all(b < a for a, b in itertools.pairwise(apart))
        ),
        number=power,
        evidence=f"power {power:.3g}; {words}",
        contradicted_by="a power outside 0.4 to 0.6",
    )


def with_torque(m: Motion, factor: float, angle: float) -> Motion:
    """A motion by the full equations with kappa and epsilon multiplied by a factor, and with M1 and
    M2 of length 0.3 at an angle."""
    # The motion is slower as the factor falls, but its frequency is not.
    slower = weaker(m, factor, m.case.time.end / factor, int(1500 / math.sqrt(factor)))
    torque = (0.3 * math.cos(angle), 0.3 * math.sin(angle), m.case.data["torque"][2])
    return integrated_motion(changed_case(slower, {"torque": torque}))


def weaker(m: Motion, factor: float, end: float, samples: int) -> Case:
    """The case with kappa and epsilon multiplied by a factor, from time 0 to `end`."""
    data = m.case.data
    cavity = {"kappa": attributes(m.case.system.constants).kappa * factor}
    time = {"start": 0.0, "end": end, "samples": samples}
    return changed_case(
        m.case, {"cavity": cavity, "epsilon": data["epsilon"] * factor, "time": time}
    )


SMALL_NUMBER = 0.01
"""The Reynolds number below which a flow counts as slow."""


def small_Reynolds_number(motions: Sequence[Motion]) -> Finding:
    """The Reynolds number of the flow at the start is below SMALL_NUMBER; decided by the
    largest."""
    numbers = [reynolds(m.case.data["cavity"], m.omega[0]) for m in motions]
    return Finding(
        deviation_unless(max(numbers) <= SMALL_NUMBER),
        number=max(numbers),
        evidence=f"Re = {listed(numbers)}",
        contradicted_by=f"a number above {SMALL_NUMBER:g}",
    )


TURN_SAMPLES = 401
"""The samples in a turn of (p, q), enough to show the change of p."""


def slow_x_and_y(motions: Sequence[Motion]) -> Finding:
    """x and y are slow: in the first turn of (p, q) they change by the order of kappa and epsilon,
    while p changes by its own size. Decided by the smallest power of that order."""
    powers, words = [], []
    for m in motions:
        turns = [first_turn(m, factor) for factor in SMALLER]
        changes = [max(np.ptp(quantity(turn, name)) for name in ("x", "y")) for turn in turns]
        powers.append(last_power(changes))
        p = np.ptp(quantity(turns[-1], "p"))
        words.append(f"{listed(changes, 3)} (p by {p:.3g})")
    power = min(powers)
    changed_by = "; ".join(words)
    # x and y are 1 at the start; the second order still bends the power at these factors.
    return Finding(
        deviation_unless(power >= 0.9),
        number=power,
        evidence=f"x or y changes by {changed_by} at factors {listed(SMALLER)}: power {power:.3g}",
        contradicted_by="a power below 0.9",
    )


def first_turn(m: Motion, factor: float) -> Motion:
    """The first turn of (p, q) by the full equations, with kappa and epsilon multiplied by a
    factor."""
    A, _, C = m.inertia
    turn = float(2 * math.pi / abs((C - A) / A * m.omega[0, 2]))
    return integrated_motion(weaker(m, factor, turn, TURN_SAMPLES))


def averaging_is_exact(motions: Sequence[Motion]) -> Finding:
    """With M1 = M2 = 0 the corrected averaged system is an identity of the full equations; cases
    in pairs, full and averaged, compared at the times that both have, until the spin ends.
    """
    pairs = []
    for full, averaged in in_groups(motions, 2):
        _, i, j = np.intersect1d(full.time.round(9), averaged.time.round(9), return_indices=True)
        pairs += [(quantity(full, n)[i], quantity(averaged, n)[j]) for n in ("x", "y")]
    return agreement(pairs, 1e-10)
