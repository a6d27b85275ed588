"""The averaged forms of the body-frame models as users run them: against the full equations, in
order of the small parameter; through the separatrix; where they do not apply."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import call, few_without_heyoka
from scipy.special import ellipk

import hodo_cli
from hodo_cli import Case, HodoError
from hodo_cli.cases.case import Time
from hodo_cli.cases.config import parse
from hodo_cli.engines import have_taylor
from hodo_cli.integration import Trajectory, integrate, solve
from hodo_cli.models.averaging import any_torque, crossing_times, free_turn, passage
from hodo_cli.models.averaging.free_turn import either
from hodo_cli.models.base import attributes

pytestmark = pytest.mark.engines

FIG4 = {"p": 0.8, "q": 0.5, "r": 0.74}
FIG12 = {"p": 0.5, "q": 0.25, "r": 1.40435829552939}
BODY = free_turn.Body.of((1.0, 0.8, 0.6))
CLOSE = 1e-13 if have_taylor() else 1e-11
"""What an averaged motion is right to: some ten roundings, or what collocation leaves of u."""


def case(**given: Any) -> Case:
    """A case of P1's body, by default Fig 4's averaged."""
    keys = {
        "model": "linear-diag",
        "form": "averaged",
        "inertia": [1, 0.8, 0.6],
        "damping": [0.005, 0.004, 0.003],
        "initial": FIG4,
        "time": {"end": 1000, "samples": 11},
    } | given
    if keys["model"] != "linear-diag":
        del keys["damping"]
    lines = "".join(f"    {key}: {written(value)}\n" for key, value in keys.items())
    return parse(f"cases:\n  c:\n{lines}", "test").cases["c"]


def written(value: Any) -> str:
    """A value in YAML's flow style."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {written(item)}" for key, item in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(written, value)) + "]"
    return str(value)


def fluid_torque(A: Sequence[float], w: np.ndarray) -> np.ndarray:
    """The torque (..., 3) of a fluid with kappa = 1, w'' + w x w' of free motion."""
    G = np.array(A) * w
    free = np.cross(G, w) / A
    return (np.cross(A * free, w) + np.cross(G, free)) / A + np.cross(w, free)


def full(averaged: Case) -> Case:
    """The same case by the full equations."""
    own = ("mean_start", "at_separatrix", "spin_reversal")
    data = {key: value for key, value in averaged.data.items() if key not in own}
    return replace(averaged, form="full", data=data, max_steps=10**8)


@cache
def motion_of(of: Case) -> np.ndarray:
    """The angular velocity of a full motion at its samples."""
    method = "taylor" if have_taylor() else "collocation"
    return solve(of, method).variables["omega"]


def omega(averaged: Case) -> np.ndarray:
    """The angular velocity of the full motion at the samples of an averaged case."""
    return motion_of(full(averaged))


def momentum_and_energy(averaged: Case) -> tuple[np.ndarray, np.ndarray]:
    """|G| and T of the full motion at the samples of an averaged case."""
    w, A = omega(averaged), np.array(averaged.data["inertia"])
    return np.linalg.norm(A * w, axis=1), (A * w * w).sum(axis=1) / 2


def off(averaged: Case, outside: tuple[float, float] = (math.inf, math.inf)) -> float:
    """The largest relative distance of averaged from full G^2 and T, but for a span of time."""
    motion, (G, T) = integrate(replace(averaged, error=False)), momentum_and_energy(averaged)
    seen = ~((motion.time > outside[0]) & (motion.time < outside[1]))
    distance = [
        np.abs(motion.variables["momentum"] ** 2 / G**2 - 1),
        np.abs(motion.variables["kinetic_energy"] / T - 1),
    ]
    return float(np.max(np.array(distance)[:, seen]))


def order(small: Sequence[float], errors: Sequence[float]) -> float:
    """The slope of a line through log error against log small parameter."""
    return float(np.polyfit(np.log(small), np.log(errors), 1)[0])


def scaled(factor: float, lam: Sequence[float], end: float, **given: Any) -> Case:
    """A case with all resistance times a factor, up to end/factor."""
    time = {"end": end / factor, "samples": 2001}
    return case(damping=[factor * x for x in lam], time=time, **given)


RAW = [
    (0.647249023398635, 0.832921530072842),
    (0.280780338871132, 0.800340189053686),
    (0.125372225938923, 0.768650023188276),
    (0.0194584549198898, 0.670441293835642),
]


@pytest.mark.parametrize("method", ["auto", "collocation"])
def test_figure_4_from_its_raw_start(method: str) -> None:
    motion = integrate(case(mean_start="no", method=method))
    rows = [1, 3, 5, 10]
    G, J = motion.variables["momentum"][rows], motion.variables["J"][rows]
    assert np.stack((G, J), axis=1) == pytest.approx(np.array(RAW), rel=CLOSE)
    assert motion.variables["enclosed_axis"].tolist() == [1] * 4 + [3] * 7
    (passage,) = motion.events
    assert passage.time == pytest.approx(304.02105312940017, rel=CLOSE)
    # Without mean elements the phase there is not known.
    assert passage.details["sense"] == 0
    assert np.isnan([passage.details["place"], passage.details["predicted"]]).all()
    assert motion.error < CLOSE


@pytest.mark.parametrize("inertia", [(1, 0.9, 0.5), (0.5, 1, 0.9)])
@pytest.mark.parametrize("about_largest", [True, False])
def test_the_momentum_told_of_a_passage_is_that_of_the_motion_there(
    inertia: tuple[float, ...], about_largest: bool
) -> None:
    order = np.argsort(inertia)[::-1]
    omega, damping = np.empty((2, 3))
    omega[order] = (0.9, 0.3, 0.3) if about_largest else (0.3, 0.3, 0.9)
    damping[order] = (1e-2, 8e-3, 3e-3) if about_largest else (3e-3, 8e-3, 1e-2)
    given = {"damping": damping.tolist(), "inertia": inertia, "mean_start": "no", "error": "off"}
    given |= {"initial": dict(zip("pqr", omega, strict=True))}
    (passage,) = integrate(case(**given)).events
    before = replace(case(**given), time=Time(end=passage.time - 1e-3, samples=1))
    # It falls by 1e-2 a unit of time at most.
    momentum = integrate(before).variables["momentum"][-1]
    assert passage.details["momentum"] == pytest.approx(momentum, rel=2e-5)


BODIES = {8: (1, 0.8, 0.6), 9: (1, 0.8, 0.6), 11: (1, 0.8, 0.6), 6: (1, 0.8, 0.8), 7: (1, 1, 0.6)}
LATE = {
    8: ((3e-3, 4e-3, 5e-3), 0.74, 3.881780e-2, 0.985714),
    9: ((5e-3, 4e-3, 5e-3), 0.74, 1.061427e-2, 0.820597),
    11: ((5e-3, 4e-3, 2e-3), 0.74, 3.954399e-2, 0.615231),
    6: ((5e-3, 4e-3, 3e-3), 0.56, 1.892024e-2, 0.813201),
    7: ((5e-3, 4e-3, 3e-3), 0.55, 1.948771e-2, 0.678491),
}


@pytest.mark.parametrize("figure", LATE)
def test_figures_of_the_first_paper_at_their_end(figure: int) -> None:
    lam, r, G, J = LATE[figure]
    given = {"damping": lam, "inertia": BODIES[figure], "initial": {"p": 0.8, "q": 0.5, "r": r}}
    motion = integrate(case(mean_start="no", **given))
    assert last(motion, "momentum") == pytest.approx(G, abs=6e-9)
    assert last(motion, "J") == pytest.approx(J, abs=6e-7)
    assert len(motion.events) == (figure == 11)


def test_a_tolerance_that_brings_the_motion_back_to_the_separatrix_is_named() -> None:
    with pytest.raises(HodoError, match="its tol is too large"):
        integrate(case(method="Radau", tol=1e-3, time={"end": 400, "samples": 11}))


def test_figure_4_from_mean_elements() -> None:
    motion = integrate(case())
    # It goes on through the separatrix: nothing ends it early.
    assert motion.message == ""
    (passage,) = motion.events
    found = passage.time, passage.details["predicted"], passage.details["place"]
    assert found == pytest.approx((303.047880, 305.782994, 0.391022), abs=1e-6)
    assert passage.details["sense"] == -1
    n, decrement = passage.details["frequency"], 4 * 2e-3 / passage.details["frequency"]
    assert passage.details["scatter"] * n == pytest.approx(math.log(16 / decrement) / 12**0.5)


@pytest.mark.heyoka
def test_cost_does_not_depend_on_how_weak_the_resistance_is() -> None:
    motions = [integrate(scaled(factor, (5e-3, 4e-3, 3e-3), 1000)) for factor in (1, 1e-4, 1e-9)]
    assert max(motion.steps for motion in motions) <= 1.1 * min(motion.steps for motion in motions)
    assert max(motion.error for motion in motions) < 1e-13
    times = [motions[1].events[0].time * 1e-4, motions[2].events[0].time * 1e-9]
    assert times == pytest.approx([304.020955827, 304.021053129], abs=1e-6)


@pytest.mark.heyoka
@pytest.mark.parametrize(
    ("start", "raw", "corrected"),
    [(FIG4, [1.21e-2, 1.32e-3, 1.33e-4], [5.7e-4, 5.4e-6, 4.9e-8]),
     ({"p": 0.5, "q": 0.25, "r": 1.4}, [3.97e-3, 3.99e-4, 4.02e-5], [6.9e-5, 6.8e-7, 6.8e-9])],
)  # fmt: skip
def test_orders_of_the_error(
    start: dict[str, float], raw: list[float], corrected: list[float]
) -> None:
    small = [1e-2, 1e-3, 1e-4]
    for mean, expected, slope in (("no", raw, 1), ("yes", corrected, 2)):
        errors = [off(scaled(e, (1, 0.5, 0.7), 0.6, initial=start, mean_start=mean)) for e in small]
        # Samples hit the largest error to some 10 %, and T is a little worse than G^2.
        assert errors == pytest.approx(expected, rel=0.25)
        assert order(small, errors) == pytest.approx(slope, abs=0.1)


@pytest.mark.heyoka
def test_the_second_order_is_kept_through_the_separatrix() -> None:
    # With s = .28, .83, .32 there: near 0 or 1 the lag, and with it the error, are larger.
    small, near = [1e-2, 1e-3, 2.5e-4], (280.0, 330.0)
    for mean, slope in (("no", 1), ("yes", 2)):
        errors = []
        for e in small:
            there = near[0] / e, near[1] / e
            errors.append(off(scaled(e, (5e-3, 4e-3, 3e-3), 500, mean_start=mean), there))
        assert order(small, errors) == pytest.approx(slope, abs=0.1)
        assert errors[-1] < {"no": 1.5e-5, "yes": 2e-10}[mean]


@pytest.mark.heyoka
def test_the_mean_motion_goes_on_while_it_lags_behind_its_passage() -> None:
    """Near the middle axis, where |G| falls on; a member of a sweep that ends there stands there
    too. A step down at the passage would be 2 % here."""
    damping = [1.13e-3 * weight for weight in (5, 4, 3)]
    given = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": damping}
    body = given | {"initial": FIG4, "error": "off"}
    averaged = body | {"form": "averaged"}
    passed = hodo_cli.run(averaged | {"time": {"end": 300}})
    begin, lag = passed.event_time.item(), passed.event_lag.item()
    assert lag > 4
    there = {"time": {"values": [0, *(begin + lag * np.array([0.01, 0.5, 0.99]))]}}
    mean, full = hodo_cli.run([averaged | there, body | there])
    assert mean.momentum.values == pytest.approx(hodo_cli.derive(full, "G").G.values, rel=5e-4)
    starts = {"initial.q": {"values": [0.5 + 1e-5 * i for i in range(200)]}}
    members = hodo_cli.sweep(
        averaged | {"time": {"end": there["time"]["values"][2]}, "sweep": starts}
    )
    assert "side by side" in members.attrs["method_reason"]
    assert members.momentum.values[0] == pytest.approx(mean.momentum.values[2], rel=1e-13)


@pytest.mark.heyoka
def test_a_tensor_with_entries_off_its_diagonal_is_right_to_first_order_only() -> None:
    small = [1e-2, 3e-3, 1e-3]

    def tensor(e: float, off_diagonal: float) -> Case:
        resistance = {"diagonal": 5e-3 * e, "off_diagonal": 5e-3 * e * off_diagonal}
        time = {"end": 150 / e, "samples": 2001}
        return case(model="tensor", resistance=resistance, initial=FIG12, time=time)

    slopes = {x: order(small, [off(tensor(e, x)) for e in small]) for x in (0, 1)}
    assert slopes == pytest.approx({0: 2, 1: 1}, abs=0.15)
    assert any("off-diagonal" in warning for warning in tensor(1, 1).system.warnings)
    assert not tensor(1, 0).system.warnings


def test_a_tensor_on_its_diagonal_is_linear_resistance() -> None:
    tensor = case(model="tensor", resistance=[[5e-3, 0, 0], [0, 3.2e-3, 0], [0, 0, 1.8e-3]])
    diagonal = integrate(case()).variables
    for name, values in integrate(tensor).variables.items():
        assert values == pytest.approx(diagonal[name], rel=1e-13)


@pytest.mark.heyoka
def test_senses_after_the_passage_are_foreseen() -> None:
    """Where s is not near 0 or 1. Each full motion takes some 5000 steps, and ends about x3."""
    phases = np.arange(40) * 2 * np.pi / 40
    right = wrong = 0
    for lam in ((5e-4, 4e-4, 3e-4), (5e-4, 4e-4, 2e-4), (4e-4, 4e-4, 2e-4), (5e-4, 4.5e-4, 3e-4)):
        slow = free_turn.slow_elements(BODY, tuple(FIG4.values()))
        for phase in phases:
            p, q, r = BODY.unsort(free_turn.free_motion_by_phase(BODY, slow, phase)).tolist()
            one = case(
                damping=list(lam),
                initial={"p": p, "q": q, "r": r},
                time={"end": 5000, "samples": 2},
                error=False,
            )
            sense = integrate(one).events[0].details["sense"]
            seen = math.copysign(1, omega(one)[-1, 2])
            right, wrong = right + (sense == seen), wrong + (sense == -seen)
    assert wrong == 0
    assert right > 140


def cavity(**given: Any) -> Case:
    return case(**{"model": "cavity+constant", "initial": {"p": 0.5, "q": 0.25, "r": 1.4}} | given)


@pytest.mark.heyoka
def test_the_cavity_crosses_when_it_should() -> None:
    times = []
    for kappa, seen in ((0.01, 132.566), (1e-3, 1333.771), (1e-4, 13343.529)):
        time = {"end": 2 / kappa, "samples": 3}
        raw = integrate(cavity(kappa=kappa, time=time, mean_start="no")).events[0]
        assert raw.time * kappa == pytest.approx(1.33454550741943, rel=1e-13)
        times.append(
            integrate(cavity(kappa=kappa, time=time)).events[0].details["predicted"] - seen
        )
    # the prediction closes in on the full motions as kappa does on 0
    assert np.abs(times) == pytest.approx([0.06, 0.017, 0.003], abs=0.003)


@pytest.mark.heyoka
def test_the_cavity_is_right_to_second_order() -> None:
    small = [1e-2, 1e-3, 1e-4]
    for mean, slope in (("no", 1), ("yes", 2)):
        errors = [
            off(cavity(kappa=e, time={"end": 1 / e, "samples": 2001}, mean_start=mean))
            for e in small
        ]
        assert order(small, errors) == pytest.approx(slope, abs=0.15)


@pytest.mark.heyoka
@pytest.mark.parametrize(("torque", "slope"), [((0.5, 0.3, 0), 2), ((0.5, 0.3, 0.3), 1)])
def test_so_it_is_under_a_torque_unless_that_has_a_part_about_both_other_axes(
    torque: Sequence[float], slope: int
) -> None:
    """About x1, a drift with M2 M3 remains. Up to 0.3/e nothing comes to the separatrix."""
    small = [1e-2, 1e-3]
    errors = [
        off(cavity(kappa=0.3 * e, torque=[e * M for M in torque], initial=FIG4,
                   time={"end": 0.3 / e, "samples": 1001}))
        for e in small
    ]  # fmt: skip
    assert order(small, errors) == pytest.approx(slope, abs=0.15)


def test_the_periodic_part_of_the_fluid_is_that_of_its_quadrature() -> None:
    def torque(w: np.ndarray) -> np.ndarray:
        return fluid_torque(BODY[:3], w)

    for start in ((0.5, 0.25, 1.4), (0.8, 0.5, 0.74), (-0.8, -0.3, 0.5)):
        slow = free_turn.slow_elements(BODY, start)
        system = cavity(kappa=1, initial=dict(zip("pqr", start, strict=True))).system
        part = system.part(0.0, slow, attributes(system.constants))
        closed = part * np.array(slow[:2])
        assert closed == pytest.approx(any_torque.periodic_part(BODY, torque, slow, 256), rel=1e-13)


@pytest.mark.parametrize("inertia", [(1, 0.8, 0.6), (0.6, 1, 0.8), (0.8, 1, 0.6)])
@pytest.mark.parametrize("model", ["cavity+constant", "torques"])
def test_the_fluid_keeps_the_momentum_of_an_averaged_motion(
    model: str, inertia: tuple[float, ...]
) -> None:
    start = dict(zip("pqr", (0.5, 0.25, 0.4), strict=True)) | {"pqr"[np.argmin(inertia)]: 1.4}
    motion = integrate(case(model=model, inertia=inertia, kappa=0.02, initial=start,
                            time={"end": 200, "samples": 401}))  # fmt: skip
    (passage,) = motion.events
    assert passage.time < 150
    size = math.hypot(*(A * w for A, w in zip(inertia, start.values(), strict=True)))
    assert motion.variables["momentum"] == pytest.approx(size, rel=CLOSE)


@pytest.mark.parametrize(
    ("A", "C", "M3", "end", "x"),
    [(8.0, 4.0, -0.1, 40.008751, 1.237062), (8.0, 4.0, -0.3, 28.875367, 1.215748),
     (1.3, 1.0, -0.1, 15.311778, 1.537620), (1.3, 1.0, -0.3, 10.627056, 1.455693)],
)  # fmt: skip
def test_ends_of_spin_of_symmetric_bodies_by_the_equations_of_all(
    A: float, C: float, M3: float, end: float, x: float
) -> None:
    symmetric = cavity(
        inertia=[A, A, C],
        kappa=1260 * 0.48 / 1000,
        torque=[0, 0, M3],
        epsilon=0.1,
        initial={"x": 1, "y": 1},
        time={"end": 60, "samples": 3},
        error=False,
    )
    general = type(cavity(kappa=1).system)(**symmetric.data)
    object.__setattr__(symmetric, "system", general)
    motion = integrate(symmetric)
    assert motion.time[-1] == pytest.approx(end, abs=6e-7)
    assert np.exp(motion.state[-1, 1]) / (A * (A - C)) == pytest.approx(x, abs=6e-7)


@pytest.mark.heyoka
@pytest.mark.parametrize(
    ("C", "M3", "x", "y", "kappa"),
    [(10, -0.066, 2.22, 2.945, 0.7416), (12, -0.0147, 2.914, 0.627, 0.1124),
     (6, -0.136, 0.548, 3.735, 0.2871), (4, -0.0605, 0.667, 3.408, 0.065),
     (4, -0.001346, 1.72, 3.3086, 0.45668)],
)  # fmt: skip
def test_a_nearly_symmetric_body_stops_where_the_symmetric_one_has_lost_its_spin(
    C: float, M3: float, x: float, y: float, kappa: float
) -> None:
    """Moments that agree to one ulp are equal. Else the separatrix is at g = 1e-7 f, and the two
    times differ by that over g'."""
    given: dict[str, Any] = {"kappa": kappa, "torque": [0, 0, M3], "initial": {"x": x, "y": y}}
    given["time"] = {"end": 3000, "samples": 3}
    ends = [
        integrate(replace(cavity(inertia=[8, B, C], **given), error=False))
        for B in ("8", "8.000000000000002", "8.0000000000001")
    ]
    (spin,), (same,), (edge,) = (motion.events for motion in ends)
    assert (spin.kind, same.kind, edge.kind) == ("end_of_spin", "end_of_spin", "separatrix")
    assert same.time == pytest.approx(spin.time, rel=1e-13)
    assert edge.time == pytest.approx(spin.time, rel=4e-5)
    # Next to none of the phases goes on; where the fluid has brought f down, the spin ends first.
    assert edge.details.get("probability", 0) < 1e-3


def chance(**given: Any) -> Case:
    """A body without fluid whose spin about x1 a torque opposes."""
    keys = {"kappa": 0, "initial": FIG4, "time": {"end": 1000, "samples": 11}, "error": "off"}
    return cavity(**keys | given)


@pytest.mark.parametrize(("ratio", "expected"), [(0.3, 0.3873), (0.5, 0.6455), (1.0, 1.0)])
def test_a_torque_makes_the_capture_a_matter_of_chance(ratio: float, expected: float) -> None:
    torque = [-1e-3, 0, -1e-3 * ratio]
    stopped = integrate(chance(torque=torque))
    (passage,) = stopped.events
    assert stopped.time[-1] == passage.time < 1000
    assert passage.details["probability"] == pytest.approx(expected, abs=5e-5)
    other = integrate(chance(torque=torque, at_separatrix="other-axis"))
    assert other.variables["enclosed_axis"][[0, -1]].tolist() == [1, 3]
    back = integrate(chance(torque=torque, at_separatrix="reversed"))
    # With probability 1 of the other axis, the motion cannot be reversed.
    assert back.variables["enclosed_axis"][-1] == 1
    assert (back.time[-1] < 1000) == (expected == 1)


@pytest.mark.heyoka
@pytest.mark.parametrize(("kappa", "ratio"), [(0, 0.3), (3e-4, 0.5), (1.2e-3, 0.2)])
def test_the_probability_of_capture_is_that_of_full_motions(kappa: float, ratio: float) -> None:
    """Drawn are phases, and sizes of all torques together: the periodic part ties the phase of the
    passage to that of the start, and phases alone would not be spread evenly."""
    count, draw = 120, np.random.default_rng(1)
    start = free_turn.slow_elements(BODY, tuple(FIG4.values()))
    passage = integrate(chance(kappa=kappa, torque=[-1e-3, 0, -1e-3 * ratio])).events[0]
    some, captured = full(chance()), 0
    for size, phase in zip(
        draw.uniform(0.2, 0.3, count), draw.uniform(0, 2 * np.pi, count), strict=True
    ):
        p, q, r = BODY.unsort(free_turn.free_motion_by_phase(BODY, start, phase)).tolist()
        torque = (-1e-3 * size, 0.0, -1e-3 * ratio * size)
        data = some.data | {"kappa": kappa * size, "torque": torque}
        one = replace(some, data=data | {"initial": {"p": p, "q": q, "r": r}})
        behind = np.array([(passage.time + 100) / size])
        w = solve(one, "taylor", times=behind).variables["omega"][0]
        captured += bool(0.2 * w[0] ** 2 < 0.12 * w[2] ** 2)
    expected = passage.details["probability"]
    error = math.sqrt(expected * (1 - expected) / count)
    assert captured / count == pytest.approx(expected, abs=3 * error)


def drift_at_separatrix(**given: Any) -> dict[passage.Region, float]:
    """How D of a cavity's motion with sqrt(X_e) = sqrt(X_o) = 1 drifts in each region."""
    system = cavity(**given).system
    rates = system.separatrix_rates(0.0, (1.0, 1.0), attributes(system.constants))
    return passage.drift_by_region(rates)


def test_a_dissipation_without_a_torque_takes_both_senses_alike() -> None:
    shares = passage.capture_shares(drift_at_separatrix(kappa=1e-3), (-1, 1))
    assert shares == pytest.approx({(1, 1): 0.5, (1, -1): 0.5, (-1, 1): 0, (-1, -1): 0})


def test_captures_add_up() -> None:
    for torque in ((-1, 0, 0.4), (-1, 0, -3), (-0.2, 0, 0.3)):
        for kappa in (0.0, 0.1, 0.5):
            drift = drift_at_separatrix(kappa=kappa, torque=list(torque))
            if drift[1, 1] < 0:
                assert sum(passage.capture_shares(drift, (1, 1)).values()) == pytest.approx(1)


@pytest.mark.quadruple
def test_the_error_measured_is_that_against_quadruple_precision() -> None:
    double = integrate(case(mean_start="no"))
    quadruple = integrate(case(mean_start="no", precision="quadruple", error=False))
    for name in ("momentum", "J"):
        apart = np.abs(double.variables[name] / quadruple.variables[name] - 1).max()
        assert apart < 1e-14
    assert double.error < 1e-14


def test_a_motion_far_below_the_smallest_double_has_its_shape() -> None:
    decayed = integrate(case(damping=[5, 4, 3], time={"end": 1000, "samples": 3}))
    assert decayed.variables["momentum"][-1] == 0
    assert decayed.variables["J"][-1] == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("given", "said"),
    [({"inertia": [0.5, 0.5, 0.5]}, "three equal moments"),
     ({"initial": {"p": 0, "q": 1, "r": 0}}, "on the separatrix"),
     ({"initial": {"p": 0, "q": 0, "r": 0}}, "at rest"),
     ({"initial": {"p": 1e-200, "q": 0, "r": 0}}, "beyond the range of doubles"),
     ({"model": "cavity+constant", "kappa": 1, "cavity": {"kappa": 1}}, "leave out the cavity"),
     ({"model": "cavity+constant"}, "none of them is given"),
     ({"mean_start": "maybe"}, "yes or no")],
)  # fmt: skip
def test_what_cannot_be_averaged(given: dict[str, Any], said: str) -> None:
    with pytest.raises(HodoError, match=said):
        case(**given)


def test_a_torque_brings_an_exact_rotation_to_rest() -> None:
    motion = integrate(chance(torque=[1e-3, 1e-3, -1e-3], initial={"p": 0, "q": 0, "r": 0.8}))
    (stop,) = motion.events
    assert stop.time == pytest.approx(0.8 * 0.6 / 1e-3)
    assert (stop.details["from"], stop.details["to"]) == (3, 0)
    assert motion.variables["momentum"][-1] == pytest.approx(0, abs=1e-8)


def test_the_cavity_warns_in_its_averaged_form_too() -> None:
    assert any("not small" in each for each in cavity(kappa=10).system.warnings)


def quarter_turn(start: Mapping[str, float]) -> float:
    """K/n of the free motion of P1's body."""
    (A1, A2, A3), (p, q, r) = (1, 0.8, 0.6), start.values()
    about_1, about_3 = A1 * (A1 - A2) * p * p, A3 * (A2 - A3) * r * r
    assert about_1 > about_3
    Y = A2 * (A2 - A3) * q * q + A1 * (A1 - A3) * p * p
    k2 = 1 - (A1 - A3) * (about_1 - about_3) / ((A1 - A2) * Y)
    return float(ellipk(k2) / math.sqrt((A1 - A2) * Y / (A1 * A2 * A3)))


def test_a_perturbation_is_small_beside_a_quarter_turn() -> None:
    quarter = quarter_turn(FIG4)
    by_resistance = case(mean_start="no").system
    fastest = 0.005
    assert by_resistance.smallness(0.0, np.array([by_resistance.start])) == pytest.approx(
        fastest * quarter
    )
    by_fluid = cavity(kappa=1e-3, initial=FIG4, mean_start="no").system
    by_e, by_o, *_ = by_fluid.rhs(0.0, by_fluid.start, attributes(by_fluid.constants))
    fastest = max(abs(by_e), abs(by_o)) / 2
    assert by_fluid.smallness(0.0, np.array([by_fluid.start])) == pytest.approx(fastest * quarter)


def last(motion: Trajectory, name: str) -> float:
    return float(motion.variables[name][-1])


@pytest.mark.parametrize(
    ("inertia", "initial", "axis", "J"),
    [((1, 0.8, 0.8), {"p": 0.8, "q": 0.5, "r": 0.56}, 1, 0.813201),
     ((1, 1, 0.6), {"p": 0.8, "q": 0.5, "r": 0.55}, 3, 0.678491)],
)  # fmt: skip
def test_symmetric_bodies_keep_their_side(
    inertia: Sequence[float], initial: dict[str, float], axis: int, J: float
) -> None:
    motion = integrate(case(inertia=list(inertia), initial=initial, mean_start="no"))
    assert set(motion.variables["enclosed_axis"]) == {axis}
    assert motion.variables["k2"].max() == 0
    assert last(motion, "J") == pytest.approx(J, abs=6e-7)


def test_exact_rotation_about_an_axis_stays_one() -> None:
    motion = integrate(case(initial={"p": 0.8, "q": 0, "r": 0}))
    assert motion.variables["J"] == pytest.approx(1)
    assert motion.variables["momentum"] == pytest.approx(0.8 * np.exp(-5e-3 * motion.time))


def test_equal_resistance_is_no_approximation() -> None:
    equal = case(damping=[5e-3, 5e-3, 5e-3], initial={"p": 0.5, "q": 0.25, "r": 1.4})
    assert off(equal) < 1e-13


def test_the_late_regime_is_told() -> None:
    (told,) = integrate(case()).warnings
    assert "0.027 at t = 0" in told


def test_one_table_serves_all_starts() -> None:
    u, times = crossing_times.crossing_table((5e-3, 4e-3, 3e-3), 1)
    some = np.random.default_rng(1).uniform(0.01, 5, 100)
    direct = crossing_times.crossing_time((5e-3, 4e-3, 3e-3), 1, some)
    assert np.interp(some, u, times) == pytest.approx(direct, rel=2e-4)
    assert not len(crossing_times.crossing_table((3e-3, 4e-3, 5e-3), 1)[0])


DRAWN = """
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}}
cases:
  a: {damping: [0.01, 0.005, 0.007], time: {end: 60, samples: 201}}
  b: {damping: [0.001, 0.0005, 0.0007], time: {end: 600, samples: 201}}
  a-mean: {form: averaged, damping: [0.01, 0.005, 0.007], time: {end: 60, samples: 201}}
  b-mean: {form: averaged, damping: [0.001, 0.0005, 0.0007], time: {end: 600, samples: 201}}
  fig4: {damping: [0.005, 0.004, 0.003], time: {end: 500}}
  fig4-mean: {form: averaged, damping: [0.005, 0.004, 0.003], time: {end: 500}}
  starts:
    damping: [0.005, 0.004, 0.003]
    initial: {p: 0, q: 0, G: 1}
    time: {end: 1000}
    store: [crossing_time]
    sweep: {damping.2: {values: [0.003]}, direction: {sphere: {count: 500, seed: 1}}}
figures:
  order: {kind: order, cases: [a-mean, b-mean], against: [a, b], groups: [2], small: [0.01, 0.001]}
  cost: {kind: cost, cases: [a, b, a-mean, b-mean], groups: [2, 2], small: [1, 0.1, 1, 0.1]}
  share: {kind: share, cases: [starts]}
  passage: {kind: series, cases: [fig4, fig4-mean], variables: [G, J], passages: yes}
claims:
  - {id: second, where: ours, statement: s, cases: [a-mean, a, b-mean, b],
     check: {kind: paper, name: second-order}, expect: reproduced}
  - {id: first, where: ours, statement: s, cases: [a-mean, a, b-mean, b],
     check: {kind: paper, name: first-order}, expect: contradicted}
  - {id: sense, where: ours, statement: s, cases: [fig4-mean, fig4],
     check: {kind: paper, name: predicted-sense}, expect: reproduced}
  - {id: steps, where: ours, statement: s, cases: [a-mean, fig4-mean],
     check: {kind: paper, name: steps-do-not-grow}, expect: contradicted}
"""


def test_an_order_wants_a_case_against_each() -> None:
    text = DRAWN.replace("against: [a, b]", "against: [a]")
    with pytest.raises(
        HodoError, match=r"order\.against: expected one for each of the cases, 2 in all, got 1"
    ):
        parse(text, "drawn.yaml")


@pytest.mark.heyoka
def test_figures_and_claims_of_averaging(tmp_path: Path) -> None:
    (tmp_path / "drawn.yaml").write_text(DRAWN, encoding="utf-8")
    for command in (
        *("run drawn.yaml --quiet", "classify runs/drawn.h5", "claims runs/drawn.h5"),
        "plot runs/drawn.h5 --format csv --out figures",
    ):
        done = call(tmp_path, *command.split())
        assert done.returncode == 0, done.stdout + done.stderr
    shown = {}
    for name in ("order", "cost", "share", "passage"):
        text = (tmp_path / "figures" / "drawn" / f"{name}.csv").read_text(encoding="utf-8")
        shown[name] = list(csv.DictReader(text.splitlines()))
    errors = [float(row["error"]) for row in shown["order"]]
    assert errors == pytest.approx([5.7e-4, 5.6e-6], rel=0.1)
    assert [row["steps"] for row in shown["cost"][2:]] == ["3", "3"]
    at_end = [row for row in shown["share"] if row["time"] == "1000.0"]
    averaged, counted = (
        [float(row[name]) for row in at_end if row[name]] for name in ("averaged", "counted, full")
    )
    assert averaged == pytest.approx([0.3766], abs=1e-4)
    # 500 starts count to 0.02
    assert counted == pytest.approx([0.3705], abs=0.06)
    assert {row["curve"] for row in shown["passage"]} == {"fig4", "fig4-mean"}


COUNTED = "counted, full motions"
STARTS = {
    "model": "torques", "inertia": [1, 0.8, 0.6], "initial": {"p": 0, "q": 0, "G": 1},
    "time": {"start": 10, "end": 200},
}  # fmt: skip


@pytest.mark.heyoka
@pytest.mark.parametrize(
    ("torques", "vary", "lines", "name"),
    [
        ({"model": "linear-diag"}, {"damping.0": [0.005, 0.009]}, 2, r"$10^3\lambda = 9, 4, 3$"),
        ({"kappa": 0}, {"kappa": [0, 0.03]}, 1, r"$\kappa = 0.03$"),
        ({"quadratic": [0.02, 0, 0.01]}, {"damping.0": [0.005, 0.009]}, 0, r"$\lambda_1 = 0.009$"),
        ({"brake": 0.001}, {}, 0, COUNTED),
        ({"torque": [0, 0.001, 0]}, {}, 0, COUNTED),
        ({"rotor": [0, 0.1, 0]}, {}, 0, COUNTED),
        ({"damping": [{"law": "exponential", "value": 0.02, "rate": 0.1}, 0, 0]}, {}, 0, COUNTED),
        ({"inertia": [0.8, 0.8, 0.6]}, {}, 0, COUNTED),
        ({}, {"inertia.0": [0.9, 1.1]}, 2, "$A_1 = 1.1$"),
    ],
)  # fmt: skip
def test_a_share_is_averaged_only_where_linear_damping_acts_alone(
    torques: dict[str, Any], vary: dict[str, Any], lines: int, name: str
) -> None:
    axes = {key: {"values": values} for key, values in vary.items()}
    direction = {"direction": {"sphere": {"count": 200, "seed": 1}}}
    given = {**STARTS, "damping": [0.005, 0.004, 0.003], "error": "off", **torques}
    given["sweep"] = axes | direction
    if "rotor" in torques:
        given["initial"] = {"p": 0.3, "q": 0.7, "r": 0.9}
    figure = hodo_cli.plot(hodo_cli.sweep(given), kind="share")
    (panel,) = figure.axes
    drawn = [line for line in panel.lines if line.get_marker() != "o"]
    assert len(drawn) == lines
    entries = [text.get_text() for text in figure.legends[0].get_texts()]
    assert name in entries
    is_said = "no line unless constant linear damping acts alone" in entries
    assert is_said == (lines < (2 if vary else 1))
    # From the start of the motions on, and beside the counted points.
    for line in panel.lines:
        assert line.get_xdata()[0] == 10
        assert line.get_ydata()[0] == 0
    for line, points in zip(drawn, panel.lines[1::2], strict=False):
        assert line.get_ydata()[::10] == pytest.approx(points.get_ydata(), abs=0.1)


@pytest.mark.parametrize(("unit", "label"), [("day", "$t$ [day]"), ("1", r"$\tau$")])
def test_a_share_names_the_unit_of_time(unit: str, label: str) -> None:
    given = STARTS | {"damping": 0.01, "time": {"end": 20, "unit": unit}}
    made = hodo_cli.sweep({**given, "sweep": {"direction": {"sphere": {"count": 20, "seed": 1}}}})
    assert hodo_cli.plot(made, kind="share").axes[0].get_xlabel() == label


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("direction: {sphere: {count: 500, seed: 1}}", "damping.1: {values: [1, 2]}",
         "share.cases.0: sweep starts has the axes damping.2, damping.1: a share needs a sphere"),
        ("store: [crossing_time]", "store: [crossings]", "case starts has no crossing_time"),
        ("share, cases: [starts]", "share, cases: [starts, starts]", "expected one sweep"),
    ],
)  # fmt: skip
def test_a_share_wants_starts(old: str, new: str, message: str) -> None:
    with pytest.raises(HodoError, match=message):
        parse(DRAWN.replace(old, new), "drawn.yaml")


def test_the_distance_of_the_mean_motion_from_the_separatrix_is_that_of_the_full_one() -> None:
    body = {
        "model": "linear-diag", "inertia": [0.6, 1, 0.8], "damping": [5e-6, 4e-6, 3e-6],
        "initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 10, "samples": 5},
    }  # fmt: skip
    full, mean = (
        hodo_cli.derive(hodo_cli.run({**body, "form": form}), "D/2T")["D/2T"].values
        for form in ("full", "averaged")
    )
    assert mean == pytest.approx(full, rel=1e-5)


def test_the_side_chooses_to_the_last_digit() -> None:
    assert either(-1.0, 1.5e15, 6.7e-16) == 6.7e-16
    assert either(1.0, 6.7e-16, 1.5e15) == 6.7e-16


@pytest.mark.parametrize("beside", [1e-3, 1e-7])
def test_a_start_in_long_double_is_that_in_double_to_its_rounding(beside: float) -> None:
    for sign, of in ((-1, case), (1, partial(cavity, kappa=0.01))):
        start = {"p": 0.8, "q": 0.5, "r": 0.8 * math.sqrt(0.2 / 0.12) * (1 + sign * beside)}
        system = of(initial=start, mean_start="no").system
        apart = system.extended_start - np.array(system.start)
        assert 0 < np.abs(apart).max() < 1e-15


@pytest.mark.parametrize("beside", few_without_heyoka([1e-9, 1e-7, 1e-5, 1e-3]))
def test_the_rounding_of_a_start_beside_the_separatrix_is_part_of_its_error(beside: float) -> None:
    """u is the difference of two logarithms of size 1: of 1e-9 seven digits are left."""
    start = {"p": 0.8, "q": 0.5, "r": 0.8 * math.sqrt(0.2 / 0.12) * (1 - beside)}
    motion = integrate(case(initial=start, mean_start="no", time={"end": 100, "samples": 3}))
    slow = free_turn.slow_elements(BODY, tuple(start.values()))
    u = float(-np.log1p(-slow.m1))
    exact = float(crossing_times.crossing_time((0.005, 0.004, 0.003), slow.side, u))
    off = abs(motion.events[0].time / exact - 1)
    assert off <= 2 * motion.errors["event_time"]
    # The fluid takes a motion the other way, and amplitudes lose as much of u as logarithms.
    other = start | {"r": 0.8 * math.sqrt(0.2 / 0.12) * (1 + beside)}
    free = integrate(cavity(kappa=0.01, initial=other, mean_start="no"))
    assert 1e-18 / beside < free.errors["event_time"] < 1e-14 / beside


@pytest.mark.parametrize(
    "torque",
    [
        {"torque": [0.0, 0.05, 0.0]},
        {"torque": [0.0, 0.05, 0.0], "resistance": {"diagonal": 1e-4, "off_diagonal": 0.0}},
        {"torque": [0.0, 0.05, 0.0], "quadratic": 1e-4},
        {"expression": ["0", "0.05", "0"]},
        {"torque": [0.0, [0.0, 0.003], 0.0]},
    ],
    ids=["constant", "with a tensor", "with a drag", "expression", "law of time"],
)
def test_a_torque_without_a_mean_is_too_strong_as_any_other(torque: dict[str, Any]) -> None:
    """About the middle axis: T of the full motion is off by 5 to 20 %."""
    body = {
        "model": "torques",
        "form": "averaged",
        "inertia": [1.0, 0.8, 0.6],
        "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
        "time": {"end": 20, "samples": 3},
        "error": "off",
    }
    weak = {"torque": [0.0, 1e-3, 0.0], "damping": 1e-4}
    for torques, warned in ((torque, True), (weak, False)):
        warnings = integrate(Case.of(body | torques)).warnings
        assert any("slow beside the turns" in warning for warning in warnings) == warned


STRONG: dict[str, dict[str, tuple[Any, int, int]]] = {
    "linear-diag": {"damping": ([0.3, 0.4, 0.2], 1, 0)},
    "tensor": {"resistance": ([[0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.2]], 1, 1)},
    "cavity+constant": {"kappa": (0.3, -1, 1), "torque": ([0.01, 0.2, 0.05], 2, 1)},
    "torques": {"damping": (0.1, 1, 0), "torque": ([0.0, 0.2, 0.05], 2, 1), "brake": (0.1, 2, 1)},
    "torques, expression": {"expression": (["0.1", "0.2", "0.1*q"], 2, 1)},
    "torques, quadratic": {"quadratic": (0.3, 0, 0), "kappa": (0.2, -1, 1)},
}
"""Torques too strong for averaging by the name of their model, each with the powers of the unit of
velocity and of mass that it carries."""


@pytest.mark.heyoka
@pytest.mark.parametrize("kind", STRONG)
def test_how_strong_a_torque_is_does_not_depend_on_units(kind: str) -> None:
    """A constant torque about the middle axis was measured against the root of a moment."""

    def stated(speed: int, mass: int) -> list[str]:
        def scaled(value: Any, size: int) -> Any:
            if isinstance(value, list):
                return [scaled(item, size) for item in value]
            if isinstance(value, str):  # q in the unit of velocity of the numbers around it
                return f"({value.replace('q', f'q*{2.0**-speed}')})*{2.0**size}"
            return value * 2.0**size

        powers = {name: v * speed + m * mass for name, (_, v, m) in data.items()}
        torques = {name: scaled(value, powers[name]) for name, (value, *_) in data.items()}
        body = {
            "model": kind.split(",")[0],
            "form": "averaged",
            "inertia": scaled([1.0, 0.8, 0.6], mass),
            "initial": {
                name: x * 2.0**speed for name, x in zip("pqr", (0.8, 0.5, 0.74), strict=True)
            },
            "time": {"end": 2.0**-speed, "samples": 2},
            "error": "off",
        }
        warnings = integrate(Case.of(body | torques)).warnings
        return [found for text in warnings for found in re.findall("K/n is (.*?) at", text)]

    data = STRONG[kind]
    assert len(stated(0, 0)) == 1
    for speed, mass in ((0, 1), (0, -40), (3, 0), (-9, 20)):
        assert stated(speed, mass) == stated(0, 0), (speed, mass)


LAW = [{"law": "exponential", "value": 0.5 * x, "rate": 0.02} for x in (1, 0.8, 0.3)]


@pytest.mark.parametrize("torque", [{"damping": LAW}, {"expression": ["-0.01*p/t", "0", "-r/t"]}])
def test_a_mean_start_under_a_torque_that_changes_is_that_of_time_0(torque: dict[str, Any]) -> None:
    """From another time it was of first order only, or not a number."""
    body = {
        "model": "torques",
        "inertia": [1, 0.8, 0.6],
        "initial": {"p": 0.9, "q": 0.45, "r": 0.4},
    }
    later = {**body, "form": "averaged", "time": {"start": 300, "end": 400, "samples": 11}}
    with pytest.raises(HodoError, match=r"mean_start: is that of time 0, and the torque changes"):
        Case.of(later | torque)
    assert Case.of(later | {"damping": 0.001})
    assert Case.of(later | torque | {"mean_start": "no"})
    assert Case.of(later | {"damping": LAW, "time": {"end": 100}})


@pytest.mark.parametrize("mean_start", ["yes", "no"])
@pytest.mark.parametrize(("inertia", "axis"), [((1, 1, 0.6), "r"), ((0.6, 1, 0.6), "q")])
def test_that_a_symmetric_body_across_its_axis_does_not_turn(
    inertia: Sequence[float], axis: str, mean_start: str
) -> None:
    """Its hodograph is a point, so that nothing is to be averaged. In a sweep over starts it takes
    no other member along."""
    start = {"p": 0.8, "q": 0.5, "r": 0.3} | {axis: 0}
    keys = {"inertia": inertia, "initial": start, "mean_start": mean_start}
    with pytest.raises(HodoError, match="averaging is undefined"):
        case(**keys)
    data = {
        "model": "linear-diag", "form": "averaged", "damping": 0.001, "time": {"end": 10}, **keys,
        "initial": start | {axis: 0.1}, "sweep": {f"initial.{axis}": {"values": [0.2, 0, 0.1]}},
    }  # fmt: skip
    assert hodo_cli.sweep(data).status.values.tolist() == [0, 3, 0]
