"""Units: what is stored and derived scales as its unit says, in every form of every model."""

import json
import re
from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import BODY as P1
from conftest import call

import hodo_cli
from hodo_cli import models
from hodo_cli.quantities import QUANTITIES
from hodo_cli.results.dataset import motion_from

SECOND, MOMENT = 2.0, 3.0
"""The factors by which the numbers of a time and of a moment of inertia grow, in smaller units."""

OMEGA = {"p": (0.8, -1, 0), "q": (0.5, -1, 0), "r": (0.74, -1, 0)}
BODY: dict[str, Any] = {"inertia": [(1.0, 0, 1), (0.8, 0, 1), (0.6, 0, 1)], "initial": OMEGA}
DAMPING = [(5e-3, -1, 0), (4e-3, -1, 0), (3e-3, -1, 0)]
DISC = {
    "inertia": [(8.0, 0, 1), (8.0, 0, 1), (4.0, 0, 1)],
    "cavity": {"kappa": (6e-3, 1, 1)},
    "torque": [(0.0, -2, 1), (0.0, -2, 1), (-0.1, -2, 1)],
    "epsilon": 0.1,
    "initial": {"x": (1.0, -2, 0), "y": (1.0, -2, 0)},
}
TOP: dict[str, Any] = {
    "inertia": {"A": (1.5, 0, 1), "C": (1.0, 0, 1)},
    "mu": (0.5, -2, 1),
    "a": (0.125, -1, 1),
    "b": (0.1, -1, 1),
    "initial": {"theta": 1.0, "r": (1.7, -1, 0)},
}
DATA: dict[str, dict[str, Any]] = {
    "linear-diag": BODY | {"damping": DAMPING},
    "tensor": BODY | {"resistance": {"diagonal": (4e-3, -1, 1), "off_diagonal": (1e-3, -1, 1)}},
    "cavity+constant": DISC,
    "Lagrange-averaged": TOP,
    "torques": BODY | {"damping": DAMPING, "kappa": (2e-3, 1, 1)},
}
"""Data of each model: numbers with the powers of time and inertia that they carry."""

FORMS = [
    (model, form) for model, forms in models.catalogue().items() if model in DATA for form in forms
]


def scaled(value: Any, unit: tuple[float, float]) -> Any:
    """Data in units that make times and moments so many times as large."""
    if isinstance(value, Mapping):
        return {key: scaled(item, unit) for key, item in value.items()}
    if isinstance(value, list):
        return [scaled(item, unit) for item in value]
    if isinstance(value, tuple):
        number, of_time, of_inertia = value
        return number * unit[0] ** of_time * unit[1] ** of_inertia
    return value


@cache
def motion(model: str, form: str, unit: tuple[float, float]) -> Any:
    """A classified case of a form, in units of its own."""
    data = scaled(DATA[model], unit)
    data |= {"epsilon": 0.05} if (model, form) == ("Lagrange-averaged", "full") else {}
    data |= {"attitude": "yes"} if (model, form) == ("torques", "full") else {}
    end = 3.0 if model == "Lagrange-averaged" else 400.0
    time = {"end": end * unit[0], "samples": 9, "unit": "s"}
    case = {"model": model, "form": form, "time": time, "inertia_unit": "kg m^2", "error": "off"}
    made = hodo_cli.run(case | data)
    assert made.attrs["status"] == "ok", made.attrs["message"]
    return motion_from(made, "case")


def factor(unit: str) -> float:
    """By what a number grows whose unit is a product of powers of s and kg m^2."""
    powers = Counter[str]()
    for sign, product in zip((1, -1), unit.split("/"), strict=False):
        for word in product.split():
            name, _, power = word.partition("^")
            powers[name] += sign * int(power or 1)
    assert powers.keys() <= {"s", "kg", "m", "rad", "1"}, unit
    assert powers["m"] == 2 * powers["kg"], unit
    return float(SECOND ** powers["s"] * MOMENT ** powers["kg"])


def values_of(motion: Any, name: str) -> np.ndarray | None:
    """A stored variable or a quantity; None of one that the motion does not have."""
    try:
        return np.asarray(motion.stored(name) if name in motion.data else motion.quantity(name))
    except (hodo_cli.HodoError, KeyError):
        return None


@pytest.mark.parametrize(("model", "form"), FORMS)
def test_every_variable_and_quantity_scales_as_its_unit_says(model: str, form: str) -> None:
    here, there = motion(model, form, (1.0, 1.0)), motion(model, form, (SECOND, MOMENT))
    numbers = [name for name, variable in here.data.items() if variable.data.dtype.kind == "f"]
    tried = 0
    for name in [*numbers, *QUANTITIES]:
        ours, theirs = (values_of(m, name) for m in (here, there))
        if ours is None or theirs is None:
            continue
        tried += 1
        assert here.units(name) == there.units(name)
        size = np.nanmax(np.abs(ours), initial=0)
        # A phase is magnified, an error is of the order of its rounding.
        bound = np.inf if name == "crossing_error" else 1e-6 * size + 1e-12
        difference = np.abs(theirs / factor(here.units(name)) - ours)
        assert np.nanmax(difference, initial=0) <= bound, name
    assert tried >= 6


def test_every_quantity_is_one_of_some_form() -> None:
    motions = [motion(model, form, (1.0, 1.0)) for model, form in FORMS]
    assert not [name for name in QUANTITIES if all(values_of(m, name) is None for m in motions)]


def test_every_model_of_hodo_is_tried() -> None:
    first = {model: next(iter(forms.values())) for model, forms in models.catalogue().items()}
    own = {name for name, form in first.items() if form.__module__.startswith("hodo_cli.")}
    assert own == set(DATA)


@pytest.mark.parametrize(
    ("variable", "time", "inertia", "written"),
    [
        ("T", "s", "kg m^2", "kg m^2/s^2"),
        ("G2", "s", "kg m^2", "kg^2 m^4/s^2"),
        ("G", "s", "1", "1/s"),
        ("G", "1", "kg m2", "kg m^2"),
        ("J", "s", "N m s^2", "N m s^2"),
        ("G", "s", "N m s^2", "N m s"),
        ("p", "days", "1", "1/days"),
        ("x", "10 s", "1", "1/(10 s)^2"),
        ("crossing_time", "10 s", "1", "10 s"),
        ("p", "1", "kg m^2", "1"),
        ("G", "s", "kg/m", "kg m^-1 s^-1"),
        ("psi", "s", "1", "rad"),
        ("x1_direction", "s", "kg m^2", "1"),
    ],
)
def test_units_are_products_of_powers(variable: str, time: str, inertia: str, written: str) -> None:
    body = scaled(BODY, (1, 1)) | {"model": "linear-diag", "time": {"end": 1, "unit": time}}
    motion = motion_from(hodo_cli.run(body | {"inertia_unit": inertia}), "a")
    assert motion.units(variable) == written


def test_keys_of_a_sweep_have_units_and_the_symbols_of_their_coefficients() -> None:
    """Those within a key their own."""
    units = {"attitude.euler.1": "rad", "damping.0": "1/s", "quadratic": "1"}
    units |= {"resistance.1.1": "kg m^2/s"}
    units |= {"torque.1": "kg m^2/s^2", "constants.k": "1"}
    case = {"model": "torques", "inertia": [3, 2, 1], "initial": {"p": 1, "q": 1, "r": 1}}
    case |= {"damping": [0.1, 0.1, "0.1*(1 + k*t)**-1"], "quadratic": 0.1, "torque": 0.1}
    case |= {"resistance": np.diag([0.1, 0.2, 0.3]).tolist()}
    case |= {"constants": {"k": 0.1}, "attitude": {"euler": [0.1, 0.2, 0.3]}, "error": "off"}
    case |= {"inertia_unit": "kg m^2", "time": {"end": 1, "unit": "s"}, "method": "DOP853"}
    swept = hodo_cli.sweep(case | {"sweep": {key: {"values": [0.2]} for key in units}})
    assert {key: swept.coords[key].attrs["units"] for key in units} == units
    for key, symbol in (("resistance.1.1", "I_{22}"), ("attitude.euler.1", r"\mathrm{euler}_2")):
        figure = hodo_cli.plot(swept, kind="curve", variable="end_axis.x1", x=key)
        assert figure.axes[0].get_xlabel().startswith(f"${symbol}$")
    body = scaled(BODY, (1, 1)) | {"model": "cavity+constant", "inertia_unit": "g cm^2"}
    axis = {"kappa": {"values": [0.001, 0.002]}}
    swept = hodo_cli.sweep(body | {"time": {"end": 1, "unit": "s"}, "sweep": axis, "error": "off"})
    axes = hodo_cli.plot(swept, kind="curve", variable="crossings", x="kappa").axes[0]
    assert axes.get_xlabel().endswith("[g cm$^{2}$ s]")
    assert not (axes.get_yticks() % 1).any()


def test_figures_files_and_tables_name_the_units(tmp_path: Path) -> None:
    body = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: .8, q: .5, r: .74}, "
    body += "damping: [.05, .04, .03], time: {end: 40, unit: s}, inertia_unit: kg m^2"
    turned = f"{body}, attitude: yes, error: off"
    starts = "p: 0, q: 0, G: 1}, error: off, sweep: {direction: {sphere: {count: 9, seed: 1}}}"
    sweep = "error: off, sweep: {damping.0: {linspace: [0.04, 0.06, 3]}}"
    figure = "{kind: series, cases: [a], variables: [p, G, T, D, D/2T]}"
    curve = "{kind: curve, cases: [s], variable: crossing_G, x: damping.0}"
    text = f"cases:\n  a: {{{body}}}\n  s: {{{body}, {sweep}}}\n  t: {{{turned}}}\n"
    text += f"  d: {{{body.replace('p: .8, q: .5, r: .74}', starts)}}}\nfigures:\n  f: {figure}\n"
    text += f"  c: {curve}\n  b: {{kind: sphere, cases: [a]}}\n"
    text += "  q: {kind: quadrants, cases: [a]}\n  h: {kind: herpolhode, cases: [t]}\n"
    (tmp_path / "u.yaml").write_text(text, encoding="utf-8")
    assert call(tmp_path, "run", "u.yaml", "--quiet").returncode == 0
    table = call(tmp_path, "classify", "runs/u.h5").stdout
    assert " s (x1 -> x3, error " in table
    rows = json.loads(call(tmp_path, "classify", "runs/u.h5", "--json").stdout)
    assert rows[0]["units"] == {"time": "s", "G": "kg m^2/s"}
    done = call(tmp_path, "plot", "runs/u.h5", "--format", "csv", "--format", "svg")
    assert done.returncode == 0, done.stderr
    tables = (tmp_path / f"runs/figures/u/{name}.csv" for name in "fcbqh")
    heads = [table.read_text(encoding="utf-8").splitlines()[0] for table in tables]
    assert heads == [
        "curve,time [s],p [1/s],G [kg m^2/s],T [kg m^2/s^2],D [kg^2 m^4/s^2],D/2T [kg m^2]",
        "curve,damping.0 [1/s],crossing_G [kg m^2/s]",
        "curve,time [s],G.x1/|G|,G.x2/|G|,G.x3/|G|",
        "curve,time [s],p^2 [1/s^2],K r^2 [1/s^2]",
        "curve,time [s],omega_space.x' [1/s],omega_space.y' [1/s]",
    ]
    stored = hodo_cli.open(tmp_path / "runs/u.h5")
    for variables, label in (
        (["G", "theta"], "$|G|$ [kg m$^{2}$/s], $\\theta$ [rad]"),
        (["p", "q"], "$p$, $q$ [1/s]"),
    ):
        (axes,) = hodo_cli.plot(stored["t"], "series", variables=variables, panels="case").axes
        assert axes.get_ylabel() == label
    swept = {"variable": "crossing_G", "x": "damping.0", "kind": "curve"}
    (axes,) = hodo_cli.plot(stored["s"], **swept).axes
    assert axes.get_ylabel() == "$|G|$ at $t_1$ [kg m$^{2}$/s]"
    assert stored["s"]["crossing_time"].attrs["units"] == "s"
    assert stored["s"]["damping.0"].attrs["units"] == "1/s"
    assert stored["s"]["crossing_G"].attrs["units"] == "kg m^2/s"


def averaged_in(of_time: float, model: str, other: dict[str, Any], end: float) -> Any:
    """An averaged motion, in a unit of time that makes it so many times as long."""
    data = scaled(DATA[model] | other, (of_time, 1.0))
    time = {"end": end * of_time, "samples": 5}
    return hodo_cli.run({"model": model, "form": "averaged", "time": time} | data)


TRIAXIAL = {"inertia": [1, 0.8, 0.6], "initial": OMEGA, "torque": [0.0, 0.0, 0.0]}
SLOW = {"damping": [(1e-13 * x, -1, 0) for x, *_ in DAMPING]}


@pytest.mark.parametrize(
    ("model", "other", "end", "powers"),
    [
        ("linear-diag", {}, 400, {"momentum": 1, "J": 0, "crossing_time": -1}),
        # The terms of a series in the seconds of a body of the sky are below the smallest double.
        ("linear-diag", SLOW, 1e16, {"momentum": 1, "J": 0, "crossing_time": -1}),
        ("tensor", {}, 400, {"momentum": 1, "J": 0}),
        ("cavity+constant", TRIAXIAL, 400, {"momentum": 1, "J": 0}),
        ("cavity+constant", {}, 400, {"x": 2, "y": 2}),
    ],
)
@pytest.mark.parametrize("rate", [2.0**-60, 2.0**100])
def test_averaged_motions_are_alike_in_units_of_any_size(model, other, end, powers, rate):
    here, there = (averaged_in(x, model, other, end) for x in (1.0, 1 / rate))
    assert there.attrs["status"] == "ok"
    assert there.attrs["error"] < 1e-11
    for name, power in powers.items():
        np.testing.assert_allclose(there[name] / rate**power, here[name], rtol=1e-11)


@pytest.mark.heyoka
def test_members_pass_in_any_unit_of_time() -> None:
    """Those whose rates are 1e6 times too small for steps side by side go by themselves."""

    def passages(unit: float) -> Any:
        axis = {"initial.r": {"linspace": [0.5 / unit, 1.5 / unit, 1000]}}
        data = {"kappa": 0.6048 * unit, "torque": [0, 0, -0.1 / unit**2], "epsilon": 0.1}
        data |= {"initial": {"p": 1 / unit, "q": 0, "r": 1 / unit}, "time": {"end": 60 * unit}}
        form = {"model": "cavity+constant", "form": "averaged", "inertia": [8, 8, 4]}
        return hodo_cli.sweep(form | data | {"sweep": axis})

    here, there = passages(1.0), passages(1e6)
    assert here.attrs["method_reason"] == "side by side, 0 of 1000 members by themselves"
    assert (here["status"] == there["status"]).all()
    np.testing.assert_allclose(there["event_time"] / 1e6, here["event_time"], rtol=2e-13)


@pytest.mark.parametrize(
    ("time_unit", "inertia_unit", "labels"),
    [
        ("1", "1", [r"$p$ [–]", r"$T$ [–]"]),
        ("s", "1", [r"$p$ [1/s]", r"$T$"]),
        ("s", "kg m^2", [r"$p$ [1/s]", r"$T$ [kg m$^{2}$/s$^{2}$]"]),
    ],
)
def test_axes_have_a_dash_where_the_case_has_no_units_and_nothing_where_one_is_lacking(
    time_unit: str, inertia_unit: str, labels: list[str]
) -> None:
    body = scaled(BODY, (1, 1)) | {"model": "linear-diag", "inertia_unit": inertia_unit}
    motion = hodo_cli.run(body | {"time": {"end": 10, "unit": time_unit}})
    drawn = hodo_cli.plot(motion, kind="series", variables=["p", "T"])
    assert [axes.get_ylabel() for axes in drawn.axes] == labels


def test_the_slow_time_of_a_top_is_not_named_as_the_time() -> None:
    """Its axis is tau = epsilon t, in a unit or not."""
    top = scaled(TOP, (1, 1)) | {"model": "Lagrange-averaged", "form": "full", "epsilon": 0.05}
    motion = hodo_cli.run(top | {"time": {"end": 1, "samples": 101, "unit": "s"}})
    (axes,) = hodo_cli.plot(motion, kind="series", variables=["Gz"]).axes
    assert axes.get_xlabel() == r"$\tau$ [s]"


# Seconds since an epoch: the digits that all times have in common tell nothing.

START = 1_700_000_000
SINCE_EPOCH = f"""
defaults:
  model: torques
  inertia: [1, 0.8, 0.6]
  initial: {{p: 0.8, q: 0.5, r: 0.74}}
  time: {{start: {START}, end: {START + 600}, samples: 1201, unit: s}}
cases:
  turning: {{damping: [0.005, 0.004, 0.003]}}
  pole: {{expression: [0.001/(t - 30), 0, 0], time: {{epoch: {START}}}}}
  braked: {{brake: 0.01, damping: 0.001}}
  broken: {{damping: [0.005, 0.004, 0.003], max_steps: 20}}
  starts:
    damping: [0.005, 0.004, 0.003]
    initial: {{p: 0, q: 0, G: 1}}
    sweep: {{direction: {{sphere: {{count: 200}}}}}}
figures:
  turning: {{kind: hodograph, cases: turning}}
  broken: {{kind: hodograph, cases: broken}}
claims:
  - {{id: wrong, where: here, statement: p falls., cases: [turning], expect: contradicted,
      check: {{kind: monotone, of: [p], sense: falls}}}}
  - {{id: crosses, where: here, statement: It crosses., cases: [turning], expect: reproduced,
      check: {{kind: crossings, from: x1, to: x3}}}}
"""
EPOCH = re.compile(r"\b1\.7e\+0?9|\b1700000\d{3}(?:\.\d+)?")


def seconds(text: str) -> list[float]:
    """How long after the start each of the times in a text is; nan for one without the digits."""
    times = [float(time) - START for time in EPOCH.findall(text)]
    assert times, text
    return times


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("epoch")
    (folder / "c.yaml").write_text(SINCE_EPOCH, encoding="utf-8")
    assert call(folder, "run", "c.yaml", "--quiet").returncode == 1
    assert call(folder, "classify", "c.yaml").returncode == 0
    return folder


def test_commands_tell_times_since_an_epoch_apart(folder: Path) -> None:
    shown = call(folder, "show", "c.yaml").stdout
    pole, stop = seconds(shown)
    assert pole == pytest.approx(30, abs=0.05)  # "near", by doubles of 1.7e9 s
    assert 0 < stop < 600
    labelled = call(folder, "classify", "c.yaml").stdout
    crossing, broken_at_pole, exact_stop, broken, first, last, median = seconds(labelled)
    assert stop == pytest.approx(exact_stop, abs=1e-3)
    assert 0 < broken_at_pole < 30
    assert 0 < broken < 600
    assert crossing == pytest.approx(305.358955, abs=1e-3)  # as that from t = 0
    assert 0 < first < median < last < 600
    verdicts = call(folder, "claims", "c.yaml").stdout
    assert seconds(verdicts)[-1] == pytest.approx(crossing, abs=0.1)
    assert 0 < seconds(verdicts)[0] < 600
    assert seconds(call(folder, "plot", "c.yaml").stderr) == [broken]


def test_figures_tell_times_since_an_epoch_apart(folder: Path) -> None:
    motion = hodo_cli.open(folder / "runs" / "c.h5")["turning"]
    (crossing,) = motion.crossing_time.data - START
    (legend,) = hodo_cli.plot(motion).legends
    words = " ".join(text.get_text() for text in legend.get_texts())
    assert seconds(words) == [pytest.approx(crossing, abs=1e-3), 600]
    time = {"start": START, "end": START + 60, "samples": 601}
    body = hodo_cli.run(P1 | {"attitude": True, "time": time})
    figure = hodo_cli.plot(body, kind="body")
    assert [seconds(axes.get_title()) for axes in figure.axes] == [[0], [30], [60]]


def test_a_stop_whose_error_is_not_measured_is_told_as_well(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(SINCE_EPOCH.replace("damping: 0.001", "error: off"))
    assert call(tmp_path, "run", "c.yaml", "--case", "braked", "--quiet").returncode == 0
    (stop,) = seconds(call(tmp_path, "show", "c.yaml").stdout)
    assert 0 < stop < 600
