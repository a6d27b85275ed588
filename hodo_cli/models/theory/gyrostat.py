"""A body with a rotor at constant speed: its steady rotations, and the hodographs that they part.

G = A omega + h, with h fixed in the body. Free motion keeps |G| and 2T = A1 p^2 + A2 q^2 + A3 r^2.
It is steady where omega = s G, that is G_i = h_i/(1 - s A_i), with s a root of

    S(s) = sum_i h_i^2/(1 - s A_i)^2 - G^2.

Between neighbouring poles 1/A_i the function S is convex, and outside of all it falls to -G^2: one
root on either side of all poles, and none or two between two of them. Where h_i = 0 there is no
pole, but s = 1/A_i is a root as long as the other components leave G_i something. From a pole
outwards Newton's iteration begins where that pole's own term is G^2, from where it rises to the
root without fail, or passes the minimum where there is none. Its unknown is the distance from the
pole, 1 - s A_i: near it s itself has no digits of G_i left.

On the sphere |G| = const a steady rotation is a minimum, a saddle or a maximum of T, minima beside
the axis of largest inertia. Hodographs on which T is below that of every saddle go round that axis,
above every one round the axis of smallest inertia, and between two saddles round both ends of each.
Without a saddle nothing parts them. For G and a steady G* of the same size

    2T - 2T* = sum_i c_i (G_i - G*_i)^2,    c_i = 1/A_i - s,

a difference of positive terms, as D is: beside the separatrix nothing cancels.
"""

from typing import Any, NamedTuple

import numpy as np

from ..rigid_body import BOTH, SEPARATRIX, UNDETERMINED, UNSEPARATED, inertia_order

CANCELLED = 1e-14
"""G of a body with a rotor is the difference of two vectors: less than this part of h it is 0."""

FLAT = 1e-9
"""The curvature beside the others from which on a cone is no pair of planes."""

NEWTON_STEPS = 100
"""Of Newton's iteration. Six suffice but where two saddles meet, where each halves the distance."""


class SteadyRotations(NamedTuple):
    """Steady rotations: s (...), G (..., 3) and c (..., 3); not a number where there is none."""

    s: Any
    G: Any
    c: Any

    @property
    def is_saddle(self) -> Any:
        """Whether (...) T has a saddle there on the sphere: the product of the curvatures in the
        plane that touches the sphere is negative."""
        j, k = np.roll(self.c, -1, -1), np.roll(self.c, -2, -1)
        return (self.G * self.G * j * k).sum(-1) < 0


def steady_rotations(A: Any, h: Any, momentum: Any, with_outer: bool = True) -> SteadyRotations:
    """All steady rotations of a body with moments A (3,), in any order, and a rotor h (3,), for
    |G| = momentum (n,): (n, 6), unsorted.

    A and h may also be those of n bodies (n, 3) which have equal moments, and components of h that
    are 0, at the same places. Of a symmetric body those that stand alone, without the circles of
    them. Those beyond all 1/A_i are the outer ones, minimum and maximum of T.
    """
    momentum = np.atleast_1d(momentum)
    A, h = (np.atleast_2d(x).T for x in (A, h))
    rows = []
    for i in range(3):
        same = A[i, 0] == A[:, 0]
        # A pole belongs to all axes of one moment: the first of them stands for it.
        if i == np.flatnonzero(same)[0] and (h[same, 0].any() or same.sum() == 1):
            solve = _from_pole if h[same, 0].any() else _by_hand
            outer = {1: A[i, 0] == A[:, 0].max(), -1: A[i, 0] == A[:, 0].min()}
            sides = [side for side in (1, -1) if with_outer or not outer[side]]
            rows += [solve(A, h, momentum, i, side) for side in sides]
    rows += [np.full((7, len(momentum)), np.nan)] * (6 - len(rows))
    table = np.stack(rows).transpose(2, 0, 1)
    return SteadyRotations(table[..., 0], table[..., 4:], table[..., 1:4] / A.T[:, None])


def _total(rows: np.ndarray) -> np.ndarray:
    """The sum (n,) of three rows (3, n), a third of numpy's time."""
    return np.asarray(rows[0] + rows[1] + rows[2])


def _from_pole(A: Any, h: Any, momentum: Any, i: int, side: int) -> np.ndarray:
    """s, 1 - s A_j and G_j (7, n) of the root next to the pole of axis i, below it in s (side 1) or
    above it."""
    # u = side (1 - s A_i) grows from the pole to the next one.
    others = side * (A - A[i]) / A
    limit = np.where((others > 0) & (h != 0), others, np.inf).min(0)
    offset, ratio = (A[i] - A) / A[i], side * A / A[i]
    with np.errstate(all="ignore"):
        x = h / momentum
        u = np.sqrt(np.where(A[i] == A, x * x, 0).sum(0))
        # Only what has not converged, since numbers that are none are slow in long double.
        moving, some = np.arange(len(u)), [x, offset, ratio, limit]
        for _ in range(NEWTON_STEPS):
            (x_, offset_, ratio_, limit_), now = some, u[moving]
            e = offset_ + now * ratio_
            square = (x_ / e) ** 2
            slope = -2 * _total(square * ratio_ / e)
            step = (_total(square) - 1) / slope
            is_between = (slope < 0) & (now < limit_)
            u[moving] = np.where(is_between, now - step, np.nan)
            going = is_between & (np.abs(step) > 4 * np.finfo(u.dtype).eps * u[moving])
            moving = moving[going]
            if not moving.size:
                break
            # What belongs to one body for all has one column.
            some = [a if a.shape[-1] == 1 else a[..., going] for a in some]
        e = offset + u * ratio
        return np.stack([(1 - side * u) / A[i], *e, *(h / e)])


def _by_hand(A: Any, h: Any, momentum: Any, i: int, side: int) -> np.ndarray:
    """The same for an axis without a pole: s = 1/A_i, G_i of the sign `side` what |G| leaves."""
    e = (A[i] - A) / A[i]
    others = np.divide(h, e, out=np.zeros_like(e), where=e != 0)
    square = momentum * momentum - (others * others).sum(0)
    G = np.broadcast_to(others, (3, len(momentum))).copy()
    with np.errstate(invalid="ignore"):
        G[i] = side * np.sqrt(np.where(square > 0, square, np.nan))
    e, s = (np.where(np.isnan(G[i]), np.nan, x) for x in (e, 1 / A[i]))
    return np.stack([s, *e, *G])


def saddles(A: Any, h: Any, momentum: Any) -> SteadyRotations:
    """The saddles of lowest and highest s, hence energy, for |G| = momentum (n,): (n, 2); one for
    both where there is one, or two of the same energy."""
    rotations = steady_rotations(A, h, momentum, with_outer=False)
    is_saddle = rotations.is_saddle
    ends = [np.where(is_saddle, sign * rotations.s, np.inf).argmin(1) for sign in (1, -1)]
    chosen = [values[np.arange(len(is_saddle))[:, None], np.stack(ends, 1)] for values in rotations]
    for values in chosen:
        values[~is_saddle.any(1)] = np.nan
    return SteadyRotations(*chosen)


class HodographRegion(NamedTuple):
    """Where angular velocities (n, 3) stand among the hodographs through the lowest and the highest
    saddle.

    `value` is 2T less that of either saddle (n, 2), `size` the sum of the sizes of its terms,
    `gradient` its derivative by omega (n, 2, 3). `margin` (n, 2) is how far they are from either
    hodograph, relative to |omega|, to first order, positive above it: an error of that size may
    change the side. Without a saddle it is infinite, and the others are not a number. `label` (n,),
    as int8, is the axis 1, 2, 3 that the hodograph of G goes round, BOTH, UNSEPARATED, 0 for the
    separatrix, and -1 where G is 0 to its rounding or not finite.
    """

    value: np.ndarray
    size: np.ndarray
    gradient: np.ndarray
    margin: np.ndarray
    label: np.ndarray

    @property
    def nearest(self) -> np.ndarray:
        """The size (n,) of the smaller margin, in double precision."""
        return np.asarray(np.abs(self.margin).astype(float).min(-1))

    @property
    def separation(self) -> np.ndarray:
        """The smaller `value` (n,) as a part of the sizes of its terms; infinite without a
        saddle."""
        sizes = np.abs(self.value) / self.size
        return np.asarray(np.where(np.isnan(sizes), np.inf, sizes).min(-1))


def region_of(A: Any, h: Any, omega: Any, band: Any = 0.0) -> HodographRegion:
    """The regions of angular velocities (n, 3), of one body or of n, as in `steady_rotations`, and
    with moments of one order; on the separatrix is a margin of at most `band`, a number or (n,)."""
    A, h = (np.atleast_2d(x) for x in (A, h))
    G = A * omega + h
    near = saddles(A, h, np.sqrt((G * G).sum(-1)))
    terms = near.c * (G[:, None] - near.G) ** 2
    value = terms.sum(-1)
    # The energy of a saddle grows with |G|^2 at the rate s.
    gradient = 2 * A[:, None] * (omega[:, None] - near.s[..., None] * G[:, None])
    size = np.linalg.norm(gradient, axis=-1) * np.linalg.norm(omega, axis=-1)[:, None]
    margin = np.divide(value, size, out=np.full_like(value, np.inf), where=size != 0)
    margin = np.where(value == 0, 0, margin)
    largest, _, smallest = inertia_order(A[0])
    conditions = {
        UNDETERMINED: ~(np.abs(G).max(-1) > CANCELLED * np.abs(h).max(-1))
        | ~np.isfinite(G).all(-1),
        UNSEPARATED: np.isnan(margin).any(-1),
        SEPARATRIX: (np.abs(margin) <= np.asarray(band)[..., None]).any(-1),
        largest + 1: (margin < 0).all(-1),
        smallest + 1: (margin > 0).all(-1),
    }
    label = np.select([*conditions.values()], [*conditions], BOTH).astype(np.int8)
    margin = np.where(np.isnan(margin), np.inf, margin)
    return HodographRegion(value, np.abs(terms).sum(-1), gradient, margin, label)


def separatrix_curves(A: Any, h: Any, momentum: float) -> list[np.ndarray]:
    """The hodographs through the saddles for one |G|, as curves of G/|G| (721, 3).

    Where 2T is that of a saddle G* the lines from G* lie on a cone, sum c_i d_i^2 = 0, of which
    each meets the sphere once more: at G* - 2 (G*.d) d/(d.d).
    """
    near, curves = saddles(A, h, momentum), []
    turn = np.linspace(0, 2 * np.pi, 721)[:, None]
    for G, c in {tuple(map(tuple, pair)) for pair in zip(near.G[0], near.c[0], strict=True)}:
        if np.isnan(G).any():
            continue
        scale = np.abs(c).max()
        order = np.argsort(c)
        low, middle, high = order if c[order[1]] >= 0 else order[::-1]
        first, second = (np.eye(3)[i] / np.sqrt(max(abs(c[i]), 1e-12 * scale)) for i in (low, high))
        if abs(c[middle]) <= FLAT * scale:  # the cone is two planes, and each cuts out a circle
            # Half a turn of the line is all of it.
            half = turn / 2
            ways = [
                np.cos(half) * (first + sign * second) / np.linalg.norm(first + second)
                + np.sin(half) * np.eye(3)[middle]
                for sign in (1, -1)
            ]
        else:
            third = np.eye(3)[middle] / np.sqrt(abs(c[middle]))
            ways = [first + np.cos(turn) * second + np.sin(turn) * third]
        for d in ways:
            point = G - 2 * (d @ np.array(G))[:, None] * d / (d * d).sum(-1, keepdims=True)
            curves.append(point / momentum)
    return curves
