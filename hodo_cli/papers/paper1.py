"""Checks for A. L. Rachinskaya, Rotation of a rigid body in a resisting medium (UDC 521.1).

Equation numbers are the paper's. Its body axes are ordered: A1 > A2 > A3.
"""

import itertools
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..claims.finding import Check, Finding, Trend, agreement, difference, erratum, if_true, listed
from ..claims.quantities import first, number, reach, swept_angle, zeros
from ..engines import have_taylor
from ..engines.protocol import EPS
from ..integration.solve import solve
from ..models.theory import closed_form
from ..models.theory.closed_form import free_motion, sn_cn_dn
from ..results.motion import Motion


def numerical_motion(m: Motion) -> np.ndarray:
    """omega (n, 3) by numerical integration: a closed form shall not be compared with itself."""
    method = "taylor" if have_taylor() else "DOP853"
    return solve(m.case, method, m.case.precision, times=m.time).variables["omega"]


@Check
def free_rotation(motions: Sequence[Motion]) -> Finding:
    """Free rotation is Euler's and Jacobi's closed form."""
    return agreement(
        [
            (numerical_motion(m), free_motion(m.inertia, m.omega[0], m.time - m.time[0]))
            for m in motions
        ],
        1e-10,
    )


@Check
def no_closed_form(motions: Sequence[Motion]) -> Finding:
    """There is no closed form: holds where that of `free_rotation` fails."""
    free = free_rotation.judge(motions)
    return Finding(if_true(free.deviation > 0), free.number, f"the closed form {free.words}")


@Check
def free_rotation_from_q0(motions: Sequence[Motion]) -> Finding:
    """Free motion from any start is the closed form for q0 = 0, with time counted from a passage of
    q through 0."""
    pairs = []
    for m in motions:
        since, passage = passage_of_q(m)
        pairs.append((numerical_motion(m), free_motion(m.inertia, passage, m.time - since)))
    # The passage is known to some rounding errors of a period, which the motion then carries along.
    return agreement(pairs, 1e-9)


def passage_of_q(m: Motion) -> tuple[float, np.ndarray]:
    """A time at which a free motion passes q = 0, and omega (3,) there: Newton's method on q(t)."""
    A, start = m.inertia, m.omega[0]
    near = first(zeros(m.time, m.omega[:, 1])) if start[1] else float(m.time[0])
    # Quadratic from a sample nearby, so that five steps would do.
    for _ in range(10):
        p, q, r = free_motion(A, start, np.array([near - m.time[0]]))[0]
        # q' of Euler's equations for free motion.
        near -= q * A[1] / ((A[2] - A[0]) * p * r)
    return near, free_motion(A, start, np.array([near - m.time[0]]))[0] * (1, 0, 1)


@Check
def turning_axis(motions: Sequence[Motion]) -> Finding:
    """A free motion goes round the axis whose component of G never changes sign, and that is the
    axis enclosed by the criterion 2 T A1 >= G^2 > 2 T A2.
    """
    right = 0
    for m in motions:
        largest, _, smallest = m.order
        keeps = [
            bool((m.omega[:, i] > 0).all() or (m.omega[:, i] < 0).all())
            for i in (largest, smallest)
        ]
        seen = {(True, False): largest + 1, (False, True): smallest + 1}.get((keeps[0], keeps[1]))
        right += seen == m.labels[0]
    return Finding(
        if_true(right == len(motions)),
        float(right),
        f"{right} of {len(motions)} as the criterion says",
    )


@Check
def equal_damping(motions: Sequence[Motion]) -> Finding:
    """omega(t) = exp(-lambda t) Omega((1 - exp(-lambda t))/lambda), Omega free from the same start.

    Source: E. Padova 1885, as cited; the paper's eq (5) with the time that meets the initial data.
    """
    return agreement([(numerical_motion(m), by_equal_damping(m)) for m in motions], 1e-10)


def by_equal_damping(m: Motion) -> np.ndarray:
    """omega (n, 3) by the closed form for three equal coefficients."""
    lam = m.case.data["damping"][0]
    return closed_form.damped_motion(m.inertia, m.omega[0], lam, m.time - m.time[0])


@Check
def turns_about_x1_only(motions: Sequence[Motion]) -> Finding:
    """G makes no full turn about x2 or x3, followed over the whole motion."""
    return turns_about_others(motions, 0)


@Check
def turns_about_x3_only(motions: Sequence[Motion]) -> Finding:
    """G makes no full turn about x1 or x2, followed over the whole motion."""
    return turns_about_others(motions, 2)


def turns_about_others(motions: Sequence[Motion], axis: int) -> Finding:
    """How far G turns about the other two axes; decided by the largest, in turns."""
    others = [abs(swept_angle(m, i)) for m in motions for i in range(3) if i != axis]
    own = [abs(swept_angle(m, axis)) for m in motions]
    words = f"{listed(own)} turns about x{axis + 1}, at most {max(others):.3g} about another axis"
    return Finding(if_true(max(others) < 1), max(others), words)


@Check
def inequality_7(motions: Sequence[Motion]) -> Finding:
    """p^2 > K r^2, with K by the moments of inertia alone, exactly where G^2 > 2 T A2."""
    wrong = 0
    for m in motions:
        # In units of |omega|, so that no size matters.
        w = m.omega / np.abs(m.omega).max(axis=1, keepdims=True)
        A1, A2, A3 = m.inertia
        G2, h = (m.inertia**2 * w * w).sum(axis=1), (m.inertia * w * w).sum(axis=1)
        # Nearer to the separatrix the difference of G^2 and 2 T A2, as it stands, is rounding.
        clear = np.abs(G2 - h * A2) > 64 * EPS * G2
        # Written out as the paper has it, and not by `slope`, which is what is tested.
        K = A3 * (A2 - A3) / (A1 * (A1 - A2))
        wrong += int(((h * A2 < G2) != (w[:, 0] ** 2 > K * w[:, 2] ** 2))[clear].sum())
    return Finding(if_true(wrong == 0), float(wrong), f"{wrong} samples on the other side")


def decay_rate(m: Motion) -> float:
    """The mean rate of decay of |G|."""
    G = m["G"]
    return float(np.log(G[0] / G[-1]) / (m.time[-1] - m.time[0]))


def factorial_effects(values: Sequence[float]) -> tuple[float, float]:
    """The mean effects of two factors on values at (low, low), (high, low), (low, high), (high,
    high)."""
    low, first_high, second_high, both = values
    return abs(first_high - low + both - second_high) / 2, abs(
        second_high - low + both - first_high
    ) / 2


@Check
def diagonal_sets_decay(motions: Sequence[Motion]) -> Finding:
    """The diagonal entries, the first factor, have more effect on the decay of |G| than the others,
    the second."""
    values = [decay_rate(m) for m in motions]
    diagonal, off = factorial_effects(values)
    words = f"rate of decay {listed(values)}: effects {listed((diagonal, off))}"
    return Finding(if_true(diagonal > off), diagonal / off, words)


@Check
def off_diagonal_sets_area(motions: Sequence[Motion]) -> Finding:
    """The off-diagonal entries, the second factor, have more effect on the largest p^2 in A than
    the diagonal ones."""
    values = [reach(m, 0) for m in motions]
    diagonal, off = factorial_effects(values)
    words = f"largest p^2 in A {listed(values)}: effects {listed((diagonal, off))}"
    return Finding(if_true(off > diagonal), off / diagonal, words)


@Check
def criterion_predicts(motions: Sequence[Motion]) -> Finding:
    """Before the crossing from x1 to x3 r changes sign, and never p; after it p, and never r."""
    steps, words = [], []
    for m in motions:
        times = [
            float(np.max(zeros(m.time, m.omega[:, 2]), initial=-math.inf)),
            m.crossings[0].time if m.crossings else math.inf,
            first(zeros(m.time, m.omega[:, 0])),
        ]
        steps += [times[1] - times[0], times[2] - times[1]]
        words.append(listed(times))
    return Finding(
        if_true(min(steps) > 0), min(steps), f"last of r, crossing, first of p: {'; '.join(words)}"
    )


@Trend
def difference_decides(members: Sequence[Sequence[Motion]]) -> Finding:
    """A start about x1 turns to x3 for lambda1 > lambda3 alone; decided by the share that does."""
    differences, times = crossing_times(members)
    up, down = times[differences > 0], times[differences <= 0]
    crossed, wrong = int(np.isfinite(up).sum()), int(np.isfinite(down).sum())
    words = (
        f"{crossed} of {len(up)} cross where lambda1 > lambda3, "
        f"{wrong} of {len(down)} where lambda1 <= lambda3"
    )
    return Finding(if_true(crossed > 0 and wrong == 0), crossed / len(up), words)


@Trend
def larger_difference_sooner(members: Sequence[Sequence[Motion]]) -> Finding:
    """The larger lambda1 - lambda3, the sooner the crossing, as a trend over all coefficients.

    Decided by the rank correlation (Spearman's) of the difference and the time of the crossing,
    among the members that cross: below -0.8.
    """
    differences, times = crossing_times(members)
    differences, times = differences[np.isfinite(times)], times[np.isfinite(times)]
    correlation = float(np.corrcoef(ranks(differences), ranks(times))[0, 1])
    pairs = [(i, j) for i, j in itertools.combinations(range(len(times)), 2)]
    apart = [(i, j) for i, j in pairs if differences[i] != differences[j]]
    reversed_ = sum((differences[i] < differences[j]) == (times[i] < times[j]) for i, j in apart)
    share = reversed_ / len(apart)
    words = f"rank correlation {correlation:.2f}, {share:.1%} of {len(apart)} pairs reversed"
    # A trend, and no law: the middle coefficient matters too, so pairs may be reversed.
    return Finding(if_true(correlation < -0.8), correlation, words)


def ranks(values: np.ndarray) -> np.ndarray:
    """The mean rank (n,) of each value; equal values share theirs."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - (count - 1) / 2)[place])


def crossing_times(members: Sequence[Sequence[Motion]]) -> tuple[np.ndarray, np.ndarray]:
    """lambda1 - lambda3 and the time of the first crossing, infinite without one, of members of one
    motion each.
    """
    motions = [m for (m,) in members]
    damping = np.array([m.case.data["damping"] for m in motions])
    times = np.array([number(m, "first_crossing") for m in motions])
    # To the last digit but three, so that 0.003 - 0.001 and 0.005 - 0.003 are one difference.
    return np.round(damping[:, 0] - damping[:, 2], 12), times


EXPLICIT = 0.1
"""The |G|, of about 1 at the start, above which a turn can be seen in a figure of the motion."""


@Check
def explicitly_about_x3(motions: Sequence[Motion]) -> Finding:
    """G never makes a full turn about x3 while x3 is enclosed and |G| > EXPLICIT; decided by the
    largest part of a turn that it makes.
    """
    turns = [longest_turn(m, 2, EXPLICIT) for m in motions]
    most = max(turns)
    return Finding(if_true(most < 1), most, f"{listed(turns)} turns about x3")


@Check
def another_character(motions: Sequence[Motion]) -> Finding:
    """The first motion goes explicitly round x3, for a full turn at least, and the second does not;
    decided by the turns of the second.
    """
    first, second = (longest_turn(m, 2, EXPLICIT) for m in motions)
    words = f"{first:.3g} turns about x3 in Fig 12, {second:.3g} in Fig 14"
    return Finding(if_true(second < 1 <= first), second, words)


def longest_turn(m: Motion, axis: int, least: float) -> float:
    """The turns about an axis in the longest stretch that encloses it with |G| above `least`."""
    inside = (m.labels == axis + 1) & (m["G"] > least)
    edges = np.flatnonzero(np.diff(np.r_[False, inside, False]))
    stretches = [np.arange(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return max((abs(swept_angle(m, axis, part)) for part in stretches), default=0.0)


# Errata: each check shows the printed form wrong and the corrected one right.


@Check
def unit_of_angular_velocity(motions: Sequence[Motion]) -> Finding:
    """|omega(0)| = 1, as omega0 = |omega(0)| makes it, is farther off in the printed starts than
    |G(0)| = 1.
    """
    speed = [float(np.linalg.norm(m.omega[0])) for m in motions]
    size = [float(m["G"][0]) for m in motions]
    off, corrected = (float(np.abs(np.array(values) - 1).max()) for values in (speed, size))
    words = (
        f"|omega(0)| from {min(speed):.4g} to {max(speed):.4g}, "
        f"|G(0)| from {min(size):.4g} to {max(size):.4g}"
    )
    return Finding(if_true(corrected < off / 5), off, words)


@Check
def slow_time(motions: Sequence[Motion]) -> Finding:
    """omega changes in tau = omega0 t much faster than it is damped: tau is no slow time."""
    (m,) = motions
    k = SimpleNamespace(**m.case.system.constants)
    rate = np.linalg.norm(m.case.system.rhs(0.0, [*m.omega[0]], k))
    fast = float(rate / np.linalg.norm(m.omega[0]))
    slow = max(m.case.data["damping"])
    words = f"omega turns at the rate {fast:.3g} and is damped at {slow:.3g}"
    return Finding(if_true(fast > 10 * slow), fast / slow, words)


DIMENSIONAL = {"A1": 3.0, "omega0": 7.0}
"""Units far from 1, in which a factor that is left out shows."""


@Check
def damping_in_equations_4(motions: Sequence[Motion]) -> Finding:
    """Eqs (3) in other units are (4) with lambda/omega0, and not with the printed lambda."""
    return scaled(motions, "lam")


@Check
def resistance_in_equations_11(motions: Sequence[Motion]) -> Finding:
    """Eqs (10) in other units are (11) with I/(A1 omega0), and not with the printed I/A1."""
    return scaled(motions, "I")


def scaled(motions: Sequence[Motion], letter: str) -> Finding:
    """The derivative of omega in a body of DIMENSIONAL size, made dimensionless, beside that of the
    dimensionless equations with the coefficients as printed and as corrected.
    """
    (m,) = motions
    rhs = m.case.system.rhs
    A1, omega0 = DIMENSIONAL["A1"], DIMENSIONAL["omega0"]
    small: dict[str, Any] = dict(m.case.system.constants)
    coefficients = [name for name in small if name.startswith(letter)]
    body = {name: value * A1 for name, value in small.items() if name in ("A1", "A2", "A3")}
    # lambda is a rate; I is a rate times a moment of inertia.
    unit = A1 if letter == "I" else 1.0
    large = {name: small[name] * unit * omega0 for name in coefficients}
    start = m.omega[0]
    true = np.array(rhs(0.0, [*(omega0 * start)], SimpleNamespace(**{**small, **body, **large})))
    # A rate of omega is in units of omega0^2.
    true /= omega0**2
    as_printed = {name: value / unit for name, value in large.items()}
    printed = np.array(rhs(0.0, [*start], SimpleNamespace(**{**small, **as_printed})))
    corrected = np.array(rhs(0.0, [*start], SimpleNamespace(**small)))
    return erratum(difference([(true, printed)]), difference([(true, corrected)]), 1e-12)


@Check
def curve_3(motions: Sequence[Motion]) -> Finding:
    """|D|/G^2 of curve 3 with the printed and with the corrected r0; near is up to 0.001."""
    printed, corrected = (number(m, "separatrix_distance", "start") for m in motions)
    return erratum(printed, corrected, 0.001)


@Check
def third_coefficient(motions: Sequence[Motion]) -> Finding:
    """lambda1 has one value: with 0.005 for it and 0.003 for lambda3 the motion turns to x3, as the
    text says; with 0.003 for it and 0.005 for lambda3 it does not.
    """
    exchanged, corrected = (len(m.crossings) for m in motions)
    words = f"{corrected} crossing with lambda3 = 0.003, {exchanged} with lambda1 = 0.003"
    return Finding(if_true(corrected == 1 and exchanged == 0), float(corrected), words)


@Check
def equation_6(motions: Sequence[Motion]) -> Finding:
    """(5)-(6) as printed, in the better of their two signs, and the closed form that meets the
    initial data, each beside the motion.
    """
    printed = difference([(numerical_motion(m), as_in_equation_6(m)) for m in motions])
    corrected = difference([(numerical_motion(m), by_equal_damping(m)) for m in motions])
    return erratum(printed, corrected, 1e-10)


def as_in_equation_6(m: Motion) -> np.ndarray:
    """omega (n, 3) by (5)-(6) as printed, for D < 0 or D > 0, with that of its two signs which is
    nearer."""
    A1, A2, A3 = A = m.inertia
    start, lam = m.omega[0], m.case.data["damping"][0]
    h, G2 = (A * start * start).sum(), (A * A * start * start).sum()
    X, Y = G2 - h * A3, h * A1 - G2
    about_x3 = h * A2 > G2
    n = math.sqrt(((A2 - A3) * Y if about_x3 else (A1 - A2) * X) / (A1 * A2 * A3))
    modulus = (A1 - A2) * X / ((A2 - A3) * Y)
    decay = np.exp(-lam * (m.time - m.time[0]))
    sn, cn, dn = sn_cn_dn(n * decay / lam, math.sqrt(1 - (modulus if about_x3 else 1 / modulus)))
    size1, size3 = math.sqrt(X / (A1 * (A1 - A3))), math.sqrt(Y / (A3 * (A1 - A3)))
    size2 = math.sqrt(X / (A2 * (A2 - A3)) if about_x3 else Y / (A2 * (A1 - A2)))
    outer, inner = (cn, dn) if about_x3 else (dn, cn)
    signs = [(s, -s, 1) if about_x3 else (1, s, -s) for s in (1, -1)]
    shapes = [
        np.stack([a * size1 * outer, b * size2 * sn, c * size3 * inner], axis=-1)
        for a, b, c in signs
    ]
    omega = numerical_motion(m)
    return min(
        (decay[:, None] * shape for shape in shapes),
        key=lambda printed: float(np.abs(printed - omega).max()),
    )
