"""Independent tasks, done here, in other processes or on other machines: the one place that knows
executors."""

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from itertools import islice
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any, Self, TypeVar

from .. import HodoError
from .mark import check_late_imports, mark

Task = TypeVar("Task")
Result = TypeVar("Result")


class Pool:
    """Applies functions to tasks, in this process or through an executor. A context manager; may be
    used repeatedly.

    `make` makes the executor (None: no executor); it is called when first needed, and again after a
    worker's death. `ahead` is the number of tasks that are handed to it before the first of them
    has to be finished. With `early` it is made on entering, so that it is known at once if there is
    none to be had.
    """

    def __init__(
        self, make: Callable[[], Executor] | None = None, ahead: int = 1, early: bool = False
    ) -> None:
        self._make = make
        self._early = early
        self._ahead = ahead
        self._executor: Executor | None = None

    def __enter__(self) -> Self:
        """Raises HodoError if there is no executor to be had."""
        if self._early and self._make is not None:
            self._executor = self._make()
        return self

    def __exit__(self, *exception: object) -> None:
        """Give up what is not finished."""
        if self._executor is not None:
            self._executor.shutdown(wait=False)
            self._executor = None

    def map(
        self, function: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[Task, Result | Exception]]:
        """Each task with what the function makes of it, or the exception that it raises, as they
        are finished.

        Tasks are taken from their iterable when they are needed, at most `ahead` of the results.
        With an executor, the function, the tasks and the results must be picklable. A task whose
        worker dies, and dies again when it has no other task beside it, comes back with a
        HodoError; what else was lost is done again.
        """
        if self._make is None:
            return ((task, _attempt(function, task)) for task in tasks)
        return self._map(function, iter(tasks))

    def _map(
        self, function: Callable[[Task], Result], tasks: Iterator[Task]
    ) -> Iterator[tuple[Task, Any]]:
        running: dict[Future[tuple[str, Any]], Task] = {}
        while True:
            # Drawn only as results leave, so that a sweep of a billion members never stands in
            # memory.
            for task in islice(tasks, self._ahead - len(running)):
                running[self._submit(function, task)] = task
            if not running:
                return
            ready, _ = wait(running, return_when=FIRST_COMPLETED)
            if any(map(_is_lost, ready)):
                ready, _ = wait(running)  # a broken executor gives up all its tasks
            # What is finished leaves first, and is stored, before a task that may have killed its
            # worker is tried again.
            for future in sorted(ready, key=_is_lost):
                task = running.pop(future)
                if _is_lost(future):
                    yield task, self._alone(function, task)
                else:
                    yield task, _outcome(future)

    def _submit(self, function: Callable[[Task], Result], task: Task) -> Future[tuple[str, Result]]:
        assert self._make is not None
        try:
            self._executor = self._executor or self._make()
            return self._executor.submit(_marked, function, task)
        # A worker that dies between two tasks is noticed only here.
        except BrokenExecutor:
            self.__exit__()
            self._executor = self._make()
            return self._executor.submit(_marked, function, task)

    def _alone(self, function: Callable[[Task], Result], task: Task) -> Result | Exception:
        wait([future := self._submit(function, task)])
        if _is_lost(future):
            return HodoError("its process died: killed, or out of memory")
        return _outcome(future)


def _is_lost(future: Future[Any]) -> bool:
    return isinstance(future.exception(), BrokenExecutor)


def _attempt(function: Callable[[Task], Result], task: Task) -> Result | Exception:
    try:
        return _marked(function, task)[1]
    except Exception as error:
        return error


def _marked(function: Callable[[Task], Result], task: Task) -> tuple[str, Result]:
    """What a worker does: the result, with the mark of what has computed it.

    The mark is taken before the work: a source that changes meanwhile has not computed it.
    """
    taken = mark()
    result = function(task)
    check_late_imports()
    return taken, result


def _outcome(future: Future[tuple[str, Result]]) -> Result | Exception:
    """The result of a finished task, or its exception. Raises HodoError if another version made
    it."""
    if isinstance(error := future.exception(), Exception):
        return error
    theirs, result = future.result()
    if theirs != mark():
        raise HodoError(
            "a worker computes with other code or libraries (hodo, heyoka, numpy, scipy) than this "
            "process: start both anew"
        )
    return result


class Processes(ProcessPoolExecutor):
    """Spawned processes that end when this executor is shut down, whatever they do, or when this
    process ends."""

    def __init__(self, workers: int) -> None:
        # Not fork, which would copy locks that threads hold and the state of an HDF5 library with
        # open files.
        context = get_context("spawn")
        leash, self._end = context.Pipe(duplex=False)
        super().__init__(workers, context, _obey, (leash,))

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Schedule a call. A worker that is started for it never sees Ctrl-C, which is this
        process's affair."""
        # A new process inherits the mask, and the executor starts its workers in `submit`.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(function, *args, **kwargs)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, whatever they do."""
        self._end.close()
        super().shutdown(wait, cancel_futures=cancel_futures)


def _obey(leash: Connection) -> None:
    """End this worker when the other end of `leash` is closed: by `shutdown`, or by the death of
    its owner."""

    def watch() -> None:
        # Blocks until the other end is closed: nothing is ever sent.
        leash.poll(None)
        # No exception would do: the main thread is inside an integration, which does not return to
        # Python.
        os._exit(1)

    # A daemon, or the worker would wait for it when it ends by itself.
    Thread(target=watch, daemon=True).start()


class Dask(Executor):
    """The workers of a dask scheduler: those at tcp://HOST:PORT, or, for "dask", so many processes
    of this machine.

    A task whose worker is lost is done again by another one. Raises HodoError if dask is not
    installed, or no scheduler answers.
    """

    def __init__(self, scheduler: str, workers: int) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise HodoError(
                "--scheduler needs dask, which is not installed: pip install 'hodo[dask]'"
            ) from None
        # On the loopback interface and without a dashboard: whoever reaches a port of dask can run
        # code here.
        local = {
            "n_workers": workers,
            "threads_per_worker": 1,
            "host": "127.0.0.1",
            "dashboard_address": None,
        }
        try:
            # 10 s in place of dask's 30: a mistyped address should show soon.
            client: Any = Client  # it is not typed
            self._client = client(**local) if scheduler == "dask" else client(scheduler, timeout=10)
        except (OSError, ValueError, TypeError) as error:
            raise HodoError(f"no dask scheduler answers at {scheduler}: {error}") from None
        # A pure task would be looked up by its arguments, and --force is to compute, not to find
        # again.
        self._inner = self._client.get_executor(pure=False)

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Schedule a call."""
        future: Future[Any] = self._inner.submit(function, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the scheduler; a cluster of this machine ends."""
        self._inner.shutdown(wait=wait and not cancel_futures)
        self._client.close()


AHEAD = 256
"""Tasks that a scheduler elsewhere is given before the first is finished: more than it is likely to
have workers."""


def pool(workers: int, scheduler: str | None = None) -> Pool:
    """Tasks in this process, if `workers` is 1, in so many others, or on the workers of a dask
    scheduler."""
    if scheduler is not None:
        return Pool(
            lambda: Dask(scheduler, workers),
            2 * workers if scheduler == "dask" else AHEAD,
            early=True,
        )
    # A task waits for each that runs, so that no worker idles while this process writes results.
    return Pool(lambda: Processes(workers), 2 * workers) if workers > 1 else Pool()
