"""`hodo show`: what is in result files."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..results.hdf5 import open_run
from ..results.layout import SUMMARY


def stored_cases(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """The cases of result files, with the attributes that a line of the table shows.

    Raises HodoError as `open_run` does.
    """
    rows = []
    for path in paths:
        with open_run(path) as run:
            rows += [
                {"run": str(path), "case": name, **run.row(name, SUMMARY)} for name in run.cases()
            ]
    return rows
