"""Print what a result says about its paper, in Markdown: `python tools/papers.py runs/paper1.h5`.

The verdicts must be stored (`hodo claims`). Statements, errata and readings come from the result
itself; links go to the figures that `make figures` draws.
"""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hodo_cli.cases.claim_block import (
    AS_PRINTED,
    CONTRADICTED,
    MISPRINTS,
    QUANTITY_NAMES,
    UNDERDETERMINED,
    VERDICTS,
)
from hodo_cli.cases.config import Config, parse
from hodo_cli.storage.hdf5 import ResultFile, open_run
from hodo_cli.tables import totals

LONGEST = 400
"""Characters of evidence that a cell holds; `hodo claims` prints all of it."""


OURS = "not in the paper"
"""How the place of a statement begins that is not the paper's."""


def plain(text: str) -> str:
    """Text on one line, with no character that Markdown obeys."""
    for mark in "|*_<":
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())


def cell(text: str) -> str:
    """Text in a cell of a table, cut where it is long."""
    return plain(text if len(text) <= LONGEST else f"{text[:LONGEST].rsplit(' ', 1)[0]} ...")


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; its cells are Markdown already."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def stored(run: ResultFile, name: str) -> list[dict[str, Any]]:
    """The rows of `_claims` or `_errata`."""
    if name not in run:
        sys.exit(f"{run.path} holds no verdicts: run `hodo claims` first")
    variables = run.read(name).variables
    columns = {key: variable.data.tolist() for key, variable in variables.items()}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def figures_of(where: str, config: Config, stem: str) -> str:
    """Links to the figures that a place in the text names, under all readings."""
    numbers = []
    for first, last in re.findall(r"Figs? (\d+)(?:(?:-| and |, )(\d+))?", where):
        numbers += range(int(first), int(last or first) + 1)
    names = [
        name
        for name in config.figures
        if (match := re.match(r"fig(\d+)(?!\d)", name)) and int(match[1]) in numbers
    ]
    return ", ".join(f"[{name}](../runs/figures/{stem}/{name}.png)" for name in names)


def statements(rows: Sequence[Mapping[str, Any]], config: Config, stem: str) -> str:
    """Every statement with its verdict and what decides it."""
    lines = []
    for row in rows:
        quoted = f"{cell(row['statement'])}<br>*{cell(row['original'])}*"
        statement = cell(row["statement"]) if not row["original"] else quoted
        remarks = "; ".join(filter(None, (row["measured"], row["note"])))
        figures = figures_of(row["where"], config, stem)
        where = f"{cell(row['where'])}<br>{figures}" if figures else cell(row["where"])
        lines.append([where, statement, row["verdict"], cell(row["evidence"]), cell(remarks)])
    header = ("where", "statement", "verdict", "decided by", "what is measured; notes")
    return table(header, lines)


def errata(rows: Sequence[Mapping[str, Any]]) -> str:
    """Every misprint with what shows it."""
    names = ("where", "printed", "should_be", "verdict", "evidence")
    lines = [[cell(row[name]) for name in names] for row in rows]
    header = ("where", "printed", "should be", "verdict", "shown by")
    return table(header, lines)


def assumptions(config: Config) -> str:
    """What the cases of the figures take that the paper does not print."""
    shown = {name for figure in config.figures.values() for name in figure.get("cases", ())}
    taken: dict[str, list[str]] = {}
    for name, case in config.cases.items():
        for key, text in case.assumes.items() if name in shown else ():
            taken.setdefault(f"{key}: {text}", []).append(name)
    if not taken:
        return "The paper prints everything that its figures need."
    lines = [[plain(text), plain(", ".join(names))] for text, names in taken.items()]
    return table(("taken here, and not printed", "by the motions"), lines)


def sentence(text: str) -> str:
    """A remark that stands by itself: it begins with a capital, unless its first word is a letter
    of a formula, and ends with a stop."""
    if not text:
        return ""
    return f"{text[:1].upper() + text[1:] if text[1:2].isalpha() else text}."


def what_does_not_hold(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The statements that do not simply hold, with what each reading of the text decides."""
    for verdict in (CONTRADICTED, AS_PRINTED, UNDERDETERMINED):
        for row in (row for row in rows if row["verdict"] == verdict):
            measured = f"measured: {row['measured']}" if row["measured"] else ""
            parts = (row["evidence"], measured, row["note"])
            words = " ".join(filter(None, (plain(sentence(part)) for part in parts)))
            statement = f"{plain(row['statement'])} *{plain(row['original'])}*"
            yield f"- **{verdict.capitalize()}** ({plain(row['where'])}). {statement}<br>{words}"


def names_used(rows: Sequence[Mapping[str, Any]]) -> str:
    """The meanings of the names of quantities in the evidence."""
    evidence = " ".join(row["evidence"] for row in rows)
    meanings = [
        f"- `{name}`: {plain(meaning)}"
        for name, meaning in QUANTITY_NAMES.items()
        if "_" in name and re.search(rf"\b{name}\b", evidence)
    ]
    return "\n".join(meanings)


def page(run: ResultFile) -> str:
    """All that a result says about its paper."""
    config, stem = parse(run.text, str(run.path)), run.path.stem
    misprints = stored(run, "_errata")
    rows = stored(run, "_claims")
    claims = [row for row in rows if not row["where"].startswith(OURS)]
    ours = [row for row in rows if row["where"].startswith(OURS)]
    errors = [run.row(name, {"error": float})["error"] for name in run.cases()]
    largest = max((error for error in errors if error == error), default=float("nan"))
    parts = [
        f"## {config.title}\n\n{config.references}",
        f"{totals('statement', claims, VERDICTS)}. {totals('erratum', misprints, MISPRINTS)}. "
        f"{len(config.figures)} figures are drawn from {len(config.cases)} motions, whose measured "
        f"errors are at most {largest:.1g}; they are in `runs/figures/{stem}/` once `make figures` "
        "has drawn them.",
        f"### Errata\n\n{errata(misprints)}",
        f"### What the text leaves open\n\n{assumptions(config)}",
    ]
    if lines := [*what_does_not_hold(claims)]:
        parts.append("### What does not simply hold\n\n" + "\n".join(lines))
    parts.append(f"### Every statement\n\n{statements(claims, config, stem)}")
    if ours:
        parts.append(f"### Not in the paper\n\n{statements(ours, config, stem)}")
    if meanings := names_used(rows):
        parts.append(f"Names in the fourth column:\n\n{meanings}")
    return "\n\n".join(parts)


if __name__ == "__main__":
    with open_run(Path(sys.argv[1])) as result:
        print(page(result))
