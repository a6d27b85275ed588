"""A sweep for figures: its axes from the coordinates of its dataset, and its variables over some of
the axes."""

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
"""The keys that change a motion, but not the formulas by which quantities follow from its
variables."""

OF_SEPARATRIX = {*MEMBER_CLASSIFIED, "event_from"}
"""The variables of a sweep that depend on the sign of D."""

EQUAL_STEPS = 1e-9
"""The largest relative difference at which steps or ratios along an axis count as equal."""


def in_even_ratios(values: np.ndarray) -> bool:
    """Whether values (n,) have equal ratios but unequal steps. Two values have both equal, so they
    do not."""
    if len(values) < 3 or (values <= 0).any():
        return False
    steps, ratios = np.diff(values), np.diff(np.log(values))
    uneven = np.ptp(steps) > EQUAL_STEPS * np.abs(steps).max()
    return bool(uneven and np.ptp(ratios) <= EQUAL_STEPS * np.abs(ratios).max())


def same_values(a: "xr.DataArray | None", b: "xr.DataArray | None") -> bool:
    """Whether two sweeps have the same coordinate along an axis, to rounding. None stands for a
    coordinate that a sweep lacks."""
    if a is None or b is None or a.sizes != b.sizes:
        return False
    return np.allclose(a.data, b.transpose(*a.dims).data, rtol=EQUAL_STEPS, atol=0)


@dataclass(frozen=True)
class SweepView:
    """A sweep: the name of its case, the case, and its dataset. The axes of the sweep are its first
    dimensions, `time` and `axis` its last."""

    name: str
    case: Case
    data: "xr.Dataset"

    @classmethod
    def of(cls, name: str, data: "xr.Dataset") -> "SweepView":
        """The sweep in a dataset, under the name of its case. Raises HodoError if the parts of the
        dataset do not fit together."""
        owner = f"case {name}"
        case, data = case_in(data, owner), ordered(data, owner)
        check_whole(data.variables, owner, is_sweep=True)
        return cls(name, case, data)

    @cached_property
    def axes(self) -> dict[str, int]:
        """The lengths of the axes by name, in order."""
        return {name: self.data.sizes[name] for name in sweep_axes(self.data)}

    def keys(self, name: str) -> list[str]:
        """The coordinates that vary along this axis alone, swept keys first; figures show the first
        one."""
        named = [*swept_names(self.data), *map(str, self.data.coords)]
        along = [key for key in named if self.data.variables[key].dims == (name,)]
        return list(dict.fromkeys(along))

    def body(self) -> np.ndarray | None:
        """A1, A2, A3 if all members have the same body, with a separatrix and with body axes that
        are its principal axes; else None."""
        varied = [path_of(key)[0] for axis in self.axes for key in self.keys(axis)]
        body = self.case.system
        # A separatrix is drawn on the sphere only where all members share one.
        if "inertia" in varied or not isinstance(body, BodyFrame):
            return None
        is_plain = body.principal_axes is None and not body.no_separatrix_reason
        return body.moments if is_plain else None

    def at(self, positions: Mapping[str, int]) -> Case:
        """The case with the values of the sweep at these positions along some axes."""
        return case_in(self.data[swept_names(self.data)].isel(positions), f"case {self.name}")

    def undivided(self, variable: str) -> str:
        """Why a variable about enclosed axes or crossings has no meaning in this sweep: no
        separatrix divides its motions. Empty for a variable that has a meaning."""
        name = variable.partition(".")[0]
        return self.case.system.no_separatrix_reason if name in OF_SEPARATRIX else ""

    @property
    def sphere(self) -> str:
        """The name of the axis that is a sphere of directions; empty without such an axis."""
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
        count, except for the status itself; members without an axis do not count in the share of an
        axis. Raises HodoError if there is no such variable, axis or position.
        """
        column, label = self._numbers(variable)
        for axis, i in {**dict.fromkeys(keep, 0), **at}.items():
            if not i < self.axes.get(axis, 0):
                has = f"its axes: {', '.join(self.axes)}"
                raise HodoError(f"the sweep has no position {i} on an axis {axis!r} ({has})")
        averaged = [axis for axis in self.axes if axis not in (*keep, *at)]
        if averaged and label:
            shares = ", ".join(f"{variable}.{word}" for word in label)
            raise HodoError(f"{variable} is a label, without a mean: name a share, {shares}")
        return np.asarray(self._counted(column).isel(at).mean(averaged).transpose(*keep).data)

    def left_out(self, variable: str, at: Mapping[str, int]) -> tuple[int, int]:
        """How many members at fixed positions do not count in an average of a variable, and how
        many members there are in all. Raises HodoError as `values` does."""
        column, _ = self._numbers(variable)
        missing = self._counted(column).isel(at).isnull()
        return int(missing.sum()), missing.size

    def _counted(self, column: "xr.DataArray") -> "xr.DataArray":
        """A column with nan for the members whose status is not ok. The stored column has nan or 0
        there, and 0 is also a label."""
        all_count = column.name == "status" or "status" not in self.data
        return column.where(True if all_count else self.data["status"] == 0)

    def _numbers(self, variable: str) -> tuple["xr.DataArray", list[str]]:
        """A variable, component or share over all axes, and the words of a label (none for a
        number). The values are repeated along axes that the stored variable does not have."""
        name, _, word = variable.partition(".")
        column = self.variable(name)
        column = column.expand_dims({a: n for a, n in self.axes.items() if a not in column.dims})
        words = str(column.attrs.get("flag_meanings", "")).split()
        labels = dict(zip(words, column.attrs.get("flag_values", ()), strict=False))
        dim = next((str(dim) for dim in column.dims if dim in PARTS), "")
        # Components are found by their coordinate, in any order.
        components = [*map(str, column[dim].data)] if dim else []
        if word in labels:
            # In the share of an axis only members that have an axis count.
            counts = (column > 0) | (labels[word] <= 0)
            return (column == labels[word]).where(counts), []
        if word in components:
            return column.isel({dim: components.index(word)}), []
        # A variable with components needs the name of one.
        if word or set(column.dims) > self.axes.keys():
            has = ", ".join(f"{name}.{choice}" for choice in words or components) or name
            raise HodoError(f"the sweep has no {variable!r}: it has {has}")
        return column.astype(float), words

    def variable(self, name: str) -> "xr.DataArray":
        """A stored variable, or a quantity that follows from stored variables. Raises HodoError if
        there is none of this name."""
        if name not in self.data and name in QUANTITIES:
            return self.derived(name)
        if name not in self.data:
            has = [str(key) for key, v in self.data.items() if self.axes.keys() <= {*v.dims}]
            raise HodoError(f"the sweep has no variable {name!r} (it has: {', '.join(has)})")
        return self.data[name]

    @cached_property
    def ends(self) -> list[str]:
        """The variables at the ends of the members: those without samples in time."""
        return [str(key) for key, v in self.data.variables.items() if "time" not in v.dims]

    @cached_property
    def sources(self) -> set[str]:
        """The variables and constants of the sweep from which quantities can follow."""
        return {*self.ends} | constants_of(self.case.system, self.case.data)

    def derived(self, name: str) -> "xr.DataArray":
        """A quantity at the ends of the members, computed from their stored variables.

        Raises HodoError if the sweep lacks a variable, a constant or a coordinate that it needs.
        """
        if message := lack_of(self.case, name, self.sources, name):
            raise HodoError(message)
        swept = [key for axis in axes_of(self.case.sweep or {}) for key in axis.keys]
        if missing := [key for key in swept if key not in self.data.variables]:
            which = f"{missing[0]!r}, which its members vary in"
            raise HodoError(f"sweep {self.name} has no coordinate {which}")
        parts = [len(PARTS[dim]) for dim in QUANTITIES[name].dims[1:]]
        blank = np.full((*self.axes.values(), *parts), np.nan)
        values = quantity_array(name, blank, [*self.axes], self.case)
        # Bodies are computed one by one, and all members of one body at once.
        bodies = [
            axis
            for axis in self.axes
            if any(path_of(key)[0] not in KEYS_OF_MOTION for key in self.keys(axis))
        ]
        for index in np.ndindex(*(self.axes[axis] for axis in bodies)):
            at = dict(zip(bodies, index, strict=True))
            values[at] = self._of_one_body(name, at, values[at])
        return values

    def _of_one_body(self, name: str, at: Mapping[str, int], blank: "xr.DataArray") -> np.ndarray:
        """The values of a quantity for the members of one body, at these positions of the axes that
        change the body, along all other axes. Members without finite variables keep the values of
        `blank`."""
        others = [axis for axis in self.axes if axis not in at]
        # A formula takes the samples of one motion: here each member stands for a sample.
        members = self.data[self.ends].isel(at).expand_dims("body")
        members = members.stack(time=["body", *others], create_index=False).transpose("time", ...)
        n = members.sizes["time"]
        members = members.assign_coords(time=("time", np.full(n, self.case.time.end)))
        needed = {x for needs in QUANTITIES[name].needs for x in needs} & {*members}
        stored = [np.asarray(members[x]).reshape(n, -1) for x in needed]
        known = np.flatnonzero(np.isfinite(np.concatenate(stored, axis=1)).all(axis=1))
        values = blank.data.reshape(n, *blank.shape[len(others) :]).copy()
        if known.size:
            motion = Motion(self.at(at), members.isel(time=known).variables)
            values[known] = QUANTITIES[name].formula(motion)
        return np.asarray(values.reshape(blank.shape))

    def distance(self, other: "SweepView", variable: str, against: str) -> "SweepView":
        """This sweep with a variable replaced by its distance from a variable of another sweep that
        has the same axes, in any order. For labels it is 1 where they differ. A member counts where
        both sweeps have the status ok.

        Raises HodoError if a sweep lacks its variable, or if the values along an axis or the sizes
        differ.
        """
        mine, theirs = (
            {key: x for key, x in view.data.coords.items() if {*x.dims} & {*view.axes}}
            for view in (self, other)
        )
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
        status = np.maximum(*by_axis)  # 0, which is ok, where both are ok
        changed = {variable: (a.dims, apart.astype(float)), "status": ([*self.axes], status)}
        return replace(self, data=self.data.assign(changed))

    def sorted_along(self, *names: str) -> "SweepView":
        """The sweep with the values along some axes in ascending order; an axis with descending
        values stays as it is.

        Raises HodoError if a value then occurs twice, because members of several sweeps make no
        single curve.
        """
        data = self.data
        for name in names:
            values, _ = self.ticks(name)
            if (np.diff(values) > 0).any():
                data = sorted_along(data, name, values, f"sweep {self.name}")
        return replace(self, data=data)

    def ticks(self, name: str) -> tuple[np.ndarray, bool]:
        """The values (n,) of the first key along an axis, or of a key itself, and whether they have
        equal ratios.

        Raises HodoError if there are no finite numbers.
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
