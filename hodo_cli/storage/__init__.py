"""Files of labelled arrays: how they are written, checked, resumed, changed and read, so that no
kill and no damage loses anything. The only importer of h5py; knows no mechanics.

Before a result has its name, there are files of four kinds beside it:

- a *staging folder*, hidden and locked, holds what one process makes;
- a *draft* in it is a file that is being written, and takes its name when it is complete;
- a *shard* is a complete file with finished cases, of which the result is joined;
- a *chunk* is a complete file with finished members of a sweep.

A *checksum* is the hash of what is stored: of a file's bytes, of a group, of a variable's values. A
*digest* is the hash of what a result depends on; this folder stores and compares it only.
"""

from .finished_cases import FinishedCase, finished_cases, open_batch
from .group import Attribute, Group, Report, StreamedVariables, Variable, dimension_sizes
from .hdf5 import ResultFile, open_run
from .output import create
from .provenance import CONTENT, history_line, result_of, root_attributes, typed
from .staging import check_writable, chunks_in, replacing, staging_folders
from .writer import Update, Writer, compose, holds, update

__all__ = [
    "CONTENT",
    "Attribute",
    "FinishedCase",
    "Group",
    "Report",
    "ResultFile",
    "StreamedVariables",
    "Update",
    "Variable",
    "Writer",
    "check_writable",
    "chunks_in",
    "compose",
    "create",
    "dimension_sizes",
    "finished_cases",
    "history_line",
    "holds",
    "open_batch",
    "open_run",
    "replacing",
    "result_of",
    "root_attributes",
    "staging_folders",
    "typed",
    "update",
]
