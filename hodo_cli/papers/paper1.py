"""Checks for A. L. Rachinskaya, Rotation of a rigid body in a resistant medium (UDC 521.1).

Equation numbers are the paper's. Its body axes are ordered: A1 > A2 > A3.
"""

import itertools
import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from ..claims.finding import (
    Finding,
    Undecidable,
    agreement,
    deviation_beyond,
    deviation_unless,
    in_groups,
    in_percent,
    listed,
)
from ..claims.measures import first_time, in_region, number, swept_angle, zero_times
from ..engines import have_taylor
from ..engines.protocol import EPS
from ..integration import solve
from ..models.theory.exact import damped_motion, free_motion, sn_cn_dn
from ..results.motion import Motion


def numerical_motion(m: Motion) -> np.ndarray:
    """omega (n, 3) by numerical integration, so that no closed form is compared with itself."""
    method = "taylor" if have_taylor() else "DOP853"
    return solve(m.case, method, m.case.precision, times=m.time).variables["omega"]


def free_rotation(motions: Sequence[Motion]) -> Finding:
    """Free rotation follows the closed form of Euler and Jacobi."""
    return agreement(
        [
            (numerical_motion(m), free_motion(m.inertia, m.omega[0], m.time - m.time[0]))
            for m in motions
        ],
        1e-10,
    )


def no_closed_form(motions: Sequence[Motion]) -> Finding:
    """There is no closed form: holds where the closed form of `free_rotation` fails."""
    free = free_rotation(motions)
    return Finding(
        deviation_unless(free.deviation > 0),
        number=free.number,
        evidence=f"the closed form {free.evidence}",
        contradicted_by="a closed form that agrees",
    )


def free_rotation_from_q0(motions: Sequence[Motion]) -> Finding:
    """Free motion from any start is the closed form for q0 = 0, if time is counted from a passage
    of q through 0."""
    pairs = []
    for m in motions:
        since, passage = passage_of_q(m)
        pairs.append((numerical_motion(m), free_motion(m.inertia, passage, m.time - since)))
    # The passage is known to some rounding errors of a period, which the whole motion then has.
    return agreement(pairs, 1e-9)


def passage_of_q(m: Motion) -> tuple[float, np.ndarray]:
    """A time at which a free motion passes q = 0, and omega (3,) there, by Newton's method on
    q(t)."""
    A, start = m.inertia, m.omega[0]
    near = first_time(zero_times(m.time, m.omega[:, 1])) if start[1] else float(m.time[0])
    # It converges quadratically from a nearby sample: five steps suffice.
    for _ in range(10):
        p, q, r = free_motion(A, start, np.array([near - m.time[0]]))[0]
        # q' by Euler's equations for free motion.
        near -= q * A[1] / ((A[2] - A[0]) * p * r)
    # The rounding of q is left out.
    return near, free_motion(A, start, np.array([near - m.time[0]]))[0] * (1, 0, 1)


def turning_axis(motions: Sequence[Motion]) -> Finding:
    """A free motion goes round the axis whose component of G never changes sign, and that is the
    axis enclosed by the criterion 2 T A1 >= G^2 > 2 T A2.
    """
    complying = 0
    for m in motions:
        of_one_sign = np.abs(np.sign(m.omega).sum(axis=0)) == len(m.time)
        enclosed = [axis + 1 for axis in (m.order[0], m.order[2]) if of_one_sign[axis]]
        complying += enclosed == [m.labels[0]]
    return Finding(
        deviation_unless(complying == len(motions)),
        number=float(complying),
        evidence=f"{complying} of {len(motions)} as the criterion says",
        contradicted_by="a motion about another axis than the criterion says",
    )


def equal_damping(motions: Sequence[Motion]) -> Finding:
    """omega(t) = exp(-lambda t) Omega((1 - exp(-lambda t))/lambda), with Omega the free motion from
    the same start.

    Source: E. Padova 1885, as cited; the paper's eq (5) with the time that meets the initial data.
    """
    return agreement([(numerical_motion(m), damped_from(m, m.omega[0])) for m in motions], 1e-10)


def turns_about_one_axis(motions: Sequence[Motion], axis: int) -> Finding:
    """Whether G makes no full turn about the other two axes; decided by the largest part of a turn
    about one of them."""
    others = [abs(swept_angle(m, i)) for m in motions for i in range(3) if i != axis]
    turns = [abs(swept_angle(m, axis)) for m in motions]
    return Finding(
        deviation_unless(max(others) < 1),
        number=max(others),
        evidence=f"{listed(turns)} turns about x{axis + 1}, "
        f"at most {max(others):.3g} about another axis",
        contradicted_by="a full turn about another axis",
    )


turns_about_x1_only = partial(turns_about_one_axis, axis=0)
"""G makes no full turn about x2 or x3, followed over the whole motion."""

turns_about_x3_only = partial(turns_about_one_axis, axis=2)
"""G makes no full turn about x1 or x2, followed over the whole motion."""


def inequality_7(motions: Sequence[Motion]) -> Finding:
    """p^2 > K r^2, with K by the moments of inertia alone, exactly where G^2 > 2 T A2. Raises
    Undecidable if all samples are too near to the separatrix."""
    mismatches, compared = 0, 0
    for m in motions:
        # In units of |omega|, so that no size matters.
        w = m.omega / np.abs(m.omega).max(axis=1, keepdims=True)
        A1, A2, A3 = m.inertia
        G2, h = (m.inertia**2 * w * w).sum(axis=1), (m.inertia * w * w).sum(axis=1)
        # Nearer to the separatrix the computed difference of G^2 and 2 T A2 is rounding.
        clear = np.abs(G2 - h * A2) > 64 * EPS * G2
        # Written as in the paper, and not by `slope`, which is under test.
        K = A3 * (A2 - A3) / (A1 * (A1 - A2))
        by_moments, by_momentum = w[:, 0] ** 2 > K * w[:, 2] ** 2, h * A2 < G2
        mismatches += int((by_moments != by_momentum)[clear].sum())
        compared += int(clear.sum())
    if not compared:
        raise Undecidable("every sample is nearer to the separatrix than its rounding")
    return Finding(
        deviation_unless(mismatches == 0),
        number=float(mismatches),
        evidence=f"{mismatches} samples on the other side",
        contradicted_by="a sample on the other side",
    )


def diagonal_sets_decay(motions: Sequence[Motion]) -> Finding:
    """The diagonal entries have more effect than the others on the decay of |G|."""
    values = [float(np.log(m["G"][0] / m["G"][-1]) / np.ptp(m.time)) for m in motions]
    return larger_effect("rate of decay", values, "diagonal", "off-diagonal")


def off_diagonal_sets_area(motions: Sequence[Motion]) -> Finding:
    """The off-diagonal entries have more effect than the others on the largest p^2 in A."""
    values = [float(in_region(m, 0).max()) for m in motions]
    return larger_effect("largest p^2 in A", values, "off-diagonal", "diagonal")


def larger_effect(measure: str, values: Sequence[float], entries: str, others: str) -> Finding:
    """Whether some entries of the tensor have a larger mean effect on a measure than the others,
    from its values at (low, low), (high, low), (low, high), (high, high) diagonal and off-diagonal
    entries; decided by the ratio of the two effects."""
    grid = np.reshape(values, (2, 2))
    effects = {
        name: abs(float(np.diff(grid, axis=axis).mean()))
        for name, axis in (("diagonal", 1), ("off-diagonal", 0))
    }
    ratio = effects[entries] / effects[others]
    sizes = (f"{size:.3g} of the {name} entries" for name, size in effects.items())
    return Finding(
        deviation_unless(ratio > 1),
        number=ratio,
        evidence=f"effects on the {measure}: {', '.join(sizes)}",
        contradicted_by=f"a larger effect of the {others} entries",
    )


def criterion_predicts(motions: Sequence[Motion]) -> Finding:
    """r changes sign before the crossing from x1 to x3, and p does not; after the crossing p
    changes sign, and r does not."""
    steps, words = [], []
    for m in motions:
        times = [
            float(np.max(zero_times(m.time, m.omega[:, 2]), initial=-math.inf)),
            m.crossings[0].time if m.crossings else math.inf,
            first_time(zero_times(m.time, m.omega[:, 0])),
        ]
        steps += [times[1] - times[0], times[2] - times[1]]
        words.append(listed(times))
    # Without a crossing a step is nan, which is not above 0.
    return Finding(
        deviation_unless(all(step > 0 for step in steps)),
        number=min(steps),
        evidence=f"last zero of r, crossing, first zero of p: {'; '.join(words)}",
        contradicted_by="no crossing, a zero of p before it, or one of r after it",
    )


def larger_difference_sooner(members: Sequence[Sequence[Motion]]) -> Finding:
    """With lambda1 and lambda2 held, the larger lambda1 - lambda3, the sooner the crossing."""
    pairs = compared_by_difference(members, "first_crossing", without=math.inf)
    return all_in_order(
        [large < small for small, large in pairs], "a later crossing at a larger difference"
    )


def larger_difference_larger_area(members: Sequence[Sequence[Motion]]) -> Finding:
    """With lambda1 and lambda2 held, the larger lambda1 - lambda3, the more of B is filled."""
    pairs = compared_by_difference(members, "area_smallest", without=0.0)
    return all_in_order(
        [large > small for small, large in pairs], "a smaller area at a larger difference"
    )


def compared_by_difference(
    members: Sequence[Sequence[Motion]], name: str, without: float
) -> list[tuple[float, float]]:
    """The values of a quantity at the smaller and the larger lambda1 - lambda3, for the same
    lambda1 and lambda2. A pair of two motions without a crossing is left out; `without` is the
    value of such a motion."""
    motions = sorted((m for (m,) in members), key=lambda m: m.case.data["damping"])
    # lambda3 falls as the difference rises, so the second of two neighbours has the smaller one.
    values = [(number(b, name), number(a, name)) for a, b in in_groups(motions, 2)]
    return [pair for pair in values if pair != (without, without)]


def all_in_order(in_order: Sequence[bool], contrary: str) -> Finding:
    """The finding of a statement on pairs; decided by the share of the pairs in its order."""
    return Finding(
        deviation_unless(all(in_order)),
        number=sum(in_order) / len(in_order),
        evidence=f"{sum(in_order)} of {len(in_order)} pairs in this order",
        contradicted_by=contrary,
    )


def larger_difference_sooner_as_a_trend(members: Sequence[Sequence[Motion]]) -> Finding:
    """The larger lambda1 - lambda3, the sooner the crossing, as a trend over all members that
    cross; decided by the share of pairs in the other order, which is a half if the time does not
    depend on the difference."""
    passages = []
    for m in (m for (m,) in members if m.crossings):
        lambda1, _, lambda3 = m.case.data["damping"]
        # Rounded, so that 0.003 - 0.001 and 0.005 - 0.003 are one difference.
        passages.append((round(lambda1 - lambda3, 12), number(m, "first_crossing")))
    pairs = itertools.combinations(sorted(passages), 2)
    reversed_ = [
        time_of_small < time_of_large
        for (small, time_of_small), (large, time_of_large) in pairs
        if small < large
    ]
    share = sum(reversed_) / len(reversed_)
    # A trend and no law: the middle coefficient matters too, so pairs may be reversed.
    return Finding(
        deviation_unless(share < 0.5),
        number=share,
        evidence=f"{in_percent(share)} of {len(reversed_)} pairs reversed",
        contradicted_by="half of the pairs in the other order",
    )


def solved_by_6(motions: Sequence[Motion], sign: int) -> Finding:
    """Eqs (5)-(6), with a sign of the sine relative to the cosine, compared with the motion from
    the same start; the better of two choices of both signs counts."""
    (m,) = motions
    shapes = (as_in_equation_6(m, both, sign * both) for both in (1, -1))
    # To 1e-9, because the functions reduce an argument of some hundred turns at the start.
    findings = (agreement([(damped_from(m, shape[0]), shape)], 1e-9) for shape in shapes)
    return min(findings, key=lambda finding: finding.number)


equations_6_as_printed = partial(solved_by_6, sign=-1)
"""(5)-(6) with opposite signs of cosine and sine are a motion."""

equations_6_with_equal_signs = partial(solved_by_6, sign=1)
"""(5)-(6) with equal signs of cosine and sine are a motion."""


def equations_6_meet_the_start(motions: Sequence[Motion]) -> Finding:
    """q at the start is q by (5)-(6), with equal signs."""
    (m,) = motions
    missed = abs(float(as_in_equation_6(m, 1, 1)[0, 1] - m.omega[0, 1]))
    return Finding(
        deviation_beyond(missed, 1e-12),
        number=missed,
        evidence=f"|q1(0) - q0| is {missed:.3g}",
        contradicted_by="a difference above 0.01",
    )


def damped_from(m: Motion, start: np.ndarray) -> np.ndarray:
    """omega (n, 3) of a motion under equal damping from another start."""
    return damped_motion(m.inertia, start, m.case.data["damping"][0], m.time - m.time[0])


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
