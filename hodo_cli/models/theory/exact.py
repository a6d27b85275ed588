"""Closed forms: the free rotation of a rigid body, A omega' + omega x A omega = 0, its rotation
under torques along G, and its attitude.

Free motion (Euler, Poinsot, Jacobi). Let e be the enclosed axis (that of the largest moment of
inertia where D = G^2 - 2 T A_m is positive, else of the smallest), m the axis of the middle
moment and o the remaining one. With

    Y  = A_m |A_o - A_m| w_m^2 + A_e |A_o - A_e| w_e^2          (= |2 T A_o - G^2|)
    n^2 = |A_m - A_e| Y / (A1 A2 A3)        1 - k^2 = |A_o - A_e| |D| / (|A_m - A_e| Y)

w_o, w_m, w_e are proportional to cn, sn, dn of n t + u0 (Landau and Lifshitz, Mechanics, section
37). The addition theorems (DLMF 22.8) turn that into the start itself and its derivative w' given
by Euler's equations. All of w, w' are taken at t = 0, and sn, cn, dn are those of n t:

    w_o(t) = (w_o cn + w_o' sn dn / n) / h^2        h^2 = cn^2 + (d sn)^2
    w_m(t) = (w_m cn dn + w_m' sn / n) / h^2        d^2 = dn(u0)^2 = A_e |A_o - A_e| w_e^2 / Y
    w_e(t) = (w_e dn + w_e' sn cn / n) / h^2

No initial phase, no sign by cases, no parity of the order of the axes; each term is at most as
large as the amplitude of its component, so nothing cancels, on the separatrix (k = 1: tanh and
sech) and at the unstable axis as little as elsewhere.

Conditioning. A float is a rational number: D, Y and what follows from them are computed exactly and
rounded once, so a start at a relative distance of 1e-15 from the separatrix costs no digits of the
data AS GIVEN. What remains is the phase: relative to |omega(t)|, errors stay below 1e-15 (1 +
|omega0| |t|), which is about what one ulp in omega0 or in t does too. Where |omega0| t = 1e8, seven
digits of the phase are left; T and G keep all of theirs.

Torques along G change the clock of a motion, not its path. Under N = -phi G, with
phi any function of the time and the state, the motion is omega(t) = g(t) Omega(s(t)), with Omega
the free motion from the same start and

    g' = -phi g,    s' = g,    g(0) = 1,    s(0) = 0.

In A omega' + omega x A omega = N the gyroscopic terms are of degree 2, so that g^2 drops out.
G^2/2T and D/G^2 are constant, no such motion crosses the separatrix, and its attitude at t is that
of the free motion at s(t).

For phi = lambda + b/|G| (damping, a brake) let beta = b/|G(0)|. Then g' = -(beta + lambda g), and

    a = int_0^t exp(-lambda t),    g = exp(-lambda t) - beta a,    s = a - beta int_0^t a.

The body stops at the zero of g.

The attitude of a free body. With e, m, o the enclosed, the middle and the other axis, n and k' as
above, and sn, cn, dn of u = n t + u0, the body turns about G by

    psi' = |G| (A_m w_m^2 + A_o w_o^2)/(A_m^2 w_m^2 + A_o^2 w_o^2),
    psi = |G| {t/A_o + (1/A_m - 1/A_o) [J]/n},    J = (1 + nu) int sn^2/(1 + nu sn^2) du,
    1 + nu = A_m |A_e - A_o|/(A_o |A_e - A_m|),

while g = G/|G| goes round e in the body, at a longitude and an angle from e. Turned back by the two
and by psi about g, the body is in axes of space one of which is G, as at the start. The angles are
continuous, and so is the quaternion.

A half turn lies about a place where sn = 0, from which u and J are counted. Within it they are
Carlson's integrals (DLMF 19.25), whose terms are positive, so that nothing cancels near the
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
"""ln 2 in two parts; the first has so few bits that its product with a whole number below 2**21 is
exact."""


SERIES_TERMS = 20
"""Terms of the series of int a: of 2/n! the last one is below the rounding of long double."""


def free_motion(A: np.ndarray, omega0: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The angular velocity (n, 3) at the times t (n,) of a free body that starts with omega0 (3,)
    at t = 0.

    A (3,): principal moments of inertia in any order, equal ones included; |omega0| of any size; t
    may be negative. Components of omega0 below 1e-300 |omega0| lose digits. Formulas, source and
    limits: the docstring of the module.
    """
    return damped_motion(A, omega0, 0.0, t)


def damped_motion(A: np.ndarray, omega0: np.ndarray, lam: float, t: np.ndarray) -> np.ndarray:
    """The angular velocity (n, 3) at the times t (n,) where lambda1 = lambda2 = lambda3 = lam, from
    omega0 (3,).

    omega(t) = exp(-lam t) Omega(s), s = (1 - exp(-lam t)) / lam, with Omega the free motion: put
    into A w' + w x A w = -lam A w, the factors exp(-2 lam t) = (ds/dt) exp(-lam t) cancel. Any
    start, any sign of t and lam; lam = 0 is the free motion, and what has decayed below the
    smallest double is 0.

    Source: Rachinskaya, eqs (5)-(6). Departs from (6) as printed, which has the argument n exp(-lam
    t) / lam: it runs backwards in time, and without an initial phase it does not meet the data at t
    = 0.
    """
    state, exponent = scaled_motion(A, omega0, lam, t)
    return np.asarray(np.ldexp(state, exponent[:, np.newaxis]))


def scaled_motion(
    A: np.ndarray, omega0: np.ndarray, lam: float, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`damped_motion` as a state (n, 3) of size about 1 and an exponent (n,): omega = state *
    2**exponent.

    It has its digits where omega itself is far below the smallest double; the exponent ends at
    -1e9. Times in long double give a state in long double. Where a growing motion has turned
    through an infinite angle the state is nan.
    """
    t = np.asarray(t, dtype=np.result_type(t, float))
    exponent, unit = in_own_units(omega0)
    # 2^(1e9) is beyond any size that counts, and an exponent of it still fits an int32.
    z = np.clip(lam * t, -7e8, 7e8)
    # exp(-z) as a power of two and a factor near 1, which is right to the last digit also where
    # exp(-z) itself has no double.
    halvings = np.rint(z / math.log(2))
    decay = np.exp(halvings * LN2_HEAD - z + halvings * LN2_TAIL)
    free = _free(A, unit, np.ldexp(free_time(lam, t), exponent))
    return decay[:, np.newaxis] * free, exponent - halvings.astype(np.int64)


def free_time(lam: float, t: np.ndarray) -> np.ndarray:
    """s = (1 - exp(-lam t))/lam (n,), the time at which the free body is where the damped one is at
    t."""
    z = lam * t
    # (1 - exp(-z))/z, which is 1 without damping and loses no digit where z is small.
    return np.asarray(t * np.divide(-np.expm1(-z), z, out=np.ones_like(z), where=z != 0))


def in_own_units(omega0: np.ndarray) -> tuple[int, np.ndarray]:
    """The exponent of a power of two near |omega0|, and omega0 in its units, where no product
    under- or overflows."""
    exponent = int(np.frexp(np.max(np.abs(omega0)))[1])
    return exponent, np.ldexp(omega0, -exponent)


class FreeTurn(NamedTuple):
    """The enclosed, middle and other axis, n, k', d, and the factors (3,) of w_j w_k in Euler's
    w_i'/n, in the letters above."""

    e: int
    m: int
    o: int
    n: Any
    complementary: Any
    d: Any
    gyroscopic: tuple[Any, ...]


def free_turn(A: np.ndarray, omega0: np.ndarray, fp: Any) -> FreeTurn | None:
    """How G turns in a free body with |omega0| near 1, in numbers of the type `fp`; None for a
    rotation about an axis, or of a sphere, for which n would be 0 or 0/0."""
    # Doubles are rational numbers, so D, Y and the moduli are exact until the one rounding in
    # _sqrt.
    A1, A2, A3 = B = [Fraction(a) for a in A.tolist()]
    p, q, r = w = [Fraction(x) for x in omega0.tolist()]
    gyroscopic = (A2 - A3) / A1, (A3 - A1) / A2, (A1 - A2) / A3
    if not any(g * x for g, x in zip(gyroscopic, (q * r, r * p, p * q), strict=True)):
        return None
    e, m, o = order = rigid_body.inertia_order(B)
    about_e, about_o = rigid_body.separatrix_terms(B, w, order)
    # e is to be the enclosed axis, about which dn never vanishes.
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
    """The square root, to 63 bits and then as `fp`, of a rational that may itself be below the
    smallest double."""
    half = 63 - (x.numerator.bit_length() - x.denominator.bit_length()) // 2
    return np.ldexp(fp(np.uint64(math.isqrt(math.floor(x * Fraction(4) ** half)))), -half)


def sn_cn_dn(u: np.ndarray, complementary: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Jacobi's sn, cn, dn of u for the complementary modulus k' = sqrt(1 - k^2), 0 <= k' <= 1.

    Landen's transformation down the arithmetic-geometric mean, in ratios of sums of positive terms:
    where cn and dn are small they keep their relative precision however small k' is
    (`scipy.special.ellipj`, which has only k^2, fails there). The period drops out in the sine and
    cosine of the last level, which reduce their argument exactly.

    Source: R. Bulirsch, Numer. Math. 7 (1965) 78, with the ratio cn/sn kept as its two terms, so
    that u = 0 and the half periods need no exception.
    """
    # On the separatrix itself the mean of 1 and 0 never meets its geometric mean.
    if complementary == 0:
        decay = np.exp(-np.abs(u))
        sech = 2 * decay / (1 + decay * decay)
        return np.tanh(u), sech, sech
    a, b, levels = u.dtype.type(1), complementary, []
    while abs(a - b) > 4 * np.finfo(u.dtype).eps * a:  # rounding can keep them 2 eps apart for ever
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
    """The sum of 2^n c_n down the arithmetic-geometric mean of sqrt((w + b)/2) and sqrt(b), with
    c_0 = 1/(2 (w + b)), c_{n+1} = d c_n^2/(16 a_{n+1}^2) and w^2 - b^2 = d: 2 (2 <sn^2> - 1)/m for
    m = 2 sqrt d/(w + sqrt d), where w + sqrt d = 1. All terms are positive, and each step doubles
    the digits.

    Source: M. Abramowitz and I. A. Stegun, 17.6, with c_{n+1} = c_n^2/(4 a_{n+1}).
    """
    a, b, c = ((w + b) / 2) ** 0.5, b**0.5, 1 / (2 * (w + b))
    total, factor = c, 1
    for _ in range(steps):
        a, b = (a + b) / 2, (a * b) ** 0.5
        c, factor = d * c * c / (16 * a * a), 2 * factor
        total = total + factor * c
    return total


class AlongMomentum(NamedTuple):
    """The rates lambda and beta of a torque along G at the start, 1/time, beta at least 0 and in
    long double: near the stop, where g = 1 - beta t is small, its rounding shows."""

    damping: float
    brake: np.longdouble

    @property
    def stop(self) -> np.longdouble:
        """The time at which the body comes to rest; infinite where it does not."""
        if not self.brake or self.damping <= -self.brake:
            return np.longdouble(math.inf)
        if not self.damping:
            return np.longdouble(1) / self.brake
        return np.longdouble(np.log1p(self.damping / self.brake) / self.damping)

    @np.errstate(over="ignore", invalid="ignore")  # of what grows beyond all doubles
    def clock(self, times: Any) -> tuple[np.ndarray, np.ndarray]:
        """g and s (...) at times >= 0 (...), in their precision; at rest g is 0 and s constant."""
        stopped, fp = np.asarray(times) >= self.stop, np.result_type(times, float).type
        t, brake = np.minimum(times, fp(self.stop)), fp(self.brake)
        a = free_time(self.damping, t)
        g = np.where(stopped, 0, np.exp(-self.damping * t) - brake * a)
        return g, a - brake * _phi_2(self.damping * t) * t * t


def _phi_2(z: Any) -> Any:
    """(exp(-z) - 1 + z)/z^2, 1/2 at z = 0; for |z| < 1, where it cancels, by its series."""
    is_small = np.abs(z) < 1
    small, large = np.where(is_small, z, 0), np.where(is_small, 1, z)
    term = total = 0.5 + 0 * small
    for n in range(3, SERIES_TERMS + 3):
        term = -term * small / n
        total = total + term
    return np.where(is_small, total, (large + np.expm1(-large)) / large**2)


# The attitude

DUPLICATIONS = 30
"""By the duplication theorem, each of which takes the arguments four times nearer to each other;
their squared distances count. From 1e-60 and 1 they take six until they are of one size."""


def free_attitude(A: np.ndarray, omega0: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The quaternions (n, 4), scalar first, from body to space at times t (n,) of a free body with
    moments A (3,), in any order, and angular velocity omega0 (3,); 1 at t = 0, the branch
    continuous. Times in long double give quaternions in long double.

    Errors are those of the phase, as of `free_motion`.
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
    # o, m or its opposite, and e are a right-handed system.
    parity = 1 if (turn.m - turn.o) % 3 == 1 else -1
    sense = np.sign(G_e[0] * (A[turn.e] - A[turn.m]))
    angle, J = longitude_and_area(A, turn, t, parity * sense * G_m, G_o)
    psi = psi_of(A, turn, (A * omega)[0], t, J - J[0])
    tilt = parity * np.arctan2(np.hypot(G_o, G_m), G_e)
    # To the axes of space one of which is G.
    a, b, c, d = Q = np.array(of_euler((turn.e, turn.m, turn.e), (psi, -tilt, -sense * angle)))
    return np.stack(composed((a[0], -b[0], -c[0], -d[0]), Q[:, 1:]), axis=-1)


def psi_of(A: np.ndarray, turn: FreeTurn, G: np.ndarray, t: Any, area: Any) -> Any:
    """psi (...) after times t (...) in which J grows by `area` (...)."""
    weight = (A[turn.o] - A[turn.m]) / (A[turn.o] * A[turn.m])  # 1/A_m - 1/A_o
    return np.hypot.reduce(G) * (t / A[turn.o] + weight * area / turn.n)


def longitude_and_area(
    A: np.ndarray, turn: FreeTurn, t: np.ndarray, G_m: np.ndarray, G_o: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The longitude of g about e, and J, each (n,) and continuous, at times t (n,) from G there,
    G_m with the sign with which the longitude grows."""
    half_turns, side = (G_o < 0) * A.dtype.type(1), np.where(G_o < 0, -1, 1)
    u, J = phase_and_area(A, turn, side * G_m, side * G_o)
    # The separatrix, k' = 0, is an infinite quarter turn, which the motion never leaves.
    if turn.complementary:
        quarter, area = phase_and_area(A, turn, 1.0, 0.0)
        u = u + 2 * quarter * half_turns
        half_turns = half_turns + 2 * np.rint((u[0] - u + turn.n * t) / (4 * quarter))
        J = J + 2 * area * half_turns
    turned = 4 * np.arctan(A.dtype.type(1)) * half_turns
    return np.arctan2(side * G_m, side * G_o) + turned, J


def turn_of_hodograph(A: np.ndarray, omega0: np.ndarray) -> tuple[float, float, str] | None:
    """The time T in which the hodograph of a free body with moments A (3,), in any order, and
    angular velocity omega0 (3,) at the start turns once; the integral of psi' over it, whole turns
    included; and a sentence. None for a rotation about an axis, and on the separatrix, where the
    turn never ends. The relative errors are a few units of the last digit.

    The enclosed axis goes round G in 2 pi T/angle. Where it has the largest moment, the long axis,
    that of the smallest one, goes round that axis once the other way meanwhile, and so round G in
    2 pi T/(angle - 2 pi).
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
    """u and J (...) from the place where sn = 0 to one in the same half turn with these G_m and
    G_o >= 0 (...), up to a factor.

    u = sn R_F(cn^2, dn^2, 1) and J = (1 + nu) sn^3 R_J(cn^2, dn^2, 1, 1 + nu sn^2)/3.
    """
    e, m, o = A[[*turn[:3]]]
    ratio = m * abs(e - o) / (o * abs(e - m))
    sn, cn = np.array([G_m, np.sqrt(ratio) * G_o]) / np.hypot(G_m, np.sqrt(ratio) * G_o)
    s, c = sn * sn, cn * cn
    # The last is 1 + nu s without the rounding of nu.
    F, J = carlson(c, c + turn.complementary**2 * s, 1.0, c + ratio * s)
    return sn * F, ratio * s * sn * J / 3


def carlson(x: Any, y: Any, z: Any, p: Any) -> tuple[Any, Any]:
    """Carlson's integrals R_F(x, y, z) and R_J(x, y, z, p) of numbers or arrays (...) in any
    precision: none negative, x, y or z 0 but only one of them, p at least as large as they.

    Source: B. C. Carlson, Numer. Algorithms 10 (1995) 13, without the series at the end; every term
    is positive.
    """
    total, product = 0.0, (p - x) * (p - y) * (p - z)
    for n in range(DUPLICATIONS):
        a, b, c, d = map(np.sqrt, (x, y, z, p))
        factor = (d + a) * (d + b) * (d + c)
        root = np.sqrt(product * 64.0**-n) / factor + 1e-300  # no 0, whose arctan(0)/0 is 1 too
        total = total + 4.0**-n * np.arctan(root) / (root * factor)
        x, y, z, p = ((value + a * b + a * c + b * c) / 4 for value in (x, y, z, p))
    rest = 4.0**-DUPLICATIONS * (5 / (x + y + z + 2 * p)) ** 1.5
    return (3 / (x + y + z)) ** 0.5, rest + 6 * total
