"""Motions whose D almost touches zero: the list of crossings is right, or said to be undecided.

HODO_FUZZ sets the number of bodies drawn (default 60, of which the first two that can be tuned are
taken).
"""

import json
import os
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
import series
from conftest import Hodo, classified
from tangents import Tangent, near_tangents

from hodo_cli import Case
from hodo_cli.cases.case import Time

SEPARATIONS = [10.0**-n for n in range(2, 11)] + [-1e-3, -1e-6, -1e-8]
DRAWS = range(int(os.environ.get("HODO_FUZZ", "60")))


@pytest.fixture(scope="module")
def tangents() -> list[Tangent]:
    """The same motions for every method."""
    found = (tangent for seed in DRAWS for tangent in near_tangents(seed, SEPARATIONS))
    return [*islice(found, None if "HODO_FUZZ" in os.environ else 2 * len(SEPARATIONS))]


@pytest.mark.parametrize(
    ("method", "tol", "certain"),
    [
        ("auto", None, 1e-5),
        pytest.param("collocation", None, 1e-5, marks=pytest.mark.heyoka),
        pytest.param("DOP853", None, 1e-3, marks=pytest.mark.heyoka),
        # Without heyoka one of the looser methods stands for all: what they know of the steps of a
        # reference is the same.
        pytest.param("LSODA", 1e-10, 1e-2, marks=pytest.mark.heyoka),
        ("RK45", 1e-8, 1.0),
        pytest.param("Radau", 1e-5, 1.0, marks=pytest.mark.heyoka),
        pytest.param("BDF", 1e-5, 1.0, marks=pytest.mark.heyoka),
    ],
)
def test_a_pair_of_crossings_is_found_or_undecided(
    tangents: list[Tangent], method: str, tol: float | None, certain: float
) -> None:
    """Down to a distance of `certain` the list is right and nothing is said: a pair is as deep as
    the square of its distance, and the error of the method is some digits smaller."""
    assert tangents
    for t in tangents:
        start = dict(zip("pqr", t.start, strict=True)) | {"G": None}
        data = {"inertia": t.A, "resistance": t.I, "initial": start}
        time = Time(end=t.end, samples=7)
        _, found = classified(Case("near", "tensor", "full", data, time, method=method, tol=tol))
        right = [(c.start, c.end) for c in found.crossings] == [
            (c.before, c.after) for c in t.crossings
        ]
        assert right or any("undecided" in w for w in found.warnings), t
        if abs(t.separation) >= certain:
            assert right, t
            assert not found.warnings, t
        if right:
            check_times(found, t.crossings)


def check_times(found: Any, truth: list[series.Crossing]) -> None:
    """The stated error of a time is the distance from the reference: 3 leaves it its own error."""
    for ours, theirs in zip(found.crossings, truth, strict=True):
        assert abs(ours.time - theirs.time) <= 3 * ours.error


def test_pairs_after_a_stiff_transient(hodo: Hodo, tmp_path: Path) -> None:
    """p and r settle within 1e-3 and then swing with q, of which D hangs on the last part: pairs
    0.0015 apart, in steps of collocation 0.3 long."""
    resistance = [
        [1651.39174312, -3.95411522936, -5504.58247706],
        [-0.733944954128, 0.0182018348624, -0.220183486239],
        [-3302.74899083, 10.0882469725, 11009.1753028],
    ]
    start = {"initial": {"p": 0.010009, "q": 0.003, "r": 0.003}, "time": {"end": 20, "samples": 5}}
    case = {"model": "tensor", "inertia": [1, 0.8, 0.6], "resistance": resistance, **start}
    (tmp_path / "a.yaml").write_text(json.dumps({"cases": {"pairs": case}}))
    assert hodo("run", "a.yaml").returncode == 0
    (row,) = json.loads(hodo("classify", "a.yaml", "--json").stdout)
    # From the independent series, in 160 bits.
    expected = [1.28287479632829393691, 1.28434864106688776883, 4.42153331366241129318]
    expected += [4.42300716374650908777, 7.5658876493152930209]
    assert not row["warnings"]
    passed = [(crossing["from"], crossing["to"]) for crossing in row["crossings"]]
    assert passed == [("x1", "x3"), ("x3", "x1")] * 6
    found = [crossing["time"] for crossing in row["crossings"]]
    assert found[:5] == pytest.approx(expected, rel=1e-12)
    # The table has the first ones and the last.
    assert "7 more (--json lists them); " in hodo("classify", "a.yaml").stdout
