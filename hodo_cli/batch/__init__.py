"""Tasks in processes or on dask: the pool, the digest of the code that computes, and the
memory and disk that tasks may take. Imports cases and what lies below; knows no result file."""


class WorkerLost(Exception):
    """The process that did a task has died."""
