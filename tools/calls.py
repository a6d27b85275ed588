"""Note which functions of a package are called, in the processes and threads that tests start;
`mutants.py` has each of them load this module."""

import os
import sys
import threading
from contextlib import suppress
from types import CodeType


def begin(package: str, notes: str) -> None:
    """Watch this process, and the threads that it starts from now on: the place of each function of
    the package (a folder) is added to the notes (a file)."""
    seen: set[CodeType] = set()

    def watch(frame: object, event: str, argument: object) -> None:
        code: CodeType = frame.f_code  # type: ignore[attr-defined]
        if code in seen:
            return
        seen.add(code)
        if code.co_filename.startswith(package):
            # At once, and in one call: the process may be killed, and others write too. A test may
            # have limited the files of a process.
            with suppress(OSError):
                file = os.open(notes, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
                os.write(file, f"{code.co_filename}:{code.co_firstlineno}\n".encode())
                os.close(file)

    threading.setprofile(watch)
    sys.setprofile(watch)
