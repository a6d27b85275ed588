"""A body that moves: printed at some moments, played and turned in a page, or written as a film.
All three draw the same strokes, in axes of the body or of space."""

import math
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from .. import HodoError
from ..text import time_text
from .between import Course, samples_in
from .look import AXIS_LOOKS, COLOURS, GREY, PAGE, Look, Sheet, stroke
from .space import arrow, pale, view_matrix

FILM_SAMPLES = 4000
"""The number of places of a film: at 90 bytes each it adds less than 400 kB to a page."""

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
    moments = spec["moments"] or m.time[part][[0, (part.stop - part.start) // 2, -1]].tolist()
    if wrong := [t for t in moments if not m.time[part][0] <= t <= m.time[part][-1]]:
        raise HodoError(f"moments: {wrong[0]:g} is not in the motion of {m.name}")
    printed = [part.start + int(np.abs(m.time[part] - t).argmin()) for t in moments]
    places = np.linspace(part.start, part.stop - 1, min(part.stop - part.start, FILM_SAMPLES))
    film = np.unique([*places.round().astype(int), *printed])
    if part.stop - part.start > 2 * FILM_SAMPLES:
        seen = (part.stop - part.start) // FILM_SAMPLES
        warnings.warn(
            f"{m.name}: the film shows one of {seen} places of its curves: a shorter span: "
            "shows more", stacklevel=2,
        )  # fmt: skip
    for name in ("omega_space", "G_space", "x1_space", "x2_space", "x3_space"):
        sheet.record_vector(m, m.samples.vector(name), [f"{name}.{x}" for x in "xyz"])
    columns = sheet.columns(PAGE, 3 if len(moments) == 3 else min(2, len(moments)))
    rows = math.ceil(len(moments) / columns)
    panels = sheet.panels(PAGE, rows * (PAGE / columns + 0.25), len(moments), columns)
    every = np.arange(part.start, part.stop)
    scene = scene_of(m, every, spec)
    for axes, i in zip(panels, printed, strict=True):
        draw_moment(axes, scene, i - part.start, spec["time"])
    sheet.scene |= scene_of(m, film, spec) if len(film) < len(every) else scene
    sheet.handles += [Line2D([], [], color=COLOURS[c], label=words) for words, c in KEY.items()]


def scene_of(m: Course, index: np.ndarray, spec: Any) -> dict[str, Any]:
    """The strokes of a motion at some of its places, the attitude there, and how long it plays."""
    turned = m.rotations[index]
    # Two different lengths, because both often point the same way.
    G, omega = (
        size * values / max(float(np.linalg.norm(values, axis=1).max()), math.ulp(0))
        for size, values in ((1, m.G[index]), (0.8, m.omega[index]))
    )
    strokes = [*faces(m.inertia, m.principal_axes)]
    for i, row in enumerate(np.eye(3), 1):
        look: Look = {"kind": "arrow", "of": "body", "name": f"x{i}"}
        strokes.append(stroke([0.7 * row], AXIS_LOOKS[i][0], **look))
    for name, row in zip("xyz", np.eye(3), strict=True):
        strokes.append(stroke([1.12 * row], GREY, kind="arrow", name=name))
    strokes += [
        stroke(G, COLOURS["red"], kind="trail", of="body"),
        stroke(turned.apply(omega), COLOURS["purple"], kind="trail"),
        stroke(turned.apply(omega), COLOURS["purple"], kind="arrow", name="ω"),
        stroke(turned.apply(G), COLOURS["red"], kind="arrow", name="G"),
    ]
    attitude = np.roll(turned.as_quat(), 1, axis=1).round(6).tolist()
    return {
        "strokes": strokes, "time": m.time[index].tolist(), "attitude": attitude,
        "seconds": spec["seconds"], "view": view_matrix(spec["view"]).tolist(),
    }  # fmt: skip


def faces(A: np.ndarray, axes: np.ndarray) -> Iterator[Look]:
    """The faces of the homogeneous box that has these moments of inertia (3,) about its axes (3,
    3), row by row; a plate gets a visible thickness."""
    # A1 = m (b^2 + c^2)/12, and so on: a^2 is proportional to A2 + A3 - A1.
    sides = np.sqrt(np.maximum(A.sum() - 2 * A, 0))
    half = 0.6 * np.maximum(sides / sides.max(), 0.03)
    square = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    for axis in range(3):
        for sign in (1, -1):
            corners = (np.insert(square, axis, sign, axis=1) * half) @ axes
            yield stroke(corners, AXIS_LOOKS[axis + 1][0], kind="face", of="body")


def draw_moment(axes: Axes, scene: Any, i: int, symbol: str) -> None:
    """Draw the body at place i of a scene into a panel."""
    from scipy.spatial.transform import Rotation  # late: it takes longer than most pictures

    V = np.array(scene["view"])
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
    axes.set_title(f"${symbol}$ = {time_text(scene['time'][i], scene['time'][0], 5)}")
    axes.set_axis_off()


def film(sheet: Sheet, path: Path) -> None:
    """The film of a moving body as GIF."""
    with sheet.figure.styled():
        fig, times = Figure((FILM_SIZE, FILM_SIZE), dpi=FILM_DPI), sheet.scene["time"]
        canvas: Any = FigureCanvasAgg(fig)
        axes, pictures = fig.add_axes((0, 0, 1, 0.93)), []
        count = max(2, round(FRAMES_A_SECOND * sheet.scene["seconds"]))
        for when in np.linspace(times[0], times[-1], count):
            axes.clear()
            i = min(int(np.searchsorted(times, when)), len(times) - 1)
            draw_moment(axes, sheet.scene, i, sheet.spec["time"])
            canvas.draw()
            shown = Image.fromarray(np.array(canvas.buffer_rgba()))
            pictures.append(shown.convert("P", palette=Image.Palette.ADAPTIVE))
    # The format is given, because the name of a draft does not show it.
    first, pause = pictures[0], 1000 // FRAMES_A_SECOND
    first.save(path, "gif", save_all=True, append_images=pictures[1:], duration=pause, loop=0)
