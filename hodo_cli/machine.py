"""This machine: its memory, its processor, its paths, and the versions of the libraries that are
installed."""

import errno
import os
import platform
import sys
from contextlib import suppress
from functools import cache
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


def relative_path(path: str | Path, folder: str | Path) -> str:
    """A path as it is seen from a folder, with slashes on every system; the whole path where none
    leads there, as from another drive of Windows."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(os.path.abspath(path)).as_posix()


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
def metadata_folders() -> tuple[Path, ...]:
    """The folders that hold the metadata of installed packages. `importlib.metadata`, which reads
    more of them, takes a tenth of a short run to load."""
    places = [Path(place) for place in sys.path if os.path.isdir(place or ".")]
    return tuple(folder for place in places for folder in place.glob("*-info"))


@cache
def library_version(library: str) -> str:
    """The version of a library that is installed, loaded or not."""
    named = (folder.stem.split("-") for folder in metadata_folders())
    versions = [words[1] for words in named if words[0] == library and len(words) > 1]
    if versions:
        return versions[0]
    # Named or kept otherwise, as in an archive, or not there.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"
