"""What is finished: the cases of a result, and those of runs that have not ended, in the shards of
their staging folders. A Batch shows both as one result."""

import os
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from .. import HodoError
from ..machine import memory_limit
from ..text import few
from .hdf5 import ResultFile, open_run
from .staging import chunks_in, identity, shards, staging_folders

RESUME_ATTRIBUTES = ("hash", "status", "message", "case")
"""The attributes that tell whether a stored case is still right."""


@dataclass(frozen=True)
class FinishedCase:
    """A finished case: its name, the file that holds it, the attributes that tell whether it is
    still right, and what is wrong with what is stored of it."""

    name: str
    file: Path
    attributes: Mapping[str, Any]
    damage: str = ""


def finished_cases(
    path: Path | str,
    check: Callable[[ResultFile], None] = lambda run: None,
    more: Collection[str] = (),
) -> dict[str, list[FinishedCase]]:
    """The finished cases of a result, and of runs that have not ended, by name; those of the result
    itself first. They have `more` attributes as they are stored.

    Raises HodoError if the result exists but cannot be read, as `open_run` does, or if `check`
    refuses it.
    """
    path = Path(path)
    cases: dict[str, list[FinishedCase]] = {}
    if os.path.lexists(path):
        with open_run(path) as run:
            check(run)
            _collect(run, cases, more)
    for shard in (shard for folder in staging_folders(path) for shard in shards(folder)):
        # Gone by now, or torn by a loss of power: then the case is run anew.
        with suppress(HodoError), open_run(shard) as run:
            if not run.damaged:
                _collect(run, cases, more)
    return cases


class Batch(ResultFile):
    """A result together with the cases that runs have finished which have not ended; made by
    `open_batch`. `result` is None where there are no others."""

    def __init__(self, path: Path, result: ResultFile | None, unpublished: "Unpublished") -> None:
        self.path = path
        self.damaged = result.damaged if result else {}
        self.attributes, self._newer = unpublished.attributes, unpublished.cases
        self._result = result
        self._bytes_left = memory_limit()
        published = result.groups if result else ()
        self.groups = in_order(dict.fromkeys([*published, *self._newer]), unpublished.order)

    @contextmanager
    def open_group(self, name: str) -> Iterator[Any]:
        if self._result and name not in self._newer:
            with self._result.open_group(name) as group:
                yield group
        else:
            # One at a time: a batch may have more cases than a process may open files. The run may
            # have ended since, and then its result has the case.
            case = self._newer.get(name)
            file = case.file if case and case.file.exists() else self.path
            with open_run(file) as run, run.open_group(name) as group:
                yield group


@contextmanager
def open_batch(path: Path | str) -> Iterator[ResultFile]:
    """A result, open for reading, with the cases of runs that have not ended: those that it lacks,
    or holds from before a change. A warning names them.

    Raises HodoError as `open_run` does, if there is no such case either.
    """
    path = Path(path)
    if not (newer := unpublished(path)).cases:
        if not os.path.lexists(path) and any(map(chunks_in, staging_folders(path))):
            message = "a run has finished parts of a sweep, which the same command completes"
            raise HodoError(f"{path}: no case is there yet: {message}")
        with open_run(path) as run:
            yield run
        return
    with ExitStack() as stack:
        result = stack.enter_context(open_run(path)) if os.path.lexists(path) else None
        batch = Batch(path, result, newer)
        names = [name for name in batch.cases() if name in newer.cases]
        message = f"{path}: {len(names)} finished in a run that has not ended: {few(names)}"
        warnings.warn(message, stacklevel=3)
        yield batch


class Unpublished(NamedTuple):
    """The cases of runs that have not ended, by name: those that the result lacks, or holds from
    before a change; and the attributes and the order of the cases that the result of the latest of
    these runs will have."""

    cases: dict[str, FinishedCase]
    attributes: dict[str, Any]
    order: list[str]


def unpublished(path: Path) -> Unpublished:
    """What runs that have not ended have finished of a result."""
    while cases := _newer_cases(path):
        head = _head(max((case.file for case in cases.values()), key=_changed))
        try:
            with open_run(head) as run:
                order = str(run.attributes.pop(ORDER_ATTRIBUTE, "")).splitlines()
                return Unpublished(cases, run.attributes, order)
        except HodoError:
            if head.exists():
                raise
            # The run has ended meanwhile, and the result has its cases.
    return Unpublished({}, {}, [])


def _newer_cases(path: Path) -> dict[str, FinishedCase]:
    cases: dict[str, FinishedCase] = {}
    if not any(map(shards, staging_folders(path))):
        return cases
    for name, items in finished_cases(path).items():
        stored = items[0] if items[0].file == path else None
        others = [item for item in items if item is not stored and _head(item.file).exists()]
        if others:
            newest = max(others, key=lambda item: _changed(item.file))
            if stored is None or _replaces(newest, stored):
                cases[name] = newest
    return cases


def _head(shard: Path) -> Path:
    """The file of the attributes of the result that a shard will be part of."""
    return shard.with_name(ATTRIBUTES_FILE)


def _changed(file: Path) -> int:
    """When a file was last changed, in nanoseconds; 0 if it is gone."""
    return (identity(file) or (0, 0))[1]


def _replaces(newer: FinishedCase, stored: FinishedCase) -> bool:
    """Whether a case is another one than is stored, and not one that has failed instead."""
    new, old = newer.attributes, stored.attributes
    is_worse = new.get("status") != "ok" and old.get("status") == "ok"
    return new.get("hash") != old.get("hash") and not is_worse


ATTRIBUTES_FILE = "head.h5"
"""The file of a staging folder that holds the attributes of the result to be. Its text is the whole
case file: in each of 10,000 shards it would be some 10 GB."""

ORDER_ATTRIBUTE = "order"
"""The attribute there that names the cases of the result in their order, a line each."""


def in_order(names: Mapping[str, Any], order: Iterable[str]) -> dict[str, None]:
    """Names of cases in an order that has more or fewer, then the others."""
    return dict.fromkeys([*(name for name in order if name in names), *names])


def _collect(run: ResultFile, cases: dict[str, list[FinishedCase]], more: Collection[str]) -> None:
    wanted = dict.fromkeys((*RESUME_ATTRIBUTES, *more))
    for name in run.cases():
        damage = run.damaged.get(name, "")
        stored = {} if damage else run.summary(name, wanted)
        attributes = stored | {key: str(stored[key]) for key in RESUME_ATTRIBUTES if key in stored}
        cases.setdefault(name, []).append(FinishedCase(name, run.path, attributes, damage))


def resume_attributes(run: ResultFile, name: str) -> dict[str, str]:
    """The attributes of a case that tell whether it is still right."""
    return {key: str(value) for key, value in run.summary(name, RESUME_ATTRIBUTES).items()}
