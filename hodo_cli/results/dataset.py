"""Result files as xarray datasets, for whoever reads results in Python. The only importer of xarray
besides the interface for Python.

Figures, claims and `compare` read the same groups without it: loading xarray takes as long as to
draw several figures.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from .. import HodoError
from ..schema.kinds import unknown
from ..storage.finished import open_batch
from ..storage.group import Group, Variable


def dataset(group: Group) -> xr.Dataset:
    """A stored group as a dataset; a variable that is named as its only dimension becomes that
    dimension's coordinate."""
    # Copies of the attributes: xarray lets them be changed, and a Group is frozen. A text of an
    # enumeration (the status) becomes plain, as it is when it comes from a file.
    arrays = {name: (v.dims, v.data, dict(v.attrs)) for name, v in group.variables.items()}
    attrs = {k: str(v) if isinstance(v, str) else v for k, v in group.attributes.items()}
    return xr.Dataset(arrays, attrs=attrs)


def group_of(data: xr.Dataset) -> Group:
    """A dataset as a group, as figures read it."""
    variables = {
        str(name): Variable(tuple(map(str, v.dims)), np.asarray(v.data), v.attrs)
        for name, v in data.variables.items()
    }
    return Group(data.attrs, variables)


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
            group = run.read(name)
        try:
            return dataset(group)
        except ValueError as error:
            raise HodoError(f"{self.path}: {name} is damaged ({error})") from error

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return f"<{self.path}: {', '.join(self._names)}>"
