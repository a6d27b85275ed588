"""Colours, marks, labels and legends that every kind of figure shares."""

import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ..cases.figure_block import COLOUR_NAMES, LINE_NAMES
from ..results.motion import Motion
from ..text import abridged
from .geometry import stretches, windings
from .sheet import Look, Sheet

COLUMN, PAGE = 84 / 25.4, 174 / 25.4
"""Widths of a journal's column and page, inches."""

BLUE, ORANGE, GREEN, SKY, RED, PURPLE, BLACK = (
    "#0072B2", "#BF8200", "#009E73", "#2E8FCB", "#D55E00", "#CC79A7", "#000000")  # fmt: skip
"""The palette of Okabe and Ito, legible to the colour-blind; its orange and sky are darker here, so
that every curve has a contrast of at least 3 to 1 on white."""

YELLOW = "#F0E442"
"""The palette's own, too pale for a curve: it fills marks."""

GREY, PALE_GREY = "#666666", "#8A8A8A"
AXIS_COLOUR = {1: BLUE, 2: GREEN, 3: ORANGE, 0: "#555555", -1: PALE_GREY}

# Neighbours differ in colour and in line, so that they are told apart in grey print too.
CYCLE = (
    (BLUE, "-"),
    (RED, (0, (5, 1.5))),
    (GREEN, (0, (5, 1.5, 1, 1.5))),
    (PURPLE, (0, (1, 1))),
    (ORANGE, "-"),
    (SKY, (0, (5, 1.5))),
    (BLACK, (0, (1, 1))),
    (GREY, "-"),
)
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
SEPARATRIX: Look = {"color": BLACK, "lw": 0.7, "ls": (0, (3, 2))}
HALO = [patheffects.withStroke(linewidth=1.5, foreground="white")]


# Drawn by several kinds


def hues(n: int = 256, end: float = AREA_END) -> ListedColormap:
    """The colours of every scale, from early or small to late or large."""
    return ListedColormap(matplotlib.colormaps[COLOUR_MAP](np.linspace(0, end, n)))


def unit(motion: Motion, variable: str, power: int = 1) -> str:
    """The units of a variable, in brackets, raised to a power; a dash where the case has none, and
    nothing where only its time has units."""
    stored = motion.units(variable)
    if stored == "1" or motion.lacks_unit(variable):
        # With time in seconds T and G are no bare numbers, and no file says what units A has.
        return "[–]" if motion.units("time") == "1" else ""
    set_in_tex = re.sub(r"\^(-?\d+)", r"$^{\1}$", stored)
    return f"[{set_in_tex}]" if power == 1 else f"[({set_in_tex})$^{power}$]"


VECTORS = {"gamma": r"\gamma", "omega": r"\omega", "total": r"(G-\kappa\dot\omega)"}
"""The symbols of stored vectors whose name is not theirs."""


def symbol(name: str) -> str:
    """A variable's name in TeX: Gz as G_z, u1 as u_1, G.x2 as G_2."""
    special = {
        "G": "|G|",
        "G2": "G^2",
        "J": "J = G^2/2T",
        "omega.x1": "p",
        "omega.x2": "q",
        "omega.x3": "r",
        "gamma.x3": r"\cos\theta",
        "psi": r"\psi",
        "theta": r"\theta",
        "phi": r"\phi",
    }
    if name in special:
        return special[name]
    base, _, axis = name.partition(".")
    if base == "attitude":
        return axis
    if base.endswith("_space"):
        vector = base.removesuffix("_space")
        index = f"{vector[1]},{axis}" if vector[1:].isdigit() else axis
        return rf"{{{VECTORS.get(vector, vector[0])}}}_{{{index}}}"
    if axis:
        return f"{VECTORS.get(base, base)}_{axis[1:]}"
    if re.fullmatch(r"[A-Za-z]\w{2,}", name):
        # A word, not a product of letters, nor an index.
        return rf"\mathrm{{{name}}}".replace("_", r"\ ")
    return f"{name[0]}_{{{name[1:]}}}" if re.fullmatch("[A-Za-z][a-z0-9]", name) else name


def axis_label(name: str, motion: Motion) -> str:
    """A variable's symbol and units."""
    return f"${symbol(name)}$ {unit(motion, name)}".rstrip()


def time_label(spec: Mapping[str, Any], motion: Motion) -> str:
    """The symbol of time and its units."""
    return f"${spec['time']}$ {unit(motion, 'time')}"


COLOURS = dict(
    zip(COLOUR_NAMES, (BLUE, ORANGE, GREEN, SKY, RED, PURPLE, BLACK, PALE_GREY), strict=True)
)
LINES = dict(zip(LINE_NAMES, ("-", (0, (5, 1.5)), (0, (1, 1))), strict=True))


def styles(n: int, style_names: Sequence[str] = ()) -> list[dict[str, Any]]:
    """n colours with line styles: first the named ones, such as "blue dashed", then the cycle's."""
    lines = list(dict.fromkeys(line for _, line in CYCLE))
    looks: list[dict[str, Any]] = []
    for i in range(n):
        lap, (colour, line) = i // len(CYCLE), CYCLE[i % len(CYCLE)]
        # Each round of the colours has other lines, or its curves would look like those before.
        line = lines[(lines.index(line) + lap) % len(lines)]
        looks.append({"color": colour, "ls": line})
    return [*map(style, style_names), *looks[len(style_names) :]][:n]


def style(text: str) -> dict[str, Any]:
    """The colour and line that a text such as "blue dashed" names; solid if it names no line."""
    colour, _, line = text.partition(" ")
    return {"color": COLOURS[colour], "ls": LINES[line or "solid"]}


def palette(
    motion: Motion, colour: str, index: int, style_names: Sequence[str] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (m, 3), and the index in them of each sample's colour (n,): by time, by enclosed
    axis, or the one colour of a case, whose number among the cases is `index`."""
    if colour == "time":
        since = motion.time - motion.time[0]
        colours = np.asarray(hues(TIME_COLOURS, CURVE_END).colors)[:, :3]
        return colours, (since / (since[-1] or 1.0) * (TIME_COLOURS - 1)).astype(int)
    if colour == "axis":
        labels = sorted(AXIS_COLOUR)
        return np.array([to_rgb(AXIS_COLOUR[x]) for x in labels]), np.searchsorted(
            labels, motion.labels
        )
    look = styles(index + 1, style_names)[index]
    return np.array([to_rgb(look["color"])]), np.zeros(len(motion.time), dtype=int)


def mark_points(
    axes: Axes, ends: np.ndarray, crossings: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]
) -> None:
    """Mark start and end (2, 2) and crossings (m, 2) of a curve, where they are inside."""
    for style, points in ((START, ends[:1]), (END, ends[1:]), (CROSSING, crossings)):
        shown = points[inside(points)]
        for artist in axes.plot(shown[:, 0], shown[:, 1], **style, zorder=6, clip_on=False):
            # A mark may stick out of its panel; the layout would make room for it.
            artist.set_in_layout(False)


def legend(sheet: Sheet, handles: Sequence[Line2D | Patch], columns: int) -> None:
    """A legend below the panels, which is read row by row."""
    # matplotlib fills column after column.
    rowwise = [handle for column in range(columns) for handle in handles[column::columns]]
    sheet.figure.legend(
        handles=rowwise, loc="outside lower center", ncols=columns, columnspacing=1.2
    )


def of_other_body(motions: Sequence[Motion]) -> Motion | None:
    """The first motion that is of another body than the first of all; None if all are of one."""
    body = motions[0].inertia
    return next((motion for motion in motions if not np.array_equal(motion.inertia, body)), None)


CROSSINGS_NAMED = 12
"""The most times of crossings in a legend, which grows by a line with every five."""


def mark_handles(motions: Sequence[Motion], time: str, wide: bool = False) -> list[Line2D]:
    """Legend entries of start, end and crossings; the time of the end where all end together, those
    of crossings where there is one motion only."""
    unit = motions[0].units("time")
    of_time = "" if unit == "1" else f" {unit}"
    # With its last zeros, which tell how exact a printed number is.
    times = [f"{when:#.6g}" for motion in motions for when in motion.crossing_time]
    crossings = abridged(times, CROSSINGS_NAMED)
    end, crossing = "end", "$D = 0$"
    if len({float(motion.time[-1]) for motion in motions}) == 1:
        end += f", ${time} = {motions[0].time[-1]:.6g}${of_time}"
    if len(motions) == 1:
        words = f"{crossing} at ${time}$ = {', '.join(crossings)}{of_time}"
        crossing = "\n".join(textwrap.wrap(words, 80 if wide else 46))
    entries = [Line2D([], [], **START, label="start"), Line2D([], [], **END, label=end)]
    return entries + ([Line2D([], [], **CROSSING, label=crossing)] if crossings else [])


def axis_handles(motions: Sequence[Motion]) -> list[Line2D]:
    """Legend entries of the colours by enclosed axis that occur."""
    present = {int(label) for motion in motions for label in np.unique(motion.labels)}
    words = {0: "separatrix", -1: "undetermined"}
    order = sorted(present, key=lambda label: (label < 1, label))
    return [
        Line2D([], [], color=AXIS_COLOUR[x], lw=1.5, label=words.get(x, f"about $x_{x}$"))
        for x in order
    ]


def case_handles(
    names: Sequence[str], style_names: Sequence[str] = (), solid: bool = False
) -> list[Line2D]:
    """Legend entries of the colours and line styles by case, or of the colours alone."""
    looks = styles(len(names), style_names)
    return [
        Line2D([], [], **look | ({"ls": "-"} if solid else {}), label=name)
        for name, look in zip(names, looks, strict=True)
    ]


def colour_handles(
    motions: Sequence[Motion], colour: str, style_names: Sequence[str] = ()
) -> list[Line2D]:
    """Legend entries of the colours of a hodograph; none where a bar explains them."""
    if colour == "case":
        return case_handles([motion.label for motion in motions], style_names, solid=True)
    return axis_handles(motions) if colour == "axis" else []


def plane_curve(
    axes: Axes, points: np.ndarray, colours: np.ndarray, code: np.ndarray, width: float
) -> None:
    """A plane curve (n, 2) in colours[code]."""
    segments = stretches(code)
    shades = [colours[code[segment.start]] for segment in segments]
    axes.add_collection(
        LineCollection(
            [points[segment] for segment in segments], colors=shades, linewidths=width, alpha=0.85
        )
    )


def line_width(motion: Motion) -> float:
    """A line width, the thinner the longer the hodograph winds."""
    return float(np.interp(windings(motion.G), [15, 120], [1.1, 0.5]))


def arrow(axes: Axes, tail: np.ndarray, tip: np.ndarray, colour: Any, zorder: float) -> None:
    """An arrow from tail to tip (2,)."""
    looks = {
        "arrowstyle": "-|>,head_width=0.14,head_length=0.35",
        "lw": 0.5,
        "color": colour,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    axes.annotate("", pair(tip), pair(tail), arrowprops=looks, zorder=zorder)


def pair(point: np.ndarray) -> tuple[float, float]:
    """A point (2,) as matplotlib's types want it."""
    return float(point[0]), float(point[1])


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


def everywhere(points: np.ndarray) -> np.ndarray:
    """True for every point (n, 2)."""
    return np.ones(len(points), dtype=bool)


def time_bar(sheet: Sheet, panels: list[Axes], motion: Motion, spec: Mapping[str, Any]) -> None:
    """The colour bar of a curve that is coloured by time."""
    scale = ScalarMappable(Normalize(motion.time[0], motion.time[-1]), hues(end=CURVE_END))
    bar = sheet.figure.colorbar(
        scale, ax=panels, location="bottom", fraction=0.03, pad=0.02, shrink=0.6, aspect=50
    )
    bar.set_label(time_label(spec, motion))
