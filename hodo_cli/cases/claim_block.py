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
VERDICTS = (REPRODUCED, PLOTTING, CONTRADICTED, UNDERDETERMINED, NOT_TESTED)

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
    "entry_momentum": "largest |G| at a crossing to the axis of smallest inertia; 0 without one",
    "turns": "turns of G about the axis that it encloses at the start",
    "reach_largest": "largest w_l^2 while the axis of largest inertia is enclosed (l is that axis)",
    "reach_smallest": "largest K w_s^2 while the axis of smallest inertia is enclosed (s is that axis)",
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

CLAIM = {
    "id": Key(Text(), "name of the claim"),
    "where": Key(Text(), "section, figure or equation of the text"),
    "statement": Key(Text(), "what the text says, in one sentence"),
    "cases": Key(Names(), "cases that it concerns"),
    "check": Key(Variant("kind", KINDS), "how it is checked"),
    "over": Key(
        Ranges(), "the check is made for every member of this sweep of the cases", default=None
    ),
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


SweepCheck = Callable[[Mapping[str, Any], Report], None]
"""Reports what keeps a case from making a sweep."""


def cross_check(given: Any, cases: Mapping[str, SweepCheck | None], report: Report) -> None:
    """Report what joins several keys of the claims as they are given.

    That is ids given twice, cases that are not there, quantities and their numbers, sweeps that a case cannot make.
    A case with mistakes of its own is None.
    """
    seen: set[str] = set()
    for i, item in enumerate(given if isinstance(given, list) else ()):
        claim = Table(CLAIM).check(item, (), lambda at, message: None)
        at = ("claims", i)
        if claim.get("id") in seen:
            report((*at, "id"), f"a second claim {claim['id']!r}")
        seen.add(claim.get("id", ""))
        named = claim.get("cases", ())
        for j, name in enumerate(named):
            if name not in cases:
                report((*at, "cases", j), kinds.unknown(f"case {name!r}", name, cases))
        _check_values(claim.get("check", {}).get("values", {}), len(named), at, report)
        if over := claim.get("over"):
            _check_over(over, [cases.get(name) for name in named], at, report)


def _check_values(values: Mapping[str, Any], count: int, at: Path, report: Report) -> None:
    for name, numbers in values.items():
        if name not in QUANTITIES:
            report(
                (*at, "check", "values", Misnamed(name)),
                kinds.unknown("quantity", name, QUANTITIES),
            )
        elif len(numbers) != count:
            report((*at, "check", "values", name), f"wants {count} numbers, one for each case")


def _check_over(
    over: Mapping[str, Any], cases: list[SweepCheck | None], at: Path, report: Report
) -> None:
    """The sweep of a claim against each of its cases; what several cases lack is reported once."""
    told: set[Path] = set()

    def note(where: Path, message: str) -> None:
        # A case's own sweep stands at `sweep`, a claim's at `over`.
        place = (*at, "over", *where[1:])
        if place not in told:
            told.add(place)
            report(place, message)

    for check in cases:
        if check:
            check(over, note)
