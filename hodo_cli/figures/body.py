"""A body that moves: printed at some moments, played and turned in a page, or written as a film.
All three draw the same strokes, in axes of the body or of space."""

import math
import warnings
from collections.abc import Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from .. import HodoError
from ..text import time_text
from .between import Course, samples_in
from .files import page_of
from .look import AXIS_LOOKS, COLOURS, GREY, Look, Sheet, usual_width
from .space import arrow, pale, view_matrix

MOST_SHOWN = 4000
"""The most places of a motion that are shown: at 90 bytes each they add less than 400 kB to a
page."""

FRAMES_A_SECOND = 10
FILM_SIZE, FILM_DPI = 4.0, 100
"""The side in inches, and pixels an inch."""

KEY = {
    "$G$, its hodograph on the body": "red",
    r"$\omega$, its herpolhode in space": "purple",
    "axes of space": "grey",
}
"""The meanings of the colours; the axes of the body are labelled by name."""


def body(sheet: Sheet, motions: Sequence[Course]) -> None:
    """The body in space at some moments, with G, omega, the hodograph on the body and the
    herpolhode in space."""
    (m,), spec = motions, sheet.spec
    part = samples_in(m, spec["span"])
    time, count = m.time[part], part.stop - part.start
    moments = spec["moments"] or time[[0, count // 2, -1]].tolist()
    if wrong := [t for t in moments if not time[0] <= t <= time[-1]]:
        raise HodoError(f"moments: {wrong[0]:g} is not in the motion of {m.name}")
    printed = [int(np.abs(time - t).argmin()) for t in moments]
    places = np.linspace(0, count - 1, min(count, MOST_SHOWN)).round().astype(int)
    shown = np.unique([*places, *printed])
    if (every := count // MOST_SHOWN) > 1:
        words = f"one of {every} places of its curves is shown: a shorter span: shows more"
        warnings.warn(f"{m.name}: {words}", stacklevel=2)
    for name in ("omega_space", "G_space", "x1_space", "x2_space", "x3_space"):
        sheet.record_vector(m, m.samples.vector(name), [f"{name}.{x}" for x in "xyz"])
    set_scene(sheet, m, part.start + shown)
    columns = sheet.columns(3 if len(moments) == 3 else min(2, len(moments)))
    panels = sheet.panels(usual_width(columns) / columns + 0.25, len(moments), columns)
    for axes, i in zip(panels, np.searchsorted(shown, printed).tolist(), strict=True):
        draw_moment(axes, sheet, i)
    for words, colour in KEY.items():
        sheet.name(words, color=COLOURS[colour])
    sheet.figure.film = partial(film, sheet)
    sheet.figure.page = partial(page_of, sheet, "The body in space")


def set_scene(sheet: Sheet, m: Course, index: np.ndarray) -> None:
    """Add the strokes of a motion at some of its places to the scene, with the attitude there, and
    how long it plays."""
    turned = m.rotations[index]
    # Two different lengths, because both often point the same way.
    G, omega = (
        size * values / max(float(np.linalg.norm(values, axis=1).max()), math.ulp(0))
        for size, values in ((1, m.G[index]), (0.8, m.omega[index]))
    )
    add_faces(sheet, m.inertia, m.principal_axes)
    for i, direct in enumerate(np.eye(3), 1):
        sheet.stroke([0.7 * direct], AXIS_LOOKS[i][0], kind="arrow", of="body", name=f"x{i}")
    for name, direct in zip("xyz", np.eye(3), strict=True):
        sheet.stroke([1.12 * direct], GREY, kind="arrow", name=name)
    sheet.stroke(G, COLOURS["red"], kind="trail", of="body")
    sheet.stroke(turned.apply(omega), COLOURS["purple"], kind="trail")
    sheet.stroke(turned.apply(omega), COLOURS["purple"], kind="arrow", name="ω")
    sheet.stroke(turned.apply(G), COLOURS["red"], kind="arrow", name="G")
    attitude = np.roll(turned.as_quat(), 1, axis=1).round(6).tolist()
    sheet.scene |= {"time": m.time[index].tolist(), "attitude": attitude}
    sheet.scene["seconds"] = sheet.spec["seconds"]


def add_faces(sheet: Sheet, A: np.ndarray, axes: np.ndarray) -> None:
    """Add the faces of the homogeneous box that has these moments of inertia (3,) about its axes
    (3, 3), row by row; a plate gets a visible thickness."""
    # A1 = m (b^2 + c^2)/12, and so on: a^2 is proportional to A2 + A3 - A1.
    sides = np.sqrt(np.maximum(A.sum() - 2 * A, 0))
    half = 0.6 * np.maximum(sides / sides.max(), 0.03)
    square = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    for axis, sign in product(range(3), (1, -1)):
        corners = (np.insert(square, axis, sign, axis=1) * half) @ axes
        sheet.stroke(corners, AXIS_LOOKS[axis + 1][0], kind="face", of="body")


def draw_moment(axes: Axes, sheet: Sheet, i: int) -> None:
    """Draw the body at place i of its scene into a panel."""
    from scipy.spatial.transform import Rotation  # late: it takes longer than most pictures

    scene, V = sheet.scene, view_matrix(sheet.spec["view"])
    R = Rotation.from_quat(np.roll(scene["attitude"][i], -1)).as_matrix()
    for part in scene["strokes"]:
        points, colour = np.array(part["points"]), part["colour"]
        seen = (points @ R.T if part.get("of") == "body" else points) @ V.T
        x, y, near = seen.T
        if part["kind"] == "face":
            # The front is transparent over what is behind it.
            front = bool(near.mean() > 0)
            look: Look = {"alpha": 0.2 if front else 0.35, "zorder": 4 if front else 1}
            axes.fill(x, y, fc=colour, ec=GREY, lw=0.5, ls="-", **look)
        elif part["kind"] == "trail":
            axes.plot(x, y, "-", color=colour, lw=0.5, alpha=0.3, zorder=2)
            axes.plot(x[: i + 1], y[: i + 1], "-", color=colour, lw=0.9, zorder=3)
        elif (tip := seen[min(i, len(x) - 1)]).any():  # at rest there is no arrow
            of_space = part["name"] in "xyz"
            # Without this, space would look left-handed from behind.
            shade = pale(colour) if of_space and tip[2] < -1e-9 else colour
            name = part["name"].replace("ω", r"\omega").replace("x", "x_" if not of_space else "x")
            arrow(axes, (0, 0), tip[:2], f"${name}$", shade, 2 if of_space else 5)
    axes.set(xlim=(-1.3, 1.3), ylim=(-1.3, 1.3), aspect="equal")
    axes.set_title(f"${sheet.spec['time']}$ = {time_text(scene['time'][i], scene['time'][0], 5)}")
    axes.set_axis_off()


def film(sheet: Sheet, path: Path) -> None:
    """The film of a moving body as GIF."""
    times, pictures = np.array(sheet.scene["time"]), []
    count = max(2, round(FRAMES_A_SECOND * sheet.scene["seconds"]))
    with sheet.figure.styled():
        fig = Figure((FILM_SIZE, FILM_SIZE), dpi=FILM_DPI)
        canvas: Any = FigureCanvasAgg(fig)
        axes = fig.add_axes((0, 0, 1, 0.93))
        for when in np.linspace(times[0], times[-1], count):
            axes.clear()
            draw_moment(axes, sheet, int((times >= when).argmax()))
            canvas.draw()
            shown = Image.fromarray(np.array(canvas.buffer_rgba()))
            pictures.append(shown.convert("P", palette=Image.Palette.ADAPTIVE))
    # The format is given, because the name of a draft does not show it.
    first, pause = pictures[0], 1000 // FRAMES_A_SECOND
    first.save(path, "gif", save_all=True, append_images=pictures[1:], duration=pause, loop=0)
