"""The page of all figures: what it shows, that it runs nothing of strangers', and one file to
send."""

import json
import re
import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from conftest import call

CONFIG = """
title: {title}
references: {title}
defaults: {{model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003]}}
cases:
  fig4: {{initial: {{p: 0.8, q: 0.5, r: 0.74}}, time: {{end: 400}}, note: a remark}}
  calm: {{initial: {{p: 0.8, q: 0.1, r: 0.1}}, time: {{end: 10}}, assumes: {{r0: a guess}}}}
figures:
  space: {{kind: hodograph, cases: fig4, caption: {title}}}
  wide: {{kind: hodograph, cases: fig4, projections: [x1x2]}}
  both: {{kind: series, cases: [fig4, calm], variables: [G]}}
  crossings-fig4: {{kind: quadrants, cases: fig4}}
  wrong: {{kind: phase, cases: fig4, x: p, y: q, style: {{log: y}}}}
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


class Reader(HTMLParser):
    """The tags of a page with their attributes; every tag that is opened is closed."""

    EMPTY = ("meta", "img", "input", "br")

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self._opened: list[str] = []
        self.text = page.read_text(encoding="utf-8")
        self.feed(self.text)
        assert not self._opened

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        self._opened += [] if tag in self.EMPTY else [tag]

    def handle_endtag(self, tag: str) -> None:
        assert self._opened.pop() == tag

    def of(self, tag: str) -> list[dict[str, str]]:
        """The attributes of all tags of a name."""
        return [attributes for name, attributes in self.tags if name == tag]


def plotted(folder: Path, **titles: str) -> Path:
    """The folder of the page of case files by their names, with these titles; a name that begins
    with paper has statements and errata."""
    for name, title in titles.items():
        more = CLAIMS if name.startswith("paper") else ""
        (folder / f"{name}.yaml").write_text(CONFIG.format(title=title, more=more))
    files = [f"{name}.yaml" for name in titles]
    judged = [file for file in files if file.startswith("paper")]
    for command in (["run", "--quiet", *files], ["classify", *files], ["claims", *judged]):
        done = call(folder, *command)
        assert done.returncode == 0, done.stderr
    done = call(folder, "plot", *files, "--format", "png", "--format", "csv")
    assert done.returncode == 1, done.stderr
    assert "reaches below zero" in done.stderr
    return folder


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page of a paper and of two other case files."""
    return plotted(tmp_path_factory.mktemp("drawn"), beta="B", alpha="A", paper=BAD)


@pytest.fixture
def place(drawn: Path, tmp_path: Path) -> Path:
    """A copy of it, to be changed."""
    return Path(shutil.copytree(drawn, tmp_path / "copy"))


def page_in(folder: Path) -> Reader:
    """The page of a folder."""
    return Reader(folder / "runs" / "figures" / "index.html")


def data_in(folder: Path, name: str) -> dict[str, Any]:
    """What a folder keeps for the page."""
    return dict(json.loads((folder / "runs" / "figures" / name / "page.json").read_text()))


def test_the_page_asks_no_network_and_escapes_what_files_say(drawn: Path) -> None:
    page = page_in(drawn)
    assert len(page.of("script")) == 1
    assert page.of("script") == [{}]
    assert not page.of("link")
    assert "http" not in page.text
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert {"paper", "paper/space", "paper/both", "paper/statement/once"} <= {*ids}
    assert "so it is in the reprint" in page.text
    images = page.of("img")
    assert [image["src"] for image in images[:3]] == [
        f"paper/{name}.png" for name in ("space", "wide", "both")
    ]
    assert {image["loading"] for image in images} == {"lazy"}
    assert images[0]["alt"] == (
        "Hodograph of the angular momentum in body axes; case fig4; "
        "encloses x1 first and x3 last, with 1 crossing of the separatrix"
    )
    for link in (attributes["href"] for attributes in page.of("a")):
        where = (
            link[1:] in ids
            if link.startswith("#")
            else (drawn / "runs" / "figures" / link).resolve().is_file()
        )
        assert where, link
    for text in (
        "Not drawn",
        "305.3589551667",
        "initial p = 0.8, q = 0.5, r = 0.74; time 0 to 400",
        "Assumed: r0: a guess",
        "a remark",
        "reproduced",
        "15 figures (3 not drawn)",
    ):
        assert text in page.text, text


def test_what_a_folder_keeps_is_data_and_no_html(drawn: Path) -> None:
    data = data_in(drawn, "paper")

    def texts(value: Any) -> Iterator[str]:
        if isinstance(value, dict | list):
            for item in value.values() if isinstance(value, dict) else value:
                yield from texts(item)
        elif isinstance(value, str):
            yield value

    assert not [text for text in texts(data) if re.search(r"</?(td|a|p|tr|div|b|i)\b", text)]
    assert data["title"] == BAD.strip("'")
    assert data["statements"][0]["verdict"] == "reproduced"


def test_papers_come_first_and_the_others_as_they_are_named(place: Path) -> None:
    assert sections_in(place) == ["paper", "beta", "alpha"]
    # What was drawn before stays, behind what is drawn now.
    assert call(place, "plot", "alpha.yaml").returncode == 1
    assert sections_in(place) == ["paper", "alpha", "beta"]


def sections_in(folder: Path) -> list[str]:
    """The results that a page shows, in their order."""
    return re.findall('<section id="([a-z0-9]+)"><h2>', page_in(folder).text)


def test_a_page_reads_well_without_eyes(drawn: Path) -> None:
    """Each table has a caption or stands under a summary, each head a scope; links lead past the
    index and back."""
    page = page_in(drawn)
    assert "<title>Figures: &lt;script&gt;" in page.text
    assert " and 2 more</title>" in page.text
    assert {head.get("scope") for head in page.of("th")} == {"col"}
    tables = len(page.of("table"))
    assert tables == len(page.of("caption")) + len(page.of("details")) > 4
    links = [link["href"] for link in page.of("a")]
    assert links[0] == "#figures"
    assert "#top" in links
    assert [span["role"] for span in page.of("span") if "role" in span] == ["status"]


def test_one_file_can_be_sent_alone(place: Path) -> None:
    done = call(place, "plot", "paper.yaml", "--alone", "sent/all.html")
    assert done.stdout.endswith("sent/all.html\n")
    page = Reader(place / "sent" / "all.html")
    pictures = [image["src"] for image in page.of("img")]
    assert len(pictures) == 12
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in pictures)
    assert all(link["href"].startswith("#") for link in page.of("a"))
    # Nor are there words of links that are none.
    assert ">CSV<" in page_in(place).text
    assert "CSV" not in re.sub("<[^>]*>", "", page.text)
    done = call(place, "plot", "paper.yaml", "space", "--alone", "all.html")
    assert done.returncode == 2
    assert "--alone" in done.stderr


def test_a_page_leaves_out_what_it_cannot_read(place: Path) -> None:
    data, folder = data_in(place, "alpha"), place / "runs" / "figures"
    (folder / "old").mkdir()
    for text in ("[]", "{", '{"title": ""}', json.dumps({**data, "figures": 1}), "[" * 100_000):
        (folder / "old" / "page.json").write_text(text)
        assert call(place, "plot", "paper.yaml").returncode == 1
        assert sections_in(place) == ["paper", "alpha", "beta"]


STRANGE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "javascript:alert(1)",
    "java\tscript:alert(1)",
    "//elsewhere/x",
    "http://elsewhere/x.png",
    "\\\\elsewhere\\x.html",
    "' onclick=alert(1) '",
)


def test_a_page_runs_nothing_that_another_folder_brings(place: Path) -> None:
    """A folder of figures may be a stranger's: each text and file name in it is an attack once."""
    own, data, folder = page_in(place), data_in(place, "paper"), place / "runs" / "figures"

    def attacked(value: Any, text: str) -> Any:
        if isinstance(value, dict):
            return {key: attacked(item, text) for key, item in value.items()}
        if isinstance(value, list):
            return [attacked(item, text) for item in value]
        return text if isinstance(value, str) else value

    for i, text in enumerate(STRANGE):
        (folder / f"old{i}").mkdir()
        file = attacked({**data, "run": f"old{i}"}, text)
        for figure in file["figures"]:
            figure["problem"] = ""
            figure["files"] = [text, f"{text}.png", f"{text}.html"]
        (folder / f"old{i}" / "page.json").write_text(json.dumps(file))
    assert call(place, "plot", "paper.yaml").returncode == 1
    page = page_in(place)
    assert page.text.count("<h2>") == 3 + len(STRANGE)
    assert {tag for tag, _ in page.tags} == {tag for tag, _ in own.tags} | {"br", "i"}
    known = {name for _, attributes in own.tags for name in attributes}
    assert {name for _, attributes in page.tags for name in attributes} <= known
    assert len(page.of("script")) == 1
    for _, attributes in page.tags:
        for name in {"href", "src"} & attributes.keys():
            address = attributes[name]
            assert not address.startswith(("//", "/", "\\"))
            assert ":" not in address


def test_results_of_one_title_are_told_apart(tmp_path: Path) -> None:
    page = page_in(plotted(tmp_path, first="One", second="One", paper="Other"))
    headings = re.findall("<h2>(.*?)</h2>", page.text)
    assert headings == ["Other", "One (first)", "One (second)"]


def test_a_page_says_what_varies_in_a_sweep(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("""
cases:
  s:
    {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003],
     initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 400},
     sweep: {damping.0: {values: [0.004, 0.005]}, damping.2: {linspace: [0.001, 0.003, 3]}}}
figures: {f: {kind: map, cases: s, variable: crossing_time, x: damping.0, y: damping.2}}
""")
    for command in ("run", "plot"):
        done = call(tmp_path, command, "s.yaml")
        assert done.returncode == 0, done.stderr
    text = (tmp_path / "runs" / "figures" / "index.html").read_text(encoding="utf-8")
    assert "2 values of damping.0; 3 values of damping.2" in text
