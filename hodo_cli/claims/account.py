"""The verdicts on a paper as a page in Markdown: the gravest in full, and all in tables."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..cases.case import Case
from ..cases.claim_block import AS_PRINTED, CONTRADICTED, ONCE_CORRECTED, UNDERDETERMINED
from ..text import few, grouped, markdown

VerdictRow = Mapping[str, Any]

OURS = "not in the paper"
"""The beginning of `where` for a statement that is not the paper's."""

GRAVEST = (CONTRADICTED, AS_PRINTED, ONCE_CORRECTED, UNDERDETERMINED)
"""The verdicts on statements that do not simply hold, the gravest first."""

IN_FULL = 3
"""The statements that are told in full at least, besides all that are contradicted and all whose
verdict is not the expected one: authors read these first, and unfold the tables."""

HEADERS = {
    "errata": ("where", "printed", "should be", "verdict", "shown by"),
    "statements": ("where", "statement", "verdict", "decided by", "contradicted by"),
    "assumptions": ("what", "taken here", "cases"),
}


def account(
    counts: Iterable[str],
    statements: Sequence[VerdictRow],
    errata: Sequence[VerdictRow],
    cases: Iterable[Case],
) -> str:
    """The verdicts on a paper as text in Markdown, which begins with these counts."""
    doubted = gravest(statements)
    shown = [
        row
        for i, row in enumerate(doubted)
        if i < IN_FULL or row["verdict"] == CONTRADICTED or row["verdict"] != row["expect"]
    ]
    items = [*map(in_full, shown)]
    if more := len(doubted) - len(shown):
        items += [f"- and {more} more in the table of every statement"]
    tables = {
        "Errata": table_of("errata", map(erratum_cells, errata)),
        "Every statement": table_of("statements", map(statement_cells, statements)),
        "What is left open, and what is taken here": table_of("assumptions", assumptions(cases)),
    }
    in_list = "\n".join(items)
    parts = [f"## What does not simply hold\n\n{in_list}"] if items else []
    parts += [
        f"<details><summary>{heading}</summary>\n\n{table}\n\n</details>"
        for heading, table in tables.items()
        if table
    ]
    return "\n\n".join([f"{'. '.join(counts)}.", *parts])


def is_ours(row: VerdictRow) -> bool:
    """Whether a statement is not the paper's."""
    return bool(row["where"].startswith(OURS))


def gravest(statements: Iterable[VerdictRow]) -> list[VerdictRow]:
    """The statements of the paper that do not simply hold, the gravest first."""
    doubted = [row for row in statements if row["verdict"] in GRAVEST and not is_ours(row)]
    return sorted(doubted, key=lambda row: GRAVEST.index(row["verdict"]))


def marked(row: VerdictRow) -> str:
    """The verdict on a statement, and the one expected where it is another."""
    expected = "" if row["verdict"] == row["expect"] else f" (expected: {row['expect']})"
    return f"{row['verdict']}{expected}"


def in_full(row: VerdictRow) -> str:
    """A statement as an item of a list: ours, the paper's words, the verdict and remarks."""
    parts = [f"**{escaped(row['where'])}**: {escaped(row['statement'])}"]
    parts += [f"*{escaped(row['original'])}*"] if row["original"] else []
    parts += [f"**{marked(row).capitalize()}**: {escaped(row['evidence'])}."]
    parts += [f"Measured: {escaped(row['measured'])}."] if row["measured"] else []
    parts += [f"Remark: {escaped(row['note'])}."] if row["note"] else []
    return " ".join(["-", *parts])


def erratum_cells(row: VerdictRow) -> Sequence[str]:
    """A misprint as a row of its table."""
    shown = with_remark(row["evidence"], row["note"])
    return [row["where"], row["printed"], row["should_be"], row["verdict"], shown]


def statement_cells(row: VerdictRow) -> Sequence[str]:
    """A statement as a row of its table; a theorem's reason decides where there is one."""
    deciding = with_remark(row["theorem"] or row["evidence"], row["note"])
    return [row["where"], row["statement"], marked(row), deciding, row["contradicted_by"]]


def with_remark(reason: str, note: str) -> str:
    """The reason of a verdict, followed by the remark if there is one."""
    return f"{reason}; {note}" if reason and note else reason or note


def assumptions(cases: Iterable[Case]) -> list[Sequence[str]]:
    """What the paper leaves open: each assumption once, with the names of its cases."""
    pairs = ((taken, case.name) for case in cases for taken in case.assumes.items())
    return [(*taken, few(names)) for taken, names in grouped(pairs).items()]


def table_of(topic: str, rows: Iterable[Sequence[str]]) -> str:
    """A table of texts; empty without rows."""
    cells = [[escaped(cell) for cell in row] for row in rows]
    return markdown(HEADERS[topic], cells).rstrip() if cells else ""


def escaped(text: str) -> str:
    """Text on one line, with the characters of Markdown's syntax escaped."""
    return re.sub(r"([\\*_<\[])", r"\\\1", " ".join(text.split()))
