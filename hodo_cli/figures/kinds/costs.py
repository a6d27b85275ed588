"""The figure of `hodo bench`: error against run time."""

import math
from collections.abc import Sequence

import matplotlib.style
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D

from ...storage import Group
from ..artists import (
    GREEN,
    GREY,
    RED,
    SEPARATRIX,
    SKY,
    YELLOW,
    labelled_styles,
)
from ..sheet import PAGE, SHEET_STYLE, Drawing, Sheet
from ..style import filled, finish_figure

MIN_ERROR = 1e-17
"""Errors below this, zero too, stand at the bottom of a panel."""

VERDICT_COLOUR = (GREEN, SKY, YELLOW, "#BBBBBB", GREY, RED)


def draw_bench(trials: Group, verdicts: Sequence[str]) -> Sheet:
    """The figure of trials as they are stored, over case, method and tolerance: work against
    precision where there are several tolerances, else the map of verdicts."""
    with matplotlib.style.context(["default", SHEET_STYLE]):
        sheet = Sheet(Drawing(layout="constrained"))
        if len(trials.variables["tol"].data) > 1:
            work_precision(sheet, trials)
        else:
            status_map(sheet, trials, verdicts)
        finish_figure(sheet, "", {})
    return sheet


def work_precision(sheet: Sheet, trials: Group) -> None:
    """Error against run time, a panel per case and a line per method; each point is a tolerance."""
    stored = {name: variable.data for name, variable in trials.variables.items()}
    cases, errors = stored["case"], np.maximum(stored["error"], MIN_ERROR)
    # What ran out of time has an error too, of where it came to.
    done = np.isfinite(stored["error"]) & (stored["status"] != "timeout")
    columns = min(3, len(cases))
    rows = math.ceil(len(cases) / columns)
    panels = sheet.panels(PAGE, 1.8 * rows + 0.4, len(cases), columns, sharex=True, sharey=True)
    for i, (axes, case) in enumerate(zip(panels, cases, strict=True)):
        for j, style in enumerate(labelled_styles(stored["method"].tolist(), even_one=True)):
            x, y = stored["run_time"][i, j][done[i, j]], errors[i, j][done[i, j]]
            # A mark a point would make most of the file; a method with one point needs it.
            axes.loglog(x, y, marker="o" if len(x) == 1 else "", ms=2, **style)
        axes.axhline(max(stored["floor"][i].max(), MIN_ERROR), **SEPARATRIX)
        axes.set(title=case, ylim=(MIN_ERROR, 10))
        axes.tick_params(which="minor", left=False, right=False, bottom=False, top=False)
        axes.tick_params(right=False, top=False)
    for axes in panels[-columns:]:
        axes.set_xlabel("run time [s]")
    label = "largest relative error (dashed: what one ulp in the data makes)"
    sheet.figure.supylabel(filled(label, 1.5 * rows), size="medium")


def status_map(sheet: Sheet, trials: Group, verdicts: Sequence[str]) -> None:
    """The verdict on every method for every case, with its error; none where it was not tried."""
    cases, methods = (trials.variables[name].data for name in ("case", "method"))
    status, error = (trials.variables[name].data[:, :, 0] for name in ("status", "error"))
    (axes,) = sheet.panels(PAGE, 0.14 * len(cases) + 1)
    places = {verdict: i for i, verdict in enumerate(verdicts)}
    axes.imshow(
        [[places.get(word, math.nan) for word in row] for row in status],
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
    sheet.legend += [
        Line2D([], [], ls="", marker="s", color=colour, label=verdict)
        for colour, verdict in zip(VERDICT_COLOUR, verdicts, strict=True)
    ]
