"""hodo: batches of rigid-body rotation experiments, integrated, classified, plotted and checked."""

__version__ = "0.2.0.dev0"


class HodoError(Exception):
    """A mistake that the user can mend; shown as one line, without a traceback. Exit status 2."""


class BatchError(HodoError):
    """Nothing can be computed or written any more: the batch ends, and no case is to blame."""
