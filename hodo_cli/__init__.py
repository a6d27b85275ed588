"""hodo: batches of rigid-body rotation experiments, integrated, classified, plotted and checked."""

import time
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import Case, derive, open, plot, run, sweep

__all__ = [
    "BatchError",
    "Case",
    "HodoError",
    "__version__",
    "derive",
    "open",
    "plot",
    "run",
    "sweep",
]

__version__ = "0.3.0"

STARTED = time.time()
"""When this process began to load hodo. A source that changes later may be loaded or not."""


class HodoError(Exception):
    """A mistake that the user can mend; shown as one line, without a traceback. Exit status 2.

    In a loop over cases, figures or statements it concerns one of them.
    """


class BatchError(Exception):
    """Nothing more can be computed, read or written: the command ends, and no case is to blame;
    shown as one line. Exit status 2."""


NOT_OF_A_CASE = (BatchError, OSError, ImportError)
"""Exceptions for which no case, figure or task is to blame. Code that catches every other exception
lets these pass. A signal that meets a library while it loads becomes an ImportError."""


LATE = ("Case", "derive", "open", "plot", "run", "sweep")
"""The names of the Python API, whose libraries load when the first of them is used."""


def __getattr__(name: str) -> Any:
    if name in LATE:
        return getattr(import_module(".api", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    # The names that a notebook completes, without those that this module happens to import.
    return __all__
