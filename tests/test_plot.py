"""Figures and their page, from the papers' own result files."""

import csv
import io
import math
import os
import re
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from itertools import permutations
from pathlib import Path
from typing import Any

import h5py
import matplotlib.image
import matplotlib.style
import numpy as np
import pytest
from click.testing import CliRunner
from conftest import ROOT, Hodo, call, figure_kinds
from drawings import Drawings, drawings_of
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.font_manager import fontManager
from matplotlib.ticker import ScalarFormatter

import hodo_cli as api
from hodo_cli import HodoError, figures
from hodo_cli.cases.config import load, parse
from hodo_cli.cli import main
from hodo_cli.figures.artists import SEPARATRIX

PAPERS = ("paper1", "paper2", "paper3")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the three papers, classified."""
    folder = tmp_path_factory.mktemp("runs")
    configs = [ROOT / "configs" / f"{name}.yaml" for name in PAPERS]
    results = [folder / f"{name}.h5" for name in PAPERS]
    for command in (["run", "--quiet", "--out", folder, *configs], ["classify", *results]):
        done = call(folder, *command)
        assert done.returncode == 0, done.stderr
    return folder


def test_each_figure_of_the_papers_is_defined() -> None:
    defined = {name: config_of(name).figures for name in PAPERS}
    assert {f"fig{i}" for i in range(1, 20)} <= set(defined["paper1"])
    assert {f"fig{i}" for i in range(1, 5)} <= set(defined["paper2"])
    panels = defined["paper3"]["figure"]
    assert set(panels["variables"]) == {"Gz", "H", "r", "u1", "u2", "u3"}
    assert [inset["case"] for inset in panels["insets"]] == ["case1", "case3"]
    # A picture alone says what it shows, those of averaging and of sweeps too.
    for name in (*PAPERS, "averaged", "sweep_crossing", "sweep_resistance"):
        config = config_of(name)
        assert all(figure["title"] for figure in config.figures.values()), name
    assert all(figure["caption"] for each in defined.values() for figure in each.values())


def config_of(name: str) -> Any:
    """One of the case files that come with hodo."""
    return load(ROOT / "configs" / f"{name}.yaml")


def refused(call: Callable[[], object]) -> str:
    """The one line that a mistake is refused with."""
    with pytest.raises(HodoError) as raised:
        call()
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_every_kind_that_is_declared_is_drawn() -> None:
    assert {*figures.DRAW, *figures.DRAW_SWEEPS} == figure_kinds()


@pytest.fixture(scope="module")
def drawn(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All figures of the papers, drawn once."""
    out = tmp_path_factory.mktemp("drawn")
    formats = ("--format", "png", "--format", "csv", "--out", out)
    done = call(out, "plot", *sorted(runs.glob("*.h5")), *formats)
    assert done.returncode == 0, done.stderr
    return out


def test_all_figures_are_drawn(drawn: Path) -> None:
    defined = [(paper, name) for paper in PAPERS for name in config_of(paper).figures]
    assert len(defined) >= 24
    for paper, name in defined:
        for suffix in ("png", "csv"):
            assert (drawn / paper / f"{name}.{suffix}").stat().st_size > 100
    assert "Not drawn" not in (drawn / "index.html").read_text(encoding="utf-8")


def test_drawing_loads_no_more_than_it_needs(runs: Path, tmp_path: Path) -> None:
    """pyplot would keep every figure in memory; netCDF4 brings an HDF5 library that may break
    h5py's; SciPy takes as long to load as several figures to draw. With nothing to draw, what draws
    is not loaded either."""
    script = f"""
import sys
from hodo_cli.cli import main
options = ["fig1", "--out", {str(tmp_path)!r}]
main(["plot", {str(runs / "paper2.h5")!r}, *options], standalone_mode=False)
loaded = {{name for name, module in sys.modules.items() if module}}
print("loaded:", *sorted({{*sys.argv[1:]}} & loaded))
"""
    never = ["matplotlib.pyplot", "netCDF4", "heyoka", "scipy"]
    for unwanted in (never, [*never, "xarray", "matplotlib"]):
        command = [sys.executable, "-c", script, *unwanted]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.stdout.splitlines()[-1] == "loaded:", done.stdout + done.stderr


def test_curves_in_space_are_those_stored(runs: Path) -> None:
    """Every vertex drawn is a stored sample in the view; its colour is that of the label; no sample
    is left out."""
    results = Drawings.of(runs / "paper1.h5")
    sheet = results.draw("fig12-all-entries")
    data = results.cases["fig12-all-entries"].variables
    G = data["omega"].data * [1, 0.8, 0.6]
    (shown,) = sheet.shown
    assert shown.curve == "fig12-all-entries"
    assert (shown.values["time"] == data["time"].data).all()
    assert (np.stack([shown.values[f"G.x{i}"] for i in (1, 2, 3)], axis=-1) == G).all()

    main, zoomed = sheet.figure.axes
    view = sheet.scenes[main].view
    (curve,) = [each for each in main.collections if isinstance(each, LineCollection)]
    drawn = np.concatenate(curve.get_segments())
    assert {tuple(at) for at in view(G)[:, :2].tolist()} == {tuple(at) for at in drawn.tolist()}

    blue, orange = (np.array(to_rgb(line.get_color())) for line in sheet.legend[:2])
    label = {
        tuple(at): axis
        for at, axis in zip(view(G)[:, :2].tolist(), data["enclosed_axis"].data, strict=True)
    }
    for segment, colour in zip(curve.get_segments(), curve.get_colors(), strict=True):
        # paler toward white: the colour's distances from white keep their ratio
        (axis,) = {label[tuple(at)] for at in segment[:-1].tolist()}
        full = 1 - (blue if axis == 1 else orange)
        faded = (1 - colour[:3])[full > 0.1] / full[full > 0.1]
        assert np.ptp(faded) < 1e-12
        assert 0.49 < faded[0] <= 1
    (crossings,) = [line for line in main.lines if line.get_marker() == "D"]
    assert len(crossings.get_xdata()) == data["crossing_time"].data.size == 3
    assert main.get_aspect() == zoomed.get_aspect() == 1

    # The enlarged panel has what is near the origin, and nothing that lies before or behind it.
    near = np.abs(G).max(axis=1) <= results.figures["fig12-all-entries"]["zoom"]
    (curve,) = [each for each in zoomed.collections if isinstance(each, LineCollection)]
    drawn = np.concatenate([segment[:-1] for segment in curve.get_segments()])
    boxed = view(G[near])[:, :2]
    assert {tuple(at) for at in drawn.tolist()} <= {tuple(at) for at in boxed.tolist()}
    assert 0 < len(drawn) <= len(boxed) < len(G)


def test_time_colour_projections_and_sphere(runs: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    sheet = results.draw("fig4-projections")
    G = results.cases["fig4"].variables["omega"].data * [1, 0.8, 0.6]
    for axes, (i, j) in zip(sheet.figure.axes[1:4], [(0, 1), (0, 2), (1, 2)], strict=True):
        (curve,) = [each for each in axes.collections if isinstance(each, LineCollection)]
        pieces = curve.get_segments()
        assert len(pieces) == 64  # as many stretches of time as colours
        joined = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
        assert (joined == G[:, [i, j]]).all()
        assert axes.get_xlabel().startswith(f"$G_{i + 1}$")
        assert axes.get_ylabel().startswith(f"$G_{j + 1}$")
    brightness = curve.get_colors()[:, :3].sum(axis=1)
    assert brightness[-1] > brightness[0]

    sheet = results.draw("fig1")
    assert [each.curve for each in sheet.shown] == ["1", "2", "3′", "3", "4"]
    for shown, name in zip(sheet.shown, results.figures["fig1"]["cases"], strict=True):
        g = np.stack([shown.values[f"G.x{i}/|G|"] for i in (1, 2, 3)], axis=-1)
        G = results.cases[name].variables["omega"].data * [1, 0.8, 0.6]
        np.testing.assert_allclose(np.linalg.norm(g, axis=1), 1, rtol=1e-15)
        np.testing.assert_allclose(np.cross(g, G), 0, atol=1e-15)


def assert_regions_are_named_within(figure: Any) -> None:
    """All that is seen of the names of A and B is below and above the diagonal."""
    figure.draw_without_rendering()
    for axes in figure.axes:
        named = [text for text in axes.texts if text.get_text()[0].isalpha()]
        assert [text.get_text()[0] for text in named] == ["A", "B"]
        for text in named:
            seen = axes.transData.inverted().transform_bbox(text.get_window_extent())
            is_a = text.get_text()[0] == "A"
            assert seen.x0 > seen.y1 if is_a else seen.x1 < seen.y0


def test_quadrants_have_one_scale_and_region_a_below_the_line(runs: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    limits = set()
    for name in ("fig9", "fig10", "fig11", "fig13-all-entries"):
        figure = results.figures[name]
        case = results.cases[figure["cases"][0]].variables
        sheet = results.draw(figure)
        axes = sheet.figure.axes[0]
        (curve,) = [each for each in axes.collections if isinstance(each, LineCollection)]
        pieces = curve.get_segments()
        across, up = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])]).T
        p, _, r = case["omega"].data.T
        assert (across == p**2).all()
        np.testing.assert_allclose(up, 0.6 * (0.8 - 0.6) / (1 - 0.8) * r**2, rtol=1e-15)
        assert (np.where(across > up, 1, 3) == case["enclosed_axis"].data).all()
        A, B = (patch.get_xy() for patch in axes.patches[:2])
        assert (A[:, 0] >= A[:, 1]).all()
        assert (B[:, 0] <= B[:, 1]).all()
        assert_regions_are_named_within(sheet.figure)
        (marks,) = [line for line in axes.lines if line.get_marker() == "D"]
        assert len(marks.get_xdata()) == case["crossing_time"].data.size
        assert (marks.get_xdata() == marks.get_ydata()).all()
        if name != "fig13-all-entries":
            limits.add((axes.get_xlim(), axes.get_ylim()))
    assert len(limits) == 1
    assert "no quadrants" in refused(
        lambda: results.draw({**results.figures["fig10"], "cases": ("fig7",)})
    )


def test_series_phase_and_invariants_show_what_is_stored(runs: Path) -> None:
    results = Drawings.of(runs / "paper2.h5")
    figure = results.figures["fig1"]
    sheet = results.draw(figure)
    ends = ("0.7670", "1.237")
    for axes, name, title, end in zip(
        sheet.figure.axes, figure["cases"], figure["labels"], ends, strict=True
    ):
        case = results.cases[name].variables
        x, y, *_ = axes.lines  # then the marks of their ends
        assert axes.get_title() == title
        assert (x.get_xdata() == case["time"].data).all()
        assert (x.get_ydata() == case["x"].data).all()
        assert (y.get_ydata() == case["y"].data).all()
        assert [text.get_text() for text in axes.texts] == [
            f"$x = {end}$",
            f"$y = 0$ at $t = {case['event_time'].data[0]:#.4g}$ s",
        ]
    sheet = results.draw("phase")
    lines = [line for line in sheet.figure.axes[0].lines if line.get_marker() == "None"]
    for line, name in zip(lines, results.figures["phase"]["cases"], strict=True):
        assert (line.get_xdata() == results.cases[name].variables["x"].data).all()
        assert (line.get_ydata() == results.cases[name].variables["y"].data).all()

    results = Drawings.of(runs / "paper3.h5")
    sheet = results.draw("figure")
    for axes, name in zip(sheet.figure.axes, ("case1", "case2", "case3"), strict=True):
        for line, variable in zip(axes.lines, ("Gz", "H", "r", "u1", "u2", "u3"), strict=True):
            assert (line.get_ydata() == results.cases[name].variables[variable].data).all()
    (rebound,) = sheet.figure.axes[0].child_axes
    (u3,) = rebound.lines
    # It touches 1 and comes back up to 1.0128.
    touched = int(u3.get_ydata().argmin())
    assert u3.get_ydata()[touched:].max() == pytest.approx(1.0128, abs=5e-5)
    (inset,) = sheet.figure.axes[2].child_axes
    u1, u2 = inset.lines
    case = results.cases["case3"].variables
    assert (u1.get_ydata() == case["u1"].data).all()
    assert (u2.get_ydata() == case["u2"].data).all()

    results = Drawings.of(runs / "paper1.h5")
    sheet = results.draw("fig12-sensitivity")
    low, high = results.figures["fig12-sensitivity"]["span"]
    assert all(shown.values["time"][[0, -1]].tolist() == [low, high] for shown in sheet.shown)
    figure = {
        **results.figures["fig12-sensitivity"],
        "variables": ("omega.x1", "omega.x2", "G.x3"),
        "span": None,
    }
    sheet = results.draw(figure)
    p, q, r = results.cases["fig12-all-entries"].variables["omega"].data.T
    for axes, values, label in zip(
        sheet.figure.axes, (p, q, 0.6 * r), ("$p$", "$q$", "$G_3$"), strict=True
    ):
        assert (axes.lines[0].get_ydata() == values).all()
        assert axes.get_ylabel().startswith(label)
    sheet = results.draw("fig4-invariants")
    values = sheet.shown[0].values
    upper, lower = (0.005 * 2, 0.003 * 2)
    G2, time = values["G2"], values["time"]
    assert (G2[0] * np.exp(-lower * time) * (1 + 1e-12) >= G2).all()
    assert (G2[0] * np.exp(-upper * time) * (1 - 1e-12) <= G2).all()
    assert (values["T"] >= G2 / 2).all()
    assert (values["T"] <= G2 / 1.2).all()
    bounds = {tuple(line.get_ydata()) for line in sheet.figure.axes[1].lines}
    assert tuple(G2[0] * np.exp(-upper * time)) in bounds
    assert tuple(G2[0] * np.exp(-lower * time)) in bounds
    np.testing.assert_allclose(
        values["D/2T"], (G2 - 2 * values["T"] * 0.8) / (2 * values["T"]), atol=1e-14
    )


def test_names_of_curves_in_tables_are_plain_text(several: Drawings) -> None:
    sheet = several.draw("ball", labels=(r"1, $\lambda_1 = 0.1$", "case_1"))
    names = [row[0] for row in csv.reader(sheet.csv().splitlines())]
    assert list(dict.fromkeys(names)) == ["curve", "1, λ1 = 0.1", "case_1"]


def test_csv_is_what_is_shown(runs: Path) -> None:
    for paper, name in (
        ("paper1", "fig18"),
        ("paper1", "fig5"),
        ("paper3", "figure"),
        ("paper1", "fig1"),
    ):
        results = Drawings.of(runs / f"{paper}.h5")
        sheet = results.draw(name)
        rows = list(csv.DictReader(sheet.csv().splitlines()))
        names = list(dict.fromkeys(row["curve"] for row in rows))
        order = list(dict.fromkeys(shown.curve for shown in sheet.shown))
        assert [name.replace("$", "") for name in names if "$" not in name] == names
        for shown in sheet.shown:
            mine = [row for row in rows if row["curve"] == names[order.index(shown.curve)]]
            for column, values in shown.values.items():
                assert [float(row[column]) for row in mine] == values.tolist()
        curves = {shown.curve: len(next(iter(shown.values.values()))) for shown in sheet.shown}
        assert len(rows) == sum(curves.values()) > 0
        assert set(rows[0]) == {"curve"}.union(*(shown.values for shown in sheet.shown))


def test_the_same_bytes_every_time(runs: Path, drawn: Path, tmp_path: Path) -> None:
    """Whatever the number of processes, the seed of hashes, the date, and what was drawn before."""
    hodo = Path(sysconfig.get_path("scripts")) / "hodo"
    formats = ("png", "svg", "pdf", "csv")
    options = [word for name in formats for word in ("--format", name)]
    environment = os.environ | {"PYTHONHASHSEED": "1", "SOURCE_DATE_EPOCH": "1000000000"}
    for paper, names, jobs in (("paper1", ["fig4", "fig5"], "2"), ("paper3", ["figure"], "1")):
        subprocess.run(
            [hodo, "plot", runs / f"{paper}.h5", *names, *options, "--out", tmp_path, "-j", jobs],
            env=environment, check=True, capture_output=True,
        )  # fmt: skip
        for name in names:
            ours = Drawings.of(runs / f"{paper}.h5").render(name, formats, tmp_path / "ours")
            others = [drawn / paper / f"{name}.{suffix}" for suffix in ("png", "csv")]
            for other in (*ours.files, *others):
                assert (tmp_path / paper / other.name).read_bytes() == other.read_bytes()


def test_a_png_is_what_matplotlib_itself_would_save(runs: Path, tmp_path: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    results.render("fig4-invariants", ("png",), tmp_path)
    results.draw("fig4-invariants").figure.savefig(tmp_path / "theirs.png")
    images = [
        matplotlib.image.imread(tmp_path / f"{name}.png") for name in ("fig4-invariants", "theirs")
    ]
    assert np.array_equal(*images)


def test_a_legend_names_the_marks_that_are_seen(runs: Path) -> None:
    """The motion of Fig 4 begins at p = 0.8, crosses the separatrix at 0.21 and ends at -0.004."""
    results = Drawings.of(runs / "paper1.h5")
    keys = {**results.figures["fig4-invariants"], "kind": "phase", "x": "p", "y": "r"}
    for style, marks in (
        ({}, ["start", "end", "$D = 0$"]),
        ({"xlim": (-0.1, 0.1)}, ["end"]),
        ({"xlim": (0.8, 0.9)}, ["start"]),
    ):
        (legend,) = results.draw(keys, style=style).figure.legends
        assert [re.split(",| at", text.get_text())[0] for text in legend.texts] == marks


def test_ticks_are_plain_text_and_their_factor_is_a_formula(several: Drawings) -> None:
    keys = {**several.figures["ball"], "kind": "phase", "x": "p", "y": "G"}
    ends = {"xlim": (-3e-9, 3e-9), "ylim": (0.1, 10.0), "log": ("y",)}
    (axes,) = several.draw(keys, style=ends).figure.axes
    FigureCanvasAgg(axes.figure).draw()
    assert axes.get_xticklabels()[0].get_text() == "\N{MINUS SIGN}3"
    assert "10^" in axes.xaxis.get_offset_text().get_text()
    assert not isinstance(axes.yaxis.get_major_formatter(), ScalarFormatter)


def test_mistakes_are_one_line_and_keep_no_other_figure(runs: Path, tmp_path: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    out = tmp_path / "out"
    command = ["plot", str(runs / "paper1.h5"), "fig5", "fgi4", "--out", str(out)]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 2
    assert f"{runs / 'paper1.h5'}: unknown figure 'fgi4'; did you mean 'fig4'?" in done.stderr
    assert not out.exists()

    spec = results.figures["fig4"]
    assert "has no result of case gif4 yet" in refused(
        lambda: results.draw({**spec, "cases": ("gif4",)})
    )
    series = {**results.figures["fig12-sensitivity"], "variables": ("w1",)}
    said = refused(lambda: results.draw(series))
    assert "variables.0: unknown variable 'w1' of case fig12-all-entries" in said
    for wrong, why in {
        "omega": "is a vector: name a component",
        "omega.x4": "unknown component 'x4' of omega",
        "time.x1": "is no vector, and has no component 'x1'",
        "omega.": "is a vector: name a component",
    }.items():
        assert why in refused(lambda wrong=wrong: results.draw({**series, "variables": (wrong,)}))

    said = refused(lambda: results.draw({**spec, "labels": (r"$\frac{$",)}))
    assert "is not TeX" in said

    results.config.figures["fig6"]["cases"] = ("gone",)
    first, second = (results.render(name, ("png",), out) for name in ("fig6", "fig8"))
    assert "has no result of case gone yet" in first.problem
    assert not first.files
    assert not second.problem
    assert second.files[0].is_file()
    results = Drawings.of(runs / "paper3.h5")
    assert "case case1 stores no angular velocity in body axes" in refused(
        lambda: results.draw({**spec, "cases": ("case1",)})
    )


@pytest.mark.parametrize("order", list(permutations((1.0, 0.8, 0.6))))
def test_the_separatrix_of_a_sphere_is_that_of_its_body(
    order: tuple[float, float, float], several: Drawings
) -> None:
    body = {"model": "linear-diag", "inertia": list(order), "damping": 0.01}
    data = api.run({**body, "initial": {"p": 1, "q": 0.1, "r": 0.2}, "time": {"end": 1}})
    keys = {**several.figures["ball"], "cases": ("case",)}
    sheet = figures.draw(keys, {"case": data})
    (scene,) = sheet.scenes.values()
    circles = [line["points"] for line in scene.strokes if line["look"] == SEPARATRIX]
    assert len(circles) == 2
    for circle in circles:
        np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 1, rtol=1e-14)
        twice_T = (circle**2 / order).sum(axis=1)
        np.testing.assert_allclose(1 - twice_T * 0.8, 0, atol=1e-15)


@pytest.mark.parametrize(
    ("body", "texts"),
    [
        ((1, 0.8, 0.6), ["A", "B"]),
        ((0.6, 0.8, 1), ["A", "B"]),
        ((1, 0.8, 0.8), ["A"]),
        ((1, 1, 0.6), ["B"]),
    ],
)
def test_a_sketch_has_a_below_the_line_and_symmetric_bodies_one_region(
    body: tuple[float, float, float], texts: list[str], several: Drawings
) -> None:
    data = several.cases["brief"]
    figure = api.plot(data, kind="quadrant-sketch", bodies=[body])
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert [text.get_text()[0] for text in axes.texts] == texts
    (line,) = axes.lines
    x, y = (float(ends[1]) for ends in line.get_data())
    K = {("A", "B"): 0.6, ("A",): 0.0, ("B",): math.inf}[tuple(texts)]
    assert x == pytest.approx(min(K, 1e99) * y, abs=1e-15) or math.isinf(K) and y < 1e-15
    for text in axes.texts:
        box = text.get_window_extent().transformed(axes.transData.inverted())
        across, up = (box.p0 + box.p1) / 2
        assert (across > K * up) == (text.get_text()[0] == "A")
    assert axes.get_xlabel() == ("$r^2$" if body[0] < body[2] else "$p^2$")


def test_words_of_a_sketch_are_on_no_line(several: Drawings) -> None:
    """A region too narrow for its words has its letter, and one too narrow for that nothing."""
    bodies = [[3, 2, 1.1], [1, 0.8, 0.6], [1, 0.95, 0.3]]
    data, large = several.cases["brief"], {"font_size": 14, "width": "column"}
    figure = api.plot(data, kind="quadrant-sketch", bodies=bodies)
    with_large = api.plot(data, kind="quadrant-sketch", bodies=bodies[1:], style=large)
    narrow = api.plot(data, kind="quadrant-sketch", bodies=[[1, 0.999, 0.5], [1, 0.501, 0.5]])
    words = []
    for drawn in (figure, with_large, narrow):
        drawn.draw_without_rendering()
        for axes in drawn.axes:
            (line,) = axes.lines
            shown = [text for text in axes.texts if text.get_text()]
            words.append([text.get_text().replace("\n", " ") for text in shown])
            for text in shown:
                box = text.get_window_extent().transformed(axes.transData.inverted())
                assert not line.get_path().intersects_bbox(box)
                assert min(box.x0, box.y0) > 0
    assert words[0] == ["A about $x_1$", "B"]  # K = 0.33
    assert words[1] == ["A about $x_1$", "B about $x_3$"]
    assert words[2] == ["A", "B about $x_3$"]  # K = 3.9
    assert words[3:5] == [["A about $x_1$", "B"], ["A", "B about $x_3$"]]
    assert words[5:] == [["B about $x_3$"], ["A about $x_1$"]]


def test_names_of_curves_stand_on_the_sphere(runs: Path) -> None:
    figure = Drawings.of(runs / "paper1.h5").draw("fig1").figure
    figure.draw_without_rendering()
    (axes,) = figure.axes
    boxes = {text.get_text(): text.get_window_extent().get_points() for text in axes.texts}
    for name in ("1", "2", "3", "3′", "4"):
        middle = axes.transData.inverted().transform(boxes[name]).mean(axis=0)
        assert np.hypot(*middle) < 0.97


def test_names_of_curves_that_meet_stand_apart(several: Drawings) -> None:
    """Two cases of one motion."""
    figure = several.draw("ball", cases=("brief", "brief"), labels=("first", "second")).figure
    figure.draw_without_rendering()
    texts = figure.axes[0].texts
    first, second = (x.get_window_extent() for x in texts if x.get_text() in ("first", "second"))
    assert not first.overlaps(second)


def test_a_figure_is_named_and_its_axes_are_those_of_the_momentum(runs: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    sheet = results.draw("fig4")
    title = sheet.figure.get_suptitle()
    names = [text.get_text() for text in sheet.figure.axes[0].texts]
    entries = [text.get_text() for text in sheet.figure.legends[0].get_texts()]
    inside = results.draw("fig15")
    kept = [text.get_text() for text in inside.figure.legends[0].get_texts()]
    assert title.startswith("Fig 4")
    assert {"$G_1$", "$G_2$", "$G_3$"} <= {*names}
    assert entries[:2] == ["about $x_1$", "about $x_3$"]
    # Fig 15 never leaves A, and its legend names nothing else.
    assert "about $x_3$" not in kept


def test_a_legend_says_where_its_axes_are_not_those_drawn() -> None:
    case = {"model": "torques", "damping": 0.01, "initial": {"p": 0.3, "q": 0.2, "r": 1}}
    time = {"end": 20, "samples": 401}
    for inertia, entry in (
        ([3, 2, 1], "about $x_3$"),
        ([[2.5, 0.1, 0], [0.1, 2, 0.2], [0, 0.2, 1]], "about principal axis $x_3$"),
    ):
        data = api.run({**case, "inertia": inertia, "time": time})
        figure = api.plot(data, kind="sphere", colour="axis")
        assert figure.legends[0].get_texts()[0].get_text() == entry


def test_a_series_names_its_marks_and_the_units_of_its_case(runs: Path) -> None:
    results = Drawings.of(runs / "paper2.h5")
    sheet = results.draw("fig1")
    turned = results.draw("internal-triaxial")
    kept = results.draw("internal-triaxial-invariants")
    entries = [text.get_text() for text in sheet.figure.legends[0].get_texts()]
    assert entries == ["$x$", "$y$", "end of spin"]
    left, right = sheet.figure.axes
    assert (left.get_xlabel(), left.get_ylabel()) == ("$t$ [s]", "$x$, $y$ [1/s$^{2}$]")
    # Four digits, of which the last may be zero.
    for axes, x, end in ((left, "0.7670", "53.07"), (right, "1.237", "40.01")):
        words = {f"$x = {x}$", f"$y = 0$ at $t = {end}$ s"}
        assert {text.get_text() for text in axes.texts} == words
    entries = [text.get_text() for text in turned.figure.legends[0].get_texts()]
    assert "end, $t = 200$ s" in entries
    assert "$D = 0$ at $t$ = 38.6520 s" in entries
    # Time is in seconds, and nothing says what units the moments of inertia have.
    assert [axes.get_ylabel() for axes in kept.figure.axes] == ["$T$", "$G^2$", "$D/2T$"]


def test_a_span_is_drawn_to_both_of_its_ends(runs: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    sheet = results.draw("fig12-sensitivity")
    axes = sheet.figure.axes[0]
    assert axes.get_xlim() == (385, 420)
    assert all(line.get_xdata()[[0, -1]].tolist() == [385, 420] for line in axes.lines[:3])


def test_an_enlarged_panel_of_quadrants_names_regions_by_letters(runs: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    sheet = results.draw("fig10")
    names = [{text.get_text() for text in axes.texts} for axes in sheet.figure.axes]
    assert names == [{"A (about $x_1$)", "B (about $x_3$)"}, {"A", "B"}]


def test_the_name_of_a_region_that_curves_fill_stays_in_it(tmp_path: Path) -> None:
    several = drawings_of(
        "defaults: {model: linear-diag, damping: [0.005, 0.004, 0.003],\n"
        "           initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 300, samples: 2001}}\n"
        "cases: {a: {inertia: [1, 0.8, 0.6]}, b: {inertia: [0.6, 0.8, 1]}}\n"
        "figures:\n  q: {kind: quadrants, cases: [a], zoom: 0.2, style: {width: column}}\n",
        tmp_path,
    )
    for case, zoom, log in [(x, *y) for x in "ab" for y in ((0.07, ""), (0.2, ""), (None, "xy"))]:
        style = {"width": "column"} | ({"xlim": [1e-3, 1], "log": log} if log else {})
        sheet = several.draw("q", cases=[case], zoom=zoom, style=style)
        assert_regions_are_named_within(sheet.figure)


def test_greek_letters_look_as_in_formulas(several: Drawings) -> None:
    for title, shown in {
        "damping λ = 0.1, $τ_1$": "damping $λ$ = 0.1, $τ_1$",
        "5 $ for λ": "5 $ for λ",
        "λ₁₂ = 10⁻³, $λ₃$, x₁": "$λ_{12}$ = 10$^{−3}$, $λ_{3}$, x$_{1}$",
    }.items():
        sheet = several.draw("ball", title=title, labels=("λ", "b"))
        sheet.figure.draw_without_rendering()  # letters that a font lacks are warned of
        assert sheet.figure.get_suptitle() == shown
        assert {curve.curve for curve in sheet.shown} == {"$λ$", "b"}
        assert sheet.csv().splitlines()[1].startswith("λ,")


def test_a_title_is_broken_between_words_and_never_in_a_formula(several: Drawings) -> None:
    assert several.draw("ball", title="Fig 1").figure.get_suptitle() == "Fig 1"
    formulas = r"$I_{11} = I_{13} = I_{31} = I_{33} = 0.005$, $|\omega(0)| = 1$"
    long = f"Fig 13: quadrants of this body for {formulas}"
    lines = several.draw("ball", title=long).figure.get_suptitle().splitlines()
    assert len(lines) > 1
    assert " ".join(lines) == long
    assert all(line.count("$") % 2 == 0 for line in lines)


def test_a_legend_is_read_row_by_row_and_fits_its_figure(several: Drawings) -> None:
    three = {"kind": "phase", "cases": ("brief", "long", "other"), "x": "p", "y": "r"}
    spec = {**several.figures["ball"], **three}
    # matplotlib fills column after column: the first has one row, the second rows of three.
    for width, order in ((84, ()), (60, ("brief", "start", "long", "end", "other"))):
        (legend,) = several.draw(spec, style={"width": width, "legend": "below"}).figure.legends
        texts = tuple(text.get_text() for text in legend.get_texts())
        assert texts == (order or ("brief", "long", "other", "start", "end"))


def test_a_style_gives_size_letters_scales_and_labels(several: Drawings) -> None:
    style = {
        **{"width": 120.0, "height": 60.0, "letters": "yes", "log": ("x",), "legend": "right"},
        **{"ylim": (-2.0, 2.0), "xlabel": "time", "font_size": 6.0, "line_width": 3.0},
    }
    figure = several.draw("each", style=style).figure
    assert figure.get_size_inches() * 25.4 == pytest.approx([120, 60])
    assert [axes.get_title("left") for axes in figure.axes] == ["(a)", "(b)"]
    for axes in figure.axes:
        assert (axes.get_xscale(), axes.get_ylim(), axes.get_xlabel()) == ("log", (-2, 2), "time")
        assert axes.get_xlim()[0] > 0
        assert axes.lines[0].get_linewidth() == 3
        assert axes.xaxis.label.get_size() == 6
    plain = several.draw("each").figure.get_size_inches() * 25.4
    wide, narrow = (several.draw("each", style={"width": word}) for word in ("page", "column"))
    sizes = [sheet.figure.get_size_inches() * 25.4 for sheet in (wide, narrow)]
    assert sizes[0] == pytest.approx([174, 174 / plain[0] * plain[1]])
    # Words stay as large: a row of panels has at least 1.4 inches.
    assert sizes[1] == pytest.approx([84, 25.4 * (1.4 + 0.3)])
    for place, count in (("none", 0), ("inside", 0), ("below", 1)):
        figure = several.draw("ball", style={"legend": place}).figure
        assert len(figure.legends) == count
        assert (figure.axes[0].get_legend() is not None) == (place == "inside")


STYLED = """
defaults: {model: linear-diag, inertia: [3, 2, 1.5], initial: {p: 1, q: 1, r: 1}}
cases: {a: {time: {end: 1, samples: 101}}}
style: {width: column, svg_text: yes}
figures:
  own: {kind: phase, cases: a, x: p, y: r, style: {width: 50, sheet: looks/mine.mplstyle}}
  common: {kind: phase, cases: a, x: p, y: r}
"""


def test_the_style_of_a_file_counts_where_a_figure_has_none(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "configs" / "looks").mkdir(parents=True)
    sheet = tmp_path / "configs" / "looks" / "mine.mplstyle"
    sheet.write_text("axes.labelcolor: ff0000\n")
    (tmp_path / "configs" / "c.yaml").write_text(STYLED)
    assert hodo("run", "configs/c.yaml", "--quiet").returncode == 0
    # By the config as by the result, whose folder is another.
    for named in ("configs/c.yaml", "runs/c.h5"):
        assert hodo("plot", named, "--format", "svg", "--force").returncode == 0
        own, common = (
            (tmp_path / "runs" / "figures" / "c" / f"{name}.svg").read_text()
            for name in ("own", "common")
        )
        assert ">start</text>" in own
        assert f'width="{50 / 25.4 * 72:.6f}pt"' in own
        assert f'width="{84 / 25.4 * 72:.6f}pt"' in common
        assert "#ff0000" in own
        assert "#ff0000" not in common
    sheet.write_text("axes.labelcolor: 00ff00\n")
    drawn = hodo("plot", "runs/c.h5", "--format", "svg")
    assert "1 of 2 figures are kept" in drawn.stderr
    sheet.write_text("axes.labelcolour: red\n")
    broken = hodo("plot", "runs/c.h5", "--format", "svg")
    assert broken.returncode == 1
    assert "unknown parameter 'axes.labelcolour'; did you mean" in broken.stderr
    # Of its own accord a figure in a file has 300 dots per inch.
    sheet.write_text("savefig.dpi: figure\n")
    assert hodo("plot", "runs/c.h5", "own").returncode == 0
    own_png = tmp_path / "runs" / "figures" / "c" / "own.png"
    assert matplotlib.image.imread(own_png).shape[1] == int(50 / 25.4 * 300)
    sheet.unlink()
    assert "no such file" in hodo("plot", "runs/c.h5", "--format", "svg").stderr


def test_a_font_that_is_not_there_costs_the_figures_that_want_it(
    hodo: Hodo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of a machine with many fonts, none is listed.
    few = [font for font in fontManager.ttflist if "DejaVu" in font.name]
    monkeypatch.setattr(fontManager, "ttflist", few)
    (tmp_path / "a.yaml").write_text(
        "style: {font: Nonesuch}\ncases: {a: {model: linear-diag, inertia: [1, 0.8, 0.6],"
        " damping: 0.1, initial: {p: 1, q: 1, r: 1}, time: {end: 1}}}\nfigures:\n"
        "  f: {kind: series, cases: [a], variables: [G]}\n"
        "  h: {kind: series, cases: [a], variables: [G]}\n"
        "  i: {kind: series, cases: [a], variables: [G], style: {sheet: ggplo}}\n"
        "  g: {kind: series, cases: [a], variables: [T], style: {font: serif}}\n"
    )
    assert hodo("run", "a.yaml").returncode == hodo("classify", "a.yaml").returncode == 0
    done = hodo("plot", "a.yaml")
    font, sheet = done.stderr.splitlines()
    assert font.startswith("f, h: style.font: unknown font 'Nonesuch' (valid: serif,")
    assert sheet.startswith("i: style.sheet: unknown style sheet 'ggplo'; did you mean 'ggplot'?")
    assert done.returncode == 1
    assert {x.name for x in (tmp_path / "runs/figures/a").glob("*.png")} == {"g.png"}


def test_a_figure_takes_the_look_that_its_user_has_set(several: Drawings) -> None:
    cycle = matplotlib.rcsetup.cycler(color=["#123456"])
    keys = {"kind": "phase", "x": "p", "y": "r"}
    data = several.cases["brief"]
    with matplotlib.rc_context({"font.size": 12, "lines.linewidth": 2, "axes.prop_cycle": cycle}):
        figure, chosen = (
            api.plot(data, **keys, style=style) for style in ({}, {"font_size": 6, "sheet": "bmh"})
        )
    axes = figure.axes[0]
    assert axes.xaxis.label.get_size() == 12
    assert (axes.lines[0].get_linewidth(), axes.lines[0].get_color()) == (2, "#123456")
    # Its own style counts before that.
    assert chosen.axes[0].lines[0].get_color() == "#348ABD"
    # Ticks are made when they are first drawn, here after the user's parameters are gone.
    FigureCanvasAgg(figure).draw()
    assert axes.get_xticklabels()[0].get_size() == pytest.approx(12 * 0.833)
    # Nor is anything left behind.
    assert api.plot(data, **keys).axes[0].xaxis.label.get_size() == pytest.approx(8.4)


def test_a_figure_takes_the_lines_of_a_cycle(several: Drawings) -> None:
    """Those that matplotlib knows and hodo has not; a second round has other lines."""
    cycle = matplotlib.rcsetup.cycler(color=["r", "b"], linestyle=["--", "-."])
    keys = {"kind": "series", "variables": ["p", "q", "r"], "panels": "case"}
    with matplotlib.rc_context({"axes.prop_cycle": cycle}):
        figure = api.plot(several.cases["brief"], **keys)
    looks = [(line.get_color(), line.get_linestyle()) for line in figure.axes[0].lines[:3]]
    assert looks == [("r", "--"), ("b", "-."), ("r", "-.")]


@pytest.mark.parametrize(
    ("style", "message"),
    [
        ({"font": "Ariel"}, "style.font: unknown font 'Ariel'"),
        ({"sheet": "ggplo"}, "style.sheet: unknown style sheet 'ggplo'; did you mean 'ggplot'?"),
        ({"sheet": "none.mplstyle"}, "style.sheet: none.mplstyle: no such file or directory"),
        ({"sheet": "http://x/y.mplstyle"}, "style.sheet: expected the name of a style sheet"),
        (
            {"log": ["x", "y"]},
            "reaches below zero, down to -0.2519; leave y out of log, or draw values above zero "
            "only",
        ),
        ({"xlabel": r"$\frac{$"}, "is not TeX"),
    ],
)
def test_a_style_that_cannot_be_had_is_one_line(
    several: Drawings, style: dict[str, object], message: str
) -> None:
    data = several.cases["brief"]
    keys = {"kind": "phase", "x": "p", "y": "omega.x2"}
    assert message in refused(lambda: api.plot(data, **keys, style=style))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("savefig.dpi: 0", "savefig.dpi: expected a number from 10 to 2400, got 0"),
        ("savefig.dpi: nan", "savefig.dpi: expected a number from 10 to 2400, got nan"),
        ("savefig.dpi: 20000", "savefig.dpi: expected a number from 10 to 2400, got 20000"),
        ("font.family: Ariel, Tmies", "font.family: no font of Ariel, Tmies is installed"),
        ("font.family: serif\nfont.serif: Tmies", "font.family: no font of serif is installed"),
    ],
)
def test_a_sheet_that_nothing_can_be_drawn_in_is_one_line(
    several: Drawings, tmp_path: Path, line: str, message: str
) -> None:
    sheet = tmp_path / "odd.mplstyle"
    sheet.write_text(line)
    keys = {"kind": "phase", "x": "p", "y": "omega.x2", "style": {"sheet": str(sheet)}}
    assert message in refused(lambda: save_as_png(several.cases["brief"], keys))


def test_a_font_that_a_sheet_has_in_reserve_is_taken_without_a_word(
    several: Drawings, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sheet = tmp_path / "reserve.mplstyle"
    sheet.write_text("font.family: Ariel, DejaVu Sans")
    keys = {"kind": "phase", "x": "p", "y": "omega.x2", "style": {"sheet": str(sheet)}}
    save_as_png(several.cases["brief"], keys)
    assert not caplog.messages


def save_as_png(data: Any, keys: dict[str, Any]) -> None:
    api.plot(data, **keys).savefig(io.BytesIO(), format="png")


def test_the_name_of_a_region_keeps_clear_of_the_curve(runs: Path) -> None:
    for name in ("fig9", "fig13-all-entries", "fig19"):
        figure = Drawings.of(runs / "paper1.h5").draw(name).figure
        figure.draw_without_rendering()
        axes = figure.axes[0]
        curve = axes.transData.transform(np.concatenate(axes.collections[0].get_segments()))
        for text in axes.texts[:2]:
            box = text.get_window_extent()
            assert not ((curve > box.min) & (curve < box.max)).all(axis=1).any()


def test_an_enlargement_that_shows_nothing_is_refused(several: Drawings) -> None:
    for kind in ("hodograph", "quadrants"):
        data = several.cases["brief"]
        line = refused(lambda kind=kind, data=data: api.plot(data, kind=kind, zoom=1e-4))
        assert "zoom: 0.0001 shows nothing: the curves come no nearer to the origin than" in line


@pytest.mark.parametrize(("kind", "units"), [("hodograph", "kg m^2/s"), ("quadrants", "1/s^2")])
def test_an_enlargement_that_shows_nothing_names_the_unit(kind: str, units: str) -> None:
    body = {"inertia": [120, 100, 80], "inertia_unit": "kg m^2", "model": "linear-diag"}
    start = {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 9, "unit": "s"}}
    with pytest.raises(HodoError) as refusal:
        api.plot(api.run(body | start), kind=kind, zoom=1e-4)
    assert str(refusal.value).endswith(f" [{units}]")


def test_components_of_one_vector_have_one_scale(several: Drawings) -> None:
    data = several.cases["brief"]
    for x, y, aspect in (("p", "omega.x3", 1), ("G.x1", "G.x2", 1), ("p", "T", "auto")):
        (axes,) = api.plot(data, kind="phase", x=x, y=y).axes
        assert axes.get_aspect() == aspect


def test_several_crossings_are_numbered_in_picture_and_legend(runs: Path) -> None:
    sheet = Drawings.of(runs / "paper1.h5").draw("fig12-all-entries")
    sheet.figure.draw_without_rendering()
    texts = {text.get_text() for text in sheet.figure.axes[0].texts if text.get_visible()}
    assert {"1", "2, 3"} <= texts
    # Beside the one that lies further to the upper right, and so on neither.
    other = Drawings.of(runs / "paper1.h5").draw("fig13-all-entries").figure
    other.draw_without_rendering()
    (_, enlarged, *_) = other.axes
    (both,) = (text for text in enlarged.texts if text.get_text() == "2, 3")
    assert both.xy[0] > 0.003
    assert "256.993 (1), 396.993 (2), 406.942 (3)" in str(sheet.legend[-1].get_label())
    # Every round value on an axis has its number.
    assert {"0.2", "0.4", "0.6", "0.8"} <= texts


@pytest.mark.parametrize(
    ("figure", "message"),
    [
        (
            "kind: sphere, cases: a, labels: [a, b]",
            "labels: expected one for each of the cases, 1 in all, got 2",
        ),
        (
            "kind: series, cases: a, variables: T, span: [5, 1]",
            "span: expected the lower end first",
        ),
        (
            "kind: map, cases: s, variable: crossings, x: u, y: v, range: [5, 1]",
            "range: expected the lower end first",
        ),
        (
            "kind: map, cases: s, variable: crossings, x: u",
            "missing 'y': a map has x and y, or neither",
        ),
        (
            "kind: map, cases: s, variable: crossings, x: u, y: u",
            "y: u is the axis of 'x' already",
        ),
        (
            "kind: map, cases: s, variable: crossings, x: u, y: v, panels: v",
            "panels: v is the axis of 'y' already",
        ),
        (
            "kind: sphere, cases: a, style: {wdth: 1}",
            "style.wdth: unknown key; did you mean 'width'?",
        ),
        (
            "kind: sphere, cases: a, style: {width: 1}",
            "style.width: expected a number >= 20",
        ),
        ("kind: sphere, cases: a, style: {log: x}", "the panels of a sphere have no scales"),
        (
            "kind: phase, cases: a, x: p, y: q, style: {log: x, xlim: [0, 1]}",
            "style.xlim: expected positive ends of a logarithmic axis",
        ),
        (
            "kind: phase, cases: a, x: p, y: q, style: {ylim: [1, 0]}",
            "style.ylim: expected the lower end first",
        ),
    ],
)
def test_keys_that_do_not_fit_each_other_are_named_with_their_place(
    figure: str, message: str
) -> None:
    body = "model: linear-diag, inertia: [3, 2, 2], initial: {p: 1, q: 1, r: 1}, time: {end: 1}"
    sweep = "u: {zip: {damping.0: {values: [1, 2]}}}, v: {zip: {damping.1: {values: [1, 2]}}}"
    cases = f"  a: {{{body}}}\n  s: {{{body}, damping: [1, 1, 1], sweep: {{{sweep}}}}}\n"
    said = refused(lambda: parse(f"cases:\n{cases}figures:\n  f: {{{figure}}}\n", "x.yaml"))
    assert said.startswith("x.yaml:5:")
    assert message in said


def test_time_is_a_variable_and_words_are_no_formulas(runs: Path) -> None:
    results = Drawings.of(runs / "paper1.h5")
    series = {**results.figures["fig12-sensitivity"], "span": None, "level": None, "columns": 2}
    variables = ("time", "enclosed_axis", "T")
    sheet = results.draw({**series, "variables": variables})
    first, second, third = sheet.figure.axes
    assert (first.lines[0].get_xdata() == first.lines[0].get_ydata()).all()
    assert second.get_ylabel().startswith(r"$\mathrm{enclosed\ axis}$")
    # The place below the second panel is empty, and its ticks are its own.
    assert second.get_xlabel() == third.get_xlabel() != ""
    assert second.xaxis.get_tick_params()["labelbottom"]
    phase = {"kind": "phase", "x": "time", "y": "T", "cases": ("fig4",), "time": "t"}
    drawn = results.draw({**series, **phase})
    assert drawn.shown[0].values["time"].size > 1
    beyond = {**series, "variables": ("T",), "span": (1e5, 2e5)}
    assert "holds no time of case" in refused(lambda: results.draw(beyond))


def test_a_figure_that_breaks_does_not_cost_the_others(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*given: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setitem(figures.DRAW, "sphere", broken)
    results = Drawings.of(runs / "paper1.h5")
    first, second = (results.render(name, ("png",), tmp_path) for name in ("fig1", "fig5"))
    assert first.problem == "ZeroDivisionError: by zero"
    assert second.files[0].is_file()


def test_no_two_of_many_curves_look_the_same_and_all_stand_out(several: Drawings) -> None:
    """Eight curves differ in line too, for grey print. The contrast is that of WCAG 2: (1 + 0.05) /
    (L + 0.05) on white, with L by the linear values."""
    data = [several.cases["brief"]] * 32
    lines = [
        line for line in api.plot(data, kind="phase", x="p", y="T").axes[0].lines
        if line.get_marker() == "None"
    ]  # fmt: skip
    looks = [(line.get_color(), str(line._dash_pattern)) for line in lines]
    assert len(set(looks)) == 32
    assert len({dashes for _, dashes in looks[:8]}) == 8
    coloured = api.plot(data[0], colour="time", view=[90, 0]).axes[0].collections[0].get_colors()
    axes = api.plot(data[0], colour="axis").axes[0].collections[0].get_colors()
    shades = [to_rgb(colour) for colour, _ in looks]
    assert len(coloured)
    for shade in np.array([*shades, *axes[:1, :3]]):
        linear = np.where(shade <= 0.03928, shade / 12.92, ((shade + 0.055) / 1.055) ** 2.4)
        assert 1.05 / (linear @ [0.2126, 0.7152, 0.0722] + 0.05) >= 3, shade


def test_a_config_is_drawn_as_it_is_now(hodo: Hodo, tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    case = "{model: linear-diag, inertia: [3, 2, 2], initial: {p: 1, q: 1, r: 1}, time: {end: 1}}"
    figure = "{kind: phase, cases: a, x: p, y: q, caption: old}"
    text = f"cases: {{a: {case}}}\nfigures: {{f: {figure}}}\n"
    config.write_text(text)
    assert hodo("run", "c.yaml", "--quiet").returncode == 0
    config.write_text(text.replace("old", "new"))
    done = hodo("plot", "c.yaml")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "runs" / "figures" / "index.html").read_text()
    assert "new" in page
    assert "old" not in page
    assert "unknown figure 'g' (valid: f)" in hodo("plot", "runs/c.h5", "g").stderr
    assert hodo("plot", "f").stderr == "f: no such file or directory\n"


KEPT = """defaults: {{model: linear-diag, inertia: [3, 2, 1.5]}}
cases:
  a: {{initial: {{p: 1, q: 1, r: {r}}}, time: {{end: 1}}}}
  b: {{initial: {{p: 1, q: 1, r: 2}}, time: {{end: {end}}}}}
figures:
  of-a: {{kind: phase, cases: a, x: p, y: q, caption: {caption}}}
  of-b: {{kind: phase, cases: b, x: p, y: q}}
  wide: {{kind: quadrants, cases: a, scale_with: [of-b]}}
"""


def test_only_what_has_changed_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By content: a figure's entry, the cases that it reads, and its files as they are."""
    monkeypatch.chdir(tmp_path)
    config, folder = tmp_path / "c.yaml", tmp_path / "runs" / "figures" / "c"
    page_file = folder.parent / "index.html"

    def drawn(*options: str, caption: str = "old", r: int = 1, end: int = 1) -> set[str]:
        """The files that this plot has written anew; one that is kept stays the same file."""
        config.write_text(KEPT.format(caption=caption, r=r, end=end))
        # In this process, which has loaded already what each of the commands would.
        main(["run", "c.yaml", "--quiet"], standalone_mode=False)
        main(["classify", "c.yaml"], standalone_mode=False)
        files = [*folder.glob("*.png"), *folder.glob("*.csv"), *folder.parent.glob("index.html")]
        before = {file: file.stat().st_ino for file in files}
        held = [open(file, "rb") for file in files]  # noqa: SIM115 (or their numbers come again)
        formats = ["--format", "png", "--format", "csv"]
        main(["plot", "c.yaml", *formats, *options], standalone_mode=False)
        for file in held:
            file.close()
        after = {*folder.glob("*.png"), *folder.glob("*.csv"), page_file}
        return {file.name for file in after if before.get(file) != file.stat().st_ino}

    def files(*names: str) -> set[str]:
        return {f"{name}.{suffix}" for name in names for suffix in ("png", "csv")}

    everything = {*files("of-a", "of-b", "wide"), "index.html"}
    assert drawn() == everything
    assert drawn() == set()
    assert drawn(caption="new") == {*files("of-a"), "index.html"}
    assert drawn(caption="new", r=2) == {*files("of-a", "wide"), "index.html"}
    # Its scale is that of another figure's case.
    assert drawn(caption="new", r=2, end=2) == {*files("of-b", "wide"), "index.html"}
    (folder / "of-b.csv").write_text("another program wrote this")
    assert drawn(caption="new", r=2, end=2) == files("of-b")
    (folder / "of-a.png").unlink()
    page_file.write_text("and this")
    assert drawn(caption="new", r=2, end=2) == {*files("of-a"), "index.html"}
    for record in ("[1", '{"of-a.png": {"digest": "", "cases": 3, "warnings": []}}'):
        (folder / "drawn.json").write_text(record)
        assert drawn(caption="new", r=2, end=2) == files("of-a", "of-b", "wide")
    assert drawn("--force", caption="new", r=2, end=2) == everything


def test_what_no_checksum_tells_apart_is_drawn_each_time(hodo: Hodo, tmp_path: Path) -> None:
    text, result = KEPT.format(caption="old", r=1, end=1), tmp_path / "runs" / "c.h5"
    (tmp_path / "c.yaml").write_text(text)
    assert hodo("run", "c.yaml", "--quiet").returncode == 0
    assert hodo("plot", "c.yaml", "of-a").returncode == 0
    with h5py.File(result, "r+") as file:
        file["a"].attrs["mine"] = "by another program"
    picture = result.parent / "figures" / "c" / "of-a.png"
    for caption in ("new", "newest"):
        (tmp_path / "c.yaml").write_text(KEPT.format(caption=caption, r=1, end=1))
        done = hodo("plot", "c.yaml", "of-a")
        assert "kept" not in done.stderr
        assert done.stdout == f"{picture.relative_to(tmp_path)}\n", done.stderr
        picture.unlink(missing_ok=True)
    page = picture.parents[1] / "index.html"
    for caption in ("new", "newest"):
        (tmp_path / "c.yaml").write_text(KEPT.format(caption=caption, r=1, end=1))
        hodo("plot", "c.yaml")
        assert f">{caption}<" in page.read_text()


def test_what_a_process_warns_of_is_heard_and_heard_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = KEPT.format(caption="a", r=1, end=1).replace("quadrants", "sphere")
    (tmp_path / "c.yaml").write_text(text.replace(", scale_with: [of-b]", ""))
    assert CliRunner().invoke(main, ["run", "c.yaml", "--quiet"]).exit_code == 0
    first = CliRunner().invoke(main, ["plot", "runs/c.h5", "-j", "2"])
    assert first.stderr.count("is not classified") == 1
    again = CliRunner().invoke(main, ["plot", "runs/c.h5"])
    assert again.stdout == first.stdout
    assert again.stderr == f"3 of 3 figures are kept; --force draws them anew\n{first.stderr}"


def test_the_names_of_panels_are_within_the_figure(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(
        "cases: {a: {model: linear-diag, inertia: [3, 2, 1], damping: [1, 1, 1], "
        "initial: {p: 0, q: 0, G: 1}, time: {end: 0.1}, "
        "sweep: {damping.2: {values: [1, 2]}, d: {sphere: {count: 9}}}}}\n"
        "figures: {f: {kind: map, cases: a, variable: omega.x1, panels: damping.2}}\n"
    )
    assert hodo("run", "c.yaml", "--quiet").returncode == 0
    results = Drawings.of(tmp_path / "runs/c.h5")
    for at in ((0,), (0, 1)):
        drawing = results.draw({**results.figures["f"], "at": at}).figure
        FigureCanvasAgg(drawing).draw()
        for panel in drawing.axes[: len(at)]:
            assert panel.get_title()
            assert panel.title.get_window_extent().y1 <= drawing.bbox.y1


def test_a_bare_name_is_a_config_unless_it_is_a_figure(hodo: Hodo, tmp_path: Path) -> None:
    text = KEPT.format(caption="a", r=1, end=1)
    for name in ("c", "d", "of-a"):
        (tmp_path / f"{name}.yaml").write_text(text)
    (tmp_path / "broken.yaml").write_text("cases: 1")
    assert hodo("run", "c.yaml", "d.yaml", "--quiet").returncode == 0
    for first in ("c", "runs/c.h5"):
        done = hodo("plot", first, "d", "of-a")
        assert done.stdout.splitlines() == [f"runs/figures/{name}/of-a.png" for name in "cd"]
        assert "unknown figure 'broken'" in hodo("plot", first, "broken").stderr


def test_a_sheet_and_a_config_are_found_from_any_folder(
    hodo: Hodo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through a link to the folder of results, and with paths that are other ones from there."""
    (tmp_path / "work").mkdir()
    (tmp_path / "data" / "deep" / "runs").mkdir(parents=True)
    (tmp_path / "work" / "runs").symlink_to("../data/deep/runs")
    text = KEPT.format(caption="a", r=1, end=1).replace("caption: a", "style: {sheet: a.mplstyle}")
    (tmp_path / "work" / "c.yaml").write_text(text)
    (tmp_path / "work" / "a.mplstyle").write_text("axes.labelcolor: red\n")
    assert call(tmp_path / "work", "run", "c.yaml", "--quiet").returncode == 0
    plot = "plot", "runs/c.h5", "--out", "../figs"
    assert call(tmp_path / "work", *plot).returncode == 0
    monkeypatch.chdir(tmp_path)
    page = Path("figs/index.html").stat().st_ino
    again = hodo("plot", "work/runs/c.h5", "--out", "figs")
    assert "3 of 3 figures are kept" in again.stderr
    assert Path("figs/index.html").stat().st_ino == page
    (tmp_path / "work" / "c.yaml").write_text(text.replace("q: 1", "q: 2"))
    for folder in ("work", "data"):
        shown = call(tmp_path / folder, "show", "../work/runs/c.h5")
        assert "a, b" in shown.stderr
        assert "c.yaml" in shown.stderr
    # Where no path leads there, as from one drive of Windows to another, the whole one is taken.
    monkeypatch.setattr(os.path, "relpath", fail_as_windows)
    done = hodo("plot", "work/runs/c.h5", "--out", "figs", "--force")
    assert done.returncode == 0, done.stderr
    assert f"{tmp_path}/work/runs/c.h5".lstrip("/") in Path("figs/index.html").read_text()


def fail_as_windows(*paths: object) -> str:
    """As `relpath` across drives."""
    raise ValueError(f"path is on mount 'C:', start on mount 'D:': {paths}")


def test_a_result_is_drawn_once_and_two_of_one_name_are_refused(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(KEPT.format(caption="a", r=1, end=1))
    for folder in ("runs", "more"):
        assert hodo("run", "c.yaml", "--quiet", "--out", folder).returncode == 0
    drawn = hodo("plot", "c.yaml", "runs/c.h5", "of-a", "--out", "figs")
    assert drawn.stdout == "figs/c/of-a.png\n"
    done = hodo("plot", "runs/c.h5", "more/c.h5", "--out", "figs")
    words = "figs/c would hold the figures of runs/c.h5 and more/c.h5: rename one\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", words)


def test_a_figure_that_failed_is_tried_again(hodo: Hodo, tmp_path: Path) -> None:
    text = KEPT.format(caption="a", r=1, end=1).replace("q: 1", "q: -1")
    (tmp_path / "c.yaml").write_text(text)
    assert hodo("run", "c.yaml", "--quiet").returncode == 0
    assert hodo("plot", "c.yaml", "of-a").returncode == 0
    (tmp_path / "c.yaml").write_text(
        text.replace("y: q, caption", "y: q, style: {log: y}, caption")
    )
    for _ in range(2):
        done = hodo("plot", "c.yaml", "of-a")
        assert done.returncode == 1
        assert "reaches below zero" in done.stderr


def test_of_many_crossings_a_legend_names_some(runs: Path) -> None:
    data = api.open(runs / "paper1.h5")["fig4"]
    times = np.arange(100.0, 130.0)
    data = data.isel(crossing=np.zeros(len(times), dtype=int))
    data = data.assign(crossing_time=("crossing", times))
    (legend,) = api.plot(data, kind="phase", x="p", y="r").legends
    (words,) = [text.get_text() for text in legend.get_texts() if "D = 0" in text.get_text()]
    assert words.replace("\n", " ").endswith("109.000 (10), 110.000 (11), 18 more, 129.000 (30)")


SEVERAL = """
defaults: {model: linear-diag, damping: 0.01, initial: {p: 1, q: 0.1, r: 0.2}}
cases:
  brief: {inertia: [1, 0.8, 0.6], time: {end: 10, samples: 101}}
  long: {inertia: [1, 0.8, 0.6], time: {end: 40, samples: 401}}
  other: {inertia: [0.6, 0.8, 1], time: {end: 10, samples: 101}}
figures:
  each: {kind: series, panels: case, cases: [brief, long], variables: [p]}
  corner: {kind: quadrants, cases: [brief, other]}
  bounds: {kind: invariants, cases: [brief, other]}
  ball: {kind: sphere, cases: [brief, other]}
  same: {kind: sphere, cases: [brief, long]}
"""


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> Drawings:
    return drawings_of(SEVERAL, tmp_path_factory.mktemp("several"), "several")


def test_panels_of_cases_show_the_whole_of_each(several: Drawings) -> None:
    for panel in several.draw("each").figure.axes:
        assert panel.get_xlim()[1] >= 40


def test_no_body_is_shown_in_the_regions_of_another(several: Drawings) -> None:
    for name in ("corner", "bounds"):
        said = refused(lambda name=name: several.draw(name))
        assert "brief and other are motions of two bodies" in said
    several.draw("ball")  # whose separatrices have the colours of their bodies


@pytest.mark.parametrize("colour", ["case", "axis", "time"])
def test_the_separatrices_of_several_bodies_are_all_drawn_and_told_apart(
    colour: str, several: Drawings
) -> None:
    lines = [entry for entry in several.draw("ball", colour=colour).legend if entry.get_label()]
    looks = {
        (line.get_color(), str(line.__dict__["_unscaled_dash_pattern"]))
        for line in lines
        if str(line.get_label()).startswith("separatrix of ")
    }
    assert len(looks) == 2


def test_numbers_of_passages_have_a_scale_even_if_they_are_0_and_1() -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [5e-3, 4e-3, 3e-3]}
    axes = {"damping.0": {"values": [1e-3, 5e-3]}, "damping.2": {"values": [1e-3, 5e-3]}}
    start = {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 1000}}
    made = api.sweep({**body, **start, "sweep": axes})
    assert set(made.crossings.values.ravel().tolist()) == {0, 1}
    figure = api.plot(made, "map", variable="crossings", x="damping.0", y="damping.2")
    assert figure.axes[-1].get_xlabel() == "number of passages"
    assert figure.axes[0].collections[0].get_cmap().N == 2
    assert figure.axes[-1].get_xticks().tolist() == [0, 1]
    # A line between two values is no result.
    lines = api.plot(made, "curve", variable="crossings", x="damping.0", by="damping.2").axes[0]
    assert {line.get_linewidth() for line in lines.lines[::2]} == {0.4}


@pytest.mark.parametrize(
    ("ends", "arrows"),
    [([0, 1], "neither"), ([0, 0.4], "max"), ([0.35, 1], "min"), ([0.35, 0.4], "both")],
)
def test_a_colour_scale_has_arrows_where_values_lie_beyond_it(
    ends: list[float], arrows: str
) -> None:
    """And a column of a single value is as narrow as it needs to show that."""
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "time": {"end": 200}}
    start = {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "damping": [5e-3, 4e-3, 3e-3]}
    axes = {"damping.0": {"values": [5e-3]}, "damping.2": {"values": [1e-3, 5e-2]}}
    made = api.sweep({**body, **start, "sweep": axes})
    low, high = sorted(api.derive(made, "G").G.values.ravel())
    assert 0.3 < low < 0.35 < 0.4 < high < 0.6
    figure = api.plot(made, "map", variable="G", x="damping.0", y="damping.2", range=ends)
    assert figure.axes[-1].__dict__["_colorbar"].extend == arrows
    assert figure.axes[0].get_xlim() == pytest.approx((4.5e-3, 5.5e-3))


@pytest.mark.parametrize("damping", [0, 1e-9])
def test_a_constant_quantity_is_drawn_as_one(damping: float) -> None:
    start = {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 100}, "attitude": "yes"}
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": damping}
    data = api.run({**body, **start})
    momentum, turned, wobbling = api.plot(data, "series", variables=["G", "G_space.x", "p"]).axes
    for axes, name in ((momentum, "G"), (turned, "G_space.x")):
        low, high = axes.get_ylim()
        # It falls by 1e-7, which is seen, or changes by rounding, which is not.
        assert (high - low > 0.1) == (damping == 0), name
        assert [text.get_text()[:8] for text in axes.texts] == ["constant"] * (damping == 0)
    assert not wobbling.texts


def test_what_changes_visibly_is_not_constant_whatever_error_is_stated() -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": 0.01, "time": {"end": 9}}
    motion = api.run(body | {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}})
    (axes,) = api.plot(motion.assign_attrs(error=1e5), "series", variables=["G"]).axes
    assert not axes.texts


@pytest.mark.parametrize(
    ("key", "symbol"),
    [
        ("damping.2", r"\lambda_3"),
        ("initial.p", "p"),
        ("resistance.0.1", "I_{12}"),
        ("resistance.diagonal", "I_{ii}"),
    ],
)
def test_symbols_of_keys(key: str, symbol: str) -> None:
    model = {"model": "linear-diag", "damping": [1e-3, 1e-3, 1e-3]}
    if key.startswith("resistance"):
        full = [[1e-3, 0, 0], [0, 1e-3, 0], [0, 0, 1e-3]]
        short = {"diagonal": 1e-3, "off_diagonal": 0}
        model = {"model": "tensor", "resistance": short if "diagonal" in key else full}
    start = {"inertia": [1, 0.8, 0.6], "initial": {"p": 1, "q": 1, "r": 1}, "time": {"end": 1}}
    made = api.sweep({**model, **start, "sweep": {key: {"values": [1e-3, 2e-3]}}})
    assert api.plot(made, "curve", variable="omega.x1", x=key).axes[0].get_xlabel() == f"${symbol}$"


@pytest.mark.parametrize(
    ("passages", "legend"), [("yes", ["crossing of each curve, $D = 0$"]), ("no", [])]
)
def test_a_series_names_the_crossings_that_it_marks(passages: str, legend: list[str]) -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.05, 0.04, 0.03]}
    start = {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 30}}
    drawn = api.plot(api.run(body | start), "series", variables=["D"], passages=passages)
    assert [text.get_text() for box in drawn.legends for text in box.get_texts()] == legend


def test_a_sketch_names_the_slope_of_each_body(tmp_path: Path) -> None:
    text = """
cases: {a: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0.1, initial: {p: 1, q: 1, r: 1},
            time: {end: 1}}}
figures: {f: {kind: quadrant-sketch, bodies: [[1, 0.8, 0.8], [1, 0.8, 0.6], [1, 1, 0.6]]}}
"""
    drawn = drawings_of(text, tmp_path).draw("f")
    slopes = [axes.get_title().splitlines()[1] for axes in drawn.figure.axes]
    assert slopes == ["$K = 0$", "$K = 0.6$", r"$K = \infty$"]


def test_a_map_of_directions_has_the_separatrix_of_its_body() -> None:
    def curves(moments: list[float]) -> int:
        start = {"damping": [5e-3, 4e-3, 3e-3], "initial": {"p": 0, "q": 0, "G": 1}}
        swept = {"time": {"end": 20}, "sweep": {"direction": {"sphere": {"count": 60, "seed": 1}}}}
        body = {"model": "torques", "inertia": moments, "error": "off"}
        (axes, *_) = api.plot(api.sweep(body | start | swept), "map", variable="end_axis.x1").axes
        return sum(len(line.get_xdata()) > 700 for line in axes.lines)

    assert (curves([1, 0.8, 0.6]), curves([1, 1, 0.6])) == (2, 0)


def five_times_crossing() -> Any:
    """A motion that a torque of the time takes to and fro across the separatrix."""
    body = {"model": "torques", "inertia": [12, 9, 6.5], "kappa": 0.5}
    body["time"] = {"end": 400, "unit": "s"}
    body["damping"] = {"law": "exponential", "value": 0.01, "rate": 0.004}
    start = {"p": 0.2, "q": 0.5, "r": 1}
    return api.run(body | {"expression": ["0.03*cos(0.1*t)", 0, 0], "initial": start})


def test_words_above_panels_of_equal_scales_are_within_the_figure() -> None:
    """A legend of two lines makes panels as high as their room that were lower before it."""
    style = {"width": "page", "letters": True}
    figure = api.plot(five_times_crossing(), "quadrants", zoom=0.05, style=style)
    figure.draw_without_rendering()
    titles = [axes.title.get_window_extent() for axes in figure.axes]
    assert max(title.y1 for title in titles) < figure.bbox.y1
    (*_, crossed) = figure.legends[0].get_texts()
    assert crossed.get_text().splitlines()[1] == "369.872 (5) s"


def test_times_of_crossings_leave_room_for_panels_in_a_column() -> None:
    """In one line they were as wide as the legend, which took a line for each of its entries."""
    motion = five_times_crossing()
    for kind, zoom in (("quadrants", 0.05), ("hodograph", 3.0)):
        figure = api.plot(motion, kind, zoom=zoom, style={"width": "column"})
        figure.draw_without_rendering()
        legend = figure.legends[0].get_window_extent()
        assert legend.height < figure.bbox.height / 2


def test_crossings_are_numbered_by_their_places_in_the_panel() -> None:
    """In one that ends nearer, or whose scales are unlike or logarithmic, they lie further apart
    than among all values."""
    motion = five_times_crossing()
    assert motion.sizes["crossing"] == 5

    def numbers(kind: str, **keys: Any) -> list[str]:
        (axes,) = (figure := api.plot(motion, kind, **keys)).axes
        figure.draw_without_rendering()
        texts = (text.get_text() for text in axes.texts if text.get_visible())
        return sorted(text for text in texts if text[0].isdigit())

    ends = {"xlim": [-0.2, 0.2], "ylim": [-0.2, 0.2]}
    pair = {"x": "omega.x1", "y": "omega.x3"}
    assert numbers("phase", **pair) == ["1", "2, 3", "4, 5"]
    # The first lies beyond these ends.
    assert numbers("phase", **pair, style=ends) == ["2", "3", "4", "5"]
    assert numbers("phase", x="G2", y="omega.x3") == ["1", "2, 3", "4, 5"]
    assert numbers("quadrants") == ["1", "2, 3, 4, 5"]
    assert numbers("quadrants", style={"log": ["x", "y"]}) == ["1", "2, 5", "3, 4"]


def test_a_crossing_alone_has_no_number() -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.05, 0.04, 0.03]}
    motion = api.run(body | {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 30}})
    assert motion.sizes["crossing"] == 1
    texts = [text.get_text() for axes in api.plot(motion, "hodograph").axes for text in axes.texts]
    assert "1" not in texts


def test_numbers_of_crossings_stand_also_where_a_variable_is_constant() -> None:
    motion = api.run(config_of("paper1").cases["fig12-all-entries"])
    assert motion.sizes["crossing"] == 3
    constant = motion.assign(Q=("time", np.full(motion.sizes["time"], 0.3)))
    (axes,) = api.plot(constant, "phase", x="time", y="Q").axes
    *numbers, remark = (text.get_text() for text in axes.texts)
    assert sorted(", ".join(numbers).split(", ")) == ["1", "2", "3"]
    assert remark == "$Q$ constant"


@pytest.mark.parametrize("height", [60, 40])
def test_words_beside_a_mark_stay_at_it_where_the_panel_has_no_room(height: int) -> None:
    body = {"model": "torques", "inertia": [2, 1.5, 1], "brake": 0.004, "damping": 0.001}
    motion = api.run(body | {"initial": {"p": 0.3, "q": 0.7, "r": -0.9}, "time": {"end": 1000}})
    variables = ["p", "q", "r", "G", "T", "D"]
    drawn = api.plot(motion, "series", variables=variables, style={"height": height})
    drawn.draw_without_rendering()
    for axes in drawn.axes:
        (words,) = axes.texts
        # Within two lines of the mark, whose panel may be lower than the words.
        assert abs(words.xyann[1]) < 20


@pytest.mark.parametrize(
    ("kind", "more", "panel"), [("hodograph", {"projections": ["x1x2"]}, 1), ("herpolhode", {}, 0)]
)
def test_colours_by_time_are_those_of_one_scale_for_all_curves(
    kind: str, more: dict[str, Any], panel: int
) -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": 0.005, "attitude": "yes"}
    motions = [
        api.run(body | {"initial": {"p": p, "q": 0.5, "r": 0.4}, "time": {"end": end}})
        for p, end in ((0.5, 10.0), (0.8, 100.0))
    ]
    for several in permutations(motions):
        axes = api.plot(several, kind, colour="time", **more).axes
        assert axes[-1].get_xlim() == (0, 100)
        curves = [each for each in axes[panel].collections if isinstance(each, LineCollection)]
        for motion, curve in zip(several, curves, strict=True):
            assert len(curve.get_colors()) == (64 if motion.time[-1] == 100 else 7)


def test_a_film_of_figures_that_do_not_move_is_refused(tmp_path: Path) -> None:
    (tmp_path / "still.yaml").write_text(
        "cases: {a: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 1, r: 1}, "
        "time: {end: 1}}}\nfigures: {f: {kind: hodograph, cases: [a]}}\n",
        encoding="utf-8",
    )
    assert call(tmp_path, "run", "still.yaml", "--quiet").returncode == 0
    done = call(tmp_path, "plot", "runs/still.h5", "--format", "gif")
    assert done.returncode == 2
    assert done.stderr == "no figure moves: only one of kind body makes a film\n"
    assert not (tmp_path / "runs" / "figures").exists()
