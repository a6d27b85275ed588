"""YAML 1.2 text as plain values that know their place, and back: the only importer of PyYAML.

PyYAML's own constructor is not used: it follows YAML 1.1 (`1e-3` text, `no` a bool, `12:30:00` a
number, the last of two equal keys wins), recurses, and expands aliases without a bound. Here the
parser's events are read in one loop. Scalars follow the core schema of YAML 1.2, in which `010` is
the integer ten. Documents may come from strangers: their size, depth and number of values are
limited, and tags are refused: what a value is, follows from how it is written.

Source: YAML 1.2.2, section 10.3 (core schema).
"""

import re
from typing import Any, NoReturn

import yaml

from .kinds import KeyPath, Misnamed, shown
from .mistakes import Mistakes, Place

# Half a million values take 100 MB of memory and some seconds; the papers' files hold 1,300 at
# most, 8 levels deep.
MAX_BYTES = 16_000_000
# Reading is a loop, but checks recurse, a few frames a level: far below Python's limit of 1,000.
MAX_DEPTH = 50
MAX_VALUES = 500_000
# An alias costs the reader nothing, but every check walks what it stands for, and nine anchors of
# nine aliases each stand for 9^9 values.
MAX_ALIASED = 100_000
# Names of cases and figures become names of files, which end at 255 bytes on most systems.
MAX_KEY = 128

# The parser in C, where PyYAML was built with it; only its events are used, never its constructor.
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
# The characters that YAML 1.2.2, 5.1, calls printable.
_UNPRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


OPENED = {
    "while parsing a flow sequence": "the [",
    "while parsing a flow mapping": "the {",
    "while parsing a flow node": "the [ or {",
}
"""PyYAML's words for the brackets that an unfinished text leaves open."""


class Block(dict[str, Any]):
    """A mapping that knows the places of its keys and values, and which keys it inherited from
    `defaults`.

    The place of a value that is itself a mapping or list in block style is that of its key.
    """

    def __init__(self) -> None:
        self.key_places: dict[str, Place] = {}
        self.value_places: dict[str, Place] = {}
        self.inherited: set[str] = set()

    def put(
        self, key: str, value: Any, key_place: Place, value_place: Place, inherited: bool = False
    ) -> None:
        """Set one entry."""
        self[key] = value
        self.key_places[key] = key_place
        self.value_places[key] = value_place
        (self.inherited.add if inherited else self.inherited.discard)(key)

    def copy(self) -> "Block":
        """A shallow copy, places included."""
        new = Block()
        for key, value in self.items():
            new.put(key, value, self.key_places[key], self.value_places[key], key in self.inherited)
        return new


class Items(list[Any]):
    """A list that knows the places of its values."""

    def __init__(self, values: list[Any] | None = None, places: list[Place] | None = None) -> None:
        super().__init__(values or [])
        self.places = places or []

    def copy(self) -> "Items":
        """A shallow copy, places included."""
        return Items(list(self), list(self.places))


def locate(root: Any, at: KeyPath, place: Place) -> tuple[Place, bool]:
    """The place of what stands at a path, or of its nearest ancestor, and whether it is
    inherited."""
    node, inherited = root, False
    for part in at:
        if isinstance(node, Block) and isinstance(part, str) and part in node:
            inherited = inherited or part in node.inherited
            place = (node.key_places if isinstance(part, Misnamed) else node.value_places)[part]
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
    reader = _Reader(mistakes, override)
    # PyYAML refuses such a character too, but its error has no line and column.
    if bad := _UNPRINTABLE.search(text):
        line, column = (
            text.count("\n", 0, bad.start()) + 1,
            bad.start() - text.rfind("\n", 0, bad.start()),
        )
        reader.fail(
            Place(line, column, override), f"the character U+{ord(bad[0]):04X} is not allowed"
        )
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            reader.take(event)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = reader.place(mark) if mark else Place(1, 1, override)
        raise mistakes.fatal(place, f"not YAML: {_told(error, mark, text, override)}") from None
    except yaml.YAMLError as error:
        raise mistakes.fatal(Place(1, 1, override), f"not YAML: {error}") from None
    return reader.root


def _told(error: yaml.MarkedYAMLError, mark: yaml.Mark | None, text: str, override: str) -> str:
    """What PyYAML finds wrong; the usual mistakes in plainer words than its own."""
    # The end of a text may be a line beyond its last.
    lines = text.split("\n")[mark.line : mark.line + 1] if mark else []
    if mark and any("\t" in line[: mark.column + 1] for line in lines):
        return "a tab; indent with spaces"
    if error.problem == "mapping values are not allowed in this context":
        return "a second ': ' on one line: indent a new key, or put the text in quotes"
    if error.context in OPENED and error.context_mark:
        # An override is one line, and stands within a document of its own.
        where = "" if override else f" of line {error.context_mark.line + 1}"
        return f"{OPENED[error.context]}{where} is not closed, or lacks a comma"
    return ", ".join(part for part in (error.context, error.problem) if part)


class _Open:
    """A mapping or list that is being read."""

    def __init__(self, node: Block | Items, place: Place, anchor: str | None, count: int) -> None:
        self.node, self.place, self.anchor, self.count = node, place, anchor, count
        self.key: str | None = None
        self.key_place = place

    @property
    def wants_key(self) -> bool:
        """Whether it is a mapping in which a key comes next."""
        return self.key is None and isinstance(self.node, Block)


class _Reader:
    """Builds the values from the events of the parser."""

    def __init__(self, mistakes: Mistakes, override: str) -> None:
        self.mistakes, self.override = mistakes, override
        self.root: Any = None
        self.documents = 0
        self.open: list[_Open] = []
        self.anchors: dict[str, tuple[Any, int] | None] = {}
        self.count = self.aliased = 0

    def place(self, mark: Any) -> Place:
        return Place(mark.line + 1, mark.column + 1, self.override)

    def path(self) -> KeyPath:
        parts = ((o.key or "") if isinstance(o.node, Block) else len(o.node) for o in self.open)
        return tuple(part for part in parts if part != "")

    @property
    def top(self) -> _Open | None:
        """The innermost mapping or list that is being read."""
        return self.open[-1] if self.open else None

    def fail(self, place: Place, message: str) -> NoReturn:
        raise self.mistakes.fatal(place, message, self.path())

    def refuse_tag(self, event: Any, place: Place) -> None:
        if event.tag:
            self.fail(place, f"the tag {shown(event.tag)} is not allowed here")

    def take(self, event: Any) -> None:
        """Take the next event."""
        match event:
            case yaml.ScalarEvent():
                self.take_scalar(event)
            case yaml.SequenceStartEvent() | yaml.MappingStartEvent():
                self.start(event)
            case yaml.SequenceEndEvent() | yaml.MappingEndEvent():
                self.end()
            case yaml.AliasEvent():
                self.take_alias(event)
            case yaml.DocumentStartEvent():
                self.documents += 1
                if self.documents > 1:
                    self.fail(
                        self.place(event.start_mark),
                        "a second document starts here; one is allowed",
                    )

    def take_scalar(self, event: Any) -> None:
        place = self.place(event.start_mark)
        top = self.top
        if top and top.wants_key:
            self.take_key(top, event, place)
            return
        self.refuse_tag(event, place)
        if _UNPRINTABLE.search(event.value):
            self.mistakes.add(place, "control characters are not allowed in text", self.path())
        unquoted = event.implicit[0]
        value = resolve_scalar(event.value) if unquoted else event.value
        if event.anchor:
            self.anchors[event.anchor] = (value, 1)
        # An empty value has no place of its own: the parser's mark stands behind the next line
        # break.
        self.add(value, place if event.value or not top else top.key_place)

    def take_key(self, top: _Open, event: Any, place: Place) -> None:
        """A key is the text as written, whatever it looks like: `404:` is the name "404"."""
        key = event.value
        if len(key) > MAX_KEY or _UNPRINTABLE.search(key):
            self.fail(place, f"a key is printable text of at most {MAX_KEY} characters")
        if key == "<<" and event.implicit[0]:
            self.fail(
                place,
                "merge keys (<<) are not part of YAML 1.2; write the keys out, or use defaults:",
            )
        if event.anchor or event.tag:
            self.fail(place, "a key takes no anchor and no tag")
        first = top.node.key_places.get(key) if isinstance(top.node, Block) else None
        top.key, top.key_place = key, place
        if first:
            said = f"duplicate key; the first is in line {first.line}"
            self.mistakes.add(place, said, self.path())

    def start(self, event: Any) -> None:
        place = self.place(event.start_mark)
        top = self.top
        if top and top.wants_key:
            self.fail(place, "a key is plain text, not a list or mapping")
        if len(self.open) >= MAX_DEPTH:
            raise self.mistakes.fatal(place, f"nested deeper than {MAX_DEPTH} levels")
        node: Block | Items = Block() if isinstance(event, yaml.MappingStartEvent) else Items()
        self.refuse_tag(event, place)
        if event.anchor:
            # Not yet a value: an alias inside its own anchor would be a value that contains itself.
            self.anchors[event.anchor] = None
        # What is written in block style begins a line below its key, where no reader looks for the
        # mistake.
        if top and isinstance(top.node, Block) and not event.flow_style:
            place = top.key_place
        self.open.append(_Open(node, place, event.anchor, self.count))

    def end(self) -> None:
        done = self.open.pop()
        if done.anchor:
            self.anchors[done.anchor] = (done.node, self.count - done.count)
        self.add(done.node, done.place)

    def take_alias(self, event: Any) -> None:
        place = self.place(event.start_mark)
        if self.top and self.top.wants_key:
            self.fail(place, "a key is plain text, not an alias")
        anchored = self.anchors.get(event.anchor)
        if anchored is None:
            known = event.anchor in self.anchors
            self.fail(
                place,
                f"*{event.anchor} "
                + ("stands inside itself" if known else "has no anchor before it"),
            )
        value, size = anchored
        self.aliased += size
        if self.aliased > MAX_ALIASED:
            self.fail(place, f"aliases stand for more than {MAX_ALIASED} values")
        self.count += size
        self.add(value, place)

    def add(self, value: Any, place: Place) -> None:
        """Put a finished value where it belongs."""
        self.count += 1
        if self.count > MAX_VALUES:
            self.fail(place, f"more than {MAX_VALUES} values")
        if not (top := self.top):
            self.root = value
        elif isinstance(top.node, Items):
            top.node.append(value)
            top.node.places.append(place)
        elif top.key is not None:
            # The first of two equal keys counts; the second has been reported.
            if top.key not in top.node:
                top.node.put(top.key, value, top.key_place, place)
            top.key = None


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
