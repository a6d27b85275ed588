"""Errors, costs and shares: the figure of `hodo bench`, and the figures of averaging."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D

from ... import HodoError
from ...cases.case import Case
from ...models.averaging.crossing_times import share_that_crosses
from ...models.averaging.free_turn import SAME_MOMENTS, Body
from ...models.terms.body import BodyUnderTorques
from ...results.dataset import Cases
from ...results.motion import Motion, forms_apart
from ...storage import Group
from ...sweeps.view import SweepView
from ..artists import (
    BLACK,
    GREEN,
    GREY,
    RED,
    SEPARATRIX,
    SKY,
    YELLOW,
    labelled_styles,
    styles,
)
from ..sheet import COLUMN, PAGE, SHEET_STYLE, Drawing, Look, Sheet
from ..style import filled, finish_figure
from ..symbols import position, value_unit
from ..words import without_tex
from .maps import positions

MONTE_CARLO: dict[str, Any] = {"ls": "", "marker": "o", "ms": 2.5, "mfc": "white", "mew": 0.7}
"""The look of counted shares, on the line of the calculated ones."""


def error_order(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """The largest relative distance of T and G^2 between two forms of a motion, against the small
    parameter, with the order of each group as the slope of its fit."""
    (axes,) = sheet.panels(COLUMN, 0.85 * COLUMN)
    errors = np.array([apart.max() for apart in map(forms_apart, motions, sheet.others)])
    for label, members, style in groups(spec, motions):
        small, error = np.array(spec["small"][members]), errors[members]
        # The order of an error is the slope of its logarithm.
        slope, start = np.polyfit(np.log(small), np.log(error), 1)
        axes.loglog(small, error, marker="o", ms=3, color=style["color"], ls="")
        order = f"{label}, order {slope:.2f}"
        axes.loglog(small, np.exp(start) * small**slope, **style, label=order)
        sheet.record(label, {"small": small, "error": error})
    axes.set(xlabel=f"${spec['parameter']}$", ylabel="largest relative error of $T$ and $G^2$")


def groups(spec: Mapping[str, Any], motions: Sequence[Motion]) -> Iterator[tuple[str, slice, Look]]:
    """Label, members and look of each group of a figure's motions."""
    # A line is a run of cases, so that a figure reads them in the order in which it names them.
    ends = np.cumsum(spec["groups"])
    for i, look in enumerate(styles(len(ends), spec["styles"])):
        members = slice(ends[i - 1] if i else 0, ends[i])
        label = spec["labels"][i] if i < len(spec["labels"]) else motions[members.start].name
        yield label, members, look


def cost(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """Steps and run time of groups of cases against the small parameter."""
    panels = sheet.panels(PAGE, 0.42 * PAGE, 2, 2)
    shown = {"steps": "steps", "run_time": "run time [s]"}
    for axes, (name, words) in zip(panels, shown.items(), strict=True):
        axes.set(xlabel=f"${spec['parameter']}$", ylabel=words)
        for label, members, style in groups(spec, motions):
            small = np.array(spec["small"][members])
            values = np.array([motion.attrs[name] for motion in motions[members]])
            axes.loglog(small, values, marker="o", ms=3, **style, label=label)
            sheet.record(label, {"small": small, name: values})


def share(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> None:
    """The share of starts that have crossed the separatrix by a time: of the members of a sweep, as
    points; averaged in closed form, where that holds, as lines."""
    (name,) = spec["cases"]
    swept = SweepView.of(name, cases[name])
    axis = next((other for other in swept.axes if other != swept.sphere), None)
    (axes,) = sheet.panels(COLUMN, 0.95 * COLUMN)
    curves = positions(swept, axis, ())
    damping = [damping_alone(swept.at(at)) for at in curves]
    names = share_names(swept, curves, damping, value_unit(swept, "r", sheet.units))
    looks = styles(len(curves), spec["styles"])
    for at, lam, label, look in zip(curves, damping, names, looks, strict=True):
        draw_share(sheet, axes, swept, at, lam, label, look)
    unit = value_unit(swept, "crossing_time", sheet.units)
    words = f"${spec['time']}$" + (f" [{unit}]" if unit else "")
    axes.set(xlabel=words, ylabel="share of starts that have crossed")
    axes.margins(x=0)
    counted = f"counted, {swept.case.form} motions"
    if {*damping} != {None}:
        sheet.legend.append(Line2D([], [], color=BLACK, label="averaged, in closed form"))
    sheet.legend.append(Line2D([], [], mec=BLACK, **MONTE_CARLO, label=counted))
    sheet.legend.append(Line2D([], [], ls="", label=NO_LINE if None in damping else ""))


def draw_share(
    sheet: Sheet, axes: Axes, swept: SweepView, at: Mapping[str, int],
    lam: tuple[float, ...] | None, label: str, look: Look,
) -> None:  # fmt: skip
    """Draw the counted shares of a sweep at a position on its other axis and, under damping of
    rates (3,) alone, the averaged ones."""
    time = swept.case.time
    if lam is not None:
        line = np.linspace(time.start, time.end, 101)
        averaged = averaged_share(swept.at(at), lam, line)
        axes.plot(line, averaged, **look, label=label)
        sheet.record(label, {"time": line, "averaged": averaged})
    points = np.linspace(time.start, time.end, 11)
    counted = counted_share(swept, at, points, label)
    circles = {"mec": look["color"], **MONTE_CARLO, "label": label if lam is None else ""}
    axes.plot(points, counted, **circles, clip_on=False, zorder=4)
    sheet.record(label, {"time": points, f"counted, {swept.case.form}": counted})


def counted_share(
    swept: SweepView, at: Mapping[str, int], points: np.ndarray, label: str
) -> np.ndarray:
    """The share (n,) of the starts of a sweep, at a position on its other axis, that have crossed
    by some times. Raises HodoError if no member counts."""
    times = swept.values("crossing_time", [swept.sphere], at)
    # Neither a member that failed nor one that never crosses has a time.
    times = times[np.isfinite(swept.values("status", [swept.sphere], at))]
    if not len(times):
        raise HodoError(f"sweep {swept.name} has no motion to count for {without_tex(label)}")
    return np.array([np.mean(times <= t) for t in points])


NO_LINE = "no line unless constant linear damping acts alone"
"""The words of a legend about members whose averaged share has no closed form."""


def damping_alone(case: Case) -> tuple[float, ...] | None:
    """The rates lambda_i (3,) of a body of three different moments under constant linear damping
    alone; None for other cases: of these the averaged share has no closed form."""
    system = case.system
    if not isinstance(system, BodyUnderTorques) or not system.is_plain:
        return None
    # Two moments that differ by their rounding leave no region between them.
    A = np.sort(system.moments)
    return system.constant_damping() if (np.diff(A) > SAME_MOMENTS * A[1]).all() else None


def averaged_share(case: Case, lam: Sequence[float], times: np.ndarray) -> np.ndarray:
    """The share (n,) of all starts that cross by some times under damping of rates (3,) alone,
    averaged over the turns in closed form."""
    body = Body.of(case.data["inertia"])
    return share_that_crosses(body, [lam[i] for i in body.order], times - case.time.start)


def share_names(
    swept: SweepView,
    curves: Sequence[Mapping[str, int]],
    damping: Sequence[tuple[float, ...] | None],
    unit: str,
) -> list[str]:
    """The name of each curve: the damping, in its unit, where it is all that acts and tells it from
    the others, else its position along the other axis of the sweep, or the sweep's name."""
    if None not in damping and len({*damping}) == len(damping):
        rates = (", ".join(f"{1e3 * x:g}" for x in lam or ()) for lam in damping)
        return [rf"$10^3\lambda = {words}$ {unit}".rstrip() for words in rates]
    names = (", ".join(position(swept, axis, i) for axis, i in at.items()) for at in curves)
    return [name or swept.name for name in names]


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
    """The verdict on every method for every case, with its error."""
    cases, methods = (trials.variables[name].data for name in ("case", "method"))
    status, error = (trials.variables[name].data[:, :, 0] for name in ("status", "error"))
    (axes,) = sheet.panels(PAGE, 0.14 * len(cases) + 1)
    axes.imshow(
        np.vectorize(verdicts.index)(status),
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
