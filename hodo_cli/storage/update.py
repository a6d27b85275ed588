"""Changes to a result file that is there."""

import shutil
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .finished_cases import chunks_in, resume_attributes, shards
from .group import Attribute, Group
from .hdf5 import ResultFile, open_run
from .output import Output, amend, create
from .staging import Staging, check_writable, identity, os_errors_as, publish
from .writer import KEPT, longer, publish_finished


class Draft:
    """The new file of a result, written group by group while the changes are made, so that no case
    has to be read twice."""

    def __init__(
        self, run: ResultFile, staging: Staging, attributes: Mapping[str, Attribute]
    ) -> None:
        self._run = run
        self._staging = staging
        self._attributes = attributes
        self._names = deque(run.groups())
        self._opened = ExitStack()
        self._output: Output | None = None

    def write(self, name: str, group: Group) -> None:
        """Write a group as it is now, after those that stand before it in the result.

        Raises BatchError if it cannot be written.
        """
        with os_errors_as(self._run.path, KEPT):
            if self._output is None:
                check_writable(self._run.path)
                new = create(self._staging / "whole.h5", self._attributes)
                self._output = self._opened.enter_context(new)
            self._copy_up_to(name)
            self._output.write(name, group)

    def completed(self) -> Path:
        """The new file with all groups, in which at least one has been written."""
        self._copy_up_to("")
        self._opened.close()
        return self._staging / "whole.h5"

    def _copy_up_to(self, name: str) -> None:
        assert self._output is not None
        while self._names and (earlier := self._names.popleft()) != name:
            self._output.copy(self._run, earlier)

    def close(self) -> None:
        """Give up what is not finished."""
        with suppress(OSError):  # of a disk that is full, as has been said
            self._opened.close()


class Update:
    """Changes to a result; made by `update`."""

    def __init__(self, run: ResultFile, draft: Draft | None) -> None:
        self.run = run
        self.additions: dict[str, Group] = {}
        self._draft = draft

    def write(self, name: str, addition: Group, old: Group | None = None) -> None:
        """Add attributes and variables to a case, or replace them; a group that begins with `_` is
        made anew. `old` is what the result holds of it, if that was read already.

        Raises BatchError if it cannot be written.
        """
        if not self.run.intact:  # its reports are not believed, so that they are no change
            addition = replace(addition, report=None)
        if old is None and name in self.run and name not in self.run.damaged:
            old = self.run.read(name)
        if old is None or not holds(old, addition, is_complete=name.startswith("_")):
            if self._draft:
                self._draft.write(name, _changed(name, old, addition))
            self.additions[name] = addition


@contextmanager
def update(path: Path | str, history: str = "") -> Iterator[Update]:
    """Change a result; cases of runs that have not ended are added to it first, see
    `publish_finished`. It is replaced at the end, or left alone if the changes change nothing.

    If another process has replaced it meanwhile, the changes apply to the cases that are still the
    same. Raises HodoError as `open_run` does, and BatchError if the result cannot be written.
    """
    path = Path(path)
    publish_finished(path)
    identity_read = identity(path)
    with open_run(path) as run, ExitStack() as stack:
        staging = Staging(path)
        stack.callback(staging.close)
        stack.callback(staging.remove)
        # HDF5 cannot copy what is damaged.
        draft = None if run.damaged else Draft(run, staging, _with_history(run, history))
        if draft:
            stack.callback(draft.close)
        changes = Update(run, draft)
        yield changes
        with os_errors_as(path, KEPT):
            # Those with finished cases wait for the next run, which takes them over.
            for folder in staging.take_over_dead():
                if not shards(folder) and not chunks_in(folder):
                    shutil.rmtree(folder, ignore_errors=True)
            if changes.additions:
                check_writable(path)
                file = draft.completed() if draft else staging / "whole.h5"
                with staging.publishing():
                    if draft is None or identity(path) != identity_read:
                        # Opened again: another process has replaced the result since.
                        with open_run(path) as latest_result:
                            _rewrite(file, latest_result, changes, history)
                    publish(file, staging.path)


def _with_history(run: ResultFile, history: str) -> dict[str, Attribute]:
    """The attributes of a result with a line more of history."""
    return {**run.attributes, "history": longer(run, history)}


def _changed(name: str, old: Group | None, addition: Group) -> Group:
    """A group with its change."""
    return addition if old is None or name.startswith("_") else old.with_addition(addition)


def _rewrite(file: Path, result: ResultFile, changes: Update, history: str) -> None:
    """Write a result with changes that were made to it, or to a file that had its name before."""

    # Bytes of a case that cannot be read are kept: they may be all that is left of it.
    is_amended = any(name in result.damaged for name in result.cases())

    def is_the_same(name: str) -> bool:
        return name in result and resume_attributes(result, name) == resume_attributes(
            changes.run, name
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
    attributes = _with_history(result, history)
    with amend(file, result, attributes) if is_amended else create(file, attributes) as output:
        for name in dict.fromkeys([*result.groups(), *additions]):
            if name not in additions:
                # Damaged verdicts are left out: `hodo claims` gives them again.
                if not is_amended and name not in result.damaged:
                    output.copy(result, name)
            else:
                old = None if name.startswith("_") else result.read(name)
                output.write(name, _changed(name, old, additions[name]))


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
