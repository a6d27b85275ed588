"""Colours, marks and legend entries that several kinds of figures share."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle, islice
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colorbar import Colorbar
from matplotlib.colors import ListedColormap, Normalize, to_rgb
from matplotlib.lines import Line2D

from .. import HodoError
from ..cases.figure_block import COLOUR_NAMES, LINE_NAMES
from ..results.motion import Motion
from ..text import abridged, time_digits
from .sheet import Look, Sheet
from .symbols import time_label, unit_after
from .words import CrossingNumber, Words, in_formula, text_lines, text_size, with_minus, without_tex

BLUE, ORANGE, GREEN, SKY, RED, PURPLE, BLACK = (
    "#0072B2", "#BF8200", "#009E73", "#2E8FCB", "#D55E00", "#CC79A7", "#000000")  # fmt: skip
"""The palette of Okabe and Ito, legible to the colour-blind; its orange and sky are darker here, so
that every curve has a contrast of at least 3 to 1 on white."""

YELLOW = "#F0E442"
"""The palette's own, too pale for a curve: it fills marks."""

GREY, PALE_GREY = "#666666", "#8A8A8A"

NOT_CLASSIFIED = -2
"""Stands for the label of a motion that has none yet."""

AXIS_COLOUR = {
    **{1: BLUE, 2: GREEN, 3: ORANGE, 4: PURPLE, 5: RED, 0: "#555555", -1: PALE_GREY},
    NOT_CLASSIFIED: BLACK,
}

# All differ in line too, so that they are told apart in grey print; a legend shows whole dashes.
CYCLE = (
    (BLUE, "-"),
    (RED, (0, (5, 1.5))),
    (GREEN, (0, (5, 1.5, 1, 1.5))),
    (PURPLE, (0, (1, 1))),
    (ORANGE, (0, (8.25, 1.5))),
    (SKY, (0, (2.7, 1.1))),
    (BLACK, (0, (6, 1.5, 1, 1.5, 1, 1.5))),
    (GREY, (0, (1, 2.4))),
)

DEFAULT_CYCLE = matplotlib.rcParamsDefault["axes.prop_cycle"]

COLOUR_MAP = "plasma"
"""From blue by red to yellow; of the maps that are even to the eye, the one with the most hues
before it grows too pale for a curve."""

AREA_END, CURVE_END = 0.93, 0.63
"""Where the colour map is cut for areas, and for curves: beyond, a curve on white has a contrast of
less than 3 to 1."""

TIME_COLOURS = 64
"""Colours along a curve that is coloured by time; more cannot be told apart."""

START: Look = {"ls": "", "marker": "o", "ms": 4, "mfc": "white", "mec": BLACK, "mew": 0.6}

END: Look = {"ls": "", "marker": "s", "ms": 2.8, "mfc": BLACK, "mec": BLACK, "mew": 0.6}

CROSSING: Look = {"ls": "", "marker": "D", "ms": 3.6, "mfc": YELLOW, "mec": BLACK, "mew": 0.6}

LAW_LOOK: Look = {"color": BLACK, "lw": 1.0, "ls": (0, (5, 1.5)), "zorder": 4}

SEPARATRIX: Look = {"color": BLACK, "lw": 0.7, "ls": (0, (3.2, 2.1))}


def hues(n: int = 256, end: float = AREA_END) -> ListedColormap:
    """The colours of every scale, from early or small to late or large."""
    return ListedColormap(matplotlib.colormaps[COLOUR_MAP](np.linspace(0, end, n)))


COLOURS = dict(
    zip(COLOUR_NAMES, (BLUE, ORANGE, GREEN, SKY, RED, PURPLE, BLACK, PALE_GREY), strict=True)
)

LINES = dict(zip(LINE_NAMES, ("-", (0, (5, 1.5)), (0, (1, 1))), strict=True))


def colour_cycle() -> Sequence[tuple[Any, Any]]:
    """Colours with a line style each: ours, or those of the user's cycle, with our line styles
    where it has colours only."""
    chosen = matplotlib.rcParams["axes.prop_cycle"]
    if chosen == DEFAULT_CYCLE:
        return CYCLE
    pairs = zip(chosen, cycle(line for _, line in CYCLE), strict=False)
    return [(look.get("color", BLACK), look.get("linestyle", line)) for look, line in pairs]


def styles(n: int, style_names: Sequence[str] = (), solid: bool = False) -> list[dict[str, Any]]:
    """n colours with line styles: first the named ones, such as "blue dashed", then those of the
    user's cycle of colours, or of ours; `solid` lines as long as the colours differ."""
    pairs = colour_cycle()
    # A user's cycle may have lines that ours has not.
    lines = list(dict.fromkeys(["-", *(line for _, line in (*pairs, *CYCLE))]))
    looks = [*map(look_named, style_names)]
    for colour, line in islice(cycle(pairs), len(looks), n):
        first = 0 if solid else lines.index(line)
        taken = [look["ls"] for look in looks if look["color"] == colour]
        # A colour that comes again has another line, or two curves would look the same.
        free = (other for other in lines[first:] + lines[:first] if other not in taken)
        looks.append({"color": colour, "ls": next(free, line)})
    return looks[:n]


def labelled_styles(
    names: Sequence[str], style_names: Sequence[str] = (), even_one: bool = False
) -> list[dict[str, Any]]:
    """The styles of curves with these names, by which the legend has them where they are several,
    and also `even_one`."""
    labels = names if even_one or len(names) > 1 else [""]
    return [
        {**look, "label": label}
        for look, label in zip(styles(len(names), style_names), labels, strict=True)
    ]


def look_named(text: str) -> dict[str, Any]:
    """The colour and line that a text such as "blue dashed" names; solid if it names no line."""
    colour, _, line = text.partition(" ")
    return {"color": COLOURS[colour], "ls": LINES[line or "solid"]}


def time_span(motions: Sequence[Motion]) -> tuple[float, float]:
    """From when the first of some motions begins to when the last one ends or comes to rest, after
    which no curve goes on: one scale of colours for all of them."""
    ends = (np.clip(motion.stop, *motion.time[[0, -1]]) for motion in motions)
    return min(motion.time[0] for motion in motions), max(ends)


def palettes(
    motions: Sequence[Motion], spec: Mapping[str, Any]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each motion of a figure colours (m, 3), and the index in them of each sample's colour
    (n,): by time, by enclosed axis, or the one colour of its case."""
    colour = spec.get("colour", "axis")
    if colour == "time":
        colours = np.asarray(hues(TIME_COLOURS, CURVE_END).colors)[:, :3]
        first, last = time_span(motions)
        whole = last - first or 1.0
        shares = [(motion.time.clip(None, last) - first) / whole for motion in motions]
        return [(colours, (share * (TIME_COLOURS - 1)).astype(int)) for share in shares]
    if colour == "axis":
        labels = sorted(AXIS_COLOUR)
        colours = np.array([to_rgb(AXIS_COLOUR[label]) for label in labels])
        return [(colours, np.searchsorted(labels, labels_of(motion))) for motion in motions]
    return [
        (np.array([to_rgb(look["color"])]), np.zeros(len(motion.time), dtype=int))
        for motion, look in zip(motions, styles(len(motions), spec["styles"], True), strict=True)
    ]


def line_styles(n: int, spec: Mapping[str, Any]) -> list[Any]:
    """The lines of n curves of a figure: solid where their colours show time or the enclosed axis,
    each its own where no colours show the cases, in the quadrants."""
    if spec.get("colour", "case") != "case":
        return ["-"] * n
    return [look["ls"] for look in styles(n, spec.get("styles", ()), solid="colour" in spec)]


def labels_of(motion: Motion) -> np.ndarray:
    """The enclosed axis at each sample (n,)."""
    return motion.labels if motion.classified else np.full(len(motion.time), NOT_CLASSIFIED)


def mark_points(
    axes: Axes,
    curves: Sequence[np.ndarray],
    crossings: Sequence[np.ndarray],
    frame: np.ndarray | None = None,
) -> None:
    """Mark start, end and crossings (m, 2) of each of some curves (n, 2), where they lie in a frame
    (2, 2) if there is one."""
    number_marks(axes, crossings)
    low, high = (-np.inf, np.inf) if frame is None else frame.T
    starts, stops = np.stack([curve[[0, -1]] for curve in curves], axis=1)
    for style, points in ((START, starts), (END, stops), (CROSSING, np.concatenate(crossings))):
        shown = points[((points >= low) & (points <= high)).all(axis=-1)]
        (marks,) = axes.plot(shown[:, 0], shown[:, 1], **style, zorder=6, clip_on=False)
        # They may stick out of their panel; the layout would make room for them.
        marks.set_in_layout(False)


def number_marks(axes: Axes, crossings: Sequence[np.ndarray]) -> None:
    """Give each of several crossings (m, 2) of a curve its number in time."""
    for points in crossings:
        for number, point in enumerate(points, 1):
            if len(points) > 1 and np.isfinite(point).all():  # else it is not in the panel
                CrossingNumber(axes, number, point)


CROSSINGS_NAMED = 12
"""The most times of crossings in a legend, which grows by a line with every five."""


def mark_handles(motions: Sequence[Motion], time: str, wide: bool = False) -> list[Line2D]:
    """Legend entries of start, end and crossings; the time of the end where all end together, those
    of crossings where there is one motion only."""
    is_crossed, crossing = any(len(motion.crossing_time) for motion in motions), "$D = 0$"
    if is_crossed and len(motions) == 1:
        crossing = crossings_in_words(motions[0], crossing, time, 80 if wide else 46)
    ends = {ending(motion, time) for motion in motions}
    end = ends.pop() if len(ends) == 1 else "end"
    entries = [Line2D([], [], **START, label="start"), Line2D([], [], **END, label=end)]
    return entries + ([Line2D([], [], **CROSSING, label=crossing)] if is_crossed else [])


def crossings_in_words(motion: Motion, crossing: str, time: str, width: int) -> str:
    """The times of a motion's crossings, numbered if they are several, in lines of a width in
    characters."""
    # With its last zeros, which tell how exact a printed number is.
    start = motion.case.time.start
    times = [
        f"{when:#.{time_digits(when, start)}g}".removesuffix(".") for when in motion.crossing_time
    ]
    if len(times) > 1:
        # A line is not broken between a time and its number, nor before the unit.
        times = [f"{time}\N{NO-BREAK SPACE}({i})" for i, time in enumerate(times, 1)]
    named = with_minus(", ".join(abridged(times, CROSSINGS_NAMED)))
    unit = unit_after(motion, "time").replace(" ", "\N{NO-BREAK SPACE}")
    words = f"$D = 0$ at ${time}$ = {named}{unit}"
    return "\n".join(textwrap.wrap(words, width)).replace("\N{NO-BREAK SPACE}", " ")


def ending(motion: Motion, time: str) -> str:
    """How a motion ends, and when: it stops, or its samples end."""
    kind, when = ("stop", motion.stop) if math.isfinite(motion.stop) else ("end", motion.time[-1])
    number = in_formula(motion.case.time.text(when))
    return f"{kind}, ${time} = {number}${unit_after(motion, 'time')}"


def axis_handles(motions: Sequence[Motion]) -> list[Line2D]:
    """Legend entries of the colours by enclosed axis that occur."""
    # A body at rest goes round no axis, and draws no curve.
    moving = (
        labels_of(motion)[(motion.time <= motion.stop) & motion.G.any(axis=1)] for motion in motions
    )
    present = {int(label) for labels in moving for label in np.unique(labels)}
    words = {0: "separatrix", -1: "undetermined", NOT_CLASSIFIED: "not classified"}
    # Others than the axes that are drawn, if a body is given by its full tensor of inertia.
    has_others = any((motion.principal_axes != np.eye(3)).any() for motion in motions)
    about = "about principal axis" if has_others else "about"
    words |= {x: f"{about} $x_{x}$" for x in (1, 2, 3)}
    return [
        Line2D([], [], color=AXIS_COLOUR[x], lw=1.5, label=words[x])
        for x in sorted(present, key=lambda label: (label < 1, label))
    ]


def case_handles(names: Sequence[str], style_names: Sequence[str]) -> list[Line2D]:
    """Legend entries of the colours by case."""
    looks = styles(len(names), style_names, solid=True)
    return [Line2D([], [], **look, label=name) for look, name in zip(looks, names, strict=True)]


def colour_handles(
    sheet: Sheet, panels: Sequence[Axes], motions: Sequence[Motion], spec: Mapping[str, Any]
) -> list[Line2D]:
    """Legend entries of the colours of curves; of colours by time, a bar below the panels, and no
    entries."""
    if spec["colour"] == "case":
        return case_handles([motion.label for motion in motions], spec["styles"])
    if spec["colour"] == "axis":
        return axis_handles(motions)
    scale = ScalarMappable(Normalize(*time_span(motions)), hues(end=CURVE_END))
    colour_bar(sheet, scale, panels, time_label(spec, motions[0]))
    return []


def colour_bar(
    sheet: Sheet, scale: ScalarMappable, panels: Sequence[Axes], label: str, arrows: str = "neither"
) -> Colorbar:
    """The scale of the colours of some panels below them, with arrows at the ends beyond which
    there are values: "neither", "min", "max" or "both"."""
    place: Look = {"location": "bottom", "fraction": 0.04, "pad": 0.02, "shrink": 0.7, "aspect": 45}
    # The panels keep their anchors: a map of a sphere is at the top of its room.
    bar = sheet.figure.colorbar(scale, ax=panels, panchor=False, extend=arrows, **place)
    bar.set_label(label)
    bar.formatter.set_locs(bar.get_ticks().tolist())
    if bar.formatter.get_offset():
        # The factor of the numbers has the line below them: a label may be as wide as the bar.
        bar.ax.xaxis.labelpad += 1.2 * text_size("xtick.labelsize")
    return bar


def stretches(*keys: np.ndarray) -> list[slice]:
    """The stretches of a curve on which all keys (n,) are constant, each reaching to the next one's
    first sample."""
    # Each stretch reaches the next, or a line would have gaps where its colour changes.
    table = np.stack(keys, axis=-1)
    cuts = (np.flatnonzero((table[1:] != table[:-1]).any(axis=-1)) + 1).tolist()
    return [slice(a, b + 1) for a, b in zip([0, *cuts], [*cuts, len(table)], strict=True)]


def windings(curve: np.ndarray) -> float:
    """The length of a curve (n, 3) in units of its size: about 2 pi for one turn."""
    size = max(float(np.abs(curve).max()), math.ulp(0))
    return float(np.linalg.norm(np.diff(curve / size, axis=0), axis=-1).sum())


def check_zoom(zoom: float, nearest: float, units: str) -> None:
    """Raise HodoError if curves that come no nearer to the origin than `nearest`, in the units of
    an axis, are not in a panel that ends at `zoom`."""
    if nearest >= zoom:
        raise HodoError(
            f"zoom: {zoom:g} shows nothing: the curves come no nearer to the origin than "
            f"{nearest:.4g} {without_tex(units).replace('[–]', '')}".rstrip()
        )


def crossings_on(motions: Sequence[Motion], curves: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The crossings (m, k) on the curves (n, k) of motions."""
    return [motion.at_crossings(curve) for motion, curve in zip(motions, curves, strict=True)]


def plane_curves(
    axes: Axes,
    spec: Mapping[str, Any],
    motions: Sequence[Motion],
    curves: Sequence[np.ndarray],
    crossings: Sequence[np.ndarray],
    frame: np.ndarray | None = None,
) -> None:
    """The curves (n, 2) of motions in a plane with their marks, at crossings (m, 2) too; in a frame
    (2, 2) of the plane, or in a panel that shows all."""
    lines = line_styles(len(motions), spec)
    drawn = zip(motions, curves, palettes(motions, spec), lines, strict=True)
    for motion, points, (colours, code), line in drawn:
        segments = stretches(code)
        axes.add_collection(
            LineCollection(
                [points[segment] for segment in segments],
                colors=[colours[code[segment.start]] for segment in segments],
                linewidths=0.8 * line_width(motion),
                linestyles=line,
                alpha=0.85,
            )
        )
    mark_points(axes, curves, crossings, frame)
    if frame is None:
        axes.autoscale_view()


def line_width(motion: Motion) -> float:
    """A line width, the thinner the longer the hodograph winds."""
    thinner = float(np.interp(windings(motion.G), [15, 120], [1.1, 0.5]))
    return thinner * float(matplotlib.rcParams["lines.linewidth"])


def arrow(axes: Axes, tail: np.ndarray, tip: np.ndarray, colour: Any, zorder: float) -> None:
    """An arrow from tail to tip (2,)."""
    head = "-|>,head_width=0.14,head_length=0.35"
    look = {"arrowstyle": head, "lw": 0.5, "color": colour, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tip.tolist(), tail.tolist(), arrowprops=look, zorder=zorder)


def names_beside(motions: Sequence[Motion], spec: Mapping[str, Any]) -> list[str]:
    """The names of several motions, where the colours of their curves show something else; else
    none."""
    is_named = len(motions) > 1 and spec["colour"] != "case"
    return [motion.label for motion in motions] if is_named else []


def name_curves(
    axes: Axes,
    curves: Sequence[np.ndarray],
    names: Sequence[str],
    colours: Sequence[Any] = (),
) -> None:
    """Name curves (n, 2), in black or in some colours, where each is far from the others."""
    # Names that are longer than a panel is wide have several lines.
    width, size = room_across(axes) / 72, text_size("font.size")
    names = ["\n".join(text_lines(name, width, size)) for name in names]
    visible = [curve[np.isfinite(curve).all(axis=1)] for curve in curves]
    thinned = [curve[:: max(1, len(curve) // 200)] for curve in visible]
    for i, (curve, name) in enumerate(zip(thinned, names, strict=False)):
        others = np.concatenate([*thinned[:i], *thinned[i + 1 :], np.full((1, 2), 1e9)])
        apart = np.hypot(*(curve[:, None] - others).T).min(axis=0)
        if len(curve):
            free = curve[apart >= np.quantile(apart, 0.75)]
            Words(axes, name, free, toward=(0, 1), color=colours[i] if colours else BLACK)


def room_across(axes: Axes) -> float:
    """The width in points that a panel has at least, when its labels have got their room."""
    return float(0.8 * 72 * axes.bbox.width / axes.figure.dpi)


def heading(axes: Axes, points: np.ndarray, colour: Any, size: float) -> None:
    """An arrow head that shows the direction of a curve (n, 2), where it is `size` away from its
    start."""
    beyond = np.flatnonzero(np.hypot(*(points - points[0]).T) > size)
    if beyond.size and beyond[0] + 1 < len(points):
        point, step = points[beyond[0]], points[beyond[0] + 1] - points[beyond[0]]
        arrow(
            axes,
            point - step / max(float(np.hypot(*step)), math.ulp(0)) * 0.01 * size,
            point,
            colour,
            zorder=5,
        )
