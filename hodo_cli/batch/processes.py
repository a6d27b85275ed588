"""Processes of this machine that do tasks, each with a pipe to it and one from it."""

import gc
import json
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from queue import SimpleQueue
from subprocess import PIPE, Popen
from threading import Lock, Thread
from typing import IO, Any

from .. import BatchError, HodoError
from . import WorkerLost

START_TRIES = 3
"""How often a process may die before it has begun; any process may be killed by chance."""


class Processes(Executor):
    """Python processes that end when this executor is shut down, whatever they do, or when this
    process ends.

    Each has pipes of its own: when a worker dies, even half way through a result, they end and the
    task comes back with `WorkerLost`. (The standard library's workers share a queue, which is read
    for ever then. They also run the main module's file again, and a `pickle.py` of the current
    folder; no task needs the one, and nobody wants the other.)
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


WORKER_PROGRAM = """\
import gc, json, sys
sys.path[:], threshold = json.loads(sys.argv[1])
gc.set_threshold(*threshold)
from hodo_cli.batch.processes import serve
serve()
"""


# `-P`, since an environment that is ignored (`-E`) cannot tell a worker to import nothing from the
# current folder.
WORKER_COMMAND = [
    sys.executable,
    "-P",
    *(["-E"] if sys.flags.ignore_environment else []),
    "-c",
    WORKER_PROGRAM,
]
"""What starts a worker, but for the folders that this process imports from, and how often this
process looks for garbage."""


class _Worker(Thread):
    """Hands calls to a process of its own, which it starts when it is needed and after a death."""

    def __init__(self, calls: SimpleQueue[tuple[Future[Any], bytes] | None]) -> None:
        super().__init__(daemon=True)
        self._calls = calls
        self._lock = Lock()
        self._ended = False
        self._process: Popen[bytes] | None = None

    def run(self) -> None:
        if hasattr(signal, "pthread_sigmask"):
            # Processes inherit it: Ctrl-C, which a terminal sends to all of them, is this process's
            # affair.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        while (item := self._calls.get()) is not None:
            future, call = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                process = self._process or self._ready()
                _send(process.stdin, call)
                has_returned, value = pickle.loads(_received(process.stdout))
            except (EOFError, OSError):
                self._discard()
                future.set_exception(WorkerLost())
            except Exception as error:  # a result that cannot be unpickled here
                future.set_exception(error)
            else:
                (future.set_result if has_returned else future.set_exception)(value)
        self._discard()

    def _ready(self) -> Popen[bytes]:
        """A process that is ready. Raises BatchError if none can be started, EOFError if this
        executor has ended."""
        for _ in range(START_TRIES):
            try:
                with self._lock:
                    if self._ended:
                        raise EOFError
                    command = [*WORKER_COMMAND, json.dumps([sys.path, gc.get_threshold()])]
                    self._process = process = Popen(command, stdin=PIPE, stdout=PIPE)
                _received(process.stdout)
                return process
            except EOFError:
                self._discard()
                if self._ended:
                    raise
            except OSError as error:
                raise BatchError(f"cannot start a process: {error.strerror}") from None
        raise BatchError("a worker process ends before it has begun (no memory left?)")

    def _discard(self) -> None:
        """Give up the process, dead or alive; the next call has a new one."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            with suppress(OSError), process:  # what it has not read is lost
                process.kill()

    def end(self) -> None:
        """Kill the process, in the middle of a call or not."""
        with self._lock:
            self._ended = True
            if self._process is not None:
                self._process.kill()


HEADER_BYTES = 8
"""The bytes that say how long a message is."""


def _send(stream: IO[bytes] | None, message: bytes) -> None:
    assert stream is not None
    stream.write(len(message).to_bytes(HEADER_BYTES, "little") + message)
    stream.flush()


def _received(stream: IO[bytes] | None) -> bytes:
    """The next message. Raises EOFError if the process at the other end has died before its end."""
    assert stream is not None
    length = int.from_bytes(stream.read(HEADER_BYTES), "little")
    message = stream.read(length)
    if not length or len(message) < length:
        raise EOFError
    return message


def serve() -> None:
    """Answer the calls that come through stdin, until the process at its other end is gone."""
    incoming, outgoing = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # What a model prints is no answer, and it has nothing to read.
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    calls: SimpleQueue[bytes] = SimpleQueue()

    def read_to_the_end() -> None:
        with suppress(EOFError, OSError):
            while True:
                calls.put(_received(incoming))
        os._exit(1)  # in the middle of a call too

    Thread(target=read_to_the_end, daemon=True).start()
    end_by_system()
    with suppress(OSError):
        _send(outgoing, b"ready")
        while True:
            _send(outgoing, _answer(calls.get()))


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
        if not isinstance(error, HodoError | BatchError):
            error.add_note(traceback.format_exc())  # a bug is looked for where it arose
        try:
            return pickle.dumps((False, error))
        except Exception:
            return pickle.dumps((False, HodoError(f"{type(error).__name__}: {error}")))
