"""Changes to a result file that is there."""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .hdf5 import Group, Run, amend, create, open_run
from .staging import Staging, check_writable, refusals
from .writer import KEPT, longer, parts_in, pieces, publish_finished, resume_attributes


class Update:
    """Changes to a result; made by `update`."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.parts: dict[str, Group] = {}

    def write(self, name: str, part: Group, old: Group | None = None) -> None:
        """Add attributes and variables to a case, or replace them; a group that begins with `_` is
        made anew. `old` is what the result holds of it, if that was read already."""
        if old is None and name in self.run and name not in self.run.damaged:
            old = self.run.read(name)
        if old is None or not _holds(old, part, whole=name.startswith("_")):
            self.parts[name] = part


@contextmanager
def update(path: Path | str, history: str = "") -> Iterator[Update]:
    """Change a result; cases of runs that have not ended are added to it first, see
    `publish_finished`. It is replaced at the end, or left alone if the changes change nothing.

    If another process has replaced it meanwhile, the changes apply to the cases that are still the
    same. Raises HodoError as `open_run` does, or if the result cannot be written.
    """
    path = Path(path)
    publish_finished(path)
    with open_run(path) as run:
        changes = Update(run)
        yield changes
        with refusals(path, KEPT), ExitStack() as stack:
            staging = Staging(path)
            stack.callback(staging.close)
            # Those with finished cases wait for the next run, which takes them over.
            for folder in staging.take_orphans():
                if not pieces(folder) and not parts_in(folder):
                    shutil.rmtree(folder, ignore_errors=True)
            if changes.parts:
                check_writable(path)
                stack.callback(staging.remove)
                # Opened again under the lock: another process may have replaced the result since.
                with staging.publishing(), open_run(path) as now:
                    _rewrite(staging / "whole.h5", now, changes, history)
                    staging.publish(staging / "whole.h5")


def _rewrite(whole: Path, now: Run, changes: Update, history: str) -> None:
    """Write a result with changes that were made to it, or to a file that had its name before."""

    # Bytes of a case that cannot be read are kept: they may be all that is left of it.
    is_amended = any(name in now.damaged for name in now.cases())

    def is_the_same(name: str) -> bool:
        return name in now and resume_attributes(now, name) == resume_attributes(changes.run, name)

    def applies(name: str) -> bool:
        if not name.startswith("_"):
            return is_the_same(name)
        # HDF5 removes no group that it cannot read: these wait for a file without damaged cases.
        if is_amended and name in now.damaged:
            return False
        # Verdicts are about all cases: none of them may have been run anew meanwhile.
        return now.cases() == changes.run.cases() and all(
            is_the_same(case) for case in now.cases() if case not in now.damaged
        )

    parts = {name: part for name, part in changes.parts.items() if applies(name)}
    attributes = {**now.attributes, "history": longer(now, history)}
    with amend(whole, now, attributes) if is_amended else create(whole, attributes) as output:
        for name in dict.fromkeys([*now.groups(), *parts]):
            if name not in parts:
                # Damaged verdicts are left out: `hodo claims` gives them again.
                if not is_amended and name not in now.damaged:
                    output.copy(now, name)
            elif name.startswith("_"):
                output.write(name, parts[name])
            else:
                old, part = now.read(name), parts[name]
                output.write(
                    name,
                    Group(
                        {**old.attributes, **part.attributes}, {**old.variables, **part.variables}
                    ),
                )


def _holds(old: Group, part: Group, whole: bool) -> bool:
    """Whether a group has what a part says already and, if `whole`, nothing else."""
    if whole and (
        set(old.attributes) != set(part.attributes) or set(old.variables) != set(part.variables)
    ):
        return False
    return _same(old.attributes, part.attributes) and all(
        name in old.variables
        and old.variables[name].dims == new.dims
        and _equal(old.variables[name].data, new.data)
        and _same(old.variables[name].attrs, new.attrs)
        for name, new in part.variables.items()
    )


def _same(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    return all(name in old and _equal(old[name], value) for name, value in new.items())


def _equal(a: Any, b: Any) -> bool:
    a, b = np.asarray(a), np.asarray(b)
    # equal_nan by type, because numpy refuses to look for nan among texts.
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))
