"""The figure of `hodo bench`: error against run time."""

import math
from collections.abc import Mapping
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.figure import Figure

from ..storage import Group, replacing
from .look import PAGE, STYLE_SHEET, looks

MIN_ERROR = 1e-18
"""The value drawn for an error of 0 on a logarithmic scale."""


def draw_bench(trials: Group, path: Path) -> None:
    """Draw error against run time into a file, from trials over case, method and tolerance: a panel
    for each case and a line for each method."""
    style = {"svg.fonttype": "none", "svg.hashsalt": "hodo"}
    with matplotlib.style.context(["default", STYLE_SHEET, style]), replacing(path) as draft:
        figure = Figure(layout="constrained")
        work_precision(figure, {name: x.data for name, x in trials.variables.items()})
        figure.savefig(draft, format=path.suffix[1:], metadata={"Date": None, "Creator": None})


def work_precision(figure: Figure, stored: Mapping[str, np.ndarray]) -> None:
    """Draw the panels and lines of `draw_bench`."""
    error, methods = np.maximum(stored["error"], MIN_ERROR), stored["method"].tolist()
    # A trial that ran out of time has an error too, at the place that it reached.
    done = np.isfinite(stored["error"]) & (stored["status"] != "timeout")
    columns = min(3, len(stored["case"]))
    rows = math.ceil(len(stored["case"]) / columns)
    figure.set_size_inches(PAGE, 1.8 * rows + 0.6)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for i, (axes, case) in enumerate(zip(panels, stored["case"], strict=False)):
        for j, (method, look) in enumerate(zip(methods, looks(len(methods)), strict=True)):
            x, y = stored["run_time"][i, j][done[i, j]], error[i, j][done[i, j]]
            # A method with one point needs a mark.
            axes.loglog(x, y, marker="o" if len(x) == 1 else "", ms=2, label=method, **look)
        floor = max(stored["floor"][i].max(), MIN_ERROR)
        axes.axhline(floor, color="black", lw=0.7, ls=":", label="one ulp in the data")
        axes.set(title=case, ylim=(MIN_ERROR, 10))
    for spare in panels[len(stored["case"]) :]:
        spare.remove()
    for axes in panels[: len(stored["case"])][-columns:]:
        axes.set_xlabel("run time [s]")
    figure.supylabel("largest relative error", size="medium")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
