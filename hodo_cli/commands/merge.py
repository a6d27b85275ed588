"""`hodo merge`: the cases, figures and statements of several results in a new one."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .. import HodoError
from ..cases.case import Case, parse_case
from ..cases.config import composed_text, parse
from ..results.resume import attributes_by, check_cases, result_named, stored_config
from ..schema.document import Source, read_mapping
from ..storage import open_batch, publish
from ..text import grouped


def merge_results(paths: Iterable[Path], out: Path) -> None:
    """Write a new result with the cases, figures and statements of several results, which may be
    named by their configs; it has no verdicts.

    Raises HodoError if `out` exists or is no name of a result, if a result cannot be read, or if
    cases, figures or statements of one name differ.
    """
    if out.suffix != ".h5" or os.path.lexists(out):
        raise HodoError(f"{out} is there already, or no name of a result: take a new one in .h5")
    results = [result_named(path)[0] for path in paths]
    cases: dict[str, Case] = {}
    known: dict[tuple[str, str], tuple[Path, Any]] = {}
    for path in results:
        with open_batch(path) as run:
            check_cases(run)
            document = read_mapping(run.text, Source(str(path)))
            config = stored_config(run)
            stored = {name: run.summary(name, ("hash", "case")) for name in run.cases()}
        cases = config.cases | cases | {x: parse_case(row["case"]) for x, row in stored.items()}
        entries: dict[tuple[str, str], Any] = {("title", config.title): config.title}
        entries |= {("references", config.references): config.references}
        entries |= {("case", name): row["hash"] for name, row in stored.items()}
        # The style of a file applies to its own figures alone, and is written into each.
        style = document.get("style") or {}
        entries |= {
            ("figures", name): figure | {"style": style | (figure.get("style") or {})}
            for name, figure in (document.get("figures") or {}).items()
        }
        for section in ("claims", "errata"):
            entries |= {(section, entry["id"]): entry for entry in document.get(section) or ()}
        for (section, name), entry in entries.items():
            other, first = known.setdefault((section, name), (path, entry))
            if first != entry:
                where = f"{section} {name} is in {other} and {path}"
                raise HodoError(f"{where} with different content: rename it in one config")
    named = grouped((section, (name, entry)) for (section, name), (_, entry) in known.items())
    by_section = {section: dict(entries_of) for section, entries_of in named.items()}
    heads = {
        section: "; ".join(filter(None, by_section[section])) for section in ("title", "references")
    }
    lists = {section: [*by_section.get(section, {}).values()] for section in ("claims", "errata")}
    text = composed_text(cases, **heads, figures=by_section.get("figures", {}), **lists)
    attributes = attributes_by(
        f"merge {' '.join(map(str, results))}", parse(text, str(out), stored=True)
    )
    chosen = {name: path for (section, name), (path, _) in known.items() if section == "case"}
    publish(out, attributes, chosen=chosen, dropped=("_claims", "_errata"), others=results)
