"""Plane figures: quadrants, series over time, one variable against another, invariants."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import zip_longest
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Wedge

from ... import HodoError
from ...cases.derived import SPACE_AXES
from ...engines.protocol import EPS
from ...models.rigid_body import inertia_order, slope
from ...models.terms.body import BodyUnderTorques
from ...results.motion import OF_ATTITUDE, Motion, formula_values, is_of_time
from ...results.resolution import gap_remark, samples_within
from ...storage import Variable
from ...text import magnitude
from ..artists import (
    AXIS_COLOUR,
    BLACK,
    CROSSING,
    END,
    GREY,
    LAW_LOOK,
    SEPARATRIX,
    axis_handles,
    check_zoom,
    crossings_on,
    labelled_styles,
    mark_handles,
    mark_points,
    number_marks,
    plane_curves,
    room_across,
    styles,
)
from ..sheet import COLUMN, PAGE, Look, Sheet
from ..symbols import axis_label, formula_in_tex, symbol, time_label, unit, unit_after
from ..words import AreaName, Words, in_formula, text_lines, text_size, text_width


def check_one_body(motions: Sequence[Motion]) -> None:
    """Raise HodoError if the motions of a figure of one body's regions are of two bodies."""
    first = motions[0]
    if other := next((motion for motion in motions if motion.body != first.body), None):
        names = f"{first.name} and {other.name}"
        raise HodoError(f"{names} are motions of two bodies, each of which has its own regions")


def quadrants(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """p^2 against K r^2, with the regions A (D > 0) and B (D < 0)."""
    check_one_body(motions)
    curves, zoom = [motion.quadrants for motion in motions], spec["zoom"]
    for motion, curve in zip(motions, curves, strict=True):
        p, r = "pqr"[motion.order[0]], "pqr"[motion.order[2]]
        sheet.record_path(motion, (f"{p}^2", f"K {r}^2"), curve)
    # They lie on the diagonal; interpolation between samples may leave it a little.
    crossings = [
        np.repeat(crossed.mean(axis=-1, keepdims=True), 2, axis=-1)
        for crossed in crossings_on(motions, curves)
    ]
    scaled_with = [motion.quadrants for motion in sheet.others]
    limits = [1.05 * max(float(curve.max()) for curve in [*curves, *scaled_with]) or 1.0]
    if zoom is not None:
        nearest = min(float(curve.max(axis=1).min()) for curve in curves)
        check_zoom(zoom, nearest, unit(motions[0], "omega", 2))
        limits.append(zoom)
    columns = sheet.columns(PAGE, len(limits))
    width = COLUMN if columns == 1 else PAGE
    lines = len(limits) // columns
    panels = sheet.panels(width, 1.1 * lines * width / columns, len(limits), columns)
    style: Look = spec["style"]
    given = [end for name in ("xlim", "ylim") for end in style.get(name, ())]
    for axes, limit in zip(panels, limits, strict=True):
        regions(axes, motions[0], limit, max([limit, *given]), axes is not panels[0], style)
        frame = np.array([[0, limit], [0, limit]])
        plane_curves(axes, spec, motions, curves, crossings, frame)
    sheet.legend += axis_handles(motions)
    # Grey, since the colours of curves are those of the axes.
    looks = labelled_styles([motion.label for motion in motions])
    sheet.legend += [Line2D([], [], **{**look, "color": GREY}) for look in looks]
    sheet.legend += mark_handles(motions, spec["time"], wide=sheet.is_wide and zoom is not None)


def regions(
    axes: Axes, motion: Motion, limit: float, end: float, is_enlarged: bool, style: Look
) -> None:
    """The regions A and B below and above the diagonal, shaded up to an end, and named up to the
    limit of the panel, beyond which its style may set ends."""
    # In a narrow panel, or an enlarged one, whose curves lie wide apart, a letter finds its place.
    width = text_width("A (about $x_1$)", text_size("font.size"))
    is_short = is_enlarged or width > 0.5 * room_across(axes)
    parts = np.geomspace(1e-16, 1, 33) if "log" in style else np.linspace(0, 1, 12)
    places = np.stack(np.meshgrid(*2 * [limit * parts]), axis=-1).reshape(-1, 2)
    below = places[:, 0] - places[:, 1]
    farthest = np.argsort(-np.abs(below), kind="stable")
    largest, _, smallest = motion.order
    areas = ("A", largest, (end, 0), 1), ("B", smallest, (0, end), -1)
    # Without K no point is above the diagonal: a body with two smallest moments has no region B.
    for name, axis, corner, side in areas if slope(motion.inertia) else areas[:1]:
        triangle = [(0, 0), (end, end), corner]
        axes.add_patch(Polygon(triangle, fc=AXIS_COLOUR[axis + 1], alpha=0.1, lw=0))
        words = name if is_short else f"{name} (about $x_{axis + 1}$)"
        own = farthest[side * below[farthest] > 0]
        Words(axes, words, places[own], inside=partial(is_beside_diagonal, side), size="medium")
    axes.plot([0, end], [0, end], color=BLACK, lw=0.7)
    p, r = "pqr"[largest], "pqr"[smallest]
    axes.set(
        xlabel=f"${p}^2$ {unit(motion, 'omega', 2)}",
        ylabel=f"$K{r}^2$ {unit(motion, 'omega', 2)}",
        xlim=(0, limit),
        ylim=(0, limit),
        aspect="equal",
    )
    if is_enlarged:
        axes.set(title="enlarged")
        # Its small values are long words, for which there is little room side by side.
        axes.locator_params(nbins=max(2, min(5, int(room_across(axes) / 25))))


def is_beside_diagonal(side: int, places: np.ndarray) -> np.ndarray:
    """Whether places (..., 2) are below the diagonal, where the side is 1, or above it, where it is
    -1."""
    return np.asarray(side * (places[..., 0] - places[..., 1]) > 0)


def quadrant_sketch(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """r^2 against p^2 for each body, with the line p^2 = K r^2, region A below it and B above,
    without scale."""
    bodies = spec["bodies"]
    n = len(bodies)
    columns = sheet.columns(PAGE, n)
    size = (COLUMN, COLUMN) if columns == 1 else (PAGE, PAGE / columns + 0.35)
    panels = sheet.panels(size[0], math.ceil(n / columns) * size[1], n, columns)
    for axes, body, label in zip_longest(panels, bodies, spec["labels"][:n]):
        title, K = label or "$A_i$ = {:g}, {:g}, {:g}".format(*body), slope(body)
        numbers = np.array([*body, K])[:, None]
        sheet.record(title, dict(zip(("A1", "A2", "A3", "K"), numbers, strict=True)))
        sketch(axes, body)
        value = r"\infty" if math.isinf(K) else in_formula(f"{K:.3g}")
        axes.set_title(f"{title}\n$K = {value}$")


def sketch(axes: Axes, body: Sequence[float]) -> None:
    """The quadrants of one body."""
    largest, _, smallest = inertia_order(body)
    # The angle of the line above the horizontal axis, on which p^2 = K r^2 grows.
    angle = math.degrees(math.atan2(1, slope(body)))
    for name, axis, low, high in (("A", largest, 0, angle), ("B", smallest, angle, 90)):
        axes.add_patch(Wedge((0, 0), 2, low, high, fc=AXIS_COLOUR[axis + 1], alpha=0.12, lw=0))
        if low < high:
            # In a narrow region, beyond which they would lie, the letter alone, or nothing.
            texts = f"{name}\nabout $x_{axis + 1}$", name
            middle = np.array(at_angle((low + high) / 2, 0.6))
            AreaName(axes, texts, middle, partial(is_between_angles, low, high))
    axes.plot(*np.transpose([(0, 0), at_angle(angle, 2)]), color=BLACK, lw=1.4)
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xticks=[], yticks=[])
    axes.set_xlabel(f"${'pqr'[largest]}^2$", loc="right")
    axes.set_ylabel(f"${'pqr'[smallest]}^2$", loc="top", rotation=0)
    axes.spines[["top", "right"]].set_visible(False)


def is_between_angles(low: float, high: float, places: np.ndarray) -> np.ndarray:
    """Whether places (..., 2) are above the horizontal axis by angles between two, in degrees."""
    angles = np.degrees(np.arctan2(places[..., 1], places[..., 0]))
    return np.asarray((low < angles) & (angles < high))


def at_angle(angle: float, distance: float) -> tuple[float, float]:
    """The point at an angle in degrees above the horizontal axis, as far from the origin."""
    return distance * math.cos(math.radians(angle)), distance * math.sin(math.radians(angle))


def time_series(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """Variables against time, a panel for each variable or for each case."""
    variables = spec["variables"]
    # In panels of variables the styles tell cases apart, in panels of cases variables.
    if spec["panels"] == "case":
        groups = {motion.name: [(motion, name) for name in variables] for motion in motions}
        keys, names, style_names = variables, [f"${symbol(name)}$" for name in variables], ()
    else:
        groups = {name: [(motion, name) for motion in motions] for name in variables}
        keys, names = [motion.name for motion in motions], [motion.label for motion in motions]
        style_names = spec["styles"]
    looks = labelled_styles(names, style_names, even_one=bool(spec["formula"]))
    panels = series_panels(sheet, spec, len(groups), time_label(spec, motions[0]))
    for axes, (group, curves) in zip(panels, groups.items(), strict=True):
        for (motion, name), style in zip(curves, looks, strict=True):
            series_curve(sheet, axes, spec, motion, name, style)
        for name, law in spec["formula"].items():
            draw_law(axes, law, [motion for motion, drawn in curves if drawn == name], spec["span"])
        axes.margins(x=0.02, y=0.08)
        label_panel(axes, spec, curves)
        if spec["level"] is not None:
            axes.axhline(spec["level"], **SEPARATRIX)
        for enlarged in (enlarged for enlarged in spec["insets"] if enlarged["panel"] == group):
            motion = next(motion for motion in motions if motion.name == enlarged["case"])
            inset(sheet, axes, enlarged, motion, dict(zip(keys, looks, strict=True)))
    # Panels share their time: its end is known when all are drawn.
    panels[0].set_xlim(*(spec["span"] or (min(motion.time[0] for motion in motions), None)))
    sheet.legend += passage_handles(motions) if spec["passages"] else []
    laws = (
        f"${symbol(name)} = {formula_in_tex(law, spec['time'])}$"
        for name, law in spec["formula"].items()
    )
    sheet.legend += [Line2D([], [], **LAW_LOOK, label=words) for words in laws]


def label_panel(axes: Axes, spec: Mapping[str, Any], curves: Sequence[tuple[Motion, str]]) -> None:
    """Name what a panel of one case, or of one variable, shows, and mark the events in it."""
    motion, variable = curves[0]
    if spec["panels"] == "case":
        names = [name for _, name in curves]
        axes.set_title(motion.label)
        # They share the vertical axis: one label on the left.
        if axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]
            labels = [axis_label(name, motion) for name in names]
            if len({unit(motion, name) for name in names}) == 1:  # else each has its own
                labels[:-1] = [f"${symbol(name)}$" for name in names[:-1]]
            axes.set_ylabel(", ".join(labels))
        marked = [(motion, names)]
    else:
        axes.set_ylabel(axis_label(variable, motion))
        values = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines]
        say_in_corner(axes, widen_constant(axes, "y", values, curves))
        gaps = [gap_remark(x, name, samples_within(x, spec["span"])) for x, name in curves]
        if all(gaps) and variable not in spec["formula"]:
            say_why_empty(axes, gaps, yticks=[])
        marked = [(drawn, [variable]) for drawn, _ in curves]
    if not spec["passages"]:
        for drawn, together in marked:
            event_marks(axes, drawn, together, spec)


CONSTANT_WITHIN = 1000
"""A quantity that changes by less than so many times the stated error of its motion is constant for
the eye: it is computed from several values with such errors, which grow along a motion."""

LARGEST_ROUNDING = 1e-6
"""The largest change, as a part of the size, that counts as rounding: a larger one is seen, and a
motion that has died down may state an error of any size."""


FEW_SAMPLES = 30
"""Samples at fewer of which a quantity may be equal that changes between them."""


def widen_constant(
    axes: Axes, letter: str, drawn: Sequence[np.ndarray], curves: Sequence[tuple[Motion, str]]
) -> str:
    """Give constant quantities, drawn as values (n,) along an axis, a scale on which they look so:
    on that of their rounding errors they would look like noise. Returns words that say it, or an
    empty text."""
    known = [values for line in drawn if (values := line[np.isfinite(line)]).size]
    values = np.concatenate([[], *known])
    size = max(motion.largest(name) for motion, name in curves)
    # A motion whose error is not measured has some rounding.
    error = max(np.fmax(motion.attrs.get("error", 0.0), EPS) for motion, _ in curves)
    smallest_change = min(CONSTANT_WITHIN * error, LARGEST_ROUNDING) * size
    if not len(values) or np.ptp(values) > smallest_change:
        return ""
    middle, half = values.mean(), 0.1 * size or 1.0
    axes.set(**{f"{letter}lim": (middle - half, middle + half)})
    words = f"constant to {magnitude(np.ptp(values))}" if np.ptp(values) else "constant"
    fewest = min(map(len, known))
    if fewest == 1:
        return ""
    return f"{words} at {fewest} samples" if fewest < FEW_SAMPLES else words


def say_in_corner(axes: Axes, words: str) -> None:
    """Put words, if there are any, into the upper right corner of a panel."""
    place: Look = {"xycoords": "axes fraction", "ha": "right", "va": "top"}
    if words:
        axes.annotate(words, (0.97, 0.95), **place, size="small")


def say_why_empty(axes: Axes, gaps: Sequence[str], **ticks: Any) -> None:
    """Say in a panel without a curve why it has none, instead of the ticks of a scale of
    nothing."""
    size = text_size("legend.fontsize")
    lines = text_lines("; ".join(dict.fromkeys(gaps)), 0.9 / 72 * room_across(axes), size)
    place: Look = {"xycoords": "axes fraction", "ha": "center", "va": "center"}
    axes.annotate("\n".join(lines), (0.5, 0.5), **place, size=size)
    axes.set(**ticks)


def series_curve(
    sheet: Sheet,
    axes: Axes,
    spec: Mapping[str, Any],
    motion: Motion,
    variable: str,
    style: Mapping[str, Any],
) -> None:
    """A variable of a motion over its time or the span of the figure, with its marks."""
    samples = within_span(motion, spec["span"])
    times, values = motion.time[samples], motion[variable][samples]
    sheet.record(motion.label, {"time": times, variable: values})
    draw_line(axes, *line_through(motion, ("time", variable), samples), **style)
    if law := spec["formula"].get(variable):
        values = formula_values(motion, law)[samples]
        sheet.record(f"{motion.label}, {law}", {"time": times, variable: values})
    if spec["passages"]:
        passage_marks(axes, motion, variable, style)


def draw_line(axes: Axes, x: np.ndarray, y: np.ndarray, **style: Any) -> None:
    """A line through samples (n,), or the mark of a single one, through which no line goes."""
    alone = len(x) == 1
    # The mark is whole, too, where its panel begins.
    axes.plot(x, y, marker="o" if alone else "", clip_on=not alone, ms=3, **style)


def line_through(
    motion: Motion, names: Sequence[str], samples: slice = slice(None)
) -> list[np.ndarray]:
    """Quantities (n,) at some samples of a motion, as a line goes through them: with a gap where a
    rotation vector, half a turn long there, goes on from its other end."""
    columns = [motion[name][samples] for name in names]
    if not any(name.startswith("rotation.") for name in names):
        return columns
    vector = np.stack([motion[f"rotation.{axis}"][samples] for axis in SPACE_AXES], axis=-1)
    steps = np.diff(vector, axis=0)
    jumps = np.flatnonzero(np.hypot.reduce(steps, axis=1) > math.pi) + 1
    return [np.insert(column.astype(float), jumps, np.nan) for column in columns]


PLACES_OF_LAW = 1001
"""Times between the ends of a panel at which a law is known besides those of its samples: it is
smooth where there are none."""


def draw_law(
    axes: Axes, law: str, motions: Sequence[Motion], span: tuple[float, float] | None
) -> None:
    """Draw a law of motions in a panel: one of the time alone once, since the dashes of one line
    would fill the gaps of another, and the curve would be hidden."""
    if motions and is_of_time(law):
        times = [motion.time[within_span(motion, span)] for motion in motions]
        ends = min(t[0] for t in times), max(t[-1] for t in times)
        places = np.unique(np.concatenate([*times, np.linspace(*ends, PLACES_OF_LAW)]))
        motions = [Motion(motions[0].case, {"time": Variable(("time",), places)})]
    for motion in motions:
        samples = within_span(motion, span)
        axes.plot(motion.time[samples], formula_values(motion, law)[samples], **LAW_LOOK)


def within_span(motion: Motion, span: tuple[float, float] | None) -> slice:
    """The samples of a motion within a span of time; all without one.

    Raises HodoError if there is none.
    """
    samples = samples_within(motion, span)
    if span is not None and samples.start >= samples.stop:
        raise HodoError(
            f"the span {span[0]:g} to {span[1]:g} holds no sample of {motion.words}, "
            f"whose time goes from {motion.time[0]:g} to {motion.time[-1]:g}"
        )
    return samples


def series_panels(sheet: Sheet, spec: Mapping[str, Any], n: int, label: str) -> list[Axes]:
    """n panels in rows of `columns`, with a label below the lowest of each column; panels of cases
    share both scales."""
    columns = sheet.columns(PAGE, min(n, spec["columns"]))
    rows = math.ceil(n / columns)
    width = sheet.width or (COLUMN if columns == 1 else PAGE)
    height = rows * max(0.62 * width / columns, 1.4) + 0.3
    panels = sheet.panels(width, height, n, columns, sharex=True, sharey=spec["panels"] == "case")
    for axes in panels[-columns:]:
        axes.set_xlabel(label)
    return panels


OF_D = ("D", "D/2T", "separatrix_distance")
"""The quantities that are 0 on the separatrix."""


def at_event(motion: Motion, name: str, kind: str, when: float) -> float:
    """A quantity of a motion at an event: what the event says of it, as a line between samples goes
    past a kink; else interpolated."""
    values, after = motion[name], int(np.searchsorted(motion.time, when))
    if kind == "stopped" and name not in OF_ATTITUDE and after < len(values):
        return float(values[after])  # omega does not change any more
    if kind == "separatrix":
        known = dict.fromkeys(OF_D, 0.0) | {"J": float(sorted(motion.inertia)[1]), "k2": 1.0}
        if name in known:
            return known[name]
    return float(np.interp(when, motion.time, values))


def passage_marks(axes: Axes, motion: Motion, name: str, style: Mapping[str, Any]) -> None:
    """Mark the crossings of a motion on a curve."""
    when = motion.crossing_time
    crossed = [at_event(motion, name, "separatrix", time) for time in when]
    axes.plot(when, crossed, **{**CROSSING, "mfc": style["color"]}, zorder=5)


def passage_handles(motions: Sequence[Motion]) -> list[Line2D]:
    """Legend entries of the marks of `passage_marks` that there are."""
    crossed = [m.crossing_time for m in motions]
    marks = (("crossing of each curve, $D = 0$", CROSSING | {"mfc": "white"}, crossed),)
    return [
        Line2D([], [], **look, label=label)
        for label, look, times in marks
        if any(np.isfinite(when).any() for when in times)
    ]


def event_marks(axes: Axes, motion: Motion, names: Sequence[str], spec: Mapping[str, Any]) -> None:
    """Mark the events of a motion on its curves in a panel, with words."""
    first, last = spec["span"] or (motion.time[0], motion.time[-1])
    for kind, when in ((kind, when) for kind, when in motion.events if first <= when <= last):
        there = ((name, at_event(motion, name, kind, when)) for name in names)
        # A direction of G, say, is none from the stop on.
        if not (values := {name: value for name, value in there if math.isfinite(value)}):
            continue
        places = values
        if kind == "stopped":  # on the line to rest, since 0 has no place on a logarithmic axis
            places = {name: np.interp(when, motion.time, motion[name]) for name in values}
        # One colour, or the legend would have the marks of each case.
        marks: Look = {**END, "color": BLACK, "clip_on": False, "zorder": 5}
        marks |= {"marker": CROSSING["marker"]} if kind == "separatrix" else {}
        axes.plot([when] * len(places), [*places.values()], **marks, label=kind.replace("_", " "))
        for name, words in words_at_event(motion, when, values, spec["time"]).items():
            lines = text_lines(words, 0.6 / 72 * room_across(axes), text_size("legend.fontsize"))
            # Behind the curve's end, which no curve of the same shape passes.
            point = np.array([[when, places[name]]])
            Words(axes, "\n".join(lines), point, toward=(1, 1), size="small")


def words_at_event(
    motion: Motion, when: float, values: Mapping[str, float], time: str
) -> dict[str, str]:
    """The words beside the curves of a motion at an event, by variable: its value there, or the
    time, once for all that are nearly zero."""
    vanishing = [x for x in values if abs(values[x]) <= 1e-3 * np.nanmax(np.abs(motion[x]))]
    zero = " = ".join([*map(symbol, vanishing), "0"])
    when_zero = in_formula(f"{when:#.4g}")
    at_time = f"${zero}$ at ${time} = {when_zero}${unit_after(motion, 'time')}"
    others = (name for name in values if name not in vanishing)
    words = {name: f"${symbol(name)} = {in_formula(f'{values[name]:#.4g}')}$" for name in others}
    return words | dict.fromkeys(vanishing[:1], at_time)


def inset(
    sheet: Sheet,
    panel: Axes,
    spec: Mapping[str, Any],
    motion: Motion,
    looks: Mapping[str, dict[str, Any]],
) -> None:
    """A smaller panel within a panel: some variables of one case, over a part of its time."""
    axes = panel.inset_axes(spec["box"])
    samples = within_span(motion, spec["span"])
    for name, look in zip(spec["variables"], styles(len(spec["variables"])), strict=True):
        # As the panel draws the variable or, where all its curves are of one variable, the case.
        drawn = looks.get(name, looks.get(motion.name, look))
        times, values = motion.time[samples], motion[name][samples]
        draw_line(axes, *line_through(motion, ("time", name), samples), **drawn, lw=0.9)
        sheet.record(motion.name, {"time": times, name: values})
    words = [f"${symbol(name)}$" for name in spec["variables"]]
    if panel.get_title() != motion.label:
        words.append(motion.label)
    axes.set_title(", ".join(words), size="small", pad=2)
    axes.tick_params(labelsize="x-small")
    axes.margins(x=0)


def phase(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """One variable against another."""
    x, y = spec["x"], spec["y"]
    (axes,) = sheet.panels(COLUMN, 0.9 * COLUMN)
    curves = [np.stack([motion[x], motion[y]], axis=-1) for motion in motions]
    looks = labelled_styles([motion.label for motion in motions], spec["styles"])
    for motion, curve, look in zip(motions, curves, looks, strict=True):
        sheet.record_path(motion, (x, y), curve)
        axes.plot(*line_through(motion, (x, y)), **look)
    mark_points(axes, curves, crossings_on(motions, curves))
    axes.margins(0.06)
    remarks = []
    for letter, name, column in (("x", x, 0), ("y", y, 1)):
        label = time_label(spec, motions[0]) if name == "time" else axis_label(name, motions[0])
        axes.set(**{f"{letter}label": label})
        of_name = [(motion, name) for motion in motions]
        if words := widen_constant(axes, letter, [curve[:, column] for curve in curves], of_name):
            remarks.append(f"${symbol(name)}$ {words}")
    say_in_corner(axes, "\n".join(remarks))
    everything = slice(None)
    gaps = [gap_remark(m, x, everything) or gap_remark(m, y, everything) for m in motions]
    if all(gaps):
        say_why_empty(axes, gaps, xticks=[], yticks=[])
    if vector_of(x) == vector_of(y) != "":
        if not axes.get_autoscale_on():
            # Equal scales need one that may grow beyond the ends of a constant component.
            axes.update_datalim(np.transpose([axes.get_xlim(), axes.get_ylim()]))
            axes.set_autoscale_on(True)
        axes.set(aspect="equal", adjustable="datalim")
    sheet.legend += mark_handles(motions, spec["time"])


def vector_of(variable: str) -> str:
    """The vector that a variable is a component of; an empty string if it is none."""
    return "omega" if variable in ("p", "q", "r") else variable.rpartition(".")[0]


def invariants(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """T, G^2 and D/2T against time, with the bounds that the body sets and, for diagonal damping,
    the bounds of G^2."""
    check_one_body(motions)
    energy, square, ratio = sheet.panels(COLUMN, 1.75 * COLUMN, 3, sharex=True)
    shade_sides(ratio, motions[0])
    looks = labelled_styles([motion.label for motion in motions], spec["styles"])
    for motion, style in zip(motions, looks, strict=True):
        shown = {name: motion[name] for name in ("T", "G2", "D/2T")}
        sheet.record(motion.label, {"time": motion.time, **shown, "D": motion["D"]})
        for axes, values in zip((energy, square, ratio), shown.values(), strict=True):
            draw_line(axes, motion.time, values, **style, zorder=3)
        energy_bounds(energy, square, motion)
        crossed = np.stack([motion.crossing_time, 0 * motion.crossing_time], axis=-1)
        number_marks(ratio, [crossed])
        ratio.plot(*crossed.T, **CROSSING, zorder=4)
    ratio.axhline(0, **SEPARATRIX)
    for axes, name in ((energy, "T"), (square, "G2"), (ratio, "D/2T")):
        axes.set(ylabel=axis_label(name, motions[0]))
        axes.margins(x=0)
    for axes in (energy, square):
        values = np.concatenate([np.asarray(line.get_ydata(), dtype=float) for line in axes.lines])
        low, high = np.nanmin(values), np.nanmax(values)
        # More than a decade is unreadable on a linear axis; below that, 0 belongs to the picture.
        if high > 10 * low > 0:
            axes.set_yscale("log")
        else:
            axes.set_ylim(0, 1.15 * high or 1.0)
    ratio.set_xlabel(time_label(spec, motions[0]))
    sheet.legend.append(Line2D([], [], color=GREY, lw=0.5, label="bounds"))
    sheet.legend += mark_handles(motions, spec["time"])[2:]


def shade_sides(axes: Axes, motion: Motion) -> None:
    """Shade and name the two sides of the separatrix in a panel of D/2T; a body with two equal
    moments has one, or none."""
    ends = motion.inertia - sorted(motion.inertia)[1]
    for axis in (i for i in (motion.order[0], motion.order[2]) if ends[i]):
        end = ends[axis]
        axes.axhspan(*sorted((0, end)), fc=AXIS_COLOUR[axis + 1], alpha=0.1, lw=0)
        places = np.linspace(motion.time[0], motion.time[-1], 40)
        edge = np.stack([places, np.full(40, end)], axis=-1)
        Words(axes, f"about $x_{axis + 1}$", edge, toward=(0, -1 if end > 0 else 1))


def energy_bounds(energy: Axes, square: Axes, motion: Motion) -> None:
    """T between G^2/2A_largest and G^2/2A_smallest; G^2 between its exponentials where constant
    damping alone changes it."""
    G2, system = motion["G2"], motion.case.system
    for A in (min(motion.inertia), max(motion.inertia)):
        energy.plot(motion.time, G2 / (2 * A), color=GREY, lw=0.5)
    # Fluid does not change G.
    damping = isinstance(system, BodyUnderTorques) and system.constant_damping("kappa")
    for rate in {min(damping), max(damping)} if damping else ():
        bound = G2[0] * np.exp(-2 * rate * (motion.time - motion.time[0]))
        square.plot(motion.time, bound, color=GREY, lw=0.5)
