"""What each kind of figure takes: the keys of an entry in a case file's `figures:` block, besides
`kind`."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..schema.kinds import (
    NAMES,
    Choice,
    Integer,
    Key,
    KeyPath,
    ListOf,
    Mistake,
    Number,
    Table,
    Text,
    Vector,
    unknown,
)

FORMATS = ("png", "svg", "pdf", "csv", "html")
"""The formats that a figure is written in."""

SCRIPT = "plotly.js"
"""What all figures in HTML share, in the folder above theirs."""

DRAWN_CASES = Key(NAMES, "cases to draw, in this order")
LEGEND = Key(
    NAMES, "names of the cases in the legend, in their order (default: their own)", default=()
)
TITLE = Key(
    Text(), "short title above the panels, so that a picture alone says what it shows", default=""
)
DERIVED = (
    *("p", "q", "r", "G", "G2", "T", "J", "D", "D/2T", "x", "y", "Gz", "H"),
    *("x1_direction", "separatrix_distance"),
)
"""What `results.motion` computes from the samples of a motion, besides what is stored of it."""

COLOUR_NAMES = ("blue", "orange", "green", "sky", "red", "purple", "black", "grey")
LINE_NAMES = ("solid", "dashed", "dotted")
"""What a style is made of; the drawing says how each looks."""

STYLES = Key(
    NAMES,
    "colour and line of each case, such as `red`, `blue dashed` or `grey dotted`, in their order "
    "(default: a palette)",
    default=(),
)
CAPTION = Key(Text(), "what the figure shows; assumptions and misprints of its cases", default="")
TIME_SYMBOL = Key(Text(), "symbol of time, in TeX", default=r"\tau")
VIEW = Key(
    Vector(2),
    "direction of view: elevation above the x1 x2 plane, azimuth from x1",
    "degree",
    (24.0, 35.0),
)
MOST_FIGURES = {
    "cases": DRAWN_CASES,
    "labels": LEGEND,
    "styles": STYLES,
    "title": TITLE,
    "caption": CAPTION,
    "time": TIME_SYMBOL,
}

COLOUR = "what the colour of the curve shows"
ZOOM = "adds a panel that shows the neighbourhood of the origin up to this size"

INSET = Table(
    {
        "panel": Key(Text(), "panel that holds it: a variable or, with `panels: case`, a case"),
        "case": Key(Text(), "case drawn in it"),
        "variables": Key(NAMES, "variables drawn in it"),
        "span": Key(Vector(2), "part of the time axis drawn (default: all)", "time", None),
        "box": Key(
            Vector(4),
            "left, bottom, width, height within the panel, as fractions",
            default=(0.5, 0.5, 0.46, 0.38),
        ),
    }
)

HODOGRAPH = {
    "colour": Key(Choice("axis", "time", "case"), COLOUR, default="axis"),
    "view": VIEW,
    "projections": Key(
        ListOf(Choice("x1x2", "x1x3", "x2x3")),
        "planes onto which the curve is projected, a panel each",
        default=(),
    ),
    "zoom": Key(Number(above=0), ZOOM, "moment of inertia / time", None),
}

SPHERE = {
    "colour": Key(Choice("axis", "time", "case"), COLOUR, default="case"),
    "view": VIEW,
}

QUADRANTS = {
    "scale_with": Key(NAMES, "figures of this file that share one scale with this one", default=()),
    "zoom": Key(Number(above=0), ZOOM, "1/time^2", None),
}

SKETCH = {
    "bodies": Key(
        ListOf(Vector(3, above=0)), "principal moments of inertia of each body, a panel each"
    ),
    "labels": Key(NAMES, "title of each panel, in the order of `bodies`", default=()),
    "title": TITLE,
    "caption": CAPTION,
}

SERIES = {
    "variables": Key(NAMES, "variables of the result, components such as `omega.x1`, or `D/2T`"),
    "panels": Key(
        Choice("variable", "case"), "one panel a variable, or one panel a case", default="variable"
    ),
    "columns": Key(Integer(least=1, most=6), "panels in a row", default=2),
    "span": Key(Vector(2), "part of the time axis to draw (default: all)", "time", None),
    "level": Key(Number(), "draws a horizontal line at this value", default=None),
    "passages": Key(
        Choice("yes", "no"),
        "mark crossings, and the true ones that an averaged motion predicts",
        default="no",
    ),
    "insets": Key(ListOf(INSET), "enlargements inside panels", default=()),
}

PHASE = {
    "x": Key(Text(), "variable on the horizontal axis, named as in a series"),
    "y": Key(Text(), "variable on the vertical axis"),
}

SWEPT_VARIABLE = Key(
    Text(),
    "variable of the sweep, a component (`share.x1`), or the share of a label "
    "(`end_axis.x1`); averaged over the axes that are not drawn",
)

MAP = {
    "cases": Key(NAMES, "sweeps to draw, a row of panels each"),
    "labels": LEGEND,
    "title": TITLE,
    "caption": CAPTION,
    "variable": SWEPT_VARIABLE,
    "x": Key(
        Text(),
        "axis of the sweep on the horizontal axis "
        "(default, if y is left out too: an equal-area map of the sphere)",
        default=None,
    ),
    "y": Key(Text(), "axis of the sweep on the vertical axis", default=None),
    "panels": Key(Text(), "axis of the sweep that the panels follow", default=None),
    "at": Key(
        ListOf(Integer(least=0)),
        "positions on that axis, counted from zero (default: all)",
        default=(),
    ),
    "range": Key(
        Vector(2), "ends of the colour scale (default: those of the values)", default=None
    ),
    "level": Key(Number(), "over two axes: draws the contour of this value", default=None),
}

CURVE = {
    "cases": Key(NAMES, "sweeps to draw, each a curve or a curve an entry of `by`"),
    "labels": LEGEND,
    "title": TITLE,
    "caption": CAPTION,
    "variable": SWEPT_VARIABLE,
    "x": Key(Text(), "axis of the sweep on the horizontal axis"),
    "by": Key(Text(), "axis of the sweep of which each entry is a curve", default=None),
    "at": Key(
        ListOf(Integer(least=0)),
        "positions on `by`, counted from zero (default: all)",
        default=(),
    ),
    "level": Key(Number(), "draws a horizontal line at this value", default=None),
}

GROUPS = {
    "groups": Key(ListOf(Integer(least=1)), "how many of the cases make up each line"),
    "small": Key(ListOf(Number(above=0)), "the small parameter of each case"),
    "parameter": Key(Text(), "symbol of the small parameter, in TeX", default=r"\varepsilon"),
}

ERROR_ORDER = GROUPS | {"against": Key(NAMES, "the case that each of the cases is compared with")}

FIGURE_KINDS: dict[str, dict[str, Key]] = {
    "hodograph": MOST_FIGURES | HODOGRAPH,
    "sphere": MOST_FIGURES | SPHERE,
    "quadrants": MOST_FIGURES | QUADRANTS,
    "quadrant-sketch": SKETCH,
    "series": MOST_FIGURES | SERIES,
    "phase": MOST_FIGURES | PHASE,
    "invariants": MOST_FIGURES,
    "map": MAP,
    "curve": CURVE,
    "order": MOST_FIGURES | ERROR_ORDER,
    "cost": MOST_FIGURES | GROUPS,
    "share": MOST_FIGURES,
}


def check_figure(values: Mapping[str, Any]) -> Iterator[Mistake]:
    """What is wrong with keys of a figure that are each right by themselves."""
    named = "bodies" if values.get("kind") == "quadrant-sketch" else "cases"
    labels, several = values.get("labels", ()), values.get(named, ())
    # The labels of a sweep are those of panels or curves, whose number its axes decide.
    if values.get("kind") not in ("map", "curve") and len(labels) > len(several):
        said = f"expected one for each of {len(several)} {named}, got {len(labels)}"
        yield ("labels",), said
    for i, style in enumerate(values.get("styles", ())):
        colour, _, line = style.partition(" ")
        for word, known in ((colour, COLOUR_NAMES), (line or "solid", LINE_NAMES)):
            if word not in known:
                yield ("styles", i), unknown(f"colour or line {word!r}", word, known)
    for key in ("range", "span"):
        if (ends := values.get(key)) and not ends[0] < ends[1]:
            yield (key,), f"expected the lower end first, got {ends[0]:g}, {ends[1]:g}"
    if values.get("kind") == "map":
        yield from _of_axes(values.get("x"), values.get("y"), values.get("panels"))
    if values.get("kind") == "curve" and (by := values.get("by")) and by == values.get("x"):
        yield ("by",), f"{by} is on the horizontal axis already"


def check_variables(values: Mapping[str, Any], stored: Iterable[str]) -> Iterator[Mistake]:
    """Names of variables that motions with these stored variables cannot have."""
    valid = [*DERIVED, *stored]
    given: dict[KeyPath, str] = {
        ("variables", i): name for i, name in enumerate(values.get("variables", ()))
    }
    if values.get("kind") == "phase":
        given |= {(key,): values[key] for key in ("x", "y") if key in values}
    for i, inset in enumerate(values.get("insets", ())):
        given |= {("insets", i, "variables", j): v for j, v in enumerate(inset["variables"])}
        yield from _of_inset(inset, values, ("insets", i))
    for at, name in given.items():
        if name.partition(".")[0] not in valid:
            yield at, unknown(f"variable {name!r}", name, valid)


def _of_inset(
    inset: Mapping[str, Any], values: Mapping[str, Any], at: KeyPath
) -> Iterator[Mistake]:
    """Names in an inset that its figure does not have."""
    cases = values["cases"]
    panels = cases if values["panels"] == "case" else values["variables"]
    for key, valid in (("panel", panels), ("case", cases)):
        if inset[key] not in valid:
            yield (*at, key), unknown(f"{key} {inset[key]!r}", inset[key], valid)


SWEPT_KINDS = ("map", "curve")
"""The kinds that draw sweeps."""


def check_swept(
    values: Mapping[str, Any], sweeps: Iterable[tuple[str, Mapping[str, Any] | None, list[str]]]
) -> Iterator[Mistake]:
    """Names in a figure of sweeps that these do not have; of each its name, its `sweep:` block and
    what may be stored of its members."""
    for i, (name, axes, stored) in enumerate(sweeps):
        if not axes:
            yield ("cases", i), f"case {name} is no sweep"
            continue
        variable = values.get("variable", stored[0])
        if variable.partition(".")[0] not in stored:
            yield ("variable",), unknown(f"variable {variable!r}", variable, stored)
        for key in ("x", "y", "by", "panels"):
            if (axis := values.get(key)) is not None and axis not in axes:
                yield (key,), unknown(f"axis {axis!r} of sweep {name}", axis, list(axes))


def _of_axes(x: str | None, y: str | None, panels: str | None) -> Iterator[Mistake]:
    """Axes of a map that are missing, or stand twice."""
    if (x is None) != (y is None):
        missing, given = ("x", "y") if x is None else ("y", "x")
        yield (), f"missing '{missing}': a map has x and y, or neither (it has {given})"
    elif x is not None and x == y:
        yield ("y",), f"{y} is on the horizontal axis already"
    if panels is not None and panels in (x, y):
        yield ("panels",), f"{panels} is an axis of the panels already"
