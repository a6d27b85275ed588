"""The pages: of one figure, which turns or plays, and of all figures."""

import json
import re
import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest
from conftest import call
from playwright.sync_api import Browser, Page, sync_playwright

import hodo_cli as hodo

# A headless Chromium of the system's.

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        browser.close()


class Reader:
    """A page that is open, with the addresses that it has asked for and its errors."""

    def __init__(self, page: Page, path: Path) -> None:
        self.page, self.requests, self.errors = page, [], []
        page.set_default_timeout(120_000)  # beside other work
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(path.resolve().as_uri())

    def is_clean(self) -> bool:
        """Whether no error came, and nothing from elsewhere was asked for."""
        own = all(url.startswith(("file:", "data:", "blob:")) for url in self.requests)
        return own and not self.errors


@pytest.fixture
def reader(chromium: Browser) -> Iterator[type]:
    """`open_page(path, width, height, dark)`: a window on a file."""
    pages = []

    def open_page(path: Path, width: int = 1400, height: int = 900, dark: bool = False) -> Reader:
        scheme = "dark" if dark else "light"
        size = {"width": width, "height": height}
        pages.append(chromium.new_page(viewport=size, color_scheme=scheme))
        return Reader(pages[-1], path)

    yield open_page
    for page in pages:
        page.close()


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
    strokes = scene_of(folder / "space.html")["strokes"]
    marks = [x["name"] for x in strokes if x.get("kind") == "mark"]
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
    opened = reader(folder / "space.html", 400, 500)
    page = opened.page
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert not page.locator("b").count()
    first = picture(page)
    box = page.locator("canvas").bounding_box()
    x, y = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 30, steps=2)
    page.mouse.up()
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


PAPER = """
title: {title}
references: {title}
defaults: {{model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003]}}
cases:
  fig4: {{initial: {{p: 0.8, q: 0.5, r: 0.74}}, time: {{end: 400}}, note: a remark}}
  calm: {{initial: {{p: 0.8, q: 0.1, r: 0.1}}, time: {{end: 10}}, assumes: {{r0: a guess}}}}
  swept: {{initial: {{p: 0.8, q: 0.5, r: 0.74}}, time: {{end: 400}}, error: off,
          store: [crossing_time], sweep: {{damping.2: {{values: [0.003, 0.004]}}}}}}
figures:
  space: {{kind: hodograph, cases: fig4, caption: {title}}}
  space-wide: {{kind: hodograph, cases: fig4, projections: [x1x2]}}
  both: {{kind: series, cases: [fig4, calm], variables: [G]}}
  wrong: {{kind: phase, cases: fig4, x: p, y: qq}}
{more}
"""
CLAIMS = """
claims:
  - id: once
    where: page 1
    statement: there is one crossing
    cases: [fig4]
    check: {kind: crossings, least: 1, most: 1, from: x1, to: x3}
    expect: reproduced
errata:
  - id: sign
    where: eq. 2
    printed: plus
    should_be: minus
    note: so it is in the reprint
    cases: [fig4]
    check: {kind: crossings, least: 1, most: 1, from: x1, to: x3}
"""
BAD = "'<script>alert(\"&\")</script>'"


class Tags(HTMLParser):
    """The tags of a page with their attributes; every tag that is opened is closed."""

    EMPTY = ("meta", "img", "input", "br")

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self._opened: list[str] = []
        self.text = page.read_text(encoding="utf-8")
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        self._opened += [] if tag in self.EMPTY else [tag]

    def handle_endtag(self, tag: str) -> None:
        assert self._opened.pop() == tag

    def of(self, tag: str) -> list[dict[str, str]]:
        """The attributes of all tags of a name."""
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drawn of the page of a paper and of another case file, which comes before it."""
    drawn = tmp_path_factory.mktemp("drawn")
    for name, title, more in (("alpha", "A", ""), ("paper", BAD, CLAIMS)):
        (drawn / f"{name}.yaml").write_text(PAPER.format(title=title, more=more))
    for command in (["run", "--quiet"], ["classify"], ["claims"]):
        files = ["alpha.yaml", "paper.yaml"][command == ["claims"] :]
        done = call(drawn, *command, *files)
        assert done.returncode == 0, done.stderr
    formats = ("--format", "png", "--format", "html")
    done = call(drawn, "plot", "alpha.yaml", "paper.yaml", *formats, "--alone", "alone.html")
    assert done.returncode == 1, done.stderr
    assert done.stderr.count("unknown variable 'qq'") == 1
    return drawn


def test_a_page_shows_all_and_links_both_ways(drawn: Path) -> None:
    figures = drawn / "runs/figures"
    page = Tags(figures / "index.html")
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len({*ids})
    parts = ("", "/space", "/both", "/claims/once", "/errata/sign")
    assert {f"paper{part}" for part in parts} <= {*ids}
    # Papers first.
    assert ids.index("paper") < ids.index("alpha")
    links = [unquote(attributes["href"]) for attributes in page.of("a")]
    for link in links:
        known = link[1:] in ids if link.startswith("#") else (figures / link).is_file()
        assert known, link
    # From a figure to its statements, and from these to it.
    assert links.count("#paper/claims/once") == links.count("#paper/errata/sign") == 4
    assert links.count("#paper/space") == 2
    for text in ("Not drawn", "305.3589551", "r0: a guess", "so it is in the reprint",
                 "1 more of space: space-wide", "1 reproduced", "a remark"):  # fmt: skip
        assert text in page.text, text


def test_a_page_asks_no_network_and_runs_nothing_that_files_say(drawn: Path) -> None:
    for file in (drawn / "runs/figures/index.html", drawn / "runs/figures/paper/space.html"):
        page = Tags(file)
        assert "alert(&#34;&amp;&#34;)" in page.text or "alert(&quot;&amp;&quot;)" in page.text
        assert "<script>alert" not in page.text
        assert "http" not in page.text
        assert not page.of("link")
    images = Tags(drawn / "runs/figures/index.html").of("img")
    assert {image["loading"] for image in images} == {"lazy"}


def test_one_file_can_be_sent_alone(drawn: Path) -> None:
    page = Tags(drawn / "alone.html")
    assert all(image["src"].startswith("data:image/png;base64,") for image in page.of("img"))
    assert len(page.of("img")) == 6
    assert all(attributes["href"].startswith("#") for attributes in page.of("a"))


def test_a_page_leaves_out_what_it_cannot_read(drawn: Path, tmp_path: Path) -> None:
    out = drawn / "runs/figures"
    for name, record in (
        ("odd", "[]"), ("older", '{"space.png": {}}'),
        ("gone", json.dumps({"result": "../gone.h5", "figures": {}})),
    ):  # fmt: skip
        (out / name).mkdir(exist_ok=True)
        (out / name / "drawn.json").write_text(record)
    (drawn / "runs/alpha.h5").touch()
    done = call(drawn, "plot", "alpha.yaml")
    assert "figures are kept" in done.stderr
    page = Tags(out / "index.html")
    assert {"paper", "alpha"} <= {a["id"] for _, a in page.tags if "id" in a}
    assert "gone" not in page.text


@pytest.mark.parametrize(("width", "dark"), [(1300, False), (390, True)])
def test_a_reader_finds_and_unfolds(reader: Any, drawn: Path, width: int, dark: bool) -> None:
    opened = reader(drawn / "runs/figures/index.html", width, dark=dark)
    page = opened.page
    # Nothing is wider than the window, and dark is dark.
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    shown = page.evaluate("getComputedStyle(document.querySelector('.family')).backgroundColor")
    assert (shown == "rgb(34, 34, 34)") is dark
    assert not page.locator("[id='paper/space-wide']").is_visible()
    page.goto(page.url + "#paper/space-wide")
    assert page.locator("[id='paper/space-wide']").is_visible()
    page.fill("#find", "reprint")
    assert page.locator("[id='paper/errata/sign']").is_visible()
    assert not page.locator("[id='paper/space']").is_visible()
    assert re.fullmatch(r"\d+ of \d+ figures, .*cases", page.text_content("#count"))
    page.fill("#find", "")
    assert page.locator("[id='paper/space']").is_visible()
    assert opened.is_clean()


def test_a_checker_has_nothing_serious_against_the_page(reader: Any, drawn: Path) -> None:
    from axe_playwright_python.sync_playwright import Axe

    for name in ("index.html", "paper/space.html"):
        opened = reader(drawn / "runs/figures" / name)
        found = Axe().run(opened.page).response["violations"]
        serious = [x["id"] for x in found if x["impact"] in ("serious", "critical")]
        assert not serious, (name, serious)


def test_a_search_leaves_no_heading_without_what_it_found(reader: Any, drawn: Path) -> None:
    page = reader(drawn / "runs/figures/index.html").page
    page.fill("#find", "reprint")
    assert [x.text_content() for x in page.locator("h3").all() if x.is_visible()] == ["Errata"]
    page.fill("#find", "nowhere")
    assert not any(x.is_visible() for x in page.locator("h2, h3, table").all())


def test_what_does_not_turn_is_not_said_to(drawn: Path) -> None:
    text = (drawn / "runs/figures/index.html").read_text("utf-8")
    assert re.findall(r'paper/([a-z-]+)\.html">(\w+)<', text) == [
        ("space", "turn"), ("space-wide", "turn"), ("both", "HTML"),
    ]  # fmt: skip
