"""`hodo merge`: the cases, figures and statements of several results in a new one."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from .. import HodoError
from ..cases.case import Case, dump, parse_case, read_mapping
from ..cases.config import composed_text, parse
from ..schema.document import Mistakes
from ..storage import FinishedCase, ResultFile, compose, finished_cases, open_run
from .plot import with_sheet
from .resume import attributes_by, check_cases, has_all_of, result_named, stored_config


def merge_results(paths: Iterable[Path], out: Path) -> None:
    """Write a new result with the cases of some, which may be named by their configs; it carries
    their figures and statements too.

    Raises HodoError if `out` is there already, or is no name of a result, if a result cannot be
    read, or as `merged_text` does.
    """
    if out.suffix != ".h5":
        raise HodoError(f"{out} would be taken for no result: take a name that ends with .h5")
    if os.path.lexists(out):
        raise HodoError(f"{out} is there already: take another name")
    results = [result_named(path)[0] for path in paths]
    with ExitStack() as stack:
        runs = [stack.enter_context(open_run(path)) for path in results]
        stored: dict[str, FinishedCase] = {}
        for path in results:
            for name, (item, *_) in finished_cases(path).items():
                if item.damage:
                    raise HodoError(f"{path}: {name} is damaged ({item.damage})")
                stored[name] = labelled_one(stored[name], item) if name in stored else item
        text = merged_text(runs, stored, out)
    config = parse(text, str(out), stored=True)
    attributes = attributes_by(f"merge {' '.join(map(str, results))}", config)
    with compose(out, attributes, tuple(config.cases)) as writer:
        for item in stored.values():
            if not writer.keep(item):
                raise HodoError(f"{item.file}: {item.name} is gone: another process replaced it")


def labelled_one(first: FinishedCase, second: FinishedCase) -> FinishedCase:
    """Of two equal results of a case the one that is labelled, if only one is. Raises HodoError if
    they are not equal."""
    with open_run(first.file) as run, open_run(second.file) as other:
        a, b = run.read(first.name), other.read(second.name)
    if has_all_of(a, b):
        return first
    if has_all_of(b, a):
        return second
    raise HodoError(
        f"{first.name} is in {first.file} and {second.file} with different results: "
        "rename it in one config"
    )


def merged_text(runs: Sequence[ResultFile], stored: Mapping[str, FinishedCase], out: Path) -> str:
    """The case file of a merged result, with the stored cases as they were run.

    Raises HodoError as `check_cases` does, if cases or statements of one name differ, or figures of
    one name in results of one name.
    """
    for run in runs:
        check_cases(run)
    configs = [stored_config(run) for run in runs]
    documents = [read_mapping(run.text, Mistakes(str(run.path))) for run in runs]
    cases: dict[str, Case] = {
        name: parse_case(str(item.attributes["case"])) for name, item in stored.items()
    }
    figures: dict[str, Any] = {}
    for run, config, document in zip(runs, configs, documents, strict=True):
        # Of a case that has been run the stored one counts, which a later text may have changed.
        for name, case in config.cases.items():
            others = cases.setdefault(name, case)
            if name not in run and dump(others, remarks=False) != dump(case, remarks=False):
                raise HodoError(f"{config.path}: its case {name} differs from the stored one")
        entries = document.get("figures") or {}
        figures |= added_figures(figures, run, entries, config.figures, out)
    statements = {}
    for section in ("claims", "errata"):
        entries = [entry for document in documents for entry in document.get(section) or ()]
        statements[section] = unique(entries)
        ids = [entry["id"] for entry in statements[section]]
        if again := [name for i, name in enumerate(ids) if name in ids[:i]]:
            raise HodoError(
                f"{section}: two results have different ones called {again[0]}: rename one"
            )
    title = ", ".join(unique([config.title for config in configs if config.title]))
    references = "; ".join(unique([config.references for config in configs if config.references]))
    return composed_text(cases, title=title, references=references, figures=figures, **statements)


def added_figures(
    before: Mapping[str, Any],
    run: ResultFile,
    entries: Mapping[str, Any],
    checked: Mapping[str, Mapping[str, Any]],
    out: Path,
) -> dict[str, Any]:
    """The figures that a result adds to those `before` it, each with the style of its case file. If
    another one has a name of theirs, all of them carry the name of their result too.

    Raises HodoError if that does not tell them apart.
    """
    stem = re.sub(r"[^A-Za-z0-9._-]", "_", run.path.stem)
    folder = Path(os.path.realpath(out.parent))
    for suffix in ("", f"-{stem}"):
        figures = {}
        for name, entry in entries.items():
            # A result without a config of its own counts from the folder that `runs` is in.
            style = with_sheet(checked[name]["style"], run, folder.parent)
            scale = [f"{other}{suffix}" for other in checked[name].get("scale_with", ())]
            changed = {"style": style, "scale_with": scale}
            figures[f"{name}{suffix}"] = {**entry, **{k: v for k, v in changed.items() if v}}
        clashes = [name for name, figure in figures.items() if before.get(name, figure) != figure]
        if not clashes:
            return figures
    other = f"another result has another figure {clashes[0]}"
    raise HodoError(f"{run.path}: {other}: rename a result")


def extended_text(path: Path, cases: Mapping[str, Case]) -> str:
    """The case file of a result with more cases, or others of the same names; of these alone if
    there is no result yet. Raises HodoError if it cannot be read."""
    if not os.path.lexists(path):
        return composed_text(cases)
    with open_run(path) as run:
        document = read_mapping(run.text, Mistakes(str(path)))
        cases = {**stored_config(run).cases, **cases}
    for section in ("cases", "defaults"):
        document.pop(section, None)
    return composed_text(cases, **document)


def unique(entries: Sequence[Any]) -> list[Any]:
    """Entries in their order, equal ones once."""
    return [entry for i, entry in enumerate(entries) if entry not in entries[:i]]
