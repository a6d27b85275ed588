"""What is stored of the members of a sweep, one column each."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..cases.case import Case, Time
from ..cases.sweep_block import axes_of
from ..integration.crossings import Crossing
from ..integration.trajectory import Occurrence
from ..results.layout import (
    CROSSING_COLUMNS,
    MEMBER_CLASSIFIED,
    MEMBER_EVENT,
    MEMBER_PASSED,
    MEMBER_STATUS,
    MEMBER_STEPS,
    UNASKED,
    Stored,
    passages_as_crossings,
    units_of_case,
)


def columns(case: Case) -> dict[str, Stored]:
    """Everything that a member of this sweep is reduced to."""
    model = case.system
    final = {
        name: Stored(
            f"{variable.long_name}, at the end",
            variable.dims[1:],
            units=units_of_case(variable.units, case.time.unit),
        )
        for name, variable in model.variables.items()
        # As a label at the end it is `end_axis`.
        if name != "enclosed_axis" or "trajectory" in case.store
    }
    own = MEMBER_CLASSIFIED
    if model.no_axis_reason:
        own = MEMBER_EVENT | (MEMBER_PASSED if "enclosed_axis" in model.variables else {})
    return final | own | MEMBER_STEPS | MEMBER_STATUS


def kept(case: Case) -> dict[str, Stored]:
    """What of that is stored in the result."""
    asked = set(case.store) - {"trajectory"}
    if asked and "trajectory" in case.store:
        asked |= set(case.system.variables)  # whose samples are the trajectory
    return {
        name: column
        for name, column in columns(case).items()
        if name == "status" or (name in asked if asked else name not in UNASKED)
    }


def shape(case: Case) -> tuple[int, ...]:
    """The length of each axis."""
    assert case.sweep is not None
    return tuple(len(axis) for axis in axes_of(case.sweep))


def stored_bytes(case: Case) -> int:
    """The bytes that a sweep takes in its result."""
    columns, samples = kept(case), case.time.samples
    each = sum(
        np.dtype(column.dtype).itemsize * 3 ** len(column.dims) for column in columns.values()
    )
    if "trajectory" in case.store:
        dims = [variable.dims[1:] for variable in case.system.variables.values()]
        each += 8 * samples * sum(3 ** len(inner) for inner in dims)
    return math.prod(shape(case)) * int(each)


class Crossings(NamedTuple):
    """Passages through the separatrix, in order of member and time, (k,) each: of which member,
    the error that the time may have, from which axis to which, and |G| there."""

    member: np.ndarray
    time: np.ndarray
    error: np.ndarray
    start: np.ndarray
    end: np.ndarray
    G: np.ndarray


@dataclass(frozen=True)
class Classified:
    """What the hodographs of n members enclose: the axes at both ends (n,), and the crossings."""

    start_axis: np.ndarray
    end_axis: np.ndarray
    separation: np.ndarray
    crossings: Crossings


@dataclass(frozen=True)
class Reduction:
    """What n members come to: their final variables and steps (n, ...), and their labels or, where
    none apply, the columns of their events (n,); and the method that has integrated them."""

    final: Mapping[str, np.ndarray]
    steps: np.ndarray
    classified: Classified | None
    events: Mapping[str, np.ndarray]
    method: str = "taylor"


def event_columns(
    met: Sequence[Sequence[Occurrence]], start: np.ndarray | None, end: np.ndarray | None
) -> dict[str, np.ndarray]:
    """The columns of the events of n members; with the axes (n,) that are enclosed at their start
    and end, if the model knows them, those of their passages too."""
    last = [events[-1] if events else Occurrence("", math.nan) for events in met]
    found = {"event_time": np.array([event.time for event in last])}
    if start is None or end is None:
        return found
    for name in MEMBER_PASSED.keys() - MEMBER_CLASSIFIED.keys():
        detail = name.removeprefix("event_")
        found[name] = np.array([event.details.get(detail, math.nan) for event in last])
    crossings = [passages_as_crossings(events, math.nan) for events in met]
    none = Crossing(math.nan, 0, 0, math.nan, math.nan)
    first = [passed[0] if passed else none for passed in crossings]
    for name in ("crossing_time", "crossing_from", "crossing_to", "crossing_G"):
        field, _ = CROSSING_COLUMNS[name]
        found[name] = np.array([getattr(crossing, field) for crossing in first])
    found["crossings"] = np.array([len(passed) for passed in crossings])
    return found | {"start_axis": start, "end_axis": end}


def enter(values: Mapping[str, np.ndarray], at: np.ndarray, of: Reduction, time: Time) -> None:
    """Enter what members come to in the rows `at` of the columns."""
    for name in of.final.keys() & values.keys():
        values[name][at] = of.final[name]
    values["steps"][at] = of.steps
    if of.classified is None:
        for name, column in of.events.items():
            values[name][at] = column
        return
    found, crossings = of.classified, of.classified.crossings
    values["start_axis"][at], values["end_axis"][at] = found.start_axis, found.end_axis
    values["separation"][at] = found.separation
    values["crossings"][at] = np.bincount(crossings.member, minlength=len(at))
    values["share"][at] = shares(found, time)
    member, first = np.unique(crossings.member, return_index=True)
    names = ("time", "error", "from", "to", "G")
    for name, column in zip(names, crossings[1:], strict=True):
        values[f"crossing_{name}"][at[member]] = column[first]


def shares(found: Classified, time: Time) -> np.ndarray:
    """The part of the span (n, 3) for which each axis is enclosed."""
    n, crossings = len(found.start_axis), found.crossings
    member = np.concatenate((np.arange(n), crossings.member))
    # A start on D = 0 leaves it at once, for the axis that the motion keeps until it crosses.
    axis = found.start_axis.copy()
    on_it, (crossing, first) = axis == 0, np.unique(crossings.member, return_index=True)
    axis[on_it] = found.end_axis[on_it]
    axis[crossing] = np.where(on_it[crossing], crossings.start[first], axis[crossing])
    axis = np.concatenate((axis, crossings.end))
    begin = np.concatenate((np.full(n, time.start), crossings.time))
    order = np.lexsort((begin, member))
    member, axis, begin = member[order], axis[order], begin[order]
    last = np.diff(member, append=n) != 0
    end = np.where(last, time.end, np.roll(begin, -1))
    share = np.zeros((n, 3))
    known = (axis > 0) & (time.end > time.start)
    np.add.at(share, (member[known], axis[known] - 1), (end - begin)[known])
    return share / max(time.end - time.start, math.ulp(0.0))
