"""One page with every figure, statement and number of the configs that were drawn into a folder:
HTML that opens from disk and asks no network for anything."""

import json
import math
import os
import re
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from ..cases.case import Case
from ..cases.claim_block import cases_of
from ..cases.config import Config
from ..cases.figure_block import PIECE, DrawnFigure
from ..models.rigid_body import LABELS
from ..results.dataset import StoredCases, motion_from
from ..results.motion import Motion
from ..results.resolution import OF_SAMPLES, coarse_curves
from ..storage.staging import replacing
from ..sweeps.swept import ANGLES, round_degrees
from ..text import magnitude, seconds

PICTURES = (".png", ".svg")

WIDE = 1400
"""Pixels of a picture, at 300 an inch, from which on it takes both columns of the page."""

Entry = dict[str, str]
"""A line of the index: what it is, its name, link, text and verdict."""


@dataclass(frozen=True)
class PageResult:
    """What the page shows of one result: its cases, its config, and the figures just drawn."""

    cases: StoredCases
    config: Config
    figures: Sequence[DrawnFigure]


def write_page(path: Path, results: Sequence[PageResult]) -> None:
    """Write the page at `path` anew: the figures just drawn, and those of other configs that were
    drawn into the same folder before.

    Links are relative to the page. Raises HodoError for a damaged result file, or if a file cannot
    be written.
    """
    for result in results:
        with replacing(path.parent / result.cases.path.stem / PIECE) as draft:
            draft.write_text(json.dumps(_piece(result, path.parent)), encoding="utf-8")
    pieces = [*_pieces(path.parent)]
    entries = [entry for piece in pieces for entry in piece["entries"]]
    page = template("page.html").substitute(
        style=template("page.css").template,
        script=template("page.js").template,
        summary=escape(index_totals(entries)),
        contents="".join(f"<li>{piece['link']}</li>" for piece in pieces),
        rows="".join(map(_index_row, entries)),
        sections="".join(piece["section"] for piece in pieces),
    )
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def template(name: str) -> Template:
    """A file that lies beside this module, with $names to fill in."""
    return Template((Path(__file__).parent / name).read_text(encoding="utf-8"))


def index_totals(entries: Iterable[Entry]) -> str:
    """How many figures, statements and errata there are, and with which verdicts."""
    kinds: dict[str, Counter[str]] = {}
    for entry in entries:
        kinds.setdefault(entry["kind"], Counter())[entry["verdict"]] += 1
    parts = []
    for kind, verdicts in kinds.items():
        named = ", ".join(f"{n} {verdict}" for verdict, n in verdicts.most_common() if verdict)
        plural = {"erratum": "errata"}.get(kind, f"{kind}s")
        count = verdicts.total()
        parts.append(f"{count} {kind if count == 1 else plural}{f' ({named})' if named else ''}")
    return "; ".join(parts)


def _pieces(folder: Path) -> Iterator[dict[str, Any]]:
    """What the folders of results tell the page; one that is damaged is drawn anew some time."""
    for file in sorted(folder.glob(f"*/{PIECE}")):
        # Nor does a parser of HTML promise anything about what is none.
        with suppress(ValueError, TypeError, AssertionError, RecursionError):
            piece = json.loads(file.read_text(encoding="utf-8"))
            if isinstance(piece, dict) and piece.keys() >= {"section", "entries", "link"}:
                entries = [
                    {key: str(entry[key]) for key in ENTRY_KEYS}
                    for entry in piece["entries"]
                    if isinstance(entry, dict) and entry.keys() >= set(ENTRY_KEYS)
                ]
                markup = {key: Markup.checked(str(piece[key])) for key in ("section", "link")}
                yield {**markup, "entries": entries}


ENTRY_KEYS = ("kind", "name", "link", "text", "verdict", "run")
"""What each entry of the index has."""


class Markup(HTMLParser):
    """What a folder says of itself, rebuilt from the tags, attributes and links inside the folder
    that this module writes. The folder may be a stranger's: all else is text, or gone."""

    BLOCKS = frozenset(
        {"details", "div", "figcaption", "figure", "h2", "h3", "p", "section", "summary"}
    )
    TABLES = frozenset({"table", "tbody", "td", "th", "thead", "tr"})
    EMPTY = frozenset({"br", "img"})
    TAGS = BLOCKS | TABLES | EMPTY | {"a", "b", "i"}
    ATTRIBUTES = frozenset(
        {"alt", "class", "data-of", "height", "href", "id", "loading", "src", "width"}
    )
    LINK = re.compile(r"(?!//)[\w.~/%#-]*", re.ASCII)
    """A relative address as `quote` writes it: without a colon it has no scheme."""

    def __init__(self) -> None:
        super().__init__()
        self._made: list[str] = []

    @classmethod
    def checked(cls, text: str) -> str:
        """HTML without anything that would run, or fetch from elsewhere."""
        parser = cls()
        parser.feed(text)
        parser.close()
        return "".join(parser._made)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        kept = "".join(
            f' {name}="{escape(value or "")}"'
            for name, value in attrs
            if name in self.ATTRIBUTES
            and (name not in ("href", "src") or self.LINK.fullmatch(value or ""))
        )
        self._made += [f"<{tag}{kept}>"] if tag in self.TAGS else []

    def handle_endtag(self, tag: str) -> None:
        self._made += [f"</{tag}>"] if tag in self.TAGS - self.EMPTY else []

    def handle_data(self, data: str) -> None:
        self._made.append(escape(data))


def _piece(result: PageResult, base: Path) -> dict[str, Any]:
    """The section of one result file, and its entries in the index."""
    cases, config = result.cases, result.config
    motions = {name: motion_from(cases[name], name) for name in cases}
    places = Anchors(result)
    title = escape(config.title or cases.path.name)
    cards = "".join(
        _card(figure, config.figures[figure.name], motions, base, places)
        for figure in result.figures
    )
    table = _table(CASE_HEADER, [_case_row(motion) for motion in motions.values()])
    section = (
        f'<section id="{places.run}"><h2>{title}</h2>'
        f"<p>{escape(config.references)}</p>"
        f'<p class="soft">Data: {_link(cases.path, base)}, {_counted(motions)}</p>'
        f'<div class="figures">{cards}</div>{_claims(cases, places)}{_errata(cases, places)}'
        f"{_crossings(motions, places)}<h3>Cases</h3>{table}</section>"
    )
    figures = [
        {
            "kind": "figure",
            "name": figure.name,
            "link": places.figure(figure.name),
            "text": config.figures[figure.name]["caption"],
            "verdict": "not drawn" if figure.problem else "",
        }
        for figure in result.figures
    ]
    judged = [*_judged(cases, places, "_claims"), *_judged(cases, places, "_errata")]
    entries = [{**entry, "run": places.run} for entry in [*figures, *judged]]
    return {
        "section": section,
        "entries": entries,
        "link": f'<a href="#{places.run}">{title}</a>',
    }


class Anchors:
    """The anchors of one result file in the page, and what is linked to what."""

    def __init__(self, result: PageResult) -> None:
        cases, config = result.cases, result.config
        self.run = escape(quote(cases.path.stem))
        self._shown: dict[str, list[str]] = {}
        for figure in result.figures:
            for case in config.figures[figure.name].get("cases", ()):
                self._shown.setdefault(case, []).append(figure.name)
        self._judged: dict[tuple[str, str], Sequence[str]] = {}
        claims = {claim["id"]: cases_of(claim) for claim in config.claims}
        errata = {erratum["id"]: erratum["cases"] for erratum in config.errata}
        for kind, group, about in (("claim", "_claims", claims), ("erratum", "_errata", errata)):
            # Only what `hodo claims` has judged stands in the page.
            stored = cases[group].variables["claim"].data if group in cases else ()
            self._judged |= {(kind, name): about[name] for name in about if name in stored}

    def figure(self, name: str) -> str:
        """The anchor of a figure."""
        return f"{self.run}-{escape(quote(name))}"

    def statement(self, kind: str, name: str) -> str:
        """The anchor of a statement ("claim") or an erratum."""
        return f"{self.run}-{kind}-{escape(quote(name))}"

    def crossings(self, case: str) -> str:
        """The anchor of the crossings of a case."""
        return f"{self.run}-crossings-{escape(quote(case))}"

    def figures_of(self, cases: Iterable[str]) -> str:
        """Links to the figures that show one of the cases."""
        names = dict.fromkeys(name for case in cases for name in self._shown.get(case, ()))
        return " ".join(f'<a href="#{self.figure(name)}">{escape(name)}</a>' for name in names)

    def figures_about(self, kind: str, name: str) -> str:
        """Links to the figures that show what a statement or an erratum is about."""
        return self.figures_of(self._judged.get((kind, name), ()))

    def statements_about(self, cases: Iterable[str]) -> str:
        """Links to the statements and errata about one of the cases."""
        wanted = set(cases)
        return " ".join(
            f'<a href="#{self.statement(kind, name)}">{escape(name)}</a>'
            for (kind, name), about in self._judged.items()
            if wanted & set(about)
        )


def _judged(cases: StoredCases, places: Anchors, group: str) -> list[Entry]:
    """The entries of the index for the stored statements or errata; none before `hodo claims`."""
    if group not in cases:
        return []
    stored, claims = cases[group].variables, group == "_claims"
    kind, text = ("claim", "statement") if claims else ("erratum", "printed")
    columns = (map(str, stored[name].data) for name in ("claim", text, "verdict"))
    return [
        {
            "kind": "statement" if claims else "erratum",
            "name": name,
            "link": places.statement(kind, name),
            "text": words,
            "verdict": verdict,
        }
        for name, words, verdict in zip(*columns, strict=True)
    ]


def _index_row(entry: Entry) -> str:
    cells = [
        _cell(entry["kind"]),
        f'<td class=n><a href="#{escape(entry["link"])}">{escape(entry["name"])}</a></td>',
        _cell(entry["run"], "n"),
        _cell(entry["verdict"], "n"),
        _cell(entry["text"], "text"),
    ]
    return f'<tr data-kind="{escape(entry["kind"])}">{"".join(cells)}</tr>'


def _link(target: Path, base: Path, text: str = "") -> str:
    """A link relative to the folder of the page."""
    return f'<a href="{quote(os.path.relpath(target, base))}">{escape(text or target.name)}</a>'


def _card(
    figure: DrawnFigure, spec: Mapping[str, Any], motions: Mapping[str, Motion], base: Path,
    places: Anchors,
) -> str:  # fmt: skip
    """A figure with its caption, its files, and the cases that it shows."""
    shown = [motions[name] for name in spec.get("cases", ()) if name in motions]
    files = " ".join(_link(file, base, LINK_NAMES.get(file.suffix, file.suffix[1:].upper()))
                     for file in figure.files)  # fmt: skip
    taken = dict.fromkeys(f"{key}: {text}" for m in shown for key, text in m.case.assumes.items())
    assumed = f'<p class="soft">Assumed: {escape("; ".join(taken))}</p>' if taken else ""
    about = places.statements_about(spec.get("cases", ()))
    linked = f"<p class=soft>Statements: {about}</p>" if about else ""
    picture, wide = _picture(figure, base, described(spec, shown))
    singles = [motion for motion in shown if motion.sampled and not motion.case.sweep]
    remarks = coarse_curves(spec, singles) if spec["kind"] in OF_SAMPLES else []
    caption = " ".join(filter(None, [spec["caption"], *remarks]))
    return (
        f'<figure id="{places.figure(figure.name)}"{" class=wide" if wide else ""}>{picture}'
        f"<figcaption><b>{escape(figure.name)}</b> {escape(caption)}{assumed}"
        f'<p class="soft">{files}</p>{linked}{_card_numbers(shown, places)}</figcaption></figure>'
    )


LINK_NAMES = {".html": "turn and zoom"}
"""What the link to a file is called, where it is not its format."""


def _card_numbers(shown: Sequence[Motion], places: Anchors) -> str:
    """The cases of a figure with their parameters, errors, and links to their crossings."""
    if not shown:
        return ""
    rows = []
    for motion in shown:
        name = _cell(motion.name)
        if motion.classified and motion.crossings:
            link = places.crossings(motion.name)
            name = f'<td><a href="#{link}">{escape(motion.name)}</a></td>'
        rows.append([name, *_numbers(motion)])
    table = _table(CARD_HEADER, rows)
    return f"<details><summary>{_summary(shown)}</summary>{table}</details>"


KINDS_IN_WORDS = {
    "hodograph": "Hodograph of the angular momentum in body axes",
    "sphere": "Curves of the direction of angular momentum on the unit sphere",
    "quadrants": "Squares of two angular velocities, with the regions of both enclosed axes",
    "quadrant-sketch": "Sketch of the regions of both enclosed axes",
    "series": "Curves over time",
    "phase": "One variable against another",
    "invariants": "Energy, squared momentum and D/2T over time, within their bounds",
    "map": "Map of a sweep",
    "curve": "Curves of a sweep",
    "order": "Distance of averaging from full motions against the small parameter",
    "cost": "Steps and run time against the small parameter",
    "share": "Share of starts that have crossed the separatrix, over time",
}
"""What each kind of figure shows, for a reader who cannot see it."""


def described(spec: Mapping[str, Any], shown: Sequence[Motion]) -> str:
    """What a picture shows, in words: its kind, variables, cases and crossings."""
    parts = [KINDS_IN_WORDS[spec["kind"]]]
    if names := spec.get("variables") or spec.get("variable"):
        parts.append(names if isinstance(names, str) else ", ".join(names))
    if spec["kind"] == "phase":
        parts.append(f"{spec['y']} over {spec['x']}")
    if spec.get("cases"):
        parts.append(f"case{'s' * (len(spec['cases']) > 1)} {', '.join(spec['cases'])}")
    for motion in shown if len(shown) == 1 else ():
        if motion.classified and motion.labels.size:
            ends = [LABELS[int(motion.labels[i])] for i in (0, -1)]
            count = len(motion.crossings)
            parts.append(
                f"encloses {ends[0]} first and {ends[1]} last, with {count} "
                f"crossing{'s' * (count != 1)} of the separatrix"
            )
    return "; ".join(parts)


def _picture(figure: DrawnFigure, base: Path, alt: str) -> tuple[str, bool]:
    """The image, loaded as it comes into view, and whether it is broad; in place of it the reason
    why there is none."""
    if figure.problem:
        return f'<p class="problem">Not drawn: {escape(figure.problem)}</p>', False
    pictures = [file for file in figure.files if file.suffix in PICTURES]
    if not pictures:
        return "", False
    source = quote(os.path.relpath(pictures[0], base))
    width, height = _size(pictures[0])
    # Printed at 300 an inch, shown at 150; with its size the page does not jump as pictures load.
    size = f' width="{width // 2}" height="{height // 2}"' if width else ""
    image = f'<img loading="lazy" alt="{escape(alt)}" src="{source}"{size}>'
    turning = [file for file in figure.files if file.suffix == ".html"]
    target = quote(os.path.relpath(turning[0], base)) if turning else source
    return f'<a href="{target}">{image}</a>', width > WIDE


def _size(picture: Path) -> tuple[int, int]:
    """Width and height of a PNG, in pixels; zeros for another format."""
    if picture.suffix != ".png":
        return 0, 0
    # The first chunk of every PNG begins with its size, so that no library has to decode it.
    with open(picture, "rb") as file:
        width, height = struct.unpack(">II", file.read(24)[16:])
    return int(width), int(height)


def _counted(motions: Sized) -> str:
    return "1 case" if len(motions) == 1 else f"{len(motions)} cases"


def _summary(motions: Sequence[Motion]) -> str:
    """The largest error and the sum of run times of some cases, in one line."""
    error = max(
        (e for motion in motions if not math.isnan(e := float(motion.attrs["error"]))),
        default=math.nan,
    )
    total = sum(float(motion.attrs["run_time"]) for motion in motions)
    count = _counted(motions)
    return f"{count}: error {magnitude(error)}, run time {seconds(total)}"


CARD_HEADER = ("case", "parameters", "error", "run time")
CASE_HEADER = (
    "case",
    "model",
    "method",
    "steps",
    "error",
    "run time",
    "parameters",
    "notes and warnings",
)
CLAIM_HEADER = (
    "where",
    "statement",
    "verdict",
    "decided by",
    "contradicted by",
    "reason, measured, notes",
    "figures",
)
ERRATUM_HEADER = ("where", "printed", "should be", "verdict", "shown by", "figures")
CROSSING_HEADER = ("case", "start", "end", "crossing time", "error", "from", "to", "|G|", "figures")


def _numbers(motion: Motion) -> list[str]:
    """The cells of parameters, error and run time."""
    attrs = motion.attrs
    return [
        _cell(parameters(motion.case), "text"),
        _cell(f"{magnitude(float(attrs['error']))} ({attrs['error_kind']})", "n"),
        _cell(seconds(float(attrs["run_time"])), "n"),
    ]


def _case_row(motion: Motion) -> list[str]:
    attrs = motion.attrs
    given, error, run_time = _numbers(motion)
    ended = "" if attrs["status"] == "ok" else f"{attrs['status']}: {attrs['message']}"
    assumed = [f"assumed {key}: {text}" for key, text in motion.case.assumes.items()]
    notes = [ended, *assumed, motion.case.note, *str(attrs["warnings"]).splitlines()]
    return [
        _cell(motion.name, "n"),
        _cell(f"{attrs['model']}, {attrs['form']}", "n"),
        _cell(str(attrs["method"])),
        _cell(str(attrs["steps"])),
        error,
        run_time,
        given,
        _cell("; ".join(filter(None, notes)), "text"),
    ]


def _claims(cases: StoredCases, places: Anchors) -> str:
    """The table of statements with their verdicts; none before `hodo claims`."""
    if "_claims" not in cases:
        return ""
    claims = cases["_claims"].variables
    names = ("claim", "where", "statement", "original", "verdict", "evidence", "contradicted_by")
    # Verdicts of an earlier version have fewer texts.
    without = [""] * len(claims["claim"].data)
    columns = [
        map(str, claims[name].data if name in claims else without)
        for name in (*names, "theorem", "measured", "note")
    ]
    rows = [
        [
            f'<td id="{places.statement("claim", name)}">{escape(where)}</td>',
            f"<td class=text>{escape(statement)}{_in_its_words(original)}</td>",
            _cell(verdict),
            _cell(evidence, "text"),
            _cell(other, "text"),
            _cell("; ".join(filter(None, remarks)), "text"),
            f"<td>{places.figures_about('claim', name)}</td>",
        ]
        for name, where, statement, original, verdict, evidence, other, *remarks in zip(
            *columns, strict=True
        )
    ]
    return f"<h3>What the text says</h3>{_table(CLAIM_HEADER, rows)}"


def _in_its_words(original: str) -> str:
    """A statement as the text has it; nothing where the case file does not quote it."""
    return f"<br><i>{escape(original)}</i>" if original else ""


def _errata(cases: StoredCases, places: Anchors) -> str:
    """The table of misprints; none without any."""
    if "_errata" not in cases:
        return ""
    errata = cases["_errata"].variables
    names = ("claim", "where", "printed", "should_be", "verdict", "evidence")
    columns = [map(str, errata[name].data) for name in names]
    rows = [
        [
            f'<td id="{places.statement("erratum", name)}">{escape(where)}</td>',
            *(_cell(text, "text" if len(text) > 30 else "") for text in texts),
            f"<td>{places.figures_about('erratum', name)}</td>",
        ]
        for name, where, *texts in zip(*columns, strict=True)
    ]
    return f"<h3>Errata</h3>{_table(ERRATUM_HEADER, rows)}"


def _crossings(motions: Mapping[str, Motion], places: Anchors) -> str:
    """The table of separatrix crossings, with the enclosed axis at start and end; none without
    classified cases."""
    classified = [motion for motion in motions.values() if motion.classified and motion.labels.size]
    rows = [row for motion in classified for row in _crossing_rows(motion, places)]
    heading = "<h3>Enclosed axes and crossings of the separatrix</h3>"
    return f"{heading}{_table(CROSSING_HEADER, rows)}" if rows else ""


def _crossing_rows(motion: Motion, places: Anchors) -> list[list[str]]:
    anchor = f'<td class=n id="{places.crossings(motion.name)}">{escape(motion.name)}</td>'
    ends = [_cell(LABELS[int(motion.labels[i])]) for i in (0, -1)]
    shown = f"<td>{places.figures_of([motion.name])}</td>"
    if not motion.crossings:
        return [[anchor, *ends, _cell("none"), *[_cell("")] * 4, shown]]
    rows = [
        [
            *ends,
            _cell(f"{crossing.time:.15g}", "n"),
            _cell(magnitude(crossing.error), "n"),
            _cell(LABELS[crossing.start]),
            _cell(LABELS[crossing.end]),
            _cell(f"{crossing.momentum:.6g}"),
            shown,
        ]
        for crossing in motion.crossings
    ]
    # The anchor is that of the first; an id may stand only once.
    return [[anchor, *rows[0]], *([_cell(motion.name, "n"), *row] for row in rows[1:])]


def parameters(case: Case) -> str:
    """The data of a case in one line; what is not given is left out."""
    span = f"time {case.time.start:g} to {case.time.end:g}"
    return "; ".join(
        [*(f"{key} {_plain(value)}" for key, value in case.data.items() if value is not None), span]
    )


def _plain(value: Any, key: str = "") -> str:
    """A value as text: numbers to 12 digits, lists in brackets, mappings as key = value."""
    if isinstance(value, Mapping):
        return ", ".join(
            f"{key} = {_plain(item, key)}" for key, item in value.items() if item is not None
        )
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_plain, value))})"
    if key in ANGLES and isinstance(value, float):
        degrees = round_degrees(value)
        return f"{value:.12g}" if degrees is None else f"{degrees:g} deg"
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _cell(text: str, kind: str = "") -> str:
    return f"<td{f' class={kind}' if kind else ''}>{escape(text)}</td>"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table that scrolls by itself; the cells of its rows are HTML already."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    # On a narrow screen each cell stands on a line of its own, behind the name of its column.
    named = [
        [cell.replace("<td", f'<td data-of="{escape(name)}"', 1)
         for name, cell in zip(header, row, strict=True)]
        for row in rows
    ]  # fmt: skip
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in named)
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="scroll">{table}</div>'
