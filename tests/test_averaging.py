"""The averages over a turn: closed forms against elliptic integrals, quadrature and each other; the
passage through D = 0."""

import math
from collections.abc import Sequence

import mpmath
import numpy as np
import pytest
from test_averaged import case, fluid_torque, scaled

from hodo_cli.integration import integrate
from hodo_cli.models.averaging import any_torque, crossing_times, free_turn, sums
from hodo_cli.models.base import attributes

Triple = tuple[float, float, float]

BODY = free_turn.Body.of((1.0, 0.8, 0.6))
FIG4, LAM4 = (0.8, 0.5, 0.74), (0.005, 0.004, 0.003)
FIG12, LAM12 = (0.5, 0.25, 1.40435829552939), (0.005, 0.00625, 0.025 / 3)


def linear_part(lam: Sequence[float], slow: free_turn.SlowVariables) -> np.ndarray:
    """The periodic parts of X_e and X_o under linear resistance."""
    form = case(damping=lam).system
    return form.part(0.0, slow, attributes(form.constants))


@pytest.mark.parametrize(
    ("m", "K", "Dn", "C"),
    [
        (0.25, 1.685750354812596, 0.87050980303816346, 0.48203921215265385),
        (0.5, 1.8540746773013719, 0.72847329052223181, 0.45694658104446363),
        (0.99, 3.6956373629898747, 0.2749170021928928, 0.26759293150797252),
    ],
)
def test_means_are_those_of_the_elliptic_integrals(m: float, K: float, Dn: float, C: float) -> None:
    mean = free_turn.turn_means(m, 1 - m)
    assert [math.pi / 2 / mean.dn, mean.dd, mean.cc] == pytest.approx([K, Dn, C], rel=3e-16 * 4)


@pytest.mark.parametrize(
    ("m1", "K", "Dn", "C"),
    [
        (1e-10, 12.8992198263876, 0.077524068438176929, 0.077524068345929336),
        (1e-100, 116.51554901082217, 0.0085825454927661045, 0.0085825454927661045),
    ],
)
def test_means_near_the_separatrix(m1: float, K: float, Dn: float, C: float) -> None:
    mean = free_turn.turn_means(1 - m1, m1, 12)
    assert [math.pi / 2 / mean.dn, mean.dd, mean.cc] == pytest.approx([K, Dn, C], rel=2e-14)


def test_the_fourth_mean_at_small_and_large_modulus() -> None:
    with mpmath.workdps(40):
        for m in (1e-12, 1e-3, 0.5, 0.999):
            M = mpmath.mpf(m)
            K, X_e = mpmath.ellipk(M), mpmath.ellipe(M)
            assert free_turn.turn_means(m, 1 - m).ssss == pytest.approx(
                float(((2 + M) * K - 2 * (1 + M) * X_e) / (3 * M * M * K)), rel=1e-15
            )


def test_shape_rates() -> None:
    mean = free_turn.turn_means(0.5, 0.5)
    both = [side * crossing_times.shape_rate(LAM4[::side], mean) for side in (1, -1)]
    assert both == pytest.approx([-0.0023708397431333909] * 2, rel=4e-16, abs=0)
    other = [
        side * crossing_times.shape_rate((0.005, 0.006, 0.003)[::side], mean) for side in (1, -1)
    ]
    assert other == pytest.approx(
        [-0.0012847329052223181, -0.0034569465810444636], rel=4e-16, abs=0
    )


def test_slow_variables_and_their_periodic_part() -> None:
    slow = free_turn.slow_elements(BODY, FIG4)
    assert [slow.X_e, slow.X_o, free_turn.shape_distance(slow.m1), 1 - slow.m1] == pytest.approx(
        [0.296, 0.171424, 0.54621943462551054, 0.57913513513513514], rel=1e-15
    )
    closed = linear_part(LAM4, slow)
    assert closed == pytest.approx(np.array((0.00080351012296, -0.00138743114381)), rel=1e-11)
    series = any_torque.periodic_part(
        BODY, lambda omega: -np.array(LAM4) * np.array(BODY[:3]) * omega, slow, any_torque.NODES
    )
    for whole, value, part in zip(series, slow[:2], closed, strict=True):
        assert whole / value == pytest.approx(part, rel=1e-12)
    assert free_turn.shape_distance(free_turn.slow_elements(BODY, FIG12).m1) == pytest.approx(
        1.4802261809540898, rel=1e-15
    )


@pytest.mark.parametrize(
    "inertia", [(1, 0.8, 0.6), (0.6, 0.8, 1), (0.8, 0.6, 1), (1, 0.8, 0.8), (1, 1, 0.6)]
)
@pytest.mark.parametrize(
    "omega", [(0.8, 0.5, 0.74), (-0.8, 0.5, 0.74), (0.5, -0.25, -1.4), (-0.5, 0.25, -1.4)]
)
def test_a_motion_is_what_its_slow_variables_and_phase_say(inertia: Triple, omega: Triple) -> None:
    body = free_turn.Body.of(inertia)
    slow = free_turn.slow_elements(body, omega)
    back = [
        body.unsort(free_turn.free_motion_by_phase(body, slow, slow.phase + step))
        for step in (0, -1e-6, 1e-6)
    ]
    assert back[0] == pytest.approx(omega, rel=1e-14)
    turning = (
        free_turn.turn_frequency(body, slow.X_e, slow.side)
        * free_turn.turn_means(1 - slow.m1, slow.m1).dn
    )
    (A1, A2, A3), (p, q, r) = inertia, omega
    euler = [(A2 - A3) / A1 * q * r, (A3 - A1) / A2 * p * r, (A1 - A2) / A3 * p * q]
    assert (back[2] - back[1]) / 2e-6 * turning == pytest.approx(euler, rel=1e-7, abs=1e-9)


def state_of_energy(J: float) -> free_turn.SlowVariables:
    X, Y = 1 - 0.6 / J, 1 / J - 1
    side = 1 if J > 0.8 else -1
    X_e, X_o = (X, Y) if side > 0 else (Y, X)
    return free_turn.SlowVariables(X_e, X_o, side, 1 - X_o / X_e, 1, 0.0)


@pytest.mark.parametrize(
    ("J", "loss"),
    [
        (0.95, 0.0790546280810736),
        (0.9, 0.137141345380964),
        (0.85, 0.161302952348168),
        (0.75, 0.186567900933926),
        (0.7, 0.196924836774467),
        (0.65, 0.143738414715558),
    ],
)
def test_the_fluid_takes_the_energy_that_it_should(J: float, loss: float) -> None:
    slow = state_of_energy(J)
    m = 1 - slow.m1
    cd, *others = sums.fluid_weights(BODY)
    weights = cd, *others[:: slow.side]
    closed = slow.X_e * slow.X_o * sums.fluid_loss(weights, m, free_turn.turn_means(m, slow.m1))
    assert closed == pytest.approx(loss, rel=1e-14)
    rates = any_torque.rates_over_turn(
        BODY,
        lambda w: fluid_torque(BODY[:3], w),
        slow,
        any_torque.nodes_for(slow.m1),
    )
    dX, dY = rates.mean(-1)[:: slow.side]
    assert [dX, dY] == pytest.approx([0.6 * loss, -loss], rel=1e-13)


def test_mean_velocity() -> None:
    slow = free_turn.SlowVariables(0.4, 0.4, 1, 0.5, 1, 0.0)
    turn = free_turn.free_motion_by_phase(BODY, slow, 2 * np.pi * np.arange(64) / 64)
    assert turn.mean(0) / math.sqrt(0.4 / 0.4) == pytest.approx(
        [0.84721308479397909, 0, 0], abs=1e-15
    )


@pytest.mark.parametrize(
    ("lam", "side", "m"),
    [
        ((2, 0, 3), 1, 0.602349061340403),
        ((3, 0, 4), 1, 0.767070424888046),
        ((3, 0, 5), 1, 0.417374963891806),
        ((3, 0, 2), -1, 0.602349061340403),
    ],
)
def test_the_shape_that_keeps_itself(lam: Triple, side: int, m: float) -> None:
    found = crossing_times.steady_shape(lam)
    assert found is not None
    assert found[0] == side
    assert found[1] == pytest.approx(m, abs=3e-15)
    assert crossing_times.steady_shape(LAM4) is None


TABLE = {
    0.9: (0.1523217102, 0.1588280022, 0.1660952919, 0.1742843809),
    0.5: (0.6471550180, 0.7350918255, 0.8589502206, 1.0511580031),
    0.1: (1.5770553469, 1.9295156740, 2.5312385076, 3.8623519733),
    0.01: (2.7516599491, 3.4877741716, 4.8454807357, 8.3593416385),
}


@pytest.mark.parametrize("m", TABLE)
def test_crossing_times_of_the_table(m: float) -> None:
    times = [
        float(crossing_times.crossing_time((1.0, rho, 0.0), 1, -math.log(m)))
        for rho in (0, 0.5, 1, 1.5)
    ]
    assert times == pytest.approx(TABLE[m], abs=6e-11)


@pytest.mark.parametrize(
    ("lam", "omega", "time"),
    [
        (LAM4, FIG4, 304.02105312940017),
        ((0.005, 0.004, 0.002), FIG4, 211.43974886762471),
        ((0.004, 0.004, 0.002), FIG4, 348.19859997256144),
        ((0.009, 0.004, 0.007), FIG4, 209.22504589909075),
        (LAM12, FIG12, 385.074603248319),
    ],
)
def test_crossing_times_of_the_paper(lam: Triple, omega: Triple, time: float) -> None:
    slow = free_turn.slow_elements(BODY, omega)
    assert float(
        crossing_times.crossing_time(lam, slow.side, free_turn.shape_distance(slow.m1))
    ) == pytest.approx(time, rel=2e-15)


def test_no_crossing_against_the_theorem_or_beyond_the_threshold() -> None:
    u = free_turn.shape_distance(free_turn.slow_elements(BODY, FIG4).m1)
    assert crossing_times.crossing_time((0.003, 0.004, 0.005), 1, u) == math.inf
    assert crossing_times.crossing_time((0.005, 0.004, 0.005), 1, u) == math.inf
    threshold = crossing_times.steady_shape((0.004, 0.006, 0.003))
    edge = -math.log(threshold[1])
    assert np.isfinite(
        crossing_times.crossing_time((0.004, 0.006, 0.003), 1, edge * np.array([0.99, 1.01]))
    ).tolist() == [True, False]


@pytest.mark.parametrize(
    ("factor", "mean", "predicted", "place", "sense"),
    [
        (1, 303.047880, 305.782994, 0.39102, -1),
        (0.5, 607.069006, 606.492377, 0.45054, 1),
        (0.1, 3039.237489, 3007.868907, 0.92653, 1),
        (0.01, 30401.132283, 30422.633409, 0.28124, 1),
        (1e-3, 304020.080102, 303975.478327, 0.82835, -1),
        (1e-4, 3040209.558270, 3040239.169132, 0.29948, -1),
    ],
)
def test_the_predictions_for_the_family_of_figure_4(
    factor: float, mean: float, predicted: float, place: float, sense: int
) -> None:
    (passage,) = integrate(scaled(factor, LAM4, 400)).events
    details = passage.details
    assert (passage.time, details["predicted"], details["place"]) == pytest.approx(
        (mean, predicted, place), rel=2e-11, abs=5e-6
    )
    assert details["sense"] == sense


def test_a_sense_is_undetermined_where_s_is_near_a_whole_number() -> None:
    (passage,) = integrate(scaled(1, (0.009, 0.004, 0.007), 400)).events
    assert passage.details["place"] == pytest.approx(0.987, abs=5e-4)
    assert passage.details["sense"] == 0


@pytest.mark.parametrize(
    ("lam", "at300", "at1000"),
    [
        ((5, 4, 3), 0.1715, 0.3766),
        ((5, 4, 2), 0.2304, 0.4048),
        ((4, 4, 2), 0.1538, 0.3411),
        ((9, 4, 7), 0.2521, 0.4177),
        ((3, 4, 5), 0.1872, 0.4938),
        ((5, 6, 3), 0.1375, 0.2930),
        ((4, 6, 3), 0.0637, 0.1240),
    ],
)
def test_shares_of_starts_that_cross(lam: Triple, at300: float, at1000: float) -> None:
    rates = [x / 1000 for x in lam]
    assert crossing_times.share_that_crosses(
        BODY, rates, np.array([300.0, 1000.0])
    ) == pytest.approx([at300, at1000], abs=5e-5)


def test_share_about_the_axis_of_largest_inertia() -> None:
    a, b, c = BODY[:3]
    assert crossing_times.share_beyond(BODY, 1, 0.0) == pytest.approx(
        2 / math.pi * math.atan(math.sqrt(c * (a - b) / (a * (b - c)))), abs=1e-14
    )
    assert crossing_times.share_beyond(BODY, 1, 0.0) + crossing_times.share_beyond(
        BODY, -1, 0.0
    ) == pytest.approx(1, abs=1e-14)
    assert crossing_times.share_that_crosses(BODY, LAM4, np.array([1e9])) == pytest.approx(
        0.419569, abs=1e-6
    )
