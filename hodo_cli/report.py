"""Plain tables and numbers for the terminal."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any


def table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str] = ()) -> str:
    """Columns under a header, aligned; those named in `right` to the right. Lines carry no trailing space.

    A character that a terminal would obey and not show is shown as a question mark.
    """
    lines = [list(header), *([_printable(cell) for cell in row] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    flush = [str.rjust if name in right else str.ljust for name in header]
    return "\n".join(
        "  ".join(align(cell, width) for align, cell, width in zip(flush, line, widths, strict=True)).rstrip()
        for line in lines
    )


def _printable(text: str) -> str:
    return text if text.isprintable() else "".join(c if c.isprintable() else "?" for c in text)


def seconds(value: float) -> str:
    """A duration with its unit, to three digits."""
    if value >= 100:
        return f"{value:.0f} s"
    if value >= 1:
        return f"{value:.3g} s"
    return f"{value * 1e3:.3g} ms" if value >= 1e-3 else f"{value * 1e6:.3g} us"


def magnitude(value: float) -> str:
    """An error to two digits; a dash where none was measured."""
    return "-" if math.isnan(value) else "0" if value == 0 else f"{value:.1e}"


def cases(rows: Sequence[Mapping[str, Any]]) -> str:
    """Cases with their method, cost, error and what is to be said about them."""
    return table(
        ("case", "model", "form", "method", "steps", "run time", "error", "warnings"),
        [
            (
                row["case"],
                row["model"],
                row["form"],
                row["method"],
                str(row["steps"]),
                seconds(row["run_time"]),
                magnitude(row["error"]),
                remarks(row),
            )
            for row in rows
        ],
        right=("steps", "run time", "error"),
    )


def remarks(row: Mapping[str, Any]) -> str:
    """How a case ended, unless well, and its warnings, on one line."""
    ended = [] if row["status"] == "ok" else [f"{row['status']}: {row['message']}"]
    return "; ".join([*ended, *row["warnings"].splitlines()])


def crossings(rows: Sequence[Mapping[str, Any]]) -> str:
    """Cases with the axes enclosed at start and end, and the crossings between."""
    return table(
        ("case", "start", "end", "crossings"),
        [
            (
                row["case"],
                row["start"],
                row["end"],
                "; ".join([*map(passage, row["crossings"]), *row["warnings"]]),
            )
            for row in rows
        ],
    )


def passage(crossing: Mapping[str, Any]) -> str:
    """One crossing: when, with its error, from which axis to which."""
    error = magnitude(crossing["error"])
    return f"{crossing['time']:.15g} ({crossing['from']} -> {crossing['to']}, error {error})"


def claims(rows: Sequence[Mapping[str, Any]]) -> str:
    """Statements with their verdicts and what decides them; a verdict that is not the one expected is marked."""
    return table(
        ("claim", "where", "verdict", "decided by"),
        [
            (
                row["id"],
                row["where"],
                row["verdict"] + ("" if row["verdict"] == row["expect"] else f" (EXPECTED: {row['expect']})"),
                row["evidence"],
            )
            for row in rows
        ],
    )


def comparison(rows: Sequence[Mapping[str, Any]]) -> str:
    """For each case the variable that is farthest from the reference, and every one that differs."""
    worst = {row["case"]: row for row in sorted(rows, key=lambda row: row["scaled"])}
    shown = [row for row in rows if row["differs"] or row is worst[row["case"]]]
    return table(
        ("case", "variable", "scaled error", "", "where"),
        [
            (
                row["case"],
                row["variable"],
                magnitude(row["scaled"]),
                "DIFFERS" if row["differs"] else "",
                row["place"],
            )
            for row in shown
        ],
        right=("scaled error",),
    )


def as_json(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as JSON, which has no numbers that are not finite: null stands for them."""
    finite = [{k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()} for row in rows]
    return json.dumps(finite)
