"""The closed forms against two computations that share nothing with them: Taylor series in big
integers, and the formulas of the literature (sn, cn, dn with an initial phase and signs by cases)
in high precision.

Unless said otherwise an error is bounded by 1e-15 (1 + |omega0| |t|) relative to |omega|: the phase
n t is rounded a few times, so an error of some 1e-16 grows with the angle turned. The worst seen in
thousands of bodies is 0.27 of it.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

import mpmath
import numpy as np
import pytest
import series
from conftest import exact_motion
from hypothesis import example, given
from hypothesis import strategies as st
from mpmath import mpf

from hodo_cli import Case
from hodo_cli.models.theory import exact

EVEN = [0, 1, 2], [1, 2, 0], [2, 0, 1]


def reference(
    A: Sequence[float],
    omega0: Sequence[float],
    lam: float,
    times: Sequence[float],
    digits: int = 60,
) -> list[mpmath.matrix]:
    """Equal damping by the formulas of P1 (6), mended: with a phase, forwards in time, for any
    order of A, any sign.

    1 - k^2 is a difference here: near the separatrix the digits must outnumber the zeros it begins
    with.
    """
    order = sorted(range(3), key=lambda i: -A[i])
    hand = 1 if order in EVEN else -1  # omega is a pseudovector
    with mpmath.workdps(digits):
        A1, A2, A3 = (mpf(float(A[i])) for i in order)
        p, q, r = (hand * mpf(float(omega0[i])) for i in order)
        motion = free(A1, A2, A3, p, q, r)
        found = []
        for t in map(mpf, map(float, times)):
            s = -mpmath.expm1(-mpf(lam) * t) / mpf(lam) if lam else t
            omega = mpmath.matrix(3, 1)
            for i, component in zip(order, motion(s), strict=True):
                omega[i] = hand * mpmath.exp(-mpf(lam) * t) * component
            found.append(omega)
        return found


def free(A1, A2, A3, p, q, r):
    """Free motion for A1 >= A2 >= A3 as a function of time, in the working precision of mpmath."""
    if not any([(A2 - A3) * q * r, (A1 - A3) * p * r, (A1 - A2) * p * q]):
        return lambda t: (p, q, r)
    X = A1 * (A1 - A3) * p**2 + A2 * (A2 - A3) * q**2
    Y = A2 * (A1 - A2) * q**2 + A3 * (A1 - A3) * r**2
    D = A1 * (A1 - A2) * p**2 - A3 * (A2 - A3) * r**2
    a1, a3 = mpmath.sqrt(X / (A1 * (A1 - A3))), mpmath.sqrt(Y / (A3 * (A1 - A3)))
    sn, cn, dn = (lambda u, kind=kind: mpmath.ellipfun(kind, u, m=m) for kind in ("sn", "cn", "dn"))
    if D == 0:
        n = mpmath.sqrt((A2 - A3) * Y / (A1 * A2 * A3))
        a1, a2, a3 = (
            mpmath.sign(p) * a1,
            -mpmath.sign(p * r) * mpmath.sqrt(X / (A2 * (A2 - A3))),
            mpmath.sign(r) * a3,
        )
        u = mpmath.atanh(q / a2)
        sn, cn, dn = mpmath.tanh, mpmath.sech, mpmath.sech
    elif D < 0:
        n, m = mpmath.sqrt((A2 - A3) * Y / (A1 * A2 * A3)), (A1 - A2) * X / ((A2 - A3) * Y)
        a2, a3 = -mpmath.sign(r) * mpmath.sqrt(X / (A2 * (A2 - A3))), mpmath.sign(r) * a3
        u = mpmath.ellipf(mpmath.atan2(q / a2, p / a1), m)
    else:
        n, m = mpmath.sqrt((A1 - A2) * X / (A1 * A2 * A3)), (A2 - A3) * Y / ((A1 - A2) * X)
        a2, a1 = -mpmath.sign(p) * mpmath.sqrt(Y / (A2 * (A1 - A2))), mpmath.sign(p) * a1
        u = mpmath.ellipf(mpmath.atan2(q / a2, r / a3), m)
        cn, dn = dn, cn
    return lambda t: (a1 * cn(n * t + u), a2 * sn(n * t + u), a3 * dn(n * t + u))


def errors(found: np.ndarray, truth: Sequence[mpmath.matrix]) -> np.ndarray:
    """|found - truth| / |truth|, sample by sample; the difference is taken in high precision."""
    with mpmath.workdps(40):
        pairs = [(mpmath.matrix(row) - w, w) for row, w in zip(found.tolist(), truth, strict=True)]
        return np.array([float(mpmath.norm(off) / mpmath.norm(w)) for off, w in pairs])


def limit(omega0: np.ndarray, times: np.ndarray) -> np.ndarray:
    """1e-15 (1 + |omega0| |t|)."""
    return 1e-15 * (1 + np.linalg.norm(omega0) * np.abs(times))


def assert_free_motion(
    A: np.ndarray, omega0: np.ndarray, times: np.ndarray, digits: int = 60
) -> None:
    """Free motion as given by the reference, to `limit`."""
    truth = reference(A, omega0, 0, times, digits)
    assert (errors(exact.free_motion(A, omega0, times), truth) <= limit(omega0, times)).all()


@st.composite
def bodies(draw: st.DrawFn) -> np.ndarray:
    """Moments of inertia in any order that obey the triangle inequality; often symmetric, thin or
    nearly spherical."""
    size = st.one_of(st.floats(0.01, 1), st.sampled_from([1e-6, 0.25, 0.5, 0.5 + 1e-12]))
    x, y, z = draw(size), draw(size), draw(size)
    return np.array([y + z, z + x, x + y])


@st.composite
def starts(draw: st.DrawFn, smallest: int = -100) -> np.ndarray:
    """Angular velocities of size about 1, of all signs, often on or beside an axis."""
    mantissa = st.floats(0.1, 1)
    exponent = st.sampled_from([0, 0, 0, 0, -3, max(-12, smallest), smallest])
    parts = [
        draw(mantissa) * 10.0 ** draw(exponent) * draw(st.sampled_from([-1, 1, 1, -1, 0]))
        for _ in range(3)
    ]
    parts[draw(st.integers(0, 2))] = draw(mantissa) * draw(st.sampled_from([-1, 1]))
    return np.array(parts)


def arrangements(
    A: Sequence[float], omega0: Sequence[float]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """A body and its start with the axes in all six orders and, among them, all eight combinations
    of signs."""
    signs = itertools.cycle(itertools.product([1, -1], repeat=3))
    for order in itertools.permutations(range(3)):
        for _ in range(2):
            sign = next(signs)
            yield (
                np.array([A[i] for i in order]),
                np.array([s * omega0[i] for s, i in zip(sign, order, strict=True)]),
            )


DAMPING = st.sampled_from([0.0, 5e-324, 1e-300, 1e-12, 0.005, 0.1, 3.0, -0.1])


# Ten digits, at the least, of the series are left over, and |omega| falls by e^-24 at most.
@given(A=bodies(), omega0=starts(smallest=-12), lam=DAMPING)
@example(A=np.array([1, 0.8, 0.6]), omega0=np.array([0.5, 0.25, 1.4]), lam=0.1)
def test_agrees_with_a_taylor_series_of_the_equations(A, omega0, lam):
    times = np.array([0.0, 0.1, 1.0, 8.0])
    states = series.states(series.diagonal(A, [lam] * 3), omega0, times)
    with mpmath.workdps(60):
        truth = [
            mpmath.matrix([mpf(x.numerator) / x.denominator for x in state]) for state in states
        ]
        for a, b in zip(reference(A, omega0, lam, times), truth, strict=True):
            assert mpmath.norm(a - b) < 1e-30 * mpmath.norm(b), "the other reference is at fault"
    assert (errors(exact.damped_motion(A, omega0, lam, times), truth) <= limit(omega0, times)).all()


# exp(-lam t) is as good as the product lam t: half an ulp of it is 1e-16 lam t. For lam < 0 the
# phase grows with s > t.
@given(A=bodies(), omega0=starts(), lam=DAMPING)
def test_agrees_with_the_formulas_of_the_literature(A, omega0, lam):
    times = np.array([-7.0, 0.3, 17.0, 120.0])
    turned = np.maximum(
        abs(times),
        [abs(math.expm1(-lam * t) / lam) if lam > 1e-200 or lam < 0 else 0 for t in times],
    )
    found = exact.damped_motion(A, omega0, lam, times)
    bound = limit(omega0, turned) + 1e-15 * abs(lam * times)
    assert (errors(found, reference(A, omega0, lam, times, 260)) <= bound).all()


@pytest.mark.parametrize("distance", [1e-3, -1e-6, 1e-9, -1e-12, 1e-15, -1e-15])
def test_near_the_separatrix_no_digit_of_the_data_is_lost(distance):
    """The motion of the data as given is met, although at 1e-15 one ulp in them moves it by 8e-8 at
    t = 60 and by 2e-4 at t = 1000: D is a rational number and computed as such.
    """
    times = np.array([0.0, 5.0, 60.0, 1000.0])
    for A, omega0 in arrangements((1, 0.8, 0.6), (math.sqrt(0.6) * (1 + distance), 0.01, 1.0)):
        assert_free_motion(A, omega0, times)


def test_on_the_separatrix():
    """A1 (A1 - A2) p^2 = A3 (A2 - A3) r^2 holds exactly: 9 x 16 = 16 x 9. The motion ends on the
    middle axis."""
    times = np.array([-3.0, 0.0, 1.0, 30.0])
    for A, omega0 in arrangements((9, 8, 4), (4.0, 0.1, 3.0)):
        assert_free_motion(A, omega0, times)
        end = exact.free_motion(A, omega0, np.array([1e8]))[0]
        assert sorted(abs(end))[:2] == [0, 0]
        assert A[np.argmax(abs(end))] == 8


@pytest.mark.parametrize("beside", [1e-3, 1e-12, 1e-170])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_beside_the_principal_axes(axis, beside):
    """The middle one is left at n t = 7, 28, 391, and passed again and again; 1e-170 squared is no
    double."""
    start = [beside, beside, 2 * beside]
    start[axis] = 1.0
    times = np.array([1.0, 140.0, 2000.0])
    for A, omega0 in arrangements((1, 0.8, 0.6), start):
        assert_free_motion(A, omega0, times, 400)


@pytest.mark.parametrize(
    ("A", "omega0"),
    [
        ((1, 0.8, 0.6), (0, 0, -2)),
        ((1, 0.8, 0.6), (0, 3, 0)),
        ((1, 0.8, 0.6), (0, 0, 0)),
        ((1, 0.8, 0.8), (0, 0.3, 0.4)),
        ((0.7, 1, 1), (0, 0.3, 0.4)),
        ((1, 1, 0.6), (0.3, 0.4, 0)),
        ((0.8, 0.8, 0.8), (0.1, 0.2, 0.3)),
    ],
)
def test_steady_rotations_stay_what_they_are(A, omega0):
    found = exact.free_motion(
        np.array(A), np.array(omega0, dtype=float), np.array([-1.0, 0.0, 1e8])
    )
    assert np.array_equal(found, np.tile(omega0, (3, 1)))


# 2**500 is about 3e150. A power of two changes no digit, so the scaled motion is the same to the
# last bit.
@given(A=bodies(), omega0=starts(), lam=DAMPING, size=st.sampled_from([-498, 498]))
def test_every_scale_is_alike(A, omega0, lam, size):
    times = np.array([0.5, 9.0])
    found = exact.damped_motion(
        A, np.ldexp(omega0, size), np.ldexp(lam, size), np.ldexp(times, -size)
    )
    if lam == 0 or abs(lam) > 1e-3:  # smaller ones are rounded by the change of scale
        assert np.array_equal(found, np.ldexp(exact.damped_motion(A, omega0, lam, times), size))
    assert np.array_equal(
        exact.free_motion(np.ldexp(A, -size), omega0, times), exact.free_motion(A, omega0, times)
    )


def test_decay_far_below_the_smallest_double():
    """lam t = 0.1 x 1000 leaves e^-100; 0.1 x 1e5 leaves nothing that a double can hold, but the
    scaled state stays."""
    A, omega0, times = np.array([1, 0.8, 0.6]), np.array([0.8, 0.5, 0.74]), np.array([1000.0, 1e5])
    found, truth = (exact.damped_motion(A, omega0, 0.1, times), reference(A, omega0, 0.1, times))
    assert errors(found[:1], truth[:1])[0] <= 1e-15 * 0.1 * 1000
    assert not found[1].any()
    state, exponent = exact.scaled_motion(A, omega0, 0.1, times)
    with mpmath.workdps(40):
        scaled = [w * mpf(2) ** -int(k) for w, k in zip(truth, exponent, strict=True)]
    # One ulp in lam t = 1e4 is 2e-12.
    assert (errors(state, scaled) <= 1e-15 * 0.1 * times).all()
    assert np.array_equal(np.ldexp(state[0], exponent[0]), found[0])


@pytest.mark.parametrize(("lam", "size"), [(1e-3, 1), (0.005, 2.0**-498), (1e4, 2.0**498)])
def test_a_damped_rotation_ends_in_the_direction_of_the_free_motion(lam, size):
    """The direction has arrived, to rounding, when lam t = 60: the rest is e^-60."""
    for A, omega0 in arrangements((1, 0.8, 0.6), (0.5, 0.25, 1.4)):
        with mpmath.workdps(60):
            (end,) = reference(A, omega0, 0, [1 / lam])
            direction = end / mpmath.norm(end)
        times = np.array([60 / lam / size])
        ((state,), _) = exact.scaled_motion(A, omega0 * size, lam * size, times)
        found = state / np.linalg.norm(state)
        assert errors(found[None], [direction])[0] <= 1e-15 * (1 + 1.6 / lam)


def case(**keys: object) -> Case:
    start = {"p": 0.5, "q": 1.4, "r": -0.25}
    return Case.of({"inertia": [1, 0.6, 0.8], "initial": start, **keys})


def test_a_case_begins_at_its_own_start_of_time():
    one = case(model="linear-diag", damping=0.1, time={"start": 3, "end": 13})
    omega0 = np.array([0.5, 1.4, -0.25])
    expected = exact.damped_motion(np.array([1, 0.6, 0.8]), omega0, 0.1, np.array([0.0, 10.0]))
    assert np.array_equal(exact_motion(one, np.array([3.0, 13.0])), expected)
    assert expected[0] == pytest.approx(omega0, rel=1e-15)
    state, exponent = one.system.exact_states(np.array([3.0, 13.0]) - one.time.start)
    assert np.array_equal(np.ldexp(state, exponent[:, None]), expected)
