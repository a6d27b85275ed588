"""Two results, case by case and variable by variable: how far one is from the other, and where.

The first result is judged by the second, the reference. Values are compared where the reference has
them: it may be a thinned one. Its variables may carry tolerances of their own, as attributes `rtol`
and `atol`. There is one rule for each kind of variable, and one for each attribute that carries
meaning.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import HodoError
from ..cases.case import Case, parse_case
from ..engines.protocol import EPS
from ..integration import AUTOMATIC
from ..models import rigid_body
from ..results.layout import CROSSING_COLUMNS
from ..results.motion import check_whole
from ..storage import Group, ResultFile, Variable, open_run, typed
from ..text import magnitude, table
from .resume import check_cases, result_named, warn_of_changes

# How far values and attributes may be apart

# Looser than the results' 1e-12, so that another machine's compiler changes no verdict, and tighter
# than any figure shows.
RTOL = 1e-9
"""The relative tolerance of a variable that has none of its own."""

# A time is worse conditioned than the state: 20 to 30 times on Fig 4 of paper 1, up to 1,000 times
# on Fig 12, whose states agree far better than RTOL asks.
EVENT_CONDITION = 100.0
"""The factor by which the time of an event, and a value measured at that time, may be further off
than the state."""

EVENT_VARIABLES = ("event_time", "crossing_time", "crossing_G")
"""The variables to which `EVENT_CONDITION` applies."""

STATED_ERRORS = 10.0
"""A time may be off by so many times its stated error, which holds one compiler's rounding."""

ERROR_RATIO = 30.0
"""The factor by which errors of one method may differ from one compiler's rounding to another."""

LUCKY_ERROR = 8 * EPS
"""The largest relative error in place of which another machine may meet none at all."""

GIVEN_TOL = 4 * EPS
"""By how much times and swept data may be off, relative to the largest: by the order of two
roundings, since they are given and not integrated."""

SUBNORMAL = 2.0**-1060
"""A few thousand times the smallest double, below which a number has fewer digits than any
tolerance."""


@dataclass(frozen=True)
class Tolerance:
    """The difference that is allowed: atol + rtol |b|. None: the variable's own, or the default.
    Raises HodoError for a negative or infinite one."""

    rtol: float | None = None
    atol: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            # An infinite one would call all values equal, and nan none.
            if value is not None and not 0 <= value < math.inf:
                raise HodoError(f"--{name}: expected a number >= 0, got {value:g}")


class ReferenceValues(NamedTuple):
    """A variable of the reference, whose group is given, with the tolerance that was asked for."""

    name: str
    group: Group
    tolerance: Tolerance

    @property
    def variable(self) -> Variable:
        """The variable itself."""
        return self.group.variables[self.name]

    @property
    def size(self) -> np.ndarray:
        """|b|, and 0 where b is not finite."""
        b = self.variable.data
        return np.where(np.isfinite(b), np.abs(b), 0)

    def of_size(self, size: Any, condition: float = 1.0) -> np.ndarray:
        """atol + rtol size, by the tolerances asked for, or else the variable's own."""
        attrs, asked = self.variable.attrs, self.tolerance
        stated = float(attrs["rtol"]) if "rtol" in attrs else RTOL * condition
        rtol = stated if asked.rtol is None else asked.rtol * condition
        atol = float(attrs.get("atol", 0.0)) if asked.atol is None else asked.atol
        return np.asarray(atol + np.maximum(rtol * size, SUBNORMAL))


def equal(b: ReferenceValues) -> np.ndarray:
    """Labels, counts and texts are equal or not."""
    return np.zeros(b.variable.data.shape)


def input_agreement(b: ReferenceValues) -> np.ndarray:
    """Times and swept data come from the case; the last time of a motion that an event ended is as
    good as the time of the event."""
    allowed = np.full(b.size.shape, GIVEN_TOL * float(np.max(b.size, initial=0)))
    events = b.group.variables.get("event_time")
    if b.name != "time" or events is None:
        return allowed
    return np.where(np.isin(b.variable.data, events.data), located_difference(b), allowed)


def located_difference(b: ReferenceValues) -> np.ndarray:
    """A time may be off by the error of the state, magnified, and by its own stated error; where
    the user or the variable names a tolerance, by that, magnified."""
    if b.tolerance.rtol is not None or "rtol" in b.variable.attrs:
        return b.of_size(b.size, EVENT_CONDITION)
    error = float(b.group.attributes.get("error", math.nan))
    if not math.isfinite(error):
        of_state = b.of_size(b.size, EVENT_CONDITION)
    else:
        # A stated error below some ulps is luck, and another machine has less of it.
        of_state = b.of_size(0.0) + EVENT_CONDITION * max(error, 1e-14) * b.size
    error_name = next((name for name, of in ERRORS.items() if of == b.name), "")
    stated = b.group.variables.get(error_name)
    return of_state + (0.0 if stated is None else STATED_ERRORS * np.nan_to_num(stated.data))


def vector_agreement(b: ReferenceValues) -> np.ndarray:
    """A vector is judged by its largest component at its own time, so that the late samples of a
    decayed motion count as much as the early ones."""
    return b.of_size(b.size.max(axis=b.variable.dims.index("axis"), keepdims=True, initial=0))


def series_agreement(b: ReferenceValues) -> np.ndarray:
    """A scalar of the time is judged by its size about that time: the smaller of the largest values
    until then and from then on, which is the amplitude of an oscillation, growing or decaying; and
    no less than the size of its neighbours, for an end at 0."""
    size = np.moveaxis(b.size, b.variable.dims.index("time"), 0)
    about = np.minimum(
        np.maximum.accumulate(size), np.flip(np.maximum.accumulate(np.flip(size, 0)), 0)
    )
    about[1:] = np.maximum(about[1:], size[:-1])
    about[:-1] = np.maximum(about[:-1], size[1:])
    return b.of_size(np.moveaxis(about, 0, b.variable.dims.index("time")))


def number_agreement(b: ReferenceValues) -> np.ndarray:
    """A number for each member, axis or event is judged by its own size; by the largest if they
    have both signs, since one that may vanish has no relative error."""
    values = b.variable.data[np.isfinite(b.variable.data)]
    one_sign = (values > 0).all() or (values < 0).all()
    return b.of_size(b.size if one_sign else np.full(b.size.shape, np.max(b.size, initial=0)))


Rule = tuple[Callable[[str, Variable], bool], Callable[[ReferenceValues], np.ndarray]]
"""A kind of variable, by name and variable, and the difference that is allowed in it."""

RULES: Sequence[Rule] = (
    (lambda name, b: b.data.dtype.kind != "f", equal),
    # A range that is swept is named by the key that it changes.
    (lambda name, b: name in b.dims or b.attrs.get("long_name") == name, input_agreement),
    (lambda name, b: name in EVENT_VARIABLES, located_difference),
    (lambda name, b: "axis" in b.dims and b.data.ndim > 1, vector_agreement),
    (lambda name, b: "time" in b.dims, series_agreement),
    (lambda name, b: True, number_agreement),
)
"""The kinds of variables; the first that holds counts."""


def allowed_difference(name: str, group: Group, tolerance: Tolerance) -> np.ndarray:
    """The difference allowed in a variable of the reference, of its shape or one that is spread to
    it."""
    variable = group.variables[name]
    allowed = next(allowed for holds_for, allowed in RULES if holds_for(name, variable))
    return allowed(ReferenceValues(name, group, tolerance))


ERRORS = {"crossing_error": "crossing_time", "event_error": "event_time"}
"""The variables that are errors themselves, with those whose errors they are: they agree to their
order of magnitude."""


def same_errors(name: str, a: Group, b: Group) -> bool:
    """Whether the variables of a name, which are errors, are alike in two cases."""
    ours, theirs = a.variables[name].data, b.variables[name].data
    values = b.variables.get(ERRORS[name])
    sized = values is not None and values.data.shape == theirs.shape
    return same_magnitude(ours, theirs, values.data if values and sized else 1.0)


def same_magnitude(ours: Any, theirs: Any, size: Any = 1.0) -> bool:
    """Whether two stated errors, of values of some size, are alike."""
    a, b = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
        return False
    low, high, size = np.minimum(a, b), np.maximum(a, b), np.abs(size)
    with np.errstate(invalid="ignore"):
        close = np.isnan(a) | (a == b) | (high <= ERROR_RATIO * np.maximum(low, EPS / 64 * size))
        return bool((close | ((low == 0) & (high <= LUCKY_ERROR * size))).all())


def same(ours: Any, theirs: Any) -> bool:
    """Whether two attributes are equal."""
    return bool(np.array_equal(np.asarray(ours, dtype=object), np.asarray(theirs, dtype=object)))


def same_words(a: Any, b: Any) -> bool:
    """Whether two texts are equal but for the numbers in them, which are measured; the digit of x1
    is part of a name."""
    number = r"(?<![\w.])[-+]?\d+(\.\d+)?(e[-+]?\d+)?"
    ours, theirs = (re.sub(number, "#", str(text)) for text in (a, b))
    return ours == theirs


MEANING = ("units", "flag_values", "flag_meanings")
"""The attributes of a variable that say what its numbers mean."""

OF_CASE: Mapping[str, Callable[[Any, Any], bool]] = {
    "model": same,
    "form": same,
    "status": same,
    "members": same,
    "message": same_words,
    "warnings": same_words,
    "classify_warnings": same_words,
    "predictions": same_words,
}
"""The attributes of a case that carry meaning, and when two of them agree."""

OF_METHOD: Mapping[str, Callable[[Any, Any], bool]] = {
    "error": same_magnitude,
    "error_kind": same,
    "error_levels": same,
    "error_quantiles": same_magnitude,
    "crossing_error_quantiles": same_magnitude,
}
"""The attributes that have a reason to agree where both cases are computed by one method at one
tolerance."""


def values_alike(a: Group, b: Group) -> bool:
    """Whether two cases are computed by one method at one tolerance."""
    return all(a.attributes.get(key) == b.attributes.get(key) for key in ("method", "tol"))


def differing_attributes(a: Group, b: Group) -> Iterator[tuple[str, str]]:
    """The attributes in which `a` and its variables do not agree with the reference `b`: name and
    both values."""
    for key, agree in {**OF_CASE, **(OF_METHOD if values_alike(a, b) else {})}.items():
        ours, theirs = (group.attributes.get(key) for group in (a, b))
        if theirs is not None and (ours is None or not agree(ours, theirs)):
            yield key, difference_in_words(ours, theirs)
    for name in (name for name in b.variables if name in a.variables):
        ours_attrs, attrs = a.variables[name].attrs, b.variables[name].attrs
        for key in MEANING:
            if not same(ours_attrs.get(key), attrs.get(key)):
                yield f"{name}:{key}", difference_in_words(ours_attrs.get(key), attrs.get(key))
        errors = [float(of.get("error", math.nan)) for of in (ours_attrs, attrs)]
        if values_alike(a, b) and not same_magnitude(*errors):
            yield f"{name}:error", difference_in_words(*errors)


def difference_in_words(*values: Any) -> str:
    """Two values that differ, in words."""
    ours, theirs = (
        f"{value:.1e}" if isinstance(value, float) else "; ".join(str(value).splitlines()) or "none"
        for value in values
    )
    return f"{ours}, not {theirs}"


# Cases and their variables

HOW_COMPUTED = (
    *("name.", "time.samples.", "time.values.", "time.steps.", "store.", "error.", "note."),
    *("assumes.", "method.", "precision.", "tol."),
)
"""Settings that may differ between a result and its reference, as their paths begin: they say how
the motion is computed, sampled and remarked upon, not which one it is."""

ComparisonRow = dict[str, Any]

Line = tuple[str, float, str]
"""The comparison of one variable, or of an attribute that differs: its name, `scaled`, and `place`.

`scaled` is max|a - b| over the difference allowed: above 1 it is a difference, and infinite where
there is no degree (labels, counts, missing variables). `place` says where it is the largest, or why
the two cannot be compared.
"""


def compare_results(a: Path, b: Path, tolerance: Tolerance) -> list[ComparisonRow]:
    """The result `a` against the reference `b`, as `compare` does it; each may be named by its
    config."""
    (ours, config), (theirs, reference_config) = map(result_named, (a, b))
    with open_run(ours) as run, open_run(theirs) as reference:
        for result, named in ((run, config), (reference, reference_config)):
            if named:
                warn_of_changes(result, named)
        return compare(run, reference, tolerance)


def compare(a: ResultFile, b: ResultFile, tolerance: Tolerance) -> list[ComparisonRow]:
    """Every case and variable of the reference `b` in `a`, and the cases that `a` alone has.

    Raises HodoError as `check_cases` does, or if the files share no case: they are then not results
    of the same experiment.
    """
    check_cases(a)
    check_cases(b)
    ours, theirs = dict.fromkeys(a.cases()), dict.fromkeys(b.cases())
    if not ours.keys() & theirs.keys():
        raise HodoError(f"{a.path} and {b.path} have no case in common")
    rows: list[ComparisonRow] = []
    for name in theirs | ours:
        if name in ours and name in theirs:
            lines = compared_case(checked_group(a, name), checked_group(b, name), tolerance)
        else:
            lines = [("", math.inf, f"missing in {(b if name in ours else a).path}")]
        for variable, scaled, place in lines:
            row = {"case": name, "variable": variable, "scaled": scaled, "place": place}
            rows.append(row | {"differs": not scaled <= 1})  # so that nan differs
    return rows


def checked_group(run: ResultFile, name: str) -> Group:
    """A case of a result. Raises HodoError if it is damaged."""
    group, owner = run.read(name), f"{run.path}: {name}"
    typed({"error": math.nan, **group.attributes}, {"error": float}, owner)
    is_motion = "time" in group.variables and "members" not in group.attributes
    check_whole(group.variables, owner, is_sweep=not is_motion)
    return group


def compared_case(a: Group, b: Group, tolerance: Tolerance) -> list[Line]:
    """The lines of one case. An attribute has one only if it differs, and how the case was computed
    only if a value does: a reference may be computed otherwise, to the same values. Labels that
    the first case lacks altogether have a line in common."""
    cases = []
    unlabelled = "classify_warnings" in b.attributes.keys() - a.attributes.keys()
    if unlabelled:
        b = replace(
            b,
            attributes=without_labels(b.attributes, a.attributes),
            variables=without_labels(b.variables, a.variables),
        )
    with suppress(HodoError):
        cases = [parse_case(str(group.attributes.get("case", ""))) for group in (a, b)]
    settings = [*differing_settings(cases, a, b)]
    named = {name for name, *_ in settings}
    # An averaged motion has its labels without.
    lacks_labels = unlabelled and "enclosed_axis" not in a.variables
    lines = [
        *settings,
        *[("labels", math.inf, "missing: not classified")] * lacks_labels,
        *((key, math.inf, place) for key, place in differing_attributes(a, b) if key not in named),
        *compared_variables(a, b, tolerance),
    ]
    if any(not scaled <= 1 for _, scaled, _ in lines):
        lines = [*differing_computation(cases, a, b), *lines]
    return lines


def differing_computation(cases: Sequence[Case], a: Group, b: Group) -> Iterator[Line]:
    """Lines for the method and tolerance where two stored cases ask for others: the precision is
    not told, because references have a higher one."""
    for key in ("method", "tol"):
        asked = [getattr(case, key) for case in cases]
        if len({*asked}) > 1:
            # Of a case that asks for none, the one that was taken.
            ours, theirs = (
                group.attributes.get(key) if value is None else value
                for value, group in zip(asked, (a, b), strict=True)
            )
            yield key, math.inf, f"{ours}, not {theirs}"


def differing_settings(cases: Sequence[Case], a: Group, b: Group) -> Iterator[Line]:
    """The parameters in which two stored cases differ, and a method that a case does not allow.

    `cases` is empty where the text of one of them cannot be read.
    """
    if not cases:
        if str(a.attributes.get("case")) != str(b.attributes.get("case")):
            yield "case", math.inf, "damaged, or of another version of hodo"
        return
    ours, theirs = (settings_by_path("", case.entries) for case in cases)
    for key in ours | theirs:
        if not f"{key}.".startswith(HOW_COMPUTED) and ours.get(key) != theirs.get(key):
            yield key, math.inf, f"{ours.get(key)}, not {theirs.get(key)}"
    # A sweep names how its members were integrated, so its method says nothing about the case.
    method, asked = str(a.attributes.get("method", "")), cases[0].method
    methods = AUTOMATIC if asked == "auto" else (asked,)
    if method not in methods and "members" not in a.attributes:
        yield "method", math.inf, f"{method}, where the case asks for {asked}"


def settings_by_path(path: str, value: Any) -> dict[str, Any]:
    """Every setting within a value by its path."""
    if isinstance(value, tuple):
        value = dict(enumerate(value))
    if not isinstance(value, Mapping):
        return {path: value}
    inner = (settings_by_path(f"{path}.{key}".lstrip("."), item) for key, item in value.items())
    return dict(entry for entries in inner for entry in entries.items())


def compared_variables(a: Group, b: Group, tolerance: Tolerance) -> Iterator[Line]:
    """A line for each variable of a case."""
    times = [
        group.variables["time"].data if "time" in group.variables else np.empty(0)
        for group in (a, b)
    ]
    # By nearest time, since a reference may be thinned and an end of spin falls a rounding apart.
    rows = nearest_times(*times)
    for key, reference in b.variables.items():
        if key not in a.variables:
            yield key, math.inf, "missing"
            continue
        ours = a.variables[key].data
        if reference.dims[:1] == ("time",) and ours.shape[:1] == times[0].shape:
            ours = ours[rows]
        if key not in ERRORS:
            allowed = allowed_difference(key, b, tolerance)
            scaled, index = scaled_difference(ours, reference.data, allowed)
            place = largest_at(key, index, ours, reference, b.variables) if scaled else "equal"
            yield key, scaled, place
        elif values_alike(a, b) and not same_errors(key, a, b):
            place = largest_at(key, (), ours, reference, b.variables)
            yield key, math.inf, place or "of another order of magnitude"


OF_LABELS = {
    *("classify_warnings", "predictions", "enclosed_axis", *CROSSING_COLUMNS),
    *("growth_rate", "final_axis", "axis"),
}
"""The attributes and variables that `classify` adds to a case."""


def without_labels(stored: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes or variables without those that `classify` adds and another case lacks."""
    return {name: item for name, item in stored.items() if name in other or name not in OF_LABELS}


def nearest_times(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """The position in `ours` (n,) of the time nearest to each of `theirs` (m,); none where `ours`
    has no times."""
    if not len(ours):
        return np.empty(0, dtype=np.intp)
    # From half a step on the next position is the nearest. Damaged times are no numbers, or fall.
    positions = np.rint(np.nan_to_num(np.interp(theirs, ours, np.arange(len(ours)))))
    return np.asarray(np.clip(positions, 0, len(ours) - 1), dtype=np.intp)


def scaled_difference(
    a: np.ndarray, b: np.ndarray, allowed: np.ndarray
) -> tuple[float, tuple[int, ...]]:
    """The scaled difference and the position of the largest; infinite, without a position, for
    unequal shapes. `allowed` has the shape of b, or one that is spread to it.

    Integers and texts are equal or not. A number that is not finite equals nothing but itself.
    """
    if a.shape != b.shape:
        return math.inf, ()
    if not a.size:
        return 0.0, ()
    same, scaled = a == b, np.full(b.shape, math.inf)
    if a.dtype.kind == "f" and b.dtype.kind == "f":
        same = same | (np.isnan(a) & np.isnan(b))
        with np.errstate(all="ignore"):
            scaled = np.nan_to_num(np.abs(a - b) / allowed, nan=math.inf, posinf=math.inf)
    scaled = np.where(same, 0.0, scaled)
    index = np.unravel_index(int(np.argmax(scaled)), scaled.shape)
    return float(scaled[index]), tuple(int(i) for i in index)


def largest_at(
    name: str,
    index: tuple[int, ...],
    a: np.ndarray,
    b: Variable,
    coordinates: Mapping[str, Variable],
) -> str:
    """Where a difference is the largest, in the reference's coordinates, and the two values
    there."""
    if a.ndim != b.data.ndim:
        return f"{a.ndim} dimensions, not {b.data.ndim}"
    if a.shape != b.data.shape:
        return f"{len(a)} along {b.dims[0] if b.dims else 'value'}, not {len(b.data)}"
    if not index:
        return ""
    where = [
        f"{dim} = {printed_value(coordinates[dim], coordinates[dim].data[i], 10)}"
        if dim in coordinates and dim != name
        else f"{dim} {i}"
        for dim, i in zip(b.dims, index, strict=True)
    ]
    return (
        f"{', '.join(where)}: {printed_value(b, a[index])}, not {printed_value(b, b.data[index])}"
    )


def printed_value(variable: Variable, value: object, digits: int = 17) -> str:
    """A value as the table prints it; a label by its meaning."""
    if "flag_values" in variable.attrs and isinstance(value, np.integer):
        return rigid_body.LABELS.get(int(value), str(value))
    return f"{value:.{digits}g}" if isinstance(value, np.floating) else str(value)


def comparison_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """For each case the variable that is farthest from the reference, and every one that
    differs."""
    # The last one of a case stays, which is the farthest.
    worst = {row["case"]: row for row in sorted(rows, key=lambda row: row["scaled"])}
    return table(
        ("case", "variable", "scaled error", "", "where"),
        [
            (
                row["case"],
                row["variable"],
                magnitude(row["scaled"]),
                "DIFFERS" if row["differs"] else "",
                row["place"],
            )
            for row in rows
            if row["differs"] or row is worst[row["case"]]
        ],
        right=("scaled error",),
    )
