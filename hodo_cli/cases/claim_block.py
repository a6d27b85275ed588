"""What a case file's `claims:` block takes: the statements of a text, and how each of them is checked."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ..schema import kinds
from ..schema.kinds import (
    Choice,
    Integer,
    Key,
    Kind,
    Misnamed,
    Names,
    Number,
    Path,
    Report,
    Sequence,
    Table,
    Text,
    Variant,
    shown,
)
from .sweep_block import Ranges

REPRODUCED, PLOTTING, CONTRADICTED = "reproduced", "reproduced to plotting accuracy", "contradicted"
UNDERDETERMINED, NOT_TESTED = "under-determined", "not tested"
AS_PRINTED = "holds as printed only"
VERDICTS = (REPRODUCED, PLOTTING, AS_PRINTED, UNDERDETERMINED, CONTRADICTED, NOT_TESTED)
"""The verdicts on a statement. One that inherits an erratum holds as printed only."""

CONFIRMED, NOT_CONFIRMED, BY_READING = "confirmed", "not confirmed", "by reading"
MISPRINTS = (CONFIRMED, BY_READING, NOT_CONFIRMED, NOT_TESTED)
"""The verdicts on an erratum; a wrong number of an equation, say, is seen by reading."""

QUANTITIES = {
    "p": "angular velocity about x1",
    "q": "angular velocity about x2",
    "r": "angular velocity about x3",
    "G": "|G|",
    "T": "kinetic energy",
    "x1_direction": "|G1|/|G|, 1 where G lies along x1",
    "separatrix_distance": "|D|/G^2",
    "x": "p^2 + q^2",
    "y": "r^2",
    "Gz": "vertical angular momentum",
    "H": "energy",
    "u1": "first root of the cubic of cos theta",
    "u2": "second root",
    "u3": "third root",
    "crossings": "number of separatrix crossings",
    "first_crossing": "time of the first crossing; infinite without one",
    "turns": "turns of G about the axis that it encloses at the start",
    "area_largest": "largest w_l^2 while the axis l of largest inertia is enclosed, "
    "by the largest coordinate in the plane of w_l^2 and K w_s^2",
    "area_smallest": "largest K w_s^2 while the axis s of smallest inertia is enclosed, likewise",
    "growth_largest": "rate at which a small tilt away from the axis of largest inertia grows",
    "growth_smallest": "rate at which a small tilt away from the axis of smallest inertia grows",
    "end_of_spin": "time at which r reaches 0; infinite if it does not",
    "rebound_u3": "time at which u3 touches 1, where |Gz| = C |r|; infinite if it does not",
}
"""The quantities that a check may name, over time or one number for a motion; `claims.quantities` computes them."""


@dataclass(frozen=True)
class Each:
    """A mapping of any names to values of one kind."""

    kind: Kind
    what: str

    def check(self, value: Any, at: Path, report: Report) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not value:
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return {}
        return {name: self.kind.check(item, (*at, name), report) for name, item in value.items()}

    def schema(self) -> dict[str, Any]:
        return {"type": "object", "additionalProperties": self.kind.schema(), "minProperties": 1}

    def describe(self) -> str:
        return f"a mapping of {self.what}"


@dataclass(frozen=True, init=False)
class Quantity(Choice):
    """The name of a quantity."""

    def describe(self) -> str:
        return "a quantity"


AXIS = Choice("x1", "x2", "x3")
QUANTITY = Quantity(*QUANTITIES)
AT = Key(Choice("start", "end"), "where a quantity over time is taken", default="end")
SEVERAL = Key(Sequence(QUANTITY), "quantities over time")

KINDS: dict[str, dict[str, Key]] = {
    "axis": {
        "start": Key(AXIS, "axis enclosed at the start", default=None),
        "end": Key(AXIS, "axis enclosed at the end", default=None),
    },
    "crossings": {
        "least": Key(Integer(least=0), "the fewest crossings", default=0),
        "most": Key(Integer(least=0), "the most crossings", default=None),
        "from": Key(AXIS, "axis that every crossing leaves", default=None),
        "to": Key(AXIS, "axis that every crossing goes to", default=None),
    },
    "value": {
        "values": Key(Each(Sequence(Number()), "quantities to lists of numbers"), "the values, one for each case"),
        "at": AT,
        "within": Key(Number(least=0), "difference that is allowed: half a unit of the last digit given, say"),
    },
    "bound": {
        "of": Key(QUANTITY, "quantity"),
        "at": Key(Choice("start", "end", "always"), "where a quantity over time is taken", default="end"),
        "least": Key(Number(), "lower bound", default=None),
        "most": Key(Number(), "upper bound", default=None),
    },
    "monotone": {"of": SEVERAL, "sense": Key(Choice("falls", "rises"), "falls or rises, throughout")},
    "order": {
        "of": Key(QUANTITY, "quantity, compared from case to case"),
        "at": AT,
        "sense": Key(Choice("falls", "rises", "equal"), "how the values follow each other"),
        "by": Key(Integer(least=2), "group size (if left out: all cases in one group)", default=None),
    },
    "conserved": {
        "of": SEVERAL,
        "within": Key(Number(least=0), "change that is allowed, relative to the largest value", default=1e-12),
    },
    "average": {
        "variable": Key(Text(), "variable of a sweep, component (`share.x1`), or share of a label (`end_axis.x1`)"),
        "at": Key(
            Sequence(Each(Integer(least=0), "axes to positions, from zero")),
            "positions at which it is averaged over the other axes",
            default=(),
        ),
        "along": Key(
            Names(), "axes; along each, how much the average over the other axes varies is compared", default=()
        ),
        "sense": Key(Choice("falls", "rises", "equal"), "how the averages follow each other", default=None),
        "least": Key(Number(), "lower bound of each average", default=None),
        "most": Key(Number(), "upper bound of each average", default=None),
        "within": Key(Number(least=0), "difference of averages that are called equal", default=1e-12),
    },
    "paper": {"name": Key(Text(), "a check written in Python for one paper (`hodo_cli/claims/paper*.py`)")},
}  # fmt: skip
"""What each kind of check takes."""

CHECK = Variant("kind", KINDS)
ID = Key(Text(), "name")
CASES = Key(Names(), "cases that it concerns", default=())
OVER = Key(Ranges(), "the check is made for every member of this sweep of the cases", default=None)

READING = {
    "cases": CASES,
    "check": Key(CHECK, "how this reading is checked (default: the claim's check)", default=None),
    "over": Key(Ranges(), "members of this reading (default: the claim's)", default=None),
}

CLAIM = {
    "id": ID,
    "where": Key(Text(), "section, figure or equation of the text"),
    "original": Key(Text(), "the statement in the words of the text", default=""),
    "statement": Key(Text(), "what the text says, in one sentence"),
    "cases": CASES,
    "readings": Key(
        Each(Table(READING), "names to cases, and to a check and members of their own"),
        "in the place of `cases`: the ways to read the text, each with its cases; "
        "a statement on which they disagree is under-determined",
        default={},
    ),
    "erratum": Key(
        Text(),
        "erratum that the statement inherits; its readings are the text as printed, and corrected",
        default="",
    ),
    "check": Key(CHECK, "how it is checked", default=None),
    "over": OVER,
    "start": Key(
        AXIS, "leave out the members of `over` that start about another axis", default=None
    ),
    "share": Key(
        Number(above=0, most=1),
        "the members of `over` are a sample, and this share of them must comply "
        "(if left out: they are a grid over what the text leaves open)",
        default=None,
    ),
    "measured": Key(
        Text(), "what is measured in the place of a statement that no check can decide", default=""
    ),
    "expect": Key(Choice(*VERDICTS), "expected verdict; another gives exit status 3"),
    "note": Key(Text(), "remark", default=""),
}
"""The keys of a claim."""

ERRATUM = {
    "id": ID,
    "where": Key(Text(), "section, figure or equation of the text"),
    "printed": Key(Text(), "what is printed"),
    "should_be": Key(Text(), "what it should be"),
    "cases": CASES,
    "check": Key(
        CHECK,
        "shows the printed form wrong and the corrected one right (if left out: seen by reading)",
        default=None,
    ),
    "note": Key(Text(), "remark", default=""),
}
"""The keys of an erratum."""

SweepCheck = Callable[[Mapping[str, Any], Report], None]
"""Reports what keeps a case from making a sweep."""


def readings(claim: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The claim under each of its readings, by name; under none, the claim itself."""
    found: dict[str, Mapping[str, Any]] = {}
    for name, reading in claim["readings"].items():
        own = {key: value for key, value in reading.items() if value is not None}
        found[name] = {**claim, **own, "readings": {}}
    return found or {"": claim}


def cross_check(
    claims: Any, errata: Any, cases: Mapping[str, SweepCheck | None], report: Report
) -> None:
    """Report what joins several keys of the claims and errata as they are given.

    That is ids given twice, cases that are not there, quantities and their numbers, sweeps that a
    case cannot make. A case with mistakes of its own is None.
    """
    wrong = _entries("errata", errata, ERRATUM, report)
    for i, erratum in wrong.items():
        _check_cases(erratum, ("errata", i), cases, report)
    known = [str(erratum.get("id")) for erratum in wrong.values()]
    for i, claim in _entries("claims", claims, CLAIM, report).items():
        _check_claim(claim, ("claims", i), cases, report)
        if (name := claim.get("erratum")) and name not in known:
            report(("claims", i, "erratum"), kinds.unknown(f"erratum {name!r}", name, known))


def _entries(
    section: str, given: Any, keys: Mapping[str, Key], report: Report
) -> dict[int, dict[str, Any]]:
    """The entries of a section that are mappings, by position; an id given twice is reported."""
    found = {}
    seen: set[str] = set()
    for i, item in enumerate(given if isinstance(given, list) else ()):
        found[i] = Table(keys).check(item, (), lambda at, message: None)
        name = found[i].get("id", "")
        if name in seen:
            report((section, i, "id"), f"a second entry {name!r}")
        seen.add(name)
    return found


def _check_claim(
    claim: Mapping[str, Any], at: Path, cases: Mapping[str, SweepCheck | None], report: Report
) -> None:
    """One claim, under each of its readings."""
    if claim.get("erratum") and len(claim.get("readings", {})) != 2:
        report((*at, "readings"), "wants two readings: the text as printed, and corrected")
    if claim.get("readings") and claim.get("cases"):
        report((*at, "cases"), "each reading has its own cases, so leave these out")
    for name, reading in (claim.get("readings") or {"": {}}).items():
        place = (*at, "readings", name) if name else at
        named = (reading if name else claim).get("cases", ())
        if not named:
            report((*place, "cases") if "cases" in claim else at, "names no case")
        _check_cases({"cases": named}, place, cases, report)
        check = reading.get("check") or claim.get("check") or {}
        if not check:
            report(place, "has no check")
        values = (*(place if reading.get("check") else at), "check", "values")
        _check_values(check.get("values", {}), len(named), values, report)
        over = (*(place if reading.get("over") else at), "over")
        if ranges := reading.get("over") or claim.get("over"):
            _check_over(ranges, [cases.get(case) for case in named], over, report)


def _check_cases(
    entry: Mapping[str, Any], at: Path, cases: Mapping[str, Any], report: Report
) -> None:
    for j, name in enumerate(entry.get("cases", ())):
        if name not in cases:
            report((*at, "cases", j), kinds.unknown(f"case {name!r}", name, cases))


def _check_values(values: Mapping[str, Any], count: int, at: Path, report: Report) -> None:
    for name, numbers in values.items():
        if name not in QUANTITIES:
            report((*at, Misnamed(name)), kinds.unknown("quantity", name, QUANTITIES))
        elif len(numbers) != count:
            report((*at, name), f"wants {count} numbers, one for each case")


def _check_over(
    over: Mapping[str, Any], cases: list[SweepCheck | None], at: Path, report: Report
) -> None:
    """The sweep of a claim against each of its cases; what several lack is reported once."""
    told: set[Path] = set()

    def note(where: Path, message: str) -> None:
        # A case's own sweep stands at `sweep`, a claim's at `over`.
        place = (*at, *where[1:])
        if place not in told:
            told.add(place)
            report(place, message)

    for check in cases:
        if check:
            check(over, note)
