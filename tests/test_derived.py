"""Quantities that follow from what is stored: named in case files, asked of datasets, in
statements and of sweeps."""

import json
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import Hodo
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import hodo_cli
from hodo_cli import HodoError
from hodo_cli.cases.config import parse
from hodo_cli.cases.derived import COMPONENTS, DERIVED

BODY: dict[str, Any] = {
    "model": "torques",
    "inertia": [1, 0.8, 0.6],
    "damping": 0.003,
    "kappa": 0.02,
    "attitude": "yes",
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
    "time": {"end": 20, "samples": 101, "unit": "s"},
    "inertia_unit": "kg m^2",
}
NO_TOP = [name for name in DERIVED if name not in ("Gz", "H", "u1", "u2", "u3")]


def test_what_is_stored_is_what_is_derived() -> None:
    whole = hodo_cli.run(BODY)
    stored = hodo_cli.run({**BODY, "store": NO_TOP})
    derived = hodo_cli.derive(whole, *NO_TOP)
    assert "omega" not in stored
    assert stored.attrs["error"] == whole.attrs["error"]
    for name in NO_TOP:
        np.testing.assert_array_equal(stored[name], derived[name])
        assert stored[name].dims == derived[name].dims
        assert stored[name].attrs == derived[name].attrs
    assert stored.G_space.attrs["units"] == "kg m^2/s"
    turned = Rotation.from_quat(whole.attitude.data, scalar_first=True)
    G = turned.apply(whole.omega.data * BODY["inertia"])
    np.testing.assert_allclose(stored.G_space, G, atol=1e-15)
    np.testing.assert_allclose(Rotation.from_rotvec(stored.rotation.data).as_matrix(),
                               turned.as_matrix(), atol=1e-14)  # fmt: skip
    # What is stored alone is drawn alone.
    hodo_cli.plot(stored, kind="series", variables=["G_space.z", "rotation.x", "psi", "T"])


def test_a_file_holds_them(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    hodo_cli.run({**BODY, "store": ["G_space", "psi"]}, to=path)
    data = hodo_cli.open(path)["case"]
    assert data.G_space.dims == ("time", "space")
    assert [*data.space.data] == ["x", "y", "z"]
    assert {*data.data_vars} >= {"G_space", "psi"}


def test_of_a_sweep_they_are_those_of_its_members() -> None:
    """Over bodies, whose momenta differ, and over starts."""
    ranges = {
        "inertia.2": {"values": [0.6, 0.7]},
        "initial.p": {"values": [0.5, 0.8, 0.9]},
        "kappa": {"values": [0.01, 0.02]},
    }
    case = {**BODY, "attitude": {"align": "G"}}
    names = ["total_space", "x3_space", "psi", "T", "rotation"]
    swept = hodo_cli.derive(hodo_cli.sweep({**case, "sweep": ranges}), *names)
    for i, j, k in np.ndindex(2, 3, 2):
        values = [entry["values"][n] for entry, n in zip(ranges.values(), (i, j, k), strict=True)]
        one = {
            **case,
            "inertia": [1, 0.8, values[0]],
            "initial": {**case["initial"], "p": values[1]},
            "kappa": values[2],
        }
        single = hodo_cli.derive(hodo_cli.run(one, classify=False), *names).isel(time=-1)
        member = swept.isel({"inertia.2": i, "initial.p": j, "kappa": k})
        for name in names:
            off = np.asarray(member[name] - single[name])
            # An angle of a member is at most half a turn.
            off = np.angle(np.exp(1j * off)) if name == "psi" else off
            assert np.abs(off).max() < 1e-12, name


SWEPT = """
cases:
  one: {model: linear-diag, inertia: [1, 0.8, 0.6], attitude: {align: G}, time: {end: 30},
        initial: {p: 0.8, q: 0.5, r: 0.74}}
  some: {model: linear-diag, inertia: [1, 0.8, 0.6], attitude: {align: G}, time: {end: 30},
         initial: {p: 0.8, q: 0.5, r: 0.74}, sweep: {initial.p: {linspace: [0.7, 0.8, 3]}}}
figures:
  parts: {kind: curve, cases: some, variable: attitude.a, x: initial.p}
  axis: {kind: curve, cases: some, variable: x3_space.z, x: initial.p}
claims:
"""


@pytest.mark.parametrize("check", [
    "{kind: conserved, of: [G_space.z]}", "{kind: monotone, of: [psi], sense: rises}",
    "{kind: bound, of: theta, at: always, least: 0, most: 3}",
])  # fmt: skip
def test_statements_and_maps_of_what_moves_in_space(tmp_path: Path, check: str, hodo: Hodo) -> None:
    claim = f"{{id: a, where: b, statement: c, cases: [one], check: {check}, expect: reproduced}}"
    (tmp_path / "a.yaml").write_text(f"{SWEPT}  - {claim}\n")
    for command in ("run", "claims", "plot"):
        done = hodo(command, "a.yaml")
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "figures" / "a" / "axis.png").exists()


@pytest.mark.parametrize(("case", "message"), [
    ("store: [psi]",
     "case.store.0: psi needs attitude, which this case does not have: write `attitude: yes`"),
    ("attitude: yes, store: [omega, total_space]",
     "case.store.1: total_space needs kappa, which this case does not have"),
    ("attitude: yes, store: [G_spac]", "unknown variable 'G_spac'; did you mean 'G_space'?"),
    ("attitude: yes, store: [psi], sweep: {initial.p: {values: [1, 2]}}",
     "case.store.0: figures and averages derive psi of what a sweep stores"),
    ("attitude: {euler: [0, 0, 0], initial: [1, 0, 0, 0]}",
     "case.attitude: give one of initial, euler and align, not initial and euler"),
    ("attitude: {align: G, sequence: xyz}",
     "case.attitude.sequence: orders the angles of `euler`, which is not there"),
    ("attitude: 3", "case.attitude: expected yes or no, or a mapping of initial, euler, sequence"),
    ("attitude: 3, store: [omega, attitude]", "case.attitude: expected yes or no, or a mapping"),
])  # fmt: skip
def test_what_cannot_be_stored_is_named_when_the_file_is_read(case: str, message: str) -> None:
    body = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 2, r: 3}, time: {end: 1}"
    with pytest.raises(HodoError) as raised:
        parse(f"cases:\n  case: {{{body}, {case}}}\n", "a.yaml")
    assert message in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize(("entry", "message"), [
    ("figures: {f: {kind: series, cases: one, variables: [psi]}}",
     "figures.f.variables.0: case one has no attitude, which psi needs: write `attitude: yes`"),
    ("figures: {f: {kind: series, cases: one, variables: [G], formula: {G: T + psi}}}",
     "figures.f.formula.G: case one has no attitude, which psi needs: write `attitude: yes`"),
    ("figures: {f: {kind: series, cases: moves, variables: [total_space.x]}}",
     "figures.f.variables.0: case moves has no kappa, which total_space.x needs"),
    ("figures: {f: {kind: series, cases: moves, variables: [G_space]}}",
     "G_space is a vector: name a component, G_space.x, G_space.y, G_space.z"),
    ("figures: {f: {kind: body, cases: moves, moments: [0, 31]}}",
     "figures.f.moments.1: 31 is no time of case moves, shown from 0 to 30"),
    ("figures: {f: {kind: body, cases: moves, span: [3, 5], moments: [1]}}",
     "figures.f.moments.0: 1 is no time of case moves, shown from 3 to 5"),
    ("claims: [{id: a, where: b, statement: c, cases: [one], expect: reproduced, check: "
     "{kind: conserved, of: [G_space.z]}}]",
     "claims.0.check: case one has no attitude, which G_space.z needs"),
    ("claims: [{id: a, where: b, statement: c, cases: [one], expect: reproduced, check: "
     "{kind: formula, of: G, formula: 1 + psi}}]",
     "claims.0.check: case one has no attitude, which psi needs"),
    ("figures: {f: {kind: series, cases: moves, variables: [G_space.q]}}",
     "figures.f.variables.0: unknown component 'q' of G_space (valid: x, y, z)"),
    ("figures: {f: {kind: body, cases: few}}",
     "figures.f.cases.0: case few has no attitude and omega, which body needs: write "
     "`attitude: yes`, and attitude and omega in its `store:`"),
])  # fmt: skip
def test_what_cannot_be_derived_is_named_when_the_file_is_read(entry: str, message: str) -> None:
    body = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 2, r: 3}"
    body += ", time: {end: 30}"
    cases = f"cases:\n  one: {{{body}}}\n  moves: {{{body}, attitude: yes}}\n"
    cases += f"  few: {{{body}, store: [T]}}\n"
    with pytest.raises(HodoError) as raised:
        parse(f"{cases}{entry}\n", "a.yaml")
    assert message in str(raised.value)


def test_a_curve_of_the_body_in_space_is_named_by_symbols_and_degrees() -> None:
    case = {**BODY, "sweep": {"attitude.euler.1": {"values": ["10 deg", "30 deg"]}}}
    swept = hodo_cli.sweep(case)
    for variable, label in (("x3_space.z", "${x}_{3,z}$"), ("theta", r"$\theta$ [deg]")):
        axes = hodo_cli.plot(swept, kind="curve", variable=variable, x="attitude.euler.1").axes[0]
        assert axes.get_ylabel() == label
        assert axes.get_xlabel() == r"$\mathrm{Euler\ angle}_2$ [deg]"
        np.testing.assert_allclose(axes.lines[0].get_xdata(), [10, 30])


LACKING = """\
defaults:
  store: [psi]
  attitude: yes
cases:
  one: {BODY}
  some: {BODY, store: [omega], sweep: {initial.p: {values: [1, 2]}}}
"""


@pytest.mark.parametrize(("entry", "message"), [
    ("figures: {f: {kind: body, cases: one}}",
     "a.yaml:2:10: figures.f.cases.0: the `store:` of case one leaves out attitude and omega, "
     "which body needs"),
    ("figures: {f: {kind: hodograph, cases: one}}",
     "a.yaml:2:10: figures.f.cases.0: the `store:` of case one leaves out omega, which hodograph"),
    ("figures: {f: {kind: series, cases: one, variables: [omega.x1]}}",
     "a.yaml:2:10: figures.f.variables.0: the `store:` of case one leaves out omega, which"),
    ("figures: {f: {kind: curve, cases: some, variable: psi, x: initial.p}}",
     "a.yaml:6:106: figures.f.variable: the `store:` of case some leaves out attitude at the ends "
     "of members, which psi needs"),
    ("claims: [{id: a, where: b, statement: c, cases: [one], expect: reproduced, check: "
     "{kind: conserved, of: [T]}}]",
     "a.yaml:2:10: claims.0.check: the `store:` of case one leaves out omega, which T needs"),
])  # fmt: skip
def test_what_a_store_leaves_out_is_a_mistake_there(entry: str, message: str) -> None:
    body = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 2, r: 3}, time: {end: 1}"
    text = LACKING.replace("BODY", body) + entry
    with pytest.raises(HodoError) as raised:
        parse(text, "a.yaml")
    assert message in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1
    if "one" in entry:
        with pytest.raises(HodoError, match=r"^--set one.store=\[phi\]: (figures.f|claims.0)"):
            parse(text, "a.yaml", ["one.store=[phi]"])


def test_a_dataset_that_lacks_what_is_asked_of_it_says_so() -> None:
    free = hodo_cli.run({**BODY, "attitude": "no"})
    with pytest.raises(HodoError, match=r"^the case has no attitude, which psi needs: write"):
        hodo_cli.derive(free, "psi")
    with pytest.raises(HodoError, match="unknown quantity 'Gspace'; did you mean 'G_s") as raised:
        hodo_cli.derive(free, "Gspace")
    # What it names, it has.
    listed = str(raised.value).partition("(it has ")[2].rstrip(")").split(", ")
    assert {"T", "tilt"} <= {*listed}
    assert {*listed} <= {*hodo_cli.derive(free, *listed)}


@pytest.mark.parametrize(("change", "name", "message"), [
    (lambda ds: ds.sel(axis="x1"), "T", "the case has omega without its components"),
    (lambda ds: ds.sel(quaternion=["a", "c"]), "x3_space", "'quaternion' has a, c, and not each"),
    (lambda ds: ds.sel(quaternion="a"), "x3_space", "has an attitude that lacks a part"),
    (lambda ds: ds.drop_vars("quaternion"), "x3_space", "has no coordinate 'quaternion'"),
    (lambda ds: ds.where(ds.time > 10), "T", "its crossing_time has dimensions crossing, time"),
])  # fmt: skip
def test_a_dataset_that_lacks_parts_says_which(
    change: Callable[[xr.Dataset], xr.Dataset], name: str, message: str
) -> None:
    with pytest.raises(HodoError, match=message):
        hodo_cli.derive(change(hodo_cli.run(BODY)), name)


def test_every_component_belongs_to_a_quantity() -> None:
    assert {name.partition(".")[0] for name in COMPONENTS} == set(DERIVED)


@pytest.mark.parametrize(("start", "turn"), [
    ((0.8, 0.5, 0.74), (21.95563180039553, 30.43060357902780)),
    ((0.5, 0.25, 1.4), (14.97125982945529, 17.08344977001511)),
])  # fmt: skip
def test_a_free_body_stores_the_turn_of_its_hodograph(
    start: tuple[float, ...], turn: tuple[float, ...]
) -> None:
    """Against values of 20 digits by a Taylor series in 176 bits; about the axis of the largest
    moment and of the smallest, the branch of psi being that of the body's own turns after 2 pi."""
    case = {
        "model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": 0, "attitude": "yes",
        "initial": dict(zip("pqr", start, strict=True)), "time": {"values": [turn[0]]},
    }  # fmt: skip
    data = hodo_cli.run(case)
    names = ("turn_period", "turn_angle")
    assert [float(data[name]) for name in names] == pytest.approx(turn, rel=2e-15)
    assert f"the hodograph turns in {turn[0]:.9g}" in data.attrs["predictions"]
    # After it the attitude is a turn about G, by this angle.
    G = np.array(start) * case["inertia"]
    half = turn[1] / 2
    expected = -np.r_[np.cos(half), np.sin(half) * G / np.linalg.norm(G)]
    np.testing.assert_allclose(data.attitude[-1], expected, atol=1e-14)
    damped = hodo_cli.run({**case, "damping": 0.01})
    assert "turn_period" not in damped


@pytest.mark.parametrize(("start", "long"), [((1.5, 0.3, 0.5), 1), ((0.3, 0.3, 1.5), 0)])
def test_classify_says_in_what_time_the_axes_go_round_G(start: Any, long: int) -> None:
    """By the azimuth of an axis about G over 50 turns of the hodograph, by a Runge-Kutta method:
    about x1 the long axis x3 goes round a turn less each time."""
    A = np.array([3.22, 2.5, 1.0])
    data = hodo_cli.run({
        "model": "linear-diag", "inertia": A.tolist(), "damping": 0, "attitude": "yes",
        "initial": dict(zip("pqr", start, strict=True)), "time": {"end": 1},
    })  # fmt: skip
    period, angle = float(data.turn_period), float(data.turn_angle)

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        w, axes = y[:3], y[3:].reshape(2, 3)  # two axes of space in the body
        return np.concatenate((np.cross(A * w, w) / A, np.cross(axes, w).ravel()))

    G = A * start / np.linalg.norm(A * start)
    x = np.cross(G, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    times = np.linspace(0, 50 * period, 20001)
    axes = [*x, *np.cross(G, x)]
    ivp = solve_ivp(rates, (0, times[-1]), [*start, *axes], "DOP853", times, rtol=1e-11, atol=1e-12)
    by_axis = {1: 2 * np.pi * period / angle, 3: 2 * np.pi * period / (angle - 2 * np.pi)}
    if not long:
        by_axis = {3: by_axis[1]}
    for axis, expected in by_axis.items():
        azimuth = np.unwrap(np.arctan2(ivp.y[5 + axis], ivp.y[2 + axis]))
        turned = (azimuth[-1] - azimuth[0]) / (2 * np.pi)
        assert times[-1] / turned == pytest.approx(expected, rel=1e-8)
    words = ", ".join(f"x{axis} in {x:.9g}" for axis, x in by_axis.items())
    assert f"the hodograph turns in {period:.9g}; axes go round G: {words}" in str(
        data.attrs["predictions"]
    )


def test_members_without_an_attitude_have_no_number_and_the_others_theirs() -> None:
    body = {"model": "linear-diag", "inertia": [3, 2.2, 1], "time": {"end": 5, "samples": 11}}
    start = {"initial": {"p": 0.3, "q": 0.2, "r": 0.9}}
    turned = {"sweep": {"attitude.initial.0": {"values": [-1, 0, 1]}}}
    bodies = {"attitude": "yes", "sweep": {"inertia.1": {"values": [2.2, 7]}}}
    names = ("x3_space", "theta", "G_space", "rotation", "T")
    for swept, known in ((turned, [True, False, True]), (bodies, [True, False])):
        found = hodo_cli.derive(hodo_cli.sweep(body | start | swept), *names)
        for name in names:
            values = found[name].values
            assert np.isfinite(values.reshape(len(values), -1)).all(1).tolist() == known, name


def test_angles_are_no_numbers_from_where_samples_lose_whole_turns() -> None:
    case: dict[str, Any] = {
        "model": "linear-diag", "inertia": [3, 2.2, 1], "initial": {"p": 0.3, "q": 0.2, "r": 0.9},
        "attitude": {"euler": [0.1, 0.5, 0.2]},
    }  # fmt: skip
    fine, coarser, few = (
        hodo_cli.derive(hodo_cli.run(case | {"time": {"end": 60, "samples": n}}), "psi", "phi")
        for n in (1201, 121, 12)
    )
    assert float(fine.phi[-1]) == pytest.approx(float(coarser.phi[-1]), abs=1e-12)
    for name in ("psi", "phi"):
        known = np.isfinite(few[name].values)
        assert not known.all()
        same = fine[name].interp(time=few.time)[known]
        np.testing.assert_allclose(few[name][known], same, atol=1e-3)


@pytest.mark.parametrize(
    ("check", "samples", "verdict"),
    [
        # Two components of G, which lies along z, are rounding.
        ("kind: conserved, of: [G_space.x, G_space.y, G_space.z]", 601, "reproduced"),
        ("kind: formula, of: G_space.x, formula: '0'", 601, "reproduced"),
        ("kind: formula, of: G_space.x, formula: '0'", 12, "not tested"),
        # Whole turns are lost: a number would be wrong by them.
        ("kind: bound, of: phi, least: 0", 12, "not tested"),
        ("kind: monotone, of: [phi], sense: rises", 12, "not tested"),
    ],
)
def test_statements_take_no_rounding_for_a_change_and_no_gap_for_a_number(
    tmp_path: Path, check: str, samples: int, verdict: str, hodo: Hodo
) -> None:
    body = "model: linear-diag, inertia: [3, 2.2, 1], initial: {p: .3, q: .2, r: .9}"
    claim = f"{{id: a, where: x, statement: s, cases: [a], check: {{{check}}}, expect: {verdict}}}"
    text = (
        f"cases: {{a: {{{body}, attitude: {{align: G}}, time: {{end: 60, samples: {samples}}}}}}}\n"
        f"claims: [{claim}]\n"
    )
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    for command in ("run", "classify", "claims"):
        done = hodo(command, "m.yaml" if command == "run" else "runs/m.h5")
        assert done.returncode == 0, done.stdout + done.stderr


DIRECTIONS = ("tilt", "x1_direction", "J", "D/2T", "separatrix_distance")
STOPPED = {
    "model": "torques",
    "inertia": [120, 100, 80],
    "brake": 0.05,
    "initial": {"p": 0.05, "q": 0.01, "r": 0.3},
    "time": {"end": 600, "samples": 121},
}


def test_a_body_that_a_brake_has_stopped_has_no_direction_of_its_momentum() -> None:
    """Nor has a figure a mark where there is nothing to mark."""
    motion = hodo_cli.run(STOPPED)
    found = hodo_cli.derive(motion, *DIRECTIONS, "G")
    is_moving = motion.time.values < motion.event_time.item()
    assert not found.G.values[~is_moving].any()
    for name in DIRECTIONS:
        assert np.isfinite(found[name].values).tolist() == is_moving.tolist(), name
    figure = hodo_cli.plot(motion, kind="series", variables=[*DIRECTIONS])
    figure.savefig(BytesIO(), format="png")
    said = [words.get_text() for panel in figure.axes for words in panel.texts]
    assert all(words.startswith("constant to") for words in said), said


def test_of_arrays_of_dask_they_are_the_same() -> None:
    pytest.importorskip("dask")
    case = {**BODY, "time": {"end": 20}, "sweep": {"initial.p": {"values": [0.5, 0.8, 0.9]}}}
    for data in (hodo_cli.run(BODY), hodo_cli.sweep(case)):
        whole = hodo_cli.derive(data, "T", "G_space")
        assert hodo_cli.derive(data.chunk(), "T", "G_space").compute().identical(whole)


def test_what_is_constant_looks_so_in_a_phase_figure() -> None:
    """On the scale of its rounding it filled the panel, and broke its frame."""
    motion = hodo_cli.run({
        "model": "linear-diag", "inertia": [3, 2, 1], "attitude": {"align": "G"},
        "initial": {"p": 0.3, "q": 0.4, "r": 1.5}, "time": {"end": 30, "samples": 3001},
    })  # fmt: skip
    for x, label, constants in (
        ("theta", r"$\theta$ [rad]", ["$T$"]),
        ("G", "$|G|$ [–]", ["$|G|$", "$T$"]),
        ("time", r"$\tau$ [–]", ["$T$"]),
    ):
        (axes,) = hodo_cli.plot(motion, kind="phase", x=x, y="T").axes
        assert axes.get_xlabel() == label
        (remark,) = (text.get_text() for text in axes.texts)
        assert [line.split()[0] for line in remark.splitlines()] == constants
        low, high = axes.get_ylim()
        assert 0.1 < high - low < 1


@pytest.mark.parametrize(
    ("samples", "said"),
    [(1, []), (2, ["at 2 samples"]), (11, ["at 11 samples"]), (101, [""])],
)
def test_a_panel_counts_the_samples_of_the_curves_that_it_draws(
    samples: int, said: list[str]
) -> None:
    """A body at rest has no J, however few samples it has; a single one shows no constant."""
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6]}
    free, still = (
        hodo_cli.run({**body, "initial": dict(zip("pqr", start, strict=True)), "time": time})
        for start, time in (
            ((0.8, 0.5, 0.74), {"end": 10, "samples": samples}),
            ((0, 0, 0), {"end": 10, "samples": 3}),
        )
    )
    figure = hodo_cli.plot([still, free], kind="series", variables=["J"])
    words = [text.get_text() for text in figure.axes[0].texts]
    assert [text.removeprefix(text.partition(" at ")[0]).strip() for text in words] == said


@pytest.mark.parametrize(
    "check",
    [
        "kind: bound, of: tilt, at: end, most: 0.001",
        "kind: average, variable: tilt, most: 0.001",
        "kind: average, variable: J, at: [{brake: 0}, {brake: 1}], least: 0",
    ],
)
def test_a_statement_on_the_direction_at_rest_is_not_tested(
    tmp_path: Path, check: str, hodo: Hodo
) -> None:
    # The last average is over a member that turns, and one that has stopped.
    sweep = {"sweep": {"brake": {"values": [0.05, 0.06] if "at" not in check else [0.05, 0.01]}}}
    case = STOPPED | (sweep if "average" in check else {})
    claim = f"{{id: a, where: x, statement: s, cases: [a], check: {{{check}}}, expect: not tested}}"
    text = f"cases: {{a: {json.dumps(case)}}}\nclaims: [{claim}]\n"
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    for command in ("run", "classify", "claims"):
        done = hodo(command, "m.yaml" if command == "run" else "runs/m.h5")
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    "initial",
    [
        {"theta": 0.5, "r": 6},
        {"theta": 2.9, "r": 200},
        {"theta": 1e-5, "r": 5},
        {"Gz": 2, "H": 9, "r": -3},
    ],
)
def test_the_roots_of_a_top_are_where_its_nutation_turns(initial: dict[str, float]) -> None:
    top = {
        "model": "Lagrange-averaged", "form": "full", "inertia": {"A": 2.3, "C": 1.1}, "a": 0,
        "b": 0, "mu": 2, "epsilon": 0.1, "initial": initial, "time": {"end": 2, "samples": 4001},
    }  # fmt: skip
    found = hodo_cli.derive(hodo_cli.run(top), "u1", "u2", "u3")
    cosine = found.gamma.sel(axis="x3").data
    # Free, it keeps them; cos theta runs over all that lies between the first two, and u3 is that
    # with which the three make the sum of eq. (1.5).
    size = max(1, abs(initial["r"]) ** 2 / 100)
    for name in ("u1", "u2", "u3"):
        assert np.ptp(found[name].data) < 1e-12 * size
    u1, u2, u3 = (float(found[name][0]) for name in ("u1", "u2", "u3"))
    width = u2 - u1
    assert cosine.min() == pytest.approx(u1, abs=1e-4 * width + 1e-15)
    assert cosine.max() == pytest.approx(u2, abs=1e-4 * width + 1e-15)
    p, q, r = found.omega.data[0]
    H = (2.3 * (p * p + q * q) + 1.1 * r * r) / 2 + 2 * cosine[0]
    total = (H - 1.1 * r * r / 2) / 2 + (1.1 * r) ** 2 / (2 * 2.3 * 2)
    assert u1 + u2 + u3 == pytest.approx(total, rel=1e-13)


def test_the_roots_of_the_full_top_are_those_of_its_averaged_form() -> None:
    top = {
        "model": "Lagrange-averaged", "inertia": {"A": 2.3, "C": 1.1}, "a": 0.1, "b": 0.08,
        "mu": [2, 0.3], "initial": {"theta": 0.5, "r": 6}, "time": {"end": 1},
    }  # fmt: skip
    apart = []
    for epsilon in (0.02, 0.01):
        full = hodo_cli.derive(hodo_cli.run({**top, "form": "full", "epsilon": epsilon}), "u1")
        averaged = hodo_cli.run(top)
        apart.append(float(np.abs(full.u1.data - averaged.u1.data).max()))
    assert apart[0] < 0.02
    assert apart[1] == pytest.approx(apart[0] / 2, rel=0.1)


def test_integrals_of_a_top_whose_moment_changes_are_those_at_the_end_of_a_member() -> None:
    top = {
        "model": "Lagrange-averaged", "form": "full", "inertia": {"A": 2.3, "C": 1.1}, "a": 0.1,
        "b": 0.08, "mu": {"law": "exponential", "value": 2, "rate": 0.5}, "epsilon": 0.1,
        "initial": {"theta": 0.5, "r": 6}, "time": {"end": 1},
    }  # fmt: skip
    members = hodo_cli.sweep(top | {"sweep": {"initial.r": {"values": [6, 10]}}})
    single = hodo_cli.derive(hodo_cli.run(top), "H", "Gz")
    found = hodo_cli.derive(members, "H", "Gz")
    for name in ("H", "Gz"):
        assert found[name].values[0] == pytest.approx(single[name].values[-1], rel=1e-12)
