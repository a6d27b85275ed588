"""The hidden folder beside a result in which one process writes it anew, to replace it in one step.

A name that exists is complete, and stays so: nothing is ever changed in place. There are no lock
files and no marks to go stale: a folder belongs to the process that holds its `flock`, which ends
with the process.
"""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path


class Workshop:
    """A hidden folder `.NAME.*.partial` beside the file `path`, made and locked when first used."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder: Path | None = None
        self._locks = ExitStack()

    def __truediv__(self, name: str) -> Path:
        """A path in the folder. Raises OSError if it cannot be made."""
        while self.folder is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            folder = self.path.parent / f".{self.path.name}.{os.urandom(4).hex()}.partial"
            folder.mkdir()
            with suppress(
                FileNotFoundError
            ):  # another took it for a dead process's before it was locked
                self._hold(_lock(folder, wait=True))
                self.folder = folder if folder.exists() else None
        return self.folder / name

    def abandoned(self) -> list[Path]:
        """The folders that dead processes have left; from now on nobody else sees them as such."""
        found = []
        for folder in workshops(self.path):
            with suppress(OSError):
                if folder != self.folder and (lock := _lock(folder)) is not None:
                    self._hold(lock)
                    found.append(folder)
        return found

    def _hold(self, lock: int | None) -> None:
        if lock is not None:
            self._locks.callback(os.close, lock)

    @contextmanager
    def turn(self) -> Iterator[None]:
        """The time in which this process alone may publish beside `path`."""
        lock = _lock(self.path.parent, wait=True)
        try:
            yield
        finally:
            if lock is not None:
                os.close(lock)

    def publish(self, whole: Path) -> None:
        """Give a complete file the name `path`, and see it on the disk."""
        _sync(whole)
        os.replace(whole, self.path)
        _sync(self.path.parent)

    def remove(self) -> None:
        """Delete the folder with what is in it."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder = None

    def close(self) -> None:
        """Give up the locks."""
        self._locks.close()


def workshops(path: Path) -> list[Path]:
    """The hidden folders of all processes, living or dead, that write the file `path`."""
    with suppress(OSError):  # no such folder: nor can a result be written there
        names = sorted(os.listdir(path.parent))
        return [
            path.parent / x
            for x in names
            if x.startswith(f".{path.name}.") and x.endswith(".partial")
        ]
    return []


def identity(path: Path) -> tuple[int, int] | None:
    """What tells a file from another that takes its name later; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns


def _lock(folder: Path, wait: bool = False) -> int | None:
    """A descriptor that locks a folder while it is open, or None: another has it, or locks do not
    work there."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
