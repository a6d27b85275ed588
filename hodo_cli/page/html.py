"""Sections as HTML: the index, and of each result its figures and tables. Every text is escaped,
and every link stays within the folders."""

import math
import re
from base64 import b64encode
from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from string import Template
from urllib.parse import quote, unquote

from ..text import counted, grouped, magnitude, seconds
from .stored import Section

PICTURES = (".png", ".svg")

WIDE_PIXELS = 1400
"""Pixels of a picture, at 300 an inch, from which on it takes the width of the page."""

LINK_NAMES = {".html": "turn and zoom", ".gif": "animation (GIF)", ".mp4": "film (MP4)"}
"""The names of links to files that are no plain format of the figure."""

Cells = Sequence[str]
"""Cells of a table, as HTML."""


def page_of(sections: Sequence[Section]) -> str:
    """The page with these sections."""
    entries = [entry for section in sections for entry in index_entries(section)]
    titles = [section["title"] for section in sections]
    rest = f" and {len(titles) - 1} more" if len(titles) > 1 else ""
    return template("page.html").substitute(
        title=escape(f"Figures: {titles[0]}{rest}" if titles else "Figures"),
        style=template("page.css").template,
        script=template("page.js").template,
        summary=escape(index_totals(entries)),
        contents="".join(
            f"<li>{local_link(section['title'], section['name'])}</li>" for section in sections
        ),
        rows="".join(map(index_row, entries)),
        sections="".join(map(section_html, sections)),
    )


def template(name: str) -> Template:
    """A file that lies beside this module, with $names to fill in."""
    return Template((Path(__file__).parent / name).read_text(encoding="utf-8"))


def anchor(*names: str) -> str:
    """The id of a place in the page, by the names that lead to it."""
    # A slash is in no quoted name, so that no two places share an id.
    return "/".join(escape(quote(name, safe="")) for name in names)


def local_link(text: str, *names: str) -> str:
    """A link within the page, to the place with these names."""
    return f'<a href="#{anchor(*names)}">{escape(text)}</a>'


def address(file: str) -> str:
    """A relative link to a file; neither a scheme nor a host begins it."""
    return quote(file.lstrip("/"))


def index_entries(section: Section) -> list[dict[str, str]]:
    """The lines of the index on a section: kind, name, link, file, verdict and text."""
    run = section["name"]
    return [
        {
            "run": run,
            "kind": "figure",
            "link": local_link(figure["name"], run, figure["name"]),
            "verdict": "not drawn" if figure["problem"] else "",
            "text": figure["caption"],
        }
        for figure in section["figures"]
    ] + [
        {
            "run": run,
            "kind": kind,
            "link": local_link(entry["name"], run, kind, entry["name"]),
            "verdict": entry["verdict"],
            "text": entry["text"],
        }
        for kind, entries in judged_by_kind(section).items()
        for entry in entries
    ]


def judged_by_kind(section: Section) -> dict[str, list[Section]]:
    """The statements and errata of a section by the words of the index."""
    return {"statement": section["statements"], "erratum": section["errata"]}


def index_totals(entries: Iterable[dict[str, str]]) -> str:
    """How many figures, statements and errata there are, and with which verdicts."""
    parts = []
    for kind, verdicts in grouped((entry["kind"], entry["verdict"]) for entry in entries).items():
        named = ", ".join(
            f"{n} {verdict}" for verdict, n in Counter(filter(None, verdicts)).most_common()
        )
        parts.append(counted(len(verdicts), kind) + (f" ({named})" if named else ""))
    return "; ".join(parts)


def index_row(entry: dict[str, str]) -> str:
    """A line of the index."""
    cells = [
        *(cell(entry["kind"]), f'<td class="n">{entry["link"]}</td>', cell(entry["run"], "n")),
        *(cell(entry["verdict"], "n"), cell(entry["text"], "text")),
    ]
    return f'<tr data-kind="{entry["kind"]}">{"".join(cells)}</tr>'


def section_html(section: Section) -> str:
    """The figures and tables of a result."""
    name, cases = section["name"], section["cases"]
    cards = "".join(card(section, figure) for figure in section["figures"])
    data = f'<a href="{address(section["file"])}">{escape(Path(section["file"]).name)}</a>'
    tables = (
        html_table(title, header, rows, section["title"])
        for title, header, rows in (
            ("What the text says", STATEMENTS, statement_rows(section)),
            ("Errata", ERRATA, erratum_rows(section)),
            ("Enclosed axes and crossings of the separatrix", CROSSINGS, crossing_rows(section)),
            ("Cases", CASE_COLUMNS, map(case_row, cases)),
        )
    )
    return (
        f'<section id="{anchor(name)}"><h2>{escape(section["title"])}</h2>'
        f"<p>{escape(section['references'])}</p>"
        f'<p class="soft">Data: {data}, {counted(len(cases), "case")}</p>'
        f'<div class="figures">{cards}</div>{"".join(tables)}'
        '<p><a href="#top">Back to the top</a></p></section>'
    )


def card(section: Section, figure: Section) -> str:
    """A figure with its caption, its files, and the cases that it shows."""
    files = " ".join(
        f'<a href="{address(file)}">{LINK_NAMES.get(suffix, suffix[1:].upper())}</a>'
        for file in figure["files"]
        for suffix in [Path(file).suffix]
    )
    assumed = f'<p class="soft">Assumed: {escape("; ".join(figure["assumed"]))}</p>'
    statements = f'<p class="soft">Statements: {links_to_statements(section, figure["cases"])}</p>'
    wide = " class=wide" if figure["size"] and figure["size"][0] > WIDE_PIXELS else ""
    return (
        f'<figure id="{anchor(section["name"], figure["name"])}"{wide}>{picture(figure)}'
        f"<figcaption><b>{escape(figure['name'])}</b> {escape(figure['caption'])}"
        f"{assumed if figure['assumed'] else ''}"
        f'<p class="soft files">{files}</p>{statements if "<a" in statements else ""}'
        f"{numbers_of_cases(section, figure)}</figcaption></figure>"
    )


def picture(figure: Section) -> str:
    """The image of a figure, loaded as it comes into view, as a link to where it turns; in place of
    it the reason why there is none."""
    if figure["problem"]:
        return f'<p class="problem">Not drawn: {escape(figure["problem"])}</p>'
    files = {Path(file).suffix: address(file) for file in figure["files"]}
    images = [files[suffix] for suffix in files if suffix in PICTURES]
    if not images:
        return ""
    # Printed at 300 an inch, shown at 150; with its size the page does not jump as pictures load.
    size = "".join(
        f' {side}="{pixels // 2}"'
        for side, pixels in zip(("width", "height"), figure["size"], strict=False)
    )
    image = f'<img loading="lazy" alt="{escape(figure["about"])}" src="{images[0]}"{size}>'
    return f'<a href="{files.get(".html", images[0])}">{image}</a>'


def numbers_of_cases(section: Section, figure: Section) -> str:
    """The cases of a figure with their parameters, errors, and links to their crossings."""
    shown = [case for case in section["cases"] if case["name"] in figure["cases"]]
    if not shown:
        return ""
    error = max((e for case in shown if not math.isnan(e := case["error"])), default=math.nan)
    total = seconds(sum(case["run_time"] for case in shown))
    # It stands for the caption of the table.
    summary = f"{counted(len(shown), 'case')}: error {magnitude(error)}, run time {total}"
    rows = []
    for case in shown:
        name = escape(case["name"])
        if case["crossings"]:
            name = local_link(case["name"], section["name"], "crossings", case["name"])
        rows.append([f"<td>{name}</td>", cell(case["parameters"], "text"), *accuracy(case)])
    numbers = bare_table(("case", "parameters", "error", "run time"), rows)
    return f"<details><summary>{summary}</summary>{numbers}</details>"


def accuracy(case: Section) -> Cells:
    """The cells of error and run time of a case."""
    return [
        cell(f"{magnitude(case['error'])} ({case['error_kind']})", "n"),
        cell(seconds(case["run_time"]), "n"),
    ]


def links_to_figures(section: Section, cases: Sequence[str]) -> str:
    """A cell with links to the figures that show one of the cases."""
    links = (
        local_link(figure["name"], section["name"], figure["name"])
        for figure in section["figures"]
        if not {*cases}.isdisjoint(figure["cases"])
    )
    return f"<td>{' '.join(links)}</td>"


def links_to_statements(section: Section, cases: Sequence[str]) -> str:
    """Links to the statements and errata about one of the cases."""
    return " ".join(
        local_link(entry["name"], section["name"], kind, entry["name"])
        for kind, entries in judged_by_kind(section).items()
        for entry in entries
        if not {*cases}.isdisjoint(entry["cases"])
    )


STATEMENTS = (
    *("where", "statement", "verdict", "decided by", "contradicted by"),
    *("reason, measured, notes", "figures"),
)
ERRATA = ("where", "printed", "should be", "verdict", "shown by", "notes", "figures")
CROSSINGS = ("case", "start", "end", "crossing time", "error", "from", "to", "|G|", "figures")
CASE_COLUMNS = (
    *("case", "model", "method", "steps", "error", "run time", "parameters"),
    "notes and warnings",
)
"""The heads of the tables."""


def statement_rows(section: Section) -> Iterable[Cells]:
    """The statements with their verdicts, and their words as the text has them."""
    for claim in section["statements"]:
        original = f"<br><i>{escape(claim['original'])}</i>" if claim["original"] else ""
        yield [
            cell(claim["where"], place=anchor(section["name"], "statement", claim["name"])),
            f'<td class="text">{escape(claim["text"])}{original}</td>',
            cell(claim["verdict"]),
            cell(claim["evidence"], "text"),
            cell(claim["contradicted_by"], "text"),
            cell("; ".join(claim["notes"]), "text"),
            links_to_figures(section, claim["cases"]),
        ]


def erratum_rows(section: Section) -> Iterable[Cells]:
    """The misprints with what shows them."""
    for erratum in section["errata"]:
        texts = (erratum[key] for key in ("text", "should_be", "verdict", "evidence"))
        yield [
            cell(erratum["where"], place=anchor(section["name"], "erratum", erratum["name"])),
            *(cell(text, "text" if len(text) > 30 else "") for text in texts),
            cell("; ".join(erratum["notes"]), "text"),
            links_to_figures(section, erratum["cases"]),
        ]


def crossing_rows(section: Section) -> Iterable[Cells]:
    """The separatrix crossings of the classified cases, with the enclosed axes at start and end."""
    for case in section["cases"]:
        if not case["ends"]:
            continue
        ends, name = [*map(cell, case["ends"])], case["name"]
        figures = links_to_figures(section, [name])
        # The anchor is that of the first; an id may stand only once.
        place = anchor(section["name"], "crossings", name)
        for crossing in case["crossings"] or [["none", "", "", "", ""]]:
            yield [cell(name, "n", place), *ends, *(cell(text, "n") for text in crossing), figures]
            place = ""


def case_row(case: Section) -> Cells:
    """A case with its model, method, accuracy, parameters and notes."""
    return [
        *(cell(case["name"], "n"), cell(case["model"], "n")),
        *(cell(case["method"]), cell(case["steps"]), *accuracy(case)),
        *(cell(case["parameters"], "text"), cell("; ".join(case["notes"]), "text")),
    ]


def cell(text: str, kind: str = "", place: str = "") -> str:
    """A cell of a table, of a class of style; `place` is its id."""
    attributes = (f' class="{kind}"' if kind else "") + (f' id="{place}"' if place else "")
    return f"<td{attributes}>{escape(text)}</td>"


def html_table(title: str, header: Sequence[str], rows: Iterable[Cells], section: str) -> str:
    """A table under its title, which is its caption too; nothing without rows. With the title of
    its section, it is told from the others of the page."""
    body = [*rows]
    return f"<h3>{title}</h3>{bare_table(header, body, title, section)}" if body else ""


def table_row(names: Sequence[str], row: Cells) -> str:
    """A row of cells, with the names of their columns: on a narrow screen each cell stands on a
    line of its own, behind the name."""
    cells = (
        html.replace("<td", f'<td data-of="{name}"', 1)
        for name, html in zip(names, row, strict=True)
    )
    return f"<tr>{''.join(cells)}</tr>"


def bare_table(
    header: Sequence[str], rows: Iterable[Cells], title: str = "", section: str = ""
) -> str:
    """A table that scrolls by itself."""
    caption = f"<caption>{title}</caption>" if title else ""
    names = [*map(escape, header)]
    head = "".join(f'<th scope="col">{name}</th>' for name in names)
    body = "".join(table_row(names, row) for row in rows)
    label = escape(f"{title}: {section}")
    region = f' role="region" tabindex="0" aria-label="{label}"' if title else ""
    inner = f"{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody>"
    return f'<div class="scroll"{region}><table>{inner}</table></div>'


KINDS_OF_IMAGES = {".png": "png", ".svg": "svg+xml"}


def with_pictures_inside(page: str, folder: Path) -> str:
    """A page whose pictures are in it, and whose links lead to nowhere else: one file to send."""

    def inside(source: re.Match[str]) -> str:
        file = folder / unquote(source[1])
        image = b64encode(file.read_bytes()).decode() if file.is_file() else ""
        return f'src="data:image/{KINDS_OF_IMAGES.get(file.suffix, "png")};base64,{image}"'

    # Only attributes match: in texts a quotation mark is escaped.
    without_files = re.sub(r'<p class="soft files">.*?</p>', "", page, flags=re.DOTALL)
    without_links = re.sub(r'<a href="[^#"][^"]*">(.*?)</a>', r"\1", without_files, flags=re.DOTALL)
    return re.sub(r'src="([^"]*)"', inside, without_links)
