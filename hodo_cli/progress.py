"""The progress of a command, as one line of a terminal that is drawn again and again; and its
problems, on any stream."""

import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Self, TypeVar

import click

Item = TypeVar("Item")

SECONDS_HIDDEN, TICK_SECONDS = 0.5, 0.2
"""Seconds before the line is shown, because short work needs neither it nor the library that draws
it; and seconds between two drawings."""

MOST_NAMED = 3
"""The most tasks that the line names: the first ones run, and the others may still wait for a
process."""

LINE = "{desc} |{bar:12}| {percentage:.0f} %, {elapsed}, {remaining} left{postfix}"


class Progress:
    """Counts tasks and shows how far they are. A context manager.

    On a terminal it is a line that is written over, with the names of the running tasks, how far
    they are, and how long all will take. Problems are always printed, warnings unless `quiet`, and
    details, such as a line for each finished task, if `verbose`. A stream that takes no messages
    stops nothing. NO_COLOR=1 takes the colour from a terminal.
    """

    def __init__(self, total: int, quiet: bool = False, verbose: bool = False) -> None:
        self._total, self._done, self._quiet, self._verbose = total, 0, quiet, verbose
        self._running: dict[str, float] = {}
        self._line: Any = None
        self._lock, self._ended = threading.RLock(), threading.Event()

    def __enter__(self) -> Self:
        self._warned = warnings.showwarning
        # A log file gets whole lines: a line that is written over is unreadable there.
        if sys.stderr.isatty() and not self._quiet:
            warnings.showwarning = self._warn
            # In a thread, so that the clock runs while a library works.
            threading.Thread(target=self._draw_on, daemon=True).start()
        return self

    def __exit__(self, *exception: object) -> None:
        warnings.showwarning = self._warned
        self._ended.set()
        with self._cleared():  # after a drawing that has begun
            pass

    def say(self, line: str) -> None:
        """Print a line, unless quiet."""
        if not self._quiet:
            self._echo(line)

    def detail(self, line: str) -> None:
        """Print a line, if verbose."""
        if self._verbose:
            self._echo(line)

    def report(self, name: str, share: float) -> None:
        """Note how much of a running task is done, from 0 to 1."""
        self._running[name] = share

    def done(self, name: str, problem: str = "") -> None:
        """Count a task that is finished, and print its problem if it has one."""
        self._done += 1
        self._running.pop(name, None)
        show = self._echo if problem else self.detail
        end = click.style(problem, fg="red") if problem else "ok"
        show(f"[{self._done}/{self._total}] {name}: {end}")

    def starting(self, items: Iterable[Item], name: Callable[[Item], str] = str) -> Iterator[Item]:
        """The items for tasks of these names; a task counts as running once its item is taken."""
        for item in items:
            self.report(name(item), 0.0)
            yield item

    def through(self, items: Iterable[Item], name: Callable[[Item], str] = str) -> Iterator[Item]:
        """The items as in `starting`; a task counts as done when the next item is taken."""
        for item in self.starting(items, name):
            yield item
            self.done(name(item))

    def _echo(self, line: str) -> None:
        with self._cleared(), suppress(OSError, ValueError):  # the log is full, or closed
            click.echo(line, err=True, color=False if os.environ.get("NO_COLOR") else None)

    def _warn(self, *warning: Any, **rest: Any) -> None:
        with self._cleared():
            self._warned(*warning, **rest)

    @contextmanager
    def _cleared(self) -> Iterator[None]:
        """A context in which the line is not drawn."""
        with self._lock:
            if self._line is not None:
                self._line.clear()
            yield

    def _draw_on(self) -> None:
        """Draw the line again and again, at intervals."""
        wait = SECONDS_HIDDEN
        while not self._ended.wait(wait):
            wait = TICK_SECONDS
            with self._lock:
                if not self._ended.is_set():
                    self._draw()

    def _draw(self) -> None:
        """Draw the line with the present numbers."""
        line = self._line = self._line or line_of_terminal(self._total)
        running = dict(self._running)
        named = [*running.items()][:MOST_NAMED]
        words = [f"{name} {100 * share:.0f} %" if share else name for name, share in named]
        line.set_description_str(f"{self._done}/{self._total}", refresh=False)
        line.set_postfix_str(", ".join(words), refresh=False)
        line.n = min(self._done + sum(running.values()), self._total)
        line.refresh()


def line_of_terminal(total: int) -> Any:
    """A line of tqdm, which is imported here because only a terminal needs it."""
    from tqdm import tqdm

    # A terminal that does not state its size (`script`, some editors) would get no line.
    is_known = os.get_terminal_size(sys.stderr.fileno()).columns > 0
    size = {} if is_known else {"ncols": 80, "nrows": 24}
    # tqdm's own lock is a semaphore of the system, which a killed process leaves in place.
    tqdm.set_lock(threading.RLock())
    tqdm.monitor_interval = 0
    return tqdm(total=total, bar_format=LINE, leave=False, dynamic_ncols=is_known, **size)
