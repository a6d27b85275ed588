"""Groups of labelled arrays in HDF5 files that netCDF-4 reads too.

Every array of numbers carries `fletcher32`, so that any reader notices a changed bit. A file ends
with the SHA-256 of all bytes before it, after the HDF5 part, where other readers do not look. It is
compared before HDF5 sees a byte, and is lost when another program changes the file.
"""

import hashlib
import json
import math
import os
import re
import shutil
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from glob import escape, glob
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5f, h5g, h5o, h5p, h5s, h5t

from .. import BatchError, HodoError
from ..machine import RESOURCES
from ..text import first_line
from .provenance import CONTENT, FORMAT_VERSION, typed

Attribute = str | int | float | np.ndarray


@dataclass(frozen=True)
class Variable:
    """A labelled array: numbers that netCDF knows (not bool, half or long double), or strings."""

    dims: tuple[str, ...]
    data: np.ndarray
    attrs: dict[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class StreamedVariables:
    """Variables too large for memory: their arrays carry only shape and dtype, and `blocks()`
    yields the values as (name, where, block) when the group is written."""

    names: frozenset[str]
    blocks: Callable[[], Iterator[tuple[str, Any, np.ndarray]]]


@dataclass(frozen=True)
class Group:
    """The content of a group. A variable with the name of its only dimension is that dimension's
    coordinate."""

    attributes: Mapping[str, Attribute]
    variables: Mapping[str, Variable]
    streamed: StreamedVariables | None = None

    def with_addition(self, addition: "Group") -> "Group":
        """This group with the variables and attributes of another added or replaced."""
        attributes = {**self.attributes, **addition.attributes}
        return Group(attributes, {**self.variables, **addition.variables})

    def with_report(self, digest: str, rows: Any) -> "Group":
        """This group with the line that a command prints of it, and the digest of what that line
        depends on besides the group: see `ResultFile.report`."""
        return self.with_addition(Group({REPORT_DIGEST: digest, REPORT: json.dumps(rows)}, {}))


def dimension_sizes(variables: Mapping[str, Variable]) -> dict[str, int]:
    """The sizes of the dimensions of variables. Raises ValueError if a dimension has two sizes."""
    sizes: dict[str, int] = {}
    for name, variable in variables.items():
        for dim, size in zip(variable.dims, variable.data.shape, strict=True):
            if sizes.setdefault(dim, size) != size:
                raise ValueError(f"{name} has {size} values along {dim}, elsewhere {sizes[dim]}")
    return sizes


# Files

MARK = b"\nhodo sha256 "
MARK_BYTES = len(MARK) + 64
"""The bytes after the HDF5 part of a file, which hold the hash of the bytes before."""


@contextmanager
def refused_as(path: Path, parts: Path | None = None) -> Iterator[None]:
    """Turn an error of writing `path` into a BatchError, which says that finished cases are kept if
    the folder `parts` holds some."""
    try:
        yield
    except DAMAGE as error:
        if not (reason := refusal(error)):
            raise
        if file := next(filter(os.path.isfile, path.parents), None):
            reason = f"{file} is a file, not a folder"
        kept = "; finished cases are kept" if parts and glob("c*", root_dir=parts) else ""
        raise BatchError(f"cannot write {path}: {reason}{kept}") from error


def refusal(error: BaseException) -> str:
    """The reason that the operating system gives (no space, no permission), or an empty string."""
    # HDF5 gives it within the text of its own errors.
    quoted = re.search(r"errno = (\d+)", str(error))
    number = int(quoted[1]) if quoted else getattr(error, "errno", None)
    return os.strerror(number).lower() if number else ""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name for a new file, which takes the place of `path` when the block ends well, so that a
    name that exists is complete. Raises BatchError if the operating system refuses it."""
    with refused_as(path):
        for left in path.parent.glob(f".{escape(path.name)}.*.draft"):
            if not is_running(int(left.name.split(".")[-2])):
                left.unlink()
        with drafted(path, path.parent) as draft:
            yield draft


def is_running(process: int) -> bool:
    """Whether a process with this number runs on this machine; on Windows always True."""
    with suppress(PermissionError):
        try:
            if os.name != "nt":
                os.kill(process, 0)
        except ProcessLookupError:
            return False
    return True


@contextmanager
def drafted(path: Path, folder: Path) -> Iterator[Path]:
    """A name for a new file in `folder`, on the same disk; the file takes the place of `path` when
    the block ends well. Raises OSError."""
    # A link stays a link: the file that it points to is replaced.
    path = Path(os.path.realpath(path)) if os.path.islink(path) else path
    draft = folder / f".{path.name}.{os.getpid()}.draft"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield draft
        with suppress(FileNotFoundError):
            shutil.copymode(path, draft)
        sync(draft)
        os.replace(draft, path)
        sync(path.parent)
    finally:
        draft.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    if os.name == "nt" and path.is_dir():  # Windows opens no folder
        return
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def create(file: Path, attributes: Mapping[str, Attribute], room: int) -> Iterator[h5py.File]:
    """A new file with these root attributes and room for `room` more bytes, which gets hodo's mark
    at the end. Raises OSError if they do not fit on the disk."""
    with h5py.File(file, "w", track_order=True, locking="best-effort") as new:
        set_attributes(new, {"format_version": FORMAT_VERSION, **attributes})
    with open(file, "r+b") as disk:
        # HDF5 ends the process on a full disk, so the room is reserved before.
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(disk.fileno(), 0, disk.seek(0, os.SEEK_END) + room)
    with h5py.File(h5f.open(os.fsencode(file), h5f.ACC_RDWR, AT_ONCE)) as new:
        yield new
    with open(file, "r+b") as disk:
        mark = MARK + hash_of(disk, disk.seek(0, os.SEEK_END)).encode()
        disk.seek(0, os.SEEK_END)
        disk.write(mark)


def save_groups(
    file: Path, groups: Mapping[str, Group], attributes: Mapping[str, Attribute] = {}
) -> None:
    """Write a new file with these groups and root attributes. Raises OSError as `create` does."""
    with create(file, attributes, sum(map(room_for, groups.values()))) as new:
        for name, group in groups.items():
            write_group(new, name, group)


def room_for(group: Group) -> int:
    """The largest number of bytes that a group takes in a file."""
    arrays = [variable.data for variable in group.variables.values()]
    texts = [text for data in arrays if data.dtype.kind in "OU" for text in data.flat]
    texts += [text for text in group.attributes.values() if isinstance(text, str)]
    numbers = sum(data.nbytes + data.nbytes // 100 + 10_000 for data in arrays)
    return 100_000 + numbers + sum(4 * len(text) + 200 for text in texts)


def hash_of(file: BinaryIO, size: int) -> str:
    """The hash of the first bytes of an open file, in hexadecimal digits."""
    hashed = hashlib.sha256()
    file.seek(0)
    while size > 0 and (block := file.read(min(size, 1 << 20))):
        hashed.update(block)
        size -= len(block)
    return hashed.hexdigest()


_marks: dict[tuple[Path, int, int, int], bool] = {}


def is_marked(path: Path) -> bool:
    """Whether a file has hodo's mark; tested once, until the file changes.

    Raises HodoError if the mark does not fit, and OSError if the file cannot be read.
    """
    # By one descriptor, because a moment later the name may mean another file.
    with open(path, "rb") as file:
        status = os.fstat(file.fileno())
        key = path, status.st_ino, status.st_mtime_ns, status.st_size
        if key not in _marks:
            _marks[key] = _fits(path, file, status.st_size)
    return _marks[key]


def _fits(path: Path, file: BinaryIO, size: int) -> bool:
    """Whether a file of `size` bytes ends with hodo's mark. Raises HodoError if the mark is of
    other bytes."""
    file.seek(max(size - MARK_BYTES, 0))
    mark = file.read(MARK_BYTES)
    if mark.startswith(MARK) and mark != MARK + hash_of(file, size - MARK_BYTES).encode():
        sound = "h5py reads what is sound of it"
        way_out = f"restore it, or move it away and run again; {sound}"
        raise HodoError(f"{path} is damaged (its checksum does not fit): {way_out}")
    return mark.startswith(MARK)


# Writing

STRING = h5py.string_dtype()
# netCDF-4's sign of a dimension without a coordinate; its readers look for these very words.
NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable."

REPORT_DIGEST, REPORT, SHORT_ATTRIBUTES, STAMP = "told_mark", "told", "listed", "stamp"
"""Attributes of a group that count only in a file which no other program has changed: the line that
a command has printed; the short attributes once more, as JSON (listing a batch then reads one
attribute a case and not eleven, each of which takes 10 to 30 us); and a number that is new after
each change."""

BOOKKEEPING = (REPORT_DIGEST, REPORT, SHORT_ATTRIBUTES, STAMP)

HIDDEN = (
    *("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates"),
    *("checksum", *BOOKKEEPING),
)
"""Attributes that are no data: links of dimensions, and the checksum of files of version 0.2."""

MAX_SHORT_CHARACTERS = 1000

LARGEST_CHUNK_OF_FILE = 1 << 16
"""The most numbers that share a checksum."""


# h5py's usual calls take two to four times as long as its low-level ones. A case has five datasets
# and forty attributes, which take half of the time of a short run.


def write_group(file: h5py.File, name: str, group: Group) -> None:
    """Add a group, or replace it. Raises ValueError if its variables differ in the size of a
    dimension, and TypeError for an array that netCDF does not know."""
    file.pop(name, None)
    amend_group(h5py.Group(h5g.create(file.id, name.encode(), LINK, TRACKED_GROUP)), group)


def amend_group(target: h5py.Group, group: Group) -> None:
    """Add attributes and variables to a group, or replace them."""
    sizes = dimension_sizes(group.variables)
    kept = {k: v for k, v in short_attributes(target).items() if k not in group.attributes}
    listed = json.dumps(kept | short_ones(group.attributes))
    stamp = os.urandom(8).hex()
    set_attributes(target, {**group.attributes, SHORT_ATTRIBUTES: listed, STAMP: stamp})
    late = group.streamed.names if group.streamed else ()
    items = datasets_of(target)
    for name, variable in group.variables.items():
        # The dataset of a dimension stays, because variables are linked to it.
        if name in items and name not in sizes:
            target.id.unlink(name.encode())
        if name not in items or name not in sizes:
            items[name] = new_dataset(target, name, file_type(name, variable.data), variable.data)
        set_attributes(h5py.Dataset(items[name]), variable.attrs)
        if name not in late:
            kind = np.require(variable.data, file_type(name, variable.data), "C")
            items[name].write(h5s.ALL, h5s.ALL, kind, types(kind.dtype)[1])
    for dim, size in sizes.items():
        if dim in group.variables and not h5ds.is_scale(items[dim]):
            h5ds.set_scale(items[dim], dim.encode())
        elif dim not in items or items[dim].shape != (size,):
            target.pop(dim, None)
            # A big-endian float that is never written, as netCDF-4 makes it: it takes no room.
            items[dim] = new_dataset(target, dim, np.dtype(">f4"), np.empty(size), is_empty=True)
            h5ds.set_scale(items[dim], NO_VARIABLE + b"%10d" % size)
    attach(items, {name: variable.dims for name, variable in group.variables.items()})
    for name, where, block in group.streamed.blocks() if group.streamed else ():
        h5py.Dataset(items[name])[where] = block


def file_type(name: str, data: np.ndarray) -> Any:
    """The type of an array in the file. Raises TypeError for a type that old netCDF readers lose
    (bool), or crash on (half and long double)."""
    if data.dtype.kind in "OU":
        return STRING
    if data.dtype.str[1:] not in ("i1", "i2", "i4", "i8", "u1", "u2", "u4", "f4", "f8"):
        raise TypeError(f"{name}: netCDF has no type {data.dtype}")
    return data.dtype


def new_dataset(
    parent: h5py.Group, name: str, dtype: np.dtype, data: np.ndarray, is_empty: bool = False
) -> h5d.DatasetID:
    """A new dataset for an array, without its values."""
    properties = TRACKED_DATASET
    if dtype != STRING and data.ndim and data.size and not is_empty:
        properties = TRACKED_DATASET.copy()
        properties.set_chunk(chunk_of(data.shape))
        properties.set_fletcher32()
    space = h5s.create_simple(data.shape) if data.ndim else SCALAR
    return h5d.create(parent.id, name.encode(), types(dtype)[0], space, properties, LINK)


def chunk_of(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape of the chunks of an array, each of which has a checksum: runs of neighbours, in
    their order."""
    chunk = [*shape]
    while math.prod(chunk) > LARGEST_CHUNK_OF_FILE:
        i = next(i for i, size in enumerate(chunk) if size > 1)
        chunk[i] = -(-chunk[i] // 2)
    return tuple(chunk)


def attach(items: Mapping[str, h5d.DatasetID], dims: Mapping[str, tuple[str, ...]]) -> None:
    """Link datasets to the datasets of their dimensions, which HDF5 calls scales."""
    for name, of_item in dims.items():
        if of_item != (name,):  # a coordinate is its own dimension
            for i, dim in enumerate(of_item):
                h5ds.attach_scale(items[name], items[dim], i)


def copy_group(source: h5py.Group, file: h5py.File, name: str) -> None:
    """Copy a group of another file. HDF5 breaks the links to dimensions, so they are made anew."""
    h5o.copy(source.id, b".", file.id, name.encode(), lcpl=LINK)
    items = datasets_of(h5py.Group(h5g.open(file.id, name.encode())))
    for item in items.values():
        for link in (b"REFERENCE_LIST", b"DIMENSION_LIST"):
            if h5a.exists(item, link):
                h5a.delete(item, link)
    with suppress(KeyError):  # a dimension that another program has removed
        attach(items, dimensions(datasets_of(source)))


def set_attributes(item: h5py.HLObject, attributes: Mapping[str, Attribute]) -> None:
    """Set attributes; texts have variable length, and every reader returns them as text."""
    for name, value in attributes.items():
        if h5a.exists(item.id, name.encode()):
            h5a.delete(item.id, name.encode())
        data = np.asarray(value)
        if isinstance(value, str):
            # A lone surrogate cannot be stored, and C readers stop at a zero.
            text = value.encode("utf-8", "replace").decode().replace("\0", "\ufffd")
            data = np.asarray(text, dtype=STRING)
        space = h5s.create_simple(data.shape) if data.shape else SCALAR
        in_file, in_memory = types(data.dtype)
        h5a.create(item.id, name.encode(), in_file, space).write(data, in_memory)


@cache
def types(dtype: np.dtype) -> tuple[h5t.TypeID, h5t.TypeID]:
    """The HDF5 types of a numpy type, in a file and in memory."""
    return h5t.py_create(dtype, logical=True), h5t.py_create(dtype)


def tracked(kind: h5p.PropClassID) -> h5p.PropOCID:
    """Settings for new groups or datasets: the order of creation is tracked, without which netCDF-4
    cannot append."""
    properties = h5p.create(kind)
    properties.set_obj_track_times(False)
    properties.set_attr_creation_order(h5p.CRT_ORDER_TRACKED | h5p.CRT_ORDER_INDEXED)
    return properties


TRACKED_GROUP, TRACKED_DATASET = tracked(h5p.GROUP_CREATE), tracked(h5p.DATASET_CREATE)
TRACKED_GROUP.set_link_creation_order(h5p.CRT_ORDER_TRACKED | h5p.CRT_ORDER_INDEXED)
# HDF5 would write buffered values when Python frees a dataset, where an error is lost.
AT_ONCE = h5p.create(h5p.FILE_ACCESS)
AT_ONCE.set_fclose_degree(h5f.CLOSE_STRONG)
AT_ONCE.set_sieve_buf_size(0)
AT_ONCE.set_cache(0, 0, 0, 0)
# The settings of `h5py.File`; one process alone has a draft open.
AT_ONCE.set_libver_bounds(h5f.LIBVER_EARLIEST, h5f.LIBVER_LATEST)
AT_ONCE.set_file_locking(False, True)
SCALAR, LINK = h5s.create(h5s.SCALAR), h5p.create(h5p.LINK_CREATE)
LINK.set_char_encoding(h5t.CSET_UTF8)


def short_ones(attributes: Mapping[str, Attribute]) -> dict[str, Any]:
    """The short texts and numbers among attributes."""
    arrays = {name: np.asarray(value) for name, value in attributes.items()}
    plain = {name: array.item() for name, array in arrays.items() if array.shape == ()}
    return {name: x for name, x in plain.items() if len(str(x)) <= MAX_SHORT_CHARACTERS}


# Reading

DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, MemoryError)
"""What h5py raises when the bytes of a file make no sense."""


class ResultFile:
    """A result that is open for reading; `open_run` makes it. `groups` are the names of all groups;
    `intact` says whether its bytes are as hodo has written them."""

    def __init__(self, path: Path, file: h5py.File, intact: bool) -> None:
        self.path, self.intact, self._file = path, intact, file
        self.attributes, self.groups = attributes_of(file), dict.fromkeys(file)

    @property
    def text(self) -> str:
        """The case file that was run."""
        return str(self.attributes.get("config", ""))

    def cases(self) -> list[str]:
        """The names of the cases, in the order of the case file: the groups that hold the text of a
        case and do not begin with `_`, unless the file states other content."""
        if CONTENT in self.attributes:
            return []
        return [name for name in self.groups if not name.startswith("_") and self._has_case(name)]

    def _has_case(self, name: str) -> bool:
        """Whether a group holds the text of a case, as the groups of other programs do not."""
        try:
            return bool(h5a.exists(self._file.id, b"case", obj_name=name.encode()))
        except DAMAGE:  # reading the group reports it
            return True

    def __contains__(self, name: str) -> bool:
        return name in self.groups

    def summary(self, name: str, only: Collection[str] = ()) -> dict[str, Any]:
        """The attributes of a group (all, or the named ones), without reading an array. Raises
        HodoError if the group is missing or damaged."""
        # By the group's name: opening the group first takes twice the time.
        short = short_attributes(self._file, name) if self.intact else {}
        if only and short.keys() >= {*only}:
            return {key: short[key] for key in only}
        with self.open_group(name) as group:
            return attributes_of(group, only)

    def row(self, name: str, kinds: Mapping[str, type]) -> dict[str, Any]:
        """Some attributes of a group, with their types. Raises HodoError as `summary` and `typed`
        do."""
        return typed(self.summary(name, kinds), kinds, f"{self.path}: {name}")

    def read(self, name: str) -> Group:
        """A whole group. Raises HodoError as `summary` does."""
        short = short_attributes(self._file, name) if self.intact else {}
        with self.open_group(name) as group:
            items = datasets_of(group)
            variables = {
                key: Variable(dims, values_of(items[key]), attributes_of(h5py.Dataset(items[key])))
                for key, dims in dimensions(items).items()
            }
            return Group(attributes_of(group, known=short), variables)

    def blocks(
        self, name: str, variables: Iterable[str], box: tuple[slice, ...]
    ) -> Iterator[tuple[str, np.ndarray]]:
        """A box of some variables of a group, with their names; the box is in the first dimensions.
        Raises HodoError as `summary` does."""
        with self.open_group(name) as group:
            for key in variables:
                yield key, group[key][box]

    def report(self, name: str, digest: str) -> Any:
        """The line that a command has printed of a group, if the digest stored with it is this one;
        else None."""
        stored = self.summary(name, (REPORT_DIGEST, REPORT)) if self.intact else {}
        return json.loads(stored[REPORT]) if stored.get(REPORT_DIGEST) == digest else None

    def checksum(self, name: str) -> str:
        """A text that identifies the content of a group without reading it; empty if another
        program may have changed the file."""
        return str(self.summary(name, (STAMP,)).get(STAMP, "")) if self.intact else ""

    @contextmanager
    def open_group(self, name: str) -> Iterator[h5py.Group]:
        """A group as h5py opens it. Raises HodoError if it is missing or damaged."""
        if name not in self.groups:
            raise HodoError(f"{self.path}: there is no case {name!r}")
        try:
            yield self._file[name]
        except DAMAGE as error:
            raise HodoError(f"{self.path}: {name} is damaged ({first_line(error)})") from error


def short_attributes(item: h5py.Group, name: str = ".") -> dict[str, Any]:
    """The short attributes of a group, if it has the attribute that holds them all; else none."""
    with suppress(*DAMAGE):
        listed = h5a.open(item.id, SHORT_ATTRIBUTES.encode(), obj_name=name.encode())
        return dict(json.loads(one_value(listed)))
    return {}


def attributes_of(
    item: h5py.HLObject, only: Collection[str] = (), known: Mapping[str, Any] = {}
) -> dict[str, Any]:
    """The attributes as plain values: all in their order, or those named in `only` in its order.
    Values in `known` are not read again."""
    # To ask for a few attributes takes less time than to list all.
    asked = [name for name in only if h5a.exists(item.id, name.encode())]
    names = asked if only else [name for name in item.attrs if name not in HIDDEN]
    return {name: known[name] if name in known else attribute_of(item, name) for name in names}


def attribute_of(item: h5py.HLObject, name: str) -> Any:
    """The value of an attribute, as a plain value if possible."""
    value = one_value(h5a.open(item.id, name.encode()))
    value = item.attrs[name] if value is None else value
    value = value.item() if isinstance(value, np.generic) else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def one_value(stored: h5a.AttrID) -> Any:
    """The value of an attribute that is one text or one number, as most are; None for others."""
    kind = stored.get_type() if stored.shape == () else None
    if isinstance(kind, h5t.TypeStringID) and kind.is_variable_str():
        text = np.empty((), STRING)
        stored.read(text, mtype=types(STRING)[1])
        return text.item()
    if isinstance(kind, h5t.TypeIntegerID | h5t.TypeFloatID):
        number = np.empty((), kind.dtype)
        stored.read(number)
        return number[()]
    return None


def values_of(item: h5d.DatasetID) -> np.ndarray:
    """The values of a dataset."""
    if h5py.check_string_dtype(item.dtype):
        return np.asarray(h5py.Dataset(item).asstr()[()])
    if item.shape is None:  # another program's dataset without a value
        return np.asarray(h5py.Dataset(item)[()])
    values = np.empty(item.shape, item.dtype)
    item.read(h5s.ALL, h5s.ALL, values)
    return values


def datasets_of(group: h5py.Group) -> dict[str, h5d.DatasetID]:
    """The datasets of a group, by name."""
    objects = {name: h5o.open(group.id, name.encode()) for name in group}
    return {name: item for name, item in objects.items() if isinstance(item, h5d.DatasetID)}


def dimensions(items: Mapping[str, h5d.DatasetID]) -> dict[str, tuple[str, ...]]:
    """The dimensions of each variable among the datasets of a group, without those that only mark
    dimensions."""
    # Datasets are compared by their places in the file: HDF5 takes milliseconds to find a name.
    names = {place_in_file(item): name for name, item in items.items()}
    # Without a list of dimensions a dataset is a number, or the coordinate of its own dimension.
    return {
        name: tuple(names[h5ds.iterate(item, i, place_in_file)] for i in range(item.rank))
        if h5a.exists(item, b"DIMENSION_LIST")
        else (name,) * item.rank
        for name, item in items.items()
        if not (h5ds.is_scale(item) and h5ds.get_scale_name(item).startswith(NO_VARIABLE))
    }


def place_in_file(item: h5d.DatasetID) -> int:
    """The unique place of a dataset in its file."""
    return int(h5o.get_info(item).addr)


@contextmanager
def open_run(path: Path | str) -> Iterator[ResultFile]:
    """A result, open for reading.

    Raises HodoError if it is missing, unreadable, in use for writing, damaged, not hodo's, or of a
    newer format, and BatchError if the machine cannot open it.
    """
    path = Path(path)
    try:
        intact = is_marked(path)
        # Some network file systems have no locks, and a file that exists is complete in any case.
        file = h5py.File(path, "r", locking="best-effort")
    except OSError as error:
        lacks = error.errno in RESOURCES and not isinstance(error, BlockingIOError)
        kind = BatchError if lacks else HodoError
        raise kind(f"{path}: {why_closed(error)}") from None
    with file:
        run = _result_of(path, file, intact)
        if not intact:
            warnings.warn(f"{path} has no checksum: damage to it would not show", stacklevel=3)
        yield run


def _result_of(path: Path, file: h5py.File, intact: bool) -> ResultFile:
    """The result in a file that h5py has opened. Raises HodoError if it is no result, or is
    damaged."""
    try:
        run = ResultFile(path, file, intact)
    except DAMAGE as error:
        raise HodoError(f"{path}: {refusal(error) or f'damaged ({first_line(error)})'}") from error
    version = run.attributes.get("format_version", 0)
    if not (isinstance(version, int) and version > 0):
        raise HodoError(f"{path} is not a result of hodo")
    if version > FORMAT_VERSION:
        raise HodoError(f"{path} has a newer format than this hodo reads: update hodo")
    return run


def why_closed(error: OSError) -> str:
    """Why a file cannot be opened."""
    if isinstance(error, BlockingIOError):
        return "locked: another program has it open for writing"
    if isinstance(error, IsADirectoryError):
        return "a folder, not a file"
    if "truncated file" in str(error):
        return "truncated: its end is missing"
    return refusal(error) or "not an HDF5 file (hodo run makes one of a case file)"
