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

__version__ = "0.2.0"

STARTED = time.time()
"""When this process began to load hodo: a source that changes afterwards may be loaded or not."""


class HodoError(Exception):
    """A mistake that the user can mend; shown as one line, without a traceback. Exit status 2.

    Where cases, figures or statements are gone through, it belongs to one of them."""


class BatchError(Exception):
    """Nothing can be computed, read or written any more: the command ends, and no case is to blame;
    shown as one line. Exit status 2."""


NOT_OF_A_CASE = (BatchError, OSError, ModuleNotFoundError)
"""What no case, figure or task is to blame for. Who catches every exception lets these pass."""


LATE = ("Case", "derive", "open", "plot", "run", "sweep")
"""The names of the Python API, whose libraries load when the first of them is used."""


def __getattr__(name: str) -> Any:
    if name in LATE:
        return getattr(import_module(".api", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    # What a notebook completes: not what this module happens to import.
    return __all__
