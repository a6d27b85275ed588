"""Result files being read: groups of labelled arrays in HDF5, checked before they are believed."""

import json
import os
import stat
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5g, h5l, h5o, h5t

from .. import BatchError, HodoError
from ..machine import RESOURCES, memory_limit
from ..text import first_line, in_bytes
from .disk import (
    PATIENCE_OF_READER,
    SLOWEST_DISK,
    checksum_fits,
    inspect_in_child,
    refusal,
    refusal_number,
)
from .group import Group, Report, Variable, checksum_of, is_number
from .provenance import CONTENT, FORMAT_VERSION, typed

STRING = h5py.string_dtype()
TEXT_IN_MEMORY = h5t.py_create(STRING)
# netCDF-4's own sign of a dimension without a coordinate; its readers look for these very words.
NO_VARIABLE = b"This is a netCDF dimension but not a netCDF variable."
REPORT_DIGEST, REPORT = "told_mark", "told"
"""The attributes that hold a report."""

SHORT_ATTRIBUTES = "listed"
"""The attribute that holds the short ones of a group once more, as JSON: a batch is listed by one
attribute a case and not by eleven, each of which takes 10 to 30 us."""

HIDDEN = (
    "CLASS",
    "NAME",
    "REFERENCE_LIST",
    "DIMENSION_LIST",
    "_Netcdf4Dimid",
    "_Netcdf4Coordinates",
    "checksum",
    REPORT_DIGEST,
    REPORT,
    SHORT_ATTRIBUTES,
)
"""Attributes that are no data: the links of dimensions, the checksum, the report, and what is there
twice."""

DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError, MemoryError)
"""What h5py raises when the bytes of a file make no sense."""

INFLATION = 10
"""A file that this user's hodo has not written may hold so many times its own bytes, as compression
may save; hodo itself compresses nothing."""

BYTES_IN_ANY_CASE = 256 << 20
"""What such a file may hold in any case: ten datasets of a sweep of a million members that are all
nan, which other programs compress to nothing."""

MAX_ITEMS = 1000
"""Datasets or attributes in a group: ten times those of any case, and far fewer than would keep
HDF5, which looks for each by its name, busy for minutes."""


class ResultFile:
    """A result file that is open for reading; made by `open_run`.

    `groups` are the names of all groups, in their order; `damaged` says what is wrong with them;
    `intact` is whether all bytes are as this user's hodo has written them.
    """

    intact = False  # of an unfinished run, which is no file

    def __init__(self, path: Path, file: h5py.File, damaged: Mapping[str, str] | None) -> None:
        """`damaged` is None for a file that its checksum vouches for."""
        self.path = path
        self.damaged = damaged or {}
        self.intact = damaged is None
        self.attributes: dict[str, Any] = _attributes(file)
        self.groups = dict.fromkeys(file)
        self._file = file
        self._bytes_left = memory_limit() if self.intact else bytes_allowed(file.id.get_filesize())

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
        """The attributes of a group (all, or those named), without reading an array.

        Raises HodoError if there is no such group or it is damaged.
        """
        short = self._short_attributes(name)
        if only and short.keys() >= {*only}:
            return {key: short[key] for key in only}
        with self.open_group(name) as group:
            return _attributes(group, only, short)

    def _short_attributes(self, name: str) -> dict[str, Any]:
        """The short attributes of a group, where they are stored as one; none if it cannot be
        read."""
        # Whoever may write the file may have written another copy.
        if self.intact:
            with suppress(*DAMAGE):
                # By the name of the group: to open the group first takes twice the time.
                listed = h5a.open(self._file.id, SHORT_ATTRIBUTES.encode(), obj_name=encoded(name))
                return dict(json.loads(str(_one_value(listed))))
        return {}

    def row(self, name: str, kinds: Mapping[str, type]) -> dict[str, Any]:
        """Some attributes of a group. Raises HodoError as `summary` does, and as `typed` does."""
        return typed(self.summary(name, kinds), kinds, f"{self.path}: {name}")

    def read(self, name: str) -> Group:
        """A group whole. Raises HodoError if there is no such group, or it is damaged or too
        large."""
        with self.open_group(name) as group:
            items = _datasets(group)
            named = dimensions({key: item.id for key, item in items.items()})
            variables, size = {}, 0
            for key, item in items.items():
                # A dimension without values of its own has a dataset that stands for it.
                if h5ds.is_scale(item.id) and h5ds.get_scale_name(item.id).startswith(NO_VARIABLE):
                    continue
                # Before it is read: HDF5 promises any size that a damaged header names.
                size += item.nbytes
                if size > self._bytes_left:
                    raise HodoError(
                        f"{self.path}: {name}/{key} does not fit: {in_bytes(size)}, "
                        f"with {in_bytes(self._bytes_left)} for it"
                    )
                data = item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()]
                dims = named[key] or (key,) * data.ndim
                variables[key] = Variable(dims, data, _attributes(item))
            # Whoever may write the file may have written any report.
            report = _report(group) if self.intact else None
            attributes = _attributes(group, known=self._short_attributes(name))
            return Group(attributes, variables, report=report)

    def blocks(
        self, name: str, variables: Iterable[str], box: tuple[slice, ...]
    ) -> Iterator[tuple[str, np.ndarray]]:
        """A box of some variables of a group, each with its name: of the first of its dimensions.
        Raises HodoError as `read` does."""
        with self.open_group(name) as group:
            for key in variables:
                yield key, _dataset(group, key)[box]

    def report(self, name: str, digest: str) -> Any:
        """The stored report of a command on a group, if it was made of this digest; None if there
        is none, or the file is not as hodo has written it. Raises HodoError as `summary` does."""
        if not self.intact:
            return None
        with self.open_group(name) as group:
            report = _report(group)
            return json.loads(report.json) if report and report.digest == digest else None

    @contextmanager
    def open_group(self, name: str) -> Iterator[h5py.Group]:
        """A group as h5py opens it. Raises HodoError if there is no such group, or it is
        damaged."""
        if reason := self.damaged.get(name):
            raise HodoError(f"{self.path}: {name} is damaged ({reason})")
        try:
            if name and "/" not in name and _is_hard(self._file, name):
                group = h5o.open(self._file.id, encoded(name))
                if isinstance(group, h5g.GroupID):
                    yield h5py.Group(group)
                    return
        except DAMAGE as error:
            if reason := refusal(error):
                raise _error_class(error)(f"{self.path} cannot be read: {reason}") from error
            raise HodoError(f"{self.path}: {name} is damaged ({first_line(error)})") from error
        raise HodoError(f"{self.path}: there is no case {name!r}")

    def check(self, name: str) -> str:
        """What is wrong with a group (`ROOT`: the attributes of the file), all of it read; an empty
        string if nothing is."""
        try:
            if name == ROOT:
                fits = _fits(self._file, Group(self.attributes, {}))
                return "" if fits else "its head has changed"
            with self.open_group(name) as group:
                content = self.read(name)
                # Any number of its texts may be the same long text of a small file. What is read of
                # one group leaves less to the others.
                size, room = size_of(content), self._bytes_left
                if size > room:
                    return f"it does not fit: {in_bytes(size)}, with {in_bytes(room)} for it"
                self._bytes_left -= size
                return "" if _fits(group, content) else "its checksum does not fit"
        except (HodoError, BatchError) as error:  # a bad sector costs the case that lies there
            reason = str(error).removeprefix(f"{self.path}: ")
            return reason.removeprefix(f"{name} is damaged (").removesuffix(")")

    def checksum(self, name: str) -> str:
        """The checksum that is stored with a group, which tells its content from any other without
        reading it.

        Empty if there is none, or the file's own does not fit: something may then have been added
        that no checksum covers. Raises HodoError as `summary` does.
        """
        with self.open_group(name) as group:
            is_known = self.intact and h5a.exists(group.id, b"checksum")
            return str(_attribute(group, "checksum")) if is_known else ""


def bytes_allowed(size: int) -> int:
    """The bytes that a file of so many may hold, which another user may have made."""
    return min(memory_limit(), BYTES_IN_ANY_CASE + INFLATION * size)


def size_of(group: Group) -> int:
    """About how many bytes a group takes in memory."""
    texts = [text for text in group.attributes.values() if isinstance(text, str)]
    arrays = [variable.data for variable in group.variables.values()]
    texts += [text for data in arrays if data.dtype == object for text in data.flat]
    return sum(data.nbytes for data in arrays) + sum(map(len, texts))


def _fits(item: h5py.HLObject, content: Group) -> bool:
    """Whether the checksum of an item fits what was read of it: the attributes before the checksum,
    and so many variables as it covers. One that is not there fits."""
    names = [*item.attrs]
    if "checksum" not in names:
        return True
    stored = str(item.attrs["checksum"])
    count = stored.split(":")[1] if stored.count(":") == 2 else ""
    covered = [name for name in names[: names.index("checksum")] if name not in HIDDEN]
    variables = islice(content.variables.items(), int(count) if count.isdecimal() else 0)
    attributes = {name: content.attributes[name] for name in covered}
    return stored == checksum_of(Group(attributes, dict(variables)))


def _datasets(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """What a group holds. Raises ValueError as `_dataset` does."""
    if len(group) > MAX_ITEMS:
        raise ValueError(f"it holds {len(group)} datasets")
    if strange := [name for name in group if not name.isprintable()]:
        raise ValueError(f"it holds {strange[0]!r}")
    return {name: _dataset(group, name) for name in group}


def _dataset(group: h5py.Group, name: str) -> h5py.Dataset:
    """An item of a group. Raises ValueError if that is anything but a plain dataset: a link, a
    group, values in other files or made from other datasets, and elements that are addresses would
    let a file from a stranger read this machine's files or fill its memory."""
    if not _is_hard(group, name):
        raise ValueError(f"{name} is a link")
    opened = h5o.open(group.id, encoded(name))
    if not isinstance(opened, h5d.DatasetID):
        raise ValueError(f"{name} is no dataset")
    # A small file would fill the memory with one dataset under a thousand names.
    if h5o.get_info(opened).rc > 1:
        raise ValueError(f"{name} has other names too")
    creation, item = opened.get_create_plist(), h5py.Dataset(opened)
    if creation.get_external_count() or creation.get_layout() == h5d.VIRTUAL:
        raise ValueError(f"the values of {name} are in other files")
    has_texts = h5py.check_string_dtype(item.dtype) and item.ndim
    if item.shape is None or not (is_number(item.dtype) or has_texts):
        raise ValueError(f"{name} holds neither numbers nor a list of texts")
    return item


def _is_hard(group: h5py.Group, name: str) -> bool:
    """Whether a group has an item of this name itself, and not in another place or file."""
    links, link = group.id.links, encoded(name)
    return bool(links.exists(link) and links.get_info(link).type == h5l.TYPE_HARD)


@contextmanager
def open_run(path: Path | str, is_own: bool = False) -> Iterator[ResultFile]:
    """A result file, open for reading; one that this process has written and nobody has changed
    since `is_own`, and not hashed again.

    Raises HodoError if it is missing, unreadable, in use for writing, damaged, not hodo's, or of a
    newer format, and BatchError if the machine cannot open it.
    """
    path = Path(path)
    damaged = None if is_own else _damage(path)
    if damaged and "" in damaged:
        raise HodoError(f"{path} is damaged ({damaged['']})")
    file = _opened(path)
    with file:
        try:
            run = ResultFile(path, file, damaged)
        except DAMAGE as error:
            raise HodoError(f"{path} is damaged ({first_line(error)})") from None
        _check_head(run, file)
        yield run


def _check_head(run: ResultFile, file: h5py.File) -> None:
    """Raise HodoError unless a file is a result of hodo in a format that this one reads, with sound
    attributes and names. Warn of groups without a checksum."""
    version = run.attributes.get("format_version")
    if not isinstance(version, int):
        raise HodoError(f"{run.path} is HDF5, but not a result of hodo (it has no format_version)")
    if version > FORMAT_VERSION:
        raise HodoError(
            f"{run.path} has format version {version}, newer than {FORMAT_VERSION}: "
            "update hodo to read it"
        )
    # A line of a message is one line, and a terminal obeys what it is sent.
    if strange := [name for name in run.groups if not name.isprintable()]:
        raise HodoError(f"{run.path} is damaged (a group is named {strange[0]!r})")
    if reason := run.damaged.get(ROOT):
        raise HodoError(f"{run.path} is damaged ({reason}): move it away and run again")
    groups = [] if run.intact else [file[name] for name in run.groups if name not in run.damaged]
    if any("checksum" not in group.attrs for group in groups):
        warnings.warn(f"{run.path} has no checksums: damage to it would not show", stacklevel=4)


def _opened(path: Path) -> h5py.File:
    """Raises HodoError if it cannot be opened."""
    try:
        # Some network file systems have no locks, and a result that is there is complete in any
        # case.
        return h5py.File(path, "r", locking="best-effort")
    except (OSError, ValueError) as error:
        raise _error_class(error)(f"{path}: {_why_closed(path, error)}") from None


def _damage(path: Path) -> Mapping[str, str] | None:
    """What is wrong with the groups of a file, by their names; None if its checksum fits.

    Raises HodoError if it is no file.
    """
    try:
        status = path.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            raise HodoError(f"{path} is a pipe or a device, not a file")
        return _inspected(path, status.st_ino, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise _error_class(error)(f"{path}: {_why_closed(path, error)}") from None


@lru_cache(maxsize=4096)
def _inspected(path: Path, inode: int, changed: int, size: int) -> Mapping[str, str] | None:
    """As `_damage`; to read a file again that has not changed would show nothing new."""
    if checksum_fits(path):
        return None

    def checks() -> dict[str, Callable[[], str]]:
        run = ResultFile(path, _opened(path), {})
        return {name: partial(run.check, name) for name in [ROOT, *run.groups]}

    patience = PATIENCE_OF_READER + size / SLOWEST_DISK
    return inspect_in_child(checks, patience, CHECKSUM_COPIES * bytes_allowed(size))


CHECKSUM_COPIES = 4
"""How often the bytes of a group stand in memory while its checksum is made."""

ROOT = "/"
"""The name under which the root attributes are looked at; no group has it."""


def _error_class(error: BaseException) -> type[HodoError | BatchError]:
    """What an error in reading a file means: the machine lacks something, or the file is wrong."""
    # In a damaged file HDF5 asks for impossible addresses, and is refused by the system as well. A
    # file that another program has locked is no lack either.
    lacks = refusal_number(error) in RESOURCES and not isinstance(error, BlockingIOError)
    return BatchError if lacks else HodoError


def _why_closed(path: Path, error: Exception) -> str:
    """Why HDF5 does not open a file."""
    if isinstance(error, BlockingIOError):
        return "locked: another program has it open for writing"
    if os.path.isdir(path):
        return "a folder, not a file"
    for words, reason in REASONS.items():
        if words in str(error):
            return reason
    return refusal(error) or f"damaged ({first_line(error)})"


REASONS = {
    "unable to lock file": "its folder has no file locks; set HDF5_USE_FILE_LOCKING=FALSE",
    "signature not found": "not an HDF5 file (hodo run makes one of a case file)",
    "truncated file": "truncated: its end is missing; restore it, or move it away and run again",
}
"""Why HDF5 does not open a file, by what it says: its errors have one class for everything."""


def _attributes(
    item: h5py.HLObject, only: Collection[str] = (), known: Mapping[str, Any] = {}
) -> dict[str, Any]:
    """Attributes as plain values, in their order, or those of `only`, in its order; without reading
    those that are `known`. Raises ValueError if they are too many."""
    if (count := h5a.get_num_attrs(item.id)) > MAX_ITEMS:
        raise ValueError(f"it has {count} attributes")
    # To ask for a few takes less time than to list all.
    names = (
        [name for name in only if name in known or h5a.exists(item.id, encoded(name))]
        if only
        else [*item.attrs]
    )
    return {
        name: known[name] if name in known else _attribute(item, name)
        for name in names
        if name not in HIDDEN
    }


def _attribute(item: h5py.HLObject, name: str) -> Any:
    """The value of one attribute, as a plain one where it is one."""
    value = _one_value(h5a.open(item.id, encoded(name)))
    return _plain_value(item, name) if value is None else value


def _one_value(stored: h5a.AttrID) -> Any:
    """The value of an attribute that is one text or one number, as most are; None of another.
    `attrs` takes four times as long."""
    # The shape is asked for first: HDF5 writes as many values as there are, whatever room they are
    # given.
    kind = stored.get_type() if stored.shape == () else None
    if isinstance(kind, h5t.TypeStringID) and kind.is_variable_str():
        text = np.empty((), STRING)
        stored.read(text, mtype=TEXT_IN_MEMORY)
        return text.item().decode("utf-8", "surrogateescape")
    if isinstance(kind, h5t.TypeIntegerID | h5t.TypeFloatID) and is_number(kind.dtype):
        number = np.empty((), kind.dtype)
        stored.read(number)
        return number.item()
    return None


def _plain_value(item: h5py.HLObject, name: str) -> Any:
    """The value of any attribute, with what other programs store as hodo stores it. Raises
    ValueError if it holds neither numbers nor texts."""
    value = item.attrs[name]
    if isinstance(value, h5py.Empty | bytes):
        value = value.decode("utf-8", "replace") if isinstance(value, bytes) else ""
    array = np.asarray(value, dtype=object if isinstance(value, str) else None)
    if array.dtype == bool:  # which netCDF has not
        value = array = array.astype(np.int8)
    if not is_number(array.dtype) and not all(isinstance(text, str) for text in array.flat):
        raise ValueError(f"its attribute {name!r} is neither a number nor a text")
    # Plain Python numbers: they compare, print and go into JSON as expected.
    return array.item() if array.shape == () else value


def _report(group: h5py.Group) -> Report | None:
    """The report that is stored with a group."""
    names = REPORT_DIGEST, REPORT
    if not all(h5a.exists(group.id, name.encode()) for name in names):
        return None
    return Report(*(str(_attribute(group, name)) for name in names))


def encoded(name: str) -> bytes:
    """A name as HDF5 knows it, whatever bytes it is made of."""
    return name.encode("utf-8", "surrogateescape")


def dimensions(items: Mapping[str, h5d.DatasetID]) -> dict[str, tuple[str, ...]]:
    """The dimensions of the datasets of a group, by the names of their scales; none of a scale."""
    # By address: HDF5 itself takes milliseconds to find a name.
    names = {_address(item): name for name, item in items.items()}
    return {
        # The first scale of each: to read the list itself takes twice as long.
        name: tuple(names[h5ds.iterate(item, i, _address)] for i in range(item.rank))
        if h5a.exists(item, b"DIMENSION_LIST")
        else ()
        for name, item in items.items()
    }


def _address(item: h5d.DatasetID) -> int:
    """Where something is in its file, which no two things share."""
    return int(h5o.get_info(item).addr)
