"""The closed forms against Taylor series in big integers and the formulas of the literature."""

import itertools
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
import series
from hypothesis import example, given
from hypothesis import strategies as st
from mpmath import mpf

from hodo_cli.models.theory import exact

EVEN = [0, 1, 2], [1, 2, 0], [2, 0, 1]


def reference(A, omega0, lam, times, digits=60):
    """Equal damping by the formulas of P1 (6), mended, in any order of A; the digits must outnumber
    the zeros that 1 - k^2 begins with."""
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
    """Free motion for A1 >= A2 >= A3 as a function of time."""
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
    """1e-15 (1 + |omega0| |t|), as the phase n t is rounded a few times; the worst seen is 0.27."""
    return 1e-15 * (1 + np.linalg.norm(omega0) * np.abs(times))


def assert_free_motion(A, omega0, times, digits=60):
    """Free motion as given by the reference, to `limit`."""
    truth = reference(A, omega0, 0, times, digits)
    assert (errors(exact.free_motion(A, omega0, times), truth) <= limit(omega0, times)).all()


@st.composite
def bodies(draw: st.DrawFn) -> np.ndarray:
    """Moments of inertia in any order, often symmetric, thin or nearly spherical."""
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


def arrangements(A, omega0):
    """A body and its start in all six orders of the axes and all eight combinations of signs."""
    signs = itertools.cycle(itertools.product([1, -1], repeat=3))
    for order in itertools.permutations(range(3)):
        for _ in range(2):
            sign = next(signs)
            yield np.array(A)[[*order]], sign * np.array(omega0)[[*order]]


DAMPING = st.sampled_from([0.0, 5e-324, 1e-300, 1e-12, 0.005, 0.1, 3.0, -0.1])


# Ten digits, at the least, of the series are left over, and |omega| falls by e^-24 at most.
@given(A=bodies(), omega0=starts(smallest=-12), lam=DAMPING)
@example(A=np.array([1, 0.8, 0.6]), omega0=np.array([0.5, 0.25, 1.4]), lam=0.1)
def test_agrees_with_a_taylor_series_of_the_equations(A, omega0, lam):
    times = np.array([0.0, 0.1, 1.0, 8.0])
    states = series.states(series.diagonal(A, [lam] * 3), omega0, times)
    with mpmath.workdps(60):
        truth = [mpmath.matrix([mpf(x.numerator) / x.denominator for x in y]) for y in states]
        for a, b in zip(reference(A, omega0, lam, times), truth, strict=True):
            assert mpmath.norm(a - b) < 1e-30 * mpmath.norm(b), "the other reference is at fault"
    assert (errors(exact.damped_motion(A, omega0, lam, times), truth) <= limit(omega0, times)).all()


# exp(-lam t) is as good as lam t: half an ulp of it. For lam < 0 the phase grows with s > t.
@given(A=bodies(), omega0=starts(), lam=DAMPING)
def test_agrees_with_the_formulas_of_the_literature(A, omega0, lam):
    times = np.array([-7.0, 0.3, 17.0, 120.0])
    stretched = [math.expm1(-lam * t) / lam if lam > 1e-200 or lam < 0 else 0 for t in times]
    turned = np.maximum(abs(times), np.abs(stretched))
    found = exact.damped_motion(A, omega0, lam, times)
    bound = limit(omega0, turned) + 1e-15 * abs(lam * times)
    assert (errors(found, reference(A, omega0, lam, times, 260)) <= bound).all()


@pytest.mark.parametrize("distance", [1e-3, -1e-6, 1e-9, -1e-12, 1e-15, -1e-15])
def test_near_the_separatrix_no_digit_of_the_data_is_lost(distance):
    """Although at 1e-15 one ulp in them moves the motion by 2e-4 at t = 1000."""
    times = np.array([0.0, 5.0, 60.0, 1000.0])
    for A, omega0 in arrangements((1, 0.8, 0.6), (math.sqrt(0.6) * (1 + distance), 0.01, 1.0)):
        assert_free_motion(A, omega0, times)


def test_on_the_separatrix():
    """9 x 16 = 16 x 9, exactly: the motion ends on the middle axis."""
    times = np.array([-3.0, 0.0, 1.0, 30.0])
    for A, omega0 in arrangements((9, 8, 4), (4.0, 0.1, 3.0)):
        assert_free_motion(A, omega0, times)
        end = exact.free_motion(A, omega0, np.array([1e8]))[0]
        assert sorted(abs(end))[:2] == [0, 0]
        assert A[np.argmax(abs(end))] == 8


@pytest.mark.parametrize("beside", [1e-3, 1e-12, 1e-170])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_beside_the_principal_axes(axis, beside):
    """The middle one is passed again and again; 1e-170 squared is no double."""
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
    found = exact.free_motion(np.array(A), np.array(omega0, float), np.array([-1.0, 0.0, 1e8]))
    assert np.array_equal(found, np.tile(omega0, (3, 1)))


# A power of two changes no digit, so the scaled motion is the same to the last bit.
@given(A=bodies(), omega0=starts(), lam=DAMPING, size=st.sampled_from([-498, 498]))
def test_every_scale_is_alike(A, omega0, lam, size):
    times = np.array([0.5, 9.0])
    fast = np.ldexp(omega0, size), np.ldexp(lam, size), np.ldexp(times, -size)
    found = exact.damped_motion(A, *fast)
    if lam == 0 or abs(lam) > 1e-3:  # smaller ones are rounded by the change of scale
        assert np.array_equal(found, np.ldexp(exact.damped_motion(A, omega0, lam, times), size))
    heavy, plain = (exact.free_motion(x, omega0, times) for x in (np.ldexp(A, -size), A))
    assert np.array_equal(heavy, plain)


def test_decay_far_below_the_smallest_double():
    """At t = 1e5 no double holds what is left, but the scaled state stays."""
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


def elapsed(rates: tuple[float, ...], g: Any) -> tuple[Any, Any]:
    """t and s at which the size has fallen from 1 to g, by quadrature."""
    damping, brake = map(mpmath.mpf, rates)
    last = mpmath.log(g) if g else mpmath.mpf(-120)
    steps = [-4 * i for i in range(int(-last / 4) + 1)] + [last]

    def integral(power: int) -> Any:
        def of(u: Any) -> Any:
            x = mpmath.exp(u)
            return x ** (1 + power) / (brake + damping * x)

        return -mpmath.quad(of, steps)

    return integral(0), integral(1)


SIZES = (0.0, 1e-9, 0.02, 3.0)


@pytest.mark.parametrize("rates", [r for r in itertools.product(SIZES, repeat=2) if any(r)])
def test_size_and_clock_are_the_integrals(rates: tuple[float, ...]) -> None:
    """For rates of every ratio, at times up to the stop or where the size has fallen far."""
    law = exact.AlongMomentum(*rates)
    end = float(law.stop) if np.isfinite(law.stop) else 8 / max(rates)
    with mpmath.workdps(22):
        for t in end * np.array([1e-6, 0.3, 0.99]):
            g, s = law.clock(t)
            exact_t, exact_s = elapsed(rates, mpmath.mpf(float(g)))
            # How far t moves when g does by its rounding: near the start g says little of t.
            slope = float(rates[1] / g + rates[0])
            assert abs(float(exact_t - t)) <= 2e-15 * t + 4e-16 / slope, t
            # Of s the same, from the t that g belongs to.
            assert abs(float(exact_s - s)) <= 4e-15 * s + float(g) * abs(float(exact_t - t)), t
        if np.isfinite(law.stop):
            exact_t, exact_s = elapsed(rates, 0)
            stopped_g, stopped_s = law.clock(np.array([law.stop, 2 * law.stop]))
            assert float(law.stop) == pytest.approx(float(exact_t), rel=4e-16 * 4)
            assert stopped_g.tolist() == [0, 0]
            assert stopped_s == pytest.approx([float(exact_s)] * 2, rel=4e-15)


@pytest.mark.parametrize(
    ("rates", "stops"), [((-0.1, 0.2), True), ((-0.199, 0.2), True), ((-0.3, 0.2), False)]
)
def test_negative_damping_may_keep_a_body_from_rest(rates, stops):
    law = exact.AlongMomentum(*rates)
    assert np.isfinite(law.stop) == stops
    end = float(law.stop) if stops else 20.0
    with mpmath.workdps(30):
        damping, brake = map(mpmath.mpf, rates)
        of = mpmath.odefun(lambda t, y: [-(brake + damping * y[0]), y[0]], 0, [1, 0])
        for t in end * np.array([0.1, 0.5, 0.9]):
            assert [*law.clock(t)] == pytest.approx([float(x) for x in of(t)], rel=1e-13)


def test_long_doubles() -> None:
    _, s = exact.AlongMomentum(0.004, 0.01).clock(np.longdouble(60))
    with mpmath.workdps(30):
        damping, brake = mpf(0.004), mpf(0.01)
        _, true = mpmath.odefun(lambda t, y: [-(brake + damping * y[0]), y[0]], 0, [1, 0])(60)
        assert abs(mpf(float(s)) + mpf(float(s - float(s))) - true) < 1e-17 * true


# The attitude.

P1 = np.array([1.0, 0.8, 0.6])
B, C = np.array([0.8, 0.5, 0.74]), np.array([0.5, 0.25, 1.4])
ONE = np.array([1.0, 0.0, 0.0, 0.0])


def kinematics(A: Any, lam: Any = (0, 0, 0)) -> series.System:
    """Euler's equations under linear damping, and Q' = Q (0, omega)/2; Q is variables 3 to 6."""
    half = Fraction(1, 2)
    return (
        *series.diagonal(A, lam),
        {(0, 4): -half, (1, 5): -half, (2, 6): -half},
        {(0, 3): half, (2, 5): half, (1, 6): -half},
        {(1, 3): half, (0, 6): half, (2, 4): -half},
        {(2, 3): half, (1, 4): half, (0, 5): -half},
    )


def expected(A: Any, omega: Any, times: list[float], lam: Any = (0, 0, 0)) -> np.ndarray:
    start = [*omega.tolist(), 1, 0, 0, 0]
    states = series.states(kinematics(A.tolist(), lam), start, times, bits=128)
    return np.array(states, dtype=float)[:, 3:]


def test_times_in_long_double_give_its_digits() -> None:
    """Twenty times nearer than doubles come."""
    times = [7.0, 29.0, 60.0]
    found = exact.free_attitude(P1, B, np.array(times, dtype=np.longdouble))
    states = series.states(kinematics(P1.tolist()), [*B.tolist(), *ONE.tolist()], times, bits=160)
    for row, state in zip(found, states, strict=True):
        for x, truth in zip(row, state[3:], strict=True):
            high = float(x)
            assert abs(Fraction(high) + Fraction(float(x - high)) - truth) < 3e-17


@pytest.mark.parametrize("y", [1e-60, 0.3, 1.0])
@pytest.mark.parametrize("p", [1.0, 40.0])
def test_the_integrals_are_carlsons(y: float, p: float) -> None:
    for x in (0.0, y):
        known = float(mpmath.elliprf(x, y, 1)), float(mpmath.elliprj(x, y, 1, p))
        assert exact.carlson(x, y, 1.0, p) == pytest.approx(known, rel=2e-15)


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
@pytest.mark.parametrize("start", [B, C])
def test_in_every_order_of_the_axes_and_every_sense(order: tuple[int, ...], start: Any) -> None:
    """Both sides of the separatrix, all signs of omega, several turns."""
    draw, times = np.random.default_rng(sum(order[:2])), [0.3, 7.0, 29.0, 60.0]
    for signs in ((-1, 1, 1), (1, -1, -1)):
        moments, omega = P1[list(order)], (start * signs * draw.uniform(0.9, 1.1, 3))[list(order)]
        found = exact.free_attitude(moments, omega, np.array(times))
        assert found == pytest.approx(expected(moments, omega, times), abs=4e-14)


def test_bodies_of_all_shapes() -> None:
    """Random moments and starts; the phase of a thin body is known worst."""
    draw, worst = np.random.default_rng(2), 0.0
    for _ in range(40):
        moments = draw.uniform(0.05, 1, 3)
        if 2 * moments.max() > moments.sum():
            continue
        omega, times = draw.normal(size=3), [3.0, 20.0]
        found = exact.free_attitude(moments, omega, np.array(times))
        worst = max(worst, np.abs(found - expected(moments, omega, times)).max())
    assert worst < 4e-14


@pytest.mark.parametrize("distance", [0.0, 1e-14, -1e-14, -1e-6])
@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1)])
def test_on_the_separatrix_and_beside_it(distance: float, signs: tuple[int, int]) -> None:
    """A body with a (a - b) = c (b - c), so that D = a (a - b) (p^2 - r^2), exactly."""
    moments = np.array([1.125, 0.9375, 0.5625])
    omega = np.array([signs[0] * (1 + distance), 0.5, signs[1]])
    times = [0.5, 3.0, 12.0]
    found = exact.free_attitude(moments, omega, np.array(times))
    assert found == pytest.approx(expected(moments, omega, times), abs=1e-13)


@pytest.mark.parametrize(
    ("moments", "omega"),
    [
        ((1.0, 1.0, 0.6), (0.3, -0.4, 1.1)),
        ((0.6, 1.0, 1.0), (0.3, -0.4, 1.1)),
        ((0.6, 1.0, 0.6), (0.3, -0.4, 1.1)),
        ((1.0, 1.0, 0.6), (0.3, -0.4, 0.0)),
        ((1.0, 1.0, 1.0), (0.3, -0.4, 1.1)),
        ((1.0, 0.8, 0.6), (0.0, 0.0, -1.3)),
        ((1.0, 0.8, 0.6), (0.0, 1.3, 0.0)),
        ((1.0, 0.8, 0.6), (1e-9, 0.0, 1.3)),
        ((1.0, 0.8, 0.6), (1e-9, 1.3, 0.0)),
        ((1.0, 0.6, 0.4), (0.5, 0.2, 0.3)),
    ],
)
def test_symmetric_bodies_steady_rotations_and_discs(moments: Any, omega: Any) -> None:
    times = [0.0, 1.0, 9.0, 25.0]
    moments, omega = np.array(moments), np.array(omega)
    found = exact.free_attitude(moments, omega, np.array(times))
    assert found == pytest.approx(expected(moments, omega, times), abs=1e-13)


def test_after_a_turn_the_body_has_turned_about_G_by_psi() -> None:
    """By (-1)^k (cos(k psi/2), sin(k psi/2) G/|G|), with psi by Taylor series in 176 bits."""
    turns = (B, 21.955631800395534, 30.430603579027798), (C, 14.971259829455285, 17.083449770015107)
    for order, (start, period, psi) in itertools.product(itertools.permutations(range(3)), turns):
        moments, omega = P1[list(order)], start[list(order)]
        k = np.arange(1, 5)
        G = moments * omega / np.linalg.norm(moments * omega)
        half = k[:, None] * psi / 2
        turned = (-1.0) ** k[:, None] * np.concatenate([np.cos(half), np.sin(half) * G], axis=1)
        assert exact.free_attitude(moments, omega, k * period) == pytest.approx(turned, abs=1e-13)


def test_time_reversed_and_in_other_units() -> None:
    times = np.linspace(-30, 30, 61)
    Q = exact.free_attitude(P1, B, times)
    # Its half turns are counted from another one, which shifts the rounding of some 30 radians.
    assert exact.free_attitude(P1, -B, -times) == pytest.approx(Q, abs=4e-15)
    for size in (2.0**-500, 2.0**500):
        assert exact.free_attitude(P1, B * size, times / size) == pytest.approx(Q, abs=0)
    assert exact.free_attitude(P1, np.zeros(3), times) == pytest.approx(
        np.tile(ONE, (61, 1)), abs=0
    )
