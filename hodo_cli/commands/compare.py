"""Two results, case by case and variable by variable: how far one is from the other, and where.

The first result is judged by the second, the reference. Values are compared where the reference has
them: it may be a thinned one. Its variables may carry tolerances of their own, as attributes `rtol`
and `atol`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, parse_case
from ..integration import AUTOMATIC
from ..models import rigid_body
from ..results.agreement import (
    ERRORS,
    Tolerance,
    allowed_difference,
    differing_attributes,
    same_errors,
    values_alike,
)
from ..results.layout import CROSSING_COLUMNS
from ..results.motion import check_whole
from ..storage import Group, ResultFile, Variable, open_run, typed
from ..text import magnitude, table
from .resume import result_named, warn_of_changes

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

    Raises HodoError if the files share no case: they are then not results of the same experiment.
    """
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
        if a.attributes.get("case") != b.attributes.get("case"):
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
