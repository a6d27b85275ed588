"""Checks for A. L. Rachinskaya, Rotation of a rigid body in a resistant medium (UDC 521.1).

Equation numbers are the paper's. Its body axes are ordered: A1 > A2 > A3.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..claims.finding import (
    Check,
    Finding,
    Trend,
    agreement,
    difference,
    erratum,
    if_true,
    listed,
    part_of,
)
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
    words = f"the closed form {free.words}"
    return Finding(if_true(free.deviation > 0), free.number, words, "a closed form that agrees")


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
    complying = 0
    for m in motions:
        of_one_sign = (np.abs(np.sign(m.omega).sum(axis=0)) == len(m.time))[
            [m.order[0], m.order[2]]
        ]
        enclosed = np.array(m.order)[[0, 2]][of_one_sign] + 1
        complying += enclosed.tolist() == [m.labels[0]]
    words = f"{complying} of {len(motions)} as the criterion says"
    contrary = "a motion about another axis than the criterion says"
    return Finding(if_true(complying == len(motions)), float(complying), words, contrary)


@Check
def equal_damping(motions: Sequence[Motion]) -> Finding:
    """omega(t) = exp(-lambda t) Omega((1 - exp(-lambda t))/lambda), Omega free from the same start.

    Source: E. Padova 1885, as cited; the paper's eq (5) with the time that meets the initial data.
    """
    return agreement([(numerical_motion(m), damped_from(m, m.omega[0])) for m in motions], 1e-10)


@Check
def turns_about_x1_only(motions: Sequence[Motion]) -> Finding:
    """G makes no full turn about x2 or x3, followed over the whole motion."""
    return turns_about_one_axis(motions, 0)


@Check
def turns_about_x3_only(motions: Sequence[Motion]) -> Finding:
    """G makes no full turn about x1 or x2, followed over the whole motion."""
    return turns_about_one_axis(motions, 2)


def turns_about_one_axis(motions: Sequence[Motion], axis: int) -> Finding:
    """Whether G makes no full turn about the other two axes; decided by the largest part of a turn
    about one of these."""
    others = [abs(swept_angle(m, i)) for m in motions for i in range(3) if i != axis]
    turns = [abs(swept_angle(m, axis)) for m in motions]
    words = f"{listed(turns)} turns about x{axis + 1}, at most {max(others):.3g} about another axis"
    return Finding(if_true(max(others) < 1), max(others), words, "a full turn about another axis")


@Check
def inequality_7(motions: Sequence[Motion]) -> Finding:
    """p^2 > K r^2, with K by the moments of inertia alone, exactly where G^2 > 2 T A2."""
    mismatches = 0
    for m in motions:
        # In units of |omega|, so that no size matters.
        w = m.omega / np.abs(m.omega).max(axis=1, keepdims=True)
        A1, A2, A3 = m.inertia
        G2, h = (m.inertia**2 * w * w).sum(axis=1), (m.inertia * w * w).sum(axis=1)
        # Nearer to the separatrix the difference of G^2 and 2 T A2, as it stands, is rounding.
        clear = np.abs(G2 - h * A2) > 64 * EPS * G2
        # Written out as the paper has it, and not by `slope`, which is what is tested.
        K = A3 * (A2 - A3) / (A1 * (A1 - A2))
        mismatches += int(((h * A2 < G2) != (w[:, 0] ** 2 > K * w[:, 2] ** 2))[clear].sum())
    words = f"{mismatches} samples on the other side"
    return Finding(if_true(mismatches == 0), float(mismatches), words, "a sample on the other side")


@Check
def diagonal_sets_decay(motions: Sequence[Motion]) -> Finding:
    """The diagonal entries have more effect than the others on the decay of |G|."""
    values = [float(np.log(m["G"][0] / m["G"][-1]) / np.ptp(m.time)) for m in motions]
    return larger_effect("rate of decay", values, "diagonal", "off-diagonal")


@Check
def off_diagonal_sets_area(motions: Sequence[Motion]) -> Finding:
    """The off-diagonal entries have more effect than the others on the largest p^2 in A."""
    values = [reach(m, 0) for m in motions]
    return larger_effect("largest p^2 in A", values, "off-diagonal", "diagonal")


def larger_effect(measure: str, values: Sequence[float], entries: str, others: str) -> Finding:
    """Whether some entries of the tensor have a larger mean effect on a measure than the others, of
    values at (low, low), (high, low), (low, high), (high, high) diagonal and off-diagonal entries;
    decided by the ratio of the two."""
    grid = np.reshape(values, (2, 2))
    effects = {
        name: abs(float(np.diff(grid, axis=axis).mean()))
        for name, axis in (("diagonal", 1), ("off-diagonal", 0))
    }
    ratio = effects[entries] / effects[others]
    words = f"{measure} {listed(values)}: effects {listed(effects.values())}"
    return Finding(if_true(ratio > 1), ratio, words, f"a larger effect of the {others} entries")


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
    evidence = f"last zero of r, crossing, first zero of p: {'; '.join(words)}"
    contrary = "no crossing, a zero of p before it, or one of r after it"
    # Without a crossing a step is no number, which is not above 0.
    return Finding(if_true(all(step > 0 for step in steps)), min(steps), evidence, contrary)


@Trend
def difference_decides(members: Sequence[Sequence[Motion]]) -> Finding:
    """A start about x1 turns to x3 for lambda1 > lambda3 alone; decided by the share that does."""
    differences, times = crossing_times(members)
    positive, negative = (np.isfinite(times[sign]) for sign in (differences > 0, differences <= 0))
    words = (
        f"{positive.sum()} of {len(positive)} cross where lambda1 > lambda3, "
        f"{negative.sum()} of {len(negative)} where lambda1 <= lambda3"
    )
    contrary = "a crossing where lambda1 <= lambda3, or none where lambda1 > lambda3"
    holds = bool(positive.any() and not negative.any())
    return Finding(if_true(holds), float(positive.mean()), words, contrary)


@Trend
def larger_difference_sooner(members: Sequence[Sequence[Motion]]) -> Finding:
    """With lambda1 and lambda2 held, the larger lambda1 - lambda3, the sooner the crossing."""
    sooner = compared_by_difference(members, lambda m: -number(m, "first_crossing"), -math.inf)
    return Finding(*sooner, "a later crossing at a larger difference")


@Trend
def larger_difference_larger_area(members: Sequence[Sequence[Motion]]) -> Finding:
    """With lambda1 and lambda2 held, the larger lambda1 - lambda3, the more of B is filled."""
    larger = compared_by_difference(members, lambda m: number(m, "area_smallest"), 0.0)
    return Finding(*larger, "a smaller area at a larger difference")


def compared_by_difference(
    members: Sequence[Sequence[Motion]], value: Callable[[Motion], float], without: float
) -> tuple[float, float, str]:
    """Deviation, share and words of: a value rises with lambda1 - lambda3 where lambda1 and lambda2
    are the same; pairs that have the value of a motion `without` a crossing are left out."""
    by_coefficients: dict[tuple[float, float], list[tuple[float, float]]] = {}
    for (m,) in members:
        lambda1, lambda2, lambda3 = m.case.data["damping"]
        by_coefficients.setdefault((lambda1, lambda2), []).append((lambda1 - lambda3, value(m)))
    pairs = [
        (low, high)
        for values in by_coefficients.values()
        for (_, low), (_, high) in itertools.pairwise(sorted(values))
    ]
    crossing = [(low, high) for low, high in pairs if (low, high) != (without, without)]
    rises = sum(low < high for low, high in crossing)
    without_crossing = len(pairs) - len(crossing)
    words = f"{rises} of {len(crossing)} pairs in this order; {without_crossing} pairs do not cross"
    return if_true(0 < rises == len(crossing)), rises / len(crossing), words


@Trend
def larger_difference_sooner_as_a_trend(members: Sequence[Sequence[Motion]]) -> Finding:
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
    words = f"rank correlation {correlation:.2f}, {part_of(share)} of {len(apart)} pairs reversed"
    # A trend, and no law: the middle coefficient matters too, so pairs may be reversed.
    return Finding(if_true(correlation < -0.8), correlation, words, "a correlation above -0.8")


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
    words = f"{listed(turns)} turns about x3"
    return Finding(if_true(most < 1), most, words, "a full turn about x3")


@Check
def another_character(motions: Sequence[Motion]) -> Finding:
    """The first motion goes explicitly round x3, for a full turn at least, and the second does not;
    decided by the turns of the second.
    """
    first, second = (longest_turn(m, 2, EXPLICIT) for m in motions)
    words = f"{first:.3g} turns about x3 in Fig 12, {second:.3g} in Fig 14"
    contrary = "a full turn about x3 in Fig 14, or none in Fig 12"
    return Finding(if_true(second < 1 <= first), second, words, contrary)


@Check
def full_turn_about_x3(motions: Sequence[Motion]) -> Finding:
    """Every motion makes a full turn about x3; decided by the fewest turns."""
    turns = [longest_turn(m, 2, 0.0) for m in motions]
    words = f"{listed(turns)} turns about x3"
    return Finding(if_true(min(turns) >= 1), min(turns), words, "less than a full turn")


SUBSTANTIAL = 0.1
"""The part of a figure of quadrants from which on a region counts as substantially filled."""


@Check
def visibly_about_x1(motions: Sequence[Motion]) -> Finding:
    """A is filled substantially, and the motion makes a full turn about x1 with |G| > EXPLICIT;
    decided by the part of the figure that A fills."""
    filled, turns, words = about_x1(motions)
    holds = filled >= SUBSTANTIAL and turns >= 1
    return Finding(if_true(holds), filled, words, f"less than {SUBSTANTIAL:.0%}, or no full turn")


@Check
def not_visibly_about_x1(motions: Sequence[Motion]) -> Finding:
    """A is filled insignificantly, and the motion makes no full turn about x1 with |G| > EXPLICIT;
    decided as `visibly_about_x1` is."""
    filled, turns, words = about_x1(motions)
    holds = filled < SUBSTANTIAL and turns < 1
    return Finding(if_true(holds), filled, words, f"{SUBSTANTIAL:.0%} or more, or a full turn")


def about_x1(motions: Sequence[Motion]) -> tuple[float, float, str]:
    """The part of the figure that one motion fills in A, its turns about x1, and both in words."""
    (m,) = motions
    filled, turns = number(m, "area_largest"), longest_turn(m, 0, EXPLICIT)
    return (
        filled,
        turns,
        f"p^2 reaches {part_of(filled)} of the figure in A; {turns:.3g} turns about x1",
    )


@Trend
def size_changes_spacing(members: Sequence[Sequence[Motion]]) -> Finding:
    """Every motion, of growing resistance, turns from x3 to x1, and makes the fewer turns about x3
    before, the larger the resistance; decided by the least step of the turns."""
    motions = [m for (m,) in members]
    turns = [longest_turn(m, 2, 0.0) for m in motions]
    steps = [a - b for a, b in itertools.pairwise(turns)]
    character = all((m.labels[0], m.labels[-1]) == (3, 1) for m in motions)
    words = f"{listed(turns)} turns about x3, {'all' if character else 'not all'} x3 to x1"
    contrary = "as many turns for another size, or another order of the axes"
    return Finding(if_true(character and min(steps) > 0), min(steps), words, contrary)


def longest_turn(m: Motion, axis: int, least: float) -> float:
    """The turns about an axis in the longest stretch that encloses it with |G| above `least`."""
    inside = (m.labels == axis + 1) & (m["G"] > least)
    edges = np.flatnonzero(np.diff(np.r_[False, inside, False]))
    stretches = [np.arange(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return max((abs(swept_angle(m, axis, stretch)) for stretch in stretches), default=0.0)


# Errata: each check shows the printed form wrong and the corrected one right.


@Check
def unit_of_angular_velocity(motions: Sequence[Motion]) -> Finding:
    """|omega(0)| = 1, as omega0 = |omega(0)| makes it, holds for the first of the printed starts
    alone, and |G(0)| = 1 for all others."""
    speed, size = (
        np.abs(np.array(values) - 1)
        for values in ([np.linalg.norm(m.omega[0]) for m in motions], [m["G"][0] for m in motions])
    )
    words = (
        f"||G(0)| - 1| is at most {size[1:].max():.2g} for {len(size) - 1} starts, and "
        f"{size[0]:.3g} for curve 1 of Fig 1; ||omega(0)| - 1| up to {speed.max():.2g}, and "
        f"{speed[0]:.2g} for curve 1"
    )
    holds = size[1:].max() < UNIT_SPHERE < speed[1:].min() and speed[0] < 2 * UNIT_SPHERE < size[0]
    contrary = "another start of the nine with |omega(0)| = 1, or one without |G(0)| = 1"
    return Finding(if_true(holds), float(speed.max()), words, contrary)


UNIT_SPHERE = 0.0025
"""What rounding to two digits leaves of |G| - 1."""


@Check
def curve_1(motions: Sequence[Motion]) -> Finding:
    """||G(0)| - 1| of curve 1 with the printed r0 and with 0.73."""
    (m,) = motions
    corrected = m.inertia * (m.omega[0, 0], m.omega[0, 1], 0.73)
    errors = (abs(float(G) - 1) for G in (m["G"][0], np.linalg.norm(corrected)))
    return erratum(errors, UNIT_SPHERE, "||G(0)| - 1| is")


@Check
def start_of_fig_14(motions: Sequence[Motion]) -> Finding:
    """D at the start, positive about x1, with r0 by either normalisation and with a smaller one."""
    D = [float(m["D"][0]) for m in motions]
    words = (
        f"D = {D[0]:.3g} with |G(0)| = 1, {D[1]:.3g} with |omega(0)| = 1, {D[2]:.3g} with r0 = 0.4"
    )
    contrary = "a positive D with |G(0)| = 1 or |omega(0)| = 1"
    return Finding(if_true(max(D[:2]) < 0 < D[2]), D[0], words, contrary)


@Check
def slow_time(motions: Sequence[Motion]) -> Finding:
    """omega changes in tau = omega0 t much faster than it is damped: tau is no slow time."""
    (m,) = motions
    k = SimpleNamespace(**m.case.system.constants)
    rate = np.linalg.norm(m.case.system.rhs(0.0, [*m.omega[0]], k))
    fast = float(rate / np.linalg.norm(m.omega[0]))
    slow = max(m.case.data["damping"])
    words = f"omega turns at the rate {fast:.3g} and is damped at {slow:.3g}"
    return Finding(
        if_true(fast > 10 * slow), fast / slow, words, "a rate below ten times that of damping"
    )


DIMENSIONAL = {"A1": 3.0, "omega0": 7.0}
"""Units far from 1, in which a factor that is left out shows."""


@Check
def dimensionless_coefficients(motions: Sequence[Motion]) -> Finding:
    """Eqs (3) in other units are (4) with lambda/omega0, not with the printed lambda, and (10) are
    (11) with I/(A1 omega0), not I/A1: by the derivative of omega in a body of DIMENSIONAL size,
    made dimensionless, beside that of the dimensionless equations."""
    (m,) = motions
    rhs = m.case.system.rhs
    A1, omega0 = DIMENSIONAL["A1"], DIMENSIONAL["omega0"]
    small: dict[str, Any] = dict(m.case.system.constants)
    body = {name: value * A1 for name, value in small.items() if name in ("A1", "A2", "A3")}
    coefficients = [name for name in small if name.startswith(("lam", "I"))]
    # lambda is a rate; I is a rate times a moment of inertia.
    unit = A1 if m.case.model == "tensor" else 1.0
    large = {name: small[name] * unit * omega0 for name in coefficients}
    start = m.omega[0]
    true = np.array(rhs(0.0, [*(omega0 * start)], SimpleNamespace(**{**small, **body, **large})))
    # A rate of omega is in units of omega0^2.
    true /= omega0**2
    as_printed = {name: value / unit for name, value in large.items()}
    printed = np.array(rhs(0.0, [*start], SimpleNamespace(**{**small, **as_printed})))
    corrected = np.array(rhs(0.0, [*start], SimpleNamespace(**small)))
    return erratum((difference([(true, form)]) for form in (printed, corrected)), 1e-12)


@Check
def curve_3(motions: Sequence[Motion]) -> Finding:
    """|D|/G^2 of curve 3 with the printed and with the corrected r0; near is up to 0.001."""
    distances = (number(m, "separatrix_distance", "start") for m in motions)
    return erratum(distances, 0.001, "|D|/G^2 is")


@Check
def third_coefficient(motions: Sequence[Motion]) -> Finding:
    """lambda1 has one value: with 0.005 for it and 0.003 for lambda3 the motion turns to x3, as the
    text says; with 0.003 for it and 0.005 for lambda3 it does not.
    """
    exchanged, corrected = (len(m.crossings) for m in motions)
    words = f"{corrected} crossing with lambda3 = 0.003, {exchanged} with lambda1 = 0.003"
    holds = corrected == 1 and exchanged == 0
    contrary = "a crossing with lambda1 = 0.003, or none with lambda3 = 0.003"
    return Finding(if_true(holds), float(corrected), words, contrary)


@Check
def signs_in_equation_6(motions: Sequence[Motion]) -> Finding:
    """(5)-(6) beside the motion that starts where they start, with opposite signs as printed and
    with equal ones; of each the better of two choices."""
    (m,) = motions
    errors = []
    for signs in ((1, -1), (1, 1)):
        shapes = [as_in_equation_6(m, s * signs[0], s * signs[1]) for s in (1, -1)]
        errors.append(min(difference([(damped_from(m, shape[0]), shape)]) for shape in shapes))
    # The argument is some hundred turns at the start, which the functions reduce.
    return erratum(errors, 1e-9)


@Check
def phase_in_equation_6(motions: Sequence[Motion]) -> Finding:
    """q at the start by (5)-(6), and by the closed form that meets the initial data."""
    (m,) = motions
    printed, corrected = as_in_equation_6(m, 1, 1)[0, 1], damped_from(m, m.omega[0])[0, 1]
    errors = (abs(float(q - m.omega[0, 1])) for q in (printed, corrected))
    return erratum(errors, 1e-12, "|q1(0) - q0| is")


def damped_from(m: Motion, start: np.ndarray) -> np.ndarray:
    """omega (n, 3) of a motion under equal damping from another start."""
    return closed_form.damped_motion(
        m.inertia, start, m.case.data["damping"][0], m.time - m.time[0]
    )


def as_in_equation_6(m: Motion, oscillating: int, middle: int) -> np.ndarray:
    """omega (n, 3) by (5)-(6), for D < 0 or D > 0, with the signs of the cosine and of q."""
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
    first, third = (oscillating * cn, dn) if about_x3 else (dn, oscillating * cn)
    shape = np.stack([size1 * first, middle * size2 * sn, size3 * third], axis=-1)
    return np.asarray(decay[:, None] * shape)
