"""The memory and the disk that cases take, and the refusal of those that exceed them."""

import ctypes
import shutil
import sys
from pathlib import Path

from .. import HodoError
from ..cases.case import Case
from ..machine import memory_limit
from ..text import in_bytes

BYTES_PER_NUMBER = 75
"""Peak of memory for each number of each sample (the state and the stored variables), rounded up
from what cases of every model took: 10 to 30 when they were integrated, 67 when they were
classified."""


M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # mallopt(3)

KEPT_MEMORY, KEPT_ARRAY = 64 << 20, 16 << 20
"""The bytes that a process keeps though they are free, and the largest array among them. The arrays
of a chunk of members are a few MB each."""


def keep_freed_memory() -> None:
    """Let this process keep what arrays have freed, where its C library can be told.

    glibc gives the pages of large arrays back at once, and the system clears new ones for the next:
    a tenth of the time of a sweep.
    """
    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)):
        mallopt(M_TRIM_THRESHOLD, KEPT_MEMORY)
        mallopt(M_MMAP_THRESHOLD, KEPT_ARRAY)


def bytes_needed(case: Case) -> int:
    """About how many bytes the samples of a case take at most while it is integrated or
    classified."""
    # Reduced members are computed and written chunk by chunk.
    if case.sweep and "trajectory" not in case.store:
        return 0
    system = case.system
    numbers = len(system.state) + sum(variable.width for variable in system.variables.values())
    return case.time.samples * numbers * BYTES_PER_NUMBER


def lack_of_memory(case: Case, processes: int = 1) -> str:
    """Why the samples of a case do not fit into the memory of one of so many processes; an empty
    string if they do."""
    if bytes_needed(case) <= (have := memory_limit() // processes):
        return ""
    needs = (
        f"{case.time.samples:,} samples would take about {in_bytes(bytes_needed(case))} of memory"
    )
    share = f" for each of {processes} processes" if processes > 1 else ""
    return f"{needs}, and there are {in_bytes(have)}{share}"


def check_memory(case: Case) -> None:
    """Raise HodoError if the samples of a case do not fit into memory."""
    # Refused before anything is integrated: a process that takes too much is killed without a word.
    if message := lack_of_memory(case):
        raise HodoError(f"{case.name}: {message}")


def check_disk(case: Case, stored: int, folder: Path) -> None:
    """Raise HodoError if a case that stores so many bytes does not fit on the disk of a folder."""
    while not folder.exists():
        folder = folder.parent
    # Its chunks are there until they are joined.
    taken, free = 2 * stored, shutil.disk_usage(folder).free
    if taken > free:
        raise HodoError(
            f"{case.name}: would take about {in_bytes(taken)} on the disk of {folder}, "
            f"and {in_bytes(free)} are free"
        )
