"""This machine: its memory, its processor, the versions of the installed libraries, and compiled
code that is kept for later processes."""

import errno
import hashlib
import os
import pickle
import platform
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

RESOURCES = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM),
)
"""Errors of the machine, for which no file and no case is to blame."""


def relative_path(path: str | Path, folder: str | Path) -> str:
    """A path relative to a folder, with slashes on every system; the whole path if there is no
    relative one, as from another drive of Windows."""
    with suppress(ValueError):
        return Path(os.path.relpath(path, folder)).as_posix()
    return Path(os.path.abspath(path)).as_posix()


def memory_size() -> int:
    """The bytes of memory of this machine."""
    if not hasattr(os, "sysconf"):  # Windows refuses by itself what exceeds it
        return sys.maxsize
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@cache
def processor() -> str:
    """The target of compiled code: the name of this machine's processor and its features."""
    described = [platform.machine(), platform.processor()]
    with suppress(OSError):  # Linux alone has it
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
        described += [
            line for line in lines if line.startswith(("model name", "flags", "Features"))
        ]
    return "\n".join(described)


@cache
def library_version(library: str) -> str:
    """The version of an installed library, loaded or not."""
    # `importlib.metadata` reads more, and loading it takes a tenth of a short run.
    places = [Path(place) for place in sys.path]
    stems = [info.stem for place in places for info in place.glob(f"{library}-*.*-info")]
    return stems[0].split("-")[1] if stems else "not installed"


def cache_folder() -> Path:
    """The folder of hodo's compiled code, which only the user can reach.

    Raises OSError if it cannot be made, or others can reach it, and RuntimeError if there is no
    home.
    """
    parent = Path(os.environ.get("XDG_CACHE_HOME", ""))
    folder = (parent if parent.is_absolute() else Path.home() / ".cache") / "hodo"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.lstat()
    # Windows keeps a home for its user, and has no such modes.
    if os.name != "nt" and (status.st_uid, status.st_mode & 0o077) != (os.geteuid(), 0):
        raise PermissionError(f"{folder} is not used: it is no folder of yours with mode 0700")
    return folder


MOST_FILES = 250
"""How many files are kept: 256 MB of steps, or 10 times as much of the largest models."""


def cached_code(key: str, compiled: Callable[[], Any]) -> Any:
    """The result of `compiled`, from the disk if a process has stored it under this key.

    It is a pickle, which could run anything, so it lies in a folder that only the user can reach.
    In the file its hash comes before it, because damaged bytes can be a pickle of something else.
    """
    try:
        file = cache_folder() / f"{key}.code"
    except (OSError, RuntimeError):
        return compiled()
    with suppress(OSError):
        stored = file.read_bytes()
        if hashlib.sha256(stored[32:]).digest() == stored[:32]:
            os.utime(file)
            return pickle.loads(stored[32:])
    code = compiled()
    with suppress(OSError):  # the disk is full
        # A draft that a kill has left is removed with the oldest files, because its name begins
        # with the name of its file.
        draft = file.with_name(f"{file.name}.{os.getpid()}")
        data = pickle.dumps(code)
        draft.write_bytes(hashlib.sha256(data).digest() + data)
        os.replace(draft, file)
        for old in sorted(file.parent.glob("*.code*"), key=os.path.getmtime)[:-MOST_FILES]:
            old.unlink(missing_ok=True)
    return code
