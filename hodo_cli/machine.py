"""This machine: its memory, and the versions of the libraries that are installed."""

import errno
import os
import sys
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


@cache
def library_version(library: str) -> str:
    """The version of a library that is installed, loaded or not; looking it up takes 10 ms."""
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"
