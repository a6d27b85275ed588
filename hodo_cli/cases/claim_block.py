"""What a case file's `claims:` block takes: the statements of a text, and how each of them is
checked."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..schema import kinds
from ..schema.kinds import (
    Choice,
    Data,
    Either,
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
    Vector,
    shown,
)

REPRODUCED, PLOTTING, CONTRADICTED = "reproduced", "reproduced to plotting accuracy", "contradicted"
UNDERDETERMINED, NOT_TESTED = "under-determined", "not tested"
VERDICTS = (REPRODUCED, PLOTTING, CONTRADICTED, UNDERDETERMINED, NOT_TESTED)

SERIES = {
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
    "order_of_roots": "the least of u1 + 1, u2 - u1, 1 - u2 and u3 - 1",
}
"""Quantities over time, with their meaning."""

NUMBERS = {
    "crossings": "number of separatrix crossings",
    "first_crossing": "time of the first crossing",
    "entry_momentum": "the largest |G| at a crossing to the axis of smallest inertia; 0 without one",
    "turns": "turns of G about the axis that it encloses, all told",
    "reach_largest": "the largest w_l^2 while the axis of largest inertia is enclosed (l is that axis)",
    "reach_smallest": "the largest K w_s^2 while the axis of smallest inertia is enclosed (s is that axis)",
    "decay": "mean rate of decay of |G|",
    "last_sign_change_r": "time of the last change of sign of r",
    "first_sign_change_p": "time of the first change of sign of p",
    "end_of_spin": "time at which r reaches 0; infinite if it does not",
    "x_at_end_of_spin": "x where r reaches 0",
    "rate_per_turn": "the largest relative change of x or y in the first turn of (p, q), at its initial rate",
    "rebound_u3": "time at which u3 touches 1, where |Gz| = C |r|; infinite if it does not",
    "roughness": "the largest second derivative of Gz, H, u1, u2, u3, in units of range and time for 9/10 of it",
}
"""Quantities that are one number for a motion, with their meaning."""

FORMS = {
    "free-rotation": "omega by Euler's and Jacobi's closed form, with any start",
    "free-rotation-from-q0": "omega by the closed form for q = 0, with time counted from a passage of q through 0",
    "equation-6": "omega by P1 eqs (5)-(6) as printed, the better of its two signs",
    "turning-axis": "the axis of largest or smallest inertia whose component of G keeps its sign, for the label",
    "inequality-7": "the sign of p^2 - K r^2, with K by the moments of inertia alone, for that of G^2 - 2 T A2",
    "equation-2.5": "Gz, H and r from u1, u2, u3 by P3 eq (2.5), with the signs of R and delta followed in time",
    "equation-2.5-frozen": "the same with the signs of R and delta that they have at the start",
    "equation-3.3": "r by P3 eq (3.3), for r from u1, u2, u3 by eq (2.5)",
}
"""Closed forms, and what each is a formula for."""


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
        return "a quantity over time" if self.names == tuple(SERIES) else "a quantity"


AXIS = Choice("x1", "x2", "x3")
ANY = Quantity(*SERIES, *NUMBERS)
OF = Key(ANY, "quantity")
AT = Key(Choice("start", "end"), "where a quantity over time is taken", default="end")
SEVERAL = Key(Sequence(Quantity(*SERIES)), "quantities")
WITHIN = "error that is allowed, relative to the largest value"

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
        "of": OF,
        "at": Key(Choice("start", "end", "always"), "where a quantity over time is taken", default="end"),
        "least": Key(Number(), "lower bound", default=None),
        "most": Key(Number(), "upper bound", default=None),
    },
    "monotone": {"of": SEVERAL, "sense": Key(Choice("falls", "rises"), "the way it goes, all the time")},
    "order": {
        "of": Key(Sequence(ANY), "a quantity, in the order of the cases; or several, in this order, of each case"),
        "at": AT,
        "sense": Key(Choice("falls", "rises", "equal"), "how the values follow each other"),
        "by": Key(Integer(least=2), "so many cases at a time (if left out: all)", default=None),
    },
    "conserved": {"of": SEVERAL, "within": Key(Number(least=0), WITHIN, default=1e-12)},
    "closed-form": {
        "form": Key(Choice(*FORMS), "formula"),
        "within": Key(Number(least=0), WITHIN, default=1e-10),
        "differs": Key(Choice("yes", "no"), "whether the statement is that the formula does not hold", default="no"),
    },
    "event": {
        "event": Key(Text(), "kind of event"),
        "happens": Key(Choice("yes", "no"), "whether it happens in finite time"),
    },
    "convergence": {
        "of": SEVERAL,
        "epsilon": Key(Sequence(Number(above=0)), "values of epsilon, falling"),
        "order": Key(Number(above=0), "power of epsilon as which each second case nears the one before it"),
    },
    "effect": {
        "of": OF,
        "at": AT,
        "larger": Key(
            Choice("first", "second"),
            "the factor of larger effect, over cases at (low, low), (high, low), (low, high), (high, high)",
        ),
    },
    "members": {
        "variable": Key(Text(), "variable of a sweep, component (`share.x1`), or share of a label (`end_axis.x1`)"),
        "at": Key(
            Sequence(Each(Integer(least=0), "axes to positions, from zero")),
            "where it is averaged over the other axes, once or several times",
        ),
        "sense": Key(Choice("falls", "rises", "equal"), "how the averages follow each other", default=None),
        "least": Key(Number(), "lower bound of each average", default=None),
        "most": Key(Number(), "upper bound of each average", default=None),
        "within": Key(Number(least=0), "difference of averages that are called equal", default=1e-12),
    },
    "axes": {
        "variable": Key(Text(), "variable of a sweep"),
        "larger": Key(Text(), "axis along which its average over the others varies more"),
        "smaller": Key(Text(), "axis along which it varies less"),
    },
}  # fmt: skip
"""What each kind of check takes."""

GIVEN = Either(Number(), Data())
OVER = Table(
    {
        "grid": Key(
            Each(Sequence(GIVEN), "keys (damping.2) to lists of values"),
            "every combination is a member",
            default=None,
        ),
        "random": Key(
            Each(Vector(2), "keys (damping.2) to two limits"), "uniform random values", default=None
        ),
        "start": Key(
            Choice("x1", "x3", "any"),
            "random starts with |G| = 1 that enclose this axis",
            default=None,
        ),
        "members": Key(Integer(least=1, most=100_000), "number of random members", default=100),
        "seed": Key(Integer(least=0), "seed of the random numbers", default=1),
        "set": Key(
            Each(GIVEN, "keys (time.end) to values"), "values for all members", default=None
        ),
        "share": Key(
            Number(above=0, most=1), "share of the random members that must comply", default=1.0
        ),
    }
)

CLAIM = {
    "id": Key(Text(), "name of the claim"),
    "where": Key(Text(), "section, figure or equation of the text"),
    "statement": Key(Text(), "what the text says, in one sentence"),
    "cases": Key(Names(), "cases that it concerns"),
    "check": Key(Variant("kind", KINDS), "how it is checked"),
    "over": Key(OVER, "the check is made for variations of the cases: a grid over what is not printed, or a sample",
                default=None),
    "measured": Key(Text(), "what is measured in the place of a statement that no check can decide", default=""),
    "expect": Key(Choice(*VERDICTS), "the verdict that stands; another is an error"),
    "note": Key(Text(), "remark", default=""),
}  # fmt: skip
"""The keys of a claim."""


def cross_check(given: Any, cases: Mapping[str, Any], report: Report) -> None:
    """Report what joins several keys of the claims as they are given.

    That is ids given twice, cases that are not there, quantities and their numbers, keys that a
    case does not have. `cases` are the values of each case, nested; None for one with mistakes of
    its own.
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
        for name, values in claim.get("check", {}).get("values", {}).items():
            if name not in SERIES and name not in NUMBERS:
                report(
                    (*at, "check", "values", Misnamed(name)),
                    kinds.unknown("quantity", name, [*SERIES, *NUMBERS]),
                )
            elif len(values) != len(named):
                report(
                    (*at, "check", "values", name), f"wants {len(named)} numbers, one for each case"
                )
        over = claim.get("over") or {}
        for part in ("grid", "random", "set"):
            for path in over.get(part) or ():
                if lacking := [
                    name
                    for name in named
                    if cases.get(name) and not reaches(cases[name], path.split("."))
                ]:
                    report((*at, "over", part, Misnamed(path)), f"is no key of case {lacking[0]}")


def reaches(values: Any, path: list[str]) -> bool:
    """Whether there is a value at a path within nested ones."""
    for part in path:
        if isinstance(values, Mapping) and part in values:
            values = values[part]
        elif isinstance(values, tuple) and part.isdecimal() and int(part) < len(values):
            values = values[int(part)]
        else:
            return False
    return True
