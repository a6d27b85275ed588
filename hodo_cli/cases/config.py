"""Case files as a whole: from YAML text and the values of `--set` to a checked Config."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

from .. import HodoError
from ..schema.document import MAX_BYTES, YAML_SUFFIXES, Place, Source, read_mapping, write
from ..schema.kinds import (
    KeyPath,
    Mistake,
    Wrong,
    WrongKey,
    check,
    check_keys,
    check_tagged,
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
    checked_case,
    inherited_keys,
    merged,
    note_all,
    variation,
)
from .figure_block import FIGURE, merged_style
from .keys import SECTIONS, all_keys, drop_replaced_times, keys_in
from .sweep_block import swept_path


@dataclass(frozen=True)
class Config:
    """A case file: its text, its cases and figures by name, in the order of the file, and the
    overrides that changed its cases."""

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
        """The entry of the `figures:` block with this name. Raises HodoError if there is none."""
        if name not in self.figures:
            raise HodoError(f"{self.path}: {unknown(f'figure {name!r}', name, self.figures)}")
        return self.figures[name]

    def matching(self, globs: Sequence[str]) -> list[str]:
        """The names of the cases that match one of the globs, or all names without globs."""
        return [
            name for name in self.cases if any(fnmatchcase(name, glob) for glob in globs or ("*",))
        ]


HERE = Path(__file__).parent

BUNDLED_CONFIGS = (
    HERE.parent if (HERE.parent / "configs").exists() else HERE.parents[1]
) / "configs"
"""The folder of the case files that come with hodo: inside an installed package, next to the
package in a clone. It may be missing: a copy of the package alone runs too."""


def is_bare(name: str | Path) -> bool:
    """Whether a name may mean NAME.yaml: it has neither folder nor suffix, and no file has it."""
    path = Path(name)
    return path.name == str(name) and not path.suffix and not path.exists()


def write_new(path: Path) -> Path:
    """Write a commented case file to begin with, and return its path, which ends with .yaml.

    Raises HodoError if the file exists or cannot be written.
    """
    if not path.name:
        raise HodoError(f"{path} is no name of a case file")
    path = path if path.suffix in YAML_SUFFIXES else path.with_name(f"{path.name}.yaml")
    if fault := file_name_fault(path.stem, ()):
        raise HodoError(f"{path}: {fault}")  # as `hodo run` would of its result
    text = (HERE / "new.yaml").read_text(encoding="utf-8")
    try:
        # Mode "x" refuses an existing file in the same step in which it makes a new one.
        with open(path, "x", encoding="utf-8") as file:
            file.write(text.replace("{name}", str(path)).replace("{stem}", path.stem))
    except FileExistsError:
        raise HodoError(f"{path} is there already: take another name") from None
    except OSError as error:
        raise HodoError(f"cannot write {path}: {str(error.strerror).lower()}") from None
    return path


def load(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """The config in a file, with overrides such as "fig4.damping.2=0.001" applied to its cases.

    `path` may be a bare name: NAME.yaml here, or a case file that comes with hodo (paper1).

    An override is CASE.KEY.PATH=VALUE: a case's name or a glob, a key, further keys or zero-based
    positions within its value, and a value in YAML. It may add a key. Raises HodoError, one line
    for each mistake.
    """
    name, local = str(path), Path(f"{path}.yaml")
    meant = [(local, str(local)), (BUNDLED_CONFIGS / local, name)] if is_bare(name) else []
    file, label = next((pair for pair in meant if pair[0].exists()), (Path(name), name))
    return parse(text_of(file, label), label, overrides)


def text_of(path: Path, name: str) -> str:
    """The text of a case file, which messages call `name`. Raises HodoError if it has none."""
    try:
        with open(path, "rb") as file:
            # One byte more than allowed shows that a file is too large, without reading all of it.
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        # In lower case, as in the message of a missing result.
        reason = str(getattr(error, "strerror", None) or error).lower()
        shown_name = name if name.isprintable() else repr(name)
        nearby = [str(x) for x in path.parent.glob("*") if x.suffix in YAML_SUFFIXES]
        others = [*nearby, *(x.stem for x in BUNDLED_CONFIGS.glob("*.yaml"))]
        near = nearest(name, [other for other in others if other != name])
        raise HodoError(f"{shown_name}: {reason}{near}") from None
    if raw.startswith(b"\x89HDF"):
        raise HodoError(f"{name}: a result, where a case file (*.yaml) is expected")
    if len(raw) > MAX_BYTES:
        Source(name).fail(Place(1, 1), f"larger than {MAX_BYTES // 10**6} MB; split the file")
    # Editors on Windows put a byte order mark before the text. `read` refuses text that is not
    # UTF-8.
    return raw.decode("utf-8-sig", errors="surrogateescape")


def no_case(globs: Sequence[str], names: Iterable[str]) -> HodoError:
    """The error for `--case` options that match no case."""
    valid = list(dict.fromkeys(names))
    near = nearest(globs[-1], valid)
    return HodoError(f"no case matches {' or '.join(globs)}{near} (valid: {', '.join(valid)})")


def parse(text: str, name: str, overrides: Sequence[str] = (), stored: bool = False) -> Config:
    """The config in a text; `name` is its file in messages. Raises HodoError as `load` does. The
    statements of a text that is `stored` in a result are not checked again."""
    source = Source(name)
    document = read_mapping(text, source)
    # `figures:` with nothing below it is a section that is left out.
    present = {k: value for k, value in document.items() if value is not None or k not in SECTIONS}
    sections, faults = check_keys(SECTIONS, present)
    if "cases" not in present:
        # Otherwise every name of a case would be one more mistake, and hide this one.
        note_all(faults, source)
        raise source.error()
    named, defaults = sections.get("cases", {}), sections.get("defaults") or {}
    entries, more = _entries("cases", named)
    faults += more
    blocks = {case: merged(defaults, block) for case, block in entries.items()}
    faults += _default_mistakes(defaults, [*blocks.values()])
    for override in overrides:
        _apply_override(override, blocks, source)
    cases = {}
    for case, block in blocks.items():
        try:
            inherited = inherited_keys(defaults, entries[case])
            cases[case] = checked_case(case, block, inherited)
        except Wrong as error:
            faults += within(("cases", case), error.mistakes)
    figures, figure_faults = _figures(sections.get("figures") or {}, named, sections.get("style"))
    faults += figure_faults
    if "cases" in sections and not named:
        faults.append((("cases",), "there is no case"))
    if not stored:
        case_named = partial(_case_named, cases, named)
        faults += claim_block.cross_check(present.get("claims"), present.get("errata"), case_named)
    note_all(faults, source)
    source.raise_any()
    others = {key: sections[key] for key in ("title", "references", "claims", "errata", "bench")}
    return Config(name, text, cases, figures, **others, overrides=(*overrides,))


def located(config: Config, path: KeyPath, message: str) -> HodoError:
    """The error for a mistake in a config that only a result shows, with file, line and column, or
    with the override."""
    source = Source(config.path)
    document = read_mapping(config.text, source)
    defaults = document.get("defaults") or {}
    blocks = {name: merged(defaults, block) for name, block in document["cases"].items()}
    for override in config.overrides:
        _apply_override(override, blocks, source)
    note_all([(path, message)], source)
    return source.error()


def _case_named(cases: Mapping[str, Case], names: Iterable[str], entry: Any) -> Case | None:
    """The case that a statement names, as it is or with other values, or None if the case has
    mistakes. Raises Wrong for an entry that describes no case."""
    changes = {} if isinstance(entry, str) else dict(entry)
    name = changes.pop("case", None) if changes else entry
    if not isinstance(name, str):
        raise Wrong(((), "missing 'case', the name of the case that has other values here"))
    if name not in names:
        raise Wrong((("case",) if changes else (), unknown(f"case {name!r}", name, names)))
    case = cases.get(name)
    return variation(case, changes) if case and changes else case


def composed_text(cases: Mapping[str, Case], **sections: Any) -> str:
    """The text of a case file: first other sections, given as plain values, then these complete
    cases, one line each."""
    lines = [f"{section}: {write(value)}" for section, value in sections.items() if value]
    lines += ["cases:", *(f"  {name}: {write(case.entries)}" for name, case in cases.items()), ""]
    return "\n".join(lines)


def _entries(section: str, named: Mapping[str, Any]) -> tuple[dict[str, Any], list[Mistake]]:
    """The entries of a section that have a valid name and are mappings, and the mistakes in the
    other entries."""
    proper = {name: value for name, value in named.items() if NAME.fullmatch(name)}
    mistakes: list[Mistake] = [
        ((section, WrongKey(name)), NAME_RULE) for name in named if name not in proper
    ]
    mistakes += [
        ((section, name), f"expected a mapping, got {shown(value)}")
        for name, value in proper.items()
        if not isinstance(value, Mapping)
    ]
    return {name: x for name, x in proper.items() if isinstance(x, Mapping)}, mistakes


def _default_mistakes(defaults: Mapping[str, Any], blocks: Sequence[Any]) -> list[Mistake]:
    """A mistake for each of the defaults that no case takes."""
    models = [(block, *keys_in(block)) for block in blocks]
    if any(model is None and "model" in block for block, model, _ in models):
        return []  # an unknown model may have keys of its own
    # A case without a model may take any known key.
    taken = {key for _, model, keys in models for key in (keys if model else all_keys())}
    return [
        (
            ("defaults", WrongKey(key)),
            "no case here takes this key"
            if key in all_keys()
            else unknown("key", key, sorted(taken)),
        )
        for key in defaults
        if key not in taken
    ]


def _figures(
    section: Mapping[str, Any], cases: Mapping[str, Any], style: Mapping[str, Any] | None
) -> tuple[dict[str, dict[str, Any]], list[Mistake]]:
    """The figures, each checked by the keys of its kind and merged with the style of the file. The
    cases and figures that they name must exist."""
    entries, mistakes = _entries("figures", section)
    figures = {}
    for name, block in entries.items():
        values, wrong = check_tagged(FIGURE, block)
        if fault := file_name_fault(name, entries):
            mistakes.append((("figures", WrongKey(name)), fault))
        if values.get("cases") == ():
            wrong.append((("cases",), "names no case"))
        for key, valid in (("cases", cases), ("scale_with", section)):
            named: dict[KeyPath, str] = {(key, i): x for i, x in enumerate(values.get(key, ()))}
            wrong += unknown_names("name", named, valid)
        mistakes += within(("figures", name), wrong)
        figures[name] = {**values, "style": merged_style(style, values.get("style"))}
    return figures, mistakes


def _apply_override(text: str, blocks: dict[str, Any], source: Source) -> None:
    """Apply one override to the blocks of the cases that it names."""
    target, equals, value = text.partition("=")
    parts = target.strip().split(".")
    if not equals or not 2 <= len(parts) <= 50:
        source.note(text, "an override reads CASE.KEY=VALUE")
        return
    # Names of cases may contain points: the longest existing name counts, else the first part.
    heads = (".".join(parts[:n]) for n in range(len(parts) - 1, 0, -1))
    pattern = next((x for x in heads if any(fnmatchcase(name, x) for name in blocks)), parts[0])
    path = parts[pattern.count(".") + 1 :]
    if path[0] == "sweep" and len(path) > 1:
        path = ["sweep", *swept_path(path[1:])]
    names = [pattern] if pattern in blocks else [x for x in blocks if fnmatchcase(x, pattern)]
    if not names:
        source.note(text, unknown(f"case {parts[0]!r}", parts[0], blocks))
    source.override = text
    with suppress(HodoError):  # the source has noted the mistakes in the text of a value
        new = source.read(value)
        for name in names:
            try:
                blocks[name] = _with_override(blocks[name], path, new)
                source.overridden["cases", name, *path] = text
            except ValueError as error:
                source.note(text, str(error), ("cases", name, *path))
    source.override = ""


def _with_override(block: Mapping[str, Any], path: Sequence[str], new: Any) -> dict[str, Any]:
    """A case's entries with another value at a path. Raises ValueError if the path does not
    exist."""
    head, rule = path[0], keys_in(block)[1].get(path[0])
    before = block.get(head, (rule or {}).get("default"))
    with suppress(Wrong):  # mistakes in the earlier value are noted with its case
        # A single number for three equal ones has no components until it is written out.
        before = check(rule, before) if rule and len(path) > 1 else before
    changed = {**block, head: with_value(before, path[1:], new)}
    if head == "time" and isinstance(changed["time"], dict):
        # `path[1:2]` holds the key within `time:`, if the override names one.
        drop_replaced_times(changed["time"], dict.fromkeys(path[1:2], new))
    return changed


def with_value(value: Any, path: Sequence[str], new: Any) -> Any:
    """A copy of a value with `new` at a path within it. Raises ValueError, with a sentence, if the
    path does not exist."""
    if not path:
        return new
    head, *rest = path
    if value is None or isinstance(value, Mapping):
        entries = {key: item for key, item in (value or {}).items() if item is not None}
        return {**entries, head: with_value(entries.get(head), rest, new)}
    if is_list(value) and head.isdecimal() and int(head) < len(value):
        i = int(head)
        return [*value[:i], with_value(value[i], rest, new), *value[i + 1 :]]
    words = shown(value)
    if is_list(value):
        words = f"a list whose positions are 0 to {len(value) - 1}" if value else "an empty list"
    raise ValueError(f"there is no {head!r} in {words}")
