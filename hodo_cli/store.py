"""Result files: how they are made of finished cases, resumed, and changed, so that nothing finished is ever lost.

A run puts each finished case into a small file of its own, a *piece*, in its workshop, and joins them at the end. (A
single HDF5 file that grows is unreadable, all of it, after one in five of its writes; a kill there would cost every
case.) A piece is whole or absent; the next run takes the pieces of a dead one over. A sweep comes in *parts*, small
files too, of which its piece is made.
"""

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from . import HodoError
from .cases.case import dump
from .hdf5 import Attribute, Group, Run, Variable, create, open_run, refusal
from .integration.trajectory import Trajectory
from .workshop import Workshop, identity, workshops

RESUME = ("hash", "status", "message", "case")

Labels = Mapping[str, tuple[tuple[str, ...], str, str]]
"""Dimensions, long name and units of each variable, by its name."""


def group_of(trajectory: Trajectory, labels: Labels, hash: str) -> Group:
    """A case as it is stored; a label of `time` replaces the plain one."""
    case, errors = trajectory.case, trajectory.errors
    labels = {"time": (("time",), "time", "1"), **labels}
    variables = {}
    for name, data in {"time": trajectory.time, **trajectory.variables}.items():
        dims, long_name, units = labels[name]
        error = {"error": errors[name]} if name in errors else {}
        variables[name] = Variable(dims, data, {"long_name": long_name, "units": units, **error})
    if any("axis" in variable.dims for variable in variables.values()):
        axes = np.array(["x1", "x2", "x3"], dtype=object)
        variables["axis"] = Variable(("axis",), axes, {"long_name": "principal axis of inertia"})
    if trajectory.events:
        times = np.array([event.time for event in trajectory.events])
        kinds = np.array([event.kind for event in trajectory.events], dtype=object)
        units = labels["time"][2]
        variables["event_time"] = Variable(("event",), times, {"long_name": "time of the event", "units": units})
        variables["event_kind"] = Variable(("event",), kinds, {"long_name": "kind of the event"})
    attributes: dict[str, Attribute] = {
        "model": case.model,
        "form": case.form,
        "case": dump(case),
        "hash": hash,
        "method": trajectory.method,
        "method_reason": trajectory.method_reason,
        "tol": trajectory.tol,
        "steps": trajectory.steps,
        "run_time": trajectory.run_time,
        "error": trajectory.error,
        "error_kind": trajectory.error_kind,
        "status": trajectory.status,
        "message": trajectory.message,
        "warnings": "\n".join(trajectory.warnings),
    }
    return Group(attributes, variables)


@dataclass(frozen=True)
class Finished:
    """A finished case: its name, the file that holds it, and the attributes that tell whether it is still right."""

    name: str
    file: Path
    attributes: Mapping[str, Any]


def finished(path: Path | str) -> dict[str, list[Finished]]:
    """The finished cases of a result, and of runs that have not ended, by name; those of the result itself first.

    Raises HodoError if the result exists but cannot be read, as `open_run` does.
    """
    path = Path(path)
    found: dict[str, list[Finished]] = {}
    if os.path.lexists(path):
        with open_run(path) as run:
            _collect(run, found)
    for piece in (piece for folder in workshops(path) for piece in _pieces(folder)):
        with suppress(HodoError), open_run(piece) as run:  # gone by now, or torn by a loss of power
            _collect(run, found)
    return found


def _collect(run: Run, found: dict[str, list[Finished]]) -> None:
    for name in run.cases():
        found.setdefault(name, []).append(Finished(name, run.path, _resume(run, name)))


def _resume(run: Run, name: str) -> dict[str, str]:
    return {key: str(value) for key, value in run.summary(name, RESUME).items()}


def _pieces(folder: Path) -> list[Path]:
    return sorted(folder.glob("[0-9]*.h5"))


def _parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("part-*.h5"))


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Make a HodoError of what the operating system refuses."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if not (reason := refusal(error)):
            raise
        raise HodoError(f"cannot write {path}: {reason}; finished cases are kept") from error


class Writer:
    """Makes a result out of new cases and finished ones. A context manager.

    On entering, `finished` is filled as by the function of that name. On leaving, the cases that were added or kept,
    and no others, are joined in the given order under the result's name; if nothing is new, the file is left alone.
    After an exception the old file stays as it is, and what was added stays where the next Writer finds it. Another
    process may replace the result meanwhile: what it has added is taken in, and so are its labels of equal cases.
    """

    def __init__(self, path: Path | str, attributes: Mapping[str, Attribute], order: Sequence[str] = ()) -> None:
        self.path = Path(path)
        self.finished: dict[str, list[Finished]] = {}
        self._attributes = attributes
        self._order = order
        self._new: dict[str, Finished] = {}
        self._kept: dict[str, Run] = {}
        self._count = 0
        self._old: Run | None = None
        self._workshop = Workshop(self.path)
        self._open = ExitStack()

    def __enter__(self) -> Self:
        """Raises HodoError as `finished` does, or if a first result cannot be written there."""
        self._open.callback(self._workshop.close)
        with self._open:
            self._abandoned = self._workshop.abandoned()
            self._seen = identity(self.path)
            self.finished = finished(self.path)
            if self._seen:
                self._old = self._open.enter_context(open_run(self.path))
            else:
                self._next_piece()
            self._open = self._open.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        with self._open:
            if kind is None:
                with _refusals(self.path):
                    self._finish()
            elif not self._new and not (self._workshop.folder and _parts(self._workshop.folder)):
                self._workshop.remove()

    def add(self, name: str, group: Group) -> None:
        """Write a finished case; from now on it survives the death of this process.

        Raises HodoError if it cannot be written.
        """
        piece = self._next_piece()
        self._put(piece, name, group)
        self._new[name] = Finished(name, piece, group.attributes)

    def _put(self, piece: Path, name: str, group: Group) -> None:
        draft = piece.with_name("draft")
        with _refusals(self.path), ExitStack() as failed:
            failed.callback(draft.unlink, missing_ok=True)
            with create(draft, {}) as output:
                output.write(name, group)
            os.replace(draft, piece)
            failed.pop_all()

    def parts(self, stamp: str) -> set[int]:
        """The numbers of the parts with this stamp that this run and dead ones have finished; all are now its own."""
        for folder in self._abandoned:
            for part in folder.glob(f"part-{stamp}-*.h5"):
                with _refusals(self.path), suppress(FileExistsError), suppress(HodoError), open_run(part):
                    os.link(part, self._workshop / part.name)
        own = self._workshop.folder
        return {int(part.stem.rpartition("-")[2]) for part in own.glob(f"part-{stamp}-*.h5")} if own else set()

    def add_part(self, stamp: str, number: int, group: Group) -> None:
        """Write one finished part of a case that comes in many; it survives the death of this process.

        `stamp` tells what the part belongs to. Raises HodoError if it cannot be written.
        """
        with _refusals(self.path):
            piece = self._workshop / f"part-{stamp}-{number}.h5"
        self._put(piece, "part", group)

    @contextmanager
    def part(self, stamp: str, number: int) -> Iterator[Run]:
        """A part that was added or taken over, open for reading; its only group is named `part`."""
        with open_run(self._workshop / f"part-{stamp}-{number}.h5") as run:
            yield run

    def keep(self, case: Finished) -> bool:
        """Take over a finished case; False if another process has just removed it."""
        if case.file == self.path:
            if self._old and case.name in self._old:
                self._kept[case.name] = self._old
            return case.name in self._kept
        piece = self._next_piece()
        with _refusals(self.path):
            try:
                os.link(case.file, piece)
            except FileNotFoundError:
                return False
        self._new[case.name] = Finished(case.name, piece, case.attributes)
        return True

    def _next_piece(self) -> Path:
        self._count += 1
        with _refusals(self.path):
            return self._workshop / f"{self._count}.h5"

    def _finish(self) -> None:
        with self._workshop.turn(), ExitStack() as stack:
            now = self._old
            if (seen := identity(self.path)) != self._seen:
                now = stack.enter_context(open_run(self.path)) if seen else None
            sources = self._sources(now)
            if self._new or not now or list(sources) != now.cases() or now.text != self._attributes.get("config"):
                whole = self._workshop / "whole.h5"
                self._join(whole, sources, _longer(now, self._attributes.get("history")))
                self._workshop.publish(whole)
        for folder in self._abandoned:
            shutil.rmtree(folder, ignore_errors=True)
        self._workshop.remove()

    def _sources(self, now: Run | None) -> dict[str, Run | Path]:
        """Where each case comes from, in the order of the new file; `now` is the result as it stands."""
        found: dict[str, Run | Path] = {**self._kept, **{name: case.file for name, case in self._new.items()}}
        if now and now is not self._old:
            known = set(self._old.cases()) if self._old else set()
            for name in now.cases():
                ours = self._new.get(name)
                equal = ours and _resume(now, name).get("hash") == ours.attributes.get("hash")
                if equal or (not ours and (name in self._kept or name not in known)):
                    found[name] = now
        return {name: found[name] for name in dict.fromkeys([*self._order, *found]) if name in found}

    def _join(self, whole: Path, sources: Mapping[str, Run | Path], history: str) -> None:
        with create(whole, {**self._attributes, "history": history}) as output:
            for name, source in sources.items():
                if isinstance(source, Run):
                    output.copy(source, name)
                else:
                    with open_run(source) as piece:
                        output.copy(piece, name)


def _longer(run: Run | None, line: Attribute | None) -> str:
    """The history of a result with a line more."""
    lines = [str(run.attributes.get("history", "")) if run else "", str(line or "")]
    return "\n".join(filter(None, lines))


class Update:
    """Changes to a result; made by `update`."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.parts: dict[str, Group] = {}

    def write(self, name: str, part: Group) -> None:
        """Add attributes and variables to a case, or replace them; a group that begins with `_` is made anew."""
        if name not in self.run or not _holds(self.run.read(name), part, whole=name.startswith("_")):
            self.parts[name] = part


@contextmanager
def update(path: Path | str, history: str = "") -> Iterator[Update]:
    """Change a result. It is replaced at the end, or left alone if the changes change nothing.

    If another process has replaced it meanwhile, the changes apply to the cases that are still the same.
    Raises HodoError as `open_run` does, or if the result cannot be written.
    """
    path = Path(path)
    with open_run(path) as run:
        changes = Update(run)
        yield changes
        with _refusals(path), ExitStack() as stack:
            workshop = Workshop(path)
            stack.callback(workshop.close)
            for folder in workshop.abandoned():
                if not _pieces(folder) and not _parts(folder):
                    shutil.rmtree(folder, ignore_errors=True)
            if changes.parts:
                stack.callback(workshop.remove)
                with workshop.turn(), open_run(path) as now:
                    _rewrite(workshop / "whole.h5", now, changes, history)
                    workshop.publish(workshop / "whole.h5")


def _rewrite(whole: Path, now: Run, changes: Update, history: str) -> None:
    """Write a result with changes that were made to it, or to a file that had its name before."""

    def applies(name: str) -> bool:
        return name.startswith("_") or (name in now and _resume(now, name) == _resume(changes.run, name))

    parts = {name: part for name, part in changes.parts.items() if applies(name)}
    with create(whole, {**now.attributes, "history": _longer(now, history)}) as output:
        for name in dict.fromkeys([*now.groups(), *parts]):
            if name not in parts:
                output.copy(now, name)
            elif name.startswith("_"):
                output.write(name, parts[name])
            else:
                old, part = now.read(name), parts[name]
                output.write(name, Group({**old.attributes, **part.attributes}, {**old.variables, **part.variables}))


def _holds(old: Group, part: Group, whole: bool) -> bool:
    """Whether a group has what a part says already and, if `whole`, nothing else."""
    if whole and (set(old.attributes) != set(part.attributes) or set(old.variables) != set(part.variables)):
        return False
    return _same(old.attributes, part.attributes) and all(
        name in old.variables
        and old.variables[name].dims == new.dims
        and _equal(old.variables[name].data, new.data)
        and _same(old.variables[name].attributes, new.attributes)
        for name, new in part.variables.items()
    )


def _same(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    return all(name in old and _equal(old[name], value) for name, value in new.items())


def _equal(a: Any, b: Any) -> bool:
    a, b = np.asarray(a), np.asarray(b)
    return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))
