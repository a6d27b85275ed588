"""What a case file's `claims:` and `errata:` blocks take: the statements and misprints of a text,
and how each of them is checked."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain, product
from pathlib import Path
from typing import Any, NamedTuple

from ..schema.document import Mistakes, read
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
    mistakes_where,
    unknown_names,
    within,
)
from .derived import DERIVED, OVER_TIME, constants_of, lack_of
from .figure_block import FORMULA, quantities_in
from .sweep_block import SWEEP, axes_of, check_axes, first_values

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
"""The quantities that are one number of a motion; `claims.quantities` computes them."""

NEEDED_BY_NUMBER = {"rebound_u3": "Gz"} | dict.fromkeys(
    ("turns", "visible_turns_x1", "visible_turns_x3", "area_largest", "area_smallest"), "omega"
)
"""The variable or quantity over time from which a number is computed that not every model has."""

QUANTITY_NAMES = {**OVER_TIME, **SINGLE_NUMBERS}


AXIS = Choice("x1", "x2", "x3")
QUANTITY = Choice(*QUANTITY_NAMES, title="a quantity")
AT = Key(Choice("start", "end"), "where a quantity over time is taken", default="end")
CURVE = Choice(*OVER_TIME, title="a quantity over time")
SEVERAL = Key(ListOf(CURVE), "quantities over time")
# Of a curve that changes its sign the change may be twice the largest value; a check to which every
# curve conforms is none.
RELATIVE = Number(least=0, below=1)

CHECK_KINDS: dict[str, dict[str, Key]] = {
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
            "one it goes round nothing, whatever the criterion says",
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
"""The keys of a check of which one must be there: without, every motion meets it."""

CHECKS_OF_PAPERS = Path(__file__).parents[1] / "papers" / "checks.yaml"


class PaperCheck(NamedTuple):
    """A check that is written for one text: the module of its function, the models that the text is
    about (empty for any), and whether it takes the motions of all members of `over:` at once."""

    module: str
    models: Sequence[str]
    is_trend: bool


@cache
def checks_of_papers() -> dict[str, PaperCheck]:
    """The checks that are written for one text, by name, from a list beside their modules, which
    compute and are not loaded for it."""
    text = CHECKS_OF_PAPERS.read_text(encoding="utf-8")
    return {
        name: PaperCheck(module, entries.get("models", ()), is_trend=section == "trends")
        for module, entries in read(text, Mistakes(CHECKS_OF_PAPERS.name)).items()
        for section in ("checks", "trends")
        for name in entries.get(section, ())
    }


CHECK = Variant("kind", CHECK_KINDS, "how it is checked")
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
`corrected`, which must comply; a check without readings shows both. Without a check it is seen by
reading."""

CaseOf = Callable[[Any], Any]
"""The case of an entry of `cases:`; None for one that has mistakes of its own. Raises Wrong for an
entry that describes no case."""


def readings(claim: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The claim under each of its readings, by name; under none, the claim itself."""
    under: dict[str, Mapping[str, Any]] = {
        name: {**claim, **{k: v for k, v in reading.items() if v not in (None, "")}, "readings": {}}
        for name, reading in claim.get("readings", {}).items()
    }
    return under or {"": claim}


def cases_of(entry: Mapping[str, Any]) -> list[str]:
    """The names of the cases of a claim, under all its readings, or of an erratum, each once."""
    named = (case_name(case) for reading in readings(entry).values() for case in reading["cases"])
    return list(dict.fromkeys(named))


def case_name(case: Any) -> str:
    """The name in an entry of `cases:`, of a case as it is or with other values."""
    return str(case["case"] if isinstance(case, Mapping) else case)


def cross_check(claims: Any, errata: Any, case_of: CaseOf) -> Iterator[Mistake]:
    """The mistakes that only several keys of the claims and errata show together: ids given twice,
    cases that are not there, checks that every motion meets or none, sweeps that a case cannot
    make."""
    ids: dict[str, list[str]] = {"errata": [], "claims": []}
    # Errata first, since claims name them.
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
    # A key that is wrong by itself has been noted; nothing follows from its absence here.
    if not {"readings", "cases", "check"} <= entry.keys():
        return
    declared = entry["readings"]
    has_both_forms = entry.get("erratum") or (section == "errata" and declared)
    yield from mistakes_where(
        (
            has_both_forms and declared.keys() != {READ_AS_PRINTED, READ_CORRECTED},
            ("readings",),
            f"expected two readings, {READ_AS_PRINTED!r} and {READ_CORRECTED!r}",
        ),
        ("" in declared, ("readings",), "a reading has no name"),
        (
            declared and entry["cases"],
            ("cases",),
            "each reading has its own cases, so leave these out",
        ),
    )
    is_seen_by_reading = not (declared or entry["cases"] or entry["check"])
    if section == "errata" and is_seen_by_reading:
        return
    for name, reading in readings(entry).items():
        prefix: KeyPath = ("readings", name) if declared else ()
        own = declared.get(name, {})
        paths = {key: (*prefix, key) if own.get(key) else (key,) for key in ("check", "over")}
        yield from _check_reading(reading, prefix, paths, case_of)


def _check_reading(
    reading: Mapping[str, Any], prefix: KeyPath, paths: Mapping[str, KeyPath], case_of: CaseOf
) -> Iterator[Mistake]:
    """The mistakes of a claim under one reading, which stands at `prefix`, with its check and its
    members at `paths`."""
    names, check, over = reading["cases"], reading["check"], reading.get("over")
    if not names:
        yield (*prefix, "cases"), "names no case"
    if check is None:
        yield prefix, "has no check"
        return
    cases, mistakes = _check_cases(names, case_of, is_swept=check["kind"] == "average")
    yield from within(prefix, mistakes)
    for mistakes_of_check in (
        _check_check(check, len(names)),
        _check_models(check, cases),
        _check_quantities(check, cases, is_stored=not over),
    ):
        yield from within(paths["check"], mistakes_of_check)
    yield from within(paths["over"], _check_over(over or {}, cases))
    yield from _check_members(reading, over)


def _check_check(check: Mapping[str, Any], count: int) -> Iterator[Mistake]:
    """The mistakes of a check of so many cases: it needs a key, contradicts itself, or takes
    another number of cases."""
    kind, least, most = check["kind"], check.get("least"), check.get("most")
    yield from (
        ((), f"needs {' or '.join(keys)}: without, every motion meets it")
        for keys in NEEDED.get(kind, ())
        if all(check[key] in (None, ()) for key in keys)
    )
    if least is not None and most is not None and least > most:
        yield ("most",), f"expected at least {least:g}, which is the lower bound, got {most:g}"
    match kind:
        case "value":
            yield from _check_values(check, count)
        case "crossings" if check["from"] and check["from"] == check["to"]:
            yield ("to",), f"expected another axis than {check['to']}, which a crossing leaves"
        case "order" if count < 2:
            yield (), f"compares the values of two cases or more, got {count}"
        case "order" if check["by"] and count % check["by"]:
            yield ("by",), f"expected a divisor of the number of cases, {count}, got {check['by']}"
        case "average":
            yield from _check_average(check, count)
        case "paper":
            yield from unknown_names("check", {("name",): check["name"]}, checks_of_papers())


def _check_average(check: Mapping[str, Any], count: int) -> Iterator[Mistake]:
    """The mistakes of a check of averages over so many cases."""
    return mistakes_where(
        (
            count not in (1, 2),
            (),
            "a check of kind average takes one case, or two whose distance it averages",
        ),
        (
            check["sense"] and len(check["at"] + check["along"]) < 2,
            ("sense",),
            "compares the averages listed in `at`, or the ranges in `along`: list at least two",
        ),
        (
            check["sense"] and check["at"] and check["along"],
            ("along",),
            "`sense` compares the averages listed in `at`, and a range is none: make it a "
            "statement of its own",
        ),
    )


def _check_values(check: Mapping[str, Any], count: int) -> Iterator[Mistake]:
    """The mistakes of the values that a check expects of so many cases."""
    values = check["values"]
    named: dict[KeyPath, str] = {("values", WrongKey(name)): name for name in values}
    yield from unknown_names("quantity", named, QUANTITY_NAMES)
    for name in QUANTITY_NAMES.keys() & values:
        if (n := len(values[name])) != count:
            yield ("values", name), f"expected a number for each case, {count} in all, got {n}"
        if any(values[name]) and check["within"] >= max(map(abs, values[name])):
            yield ("within",), f"expected less than the values of {name!r} themselves"


def _check_models(check: Mapping[str, Any], cases: Iterable[Any]) -> Iterator[Mistake]:
    """The mistake of a check of one text that meets a case of a model that the text is not
    about."""
    paper_check = checks_of_papers().get(check.get("name", ""))
    for case in cases:
        if paper_check and paper_check.models and case.model not in paper_check.models:
            models = " or ".join(paper_check.models)
            yield ("name",), f"is for cases of model {models}, and {case.name} is {case.model}"


def _check_quantities(
    check: Mapping[str, Any], cases: Iterable[Any], is_stored: bool
) -> Iterator[Mistake]:
    """The mistakes of a check of quantities that do not follow from what its cases store, or from
    the variables of the model for cases that no result stores."""
    named = check.get("of", ())
    names = [
        *([named] if isinstance(named, str) else named),
        *(name for name in check.get("values", ()) if name in QUANTITY_NAMES),
        *(["turns"] if check.get("turns") else []),
        *sorted(quantities_in(check.get("formula", "0"))),
    ]
    for case, name in product(cases, names):
        variables = (case.store if is_stored else ()) or case.system.variables
        sources = {*variables, *constants_of(case.system, case.data)}
        base = NEEDED_BY_NUMBER.get(name, name.partition(".")[0])
        if base in sources or base in SINGLE_NUMBERS:
            continue
        of_model = f"case {case.name} ({case.model}, {case.form}) has no {name}"
        if message := lack_of(case, base, sources, name) if base in DERIVED else of_model:
            yield (), message
            return


def _check_members(reading: Mapping[str, Any], over: Any) -> Iterator[Mistake]:
    """The mistakes in the keys that choose and count the members of `over`."""
    name, has_share = reading["check"].get("name", ""), reading.get("share") is not None
    is_trend = name in checks_of_papers() and checks_of_papers()[name].is_trend
    no_members = "the members of `over`, which is not there"
    return mistakes_where(
        (reading.get("start") and not over, ("start",), f"is about {no_members}"),
        (has_share and not over, ("share",), f"is about {no_members}"),
        (is_trend and not over, ("check",), f"{name!r} compares {no_members}"),
        (
            is_trend and has_share,
            ("share",),
            f"{name!r} compares all members, and is decided by no share",
        ),
        (
            reading["check"]["kind"] == "average" and over,
            ("over",),
            "a check of kind average takes the members of its cases' own sweeps",
        ),
    )


def _check_cases(
    entries: Sequence[Any], case_of: CaseOf, is_swept: bool
) -> tuple[list[Any], list[Mistake]]:
    """The cases of the entries of `cases:` that have no mistake, and the mistakes: of the entries,
    and sweeps where a check takes single motions, or the other way round."""
    cases: list[Any] = []
    mistakes: list[Mistake] = []
    for i, entry in enumerate(entries):
        try:
            case = case_of(entry)
        except Wrong as error:
            mistakes += within(("cases", i), error.mistakes)
            continue
        if case is not None and bool(case.sweep) != is_swept:
            words = "a sweep, where a statement needs a single motion: use `over`"
            mistakes.append(
                (("cases", i), words if case.sweep else f"case {case.name} is no sweep")
            )
        elif case is not None:
            cases.append(case)
    return cases, mistakes


MOST_MEMBERS = 100_000
"""Members that a claim may have: some milliseconds each make minutes of them."""


def _check_over(ranges: Mapping[str, Any], cases: Iterable[Any]) -> Iterator[Mistake]:
    """The sweep of a claim against each of its cases; a mistake in several is noted once."""
    if math.prod(map(len, axes_of(ranges))) > MOST_MEMBERS:
        yield (), f"more than {MOST_MEMBERS:,} members, each of which is integrated by itself"
    elif ranges:
        by_path: dict[KeyPath, str] = {}
        for case in cases:
            model, data = type(case.system), case.data
            entries = {**vars(case), **data, **first_values(ranges, model, data)}
            by_path |= dict(check_axes(ranges, model, entries))
        # A case's own sweep stands at `sweep`, a claim's at `over`.
        yield from ((path[1:], message) for path, message in by_path.items())
