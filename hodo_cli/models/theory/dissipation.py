"""What follows from a sum of torques alone: which way a motion crosses the separatrix, whether a
small tilt away from a steady rotation grows, and which rotation a torque holds.

With a > b > c the moments of inertia and 1, 2, 3 their axes, let D = 0 at a given |G|. One number
is left, sigma in 0 to 1:

    p^2 = sigma G^2 (b - c)/(a b (a - c)),    r^2 = sigma G^2 (a - b)/(b c (a - c)),
    q^2 = (1 - sigma) G^2/b^2,                W = (a - b)(b - c) G^2/(b (a - c)).

Under damping -lambda_i A_i omega_i, quadratic drag -c_i |omega| A_i omega_i or -e_i A_i omega_i
|omega_i|, fluid with the coefficient kappa and any torque along G

    D' = 2 W sigma {kappa G^2 [alpha sigma + beta (1 - sigma)] - (lambda_1 - lambda_3)
                    - (c_1 - c_3) |omega| - (e_1 |p| - e_3 |r|)},
    alpha = (a - c) b (a + c - b)/(abc)^2,    beta = (a - c) [2ac - b (a + c - b)]/(abc)^2,

with alpha, beta >= 0 for every body. Where all terms that are there have one sign, there is one
crossing at most. Fluid against damping changes its sign with |G|, which falls: fast, the fluid
turns the body to axis 1, slow, the damping turns it back to axis 3. Averaged over a half turn
beside the separatrix the sense turns where kappa G^2 f = lambda_1 - lambda_3, f = (2 alpha +
beta)/3.

All of it holds for a diagonal tensor of resistance (lambda_i += I_ii/A_i), and without a torque
fixed in the body or in space, an expression or a rotor. Under laws of time D' is that of each
moment: what excludes a crossing has to do so at all times, and "two at most" need not hold. A body
with two equal moments never crosses.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..rigid_body import inertia_order


class Dissipation(NamedTuple):
    """The coefficients of a sum of torques by body axis (3,), but for kappa; `torque` is constant
    in the body. `covered` is False where there are others, whose means over a turn are 0, so that
    they count in no growth of a tilt, but may make the motion cross."""

    inertia: Any
    damping: Any = (0.0, 0.0, 0.0)
    quadratic: Any = (0.0, 0.0, 0.0)
    kappa: Any = 0.0
    torque: Any = (0.0, 0.0, 0.0)
    covered: Any = True


class SenseReversal(NamedTuple):
    """The sizes of G at which the sense of crossings turns; not numbers where it does not.

    Above `fluid` a body crosses to the axis of largest inertia only, below `damping` to that of
    smallest only; `mean` is where the mean over a half turn changes its sign.
    """

    fluid: float
    damping: float
    mean: float


@np.errstate(all="ignore")
def turning_momenta(terms: Dissipation) -> SenseReversal:
    """Where fluid and damping change places."""
    c, b, a = np.sort(np.asarray(terms.inertia, float))
    # In ratios, since (a b c)^2 may have no double.
    scale, narrow = (a - c) / a / (a * b * c), (a + c - b) / c
    alpha, beta = scale * narrow, scale * (2 * a / b - narrow)
    largest, _, smallest = inertia_order(terms.inertia)
    excess = np.float64(terms.damping[largest] - terms.damping[smallest])
    strengths = np.array([min(alpha, beta), max(alpha, beta), (2 * alpha + beta) / 3])
    squares = excess / (terms.kappa * strengths)
    valid = (squares > 0) & np.isfinite(squares)
    return SenseReversal(*np.where(valid, np.sqrt(squares), np.nan).tolist())


def possible_crossings(terms: Dissipation) -> frozenset[int] | None:
    """The senses of the crossings that a motion can have: 1 to the axis of largest inertia, -1 to
    that of smallest; None where nothing is known.

    Of one sense there is one crossing at most. With both, the motion may go to the axis of largest
    inertia, and back: two at most, but for what happens between the two sizes of G at which the
    sense may turn. kappa and the quadratic coefficients are at least 0; for negative damping beside
    fluid less is known.
    """
    c, b, a = np.sort(np.asarray(terms.inertia, float))
    if a == b or b == c:
        return frozenset()
    if not terms.covered or np.any(terms.torque):
        return None
    largest, _, smallest = inertia_order(terms.inertia)
    damping, quadratic = media = [
        x[largest] - x[smallest] for x in (terms.damping, terms.quadratic)
    ]
    has_fluid = terms.kappa > 0
    if max(media) <= 0:
        return frozenset({1} if has_fluid or min(media) < 0 else ())
    if not has_fluid and min(media) >= 0:
        return frozenset({-1})
    # |G| alone tells which of fluid and damping is the stronger, and it falls.
    turns = has_fluid and damping > 0 and not quadratic and min(terms.damping) >= 0
    return frozenset({1, -1}) if turns else None


def axes_never_left(moments: Sequence[Dissipation]) -> frozenset[int]:
    """The body axes, 1 to 3, each of which is enclosed for ever once it is; by what a sum of
    torques is at all decisive moments."""
    known = [senses for terms in moments if (senses := possible_crossings(terms)) is not None]
    if not known or len(known) < len(moments):
        return frozenset()
    largest, _, smallest = inertia_order(moments[0].inertia)
    possible = frozenset().union(*known)
    leaving = {largest + 1: -1, smallest + 1: 1}
    return frozenset(axis for axis, sense in leaving.items() if sense not in possible)


def crossing_predictions(moments: Sequence[Dissipation]) -> list[str]:
    """Which crossings are possible, in a sentence, by what a sum of torques is at all decisive
    moments."""
    if not moments:
        return []
    largest, _, smallest = inertia_order(moments[0].inertia)
    up, down = f"x{smallest + 1} to x{largest + 1}", f"x{largest + 1} to x{smallest + 1}"
    at_most_one = {
        frozenset({largest + 1, smallest + 1}): "no crossing is possible",
        frozenset({smallest + 1}): f"one crossing at most, {down}",
        frozenset({largest + 1}): f"one crossing at most, {up}",
    }
    if never_left := axes_never_left(moments):
        return [at_most_one[never_left]]
    terms, *others = moments
    if others or possible_crossings(terms) != frozenset({1, -1}):
        return []
    fluid, damping, mean = (f"{G:.6g} [moment of inertia / time]" for G in turning_momenta(terms))
    return [
        f"only {up} above |G| = {fluid}, only {down} below {damping}; on the mean the sense turns "
        f"at {mean}"
    ]


@np.errstate(divide="ignore", invalid="ignore")
def tilt_growth_rates(terms: Dissipation, omega: Any) -> np.ndarray:
    """The rate (..., 3) at which a small tilt away from rotation about each body axis, at the speed
    omega (..., 3), grows on the mean over a turn; not a number for the middle axis, about which
    free rotation is unstable.

    With i the axis, j and k the others, w = |omega_i|, and M a torque fixed in the body it is

        lambda_i - (lambda_j + lambda_k)/2 + [c_i - (c_j + c_k)/2] w + e_i w - M_i/(A_i omega_i)
            - (F_j + F_k) w^2/2,    F_j = kappa (A_i - A_j)(A_i + A_j - A_k)/(A_j^2 A_k),

    the other letters as above, to first order in the torques. A torque along G
    adds nothing: it slows rotation and tilt alike. Where the rate is positive the motion leaves the
    axis, though not always for the other one: it may end as an oscillation of constant shape on the
    same side.
    """
    A, damping, quadratic, torque, omega = (
        np.asarray(x, float) for x in (*terms[:3], terms.torque, omega)
    )
    w, kappa = np.abs(omega), np.asarray(terms.kappa, float)[..., None]
    j, k = np.roll(A, -1, -1), np.roll(A, -2, -1)
    fluid = (A - j) * (A + j - k) / (j * j * k) + (A - k) * (A + k - j) / (k * k * j)
    driven = np.where(torque == 0, 0, torque / (A * omega))
    growth = _above_others(damping) + _above_others(quadratic) * w
    growth = growth - driven - kappa * fluid * w * w / 2
    # A symmetric body has no such turn about an axis whose moment is the middle one too; nor has a
    # body that starts from rest about an axis of its torque.
    has_none = (np.sort(A, axis=-1)[..., 1:2] == A) | np.isinf(driven)
    return np.where(has_none, np.nan, growth)


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


def spin_predictions(terms: Dissipation) -> list[str]:
    """The rotation that a torque along one axis holds against damping alone, in a sentence."""
    others = *terms.quadratic, terms.kappa
    if any(others) or not terms.covered or np.count_nonzero(terms.torque) != 1:
        return []
    axis = int(np.flatnonzero(terms.torque)[0])
    if not terms.damping[axis] > 0:
        return []
    omega, stable = driven_spin(terms, axis)
    return [
        f"the torque holds a rotation about x{axis + 1} at {omega:.6g} [time^-1]: "
        f"{'stable' if stable else 'unstable'}"
    ]
