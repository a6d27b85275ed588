"""Two results, case by case and variable by variable: how far one is from the other, and where.

The first result is judged by the second, the reference. Values are compared where the reference has
them: it may be a thinned one. Its variables may carry tolerances of their own, as attributes `rtol`
and `atol`.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import HodoError
from ..models import rigid_body
from ..results.hdf5 import Group, Run, Variable, open_run

# Looser than the results' 1e-12, so that another machine's compiler changes no verdict, and tighter
# than any figure shows.
RTOL = 1e-9
"""The relative tolerance of a variable that has none of its own."""

# A time is worse conditioned than the state: 20 to 30 times on Fig 4 of paper 1, up to 1,000 times
# on Fig 12, whose states agree far better than RTOL asks.
CONDITION = 100.0
"""By how much more the time of an event may be off than the state, and what is measured at that
time."""

LOCATED = ("event_time", "crossing_time", "crossing_G")
"""The variables to which `CONDITION` applies."""

VARYING = ("crossing_error",)
"""Variables that differ from run to run; so do all attributes but EXACT."""

EXACT = ("model", "form", "status")
"""The attributes that have to be equal."""


@dataclass(frozen=True)
class Tolerance:
    """The difference that is allowed: atol + rtol max|b|. None: the variable's own, or the
    default."""

    rtol: float | None = None
    atol: float | None = None

    def of(self, name: str, variable: Variable) -> tuple[float, float]:
        """rtol and atol of a variable of the reference."""
        own = {key: float(variable.attrs[key]) for key in ("rtol", "atol") if key in variable.attrs}
        condition = CONDITION if name in LOCATED else 1.0
        rtol = self.rtol * condition if self.rtol is not None else own.get("rtol", RTOL * condition)
        return rtol, own.get("atol", 0.0) if self.atol is None else self.atol


@dataclass(frozen=True)
class Line:
    """What the comparison found of one variable of one case.

    `scaled` is max|a - b| / (atol + rtol max|b|): above 1 it is a difference, and infinite where
    there is no degree (labels, counts, what is missing). `place` says where it is the largest, or
    what is wrong.
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


def compare_results(a: Path, b: Path, tolerance: Tolerance) -> list[Line]:
    """The result file `a` against the reference `b`, as `compare` does it."""
    with open_run(a) as ours, open_run(b) as reference:
        return compare(ours, reference, tolerance)


def compare(a: Run, b: Run, tolerance: Tolerance) -> list[Line]:
    """Every case and variable of the reference `b` in `a`, and the cases that `a` alone has.

    Raises HodoError if the files share no case: they are then not results of the same experiment.
    """
    ours, theirs = a.cases(), b.cases()
    if not set(ours) & set(theirs):
        raise HodoError(f"{a.path} and {b.path} have no case in common")
    lines: list[Line] = []
    for name in theirs:
        if name in ours:
            lines += one_case(name, a.read(name), b.read(name), tolerance)
        else:
            lines.append(Line(name, "", math.inf, f"missing in {a.path}"))
    return lines + [
        Line(name, "", math.inf, f"missing in {b.path}") for name in ours if name not in theirs
    ]


def one_case(name: str, a: Group, b: Group, tolerance: Tolerance) -> Iterator[Line]:
    """The lines of one case. An attribute has one only if it differs."""
    for key in EXACT:
        said = [str(group.attributes.get(key)) for group in (a, b)]
        if said[0] != said[1]:
            yield Line(name, key, math.inf, f"{said[0]}, not {said[1]}")
    times = [
        group.variables["time"].data if "time" in group.variables else np.empty(0)
        for group in (a, b)
    ]
    if any(time.dtype.kind != "f" or time.ndim != 1 for time in times):
        raise HodoError(f"{name} is damaged (its times are no numbers)")
    # By nearest time, since a reference may be thinned and an end of spin falls a rounding apart.
    rows = matching(*times)
    for key, reference in b.variables.items():
        if key in VARYING:
            continue
        if key not in a.variables:
            yield Line(name, key, math.inf, "missing")
            continue
        ours = a.variables[key].data
        if reference.dims[:1] == ("time",) and ours.shape[:1] == times[0].shape:
            ours = ours[rows]
        scaled, at = scaled_difference(ours, reference.data, *tolerance.of(key, reference))
        yield Line(name, key, scaled, largest_at(key, at, ours, reference, b.variables))


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
    a: np.ndarray, b: np.ndarray, rtol: float, atol: float
) -> tuple[float, tuple[int, ...]]:
    """The scaled difference and the position of the largest; infinite, without a position, for
    unequal shapes.

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
        # Relative to the largest value: a component that passes through 0 has no relative error
        # there.
        allowed = atol + rtol * float(np.max(np.abs(b), initial=0, where=np.isfinite(b)))
        scaled = np.divide(
            apart, allowed, out=np.where(same, 0.0, math.inf), where=finite & (allowed > 0)
        )
    else:
        scaled = np.where(a == b, 0.0, math.inf)
    at = np.unravel_index(int(np.argmax(scaled)), scaled.shape)
    return float(scaled[at]), tuple(int(i) for i in at)


def largest_at(
    name: str, at: tuple[int, ...], a: np.ndarray, b: Variable, coordinates: Mapping[str, Variable]
) -> str:
    """Where a difference is the largest, in the reference's coordinates, and the two values
    there."""
    if a.ndim != b.data.ndim:
        return f"{a.ndim} dimensions, not {b.data.ndim}"
    if a.shape != b.data.shape:
        what = b.dims[0] if b.dims else "value"
        return f"{len(a)} along {what}, not {len(b.data)}"
    if not at:
        return ""
    where = [
        f"{dim} = {coordinate(coordinates[dim].data[i])}"
        if dim in coordinates and dim != name
        else f"{dim} {i}"
        for dim, i in zip(b.dims, at, strict=True)
    ]
    return f"{', '.join(where)}: {printed_value(b, a[at])}, not {printed_value(b, b.data[at])}"


def coordinate(value: object) -> str:
    """A coordinate to ten digits."""
    return f"{value:.10g}" if isinstance(value, np.floating) else str(value)


def printed_value(variable: Variable, value: object) -> str:
    """A value as the table prints it; a label by its meaning."""
    if "flag_values" in variable.attrs and isinstance(value, np.integer):
        return rigid_body.LABELS.get(int(value), str(value))
    return f"{value:.17g}" if isinstance(value, np.floating) else str(value)
