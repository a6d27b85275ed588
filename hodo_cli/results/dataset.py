"""Results as xarray datasets, for figures and notebooks. The only importer of xarray besides the
interface for Python.

Commands that only compute read the same groups without it: loading xarray takes as long as drawing
two figures.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

import numpy as np
import xarray as xr

from .. import HodoError
from ..cases.case import Case, parse_axes
from ..cases.sweep_block import axes_of, path_of, with_number
from ..quantities import PARTS, QUANTITIES
from ..schema.spelling import unknown
from ..storage import Group, ResultFile, open_batch, typed
from ..text import case_words
from .layout import SHOWN_ATTRIBUTES, units_of_case, without_old_labels
from .motion import Motion, case_of, check_whole

Cases = Mapping[str, xr.Dataset]
"""Datasets by the names of their cases."""


def dataset(group: Group, source: str = "") -> xr.Dataset:
    """A stored group as a dataset; `source` is its file.

    A variable with the name of its only dimension becomes that dimension's coordinate, as do the
    keys and directions that vary along the axes of a sweep.
    """
    # Attributes are copied, because xarray lets them be changed and a Group is frozen. A member of
    # an enumeration (the status) becomes plain text, as it is when it comes from a file. Without
    # `fastpath` xarray loads dask, where that is installed, to see whether an array is one of
    # dask's.
    arrays = {
        name: xr.Variable(v.dims, v.data, dict(v.attrs), fastpath=True)
        for name, v in without_old_labels(group.variables).items()
    }
    attrs = {k: str(v) if isinstance(v, str) else v for k, v in group.attributes.items()}
    data = xr.Dataset(arrays, attrs=attrs)
    if source:
        data.encoding["source"] = source  # as in a dataset of a file that xarray opens itself
    return data.set_coords(swept_names(data)) if "members" in attrs else data


def swept_names(data: xr.Dataset) -> list[str]:
    """The variables of a sweep that hold the values along its axes, in the order of its case."""
    names = [
        name
        for axis in parse_axes(typed(data.attrs, {"case": str}, "the sweep")["case"])
        for name in [*axis.keys, f"{axis.name}_vector"]
    ]
    return [name for name in names if name in data]


def ordered(data: xr.Dataset, owner: str) -> xr.Dataset:
    """A dataset with its times, its crossings, the parts of vectors and quaternions, and their
    dimensions in order.

    Raises HodoError, which begins with `owner`, if times or parts occur twice after sorting or have
    no coordinate, or if parts are missing.
    """
    for dim in ("time", *PARTS):
        if dim in data.dims and dim not in data.variables:
            raise HodoError(f"{owner} has no coordinate {dim!r}, which tells its values apart")
    if "time" in data.dims:
        data = sorted_along(data, "time", np.asarray(data.variables["time"].data), owner)
    for dim in PARTS.keys() & data.dims:
        data = with_parts_in_order(data, dim, owner)
    if "crossing_time" in data and data.variables["crossing_time"].dims == ("crossing",):
        order = np.argsort(data.variables["crossing_time"].data, kind="stable")
        data = data.isel(crossing=order) if (np.diff(order) != 1).any() else data
    transposed = any(v.dims[1:] == ("time",) for v in data.variables.values())
    return data.transpose(..., "time", *PARTS, missing_dims="ignore") if transposed else data


def with_parts_in_order(data: xr.Dataset, dim: str, owner: str) -> xr.Dataset:
    """A dataset with the parts along a dimension in the order of `PARTS`. Raises HodoError,
    which begins with `owner`, unless each part occurs once."""
    stored, valid = data.variables[dim].data, PARTS[dim]
    names = [name.decode() if isinstance(name, bytes) else str(name) for name in stored]
    if strange := [name for name in names if name not in valid]:
        raise HodoError(f"{owner}: {strange[0]!r} along {dim!r} is none of {', '.join(valid)}")
    if sorted(names) != sorted(valid):
        raise HodoError(
            f"{owner}: its coordinate {dim!r} has {', '.join(names)}, and not each of "
            f"{', '.join(valid)} once"
        )
    if isinstance(stored[0], bytes):  # as other programs store texts
        data = data.assign_coords({dim: np.array(names, dtype=object)})
    return sorted_along(data, dim, np.array([valid.index(name) for name in names]), owner)


def sorted_along(data: xr.Dataset, dim: str, values: np.ndarray, owner: str) -> xr.Dataset:
    """A dataset sorted by the `values` along a dimension, unchanged if they descend nowhere. Raises
    HodoError, which begins with `owner`, if they are not finite numbers, or if two of those to be
    sorted are equal."""
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise HodoError(f"{owner}: its coordinate {dim!r} holds more than finite numbers")
    if not (np.diff(values.astype(float)) < 0).any():
        return data
    order = np.argsort(values, kind="stable")
    # Consecutive parts may share an end; two parts over the same span make no single curve.
    if twice := values[order][1:][np.diff(values[order]) == 0].tolist():
        raise HodoError(f"{owner}: its coordinate {dim!r} has {twice[0]:.6g} twice, out of order")
    return data.isel({dim: order})


def case_in(data: xr.Dataset, owner: str) -> Case:
    """The case of a dataset. Where a selection has fixed swept keys, the case has their values.

    Raises HodoError, which begins with `owner`, if the attributes hold no case.
    """
    if "case" not in data.attrs:
        raise HodoError(
            f"{owner}: its attributes hold no case, as the attributes of a result do; "
            "arithmetic with a dataset drops them without keep_attrs=True"
        )
    case = case_of(data.attrs, owner)
    keys = [key for axis in axes_of(case.sweep or {}) for key in axis.keys]
    fixed = [key for key in keys if key in data.variables and not data.variables[key].dims]
    case_data = case.data
    for key in fixed:
        case_data = with_number(case_data, path_of(key), float(data.variables[key].data))
    return replace(case, data=case_data) if fixed else case


MOTION_DIMS = ("time", *PARTS, "crossing", "event")
"""The dimensions of the variables of a single motion."""


def sweep_axes(data: xr.Dataset) -> list[str]:
    """The dimensions over which a dataset has members, in the order of `status`; none for a single
    motion."""
    status = data.variables.get("status")
    if status is not None:
        return [str(dim) for dim in status.dims]
    dims = [str(dim) for variable in data.variables.values() for dim in variable.dims]
    is_sweep_group = "members" in data.attrs
    return [dim for dim in dict.fromkeys(dims) if is_sweep_group and dim not in MOTION_DIMS]


def motion_from(data: xr.Dataset, name: str, label: str = "") -> Motion:
    """The motion in a dataset, its samples in the order of their times; figures call it `label`.

    Raises HodoError if the dataset holds no motion, or its contents do not fit together.
    """
    source = str(data.encoding.get("source", ""))
    stored = source.endswith(".h5")
    owner = f"{source}: {name}" if stored else case_words(name)
    case = replace(case_in(data, owner), name=name)
    typed(data.attrs, SHOWN_ATTRIBUTES, owner)
    data = ordered(data, owner)
    check_whole(data.variables, owner, is_sweep=bool(sweep_axes(data)))
    motion = Motion(case, data.variables, data.attrs, label or name, source if stored else "")
    if (status := data.attrs["status"]) != "ok" and motion.sampled:
        reached = case.time.text(motion.time[-1])
        warnings.warn(f"{name}: {status}: drawn to t = {reached} only", stacklevel=2)
    return motion


def quantity_array(name: str, values: np.ndarray, dims: Sequence[str], case: Case) -> xr.DataArray:
    """The values of a quantity over some dimensions and its own components, with meaning and
    units."""
    quantity = QUANTITIES[name]
    parts = {quantity.dim: [*PARTS[quantity.dim]]} if quantity.dim else {}
    words = {"long_name": quantity.long_name, "units": units_of_case(quantity.units, case)}
    return xr.DataArray(values, parts, (*dims, *parts), attrs=words)


def lacks_labels(data: xr.Dataset) -> bool:
    """Whether a stored case has no labels although `classify` would find some."""
    if "case" not in data.attrs:
        return False  # statements or errata
    return Motion(case_of(data.attrs, "a case"), data.variables).lacks_labels


def motions_of(cases: Cases, names: Sequence[str], labels: Sequence[str] = ()) -> list[Motion]:
    """The motions of some cases, in order; a figure's `labels` name the first of them.

    Raises HodoError as `motion_from` does, or if a motion has no samples.
    """
    labelled = zip_longest(names, labels[: len(names)], fillvalue="")
    if swept := next((name for name in names if sweep_axes(cases[name])), None):
        raise HodoError(f"{case_words(swept)} is a sweep, which only maps and curves draw")
    motions = [motion_from(cases[name], name, label) for name, label in labelled]
    for motion in motions:
        if not motion.sampled:
            status = motion.attrs["status"]
            why = "" if status == "ok" else f", its status is {status}"
            raise HodoError(f"{motion.words} has no samples{why}")
    return motions


class NoSuchCase(HodoError, KeyError):
    """The error for a case that a file does not hold; a KeyError too, as `in` and `get` of a
    mapping expect."""

    # A KeyError prints its message in quotes.
    __str__ = Exception.__str__


class StoredCases(Mapping[str, xr.Dataset]):
    """The cases of a result file by name, each read when it is asked for.

    `attrs` are the attributes of the file. `cache`, if given, keeps the cases that were read.
    """

    def __init__(
        self, path: Path, reader: Callable[[], AbstractContextManager[ResultFile]],
        cache: dict[str, xr.Dataset] | None = None,
    ) -> None:  # fmt: skip
        """Take a function that opens the file for each reading. Raises HodoError as `open_batch`
        does."""
        self.path, self._reader, self.cache = path, reader, cache
        with reader() as run:
            self._names = tuple(run.cases())
            self._groups = frozenset(run.groups)
            self.attrs = dict(run.attributes)

    def __getitem__(self, name: str) -> xr.Dataset:
        """A case, in memory. Groups whose names begin with `_` are no cases.

        Raises HodoError if the case is missing, damaged or too large.
        """
        if name not in self:
            raise NoSuchCase(f"{self.path}: {unknown(f'case {name!r}', str(name), self._names)}")
        read = {} if self.cache is None else self.cache
        if name not in read:
            read[name] = self._read(name)
        return read[name]

    def _read(self, name: str) -> xr.Dataset:
        """A case as it is in the file. Raises HodoError if it is damaged."""
        with self._reader() as run:
            group = run.read(name)
        try:
            return dataset(group, str(self.path))
        except ValueError as error:
            raise HodoError(f"{self.path}: {name} is damaged ({error})") from error

    def __contains__(self, name: object) -> bool:
        return name in self._groups

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return f"<{self.path}: {', '.join(self._names)}>"


def cases_of_file(path: Path) -> StoredCases:
    """The cases of a result file, which is opened and closed for each reading, so that a run may
    replace it meanwhile. Raises HodoError as `open_batch` does."""
    return StoredCases(path, lambda: open_batch(path))


@contextmanager
def open_cases(path: Path) -> Iterator[StoredCases]:
    """The cases of a result file that stays open, each read once. Raises HodoError as `open_batch`
    does."""
    with open_batch(path) as run:
        yield StoredCases(run.path, lambda: nullcontext(run), {})
