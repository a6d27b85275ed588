"""What a case file's `claims:` block takes: the statements of a text, and how each of them is
checked."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from ..schema.kinds import (
    NAMES,
    Choice,
    Each,
    Either,
    Integer,
    Key,
    KeyPath,
    ListOf,
    Mapped,
    Mistake,
    Number,
    Table,
    Text,
    Variant,
    Wrong,
    WrongKey,
    check_keys,
    unknown_names,
    within,
)
from .figure_block import FORMULA
from .sweep_block import SWEEP, axes_of

REPRODUCED, PLOTTING, CONTRADICTED = "reproduced", "reproduced to plotting accuracy", "contradicted"
UNDERDETERMINED, NOT_TESTED = "under-determined", "not tested"
THEOREM = "holds by theorem"
AS_PRINTED, ONCE_CORRECTED = "reproduced as printed only", "reproduced once corrected"
COMPLYING = (REPRODUCED, THEOREM, PLOTTING)
VERDICTS = (*COMPLYING, AS_PRINTED, ONCE_CORRECTED, UNDERDETERMINED, CONTRADICTED, NOT_TESTED)
"""The verdicts on a statement; the first ones say that it holds. One that rests on an erratum holds
as printed only, or once corrected."""

CONFIRMED, NOT_CONFIRMED, BY_READING = "confirmed", "not confirmed", "by reading"
MISPRINTS = (CONFIRMED, BY_READING, NOT_CONFIRMED, NOT_TESTED)
"""The verdicts on an erratum; a wrong number of an equation, say, is seen by reading."""

QUANTITY_NAMES = {
    "p": "angular velocity about x1",
    "q": "angular velocity about x2",
    "r": "angular velocity about x3",
    "G": "|G|",
    "T": "kinetic energy",
    "x1_direction": "|G1|/|G|, 1 where G lies along x1",
    "tilt": "angle between G and x3, in radians",
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
"""The quantities that a check may name, over time or one number for a motion; `claims.quantities`
computes them."""


AXIS = Choice("x1", "x2", "x3")
QUANTITY = Choice(*QUANTITY_NAMES, title="a quantity")
AT = Key(Choice("start", "end"), "where a quantity over time is taken", default="end")
SEVERAL = Key(ListOf(QUANTITY), "quantities over time")

CHECK_KINDS: dict[str, dict[str, Key]] = {
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
        "values": Key(
            Each(ListOf(Number()), "quantities to lists of numbers"),
            "the values, one for each case",
        ),
        "at": AT,
        "within": Key(
            Number(least=0), "difference allowed, such as half a unit of the last digit printed"
        ),
    },
    "bound": {
        "of": Key(QUANTITY, "quantity"),
        "at": Key(
            Choice("start", "end", "always"), "where a quantity over time is taken", default="end"
        ),
        "least": Key(Number(), "lower bound", default=None),
        "most": Key(Number(), "upper bound", default=None),
    },
    "monotone": {
        "of": SEVERAL,
        "sense": Key(Choice("falls", "rises"), "falls or rises, throughout"),
    },
    "order": {
        "of": Key(QUANTITY, "quantity, compared from case to case"),
        "at": AT,
        "sense": Key(Choice("falls", "rises", "equal"), "how the values follow each other"),
        "by": Key(Integer(least=2), "group size (default: all cases in one group)", default=None),
    },
    "conserved": {
        "of": SEVERAL,
        "within": Key(
            Number(least=0), "change allowed, relative to the largest value", default=1e-12
        ),
    },
    "formula": {
        "of": Key(QUANTITY, "quantity over time"),
        "formula": Key(FORMULA, "the law that it follows"),
        "within": Key(
            Number(least=0), "difference allowed, relative to the largest value", default=1e-12
        ),
    },
    "average": {
        "variable": Key(
            Text(),
            "variable of a sweep, component (`share.x1`), or share of a label (`end_axis.x1`)",
        ),
        "against": Key(
            Text(),
            "where two sweeps are named: the variable of the second (default: the same); averaged "
            "is the distance of the two, or 1 where labels differ",
            default=None,
        ),
        "at": Key(
            ListOf(Each(Integer(least=0), "axes to positions, from zero")),
            "positions at which it is averaged over the other axes",
            default=(),
        ),
        "along": Key(
            NAMES,
            "axes to compare: by how much the average over the others varies along each",
            default=(),
        ),
        "sense": Key(
            Choice("falls", "rises", "equal"), "how the averages follow each other", default=None
        ),
        "least": Key(Number(), "lower bound of each average", default=None),
        "most": Key(Number(), "upper bound of each average", default=None),
        "within": Key(
            Number(least=0), "largest difference of averages that count as equal", default=1e-12
        ),
    },
    "paper": {
        "name": Key(
            Text(), "a check written in Python for one text (a function in `hodo_cli/papers/`)"
        )
    },
}
"""The keys of each kind of check."""

CHECK = Variant("kind", CHECK_KINDS, "how it is checked")
ID = Key(Text(), "name")
WHERE = Key(Text(), "section, figure or equation of the text")
REMARK = Key(Text(), "remark", default="")
THEOREM_KEY = Key(
    Text(),
    "why it holds for all motions of the kind; the cases, or each member of `over`, try it, and "
    "one that does not comply contradicts it",
    default="",
)
CASES = Key(
    ListOf(
        Either(Text(), Mapped()),
        least=0,
        alone=True,
        title="a name, a mapping of `case` to a name and of keys to other values, "
        "or a list of these",
    ),
    "cases that it concerns; one with other values is integrated for this statement, and is no "
    "case of the result",
    default=(),
)
CLAIM = {
    "id": ID,
    "where": WHERE,
    "original": Key(Text(), "the statement in the words of the text", default=""),
    "statement": Key(Text(), "what the text says, in one sentence"),
    "cases": CASES,
    "readings": Key(
        Each(
            Table(
                {
                    "cases": CASES,
                    "check": Key(
                        CHECK,
                        "how this reading is checked (default: the claim's check)",
                        default=None,
                    ),
                    "over": Key(
                        SWEEP, "members of this reading (default: the claim's)", default=None
                    ),
                    "theorem": THEOREM_KEY,
                }
            ),
            "names to cases, and to a check and members of their own",
        ),
        "instead of `cases`: the ways to read the text, each with its cases; "
        "a statement on which they disagree is under-determined",
        default={},
    ),
    "erratum": Key(
        Text(),
        "erratum that the statement inherits; its readings are the text as printed, and corrected",
        default="",
    ),
    "check": Key(CHECK, "how it is checked", default=None),
    "over": Key(SWEEP, "ranges of keys: the statement is checked for every member", default=None),
    "start": Key(
        AXIS, "leaves out the members of `over` that start about another axis", default=None
    ),
    "share": Key(
        Number(above=0, most=1),
        "the members of `over` are a sample, and this share of them must comply "
        "(default: they are a grid over what the text leaves open)",
        default=None,
    ),
    "theorem": THEOREM_KEY,
    "measured": Key(
        Text(), "what is measured instead, if no check can decide the statement itself", default=""
    ),
    "expect": Key(Choice(*VERDICTS), "expected verdict; another gives exit status 3"),
    "note": REMARK,
}
"""The keys of a claim."""

ERRATUM_KEYS = {
    "id": ID,
    "where": WHERE,
    "printed": Key(Text(), "what is printed"),
    "should_be": Key(Text(), "what it should be"),
    "cases": CASES,
    "check": Key(
        CHECK,
        "shows that the printed form is wrong and the corrected one right "
        "(default: reading shows it)",
        default=None,
    ),
    "note": REMARK,
}
"""The keys of an erratum."""

SweepCheck = Callable[[Mapping[str, Any]], Iterable[Mistake]]
"""The mistakes of a sweep of a case."""

CaseCheck = Callable[[Any], SweepCheck | None]
"""The check of sweeps of a case, by an entry of `cases:`; None for a case that has mistakes of its
own. Raises Wrong for an entry that describes no case."""


def readings(claim: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The claim under each of its readings, by name; under none, the claim itself."""
    merged: dict[str, Mapping[str, Any]] = {}
    for name, reading in claim.get("readings", {}).items():
        changes = {key: value for key, value in reading.items() if value not in (None, "")}
        merged[name] = {**claim, **changes, "readings": {}}
    return merged or {"": claim}


def cases_of(entry: Mapping[str, Any]) -> list[str]:
    """The names of the cases of a claim, under all its readings, or of an erratum, each once."""
    named = (case_name(case) for reading in readings(entry).values() for case in reading["cases"])
    return list(dict.fromkeys(named))


def case_name(case: Any) -> str:
    """The name in an entry of `cases:`, of a case as it is or with other values."""
    return str(case["case"] if isinstance(case, Mapping) else case)


def cross_check(claims: Any, errata: Any, case_check: CaseCheck) -> Iterator[Mistake]:
    """The mistakes that only several keys of the claims and errata show together: ids given twice,
    cases that are not there, quantities and their numbers, sweeps that a case cannot make."""
    ids: dict[str, list[str]] = {"errata": [], "claims": []}
    entries = [*_entries("errata", errata, ERRATUM_KEYS), *_entries("claims", claims, CLAIM)]
    for (section, i), entry in entries:
        is_claim, cases = section == "claims", entry.get("cases", ())
        of_entry = (
            _check_claim(entry, case_check) if is_claim else _check_cases(cases, case_check)[0]
        )
        mistakes = [*of_entry]
        if (name := entry.get("id", "")) in ids[section]:
            mistakes.append((("id",), f"a second entry {name!r}"))
        ids[section].append(name)
        if name := entry.get("erratum", ""):
            mistakes += unknown_names("erratum", {("erratum",): name}, ids["errata"])
        yield from within((section, i), mistakes)


def _entries(
    name: str, section: Any, keys: Mapping[str, Key]
) -> Iterator[tuple[tuple[str, int], dict[str, Any]]]:
    """The valid values of each entry of a section that is a mapping, with its place."""
    for i, item in enumerate(section if isinstance(section, list) else ()):
        if isinstance(item, Mapping):
            yield (name, i), check_keys(keys, item)[0]


def _check_claim(claim: Mapping[str, Any], case_check: CaseCheck) -> Iterator[Mistake]:
    """The mistakes of one claim, under each of its readings."""
    # A key that is wrong by itself has been noted; nothing follows from its absence here.
    if not {"readings", "cases", "check"} <= claim.keys():
        return
    declared = claim["readings"]
    if claim.get("erratum") and len(declared) != 2:
        yield ("readings",), "expected two readings: the text as printed, and corrected"
    if declared and claim["cases"]:
        yield ("cases",), "each reading has its own cases, so leave these out"
    for name, reading in (declared or {"": {}}).items():
        prefix: KeyPath = ("readings", name) if name else ()
        named = (reading if name else claim)["cases"]
        if not named:
            yield (*prefix, "cases"), "names no case"
        mistakes, sweep_checks = _check_cases(named, case_check)
        yield from within(prefix, mistakes)
        check = reading.get("check") or claim["check"] or {}
        if not check:
            yield prefix, "has no check"
        check_path = (*(prefix if reading.get("check") else ()), "check")
        values = _check_values(check.get("values", {}), len(named))
        yield from within((*check_path, "values"), values)
        yield from within(check_path, _check_bounds(check))
        ranges = reading.get("over") or claim.get("over") or {}
        over = _check_over(ranges, sweep_checks)
        yield from within((*(prefix if reading.get("over") else ()), "over"), over)


def _check_cases(
    entries: Iterable[Any], case_check: CaseCheck
) -> tuple[list[Mistake], list[SweepCheck]]:
    """The mistakes of the entries of `cases:`, and the checks of sweeps of those without any."""
    mistakes: list[Mistake] = []
    sweep_checks = []
    for i, entry in enumerate(entries):
        try:
            sweep_checks.append(case_check(entry))
        except Wrong as error:
            mistakes += within(("cases", i), error.mistakes)
    return mistakes, [*filter(None, sweep_checks)]


def _check_bounds(check: Mapping[str, Any]) -> Iterator[Mistake]:
    """Bounds that no value meets, and checks that every motion meets."""
    least, most = check.get("least"), check.get("most")
    if least is not None and most is not None and least > most:
        yield ("most",), f"expected at least {least:g}, which is the lower bound, got {most:g}"
    needed = {"bound": ("least", "most"), "axis": ("start", "end")}.get(check.get("kind", ""), ())
    if needed and all(check[key] is None for key in needed):
        yield (), f"needs {' or '.join(needed)}: without, every motion meets it"


def _check_values(values: Mapping[str, Any], count: int) -> Iterator[Mistake]:
    named: dict[KeyPath, str] = {(WrongKey(name),): name for name in values}
    yield from unknown_names("quantity", named, QUANTITY_NAMES)
    for name in QUANTITY_NAMES.keys() & values:
        if (n := len(values[name])) != count:
            yield (name,), f"expected {count} numbers, one for each case, got {n}"


MOST_MEMBERS = 100_000
"""Members that a claim may have: some milliseconds each make minutes of them."""


def _check_over(ranges: Mapping[str, Any], checks: Iterable[SweepCheck]) -> Iterator[Mistake]:
    """The sweep of a claim against each of its cases; a mistake in several is noted once."""
    if math.prod(map(len, axes_of(ranges))) > MOST_MEMBERS:
        yield (), f"more than {MOST_MEMBERS:,} members, each of which is integrated by itself"
    elif ranges:
        by_path = dict(mistake for check in checks for mistake in check(ranges))
        # A case's own sweep stands at `sweep`, a claim's at `over`.
        yield from ((path[1:], message) for path, message in by_path.items())
