"""The growth of a small tilt, and the axis in the end: what `classify` says of a medium."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from conftest import FIG4, call, classified

from hodo_cli import Case, run
from hodo_cli.cases.case import Time

A = np.array([1.0, 0.8, 0.6])
LITERAL = ((0.005, 0.0, 0.005), (0.0, 0.0, 0.0), (0.005, 0.0, 0.005))


def damped(model: str, start: tuple[float, ...], end: float = 1.0, **medium: object) -> Case:
    """A case of P1's body in some medium."""
    initial = dict(zip("pqr", start, strict=True)) | {"G": None}
    data = {"inertia": (1.0, 0.8, 0.6), **medium, "initial": initial}
    return Case("test", model, "full", data, Time(end=end, samples=401))


def diagonal(*damping: float) -> Case:
    return damped("linear-diag", (0.8, 0.5, 0.74), damping=damping)


def tensor(on: float, off: float) -> Case:
    return damped("tensor", (0.8, 0.5, 0.74), resistance={"diagonal": on, "off_diagonal": off})


@pytest.mark.parametrize(
    ("case", "about_x1", "about_x3"),
    [
        (diagonal(0.005, 0.004, 0.003), 0.0015, -0.0015),
        (diagonal(0.003, 0.004, 0.005), -0.0015, 0.0015),
        (tensor(0.005, 0.005), -0.00229167, 0.00270833),
        (damped("tensor", (0.8, 0.5, 0.74), resistance=LITERAL), 0.00083333, 0.00583333),
    ],
)
def test_the_rates_are_those_of_the_papers_media(case, about_x1, about_x3):
    _, found = classified(case)
    assert found.growth is not None
    assert found.growth[[0, 2]] == pytest.approx([about_x1, about_x3], abs=5e-9)
    assert np.isnan(found.growth[1])


def test_the_table_has_the_rates_by_axis_but_for_the_middle_one(tmp_path: Path) -> None:
    couple = {"size": 0.01, "direction": [0, 0, 1]}
    cases = {"damped": FIG4, "driven": FIG4 | {"model": "torques", "space_torque": couple}}
    (tmp_path / "a.yaml").write_text(json.dumps({"cases": cases}), encoding="utf-8")
    assert call(tmp_path, "run", "a.yaml", "--quiet").returncode == 0
    rows = json.loads(call(tmp_path, "classify", "a.yaml", "--json").stdout)
    rates = {"x1": pytest.approx(0.0015), "x3": pytest.approx(-0.0015)}
    assert [row["growth"] for row in rows] == [rates, {}]


def test_a_symmetric_body_has_one_rate_and_equal_ones_cancel_without_their_rounding() -> None:
    data = {**diagonal(0.005, 0.004, 0.003).data, "inertia": (1.0, 0.8, 0.8)}
    found = Case("test", "linear-diag", "full", data, Time(end=1.0)).system.tilt_growth(0.0)
    assert found[0] == pytest.approx(0.0015)
    assert np.isnan(found[1:]).all()
    assert diagonal(0.005, 0.005, 0.005).system.tilt_growth(0.0)[[0, 2]].tolist() == [0, 0]


@pytest.mark.heyoka
def test_the_axis_in_the_end_is_that_of_the_slowest_eigenvector() -> None:
    generator = np.random.default_rng(3)
    for _ in range(4):
        root = generator.normal(size=(3, 3))
        resistance = 0.01 * (root @ root.T + 0.1 * np.eye(3))
        start = tuple(generator.normal(size=3).tolist())
        case = damped("tensor", start, 20000.0, resistance=tuple(map(tuple, resistance.tolist())))
        _, found = classified(case)
        assert found.labels[-1] == found.final


@pytest.mark.parametrize("start", [(0.8, 0.5, 0.74), (0.0, 0.3, 0.74)])
def test_the_axis_in_the_end_is_that_of_omega_beside_an_attitude(start: Sequence[float]) -> None:
    resistance = np.diag([0.005, 0.004, 0.001]).tolist()
    data = {"model": "tensor", "inertia": A, "resistance": resistance, "time": {"end": 3000}}
    motion = run({**data, "initial": dict(zip("pqr", start, strict=True)), "attitude": True})
    assert motion.final_axis == motion.enclosed_axis[-1] == 3


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 0, 2)])
@pytest.mark.parametrize(
    ("rates", "final"),
    [
        ((0.005, 0.005, 0.005), None),  # D = D(0) exp(-2 lambda t): the start decides
        ((0.003, 0.010, 0.003), None),
        ((0.003, 0.010, 0.003 * (1 + 1e-15)), None),
        ((0.005, 0.001, 0.004), None),  # the slowest axis is the middle one: the separatrix
        ((0.003, 0.003, 0.005), None),
        ((0.005, 0.004, 0.003), 2),
    ],
)
def test_of_a_diagonal_tensor_the_outer_rates_decide(rates, final, order):
    A = np.array((1.0, 0.8, 0.6))[[*order]]
    data = {"inertia": A.tolist(), "resistance": np.diag(np.array(rates)[[*order]] * A).tolist()}
    both = {"model": "tensor", "time": {"end": 1.0}, **data}
    case = Case.of({**both, "initial": {"p": 0.8, "q": 0.5, "r": 0.74}})
    assert case.system.final_axis == (None if final is None else [*order].index(final) + 1)
    assert Case.of({**both, "initial": dict.fromkeys("pqr", 0.0)}).system.final_axis is None
    # A rotation about a body axis may stay there, whatever is slower.
    for axis in range(3):
        start = np.eye(3)[axis].tolist()
        case = Case.of({**both, "initial": dict(zip("pqr", start, strict=True))})
        assert case.system.final_axis is None


@pytest.mark.parametrize("unit", [1e-14, 1, 1e14])
def test_what_feeds_energy_in_is_told_in_every_unit(unit: float) -> None:
    # Of a kernel rounding makes an eigenvalue of either sign.
    for on, off, told in ((5, 5, False), (1, 3, True), (-1, 0, True)):
        warnings = tensor(on * unit, off * unit).system.warnings
        assert any("not dissipative" in each for each in warnings) == told


def test_nothing_is_predicted_for_a_kernel_or_a_tensor_that_feeds_energy_in() -> None:
    # A matter of the eigenvalues' ratios, whatever the unit of time.
    assert [tensor(3 * unit, unit).system.final_axis for unit in (1e-14, 1e-3, 1e14)] == [1] * 3
    assert tensor(0.005, 0.005).system.final_axis is None
    assert tensor(0.001, 0.003).system.final_axis is None
    assert damped("tensor", (1.0, 0.1, 0.0), resistance=LITERAL).system.final_axis is None
    lopsided = ((0.003, 0.001, 0.0), (0.0, 0.003, 0.0), (0.0, 0.0, 0.003))
    assert damped("tensor", (1.0, 0.1, 0.0), resistance=lopsided).system.final_axis is None
