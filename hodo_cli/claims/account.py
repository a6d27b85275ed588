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
"""How many of the gravest statements are shown in full, besides all that are contradicted and all
whose verdict is not the expected one: authors read these first, and unfold the tables."""


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
    in_list = "\n".join(items)
    # What the paper leaves open: each assumption once, with the names of its cases.
    open_ = grouped((taken, case.name) for case in cases for taken in case.assumes.items())
    tables = (
        (
            "Errata",
            ("where", "printed", "should be", "verdict", "shown by"),
            [[x["where"], x["printed"], x["should_be"], x["verdict"], shown_by(x)] for x in errata],
        ),
        (
            "Every statement",
            ("where", "statement", "verdict", "decided by", "contradicted by"),
            [
                [
                    x["where"],
                    x["statement"],
                    marked(x),
                    shown_by(x, x["theorem"]),
                    x["contradicted_by"],
                ]
                for x in statements
            ],
        ),
        (
            "What is left open, and what is taken here",
            ("what", "taken here", "cases"),
            [[*taken, few(names)] for taken, names in open_.items()],
        ),
    )
    parts = [f"## What does not simply hold\n\n{in_list}"] if items else []
    for heading, header, rows in tables:
        table = markdown(header, [[escaped(cell) for cell in row] for row in rows]).rstrip()
        fold = f"<details><summary>{heading}</summary>\n\n{table}\n\n</details>"
        parts += [fold] if rows else []
    return "\n\n".join([f"{'. '.join(counts)}.", *parts])


def is_ours(row: VerdictRow) -> bool:
    """Whether a statement is not the paper's."""
    return bool(row["where"].startswith(OURS))


def gravest(statements: Iterable[VerdictRow]) -> list[VerdictRow]:
    """The statements of the paper that do not simply hold, the gravest first."""
    doubted = [row for row in statements if row["verdict"] in GRAVEST and not is_ours(row)]
    return sorted(doubted, key=lambda row: GRAVEST.index(row["verdict"]))


def marked(row: VerdictRow) -> str:
    """The verdict on a statement, with the expected verdict where that is another."""
    expected = "" if row["verdict"] == row["expect"] else f" (expected: {row['expect']})"
    return f"{row['verdict']}{expected}"


def in_full(row: VerdictRow) -> str:
    """A statement as an item of a list: in our words, in the paper's words, the verdict and
    remarks."""
    parts = [f"**{escaped(row['where'])}**: {escaped(row['statement'])}"]
    parts += [f"*{escaped(row['original'])}*"] if row["original"] else []
    parts += [f"**{marked(row).capitalize()}**: {escaped(row['evidence'])}."]
    parts += [f"Measured: {escaped(row['measured'])}."] if row["measured"] else []
    parts += [f"Remark: {escaped(row['note'])}."] if row["note"] else []
    return " ".join(["-", *parts])


def shown_by(row: VerdictRow, theorem: str = "") -> str:
    """What decides a statement or shows a misprint (its `theorem`, if there is one, or else the
    evidence), and the remark."""
    return "; ".join(filter(None, [theorem or row["evidence"], row["note"]]))


def escaped(text: str) -> str:
    """Text on one line, with the characters of Markdown's syntax escaped."""
    return re.sub(r"([\\*_<\[])", r"\\\1", " ".join(text.split()))
