"""Files that are written beside the place where they belong, and take it in one step.

A name that exists is complete, and stays so: nothing is ever changed in place. Shards and
chunks of a run wait in a staging folder; `writer` puts them into it. There are no lock
files to go stale: what is being written belongs to the process that holds its `flock`,
which ends with the process. Where there is no `flock` (Windows), a locked file beside it does.
"""

import os
import re
import shutil
import stat
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Self

from .. import BatchError
from ..machine import RESOURCES
from .disk import refusal

HAVE_FLOCK = find_spec("fcntl") is not None
"""Whether the system locks files: Windows has other locks."""

if HAVE_FLOCK:
    import fcntl


class Staging:
    """A hidden folder `.NAME.*.partial` beside the file `path`, made and locked when first used. A
    context manager, which on leaving removes each folder that holds nothing finished.

    `dead` are the folders of processes that have died; meanwhile no other process takes them over.
    """

    def __init__(self, path: Path) -> None:
        self.path = destination(path)
        self.folder: Path | None = None
        self.dead: list[Path] = []
        self._locks = ExitStack()

    def __enter__(self) -> Self:
        for folder in staging_folders(self.path):
            with suppress(OSError):
                if _lock(folder, self._locks):
                    self.dead.append(folder)
        return self

    def __exit__(self, *exception: object) -> None:
        with self._locks:
            for folder in self.folders():
                with suppress(OSError):  # what cannot be listed is left to the next process
                    if not shards(folder) and not chunks_in(folder):
                        shutil.rmtree(folder, ignore_errors=True)

    def __truediv__(self, name: str) -> Path:
        """A path in the folder. Raises OSError if it cannot be made."""
        while self.folder is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            folder = self.path.with_name(f".{self.path.name}.{os.urandom(4).hex()}.partial")
            folder.mkdir(mode=0o700)  # the result may be private, and its owner alone takes it over
            # Before it is locked, another process may take it for a dead one's, and remove it.
            with suppress(FileNotFoundError):
                _lock(folder, self._locks, wait=True)
                self.folder = folder if folder.exists() else None
        return self.folder / name

    def folders(self) -> list[Path]:
        """The folders that are this process's own now."""
        return [*self.dead, *filter(None, [self.folder])]

    def clear(self, kept: Collection[str]) -> None:
        """Delete all files of the folders but those of some names."""
        for folder in self.folders():
            for name in set(os.listdir(folder)).difference(kept):
                (folder / name).unlink()

    @contextmanager
    def publishing(self) -> Iterator[None]:
        """The time in which no other process publishes beside `path`."""
        with ExitStack() as locks:
            _lock(self.path.parent, locks, wait=True)
            yield


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name for a new file, which takes the place of `path` when the block ends well.

    Raises BatchError if the operating system refuses it; then, and after any other exception, what
    had the name keeps it.
    """
    with os_errors_as(path), Staging(path) as staging:
        yield (draft := staging / "draft")
        publish(draft, staging.path)


@contextmanager
def os_errors_as(path: Path, remark: str = "") -> Iterator[None]:
    """Make a BatchError of what the operating system refuses."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if not (reason := refusal(error)):
            raise
        if file := next(filter(os.path.isfile, path.parents), None):
            reason, remark = f"{file} is a file, not a folder", ""
        raise BatchError(f"cannot write {path}: {reason}{remark}") from error


def destination(path: Path) -> Path:
    """The file that a name stands for: what is written through a link goes where it points."""
    # Not by `is_symlink`, which raises an exception where a name is too long.
    return Path(os.path.realpath(path)) if os.path.islink(path) else path


def check_writable(path: Path, remedy: str = "") -> None:
    """Raise BatchError if a file is marked as read-only, which replacing it would ignore; with
    another remedy, if there is one."""
    with suppress(OSError):  # there is none yet, or writing it will say what is wrong
        mode = stat.S_IMODE(path.stat().st_mode)
        if not mode & 0o222:
            raise BatchError(f"{path} is read-only (mode {mode:o}): chmod u+w{remedy}")


def staging_folders(path: Path) -> list[Path]:
    """The hidden folders of all processes, living or dead, that write `path`. Raises OSError if the
    machine cannot list them."""
    path = destination(path)
    try:
        names = sorted(os.listdir(path.parent))
    except OSError as error:
        if error.errno in RESOURCES:
            raise
        return []  # no such folder: nor can a result be written there
    return [
        path.parent / name
        for name in names
        if name.startswith(f".{path.name}.") and name.endswith(".partial")
    ]


def shards(folder: Path) -> list[Path]:
    """The files with finished cases in a staging folder. Raises OSError if it cannot be listed."""
    # By their numbers: a draft that a kill has left behind is not among them.
    return _listed(folder, r"[0-9].*\.h5")


def chunks_in(folder: Path, sweep_id: str = "") -> list[Path]:
    """The finished chunks of sweeps, or of one sweep, in a staging folder, a file each. Raises
    OSError as `shards` does."""
    return _listed(folder, rf"part-{sweep_id}.*\.h5")


def _listed(folder: Path, pattern: str) -> list[Path]:
    """What is in a staging folder; nothing where that is another user's, or gone.

    Raises OSError if it cannot be listed otherwise: `glob` would show an empty folder.
    """
    with suppress(FileNotFoundError, NotADirectoryError, PermissionError):
        return [folder / name for name in sorted(os.listdir(folder)) if re.fullmatch(pattern, name)]
    return []


def identity(path: Path) -> tuple[int, int] | None:
    """What tells a file from another that takes its name later; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns


def synced(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    # Windows opens no folders, and syncs only what is open for writing.
    if os.name == "nt" and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def publish(draft: Path, path: Path) -> None:
    """Replace a file by its complete draft, which takes over owner and mode, and see it on the
    disk."""
    with suppress(FileNotFoundError):
        status = path.stat()
        # Only the superuser gives files away, and Windows has no such call.
        with suppress(PermissionError, AttributeError):
            os.chown(draft, status.st_uid, status.st_gid)
        draft.chmod(stat.S_IMODE(status.st_mode))
    synced(draft)
    os.replace(draft, path)
    synced(path.parent)


def _lock(path: Path, locks: ExitStack, wait: bool = False) -> bool:
    """Lock a folder until `locks` is closed. False if another process has it, or locks do
    not work there."""
    if not HAVE_FLOCK:
        return _lock_beside(path, locks, wait)
    descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        os.close(descriptor)
        return False
    locks.callback(os.close, descriptor)
    return True


def _lock_beside(path: Path, locks: ExitStack, wait: bool) -> bool:
    """`_lock` by a file that `filelock` locks, and removes when it gives it up: for a staging
    folder beside it, for the folder of results in it."""
    import filelock

    os.stat(path)  # as opening it would, if another process has removed it
    is_staging = path.suffix == ".partial"
    lock = filelock.FileLock(f"{path}.lock" if is_staging else path / ".hodo.lock")
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except (OSError, filelock.Timeout):
        return False
    locks.callback(lock.release)
    return True
