"""What the operating system refuses: a file for HDF5 that outlives a full disk, and the reasons."""

import io
import os
import re
from pathlib import Path
from typing import Any


class Disk(io.FileIO):
    """A new file that keeps the first failure (a full disk) to itself: HDF5 takes the whole process
    down over one.

    What could not be written is kept in memory and read back from there, for HDF5 crashes over
    missing bytes too.
    """

    error: OSError | None = None

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._unwritten: list[tuple[int, bytes]] = []

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        try:
            while view and self.error is None:
                view = view[super().write(view) :]
        except OSError as error:
            self.error = error
        # HDF5 takes a short write for the end of everything, so all is taken and the rest kept.
        if view:
            self._unwritten.append((self.tell(), bytes(view)))
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def check(self) -> None:
        """Raise the failure, if there was one."""
        if self.error:
            raise self.error

    def readinto(self, buffer: Any) -> int:
        start, view = self.tell(), memoryview(buffer).cast("B")
        got = super().readinto(view) or 0
        if not self.error:
            return got
        # Zeros where nothing was ever written, as a sparse file has them.
        view[got:] = bytes(len(view) - got)
        for offset, data in self._unwritten:
            first, last = max(start, offset), min(start + len(view), offset + len(data))
            if first < last:
                view[first - start : last - start] = data[first - offset : last - offset]
        return len(view)


def refusal(error: BaseException) -> str:
    """What the operating system said (no space, no permission), which HDF5 hides in its own errors;
    or nothing."""
    # HDF5 gives the errno in the text of its error, and nowhere else.
    told = re.search(r"error message = '([^']*)'", str(error))
    number = getattr(error, "errno", None)
    if told:
        return told[1].lower()
    return os.strerror(number).lower() if number else ""
