"""Theorems on a sum of torques: which way a motion crosses the separatrix D = 0.

With a > b > c the moments of inertia and 1, 2, 3 their axes, let D = 0 at a given |G|. One number
is left, sigma in 0 to 1:

    p^2 = sigma G^2 (b - c)/(a b (a - c)),    r^2 = sigma G^2 (a - b)/(b c (a - c)),
    q^2 = (1 - sigma) G^2/b^2,                W = (a - b)(b - c) G^2/(b (a - c)).

Under damping -lambda_i A_i omega_i, quadratic drag -c_i |omega| A_i omega_i, fluid with the
coefficient kappa and any torque along G

    D' = 2 W sigma {kappa G^2 [alpha sigma + beta (1 - sigma)] - (lambda_1 - lambda_3)
                    - (c_1 - c_3) |omega|},
    alpha = (a - c) b (a + c - b)/(abc)^2,    beta = (a - c) [2ac - b (a + c - b)]/(abc)^2,

with alpha, beta >= 0 for every body. Where all terms that are there have one sign, there is one
crossing at most. Fluid against damping changes its sign with |G|, which falls: fast, the fluid
turns the body to axis 1, slow, the damping turns it back to axis 3. Averaged over a half turn
beside the separatrix the sense turns where kappa G^2 f = lambda_1 - lambda_3, f = (2 alpha +
beta)/3.

All of it holds for constant coefficients, for a diagonal tensor of resistance too (lambda_i +=
I_ii/A_i), and without a torque fixed in the body or in space, an expression or a rotor. A body with
two equal moments never crosses.
"""

from typing import Any, NamedTuple

import numpy as np

from ..rigid_body import inertia_order


class Dissipation(NamedTuple):
    """The coefficients of a sum of torques by body axis (3,), but for kappa; `torque` is constant
    in the body. `covered` is False where there are others."""

    inertia: Any
    damping: Any = (0.0, 0.0, 0.0)
    quadratic: Any = (0.0, 0.0, 0.0)
    kappa: Any = 0.0
    torque: Any = (0.0, 0.0, 0.0)
    covered: Any = True


@np.errstate(all="ignore")
def turning_momenta(terms: Dissipation) -> tuple[float, float, float]:
    """The sizes of G at which the sense of crossings turns; not numbers where it does not.

    Above the first a body crosses to the axis of largest inertia only, under the fluid; below the
    second to the axis of smallest only, under damping. At the third the mean over a half turn
    changes its sign.
    """
    c, b, a = np.sort(np.asarray(terms.inertia, float))
    # In ratios, since (a b c)^2 may have no double.
    scale, narrow = (a - c) / a / (a * b * c), (a + c - b) / c
    alpha, beta = scale * narrow, scale * (2 * a / b - narrow)
    largest, _, smallest = inertia_order(terms.inertia)
    excess = np.float64(terms.damping[largest] - terms.damping[smallest])
    strengths = np.array([min(alpha, beta), max(alpha, beta), (2 * alpha + beta) / 3])
    squares = excess / (terms.kappa * strengths)
    valid = (squares > 0) & np.isfinite(squares)
    fluid, damping, mean = np.where(valid, np.sqrt(squares), np.nan).tolist()
    return fluid, damping, mean


def possible_crossings(terms: Dissipation) -> frozenset[int] | None:
    """The senses of the crossings that a motion can have: 1 to the axis of largest inertia, -1 to
    the axis of smallest; None where nothing is known.

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
    # |G| alone decides which of fluid and damping is the stronger, and it falls.
    turns = has_fluid and damping > 0 and not quadratic and min(terms.damping) >= 0
    return frozenset({1, -1}) if turns else None


def axes_never_left(terms: Dissipation) -> frozenset[int]:
    """The body axes, 1 to 3, each of which is enclosed for ever once it is."""
    largest, _, smallest = inertia_order(terms.inertia)
    senses = possible_crossings(terms)
    possible = {-1, 1} if senses is None else senses
    leaving = {largest + 1: -1, smallest + 1: 1}
    return frozenset(axis for axis, sense in leaving.items() if sense not in possible)


def crossing_predictions(terms: Dissipation) -> list[str]:
    """Which crossings are possible, in a sentence."""
    largest, _, smallest = inertia_order(terms.inertia)
    up, down = f"x{smallest + 1} to x{largest + 1}", f"x{largest + 1} to x{smallest + 1}"
    at_most_one = {
        frozenset[int](): "no crossing is possible",
        frozenset({-1}): f"one crossing at most, {down}",
        frozenset({1}): f"one crossing at most, {up}",
    }
    possible = possible_crossings(terms)
    if possible is None or possible in at_most_one:
        return [] if possible is None else [at_most_one[possible]]
    fluid, damping, mean = (f"{G:.6g} [moment of inertia / time]" for G in turning_momenta(terms))
    return [
        f"only {up} above |G| = {fluid}, only {down} below {damping}; on the mean the sense turns "
        f"at {mean}"
    ]
