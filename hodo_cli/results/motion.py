"""A result file as figures and pages read it: its cases as motions, its figures, what was drawn of
them."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..cases.config import Config, parse
from ..models import rigid_body
from ..schema.kinds import nearest
from .dataset import Cases, case_of, derive, open_cases
from .layout import SUMMARY
from .provenance import typed

if TYPE_CHECKING:
    import xarray as xr


LABELS = {"enclosed_axis": "time"} | {
    f"crossing_{name}": "crossing" for name in ("time", "error", "from", "to", "G")
}
"""What `classify` adds to a motion, each over its dimension."""


@dataclass(frozen=True)
class Motion:
    """One case: its dataset with what follows from it (`dataset.derive`), and what a figure calls
    it."""

    case: Case
    label: str
    data: "xr.Dataset"

    @property
    def name(self) -> str:
        """The case's name in the file."""
        return self.case.name

    def __getitem__(self, variable: str) -> np.ndarray:
        """A variable over time (n,): of the dataset, a component such as "omega.x1", or "D/2T".

        Raises HodoError if the dataset has no such variable.
        """
        if variable == "D/2T":
            with np.errstate(invalid="ignore"):
                return np.asarray(self["D"] / (2 * self["T"]))
        name, _, axis = variable.partition(".")
        if name in self.data and self.data[name].dims == (("time", "axis") if axis else ("time",)):
            if not axis:
                return np.asarray(self.data[name].values)
            if axis in ("x1", "x2", "x3"):
                return np.asarray(self.data[name].values[:, int(axis[1]) - 1])
        known = ", ".join(
            str(each)
            for each, values in self.data.data_vars.items()
            if values.dims[:1] == ("time",)
        )
        raise HodoError(f"case {self.name} has no variable {variable!r} (it has: {known})")

    def columns(self, *variables: str) -> dict[str, np.ndarray]:
        """Several variables by name."""
        return {name: self[name] for name in variables}

    def units(self, variable: str) -> str:
        """The stored units of a variable; "1" where none are stored."""
        name = variable.partition(".")[0]
        return str(self.data[name].attrs.get("units", "1")) if name in self.data else "1"

    @cached_property
    def time(self) -> np.ndarray:
        """Times (n,)."""
        return np.asarray(self.data["time"].values)

    @cached_property
    def G(self) -> np.ndarray:
        """Angular momentum (n, 3) in body axes. Raises HodoError for a case without it."""
        if "G" not in self.data or self.data["G"].dims != ("time", "axis"):
            raise HodoError(
                f"case {self.name} ({self.case.model}, {self.case.form}) has no angular momentum in body axes"
            )
        return np.asarray(self.data["G"].values)

    @cached_property
    def inertia(self) -> np.ndarray:
        """A1, A2, A3 of a case that has `G`."""
        return np.array(self.case.data["inertia"], dtype=float)

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """The positions of the largest, middle and smallest moment of inertia."""
        return rigid_body.inertia_order(self.inertia)

    @property
    def classified(self) -> bool:
        """Whether `classify` has stored an enclosed axis for each sample."""
        return "enclosed_axis" in self.data and self.data["enclosed_axis"].dims == ("time",)

    @cached_property
    def labels(self) -> np.ndarray:
        """The enclosed axis (n,) as `classify` stored it. Raises HodoError if it has not."""
        if not self.classified:
            raise HodoError(
                f"case {self.name} has no labels of the enclosed axis (`hodo classify` stores them)"
            )
        return np.asarray(self.data["enclosed_axis"].values)

    @cached_property
    def crossing_time(self) -> np.ndarray:
        """Times (m,) of the separatrix crossings; none in a case that is not classified."""
        return (
            np.asarray(self.data["crossing_time"].values)
            if "crossing_time" in self.data
            else np.empty(0)
        )

    @cached_property
    def event_time(self) -> np.ndarray:
        """Times (m,) of the events of the motion itself, such as the end of spin."""
        return (
            np.asarray(self.data["event_time"].values) if "event_time" in self.data else np.empty(0)
        )

    def at_crossings(self, values: np.ndarray) -> np.ndarray:
        """Values over time (n, k) at the crossings (m, k), interpolated between samples."""
        return np.stack(
            [np.interp(self.crossing_time, self.time, column) for column in values.T], axis=-1
        )


@dataclass
class Results:
    """A result file that is open for reading: its cases, and the config that it was made from."""

    path: Path
    cases: Cases
    config: Config
    _motions: dict[str, Motion] = field(default_factory=dict)

    @property
    def figures(self) -> Mapping[str, Mapping[str, Any]]:
        """The entries of the `figures:` block, resolved."""
        return self.config.figures

    def motion(self, name: str, label: str = "") -> Motion:
        """One case. Raises HodoError if the file does not hold it, or it is damaged."""
        if name not in self._motions:
            if name not in self.cases:
                raise HodoError(f"{self.path} has no case {name!r}{nearest(name, self.cases)}")
            data = derive(self.cases[name])
            typed(data.attrs, SUMMARY | {"case": str, "error_kind": str}, f"{self.path}: {name}")
            if "enclosed_axis" in data and not all(
                key in data and data[key].dims == (dim,) and data[key].dtype.kind in "fi"
                for key, dim in LABELS.items()
            ):
                raise HodoError(
                    f"{self.path}: {name} is damaged (its labels and crossings do not fit together)"
                )
            self._motions[name] = Motion(case_of(data), name, data)
        found = self._motions[name]
        return Motion(found.case, label or name, found.data)

    def motions(self, spec: Mapping[str, Any]) -> list[Motion]:
        """The cases of a figure, in order, under the labels that it gives them.

        Raises HodoError if the file does not hold one of them, or has no samples of it.
        """
        labels = [*spec["labels"], *[""] * len(spec["cases"])]
        motions = [
            self.motion(name, label) for name, label in zip(spec["cases"], labels, strict=False)
        ]
        for motion in motions:
            if not motion.data.sizes.get("time"):
                raise HodoError(
                    f"case {motion.name} has no samples (it {motion.data.attrs.get('status')})"
                )
        return motions

    def figure(self, name: str) -> Mapping[str, Any]:
        """One entry of the `figures:` block. Raises HodoError if there is none of this name."""
        if name not in self.figures:
            raise HodoError(f"{self.path} has no figure {name!r}{nearest(name, self.figures)}")
        return self.figures[name]


@contextmanager
def open_results(path: Path | str) -> Iterator[Results]:
    """A result file, open for reading. Raises HodoError as `dataset.open_cases` does."""
    with open_cases(path) as cases:
        yield Results(Path(path), cases, parse(str(cases.attributes.get("config", "")), str(path)))


@dataclass(frozen=True)
class Rendered:
    """A figure that was drawn into files, or the reason why it was not."""

    name: str
    files: tuple[Path, ...] = ()
    problem: str = ""
