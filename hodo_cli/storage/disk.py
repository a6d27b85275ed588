"""What disks do to files: a file for HDF5 that outlives a full disk, the reasons of refusals, and
how damage is noticed.

HDF5 trusts what it reads: a wrong byte can make it loop for ever, deaf to signals, or take the
process down. The checksum of the file says that no byte has changed, before HDF5 sees any. Where
there is none, or it does not fit, each group is read in another process first, which may hang or
crash, and its own checksum compared: so one wrong byte costs one case, and a file to which another
program has added something can still be read.
"""

import errno
import hashlib
import io
import json
import os
import re
import signal
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np


class BufferedFile(io.FileIO):
    """A new file that keeps the first failure (a full disk) to itself: HDF5 takes the whole process
    down over one.

    What could not be written is kept in memory and read back from there, for HDF5 crashes over
    missing bytes too.
    """

    error: OSError | None = None

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._unwritten: list[tuple[int, bytes]] = []

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        try:
            while view and self.error is None:
                if (written := super().write(view)) is None:
                    raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
                view = view[written:]
        except OSError as error:
            self.error = error
        # HDF5 takes a short write for the end of everything, so all is taken and the rest kept.
        if view:
            self._unwritten.append((self.tell(), bytes(view)))
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def check(self) -> None:
        """Raise the failure, if there was one."""
        if self.error:
            raise self.error

    def readinto(self, buffer: Any) -> int:
        start, view = self.tell(), memoryview(buffer).cast("B")
        got = super().readinto(view) or 0
        if not self.error:
            return got
        # Zeros where nothing was ever written, as a sparse file has them.
        view[got:] = bytes(len(view) - got)
        for offset, data in self._unwritten:
            first, last = max(start, offset), min(start + len(view), offset + len(data))
            if first < last:
                view[first - start : last - start] = data[first - offset : last - offset]
        return len(view)


def refusal(error: BaseException) -> str:
    """What the operating system said (no space, no permission), which HDF5 hides in its own errors;
    or nothing."""
    # HDF5 gives the errno in the text of its error, and nowhere else.
    quoted = re.search(r"error message = '([^']*)'", str(error))
    number = getattr(error, "errno", None)
    if quoted:
        return quoted[1].lower()
    return os.strerror(number).lower() if number else ""


def refusal_number(error: BaseException) -> int | None:
    """The number of what the operating system said."""
    quoted = re.search(r"errno = (\d+)", str(error))
    return int(quoted[1]) if quoted else getattr(error, "errno", None)


CHECKSUM_MARKER = b"\nhodo sha256 "
TRAILER = len(CHECKSUM_MARKER) + 64 + 1
"""The bytes of a file's checksum. It stands behind the end of the HDF5 file proper, where readers
do not look, and goes when another program changes the file."""

BLOCK_SIZE = 1 << 20
"""Bytes hashed at a time: between two blocks, Ctrl-C is heard."""

PATIENCE_OF_READER = 10.0
"""Seconds in which a case must be read, besides those that a slow disk takes for the file."""

SLOW_DISK = 2e7
"""Bytes a second that any disk gives, and the network before it."""

HANGS = 3
"""How many cases may hang or crash the reader before the file is given up as a whole."""


def append_checksum(file: io.FileIO) -> None:
    """Put the checksum of a file behind what it holds."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    hashed = _hash(file, size)
    file.seek(size)
    file.write(CHECKSUM_MARKER + hashed.encode() + b"\n")


def checksum_fits(path: Path) -> bool:
    """Whether a file has a checksum that fits. Raises OSError if it cannot be read."""
    status = path.stat()
    return _fits(str(path), status.st_ino, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4096)
def _fits(path: str, inode: int, changed: int, size: int) -> bool:
    """Reading a file again that has not changed would show nothing new."""
    with open(path, "rb", buffering=0) as file:
        file.seek(max(size - TRAILER, 0))
        tail = file.read(TRAILER)
        if not tail.startswith(CHECKSUM_MARKER):
            return False
        file.seek(0)
        return tail[len(CHECKSUM_MARKER) : -1] == _hash(file, size - TRAILER).encode()


def _hash(file: io.FileIO, size: int) -> str:
    hashed = hashlib.sha256()
    while size > 0 and (block := file.read(min(size, BLOCK_SIZE))):
        hashed.update(block)
        size -= len(block)
    return hashed.hexdigest()


class GroupChecksum:
    """The checksum of a group: of its attributes and of its variables, in the order in which they
    are stored. What is added to the group later is not covered, and does not disturb it."""

    def __init__(self, attributes: Mapping[str, Any]) -> None:
        self._lines = [_described(attributes)]

    def add(self, name: str, dims: tuple[str, ...], values: str, attrs: Mapping[str, Any]) -> None:
        """Take in a variable; `values` is the checksum of its values."""
        self._lines.append(f"{name} {dims} {values} {_described(attrs)}")

    def __str__(self) -> str:
        hashed = hashlib.sha256("\n".join(self._lines).encode("utf-8", "replace"))
        return f"sha256:{len(self._lines) - 1}:{hashed.hexdigest()[:32]}"


class ValuesChecksum:
    """The checksum of an array's values, which may come block by block, in their order."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._kind = ""

    def add(self, values: np.ndarray) -> None:
        """Some values; text by its characters, numbers by their bits."""
        if values.dtype.kind in "OU":
            self._hash.update("\0".join([*map(str, values.ravel()), ""]).encode("utf-8", "replace"))
        else:
            self._kind = values.dtype.str
            self._hash.update(np.ascontiguousarray(values).data.cast("B") if values.size else b"")

    def __str__(self) -> str:
        return f"{self._kind}{self._hash.hexdigest()}"


def checksum_of_values(values: np.ndarray) -> str:
    """The checksum of an array that is there as a whole."""
    checksum = ValuesChecksum()
    checksum.add(values)
    return str(checksum)


def _described(attributes: Mapping[str, Any]) -> str:
    """Attributes in a form that is the same before they are written and after they are read."""
    return "\n".join(f"{name}={np.asarray(value).tolist()!r}" for name, value in attributes.items())


SILENT = "reading it does not end, or ends the process"


def look(
    first: Callable[[], list[str]], then: Callable[[str], str], patience: float
) -> dict[str, str]:
    """What is wrong with the parts of a file, by their names, looked at in another process.

    `first` opens the file and gives the names, `then` says what is wrong with one of them, or "".
    A part at which that process dies, or takes more than `patience` seconds, is reported as such;
    the name "" stands for the whole file. Signals are heard meanwhile.
    """
    # Windows makes no such processes: there, damage may end this one.
    if not hasattr(os, "fork"):
        return {name: reason for name in first() if (reason := then(name))}
    wrong: dict[str, str] = {}
    seen: set[str] = set()
    for _ in range(HANGS):
        last, done = "", False
        for line in _lines_of_child(first, then, seen, patience):
            kind, name, reason = json.loads(line)
            done = kind == "done"
            last = name if kind == "begin" else ""
            if kind == "end":
                seen.add(name)
                if reason:
                    wrong[name] = reason
        if done:
            return wrong
        wrong[last] = SILENT
        seen.add(last)
        if not last:
            break
    return wrong | {"": SILENT}


def _lines_of_child(
    first: Callable[[], list[str]],
    then: Callable[[str], str],
    skipped: set[str],
    patience: float,
) -> list[str]:
    """What another process says of the parts, one line each, until it ends or dies."""
    ours, theirs = os.pipe()
    # A fork and not a spawn: it starts in a millisecond, and only reads before it ends.
    child = os.fork()
    if child == 0:
        _look_and_exit(theirs, first, then, skipped, patience)
    os.close(theirs)
    with open(ours, "rb") as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    return text.decode().split("\n")[:-1]


def _look_and_exit(
    pipe: int,
    first: Callable[[], list[str]],
    then: Callable[[str], str],
    skipped: set[str],
    patience: float,
) -> None:
    """What the other process does."""

    def say(*words: str) -> None:
        os.write(pipe, json.dumps(words).encode() + b"\n")

    # The line that is missing says where it has ended; its own last words say nothing more.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    # The system itself ends it at a signal, also in a loop of HDF5, and if nobody waits any more.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
    try:
        signal.setitimer(signal.ITIMER_REAL, patience)
        for name in first():
            if name not in skipped:
                signal.setitimer(signal.ITIMER_REAL, patience)
                say("begin", name, "")
                say("end", name, then(name))
        say("done", "", "")
    except Exception:  # it cannot be opened: so this process will find, and say why
        say("done", "", "")
    finally:
        os._exit(0)
