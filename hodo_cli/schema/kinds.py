"""The vocabulary in which models, figures and cases declare the keys that they take.

A kind checks plain values (None, bool, int, float, str, list, dict). Its `check(value, at, report)`
never raises: it calls `report(at, message)` for every mistake and returns the resolved value, or
something to go on with. `schema()` is the same rule as JSON Schema, `describe()` the same in a few
words.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, Protocol

Path = tuple[str | int, ...]
"""Where a value stands within its case: keys and zero-based positions."""

Report = Callable[[Path, str], None]


class Misnamed(str):
    """The last part of a path whose mistake is the key itself, not its value."""


class _Required:
    def __repr__(self) -> str:
        return "required"


REQUIRED: Any = _Required()
"""The default of a key that must be given."""


class Kind(Protocol):
    """What every kind offers."""

    def check(self, value: Any, at: Path, report: Report) -> Any:
        """The resolved value; every mistake is reported."""

    def schema(self) -> dict[str, Any]:
        """JSON Schema of the values that `check` takes."""

    def describe(self) -> str:
        """The values that `check` takes, in a few words."""


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
        default = (
            {} if self.default is REQUIRED or self.default is None else {"default": self.default}
        )
        return self.kind.schema() | {"description": self.doc} | default


def resolve(
    keys: Mapping[str, Key], given: Mapping[str, Any], at: Path, report: Report
) -> dict[str, Any]:
    """The values of `keys`, checked, with defaults filled in; keys that are missing or wrong are
    left out."""
    for name in given:
        if name not in keys:
            report((*at, Misnamed(name)), unknown("key", name, keys))
    missing = [name for name, key in keys.items() if name not in given and key.default is REQUIRED]
    if missing:
        report(at, f"missing {', '.join(map(repr, missing))}")
    resolved: dict[str, Any] = {}
    for name, key in keys.items():
        if name in given:
            wrong = False

            def note(place: Path, message: str) -> None:
                nonlocal wrong
                wrong = True
                report(place, message)

            value = key.kind.check(given[name], (*at, name), note)
            if not wrong:
                resolved[name] = value
        elif key.default is not REQUIRED:
            resolved[name] = key.default
    return resolved


def unknown(what: str, name: str, valid: Iterable[str]) -> str:
    """The sentence for a name that is none of `valid`, with the nearest spelling."""
    names = list(valid)
    listed = f" (valid: {', '.join(names)})" if 0 < len(names) <= 40 else ""
    return f"unknown {what}{nearest(name, names)}{listed}"


def nearest(name: str, valid: Iterable[str]) -> str:
    """'; did you mean ...?', or nothing when no name is near; long lists are not searched."""
    # The comparison takes milliseconds a name, and a mistaken file can have a thousand of them.
    folded = {option.casefold(): option for option in valid}
    if len(folded) > 1000 or not (close := get_close_matches(name[:200].casefold(), folded, n=1)):
        return ""
    return f"; did you mean {folded[close[0]]!r}?"


def shown(value: Any) -> str:
    """A value as a message names it, in YAML's words and shortened."""
    match value:
        case None:
            return "an empty value"
        case bool():
            return str(value).lower()
        case str():
            return repr(value if len(value) <= 60 else value[:57] + "...")
        # A message of 300 digits hides what it says.
        case int() if abs(value) >= 10**30:
            return "a huge integer"
        case int() | float():
            return repr(value)
        case list() | tuple():
            return f"a list of {len(value)}"
    return "a mapping"


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple)


def _is_scalar(value: Any) -> bool:
    return not _is_list(value) and not isinstance(value, Mapping)


def _real(value: Any) -> float | None:
    """The value as a finite double, or None if it is none; a bool is no number."""
    # Python's bool is an int, so `true` would pass as 1.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _bounds(kind: "Number | Integer") -> list[tuple[str, str, float]]:
    """The bounds that a kind has: sign, JSON Schema's word, value."""
    words = (("above", ">", "exclusiveMinimum"), ("least", ">=", "minimum"),
             ("below", "<", "exclusiveMaximum"), ("most", "<=", "maximum"))  # fmt: skip
    values = ((sign, word, getattr(kind, name, None)) for name, sign, word in words)
    return [(sign, word, value) for sign, word, value in values if value is not None]


_HOLDS: dict[str, Callable[[float, float], bool]] = {
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
}


@dataclass(frozen=True)
class Number:
    """A finite number, resolved to a float."""

    above: float | None = None
    least: float | None = None
    below: float | None = None
    most: float | None = None

    def check(self, value: Any, at: Path, report: Report) -> float:
        number = _real(value)
        if number is None:
            report(at, f"wants a finite {self.describe()}, not {shown(value)}")
            return math.nan
        if not all(_HOLDS[sign](number, bound) for sign, _, bound in _bounds(self)):
            report(at, f"wants a {self.describe()}, not {shown(value)}")
        return number

    def schema(self) -> dict[str, Any]:
        return {"type": "number"} | {word: bound for _, word, bound in _bounds(self)}

    def describe(self) -> str:
        return " ".join(
            ["number", ", ".join(f"{sign} {bound:g}" for sign, _, bound in _bounds(self))]
        ).rstrip()


@dataclass(frozen=True)
class Integer:
    """A whole number; 5e3 is one too."""

    least: int | None = None
    most: int | None = None

    def check(self, value: Any, at: Path, report: Report) -> int:
        number = _real(value)
        if number is None or number != int(number):
            report(at, f"wants an {self.describe()}, not {shown(value)}")
            return 0
        if not all(_HOLDS[sign](number, bound) for sign, _, bound in _bounds(self)):
            report(at, f"wants an {self.describe()}, not {shown(value)}")
        # Not int(number): a double has lost the last digits of integers beyond 2^53.
        return int(value)

    def schema(self) -> dict[str, Any]:
        return {"type": "integer"} | {word: bound for _, word, bound in _bounds(self)}

    def describe(self) -> str:
        return " ".join(
            ["integer", ", ".join(f"{sign} {bound:g}" for sign, _, bound in _bounds(self))]
        ).rstrip()


@dataclass(frozen=True, init=False)
class Choice:
    """One of a few words."""

    names: tuple[str, ...]

    def __init__(self, *names: str) -> None:
        object.__setattr__(self, "names", names)

    def check(self, value: Any, at: Path, report: Report) -> str:
        if isinstance(value, str) and value in self.names:
            return str(value)
        near = nearest(value, self.names) if isinstance(value, str) else ""
        report(at, f"wants {self.describe()}, not {shown(value)}{near}")
        return self.names[0]

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.names)}

    def describe(self) -> str:
        *names, last = self.names
        return f"{', '.join(names)} or {last}" if names else last


@dataclass(frozen=True)
class Text:
    """Any text."""

    def check(self, value: Any, at: Path, report: Report) -> str:
        if not isinstance(value, str):
            report(
                at,
                f"wants text, not {shown(value)}"
                + ("; put it in quotes" if _real(value) is not None else ""),
            )
            return ""
        return str(value)

    def schema(self) -> dict[str, Any]:
        return {"type": "string"}

    def describe(self) -> str:
        return "text"


@dataclass(frozen=True)
class Angle:
    """An angle in radians, or text such as "60 deg"; resolved to radians, degrees by
    `math.radians`."""

    def check(self, value: Any, at: Path, report: Report) -> float:
        if isinstance(value, str) and (
            match := re.fullmatch(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?) ?(deg|rad)", value)
        ):
            try:
                number = _real(float(match[1]))
            except ValueError:
                number = None
            if number is not None:
                return math.radians(number) if match[2] == "deg" else number
        elif (number := _real(value)) is not None:
            return number
        report(at, f"wants {self.describe()}, not {shown(value)}")
        return 0.0

    def schema(self) -> dict[str, Any]:
        text = {"type": "string", "pattern": r"^[-+]?[0-9.]+([eE][-+]?[0-9]+)? ?(deg|rad)$"}
        return {"anyOf": [{"type": "number"}, text]}

    def describe(self) -> str:
        return "an angle in radians, or such as '60 deg'"


@dataclass(frozen=True)
class Vector:
    """A list of n numbers, resolved to a tuple; with `scalar` one number means that all are
    equal."""

    n: int
    above: float | None = None
    scalar: bool = False

    def check(self, value: Any, at: Path, report: Report) -> tuple[float, ...]:
        if self.scalar and _is_scalar(value):
            return (Number(self.above).check(value, at, report),) * self.n
        if not _is_list(value) or len(value) != self.n:
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return (math.nan,) * self.n
        return tuple(
            Number(self.above).check(item, (*at, i), report) for i, item in enumerate(value)
        )

    def schema(self) -> dict[str, Any]:
        one = Number(self.above).schema()
        many = {"type": "array", "items": one, "minItems": self.n, "maxItems": self.n}
        return {"anyOf": [one, many]} if self.scalar else many

    def describe(self) -> str:
        bound = "" if self.above is None else f" > {self.above:g}"
        return f"{self.n} numbers{bound}" + (" or one for all" if self.scalar else "")


@dataclass(frozen=True)
class Matrix:
    """A list of n rows of n numbers, resolved to a tuple of tuples."""

    n: int

    def check(self, value: Any, at: Path, report: Report) -> tuple[tuple[float, ...], ...]:
        if not _is_list(value) or len(value) != self.n:
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return ((math.nan,) * self.n,) * self.n
        return tuple(Vector(self.n).check(row, (*at, i), report) for i, row in enumerate(value))

    def schema(self) -> dict[str, Any]:
        return {
            "type": "array",
            "items": Vector(self.n).schema(),
            "minItems": self.n,
            "maxItems": self.n,
        }

    def describe(self) -> str:
        return f"{self.n} rows of {self.n} numbers"


@dataclass(frozen=True)
class Table:
    """A mapping with fixed keys."""

    keys: Mapping[str, Key]

    def check(self, value: Any, at: Path, report: Report) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return {}
        return resolve(self.keys, value, at, report)

    def schema(self) -> dict[str, Any]:
        required = [name for name, key in self.keys.items() if key.default is REQUIRED]
        return {
            "type": "object",
            "properties": {name: key.schema() for name, key in self.keys.items()},
            "additionalProperties": False,
        } | ({"required": required} if required else {})

    def describe(self) -> str:
        return f"a mapping of {', '.join(self.keys)}"


@dataclass(frozen=True)
class Variant:
    """A mapping in which one key, `tag`, names the set of the other keys."""

    tag: str
    tables: Mapping[str, Mapping[str, Key]]

    def check(self, value: Any, at: Path, report: Report) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return {}
        choice = Choice(*self.tables)
        name = value.get(self.tag)
        if self.tag not in value or not isinstance(name, str) or name not in self.tables:
            return resolve(
                {self.tag: Key(choice, "")},
                {k: v for k, v in value.items() if k == self.tag},
                at,
                report,
            )
        return resolve({self.tag: Key(choice, ""), **self.tables[name]}, value, at, report)

    def schema(self) -> dict[str, Any]:
        tables = self.tables.items()
        return {
            "oneOf": [
                Table({self.tag: Key(Choice(name), "which law"), **keys}).schema()
                for name, keys in tables
            ]
        }

    def describe(self) -> str:
        return f"a mapping with {self.tag}: {Choice(*self.tables).describe()}"


@dataclass(frozen=True)
class Sequence:
    """A list of one or more values of a kind, resolved to a tuple."""

    kind: Kind

    def check(self, value: Any, at: Path, report: Report) -> tuple[Any, ...]:
        if not _is_list(value) or not value:
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return ()
        return tuple(self.kind.check(item, (*at, i), report) for i, item in enumerate(value))

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": self.kind.schema(), "minItems": 1}

    def describe(self) -> str:
        return f"a list of one or more: {self.kind.describe()}"


@dataclass(frozen=True)
class Names:
    """A name or a list of names, resolved to a tuple."""

    def check(self, value: Any, at: Path, report: Report) -> tuple[str, ...]:
        if isinstance(value, str):
            return (str(value),)
        if not _is_list(value):
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return ()
        return tuple(Text().check(item, (*at, i), report) for i, item in enumerate(value))

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}

    def describe(self) -> str:
        return "a name or a list of names"


@dataclass(frozen=True, init=False)
class Either:
    """One of several kinds, chosen by the shape of the value (mapping, list, scalar), so that
    errors stay precise.

    Where several kinds take the shape, the first without a mistake counts; a Variant or Table takes
    mappings, a Vector, Matrix or Sequence lists, Names and a Vector with `scalar` both lists and
    scalars.
    """

    kinds: tuple[Kind, ...]

    def __init__(self, *kinds: Kind) -> None:
        object.__setattr__(self, "kinds", kinds)

    def check(self, value: Any, at: Path, report: Report) -> Any:
        fitting = [kind for kind in self.kinds if _takes(kind, value)]
        for kind in fitting:
            mistakes: list[tuple[Path, str]] = []
            # Bound as a default, because the loop rebinds the name before a later call.
            resolved = kind.check(value, at, lambda *mistake, to=mistakes: to.append(mistake))
            if not mistakes:
                return resolved
        # Only one kind was meant, so its own mistakes say more than a list of all kinds.
        if len(fitting) == 1:
            return fitting[0].check(value, at, report)
        report(at, f"wants {self.describe()}, not {shown(value)}")
        return None

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [kind.schema() for kind in self.kinds]}

    def describe(self) -> str:
        return ", or ".join(kind.describe() for kind in self.kinds)


def _takes(kind: Kind, value: Any) -> bool:
    """Whether a value has the outer shape that a kind wants."""
    match kind:
        case Either():
            return any(_takes(inner, value) for inner in kind.kinds)
        case Table() | Variant() | Data():
            return isinstance(value, Mapping)
        case Matrix() | Sequence():
            return _is_list(value)
        case Vector():
            return _is_list(value) or kind.scalar and _is_scalar(value)
        case Names():
            return not isinstance(value, Mapping)
    return _is_scalar(value)


@dataclass(frozen=True)
class Data:
    """A mapping of plain data that is kept as given; only its numbers must be finite."""

    def check(self, value: Any, at: Path, report: Report) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return {}
        return {str(name): plain(item, (*at, name), report) for name, item in value.items()}

    def schema(self) -> dict[str, Any]:
        return {"type": "object"}

    def describe(self) -> str:
        return "a mapping"


def plain(value: Any, at: Path, report: Report) -> Any:
    """A copy of nested lists and mappings; a number that is not finite is reported."""
    if isinstance(value, Mapping):
        return {str(name): plain(item, (*at, name), report) for name, item in value.items()}
    if _is_list(value):
        return [plain(item, (*at, i), report) for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        report(at, f"wants a finite number, not {shown(value)}")
    return value
