"""The keys of case files: the keys that every case takes, and the sections of a file."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

from .. import models
from ..models.attitude import keys_of_form
from ..models.base import Model
from ..schema.kinds import (
    NAMES,
    Choice,
    Each,
    Integer,
    Key,
    ListOf,
    Mapped,
    Mistake,
    Number,
    Rule,
    Switch,
    Table,
    Text,
    Wrong,
)
from . import claim_block, figure_block
from .sweep_block import SWEEP

SCIPY_METHODS = ("DOP853", "RK45", "LSODA", "Radau", "BDF")

METHODS = ("auto", "taylor", "collocation", *SCIPY_METHODS, "exact", "quadrature")

METHOD_PRECISIONS = {
    **dict.fromkeys(("auto", "taylor"), ("double", "extended", "quadruple")),
    **dict.fromkeys(("collocation", "exact", "quadrature"), ("double", "extended")),
}
"""The precisions of methods; the others have double precision alone."""


def wrong_precision(method: str, precision: str) -> str:
    """Why a method cannot integrate in a precision; an empty string if it can."""
    if precision in (known := METHOD_PRECISIONS.get(method, ("double",))):
        return ""
    return f"method {method} works in {' and '.join(known)} precision only, not {precision}"


def finds_no_stop(method: str, system: Model) -> str:
    """Why a method cannot integrate a model, whose events it would miss; an empty string if it
    can."""
    if method in SCIPY_METHODS and system.run_events:
        return f"{method} finds no stop: method auto, taylor or collocation"
    return ""


NO_CLOSED_FORM = (
    "method exact needs torques along G: equal damping, a brake, or both, all constant; "
    "and none with an attitude"
)

NO_RATES = "form averaged is a quadrature: leave out method and precision"

FORMER_KEYS = {
    "mean_start": "averaged motions begin at the start itself, to first order: leave it out",
}
"""Keys that earlier versions took, and what to do instead."""

REPLACED_TIMES = {"values": {"end", "samples"}, "end": {"values"}, "samples": {"values"}}
"""The keys of `time:` that a change of another key replaces: samples are either listed or evenly
spaced."""


def drop_replaced_times(time: dict[str, Any], given: Mapping[str, Any]) -> None:
    """Remove the keys of `time:` that the keys given now replace."""
    changed = [name for name, value in given.items() if value is not None]
    replaced = {key for name in changed for key in REPLACED_TIMES.get(name, ())}
    for key in replaced - given.keys():
        time.pop(key, None)


def _time_span(time: dict[str, Any]) -> dict[str, Any]:
    """The keys of `time:`. Times that are listed set `end` and `samples`."""
    if mistakes := [*_time_mistakes(time)]:
        raise Wrong(*mistakes)
    listed = time["values"]
    return time | {"end": listed[-1], "samples": len(listed)} if listed else time


def _time_mistakes(time: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes that several keys of `time:` make together: a missing end, a span that is not a
    double, listed times that turn back, or an end given with listed times."""
    values, start, end = time["values"] or (), time["start"], time["end"]
    if values:
        yield from _order_mistakes(start, values)
        if idle := [name for name in ("end", "samples") if time[name] is not None]:
            yield (idle[0],), "leave it out where values: gives the times"
    elif end is None:
        yield (), "missing 'end'"
    elif not math.isfinite(end - start):
        yield ("end",), f"the span from {start:g} to {end:g} is not possible"
    elif (time["samples"] or 1) > (most := most_samples(start, end)):
        words = f"expected at most {most}, by the doubles from start to end"
        yield ("samples",), f"{words}, got {time['samples']}"


def _order_mistakes(start: float, values: Sequence[float]) -> Iterator[Mistake]:
    """The mistakes of listed times, which must all rise from the start, or all fall from it."""
    sign = -1 if values[-1] < start else 1
    side, other = ("after", "before")[::sign]
    if sign * values[0] < sign * start:
        yield ("values", 0), f"expected no time {other} start, {start:g}, got {values[0]:g}"
    for i, (last, time) in enumerate(pairwise(values), 1):
        if sign * time <= sign * last:
            yield ("values", i), f"expected a time {side} {last:g}, got {time:g}"


def most_samples(start: float, end: float) -> float:
    """How many samples of a span can be different doubles; infinite if the end is the start, where
    all samples are one time."""
    # Times two doubles apart are never rounded to the same double.
    grain = 2 * math.ulp(max(abs(start), abs(end)))
    return max(2, int(abs(end - start) / grain) + 1) if start != end else math.inf


def _time_answer(value: Any) -> str:
    """What to write instead of a `time:` that is the end alone, or start and end."""
    match value:
        case int() | float():
            return f"; write {{end: {value:g}}}"
        case [int() | float() as start, int() | float() as end]:
            return f"; write {{start: {start:g}, end: {end:g}}}"
    return ""


SPAN = Table(
    {
        "start": Key(Number(), "time of the initial data", "time", 0.0),
        "end": Key(
            Number(),
            "time at which the integration ends; before start it runs backward (required without "
            "values)",
            "time",
            None,
        ),
        "samples": Key(
            Integer(least=1, most=10**15),
            "number of stored times, evenly spaced from start to end; 1 stores the end alone, as "
            "does an end at the start (default: enough for a smooth figure of the body's turns, "
            "1001 to 50001; a torque that changes faster needs more)",
            default=None,
        ),
        "values": Key(
            ListOf(Number()),
            "instead of end and samples: the stored times, all rising from start, or falling",
            "time",
            None,
        ),
        "epoch": Key(
            Number(),
            "the time from which t counts in expressions and polynomials (default: 0)",
            "time",
            None,
        ),
        "unit": Key(Text(), "unit of time, where the data have one", default="1"),
    },
    convert=_time_span,
    answer=_time_answer,
)

MERGED_KEYS = ("time", "assumes", "constants")
"""The keys whose entries a case changes one by one, and otherwise inherits from the defaults."""

REMARKS = ("note", "assumes")
"""The keys that describe a case and change none of its numbers."""

COMMON = {
    "time": Key(SPAN, "span of the integration, and its samples"),
    "inertia_unit": Key(
        Text(), "unit of the moments of inertia, where the data have one", default="1"
    ),
    "method": Key(
        Choice(*METHODS),
        "method of integration; auto takes the fastest that is accurate",
        default="auto",
    ),
    "tol": Key(
        Number(above=0, below=1),
        "tolerance relative to max|omega| (default: 1e-9 for RK45, LSODA, Radau and BDF, "
        "1e-12 for DOP853, else the limit of the precision)",
        default=None,
    ),
    "precision": Key(
        Choice("double", "extended", "quadruple"), "working precision", default="double"
    ),
    "error": Key(
        Switch("on", "off"),
        "on: the error is measured against a finer integration",
        default=True,
    ),
    "store": Key(NAMES, "variables to store, instead of the whole state", default=()),
    "max_seconds": Key(
        Number(above=0),
        "seconds of the clock, without compilation, after which the case stops, unfinished; "
        "measuring its error may take as long again",
        "s",
        None,
    ),
    "max_steps": Key(
        Integer(least=1, most=10**15),
        "number of steps after which the case stops, unfinished; if left out, 1e7 of taylor, "
        "1e5 of collocation, 1e6 of the others",
        default=None,
    ),
    "note": Key(Text(), "remark to be stored with the results", default=""),
    "assumes": Key(
        Each(Text(least=1), "names to texts", least=0),
        "what the case takes that its source does not print",
        default={},
    ),
    "sweep": Key(
        SWEEP, "ranges of numeric keys: the case becomes a grid or an ensemble", default=None
    ),
}
"""The keys that a case of any model takes besides `model` and `form`."""


BENCH = Table(
    {
        "methods": Key(ListOf(Choice(*METHODS)), "methods to compare"),
        "tols": Key(
            ListOf(Number(above=0, below=1), least=0),
            "tolerances (default: each method's own)",
            default=(),
        ),
        "repeats": Key(
            Integer(least=1, most=1000),
            "least number of runs of each; the least of their times counts",
            default=3,
        ),
        "max_seconds": Key(
            Number(above=0), "run time after which a method stops, unfinished", "s", 10.0
        ),
    }
)

SECTIONS = {
    "title": Key(Text(), "title of the config", default=""),
    "references": Key(Text(), "where its cases come from", default=""),
    "defaults": Key(
        Mapped(),
        "values for every case that takes the key, unless the case gives it or removes it by "
        "`null`; `time`, `assumes` and `constants` are merged key by key",
        default=None,
    ),
    "cases": Key(Mapped(), "the experiments, by name"),
    "figures": Key(Mapped(), "what `hodo plot` draws, by name", default=None),
    "style": Key(figure_block.STYLE, "look of all figures", default=None),
    "bench": Key(BENCH, "what `hodo bench` tries on every case", default=None),
    "claims": Key(
        ListOf(Table(claim_block.CLAIM), least=0, title="a list of statements (`- id: ...`)"),
        "statements that `hodo claims` checks",
        default=(),
    ),
    "errata": Key(
        ListOf(Table(claim_block.ERRATUM_KEYS), least=0, title="a list of misprints (`- id: ...`)"),
        "misprints of the source, each with a check of it and of its correction",
        default=(),
    ),
}


def _own_model(name: Any) -> str:
    """The end of a message about an unknown model: how to name the file of a user's own model."""
    how = "hodo --models FILE.py ..., in Python HODO_MODELS=FILE.py before it starts"
    return f" (from a file of your own: {how})" if isinstance(name, str) else ""


@cache
def keys_of(model: str | None, form: str | None) -> tuple[type[Model] | None, dict[str, Rule]]:
    """The class of a model's form (None: the first form) and every key of its cases; None for the
    class if there is no such form."""
    forms = models.forms_of(model or "")
    first = next(iter(forms), "")
    names = Choice(*models.model_names()) | {"answer": _own_model}
    head = {"model": Key(names, "equations of motion")}
    if forms:
        head["form"] = Key(Choice(*forms), "form of the equations", default=first)
    form_class = forms.get(first if form is None else form)
    return form_class, head | (keys_of_form(form_class) if form_class else {}) | COMMON


def keys_in(block: Mapping[str, Any]) -> tuple[type[Model] | None, dict[str, Rule]]:
    """`keys_of` for the model and form that a case names, whether they exist or not."""
    model, form = block.get("model"), block.get("form")
    return keys_of(
        model if isinstance(model, str) else None,
        form if form is None or isinstance(form, str) else "",
    )


@cache
def all_keys() -> frozenset[str]:
    """Every key that a case of any model takes."""
    classes = [form for forms in models.catalogue().values() for form in forms.values()]
    return frozenset({"model", "form", *COMMON}.union(*(keys_of_form(form) for form in classes)))
