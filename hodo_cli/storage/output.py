"""Files being written, group by group, as netCDF-4 readers want them."""

import json
import math
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5f, h5g, h5o, h5p, h5s, h5t

from .disk import BufferedFile, append_checksum
from .group import (
    Attribute,
    Group,
    ValuesChecksum,
    Variable,
    as_stored,
    checksum_of,
    dimension_sizes,
    is_number,
)
from .hdf5 import (
    NO_VARIABLE,
    REPORT,
    REPORT_DIGEST,
    SHORT_ATTRIBUTES,
    STRING,
    ResultFile,
    dimensions,
    encoded,
)
from .provenance import FORMAT_VERSION

SCALAR = h5s.create(h5s.SCALAR)

H5Object: TypeAlias = h5f.FileID | h5g.GroupID | h5d.DatasetID
"""What attributes stand at."""


class Output:
    """A file that is being written; made by `create`."""

    def __init__(self, file: h5py.File, disk: BufferedFile) -> None:
        self._file = file
        self._disk = disk

    def write(self, name: str, group: Group) -> None:
        """Add a group, or replace it. Raises ValueError if its variables differ in the size of a
        dimension."""
        self._disk.check()
        sizes = dimension_sizes(group.variables)
        if name in self._file:
            del self._file[name]
        target = h5g.create(self._file.id, name.encode(), LINK, GROUP_CREATION)
        _set_attributes(target, group.attributes)
        checksums = {
            key: ValuesChecksum() for key in (group.streamed.names if group.streamed else ())
        }
        items = {
            key: _stored(target, key, variable, has_values=key not in checksums)
            for key, variable in group.variables.items()
        }
        _make_scales(target, items, sizes)
        _attach(items, {key: variable.dims for key, variable in group.variables.items()})
        # Last, so that memory holds one block at a time.
        for key, where, block in group.streamed.blocks() if group.streamed else ():
            item = h5py.Dataset(items[key])
            item[where] = block
            checksums[key].add(np.asarray(block, dtype=item.dtype))
        checksum = checksum_of(group, checksums)
        _set_attributes(
            target, {"checksum": checksum, SHORT_ATTRIBUTES: short_attributes(group.attributes)}
        )
        if group.report:
            _set_attributes(target, {REPORT_DIGEST: group.report.digest, REPORT: group.report.json})

    def copy(self, run: ResultFile, name: str, addition: Group | None = None) -> None:
        """Copy a group as it is stored, or write it with an addition. Raises HodoError if it is
        damaged.

        HDF5 breaks the links of datasets to their dimensions when it copies: they are made anew.
        What another program may have written beside the data is left out: the new file would vouch
        for it.
        """
        if addition:
            self.write(name, run.read(name).with_addition(addition))
            return
        self._disk.check()
        with run.open_group(name) as old:
            h5o.copy(old.id, b".", self._file.id, name.encode(), lcpl=LINK)
            target = h5g.open(self._file.id, name.encode())
            if not run.intact:
                _delete_attributes(target, REPORT_DIGEST, REPORT, SHORT_ATTRIBUTES)
            items = {key: h5d.open(target, encoded(key)) for key in old}
            for item in items.values():
                _delete_attributes(item, "REFERENCE_LIST", "DIMENSION_LIST")
            _attach(items, dimensions({key: h5d.open(old.id, encoded(key)) for key in old}))


def _stored(parent: H5Object, name: str, variable: Variable, has_values: bool) -> h5d.DatasetID:
    """A new dataset for a variable, with its values if it has them already, and its attributes."""
    data, dtype = variable.data, _file_type(name, variable.data)
    item = _new_dataset(parent, name, dtype, data.shape, is_checked=dtype != STRING)
    if has_values:
        item.write(h5s.ALL, h5s.ALL, np.require(data, dtype, "C"), _types(dtype)[1])
    _set_attributes(item, variable.attrs)
    return item


MAX_SHORT_CHARACTERS = 1000
"""Characters of an attribute that is short."""


def short_attributes(attributes: Mapping[str, Attribute]) -> str:
    """The short texts and numbers among attributes, as they are stored, as JSON."""
    arrays = {key: np.asarray(value) for key, value in as_stored(attributes).items()}
    plain = {key: array.item() for key, array in arrays.items() if array.shape == ()}
    return json.dumps(
        {key: value for key, value in plain.items() if len(str(value)) <= MAX_SHORT_CHARACTERS}
    )


def _delete_attributes(item: H5Object, *names: str) -> None:
    """Remove attributes that may be there."""
    for name in names:
        if h5a.exists(item, name.encode()):
            h5a.delete(item, name.encode())


def _make_scales(
    parent: H5Object, items: dict[str, h5d.DatasetID], sizes: Mapping[str, int]
) -> None:
    """Make the datasets of coordinates the scales of their dimensions; a dimension without one gets
    a dataset that stands for it."""
    for dim, size in sizes.items():
        if dim in items:
            h5ds.set_scale(items[dim], dim.encode())
        else:
            # A big-endian float that is never written, as netCDF-4 makes it: it takes no room in
            # the file.
            items[dim] = _new_dataset(parent, dim, np.dtype(">f4"), (size,))
            h5ds.set_scale(items[dim], NO_VARIABLE + b"%10d" % size)


def _attach(items: Mapping[str, h5d.DatasetID], dims: Mapping[str, tuple[str, ...]]) -> None:
    """Link datasets to their dimensions; a scale is attached to others, never to itself."""
    scales = {dim for names in dims.values() for dim in names}
    for name in [name for name in dims if name not in scales]:
        for i, dim in enumerate(dims[name]):
            h5ds.attach_scale(items[name], items[dim], i)


@contextmanager
def create(
    path: Path, attributes: Mapping[str, Attribute], damaged: Path | None = None
) -> Iterator[Output]:
    """A new file with these root attributes; the version of the format is one in any case.

    It begins as a copy of a `damaged` file, whose groups HDF5 cannot copy: their bytes are kept,
    and the groups that are written replace theirs and come last. It gets no checksum then, so that
    the damage is seen again. Raises OSError if the operating system does not let it be written.
    """
    root = {"format_version": FORMAT_VERSION, **attributes}
    with BufferedFile(path) as disk:
        if damaged:
            with open(damaged, "rb") as source:
                shutil.copyfileobj(source, disk)
            disk.check()
        with h5py.File(disk, "r+" if damaged else "w", track_order=True) as file:
            for name in [*file.attrs]:
                del file.attrs[name]
            _set_attributes(file.id, {**root, "checksum": checksum_of(Group(root, {}))})
            yield Output(file, disk)
        disk.check()
        if not damaged:
            append_checksum(disk)


def _file_type(name: str, data: np.ndarray) -> Any:
    """The type of an array in the file. Old netCDF readers lose bool, and crash on half and long
    double."""
    if data.dtype.kind in "OU":
        return STRING
    if not is_number(data.dtype):
        raise TypeError(f"{name}: netCDF has no type {data.dtype}")
    return data.dtype


def _set_attributes(item: H5Object, attributes: Mapping[str, Attribute]) -> None:
    """Set new attributes; text with variable length, which every reader gives back as text."""
    for name, value in as_stored(attributes).items():
        data = np.asarray(value, dtype=STRING if isinstance(value, str) else None)
        space = h5s.create_simple(data.shape) if data.shape else SCALAR
        in_file, in_memory = _types(_file_type(name, data))
        h5a.create(item, name.encode(), in_file, space).write(data, in_memory)


@cache
def _types(dtype: np.dtype) -> tuple[h5t.TypeID, h5t.TypeID]:
    """A type as HDF5 names it in a file and in memory."""
    return h5t.py_create(dtype, logical=True), h5t.py_create(dtype)


def _creation(kind: h5p.PropClassID) -> h5p.PropOCID:
    """How groups or datasets are created: the order of creation is tracked throughout, without
    which netCDF-4 cannot append."""
    properties = h5p.create(kind)
    properties.set_obj_track_times(False)
    properties.set_attr_creation_order(TRACKED)
    return properties


TRACKED = h5p.CRT_ORDER_TRACKED | h5p.CRT_ORDER_INDEXED
GROUP_CREATION, DATASET_CREATION = _creation(h5p.GROUP_CREATE), _creation(h5p.DATASET_CREATE)
GROUP_CREATION.set_link_creation_order(TRACKED)
LINK = h5p.create(h5p.LINK_CREATE)
"""How the name of a group or dataset is stored."""
LINK.set_char_encoding(h5t.CSET_UTF8)

# The calls that h5py has for everybody take twice the time of these: a case has five datasets and
# forty attributes, which is half of what it costs to run a short one.


def _new_dataset(
    parent: H5Object, name: str, dtype: np.dtype, shape: tuple[int, ...], is_checked: bool = False
) -> h5d.DatasetID:
    """A new dataset; where it `is_checked`, every reader notices a bit that has changed in it."""
    space = h5s.create_simple(shape) if shape else SCALAR
    properties = DATASET_CREATION
    if is_checked and math.prod(shape) and shape:
        properties = DATASET_CREATION.copy()
        properties.set_chunk(_chunk(shape))
        properties.set_fletcher32()
    return h5d.create(parent, name.encode(), _types(dtype)[0], space, properties, LINK)


NUMBERS_OF_A_CHUNK = 1 << 16


def _chunk(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape of the pieces that have a checksum each: runs of neighbours in their order."""
    chunk = [*shape]
    while math.prod(chunk) > NUMBERS_OF_A_CHUNK:
        longest = next(i for i, size in enumerate(chunk) if size > 1)
        chunk[longest] = -(-chunk[longest] // 2)
    return tuple(chunk)
