"""Result files as xarray datasets: for figures, and for whoever reads results in Python. The only
importer of xarray.

Claims and `compare` read the same groups without it: loading xarray takes longer than they do.
"""

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import xarray as xr

from .. import HodoError
from ..cases.config import Config, parse
from ..schema.kinds import unknown
from .hdf5 import Group, Run
from .layout import SHOWN
from .motion import Motion, motion_of
from .provenance import typed
from .writer import open_batch

UNSAVED = Path("data")
"""Stands for a result file where the datasets at hand are drawn."""


def dataset(group: Group) -> xr.Dataset:
    """A stored group as a dataset; a variable that is named as its only dimension becomes that
    dimension's coordinate."""
    # Copies of the attributes: xarray lets them be changed, and a Group is frozen. A text of an
    # enumeration (the status) becomes plain, as it is when it comes from a file.
    arrays = {name: (v.dims, v.data, dict(v.attrs)) for name, v in group.variables.items()}
    attrs = {k: str(v) if isinstance(v, str) else v for k, v in group.attributes.items()}
    return xr.Dataset(arrays, attrs=attrs)


class Datasets(Mapping[str, xr.Dataset]):
    """The cases of an open result file by name, each read when it is asked for; `asked` notes for
    which, whether they are there or not."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self.asked: set[str] = set()

    def __getitem__(self, name: str) -> xr.Dataset:
        """A case, in memory; groups that are no cases have names that begin with `_`.

        Raises KeyError if it is not there, HodoError if it is damaged or too large.
        """
        if name not in self:
            raise KeyError(name)
        group = self._run.read(name)
        try:
            return dataset(group)
        except ValueError as error:
            raise HodoError(f"{self._run.path}: {name} is damaged ({error})") from error

    def __iter__(self) -> Iterator[str]:
        return iter(self._run.cases())

    def __len__(self) -> int:
        return len(self._run.cases())

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return isinstance(name, str) and name in self._run


class NoSuchCase(HodoError, KeyError):
    """A case that a file does not hold; a KeyError too, as `in` and `get` of a mapping expect."""

    # A KeyError prints its message in quotes.
    __str__ = Exception.__str__


class Opened(Mapping[str, xr.Dataset]):
    """The cases of a result file by name, each read when it is asked for.

    The file is opened for each reading and closed again, so that a run may replace it meanwhile.
    """

    def __init__(self, path: Path) -> None:
        """Raises HodoError as `writer.open_batch` does."""
        self.path = path
        with open_batch(path) as run:
            self._names = tuple(run.cases())
            self.attrs = dict(run.attributes)

    def __getitem__(self, name: str) -> xr.Dataset:
        """A case, in memory. Raises HodoError if it is not there, or is damaged."""
        if name not in self._names:
            raise NoSuchCase(f"{self.path}: {unknown(f'case {name!r}', str(name), self._names)}")
        with open_batch(self.path) as run:
            return Datasets(run)[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return f"<{self.path}: {', '.join(self._names)}>"


@dataclass
class Results:
    """A result file that is open for reading: its cases, and the config that it was made from."""

    path: Path
    cases: Mapping[str, xr.Dataset]
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
                raise HodoError(f"{self.path} has no result of case {name} yet: run it first")
            owner, data = f"{self.path}: {name}", self.cases[name]
            typed(data.attrs, SHOWN, owner)
            if (status := data.attrs["status"]) != "ok" and data.sizes.get("time"):
                end = float(data["time"].values[-1])
                warnings.warn(f"{name}: {status}: drawn to t = {end:.6g} only", stacklevel=2)
            # Kept, because most cases stand in several figures and on the page.
            path = "" if self.path == UNSAVED else str(self.path)
            self._motions[name] = motion_of(data, data.attrs, owner, path)
        return replace(self._motions[name], label=label or name)

    @property
    def lacks_labels(self) -> bool:
        """Whether a case that has been read would be labelled by `classify`, and is not."""
        return any(motion.lacks_labels for motion in self._motions.values())

    def motions(self, spec: Mapping[str, Any]) -> list[Motion]:
        """The cases of a figure, in order, under the labels that it gives them.

        Raises HodoError if the file does not hold one of them, or has no samples of it.
        """
        labels = [*spec["labels"], *[""] * len(spec["cases"])]
        motions = [
            self.motion(name, label) for name, label in zip(spec["cases"], labels, strict=False)
        ]
        for motion in motions:
            if "time" not in motion.data or not len(motion.time):
                status = motion.attrs.get("status")
                why = "" if status == "ok" else f", its status is {status}"
                raise HodoError(f"case {motion.name} has no samples{why}")
        return motions

    def figure(self, name: str) -> Mapping[str, Any]:
        """One entry of the `figures:` block. Raises HodoError if there is none of this name."""
        return self.config.figure(name)


@contextmanager
def open_results(path: Path | str, config: Config | None = None) -> Iterator[Results]:
    """A result file, open for reading, with its own config or another. Raises HodoError as
    `writer.open_batch` does."""
    with open_batch(path) as run:
        yield Results(run.path, Datasets(run), config or parse(run.text, str(path)))
