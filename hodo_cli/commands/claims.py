"""`hodo claims`: verdicts on the claims and errata of a result file."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..cases.claim_block import BY_READING, CONFIRMED
from ..cases.config import Config, parse
from ..claims.finding import Verdict
from ..claims.variations import Motions
from ..claims.verdicts import judge_claim, judge_erratum
from ..results.hdf5 import Group, Run, Variable
from ..results.provenance import stamp
from ..results.update import update

Rows = list[dict[str, Any]]


def judge_results(paths: Iterable[Path]) -> tuple[Rows, Rows]:
    """Judge and store the claims and the errata of result files; the lines of both tables.

    Raises HodoError as `judge_claim` does, or if a file cannot be read or replaced.
    """
    statements: Rows = []
    misprints: Rows = []
    for path in paths:
        with update(path, stamp(f"hodo claims {path}")) as changes:
            verdicts, errata = judged(parse(changes.run.text, str(path)), changes.run)
            statements += [{"run": str(path), **claim_row(verdict)} for verdict in verdicts]
            misprints += [{"run": str(path), **claim_row(verdict)} for verdict in errata]
            if verdicts:
                changes.write("_claims", claim_group(verdicts, STATEMENT_COLUMNS))
            if errata:
                changes.write("_errata", claim_group(errata, ERRATUM_COLUMNS))
    return statements, misprints


STATEMENT_COLUMNS = (
    "where",
    "original",
    "statement",
    "verdict",
    "expect",
    "evidence",
    "measured",
    "note",
)
ERRATUM_COLUMNS = ("where", "printed", "should_be", "verdict", "evidence", "note")
"""What is stored of a claim and of an erratum as text, besides its id."""


def judged(config: Config, run: Run) -> tuple[list[Verdict], list[Verdict]]:
    """The verdicts on the claims and on the errata of one result. Raises HodoError as `judge_claim`
    does."""
    known = Motions()
    verdicts = [judge_claim(claim, run, known) for claim in config.claims]
    return verdicts, [judge_erratum(erratum, run) for erratum in config.errata]


def claim_row(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain data."""
    entry = {key: value for key, value in verdict.claim.items() if isinstance(value, str)}
    readings = {
        name: {"verdict": each.verdict, "number": each.number, "evidence": each.evidence}
        for name, each in verdict.readings.items()
    }
    found = {"verdict": verdict.verdict, "number": verdict.number, "evidence": verdict.evidence}
    return {**entry, **found, "cases": list(verdict.claim["cases"]), "readings": readings}


def as_expected(row: Mapping[str, Any]) -> bool:
    """Whether a claim has the verdict that its file expects, or an erratum is confirmed."""
    if "expect" in row:
        return bool(row["verdict"] == row["expect"])
    return row["verdict"] in (CONFIRMED, BY_READING)


def claim_group(verdicts: Sequence[Verdict], columns: Sequence[str]) -> Group:
    """Verdicts as they are stored: texts and `number` over the dimension `claim`, whose coordinate
    is the id."""
    rows = [claim_row(verdict) for verdict in verdicts]
    texts = {
        name: Variable(
            ("claim",), np.array([row[key] for row in rows], dtype=object), {"long_name": name}
        )
        for name, key in {"claim": "id", **{name: name for name in columns}}.items()
    }
    numbers = np.array([row["number"] for row in rows], dtype=float)
    decides = Variable(("claim",), numbers, {"long_name": "the number that decides"})
    return Group({}, {**texts, "number": decides})
