"""Faults made on purpose: I/O calls that fail from the N-th on, data that were never synced, bytes
that have changed. What `test_damage.py` tries by sample, and `make stress` all over."""

import ctypes
import errno
import json
import os
import random
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from click.testing import CliRunner, Result

from hodo_cli import HodoError
from hodo_cli.cli import main
from hodo_cli.storage import disk, hdf5
from hodo_cli.storage.hdf5 import open_run

CONFIG = """\
defaults:
  model: linear-diag
  inertia: [1, 0.8, 0.6]
  time: {end: 40, samples: 41}
  initial: {p: 0.8, q: 0.5, r: 0.74}
  error: off
cases:
  a: {damping: [0.05, 0.04, 0.03]}
  b: {damping: [0.03, 0.04, 0.05]}
  s: {damping: [0.03, 0.04, 0.05], sweep: {damping.0: {linspace: [0.01, 0.05, 300]}}}
figures:
  both: {kind: hodograph, cases: [a, b]}
claims:
  - {id: start, where: here, statement: It is damped., cases: [a], expect: reproduced,
     check: {kind: axis, start: x1, end: x3}}
"""

SMALL = CONFIG.partition("  b:")[0] + "figures:" + CONFIG.partition("figures:")[2]
SMALL = SMALL.replace("[a, b]", "[a]")
"""The first case alone, where a trial takes long."""

Motions = dict[str, np.ndarray]


def hodo(*arguments: object) -> Result:
    """A command in this process."""
    return CliRunner().invoke(main, [str(word) for word in arguments])


def forked(
    told: Path,
    arguments: Sequence[object],
    before: Callable[[], object] = lambda: None,
    after: Callable[[], int] = lambda: 0,
) -> int:
    """A command in a process that has all modules already, which `ended` awaits."""
    if child := os.fork():
        return child
    before()
    done = hodo(*arguments)
    bug = [] if isinstance(done.exception, SystemExit | None) else [repr(done.exception)]
    count = after()
    told.write_text(json.dumps([done.exit_code, done.stderr.splitlines() + bug, count]))
    os._exit(0)


def ended(child: int, told: Path) -> tuple[int, list[str], int]:
    """The exit status of a forked command, what it said, and the number that `after` gave."""
    assert os.waitpid(child, 0)[1] == 0, "the process died"
    status, said, count = json.loads(told.read_text())
    assert not [line for line in said if "Traceback" in line or "Error(" in line], said
    return status, said, count


def prepared(folder: Path, config: str = CONFIG) -> Motions:
    """A classified result `x.h5` of `x.yaml` in a folder; its motions."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "x.yaml").write_text(config)
    for command in (["run", folder / "x.yaml", "--out", folder], ["classify", folder / "x.h5"]):
        done = hodo(*command)
        assert done.exit_code == 0, done.output
    return motions(folder / "x.h5")


def motions(path: Path) -> Motions:
    """What the cases of a result hold."""
    with open_run(path) as run:
        return {name: run.read(name).variables["omega"].data for name in run.cases()}


def right_or_named(path: Path, right: Motions) -> str:
    """A damaged result is refused as a whole, or its damaged cases are, and the others are right;
    what was found."""
    try:
        with open_run(path) as run:
            refused = 0
            for name in right:
                try:
                    omega = run.read(name).variables["omega"].data
                except HodoError as error:
                    is_one_line(error)
                    refused += 1
                else:
                    assert np.array_equal(omega, right[name]), f"{name} is wrong in silence"
    except HodoError as error:
        is_one_line(error)
        return "refused"
    return "a case named" if refused else "right"


def is_one_line(error: HodoError) -> None:
    assert "\n" not in str(error)


def flipped(path: Path, chance: random.Random) -> None:
    """Turn one bit of a file."""
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def without_labels(path: Path) -> None:
    """Make a result anew, without labels, from a copy of its config in another folder: `run` makes
    it once more if it is forced, though the numbers are equal."""
    path.unlink()
    origin = path.with_name("origin")
    origin.mkdir()
    config = shutil.copy(path.with_suffix(".yaml"), origin)
    assert hodo("run", config, "--out", path.parent).exit_code == 0
    shutil.rmtree(origin)


def zeroed(path: Path, chance: random.Random, size: int = 512) -> None:
    """Clear one block of a file."""
    data = bytearray(path.read_bytes())
    start = chance.randrange(-(-len(data) // size)) * size
    data[start : start + size] = bytes(len(data[start : start + size]))
    path.write_bytes(data)


def truncated(path: Path, chance: random.Random) -> None:
    """Cut the end of a file off."""
    os.truncate(path, chance.randrange(path.stat().st_size))


def sealed_by_a_stranger(path: Path) -> None:
    """Give a file a checksum that fits all its bytes, under another user's secret."""
    with (
        patch.object(disk, "secret", lambda: bytes(32)),
        open(path, "r+b", buffering=0) as file,
    ):
        disk.append_checksum(file)  # type: ignore[arg-type]
    hdf5._inspected.cache_clear()


def equal(found: Motions, right: Motions) -> None:
    assert found.keys() == right.keys()
    for name, omega in right.items():
        assert np.array_equal(found[name], omega), name


# The N-th call of the operating system fails, in whatever library it is made.

COMMANDS = {
    "run": ["run", "x.yaml", "--out", ".", "--force", "--quiet"],
    "classify": ["classify", "x.h5"],
    "plot": ["plot", "x.h5", "--format", "png", "--format", "csv", "--out", "figures"],
}


def compiled(folder: Path) -> Path:
    """The library of `faults.c`, in a folder."""
    library, source = folder / "faults.so", Path(__file__).with_suffix(".c")
    subprocess.run(
        ["gcc", "-O1", "-Wall", "-Werror", "-shared", "-fPIC", "-o", library, source, "-ldl"],
        check=True,
    )
    return library


def preloaded(library: Path, trial: str, folder: Path, *numbers: int) -> dict[str, int]:
    """A trial (`TRIALS`) in a process that has the library; what it counts."""
    done = subprocess.run(
        [sys.executable, __file__, trial, library, folder, *map(str, numbers)],
        env={**os.environ, "LD_PRELOAD": str(library)},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    return dict(json.loads(done.stdout))


def calls_fail(library: Path, folder: Path, most: int, step: int = 1) -> Counter[str]:
    """Each command with its N-th call failing that reads or writes, once and for ever, for every N
    up to so many, or each `step`-th."""
    arm = ctypes.CDLL(str(library)).faults_arm
    right, count = prepared(folder / "x", SMALL), Counter[str]()
    shutil.copytree(folder / "x", folder / "plain")
    without_labels(folder / "plain" / "x.h5")
    with chdir(folder / "x"):
        assert hodo(*COMMANDS["plot"]).exit_code == 0
    for name in COMMANDS:
        for kind in range(4):
            reads, forever = divmod(kind, 2)
            what = f"{name}: {'reads' if reads else 'writes'} {'for ever' if forever else 'once'}"
            for first in range(1, most + 1, step):
                number = errno.EIO if reads or first % 2 else errno.ENOSPC
                fault = partial(arm, bytes(folder / "work"), first, forever, reads, number)
                if one_fails(folder, name, right, fault) < first:
                    break
                count[what] += 1
            arm(b"", 0, 0, 0, 0)
    return count


def one_fails(folder: Path, name: str, right: Motions, arm: Callable[[], object]) -> int:
    """One command of which a call fails, and the same that follows it: nothing is lost, or half
    there. The number of its calls."""
    work, told = folder / "work", folder / "told"
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(folder / "plain", work)
    if name == "plot":
        shutil.copy(folder / "x" / "x.h5", work)
    with chdir(work):
        status, said, count = ended(forked(told, COMMANDS[name], arm, _calls), told)
        assert status in (0, 2) or (status == 1 and name != "run"), (status, said)
        assert status != 2 or len(said) == 1 or name == "plot", said  # a figure has a line too
        equal(motions(work / "x.h5"), right)
        drawn = files_of(folder / "x" / "figures")
        half = [  # the page shows what could be drawn
            path
            for path, data in files_of(work / "figures").items()
            if path.suffix in (".png", ".csv") and drawn[path] != data
        ]
        assert not half, half
        again = hodo(*COMMANDS[name])
        assert again.exit_code == 0, (said, again.output)
    equal(motions(work / "x.h5"), right)
    assert [path.name for path in work.glob("*.h5")] == ["x.h5"]
    # An empty folder stays where the disk refuses to remove it, until the next draft of that file.
    hidden = [path for path in work.rglob(".*") if not path.is_dir() or any(path.iterdir())]
    assert not hidden, (said, hidden)
    assert name != "plot" or files_of(work / "figures") == drawn
    return count


def _calls() -> int:
    return int(ctypes.CDLL(None).faults_count())


def files_of(folder: Path) -> dict[Path, bytes]:
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(".")
    }


# Power is lost: of what was not synced, anything may be on the disk.


class Call(NamedTuple):
    """A call that changed a file or folder, as `faults.c` logs it."""

    what: str
    inode: int
    offset: int
    path: str
    target: str
    data: bytes


def calls_in(log: bytes) -> Iterator[Call]:
    while log:
        line, _, log = log.partition(b"\n")
        what, inode, offset, size, path, target = line.decode().split("\t")
        data, log = (log[: int(size)], log[int(size) :]) if what == "write" else (b"", log)
        yield Call(what, int(inode), int(offset), *map(os.path.normpath, (path, target)), data)


Choice = Callable[[list[Any]], list[Any]]
"""Which of some changes that were not synced are on the disk."""


class PowerlessDisk:
    """A folder as calls change it, with what each file and folder was at its last sync, and the
    changes since. What stands there at first is synced."""

    def __init__(self, folder: Path) -> None:
        self.folder = str(folder)
        self.names: dict[str, tuple[dict[str, int], list[tuple[str, int | None]]]] = {}
        self.bytes: dict[int, tuple[bytes, list[Call]]] = {}
        self.folders = {folder.stat().st_ino: self.folder}
        files = {path.name: path.stat().st_ino for path in folder.iterdir()}
        self.names[self.folder] = files, []
        for name, inode in files.items():
            self.bytes[inode] = (folder / name).read_bytes(), []

    def apply(self, call: Call) -> None:
        if call.what in ("write", "cut"):
            self.bytes[call.inode][1].append(call)
        elif call.what == "sync" and call.inode in self.folders:
            path = self.folders[call.inode]
            self.names[path] = named(*self.names[path]), []
        elif call.what == "sync":
            self.bytes[call.inode] = written(*self.bytes[call.inode]), []
        else:
            if call.what == "mkdir":
                self.folders[call.inode], self.names[call.path] = call.path, ({}, [])
            elif call.what == "make":
                self.bytes[call.inode] = b"", []
            if call.what in ("rename", "unlink"):
                self._change(call.path, None)
            if call.what != "unlink":
                new = call.target if call.what in ("rename", "link") else call.path
                self._change(new, call.inode)

    def _change(self, path: str, inode: int | None) -> None:
        folder, name = os.path.split(path)
        self.names[folder][1].append((name, inode))

    def start_again(self, target: Path, of_names: Choice, of_bytes: Choice, at: str = "") -> None:
        """Make the folder as it may be found when the power is back."""
        target.mkdir()
        synced, changes = self.names[at or self.folder]
        for name, inode in named(synced, of_names(changes)).items():
            if inode in self.folders:
                self.start_again(target / name, of_names, of_bytes, self.folders[inode])
            else:
                synced_bytes, writes = self.bytes[inode]
                (target / name).write_bytes(written(synced_bytes, of_bytes(writes)))


def named(names: dict[str, int], changes: list[tuple[str, int | None]]) -> dict[str, int]:
    """The names in a folder after some changes."""
    new: dict[str, int | None] = {**names, **dict(changes)}
    return {name: inode for name, inode in new.items() if inode is not None}


def written(content: bytes, writes: list[Call]) -> bytes:
    """What is in a file after some writes."""
    data = bytearray(content)
    for call in writes:
        end = call.offset + len(call.data)
        data.extend(bytes(max(end - len(data), 0)))
        if call.what == "cut":
            del data[call.offset :]
        data[call.offset : end] = call.data
    return bytes(data)


def power_fails(library: Path, folder: Path, tries: int) -> Counter[str]:
    """Lose the power after so many random calls of a command and, each time, all that was not
    synced, all but names, nothing, or what chance takes: the next run gives the right result, and a
    result that was there is never gone. At the end of a command its result is on the disk."""
    right, count, chance = prepared(folder / "x"), Counter[str](), random.Random(7)
    shutil.copytree(folder / "x", folder / "plain")
    for name in ("x", "plain"):
        without_labels(folder / name / "x.h5")
    (folder / "new").mkdir()
    shutil.copy(folder / "x" / "x.yaml", folder / "new")
    for start, command in (("new", "run"), ("x", "run"), ("plain", "classify")):
        work, log, after = folder / "work", folder / "log", folder / "after"
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(folder / start, work)
        log.write_bytes(b"")
        disk, begin = PowerlessDisk(work), ctypes.CDLL(str(library)).faults_log
        with chdir(work):
            before = partial(begin, bytes(work), bytes(log))
            assert (
                ended(forked(folder / "told", COMMANDS[command], before), folder / "told")[0] == 0
            )
        calls = [*calls_in(log.read_bytes())]
        last = set(chance.sample(range(len(calls)), min(tries, len(calls)))) | {len(calls)}
        for number in range(len(calls) + 1):
            for state, choices in states(chance).items() if number in last else ():
                shutil.rmtree(after, ignore_errors=True)
                disk.start_again(after, *choices)
                case = f"{command} on {start}, {state} after {number} of {len(calls)} calls"
                if start != "new" or number == len(calls):
                    equal(motions(after / "x.h5"), right)
                if command == "classify" and number == len(calls):
                    with open_run(after / "x.h5") as run:
                        assert "enclosed_axis" in run.read("a").variables, case
                with chdir(after):
                    again = hodo("run", "x.yaml", "--out", ".", "--quiet")
                assert again.exit_code == 0, (case, again.output)
                equal(motions(after / "x.h5"), right)
                assert sorted(os.listdir(after)) == ["x.h5", "x.yaml"], case
                count[f"{command} on {start}: {state}"] += 1
            for call in calls[number : number + 1]:
                disk.apply(call)
    return count


def states(chance: random.Random) -> dict[str, tuple[Choice, Choice]]:
    """What may be on a disk of changes that were not synced: those of names, and of bytes."""
    return {
        "nothing unsynced": (lambda changes: [], lambda writes: []),
        "names alone": (list, lambda writes: []),
        "everything": (list, list),
        "by chance": (
            lambda changes: changes[: chance.randrange(len(changes) + 1)],
            lambda writes: [call for call in writes if chance.random() < 0.5],
        ),
    }


TRIALS = {"calls": calls_fail, "power": power_fails}

if __name__ == "__main__":
    trial, library, folder, *numbers = sys.argv[1:]
    print(json.dumps(TRIALS[trial](Path(library), Path(folder), *map(int, numbers))))
