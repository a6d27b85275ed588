"""The vocabulary in which models, figures and cases declare the keys that they take.

A kind checks plain values (None, bool, int, float, str, list, dict): `check(value)` returns the
resolved value, or raises Wrong with every mistake within it. `schema()` is the same rule as JSON
Schema, `str(kind)` the same in a few words.
"""

import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from .spelling import DECIMAL_HINT, near, nearest, number_advice, shown, unknown

KeyPath = tuple[str | int, ...]
"""Where a value stands within another: keys and zero-based positions."""

Mistake = tuple[KeyPath, str]
"""Where something is wrong, and a sentence that says what is right."""


class Wrong(Exception):
    """The mistakes in one value."""

    def __init__(self, *mistakes: Mistake) -> None:
        super().__init__(*mistakes)
        self.mistakes = mistakes

    def __str__(self) -> str:
        """A line for each: the key, and what is right."""
        lines = ((".".join(map(str, path)), sentence) for path, sentence in self.mistakes)
        return "\n".join(f"{path}: {sentence}" if path else sentence for path, sentence in lines)


class WrongKey(str):
    """The last part of a path whose mistake is the key itself, not its value."""


REQUIRED: Any = object()
"""The default of a key that must be given."""


def is_list(value: Any) -> bool:
    """Whether a value is a list, as YAML has it."""
    return isinstance(value, list | tuple)


class Kind:
    """The methods of every kind."""

    def check(self, value: Any) -> Any:
        """The resolved value. Raises Wrong."""
        raise NotImplementedError

    def schema(self) -> dict[str, Any]:
        """JSON Schema of the values that `check` takes."""
        raise NotImplementedError

    def written(self, value: Any) -> Any:
        """A resolved value as a case file says it."""
        return value

    def takes(self, value: Any) -> bool:
        """Whether a value has the outer shape of this kind: mapping, list or scalar."""
        return not (is_list(value) or isinstance(value, Mapping))


@dataclass(frozen=True)
class Key:
    """One key: the kind of its value, its meaning, its unit, and its default (None: may be left
    out)."""

    kind: Kind
    doc: str
    unit: str = "1"
    default: Any = REQUIRED

    def schema(self) -> dict[str, Any]:
        """The kind's schema with the key's meaning and default."""
        entries = {"description": self.doc, "default": self.kind.written(self.default)}
        none: tuple[Any, ...] = ("", None, REQUIRED)
        return self.kind.schema() | {
            word: entry for word, entry in entries.items() if entry not in none
        }


def within(prefix: KeyPath, mistakes: Iterable[Mistake]) -> Iterator[Mistake]:
    """The mistakes of a value, with its own path put before theirs."""
    return (((*prefix, *path), sentence) for path, sentence in mistakes)


def mistakes_where(*rules: tuple[object, KeyPath, str]) -> Iterator[Mistake]:
    """The mistakes of those rules whose condition holds: the condition, the path, the sentence."""
    return ((path, sentence) for is_wrong, path, sentence in rules if is_wrong)


Part = tuple[str | int, Kind, Any]
"""A value within another: its key or position, the kind that it should be, and itself."""


def check_parts(parts: Iterable[Part]) -> tuple[dict[Any, Any], list[Mistake]]:
    """The resolved values by key, without those that are wrong, and all mistakes."""
    values: dict[Any, Any] = {}
    mistakes: list[Mistake] = []
    for key, kind, value in parts:
        try:
            values[key] = kind.check(value)
        except Wrong as error:
            mistakes += within((key,), error.mistakes)
    return values, mistakes


def all_right(values: dict[Any, Any], mistakes: Sequence[Mistake]) -> dict[Any, Any]:
    """The values, where there is no mistake. Raises Wrong."""
    if mistakes:
        raise Wrong(*mistakes)
    return values


def check_keys(
    keys: Mapping[str, Key], entries: Mapping[str, Any]
) -> tuple[dict[str, Any], list[Mistake]]:
    """The values of `keys` with defaults filled in, without those that are missing or wrong, and
    all mistakes."""
    values, mistakes = check_parts(
        (name, key.kind, entries[name]) for name, key in keys.items() if name in entries
    )
    strange = [name for name in entries if name not in keys]
    mistakes += [((WrongKey(name),), unknown("key", name, keys)) for name in strange]
    required = [name for name, key in keys.items() if key.default is REQUIRED]
    # One that is misspelt is not missing as well.
    present = {*entries, *(near(name, keys) for name in strange)}
    if missing := [repr(name) for name in required if name not in present]:
        mistakes.append(((), f"missing {', '.join(missing)}"))
    values |= {name: keys[name].default for name in keys.keys() - {*entries, *required}}
    # In the order in which the keys are declared, which is that in a stored case.
    return {name: values[name] for name in keys if name in values}, mistakes


def unknown_names(
    what: str, named: Mapping[KeyPath, str], valid: Collection[str]
) -> Iterator[Mistake]:
    """A mistake for each of some names, by their paths, that is not among the `valid` ones."""
    return (
        (path, unknown(f"{what} {name!r}", name, valid))
        for path, name in named.items()
        if name not in valid
    )


def expected(what: object, value: Any, hint: str = "") -> Wrong:
    """The mistake of a value that is something else than it should be."""
    return Wrong(((), f"expected {what}, got {shown(value)}{hint}"))


def as_finite(value: Any) -> float | None:
    """The value as a finite double, or None if it is none; a bool is no number."""
    # Python's bool is an int, so `true` would pass as 1.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


Holds = Callable[[float, float], bool]
BOUNDS: dict[str, tuple[str, str, Holds]] = {
    "above": (">", "exclusiveMinimum", operator.gt),
    "least": (">=", "minimum", operator.ge),
    "below": ("<", "exclusiveMaximum", operator.lt),
    "most": ("<=", "maximum", operator.le),
}
"""The bounds that a number can have: sign, JSON Schema's word, and when it holds."""


@dataclass(frozen=True)
class Number(Kind):
    """A finite number within bounds, resolved to a float."""

    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None
    word: ClassVar[str] = "number"

    @cached_property
    def bounds(self) -> list[tuple[float, str, str, Holds]]:
        """The bounds that are set: value, sign, JSON Schema's word, and when it holds."""
        return [
            (x, *rule) for name, rule in BOUNDS.items() if (x := getattr(self, name)) is not None
        ]

    def allows(self, number: float) -> bool:
        """Whether a number is within the bounds."""
        return all(holds(number, bound) for bound, _, _, holds in self.bounds)

    def check(self, value: Any) -> float:
        number = as_finite(value)
        if number is None:
            raise expected(f"a finite {self}", value, number_advice(value))
        if not self.allows(value):
            raise expected(f"a {self}", value)
        return number

    def schema(self) -> dict[str, Any]:
        return {"type": self.word} | {rule: bound for bound, _, rule, _ in self.bounds}

    def __str__(self) -> str:
        signs = (f"{sign} {bound:g}" for bound, sign, _, _ in self.bounds)
        limits = ", ".join(sign for sign in signs if sign != "> 0")
        return f"{'positive ' if self.above == 0 else ''}{self.word} {limits}".rstrip()


class Integer(Number):
    """A whole number; 5e3 is one too."""

    word = "integer"

    def check(self, value: Any) -> int:
        number = as_finite(value)
        if number is None or number != int(number) or not self.allows(value):
            raise expected(f"an {self}", value)
        # Not int(number): a double has lost the last digits of integers beyond 2^53.
        return int(value)


class Choice(Kind):
    """One of a few words; a title stands for a list of them that is too long to read."""

    def __init__(self, *names: str, title: str = "") -> None:
        self.names, self.title = names, title

    def check(self, value: Any) -> Any:
        if isinstance(value, str) and value in self.names:
            return str(value)
        raise expected(self, value, nearest(value, self.names) if isinstance(value, str) else "")

    def takes(self, value: Any) -> bool:
        return isinstance(value, str)

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.names)}

    def __str__(self) -> str:
        *names, last = self.names
        return self.title or (f"{', '.join(names)} or {last}" if names else last)


class Switch(Choice):
    """One of two words, the first for yes, or YAML's true and false; resolved to a bool."""

    def check(self, value: Any) -> bool:
        return value if isinstance(value, bool) else super().check(value) == self.names[0]

    def written(self, value: Any) -> Any:
        return self.names[not value] if isinstance(value, bool) else value

    def takes(self, value: Any) -> bool:
        return isinstance(value, bool) or super().takes(value)

    def schema(self) -> dict[str, Any]:
        return {"enum": [*self.names, True, False]}


@dataclass(frozen=True)
class Text(Kind):
    """Any text, of at least so many characters."""

    least: int = 0

    def check(self, value: Any) -> str:
        if isinstance(value, str) and len(value) >= self.least:
            return str(value)
        is_plain = isinstance(value, bool) or as_finite(value) is not None
        raise expected(self, value, "; put it in quotes" if is_plain else "")

    def schema(self) -> dict[str, Any]:
        return {"type": "string"} | ({"minLength": self.least} if self.least else {})

    def __str__(self) -> str:
        return "text"


# One space at most between number and unit.
ANGLE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)([eE][-+]?\d+)?) ?(deg|rad)", re.ASCII)


@dataclass(frozen=True)
class Angle(Kind):
    """An angle in radians, or text such as "60 deg"; resolved to radians, degrees by
    `math.radians`. A `polar` angle is one from 0 to pi."""

    polar: bool = False

    def check(self, value: Any) -> float:
        text = ANGLE.fullmatch(value) if isinstance(value, str) else None
        number = as_finite(float(text[1]) if text else value)
        if number is None:
            raise expected(self, value)
        angle = math.radians(number) if text and text[3] == "deg" else number
        if self.polar and not 0 <= angle <= math.pi:
            is_in_degrees = not text and 0 <= number <= 180
            hint = f"; degrees are written as '{number:.9g} deg'" if is_in_degrees else ""
            raise expected(self, value, hint)
        return angle

    def schema(self) -> dict[str, Any]:
        bounds = {"minimum": 0, "maximum": math.pi} if self.polar else {}
        text = {"type": "string", "pattern": f"^{ANGLE.pattern}$"}
        return {"anyOf": [{"type": "number"} | bounds, text]}

    def __str__(self) -> str:
        return f"an angle{' from 0 to pi' if self.polar else ''} in radians, or such as '60 deg'"


@dataclass(frozen=True)
class ListOf(Kind):
    """A list of values of a kind, resolved to a tuple: at least so many, or exactly `length`; with
    `alone` a value by itself means a list of one, or that all `length` are equal."""

    kind: Kind
    least: int = 1
    length: int | None = None
    alone: bool = False
    title: str = ""

    def check(self, value: Any) -> tuple[Any, ...]:
        if self.alone and self.kind.takes(value):
            return (self.kind.check(value),) * (self.length or 1)
        if not is_list(value):
            raise expected(self, value)
        length = self.length or len(value)
        if not self.least <= len(value) == length:
            # YAML takes [0,005, 0,004, 0,003] for six numbers, and [1, 0,8, 0,6] for five.
            is_split = isinstance(self.kind, Number) and 0 in value and len(value) > length
            raise expected(self, value, DECIMAL_HINT if is_split else "")
        if self.length == 3 and isinstance(self.kind, Number) and all(map(is_list, value)):
            raise Wrong(((), f"expected {self}; a tensor is a key of other models, as torques"))
        parts = ((i, self.kind, item) for i, item in enumerate(value))
        return tuple(all_right(*check_parts(parts)).values())

    def schema(self) -> dict[str, Any]:
        item = self.kind.schema()
        bounds = {"minItems": self.length or self.least, "maxItems": self.length}
        several = {"type": "array", "items": item} | {k: n for k, n in bounds.items() if n}
        return {"anyOf": [item, several]} if self.alone else several

    def takes(self, value: Any) -> bool:
        return is_list(value) or (self.alone and self.kind.takes(value))

    def __str__(self) -> str:
        return self.title or f"a list{' of one or more' if self.least else ''}: {self.kind}"


def vector(n: int, above: float | None = None, scalar: bool = False) -> ListOf:
    """A list of n numbers; with `scalar` one number means that all are equal."""
    number = Number(above)
    word, _, limits = str(number).partition("number")
    title = f"{n} {word}numbers{limits}" + (" or one for all" if scalar else "")
    return ListOf(number, length=n, alone=scalar, title=title)


def matrix(n: int) -> ListOf:
    """A list of n rows of n numbers."""
    return ListOf(vector(n), length=n, title=f"{n} rows of {n} numbers")


NAMES = ListOf(Text(), least=0, alone=True, title="a name or a list of names")
"""A name or a list of names, resolved to a tuple."""


@dataclass(frozen=True)
class Mapped(Kind):
    """A mapping; used by itself, one whose entries are checked elsewhere."""

    def check(self, value: Any) -> Any:
        if isinstance(value, Mapping):
            return value
        raise expected(self, value)

    def schema(self) -> dict[str, Any]:
        return {"type": "object"}

    def takes(self, value: Any) -> bool:
        return isinstance(value, Mapping)

    def __str__(self) -> str:
        return "a mapping"


@dataclass(frozen=True)
class Table(Mapped):
    """A mapping with fixed keys."""

    keys: Mapping[str, Key]

    def check(self, value: Any) -> dict[str, Any]:
        return all_right(*check_keys(self.keys, super().check(value)))

    def schema(self) -> dict[str, Any]:
        required = [name for name, key in self.keys.items() if key.default is REQUIRED]
        return {
            "type": "object",
            "properties": {name: key.schema() for name, key in self.keys.items()},
            "additionalProperties": False,
        } | ({"required": required} if required else {})

    def __str__(self) -> str:
        return f"a mapping of {', '.join(self.keys)}"


@dataclass(frozen=True)
class Variant(Mapped):
    """A mapping in which one key, `tag`, names the set of the other keys; `doc` is its meaning."""

    tag: str
    tables: Mapping[str, Mapping[str, Key]]
    doc: str

    def check(self, value: Any) -> dict[str, Any]:
        return all_right(*self.check_keys(super().check(value)))

    def check_keys(self, value: Mapping[str, Any]) -> tuple[dict[str, Any], list[Mistake]]:
        """The values with defaults filled in, and all mistakes, as `check_keys` of a table."""
        name = value.get(self.tag)
        if isinstance(name, str) and name in self.tables:
            return check_keys({**self.head(*self.tables), **self.tables[name]}, value)
        # Which other keys are right is not known without the name.
        return check_keys(self.head(*self.tables), {key: name for key in value if key == self.tag})

    def head(self, *names: str) -> dict[str, Key]:
        """The key that names the others, where it may be one of these names."""
        return {self.tag: Key(Choice(*names), self.doc)}

    def schema(self) -> dict[str, Any]:
        return {
            "oneOf": [
                Table({**self.head(name), **keys}).schema() for name, keys in self.tables.items()
            ]
        }

    def __str__(self) -> str:
        return f"a mapping with {self.tag}: {Choice(*self.tables)}"


@dataclass(frozen=True)
class Each(Mapped):
    """A mapping of any names, at least so many, to values of one kind."""

    kind: Kind
    title: str
    least: int = 1

    def check(self, value: Any) -> dict[str, Any]:
        if len(super().check(value)) < self.least:
            raise expected(self, value)
        return all_right(*check_parts((name, self.kind, item) for name, item in value.items()))

    def schema(self) -> dict[str, Any]:
        bounds = {"minProperties": self.least} if self.least else {}
        return {"type": "object", "additionalProperties": self.kind.schema()} | bounds

    def __str__(self) -> str:
        return f"a mapping of {self.title}"


@dataclass(frozen=True)
class OneOf(Table):
    """A mapping with exactly one of some optional keys."""

    def check(self, value: Any) -> dict[str, Any]:
        if isinstance(value, Mapping) and len(value) != 1:
            given = f", of {len(value)} keys: {shown(', '.join(value))}" if value else ""
            raise expected(self, value, given)
        values = super().check(value)
        return {name: values[name] for name in value}

    def schema(self) -> dict[str, Any]:
        return {
            "oneOf": [
                Table({name: Key(key.kind, key.doc)}).schema() for name, key in self.keys.items()
            ]
        }

    def __str__(self) -> str:
        return f"one of {', '.join(self.keys)}"


class Either(Kind):
    """One of several kinds, chosen by the shape of the value, so that messages stay precise.

    Where several kinds take the shape, the first without a mistake counts.
    """

    def __init__(self, *kinds: Kind) -> None:
        self.kinds = kinds

    def check(self, value: Any) -> Any:
        problems = []
        for kind in self.kinds:
            if kind.takes(value):
                try:
                    return kind.check(value)
                except Wrong as error:
                    problems.append(error)
        # Only one kind was meant, so its own mistakes say more than a list of all kinds.
        raise problems[0] if len(problems) == 1 else expected(self, value)

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [kind.schema() for kind in self.kinds]}

    def takes(self, value: Any) -> bool:
        return any(kind.takes(value) for kind in self.kinds)

    def __str__(self) -> str:
        return ", or ".join(map(str, self.kinds))
