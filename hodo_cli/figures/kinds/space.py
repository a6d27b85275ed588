"""Curves in space: hodographs and spheres."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle, product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from ...cases.derived import SPACE_AXES, component_names
from ...models.rigid_body import separatrix_circles
from ...results.motion import Motion, directions_of_momentum
from ...text import grouped
from ..artists import (
    BLACK,
    CROSSING,
    END,
    GREY,
    PALE_GREY,
    SEPARATRIX,
    START,
    arrow,
    case_handles,
    check_zoom,
    colour_handles,
    crossings_on,
    heading,
    line_styles,
    line_width,
    mark_handles,
    mark_points,
    name_curves,
    names_beside,
    number_marks,
    palettes,
    plane_curves,
    stretches,
    styles,
    windings,
)
from ..sheet import COLUMN, PAGE, Look, Scene, Sheet, View
from ..symbols import axis_label, unit
from ..words import HALO, Words, in_formula


def hodograph(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """The curve of G in body axes; beside it, if wanted, its neighbourhood of the origin and its
    projections."""
    view, planes, zoom = View(spec["view"]), spec["projections"], spec["zoom"]
    for motion in motions:
        sheet.record_path(motion, component_names("G", "axis"), motion.G)
    up, down = (
        np.max([(sign * motion.G).max(axis=0) for motion in motions], axis=0) for sign in (1, -1)
    )
    size = float(np.maximum(up, down).max()) or 1.0
    reach = np.stack([np.maximum(1.15 * up, 0.45 * size), np.maximum(1.05 * down, 0.12 * size)])
    seen = [motion.G for motion in motions] + [np.diag(reach[0]), -np.diag(reach[1])]
    frame = extent(np.concatenate([view(points)[:, :2] for points in seen]))
    main, *others = hodograph_panels(sheet, frame, 1 + (zoom is not None) + len(planes))
    names = [axis_label(f"G.x{i}", motions[0]) for i in (1, 2, 3)]
    space(sheet.scene(main, view, names), motions, spec, reach, frame)
    if zoom is not None:
        nearest = min(float(np.abs(motion.G).max(axis=1).min()) for motion in motions)
        check_zoom(zoom, nearest, unit(motions[0], "G"))
        window = np.array([[-1.25, 1.25], [-1.25, 1.25]]) * zoom
        enlarged = sheet.scene(others[0], view, names, reach=zoom)
        space(enlarged, motions, spec, np.full((2, 3), zoom), window)
        others[0].set(title=f"enlarged, to $|G_i| = {in_formula(f'{zoom:g}')}$")
    for axes, plane in zip(others[zoom is not None :], planes, strict=True):
        projection(axes, motions, spec, plane)
    sheet.legend += colour_handles(sheet, [main, *others], motions, spec)
    sheet.legend += mark_handles(motions, spec["time"], wide=sheet.is_wide and bool(others))


def extent(seen: np.ndarray) -> np.ndarray:
    """((left, right), (bottom, top)) of points (n, 2) in view, with a margin."""
    lo, hi = seen.min(axis=0), seen.max(axis=0)
    margin = 0.07 * (hi - lo).max()
    return np.stack([lo - margin, hi + margin], axis=-1)


def hodograph_panels(sheet: Sheet, frame: np.ndarray, n: int) -> list[Axes]:
    """n panels, the first shaped as the frame."""
    shape = float(np.clip(np.ptp(frame[0]) / np.ptp(frame[1]), 0.5, 2))
    if n == 1:
        return sheet.panels(COLUMN, COLUMN / max(shape, 0.8) + 0.5)
    most = max(2, (n + 1) // 2)
    columns = sheet.columns(PAGE, most)
    if n == columns == 2:
        height = min(PAGE / (shape + 1), 3.3)
        return sheet.panels(PAGE, height + 0.45, 2, 2, width_ratios=[shape, 1])
    # Two full rows are nearly as high as they are wide.
    height = 0.95 * PAGE / 2 * math.ceil(n / columns) * most / columns
    return sheet.panels(PAGE, height, n, columns)


def space(
    scene: Scene,
    motions: Sequence[Motion],
    spec: Mapping[str, Any],
    reach: np.ndarray,
    frame: np.ndarray,
) -> None:
    """Hodographs in a view, with body axes of lengths `reach` (2, 3), within a frame (2, 2) of the
    page."""
    axes, is_enlarged, depth = scene.axes, scene.reach is not None, float(np.ptp(frame)) / 2
    body_axes(scene, reach)
    lines = line_styles(len(motions), spec)
    drawn = zip(motions, palettes(motions, spec), lines, strict=True)
    # The longest curve first, so that it does not bury the short ones.
    for motion, (colours, code), line in sorted(drawn, key=lambda item: -windings(item[0].G)):
        look = {"ls": line, "lw": line_width(motion)}
        seen = space_curve(scene, motion, colours, code, look, depth)
        if not is_enlarged:
            heading(axes, seen[:, :2], colours[code[0]], 0.12 * depth)
    curves = [scene.flat(motion.G) for motion in motions]
    crossings = [scene.flat(motion.at_crossings(motion.G)) for motion in motions]
    mark_points(axes, curves, crossings, frame)
    name_curves(axes, curves, names_beside(motions, spec))
    axes.set(xlim=frame[0], ylim=frame[1], aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set(visible=is_enlarged, color="#BBBBBB")


def space_curve(
    scene: Scene, motion: Motion, colours: np.ndarray, code: np.ndarray, look: Look, depth: float
) -> np.ndarray:
    """A hodograph in colours[code], with a look of its line, paler the farther it is from the
    reader, where `depth` is far; returns it as it is seen (n, 3)."""
    seen = scene.add(motion.G, colours, code, name=motion.label, time=motion.time, **look)
    scene.add(motion.G[[0]], **START)
    scene.add(motion.G[[-1]], **END)
    times = [f"crossing at {time:.12g}" for time in motion.crossing_time]
    scene.add(motion.at_crossings(motion.G), texts=times, **CROSSING)
    # Thirteen layers: enough to show depth, and few enough pieces of line.
    layer = np.clip((seen[:, 2] / depth * 6).round(), -6, 6).astype(int)
    white = 0.5 * (6 - layer[:, None]) / 12
    shades = colours[code] * (1 - white) + white
    shown = scene.shows(motion.G)
    pieces = [piece for piece in stretches(code, layer, shown) if shown[piece.start]]
    pieces.sort(key=lambda piece: int(layer[piece.start]))
    lines = LineCollection(
        [seen[piece, :2] for piece in pieces],
        colors=[shades[piece.start] for piece in pieces],
        linewidths=look["lw"],
        linestyles=look["ls"],
        capstyle="round",
    )
    scene.axes.add_collection(lines, autolim=False)
    return seen


def body_axes(scene: Scene, reach: np.ndarray) -> None:
    """The axes of G1, G2, G3 through the origin, of lengths `reach` (2, 3), named, with round
    values marked; numbered where they are not looked at along the axis, on one another."""
    right, up, _ = np.abs(scene.view(np.eye(3))).T
    is_numbered = np.hypot(right, up) > SHORTEST_NUMBERED
    step = round_step(float(reach[:, is_numbered].max()))
    for i, axis in enumerate(np.eye(3)):
        arm(scene, -reach[1, i] * axis, reach[0, i] * axis, f"G_{i + 1}")
        counts = np.arange(-int(reach[1, i] / step), int(0.87 * reach[0, i] / step) + 1)
        places = counts[counts != 0]
        texts = [f"{count * step:.10g}" if count > 0 else "" for count in places]
        dots: Look = {"marker": ".", "ms": 2, "color": GREY}
        at = scene.add(places[:, None] * step * axis, texts=texts, lw=0, size=6, **dots)
        scene.axes.plot(at[:, 0], at[:, 1], ls="", **dots, zorder=1)
        for count in range(1, counts[-1] + 1) if is_numbered[i] else ():
            # An upright axis has its values to the right, the others below.
            scene.axes.annotate(
                f"{count * step:.10g}",
                scene.view(count * step * axis)[:2].tolist(),
                (4, 0) if up[i] > right[i] else (1, -6),
                size="x-small",
                color=GREY,
                textcoords="offset points",
                va="center",
                zorder=5,
                path_effects=HALO,
            )


SHORTEST_NUMBERED = 0.5
"""The part of their length that the steps of an axis have on the page at least, if its numbers
stand apart."""


def round_step(size: float) -> float:
    """A round spacing, 1, 2 or 5 times a power of ten, of two to five marks up to `size` > 0."""
    power = 10.0 ** math.floor(math.log10(size / 2))
    return max(m * power for m in (1, 2, 5) if m * power <= size / 2)


def arm(scene: Scene, tail: np.ndarray, tip: np.ndarray, name: str, zorder: float = 1) -> None:
    """An arrow along an axis from tail to tip (3,), with its name, which is pale where it points
    away from the reader: else a right-handed frame would look like its mirror image. Behind a globe
    the arrow is pale too."""
    texts = ["", f"${name}$"]
    begin, end = scene.add(np.stack([tail, tip]), texts=texts, color=GREY, lw=0.5)
    is_far = end[2] < -IN_PAGE
    colour = pale(GREY) if is_far and scene.globe else GREY
    arrow(scene.axes, begin[:2], end[:2], colour, zorder)
    look: Look = {"color": PALE_GREY} if is_far else {}
    Words(scene.axes, f"${name}$", end[None, :2], toward=end[:2], **look)


IN_PAGE = 1e-9
"""How far behind the page an axis may point that lies in it but for rounding."""


def projection(axes: Axes, motions: Sequence[Motion], spec: Mapping[str, Any], plane: str) -> None:
    """The hodographs projected onto the plane of two body axes."""
    i, j = int(plane[1]) - 1, int(plane[3]) - 1
    curves = [motion.G[:, [i, j]] for motion in motions]
    plane_curves(axes, spec, motions, curves, crossings_on(motions, curves))
    name_curves(axes, curves, names_beside(motions, spec))
    axes.set(
        xlabel=axis_label(f"G.x{i + 1}", motions[0]),
        ylabel=axis_label(f"G.x{j + 1}", motions[0]),
        aspect="equal",
    )


DASHES = (SEPARATRIX["ls"], (0, (0.8, 1.6)), (0, (7, 1.5, 1, 1.5)), (0, (1, 4)))
"""The lines of the separatrices of several bodies where colours do not tell the cases apart."""

BodySeparatrix = tuple[str, Look, Sequence[np.ndarray]]
"""The separatrix of a body on the unit sphere: its words, its look, and its curves (n, 3)."""


def separatrices(motions: Sequence[Motion], spec: Mapping[str, Any]) -> list[BodySeparatrix]:
    """The separatrix of each body that has one: two great circles. Those of
    several bodies have the colours of their cases or, where these have none, lines of their own."""
    first_of_body: dict[Any, tuple[Motion, Look]] = {}
    for motion, style in zip(motions, styles(len(motions), spec["styles"]), strict=True):
        first_of_body.setdefault(motion.body, (motion, {"color": style["color"]}))
    are_several = len(first_of_body) > 1
    drawn: list[BodySeparatrix] = []
    for (motion, colour), line in zip(first_of_body.values(), cycle(DASHES), strict=False):
        own_look = colour if spec["colour"] == "case" else {"ls": line}
        words = f"separatrix of {motion.label}" if are_several else "separatrix"
        if not are_several:
            words += ", $D = 0$"
        if circles := separatrix_of(motion):
            drawn.append((words, SEPARATRIX | (own_look if are_several else {}), circles))
    return drawn


def separatrix_of(motion: Motion) -> list[np.ndarray]:
    """The curves (n, 3) of the separatrix of a motion's body in its axes; none without one."""
    motion.check_separatrix()
    return [circle @ motion.principal_axes for circle in separatrix_circles(motion.inertia)]


@dataclass(frozen=True)
class SphereCurve:
    """A curve of directions (n, 3) on the unit sphere: its motion, its name in the panel, and what
    its components are called."""

    motion: Motion
    directions: np.ndarray
    label: str
    columns: Sequence[str]


def sphere(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """The curves of G/|G| on the unit sphere, with the two separatrix circles."""
    columns = [f"G.x{i}/|G|" for i in (1, 2, 3)]
    curves = [
        SphereCurve(motion, directions_of_momentum(motion), motion.label, columns)
        for motion in motions
    ]
    draw_sphere(sheet, spec, curves, ("x_1", "x_2", "x_3"), separatrices(motions, spec))


def axis_trace(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """Where axes of the body point in space, on the unit sphere of directions."""
    curves = []
    for motion, axis in product(motions, spec["axes"]):
        case_name = f", {motion.label}" if len(motions) > 1 else ""
        label = f"${axis[0]}_{axis[1]}${case_name}"
        columns = component_names(f"{axis}_space", "space")
        curves.append(SphereCurve(motion, space_vector(motion, axis), label, columns))
    draw_sphere(sheet, spec, curves, SPACE_AXES, [])


def draw_sphere(
    sheet: Sheet,
    spec: Mapping[str, Any],
    curves: Sequence[SphereCurve],
    arms: Sequence[str],
    bodies: Sequence[BodySeparatrix],
) -> None:
    """Curves on the unit sphere, with the names of its three arms, and separatrices."""
    (axes,), view = sheet.panels(COLUMN, 1.08 * COLUMN), View(spec["view"])
    lowest = float(view(ARM * np.eye(3))[:, 1].min())
    scene = sheet.scene(axes, view, arms, globe=True)
    # Under the curves, which may run on the separatrices.
    globe_below(scene, bodies)
    motions = [curve.motion for curve in curves]
    is_trace, by_case = spec["kind"] == "axis-trace", spec["colour"] == "case"
    crossings = crossings_on(motions, [curve.directions for curve in curves])
    number_marks(axes, [view(crossed)[:, :2] for crossed in crossings])
    palette, lines = palettes(motions, spec), line_styles(len(curves), spec)
    for curve, crossed, coloured, line in zip(curves, crossings, palette, lines, strict=True):
        sheet.record_path(curve.motion, curve.columns, curve.directions, curve.label)
        sphere_curve(scene, curve, crossed, *coloured, {"ls": line, "lw": 1.1})
    entries = (
        case_handles([curve.label for curve in curves], spec["styles"])
        if by_case
        else colour_handles(sheet, [axes], motions, spec)
    )
    if len(curves) > 1 or is_trace:  # a single motion is named by its title
        name_on_sphere(scene, curves, [entry.get_color() for entry in entries] if by_case else [])
    # The curves of G have their names beside them alone.
    sheet.legend += entries if is_trace or not by_case else []
    axes.set(xlim=(-1.24, 1.24), ylim=(min(-1.12, lowest - 0.22), 1.32), aspect="equal")
    axes.set_axis_off()
    sheet.legend += [Line2D([], [], **look, label=words) for words, look, _ in bodies]
    sheet.legend += mark_handles(motions, spec["time"])


ARM = 1.2
"""How far the arms of a globe reach from its middle."""


def globe_below(scene: Scene, bodies: Sequence[BodySeparatrix]) -> None:
    """A globe with its graticule, its three arms, named, and the separatrices of bodies."""
    scene.axes.add_patch(Circle((0, 0), 1, fc="#F8F8F8", ec=GREY, lw=0.6, zorder=1.1))
    for line in graticule():
        on_sphere(scene.axes, scene.add(line, **GRATICULE), **GRATICULE)
    for foot, name in zip(np.eye(3), scene.names, strict=True):
        # Above the globe, within which an arm of its far side is seen, too.
        arm(scene, foot, ARM * foot, name, zorder=5 if scene.view(foot)[2] > -IN_PAGE else 2)
    for _, look, circles in bodies:
        for circle in circles:
            on_sphere(scene.axes, scene.add(circle, **look), **look)


def sphere_curve(
    scene: Scene,
    curve: SphereCurve,
    crossed: np.ndarray,
    colours: np.ndarray,
    code: np.ndarray,
    line: Look,
) -> None:
    """A curve on a globe in colours[code], with a look of its line, its direction, ends and
    crossings (m, 3)."""
    axes, time = scene.axes, curve.motion.time
    seen = scene.add(curve.directions, colours, code, name=curve.label, time=time, **line)
    for piece in stretches(code):
        on_sphere(axes, seen[piece], color=colours[code[piece.start]], **line)
    heading(axes, seen[:, :2], colours[code[0]], 0.15)
    moving = curve.directions[np.isfinite(curve.directions).all(axis=1)]
    for look, places in ((CROSSING, crossed), (START, moving[:1]), (END, moving[-1:])):
        for x, y, near in scene.add(places, **look):
            axes.plot(x, y, **look, alpha=1 if near > 0 else 0.4, zorder=6)


def name_on_sphere(scene: Scene, curves: Sequence[SphereCurve], colours: Sequence[Any]) -> None:
    """Name curves on a globe, in black or in colours."""
    starts = ((tuple(curve.directions[0].round(2)), curve.label) for curve in curves)
    for start, names in grouped(starts).items():
        # In space a name is beside the start, where it is on no side of the page.
        scene.add(1.08 * np.array([start]), texts=[", ".join(names)], lw=0)
    shown = [within_globe(scene.view(curve.directions)) for curve in curves]
    name_curves(scene.axes, shown, [curve.label for curve in curves], colours)


def graticule() -> list[np.ndarray]:
    """Parallels and meridians of the unit sphere about x3, 30 degrees apart, (181, 3) each."""
    turn = np.linspace(0, 2 * np.pi, 181)
    c, s = np.cos(turn), np.sin(turn)
    latitudes, longitudes = np.radians(np.arange(-60, 90, 30)), np.radians(np.arange(0, 180, 30))
    parallels = [
        np.stack([math.cos(b) * c, math.cos(b) * s, math.sin(b) + 0 * c], axis=-1)
        for b in latitudes
    ]
    meridians = [np.stack([math.cos(a) * c, math.sin(a) * c, s], axis=-1) for a in longitudes]
    return parallels + meridians


NAMES_WITHIN = 0.85
"""How far from the middle of a globe a curve is named."""


def within_globe(seen: np.ndarray) -> np.ndarray:
    """The points (m, 2) of a curve in view (n, 3) on the reader's side and not near its edge; all
    if there is none."""
    is_within = (seen[:, 2] > 0) & (np.hypot(*seen.T[:2]) < NAMES_WITHIN)
    return seen[is_within if is_within.any() else slice(None), :2]


GRATICULE: Look = {"color": "#C8C8C8", "lw": 0.35}


def herpolhode(sheet: Sheet, spec: Mapping[str, Any], motions: Sequence[Motion]) -> None:
    """omega in space, projected along the G of the start: while G and T stay, it lies in a plane
    across G."""
    (axes,) = sheet.panels(COLUMN, 1.05 * COLUMN)
    planes = [across(space_vector(motion, "G")[0]) for motion in motions]
    curves = [
        space_vector(motion, "omega") @ plane.T
        for motion, plane in zip(motions, planes, strict=True)
    ]
    along_z = np.abs(np.array(planes) - np.eye(2, 3)).max() < ALONG_ANGLE
    prime = "" if along_z else "'"
    for motion, points in zip(motions, curves, strict=True):
        sheet.record_path(motion, [f"omega_space.{letter}{prime}" for letter in "xy"], points)
    plane_curves(axes, spec, motions, curves, crossings_on(motions, curves))
    cross: Look = {"marker": "+", "ms": 6, "color": BLACK, "ls": ""}
    axes.plot(0, 0, **cross)
    name_curves(axes, curves, names_beside(motions, spec))
    labels = [f"$\\omega_{{{letter}{prime}}}$ {unit(motions[0], 'omega')}" for letter in "xy"]
    axes.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
    sheet.legend += colour_handles(sheet, [axes], motions, spec)
    each, its = ("", "") if len(motions) == 1 else ("each ", "its ")
    along = "" if along_z else f", along {its}$z'$"
    sheet.legend.append(Line2D([], [], **cross, label=f"{each}$G$ at the start{along}"))
    sheet.legend += mark_handles(motions, spec["time"])


ALONG_ANGLE = 1e-9
"""The angle from z below which a vector lies along it."""


def space_vector(motion: Motion, name: str) -> np.ndarray:
    """A vector (n, 3) of a motion along the axes of space."""
    return np.stack([motion[part] for part in component_names(f"{name}_space", "space")], axis=-1)


def across(vector: np.ndarray) -> np.ndarray:
    """Two unit vectors (2, 3) that make a right-handed frame with a vector (3,); x and y for z."""
    axis = vector / max(float(np.hypot.reduce(vector)), math.ulp(0))
    # The shortest turn from z to the vector carries x and y with it.
    c = 1 + axis[2]
    if c < 1e-8:
        return np.array([[1.0, 0, 0], [0, -1.0, 0]])
    x, y = axis[:2]
    return np.array([[1 - x * x / c, -x * y / c, -x], [-x * y / c, 1 - y * y / c, -y]])


def on_sphere(axes: Axes, seen: np.ndarray, **style: Any) -> None:
    """A curve in view (n, 3) on the sphere, pale on the far side."""
    # No alpha, of which many turns on one another would make the full colour.
    looks = [{**style, "zorder": 3}, {**style, "zorder": 2, "color": pale(style["color"])}]
    for piece in stretches(seen[:, 2] < 0):
        axes.plot(seen[piece, 0], seen[piece, 1], **looks[int(seen[piece.start, 2] < 0)])


def pale(colour: Any) -> np.ndarray:
    """A colour (3,) as it is shown where it is on the far side of a globe."""
    return 1 - 0.35 * (1 - np.array(to_rgb(colour)))
