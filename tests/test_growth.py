"""The growth of a small tilt, as `classify` states it."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import FIG4, call, classified

from hodo_cli import Case
from hodo_cli.cases.case import Time

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


@pytest.mark.parametrize("unit", [1e-14, 1, 1e14])
def test_what_feeds_energy_in_is_told_in_every_unit(unit: float) -> None:
    # Of a kernel rounding makes an eigenvalue of either sign.
    for on, off, told in ((5, 5, False), (1, 3, True), (-1, 0, True)):
        warnings = tensor(on * unit, off * unit).system.warnings
        assert any("not dissipative" in each for each in warnings) == told
