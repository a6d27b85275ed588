"""Processes of this machine that do tasks, each through a pipe of its own."""

import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import SimpleQueue
from threading import Lock, Thread
from types import ModuleType
from typing import Any

from .. import BatchError, HodoError
from . import WorkerLost

STARTS = 3
"""How often a process may die before it has begun; any process may be killed by chance."""


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


SPAWNING = Lock()
"""Held while the main module and the environment are changed; workers start side by side."""

SAFE_PATH = "PYTHONSAFEPATH"
"""The variable that keeps Python from importing what lies in the current folder."""


@contextmanager
def spawning() -> Iterator[None]:
    """The time in which a process may be spawned that runs no file of the user's.

    The standard library lets it run the main module's file again: then a script without
    `if __name__ == "__main__":` would run as many times as there are workers, and a script from
    stdin not at all. No task needs it, because none is a function of the main module. And it starts
    Python with `-c`, which takes a `pickle.py` of the current folder for the library's own.
    """
    with SPAWNING:
        main, before = sys.modules["__main__"], os.environ.get(SAFE_PATH)
        sys.modules["__main__"], os.environ[SAFE_PATH] = ModuleType("__main__"), "1"
        try:
            yield
        finally:
            sys.modules["__main__"] = main
            del os.environ[SAFE_PATH]
            if before is not None:
                os.environ[SAFE_PATH] = before


def start_tracker() -> None:
    """Start the process in which the standard library notes what others share."""
    if os.name == "posix":  # Windows has none
        with spawning():
            resource_tracker.ensure_running()


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
        # Starting it unblocks the signal, so it comes first.
        start_tracker()
        if hasattr(signal, "pthread_sigmask"):
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
        """Whether a call returned, and what it returned or raised."""
        if self._pipe is None:
            self._start()
        assert self._pipe is not None
        self._pipe.send_bytes(call)
        done, value = pickle.loads(self._pipe.recv_bytes())
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
            with spawning():
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

    Thread(target=end_with_parent, daemon=True).start()
    end_by_system()
    with suppress(EOFError, OSError):
        pipe.send_bytes(b"ready")
        while True:
            pipe.send_bytes(_answer(pipe.recv_bytes()))


PR_SET_PDEATHSIG = 1
"""The number of Linux's call that asks for a signal at the death of the parent (prctl(2))."""


def end_by_system() -> None:
    """Let the system end this process with its parent, where it can: one that is stopped (SIGSTOP,
    a debugger) does nothing itself any more."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _answer(call: bytes) -> bytes:
    """What a call returns or raises, pickled."""
    try:
        function, args, kwargs = pickle.loads(call)
        return pickle.dumps((True, function(*args, **kwargs)))
    except Exception as error:
        if not isinstance(
            error, HodoError | BatchError
        ):  # a bug, which is looked for where it arose
            error.add_note(traceback.format_exc())
        try:
            return pickle.dumps((False, error))
        except Exception:
            return pickle.dumps((False, HodoError(f"{type(error).__name__}: {error}")))
