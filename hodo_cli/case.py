"""Case files: from YAML to frozen cases, checked, and back.

The keys of a case are `model`, `form`, those of its model's form, and COMMON. A value is taken from the first of: an
override (`--set`), the case, the file's `defaults:`, the key's own default. A mistake is reported with its file, line,
column, key and nearest spelling; all mistakes of a file are raised together, as one HodoError with a line for each.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path as FilePath
from typing import Any

from . import HodoError, models, statements
from .axes import Ranges, check_axes, storable
from .figures import KINDS
from .models.base import Model
from .schema import kinds
from .schema.document import MAX_BYTES, Block, Items, locate, read
from .schema.kinds import (
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
    Table,
    Text,
    Variant,
)
from .schema.mistakes import Mistakes, Place
from .schema.write import write

METHODS = ("auto", "taylor", "collocation", "DOP853", "RK45", "LSODA", "Radau", "BDF", "exact")

TIME = Table(
    {
        "start": Key(Number(), "time of the initial data", "time", 0.0),
        "end": Key(Number(), "time at which the integration ends, not before start", "time"),
        "samples": Key(
            Integer(least=1, most=10**15),
            "number of stored times, evenly spaced from start to end; a single one is the end",
            default=1001,
        ),
    }
)

COMMON = {
    "time": Key(TIME, "span of the integration, and its samples"),
    "method": Key(Choice(*METHODS), "method of integration; auto takes the fastest that is safe", default="auto"),
    "tol": Key(
        Number(above=0, below=1),
        "tolerance relative to max|omega| "
        "(if left out: 1e-9 for RK45, LSODA, Radau, BDF, 1e-12 for DOP853, else the precision's limit)",
        default=None,
    ),
    "precision": Key(Choice("double", "extended", "quadruple"), "working precision", default="double"),
    "error": Key(Choice("on", "off"), "whether the error is measured, against a finer integration", default="on"),
    "store": Key(Names(), "variables kept (if left out or empty: the state)", default=()),
    "max_seconds": Key(Number(above=0), "run time after which the case is given up", "s", None),
    "max_steps": Key(Integer(least=1, most=10**15), "number of steps after which the case is given up", default=None),
    "note": Key(Text(), "remark that goes with the results: an assumption, a misprint", default=""),
    "sweep": Key(Ranges(), "ranges of numeric keys, which make the case a grid or an ensemble", default=None),
}
"""The keys that a case of any model takes besides `model` and `form`."""


@dataclass(frozen=True)
class Section:
    """A mapping whose entries are checked one by one."""

    def check(self, value: Any, at: Path, report: Report) -> Any:
        return value if isinstance(value, Block) else Data().check(value, at, report)

    def schema(self) -> dict[str, Any]:
        return Data().schema()

    def describe(self) -> str:
        return Data().describe()


BENCH = Table(
    {
        "methods": Key(kinds.Sequence(Choice(*METHODS)), "methods compared"),
        "tols": Key(kinds.Sequence(Number(above=0, below=1)), "tolerances (default: each method's own)", default=()),
        "repeats": Key(Integer(least=1, most=1000), "runs of which the median is timed", default=1),
        "max_seconds": Key(Number(above=0), "run time after which a method is given up", "s", 10.0),
    }
)

SECTIONS = {
    "title": Key(Text(), "title of the config", default=""),
    "references": Key(Text(), "where its cases come from", default=""),
    "defaults": Key(Section(), "values for every case that takes the key; those of `time` one by one", default=None),
    "cases": Key(Section(), "the experiments, by name"),
    "figures": Key(Section(), "what `hodo plot` draws, by name", default=None),
    "bench": Key(BENCH, "what `hodo bench` tries on every case", default=None),
    "claims": Key(kinds.Sequence(Table(statements.CLAIM)), "statements that `hodo claims` checks", default=()),
}

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_NAME_RULE = "a name is up to 100 of the characters A-Z a-z 0-9 . _ - and begins with a letter or digit"


@dataclass(frozen=True, kw_only=True)
class Time:
    """Span and number of samples of a case; a single sample is that at the end."""

    start: float = 0.0
    end: float
    samples: int = 1001


@dataclass(frozen=True)
class Case:
    """One experiment, complete: `data` holds the keys of its model's form, every default filled in."""

    name: str
    model: str
    form: str
    data: dict[str, Any]
    time: Time
    method: str = "auto"
    tol: float | None = None
    precision: str = "double"
    error: str = "on"
    store: tuple[str, ...] = ()
    max_seconds: float | None = None
    max_steps: int | None = None
    note: str = ""
    sweep: dict[str, Any] | None = None


@dataclass(frozen=True)
class Config:
    """A case file, read: its text as it was, its cases and figures by name, in the file's order."""

    path: str
    text: str
    title: str
    references: str
    cases: dict[str, Case]
    figures: dict[str, dict[str, Any]]
    claims: tuple[dict[str, Any], ...]
    bench: dict[str, Any] | None = None


def load(path: str | FilePath, overrides: Sequence[str] = ()) -> Config:
    """The config in a file, with overrides such as "fig4.damping.2=0.001" applied to its cases.

    An override is CASE.KEY.PATH=VALUE: a case's name or a glob, a key, further keys or zero-based positions within
    its value, and a value in YAML. It may add a key. Raises HodoError, one line for each mistake.
    """
    name = str(path)
    try:
        with open(path, "rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise HodoError(f"{name!r}: {getattr(error, 'strerror', None) or error}") from None
    mistakes = Mistakes(name)
    if len(raw) > MAX_BYTES:
        raise mistakes.fatal(Place(1, 1), f"larger than {MAX_BYTES // 10**6} MB; split the file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = raw.count(b"\n", 0, error.start) + 1, error.start - raw.rfind(b"\n", 0, error.start)
        raise mistakes.fatal(Place(line, column), f"not UTF-8 text (byte {raw[error.start]:#04x})") from None
    return parse(text, name, overrides)


def parse(text: str, name: str, overrides: Sequence[str] = ()) -> Config:
    """The config in a text; `name` stands for the file in messages. Raises HodoError as `load` does."""
    mistakes = Mistakes(name)
    document = _mapping(text, mistakes)
    report = _reporter(document, (), Place(1, 1), mistakes)
    given = {section: value for section, value in document.items() if value is not None}
    sections = kinds.resolve(SECTIONS, given, (), report)
    cases, defaults = sections.get("cases", Block()), sections.get("defaults") or Block()
    if "cases" in sections and not cases:
        report(("cases",), "there is no case")
    blocks = {case: _merge(defaults, block) for case, block in cases.items() if _is_entry("cases", case, block, report)}
    for override in overrides:
        _override(override, blocks, mistakes)
    checked = [
        _case(case, block, _reporter(block, ("cases", case), cases.value_places[case], mistakes))
        for case, block in blocks.items()
    ]
    _check_defaults(defaults, blocks.values(), report)
    figures = _figures(sections.get("figures") or {}, cases, report)
    values = {case.name: case.data | {"time": asdict(case.time)} for case in checked if case}
    statements.cross_check(given.get("claims"), dict.fromkeys(cases) | values, report)
    mistakes.raise_any()
    return Config(
        path=name,
        text=text,
        title=sections["title"],
        references=sections["references"],
        cases={case.name: case for case in checked if case},
        figures=figures,
        claims=sections["claims"],
        bench=sections["bench"],
    )


def dump(case: Case) -> str:
    """The case as YAML, complete, one key a line; `parse_case` returns an equal case."""
    entries = {"name": case.name, "model": case.model, "form": case.form} | _without_none(case.data)
    common = {key: getattr(case, key) for key in COMMON} | {"time": asdict(case.time)}
    entries |= {key: value for key, value in common.items() if value is not None}
    return "".join(f"{key}: {write(value)}\n" for key, value in entries.items())


def parse_case(text: str) -> Case:
    """The case in a text written by `dump`. Raises HodoError, one line for each mistake."""
    mistakes = Mistakes("case")
    block = _mapping(text, mistakes)
    name = block.pop("name", None)
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise mistakes.fatal(Place(1, 1), f"{_NAME_RULE}, not {kinds.shown(name)}")
    case = _case(name, block, _reporter(block, (), Place(1, 1), mistakes))
    mistakes.raise_any()
    assert case is not None
    return case


def _mapping(text: str, mistakes: Mistakes) -> Block:
    document = read(text, mistakes)
    if isinstance(document, Block):
        return document
    raise mistakes.fatal(Place(1, 1), f"wants a mapping of keys to values, not {kinds.shown(document)}")


def _without_none(data: Any) -> Any:
    """Model data without the optional keys that are not given."""
    if not isinstance(data, dict):
        return data
    return {key: _without_none(value) for key, value in data.items() if value is not None}


def _reporter(root: Block, label: Path, place: Place, mistakes: Mistakes) -> Report:
    """A report for paths within `root`, which stands at `place` and is called `label`."""

    def report(at: Path, message: str) -> None:
        found, inherited = locate(root, at, place)
        mistakes.add(found, ("defaults", *at) if inherited else (*label, *at), message)

    return report


def _is_entry(section: str, name: str, value: Any, report: Report) -> bool:
    """Whether an entry of a section has a proper name and is a mapping; reports it otherwise."""
    if not _NAME.fullmatch(name):
        report((section, Misnamed(name)), _NAME_RULE)
    elif not isinstance(value, Block):
        report((section, name), f"wants a mapping, not {kinds.shown(value)}")
    else:
        return True
    return False


def _merge(defaults: Block, given: Block) -> Block:
    """A case's own entries over all defaults, which are marked as inherited."""
    merged = given.copy()
    for key, value in defaults.items():
        if key not in given:
            merged.put(key, value, defaults.key_places[key], defaults.value_places[key], inherited=True)
    own, common = given.get("time"), defaults.get("time")
    if isinstance(own, Block) and isinstance(common, Block):
        merged["time"] = _merge(common, own)
    return merged


@cache
def _keys_of(model: str | None, form: str | None) -> tuple[type[Model] | None, dict[str, Key]]:
    """The class of a model's form (None: the first) and every key of its cases; no class if there is none such."""
    catalogue = models.catalogue()
    forms = catalogue.get(model or "", {})
    head = {"model": Key(Choice(*catalogue), "equations of motion")}
    if forms:
        head["form"] = Key(Choice(*forms), "form of the equations", default=next(iter(forms)))
    found = forms.get(head["form"].default if form is None else form) if forms else None
    return found, head | (found.keys if found else {}) | COMMON


def _keys_in(block: Block) -> tuple[type[Model] | None, dict[str, Key]]:
    """`_keys_of` for the model and form that a case names, rightly or not."""
    model, form = block.get("model"), block.get("form")
    return _keys_of(model if isinstance(model, str) else None, form if form is None or isinstance(form, str) else "")


@cache
def _all_keys() -> frozenset[str]:
    """Every key that a case of some model takes."""
    classes = [form for forms in models.catalogue().values() for form in forms.values()]
    return frozenset({"model", "form", *COMMON}.union(*(form.keys for form in classes)))


def _case(name: str, block: Block, report: Report) -> Case | None:
    """The case that a merged block describes, or None after reporting what is wrong with it."""
    wrong = False

    def note(at: Path, message: str) -> None:
        nonlocal wrong
        wrong = True
        report(at, message)

    found, taken = _keys_in(block)
    values = kinds.resolve(taken, _own(block, found, taken, note), (), note)
    data = {key: values[key] for key in found.keys if key in values} if found else {}
    if found:
        _cross_check(found, data, note)
        sweep = values.get("sweep")
        if sweep and not wrong:
            check_axes(sweep, found.keys, data, not found.unclassifiable, note)
        known = storable(found.variables, not found.unclassifiable) if sweep else list(found.variables)
        for i, kept in enumerate(values.get("store", ())):
            if kept not in known:
                note(("store", i), kinds.unknown(f"variable {kept!r}", kept, known))
    if "time" in values and not 0 <= values["time"]["end"] - values["time"]["start"] < float("inf"):
        note(("time", "end"), f"the span from {values['time']['start']:g} to {values['time']['end']:g} is not possible")
    if wrong or not found:
        return None
    common = {key: values[key] for key in COMMON} | {"time": Time(**values["time"])}
    return Case(name=name, model=found.name, form=found.form, data=data, **common)


def _cross_check(found: type[Model], data: Mapping[str, Any], report: Report) -> None:
    """A model's own check, which ends where it needs a value that has a mistake of its own."""
    try:
        found.check(data, report)
    except KeyError:
        if data.keys() >= found.keys.keys():
            raise


def _own(block: Block, found: type[Model] | None, taken: Mapping[str, Key], report: Report) -> dict[str, Any]:
    """The entries of a case that are to be resolved.

    Left out are defaults that its model does not take; keys of another form of the model, which are reported; and,
    where the model is not known, the keys of every model.
    """
    own = {}
    for key, value in block.items():
        forms = models.catalogue()[found.name].items() if found and key not in taken else ()
        others = [form for form, other in forms if key in other.keys]
        if key in taken:
            own[key] = value
        elif key in block.inherited or (found is None and key in _all_keys()):
            continue
        elif found and others:
            report((Misnamed(key),), f"is a key of form {' or '.join(others)}, and this is form {found.form}")
        else:
            own[key] = value
    return own


def _check_defaults(defaults: Block, blocks: Iterable[Block], report: Report) -> None:
    """Report the defaults that no case takes."""
    found = [_keys_in(block) for block in blocks]
    taken = set(_all_keys()) if any(form is None for form, _ in found) else {key for _, some in found for key in some}
    for key in defaults:
        if key not in taken:
            message = "no case here takes this key" if key in _all_keys() else kinds.unknown("key", key, sorted(taken))
            report(("defaults", Misnamed(key)), message)


def _figures(given: Mapping[str, Any], cases: Mapping[str, Any], report: Report) -> dict[str, dict[str, Any]]:
    """The figures, each checked by the keys of its kind; the cases and figures that they name must exist."""
    figures = {}
    for name, block in given.items():
        if not _is_entry("figures", name, block, report):
            continue
        kind = block.get("kind")
        known = isinstance(kind, str) and kind in KINDS
        entries = block if known else {key: kind for key in block if key == "kind"}
        taken = {"kind": Key(Choice(*KINDS), "what is drawn")} | (KINDS[kind] if known else {})
        figures[name] = kinds.resolve(taken, entries, ("figures", name), report)
        for key, valid in (("cases", cases), ("scale_with", given)):
            for i, item in enumerate(figures[name].get(key, ())):
                if item not in valid:
                    report(("figures", name, key, i), kinds.unknown(f"name {item!r}", item, valid))
    return figures


def _override(text: str, blocks: dict[str, Block], mistakes: Mistakes) -> None:
    """Apply one override to the blocks of the cases that it names."""
    place = Place(1, 1, text)
    target, equals, value = text.partition("=")
    parts = target.strip().split(".")
    if not equals or not 2 <= len(parts) <= 50:
        mistakes.add(place, (), "an override reads CASE.KEY=VALUE")
        return
    splits = ((".".join(parts[:n]), parts[n:]) for n in range(len(parts) - 1, 0, -1))
    named = ((names, path) for case, path in splits if (names := _matching(case, blocks)))
    names, path = next(named, ([], []))
    if not names:
        mistakes.add(place, (), kinds.unknown(f"case {parts[0]!r}", parts[0], blocks))
    try:
        new = read(value, mistakes, text)
    except HodoError:
        return
    for name in names:
        try:
            blocks[name] = _replaced(blocks[name], Table(_keys_in(blocks[name])[1]), path, new, place)
        except ValueError as error:
            mistakes.add(place, ("cases", name, *path), str(error.args[0]))


def _matching(pattern: str, blocks: Mapping[str, Block]) -> list[str]:
    return [pattern] if pattern in blocks else [name for name in blocks if fnmatchcase(name, pattern)]


def _replaced(node: Any, kind: Kind | None, path: Sequence[str], new: Any, place: Place) -> Any:
    """A copy of a value with `new` at a path within it. Raises ValueError, with a sentence, if there is no such path.

    A number that stands for a vector of equal ones is written out where the path names one of them.
    """
    if not path:
        return new
    head, *rest = path
    if isinstance(kind, kinds.Vector) and kind.scalar and isinstance(node, int | float):
        node = (node,) * kind.n
    if isinstance(node, tuple):
        node = Items(list(node), [place] * len(node))
    if isinstance(node, Items):
        if not head.isdecimal() or int(head) >= len(node):
            raise ValueError(f"there is no {head!r} in a list whose positions are 0 to {len(node) - 1}")
        items, i = node.copy(), int(head)
        items[i], items.places[i] = _replaced(node[i], None, rest, new, place), place
        return items
    if not isinstance(node, Block) and node not in (None, kinds.REQUIRED):
        raise ValueError(f"there is no {head!r} in {kinds.shown(node)}")
    block = node.copy() if isinstance(node, Block) else Block()
    key = kind.keys.get(head) if isinstance(kind, Table) else None
    old = block.get(head, key.default if key else None)
    value = _replaced(old, key.kind if key else None, rest, new, place)
    if rest and head in block:
        block.put(head, value, block.key_places[head], block.value_places[head])
    else:
        block.put(head, value, place, place)
    return block


def _rows(path: str, key: Key) -> Iterator[tuple[str, str, str, str, str]]:
    """The rows of the key table, but for `where`, of a key and the keys within it."""
    default = "required" if key.default is kinds.REQUIRED else "" if key.default is None else write(key.default)
    yield path, key.kind.describe(), key.unit, default, key.doc
    kinds = key.kind.kinds if isinstance(key.kind, Either) else (key.kind,)
    for kind in kinds:
        tables = [kind.keys] if isinstance(kind, Table) else kind.tables.values() if isinstance(kind, Variant) else []
        for table in tables:
            for name, inner in table.items():
                yield from _rows(f"{path}.{name}", inner)


def key_table() -> str:
    """Every key of a case file as a table in Markdown."""
    catalogue = models.catalogue()
    head = {"model": Key(Choice(*catalogue), "equations of motion")}
    scopes = [("file", "", SECTIONS), ("every case", "", head | COMMON)]
    for model, forms in catalogue.items():
        scopes.append((model, "", {"form": _keys_of(model, None)[1]["form"]}))
        scopes += [(model, form, dict(found.keys)) for form, found in forms.items()]
    kind = {"kind": Key(Choice(*KINDS), "what is drawn")}
    scopes += [("figure", name, kind | taken) for name, taken in KINDS.items()]
    scopes.append(("claim", "", statements.CLAIM))
    where: dict[tuple[str, ...], dict[str, dict[str, None]]] = {}
    for group, member, taken in scopes:
        for row in (row for name, key in taken.items() for row in _rows(name, key)):
            where.setdefault(row, {}).setdefault(group, {})[member] = None
    every = {model: list(forms) for model, forms in catalogue.items()} | {"figure": list(KINDS)}
    lines = ["| key | where | value | unit | default | meaning |", "|---|---|---|---|---|---|"]
    for (name, *rest), groups in where.items():
        named = [g if list(some) in ([""], every.get(g)) else f"{g} ({', '.join(some)})" for g, some in groups.items()]
        cells = (f"`{name}`", ", ".join(named), *rest)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _closed(form: dict[str, Any], classes: Iterable[type[Model]]) -> dict[str, Any]:
    """JSON Schema of a case of one of some forms of a model."""
    own: dict[str, list[dict[str, Any]]] = {}
    for name, key in (item for found in classes for item in found.keys.items()):
        if (rule := key.schema()) not in own.setdefault(name, []):
            own[name].append(rule)
    rules = {name: some[0] if len(some) == 1 else {"anyOf": some} for name, some in own.items()}
    return {"properties": dict.fromkeys(("model", *COMMON), True) | form | rules, "additionalProperties": False}


def schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of the case files.

    No key is required of a case, since `defaults:` may supply it; the keys of a model are closed only where the case
    itself names the model. Conditions that join several keys (the triangle inequality, say) are beyond a schema.
    """
    catalogue = models.catalogue()
    head = {"model": {"enum": list(catalogue), "description": "equations of motion"}}
    common = {name: key.schema() for name, key in COMMON.items()}
    common["time"].pop("required")
    rules = []
    for model, forms in catalogue.items():
        named = {"properties": {"model": {"const": model}}, "required": ["model"]}
        rules.append({"if": named, "then": _closed({"form": {"enum": list(forms)}}, forms.values())})
        for form, found in forms.items():
            this = {"properties": {"form": {"const": form}}, "required": ["form"]}
            rules.append({"if": {"allOf": [named, this]}, "then": _closed({"form": True}, [found])})
    figures = [Table({"kind": Key(Choice(kind), "what is drawn")} | taken).schema() for kind, taken in KINDS.items()]
    sections = {name: key.schema() for name, key in SECTIONS.items()}
    names = {"propertyNames": {"pattern": f"^{_NAME.pattern}$"}}
    sections["cases"] |= names | {"additionalProperties": {"$ref": "#/$defs/case"}, "minProperties": 1}
    sections["figures"] |= names | {"additionalProperties": {"oneOf": figures}}
    sections["defaults"] |= {"properties": head | common}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "hodo case file",
        "type": "object",
        "properties": sections,
        "required": ["cases"],
        "additionalProperties": False,
        "$defs": {"case": {"type": "object", "properties": head | common, "allOf": rules}},
    }
