"""`hodo show`: the cases in result files."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .. import HodoError
from ..cases.case import parse_case
from ..results.layout import SUMMARY, typed_as
from ..storage.finished_cases import open_batch
from .resume import result_named, warn_of_changes

LISTED = SUMMARY | typed_as("case")


def stored_cases(paths: Iterable[Path]) -> tuple[list[dict[str, Any]], list[str]]:
    """The cases of result files, with the attributes that a line of the table shows, and a line for
    every damaged case.

    A path may be that of a config. Raises HodoError as `open_batch` does, or if a case has
    no such attributes.
    """
    rows: list[dict[str, Any]] = []
    problems = []
    for path, config in map(result_named, paths):
        with open_batch(path) as run:
            warn_of_changes(run, config)
            # One damaged case hides no other.
            problems += [f"{path}: {name} is damaged ({why})" for name, why in run.damaged.items()]
            for name in run.cases():
                if name not in run.damaged:
                    row = run.row(name, LISTED)
                    assumed = assumes_of(row.pop("case"))
                    rows.append({"run": str(path), "case": name, **row, "assumes": assumed})
    return rows, problems


def assumes_of(text: str) -> str:
    """The values that a stored case takes and its source does not print, in one line."""
    if "\nassumes:" not in text:  # so that of many cases those few are parsed that assume something
        return ""
    try:
        return "; ".join(f"{name}: {value}" for name, value in parse_case(text).assumes.items())
    except HodoError:  # its model is in a file that has not been named
        return ""
