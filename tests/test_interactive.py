"""Figures that turn: the values of the printed ones, in a page that a browser shows by itself."""

import base64
import importlib.util
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from drawings import Drawings, drawings_of

from hodo_cli.cases.figure_block import DrawnFigure
from hodo_cli.figures.sheet import Sheet
from hodo_cli.results.dataset import motion_from

if importlib.util.find_spec("plotly") is None:
    pytest.skip("needs plotly", allow_module_level=True)

from hodo_cli.figures.artists import COLOURS
from hodo_cli.figures.interactive import interactive, write_interactive
from hodo_cli.figures.maps import GAP
from hodo_cli.figures.sheet import save

CONFIG = r"""
title: Turning
cases:
  fig4:
    model: linear-diag
    inertia: [1, 0.8, 0.6]
    damping: [0.005, 0.004, 0.003]
    initial: {p: 0.8, q: 0.5, r: 0.74}
    time: {end: 1000, samples: 501}
  grid:
    model: linear-diag
    inertia: [1, 0.8, 0.6]
    damping: [0.005, 0.004, 0.003]
    initial: {p: 0.8, q: 0.5, r: 0.74}
    time: {end: 1000}
    sweep: {damping.2: {linspace: [0.001, 0.006, 6]}, damping.0: {values: [0.004, 0.005]}}
  starts:
    model: linear-diag
    inertia: [1, 0.8, 0.6]
    damping: [0.005, 0.004, 0.003]
    initial: {p: 0, q: 0, G: 1}
    time: {end: 1000}
    sweep: {damping.2: {values: [0.001, 0.006]}, direction: {sphere: {count: 20, seed: 1}}}
figures:
  lines: {kind: curve, cases: grid, variable: crossing_time, x: damping.2, by: damping.0}
  flat: {kind: map, cases: grid, variable: crossing_time, x: damping.2, y: damping.0}
  round: {kind: map, cases: starts, variable: crossing_time, panels: damping.2}
  space: {kind: hodograph, cases: fig4, caption: "</script><b>&"}
  ball: {kind: sphere, cases: fig4}
  time: {kind: series, cases: fig4, variables: [T, D/2T, G.x1], time: \tau}
  clock: {kind: series, cases: fig4, variables: [time]}
  late: {kind: phase, cases: fig4, x: p, y: time}
  plane: {kind: phase, cases: fig4, x: p, y: q}
  corner: {kind: quadrants, cases: fig4}
  bounds: {kind: invariants, cases: fig4, styles: [green dotted]}
  own: {kind: hodograph, cases: fig4, colour: case, styles: [orange]}
"""

ALL = [
    *("lines", "flat", "round", "space", "ball", "time", "clock", "late", "plane", "corner"),
    *("bounds", "own"),
]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Drawings:
    """Cases and their figures."""
    return drawings_of(CONFIG, tmp_path_factory.mktemp("results"))


def drawn(results: Drawings, name: str) -> tuple[Sheet, dict[str, np.ndarray]]:
    """A printed figure, and the values of its turning form by the names of its traces."""
    spec = results.figures[name]
    sheet = results.draw(spec)
    made = interactive(sheet, spec, results.cases)
    axes = "xyz" if made.data[0].type == "scatter3d" else "xy"
    found: dict[str, np.ndarray] = {}
    for trace in made.data:
        if trace.mode == "lines" and trace.customdata is not None:
            values = np.stack([np.asarray(trace[axis], dtype=float) for axis in axes], axis=-1)
            found[f"{trace.name} {trace.xaxis if axes == 'xy' else ''}".strip()] = values
    return sheet, found


@pytest.mark.parametrize("name", ["space", "ball"])
def test_a_turning_curve_is_the_printed_one_point_by_point(results: Drawings, name: str) -> None:
    """The parts by enclosed axis overlap in the sample where one ends and the next begins."""
    sheet, found = drawn(results, name)
    (shown,) = sheet.shown
    printed = np.stack([v for key, v in shown.values.items() if key != "time"], axis=-1)
    parts = np.stack(list(found.values()))
    assert len(parts) == (2 if name == "space" else 1)
    assert np.isfinite(parts).all(axis=2).any(axis=0).all()
    for part in parts:
        there = np.isfinite(part[:, 0])
        np.testing.assert_array_equal(part[there], printed[there])


@pytest.mark.parametrize("name", ["time", "plane", "corner", "bounds"])
def test_panels_are_the_printed_ones_point_by_point(results: Drawings, name: str) -> None:
    sheet, found = drawn(results, name)
    printed = []
    for shown in sheet.shown:
        values = [np.asarray(v) for key, v in shown.values.items() if key != "time"]
        if name in ("plane", "corner"):
            printed.append(np.stack(values, axis=-1))
        else:
            printed += [np.stack([shown.values["time"], value], axis=-1) for value in values]
    assert len(found) == len(printed) > 0
    for ours, theirs in zip(found.values(), printed, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    if name in ("time", "plane"):
        lines = [np.asarray(line.get_xydata()) for axes in sheet.figure.axes for line in axes.lines]
        assert all(any(np.array_equal(ours, line) for line in lines) for ours in found.values())


def test_time_may_be_drawn_itself(results: Drawings) -> None:
    time = results.cases["fig4"].variables["time"].data
    for name, across in (
        ("clock", time),
        ("late", motion_from(results.cases["fig4"], "fig4")["p"]),
    ):
        _, found = drawn(results, name)
        (values,) = found.values()
        np.testing.assert_array_equal(values, np.stack([across, time], axis=-1))


def test_curves_of_sweeps_are_the_printed_ones_with_their_errors(results: Drawings) -> None:
    spec = results.figures["lines"]
    sheet = results.draw(spec)
    made = interactive(sheet, spec, results.cases)
    curves = [trace for trace in made.data if trace.name != "none"]
    assert [trace.name for trace in curves] == ["damping.0 = 0.004", "damping.0 = 0.005"]
    assert made.layout.xaxis.title.text == "λ3"
    assert made.layout.yaxis.title.text == "time of the first passage through the<br>separatrix"
    for trace, shown in zip(curves, sheet.shown, strict=True):
        x, values, errors, other = shown.values.values()
        assert set(other) in ({0.004}, {0.005})
        np.testing.assert_array_equal(trace.x, x)
        np.testing.assert_array_equal(np.asarray(trace.y, dtype=float), values)
        np.testing.assert_array_equal(np.asarray(trace.error_y.array, dtype=float), errors)
        assert np.isfinite(values).any()
        assert (errors[np.isfinite(values)] > 0).all()


def test_members_without_a_value_are_marked_where_the_printed_curves_mark_them(
    results: Drawings,
) -> None:
    spec = results.figures["lines"]
    sheet = results.draw(spec)
    made = interactive(sheet, spec, results.cases)
    crosses = [line for line in sheet.figure.axes[0].lines if line.get_marker() == "x"]
    printed = [line.get_xdata().tolist() for line in crosses if line.get_xdata().size]
    marks = [trace for trace in made.data if trace.name == "none"]
    assert [list(trace.x) for trace in marks] == printed != []
    # Below every value, and once in the legend.
    every = np.concatenate([shown.values["crossing_time"] for shown in sheet.shown])
    assert all(y < np.nanmin(every) for trace in marks for y in trace.y)
    assert [trace.showlegend for trace in marks] == [True, *[False] * (len(marks) - 1)]
    assert marks[0].text[0].endswith(": none")


def test_maps_are_the_printed_ones(results: Drawings) -> None:
    for name in ("flat", "round"):
        spec = results.figures[name]
        sheet = results.draw(spec)
        made = interactive(sheet, spec, results.cases)
        printed = [shown.values["crossing_time"] for shown in sheet.shown]
        assert np.isfinite(np.concatenate([values.ravel() for values in printed])).any()
        clouds = [trace for trace in made.data if trace.type == "heatmap" or trace.text is not None]
        if name == "flat":
            for trace, values in zip(clouds, printed, strict=True):
                np.testing.assert_array_equal(np.asarray(trace.z, dtype=float), values)
            continue
        for shown, values in zip(sheet.shown, printed, strict=True):
            there = np.isfinite(values)
            coloured, grey = clouds.pop(0), clouds.pop(0)
            np.testing.assert_array_equal(coloured.marker.color, values[there])
            assert grey.marker.color == GAP
            assert set(grey.text) == {"none"}
            for trace, part in ((coloured, there), (grey, ~there)):
                for letter, axis in zip("xyz", (1, 2, 3), strict=True):
                    at = shown.values[f"G.x{axis}/|G|"][part]
                    np.testing.assert_array_equal(trace[letter], at)
        assert not clouds


def test_scales_are_the_printed_ones(results: Drawings) -> None:
    """T and G^2 fall by more than a decade; D/2T changes its sign."""
    spec = results.figures["bounds"]
    made = interactive(results.draw(spec), spec, results.cases)
    axes = [made.layout[f"yaxis{i}"] for i in ("", 2, 3)]
    assert [axis.type for axis in axes] == ["log", "log", "linear"]
    assert [axis.title.text for axis in axes] == ["T [–]", "G^2 [–]", "D/2T [–]"]


def test_styles_are_the_printed_ones(results: Drawings) -> None:
    spec = results.figures["bounds"]
    sheet = results.draw(spec)
    made = interactive(sheet, spec, results.cases)
    lines = {(trace.line.color, trace.line.dash) for trace in made.data if trace.mode == "lines"}
    assert lines == {(COLOURS["green"], "dot")}
    printed = [axes.lines[0] for axes in sheet.figure.axes]
    assert {line.get_color() for line in printed} == {COLOURS["green"]}
    spec = results.figures["own"]
    space = interactive(results.draw(spec), spec, results.cases)
    (curve,) = [trace for trace in space.data if trace.customdata is not None]
    assert curve.line.color == COLOURS["orange"]


def test_the_pointer_tells_time_invariants_and_axis(results: Drawings) -> None:
    spec = results.figures["space"]
    made = interactive(results.draw(spec), spec, results.cases)
    trace = next(trace for trace in made.data if trace.customdata is not None)
    motion = motion_from(results.cases["fig4"], "fig4")
    expected = ["time", "G", "T", "D"]
    for i, name in enumerate(expected):
        assert f"{name} = %{{customdata[{i}]" in trace.hovertemplate
        np.testing.assert_array_equal(trace.customdata[:, i].astype(float), motion[name])
    assert trace.customdata[0, 4] == "x1"
    assert trace.customdata[-1, 4] == "x3"
    (mark,) = [trace for trace in made.data if trace.name == "D = 0"]
    assert mark.text[0].startswith("crossing of D = 0 at τ = 305.3589")


@pytest.fixture(scope="module")
def folder(results: Drawings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of all figures, each with its turning form beside it."""
    out = tmp_path_factory.mktemp("figures")
    rendered = []
    for name, spec in results.figures.items():
        sheet = results.draw(spec)
        files = (out / "test" / f"{name}.png", out / "test" / f"{name}.html")
        save(sheet, files[0], about=spec["caption"])
        write_interactive(sheet, spec, results.cases, files[1], name)
        rendered.append(DrawnFigure(name, files))
    results.write_page(out / "index.html", rendered)
    return out


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")
    with Browser() as opened:
        yield opened


def test_the_script_lies_once_beside_the_page(folder: Path) -> None:
    assert (folder / "plotly.js").stat().st_size > 1_000_000
    for path in (folder / "test").glob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert '<script src="../plotly.js">' in text
        assert "http://" not in text.replace("http://www.w3.org", "")
        assert "https://" not in text
        assert len(text) < 1_000_000


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (800, True), (390, False)])
def test_a_hodograph_turns_in_a_browser(
    browser: Browser, folder: Path, width: int, dark: bool
) -> None:
    browser.requests.clear()
    browser.open(folder / "test" / "space.html", width=width, dark=dark)
    browser.wait_for("!!document.querySelector('#figure canvas')")
    eye = "JSON.stringify(document.getElementById('figure')._fullLayout.scene.camera.eye)"
    before = browser.evaluate(eye)
    # The field of view is fixed from top to bottom: a narrow page looks from farther away.
    assert (json.loads(before)["x"] > 2) == (width == 390)
    browser.drag((width // 3, 400), (width // 2, 480))
    browser.wait_for(f"{eye} !== {before!r}")
    colour = browser.evaluate("document.getElementById('figure')._fullLayout.paper_bgcolor")
    assert colour == ("#18191c" if dark else "#ffffff")
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    assert not browser.errors
    assert all(url.startswith(("file:", "data:", "blob:")) for url in browser.requests)


def test_series_zoom_in_a_browser(browser: Browser, folder: Path) -> None:
    browser.open(folder / "test" / "time.html")
    browser.wait_for("!!document.querySelector('.nsewdrag')")
    span = "document.getElementById('figure')._fullLayout.xaxis.range.map(Number)"
    low, high = browser.evaluate(span)
    browser.drag((200, 150), (400, 250))
    browser.wait_for(f"{span}[1] - {span}[0] < {(high - low) / 2}")
    assert not browser.errors
    shot = base64.b64decode(browser.send("Page.captureScreenshot")["data"])
    assert shot.startswith(b"\x89PNG")


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (800, True), (390, False)])
def test_the_page_of_all_figures_in_a_browser(
    browser: Browser, folder: Path, width: int, dark: bool
) -> None:
    """The filter filters, the columns sort, links lead to their figure; nothing comes from
    elsewhere."""
    browser.requests.clear()
    browser.open(folder / "index.html", width=width, dark=dark)
    assert browser.evaluate("document.documentElement.scrollWidth") <= width
    shown = "[...document.querySelectorAll('#index tbody tr:not([hidden])')]"
    names = f"{shown}.map((row) => row.cells[1].textContent)"
    assert browser.evaluate(names) == ALL
    browser.evaluate("document.querySelectorAll('#index th button')[1].click()")
    assert browser.evaluate(names) == sorted(ALL)
    browser.evaluate("find.value = 'BALL'; find.dispatchEvent(new Event('input'))")
    assert browser.evaluate(names) == ["ball"]
    assert browser.evaluate("document.getElementById('found').textContent") == f"1 of {len(ALL)}"
    browser.evaluate("kinds[0].click()")
    assert browser.evaluate(names) == []
    assert browser.evaluate(
        "[...document.querySelectorAll('#index a')].every((a) => document.querySelector(a.hash))"
    )
    browser.evaluate("document.querySelector('figure img').scrollIntoView()")
    browser.wait_for("document.querySelector('figure img').naturalWidth > 0")
    turning = browser.evaluate("document.querySelector('figure > a').getAttribute('href')")
    assert turning == "test/lines.html"
    assert not browser.errors
    assert all(url.startswith(("file:", "data:")) for url in browser.requests)


HEADS = """(table) => {
    const [head, ...rows] = table.querySelectorAll("tr");
    const box = table.closest(".scroll");
    // Where the box does not scroll, the page does.
    box.scrollTop = 20;
    window.scrollTo(0, box.getBoundingClientRect().top + scrollY + 20 - box.scrollTop);
    const top = Math.max(0, box.getBoundingClientRect().top);
    const cells = [...head.children].map((cell) => cell.getBoundingClientRect());
    return cells.every((cell) => cell.top >= top - 1 && cell.height > 0)
        && rows[0].getBoundingClientRect().top < cells[0].bottom;
}"""
"""Whether the head of a table is in sight while its first row has moved up behind it."""


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (1000, True), (390, False)])
def test_heads_of_tables_stay_in_sight(
    browser: Browser, folder: Path, width: int, dark: bool
) -> None:
    """That of the index, which sorts, at any width; that of the cases where there are columns."""
    browser.open(folder / "index.html", width=width, height=100, dark=dark)
    browser.evaluate("document.querySelector('.index').style.maxHeight = '6rem'")
    assert browser.evaluate(f"({HEADS})(document.querySelector('.index table'))")
    box = "document.querySelector('.index')"
    assert browser.evaluate(f"{box}.scrollWidth <= {box}.clientWidth")
    if width > 390:
        tables = "[...document.querySelectorAll('main section > .scroll table')]"
        assert browser.evaluate(f"({HEADS})({tables}.at(-1))")
