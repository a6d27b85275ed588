"""`hodo claims`: verdicts on the claims of a result file."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.claim_block import NOT_TESTED
from ..claims import quantities
from ..claims.finding import Verdict
from ..claims.quantities import Motion
from ..claims.verdicts import SWEPT, census, measure
from ..results.hdf5 import Group, Run, Variable


def judge(claim: Mapping[str, Any], run: Run) -> Verdict:
    """The verdict on one claim by the cases of a result.

    Raises HodoError if a case is not classified, or does not have what the check needs.
    """
    if claim["check"]["kind"] in SWEPT:
        return census(claim, run)
    cases: dict[str, Motion] = {}
    for name in claim["cases"]:
        ended = (
            run.row(name, {"status": str, "message": str})
            if name in run
            else {"status": "missing", "message": ""}
        )
        if ended["status"] != "ok":
            return Verdict(
                claim,
                NOT_TESTED,
                math.nan,
                f"{name}: {ended['status']} {ended['message']}".rstrip(),
            )
        cases[name] = quantities.read(run.read(name))
    try:
        return measure(claim, [*cases.values()])
    except HodoError as error:
        raise HodoError(f"{run.path}: claim {claim['id']}: {error}") from error


COLUMNS = ("id", "where", "statement", "verdict", "expect", "evidence", "measured", "note")
"""What is stored of a claim as text, besides the number."""


def row(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain data."""
    claim = verdict.claim
    texts = {
        name: claim[name] for name in ("id", "where", "statement", "expect", "measured", "note")
    }
    found = {"verdict": verdict.verdict, "evidence": verdict.evidence, "number": verdict.number}
    return {**texts, **found, "kind": claim["check"]["kind"], "cases": list(claim["cases"])}


def group(verdicts: Sequence[Verdict]) -> Group:
    """Verdicts as they are stored: texts and `number` over the dimension `claim`, whose coordinate
    is the id."""
    rows = [row(verdict) for verdict in verdicts]
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
