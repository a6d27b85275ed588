"""Sweeps that have grown: the members that an earlier result holds are taken over from it, and only
the others are computed."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, dump, parse_case
from ..cases.sweep_block import Axis, axes_of
from ..storage import FinishedCase, Group, open_run
from .columns import shape, stored_columns


@dataclass(frozen=True)
class Earlier:
    """An earlier result of a sweep that has grown since: its file, its name there, its attributes,
    and the lengths of the axes now.

    `indices` are those (n,) that the values along each axis have in the earlier result, -1 for new
    ones; of a sphere, how many directions that has, which are the first ones.
    """

    file: Path
    name: str
    attributes: Mapping[str, Any]
    sizes: tuple[int, ...]
    indices: tuple[np.ndarray | int, ...]

    def positions(self, first: int, last: int) -> np.ndarray:
        """Where the members `first` to `last` - 1 stand in the earlier result (axes, n), -1 along
        an axis that has no such value there."""
        index = np.unravel_index(np.arange(first, last), self.sizes)
        return np.array([
            np.where(i < before, i, -1) if isinstance(before, int) else before[i]
            for before, i in zip(self.indices, index, strict=True)
        ])  # fmt: skip

    def holds(self, first: int, last: int) -> np.ndarray:
        """Which of these members (n,) are in the earlier result."""
        return np.asarray((self.positions(first, last) >= 0).all(axis=0))

    def completed(self, case: Case, first: int, last: int, group: Group) -> Group:
        """The group of a chunk with the stored columns of the members that the earlier result
        holds. Raises HodoError if that cannot be read, or is another one by now."""
        taken = self.holds(first, last)
        if not taken.any():
            return group
        positions = self.positions(first, last)[:, taken]
        corner = positions.min(axis=1)
        box = tuple(map(slice, corner, positions.max(axis=1) + 1))
        variables = dict(group.variables)
        with open_run(self.file) as run:
            # Another run may have grown it too: its members then have other positions.
            if run.summary(self.name, ("hash",))["hash"] != self.attributes["hash"]:
                raise HodoError(f"{self.file}: another run has replaced {self.name}: run it again")
            for name, values in run.blocks(self.name, stored_columns(case), box):
                data = variables[name].data.copy()
                data[taken] = values[tuple(positions - corner[:, None])]
                variables[name] = replace(variables[name], data=data)
        return replace(group, variables=variables)


def earlier_result(case: Case, case_digest: str, stored: FinishedCase | None) -> Earlier | None:
    """The stored result of a sweep to which it only adds values and directions, if all of that
    ended well and was computed by the same code; else None."""
    if stored is None or stored.damage or stored.attributes.get("status") != "ok":
        return None
    # Of the digests of code, libraries and case, the first two.
    code, stored_code = (
        digests.split("-")[:2] for digests in (case_digest, str(stored.attributes.get("hash")))
    )
    if code != stored_code:
        return None
    before = parse_case(str(stored.attributes["case"]))
    if before.sweep is None or case.sweep is None or [*before.sweep] != [*case.sweep]:
        return None
    if dump(replace(before, sweep=case.sweep), remarks=False) != dump(case, remarks=False):
        return None
    pairs = zip(axes_of(case.sweep), axes_of(before.sweep), strict=True)
    indices = [earlier_indices(*axes) for axes in pairs]
    known = tuple(of_axis for of_axis in indices if of_axis is not None)
    if len(known) < len(indices):
        return None
    with open_run(stored.file) as run:
        attributes = run.summary(stored.name)
    return Earlier(stored.file, stored.name, attributes, shape(case), known)


def earlier_indices(axis: Axis, before: Axis) -> np.ndarray | int | None:
    """The entry of `Earlier.indices` for an axis; None if the earlier one has other keys, or a
    value that is not on it any more."""
    if axis.sphere is not None and before.sphere is not None:
        is_prefix = axis.sphere["seed"] == before.sphere["seed"] and len(before) <= len(axis)
        return len(before) if is_prefix else None
    if axis.sphere or before.sphere or axis.keys != before.keys:
        return None
    # To the last bit: half the step of a linspace has the values of the whole one.
    positions = {values: i for i, values in enumerate(values_along(before))}
    indices = np.array([positions.get(values, -1) for values in values_along(axis)])
    return indices if len({*indices.tolist()} - {-1}) == len(before) else None


def values_along(axis: Axis) -> Iterator[tuple[float, ...]]:
    """The values of all keys of an axis, position by position."""
    return zip(*(axis.values(i).tolist() for i in range(len(axis.keys))), strict=True)
