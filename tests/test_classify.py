"""Labels and crossings: what counts as one, at every scale, whatever the sampling and the
engine."""

import json
import math
import re
from dataclasses import replace
from fractions import Fraction
from itertools import permutations
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Hodo, classified
from hypothesis import given
from hypothesis import strategies as st

import hodo_cli
from hodo_cli import Case, HodoError, engines
from hodo_cli.cases.case import Time
from hodo_cli.commands.classify import crossings_line
from hodo_cli.integration import classify, crossings, integrate
from hodo_cli.models import rigid_body
from hodo_cli.results import layout

BODY = (1.0, 0.8, 0.6)
# Of Fig 4, for the doubles nearest to its decimals; tests/data/crossings.csv.
CROSSING = 305.3589551667112034886


def diagonal(
    damping: float | tuple[float, ...], start: tuple[float, ...], **common: object
) -> Case:
    inertia, time = common.pop("inertia", BODY), common.pop("time", Time(end=1000.0, samples=101))
    damping = damping if isinstance(damping, tuple) else (damping,) * 3
    data = {
        "inertia": inertia,
        "damping": damping,
        "initial": dict(zip("pqr", start, strict=True)) | {"G": None},
    }
    return Case(name="test", model="linear-diag", form="full", data=data, time=time, **common)  # type: ignore[arg-type]


def found(case: Case) -> Any:
    return classified(case)[1]


FIG4 = diagonal((0.005, 0.004, 0.003), (0.8, 0.5, 0.74))

ON_SEPARATRIX = (math.sqrt(0.6), 0.3, 1.0)
"""D = 0 but for the rounding of the root: D = A1(A1-A2) p^2 - A3(A2-A3) r^2 = 0.2 p^2 - 0.12
r^2."""


def test_rounding_makes_no_crossings() -> None:
    # D stays at a few ulps for ever here, and its sign is noise: heyoka alone reports dozens of
    # roots.
    for damping in (0.0, 0.01):
        case = diagonal(damping, ON_SEPARATRIX)
        classification = found(case)
        assert not classification.crossings
        assert classification.labels[0] == rigid_body.SEPARATRIX


@pytest.mark.parametrize(
    ("damping", "end"), [((0.005, 0.004, 0.003), 3), ((0.003, 0.004, 0.005), 1)]
)
def test_a_start_on_the_separatrix_is_no_crossing(damping: tuple[float, ...], end: int) -> None:
    classification = found(diagonal(damping, ON_SEPARATRIX))
    assert not classification.crossings
    assert (classification.labels[0], classification.labels[-1]) == (rigid_body.SEPARATRIX, end)


@pytest.mark.parametrize("error", ["on", "off"])
def test_rotation_about_the_middle_axis_is_the_separatrix(error: str) -> None:
    case = diagonal(0.01, (0.0, 1.0, 0.0), error=error)
    assert set(found(case).labels) == {rigid_body.SEPARATRIX}


@pytest.mark.parametrize(
    ("inertia", "start", "label"),
    [
        ((1.0, 0.8, 0.8), (0.1, 0.5, 0.5), 1),
        ((1.0, 0.8, 0.8), (0.0, 0.5, 0.5), rigid_body.UNDETERMINED),
        ((1.0, 1.0, 0.6), (0.5, 0.5, 0.1), 3),
        ((1.0, 1.0, 0.6), (0.5, 0.5, 0.0), rigid_body.UNDETERMINED),
        ((1.0, 1.0, 1.0), (0.5, 0.5, 0.5), rigid_body.UNDETERMINED),
        ((0.8, 1.0, 0.6), (0.1, 0.9, 0.1), 2),
        ((0.8, 0.6, 1.0), (0.1, 0.9, 0.1), 2),
        (BODY, (0.0, 0.0, 0.0), rigid_body.UNDETERMINED),
    ],
)
def test_labels_name_the_body_axes_as_given(
    inertia: tuple[float, ...], start: tuple[float, ...], label: int
) -> None:
    assert set(found(diagonal(0.001, start, inertia=inertia)).labels) == {label}


def test_labels_go_on_below_the_smallest_double() -> None:
    # exp(-1.2 * 650) is 1e-339.
    time = Time(end=650.0, samples=66)
    case = diagonal((1.2, 1.2, 1.2 - 2**-40), (0.8, 0.3, 0.2), time=time)
    motion, classification = classified(case)
    assert not motion.variables["omega"][-1].any()
    assert set(classification.labels) == {1}


@pytest.mark.parametrize("samples", [1, 2, 17, 5001])
def test_crossings_do_not_depend_on_the_sampling(samples: int) -> None:
    (crossing,) = found(replace(FIG4, time=Time(end=1000.0, samples=samples))).crossings
    bound = 1e-12 if engines.have_taylor() else 1e-10
    assert crossing.time == pytest.approx(CROSSING, rel=bound)
    assert (crossing.start, crossing.end) == (1, 3)


def test_the_start_is_that_of_the_motion_and_not_of_its_first_sample(
    hodo: Hodo, tmp_path: Path
) -> None:
    common = "model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003]"
    start = "initial: {p: 0.8, q: 0.5, r: 0.74}"
    cases = [
        f"  full{i}: {{{common}, {start}, time: {time}}}\n"
        for i, time in enumerate(("{values: [900, 950, 1000]}", "{end: 1000, samples: 1}"))
    ]
    (tmp_path / "a.yaml").write_text("cases:\n" + "".join(cases))
    assert hodo("run", "a.yaml").returncode == 0
    rows = json.loads(hodo("classify", "runs/a.h5", "--json").stdout)
    assert len(rows) == 2
    for row in rows:
        assert [row["start"], row["end"]] == ["x1", "x3"]
        assert [[c["from"], c["to"]] for c in row["crossings"]] == [["x1", "x3"]]


@pytest.mark.parametrize(
    ("method", "bound"), [("DOP853", 1e-11), ("RK45", 1e-6), ("LSODA", 1e-6), ("Radau", 1e-6)]
)
def test_every_engine_finds_the_same_crossing_to_its_own_error(method: str, bound: float) -> None:
    case = replace(FIG4, method=method, time=Time(end=400.0, samples=3))
    if method == "Radau":
        case = replace(case, tol=1e-7)
    (crossing,) = found(case).crossings
    assert crossing.time == pytest.approx(CROSSING, rel=bound)
    assert abs(crossing.time - CROSSING) <= 2 * crossing.error + 1e-13 * CROSSING


def test_a_stored_motion_that_is_not_the_case_s_is_refused() -> None:
    motion, _ = classified(FIG4)
    wrong = motion.variables["omega"] * (1 + 1e-9)
    with pytest.raises(HodoError, match="differs from its case"):
        classify(FIG4, motion.method, motion.tol, motion.error, wrong)


def test_a_motion_that_comes_back_between_the_places_looked_at_has_crossed_twice() -> None:
    # It encloses x3 at each of its two samples and of the 513 other times.
    case: dict[str, Any] = {
        "model": "torques",
        "inertia": BODY,
        "damping": 0.7,
        "torque": [0.5, 0.6, 0.9],
        "initial": {"p": 0.5, "q": 0.8, "r": -0.9},
        "time": {"end": 2000, "samples": 2},
    }
    motion = hodo_cli.run(case)
    assert motion.enclosed_axis.values.tolist() == [3, 3]
    assert motion.crossing_to.values.tolist() == [1, 3]
    assert np.allclose(motion.crossing_time, [0.1153054, 1.0613031], rtol=1e-6)
    assert (motion.crossing_error.values < 1e-12).all()


def test_labels_and_crossings_as_they_are_stored() -> None:
    crossing = crossings.Crossing(1.0, 1, 3, 0.5, 1e-12)
    variables = layout.label_variables(np.array([1, 3]), [crossing])
    label = variables["enclosed_axis"]
    assert label.attrs["flag_meanings"] == "undetermined separatrix x1 x2 x3"
    assert label.attrs["flag_values"].dtype == label.data.dtype == np.int8
    assert variables["crossing_from"].data.tolist() == [1]


# `read_sign_changes` by itself, on moments made by hand.


def side(margin: np.ndarray) -> np.ndarray:
    """The label where the axis of largest inertia is x1, and that of smallest x3."""
    return np.where(margin > 0, 1, 3)


def crossings_between(
    margins: list[float | None], absorbing: tuple[int, ...] = ()
) -> tuple[list[tuple[int, int]], int]:
    """The crossings, and how many places are undecided, when D / (sum of its terms) takes these
    values at whole times, None marking a zero, and the axes `absorbing` are never left."""
    margin = np.array([0.0 if value is None else value for value in margins])
    vanishes = np.array([value is None for value in margins])
    ones = np.ones(len(margin))
    signs = crossings.SignChanges(
        np.arange(len(margin), dtype=float), margin, vanishes, ones, ones, side(margin)
    )
    verdict = crossings.read_sign_changes(signs, 1e-15 * ones, frozenset(absorbing))
    return [(c.start, c.end) for c in verdict.crossings], len(verdict.undecided)


def test_a_zero_reported_twice_or_never_is_one_crossing() -> None:
    for roots in range(4):
        assert crossings_between([0.5, *[None] * roots, -0.5]) == ([(1, 3)], 0)


def test_a_pair_of_zeros_is_two_crossings_or_undecided() -> None:
    assert crossings_between([0.5, None, -1e-12, None, 0.5]) == ([(1, 3), (3, 1)], 0)
    assert crossings_between([0.5, None, -1e-16, None, 0.5]) == ([], 1)
    assert crossings_between([0.5, 1e-12, 0.5]) == ([], 0)
    assert crossings_between([0.5, 1e-16, 0.5]) == ([], 1)


def test_a_start_or_an_end_on_the_separatrix_is_no_crossing() -> None:
    assert crossings_between([0.0, 0.5]) == ([], 0)
    assert crossings_between([None, 0.5, None, -0.5]) == ([(1, 3)], 0)
    assert crossings_between([0.5, None, -1e-17]) == ([], 1)


def test_an_axis_that_is_never_left_decides_what_the_error_hides() -> None:
    touch, leave = [0.5, None, -1e-16, None, 0.5, None, 1e-16], [0.5, None, -0.5, 1e-16, -0.5, 0.0]
    assert crossings_between(touch) == ([], 2)
    # About x1 it is for good; about x3 the end may have brought it, but nothing before.
    assert crossings_between(touch, (1,)) == crossings_between(touch, (1, 3)) == ([], 0)
    assert crossings_between(touch, (3,)) == ([], 1)
    assert crossings_between(leave) == ([(1, 3)], 2)
    assert crossings_between(leave, (3,)) == ([(1, 3)], 0)
    # What cannot be is the error's doing, and is shown as it was found.
    assert crossings_between(leave, (1,)) == ([(1, 3)], 2)


def test_a_passage_through_a_stretch_of_rounding_is_one_crossing() -> None:
    assert crossings_between([0.5, 1e-17, None, -1e-17, None, 1e-17, None, -0.5]) == ([(1, 3)], 0)


def test_the_time_of_a_crossing_is_known_as_far_as_the_error_allows() -> None:
    margin, vanishes = np.array([0.5, 0.0, -0.5]), np.array([False, True, False])
    rate, ones = np.array([0.0, 0.25, 0.0]), np.ones(3)
    signs = crossings.SignChanges(np.arange(3.0), margin, vanishes, rate, ones, side(margin))
    assert crossings.read_sign_changes(signs, 1e-3 * ones).widths == [4e-3]


def test_what_is_undecided_in_the_end_is_named_by_its_own_time() -> None:
    # The last moment beyond its band is that of time 2; the zero before it is a crossing.
    margin = np.array([0.5, 0.0, -0.5, 1e-4, 2e-4])
    vanishes = np.array([False, True, False, False, False])
    signs = crossings.SignChanges(
        np.arange(5.0), margin, vanishes, np.ones(5), np.ones(5), side(margin)
    )
    verdict = crossings.read_sign_changes(signs, np.full(5, 1e-3))
    assert [c.time for c in verdict.crossings] == [1.0]
    assert verdict.undecided == [3.0]


@given(
    st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3),
    st.permutations([1.0, 0.8, 0.6]),
    st.integers(-900, 900),
)
def test_a_label_is_the_sign_of_the_separatrix_function(
    omega: list[float], inertia: list[float], exponent: int
) -> None:
    A, w = [Fraction(x) for x in inertia], [Fraction(x) for x in omega]
    momentum = sum((a * x) ** 2 for a, x in zip(A, w, strict=True))
    energy = sum(a * x * x for a, x in zip(A, w, strict=True))
    exact = momentum - energy * Fraction(0.8)
    terms = sum(abs(a * (a - Fraction(0.8))) * x * x for a, x in zip(A, w, strict=True))
    label = int(rigid_body.enclosed_axis(inertia, np.array(omega), 1e-15))
    if not terms > Fraction(10) ** -300:
        return
    most = sum(abs(a * (a - Fraction(0.8))) for a in A) * sum(x * x for x in w)
    if abs(exact) / terms * Fraction(math.sqrt(terms / most)) > Fraction(1, 10**14):
        assert label == 1 + inertia.index(1.0 if exact > 0 else 0.6)


@pytest.mark.heyoka
def test_the_side_of_the_start_is_that_of_its_label() -> None:
    # Near the middle axis D stands out of the noise only after the crossing, but the start itself
    # has no noise.
    body = (0.999999, 0.4722878378595431, 1.0)
    start = (0.6660700208488779, 4.4023755025267474e-10, 2.1978022028665094e-07)
    damping = (0.0020559210260287066, 0.00413584962737225, 0.0018788737484742401)
    classification = found(diagonal(damping, start, inertia=body, time=Time(end=20.0, samples=11)))
    assert (classification.labels[0], classification.labels[-1]) == (2, 3)
    assert [(c.start, c.end) for c in classification.crossings] == [(2, 3)]


@pytest.mark.heyoka
def test_a_motion_that_ends_early_is_labelled_as_far_as_both_integrations_go() -> None:
    # In units of its own at every event, the second integration of a growing motion stops some
    # steps earlier.
    data = {
        "inertia": BODY,
        "resistance": ((-10.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0)),
        "initial": {"p": 1.0, "q": 0.0, "r": 0.0, "G": None},
    }
    case = Case(
        name="test", model="tensor", form="full", data=data, time=Time(end=100.0, samples=2001)
    )
    motion, classification = classified(case)
    assert motion.status == "failed"
    assert classification.labels.shape == motion.time.shape
    few = classify(case, motion.method, motion.tol, motion.error, motion.variables["omega"][:5])
    assert few.labels.tolist() == [1] * 5


@pytest.mark.heyoka
def test_a_motion_that_dies_out_about_the_middle_axis_keeps_the_side_that_it_cannot_leave() -> None:
    # p and r fall to 1e-16 of q at a time of about 3, and far below the smallest double: the sign
    # of D is noise. But lambda1 > lambda3, and so there is no way back from x3.
    case = diagonal((30.0, 10.0, 20.0), (0.7, 0.3, 0.3), time=Time(end=200.0, samples=201))
    classification = found(case)
    assert [(c.start, c.end) for c in classification.crossings] == [(1, 3)]
    assert classification.crossings[0].time < 1
    assert set(classification.labels[1:]) == {3}


@pytest.mark.heyoka
def test_without_a_side_that_it_cannot_leave_a_motion_that_dies_out_keeps_none() -> None:
    # The same as a tensor: an entry beside the diagonal, too small to matter, and no theory.
    lam, A = (30.0, 10.0, 20.0), BODY
    I = tuple(
        tuple(lam[i] * A[i] if i == j else 1e-300 * (i + j == 1) for j in range(3))
        for i in range(3)
    )
    initial = {"p": 0.7, "q": 0.3, "r": 0.3, "G": None}
    data = {"inertia": A, "resistance": I, "initial": initial}
    labels = found(Case("dying", "tensor", "full", data, Time(end=200.0, samples=201))).labels
    assert set(labels[1:3]) == {3}
    assert set(labels[10:]) == {rigid_body.SEPARATRIX}


def test_a_margin_of_just_the_band_stands_on_neither_side() -> None:
    A, omega = np.array(BODY), np.array([0.8, 0.5, 1.03])
    band = abs(float(rigid_body.margin(A, omega, (0, 1, 2))))
    assert rigid_body.enclosed_axis(A, omega, band) == rigid_body.SEPARATRIX
    assert rigid_body.enclosed_axis(A, omega, math.nextafter(band, 0)) in (1, 3)


def test_a_motion_without_a_measured_error_is_compared_where_its_error_decides() -> None:
    case = diagonal((0.005, 0.004, 0.003), (0.8, 0.5, 0.74), error=False)
    motion = integrate(case)
    found = classify(case, motion.method, motion.tol, math.nan, motion.variables["omega"])
    (crossing,) = found.crossings
    assert crossing.time == pytest.approx(CROSSING, rel=1e-9)
    assert math.isnan(crossing.error)
    # Of a hundred tolerances of 1e-4 eight count: 0.08 of what D could be.
    loose = replace(case, method="DOP853", tol=1e-4)
    motion = integrate(loose)
    found = classify(loose, "DOP853", 1e-4, math.nan, motion.variables["omega"])
    (crossing,) = found.crossings
    assert abs(crossing.time - CROSSING) <= 3 * crossing.error


@pytest.mark.parametrize("beside", [6.05412358e-10, 2.21898234e-09, 1e-8])
@pytest.mark.parametrize("part", [1e-2, 1e-6, -1e-2])
def test_rounding_makes_no_crossing_of_a_motion_that_turns_over(beside: float, part: float) -> None:
    """lambda1 = lambda3 forbids a crossing. The motion comes back to the middle axis, where what
    rounding took from D on the way is larger than D; nobody has measured that."""
    on = math.sqrt(0.2 / 0.12) * beside
    start = (beside, 1.0, on * (1 - part))
    case = diagonal((1e-3, 5e-3, 1e-3), start, error=False)
    motion = integrate(case)
    found = classify(case, motion.method, motion.tol, math.nan, motion.variables["omega"])
    assert not found.crossings
    assert set(found.labels.tolist()) <= {0, 1 if part > 0 else 3}


def test_the_side_of_a_state_is_told_by_the_digits_that_it_has() -> None:
    """Beside states far from the separatrix, some that a double would put on it."""
    A = np.array([1.0, 0.8, 0.6])
    order = rigid_body.inertia_order(A)
    a, b = rigid_body.separatrix_roots(A.astype(np.longdouble), order)
    off = np.array([1e-18, -1e-18, 1e-10, 0.1], dtype=np.longdouble)
    across = b / a * (1 + off)
    omega = np.stack([across, np.full(4, 0.5), np.ones(4)], axis=-1)
    found = rigid_body.margin(A, omega, order)
    w = omega[:, 0] ** 2 + omega[:, 1] ** 2 + omega[:, 2] ** 2
    outer, inner = (a * omega[:, 0]) ** 2, (b * omega[:, 2]) ** 2
    exact = (outer - inner) / np.sqrt((outer + inner) * (a * a + b * b) * w)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, exact.astype(float), rtol=0.1, atol=0)
    np.testing.assert_allclose(found[3], float(exact[3]), rtol=1e-14)
    assert rigid_body.margin(A, omega[1], order) == found[1]


def test_of_many_crossings_a_table_shows_the_first_ones_and_the_last() -> None:
    crossings = [{"time": float(t), "from": "x1", "to": "x3", "error": 1e-14} for t in range(30)]
    for n, expected in ((5, "0 1 2 3 4"), (6, "0 1 2 3 more 5"), (30, "0 1 2 3 more 29")):
        row = {"case": "a", "start": "x1", "end": "x3", "crossings": crossings[:n], "warnings": []}
        told = crossings_line(row)[-1].split("; ")
        shown = ["more" if "more" in each else each.split()[0] for each in told]
        assert " ".join(shown) == expected
    assert told[4] == "25 more (--json lists them)"


@pytest.mark.parametrize("order", [*permutations(range(3))])
def test_what_begins_on_no_side_has_crossed_nothing_when_it_stands_on_one(
    order: tuple[int, int, int],
) -> None:
    """D < 0 for all t > 0 as p grows with t^7 and r with t^2."""
    inertia, torque = (1, 0.8, 0.6), ("0", "0.1*t**3", "0.01*t")
    ds = hodo_cli.run(
        {
            "model": "torques", "inertia": [inertia[i] for i in order],
            "expression": [torque[i] for i in order], "initial": dict.fromkeys("pqr", 0),
            "time": {"end": 10, "samples": 11},
        }
    )  # fmt: skip
    assert ds.attrs["classify_warnings"] == ""
    assert ds.crossing_time.size == 0
    assert ds.enclosed_axis[:2].values.tolist() == [rigid_body.UNDETERMINED, order.index(2) + 1]


def test_a_motion_with_a_rotor_encloses_no_axis_and_the_table_says_why(
    hodo: Hodo, tmp_path: Path
) -> None:
    """In a case, whatever D does, and in the members of a sweep."""
    body = (
        "model: torques, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003], "
        "rotor: [0, 0, 0.2], initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 300, samples: 31}"
    )
    (tmp_path / "a.yaml").write_text(
        f"cases:\n  one: {{{body}}}\n"
        f"  many: {{{body}, sweep: {{rotor.2: {{values: [0.1, 0.2]}}}}}}\n"
    )
    assert hodo("run", "a.yaml").returncode == 0
    rows = json.loads(hodo("classify", "runs/a.h5", "--json").stdout)
    words = "with a rotor D says nothing, and the enclosed axis is undetermined"
    one, many = rows
    assert (one["start"], one["end"], one["crossings"]) == ("undetermined", "undetermined", [])
    assert one["predictions"] == many["warnings"] == [words]
    with h5py.File(tmp_path / "runs" / "a.h5") as file:
        assert (file["one/enclosed_axis"][:] == -1).all()
        assert file["one/crossing_time"].size == 0
        for name in ("start_axis", "end_axis"):
            assert file[f"many/{name}"][:].tolist() == [-1, -1]


def test_a_body_at_rest_under_a_torque_has_no_growth_of_a_tilt(hodo: Hodo, tmp_path: Path) -> None:
    body = "model: torques, inertia: [3, 2, 1], torque: [0.1, 0, 0], initial: {p: 0, q: 0, r: 0}"
    (tmp_path / "a.yaml").write_text(f"cases:\n  a: {{{body}, time: {{end: 10}}}}\n")
    assert hodo("run", "a.yaml").returncode == 0
    done = hodo("classify", "a.yaml", "--json")
    assert "inf" not in done.stdout.lower()
    (row,) = json.loads(done.stdout)
    assert "x1" not in row["growth"]


def test_a_damaged_case_keeps_no_labels_from_the_others(hodo: Hodo, tmp_path: Path) -> None:
    body = "model: linear-diag, inertia: [3, 2, 1], initial: {p: 1, q: 0.2, r: 0.1}"
    cases = "".join(f"  {name}: {{{body}, time: {{end: 5}}}}\n" for name in "abc")
    (tmp_path / "a.yaml").write_text(f"cases:\n{cases}")
    assert hodo("run", "a.yaml").returncode == 0
    path = tmp_path / "runs" / "a.h5"
    with h5py.File(path, "r+") as file:
        del file["a/time"]
        file["b"].attrs["case"] = "no: case"
    done = hodo("classify", "runs/a.h5")
    assert done.returncode == 1
    assert re.search(r"^runs/a\.h5: a is damaged", done.stderr, re.MULTILINE)
    assert re.search(r"^runs/a\.h5: b: ", done.stderr, re.MULTILINE)
    with h5py.File(path) as file:
        assert [name for name in "abc" if "enclosed_axis" in file[name]] == ["c"]
