"""Sweeps: members equal single cases, whatever the chunks; nothing is lost; what is drawn is what
is stored."""

import json
import math
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import series
import xarray as xr
from conftest import call, classified, wait_until
from hypothesis import given
from hypothesis import strategies as st

import hodo_cli
from hodo_cli import Case, HodoError
from hodo_cli.cases.case import parse_case
from hodo_cli.cases.config import load, parse
from hodo_cli.commands import run
from hodo_cli.integration import integrate
from hodo_cli.models import rigid_body
from hodo_cli.storage import Group
from hodo_cli.sweeps import chunk, columns, members, summary, sweep

OK, FAILED, TIMEOUT, INVALID = range(4)
"""The first values of `status`, by their places in its `flag_meanings`."""

pytestmark = pytest.mark.usefixtures("quick_steps")

HEAD = "inertia: [1, 0.8, 0.6], time: {end: 1000}, error: off"
BALL = "initial: {p: 0, q: 0, G: 1}"
BODY = (1.0, 0.8, 0.6)
FIG4 = f"model: linear-diag, {HEAD}, damping: [0.005, 0.004, 0.003]"
BRIEF = FIG4.replace("end: 1000", "end: 100")
SHORT = FIG4.replace("end: 1000", "end: 20")
INSTANT = FIG4.replace("end: 1000", "end: 1e-9")
TOP = "model: Lagrange-averaged, inertia: {A: 1.5, C: 1}, initial: {theta: 0, r: 2}, b: 0.3"
FIG12 = f"model: tensor, {HEAD}, resistance: {{diagonal: 0.005, off_diagonal: 0.005}}"
BODY_MOVES = "initial: {p: 0.8, q: 0.5, r: 0.74}"


def one(text: str) -> Case:
    return parse(f"title: t\ncases:\n  a: {{{text}}}\n", "x.yaml").cases["a"]


def swept(text: str) -> xr.Dataset:
    return hodo_cli.sweep(one(text))


def precisely(case: Case, precision: str) -> xr.Dataset:
    """A case by a series in another precision."""
    return hodo_cli.run(replace(case, method="taylor", tol=None, precision=precision, error=False))


def computed(case: Case, first: int = 0, last: int | None = None) -> dict[str, np.ndarray]:
    group = chunk.compute(
        chunk.Chunk(case, first, math.prod(columns.shape(case)) if last is None else last)
    )
    return {name: variable.data for name, variable in group.variables.items()}


def test_each_variable_of_a_sweep_may_be_stored_alone() -> None:
    text = f"{SHORT}, {BALL}, sweep: {{damping.2: {{values: [0.003]}}}}"
    for name in {*swept(text).data_vars} - {"status", "d_vector"}:
        assert {*swept(f"{text}, store: [{name}]").data_vars} == {"status", name}


def test_the_values_of_a_range() -> None:
    ranges = "damping.0: {linspace: [1, 2, 5]}, damping.2: {logspace: [1e-4, 1e-2, 3]}"
    data = swept(f"{INSTANT}, {BALL}, sweep: {{{ranges}}}")
    assert data["damping.2"].values == pytest.approx([1e-4, 1e-3, 1e-2], rel=1e-14)
    assert data["damping.0"].values.tolist() == [1, 1.25, 1.5, 1.75, 2]


@pytest.mark.heyoka
def test_directions_are_uniform_and_those_of_the_members_in_every_block_of_them() -> None:
    """They are written in blocks of some 16,000; G has not turned yet at the end."""
    count = chunk.LARGEST_CHUNK + 100
    text = f"{INSTANT}, {BALL}, sweep: {{d: {{sphere: {{count: %s, seed: %s}}}}}}"
    data = swept(f"{text % (count, 3)}, store: [omega]")
    every, G = data["d_vector"].values, np.array(BODY) * data["omega"].values
    along = G / np.linalg.norm(G, axis=1, keepdims=True)
    assert np.abs(along - every).max() < 1e-8  # ten times its turn
    assert np.linalg.norm(every, axis=1) == pytest.approx(1, rel=1e-15)
    # Each component of a uniform direction is uniform in [-1, 1]; 4 standard errors.
    assert np.abs(every.mean(axis=0)).max() < 4 * math.sqrt(1 / 3 / count)
    assert np.abs((every**2).mean(axis=0) - 1 / 3).max() < 4 * math.sqrt(4 / 45 / count)
    assert np.array_equal(swept(text % (9, 3))["d_vector"], every[:9])
    assert not np.any(swept(text % (9, 4))["d_vector"] == every[:9])


# Members are single cases


@pytest.mark.heyoka  # without it, collocation would be compared with itself
@pytest.mark.parametrize(
    ("form", "times", "store", "other"),
    [
        ("full", "end: 440, samples: 1", "share", "collocation"),
        ("full", "values: [400, 420, 440]", "share, trajectory", "collocation"),
        ("averaged", "values: [400, 440]", "trajectory", "quadrature"),
    ],
)
def test_a_member_starts_about_the_axis_of_its_start_whenever_its_samples_begin(
    form: str, times: str, store: str, other: str
) -> None:
    wanted = f"store: [start_axis, end_axis, crossings, crossing_time, {store}]"
    text = f"{FIG4}, {BODY_MOVES}, sweep: {{damping.1: {{values: [0.004, 0.0041]}}}}, {wanted}"
    text = text.replace("end: 1000", times) + f", form: {form}"
    together, alone = swept(text), swept(f"{text}, method: {other}")
    assert alone.attrs["method"] == other
    for data in (together, alone):
        assert data.start_axis.values.tolist() == [1, 1]
        assert data.end_axis.values.tolist() == [3, 3]
        for name in {"crossings", "crossing_time", "share"} & {*data}:
            np.testing.assert_allclose(data[name], together[name], rtol=1e-9)


def test_a_sweep_warns_of_an_error_above_its_tolerance() -> None:
    text = f"{FIG4.replace('off', 'on')}, {BODY_MOVES}, sweep: {{damping.1: {{values: [0, 0.1]}}}}"
    far = swept(text.replace("end: 1000", "end: 500") + ", method: RK45")
    assert far.attrs["tol"] == 1e-9
    assert far.attrs["error"] > 1e-8
    assert "is more than ten times the 1e-09 that hodo aims at" in far.attrs["warnings"]
    assert swept(text.replace("end: 1000", "end: 5")).attrs["warnings"] == ""


@pytest.mark.heyoka
def test_the_shares_of_a_member_that_crosses_there_and_back() -> None:
    """Of paper 1's Fig. 12 (tests/data/crossings.csv)."""
    start = "initial: {p: 0.5, q: 0.25, r: 1.40435829552939}, sweep: {initial.q: {values: [0.25]}}"
    values = computed(one(f"{FIG12}, {start}"))
    first, second, third = 256.993064559, 396.993309847, 406.942439380  # to x1, x3, x1
    assert values["crossing_time"][0] == pytest.approx(first, rel=1e-11)
    assert values["crossings"][0] == 3
    about_x1 = (second - first + 1000 - third) / 1000
    assert values["share"][0] == pytest.approx([about_x1, 0, 1 - about_x1], abs=1e-11)


@pytest.mark.heyoka
def test_the_last_sample_is_the_end_whatever_rounding_has_taken_from_the_time() -> None:
    brief = FIG4.replace("end: 1000", "end: 3, samples: 11")
    text = f"{brief}, {BALL}, sweep: {{d: {{sphere: {{count: 200}}}}}}"
    paths = computed(one(f"{text}, store: [trajectory]"))["omega"]
    np.testing.assert_allclose(paths[:, -1], computed(one(text))["omega"], rtol=0, atol=1e-15)


@pytest.mark.heyoka
def test_what_an_ensemble_cannot_settle_is_integrated_alone() -> None:
    case = one(f"{FIG4}, {BODY_MOVES}, sweep: {{damping.0: {{values: [0.005, 1e6]}}}}")
    counts = [
        chunk.compute(chunk.Chunk(case, i, i + 1)).attributes["rejections"].sum() for i in range(2)
    ]
    assert counts == [0, 1]
    values = computed(case)
    assert values["status"].tolist() == [OK, OK]
    assert values["end_axis"].tolist() == [3, 3]
    single = integrate(members.member(case, 1))
    assert single.method != "taylor"
    assert values["omega"][1] == pytest.approx(single.variables["omega"][-1], rel=1e-6)


@pytest.mark.heyoka
# A formula that holds |x| tells it; the other only the steps themselves show.
@pytest.mark.parametrize("size", ["sqrt(4*p*p)/2", "sqrt(p*p-0.02*p+0.0001)"])
def test_a_corner_that_one_member_in_many_comes_to_is_none_too_few(size: str) -> None:
    """No check of members drawn at random need meet it."""
    drawn = np.random.default_rng(60).choice(60, 16, replace=False)
    odd = min({*range(60)} - {*drawn.tolist()})
    values = [0.05 if i == odd else 0.9 + i / 1000 for i in range(60)]  # about x3, where p turns
    text = f"model: torques, inertia: [1, 0.8, 0.6], expression: ['-0.02*{size}*p', 0, 0], "
    text += "time: {end: 20}, error: off, initial: {p: %s, q: 0.1, r: 0.6}"
    together = swept(f"{text % 0.9}, sweep: {{initial.p: {{values: {values}}}}}")
    alone = hodo_cli.run(one(text % 0.05))
    assert np.abs(together.omega[odd] - alone.omega[-1]).max() < 1e-13


REFUSED_LATER = (
    "model: torques, inertia: [1, 0.8, 0.6], initial: {p: 0.1, q: 0.5, r: 0.7}, "
    "time: {start: -2, end: 2}, error: off"
)
FLUID_INSIDE = "model: cavity+constant, form: averaged, kappa: 0.6, time: {end: 10}, error: off"
MARKED = {
    "an averaged start on the separatrix": (
        f"{FIG4}, form: averaged, initial: {{p: 1, q: 0.5, r: 0}}", "initial.p", "[0, 1]", "IO"),
    "no attitude": (f"{FIG4}, {BODY_MOVES}, attitude: {{initial: [1, 0, 0, 0]}}",
        "attitude.initial.0", "[0, 1, 2]", "IOO"),
    "no body": (f"{FIG4}, {BODY_MOVES}", "inertia.1", "[0.1, 0.8, 2.0]", "IOI"),
    "a limit of steps": (f"{FIG4}, {BODY_MOVES}, max_steps: 20", "damping.2", "[0, 1]", "TT"),
    # Those whose single cases are refused for their span.
    "a power of 0": (f"{REFUSED_LATER}, constants: {{k: 0.1}}, damping: 0.01*(1 + k*t)**-2",
        "constants.k", "[0.1, 0.5]", "OI"),
    "no value at the start": (
        f"{REFUSED_LATER}, expression: [1e-3/(q*q + (p - 0.1)**2), 0, 0], method: collocation",
        "initial.q", "[0.5, 0]", "OI"),
    # With A1 = A2 the spin is a variable of the averaged body; there is another class for others.
    "other equations": (f"{FLUID_INSIDE}, inertia: [8, 8, 4], initial: {{x: 2, y: 3}}",
        "inertia.1", "[8, 7, 6]", "OII"),
    "other equations, alone": (
        f"{FLUID_INSIDE}, inertia: [8, 6, 4], initial: {{p: 0.1, q: 0.1, r: 1}}",
        "inertia.1", "[8, 7, 6]", "IOO"),
}  # fmt: skip
"""A case, what is swept, and how its members end: OK, invalid or after too many steps."""


@pytest.mark.parametrize("kind", MARKED)
def test_members_that_do_not_end_well_are_marked(kind, monkeypatch):
    text, key, values, ends = MARKED[kind]
    monkeypatch.setattr(chunk, "WORTH_COMPILING", 250 if "alone" in kind else 0)
    case = one(f"{text}, sweep: {{{key}: {{values: {values}}}}}")
    found = computed(case)
    assert found["status"].tolist() == [{"O": OK, "I": INVALID, "T": TIMEOUT}[end] for end in ends]
    if "omega" in found:
        assert np.isnan(found["omega"][found["status"] == INVALID]).all()
    if kind in ("a power of 0", "no value at the start"):
        assert members.warnings_of_ends(case) == []


@pytest.mark.heyoka
def test_the_error_of_members_that_stop_is_that_of_the_time() -> None:
    """Members that end too small are counted."""
    body = f"model: torques, inertia: [1, 0.8, 0.6], {BODY_MOVES}"
    case = one(f"{body}, damping: 0.004, brake: 0.01, time: {{start: -50, end: 400}}, "
               "sweep: {brake: {values: [0.01]}}")  # fmt: skip
    end = summary.member_end(chunk.Chunk(case, 0, 1), computed(case), 0)
    late = end._replace(final={"event_time": end.final["event_time"] + 84e-9})
    errors = [found.final for found in summary.probe(case, [end, late])[0]]
    assert errors == [pytest.approx(0, abs=1e-14), pytest.approx(1e-9, rel=1e-3)]
    span = f"{body}, time: {{end: 400}}, sweep:"
    stopped = swept(f"{span} {{brake: {{values: [0.01, 0.02]}}}}, brake: 0.01").attrs
    assert stopped["error"] < 1e-14
    assert (stopped["error_sample"], stopped["warnings"]) == (2, "")
    decayed = swept(f"{span} {{damping.0: {{values: [8, 9]}}}}, damping: 9").attrs
    words = "2 of 2 members have no measured error: they end below 1e-290"
    assert (decayed["error_sample"], decayed["warnings"]) == (0, words)


# Files


DAMPED = "model: linear-diag, damping: [0.005, 0.004, 0.003]"
SMALL = f"""\
title: t
defaults: {{inertia: [1, 0.8, 0.6], time: {{end: 300, samples: 7}}}}
cases:
  ball: {{{DAMPED}, {BALL}, sweep: {{damping.2: {{linspace: [0.001, 0.009, 3]}},
         direction: {{sphere: {{count: 400, seed: 1}}}}}}}}
  single: {{model: linear-diag, {BODY_MOVES}}}
  paths: {{model: tensor, resistance: {{diagonal: 0.003, off_diagonal: 0.001}},
          initial: {{p: 0.5, q: 0.25, G: 1}}, store: [omega, trajectory],
          sweep: {{resistance.diagonal: {{values: [0.003, 0.004]}}}}}}
  some: {{{DAMPED}, {BODY_MOVES}, sweep: {{
         damping.2: {{values: [0.001, 0.002, 0.009]}}, inertia.1: {{values: [0.1, 0.8]}}}}}}
  few: {{model: linear-diag, {BODY_MOVES}, store: [crossing_time],
        sweep: {{damping.2: {{values: [0.002, 0.003]}}}}}}
figures:
  sphere: {{kind: map, cases: [ball], variable: crossing_time, panels: damping.2, at: [0, 2],
           caption: c}}
"""


def results(folder: Path, text: str, jobs: int = 1) -> Path:
    (folder / "a.yaml").write_text(text, encoding="utf-8")
    call(folder, "run", "a.yaml", "--out", ".", "--quiet", "-j", jobs)
    return folder / "a.h5"


MOMENTS = "inertia: [2, 1.5, 1], damping: [0.001, 0.002, 0.003]"
IN_ANY_AXES = (
    "inertia: [[2, 0.2, 0.1], [0.2, 1.5, -0.1], [0.1, -0.1, 1]], "
    "resistance: [[0.009, 0.001, 0], [0.001, 0.002, 0.001], [0, 0.001, 0.001]]"
)
STARTS = (
    f"time: {{end: 100}}, {BALL.replace('G: 1', 'r: 1')}, "
    "sweep: {d: {sphere: {count: 40, seed: 3}}}"
)
FROM_REST = (
    "inertia: [1, 0.8, 0.6], initial: {p: 0, q: 0, r: 0}, time: {end: 60}, "
    "torque: [0.01, 0, 0.01], sweep: {torque.1: {linspace: [-0.03, 0.031, 40]}}"
)
TORQUES = {
    "fixed in space": f"space_torque: {{size: 0.01, direction: [1, 0, 2]}}, {MOMENTS}, {STARTS}",
    "of a brake that stops some": f"brake: 0.009, {MOMENTS}, {STARTS}",
    "of a brake that stops all": f"brake: 0.03, torque: [0, 1e-3, 0], {MOMENTS}, {STARTS}",
    "in other axes, of fluid": f"kappa: 0.02, torque: [0.01, 0, 0.02], {IN_ANY_AXES}, {STARTS}",
    "in other axes, of a brake that stops some": f"brake: 0.009, {IN_ANY_AXES}, {STARTS}",
    "of a rotor beside a brake": "rotor: [0, 0.3, 0], brake: 0.02, inertia: [2, 1.5, 1], "
    f"damping: [0.03, 0.02, 0.01], {STARTS}",
    "of a rotor in other axes": f"rotor: [0.1, 0.2, 0.1], attitude: yes, {IN_ANY_AXES}, {STARTS}",
    "from rest, damped": f"damping: [0.01, 0.02, 0.03], {FROM_REST}",
    "from rest, with fluid and an attitude": f"kappa: 0.05, attitude: yes, {FROM_REST}",
    "from rest, with a rotor": f"damping: 0.02, rotor: [0, 0.05, 0], {FROM_REST}",
    # Its D touches 0 where the spin reverses: a quarter of the members went by themselves.
    "of two equal moments": "inertia: [8, 8, 4], kappa: 0.6048, torque: [0, 0, -0.01], "
    "attitude: yes, initial: {p: 1, q: 0.3, r: 1}, time: {end: 30}, "
    "sweep: {initial.p: {linspace: [0.5, 1.5, 40]}}",
    # Below 1e-1233 a motion is at rest, and has no label.
    "that all but stops all": "inertia: [1, 0.8, 0.6], damping: [0.5, 0.4, 0.3], time: {end: 1e4}, "
    "initial: {p: 0.8, q: 0.5, r: 0.99}, sweep: {initial.p: {values: [0.77]}}",
}


SPHERE = "sweep: {d: {sphere: {count: 12, seed: 2}}}"
KEPT = "time: {end: 30, samples: 31}, error: off, store: [trajectory]"
ENDING = (
    "model: cavity+constant, form: averaged, inertia: [8, 8, 4], kappa: 0.6048, epsilon: 0.1, "
    f"torque: [0, 0, -0.1], initial: {{x: 1, y: 1}}, {KEPT}"
)
OTHERS = {
    "linear-diag": f"{FIG4}, {BALL}, {SPHERE}",
    "tensor": f"{FIG12}, {BALL}, {SPHERE}",
    "tensor, along the motion": f"{FIG12.replace(HEAD, KEPT)}, inertia: [1, 0.8, 0.6], {BALL}, "
    f"{SPHERE}",
    # Without a value at the samples that a motion does not reach.
    "and some end early": f"{ENDING}, sweep: {{initial.y: {{linspace: [0.01, 1.5, 1500]}}}}",
    "a grid": f"{BRIEF}, {BODY_MOVES}, sweep: {{inertia.1: {{linspace: [0.5, 1.2, 2]}}, "
    "damping.0: {values: [0.01, 0.05]}, d: {sphere: {count: 2, seed: 1}}}",
    # Its state at the start knows G, and so the rotor.
    "rotor in space": "model: torques, inertia: [1, 0.8, 0.6], rotor: [0.3, 0.1, 0.2], "
    f"time: {{end: 40}}, {BODY_MOVES}, sweep: {{rotor.0: {{values: [-0.2, 0, 0.3]}}}}, "
    "space_torque: {size: 0.01, direction: [1, 2, 3]}",
    # On the separatrix, D = 0.2 p^2 - 0.12 r^2, on each principal axis, at rest.
    "starts that decide nothing": f"{FIG4}, initial: {{p: 1, q: 1, r: 1}}, sweep: {{start: {{zip: "
    f"{{initial.p: {{values: [{math.sqrt(0.6)!r}, 1, 0, 0, 0]}}, "
    "initial.q: {values: [0, 0, 1, 0, 0]}, initial.r: {values: [1, 0, 0, 1, 0]}}}}",
    "1e-70 beside an axis": "model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 1500}, "
    "damping: [1e-3, 1e-3, 5e-3], initial: {p: 1e-70, q: 1, r: 1.5e-70}, "
    "sweep: {initial.p: {values: [1e-70, 1e-60, 0.1]}}",
}


@pytest.mark.heyoka
@pytest.mark.parametrize("torque", [*TORQUES, *OTHERS])
def test_members_go_side_by_side_as_they_go_alone(torque: str) -> None:
    """Also where more than omega along principal axes is the state: the direction of a torque, the
    leg of a brake, an attitude. A limit of steps has each member integrated by itself."""
    case = one(OTHERS.get(torque) or f"model: torques, error: off, {TORQUES[torque]}")
    case = replace(case, error=False)
    group = chunk.compute(chunk.Chunk(case, 0, math.prod(columns.shape(case))))
    assert group.attributes["rejections"].sum() <= 2 or torque in OTHERS
    together = {name: variable.data for name, variable in group.variables.items()}
    first = min(8, len(together["status"]))
    alone = computed(replace(case, max_steps=10**6), 0, first)
    assert {*alone} == {*together}
    labels = {"status", "start_axis", "end_axis", "crossings", "crossing_to", "crossing_from"}
    for name in (labels | {"event_from"}) & {*together}:
        assert np.array_equal(together[name][:first], alone[name]), name
    times = {"crossing_time", "crossing_G", "event_time"}
    for name in ({"omega", "share", "attitude", "x", "y"} | times) & {*together}:
        near = pytest.approx(alone[name], rel=1e-10, abs=1e-12, nan_ok=True)
        assert together[name][:first] == near, name
    if "early" in torque:
        assert np.isnan(together["x"][:first, -1]).any()
        assert not np.isnan(together["x"][:, 0]).any()
    if "omega" not in together:
        return
    if "1e-70" in torque:  # by DOP853 at 1e-12 of each component, which takes 1,200 steps
        assert together["omega"][0] == pytest.approx([0.1411, -0.0022, 0.0699], abs=1e-4)
    stopped = (together["omega"] == 0).all(axis=1)
    assert stopped.any() == ("stops" in torque or "nothing" in torque)
    assert stopped.all() == ("all" in torque)
    if "brake that stops" in torque:  # the share of the axes ends with the stop
        part = together["event_time"][stopped] / case.time.end
        assert together["share"][stopped].sum(axis=1) == pytest.approx(part, rel=1e-12)
    if "from rest" in torque:  # its side is the one along the torque
        assert (together["start_axis"] == rigid_body.UNDETERMINED).all()
        assert together["crossings"].any() == ("rotor" not in torque)
    assert not ("equal" in torque and together["crossings"].any())


@pytest.mark.heyoka
def test_a_sweep_says_how_many_members_went_alone_and_why() -> None:
    fast = f"{FIG4}, {BODY_MOVES}"
    torques = fast.replace("linear-diag", "torques")
    top = f"{TOP.replace('theta: 0', 'theta: 1')}, mu: 0.5, a: 0.1, time: {{end: 1}}, error: off"
    together = "side by side, 0 of 2 members by themselves"
    alone = "(1: starts with a component that is small beside another)"
    for text, values, reason in (
        (fast, "[0, 1e-12, 0.8]", f"side by side, 1 of 3 members by themselves {alone}"),
        (fast, "[0.7, 0.8]", together),
        (f"{torques}, rotor: [0, 0.1, 0]", "[0.7, 0.8]", together),
        (f"{torques}, quadratic: 0.1", "[0.7, 0.8]", together),
        (f"{fast}, max_steps: 900", "[0.7, 0.8]", "each by itself: limits of each member"),
        (top, "[1.6, 1.7]",
         "each by itself: fewer than 1250 members are not worth compiling their step"),
    ):  # fmt: skip
        key = "initial.r" if text == top else "initial.p"
        data = swept(f"{text}, sweep: {{{key}: {{values: {values}}}}}")
        assert data.attrs["method_reason"] == reason


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which SMALL has been run."""
    folder = tmp_path_factory.mktemp("small")
    results(folder, SMALL)
    return folder


@pytest.mark.heyoka
def test_a_sweep_is_stored_with_its_axes(small: Path) -> None:
    ball, single, paths = (hodo_cli.open(small / "a.h5")[x] for x in ("ball", "single", "paths"))
    assert ball.omega.dims == ("damping.2", "direction", "axis")
    assert ball["damping.2"].values.tolist() == [0.001, 0.005, 0.009]
    assert (ball.crossing_time.shape, ball.attrs["status"]) == ((3, 400), "ok")
    assert ball.attrs["error"] < 1e-11
    assert ball.attrs["error_sample"] > 256
    assert single.omega.shape == (7, 3)
    assert paths.omega.dims == ("resistance.diagonal", "time", "axis")
    assert np.array_equal(paths.time, np.linspace(0, 300, 7))


@pytest.mark.heyoka
def test_every_command_takes_a_sweep(small: Path) -> None:
    """The line of the table counts members that ended well, by what is stored."""
    assert call(small, "show", "a.h5").returncode == 0
    for _ in range(2):  # before and after it is written anew
        told = json.loads(call(small, "classify", "a.h5", "--json").stdout)
        rows = {row["case"]: row for row in told}
        stored = hodo_cli.open(small / "a.h5")["ball"]
        counts, times = stored["crossings"].values, stored["crossing_time"].values
        (line,) = rows["ball"]["warnings"]
        words = r"(\d+) of 1200 members cross, first at (.*) to (.*), median (.*)"
        said = re.fullmatch(words, line)
        assert said
        assert int(said[1]) == (counts > 0).sum()
        known = [np.nanmin(times), np.nanmax(times), np.nanmedian(times)]
        assert [float(x) for x in said.groups()[1:]] == pytest.approx(known, rel=1e-4)
        assert rows["some"]["end"] == "x1 33.3 %, x3 66.7 %"
        assert rows["some"]["warnings"][0].startswith("2 of 3 members cross, first at ")
        assert rows["few"]["warnings"] == ['"crossings", their number, is not stored']
    done = call(small, "plot", "a.h5", "--out", ".", "--format", "csv")
    assert done.returncode == 0, done.stderr
    path = small / "a" / "sphere.csv"
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert np.array_equal(table["crossing_time"], times[[0, 2]].ravel(), equal_nan=True)


@pytest.mark.heyoka
def test_processes_and_repeats_change_nothing(tmp_path, monkeypatch):
    monkeypatch.undo()  # steps that round as those of workers do
    for name in "ab":
        (tmp_path / name).mkdir()
    # Still more than a task of measuring errors has.
    monkeypatch.setattr(summary, "RANDOM_MEMBERS", 40)
    monkeypatch.setattr(summary, "NEAREST_MEMBERS", 10)
    first = results(tmp_path / "a", SMALL).read_bytes()
    paths = results(tmp_path / "a", SMALL), results(tmp_path / "b", SMALL, 2)
    assert paths[0].read_bytes() == first
    one, two = (hodo_cli.open(path)["ball"] for path in paths)
    xr.testing.assert_equal(one, two)
    assert one.attrs["error_quantiles"].tolist() == two.attrs["error_quantiles"].tolist()


@pytest.mark.heyoka
def test_a_killed_sweep_goes_on_from_its_last_chunk(tmp_path, hodo, monkeypatch):
    monkeypatch.undo()  # steps that round as those of the other process do
    text = SMALL.replace("count: 400", "count: 600").replace("time:", "error: off, time:")
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "hodo_cli.cli", "run", "a.yaml", "--case", "ball"]
    with subprocess.Popen(command, cwd=tmp_path) as process:
        wait_until(lambda: len([*tmp_path.glob("runs/.a.h5.parts/chunk-*.h5")]) >= 3)
        process.kill()
    done = len([*tmp_path.glob("runs/.a.h5.parts/chunk-*.h5")])
    assert 3 <= done < 9
    assert not (tmp_path / "runs" / "a.h5").exists()
    # Another sweep in its place lets them lie until they are pruned.
    (tmp_path / "a.yaml").write_text(text.replace("count: 600", "count: 20"), encoding="utf-8")
    assert hodo("run", "a.yaml", "--case", "ball").returncode == 0
    assert f"runs/a.h5: {done} chunks of unfinished sweeps" in hodo("show", "runs/a.h5").stderr
    shutil.copytree(tmp_path / "runs", tmp_path / "pruned")
    assert hodo("run", "a.yaml", "--case", "ball", "--prune", "--out", "pruned").returncode == 0
    assert not list(tmp_path.glob("pruned/.a.h5.*"))
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    again = hodo("run", "a.yaml", "--case", "ball", "-v")
    assert again.returncode == 0, again.stderr
    assert f"ball: {done} of 9 chunks are kept" in again.stderr
    assert not list(tmp_path.glob("runs/.a.h5.*"))
    ball = hodo_cli.open(tmp_path / "runs" / "a.h5")["ball"]
    values = computed(parse_case(ball.attrs["case"]), 0, 300)
    np.testing.assert_array_equal(ball["crossing_time"][0, :300], values["crossing_time"])
    assert (ball["status"] == OK).all()


GROWING = {
    "finer steps and more directions": (
        f"{FIG4}, {BALL}, sweep: {{damping.2: {{linspace: [0.001, 0.009, NEW]}}, "
        "direction: {sphere: {count: NEW, seed: 1}}}",
        ("3", "8"), ("5", "20"),
    ),
    "trajectories along even ratios": (
        f"{FIG12}, initial: {{p: 0.2, q: 0.4, r: 0.9}}, store: [omega, trajectory], "
        "sweep: {resistance.diagonal: {logspace: [1e-3, 1e-1, NEW]}}",
        ("3",), ("5",),
    ),
    "values between, by another method": (
        f"{SHORT}, initial: {{p: 0.8, q: 0.5, r: 0.74}}, method: DOP853, sweep: {{"
        "initial.q: {values: NEW}, "
        "body: {zip: {inertia.1: {values: NEW}, inertia.2: {values: NEW}}}}",
        ("[0.1, 0.2]", "[0.7, 0.8]", "[0.6, 0.5]"),
        ("[0.15, 0.2, 0.3, 0.1]", "[0.7, 0.9, 0.8]", "[0.6, 0.5, 0.5]"),
    ),
    "few columns": (
        f"{FIG4}, {BALL}, store: [crossing_time], sweep: {{d: {{sphere: {{count: NEW}}}}}}",
        ("30",), ("40",),
    ),
    "members that a brake holds": (
        f"model: torques, {HEAD.replace('1000', '30')}, torque: [0.005*t, 0, 0], brake: 0.1, "
        "initial: {p: 0.2, q: 0.4, r: 0.9}, sweep: {initial.p: {values: NEW}}",
        ("[0.1]",), ("[0.15, 0.1]",),
    ),
}  # fmt: skip
"""Sweeps with the places of what grows, and what stands there at first and later."""


def stored_sweeps(folder: Path, *texts: str) -> xr.Dataset:
    """The last of some sweeps, of which each is run onto the result of the one before."""
    folder.mkdir(exist_ok=True)
    for text in texts:
        path = results(folder, f"title: t\ncases:\n  a: {{{text}}}\n")
    return hodo_cli.open(path)["a"]


@pytest.mark.heyoka
@pytest.mark.parametrize("kind", GROWING)
def test_a_sweep_that_grows_computes_its_new_members_only(kind, tmp_path, monkeypatch):
    text, *values = GROWING[kind]
    # Or else the errors of some hundred members take most of the time.
    monkeypatch.setattr(summary, "RANDOM_MEMBERS", 24)
    monkeypatch.setattr(summary, "NEAREST_MEMBERS", 8)
    pattern = text.replace("error: off", "error: on").replace("NEW", "%s")
    before, after = (pattern % entries for entries in values)
    first, whole = (math.prod(columns.shape(one(text))) for text in (before, after))
    fresh, computed_now = stored_sweeps(tmp_path / "fresh", after), []
    stored_sweeps(tmp_path / "grown", before)

    def members_of(case: Case, numbers: np.ndarray) -> Any:
        computed_now.extend(numbers.tolist())
        return members.prepare(case, numbers)

    def alone(case: Case, number: int) -> Any:
        computed_now.append(number)
        return as_before(case, number)

    as_before = chunk.integrated_alone
    monkeypatch.setattr(chunk, "prepare", members_of)
    monkeypatch.setattr(chunk, "integrated_alone", alone)
    grown = stored_sweeps(tmp_path / "grown", after)
    assert len(set(computed_now)) == whole - first > 0
    xr.testing.assert_equal(grown, fresh)
    for key in ("members", "steps", "method", "status", "error_kind", "warnings", "message"):
        assert grown.attrs[key] == fresh.attrs[key], key
    assert f"{first} of {whole} members from an earlier run" in grown.attrs["method_reason"]
    assert grown.attrs["error_sample"] >= min(whole, summary.RANDOM_MEMBERS)
    assert 0 < grown.attrs["error"] == grown.attrs["error_quantiles"][-1] < 1e-8


@pytest.mark.heyoka
def test_an_earlier_result_that_another_run_has_grown_is_not_read(tmp_path: Path) -> None:
    text = f"{FIG4}, {BALL}, sweep: {{d: {{sphere: {{count: NEW}}}}}}"
    few, many = (f"title: t\ncases:\n  a: {{{text.replace('NEW', n)}}}\n" for n in ("9", "20"))
    path = results(tmp_path, few)
    (tmp_path / "a.yaml").write_text(many, encoding="utf-8")
    (plan,) = run.plans([load(tmp_path / "a.yaml")], tmp_path, (), False)
    case = plan.config.cases["a"]
    earlier = plan.earlier(case)
    results(tmp_path, many)
    assert earlier is not None
    with pytest.raises(HodoError, match="another run has replaced a: run it again"):
        earlier.completed(case, 0, 20, Group({}, {}))
    assert path.exists()


CHANGED = [("[0.001, 0.002]", "[0.003, 0.004]"), ("damping.2", "damping.1"),
           ("count: 9}", "count: 8}"), ("end: 1000", "end: 999")]  # fmt: skip


@pytest.mark.heyoka
@pytest.mark.parametrize(("old", "new"), CHANGED)
def test_a_sweep_that_changes_otherwise_is_computed_anew(tmp_path, old, new):
    axes = "{damping.2: {values: [0.001, 0.002]}, d: {sphere: {count: 9}}}"
    text = f"{FIG4}, {BALL}, sweep: {axes}"
    grown = stored_sweeps(tmp_path, text, text.replace(old, new))
    assert "earlier" not in grown.attrs["method_reason"]


@pytest.mark.heyoka
def test_a_chunk_whose_worker_dies_is_marked(tmp_path, monkeypatch):
    as_before = chunk.compute

    def compute(task: chunk.Chunk) -> Any:
        if task.case.name == "ball" and task.first == 0:
            raise HodoError("its process died: killed, or out of memory")
        return as_before(task)

    monkeypatch.setattr(sweep, "compute", compute)
    path = results(tmp_path, SMALL.replace("count: 400", "count: 100"))
    ball = hodo_cli.open(path)["ball"]
    failed = int((ball["status"] == FAILED).sum())
    assert 0 < failed < ball["status"].size
    assert ball.attrs["status"] == "failed"
    assert f"{failed} of 300 members: its process died" in ball.attrs["message"]


@pytest.mark.heyoka
def test_an_error_that_cannot_be_measured_costs_its_member(monkeypatch):
    solved = summary.solve

    def solve(case: Case, *rest: Any) -> Any:
        if case.name.endswith(".3"):
            raise ZeroDivisionError("a number of it is 0")
        return solved(case, *rest)

    monkeypatch.setattr(summary, "solve", solve)
    text = f"{FIG4.replace('off', 'on')}, {BALL}, sweep: {{d: {{sphere: {{count: 20}}}}}}"
    attributes = swept(text).attrs
    assert (attributes["status"], attributes["error_sample"]) == ("ok", 19)
    words = "1 of 20 members have no measured error: a number of it is 0"
    assert attributes["warnings"] == words


@given(st.lists(st.integers(1, 7), min_size=1, max_size=4), st.integers(1, 60))
def test_chunks_are_boxes_in_order(sizes: list[int], most: int) -> None:
    array, end = np.arange(math.prod(sizes)).reshape(sizes), 0
    for first, last in chunk.boxes(tuple(sizes), most):
        assert first == end
        assert 0 < last - first <= most
        members = array[sweep.box(tuple(sizes), first, last)]
        assert members.ravel().tolist() == list(range(first, last))
        end = last
    assert end == array.size


TENSOR = "[[1, 0.1, 0], [0.1, 0.8, 0], [0, 0, 0.6]]"
BODIES = [("[1, 0.8, 0.6]", "", True), (TENSOR, "", False),
          ("[1, 0.8, 0.6]", "inertia.1: {values: [0.7, 0.8]}, ", False)]  # fmt: skip


@pytest.mark.parametrize(("inertia", "others", "is_shared"), BODIES)
def test_a_map_has_a_separatrix_where_members_share_a_body_along_its_principal_axes(
    inertia: str, others: str, is_shared: bool
) -> None:
    text = f"model: torques, inertia: {inertia}, damping: 0.01, time: {{end: 1}}, error: off, "
    data = swept(f"{text}{BODY_MOVES}, sweep: {{{others}d: {{sphere: {{count: 20}}}}}}")
    lines = hodo_cli.plot(data, "map", variable="end_axis.x1").axes[0].lines
    assert any("separatrix" in str(line.get_label()) for line in lines) == is_shared


# Of three bodies the first has no A1 = 1, and the last no A1 = 0.9.
TWO_SWEEPS = """
defaults: {model: linear-diag, initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 300}, error: off,
           sweep: {damping.0: {values: [0.02, 0.001]}, inertia.1: {values: [0.35, 0.8, 1.55]}}}
cases:
  one: {inertia: [1, 0.8, 0.6], damping: [0.02, 0.01, 0.003]}
  two: {inertia: [0.9, 0.8, 0.6], damping: [0.02, 0.01, 0.1]}
claims:
"""
AVERAGES = """
cases: one, check: {kind: average, variable: end_axis.x1
cases: one, check: {kind: average, variable: omega.x3, at: [{damping.0: 1}]
cases: one, check: {kind: average, variable: crossing_time
cases: one, check: {kind: average, variable: crossings, along: [damping.0]
cases: [one, two], check: {kind: average, variable: end_axis
cases: [one, two], check: {kind: average, variable: G
cases: [one, two], check: {kind: average, variable: crossing_time, against: crossings
"""
NOT_AVERAGED = """
cases: one, check: {kind: average, variable: nothing -> the sweep has no
cases: one, check: {kind: average, variable: omega -> it has omega.x1, omega.x2, omega.x3
cases: one, check: {kind: average, variable: end_axis.x4 -> end_axis.x1
cases: one, check: {kind: average, variable: end_axis -> is a label, without a mean: name a share
cases: one, check: {kind: average, variable: G, at: [{damping.0: 3}] -> no position 3 on an axis
cases: one, check: {kind: average, variable: G, along: [c] -> on an axis 'c'
cases: [one, two], check: {kind: average, variable: G, against: omega -> values of 'G' and 'omega'
"""


def test_averages_over_members_and_the_distances_of_two_sweeps(tmp_path: Path) -> None:
    """A label counts as 1 where it differs, and only members that are ok, in both, count."""
    rows = AVERAGES.strip().splitlines()
    refused = [row.split(" -> ") for row in NOT_AVERAGED.strip().splitlines()]

    def judged(*checks: str) -> subprocess.CompletedProcess[str]:
        claims = (
            f"- {{id: c{i}, where: a, statement: b, expect: reproduced, {check}, least: -9}}}}\n"
            for i, check in enumerate(checks)
        )
        (tmp_path / "a.yaml").write_text(TWO_SWEEPS + "".join(claims), encoding="utf-8")
        return call(tmp_path, "claims", "a.yaml", "--json")

    judged(*rows)
    for command in ("run", "classify"):
        call(tmp_path, command, "a.yaml")
    found = [row["number"] for row in json.loads(judged(*rows).stdout)["statements"]]
    a, b = (hodo_cli.open(tmp_path / "runs" / "a.h5")[name].load() for name in ("one", "two"))
    ok, both = a.status == OK, (a.status == OK) & (b.status == OK)
    assert (ok.sum(), both.sum()) == (4, 2)
    number = a.crossings.where(ok).mean("inertia.1")
    G_of_one, G_of_two = (hodo_cli.derive(data, "G").G for data in (a, b))
    expected = [
        (a.end_axis == 1).where(ok).mean(),
        a.omega.sel(axis="x3").where(ok)[1].mean(),
        a.crossing_time.where(ok).mean(),
        number.max() - number.min(),
        (a.end_axis != b.end_axis).where(both).mean(),
        abs(G_of_one - G_of_two).where(both).mean(),
        abs(a.crossing_time - b.crossings).where(both).mean(),
    ]
    assert found == pytest.approx([*map(float, expected)])
    assert len({*found}) == len(found) - 1 > 5
    for check, words in refused:
        done = judged(check)
        assert (done.returncode, words in done.stderr) == (2, True), done.stderr


# Beside the middle axis D is a difference of terms of 1e-26 and less in a body that turns at 1.
BESIDE = (
    "model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 300}, initial: {p: 1e-13, q: 1, r: 0},"
    " sweep: {initial.p: {logspace: [1e-13, 1e-3, 3]}, initial.r: {values: [0, 1e-11]}}"
)


# Without heyoka members are single cases, whose side test_motions.py tries; here they take minutes.
@pytest.mark.heyoka
@pytest.mark.parametrize(("last", "error"), [(1e-3, "on"), (1.001e-3, "off")])
def test_members_beside_the_middle_axis_cross_as_they_must(last: float, error: str) -> None:
    """lambda1 = lambda3 forbids a crossing, which no precision would tell: D decays from 1e-18 and
    less of what its terms become. lambda1 < lambda3 allows one to x1."""
    damping = [1e-3, 5e-3, last]
    case = one(f"{BESIDE}, damping: {damping}, error: {error}")
    found = computed(case)
    assert (found["status"] == OK).all()
    for i in range(len(found["status"])):
        single = members.member(case, i)
        true = series.crossings(
            BODY, series.diagonal(BODY, damping), single.system.start, 300.0, bits=256
        )
        assert found["crossings"][i] == len(true) <= (last != 1e-3)
        if true:
            # An ulp of |omega| is up to 2e-5 of p and r, a few units of time at this difference
            # of the coefficients; the motion leaves the axis long before that has added up.
            assert found["crossing_time"][i] == pytest.approx(float(true[0].time), rel=1e-6)
            assert (found["crossing_from"][i], found["crossing_to"][i]) == (3, 1)
        _, alone = classified(replace(single, error=error))
        assert len(alone.crossings) == len(true)
        assert alone.labels[[0, -1]].tolist() == [found["start_axis"][i], found["end_axis"][i]]


RANDOM = "initial: {p: 0, q: 0, G: 1}, sweep: {d: {sphere: {count: 24, seed: 3}}}"
SKEW = "[[9e-3, 2e-3, -4e-3], [0, 7e-3, 5e-3], [3e-3, -6e-3, 4e-3]]"
MANY = {
    "paper": f"{FIG4}, {RANDOM}",
    "loose": f"{FIG4}, tol: 1e-9, {RANDOM}",
    "tensor": f"model: tensor, {HEAD}, resistance: {SKEW}, {RANDOM}",
    "cavity": f"model: cavity+constant, inertia: [1, 0.8, 0.6], kappa: 0.01, "
    f"torque: [1e-3, 2e-3, 1e-3], time: {{end: 200}}, error: off, {RANDOM}",
    "middle": "model: linear-diag, inertia: [1, 0.8, 0.6], damping: [1e-3, 5e-3, 1.001e-3], "
    "time: {end: 300}, initial: {p: 0, q: 1, r: 0}, error: off, sweep: "
    "{initial.p: {logspace: [1e-6, 1e-3, 8]}, initial.r: {logspace: [1e-6, 1e-3, 8]}}",
}


@pytest.mark.heyoka
@pytest.mark.parametrize("kind", MANY)
def test_the_time_of_a_crossing_is_right_to_the_error_that_the_member_states(kind: str) -> None:
    """Against long double, whose own error is a thousandth of it."""
    case = one(MANY[kind])
    found = computed(case)
    decided = found["status"] == OK
    crossing = np.flatnonzero(decided & (found["crossings"] > 0) & np.isfinite(found["separation"]))
    assert len(crossing) >= 4
    assert np.isfinite(found["crossing_error"][crossing]).all()
    for i in crossing[:8].tolist():
        true = precisely(members.member(case, i), "extended")
        off = abs(found["crossing_time"][i] - true.crossing_time.values[0])
        assert off <= found["crossing_error"][i]
        assert found["crossing_to"][i] == true.crossing_to[0]
    if kind == "paper":  # an error that is stated far too large would be no use
        assert np.median(found["crossing_error"][crossing]) < 1e-10 * 1000


@pytest.mark.heyoka
@pytest.mark.parametrize("end", [1e-2, 1e6])
def test_an_early_crossing_in_a_long_span_has_its_digits(end: float) -> None:
    """The time that is left has none of them. The motions cross after some steps, for in the first
    one no time has been lost yet."""
    unit = 1e-3 * end
    case = one(
        f"model: linear-diag, inertia: [1, 0.8, 0.6], time: {{end: {end}}}, error: off, "
        f"damping: [{0.5 / unit}, {0.4 / unit}, {0.3 / unit}], initial: {{p: 0, q: {0.5 / unit}, "
        f"r: {0.99 / unit}}}, sweep: {{initial.p: {{values: [{1.2 / unit}, {8 / unit}]}}}}"
    )
    found, known = computed(case), replace(case, time=replace(case.time, end=20 * unit))
    assert found["crossings"].tolist() == [1, 1]
    for i in range(2):
        true = precisely(members.member(known, i), "extended").crossing_time.values[0]
        assert abs(found["crossing_time"][i] - true) < found["crossing_error"][i] < 1e-12 * true


@pytest.mark.heyoka
def test_early_samples_in_a_long_span_have_their_digits() -> None:
    text = "model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.5, 0.4, 0.3], error: off, "
    text += "initial: {p: %s, q: 0.5, r: 0.99}, time: {values: [3.1, 7.7, 12.9%s]}"
    starts = [0.77, 0.8, 0.83]
    axis = f"store: [trajectory], sweep: {{initial.p: {{values: {starts}}}}}"
    seen = swept(f"{text % (1, ', 1e4')}, {axis}").omega.values
    for p, omega in zip(starts, seen, strict=True):
        known = hodo_cli.run(one(text % (p, ""))).omega.values
        assert omega[:3] == pytest.approx(known, rel=0, abs=1e-14)


@pytest.mark.heyoka
def test_a_motion_has_a_label_until_it_is_at_rest() -> None:
    """That is below 2^-4096, far beyond the smallest double: a rotation about x3 as a case, at the
    times when it is 2^-n, and as members that end there."""
    times = [n * math.log(2) for n in (4095, 4099, 4110)]
    text = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1e-3, q: 0, r: 1}, "
    text += "damping: [2, 2, 1]"
    rates = [time / times[0] for time in times]
    ends = f"time: {{end: {times[0]}}}, sweep: {{damping.2: {{values: {rates}}}}}"
    alone = hodo_cli.run(one(f"{text}, time: {{values: {times}}}"))
    for labels in (alone["enclosed_axis"], swept(f"{text}, {ends}")["end_axis"]):
        assert labels.values.tolist() == [3, -1, -1]


@pytest.mark.heyoka
@pytest.mark.parametrize("size", [1e-150, 1e17])
def test_the_errors_of_a_sweep_are_measured_at_every_scale(size: float) -> None:
    attributes = swept(
        "model: linear-diag, inertia: [1, 0.8, 0.6], "
        f"damping: [{0.01 * size}, {0.008 * size}, {0.006 * size}], time: {{end: {200 / size}}}, "
        f"initial: {{p: {0.8 * size}, q: {0.5 * size}, r: {0.74 * size}}}, "
        f"sweep: {{initial.p: {{linspace: [{0.75 * size}, {0.85 * size}, 40]}}}}"
    ).attrs
    assert attributes["status"] == "ok"
    assert 1e-15 < attributes["error"] < 1e-11
    quantiles = size * attributes["crossing_error_quantiles"]
    assert 1e-15 < quantiles[0] <= quantiles[-1] < 1e-10


BENT = "[[5e-3, 1e-3, 0], [1e-3, 4e-3, 0], [0, 0, 3e-3]]"


def random_starts(resistance: str, tol: float, ball: str = "count: 20000, seed: 1") -> Case:
    return one(
        f"model: tensor, {HEAD}, resistance: {resistance}, {BALL}, tol: {tol!r}, "
        f"sweep: {{d: {{sphere: {{{ball}}}}}}}"
    )


LATE = random_starts(BENT, 1e-12, "count: 100000, seed: 77")


@pytest.mark.quadruple
@pytest.mark.parametrize(
    ("case", "number", "least", "most"),
    [
        # Off by 20 and 70 times what their steps lose: they stay long near the separatrix.
        (random_starts(BENT, 2.2e-16), 1844, 2e-9, 500),
        (random_starts(SKEW, 1e-12), 2745, 1e-6, 500),
        # Off by three times the error where a step was as long as the tolerance allows by the
        # series' own last coefficients.
        (LATE, 5912, 0, math.inf),
        (LATE, 74140, 0, math.inf),
    ],
)
def test_an_error_that_grows_along_a_motion_is_stated(case, number, least, most):
    """Other members beside one change no digit of it."""
    values = computed(case, number, number + 1)
    true = precisely(members.member(case, number), "quadruple").crossing_time.values
    off = abs(values["crossing_time"][0] - true[0])
    assert least < off < values["crossing_error"][0] < most * off
    among = computed(case, number - 5, number + 7)
    assert among["crossing_error"][5] == values["crossing_error"][0]


@pytest.mark.quadruple
def test_crossings_that_no_bound_decides_are_left_to_the_single_case() -> None:
    """The first of its three is lost where D is uncertain; the result counts it."""
    case, number = random_starts(SKEW, 1e-12), 10543
    group = chunk.compute(chunk.Chunk(case, number, number + 1))
    assert group.attributes["rejections"].sum() == 1
    true = precisely(members.member(case, number), "quadruple").crossing_time.values
    assert group.variables["crossings"].data[0] == len(true) == 3
    off = abs(group.variables["crossing_time"].data[0] - true[0])
    # Its error is then the measured one.
    assert group.variables["crossing_error"].data[0] == pytest.approx(off, rel=0.01)


@pytest.mark.heyoka
def test_the_end_of_a_member_is_that_of_its_own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """An upright top that an event ends, under a weight that changes: H contains mu at that time,
    not at the end of the span, where mu is larger."""
    text = f"{TOP}, mu: [0.5, 0.05], a: 0.125, time: {{end: 2, samples: 2}}, error: off"
    alone = hodo_cli.run(one(text))
    monkeypatch.setattr(chunk, "WORTH_COMPILING", 0)
    data = swept(f"{text}, sweep: {{initial.theta: {{linspace: [0, 3, 4]}}}}")
    assert "side by side" in data.attrs["method_reason"]
    member = data.isel({"initial.theta": 0})
    assert float(alone.event_time[0]) < 0.5
    assert member.event_time == pytest.approx(alone.event_time.values[0], rel=1e-13)
    for name in ("Gz", "H", "r", "u3"):
        assert member[name] == pytest.approx(alone[name].values[-1], rel=1e-8), name


def test_a_member_without_a_last_sample_says_why_it_has_no_error() -> None:
    text = f"{TOP}, mu: 0.5, a: 0.1, m: [0.1, -0.0777], store: [trajectory]"
    text += ", time: {end: 2, samples: 5}, sweep: {initial.theta: {values: [0, 1]}}"
    reason = "an event ends them before their last sample"
    assert swept(text).attrs["warnings"] == f"1 of 2 members have no measured error: {reason}"
