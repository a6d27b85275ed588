"""Texts in figures: formulas and plain words, numbers at logarithmic ticks, and words at the
emptiest of some places."""

import re
import textwrap
import unicodedata
import warnings
from html import escape
from typing import Any

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Annotation
from matplotlib.ticker import LogFormatterSciNotation

from .. import HodoError

HALO = [patheffects.withStroke(linewidth=1.5, foreground="white")]

GREEK = {
    unicodedata.name(chr(code)).split()[-1].lower().replace("lamda", "lambda"): chr(code)
    for code in range(0x3B1, 0x3CA)
}
"""The letters of the literature by their names in TeX."""


def without_tex(text: str) -> str:
    """A label without its TeX, for tables and pages."""

    def letter(name: re.Match[str]) -> str:
        return GREEK.get(name[1], name[1])

    def letters(formula: re.Match[str]) -> str:
        bare = re.sub(r"\\(mathrm|,)", "", formula[1]).replace(r"\cdot", "·")
        return re.sub(r"[_{}\\]", "", re.sub(r"\\(?:var)?([a-z]+)", letter, bare))

    return re.sub(r"\$([^$]*)\$", letters, text)


def in_html(text: str) -> str:
    """A label in HTML, with its indices."""

    def indexed(formula: re.Match[str]) -> str:
        return re.sub(r"_(\w|\{[^{}]*\})", r"<sub>\1</sub>", formula[0])

    return without_tex(re.sub(r"\$[^$]*\$", indexed, escape(text)))


def wrapped(text: str, width: int) -> str:
    """A text in lines of `width` letters; a formula is not broken, and counts as its letters
    without TeX."""
    formulas_in = re.findall(r"\$[^$]*\$", text)
    # While lines are made, a letter of the private use area stands for each formula.
    for i, formula in enumerate(formulas_in):
        text = text.replace(formula, chr(0xE000 + i) * max(1, len(without_tex(formula))), 1)
    lines = [textwrap.fill(line, width, break_long_words=False) for line in text.splitlines()]
    text = "\n".join(lines)
    for i, formula in enumerate(formulas_in):
        text = re.sub(chr(0xE000 + i) + "+", formula.replace("\\", r"\\"), text, count=1)
    return text


class LogNumbers(LogFormatterSciNotation):
    """Numbers at the ticks of a logarithmic axis, such as 40 in place of 4 times a power of ten."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = super().__call__(x, pos)
        return f"{x:g}" if text and 1e-3 <= abs(x) < 1e5 else text


COMPASS = np.array([(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)])


class Words(Annotation):
    """Words in a panel, at the emptiest of some places (n, 2) or, with `beside`, next to it: above
    it, or `toward` a direction, unless another side is emptier."""

    def __init__(
        self, axes: Axes, text: str, places: Any, beside: bool = True, toward: Any = (0, 1),
        **look: Any,
    ) -> None:  # fmt: skip
        self.places = np.asarray(places, float)
        likeness = (COMPASS @ np.asarray(toward)) / np.hypot(*COMPASS.T)
        self.shifts = COMPASS[np.argsort(-likeness, kind="stable")] if beside else np.zeros((1, 2))
        # The layout leaves them out: it would make room for their first place.
        usual: dict[str, Any] = {"in_layout": False, "path_effects": HALO, "zorder": 8}
        usual |= {"textcoords": "offset points", "ha": "center", "va": "center"}
        super().__init__(text, tuple(self.places[0]), (0, 0), **usual | look)
        axes.add_artist(self)

    def take_place(self, panel: Any, dark: np.ndarray) -> np.ndarray:
        """Move the words to where they hide the least of the dark points (n, 2) of a panel, in
        pixels; return some of the points that are then dark."""
        point = self.get_figure(root=True).dpi / 72  # type: ignore[union-attr]
        half = np.array(self.get_window_extent().size) / 2
        offsets = self.shifts * (half + 4 * point)  # clear of a mark there
        seen = panel.transData.transform(self.places)
        middles = (seen[:, None] + offsets).reshape(-1, 2)
        frame = panel.bbox.padded(-2 * point)
        inside = (middles - half >= frame.min) & (middles + half <= frame.max)
        away = np.abs(dark - middles[:, None])
        # The dark points under the words, and those within six points of them. A place beyond the
        # frame is the worst.
        hidden, near = ((away < half + x * point).all(-1).sum(-1) for x in (1, 6))
        best = int((hidden + near / 50 + 1000 * ~inside.all(-1)).argmin())
        i, j = divmod(best, len(self.shifts))
        self.xy, self.xyann = tuple(self.places[i]), tuple(offsets[j] / point)
        # As dense as the points of strokes: else later words would hide these rather than lines.
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 2), -1).reshape(-1, 2)
        return np.asarray(middles[best] + grid * half)


def dark_points(panel: Any) -> np.ndarray:
    """The points (n, 2) in pixels of lines, arrows and words that keep their places in a panel, at
    most one in each square of three pixels."""
    drawn = [x for x in panel.collections if isinstance(x, LineCollection)]
    lines = [line.get_transform().transform(line.get_xydata()) for line in panel.lines]
    lines += [x.get_transform().transform(path.vertices) for x in drawn for path in x.get_paths()]
    for text in panel.texts:
        if isinstance(text, Annotation) and text.arrow_patch:
            lines.append(panel.transData.transform([text.xyann, text.xy]))
        elif not isinstance(text, Words):
            lines.append(text.get_window_extent().get_points())
    points = [np.zeros((0, 2))]
    for known in filter(len, (line[np.isfinite(line).all(axis=1)] for line in lines)):
        length = np.append(0, np.hypot(*np.diff(known, axis=0).T).cumsum())
        # A point at each three pixels: the places between two distant points are dark too.
        at = np.linspace(0, length[-1], int(min(length[-1] / 3, 20000)) + 2)
        points.append(np.stack([np.interp(at, length, x) for x in known.T], axis=-1))
    dark = np.concatenate(points)
    dark = dark[((dark >= panel.bbox.min) & (dark <= panel.bbox.max)).all(axis=1)]
    cells = np.unique(dark // 3 @ [1, 1j])
    return 3 * np.stack([cells.real, cells.imag], axis=-1)


class Layout(ConstrainedLayoutEngine):
    """The layout of matplotlib, after which words take their places. Raises HodoError if there is
    no room for the panels."""

    def execute(self, fig: Any) -> None:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", "constrained_layout not applied")
            try:
                super().execute(fig)
            except UserWarning:
                width, height = 25.4 * fig.get_size_inches()
                raise HodoError(
                    f"style: {width:.0f} mm by {height:.0f} mm have no room for the panels beside "
                    "their words: set a larger width or height, or a smaller font.size"
                ) from None
        for panel in fig.axes:
            if waiting := [text for text in panel.texts if isinstance(text, Words)]:
                panel.apply_aspect()
                dark = dark_points(panel)
                for words in waiting:
                    dark = np.concatenate([dark, words.take_place(panel, dark)])
