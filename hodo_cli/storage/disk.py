"""What disks do to files: a file for HDF5 that outlives a full disk, the reasons of refusals, and
how damage and foreign files are noticed.

HDF5 trusts what it reads: a wrong byte can make it loop for ever, deaf to signals, or take the
process down. The checksum of a file says that no byte has changed since this user's hodo wrote it,
before HDF5 sees any. Where it does not fit, because of damage, another program or another user,
each group is read in another process first, which may hang, crash or run out of memory, and the
group's own checksum is compared: so one wrong byte costs one case, and a file that comes from
elsewhere can still be read.
"""

import errno
import hmac
import io
import json
import os
import re
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn

from ..machine import limit_memory
from ..private import secret


class BufferedFile(io.FileIO):
    """A new file that keeps the first failure (a full disk) to itself: HDF5 takes the whole process
    down over one.

    What could not be written is kept in memory and read back from there, for HDF5 crashes over
    missing bytes too. As a context manager it raises that failure at its end.
    """

    error: OSError | None = None

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._unwritten: list[tuple[int, bytes]] = []

    def __exit__(self, *exception: Any) -> None:
        super().__exit__(*exception)
        self.check()

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


def refusal_number(error: BaseException) -> int | None:
    """The errno of what the operating system said, which HDF5 hides in its own errors."""
    # It gives it in the text of its error, and nowhere else.
    quoted = re.search(r"errno = (\d+)", str(error))
    return int(quoted[1]) if quoted else getattr(error, "errno", None)


def refusal(error: BaseException) -> str:
    """What the operating system said (no space, no permission), or nothing."""
    number = refusal_number(error)
    return os.strerror(number).lower() if number else ""


CHECKSUM_MARKER = b"\nhodo hmac-sha256 "
TRAILER = len(CHECKSUM_MARKER) + 64 + 1
"""The bytes of a file's checksum. It stands behind the end of the HDF5 file proper, where readers
do not look, and goes when another program changes the file."""

BLOCK_SIZE = 1 << 20
"""Bytes hashed at a time: between two blocks, Ctrl-C is heard."""


def append_checksum(file: io.FileIO) -> None:
    """Put the checksum of a file behind what it holds. It is keyed with the user's secret: whoever
    else makes a file cannot make one that fits."""
    size = file.seek(0, os.SEEK_END)
    checksum = _keyed_hash(file, size)
    file.seek(size)
    file.write(CHECKSUM_MARKER + checksum + b"\n")


def checksum_fits(path: Path) -> bool:
    """Whether this user's hodo wrote a file, and no byte has changed since. Raises OSError if it
    cannot be read."""
    with open(path, "rb", buffering=0) as file:
        size = max(file.seek(0, os.SEEK_END) - TRAILER, 0)
        file.seek(size)
        trailer = file.read(TRAILER)
        return trailer.startswith(CHECKSUM_MARKER) and hmac.compare_digest(
            trailer[len(CHECKSUM_MARKER) : -1], _keyed_hash(file, size)
        )


def _keyed_hash(file: io.FileIO, size: int) -> bytes:
    """The keyed hash of the first bytes of a file, in hexadecimal digits."""
    hashed = hmac.new(secret(), digestmod="sha256")
    file.seek(0)
    while size > 0 and (block := file.read(min(size, BLOCK_SIZE))):
        hashed.update(block)
        size -= len(block)
    return hashed.hexdigest().encode()


READER_SILENT = "reading it does not end, or ends the process"

PATIENCE_OF_READER = 10.0
"""Seconds in which a case must be read, besides those that a slow disk takes for the file."""

SLOWEST_DISK = 2e7
"""Bytes a second that any disk gives, and the network before it."""

MAX_HANGS = 3
"""How many cases may hang or crash the reader before the file is given up as a whole."""


def inspect_in_child(
    open_parts: Callable[[], Mapping[str, Callable[[], str]]], patience: float, memory: int
) -> dict[str, str]:
    """What is wrong with the parts of a file, by their names, as another process finds it.

    `open_parts` opens the file and gives its parts by name, each as the function that says what is
    wrong with it, or "". A part at which that process dies, takes more than `patience` seconds or
    so many bytes of memory, is reported as such; the name "" stands for the whole file. Signals are
    heard meanwhile.
    """
    problems = {"": READER_SILENT}  # until the other process comes to its end

    def named_problems() -> Iterator[tuple[str, str]]:
        """Each part by its name with what is wrong, as far as the process gets: the last that came
        for a name counts."""
        parts: Mapping[str, Callable[[], str]] = {}
        with suppress(Exception):  # it cannot be opened: so this process will find, and say why
            parts = open_parts()
        for name, find_problem in parts.items():
            if name not in problems:
                yield name, READER_SILENT  # stands if nothing more comes
                yield name, find_problem()
        yield "", ""

    for _ in range(MAX_HANGS):
        # Windows makes no such processes: there, damage may end this one.
        can_fork = hasattr(os, "fork")
        found = (
            _from_child(named_problems, patience, memory) if can_fork else dict(named_problems())
        )
        problems |= found
        if not found or not problems[""]:
            break
    return {name: problem for name, problem in problems.items() if problem}


def _from_child(
    pairs: Callable[[], Iterator[tuple[str, str]]], patience: float, memory: int
) -> dict[str, str]:
    """The pairs that another process makes until it ends or dies."""
    ours, theirs = os.pipe()
    # A fork and not a spawn: it starts in a millisecond, and only reads before it ends.
    child = os.fork()
    if child == 0:
        _write_and_exit(theirs, pairs, patience, memory)
    try:
        os.close(theirs)
        with open(ours, "rb") as pipe:
            return dict(json.loads(line) for line in pipe if line.endswith(b"\n"))
    finally:
        # A signal may have ended the reading.
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def _write_and_exit(
    pipe: int, pairs: Callable[[], Iterator[tuple[str, str]]], patience: float, memory: int
) -> NoReturn:
    """What the other process does."""
    # The line that is missing says where it has ended; its own last words say nothing more.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    # The system itself ends it at a signal, also in a loop of HDF5, and if nobody waits any more.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
    try:
        limit_memory(memory)
        signal.setitimer(signal.ITIMER_REAL, patience)
        for pair in pairs():
            os.write(pipe, json.dumps(pair).encode() + b"\n")
            signal.setitimer(signal.ITIMER_REAL, patience)
    finally:
        os._exit(0)
