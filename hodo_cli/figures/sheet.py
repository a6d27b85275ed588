"""A figure under construction, and how one is saved: as an image, a table or a film, or as a page
of its own, which needs no other file. In a page a reader turns what is in space, comes nearer, and
reads values with the pointer.

A page shows the figure as it is printed. Over each panel that shows space its script draws what the
panel's `Scene` has kept, from any side.
"""

import csv
import io
import json
import math
import warnings
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import cached_property, partial
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from .. import HodoError
from ..cases.figure_block import FILM_FORMATS
from ..results.motion import Motion
from ..storage import replacing
from .words import every_panel, keep_formulas, place_words, text_size, without_tex

Look = dict[str, Any]

SHEET_STYLE: Look = {
    "font.family": "STIXGeneral", "mathtext.fontset": "stix",
    # All sizes follow that of the font: `medium` is 8.4 points, `small` 7.
    "font.size": 8.4, "axes.labelsize": "medium", "axes.titlesize": "medium",
    "figure.titlesize": "medium", "legend.fontsize": "small", "xtick.labelsize": "small",
    "ytick.labelsize": "small",
    "axes.linewidth": 0.5, "lines.linewidth": 1.0, "xtick.direction": "in", "ytick.direction": "in",
    "xtick.top": True, "ytick.right": True, "xtick.major.width": 0.5, "ytick.major.width": 0.5,
    # 18 points of a line, at which no pattern of dashes ends within a dash.
    "legend.handlelength": 2.57, "legend.handletextpad": 0.43,
    "legend.frameon": False, "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-5, 5), "axes.formatter.use_mathtext": True, "savefig.dpi": 300,
    "svg.hashsalt": "hodo", "pdf.fonttype": 42,
    # Right above a panel: to look for ticks there, which it never has, takes as long as to draw it.
    "axes.titley": 1.0,
}  # fmt: skip

COLUMN, PAGE = 84 / 25.4, 174 / 25.4
"""Widths of a journal's column and page, inches."""

SCREEN = 150
"""Dots per inch in a notebook: half of print's, which is as sharp on a screen."""


@dataclass(frozen=True)
class DrawnCurve:
    """One curve of a figure: its name, and the values drawn."""

    curve: str
    values: dict[str, np.ndarray]


@dataclass(frozen=True)
class View:
    """An orthographic view, so that all axes have one scale, from an elevation above the x1 x2
    plane and an azimuth from x1, degrees."""

    angles: tuple[float, float]

    @cached_property
    def matrix(self) -> np.ndarray:
        """The directions right, up and toward the reader (3, 3), in body axes."""
        e, a = map(math.radians, self.angles)
        right = (-math.sin(a), math.cos(a), 0)
        up = (-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e))
        near = (math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e))
        return np.array([right, up, near])

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) in body axes as (right, up, toward the reader)."""
        return np.asarray(points @ self.matrix.T)


@dataclass(frozen=True)
class Scene:
    """What a panel shows of space, from a direction: it is printed in this view, and turned where a
    reader can turn it. It has the names of its coordinates; `reach` is where the panel ends on each
    axis, None if it shows all; a globe hides its far side."""

    axes: Axes
    view: View
    names: Sequence[str] = ()
    reach: float | None = None
    globe: bool = False
    strokes: list[dict[str, Any]] = field(default_factory=list)

    def add(
        self,
        points: np.ndarray,
        colours: np.ndarray | None = None,
        code: np.ndarray | None = None,
        texts: Sequence[str] = (),
        name: str = "",
        time: np.ndarray | None = None,
        **look: Any,
    ) -> np.ndarray:
        """Add a curve, marks or words in space; returns the points (n, 3) as they are seen.

        They are in colours[code], for colours (m, 3) and codes (n,), or in the colour of the look,
        which has the names of `Line2D`. Texts stand at the points of a line; the pointer tells
        those of marks, and the name and times (n,) of a curve that has them.
        """
        if colours is None:
            colours = np.array([to_rgb(look.get("mfc", look.get("color", "black")))])
        known = {"texts": texts, "name": name, "time": time, "look": look}
        self.strokes.append({"points": points, "colours": colours, "code": code, **known})
        return self.view(points)

    def shows(self, points: np.ndarray) -> np.ndarray:
        """Which points (n, 3) are within its reach, not before it or behind."""
        return np.asarray(np.abs(points).max(axis=-1) <= (self.reach or math.inf))

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) as places (n, 2) in the panel, nan for those that it does not show."""
        return np.where(self.shows(points)[:, None], self.view(points)[:, :2], np.nan)


class Drawing(Figure):
    """A figure with parameters of matplotlib of its own, in which it is drawn and saved wherever
    that is. A notebook shows it by itself, whatever backend it has: as an image, or moving."""

    parameters: Look = SHEET_STYLE
    film: Any = None
    """The `body.Film` of a figure that moves."""

    def styled(self) -> AbstractContextManager[None]:
        """The context in which the figure's own parameters count."""
        return matplotlib.style.context(["default", self.parameters])

    def draw(self, renderer: Any) -> None:
        """Draw the figure, its ticks too, which take their look when they are first drawn."""
        with self.styled():
            keep_formulas(renderer)
            super().draw(renderer)

    def _repr_html_(self) -> Any:
        return self.film and self.film.frame()

    def savefig(self, fname: Any, **keys: Any) -> None:
        """As matplotlib does; to a name that ends with .gif or .mp4, what moves as a film."""
        path = Path(fname) if isinstance(fname, str | Path) else Path()
        with self.styled():
            if self.film and (suffix := path.suffix[1:]) in FILM_FORMATS:
                self.film.write(path, suffix)
            else:
                super().savefig(fname, **keys)

    def _repr_png_(self) -> bytes:
        """The figure as PNG."""
        image = io.BytesIO()
        self.savefig(image, format="png", dpi=SCREEN)
        return image.getvalue()


MIN_PANEL_WIDTH = 40 / 25.4
"""The least width of a panel with its words, inches: four stand in a page, two in a column."""


LEAST_ROOM = np.array([3, 1])
"""The least width and height of a panel, in sizes of its letters: in a smaller one the numbers
along its sides are on each other."""


def have_room(panels: Sequence[Axes], size: np.ndarray) -> bool:
    """Whether the layout has left enough of a figure of a size (2,) in points for its panels."""
    placed = (axes for axes in panels if axes.get_subplotspec() is not None)
    least = LEAST_ROOM * text_size("font.size")
    return all((axes.get_position(original=True).size * size > least).all() for axes in placed)


def are_cut(fig: Figure) -> bool:
    """Whether panels of equal scales have words beyond the ends of their figure."""
    shaped = (axes for axes in fig.axes if axes.get_aspect() != "auto")
    boxes = [box for axes in shaped if (box := axes.get_tightbbox(for_layout_only=True))]
    return bool(Bbox.union([fig.bbox, *boxes]).bounds != fig.bbox.bounds)


def part_letters(panels: Sequence[Any]) -> None:
    """Let the letter of a panel that its title would cover, one wider than the panel, stand before
    the title."""
    for axes in panels:
        letter, title = axes._left_title.get_window_extent(), axes.title.get_window_extent()
        if letter.width > 0 and title.width > 0 and letter.x1 > title.x0:
            start = title.x0 - letter.width - axes.title.get_fontsize() * axes.figure.dpi / 144
            axes._left_title.set_x((start - axes.bbox.x0) / axes.bbox.width)


class Layout(ConstrainedLayoutEngine):
    """The layout of matplotlib, after which words find their places; where it finds no room for the
    panels, it refuses the figure."""

    def execute(self, fig: Figure) -> None:
        with warnings.catch_warnings():
            # It would warn in its own words, and leave the panels on each other.
            warnings.filterwarnings("error", "constrained_layout not applied")
            try:
                super().execute(fig)
                # Where the first panels of equal scales were lower, or narrower, than their room,
                # words beside them seemed to need none.
                if are_cut(fig):
                    super().execute(fig)
                has_room = have_room(fig.axes, 72 * fig.get_size_inches())
            except UserWarning:
                has_room = False
        if not has_room:
            width, height = 25.4 * fig.get_size_inches()
            raise HodoError(
                f"style: {width:.0f} mm by {height:.0f} mm have no room for the panels beside "
                "their words: a larger width or height has, or a smaller font_size"
            )
        part_letters(fig.axes)
        place_words(fig)


@dataclass
class Sheet:
    """A figure being drawn, with a record of every value that it shows."""

    figure: Drawing
    width: float | None = None
    """The width in inches that the style of the figure sets, if it does."""
    shown: list[DrawnCurve] = field(default_factory=list)
    others: Sequence[Motion] = ()
    """The motions with which it compares its own, or whose scale it shares."""
    scenes: dict[Axes, Scene] = field(default_factory=dict)
    """The panels that show space."""
    legend: list[Line2D | Patch] = field(default_factory=list)
    """The entries of the legend, which is placed when all panels are drawn, besides the labelled
    lines of the panels."""
    units: Callable[[str], str] = field(default=lambda column: "1")
    """The units of a column of values, by its name."""
    time: str = "t"
    """The symbol of time, in TeX."""
    remarks: Sequence[str] = ()
    """What the caption has to say of the curves, besides what the case file says."""

    @property
    def is_wide(self) -> bool:
        """Whether the figure, once it has panels, is nearer to a page in width than to a column."""
        return self.figure.get_figwidth() > (COLUMN + PAGE) / 2

    def columns(self, width: float, limit: int) -> int:
        """How many panels, up to a limit, have room side by side in the figure, which has a
        width in inches where its style sets none; larger letters need wider panels."""
        least = MIN_PANEL_WIDTH * max(1.0, text_size("font.size") / SHEET_STYLE["font.size"])
        return max(1, min(limit, int((self.width or width) / least)))

    def panels(
        self, width: float, height: float, count: int = 1, columns: int = 1, **grid: Any
    ) -> list[Axes]:
        """Panels in rows of some columns, in a figure of this size in inches, or of this shape
        where its style sets the width."""
        # At once: where words have room depends on it.
        scale = (self.width or width) / width
        self.figure.set_size_inches(scale * width, scale * height)
        places = self.figure.subplots(-(-count // columns), columns, squeeze=False, **grid).ravel()
        for spare in places[count:]:
            spare.remove()
        for lowest in places[max(0, count - columns) : count]:
            # Also above a place that stays empty, where matplotlib would leave the ticks to it.
            lowest.tick_params(labelbottom=True)
        return list(places[:count])

    def record(self, curve: str, values: Mapping[str, np.ndarray]) -> None:
        """Note the values of a curve by the names of what they are, those of the same samples
        together: several panels may show them."""
        arrays = {name: np.asarray(value) for name, value in values.items()}
        first = next(iter(arrays))
        for item in self.shown:
            # Two curves may have one name: then what both have is not the same.
            known = item.values.keys() & arrays.keys() if item.curve == curve else ()
            same = (np.array_equal(item.values[x], arrays[x], equal_nan=True) for x in known)
            if first in known and all(same):
                item.values.update(arrays)
                return
        self.shown.append(DrawnCurve(curve, arrays))

    def record_path(
        self, motion: Motion, names: Sequence[str], points: np.ndarray, curve: str = ""
    ) -> None:
        """Note the values (n, k) of a motion over its time, by k names; `curve` is the name where
        it is not that of the motion."""
        values = dict(zip(names, points.T, strict=True))
        self.record(curve or motion.label, {"time": motion.time, **values})

    def scene(self, axes: Axes, view: View, names: Sequence[str], **kind: Any) -> Scene:
        """A panel that shows space in a view, with the names of its coordinates; see `Scene`."""
        return self.scenes.setdefault(axes, Scene(axes, view, names, **kind))

    def csv(self) -> str:
        """What the figure shows: a row for each sample of each curve, a column for each quantity,
        with its units if it has any: "G [kg m^2/s]".

        What a curve does not have stays empty.
        """
        # A dict keeps their order, which a set would lose.
        columns = dict.fromkeys(name for item in self.shown for name in item.values)
        units = {name: self.units(name) for name in columns}
        heads = {name: name if of == "1" else f"{name} [{of}]" for name, of in units.items()}
        text = io.StringIO()
        writer = csv.DictWriter(text, ["curve", *columns], restval="", lineterminator="\n")
        writer.writerow({"curve": "curve"} | {name: _cell(head) for name, head in heads.items()})
        for item in self.shown:
            for row in zip(*(column.tolist() for column in item.values.values()), strict=True):
                cells = zip(item.values, map(_cell, row), strict=True)
                writer.writerow({"curve": _cell(without_tex(item.curve)), **dict(cells)})
        return text.getvalue()


def _cell(value: object) -> object:
    """A cell of a table; a text that a spreadsheet would compute is quoted."""
    is_formula = isinstance(value, str) and value.startswith(("=", "+", "-", "@"))
    return f"'{value}" if is_formula else value


# Files

# Without dates and versions, so that the same results give the same bytes.
UNDATED: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def save(sheet: Sheet, path: Path, about: str = "") -> None:
    """Write a figure in the format of the path's suffix, the same bytes every time; `about` is the
    caption of its page, and goes into the metadata of an image.

    Raises HodoError if the file cannot be written; an older one then stays.
    """
    suffix, film = path.suffix[1:], sheet.figure.film
    with replacing(path) as draft:
        if suffix in FILM_FORMATS:
            film.write(draft, suffix)
        elif suffix == "html":
            back = f"../index.html#{quote(path.parent.name)}/{quote(path.stem)}"
            page = film.page if film else partial(figure_page, sheet)
            draft.write_text(page(path.stem, about, back), encoding="utf-8")
        elif suffix == "csv":
            # No translation of line ends: the file has the same bytes on every system.
            draft.write_text(sheet.csv(), encoding="utf-8", newline="")
        else:
            metadata = UNDATED[suffix] | {"Subject" if suffix == "pdf" else "Description": about}
            if suffix == "png":
                # savefig would draw all of it twice, the first time for the layout alone.
                sheet.figure.set_dpi(sheet.figure.parameters["savefig.dpi"])
                canvas: Any = FigureCanvasAgg(sheet.figure)
                # Level 6, which is usual, costs a third more for 9 % fewer bytes.
                canvas.print_png(draft, metadata=metadata, pil_kwargs={"compress_level": 3})
            else:
                sheet.figure.savefig(draft, format=suffix, metadata=metadata)


TO_TURN = "Drag to turn, scroll to come nearer, double-click to turn back; the pointer tells"
HOW_TO = {
    "globe": f"Here the map is on the sphere itself, a dot a start. {TO_TURN} its value.",
    "space": f"{TO_TURN} times and places.",
    "plane": "The pointer tells the values of both scales.",
}
"""What a reader can do with the panels of a figure, and what differs from print."""


def own_page(
    kind: str, data: Mapping[str, Any], title: str, caption: str, back: str, **content: str
) -> str:
    """A page with the elements of `kind`.html, filled with a caption and other content, and the
    script `kind`.js, which draws the data; `back` is the address of the page of all figures."""
    names = ("shell.html", f"{kind}.html", "space.js", f"{kind}.js")
    shell, elements, *scripts = (
        (Path(__file__).parent / name).read_text(encoding="utf-8") for name in names
    )
    link = f'<p><a href="{escape(back)}">All figures</a></p><h1>{escape(title)}</h1>'
    return Template(shell).substitute(
        title=escape(title),
        head=link if back else "",
        content=Template(elements).substitute(caption=escape(caption), **content),
        # A name may hold what ends a script.
        data=json.dumps(data, default=packed32).replace("</", "<\\/"),
        script="\n".join(scripts),
    )


def packed32(values: np.ndarray) -> str:
    """Numbers as the bytes of 32-bit ones, finer than any screen."""
    return b64encode(values.astype("<f4").tobytes()).decode()


def figure_page(sheet: Sheet, title: str, caption: str, back: str) -> str:
    """The page of a figure."""
    printed = io.StringIO()
    sheet.figure.savefig(printed, format="svg", metadata=UNDATED["svg"])
    # Panels have their final places once they are drawn.
    width, height = (72 * sheet.figure.get_size_inches()).tolist()
    unit = sheet.units("time")
    data = {
        "panels": [panel_data(sheet, axes) for axes in every_panel(sheet.figure.axes)],
        "points": width,
        "height": height,
        "time": [without_tex(f"${sheet.time}$"), "" if unit == "1" else f" {unit}"],
    }
    in_space = "globe" if any(axes.name == "hammer" for axes in sheet.scenes) else "space"
    how_to = HOW_TO[in_space if sheet.scenes else "plane"]
    svg = printed.getvalue()
    return own_page(
        "figure", data, title, caption, back, figure=svg[svg.index("<svg") :], how_to=how_to
    )


def panel_data(sheet: Sheet, axes: Axes) -> dict[str, Any]:
    """A panel for the script: its place in the figure, and its scene or its two scales."""
    place = {"box": axes.get_position().bounds}
    if axes not in sheet.scenes:
        return place | {"scales": [scale_data(axes, letter) for letter in "xy"]}
    scene = sheet.scenes[axes]
    return place | {
        "angles": scene.view.angles,
        "names": [*map(without_tex, scene.names)],
        "reach": scene.reach,
        "globe": scene.globe,
        "strokes": [*map(stroke_data, scene.strokes)],
    }


def sharing(axes: Any, letter: str) -> list[Any]:
    """The axis of a panel by its letter, and those of the panels that share its scale."""
    others = getattr(axes, f"get_shared_{letter}_axes")().get_siblings(axes)
    return [getattr(panel, f"{letter}axis") for panel in (axes, *others)]


def scale_words(axes: Any, letter: str) -> str:
    """The label of one scale of a plane panel as plain text; the letter where it has none."""
    # Panels that share a scale have its label once.
    labels = [axis.get_label_text() for axis in sharing(axes, letter)]
    return without_tex(next(filter(None, labels), letter))


def scale_data(axes: Any, letter: str) -> dict[str, Any]:
    """One scale of a plane panel; without a label if it has no ticks."""
    has_ticks = getattr(axes, f"get_{letter}ticks")().size > 0
    return {
        "label": scale_words(axes, letter) if has_ticks else "",
        "ends": getattr(axes, f"get_{letter}lim")(),
        "log": getattr(axes, f"get_{letter}scale")() == "log",
    }


def stroke_data(stroke: Mapping[str, Any]) -> dict[str, Any]:
    """A curve, marks or words in space for the script."""
    texts = {"texts": [*map(without_tex, stroke["texts"])], "name": without_tex(stroke["name"])}
    return {**stroke, **texts, "colours": [*map(to_hex, stroke["colours"])]}
