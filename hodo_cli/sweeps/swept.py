"""A stored sweep as figures read it: its axes, and any of its variables over some of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..cases.sweep_block import Axis, axes_of
from ..results.motion import Array, case_of
from ..schema.kinds import nearest
from ..storage.group import Group
from .averages import average

ANGLES = ("theta",)
"""The keys of cases that are angles."""


def round_degrees(angle: float) -> float | None:
    """The degrees of an angle in radians if they are a round number, in which it was given then;
    None if not. A case holds every angle in radians."""
    degrees = math.degrees(angle)
    whole = round(degrees, 6)
    return whole if abs(degrees - whole) <= 4 * math.ulp(degrees) else None


@dataclass(frozen=True)
class Swept:
    """A sweep as it is stored: its case, and its variables by name."""

    case: Case
    data: Mapping[Any, Array]

    @classmethod
    def of(cls, name: str, cases: Mapping[str, Group]) -> "Swept":
        """A sweep among the cases of a result file.

        Raises HodoError if there is no such case, or it is no sweep.
        """
        if name not in cases:
            raise HodoError(f"there is no case {name!r}{nearest(name, cases)}")
        group = cases[name]
        case = case_of(group.attributes, name)
        if not case.sweep:
            raise HodoError(f"case {name} is no sweep")
        return cls(case, group.variables)

    @property
    def axes(self) -> dict[str, Axis]:
        """The axes by name, in order."""
        return {axis.name: axis for axis in axes_of(self.case.sweep or {})}

    def axis(self, name: str) -> Axis:
        """One axis. Raises HodoError if the sweep has none of this name."""
        if name not in self.axes:
            raise HodoError(
                f"sweep {self.case.name} has no axis {name!r} (it has: {', '.join(self.axes)})"
            )
        return self.axes[name]

    def body(self) -> np.ndarray | None:
        """A1, A2, A3 if all members have the same body."""
        keys = [path for axis in self.axes.values() for path, _ in axis.ranges]
        # A separatrix is drawn on the sphere only where all members share one.
        if "inertia" not in self.case.data or any(path[0] == "inertia" for path in keys):
            return None
        return np.array(self.case.data["inertia"], dtype=float)

    def sphere(self) -> str:
        """The name of the axis that is a sphere; empty if none is."""
        return next((name for name, axis in self.axes.items() if axis.sphere is not None), "")

    def values(self, variable: str, keep: Sequence[str], at: Mapping[str, int]) -> np.ndarray:
        """A variable over the axes to `keep`, averaged over those that are neither kept nor fixed;
        see `averages.average`."""
        return average(self.data, list(self.axes), variable, keep, at)

    def ticks(self, name: str) -> tuple[np.ndarray, bool]:
        """The values (n,) along an axis, of the first of its keys and in its `unit`, and whether
        they go in even ratios.

        Raises HodoError if there is no such axis, or it is a sphere.
        """
        axis = self.axis(name)
        if axis.sphere is not None:
            raise HodoError(f"axis {name} is a sphere: it has no values along a line")
        values = axis.values()
        if self.unit(name) == "deg":
            # Without what the way to radians and back has added.
            values = np.round(np.degrees(values), 9)
        return values, "logspace" in axis.ranges[0][1]

    def unit(self, name: str) -> str:
        """The unit of the values along an axis: degrees where an angle was given so, radians of any
        other angle, an empty string where the first key is no angle."""
        ranges = self.axis(name).ranges
        if not ranges or ranges[0][0][-1] not in ANGLES:
            return ""
        ((word, given),) = ranges[0][1].items()
        ends = given if word == "values" else given[:2]
        return "rad" if None in map(round_degrees, ends) else "deg"

    def key(self, name: str) -> str:
        """The first key that varies along an axis."""
        return next(iter(self.axis(name).keys), name)
