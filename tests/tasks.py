"""Tasks that tests give to other processes, which load this module alone and no test."""

import os
import signal
import sys
import time
from pathlib import Path


def troubled(task: tuple[Path, str | int]) -> object:
    """What a task may do to its process, and numbers that do nothing."""
    folder, what = task
    if what == "raises":
        raise ValueError(what)
    if what == "is odd":

        class OddError(Exception):
            """No other process knows it."""

        raise OddError(what)
    if str(what).startswith("dies"):
        with (folder / what).open("a") as file:
            file.write("x")
        if what == "dies" or (folder / what).read_text() == "x":
            os.kill(os.getpid(), signal.SIGKILL)
    return what


def stay(task: tuple[float, Path]) -> None:
    """Leave the number of its process, and after some seconds their number."""
    seconds, folder = task
    (folder / f"process {os.getpid()}").touch()
    time.sleep(seconds)
    (folder / f"after {seconds}").touch()


def tell(text: str) -> str:
    os.write(1, text.encode())  # as a library may, past Python's own stream
    return sys.stdin.read()


def large(task: int) -> bytes:
    return b"x" * 60_000_000
