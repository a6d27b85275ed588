"""A figure under construction, and how one is saved."""

import csv
import io
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any
from unicodedata import normalize

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cbook import is_math_text
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.mathtext import MathTextParser
from matplotlib.patches import Patch
from matplotlib.text import Annotation
from matplotlib.ticker import LogFormatterSciNotation, ScalarFormatter

from .. import HodoError
from ..results.motion import Motion
from .geometry import View

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

SCREEN = 150
"""Dots per inch in a notebook: half of print's, which is as sharp on a screen."""


@dataclass(frozen=True)
class DrawnCurve:
    """One curve of a figure: its name, and the values drawn."""

    curve: str
    values: dict[str, np.ndarray]


@dataclass(frozen=True)
class Scene:
    """What a panel shows of space, from a direction: it is printed in this view, and turned where a
    reader can turn it. It has the names of its coordinates; `reach` is where the panel ends on each
    axis, None if it shows all; a globe hides its far side."""

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


FILMS = (".gif", ".mp4")
"""The suffixes of files of what moves."""


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
            super().draw(renderer)

    def _repr_html_(self) -> Any:
        return self.film and self.film.frame()

    def savefig(self, fname: Any, **keys: Any) -> None:
        """As matplotlib does; to a name that ends with .gif or .mp4, what moves as a film."""
        path = Path(fname) if isinstance(fname, str | Path) else Path()
        with self.styled():
            if self.film and path.suffix in FILMS:
                self.film.write(path, path.suffix[1:])
            else:
                super().savefig(fname, **keys)

    def _repr_png_(self) -> bytes:
        """The figure as PNG."""
        image = io.BytesIO()
        self.savefig(image, format="png", dpi=SCREEN)
        return image.getvalue()


NARROWEST = 40 / 25.4
"""The least width of a panel with its words, inches: four stand in a page, two in a column."""


class Layout(ConstrainedLayoutEngine):
    """The layout of matplotlib; where it finds no room, it refuses the figure."""

    def execute(self, fig: Figure) -> None:
        with warnings.catch_warnings():
            # It would warn in its own words, and leave the panels on each other.
            warnings.filterwarnings("error", "constrained_layout not applied")
            try:
                super().execute(fig)
            except UserWarning:
                width, height = 25.4 * fig.get_size_inches()
                raise HodoError(
                    f"style: {width:.0f} mm by {height:.0f} mm have no room for the panels beside "
                    "their words: a larger width or height has, or a smaller font_size"
                ) from None


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
    notes: list[Annotation] = field(default_factory=list)
    """The words beside marks, which are set apart when all panels have their places."""
    units: Callable[[str], str] = field(default=lambda column: "1")
    """The units of a column of values, by its name."""
    time: str = "t"
    """The symbol of time, in TeX."""
    remarks: Sequence[str] = ()
    """What the caption has to say of the curves, besides what the case file says."""

    def columns(self, width: float, most: int) -> int:
        """How many panels, `most` at the most, have room side by side in the figure, which has a
        width in inches where its style sets none."""
        return max(1, min(most, int((self.width or width) / NARROWEST)))

    def panels(
        self, width: float, height: float, count: int = 1, columns: int = 1, **grid: Any
    ) -> list[Axes]:
        """Panels in rows of some columns, in a figure of this size in inches, or of this shape
        where its style sets the width."""
        # At once: where words have room depends on it.
        scale = (self.width or width) / width
        self.figure.set_size_inches(scale * width, scale * height)
        rows = -(-count // columns)
        places = self.figure.subplots(rows, columns, squeeze=False, **grid).ravel()
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
            same = item.curve == curve and first in item.values
            if same and np.array_equal(item.values[first], arrays[first], equal_nan=True):
                item.values.update(arrays)
                return
        self.shown.append(DrawnCurve(curve, arrays))

    def scene(self, axes: Axes, view: View, names: Sequence[str], **kind: Any) -> Scene:
        """A panel that shows space in a view, with the names of its coordinates; see `Scene`."""
        return self.scenes.setdefault(axes, Scene(view, names, **kind))

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


GREEK = (
    *("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda"),
    *("mu", "nu", "xi", "rho", "sigma", "tau", "phi", "chi", "psi", "omega", "infty"),
)
TEX_LETTERS = {
    rf"\{name}": letter for name, letter in zip(GREEK, "αβγδεζηθκλμνξρστφχψω∞", strict=True)
}
"""The letters of the literature in texts that are not set."""


def without_tex(text: str) -> str:
    """A label as plain text: for tables, and for pages, where a script that sets formulas would
    have to be fetched."""

    def letters(formula: re.Match[str]) -> str:
        plain = formula[1].replace(r"\var", "\\")
        for tex, letter in TEX_LETTERS.items():
            plain = plain.replace(tex, letter)
        return re.sub(r"[_{}\\]", "", plain)

    return re.sub(r"\$([^$]*)\$", letters, text)


RAISED, LOWERED = "⁰¹²³⁴-⁹⁺⁻", "₀-₉₊₋"
"""Digits in texts that the fonts of formulas lack."""


def slanted(text: str) -> str:
    """A text whose Greek letters, and whose raised and lowered digits, are set as in formulas."""
    if text.count("$") % 2:  # a sum of money, and no formula
        return text
    pieces = rf"(\$[^$]*\$)|([α-ω{RAISED}{LOWERED}]+)"
    text = re.sub(pieces, lambda piece: piece[1] or f"${piece[2]}$", text)
    return re.sub(f"[{RAISED}]+|[{LOWERED}]+", in_tex, text)


def in_tex(digits: re.Match[str]) -> str:
    """Raised or lowered digits in TeX."""
    return f"{'_' if digits[0] >= '₀' else '^'}{{{normalize('NFKC', digits[0])}}}"


def _cell(value: object) -> object:
    """A cell of a table; a text that a spreadsheet would compute is quoted."""
    is_formula = isinstance(value, str) and value.startswith(("=", "+", "-", "@"))
    return f"'{value}" if is_formula else value


# Before matplotlib 3.11 they set formulas as images, which their parsers call otherwise.
SET_FOR: Any = "path" if matplotlib.__version_info__ >= (3, 11) else "agg"
"""What a canvas of pixels takes of a formula."""


@lru_cache(maxsize=1024)
def _formula(text: str, dpi: float, font: FontProperties | None, fonts: str) -> Any:
    return MathTextParser(SET_FOR).parse(text, dpi, font)


class CachedMathText(MathTextParser):  # type: ignore[type-arg]
    """Sets formulas, and keeps them: figures share most of their labels, to set one takes some
    milliseconds, and matplotlib's own parser forgets with every figure."""

    def parse(
        self,
        s: str,
        dpi: float = 72,
        prop: FontProperties | None = None,
        *,
        antialiased: bool | None = None,
    ) -> Any:
        """What is drawn of a text with formulas; `antialiased` is for images of single formulas."""
        # A copy, because a text may change its font later.
        # The letters of formulas may come from other fonts in another figure.
        return _formula(s, dpi, prop and prop.copy(), matplotlib.rcParams["mathtext.it"])


FORMULAS = CachedMathText(SET_FOR)


class FormulaCanvas(FigureCanvasAgg):
    """A canvas of pixels that sets formulas by `FORMULAS`."""

    def get_renderer(self) -> Any:
        """The renderer of the figure."""
        renderer = super().get_renderer()  # type: ignore[no-untyped-call]
        renderer.mathtext_parser = FORMULAS
        return renderer


def text_width(text: str, size: float) -> float:
    """The width in points of a text of a size. Raises HodoError if its formulas, between dollar
    signs, cannot be set within the parameters of its figure."""
    dpi: float = matplotlib.rcParams["savefig.dpi"]
    # Dollars that are no pair are sums of money.
    formula = text if is_math_text(text) else text.replace("$", r"\$")
    try:
        # Before drawing: matplotlib would find a mistake only when it saves, and not say which text
        # is meant. Set as it will be drawn, a formula is set only once.
        parsed = FORMULAS.parse(formula, dpi, FontProperties(size=size))
    except ValueError as error:
        what = str(error).strip().splitlines()[-1]
        raise HodoError(f"{text!r} is not TeX that matplotlib knows ({what})") from None
    return 72 / dpi * float(parsed.width)


def text_lines(text: str, width: float, size: float) -> list[str]:
    """A text of a size in lines that fit into a width in inches, with no formula broken. Raises
    HodoError as `text_width` does."""
    # The whole first: a line that fits is set only once.
    if text_width(text, size) <= 72 * width:
        return [text]
    lines: list[str] = []
    # matplotlib's own wrapping breaks lines at the spaces inside formulas too.
    for word in re.findall(r"(?:\$[^$]*\$|\S)+", text):
        if lines and text_width(longer := f"{lines[-1]} {word}", size) <= 72 * width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def text_size(name: str) -> float:
    """The size in points of a text, by the name of matplotlib's parameter."""
    parameters: Any = matplotlib.rcParams
    return float(FontProperties(size=parameters[name]).get_size_in_points())


class TickText(ScalarFormatter):
    """Numbers at ticks as plain text, and as a formula only the factor that is common to all: to
    set a formula takes ten times as long, and a number looks the same."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")


class PowerText(LogFormatterSciNotation):
    """Numbers at the ticks of a logarithmic axis, as many as have room; matplotlib counts decades,
    however small their panel is."""

    def format_ticks(self, values: Any) -> list[str]:
        axis: Any = self.axis
        texts, taken = super().format_ticks(values), []
        # The powers of ten come first: those between them keep clear of them.
        if (powers := axis.get_major_formatter()) is not self:
            places = axis.get_majorticklocs()
            named = zip(places, powers.format_ticks(places), strict=True)
            taken = [tick_room(axis, *tick) for tick in named if tick[1]]
        for i, tick in enumerate(zip(values, texts, strict=True)):
            low, high = tick_room(axis, *tick)
            if all(high <= start or end <= low for start, end in taken):
                taken += [(low, high)] if tick[1] else []
            else:
                texts[i] = ""
        return texts


def tick_room(axis: Any, value: float, text: str) -> tuple[float, float]:
    """The ends of the room that the number at a tick takes along its axis, points."""
    size = text_size(f"{axis.axis_name}tick.labelsize")
    is_across = axis.axis_name == "x"
    transform = getattr(axis.axes, f"get_{axis.axis_name}axis_transform")()
    across, up = transform.transform((value, 0) if is_across else (0, value))
    middle = 72 / axis.axes.get_figure().dpi * float(across if is_across else up)
    half = text_width(text, size) / 2 + 0.2 * size if is_across else 0.6 * size
    return middle - half, middle + half


def lighten(figure: Figure) -> None:
    """Give every axis whose ticks are plain numbers their `TickText`, every logarithmic one its
    `PowerText`, and spare the layout what takes no room."""
    for axes in every_panel(figure.axes):
        for axis in (axes.xaxis, axes.yaxis):
            if type(axis.get_major_formatter()) is ScalarFormatter:
                axis.set_major_formatter(TickText())
            if type(minor := axis.get_minor_formatter()) is LogFormatterSciNotation:
                axis.set_major_formatter(PowerText())
                axis.set_minor_formatter(PowerText(labelOnlyBase=minor.labelOnlyBase))
        # They lie on the edge of their panel, and are slow to measure.
        for spine in axes.spines.values():
            spine.set_in_layout(False)


def every_panel(panels: Iterable[Any]) -> Iterator[Axes]:
    """Panels, and the insets in them."""
    # Not by `findobj`, which would make the ticks of a scale that is not final yet.
    for axes in panels:
        yield axes
        yield from every_panel(axes.child_axes)
