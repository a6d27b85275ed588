"""YAML 1.2 text as plain values that know their place, and back, and the mistakes in it, all of
them as one error: the only importer of PyYAML.

PyYAML's own constructor is not used: it follows YAML 1.1 (`1e-3` text, `no` a bool, `12:30:00` a
number, the last of two equal keys wins), and expands aliases without a bound. Here the parser's
events are read by recursive descent. Scalars follow the core schema of YAML 1.2, in which `010` is
the integer ten. Documents may come from strangers: their size, depth and number of values are
limited, and tags are refused: what a value is, follows from how it is written.

Source: YAML 1.2.2, section 10.3 (core schema).
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple, NoReturn

import yaml

from .. import HodoError
from .kinds import KeyPath, WrongKey
from .spelling import colon_hint, shown

YAML_SUFFIXES = (".yaml", ".yml")
"""The suffixes of YAML files."""

# A hundred thousand cases of a dozen values are read in 20 s and 0.7 GB; the papers' files
# hold 1,300 values at most, 8 levels deep.
MAX_BYTES = 16_000_000
# Reading and checks recurse, a few frames a level: far below Python's limit of 1,000.
MAX_DEPTH = 50
MAX_VALUES = 1_500_000
# An alias costs the reader nothing, but every check walks what it stands for, and nine anchors of
# nine aliases each stand for 9^9 values.
MAX_ALIASED = 100_000
# Names of cases and figures become names of files, which end at 255 bytes on most systems.
MAX_KEY = 128

# The parser in C, where PyYAML was built with it; only its events are used, never its constructor.
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# The characters that YAML 1.2.2, 5.1, calls printable.
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


UNDECODED = range(0xDC80, 0xDD00)
"""The characters by which Python stands for bytes that are no UTF-8 ("surrogateescape")."""

OPENED = {
    "while parsing a flow sequence": "the [",
    "while parsing a flow mapping": "the {",
    "while parsing a flow node": "the [ or {",
}
"""PyYAML's words for the brackets that an unfinished text leaves open."""


# A file that is no case file at all has a mistake in every line; nobody reads a thousand.
MAX_MISTAKES = 1000

# So many are listed one by one; of more, the first few show what is wrong with the file.
MISTAKES_LISTED, MISTAKES_FIRST = 100, 20


class Place(NamedTuple):
    """Where a value stands: line and column of the file from 1, or in the text of an override."""

    line: int
    column: int
    override: str = ""

    def shown(self, file: str) -> str:
        """The place as a message begins with it."""
        return f"--set {self.override}" if self.override else f"{file}:{self.line}:{self.column}"


class Mistakes:
    """The mistakes found in a file, each once, to be raised together."""

    def __init__(self, name: str) -> None:
        self.name = name
        # A dict keeps each once: what is wrong in `defaults` is met again in every case that
        # inherits it. The flag sorts overrides behind the file's own mistakes.
        self.noted: dict[tuple[bool, Place, str], None] = {}

    def add(self, place: Place, message: str, path: KeyPath = ()) -> None:
        """Note a mistake; raises them all when there are too many to go on."""
        # An empty key would be a point without a name.
        where = ".".join(str(key) for key in path if key != "")
        self.noted[bool(place.override), place, f"{where}: {message}" if where else message] = None
        if len(self.noted) >= MAX_MISTAKES:
            raise self.error(f"{self.name}: stopped at {MAX_MISTAKES} mistakes")

    def fail(self, place: Place, message: str, path: KeyPath = ()) -> NoReturn:
        """Raise a mistake after which reading cannot go on, with all mistakes so far."""
        self.add(place, message, path)
        raise self.error() from None

    def error(self, *last: str) -> HodoError:
        """One line for each mistake, by line and column; mistakes of overrides and the `last` lines
        behind them."""
        listed = len(self.noted) if len(self.noted) <= MISTAKES_LISTED else MISTAKES_FIRST
        lines = [
            f"{place.shown(self.name)}: {text}" for _, place, text in sorted(self.noted)[:listed]
        ]
        if more := len(self.noted) - listed:
            lines.append(f"{self.name}: and {more} more mistakes")
        return HodoError("\n".join(map(_one_line, [*lines, *last])))

    def raise_any(self) -> None:
        """Raise what was noted, if anything was."""
        if self.noted:
            raise self.error()


# Names of files and values may hold line breaks, and terminals obey control characters.
def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class Block(dict[str, Any]):
    """A mapping that knows the places of its keys and values, and which keys it inherited from
    `defaults`.

    A value that is itself a mapping or list in block style has the place of its key.
    """

    def __init__(self, entries: Mapping[str, Any] = MappingProxyType({})) -> None:
        """A copy of a mapping, of another block with its places."""
        super().__init__(entries)
        self.places: dict[str, tuple[Place, Place]] = {**getattr(entries, "places", {})}
        self.inherited: set[str] = {*getattr(entries, "inherited", ())}

    def put(self, key: str, value: Any, key_place: Place, value_place: Place) -> None:
        """Set one entry."""
        self[key] = value
        self.places[key] = key_place, value_place
        self.inherited.discard(key)

    def over(self, common: Mapping[str, Any]) -> "Block":
        """These entries, and those of `common` that are lacking here, marked as inherited; an empty
        value here takes an entry of `common` back."""
        entries = {**common, **self}
        taken_back = {key for key in common.keys() & self.keys() if self[key] is None}
        merged = Block({key: entries[key] for key in entries if key not in taken_back})
        merged.places = Block(common).places | self.places
        merged.inherited = {*common} - {*self}
        return merged


class Items(list[Any]):
    """A list that knows the places of its values."""

    def __init__(self, values: Iterable[Any] = (), places: Iterable[Place] = ()) -> None:
        super().__init__(values)
        self.places = [*places]


def locate(root: Any, path: KeyPath) -> tuple[Place, bool]:
    """The place of the value at a path, or of its nearest ancestor, and whether `defaults` gave
    it."""
    node, place, inherited = root, Place(1, 1), False
    for part in path:
        if isinstance(node, Block) and isinstance(part, str) and part in node:
            inherited = inherited or part in node.inherited
            key_place, value_place = node.places[part]
            place = key_place if isinstance(part, WrongKey) else value_place
            node = node[part]
        elif isinstance(node, Items) and isinstance(part, int) and part < len(node):
            place, node = node.places[part], node[part]
        else:
            break
    return place, inherited


def read(text: str, mistakes: Mistakes, override: str = "") -> Any:
    """The one document of a text, as nested Block, Items and scalars.

    Duplicate keys are noted in `mistakes`. Raises HodoError, with all that was noted, for text that
    is not YAML or exceeds a limit.
    """
    reader = _Reader(text, mistakes, override)
    # PyYAML refuses such a character too, but its error has no line and column.
    if bad := _UNPRINTABLE.search(text):
        line = text.count("\n", 0, bad.start()) + 1
        column, code = bad.start() - text.rfind("\n", 0, bad.start()), ord(bad[0])
        message = f"the character U+{code:04X} is not allowed"
        if code in UNDECODED:
            message = f"not UTF-8 text (byte {code - 0xDC00:#04x})"
        mistakes.fail(Place(line, column, override), message)
    try:
        return reader.document()
    except yaml.YAMLError as error:
        place, reason = _syntax_mistake(error, text, override)
        mistakes.fail(place, f"not YAML: {reason}")


def _syntax_mistake(error: Any, text: str, override: str) -> tuple[Place, str]:
    """Where and why PyYAML refuses a text."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    if mark is None:
        return Place(1, 1, override), str(error)
    lines = text.split("\n")
    before = "".join(lines[mark.line : mark.line + 1])[: mark.column]
    if error.problem in (NO_MAPPING_HERE, NO_COLON) and not COLON.search(before):
        # The scanner has taken a line without a colon for text that goes on below it.
        number = next((i for i in reversed(range(mark.line)) if CONTENT.match(lines[i])), 0)
        line = lines[number]
        if mark.line and not COLON.search(line):
            place = Place(number + 1, len(line) - len(line.lstrip()) + 1, override)
            return place, colon_hint(line) or "no ': ' between key and value"
    place = Place(mark.line + 1, mark.column + 1, override)
    return place, _reason(error, mark, text, override)


NO_MAPPING_HERE = "mapping values are not allowed in this context"
NO_COLON = "could not find expected ':'"
"""What PyYAML says of a second colon in one value, and of a line without one."""

FIRST_SIGNS = {"while scanning an alias": "*", "while scanning an anchor": "&"}
NO_START = "that cannot start any token"
"""What PyYAML says of a text that begins with a sign of its own, and of one that begins with @."""

COLON, CONTENT = re.compile(r":(\s|$)"), re.compile(r"\s*[^\s#]")
"""The end of a key; the begin of a line that is neither empty nor a comment."""


def _reason(error: Any, mark: yaml.Mark, text: str, override: str) -> str:
    """Why PyYAML refuses a text; the usual mistakes in plainer words than its own."""
    # The end of a text may be a line beyond its last.
    lines = text.split("\n")[mark.line : mark.line + 1]
    bracket, opening = OPENED.get(error.context, ""), error.context_mark
    # An override is one line, and stands within a document of its own.
    where = f" of line {opening.line + 1}" if opening and not override else ""
    reasons = (
        (any("\t" in line[: mark.column + 1] for line in lines), "a tab; indent with spaces"),
        (
            error.problem == NO_MAPPING_HERE,
            "a second ': ' on one line: indent a new key, or put the text in quotes",
        ),
        (
            bracket and any(line[mark.column : mark.column + 1] == "," for line in lines),
            f"{bracket}{where} has a comma too many",
        ),
        (bracket and opening, f"{bracket}{where} is not closed, or lacks a comma"),
        (error.context == "while scanning a quoted scalar", f"the quote{where} is not closed"),
        (
            error.context in FIRST_SIGNS or NO_START in str(error.problem),
            f"put a text that begins with {FIRST_SIGNS.get(error.context, 'this sign')} in quotes",
        ),
        (True, ", ".join(filter(None, (error.context, error.problem)))),
    )
    return next(reason for holds, reason in reasons if holds)


class _Reader:
    """Builds the values from the events of the parser, by recursive descent: a document is a value;
    a value is a scalar, an alias, a list of values, or a mapping of keys to values.

    `path` is where a value stands. `outer` is the place of the key, or of the list, to which it
    belongs.
    """

    def __init__(self, text: str, mistakes: Mistakes, override: str) -> None:
        self.events: Iterator[Any] = yaml.parse(text, Loader=_LOADER)
        self.mistakes, self.override = mistakes, override
        # None while the value is being read: an alias there would make it contain itself.
        self.anchors: dict[str, tuple[Any, int] | None] = {}
        self.count = self.aliased = 0

    def place(self, mark: Any) -> Place:
        return Place(mark.line + 1, mark.column + 1, self.override)

    def document(self) -> Any:
        """The value of the one document; None where there is none."""
        root = None
        starts = (event for event in self.events if isinstance(event, yaml.DocumentStartEvent))
        for number, start in enumerate(starts):
            place = self.place(start.start_mark)
            if number:
                self.mistakes.fail(place, "a second document starts here; one is allowed")
            root, _ = self.value(next(self.events), (), place)
        return root

    def value(self, event: Any, path: KeyPath, outer: Place) -> tuple[Any, Place]:
        """The value that begins with an event, and its place."""
        place, before = self.place(event.start_mark), self.count
        self.count += 1
        if self.count > MAX_VALUES:
            self.mistakes.fail(place, f"more than {MAX_VALUES} values: split the file", path)
        if isinstance(event, yaml.AliasEvent):
            return self.alias(event, path, place), place
        if event.tag:
            self.mistakes.fail(place, f"the tag {shown(event.tag)} is not allowed here", path)
        if event.anchor:
            self.anchors[event.anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            value = self.scalar(event, path, place)
            # An empty value has no place of its own: the parser's mark stands behind the next line
            # break.
            place = place if event.value or not path else outer
        else:
            # A value in block style begins a line below its key, where no reader looks for the
            # mistake.
            if path and isinstance(path[-1], str) and not event.flow_style:
                place = outer
            value = self.collection(event, path, place)
        if event.anchor:
            self.anchors[event.anchor] = (value, self.count - before)
        return value, place

    def scalar(self, event: Any, path: KeyPath, place: Place) -> Any:
        if _UNPRINTABLE.search(event.value):
            self.mistakes.add(place, "control characters are not allowed in text", path)
        # What is quoted is a text, whatever it looks like.
        return resolve_scalar(event.value) if event.implicit[0] else event.value

    def alias(self, event: Any, path: KeyPath, place: Place) -> Any:
        anchored = self.anchors.get(event.anchor)
        if anchored is None:
            known = event.anchor in self.anchors
            reason = "stands inside itself" if known else "has no anchor before it"
            self.mistakes.fail(place, f"*{event.anchor} {reason}", path)
        value, size = anchored
        self.aliased += size
        if self.aliased > MAX_ALIASED:
            self.mistakes.fail(place, f"aliases stand for more than {MAX_ALIASED} values", path)
        self.count += size
        return value

    def collection(self, event: Any, path: KeyPath, place: Place) -> Block | Items:
        if len(path) >= MAX_DEPTH:
            self.mistakes.fail(place, f"nested deeper than {MAX_DEPTH} levels")
        is_mapping = isinstance(event, yaml.MappingStartEvent)
        return self.mapping(path) if is_mapping else self.items(path, place)

    def items(self, path: KeyPath, place: Place) -> Items:
        items = Items()
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            value, value_place = self.value(event, (*path, len(items)), place)
            items.append(value)
            items.places.append(value_place)
        return items

    def mapping(self, path: KeyPath) -> Block:
        block = Block()
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            key, key_place = self.key(event, path)
            key_path = (*path, key)
            value, value_place = self.value(next(self.events), key_path, key_place)
            if key in block:
                self.mistakes.add(
                    key_place,
                    f"duplicate key; the first is in line {block.places[key][0].line}",
                    key_path,
                )
            else:
                block.put(key, value, key_place, value_place)
        return block

    def key(self, event: Any, path: KeyPath) -> tuple[str, Place]:
        """A key is the text as written, whatever it looks like: `404:` is the name "404"."""
        place = self.place(event.start_mark)
        if not isinstance(event, yaml.ScalarEvent):
            what = "an alias" if isinstance(event, yaml.AliasEvent) else "a list or mapping"
            self.mistakes.fail(place, f"a key is plain text, not {what}", path)
        key: str = event.value
        if len(key) > MAX_KEY or _UNPRINTABLE.search(key):
            self.mistakes.fail(
                place, f"a key is printable text of at most {MAX_KEY} characters", path
            )
        if key == "<<" and event.implicit[0]:
            self.mistakes.fail(
                place,
                "merge keys (<<) are not part of YAML 1.2; write the keys out, or use defaults:",
                path,
            )
        if event.anchor or event.tag:
            self.mistakes.fail(place, "a key takes no anchor and no tag", path)
        return key, place


_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **{
        sign + word: float(sign + "inf")
        for sign in ("", "+", "-")
        for word in (".inf", ".Inf", ".INF")
    },
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
# 300 digits fit into a double. Longer ones are read as floats, that is as infinite, and refused as
# such; int() would take a time that grows as the square of the digits.
_INTEGER = re.compile(r"[-+]?[0-9]{1,300}|0o[0-7]{1,300}|0x[0-9a-fA-F]{1,200}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


def resolve_scalar(text: str) -> Any:
    """The value of a plain scalar by the core schema of YAML 1.2: None, bool, int, float or str."""
    if text in _WORDS:
        return _WORDS[text]
    # Most scalars are words, and this spares them the two patterns.
    if text[0] not in "+-.0123456789":
        return text
    if _INTEGER.fullmatch(text):
        return int(text[2:], {"o": 8, "x": 16}[text[1]]) if text[1:2] in ("o", "x") else int(text)
    if not _FLOAT.fullmatch(text):
        return text
    # Too small for a double is as wrong as too large: it stays text, which no number is.
    number = float(text)
    return text if number == 0 and text.lower().partition("e")[0].strip("+-.0") else number


def write(value: Any) -> str:
    """A plain value as YAML in one line (flow style); numbers keep every bit. Tuples are written as
    lists."""
    match value:
        case float():
            return repr(value)
        case str():
            return _written_text(value)
        case list() | tuple():
            return f"[{', '.join(map(write, value))}]"
        case dict():
            items = (f"{_written_text(str(key))}: {write(item)}" for key, item in value.items())
            return f"{{{', '.join(items)}}}"
        case None | bool() | int():
            return json.dumps(value)
    raise TypeError(f"no plain value: {shown(value)}")


@lru_cache  # thousands of cases have the same words
def _written_text(text: str) -> str:
    if _PLAIN.fullmatch(text) and isinstance(resolve_scalar(text), str):
        return text
    text = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return '"' + re.sub(_ESCAPED, lambda match: f"\\u{ord(match[0]):04x}", text) + '"'


# Only words that no reader, of YAML 1.1 or 1.2, could take for a number, a date or a comment.
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_.+-]*")
# Beside what is unprintable: line breaks of YAML 1.1 (85, 2028, 2029) and byte order marks.
# Compiled at its first use, since that takes milliseconds and most texts are words.
_ESCAPED = "[^\x20-\x7e\xa1-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
