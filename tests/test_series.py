"""The reference itself: against closed forms, conservation laws and the table of events."""

import csv
import math
import random
from fractions import Fraction
from pathlib import Path

import mpmath
import pytest
import series

TABLE = list(csv.DictReader((Path(__file__).parent / "data" / "crossings.csv").open()))
INERTIA = (1.0, 0.8, 0.6)


def close(value, expected, digits):
    """Two vectors, relative to the larger of them, in arithmetic that does not round."""

    def number(x):
        return mpmath.mpf(x.numerator) / x.denominator if isinstance(x, Fraction) else x

    with mpmath.workdps(60):
        value, expected = (mpmath.matrix([*map(number, x)]) for x in (value, expected))
        return mpmath.norm(value - expected) <= mpmath.mpf(10) ** -digits * mpmath.norm(expected)


@pytest.mark.parametrize(("p0", "r0"), [(0.9, 0.43), (0.5, 1.44), (0.79, 1.02)])
def test_free_motion_is_jacobi_elliptic(p0, r0):
    """Landau and Lifshitz, Mechanics, section 37; for q(0) = 0, so that the phase is none."""
    (state,) = series.states(series.diagonal(INERTIA, (0, 0, 0)), (p0, 0, r0), [20])
    with mpmath.workdps(60):
        A1, A2, A3, p0, r0 = map(mpmath.mpf, (*INERTIA, p0, r0))
        X, Y = A1 * (A1 - A3) * p0**2, A3 * (A1 - A3) * r0**2
        x, y, scale = (A1 - A2) * X, (A2 - A3) * Y, A1 * A2 * A3
        if x < y:
            n2, m, q2, names = y / scale, x / y, X / (A2 * (A2 - A3)), "csd"
        else:
            n2, m, q2, names = x / scale, y / x, Y / (A2 * (A1 - A2)), "dsc"
        P, Q, R = (mpmath.ellipfun(f"{name}n", mpmath.sqrt(n2) * 20, m=m) for name in names)
        assert close(state, [p0 * P, -mpmath.sqrt(q2) * Q, r0 * R], 40)


def test_equal_damping_is_free_motion_in_stretched_time():
    lam, start = 0.01, (0.5, 0.25, 1.4)
    (damped,) = series.states(series.diagonal(INERTIA, (lam, lam, lam)), start, [100])
    with mpmath.workdps(60):
        stretched = -mpmath.expm1(-mpmath.mpf(lam) * 100) / lam
        shrink = mpmath.exp(-mpmath.mpf(lam) * 100)
        time, size = (Fraction(int(mpmath.ldexp(x, 190)), 1 << 190) for x in (stretched, shrink))
        (free,) = series.states(series.diagonal(INERTIA, (0, 0, 0)), start, [time])
        assert close([w * size for w in free], damped, 40)


def test_tensor_without_gyroscopic_terms_is_a_matrix_exponential():
    resistance, start = [[0.3, 0.01, -0.2], [0.05, 0.1, 0.07], [0.4, -0.03, 0.2]], (0.5, 0.25, 1.4)
    (state,) = series.states(series.tensor((2, 2, 2), resistance), start, [3])
    with mpmath.workdps(60):
        propagator = mpmath.expm(mpmath.matrix(resistance) * mpmath.mpf(-3) / 2)
        assert close(state, propagator * mpmath.matrix(start), 40)


def test_torque_of_the_cavity_follows_from_free_motion():
    """kappa (w'' + w x w') with w' of Euler's free motion, in exact fractions."""
    draw = random.Random(1)
    A, w = ([Fraction(draw.randint(1, 99), 10) for _ in range(3)] for _ in range(2))

    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]

    def gyroscopic(w, v):
        G = [a * x for a, x in zip(A, w, strict=True)]
        return [x / a for x, a in zip(cross(G, v), A, strict=True)]

    first = gyroscopic(w, w)
    second = [x + y for x, y in zip(gyroscopic(first, w), gyroscopic(w, first), strict=True)]
    kappa, torque = Fraction(3, 7), [Fraction(k) for k in (2, -3, 5)]
    expected = [
        x + (kappa * (y + z) + M) / a
        for x, y, z, M, a in zip(first, second, cross(w, first), torque, A, strict=True)
    ]
    rows = series.cavity(A, kappa, torque)
    found = [sum(k * math.prod(w[i] for i in m) for m, k in row.items()) for row in rows]
    assert found == expected


def test_the_symmetric_case_closes_in_x_and_r():
    A, C, kappa = 8.0, 4.0, 0.6048
    full = series.cavity((A, A, C), kappa, (0, 0, -0.01))
    ((p, q, r),) = series.states(full, (0.6, 0.8, 1), [40])
    x0 = Fraction(0.6) ** 2 + Fraction(0.8) ** 2
    mean = series.cavity_averaged(A, C, kappa, -0.01, printed=False)
    (averaged,) = series.states(mean, (x0, 1), [40])
    assert close([p * p + q * q, r], averaged, 40)


def full_start(theta, r):
    return 0, 0, r, 0, math.sin(theta), math.cos(theta), 0


def integrals(A, C, mu, state):
    """(Gz, H, r) of P3 eq (1.2)."""
    p, q, r, g1, g2, g3, _ = state
    A, C, mu = map(Fraction, (A, C, mu))
    return A * (p * g1 + q * g2) + C * r * g3, (A * (p * p + q * q) + C * r * r) / 2 + mu * g3, r


def test_top_without_damping_keeps_its_integrals():
    start = full_start(1.0, 1.7)
    (state,) = series.states(series.lagrange(1.5, 1, 0.5, 0.25, [], []), start, [5])
    assert close(integrals(1.5, 1, 0.5, state), integrals(1.5, 1, 0.5, map(Fraction, start)), 40)
    assert close([sum(g * g for g in state[3:6])], [sum(Fraction(g) ** 2 for g in start[3:6])], 40)
    assert abs(state[5] - Fraction(start[5])) > 0.1


def test_top_averages_to_first_order():
    """The full system with angles gone meets (3.2) with elliptic integrals."""
    motion, (Gz, H, r) = series.paper3("case2")
    times = [k / 4 for k in range(1, 13)]
    slow = motion.states((Gz, H, r), times, digits=10)
    errors = []
    for eps in (0.02, 0.005):
        system = series.lagrange(1.5, 1, 0.5, eps, motion.a, motion.b)
        fast = series.states(system, full_start(math.radians(60), r), times, bits=96)
        energies = [integrals(1.5, 1, 0.5, state)[1] for state in fast]
        means = [Fraction(float(mean[1])) for mean in slow]
        errors.append(max(abs(H - mean) for H, mean in zip(energies, means, strict=True)))
    assert errors[0] < 4.4e-3
    assert 3 < errors[0] / errors[1] < 5


def test_mean_cosine_is_the_mean_over_a_period():
    motion, _ = series.paper3("case2")
    with mpmath.workdps(20):
        Gz, H, r = mpmath.mpf("0.7"), mpmath.mpf("1.1"), mpmath.mpf("1.3")
        u1, u2, u3 = motion.roots(Gz, H, r)
        assert -1 <= u1 < u2 <= 1 <= u3
        for u in (u1, u2, u3):
            kinetic = (2 * H - r**2 - u) * (1 - u**2) * mpmath.mpf(1.5)
            assert abs(kinetic - (Gz - r * u) ** 2) < 1e-17

        def angle(f):  # u = u1 + (u2 - u1) sin^2 x, dt = dx / sqrt(u3 - u)
            return mpmath.quad(lambda x: f(u1 + (u2 - u1) * mpmath.sin(x) ** 2), [0, mpmath.pi / 2])

        mean = angle(lambda u: u / mpmath.sqrt(u3 - u)) / angle(lambda u: 1 / mpmath.sqrt(u3 - u))
        assert abs(mean - motion.mean_cosine(Gz, H, r)) < 1e-17


def test_zeros_that_nearly_meet_are_all_found():
    """cos t = 1 - 1e-18 has pairs of roots 2.8e-9 apart, far inside one step."""
    level = 1 - Fraction(1, 10**18)
    rotation = ({(1,): Fraction(-1)}, {(0,): Fraction(1)}, {})
    found = list(series.zeros(series.taylor(rotation, (1, 0, 1), 20), (1, 0, -level)))
    with mpmath.workdps(60):
        half = mpmath.acos(mpmath.mpf(level.numerator) / level.denominator)
        expected = [2 * mpmath.pi * k + side * half for k in range(4) for side in (-1, 1)][1:]
        assert len(found) == 7
        assert close([zero.time for zero in found], expected, 30)
    assert [zero.sign for zero in found] == [-1, 1, -1, 1, -1, 1, -1]


def test_start_on_the_separatrix_is_no_crossing():
    A, start = (9, 8, 4), (4, 1, 3)  # D = 9 * 1 * 16 - 4 * 4 * 9 = 0
    assert series.crossings(A, series.diagonal(A, (0.02, 0.01, 0.005)), start, 100) == []
    (crossing,) = series.crossings(A, series.diagonal(A, (0.02, 0.01, 0.005)), (4.01, 1, 3), 100)
    assert (crossing.before, crossing.after) == (1, 3)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 1, 0)])
def test_crossings_name_the_axes_as_given(order):
    A, system, start, end = series.paper1("fig4")
    lam = series.PAPER1["fig4"][0]
    (expected,) = series.crossings(A, system, start, end)
    A, lam, start = ([values[i] for i in order] for values in (A, lam, start))
    if order == (2, 1, 0):  # an odd permutation turns a pseudovector round
        start = [-w for w in start]
    (crossing,) = series.crossings(A, series.diagonal(A, lam), start, end)
    assert close([crossing.time], [expected.time], 40)
    assert (order[crossing.before - 1], order[crossing.after - 1]) == (0, 2)


def test_forms_lost_in_rounding_are_refused():
    decay = INERTIA, series.diagonal(INERTIA, (1, 1, 1)), (0.8, 0.5, 0.74), 150
    with pytest.raises(ArithmeticError, match="more bits"):
        series.crossings(*decay)
    assert series.crossings(*decay, bits=384) == []


@pytest.mark.parametrize("name", [*series.PAPER1][::3])
def test_table_of_crossings(name):
    """At two thirds of the precision that made the table."""
    rows = [row for row in TABLE if row["case"] == f"P1 {name}"]
    found = series.crossings(*series.paper1(name), bits=128)
    assert [
        (f"x{c.before} to x{c.after}", series.digits(c.time), series.digits(c.momentum)[:20])
        for c in found
    ] == [(row["event"], row["time"], row["value"][:20]) for row in rows]


@pytest.mark.parametrize(
    "row", [row for row in TABLE if row["event"] == "end of spin"], ids=lambda row: row["case"]
)
def test_table_of_ends_of_spin(row):
    _, name, form = row["case"].split()
    zero = series.end_of_spin(name, printed=form == "averaged-as-printed", bits=128)
    assert (series.digits(zero.time), series.digits(zero.state[0])) == (row["time"], row["value"])


def test_table_of_rebounds():
    (row,) = (row for row in TABLE if row["case"] == "P3 case2")
    motion, start = series.paper3("case2")
    time = motion.when(start, 1.75, lambda Gz, H, r: Gz - r, digits=16)
    assert abs(time - mpmath.mpf(row["time"])) < 1e-15
