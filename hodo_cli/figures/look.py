"""A figure under construction: its panels, its legend and the record of what it shows, with the
colours and marks that all kinds share. The style is matplotlib's own, from `hodo.mplstyle`."""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .. import HodoError
from ..quantities import symbol
from ..results.motion import Motion, units_in_words
from ..schema.spelling import unknown
from ..text import time_digits, time_text
from .between import Course
from .words import Layout, LogNumbers, Words, without_tex, wrapped

Look = dict[str, Any]

STYLE_SHEET = Path(__file__).with_name("hodo.mplstyle")
COLUMN, PAGE = 84 / 25.4, 174 / 25.4
"""Widths of a journal's column and page, inches."""

LEAST_PANEL = 40 / 25.4
"""The least width of a panel with its words, inches: two fit into a column."""

SCREEN = 150
"""Dots per inch in a notebook."""

NOT_CLASSIFIED = -2

# The palette of Okabe and Ito, its orange and sky darker, for a contrast of 3 to 1 on white.
COLOURS = {
    "blue": "#0072B2", "orange": "#BF8200", "green": "#009E73", "sky": "#2E8FCB",
    "red": "#D55E00", "purple": "#CC79A7", "black": "#000000", "grey": "#8A8A8A",
}  # fmt: skip
LINES: dict[str, Any] = {"": "-", "solid": "-", "dashed": (0, (5, 1.5)), "dotted": (0, (1, 1))}
GREY = "#666666"
AXIS_LOOKS = {
    1: ("#0072B2", "about $x_1$"), 2: ("#009E73", "about $x_2$"), 3: ("#BF8200", "about $x_3$"),
    0: ("#555555", "separatrix"),
    -1: ("#8A8A8A", "undetermined"), NOT_CLASSIFIED: ("#000000", "not classified"),
}  # fmt: skip
"""The colour of each enclosed axis, in every figure, and its words."""

START: Look = {"ls": "", "marker": "o", "ms": 4, "mfc": "white", "mec": "black", "mew": 0.6}
END: Look = {"ls": "", "marker": "s", "ms": 2.8, "mfc": "black", "mec": "black", "mew": 0.6}
CROSSING: Look = {"ls": "", "marker": "D", "ms": 3.6, "mfc": "#F0E442", "mec": "black", "mew": 0.6}
SEPARATRIX: Look = {"color": "black", "lw": 0.7, "ls": (0, (3.2, 2.1))}

TIME_COLOURS = ListedColormap(matplotlib.colormaps["plasma"](np.linspace(0, 0.63, 64)))
"""The colours of a curve by time, without the bright ones, which white paper hides."""


class Drawing(Figure):
    """A figure with its own parameters of matplotlib, wherever it is drawn and saved. A notebook
    shows it as an image or, if the body moves, as the page that plays."""

    page: Any = None
    film: Any = None
    """The functions that make the page that plays, and the film, of a figure that moves."""

    def __init__(self) -> None:
        super().__init__(layout=Layout(w_pad=0.04, h_pad=0.06, wspace=0.04))
        self.parameters = matplotlib.rcParams.copy()

    def styled(self) -> AbstractContextManager[None]:
        """The context in which the figure's own parameters apply."""
        return matplotlib.rc_context(self.parameters)

    def draw(self, renderer: Any) -> None:
        with self.styled():
            super().draw(renderer)

    def savefig(self, fname: Any, **keys: Any) -> None:
        """Save as matplotlib does; a moving figure becomes a film under a name that ends with
        .gif."""
        with self.styled():
            if self.film and str(fname).endswith(".gif"):
                self.film(Path(fname))
            else:
                super().savefig(fname, **keys)

    def _repr_png_(self) -> bytes:
        image = io.BytesIO()
        self.savefig(image, format="png", dpi=SCREEN)
        return image.getvalue()

    def _repr_html_(self) -> str | None:
        if not self.page:
            return None
        source, size = escape(self.page()), 'width="560" height="640" style="border: 0"'
        return f'<iframe srcdoc="{source}" {size} title="moving body"></iframe>'


@dataclass
class Sheet:
    """A figure being drawn: its entry of a case file, the entries of its legend besides labelled
    lines, a record of every value that it shows, the scene of its viewer, the units of recorded
    quantities, and the motions of other figures with which it shares its scale."""

    spec: Mapping[str, Any]
    figure: Drawing = field(default_factory=Drawing)
    handles: list[Any] = field(default_factory=list)
    table: list[tuple[str, dict[str, np.ndarray]]] = field(default_factory=list)
    scene: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    others: Sequence[Motion] = ()

    @property
    def view(self) -> np.ndarray:
        """The directions right, up and toward the reader (3, 3), from elevation and azimuth."""
        e, a = np.radians(self.spec.get("view", (0, 0)))
        se, ce, sa, ca = math.sin(e), math.cos(e), math.sin(a), math.cos(a)
        return np.array([(-sa, ca, 0), (-se * ca, -se * sa, ce), (ce * ca, ce * sa, se)])

    def columns(self, most: int) -> int:
        """How many panels, at most `most`, fit side by side."""
        return max(1, min(most, int(self.width(PAGE) / LEAST_PANEL)))

    def width(self, usual: float) -> float:
        """The width in inches that the style of the figure sets, else the given one."""
        given = self.spec["style"].get("width")
        named = {"column": COLUMN, "page": PAGE, None: usual}
        return float(named[given] if given in named else given / 25.4)

    def panels(
        self, row: float, n: int = 1, columns: int = 1, more: float = 0, **grid: Any
    ) -> list[Axes]:
        """n panels in rows of `columns`, in a figure as wide as a column or, with several columns,
        a page. `row` is the height of a row in inches; the figure is higher by `more`."""
        style, rows = self.spec["style"], math.ceil(n / columns)
        usual = usual_width(columns)
        width, height = self.width(usual), rows * row + more + 0.2 * bool(self.spec["title"])
        height = style["height"] / 25.4 if "height" in style else height * width / usual
        self.figure.set_size_inches(width, height)
        axes = [*self.figure.subplots(rows, columns, squeeze=False, **grid).ravel()]
        for spare in axes[n:]:
            spare.remove()
        for lowest in axes[max(0, n - columns) : n]:
            # Matplotlib leaves out the numbers of a panel above an empty place.
            lowest.tick_params(labelbottom=True)
        return axes[:n]

    def record(self, curve: str, columns: Mapping[str, Any]) -> None:
        """Note the values (n,) of a curve by the names of their quantities; values of the same
        samples are added to those noted before."""
        for name, known in self.table:
            shared = known.keys() & columns.keys()
            same = (np.array_equal(known[x], columns[x], equal_nan=True) for x in shared)
            if name == curve and shared and all(same):
                known |= columns
                return
        self.table.append((curve, dict(columns)))

    def record_vector(
        self, m: Course, values: np.ndarray, names: Iterable[str], label: str = ""
    ) -> None:
        """Note a vector (n, k) of the samples of a motion by the names of its components."""
        columns = dict(zip(names, values.T, strict=True))
        self.record(label or m.label, {"time": m.samples.time, **columns})

    def name(self, label: str, **look: Any) -> None:
        """Add an entry to the legend: a line or a mark of this look."""
        self.handles.append(Line2D([], [], **look, label=label))

    def stroke(self, points: Any, colour: Any, time: np.ndarray | None = None, **kind: Any) -> None:
        """Add a line, mark, arrow or face (n, 3) to the scene of the viewer, without points that
        are nan. `kind` holds its further properties, such as `of`, whose axes its points have."""
        places = np.asarray(points, float)
        finite = np.isfinite(places).all(axis=-1)
        size = float(np.abs(places[finite]).max(initial=0)) or 1.0
        # Five digits, in any units.
        kind["points"] = places[finite].round(5 - math.floor(math.log10(size))).tolist()
        if time is not None:
            kind["time"] = time[finite].tolist()
        self.scene.setdefault("strokes", []).append({"colour": to_hex(colour), **kind})

    def csv(self) -> str:
        """A row for each sample of each curve, a column for each quantity with its units; a missing
        value leaves a cell empty."""
        names = dict.fromkeys(name for _, columns in self.table for name in columns)
        heads = {x: f"{x} [{of}]" for x, of in self.units.items() if x in names and of != "1"}
        text = io.StringIO()
        writer = csv.DictWriter(text, ["curve", *names], restval="", lineterminator="\n")
        writer.writerow({"curve": "curve", **dict(zip(names, names, strict=True)), **heads})
        for curve, columns in self.table:
            name = without_tex(curve)
            # A spreadsheet would compute a text that begins with one of these signs.
            first = {"curve": f"'{name}" if name[:1] in "=+-@" else name}
            for row in zip(*(np.asarray(c).tolist() for c in columns.values()), strict=True):
                writer.writerow(first | dict(zip(columns, row, strict=True)))
        return text.getvalue()

    def finish(self) -> None:
        """Set the properties of the panels that the style gives, and add the title and the
        legend."""
        panels = [axes for axes in self.figure.axes if axes.get_subplotspec() is not None]
        for axes in panels:
            try:
                axes.set(**self.spec["style"].get("axes", {}))
            except (AttributeError, TypeError, ValueError) as error:
                raise HodoError(f"style: axes: {str(error).splitlines()[0]}") from None
            for axis in (axes.xaxis, axes.yaxis):
                if axis.get_scale() == "log":
                    axis.set_major_formatter(LogNumbers())
                    axis.set_minor_formatter(LogNumbers(minor_thresholds=(1.5, 0.4)))
        across = int(self.figure.get_figwidth() * 18)
        if self.spec["title"]:
            self.figure.suptitle(wrapped(self.spec["title"], across))
        lines = [line for axes in panels for line in axes.get_lines()]
        named = [(str(handle.get_label()), handle) for handle in (*lines, *self.handles)]
        # Of equal labels the first counts.
        entries = {label: h for label, h in reversed(named) if label and label[0] != "_"}
        if entries:
            self.add_legend([*reversed(entries.values())], across)

    def add_legend(self, handles: list[Any], across: int) -> None:
        """Add a legend below the panels, in as many columns as fit into a width in letters."""
        for handle in handles:
            handle.set_label(wrapped(str(handle.get_label()), across - 8))
        texts = [without_tex(str(handle.get_label())).splitlines() for handle in handles]
        # A line with its gaps is some ten letters wide.
        wide = [10 + max(map(len, lines)) for lines in texts]
        widths = {n: sum(max(wide[i::n]) for i in range(n)) for n in range(1, len(wide) + 1)}
        most = max((n for n, width in widths.items() if width <= 1.3 * across), default=1)
        columns = math.ceil(len(wide) / math.ceil(len(wide) / most))
        # matplotlib fills column by column.
        ordered = [handle for column in range(columns) for handle in handles[column::columns]]
        if "height" not in self.spec["style"]:
            lines = sum(max(map(len, texts[i : i + columns])) for i in range(0, len(wide), columns))
            self.figure.set_figheight(self.figure.get_figheight() + 0.14 * lines)
        place: Look = {"loc": "outside lower center", "ncols": columns, "columnspacing": 1.2}
        self.figure.legend(handles=ordered, **place)


def usual_width(columns: int) -> float:
    """The width in inches of a figure with these columns of panels, if its style sets none."""
    return COLUMN if columns == 1 else PAGE


def looks(n: int, names: Sequence[str] = (), solid: bool = False) -> list[Look]:
    """Colours and lines of n curves: first the named ones, such as "blue dashed", then the cycle of
    the style."""
    given: list[Look] = []
    for colour, _, line in (name.partition(" ") for name in names):
        if colour not in COLOURS or line not in LINES:
            wrong = f"style {f'{colour} {line}'.strip()!r}"
            raise HodoError(f"styles: {unknown(wrong, colour, [*COLOURS, *LINES])}")
        given.append({"color": COLOURS[colour], "ls": LINES[line]})
    cycle = [*matplotlib.rcParams["axes.prop_cycle"]]
    for number in range(len(given), n):
        # Each further round has the next line with a colour, so that no curve looks like another.
        turn, i = divmod(number, len(cycle))
        line = "-" if solid else cycle[(i + turn) % len(cycle)].get("linestyle", "-")
        given.append({"color": cycle[i].get("color", "black"), "ls": line})
    return given[:n]


def labels_of(m: Motion) -> np.ndarray:
    """The enclosed axis (n,), NOT_CLASSIFIED where `hodo classify` has not been run."""
    return m.labels if m.classified else np.full(len(m.time), NOT_CLASSIFIED)


def time_scale(motions: Sequence[Motion]) -> Normalize:
    """The scale of time from the first start of a motion to the last end, or stop, of one."""
    ends = [min(m.time[-1], m.stop) for m in motions]
    return Normalize(min(m.time[0] for m in motions), max(ends), clip=True)


def colours_of(
    motions: Sequence[Motion], spec: Mapping[str, Any]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """For each motion its colours (m, 3), and the index (n,) of the colour at each of its places.
    The colours show the time, the enclosed axis, or the case."""
    colour = spec.get("colour", "axis")
    if colour == "axis":
        labels = sorted(AXIS_LOOKS)
        palette = np.array([to_rgb(AXIS_LOOKS[label][0]) for label in labels])
        return [(palette, np.searchsorted(labels, labels_of(m))) for m in motions]
    if colour == "time":
        palette, scale = np.asarray(TIME_COLOURS.colors)[:, :3], time_scale(motions)
        return [(palette, (63 * scale(m.time)).astype(int)) for m in motions]
    ways = looks(len(motions), spec.get("styles", ()), solid=True)
    palettes = [np.array([to_rgb(way["color"])]) for way in ways]
    return [(p, np.zeros(len(m.time), int)) for m, p in zip(motions, palettes, strict=True)]


def colour_legend(
    sheet: Sheet, panels: Sequence[Axes], motions: Sequence[Motion], labels: Sequence[str] = ()
) -> None:
    """The entries of the colours in the legend, or the bar of colours by time; `labels` name the
    curves if their motions do not."""
    colour = sheet.spec.get("colour", "axis")
    if colour == "time":
        scale = matplotlib.cm.ScalarMappable(time_scale(motions), TIME_COLOURS)
        colour_bar(sheet, scale, panels, time_label(sheet.spec, motions[0]))
    elif colour == "case":
        ways = looks(len(motions), sheet.spec.get("styles", ()), solid=True)
        for label, way in zip(labels or [m.label for m in motions], ways, strict=True):
            sheet.name(label, **way)
    else:
        # A body at rest goes round no axis, and draws no curve.
        moving = [labels_of(m)[(m.time <= m.stop) & m.G.any(axis=1)] for m in motions]
        # These axes differ from the drawn ones if a body is given by its full tensor of inertia.
        turned = any((m.principal_axes != np.eye(3)).any() for m in motions)
        about = "about principal axis" if turned else "about"
        for axis in sorted({*np.concatenate(moving).tolist()}, key=lambda x: (x < 1, x)):
            look, words = AXIS_LOOKS[axis]
            sheet.name(words.replace("about", about), color=look, lw=1.5)


def colour_bar(
    sheet: Sheet, scale: Any, panels: Sequence[Axes], label: str, arrows: str = "neither"
) -> Any:
    """The scale of the colours of some panels, below them, with arrows at the ends beyond which
    there are values: "neither", "min", "max" or "both"."""
    place: Look = {"location": "bottom", "fraction": 0.04, "pad": 0.02, "shrink": 0.7, "aspect": 45}
    bar = sheet.figure.colorbar(scale, ax=panels, panchor=False, extend=arrows, **place)
    bar.set_label(wrapped(label, int(sheet.figure.get_figwidth() * 17)))
    return bar


def pieces(*keys: np.ndarray) -> list[slice]:
    """The stretches of a curve on which all keys (n,) are constant; the last place of each is the
    first of the next."""
    table = np.stack(keys, axis=-1)
    cuts = (np.flatnonzero((table[1:] != table[:-1]).any(axis=-1)) + 1).tolist()
    return [slice(a, b + 1) for a, b in zip([0, *cuts], [*cuts, len(table)], strict=True)]


def curves(
    axes: Axes, motions: Sequence[Course], spec: Mapping[str, Any], points: Sequence[np.ndarray],
    size: float = 0,
) -> None:  # fmt: skip
    """Draw the curves (n, 2) of motions in a plane with their marks and, for several motions, their
    names; `size` is the size of a panel that shows only a part of them."""
    for m, values, (palette, code) in zip(motions, points, colours_of(motions, spec), strict=True):
        parts = pieces(code)
        lines = [values[part] for part in parts]
        colours = [palette[code[part.start]] for part in parts]
        look: Look = {"linewidths": 0.8 * width_of(m), "alpha": 0.85}
        axes.add_collection(LineCollection(lines, colors=colours, **look))
        marks(axes, values, m.at(m.crossing_time, values), size=size)
    axes.autoscale_view()
    name_curves(axes, names_beside(motions, spec), points)


def names_beside(motions: Sequence[Motion], spec: Mapping[str, Any]) -> list[str]:
    """The names of motions, if there are several whose colours do not show the case; else none."""
    is_named = len(motions) > 1 and spec.get("colour", "axis") != "case"
    return [m.label for m in motions] if is_named else []


def name_curves(
    axes: Axes, names: Sequence[str], points: Sequence[np.ndarray], colours: Sequence[Any] = ()
) -> None:
    """Write the names of curves (n, 2), each at one of some nine places of its curve that are far
    from other curves."""
    finite = [curve[np.isfinite(curve).all(axis=1)] for curve in points]
    thin = [curve[:: max(1, len(curve) // 200)] for curve in finite]
    for i in (i for i in range(len(names)) if len(thin[i])):
        others = np.concatenate([*thin[:i], *thin[i + 1 :], np.full((1, 2), 1e9)])
        apart = np.hypot(*(thin[i][:, None] - others).T).min(axis=0)
        places = thin[i][np.argsort(-apart, kind="stable")[: max(1, len(apart) // 4)]]
        colour = colours[i] if colours else "black"
        Words(axes, names[i], places[:: max(1, len(places) // 9)], color=colour)


def marks(
    axes: Axes, curve: np.ndarray, crossings: np.ndarray, reach: float = math.inf, size: float = 0
) -> None:
    """Mark the start, the end and the numbered crossings of a curve (n, 2), where no coordinate is
    beyond `reach`; `size` is the size of a panel that shows only a part of the curve."""
    for look, points in ((START, curve[:1]), (END, curve[-1:]), (CROSSING, crossings)):
        shown = points[(np.abs(points) <= reach).all(axis=1)]
        (line,) = axes.plot(*shown.T, **look, zorder=6, clip_on=reach < math.inf)
        # A mark may stick out of its panel; the layout would make room for it.
        line.set_in_layout(False)
    whole = float(np.ptp(curve, axis=0).max()) if reach == math.inf else 2 * reach
    number_marks(axes, crossings, NUMBER_ROOM * (size or whole))


def number_marks(axes: Axes, crossings: np.ndarray, room: float) -> None:
    """Number several crossings (n, 2) in time; those close together share one place."""
    numbered = np.isfinite(crossings).all(axis=1) & (len(crossings) > 1)
    together: dict[int, list[str]] = {}
    for i in np.flatnonzero(numbered).tolist():
        near = (j for j in together if np.abs(crossings[j] - crossings[i]).max() < room)
        together.setdefault(next(near, i), []).append(str(i + 1))
    for first, names in together.items():
        names[1:-1] = names[1:-1] if len(names) < 4 else ["..."]
        Words(axes, ", ".join(names), [crossings[first]], toward=(1, 1), size="x-small")


NUMBER_ROOM = 0.04
"""The distance of two marks, relative to a curve's size, below which they share a place for their
numbers."""


def mark_legend(sheet: Sheet, motions: Sequence[Motion]) -> None:
    """The entries of start, end and crossings in the legend."""
    m, tau = motions[0], sheet.spec.get("time") or "t"
    ends = {
        f"stop, ${tau} = {time_text(m.stop, m.case.time.start)}$" if m.stop < math.inf
        else f"end, ${tau} = {m.case.time.text(m.time[-1])}$"
        for m in motions
    }  # fmt: skip
    sheet.name("start", **START)
    sheet.name(ends.pop() + unit_of_time(m) if len(ends) == 1 else "end", **END)
    crossing_legend(sheet, motions)


def crossing_legend(sheet: Sheet, motions: Sequence[Motion]) -> None:
    """The entry of crossings in the legend, with their times for a single motion."""
    m, words = motions[0], "$D = 0$"
    if len(motions) == 1:
        # Zeros at the end of a number are kept: they show how accurate it is.
        digits = [(t, time_digits(t, m.case.time.start)) for t in m.crossing_time]
        texts = [f"{t:#.{n}g}".removesuffix(".") for t, n in digits]
        if len(texts) > 1:
            texts = [f"{text} ({i})" for i, text in enumerate(texts, 1)]
        texts[CROSSINGS_NAMED:] = ["..."] * (len(texts) > CROSSINGS_NAMED)
        words += f" at ${sheet.spec.get('time') or 't'}$ = {', '.join(texts)}{unit_of_time(m)}"
    if any(len(m.crossing_time) for m in motions):
        sheet.name(words, **CROSSING)


def unit_of_time(m: Motion) -> str:
    """The unit after a number of time; empty for a pure number."""
    return "" if m.units("time") == "1" else f" {m.units('time')}"


CROSSINGS_NAMED = 12
"""The most times of crossings in a legend, which grows by a line with every five."""


def width_of(m: Motion) -> float:
    """The width of the line of a motion: the longer the hodograph, the thinner."""
    size = max(float(np.abs(m.G).max()), math.ulp(0))
    length = np.linalg.norm(np.diff(m.G / size, axis=0), axis=-1).sum()
    return float(np.interp(length, [15, 120], [1.1, 0.5]) * matplotlib.rcParams["lines.linewidth"])


def check_zoom(zoom: float, nearest: float) -> None:
    """Raise HodoError if curves do not come near enough to the origin for a panel up to `zoom`."""
    if nearest >= zoom:
        raise HodoError(
            f"zoom: {zoom:g} shows nothing: the curves come no nearer to the origin than "
            f"{nearest:.4g}"
        )


def unit(m: Motion, name: str, power: int = 1) -> str:
    """The units of a variable in brackets, in TeX: a dash for a pure number, and empty if the unit
    of the moments of inertia is not known."""
    stated = m.units(name)
    if "inertia" in units_in_words(m, name) and m.case.inertia_unit == "1":
        return "[–]" if m.units("time") == "1" else ""
    if stated == "1":
        return "[–]"
    return f"[{raised(stated + (f'^{power}' if power > 1 else ''))}]"


def raised(units: str) -> str:
    """Units with their powers in TeX."""
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", units)


def axis_label(m: Motion, name: str) -> str:
    """The symbol and the units of a variable."""
    return f"${symbol(name)}$ {unit(m, name)}".rstrip()


def time_label(spec: Mapping[str, Any], m: Motion) -> str:
    """The symbol and the units of time."""
    return f"${spec.get('time') or 't'}$ {unit(m, 'time')}"


def check_units(motions: Iterable[Motion], name: str) -> None:
    """Raise HodoError if motions have a variable in different units: one scale has one unit."""
    units = {m.units(name): f"{m.units(name)!r} in {m.name}" for m in motions}
    if len(units) > 1:
        raise HodoError(f"{name} is in {' and '.join(units.values())}: one scale has one unit")
