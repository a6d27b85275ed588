"""Curves in space: hodographs, spheres, the ellipsoid of inertia with its polhodes, and
herpolhodes. Each is drawn in one orthographic view; the viewer turns the strokes of its scene."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from ..models.rigid_body import separatrix_circles
from ..quantities import direction
from ..results.motion import Motion
from .between import Course
from .look import (
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
    looks,
    mark_legend,
    marks,
    name_curves,
    names_beside,
    number_marks,
    pieces,
    stroke,
    unit,
    width_of,
)
from .words import HALO, Words


def view_matrix(angles: Sequence[float]) -> np.ndarray:
    """The directions right, up and toward the reader (3, 3), from elevation and azimuth."""
    e, a = map(math.radians, angles)
    se, ce, sa, ca = math.sin(e), math.cos(e), math.sin(a), math.cos(a)
    return np.array([(-sa, ca, 0), (-se * ca, -se * sa, ce), (ce * ca, ce * sa, se)])


def pale(colour: Any, part: float = 0.65) -> np.ndarray:
    """A colour (3,) mixed with white, as on the far side."""
    return np.array(to_rgb(colour)) * (1 - part) + part


def arrow(
    axes: Axes, tail: Any, tip: Any, name: str = "", colour: Any = GREY, zorder: float = 1
) -> None:
    """Draw an arrow in the page with its name beyond the tip."""
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
    V, zoom, planes = view_matrix(spec["view"]), spec["zoom"], spec["projections"]
    every = np.concatenate([m.G for m in motions])
    size = float(np.abs(every).max()) or 1.0
    up = np.maximum(1.1 * every.max(axis=0), 0.45 * size)
    down = np.maximum(-1.1 * every.min(axis=0), 0.12 * size)
    seen = np.concatenate([every, np.diag(up), -np.diag(down)]) @ V.T
    low, high = seen.min(axis=0)[:2] - 0.07 * size, seen.max(axis=0)[:2] + 0.09 * size
    n, shape = 1 + (zoom is not None) + len(planes), float(np.divide(*(high - low)))
    columns = sheet.columns(PAGE, 2) if n > 1 else 1
    if columns == 1:
        panels = sheet.panels(COLUMN, n * (COLUMN / max(shape, 0.8) + 0.3), n)
    elif n == 2:
        height = min(PAGE / (shape + 1), 3.3) + 0.3
        panels = sheet.panels(PAGE, height, 2, 2, width_ratios=[shape, 1])
    else:
        panels = sheet.panels(PAGE, 0.95 * PAGE, n, 2)
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
    """Hodographs in a view V with body axes of these lengths, paler the farther they are; those
    parts alone of which no component is beyond the reach."""
    body_axes(sheet, axes, V, arms, motions[0] if reach == math.inf else None)
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
        if reach == math.inf:
            heading(axes, seen, palette[code[0]], 0.12 * depth)
            add_strokes(sheet, m, m.G, (palette, code), crossed, m.label)
        flat[m.name] = np.where(inside[:, None], seen[:, :2], np.nan)
        near = np.where(np.abs(crossed).max(axis=1, keepdims=True) <= reach, crossed, np.nan)
        marks(axes, flat[m.name], (near @ V.T)[:, :2], 2 * reach)
    name_curves(axes, names_beside(motions, sheet.spec), [flat[m.name] for m in motions])
    axes.set(aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set(visible=reach < math.inf, color="#BBBBBB")


def body_axes(
    sheet: Sheet, axes: Axes, V: np.ndarray, arms: tuple[np.ndarray, np.ndarray], m: Motion | None
) -> None:
    """The axes of G1, G2, G3 through the origin, with round values on those that the view does not
    shorten too much; of a motion that is shown whole with units, and for the viewer."""
    up, down = arms
    step = round_step(float(up.max()))
    for i, direct in enumerate(np.eye(3)):
        tail, tip, along = -down[i] * direct, up[i] * direct, (V @ direct)[:2]
        # Without this a right-handed frame would look like its mirror image.
        colour = to_hex(tuple(pale(GREY))) if (V @ tip)[2] < -1e-9 else GREY
        # Once for all three, which have one scale: each longer name would lie on a curve.
        name = axis_label(m, "G.x3") if m and i == 2 else f"$G_{i + 1}$"
        arrow(axes, (V @ tail)[:2], (V @ tip)[:2], name, colour)
        for count in range(1, int(0.87 * up[i] / step) + 1) if math.hypot(*along) > 0.5 else ():
            at = tuple(along * count * step)
            axes.plot(*at, ".", ms=2, color=GREY)
            # An upright axis has its values to the right, the others below.
            shift = (4, 0) if abs(along[1]) > abs(along[0]) else (1, -6)
            look: Look = {"size": "x-small", "color": GREY, "va": "center", "path_effects": HALO}
            words = f"{count * step:.6g}"
            axes.annotate(words, at, shift, textcoords="offset points", zorder=5, **look)
        if m:
            ends = stroke([tail, tip], GREY, name=f"G{i + 1}", kind="axis")
            sheet.scene.setdefault("strokes", []).append(ends)


def add_strokes(
    sheet: Sheet, m: Motion, curve: np.ndarray, colours: Any, crossed: np.ndarray, name: str
) -> None:
    """Add a curve (n, 3) and its marks to the scene of the viewer."""
    strokes, (palette, code) = sheet.scene.setdefault("strokes", []), colours
    for part in pieces(code):
        strokes.append(stroke(curve[part], palette[code[part.start]], m.time[part], name=name))
    moving = curve[np.isfinite(curve).all(axis=1)]
    named = [(moving[:1], "white", "start"), (moving[-1:], "black", "end")]
    named += [
        (crossed[[i]], CROSSING["mfc"], f"crossing at {t:.12g}")
        for i, t in enumerate(m.crossing_time)
    ]
    strokes += [stroke(point, colour, kind="mark", name=words) for point, colour, words in named]


def heading(axes: Axes, seen: np.ndarray, colour: Any, size: float) -> None:
    """Draw an arrow head that shows the direction of a curve, near its start."""
    beyond = np.flatnonzero(np.hypot(*(seen - seen[0])[:, :2].T) > size)
    if beyond.size and beyond[0]:
        i = beyond[0]
        arrow(axes, seen[i - 1, :2], seen[i, :2], "", to_hex(colour), 5)


@dataclass(frozen=True)
class GlobeCurve:
    """A curve on a globe by its normals (n, 3), with its name."""

    motion: Course
    normals: np.ndarray
    label: str


Surface = Callable[[np.ndarray], np.ndarray]
"""The points (..., 3) of a closed surface at which it has these unit normals (..., 3)."""


def ellipsoid_of(m: Motion) -> Surface:
    """The surface 2 T = const of the ellipsoid of inertia, its longest axis 1. omega lies where the
    normal is G/|G|, and runs along a polhode."""
    Q, A = m.principal_axes, m.inertia

    def surface(normals: np.ndarray) -> np.ndarray:
        along = normals @ Q.T
        size = np.sqrt((along * along / A).sum(axis=-1, keepdims=True) / min(A))
        return np.asarray((along / A / size) @ Q)

    return surface


def sphere(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Draw the curves of G/|G| on the unit sphere, with the separatrix of each body, or the
    polhodes, curves of omega on the ellipsoid of inertia of the first body."""
    paths = [GlobeCurve(m, direction(m), m.label) for m in motions]
    for m in motions:
        m.check_separatrix()
        sheet.record_vector(m, direction(m.samples), [f"G.x{i}/|G|" for i in (1, 2, 3)])
    surface = ellipsoid_of(motions[0]) if sheet.spec["ellipsoid"] else np.asarray
    first = {m.inertia.tobytes(): m for m in reversed(motions)}
    on_globe(sheet, paths, ("$x_1$", "$x_2$", "$x_3$"), [*first.values()], surface)
    if sheet.spec["ellipsoid"]:
        Q, A = motions[0].principal_axes, motions[0].inertia
        sheet.scene["normal"] = (Q.T * A @ Q / A.max()).tolist()


def axis_trace(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Draw the directions in space of axes of the body, on the unit sphere."""
    paths = []
    for m in motions:
        for axis in sheet.spec["axes"]:
            label = f"${axis[0]}_{axis[1]}$" + f", {m.label}" * (len(motions) > 1)
            name = f"{axis}_space"
            sheet.record_vector(m, m.samples.vector(name), [f"{name}.{x}" for x in "xyz"], label)
            paths.append(GlobeCurve(m, m.vector(name), label))
    on_globe(sheet, paths, ("$x$", "$y$", "$z$"), [], np.asarray)


def on_globe(
    sheet: Sheet, paths: Sequence[GlobeCurve], arms: Sequence[str], bodies: Sequence[Motion],
    surface: Surface,
) -> None:  # fmt: skip
    """Draw curves on a globe, whose far side is pale, with the separatrices of bodies."""
    (axes,), V = sheet.panels(COLUMN, 1.05 * COLUMN), view_matrix(sheet.spec["view"])
    sheet.scene |= {"globe": surface is np.asarray, "normal": np.eye(3).tolist(), "strokes": []}
    globe_below(sheet, axes, V, bodies, surface)
    for foot, name in zip(np.eye(3), arms, strict=True):
        tail = surface(foot)
        near = (V @ foot)[2] > -1e-9
        arrow(axes, (V @ tail)[:2], (V @ (tail + 0.2 * foot))[:2], name, zorder=5 if near else 1)
        words = name.strip("$").replace("_", "")
        sheet.scene["strokes"].append(
            stroke([tail, tail + 0.2 * foot], GREY, kind="axis", name=words)
        )
    by_case = sheet.spec["colour"] == "case"
    ways = looks(len(paths), sheet.spec.get("styles", ()), solid=True)
    colours = colours_of([path.motion for path in paths], sheet.spec)
    for path, way, (palette, code) in zip(paths, ways, colours, strict=True):
        if by_case:
            palette = np.array([to_rgb(way["color"])])
        globe_curve(sheet, axes, V, path, (palette, code), surface)
    fronts = [(surface(x.normals) @ V.T)[(x.normals @ V.T)[:, 2] > 0.2, :2] for x in paths]
    names = [path.label for path in paths] if len(paths) > 1 else []
    name_curves(axes, names, fronts, [way["color"] if by_case else "black" for way in ways])
    axes.set(xlim=(-1.3, 1.3), ylim=(-1.15, 1.35), aspect="equal")
    axes.set_axis_off()
    motions = [path.motion for path in paths]
    if not by_case:
        colour_legend(sheet, [axes], motions)
    elif arms[0] == "$x$":
        for path, way in zip(paths, ways, strict=True):
            sheet.handles.append(Line2D([], [], **way, label=path.label))
    if bodies and any(separatrix_circles(m.inertia) for m in bodies):
        sheet.handles.append(Line2D([], [], **SEPARATRIX, label="separatrix, $D = 0$"))
    mark_legend(sheet, motions)


def globe_below(
    sheet: Sheet, axes: Axes, V: np.ndarray, bodies: Sequence[Motion], surface: Surface
) -> None:
    """Draw a globe with its graticule and the separatrices of bodies."""
    c, s = np.cos(CIRCLE), np.sin(CIRCLE)
    outline = surface(c[:, None] * V[0] + s[:, None] * V[1]) @ V.T
    axes.add_patch(Polygon(outline[:, :2], fc="#F8F8F8", ec=GREY, lw=0.6, zorder=1.1))
    grid: Look = {"color": "#C8C8C8", "lw": 0.35}
    lines: list[tuple[np.ndarray, Look]] = []
    for b in np.radians([-60, -30, 0, 30, 60]):
        lines.append((np.stack([np.cos(b) * c, np.cos(b) * s, 0 * c + np.sin(b)], -1), grid))
    for a in np.radians(range(0, 180, 30)):
        lines.append((np.stack([np.cos(a) * c, np.sin(a) * c, s], -1), grid))
    for m in bodies:
        circles = separatrix_circles(m.inertia)
        lines += [(circle @ m.principal_axes, SEPARATRIX) for circle in circles]
    for normals, look in lines:
        points = surface(normals)
        far_and_near(axes, points @ V.T, (normals @ V.T)[:, 2], **look)
        drawn = stroke(points, look["color"], width=look["lw"], dashed=look is SEPARATRIX)
        sheet.scene["strokes"].append(drawn)


CIRCLE = np.linspace(0, 2 * np.pi, 181)
"""The angles of a circle whose polygon the eye sees as a circle."""


def globe_curve(
    sheet: Sheet, axes: Axes, V: np.ndarray, path: GlobeCurve, colours: Any, surface: Surface
) -> None:
    """Draw one curve on a globe with its marks."""
    m, (palette, code) = path.motion, colours
    curve, near = surface(path.normals), (path.normals @ V.T)[:, 2]
    seen, crossed = curve @ V.T, m.at(m.crossing_time, path.normals)
    for part in pieces(code):
        far_and_near(axes, seen[part], near[part], color=palette[code[part.start]], lw=1.1)
    heading(axes, seen, palette[code[0]], 0.15)
    add_strokes(sheet, m, curve, colours, surface(crossed), path.label)
    known = np.flatnonzero(np.isfinite(seen).all(axis=1))
    ends = [(START, seen[known[:1]], near[known[:1]]), (END, seen[known[-1:]], near[known[-1:]])]
    ends.append((CROSSING, surface(crossed) @ V.T, (crossed @ V.T)[:, 2]))
    for look, points, depth in ends:
        for (x, y, _), z in zip(points, depth, strict=True):
            axes.plot(x, y, **look, alpha=1 if z > 0 else 0.4, zorder=6)
    number_marks(axes, ends[-1][1][:, :2], 0.1)


def far_and_near(axes: Axes, seen: np.ndarray, near: np.ndarray, color: Any, **look: Any) -> None:
    """A curve in view (n, 3) on a globe, pale where its normals point away from the reader."""
    for part in pieces(near < 0):
        far = near[part.start] < 0
        shade, zorder = (pale(color), 2) if far else (color, 3)
        axes.plot(*seen[part, :2].T, **{"ls": "-", **look}, color=shade, zorder=zorder)


def herpolhode(sheet: Sheet, motions: Sequence[Course]) -> None:
    """Draw omega in space, projected along the G of the start."""
    (axes,) = sheet.panels(COLUMN, 1.05 * COLUMN)
    planes = [across(m.vector("G_space")[0]) for m in motions]
    # The axes of the plane are axes of space only if G points along z.
    prime = "" if np.abs(np.array(planes) - np.eye(2, 3)).max() < 1e-9 else "'"
    for m, plane in zip(motions, planes, strict=True):
        sheet.record_vector(
            m, m.samples.vector("omega_space") @ plane.T, [f"omega_space.{x}{prime}" for x in "xy"]
        )
    points = [m.vector("omega_space") @ plane.T for m, plane in zip(motions, planes, strict=True)]
    curves(axes, motions, sheet.spec, points)
    look: Look = {"marker": "+", "ls": "", "color": "black", "ms": 6}
    axes.plot(0, 0, **look)
    labels = [rf"$\omega_{{{x}{prime}}}$ {unit(motions[0], 'omega')}" for x in "xy"]
    axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
    colour_legend(sheet, [axes], motions)
    sheet.handles.append(Line2D([], [], **look, label="$G$ at the start"))
    mark_legend(sheet, motions)


def across(vector: np.ndarray) -> np.ndarray:
    """Two unit vectors (2, 3): x and y turned by the shortest rotation that takes z to a vector."""
    x, y, z = vector / max(float(np.hypot.reduce(vector)), math.ulp(0))
    c = max(1 + z, 1e-8)
    return np.array([[1 - x * x / c, -x * y / c, -x], [-x * y / c, 1 - y * y / c, -y]])
