"""Changes to a result file that is there."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .finished_cases import resume_attributes
from .group import Group
from .hdf5 import ResultFile, open_run, size_of
from .output import amend, create
from .staging import Staging, check_writable, identity, os_errors_as, publish
from .writer import KEPT, longer, publish_finished

HELD = 64 << 20
"""Bytes of cases that are held to be written once more with what is added to them: to read a short
case again takes as long as to integrate it."""


class Update:
    """Changes to a result, whose file had this identity before it was opened; made by `update`."""

    def __init__(self, run: ResultFile, file_identity: tuple[int, int] | None) -> None:
        self.run = run
        self.additions: dict[str, Group] = {}
        self.held: dict[str, Group] = {}
        self.file_identity = file_identity
        self._room = HELD

    def write(self, name: str, addition: Group, old: Group | None = None) -> None:
        """Add attributes and variables to a case, or replace them; a group that begins with `_` is
        made anew. `old` is what the result holds of it, if that was read already."""
        if not self.run.intact:  # its reports are not believed, so that they are no change
            addition = replace(addition, report=None)
        if old is None and name in self.run and name not in self.run.damaged:
            old = self.run.read(name)
        if old is None or not holds(old, addition, is_complete=name.startswith("_")):
            self.additions[name] = addition
            if old and (size := size_of(old)) < self._room:
                self._room -= size
                self.held[name] = old


@contextmanager
def update(path: Path | str, history: str = "") -> Iterator[Update]:
    """Change a result; cases of runs that have not ended are added to it first, see
    `publish_finished`. It is replaced at the end, or left alone if the changes change nothing.

    If another process has replaced it meanwhile, the changes apply to the cases that are still the
    same. Raises HodoError as `open_run` does, and BatchError if the result cannot be written.
    """
    path = Path(path)
    publish_finished(path)
    before = identity(path)
    with open_run(path) as run, Staging(path) as staging:
        changes = Update(run, before)
        yield changes
        if changes.additions:
            with os_errors_as(path, KEPT):
                check_writable(path)
                file = staging / "whole.h5"
                # Opened again: another process may have replaced the result since.
                with staging.publishing(), open_run(path) as latest_result:
                    _rewrite(file, latest_result, changes, history)
                    publish(file, staging.path)


def _rewrite(file: Path, result: ResultFile, changes: Update, history: str) -> None:
    """Write a result with changes that were made to it, or to a file that had its name before."""

    # Bytes of a case that cannot be read are kept: they may be all that is left of it.
    is_amended = any(name in result.damaged for name in result.cases())
    # Looked at when both are open: a name that passes to another file later changes neither.
    is_latest = identity(result.path) == changes.file_identity

    def is_the_same(name: str) -> bool:
        return is_latest or (
            name in result
            and resume_attributes(result, name) == resume_attributes(changes.run, name)
        )

    def applies(name: str) -> bool:
        if not name.startswith("_"):
            return is_the_same(name)
        # HDF5 removes no group that it cannot read: these wait for a file without damaged cases.
        if is_amended and name in result.damaged:
            return False
        # Verdicts are about all cases: none of them may have been run anew meanwhile.
        return result.cases() == changes.run.cases() and all(
            is_the_same(case) for case in result.cases() if case not in result.damaged
        )

    additions = {name: addition for name, addition in changes.additions.items() if applies(name)}
    attributes = {**result.attributes, "history": longer(result, history)}
    with amend(file, result, attributes) if is_amended else create(file, attributes) as output:
        for name in dict.fromkeys([*result.groups(), *additions]):
            if name not in additions:
                # Damaged verdicts are left out: `hodo claims` gives them again.
                if not is_amended and name not in result.damaged:
                    output.copy(result, name)
            else:
                held = changes.held.get(name) if is_latest else None
                old = Group({}, {}) if name.startswith("_") else held or result.read(name)
                output.write(name, old.with_addition(additions[name]))


def holds(old: Group, addition: Group, is_complete: bool = False) -> bool:
    """Whether a group has all of an addition already and, if that `is_complete`, nothing else."""
    if is_complete and (
        set(old.attributes) != set(addition.attributes)
        or set(old.variables) != set(addition.variables)
    ):
        return False
    if old.report != addition.report or not _same(old.attributes, addition.attributes):
        return False
    return all(
        name in old.variables
        and old.variables[name].dims == new.dims
        and _equal(old.variables[name].data, new.data)
        and _same(old.variables[name].attrs, new.attrs)
        for name, new in addition.variables.items()
    )


def _same(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    return all(name in old and _equal(old[name], value) for name, value in new.items())


def _equal(a: Any, b: Any) -> bool:
    a, b = np.asarray(a), np.asarray(b)
    # equal_nan by type, because numpy refuses to look for nan among texts.
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))
