"""The attitude of a free body at any time, in closed form.

With e, m, o the enclosed, the middle and the other axis, n and k' as in `closed_form`, and sn, cn,
dn those of u = n t + u0, the body turns about G by

    psi' = |G| (A_m w_m^2 + A_o w_o^2)/(A_m^2 w_m^2 + A_o^2 w_o^2),
    psi = |G| {t/A_o + (1/A_m - 1/A_o) [J]/n},    J = (1 + nu) int sn^2/(1 + nu sn^2) du,
    1 + nu = A_m |A_e - A_o|/(A_o |A_e - A_m|),

while g = G/|G| goes round e in the body, at a longitude and an angle from e. Turned back by the two
and by psi about g, the body stands in axes of space one of which is G; and so it did at the start.
The angles are continuous, and so is the quaternion.

A half turn lies about a place where sn = 0, from which u and J are counted. Within it they are
Carlson's integrals (DLMF 19.25), whose terms are positive, so that nothing cancels beside the
separatrix, where cn and dn are small.

Source: R. Montgomery, Am. J. Phys. 59 (1991) 394, for psi over a turn.
"""

import math
from typing import Any

import numpy as np

from ..attitude import of_euler
from ..euler import about, composed
from .closed_form import FreeTurn, free_motion, free_turn, in_own_units

DUPLICATIONS = 30
"""By the duplication theorem, each of which takes the arguments four times nearer to each other;
their squared distances count. From 1e-60 and 1 they take six until they are of one size."""


def free_attitude(A: np.ndarray, omega0: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The quaternions (n, 4), scalar first, from body to space at times t (n,) of a free body with
    moments A (3,), in any order, and angular velocity omega0 (3,); 1 at t = 0, the branch
    continuous. Times in long double give quaternions in long double.

    Errors are those of the phase, as of `closed_form.free_motion`.
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
    """The turn of the hodograph of a free body with moments A (3,), in any order, and angular
    velocity omega0 (3,) at the start: the time T that it takes, the integral of psi' over it, whole
    turns included, and a sentence; None for a rotation about an axis, and on the separatrix, where
    it takes for ever. Errors are relative, and a few units of the last digit.

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
