"""Curves in space: hodographs and spheres."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from ..results.dataset import Cases, motions_of
from ..results.motion import Motion
from .artists import (
    COLUMN,
    GREY,
    HALO,
    PAGE,
    SEPARATRIX,
    START,
    arrow,
    axis_handles,
    axis_label,
    colour_handles,
    everywhere,
    heading,
    legend,
    line_width,
    mark_handles,
    mark_points,
    of_other_body,
    pair,
    palette,
    plane_curve,
    time_bar,
)
from .geometry import (
    View,
    beside,
    clearest,
    graticule,
    round_step,
    separatrix_circles,
    stretches,
    windings,
)
from .sheet import Sheet


def hodograph(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> None:
    """The curve of G in body axes; beside it, if wanted, its neighbourhood of the origin and its
    projections."""
    motions, view = motions_of(cases, spec["cases"], spec["labels"]), View.toward(spec["view"])
    planes, zoom = spec["projections"], spec["zoom"]
    for motion in motions:
        G1, G2, G3 = motion.G.T
        sheet.record(
            "hodograph", motion.label, {"time": motion.time, "G.x1": G1, "G.x2": G2, "G.x3": G3}
        )
    up, down = (
        np.max([(sign * motion.G).max(axis=0) for motion in motions], axis=0) for sign in (1, -1)
    )
    size = float(np.maximum(up, down).max()) or 1.0
    reach = np.stack([np.maximum(1.15 * up, 0.45 * size), np.maximum(1.05 * down, 0.12 * size)])
    seen = np.concatenate([view(motion.G)[:, :2] for motion in motions])
    reach[0] = clear_lengths(view, reach[0], seen, float(np.ptp(seen, axis=0).max()))
    frame = extent(np.concatenate([seen, *(view(arms)[:, :2] for arms in tips(reach))]))
    main, *others = hodograph_panels(sheet, frame, 1 + (zoom is not None) + len(planes))
    space(main, motions, spec, view, reach, frame)
    if zoom is not None:
        window = np.array([[-1.25, 1.25], [-1.25, 1.25]]) * zoom
        near = np.full((2, 3), zoom)
        near[0] = clear_lengths(view, near[0], seen, 2.5 * zoom)
        space(others[0], motions, spec, view, near, window, cut=True)
        others[0].set(title=f"enlarged, to $|G_i| = {zoom:g}$")
    for axes, plane in zip(others[zoom is not None :], planes, strict=True):
        projection(axes, motions, spec, plane)
    handles = colour_handles(motions, spec["colour"], spec["styles"])
    handles += mark_handles(motions, spec["time"], wide=bool(others))
    if spec["colour"] == "time":
        time_bar(sheet, [main, *others], motions[0], spec)
    # Three entries fit into the width of a column, and five into that of a page.
    legend(sheet, handles, 5 if others or len(handles) <= 3 else 2)


STRETCHES = np.linspace(1, 1.25, 6)
"""By how much an arm of the body axes may be longer, so that its name is on no curve; more would
leave an enlarged panel."""


def clear_lengths(view: View, lengths: np.ndarray, seen: np.ndarray, width: float) -> np.ndarray:
    """Lengths (3,) of the positive body axes, each a little longer if its name would be on the
    curves in view (n, 2), in a panel of some width.
    """
    # A name stands a thirtieth of a panel beyond its arm, and is half as large.
    beyond, room = 0.03 * width, 0.025 * width
    cleared = []
    for along, length in zip(view(np.eye(3))[:, :2], lengths, strict=True):
        # An axis that points at the reader has no direction on the page.
        outward = along / max(float(np.hypot(*along)), math.ulp(0))
        ends = STRETCHES[:, None] * length * along + beyond * outward
        cleared.append(length * STRETCHES[clearest(seen, ends, room)])
    return np.array(cleared)


def tips(reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ends (3, 3) of the positive and the negative body axes, of lengths (2, 3)."""
    return np.diag(reach[0]), -np.diag(reach[1])


def extent(seen: np.ndarray) -> np.ndarray:
    """((left, right), (bottom, top)) of points (n, 2) in view, with a margin."""
    lo, hi = seen.min(axis=0), seen.max(axis=0)
    margin = 0.05 * (hi - lo).max()
    return np.stack([lo - margin, hi + margin], axis=-1)


def hodograph_panels(sheet: Sheet, frame: np.ndarray, n: int) -> list[Axes]:
    """n panels, the first shaped as the frame."""
    shape = float(np.clip(np.ptp(frame[0]) / np.ptp(frame[1]), 0.5, 2))
    if n == 1:
        sheet.figure.set_size_inches(COLUMN, COLUMN / max(shape, 0.8) + 0.5)
        return [sheet.figure.subplots()]
    if n == 2:
        height = min(PAGE / (shape + 1), 3.3)
        sheet.figure.set_size_inches(PAGE, height + 0.45)
        return list(sheet.figure.subplots(1, 2, width_ratios=[shape, 1]))
    sheet.figure.set_size_inches(PAGE, 0.95 * PAGE)
    panels = sheet.figure.subplots(2, (n + 1) // 2).ravel()
    for spare in panels[n:]:
        spare.remove()
    return list(panels[:n])


def space(
    axes: Axes,
    motions: Sequence[Motion],
    spec: Mapping[str, Any],
    view: View,
    reach: np.ndarray,
    frame: np.ndarray,
    cut: bool = False,
) -> None:
    """Hodographs in a view, with body axes of lengths `reach` (2, 3), within a frame (2, 2) of the
    page."""
    body_axes(axes, view, reach)
    near = float(np.ptp(frame)) / 2
    # The longest curve first, so that it does not bury the short ones.
    for place, motion in sorted(enumerate(motions), key=lambda item: -windings(item[1].G)):
        colours, code = palette(motion, spec["colour"], place, spec["styles"])
        seen = view(motion.G)
        space_curve(axes, seen, colours, code, line_width(motion), near)
        mark_points(
            axes,
            seen[[0, -1], :2],
            view(motion.at_crossings(motion.G))[:, :2],
            lambda points: within(points, frame),
        )
        if not cut:
            heading(axes, seen[:, :2], colours[code[0]], 0.12 * near)
    axes.set(xlim=frame[0], ylim=frame[1], aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set(visible=cut, color="#BBBBBB")


def within(points: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Which points (n, 2) lie in a frame (2, 2)."""
    return np.asarray(((points >= frame[:, 0]) & (points <= frame[:, 1])).all(axis=-1))


def space_curve(
    axes: Axes, seen: np.ndarray, colours: np.ndarray, code: np.ndarray, width: float, near: float
) -> None:
    """A curve in view (n, 3), in colours[code]; what is farther from the reader is paler, and
    behind."""
    # Thirteen layers: enough to show depth, and few enough pieces of line.
    layer = np.clip((seen[:, 2] / near * 6).round(), -6, 6).astype(int)
    pieces = [
        piece
        for piece in stretches(code, layer)
        # What is far outside an enlarged panel would only make the file larger.
        if np.abs(seen[piece, :2]).min(axis=0).max() < 3 * near
    ]
    pieces.sort(key=lambda piece: int(layer[piece.start]))
    pale = [0.5 * (6 - layer[piece.start]) / 12 for piece in pieces]
    shades = [
        colours[code[piece.start]] * (1 - white) + white
        for piece, white in zip(pieces, pale, strict=True)
    ]
    lines = LineCollection(
        [seen[piece, :2] for piece in pieces], colors=shades, linewidths=width, capstyle="round"
    )
    axes.add_collection(lines, autolim=False)


def body_axes(axes: Axes, view: View, reach: np.ndarray) -> None:
    """The axes of G1, G2, G3 through the origin, of lengths `reach` (2, 3), named, with round
    values marked."""
    # Some are longer only for their names.
    step = round_step(float(reach.max()) / STRETCHES[-1])
    for i, (tip, tail) in enumerate(zip(*(view(arms)[:, :2] for arms in tips(reach)), strict=True)):
        arm(axes, tail, tip, f"G_{i + 1}")
        counts = np.arange(-int(reach[1, i] / step), int(0.87 * reach[0, i] / step) + 1)
        at = view(counts[counts != 0, None] * step * np.eye(3)[i])
        axes.plot(at[:, 0], at[:, 1], ls="", marker=".", ms=2, color=GREY, zorder=1)
        if counts[-1] > 0:
            # The upright axis has its value to the right, the others below.
            axes.annotate(
                f"{counts[-1] * step:.10g}",
                pair(at[-1]),
                (4, 0) if i == 2 else (1, -6),
                size=6,
                color=GREY,
                textcoords="offset points",
                va="center",
                zorder=5,
                path_effects=HALO,
            )


def arm(axes: Axes, tail: np.ndarray, tip: np.ndarray, name: str, zorder: float = 1) -> None:
    """An arrow along a body axis from tail to tip (2,), with its name."""
    arrow(axes, tail, tip, GREY, zorder)
    beyond = 6 * tip / max(float(np.hypot(*tip)), math.ulp(0))
    axes.annotate(
        f"${name}$",
        pair(tip),
        pair(beyond),
        textcoords="offset points",
        ha="center",
        va="center",
        zorder=7,
        path_effects=HALO,
    )


def projection(axes: Axes, motions: Sequence[Motion], spec: Mapping[str, Any], plane: str) -> None:
    """The hodographs projected onto the plane of two body axes."""
    i, j = int(plane[1]) - 1, int(plane[3]) - 1
    for place, motion in enumerate(motions):
        points = motion.G[:, [i, j]]
        shades = palette(motion, spec["colour"], place, spec["styles"])
        plane_curve(axes, points, *shades, 0.8 * line_width(motion))
        mark_points(axes, points[[0, -1]], motion.at_crossings(points), everywhere)
    axes.autoscale_view()
    axes.set(
        xlabel=axis_label(f"G.x{i + 1}", motions[0]),
        ylabel=axis_label(f"G.x{j + 1}", motions[0]),
        aspect="equal",
    )


def common_circles(motions: Sequence[Motion]) -> list[np.ndarray]:
    """The circles of the separatrix on the unit sphere, where all motions are of one body."""
    return [] if of_other_body(motions) else separatrix_circles(motions[0].inertia)


def sphere(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> None:
    """The curves of G/|G| on the unit sphere, with the two separatrix circles."""
    motions, view = motions_of(cases, spec["cases"], spec["labels"]), View.toward(spec["view"])
    sheet.figure.set_size_inches(COLUMN, 1.08 * COLUMN)
    axes = sheet.figure.subplots()
    axes.add_patch(Circle((0, 0), 1, fc="#F8F8F8", ec=GREY, lw=0.6, zorder=1.1))
    for line in graticule():
        on_sphere(axes, view(line), color="#C8C8C8", lw=0.35)
    directions = [unit_vectors(motion) for motion in motions]
    seen = np.concatenate([view(direction)[:, :2] for direction in directions])
    lengths = clear_lengths(view, np.full(3, 1.2), seen[np.isfinite(seen).all(axis=-1)], 2.2)
    for i, (tip, foot) in enumerate(zip(view(np.diag(lengths)), view(np.eye(3)), strict=True)):
        arm(axes, foot[:2], tip[:2], f"x_{i + 1}", zorder=5 if foot[2] > 0 else 1)
    for place, (motion, direction) in enumerate(zip(motions, directions, strict=True)):
        g1, g2, g3 = direction.T
        sheet.record(
            "sphere",
            motion.label,
            {"time": motion.time, "G.x1/|G|": g1, "G.x2/|G|": g2, "G.x3/|G|": g3},
        )
        seen = view(direction)
        colours, code = palette(motion, spec["colour"], place, spec["styles"])
        for piece in stretches(code):
            on_sphere(axes, seen[piece], color=colours[code[piece.start]], lw=1.1)
        heading(axes, seen[:, :2], colours[code[0]], 0.15)
        axes.plot(*seen[0, :2], **START, alpha=1 if seen[0, 2] > 0 else 0.4, zorder=6)
    # Over the curves, which run close beside it.
    circles = [view(circle) for circle in common_circles(motions)]
    for circle in circles:
        on_sphere(axes, circle, **SEPARATRIX)
    places = beside([view(direction) for direction in directions], circles)
    for motion, free in zip(motions, places, strict=True):
        axes.text(*pair(free), motion.label, ha="center", va="center", zorder=8, path_effects=HALO)
    axes.set(xlim=(-1.24, 1.24), ylim=(-1.12, 1.28), aspect="equal")
    axes.set_axis_off()
    handles = axis_handles(motions) if spec["colour"] == "axis" else []
    handles += [
        Line2D([], [], **SEPARATRIX, label="separatrix, $D = 0$"),
        Line2D([], [], **START, label="start"),
    ]
    if spec["colour"] == "time":
        time_bar(sheet, [axes], motions[0], spec)
    legend(sheet, handles, 2)


def unit_vectors(motion: Motion) -> np.ndarray:
    """G/|G| (n, 3), nan where the body is at rest."""
    size = motion["G"][:, None]
    return np.asarray(motion.G / np.where(size > 0, size, np.nan))


def on_sphere(axes: Axes, seen: np.ndarray, **style: Any) -> None:
    """A curve in view (n, 3) on the sphere, faint on the far side."""
    for piece in stretches(seen[:, 2] >= 0):
        front = seen[piece.start, 2] >= 0
        axes.plot(
            seen[piece, 0],
            seen[piece, 1],
            **style,
            alpha=1 if front else 0.35,
            zorder=3 if front else 2,
        )
