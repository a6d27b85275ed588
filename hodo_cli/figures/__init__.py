"""Drawings of motions and sweeps: `draw` makes the sheet of one figure, `save` its files. The only
importer of matplotlib; it reads datasets and knows no command and no claim."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib.style
import numpy as np

from .. import HodoError
from ..quantities import lack_of
from ..results.dataset import Cases, motions_of
from ..results.motion import Motion
from ..schema.spelling import unknown
from .between import Course, course, remark, samples_in
from .files import save
from .look import STYLE_SHEET, Sheet, check_units
from .maps import sweep_curve, sweep_map
from .plane import invariants, phase, quadrant_sketch, quadrants, series
from .space import axis_trace, body, herpolhode, hodograph, sphere

__all__ = ["draw", "save", "user_parameters"]

KINDS_DRAWN: dict[str, tuple[Callable[[Sheet, Sequence[Course]], None], tuple[str, ...]]] = {
    "hodograph": (hodograph, ("omega",)),
    "sphere": (sphere, ("omega",)),
    "herpolhode": (herpolhode, ("omega_space", "G_space")),
    "axis-trace": (axis_trace, ("x1_space",)),
    "body": (body, ("omega_space", "G_space")),
    "quadrants": (quadrants, ("omega",)),
    "quadrant-sketch": (quadrant_sketch, ()),
    "series": (series, ()),
    "phase": (phase, ()),
    "invariants": (invariants, ("omega",)),
}
"""The kinds of figures of motions: the function that draws each, and the variables that it
needs."""

KINDS_OF_SWEEPS: dict[str, Callable[[Sheet, Cases], None]] = {
    "map": sweep_map,
    "curve": sweep_curve,
}

RC_GROUPS = (
    "axes", "axes3d", "errorbar", "font", "grid", "hatch", "legend", "lines", "mathtext", "patch",
    "savefig", "svg", "xtick", "ytick",
)  # fmt: skip
"""The groups of matplotlib's parameters that a case file may set. Case files come from strangers,
and other parameters name programs and functions that are then started."""


def user_parameters() -> dict[str, Any]:
    """The parameters of matplotlib that a notebook or a style sheet has set."""
    groups = (*RC_GROUPS, "figure", "image", "text")
    usual, now = matplotlib.rcParamsDefault, matplotlib.rcParams
    return {x: now[x] for x in now if x.partition(".")[0] in groups and now[x] != usual[x]}


def check_rc(rc: Mapping[str, Any]) -> None:
    """Raise HodoError for an unknown parameter of matplotlib, one that case files must not set, or
    a wrong value."""
    for key, value in rc.items():
        if str(key).partition(".")[0] not in RC_GROUPS:
            groups = ", ".join(RC_GROUPS)
            raise HodoError(f"style: rc: {key}: a case file sets {groups} and no other group")
        try:
            matplotlib.RcParams({key: value})
        except KeyError:
            wrong = unknown(f"parameter {key!r}", key, matplotlib.rcParams)
            raise HodoError(f"style: rc: {wrong}") from None
        except ValueError as error:
            raise HodoError(f"style: rc: {key}: {str(error).splitlines()[0]}") from None


def draw(
    spec: Mapping[str, Any],
    cases: Cases,
    figures: Mapping[str, Mapping[str, Any]] = {},
    rc: Mapping[str, Any] = {},
) -> Sheet:
    """The figure that one entry of a `figures:` block describes, of datasets by name; it may share
    the scale of other `figures`. Parameters `rc` of matplotlib apply where its style sets none.

    Raises HodoError if a case or a variable is missing, the kind has no meaning for a case, or
    matplotlib does not know the style.
    """
    own = spec["style"].get("rc", {})
    check_rc(own)
    for name in spec.get("cases", ()):
        if name not in cases:
            owner = getattr(cases, "path", "the data")
            raise HodoError(f"{owner} has no result of case {name} yet: run it first")
    with matplotlib.style.context(["default", STYLE_SHEET, dict(rc), dict(own)]):
        sheet = Sheet(spec)
        if of_sweeps := KINDS_OF_SWEEPS.get(spec["kind"]):
            of_sweeps(sheet, {name: cases[name] for name in spec["cases"]})
        else:
            draw_motions(sheet, cases, figures)
        sheet.finish()
    return sheet


def draw_motions(sheet: Sheet, cases: Cases, figures: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw a figure of motions, and warn of motions with too few samples."""
    spec = sheet.spec
    named = "bodies" if "bodies" in spec else "cases"
    count, given = len(spec.get(named, ())), len(spec["labels"])
    if given > count:
        raise HodoError(
            f"labels: expected one for each of the {named}, {count} in all, got {given}"
        )
    motions = motions_of(cases, spec.get("cases", ()), spec["labels"])
    sheet.spec = {**spec, "time": symbol_of_time(spec, motions)}
    for name in (others := spec.get("scale_with", ())):
        if name not in figures:
            raise HodoError(f"scale_with: {unknown(f'figure {name!r}', name, figures)}")
    sharing = [case for name in others for case in figures[name]["cases"]]
    sheet.others = motions_of(cases, sharing)
    draw_kind, needs = KINDS_DRAWN[spec["kind"]]
    check_variables([*motions, *sheet.others], spec["kind"], needs)
    courses = [course(m) for m in motions]
    draw_kind(sheet, courses)
    recorded = [name for _, columns in sheet.table for name in columns]
    for name in dict.fromkeys(recorded) if motions else ():
        # A squared rate has the units of y = r^2.
        quantity = "y" if name.endswith("^2") else name
        # G/|G| has no units.
        if not name.endswith("/|G|"):
            check_units(motions, quantity)
            sheet.units[name] = motions[0].units(quantity)
    variables = [spec[key] for key in ("x", "y") if key in spec]
    for m in courses:
        names = [*needs, *spec.get("variables", variables)]
        if line := remark(m, names, samples_in(m.samples, spec.get("span"))):
            warnings.warn(line, stacklevel=3)


def check_variables(motions: Sequence[Motion], kind: str, needs: Sequence[str]) -> None:
    """Raise HodoError for a motion that lacks a variable which a kind of figure draws, or whose
    omega is nan at some time: such a sample has no place on a curve."""
    for m in motions:
        for name in needs:
            if lack := lack_of(m.case, name, m.sources, f"kind {kind}"):
                raise HodoError(lack)
        vector = m.data.get("omega")
        if needs and vector is not None and vector.shape[-1] < 3:
            raise HodoError(f"{m.words} has not all components of omega, which kind {kind} needs")
        if "omega" in needs and (missing := ~np.isfinite(m.omega).all(axis=-1)).any():
            when = m.case.time.text(m.time[missing.argmax()])
            raise HodoError(
                f"omega of {m.words} has no value at {when}: draw the samples that have one, "
                "as data.dropna('time') selects them"
            )


def symbol_of_time(spec: Mapping[str, Any], motions: Sequence[Motion]) -> str:
    """The symbol of time: the figure's own, or tau for a slow time without a unit, else t."""
    is_tau = not motions or motions[0].units("time") == "1" or motions[0].case.system.slow_time
    usual = r"\tau" if is_tau else "t"
    return str(spec.get("time") or usual)
