"""Torques along G: size and clock against the integrals that define them, and whole motions against
those of the literature's numbers."""

import itertools
from typing import Any

import mpmath
import numpy as np
import pytest

from hodo_cli.models.theory.along_momentum import AlongMomentum, clock_of_law
from hodo_cli.models.theory.closed_form import free_motion

A = np.array([1.0, 0.8, 0.6])
B, C = np.array([0.8, 0.5, 0.74]), np.array([0.5, 0.25, 1.4])
G_B, G_C = 0.99856697321711977397, 0.9956**0.5


def elapsed(rates: tuple[float, ...], g: Any) -> tuple[Any, Any]:
    """t and s at which the size has fallen from 1 to g, by quadrature: the time as a function of
    the size, not the size as one of the time."""
    damping, brake, drag = map(mpmath.mpf, rates)
    last = mpmath.log(g) if g else mpmath.mpf(-120)
    steps = [-4 * i for i in range(int(-last / 4) + 1)] + [last]

    def integral(power: int) -> Any:
        def of(u: Any) -> Any:
            x = mpmath.exp(u)
            return x ** (1 + power) / (brake + damping * x + drag * x * x)

        return -mpmath.quad(of, steps)

    return integral(0), integral(1)


SIZES = (0.0, 1e-9, 0.02, 3.0)


@pytest.mark.parametrize("rates", [r for r in itertools.product(SIZES, repeat=3) if any(r)])
def test_size_and_clock_are_the_integrals(rates: tuple[float, ...]) -> None:
    """For rates of every ratio, where a formula might cancel, at times up to the stop or where the
    size has fallen far."""
    law = AlongMomentum.of(1.0, *rates)
    end = float(law.stop) if np.isfinite(law.stop) else 8 / max(rates)
    with mpmath.workdps(22):
        for t in end * np.array([1e-6, 0.3, 0.99]):
            g, s = law.clock(t)
            exact_t, exact_s = elapsed(rates, mpmath.mpf(float(g)))
            # How far t moves when g does by its rounding: near the start g says little of t.
            slope = float(rates[1] / g + rates[0] + rates[2] * g)
            assert abs(float(exact_t - t)) <= 2e-15 * t + 4e-16 / slope, t
            # Of s the same, from the t that g belongs to.
            assert abs(float(exact_s - s)) <= 4e-15 * s + float(g) * abs(float(exact_t - t)), t
        if np.isfinite(law.stop):
            exact_t, exact_s = elapsed(rates, 0)
            stopped = law.clock([law.stop, 2 * law.stop])
            assert float(law.stop) == pytest.approx(float(exact_t), rel=4e-16 * 4)
            assert stopped.g.tolist() == [0, 0]
            assert stopped.s == pytest.approx([float(exact_s)] * 2, rel=4e-15)


@pytest.mark.parametrize(
    ("rates", "stops"),
    [
        ((-0.1, 0.2, 0.0), True),
        ((-0.3, 0.2, 0.0), False),
        ((-0.3, 0.2, 0.2), True),
        ((-0.3, 0.2, 0.15), True),
        ((-0.5, 0.05, 0.6), False),
    ],
)
def test_negative_damping_may_keep_a_body_from_rest(rates: tuple[float, ...], stops: bool) -> None:
    law = AlongMomentum.of(1.0, *rates)
    assert np.isfinite(law.stop) == stops
    end = float(law.stop) if stops else 20.0
    with mpmath.workdps(30):
        damping, brake, drag = map(mpmath.mpf, rates)
        of = mpmath.odefun(
            lambda t, y: [-(brake + damping * y[0] + drag * y[0] ** 2), y[0]], 0, [1, 0]
        )
        for t in end * np.array([0.1, 0.5, 0.9]):
            assert [float(x) for x in law.clock(t)] == pytest.approx(
                [float(x) for x in of(t)], rel=1e-13
            )


def test_columns_and_long_doubles() -> None:
    momentum, brake = np.array([1.0, 2.0, 3.0]), np.array([0.01, 0.0, 0.02])
    law = AlongMomentum.of(momentum, 0.004, brake)
    stops = [
        float(AlongMomentum.of(G, 0.004, b).stop) for G, b in zip(momentum, brake, strict=True)
    ]
    assert law.stop.tolist() == stops
    long = AlongMomentum.of(np.longdouble(1), np.longdouble(0.004), np.longdouble(0.01))
    with mpmath.workdps(30):
        damping, brake = mpmath.mpf(0.004), mpmath.mpf(0.01)
        exact = mpmath.log(1 + damping / brake) / damping
        assert abs(digits(long.stop) - exact) < 1e-18 * exact
        free = mpmath.odefun(lambda t, y: [-(brake + damping * y[0]), y[0]], 0, [1, 0])
        assert abs(digits(long.clock(np.longdouble(60)).s) - free(60)[1]) < 1e-17 * free(60)[1]


def digits(x: Any) -> Any:
    """A long double as a number of mpmath."""
    x = np.longdouble(x)
    high = float(x)
    return mpmath.mpf(high) + mpmath.mpf(float(x - np.longdouble(high)))


TABLE = {
    "brake": (B, (0, 0.01, 0), 60, [0.25529394140312088, 0.36302827209964620, 0.16103259471969840]),
    "brake and damping": (
        B, (0.004, 0.01, 0), 60, [0.18526945894296346, 0.17909106057615755, -0.15534488424796164],
    ),
    "drag": (
        B, (0, 0, 0.01), 60, [0.49262375296093774, -0.34166966632732990, 0.44887090573771592],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLE)
def test_a_motion_is_the_free_one_at_another_clock(name: str) -> None:
    """Against Taylor series of order 30 and more in 176 bits and more."""
    start, (damping, brake, drag), t, omega = TABLE[name]
    momentum = np.hypot.reduce(A * start)
    clock = AlongMomentum.of(momentum, damping, brake, drag).clock(t)
    assert clock.g * free_motion(A, start, np.array([clock.s]))[0] == pytest.approx(
        omega, abs=5e-15
    )


def test_stops_and_directions_at_them() -> None:
    stop = {
        (0, 0.01, 0): 99.856697321711977,
        (0.004, 0.01, 0): 84.015679138909045,
        (0.004, 0.01, 0.01): 69.824108762608943,
        (0.01, 0.001, 0.005): 215.11482601394639,
    }
    for rates, time in stop.items():
        assert AlongMomentum.of(G_B, *rates).stop == pytest.approx(time, rel=1e-15)
    for rates, s in (((0, 0.01), 49.928348660855989), ((0.004, 0.01), 39.659378408459034)):
        law = AlongMomentum.of(G_B, *rates)
        assert law.clock(law.stop).s == pytest.approx(s, rel=1e-15)
    law = AlongMomentum.of(G_B, brake=0.01)
    G = A * free_motion(A, B, np.array([law.clock(law.stop).s]))[0]
    direction = [0.576436209452822, -0.809786879333248, 0.109391528426027]
    assert G / np.hypot.reduce(G) == pytest.approx(direction, abs=1e-14)
    # Unequal damping is bounded by its largest and its smallest rate.
    bounds = [float(AlongMomentum.of(G_B, rate, 0.002).stop) for rate in (0.005, 0.003)]
    assert bounds == pytest.approx([250.348, 305.144], abs=5e-4)
    assert bounds[0] < 267.05497187079620 < bounds[1]


def test_fluid_leaves_the_size_alone() -> None:
    law = AlongMomentum.of(G_C, brake=0.002)
    assert law.clock(100.0).g * G_C == pytest.approx(0.79779757466131375639, rel=4e-16)


# kappa t* of the fluid alone, from C.
EXPOSURE = 1.3345455074194301344


@pytest.mark.parametrize(
    ("kappa", "damping", "brake", "time"),
    [
        (0.01, 0.002, 0, 190.794899636922105),
        (0.01, 0.001, 0, 155.242787947150792),
        (0.01, 0, 0.002, 208.359185063327034),
        (0.001, 0.0002, 0, 1907.94899636922105),
        (0.01, 0.006, 0, np.inf),
        (0.01, 0, 0.006, np.inf),
        (0.01, 0, 0, 133.45455074194301),
    ],
)
def test_the_fluid_crosses_when_its_exposure_is_reached(
    kappa: float, damping: float, brake: float, time: float
) -> None:
    law = AlongMomentum.of(G_C, damping, brake)
    found = law.time_of_exposure(EXPOSURE / kappa)
    assert found == pytest.approx(time, rel=2e-15)
    if np.isfinite(found):
        with mpmath.workdps(20):
            exposure = mpmath.quad(lambda t: float(law.clock(float(t)).g) ** 2, [0, time])
        assert float(exposure) == pytest.approx(EXPOSURE / kappa, rel=1e-12)


def test_the_exposure_of_a_drag_and_of_two_rates() -> None:
    law = AlongMomentum.of(1.0, drag=0.5)
    assert law.time_of_exposure([0.5, 1.0, 2.0]).tolist() == [pytest.approx(2 / 3), 2.0, np.inf]
    with pytest.raises(ValueError, match="alone"):
        AlongMomentum.of(1.0, 0.1, 0.1).time_of_exposure(1.0)


@pytest.mark.parametrize("dtype", [np.float64, np.longdouble])
def test_a_law_of_time(dtype: type) -> None:
    """lambda = .005/(1 + .01 t)^2, whose s is an exponential integral, and a law that rises."""
    times = np.array([0.0, 1e-3, 50.0, 100.0, 1e4], dtype=dtype)
    rate, bend = dtype(0.005), dtype(0.01)
    clock = clock_of_law(times, lambda t: -rate / bend / (1 + bend * t))
    with mpmath.workdps(30):
        r, b = mpmath.mpf(float(rate)), mpmath.mpf(float(bend))
        g = [mpmath.exp(r / b / (1 + b * float(t)) - r / b) for t in times]
        s = [
            mpmath.quad(
                lambda t: mpmath.exp(r / b / (1 + b * t) - r / b), [0, float(t) / 8, float(t)]
            )
            for t in times
        ]
        assert max(abs(x - float(y)) for x, y in zip(s, clock.s, strict=True)) < 1e-11
    assert clock.g == pytest.approx([float(x) for x in g], rel=1e-15)
    assert clock.s[3] == pytest.approx(dtype("85.988527753746307"), rel=2e-16)
    omega = clock.g[3] * free_motion(A, B, clock.s[3:4].astype(float))[0]
    assert omega.astype(float) == pytest.approx(
        [0.50412305006140321, 0.69766151997966874, 0.32975278857125048], abs=1e-14
    )
    # exp(-t^2/2) from another start than 0.
    late = clock_of_law(np.array([3.0, 2.0]), lambda t: t * t / 2, start=1.0)
    of = [mpmath.quad(lambda t: mpmath.exp((1 - t * t) / 2), [1, end]) for end in (3, 2)]
    assert late.s == pytest.approx([float(x) for x in of], rel=1e-14)
