"""Files that are written beside the place where they belong, and take it in one step.

A name that exists is complete, and stays so: nothing is ever changed in place. Shards and
chunks of a run wait in a staging folder; `writer` puts them into it. There are no lock
files to go stale: what is being written belongs to the process that holds its `flock`,
which ends with the process. Where there is no `flock` (Windows), a locked file beside it does.
"""

import os
import shutil
import stat
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from .. import BatchError
from ..machine import RESOURCES
from ..private import HAVE_FLOCK
from .disk import refusal

if HAVE_FLOCK:
    import fcntl

Release = Callable[[], object]
"""What gives up a lock."""


class Staging:
    """A hidden folder `.NAME.*.partial` beside the file `path`, made and locked when first used."""

    def __init__(self, path: Path) -> None:
        self.path = destination(path)
        self.folder: Path | None = None
        self._locks = ExitStack()

    def __truediv__(self, name: str) -> Path:
        """A path in the folder. Raises OSError if it cannot be made."""
        while self.folder is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            folder = _beside(self.path)
            folder.mkdir(mode=0o700)  # the result may be private, and its owner alone takes it over
            # Before it is locked, another process may take it for a dead one's, and remove it.
            with suppress(FileNotFoundError):
                self._hold(_lock(folder, wait=True))
                self.folder = folder if folder.exists() else None
        return self.folder / name

    def take_over_dead(self) -> list[Path]:
        """The folders of processes that have died; from now on no other process takes them."""
        folders = []
        for folder in staging_folders(self.path):
            with suppress(OSError):
                if folder != self.folder and (lock := _lock(folder)) is not None:
                    self._hold(lock)
                    folders.append(folder)
        return folders

    def _hold(self, lock: Release | None) -> None:
        if lock is not None:
            self._locks.callback(lock)

    @contextmanager
    def publishing(self) -> Iterator[None]:
        """The time in which no other process publishes beside `path`."""
        lock = _lock(self.path.parent, wait=True)
        try:
            yield
        finally:
            if lock is not None:
                lock()

    def remove(self, besides: Collection[str] = ()) -> None:
        """Delete the folder with what is in it; if files of some names stay, only the rest."""
        if self.folder is not None and besides:
            for name in set(os.listdir(self.folder)).difference(besides):
                (self.folder / name).unlink()
        elif self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder = None

    def close(self) -> None:
        """Give up the locks."""
        self._locks.close()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """An empty file beside `path`, which takes its name when the block ends well.

    Raises BatchError if the operating system refuses it; then, and after any other exception, what
    had the name keeps it.
    """
    path = destination(path)
    with os_errors_as(path), ExitStack() as failed:
        path.parent.mkdir(parents=True, exist_ok=True)
        for leftover in staging_folders(path):
            with suppress(OSError):  # it is a folder, or another process has just removed it
                if (lock := _lock(leftover)) is not None:
                    failed.callback(lock)
                    leftover.unlink()
        draft = _beside(path)
        # No wider than the file that it replaces, also if a kill leaves it behind.
        mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o666
        os.close(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_RDWR, mode | stat.S_IWUSR))
        # Open for writing, without which NFS gives no lock.
        with suppress(OSError):
            if (lock := _lock(draft, flags=os.O_RDWR)) is not None:
                failed.callback(lock)
        failed.callback(draft.unlink, missing_ok=True)
        yield draft
        publish(draft, path)


@contextmanager
def os_errors_as(path: Path, remark: str = "") -> Iterator[None]:
    """Make a BatchError of what the operating system refuses."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if not (reason := refusal(error)):
            raise
        raise BatchError(f"cannot write {path}: {reason}{remark}") from error


def destination(path: Path) -> Path:
    """The file that a name stands for: what is written through a link goes where it points."""
    # Not by `is_symlink`, which raises an exception where a name is too long.
    return Path(os.path.realpath(path)) if os.path.islink(path) else path


def check_writable(path: Path) -> None:
    """Raise BatchError if a file is marked as read-only, which replacing it would ignore."""
    with suppress(OSError):  # there is none yet, or writing it will say what is wrong
        mode = stat.S_IMODE(path.stat().st_mode)
        if not mode & 0o222:
            raise BatchError(f"{path} is read-only (mode {mode:o}): chmod u+w, or run --force")


def staging_folders(path: Path) -> list[Path]:
    """The hidden folders and drafts of all processes, living or dead, that write `path`. Raises
    OSError if the machine cannot list them."""
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


def _beside(path: Path) -> Path:
    """A hidden name that nothing has yet."""
    return path.parent / f".{path.name}.{os.urandom(4).hex()}.partial"


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


def _lock(path: Path, wait: bool = False, flags: int = os.O_RDONLY) -> Release | None:
    """A lock of a file or folder, or None: another process has it, or locks do not work there."""
    if not HAVE_FLOCK:
        return _lock_beside(path, wait)
    descriptor = os.open(path, flags)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        os.close(descriptor)
        return None
    return partial(os.close, descriptor)


def _lock_beside(path: Path, wait: bool) -> Release | None:
    """`_lock` by a file that `filelock` locks: for a draft or staging folder beside it, for the
    folder of results in it."""
    import filelock

    os.stat(path)  # as opening it would, if another process has removed it
    is_draft = path.suffix == ".partial"
    file = path.with_name(f"{path.name}.lock") if is_draft else path / ".hodo.lock"
    lock = filelock.FileLock(file)
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except (OSError, filelock.Timeout):
        return None

    def release() -> None:
        lock.release()
        # The name of a draft is never used again; that of the folder's lock is, and must stay.
        if is_draft:
            with suppress(OSError):
                file.unlink()

    return release
