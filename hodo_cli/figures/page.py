"""One page with every figure and the numbers behind it: self-contained HTML that opens from
disk."""

import base64
import math
import os
import struct
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from ..cases.case import Case
from ..models.rigid_body import LABELS
from ..results.dataset import Results
from ..results.motion import Motion
from ..results.staging import replacing
from ..text import magnitude, seconds
from .sheet import Rendered

MEDIA = {".png": "image/png", ".svg": "image/svg+xml"}


def write(
    path: Path, runs: Sequence[tuple[Results, Sequence[Rendered]]], title: str = "Figures"
) -> None:
    """Write the page of the figures drawn from these results; links are relative to it.

    A figure drawn as PNG or SVG is in the page itself. Raises HodoError for a damaged result file.
    """
    sections = [_section(results, rendered, path.parent) for results, rendered in runs]
    contents = [
        f'<li><a href="#{_anchor(results)}">{escape(results.config.title or results.path.name)}</a></li>'
        for results, _ in runs
    ]
    count = sum(len(rendered) for _, rendered in runs)
    page = template("page.html").substitute(
        title=escape(title),
        style=template("page.css").template,
        contents="".join(contents),
        sections="".join(sections),
        summary=f"{count} figures, with the parameters, measured errors and run times of what "
        "they show.",
    )
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def template(name: str) -> Template:
    """A file that lies beside this module, with $names to fill in."""
    return Template((Path(__file__).parent / name).read_text(encoding="utf-8"))


def _section(results: Results, rendered: Sequence[Rendered], base: Path) -> str:
    """All that the page says of one result file."""
    motions = {name: results.motion(name) for name in results.cases}
    cards = "".join(_card(each, results, motions, base) for each in rendered)
    return (
        f'<section id="{_anchor(results)}"><h2>{escape(results.config.title or results.path.name)}</h2>'
        f"<p>{escape(results.config.references)}</p>"
        f'<p class="soft">Data: {_link(results.path, base)}, {len(motions)} cases</p>'
        f'<div class="figures">{cards}</div>{_claims(results)}{_crossings(motions)}'
        f"<h3>Cases</h3>{_table(CASE_HEADER, [_case_row(motion) for motion in motions.values()])}</section>"
    )


def _anchor(results: Results) -> str:
    return escape(results.path.stem)


def _link(target: Path, base: Path, text: str = "") -> str:
    """A link relative to the folder of the page."""
    return f'<a href="{quote(os.path.relpath(target, base))}">{escape(text or target.name)}</a>'


def _card(figure: Rendered, results: Results, motions: Mapping[str, Motion], base: Path) -> str:
    """A figure with its caption, its files, and the cases that it shows."""
    spec = results.figures[figure.name]
    shown = [motions[name] for name in spec.get("cases", ()) if name in motions]
    files = " ".join(_link(file, base, file.suffix[1:].upper()) for file in figure.files)
    rows = [[_cell(motion.name), *_numbers(motion)] for motion in shown]
    taken = dict.fromkeys(f"{key}: {said}" for m in shown for key, said in m.case.assumes.items())
    assumed = f'<p class="soft">Assumed: {escape("; ".join(taken))}</p>' if taken else ""
    numbers = (
        f"<details><summary>{_summary(shown)}</summary>{_table(CARD_HEADER, rows)}</details>"
        if shown
        else ""
    )
    picture, wide = _picture(figure, base, spec["caption"] or figure.name)
    return (
        f'<figure id="{_anchor(results)}-{escape(figure.name)}"{" class=wide" if wide else ""}>{picture}'
        f"<figcaption><b>{escape(figure.name)}</b> {escape(spec['caption'])}{assumed}"
        f'<p class="soft">{files}</p>{numbers}</figcaption></figure>'
    )


def _picture(figure: Rendered, base: Path, alt: str) -> tuple[str, bool]:
    """The image, in the page, and whether it is broad; in place of it the reason why there is
    none."""
    if figure.problem:
        return f'<p class="problem">Not drawn: {escape(figure.problem)}</p>', False
    pictures = [file for file in figure.files if file.suffix in MEDIA]
    if not pictures:
        return "", False
    data = pictures[0].read_bytes()
    width, height = struct.unpack(">II", data[16:24]) if pictures[0].suffix == ".png" else (0, 0)
    size = f' width="{width // 2}" height="{height // 2}"' if width else ""
    source = f"data:{MEDIA[pictures[0].suffix]};base64,{base64.b64encode(data).decode()}"
    image = f'<img alt="{escape(alt)}" src="{source}"{size}>'
    return f'<a href="{quote(os.path.relpath(pictures[0], base))}">{image}</a>', width > 1400


def _summary(motions: Sequence[Motion]) -> str:
    """The largest error and the sum of run times of some cases, in one line."""
    error = max(
        (e for motion in motions if not math.isnan(e := float(motion.attrs["error"]))),
        default=math.nan,
    )
    total = sum(float(motion.attrs["run_time"]) for motion in motions)
    count = "1 case" if len(motions) == 1 else f"{len(motions)} cases"
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
CLAIM_HEADER = ("where", "statement", "verdict", "decided by", "measured, notes")
ERRATUM_HEADER = ("where", "printed", "should be", "verdict", "shown by")
CROSSING_HEADER = ("case", "start", "end", "crossing time", "error", "from", "to", "|G|")


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
    assumed = [f"assumed {key}: {said}" for key, said in motion.case.assumes.items()]
    notes = [ended, *assumed, motion.case.note, *str(attrs["warnings"]).splitlines()]
    return [
        _cell(motion.name, "n"), _cell(f"{attrs['model']}, {attrs['form']}", "n"), _cell(str(attrs["method"])),
        _cell(str(attrs["steps"])), error, run_time, given, _cell(". ".join(filter(None, notes)), "text"),
    ]  # fmt: skip


def _claims(results: Results) -> str:
    """The table of statements with their verdicts; none before `hodo claims`."""
    if "_claims" not in results.cases:
        return ""
    claims = results.cases["_claims"]
    columns = [
        map(str, claims[name].values)
        for name in ("where", "statement", "verdict", "evidence", "measured", "note")
    ]
    rows = [
        [_cell(where, "n"), _cell(statement, "text"), _cell(verdict, "n"), _cell(evidence, "text"),
         _cell(". ".join(filter(None, remarks)), "text")]
        for where, statement, verdict, evidence, *remarks in zip(*columns, strict=True)
    ]  # fmt: skip
    return f"<h3>What the text says</h3>{_table(CLAIM_HEADER, rows)}{_errata(results)}"


def _errata(results: Results) -> str:
    """The table of misprints; none without any."""
    if "_errata" not in results.cases:
        return ""
    errata = results.cases["_errata"]
    names = ("where", "printed", "should_be", "verdict", "evidence")
    columns = [map(str, errata[name].values) for name in names]
    rows = [[_cell(text, "text") for text in row] for row in zip(*columns, strict=True)]
    return f"<h3>Errata</h3>{_table(ERRATUM_HEADER, rows)}"


def _crossings(motions: Mapping[str, Motion]) -> str:
    """The table of separatrix crossings, with the enclosed axis at start and end; none without
    classified cases."""
    classified = [motion for motion in motions.values() if motion.classified and motion.labels.size]
    rows = [row for motion in classified for row in _crossing_rows(motion)]
    return (
        f"<h3>Enclosed axes and crossings of the separatrix</h3>{_table(CROSSING_HEADER, rows)}"
        if rows
        else ""
    )


def _crossing_rows(motion: Motion) -> list[list[str]]:
    ends = [_cell(motion.name, "n"), *(_cell(LABELS[int(motion.labels[i])]) for i in (0, -1))]
    if not motion.crossings:
        return [[*ends, _cell("none"), *[_cell("")] * 4]]
    return [
        [
            *ends,
            _cell(f"{crossing.time:.15g}", "n"),
            _cell(magnitude(crossing.error), "n"),
            _cell(LABELS[crossing.start]),
            _cell(LABELS[crossing.end]),
            _cell(f"{crossing.momentum:.6g}"),
        ]
        for crossing in motion.crossings
    ]


def parameters(case: Case) -> str:
    """The data of a case in one line; what is not given is left out."""
    span = f"time {case.time.start:g} to {case.time.end:g}"
    return "; ".join(
        [*(f"{key} {_plain(value)}" for key, value in case.data.items() if value is not None), span]
    )


def _plain(value: Any) -> str:
    """A value as text: numbers to 12 digits, lists in brackets, mappings as key = value."""
    if isinstance(value, Mapping):
        return ", ".join(
            f"{key} = {_plain(item)}" for key, item in value.items() if item is not None
        )
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_plain, value))})"
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _cell(text: str, kind: str = "") -> str:
    return f"<td{f' class={kind}' if kind else ''}>{escape(text)}</td>"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table that scrolls by itself; the cells of its rows are HTML already."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
