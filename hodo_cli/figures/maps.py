"""Figures of sweeps: a variable over one axis, over two, or over the directions of the start."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, repeat
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from .. import HodoError
from ..models.rigid_body import inertia_order, separatrix_circles, separatrix_terms
from ..models.theory.theorems import turning_momenta
from ..results.dataset import Cases
from ..sweeps.view import SweepView
from ..text import grouped
from .look import (
    AXIS_LOOKS,
    COLUMN,
    GREY,
    SEPARATRIX,
    Look,
    Sheet,
    colour_bar,
    looks,
    raised,
    usual_width,
)
from .space import pale
from .words import HALO, Words, without_tex

NO_VALUE = "#E4E4E4"
"""The colour of members without a value, a grey that no colour map contains."""

LEVEL: Look = {
    "color": "white", "lw": 0.9, "path_effects": [withStroke(linewidth=2, foreground="black")],
}  # fmt: skip
"""The look of a contour, visible on every colour, and on a white page."""

THEORY: Look = {"color": "#D55E00", "lw": 1.4, "ls": (0, (3.4, 1.4))}
"""The look of a curve of theory over a map."""

MOST_COUNTS = 8
"""The largest range of counts in which each count has a colour of its own: with more colours they
are too alike."""

KEY_SYMBOLS = {
    "damping": r"\lambda", "inertia": "A", "torque": "M", "quadratic": "c", "rotor": "h",
    "kappa": r"\kappa", "epsilon": r"\varepsilon", "mu": r"\mu", "theta": r"\theta",
    "diagonal": "I_{ii}", "off_diagonal": "I_{ij}", "brake": "b", "resistance": "I",
}  # fmt: skip

VARIABLE_WORDS = {
    "crossing_time": "time of the crossing, ${t}_1$",
    "crossing_G": "$|G|$ at ${t}_1$",
}
"""Words for variables whose meanings are longer than an axis, with the symbol of time."""


def key_symbol(key: str) -> str:
    """The symbol of a key in TeX: damping.2 is lambda_3, resistance.0.1 is I_12, a.1 is a_1, the
    coefficient of t."""
    head, _, last = key.rpartition(".")
    if last.isdecimal():
        counts_from_0 = head in ("a", "b", "m", "mu")
        index = last if counts_from_0 else str(int(last) + 1)
        whole, _, before = key_symbol(head).partition("_")
        indices = before.strip("{}") + index
        return f"{whole}_{indices}" if len(indices) == 1 else f"{whole}_{{{indices}}}"
    words = last if len(last) < 3 else rf"\mathrm{{{last}}}".replace("_", r"\_")
    return KEY_SYMBOLS.get(last, words)


def axis_name(swept: SweepView, axis: str) -> str:
    """The symbol and the unit of an axis."""
    unit = raised(swept.unit(axis))
    return f"${key_symbol(swept.key(axis))}$" + (f" [{unit}]" if unit else "")


Cell = tuple[SweepView, str, str, np.ndarray]
"""A panel or curve: its sweep, its name in the picture and in tables, and its values."""


def check_axes_differ(spec: Mapping[str, Any]) -> None:
    """Raise HodoError if a map names only one of two axes, or an axis is drawn twice."""
    given = {key: spec[key] for key in ("x", "y", "panels", "by") if spec.get(key)}
    if spec["kind"] == "map" and len(alone := given.keys() & {"x", "y"}) == 1:
        (missing,) = {"x", "y"} - alone
        raise HodoError(f"missing '{missing}': a map has x and y, or neither")
    for name, (first, *more) in grouped((given[key], key) for key in given).items():
        if more:
            raise HodoError(f"{more[0]}: {name} is the axis of '{first}' already")


def cells(sheet: Sheet, cases: Cases, keep: Sequence[str], along: str | None) -> list[Cell]:
    """Each panel or curve of a figure of sweeps, with the values over the axes to keep. Raises
    HodoError as `check_axes_differ` does, and for an axis that is missing or has several units."""
    spec, cells_drawn = sheet.spec, []
    check_axes_differ(spec)
    labels = chain(spec["labels"], repeat(""))
    for name, data in cases.items():
        swept = swept_in(name, data, spec["variable"], [*keep, *filter(None, [along])])
        swept = swept.sorted_along(*keep)
        for axis in keep:
            if sheet.units.setdefault(axis, swept.unit(axis)) != swept.unit(axis):
                raise HodoError(f"axis {axis} has several units: one scale has one unit")
        places = [{along: i} for i in spec["at"] or range(swept.axes[along])] if along else [{}]
        for at in places:
            values = swept.values(spec["variable"], keep or [swept.sphere], at)
            label, of_case = next(labels), name if len(cases) > 1 else ""
            shown, plain = (
                label or ", ".join(filter(None, [of_case, *position(swept, at, in_tex)]))
                for in_tex in (True, False)
            )
            cells_drawn.append((swept, shown, without_tex(plain) or name, values))
    sheet.units = {axis: of for axis, of in sheet.units.items() if of not in ("", "rad")}
    variable = cells_drawn[0][0].variable(spec["variable"].partition(".")[0])
    if (stated := str(variable.attrs.get("units", "1"))) != "1":
        sheet.units[spec["variable"]] = stated
    return cells_drawn


def swept_in(name: str, data: Any, variable: str, axes: Sequence[str]) -> SweepView:
    """The sweep in a dataset. Raises HodoError if it is none, has no such axes, or if the variable
    has no meaning for it."""
    if "members" not in data.attrs:
        raise HodoError(f"case {name} is no sweep")
    swept = SweepView.of(name, data)
    if reason := swept.undivided(variable):
        raise HodoError(f"case {name} has no separatrix to be drawn: {reason}")
    if missing := [axis for axis in axes if axis not in swept.axes]:
        its_axes = ", ".join(swept.axes)
        raise HodoError(f"sweep {name} has no axis {missing[0]} (its axes: {its_axes})")
    return swept


def position(swept: SweepView, at: Mapping[str, int], in_tex: bool) -> Iterator[str]:
    """A position on each of some axes in words: the symbol of the key, or the key, = the value."""
    for axis, i in at.items():
        value, key = f"{swept.ticks(axis)[0][i]:.4g}", swept.key(axis)
        equal = f"${key_symbol(key)} = {value}$" if in_tex else f"{key} = {value}"
        yield f"{equal} {swept.unit(axis)}".strip()


def meaning(cells_drawn: Sequence[Cell], spec: Mapping[str, Any], keep: Sequence[str]) -> str:
    """What the colours of a map, or the heights of a curve, show, with the axes over which all
    sweeps are averaged."""
    (swept, *_), (name, _, part) = cells_drawn[0], spec["variable"].partition(".")
    attrs = swept.variable(name).attrs
    t = "t" if swept.case.time.unit != "1" else r"\tau"
    words = VARIABLE_WORDS.get(name, str(attrs.get("long_name", name))).replace("{t}", t)
    if part in str(attrs.get("flag_meanings", "")).split():
        words = f"share of members: ${part[0]}_{part[1:]}$ is the {words}"
    elif part:
        words += f": ${part[0]}_{part[1:]}$"
    stated = str(attrs.get("units", "1"))
    unit = "–" if stated == "1" and name in VARIABLE_WORDS else raised(stated)
    drawn = {*(keep or [swept.sphere]), spec.get("by"), spec.get("panels")}
    shared = set(swept.axes).intersection(*(cell[0].axes for cell in cells_drawn))
    over = [axis for axis in swept.axes if axis in shared - drawn]
    mean = f", mean over {', '.join(over)}" if over else ""
    return words + mean + (f" [{unit}]" if unit != "1" else "")


def scale_of(
    spec: Mapping[str, Any], known: np.ndarray, labelled: bool
) -> tuple[Normalize, ListedColormap | LinearSegmentedColormap]:
    """The scale and the colours of a map of known values (n,). Labels, and the share of a label,
    have the colours of the axes in every figure."""
    low, high = spec["range"] or (float(known.min()), float(known.max()))
    part = spec["variable"].rpartition(".")[2]
    plasma = ListedColormap(matplotlib.colormaps["plasma"](np.linspace(0, 0.93, 256)))
    if labelled:
        colours = [AXIS_LOOKS[label][0] for label in range(int(low), int(high) + 1)]
        return Normalize(low - 0.5, high + 0.5), ListedColormap(colours)
    if part in ("x1", "x2", "x3"):
        colour = AXIS_LOOKS[int(part[1])][0]
        ends: Any = [pale(colour, 0.88), colour]
        # Where all values are equal, 1 has another colour than 0.
        alike = np.isin(known, (0, 1)).all() or low == high
        ends_of_scale = (0, 1) if alike and not spec["range"] else (low, high)
        return Normalize(*ends_of_scale), LinearSegmentedColormap.from_list(part, ends)
    if not spec["range"] and high - low <= MOST_COUNTS and (known % 1 == 0).all():
        # A continuous scale would show counts that no member has.
        return Normalize(low - 0.5, high + 0.5), plasma.resampled(int(high - low) + 1)
    if high - low <= 1e-12 * max(abs(high), abs(low)):  # a scale of rounding has no meaning
        return Normalize(low - 0.1 * abs(low), low + 0.1 * abs(low)), plasma.resampled(1)
    return Normalize(low, high), plasma


def sweep_map(sheet: Sheet, cases: Cases) -> None:
    """Draw a variable over two axes, or over the directions of the start, a panel for each
    position."""
    spec = sheet.spec
    keep = [spec["x"], spec["y"]] if spec["x"] else []
    drawn = cells(sheet, cases, keep, spec["panels"])
    (first, *_), n = drawn[0], len(drawn)
    flags = first.data[spec["variable"]].attrs if spec["variable"] in first.data else {}
    numbers = np.atleast_1d(flags.get("flag_values", ())).tolist()
    words = dict(zip(numbers, str(flags.get("flag_meanings", "")).split(), strict=False))
    all_values = np.concatenate([values.ravel() for *_, values in drawn])
    finite = all_values[np.isfinite(all_values)]
    norm, colours = scale_of(spec, finite if finite.size else np.zeros(1), bool(words))
    of_each = n // len(cases)  # a row for each case that has several panels
    by_case = of_each if len(cases) > 1 and of_each > 1 else min(n, 3)
    columns = sheet.columns(2 if by_case == 3 and n == 4 else by_case)
    grid: Look = {"sharex": True, "sharey": True}
    if not keep:
        grid = {"subplot_kw": {"projection": "hammer"}}
    row = usual_width(columns) / columns * (0.85 if keep else 0.6)
    panels = sheet.panels(row, n, columns, 0.55, **grid)
    look: Look = {"norm": norm, "cmap": colours.with_extremes(bad=NO_VALUE), "rasterized": True}
    for axes, (swept, title, name, values) in zip(panels, drawn, strict=True):
        axes.set_title(title)
        draw_panel = plane if keep else globe
        draw_panel(sheet, axes, swept, name, values, look)
    for axes in panels if keep else ():
        axes.label_outer()
    if len(finite) < len(all_values):
        absent = "no crossing" if spec["variable"].startswith("crossing") else "no value"
        sheet.handles.append(Patch(fc=NO_VALUE, ec=GREY, lw=0.4, label=absent))
    colour_words = meaning(drawn, spec, keep)
    prefix, meanings = f"{colour_words}: ", words
    # Shares that are all 0 or 1 need no scale: two entries of the legend name them.
    if colour_words.startswith("share of") and np.isin(finite, (0, 1)).all():
        prefix, meanings = "", {1: colour_words.partition(": ")[2], 0: "otherwise"}
    for value in (value for value in meanings if value in finite):
        word = re.sub(r"^x([123])$", r"$x_\1$", meanings[value])
        sheet.handles.append(Patch(fc=colours(norm(value)), label=prefix + word))
    if finite.size and not meanings:
        scale_beside(sheet, panels, (norm, colours), finite, colour_words)


def scale_beside(
    sheet: Sheet, panels: Sequence[Axes], look: tuple[Normalize, Any], known: np.ndarray, words: str
) -> None:
    """Draw the bar of the colours of a map, with arrows at the ends beyond which there are
    values."""
    norm, colours = look
    low, high = float(norm.vmin or 0), float(norm.vmax or 0)
    ends = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}
    arrows = ends[int(known.min() < low), int(known.max() > high)]
    bar = colour_bar(sheet, ScalarMappable(norm, colours), panels, words, arrows)
    if colours.N <= MOST_COUNTS + 1:
        bar.set_ticks(np.linspace(low, high, 2 * colours.N + 1)[1::2].tolist())


def plane(
    sheet: Sheet, axes: Axes, swept: SweepView, name: str, values: np.ndarray, look: Look
) -> None:
    """Draw an image over two axes, with a level and the curve of theory."""
    spec = sheet.spec
    (x, even_x), (y, even_y) = swept.ticks(spec["x"]), swept.ticks(spec["y"])
    axes.set(
        xscale="log" if even_x else "linear",
        yscale="log" if even_y else "linear",
        xlabel=axis_name(swept, spec["x"]),
        ylabel=axis_name(swept, spec["y"]),
    )
    axes.pcolormesh(edges(x, even_x), edges(y, even_y), values.T, **look)
    across = {spec["x"]: np.repeat(x, len(y)), spec["y"]: np.tile(y, len(x))}
    sheet.record(name, {**across, spec["variable"]: values.ravel()})
    if spec["level"] is not None:
        unit = sheet.units.get(spec["variable"], "")
        contour(
            sheet, axes, (x, y, values), spec["level"], LEVEL, f"level {spec['level']:g} {unit}"
        )
    if spec["theory"]:
        i, j = (np.unique(np.linspace(0, len(v) - 1, 33).astype(int)) for v in (x, y))
        ratio = [[balance(swept.at({spec["x"]: a, spec["y"]: b})) for b in j] for a in i]
        places = x[i], y[j], np.array(ratio)
        contour(sheet, axes, places, 1.0, THEORY, "fluid and damping balance")


MANY_CELLS = 20
"""With this many cells along an axis half of an outer cell is not missed."""


def edges(values: np.ndarray, ratios: bool) -> np.ndarray:
    """The edges (n + 1,) of cells about values (n,), half way between them, by differences or
    ratios."""
    x = np.log(values) if ratios else values
    # Half of the width of a single cell.
    alone = 0.5 if ratios else 0.1 * abs(x[0]) or 0.5
    half = np.diff(x) / 2 if len(x) > 1 else np.array([alone])
    # If there are many cells, the outer ones end at their values.
    outer = half * (len(x) < MANY_CELLS)
    ends = np.concatenate([x[:1] - outer[:1], x[:-1] + half[: len(x) - 1], x[-1:] + outer[-1:]])
    return np.asarray(np.exp(ends) if ratios else ends)


def contour(
    sheet: Sheet, axes: Axes, of: tuple[np.ndarray, ...], level: float, look: Look, words: str
) -> None:
    """Draw the contour of values (n, m) over x and y at a level, and add its entry to the
    legend."""
    x, y, values = of
    reached = np.fmin.reduce(values, axis=None) <= level < np.fmax.reduce(values, axis=None)
    if reached and min(values.shape) > 1:
        drawn = axes.contour(x, y, values.T, [level], colors=look["color"])
        drawn.set(linewidth=look["lw"], linestyle=[look.get("ls", "-")])
        drawn.set(path_effects=look.get("path_effects"))
        sheet.name(words.strip(), **look)
    else:
        sheet.name(f"nowhere {words.strip()}", ls="")


def balance(case: Any) -> float:
    """|G| at the start over the |G| at which the sense of crossings turns on the mean. Raises
    HodoError for a sweep whose torques no theorem covers."""
    if not (terms := case.system.dissipation):
        raise HodoError("theory: no theorem predicts the sense of crossings of the sweep")
    return float(case.system.momentum_at_start / turning_momenta(terms)[-1])


def globe(
    sheet: Sheet, axes: Axes, swept: SweepView, name: str, values: np.ndarray, look: Look
) -> None:
    """Draw an equal-area map of the directions of G at the start; each cell has the value of the
    nearest direction on its own side of the separatrix."""
    from scipy.spatial import cKDTree  # late: it loads half of SciPy

    directions, A = swept.directions(), swept.body()
    longitude, latitude = np.linspace(-np.pi, np.pi, 361), np.linspace(-np.pi / 2, np.pi / 2, 181)
    middles = [(edge[1:] + edge[:-1]) / 2 for edge in (longitude, latitude)]
    along, up = np.meshgrid(*middles)
    grid = np.stack([np.cos(up) * np.cos(along), np.cos(up) * np.sin(along), np.sin(up)], axis=-1)
    side, grid_side = (outside(points, A) for points in (directions, grid))
    shown = np.empty(along.shape)
    for which in np.unique(grid_side):
        own_side = side == which
        starts = own_side if own_side.any() else np.full(len(side), True)
        nearest = cKDTree(directions[starts]).query(grid[grid_side == which])[1]
        shown[grid_side == which] = values[starts][nearest]
    axes.pcolormesh(longitude, latitude, shown, **look)
    axes.grid(False)
    axes.set(xticks=[], yticks=[])
    for circle in separatrix_circles(A) if A is not None else ():
        east, north = (
            np.arctan2(circle[:, 1], circle[:, 0]),
            np.arcsin(np.clip(circle[:, 2], -1, 1)),
        )
        east[1:][np.abs(np.diff(east)) > np.pi] = np.nan
        axes.plot(east, north, **SEPARATRIX, path_effects=HALO, label="separatrix, $D = 0$")
    for text, at in SPHERE_AXES.items():
        axes.plot(*at, "k.", ms=2.5, zorder=4, clip_on=False)
        Words(axes, text, [at], size="small")
    columns = {f"G.x{i + 1}/|G|": directions[:, i] for i in range(3)}
    sheet.record(name, {**columns, sheet.spec["variable"]: values})


SPHERE_AXES = {
    "$x_1$": (0, 0), "$x_2$": (np.pi / 2, 0), "$x_3$": (0, np.pi / 2),
    "$-x_2$": (-np.pi / 2, 0), "$-x_3$": (0, -np.pi / 2),
}  # fmt: skip
"""Longitude and latitude of the axes on a map of the sphere."""


def outside(directions: np.ndarray, A: np.ndarray | None) -> np.ndarray:
    """Whether D > 0 for directions (..., 3) of G of a body with moments A (3,)."""
    if A is None:
        return np.zeros(directions.shape[:-1], dtype=bool)
    outer, inner = separatrix_terms(A, np.moveaxis(directions / A, -1, 0), inertia_order(A))
    return np.asarray(outer > inner)


def sweep_curve(sheet: Sheet, cases: Cases) -> None:
    """Draw a variable over one axis: a curve for each sweep, or for each value of another axis."""
    spec = sheet.spec
    (axes,) = sheet.panels(0.85 * COLUMN)
    drawn = cells(sheet, cases, [spec["x"]], spec["by"])
    if not any(np.isfinite(values).any() for *_, values in drawn):
        raise HodoError(f"the sweep has no value of {spec['variable']} to draw")
    for (swept, title, name, values), look in zip(drawn, looks(len(drawn)), strict=True):
        x, even = swept.ticks(spec["x"])
        way: Look = {"marker": ".", "ms": 3, "lw": 0.4 if len(x) < 12 else 1}
        axes.plot(x, values, **look, **way, label=title if len(drawn) > 1 else "")
        axes.set(xscale="log" if even else "linear")
        sheet.record(name, {spec["x"]: x, spec["variable"]: values})
    if spec["level"] is not None:
        axes.axhline(spec["level"], **SEPARATRIX)
    all_values = np.concatenate([values for *_, values in drawn])
    if not (all_values[np.isfinite(all_values)] % 1).any():  # as numbers of crossings
        axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    first = drawn[0][0]
    height_words = meaning(drawn, spec, [spec["x"]])
    axes.set(xlabel=axis_name(first, spec["x"]), ylabel=height_words)
