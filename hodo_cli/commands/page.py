"""One page with every figure, statement and number of the results that were drawn into a folder.
Everything in it except the names of the pictures is read from the result files. It opens from disk
and needs no network."""

import json
import os
from base64 import b64encode
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import jinja2

from .. import HodoError
from ..cases.claim_block import cases_of
from ..cases.config import Config
from ..machine import relative_path
from ..models.rigid_body import LABELS
from ..results.resume import stored_config
from ..storage import ResultFile, open_batch, replacing
from ..text import grouped, magnitude, seconds

PAGES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True
)
PAGES.filters |= {"magnitude": magnitude, "seconds": seconds}

ABOUT = {
    "model": str, "form": str, "method": str, "steps": int, "error": float, "error_kind": str,
    "run_time": float, "case": str, "status": str, "message": str, "warnings": str,
}  # fmt: skip
"""The attributes of a case that the page shows."""

Entry = dict[str, Any]
"""The values of a result, a figure or a statement for the template, by name."""

PICTURES = {".png": "png", ".svg": "svg+xml"}
"""The suffixes of picture files that a browser shows, and their media types."""


def write_page(path: Path, sections: Sequence[Entry], alone: bool) -> None:
    """Write the page with these sections; an `alone` page includes its pictures, and has no links
    to files.

    Raises HodoError if the file cannot be written.
    """
    totals = Counter(row["verdict"] for section in sections for row in section["statements"])
    page = PAGES.get_template("page.html").render(sections=sections, totals=totals, alone=alone)
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def sections_of(folder: Path, alone: bool = False) -> Iterator[Entry]:
    """The sections of all results with figures in a folder, papers first."""
    sections = []
    for file in sorted(folder.glob("*/drawn.json")):
        # A missing result, or a record of another version, has no section.
        with suppress(HodoError, ValueError, KeyError, TypeError):
            record = json.loads(file.read_text(encoding="utf-8"))
            with open_batch(os.path.normpath(folder / record["result"])) as run:
                sections.append(section_of(run, file.parent, record["figures"], alone))
    yield from sorted(sections, key=lambda section: not section["errata"])


def section_of(run: ResultFile, folder: Path, drawn: Mapping[str, Any], alone: bool) -> Entry:
    """The section of one result."""
    config, rows = stored_config(run), {name: run.row(name, ABOUT) for name in run.cases()}
    judged = {
        group: [*verdicts(run, group, entries)]
        for group, entries in (("_claims", config.claims), ("_errata", config.errata))
    }
    figures = [
        figure_of(config, name, drawn.get(name, {}), folder, alone) for name in config.figures
    ]
    for figure in figures:
        cases = {*figure["shown"]}
        judged_rows = [row for group in judged.values() for row in group]
        figure["statements"] = [row for row in judged_rows if cases & {*row["cases"]}]
        figure["cases"] = {name: rows[name] for name in figure["shown"] if name in rows}
        for row in figure["statements"]:
            row["figures"].append(figure["name"])
    return {
        "name": run.path.stem, "title": config.title or run.path.name,
        "references": config.references, "file": relative_path(run.path, folder.parent),
        "families": grouped((figure["name"].partition("-")[0], figure) for figure in figures),
        "cases": rows, "statements": judged["_claims"], "errata": judged["_errata"],
        "crossings": {name: [*crossing_rows(run, name)] for name in rows},
    }  # fmt: skip


def figure_of(
    config: Config, name: str, drawn: Mapping[str, Any], folder: Path, alone: bool
) -> Entry:
    """A figure of a config with its files in a folder."""
    spec, recorded = config.figures[name], sorted(drawn.get("files", ()))
    files = [folder / file for file in recorded if (folder / file).exists()]
    shown = spec.get("cases", ())
    assumptions = [config.cases[case].assumes.items() for case in shown if case in config.cases]
    images = (image_of(file, folder, alone) for file in files if file.suffix in PICTURES)
    links = [(file.suffix[1:].upper(), relative_path(file, folder.parent)) for file in files]
    return {
        "name": name, "kind": spec["kind"], "caption": spec["caption"], "shown": shown,
        "files": links, "image": next(images, ""),
        "problem": drawn.get("problem", ""), "notes": drawn.get("warnings", ()),
        "assumed": dict.fromkeys(": ".join(item) for items in assumptions for item in items),
        "wide": any(map(is_wide, files)),
    }  # fmt: skip


def is_wide(file: Path) -> bool:
    """Whether a picture is a PNG as wide as a page, by the width in its first chunk."""
    return file.suffix == ".png" and int.from_bytes(file.read_bytes()[16:20], "big") > 1400


def image_of(file: Path, folder: Path, alone: bool) -> str:
    """The address of a picture from the page, or the picture itself."""
    if not alone:
        return relative_path(file, folder.parent)
    return f"data:image/{PICTURES[file.suffix]};base64,{b64encode(file.read_bytes()).decode()}"


def verdicts(run: ResultFile, group: str, entries: Sequence[Entry]) -> Iterator[Entry]:
    """The statements (`_claims`) or misprints (`_errata`) of a result that `hodo claims` has
    judged; `entries` are their entries in the case file."""
    if group not in run:
        return
    stored, about = run.read(group).variables, {entry["id"]: cases_of(entry) for entry in entries}
    for i, name in enumerate(stored["claim"].data.tolist()):
        texts = {key: str(values.data[i]) for key, values in stored.items() if key != "number"}
        cases = about.get(str(name), [])
        yield {"kind": group[1:], **texts, "cases": cases, "figures": []}


def crossing_rows(run: ResultFile, name: str) -> Iterator[Sequence[str]]:
    """A row for each crossing of a case: time, error, axis before, axis after, |G|."""
    stored = run.read(name).variables
    # The members of a sweep have no such dimension.
    if "crossing_time" in stored and "crossing" in stored["crossing_time"].dims:
        columns = (stored[f"crossing_{key}"].data for key in ("time", "error", "from", "to", "G"))
        for time, error, start, end, G in zip(*columns, strict=True):
            yield f"{time:.15g}", magnitude(error), LABELS[int(start)], LABELS[int(end)], f"{G:.6g}"
