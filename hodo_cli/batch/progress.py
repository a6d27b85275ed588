"""What a batch says on stderr while it runs."""

import os
import shutil
import sys
from typing import Self

import click


class Progress:
    """Counts tasks: in one line that is written over on a terminal, else in a line for each. A
    context manager.

    Problems are said in any case; the rest unless `quiet`. NO_COLOR=1 takes the colour from a
    terminal.
    """

    def __init__(self, total: int, quiet: bool = False) -> None:
        self._total = total
        self._done = 0
        self._quiet = quiet
        # A log file gets whole lines: what is written over on a terminal is unreadable there.
        self._live = sys.stderr.isatty() and not quiet
        self._colour = sys.stderr.isatty() and not os.environ.get("NO_COLOR")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._clear()

    def say(self, line: str) -> None:
        """A line, unless quiet."""
        if not self._quiet:
            self._clear()
            click.echo(line, err=True)

    def done(self, name: str, problem: str = "") -> None:
        """Count a task that is finished, well or with a problem."""
        self._done += 1
        count = f"[{self._done}/{self._total}] {name}"
        if problem:
            self._clear()
            said = click.style(problem, fg="red") if self._colour else problem
            click.echo(f"{count}: {said}", err=True)
        elif self._live:
            self._clear()
            # A full line would wrap, and only its last row could be cleared.
            click.echo(count[: shutil.get_terminal_size().columns - 1], err=True, nl=False)
        else:
            self.say(f"{count}: ok")

    def _clear(self) -> None:
        if self._live:
            click.echo("\r\x1b[K", err=True, nl=False)
