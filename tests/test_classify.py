"""Labels and crossings, at every scale, whatever the sampling and the engine."""

import json
import math
import re
from fractions import Fraction
from itertools import permutations
from pathlib import Path
from typing import Any

import conftest
import h5py
import numpy as np
import pytest
import xarray as xr
from conftest import FIG4, Hodo, call
from hypothesis import given
from hypothesis import strategies as st

import hodo_cli
from hodo_cli import Case
from hodo_cli.integration import crossings
from hodo_cli.models import rigid_body

BODY = (1.0, 0.8, 0.6)
# Of Fig 4, for the doubles nearest to its decimals; tests/data/crossings.csv.
CROSSING = 305.3589551667112034886
UNDETERMINED, SEPARATRIX = -1, 0
"""The labels that are no axis."""


def diagonal(damping: Any, start: tuple[float, ...], **more: Any) -> xr.Dataset:
    """The motion of a damped body, to t = 1000 unless another time is given."""
    initial = dict(zip("pqr", start, strict=True))
    return hodo_cli.run(FIG4 | {"damping": damping, "initial": initial} | more)


def labels_of(motion: xr.Dataset) -> set[int]:
    return {*motion.enclosed_axis.values.tolist()}


def crossings_of(motion: xr.Dataset) -> list[tuple[int, int]]:
    """The axes before and after each crossing."""
    ends = (motion[f"crossing_{side}"].values.tolist() for side in ("from", "to"))
    return [*zip(*ends, strict=True)]


ON_SEPARATRIX = (math.sqrt(0.6), 0.3, 1.0)
"""D = 0.2 p^2 - 0.12 r^2 is 0 but for the rounding of the root."""


# Without damping, or with equal one, D stays at a few ulps for ever, and its sign is noise.
@pytest.mark.parametrize(
    ("damping", "end"),
    [(0, SEPARATRIX), (0.01, SEPARATRIX), ((0.005, 0.004, 0.003), 3), ((0.003, 0.004, 0.005), 1)],
)
def test_a_start_on_the_separatrix_is_no_crossing(damping: Any, end: int) -> None:
    motion = diagonal(damping, ON_SEPARATRIX)
    assert not crossings_of(motion)
    assert motion.enclosed_axis.values[0] == SEPARATRIX
    assert end in (SEPARATRIX, motion.enclosed_axis.values[-1])


@pytest.mark.parametrize("error", ["on", "off"])
def test_rotation_about_the_middle_axis_is_the_separatrix(error: str) -> None:
    assert labels_of(diagonal(0.01, (0.0, 1.0, 0.0), error=error)) == {SEPARATRIX}


@pytest.mark.parametrize(
    ("inertia", "start", "label"),
    [
        ((1.0, 0.8, 0.8), (0.1, 0.5, 0.5), 1),
        ((1.0, 0.8, 0.8), (0.0, 0.5, 0.5), UNDETERMINED),
        ((1.0, 1.0, 0.6), (0.5, 0.5, 0.1), 3),
        ((1.0, 1.0, 0.6), (0.5, 0.5, 0.0), UNDETERMINED),
        ((1.0, 1.0, 1.0), (0.5, 0.5, 0.5), UNDETERMINED),
        ((0.8, 1.0, 0.6), (0.1, 0.9, 0.1), 2),
        ((0.8, 0.6, 1.0), (0.1, 0.9, 0.1), 2),
        (BODY, (0.0, 0.0, 0.0), UNDETERMINED),
    ],
)
def test_labels_name_the_body_axes_as_given(inertia, start, label):
    assert labels_of(diagonal(0.001, start, inertia=inertia)) == {label}


def test_labels_go_on_below_the_smallest_double() -> None:
    # exp(-1.2 * 650) is 1e-339.
    time = {"end": 650, "samples": 66}
    motion = diagonal((1.2, 1.2, 1.2 - 2**-40), (0.8, 0.3, 0.2), time=time)
    assert not motion.omega.values[-1].any()
    assert labels_of(motion) == {1}


@pytest.mark.parametrize(
    ("keys", "bound"),
    [
        *(({"time": {"end": 1000, "samples": samples}}, 1e-10) for samples in (1, 2, 17, 5001)),
        ({"method": "DOP853"}, 1e-11),
        *(({"method": method}, 1e-6) for method in ("RK45", "LSODA")),
        ({"method": "Radau", "tol": 1e-7}, 1e-6),
    ],
)
def test_a_crossing_depends_on_no_sampling_and_no_engine(keys, bound):
    """To the bound of the method, and to the error that is stated."""
    motion = hodo_cli.run({**FIG4, "time": {"end": 400, "samples": 3}, **keys})
    assert crossings_of(motion) == [(1, 3)]
    bound = 1e-12 if motion.attrs["method"] == "taylor" else bound
    assert motion.crossing_time.item() == pytest.approx(CROSSING, rel=bound)
    off = abs(motion.crossing_time.item() - CROSSING)
    assert off <= 2 * motion.crossing_error.item() + 1e-13 * CROSSING


def test_a_motion_that_comes_back_between_the_places_looked_at_has_crossed_twice() -> None:
    # It encloses x3 at each of its two samples and of the 513 other times.
    torque = {"model": "torques", "torque": [0.5, 0.6, 0.9], "time": {"end": 2000, "samples": 2}}
    motion = diagonal(0.7, (0.5, 0.8, -0.9), **torque)
    assert motion.enclosed_axis.values.tolist() == [3, 3]
    assert crossings_of(motion) == [(3, 1), (1, 3)]
    assert np.allclose(motion.crossing_time, [0.1153054, 1.0613031], rtol=1e-6)
    assert (motion.crossing_error.values < 1e-12).all()


TOUCH = [0.5, None, -1e-16, None, 0.5, None, 1e-16]
LEAVE = [0.5, None, -0.5, 1e-16, -0.5, 0.0]
MOMENTS: list[tuple[list[float | None], tuple[int, ...], list[tuple[int, int]], int]] = [
    # A zero that is reported twice or never is one crossing.
    *(([0.5, *[None] * roots, -0.5], (), [(1, 3)], 0) for roots in range(4)),
    # A pair of zeros is two crossings, or undecided.
    ([0.5, None, -1e-12, None, 0.5], (), [(1, 3), (3, 1)], 0),
    ([0.5, None, -1e-16, None, 0.5], (), [], 1),
    ([0.5, 1e-12, 0.5], (), [], 0),
    ([0.5, 1e-16, 0.5], (), [], 1),
    # A start or an end on the separatrix is no crossing.
    ([0.0, 0.5], (), [], 0),
    ([None, 0.5, None, -0.5], (), [(1, 3)], 0),
    ([0.5, None, -1e-17], (), [], 1),
    # An axis that is never left decides what the error hides.
    (TOUCH, (), [], 2), (TOUCH, (1,), [], 0), (TOUCH, (1, 3), [], 0), (TOUCH, (3,), [], 1),
    (LEAVE, (), [(1, 3)], 2), (LEAVE, (3,), [(1, 3)], 0),
    # What cannot be is the error's doing, and is shown as it was found.
    (LEAVE, (1,), [(1, 3)], 2),
    # A passage through a stretch of rounding is one crossing.
    ([0.5, 1e-17, None, -1e-17, None, 1e-17, None, -0.5], (), [(1, 3)], 0),
]  # fmt: skip
"""D / (sum of its terms) at whole times, None marking a zero; the axes that are never left; the
crossings; how many places are undecided."""


def read(margins: list[float | None], error: float = 1e-15, **more: Any) -> Any:
    """What moments with these margins say; the axis of largest inertia is x1, of smallest x3."""
    margin = np.array([0.0 if value is None else value for value in margins])
    vanishes, ones = np.array([value is None for value in margins]), np.ones(len(margins))
    rate, side = more.pop("rate", ones), np.where(margin > 0, 1, 3)
    times = np.arange(len(margin), dtype=float)
    signs = crossings.SignChanges(times, margin, vanishes, rate, ones, side)
    return crossings.read_sign_changes(signs, error * ones, **more)


@pytest.mark.parametrize(("margins", "never_left", "expected", "undecided"), MOMENTS)
def test_moments_make_crossings(margins, never_left, expected, undecided):
    verdict = read(margins, absorbing=frozenset(never_left))
    assert [(c.start, c.end) for c in verdict.crossings] == expected
    assert len(verdict.undecided) == undecided


def test_times_of_crossings_and_of_what_is_undecided() -> None:
    # A time is known as far as the error allows.
    assert read([0.5, None, -0.5], 1e-3, rate=np.array([0.0, 0.25, 0.0])).widths == [4e-3]
    # The last moment beyond its band is that of time 2; the zero before it is a crossing.
    verdict = read([0.5, None, -0.5, 1e-4, 2e-4], 1e-3)
    assert [c.time for c in verdict.crossings] == [1.0]
    assert verdict.undecided == [3.0]


@given(
    st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3),
    st.permutations([1.0, 0.8, 0.6]),
    st.integers(-900, 900),
)
def test_a_label_is_the_sign_of_the_separatrix_function(omega, inertia, exponent):
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
    # Near the middle axis D stands out of the noise only after the crossing.
    body = (0.999999, 0.4722878378595431, 1.0)
    start = (0.6660700208488779, 4.4023755025267474e-10, 2.1978022028665094e-07)
    damping = (0.0020559210260287066, 0.00413584962737225, 0.0018788737484742401)
    motion = diagonal(damping, start, inertia=body, time={"end": 20, "samples": 11})
    assert motion.enclosed_axis.values[[0, -1]].tolist() == [2, 3]
    assert crossings_of(motion) == [(2, 3)]


@pytest.mark.heyoka
def test_a_motion_that_ends_early_is_labelled_as_far_as_both_integrations_go() -> None:
    # The second integration of a growing motion stops some steps earlier.
    case = {"model": "tensor", "inertia": BODY, "resistance": [[-10, 0, 0], [0, 1, 0], [0, 0, 2]]}
    start = {"initial": {"p": 1, "q": 0, "r": 0}, "time": {"end": 100, "samples": 2001}}
    motion = hodo_cli.run(case | start)
    assert motion.attrs["status"] == "failed"
    assert 5 < motion.time.size < 2001
    assert labels_of(motion) == {1}


@pytest.mark.heyoka
def test_a_motion_that_dies_out_about_the_middle_axis_keeps_the_side_that_it_cannot_leave() -> None:
    # The sign of D becomes noise, but lambda1 > lambda3, and so there is no way back from x3.
    time, lam = {"end": 40, "samples": 41}, (30.0, 10.0, 20.0)
    motion = diagonal(lam, (0.7, 0.3, 0.3), time=time)
    assert crossings_of(motion) == [(1, 3)]
    assert motion.crossing_time.item() < 1
    assert {*motion.enclosed_axis.values[1:].tolist()} == {3}
    # The same as a tensor: an entry beside the diagonal, too small to matter, and no theory.
    rows = np.diag(np.multiply(lam, BODY))
    rows[0, 1] = rows[1, 0] = 1e-150
    given = {"model": "tensor", "inertia": BODY, "resistance": rows, "time": time}
    labels = hodo_cli.run(given | {"initial": {"p": 0.7, "q": 0.3, "r": 0.3}}).enclosed_axis.values
    assert {*labels[1:3].tolist()} == {3}
    assert {*labels[10:].tolist()} == {SEPARATRIX}


def test_a_margin_of_just_the_band_stands_on_neither_side() -> None:
    A, omega = np.array(BODY), np.array([0.8, 0.5, 1.03])
    band = abs(float(rigid_body.margin(A, omega, (0, 1, 2))))
    assert rigid_body.enclosed_axis(A, omega, band) == SEPARATRIX
    assert rigid_body.enclosed_axis(A, omega, math.nextafter(band, 0)) in (1, 3)


def test_a_motion_without_a_measured_error_is_compared_where_its_error_decides() -> None:
    motion = hodo_cli.run({**FIG4, "error": "off"})
    assert motion.crossing_time.item() == pytest.approx(CROSSING, rel=1e-9)
    assert math.isnan(motion.crossing_error.item())
    # Of a hundred tolerances of 1e-4 eight count: 0.08 of what D could be.
    loose = hodo_cli.run({**FIG4, "error": "off", "method": "DOP853", "tol": 1e-4})
    assert abs(loose.crossing_time.item() - CROSSING) <= 3 * loose.crossing_error.item()


@pytest.mark.parametrize("beside", [6.05412358e-10, 2.21898234e-09, 1e-8])
@pytest.mark.parametrize("part", [1e-2, 1e-6, -1e-2])
def test_rounding_makes_no_crossing_of_a_motion_that_turns_over(beside: float, part: float) -> None:
    """lambda1 = lambda3 forbids a crossing, but rounding takes more than D of D on the way."""
    on = math.sqrt(0.2 / 0.12) * beside
    motion = diagonal((1e-3, 5e-3, 1e-3), (beside, 1.0, on * (1 - part)), error="off")
    assert not crossings_of(motion)
    assert labels_of(motion) <= {0, 1 if part > 0 else 3}


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


@pytest.mark.parametrize("order", [*permutations(range(3))])
def test_what_begins_on_no_side_has_crossed_nothing_when_it_stands_on_one(order):
    """D < 0 for all t > 0 as p grows with t^7 and r with t^2."""
    inertia, torque = (1, 0.8, 0.6), ("0", "0.1*t**3", "0.01*t")
    body = {"inertia": [inertia[i] for i in order], "expression": [torque[i] for i in order]}
    time = {"end": 10, "samples": 11}
    ds = diagonal(0, (0, 0, 0), model="torques", time=time, **body)
    assert ds.attrs["classify_warnings"] == ""
    assert ds.crossing_time.size == 0
    assert ds.enclosed_axis[:2].values.tolist() == [UNDETERMINED, order.index(2) + 1]


def test_a_motion_with_a_rotor_encloses_no_axis_and_the_table_says_why(hodo, tmp_path):
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


def test_a_body_at_rest_under_a_torque_has_no_growth_of_a_tilt() -> None:
    motion = diagonal(0, (0, 0, 0), model="torques", torque=[0.1, 0, 0], time={"end": 10})
    assert "growth_rate" not in motion


def test_a_damaged_case_keeps_no_labels_from_the_others(hodo: Hodo, tmp_path: Path) -> None:
    body = "model: linear-diag, inertia: [3, 2, 1], initial: {p: 1, q: 0.2, r: 0.1}"
    cases = "".join(f"  {name}: {{{body}, time: {{end: 5}}}}\n" for name in "abcd")
    (tmp_path / "a.yaml").write_text(f"cases:\n{cases}")
    assert hodo("run", "a.yaml").returncode == 0
    path = tmp_path / "runs" / "a.h5"
    with h5py.File(path, "r+") as file:
        del file["a/time"]
        file["b"].attrs["case"] = "no: case"
        file["d/omega"][...] *= 1 + 1e-9
    done = hodo("classify", "runs/a.h5")
    assert done.returncode == 1
    assert re.search(r"^runs/a\.h5: a is damaged", done.stderr, re.MULTILINE)
    assert re.search(r"^runs/a\.h5: b: ", done.stderr, re.MULTILINE)
    assert re.search(r"^runs/a\.h5: d.*differs from its case", done.stderr, re.MULTILINE)
    with h5py.File(path) as file:
        assert [name for name in "abcd" if "enclosed_axis" in file[name]] == ["c"]


def resisted(rows: Any) -> dict[str, Any]:
    return {"model": "tensor", "resistance": rows}


def tensor(on: float, off: float) -> dict[str, Any]:
    return resisted({"diagonal": on, "off_diagonal": off})


@pytest.mark.parametrize(
    ("medium", "about_x1", "about_x3"),
    [
        ({"damping": [0.005, 0.004, 0.003]}, 0.0015, -0.0015),
        ({"damping": [0.003, 0.004, 0.005]}, -0.0015, 0.0015),
        (tensor(0.005, 0.005), -0.00229167, 0.00270833),
        (resisted([[0.005, 0, 0.005], [0, 0, 0], [0.005, 0, 0.005]]), 0.00083333, 0.00583333),
    ],
)
def test_the_rates_are_those_of_the_papers_media(medium, about_x1, about_x3):
    growth = hodo_cli.run(conftest.BODY | medium | {"time": {"end": 1}}).growth_rate.values
    assert growth[[0, 2]] == pytest.approx([about_x1, about_x3], abs=5e-9)
    assert np.isnan(growth[1])


def test_the_table_has_the_rates_by_axis_but_for_the_middle_one(tmp_path: Path) -> None:
    couple = {"size": 0.01, "direction": [0, 0, 1]}
    cases = {"damped": FIG4, "driven": FIG4 | {"model": "torques", "space_torque": couple}}
    (tmp_path / "a.yaml").write_text(json.dumps({"cases": cases}), encoding="utf-8")
    assert call(tmp_path, "run", "a.yaml", "--quiet").returncode == 0
    rows = json.loads(call(tmp_path, "classify", "a.yaml", "--json").stdout)
    rates = {"x1": pytest.approx(0.0015), "x3": pytest.approx(-0.0015)}
    assert [row["growth"] for row in rows] == [rates, {}]


@pytest.mark.parametrize("unit", [1e-14, 1, 1e14])
def test_what_feeds_energy_in_is_told_in_every_unit(unit: float) -> None:
    # Of a kernel rounding makes an eigenvalue of either sign.
    for on, off, told in ((5, 5, False), (1, 3, True), (-1, 0, True)):
        medium = tensor(on * unit, off * unit)
        warnings = Case.of(conftest.BODY | medium | {"time": {"end": 1}}).system.warnings
        assert any("not dissipative" in each for each in warnings) == told
