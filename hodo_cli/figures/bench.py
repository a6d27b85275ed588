"""The figure of `hodo bench`."""

from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .artists import GREEN, PAGE, RED, SEPARATRIX, SKY, styles
from .sheet import STYLE, Sheet

VERDICT_COLOUR = (GREEN, SKY, "#F0E442", "#BBBBBB", "#666666", RED)


def draw_bench(bench: Any) -> Sheet:
    """The figure of a bench: work against precision where there are several tolerances, else the
    map of verdicts."""
    with matplotlib.style.context(["default", STYLE]):
        sheet = Sheet(Figure(layout="constrained"))
        (work_precision if len(bench.tols) > 1 else status_map)(sheet, bench)
    return sheet


def work_precision(sheet: Sheet, bench: Any) -> None:
    """Error against run time, a panel per case and a line per method; each point is a tolerance."""
    columns = min(3, len(bench.cases))
    rows = -(-len(bench.cases) // columns)
    sheet.figure.set_size_inches(PAGE, 1.8 * rows + 0.4)
    panels = sheet.figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    error, time, status = (bench.values(name) for name in ("error", "run_time", "status"))
    for i, (axes, case) in enumerate(zip(panels, bench.cases, strict=False)):
        for j, (method, style) in enumerate(
            zip(bench.methods, styles(len(bench.methods)), strict=True)
        ):
            done = np.isfinite(error[i, j]) & (status[i, j] != "timeout")
            x, y = time[i, j][done], np.maximum(error[i, j][done], 1e-17)
            axes.loglog(x, y, marker="o", ms=2, label=method, **style)
            sheet.record(case, method, run_time=x, error=y)
        axes.axhline(max(bench.values("floor")[i].max(), 1e-17), **SEPARATRIX)
        axes.set(title=case, ylim=(1e-17, 10))
    for place, axes in enumerate(panels[len(bench.cases) :], len(bench.cases)):
        axes.set_axis_off()
        panels[place - columns].tick_params(labelbottom=True)
    sheet.figure.supxlabel("run time, s", fontsize=8)
    sheet.figure.supylabel(
        "largest relative error (dashed: what one ulp in the data makes)", fontsize=8
    )
    handles = [Line2D([], [], marker="o", ms=2, **style) for style in styles(len(bench.methods))]
    sheet.figure.legend(
        handles, bench.methods, loc="outside upper center", ncols=len(bench.methods)
    )


def status_map(sheet: Sheet, bench: Any) -> None:
    """What every method makes of every case, with its error."""
    status, error = bench.values("status")[:, :, 0], bench.values("error")[:, :, 0]
    sheet.figure.set_size_inches(PAGE, 0.14 * len(bench.cases) + 1)
    axes = sheet.figure.subplots()
    code = np.vectorize(bench.verdicts.index)(status)
    axes.imshow(
        code,
        cmap=ListedColormap(VERDICT_COLOUR),
        vmin=-0.5,
        vmax=len(VERDICT_COLOUR) - 0.5,
        aspect="auto",
    )
    for (i, j), value in np.ndenumerate(error):
        if np.isfinite(value):
            axes.text(
                j, i, f"{value:.0e}" if value else "0", ha="center", va="center", fontsize=4.5
            )
    axes.set_xticks(range(len(bench.methods)), bench.methods)
    axes.set_yticks(range(len(bench.cases)), bench.cases, fontsize=5.5)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    for case, row in zip(bench.cases, code, strict=True):
        sheet.record(case, "verdict", **{name: row[[j]] for j, name in enumerate(bench.methods)})
    handles = [Line2D([], [], ls="", marker="s", color=colour) for colour in VERDICT_COLOUR]
    sheet.figure.legend(handles, bench.verdicts, loc="outside lower center", ncols=3)
