"""Verdicts: over the motions of a result, over a grid of what a text leaves open, over a sample,
over a stored sweep.

Where a text leaves a value out, the check is made over a grid of it, and a statement that holds on
a part of the grid is under-determined. A statement about all motions of a kind is checked on a
sample of them, of which a share must comply.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

from .. import HodoError
from ..cases.case import Case
from ..cases.claim_block import (
    AS_PRINTED,
    BY_READING,
    COMPLYING,
    CONFIRMED,
    CONTRADICTED,
    NOT_CONFIRMED,
    NOT_TESTED,
    ONCE_CORRECTED,
    PLOTTING,
    REPRODUCED,
    THEOREM,
    UNDERDETERMINED,
    case_name,
    readings,
)
from ..results.motion import Motion, case_of, motion_of
from ..schema.frozen import frozen
from ..schema.kinds import unknown
from ..storage.hdf5 import ResultFile
from .checks import MOTION_CHECKS, averages
from .finding import Check, Finding, Trend, Verdict, part_of
from .variations import Motions, changed, members


@dataclass(frozen=True)
class Judge:
    """Decides claims and errata by the cases of one result; `checks` are those written for single
    texts, by name."""

    run: ResultFile
    checks: Mapping[str, Check | Trend]
    varied: Motions = field(default_factory=Motions)

    def claim(self, claim: Mapping[str, Any]) -> Verdict:
        """The verdict on one claim.

        Raises HodoError if a case is not classified, or does not have what the check needs.
        """
        verdicts = {name: self._reading(reading) for name, reading in readings(claim).items()}
        if not claim["readings"]:
            return verdicts[""]
        first = next(iter(verdicts.values()))
        decisions = {name: f"{v.verdict} ({v.evidence})" for name, v in verdicts.items()}
        evidence = by_reading(decisions, "every reading: ")
        contrary = by_reading({name: v.contradicted_by for name, v in verdicts.items()}, "")
        return Verdict(
            claim, over_readings(claim, verdicts), first.number, evidence, contrary, verdicts
        )

    def erratum(self, erratum: Mapping[str, Any]) -> Verdict:
        """Whether the printed form is wrong and the corrected one right. Raises as `claim`."""
        if erratum["check"] is None:
            return Verdict(erratum, BY_READING, math.nan, "")
        if missing := unusable(erratum["cases"], self.run):
            return Verdict(erratum, NOT_TESTED, math.nan, missing)
        try:
            finding = self._decide(erratum["check"], self._motions(erratum["cases"]))
        except HodoError as error:
            raise _located(f"erratum {erratum['id']}", self.run, error) from error
        verdict = CONFIRMED if finding.holds else NOT_CONFIRMED
        return Verdict(erratum, verdict, finding.number, finding.words, finding.contradicted_by)

    def _reading(self, claim: Mapping[str, Any]) -> Verdict:
        """The verdict on a claim without readings."""
        if missing := unusable(claim["cases"], self.run):
            return Verdict(claim, NOT_TESTED, math.nan, missing)
        try:
            if claim["check"]["kind"] == "average":
                return by_finding(claim, of_sweep(claim, self.run))
            return proved(self._measured(claim))
        except HodoError as error:
            raise _located(f"claim {claim['id']}", self.run, error) from error

    def _case(self, entry: Any) -> Case:
        """The case of an entry of `cases:`, as it is stored or with other values."""
        name = case_name(entry)
        case = case_of(self.run.row(name, {"case": str}), f"{self.run.path}: {name}")
        if isinstance(entry, str):
            return case
        return changed(case, {key: value for key, value in entry.items() if key != "case"})

    def _motions(self, entries: Sequence[Any]) -> list[Motion]:
        """The motions of entries of `cases:`, in order: stored ones, and those of cases with other
        values."""
        new = [self._case(entry) for entry in entries if not isinstance(entry, str)]
        varied = iter(next(self.varied.of([new])) if new else ())
        return [
            stored_motion(self.run, entry) if isinstance(entry, str) else next(varied)
            for entry in entries
        ]

    def _measured(self, claim: Mapping[str, Any]) -> Verdict:
        """The verdict on a claim by the motions of its cases, in order, or by the members of its
        `over:`. Raises as `claim`."""
        if not claim["over"]:
            return by_finding(claim, self._decide(claim["check"], self._motions(claim["cases"])))
        cases = tuple(map(self._case, claim["cases"]))
        varied = members(cases, frozen(claim["over"]), claim["start"])
        if not varied:
            raise HodoError(f"no member starts about {claim['start']}")
        by_member = self.varied.of([*varied.values()])
        # A trend is about all members at once, so no single member can decide it.
        if isinstance(self.checks.get(claim["check"].get("name")), Trend):
            return by_finding(claim, self._decide(claim["check"], [*by_member]))
        findings = {
            name: self._decide(claim["check"], of_member)
            for name, of_member in zip(varied, by_member, strict=True)
        }
        return (
            gridded(claim, findings) if claim["share"] is None else sampled_verdict(claim, findings)
        )

    def _decide(self, check: Mapping[str, Any], motions: Sequence[Any]) -> Finding:
        """The finding of one check on one set of motions, or of a trend on the motions of each
        member, or on each motion. Raises HodoError for a name that no check has, and for motions
        that it is not for."""
        if check["kind"] != "paper":
            return MOTION_CHECKS[check["kind"]](check, motions)
        name = check["name"]
        if name not in self.checks:
            raise HodoError(unknown(f"check {name!r}", name, self.checks))
        if isinstance(self.checks[name], Trend):
            motions = [[m] if isinstance(m, Motion) else m for m in motions]
        try:
            return self.checks[name].judge(motions)
        except (LookupError, TypeError, ValueError) as error:
            raise HodoError(
                f"check {name!r} needs another number of cases, cases of another model, or members"
            ) from error


def by_reading(words: Mapping[str, str], of_all: str) -> str:
    """Words under each reading by its name, once where several have the same, and after `of_all`
    where all have."""
    names: dict[str, list[str]] = {}
    for name, text in words.items():
        names.setdefault(text, []).append(name)
    if len(names) == 1:
        return f"{of_all}{next(iter(names))}"
    return "; ".join(f"{' / '.join(same)}: {text}" for text, same in names.items())


def over_readings(claim: Mapping[str, Any], by_reading: Mapping[str, Verdict]) -> str:
    """The verdict over the readings of a claim."""
    verdicts = [reading.verdict for reading in by_reading.values()]
    holds = [verdict in COMPLYING for verdict in verdicts]
    if NOT_TESTED in verdicts:
        return NOT_TESTED
    # The readings of an erratum are two, as printed and corrected, in this order.
    if claim["erratum"] and holds[0] != holds[1]:
        return AS_PRINTED if holds[0] else ONCE_CORRECTED
    if all(holds):
        weakest = (PLOTTING, REPRODUCED, THEOREM)
        return next(verdict for verdict in weakest if verdict in verdicts)
    # Contradicted only under every reading: the text may have meant the one under which it holds.
    return CONTRADICTED if set(verdicts) == {CONTRADICTED} else UNDERDETERMINED


def by_finding(claim: Mapping[str, Any], finding: Finding) -> Verdict:
    """The verdict on a claim that one finding decides."""
    return Verdict(claim, finding.degree, finding.number, finding.words, finding.contradicted_by)


def proved(verdict: Verdict) -> Verdict:
    """A verdict in the terms of its claim's theorem, which one motion that does not comply
    refutes."""
    if not verdict.claim["theorem"]:
        return verdict
    return replace(verdict, verdict=THEOREM if verdict.verdict in COMPLYING else CONTRADICTED)


def unusable(cases: Sequence[Any], run: ResultFile) -> str:
    """The case that has no result, and why; an empty string if every case has a result."""
    for name in map(case_name, cases):
        ended = {"status": "missing", "message": ""}
        if name in run:
            ended = run.row(name, {"status": str, "message": str})
        if ended["status"] != "ok":
            return f"{name}: {ended['status']} {ended['message']}".rstrip()
    return ""


def _located(entry: str, run: ResultFile, error: HodoError) -> HodoError:
    """An error that names the claim or erratum and the file, once: it may begin with the file."""
    return HodoError(f"{run.path}: {entry}: {str(error).removeprefix(f'{run.path}: ')}")


def of_sweep(claim: Mapping[str, Any], run: ResultFile) -> Finding:
    """The finding of an `average` on the one sweep that the claim names, or on the distance of two.
    Raises HodoError if there is no such sweep."""
    names = [name for name in claim["cases"] if isinstance(name, str)]
    if len(names) not in (1, 2):
        raise HodoError("a check of kind average takes one case, or two whose distance it averages")
    # Late, because it loads xarray, which no other claim needs.
    from ..results.dataset import dataset
    from ..sweeps.view import SweepView

    sweeps = [SweepView.of(name, dataset(run.read(name))) for name in names]
    for swept in sweeps:
        if not swept.case.sweep:
            raise HodoError(f"case {swept.name} is no sweep")
    if len(sweeps) == 2:
        variable, against = claim["check"]["variable"], claim["check"]["against"]
        sweeps = [sweeps[0].distance(sweeps[1], variable, against or variable)]
    return averages(claim["check"], sweeps[0])


@lru_cache(maxsize=64)
def stored_motion(run: ResultFile, name: str) -> Motion:
    """The motion of one case of a result, kept for the next claim about it. Raises HodoError if it
    is damaged."""
    group = run.read(name)
    return motion_of(group.variables, group.attributes, f"{run.path}: {name}", str(run.path))


def gridded(claim: Mapping[str, Any], findings: Mapping[str, Finding]) -> Verdict:
    """The verdict over a grid of the values that the text does not print."""
    worst = max(findings, key=lambda member: findings[member].deviation)
    deviation, holds = findings[worst].deviation, sum(f.holds for f in findings.values())
    disagree = 0 < holds < len(findings)
    size = f"{part_of(deviation)} of the range " if deviation < math.inf else ""
    violation = (
        f"; largest violation {size}at {worst} ({findings[worst].words})" if deviation else ""
    )
    words = f"holds on {holds} of {len(findings)} members{spread(findings)}{violation}"
    verdict = UNDERDETERMINED if disagree else findings[worst].degree
    fewest = "a" if claim["theorem"] else "every"
    contrary = f"{fewest} member with {findings[worst].contradicted_by}"
    return Verdict(claim, verdict, findings[worst].number, words, contrary)


def sampled_verdict(claim: Mapping[str, Any], findings: Mapping[str, Finding]) -> Verdict:
    """The verdict over a sample of the motions that the statement is about."""
    holds = sum(f.holds for f in findings.values())
    share = holds / len(findings)
    words = (
        f"holds for {holds} of {len(findings)} members of a sample ({100 * share:.3g} %)"
        f"{spread(findings)}"
    )
    of_member = next(iter(findings.values())).contradicted_by
    failing = 1 - claim["share"]
    fewest = f"more than {failing:.0%} of the members" if failing else "a member"
    verdict = REPRODUCED if share >= claim["share"] else CONTRADICTED
    return Verdict(claim, verdict, share, words, f"{fewest} with {of_member}")


def spread(findings: Mapping[str, Finding]) -> str:
    """The range of the deciding number over the members, where there is one."""
    numbers = [finding.number for finding in findings.values()]
    return f", {min(numbers):.3g} to {max(numbers):.3g}" if min(numbers) < max(numbers) else ""
