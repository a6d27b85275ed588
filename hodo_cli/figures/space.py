"""Figures in space: hodographs, spheres, the ellipsoid of inertia with its polhodes, herpolhodes,
and the body that moves. Each is drawn in one orthographic view; the viewer turns the strokes of its
scene."""

import math
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product, repeat
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image

from .. import HodoError
from ..models.rigid_body import separatrix_circles
from ..quantities import direction
from ..results.motion import Motion
from ..text import time_text
from .between import Course, samples_in
from .files import page_of
from .look import (
    AXIS_LOOKS,
    COLOURS,
    COLUMN,
    CROSSING,
    END,
    GREY,
    PAGE,
    SEPARATRIX,
    START,
    Look,
    Sheet,
    axis_label,
    check_zoom,
    colour_legend,
    colours_of,
    curves,
    mark_legend,
    marks,
    name_curves,
    names_beside,
    number_marks,
    pieces,
    unit,
    usual_width,
    width_of,
)
from .words import HALO, Words


def pale(colour: Any, part: float = 0.65) -> tuple[float, ...]:
    """A colour mixed with white, as on the far side."""
    return tuple(np.array(to_rgb(colour)) * (1 - part) + part)


def arrow(
    axes: Axes, tail: Any, tip: Any, name: str = "", colour: Any = GREY, zorder: float = 1
) -> None:
    """Draw an arrow in the plane of the page, with its name beyond the tip."""
    head = "-|>,head_width=0.14,head_length=0.35"
    shape = {"arrowstyle": head, "lw": 0.5, "color": colour, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(tip), tuple(tail), arrowprops=shape, zorder=zorder)
    if name:
        Words(axes, name, [tip], toward=tip, color="black" if colour == GREY else colour)


def round_step(size: float) -> float:
    """A round spacing that puts two to five marks up to a size."""
    power = 10.0 ** math.floor(math.log10(size / 2))
    return max(m * power for m in (1, 2, 5) if m * power <= size / 2)


def hodograph(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Draw the curve of G in body axes, with panels for the neighbourhood of the origin and for
    projections."""
    spec = sheet.spec
    V, zoom, planes = sheet.view, spec["zoom"], spec["projections"]
    all_points = np.concatenate([m.G for m in motions])
    size = float(np.abs(all_points).max()) or 1.0
    # How far the axes are drawn: beyond the curve, and far enough to be seen.
    up = np.maximum(1.1 * all_points.max(axis=0), 0.45 * size)
    down = np.maximum(-1.1 * all_points.min(axis=0), 0.12 * size)
    seen = np.concatenate([all_points, np.diag(up), -np.diag(down)]) @ V.T
    low, high = seen.min(axis=0)[:2] - 0.07 * size, seen.max(axis=0)[:2] + 0.09 * size
    n, shape = 1 + (zoom is not None) + len(planes), float(np.divide(*(high - low)))
    columns, grid = sheet.columns(min(n, 2)), dict[str, Any]()
    row = COLUMN / max(shape, 0.8) + 0.3 if columns == 1 else 0.475 * PAGE
    if n == columns == 2:
        row, grid = min(PAGE / (shape + 1), 3.3) + 0.3, {"width_ratios": [shape, 1]}
    panels = sheet.panels(row, n, columns, **grid)
    for m in motions:
        sheet.record_vector(m, m.samples.G, [f"G.x{i}" for i in (1, 2, 3)])
    in_space(sheet, panels[0], motions, V, (up, down))
    panels[0].set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    if zoom is not None:
        check_zoom(zoom, min(float(np.abs(m.G).max(axis=1).min()) for m in motions))
        in_space(sheet, panels[1], motions, V, (np.full(3, zoom), np.full(3, zoom)), zoom)
        ends = (-1.25 * zoom, 1.25 * zoom)
        panels[1].set(xlim=ends, ylim=ends, title=f"enlarged, to $|G_i|$ = {zoom:g}")
    for axes, plane in zip(panels[n - len(planes) :], planes, strict=True):
        i, j = int(plane[1]) - 1, int(plane[3]) - 1
        curves(axes, motions, spec, [m.G[:, [i, j]] for m in motions])
        labels = [axis_label(motions[0], f"G.x{k + 1}") for k in (i, j)]
        axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
    colour_legend(sheet, panels, motions)
    mark_legend(sheet, motions)


def in_space(
    sheet: Sheet, axes: Axes, motions: Sequence[Course], V: np.ndarray,
    arms: tuple[np.ndarray, np.ndarray], reach: float = math.inf,
) -> None:  # fmt: skip
    """Draw hodographs in a view V, paler where they are farther, with body axes of these lengths;
    only the parts with no component beyond `reach`."""
    is_whole = reach == math.inf
    body_axes(sheet, axes, V, arms, motions[0] if is_whole else None)
    chosen = zip(motions, colours_of(motions, sheet.spec), strict=True)
    flat = {}
    # The longest curve first, so that it does not hide the short ones.
    for m, (palette, code) in sorted(chosen, key=lambda item: width_of(item[0])):
        seen, crossed = m.G @ V.T, m.at(m.crossing_time, m.G)
        depth = min(reach, float(np.abs(seen).max())) or 1.0
        layer = np.clip((seen[:, 2] / depth * 6).round(), -6, 6).astype(int)
        inside = np.abs(m.G).max(axis=1) <= reach
        parts = [part for part in pieces(code, layer, inside) if inside[part.start]]
        parts.sort(key=lambda part: layer[part.start])
        shades = [pale(palette[code[p.start]], (6 - layer[p.start]) / 24) for p in parts]
        look: Look = {"linewidths": width_of(m), "capstyle": "round"}
        lines = LineCollection([seen[part, :2] for part in parts], colors=shades, **look)
        axes.add_collection(lines, autolim=False)
        if is_whole:
            heading(axes, seen, palette[code[0]], 0.12 * depth)
            add_strokes(sheet, m, m.G, (palette, code), crossed, m.label)
        flat[m.name] = np.where(inside[:, None], seen[:, :2], np.nan)
        near = np.where(np.abs(crossed).max(axis=1, keepdims=True) <= reach, crossed, np.nan)
        marks(axes, flat[m.name], (near @ V.T)[:, :2], 2 * reach)
    name_curves(axes, names_beside(motions, sheet.spec), [flat[m.name] for m in motions])
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set(visible=not is_whole, color="#BBBBBB")


def body_axes(
    sheet: Sheet, axes: Axes, V: np.ndarray, arms: tuple[np.ndarray, np.ndarray], m: Motion | None
) -> None:
    """Draw the axes of G1, G2, G3 through the origin, with round values on axes that the view does
    not shorten too much. For a motion `m`, which is shown whole, they have units, and are strokes
    of the viewer too."""
    step = round_step(float(arms[0].max()))
    for i, (direct, up, down) in enumerate(zip(np.eye(3), *arms, strict=True)):
        ends, along = np.array([-down * direct, up * direct]), (V @ direct)[:2]
        # An axis that points away is pale: else a right-handed frame would look left-handed.
        colour = pale(GREY) if (V @ direct)[2] < -1e-9 else GREY
        # Units once, because the axes have one scale, and each longer name would lie on a curve.
        name = axis_label(m, "G.x3") if m and i == 2 else f"$G_{i + 1}$"
        tail, tip = (ends @ V.T)[:, :2]
        arrow(axes, tail, tip, name, colour)
        for count in range(1, int(0.87 * up / step) + 1) if math.hypot(*along) > 0.5 else ():
            at = tuple(along * count * step)
            axes.plot(*at, ".", ms=2, color=GREY)
            # An upright axis has its values to the right, the others below.
            shift = (4, 0) if abs(along[1]) > abs(along[0]) else (1, -6)
            look: Look = {"size": "x-small", "color": GREY, "va": "center", "path_effects": HALO}
            words = f"{count * step:.6g}"
            axes.annotate(words, at, shift, textcoords="offset points", zorder=5, **look)
        if m:
            sheet.stroke(ends, GREY, name=f"G{i + 1}", kind="axis")


def add_strokes(
    sheet: Sheet, m: Motion, curve: np.ndarray, colours: Any, crossed: np.ndarray, name: str
) -> None:
    """Add a curve (n, 3) and its marks to the scene of the viewer."""
    palette, code = colours
    for part in pieces(code):
        sheet.stroke(curve[part], palette[code[part.start]], m.time[part], name=name)
    moving = curve[np.isfinite(curve).all(axis=1)]
    sheet.stroke(moving[:1], "white", kind="mark", name="start")
    sheet.stroke(moving[-1:], "black", kind="mark", name="end")
    for point, t in zip(crossed, m.crossing_time, strict=True):
        sheet.stroke([point], CROSSING["mfc"], kind="mark", name=f"crossing at {t:.12g}")


def heading(axes: Axes, seen: np.ndarray, colour: Any, size: float) -> None:
    """Draw an arrow head that shows the direction of a curve, near its start."""
    beyond = np.flatnonzero(np.hypot(*(seen - seen[0])[:, :2].T) > size)
    if beyond.size and beyond[0]:
        i = beyond[0]
        arrow(axes, seen[i - 1, :2], seen[i, :2], "", to_hex(colour), 5)


Surface = Callable[[np.ndarray], np.ndarray]
"""A function from unit normals (..., 3) to the points (..., 3) at which a closed surface has
them."""

Curve = tuple[Course, np.ndarray, str]
"""A curve on a globe: its motion, its normals (n, 3), and its name."""


def sphere(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Draw the curves of G/|G| on the unit sphere, with the separatrix of each body, or the
    polhodes, curves of omega on the ellipsoid of inertia of the first body."""
    for m in motions:
        m.check_separatrix()
        sheet.record_vector(m, direction(m.samples), [f"G.x{i}/|G|" for i in (1, 2, 3)])
    surface: Surface = np.asarray
    if sheet.spec["ellipsoid"]:
        Q, A = motions[0].principal_axes, motions[0].inertia
        surface = partial(on_ellipsoid, Q, A)
        sheet.scene["normal"] = (Q.T * A @ Q / A.max()).tolist()
    bodies = {m.inertia.tobytes(): m for m in reversed(motions)}
    circles = [c @ m.principal_axes for m in bodies.values() for c in separatrix_circles(m.inertia)]
    paths = [(m, direction(m), m.label) for m in motions]
    on_globe(sheet, paths, ("$x_1$", "$x_2$", "$x_3$"), circles, surface)


def on_ellipsoid(Q: np.ndarray, A: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """The points at which the ellipsoid of inertia 2 T = const, with longest semi-axis 1, has these
    normals. omega is at the point with the normal G/|G|, and runs along a polhode."""
    along = normals @ Q.T
    size = np.sqrt((along * along / A).sum(axis=-1, keepdims=True) / min(A))
    return np.asarray((along / A / size) @ Q)


def axis_trace(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Draw the directions in space of axes of the body, on the unit sphere."""
    paths = []
    for m, axis in product(motions, sheet.spec["axes"]):
        label = f"${axis[0]}_{axis[1]}$" + f", {m.label}" * (len(motions) > 1)
        name = f"{axis}_space"
        sheet.record_vector(m, m.samples.vector(name), [f"{name}.{x}" for x in "xyz"], label)
        paths.append((m, m.vector(name), label))
    on_globe(sheet, paths, ("$x$", "$y$", "$z$"), [], np.asarray)


def on_globe(
    sheet: Sheet, paths: Sequence[Curve], arms: Sequence[str], circles: Sequence[np.ndarray],
    surface: Surface,
) -> None:  # fmt: skip
    """Draw curves on a globe, whose far side is pale, with the circles of separatrices."""
    (axes,), V = sheet.panels(1.05 * COLUMN), sheet.view
    motions, _, labels = zip(*paths, strict=True)
    globe_below(sheet, axes, V, circles, surface)
    for foot, name in zip(np.eye(3), arms, strict=True):
        ends = surface(foot) + np.outer([0, 0.2], foot)
        near = (V @ foot)[2] > -1e-9
        tail, tip = (ends @ V.T)[:, :2]
        arrow(axes, tail, tip, name, zorder=5 if near else 1)
        sheet.stroke(ends, GREY, kind="axis", name=name.strip("$").replace("_", ""))
    by_case, colours = sheet.spec["colour"] == "case", colours_of(motions, sheet.spec)
    for path, of_path in zip(paths, colours, strict=True):
        globe_curve(sheet, axes, V, path, of_path, surface)
    # The points of each curve on the near side, off the rim: its name is written at one of them.
    fronts = [(surface(n) @ V.T)[(n @ V.T)[:, 2] > 0.2, :2] for _, n, _ in paths]
    if len(paths) > 1:
        shades = [palette[0] for palette, _ in colours] if by_case else []
        name_curves(axes, labels, fronts, shades)
    axes.set(xlim=(-1.3, 1.3), ylim=(-1.15, 1.35), aspect="equal")
    axes.set_axis_off()
    # Curves of G, which have arms x_1 to x_3, need no legend if their names have their colours.
    if not by_case or arms[0] == "$x$":
        colour_legend(sheet, [axes], motions, labels)
    if circles:
        sheet.name("separatrix, $D = 0$", **SEPARATRIX)
    mark_legend(sheet, motions)


def globe_below(
    sheet: Sheet, axes: Axes, V: np.ndarray, circles: Sequence[np.ndarray], surface: Surface
) -> None:
    """Draw a globe with its graticule and the circles of separatrices."""
    c, s = np.cos(CIRCLE), np.sin(CIRCLE)
    outline = surface(c[:, None] * V[0] + s[:, None] * V[1]) @ V.T
    axes.add_patch(Polygon(outline[:, :2], fc="#F8F8F8", ec=GREY, lw=0.6, zorder=1.1))
    sheet.scene = {"globe": surface is np.asarray, "normal": np.eye(3).tolist(), **sheet.scene}
    a, b = np.radians(range(0, 180, 30)), np.radians([-60, -30, 0, 30, 60])
    lines = [np.stack([np.cos(x) * c, np.cos(x) * s, 0 * c + np.sin(x)], axis=-1) for x in b]
    lines += [np.stack([np.cos(x) * c, np.sin(x) * c, s], axis=-1) for x in a]
    grid: Look = {"color": "#C8C8C8", "lw": 0.35}
    for normals, look in [*zip(lines, repeat(grid)), *zip(circles, repeat(SEPARATRIX))]:
        points = surface(normals)
        far_and_near(axes, points @ V.T, (normals @ V.T)[:, 2], **look)
        sheet.stroke(points, look["color"], width=look["lw"], dashed=look is SEPARATRIX)


CIRCLE = np.linspace(0, 2 * np.pi, 181)
"""The angles of a circle whose polygon the eye sees as a circle."""


def globe_curve(
    sheet: Sheet, axes: Axes, V: np.ndarray, path: Curve, colours: Any, surface: Surface
) -> None:
    """Draw one curve on a globe with its marks."""
    (m, normals, label), (palette, code) = path, colours
    curve, near = surface(normals), (normals @ V.T)[:, 2]
    seen, crossed = curve @ V.T, m.at(m.crossing_time, normals)
    for part in pieces(code):
        far_and_near(axes, seen[part], near[part], color=palette[code[part.start]], lw=1.1)
    heading(axes, seen, palette[code[0]], 0.15)
    add_strokes(sheet, m, curve, colours, surface(crossed), label)
    finite = normals[np.isfinite(normals).all(axis=1)]
    for look, points in ((START, finite[:1]), (END, finite[-1:]), (CROSSING, crossed)):
        for x, y, front in np.column_stack([(surface(points) @ V.T)[:, :2], points @ V[2]]):
            axes.plot(x, y, **look, alpha=1 if front > 0 else 0.4, zorder=6)
    number_marks(axes, (surface(crossed) @ V.T)[:, :2], 0.1)


def far_and_near(axes: Axes, seen: np.ndarray, near: np.ndarray, color: Any, **look: Any) -> None:
    """Draw a curve (n, 3), given in the view, on a globe; it is pale where its normals point away
    from the reader (`near` (n,) is negative)."""
    for part in pieces(near < 0):
        far = near[part.start] < 0
        shade, zorder = (pale(color), 2) if far else (color, 3)
        axes.plot(*seen[part, :2].T, **{"ls": "-", **look}, color=shade, zorder=zorder)


def herpolhode(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Draw the curves of omega in space, projected along G at the start."""
    (axes,) = sheet.panels(1.05 * COLUMN)
    planes = [across(m.vector("G_space")[0]) for m in motions]
    # The axes of the plane are axes of space only if G points along z.
    prime = "" if np.abs(np.array(planes) - np.eye(2, 3)).max() < 1e-9 else "'"
    names = [f"omega_space.{x}{prime}" for x in "xy"]
    for m, plane in zip(motions, planes, strict=True):
        sheet.record_vector(m, m.samples.vector("omega_space") @ plane.T, names)
    points = [m.vector("omega_space") @ plane.T for m, plane in zip(motions, planes, strict=True)]
    curves(axes, motions, sheet.spec, points)
    look: Look = {"marker": "+", "ls": "", "color": "black", "ms": 6}
    axes.plot(0, 0, **look)
    labels = [rf"$\omega_{{{x}{prime}}}$ {unit(motions[0], 'omega')}" for x in "xy"]
    axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
    colour_legend(sheet, [axes], motions)
    sheet.name("$G$ at the start", **look)
    mark_legend(sheet, motions)


def across(vector: np.ndarray) -> np.ndarray:
    """Two unit vectors (2, 3) across a vector: x and y turned by the shortest rotation that takes z
    to its direction."""
    x, y, z = vector / max(float(np.hypot.reduce(vector)), math.ulp(0))
    c = max(1 + z, 1e-8)
    return np.array([[1 - x * x / c, -x * y / c, -x], [-x * y / c, 1 - y * y / c, -y]])


# A body that moves: printed at some moments, played and turned in a page, or written as a film. All
# three draw the same strokes, in axes of the body or of space.

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
    """Draw the body in space at some moments, with G, omega, the hodograph on the body and the
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
    # Two different lengths, because G and omega often point the same way.
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

    scene, V = sheet.scene, sheet.view
    R = Rotation.from_quat(np.roll(scene["attitude"][i], -1)).as_matrix()
    for part in scene["strokes"]:
        points, colour = np.array(part["points"]), part["colour"]
        seen = (points @ R.T if part.get("of") == "body" else points) @ V.T
        x, y, near = seen.T
        if part["kind"] == "face":
            # A face in front is transparent, over the strokes behind it.
            front = bool(near.mean() > 0)
            look: Look = {"alpha": 0.2 if front else 0.35, "zorder": 4 if front else 1}
            axes.fill(x, y, fc=colour, ec=GREY, lw=0.5, ls="-", **look)
        elif part["kind"] == "trail":
            axes.plot(x, y, "-", color=colour, lw=0.5, alpha=0.3, zorder=2)
            axes.plot(x[: i + 1], y[: i + 1], "-", color=colour, lw=0.9, zorder=3)
        elif (tip := seen[min(i, len(x) - 1)]).any():  # at rest there is no arrow
            of_space = part["name"] in "xyz"
            # An axis that points away is pale: else space would look left-handed.
            shade = pale(colour) if of_space and tip[2] < -1e-9 else colour
            of_body = part["name"].replace("ω", r"\omega").replace("x", "x_")
            name = part["name"] if of_space else of_body
            arrow(axes, (0, 0), tip[:2], f"${name}$", shade, 2 if of_space else 5)
    axes.set(xlim=(-1.3, 1.3), ylim=(-1.3, 1.3), aspect="equal")
    axes.set_title(f"${sheet.spec['time']}$ = {time_text(scene['time'][i], scene['time'][0], 5)}")
    axes.set_axis_off()


def film(sheet: Sheet, path: Path) -> None:
    """Write the film of a moving body as GIF."""
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
