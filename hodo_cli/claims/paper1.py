"""Checks for A. L. Rachinskaya, Rotation of a rigid body in a resisting medium (UDC 521.1).

Equation numbers are the paper's. Its body axes are ordered: A1 > A2 > A3.
"""

import math
from collections.abc import Sequence

import numpy as np

from ..engines.protocol import have_taylor
from ..integration.classify import EPS
from ..integration.solve import solve, stored
from ..models.closed_form import free_motion, sn_cn_dn
from ..results.motion import Motion
from .finding import Finding, agreement, if_true, listed
from .paper import check
from .quantities import first, reach, zeros


def integrated(m: Motion) -> np.ndarray:
    """omega (n, 3) by numerical integration: a closed form shall not be compared with itself."""
    solution = solve(
        m.case, "taylor" if have_taylor() else "DOP853", m.case.precision, times=m.time
    )
    return stored(m.case, solution.path)["omega"]


@check
def free_rotation(motions: Sequence[Motion]) -> Finding:
    """Free rotation is Euler's and Jacobi's closed form."""
    return agreement(
        [(integrated(m), free_motion(m.inertia, m.omega[0], m.time - m.time[0])) for m in motions],
        1e-10,
    )


@check
def no_closed_form(motions: Sequence[Motion]) -> Finding:
    """There is no closed form: holds where that of `free_rotation` fails."""
    found = free_rotation(motions)
    return Finding(if_true(found.deviation > 0), found.number, f"the closed form {found.words}")


@check
def free_rotation_from_q0(motions: Sequence[Motion]) -> Finding:
    """Free motion from any start is the closed form for q0 = 0, with time counted from a passage of q through 0."""
    pairs = []
    for m in motions:
        since, passage = passage_of_q(m)
        pairs.append((integrated(m), free_motion(m.inertia, passage, m.time - since)))
    # The passage is known to some rounding errors of a period, which the motion then carries along.
    return agreement(pairs, 1e-9)


def passage_of_q(m: Motion) -> tuple[float, np.ndarray]:
    """A time at which a free motion passes q = 0, and omega (3,) there: Newton's method on q(t)."""
    A, start = m.inertia, m.omega[0]
    near = first(zeros(m.time, m.omega[:, 1])) if start[1] else float(m.time[0])
    for _ in range(60):
        p, q, r = free_motion(A, start, np.array([near - m.time[0]]))[0]
        near -= q * A[1] / ((A[2] - A[0]) * p * r)
    return near, free_motion(A, start, np.array([near - m.time[0]]))[0] * (1, 0, 1)


@check
def turning_axis(motions: Sequence[Motion]) -> Finding:
    """A free motion goes round the axis whose component of G never changes sign, and that is the axis enclosed by
    the criterion 2 T A1 >= G^2 > 2 T A2.
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


@check
def equation_6(motions: Sequence[Motion]) -> Finding:
    """For equal coefficients and q0 = 0 the motion is (5)-(6), in the better of the two signs that are printed."""
    return agreement([(integrated(m), as_in_equation_6(m)) for m in motions], 1e-10)


def as_in_equation_6(m: Motion) -> np.ndarray:
    """omega (n, 3) by (5)-(6) as printed, for D < 0 or D > 0, with that of its two signs which is nearer."""
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
    omega = integrated(m)
    return min(
        (decay[:, None] * shape for shape in shapes),
        key=lambda found: float(np.abs(found - omega).max()),
    )


@check
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
        K = A3 * (A2 - A3) / (A1 * (A1 - A2))
        wrong += int(((h * A2 < G2) != (w[:, 0] ** 2 > K * w[:, 2] ** 2))[clear].sum())
    return Finding(if_true(wrong == 0), float(wrong), f"{wrong} samples on the other side")


def decay_rate(m: Motion) -> float:
    """The mean rate of decay of |G|."""
    G = m["G"]
    return float(np.log(G[0] / G[-1]) / (m.time[-1] - m.time[0]))


def factorial_effects(values: Sequence[float]) -> tuple[float, float]:
    """The mean effects of two factors on values at (low, low), (high, low), (low, high), (high, high)."""
    low, first_high, second_high, both = values
    return abs(first_high - low + both - second_high) / 2, abs(
        second_high - low + both - first_high
    ) / 2


@check
def diagonal_sets_decay(motions: Sequence[Motion]) -> Finding:
    """The diagonal entries, the first factor, have more effect on the decay of |G| than the others, the second."""
    values = [decay_rate(m) for m in motions]
    diagonal, off = factorial_effects(values)
    words = f"rate of decay {listed(values)}: effects {listed((diagonal, off))}"
    return Finding(if_true(diagonal > off), diagonal / off, words)


@check
def off_diagonal_sets_area(motions: Sequence[Motion]) -> Finding:
    """The off-diagonal entries, the second factor, have more effect on the largest p^2 in A than the diagonal ones."""
    values = [reach(m, 0) for m in motions]
    diagonal, off = factorial_effects(values)
    words = f"largest p^2 in A {listed(values)}: effects {listed((diagonal, off))}"
    return Finding(if_true(off > diagonal), off / diagonal, words)


@check
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
