"""Theorems on a sum of torques: in which sense a motion can cross the separatrix D = 0.

Let a > b > c be the moments of inertia and 1, 2, 3 their axes. A state on the separatrix with a
given |G| is determined, up to signs, by one number sigma from 0 to 1:

    p^2 = sigma G^2 (b - c)/(a b (a - c)),    r^2 = sigma G^2 (a - b)/(b c (a - c)),
    q^2 = (1 - sigma) G^2/b^2.

Under damping -lambda_i A_i omega_i, quadratic drag -c_i |omega| A_i omega_i, a fluid with the
coefficient kappa and any torque along G the rate of D there is

    D' = 2 W sigma {kappa G^2 [alpha sigma + beta (1 - sigma)] - (lambda_1 - lambda_3)
                    - (c_1 - c_3) |omega|},
    W = (a - b)(b - c) G^2/(b (a - c)),
    alpha = (a - c) b (a + c - b)/(abc)^2,    beta = (a - c) [2ac - b (a + c - b)]/(abc)^2,

where alpha and beta are not negative for any body. If all terms in the braces have one sign, every
crossing has this sense, so there is one crossing at most. If a fluid acts against damping, the sign
depends on |G|, which falls: at large |G| the fluid turns the body to axis 1, at small |G| the
damping turns it back to axis 3. On the mean over a half turn near the separatrix the sense turns
where kappa G^2 f = lambda_1 - lambda_3, with f = (2 alpha + beta)/3.

All of this holds for constant coefficients, and without torques fixed in the body or in space,
expressions and rotors. A diagonal tensor of resistance adds I_ii/A_i to lambda_i. A body with two
equal moments never crosses.
"""

from typing import Any, NamedTuple

import numpy as np

from ..rigid_body import inertia_order


class Dissipation(NamedTuple):
    """The moments of inertia and the coefficients of a sum of torques, each by body axis (3,),
    except for the number kappa. `torque` is constant in the body. `covered` is False where further
    torques act."""

    inertia: Any
    damping: Any = (0.0, 0.0, 0.0)
    quadratic: Any = (0.0, 0.0, 0.0)
    kappa: Any = 0.0
    torque: Any = (0.0, 0.0, 0.0)
    covered: Any = True


@np.errstate(all="ignore")
def turning_momenta(terms: Dissipation) -> tuple[float, float, float]:
    """Three values of |G| at which the sense of crossings changes, for a fluid against damping; nan
    where it does not change.

    Above the first value the fluid prevails: a body crosses to the axis of largest inertia only.
    Below the second damping prevails: it crosses to the axis of smallest inertia only. At the third
    the mean of D' over a half turn changes its sign.
    """
    c, b, a = np.sort(np.asarray(terms.inertia, float))
    # In ratios, because (a b c)^2 may overflow.
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
    the axis of smallest inertia. None where no theorem applies.

    With one sense there is one crossing at most. With both, the motion may go to the axis of
    largest inertia and back, with two crossings at most outside the range of |G| in which the sense
    changes. kappa and the quadratic coefficients must not be negative. For negative damping beside
    a fluid no theorem applies.
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
    # |G| alone decides whether fluid or damping prevails, and |G| falls.
    turns = has_fluid and damping > 0 and not quadratic and min(terms.damping) >= 0
    return frozenset({1, -1}) if turns else None


def axes_never_left(terms: Dissipation) -> frozenset[int]:
    """The body axes (1 to 3) that are enclosed for ever once they are enclosed."""
    largest, _, smallest = inertia_order(terms.inertia)
    senses = possible_crossings(terms)
    possible = {-1, 1} if senses is None else senses
    leaving = {largest + 1: -1, smallest + 1: 1}
    return frozenset(axis for axis, sense in leaving.items() if sense not in possible)


def crossing_predictions(terms: Dissipation) -> list[str]:
    """A sentence on the crossings that are possible; none where no theorem applies."""
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
