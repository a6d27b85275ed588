"""The page of all figures: what it shows, that it runs nothing of strangers', and one file to
send."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from conftest import call

pytest_plugins = ("browser",)

CONFIG = """
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
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the page of a paper and of another case file, which comes before it."""
    folder = tmp_path_factory.mktemp("drawn")
    for name, title, more in (("alpha", "A", ""), ("paper", BAD, CLAIMS)):
        (folder / f"{name}.yaml").write_text(CONFIG.format(title=title, more=more))
    for command in (["run", "--quiet"], ["classify"], ["claims"]):
        files = ["alpha.yaml", "paper.yaml"][command == ["claims"] :]
        done = call(folder, *command, *files)
        assert done.returncode == 0, done.stderr
    formats = ("--format", "png", "--format", "html")
    done = call(folder, "plot", "alpha.yaml", "paper.yaml", *formats, "--alone", "alone.html")
    assert done.returncode == 1, done.stderr
    assert done.stderr.count("unknown variable 'qq'") == 1
    return folder


def test_a_page_shows_all_and_links_both_ways(folder: Path) -> None:
    figures = folder / "runs/figures"
    page = Tags(figures / "index.html")
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len({*ids})
    assert {"paper", "paper/space", "paper/both", "paper/claims/once", "paper/errata/sign"} <= {
        *ids
    }
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


def test_a_page_asks_no_network_and_runs_nothing_that_files_say(folder: Path) -> None:
    for file in (folder / "runs/figures/index.html", folder / "runs/figures/paper/space.html"):
        page = Tags(file)
        assert "alert(&#34;&amp;&#34;)" in page.text or "alert(&quot;&amp;&quot;)" in page.text
        assert "<script>alert" not in page.text
        assert "http" not in page.text
        assert not page.of("link")
    assert {image["loading"] for image in Tags(folder / "runs/figures/index.html").of("img")} == {
        "lazy"
    }


def test_one_file_can_be_sent_alone(folder: Path) -> None:
    page = Tags(folder / "alone.html")
    assert all(image["src"].startswith("data:image/png;base64,") for image in page.of("img"))
    assert len(page.of("img")) == 6
    assert all(attributes["href"].startswith("#") for attributes in page.of("a"))


def test_a_page_leaves_out_what_it_cannot_read(folder: Path, tmp_path: Path) -> None:
    out = folder / "runs/figures"
    for name, record in (
        ("odd", "[]"), ("older", '{"space.png": {}}'),
        ("gone", json.dumps({"result": "../gone.h5", "figures": {}})),
    ):  # fmt: skip
        (out / name).mkdir(exist_ok=True)
        (out / name / "drawn.json").write_text(record)
    (folder / "runs/alpha.h5").touch()
    done = call(folder, "plot", "alpha.yaml")
    assert "figures are kept" in done.stderr
    page = Tags(out / "index.html")
    assert {"paper", "alpha"} <= {a["id"] for _, a in page.tags if "id" in a}
    assert "gone" not in page.text


# In a browser


@pytest.mark.parametrize(("width", "dark"), [(1300, False), (390, True)])
def test_a_reader_finds_and_unfolds(reader: Any, folder: Path, width: int, dark: bool) -> None:
    opened = reader(folder / "runs/figures/index.html", width, dark=dark)
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


def test_a_checker_has_nothing_serious_against_the_page(reader: Any, folder: Path) -> None:
    from axe_playwright_python.sync_playwright import Axe

    for name in ("index.html", "paper/space.html"):
        opened = reader(folder / "runs/figures" / name)
        found = Axe().run(opened.page).response["violations"]
        serious = [x["id"] for x in found if x["impact"] in ("serious", "critical")]
        assert not serious, (name, serious)


def test_a_search_leaves_no_heading_without_what_it_found(reader: Any, folder: Path) -> None:
    page = reader(folder / "runs/figures/index.html").page
    page.fill("#find", "reprint")
    assert [x.text_content() for x in page.locator("h3").all() if x.is_visible()] == ["Errata"]
    page.fill("#find", "nowhere")
    assert not any(x.is_visible() for x in page.locator("h2, h3, table").all())


def test_what_does_not_turn_is_not_said_to(folder: Path) -> None:
    text = (folder / "runs/figures/index.html").read_text("utf-8")
    assert re.findall(r'paper/([a-z-]+)\.html">(\w+)<', text) == [
        ("space", "turn"), ("space-wide", "turn"), ("both", "HTML"),
    ]  # fmt: skip
