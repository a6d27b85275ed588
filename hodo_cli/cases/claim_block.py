"""The keys of a case file's `claims:` and `errata:` blocks: the statements and misprints of a text,
and how each is checked."""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

from ..quantities import OVER_TIME
from ..schema.document import Source
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
    Rule,
    Table,
    Text,
    Variant,
    Wrong,
    WrongKey,
    check_keys,
    mistakes_where,
    unknown_names,
    within,
)
from .figure_block import FORMULA
from .sweep_block import SWEEP, axes_of, check_axes, first_values

REPRODUCED, PLOTTING, CONTRADICTED = "reproduced", "reproduced to plotting accuracy", "contradicted"
UNDERDETERMINED, NOT_TESTED = "under-determined", "not tested"
THEOREM = "holds by theorem"
AS_PRINTED, ONCE_CORRECTED = "reproduced as printed only", "reproduced once corrected"
COMPLYING = (REPRODUCED, THEOREM, PLOTTING)
VERDICTS = (*COMPLYING, AS_PRINTED, ONCE_CORRECTED, UNDERDETERMINED, CONTRADICTED, NOT_TESTED)
"""The verdicts on a statement; the first three say that it holds. A statement that rests on an
erratum holds as printed only, or once corrected."""

CONFIRMED, NOT_CONFIRMED, BY_READING = "confirmed", "not confirmed", "by reading"
MISPRINTS = (CONFIRMED, BY_READING, NOT_CONFIRMED, NOT_TESTED)
"""The verdicts on an erratum. A misprint such as a wrong equation number has no check and is shown
by reading."""

SINGLE_NUMBERS = {
    "crossings": "number of separatrix crossings",
    "first_crossing": "time of the first crossing; infinite without one",
    "turns": "turns of G about the axis that it encloses at the start, while it does",
    "visible_turns_x1": "the most turns of G about x1 in one stretch that encloses x1, where "
    "|G| > 0.1",
    "visible_turns_x3": "the most turns of G about x3, likewise",
    "area_largest": "largest w_l^2 while the axis l of largest inertia is enclosed, "
    "by the largest coordinate in the plane of w_l^2 and K w_s^2",
    "area_smallest": "largest K w_s^2 while the axis s of smallest inertia is enclosed, likewise",
    "growth_largest": "rate at which a small tilt away from the axis of largest inertia grows",
    "growth_smallest": "rate at which a small tilt away from the axis of smallest inertia grows",
    "end_of_spin": "time at which r reaches 0; infinite if it does not",
    "rebound_u3": "time at which u3 touches 1, where |Gz| = C |r|; infinite if it does not",
}
"""The quantities that are one number of a motion; `claims.measures` computes them."""

QUANTITY_NAMES = {**OVER_TIME, **SINGLE_NUMBERS}


AXIS = Choice("x1", "x2", "x3")
QUANTITY = Choice(*QUANTITY_NAMES, title="a quantity") | {"definition": "quantity"}
AT = Key(Choice("start", "end"), "where a quantity over time is taken", default="end")
CURVE = Choice(*OVER_TIME, title="a quantity over time") | {"definition": "curve"}
SEVERAL = Key(ListOf(CURVE), "quantities over time")
# The change of a curve through zero may be twice its largest value. A check that every curve passes
# would test nothing.
RELATIVE = Number(least=0, below=1)

CHECK_KINDS: dict[str, dict[str, Rule]] = {
    "axis": {
        "start": Key(
            AXIS,
            "axis enclosed at the start of the motion, also where samples begin later",
            default=None,
        ),
        "end": Key(AXIS, "axis enclosed at the end", default=None),
        "turns": Key(
            Number(least=0),
            "turns that G must make about each of these axes while it is enclosed; with fewer than "
            "one it goes round no axis, whatever the criterion says",
            default=0.0,
        ),
    },
    "crossings": {
        "least": Key(
            Integer(least=1), "the fewest crossings (default: 1 without `most`)", default=None
        ),
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
        "within": Key(RELATIVE, "change allowed, relative to the largest value", default=1e-12),
    },
    "formula": {
        "of": Key(CURVE, "quantity over time"),
        "formula": Key(FORMULA, "the law that it follows"),
        "within": Key(RELATIVE, "difference allowed, relative to the largest value", default=1e-12),
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
            ListOf(Each(Integer(least=0), "axes to positions, from zero", least=0), least=0),
            "positions at which it is averaged over the other axes; `{}` averages over all "
            "(default, without `along`: that alone)",
            default=(),
        ),
        "along": Key(
            NAMES,
            "for each axis named: the range (largest minus smallest) of the average over all other "
            "axes",
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

NEEDED: dict[str, tuple[tuple[str, ...], ...]] = {
    "axis": (("start", "end"),),
    "crossings": (("least", "most", "from", "to"),),
    "bound": (("least", "most"),),
    "average": (("least", "most", "sense"),),
}
"""The keys of a check of which one must be given, because every motion meets the check without
them."""

CHECKS_OF_PAPERS = Path(__file__).parents[1] / "papers" / "checks.yaml"


@cache
def checks_of_papers() -> dict[str, tuple[str, str]]:
    """The checks that are written for one text, by name, each with the module of its function and
    its list in `checks.yaml`: "checks" or "trends". Reading a list does not load the modules, which
    compute."""
    text = CHECKS_OF_PAPERS.read_text(encoding="utf-8")
    return {
        name: (module, section)
        for module, entries in Source(CHECKS_OF_PAPERS.name).read(text).items()
        for section in ("checks", "trends")
        for name in entries.get(section, ())
    }


CHECK = Variant("kind", CHECK_KINDS, "how it is checked") | {"definition": "check"}
ID = Key(Text(least=1), "name")
WHERE = Key(Text(least=1), "section, figure or equation of the text")
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
READ_AS_PRINTED, READ_CORRECTED = "as printed", "corrected"
"""The readings of an erratum, and of a statement that inherits it."""

TESTED = {
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
            least=0,
        ),
        "instead of `cases`: the ways to read the text, each with its cases; "
        "a statement on which they disagree is under-determined",
        default={},
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
}
"""The keys by which a statement or a misprint is tested."""

CLAIM = {
    "id": ID,
    "where": WHERE,
    "original": Key(Text(), "the statement in the words of the text", default=""),
    "statement": Key(Text(least=1), "what the text says, in one sentence"),
    "erratum": Key(
        Text(),
        "erratum that the statement inherits; its readings are `as printed` and `corrected`",
        default="",
    ),
    **TESTED,
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
    "printed": Key(Text(least=1), "what is printed"),
    "should_be": Key(Text(least=1), "what it should be"),
    **TESTED,
    "note": REMARK,
}
"""The keys of an erratum. Its readings are `as printed`, which its check must contradict, and
`corrected`, which must comply; a check without readings shows both. A misprint without a check is
shown by reading."""


CaseOf = Callable[[Any], Any]
"""The case of an entry of `cases:`, or None for a case that has mistakes of its own. Raises Wrong
for an entry that describes no case."""


def readings(claim: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The claim under each of its readings, by name; the name is empty for a claim without
    readings."""
    under: dict[str, Mapping[str, Any]] = {
        name: {**claim, **{k: v for k, v in reading.items() if v not in (None, "")}, "readings": {}}
        for name, reading in claim.get("readings", {}).items()
    }
    return under or {"": claim}


def cases_of(entry: Mapping[str, Any]) -> list[str]:
    """The names of the cases of a claim or an erratum, under all its readings, each once."""
    entries = (case for reading in readings(entry).values() for case in reading["cases"])
    return list(dict.fromkeys(map(case_name, entries)))


def case_name(case: Any) -> str:
    """The name of the case in an entry of `cases:`."""
    return str(case["case"] if isinstance(case, Mapping) else case)


def cross_check(claims: Any, errata: Any, case_of: CaseOf) -> Iterator[Mistake]:
    """The mistakes that only several keys of the claims and errata show together: repeated ids,
    missing cases, checks that every motion or no motion passes, ranges of keys that a case does not
    have. Mistakes that only the motions show are reported when they are judged."""
    ids: dict[str, list[str]] = {"errata": [], "claims": []}
    # Errata first, because claims name them.
    for section, items, keys in (("errata", errata, ERRATUM_KEYS), ("claims", claims, CLAIM)):
        for i, item in enumerate(items if isinstance(items, list) else ()):
            if not isinstance(item, Mapping):
                continue
            entry, _ = check_keys(keys, item)  # what is wrong with a single key has been noted
            name, erratum = entry.get("id", ""), entry.get("erratum", "")
            is_second = name and name in ids[section]
            mistakes = (
                _check_entry(section, entry, case_of),
                mistakes_where((is_second, ("id",), f"a second entry {name!r}")),
                unknown_names("erratum", {("erratum",): erratum} if erratum else {}, ids["errata"]),
            )
            yield from within((section, i), chain.from_iterable(mistakes))
            ids[section].append(name)


def _check_entry(section: str, entry: Mapping[str, Any], case_of: CaseOf) -> Iterator[Mistake]:
    """The mistakes of one claim or erratum, under each of its readings."""
    # A key whose value is wrong has been noted, and is missing here.
    if not {"readings", "cases", "check"} <= entry.keys():
        return
    declared = entry["readings"]
    has_both_forms = entry.get("erratum") or (section == "errata" and declared)
    if has_both_forms and declared.keys() != {READ_AS_PRINTED, READ_CORRECTED}:
        yield ("readings",), f"expected two readings, {READ_AS_PRINTED!r} and {READ_CORRECTED!r}"
    if section == "errata" and not (declared or entry["cases"] or entry["check"]):
        return  # a misprint without a check is shown by reading
    for name, reading in readings(entry).items():
        prefix: KeyPath = ("readings", name) if declared else ()
        yield from within(prefix, _check_reading(reading, case_of))


def _check_reading(reading: Mapping[str, Any], case_of: CaseOf) -> Iterator[Mistake]:
    """The mistakes of a claim under one reading."""
    check, entries, cases = reading["check"], reading["cases"], list[Any]()
    if not entries or check is None:
        yield (), "names no case" if check else "has no check"
        return
    is_swept = check["kind"] == "average"
    sweep = f"{'no' if is_swept else 'a'} sweep, which this check does not take"
    for i, entry in enumerate(entries):
        try:
            case = case_of(entry)
        except Wrong as error:
            yield from within(("cases", i), error.mistakes)
            continue
        if case is not None and bool(case.sweep) != is_swept:
            yield ("cases", i), f"case {case.name} is {sweep}"
        cases += [] if case is None else [case]
    yield from within(("check",), _check_check(check, len(entries)))
    if reading.get("over") and cases:
        yield from _check_members(reading["over"], cases[0])


def _check_members(over: Mapping[str, Any], case: Any) -> Iterator[Mistake]:
    """The mistakes of the ranges of a claim, in one case."""
    if math.prod(map(len, axes_of(over))) > MOST_MEMBERS:
        says = f"more than {MOST_MEMBERS:,} members, each of which is integrated by itself"
        yield ("over",), says
        return
    system = case.system
    entries = {**vars(case), **case.data, **first_values(over, type(system), case.data)}
    # A case has its ranges at `sweep`, a claim at `over`.
    mistakes = check_axes(over, system.equations, entries)
    yield from ((("over", *path[1:]), sentence) for path, sentence in mistakes)


MOST_MEMBERS = 100_000
"""The most members of a claim: at some milliseconds each they take minutes."""


def _check_check(check: Mapping[str, Any], count: int) -> Iterator[Mistake]:
    """The mistakes of a check of `count` cases: missing keys, unknown names, and a number of cases
    that it does not take."""
    kind, values = check["kind"], check.get("values", {})
    yield from (
        ((), f"needs {' or '.join(keys)}: without, every motion meets it")
        for keys in NEEDED.get(kind, ())
        if all(check[key] in (None, ()) for key in keys)
    )
    named: dict[KeyPath, str] = {("values", WrongKey(name)): name for name in values}
    yield from unknown_names("quantity", named, QUANTITY_NAMES)
    is_uneven = kind == "order" and (count < 2 or count % (check["by"] or 1))
    yield from mistakes_where(
        (
            is_uneven,
            (),
            f"expected cases in groups of {check.get('by') or 'two or more'}, got {count} in all",
        ),
        (kind == "average" and count > 2, (), "a check of kind average takes one case, or two"),
    )
    of_each = f"expected a number for each case, {count} in all, got "
    yield from (
        (("values", name), f"{of_each}{len(x)}") for name, x in values.items() if len(x) != count
    )
    if kind == "paper":
        yield from unknown_names("check", {("name",): check["name"]}, checks_of_papers())
