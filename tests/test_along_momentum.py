"""Torques along G: size and clock against the integrals that define them, and whole motions against
those of the literature's numbers."""

import itertools
from typing import Any

import mpmath
import numpy as np
import pytest

from hodo_cli.models.theory import exact

A = np.array([1.0, 0.8, 0.6])


def elapsed(rates: tuple[float, ...], g: Any) -> tuple[Any, Any]:
    """t and s at which the size has fallen from 1 to g, by quadrature: the time as a function of
    the size, not the size as one of the time."""
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
    """For rates of every ratio, where a formula might cancel, at times up to the stop or where the
    size has fallen far."""
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
            assert [float(x) for x in law.clock(t)] == pytest.approx(
                [float(x) for x in of(t)], rel=1e-13
            )


def test_long_doubles() -> None:
    long = exact.AlongMomentum(0.004, 0.01)
    with mpmath.workdps(30):
        damping, brake = mpmath.mpf(0.004), mpmath.mpf(0.01)
        free = mpmath.odefun(lambda t, y: [-(brake + damping * y[0]), y[0]], 0, [1, 0])
        assert abs(digits(long.clock(np.longdouble(60))[1]) - free(60)[1]) < 1e-17 * free(60)[1]


def digits(x: Any) -> Any:
    """A long double as a number of mpmath."""
    x = np.longdouble(x)
    high = float(x)
    return mpmath.mpf(high) + mpmath.mpf(float(x - np.longdouble(high)))
