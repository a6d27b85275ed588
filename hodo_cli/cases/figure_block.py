"""The keys of each kind of figure, as entries of a case file's `figures:` block, besides `kind`.
Only the drawing of a figure decides what a key means for its data."""

from collections.abc import Mapping
from typing import Any

from ..quantities import OVER_TIME
from ..schema.expression import Expression
from ..schema.kinds import (
    NAMES,
    Choice,
    Each,
    Either,
    Integer,
    Key,
    ListOf,
    Mapped,
    Number,
    Rule,
    Switch,
    Table,
    Text,
    Variant,
    Wrong,
    vector,
)

FORMULA_NAMES = ("t", *(name for name in OVER_TIME if name not in ("D/2T", "t")))
FORMULA = Expression(FORMULA_NAMES, "an expression in t and quantities over time")
"""A formula in the time and the numbers over time of a motion."""


VIEW = Key(
    vector(2),
    "direction of view: elevation above the x1 x2 plane, azimuth from x1",
    "degree",
    (24.0, 35.0),
)


def _rising(ends: tuple[float, ...]) -> tuple[float, ...]:
    """The two ends themselves. Raises Wrong unless the first is the lower one."""
    if not ends[0] < ends[1]:
        raise Wrong(((), f"expected the lower end first, got {ends[0]:g}, {ends[1]:g}"))
    return ends


INTERVAL = ListOf(Number(), length=2, title="2 numbers", convert=_rising)

LOOK = {
    "width": Key(
        Either(Choice("column", "page"), Number(least=20, most=1000)),
        "width of the figure: `column` (84 mm), `page` (174 mm), or a number",
        "mm",
        None,
    ),
    "height": Key(Number(least=20, most=1000), "height of the figure", "mm", None),
    "rc": Key(Mapped(), "parameters of matplotlib: `{font.size: 10}`", default=None),
    "axes": Key(
        Mapped(),
        "what each panel is set to, by matplotlib's names: `{xlim: [0, 1], yscale: log}`",
        default=None,
    ),
}
"""The style of all figures of a file, or of one."""

STYLE = Table(LOOK, definition="style")

LABELLED = {
    "labels": Key(
        NAMES, "names of the cases in the legend, in their order (default: their own)", default=()
    ),
    "title": Key(
        Text(),
        "short title above the panels, so that a picture alone says what it shows",
        default="",
    ),
    "caption": Key(
        Text(), "what the figure shows; assumptions and misprints of its cases", default=""
    ),
    "style": Key(STYLE, "look of the figure, besides the file's `style`", default=None),
}
OF_CASES = {"cases": Key(NAMES, "cases to draw, in this order")} | LABELLED
STYLED = OF_CASES | {
    "styles": Key(
        NAMES,
        "colour and line of each case, such as `red`, `blue dashed` or `grey dotted`, in their "
        "order (default: a palette)",
        default=(),
    ),
}
TIME_KEYS = {
    "time": Key(
        Text(),
        r"symbol of time, in TeX (default: t where time has a unit and is not slow, else \tau)",
        default=None,
    ),
}

COLOUR = "what the colour of the curve shows; the axis is known once `hodo classify` has run"
ZOOM = "adds a panel that shows the neighbourhood of the origin up to this size"

SOME_NAMES = ListOf(Text(), alone=True, title="a name or a list of names")

INSET = Table(
    {
        "panel": Key(Text(), "panel that holds it: a variable or, with `panels: case`, a case"),
        "case": Key(Text(), "case drawn in it"),
        "variables": Key(SOME_NAMES, "variables drawn in it"),
        "span": Key(INTERVAL, "part of the time axis drawn (default: all)", "time", None),
        "box": Key(
            vector(4),
            "left, bottom, width, height within the panel, as fractions",
            default=(0.5, 0.5, 0.46, 0.38),
        ),
    }
)

SPHERE = {
    "colour": Key(Choice("axis", "time", "case"), COLOUR, default="case"),
    "view": VIEW,
}

SWEPT_VARIABLE = Key(
    Text(),
    "variable of the sweep, a component (`share.x1`), or the share of a label "
    "(`end_axis.x1`); averaged over the axes that are not drawn",
)

FIGURE_KINDS: dict[str, dict[str, Rule]] = {
    "hodograph": STYLED
    | TIME_KEYS
    | {
        "colour": Key(Choice("axis", "time", "case"), COLOUR, default="axis"),
        "view": VIEW,
        "projections": Key(
            ListOf(Choice("x1x2", "x1x3", "x2x3"), least=0),
            "planes onto which the curve is projected, a panel each",
            default=(),
        ),
        "zoom": Key(Number(above=0), ZOOM, "moment of inertia / time", None),
    },
    "sphere": STYLED
    | TIME_KEYS
    | SPHERE
    | {
        "ellipsoid": Key(
            Switch("yes", "no"),
            "draw omega on the ellipsoid of inertia, whose curves of free motion are polhodes",
            default=False,
        ),
    },
    "herpolhode": STYLED
    | TIME_KEYS
    | {"colour": Key(Choice("axis", "time", "case"), COLOUR, default="case")},
    "axis-trace": STYLED
    | TIME_KEYS
    | SPHERE
    | {
        "axes": Key(
            ListOf(Choice("x1", "x2", "x3")), "axes of the body, a curve each", default=("x3",)
        ),
    },
    "body": OF_CASES
    | TIME_KEYS
    | {
        "view": VIEW,
        "moments": Key(
            ListOf(Number(), least=0),
            "times that are printed, a panel each, at the sample next to each (default: start, "
            "middle and end)",
            "time",
            (),
        ),
        "span": Key(INTERVAL, "part of the time axis to show (default: all)", "time", None),
        "seconds": Key(Number(above=0, most=600), "how long the film lasts", "s", 20.0),
    },
    "quadrants": OF_CASES
    | TIME_KEYS
    | {
        "scale_with": Key(
            NAMES, "figures of this file that share one scale with this one", default=()
        ),
        "zoom": Key(Number(above=0), ZOOM, "1/time^2", None),
    },
    "quadrant-sketch": {
        "bodies": Key(
            ListOf(vector(3, above=0)), "principal moments of inertia of each body, a panel each"
        ),
    }
    | LABELLED
    | {
        "labels": Key(NAMES, "title of each panel, in the order of `bodies`", default=()),
    },
    "series": STYLED
    | TIME_KEYS
    | {
        "variables": Key(
            SOME_NAMES, "variables of the result, components such as `omega.x1`, or `D/2T`"
        ),
        "panels": Key(
            Choice("variable", "case"),
            "one panel a variable, or one panel a case",
            default="variable",
        ),
        "columns": Key(
            Integer(least=1, most=6),
            "panels in a row, fewer where each has less than 40 mm",
            default=2,
        ),
        "span": Key(INTERVAL, "part of the time axis to draw (default: all)", "time", None),
        "level": Key(Number(), "draws a horizontal line at this value", default=None),
        "formula": Key(
            Each(FORMULA, "variables to formulas", least=0),
            "laws to compare curves with, drawn dashed: `{G: 0.9*exp(-0.004*t)}`",
            default={},
        ),
        "insets": Key(ListOf(INSET, least=0), "enlargements inside panels", default=()),
    },
    "phase": STYLED
    | TIME_KEYS
    | {
        "x": Key(Text(), "variable on the horizontal axis, named as in a series"),
        "y": Key(Text(), "variable on the vertical axis"),
    },
    "invariants": STYLED | TIME_KEYS,
    "map": {
        "cases": Key(NAMES, "sweeps to draw, a row of panels each"),
    }
    | LABELLED
    | {
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
            ListOf(Integer(least=0), least=0),
            "positions on that axis, counted from zero (default: all)",
            default=(),
        ),
        "range": Key(
            INTERVAL,
            "ends of the colour scale (default: the least and the largest value)",
            default=None,
        ),
        "level": Key(Number(), "over two axes: draws the contour of this value", default=None),
        "theory": Key(
            Choice("turning"),
            "turning: over two axes, draws where fluid and damping balance on the mean at the "
            "start, so that the sense of crossings turns there",
            default=None,
        ),
    },
    "curve": {
        "cases": Key(NAMES, "sweeps to draw, each a curve or a curve an entry of `by`"),
    }
    | LABELLED
    | {
        "variable": SWEPT_VARIABLE,
        "x": Key(Text(), "axis of the sweep on the horizontal axis"),
        "by": Key(Text(), "axis of the sweep; each of its values has a curve", default=None),
        "at": Key(
            ListOf(Integer(least=0), least=0),
            "positions on `by`, counted from zero (default: all)",
            default=(),
        ),
        "level": Key(Number(), "draws a horizontal line at this value", default=None),
    },
}
"""The keys of each kind of figure, besides `kind`."""

FIGURE = Variant("kind", FIGURE_KINDS, "what is drawn")


def merged_style(*styles: Mapping[str, Any] | None) -> dict[str, Any]:
    """The keys that several styles set; a later style overrides the earlier ones."""
    given = (style for style in styles if style)
    return {k: value for style in given for k, value in style.items() if value is not None}
