"""The tables that commands print."""

from collections.abc import Mapping, Sequence
from typing import Any

from .cases.claim_block import MISPRINTS, VERDICTS
from .text import NAMES_LISTED, abridged, grouped, magnitude, seconds, table


def case_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Cases with their method, cost, error and warnings; below them, once each, the warnings that
    several cases share, and what cases assume where that is known."""
    header = ("case", "model", "form", "method", "steps", "run time", "error", "warnings")
    names = grouped(
        (text, row["case"])
        for row in rows
        for text in [*remarks(row), f"assumes {row['assumes']}" if row.get("assumes") else ""]
        if text
    )
    lines = [
        [
            row["case"],
            row["model"],
            row["form"],
            row["method"],
            str(row["steps"]),
            seconds(row["run_time"]),
            magnitude(row["error"]),
            "; ".join(text for text in remarks(row) if len(names[text]) == 1),
        ]
        for row in rows
    ]
    shared = [
        f"{', '.join(abridged(cases, NAMES_LISTED))}: {text}"
        for text, cases in names.items()
        if len(cases) > 1 or text.startswith("assumes ")
    ]
    return "\n".join([table(header, lines, right=("steps", "run time", "error")), *shared])


def remarks(row: Mapping[str, Any]) -> list[str]:
    """How a case ended, unless well and at its time, and its warnings."""
    ended = row["message"] if row["status"] == "ok" else f"{row['status']}: {row['message']}"
    return [*filter(None, [ended]), *row["warnings"].splitlines()]


def table_of_crossings(rows: Sequence[Mapping[str, Any]]) -> str:
    """Cases with the axes enclosed at start and end, the growth rates of a small tilt away from an
    axis, the axis that theory predicts in the end, and the crossings; below them, once for each
    reason, the cases without labels."""
    header = ("case", "start", "end", "growth of a tilt", "predicted", "crossings")
    lines = [crossings_line(row) for row in rows if row["warnings"] != [row.get("unlabelled")]]
    names = grouped((row["unlabelled"], row["case"]) for row in rows if "unlabelled" in row)
    paragraphs = [table(header, lines, optional=header[3:])] if lines else []
    for reason, cases in names.items():
        paragraphs.append(f"no labels: {reason}: {', '.join(abridged(cases, NAMES_LISTED))}")
    return "\n".join(paragraphs)


CROSSINGS_SHOWN = 5
"""The most crossings of a case in a table, where a line may have hundreds of them."""


def crossings_line(row: Mapping[str, Any]) -> tuple[str, ...]:
    """The line of a case in the table of crossings; of many of these, the first ones and the
    last."""
    growth = [f"{axis} {rate:+.6g}" for axis, rate in row.get("growth", {}).items()]
    predicted = filter(None, [row.get("final", ""), *row.get("predictions", ())])
    time_unit = row.get("units", {}).get("time", "1")
    unit = "" if time_unit == "1" else f" {time_unit}"
    every = [passage(crossing, unit) for crossing in row["crossings"]]
    events = [f"{event['kind']} at {event['time']:.15g}{unit}" for event in row.get("events", ())]
    remarks = [remark for remark in row["warnings"] if remark != row.get("unlabelled")]
    passages = abridged(every, CROSSINGS_SHOWN, " (--json lists them)")
    ends = row["case"], row["start"], row["end"], ", ".join(growth), "; ".join(predicted)
    return (*ends, "; ".join([*passages, *events, *remarks]))


def passage(crossing: Mapping[str, Any], unit: str) -> str:
    """One crossing: when, with its error, from which axis to which."""
    error, ends = magnitude(crossing["error"]), f"{crossing['from']} -> {crossing['to']}"
    return f"{crossing['time']:.15g}{unit} ({ends}, error {error}{unit})"


def verdict_tables(rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Statements with their verdicts and what decides them, errata with their corrections, and how
    many have which verdict; a statement whose verdict is not the one expected is marked."""
    statements, errata, parts = rows["statements"], rows["errata"], []
    if statements:
        lines = []
        for row in statements:
            unexpected = "" if row["verdict"] == row["expect"] else f" (EXPECTED: {row['expect']})"
            lines.append((row["id"], row["where"], row["verdict"] + unexpected, row["evidence"]))
        parts += [table(("claim", "where", "verdict", "decided by"), lines)]
        parts += [totals("statement", statements, VERDICTS)]
    if errata:
        header = ("erratum", "where", "printed", "should be", "verdict", "shown by")
        keys = ("id", "where", "printed", "should_be", "verdict", "evidence")
        parts += ["", table(header, [[row[key] for key in keys] for row in errata])]
        parts += [totals("erratum", errata, MISPRINTS)]
    return "\n".join(parts)


def totals(what: str, rows: Sequence[Mapping[str, Any]], verdicts: Sequence[str]) -> str:
    """How many rows there are, and how many have which verdict."""
    counts = [(sum(row["verdict"] == verdict for row in rows), verdict) for verdict in verdicts]
    plural = what if len(rows) == 1 else {"erratum": "errata"}.get(what, f"{what}s")
    return f"{len(rows)} {plural}: {', '.join(f'{n} {verdict}' for n, verdict in counts if n)}"


def comparison_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """For each case the variable that is farthest from the reference, and every one that
    differs."""
    # The last one of a case stays, which is the farthest.
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
