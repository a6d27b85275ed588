"""Result files as xarray datasets, read through netCDF4: for figures, comparisons and notebooks.

netCDF4 and h5py each bring an HDF5 library of their own, and some pairs of these break each other:
a process that imports this module should not import `hdf5`, nor the reverse.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from .. import HodoError
from ..batch import memory
from ..cases.case import Case, parse_case
from ..models import rigid_body
from .provenance import FORMAT_VERSION


class Cases(Mapping[str, xr.Dataset]):
    """The cases of an open result file by name, each read when it is asked for, and the file's
    `attributes`."""

    def __init__(self, path: Path, file: netCDF4.Dataset) -> None:
        self.path = path
        self.attributes: dict[str, Any] = dict(file.__dict__)
        self._file = file

    def __getitem__(self, name: str) -> xr.Dataset:
        """A case, in memory. Raises KeyError if it is not there, HodoError if it is damaged or too
        large."""
        group = self._file.groups[name]
        try:
            source = xr.backends.NetCDF4DataStore(group)  # type: ignore[no-untyped-call]
            found = xr.open_dataset(source, decode_cf=False)
            if found.nbytes > memory.limit():
                raise HodoError(
                    f"{self.path}: {name} does not fit into memory: {memory.size(found.nbytes)}"
                )
            return found.load()
        except (OSError, RuntimeError, LookupError, ValueError) as error:
            raise HodoError(f"{self.path}: {name} is damaged ({error})") from error

    def __iter__(self) -> Iterator[str]:
        return (name for name in self._file.groups if not name.startswith("_"))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return name in self._file.groups


@contextmanager
def open_cases(path: Path | str) -> Iterator[Cases]:
    """The cases of a result file, which is opened once: netCDF takes 0.7 ms for every group that a
    file has.

    Raises HodoError if it is missing, unreadable, in use for writing, damaged, not hodo's, or of a
    newer format.
    """
    path = Path(path)
    try:
        file = netCDF4.Dataset(path)
    except OSError as error:
        raise HodoError(f"{path}: {_why_closed(path, error)}") from None
    except (RuntimeError, LookupError, TypeError, ValueError, AttributeError) as error:
        raise HodoError(f"{path} is damaged ({error})") from None
    with file:
        cases = Cases(path, file)
        version = cases.attributes.get("format_version")
        if not isinstance(version, int | np.integer):
            raise HodoError(
                f"{path} is netCDF, but not a result of hodo (it has no format_version)"
            )
        if version > FORMAT_VERSION:
            raise HodoError(
                f"{path} has format version {version}, newer than {FORMAT_VERSION}: update hodo to read it"
            )
        yield cases


def _why_closed(path: Path, error: OSError) -> str:
    """Why netCDF does not open a file."""
    if os.path.isdir(path):
        return "a folder, not a file"
    if error.errno and error.errno > 0:
        return os.strerror(error.errno).lower()
    return f"not an HDF5 file, truncated, or open for writing elsewhere ({error.strerror})"


def open_case(path: Path | str, name: str) -> xr.Dataset:
    """One case, in memory. Raises HodoError if it is not there, or as `open_cases` does."""
    with open_cases(path) as cases:
        if name not in cases:
            raise HodoError(f"{path}: there is no case {name!r}")
        return cases[name]


def open_root(path: Path | str) -> xr.Dataset:
    """The attributes of a result file, as those of an empty dataset. Raises HodoError as
    `open_cases` does."""
    with open_cases(path) as cases:
        return xr.Dataset(attrs=cases.attributes)


def case_of(dataset: xr.Dataset) -> Case:
    """The case that a dataset is the motion of. Raises HodoError if it says none."""
    text = dataset.attrs.get("case")
    if not isinstance(text, str):
        raise HodoError("damaged: a group without the text of its case")
    return parse_case(text)


def derive(dataset: xr.Dataset) -> xr.Dataset:
    """A case with what its angular velocity and its three moments of inertia determine; any other
    as it is.

    Added: `G` (..., axis), the angular momentum in body axes, `G_norm` = |G|, `G2` = G^2, the
    kinetic energy `T` and the separatrix function `D` = G^2 - 2 T A_middle. |G| is right also where
    G^2 underflows.
    """
    inertia = case_of(dataset).data.get("inertia") if "omega" in dataset else None
    if not isinstance(inertia, tuple | list):
        return dataset
    omega = dataset["omega"]
    if "axis" not in omega.dims or omega.sizes["axis"] != 3 or omega.dtype.kind != "f":
        raise HodoError("damaged: its omega holds no vectors")
    omega = omega.transpose(..., "axis")
    A, w = np.array(inertia, dtype=float), omega.values
    G = rigid_body.angular_momentum(A, w)
    outer, inner = rigid_body.separatrix_terms(
        A, np.moveaxis(w, -1, 0), rigid_body.inertia_order(A)
    )
    return dataset.assign(
        G=(omega.dims, G, {"long_name": "angular momentum in body axes"}),
        G_norm=(omega.dims[:-1], np.hypot.reduce(G, axis=-1), {"long_name": "angular momentum"}),
        G2=(omega.dims[:-1], (G * G).sum(axis=-1), {"long_name": "square of the angular momentum"}),
        T=(omega.dims[:-1], rigid_body.kinetic_energy(A, w), {"long_name": "kinetic energy"}),
        D=(omega.dims[:-1], outer - inner, {"long_name": "separatrix function"}),
    )
