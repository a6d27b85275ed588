"""Result files: how they are made of finished cases, resumed and changed, so that nothing finished
is ever lost.

A run puts finished cases into shards and joins them at the end. (A single HDF5 file that grows is
unreadable, all of it, after one in five of its writes; a kill there would cost every case.) A shard
is complete or absent; the next run takes over those of a dead one. A sweep comes in chunks, of
which its shard is made.

Short cases share a shard, because a file costs as much as a case. It is written when a case is
finished SHARD_SECONDS seconds after the shard before, and only a case in a shard is called
finished.

A result that is there is changed by a new file in its place.
"""

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

import numpy as np

from .. import BEFORE_END, HodoError
from .finished_cases import (
    ATTRIBUTES_FILE,
    ORDER_ATTRIBUTE,
    FinishedCase,
    finished_cases,
    in_order,
    resume_attributes,
    unpublished,
)
from .group import Attribute, Group
from .hdf5 import ResultFile, open_run, size_of
from .output import create
from .staging import Staging, check_writable, chunks_in, identity, os_errors_as, publish, synced

_Outcome = TypeVar("_Outcome")

CASES_KEPT = "; finished cases are kept"

SHARD_SECONDS = 0.5
"""Seconds within which finished cases share a shard, unless one of them took as long itself: so
much work a kill may cost."""


def publish_finished(path: Path) -> None:
    """Add to a result those finished cases of runs which have not ended that it lacks.

    The cases that it holds from before a change stay: they may be wanted again. So does what dead
    runs have left, for the next run. Raises HodoError as `compose` does.
    """
    shards, attributes, order = unpublished(path)
    if not shards:
        return
    if os.path.lexists(path):
        with open_run(path) as run:
            # A damaged case could not be copied into the new file, and would be gone.
            shards = {} if run.damaged else {n: f for n, f in shards.items() if n not in run}
    if shards:
        with compose(path, attributes, order) as writer:
            writer.leave_dead()
            for name, items in finished_cases(path).items():
                writer.keep(shards.get(name, items[0]))
            writer.keep_others()


@contextmanager
def compose(
    path: Path | str, attributes: Mapping[str, Attribute], order: Collection[str] = ()
) -> Iterator["Writer"]:
    """Make a result out of new cases and finished ones.

    On leaving, the cases that were added or kept, and no others, are joined in the given order
    under the result's name; if nothing is new, the file is left alone. After an exception the old
    file stays as it is, and what was added stays where the next writer finds it. Another process
    may replace the result meanwhile: what it has added is taken in, and so are its labels of equal
    cases. Raises HodoError as `open_run` does, or if a first result cannot be written there.
    """
    path = Path(path)
    before = identity(path)
    with Staging(path) as staging, open_run(path) if before else nullcontext() as old:
        writer = Writer(path, attributes, order, staging, old, before)
        if not old:
            # A folder that cannot be written should show before hours of integration, not after.
            writer.next_shard()
        try:
            yield writer
        except BaseException:
            # The user should see the exception at hand, and no other that it leads to.
            with suppress(Exception):
                writer.store()
            raise
        writer.store()
        with os_errors_as(path, CASES_KEPT):
            writer.finish()


class Writer:
    """A result on its way; made by `compose`, where it had the identity `before`."""

    def __init__(
        self,
        path: Path,
        attributes: Mapping[str, Attribute],
        order: Collection[str],
        staging: Staging,
        old: ResultFile | None,
        before: tuple[int, int] | None,
    ) -> None:
        self.path, self._attributes, self._order = path, attributes, order
        self._staging, self._old, self._before = staging, old, before
        self._cases: dict[str, FinishedCase] = {}
        self._texts: dict[str, Group] = {}
        self._chunks = {
            _chunk_key(file): file for folder in staging.dead for file in chunks_in(folder)
        }
        self._count, self._written = 0, set[tuple[Path, tuple[int, int] | None]]()
        self._waiting: dict[str, tuple[Group, Callable[[], object]]] = {}
        self._stored_at = monotonic()
        self.unfinished: set[str] = set()
        """The ids of the sweeps whose chunks stay for the next writer."""

    def add(self, name: str, group: Group, then: Callable[[], object] = lambda: None) -> None:
        """Take a finished case. `then` is called as soon as the case survives the death of this
        process: see `store`.

        Raises HodoError if it, or one that was added before, cannot be written.
        """
        self._waiting[name] = group, then
        took = float(group.attributes.get("run_time", 0.0))
        if max(took, monotonic() - self._stored_at) > SHARD_SECONDS:
            self.store()

    def between(self, outcomes: Iterable[_Outcome]) -> Iterator[_Outcome]:
        """Outcomes that take long to come: a signal that ends the process meanwhile has the cases
        that wait written first."""
        supply = iter(outcomes)
        while True:
            BEFORE_END.append(self.store)
            try:
                outcome = next(supply)
            except StopIteration:
                return
            finally:
                BEFORE_END.remove(self.store)
            yield outcome

    def store(self) -> None:
        """Write the cases that wait as one shard. Raises HodoError if it cannot be written."""
        self._stored_at = monotonic()
        try:
            self._store([*self._waiting])
        except Exception:
            # As much as the disk takes, and a case that cannot be stored takes no other along.
            for name in [*self._waiting]:
                with suppress(Exception):
                    self._store([name])
            raise

    def _store(self, names: Sequence[str]) -> None:
        if not names:
            return
        shard = self._put(self.next_shard(), {name: self._waiting[name][0] for name in names})
        for name in names:
            group, then = self._waiting.pop(name)
            self._cases[name] = FinishedCase(name, shard, group.attributes)
            then()

    def _put(self, file_name: str, groups: Mapping[str, Group]) -> Path:
        """A new file in the staging folder, with these groups."""
        with os_errors_as(self.path, CASES_KEPT):
            draft, file = self._staging / "draft", self._staging / file_name
            with create(draft, {}) as output:
                for name, group in groups.items():
                    output.write(name, group)
            synced(draft)  # or a loss of power leaves the name with nothing under it
            # The new name is on the disk with the next sync: one file may be lost, and half of the
            # time for syncing is saved.
            os.replace(draft, file)
        self._written.add((file, identity(file)))
        return file

    def chunks(self, sweep_id: str) -> set[int]:
        """The numbers of a sweep's chunks that this run and dead ones have finished. `sweep_id` is
        the digest of what the sweep depends on."""
        return {
            number
            for (of_sweep, number), file in self._chunks.items()
            if of_sweep == sweep_id and _is_sound(file)
        }

    def add_chunk(self, sweep_id: str, number: int, group: Group) -> None:
        """Write a finished chunk of a sweep; it survives the death of this process. Raises
        HodoError if it cannot be written."""
        name = f"part-{sweep_id}-{number}.h5"
        self._chunks[sweep_id, number] = self._put(name, {"part": group})

    def keep_all_chunks(self) -> None:
        """Leave the chunks of dead runs for the next writer."""
        self.unfinished |= {sweep_id for sweep_id, _ in self._chunks}

    def leave_dead(self) -> None:
        """Leave all that dead runs have finished for the next writer."""
        self._staging.dead.clear()

    def chunk(self, sweep_id: str, number: int) -> Group:
        """The members of a chunk, which is among `chunks`."""
        with self._opened(self._chunks[sweep_id, number]) as run:
            return run.read("part")

    def _opened(self, source: ResultFile | Path) -> AbstractContextManager[ResultFile]:
        """A source of cases, open for reading."""
        if isinstance(source, ResultFile):
            return nullcontext(source)
        return open_run(source, is_own=(source, identity(source)) in self._written)

    def keep(self, case: FinishedCase, text: str = "") -> bool:
        """Take over a finished case; False if another process has just removed it.

        `text` replaces the text of the case that is stored, whose remarks may be older.
        """
        is_old = case.file == self.path
        if case.damage or not (case.name in (self._old or ()) if is_old else case.file.exists()):
            return False
        if text and text != case.attributes.get("case"):
            self._texts[case.name] = Group({"case": text}, {})
        self._cases[case.name] = case
        return True

    def keep_others(self, gone: Collection[str] = ()) -> None:
        """Take over what the old result holds besides, but for cases that are to be `gone`: another
        process may have added it since the cases were looked up."""
        if (old := self._old) is None:
            return
        for name in old.cases():
            if name not in gone and name not in self._cases and name not in old.damaged:
                self.keep(FinishedCase(name, self.path, resume_attributes(old, name)))

    def next_shard(self) -> str:
        """The name of a new shard, beside the attributes of the result to be, which the first one
        writes. Raises BatchError if these cannot be written."""
        with os_errors_as(self.path, CASES_KEPT if self._waiting or self._cases else ""):
            if not self._count:
                # Before any shard: until the result is made, they are shown in its place.
                file = self._staging / ATTRIBUTES_FILE
                with create(file, {**self._attributes, ORDER_ATTRIBUTE: "\n".join(self._order)}):
                    pass
                synced(file)
        self._count += 1
        return f"{self._count}.h5"

    def finish(self) -> None:
        """Join the cases under the result's name, if there is anything new."""
        with self._staging.publishing(), self._latest_result() as result:
            sources = self._sources(result)
            if not (result and self._adds_nothing(result, sources)):
                draft = self._staging / "whole.h5"
                self._join(draft, sources, longer(result, self._attributes.get("history")))
                publish(draft, self._staging.path)
            # Not behind the lock: another process that publishes meanwhile may take these cases.
            chunks = self._chunks.items()
            self._staging.clear({file.name for (id, _), file in chunks if id in self.unfinished})

    def _latest_result(self) -> AbstractContextManager[ResultFile | None]:
        """The result as it is now. Another process may have replaced it since this one began, and
        what that has added is not lost."""
        if identity(self.path) == self._before:
            return nullcontext(self._old)
        return open_run(self.path) if self.path.exists() else nullcontext()

    def _adds_nothing(self, result: ResultFile, sources: Mapping[str, ResultFile | Path]) -> bool:
        """Whether a result has these cases already, in this order, with the same texts and
        config."""
        return (
            all(source in (self._old, result) for source in sources.values())
            and not self._texts
            and list(sources) == result.cases()
            and result.text == self._attributes.get("config")
        )

    def _sources(self, latest_result: ResultFile | None) -> dict[str, ResultFile | Path]:
        """Where each case comes from, in the order of the new file."""
        sources: dict[str, ResultFile | Path] = {
            name: self._old if self._old and case.file == self.path else case.file
            for name, case in self._cases.items()
        }
        if latest_result:
            sources |= {
                name: latest_result
                for name in latest_result.cases()
                if name not in latest_result.damaged and self._takes(latest_result, name)
            }
        return {name: sources[name] for name in in_order(sources, self._order)}

    def _takes(self, theirs: ResultFile, name: str) -> bool:
        """Whether a case is taken from the latest result, which another process may have put in the
        old one's place."""
        ours = self._cases.get(name)
        if ours is None:  # new there, unless this run has left it out
            return not (self._old and name in self._old)
        if ours.file == self.path:  # of the old result, which theirs replaces
            return True
        if not ours.file.exists():  # a shard that is gone is part of theirs
            return True
        # An equal one may have labels there.
        theirs_hash = resume_attributes(theirs, name).get("hash")
        return theirs is not self._old and theirs_hash == ours.attributes.get("hash")

    def _join(self, draft: Path, sources: Mapping[str, ResultFile | Path], history: str) -> None:
        with create(draft, {**self._attributes, "history": history}) as output:
            # Neighbours are in one shard, mostly.
            for source, names in groupby(sources, sources.__getitem__):
                with self._opened(source) as run:
                    for name in names:
                        output.copy(run, name, self._texts.get(name))


def _chunk_key(file: Path) -> tuple[str, int]:
    """The id of the sweep of a chunk, and its number."""
    _, sweep_id, number = file.stem.split("-")
    return sweep_id, int(number)


def _is_sound(file: Path) -> bool:
    """Whether a file of a dead run is whole: a loss of power may have torn it."""
    with suppress(HodoError), open_run(file) as run:
        return not run.damaged
    return False


MAX_HISTORY_LINES = 100
"""The lines of history that are kept: the first, which made the file, and the latest."""


def longer(run: ResultFile | None, line: Attribute | None) -> str:
    """The history of a result with a line more."""
    lines = str(run.attributes.get("history", "")).splitlines() if run else []
    lines += [str(line)] if line else []
    surplus = len(lines) - MAX_HISTORY_LINES
    if surplus > 0:
        lines[1 : 2 + surplus] = ["..."]
    return "\n".join(lines)


CACHED_BYTES = 64 << 20
"""Bytes of cases that stay in memory, to be written once more with what is added to them."""


@dataclass
class Update:
    """Changes to a result, whose file had this identity before it was opened; made by `update`.

    `cached` are cases as they were before: to read a short case again takes as long as to integrate
    it.
    """

    run: ResultFile
    file_identity: tuple[int, int] | None
    additions: dict[str, Group] = field(default_factory=dict)
    cached: dict[str, Group] = field(default_factory=dict)
    bytes_left: int = CACHED_BYTES

    def write(self, name: str, addition: Group, old: Group | None = None) -> None:
        """Add attributes and variables to a case, or replace them; a group that begins with `_` is
        made anew. `old` is what the result holds of it, if that was read already."""
        if not self.run.intact:  # its reports are not believed, so that they are no change
            addition = replace(addition, report=None)
        if old is None and name in self.run and name not in self.run.damaged:
            old = self.run.read(name)
        if old is None or not holds(old, addition, is_complete=name.startswith("_")):
            self.additions[name] = addition
            if old and (size := size_of(old)) < self.bytes_left:
                self.bytes_left -= size
                self.cached[name] = old


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
        yield (changes := Update(run, before))
        if changes.additions:
            with os_errors_as(path, CASES_KEPT):
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
    additions = changes.additions if is_latest else _applicable(changes, result)
    attributes = {**result.attributes, "history": longer(result, history)}
    with create(file, attributes, damaged=result.path if is_amended else None) as output:
        for name in dict.fromkeys([*result.groups, *additions]):
            # HDF5 neither copies nor removes a group that it cannot read. Damaged verdicts wait for
            # a file without damaged cases, where `hodo claims` gives them again.
            is_damaged = name in result.damaged and name.startswith("_")
            if name in additions and not (is_amended and is_damaged):
                cached = changes.cached.get(name) if is_latest else None
                old = Group({}, {}) if name.startswith("_") else cached or result.read(name)
                output.write(name, old.with_addition(additions[name]))
            elif not (is_amended or is_damaged):
                output.copy(result, name)


def _applicable(changes: Update, result: ResultFile) -> dict[str, Group]:
    """Those of the changes that are about what is still the same in a later result."""

    def is_the_same(name: str) -> bool:
        return name in result and (
            resume_attributes(result, name) == resume_attributes(changes.run, name)
        )

    def applies(name: str) -> bool:
        if not name.startswith("_"):
            return is_the_same(name)
        # Verdicts are about all cases: none of them may have been run anew meanwhile.
        sound = (case for case in result.cases() if case not in result.damaged)
        return result.cases() == changes.run.cases() and all(map(is_the_same, sound))

    return {name: addition for name, addition in changes.additions.items() if applies(name)}


def holds(old: Group, addition: Group, is_complete: bool = False) -> bool:
    """Whether a group has all of an addition already and, if that `is_complete`, nothing else."""
    names = (old.attributes.keys(), old.variables.keys())
    if is_complete and names != (addition.attributes.keys(), addition.variables.keys()):
        return False
    is_same = old.report == addition.report and _same(old.attributes, addition.attributes)
    return is_same and all(
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
