"""This machine: its memory, its processor, and the versions of the libraries that are installed."""

import errno
import os
import platform
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

RESOURCES = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF),
    *(errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM),
)
"""Errors of the machine, which no file and no case is to blame for."""


def relative_path(path: str | Path, folder: str | Path) -> str:
    """A path as it is seen from a folder, with slashes on every system; the whole path where none
    leads there, as from another drive of Windows."""
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
    """What code is compiled for: the name of this machine's processor and what it can do."""
    described = [platform.machine(), platform.processor()]
    with suppress(OSError):  # Linux alone has it
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
        described += [
            line for line in lines if line.startswith(("model name", "flags", "Features"))
        ]
    return "\n".join(described)


@cache
def library_version(library: str) -> str:
    """The version of a library that is installed, loaded or not."""
    # `importlib.metadata`, which reads more, takes a tenth of a short run to load.
    places = [Path(place) for place in sys.path]
    found = [info.stem for place in places for info in place.glob(f"{library}-*.*-info")]
    return found[0].split("-")[1] if found else "not installed"
