"""A sweep as figures read it: its axes by the coordinates of its dataset, and any of its variables
over some of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..cases.sweep_block import axes_of, path_of
from ..models.rigid_body import BodyFrame
from ..quantities import BODY_AXES, PARTS, QUANTITIES, constants_of, lack_of
from ..results.dataset import (
    case_in,
    ordered,
    quantity_array,
    sorted_along,
    sweep_axes,
    swept_names,
)
from ..results.layout import MEMBER_CLASSIFIED
from ..results.motion import Motion, check_whole

if TYPE_CHECKING:
    import xarray as xr

KEYS_OF_MOTION = ("initial", "attitude", "damping", "resistance")
"""The keys that change a motion and not what follows from its variables."""

OF_SEPARATRIX = {*MEMBER_CLASSIFIED, "event_from"}
"""The variables of a sweep that rest on the sign of D."""

EQUAL_STEPS = 1e-9
"""How much, relative to them, steps or ratios along an axis may differ that count as even."""


def in_even_ratios(values: np.ndarray) -> bool:
    """Whether values (n,) go in even ratios and not in even steps; two alone do both."""
    if len(values) < 3 or (values <= 0).any():
        return False
    steps, ratios = np.diff(values), np.diff(np.log(values))
    uneven = np.ptp(steps) > EQUAL_STEPS * np.abs(steps).max()
    return bool(uneven and np.ptp(ratios) <= EQUAL_STEPS * np.abs(ratios).max())


def same_values(a: "xr.DataArray | None", b: "xr.DataArray | None") -> bool:
    """Whether what varies along an axis is the same in two sweeps, to rounding."""
    if a is None or b is None or a.sizes != b.sizes:
        return False
    return np.allclose(a.data, b.transpose(*a.dims).data, rtol=EQUAL_STEPS, atol=0)


@dataclass(frozen=True)
class SweepView:
    """A sweep: the name of its case, the case, and its dataset, whose last dimensions are `time`
    and `axis`."""

    name: str
    case: Case
    data: "xr.Dataset"

    @classmethod
    def of(cls, name: str, data: "xr.Dataset") -> "SweepView":
        """The sweep in a dataset. Raises HodoError if what it holds does not fit together."""
        owner = f"case {name}"
        case, data = case_in(data, owner), ordered(data, owner)
        check_whole(data.variables, owner, is_sweep=True)
        return cls(name, case, data)

    @cached_property
    def axes(self) -> dict[str, int]:
        """The lengths of the axes by name, in order."""
        return {name: self.data.sizes[name] for name in sweep_axes(self.data)}

    @property
    def coordinates(self) -> dict[str, "xr.DataArray"]:
        """What varies along the axes, by name."""
        named = {str(key): values for key, values in self.data.coords.items()}
        return {key: values for key, values in named.items() if {*values.dims} & {*self.axes}}

    def keys(self, name: str) -> list[str]:
        """The coordinates that vary along an axis alone; the first is that which figures show."""
        named = [*swept_names(self.data), *map(str, self.data.coords)]
        along = [key for key in named if self.data.variables[key].dims == (name,)]
        return list(dict.fromkeys(along))

    def body(self) -> np.ndarray | None:
        """A1, A2, A3 if all members have the same body."""
        varied = [key for axis in self.axes for key in self.keys(axis)]
        # A separatrix is drawn on the sphere only where all members share one.
        if "inertia" not in self.case.data or any(path_of(key)[0] == "inertia" for key in varied):
            return None
        if not isinstance(body := self.case.system, BodyFrame):
            return np.array(self.case.data["inertia"], dtype=float)
        is_plain = body.principal_axes is None and not body.no_separatrix_reason
        return body.moments if is_plain else None

    def at(self, positions: Mapping[str, int]) -> Case:
        """The case with the values that vary along axes as they are at positions there."""
        return case_in(self.data[swept_names(self.data)].isel(positions), f"case {self.name}")

    def undivided(self, variable: str) -> str:
        """Why a variable about enclosed axes and crossings says nothing, where no separatrix
        divides the motions by the sign of D; else an empty text."""
        name = variable.partition(".")[0]
        return self.case.system.no_separatrix_reason if name in OF_SEPARATRIX else ""

    @property
    def sphere(self) -> str:
        """The name of the axis that is a sphere of directions; empty if none is."""
        return next((name for name in self.axes if f"{name}_vector" in self.data), "")

    def directions(self) -> np.ndarray:
        """The directions (n, 3) of G at the start along the sphere.

        Raises HodoError if they lack a component.
        """
        vector = self.data[f"{self.sphere}_vector"].transpose(self.sphere, "axis")
        if tuple(vector["axis"].data) != BODY_AXES:
            raise HodoError(f"the directions of sweep {self.name} lack a component")
        return np.asarray(vector.data)

    def values(self, variable: str, keep: Sequence[str], at: Mapping[str, int]) -> np.ndarray:
        """A variable over the axes to `keep`, at fixed positions on others, averaged over all
        further axes; nan where no member counts.

        `share.x1` is a component; `end_axis.x1` is 1 where the label is x1 and 0 where it is
        another, so that its average is a share of members. Members whose status is not ok do not
        count, but for the status itself, nor do those without an axis in the share of one. Raises
        HodoError if there is no such variable, axis or
        position.
        """
        column, label = self._numbers(variable)
        for axis, i in {**dict.fromkeys(keep, 0), **at}.items():
            if not i < self.axes.get(axis, 0):
                its_axes = ", ".join(self.axes)
                message = (
                    f"the sweep has no position {i} on an axis {axis!r} (its axes: {its_axes})"
                )
                raise HodoError(message)
        averaged = [axis for axis in self.axes if axis not in (*keep, *at)]
        if averaged and label:
            shares = ", ".join(f"{variable}.{word}" for word in label)
            raise HodoError(f"{variable} is a label, without a mean: name a share, {shares}")
        return np.asarray(self._counted(column).isel(at).mean(averaged).transpose(*keep).data)

    def left_out(self, variable: str, at: Mapping[str, int]) -> tuple[int, int]:
        """How many of the members at fixed positions do not count in an average of a variable, and
        how many there are. Raises HodoError as `values` does."""
        column, _ = self._numbers(variable)
        missing = self._counted(column).isel(at).isnull()
        return int(missing.sum()), missing.size

    def _counted(self, column: "xr.DataArray") -> "xr.DataArray":
        """A column with nan for members that failed: they hold nan or 0, and 0 is a label."""
        all_count = column.name == "status" or "status" not in self.data
        return column.where(True if all_count else self.data["status"] == 0)

    def _numbers(self, variable: str) -> tuple["xr.DataArray", list[str]]:
        """A variable, component or share over all axes, the same along one that it does not have,
        and the words of a label: none of a number."""
        name, _, word = variable.partition(".")
        column = self.variable(name)
        column = column.expand_dims({a: n for a, n in self.axes.items() if a not in column.dims})
        words = str(column.attrs.get("flag_meanings", "")).split()
        labels = dict(zip(words, column.attrs.get("flag_values", ()), strict=False))
        dim = next((str(dim) for dim in column.dims if dim in PARTS), "")
        # By their coordinate, wherever they stand.
        components = [*map(str, column[dim].data)] if dim else []
        if word in labels:
            # Of an axis only a member that has one says yes or no.
            counts = (column > 0) | (labels[word] <= 0)
            return (column == labels[word]).where(counts), []
        if word in components:
            return column.isel({dim: components.index(word)}), []
        if word or set(column.dims) > self.axes.keys():
            has = ", ".join(f"{name}.{choice}" for choice in words or components) or name
            raise HodoError(f"the sweep has no {variable!r}: it has {has}")
        return column.astype(float), words

    def variable(self, name: str) -> "xr.DataArray":
        """A stored variable, or a quantity that follows from those. Raises HodoError if there is
        none of this name."""
        if name not in self.data and name in QUANTITIES:
            return self.derived(name)
        if name not in self.data:
            has = [str(key) for key, v in self.data.items() if self.axes.keys() <= {*v.dims}]
            raise HodoError(f"the sweep has no variable {name!r} (it has: {', '.join(has)})")
        return self.data[name]

    @cached_property
    def ends(self) -> list[str]:
        """The variables at the ends of the members."""
        return [str(key) for key, v in self.data.variables.items() if "time" not in v.dims]

    @cached_property
    def sources(self) -> set[str]:
        """The variables and constants that it has for quantities to follow from."""
        return {*self.ends} | constants_of(self.case.system, self.case.data)

    def derived(self, name: str) -> "xr.DataArray":
        """A quantity at the ends of the members, by what is stored of them.

        Raises HodoError if the sweep lacks what it needs.
        """
        if message := lack_of(self.case, name, self.sources, name):
            raise HodoError(message)
        swept = (key for axis in axes_of(self.case.sweep or {}) for key in axis.keys)
        for key in (key for key in swept if key not in self.data.variables):
            raise HodoError(
                f"sweep {self.name} has no coordinate {key!r}, which its members vary in"
            )
        # Along an axis that changes the body, one body after the other; along all others at once.
        one_by_one = [
            axis
            for axis in self.axes
            if any(path_of(key)[0] not in KEYS_OF_MOTION for key in self.keys(axis))
        ]
        at_once = [axis for axis in self.axes if axis not in one_by_one]
        indices = np.ndindex(*(self.axes[axis] for axis in one_by_one))
        positions = (dict(zip(one_by_one, index, strict=True)) for index in indices)
        pieces = [self._quantity(name, at, at_once) for at in positions]
        order = [*one_by_one, *at_once]
        sizes = [self.axes[axis] for axis in order]
        values = np.array(pieces).reshape((*sizes, *pieces[0].shape[1:]))
        return quantity_array(name, values, order, self.case).transpose(*self.axes, ...)

    def _quantity(self, name: str, at: Mapping[str, int], others: Sequence[str]) -> np.ndarray:
        """A quantity of the members (n,) of one body, which stands at these positions,
        along all other axes; no number for one that has come to nothing."""
        # As the samples of a motion.
        members = self.data[self.ends].isel(at)
        if others:
            members = members.stack(time=others, create_index=False).transpose("time", ...)
        else:
            members = members.expand_dims("time")
        members = members.assign_coords(
            time=("time", np.full(members.sizes["time"], self.case.time.end))
        )
        needed = {x for needs in QUANTITIES[name].needs for x in needs} & {*members}
        stored = (np.asarray(members[x]).reshape(members.sizes["time"], -1) for x in needed)
        known = np.isfinite(np.concatenate([*stored], axis=1)).all(1)
        parts = [len(PARTS[dim]) for dim in QUANTITIES[name].dims[1:]]
        values = np.full((len(known), *parts), np.nan)
        if known.any():
            motion = Motion(self.at(at), members.isel(time=np.flatnonzero(known)).variables)
            values[known] = QUANTITIES[name].formula(motion)
        return values

    def distance(self, other: "SweepView", variable: str, against: str) -> "SweepView":
        """This sweep with a variable as its distance from one of another sweep of the same axes, in
        any order; for labels, 1 where they differ. Members count where both are ok.

        Raises HodoError unless the sweeps have them, over the same values along each axis.
        """
        mine, theirs = self.coordinates, other.coordinates
        for key in {**mine, **theirs}:
            if not same_values(mine.get(key), theirs.get(key)):
                raise HodoError(f"sweeps {self.name} and {other.name} have other values of {key}")
        a, b = self.variable(variable), other.variable(against)
        if dict(a.sizes) != dict(b.sizes):
            sizes = f"{dict(a.sizes)} and {dict(b.sizes)}"
            raise HodoError(f"the sweeps have {sizes} values of {variable!r} and {against!r}")
        b = b.transpose(*a.dims)
        apart = a.data != b.data if "flag_meanings" in a.attrs else np.abs(a.data - b.data)
        by_axis = (view.data["status"].transpose(*self.axes).data for view in (self, other))
        status = np.maximum(*by_axis)
        changed = {variable: (a.dims, apart.astype(float)), "status": ([*self.axes], status)}
        return replace(self, data=self.data.assign(changed))

    def sorted_along(self, *names: str) -> "SweepView":
        """The sweep with the values along some axes in order, ascending unless they descend.

        Raises HodoError if one then stands twice: members of several sweeps make no single curve.
        """
        data = self.data
        for name in names:
            values, _ = self.ticks(name)
            if (np.diff(values) > 0).any():
                data = sorted_along(data, name, values, f"sweep {self.name}")
        return replace(self, data=data)

    def ticks(self, name: str) -> tuple[np.ndarray, bool]:
        """The values (n,) along an axis, of the first of its keys and in its `unit`, or of a key,
        and whether they go in even ratios.

        Raises HodoError if it has no finite numbers.
        """
        key, variables = self.key(name), self.data.variables
        values = np.asarray(variables[key].data if key in variables else [math.nan])
        if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
            message = "no coordinate of finite numbers, which a scale needs"
            raise HodoError(f"axis {name} of sweep {self.name} has {message}")
        return values, in_even_ratios(values)

    def unit(self, name: str) -> str:
        """The unit of the values along an axis; empty if they have none."""
        stored = str(self.data.variables[self.key(name)].attrs.get("units", "1"))
        return "" if stored == "1" else stored

    def key(self, name: str) -> str:
        """The first key that varies along an axis."""
        return next(iter(self.keys(name)), name)
