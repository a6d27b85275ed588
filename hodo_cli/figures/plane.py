"""Plane figures: series over time, one variable against another, quadrants, invariants, and error
against run time."""

import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Wedge

from .. import HodoError
from ..models.body import Body
from ..models.rigid_body import inertia_order, slope
from ..quantities import symbol
from ..results.motion import Motion, formula_values
from ..schema.spelling import unknown
from ..storage import Group
from ..text import grouped
from .between import Course, samples_in
from .files import save
from .look import (
    AXIS_LOOKS,
    COLUMN,
    CROSSING,
    END,
    GREY,
    PAGE,
    SEPARATRIX,
    STYLE_SHEET,
    Look,
    Sheet,
    axis_label,
    check_zoom,
    colour_legend,
    crossing_legend,
    curves,
    looks,
    mark_legend,
    marks,
    time_label,
    unit,
    unit_of_time,
    usual_width,
)
from .words import Words

FITTED: Look = {"color": "black", "lw": 1.0, "ls": (0, (5, 1.5)), "zorder": 4}

Drawn = tuple[Course, str, Look]
"""A variable of a motion and the look of its curve."""


def series(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Variables against time, a panel for each variable or for each case."""
    spec, names = sheet.spec, sheet.spec["variables"]
    by_case = spec["panels"] == "case"
    titles = [f"${symbol(name)}$" for name in names] if by_case else [m.label for m in motions]
    ways = looks(len(titles), () if by_case else spec["styles"])
    if len(titles) > 1 or spec["formula"]:
        ways = [way | {"label": title} for way, title in zip(ways, titles, strict=True)]
    groups: dict[str, list[Drawn]] = grouped(
        (m.name if by_case else name, (m, name, ways[j if by_case else i]))
        for i, m in enumerate(motions)
        for j, name in enumerate(names)
    )
    for panel in (entry["panel"] for entry in spec["insets"]):
        if panel not in groups:
            raise HodoError(f"insets: {unknown(f'panel {panel!r}', panel, groups)}")
    columns = sheet.columns(min(spec["columns"], len(groups)))
    row = max(0.62 * usual_width(columns) / columns, 1.4)
    panels = sheet.panels(row, len(groups), columns, 0.2, sharex=True, sharey=by_case)
    for axes, (group, curves_of) in zip(panels, groups.items(), strict=True):
        for m, name, look in curves_of:
            over_time(sheet, axes, m, name, look)
            law_of(sheet, axes, m, name)
            events(axes, m, name, spec)
        axes.margins(x=0.02, y=0.08)
        if spec["level"] is not None:
            axes.axhline(spec["level"], **SEPARATRIX)
        (label_case if by_case else label_variable)(axes, curves_of)
        for enlarged in (entry for entry in spec["insets"] if entry["panel"] == group):
            inset(sheet, axes, enlarged, curves_of)
    for axes in panels[-columns:]:
        axes.set_xlabel(time_label(spec, motions[0]))
    panels[0].set_xlim(*(spec["span"] or (min(m.time[0] for m in motions), None)))


def over_time(sheet: Sheet, axes: Axes, m: Course, name: str, look: Look) -> None:
    """Draw a variable of a motion within the span of the figure."""
    part, stored = (samples_in(x, sheet.spec.get("span")) for x in (m, m.samples))
    values = m[name].astype(float)
    if name.startswith("rotation."):
        # Where a vector of half a turn jumps to its opposite there is a gap.
        jumps = np.linalg.norm(np.diff(m.vector("rotation"), axis=0), axis=1) > math.pi
        values[1:][jumps] = np.nan
    mark = "o" if part.stop - part.start == 1 else ""
    axes.plot(m.time[part], values[part], **look, marker=mark)
    known = m.samples[name][stored]
    sheet.record(m.label, {"time": m.samples.time[stored], name: known})
    if not np.isfinite(known).any():
        warnings.warn(f"{name} of {m.name} has no value at any sample: no curve", stacklevel=2)


def law_of(sheet: Sheet, axes: Axes, m: Course, name: str) -> None:
    """Draw the law with which a variable is compared, if the figure gives one."""
    if law := sheet.spec["formula"].get(name):
        stored = samples_in(m.samples, sheet.spec["span"])
        time, fitted = m.samples.time[stored], formula_values(m.samples, law)[stored]
        words = f"${symbol(name)}$ = {law}".replace("**", "^").replace("*", " · ")
        axes.plot(time, fitted, **FITTED, label=words)
        sheet.record(f"{m.label}, {law}", {"time": time, name: fitted})


def label_variable(axes: Axes, drawn: Sequence[Drawn]) -> None:
    """Name the variable that a panel shows of all cases. Constant values get a scale on which they
    look constant, and words that say so: on the scale of their rounding they look like noise."""
    m, name, _ = drawn[0]
    axes.set_ylabel(axis_label(m, name))
    known = np.concatenate([np.asarray(line.get_ydata(), float) for line in axes.lines])
    known = known[np.isfinite(known)]
    if known.size > 1 and np.ptp(known) <= 1e-9 * np.abs(known).max():
        half = 0.1 * np.abs(known).max() or 1.0
        axes.set_ylim(known.mean() - half, known.mean() + half)
        words = f"constant to {np.ptp(known):.1e}" if np.ptp(known) else "constant"
        place: Look = {"xycoords": "axes fraction", "ha": "right", "va": "top", "size": "small"}
        axes.annotate(words, (0.97, 0.95), **place)


def label_case(axes: Axes, drawn: Sequence[Drawn]) -> None:
    """Name the case and, in the first panel of a row, the variables that a panel shows of it."""
    m = drawn[0][0]
    axes.set_title(m.label)
    labels, units = [axis_label(m, name) for _, name, _ in drawn], {unit(m, x) for _, x, _ in drawn}
    if len(units) == 1:
        symbols = ", ".join(f"${symbol(name)}$" for _, name, _ in drawn)
        labels = [f"{symbols} {units.pop()}"]
    place = axes.get_subplotspec()
    if place and place.is_first_col():
        axes.set_ylabel(", ".join(labels))


def events(axes: Axes, m: Motion, name: str, spec: Mapping[str, Any]) -> None:
    """Mark the events of a motion on its curve, each with the value there, or with the time if that
    value is 0."""
    low, high = spec["span"] or (-math.inf, math.inf)
    for kind, when in ((kind, when) for kind, when in m.events if low <= when <= high):
        value = float(np.interp(when, m.time, m[name]))
        axes.plot(when, value, **END, clip_on=False, zorder=5, label=kind.replace("_", " "))
        words = f"${symbol(name)}$ = {value:#.4g}"
        if abs(value) <= 1e-3 * np.nanmax(np.abs(m[name])):
            words = f"${symbol(name)}$ = 0 at ${spec['time']}$ = {when:#.4g}{unit_of_time(m)}"
        Words(axes, words, [(when, value)], toward=(-0.5, 1), size="small")


def inset(sheet: Sheet, panel: Axes, spec: Mapping[str, Any], drawn: Sequence[Drawn]) -> None:
    """Draw a part of a panel's curves enlarged within the panel."""
    axes, shown = panel.inset_axes(spec["box"]), []
    for m, name, look in drawn:
        if m.name == spec["case"] and name in spec["variables"]:
            part, stored = (samples_in(x, spec["span"]) for x in (m, m.samples))
            axes.plot(m.time[part], m[name][part], **look | {"lw": 0.9})
            sheet.record(m.name, {"time": m.samples.time[stored], name: m.samples[name][stored]})
            shown.append(f"${symbol(name)}$" + f", {m.label}" * (m.label != panel.get_title()))
    if not shown:
        raise HodoError(f"insets: panel {spec['panel']} draws none of {spec['variables']}")
    axes.set_title("; ".join(shown), size="small", pad=2)
    axes.tick_params(labelsize="x-small")
    axes.margins(x=0)


def phase(sheet: Sheet, motions: Sequence[Course]) -> None:
    """One variable against another."""
    names, first = [sheet.spec["x"], sheet.spec["y"]], motions[0]
    (axes,) = sheet.panels(0.9 * COLUMN)
    for m, look in zip(motions, looks(len(motions), sheet.spec["styles"]), strict=True):
        points = np.stack([m[name] for name in names], axis=-1)
        axes.plot(*points.T, **look, label=m.label if len(motions) > 1 else "")
        marks(axes, points, m.at(m.crossing_time, points))
        sheet.record(m.label, {"time": m.samples.time} | {x: m.samples[x] for x in names})
    axes.set(xlabel=axis_label(first, names[0]), ylabel=axis_label(first, names[1]))
    axes.margins(0.06)
    vectors = {"omega" if name in "pqr" else name.rpartition(".")[0] for name in names}
    if len(vectors) == 1 and vectors != {""}:
        axes.set(aspect="equal", adjustable="datalim")
    mark_legend(sheet, motions)


def quadrants(sheet: Sheet, motions: Sequence[Course]) -> None:
    """p^2 against K r^2, with the regions A (D > 0) and B (D < 0); an enlargement is the larger
    panel, because the whole shows few turns of most motions."""
    spec, points = sheet.spec, [m.quadrants for m in motions]
    bodies = {m.inertia.tobytes(): m.name for m in motions}
    if len(bodies) > 1:
        names = " and ".join(bodies.values())
        raise HodoError(f"{names} are motions of several bodies, each of which has its own regions")
    m = motions[0]
    p, r = "pqr"[m.order[0]], "pqr"[m.order[2]]
    for motion in motions:
        sheet.record_vector(motion, motion.samples.quadrants, (f"{p}^2", f"K {r}^2"))
    limits = [1.05 * max(float(x.quadrants.max()) for x in (*motions, *sheet.others)) or 1.0]
    if spec["zoom"] is not None:
        check_zoom(spec["zoom"], min(float(curve.max(axis=1).min()) for curve in points))
        limits.append(spec["zoom"])
    columns = sheet.columns(len(limits))
    row, grid = 1.05 * COLUMN, dict[str, Any]()
    if columns > 1:
        row, grid = 0.62 * PAGE, {"width_ratios": [1, 1.8]}
    panels = sheet.panels(row, len(limits), columns, **grid)
    of_omega = unit(m, "omega", 2)
    for axes, limit in zip(panels, limits, strict=True):
        axes.plot([0, limit], [0, limit], color="black", lw=0.7, ls="-")
        places = limit * np.array([(0.97, 0.06), (0.8, 0.06), (0.9, 0.3), (0.7, 0.2), (0.95, 0.6)])
        areas = [
            ("A", m.order[0], (limit, 0), places),
            ("B", m.order[2], (0, limit), places[:, ::-1]),
        ]
        # Without K no point is above the diagonal: a body with two smallest moments has no B.
        for name, axis, corner, at in areas if slope(m.inertia) else areas[:1]:
            triangle: Any = [(0, 0), (limit, limit), corner]
            axes.add_patch(Polygon(triangle, fc=AXIS_LOOKS[axis + 1][0], alpha=0.1, lw=0))
            is_small = columns > 1 and axes is panels[0]
            words = name if is_small else f"{name} (about $x_{axis + 1}$)"
            Words(axes, words, [*at, *(0.75 * at), *(0.5 * at)], beside=False)
        curves(axes, motions, spec, points, limit)
        axes.set(xlim=(0, limit), ylim=(0, limit), aspect="equal")
        axes.set(xlabel=f"${p}^2$ {of_omega}", ylabel=f"$K{r}^2$ {of_omega}")
    if len(panels) > 1:
        panels[0].set(anchor="N")
        panels[1].set_title("enlarged")
    colour_legend(sheet, panels, motions)
    mark_legend(sheet, motions)


def quadrant_sketch(sheet: Sheet, motions: Sequence[Course]) -> None:
    """r^2 against p^2 for each body, with the line p^2 = K r^2, A below it and B above, without
    scale."""
    bodies, labels = sheet.spec["bodies"], sheet.spec["labels"]
    columns = sheet.columns(len(bodies))
    panels = sheet.panels(usual_width(columns) / columns + 0.5, len(bodies), columns)
    titles = [*labels, *[""] * (len(bodies) - len(labels))]
    for axes, A, label in zip(panels, bodies, titles, strict=True):
        K, (largest, _, smallest) = slope(A), inertia_order(A)
        title = label or "$A_i$ = {:g}, {:g}, {:g}".format(*A)
        sheet.record(title, {f"A{i}": np.array([a]) for i, a in enumerate(A, 1)} | {"K": [K]})
        # The angle of the line above the horizontal axis, on which p^2 = K r^2 grows.
        angle = math.atan2(1, K)
        axes.plot([0, 2 * math.cos(angle)], [0, 2 * math.sin(angle)], "k-", lw=1.4)
        ends = np.degrees([0, angle, math.pi / 2])
        for name, axis, low, high in zip("AB", (largest, smallest), ends, ends[1:], strict=False):
            look: Look = {"fc": AXIS_LOOKS[axis + 1][0], "alpha": 0.12, "lw": 0}
            axes.add_patch(Wedge((0, 0), 2, low, high, **look))
            middle = np.radians((low + high) / 2)
            at = np.array([np.cos(middle), np.sin(middle)])
            words = f"{name}\nabout $x_{axis + 1}$" if high - low > 25 else name
            places = [0.6 * at, 0.75 * at, 0.45 * at]
            Words(axes, words, places, beside=False, visible=high - low > 1)
        axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xticks=[], yticks=[])
        axes.set_title(f"{title}\n$K$ = {K:.3g}".replace("inf", r"$\infty$"))
        axes.set_xlabel(f"${'pqr'[largest]}^2$", loc="right")
        axes.set_ylabel(f"${'pqr'[smallest]}^2$", loc="top", rotation=0)
        axes.spines[["top", "right"]].set_visible(False)


def invariants(sheet: Sheet, motions: Sequence[Course]) -> None:
    """T, G^2 and D/2T against time, with the bounds that the body and its damping set."""
    names, m = ("T", "G2", "D/2T"), motions[0]
    panels = sheet.panels(1.75 / 3 * COLUMN, 3, sharex=True)
    for motion, look in zip(motions, looks(len(motions), sheet.spec["styles"]), strict=True):
        label = motion.label if len(motions) > 1 else ""
        for axes, name in zip(panels, names, strict=True):
            over_time(sheet, axes, motion, name, {**look, "zorder": 3, "label": label})
        sheet.record(motion.label, {"time": motion.samples.time, "D": motion.samples["D"]})
        bounds(panels, motion)
        crossed = motion.crossing_time
        panels[2].plot(crossed, 0 * crossed, **CROSSING, zorder=4)
    ends = m.inertia - sorted(m.inertia)[1]
    for i in (i for i in (m.order[0], m.order[2]) if ends[i]):
        panels[2].axhspan(*sorted((0, ends[i])), fc=AXIS_LOOKS[i + 1][0], alpha=0.1, lw=0)
        times = np.linspace(m.time[0], m.time[-1], 11)[1:-1]
        places = np.stack([times, np.full(9, 0.8 * ends[i])], axis=-1)
        Words(panels[2], f"about $x_{i + 1}$", places, beside=False)
    panels[2].axhline(0, **SEPARATRIX)
    for axes, name in zip(panels, names, strict=True):
        axes.set_ylabel(axis_label(m, name))
        axes.margins(x=0)
    for axes in panels[:2]:
        low, high = axes.dataLim.intervaly
        # More than a decade is unreadable on a linear axis; below that, 0 belongs to the picture.
        if high > 10 * low > 0:
            axes.set(yscale="log")
        else:
            axes.set(ylim=(0, 1.15 * high or 1.0))
    panels[2].set_xlabel(time_label(sheet.spec, m))
    sheet.name("bounds", color=GREY, lw=0.5)
    crossing_legend(sheet, motions)


def bounds(panels: Sequence[Axes], m: Motion) -> None:
    """Draw the bounds of T, G^2/2A_largest and G^2/2A_smallest, and those of G^2, its exponentials,
    if constant damping alone changes it."""
    look: Look = {"color": GREY, "lw": 0.5, "ls": "-"}
    for A in (min(m.inertia), max(m.inertia)):
        panels[0].plot(m.time, m["G2"] / (2 * A), **look)
    system = m.case.system
    # A fluid does not change G.
    terms = system.dissipation if isinstance(system, Body) else None
    alone = terms and {*system.equations.terms} <= {"damping", "kappa"} and terms.damping
    for rate in {min(alone), max(alone)} if alone else ():
        panels[1].plot(m.time, m["G2"][0] * np.exp(-2 * rate * (m.time - m.time[0])), **look)


MIN_ERROR = 1e-18
"""The value drawn for an error of 0 on a logarithmic scale."""


def draw_bench(trials: Group, path: Path) -> None:
    """Draw error against run time into a file, from trials over case, method and tolerance: a panel
    for each case and a line for each method."""
    with matplotlib.style.context(["default", STYLE_SHEET, {"svg.fonttype": "none"}]):
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
