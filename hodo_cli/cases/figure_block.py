"""What each kind of figure takes: the keys of an entry in a case file's `figures:` block, besides
`kind`."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ..models import rigid_body
from ..models.theory.principal_axes import one_exceeds_others
from ..schema.expression import Expression, names_in, parse_expression
from ..schema.kinds import (
    NAMES,
    Choice,
    Each,
    Either,
    Integer,
    Key,
    KeyPath,
    ListOf,
    Mistake,
    Number,
    Switch,
    Table,
    Text,
    Variant,
    Wrong,
    WrongKey,
    expected,
    mistakes_where,
    unknown_names,
    vector,
)
from ..schema.spelling import unknown
from ..text import case_words
from .derived import (
    DERIVED,
    OVER_TIME,
    PARTS,
    component_names,
    constants_of,
    derivable_numbers,
    lack_of,
    missing,
)
from .sweep_block import AXIS_LABELS

PAGE_DATA = "page.json"
"""The data of a result for the page, in the folder of its figures."""

FILM_FORMATS = ("gif", "mp4")
"""The formats of a figure that moves."""


@dataclass(frozen=True)
class DrawnFigure:
    """A figure as it was drawn: its files or why there are none, the cases that it has asked for,
    and the warnings that it gave."""

    name: str
    files: tuple[Path, ...] = ()
    problem: str = ""
    cases: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


FORMULA = Expression(
    ("t", *(name for name in OVER_TIME if name not in ("D/2T", "t"))),
    title="an expression in t and quantities over time",
)
"""A formula in the time and the numbers over time of a motion."""


def quantities_in(formula: str) -> set[str]:
    """The variables of a motion that a formula contains, besides the time."""
    return names_in(parse_expression(formula, FORMULA.names)) - {"t"}


COLOUR_NAMES = ("blue", "orange", "green", "sky", "red", "purple", "black", "grey")
LINE_NAMES = ("solid", "dashed", "dotted")
"""The words of a style; the drawing says how each looks."""

VIEW = Key(
    vector(2),
    "direction of view: elevation above the x1 x2 plane, azimuth from x1",
    "degree",
    (24.0, 35.0),
)


@dataclass(frozen=True)
class Interval(ListOf):
    """Two numbers, the lower one first."""

    def check(self, value: Any) -> tuple[Any, ...]:
        ends = super().check(value)
        if not ends[0] < ends[1]:
            raise Wrong(((), f"expected the lower end first, got {ends[0]:g}, {ends[1]:g}"))
        return ends


INTERVAL = Interval(Number(), length=2, title="2 numbers")


class StyleSheet(Text):
    """The name of one of matplotlib's style sheets, or the path of one; no address elsewhere."""

    def check(self, value: Any) -> str:
        name = super().check(value)
        is_path = name.endswith(".mplstyle") and "://" not in name
        if is_path or name.replace("-", "_").isidentifier():
            return name
        raise expected(self, value)

    def __str__(self) -> str:
        return "the name of a style sheet of matplotlib, or a file *.mplstyle"


LOOK = {
    "width": Key(
        Either(Choice("column", "page"), Number(least=20, most=1000)),
        "width of the figure: `column` (84 mm), `page` (174 mm, two columns), or a number",
        "mm",
        None,
    ),
    "height": Key(
        Number(least=20, most=1000), "height of the figure (default: by its width)", "mm", None
    ),
    "font": Key(
        Text(),
        "family of the letters: an installed one, `serif`, `sans-serif` or `monospace` "
        "(default: STIX)",
        default=None,
    ),
    "font_size": Key(
        Number(least=3, most=72),
        "size of labels and titles; ticks and legend are a sixth smaller (default: 8.4)",
        "pt",
        None,
    ),
    "line_width": Key(
        Number(above=0, most=20),
        "width of curves; long hodographs are drawn thinner (default: 1)",
        "pt",
        None,
    ),
    "legend": Key(
        Choice(
            *("below", "right", "inside", "none"),
            *("upper left", "upper right", "lower left", "lower right"),
        ),
        "where the legend stands: below the panels, right of them where each keeps 40 mm, or "
        "within the first (default: below)",
        default=None,
    ),
    "letters": Key(
        Switch("yes", "no"),
        "letter the panels (a), (b), ... where there are several (default: no)",
        default=None,
    ),
    "svg_text": Key(
        Switch("yes", "no"),
        "keep text in SVG as text, which an editor can change (default: no)",
        default=None,
    ),
    "sheet": Key(
        StyleSheet(),
        "style sheet of matplotlib: its name, or its path from the folder of the case file",
        default=None,
    ),
}
"""The style of all figures of a file, or of one."""

SCALES = {
    "log": Key(ListOf(Choice("x", "y"), alone=True), "the axes that are logarithmic", default=None),
    "xlim": Key(INTERVAL, "left and right end of each panel", default=None),
    "ylim": Key(INTERVAL, "lower and upper end of each panel", default=None),
    "xlabel": Key(Text(), "label of the horizontal axis, its formulas in TeX", default=None),
    "ylabel": Key(Text(), "label of the vertical axis", default=None),
}
"""The style of one figure whose panels have scales."""

KINDS_WITHOUT_SCALES = ("hodograph", "sphere", "axis-trace", "body", "quadrant-sketch")

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
    "style": Key(
        Table(LOOK | SCALES), "look of the figure, besides the file's `style`", default=None
    ),
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

SOME_NAMES = ListOf(Text(), alone=True, title=NAMES.title)

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

FIGURE_KINDS: dict[str, dict[str, Key]] = {
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
    "sphere": STYLED | TIME_KEYS | SPHERE,
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
        "passages": Key(
            Switch("yes", "no"),
            "mark crossings of the separatrix",
            default=False,
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
    """The keys of several styles that are set; a later style counts before the earlier ones."""
    given = (style for style in styles if style)
    return {k: value for style in given for k, value in style.items() if value is not None}


def check_figure(values: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes in keys of a figure that are each right by themselves."""
    kind = values.get("kind")
    yield from _count_mistakes(values)
    axis = _axis_of_positions(values)
    if values.get("at") and not values.get(axis):
        yield ("at",), f"counts positions on the axis that '{axis}' names, which is missing"
    for i, words in enumerate(values.get("styles", ())):
        colour, _, line = words.partition(" ")
        yield from unknown_names("colour or line", {("styles", i): colour}, COLOUR_NAMES)
        yield from unknown_names("colour or line", {("styles", i): line or "solid"}, LINE_NAMES)
    formulas: dict[KeyPath, str] = {("formula", WrongKey(x)): x for x in values.get("formula", ())}
    yield from unknown_names("variable", formulas, values.get("variables", ()))
    for i, moments in enumerate(values.get("bodies", ())):
        if one_exceeds_others(moments):
            yield ("bodies", i), "no body has a moment larger than the sum of the other two"
        if min(moments) == max(moments):
            yield ("bodies", i), "a body with three equal moments of inertia has no quadrants"
    for i, inset in enumerate(values.get("insets", ())):
        if min(inset["box"][2:]) <= 0:
            yield ("insets", i, "box"), "expected a positive width and height"
    has_scales = kind not in KINDS_WITHOUT_SCALES and not _is_map_of_sphere(values)
    yield from _scale_mistakes(kind, values.get("style") or {}, has_scales)
    if kind in SWEPT_KINDS:
        yield from _axis_mistakes(values)


def _count_mistakes(values: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes of lists in which each case, or each body of a sketch, has an entry."""
    kind = values.get("kind")
    named = "bodies" if kind == "quadrant-sketch" else "cases"
    count, labels = len(values.get(named, ())), values.get("labels", ())
    styles = values.get("styles", ())
    curves = count * (len(values.get("axes", ())) if kind == "axis-trace" else 1)
    yield from mistakes_where(
        # The labels of a sweep name panels or curves, whose number its axes decide.
        (
            kind not in ("map", "curve") and len(labels) > count,
            ("labels",),
            f"expected one for each of the {named}, {count} in all, got {len(labels)}",
        ),
        (
            0 < curves < len(styles),
            ("styles",),
            f"expected {curves} at most, one for each line, got {len(styles)}",
        ),
        (
            kind == "body" and count > 1,
            ("cases",),
            f"expected one case, whose body moves, got {count}",
        ),
    )


def _scale_mistakes(
    kind: str | None, style: Mapping[str, Any], has_scales: bool
) -> Iterator[Mistake]:
    """The mistakes in the style of the scales of a figure's panels."""
    if not has_scales:
        given = (key for key in SCALES if style.get(key) is not None)
        yield from ((("style", key), f"the panels of a {kind} have no scales") for key in given)
    if kind == "quadrants" and len({*(style.get("log") or ())}) == 1:
        yield ("style", "log"), "expected both x and y: else no straight line divides the quadrants"
    logarithmic = [f"{axis}lim" for axis in style.get("log") or ()]
    yield from (
        (("style", key), "expected positive ends of a logarithmic axis")
        for key in logarithmic
        if (ends := style.get(key)) and ends[0] <= 0
    )


@dataclass(frozen=True)
class Drawable:
    """The properties of a case on which figures rest, known before it is run and from its dataset:
    its name, the case, its variables with the dimension of their components (empty for a number),
    its first and last time, its units of time and of moments of inertia, the lengths of a sweep's
    axes and which of them is a sphere."""

    name: str
    case: Any
    variables: Mapping[str, str]
    times: tuple[float, float]
    units: Mapping[str, str]
    axes: Mapping[str, int]
    sphere: str

    @cached_property
    def sources(self) -> set[str]:
        """The variables and constants that it has for quantities to follow from."""
        return {*self.variables, *constants_of(self.case.system, self.case.data)}


SWEPT_KINDS = ("map", "curve")
"""The kinds that draw sweeps."""

AXIS_KEYS = ("x", "y", "by", "panels")
"""The keys that name axes of a sweep."""

KINDS_OF_BODIES = ("hodograph", "sphere", "quadrants", "invariants")
"""The kinds that draw what follows from the angular velocity in body axes."""

KINDS_IN_SPACE = {"herpolhode": "G_space", "axis-trace": "x1_space", "body": "G_space"}
"""The kinds that draw where the body points, and what they need."""


def check_drawn(
    values: Mapping[str, Any], cases: Mapping[str, Drawable], with_sizes: bool
) -> Iterator[Mistake]:
    """The mistakes that keep a figure from drawing its cases: one set of rules, for a case file as
    it is read and for datasets as they are drawn.

    Without `with_sizes` no figure is wrong by the times of cases and the lengths of axes, which are
    others in a run with `--set`.
    """
    kind, drawn = values.get("kind"), [cases[name] for name in values.get("cases", ())]
    unfit: list[Mistake] = [
        (("cases", i), message) for i, case in enumerate(drawn) if (message := _unfit(kind, case))
    ]
    if unfit:
        yield from unfit
        return
    for i, case in enumerate(drawn):
        for what, unit in case.units.items():
            if unit != (first := drawn[0].units[what]):
                message = f"the unit of {what} is {first!r} in {drawn[0].name}, and {unit!r} in"
                yield ("cases", i), f"{message} {case.name}: one axis has one unit"
    if kind in SWEPT_KINDS:
        for case in drawn:
            yield from _swept_mistakes(values, case, with_sizes)
        return
    yield from _variable_mistakes(values, drawn)
    yield from _inset_mistakes(values)
    if with_sizes:
        yield from _span_mistakes(values, cases)


def _unfit(kind: str | None, case: Drawable) -> str:
    """Why a kind of figure cannot draw a case; an empty string if it can."""
    is_swept, words = kind in SWEPT_KINDS, case_words(case.name)
    if is_swept and not case.axes:
        return f"{words} is no sweep"
    if case.axes and not is_swept:
        *kinds, last = SWEPT_KINDS
        return f"{words} is a sweep, which only {', '.join(kinds)} and {last} draw"
    if kind in KINDS_IN_SPACE:
        return lack_of(case.case, KINDS_IN_SPACE[kind], case.sources, kind)
    if kind not in KINDS_OF_BODIES or case.variables.get("omega") == "axis":
        return ""
    if case.case.leaves_out(["omega"]):
        return lack_of(case.case, "omega", case.sources, kind)
    return f"{words} stores no angular velocity in body axes, which kind {kind} needs"


def _variable_mistakes(values: Mapping[str, Any], cases: Sequence[Drawable]) -> Iterator[Mistake]:
    """A mistake for each variable that motions cannot have, about the first of its cases."""
    drawn: list[tuple[KeyPath, str, Sequence[Drawable]]] = [
        (("variables", i), name, cases) for i, name in enumerate(values.get("variables", ()))
    ]
    drawn += [
        (("formula", of), name, cases)
        for of, formula in values.get("formula", {}).items()
        for name in sorted(quantities_in(formula))
    ]
    if values.get("kind") == "phase":
        drawn += [((key,), values[key], cases) for key in ("x", "y") if key in values]
    drawn += [
        (("insets", i, "variables", j), name, [x for x in cases if x.name == inset["case"]])
        for i, inset in enumerate(values.get("insets", ()))
        for j, name in enumerate(inset["variables"])
    ]
    for path, name, owners in drawn:
        if message := next(filter(None, (_wrong_variable(name, case) for case in owners)), ""):
            yield path, message


def _wrong_variable(name: str, case: Drawable) -> str:
    """Why a name stands for no number that a case stores, or that is derived from it; an empty
    string if it does. A vector needs a component, and a number has none."""
    base, _, component = name.partition(".")
    # As it is stored, and as it is derived: `G` is a vector and a number.
    dims = [case.variables[base]] if base in case.variables else []
    if base in DERIVED and not missing(base, case.sources):
        dims.append(DERIVED[base].dim)
    if any(name in component_names(base, dim) for dim in dims):
        return ""
    if not dims and (base in DERIVED or base in case.case.system.variables):
        return lack_of(case.case, base, case.sources, name)
    if not dims:
        valid = dict.fromkeys([*derivable_numbers(case.sources), *case.variables])
        return unknown(f"variable {name!r} of {case_words(case.name)}", base, list(valid))
    if not (dim := next(filter(None, dims), "")):
        return f"{base} is no vector, and has no component {component!r}"
    if not component:
        return f"{base} is a vector: name a component, {', '.join(component_names(base, dim))}"
    return unknown(f"component {component!r} of {base}", component, PARTS[dim])


def _inset_mistakes(values: Mapping[str, Any]) -> Iterator[Mistake]:
    """A mistake for each panel and case that an inset names and its figure does not have."""
    panels = "cases" if values.get("panels") == "case" else "variables"
    # Of a key that is missing or wrong, which is a mistake by itself, no name can be unknown.
    known = {"panel": values.get(panels), "case": values.get("cases")}
    for i, inset in enumerate(values.get("insets", ())):
        for key, valid in known.items():
            named: dict[KeyPath, str] = {("insets", i, key): inset[key]}
            yield from () if valid is None else unknown_names(key, named, valid)


def _span_mistakes(values: Mapping[str, Any], cases: Mapping[str, Drawable]) -> Iterator[Mistake]:
    """A mistake for each span or moment that lies outside the times of a case drawn over it."""
    spans: list[tuple[KeyPath, Any, str]] = [
        *((("span",), values.get("span"), name) for name in values.get("cases", ())),
        *(
            (("insets", i, "span"), inset["span"], inset["case"])
            for i, inset in enumerate(values.get("insets", ()))
        ),
    ]
    for path, span, name in spans:
        start, end = cases[name].times if name in cases else (-math.inf, math.inf)
        low, high = span or (-math.inf, math.inf)
        first, last = max(start, low), min(end, high)
        if first > last:
            yield path, f"holds no time of {case_words(name)}, which goes from {start:g} to {end:g}"
        shown = f"{case_words(name)}, shown from {first:g} to {last:g}"
        yield from (
            (("moments", i), f"{moment:g} is no time of {shown}")
            for i, moment in enumerate(values.get("moments", ()))
            if not first <= moment <= last
        )


def _swept_mistakes(
    values: Mapping[str, Any], case: Drawable, with_sizes: bool
) -> Iterator[Mistake]:
    """A mistake for each variable, axis and position that a sweep does not have."""
    if message := _wrong_swept_variable(values, case):
        yield ("variable",), message
    for key in AXIS_KEYS:
        if (name := values.get(key)) is not None and name == case.sphere:
            yield (key,), f"axis {name} of sweep {case.name} is a sphere, which has no scale"
        elif name is not None and name not in case.axes:
            yield (key,), unknown(f"axis {name!r} of sweep {case.name}", name, list(case.axes))
    if _is_map_of_sphere(values) and not case.sphere:
        yield (), f"sweep {case.name} has no sphere: name the axes x and y"
    counted = values.get(_axis_of_positions(values)) or ""
    size = case.axes.get(counted, math.inf) if with_sizes else math.inf
    message = f"axis {counted} of sweep {case.name} has positions 0 to {size - 1}"
    yield from (
        (("at", i), f"{message}, not {position}")
        for i, position in enumerate(values.get("at", ()))
        if position >= size
    )


def _wrong_swept_variable(values: Mapping[str, Any], case: Drawable) -> str:
    """Why a figure's variable is one that a sweep lacks, or not a number; an empty string if it is
    right, or wrong by itself."""
    base, dot, label = (name := values.get("variable", "")).partition(".")
    if base not in {*AXIS_LABELS} & {*case.variables}:
        return _wrong_variable(name, case) if name else ""
    is_mean = bool(dot or averaged(values, case.axes, case.sphere))
    if not is_mean or label in rigid_body.LABELS.values():
        return ""
    return (
        f"{base} is a label, without a mean: name the one whose share is to be drawn, "
        f"{', '.join(component_names(base, 'axis'))}"
    )


def averaged(values: Mapping[str, Any], axes: Iterable[str], sphere: str) -> list[str]:
    """The axes of a sweep over which a figure averages: those that it does not draw. A map without
    x draws `sphere`, the axis of directions."""
    drawn = {values.get(key) for key in AXIS_KEYS}
    if values.get("kind") == "map" and values.get("x") is None:
        drawn.add(sphere)
    return [name for name in axes if name not in drawn]


def _is_map_of_sphere(values: Mapping[str, Any]) -> bool:
    """Whether a figure is a map of the sphere."""
    return values.get("kind") == "map" and values.get("x") is None and values.get("y") is None


def _axis_of_positions(values: Mapping[str, Any]) -> str:
    """The key that names the axis on which `at` counts; an empty string for a kind without."""
    return {"map": "panels", "curve": "by"}.get(str(values.get("kind")), "")


def _axis_mistakes(values: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes of axes: one of a map is missing, or one is drawn twice."""
    given = {key: values[key] for key in AXIS_KEYS if values.get(key) is not None}
    if values["kind"] == "map" and len(pair := given.keys() & {"x", "y"}) == 1:
        (missing,) = {"x", "y"} - pair
        yield (), f"missing '{missing}': a map has x and y, or neither (it has {''.join(pair)})"
    firsts: dict[str, str] = {}
    for key, name in given.items():
        if (first := firsts.setdefault(name, key)) != key:
            yield (key,), f"{name} is the axis of '{first}' already"
