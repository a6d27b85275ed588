"""Figures: the values that they show, their words, their formats, and what is refused.

Where HODO_FUZZ is set, all figures of motions are asked whether they are legible."""

import csv
import io
import os
import re
import warnings
from collections.abc import Iterator
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.image
import numpy as np
import pytest
import xarray as xr
import yaml
from conftest import ROOT, Hodo, call, figure_kinds
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import hodo_cli as api
from hodo_cli import HodoError

CROSSING = {
    "model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.015, 0.004, 0.003],
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
}  # fmt: skip


def motion(end: float = 100, samples: int = 501, **keys: Any) -> Any:
    """A damped body, or what other keys make of it."""
    return api.run({**CROSSING, "time": {"end": end, "samples": samples}, "error": "off", **keys})


# Six rules of legibility, of figures of the case files that come with hodo.


def entries_of(config: str) -> dict[str, dict[str, Any]]:
    """The figures of a case file that comes with hodo."""
    figures = yaml.safe_load((ROOT / "configs" / f"{config}.yaml").read_text("utf-8"))["figures"]
    return {name: entry for name, entry in figures.items() if entry.get("kind") != "map"}


CHOSEN = {
    "paper1": ["fig1", "fig4", "fig4-projections", "fig4-invariants", "fig5", "fig13"],
    "paper2": ["fig1", "phase"],
    "paper3": ["figure"],
    "attitude": ["herpolhode", "body-flip", "traces"],
    "torques": ["braked-with-fluid", "symmetric"],
}
"""Figures of every kind, layout and decoration, those of sweeps excepted."""

FIGURES = [
    (config, name)
    for config, chosen in CHOSEN.items()
    for name in (entries_of(config) if "HODO_FUZZ" in os.environ else chosen)
]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the results of the cases of these figures, classified."""
    folder = tmp_path_factory.mktemp("results")
    for name in CHOSEN:
        entries = [entries_of(name)[figure] for of, figure in FIGURES if of == name]
        cases = {case for entry in entries for case in entry.get("cases", ())}
        asked = [word for case in sorted(cases) for word in ("--case", case)]
        config = ROOT / "configs" / f"{name}.yaml"
        for command in (["run", config, "--out", ".", *asked], ["classify", f"{name}.h5"]):
            done = call(folder, *command)
            assert done.returncode == 0, done.stderr
    return folder


def drawn(folder: Path, config: str, name: str) -> Any:
    """A figure of a case file as a notebook draws it from the result, once it is laid out."""
    entry, cases = entries_of(config)[name], api.open(folder / f"{config}.h5")
    keys = {key: value for key, value in entry.items() if key not in ("cases", "scale_with")}
    named = entry.get("cases", ())
    names = [named] if isinstance(named, str) else named
    # A sketch draws bodies, and takes no cases.
    figure = api.plot([cases[name] for name in names] or [cases[next(iter(cases))]], **keys)
    figure.set_dpi(100)
    figure.draw_without_rendering()
    return figure


def all_texts(figure: Any) -> Iterator[Any]:
    """Every text of a figure but for numbers at ticks."""
    yield from [figure._suptitle] if figure._suptitle else []
    for axes in figure.axes:
        yield from (*axes.texts, axes.title, axes.xaxis.label, axes.yaxis.label)
    for legend in figure.legends:
        yield from legend.get_texts()


@pytest.mark.parametrize(("config", "name"), FIGURES)
def test_a_figure_is_legible(results: Path, config: str, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        figure = drawn(results, config, name)
    texts = [x for x in all_texts(figure) if x.get_visible() and x.get_text().strip()]
    # 1. Nothing is cut off.
    for text in texts:
        box = text.get_window_extent()
        ends = (box.x0, box.y0, figure.bbox.x1 - box.x1, figure.bbox.y1 - box.y1)
        assert min(ends) >= -1, text.get_text()
    # 2. No word is on another one.
    for a, b in combinations(texts, 2):
        one, other = (x.get_window_extent().padded(-1.5) for x in (a, b))
        assert not one.overlaps(other), (a.get_text(), b.get_text())
    # 3. Letters are of six points at least.
    assert min(text.get_fontsize() for text in texts) >= 5.5
    # 4. A panel has room, and is on no other.
    panels = [axes for axes in figure.axes if axes.get_subplotspec()]
    assert min((axes.bbox.width for axes in panels), default=100) > 100 * 18 / 25.4
    assert not any(a.bbox.padded(-1).overlaps(b.bbox) for a, b in combinations(panels, 2))
    # 5. Numbers at ticks stand apart.
    for axes in panels:
        for axis, ends in ((axes.xaxis, ("x0", "x1")), (axes.yaxis, ("y0", "y1"))):
            labels = [x for x in axis.get_ticklabels() if x.get_visible() and x.get_text().strip()]
            boxes = [text.get_window_extent() for text in labels]
            places = sorted(tuple(getattr(box, end) for end in ends) for box in boxes)
            shown = [p for p in places if axes.bbox.intervalx[0] - 9 <= p[1]]
            assert all(a[1] <= b[0] + 2 for a, b in pairwise(shown)) or axes.name == "hammer"
    # 6. No two entries of a legend look the same or have the same words.
    for legend in figure.legends:
        words = [text.get_text() for text in legend.get_texts()]
        plain = [line for line in legend.get_lines() if line.get_marker() in ("None", None)]
        ways = [(to_hex(line.get_color()), str(line.get_linestyle())) for line in plain]
        assert (len(words), len(ways)) == (len({*words}), len({*ways}))


def table(run: Hodo, folder: Path, *command: object) -> tuple[list[str], list[list[str]]]:
    """The head and the rows of the CSV that `hodo plot` names."""
    done = run("plot", *command, "--format", "csv")
    assert done.returncode == 0, done.stderr
    head, *rows = csv.reader(io.StringIO((folder / done.stdout.split()[0]).read_text("utf-8")))
    return head, rows


def test_a_table_has_a_row_for_each_stored_sample_plain_names_and_units(
    hodo: Hodo, tmp_path: Path, results: Path
) -> None:
    data = api.open(results / "paper1.h5")["fig4"]
    head, rows = table(hodo, tmp_path, results / "paper1.h5", "fig4")
    assert head == ["curve", "time", "G.x1", "G.x2", "G.x3"]
    values = np.array(rows)[:, 1:].astype(float)
    np.testing.assert_array_equal(values[:, 0], data.time)
    np.testing.assert_array_equal(values[:, 1:], data.omega * [1, 0.8, 0.6])
    head, _ = table(hodo, tmp_path, results / "paper2.h5", "fig1")
    assert head == ["curve", "time [s]", "x [1/s^2]", "y [1/s^2]"]
    _, rows = table(hodo, tmp_path, results / "paper3.h5", "figure")
    assert {row[0] for row in rows} >= {"case 1, θ^0 = 5°", "case 3, θ^0 = 150°"}


KEYS_OF_KINDS = {
    "axis-trace": "cases: one, axes: [x1, x3]", "phase": "cases: one, x: p, y: q",
    "series": "cases: one, variables: [G, omega.x1, psi]", "body": "cases: one, seconds: 0.3",
    "sphere": "cases: one, ellipsoid: yes", "quadrant-sketch": "bodies: [[1, 0.8, 0.6]]",
    "map": "cases: grid, variable: crossing_time, x: damping.0, y: q",
    "curve": "cases: grid, variable: crossing_time, x: damping.0, by: q",
}  # fmt: skip
ALL_KINDS = """
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.045, 0.012, 0.009], error: off,
           initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 20, samples: 41}}
cases:
  one: {attitude: yes}
  grid: {sweep: {damping.0: {values: [0.03, 0.045]}, q: {zip: {initial.q: {values: [0.3, 0.5]}}}}}
figures:
"""


def test_every_format_of_every_kind(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(
        ALL_KINDS
        + "".join(
            f"  {kind}: {{kind: {kind}, {KEYS_OF_KINDS.get(kind, 'cases: one')}}}\n"
            for kind in sorted(figure_kinds())
        )
    )
    assert hodo("run", "c.yaml").returncode == 0
    assert hodo("classify", "runs/c.h5").returncode == 0
    few, more = ("phase", "body", "map"), ("png", "svg", "pdf", "html", "gif")
    for names, formats in (((), ["csv"]), (few, more)):
        asked = [word for suffix in formats for word in ("--format", suffix)]
        done = hodo("plot", "c.yaml", *names, *asked)
        assert done.returncode == 0, done.stderr
    begins = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF", "html": b"<!DOC", "gif": b"GIF89"}
    for suffix in ("csv", *more):
        files = [*(tmp_path / "runs/figures/c").glob(f"*.{suffix}")]
        kinds = {"csv": figure_kinds(), "gif": {"body"}}.get(suffix, {*few})
        assert {file.stem for file in files} == kinds
        assert all(file.read_bytes().startswith(begins.get(suffix, b"")) for file in files)
    # The same results give the same bytes.
    files = [tmp_path / "runs/figures/c" / f"phase.{suffix}" for suffix in ("svg", "pdf")]
    before = {x: x.read_bytes() for x in files}
    assert hodo("plot", "c.yaml", "phase", *asked, "--force").returncode == 0
    assert before == {x: x.read_bytes() for x in before}


# Between samples


def points_of(axes: Any) -> np.ndarray:
    """The points (n, 2) of the curves of a panel."""
    paths = [x for c in axes.collections if isinstance(c, LineCollection) for x in c.get_paths()]
    lines = [line.get_xydata() for line in axes.lines if len(line.get_xdata()) > 9]
    return np.concatenate([*(path.vertices for path in paths), *lines])


def test_a_curve_between_few_samples_is_that_of_many() -> None:
    """A body that turns by a radian between its samples is drawn as one with 200 times as many,
    to a part in 250."""
    keys = {"damping": [0, 0, 0], "attitude": True}
    few, many = motion(60, 61, **keys), motion(60, 12001, **keys)
    for kind in ("herpolhode", "phase"):
        more = {"x": "omega.x1", "y": "omega.x2"} if kind == "phase" else {}
        one, other = (points_of(api.plot(data, kind, **more).axes[0]) for data in (few, many))
        apart = np.hypot(*(one[:, None] - other).T).min(axis=0)
        assert len(one) > 4 * 61
        assert apart.max() < np.abs(other).max() / 250


def test_a_curve_changes_its_colour_at_the_crossing() -> None:
    """To the colour that the legend gives its axis."""
    data = motion(300, 31)
    figure = api.plot(data, "quadrants")
    first, _ = figure.axes[0].collections[0].get_paths()
    # On the diagonal, though no sample is near it.
    assert abs(np.subtract(*first.vertices[-1])) < 0.05 * first.vertices[-1].max()
    assert [int(data.enclosed_axis[i]) for i in (0, -1)] == [1, 3]
    (legend,) = figure.legends
    named = {h.get_label(): to_hex(h.get_color()) for h in legend.legend_handles}
    before, after = figure.axes[0].collections[0].get_colors()
    assert to_hex(before) == named["about $x_1$"] == "#0072b2"
    assert to_hex(after) == named["about $x_3$"] == "#bf8200"


def test_a_panel_says_unit_case_and_colour_of_its_curves() -> None:
    time = {"end": 10, "samples": 101, "unit": "s"}
    cases = [motion(10, 101, damping=damping, time=time) for damping in (0, 0.1)]
    figure = api.plot(cases, "series", variables=["omega.x1", "G"], labels=["free", "damped"])
    omega, G = figure.axes
    assert omega.get_ylabel() == "$p$ [1/s]"
    assert omega.get_xlabel() == G.get_xlabel() == "$t$ [s]"
    (legend,) = figure.legends
    named = {h.get_label(): h.get_color() for h in legend.legend_handles}
    for label, data in zip(("free", "damped"), cases, strict=True):
        (line,) = [x for x in omega.lines if x.get_label() == label]
        assert line.get_color() == named[label]
        at_samples = np.interp(data.time, *line.get_xydata().T)
        np.testing.assert_allclose(at_samples, data.omega[:, 0], atol=1e-12)


FAST = "20*3.14159265358979*0.5*cos(20*3.14159265358979*t)"


@pytest.mark.parametrize(
    ("formula", "samples", "variables", "coarse"),
    [
        # r oscillates between 0.5 and 1.5, with a sample in each period, at one phase or another.
        (FAST, 101, ["r"], True),
        (FAST, 138, ["omega.x3"], True),
        (FAST, 3601, ["r", "G"], False),
        # A component that no torque turns is a line between its samples.
        (FAST, 101, ["p"], False),
        # A pulse is a jump for the eye, also between two samples.
        ("0.5*exp(-900*(t - 4.71)**2)", 201, ["r"], False),
    ],
)
def test_a_torque_that_changes_between_the_samples_is_warned_of_once(
    formula: str, samples: int, variables: list[str], coarse: bool
) -> None:
    case = {"model": "torques", "inertia": [2, 1.5, 1], "expression": ["0", "0", formula],
            "initial": {"p": 0, "q": 0, "r": 1}, "error": "off"}  # fmt: skip
    data = api.run({**case, "time": {"end": 10, "samples": samples}})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        api.plot(data, "series", variables=variables)
    assert ["not known between" in str(w.message) for w in caught] == [True] * coarse


@pytest.mark.parametrize("part", [slice(None), slice(100, 300)])
def test_the_samples_that_a_warning_advises_are_those_of_the_case(part: slice) -> None:
    """Also where a part of it is drawn; with as many there is no warning."""
    spun = {"damping": [0, 0, 0], "initial": {"p": 8, "q": 5, "r": 7.4}}
    data = motion(300, 401, **spun).isel(time=part)
    with pytest.warns(UserWarning, match="not known between its samples") as caught:
        api.plot(data)
    samples = int(re.search(r"samples: (\d+)", str(caught[0].message))[1])
    assert 800 < samples < 6000
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        api.plot(motion(300, samples, **spun))


# What is drawn, kind by kind


def test_each_moment_of_a_body_has_a_panel() -> None:
    figure = api.plot(motion(10, 101, attitude=True), "body", moments=[0, 2, 4, 6])
    assert [axes.get_title()[-1] for axes in figure.axes] == ["0", "2", "4", "6"]


@pytest.mark.parametrize("inertia", [[1, 0.8, 0.6], [0.6, 1, 0.8]])
def test_polhodes_lie_on_the_ellipsoid_of_inertia(inertia: list[float]) -> None:
    """2 T is one number on it, and its longest axis is 1."""
    data = motion(20, 201, inertia=inertia, damping=[0, 0, 0])
    figure = api.plot(data, "sphere", ellipsoid=True, view=[0, 0])
    # Seen along x1, the outline has the semi-axes of x2 and x3.
    outline = figure.axes[0].patches[0].get_xy()
    lengths = np.sqrt(min(inertia) / np.array(inertia))
    np.testing.assert_allclose(outline.max(axis=0), lengths[1:], rtol=1e-3)


def test_a_map_without_a_value_says_so_and_a_logarithmic_axis_has_plain_numbers(
    hodo: Hodo, tmp_path: Path
) -> None:
    (tmp_path / "c.yaml").write_text("""
cases:
  grid: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0.004, time: {end: 5},
         initial: {p: 0.8, q: 0.5, r: 0.74},
         sweep: {initial.q: {values: [0.4, 0.5]}, initial.p: {logspace: [20, 80, 5]}}}
figures:
  m: {kind: map, cases: [grid], variable: crossing_time, x: initial.p, y: initial.q}
""")
    assert hodo("run", "c.yaml").returncode == 0
    done = hodo("plot", "c.yaml", "--format", "svg")
    assert done.returncode == 0, done.stderr
    svg = (tmp_path / "runs/figures/c/m.svg").read_text()
    assert "no crossing" in re.sub(r"<!-- | -->", "", svg)
    grid = api.open(tmp_path / "runs/c.h5")["grid"]
    figure = api.plot(grid, "map", variable="G", x="initial.p", y="initial.q")
    figure.draw_without_rendering()
    axis = figure.axes[0].xaxis
    shown = [x.get_text() for x in (*axis.get_ticklabels(), *axis.get_ticklabels(minor=True))]
    assert {"20", "40"} <= {*shown}
    assert not any("times" in text for text in shown)


def test_a_user_has_a_look_of_their_own_and_a_figure_keeps_it() -> None:
    data = motion(10, 101)
    with matplotlib.rc_context({"font.size": 14, "axes.facecolor": "#eeeeee"}):
        figure = api.plot(data, "phase", x="p", y="q")
    assert figure.axes[0].xaxis.label.get_fontsize() == 14
    assert to_hex(figure.axes[0].get_facecolor()) == "#eeeeee"
    own = api.plot(data, "phase", x="p", y="q", style={"rc": {"font.size": 6}})
    assert own.axes[0].xaxis.label.get_fontsize() == 6


def test_a_style_sets_the_size_and_each_panel(tmp_path: Path) -> None:
    data = motion(10, 101)
    for width, mm in (("column", 84), ("page", 174), (100, 100)):
        figure = api.plot(data, style={"width": width, "height": 60})
        np.testing.assert_allclose(25.4 * figure.get_size_inches(), [mm, 60])
    style = {"axes": {"yscale": "log", "xlim": [1, 5]}}
    axes = api.plot(data, "series", variables=["G"], style=style).axes[0]
    assert axes.get_yscale() == "log"
    assert axes.get_xlim() == (1, 5)
    api.plot(data, zoom=0.9, style={"width": "column"}).savefig(tmp_path / "narrow.png", dpi=50)
    assert matplotlib.image.imread(tmp_path / "narrow.png").shape[1] == int(50 * 84 / 25.4)


def test_a_body_is_seen_from_behind_and_time_is_a_variable_of_a_phase() -> None:
    data = motion(10, 101, attitude=True)
    # The axes y and z of space point away from the reader.
    names = {text.get_text() for text in api.plot(data, "body", view=[-60, -90]).axes[0].texts}
    assert {"$x$", "$y$", "$z$"} <= names
    lines = api.plot(data, "phase", x="time", y="G").axes[0].lines
    (curve,) = (line for line in lines if len(line.get_xdata()) > 9)
    np.testing.assert_allclose(curve.get_xdata()[[0, -1]], [0, 10])


def test_one_component_is_drawn_as_lines_between_its_samples() -> None:
    data = motion(10, 101)
    axes = api.plot(data.isel(axis=0), "series", variables=["omega"]).axes[0]
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), data.omega[:, 0])


# Mistakes


@pytest.mark.parametrize(
    ("kind", "keys", "said"),
    [
        ("series", {"variables": ["w1"]}, "unknown variable 'w1'"),
        ("series", {"variables": ["omega.x4"]}, "unknown variable 'omega.x4'"),
        ("series", {"variables": ["G"], "span": [200, 300]}, "span: holds no sample of case"),
        ("phase", {"x": "p", "y": "Tt"}, "unknown variable 'Tt'"),
        ("hodograph", {"zoom": 1e-9}, "zoom: 1e-09 shows nothing"),
        ("herpolhode", {}, "has no attitude, which kind herpolhode needs: write `attitude: yes`"),
        ("hodograph", {"styles": ["bleu"], "colour": "case"}, "styles: unknown style 'bleu'; did"),
        ("map", {"variable": "G", "x": "a", "y": "b"}, "case case is no sweep"),
        ("hodograph", {"style": {"rc": {"text.usetex": True}}}, "no other group"),
        ("hodograph", {"style": {"rc": {"figure.hooks": ["os:getpid"]}}}, "no other group"),
        ("hodograph", {"style": {"rc": {"font.sise": 9}}}, "parameter 'font.sise'; did"),
        ("hodograph", {"style": {"rc": {"font.size": "big"}}}, "style: rc: font.size: "),
        ("hodograph", {"style": {"axes": {"xscale": "lgo"}}}, "style: axes: "),
        ("hodograph", {"style": {"legend": "none"}}, "legend"),
        ("series", {"variables": ["G"], "insets": [
            {"panel": "T", "case": "case", "variables": ["G"]}]}, "insets"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_sentence(kind: str, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(HodoError, match=re.escape(said)) as refused:
        api.plot(motion(10, 101), kind, **keys)
    assert "\n" not in str(refused.value)


def test_what_has_no_place_in_a_figure_is_refused() -> None:
    plain, gap, heavy = motion(10, 101), motion(10, 101), motion(10, 101, inertia_unit="kg m^2")
    gap.omega[5] = np.nan
    seconds = motion(10, 101, time={"end": 10, "unit": "s"})
    other, small = motion(10, 101, inertia=[1, 0.9, 0.6]), {"width": 20, "height": 20}
    for data, kind, keys, said in (
        (gap, "hodograph", {}, r"omega of .* has no value at 0\.5: draw the samples"),
        (
            [plain, seconds],
            "series",
            {"variables": ["G"]},
            "time is in '1' in .* and 's' in .*: one",
        ),
        ([plain, heavy], "hodograph", {}, "G.x1 is in '1' in .* and 'kg m.2' in .*: one scale"),
        ([plain, other], "quadrants", {}, "motions of several bodies"),
        (plain, "invariants", {"style": small}, "20 mm by 20 mm have no room for the panels"),
    ):
        with pytest.raises(HodoError, match=said):
            api.plot(data, kind, **keys).draw_without_rendering()
    api.plot(gap.dropna("time"))


# The command

CONFIG = """
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74},
           time: {end: 20, samples: 201}, damping: 0.004}
cases: {a: {}, b: {damping: 0.005}}
figures:
  one: {kind: hodograph, cases: [a]}
  two: {kind: series, cases: [a, b], variables: [G]}
  gone: {kind: hodograph, cases: [b], zoom: 1e-9}
"""


@pytest.fixture
def config(hodo: Hodo, tmp_path: Path) -> Path:
    (tmp_path / "c.yaml").write_text(CONFIG)
    assert hodo("run", "c.yaml").returncode == 0
    return tmp_path / "c.yaml"


def test_a_figure_that_cannot_be_drawn_costs_no_other(hodo: Hodo, config: Path) -> None:
    done = hodo("plot", "c.yaml", "--format", "csv")
    assert done.returncode == 1
    assert "gone: zoom: 1e-09 shows nothing" in done.stderr
    assert "runs/c.h5 is not classified: run `hodo classify runs/c.h5`" in done.stderr
    assert (config.parent / "runs/figures/c/two.csv").exists()
    assert "Not drawn: zoom" in (config.parent / "runs/figures/index.html").read_text("utf-8")
    done = hodo("plot", "c.yaml", "oen")
    assert done.returncode == 2
    assert "unknown figure 'oen'; did you mean 'one'?" in done.stderr


def test_only_what_has_changed_is_drawn(hodo: Hodo, config: Path) -> None:
    folder = config.parent / "runs/figures/c"
    asked = ("one", "two", "--format", "csv")
    hodo("plot", "c.yaml", *asked)
    times = {file: file.stat().st_mtime_ns for file in folder.glob("*.csv")}
    done = hodo("plot", "c.yaml", *asked)
    assert "2 of 2 figures are kept; --force draws them anew" in done.stderr
    assert times == {file: file.stat().st_mtime_ns for file in times}
    config.write_text(CONFIG.replace("variables: [G]", "variables: [T]"))
    done = hodo("plot", "c.yaml", *asked)
    assert "1 of 2 figures are kept" in done.stderr
    assert "T" in (folder / "two.csv").read_text().splitlines()[0]
    # What another hand has changed is drawn again, and another format beside it.
    (folder / "one.csv").write_text("")
    hodo("plot", "c.yaml", *asked, "--format", "svg")
    assert (folder / "one.csv").stat().st_size
    assert (folder / "one.svg").exists()


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["one", "--format", "gif"], "no figure moves: only one of kind body makes a film"),
        (["one", "--alone", "x.html"], "--alone shows all figures: give no names"),
        (["--format", "csv", "--alone", "x.html"], "--format png or svg"),
    ],
)
def test_what_cannot_be_written_is_refused(
    hodo: Hodo, config: Path, command: list[str], said: str
) -> None:
    done = hodo("plot", "c.yaml", *command)
    assert done.returncode == 2
    assert said in done.stderr
    assert not (config.parent / "runs/figures").exists()


def test_figures_of_the_papers_are_all_there() -> None:
    assert {f"fig{i}" for i in range(1, 20)} <= {*entries_of("paper1")}
    assert {f"fig{i}" for i in range(1, 5)} <= {*entries_of("paper2")}
    for paper in ("paper1", "paper2", "paper3"):
        assert all(entry["title"] and entry["caption"] for entry in entries_of(paper).values())


def test_maps_of_a_coarse_and_a_fine_grid_end_alike_and_say_what_both_show() -> None:
    def swept(count: int, **more: Any) -> Any:
        ranges = {"linspace": [0.001, 0.01, count]}
        sweep = {"damping.1": ranges, "damping.2": ranges, **more}
        case = {"time": {"end": 1}, "error": "off", "sweep": sweep, "store": ["share"]}
        return api.sweep({**CROSSING, **case})

    both = [swept(20, direction={"sphere": {"count": 2}}), swept(25)]
    axes = {"x": "damping.1", "y": "damping.2"}
    figure = api.plot(both, "map", variable="share.x1", range=[0, 1], level=0.5, **axes)
    ends = [panel.collections[0].get_datalim(panel.transData).bounds for panel in figure.axes[:2]]
    np.testing.assert_allclose(ends, [[0.001, 0.001, 0.009, 0.009]] * 2)
    assert "mean" not in figure.axes[2].get_xlabel()
    assert "nowhere level 0.5" in [text.get_text() for text in figure.legends[0].get_texts()]
    alone = api.plot(both[0], "map", variable="share.x1", range=[0, 1], **axes)
    assert alone.axes[1].get_xlabel().replace("\n", " ").endswith(", mean over direction")


def test_the_upright_axis_of_a_hodograph_has_its_unit() -> None:
    run = motion(1, inertia_unit="kg m^2", time={"end": 1, "samples": 11, "unit": "s"})
    words = [text.get_text() for text in api.plot(run, "hodograph").axes[0].texts]
    assert {"$G_1$", "$G_2$", "${G}_{3}$ [kg m$^{2}$/s]"} <= {*words}


# Unusual data: motions that have died down, single samples, constants.

DYING = CROSSING | {"damping": 1, "time": {"end": 900, "samples": 901}}


@pytest.fixture(scope="module")
def dying() -> xr.Dataset:
    """A body whose omega ends below the smallest double, while its direction is known."""
    return api.run(DYING)


def plotted(*args: Any, **keys: Any) -> Figure:
    """A figure that is drawn without a warning but for those about samples."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*not known between its samples")
        figure = api.plot(*args, **keys)
        figure.draw_without_rendering()
    return figure


def test_a_direction_keeps_its_digits_until_omega_has_none(dying: xr.Dataset) -> None:
    """The squares of omega lose theirs from 1e-154 on, twice as early."""
    omega, A = np.array([0.8, 0.5, 0.74]), np.array([1, 0.8, 0.6])
    G2, energy = np.sum((A * omega) ** 2), np.sum(A * omega**2) / 2
    names = ("J", "D_per_2T", "separatrix_distance", "tilt", "x1_direction")
    values = api.derive(dying, *(name.replace("_per_", "/") for name in names))
    is_normal = np.abs(dying.omega).max("axis").values > 2.3e-308
    assert 700 < is_normal.sum() < 720
    J = G2 / (2 * energy)
    # Constants of the free motion.
    for name, constant in (("J", J), ("D_per_2T", J - 0.8), ("separatrix_distance", 1 - 0.8 / J)):
        np.testing.assert_allclose(values[name][is_normal], constant, rtol=1e-12)
    # The stretched time, and with it the direction, stands still from 50 on.
    for name in ("tilt", "x1_direction"):
        there = values[name].values
        np.testing.assert_allclose(there[50:700], there[50], rtol=1e-12)
    for name in names:
        assert np.isnan(values[name][720:]).all()


def test_a_direction_of_a_huge_motion_has_its_digits() -> None:
    scale = {key: 1e100 * value for key, value in DYING["initial"].items()}
    fast = api.run({**DYING, "damping": 0, "initial": scale, "time": {"end": 1e-99, "samples": 9}})
    np.testing.assert_allclose(api.derive(fast, "D/2T").D_per_2T, 0.0533032107893475, rtol=1e-12)


def test_a_sphere_shows_no_direction_of_lost_digits(dying: xr.Dataset) -> None:
    figure = plotted(dying, "sphere")
    (end,) = (x for x in figure.axes[0].lines if x.get_marker() == "s")
    moving = api.run({**DYING, "time": {"values": [100]}})
    (mark,) = (x for x in plotted(moving, "sphere").axes[0].lines if x.get_marker() == "s")
    np.testing.assert_allclose(end.get_xydata(), mark.get_xydata(), atol=1e-9)


def test_huge_and_tiny_constants_are_said_to_be_constant() -> None:
    for size in (1e85, 1e-85):
        start = {key: size * value for key, value in DYING["initial"].items()}
        time = {"end": 100 / size, "samples": 101}
        free = api.run({**DYING, "damping": 0, "initial": start, "time": time})
        figure = plotted(free, "series", variables=["T"])
        assert [text.get_text()[:8] for text in figure.axes[0].texts] == ["constant"]


def test_a_single_sample_is_marked() -> None:
    one = api.run({**DYING, "damping": 0, "time": {"end": 10, "samples": 1}})
    for figure in (plotted(one, "invariants"), plotted(one, "series", variables=["G", "T", "D"])):
        assert [axes.lines[0].get_marker() for axes in figure.axes] == ["o"] * 3


@pytest.mark.parametrize(
    ("inertia", "sides"), [([1, 1, 0.6], ["about $x_3$"]), ([1, 0.8, 0.8], ["about $x_1$"])]
)
def test_a_side_that_a_body_lacks_is_not_named(inertia: list[float], sides: list[str]) -> None:
    body = api.run({**DYING, "inertia": inertia, "time": {"end": 1}})
    texts = plotted(body, "invariants").axes[2].texts
    assert [text.get_text() for text in texts] == sides


@pytest.mark.parametrize("values", ["x", 1j])
def test_what_is_no_number_is_no_variable(dying: xr.Dataset, values: Any) -> None:
    named = dying.assign(mine=("time", np.full(dying.sizes["time"], values)))
    with pytest.raises(HodoError, match="unknown variable 'mine'"):
        api.plot(named, "series", variables=["mine"])


def test_two_constant_components_have_equal_scales(caplog: pytest.LogCaptureFixture) -> None:
    steady = api.run({**DYING, "damping": 0, "initial": {"p": 0, "q": 0, "r": 1}})
    plotted(steady, "phase", x="p", y="r")
    assert not caplog.records  # matplotlib tells of ends that it cannot keep


def test_a_map_of_the_status_shows_every_status() -> None:
    """Members of another status than ok have no values but this one."""
    moments = {"inertia.0": {"values": [1, 2.5]}, "inertia.2": {"values": [0.6, 0.7]}}
    swept = api.sweep({**CROSSING, "time": {"end": 300}, "sweep": moments})
    assert swept.status.values.tolist() == [[0, 0], [3, 3]]
    figure = plotted(swept, "map", variable="status", x="inertia.0", y="inertia.2")
    words = [text.get_text().rpartition(": ")[2] for text in figure.legends[0].texts]
    assert words == ["ok", "invalid"]
