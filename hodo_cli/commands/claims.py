"""`hodo claims`: verdicts on the claims of a result file."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..cases.config import parse
from ..claims.finding import Verdict
from ..claims.variations import Motions
from ..claims.verdicts import judge
from ..results.hdf5 import Group, Run, Variable
from ..results.provenance import stamp
from ..results.update import update


def judge_results(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """Judge and store the claims of result files; the lines of the table.

    Raises HodoError as `judge` does, or if a file cannot be read or replaced.
    """
    rows: list[dict[str, Any]] = []
    for path in paths:
        with update(path, stamp(f"hodo claims {path}")) as changes:
            config = parse(changes.run.text, str(path))
            verdicts = judged(config.claims, changes.run)
            rows += [{"run": str(path), **claim_row(verdict)} for verdict in verdicts]
            if verdicts:
                changes.write("_claims", claim_group(verdicts))
    return rows


def judged(claims: Sequence[Mapping[str, Any]], run: Run) -> list[Verdict]:
    """The verdicts on the claims of one result. Raises HodoError as `judge` does."""
    known = Motions()
    return [judge(claim, run, known) for claim in claims]


COLUMNS = ("id", "where", "statement", "verdict", "expect", "evidence", "measured", "note")
"""What is stored of a claim as text, besides the number."""


def claim_row(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain data."""
    claim = verdict.claim
    texts = {
        name: claim[name] for name in ("id", "where", "statement", "expect", "measured", "note")
    }
    found = {"verdict": verdict.verdict, "evidence": verdict.evidence, "number": verdict.number}
    return {**texts, **found, "kind": claim["check"]["kind"], "cases": list(claim["cases"])}


def claim_group(verdicts: Sequence[Verdict]) -> Group:
    """Verdicts as they are stored: texts and `number` over the dimension `claim`, whose coordinate
    is the id."""
    rows = [claim_row(verdict) for verdict in verdicts]
    names = {"claim": "id", **{name: name for name in COLUMNS[1:]}}
    texts = {
        name: Variable(
            ("claim",), np.array([row[key] for row in rows], dtype=object), {"long_name": name}
        )
        for name, key in names.items()
    }
    numbers = np.array([row["number"] for row in rows], dtype=float)
    return Group(
        {},
        {
            **texts,
            "number": Variable(("claim",), numbers, {"long_name": "the number that decides"}),
        },
    )
