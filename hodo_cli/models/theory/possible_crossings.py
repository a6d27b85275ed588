"""Which way a sum of torques crosses the separatrix: what follows from the data alone.

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

All of it holds for constant coefficients, a diagonal tensor of resistance (lambda_i += I_ii/A_i),
and without a torque fixed in the body or in space, an expression or a rotor. A body with two equal
moments never crosses.
"""

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np


class CrossingPattern(IntEnum):
    """The crossings that are possible, by the axes of largest and smallest inertia."""

    UNKNOWN = -1
    NONE = 0
    TO_SMALLEST = 1
    """One at most, from the axis of largest inertia to that of smallest."""
    TO_LARGEST = 2
    """One at most, the other way."""
    THERE_AND_BACK = 3
    """To the axis of largest inertia, and back: two at most, but for what happens between the two
    sizes of G at which the sense may turn."""


class Dissipation(NamedTuple):
    """The coefficients of a sum of torques by body axis, (..., 3), but for kappa (...); `torque` is
    constant in the body. `covered` (...) is False where there are others, whose means over a turn
    are 0, so that they count in no growth of a tilt, but may make the motion cross."""

    inertia: Any
    damping: Any = (0.0, 0.0, 0.0)
    quadratic: Any = (0.0, 0.0, 0.0)
    quadratic_axes: Any = (0.0, 0.0, 0.0)
    kappa: Any = 0.0
    torque: Any = (0.0, 0.0, 0.0)
    covered: Any = True


class SenseReversal(NamedTuple):
    """The sizes of G (...) at which the sense of crossings turns; not a number where it does not.

    Above `fluid` a body crosses to the axis of largest inertia only, below `damping` to that of
    smallest only; `mean` is where the mean over a half turn changes its sign.
    """

    fluid: Any
    damping: Any
    mean: Any


def outer_axes(inertia: Any) -> np.ndarray:
    """The positions (..., 2) of the axes of largest and smallest inertia; ties keep the order
    given."""
    # A stable sort, as that of a single body.
    return np.argsort(-np.asarray(inertia), axis=-1, kind="stable")[..., ::2]


def turning_momenta(terms: Dissipation) -> SenseReversal:
    """Where fluid and damping change places."""
    a, b, c = np.moveaxis(-np.sort(-np.asarray(terms.inertia, float), axis=-1), -1, 0)
    # In ratios, since (a b c)^2 may have no double.
    scale, narrow = (a - c) / a / (a * b * c), (a + c - b) / c
    alpha, beta = scale * narrow, scale * (2 * a / b - narrow)
    largest, smallest = _outer(terms.inertia, terms.damping)
    excess = largest - smallest
    strengths = np.minimum(alpha, beta), np.maximum(alpha, beta), (2 * alpha + beta) / 3
    with np.errstate(all="ignore"):
        ratios = [np.where(excess > 0, excess, np.nan) / (terms.kappa * f) for f in strengths]
        return SenseReversal(*(np.where(np.isfinite(x), np.sqrt(x), np.nan) for x in ratios))


def possible_crossings(terms: Dissipation, momentum: Any = np.inf) -> np.ndarray:
    """The CrossingPattern (...) that a motion can have, as int8; from a given |G| (...) on.

    kappa and the quadratic coefficients are at least 0; for negative damping beside fluid less is
    known.
    """
    ordered = -np.sort(-np.asarray(terms.inertia, float), axis=-1)
    a, b, c = np.moveaxis(ordered, -1, 0)
    damping, quadratic = (
        np.subtract(*_outer(terms.inertia, x)) for x in (terms.damping, terms.quadratic)
    )
    first, last = _outer(terms.inertia, terms.quadratic_axes)
    # |p| and |r| on the separatrix are as sqrt(c (b - c)) and sqrt(a (a - b)).
    by_axes = first * np.sqrt(c * (b - c)) - last * np.sqrt(a * (a - b))
    fluid = np.asarray(terms.kappa) > 0
    up = fluid | (damping < 0) | (quadratic < 0) | (by_axes < 0)
    down = (damping > 0) | (quadratic > 0) | (by_axes > 0)
    dissipates = (np.asarray(terms.damping) >= 0).all(-1)
    turns = fluid & (damping > 0) & (quadratic == 0) & (by_axes == 0) & dissipates
    covered = np.asarray(terms.covered) & (np.asarray(terms.torque) == 0).all(-1)
    slow = np.asarray(momentum) <= turning_momenta(terms).damping
    codes = np.select(
        [(a == b) | (b == c), ~covered, ~down & ~up, ~down, ~up | (turns & slow), turns],
        [
            CrossingPattern.NONE,
            CrossingPattern.UNKNOWN,
            CrossingPattern.NONE,
            CrossingPattern.TO_LARGEST,
            CrossingPattern.TO_SMALLEST,
            CrossingPattern.THERE_AND_BACK,
        ],
        CrossingPattern.UNKNOWN,
    )
    return codes.astype(np.int8)


def axes_kept(terms: Dissipation, momentum: Any = np.inf) -> np.ndarray:
    """Whether (..., 3) a body axis is enclosed for ever once it is."""
    codes = possible_crossings(terms, momentum)
    absorbing = np.zeros((*codes.shape, 3), dtype=bool)
    largest = (codes == CrossingPattern.NONE) | (codes == CrossingPattern.TO_LARGEST)
    smallest = (codes == CrossingPattern.NONE) | (codes == CrossingPattern.TO_SMALLEST)
    positions = np.broadcast_to(outer_axes(terms.inertia), (*codes.shape, 2))
    np.put_along_axis(absorbing, positions, np.stack([largest, smallest], -1), -1)
    return absorbing


def _outer(inertia: Any, values: Any) -> tuple[Any, Any]:
    """Those of values (..., 3) that belong to the axes of largest and smallest inertia."""
    inertia, values = np.broadcast_arrays(inertia, np.asarray(values, float))
    outer = np.take_along_axis(values, outer_axes(inertia), -1)
    return outer[..., 0], outer[..., 1]
