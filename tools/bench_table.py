"""Print error against run time of a bench, in Markdown: `python tools/bench_table.py
runs/error_time.bench.h5`.

The table has a row for each case and method, and a column for every other tolerance.
"""

import sys
from collections.abc import Iterator, Sequence

import numpy as np
import xarray

from hodo_cli.text import magnitude, seconds

STEP = 2
"""The table has each second tolerance, which shows where an error ends; the figure has all."""


def cell(error: float, time: float, status: str) -> str:
    """Error and run time of a trial; a dash where it did not come to its end."""
    if status == "timeout" or not np.isfinite(error):
        return "-"
    return f"{magnitude(error)}, {seconds(time)}"


def rows(trials: xarray.Dataset) -> Iterator[Sequence[str]]:
    """The lines of the table; a method that solves a case at no tolerance has none."""
    columns = trials.variables
    cases, methods, tols = (columns[name].data for name in ("case", "method", "tol"))
    yield ["case", "method", *(f"{tol:.0e}" for tol in tols[::STEP])]
    yield ["---"] * (2 + len(tols[::STEP]))
    values = [columns[name].data[:, :, ::STEP] for name in ("error", "run_time", "status")]
    for i, case in enumerate(cases):
        for j, method in enumerate(methods):
            cells = [cell(*trial) for trial in zip(*(x[i, j] for x in values), strict=True)]
            if set(cells) != {"-"}:
                yield [str(case), str(method), *cells]


if __name__ == "__main__":
    bench = xarray.load_dataset(sys.argv[1], group="bench", engine="netcdf4")
    print("\n".join(f"| {' | '.join(row)} |" for row in rows(bench)))
