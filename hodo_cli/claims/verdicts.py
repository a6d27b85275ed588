"""Verdicts: over the motions of a result, a grid of what a text leaves open, a sample, or a stored
sweep.

Where a text leaves a value open, the check is made over a grid of values, and a statement that
holds on a part of the grid is under-determined. A statement about all motions of a kind is checked
on a sample of them, a share of which must comply. No result stores the motions of such members, or
of cases with other values: they are integrated here.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, FrozenDict, frozen, variation
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
    READ_AS_PRINTED,
    READ_CORRECTED,
    REPRODUCED,
    THEOREM,
    UNDERDETERMINED,
    case_name,
    cases_of,
    checks_of_papers,
    readings,
)
from ..cases.sweep_block import Axis, axes_of, first_values
from ..integration import body_of
from ..models import rigid_body
from ..results.layout import without_old_labels
from ..results.motion import Motion, case_of, motion_of
from ..schema.kinds import Wrong
from ..storage import ResultFile
from ..sweeps.members import members_as_cases, side_by_side
from ..text import grouped
from .checks import averages, motion_finding
from .finding import ROUNDING, Finding, Undecidable, Verdict, in_percent
from .measures import (
    FEWEST_A_STEP,
    check_followed,
    followed,
    integrated_motion,
    sampled_motion,
)


@lru_cache(maxsize=16)
def members(
    cases: tuple[Case, ...], over: FrozenDict, start: str | None
) -> Mapping[str, Sequence[Case]]:
    """The members of a sweep over several cases, by name: each member holds one variation of each
    case. They are kept for the next claim about them.

    With `start`, only the members in which every case starts about this axis. Raises HodoError for
    a member whose data make no body.
    """
    axes = axes_of(over)
    shape = tuple(map(len, axes))
    numbers = np.arange(math.prod(shape))
    names = [member_name(axes, np.unravel_index(i, shape)) for i in numbers]
    by_case = []
    for case in cases:
        data = {**case.data, **first_values(over, type(case.system), case.data)}
        varied = members_as_cases(replace(case, sweep=over, data=data), numbers, None)
        # Messages name a member by its values, because its number in the grid says nothing.
        of_case = [
            replace(member, name=f"{case.name} with {name}")
            for name, member in zip(names, varied, strict=True)
        ]
        for number, member in enumerate(of_case):
            for mistake in type(member.system).check(member.data):
                raise HodoError(f"member {case.name}.{number}: {mistake}")
        by_case.append(of_case)
    return {
        name: of_member
        for name, of_member in zip(names, zip(*by_case, strict=True), strict=True)
        if start is None or all(starting_axis(case) == start for case in of_member)
    }


def member_name(axes: Sequence[Axis], index: Sequence[Any]) -> str:
    """The name of a member: its values, and its number on a sphere."""
    words = []
    for axis, i in zip(axes, index, strict=True):
        values = [
            f"{key} = {axis.values(j, np.array([i]))[0]:g}" for j, key in enumerate(axis.keys)
        ]
        words += values or [f"{axis.name} {i}"]
    return ", ".join(words)


def starting_axis(case: Case) -> str:
    """The axis that the hodograph of a body-frame case encloses at the start."""
    labels = body_of(case).enclosed(np.array([case.system.start[:3]]), ROUNDING)
    return rigid_body.LABELS[int(labels[0])]


def changed_case(case: Case, changes: Mapping[str, Any]) -> Case:
    """A case with other values at some keys. Raises HodoError for a value that it cannot have."""
    try:
        return variation(case, changes)
    except Wrong as error:
        raise HodoError(f"a variation of case {case.name}: {error}") from None


MOST_VARIED_SAMPLES = 5_000_000
"""How many samples are integrated side by side, and kept for the next claim: some 500 MB."""


@dataclass
class Motions:
    """The motions of varied cases, each integrated once for all claims that share it, as far as
    memory allows."""

    _known: dict[Case, Motion] = field(default_factory=dict)

    def of(self, members: Sequence[Sequence[Case]], along: bool = False) -> Iterator[list[Motion]]:
        """The motions of each member's cases; with `along`, with samples that follow them. Raises
        Undecidable if a motion stops before its end."""
        if along:
            members = [[*map(followed, cases)] for cases in members]
        # Members are integrated in blocks that fit into memory.
        size = max(1, MOST_VARIED_SAMPLES // sum(case.time.samples for case in members[0]))
        for i in range(0, len(members), size):
            if sum(len(m.time) for m in self._known.values()) > MOST_VARIED_SAMPLES:
                self._known.clear()
            block = members[i : i + size]
            self._integrate(itertools.chain(*block))
            if along:
                block = self._finer(block)
            yield from ([self._known[case] for case in cases] for cases in block)

    def _finer(self, members: Sequence[Sequence[Case]]) -> list[list[Case]]:
        """The cases of members. A case whose motion has few samples to a step of its method is
        replaced by one with more samples, which is integrated."""
        motions = {case: self._known[case] for case in itertools.chain(*members)}
        steps = {case: m.attrs["steps"] for case, m in motions.items()}
        sparse = {case for case, m in motions.items() if len(m.time) < FEWEST_A_STEP * steps[case]}
        # The same number of steps for all, so that they are integrated side by side.
        most = max((steps[case] for case in sparse), default=0)
        finer = {case: followed(case, most) for case in sparse}
        self._integrate(finer.values())
        return [[finer.get(case, case) for case in cases] for cases in members]

    def _integrate(self, cases: Iterable[Case]) -> None:
        """Integrate the cases that are not yet known, side by side where that is possible."""
        new = [case for case in dict.fromkeys(cases) if case not in self._known]
        for case, found in zip(new, side_by_side(new), strict=True):
            self._known[case] = sampled_motion(*found) if found else integrated_motion(case)


@dataclass(frozen=True)
class Judge:
    """The judge of claims and errata by the cases of one result. `paper_check` returns the finding
    of a check that is written for one text, by its name, from motions."""

    run: ResultFile
    paper_check: Callable[[str, Sequence[Any]], Finding]
    varied: Motions = field(default_factory=Motions)

    def claim(self, claim: Mapping[str, Any]) -> Verdict:
        """The verdict on one claim.

        Raises HodoError if a case is not classified, or lacks what the check needs.
        """
        if not claim["readings"]:
            return self._reading(claim)
        verdicts = {name: self._reading(reading) for name, reading in readings(claim).items()}
        first = next(iter(verdicts.values()))
        evidence = by_reading(
            {name: f"{v.word} ({v.finding.evidence})" for name, v in verdicts.items()},
            "every reading: ",
        )
        contrary = by_reading({name: v.finding.contradicted_by for name, v in verdicts.items()}, "")
        finding = Finding(
            math.nan, number=first.finding.number, evidence=evidence, contradicted_by=contrary
        )
        return Verdict(over_readings(verdicts), finding, verdicts)

    def erratum(self, erratum: Mapping[str, Any]) -> Verdict:
        """The verdict on a misprint: whether the printed form is wrong and the corrected one right.
        Raises as `claim`."""
        if not cases_of(erratum):
            return undecided(BY_READING)
        verdict = self.claim(erratum)
        if verdict.word == NOT_TESTED:
            return verdict
        finding, is_shown = verdict.finding, verdict.word in COMPLYING
        if erratum["readings"]:
            corrected = verdict.readings[READ_CORRECTED].finding.contradicted_by
            contrary = f"a corrected form with {corrected}, or a printed one without"
            finding = replace(finding, contradicted_by=contrary)
            is_shown = verdict.word == ONCE_CORRECTED
        return replace(verdict, word=CONFIRMED if is_shown else NOT_CONFIRMED, finding=finding)

    def _reading(self, claim: Mapping[str, Any]) -> Verdict:
        """The verdict on a claim without readings."""
        try:
            check_usable(claim, self.run)
            if claim["check"]["kind"] == "average":
                return by_finding(of_sweep(claim, self.run))
            verdict = self._measured(claim)
        except Undecidable as error:
            return undecided(NOT_TESTED, str(error))
        if not claim["theorem"]:
            return verdict
        # One motion that does not comply refutes a theorem.
        return replace(verdict, word=THEOREM if verdict.word in COMPLYING else CONTRADICTED)

    def _case(self, entry: Any) -> Case:
        """The case of an entry of `cases:`, as stored or with other values."""
        name = case_name(entry)
        case = case_of(self.run.row(name, {"case": str}), f"{self.run.path}: {name}")
        if isinstance(entry, str):
            return case
        return changed_case(case, {key: value for key, value in entry.items() if key != "case"})

    def _motions(self, check: Mapping[str, Any], entries: Sequence[Any]) -> list[Motion]:
        """The motions of entries of `cases:`, in order: as stored, or integrated where they have
        other values or where the check is decided along the motion."""
        along = is_of_course(check)
        stored = [stored_motion(self.run, x) if isinstance(x, str) else None for x in entries]
        new = [
            self._case(x)
            for x, of_case in zip(entries, stored, strict=True)
            if along or not of_case
        ]
        # `varied` takes the new cases as those of a single member.
        varied = iter(next(self.varied.of([new], along)) if new else ())
        if along:
            return [with_errors(m, x) if x else m for m, x in zip(varied, stored, strict=True)]
        return [of_case or next(varied) for of_case in stored]

    def _measured(self, claim: Mapping[str, Any]) -> Verdict:
        """The verdict on a claim by the motions of its cases, in order, or by the members of its
        `over:`. Raises as `claim`."""
        check = claim["check"]
        if not claim["over"]:
            return by_finding(self._decide(check, self._motions(check, claim["cases"])))
        cases = tuple(map(self._case, claim["cases"]))
        varied = members(cases, frozen(claim["over"]), claim["start"])
        if not varied:
            raise HodoError(f"no member starts about {claim['start']}")
        by_member = self.varied.of([*varied.values()], is_of_course(check))
        # A trend is about all members at once: no single member decides it.
        if check["kind"] == "paper" and checks_of_papers()[check["name"]][1] == "trends":
            return by_finding(self._decide(check, [*by_member]))
        findings: dict[str, Finding] = {}
        remarks: list[str] = []
        for name, of_member in zip(varied, by_member, strict=True):
            try:
                findings[name] = self._decide(check, of_member)
            except Undecidable as error:
                remarks.append(str(error))
        return over_members(claim, findings, remarks)

    def _decide(self, check: Mapping[str, Any], motions: Sequence[Any]) -> Finding:
        """The finding of one check on one set of motions, or of a trend on the motions of each
        member. Raises HodoError if the check is not for their models."""
        if is_of_course(check):
            for m in motions:
                check_followed(m)
        if check["kind"] != "paper":
            return motion_finding(check, motions)
        name = check["name"]
        try:
            return self.paper_check(name, motions)
        except (LookupError, TypeError, ValueError, ZeroDivisionError) as error:
            raise HodoError(
                f"check {name!r} needs another number of cases, cases of another model, or members"
            ) from error


def by_reading(words: Mapping[str, str], of_all: str) -> str:
    """Words about each reading, by its name, in one sentence. Equal words occur once, after the
    names of all their readings or, if every reading has the same words, after `of_all`."""
    names = grouped((text, name) for name, text in words.items())
    if len(names) == 1:
        return f"{of_all}{next(iter(names))}"
    return "; ".join(f"{' / '.join(same)}: {text}" for text, same in names.items())


def over_readings(by_reading: Mapping[str, Verdict]) -> str:
    """The verdict over the readings of a claim or an erratum."""
    words = {reading.word for reading in by_reading.values()}
    if NOT_TESTED in words:
        return NOT_TESTED
    if words <= {*COMPLYING}:
        return next(word for word in (PLOTTING, REPRODUCED, THEOREM) if word in words)
    # Contradicted only under every reading: the text may have meant the one under which it holds.
    if words == {CONTRADICTED}:
        return CONTRADICTED
    holding = [name for name, reading in by_reading.items() if reading.word in COMPLYING]
    if not holding or by_reading.keys() != {READ_AS_PRINTED, READ_CORRECTED}:
        return UNDERDETERMINED
    return AS_PRINTED if holding == [READ_AS_PRINTED] else ONCE_CORRECTED


def by_finding(finding: Finding) -> Verdict:
    """The verdict on a claim that one finding decides."""
    return Verdict(finding.degree, finding)


def undecided(word: str, evidence: str = "") -> Verdict:
    """A verdict without a deciding finding, with its reason."""
    return Verdict(word, Finding(math.nan, number=math.nan, evidence=evidence))


def check_usable(claim: Mapping[str, Any], run: ResultFile) -> None:
    """Raise Undecidable if this version lacks the check of a claim, or the result one of its
    cases."""
    check = claim["check"]
    if check["kind"] == "paper" and check["name"] not in checks_of_papers():
        raise Undecidable(f"this version has no check {check['name']!r}")
    for name in map(case_name, claim["cases"]):
        if name not in run:
            raise Undecidable(f"{name}: missing")
        ended = run.row(name, {"status": str, "message": str})
        if ended["status"] != "ok":
            raise Undecidable(f"{name}: {ended['status']} {ended['message']}".rstrip())


def of_sweep(claim: Mapping[str, Any], run: ResultFile) -> Finding:
    """The finding of an `average` on the single sweep of a claim, or on the distance of two
    sweeps."""
    # Imported late, because it loads xarray, which no other claim needs.
    from ..results.dataset import dataset
    from ..sweeps.view import SweepView

    swept, *other = (SweepView.of(name, dataset(run.read(name))) for name in claim["cases"])
    variable, against = claim["check"]["variable"], claim["check"]["against"]
    for view, name in zip((swept, *other), (variable, against or variable), strict=False):
        if reason := view.undivided(name):
            raise Undecidable(f"case {view.name}: {reason}")
    if other:
        swept = swept.distance(other[0], variable, against or variable)
    return averages(claim["check"], swept)


@lru_cache(maxsize=64)
def stored_motion(run: ResultFile, name: str) -> Motion:
    """The motion of one case of a result, kept for the next claim about it. Raises HodoError if it
    is damaged."""
    group = run.read(name)
    variables = without_old_labels(group.variables)
    return motion_of(variables, group.attributes, f"{run.path}: {name}", str(run.path))


READ_ALONG = {
    *("turns", "visible_turns_x1", "visible_turns_x3", "area_largest", "area_smallest"),
    *("end_of_spin", "rebound_u3"),
}
"""The single numbers that follow from the course of a motion."""


def is_of_course(check: Mapping[str, Any]) -> bool:
    """Whether a check is decided along the motion, and not by its last sample and its events."""
    if check["kind"] in ("monotone", "conserved", "formula") or check.get("turns"):
        return True
    named = {check.get("of"), *check.get("values", ())}
    # The first stored sample may be later than the start.
    return check.get("at", "end") != "end" or bool(named & READ_ALONG)


def with_errors(m: Motion, stored: Motion) -> Motion:
    """A motion with the crossings, events and measured errors of the stored one."""
    measured = {k: v for k, v in stored.data.items() if k.startswith(("crossing", "event"))}
    return replace(m, data={**m.data, **measured}, attrs=stored.attrs, path=stored.path)


def over_some(claim: Mapping[str, Any], holds: int, total: int) -> str:
    """The verdict on a statement that holds, to plotting accuracy at least, for `holds` of `total`
    members of `over`. A statement that holds on a part of a grid of values that the text leaves
    open is under-determined; one member refutes a theorem."""
    share = 1 if claim["share"] is None else claim["share"]
    if holds / total >= share:
        return REPRODUCED
    is_open = holds and claim["share"] is None and not claim["theorem"]
    return UNDERDETERMINED if is_open else CONTRADICTED


def over_members(
    claim: Mapping[str, Any], findings: Mapping[str, Finding], remarks: Sequence[str]
) -> Verdict:
    """The verdict over the members of `over`: a grid of the values that the text does not print or,
    with `share`, a sample of the motions that the statement is about.

    Each undecided member has a remark. Raises Undecidable with the first remark if the verdict
    depends on what these members would give.
    """
    holds, total = sum(f.holds for f in findings.values()), len(findings) + len(remarks)
    word = over_some(claim, holds, total)
    if word != over_some(claim, holds + len(remarks), total):
        others = f" (open for {len(remarks)} of {total} members)" if total > 1 else ""
        raise Undecidable(f"{remarks[0]}{others}")
    numbers = [f.number for f in findings.values()]
    spread = f", {min(numbers):.3g} to {max(numbers):.3g}" if min(numbers) < max(numbers) else ""
    spread += f"; open for {len(remarks)}: {remarks[0]}" if remarks else ""
    worst, finding = max(findings.items(), key=lambda member: member[1].deviation)
    if (share := claim["share"]) is not None:
        fewest = f"more than {100 * (1 - share):.3g} % of the members" if share < 1 else "a member"
        finding = replace(finding, number=holds / total)
        evidence = f"holds for {holds} of {total} members of a sample ({100 * holds / total:.3g} %)"
    else:
        fewest = "a member" if claim["theorem"] else "every member"
        # The worst member may hold to plotting accuracy alone.
        word = finding.degree if holds == total else word
        evidence = f"holds on {holds} of {total} members"
        is_sized = finding.deviation < math.inf
        size = f"{in_percent(finding.deviation)} of the range " if is_sized else ""
        violation = f"; largest violation {size}at {worst} ({finding.evidence})"
        spread += violation if finding.deviation else ""
    contrary = f"{finding.contradicted_by}, for {fewest}"
    return Verdict(word, replace(finding, evidence=evidence + spread, contradicted_by=contrary))
