"""The figure of trials: how right each method is, and how fast."""

from collections.abc import Sequence

import matplotlib.style
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..results.hdf5 import Group
from .artists import GREEN, PAGE, RED, SEPARATRIX, SKY, styles
from .sheet import STYLE, Sheet

LEAST_ERROR = 1e-17
"""Errors below this, zero too, stand at the bottom of a panel."""

VERDICT_COLOUR = (GREEN, SKY, "#F0E442", "#BBBBBB", "#666666", RED)


def draw_bench(trials: Group, verdicts: Sequence[str]) -> Sheet:
    """The figure of trials as they are stored, over case, method and tolerance: work against
    precision where there are several tolerances, else the map of verdicts."""
    with matplotlib.style.context(["default", STYLE]):
        sheet = Sheet(Figure(layout="constrained"))
        if len(trials.variables["tol"].data) > 1:
            work_precision(sheet, trials)
        else:
            status_map(sheet, trials, verdicts)
    return sheet


def work_precision(sheet: Sheet, trials: Group) -> None:
    """Error against run time, a panel per case and a line per method; each point is a tolerance."""
    cases, methods = (trials.variables[name].data for name in ("case", "method"))
    columns = min(3, len(cases))
    rows = -(-len(cases) // columns)
    sheet.figure.set_size_inches(PAGE, 1.8 * rows + 0.4)
    panels = sheet.figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    names = ("error", "run_time", "status", "floor")
    error, time, status, floor = (trials.variables[name].data for name in names)
    for i, (axes, case) in enumerate(zip(panels, cases, strict=False)):
        for j, (method, style) in enumerate(zip(methods, styles(len(methods)), strict=True)):
            done = np.isfinite(error[i, j]) & (status[i, j] != "timeout")
            x, y = time[i, j][done], np.maximum(error[i, j][done], LEAST_ERROR)
            axes.loglog(x, y, marker="o", ms=2, label=method, **style)
            sheet.record(case, method, {"run_time": x, "error": y})
        axes.axhline(max(floor[i].max(), LEAST_ERROR), **SEPARATRIX)
        axes.set(title=case, ylim=(LEAST_ERROR, 10))
    for place, axes in enumerate(panels[len(cases) :], len(cases)):
        axes.set_axis_off()
        panels[place - columns].tick_params(labelbottom=True)
    sheet.figure.supxlabel("run time, s", fontsize=8)
    sheet.figure.supylabel(
        "largest relative error (dashed: what one ulp in the data makes)", fontsize=8
    )
    handles = [Line2D([], [], marker="o", ms=2, **style) for style in styles(len(methods))]
    sheet.figure.legend(handles, methods, loc="outside upper center", ncols=len(methods))


def status_map(sheet: Sheet, trials: Group, verdicts: Sequence[str]) -> None:
    """What every method makes of every case, with its error."""
    cases, methods = (trials.variables[name].data for name in ("case", "method"))
    status, error = (trials.variables[name].data[:, :, 0] for name in ("status", "error"))
    sheet.figure.set_size_inches(PAGE, 0.14 * len(cases) + 1)
    axes = sheet.figure.subplots()
    code = np.vectorize(verdicts.index)(status)
    axes.imshow(
        code,
        cmap=ListedColormap(VERDICT_COLOUR),
        vmin=-0.5,
        vmax=len(VERDICT_COLOUR) - 0.5,
        aspect="auto",
    )
    for (i, j), value in np.ndenumerate(error):
        if np.isfinite(value):
            text = f"{value:.0e}" if value else "0"
            axes.text(j, i, text, ha="center", va="center", fontsize=4.5)
    axes.set_xticks(range(len(methods)), methods)
    axes.set_yticks(range(len(cases)), cases, fontsize=5.5)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    for case, row in zip(cases, code, strict=True):
        sheet.record(case, "verdict", {name: row[[j]] for j, name in enumerate(methods)})
    handles = [Line2D([], [], ls="", marker="s", color=colour) for colour in VERDICT_COLOUR]
    sheet.figure.legend(handles, verdicts, loc="outside lower center", ncols=3)
