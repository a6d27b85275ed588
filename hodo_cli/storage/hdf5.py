"""Groups of labelled arrays in HDF5 files that netCDF-4 reads too.

Every array of numbers carries `fletcher32`, so that any reader notices a changed bit. A file ends
with the SHA-256 of all bytes before it, behind the HDF5 part, where other readers do not look: it
is compared before HDF5 sees a byte, and goes when another program changes the file.
"""

import hashlib
import json
import os
import re
import shutil
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5ds, h5o, h5s, h5t

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
    """Variables too large for memory: their arrays carry only shape and dtype, and the values come
    from `blocks()` as (name, where, block) when the group is written."""

    names: frozenset[str]
    blocks: Callable[[], Iterator[tuple[str, Any, np.ndarray]]]


@dataclass(frozen=True)
class Group:
    """What a group holds. A variable that is named as its only dimension is that dimension's
    coordinate."""

    attributes: Mapping[str, Attribute]
    variables: Mapping[str, Variable]
    streamed: StreamedVariables | None = None

    def with_addition(self, addition: "Group") -> "Group":
        """This group with what another adds to it or replaces."""
        attributes = {**self.attributes, **addition.attributes}
        return Group(attributes, {**self.variables, **addition.variables})

    def with_report(self, digest: str, rows: Any) -> "Group":
        """This group with what a command prints of it, and the digest of what that depends on
        besides the group: see `ResultFile.report`."""
        return self.with_addition(Group({REPORT_DIGEST: digest, REPORT: json.dumps(rows)}, {}))


def dimension_sizes(variables: Mapping[str, Variable]) -> dict[str, int]:
    """The sizes of the dimensions of variables. Raises ValueError for one that has two."""
    sizes: dict[str, int] = {}
    for name, variable in variables.items():
        for dim, size in zip(variable.dims, variable.data.shape, strict=True):
            if sizes.setdefault(dim, size) != size:
                raise ValueError(f"{name} has {size} values along {dim}, elsewhere {sizes[dim]}")
    return sizes


# Files

MARK = b"\nhodo sha256 "
MARK_BYTES = len(MARK) + 64
"""The bytes behind the HDF5 part of a file that hold the hash of those before."""


@contextmanager
def refused_as(path: Path, parts: Path | None = None) -> Iterator[None]:
    """Make a BatchError of what the operating system refuses, which says so if there are finished
    cases in a folder."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if not (reason := refusal(error)):
            raise
        if file := next(filter(os.path.isfile, path.parents), None):
            reason = f"{file} is a file, not a folder"
        kept = "; finished cases are kept" if parts and any(parts.glob("c*")) else ""
        raise BatchError(f"cannot write {path}: {reason}{kept}") from error


def refusal(error: BaseException) -> str:
    """What the operating system said (no space, no permission), or nothing."""
    # HDF5 gives it in the text of its own errors.
    quoted = re.search(r"errno = (\d+)", str(error))
    number = int(quoted[1]) if quoted else getattr(error, "errno", None)
    return os.strerror(number).lower() if number else ""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name for a new file, which takes the place of `path` when the block ends well: a name that
    exists is complete. Raises BatchError if the operating system refuses it."""
    with refused_as(path), drafted(path, path.parent) as draft:
        yield draft


@contextmanager
def drafted(path: Path, folder: Path) -> Iterator[Path]:
    """As `replacing`, with the draft in a folder of the same disk. Raises OSError."""
    # What is written through a link goes where it points.
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
    if os.name == "nt" and path.is_dir():  # which Windows does not open
        return
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def create(file: Path, attributes: Mapping[str, Attribute], room: int) -> Iterator[h5py.File]:
    """A new file with these root attributes, to be filled with at most so many bytes. Raises
    OSError if these do not fit on the disk."""
    with h5py.File(file, "w", track_order=True, locking="best-effort") as new:
        set_attributes(new, {"format_version": FORMAT_VERSION, **attributes})
    with open(file, "r+b") as disk:
        # HDF5 takes the process down over a full disk, so the room is taken before.
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(disk.fileno(), 0, disk.seek(0, os.SEEK_END) + room)
    with h5py.File(file, "r+", locking="best-effort") as new:
        yield new
    mark = MARK + hash_of(file, file.stat().st_size).encode()
    with open(file, "ab") as disk:
        disk.write(mark)


def save_groups(
    file: Path, groups: Mapping[str, Group], attributes: Mapping[str, Attribute] = {}
) -> None:
    """Write a new file with these groups and root attributes. Raises OSError as `create` does."""
    with create(file, attributes, sum(map(room_for, groups.values()))) as new:
        for name, group in groups.items():
            write_group(new, name, group)


def room_for(group: Group) -> int:
    """The bytes that a group takes in a file at most."""
    arrays = [variable.data for variable in group.variables.values()]
    texts = [text for data in arrays if data.dtype.kind in "OU" for text in data.flat]
    texts += [text for text in group.attributes.values() if isinstance(text, str)]
    numbers = sum(data.nbytes + data.nbytes // 100 + 10_000 for data in arrays)
    return 100_000 + numbers + sum(4 * len(text) + 200 for text in texts)


def hash_of(file: Path, size: int) -> str:
    """The hash of the first bytes of a file, in hexadecimal digits."""
    hashed = hashlib.sha256()
    with open(file, "rb") as disk:
        while size > 0 and (block := disk.read(min(size, 1 << 20))):
            hashed.update(block)
            size -= len(block)
    return hashed.hexdigest()


def is_marked(path: Path) -> bool:
    """Whether a file has the mark of its bytes. Raises HodoError if that does not fit, and OSError
    if the file cannot be read."""
    status = path.stat()
    return _is_marked(path, status.st_ino, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4096)
def _is_marked(path: Path, inode: int, changed: int, size: int) -> bool:
    with open(path, "rb") as file:
        file.seek(max(size - MARK_BYTES, 0))
        mark = file.read()
    if mark.startswith(MARK) and mark != MARK + hash_of(path, size - MARK_BYTES).encode():
        sound = "h5py reads what is sound of it"
        way_out = f"restore it, or move it away and run again; {sound}"
        raise HodoError(f"{path} is damaged (its checksum does not fit): {way_out}")
    return mark.startswith(MARK)


# Writing

STRING = h5py.string_dtype()
# netCDF-4's own sign of a dimension without a coordinate; its readers look for these very words.
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable."

REPORT_DIGEST, REPORT, SHORT_ATTRIBUTES, STAMP = "told_mark", "told", "listed", "stamp"
"""Attributes of a group that are believed only in a file which no other program has changed: what a
command has printed of it; its short attributes once more, as JSON (a batch is listed by one
attribute a case and not by eleven, each of which takes 10 to 30 us); and a number that is another
one after each change."""

BOOKKEEPING = (REPORT_DIGEST, REPORT, SHORT_ATTRIBUTES, STAMP)

HIDDEN = (
    *("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates"),
    *("checksum", *BOOKKEEPING),
)
"""Attributes that are no data: links of dimensions, and the checksum of files of version 0.2."""

MAX_SHORT_CHARACTERS = 1000

WHOLE_CHUNK = 1 << 16
"""Numbers of an array that is stored in one piece."""


def write_group(file: h5py.File, name: str, group: Group) -> None:
    """Add a group, or replace it. Raises ValueError if its variables differ in the size of a
    dimension, and TypeError for an array that netCDF does not know."""
    file.pop(name, None)
    amend_group(file.create_group(name, track_order=True), group)


def amend_group(target: h5py.Group, group: Group) -> None:
    """Add attributes and variables to a group, or replace them."""
    sizes = dimension_sizes(group.variables)
    kept = {k: v for k, v in short_attributes(target).items() if k not in group.attributes}
    listed = json.dumps(kept | short_ones(group.attributes))
    stamp = os.urandom(8).hex()
    set_attributes(target, {**group.attributes, SHORT_ATTRIBUTES: listed, STAMP: stamp})
    late = group.streamed.names if group.streamed else ()
    for name, variable in group.variables.items():
        if name in sizes and name in target:  # other variables are linked to it
            target[name][...] = variable.data
        else:
            target.pop(name, None)
            set_attributes(new_dataset(target, name, variable.data, name in late), variable.attrs)
    for dim, size in sizes.items():
        if dim in group.variables and not h5ds.is_scale(target[dim].id):
            target[dim].make_scale(dim)
        elif dim not in target or target[dim].shape != (size,):
            target.pop(dim, None)
            # A big-endian float that is never written, as netCDF-4 makes it: it takes no room.
            target.create_dataset(dim, (size,), ">f4", track_order=True)
            target[dim].make_scale(f"{NO_VARIABLE}{size:10d}")
    attach(target, {name: variable.dims for name, variable in group.variables.items()})
    for name, where, block in group.streamed.blocks() if group.streamed else ():
        target[name][where] = block


def new_dataset(parent: h5py.Group, name: str, data: np.ndarray, is_late: bool) -> h5py.Dataset:
    """A new dataset for an array, with its values unless they come later."""
    is_text = data.dtype.kind in "OU"
    # Old netCDF readers lose bool, and crash on half and long double.
    if not is_text and data.dtype.str[1:] not in ("i1", "i2", "i4", "i8", "u1", "u2", "f4", "f8"):
        raise TypeError(f"{name}: netCDF has no type {data.dtype}")
    is_checked = bool(not is_text and data.ndim and data.size)
    chunks = (data.shape if data.size <= WHOLE_CHUNK else True) if is_checked else None
    return parent.create_dataset(
        name,
        data.shape,
        STRING if is_text else data.dtype,
        None if is_late else data,
        chunks=chunks,
        fletcher32=is_checked,
        track_order=True,
    )


def attach(group: h5py.Group, dims: Mapping[str, tuple[str, ...]]) -> None:
    """Link datasets to their dimensions; a scale is attached to others, never to itself."""
    for name, of_item in dims.items():
        for i, dim in enumerate(of_item if (name,) != of_item else ()):
            h5ds.attach_scale(group[name].id, group[dim].id, i)


def copy_group(source: h5py.Group, file: h5py.File, name: str) -> None:
    """Copy a group of another file. HDF5 breaks the links to dimensions: they are made anew."""
    file.copy(source, name)
    for item in file[name].values():
        for link in ("REFERENCE_LIST", "DIMENSION_LIST"):
            item.attrs.pop(link, None)
    attach(file[name], dimensions(source))


def set_attributes(item: h5py.HLObject, attributes: Mapping[str, Attribute]) -> None:
    """Set attributes; texts have variable length, which every reader gives back as text. `attrs` of
    h5py takes three times as long, and a case has forty."""
    for name, value in attributes.items():
        if h5a.exists(item.id, name.encode()):
            h5a.delete(item.id, name.encode())
        # Half a surrogate cannot be stored, and at a zero C readers would stop.
        text = str(value).encode("utf-8", "replace").decode().replace("\0", "\ufffd")
        is_text = isinstance(value, str)
        data = np.asarray(text, dtype=STRING) if is_text else np.asarray(value)
        space = h5s.create_simple(data.shape) if data.shape else h5s.create(h5s.SCALAR)
        kind = h5t.py_create(data.dtype, logical=True)
        h5a.create(item.id, name.encode(), kind, space).write(data)


def short_ones(attributes: Mapping[str, Attribute]) -> dict[str, Any]:
    """The short texts and numbers among attributes."""
    arrays = {name: np.asarray(value) for name, value in attributes.items()}
    plain = {name: array.item() for name, array in arrays.items() if array.shape == ()}
    return {name: x for name, x in plain.items() if len(str(x)) <= MAX_SHORT_CHARACTERS}


# Reading

DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, MemoryError)
"""What h5py raises when the bytes of a file make no sense."""


class ResultFile:
    """A result that is open for reading; made by `open_run`. `groups` are the names of all groups;
    `intact` is whether its bytes are as hodo has written them."""

    def __init__(self, path: Path, file: h5py.File, intact: bool) -> None:
        self.path, self.intact, self._file = path, intact, file
        self.attributes, self.groups = attributes_of(file), dict.fromkeys(file)

    @property
    def text(self) -> str:
        """The case file that was run."""
        return str(self.attributes.get("config", ""))

    def cases(self) -> list[str]:
        """The names of the cases, in the order of the case file: the groups that do not begin with
        `_`, unless the file says that it holds something else."""
        is_other = CONTENT in self.attributes
        return [name for name in self.groups if not (is_other or name.startswith("_"))]

    def __contains__(self, name: str) -> bool:
        return name in self.groups

    def summary(self, name: str, only: Collection[str] = ()) -> dict[str, Any]:
        """The attributes of a group (all, or those named), without reading an array. Raises
        HodoError if there is no such group or it is damaged."""
        # By the name of the group: to open the group first takes twice the time.
        short = short_attributes(self._file, name) if self.intact else {}
        if only and short.keys() >= {*only}:
            return {key: short[key] for key in only}
        with self.open_group(name) as group:
            return attributes_of(group, only)

    def row(self, name: str, kinds: Mapping[str, type]) -> dict[str, Any]:
        """Some attributes of a group. Raises HodoError as `summary` does, and as `typed` does."""
        return typed(self.summary(name, kinds), kinds, f"{self.path}: {name}")

    def read(self, name: str) -> Group:
        """A group whole. Raises HodoError as `summary` does."""
        with self.open_group(name) as group:
            items = {key: (dims, group[key]) for key, dims in dimensions(group).items()}
            variables = {
                key: Variable(dims, values_of(item), attributes_of(item))
                for key, (dims, item) in items.items()
            }
            return Group(attributes_of(group), variables)

    def blocks(
        self, name: str, variables: Iterable[str], box: tuple[slice, ...]
    ) -> Iterator[tuple[str, np.ndarray]]:
        """A box of some variables of a group, each with its name: of the first of its dimensions.
        Raises HodoError as `summary` does."""
        with self.open_group(name) as group:
            for key in variables:
                yield key, group[key][box]

    def report(self, name: str, digest: str) -> Any:
        """What a command has printed of a group, if that was made of this digest; else None."""
        known = self.summary(name, (REPORT_DIGEST, REPORT)) if self.intact else {}
        return json.loads(known[REPORT]) if known.get(REPORT_DIGEST) == digest else None

    def checksum(self, name: str) -> str:
        """What tells the content of a group from any other without reading it; empty if another
        program may have changed that."""
        return str(self.summary(name, (STAMP,)).get(STAMP, "")) if self.intact else ""

    @contextmanager
    def open_group(self, name: str) -> Iterator[h5py.Group]:
        """A group as h5py opens it. Raises HodoError if there is none, or it is damaged."""
        if name not in self.groups:
            raise HodoError(f"{self.path}: there is no case {name!r}")
        try:
            yield self._file[name]
        except DAMAGE as error:
            raise HodoError(f"{self.path}: {name} is damaged ({first_line(error)})") from error


def short_attributes(item: h5py.Group, name: str = ".") -> dict[str, Any]:
    """The short attributes of a group, where they are stored as one; none if it has no such."""
    text = np.empty((), STRING)
    with suppress(*DAMAGE):
        listed = h5a.open(item.id, SHORT_ATTRIBUTES.encode(), obj_name=name.encode())
        listed.read(text, mtype=h5t.py_create(STRING))
        return dict(json.loads(text.item()))
    return {}


def attributes_of(item: h5py.HLObject, only: Collection[str] = ()) -> dict[str, Any]:
    """Attributes as plain values, in their order, or those of `only`, in its order."""
    # To ask for a few takes less time than to list all.
    asked = [name for name in only if h5a.exists(item.id, name.encode())]
    names = asked if only else [name for name in item.attrs if name not in HIDDEN]
    return {name: plain_value(item.attrs[name]) for name in names}


def plain_value(value: Any) -> Any:
    """The value of an attribute as a plain one where it is one."""
    value = value.item() if isinstance(value, np.generic) else value
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def values_of(item: h5py.Dataset) -> np.ndarray:
    """The values of a dataset."""
    return np.asarray(item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()])


def dimensions(group: h5py.Group) -> dict[str, tuple[str, ...]]:
    """The variables of a group with the dimensions of each; not what stands for a dimension without
    values."""
    items = {name: item for name, item in group.items() if isinstance(item, h5py.Dataset)}
    # By place_in_file: HDF5 itself takes milliseconds to find a name.
    names = {place_in_file(item.id): name for name, item in items.items()}
    return {
        name: tuple(names[h5ds.iterate(item.id, i, place_in_file)] for i in range(item.ndim))
        if h5a.exists(item.id, b"DIMENSION_LIST")
        else (name,) * item.ndim
        for name, item in items.items()
        if not (h5ds.is_scale(item.id) and NO_VARIABLE.encode() in h5ds.get_scale_name(item.id))
    }


def place_in_file(item: h5py.h5d.DatasetID) -> int:
    """Where a dataset is in its file, which no two share."""
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
        # Some network file systems have no locks, and what is there is complete in any case.
        file = h5py.File(path, "r", locking="best-effort")
    except OSError as error:
        lacks = error.errno in RESOURCES and not isinstance(error, BlockingIOError)
        raise (BatchError if lacks else HodoError)(f"{path}: {why_closed(error)}") from None
    with file:
        version = file.attrs.get("format_version", 0)
        if not (isinstance(version, np.integer) and 0 < version <= FORMAT_VERSION):
            raise HodoError(f"{path} is no result of hodo, or of a newer version: update hodo")
        if not intact:
            warnings.warn(f"{path} has no checksum: damage to it would not show", stacklevel=3)
        yield ResultFile(path, file, intact)


def why_closed(error: OSError) -> str:
    """Why a file cannot be opened."""
    if isinstance(error, BlockingIOError):
        return "locked: another program has it open for writing"
    return refusal(error) or f"no HDF5 file, or a part of one ({first_line(error)})"
