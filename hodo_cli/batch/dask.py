"""Workers of a dask scheduler that do tasks, here or on other machines."""

import logging
import os
import sys
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from contextlib import ExitStack
from functools import partial
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

from .. import BatchError
from ..text import first_line
from . import WorkerLost

CONNECT_SECONDS = 10.0
"""Seconds in which a scheduler must be reached."""

MAX_WAIT_SECONDS = 60.0
"""Seconds in which a scheduler must answer, or one of this machine start its workers."""


SAFE_PATH = "PYTHONSAFEPATH"
"""The variable that keeps Python from importing what lies in the current folder."""


class Dask(Executor):
    """The workers of a dask scheduler: those at tcp://HOST:PORT or tls://HOST:PORT (with the
    certificates that dask's own configuration names), or, for "dask", so many processes of this
    machine.

    A task whose worker is lost is done again by another one. Raises BatchError if dask is not
    installed, or no scheduler answers.
    """

    def __init__(self, scheduler: str, workers: int) -> None:
        self._address = scheduler
        with ExitStack() as opened:
            try:
                import distributed

                arguments = {"address": scheduler, "timeout": CONNECT_SECONDS}
                if scheduler == "dask":
                    scratch = TemporaryDirectory(ignore_cleanup_errors=True)
                    arguments = _of_this_machine(workers, opened.enter_context(scratch))
            except ImportError:
                raise BatchError(
                    "--scheduler needs dask, which is not installed: "
                    "pip install dask distributed cryptography"
                ) from None
            # dask logs with tracebacks what ends up as one line here.
            for name in [name for name in logging.root.manager.loggerDict if "distributed" in name]:
                logging.getLogger(name).setLevel(logging.CRITICAL + 1)
            self._killed = distributed.KilledWorker
            self._client = self._connected(partial(distributed.Client, **arguments))
            self._inner = self._client.get_executor(pure=False)
            self._opened = opened.pop_all()

    def _connected(self, connect: Callable[[], Any]) -> Any:
        """A client. What answers at an address may be any program: dask raises whatever that leads
        to, or waits for ever."""
        answer: Future[Any] = Future()

        def connect_now() -> None:
            try:
                answer.set_result(connect())
            except Exception as error:
                answer.set_exception(error)

        Thread(target=connect_now, daemon=True).start()
        try:
            return answer.result(timeout=MAX_WAIT_SECONDS)
        except Exception as error:
            reason = f"no dask scheduler answers at {self._address}: {first_line(error)}"
            raise BatchError(reason) from None

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Schedule a call. Raises BatchError if the scheduler is gone."""
        try:
            of_dask = self._inner.submit(function, *args, **kwargs)
        except Exception as error:
            raise self._gone(first_line(error)) from None
        future: Future[Any] = Future()
        of_dask.add_done_callback(lambda done: self._pass_on(done, future))
        return future

    def _pass_on(self, of_dask: Future[Any], future: Future[Any]) -> None:
        """The outcome of a task; dask's own errors by what they mean for a batch."""
        try:
            future.set_result(of_dask.result())
        except CancelledError:
            future.set_exception(self._gone("it has dropped a task"))
        except self._killed:
            future.set_exception(WorkerLost())
        except Exception as error:
            is_theirs = type(error).__module__.startswith("distributed")
            future.set_exception(self._gone(first_line(error)) if is_theirs else error)

    def _gone(self, reason: str) -> BatchError:
        return BatchError(
            f"the dask scheduler at {self._address} has failed: {reason}; finished work is kept"
        )

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the scheduler; a cluster of this machine ends."""
        self._inner.shutdown(wait=wait and not cancel_futures)
        self._client.close()
        self._opened.close()


def _of_this_machine(workers: int, scratch: str) -> dict[str, Any]:
    """What makes a client start a cluster that no other user of this machine can use.

    Whoever reaches a scheduler runs code as its owner, and any user reaches a port: so there is a
    certificate that only these processes have, and no page. What is spilled to the disk is
    unpickled again, and lies in a folder that nobody else can exchange.
    """
    import dask

    if sys.flags.ignore_environment and not sys.flags.safe_path:
        raise BatchError(f"under python -E workers would ignore {SAFE_PATH}: start it with -P too")
    # For good, since a worker that has died is started again.
    os.environ.setdefault(SAFE_PATH, "1")
    dask.config.set({f"distributed.{role}.http.routes": [] for role in ("scheduler", "worker")})
    return {
        "n_workers": workers,
        "threads_per_worker": 1,
        "host": "127.0.0.1",
        "dashboard_address": None,
        "security": True,  # made anew, and kept in memory
        "local_directory": scratch,
    }
