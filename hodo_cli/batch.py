"""Independent tasks, in this process, in others, or on dask; and the digests of the code that
computes."""

import hashlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from concurrent.futures import Executor, Future
from functools import cache
from itertools import islice
from multiprocessing import connection
from pathlib import Path
from typing import Any, Self, TypeVar

from . import NOT_OF_A_CASE, STARTED, BatchError, HodoError, models
from .cases.case import Case
from .engines import have_taylor
from .machine import library_version, memory_size
from .text import first_line, in_bytes

Task = TypeVar("Task")
Result = TypeVar("Result")

LOST = HodoError("its process died: killed, or out of memory")
"""The outcome of a task whose process has died."""

OTHER_CODE = (
    "a worker computes with other code or libraries (hodo, heyoka, numpy, scipy) than this "
    "process: start both anew"
)

EDITED = "the code of hodo has changed since this process began: start it anew"

TASKS_AHEAD = 128
"""The most unfinished tasks given to a scheduler elsewhere: more than it is likely to have
workers."""

TRIES_BESIDE_OTHERS = 2
"""How often a task is tried together with others: a worker may be killed for memory that others
take."""


class Pool:
    """Applies functions to tasks: in this process if `jobs` is 1, in `jobs` processes otherwise or
    `always`, or on the workers of a dask scheduler at tcp://HOST:PORT. A context manager; at its
    end unfinished tasks are given up.

    Raises BatchError if no scheduler answers, and ModuleNotFoundError without dask.
    """

    def __init__(self, jobs: int = 1, scheduler: str | None = None, always: bool = False) -> None:
        self._jobs, self._is_here = jobs, jobs == 1 and not (scheduler or always)
        self._client = connected(scheduler) if scheduler else None
        self._executor: Executor | None = None

    def __enter__(self) -> Self:
        if not (self._is_here or self._client):
            # The processes start now, before a thread begins that a fork must not meet.
            self._executor = Processes(self._jobs)
            self._executor.submit(int)
        return self

    def __exit__(self, *exception: object) -> None:
        self._end()
        if self._client:
            self._client.close()

    def map(
        self, function: Callable[[Task], Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[Task, Result | Exception]]:
        """Each task with the function's result, or the exception that it raises, in the order in
        which they finish.

        Tasks are drawn when they are needed, so that a sweep of a billion members is never in
        memory. A task whose process dies is tried again, at last alone, before it gives a
        HodoError. Raises BatchError if a worker computes with other code, or dask fails, and the
        exceptions of `NOT_OF_A_CASE`.
        """
        supply, alone, running = iter(tasks), list[Task](), dict[Future[Any], tuple[Task, int]]()
        ahead = TASKS_AHEAD if self._client else 2 * self._jobs
        while True:
            for task in islice(supply, (1 if self._is_here else ahead) - len(running)):
                running[self._submit(function, task)] = task, 1
            if not running:
                break
            done = futures.wait(running, return_when=futures.FIRST_COMPLETED).done
            outcomes = {future: outcome(future) for future in done}
            for future in [future for future, result in outcomes.items() if result is not LOST]:
                yield running.pop(future)[0], outcomes[future]
            if any(result is LOST for result in outcomes.values()):
                # A process has died, and nobody knows over which of the tasks.
                self._end()
                lost, running = [*running.values()], {}
                for task, tries in lost:
                    if tries == TRIES_BESIDE_OTHERS:
                        alone.append(task)
                    else:
                        running[self._submit(function, task)] = task, tries + 1
        for task in alone:
            yield task, outcome(self._submit(function, task))
            self._end()

    def _submit(self, function: Callable[[Task], Result], task: Task) -> Future[Any]:
        """The future of a task. The executor starts with its first task."""
        if self._is_here:
            return done_now(function, task)
        if self._executor is None:
            client = self._client
            self._executor = client.get_executor(pure=False) if client else Processes(self._jobs)
        return self._executor.submit(with_digest, function, task)

    def _end(self) -> None:
        """End the workers, even in the middle of a task."""
        if self._executor:
            self._executor.shutdown(wait=False)
        self._executor = None


class Processes(futures.ProcessPoolExecutor):
    """Processes of this machine, which end when this executor is shut down, and with this process,
    however it ends."""

    def __init__(self, workers: int) -> None:
        # A fork starts in a millisecond, with everything loaded. It is safe on Linux alone, and if
        # no thread may hold a lock.
        is_safe = sys.platform == "linux" and threading.active_count() == 1
        context = multiprocessing.get_context("fork" if is_safe else "spawn")
        super().__init__(workers, context, begin)

    def submit(self, *task: Any, **keywords: Any) -> Any:
        """Submit a task, for which a process may be started."""
        before = os.environ.get("PYTHONSAFEPATH")
        # A Python that starts must not import modules from the current folder.
        os.environ["PYTHONSAFEPATH"] = before or "1"
        try:
            return super().submit(*task, **keywords)
        finally:
            if before is None:
                del os.environ["PYTHONSAFEPATH"]

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes."""
        # Python has a public method for this from 3.14 on.
        for process in [*(self._processes or {}).values()]:
            process.kill()
        # A process that is killed while it writes a result leaves a part of it. The thread that
        # reads results would wait for the rest, unless no process can write any more.
        results: Any = self._result_queue
        if results is not None:
            results._writer.close()
        super().shutdown(cancel_futures=True)


def begin() -> None:
    """Prepare a worker: it ends when its parent has ended, however that ended. It leaves signals,
    which a terminal sends to all processes, and the standard output to its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.dup2(2, 1)
    parent = multiprocessing.parent_process()

    def end_with_parent() -> None:
        connection.wait([parent.sentinel] if parent else [])
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


def connected(address: str) -> Any:
    """A client of a dask scheduler, by dask's own configuration. Raises BatchError if there is
    none."""
    import distributed

    # dask logs tracebacks of errors that become one line here.
    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)
    connect: Callable[..., Any] = distributed.Client
    try:
        return connect(address, timeout=10, set_as_default=False)
    except Exception as error:  # what answers there may be any program
        # A client that has never connected would wait 20 s for its own end, and complain.
        setattr(connect, "__del__", lambda client: None)  # noqa: B010
        reason = f"no dask scheduler answers at {address}: {first_line(error)}"
        raise BatchError(reason) from None


def with_digest(function: Callable[[Task], Result], task: Task) -> tuple[str, Result]:
    """The digest of the code of the process that computes, and a function's result for a task."""
    try:
        own_digest, result = process_digest(), function(task)
        check_unedited()
        return own_digest, result
    except SystemExit as error:  # of a model that is not hodo's
        raise HodoError(f"its model calls exit({error})") from error
    except OSError as error:
        raise BatchError(f"the operating system refuses it: {error}") from error


def done_now(function: Callable[[Task], Result], task: Task) -> Future[Any]:
    """A future with the outcome of a task that this process computes now."""
    future: Future[Any] = Future()
    try:
        future.set_result(with_digest(function, task))
    except Exception as error:
        future.set_exception(error)
    return future


def outcome(future: Future[Any]) -> Any:
    """The result of a task, or its exception. Raises exceptions for which no task is to blame."""
    try:
        digest_there, result = future.result()
    except NOT_OF_A_CASE:
        raise
    except futures.BrokenExecutor:
        return LOST
    except Exception as error:
        if type(error).__name__ == "KilledWorker":  # dask has tried several workers
            return HodoError(str(LOST))
        if type(error).__module__.startswith(("distributed", "concurrent")):
            raise BatchError(f"the dask scheduler has failed: {first_line(error)}") from None
        return error
    if digest_there != process_digest():
        raise BatchError(OTHER_CODE)
    return result


# Digests

PACKAGE = Path(__file__).parent

CASE_SOURCES = ("models", "engines", "integration", "arithmetic.py", "schema/expression.py")
"""The sources that determine the numbers of a single case, and the meaning of its formulas."""

SWEEP_SOURCES = (*CASE_SOURCES, "sweeps", "cases/sweep_block.py")
"""The sources that determine the numbers of a sweep: the members' motions, and how members are made
and reduced."""


@cache
def sources(parts: tuple[str, ...]) -> list[Path]:
    """The files of parts of the package; a part is a module, or a folder of modules."""
    files = [file for part in parts for file in [PACKAGE / part, *(PACKAGE / part).rglob("*.py")]]
    return sorted(file for file in files if file.suffix == ".py")


def check_unedited() -> None:
    """Raise BatchError if a source of the code that computes has changed since this process began:
    the loaded code may then differ from its digest."""
    # A copy keeps the time of its content, but not ctime. Another clock sets a time in the future.
    changed = max(file.stat().st_ctime for file in sources(SWEEP_SOURCES))
    if STARTED < changed <= time.time():
        raise BatchError(EDITED)


@cache
def code_digest(parts: tuple[str, ...], model: str = "") -> str:
    """The digest of these parts of the package and, for a `model` of the user's own, of its
    code."""
    lines = [
        f"{file.relative_to(PACKAGE).as_posix()} {digest(file.read_text('utf-8'))}"
        for file in sources(parts)
    ]
    return digest("\n".join(lines) + (models.added_models_digest(model) if model else ""))


@cache
def library_digest() -> str:
    """The digest of the versions of the libraries whose arithmetic affects results."""
    versions = [library_version(name) for name in ("heyoka", "numpy", "scipy")]
    # `auto` takes other methods where heyoka is hidden or its wheel does not load.
    return digest(f"{versions} {have_taylor()}")


@cache
def process_digest() -> str:
    """The digest of the code, the libraries and the added models of this process, at its first
    task."""
    return f"{code_digest(SWEEP_SOURCES)}-{library_digest()}-{models.added_models_digest()}"


def digest(text: str) -> str:
    """A hash, short enough to be read and long enough that no two texts share it by chance."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


BYTES_PER_NUMBER = 75
"""The peak of memory for each number of each sample (state and stored variables), rounded up from
measurements of every model: 10 to 30 for integration, 67 for classification."""


def lack_of_memory(case: Case, jobs: int = 1) -> str:
    """Why the samples of a case do not fit into the memory of one of `jobs` processes; an empty
    string if they do."""
    if case.sweep and "trajectory" not in case.store:
        return ""  # reduced members are computed and written chunk by chunk
    system, have = case.system, memory_size() // jobs
    model = system.equations
    numbers = len(model.state) + sum(variable.width for variable in model.variables.values())
    if (needed := case.time.samples * numbers * BYTES_PER_NUMBER) <= have:
        return ""
    share = f" for each of {jobs} processes" if jobs > 1 else ""
    return (
        f"{case.time.samples:,} samples would take about {in_bytes(needed)} of memory, and there "
        f"are {in_bytes(have)}{share}"
    )


def check_memory(case: Case) -> None:
    """Raise HodoError if the samples of a case do not fit into memory: a process that takes too
    much is killed without a message."""
    if message := lack_of_memory(case):
        raise HodoError(f"{case.name}: {message}")
