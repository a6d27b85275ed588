"""The attitude of a free body at any time, in closed form.

With e, m, o the enclosed, the middle and the other axis, n and k' as in `closed_form`, and sn, cn,
dn those of u = n t + u0, the body turns about G by

    psi' = |G| (A_m w_m^2 + A_o w_o^2)/(A_m^2 w_m^2 + A_o^2 w_o^2),
    psi = |G| {t/A_o + (1/A_m - 1/A_o) [J]/n},    J = (1 + nu) int sn^2/(1 + nu sn^2) du,
    1 + nu = A_m |A_e - A_o|/(A_o |A_e - A_m|),

while g = G/|G| goes round e in the body, at a longitude and an angle from e. Turned back by the
two, and forth by those of the start, g is where it was in space; turned about G by psi, the body
has its attitude: four rotations by angles that are continuous.

Within a quarter turn J = (1 + nu) sn^3 R_J(cn^2, dn^2, 1, 1 + nu sn^2)/3 (DLMF 19.25.14) has
positive terms only, and is as good beside the separatrix, where cn and dn are small, as elsewhere.

Source: R. Montgomery, Am. J. Phys. 59 (1991) 394, for psi over a turn.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

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
    t = np.ldexp(np.asarray(t, dtype=np.result_type(t, float)), exponent)
    turn = free_turn(A, omega0, t.dtype.type)
    A, omega0 = A.astype(t.dtype), omega0.astype(t.dtype)
    if turn is None:
        speed = np.hypot.reduce(omega0)
        return _rotation(omega0 / (speed or 1), speed * t)
    columns = _angles_and_area(A, turn, omega0, np.concatenate([t[:1] * 0, t]))
    longitude, tilt, area = columns[:, 1:]
    longitude0, tilt0, area0 = columns[:, 0]
    # The right-handed system of o, m or its opposite, and e.
    frame = np.array([turn.o, turn.m, turn.e])
    signs = np.array([1, _parity(turn), 1])
    momentum = (A * omega0)[frame] * signs
    total = np.hypot.reduce(momentum)
    psi = _psi(A, turn, total, t, area - area0)
    y, z = np.eye(3)[1:]
    # The longitude and the angle of the start, then those of t the other way.
    attitude = product(
        product(_rotation(momentum / total, psi), _rotation(z, longitude0)),
        product(_rotation(y, tilt0 - tilt), _rotation(z, -longitude)),
    )
    attitude[..., 1 + frame] = attitude[..., 1:] * signs
    return attitude


def _psi(A: np.ndarray, turn: FreeTurn, total: Any, t: Any, area: Any) -> Any:
    """psi (...) after times t (...) in which J grows by `area` (...), with `total` for |G|."""
    weight = (A[turn.o] - A[turn.m]) / (A[turn.o] * A[turn.m])  # 1/A_m - 1/A_o
    return total * (t / A[turn.o] + weight * area / turn.n)


class HodographTurn(NamedTuple):
    """A turn of the hodograph of a free body: the time that it takes, the angle psi above, by which
    the body stands turned about G then, and the parameters of the elliptic integrals: m, and nu,
    which depends on the body alone.

    The body has gone through psi - 2 pi if e has the largest moment, psi + 2 pi if the smallest.
    """

    period: float
    angle: float
    m: float
    nu: float


def turn_of_hodograph(A: np.ndarray, omega0: np.ndarray) -> HodographTurn | None:
    """The turn of the hodograph of a free body with moments A (3,), in any order, and angular
    velocity omega0 (3,) at the start; None for a rotation about an axis, and on the separatrix,
    where it takes for ever.

    Errors are relative, and a few units of the last digit.
    """
    exponent, omega0 = in_own_units(omega0)
    turn = free_turn(A, omega0, np.longdouble)
    if turn is None or not turn.complementary:
        return None
    A = A.astype(np.longdouble)
    quarter, area = _quarter_turn(A, turn)
    period = 4 * quarter / turn.n
    psi = _psi(A, turn, np.hypot.reduce(A * omega0), period, 4 * area)
    m, nu = 1 - turn.complementary**2, _characteristic(A, turn) - 1
    return HodographTurn(*map(float, (np.ldexp(period, -exponent), psi, m, nu)))


def composed(first: Iterable[Any], second: Iterable[Any]) -> tuple[Any, ...]:
    """The components of the rotation `second`, then `first`, from those of both."""
    a, b, c, d = first
    e, f, g, h = second
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The rotation `second`, then `first`, as quaternions (..., 4), scalar first."""
    return np.stack(composed(np.moveaxis(first, -1, 0), np.moveaxis(second, -1, 0)), axis=-1)


def _rotation(axis: np.ndarray, angle: Any) -> np.ndarray:
    """The quaternions (n, 4) of turns by angles (n,) about an axis (3,) of length 1."""
    half = np.asarray(angle)[..., None] / 2
    return np.concatenate([np.cos(half), np.sin(half) * axis], axis=-1)


def _angles_and_area(
    A: np.ndarray, turn: FreeTurn, omega0: np.ndarray, t: np.ndarray
) -> np.ndarray:
    """The longitude of g about e, its angle from e, and J (3, n) at times t (n,), the first of them
    0; continuous in t."""
    e, m, o = turn[:3]
    # Doubles, as the moments and the start were given.
    omega = free_motion(A.astype(float), omega0.astype(float), t)
    # In one of four mirror images the phase grows with the longitude, and cn is positive at the
    # start.
    sense = np.sign(omega0[e] * turn.gyroscopic[m])
    mirror = -1 if omega0[o] < 0 else 1
    # A component -0.0 becomes 0.0: half a turn is pi for arctan2 then, and never -pi.
    wm, wo = mirror * sense * omega[:, m] + 0.0, mirror * omega[:, o] + 0.0
    whole_turns, area = _turns_and_area(A, turn, wm, wo, t)
    pi = 4 * np.arctan(t.dtype.type(1))
    angle = np.arctan2(A[m] * wm, A[o] * wo) + 2 * pi * whole_turns
    longitude = _parity(turn) * sense * angle + (pi if mirror < 0 else 0)
    tilt = np.arctan2(np.hypot(A[m] * wm, A[o] * wo), A[e] * omega[:, e])
    return np.stack([longitude, tilt, area])


def _turns_and_area(
    A: np.ndarray, turn: FreeTurn, wm: np.ndarray, wo: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The whole turns since the phase u = n t + u0 was 0, and J, at times t (n,), the first of them
    0, from w_m and w_o then.

    u and J are 0 where cn = 1; they are computed in the half turn about that place, to which the
    half turns in between are added.
    """
    e, m, o = turn[:3]
    half_turns = np.where(wo < 0, np.where(wm < 0, -1, 1), 0)
    whole_turns = np.zeros_like(half_turns)
    sn, cn = np.sqrt(A[m] * abs(A[m] - A[e])) * wm, np.sqrt(A[o] * abs(A[o] - A[e])) * wo
    length = np.hypot(sn, cn)
    u, area = _integrals(A, turn, np.where(wo < 0, -sn, sn) / length, np.abs(cn) / length)
    # The separatrix, k' = 0, is an infinite quarter turn, which the motion never leaves.
    if turn.complementary:
        quarter, area_of_quarter = _quarter_turn(A, turn)
        u = u + 2 * quarter * half_turns
        whole_turns = np.rint((u[0] + turn.n * t - u) / (4 * quarter))
        area = area + 2 * area_of_quarter * (half_turns + 2 * whole_turns)
    return whole_turns, area


def _characteristic(A: np.ndarray, turn: FreeTurn) -> Any:
    """1 + nu."""
    e, m, o = turn[:3]
    return A[m] * abs(A[e] - A[o]) / (A[o] * abs(A[e] - A[m]))


def _integrals(A: np.ndarray, turn: FreeTurn, sn: Any, cn: Any) -> tuple[Any, Any]:
    """F and J (...) from 0 to where sn and cn >= 0 are these (...)."""
    ratio, s, c = _characteristic(A, turn), sn * sn, cn * cn
    # The last is 1 + nu s without the rounding of nu.
    F, J = carlson(c, c + turn.complementary**2 * s, 1.0, c + ratio * s)
    return sn * F, ratio * s * sn * J / 3


def _quarter_turn(A: np.ndarray, turn: FreeTurn) -> tuple[Any, Any]:
    """F and J of a quarter turn: K, and J up to there."""
    return _integrals(A, turn, A.dtype.type(1), A.dtype.type(0))


def carlson(x: Any, y: Any, z: Any, p: Any) -> tuple[Any, Any]:
    """Carlson's integrals R_F(x, y, z) and R_J(x, y, z, p) of numbers or arrays (...) in any
    precision: none negative, x, y or z 0 but only one of them, p at least as large as they.

    Source: B. C. Carlson, Numer. Algorithms 10 (1995) 13, without the series at the end; every term
    is positive.
    """
    total, scale, product = 0.0, 1.0, (p - x) * (p - y) * (p - z)
    for _ in range(DUPLICATIONS):
        a, b, c, d = map(np.sqrt, (x, y, z, p))
        factor = (d + a) * (d + b) * (d + c)
        root = np.sqrt(product * scale**3) / factor
        total = total + scale / factor * np.where(
            root > 0, np.arctan(root) / np.where(root > 0, root, 1), 1
        )
        shift = a * b + a * c + b * c
        x, y, z, p = ((value + shift) / 4 for value in (x, y, z, p))
        scale = scale / 4
    return (3 / (x + y + z)) ** 0.5, scale * (5 / (x + y + z + 2 * p)) ** 1.5 + 6 * total


def _parity(turn: FreeTurn) -> int:
    """1 where o, m, e is a right-handed system, -1 where a left-handed one."""
    return 1 if (turn.m - turn.o) % 3 == 1 else -1
