"""Drawings of motions and sweeps, as files and pages of their own. They read datasets and know no
command, no engine and no claim; matplotlib is loaded nowhere else.

`kinds` holds what draws each kind of figure. What they share: `sheet` is a figure under
construction, and its files; `artists` has its colours, marks and legend entries, `symbols` and
`words` its texts; `style` finishes it.
"""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib.style
import numpy as np

from .. import NOT_OF_A_CASE, HodoError
from ..cases.case import Case
from ..cases.derived import PARTS
from ..cases.figure_block import FILM_FORMATS, Drawable, DrawnFigure, check_drawn, merged_style
from ..results.dataset import MOTION_DIMS, Cases, case_in, motions_of, sweep_axes
from ..results.motion import Motion
from ..results.resolution import OF_SAMPLES, coarse_curves
from ..schema.kinds import Wrong
from ..schema.spelling import unknown
from ..text import case_words
from .kinds.body import body
from .kinds.maps import sweep_curve, sweep_map
from .kinds.plane import invariants, phase, quadrant_sketch, quadrants, time_series
from .kinds.space import axis_trace, herpolhode, hodograph, sphere
from .sheet import SHEET_STYLE, Drawing, Layout, Sheet, save
from .style import finish_figure, matplotlib_parameters, wanted_width
from .words import lighten, slanted, text_size, text_width

if TYPE_CHECKING:
    import xarray as xr

NO_OTHERS: Mapping[str, Mapping[str, Any]] = {}
"""The figures with which a figure of datasets at hand may share its scale."""

NO_TIMES = (math.nan, math.nan)
"""The first and the last time of a sweep, or of a motion without samples."""

DRAW: dict[str, Callable[[Sheet, Mapping[str, Any], Sequence[Motion]], None]] = {
    "hodograph": hodograph,
    "sphere": sphere,
    "herpolhode": herpolhode,
    "axis-trace": axis_trace,
    "body": body,
    "quadrants": quadrants,
    "quadrant-sketch": quadrant_sketch,
    "series": time_series,
    "phase": phase,
    "invariants": invariants,
}
"""The kinds of figures of motions."""

DRAW_SWEEPS: dict[str, Callable[[Sheet, Mapping[str, Any], Cases], None]] = {
    "map": sweep_map,
    "curve": sweep_curve,
}
"""The kinds of figures of sweeps."""

SQUARES = [f"{factor}{letter}^2" for factor in ("", "K ") for letter in "pqr"]
"""The columns of the quadrants, whose units are those of y = r^2."""

WITH_GAPS = ("series", "phase")
"""The kinds of figures of motions that leave a gap where a quantity is no number."""


def draw(
    spec: Mapping[str, Any],
    cases: Cases,
    figures: Mapping[str, Mapping[str, Any]] = NO_OTHERS,
    rc: Mapping[str, Any] = NO_OTHERS,
) -> Sheet:
    """The figure that one entry of a `figures:` block describes, of datasets by name; it may share
    the scale of other `figures`. Parameters `rc` of matplotlib count where its style has none.

    Raises HodoError if a case or variable is not there, the kind of figure has no meaning for it,
    or a text is not TeX as matplotlib knows it.
    """
    others = cases_of_scale(spec, figures)
    words = {"title": slanted(spec["title"]), "labels": [*map(slanted, spec.get("labels", ()))]}
    style = merged_style(spec["style"])
    spec = {**with_time_symbol(spec, cases), **words, "style": style}
    check(spec, cases, others)
    look = {**SHEET_STYLE, **rc, **matplotlib_parameters(style)}
    with matplotlib.style.context(["default", look]):
        drawing = Drawing(layout=Layout(w_pad=0.04, h_pad=0.06, wspace=0.04))
        drawing.parameters = look
        for text in (*spec["labels"], f"${spec.get('time', 't')}$"):
            text_width(text, text_size("legend.fontsize"))  # which finds mistakes in its TeX
        sheet = Sheet(drawing, wanted_width(style))
        sheet.units, sheet.time = column_units(spec, cases), spec.get("time", "t")
        if draw_sweeps := DRAW_SWEEPS.get(spec["kind"]):
            draw_sweeps(sheet, spec, cases)
        else:
            motions = motions_of(cases, spec.get("cases", ()), spec["labels"])
            sheet.others = motions_of(cases, others)
            if spec["kind"] not in WITH_GAPS:
                check_numbers([*motions, *sheet.others])
            DRAW[spec["kind"]](sheet, spec, motions)
            sheet.remarks = remarks_on(spec, motions)
        finish_figure(sheet, spec["title"], style)
        lighten(drawing)
    return sheet


def cases_of_scale(spec: Mapping[str, Any], figures: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The cases of the other figures whose scale a figure shares. Raises HodoError for a figure
    that is not there."""
    names = spec.get("scale_with", ())
    for name in names:
        if name not in figures:
            raise HodoError(f"scale_with: {unknown(f'figure {name!r}', name, figures)}")
    return [case for name in names for case in figures[name]["cases"]]


def check_numbers(motions: Sequence[Motion]) -> None:
    """Raise HodoError for a motion whose omega is no number at some time, where it has no place on
    a hodograph."""
    for motion in motions:
        omega = motion.stored("omega") if "omega" in motion.data else np.zeros((1, 1))
        if (missing := ~np.isfinite(omega).all(axis=-1)).any():
            when = motion.case.time.text(motion.time[missing.argmax()])
            raise HodoError(
                f"omega of {motion.words} is no number at {when}: draw the samples that have one, "
                "as data.dropna('time') selects them"
            )


def with_time_symbol(spec: Mapping[str, Any], cases: Cases) -> Mapping[str, Any]:
    """A figure with the symbol of its time. The default is t for a time with a unit, and tau for
    the dimensionless time of the papers and for a slow one."""
    if "time" not in spec or spec["time"] is not None:  # a kind without a time, or a given symbol
        return spec
    first = cases.get(next(iter(spec["cases"]), ""))
    case = None if first is None or "case" not in first.attrs else case_in(first, "")
    is_tau = case is None or case.time.unit == "1" or case.system.slow_time
    return {**spec, "time": r"\tau" if is_tau else "t"}


def remarks_on(spec: Mapping[str, Any], motions: Sequence[Motion]) -> list[str]:
    """The remarks for a figure's caption: that its curves are polygons. Warns of it, too."""
    remarks = coarse_curves(spec, motions) if spec["kind"] in OF_SAMPLES else []
    for remark in remarks:
        warnings.warn(remark, stacklevel=3)
    return remarks


def column_units(spec: Mapping[str, Any], cases: Cases) -> Callable[[str], str]:
    """The units of a column of a figure's values by its name: the units of its motions or sweeps,
    which all share them."""
    name = next(iter(spec.get("cases", ())), "")
    if not name:
        return lambda column: "1"
    case = case_in(cases[name], case_words(name))
    units = Motion(case, cases[name].variables).units
    # A direction, G over its size, has none.
    own = {"run_time": "s", **dict.fromkeys(SQUARES, units("y"))}
    return lambda column: "1" if column.endswith("/|G|") else own.get(column) or units(column)


def check(spec: Mapping[str, Any], cases: Cases, others: Sequence[str]) -> None:
    """Raise HodoError for the first mistake that keeps a figure from being drawn of datasets,
    beside those of other cases."""
    for name in (*spec.get("cases", ()), *others):
        if name not in cases:
            owner = getattr(cases, "path", "the data")
            raise HodoError(f"{owner} has no result of case {name} yet: run it first")
    drawables = {name: drawable_of(name, cases[name]) for name in spec.get("cases", ())}
    for mistake in check_drawn(spec, drawables, with_sizes=True):
        raise HodoError(str(Wrong(mistake)))


def drawable_of(name: str, data: "xr.Dataset") -> Drawable:
    """The properties of a dataset that figures are checked by. Raises HodoError for one of several
    motions that is no sweep."""
    axes = {axis: data.sizes[axis] for axis in sweep_axes(data)}
    beyond = {str(dim) for v in data.variables.values() if "time" in v.dims for dim in v.dims}
    if not axes and (others := sorted(beyond - {*MOTION_DIMS})):
        along = " and ".join(others)
        raise HodoError(f"{case_words(name)} is several motions: select one along {along}")
    case = case_in(data, case_words(name))
    if "time" not in data.dims and "members" not in data.attrs:
        raise HodoError(f"{case_words(name)} is a motion at one time: select several")
    units = {"time": case.time.unit, "moments of inertia": case.inertia_unit}
    if axes:
        sphere = next((axis for axis in axes if f"{axis}_vector" in data.variables), "")
        variables = variables_over({*axes}, data.data_vars, case)
        return Drawable(name, case, variables, NO_TIMES, units, axes, sphere)
    variables, times = variables_over({"time"}, data.variables, case), NO_TIMES
    if variables.get("omega") == "axis":
        variables["G"] = "axis"
    if "time" in data.variables:
        time = data.variables["time"]
        units["time"] = str(time.attrs.get("units", "1"))
        if time.size and time.dtype.kind in "fiu":
            times = float(time.data.min()), float(time.data.max())
    return Drawable(name, case, variables, times, units, axes, sphere="")


def variables_over(outer: set[str], variables: Mapping[Any, Any], case: Case) -> dict[str, str]:
    """The variables of numbers along some dimensions, with the dimension of their components, empty
    for a number; without those that have other dimensions too. Those of a case itself are named
    whatever they hold: the motion says what is wrong with them."""
    own = case.system.variables
    inner = {
        str(name): {*variable.dims} - outer
        for name, variable in variables.items()
        if outer & {*variable.dims} and (variable.dtype.kind in "biuf" or name in own)
    }
    return {name: "".join(dims) for name, dims in inner.items() if dims <= PARTS.keys()}


def render(
    cases: Cases, figures: Mapping[str, Mapping[str, Any]], name: str,
    formats: Sequence[str], out: Path,
) -> DrawnFigure:  # fmt: skip
    """Draw one of the figures of a case file into the folder `out`; whatever goes wrong with it is
    its own problem."""
    try:
        sheet = draw(figures[name], cases, figures)
        drawn = [x for x in formats if sheet.figure.film or x not in FILM_FORMATS]
        files = [out / f"{name}.{suffix}" for suffix in drawn]
        about = " ".join(filter(None, [figures[name]["caption"], *sheet.remarks]))
        for file in files:
            save(sheet, file, about)
        return DrawnFigure(name, tuple(files))
    except HodoError as error:
        return DrawnFigure(name, problem="; ".join(str(error).splitlines()))
    except NOT_OF_A_CASE:
        raise
    except Exception as error:
        # A mistake of ours in one figure shall not cost the others. Without a traceback, the kind
        # of the error belongs in the message.
        return DrawnFigure(name, problem=f"{type(error).__name__}: {error}")
