"""Figures from result files: each kind of figure is one function here. The only importer of matplotlib."""

import csv
import io
import math
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib.style
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cbook import is_math_text
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.mathtext import MathTextParser
from matplotlib.patches import Circle, Ellipse, Patch, Polygon

from . import HodoError
from .geometry import View, centroid, freest, graticule, round_step, sectors, separatrix_circles, stretches, windings
from .maps import Swept, edges, hammer, hammer_curve, hammer_image
from .models import rigid_body
from .models.rigid_body import slope
from .results.motion import Motion, Rendered, Results
from .schema.kinds import nearest

if TYPE_CHECKING:
    from .bench import Bench

Look = dict[str, Any]

COLUMN, PAGE = 84 / 25.4, 174 / 25.4
"""Widths of a journal's column and page, inches."""

BLUE, ORANGE, GREEN, SKY, RED, PURPLE, BLACK = (
    "#0072B2", "#E69F00", "#009E73", "#56B4E9", "#D55E00", "#CC79A7", "#000000")  # fmt: skip
"""The palette of Okabe and Ito, legible to the colour-blind; blue and orange differ in grey print too."""

GREY = "#666666"
AXIS_COLOUR = {1: BLUE, 2: GREEN, 3: ORANGE, 0: "#555555", -1: "#999999"}
CYCLE = ((BLUE, "-"), (RED, (0, (5, 1.5))), (GREEN, (0, (5, 1.5, 1, 1.5))), (PURPLE, (0, (1, 1))), (ORANGE, "-"),
         (SKY, (0, (5, 1.5))), (BLACK, (0, (1, 1))), (GREY, "-"))  # fmt: skip
VIRIDIS_END = 0.93  # its yellow end is too pale on white

START: Look = {"ls": "", "marker": "o", "ms": 4, "mfc": "white", "mec": BLACK, "mew": 0.6}
END: Look = {"ls": "", "marker": "s", "ms": 2.8, "mfc": BLACK, "mec": BLACK, "mew": 0.6}
CROSSING: Look = {"ls": "", "marker": "D", "ms": 3.6, "mfc": "#F0E442", "mec": BLACK, "mew": 0.6}
SEPARATRIX: Look = {"color": BLACK, "lw": 0.7, "ls": (0, (3, 2))}
HALO = [patheffects.withStroke(linewidth=1.5, foreground="white")]

STYLE: Look = {
    "font.family": "STIXGeneral", "mathtext.fontset": "stix", "font.size": 8, "axes.labelsize": 8,
    "axes.titlesize": 8, "legend.fontsize": 7, "xtick.labelsize": 7, "ytick.labelsize": 7,
    "axes.linewidth": 0.5, "lines.linewidth": 1.0, "xtick.direction": "in", "ytick.direction": "in",
    "xtick.top": True, "ytick.right": True, "xtick.major.width": 0.5, "ytick.major.width": 0.5,
    "legend.frameon": False, "legend.handlelength": 2.2, "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4), "axes.formatter.use_mathtext": True, "savefig.dpi": 300,
    "svg.hashsalt": "hodo", "pdf.fonttype": 42,
}  # fmt: skip

UNDATED: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
FORMATS = (*UNDATED, "csv")


@dataclass(frozen=True)
class Shown:
    """One curve of a figure: the panel that holds it, its name, and the values drawn."""

    panel: str
    curve: str
    values: Mapping[str, np.ndarray]


@dataclass
class Sheet:
    """A figure being drawn, with a record of every value that it shows."""

    figure: Figure
    shown: list[Shown] = field(default_factory=list)

    def record(self, panel: str, curve: str, **values: np.ndarray) -> None:
        """Note the values of a curve."""
        self.shown.append(Shown(panel, curve, {name: np.asarray(value) for name, value in values.items()}))

    def csv(self) -> str:
        """What the figure shows, a row per sample; columns that a curve does not have stay empty."""
        columns = list(dict.fromkeys(name for item in self.shown for name in item.values))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["panel", "curve", *columns])
        for item in self.shown:
            present = [item.values[name].tolist() if name in item.values else None for name in columns]
            for i in range(len(next(iter(item.values.values())))):
                writer.writerow([item.panel, item.curve, *("" if one is None else one[i] for one in present)])
        return text.getvalue()


Kind = Callable[[Sheet, Mapping[str, Any], Results], None]
DRAW: dict[str, Kind] = {}


def kind(name: str) -> Callable[[Kind], Kind]:
    """Make a function the one that draws figures of this kind; `figures.KINDS` declares its keys."""

    def enter(function: Kind) -> Kind:
        DRAW[name] = function
        return function

    return enter


def draw(spec: Mapping[str, Any], results: Results) -> Sheet:
    """The figure that one entry of a `figures:` block describes.

    Raises HodoError if a case or variable is not in the file, the kind of figure has no meaning for it, or a text
    is not TeX as matplotlib knows it.
    """
    for text in (*spec.get("labels", ()), f"${spec.get('time', 't')}$"):
        check_tex(text)
    with matplotlib.style.context(["default", STYLE]):
        sheet = Sheet(Figure(layout=ConstrainedLayoutEngine(w_pad=0.04, h_pad=0.06)))
        DRAW[spec["kind"]](sheet, spec, results)
    return sheet


def check_tex(text: str) -> None:
    """Raise HodoError if the formulas in a text, between dollar signs, cannot be set."""
    try:
        if is_math_text(text):
            MathTextParser("path").parse(text)
    except ValueError as error:
        what = str(error).strip().splitlines()[-1]
        raise HodoError(f"{text!r} is not TeX that matplotlib knows ({what})") from None


def save(sheet: Sheet, path: Path, about: str = "") -> None:
    """Write a figure in the format of the path's suffix, the same bytes every time; `about` goes into its metadata."""
    suffix = path.suffix[1:]
    if suffix == "csv":
        path.write_text(sheet.csv(), encoding="utf-8", newline="")
        return
    note = {"pdf": "Subject"}.get(suffix, "Description")
    with matplotlib.style.context(["default", STYLE]):
        sheet.figure.savefig(path, metadata=UNDATED[suffix] | {note: about})


def render(results: Results, names: Sequence[str], formats: Sequence[str], out: Path) -> list[Rendered]:
    """Draw the named figures of a result file (all, if none is named) into the folder `out`.

    A figure that cannot be drawn does not keep the others: its `problem` says why. Raises HodoError, before
    anything is drawn, for an unknown figure or format.
    """
    chosen = [(name, results.figure(name)) for name in names or results.figures]
    for wrong in (name for name in formats if name not in FORMATS):
        raise HodoError(f"unknown format {wrong!r}{nearest(wrong, FORMATS)} (valid: {', '.join(FORMATS)})")
    out.mkdir(parents=True, exist_ok=True)
    return [_rendered(results, name, spec, [out / f"{name}.{suffix}" for suffix in formats]) for name, spec in chosen]


def _rendered(results: Results, name: str, spec: Mapping[str, Any], files: Sequence[Path]) -> Rendered:
    try:
        sheet = draw(spec, results)
    except HodoError as error:
        return Rendered(name, problem=str(error))
    for path in files:
        save(sheet, path, about=spec["caption"])
    return Rendered(name, tuple(files))


# What several kinds draw


def unit(motion: Motion, variable: str, power: int = 1) -> str:
    """The units of a variable, in brackets, raised to a power; a dash where it has none."""
    stored = motion.units(variable)
    return "[–]" if stored == "1" else f"[{stored}]" if power == 1 else f"[({stored})$^{power}$]"


def symbol(name: str) -> str:
    """A variable's name in TeX: Gz as G_z, u1 as u_1, G.x2 as G_2."""
    special = {"G_norm": "|G|", "G2": "G^2", "omega.x1": "p", "omega.x2": "q", "omega.x3": "r", "gamma": r"\gamma"}
    if name in special:
        return special[name]
    base, _, axis = name.partition(".")
    if axis:
        return f"{symbol(base)}_{axis[1:]}"
    return f"{name[0]}_{{{name[1:]}}}" if re.fullmatch("[A-Za-z][a-z0-9]", name) else name


def axis_label(name: str, motion: Motion) -> str:
    """A variable's symbol and units."""
    return f"${symbol(name)}$ {unit(motion, name)}"


def time_label(spec: Mapping[str, Any], motion: Motion) -> str:
    """The symbol of time and its units."""
    return f"${spec['time']}$ {unit(motion, 'time')}"


def styles(n: int) -> list[dict[str, Any]]:
    """n colours with line styles."""
    return [dict(zip(("color", "ls"), CYCLE[i % len(CYCLE)], strict=True)) for i in range(n)]


def palette(motion: Motion, colour: str, place: int) -> tuple[np.ndarray, np.ndarray]:
    """Colours (m, 3), and the position in them of each sample's colour (n,), by what the colour says."""
    if colour == "time":
        since = motion.time - motion.time[0]
        hues = matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 64))[:, :3]
        return hues, (since / (since[-1] or 1.0) * 63).astype(int)
    if colour == "axis":
        labels = sorted(AXIS_COLOUR)
        return np.array([to_rgb(AXIS_COLOUR[x]) for x in labels]), np.searchsorted(labels, motion.labels)
    return np.array([to_rgb(CYCLE[place % len(CYCLE)][0])]), np.zeros(len(motion.time), dtype=int)


def mark(axes: Axes, ends: np.ndarray, crossings: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]) -> None:
    """Mark start and end (2, 2) and crossings (m, 2) of a curve, where they are inside."""
    for style, points in ((START, ends[:1]), (END, ends[1:]), (CROSSING, crossings)):
        shown = points[inside(points)]
        for artist in axes.plot(shown[:, 0], shown[:, 1], **style, zorder=6, clip_on=False):
            artist.set_in_layout(False)


def legend(sheet: Sheet, handles: Sequence[Line2D | Patch], columns: int) -> None:
    """A legend below the panels."""
    sheet.figure.legend(handles=list(handles), loc="outside lower center", ncols=columns, columnspacing=1.2)


def mark_handles(motions: Sequence[Motion], time: str, wide: bool = False) -> list[Line2D]:
    """Legend entries of start, end and crossings; times are given where there is one motion only."""
    crossings = [f"{when:.6g}" for motion in motions for when in motion.crossing_time]
    end, crossing = "end", "$D = 0$"
    if len(motions) == 1:
        end += f", ${time} = {motions[0].time[-1]:.6g}$"
        crossing = "\n".join(textwrap.wrap(f"{crossing} at ${time}$ = {', '.join(crossings)}", 80 if wide else 46))
    entries = [Line2D([], [], **START, label="start"), Line2D([], [], **END, label=end)]
    return entries + ([Line2D([], [], **CROSSING, label=crossing)] if crossings else [])


def axis_handles(motions: Sequence[Motion], both: bool = False) -> list[Line2D]:
    """Legend entries of the colours by enclosed axis that occur, or of both axes besides."""
    present = {int(label) for motion in motions for label in np.unique(motion.labels)}
    present |= {motions[0].order[0] + 1, motions[0].order[2] + 1} if both else set()
    words = {0: "separatrix", -1: "undetermined"}
    order = sorted(present, key=lambda label: (label < 1, label))
    return [Line2D([], [], color=AXIS_COLOUR[x], lw=1.5, label=words.get(x, f"about $x_{x}$")) for x in order]


def case_handles(names: Sequence[str], solid: bool = False) -> list[Line2D]:
    """Legend entries of the colours and line styles by case, or of the colours alone."""
    return [
        Line2D([], [], **style | ({"ls": "-"} if solid else {}), label=name)
        for name, style in zip(names, styles(len(names)), strict=True)
    ]


def colour_handles(motions: Sequence[Motion], colour: str) -> list[Line2D]:
    """Legend entries of what the colour of a hodograph says."""
    if colour == "case":
        return case_handles([motion.label for motion in motions], solid=True)
    return axis_handles(motions) if colour == "axis" else []


def plane_curve(axes: Axes, points: np.ndarray, colours: np.ndarray, code: np.ndarray, width: float) -> None:
    """A plane curve (n, 2) in colours[code]."""
    pieces = stretches(code)
    shades = [colours[code[piece.start]] for piece in pieces]
    axes.add_collection(
        LineCollection([points[piece] for piece in pieces], colors=shades, linewidths=width, alpha=0.85)
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
    """An arrow head that shows the direction of a curve (n, 2), where it is `size` away from its start."""
    far = np.flatnonzero(np.hypot(*(points - points[0]).T) > size)
    if far.size and far[0] + 1 < len(points):
        here, step = points[far[0]], points[far[0] + 1] - points[far[0]]
        arrow(axes, here - step / max(float(np.hypot(*step)), math.ulp(0)) * 0.01 * size, here, colour, zorder=5)


# Curves in space


@kind("hodograph")
def hodograph(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """The curve of G in body axes; beside it, if wanted, its neighbourhood of the origin and its projections."""
    motions, view = results.motions(spec), View.toward(spec["view"])
    planes, zoom = spec["projections"], spec["zoom"]
    for motion in motions:
        G1, G2, G3 = motion.G.T
        sheet.record("hodograph", motion.label, time=motion.time, **{"G.x1": G1, "G.x2": G2, "G.x3": G3})
    up, down = (np.max([(sign * motion.G).max(axis=0) for motion in motions], axis=0) for sign in (1, -1))
    size = float(np.maximum(up, down).max()) or 1.0
    reach = np.stack([np.maximum(1.15 * up, 0.45 * size), np.maximum(1.05 * down, 0.12 * size)])
    frame = extent(np.concatenate([view(motion.G) for motion in motions] + [view(arms) for arms in tips(reach)]))
    main, *others = hodograph_panels(sheet, frame, 1 + (zoom is not None) + len(planes))
    space(main, motions, spec, view, reach, frame)
    if zoom is not None:
        window = np.array([[-1.25, 1.25], [-1.25, 1.25]]) * zoom
        space(others[0], motions, spec, view, np.full((2, 3), zoom), window, cut=True)
        others[0].set(title=f"enlarged, to $|G_i| = {zoom:g}$")
    for axes, plane in zip(others[zoom is not None :], planes, strict=True):
        projection(axes, motions, spec, plane)
    handles = colour_handles(motions, spec["colour"])
    handles += mark_handles(motions, spec["time"], wide=bool(others))
    if spec["colour"] == "time":
        time_bar(sheet, [main, *others], motions[0], spec)
    legend(sheet, handles, 5 if others else 2)


def tips(reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ends (3, 3) of the positive and the negative body axes, of lengths (2, 3)."""
    return np.diag(reach[0]), -np.diag(reach[1])


def extent(seen: np.ndarray) -> np.ndarray:
    """((left, right), (bottom, top)) of points (n, 3) in view, with a margin."""
    lo, hi = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    margin = 0.05 * (hi - lo).max()
    return np.stack([lo - margin, hi + margin], axis=-1)


def hodograph_panels(sheet: Sheet, frame: np.ndarray, n: int) -> list[Axes]:
    """n panels, the first shaped as the frame."""
    shape = float(np.clip(np.ptp(frame[0]) / np.ptp(frame[1]), 0.5, 2))
    if n == 1:
        sheet.figure.set_size_inches(COLUMN, COLUMN / max(shape, 0.8) + 0.5)
        return [sheet.figure.subplots()]
    if n == 2:
        height = min(PAGE / (shape + 1), 3.3)
        sheet.figure.set_size_inches(PAGE, height + 0.45)
        return list(sheet.figure.subplots(1, 2, width_ratios=[shape, 1]))
    sheet.figure.set_size_inches(PAGE, 0.95 * PAGE)
    panels = sheet.figure.subplots(2, (n + 1) // 2).ravel()
    for spare in panels[n:]:
        spare.remove()
    return list(panels[:n])


def space(
    axes: Axes, motions: Sequence[Motion], spec: Mapping[str, Any], view: View, reach: np.ndarray, frame: np.ndarray,
    cut: bool = False,
) -> None:  # fmt: skip
    """Hodographs in a view, with body axes of lengths `reach` (2, 3), within a frame (2, 2) of the page."""
    body_axes(axes, view, reach)
    near = float(np.ptp(frame)) / 2
    for place, motion in sorted(enumerate(motions), key=lambda item: -windings(item[1].G)):
        colours, code = palette(motion, spec["colour"], place)
        seen = view(motion.G)
        space_curve(axes, seen, colours, code, line_width(motion), near)
        mark(axes, seen[[0, -1], :2], view(motion.at_crossings(motion.G))[:, :2], lambda points: within(points, frame))
        if not cut:
            heading(axes, seen[:, :2], colours[code[0]], 0.12 * near)
    axes.set(xlim=frame[0], ylim=frame[1], aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set(visible=cut, color="#BBBBBB")


def within(points: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Which points (n, 2) lie in a frame (2, 2)."""
    return np.asarray(((points >= frame[:, 0]) & (points <= frame[:, 1])).all(axis=-1))


def space_curve(axes: Axes, seen: np.ndarray, colours: np.ndarray, code: np.ndarray, width: float, near: float) -> None:
    """A curve in view (n, 3), in colours[code]; what is farther from the reader is paler, and behind."""
    layer = np.clip((seen[:, 2] / near * 6).round(), -6, 6).astype(int)
    pieces = [piece for piece in stretches(code, layer) if np.abs(seen[piece, :2]).min(axis=0).max() < 3 * near]
    pieces.sort(key=lambda piece: int(layer[piece.start]))
    pale = [0.5 * (6 - layer[piece.start]) / 12 for piece in pieces]
    shades = [colours[code[piece.start]] * (1 - white) + white for piece, white in zip(pieces, pale, strict=True)]
    lines = LineCollection([seen[piece, :2] for piece in pieces], colors=shades, linewidths=width, capstyle="round")
    axes.add_collection(lines, autolim=False)


def body_axes(axes: Axes, view: View, reach: np.ndarray) -> None:
    """The axes x1, x2, x3 through the origin, of lengths `reach` (2, 3), named, with round values marked."""
    step = round_step(float(reach.max()))
    for i, (tip, tail) in enumerate(zip(*(view(arms)[:, :2] for arms in tips(reach)), strict=True)):
        arm(axes, tail, tip, i)
        counts = np.arange(-int(reach[1, i] / step), int(0.93 * reach[0, i] / step) + 1)
        at = view(counts[counts != 0, None] * step * np.eye(3)[i])
        axes.plot(at[:, 0], at[:, 1], ls="", marker=".", ms=2, color=GREY, zorder=1)
        if counts[-1] > 0:
            axes.annotate(f"{counts[-1] * step:.10g}", pair(at[-1]), (4, 0) if i == 2 else (1, -6), size=6, color=GREY,
                          textcoords="offset points", va="center", zorder=5, path_effects=HALO)  # fmt: skip


def arm(axes: Axes, tail: np.ndarray, tip: np.ndarray, i: int, zorder: float = 1) -> None:
    """An arrow along body axis i from tail to tip (2,), with the axis's name."""
    arrow(axes, tail, tip, GREY, zorder)
    beyond = 6 * tip / max(float(np.hypot(*tip)), math.ulp(0))
    axes.annotate(f"$x_{i + 1}$", pair(tip), pair(beyond), textcoords="offset points", ha="center", va="center",
                  zorder=7, path_effects=HALO)  # fmt: skip


def projection(axes: Axes, motions: Sequence[Motion], spec: Mapping[str, Any], plane: str) -> None:
    """The hodographs projected onto the plane of two body axes."""
    i, j = int(plane[1]) - 1, int(plane[3]) - 1
    for place, motion in enumerate(motions):
        points = motion.G[:, [i, j]]
        plane_curve(axes, points, *palette(motion, spec["colour"], place), 0.8 * line_width(motion))
        mark(axes, points[[0, -1]], motion.at_crossings(points), everywhere)
    axes.autoscale_view()
    axes.set(xlabel=axis_label(f"G.x{i + 1}", motions[0]), ylabel=axis_label(f"G.x{j + 1}", motions[0]), aspect="equal")


def everywhere(points: np.ndarray) -> np.ndarray:
    """True for every point (n, 2)."""
    return np.ones(len(points), dtype=bool)


def time_bar(sheet: Sheet, panels: list[Axes], motion: Motion, spec: Mapping[str, Any]) -> None:
    """The colour bar of a curve that is coloured by time."""
    hues = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 256)))
    scale = ScalarMappable(Normalize(motion.time[0], motion.time[-1]), hues)
    bar = sheet.figure.colorbar(scale, ax=panels, location="bottom", fraction=0.03, pad=0.02, shrink=0.6, aspect=50)
    bar.set_label(time_label(spec, motion))


@kind("sphere")
def sphere(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """The curves of G/|G| on the unit sphere, with the two separatrix circles."""
    motions, view = results.motions(spec), View.toward(spec["view"])
    sheet.figure.set_size_inches(COLUMN, 1.08 * COLUMN)
    axes = sheet.figure.subplots()
    axes.add_patch(Circle((0, 0), 1, fc="#F8F8F8", ec=GREY, lw=0.6, zorder=1.1))
    for line in graticule():
        on_sphere(axes, view(line), color="#C8C8C8", lw=0.35)
    for circle in separatrix_circles(motions[0].inertia):
        on_sphere(axes, view(circle), **SEPARATRIX)
    for i, (tip, foot) in enumerate(zip(view(1.2 * np.eye(3)), view(np.eye(3)), strict=True)):
        arm(axes, foot[:2], tip[:2], i, zorder=5 if foot[2] > 0 else 1)
    directions = [unit_vectors(motion) for motion in motions]
    for place, (motion, direction) in enumerate(zip(motions, directions, strict=True)):
        g1, g2, g3 = direction.T
        sheet.record("sphere", motion.label, time=motion.time, **{"G.x1/|G|": g1, "G.x2/|G|": g2, "G.x3/|G|": g3})
        seen, (colours, code) = view(direction), palette(motion, spec["colour"], place)
        for piece in stretches(code):
            on_sphere(axes, seen[piece], color=colours[code[piece.start]], lw=1.1)
        heading(axes, seen[:, :2], colours[code[0]], 0.15)
        axes.plot(*seen[0, :2], **START, alpha=1 if seen[0, 2] > 0 else 0.4, zorder=6)
    for motion, free in zip(motions, freest([view(direction) for direction in directions]), strict=True):
        axes.text(*pair(free), motion.label, ha="center", va="center", zorder=8, path_effects=HALO)
    axes.set(xlim=(-1.24, 1.24), ylim=(-1.12, 1.28), aspect="equal")
    axes.set_axis_off()
    handles = axis_handles(motions) if spec["colour"] == "axis" else []
    handles += [Line2D([], [], **SEPARATRIX, label="separatrix, $D = 0$"), Line2D([], [], **START, label="start")]
    if spec["colour"] == "time":
        time_bar(sheet, [axes], motions[0], spec)
    legend(sheet, handles, 2)


def unit_vectors(motion: Motion) -> np.ndarray:
    """G/|G| (n, 3), nan where the body is at rest."""
    size = motion["G_norm"][:, None]
    return np.asarray(motion.G / np.where(size > 0, size, np.nan))


def on_sphere(axes: Axes, seen: np.ndarray, **style: Any) -> None:
    """A curve in view (n, 3) on the sphere, faint on the far side."""
    for piece in stretches(seen[:, 2] >= 0):
        front = seen[piece.start, 2] >= 0
        axes.plot(seen[piece, 0], seen[piece, 1], **style, alpha=1 if front else 0.35, zorder=3 if front else 2)


# Plane figures


def squares(motion: Motion) -> np.ndarray:
    """(w_l^2, K w_s^2) (n, 2): the separatrix is the diagonal, and D > 0 below it. Raises HodoError where K is inf."""
    K = slope(motion.inertia)
    if math.isinf(K):
        raise HodoError(f"case {motion.name} has no quadrants to draw: its two larger moments of inertia are equal")
    largest, _, smallest = motion.order
    return np.asarray(motion.data["omega"].values[:, [largest, smallest]] ** 2 * [1, K])


@kind("quadrants")
def quadrants(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """p^2 against K r^2, with the regions A (D > 0) and B (D < 0)."""
    motions, zoom = results.motions(spec), spec["zoom"]
    points = {motion.name: squares(motion) for motion in motions}
    for motion in motions:
        p, r = "pqr"[motion.order[0]], "pqr"[motion.order[2]]
        across, up = points[motion.name].T
        sheet.record("quadrants", motion.label, time=motion.time, **{f"{p}^2": across, f"K {r}^2": up})
    others = [results.motion(name) for figure in spec["scale_with"] for name in results.figure(figure)["cases"]]
    limits = [1.05 * max(float(each.max()) for each in [*points.values(), *map(squares, others)]) or 1.0]
    limits += [] if zoom is None else [zoom]
    sheet.figure.set_size_inches(*((COLUMN, 1.1 * COLUMN) if zoom is None else (PAGE, 0.58 * PAGE)))
    panels = sheet.figure.subplots(1, len(limits), squeeze=False)[0]
    for axes, limit in zip(panels, limits, strict=True):
        regions(axes, motions[0], limit)
        for place, motion in enumerate(motions):
            curve = points[motion.name]
            plane_curve(axes, curve, *palette(motion, "axis", place), 0.8 * line_width(motion))
            on_line = np.repeat(motion.at_crossings(curve).mean(axis=-1, keepdims=True), 2, axis=-1)
            mark(axes, curve[[0, -1]], on_line, lambda at: at.max(axis=-1) <= limit)  # noqa: B023
    if zoom is not None:
        panels[1].set(title="enlarged")
    wide = zoom is not None
    legend(sheet, axis_handles(motions, both=True) + mark_handles(motions, spec["time"], wide), 5 if wide else 3)


def regions(axes: Axes, motion: Motion, limit: float) -> None:
    """The regions A and B below and above the diagonal, shaded and named, up to a limit."""
    largest, _, smallest = motion.order
    axes.add_patch(Polygon([(0, 0), (limit, limit), (limit, 0)], fc=AXIS_COLOUR[largest + 1], alpha=0.1, lw=0))
    axes.add_patch(Polygon([(0, 0), (limit, limit), (0, limit)], fc=AXIS_COLOUR[smallest + 1], alpha=0.1, lw=0))
    axes.plot([0, limit], [0, limit], color=BLACK, lw=0.7)
    place: Look = {"xycoords": "axes fraction", "size": 9, "path_effects": HALO, "zorder": 7}
    axes.annotate(f"A (about $x_{largest + 1}$)", (0.97, 0.04), ha="right", va="bottom", **place)
    axes.annotate(f"B (about $x_{smallest + 1}$)", (0.5, 0.96), ha="center", va="top", **place)
    p, r = "pqr"[largest], "pqr"[smallest]
    axes.set(xlabel=f"${p}^2$ {unit(motion, 'omega', 2)}", ylabel=f"$K{r}^2$ {unit(motion, 'omega', 2)}")
    axes.set(xlim=(0, limit), ylim=(0, limit), aspect="equal")


@kind("quadrant-sketch")
def quadrant_sketch(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """r^2 against p^2 for each body, with the line p^2 = K r^2, region A above it and B below, without scale."""
    bodies = spec["bodies"]
    sheet.figure.set_size_inches(*((COLUMN, COLUMN) if len(bodies) == 1 else (PAGE, PAGE / len(bodies) + 0.35)))
    panels = sheet.figure.subplots(1, len(bodies), squeeze=False)[0]
    for axes, body, label in zip_longest(panels, bodies, spec["labels"][: len(bodies)]):
        title = label or "$A_i$ = {:g}, {:g}, {:g}".format(*body)
        sheet.record(
            "sketch", title, **{f"A{i + 1}": np.array([A]) for i, A in enumerate(body)}, K=np.array([slope(body)])
        )
        sketch(axes, body)
        K = slope(body)
        value = r"\infty" if math.isinf(K) else f"{K:.3g}"
        axes.set_title(f"{title}\n$K = {value}$, slope ${math.degrees(math.atan(K)):.3g}°$")


def sketch(axes: Axes, body: Sequence[float]) -> None:
    """The quadrants of one body."""
    largest, _, smallest = rigid_body.inertia_order(body)
    end, above, below = sectors(slope(body))
    for name, outline, axis in (("A", above, largest), ("B", below, smallest)):
        axes.add_patch(Polygon(outline, fc=AXIS_COLOUR[axis + 1], alpha=0.12, lw=0))
        if centre := centroid(outline):
            axes.text(*centre, f"{name}\nabout $x_{axis + 1}$", ha="center", va="center")
    axes.plot([0, end[0]], [0, end[1]], color=BLACK, lw=1.4, clip_on=False)
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xticks=[], yticks=[])
    axes.set_xlabel(f"${'pqr'[smallest]}^2$", loc="right")
    axes.set_ylabel(f"${'pqr'[largest]}^2$", loc="top", rotation=0)
    axes.spines[["top", "right"]].set_visible(False)


@kind("series")
def series(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """Variables against time, a panel for each variable or for each case."""
    motions, variables = results.motions(spec), spec["variables"]
    by_case = spec["panels"] == "case"
    if by_case:
        groups = {motion.name: [(motion, name) for name in variables] for motion in motions}
        names = [f"${symbol(name)}$" for name in variables]
    else:
        groups = {name: [(motion, name) for motion in motions] for name in variables}
        names = [motion.label for motion in motions]
    if spec["inset"] and spec["inset"]["panel"] not in groups:
        raise HodoError(f"the inset's panel {spec['inset']['panel']!r} is none of the panels ({', '.join(groups)})")
    for axes, (group, curves) in zip(series_panels(sheet, spec, len(groups)), groups.items(), strict=True):
        for (motion, name), style in zip(curves, styles(len(curves)), strict=True):
            part = slice(None) if spec["span"] is None else slice(*np.searchsorted(motion.time, spec["span"]))
            times, values = motion.time[part], motion[name][part]
            sheet.record(group, motion.label, time=times, **{name: values})
            axes.plot(times, values, **style)
            event_marks(axes, motion, name, spec["time"])
        axes.margins(x=0, y=0.08)
        if spec["level"] is not None:
            axes.axhline(spec["level"], **SEPARATRIX)
        axes.set(**({"title": curves[0][0].label} if by_case else {"ylabel": axis_label(group, motions[0])}))
        if axes.get_subplotspec().is_last_row():  # type: ignore[union-attr]
            axes.set_xlabel(time_label(spec, motions[0]))
        if spec["inset"] and spec["inset"]["panel"] == group:
            inset(sheet, axes, spec["inset"], results, dict(zip(variables, styles(len(variables)), strict=True)))
    if len(names) > 1:
        room = sheet.figure.get_figwidth() * 72 / (30 + 4 * max(len(re.sub(r"[${}\\]", "", name)) for name in names))
        legend(sheet, case_handles(names), max(1, min(int(room), len(names))))


def series_panels(sheet: Sheet, spec: Mapping[str, Any], n: int) -> list[Axes]:
    """n panels in rows of `columns`; those of cases share both scales."""
    columns = min(n, spec["columns"])
    rows = -(-n // columns)
    width = COLUMN if columns == 1 else PAGE
    sheet.figure.set_size_inches(width, rows * max(0.62 * width / columns, 1.4) + 0.3)
    by_case = spec["panels"] == "case"
    grid = sheet.figure.subplots(rows, columns, sharex=True, sharey=by_case, squeeze=False).ravel()
    for spare in grid[n:]:
        spare.remove()
    return list(grid[:n])


def event_marks(axes: Axes, motion: Motion, name: str, time: str) -> None:
    """Mark the events of a motion on a curve: with the value there, or with the time where that is nearly zero."""
    values = motion[name]
    peak = np.abs(values).max()
    for when in motion.event_time:
        value = float(np.interp(when, motion.time, values))
        text = f"${value:.4g}$" if abs(value) > 1e-3 * peak else f"${time} = {when:.4g}$"
        below = value > 0.9 * peak
        axes.plot(when, value, **END, clip_on=False, zorder=5)
        early = when - motion.time[0] < 0.4 * (motion.time[-1] - motion.time[0])
        axes.annotate(text, (when, value), (3 if early else -3, -4 if below else 4), textcoords="offset points", size=7,
                      ha="left" if early else "right", va="top" if below else "bottom")  # fmt: skip


def inset(
    sheet: Sheet, panel: Axes, spec: Mapping[str, Any], results: Results, looks: Mapping[str, dict[str, Any]]
) -> None:
    """A smaller panel within a panel: some variables of one case."""
    motion = results.motion(spec["case"])
    axes = panel.inset_axes(spec["box"])
    for name, look in zip(spec["variables"], styles(len(spec["variables"])), strict=True):
        axes.plot(motion.time, motion[name], **looks.get(name, look), lw=0.9)
        sheet.record("inset", motion.name, time=motion.time, **motion.columns(name))
    axes.set_title(", ".join(f"${symbol(name)}$" for name in spec["variables"]), size=7, pad=2)
    axes.tick_params(labelsize=6)
    axes.margins(x=0)


@kind("phase")
def phase(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """One variable against another."""
    motions, x, y = results.motions(spec), spec["x"], spec["y"]
    sheet.figure.set_size_inches(COLUMN, 0.9 * COLUMN)
    axes = sheet.figure.subplots()
    for motion, style in zip(motions, styles(len(motions)), strict=True):
        across, up = motion[x], motion[y]
        sheet.record("phase", motion.label, time=motion.time, **{x: across, y: up})
        axes.plot(across, up, **style)
        points = np.stack([across, up], axis=-1)
        mark(axes, points[[0, -1]], motion.at_crossings(points), everywhere)
    axes.set(xlabel=axis_label(x, motions[0]), ylabel=axis_label(y, motions[0]))
    axes.margins(0.06)
    handles = case_handles([motion.label for motion in motions]) if len(motions) > 1 else []
    legend(sheet, handles + mark_handles(motions, spec["time"]), 2)


@kind("invariants")
def invariants(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """T, G^2 and D/2T against time, with the bounds that the body sets and, for diagonal damping, those of G^2."""
    motions = results.motions(spec)
    sheet.figure.set_size_inches(COLUMN, 1.75 * COLUMN)
    energy, square, ratio = sheet.figure.subplots(3, sharex=True)
    for motion, style in zip(motions, styles(len(motions)), strict=True):
        shown = motion.columns("T", "G2", "D/2T")
        sheet.record("invariants", motion.label, time=motion.time, **shown, D=motion["D"])
        for axes, values in zip((energy, square, ratio), shown.values(), strict=True):
            axes.plot(motion.time, values, **style, zorder=3)
        energy_bounds(energy, square, motion)
        middle = sorted(motion.inertia)[1]
        ratio.axhspan(0, max(motion.inertia) - middle, fc=AXIS_COLOUR[motion.order[0] + 1], alpha=0.1, lw=0)
        ratio.axhspan(min(motion.inertia) - middle, 0, fc=AXIS_COLOUR[motion.order[2] + 1], alpha=0.1, lw=0)
        crossings = np.stack([motion.crossing_time, 0 * motion.crossing_time], axis=-1)
        ratio.plot(*crossings.T, **CROSSING, zorder=4)
    ratio.axhline(0, **SEPARATRIX)
    for axes, name in ((energy, "T"), (square, "G2"), (ratio, "D/2T")):
        axes.set(ylabel=axis_label(name, motions[0]))
        axes.margins(x=0)
    for axes in (energy, square):
        low, high = (f(float(f(line.get_ydata())) for line in axes.lines) for f in (min, max))
        axes.set(**({"yscale": "log"} if high > 10 * low > 0 else {"ylim": (0, 1.15 * high or 1.0)}))
    ratio.set_xlabel(time_label(spec, motions[0]))
    handles = case_handles([motion.label for motion in motions]) if len(motions) > 1 else []
    bound = Line2D([], [], color=GREY, lw=0.5, label="bounds")
    legend(sheet, [*handles, bound, *mark_handles(motions, spec["time"])[2:]], 2)


def energy_bounds(energy: Axes, square: Axes, motion: Motion) -> None:
    """T between G^2/2A_largest and G^2/2A_smallest; G^2 between its exponentials where the damping is diagonal."""
    G2 = motion["G2"]
    for A in (min(motion.inertia), max(motion.inertia)):
        energy.plot(motion.time, G2 / (2 * A), color=GREY, lw=0.5)
    for rate in {f(motion.case.data.get("damping", [math.nan])) for f in (min, max)}:
        bound = G2[0] * np.exp(-2 * rate * (motion.time - motion.time[0]))
        square.plot(motion.time, bound, color=GREY, lw=0.5)


# Sweeps

GAP = "#E4E4E4"


@kind("map")
def sweep_map(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """A variable of sweeps over two axes, or over the directions of the start, a panel for each position asked for."""
    sweeps = [Swept.of(name, results.cases) for name in spec["cases"]]
    rows = [[(swept, at) for at in positions(swept, spec)] for swept in sweeps]
    flat = spec["x"] is None or spec["y"] is None
    cells = [cell for row in rows for cell in row]
    most = max(map(len, rows))
    columns = most if len(rows) > 1 and most > 1 else 2 if len(cells) == 4 else min(len(cells), 3)
    lines = -(-len(cells) // columns)
    width = COLUMN if columns == 1 else PAGE
    sheet.figure.set_size_inches(width, lines * width / columns * (0.6 if flat else 0.85) + 0.55)
    panels = sheet.figure.subplots(lines, columns, squeeze=False, sharex=not flat, sharey=not flat)
    values = [map_values(swept, spec, at) for swept, at in cells]
    every = np.concatenate([value.ravel() for value in values])
    scale = Normalize(*(spec["range"] or (np.nanmin(every), np.nanmax(every))))
    for spare in panels.ravel()[len(cells) :]:
        spare.remove()
    labels = [*spec["labels"], *[""] * len(cells)]
    for axes, (swept, at), value, label in zip(panels.ravel(), cells, values, labels, strict=False):
        title = label or ", ".join(swept.at(name, i) for name, i in at.items())
        (map_sphere if flat else map_image)(sheet, axes, swept, spec, value, scale, title)
        axes.set_title(title)
    hues = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 256)))
    bar = sheet.figure.colorbar(ScalarMappable(scale, hues), ax=sheet.figure.axes, location="bottom", fraction=0.04,
                                pad=0.02, shrink=0.7, aspect=45)  # fmt: skip
    bar.set_label(map_label(sweeps[0], spec["variable"]))
    if flat:
        gap = [Patch(fc=GAP, ec=GREY, lw=0.4, label="none")] if np.isnan(every).any() else []
        legend(sheet, [Line2D([], [], **SEPARATRIX, label="$D = 0$"), *gap], 2)


def positions(swept: Swept, spec: Mapping[str, Any]) -> list[dict[str, int]]:
    """The positions on the axis of panels, one panel each."""
    if spec["panels"] is None:
        return [{}]
    n = len(swept.axis(spec["panels"]))
    for i in spec["at"]:
        if i >= n:
            raise HodoError(f"axis {spec['panels']} of sweep {swept.case.name} has positions 0 to {n - 1}, not {i}")
    return [{spec["panels"]: i} for i in spec["at"] or range(n)]


def map_values(swept: Swept, spec: Mapping[str, Any], at: Mapping[str, int]) -> np.ndarray:
    """What one panel shows: (x, y), or (directions,). Raises HodoError if there is nothing but gaps."""
    if spec["x"] is None or spec["y"] is None:
        keep = [swept.sphere()]
        if not keep[0]:
            raise HodoError(f"sweep {swept.case.name} has no sphere: name the axes x and y")
    else:
        keep = [swept.axis(spec[name]).name for name in ("x", "y")]
    values = swept.values(spec["variable"], keep, at)
    if not np.isfinite(values).any():
        raise HodoError(f"sweep {swept.case.name} has no value of {spec['variable']} to draw")
    return values


def map_image(
    sheet: Sheet, axes: Axes, swept: Swept, spec: Mapping[str, Any], values: np.ndarray, scale: Normalize, title: str
) -> None:
    """An image over two axes; white where there is no value."""
    (x, even_x), (y, even_y) = swept.ticks(spec["x"]), swept.ticks(spec["y"])
    across, up = (each.ravel() for each in np.meshgrid(x, y, indexing="ij"))
    sheet.record(swept.case.name, title, **{spec["x"]: across, spec["y"]: up, spec["variable"]: values.ravel()})
    hues = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 256)))
    axes.pcolormesh(edges(x, even_x), edges(y, even_y), values.T, norm=scale, cmap=hues, rasterized=True)
    if spec["level"] is not None and min(values.shape) > 1:
        axes.contour(x, y, values.T, [spec["level"]], colors="white", linewidths=0.9)
    axes.set(xscale="log" if even_x else "linear", yscale="log" if even_y else "linear")
    subplot = axes.get_subplotspec()
    if subplot is None or subplot.is_last_row():
        axes.set_xlabel(f"${swept.symbol(spec['x'])}$")
    if subplot is None or subplot.is_first_col():
        axes.set_ylabel(f"${swept.symbol(spec['y'])}$")


def map_sphere(
    sheet: Sheet, axes: Axes, swept: Swept, spec: Mapping[str, Any], values: np.ndarray, scale: Normalize, title: str
) -> None:
    """An equal-area map of the directions of G at the start, with the separatrix; grey where there is no value."""
    name = swept.sphere()
    directions = swept.axis(name).directions(np.arange(len(swept.axis(name))))
    g = dict(zip(("G.x1/|G|", "G.x2/|G|", "G.x3/|G|"), directions.T, strict=True))
    sheet.record(swept.case.name, title, **g, **{spec["variable"]: values})
    hues = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 256)))
    reach = (-math.sqrt(8), math.sqrt(8), -math.sqrt(2), math.sqrt(2))
    rim = Ellipse((0, 0), 2 * math.sqrt(8), 2 * math.sqrt(2), fc=GAP, ec=GREY, lw=0.6)
    axes.add_patch(rim)
    image = axes.imshow(hammer_image(directions, values, 360), origin="lower", extent=reach, norm=scale, cmap=hues,
                        interpolation="nearest", zorder=2)  # fmt: skip
    image.set_clip_path(rim)
    for circle in separatrix_circles(A) if (A := swept.body()) is not None else []:
        for piece in hammer_curve(circle):
            axes.plot(*piece.T, **SEPARATRIX, zorder=3)
    for i, direction in ((1, (1, 0, 0)), (2, (0, 1, 0)), (3, (0, 0, 1)), (2, (0, -1, 0)), (3, (0, 0, -1))):
        (point,) = hammer(np.array([direction], dtype=float))
        sign = "" if sum(direction) > 0 else "-"
        axes.plot(*point, "k.", ms=2.5, zorder=4)
        axes.annotate(f"${sign}x_{i}$", pair(point), (3, 3), textcoords="offset points", size=7, path_effects=HALO,
                      zorder=5)  # fmt: skip
    axes.set(xlim=(-2.9, 2.9), ylim=(-1.62, 1.62), aspect="equal")
    axes.set_axis_off()


def map_label(swept: Swept, variable: str) -> str:
    """What the colours of a map say."""
    name, _, part = variable.partition(".")
    said = str(swept.data[name].attrs.get("long_name", name))
    labels = str(swept.data[name].attrs.get("flag_meanings", "")).split()
    return f"share of members: {said} is {part}" if part in labels else f"{said}: {part}" if part else said


VERDICT_COLOUR = (GREEN, SKY, "#F0E442", "#BBBBBB", "#666666", RED)


def draw_bench(bench: "Bench") -> Sheet:
    """The figure of a bench: work against precision where there are several tolerances, else the map of verdicts."""
    with matplotlib.style.context(["default", STYLE]):
        sheet = Sheet(Figure(layout="constrained"))
        (work_precision if len(bench.tols) > 1 else status_map)(sheet, bench)
    return sheet


def work_precision(sheet: Sheet, bench: "Bench") -> None:
    """Error against run time, a panel per case and a line per method; each point is a tolerance."""
    columns = min(3, len(bench.cases))
    rows = -(-len(bench.cases) // columns)
    sheet.figure.set_size_inches(PAGE, 1.8 * rows + 0.4)
    panels = sheet.figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    error, time, status = (bench.values(name) for name in ("error", "run_time", "status"))
    for i, (axes, case) in enumerate(zip(panels, bench.cases, strict=False)):
        for j, (method, style) in enumerate(zip(bench.methods, styles(len(bench.methods)), strict=True)):
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
    sheet.figure.supylabel("largest relative error (dashed: what one ulp in the data makes)", fontsize=8)
    handles = [Line2D([], [], marker="o", ms=2, **style) for style in styles(len(bench.methods))]
    sheet.figure.legend(handles, bench.methods, loc="outside upper center", ncols=len(bench.methods))


def status_map(sheet: Sheet, bench: "Bench") -> None:
    """What every method makes of every case, with its error."""
    status, error = bench.values("status")[:, :, 0], bench.values("error")[:, :, 0]
    sheet.figure.set_size_inches(PAGE, 0.14 * len(bench.cases) + 1)
    axes = sheet.figure.subplots()
    code = np.vectorize(bench.verdicts.index)(status)
    axes.imshow(code, cmap=ListedColormap(VERDICT_COLOUR), vmin=-0.5, vmax=len(VERDICT_COLOUR) - 0.5, aspect="auto")
    for (i, j), value in np.ndenumerate(error):
        if np.isfinite(value):
            axes.text(j, i, f"{value:.0e}" if value else "0", ha="center", va="center", fontsize=4.5)
    axes.set_xticks(range(len(bench.methods)), bench.methods)
    axes.set_yticks(range(len(bench.cases)), bench.cases, fontsize=5.5)
    axes.tick_params(length=0, labeltop=True, labelbottom=False)
    for case, row in zip(bench.cases, code, strict=True):
        sheet.record(case, "verdict", **{name: row[[j]] for j, name in enumerate(bench.methods)})
    handles = [Line2D([], [], ls="", marker="s", color=colour) for colour in VERDICT_COLOUR]
    sheet.figure.legend(handles, bench.verdicts, loc="outside lower center", ncols=3)
