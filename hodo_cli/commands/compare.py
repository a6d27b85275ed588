"""Two results, case by case and variable by variable: how far one is from the other, and where.

The first result is judged by the second, the reference. Values are compared where the reference has
them: it may be a thinned one. Its variables may carry tolerances of their own, as attributes `rtol`
and `atol`.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, parse_case
from ..integration.choice import AUTOMATIC
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
from ..results.motion import wrong_labels
from ..storage.group import Group, Variable
from ..storage.hdf5 import ResultFile, open_run
from ..storage.provenance import typed
from .resume import result_named, warn_of_changes

COMPUTED = ("name", "time.samples", "store", "error", "note", "method", "precision", "tol")
"""Settings that may differ between a result and its reference: they say how the motion is computed,
sampled and remarked upon, not which one it is."""


@dataclass(frozen=True)
class VariableComparison:
    """The comparison of one variable of one case.

    `scaled` is max|a - b| over the difference allowed: above 1 it is a difference, and infinite
    where there is no degree (labels, counts, missing variables). `place` says where it is the
    largest, or why the two cannot be compared.
    """

    case: str
    variable: str
    scaled: float
    place: str

    @property
    def differs(self) -> bool:
        """Whether this is a difference."""
        # So that nan differs.
        return not self.scaled <= 1


def compare_results(a: Path, b: Path, tolerance: Tolerance) -> list[VariableComparison]:
    """The result `a` against the reference `b`, as `compare` does it; each may be named by its
    config."""
    (ours, config), (theirs, reference_config) = map(result_named, (a, b))
    with open_run(ours) as run, open_run(theirs) as reference:
        for result, named in ((run, config), (reference, reference_config)):
            if named:
                warn_of_changes(result, named)
        return compare(run, reference, tolerance)


def compare(a: ResultFile, b: ResultFile, tolerance: Tolerance) -> list[VariableComparison]:
    """Every case and variable of the reference `b` in `a`, and the cases that `a` alone has.

    Raises HodoError if the files share no case: they are then not results of the same experiment.
    """
    ours, theirs = a.cases(), b.cases()
    if not set(ours) & set(theirs):
        raise HodoError(f"{a.path} and {b.path} have no case in common")
    lines: list[VariableComparison] = []
    for name in theirs:
        if name in ours:
            lines += one_case(name, sound(a, name), sound(b, name), tolerance)
        else:
            lines.append(VariableComparison(name, "", math.inf, f"missing in {a.path}"))
    return lines + [
        VariableComparison(name, "", math.inf, f"missing in {b.path}")
        for name in ours
        if name not in theirs
    ]


def sound(run: ResultFile, name: str) -> Group:
    """A case of a result. Raises HodoError if it is damaged."""
    group = run.read(name)
    typed({"error": math.nan, **group.attributes}, {"error": float}, f"{run.path}: {name}")
    if problem := damage_of(group.variables):
        raise HodoError(f"{run.path}: {name} is damaged ({problem})")
    return group


def damage_of(variables: Mapping[str, Variable]) -> str:
    """The damage that keeps variables from being compared; an empty string if there is none."""
    time = variables.get("time")
    if time and (time.data.dtype.kind != "f" or time.data.ndim != 1):
        return "its times are no numbers"
    return wrong_labels(variables)


def one_case(name: str, a: Group, b: Group, tolerance: Tolerance) -> Iterator[VariableComparison]:
    """The lines of one case. An attribute has one only if it differs, and how the case was computed
    only if a value does: a reference may be computed otherwise, to the same values."""
    lines = [*variable_lines(name, a, b, tolerance)]
    if any(line.differs for line in lines):
        yield from differing_computation(name, a, b)
    yield from lines


def differing_computation(name: str, a: Group, b: Group) -> Iterator[VariableComparison]:
    """Lines for the method and tolerance where two stored cases ask for others: the precision is
    not told, because references have a higher one. None for a case that cannot be read, which has
    a line of its own."""
    try:
        cases = [parse_case(str(group.attributes.get("case", ""))) for group in (a, b)]
    except HodoError:
        return
    for key in ("method", "tol"):
        asked = [getattr(case, key) for case in cases]
        if asked[0] != asked[1]:
            got = [group.attributes.get(key) for group in (a, b)]
            ours, theirs = (g if a is None else a for a, g in zip(asked, got, strict=True))
            yield VariableComparison(name, key, math.inf, f"{ours}, not {theirs}")


def variable_lines(
    name: str, a: Group, b: Group, tolerance: Tolerance
) -> Iterator[VariableComparison]:
    """Every difference in one case, and a line for each of its variables."""
    yield from differing_settings(name, a, b)
    for attribute, place in differing_attributes(a, b):
        yield VariableComparison(name, attribute, math.inf, place)
    times = [
        group.variables["time"].data if "time" in group.variables else np.empty(0)
        for group in (a, b)
    ]
    # By nearest time, since a reference may be thinned and an end of spin falls a rounding apart.
    rows = matching(*times)
    of_labels = () if "enclosed_axis" in a.variables else LABELS_STORED
    for key, reference in b.variables.items():
        if key not in a.variables:
            what = "missing: not classified" if key in of_labels else "missing"
            yield VariableComparison(name, key, math.inf, what)
            continue
        ours = a.variables[key].data
        if reference.dims[:1] == ("time",) and ours.shape[:1] == times[0].shape:
            ours = ours[rows]
        if key in ERRORS:
            if values_alike(a, b) and not same_errors(key, a, b):
                place = largest_at(key, (), ours, reference, b.variables)
                yield VariableComparison(
                    name, key, math.inf, place or "of another order of magnitude"
                )
            continue
        allowed = allowed_difference(key, b, tolerance)
        scaled, index = scaled_difference(ours, reference.data, allowed)
        place = largest_at(key, index, ours, reference, b.variables) if scaled else "equal"
        yield VariableComparison(name, key, scaled, place)


def differing_settings(name: str, a: Group, b: Group) -> Iterator[VariableComparison]:
    """The parameters in which two stored cases differ, and a method that a case does not allow."""
    try:
        ours, theirs = (
            settings(parse_case(str(group.attributes.get("case", "")))) for group in (a, b)
        )
    except HodoError:
        if a.attributes.get("case") != b.attributes.get("case"):
            yield VariableComparison(
                name, "case", math.inf, "damaged, or of another version of hodo"
            )
        return
    for key in ours | theirs:
        if (
            key not in COMPUTED
            and not key.startswith(("assumes", "time.values", "time.steps"))
            and ours.get(key) != theirs.get(key)
        ):
            yield VariableComparison(name, key, math.inf, f"{ours.get(key)}, not {theirs.get(key)}")
    # A sweep names how its members were integrated, so its method says nothing about the case.
    method, asked = str(a.attributes.get("method", "")), ours["method"]
    methods = AUTOMATIC if asked == "auto" else (asked,)
    if method not in methods and "members" not in a.attributes:
        yield VariableComparison(
            name, "method", math.inf, f"{method}, where the case asks for {asked}"
        )


def settings(case: Case) -> dict[str, Any]:
    """Every setting of a case by its path."""

    def flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
        if isinstance(value, Mapping):
            for key, item in value.items():
                yield from flat(f"{path}.{key}" if path else str(key), item)
        elif isinstance(value, list | tuple) and path != "store":
            for i, item in enumerate(value):
                yield from flat(f"{path}.{i}", item)
        else:
            yield path, value

    common = {of.name: getattr(case, of.name) for of in fields(case) if of.name != "data"}
    return dict(flat("", {**case.data, **common, "time": case.time.entries}))


LABELS_STORED = ("enclosed_axis", *CROSSING_COLUMNS, "growth_rate", "final_axis")
"""The variables that `classify` adds to a case."""


def matching(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """The position in `ours` (n,) of the time nearest to each of `theirs` (m,); none where `ours`
    has no times."""
    if not len(ours):
        return np.empty(0, dtype=np.intp)
    after = np.clip(np.searchsorted(ours, theirs), 1, max(len(ours) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(ours) - 1)
    return np.asarray(
        np.where(np.abs(ours[before] - theirs) <= np.abs(ours[after] - theirs), before, after)
    )


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
    if a.dtype.kind == "f" and b.dtype.kind == "f":
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        with np.errstate(invalid="ignore"):
            apart = np.where(same, 0.0, np.abs(a - b))
        finite = np.isfinite(a) & np.isfinite(b)
        allowed = np.broadcast_to(allowed, b.shape)
        scaled = np.divide(
            apart, allowed, out=np.where(same, 0.0, math.inf), where=finite & (allowed > 0)
        )
    else:
        scaled = np.where(a == b, 0.0, math.inf)
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
        what = b.dims[0] if b.dims else "value"
        return f"{len(a)} along {what}, not {len(b.data)}"
    if not index:
        return ""
    where = [
        f"{dim} = {printed_coordinate(coordinates[dim].data[i])}"
        if dim in coordinates and dim != name
        else f"{dim} {i}"
        for dim, i in zip(b.dims, index, strict=True)
    ]
    return (
        f"{', '.join(where)}: {printed_value(b, a[index])}, not {printed_value(b, b.data[index])}"
    )


def printed_coordinate(value: object) -> str:
    """A coordinate to ten digits."""
    return f"{value:.10g}" if isinstance(value, np.floating) else str(value)


def printed_value(variable: Variable, value: object) -> str:
    """A value as the table prints it; a label by its meaning."""
    if "flag_values" in variable.attrs and isinstance(value, np.integer):
        return rigid_body.LABELS.get(int(value), str(value))
    return f"{value:.17g}" if isinstance(value, np.floating) else str(value)
