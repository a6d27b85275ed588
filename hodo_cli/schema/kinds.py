"""Rules of values: JSON Schema with a few more words, for the reader of case files, for editors,
and for the tables of the documentation.

A rule is a dict. Besides the words of JSON Schema it may have `title` (the value in words), `unit`,
`default` (a key with one may be left out), `definition` (its name in a schema that uses it several
times), `repeat` (a single value stands for this number of equal ones), `tag` and `tables` (the
value of the tag's key decides which other keys there are), `answer` (what to write instead of a
value of the wrong shape), `convert` (resolves a value of the right shape, or raises Wrong) and
`whole` (checks and resolves a value of any shape).
"""

import math
import operator
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from typing import Any

from .spelling import DECIMAL_HINT, near, nearest, number_advice, shown, unknown

Rule = dict[str, Any]

KeyPath = tuple[str | int, ...]
Mistake = tuple[KeyPath, str]
"""The path of a mistake, and a sentence that says what is right."""

REQUIRED: Any = object()


class Wrong(Exception):
    """The mistakes in one value."""

    def __init__(self, *mistakes: Mistake) -> None:
        super().__init__(*mistakes)
        self.mistakes = mistakes

    def __str__(self) -> str:
        lines = ((".".join(map(str, path)), sentence) for path, sentence in self.mistakes)
        return "\n".join(f"{path}: {sentence}" if path else sentence for path, sentence in lines)


class WrongKey(str):
    """The last part of a path where the key itself is wrong, not its value."""


MOST_STRANGE = 100
"""The most unknown keys of one mapping that are reported: each is compared with all valid keys."""

BOUNDS = {
    "exclusiveMinimum": (">", operator.gt),
    "minimum": (">=", operator.ge),
    "exclusiveMaximum": ("<", operator.lt),
    "maximum": ("<=", operator.le),
}


# Rules


def Key(rule: Rule, doc: str, unit: str = "1", default: Any = REQUIRED) -> Rule:
    """The rule of a key: the rule of its value with the meaning, unit and default of the key."""
    optional = {} if default is REQUIRED else {"default": default}
    return rule | {"description": doc, "unit": unit} | optional


def Number(
    above: Any = None, least: Any = None, below: Any = None, most: Any = None, type: str = "number"
) -> Rule:
    """The rule of a finite number within bounds."""
    bounds = zip(BOUNDS, (above, least, below, most), strict=True)
    return {"type": type} | {word: bound for word, bound in bounds if bound is not None}


def Integer(**bounds: Any) -> Rule:
    """The rule of a whole number within bounds."""
    return Number(**bounds, type="integer")


def Choice(*names: str, title: str = "") -> Rule:
    """The rule of one of some names."""
    *others, last = names
    listed = " or ".join(filter(None, [", ".join(others), last]))
    return {"enum": [*names], "title": title or listed}


def Switch(yes: str, no: str) -> Rule:
    """The rule of two words, or YAML's true and false, resolved to a bool."""
    return Choice(yes, no) | {"enum": [yes, no, True, False], "convert": lambda x: x in (yes, True)}


def Text(least: int = 0) -> Rule:
    """The rule of a text of at least `least` characters."""
    return {"type": "string"} | ({"minLength": least} if least else {})


ANGLE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?) ?(deg|rad)", re.ASCII)


def _angular(number: Rule, title: str) -> Rule:
    """The rule of a number in radians, or of text with a unit of angle."""

    def radians(value: Any) -> float:
        text = ANGLE.fullmatch(value) if isinstance(value, str) else None
        size = as_finite(float(text[1]) if text else value)
        if size is None:
            raise expected(rule, value)
        angle = math.radians(size) if text and text[2] == "deg" else size
        if number.get("minimum", angle) <= angle <= number.get("maximum", angle):
            return angle
        is_degrees = not isinstance(value, str) and 0 <= angle <= 180
        hint = f"; degrees are written as '{angle:.9g} deg'" if is_degrees else ""
        raise expected(rule, value, hint)

    text = Text() | {"pattern": f"^{ANGLE.pattern}$"}
    rule: Rule = {"anyOf": [number, text], "title": title, "whole": radians}
    return rule


def Angle(polar: bool = False) -> Rule:
    """The rule of an angle in radians, or text such as "60 deg"; a `polar` angle is from 0 to
    pi."""
    title = f"an angle{' from 0 to pi' if polar else ''} in radians, or such as '60 deg'"
    return _angular(Number(least=0, most=math.pi) if polar else Number(), title)


def Rate() -> Rule:
    """The rule of an angular velocity in radians per unit of time, or text such as "2.5 deg"."""
    return _angular(Number(), "a finite number, or such as '2.5 deg'")


def ListOf(
    rule: Rule,
    least: int = 1,
    length: int | None = None,
    alone: bool = False,
    title: str = "",
    **more: Any,
) -> Rule:
    """The rule of a list of at least `least` values, or of exactly `length`; with `alone` a single
    value is a list too."""
    title = title or f"a list{' of one or more' if least else ''}: {words(rule)}"
    several = {"type": "array", "items": rule, "minItems": length or least, "title": title}
    several |= {"maxItems": length} if length else {}
    either = {"anyOf": [rule, several], "title": title, "repeat": length or 1}
    return (either if alone else several) | more


def vector(n: int, above: float | None = None, scalar: bool = False) -> Rule:
    """The rule of a list of `n` numbers; with `scalar` one number means that all are equal."""
    word, _, limits = words(Number(above)).partition("number")
    title = f"{n} {word}numbers{limits}" + (" or one for all" if scalar else "")
    return ListOf(Number(above), length=n, alone=scalar, title=title)


def matrix(n: int) -> Rule:
    """The rule of an n by n matrix of numbers, row by row."""
    return ListOf(vector(n), length=n, title=f"{n} rows of {n} numbers")


NAMES = ListOf(Text(), least=0, alone=True, title="a name or a list of names")


def Mapped() -> Rule:
    """The rule of any mapping."""
    return {"type": "object"}


def Table(keys: Mapping[str, Rule], **more: Any) -> Rule:
    """The rule of a mapping with these keys."""
    return {"type": "object", "properties": keys, "title": f"a mapping of {', '.join(keys)}"} | more


def OneOf(keys: Mapping[str, Rule], **more: Any) -> Rule:
    """The rule of a mapping with exactly one of these keys."""

    def given(values: Any) -> Any:
        return {name: value for name, value in values.items() if value is not None}

    title = f"one of {', '.join(keys)}"
    return Table(keys, title=title, minProperties=1, maxProperties=1, convert=given, **more)


def Variant(tag: str, tables: Mapping[str, Mapping[str, Rule]], doc: str) -> Rule:
    """The rule of a mapping in which the value of one key, `tag`, decides which others it has."""
    head = Key(Choice(*tables), doc)
    title = f"a mapping with {tag}: {head['title']}"
    return {"type": "object", "tag": tag, "tables": tables, "head": head, "title": title}


def Each(rule: Rule, title: str, least: int = 1, **more: Any) -> Rule:
    """The rule of a mapping of names to values of one kind; `title` says what names and values
    are."""
    mapping = {"type": "object", "additionalProperties": rule, "minProperties": least}
    return mapping | {"title": f"a mapping of {title}"} | more


def Either(*rules: Rule, **more: Any) -> Rule:
    """The rule of a value of one of these kinds."""
    return {"anyOf": [*rules]} | more


def words(rule: Rule) -> str:
    """The values that a rule accepts, in words."""
    match rule:
        case {"title": title}:
            return str(title)
        case {"anyOf": rules}:
            return ", or ".join(map(words, rules))
        case {"type": "string" | "object" as name}:
            return {"string": "text", "object": "a mapping"}[name]
    signs = (f"{sign} {rule[word]:g}" for word, (sign, _) in BOUNDS.items() if word in rule)
    positive = "positive " if rule.get("exclusiveMinimum") == 0 else ""
    limits = ", ".join(sign for sign in signs if sign != "> 0")
    return f"{positive}{rule['type']} {limits}".rstrip()


# The checks of values


def is_list(value: Any) -> bool:
    """Whether a value is a list in YAML's sense."""
    return isinstance(value, list | tuple)


def leaves(value: Any, path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """Every value within mappings and lists, by its path."""
    if not isinstance(value, Mapping | list | tuple):
        yield path, value
        return
    for key, part in value.items() if isinstance(value, Mapping) else enumerate(value):
        yield from leaves(part, (*path, key))


SHAPES: dict[str, Any] = {"array": (list, tuple), "object": Mapping}


def takes(rule: Rule, value: Any) -> bool:
    """Whether a value has the outer shape of a rule: mapping, list or scalar."""
    if "anyOf" in rule:
        return any(takes(option, value) for option in rule["anyOf"])
    if "enum" in rule:
        return isinstance(value, str) or any(value is name for name in rule["enum"])
    shape = SHAPES.get(rule["type"])
    return isinstance(value, shape) if shape else not isinstance(value, list | tuple | Mapping)


def expected(rule: Rule, value: Any, hint: str = "") -> Wrong:
    """The mistake of a value that its rule does not accept."""
    what = words(rule)
    if rule.get("type") in ("number", "integer") and "title" not in rule:
        finite = "finite " if as_finite(value) is None else ""
        what = f"an {what}" if what.startswith("integer") else f"a {finite}{what}"
    answer = rule["answer"](value) if "answer" in rule else ""
    return Wrong(((), f"expected {what}, got {shown(value)}{hint or answer}"))


def as_finite(value: Any) -> float | None:
    """The value as a finite double, or None if it is not a finite number; a bool is not a
    number."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and abs(value) <= sys.float_info.max else None


def within(prefix: KeyPath, mistakes: Iterable[Mistake]) -> Iterator[Mistake]:
    """The mistakes within a value, with the value's path put before the path of each."""
    return (((*prefix, *path), sentence) for path, sentence in mistakes)


def check_parts(parts: Iterable[tuple[Any, Rule, Any]]) -> tuple[dict[Any, Any], list[Mistake]]:
    """The values of (key, rule, value) resolved by their rules, by key and without the wrong ones,
    and all mistakes."""
    values: dict[Any, Any] = {}
    mistakes: list[Mistake] = []
    for key, rule, value in parts:
        try:
            values[key] = check(rule, value)
        except Wrong as error:
            mistakes += within((key,), error.mistakes)
    return values, mistakes


def all_right(values: dict[Any, Any], mistakes: Collection[Mistake]) -> dict[Any, Any]:
    """The values. Raises Wrong if there are mistakes."""
    if mistakes:
        raise Wrong(*mistakes)
    return values


def check_tagged(rule: Rule, value: Mapping[str, Any]) -> tuple[dict[str, Any], list[Mistake]]:
    """`check_keys` for the tag and the keys of the table that it names. Without a valid tag no
    other key is judged."""
    name = value.get(rule["tag"])
    others = rule["tables"].get(name, {}) if isinstance(name, str) else {}
    keys = {rule["tag"]: rule["head"]} | others
    return check_keys(keys, {k: value[k] for k in value if len(keys) > 1 or k in keys})


def check_keys(
    keys: Mapping[str, Rule], entries: Mapping[str, Any]
) -> tuple[dict[str, Any], list[Mistake]]:
    """The values of `keys` with defaults filled in, without missing and wrong ones, and all
    mistakes."""
    values, mistakes = check_parts((k, keys[k], entries[k]) for k in keys if k in entries)
    strange = [name for name in entries if name not in keys][:MOST_STRANGE]
    mistakes += [((WrongKey(name),), unknown("key", name, keys)) for name in strange]
    # A misspelt key is not reported as missing too.
    absent = [k for k in keys if k not in {*entries, *(near(name, keys) for name in strange)}]
    if missing := [repr(name) for name in absent if "default" not in keys[name]]:
        mistakes.append(((), f"missing {', '.join(missing)}"))
    values |= {k: keys[k]["default"] for k in keys if k not in entries and "default" in keys[k]}
    return {name: values[name] for name in keys if name in values}, mistakes


def check(rule: Rule, value: Any) -> Any:
    """The value resolved by its rule. Raises Wrong with every mistake in it."""
    if "whole" in rule:
        return rule["whole"](value)
    if not takes(rule, value):
        raise expected(rule, value)
    kind = next((word for word in ("anyOf", "enum") if word in rule), rule.get("type", ""))
    resolved = CHECKS[kind](rule, value)
    return rule["convert"](resolved) if "convert" in rule else resolved


def _any_of(rule: Rule, value: Any) -> Any:
    """The value resolved by the first of several rules that accepts it. Raises Wrong."""
    problems = []
    for option in (option for option in rule["anyOf"] if takes(option, value)):
        try:
            resolved = check(option, value)
            stands_for_all = "repeat" in rule and not is_list(value)
            return (resolved,) * rule["repeat"] if stands_for_all else resolved
        except Wrong as error:
            problems.append(error)
    # Only one kind was meant, so its own mistakes say more than a list of all kinds.
    raise problems[0] if len(problems) == 1 else expected(rule, value)


def _word(rule: Rule, value: Any) -> Any:
    """The value, if it is one of the rule's words. Raises Wrong."""
    if value in rule["enum"]:
        return value
    raise expected(rule, value, nearest(value, [x for x in rule["enum"] if isinstance(x, str)]))


def _text(rule: Rule, value: Any) -> str:
    """The value, if it is a text that is long enough. Raises Wrong."""
    if isinstance(value, str) and len(value) >= rule.get("minLength", 0):
        return value
    raise expected(rule, value, "; put it in quotes" if isinstance(value, int | float) else "")


def _items(rule: Rule, value: Any) -> tuple[Any, ...]:
    """The resolved items of a list. Raises Wrong with the mistakes of all items."""
    most, item_rule = rule.get("maxItems", math.inf), rule["items"]
    if not rule["minItems"] <= len(value) <= most:
        # YAML takes [0,005, 0,004, 0,003] for six numbers.
        raise expected(rule, value, DECIMAL_HINT if 0 in value and len(value) > most else "")
    if value and all(is_list(item) and not takes(item_rule, item) for item in value):
        raise expected(rule, value)  # one mistake, not one an item
    parts = ((i, item_rule, item) for i, item in enumerate(value))
    return tuple(all_right(*check_parts(parts)).values())


def _entries(rule: Rule, value: Mapping[str, Any]) -> Any:
    """The resolved entries of a mapping. Raises Wrong with the mistakes of all entries."""
    if not rule.get("minProperties", 0) <= len(value) <= rule.get("maxProperties", math.inf):
        listed = shown(", ".join(map(str, value)))
        raise expected(rule, value, f", of {len(value)} keys: {listed}" if value else "")
    if "properties" in rule:
        return all_right(*check_keys(rule["properties"], value))
    if "tag" in rule:
        return all_right(*check_tagged(rule, value))
    if value_rule := rule.get("additionalProperties"):
        return all_right(*check_parts((name, value_rule, item) for name, item in value.items()))
    return value


def _number(rule: Rule, value: Any) -> float:
    """The value as a number within the rule's bounds. Raises Wrong."""
    number, is_whole = as_finite(value), rule["type"] == "integer"
    if number is None:
        raise expected(rule, value, number_advice(value))
    in_bounds = all(holds(value, rule[word]) for word, (_, holds) in BOUNDS.items() if word in rule)
    if not in_bounds or (is_whole and number % 1):
        raise expected(rule, value)
    return int(value) if is_whole else number


CHECKS: dict[str, Callable[[Rule, Any], Any]] = {
    "anyOf": _any_of,
    "enum": _word,
    "string": _text,
    "array": _items,
    "object": _entries,
    "number": _number,
    "integer": _number,
}


def unknown_names(
    what: str, named: Mapping[KeyPath, str], valid: Collection[str]
) -> Iterator[Mistake]:
    """A mistake for each name, by its path, that is not among the `valid` ones."""
    return (
        (path, unknown(f"{what} {name!r}", name, valid))
        for path, name in named.items()
        if name not in valid
    )


def mistakes_where(*rules: tuple[object, KeyPath, str]) -> Iterator[Mistake]:
    """The mistakes whose condition holds, from rows of a condition, a path and a sentence."""
    return ((path, sentence) for is_wrong, path, sentence in rules if is_wrong)
