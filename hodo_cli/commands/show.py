"""`hodo show`: what is in result files."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..cases.case import parse_case
from ..results.hdf5 import open_run
from ..results.layout import SUMMARY, typed_as

CASE = typed_as("case")


def stored_cases(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """The cases of result files, with the attributes that a line of the table shows.

    Raises HodoError as `open_run` does.
    """
    rows = []
    for path in paths:
        with open_run(path) as run:
            rows += [
                {"run": str(path), "case": name, **run.row(name, SUMMARY), "assumes": assumed}
                for name in run.cases()
                for assumed in [assumes_of(run.row(name, CASE)["case"])]
            ]
    return rows


def assumes_of(text: str) -> str:
    """What a stored case takes that its source does not print, in one line."""
    return "; ".join(f"{name}: {said}" for name, said in parse_case(text).assumes.items())
