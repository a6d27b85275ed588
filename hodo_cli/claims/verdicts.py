"""Verdicts: over the motions of a result, over a grid of what a text leaves open, over a sample,
over a stored sweep.

Where a text leaves a value out, the check is made over a grid of it, and a statement that holds on
a part of the grid is under-determined. A statement about all motions of a kind is checked on a
sample of them, of which a share must comply.
"""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from .. import HodoError
from ..cases.case import parse_case
from ..cases.claim_block import (
    AS_PRINTED,
    BY_READING,
    CONFIRMED,
    CONTRADICTED,
    NOT_CONFIRMED,
    NOT_TESTED,
    PLOTTING,
    REPRODUCED,
    UNDERDETERMINED,
    readings,
)
from ..results.motion import Array, Motion, motion_of
from ..schema.kinds import unknown
from ..storage.hdf5 import ResultFile
from ..sweeps.averages import distance_of_sweeps
from . import averaging, paper1, paper2, paper3
from .checks import MOTION_CHECKS, averages
from .finding import PAPER_CHECKS, PAPER_TRENDS, Finding, Verdict
from .variations import Motions, members

PAPERS = (averaging, paper1, paper2, paper3)
"""The modules whose import fills `PAPER_CHECKS` and `PAPER_TRENDS`."""


def judge_claim(claim: Mapping[str, Any], run: ResultFile, known: Motions) -> Verdict:
    """The verdict on one claim by the cases of a result; `known` holds the motions that claims have
    varied.

    Raises HodoError if a case is not classified, or does not have what the check needs.
    """
    found = {name: judge_reading(one, run, known) for name, one in readings(claim).items()}
    if not claim["readings"]:
        return found[""]
    first = next(iter(found.values()))
    evidence = "; ".join(
        f"{name}: {each.verdict} ({each.evidence})" for name, each in found.items()
    )
    return Verdict(claim, together(claim, found), first.number, evidence, found)


def together(claim: Mapping[str, Any], found: Mapping[str, Verdict]) -> str:
    """The verdict over the readings of a claim."""
    verdicts = [each.verdict for each in found.values()]
    holds = [verdict in (REPRODUCED, PLOTTING) for verdict in verdicts]
    if NOT_TESTED in verdicts:
        return NOT_TESTED
    # The readings of an erratum are two, as printed and corrected, in this order.
    if claim["erratum"] and holds == [True, False]:
        return AS_PRINTED
    if all(holds):
        return PLOTTING if PLOTTING in verdicts else REPRODUCED
    # Contradicted only under every reading: the text may have meant the one under which it holds.
    return CONTRADICTED if set(verdicts) == {CONTRADICTED} else UNDERDETERMINED


def judge_erratum(erratum: Mapping[str, Any], run: ResultFile) -> Verdict:
    """Whether the printed form is wrong and the corrected one right. Raises as `judge_claim`."""
    if erratum["check"] is None:
        return Verdict(erratum, BY_READING, math.nan, "")
    if missing := unusable(erratum["cases"], run):
        return Verdict(erratum, NOT_TESTED, math.nan, missing)
    try:
        finding = decide(erratum["check"], [stored_motion(run, name) for name in erratum["cases"]])
    except HodoError as error:
        raise _told_of(f"erratum {erratum['id']}", run, error) from error
    verdict = CONFIRMED if finding.holds else NOT_CONFIRMED
    return Verdict(erratum, verdict, finding.number, finding.words)


def alone(claim: Mapping[str, Any], finding: Finding) -> Verdict:
    """The verdict on a claim that one finding decides."""
    return Verdict(claim, finding.degree, finding.number, finding.words)


def unusable(cases: Sequence[str], run: ResultFile) -> str:
    """Which of some cases has no result, and why; an empty string if each has one."""
    for name in cases:
        ended = {"status": "missing", "message": ""}
        if name in run:
            ended = run.row(name, {"status": str, "message": str})
        if ended["status"] != "ok":
            return f"{name}: {ended['status']} {ended['message']}".rstrip()
    return ""


def judge_reading(claim: Mapping[str, Any], run: ResultFile, known: Motions) -> Verdict:
    """The verdict on a claim without readings. Raises as `judge_claim` does."""
    if missing := unusable(claim["cases"], run):
        return Verdict(claim, NOT_TESTED, math.nan, missing)
    try:
        if claim["check"]["kind"] == "average":
            return alone(claim, of_sweep(claim, run))
        return measure(claim, [stored_motion(run, name) for name in claim["cases"]], known)
    except HodoError as error:
        raise _told_of(f"claim {claim['id']}", run, error) from error


def _told_of(what: str, run: ResultFile, error: HodoError) -> HodoError:
    """An error with what could not be decided, and the file once: it may begin with it already."""
    return HodoError(f"{run.path}: {what}: {str(error).removeprefix(f'{run.path}: ')}")


def of_sweep(claim: Mapping[str, Any], run: ResultFile) -> Finding:
    """What an `average` finds in the one sweep that the claim names, or in the distance of two.
    Raises HodoError if there is no such sweep."""
    if len(claim["cases"]) not in (1, 2):
        raise HodoError("a check of kind average takes one case, or two whose distance it averages")
    groups = [run.read(name) for name in claim["cases"]]
    for name, group in zip(claim["cases"], groups, strict=True):
        if not (sweep := parse_case(str(group.attributes["case"])).sweep):
            raise HodoError(f"case {name} is no sweep")
    columns: Mapping[Any, Array] = groups[0].variables
    if len(groups) == 2:
        variable, against = claim["check"]["variable"], claim["check"]["against"]
        columns = distance_of_sweeps(columns, groups[1].variables, variable, against or variable)
    return averages(claim["check"], columns, list(sweep or {}))


@lru_cache(maxsize=64)
def stored_motion(run: ResultFile, name: str) -> Motion:
    """The motion of one case of a result, kept for the next claim about it. Raises HodoError if it
    is damaged."""
    group = run.read(name)
    return motion_of(group.variables, group.attributes, f"{run.path}: {name}", str(run.path))


def measure(claim: Mapping[str, Any], motions: Sequence[Motion], known: Motions) -> Verdict:
    """The verdict on one claim by the motions of its cases, in order, or by the members of its
    `over:`.

    Raises HodoError as `judge_claim` does.
    """
    if not claim["over"]:
        return alone(claim, decide(claim["check"], motions))
    varied = dict(members([each.case for each in motions], claim["over"], claim["start"]))
    if not varied:
        raise HodoError(f"no member starts about {claim['start']}")
    n = len(motions)
    flat = known.of([case for cases in varied.values() for case in cases])
    found = dict(zip(varied, [flat[i : i + n] for i in range(0, len(flat), n)], strict=True))
    # A trend speaks of all members at once, so no single one of them can decide it.
    if (name := claim["check"].get("name")) in PAPER_TRENDS:
        return alone(claim, PAPER_TRENDS[name]([*found.values()]))
    findings = {name: decide(claim["check"], some) for name, some in found.items()}
    return gridded(claim, findings) if claim["share"] is None else sampled(claim, findings)


def decide(check: Mapping[str, Any], motions: Sequence[Motion]) -> Finding:
    """What one check finds in one set of motions. Raises HodoError for a check that there is
    not."""
    if check["kind"] != "paper":
        return MOTION_CHECKS[check["kind"]](check, motions)
    if (name := check["name"]) not in PAPER_CHECKS:
        raise HodoError(unknown(f"check {name!r}", name, [*PAPER_CHECKS, *PAPER_TRENDS]))
    return PAPER_CHECKS[name](motions)


def gridded(claim: Mapping[str, Any], found: Mapping[str, Finding]) -> Verdict:
    """The verdict over a grid of what the text does not print."""
    worst = max(found, key=lambda member: found[member].deviation)
    deviation, holds = found[worst].deviation, sum(f.holds for f in found.values())
    part = 0 < holds < len(found)
    size = f"{deviation:.2g} of the range " if deviation < math.inf else ""
    violation = f"; largest violation {size}at {worst} ({found[worst].words})" if deviation else ""
    words = f"holds on {holds} of {len(found)} members{spread(found)}{violation}"
    verdict = UNDERDETERMINED if part else found[worst].degree
    return Verdict(claim, verdict, found[worst].number, words)


def sampled(claim: Mapping[str, Any], found: Mapping[str, Finding]) -> Verdict:
    """The verdict over a sample of what the statement speaks of."""
    holds = sum(f.holds for f in found.values())
    share = holds / len(found)
    percent = f"{100 * share:.3g} %"
    words = f"holds for {holds} of {len(found)} members of a sample ({percent}){spread(found)}"
    return Verdict(claim, REPRODUCED if share >= claim["share"] else CONTRADICTED, share, words)


def spread(found: Mapping[str, Finding]) -> str:
    """The range of the deciding number over the members, where there is one."""
    numbers = [finding.number for finding in found.values()]
    return f", {min(numbers):.6g} to {max(numbers):.6g}" if min(numbers) < max(numbers) else ""
