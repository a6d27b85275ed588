"""The page of one figure: what is in space turns, comes nearer and tells its values, and a body
plays."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import call

import hodo_cli as hodo

pytest_plugins = ("browser",)

CONFIG = """
cases:
  fig4: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003],
         initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 400, unit: s}, attitude: {align: G}}
figures:
  space: {kind: hodograph, cases: fig4, caption: "</script><b>bold</b>", colour: case}
  ball: {kind: sphere, cases: fig4}
  egg: {kind: sphere, cases: fig4, ellipsoid: yes}
  plane: {kind: phase, cases: fig4, x: p, y: q}
  moving: {kind: body, cases: fig4, span: [100, 140], seconds: 4}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    (folder / "c.yaml").write_text(CONFIG)
    for command in (["run", "--quiet"], ["classify"], ["plot", "--format", "html"]):
        done = call(folder, *command, "c.yaml")
        assert done.returncode == 0, done.stderr
    return folder / "runs/figures/c"


def scene_of(page: Path) -> dict[str, Any]:
    """What a page has to draw."""
    text = page.read_text("utf-8")
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text)
    return dict(json.loads(found[1]))


def test_a_scene_has_the_stored_motion(folder: Path) -> None:
    data = hodo.open(folder.parents[1] / "c.h5")["fig4"]
    (curve,) = [x for x in scene_of(folder / "space.html")["strokes"] if "time" in x]
    for i in range(0, data.time.size, 50):
        place = int(np.abs(np.array(curve["time"]) - data.time.data[i]).argmin())
        expected = data.omega.data[i] * [1, 0.8, 0.6]
        np.testing.assert_allclose(curve["points"][place], expected, atol=1e-5)
    marks = [
        x["name"] for x in scene_of(folder / "space.html")["strokes"] if x.get("kind") == "mark"
    ]
    assert marks == ["start", "end", f"crossing at {data.crossing_time.item():.12g}"]


def test_a_film_has_the_attitudes_and_the_faces_of_the_body(folder: Path) -> None:
    data, scene = hodo.open(folder.parents[1] / "c.h5")["fig4"], scene_of(folder / "moving.html")
    assert scene["time"][0] >= 100
    assert scene["time"][-1] <= 140
    stored = data.attitude.sel(time=120, method="nearest")
    place = int(np.abs(np.array(scene["time"]) - stored.time.item()).argmin())
    np.testing.assert_allclose(scene["attitude"][place], stored, atol=1e-5)
    faces = [np.array(x["points"]) for x in scene["strokes"] if x["kind"] == "face"]
    assert len(faces) == 6
    a = np.ptp(np.concatenate(faces), axis=0)
    # The homogeneous box with A1 : A2 : A3 = b^2 + c^2 : c^2 + a^2 : a^2 + b^2.
    A = (a * a).sum() - a * a
    np.testing.assert_allclose(A / A[0], [1, 0.8, 0.6], rtol=1e-4)


def test_pages_are_small(folder: Path) -> None:
    sizes = {file.name: file.stat().st_size for file in folder.glob("*.html")}
    assert max(sizes.values()) < 400_000, sizes


def picture(page: Any) -> str:
    """What a canvas shows: from where, and how near."""
    return str(page.evaluate("JSON.stringify([V, zoom, now])"))


def test_a_hodograph_turns_comes_nearer_and_tells_its_values(reader: Any, folder: Path) -> None:
    opened = reader(folder / "space.html", 400)
    page = opened.page
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert not page.locator("b").count()
    first = picture(page)
    box = page.locator("canvas").bounding_box()
    x, y = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.drag((x, y), (x + 60, y + 30))
    turned = picture(page)
    page.mouse.wheel(0, -200)
    page.wait_for_function("zoom > 1.4")
    nearer = picture(page)
    assert len({first, turned, nearer}) == 3
    page.locator("canvas").dblclick()
    page.wait_for_function("zoom === 1")
    assert picture(page) == first
    # Somewhere the pointer meets a mark or a curve, with time, unit and place.
    page.evaluate("""() => { const curve = seen.filter((x) => x[1].startsWith("fig4"));
      const [p] = curve[Math.floor(curve.length / 3)];
      const r = canvas.getBoundingClientRect();
      canvas.dispatchEvent(new PointerEvent("pointermove", {clientX: r.x + p[0] / devicePixelRatio,
        clientY: r.y + p[1] / devicePixelRatio})); }""")
    assert re.match(r"fig4, t = [\d.]+ s: ", page.text_content("#read"))
    assert opened.is_clean()


def test_a_body_plays_pauses_and_scrubs(reader: Any, folder: Path) -> None:
    opened = reader(folder / "moving.html")
    page = opened.page
    assert re.match(r"t = 100\.0\d+ s", page.text_content("output"))
    first = picture(page)
    page.click("button")
    page.wait_for_function("Number(document.getElementById('time').value) > 0.02")
    assert page.text_content("button") == "Pause"
    page.click("button")
    assert picture(page) != first
    page.evaluate("""() => { const t = document.getElementById("time"); t.value = 1;
      t.dispatchEvent(new Event("input")); }""")
    assert re.match(r"t = 1(40\.0|39\.9)\d+ s", page.text_content("output"))
    assert opened.is_clean()


def test_a_plane_figure_is_a_picture(reader: Any, folder: Path) -> None:
    opened = reader(folder / "plane.html")
    assert opened.page.locator("img").is_visible()
    assert not opened.page.locator("canvas").is_visible()
    assert opened.is_clean()


def test_a_notebook_shows_a_figure_by_itself_and_a_body_that_plays(folder: Path) -> None:
    data = hodo.open(folder.parents[1] / "c.h5")["fig4"]
    still, moving = hodo.plot(data), hodo.plot(data, "body", seconds=0.2)
    assert still._repr_png_().startswith(b"\x89PNG")
    assert still._repr_html_() is None
    assert moving._repr_html_().startswith("<iframe srcdoc=")
    moving.savefig(folder / "film.gif")
    assert (folder / "film.gif").read_bytes().startswith(b"GIF89")


def test_a_page_is_as_wide_as_a_telephone_and_dark_with_it(reader: Any, folder: Path) -> None:
    page = reader(folder / "space.html", 390, dark=True).page
    assert page.get_attribute("meta[name=viewport]", "content").startswith("width=device-width")
    look = page.evaluate("getComputedStyle(canvas).filter + getComputedStyle(document.body).color")
    assert look.startswith("invert(0.87)")
    assert look.endswith("rgb(255, 255, 255)")


def test_a_page_has_its_caption_and_the_legend_of_the_picture(reader: Any, folder: Path) -> None:
    page = reader(folder / "space.html").page
    assert "<b>bold</b>" in page.text_content("body")
    words = page.locator("span").all_text_contents()
    assert [x.split(maxsplit=1)[1] for x in words[:3]] == ["fig4", "start", "end, t = 400 s"]
    assert re.fullmatch(r"◇ D = 0 at t = 305\.\d+ s", words[3])
    scene, moving = scene_of(folder / "moving.html"), reader(folder / "moving.html").page
    assert [x["name"] for x in scene["strokes"] if x["kind"] == "arrow"][:3] == ["x1", "x2", "x3"]
    # The names that meet at the start stand apart.
    middles = moving.evaluate("words.map(([x, y]) => [x / devicePixelRatio, y / devicePixelRatio])")
    apart = np.abs(np.array(middles)[:, None] - np.array(middles))
    assert ((apart[..., 0] >= 20) | (apart[..., 1] >= 16) | (np.eye(8) > 0)).all()


def test_two_fingers_bring_nearer(reader: Any, folder: Path) -> None:
    page = reader(folder / "space.html").page
    before = page.evaluate("JSON.stringify(V)")
    page.evaluate("""() => { const at = (kind, pointerId, clientX) => canvas.dispatchEvent(
        new PointerEvent(kind, {pointerId, clientX, buttons: 1, pointerType: "touch"}));
      at("pointerdown", 1, 100); at("pointerdown", 2, 150); at("pointermove", 2, 200);
      at("pointerup", 1, 100); at("pointerup", 2, 200); }""")
    assert page.evaluate("[zoom, fingers.size]") == [2, 0]
    assert page.evaluate("JSON.stringify(V)") == before


def test_the_far_side_of_an_ellipsoid_is_told_by_its_normals(folder: Path) -> None:
    data = hodo.open(folder.parents[1] / "c.h5")["fig4"]
    scene = scene_of(folder / "egg.html")
    (curve,) = [x for x in scene["strokes"] if "time" in x]
    along = np.array(curve["points"]) @ scene["normal"]
    G = data.omega.data * [1, 0.8, 0.6]
    sizes = np.linalg.norm(G, axis=1), np.linalg.norm(along, axis=1)
    i = [int(np.abs(np.array(curve["time"]) - t).argmin()) for t in data.time.data[::50]]
    expected = G[::50] / sizes[0][::50, None]
    np.testing.assert_allclose(along[i] / sizes[1][i, None], expected, atol=1e-4)
