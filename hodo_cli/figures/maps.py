"""Maps of sweeps."""

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch

from .. import HodoError
from ..results.dataset import Results
from .artists import COLUMN, GREY, HALO, PAGE, SEPARATRIX, VIRIDIS_END, legend, pair
from .geometry import separatrix_circles
from .sheet import Sheet, kind
from .swept import Swept, edges, hammer, hammer_curve, hammer_image

# Sweeps

GAP = "#E4E4E4"


@kind("map")
def sweep_map(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """A variable of sweeps over two axes, or over the directions of the start, a panel for each
    position asked for."""
    sweeps = [Swept.of(name, results.cases) for name in spec["cases"]]
    rows = [[(swept, at) for at in positions(swept, spec)] for swept in sweeps]
    flat = spec["x"] is None or spec["y"] is None
    cells = [cell for row in rows for cell in row]
    most = max(map(len, rows))
    columns = most if len(rows) > 1 and most > 1 else 2 if len(cells) == 4 else min(len(cells), 3)
    lines = -(-len(cells) // columns)
    width = COLUMN if columns == 1 else PAGE
    sheet.figure.set_size_inches(width, lines * width / columns * (0.6 if flat else 0.85) + 0.55)
    panels = sheet.figure.subplots(lines, columns, squeeze=False, sharex=not flat, sharey=not flat)
    values = [map_values(swept, spec, at) for swept, at in cells]
    every = np.concatenate([value.ravel() for value in values])
    scale = Normalize(*(spec["range"] or (np.nanmin(every), np.nanmax(every))))
    for spare in panels.ravel()[len(cells) :]:
        spare.remove()
    labels = [*spec["labels"], *[""] * len(cells)]
    for axes, (swept, at), value, label in zip(panels.ravel(), cells, values, labels, strict=False):
        title = label or ", ".join(swept.at(name, i) for name, i in at.items())
        (map_sphere if flat else map_image)(sheet, axes, swept, spec, value, scale, title)
        axes.set_title(title)
    hues = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 256)))
    bar = sheet.figure.colorbar(ScalarMappable(scale, hues), ax=sheet.figure.axes, location="bottom", fraction=0.04,
                                pad=0.02, shrink=0.7, aspect=45)  # fmt: skip
    bar.set_label(map_label(sweeps[0], spec["variable"]))
    if flat:
        gap = [Patch(fc=GAP, ec=GREY, lw=0.4, label="none")] if np.isnan(every).any() else []
        legend(sheet, [Line2D([], [], **SEPARATRIX, label="$D = 0$"), *gap], 2)


def positions(swept: Swept, spec: Mapping[str, Any]) -> list[dict[str, int]]:
    """The positions on the axis of panels, one panel each."""
    if spec["panels"] is None:
        return [{}]
    n = len(swept.axis(spec["panels"]))
    for i in spec["at"]:
        if i >= n:
            raise HodoError(
                f"axis {spec['panels']} of sweep {swept.case.name} has positions 0 to {n - 1}, not {i}"
            )
    return [{spec["panels"]: i} for i in spec["at"] or range(n)]


def map_values(swept: Swept, spec: Mapping[str, Any], at: Mapping[str, int]) -> np.ndarray:
    """What one panel shows: (x, y), or (directions,). Raises HodoError if there is nothing but
    gaps."""
    if spec["x"] is None or spec["y"] is None:
        keep = [swept.sphere()]
        if not keep[0]:
            raise HodoError(f"sweep {swept.case.name} has no sphere: name the axes x and y")
    else:
        keep = [swept.axis(spec[name]).name for name in ("x", "y")]
    values = swept.values(spec["variable"], keep, at)
    if not np.isfinite(values).any():
        raise HodoError(f"sweep {swept.case.name} has no value of {spec['variable']} to draw")
    return values


def map_image(
    sheet: Sheet,
    axes: Axes,
    swept: Swept,
    spec: Mapping[str, Any],
    values: np.ndarray,
    scale: Normalize,
    title: str,
) -> None:
    """An image over two axes; white where there is no value."""
    (x, even_x), (y, even_y) = swept.ticks(spec["x"]), swept.ticks(spec["y"])
    across, up = (each.ravel() for each in np.meshgrid(x, y, indexing="ij"))
    sheet.record(
        swept.case.name,
        title,
        **{spec["x"]: across, spec["y"]: up, spec["variable"]: values.ravel()},
    )
    hues = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 256)))
    axes.pcolormesh(
        edges(x, even_x), edges(y, even_y), values.T, norm=scale, cmap=hues, rasterized=True
    )
    if spec["level"] is not None and min(values.shape) > 1:
        axes.contour(x, y, values.T, [spec["level"]], colors="white", linewidths=0.9)
    axes.set(xscale="log" if even_x else "linear", yscale="log" if even_y else "linear")
    subplot = axes.get_subplotspec()
    if subplot is None or subplot.is_last_row():
        axes.set_xlabel(f"${swept.symbol(spec['x'])}$")
    if subplot is None or subplot.is_first_col():
        axes.set_ylabel(f"${swept.symbol(spec['y'])}$")


def map_sphere(
    sheet: Sheet,
    axes: Axes,
    swept: Swept,
    spec: Mapping[str, Any],
    values: np.ndarray,
    scale: Normalize,
    title: str,
) -> None:
    """An equal-area map of the directions of G at the start, with the separatrix; grey where there
    is no value."""
    name = swept.sphere()
    directions = swept.axis(name).directions(np.arange(len(swept.axis(name))))
    g = dict(zip(("G.x1/|G|", "G.x2/|G|", "G.x3/|G|"), directions.T, strict=True))
    sheet.record(swept.case.name, title, **g, **{spec["variable"]: values})
    hues = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, VIRIDIS_END, 256)))
    reach = (-math.sqrt(8), math.sqrt(8), -math.sqrt(2), math.sqrt(2))
    rim = Ellipse((0, 0), 2 * math.sqrt(8), 2 * math.sqrt(2), fc=GAP, ec=GREY, lw=0.6)
    axes.add_patch(rim)
    image = axes.imshow(hammer_image(directions, values, 360), origin="lower", extent=reach, norm=scale, cmap=hues,
                        interpolation="nearest", zorder=2)  # fmt: skip
    image.set_clip_path(rim)
    for circle in separatrix_circles(A) if (A := swept.body()) is not None else []:
        for piece in hammer_curve(circle):
            axes.plot(*piece.T, **SEPARATRIX, zorder=3)
    for i, direction in (
        (1, (1, 0, 0)),
        (2, (0, 1, 0)),
        (3, (0, 0, 1)),
        (2, (0, -1, 0)),
        (3, (0, 0, -1)),
    ):
        (point,) = hammer(np.array([direction], dtype=float))
        sign = "" if sum(direction) > 0 else "-"
        axes.plot(*point, "k.", ms=2.5, zorder=4)
        axes.annotate(f"${sign}x_{i}$", pair(point), (3, 3), textcoords="offset points", size=7, path_effects=HALO,
                      zorder=5)  # fmt: skip
    axes.set(xlim=(-2.9, 2.9), ylim=(-1.62, 1.62), aspect="equal")
    axes.set_axis_off()


def map_label(swept: Swept, variable: str) -> str:
    """What the colours of a map say."""
    name, _, part = variable.partition(".")
    said = str(swept.data[name].attrs.get("long_name", name))
    labels = str(swept.data[name].attrs.get("flag_meanings", "")).split()
    return (
        f"share of members: {said} is {part}"
        if part in labels
        else f"{said}: {part}"
        if part
        else said
    )
