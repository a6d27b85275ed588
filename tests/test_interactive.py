"""Figures that turn: the values of the printed ones, in a page that a browser shows by itself."""

import base64
import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import call

pytest_plugins = ("browser",)

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
  turning:
    model: linear-diag
    inertia: [1, 0.8, 0.6]
    attitude: {align: G}
    initial: {p: 0.8, q: 0.5, r: 0.74}
    time: {end: 60}
figures:
  lines: {kind: curve, cases: grid, variable: crossing_time, x: damping.2, by: damping.0}
  flat: {kind: map, cases: grid, variable: crossing_time, x: damping.2, y: damping.0, level: 300}
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
  near: {kind: hodograph, cases: fig4, zoom: 0.1, projections: [x1x3], colour: time}
  sketch: {kind: quadrant-sketch, bodies: [[1, 0.8, 0.6]]}
  herpolhode: {kind: herpolhode, cases: turning}
  trace: {kind: axis-trace, cases: turning, axes: [x1, x3]}
"""

NAMES = re.findall(r"^  ([a-z]+): {kind", CONFIG, re.MULTILINE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of all figures, each with its values and its turning form beside it."""
    folder = tmp_path_factory.mktemp("turning")
    (folder / "test.yaml").write_text(CONFIG, encoding="utf-8")
    formats = [word for name in ("png", "csv", "html") for word in ("--format", name)]
    for command in (["run", "test.yaml", "--quiet"], ["classify", "test.yaml"]):
        assert call(folder, *command).returncode == 0
    done = call(folder, "plot", "test.yaml", *formats)
    assert done.returncode == 0, done.stderr
    return folder / "runs" / "figures"


def decoded(value: Any) -> Any:
    """A part of a figure with its arrays as plotly reads them."""
    if isinstance(value, list):
        return [decoded(item) for item in value]
    if not isinstance(value, dict):
        return value
    if "bdata" not in value:
        return {key: decoded(item) for key, item in value.items()}
    array = np.frombuffer(base64.b64decode(value["bdata"]), value["dtype"])
    shape = [*map(int, value.get("shape", "-1").split(","))]
    return array.reshape(shape)


def turned(folder: Path, name: str) -> dict[str, Any]:
    """The data and layout of a figure in its page."""
    text = (folder / "test" / f"{name}.html").read_text(encoding="utf-8")
    (line,) = [line for line in text.splitlines() if line.startswith("const figure = ")]
    return dict(decoded(json.loads(line.removeprefix("const figure = ").removesuffix(";"))))


def curves(figure: dict[str, Any], *names: str) -> list[dict[str, Any]]:
    """The traces that are curves of samples: those that the pointer finds. Those of a name."""
    traces = [t for t in figure["data"] if t["mode"].startswith("lines") and "name" in t]
    shown = [trace for trace in traces if not trace["showlegend"]]
    return [trace for trace in shown if not names or trace["name"] in names]


def points(traces: list[dict[str, Any]]) -> set[tuple[float, ...]]:
    """All points of some traces, without the gaps."""
    table = [np.stack([t[axis] for axis in "xyz" if axis in t], axis=-1) for t in traces]
    return {tuple(row) for rows in table for row in rows.tolist() if not np.isnan(row).any()}


def printed(folder: Path, name: str, *columns: str) -> set[tuple[float, ...]]:
    """The values of a printed figure in some columns of its table."""
    with open(folder / "test" / f"{name}.csv", encoding="utf-8", newline="") as file:
        rows = [[row[column] for column in columns] for row in csv.DictReader(file)]
    return {tuple(map(float, row)) for row in rows if all(row) and "nan" not in row}


@pytest.mark.parametrize("name", NAMES)
def test_plotly_knows_all_that_a_figure_says(folder: Path, name: str) -> None:
    """Its script leaves out in silence what it does not know; its Python library refuses it."""
    go.Figure(turned(folder, name))


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("space", ("G.x1", "G.x2", "G.x3")),
        ("ball", ("G.x1/|G|", "G.x2/|G|", "G.x3/|G|")),
        ("trace", ("x1_space.x", "x1_space.y", "x1_space.z")),
        ("plane", ("p", "q")),
        ("late", ("p", "time")),
        ("corner", ("p^2", "K r^2")),
        ("herpolhode", ("omega across G, 1", "omega across G, 2")),
    ],
)
def test_a_curve_is_the_printed_one_point_by_point(
    folder: Path, name: str, columns: tuple[str, ...]
) -> None:
    """The parts by enclosed axis share the sample where one ends and the next begins."""
    expected = printed(folder, name, *columns)
    assert len(expected) > 400
    drawn = points(curves(turned(folder, name), *["x1"] * (name == "trace")))
    assert drawn == expected


@pytest.mark.parametrize(
    ("name", "columns"), [("time", ("T", "D/2T", "G.x1")), ("bounds", ("T", "G2", "D/2T"))]
)
def test_panels_are_the_printed_ones_point_by_point(
    folder: Path, name: str, columns: tuple[str, ...]
) -> None:
    by_panel = curves(turned(folder, name), "fig4")
    assert len({trace["xaxis"] for trace in by_panel}) == 3
    for trace, column in zip(by_panel, columns, strict=True):
        assert points([trace]) == printed(folder, name, "time", column)


def test_colours_part_a_curve_at_its_crossing(folder: Path) -> None:
    about = curves(turned(folder, "space"))
    assert len(about) == 2
    (shared,) = points(about[:1]) & points(about[1:])
    assert shared in printed(folder, "space", "G.x1", "G.x2", "G.x3")
    # The entries of the legend stand for them.
    entries = [t for t in turned(folder, "space")["data"] if t["showlegend"]]
    groups = {entry["name"]: entry["legendgroup"] for entry in entries}
    assert [trace["legendgroup"] for trace in about] == [groups["about x1"], groups["about x3"]]


def test_bounds_regions_and_levels_are_drawn_too(folder: Path) -> None:
    """What a reader compares a curve with, where it is printed."""
    bounds = turned(folder, "bounds")["data"]
    assert sum(trace.get("fill") == "toself" for trace in bounds) == 2
    grey = [trace for trace in bounds if trace.get("line", {}).get("color") == "#666666"]
    assert len([trace for trace in grey if not trace["showlegend"]]) == 4
    (level,) = [t for t in bounds if t.get("line", {}).get("dash") == "dash" and len(t["x"]) == 2]
    np.testing.assert_allclose(level["y"], 0, atol=1e-12)
    corner = turned(folder, "corner")
    assert sum(trace.get("fill") == "toself" for trace in corner["data"]) == 2
    assert {"A (about x1)", "B (about x3)"} <= {n["text"] for n in corner["layout"]["annotations"]}
    sketch = turned(folder, "sketch")
    assert "A<br>about x1" in {note["text"] for note in sketch["layout"]["annotations"]}
    ball = [trace for trace in turned(folder, "ball")["data"] if len(trace["x"]) == 361]
    assert len(ball) == 2
    contour = [
        t for t in turned(folder, "flat")["data"] if t["mode" if "mode" in t else "type"] == "lines"
    ]
    assert contour


def test_panels_stand_where_they_are_printed(folder: Path) -> None:
    layout = turned(folder, "near")["layout"]
    main, near = (layout[name]["domain"] for name in ("scene", "scene2"))
    assert main["x"][1] < near["x"][0]
    assert (
        layout["xaxis3"]["domain"][1] < near["x"][0] or layout["yaxis3"]["domain"][1] < near["y"][0]
    )
    assert layout["scene2"]["xaxis"]["range"] == [-0.1, 0.1]
    assert layout["coloraxis"]["colorbar"]["title"]["text"] == "τ [–]"


def test_curves_of_sweeps_have_their_errors_and_gaps(folder: Path) -> None:
    figure = turned(folder, "lines")
    drawn = curves(figure, "damping.0 = 0.004", "damping.0 = 0.005")
    assert len(drawn) == 2
    assert points(drawn) == printed(folder, "lines", "damping.2", "crossing_time")
    crosses = [t for t in figure["data"] if t.get("marker", {}).get("symbol") == "x"]
    missing = [t for t in crosses if not t["showlegend"]]
    assert len(missing) == 2
    assert figure["layout"]["xaxis"]["title"]["text"] == "λ3"
    assert "<br>" in figure["layout"]["yaxis"]["title"]["text"]
    assert sum(len(t["x"]) for t in missing) == 12 - len(points(drawn))


def test_maps_are_the_printed_ones(folder: Path) -> None:
    figure = turned(folder, "flat")
    gaps, cells = [trace for trace in figure["data"] if trace.get("type") == "heatmap"]
    values = cells["z"][np.isfinite(cells["z"])]
    assert {(v,) for v in values} == printed(folder, "flat", "crossing_time")
    np.testing.assert_array_equal(np.isnan(gaps["z"]), np.isfinite(cells["z"]))
    assert cells["zmin"] == values.min()
    figure = turned(folder, "round")
    clouds = [trace for trace in figure["data"] if trace.get("text") and trace["mode"] == "markers"]
    assert points(clouds) == printed(folder, "round", "G.x1/|G|", "G.x2/|G|", "G.x3/|G|")
    texts = [text for trace in clouds for text in trace["text"]]
    values = {value for (value,) in printed(folder, "round", "crossing_time")}
    assert {text for text in texts if text != "none"} == {f"{value:.6g}" for value in values}
    # The same number has the same colour in every panel, and none has the grey of gaps.
    shades = [shade for trace in clouds for shade in trace["marker"]["color"]]
    assert {shade for shade, text in zip(shades, texts, strict=True) if text == "none"} == {
        "#e4e4e4"
    }
    assert len({*zip(texts, shades, strict=True)}) == len({*texts})
    assert len([trace for trace in figure["data"] if len(trace["x"]) == 361]) == 4


def test_scales_are_the_printed_ones(folder: Path) -> None:
    """T and G^2 fall by more than a decade; D/2T changes its sign."""
    layout = turned(folder, "bounds")["layout"]
    axes = [layout[f"yaxis{i}"] for i in ("", 2, 3)]
    assert [axis["type"] for axis in axes] == ["log", "log", "linear"]
    assert [axis["title"]["text"] for axis in axes] == ["T [–]", "G<sup>2</sup> [–]", "D/2T [–]"]


def test_styles_are_the_printed_ones(folder: Path) -> None:
    (line,) = {tuple(t["line"].items())[:2] for t in curves(turned(folder, "bounds"), "fig4")}
    assert dict(line) == {"color": "#009e73", "dash": "dot"}
    (curve,) = curves(turned(folder, "own"))
    assert curve["line"]["color"] == "#bf8200"


def test_the_pointer_tells_time_invariants_and_axis(folder: Path) -> None:
    figure = turned(folder, "space")
    first, last = curves(figure)
    for i, name in enumerate(["time", "G", "T", "D"]):
        assert f"{name} = %{{customdata[{i}]" in first["hovertemplate"]
    assert first["customdata"][0, 0] == 0
    assert last["customdata"][-1, 0] == 1000
    G = np.linalg.norm([first[axis][0] for axis in "xyz"])
    assert first["customdata"][0, 1] == pytest.approx(G)
    assert {*first["text"]} == {"x1", "x3"} or {*first["text"]} == {"x1"}
    assert {*last["text"]} == {"x3"}
    texts = [text for t in figure["data"] if t["mode"] == "markers" for text in t.get("text", ())]
    assert len(texts) == 1
    assert texts[0].startswith("crossing of D = 0 at 305.3589")


def test_a_caption_speaks_of_the_figure_in_its_page(folder: Path) -> None:
    for name, words in (("space", "Drag to turn"), ("round", "on the sphere"), ("time", "enlarge")):
        assert words in (folder / "test" / f"{name}.html").read_text(encoding="utf-8")
    # A caption that ends a script is text.
    assert "&lt;/script&gt;&lt;b&gt;&amp;" in (folder / "test" / "space.html").read_text()


def test_the_script_lies_once_beside_the_page(folder: Path) -> None:
    assert (folder / "plotly.js").stat().st_size > 1_000_000
    for path in (folder / "test").glob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert '<script src="../plotly.js">' in text
        assert "http" not in text
        assert len(text) < 1_000_000


SIZES = [(1400, False), (800, True), (390, False)]


@pytest.mark.parametrize(("width", "dark"), SIZES)
def test_a_hodograph_turns_in_a_browser(reader, folder: Path, width: int, dark: bool) -> None:
    window = reader(folder / "test" / "space.html", width, dark=dark)
    page = window.page
    page.wait_for_selector("#figure canvas")
    eye = "JSON.stringify(document.getElementById('figure')._fullLayout.scene.camera.eye)"
    before = page.evaluate(eye)
    # The field of view is fixed from top to bottom: a narrow page looks from farther away.
    assert (np.linalg.norm([*json.loads(before).values()]) > 2.5) == (width == 390)
    window.drag((width // 3, 400), (width // 2, 480))
    page.wait_for_function(f"{eye} !== {before!r}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert window.is_clean()


def test_series_enlarge_and_tell_in_a_browser(reader, folder: Path) -> None:
    window = reader(folder / "test" / "time.html")
    page = window.page
    page.wait_for_selector(".nsewdrag")
    box = page.locator(".nsewdrag").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] - 8)
    page.wait_for_selector(".hoverlayer text")
    told = " ".join(page.locator(".hoverlayer text").all_text_contents())
    assert "time = " in told
    assert "encloses x" in told
    span = "document.getElementById('figure')._fullLayout.xaxis.range.map(Number)"
    low, high = page.evaluate(span)
    x, y = int(box["x"]), int(box["y"])
    window.drag((x + 20, y + 20), (x + 120, y + 80))
    page.wait_for_function(f"{span}[1] - {span}[0] < {(high - low) / 2}")
    assert window.is_clean()


def test_no_button_sends_data_elsewhere(reader, folder: Path) -> None:
    window = reader(folder / "test" / "plane.html")
    window.page.wait_for_selector(".modebar-btn")
    titles = window.page.eval_on_selector_all(
        ".modebar-btn", "buttons => buttons.map((button) => button.dataset.title)"
    )
    assert titles
    assert not [title for title in titles if re.search("share|studio|cloud", title, re.I)]


@pytest.mark.parametrize(("width", "dark"), SIZES)
def test_the_page_of_all_figures_in_a_browser(reader, folder: Path, width: int, dark: bool) -> None:
    """The filter filters, the columns sort, links lead to their figure; nothing comes from
    elsewhere."""
    window = reader(folder / "index.html", width, dark=dark)
    page = window.page
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    rows = "[...document.querySelectorAll('#index tbody tr:not([hidden])')]"
    names = f"{rows}.map((row) => row.cells[1].textContent)"
    assert page.evaluate(names) == NAMES
    heads = "[...document.querySelectorAll('#index th')].map((head) => head.ariaSort)"
    for direction, expected in (("ascending", sorted(NAMES)), ("descending", sorted(NAMES)[::-1])):
        page.click("#index th:nth-child(2) button")
        assert page.evaluate(names) == expected
        assert page.evaluate(heads) == [None, direction, None, None, None]
    page.fill("#find", "BALL")
    assert page.evaluate(names) == ["ball"]
    status = page.get_by_role("status")
    assert status.inner_text() == f"1 of {len(NAMES)}"
    page.get_by_label("figures", exact=True).uncheck()
    assert page.evaluate(names) == []
    assert page.evaluate(
        "[...document.querySelectorAll('#index a')].every((a) => document.querySelector(a.hash))"
    )
    page.evaluate("document.querySelector('figure img').scrollIntoView()")
    page.wait_for_function("document.querySelector('figure img').naturalWidth > 0")
    turning = page.evaluate("document.querySelector('figure > a').getAttribute('href')")
    assert turning == f"test/{NAMES[0]}.html"
    assert window.is_clean()


def test_figures_stand_in_the_order_of_the_file(reader, folder: Path) -> None:
    """Row after row, whatever their widths."""
    page = reader(folder / "index.html").page
    boxes = page.evaluate(
        "[...document.querySelectorAll('figure')].map((f) => f.getBoundingClientRect())"
        ".map((box) => [Math.round(box.top), Math.round(box.left)])"
    )
    assert boxes == sorted(boxes)
    assert len({left for _, left in boxes}) == 2


def test_the_keyboard_passes_the_index(reader, folder: Path) -> None:
    page = reader(folder / "index.html").page
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the figures"
    page.keyboard.press("Enter")
    assert page.evaluate("location.hash") == "#figures"


@pytest.mark.parametrize("dark", [False, True])
def test_a_checker_has_nothing_serious_against_the_pages(reader, folder: Path, dark: bool) -> None:
    for path in (folder / "index.html", folder / "test" / "time.html"):
        page = reader(path, dark=dark).page
        page.wait_for_load_state("load")
        faults = Axe().run(page).response["violations"]
        serious = [
            (fault["id"], [node["html"] for node in fault["nodes"]])
            for fault in faults
            if fault["impact"] in ("serious", "critical")
        ]
        assert not serious


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
def test_heads_of_tables_stay_in_sight(reader, folder: Path, width: int, dark: bool) -> None:
    """That of the index, which sorts, at any width; that of the cases where there are columns."""
    page = reader(folder / "index.html", width, 100, dark).page
    page.evaluate("document.querySelector('.index').style.maxHeight = '6rem'")
    assert page.evaluate(f"({HEADS})(document.querySelector('.index table'))")
    box = "document.querySelector('.index')"
    assert page.evaluate(f"{box}.scrollWidth <= {box}.clientWidth")
    if width > 390:
        tables = "[...document.querySelectorAll('main section > .scroll table')]"
        assert page.evaluate(f"({HEADS})({tables}.at(-1))")
