"""Sweeps as maps: one variable over two axes, or over the directions of a sphere. Numbers only."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from .. import HodoError
from ..cases.case import Case, parse_case
from ..cases.sweep_block import Axis, axes_of
from ..schema.kinds import nearest
from ..sweeps.averages import average

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Swept:
    """A sweep as it is stored: its case, and its dataset."""

    case: Case
    data: "xr.Dataset"

    @classmethod
    def of(cls, name: str, cases: "Mapping[str, xr.Dataset]") -> "Swept":
        """A sweep of a result file. Raises HodoError if there is no such case, or it is no
        sweep."""
        if name not in cases:
            raise HodoError(f"there is no case {name!r}{nearest(name, cases)}")
        data = cases[name]
        case = parse_case(str(data.attrs["case"]))
        if not case.sweep:
            raise HodoError(f"case {name} is no sweep")
        return cls(case, data)

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
        varies = any(path[0] == "inertia" for axis in self.axes.values() for path, _ in axis.ranges)
        return (
            None
            if varies or "inertia" not in self.case.data
            else np.array(self.case.data["inertia"], dtype=float)
        )

    def sphere(self) -> str:
        """The name of the axis that is a sphere; empty if none is."""
        return next((name for name, axis in self.axes.items() if axis.sphere is not None), "")

    def values(self, variable: str, keep: Sequence[str], at: Mapping[str, int]) -> np.ndarray:
        """A variable over the axes to `keep`, averaged over those that are neither kept nor fixed;
        `averages.average`."""
        return average(self.data, list(self.axes), variable, keep, at)

    def ticks(self, name: str) -> tuple[np.ndarray, bool]:
        """The values (n,) along an axis, of the first of its keys, and whether they go in even
        ratios."""
        axis = self.axis(name)
        if axis.sphere is not None:
            raise HodoError(f"axis {name} is a sphere: it has no values along a line")
        return axis.values[0], "logspace" in axis.ranges[0][1]

    def symbol(self, name: str) -> str:
        """The symbol of an axis in TeX, of the first of its keys."""
        axis = self.axis(name)
        return symbol(".".join(map(str, axis.ranges[0][0])) if axis.ranges else name)

    def at(self, name: str, i: int) -> str:
        """A position on an axis in words: symbol = value."""
        return f"${self.symbol(name)} = {self.ticks(name)[0][i]:.4g}$"


def symbol(key: str) -> str:
    """The symbol of a key in TeX: damping.2 is lambda_3."""
    vectors = {"damping": r"\lambda", "inertia": "A", "torque": "M"}
    words = {"resistance.diagonal": "I_{ii}", "resistance.off_diagonal": "I_{ij}", "epsilon": r"\varepsilon",
             "kappa": r"\kappa", "cavity.kappa": r"\kappa", "mu": r"\mu", "damping": r"\lambda"}  # fmt: skip
    head, _, last = key.rpartition(".")
    if head in vectors and last.isdecimal():
        return f"{vectors[head]}_{int(last) + 1}"
    return words.get(
        key,
        last if re.fullmatch(r"[A-Za-z]\w?", last) else rf"\mathrm{{{last}}}".replace("_", r"\_"),
    )


def edges(values: np.ndarray, ratios: bool) -> np.ndarray:
    """The edges (n + 1,) of cells about values (n,), half way between them."""
    x = np.log(values) if ratios else values
    if len(x) == 1:
        return np.asarray(np.exp([x[0] - 0.5, x[0] + 0.5]) if ratios else [x[0] - 0.5, x[0] + 0.5])
    middle = (x[1:] + x[:-1]) / 2
    x = np.concatenate([[2 * x[0] - middle[0]], middle, [2 * x[-1] - middle[-1]]])
    return np.asarray(np.exp(x) if ratios else x)


def hammer(directions: np.ndarray) -> np.ndarray:
    """Hammer's equal-area map (n, 2) of directions (n, 3): x1 in the middle, x2 to the right of it,
    x3 on top.

    The sphere fills an ellipse with the half axes 2 sqrt(2) and sqrt(2). Source: E. Hammer,
    Petermanns Mitt. 38 (1892).
    """
    x, y, z = directions.T
    longitude = np.arctan2(y, x)
    flat = np.hypot(x, y)
    scale = np.sqrt(2 / (1 + flat * np.cos(longitude / 2)))
    return np.stack([2 * scale * flat * np.sin(longitude / 2), scale * z], axis=-1)


def hammer_back(points: np.ndarray) -> np.ndarray:
    """The directions (n, 3) of points (n, 2) of Hammer's map; nan outside the ellipse."""
    x, y = points.T
    inside = (x / math.sqrt(8)) ** 2 + (y / math.sqrt(2)) ** 2 <= 1
    root = np.sqrt(np.where(inside, 1 - (x / 4) ** 2 - (y / 2) ** 2, np.nan))
    longitude, z = 2 * np.arctan2(root * x, 2 * (2 * root * root - 1)), root * y
    flat = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([flat * np.cos(longitude), flat * np.sin(longitude), z], axis=-1)


def hammer_image(directions: np.ndarray, values: np.ndarray, height: int) -> np.ndarray:
    """Values (n,) at directions (n, 3) as an image (height, 2 height), each pixel that of the
    nearest direction."""
    x = (np.arange(2 * height) + 0.5) / height - 1
    y = (np.arange(height) + 0.5) / height * 2 - 1
    grid = np.stack(np.meshgrid(math.sqrt(8) * x, math.sqrt(2) * y), axis=-1).reshape(-1, 2)
    at = hammer_back(grid)
    inside = np.isfinite(at[:, 0])
    image = np.full(len(grid), np.nan)
    image[inside] = values[cKDTree(directions).query(at[inside])[1]]
    return image.reshape(height, 2 * height)


def hammer_curve(curve: np.ndarray) -> list[np.ndarray]:
    """A curve of directions (n, 3) on the map, in pieces that do not jump across its rim."""
    points = hammer(curve)
    jumps = np.flatnonzero(np.abs(np.diff(points[:, 0])) > 2) + 1
    return np.split(points, jumps)
