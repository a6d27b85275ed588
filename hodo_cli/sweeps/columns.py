"""What is stored of the members of a sweep, one column each."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..cases.case import Case, Time
from ..cases.sweep_block import axes_of
from ..integration import Crossing, Occurrence
from ..models.base import LENGTHS
from ..models.rigid_body import UNDETERMINED
from ..results.layout import (
    CROSSING_COLUMNS,
    MEMBER,
    MEMBER_CLASSIFIED,
    MEMBER_EVENT,
    MEMBER_PASSED,
    MEMBER_STOPPED,
    ON_REQUEST,
    Stored,
    columns_of,
    passages_as_crossings,
)


def columns(case: Case) -> dict[str, Stored]:
    """All columns to which the members of a sweep are reduced: the variables at the end or, where
    trajectories are stored, at every sample."""
    model, is_sampled = case.system, "trajectory" in case.store
    words, first = ("", 0) if is_sampled else (", at the end", 1)
    final = {
        name: Stored(f"{variable.long_name}{words}", variable.dims[first:], units=variable.units)
        for name, variable in model.variables.items()
        if is_sampled or name != "enclosed_axis"  # as a label at the end it is `end_axis`
    }
    reduced = MEMBER_CLASSIFIED | (MEMBER_STOPPED if model.may_stop else {})
    if model.no_axis_reason:
        reduced = MEMBER_EVENT | (MEMBER_PASSED if "enclosed_axis" in model.variables else {})
    return final | reduced | MEMBER


def stored_columns(case: Case) -> dict[str, Stored]:
    """The columns that are stored in the result."""
    asked = set(case.store) - {"trajectory"}
    if asked and "trajectory" in case.store:
        asked |= set(case.system.variables)  # whose samples are the trajectory
    return {
        name: column
        for name, column in columns(case).items()
        if name == "status" or (name in asked if asked else name not in ON_REQUEST)
    }


def lengths(case: Case, column: Stored) -> tuple[int, ...]:
    """The lengths of a column's dimensions, for one member."""
    return tuple(case.time.samples if dim == "time" else LENGTHS[dim] for dim in column.dims)


def blank_array(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """An array without a value: nan, or 0 where numbers are whole."""
    return np.full(shape, 0 if np.dtype(dtype).kind == "i" else np.nan, dtype)


def shape(case: Case) -> tuple[int, ...]:
    """The length of each axis."""
    assert case.sweep is not None
    return tuple(len(axis) for axis in axes_of(case.sweep))


def stored_bytes(case: Case) -> int:
    """The bytes that a sweep takes in its result."""
    return math.prod(shape(case)) * sum(
        np.dtype(column.dtype).itemsize * math.prod(lengths(case, column))
        for column in stored_columns(case).values()
    )


def event_columns(events: Mapping[int, Sequence[Occurrence]], n: int) -> dict[str, np.ndarray]:
    """The columns of the last events of n members, by the positions of members that have some."""
    last = {row: of_member[-1] for row, of_member in events.items() if of_member}

    def column(values: Iterable[float], blank: float = math.nan) -> np.ndarray:
        filled = np.full(n, blank)
        filled[[*last]] = [*values]
        return filled

    filled = {"event_time": column(event.time for event in last.values())}
    for name in MEMBER_PASSED.keys() - MEMBER_CLASSIFIED.keys():
        detail = name.removeprefix("event_")
        filled[name] = column(event.details.get(detail, math.nan) for event in last.values())
    axis = (event.details.get("from", UNDETERMINED) for event in last.values())
    return filled | {"event_from": column(axis, UNDETERMINED)}


def passage_columns(
    events: Mapping[int, Sequence[Occurrence]],
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The member (k,) of each event that takes an averaged motion to another axis, and these as
    columns of crossings, from the events of members by their positions."""
    passages = {row: passages_as_crossings(of_member) for row, of_member in events.items()}
    member = [row for row, crossings in passages.items() for _ in crossings]
    listed = [crossing for crossings in passages.values() for crossing in crossings]
    return np.array(member, dtype=np.int64), crossing_arrays(listed)


def crossing_arrays(crossings: Sequence[Crossing]) -> dict[str, np.ndarray]:
    """Crossings as arrays (k,) by the names of CROSSING_COLUMNS."""
    return {name: x.data for name, x in columns_of(CROSSING_COLUMNS, crossings).items()}


def label_columns(
    start: np.ndarray,
    end: np.ndarray,
    member: np.ndarray,
    crossings: Mapping[str, np.ndarray],
    stop: np.ndarray,
    time: Time,
) -> dict[str, np.ndarray]:
    """The columns of the labels of n members, with the first crossing of each.

    `start` and `end` (n,) are the axes that they enclose at both ends, `crossings` (k,) by the
    names of their columns those of the members `member` (k,), in order of time, and `stop` (n,) the
    times at which members stop, nan where they do not.
    """
    n = len(start)
    filled = {
        "start_axis": start,
        "end_axis": end,
        "crossings": np.bincount(member, minlength=n),
        "share": shares(start, end, member, crossings, np.fmin(stop, time.end), time),
    }
    crossing, first = np.unique(member, return_index=True)
    for name, values in crossings.items():
        filled[name] = blank_array((n,), values.dtype)
        filled[name][crossing] = values[first]
    return filled


def shares(
    start: np.ndarray,
    end: np.ndarray,
    member: np.ndarray,
    crossings: Mapping[str, np.ndarray],
    turning_until: np.ndarray,
    time: Time,
) -> np.ndarray:
    """The part of the span (n, 3) for which each axis is enclosed, by members that turn until some
    times (n,); other arguments as `label_columns`."""
    n, (crossing, first) = len(start), np.unique(member, return_index=True)
    # A start on D = 0 leaves it at once, for the axis that the motion keeps until it crosses.
    kept = end.copy()
    kept[crossing] = crossings["crossing_from"][first]
    # The stretches of one axis, of all members: each begins with the motion, or with a crossing.
    owner = np.concatenate((np.arange(n), member))
    axis = np.concatenate((np.where(start == 0, kept, start), crossings["crossing_to"]))
    begin = np.concatenate((np.full(n, time.start), crossings["crossing_time"]))
    order = np.lexsort((begin, owner))
    owner, axis, begin = owner[order], axis[order], begin[order]
    is_last = np.diff(owner, append=n) != 0
    until = np.where(is_last, turning_until[owner], np.roll(begin, -1))
    share = np.zeros((n, 3))
    is_one = (axis > 0) & (axis <= 3) & (time.end > time.start)
    np.add.at(share, (owner[is_one], axis[is_one] - 1), (until - begin)[is_one])
    return share / max(time.end - time.start, math.ulp(0.0))
