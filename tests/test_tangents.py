"""Motions whose D almost touches zero: the list of crossings is right, or said to be undecided."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import series
from conftest import Hodo, classified

from hodo_cli import Case
from hodo_cli.cases.case import Time

SEPARATIONS = [*(10.0**-n for n in range(2, 11)), -1e-3, -1e-6, -1e-8]
BODIES = [
    ([0.5482075441764813, 1.0, 0.7584568324742226],
     [[0.12359777273816759, -0.06243272139408059, 0.04172914181030549],
      [-0.06243272139408059, 0.1568338239821561, 0.0],
      [0.04172914181030549, 8.758996287535583e-05, 0.017671600676017897]],
     [0.8921365761271688, -0.6253102840464697, -0.989800940133891], 1.9887365739594198, (1, 2),
     [3.1770024727441383e-07, 6.00787987629392e-08, 5.750257637607001e-08, 5.747681415141113e-08,
      5.747655652916446e-08, 5.7476553952941995e-08, 5.747655392717977e-08, 5.747655392692215e-08,
      5.7476553926919575e-08, 5.487430893125087e-08, 5.7476551324674636e-08,
      5.7476553926659324e-08]),
    ([0.6767247674425503, 1.0, 0.8445491659936649],
     [[0.020735152430327107, -0.01135931235634819, 0.0],
      [-0.01135931235634819, 0.055589339219204635, -0.013347612470773424],
      [0.030829576712183997, -0.013347612470773424, 0.04644653001190145]],
     [-1.0477865770211674, 0.9948936599850478, -0.8915122760988898], 6.01870827861004, (0, 2),
     [4.5009751959141755e-08, 1.3673663404000898e-08, 1.3360301137014184e-08,
      1.3357167514206172e-08, 1.3357136177978079e-08, 1.3357135864615798e-08,
      1.3357135861482175e-08, 1.335713586145084e-08, 1.3357135861450525e-08,
      1.3040608290989427e-08, 1.3357135544922967e-08, 1.335713586141887e-08]),
]  # fmt: skip
"""Moments, tensor, start and horizon of motions, tuned in 160 bits: the entry of the tensor that is
named has one value for each separation of a pair of crossings. There is none where that is
negative, and D stays as far from 0 as it would pass it by."""


class Tangent(NamedTuple):
    """A case without its method, its crossings, and how far apart the tuned pair is."""

    data: dict[str, Any]
    end: float
    crossings: list[series.Crossing]
    separation: float


@pytest.fixture(scope="module")
def tangents() -> list[Tangent]:
    """The same motions for every method."""
    found = []
    for A, rows, start, end, (i, j), entries in BODIES:
        initial = dict(zip("pqr", start, strict=True)) | {"G": None}
        for separation, entry in zip(SEPARATIONS, entries, strict=True):
            I = [[entry if (k, n) == (i, j) else rows[k][n] for n in range(3)] for k in range(3)]
            crossings = series.crossings(A, series.tensor(A, I), start, end, bits=160)
            data = {"inertia": tuple(A), "resistance": tuple(map(tuple, I)), "initial": initial}
            found.append(Tangent(data, end, crossings, separation))
    return found


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
def test_a_pair_of_crossings_is_found_or_undecided(tangents, method, tol, certain):
    """Down to a distance of `certain` the list is right and nothing is said: a pair is as deep as
    the square of its distance, and the error of the method is some digits smaller."""
    for t in tangents:
        time = Time(end=t.end, samples=7)
        _, found = classified(Case("near", "tensor", "full", t.data, time, method=method, tol=tol))
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
