"""The free motion of a rigid body by its slow variables and its phase, and its means over a turn.

Axes are sorted, a >= b >= c, and omega = (p, q, r) goes with them. With h = 2T the slow variables
are

    X = G^2 - h c = a(a - c) p^2 + b(b - c) q^2        Y = h a - G^2 = b(a - b) q^2 + c(a - c) r^2
    u = |ln[(a - b) X / ((b - c) Y)]|                  m = k^2 = exp(-u)

Side +1 (D > 0): the hodograph goes round axis a. Side -1: round axis c. The separatrix is u = 0. On
side +1

    p, q, r = s sqrt(X/(a(a-c))) dn, -s sqrt(Y/(b(a-b))) sn, sqrt(Y/(c(a-c))) cn
    of n t, n^2 = (a-b) X/(abc)

and on side -1

    p, q, r = sqrt(X/(a(a-c))) cn, -s sqrt(X/(b(b-c))) sn, s sqrt(Y/(c(a-c))) dn
    of n t, n^2 = (b-c) Y/(abc)

with the sense of rotation s = +1 or -1. The phase is phi = pi n t/(2K): 0 where q = 0, and 2 pi
more after a turn. The two sides are one formula in X_e = X, X_o = Y (side +1) and X_e = Y, X_o = X
(side -1): e is the enclosed axis, o the other.

The means are written with + - * / and **, for numbers, arrays and the symbols of an engine. The
elliptic integrals come by the arithmetic-geometric mean as sums of positive terms: (K - E)/(m K)
loses its digits as m -> 0.

Source: L. D. Landau and E. M. Lifshitz, Mechanics, section 37.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from ..rigid_body import inertia_order

LANDEN = 12
"""Steps of the arithmetic-geometric mean that bring 1 - m = 1e-300 to the last digit of a
double."""

SMALLEST_M1 = 1e-300
"""The smallest 1 - m: at 0 the period is infinite, and Landen's transformation divides by 0."""


SAME_MOMENTS = 1e-15
"""The relative difference up to which two moments are equal, that of the rounding of data: the
region between them would be narrower than 1e-7 of a motion, and at a place that rounding tells."""


def either(side: Any, above: Any, below: Any) -> Any:
    """`above` on side +1, `below` on side -1; for symbols too."""
    # A choice would not pass through an engine's symbols; the side is +1 or -1 to the last digit.
    # Both weights are then 0 or 1. A mean and half a difference would lose the smaller of two
    # ratios that are each other's inverse, as of a nearly symmetric body.
    return (1 + side) / 2 * above + (1 - side) / 2 * below


def exchanged(side: Any, above: Any, below: Any) -> tuple[Any, Any]:
    """Two quantities, of axis a and of axis c, in the order of the enclosed and the other axis."""
    return either(side, above, below), either(side, below, above)


class Body(NamedTuple):
    """Principal moments in falling order, and the axes (from 0) that they belong to."""

    a: float
    b: float
    c: float
    order: tuple[int, int, int]

    @classmethod
    def of(cls, inertia: Sequence[float]) -> Self:
        """The body with these moments, which are not all equal: a sphere has no fast motion."""
        order = inertia_order(inertia)
        a, b, c = (inertia[i] for i in order)
        if min(a - b, b - c) <= SAME_MOMENTS * b:
            b = a if a - b < b - c else c
        return cls(a, b, c, order)

    @property
    def parity(self) -> int:
        """1 where the sorted axes make a right-handed system, -1 where a left-handed one."""
        return 1 if self.order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else -1

    @property
    def is_symmetric(self) -> bool:
        """Whether two moments are equal: no separatrix divides the hodographs then."""
        return self.a == self.b or self.b == self.c

    def weights(self, side: Any) -> tuple[Any, Any]:
        """(w_e, w_o) with m = w_o X_o/(w_e X_e): a - b and b - c on side +1."""
        return exchanged(side, self.a - self.b, self.b - self.c)

    def enclosed_first(self, side: Any, values: Sequence[Any]) -> tuple[Any, Any, Any]:
        """Values (3,) of the axes as given for the enclosed, the middle and the other axis."""
        of_a, of_b, of_c = (values[axis] for axis in self.order)
        of_e, of_o = exchanged(side, of_a, of_c)
        return of_e, of_b, of_o

    def label(self, side: Any) -> Any:
        """The label of the axis, as given, that motions on a side go round; side of any shape."""
        return np.where(np.asarray(side) > 0, self.order[0] + 1, self.order[2] + 1)

    def sort(self, vector: Any) -> np.ndarray:
        """A pseudovector (..., 3), omega or a torque, along the sorted axes: an odd order turns it
        round."""
        return np.asarray(self.parity * np.asarray(vector)[..., list(self.order)])

    def unsort(self, vector: np.ndarray) -> np.ndarray:
        """The inverse of `sort`."""
        unsorted = np.empty_like(vector)
        unsorted[..., list(self.order)] = self.parity * vector
        return unsorted


def turning_body(k: Any) -> Body:
    """The body with its axes sorted, from the constants of a form; for symbols too."""
    l, m, s = map(int, k.turning_axes)
    A = k.A1, k.A2, k.A3
    return Body(A[l], A[m], A[s], (l, m, s))


class SlowVariables(NamedTuple):
    """A motion at one moment or at many (n,): X_e, X_o, side, 1 - m, sense of rotation s, phase
    phi."""

    X_e: Any
    X_o: Any
    side: Any
    m1: Any
    sense: Any
    phase: Any


def slow_elements(body: Body, omega: Any) -> SlowVariables:
    """The slow variables and the phase of angular velocities (..., 3), along the body axes as
    given.

    1 - m comes from D, as a sum of terms none of which cancels: 1 - m as a difference is noise near
    the separatrix.
    """
    a, b, c = body[:3]
    p, q, r = np.moveaxis(body.sort(np.asarray(omega, dtype=float)), -1, 0)
    X = a * (a - c) * p * p + b * (b - c) * q * q
    Y = b * (a - b) * q * q + c * (a - c) * r * r
    D = a * (a - b) * p * p - c * (b - c) * r * r
    above = D > 0
    side, (X_e, X_o) = np.where(above, 1, -1), np.where(above, (X, Y), (Y, X))
    about, across = np.where(above, p, r), np.where(above, r, p)
    scale = body.weights(side)[0] * X_e
    # What does not turn is taken for the separatrix: rest, and a symmetric body across its axis.
    m1 = np.divide((a - c) * np.abs(D), scale, out=np.zeros_like(scale), where=scale != 0)
    sense = np.where(about < 0, -1, 1)
    opposite, inner = np.where(above, c, a), np.where(above, a - b, b - c)
    am = np.arctan2(-sense * np.sqrt(b * inner) * q, np.sqrt(opposite * (a - c)) * across)
    return SlowVariables(X_e, X_o, side, m1, sense, phase_of(am, m1))


@np.errstate(divide="ignore")
def shape_distance(m1: Any) -> Any:
    """u = -ln m from m1 = 1 - m (...)."""
    return -np.log1p(-np.asarray(m1))


def turn_frequency(body: Body, X_e: Any, side: Any) -> Any:
    """n = sqrt(w_e X_e/(a b c)), the factor of t in sn, cn, dn; a turn takes 4 K/n. X_e and side
    of any shape."""
    return np.sqrt(body.weights(side)[0] * X_e / (body.a * body.b * body.c))


def landen(m1: Any) -> list[tuple[Any, Any, Any]]:
    """(a_n, b_n, c_n/m) of the arithmetic-geometric mean from (1, k', k) for m1 = 1 - m (...), n =
    0 ... LANDEN.

    c_{n+1}/m = m (c_n/m)^2/(2(a_n + b_n)): no difference of near numbers, and no division by a
    small m.
    """
    m1 = np.maximum(m1, SMALLEST_M1)
    # From k' = sqrt(1 - m), never from k, which has no digits of 1 - m left near the separatrix.
    a, b, m = np.ones_like(m1), np.sqrt(m1), 1 - m1
    levels = [(a, b, np.zeros_like(m1))]
    c = 1 / (2 * (1 + b))
    for _ in range(LANDEN):
        a, b = (a + b) / 2, np.sqrt(a * b)
        levels.append((a, b, c))
        c = m * c * c / (4 * ((a + b) / 2))
    return levels


def phase_of(am: Any, m1: Any) -> Any:
    """phi = pi F(am)/(2K) of an amplitude am (...); on the whole real line, for m1 = 1 - m
    (...)."""
    levels = landen(m1)
    for a, b, _ in levels[:-1]:
        increase = np.arctan2(b * np.sin(am), a * np.cos(am))
        # `increase` and `am` are in the same quadrant; the arc tangent drops whole turns.
        am = am + increase + 2 * np.pi * np.round((am - increase) / (2 * np.pi))
    return am / 2**LANDEN


def amplitude(phase: Any, m1: Any) -> tuple[Any, Any]:
    """am and Z/m, Z = E(am) - F(am) E/K, at a phase (...) for m1 = 1 - m (...).

    Z/m = sum of (c_n/m) sin phi_n, over Landen's amplitudes, is as good at m = 0 as anywhere.

    Source: M. Abramowitz and I. A. Stegun, 16.4 and 17.6.9.
    """
    levels = landen(m1)
    m = 1 - np.maximum(m1, SMALLEST_M1)
    # Where the mean has converged, an amplitude is 2^n times the phase; Landen's steps lead back
    # from there.
    phi, zeta = 2**LANDEN * phase, 0.0
    for a, _, c in levels[:0:-1]:
        sine = np.sin(phi)
        zeta = zeta + c * sine
        phi = (phi + np.arcsin(m * c / a * sine)) / 2
    return phi, zeta


@np.errstate(divide="ignore", invalid="ignore")
def free_motion_by_phase(body: Body, slow: SlowVariables, phase: Any) -> np.ndarray:
    """omega (..., 3) along the sorted axes, at a phase (...) of the free motion with these slow
    variables (...)."""
    a, b, c = body[:3]
    am, _ = amplitude(phase, slow.m1)
    sn, cn = np.sin(am), np.cos(am)
    # A sum of squares: 1 - m sn^2 would cancel at the separatrix.
    dn = np.sqrt(cn * cn + slow.m1 * sn * sn)
    A_e, A_o = exchanged(slow.side, a, c)
    # For two equal moments the other side, with its division by 0, is not there.
    across = np.sqrt(slow.X_o / (b * body.weights(slow.side)[0]))
    w_e = slow.sense * np.sqrt(slow.X_e / (A_e * (a - c))) * dn
    w_m = -slow.sense * across * sn
    w_o = np.sqrt(slow.X_o / (A_o * (a - c))) * cn
    p, r = exchanged(slow.side, w_e, w_o)
    return np.stack((p, w_m, r), axis=-1)


AGM = 8
"""Steps of the mean: they bring 1 - m = 1e-16 to the last digit of a double."""


class Means(NamedTuple):
    """<sn^2>, <sn^4>, C = <cn^2>, Dn = <dn^2> = E/K, and <dn> = pi/(2K), at which the phase
    grows."""

    ss: Any
    ssss: Any
    cc: Any
    dd: Any
    dn: Any


def turn_means(m: Any, m1: Any, steps: int = AGM) -> Means:
    """The means of a turn for the modulus m = k^2 and m1 = 1 - m.

    <sn^2> = 1/2 + m S with S = sum of 2^(n-1) c_n^2/m^2, and c_{n+1} = c_n^2/(4 a_{n+1}). Then
    <sn^4> = (2(1 + m) <sn^2> - 1)/(3m) is (1 + 2(1 + m) S)/3, without its division.

    Source: M. Abramowitz and I. A. Stegun, 17.6.
    """
    # A power series of an engine has some twenty coefficients, of which only the first needs all
    # these steps.
    total, dn = (
        m.functions(lambda first: sums_of_mean(first, 1 - first, steps), slopes)
        if hasattr(m, "functions")
        else sums_of_mean(m, m1, steps)
    )
    ss = 0.5 + m * total
    return Means(ss, (1 + 2 * (1 + m) * total) / 3, 0.5 - m * total, 1 - m * ss, dn)


def slopes(m: Any, functions: Sequence[Any]) -> tuple[Any, Any]:
    """m dS/dm and m d<dn>/dm of S = (<sn^2> - 1/2)/m and <dn>, given them: nothing cancels, at
    m = 0 or elsewhere.

    Source: the derivatives of K and E, M. Abramowitz and I. A. Stegun, 17.3, in these variables.
    """
    total, dn = functions
    cc = 0.5 - m * total
    ratio = cc / (2 * (1 - m))
    return cc * ratio - 2 * total, -m * ratio * dn


def sums_of_mean(m: Any, m1: Any, steps: int) -> tuple[Any, Any]:
    """S = (<sn^2> - 1/2)/m and <dn>, by the arithmetic-geometric mean."""
    root = m1**0.5
    a, b = (1 + root) / 2, root**0.5
    square, factor = 1 / (4 * (1 + root) * (1 + root)), 1  # c_n^2/m^2 and 2^(n-1)
    total = square
    # A fixed number of steps, because symbols of an engine cannot be compared with a tolerance.
    for _ in range(steps - 1):
        a, b = (a + b) / 2, (a * b) ** 0.5
        square, factor = m * m * square * square / (16 * a * a), 2 * factor
        total = total + factor * square
    return total, a
