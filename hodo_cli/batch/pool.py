"""Independent tasks, done here, in other processes or on other machines: the one place that knows
executors."""

import logging
import math
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager, suppress
from functools import partial
from itertools import count, islice
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from threading import Lock, Thread
from time import perf_counter
from types import ModuleType
from typing import Any, Self, TypeVar

from .. import BatchError, HodoError
from ..progress import TICK, hear, listening
from .mark import check_late_imports, process_mark

Task = TypeVar("Task")
Result = TypeVar("Result")

TOGETHER = 2
"""How often a task is tried beside others: a worker may be killed for memory that others take."""

STARTS = 3
"""How often a process may die before it has begun; any process may be killed by chance."""

NOT_OF_A_TASK = (BatchError, ModuleNotFoundError)
"""What ends the batch, because no task is to blame for it."""

DIED = "its process died: killed, or out of memory"


class WorkerLost(Exception):
    """The process that did a task has died."""


class Pool:
    """Applies functions to tasks, in this process or through an executor. A context manager; may be
    used repeatedly.

    `make` makes the executor (None: no executor); it is called when the executor is first needed,
    or, with `early`, on entering, so that a failure to connect shows at once. `ahead` is the number
    of tasks that are handed to it before the first of them has to be finished.
    """

    def __init__(
        self, make: Callable[[], Executor] | None = None, ahead: int = 1, early: bool = False
    ) -> None:
        self._make = make
        self._early = early
        self._ahead = ahead
        self._executor: Executor | None = None

    def __enter__(self) -> Self:
        """Raises BatchError if there is no executor."""
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
        worker dies is tried again, at last with no other task beside it, before it comes back with
        a HodoError. Raises BatchError if the executor itself fails, or computes with other code,
        and ModuleNotFoundError if a package is missing.
        """
        if self._make is None:
            return ((task, _attempt(function, task)) for task in tasks)
        return self._map(function, iter(tasks))

    def _map(
        self, function: Callable[[Task], Result], tasks: Iterator[Task]
    ) -> Iterator[tuple[Task, Result | Exception]]:
        running: dict[Future[tuple[str, Result]], tuple[Task, int]] = {}
        alone: list[Task] = []
        while True:
            # Drawn only as results leave, so that a sweep of a billion members never stands in
            # memory.
            for task in islice(tasks, self._ahead - len(running)):
                running[self._submit(function, task)] = task, 1
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED)[0]:
                task, tries = running.pop(future)
                if not _is_lost(future):
                    yield task, _outcome(future)
                elif tries < TOGETHER:
                    running[self._submit(function, task)] = task, tries + 1
                else:
                    alone.append(task)
        for task in alone:
            wait([future := self._submit(function, task)])
            yield task, HodoError(DIED) if _is_lost(future) else _outcome(future)

    def _submit(self, function: Callable[[Task], Result], task: Task) -> Future[tuple[str, Result]]:
        assert self._make is not None
        self._executor = self._executor or self._make()
        return self._executor.submit(_marked, function, task)


def _is_lost(future: Future[Any]) -> bool:
    return isinstance(future.exception(), WorkerLost)


def _attempt(function: Callable[[Task], Result], task: Task) -> Result | Exception:
    try:
        return _marked(function, task)[1]
    except NOT_OF_A_TASK:
        raise
    except Exception as error:
        return error


def _marked(function: Callable[[Task], Result], task: Task) -> tuple[str, Result]:
    """What a worker does: the result, with the mark of what has computed it.

    The mark is taken before the work: a source that changes meanwhile has not computed it.
    """
    taken = process_mark()
    try:
        result = function(task)
    except ModuleNotFoundError:
        raise
    except ImportError as error:  # too large for a limit on memory, say
        raise BatchError(f"a library cannot be loaded: {error}") from None
    check_late_imports()
    return taken, result


def _outcome(future: Future[tuple[str, Any]]) -> Any:
    """The result of a finished task, or its exception.

    Raises BatchError if the executor has given up, or another version computed the result.
    """
    if isinstance(error := future.exception(), NOT_OF_A_TASK):
        raise error
    if isinstance(error, Exception):
        return error
    theirs, result = future.result()
    if theirs != process_mark():
        raise BatchError(
            "a worker computes with other code or libraries (hodo, heyoka, numpy, scipy) than this "
            "process: start both anew"
        )
    return result


class Processes(Executor):
    """Spawned processes that end when this executor is shut down, whatever they do, or when this
    process ends.

    Each has a pipe of its own, of which this process holds one end only: when a worker dies, even
    half way through a result, the pipe ends and the task comes back with `WorkerLost`. (A queue
    that workers share, as that of the standard library, is read for ever then; and its semaphores
    outlive a process that is killed.)
    """

    def __init__(self, workers: int) -> None:
        self._calls: SimpleQueue[tuple[Future[Any], bytes] | None] = SimpleQueue()
        self._workers = [_Worker(self._calls) for _ in range(workers)]
        try:
            for worker in self._workers:
                worker.start()
        except RuntimeError as error:  # a limit on threads, processes or memory
            raise BatchError(f"cannot run in {workers} processes: {error}") from None

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Schedule a call."""
        future: Future[Any] = Future()
        self._calls.put((future, pickle.dumps((function, args, kwargs))))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers, whatever they do."""
        for worker in self._workers:
            self._calls.put(None)
            worker.end()


MAIN = Lock()
"""Held while the main module is another one; workers start side by side."""


@contextmanager
def without_main() -> Iterator[None]:
    """The time in which a process may be spawned that does not run the main module's file again.

    The standard library lets it: then a script without `if __name__ == "__main__":` would run as
    many times as there are workers, and a script from stdin not at all. No task needs it, because
    none is a function of the main module.
    """
    with MAIN:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


class _Worker(Thread):
    """Hands calls to a process of its own, which it starts when it is needed and after a death."""

    def __init__(self, calls: SimpleQueue[tuple[Future[Any], bytes] | None]) -> None:
        super().__init__(daemon=True)
        self._calls = calls
        self._lock = Lock()
        self._ended = False
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    def run(self) -> None:
        if hasattr(signal, "pthread_sigmask"):  # Windows has neither this nor the helper
            # Starting this helper of the standard library unblocks the signal, so it comes first.
            resource_tracker.ensure_running()
            # Processes inherit it: Ctrl-C, which a terminal sends to all of them, is this process's
            # affair.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        while (item := self._calls.get()) is not None:
            future, call = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                done, value = self._reply(call)
            except (EOFError, OSError):
                self._discard()
                future.set_exception(WorkerLost())
            except Exception as error:  # a result that cannot be unpickled here
                future.set_exception(error)
            else:
                (future.set_result if done else future.set_exception)(value)
        self._discard()

    def _reply(self, call: bytes) -> tuple[bool, Any]:
        """What a call comes to; what it says of its progress before is passed on."""
        if self._pipe is None:
            self._start()
        assert self._pipe is not None
        self._pipe.send_bytes(call)
        while isinstance((answer := pickle.loads(self._pipe.recv_bytes()))[0], str):
            hear(*answer)
        done, value = answer
        return done, value

    def _start(self) -> None:
        """Raises BatchError if no process can be started, EOFError if this executor has ended."""
        for _ in range(STARTS):
            try:
                self._pipe = self._spawned()
                self._pipe.recv_bytes()
                return
            except EOFError:
                self._discard()
                if self._ended:
                    raise
            except OSError as error:
                raise BatchError(f"cannot start a process: {error.strerror}") from None
        raise BatchError("a worker process ends before it has begun (no memory left?)")

    def _spawned(self) -> Connection:
        """This end of the pipe to a new process, which says at its other end when it is ready."""
        context = get_context("spawn")
        ours, theirs = context.Pipe()
        with theirs, self._lock:
            if self._ended:
                raise EOFError
            self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
            with without_main():
                self._process.start()
        return ours

    def _discard(self) -> None:
        """Give up the process, dead or alive; the next call has a new one."""
        if self._pipe is not None:
            self._pipe.close()
        with self._lock:
            process, self._process, self._pipe = self._process, None, None
        if process is not None and process.pid is not None:
            process.kill()
            process.join()

    def end(self) -> None:
        """Kill the process, in the middle of a call or not."""
        with self._lock:
            self._ended = True
            if self._process is not None and self._process.pid is not None:
                self._process.kill()


def _serve(pipe: Connection) -> None:
    """Answer calls, one after the other, until the pipe or the process at its other end is gone."""

    def end_with_parent() -> None:
        if (parent := parent_process()) is not None:
            parent.join()
            os._exit(1)

    def say(name: str, part: float) -> None:
        pipe.send_bytes(pickle.dumps((name, part)))

    Thread(target=end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError), listening(say):
        pipe.send_bytes(b"ready")
        while True:
            pipe.send_bytes(_answer(pipe.recv_bytes()))


def _answer(call: bytes) -> bytes:
    """What a call returns or raises, pickled."""
    try:
        function, args, kwargs = pickle.loads(call)
        return pickle.dumps((True, function(*args, **kwargs)))
    except Exception as error:
        if not isinstance(error, HodoError):  # a bug, which is looked for where it arose
            error.add_note(traceback.format_exc())
        try:
            return pickle.dumps((False, error))
        except Exception:
            return pickle.dumps((False, HodoError(f"{type(error).__name__}: {error}")))


class Dask(Executor):
    """The workers of a dask scheduler: those at tcp://HOST:PORT, or, for "dask", so many processes
    of this machine.

    A task whose worker is lost is done again by another one. Raises BatchError if dask is not
    installed, or no scheduler answers.
    """

    def __init__(self, scheduler: str, workers: int) -> None:
        try:
            import distributed
        except ImportError:
            raise BatchError(
                "--scheduler needs dask, which is not installed: pip install '.[dask]'"
            ) from None
        # It logs with tracebacks what ends up as one line of ours.
        for name in [name for name in logging.root.manager.loggerDict if "distributed" in name]:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        local = {
            "n_workers": workers,
            "threads_per_worker": 1,
            "host": "127.0.0.1",
            "dashboard_address": None,
        }
        self._address = scheduler
        self._killed = distributed.KilledWorker
        self._client = self._connected(
            partial(distributed.Client, **local)
            if scheduler == "dask"
            else partial(distributed.Client, scheduler, timeout=10)
        )
        self._inner = self._client.get_executor(pure=False)
        # Of this client alone: others may use the scheduler at the same time.
        self._topic = f"hodo {self._client.id}"
        self._client.subscribe_topic(self._topic, self._hear)
        self._numbers, self._running = count(), set[int]()

    def _connected(self, connect: Callable[[], Any]) -> Any:
        """A client. What answers at an address may be any program: dask raises whatever that leads
        to, or waits for ever."""
        answer: Future[Any] = Future()

        def try_to() -> None:
            try:
                answer.set_result(connect())
            except Exception as error:
                answer.set_exception(error)

        Thread(target=try_to, daemon=True).start()
        try:
            return answer.result(timeout=PATIENCE_OF_DASK)
        except Exception as error:
            reason = str(error).partition("\n")[0] or type(error).__name__
            raise BatchError(f"no dask scheduler answers at {self._address}: {reason}") from None

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Schedule a call. Raises BatchError if the scheduler is gone."""
        try:
            number = next(self._numbers)
            told = partial(_telling, self._topic, number, function)
            theirs = self._inner.submit(told, *args, **kwargs)
        except Exception as error:
            raise self._gone(error) from None
        self._running.add(number)
        ours: Future[Any] = Future()
        ours.add_done_callback(lambda _: self._running.discard(number))
        theirs.add_done_callback(lambda done: self._pass_on(done, ours))
        return ours

    def _hear(self, event: tuple[float, tuple[int, str, float]]) -> None:
        """Pass on how far a call is; what comes after its result is late."""
        number, name, part = event[1]
        if number in self._running:
            hear(name, part)

    def _pass_on(self, theirs: Future[Any], ours: Future[Any]) -> None:
        """The outcome of a task; dask's own errors by what they mean for a batch."""
        error = None if theirs.cancelled() else theirs.exception()
        if theirs.cancelled():
            ours.set_exception(self._gone("it has dropped a task"))
        elif isinstance(error, self._killed):
            ours.set_exception(WorkerLost())
        elif type(error).__module__.startswith("distributed"):
            ours.set_exception(self._gone(error))
        elif error is not None:
            ours.set_exception(error)
        else:
            ours.set_result(theirs.result())

    def _gone(self, error: object) -> BatchError:
        reason = str(error).partition("\n")[0]
        return BatchError(
            f"the dask scheduler at {self._address} has failed: {reason}; what is finished is kept"
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the scheduler; a cluster of this machine ends."""
        self._inner.shutdown(wait=wait and not cancel_futures)
        self._client.close()


def _telling(
    topic: str, number: int, function: Callable[..., Result], *args: Any, **kwargs: Any
) -> Result:
    """A call on a worker of dask, which tells the scheduler how far it is."""
    from distributed import get_worker

    worker, said = get_worker(), -math.inf

    def say(name: str, part: float) -> None:
        nonlocal said
        # The scheduler keeps what it is told, so it is not told of every step.
        if perf_counter() > said + TICK:
            said = perf_counter()
            worker.log_event(topic, (number, name, part))

    with listening(say):
        return function(*args, **kwargs)


PATIENCE_OF_DASK = 60.0
"""Seconds in which a scheduler must answer, or one of this machine start its workers."""

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
    return Pool(lambda: Processes(workers), 2 * workers) if workers > 1 else Pool()
