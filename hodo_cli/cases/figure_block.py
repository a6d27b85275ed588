"""What each kind of figure takes: the keys of an entry in a case file's `figures:` block, besides
`kind`."""

from ..schema.kinds import Choice, Integer, Key, Names, Number, Sequence, Table, Text, Vector

CASES = Key(Names(), "cases drawn, in this order")
LABELS = Key(
    Names(), "what the figure calls its cases, in their order (default: their names)", default=()
)
CAPTION = Key(
    Text(), "what the figure shows, and any assumption or misprint that its cases carry", default=""
)
TIME = Key(Text(), "symbol of time, in TeX", default=r"\tau")
VIEW = Key(
    Vector(2),
    "elevation above the x1 x2 plane and azimuth from x1 of the reader's eye",
    "degree",
    (24.0, 35.0),
)
COMMON = {"cases": CASES, "labels": LABELS, "caption": CAPTION, "time": TIME}
ZOOM_DOC = "draw a second panel, of the neighbourhood of the origin up to this size"

INSET = Table(
    {
        "panel": Key(
            Text(), "panel that holds the inset: a variable or, with `panels: case`, a case"
        ),
        "case": Key(Text(), "case drawn in the inset"),
        "variables": Key(Names(), "variables drawn in the inset"),
        "box": Key(
            Vector(4),
            "left, bottom, width, height within the panel, as fractions",
            default=(0.5, 0.5, 0.46, 0.38),
        ),
    }
)

KINDS: dict[str, dict[str, Key]] = {
    "hodograph": COMMON
    | {
        "colour": Key(Choice("axis", "time", "case"), "what the colour of the curve says", default="axis"),
        "view": VIEW,
        "projections": Key(
            Sequence(Choice("x1x2", "x1x3", "x2x3")), "planes onto which the curve is projected in panels beside it",
            default=(),
        ),
        "zoom": Key(Number(above=0), ZOOM_DOC, "moment of inertia / time", None),
    },
    "sphere": COMMON
    | {
        "colour": Key(Choice("axis", "time", "case"), "what the colour of the curve says", default="case"),
        "view": VIEW,
    },
    "quadrants": COMMON
    | {
        "scale_with": Key(Names(), "figures of this file whose cases set the scale together with this one's",
                          default=()),
        "zoom": Key(Number(above=0), ZOOM_DOC, "1/time^2", None),
    },
    "quadrant-sketch": {
        "bodies": Key(Sequence(Vector(3, above=0)), "principal moments of inertia of each body, one panel each"),
        "labels": Key(Names(), "title of each panel, in the order of `bodies`", default=()),
        "caption": CAPTION,
    },
    "series": COMMON
    | {
        "variables": Key(Names(), "variables of the dataset, components such as `omega.x1`, or `D/2T`"),
        "panels": Key(Choice("variable", "case"), "what each panel holds: one variable of every case, or one case",
                      default="variable"),
        "columns": Key(Integer(least=1, most=6), "panels in a row", default=2),
        "span": Key(Vector(2), "part of the time axis that is drawn (default: all)", "time", None),
        "level": Key(Number(), "a value that a horizontal line marks", default=None),
        "inset": Key(INSET, "an enlargement inside one panel", default=None),
    },
    "phase": COMMON
    | {
        "x": Key(Text(), "variable on the horizontal axis, named as in a series"),
        "y": Key(Text(), "variable on the vertical axis"),
    },
    "invariants": COMMON,
    "map": {
        "cases": Key(Names(), "sweeps drawn, a row of panels each"),
        "labels": LABELS,
        "caption": CAPTION,
        "variable": Key(Text(), "variable of the sweep, a component (`share.x1`), or the share of a label "
                        "(`end_axis.x1`); averaged over the axes that are not drawn"),
        "x": Key(Text(), "axis of the sweep on the horizontal axis (default, with y: an equal-area map of the sphere)",
                 default=None),
        "y": Key(Text(), "axis of the sweep on the vertical axis", default=None),
        "panels": Key(Text(), "axis of the sweep along which the panels stand", default=None),
        "at": Key(Sequence(Integer(least=0)), "positions on that axis, counted from zero (default: all)", default=()),
        "range": Key(Vector(2), "ends of the colour scale (default: those of the values)", default=None),
        "level": Key(Number(), "a value whose contour is drawn over two axes", default=None),
    },
}  # fmt: skip
