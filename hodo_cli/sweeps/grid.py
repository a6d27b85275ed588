"""A sweep as the group of a result file, with its axes as dimensions."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ..cases.case import Case
from ..cases.keys import keys_of
from ..cases.sweep_block import axes_of, path_of
from ..engines.protocol import EPS, Status
from ..integration.solve import sample_times
from ..results.layout import TIME, Stored, case_attributes, inner_coordinates, with_units
from ..storage.group import Attribute, Group, StreamedVariables, Variable
from .chunk import Chunk, reason_alone
from .columns import lengths, shape, stored_columns
from .ensemble.motions import Rejection
from .summary import Summary


def group_of_columns(
    case: Case, case_digest: str, tasks: list[Chunk], finished: Callable[[Chunk], Group],
    summary: Summary,
    errors: Mapping[str, Any], problems: Mapping[str, int],
) -> Group:  # fmt: skip
    """The sweep as it is stored; its variables are filled in from the chunks when it is written."""
    attributes = sweep_attributes(case, case_digest, summary, problems)
    sizes = shape(case)
    names = [axis.name for axis in axes_of(case.sweep or {})]
    variables = coordinates(case)
    for name, column in stored_columns(case).items():
        # The shape and type of an array without its memory: a zero that stands everywhere.
        zero, inner = np.zeros((), dtype=column.dtype), lengths(case, column)
        outline = np.broadcast_to(zero, (*sizes, *inner))
        variables[name] = Variable((*names, *column.dims), outline, column.attrs)
    variables |= inner_coordinates(variables.values())

    def fill() -> Iterator[tuple[str, Any, np.ndarray]]:
        for task in tasks:
            where = box(sizes, task.first, task.last)
            group = finished(task)
            for name in stored_columns(case):
                data = group.variables[name].data
                outline = (*(corner.stop - corner.start for corner in where), *data.shape[1:])
                yield name, where, data.reshape(outline)

    variables = with_units(variables, case)
    return Group(
        {**attributes, **errors},
        variables,
        StreamedVariables(frozenset(stored_columns(case)), fill),
    )


def sweep_attributes(
    case: Case, case_digest: str, summary: Summary, problems: Mapping[str, int]
) -> dict[str, Attribute]:
    """The attributes of a sweep, without those of its errors."""
    ok, failed, timeout, invalid, hidden = summary.status.tolist()
    total = sum(summary.status.tolist())
    remarks = (
        (invalid, "are no body or have no start"),
        (hidden, "are undecided: their error is larger than their distance from the separatrix"),
        *((n, f"have no measured error: {why}") for why, n in summary.unmeasured.items()),
    )
    messages = [f"{count} of {total} members: {message}" for message, count in problems.items()]
    messages += [
        f"{n} of {total} members {outcome}"
        for n, outcome in ((failed, "failed"), (timeout, "ran out of time"))
        if n
    ]
    alone = summary.alone[1:].sum()
    named = zip(summary.alone.tolist(), Rejection, strict=True)
    why = "; ".join(f"{count}: {rejection}" for count, rejection in named if rejection and count)
    return case_attributes(
        case,
        case_digest,
        method=", ".join(sorted(summary.methods)) or case.method,
        method_reason=f"each by itself: {reason}"
        if (reason := reason_alone(case))
        else f"side by side, {alone} of {total} members by themselves" + f" ({why})" * bool(why),
        members=total,
        tol=case.tol or EPS,
        steps=summary.steps,
        run_time=summary.run_time,
        error=math.nan,
        error_kind="none",
        status=ending(ok + hidden, failed, timeout),
        message="; ".join(messages) or ("" if ok + hidden else "no member is a body with a start"),
        warnings="\n".join(f"{n} of {total} members {outcome}" for n, outcome in remarks if n),
    )


def coordinates(case: Case) -> dict[str, Variable]:
    """The values along each axis; of a sphere, the directions."""
    variables: dict[str, Variable] = {}
    for axis in axes_of(case.sweep or {}):
        numbers = np.arange(len(axis))
        if axis.sphere is not None:
            directions = Stored("direction of G at the start", (axis.name, "axis"))
            variables[f"{axis.name}_vector"] = directions.holding(axis.directions(numbers))
        elif axis.keys == [axis.name]:
            variables[axis.name] = Stored(
                axis.name, (axis.name,), units=stated_unit(case, axis.name)
            ).holding(axis.values(0))
        else:
            for i, key in enumerate(axis.keys):
                stored = Stored(key, (axis.name,), units=stated_unit(case, key))
                variables[key] = stored.holding(axis.values(i))
    if "trajectory" in case.store:
        variables["time"] = TIME.holding(sample_times(case))
    return variables


def stated_unit(case: Case, name: str) -> str:
    """The unit of a swept key, in words; none of an angle, which may be given in degrees."""
    keys, unit = keys_of(case.model, case.form)[1], "1"
    for key in path_of(name):
        if key in keys:
            unit = keys[str(key)].unit
            keys = getattr(keys[str(key)].kind, "keys", {})
    return "1" if unit == "rad" else unit


def ending(ok: int, failed: int, timeout: int) -> Status:
    """The status of a sweep of which so many members ended in each way: that of the worst."""
    if failed or not ok:
        return Status.FAILED
    return Status.TIMEOUT if timeout else Status.OK


def box(sizes: tuple[int, ...], first: int, last: int) -> tuple[slice, ...]:
    """The box of the members `first` to `last` - 1 in an array of these sizes, as a slice of each
    axis."""
    corners = zip(np.unravel_index(first, sizes), np.unravel_index(last - 1, sizes), strict=True)
    return tuple(slice(int(low), int(high) + 1) for low, high in corners)
