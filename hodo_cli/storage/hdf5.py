"""Labelled arrays in HDF5 that netCDF-4 readers understand, group by group. The only importer of
h5py."""

import os
import shutil
import stat
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5f, h5g, h5l, h5o, h5p, h5s, h5t

from .. import HodoError
from ..batch import memory
from .disk import (
    PATIENCE_OF_READER,
    SLOW_DISK,
    Checksum,
    Digest,
    Disk,
    digest_of,
    is_sealed,
    look,
    refusal,
    seal,
)
from .provenance import FORMAT_VERSION, typed

STRING = h5py.string_dtype()
TEXT_IN_MEMORY = h5t.py_create(STRING)
SCALAR = h5s.create(h5s.SCALAR)
# netCDF-4's own mark of a dimension without a coordinate; its readers look for these very words.
NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable."
# The bookkeeping of dimension scales, which says nothing about the data.
HIDDEN = (
    "CLASS",
    "NAME",
    "REFERENCE_LIST",
    "DIMENSION_LIST",
    "_Netcdf4Dimid",
    "_Netcdf4Coordinates",
    "checksum",
)
"""Attributes that say nothing of the data: the links of dimensions, and the checksum."""

DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, MemoryError)
"""What h5py raises when the bytes of a file make no sense."""

TOLD_ATTRIBUTES = ("told_mark", "told")
"""Attributes that stand behind the checksum: what a command has told of the data under it."""

INFLATION = 1000
"""A dataset may claim so many times the bytes that are stored of it, as compression may save; one
that claims more was never written, and would fill the memory."""

FEW_BYTES = 1 << 20
"""What a dataset may claim in any case."""

MOST_ITEMS = 1000
"""Datasets or attributes in a group: ten times those of any case, and far fewer than would keep
HDF5, which looks for each by its name, busy for minutes."""

FEW_TEXTS = 16
"""Texts that are read at once: a compromise between time, and memory if each is the whole file."""

Dimensions: TypeAlias = Mapping[str, tuple[str, ...]]
"""The dimensions of each variable of a group."""

Attribute = str | int | float | np.ndarray

H5Object: TypeAlias = h5f.FileID | h5g.GroupID | h5d.DatasetID
"""What attributes stand at."""


@dataclass(frozen=True)
class Variable:
    """A labelled array: numbers that netCDF knows (not bool, half or long double), or strings."""

    dims: tuple[str, ...]
    data: np.ndarray
    attrs: dict[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class Late:
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
    late: Late | None = None


class Run:
    """A result file that is open for reading; made by `open_run`."""

    _intact = False
    """Whether all bytes are as hodo has written them."""

    def __init__(self, path: Path, file: h5py.File, damaged: Mapping[str, str]) -> None:
        self.path = path
        self.damaged = damaged
        self._intact = damaged is INTACT
        self.attributes: dict[str, Any] = _attributes(file)
        self._file = file

    @property
    def text(self) -> str:
        """The case file that was run."""
        return str(self.attributes.get("config", ""))

    def groups(self) -> list[str]:
        """The names of all groups, in their order."""
        return list(self._file)

    def cases(self) -> list[str]:
        """The names of the cases, in the order of the case file: the groups that do not begin with
        `_`."""
        return [name for name in self._file if not name.startswith("_")]

    def __contains__(self, name: str) -> bool:
        return name in self._file

    def check_root(self) -> str:
        """What is wrong with the root attributes; an empty string if nothing is."""
        told, covered = _covered(self._file)
        known = {key: self.attributes[key] for key in covered}
        return "" if told in ("", _checksum(known, {}, told)) else "its head has changed"

    def summary(self, name: str, only: Collection[str] = ()) -> dict[str, Any]:
        """The attributes of a group (all, or those named), without reading an array.

        Raises HodoError if there is no such group or it is damaged.
        """
        with self._group(name) as group:
            return _attributes(group, only)

    def row(self, name: str, kinds: Mapping[str, type]) -> dict[str, Any]:
        """Some attributes of a group. Raises HodoError as `summary` does, and as `typed` does."""
        return typed(self.summary(name, kinds), kinds, f"{self.path}: {name}")

    def read(self, name: str) -> Group:
        """A group whole. Raises HodoError if there is no such group, or it is damaged or too
        large."""
        with self._group(name) as group:
            items = _datasets(group)
            named, variables = _by_address(items), {}
            for key, item in items.items():
                if _is_placeholder(item):
                    continue
                # Asked for before reading: HDF5 promises any size that a damaged header names.
                if item.nbytes > memory.limit():
                    size = memory.in_bytes(item.nbytes)
                    raise HodoError(f"{self.path}: {name}/{key} does not fit into memory: {size}")
                data = _texts(item) if h5py.check_string_dtype(item.dtype) else item[()]
                variables[key] = Variable(
                    _dims(item, named) or (key,) * data.ndim, data, _attributes(item)
                )
            return Group(_attributes(group), variables)

    def array(self, name: str, key: str) -> np.ndarray:
        """The values of one variable of a group. Raises HodoError as `read` does."""
        with self._group(name) as group:
            return np.asarray(_dataset(group, key)[()])

    @contextmanager
    def _group(self, name: str) -> Iterator[h5py.Group]:
        if reason := self.damaged.get(name):
            raise HodoError(f"{self.path}: {name} is damaged ({reason})")
        try:
            if name and "/" not in name and _is_hard(self._file, name):
                group = h5o.open(self._file.id, _encoded(name))
                if isinstance(group, h5g.GroupID):
                    yield h5py.Group(group)
                    return
        except DAMAGE as error:
            if reason := refusal(error):
                raise HodoError(f"{self.path} cannot be read: {reason}") from error
            raise HodoError(f"{self.path}: {name} is damaged ({_first_line(error)})") from error
        raise HodoError(f"{self.path}: there is no case {name!r}")

    def check(self, name: str) -> str:
        """What is wrong with a group, all of it read; an empty string if nothing is."""
        try:
            with self._group(name) as group:
                told, covered = _covered(group)
            found = self.read(name)
            known = {key: found.attributes[key] for key in covered}
            return "" if told in ("", _checksum(known, found.variables, told)) else MISFIT
        except HodoError as error:
            reason = str(error).removeprefix(f"{self.path}: ")
            return reason.removeprefix(f"{name} is damaged (").removesuffix(")")

    def checksum(self, name: str) -> str:
        """The checksum that is stored with a group, which tells its content from any other without
        reading it.

        Empty if there is none, or the file's seal does not fit: something may then have been added
        that no checksum covers. Raises HodoError as `summary` does.
        """
        with self._group(name) as group:
            return str(group.attrs.get("checksum", "")) if self._intact else ""

    def lacks_checksum(self, name: str) -> bool:
        """Whether damage to a group would not be noticed."""
        if name in self.damaged:
            return False
        with self._group(name) as group:
            return "checksum" not in group.attrs


MISFIT = "its checksum does not fit"


def checksum_of(group: Group) -> str:
    """The checksum that a group is stored with."""
    return _checksum_with(group, {})


def _checksum_with(group: Group, digests: Mapping[str, Digest]) -> str:
    """The checksum of a group, some of whose variables were digested as they were written."""
    covered = {key: value for key, value in group.attributes.items() if key not in TOLD_ATTRIBUTES}
    found = Checksum(_as_stored(covered))
    for key, variable in group.variables.items():
        digest = str(digests[key]) if key in digests else digest_of(variable.data)
        found.add(key, variable.dims, digest, _as_stored(variable.attrs))
    return str(found)


def _covered(item: h5py.HLObject) -> tuple[str, list[str]]:
    """The checksum of a group and the attributes that it covers, which are those before it; an
    empty text if there is none."""
    names = list(item.attrs)
    if "checksum" not in names:
        return "", []
    before = names[: names.index("checksum")]
    return str(item.attrs["checksum"]), [name for name in before if name not in HIDDEN]


def _checksum(attributes: Mapping[str, Any], variables: Mapping[str, Variable], told: str) -> str:
    """The checksum of attributes and of so many variables as the checksum told covers."""
    count = told.split(":")[1] if told.count(":") == 2 else ""
    found = Checksum(attributes)
    for name, variable in [*variables.items()][: int(count) if count.isdecimal() else 0]:
        found.add(name, variable.dims, digest_of(variable.data), variable.attrs)
    return str(found)


def _is_placeholder(item: h5py.Dataset) -> bool:
    """Whether a dataset stands for a dimension without values of its own."""
    return bool(h5ds.is_scale(item.id) and h5ds.get_scale_name(item.id).startswith(NO_VARIABLE))


def _datasets(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """What a group holds. Raises ValueError as `_dataset` does."""
    if len(group) > MOST_ITEMS:
        raise ValueError(f"it holds {len(group)} datasets")
    if strange := [name for name in group if not name.isprintable()]:
        raise ValueError(f"it holds {strange[0]!r}")
    return {name: _dataset(group, name) for name in group}


def _dataset(group: h5py.Group, name: str) -> h5py.Dataset:
    """An item of a group. Raises ValueError if that is anything but a plain dataset: a link, a
    group, values in other files or made from other datasets, elements that are addresses, and a
    size that was never written would let a file from a stranger read this machine's files or fill
    its memory."""
    if not _is_hard(group, name):
        raise ValueError(f"{name} is a link")
    opened = h5o.open(group.id, _encoded(name))
    if not isinstance(opened, h5d.DatasetID):
        raise ValueError(f"{name} is no dataset")
    item = h5py.Dataset(opened)
    if item.external or item.is_virtual:
        raise ValueError(f"the values of {name} are in other files")
    is_plain = _is_number(item.dtype) or h5py.check_string_dtype(item.dtype)
    if not is_plain or item.shape is None:
        raise ValueError(f"{name} holds neither numbers nor texts")
    stored = item.id.get_storage_size()
    if item.nbytes > FEW_BYTES + INFLATION * stored and not _is_placeholder(item):
        claimed, there = memory.in_bytes(item.nbytes), memory.in_bytes(stored)
        raise ValueError(f"{name} claims {claimed}, of which {there} are stored")
    return item


def _is_hard(group: h5py.Group, name: str) -> bool:
    """Whether a group has an item of this name itself, and not in another place or file."""
    links, link = group.id.links, _encoded(name)
    return bool(links.exists(link) and links.get_info(link).type == h5l.TYPE_HARD)


def _texts(item: h5py.Dataset) -> np.ndarray:
    """A list of texts, a few at a time: any number of them may be the same long text of a small
    file. Raises ValueError if they are longer than the file."""
    if item.ndim != 1:
        raise ValueError(f"{item.name} is no list of texts")
    texts, left = np.empty(len(item), dtype=object), item.file.id.get_filesize()
    for few in (slice(start, start + FEW_TEXTS) for start in range(0, len(item), FEW_TEXTS)):
        texts[few] = item.asstr()[few]
        left -= sum(map(len, texts[few]))
        if left < 0:
            raise ValueError(f"the texts of {item.name} are longer than the file")
    return texts


@contextmanager
def open_run(path: Path | str) -> Iterator[Run]:
    """A result file, open for reading.

    Raises HodoError if it is missing, unreadable, in use for writing, damaged, not hodo's, or of a
    newer format.
    """
    path = Path(path)
    damaged = _damage(path)
    if reason := damaged.get(""):
        raise HodoError(f"{path} is damaged ({reason})")
    file = _opened(path)
    with file:
        try:
            run = Run(path, file, damaged)
        except DAMAGE as error:
            raise HodoError(f"{path} is damaged ({_first_line(error)})") from None
        version = run.attributes.get("format_version")
        if not isinstance(version, int):
            raise HodoError(f"{path} is HDF5, but not a result of hodo (it has no format_version)")
        if version > FORMAT_VERSION:
            newer = f"newer than {FORMAT_VERSION}: update hodo to read it"
            raise HodoError(f"{path} has format version {version}, {newer}")
        # A line of a message is one line, and a terminal obeys what it is sent.
        if strange := [name for name in run.groups() if not name.isprintable()]:
            raise HodoError(f"{path} is damaged (a group is named {strange[0]!r})")
        if reason := damaged.get(ROOT):
            raise HodoError(f"{path} is damaged ({reason}): move it away and run again")
        if damaged is not INTACT and any(run.lacks_checksum(name) for name in run.groups()):
            warnings.warn(f"{path} has no checksums: damage to it would not show", stacklevel=3)
        try:
            yield run
        except DAMAGE as error:
            if "file read failed" not in str(error):  # HDF5's words, whatever it was asked for
                raise
            raise HodoError(f"{path} cannot be read: {refusal(error)}") from error


def _opened(path: Path) -> h5py.File:
    """Raises HodoError if it cannot be opened."""
    try:
        # Some network file systems have no locks, and a result that is there is complete in any
        # case.
        return h5py.File(path, "r", locking="best-effort")
    except (OSError, ValueError) as error:
        raise HodoError(f"{path}: {_why_closed(path, error)}") from None


def _damage(path: Path) -> Mapping[str, str]:
    """What is wrong with the groups of a file, by their names; nothing where its seal fits.

    Raises HodoError if it is no file.
    """
    try:
        status = path.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            raise HodoError(f"{path} is a pipe or a device, not a file")
        if stat.S_ISREG(status.st_mode) and not is_sealed(path):
            return _looked_at(path, status.st_ino, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise HodoError(f"{path}: {_why_closed(path, error)}") from None
    return INTACT


INTACT: Mapping[str, str] = {}
"""What is wrong with a file whose seal fits."""


@lru_cache(maxsize=256)
def _looked_at(path: Path, inode: int, changed: int, size: int) -> Mapping[str, str]:
    """What is wrong with the groups of a file that has no seal, or one that does not fit."""
    files: list[Run] = []

    def names() -> list[str]:
        files.append(Run(path, _opened(path), {}))
        return [ROOT, *files[0].groups()]

    def problem(name: str) -> str:
        return files[0].check(name) if name != ROOT else files[0].check_root()

    return look(names, problem, PATIENCE_OF_READER + size / SLOW_DISK)


ROOT = "/"
"""The name under which the root attributes are looked at; no group has it."""


def _why_closed(path: Path, error: Exception) -> str:
    """Why HDF5 does not open a file."""
    text = str(error)
    if isinstance(error, BlockingIOError):
        return "locked: another program has it open for writing"
    # By what HDF5 says, since its errors have one class for everything.
    if "unable to lock file" in text:
        return "its folder has no file locks; set HDF5_USE_FILE_LOCKING=FALSE"
    if os.path.isdir(path):
        return "a folder, not a file"
    if "signature not found" in text:
        if path.suffix in (".yaml", ".yml"):
            return "a case file, where a result is expected: hodo run makes one of it"
        return "not an HDF5 file"
    if "truncated file" in text:
        return "truncated: its end is missing; restore it, or move it away and run again"
    number = getattr(error, "errno", None)
    return os.strerror(number).lower() if number else f"damaged ({_first_line(error)})"


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]


def _attributes(item: h5py.HLObject, only: Collection[str] = ()) -> dict[str, Any]:
    """Attributes as plain values, in their order, or those of `only`, in its order. Raises
    ValueError if they are too many."""
    if (count := h5a.get_num_attrs(item.id)) > MOST_ITEMS:
        raise ValueError(f"it has {count} attributes")
    # To ask for a few takes less time than to list all.
    names = (
        [name for name in only if h5a.exists(item.id, _encoded(name))] if only else [*item.attrs]
    )
    return {name: _attribute(item, name) for name in names if name not in HIDDEN}


def _attribute(item: h5py.HLObject, name: str) -> Any:
    """The value of one attribute, as a plain one where it is one."""
    stored = h5a.open(item.id, _encoded(name))
    # `attrs` takes four times as long for a text, and most are one. The shape comes first: HDF5
    # writes as many values as there are, whatever room they are given.
    if stored.shape == ():
        text = np.empty((), STRING)
        with suppress(OSError, TypeError):  # it is none
            stored.read(text, mtype=TEXT_IN_MEMORY)
            return text.item().decode("utf-8", "surrogateescape")
        kind = stored.get_type()
        if isinstance(kind, h5t.TypeFloatID | h5t.TypeIntegerID):
            number = np.empty((), kind.dtype)
            stored.read(number)
            return number.item()
    value = item.attrs[name]
    # Other programs store an empty text so.
    value = "" if isinstance(value, h5py.Empty) else value
    value = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    # Plain Python numbers: they compare, print and go into JSON as expected.
    return value.item() if isinstance(value, np.generic) else value


def _encoded(name: str) -> bytes:
    """A name as HDF5 knows it, whatever bytes it is made of."""
    return name.encode("utf-8", "surrogateescape")


def _by_address(items: Mapping[str, h5py.HLObject]) -> dict[int, str]:
    """Names by the addresses of what they name; HDF5 itself takes milliseconds to find a name."""
    return {_address(item.id): name for name, item in items.items()}


def _dims(dataset: h5py.Dataset, named: Mapping[int, str]) -> tuple[str, ...]:
    """The dimensions of a dataset by the names of their scales; none for a scale itself."""
    item = dataset.id
    if not h5a.exists(item, b"DIMENSION_LIST"):
        return ()
    # The first scale of each: to read the list itself takes twice as long.
    return tuple(named[h5ds.iterate(item, i, _address)] for i in range(dataset.ndim))


def _address(item: h5d.DatasetID) -> int:
    """Where something is in its file, which no two things share."""
    return int(h5o.get_info(item).addr)


def _dimensions(group: h5py.Group) -> Dimensions:
    """The dimensions of what a group holds. Raises ValueError as `_dataset` does."""
    items = _datasets(group)
    named = _by_address(items)
    return {key: _dims(item, named) for key, item in items.items()}


class Output:
    """A file that is being written; made by `create`."""

    def __init__(self, file: h5py.File, disk: "Disk") -> None:
        self._file = file
        self._disk = disk

    def write(self, name: str, group: Group) -> None:
        """Add a group, or replace it."""
        self._disk.check()
        if name in self._file:
            del self._file[name]
        target = _new_group(self._file.id, name)
        told = {key: group.attributes[key] for key in TOLD_ATTRIBUTES if key in group.attributes}
        _set_attributes(target, {k: v for k, v in group.attributes.items() if k not in told})
        sizes: dict[str, int] = {}
        items: dict[str, h5d.DatasetID] = {}
        late_ones = group.late.names if group.late else ()
        for key, variable in group.variables.items():
            for dim, size in zip(variable.dims, variable.data.shape, strict=True):
                if sizes.setdefault(dim, size) != size:
                    raise ValueError(
                        f"{name}/{key}: {dim} has {size} values, elsewhere {sizes[dim]}"
                    )
            dtype = _file_type(key, variable.data)
            items[key] = _new_dataset(target, key, dtype, variable.data.shape)
            if key not in late_ones:
                data = np.require(variable.data, dtype, "C")
                items[key].write(h5s.ALL, h5s.ALL, data, _types(dtype)[1])
            _set_attributes(items[key], variable.attrs)
        for dim, size in sizes.items():
            if dim in items:
                h5ds.set_scale(items[dim], dim.encode())
            else:
                # A big-endian float that is never written, as netCDF-4 makes it: it takes no room
                # in the file.
                items[dim] = _new_dataset(target, dim, np.dtype(">f4"), (size,))
                h5ds.set_scale(items[dim], NO_VARIABLE + b"%10d" % size)
        for key, variable in group.variables.items():
            # A scale is attached to others, never to itself.
            if key not in sizes:
                _attach(items, key, variable.dims)
        # Last, so that memory holds one block at a time.
        late = {key: Digest() for key in late_ones}
        for key, where, block in group.late.blocks() if group.late else ():
            item = h5py.Dataset(items[key])
            item[where] = block
            late[key].add(np.asarray(block, dtype=item.dtype))
        _set_attributes(target, {"checksum": _checksum_with(group, late), **told})

    def copy(self, run: Run, name: str, known: Dimensions | None = None) -> None:
        """Copy a group as it is stored; `known` are the dimensions of its variables, where this
        process has written it. Raises HodoError if it is damaged.

        HDF5 breaks the links of datasets to their dimensions when it copies: they are made anew.
        """
        self._disk.check()
        with run._group(name) as old:
            dims = known or _dimensions(old)
            h5o.copy(old.id, b".", self._file.id, name.encode(), lcpl=LINKS[name.isascii()])
            target = h5g.open(self._file.id, name.encode())
            scales = dict.fromkeys(dim for each in dims.values() for dim in each)
            items = {key: h5d.open(target, _encoded(key)) for key in {**dims, **scales}}
            for item in items.values():
                for link in (b"REFERENCE_LIST", b"DIMENSION_LIST"):
                    if h5a.exists(item, link):
                        h5a.delete(item, link)
            for key, of in dims.items():
                if key not in scales:  # a scale is attached to others, never to itself
                    _attach(items, key, of)


def _attach(items: Mapping[str, h5d.DatasetID], name: str, dims: tuple[str, ...]) -> None:
    """Link a dataset to its dimensions."""
    for i, dim in enumerate(dims):
        h5ds.attach_scale(items[name], items[dim], i)


@contextmanager
def create(path: Path, attributes: Mapping[str, Attribute]) -> Iterator[Output]:
    """A new file with these root attributes; the version of the format is one in any case.

    Raises OSError if the operating system does not let it be written.
    """
    with _written(path) as disk:
        with h5py.File(disk, "w", track_order=True) as file:
            _set_root(file, attributes)
            yield Output(file, disk)
        disk.check()
        seal(disk)


@contextmanager
def amend(path: Path, run: Run, attributes: Mapping[str, Attribute]) -> Iterator[Output]:
    """A copy of a file that holds damaged groups, which HDF5 cannot copy: their bytes are kept, and
    the groups that are written replace theirs and come last. It gets no seal, so that the damage is
    seen again.

    Raises OSError if the operating system does not let it be written.
    """
    with _written(path) as disk:
        with open(run.path, "rb") as file:
            shutil.copyfileobj(file, disk)
        disk.check()
        with h5py.File(disk, "r+") as file:
            for name in [*file.attrs]:
                del file.attrs[name]
            _set_root(file, attributes)
            yield Output(file, disk)


@contextmanager
def _written(path: Path) -> Iterator[Disk]:
    """A new file; what the operating system refused in the meantime is raised at the end."""
    with Disk(path) as disk:
        try:
            yield disk
        finally:
            disk.check()


def _set_root(file: h5py.File, attributes: Mapping[str, Attribute]) -> None:
    root = _as_stored({"format_version": FORMAT_VERSION, **attributes})
    _set_attributes(file.id, {**root, "checksum": str(Checksum(root))})


def _is_number(dtype: np.dtype) -> bool:
    """Whether netCDF has a type of number: no records, references or lists either."""
    return dtype.kind in "iuf" and dtype.itemsize <= 8 and dtype != np.float16


def _file_type(name: str, data: np.ndarray) -> Any:
    """The type of an array in the file. Old netCDF readers lose bool, and crash on half and long
    double."""
    if data.dtype.kind in "OU":
        return STRING
    if not _is_number(data.dtype):
        raise TypeError(f"{name}: netCDF has no type {data.dtype}")
    return data.dtype


def _as_stored(attributes: Mapping[str, Attribute]) -> dict[str, Attribute]:
    """Attributes without what HDF5 cannot store: a text of a foreign program may hold half a
    surrogate, or a zero, at which C readers would stop."""
    return {
        name: value.encode("utf-8", "replace").decode().replace("\0", "\ufffd")
        if isinstance(value, str)
        else value
        for name, value in attributes.items()
    }


def _set_attributes(item: H5Object, attributes: Mapping[str, Attribute]) -> None:
    """Set new attributes; text with variable length, which every reader gives back as text."""
    for name, value in _as_stored(attributes).items():
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


def _link(characters: int) -> h5p.PropLCID:
    """How the name of a group or dataset is stored."""
    properties = h5p.create(h5p.LINK_CREATE)
    properties.set_char_encoding(characters)
    return properties


TRACKED = h5p.CRT_ORDER_TRACKED | h5p.CRT_ORDER_INDEXED
GROUP_CREATION, DATASET_CREATION = _creation(h5p.GROUP_CREATE), _creation(h5p.DATASET_CREATE)
GROUP_CREATION.set_link_creation_order(TRACKED)
LINKS = {True: _link(h5t.CSET_ASCII), False: _link(h5t.CSET_UTF8)}
"""By whether the name is ASCII."""

# The calls that h5py has for everybody take twice the time of these: a case has five datasets and
# forty attributes, which is half of what it costs to run a short one.


def _new_group(parent: H5Object, name: str) -> h5g.GroupID:
    return h5g.create(parent, name.encode(), LINKS[name.isascii()], GROUP_CREATION)


def _new_dataset(
    parent: H5Object, name: str, dtype: np.dtype, shape: tuple[int, ...]
) -> h5d.DatasetID:
    space = h5s.create_simple(shape) if shape else SCALAR
    link = LINKS[name.isascii()]
    return h5d.create(parent, name.encode(), _types(dtype)[0], space, DATASET_CREATION, link)
