"""Closed forms of the rotation of a rigid body: free motion, A omega' + omega x A omega = 0, motion
under torques along G, and the attitude in free motion.

Free motion (Euler, Poinsot, Jacobi). Let e be the enclosed axis, m the axis of the middle moment of
inertia and o the remaining one. The enclosed axis is that of the largest moment where
D = G^2 - 2 T A_m is positive, and that of the smallest one else. T is the kinetic energy. With

    Y  = A_m |A_o - A_m| w_m^2 + A_e |A_o - A_e| w_e^2          (= |2 T A_o - G^2|)
    n^2 = |A_m - A_e| Y / (A1 A2 A3)        1 - k^2 = |A_o - A_e| |D| / (|A_m - A_e| Y)

w_o, w_m, w_e are proportional to cn, sn, dn of n t + u0 (Landau and Lifshitz, Mechanics, section
37). The addition theorems (DLMF 22.8) express them by the start w and its derivative w', which
Euler's equations give. In the next formulas w and w' are those at t = 0, and sn, cn, dn are those
of n t:

    w_o(t) = (w_o cn + w_o' sn dn / n) / h^2        h^2 = cn^2 + (d sn)^2
    w_m(t) = (w_m cn dn + w_m' sn / n) / h^2        d^2 = dn(u0)^2 = A_e |A_o - A_e| w_e^2 / Y
    w_e(t) = (w_e dn + w_e' sn cn / n) / h^2

These formulas need no initial phase u0 and no signs by cases. Each term is at most as large as the
amplitude of its component, so nothing cancels, even on the separatrix (k = 1: tanh and sech) and at
the unstable axis.

Conditioning. A float is a rational number, so D, Y, n and k are computed exactly and rounded once.
A start at a relative distance of 1e-15 from the separatrix costs no digits of the data as given.
The remaining error is that of the phase: relative to |omega(t)| it stays below
1e-15 (1 + |omega0| |t|), which is about the effect of one ulp in omega0 or in t. Where
|omega0| t = 1e8 the phase has seven digits left, while T and G keep all of theirs.

Torques along G change the clock of a motion, not its path. Under N = -phi G, where phi is any
function of the time and the state, the motion is omega(t) = g(t) Omega(s(t)). Omega is the free
motion from the same start, and

    g' = -phi g,    s' = g,    g(0) = 1,    s(0) = 0.

This solves A omega' + omega x A omega = N, because the gyroscopic terms are of degree 2, and the
factor g^2 drops out. G^2/2T and D/G^2 are constant, so no such motion crosses the separatrix. The
attitude at t is that of the free motion at s(t).

For damping and a brake, phi = lambda + b/|G|, let beta = b/|G(0)|. Then g' = -(beta + lambda g),
and

    a = int_0^t exp(-lambda t),    g = exp(-lambda t) - beta a,    s = a - beta int_0^t a.

The body stops at the zero of g.

Attitude of a free body. With e, m, o, n as above, u = n t + u0 and sn = sn u, the body turns about
G by the angle psi,

    psi' = |G| (A_m w_m^2 + A_o w_o^2)/(A_m^2 w_m^2 + A_o^2 w_o^2),
    psi = |G| {t/A_o + (1/A_m - 1/A_o) [J]/n},    J = (1 + nu) int sn^2/(1 + nu sn^2) du,
    1 + nu = A_m |A_e - A_o|/(A_o |A_e - A_m|),

where [J] is the growth of J since t = 0. Seen from the body the direction G/|G| goes round e; a
longitude and the angle from e are its position. The rotations by these two angles and by psi about
G give the attitude relative to space axes one of which is G. All angles are continuous, and so is
the quaternion.

u and J are counted from a zero of sn, which is the middle of a half turn. Within the half turn they
are Carlson's integrals (DLMF 19.25). All terms of these are positive, so nothing cancels near the
separatrix, where cn and dn are small.

Source: R. Montgomery, Am. J. Phys. 59 (1991) 394, for psi over a turn.
"""

import math
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from .. import rigid_body
from ..attitude import of_euler
from ..euler import about, composed

LN2_HEAD, LN2_TAIL = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
"""ln 2 as the sum of two numbers. The first has so few bits that its product with a whole number
below 2**21 is exact."""

SERIES_TERMS = 20
"""The number of terms of the series in `_phi_2`. The last one is below the rounding of long
double."""


def free_motion(A: np.ndarray, omega0: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The angular velocity (n, 3) at the times t (n,) of a free body that starts with omega0 (3,)
    at t = 0.

    A (3,): principal moments of inertia in any order, which may be equal. |omega0| may have any
    size, and t may be negative. Components of omega0 below 1e-300 |omega0| lose digits. For
    formulas, source and limits see the docstring of the module.
    """
    return damped_motion(A, omega0, 0.0, t)


def damped_motion(A: np.ndarray, omega0: np.ndarray, lam: float, t: np.ndarray) -> np.ndarray:
    """The angular velocity (n, 3) at the times t (n,) of a body with the moments A (3,) that starts
    with omega0 (3,) at t = 0 under equal damping, lambda1 = lambda2 = lambda3 = lam.

    omega(t) = exp(-lam t) Omega(s), s = (1 - exp(-lam t)) / lam, where Omega is the free motion. In
    A w' + w x A w = -lam A w the factors exp(-2 lam t) = (ds/dt) exp(-lam t) cancel. Any start
    and any signs of t and lam are allowed; lam = 0 is the free motion. A motion that has decayed
    below the smallest double is 0.

    Source: Rachinskaya, eqs (5)-(6). Eq. (6) as printed has the argument n exp(-lam t) / lam, which
    runs backwards in time and, without an initial phase, does not meet the data at t = 0.
    """
    state, exponent = scaled_motion(A, omega0, lam, t)
    return np.asarray(np.ldexp(state, exponent[:, np.newaxis]))


def scaled_motion(
    A: np.ndarray, omega0: np.ndarray, lam: float, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`damped_motion` as states (n, 3) of size about 1 and exponents (n,):
    omega = state * 2**exponent.

    The states keep their digits where omega is far below the smallest double. The exponents end at
    -1e9. Times in long double give states in long double. The state is nan where a growing motion
    has turned through an infinite angle.
    """
    t = np.asarray(t, dtype=np.result_type(t, float))
    exponent, unit = in_own_units(omega0)
    # No size beyond 2**(1e9) matters, and an exponent of 1e9 still fits an int32.
    z = np.clip(lam * t, -7e8, 7e8)
    # exp(-z) as a power of two times a factor near 1. The factor keeps its last digit where exp(-z)
    # is below the smallest double.
    halvings = np.rint(z / math.log(2))
    decay = np.exp(halvings * LN2_HEAD - z + halvings * LN2_TAIL)
    free = _free(A, unit, np.ldexp(free_time(lam, t), exponent))
    return decay[:, np.newaxis] * free, exponent - halvings.astype(np.int64)


def free_time(lam: float, t: np.ndarray) -> np.ndarray:
    """s = (1 - exp(-lam t))/lam (n,): the free motion at the time s has the direction of the damped
    motion at the time t."""
    z = lam * t
    # (1 - exp(-z))/z, which is 1 without damping and loses no digit where z is small.
    return np.asarray(t * np.divide(-np.expm1(-z), z, out=np.ones_like(z), where=z != 0))


def in_own_units(omega0: np.ndarray) -> tuple[int, np.ndarray]:
    """The exponent e of a power of two near |omega0|, and omega0/2**e, of which no product under-
    or overflows."""
    exponent = int(np.frexp(np.max(np.abs(omega0)))[1])
    return exponent, np.ldexp(omega0, -exponent)


class FreeTurn(NamedTuple):
    """The parameters of a free motion, in the letters of the module: the axes e, m and o, n, k',
    d = dn(u0), and the factors (3,) of w_j w_k in w_i'/n by Euler's equations."""

    e: int
    m: int
    o: int
    n: Any
    complementary: Any
    d: Any
    gyroscopic: tuple[Any, ...]


def free_turn(A: np.ndarray, omega0: np.ndarray, fp: Any) -> FreeTurn | None:
    """The parameters of the free motion with |omega0| near 1, as numbers of the type `fp`. None for
    a steady rotation, for which n would be 0 or 0/0."""
    # Doubles are rational numbers, so D and Y are exact, and n, k' and d have the rounding of
    # _sqrt.
    A1, A2, A3 = B = [Fraction(a) for a in A.tolist()]
    p, q, r = w = [Fraction(x) for x in omega0.tolist()]
    gyroscopic = (A2 - A3) / A1, (A3 - A1) / A2, (A1 - A2) / A3
    if not any(g * x for g, x in zip(gyroscopic, (q * r, r * p, p * q), strict=True)):
        return None
    e, m, o = order = rigid_body.inertia_order(B)
    about_e, about_o = rigid_body.separatrix_terms(B, w, order)
    # Swap, so that e is the enclosed axis, whose component dn never vanishes.
    if about_e < about_o:
        e, o = o, e
    # Y = |G^2 - 2 T A_o| and d = dn(u0), as above.
    Y = B[m] * abs(B[o] - B[m]) * w[m] ** 2 + B[e] * abs(B[o] - B[e]) * w[e] ** 2
    n = _sqrt(abs(B[m] - B[e]) * Y / (A1 * A2 * A3), fp)
    complementary = _sqrt(abs(B[o] - B[e]) * abs(about_e - about_o) / (abs(B[m] - B[e]) * Y), fp)
    d = _sqrt(B[e] * abs(B[o] - B[e]) * w[e] ** 2 / Y, fp)
    factors = tuple((1 if x > 0 else -1) * _sqrt(x * x, fp) / n for x in gyroscopic)
    return FreeTurn(e, m, o, n, complementary, d, factors)


def _free(A: np.ndarray, omega0: np.ndarray, t: np.ndarray) -> np.ndarray:
    """`free_motion` for |omega0| near 1."""
    turn = free_turn(A, omega0, t.dtype.type)
    if turn is None:
        return np.broadcast_to(omega0, (*np.shape(t), 3))

    e, m, o, n, complementary, d, g = turn
    sn, cn, dn = sn_cn_dn(n * t, complementary)
    h = np.hypot(cn, d * sn)
    cn, dn, we, wm, wo = cn / h, dn / h, omega0[e] / h, omega0[m], omega0[o] / h
    components = {
        o: wo * cn + g[o] * wm * we * sn * dn,
        m: wm * cn * dn + g[m] * we * wo * sn,
        e: we * dn + g[e] * wo * wm * sn * cn,
    }
    return np.stack([components[i] for i in range(3)], axis=-1)


def _sqrt(x: Fraction, fp: Any) -> Any:
    """The square root of a rational number, to 63 bits and then as `fp`. The number itself may be
    below the smallest double."""
    half = 63 - (x.numerator.bit_length() - x.denominator.bit_length()) // 2
    return np.ldexp(fp(np.uint64(math.isqrt(math.floor(x * Fraction(4) ** half)))), -half)


def sn_cn_dn(u: np.ndarray, complementary: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobi's sn, cn, dn of u (n,) for the complementary modulus k' = sqrt(1 - k^2) from 0 to 1.

    The method is Landen's transformation along the arithmetic-geometric mean, in ratios of sums of
    positive terms. So cn and dn keep their relative precision where they are small, however small
    k' is. (`scipy.special.ellipj`, which takes k^2, loses it.) Whole periods drop out exactly in
    the sine and cosine of the last level.

    Source: R. Bulirsch, Numer. Math. 7 (1965) 78. Here the ratio cn/sn is kept as two terms, so
    that u = 0 and the half periods are no exceptions.
    """
    # For k' = 0, the separatrix, the arithmetic and geometric means of 1 and 0 never meet.
    if complementary == 0:
        decay = np.exp(-np.abs(u))
        sech = 2 * decay / (1 + decay * decay)
        return np.tanh(u), sech, sech
    a, b, levels = u.dtype.type(1), complementary, []
    while abs(a - b) > 4 * np.finfo(u.dtype).eps * a:  # rounding may keep them 2 eps apart
        mean = (a + b) / 2
        levels.append((mean * a, mean * b))
        a, b = mean, np.sqrt(a * b)
    sn, cn, dn = np.sin(a * u), a * np.cos(a * u), np.ones_like(u)
    for aa, ab in reversed(levels):
        ss, cc = sn * sn, cn * cn
        cn, dn = cn * dn, (ab * ss + cc) / (aa * ss + cc)
    length = np.hypot(sn, cn)
    return sn / length, cn / length, dn


def sum_along_mean(d: Any, w: Any, b: Any, steps: int) -> Any:
    """The sum of 2^n c_n along the arithmetic-geometric mean a_n of sqrt((w + b)/2) and sqrt(b),
    where w^2 - b^2 = d, c_0 = 1/(2 (w + b)) and c_{n+1} = d c_n^2/(16 a_{n+1}^2).

    For w + sqrt d = 1 and m = 2 sqrt d it is 2 (2 <sn^2> - 1)/m, with the mean of sn^2 over a turn.
    All terms are positive, and each of the `steps` doubles the number of right digits.

    Source: M. Abramowitz and I. A. Stegun, 17.6, where c_{n+1} = c_n^2/(4 a_{n+1}).
    """
    a, b, c = ((w + b) / 2) ** 0.5, b**0.5, 1 / (2 * (w + b))
    total, factor = c, 1
    for _ in range(steps):
        a, b = (a + b) / 2, (a * b) ** 0.5
        c, factor = d * c * c / (16 * a * a), 2 * factor
        total = total + factor * c
    return total


class AlongMomentum(NamedTuple):
    """The rates lambda and beta >= 0 (1/time) of damping and a brake, in the letters of the module.

    beta is in long double, because its rounding shows near the stop, where g = 1 - beta t is small.
    """

    damping: float
    brake: np.longdouble

    @property
    def stop(self) -> np.longdouble:
        """The time at which the body comes to rest; infinite where it never does."""
        if not self.brake or self.damping <= -self.brake:
            return np.longdouble(math.inf)
        if not self.damping:
            return np.longdouble(1) / self.brake
        return np.longdouble(np.log1p(self.damping / self.brake) / self.damping)

    @np.errstate(over="ignore", invalid="ignore")  # a growing motion may exceed all doubles
    def clock(self, times: Any) -> tuple[np.ndarray, np.ndarray]:
        """g and s (...) at `times` >= 0 (...), in their precision. After the stop g is 0 and s is
        constant."""
        stopped, fp = np.asarray(times) >= self.stop, np.result_type(times, float).type
        t, brake = np.minimum(times, fp(self.stop)), fp(self.brake)
        a = free_time(self.damping, t)
        g = np.where(stopped, 0, np.exp(-self.damping * t) - brake * a)
        return g, a - brake * _phi_2(self.damping * t) * t * t


def _phi_2(z: Any) -> Any:
    """(exp(-z) - 1 + z)/z^2, which is 1/2 at z = 0. For |z| < 1, where the terms cancel, it is
    computed by its series."""
    is_small = np.abs(z) < 1
    small, large = np.where(is_small, z, 0), np.where(is_small, 1, z)
    term = total = 0.5 + 0 * small
    for n in range(3, SERIES_TERMS + 3):
        term = -term * small / n
        total = total + term
    return np.where(is_small, total, (large + np.expm1(-large)) / large**2)


# The attitude

DUPLICATIONS = 30
"""The number of duplications in Carlson's integrals. Each brings the arguments four times nearer to
each other, and the error is of the order of their squared distance. Arguments of 1e-60 and 1 need
six until they are of one size."""


def free_attitude(A: np.ndarray, omega0: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The quaternions (n, 4), scalar first, from body to space axes at the times t (n,) of a free
    body with the moments A (3,), in any order, and the angular velocity omega0 (3,) at t = 0. They
    are 1 at t = 0 and continuous. Times in long double give quaternions in long double.

    The errors are those of the phase, as in `free_motion`.
    """
    exponent, omega0 = in_own_units(omega0)
    t = np.ldexp(np.concatenate((t[:1] * 0, t)).astype(np.result_type(t, float)), exponent)
    turn, omega, A = (
        free_turn(A, omega0, t.dtype.type),
        free_motion(A, omega0, t),
        A.astype(t.dtype),
    )
    if turn is None:
        speed = np.hypot.reduce(omega[0])
        return np.stack(about(omega[0] / (speed or 1), speed * t[1:]), axis=-1)
    G_e, G_m, G_o = (A * omega).T[[*turn[:3]]]
    # o, m, e are a right-handed system for parity 1; else o, the opposite of m, e are.
    parity = 1 if (turn.m - turn.o) % 3 == 1 else -1
    sense = np.sign(G_e[0] * (A[turn.e] - A[turn.m]))
    angle, J = longitude_and_area(A, turn, t, parity * sense * G_m, G_o)
    psi = psi_of(A, turn, (A * omega)[0], t, J - J[0])
    tilt = parity * np.arctan2(np.hypot(G_o, G_m), G_e)
    # Q is relative to space axes one of which is G, the result relative to the attitude at t = 0.
    a, b, c, d = Q = np.array(of_euler((turn.e, turn.m, turn.e), (psi, -tilt, -sense * angle)))
    return np.stack(composed((a[0], -b[0], -c[0], -d[0]), Q[:, 1:]), axis=-1)


def psi_of(A: np.ndarray, turn: FreeTurn, G: np.ndarray, t: Any, area: Any) -> Any:
    """The angle psi (...), in the letters of the module, after times t (...) during which J grows
    by `area` (...)."""
    weight = (A[turn.o] - A[turn.m]) / (A[turn.o] * A[turn.m])  # 1/A_m - 1/A_o
    return np.hypot.reduce(G) * (t / A[turn.o] + weight * area / turn.n)


def longitude_and_area(
    A: np.ndarray, turn: FreeTurn, t: np.ndarray, G_m: np.ndarray, G_o: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The longitude (n,) of G about e and J (n,), in the letters of the module, at the times t
    (n,). Both are continuous. G_m and G_o (n,) are components of G at these times, G_m with the
    sign with which the longitude grows."""
    half_turns, side = (G_o < 0) * A.dtype.type(1), np.where(G_o < 0, -1, 1)
    u, J = phase_and_area(A, turn, side * G_m, side * G_o)
    # On the separatrix, k' = 0, a quarter turn takes an infinite time, so no half turn ends.
    if turn.complementary:
        quarter, area = phase_and_area(A, turn, 1.0, 0.0)
        u = u + 2 * quarter * half_turns
        half_turns = half_turns + 2 * np.rint((u[0] - u + turn.n * t) / (4 * quarter))
        J = J + 2 * area * half_turns
    turned = 4 * np.arctan(A.dtype.type(1)) * half_turns
    return np.arctan2(side * G_m, side * G_o) + turned, J


def turn_of_hodograph(A: np.ndarray, omega0: np.ndarray) -> tuple[float, float, str] | None:
    """The period T of the hodograph of a free body with the moments A (3,), in any order, and the
    angular velocity omega0 (3,) at the start; the angle psi in this time, whole turns included; and
    a sentence on the periods. None for a steady rotation, and on the separatrix, where the turn
    never ends. The relative errors are a few units of the last digit.

    The enclosed axis goes round G in 2 pi T/angle. If the enclosed axis has the largest moment, the
    axis of the smallest moment meanwhile goes round it once in the opposite sense, and so round G
    in 2 pi T/(angle - 2 pi).
    """
    exponent, omega0 = in_own_units(omega0)
    turn, A = free_turn(A, omega0, np.longdouble), A.astype(np.longdouble)
    if turn is None or not turn.complementary:
        return None
    quarter, area = phase_and_area(A, turn, 1.0, 0.0)
    period = float(np.ldexp(4 * quarter / turn.n, -exponent))
    angle = float(psi_of(A, turn, A * omega0, 4 * quarter / turn.n, 4 * area))
    angles = {turn.e: angle} | ({turn.o: angle - math.tau} if A[turn.e] > A[turn.o] else {})
    periods = [f"x{i + 1} in {math.tau * period / x:.9g} [time]" for i, x in angles.items()]
    words = f"the hodograph turns in {period:.9g} [time]; axes go round G: {', '.join(periods)}"
    return period, angle, words


def phase_and_area(A: np.ndarray, turn: FreeTurn, G_m: Any, G_o: Any) -> tuple[Any, Any]:
    """u and J (...), counted from the middle of a half turn, where sn = 0. G_m and G_o >= 0 (...)
    are proportional to the components of G.

    u = sn R_F(cn^2, dn^2, 1) and J = (1 + nu) sn^3 R_J(cn^2, dn^2, 1, 1 + nu sn^2)/3.
    """
    e, m, o = A[[*turn[:3]]]
    ratio = m * abs(e - o) / (o * abs(e - m))
    sn, cn = np.array([G_m, np.sqrt(ratio) * G_o]) / np.hypot(G_m, np.sqrt(ratio) * G_o)
    s, c = sn * sn, cn * cn
    # The last argument is 1 + nu s, written without the rounding of nu.
    F, J = carlson(c, c + turn.complementary**2 * s, 1.0, c + ratio * s)
    return sn * F, ratio * s * sn * J / 3


def carlson(x: Any, y: Any, z: Any, p: Any) -> tuple[Any, Any]:
    """Carlson's integrals R_F(x, y, z) and R_J(x, y, z, p) of numbers or arrays (...) in any
    precision. None of x, y and z is negative, one of them at most is 0, and p is at least as large
    as each.

    Source: B. C. Carlson, Numer. Algorithms 10 (1995) 13, without the series at the end. Every term
    is positive.
    """
    total, product = 0.0, (p - x) * (p - y) * (p - z)
    for n in range(DUPLICATIONS):
        a, b, c, d = map(np.sqrt, (x, y, z, p))
        factor = (d + a) * (d + b) * (d + c)
        root = np.sqrt(product * 64.0**-n) / factor + 1e-300  # not 0, because arctan(0)/0 is nan
        total = total + 4.0**-n * np.arctan(root) / (root * factor)
        x, y, z, p = ((value + a * b + a * c + b * c) / 4 for value in (x, y, z, p))
    rest = 4.0**-DUPLICATIONS * (5 / (x + y + z + 2 * p)) ** 1.5
    return (3 / (x + y + z)) ** 0.5, rest + 6 * total
