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
from ..cases.figure_block import BODY_AXES
from ..cases.sweep_block import path_of, put
from ..models.rigid_body import BodyFrame
from ..results.dataset import case_in, ordered, sweep_axes, swept_names
from ..results.motion import wrong_labels
from ..storage.group import Variable
from .averages import average

if TYPE_CHECKING:
    import xarray as xr

ANGLES = ("theta",)
"""The keys of cases that are angles."""


def round_degrees(angle: float) -> float | None:
    """The degrees of an angle in radians if they are a round number, in which it was given then;
    None if not. A case holds every angle in radians."""
    degrees = math.degrees(angle)
    rounded = round(degrees, 6)
    return rounded if abs(degrees - rounded) <= 4 * math.ulp(degrees) else None


EVEN = 1e-9
"""How much, relative to them, steps or ratios along an axis may differ that count as even."""


def in_even_ratios(values: np.ndarray) -> bool:
    """Whether values (n,) go in even ratios and not in even steps; two alone do both."""
    if len(values) < 3 or (values <= 0).any():
        return False
    steps, ratios = np.diff(values), np.diff(np.log(values))
    uneven = np.ptp(steps) > EVEN * np.abs(steps).max()
    return bool(uneven and np.ptp(ratios) <= EVEN * np.abs(ratios).max())


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
        if problem := wrong_labels(data.variables):
            raise HodoError(f"{owner} is damaged ({problem})")
        return cls(name, case, data)

    @cached_property
    def axes(self) -> dict[str, int]:
        """The lengths of the axes by name, in order."""
        return {name: self.data.sizes[name] for name in sweep_axes(self.data)}

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
        special = body.rotor_momentum is not None or body.principal_axes is not None
        return None if special else body.moments

    def at(self, name: str, i: int) -> Case:
        """The case with the values that vary along an axis as they are at a position."""
        data = self.case.data
        for key in swept_names(self.data):
            if self.data.variables[key].dims == (name,):
                data = put(data, path_of(key), float(self.data.variables[key].data[i]))
        return replace(self.case, data=data)

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
        """A variable over the axes to `keep`, averaged over those that are neither kept nor fixed;
        see `averages.average`."""
        name, _, component = variable.partition(".")
        column = self.data[name]
        if component and "axis" in column.dims:
            # By its coordinate, wherever it stands.
            column, variable = column.isel(axis=list(column["axis"].data).index(component)), name
        ok = self.data["status"] if "status" in self.data else 0 * column
        columns = {name: self._over_all(column), "status": self._over_all(ok)}
        return average(columns, list(self.axes), variable, keep, at)

    def _over_all(self, column: "xr.DataArray") -> Variable:
        """A variable over all axes in their order; the same along an axis that it does not have."""
        sizes = {axis: n for axis, n in self.axes.items() if axis not in column.dims}
        column = column.expand_dims(sizes).transpose(*self.axes, ...)
        return Variable(tuple(map(str, column.dims)), np.asarray(column.data), dict(column.attrs))

    def sorted_along(self, *names: str) -> "SweepView":
        """The sweep with the values along some axes in order, ascending unless they descend.

        Raises HodoError if one then stands twice: members of several sweeps make no single curve.
        """
        data = self.data
        for name in names:
            values = self.ticks(name)[0]
            steps = np.diff(values)
            if (steps >= 0).all() or (steps <= 0).all():
                continue
            order = np.argsort(values, kind="stable")
            if repeated := values[order][1:][np.diff(values[order]) == 0].tolist():
                message = (
                    f"axis {name} of sweep {self.name} has {repeated[0]:.6g} twice, out of order"
                )
                raise HodoError(message)
            data = data.isel({name: order})
        return replace(self, data=data)

    def ticks(self, name: str) -> tuple[np.ndarray, bool]:
        """The values (n,) along an axis, of the first of its keys and in its `unit`, and whether
        they go in even ratios.

        Raises HodoError if it has no finite numbers.
        """
        keys = self.keys(name)
        values = np.asarray(self.data.variables[keys[0]].data if keys else [math.nan])
        if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
            message = "no coordinate of finite numbers, which a scale needs"
            raise HodoError(f"axis {name} of sweep {self.name} has {message}")
        if self.unit(name) == "deg":
            # Without what the way to radians and back has added.
            values = np.round(np.degrees(values), 9)
        return values, in_even_ratios(values)

    def unit(self, name: str) -> str:
        """The unit of the values along an axis: that of its coordinate or, of an angle, degrees
        where it was given so and else radians."""
        variable = self.data.variables[(self.keys(name) or [name])[0]]
        if (stored := str(variable.attrs.get("units", "1"))) != "1":
            return stored
        if self.key(name).rpartition(".")[2] not in ANGLES or not variable.size:
            return ""
        ends = float(variable.data.min()), float(variable.data.max())
        return "rad" if None in map(round_degrees, ends) else "deg"

    def key(self, name: str) -> str:
        """The first key that varies along an axis."""
        return next(iter(self.keys(name)), name)
