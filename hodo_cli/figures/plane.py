"""Plane figures: series over time, one variable against another, quadrants, invariants."""

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Wedge

from .. import HodoError
from ..models.body import Body
from ..models.rigid_body import inertia_order, slope
from ..quantities import symbol
from ..results.motion import Motion, formula_values
from ..schema.spelling import unknown
from .between import Course, samples_in
from .look import (
    AXIS_LOOKS,
    COLUMN,
    CROSSING,
    END,
    GREY,
    PAGE,
    SEPARATRIX,
    Look,
    Sheet,
    axis_label,
    check_units,
    check_zoom,
    colour_legend,
    curves,
    looks,
    mark_legend,
    marks,
    time_label,
    unit,
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
    groups: dict[str, list[Drawn]] = {}
    for i, m in enumerate(motions):
        for j, name in enumerate(names):
            drawn = m, name, ways[j if by_case else i]
            groups.setdefault(m.name if by_case else name, []).append(drawn)
    for entry in spec["insets"]:
        if entry["panel"] not in groups:
            panel = entry["panel"]
            raise HodoError(f"insets: {unknown(f'panel {panel!r}', panel, groups)}")
    columns = sheet.columns(PAGE, min(spec["columns"], len(groups)))
    width, rows = COLUMN if columns == 1 else PAGE, math.ceil(len(groups) / columns)
    height = rows * max(0.62 * width / columns, 1.4) + 0.2
    shared: Look = {"sharex": True, "sharey": by_case}
    panels = sheet.panels(width, height, len(groups), columns, **shared)
    for axes, (group, curves_of) in zip(panels, groups.items(), strict=True):
        for m, name, look in curves_of:
            series_curve(sheet, axes, m, name, look)
        axes.margins(x=0.02, y=0.08)
        label_panel(sheet, axes, curves_of)
        for enlarged in (entry for entry in spec["insets"] if entry["panel"] == group):
            inset(sheet, axes, enlarged, curves_of)
    for axes in panels[-columns:]:
        axes.set_xlabel(time_label(spec, motions[0]))
    panels[0].set_xlim(*(spec["span"] or (min(m.time[0] for m in motions), None)))


def series_curve(sheet: Sheet, axes: Axes, m: Course, name: str, look: Look) -> None:
    """Draw a variable of a motion within the span of the figure, with its law and its marks."""
    spec, part = sheet.spec, samples_in(m, sheet.spec["span"])
    stored = samples_in(m.samples, spec["span"])
    is_single = part.stop - part.start == 1
    axes.plot(m.time[part], unbroken(m, name)[part], **look, marker="o" if is_single else "")
    time, values = m.samples.time[stored], m.samples[name][stored]
    sheet.record(m.label, time=time, **{name: values})
    if not np.isfinite(values).any():
        warnings.warn(f"{name} of {m.name} has no value at any sample: no curve", stacklevel=2)
    if law := spec["formula"].get(name):
        fitted = formula_values(m.samples, law)[stored]
        words = f"${symbol(name)}$ = {law}".replace("**", "^").replace("*", " · ")
        axes.plot(time, fitted, **FITTED, label=words)
        sheet.record(f"{m.label}, {law}", time=time, **{name: fitted})
    events(axes, m, name, spec)


def label_panel(sheet: Sheet, axes: Axes, drawn: Sequence[Drawn]) -> None:
    """Name what a panel of one case, or of one variable, shows."""
    spec, (m, variable, _) = sheet.spec, drawn[0]
    if spec["level"] is not None:
        axes.axhline(spec["level"], **SEPARATRIX)
    if spec["panels"] == "variable":
        check_units([m for m, *_ in drawn], variable)
        axes.set_ylabel(axis_label(m, variable))
        widen(axes)
        return
    axes.set_title(m.label)
    units = {unit(m, name) for m, name, _ in drawn}
    labels = [f"${symbol(name)}$" for _, name, _ in drawn]
    if len(units) > 1:
        labels = [axis_label(m, name) for m, name, _ in drawn]
    place = axes.get_subplotspec()
    if place and place.is_first_col():
        axes.set_ylabel(", ".join(labels) + (f" {units.pop()}" if len(units) == 1 else ""))


def unbroken(m: Motion, name: str) -> np.ndarray:
    """Values (n,) with a gap where a rotation vector of half a turn jumps to its opposite."""
    values = m[name].astype(float)
    if name.startswith("rotation."):
        jumps = np.linalg.norm(np.diff(m.vector("rotation"), axis=0), axis=1) > math.pi
        values[1:][jumps] = np.nan
    return values


def widen(axes: Axes) -> None:
    """Give constant quantities a scale on which they look constant, and say so: on the scale of
    their rounding they would look like noise."""
    known = np.concatenate([np.asarray(line.get_ydata(), float) for line in axes.lines])
    known = known[np.isfinite(known)]
    if known.size > 1 and np.ptp(known) <= 1e-9 * np.abs(known).max():
        half = 0.1 * np.abs(known).max() or 1.0
        axes.set_ylim(known.mean() - half, known.mean() + half)
        words = f"constant to {np.ptp(known):.1e}" if np.ptp(known) else "constant"
        place: Look = {"xycoords": "axes fraction", "ha": "right", "va": "top", "size": "small"}
        axes.annotate(words, (0.97, 0.95), **place)


def events(axes: Axes, m: Motion, name: str, spec: Mapping[str, Any]) -> None:
    """Mark the events of a motion on its curve, each with the value there, or with the time if that
    value is 0."""
    low, high = spec["span"] or (-math.inf, math.inf)
    for kind, when in m.events:
        if not low <= when <= high:
            continue
        value = float(np.interp(when, m.time, m[name]))
        axes.plot(when, value, **END, clip_on=False, zorder=5, label=kind.replace("_", " "))
        words = f"${symbol(name)}$ = {value:#.4g}"
        if abs(value) <= 1e-3 * np.nanmax(np.abs(m[name])):
            of = "" if m.units("time") == "1" else f" {m.units('time')}"
            words = f"${symbol(name)}$ = 0 at ${spec['time']}$ = {when:#.4g}{of}"
        Words(axes, words, [(when, value)], toward=(-0.5, 1), size="small")


def inset(sheet: Sheet, panel: Axes, spec: Mapping[str, Any], drawn: Sequence[Drawn]) -> None:
    """Draw a part of a panel's curves enlarged within the panel."""
    axes, shown = panel.inset_axes(spec["box"]), []
    for m, name, look in drawn:
        if m.name == spec["case"] and name in spec["variables"]:
            part, stored = samples_in(m, spec["span"]), samples_in(m.samples, spec["span"])
            axes.plot(m.time[part], m[name][part], **look | {"lw": 0.9})
            sheet.record(m.name, time=m.samples.time[stored], **{name: m.samples[name][stored]})
            shown.append(f"${symbol(name)}$" + f", {m.label}" * (m.label != panel.get_title()))
    if not shown:
        raise HodoError(f"insets: panel {spec['panel']} draws none of {spec['variables']}")
    axes.set_title("; ".join(shown), size="small", pad=2)
    axes.tick_params(labelsize="x-small")
    axes.margins(x=0)


def phase(sheet: Sheet, motions: Sequence[Course]) -> None:
    """One variable against another."""
    spec, x, y = sheet.spec, sheet.spec["x"], sheet.spec["y"]
    (axes,) = sheet.panels(COLUMN, 0.9 * COLUMN)
    for name in (x, y):
        check_units(motions, name)
    for m, look in zip(motions, looks(len(motions), spec["styles"]), strict=True):
        points = np.stack([m[x], m[y]], axis=-1)
        axes.plot(*points.T, **look, label=m.label if len(motions) > 1 else "")
        marks(axes, points, m.at(m.crossing_time, points))
        sheet.record(m.label, time=m.samples.time, **{x: m.samples[x], y: m.samples[y]})
    axes.margins(0.06)
    axes.set(xlabel=axis_label(motions[0], x), ylabel=axis_label(motions[0], y))
    vectors = {"omega" if name in "pqr" else name.rpartition(".")[0] for name in (x, y)}
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
    largest, _, smallest = motions[0].order
    p, r = "pqr"[largest], "pqr"[smallest]
    for m in motions:
        sheet.record_vector(m, m.samples.quadrants, (f"{p}^2", f"K {r}^2"))
    whole, zoom = (
        [1.05 * max(float(m.quadrants.max()) for m in (*motions, *sheet.others)) or 1.0],
        spec["zoom"],
    )
    limits = whole + ([zoom] if zoom is not None else [])
    if zoom is not None:
        check_zoom(zoom, min(float(curve.max(axis=1).min()) for curve in points))
    columns = sheet.columns(PAGE, len(limits))
    if columns == 1:
        panels = sheet.panels(COLUMN, 1.05 * COLUMN * len(limits), len(limits))
    else:
        panels = sheet.panels(PAGE, 0.62 * PAGE, 2, 2, width_ratios=[1, 1.8])
    for axes, limit in zip(panels, limits, strict=True):
        regions(axes, motions[0], limit, is_small=columns > 1 and axes is panels[0])
        curves(axes, motions, spec, points, limit)
        axes.set(xlim=(0, limit), ylim=(0, limit), aspect="equal")
        of_omega = unit(motions[0], "omega", 2)
        axes.set(xlabel=f"${p}^2$ {of_omega}", ylabel=f"$K{r}^2$ {of_omega}")
    if zoom is not None:
        panels[0].set(anchor="N")
        panels[1].set_title("enlarged")
    colour_legend(sheet, panels, motions)
    mark_legend(sheet, motions)


def regions(axes: Axes, m: Motion, limit: float, is_small: bool) -> None:
    """Shade and name the regions A and B below and above the diagonal."""
    axes.plot([0, limit], [0, limit], color="black", lw=0.7, ls="-")
    places = limit * np.array([(0.97, 0.06), (0.8, 0.06), (0.9, 0.3), (0.7, 0.2), (0.95, 0.6)])
    areas = [("A", m.order[0], (limit, 0), places), ("B", m.order[2], (0, limit), places[:, ::-1])]
    # Without K no point is above the diagonal: a body with two smallest moments has no region B.
    for name, axis, corner, at in areas if slope(m.inertia) else areas[:1]:
        triangle: Any = [(0, 0), (limit, limit), corner]
        axes.add_patch(Polygon(triangle, fc=AXIS_LOOKS[axis + 1][0], alpha=0.1, lw=0))
        words = name if is_small else f"{name} (about $x_{axis + 1}$)"
        Words(axes, words, [*at, *(0.75 * at), *(0.5 * at)], beside=False)


def quadrant_sketch(sheet: Sheet, motions: Sequence[Course]) -> None:
    """r^2 against p^2 for each body, with the line p^2 = K r^2, A below it and B above, without
    scale."""
    bodies, labels = sheet.spec["bodies"], sheet.spec["labels"]
    columns = sheet.columns(PAGE, len(bodies))
    width = COLUMN if columns == 1 else PAGE
    height = math.ceil(len(bodies) / columns) * (width / columns + 0.5)
    panels = sheet.panels(width, height, len(bodies), columns)
    titles = [*labels[: len(bodies)], *[""] * (len(bodies) - len(labels))]
    for axes, A, label in zip(panels, bodies, titles, strict=True):
        K, (largest, _, smallest) = slope(A), inertia_order(A)
        title = label or "$A_i$ = {:g}, {:g}, {:g}".format(*A)
        numbers = np.array([*A, K])[:, None]
        sheet.record(title, **dict(zip(("A1", "A2", "A3", "K"), numbers, strict=True)))
        # The angle of the line above the horizontal axis, on which p^2 = K r^2 grows.
        angle = math.degrees(math.atan2(1, K))
        for name, axis, low, high in (("A", largest, 0.0, angle), ("B", smallest, angle, 90.0)):
            axes.add_patch(
                Wedge((0, 0), 2, low, high, fc=AXIS_LOOKS[axis + 1][0], alpha=0.12, lw=0)
            )
            if high - low > 1:
                middle = math.radians((low + high) / 2)
                at = np.array([math.cos(middle), math.sin(middle)])
                words = f"{name}\nabout $x_{axis + 1}$" if high - low > 25 else name
                Words(axes, words, [0.6 * at, 0.75 * at, 0.45 * at], beside=False)
        line = math.radians(angle)
        axes.plot([0, 2 * math.cos(line)], [0, 2 * math.sin(line)], "k-", lw=1.4)
        axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xticks=[], yticks=[])
        value = r"$\infty$" if math.isinf(K) else f"{K:.3g}"
        axes.set_title(f"{title}\n$K$ = {value}")
        axes.set_xlabel(f"${'pqr'[largest]}^2$", loc="right")
        axes.set_ylabel(f"${'pqr'[smallest]}^2$", loc="top", rotation=0)
        axes.spines[["top", "right"]].set_visible(False)


def invariants(sheet: Sheet, motions: Sequence[Course]) -> None:
    """T, G^2 and D/2T against time, with the bounds that the body and its damping set."""
    names, m = ("T", "G2", "D/2T"), motions[0]
    panels = sheet.panels(COLUMN, 1.75 * COLUMN, 3, sharex=True)
    for m, look in zip(motions, looks(len(motions), sheet.spec["styles"]), strict=True):
        for axes, name in zip(panels, names, strict=True):
            label, mark = m.label if len(motions) > 1 else "", "o" if len(m.time) == 1 else ""
            axes.plot(m.time, m[name], **look, marker=mark, zorder=3, label=label)
        columns = {name: m.samples[name] for name in (*names, "D")}
        sheet.record(m.label, time=m.samples.time, **columns)
        bounds(panels, m)
        panels[2].plot(m.crossing_time, 0 * m.crossing_time, **CROSSING, zorder=4)
    ends = m.inertia - sorted(m.inertia)[1]
    for i in (i for i in (m.order[0], m.order[2]) if ends[i]):
        panels[2].axhspan(*sorted((0, ends[i])), fc=AXIS_LOOKS[i + 1][0], alpha=0.1, lw=0)
        times = np.linspace(m.time[0], m.time[-1], 11)[1:-1]
        places = np.stack([times, np.full(9, 0.8 * ends[i])], axis=-1)
        Words(panels[2], f"about $x_{i + 1}$", places, beside=False)
    panels[2].axhline(0, **SEPARATRIX)
    for axes, name in zip(panels, names, strict=True):
        check_units(motions, name)
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
    sheet.handles.append(Line2D([], [], color=GREY, lw=0.5, label="bounds"))
    n = len(sheet.handles)
    mark_legend(sheet, motions)
    del sheet.handles[n : n + 2]  # no start and no end are marked


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
