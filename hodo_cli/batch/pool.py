"""Independent tasks, done here, in other processes or on other machines."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from itertools import islice
from time import monotonic
from typing import Any, Self, TypeVar

from .. import NOT_OF_A_CASE, BatchError, HodoError
from . import WorkerLost
from .digests import process_digest

Task = TypeVar("Task")
Result = TypeVar("Result")

TRIES_BESIDE_OTHERS = 2
"""How often a task is tried beside others: a worker may be killed for memory that others take."""

PROCESS_DIED = "its process died: killed, or out of memory"


START_SECONDS = 0.4
"""What it takes to start a process with numpy, heyoka and the models, on a machine of 2026."""


class InThisProcess(Executor):
    """Does each task when it is submitted."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Do a call."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Pool:
    """Applies functions to tasks through an executor, which has `ahead` tasks before the first of
    them has to be finished; where this process `takes_part`, it does tasks meanwhile. A context
    manager."""

    def __init__(self, executor: Executor, ahead: int, takes_part: bool = False) -> None:
        self._executor = executor
        self._ahead = ahead
        self._takes_part = takes_part

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        """Give up what is not finished."""
        self._executor.shutdown(wait=False)

    def map(
        self, function: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[Task, Result | Exception]]:
        """Each task with what the function makes of it, or the exception that it raises, as they
        are finished.

        Tasks are taken from their iterable when they are needed, at most `ahead` of the results.
        For other processes the function, the tasks and the results must be picklable. A task whose
        worker dies is tried again, at last with no other task beside it, before it comes back with
        a HodoError. Raises BatchError if the executor itself fails, or computes with other code,
        and ModuleNotFoundError if a package is missing.
        """

        def submit(task: Task) -> Future[tuple[str, Result]]:
            return self._executor.submit(_with_digest, function, task)

        supply = iter(tasks)
        running: dict[Future[tuple[str, Result]], tuple[Task, int]] = {}
        alone: list[Task] = []
        while True:
            # Drawn only as results leave, so that a sweep of a billion members never stands in
            # memory.
            for task in islice(supply, self._ahead - len(running)):
                running[submit(task)] = task, 1
            if not running:
                break
            is_free = self._takes_part and not any(future.done() for future in running)
            mine = [*islice(supply, is_free)]
            for task in mine:
                yield task, _outcome(InThisProcess().submit(_with_digest, function, task))
            for future in wait(running, 0 if mine else None, FIRST_COMPLETED)[0]:
                task, tries = running.pop(future)
                if not _is_lost(future):
                    yield task, _outcome(future)
                elif tries < TRIES_BESIDE_OTHERS:
                    running[submit(task)] = task, tries + 1
                else:
                    alone.append(task)
        for task in alone:
            wait([future := submit(task)])
            yield task, HodoError(PROCESS_DIED) if _is_lost(future) else _outcome(future)

    def map_brief(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], is_long: bool = False
    ) -> Iterator[tuple[Task, Result | Exception]]:
        """As `map`, for tasks that are brief beside the start of a process: they are done here
        until the first worker has started, and none starts for less work than that takes. Where all
        together are known to take longer, `is_long`, workers start at once."""
        starting: list[Future[bool]] = []
        done, begin, here = 0, monotonic(), pool(1)
        seconds_left = math.inf if is_long else 0.0
        # One at least is done here: what it compiles the others find on the disk.
        while done < len(tasks) and not any(future.done() for future in starting):
            if not starting and seconds_left > START_SECONDS:
                # One call for each worker, whose unpickling loads what the function needs.
                workers = range(self._ahead // 2)
                starting = [self._executor.submit(callable, function) for _ in workers]
            yield from here.map(function, tasks[done : done + 1])
            done += 1
            seconds_left = (monotonic() - begin) / done * (len(tasks) - done)
        yield from self.map(function, tasks[done:])


def _is_lost(future: Future[Any]) -> bool:
    return isinstance(future.exception(), WorkerLost)


def _with_digest(function: Callable[[Task], Result], task: Task) -> tuple[str, Result]:
    """What a worker does: the result, with the digest of what has computed it.

    Raises BatchError for what this machine refuses; a package that is missing is the caller's.
    """
    try:
        result = function(task)
    except ModuleNotFoundError:
        raise
    except SystemExit as error:  # of a model that is not hodo's
        raise HodoError(f"its model calls exit({error})") from error
    except ImportError as error:  # too large for a limit on memory, say
        raise BatchError(f"a library cannot be loaded: {error}") from None
    except OSError as error:
        raise BatchError(f"the operating system refuses it: {error}") from error
    return process_digest(), result


def _outcome(future: Future[tuple[str, Any]]) -> Any:
    """The result of a finished task, or its exception.

    Raises BatchError if the executor has given up, or another version computed the result.
    """
    if isinstance(error := future.exception(), NOT_OF_A_CASE):
        raise error
    if isinstance(error, Exception):
        return error
    worker_digest, result = future.result()
    if worker_digest != process_digest():
        raise BatchError(
            "a worker computes with other code or libraries (hodo, heyoka, numpy, scipy) than this "
            "process: start both anew"
        )
    return result


TASKS_AHEAD = 256
"""Tasks that a scheduler elsewhere is given before the first is finished: more than it is likely to
have workers."""


def pool(workers: int, scheduler: str | None = None, takes_part: bool = False) -> Pool:
    """Tasks in this process, if `workers` is 1, in so many others, or on the workers of a dask
    scheduler; with `takes_part` this process is one of the workers. Raises BatchError if there are
    none."""
    if scheduler is not None:
        from .dask import Dask

        return Pool(Dask(scheduler, workers), 2 * workers if scheduler == "dask" else TASKS_AHEAD)
    if workers > 1:
        from .processes import Processes

        others = workers - takes_part
        return Pool(Processes(others), 2 * others, takes_part)
    return Pool(InThisProcess(), 1)
