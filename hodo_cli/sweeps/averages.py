"""Averages over the members of a sweep. Numbers only."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import HodoError
from ..results.motion import Array
from ..storage.group import Variable


def distance_of_sweeps(
    variables: Mapping[Any, Array], others: Mapping[Any, Array], variable: str, against: str
) -> dict[str, Array]:
    """A variable of one sweep as its distance from one of another sweep of the same axes; for
    labels, 1 where they differ. Members count where both are ok.

    Raises HodoError unless the sweeps have them, over as many members.
    """
    for columns, name in ((variables, variable), (others, against)):
        if name not in columns:
            raise HodoError(f"the sweep has no variable {name!r} (it has: {', '.join(columns)})")
    a, b = variables[variable], others[against]
    if a.data.shape != b.data.shape:
        raise HodoError(f"the sweeps have {a.data.shape} and {b.data.shape} values of {variable!r}")
    label = "flag_meanings" in a.attrs
    distance = (a.data != b.data).astype(float) if label else np.abs(a.data - b.data)
    status = np.maximum(variables["status"].data, others["status"].data)
    return {
        variable: Variable(a.dims, distance, {}),
        "status": Variable(variables["status"].dims, status, {}),
    }


def average(
    variables: Mapping[Any, Array],
    axes: Sequence[str],
    variable: str,
    keep: Sequence[str],
    positions: Mapping[str, int],
) -> np.ndarray:
    """A variable over the axes to `keep`, at fixed `positions` on others, averaged over all further
    axes; nan where no member counts.

    `share.x1` is a component; `end_axis.x1` is 1 where the label is x1 and 0 where it is another,
    so that its average is a share of members. Members whose status is not ok do not count. Raises
    HodoError if there is no such variable, axis or position.
    """
    data, label = numbers(variables, axes, variable)
    for axis, i in positions.items():
        if axis not in axes or not i < data.shape[axes.index(axis)]:
            raise HodoError(
                f"the sweep has no position {i} on an axis {axis!r} (its axes: {', '.join(axes)})"
            )
    # Members that failed hold nan or 0, and 0 is a label.
    data = np.where(variables["status"].data == 0, data, np.nan)[
        tuple(positions.get(axis, slice(None)) for axis in axes)
    ]
    free = [axis for axis in axes if axis not in positions]
    averaged = tuple(i for i, axis in enumerate(free) if axis not in keep)
    if averaged and label:
        shares = ", ".join(f"{variable}.{word}" for word in label)
        raise HodoError(f"{variable} is a label, without a mean: name a share, {shares}")
    counted = np.isfinite(data).sum(axis=averaged)
    total = np.nansum(data, axis=averaged)
    # Not nanmean, which warns on stderr where nothing is left to average.
    means = np.divide(total, counted, out=np.full(np.shape(total), np.nan), where=counted > 0)
    # The means stand in the order of the sweep's axes, and are asked for in that of `keep`.
    return np.asarray(
        np.transpose(means, np.argsort(np.argsort([free.index(axis) for axis in keep])))
    )


def numbers(
    variables: Mapping[Any, Array], axes: Sequence[str], variable: str
) -> tuple[np.ndarray, list[str]]:
    """A variable, component or share over all axes, and the words of a label: none of a number.

    Raises HodoError as `average` does.
    """
    name, _, word = variable.partition(".")
    if name not in variables or not set(axes) <= set(variables[name].dims):
        stored = [str(key) for key, column in variables.items() if set(axes) <= set(column.dims)]
        raise HodoError(f"the sweep has no variable {name!r} (it has: {', '.join(stored)})")
    column = variables[name]
    dims, data, attributes = column.dims, column.data, column.attrs
    words = str(attributes.get("flag_meanings", "")).split()
    components = ["x1", "x2", "x3"] if dims == (*axes, "axis") else []
    if word in words:
        return data == np.asarray(attributes["flag_values"])[words.index(word)], []
    if word in components:
        return data[..., components.index(word)], []
    if word or dims != tuple(axes):
        has = ", ".join(f"{name}.{choice}" for choice in words or components) or name
        raise HodoError(f"the sweep has no {variable!r}: it has {has}")
    return data, words
