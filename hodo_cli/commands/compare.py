"""Two results, case by case and variable by variable: how far one is from the other, and where.

The first result is compared with the second, the reference, by one rule for all measured values: |a
- b| <= atol + rtol max |b|. Values are compared at the times of the reference, which may be
thinned, and whose variables may carry tolerances of their own, as attributes `rtol` and `atol`.
Times may also be off by their stated errors. Everything else has to be equal: labels, counts and
texts, the meaning of a variable, the status of a case, and its numbers. How it was computed is not
compared.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import parse_case
from ..models import rigid_body
from ..results.motion import check_whole
from ..results.resume import check_cases, result_named, warn_of_changes
from ..schema.kinds import leaves
from ..storage import Group, ResultFile, Variable, open_run
from ..text import counted, magnitude, table

# Looser than the results' 1e-12, so that another machine's compiler changes no verdict, and tighter
# than any figure shows.
RTOL = 1e-9
"""The relative tolerance of a variable that has none of its own."""

SUBNORMAL = 2.0**-1060
"""A few thousand times the smallest double: numbers below it have fewer digits than any
tolerance."""

ERRORS = {"crossing_time": "crossing_error", "event_time": "event_error"}
"""The times with stated errors, and the variables of these errors."""

STATED_ERRORS = 10.0
"""How far a time may be off, in units of its stated error, which includes one compiler's
rounding."""

MEANING = ("long_name", "units", "flag_values", "flag_meanings")
"""The attributes of a variable that state the meaning of its numbers."""

OF_CASE = ("model", "form", "status", "members")
"""The attributes that identify the motion of a case and its end."""

HOW_COMPUTED = (
    *("name.", "time.samples.", "time.values.", "store.", "error.", "note.", "assumes."),
    *("method.", "precision.", "tol.", "max_seconds.", "max_steps."),
)
"""The beginnings of the paths of settings that say how a case is computed, sampled and described,
and not which motion it is."""


@dataclass(frozen=True)
class Tolerance:
    """The allowed difference, atol + rtol max|b|; None for the variable's own tolerance, or the
    default. Raises HodoError for a negative or infinite one."""

    rtol: float | None = None
    atol: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            # With an infinite tolerance all values would be equal, with nan none.
            if value is not None and not 0 <= value < math.inf:
                raise HodoError(f"--{name}: expected a number >= 0, got {value:g}")

    def allowed(self, name: str, group: Group) -> np.ndarray:
        """The allowed difference (...) of a variable of the reference; `group` is its case."""
        b, attrs = group.variables[name].data, group.variables[name].attrs
        rtol = float(attrs.get("rtol", RTOL)) if self.rtol is None else self.rtol
        atol = float(attrs.get("atol", 0.0)) if self.atol is None else self.atol
        largest = float(np.abs(b[np.isfinite(b)]).max(initial=0))
        allowed = np.full(b.shape, atol + max(rtol * largest, SUBNORMAL))
        stated = group.variables.get(ERRORS.get(name, ""))
        return allowed if stated is None else allowed + STATED_ERRORS * np.nan_to_num(stated.data)


Line = tuple[str, float, str]
"""The comparison of one variable, or of another property: its name, `scaled`, and `place`.

`scaled` is max|a - b| over the allowed difference: above 1 the values differ. It is infinite where
there is no degree (labels, counts, missing variables). `place` says where it is the largest, or why
the two cannot be compared.
"""


def compare_results(a: Path, b: Path, tolerance: Tolerance) -> list[dict[str, Any]]:
    """The rows of the comparison of a result `a` with the reference `b`; each may be named by its
    config. Raises HodoError if they have no case in common, and so are not results of one
    experiment."""
    (ours, config), (theirs, reference_config) = map(result_named, (a, b))
    with open_run(ours) as run, open_run(theirs) as reference:
        for result, named in ((run, config), (reference, reference_config)):
            check_cases(result)
            if named:
                warn_of_changes(result, named)
        cases, of_reference = run.cases(), reference.cases()
        if not {*cases} & {*of_reference}:
            raise HodoError(f"{run.path} and {reference.path} have no case in common")
        return [
            {"case": name, "variable": variable, "scaled": scaled, "place": place}
            | {"differs": not scaled <= 1}  # so that nan differs
            for name in dict.fromkeys([*of_reference, *cases])
            for variable, scaled, place in compared_case(name, run, reference, tolerance)
        ]


def compared_case(
    name: str, run: ResultFile, reference: ResultFile, tolerance: Tolerance
) -> Iterator[Line]:
    """The lines of one case: first its other properties that differ, then each variable of the
    reference."""
    for result in (run, reference):
        if name not in result.cases():
            yield "", math.inf, f"missing in {result.path}"
            return
    a, b = checked_group(run, name), checked_group(reference, name)
    yield from unequal("", *({key: of.attributes.get(key) for key in OF_CASE} for of in (a, b)))
    yield from differing_settings(*(str(of.attributes.get("case", "")) for of in (a, b)))
    if missing := [key for key in b.variables if key not in a.variables]:
        yield ", ".join(missing), math.inf, "missing"
    rows = nearest_times(a.variables.get("time"), b.variables.get("time"))
    for key in (key for key in b.variables if key in a.variables):
        ours, theirs = a.variables[key], b.variables[key]
        meanings = ({name: of.attrs.get(name) for name in MEANING} for of in (ours, theirs))
        yield from unequal(f"{key}:", *meanings)
        if key not in ERRORS.values():
            at_times = theirs.dims[:1] == ("time",) == ours.dims[:1]
            data = ours.data[rows] if at_times else ours.data
            yield (key, *largest_difference(data, key, b, tolerance))


def checked_group(run: ResultFile, name: str) -> Group:
    """A case of a result. Raises HodoError if it is damaged."""
    group, owner = run.read(name), f"{run.path}: {name}"
    is_motion = "time" in group.variables and "members" not in group.attributes
    check_whole(group.variables, owner, is_sweep=not is_motion)
    return group


def differing_settings(ours: str, theirs: str) -> Iterator[Line]:
    """A line for each setting in which the texts of two stored cases differ, if it decides which
    motion they are."""
    if ours == theirs:
        return
    try:
        settings = [leaves(parse_case(text).entries) for text in (ours, theirs)]
    except HodoError as error:  # of another version, or damaged
        yield "case", math.inf, f"cannot be read: {error}"
        return
    named = ({".".join(map(str, path)): x for path, x in of_case} for of_case in settings)
    motions = (
        {key: x for key, x in of_case.items() if not f"{key}.".startswith(HOW_COMPUTED)}
        for of_case in named
    )
    yield from unequal("", *motions)


def unequal(prefix: str, ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> Iterator[Line]:
    """A line for each name whose values differ; a missing value is None."""
    for key in {**theirs, **ours}:
        a, b = (np.asarray(of.get(key), dtype=object) for of in (ours, theirs))
        if not np.array_equal(a, b):
            yield f"{prefix}{key}", math.inf, f"{ours.get(key)}, not {theirs.get(key)}"


def nearest_times(ours: Variable | None, theirs: Variable | None) -> np.ndarray:
    """For each time (m,) of the reference the position of the nearest of our times (n,); none for a
    sweep. A reference may be thinned, and the time of an end of spin differs by a rounding."""
    if ours is None or theirs is None or not len(ours.data):
        return np.empty(0, dtype=np.intp)
    last = len(ours.data) - 1
    # From half a step on the next position is nearer. Damaged times may be nan, or fall.
    positions = np.interp(theirs.data, ours.data, np.arange(last + 1))
    return np.asarray(np.clip(np.rint(np.nan_to_num(positions)), 0, last), dtype=np.intp)


def largest_difference(
    a: np.ndarray, name: str, reference: Group, tolerance: Tolerance
) -> tuple[float, str]:
    """The largest scaled difference of values `a` from a variable of the reference, and its place.
    A number that is not finite is equal to the same number only."""
    variable = reference.variables[name]
    if a.shape != (b := variable.data).shape:
        return math.inf, f"shape {a.shape}, not {b.shape}"
    scaled, equal = np.full(b.shape, math.inf), a == b
    if a.dtype.kind == b.dtype.kind == "f":
        equal = equal | (np.isnan(a) & np.isnan(b))
        with np.errstate(all="ignore"):
            scaled = np.abs(a - b) / tolerance.allowed(name, reference)
    scaled = np.where(equal, 0.0, np.nan_to_num(scaled, nan=math.inf, posinf=math.inf))
    if not scaled.any():
        return 0.0, "equal"
    index = np.unravel_index(int(np.argmax(scaled)), scaled.shape)
    return float(scaled[index]), place_of(name, index, a, reference)


def place_of(name: str, index: Sequence[Any], a: np.ndarray, reference: Group) -> str:
    """The place of a difference in the reference's coordinates, and both values there."""
    b, coordinates = reference.variables[name], reference.variables
    where = [
        f"{dim} = {printed_value(coordinates[dim], coordinates[dim].data[i], 10)}"
        if dim in coordinates and dim != name
        else f"{dim} {i}"
        for dim, i in zip(b.dims, index, strict=True)
    ]
    ours, theirs = (printed_value(b, data[tuple(index)]) for data in (a, b.data))
    return f"{', '.join(where)}: {ours}, not {theirs}".removeprefix(": ")


def printed_value(variable: Variable, value: object, digits: int = 17) -> str:
    """A value as the table prints it; a label by its meaning."""
    if "flag_values" in variable.attrs and isinstance(value, np.integer):
        return rigid_body.LABELS.get(int(value), str(value))
    return f"{value:.{digits}g}" if isinstance(value, np.floating) else str(value)


def comparison_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """For each case everything that differs, and the variable that is farthest from the reference;
    one line for a case whose variables are all equal."""
    lines = []
    for case in dict.fromkeys(row["case"] for row in rows):
        of_case = [row for row in rows if row["case"] == case]
        worst = max(of_case, key=lambda row: float(row["scaled"]))
        shown = [row for row in of_case if row["differs"] or row is worst]
        if not worst["scaled"]:
            shown = [{**worst, "variable": f"all {counted(len(of_case), 'variable')}"}]
        for row in shown:
            verdict = "DIFFERS" if row["differs"] else ""
            error = magnitude(row["scaled"])
            lines.append((case, row["variable"], error, verdict, row["place"]))
    return table(("case", "variable", "scaled error", "", "where"), lines, right=("scaled error",))
