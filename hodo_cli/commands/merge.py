"""`hodo merge`: the cases, figures and statements of several results in a new one."""

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from .. import HodoError
from ..cases.case import Case, dump, parse_case, read_mapping
from ..cases.config import composed_text, parse
from ..schema.mistakes import Mistakes
from ..storage.finished_cases import FinishedCase, finished_cases
from ..storage.hdf5 import ResultFile, open_run
from ..storage.provenance import history_line, root_attributes
from ..storage.writer import Writer
from .resume import has_all_of, result_named


def merge_results(paths: Iterable[Path], out: Path) -> None:
    """Write a new result with the cases of some, which may be named by their configs; it carries
    their figures and statements too.

    Raises HodoError if `out` is there already, if a result cannot be read, or if cases, figures or
    statements of one name differ.
    """
    if os.path.lexists(out):
        raise HodoError(f"{out} is there already: take another name")
    results = [result_named(path)[0] for path in paths]
    with ExitStack() as stack:
        runs = [stack.enter_context(open_run(path)) for path in results]
        stored: dict[str, FinishedCase] = {}
        for path in results:
            for name, (item, *_) in finished_cases(path).items():
                stored[name] = fuller(stored[name], item) if name in stored else item
        text = merged_text(runs, stored)
    config = parse(text, str(out))
    history = history_line(f"hodo merge {' '.join(map(str, results))}")
    attributes = root_attributes(config.title, config.references, text, history)
    with Writer(out, attributes, tuple(config.cases)) as writer:
        for item in stored.values():
            if not writer.keep(item):
                raise HodoError(f"{item.file}: {item.name} is damaged ({item.damage or 'gone'})")


def fuller(first: FinishedCase, second: FinishedCase) -> FinishedCase:
    """Of two equal results of a case the one that is labelled, if only one is. Raises HodoError if
    they are not equal."""
    groups = []
    for item in (first, second):
        with open_run(item.file) as run:
            groups.append(run.read(item.name))
    a, b = groups
    if has_all_of(a, b):
        return first
    if has_all_of(b, a):
        return second
    both = f"{first.file} and {second.file}"
    raise HodoError(f"{first.name} is in {both} with different results: rename it in one config")


def merged_text(runs: Sequence[ResultFile], stored: Mapping[str, FinishedCase]) -> str:
    """The case file of a merged result, with the stored cases as they were run.

    Raises HodoError if cases or figures of one name differ.
    """
    configs = [parse(run.text, str(run.path)) for run in runs]
    documents = [read_mapping(run.text, Mistakes(str(run.path))) for run in runs]
    cases: dict[str, Case] = {
        name: parse_case(str(item.attributes["case"])) for name, item in stored.items()
    }
    figures: dict[str, Any] = {}
    for config, document in zip(configs, documents, strict=True):
        for name, case in config.cases.items():
            if dump(cases.setdefault(name, case), remarks=False) != dump(case, remarks=False):
                raise HodoError(f"{config.path}: its case {name} differs from the stored one")
        for name, figure in (document.get("figures") or {}).items():
            if figures.setdefault(name, figure) != figure:
                raise HodoError(
                    f"{config.path}: another result has another figure {name}: rename one"
                )
    statements = {
        section: unique([entry for document in documents for entry in document.get(section) or ()])
        for section in ("claims", "errata")
    }
    title = ", ".join(unique([config.title for config in configs if config.title]))
    references = "; ".join(unique([config.references for config in configs if config.references]))
    return composed_text(cases, title=title, references=references, figures=figures, **statements)


def unique(entries: Sequence[Any]) -> list[Any]:
    """Entries in their order, equal ones once."""
    return [entry for i, entry in enumerate(entries) if entry not in entries[:i]]
