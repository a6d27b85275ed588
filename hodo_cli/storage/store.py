"""How a result is made, so that a kill costs half a second of work at most.

Until the run ends, finished work lies in a hidden folder next to the result as *parts*: complete
files that get their names in one step. A part holds cases, or a chunk of a sweep. Each states what
it is made of (the hash of a case or sweep), so that it does not matter which process wrote it, or
whether that process lives. `publish` puts the cases into the result: it composes a new file from
the present result and the parts, and gives it the result's name.

Both happen under a lock, one for each folder of results, so that any number of processes may work
on one result: a part is written before or after another process publishes, never meanwhile.
"""

import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Any

import h5py

from .. import BatchError, HodoError
from .hdf5 import (
    BOOKKEEPING,
    Attribute,
    Group,
    ResultFile,
    amend_group,
    attributes_of,
    copy_group,
    create,
    drafted,
    is_marked,
    open_run,
    refused_as,
    room_for,
    save_groups,
    write_group,
)

HAVE_FLOCK = find_spec("fcntl") is not None
"""Whether the system locks files as here; Windows has other locks."""

if HAVE_FLOCK:
    import fcntl

HEAD, ORDER = "head.h5", "order"
"""The file among the parts with the root attributes of the future result, and its attribute with
the names of the cases in their order. It holds the whole case file, which in each of 10,000 parts
would take some 10 GB."""


@dataclass(frozen=True)
class FinishedCase:
    """A finished case: its name, the file that holds it, and its attributes."""

    name: str
    file: Path
    attributes: Mapping[str, Any]


def folder_of(path: Path) -> Path:
    """The folder of a result's parts."""
    path = Path(os.path.realpath(path))
    return path.with_name(f".{path.name}.parts")


def parts_of(path: Path, pattern: str = "cases-*.h5") -> list[Path]:
    """The parts of a result, oldest first, without damaged parts and parts that another process has
    just put into the result."""
    with refused_as(path):
        return [part for part in sorted(folder_of(path).glob(pattern)) if is_sound(part)]


def is_sound(file: Path) -> bool:
    """Whether a file exists and is whole."""
    with suppress(OSError, HodoError):
        return is_marked(file)
    return False


def chunks_of(path: Path, sweep: str) -> dict[int, Path]:
    """The finished chunks of the sweep with this hash, by their numbers."""
    chunks = parts_of(path, f"chunk-{sweep}-*.h5")
    return {int(chunk.stem.rpartition("-")[2]): chunk for chunk in chunks}


def chunk_name(sweep: str, number: int) -> str:
    """The file name of a finished chunk of the sweep with this hash."""
    return f"chunk-{sweep}-{number}.h5"


def part_name() -> str:
    """A name for a new part with finished cases, which sorts after the names of earlier parts."""
    return f"cases-{time.time_ns():020}-{os.getpid()}.h5"


def put_part(
    path: Path, name: str, groups: Mapping[str, Group], attributes: Mapping[str, Attribute] = {}
) -> None:
    """Store finished groups of a result as one part, which survives the death of this process.
    Raises BatchError if the operating system refuses it."""
    with locked(path) as folder, drafted(folder / name, folder) as draft:
        save_groups(draft, groups, attributes)


@contextmanager
def locked(path: Path) -> Iterator[Path]:
    """Hold a lock during which no other process writes a part of a result, or the result; it ends
    with the process. Yields the folder of the parts, which is removed if it is empty at the end.
    Raises BatchError if the operating system refuses it."""
    folder = folder_of(path)
    with refused_as(path, folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        with lock_of(folder.parent):
            # As private as the result may be.
            folder.mkdir(mode=0o700, exist_ok=True)
            for draft in folder.glob("*.draft"):  # of processes that have died
                draft.unlink()
            try:
                yield folder
            finally:
                with suppress(OSError):
                    folder.rmdir()


@contextmanager
def lock_of(folder: Path) -> Iterator[None]:
    """The lock of a folder. On a file system without locks the last writer wins."""
    if not HAVE_FLOCK:
        import filelock

        with filelock.FileLock(folder / ".hodo.lock"):
            yield
        return
    # The folder itself is locked: a lock file would have to stay, because a removed file may be
    # locked twice.
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def finished_cases(path: Path, only: Collection[str] = ()) -> dict[str, list[FinishedCase]]:
    """The finished cases of a result and of its parts by name, the latest of each name first, with
    all attributes or those in `only`. Raises HodoError as `open_run` does if the result exists and
    cannot be read."""
    cases: dict[str, list[FinishedCase]] = {}

    def collect(file: Path) -> None:
        with open_run(file) as run:
            for name in run.cases():
                cases.setdefault(name, []).append(FinishedCase(name, file, run.summary(name, only)))

    for part in parts_of(path)[::-1]:
        with suppress(HodoError):  # another process has just put it into the result
            collect(part)
    if os.path.lexists(path):
        collect(path)
    return cases


@dataclass
class Update:
    """Changes to a result, collected within `update`. `seen` holds the hash that each case had."""

    run: ResultFile
    additions: dict[str, Group] = field(default_factory=dict)
    seen: dict[str, Any] = field(default_factory=dict)

    def write(self, name: str, addition: Group) -> None:
        """Add attributes and variables to a case, or replace them; a group that begins with `_` is
        replaced as a whole."""
        self.additions[name] = addition

    def apply(self, file: h5py.File) -> None:
        """Change the cases whose hash is still the one in `seen`. A group that begins with `_`
        (verdicts) is written only if the cases are the same and none has changed."""
        cases = {name: group for name, group in file.items() if not name.startswith("_")}
        now = {name: attributes_of(x, ("hash",)).get("hash") for name, x in cases.items()}
        for name, addition in self.additions.items():
            if name.startswith("_") and now == self.seen:
                write_group(file, name, addition)
            elif name in now and now[name] == self.seen[name]:
                amend_group(file[name], addition)


def publish(
    path: Path,
    attributes: Mapping[str, Attribute] | None = None,
    groups: Mapping[str, Group] = {},
    chosen: Mapping[str, Path] = {},
    dropped: Collection[str] = (),
    order: Sequence[str] = (),
    changes: Update | None = None,
    line: str = "",
    others: Sequence[Path] = (),
) -> None:
    """Put the parts of a result into it, with new `groups`, a `line` of history, and `changes`, and
    replace the result in one step.

    If several files hold a case, the latest counts, or the one in its `chosen` file. Root
    attributes that are not given come from the run that has begun the parts, or from the result.
    The groups of `others`, which are results themselves, are added. Raises BatchError if the
    operating system refuses it, and HodoError if the result is damaged.
    """
    check_writable(path)
    with locked(path) as folder:
        parts, present, head = parts_of(path), root_of(path), root_of(folder / HEAD)
        order = order or str(head.pop(ORDER, "")).splitlines()
        root = {**(attributes or head or present)}
        lines = [*history_of(present), *history_of(root), *filter(None, [line])]
        root["history"] = "\n".join(dict.fromkeys(lines))
        sources = sources_of(path, [*others, *parts], chosen) | dict.fromkeys(groups, None)
        names = [x for x in dict.fromkeys([*order, *sources]) if x in sources and x not in dropped]
        additions = changes.additions if changes else {}
        added = [Group(root, {}), *groups.values(), *additions.values()]
        room = sum(file.stat().st_size for file in {*sources.values()} if file)
        with (
            drafted(path, folder) as draft,
            create(draft, root, room + sum(map(room_for, added))) as file,
        ):
            for source, of_source in groupby(names, sources.__getitem__):
                if source:
                    copy_groups(source, of_source, file)
                else:
                    for name in of_source:
                        write_group(file, name, groups[name])
            if changes:
                changes.apply(file)
        for part in parts:
            part.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """Raise BatchError if a file is marked as read-only, which replacing it would ignore."""
    if path.exists() and not path.stat().st_mode & 0o222:
        raise BatchError(f"{path} is read-only (mode {path.stat().st_mode & 0o777:o}): chmod u+w")


def root_of(file: Path) -> dict[str, Any]:
    """The root attributes of a file; none if it does not exist."""
    if not os.path.lexists(file):
        return {}
    with open_run(file) as run:
        return run.attributes


def history_of(root: Mapping[str, Attribute]) -> list[str]:
    """The lines of a history."""
    return str(root.get("history", "")).splitlines()


def sources_of(path: Path, parts: Sequence[Path], chosen: Mapping[str, Path]) -> dict[str, Any]:
    """The file, a result or one of its parts, from which each group is taken: the latest that holds
    it, or its `chosen` file."""
    sources: dict[str, Path] = {}
    for file in [*([path] if os.path.lexists(path) else []), *parts]:
        with open_run(file) as run:
            # A later file replaces an earlier one, unless another file is chosen.
            is_chosen = (x for x in run.groups if x not in sources or chosen.get(x, file) == file)
            sources |= dict.fromkeys(is_chosen, file)
    return sources


def copy_groups(source: Path, names: Iterable[str], file: h5py.File) -> None:
    """Copy groups of a file. If another program has changed the file, the attributes that count
    only in a file of hodo's own are left out."""
    with open_run(source) as run:
        for name in names:
            with run.open_group(name) as group:
                copy_group(group, file, name)
            for key in () if run.intact else BOOKKEEPING:
                file[name].attrs.pop(key, None)


def tidy(path: Path, is_needless: Callable[[str], bool] = lambda sweep: False) -> None:
    """Remove the chunks of sweeps whose hash `is_needless` and, if nothing is left there, the
    folder of the parts."""
    if not folder_of(path).exists():
        return
    with locked(path) as folder:
        for chunk in folder.glob("chunk-*"):
            if is_needless(chunk.stem.removeprefix("chunk-").rpartition("-")[0]):
                chunk.unlink()
        if not any(folder.glob("c*")):  # neither cases nor chunks
            (folder / HEAD).unlink(missing_ok=True)


@contextmanager
def open_batch(path: Path | str) -> Iterator[ResultFile]:
    """A result, open for reading, with the cases that killed or running runs of it have finished.
    Raises as `open_run` and `publish` do."""
    path = Path(path)
    if parts_of(path):
        publish(path)
        tidy(path)
    with open_run(path) as run:
        yield run


@contextmanager
def update(path: Path | str, line: str = "") -> Iterator[Update]:
    """Collect changes to a result. When the block ends, the result is replaced, with a line of
    history, if there are changes; a case that another process has changed meanwhile stays as that
    process left it. Raises as `open_run` and `publish` do."""
    path = Path(path)
    with open_batch(path) as run:
        yield (changes := Update(run))
        if changes.additions:
            changes.seen = {x: run.summary(x, ("hash",)).get("hash") for x in run.cases()}
    if changes.additions:
        publish(path, changes=changes, line=line)
