"""YAML 1.2 text as plain values with their places, and all mistakes in it as one error. The only
importer of PyYAML.

Only the events of PyYAML's parser are used, because its constructor follows YAML 1.1 and expands
aliases without a bound. Documents may come from strangers: their size, depth and number of values
are limited, and tags are refused.
"""

import json
import re
from typing import Any, NamedTuple, NoReturn

import yaml

from .. import HodoError
from .kinds import KeyPath, WrongKey
from .spelling import shown

YAML_SUFFIXES = (".yaml", ".yml")
MAX_BYTES, MAX_DEPTH, MAX_VALUES, MAX_ALIASED, MAX_KEY = 16_000_000, 50, 1_500_000, 100_000, 128
MAX_MISTAKES = 100

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# The characters that YAML 1.2.2, 5.1, calls printable.
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class Place(NamedTuple):
    """Line and column in a file, both from 1."""

    line: int
    column: int


class Source:
    """A text with the places of its keys and values, the values that overrides have set, and the
    mistakes that were noted in it."""

    def __init__(self, name: str) -> None:
        self.name, self.override = name, ""
        self.document: Any = None
        # Places of key and value, by the container's identity: the document keeps the containers
        # alive.
        self.places: dict[tuple[int, str | int], tuple[Place, Place]] = {}
        self.overridden: dict[tuple[str, ...], str] = {}
        self.noted: dict[tuple[bool, Any, str], None] = {}
        self.anchors: dict[str, tuple[Any, int] | None] = {}
        self.count = self.aliased = 0

    def note(self, place: Place | str, message: str, path: KeyPath = ()) -> None:
        """Note a mistake. Raises HodoError with all of them once there are MAX_MISTAKES."""
        where = ".".join(str(key) for key in path if key != "")
        place, text = self.override or place, f"{where}: {message}" if where else message
        self.noted[isinstance(place, str), place, text] = None
        if len(self.noted) >= MAX_MISTAKES:
            raise self.error(f"{self.name}: stopped at {MAX_MISTAKES} mistakes")

    def fail(self, place: Place | str, message: str, path: KeyPath = ()) -> NoReturn:
        """Raise a mistake that ends the reading, with all mistakes noted so far."""
        self.note(place, message, path)
        raise self.error() from None

    def error(self, *last: str) -> HodoError:
        """The error with one line for each mistake, by line and column; mistakes in overrides come
        last."""
        lines = [
            f"--set {place}: {text}" if is_set else f"{self.name}:{place[0]}:{place[1]}: {text}"
            for is_set, place, text in sorted(self.noted)
        ]
        return HodoError("\n".join(map(_one_line, [*lines, *last])))

    def raise_any(self) -> None:
        """Raise all mistakes noted so far, if there are any."""
        if self.noted:
            raise self.error()

    def locate(self, path: KeyPath) -> Place:
        """The place of the value at a path of the document, or of its nearest ancestor."""
        node, place = self.document, Place(1, 1)
        for part in path:
            if (places := self.places.get((id(node), part))) is None:
                break
            of_key, of_value = places
            place = of_key if isinstance(part, WrongKey) else of_value
            node = node[part]
        return place

    def read(self, text: str) -> Any:
        """The single value of a text. Raises HodoError, with all mistakes noted, if the text is not
        YAML or exceeds a limit."""
        if bad := _UNPRINTABLE.search(text):
            before = text[: bad.start()]
            place = Place(before.count("\n") + 1, len(before) - before.rfind("\n"))
            self.fail(place, _unprintable(ord(bad[0])))
        self.events = yaml.parse(text, Loader=_LOADER)
        try:
            value = None
            starts = (event for event in self.events if isinstance(event, yaml.DocumentStartEvent))
            for number, start in enumerate(starts):
                if number:
                    self.fail(_place(start), "a second document starts here; one is allowed")
                value, _ = self._value(next(self.events), (), _place(start))
            return value
        except yaml.YAMLError as error:
            self.fail(*_syntax_mistake(error, bool(self.override)))

    def _value(self, event: Any, path: KeyPath, outer: Place) -> tuple[Any, Place]:
        """The value that begins with an event, and its place; `outer` is the place of its key."""
        place, before = _place(event), self.count
        self.count += 1
        if self.count > MAX_VALUES:
            self.fail(place, f"more than {MAX_VALUES} values: split the file", path)
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, path, place), place
        if event.tag:
            self.fail(place, f"the tag {shown(event.tag)} is not allowed here", path)
        if event.anchor:
            # None, because an alias within the value would make it contain itself.
            self.anchors[event.anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            if _UNPRINTABLE.search(event.value):
                self.note(place, "control characters are not allowed in text", path)
            # A quoted value is text; an empty value has no place of its own.
            value = resolve_scalar(event.value) if event.implicit[0] else event.value
            place = place if event.value or not path else outer
        else:
            if len(path) >= MAX_DEPTH:
                self.fail(place, f"nested deeper than {MAX_DEPTH} levels")
            # A value in block style begins a line below its key; a reader looks at the key.
            if path and isinstance(path[-1], str) and not event.flow_style:
                place = outer
            is_mapping = isinstance(event, yaml.MappingStartEvent)
            value = self._mapping(path, place) if is_mapping else self._list(path, place)
        if event.anchor:
            self.anchors[event.anchor] = value, self.count - before
        return value, place

    def _alias(self, event: Any, path: KeyPath, place: Place) -> Any:
        """The value of the anchor that an alias names."""
        if (anchored := self.anchors.get(event.anchor)) is None:
            reason = (
                "stands inside itself"
                if event.anchor in self.anchors
                else "has no anchor before it"
            )
            self.fail(place, f"*{event.anchor} {reason}", path)
        value, size = anchored
        self.aliased += size
        self.count += size
        if self.aliased > MAX_ALIASED:
            self.fail(place, f"aliases stand for more than {MAX_ALIASED} values", path)
        return value

    def _list(self, path: KeyPath, place: Place) -> list[Any]:
        """The list that has begun, up to its end."""
        items: list[Any] = []
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            value, of_value = self._value(event, (*path, len(items)), place)
            self.places[id(items), len(items)] = of_value, of_value
            items.append(value)
        return items

    def _mapping(self, path: KeyPath, place: Place) -> dict[str, Any]:
        """The mapping that has begun, up to its end; of two equal keys the first counts."""
        entries: dict[str, Any] = {}
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            of_key = _place(event)
            key = self._key(event, of_key, path)
            value, of_value = self._value(next(self.events), (*path, key), of_key)
            if key in entries:
                line = self.places[id(entries), key][0].line
                self.note(of_key, f"duplicate key; the first is in line {line}", (*path, key))
            else:
                entries[key] = value
                self.places[id(entries), key] = of_key, of_value
        return entries

    def _key(self, event: Any, place: Place, path: KeyPath) -> str:
        """A key is its text as written: `404:` is the name "404"."""
        if not isinstance(event, yaml.ScalarEvent) or event.anchor or event.tag:
            self.fail(place, "a key is plain text, without anchor or tag", path)
        if len(event.value) > MAX_KEY or _UNPRINTABLE.search(event.value):
            self.fail(place, f"a key is printable text of at most {MAX_KEY} characters", path)
        if event.value == "<<" and event.implicit[0]:
            self.fail(
                place,
                "merge keys (<<) are not part of YAML 1.2; write the keys out, or use defaults:",
                path,
            )
        return str(event.value)


def _unprintable(code: int) -> str:
    """What is wrong with a character. Python represents bytes that are not UTF-8 by surrogates."""
    if 0x80 <= code - 0xDC00 <= 0xFF:
        return f"not UTF-8 text (byte {code - 0xDC00:#04x})"
    return f"the character U+{code:04X} is not allowed"


def _place(event: Any) -> Place:
    return Place(event.start_mark.line + 1, event.start_mark.column + 1)


# Names of files and values may hold line breaks, and terminals obey control characters.
def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


PLAINER = {
    "mapping values are not allowed": "a second ': ' on one line, or none on the line before: put "
    "a space after each colon, indent new keys, put other texts in quotes",
    "could not find expected ':'": "no ': ' between key and value: put a space after the colon",
    "flow sequence": "the [{} is not closed, or lacks a comma",
    "flow mapping": "the {{{} is not closed, or lacks a comma",
    "flow node": "the [ or {{{} is not closed, or has a comma too many",
    "quoted scalar": "the quote{} is not closed",
    "an alias": "put a text that begins with * in quotes",
    "cannot start any token": "indent with spaces, not with a tab; put a text that begins with "
    "this sign in quotes",
}
"""The usual mistakes in plainer words than PyYAML's own."""


def _syntax_mistake(error: Any, is_value: bool) -> tuple[Place, str]:
    """Where and why PyYAML refuses a text, or a single value."""
    mark: Any = getattr(error, "problem_mark", None)
    opening: Any = getattr(error, "context_mark", None)
    if mark is None:
        return Place(1, 1), f"not YAML: {error}"
    reason = " ".join(filter(None, (error.context, error.problem)))
    plainer = (says for problem, says in PLAINER.items() if problem in reason)
    of_line = f" of line {opening.line + 1}" if opening and not is_value else ""
    words = next(plainer, reason).format(of_line)
    # Where PyYAML has looked for a colon in vain, `opening` is the key that lacks it.
    mark = opening if "simple key" in reason else mark
    return Place(mark.line + 1, mark.column + 1), f"not YAML: {words}"


_INFINITE = (".inf", ".Inf", ".INF")
_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **{sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in _INFINITE},
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
# The time of int() grows as the square of the number of digits; longer numbers are infinite, and
# refused.
_INTEGER = re.compile(r"[-+]?[0-9]{1,300}|0o[0-7]{1,300}|0x[0-9a-fA-F]{1,200}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


def resolve_scalar(text: str) -> Any:
    """The value of a plain scalar by the core schema of YAML 1.2: None, bool, int, float or str."""
    if text in _WORDS:
        return _WORDS[text]
    if text[0] not in "+-.0123456789":
        return text
    if _INTEGER.fullmatch(text):
        return int(text[2:], {"o": 8, "x": 16}[text[1]]) if text[1:2] in ("o", "x") else int(text)
    return float(text) if _FLOAT.fullmatch(text) else text


# Characters that JSON allows and readers of YAML refuse or fold.
_ESCAPED = re.compile("[\x7f-\xa0\u2028\u2029\ufeff\ufffe\uffff\ud800-\udfff]")


def write(value: Any) -> str:
    """A plain value as JSON, which is YAML 1.2 too. Numbers keep every bit."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    return _ESCAPED.sub(lambda c: f"\\u{ord(c[0]):04x}", text)


def read_mapping(text: str, source: Source) -> dict[str, Any]:
    """The mapping that a text holds, which becomes the source's document. Raises HodoError."""
    document = source.document = source.read(text)
    if not isinstance(document, dict):
        source.fail(Place(1, 1), f"expected a mapping of keys to values, got {shown(document)}")
    return document
