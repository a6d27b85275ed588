"""The memory of this machine, and the refusal of cases that exceed it."""

import os
import shutil
import sys
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from .. import HodoError
from ..cases.case import Case

HAVE_LIMITS = find_spec("resource") is not None
if HAVE_LIMITS:
    import resource

BYTES = 75
"""Peak of memory for each number of each sample (the state and the stored variables), rounded up
from what cases of every model took: 10 to 30 when they were integrated, 67 when they were
classified."""


@cache
def limit() -> int:
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


def need(case: Case) -> int:
    """About how many bytes the samples of a case take at most while it is integrated or
    classified."""
    # Reduced members are computed and written chunk by chunk.
    if case.sweep and "trajectory" not in case.store:
        return 0
    system = case.system
    numbers = len(system.state) + sum(
        3 if "axis" in variable.dims else 1 for variable in system.variables.values()
    )
    return case.time.samples * numbers * BYTES


def check_memory(case: Case, processes: int = 1) -> None:
    """Raise HodoError if the samples of a case do not fit into the memory of one of so many
    processes."""
    # Refused before anything is integrated: a process that takes too much is killed without a word.
    have = limit() // processes
    if need(case) > have:
        share = f" for each of {processes} processes" if processes > 1 else ""
        there = f"there are {in_bytes(have)}{share}"
        said = f"would take about {in_bytes(need(case))} of memory, and {there}"
        raise HodoError(f"{case.name}: {case.time.samples:,} samples {said}")


def check_disk(case: Case, stored: int, folder: Path) -> None:
    """Raise HodoError if a case that stores so many bytes does not fit on the disk of a folder."""
    while not folder.exists():
        folder = folder.parent
    # Its parts are there until they are joined.
    taken, free = 2 * stored, shutil.disk_usage(folder).free
    if taken > free:
        there = f"{in_bytes(free)} are free"
        said = f"would take about {in_bytes(taken)} on the disk of {folder}, and {there}"
        raise HodoError(f"{case.name}: {said}")


def in_bytes(count: int) -> str:
    """A number of bytes with its unit, to three digits."""
    for power, unit in ((5, "PB"), (4, "TB"), (3, "GB"), (2, "MB")):
        if count >= 1000**power:
            return f"{count / 1000**power:.3g} {unit}"
    return f"{count} bytes"
