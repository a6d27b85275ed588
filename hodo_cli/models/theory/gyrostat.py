"""A body with a rotor at constant speed: its steady rotations, and the hodographs that they part.

G = A omega + h, with h fixed in the body. Free motion keeps |G| and 2T = A1 p^2 + A2 q^2 + A3 r^2.
It is steady where omega = s G, that is G_i = h_i/(1 - s A_i), with s a root of

    S(s) = sum_i h_i^2/(1 - s A_i)^2 - G^2.

On the sphere |G| = const a steady rotation is a minimum, a saddle or a maximum of T, minima beside
the axis of largest inertia. Hodographs on which T is below that of every saddle go round that axis,
above every one round the axis of smallest inertia, and between two saddles round both ends of each.
Without a saddle nothing parts them. For G and a steady G* of the same size

    2T - 2T* = sum_i c_i (G_i - G*_i)^2,    c_i = 1/A_i - s,

a difference of positive terms, as D is: beside the separatrix nothing cancels. With another steady
rotation for G, and the same the other way round, 2T is seen to rise with s.

The curvatures of T along the sphere have a product of the sign of c1 c2 c3 S'(s). So the saddles
are the roots on either side of the pole 1/A_i of the middle axis, from where S falls to its least
value or, without a pole there, to the place 1/A_j of an outer axis: a saddle exists as long as that
leaves S below 0. Where the middle h_i = 0 there is no pole, but s = 1/A_i is the root as long as
the other components leave G_i something. As a function of G^2 the energy 2T of a saddle has the
slope s: it is convex for the lower saddle, whose s rises, and concave for the upper one.
"""

from typing import Any, NamedTuple

import numpy as np

from ..rigid_body import BOTH, SEPARATRIX, UNDETERMINED, UNSEPARATED, inertia_order

CANCELLED_PART = 1e-14
"""G of a body with a rotor is the difference of two vectors: less than this part of h it is 0."""

FLAT_CURVATURE = 1e-9
"""The curvature beside the others from which on a cone is no pair of planes."""

BISECTIONS = 60
"""In search of the place where a saddle appears: more than a double has digits."""

AT_POLE = 2.0**-60
"""A distance from the pole, as a part of its limit, that changes no other term."""


class SaddleCurves(NamedTuple):
    """Where bodies have saddles, in columns: the lower one of each of n bodies, then the upper one.

    A saddle stands at a distance u = `side` (1 - s A_i) from the pole of the middle axis i, since
    near it s itself has no digits of G_i left; the side is 1 for the lower saddle, else -1. There
    1 - s A_j = `offset` + u `ratio`. The distance is less than `limit`, that of the outer axis: 0
    for a saddle that never exists. Of `rotor` the part along the middle axis is `middle_rotor`, and
    `middle_moment` that axis' moment of inertia.
    """

    rotor: np.ndarray
    offset: np.ndarray
    ratio: np.ndarray
    middle_rotor: np.ndarray
    limit: np.ndarray
    side: np.ndarray
    middle_moment: np.ndarray

    @classmethod
    def of(cls, A: np.ndarray, h: np.ndarray) -> "SaddleCurves":
        """Those of n bodies with moments A (n, 3) of one order and rotors h (n, 3)."""
        largest, middle, smallest = inertia_order(A[0])
        A, h = A.T, h.T
        side, outer = np.array([[1], [-1]]), A[[largest, smallest]]
        is_middle = A[middle] == A
        middle_rotor = np.sqrt(_total(np.where(is_middle, h * h, 0)))
        # Without a pole, steady rotations of two equal moments are a circle.
        has_saddles = (middle_rotor > 0) | (is_middle.sum(0) == 1)
        curves = cls(
            rotor=h[:, None],
            offset=((A[middle] - A) / A[middle])[:, None],
            ratio=side * (A / A[middle])[:, None],
            middle_rotor=middle_rotor,
            limit=np.where(has_saddles, side * (outer - A[middle]) / outer, 0),
            side=side,
            middle_moment=A[middle],
        )
        return cls(*(_columns(values, curves.limit.shape) for values in curves))

    def chosen(self, columns: np.ndarray) -> "SaddleCurves":
        """Some of the columns, by position."""
        return SaddleCurves(*(values.take(columns, axis=-1) for values in self))

    def of_bodies(self, bodies: np.ndarray) -> "SaddleCurves":
        """The columns of some bodies, by position."""
        return self.chosen(np.concatenate([bodies, bodies + len(self.limit) // 2]))

    def s(self, u: np.ndarray) -> np.ndarray:
        """s (k,) at distances u (k,)."""
        return np.asarray((1 - self.side * u) / self.middle_moment)

    def factors(self, u: np.ndarray) -> np.ndarray:
        """1 - s A_j (3, k) at distances u (k,)."""
        return np.asarray(self.offset + u * self.ratio)

    def square(self, u: np.ndarray) -> np.ndarray:
        """|G|^2 (k,) at distances u (k,)."""
        return _total((self.rotor / self.factors(u)) ** 2)

    def square_and_slope(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same, and its derivatives (k,)."""
        e = self.factors(u)
        terms = (self.rotor / e) ** 2
        return _total(terms), -2 * _total(terms * (self.ratio / e))

    def tangent(self, u: np.ndarray, square: np.ndarray) -> np.ndarray:
        """2T (k,) where |G|^2 = square (k,) on the tangent of the energy of a saddle, as a function
        of |G|^2, at distances u (k,)."""
        return np.asarray(self.s(u) * (square - _total(self.rotor**2 / self.factors(u))))

    def nearest(self, momentum: Any) -> np.ndarray:
        """Distances (k,) that are less than where |G| = momentum (k,), or stand for the pole."""
        # There the part of G along the middle axis is `momentum`, to the rounding.
        beside = (1 - 2.0**-50) * self.middle_rotor / momentum
        return np.asarray(np.maximum(beside, AT_POLE * self.limit))

    def ahead(self, u: np.ndarray, momentum: Any) -> np.ndarray:
        """The next distances (k,) of Newton's iteration for 1/|G|, to where |G| = momentum (k,); no
        number behind the least |G|.

        1/|G| is a concave function of u between two poles, and linear beside one. So the iteration
        rises from there to the root without fail, or passes the least |G| where there is none.
        """
        square, slope = self.square_and_slope(u)
        step = 2 * square * (np.sqrt(square) / momentum - 1) / slope
        return np.where((slope < 0) & (u < self.limit), u - step, np.nan)

    def distance(self, momentum: float) -> np.ndarray:
        """The distances (k,) where |G| = momentum; no number where there is no saddle."""
        u = self.nearest(momentum)
        moving = np.flatnonzero(self.square(u) > momentum * momentum)
        # Only what has not converged, since numbers that are none are slow in long double.
        some = self.chosen(moving)
        while moving.size:
            ahead = some.ahead(u[moving], momentum)
            accuracy = (
                4 * np.finfo(u.dtype).eps * np.where(some.middle_rotor > 0, ahead, some.limit)
            )
            # Five steps suffice but where steady rotations meet; steps back are made of rounding.
            going = np.flatnonzero(ahead - u[moving] > accuracy)
            u[moving] = ahead
            moving, some = moving[going], some.chosen(going)
        return np.where(u < self.limit, u, np.nan)

    @np.errstate(all="ignore")
    def limited(self) -> "SaddleCurves":
        """The same with the distances at which the saddles appear, as |G| grows, for limits."""
        # At the limit of an axis a term may be 0/0.
        low, high = np.zeros_like(self.limit), (1 - 2.0**-50) * self.limit
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            falls = self.square_and_slope(middle)[1] < 0
            low, high = np.where(falls, middle, low), np.where(falls, high, middle)
        return self._replace(limit=high)

    @np.errstate(all="ignore")
    def least_squares(self) -> np.ndarray:
        """The |G|^2 (k,) at which the saddles appear, from limits as of `limited`."""
        return np.where(self.limit > 0, self.square(self.limit), np.inf)


def _columns(part: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Values of saddles and bodies (..., 2, n), which may have one for all, as columns."""
    whole = np.broadcast_to(part, (*part.shape[:-2], *shape))
    return whole.reshape(*part.shape[:-2], -1)


def _total(rows: np.ndarray) -> np.ndarray:
    """The sum (...) of three rows (3, ...), a third of numpy's time."""
    return np.asarray(rows[0] + rows[1] + rows[2])


class SteadyRotations(NamedTuple):
    """Steady rotations: s (...), G (..., 3) and c (..., 3); not a number where there is none."""

    s: Any
    G: Any
    c: Any


@np.errstate(all="ignore")
def saddles(A: Any, h: Any, momentum: Any) -> SteadyRotations:
    """The lower and the upper saddle of a body with moments A (3,), in any order, and a rotor h
    (3,), for |G| = momentum (n,): (n, 2). Both are the same where the middle axis has no part of h
    and the others leave it some of G.

    A and h may also be those of n bodies (n, 3) with moments of one order. Of a symmetric body the
    circles of steady rotations are no saddles.
    """
    momentum = np.atleast_1d(momentum)
    A = np.broadcast_to(A, (len(momentum), 3))
    middle = inertia_order(A[0])[1]
    # In units of |G|.
    curves = SaddleCurves.of(A, np.asarray(h) / momentum[:, None])
    u = curves.distance(1.0)
    e = curves.factors(u)
    G = curves.rotor / e
    # At the pole the middle e is 0, and G there, 0/0, is what the other two leave of |G|.
    at_pole = u == AT_POLE * curves.limit
    others = _total(G * G) - G[middle] ** 2
    e[middle, at_pole] = 0
    G[middle, at_pole] = np.sqrt(1 - others[at_pole])
    # A column for each saddle of each body: (..., 2 n) to (..., 2, n).
    s, e, G = (values.reshape(*values.shape[:-1], 2, -1) for values in (curves.s(u), e, G))
    return SteadyRotations(s.T, (G * momentum).T, (e / A.T[:, None]).T)


class HodographRegion(NamedTuple):
    """Where angular velocities (n, 3) stand among the hodographs through the lower and the upper
    saddle.

    `value` is 2T less that of either saddle (n, 2), `size` the sum of the sizes of its terms,
    `gradient` its derivative by omega (n, 2, 3). `margin` (n, 2) is how far they are from either
    hodograph, relative to |omega|, to first order, positive above it: an error of that size may
    change the side. For a saddle that does not exist it is infinite, and the others are no numbers.
    `label` (n,), as int8, is the axis 1, 2, 3 that the hodograph of G goes round, BOTH,
    UNSEPARATED, 0 for the separatrix, and -1 where G is 0 to its rounding or not finite.
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
    """The regions of angular velocities (n, 3), of one body or of n, as in `saddles`; on the
    separatrix is a margin of at most `band`, a number or (n,)."""
    A, h = (np.atleast_2d(x) for x in (A, h))
    G = A * omega + h
    near = saddles(A, h, np.sqrt((G * G).sum(-1)))
    largest, _, smallest = inertia_order(A[0])
    # Rows (3, 2, n), of the coordinates and of the saddles.
    A, h, omega, G = (np.ascontiguousarray(x.T)[:, None] for x in (A, h, omega, G))
    terms = near.c.T * (G - near.G.T) ** 2
    value = _total(terms)
    # The energy of a saddle grows with |G|^2 at the rate s.
    gradient = 2 * A * (omega - near.s.T * G)
    size = np.sqrt(_total(gradient**2) * _total(omega**2))
    margin = np.divide(value, size, out=np.full_like(value, np.inf), where=size != 0)
    margin, none = np.where(value == 0, 0, margin), np.isnan(value)
    conditions = {
        UNDETERMINED: ~(np.abs(G).max((0, 1)) > CANCELLED_PART * np.abs(h).max((0, 1)))
        | ~np.isfinite(G).all((0, 1)),
        UNSEPARATED: none.all(0),
        SEPARATRIX: (np.abs(margin) <= band).any(0),
        largest + 1: (none | (margin < 0)).all(0),
        smallest + 1: (none | (margin > 0)).all(0),
    }
    label = np.select([*conditions.values()], [*conditions], BOTH).astype(np.int8)
    margin = np.where(none, np.inf, margin)
    return HodographRegion(value.T, _total(np.abs(terms)).T, gradient.T, margin.T, label)


def separatrix_curves(A: Any, h: Any, momentum: float) -> list[np.ndarray]:
    """The hodographs through the saddles for one |G|, as curves of G/|G| (721, 3).

    Where 2T is that of a saddle G* the lines from G* lie on a cone, sum c_i d_i^2 = 0, of which
    each meets the sphere once more: at G* - 2 (G*.d) d/(d.d).
    """
    near, curves = saddles(A, h, momentum), []
    # The lower and the upper saddle may be one.
    pairs = dict.fromkeys((tuple(G), tuple(c)) for G, c in zip(near.G[0], near.c[0], strict=True))
    for saddle, c in pairs:
        if not np.isnan(saddle).any():
            G = np.array(saddle)
            for d in lines_of_cone(np.array(c)):
                points = G - 2 * (d @ G)[:, None] * d / (d * d).sum(-1, keepdims=True)
                curves.append(points / momentum)
    return curves


def lines_of_cone(c: np.ndarray) -> list[np.ndarray]:
    """The directions d (721, 3) of the lines of a cone, sum c_i d_i^2 = 0, once round it; of a flat
    cone, which is two planes, those of either plane."""
    scale = np.abs(c).max()
    order = np.argsort(c)
    # `low` is the coefficient that has a sign of its own.
    low, middle, high = order if c[order[1]] >= 0 else order[::-1]
    # The section of the cone across axis `low` is an ellipse about `first`, of half axes `second`
    # and `third`.
    first, second = (np.eye(3)[i] / np.sqrt(max(abs(c[i]), 1e-12 * scale)) for i in (low, high))
    turn = np.linspace(0, 2 * np.pi, 721)[:, None]
    if abs(c[middle]) > FLAT_CURVATURE * scale:
        third = np.eye(3)[middle] / np.sqrt(abs(c[middle]))
        return [first + np.cos(turn) * second + np.sin(turn) * third]
    # A line of a plane comes back to itself after half a turn.
    along = [(first + sign * second) / np.linalg.norm(first + second) for sign in (1, -1)]
    return [np.cos(turn / 2) * line + np.sin(turn / 2) * np.eye(3)[middle] for line in along]
