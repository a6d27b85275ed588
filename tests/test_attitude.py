"""The attitude of a free body in closed form against Taylor series in big integers of the
kinematics of quaternions, which share no line with it."""

import itertools
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
import series

from hodo_cli.models.theory import exact

A = np.array([1.0, 0.8, 0.6])
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
    system = kinematics(A.tolist(), lam)
    return np.array(
        series.states(system, [*omega.tolist(), 1, 0, 0, 0], times, bits=128), dtype=float
    )[:, 3:]


def test_times_in_long_double_give_its_digits() -> None:
    """Twenty times nearer than doubles come."""
    times = [7.0, 29.0, 60.0]
    found = exact.free_attitude(A, B, np.array(times, dtype=np.longdouble))
    states = series.states(kinematics(A.tolist()), [*B.tolist(), *ONE.tolist()], times, bits=160)
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
        moments, omega = A[list(order)], (start * signs * draw.uniform(0.9, 1.1, 3))[list(order)]
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
    """The branch after k turns is (-1)^k (cos(k psi/2), sin(k psi/2) G/|G|), and psi is an angle
    modulo 2 pi alone, in all six orders. Both were integrated by Taylor series in 176 bits."""
    turns = (B, 21.955631800395534, 30.430603579027798), (C, 14.971259829455285, 17.083449770015107)
    for order, (start, period, psi) in itertools.product(itertools.permutations(range(3)), turns):
        moments, omega = A[list(order)], start[list(order)]
        k = np.arange(1, 5)
        G = moments * omega / np.linalg.norm(moments * omega)
        half = k[:, None] * psi / 2
        turned = (-1.0) ** k[:, None] * np.concatenate([np.cos(half), np.sin(half) * G], axis=1)
        assert exact.free_attitude(moments, omega, k * period) == pytest.approx(turned, abs=1e-13)


def test_time_reversed_and_in_other_units() -> None:
    times = np.linspace(-30, 30, 61)
    Q = exact.free_attitude(A, B, times)
    # Its half turns are counted from another one, which shifts the rounding of some 30 radians.
    assert exact.free_attitude(A, -B, -times) == pytest.approx(Q, abs=4e-15)
    for size in (2.0**-500, 2.0**500):
        assert exact.free_attitude(A, B * size, times / size) == pytest.approx(Q, abs=0)
    assert exact.free_attitude(A, np.zeros(3), times) == pytest.approx(np.tile(ONE, (61, 1)), abs=0)
