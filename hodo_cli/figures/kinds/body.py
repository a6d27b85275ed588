"""A body that moves: printed at some moments, played and turned in a page or a notebook, or written
as a film.

What is drawn stands once, as a list of parts in axes of the body or of space; the printed picture
here and the script of the page (`film.js`) know no more than faces, trails and arrows.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from ... import HodoError
from ...cases.derived import SPACE_AXES, component_names
from ...results.motion import Motion, rotations
from ...text import time_digits, time_text
from ..artists import AXIS_COLOUR, BLACK, GREY, PURPLE, RED, arrow
from ..sheet import PAGE, SHEET_STYLE, Look, Sheet, View, own_page
from ..words import Words, in_formula, keep_formulas, place_words, without_tex
from .plane import within_span
from .space import IN_PAGE, pale, space_vector

FILM_SAMPLES = 3000
"""The samples of a film: with 65 bytes each in a page, it has less than 300 kB."""

FRAMES_A_SECOND = 20
FILM_SIZE, FILM_DPI = 4.0, 120
"""Inches of a side, and pixels an inch: even numbers of pixels, which films want."""

PICTURE_REACH, SPACE_AXIS = 1.3, 1.12
"""Half the width of a picture, and the length of the axes of space; G is 1 where it is largest."""

NAME_ROOM = 0.2
"""How far apart the names of arrows are: the height of a letter in a narrow panel."""

COLOUR_KEY = {
    RED: "$G$, its hodograph on the body",
    PURPLE: r"$\omega$, its herpolhode in space",
    GREY: "axes of space",
}
"""The meanings of the colours; the axes of the body have their names."""


@dataclass(frozen=True)
class MovingPart:
    """Part of a moving picture: a face of the body, the trail of a point, an arrow from the centre
    to it, or an axis, which is thin; through points (n, 3) in axes of the body or of space; a point
    a sample, or one that stays."""

    role: str
    of_body: bool
    points: np.ndarray
    colour: str
    name: str = ""


@dataclass(frozen=True)
class Film:
    """A motion as a moving picture: times (n,), SciPy's rotations (n,) from the body to space,
    parts, the angles of view in degrees, the seconds that it lasts, when the motion starts, and the
    words before and after a time."""

    time: np.ndarray
    rotations: Any
    parts: Sequence[MovingPart]
    view: tuple[float, float]
    seconds: float
    motion_start: float
    words: tuple[str, str]

    @property
    def count(self) -> int:
        """The number of its pictures as a file."""
        return max(2, round(self.seconds * FRAMES_A_SECOND))

    def page(self, title: str = "The body in space", caption: str = "", back: str = "") -> str:
        """The film in a page that plays, pauses, scrubs and turns it, and needs no other file."""
        data = {
            "time": self.time - self.time[0], "start": float(self.time[0]),
            "attitude": np.roll(self.rotations.as_quat(), 1, axis=1),
            "parts": [*map(asdict, self.parts)],
            "view": self.view, "seconds": self.seconds, "words": self.words, "reach": PICTURE_REACH,
            "room": NAME_ROOM, "digits": time_digits(self.time[-1], self.motion_start, 5),
        }  # fmt: skip
        return own_page("film", data, title, caption, back)

    def frame(self) -> str:
        """The page in a frame, as a notebook shows it."""
        source = escape(self.page())
        size = 'width="560" height="640" style="border: 0"'
        return f'<iframe srcdoc="{source}" {size} title="moving body"></iframe>'

    def write(self, path: Path, suffix: str) -> None:
        """Write the film as GIF or MP4. Raises HodoError without ffmpeg, which writes the latter,
        and OSError if the file cannot be written."""
        if suffix == "mp4" and not FFMpegWriter.isAvailable():
            raise HodoError("MP4 needs ffmpeg, which is not installed; GIF needs no other program")
        with matplotlib.style.context(["default", SHEET_STYLE]):
            if suffix == "gif":
                first, *rest = in_colours(self)
                pause = 1000 // FRAMES_A_SECOND
                first.save(path, "gif", save_all=True, append_images=rest, duration=pause, loop=0)
                return
            figure, axes = film_panel()
            writer = FFMpegWriter(FRAMES_A_SECOND, extra_args=["-f", "mp4", "-pix_fmt", "yuv420p"])
            with writer.saving(figure, str(path), FILM_DPI):
                for _ in moving_artists(self, axes, self.count):
                    writer.grab_frame()


def body(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """The body in space at some moments, with G, omega, the hodograph on the body and the
    herpolhode in space; a film where it can move."""
    (motion,) = motions
    times = motion.time[within_span(motion, spec["span"])]
    moments = spec["moments"] or times[[0, len(times) // 2, -1]].tolist()
    film = film_of(motion, spec, moments)
    sheet.figure.film = film
    for vector in ("omega", "G", "x1", "x2", "x3"):
        names = component_names(f"{vector}_space", "space")
        sheet.record_path(motion, names, space_vector(motion, vector))
    across = sheet.columns(PAGE, min(4, len(moments)))
    rows, width = -(-len(moments) // across), sheet.width or PAGE
    panels = sheet.panels(width, rows * (width / across + 0.2), len(moments), across)
    for axes, moment in zip(panels, moments, strict=True):
        frame_space(axes)
        draw_moment(axes, film, int(np.abs(film.time - moment).argmin()))
    sheet.legend += key_handles()


def film_of(motion: Motion, spec: Mapping[str, Any], moments: Sequence[float]) -> Film:
    """The film of a motion, within the span of its figure; it has the samples next to moments."""
    within = np.arange(len(motion.time))[within_span(motion, spec["span"])]
    # The last one too: a film and its printed moments end with the motion.
    places = np.linspace(0, len(within) - 1, min(len(within), FILM_SAMPLES))
    printed = [np.abs(motion.time[within] - moment).argmin() for moment in moments]
    index = within[np.unique([*places.round().astype(int), *printed])]
    symbol, of = without_tex(f"${spec['time']}$"), motion.units("time")
    turned = rotations(motion)[index]
    return Film(
        time=motion.time[index],
        rotations=turned,
        parts=moving_parts(motion, index, turned),
        view=tuple(spec["view"]),
        seconds=spec["seconds"],
        motion_start=motion.case.time.start,
        words=(f"{symbol} = ", "" if of == "1" else f" {of}"),
    )


def moving_parts(motion: Motion, index: np.ndarray, turned: Any) -> list[MovingPart]:
    """What is seen of a motion in a film of some of its samples, at which it is turned so."""
    # Whatever the units; of two lengths, since both often point the same way.
    G, omega = (
        length * values / max(float(np.hypot.reduce(values, axis=-1).max()), math.ulp(0))
        for length, values in ((1, motion.G[index]), (0.8, motion.omega[index]))
    )
    body_axes = zip(0.7 * np.eye(3), ("x1", "x2", "x3"), range(1, 4), strict=True)
    space_axes = zip(SPACE_AXIS * np.eye(3), SPACE_AXES, strict=True)
    return [
        *faces(motion.inertia, motion.principal_axes),
        *(MovingPart("arrow", True, tip[None], AXIS_COLOUR[i], name) for tip, name, i in body_axes),
        MovingPart("trail", True, G, RED),
        MovingPart("trail", False, turned.apply(omega), PURPLE),
        MovingPart("arrow", False, turned.apply(omega), PURPLE, "ω"),
        MovingPart("arrow", False, turned.apply(G), RED, "G"),
        *(MovingPart("axis", False, tip[None], GREY, name) for tip, name in space_axes),
    ]


def faces(A: np.ndarray, axes: np.ndarray) -> Iterator[MovingPart]:
    """The faces of the homogeneous box that has these moments of inertia (3,) about its axes
    (3, 3), row by row; it has half length 0.6 along its longest side, and a plate a thickness that
    is seen."""
    # A1 = m (b^2 + c^2)/12, and so on: a^2 is proportional to A2 + A3 - A1.
    sides = np.sqrt(np.maximum(A.sum() - 2 * A, 0))
    half = 0.6 * np.maximum(sides / sides.max(), 0.03)
    square = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    for axis in range(3):
        for sign in (1, -1):
            corners = (np.insert(square, axis, sign, axis=1) * half) @ axes
            yield MovingPart("face", True, corners, AXIS_COLOUR[axis + 1])


def draw_moment(axes: Axes, film: Film, i: int) -> None:
    """Draw the film's sample i into a panel."""
    view, turn = View(film.view), film.rotations[i].as_matrix()
    for part in film.parts:
        seen = view(part.points @ turn.T if part.of_body else part.points)
        x, y, near = seen.T
        if part.role == "face":
            # The front is a veil over what is behind it.
            front = near.mean() > 0
            look: Look = {"fc": part.colour, "ec": GREY, "lw": 0.5, "alpha": 0.2 if front else 0.35}
            axes.fill(x, y, **look, zorder=4 if front else 1)
        elif part.role == "trail":
            axes.plot(x, y, color=part.colour, lw=0.5, alpha=0.3, zorder=2)
            axes.plot(x[: i + 1], y[: i + 1], color=part.colour, lw=0.9, zorder=3)
        elif (tip := seen[min(i, len(seen) - 1)]).any():  # at rest there is no arrow to name
            is_axis = part.role == "axis"
            # Else space would look left-handed from behind; what turns shows its sides.
            colour = pale(part.colour) if is_axis and tip[2] < -IN_PAGE else part.colour
            arrow(axes, np.zeros(2), tip[:2], colour, zorder=2 if is_axis else 5)
            name = re.sub(r"(\d)", r"_\1", part.name)
            Words(axes, f"${name}$", tip[None, :2], toward=tip[:2], color=colour)
    symbol, unit = film.words
    moment = in_formula(time_text(film.time[i], film.motion_start))
    axes.set_title(f"${symbol}{moment}${unit}", color=BLACK)


def frame_space(axes: Axes) -> None:
    """Let a panel show what is as far as G is long."""
    axes.set(
        xlim=(-PICTURE_REACH, PICTURE_REACH), ylim=(-PICTURE_REACH, PICTURE_REACH), aspect="equal"
    )
    axes.set_axis_off()


def key_handles() -> list[Line2D]:
    """The legend of the colours."""
    return [Line2D([], [], color=colour, label=words) for colour, words in COLOUR_KEY.items()]


def film_panel() -> tuple[Figure, Axes]:
    """A figure with the legend of a film's colours, and its panel."""
    figure = Figure((FILM_SIZE, FILM_SIZE), dpi=FILM_DPI)
    figure.legend(
        handles=key_handles(), loc="lower center", ncols=3, fontsize="x-small",
        handlelength=0.8, handletextpad=0.4, columnspacing=1,
    )  # fmt: skip
    axes = figure.add_axes((0, 0.06, 1, 0.88))
    frame_space(axes)
    return figure, axes


def moving_artists(film: Film, axes: Axes, count: int) -> Iterator[Sequence[Artist]]:
    """What moves in the panel of a film, at so many even steps of time; each picture is taken out
    again before the next."""
    lasting = {*axes.get_children()}
    for moment in np.linspace(film.time[0], film.time[-1], count):
        draw_moment(axes, film, int(np.searchsorted(film.time, moment)))
        place_words(axes.figure, hiding=True)
        moving = [artist for artist in axes.get_children() if artist not in lasting]
        yield [*sorted(moving, key=Artist.get_zorder), axes.title]
        for artist in moving:
            artist.remove()


def pictures(film: Film, count: int) -> Iterator[Image.Image]:
    """So many pictures of a film. What moves is drawn on a copy of what does not: to draw all of it
    takes twice as long."""
    figure, axes = film_panel()
    canvas: Any = FigureCanvasAgg(figure)
    keep_formulas(canvas.get_renderer())
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    renderer = canvas.get_renderer()
    for artists in moving_artists(film, axes, count):
        canvas.restore_region(background)
        for artist in artists:
            artist.draw(renderer)
        yield Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB")


PALETTE, PALETTE_PICTURES = 256, 9
"""The colours that the pictures of a film share, and how many pictures show all that occur."""


def in_colours(film: Film) -> Iterator[Image.Image]:
    """The pictures of a film in the colours that they share: with their own they would flicker."""
    few = np.concatenate([*map(np.asarray, pictures(film, PALETTE_PICTURES))])
    # By coverage: medians of the pixels lose the colours of thin lines.
    colours = Image.fromarray(few).quantize(PALETTE, Image.Quantize.MAXCOVERAGE)
    for picture in pictures(film, film.count):
        yield picture.quantize(palette=colours, dither=Image.Dither.NONE)
