"""The keys of case files: those of every case, and the sections of a file."""

import math
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Any

from .. import models
from ..models.attitude import keys_of_form
from ..models.base import Model
from ..schema.document import Block
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
    Switch,
    Table,
    Text,
    Wrong,
    expected,
)
from ..schema.spelling import near
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
    """Why a method does not integrate in a precision; an empty string if it does."""
    if precision in (known := METHOD_PRECISIONS.get(method, ("double",))):
        return ""
    return f"method {method} works in {' and '.join(known)} precision only, not {precision}"


def finds_no_stop(method: str, system: Model) -> str:
    """Why a method does not integrate a model, which has events that it would pass; an empty string
    if it does."""
    if method in SCIPY_METHODS and system.run_events:
        return f"{method} finds no stop: method auto, taylor or collocation"
    return ""


NO_CLOSED_FORM = (
    "method exact needs torques along G: equal damping, a brake, or both, all constant; "
    "and none with an attitude"
)

NO_RATES = "form averaged is a quadrature: leave out method, precision and steps"

FORMER_KEYS = {
    "mean_start": "averaged motions begin at the start itself, to first order: leave it out",
}
"""Keys that earlier versions took, and what to do instead."""

REPLACED_TIMES = {
    "values": {"end", "samples", "steps"},
    "end": {"values"},
    "samples": {"values", "steps"},
    "steps": {"samples", "values"},
}
"""The keys of `time:` that do not count where one of the others is changed: samples are listed,
evenly spaced, or the steps of the method."""


def drop_replaced_times(time: dict[str, Any], given: Mapping[str, Any]) -> None:
    """Remove from the keys of `time:` those that do not count beside some that are given now."""
    told = [name for name, value in given.items() if value not in ("no", False, None)]
    for key in set().union(*(REPLACED_TIMES.get(name, ()) for name in told)) - given.keys():
        time.pop(key, None)


class TimeSpan(Table):
    """The keys of `time:`. Times that are listed set `end` and `samples`."""

    def check(self, value: Any) -> dict[str, Any]:
        time = super().check(value)
        if mistakes := [*_time_mistakes(time)]:
            raise Wrong(*mistakes)
        listed = time["values"]
        return time | {"end": listed[-1], "samples": len(listed)} if listed else time


def _time_mistakes(time: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes that several keys of `time:` make: an end that is missing, lies before the
    start, or so far behind it that the span is no double; stored times that do not rise, or stand
    beside an end."""
    values, start, end = time["values"] or (), time["start"], time["end"]
    for key, words in (("values", "values:"), ("steps", "steps: yes")):
        others = [name for name in ("end", "samples", "values") if name in REPLACED_TIMES[key]]
        if time[key] and (idle := [other for other in others if time[other] is not None]):
            yield (idle[0],), f"leave it out where {words} gives the times"
    yield from (
        (("values", i), f"expected a time after {before:g}, got {after:g}")
        for i, (before, after) in enumerate(pairwise(values), 1)
        if not before < after
    )
    if values and values[0] < start:
        yield ("values", 0), f"expected no time before start, {start:g}, got {values[0]:g}"
    if not values and end is None:
        yield (), "missing 'end'"
    if values or end is None:
        return
    if not 0 <= end - start < math.inf:
        yield ("end",), f"the span from {start:g} to {end:g} is not possible"
    elif (time["samples"] or 1) > (most := most_samples(start, end)):
        words = f"expected at most {most}, by the doubles from start to end"
        yield ("samples",), f"{words}, got {time['samples']}"


def most_samples(start: float, end: float) -> float:
    """How many samples of a span are different doubles; at an end at the start all are one."""
    # Of times that lie two doubles apart no two are rounded to one.
    grain = 2 * math.ulp(max(abs(start), abs(end)))
    return max(2, int((end - start) / grain) + 1) if start < end else math.inf


SPAN = TimeSpan(
    {
        "start": Key(Number(), "time of the initial data", "time", 0.0),
        "end": Key(
            Number(),
            "time at which the integration ends, not before start (required without values)",
            "time",
            None,
        ),
        "samples": Key(
            Integer(least=1, most=10**15),
            "number of stored times, evenly spaced from start to end; 1 stores the end alone, and "
            "so does an end at the start "
            "(default: so many that a figure of the motion is smooth, 1001 to 50001; they follow "
            "the turns of the body, not a torque that changes faster)",
            default=None,
        ),
        "values": Key(
            ListOf(Number()),
            "instead of end and samples: the stored times, rising, none before start",
            "time",
            None,
        ),
        "steps": Key(
            Switch("yes", "no"),
            "yes, instead of samples: the stored times are the steps that the method takes",
            default=False,
        ),
        "unit": Key(Text(), "unit of time, where the data have one", default="1"),
    }
)

REMARKS = ("note", "assumes")
"""The keys of a case that say something about it and change none of its numbers."""

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
        "seconds of integration, without compilation, after which the case stops, unfinished; "
        "the measurement of its error has as many again",
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
        "values for every case that takes the key, unless the case gives it or takes it back by "
        "`null`; `time` and `assumes` are merged key by key",
        default=None,
    ),
    "cases": Key(Mapped(), "the experiments, by name"),
    "figures": Key(Mapped(), "what `hodo plot` draws, by name", default=None),
    "style": Key(Table(figure_block.LOOK), "look of all figures", default=None),
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


class ModelName(Choice):
    """The name of a model."""

    def check(self, value: Any) -> Any:
        if isinstance(value, str) and value not in self.names and near(value, self.names) is None:
            how = "hodo --models FILE.py ..., in Python HODO_MODELS=FILE.py before it starts"
            raise expected(self, value, f" (from a file of your own: {how})")
        return super().check(value)


@cache
def keys_of(model: str | None, form: str | None) -> tuple[type[Model] | None, dict[str, Key]]:
    """The class of a model's form (None: the first) and every key of its cases; no class if there
    is no such form."""
    forms = models.forms_of(model or "")
    first = next(iter(forms), "")
    head = {"model": Key(ModelName(*models.model_names()), "equations of motion")}
    if forms:
        head["form"] = Key(Choice(*forms), "form of the equations", default=first)
    form_class = forms.get(first if form is None else form)
    return form_class, head | (keys_of_form(form_class) if form_class else {}) | COMMON


def keys_in(block: Block) -> tuple[type[Model] | None, dict[str, Key]]:
    """`keys_of` for the model and form that a case names, rightly or not."""
    model, form = block.get("model"), block.get("form")
    return keys_of(
        model if isinstance(model, str) else None,
        form if form is None or isinstance(form, str) else "",
    )


@cache
def all_keys() -> frozenset[str]:
    """Every key that a case of some model takes."""
    classes = [form for forms in models.catalogue().values() for form in forms.values()]
    return frozenset({"model", "form", *COMMON}.union(*(keys_of_form(form) for form in classes)))
