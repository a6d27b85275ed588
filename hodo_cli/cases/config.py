"""Case files as a whole: from YAML text to a checked Config."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import Any

from .. import HodoError
from ..schema import kinds
from ..schema.document import MAX_BYTES, Block
from ..schema.kinds import Choice, Key, Misnamed, Report
from ..schema.mistakes import Mistakes, Place
from . import claim_block
from .case import NAME, NAME_RULE, Case, check_sweep, checked_case, read_mapping, reporter
from .figure_block import KINDS
from .keys import SECTIONS, all_keys, keys_in
from .override import apply_override


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
    errata: tuple[dict[str, Any], ...] = ()
    bench: dict[str, Any] | None = None


def load(path: str | FilePath, overrides: Sequence[str] = ()) -> Config:
    """The config in a file, with overrides such as "fig4.damping.2=0.001" applied to its cases.

    An override is CASE.KEY.PATH=VALUE: a case's name or a glob, a key, further keys or zero-based
    positions within its value, and a value in YAML. It may add a key. Raises HodoError, one line
    for each mistake.
    """
    name = str(path)
    try:
        with open(path, "rb") as file:
            # One byte more than allowed tells a file that is too large without reading it.
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise HodoError(f"{name!r}: {getattr(error, 'strerror', None) or error}") from None
    mistakes = Mistakes(name)
    if len(raw) > MAX_BYTES:
        raise mistakes.fatal(Place(1, 1), f"larger than {MAX_BYTES // 10**6} MB; split the file")
    try:
        # Editors on Windows put a byte order mark before the text.
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = (
            raw.count(b"\n", 0, error.start) + 1,
            error.start - raw.rfind(b"\n", 0, error.start),
        )
        raise mistakes.fatal(
            Place(line, column), f"not UTF-8 text (byte {raw[error.start]:#04x})"
        ) from None
    return parse(text, name, overrides)


def parse(text: str, name: str, overrides: Sequence[str] = ()) -> Config:
    """The config in a text; `name` stands for the file in messages. Raises HodoError as `load`
    does."""
    mistakes = Mistakes(name)
    document = read_mapping(text, mistakes)
    report = reporter(document, (), Place(1, 1), mistakes)
    # `figures:` with nothing below it is a section that is left out.
    given = {section: value for section, value in document.items() if value is not None}
    sections = kinds.resolve(SECTIONS, given, (), report)
    cases, defaults = sections.get("cases", Block()), sections.get("defaults") or Block()
    if "cases" in sections and not cases:
        report(("cases",), "there is no case")
    blocks = {
        case: _merge(defaults, block)
        for case, block in cases.items()
        if _is_entry("cases", case, block, report)
    }
    for override in overrides:
        apply_override(override, blocks, mistakes)
    checked = [
        checked_case(
            case, block, reporter(block, ("cases", case), cases.value_places[case], mistakes)
        )
        for case, block in blocks.items()
    ]
    _check_defaults(defaults, blocks.values(), report)
    figures = _figures(sections.get("figures") or {}, cases, report)
    sweepable = {case.name: partial(check_sweep, case) for case in checked if case}
    known = {**dict.fromkeys(cases), **sweepable}
    claim_block.cross_check(given.get("claims"), given.get("errata"), known, report)
    mistakes.raise_any()
    return Config(
        path=name,
        text=text,
        title=sections["title"],
        references=sections["references"],
        cases={case.name: case for case in checked if case},
        figures=figures,
        claims=sections["claims"],
        errata=sections["errata"],
        bench=sections["bench"],
    )


def _is_entry(section: str, name: str, value: Any, report: Report) -> bool:
    """Whether an entry of a section has a proper name and is a mapping; reports it otherwise."""
    if not NAME.fullmatch(name):
        report((section, Misnamed(name)), NAME_RULE)
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
            merged.put(
                key, value, defaults.key_places[key], defaults.value_places[key], inherited=True
            )
    for key in ("time", "assumes"):
        own, common = given.get(key), defaults.get(key)
        if isinstance(own, Block) and isinstance(common, Block):
            # Key by key: a case that changes `end` keeps the common `samples`.
            merged[key] = _merge(common, own)
    return merged


def _check_defaults(defaults: Block, blocks: Iterable[Block], report: Report) -> None:
    """Report the defaults that no case takes."""
    found = [keys_in(block) for block in blocks]
    taken = (
        set(all_keys())
        # A case whose model is not known may take any key; its own mistake says enough.
        if any(form is None for form, _ in found)
        else {key for _, some in found for key in some}
    )
    for key in defaults:
        if key not in taken:
            message = (
                "no case here takes this key"
                if key in all_keys()
                else kinds.unknown("key", key, sorted(taken))
            )
            report(("defaults", Misnamed(key)), message)


def _figures(
    given: Mapping[str, Any], cases: Mapping[str, Any], report: Report
) -> dict[str, dict[str, Any]]:
    """The figures, each checked by the keys of its kind; the cases and figures that they name must
    exist."""
    figures = {}
    for name, block in given.items():
        if not _is_entry("figures", name, block, report):
            continue
        kind = block.get("kind")
        known = isinstance(kind, str) and kind in KINDS
        # Without a kind the other keys cannot be judged, and would each be called unknown.
        entries = block if known else {key: kind for key in block if key == "kind"}
        taken = {"kind": Key(Choice(*KINDS), "what is drawn")} | (KINDS[kind] if known else {})
        figures[name] = kinds.resolve(taken, entries, ("figures", name), report)
        for key, valid in (("cases", cases), ("scale_with", given)):
            for i, item in enumerate(figures[name].get(key, ())):
                if item not in valid:
                    report(("figures", name, key, i), kinds.unknown(f"name {item!r}", item, valid))
    return figures
