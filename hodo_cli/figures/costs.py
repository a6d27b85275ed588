"""The figure of `hodo bench`: error against run time."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.style
import numpy as np

from ..storage import Group
from .files import save
from .look import STYLE_SHEET, Sheet, looks

MIN_ERROR = 1e-18
"""The value drawn for an error of 0 on a logarithmic scale."""


def draw_bench(trials: Group, path: Path) -> None:
    """Draw error against run time into a file, from trials over case, method and tolerance: a panel
    for each case and a line for each method."""
    with matplotlib.style.context(["default", STYLE_SHEET]):
        sheet = Sheet({"style": {}, "title": ""})
        work_precision(sheet, {name: x.data for name, x in trials.variables.items()})
        sheet.finish()
    save(sheet, path)


def work_precision(sheet: Sheet, stored: Mapping[str, np.ndarray]) -> None:
    """Draw the panels and lines of `draw_bench`."""
    error, methods = np.maximum(stored["error"], MIN_ERROR), stored["method"].tolist()
    # A trial that ran out of time has an error too, at the place that it reached.
    done = np.isfinite(stored["error"]) & (stored["status"] != "timeout")
    n, columns = len(stored["case"]), sheet.columns(min(3, len(stored["case"])))
    panels = sheet.panels(1.8, n, columns, 0.2, sharex=True, sharey=True)
    for i, (axes, case) in enumerate(zip(panels, stored["case"], strict=True)):
        for j, (method, look) in enumerate(zip(methods, looks(len(methods)), strict=True)):
            x, y = stored["run_time"][i, j][done[i, j]], error[i, j][done[i, j]]
            # A method with one point needs a mark.
            axes.loglog(x, y, marker="o" if len(x) == 1 else "", ms=2, label=method, **look)
        floor = max(stored["floor"][i].max(), MIN_ERROR)
        axes.axhline(floor, color="black", lw=0.7, ls=":", label="one ulp in the data")
        axes.set(title=case, ylim=(MIN_ERROR, 10))
    for axes in panels[-columns:]:
        axes.set_xlabel("run time [s]")
    sheet.figure.supylabel("largest relative error", size="medium")
