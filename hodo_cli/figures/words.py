"""Words in figures: formulas, the room that texts take, numbers at ticks, and places of words."""

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any
from unicodedata import normalize

import matplotlib.style
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.cbook import is_math_text
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Annotation
from matplotlib.ticker import LogFormatterSciNotation, ScalarFormatter

from .. import HodoError
from ..text import abridged

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
        plain = re.sub(r"\\(mathrm|,)", "", formula[1]).replace(r"\var", "\\")
        for tex, letter in TEX_LETTERS.items():
            plain = plain.replace(tex, letter)
        plain = plain.replace(r"\cdot", "·")
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


# Before matplotlib 3.11 they set formulas as images, which their parsers call otherwise.
PIXELS = "path" if matplotlib.__version_info__ >= (3, 11) else "agg"
"""What a canvas of pixels takes of a formula."""

FORMULAS_KEPT = 2000
"""More than the figures of a paper have; matplotlib keeps 50, and none for the next figure."""

Setter: Any = MathTextParser


class Formulas(Setter):  # type: ignore[misc]
    """What sets formulas, and keeps them: figures share most of their labels, and to set one takes
    some milliseconds."""

    _parse_cached = lru_cache(FORMULAS_KEPT)(Setter._parse_cached.__wrapped__)


@lru_cache
def formulas(fonts: str, output: str) -> Formulas:
    """What sets formulas in letters of these fonts."""
    return Formulas(output)


def keep_formulas(renderer: Any) -> None:
    """Let what draws a figure keep its formulas for the next one."""
    fonts = matplotlib.rcParams["mathtext.it"]
    renderer._text2path.mathtext_parser = formulas(fonts, "path")
    if isinstance(renderer, RendererAgg):
        renderer.mathtext_parser = formulas(fonts, PIXELS)


def text_width(text: str, size: float) -> float:
    """The width in points of a text of a size. Raises HodoError if its formulas, between dollar
    signs, cannot be set within the parameters of its figure."""
    given: Any = matplotlib.rcParams["savefig.dpi"]
    # A user who asks a figure for its ticks does so outside of its parameters.
    dpi = 72.0 if given == "figure" else float(given)
    # Dollars that are no pair are sums of money.
    formula = text if is_math_text(text) else text.replace("$", r"\$")
    try:
        # Before drawing: matplotlib would find a mistake only when it saves, and not say which text
        # is meant. Set as it will be drawn, a formula is set only once.
        setter = formulas(matplotlib.rcParams["mathtext.it"], PIXELS)
        parsed = setter.parse(formula, dpi, FontProperties(size=size))
    except ValueError as error:
        what = str(error).strip().splitlines()[-1]
        raise HodoError(f"{text!r} is not TeX that matplotlib knows ({what})") from None
    return 72 / dpi * float(parsed.width)


def text_lines(text: str, width: float, size: float) -> list[str]:
    """A text of a size in lines that fit into a width in inches, with no formula broken, and no
    word that fits into a line. Raises HodoError as `text_width` does."""
    # The whole first: a line that fits is set only once.
    if text_width(text, size) <= 72 * width:
        return [text]
    lines: list[str] = []
    # matplotlib's own wrapping breaks lines at the spaces inside formulas too.
    for whole in re.findall(r"(?:\$[^$]*\$|\S)+", text):
        word, *others = word_in_pieces(whole, width, size)
        if lines and text_width(longer := f"{lines[-1]} {word}", size) <= 72 * width:
            lines[-1] = longer
        else:
            lines.append(word)
        lines += others
    return lines


def word_in_pieces(word: str, width: float, size: float) -> list[str]:
    """A word of a size in pieces that fit into a width in inches, if it is no formula."""
    letters, pieces = len(word), [word]
    while "$" not in word and letters > 1 and max(text_width(x, size) for x in pieces) > 72 * width:
        letters = math.ceil(0.9 * letters) - 1
        pieces = textwrap.wrap(word, letters)
    return pieces


def text_size(name: str) -> float:
    """The size in points of a text, by the name of matplotlib's parameter."""
    parameters: Any = matplotlib.rcParams
    return float(FontProperties(size=parameters[name]).get_size_in_points())


def with_minus(number: str) -> str:
    """A number outside of formulas with the sign that ticks and formulas have."""
    return number.replace("-", "\N{MINUS SIGN}")


def in_formula(number: str) -> str:
    """A number as it stands in a formula, where 1e-77 would be a difference and the point of 1234.
    would end a sentence."""
    power = re.sub(r"e([-+])0*(\d+)$", r" \\cdot 10^{\1\2}", number).replace("{+", "{")
    return power.removesuffix(".")


DIGITS_WITH_ROOM = 3
"""The letters of a number at a tick for which matplotlib leaves room."""


class TickText(ScalarFormatter):
    """Numbers at ticks as plain text, and as a formula only the factor that is common to all: to
    set a formula takes ten times as long, and a number looks the same."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")

    def format_ticks(self, values: Any) -> list[str]:
        """Every number, or every second, third and so on where side by side they are on each
        other: matplotlib counts on three digits."""
        axis: Any = self.axis
        texts = super().format_ticks(values)
        if axis.axis_name != "x" or max(map(len, texts), default=0) <= DIGITS_WITH_ROOM:
            return texts
        rooms = [tick_room(axis, *tick) for tick in zip(values, texts, strict=True)]
        # Counted from the first that is seen.
        first = int(np.argmax(np.asarray(values) >= min(axis.get_view_interval())))
        choices = (range(first % n, len(texts), n) for n in range(1, len(texts) + 1))
        shown = next(x for x in choices if all(rooms[i][1] <= rooms[j][0] for i, j in pairwise(x)))
        return [text if i in shown else "" for i, text in enumerate(texts)]


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
    if axis.axis_name == "x":
        middle, _ = axis.axes.get_xaxis_transform().transform((value, 0))
        half = text_width(text, size) / 2 + 0.2 * size
    else:
        _, middle = axis.axes.get_yaxis_transform().transform((0, value))
        half = 0.6 * size
    points = 72 / axis.axes.get_figure().dpi * float(middle)
    return points - half, points + half


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


# Words that find their places

HALO = [patheffects.withStroke(linewidth=1.5, foreground="white")]

BESIDE, AROUND = 3.0, 10
"""Points between words and what they stand beside, and around words that should be empty."""

FULL = 10
"""How dark words are where others would be on them."""

LINES_AWAY = 4
"""How many lines away from its point a text may stand, where there is no room nearer."""

COMPASS = np.array([(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)])


class Words(Annotation):
    """Words in a panel beside one of some points (n, 2), first of all `toward` a direction.

    Words of a single point stay as near to it as they can; of several points they take the one with
    the most room, or the first of those with as much. What names an area stays where all of it is
    `inside`, which says so of points (..., 2), if there is room.
    """

    def __init__(
        self, axes: Axes, text: str, points: np.ndarray, toward: Any = (0, 1),
        inside: Callable[[np.ndarray], np.ndarray] | None = None, **look: Any,
    ) -> None:  # fmt: skip
        self.points, self.toward, self.inside = points, toward, inside
        # Outside of the layout, which would make room for them where they stand first.
        usual: dict[str, Any] = {"in_layout": False, "clip_on": False, "path_effects": HALO}
        usual |= {"textcoords": "offset points", "ha": "center", "va": "center", "zorder": 8}
        super().__init__(text, points[0], (0, 0), **usual | look)
        axes.add_artist(self)

    def find_place(self, ink: np.ndarray) -> None:
        """Stand where least is hidden of a picture of the figure (height, width), a pixel a point;
        it is dark there from then on."""
        half = self.half_size()
        points, offsets, middles = self.places(half)
        hidden, around = (
            np.array([area.sum() for area in areas_about(ink, middles, half + wider)])
            for wider in (1, AROUND)
        )
        # Of a single point the nearest place counts, of several the emptiest.
        cost = hidden + (around / 20 if len(self.points) > 1 else np.arange(len(middles)))
        best = int(cost.argmin())
        self.xy, self.xyann = points[best], offsets[best]
        areas_about(ink, middles[[best]], half)[0][...] = FULL

    def half_size(self) -> np.ndarray:
        """Half the width and height (2,), points."""
        size: Any = self.get_fontsize()
        lines = self.get_text().splitlines()
        width = max(text_width(line, size) for line in lines)
        return np.array([width, 1.2 * size * len(lines)]) / 2

    def places(self, half: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The places within the panel, the best first: the point there, the offset from it and the
        middle of the words (m, 2), in points; `half` is half their size (2,)."""
        size: Any = self.get_fontsize()
        seen = self.axes.transData.transform(self.points)  # type: ignore[union-attr]
        panel = self.axes.bbox.padded(-BESIDE)  # type: ignore[union-attr]
        likeness = (COMPASS @ self.toward) / np.hypot(*COMPASS.T)
        directions = COMPASS[np.argsort(-likeness, kind="stable")]
        away = BESIDE + size * np.arange(LINES_AWAY if len(self.points) == 1 else 1)
        offsets = ((half + away[:, None, None]) * directions).reshape(-1, 2)
        middles = seen + offsets[:, None]
        within = ((panel.min + half <= middles) & (middles <= panel.max - half)).all(axis=-1)
        own = within & self.is_inside(middles, half)
        within = own if own.any() else within
        offset, point = np.nonzero(within)
        if not len(point):  # to the upper right
            beside = half[None] + BESIDE
            return self.points[:1], beside, seen[:1] + beside
        return self.points[point], offsets[offset], middles[offset, point]

    def is_inside(self, middles: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Whether words of half a size (2,) about middles (..., 2), in points, are all in the area
        that they name, if they name one."""
        if self.inside is None:
            return np.full(middles.shape[:-1], True)
        corners = middles[..., None, :] + half * COMPASS[1::2]
        to_data = self.axes.transData.inverted()  # type: ignore[union-attr]
        places = to_data.transform(corners.reshape(-1, 2)).reshape(corners.shape)
        return np.asarray(self.inside(places).all(axis=-1))


class AreaName(Words):
    """The first of some texts that stands about the middle (2,) of an area all within it."""

    def __init__(
        self, axes: Axes, texts: Sequence[str], middle: np.ndarray,
        inside: Callable[[np.ndarray], np.ndarray],
    ) -> None:  # fmt: skip
        super().__init__(axes, texts[0], middle[None], inside=inside, zorder=3, path_effects=[])
        self.texts = texts

    def find_place(self, ink: np.ndarray) -> None:
        """Take the first text that fits, now that the size of the panel is known."""
        middle = self.axes.transData.transform(self.points)  # type: ignore[union-attr]
        for text in self.texts:
            self.set_text(text)
            if self.is_inside(middle, self.half_size()).all():
                return
        self.set_text("")


class CrossingNumber(Words):
    """The number in time of a mark (2,) that is one of several."""

    def __init__(self, axes: Axes, number: int, mark: np.ndarray) -> None:
        super().__init__(axes, str(number), mark[None], toward=(1, 1), size="x-small")
        self.number, self.mark = number, mark


NUMBER_ROOM = 0.04
"""The part of a panel that a number takes, about 8 points of 200."""


def gather_numbers(axes: Axes, numbers: Iterable[CrossingNumber]) -> None:
    """Let the marks of a panel that lie too close together for their numbers have these beside the
    outermost; marks beyond its ends have none."""
    panel, room = axes.bbox.padded(1), NUMBER_ROOM * max(axes.bbox.size)
    together: dict[tuple[float, ...], list[tuple[CrossingNumber, np.ndarray]]] = {}
    for number in numbers:
        seen = axes.transData.transform(number.mark)
        near = (place for place in together if math.dist(seen, place) < room)
        number.set_visible(False)
        if panel.contains(*seen):
            together.setdefault(next(near, tuple(seen)), []).append((number, seen))
    for group in together.values():
        # Upper right, where numbers stand.
        outermost, _ = max(group, key=lambda pair: float(sum(pair[1] / axes.bbox.size)))
        shown, _ = group[0]
        texts = map(str, sorted({number.number for number, _ in group}))
        shown.set(text=", ".join(abridged([*texts], 6)), visible=True)
        shown.points = outermost.mark[None]


def areas_about(picture: np.ndarray, middles: np.ndarray, half: np.ndarray) -> list[np.ndarray]:
    """The parts of a picture (height, width) about some middles (n, 2), of half a size (2,)."""
    ends = np.rint([middles - half, middles + half]).clip(0).astype(int)
    return [
        picture[low:high, left:right]
        for (left, low), (right, high) in zip(*ends.tolist(), strict=True)
    ]


def place_words(figure: Any, hiding: bool = False) -> None:
    """Put the words of each panel, in the order in which they were made, where they hide least; or,
    where what they hide moves on, on no other words."""
    dpi = figure.dpi
    for axes in figure.axes:
        if waiting := [text for text in axes.texts if isinstance(text, Words)]:
            figure.set_dpi(72)  # now all is measured in points
            axes.apply_aspect()
            gather_numbers(axes, [text for text in waiting if isinstance(text, CrossingNumber)])
            ink = np.zeros(np.ceil(figure.bbox.size[::-1]).astype(int)) if hiding else ink_of(axes)
            for words in filter(Words.get_visible, waiting):
                words.find_place(ink)
            figure.set_dpi(dpi)


def ink_of(axes: Any) -> np.ndarray:
    """How dark a figure is by what is in one of its panels (height, width), a pixel a point, from
    0 to 1."""
    width, height = np.ceil(axes.figure.bbox.size)
    renderer: Any = RendererAgg(width, height, 72)  # type: ignore[no-untyped-call]
    for artist in (*axes.patches, *axes.collections, *axes.lines, *axes.texts):
        if not isinstance(artist, Words):
            artist.draw(renderer)
    *colours, opacity = np.moveaxis(np.asarray(renderer.buffer_rgba())[::-1] / 255, -1, 0)
    return np.asarray(opacity * (1 - np.mean(colours, axis=0)))
