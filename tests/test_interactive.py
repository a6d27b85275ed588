"""Figures in pages of their own: as printed, and what is in space turns."""

import base64
import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
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


def data_in(folder: Path, name: str) -> dict[str, Any]:
    """What the page of a figure knows, its numbers by strokes."""
    text = (folder / "test" / f"{name}.html").read_text(encoding="utf-8")
    (line,) = re.findall("^const data = (.*);$", text, re.MULTILINE)
    data = json.loads(line)

    def numbers(text: str | None) -> np.ndarray | None:
        return None if text is None else np.frombuffer(base64.b64decode(text), "<f4")

    for stroke in strokes(data):
        stroke |= {key: numbers(stroke[key]) for key in ("points", "code", "time")}
        stroke["points"] = stroke["points"].reshape(-1, 3)
    return dict(data)


def strokes(data: dict[str, Any]) -> list[dict[str, Any]]:
    """All that a page draws in space."""
    return [stroke for panel in data["panels"] for stroke in panel.get("strokes", ())]


def printed(folder: Path, name: str, *columns: str) -> np.ndarray:
    """The values of a printed figure in some columns of its table, where it has them all."""
    with open(folder / "test" / f"{name}.csv", encoding="utf-8", newline="") as file:
        rows = [[row[column] for column in columns] for row in csv.DictReader(file)]
    return np.array([[*map(float, row)] for row in rows if all(row) and "nan" not in row])


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("space", ("time", "G.x1", "G.x2", "G.x3")),
        ("ball", ("time", "G.x1/|G|", "G.x2/|G|", "G.x3/|G|")),
        ("trace", ("time", "x1_space.x", "x1_space.y", "x1_space.z")),
    ],
)
def test_a_curve_is_the_printed_one_point_by_point(
    folder: Path, name: str, columns: tuple[str, ...]
) -> None:
    data = data_in(folder, name)
    curve, *others = [stroke for stroke in strokes(data) if stroke["time"] is not None]
    assert [other["name"] for other in others] == ["x3"] * (name == "trace")
    expected = printed(folder, name, *columns)
    assert len(expected) > 400
    drawn = np.column_stack([curve["time"], curve["points"]])
    np.testing.assert_allclose(drawn, expected, rtol=1e-7, atol=1e-7)


def test_colours_part_a_curve_at_its_crossing(folder: Path) -> None:
    (curve,) = [stroke for stroke in strokes(data_in(folder, "space")) if stroke["name"] == "fig4"]
    shades = [curve["colours"][int(code)] for code in curve["code"]]
    change = shades.index("#bf8200")
    assert {*shades[:change]} == {"#0072b2"}
    assert {*shades[change:]} == {"#bf8200"}
    assert curve["time"][change - 1] < 305.36 < curve["time"][change]
    (own,) = [stroke for stroke in strokes(data_in(folder, "own")) if stroke["name"] == "fig4"]
    assert own["colours"] == ["#bf8200"]


def test_marks_tell_what_they_are(folder: Path) -> None:
    marks = [stroke for stroke in strokes(data_in(folder, "space")) if stroke["look"].get("mec")]
    assert [mark["look"]["marker"] for mark in marks] == ["o", "s", "D"]
    ((words,),) = [mark["texts"] for mark in marks if mark["texts"]]
    assert words.startswith("crossing at 305.3589")
    names = {text for stroke in strokes(data_in(folder, "space")) for text in stroke["texts"]}
    assert {"G1", "G2", "G3", "0.2", "0.4"} <= names
    circles = [s for s in strokes(data_in(folder, "ball")) if len(s["points"]) == 721]
    assert len(circles) == 2


def test_a_map_of_the_sphere_is_on_the_sphere(folder: Path) -> None:
    data = data_in(folder, "round")
    clouds = [stroke for stroke in strokes(data) if stroke["look"].get("ls") == ""]
    points = np.concatenate([cloud["points"] for cloud in clouds])
    directions = printed(folder, "round", "G.x1/|G|", "G.x2/|G|", "G.x3/|G|")
    np.testing.assert_allclose(points, directions, atol=1e-7)
    texts = [text for cloud in clouds for text in cloud["texts"]]
    values = {value for (value,) in printed(folder, "round", "crossing_time")}
    assert {text for text in texts if text != "none"} == {f"{value:.6g}" for value in values}
    # The same number has the same colour in every panel, and none has the grey of gaps.
    shades = [cloud["colours"][int(code)] for cloud in clouds for code in cloud["code"]]
    assert {shade for shade, text in zip(shades, texts, strict=True) if text == "none"} == {
        "#e4e4e4"
    }
    assert len({*zip(texts, shades, strict=True)}) == len({*texts})
    assert len([stroke for stroke in strokes(data) if len(stroke["points"]) == 721]) == 4


def test_a_caption_speaks_of_the_figure_in_its_page(folder: Path) -> None:
    words = {"space": "Drag to turn", "round": "on the sphere", "time": "both scales"}
    for name, text in words.items():
        assert text in (folder / "test" / f"{name}.html").read_text(encoding="utf-8")
    # A caption that ends a script is text.
    assert "&lt;/script&gt;&lt;b&gt;&amp;" in (folder / "test" / "space.html").read_text()


def test_a_page_is_small_and_asks_no_network(folder: Path) -> None:
    for name in NAMES:
        text = (folder / "test" / f"{name}.html").read_text(encoding="utf-8")
        assert len(text) < 400_000
        assert text.count("</script>") == 1
        assert not re.search(r'(src|href)="(?!data:|#|\.\./index)', text)


SIZES = [(1400, False), (800, True), (390, False)]


PICTURES = "[...document.querySelectorAll('#figure canvas')].map((c) => c.toDataURL())"


@pytest.mark.parametrize(("width", "dark"), SIZES)
def test_a_hodograph_turns_in_a_browser(reader, folder: Path, width: int, dark: bool) -> None:
    window = reader(folder / "test" / "space.html", width, dark=dark)
    page = window.page
    pictures = [page.evaluate(PICTURES)]
    box = page.locator("#figure canvas").bounding_box()
    x, y = (int(box[at] + box[size] / 2) for at, size in (("x", "width"), ("y", "height")))
    window.drag((x, y), (x + 60, y + 40))
    pictures.append(page.evaluate(PICTURES))
    page.mouse.wheel(0, -200)
    page.wait_for_function(f"JSON.stringify({PICTURES}) !== {json.dumps(pictures[1])!r}")
    assert pictures[0] != pictures[1]
    page.mouse.dblclick(x, y)
    assert page.evaluate(PICTURES) == pictures[0]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert window.is_clean()


def test_panels_turn_where_they_are_printed(reader, folder: Path) -> None:
    """The canvas lies over the printed panel, whose scale the pointer reads beside it."""
    page = reader(folder / "test" / "near.html").page
    box = "(e) => { const { x, y, width } = e.getBoundingClientRect(); return [x, y, width]; }"
    figure = page.locator("#figure").evaluate(box)
    panels = page.locator("#figure canvas").evaluate_all(f"(all) => all.map({box})")
    data = data_in(folder, "near")
    assert [panel.get("reach") for panel in data["panels"][:2]] == [None, 0.1]
    for (x, _, width), panel in zip(panels, data["panels"], strict=False):
        assert x == pytest.approx(figure[0] + panel["box"][0] * figure[2], abs=1)
        assert width == pytest.approx(panel["box"][2] * figure[2], abs=2)


def test_the_pointer_tells_values(reader, folder: Path) -> None:
    """Of a crossing in space its time; over a plane panel its scales, over the printed tick 1."""
    window = reader(folder / "test" / "space.html")
    page, reading = window.page, "document.getElementById('reading').textContent"
    at = """(marker) => {
        const stroke = data.panels[0].strokes.find((s) => s.look.marker === marker);
        const { left, top } = document.querySelector("canvas").getBoundingClientRect();
        return [left + stroke.seen[0][0], top + stroke.seen[0][1]];
    }"""
    page.mouse.move(*page.evaluate(at, "D"))
    assert page.evaluate(reading).startswith("crossing at 305.3589")
    page.mouse.move(*page.evaluate(at, "o"))
    # The start: G = A omega.
    assert page.evaluate(reading).startswith(
        "fig4, τ = 0.00000, G1 [–] = 0.80000, G2 [–] = 0.40000"
    )
    assert window.is_clean()

    window = reader(folder / "test" / "bounds.html")
    page, panel = window.page, data_in(folder, "bounds")["panels"][0]
    assert [scale["log"] for scale in panel["scales"]] == [False, True]
    box = page.locator("#figure").bounding_box()
    left, bottom, width, height = panel["box"]
    across, up = left + 0.25 * width, bottom + 0.5 * height
    page.mouse.move(box["x"] + across * box["width"], box["y"] + (1 - up) * box["height"])
    words = dict(part.split(" = ") for part in page.evaluate(reading).split(", "))
    low, high = panel["scales"][1]["ends"]
    assert float(words["τ [–]"]) == pytest.approx(250, rel=0.01)
    assert float(words["T [–]"]) == pytest.approx(np.sqrt(low * high), rel=0.03)
    before = box["width"]
    page.evaluate("size.value = 3; size.dispatchEvent(new Event('input'))")
    assert page.locator("#figure").bounding_box()["width"] > 2 * before
    assert page.evaluate("document.documentElement.scrollWidth") <= 1400
    assert window.is_clean()


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
        "[...document.querySelectorAll('#index a')]"
        ".every((a) => document.getElementById(decodeURIComponent(a.hash.slice(1))))"
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
    for name in ("index", "test/time", "test/space"):
        page = reader(folder / f"{name}.html", dark=dark).page
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
