"""Figures of sweeps: one variable over one axis, over two, or over the directions of a sphere."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import chain, repeat
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, ListedColormap, Normalize, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from ... import HodoError
from ...cases.figure_block import AXIS_KEYS, averaged
from ...cases.sweep_block import AXIS_LABELS
from ...models.rigid_body import LABELS, inertia_order, separatrix_circles, separatrix_terms
from ...models.terms.body import BodyUnderTorques
from ...models.theory.dissipation import turning_momenta
from ...results.dataset import Cases
from ...results.motion import OF_ATTITUDE
from ...sweeps.view import SweepView
from ..artists import (
    AXIS_COLOUR,
    BLACK,
    GREY,
    PURPLE,
    RED,
    SEPARATRIX,
    colour_bar,
    hues,
    styles,
)
from ..sheet import COLUMN, PAGE, Look, Sheet, View
from ..symbols import (
    axis_columns,
    axis_name,
    axis_words,
    meaning_in_tex,
    position,
    symbol,
    value_unit,
)
from ..words import HALO, with_minus

NO_VALUE_COLOUR = "#E4E4E4"
"""The colour of members without a value: a grey that the colour map does not contain."""

LEVEL: Look = {
    "color": "white",
    "lw": 0.9,
    "path_effects": [withStroke(linewidth=2, foreground=BLACK)],
}
"""A contour, seen on every colour, and on a white page."""

THEORY: Look = {"color": RED, "lw": 1.4, "ls": (0, (3.4, 1.4))}
"""A curve of theory over a map."""

PLACES_OF_THEORY = 33
"""Places along an axis at which theory is asked for: its curves are smooth."""

ARROWS = {
    (False, False): "neither",
    (True, False): "min",
    (False, True): "max",
    (True, True): "both",
}
"""Which ends of a colour scale have an arrow, by whether values lie below and above it."""

GRID = 360
"""Cells around the sphere: a degree each, some two pixels of a panel in print."""


def sweep_map(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> None:
    """A variable of sweeps over two axes, or over the directions of the start, a panel for each
    position asked for."""
    of_sphere, name = spec["x"] is None, spec["variable"]
    across = () if of_sphere else (spec["x"], spec["y"])
    sweeps = sweeps_of(cases, spec, *across)
    rows = [positions(swept, spec["panels"], spec["at"]) for swept in sweeps]
    cells = [(swept, at) for swept, row in zip(sweeps, rows, strict=True) for at in row]
    show_degrees(sheet, sweeps, spec)
    values = [  # (x, y), or (directions,)
        shown_values(sheet, swept, name, across or [swept.sphere], at) for swept, at in cells
    ]
    # One scale for all panels, or equal colours would mean different values.
    all_values = np.concatenate([value.ravel() for value in values])
    check_any(bool(np.isfinite(all_values).any()), sweeps, name)
    all_values = without_rounding(all_values)
    labelled, meaning = meanings(sweeps[0], name), map_label(sweeps, spec, sheet.units)
    scale, colours = colour_scale_of(spec, all_values, labelled)
    # Rasterized: a million cells as vectors make a file that no reader opens.
    look: Look = {"norm": scale, "cmap": colours, "rasterized": True}
    panels = map_panels(sheet, [len(row) for row in rows], of_sphere)
    draw_panel = map_sphere if of_sphere else map_image
    # Panels behind those that `labels` names are named by their positions.
    labels = chain(spec["labels"], repeat(""))
    for axes, (swept, indices), value, label in zip(panels, cells, values, labels, strict=False):
        shown_name, plain_name = names_of(swept, indices, label, len(sweeps))
        axes.set_title(shown_name)
        places = draw_panel(sheet, axes, swept, spec, value, look)
        sheet.record(plain_name, {**places, name: value.ravel()})
    label_outer(panels)
    if np.isnan(all_values).any():
        sheet.legend.append(Patch(fc=NO_VALUE_COLOUR, ec=GREY, lw=0.4, label=absence(name)))
    words = words_of_values(meaning, labelled, all_values)
    sheet.legend += [Patch(fc=colours(scale(value)), label=word) for value, word in words.items()]
    if not words:
        below, above = np.nanmin(all_values) < scale.vmin, np.nanmax(all_values) > scale.vmax
        ends = ARROWS[bool(below), bool(above)]
        bar = colour_bar(sheet, ScalarMappable(scale, colours), panels, meaning, ends)
        if colours.N <= MAX_COUNTS + 1:
            edges_and_middles = np.linspace(*bar.mappable.get_clim(), 2 * colours.N + 1)
            bar.set_ticks(edges_and_middles[1::2].tolist())


def check_any(is_any: bool, sweeps: Sequence[SweepView], variable: str) -> None:
    """Raise HodoError unless there is any value of a variable of sweeps to draw."""
    if not is_any:
        names = " and ".join(swept.name for swept in sweeps)
        raise HodoError(f"sweep {names} has no value of {variable} to draw")


EQUAL_WITHIN = 1e-12
"""The part of their size by which values differ at most that are equal but for their rounding."""


def without_rounding(values: np.ndarray) -> np.ndarray:
    """Values (n,) as they are; those that are all equal but for their rounding as one number, since
    a scale of their differences would show a pattern of no meaning."""
    size = float(np.nanmax(np.abs(values)))
    if np.nanmax(values) - np.nanmin(values) > EQUAL_WITHIN * size:
        return values
    return np.where(np.isnan(values), values, float(f"{np.nanmean(values):.12g}"))


def show_degrees(sheet: Sheet, sweeps: Sequence[SweepView], spec: Mapping[str, Any]) -> None:
    """Let a sheet have the variable of its figure in degrees, if that is an angle and one along an
    axis was given so."""
    units, name = sheet.units, spec["variable"]
    along = [spec.get(key) for key in AXIS_KEYS]
    degrees = any(swept.unit(axis) == "deg" for swept in sweeps for axis in along if axis)
    if degrees and units(name) == "rad":
        sheet.units = lambda column: "deg" if column == name else units(column)


def shown_values(
    sheet: Sheet, swept: SweepView, variable: str, keep: Sequence[str], indices: Mapping[str, int]
) -> np.ndarray:
    """The values of a variable over the axes to `keep`, in the units of the sheet."""
    values = swept.values(variable, keep, indices)
    return np.degrees(values) if sheet.units(variable) == "deg" else values


def sweeps_of(cases: Cases, spec: Mapping[str, Any], *across: str) -> list[SweepView]:
    """The sweeps of a figure, in order along the axes that are drawn or listed.

    Raises HodoError if such an axis has values of several units, or one out of order twice.
    """
    # Positions and labels count along an axis as it is stored; an axis that has grown by single
    # values is out of order.
    listed = () if spec["at"] or spec["labels"] else (spec.get("panels"), spec.get("by"))
    ordered = [*across, *filter(None, listed)]
    sweeps = [SweepView.of(name, cases[name]).sorted_along(*ordered) for name in spec["cases"]]
    for axis in across:
        units = {swept.unit(axis): f"{swept.unit(axis)!r} in {swept.name}" for swept in sweeps}
        if len(units) > 1:
            raise HodoError(
                f"axis {axis} is in {' and '.join(units.values())}: one scale has one unit"
            )
    return sweeps


MAX_COUNTS = 8
"""The largest difference of counts that have a colour each: of more, colours are too alike."""


def colour_scale_of(
    spec: Mapping[str, Any], values: np.ndarray, labelled: Mapping[int, str]
) -> tuple[Normalize, Colormap]:
    """The scale and the colours of a map: for an enclosed axis, or the share of one, the colours
    that axes have in every figure."""
    known = values[~np.isnan(values)]
    low, high = float(known.min()), float(known.max())
    name, _, part = spec["variable"].rpartition(".")
    if name in ("share", *AXIS_LABELS) and (np.isin(known, (0, 1)).all() or low == high):
        low, high = 0.0, 1.0  # where all say yes it has another colour than where all say no
    if labelled:
        labels = range(int(low), int(high) + 1)
        colours = ListedColormap([AXIS_COLOUR.get(label, PURPLE) for label in labels])
        return Normalize(low - 0.5, high + 0.5), colours
    if spec["range"] is None and high - low <= MAX_COUNTS and (known % 1 == 0).all():
        # The colours of a continuous scale would show counts that no member has.
        return Normalize(low - 0.5, high + 0.5), hues().resampled(int(high - low) + 1)
    if spec["range"] is None and low == high:
        return Normalize(low - 0.1 * abs(low), low + 0.1 * abs(low)), hues().resampled(1)
    scale = Normalize(*(spec["range"] or (low, high)))
    if part not in LABELS.values():
        return scale, hues()
    full = AXIS_COLOUR[int(part[1])]
    pale = 0.12 * np.array(to_rgb(full)) + 0.88
    return scale, LinearSegmentedColormap.from_list(part, [tuple(pale), full])


def words_of_values(
    meaning: str, labelled: Mapping[int, str], values: np.ndarray
) -> dict[float, str]:
    """The words for the values of a map where they are few: labels, or yes and no. A scale would
    show colours that no member has."""
    if labelled:
        words = {value: word for value, word in labelled.items() if value in values}
        return {value: f"{meaning}: {axis_words(word)}" for value, word in words.items()}
    yes_or_no = np.isin(values, (0, 1)) | np.isnan(values)
    if meaning.startswith(SHARE_WORDS) and yes_or_no.all():
        return {1: meaning.removeprefix(SHARE_WORDS), 0: "otherwise"}
    return {}


def map_panels(sheet: Sheet, rows: Sequence[int], of_sphere: bool) -> list[Axes]:
    """Panels for sweeps with so many positions each: a row a sweep, or up to three in a row."""
    n, longest = sum(rows), max(rows)
    # A row for each of several sweeps; else three panels fill the width of a page.
    columns = longest if len(rows) > 1 and longest > 1 else min(n, 3)
    if len(rows) == 1 and n == 4:
        columns = 2  # two by two, rather than three and one
    columns = sheet.columns(PAGE, columns)
    lines = math.ceil(n / columns)
    width = COLUMN if columns == 1 else PAGE
    height = lines * width / columns * (0.6 if of_sphere else 0.85) + 0.55
    look = {"projection": "hammer"} if of_sphere else {}
    shared = not of_sphere
    return sheet.panels(width, height, n, columns, sharex=shared, sharey=shared, subplot_kw=look)


def label_outer(panels: Sequence[Axes]) -> None:
    """Leave labels to the first panels of rows, and to those with no panel below."""
    columns = panels[0].get_gridspec().ncols  # type: ignore[union-attr]
    for i, axes in enumerate(panels):
        if i % columns:
            axes.set_ylabel("")
        if i + columns < len(panels):
            axes.set_xlabel("")


def positions(swept: SweepView, axis: str | None, at: Sequence[int]) -> list[dict[str, int]]:
    """The positions on an axis that are drawn, a panel or a curve each; all without any in `at`."""
    return [{}] if axis is None else [{axis: i} for i in at or range(swept.axes[axis])]


def map_image(
    sheet: Sheet, axes: Axes, swept: SweepView, spec: Mapping[str, Any], values: np.ndarray,
    look: Look,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Draw an image over two axes, grey where there is no value; returns the places (n,) of its
    values by the names of the axes."""
    (x, even_x), (y, even_y) = swept.ticks(spec["x"]), swept.ticks(spec["y"])
    # Edges half way between uneven values may be below zero, where a logarithmic axis has no place.
    log = spec["style"].get("log", ())
    even_x = even_x or ("x" in log and x.min() > 0)
    even_y = even_y or ("y" in log and y.min() > 0)
    image = axes.pcolormesh(edges(x, even_x), edges(y, even_y), values.T, **look)
    # Not the background: beside a larger panel, it shows beyond the axes of a sweep too.
    image.set_cmap(image.get_cmap().with_extremes(bad=NO_VALUE_COLOUR))
    if spec["theory"] is not None:
        (i, j), ratio = balance(swept, spec["x"], spec["y"])
        words = "fluid and damping balance", "no line where fluid and damping do not balance"
        sheet.legend.append(contour(axes, x[i], y[j], ratio, 1.0, THEORY, words))
    if spec["level"] is not None and min(values.shape) > 1:
        unit = value_unit(swept, spec["variable"].partition(".")[0], sheet.units)
        level = f"{with_minus(format(spec['level'], 'g'))} {unit}".rstrip()
        words = level, f"no line where {level} is not reached"
        sheet.legend.append(contour(axes, x, y, values, spec["level"], LEVEL, words))
    axes.set(
        xscale="log" if even_x else "linear",
        yscale="log" if even_y else "linear",
        xlabel=axis_name(swept, spec["x"]),
        ylabel=axis_name(swept, spec["y"]),
    )
    across = {key: np.repeat(of, len(y)) for key, of in axis_columns(swept, spec["x"]).items()}
    return across | {key: np.tile(of, len(x)) for key, of in axis_columns(swept, spec["y"]).items()}


def contour(
    axes: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, level: float, look: Look,
    words: tuple[str, str],
) -> Line2D:  # fmt: skip
    """Draw the contour of values (n, m) at a level; returns its entry of the legend, the second of
    the words without a line where no value is on its other side."""
    # Of no value at all these are nan, without numpy's warning.
    if not np.fmin.reduce(values, axis=None) <= level < np.fmax.reduce(values, axis=None):
        return Line2D([], [], ls="", label=words[1])
    axes.contour(x, y, values.T, [level], colors=look["color"]).set(
        linewidth=look["lw"],
        linestyle=[look.get("ls", "-")],
        path_effects=look.get("path_effects"),
    )
    return Line2D([], [], **look, label=words[0])


def edges(values: np.ndarray, ratios: bool) -> np.ndarray:
    """The edges (n + 1,) of cells about values (n,), half way between them, in even ratios or
    not."""
    x = np.log(values) if ratios else values
    if len(x) == 1:
        # By a part of a value, which the numbers along the axis then show.
        half = 0.5 if ratios else 0.1 * abs(x[0]) or 0.5
        x = np.array([x[0] - half, x[0] + half])
    else:
        # The outer edges mirror the inner ones, so that the first and last cell are as wide as
        # their neighbours.
        middle = (x[1:] + x[:-1]) / 2
        x = np.concatenate([[2 * x[0] - middle[0]], middle, [2 * x[-1] - middle[-1]]])
    return np.asarray(np.exp(x) if ratios else x)


def balance(swept: SweepView, x: str, y: str) -> tuple[list[np.ndarray], np.ndarray]:
    """Places along two axes of a sweep, a few of many, and there |G| at the start over that at
    which the sense of crossings turns on the mean; not a number where it does not.

    Raises HodoError for a sweep whose torques no theorem takes.
    """
    places = [
        np.unique(np.linspace(0, swept.axes[name] - 1, PLACES_OF_THEORY).astype(int))
        for name in (x, y)
    ]
    ratios = np.empty((len(places[0]), len(places[1])))
    for row, i in enumerate(places[0]):
        for column, j in enumerate(places[1]):
            case = swept.at({x: int(i), y: int(j)})
            body, time = case.system, case.time
            if (
                not isinstance(body, BodyUnderTorques)
                or len(terms := body.dissipations(time.start, time.end)) != 1
            ):
                raise HodoError(f"no theorem predicts the sense of crossings of sweep {swept.name}")
            momentum = np.linalg.norm(body.momentum(np.array(body.start[:3])))
            ratios[row, column] = momentum / turning_momenta(*terms).mean
    return places, ratios


def map_sphere(
    sheet: Sheet, axes: Axes, swept: SweepView, spec: Mapping[str, Any], values: np.ndarray,
    look: Look,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Draw an equal-area map of the directions of G at the start, with the separatrix, grey where
    there is no value; returns the directions' components (n,) by their names.

    x1 is in the middle, x2 to the right of it, x3 on top.
    """
    directions = swept.directions()
    axes.set_facecolor(NO_VALUE_COLOUR)
    axes.grid(False)
    # At the top of its room: the layout would take room above the map for its title's, and the
    # title would be cut off when the map grows.
    axes.set(xticks=[], yticks=[], anchor="N")
    axes.spines["geo"].set(color=GREY, lw=0.6)
    A = swept.body()
    axes.pcolormesh(*sphere_cells(directions, values, A), **look)
    circles = [] if A is None else separatrix_circles(A)
    for circle in circles:
        axes.plot(*unbroken(circle), **SEPARATRIX, zorder=3, path_effects=HALO)
    globe(sheet, axes, directions, values, circles, look)
    name_axes(axes)
    sheet.legend += [Line2D([], [], **SEPARATRIX, label="separatrix, $D = 0$")] if circles else []
    return dict(zip(("G.x1/|G|", "G.x2/|G|", "G.x3/|G|"), directions.T, strict=True))


def name_axes(axes: Axes) -> None:
    """Mark and name the directions of the axes of the body on a map of the sphere; -x1 is on both
    of its edges."""
    for i, sign in ((1, 1), (2, 1), (3, 1), (2, -1), (3, -1)):
        direction = sign * np.eye(3)[i - 1]
        axes.plot(*angles(direction), "k.", ms=2.5, zorder=4, clip_on=False)
        axes.annotate(
            f"${'-' if sign < 0 else ''}x_{i}$",
            np.array(angles(direction)).tolist(),
            # Above the upper pole is the title.
            (3, -9 if direction[2] > 0 else 3),
            textcoords="offset points",
            size="small",
            path_effects=HALO,
            zorder=5,
        )


def angles(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Longitude from x1 and latitude above the x1 x2 plane (n,) of unit vectors (n, 3), radians."""
    x, y, z = directions.T
    # Rounding may put a unit vector a little beyond the pole.
    return np.arctan2(y, x), np.arcsin(np.clip(z, -1, 1))


def globe(
    sheet: Sheet, axes: Axes, directions: np.ndarray, values: np.ndarray,
    circles: Sequence[np.ndarray], look: Look,
) -> None:  # fmt: skip
    """Add the sphere of a map to the scenes of the sheet, a dot for each direction, so that its
    page can turn it."""
    scene = sheet.scene(axes, View((0, 0)), (), globe=True)
    texts = [f"{value:.6g}" if math.isfinite(value) else "none" for value in values]
    shades = look["cmap"].with_extremes(bad=NO_VALUE_COLOUR)(
        look["norm"](np.ma.masked_invalid(values))
    )
    # As large as their distance allows, so that neighbours do not hide each other.
    size = min(3.0, 80 / math.sqrt(len(values)))
    dots: Look = {"ls": "", "marker": "o", "ms": size, "mec": GREY, "mew": 0.1 * size}
    scene.add(directions, shades[:, :3], np.arange(len(values)), texts, **dots)
    for circle in circles:
        scene.add(circle, **SEPARATRIX)
    for i, direction in enumerate(np.eye(3), 1):
        scene.add(np.stack([direction, 1.15 * direction]), texts=["", f"$x_{i}$"], color=GREY)


def sphere_cells(
    directions: np.ndarray, values: np.ndarray, A: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges of longitude and latitude, and in each cell the value of the nearest direction of
    `directions` (n, 3), on its own side of the separatrix of a body with moments A (3,)."""
    # Late, because it loads half of SciPy, which no other figure needs.
    from scipy.spatial import cKDTree

    longitude = np.linspace(-np.pi, np.pi, GRID + 1)
    latitude = np.linspace(-np.pi / 2, np.pi / 2, GRID // 2 + 1)
    middle = [(edge[1:] + edge[:-1]) / 2 for edge in (longitude, latitude)]
    along, up = np.meshgrid(*middle)
    cells = np.stack([np.cos(up) * np.cos(along), np.cos(up) * np.sin(along), np.sin(up)], axis=-1)
    shown = np.empty(along.shape)
    sides, cell_sides = (within_separatrix(points, A) for points in (directions, cells))
    for side in np.unique(cell_sides):
        starts = sides == side if (sides == side).any() else np.full(len(directions), True)
        # By distance in space, which no pole or date line disturbs.
        nearest = cKDTree(directions[starts]).query(cells[cell_sides == side])[1]
        shown[cell_sides == side] = values[starts][nearest]
    return longitude, latitude, shown


def within_separatrix(directions: np.ndarray, A: np.ndarray | None) -> np.ndarray:
    """Whether D > 0 for directions (..., 3) of G of a body with moments A (3,); False without a
    body."""
    if A is None:
        return np.zeros(directions.shape[:-1], dtype=bool)
    omega = np.moveaxis(directions / A, -1, 0)
    outer, inner = separatrix_terms(A, omega, inertia_order(A))
    return np.asarray(outer > inner)


def unbroken(curve: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Longitude and latitude of a curve of directions (n, 3), with a gap where it leaves the map on
    one side and comes back on the other."""
    longitude, latitude = angles(curve)
    jumps = np.flatnonzero(np.abs(np.diff(longitude)) > np.pi) + 1
    return np.insert(longitude, jumps, np.nan), np.insert(latitude, jumps, np.nan)


def sweep_curve(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> None:
    """A variable of sweeps over one axis: a curve a sweep, or a curve an entry of another axis."""
    sweeps = sweeps_of(cases, spec, spec["x"])
    curves = [
        (swept, indices) for swept in sweeps for indices in positions(swept, spec["by"], spec["at"])
    ]
    (axes,) = sheet.panels(COLUMN, 0.85 * COLUMN)
    show_degrees(sheet, sweeps, spec)
    known: list[float] = []
    # Each curve that lacks values has a row of crosses.
    rows, spacing = 0, min(ROW_OF_CROSSES, ROWS_OF_CROSSES / len(curves))
    # Curves behind those that `labels` names are named by what they are.
    labels = chain(spec["labels"], repeat(""))
    for (swept, indices), label, look in zip(curves, labels, styles(len(curves)), strict=False):
        shown_name, plain_name = names_of(swept, indices, label, len(sweeps))
        columns = curve_columns(sheet, swept, spec, indices)
        sheet.record(plain_name, columns)
        (x, _), values = swept.ticks(spec["x"]), columns[spec["variable"]]
        errors = columns.get(ERROR_COLUMNS.get(spec["variable"], ""))
        draw_curve(axes, x, values, errors, {**look, "label": shown_name})
        is_known = np.isfinite(values)
        known += values[is_known].tolist()
        if not is_known.all():
            # Many stand side by side, and not on one another.
            size = float(np.clip(CROSSES_ACROSS / len(x), 1, 4))
            cross_out(axes, x[~is_known], 0.02 + spacing * rows, look["color"], size)
            rows += 1
    check_any(bool(known), sweeps, spec["variable"])
    if all(value.is_integer() for value in known):
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    if spec["level"] is not None:
        axes.axhline(spec["level"], **SEPARATRIX)
    ticks = [swept.ticks(spec["x"]) for swept in sweeps]
    axes.set(
        xscale="log" if all(even for _, even in ticks) else "linear",
        xlabel=axis_name(sweeps[0], spec["x"]),
        ylabel=map_label(sweeps, spec, sheet.units),
    )
    low, high = axes.dataLim.intervaly
    if 0 < high - low <= EQUAL_WITHIN * max(-low, high):
        # Else the scale would be that of their rounding, or of an error as small.
        axes.set_ylim(low - 0.1 * abs(low), high + 0.1 * abs(high))
    # A margin is a part of what values take, and rows are parts of the panel.
    below = 0.05 + spacing * (rows - 1)
    axes.margins(x=0.02, y=below / (1 - 2 * below) if rows else 0.05)
    if rows:
        crosses: Look = {"ls": "", "marker": "x", "ms": 4, "color": GREY}
        sheet.legend.append(Line2D([], [], **crosses, label=absence(spec["variable"])))


ERROR_COLUMNS = {"crossing_time": "crossing_error"}
"""The variables of members that are stored with their errors."""

FEW_VALUES = 12
"""Values along a curve, below which its marks are drawn larger, and the line between them fine."""

CROSSES_ACROSS, ROW_OF_CROSSES, ROWS_OF_CROSSES = 130, 0.035, 0.25
"""The points across a narrow panel that crosses may take together, and the parts of its height that
a row of them has, and all rows at most."""


def absence(variable: str) -> str:
    """The words for a member without a value."""
    return "no crossing" if variable.startswith("crossing") else "no value"


def curve_columns(
    sheet: Sheet, swept: SweepView, spec: Mapping[str, Any], indices: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """What a curve shows, as columns (n,) of a table: the values along its axis, those of the
    variable and their stored errors, and in each row the numbers that tell it from other curves."""
    values = shown_values(sheet, swept, spec["variable"], [spec["x"]], indices)
    columns = {**axis_columns(swept, spec["x"]), spec["variable"]: values}
    error = ERROR_COLUMNS.get(spec["variable"], "")
    if error in swept.data:
        columns[error] = swept.values(error, [spec["x"]], indices)
    for axis, i in indices.items():
        for key, along in axis_columns(swept, axis).items():
            columns[key] = np.full(len(values), along[i])
    return columns


def draw_curve(
    axes: Axes, x: np.ndarray, values: np.ndarray, errors: np.ndarray | None, look: Look
) -> None:
    """A curve through values (n,) at x (n,), with bars of their errors if there are any."""
    # A line between few values would pass for a result.
    width = {"lw": 0.4, "ms": 5} if len(x) < FEW_VALUES else {"ms": 3}
    axes.plot(x, values, **look, **width, marker=".")
    if errors is not None:
        axes.errorbar(x, values, errors, fmt="none", ecolor=look["color"])


def cross_out(axes: Axes, x: np.ndarray, row: float, colour: Any, size: float) -> None:
    """Crosses of a size in points at places (n,) along a panel, in a row of it; whole at its ends
    too, without room made for them."""
    look: Look = {"ls": "", "marker": "x", "ms": size, "color": colour, "clip_on": False}
    (crosses,) = axes.plot(x, np.full(len(x), row), transform=axes.get_xaxis_transform(), **look)
    crosses.set_in_layout(False)


SHARE_WORDS = "share of members: "
"""How the label of a share begins; where each member is drawn by itself, it says yes or no."""


def map_label(
    sweeps: Sequence[SweepView], spec: Mapping[str, Any], units_of: Callable[[str], str]
) -> str:
    """The label of a map's colours, or of a curve's height."""
    name, _, component = spec["variable"].partition(".")
    attributes = sweeps[0].variable(name).attrs
    meaning = str(attributes.get("long_name", name))
    if component in str(attributes.get("flag_meanings", "")).split():
        return f"{SHARE_WORDS}{axis_words(component)} is the {meaning}"
    shown = f"{meaning}, here {axis_words(component)}" if component else meaning_in_tex(meaning)
    if name in OF_ATTITUDE:
        # Its meaning takes a sentence, which is longer than an axis.
        shown = f"${symbol(spec['variable'])}$"
    unit = value_unit(sweeps[0], name, units_of)
    in_units = f" [{unit}]" if unit else ""
    over = dict.fromkeys(
        axis for swept in sweeps for axis in averaged(spec, swept.axes, swept.sphere)
    )
    if not over:
        return f"{shown}{in_units}"
    lacking = any(bool(swept.variable(name).isnull().any()) for swept in sweeps)
    of_some = " of the members that have one" if lacking else ""
    return f"{shown}, mean over {', '.join(over)}{of_some}{in_units}"


def meanings(swept: SweepView, variable: str) -> dict[int, str]:
    """The meanings of a label's values; an empty dict for a variable that is no label."""
    attributes = swept.data[variable].attrs if variable in swept.data else {}
    values = np.atleast_1d(attributes.get("flag_values", ())).tolist()
    return dict(zip(values, str(attributes.get("flag_meanings", "")).split(), strict=True))


def names_of(
    swept: SweepView, indices: Mapping[str, int], label: str, sweep_count: int
) -> tuple[str, str]:
    """The names of a curve or panel in its picture, and in tables and pages: the label that it is
    given, or its sweep and the positions that tell it from the others."""
    if label:
        return label, label
    sweep_name = [swept.name] if sweep_count > 1 else []
    in_picture = [position(swept, *place) for place in indices.items()]
    in_tables = [
        f"{key} = {swept.ticks(key)[0][i]:.4g} {swept.unit(key)}".rstrip()
        for name, i in indices.items()
        for key in swept.numbers_along(name)
    ]
    plain = ", ".join([*sweep_name, *in_tables])
    return ", ".join([*sweep_name, *in_picture]), plain or swept.name
