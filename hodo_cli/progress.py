"""How far a command is: a line on a terminal that is written over; problems, wherever they go."""

import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Self, TypeVar

import click

Item = TypeVar("Item")

SECONDS_HIDDEN = 0.5
"""Seconds before a line is shown: what is done by then needs none, nor the library that draws
it."""

TICK_SECONDS = 0.2
"""Seconds between two drawings of the line."""

SMOOTHING = 0.1
"""How much the latest tick counts in the estimate of what is left. Tasks differ, so it is taken
over some ten ticks; but not over all, because the last task may be the long one."""

MOST_NAMED = 3
"""Tasks that the line names at most: the first ones run, and the others may still wait for a
process."""

LINE = "{desc} |{bar:12}| {percentage:.0f} %, {elapsed}, {remaining} left{postfix}"


class Progress:
    """Counts tasks and says how far they are. A context manager.

    On a terminal it is a line that is written over, with the names of the tasks that run, how far
    they are, and how long all will take. Problems are printed in any case, warnings unless `quiet`,
    and details, such as a line for each task that is done, if `verbose`. A stream that takes no
    messages stops nothing. NO_COLOR=1 takes the colour from a terminal.
    """

    def __init__(self, total: int, quiet: bool = False, verbose: bool = False) -> None:
        self._total = total
        self._done = 0
        self._quiet = quiet
        self._verbose = verbose
        # A log file gets whole lines: what is written over on a terminal is unreadable there.
        self._live = sys.stderr.isatty() and not quiet
        self._colour = False if os.environ.get("NO_COLOR") else None  # None: on a terminal
        self._running: dict[str, float] = {}
        self._line: Any = None
        self._lock = threading.RLock()
        self._ended = threading.Event()
        self._drawing = threading.Thread(target=self._draw_on, daemon=True)

    def __enter__(self) -> Self:
        self._warned = warnings.showwarning
        if self._live:
            warnings.showwarning = self._warn
            self._drawing.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._live:
            self._ended.set()
            self._drawing.join()
            with self._cleared():
                warnings.showwarning = self._warned

    def say(self, line: str) -> None:
        """A line, unless quiet."""
        if not self._quiet:
            self._echo(line)

    def detail(self, line: str) -> None:
        """A line, if verbose."""
        if self._verbose:
            self._echo(line)

    def report(self, name: str, share: float) -> None:
        """Note how much of a task that runs is done, from 0 to 1."""
        self._running[name] = share

    def done(self, name: str, problem: str = "") -> None:
        """Count a task that is finished, and print its problem if it has one."""
        self._done += 1
        self._running.pop(name, None)
        count = f"[{self._done}/{self._total}] {name}"
        if problem:
            self._echo(f"{count}: {click.style(problem, fg='red')}")
        else:
            self.detail(f"{count}: ok")

    def starting(self, items: Iterable[Item], name: Callable[[Item], str] = str) -> Iterator[Item]:
        """Items that stand for tasks of these names, each of which runs from when it is taken."""
        for item in items:
            self.report(name(item), 0.0)
            yield item

    def through(self, items: Iterable[Item], name: Callable[[Item], str] = str) -> Iterator[Item]:
        """Items as in `starting`, each of which is done when the next one is taken."""
        for item in self.starting(items, name):
            yield item
            self.done(name(item))

    def _echo(self, line: str) -> None:
        with self._cleared(), suppress(OSError, ValueError):  # the log is full, or closed
            click.echo(line, err=True, color=self._colour)

    def _warn(self, *warning: Any, **rest: Any) -> None:
        with self._cleared():
            self._warned(*warning, **rest)

    @contextmanager
    def _cleared(self) -> Iterator[None]:
        """The time in which the line is not drawn."""
        with self._lock:
            if self._line is not None:
                self._line.clear()
            yield

    def _draw_on(self) -> None:
        """Draw the line now and then. In a thread, so that its clock goes on while a library
        works."""
        wait = SECONDS_HIDDEN
        while not self._ended.wait(wait):
            wait = TICK_SECONDS
            with self._lock:
                self._draw()

    def _draw(self) -> None:
        if self._line is None:
            self._line = _line(self._total)
        running = dict(self._running)
        line, now = self._line, min(self._done + sum(running.values()), self._total)
        line.set_description_str(f"{self._done}/{self._total}", refresh=False)
        named = [*running.items()][:MOST_NAMED]
        words = [f"{name} {100 * share:.0f} %" if share else name for name, share in named]
        line.set_postfix_str(", ".join(words), refresh=False)
        # An update by nothing would count as a tick in which nothing was done.
        if now != line.n:
            line.update(now - line.n)
        else:
            line.refresh()


def _line(total: int) -> Any:
    """A line of tqdm's. It is imported here, because only a terminal wants it."""
    from tqdm import tqdm

    # A terminal that does not say how large it is (`script`, some editors) would get no line.
    known = os.get_terminal_size(sys.stderr.fileno()).columns > 0
    columns, lines = (None, None) if known else (80, 24)
    # Its own lock is a semaphore of the system, which a process that is killed leaves behind.
    tqdm.set_lock(threading.RLock())
    return tqdm(
        desc=f"0/{total}",
        total=total,
        bar_format=LINE,
        leave=False,
        dynamic_ncols=known,
        ncols=columns,
        nrows=lines,
        mininterval=0,
        miniters=0,
        smoothing=SMOOTHING,
    )
