"""This machine: its memory, the versions of the libraries that are installed, and the files that
belong to the user alone."""

import errno
import os
import stat
import sys
import warnings
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

HAVE_LIMITS = find_spec("resource") is not None
if HAVE_LIMITS:
    import resource

RESOURCES = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM),
)
"""Errors of the machine, which no file and no case is to blame for."""


@cache
def memory_limit() -> int:
    """The bytes that a process may have at most: the machine's memory, or a lower limit of its
    container or shell."""
    # Windows tells neither, and refuses by itself what exceeds it.
    if not HAVE_LIMITS:
        return sys.maxsize
    # The whole memory, not what is free now: other programs may end, and Linux counts caches as
    # used.
    limits = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    if (address_space := resource.getrlimit(resource.RLIMIT_AS)[0]) != resource.RLIM_INFINITY:
        limits.append(address_space)
    with suppress(OSError, ValueError):  # no control groups, or "max"
        limits.append(int(Path("/sys/fs/cgroup/memory.max").read_text()))
    return min(limits)


def limit_memory(more: int) -> None:
    """Let this process take so many bytes more than it has, where Linux counts them."""
    with suppress(OSError, ValueError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + more, hard))


@cache
def library_version(library: str) -> str:
    """The version of a library that is installed, loaded or not; looking it up takes 10 ms."""
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"


def private_folder(variable: str, default: str) -> Path:
    """The folder `hodo` in the folder that an environment variable names, or in `default` of the
    user's home; made with mode 0700 when first asked for.

    Raises ValueError if others can reach it, OSError if it cannot be made, and RuntimeError if
    there is no home.
    """
    parent = Path(os.environ.get(variable, ""))
    folder = (parent if parent.is_absolute() else Path.home() / default) / "hodo"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not (stat.S_ISDIR((status := folder.lstat()).st_mode) and is_private(status)):
        raise ValueError(f"{folder} is not used: it is no folder of yours with mode 0700")
    return folder


def is_private(status: os.stat_result) -> bool:
    """Whether nobody else can read or change a file."""
    # Windows keeps a home for its user, and has no such modes.
    return os.name == "nt" or (
        status.st_uid == os.geteuid() and not stat.S_IMODE(status.st_mode) & 0o077
    )


SECRET_SIZE = 32


@cache
def secret() -> bytes:
    """Random bytes that only this user's processes know, on every machine that shares the home.

    Where a home cannot be written, as on many machines of a CI, they are this process's own.
    """
    try:
        file = private_folder("XDG_STATE_HOME", ".local/state") / "secret"
        if not file.exists():
            _make_secret(file)
        with open(file, "rb", opener=_opened_itself) as stream:
            content, status = stream.read(), os.fstat(stream.fileno())
        if len(content) == SECRET_SIZE and is_private(status):
            return content
        warnings.warn(f"{file} is not used: no {SECRET_SIZE} bytes with mode 0600", stacklevel=2)
    except ValueError as error:
        warnings.warn(str(error), stacklevel=2)
    except (OSError, RuntimeError):
        pass
    return os.urandom(SECRET_SIZE)


def _make_secret(file: Path) -> None:
    """Make the file of the secret whole, and once, however many processes begin together."""
    draft = file.with_name(f"secret.{os.urandom(4).hex()}")
    try:
        with open(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as stream:
            stream.write(os.urandom(SECRET_SIZE))
            stream.flush()
            os.fsync(stream.fileno())
        with suppress(FileExistsError):
            os.link(draft, file)
    finally:
        draft.unlink()


def _opened_itself(path: str, flags: int) -> int:
    """An opener that follows no link."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0))
