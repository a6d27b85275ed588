"""How far the work is: said where it is done, and shown on stderr.

What takes time names its task by `task`, and says by `reached` how much of it is done; `portion`
makes the whole of a piece of work a part of another's. Nothing comes of it unless somebody listens:
a `Progress` on a terminal, or the pipe that leads from a worker to one.
"""

import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Any, NamedTuple, Self, TypeVar

import click

Item = TypeVar("Item")

Listener = Callable[[str, float], object]
"""Called with the name of a task and the part of it that is done, from any thread."""


class _Scope(NamedTuple):
    """The task at hand, and which part of it the present work is."""

    name: str = ""
    low: float = 0.0
    high: float = 1.0


NOTHING = _Scope()
_scope: ContextVar[_Scope] = ContextVar("scope", default=NOTHING)
_listener: Listener | None = None


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """The time in which a listener hears what is reached in this process."""
    global _listener
    before, _listener = _listener, listener
    try:
        yield
    finally:
        _listener = before


@contextmanager
def task(name: str) -> Iterator[None]:
    """The work on one task."""
    token = _scope.set(_Scope(name))
    try:
        reached(0.0)
        yield
    finally:
        _scope.reset(token)


@contextmanager
def portion(low: float, high: float) -> Iterator[None]:
    """The work that takes the present one from `low` to `high`, as parts of its whole."""
    outer = _scope.get()
    size = outer.high - outer.low
    token = _scope.set(_Scope(outer.name, outer.low + low * size, outer.low + high * size))
    try:
        yield
    finally:
        _scope.reset(token)


def reached(part: float) -> None:
    """Say how much of the present work is done, from 0 to 1."""
    scope = _scope.get()
    if scope.name:
        hear(scope.name, scope.low + part * (scope.high - scope.low))


def hear(name: str, part: float) -> None:
    """Say how much of a task is done, to whoever listens."""
    if _listener is not None:
        _listener(name, part)


BRIEF = 0.5
"""Seconds before a line is shown: what is done by then needs none, nor the library that draws
it."""

TICK = 0.2
"""Seconds between two looks at what has been reached."""

SMOOTHING = 0.1
"""How much the latest tick counts in the estimate of what is left. Tasks differ, so it is taken
over some ten ticks; but not over all, because the last task may be the long one."""

LINE = "{desc} |{bar:12}| {percentage:.0f} %, {elapsed}, {remaining} left{postfix}"


class Progress:
    """Counts tasks and says how far they are. A context manager.

    On a terminal it is a line that is written over, with what runs, how far that is, and how long
    all will take; elsewhere, if `logs`, a line for each task that is done. Problems are said in any
    case; the rest unless `quiet`. NO_COLOR=1 takes the colour from a terminal.
    """

    def __init__(self, total: int, quiet: bool = False, logs: bool = True) -> None:
        self._total = total
        self._done = 0
        self._quiet = quiet
        self._logs = logs
        # A log file gets whole lines: what is written over on a terminal is unreadable there.
        self._live = sys.stderr.isatty() and not quiet
        self._colour = sys.stderr.isatty() and not os.environ.get("NO_COLOR")
        self._running: dict[str, float] = {}
        self._line: Any = None
        self._lock = threading.RLock()
        self._ended = threading.Event()
        self._drawing = threading.Thread(target=self._draw_on, daemon=True)

    def __enter__(self) -> Self:
        self._hearing = listening(self._hear if self._live else None)
        self._hearing.__enter__()
        self._warned = warnings.showwarning
        if self._live:
            warnings.showwarning = self._warn
            self._drawing.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._hearing.__exit__(None, None, None)
        if self._live:
            self._ended.set()
            self._drawing.join()
            self._clear()
            warnings.showwarning = self._warned

    def say(self, line: str) -> None:
        """A line, unless quiet."""
        if not self._quiet:
            self._echo(line)

    def done(self, name: str, problem: str = "") -> None:
        """Count a task that is finished, well or with a problem, and say so."""
        self.counted(name, problem)()

    def counted(self, name: str, problem: str = "") -> Callable[[], object]:
        """Count a task that is finished; what is returned says so, when it is called."""
        self._done += 1
        self._running.pop(name, None)
        count = f"[{self._done}/{self._total}] {name}"
        if problem:
            told = click.style(problem, fg="red") if self._colour else problem
            return partial(self._echo, f"{count}: {told}")
        return partial(self.say if self._logs and not self._live else str, f"{count}: ok")

    def each(self, items: Iterable[Item], name: Callable[[Item], str] = str) -> Iterator[Item]:
        """Items by their names as tasks, each done when the next one is asked for."""
        for item in items:
            with task(name(item)):
                yield item
            self.done(name(item))

    def _hear(self, name: str, part: float) -> None:
        self._running[name] = part

    def _echo(self, line: str) -> None:
        with self._lock:
            self._clear()
            click.echo(line, err=True)

    def _warn(self, *warning: Any, **rest: Any) -> None:
        with self._lock:
            self._clear()
            self._warned(*warning, **rest)

    def _clear(self) -> None:
        if self._line is not None:
            self._line.clear()

    def _draw_on(self) -> None:
        """Draw the line now and then. In a thread, so that its clock goes on while a library
        works."""
        wait = BRIEF
        while not self._ended.wait(wait):
            wait = TICK
            with self._lock:
                self._draw()

    def _draw(self) -> None:
        if self._line is None:
            self._line = _line(self._total)
        running = dict(self._running)
        line, now = self._line, min(self._done + sum(running.values()), self._total)
        line.set_description_str(f"{self._done}/{self._total}", refresh=False)
        words = [f"{name} {100 * part:.0f} %" if part else name for name, part in running.items()]
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
