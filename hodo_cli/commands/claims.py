"""`hodo claims`: verdicts on the claims and errata of a result file."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..cases.claim_block import (
    BY_READING,
    CONFIRMED,
    MISPRINTS,
    VERDICTS,
    checks_of_papers,
    readings,
)
from ..cases.config import Config, located
from ..claims.account import account, is_ours
from ..claims.finding import Verdict
from ..claims.verdicts import Judge
from ..papers import finding_of
from ..progress import Progress
from ..results.resume import content_digest, results_named, stored_config, warn_of_changes
from ..storage import Group, ResultFile, Update, Variable, history_line, open_run, update
from ..text import counted, table

Rows = list[dict[str, Any]]


TABLES = {
    "statements": (
        "_claims",
        ("where", "original", "statement", "verdict", "expect", "evidence", "contradicted_by",
         "theorem", "measured", "note"),
    ),
    "errata": (
        "_errata",
        ("where", "printed", "should_be", "verdict", "evidence", "contradicted_by", "note"),
    ),
}  # fmt: skip
"""The groups of the verdicts on claims and on errata, and the texts that they hold besides the
id."""


def judge_results(paths: Iterable[Path]) -> dict[str, Rows]:
    """Judge the claims and the errata of result files, or of the results of configs, and store the
    verdicts. Returns the rows of both TABLES.

    A file without claims is warned of, because an empty table would look like a passed check.
    Raises HodoError as `Judge.claim` does, or if a file cannot be read or replaced.
    """
    tables: dict[str, Rows] = {name: [] for name in TABLES}
    for path, config in results_named(paths):
        with update(path, history_line(f"hodo claims {path}")) as changes:
            warn_of_changes(changes.run, config, "claims")
            rows = rows_of_result(changes, config)
        if not any(rows.values()):
            warnings.warn(f"{path} has no claims: or errata:", stacklevel=2)
        for topic, lines in tables.items():
            lines += [{"run": str(path), **row} for row in rows[topic]]
    return tables


def rows_of_result(changes: Update, config: Config | None) -> dict[str, Rows]:
    """The rows of one result. They are read from it if nothing on which they depend has changed;
    else they are judged and stored. Raises HodoError as `judged` does."""
    run, digest = changes.run, ""
    with suppress(HodoError):  # a case that cannot be read may matter to no claim
        digest = content_digest(map(run.checksum, run.cases()), (config or run).text)
        rows = run.report("_claims", digest) if digest and "_claims" in run else None
        if rows is not None:
            return dict(rows)
    stated = config or stored_config(run)
    rows = judged(stated, run)
    if unknown := unknown_checks(stated):
        digest = ""  # without a digest the verdicts are judged again, and the warning is repeated
        warnings.warn(
            f"{run.path}: this version has no check {', '.join(map(repr, unknown))}: "
            "hodo run with the case file of this version renews its statements",
            stacklevel=3,
        )
    # Empty groups are written too: they replace verdicts on statements that were removed, and the
    # first group holds the report even if there are only errata.
    if any(rows.values()) or any(name in run for name, _ in TABLES.values()):
        for topic, (name, columns) in TABLES.items():
            group = claim_group(rows[topic], columns)
            changes.write(name, group.with_report(digest, rows) if topic == "statements" else group)
    return rows


def judged(config: Config, run: ResultFile) -> dict[str, Rows]:
    """The rows of the verdicts on the claims and on the errata of one result. Raises HodoError as
    `Judge.claim` does, with the place of the claim in its file."""
    judge, by_id = Judge(run, finding_of), itemgetter("id")
    rows: dict[str, Rows] = {"statements": [], "errata": []}
    with Progress(len(config.claims) + len(config.errata)) as progress:
        for topic, section, entries, decide in (
            ("statements", "claims", config.claims, judge.claim),
            ("errata", "errata", config.errata, judge.erratum),
        ):
            for i, entry in enumerate(progress.through(entries, by_id)):
                try:
                    rows[topic].append(claim_row(entry, decide(entry)))
                except HodoError as error:
                    place = (section, i, "check" if entry["check"] else "readings")
                    message = str(error).removeprefix(f"{run.path}: ")
                    raise located(config, place, message) from error
    return rows


def unknown_checks(config: Config) -> list[str]:
    """The names of checks in a result of another version of hodo that this version lacks."""
    entries = (*config.claims, *config.errata)
    checks = [reading["check"] for entry in entries for reading in readings(entry).values()]
    named = dict.fromkeys(check["name"] for check in checks if check and check["kind"] == "paper")
    return [name for name in named if name not in checks_of_papers()]


def claim_row(claim: Mapping[str, Any], verdict: Verdict) -> dict[str, Any]:
    """A claim or erratum with its verdict, as plain data."""
    return {
        **{key: value for key, value in claim.items() if isinstance(value, str)},
        **decision(verdict),
        "cases": list(claim["cases"]),
        "readings": {name: decision(reading) for name, reading in verdict.readings.items()},
    }


def decision(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain data, without the verdicts of single readings."""
    finding = verdict.finding
    return {
        "verdict": verdict.word,
        "number": finding.number,
        "evidence": finding.evidence,
        "contradicted_by": finding.contradicted_by,
    }


def as_expected(row: Mapping[str, Any]) -> bool:
    """Whether a claim has the verdict that its file expects, or an erratum is confirmed."""
    expected = (row["expect"],) if "expect" in row else (CONFIRMED, BY_READING)
    return row["verdict"] in expected


def claim_group(rows: Rows, columns: Sequence[str]) -> Group:
    """The rows of verdicts as a group: texts and `number` over the dimension `claim`, whose
    coordinate is the id."""
    texts = {
        name: Variable(
            ("claim",), np.array([row[key] for row in rows], dtype=object), {"long_name": name}
        )
        for name, key in {"claim": "id", **{name: name for name in columns}}.items()
    }
    numbers = np.array([row["number"] for row in rows], dtype=float)
    decides = Variable(("claim",), numbers, {"long_name": "the number that decides"})
    return Group({}, {**texts, "number": decides})


def verdict_tables(rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Statements with their verdicts and deciding evidence, errata with their corrections, and the
    number of each verdict; a mark shows an unexpected verdict."""
    statements, errata, parts = rows["statements"], rows["errata"], []
    if statements:
        unexpected = ("" if as_expected(x) else f" (EXPECTED: {x['expect']})" for x in statements)
        lines = [
            [row["id"], row["where"], row["verdict"] + expected, row["evidence"]]
            for row, expected in zip(statements, unexpected, strict=True)
        ]
        parts += [table(("claim", "where", "verdict", "decided by"), lines)]
        parts += [totals("statement", statements, VERDICTS), *([""] if errata else [])]
    if errata:
        header = ("erratum", "where", "printed", "should be", "verdict", "shown by")
        keys = ("id", "where", "printed", "should_be", "verdict", "evidence")
        parts += [table(header, [[row[key] for key in keys] for row in errata])]
        parts += [totals("erratum", errata, MISPRINTS)]
    return "\n".join(parts)


def verdict_page(paths: Iterable[Path], rows: Mapping[str, Rows]) -> str:
    """The verdicts on results, or on results of configs, as a page in Markdown; statements that are
    not the paper's are not counted. Raises HodoError if a result cannot be read."""
    cases: list[Case] = []
    for path, config in results_named(paths):
        with open_run(path) as run:
            cases += (config or stored_config(run)).cases.values()
    statements, errata = rows["statements"], rows["errata"]
    own = [row for row in statements if not is_ours(row)]
    misprints = [totals("erratum", errata, MISPRINTS)] if errata else []
    return account([totals("statement", own, VERDICTS), *misprints], statements, errata, cases)


def totals(what: str, rows: Sequence[Mapping[str, Any]], verdicts: Sequence[str]) -> str:
    """The number of rows, and of rows of each verdict."""
    counts = ((sum(row["verdict"] == verdict for row in rows), verdict) for verdict in verdicts)
    named = ", ".join(f"{n} {verdict}" for n, verdict in counts if n)
    return f"{counted(len(rows), what)}: {named}"
