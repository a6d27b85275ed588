"""Case files as a whole: from YAML text, and values that `--set` puts into it, to a checked
Config."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

from .. import HodoError
from ..schema.document import MAX_BYTES, YAML_SUFFIXES, Block, Items, Mistakes, Place, read, write
from ..schema.kinds import (
    REQUIRED,
    Either,
    Key,
    KeyPath,
    Kind,
    ListOf,
    Mistake,
    Table,
    Wrong,
    WrongKey,
    check_keys,
    is_list,
    unknown_names,
    within,
)
from ..schema.spelling import nearest, shown, unknown
from ..text import file_name_fault
from . import claim_block
from .case import (
    NAME,
    NAME_RULE,
    Case,
    add_mistakes,
    checked_case,
    merged,
    read_mapping,
    variation,
)
from .derived import DERIVED
from .figure_block import FIGURE, Drawable, check_drawn, check_figure, merged_style
from .keys import SECTIONS, all_keys, drop_replaced_times, keys_in
from .sweep_block import axes_of, storable


@dataclass(frozen=True)
class Config:
    """A case file, read: its text as it was, its cases and figures by name, in the file's order;
    and the overrides that changed its cases."""

    path: str
    text: str
    cases: dict[str, Case]
    figures: dict[str, dict[str, Any]]
    title: str
    references: str
    claims: tuple[dict[str, Any], ...]
    errata: tuple[dict[str, Any], ...] = ()
    bench: dict[str, Any] | None = None
    overrides: tuple[str, ...] = ()

    def figure(self, name: str) -> dict[str, Any]:
        """One entry of the `figures:` block. Raises HodoError if there is none of this name."""
        if name not in self.figures:
            raise HodoError(f"{self.path}: {unknown(f'figure {name!r}', name, self.figures)}")
        return self.figures[name]

    def matching(self, globs: Sequence[str]) -> list[str]:
        """The names of the cases that match one of some globs; all if none is given."""
        return [
            name for name in self.cases if any(fnmatchcase(name, glob) for glob in globs or ("*",))
        ]


HERE = Path(__file__).parent

BUNDLED_CONFIGS = (
    HERE.parent if (HERE.parent / "configs").exists() else HERE.parents[1]
) / "configs"
"""The folder of the case files that come with hodo: within an installed package, beside it in a
clone. There need be none: a copy of the package alone runs too."""


def is_bare(name: str | Path) -> bool:
    """Whether a name has neither folder nor suffix, and no file has it: it may be NAME of
    NAME.yaml."""
    path = Path(name)
    return path.name == str(name) and not path.suffix and not path.exists()


def _path_and_label(path: str) -> tuple[Path, str]:
    """The file that a name stands for, and its name in messages. A bare name stands for NAME.yaml
    in the working folder, or else for a case file that comes with hodo."""
    if is_bare(path) and Path(f"{path}.yaml").exists():
        return Path(f"{path}.yaml"), f"{path}.yaml"
    if is_bare(path) and (bundled := BUNDLED_CONFIGS / f"{path}.yaml").exists():
        return bundled, path
    return Path(path), path


def write_new(path: Path) -> Path:
    """Write a case file to begin with, with remarks; its name ends with .yaml.

    Raises HodoError if there is one already, or it cannot be written.
    """
    if not path.name:
        raise HodoError(f"{path} is no name of a case file")
    path = path if path.suffix in YAML_SUFFIXES else path.with_name(f"{path.name}.yaml")
    if fault := file_name_fault(path.stem, ()):
        raise HodoError(f"{path}: {fault}")  # as `hodo run` would of its result
    text = (HERE / "new.yaml").read_text(encoding="utf-8")
    try:
        # "x" refuses a file that is there, in one step with making it.
        with open(path, "x", encoding="utf-8") as file:
            file.write(text.replace("{name}", str(path)).replace("{stem}", path.stem))
    except FileExistsError:
        raise HodoError(f"{path} is there already: take another name") from None
    except OSError as error:
        raise HodoError(f"cannot write {path}: {str(error.strerror).lower()}") from None
    return path


def load(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """The config in a file, with overrides such as "fig4.damping.2=0.001" applied to its cases.

    `path` may be the bare name of NAME.yaml here, or of a case file that comes with hodo: paper1.

    An override is CASE.KEY.PATH=VALUE: a case's name or a glob, a key, further keys or zero-based
    positions within its value, and a value in YAML. It may add a key. Raises HodoError, one line
    for each mistake.
    """
    file_path, name = _path_and_label(str(path))
    return parse(text_of(file_path, name), name, overrides)


def text_of(path: Path, name: str) -> str:
    """The text of a case file, which messages call `name`. Raises HodoError if it has none."""
    try:
        with open(path, "rb") as file:
            # One byte more than allowed tells a file that is too large without reading it.
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        # In lower case, as where a result is missing.
        reason = str(getattr(error, "strerror", None) or error).lower()
        shown_name = name if name.isprintable() else repr(name)
        beside = [str(x) for x in path.parent.glob("*") if x.suffix in YAML_SUFFIXES]
        others = [*beside, *(x.stem for x in BUNDLED_CONFIGS.glob("*.yaml"))]
        near = nearest(name, [other for other in others if other != name])
        raise HodoError(f"{shown_name}: {reason}{near}") from None
    if raw.startswith(b"\x89HDF"):
        raise HodoError(f"{name}: a result, where a case file (*.yaml) is expected")
    if len(raw) > MAX_BYTES:
        Mistakes(name).fail(Place(1, 1), f"larger than {MAX_BYTES // 10**6} MB; split the file")
    # Editors on Windows put a byte order mark before the text. `read` refuses what is no UTF-8.
    return raw.decode("utf-8-sig", errors="surrogateescape")


def no_case(globs: Sequence[str], names: Iterable[str]) -> HodoError:
    """The error for `--case` options that match no name of a case."""
    valid = list(dict.fromkeys(names))
    near = nearest(globs[-1], valid)
    return HodoError(f"no case matches {' or '.join(globs)}{near} (valid: {', '.join(valid)})")


def parse(text: str, name: str, overrides: Sequence[str] = (), stored: bool = False) -> Config:
    """The config in a text; `name` stands for the file in messages. Raises HodoError as `load`
    does.

    The statements of a text that is stored in a result were checked against its cases by `run`: a
    check of theirs that another version calls by another name keeps nobody from reading the rest.
    """
    mistakes = Mistakes(name)
    document = read_mapping(text, mistakes)
    # `figures:` with nothing below it is a section that is left out; a name that is no section is a
    # mistake all the same.
    present = {
        section: value
        for section, value in document.items()
        if value is not None or section not in SECTIONS
    }
    sections, faults = check_keys(SECTIONS, present)
    if "cases" not in present:
        # Every name of a case would be a mistake besides, and hide this one.
        add_mistakes(faults, document, mistakes)
        raise mistakes.error()
    named = sections.get("cases", Block())
    blocks, case_faults = _case_blocks(
        named, sections.get("defaults") or Block(), overrides, mistakes
    )
    # A mistake may stand in what a case inherits or an override changes.
    named.update(blocks)
    cases = _cases(blocks, document, mistakes)
    figures, figure_faults = _figures(sections.get("figures") or {}, named, sections.get("style"))
    figure_faults += _figure_mistakes(figures, cases, with_sizes=not overrides)
    faults += [*case_faults, *figure_faults]
    if "cases" in sections and not named:
        faults.append((("cases",), "there is no case"))
    if not stored:
        case_named = partial(_case_named, cases, named)
        faults += claim_block.cross_check(present.get("claims"), present.get("errata"), case_named)
    add_mistakes(faults, document, mistakes)
    mistakes.raise_any()
    kept = {key: sections[key] for key in ("title", "references", "claims", "errata", "bench")}
    return Config(name, text, cases, figures, **kept, overrides=(*overrides,))


def located(config: Config, path: KeyPath, message: str) -> HodoError:
    """The error for a mistake in a config that only a result shows, with file, line and column."""
    mistakes = Mistakes(config.path)
    add_mistakes([(path, message)], read_mapping(config.text, mistakes), mistakes)
    return mistakes.error()


def _case_named(cases: Mapping[str, Case], names: Iterable[str], entry: Any) -> Case | None:
    """The case that a statement names, as it is or with other values; None if the case has
    mistakes. Raises Wrong for an entry that describes no case."""
    changes = dict(entry) if isinstance(entry, Mapping) else {}
    name = changes.pop("case", None) if changes else entry
    if not isinstance(name, str):
        raise Wrong(((), "missing 'case', the name of the case that has other values here"))
    if name not in names:
        raise Wrong((("case",) if changes else (), unknown(f"case {name!r}", name, names)))
    case = cases.get(name)
    return variation(case, changes) if case and changes else case


def composed_text(cases: Mapping[str, Case], **sections: Any) -> str:
    """The text of a case file with these cases, complete, and other sections as plain values; one
    line an entry."""
    sections["cases"] = {name: case.entries for name, case in cases.items()}
    lines = []
    for section, value in sections.items():
        match value:
            case Mapping() if value:
                entries = [f"  {name}: {write(entry)}" for name, entry in value.items()]
                lines += [f"{section}:", *entries]
            case list() if value:
                lines += [f"{section}:", *(f"  - {write(entry)}" for entry in value)]
            case str() if value:
                lines.append(f"{section}: {write(value)}")
    return "\n".join([*lines, ""])


def _entries(section: str, named: Mapping[str, Any]) -> tuple[dict[str, Block], list[Mistake]]:
    """The entries of a section that have a proper name and are mappings, and the mistakes in the
    others."""
    entries: dict[str, Block] = {}
    mistakes: list[Mistake] = []
    for name, value in named.items():
        if not NAME.fullmatch(name):
            mistakes.append(((section, WrongKey(name)), NAME_RULE))
        elif not isinstance(value, Block):
            mistakes.append(((section, name), f"expected a mapping, got {shown(value)}"))
        else:
            entries[name] = value
    return entries, mistakes


def _case_blocks(
    named: Block, defaults: Block, overrides: Sequence[str], mistakes: Mistakes
) -> tuple[dict[str, Block], list[Mistake]]:
    """The keys of each case over the defaults, as overrides change them, and what is wrong with
    names of cases and with defaults; what is wrong with overrides is added to `mistakes`."""
    entries, faults = _entries("cases", named)
    blocks = {case: merged(defaults, block) for case, block in entries.items()}
    for override in overrides:
        _apply_override(override, blocks, mistakes)
    return blocks, [*faults, *_default_mistakes(defaults, blocks.values())]


def _cases(blocks: Mapping[str, Block], document: Block, mistakes: Mistakes) -> dict[str, Case]:
    """The cases without a mistake; the mistakes in the others are added."""
    cases = {}
    for name, block in blocks.items():
        try:
            cases[name] = checked_case(name, block)
        except Wrong as error:
            add_mistakes(within(("cases", name), error.mistakes), document, mistakes)
    return cases


def _default_mistakes(defaults: Block, blocks: Iterable[Block]) -> Iterator[Mistake]:
    """A mistake for each of the defaults that no case takes."""
    models_of_blocks = [(block, *keys_in(block)) for block in blocks]
    if any(model is None and "model" in block for block, model, _ in models_of_blocks):
        return  # it may have keys of its own
    # A case without a model may take any key that there is.
    accepted = {
        key for _, model, keys in models_of_blocks for key in (keys if model else all_keys())
    }
    for key in defaults.keys() - accepted:
        is_key = key in all_keys()
        message = "no case here takes this key" if is_key else unknown("key", key, sorted(accepted))
        yield ("defaults", WrongKey(key)), message


def _figure_mistakes(
    figures: Mapping[str, Mapping[str, Any]], cases: Mapping[str, Case], with_sizes: bool
) -> Iterator[Mistake]:
    """The mistakes that keep figures from drawing their cases; none where a case is itself
    wrong."""
    drawn = {name for values in figures.values() for name in values.get("cases", ())}
    known = {name: drawable(cases[name]) for name in cases.keys() & drawn}
    for name, values in figures.items():
        if all(case in cases for case in values.get("cases", ())):
            yield from within(("figures", name), check_drawn(values, known, with_sizes))


def drawable(case: Case) -> Drawable:
    """The properties of a case on which figures rest."""
    axes = axes_of(case.sweep or {})
    sphere = next((axis.name for axis in axes if axis.sphere is not None), "")
    own = {name: "".join(label.dims[1:]) for name, label in case.system.variables.items()}
    return Drawable(
        case.name,
        case,
        variables=_columns_drawn(case, own) if case.sweep else _variables_drawn(case, own),
        times=(case.time.start, case.time.end),
        units={"time": case.time.unit, "moments of inertia": case.inertia_unit},
        axes={axis.name: len(axis) for axis in axes},
        sphere=sphere,
    )


def _variables_drawn(case: Case, own: Mapping[str, str]) -> dict[str, str]:
    """The variables that a figure of a motion may draw, each with the dimension of its parts, which
    is known of the model's `own`."""
    dims = {**{name: quantity.dim for name, quantity in DERIVED.items()}, **own}
    # Labels are stored by `classify`, whatever the model.
    variables = {x: dims.get(x, "") for x in (*(case.store or own), "enclosed_axis", "time")}
    # As a vector, too, of which `G` alone is the length.
    return variables | ({"G": "axis"} if "omega" in variables else {})


def _columns_drawn(case: Case, own: Mapping[str, str]) -> dict[str, str]:
    """As `_variables_drawn`, for the columns of a sweep."""
    # Of the variables of a trajectory a member has no single value.
    without = {"trajectory", *(own if "trajectory" in case.store else ())}
    names = [x for x in case.store if x != "trajectory"] or storable(type(case.system))
    dims = {**own, "share": "axis"}
    return {name: dims.get(name, "") for name in names if name not in without}


def _figures(
    section: Mapping[str, Any], cases: Mapping[str, Any], style: Mapping[str, Any] | None
) -> tuple[dict[str, dict[str, Any]], list[Mistake]]:
    """The figures, each checked by the keys of its kind and with the style of the file where it has
    none; the cases and figures that they name must exist."""
    entries, mistakes = _entries("figures", section)
    figures = {}
    for name, block in entries.items():
        values, wrong = FIGURE.check_keys(block)
        if fault := file_name_fault(name, entries):
            mistakes.append((("figures", WrongKey(name)), fault))
        if values.get("cases") == ():
            wrong.append((("cases",), "names no case"))
        for key, valid in (("cases", cases), ("scale_with", section)):
            named: dict[KeyPath, str] = {(key, i): x for i, x in enumerate(values.get(key, ()))}
            wrong += unknown_names("name", named, valid)
        mistakes += within(("figures", name), [*wrong, *check_figure(values)])
        figures[name] = {**values, "style": merged_style(style, values.get("style"))}
    return figures, mistakes


def _apply_override(text: str, blocks: dict[str, Block], mistakes: Mistakes) -> None:
    """Apply one override to the blocks of the cases that it names."""
    place = Place(1, 1, text)
    target, equals, value = text.partition("=")
    parts = target.strip().split(".")
    if not equals or not 2 <= len(parts) <= 50:
        mistakes.add(place, "an override reads CASE.KEY=VALUE")
        return
    *begin, last = parts
    case, within_case = _longest_name(begin, lambda name: bool(_blocks_named(name, blocks)))
    names, path = _blocks_named(case, blocks), [*within_case, last]
    if not names:
        mistakes.add(place, unknown(f"case {parts[0]!r}", parts[0], blocks))
    with suppress(HodoError):  # what is wrong with the text of a value is noted
        new = read(value, mistakes, text)
        for name in names:
            kind = Table(keys_in(blocks[name])[1])
            try:
                blocks[name] = _with_value(blocks[name], kind, path, new, place)
                if path[0] == "time" and isinstance(time := blocks[name]["time"], Block):
                    drop_replaced_times(time, dict.fromkeys(path[1:2], new))
            except ValueError as error:
                mistakes.add(place, str(error), ("cases", name, *path))


def _longest_name(parts: Sequence[str], exists: Callable[[str], bool]) -> tuple[str, Sequence[str]]:
    """The name that parts of a path begin with, and the parts behind it: names of cases and keys of
    sweeps contain points, so the longest that exists is meant, or the first part."""
    lengths = range(len(parts), 0, -1)
    n = next((n for n in lengths if exists(".".join(parts[:n]))), 1)
    return ".".join(parts[:n]), parts[n:]


def _blocks_named(pattern: str, blocks: Mapping[str, Block]) -> list[str]:
    """The cases of a name or, if there is none, those that match it."""
    matching = [name for name in blocks if fnmatchcase(name, pattern)]
    return [pattern] if pattern in blocks else matching


ANYTHING = Key(Kind(), "", default=None)
"""A key of which nothing is known but where it stands."""


def _with_value(node: Any, kind: Kind, path: Sequence[str], new: Any, place: Place) -> Any:
    """A copy of a value of some kind with `new` at a path within it. Raises ValueError, with a
    sentence, if there is no such path."""
    if not path:
        return new
    node = _written_out(node, kind, path[0])
    if is_list(node):
        if not path[0].isdecimal() or int(path[0]) >= len(node):
            positions = f"a list whose positions are 0 to {len(node) - 1}"
            where = positions if node else "an empty list"
            raise ValueError(f"there is no {path[0]!r} in {where}")
        items, i = Items(node, getattr(node, "places", [place] * len(node))), int(path[0])
        items[i], items.places[i] = _with_value(node[i], ANYTHING.kind, path[1:], new, place), place
        return items
    if node not in (None, REQUIRED) and not isinstance(node, Mapping):
        raise ValueError(f"there is no {path[0]!r} in {shown(node)}")
    block = Block(node if isinstance(node, Mapping) else {})
    head, tail = _longest_name(path, block.__contains__)
    key = kind.keys.get(head, ANYTHING) if isinstance(kind, Table) else ANYTHING
    value = _with_value(block.get(head, key.default), key.kind, tail, new, place)
    block.put(head, value, *(block.places.get(head, (place, place)) if tail else (place, place)))
    return block


def _written_out(node: Any, kind: Kind, head: str) -> Any:
    """A value, as a list if it stands for one of equal ones and `head` is a position there:
    `damping: 0.004` has no component 2 until it is written out."""
    kinds = kind.kinds if isinstance(kind, Either) else (kind,)
    lists = [option for option in kinds if isinstance(option, ListOf) and option.takes(node)]
    is_key = isinstance(node, Mapping) and not head.isdecimal()
    if node in (None, REQUIRED) or is_list(node) or is_key or not lists:
        return node
    return [node] * (lists[0].length or 1)
