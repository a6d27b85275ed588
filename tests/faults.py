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
from contextlib import chdir, contextmanager, suppress
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
from click.testing import CliRunner, Result

from hodo_cli import HodoError
from hodo_cli.cli import main
from hodo_cli.storage import disk
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


def zeroed(path: Path, chance: random.Random, size: int = 512) -> None:
    """Clear one block of a file."""
    data = bytearray(path.read_bytes())
    start = chance.randrange(-(-len(data) // size)) * size
    data[start : start + size] = bytes(len(data[start : start + size]))
    path.write_bytes(data)


def truncated(path: Path, chance: random.Random) -> None:
    """Cut the end of a file off."""
    os.truncate(path, chance.randrange(path.stat().st_size))


# The N-th call of the operating system fails.

CALLS = ("replace", "link", "mkdir", "open", "fsync", "unlink")


class Faults:
    """Counts calls that touch files, and lets those from `first` on fail, or only that one."""

    def __init__(self, first: int, forever: bool, number: int = errno.EIO) -> None:
        self.first, self.forever, self.number = first, forever, number
        self.count = 0

    def __call__(self, *_: object) -> None:
        self.count += 1
        if self.count == self.first or (self.forever and self.count > self.first):
            raise OSError(self.number, os.strerror(self.number))


@contextmanager
def failing(faults: Faults) -> Iterator[None]:
    """Let calls fail that staging, writer and HDF5's file make."""

    def before(function: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **options: object) -> object:
            faults()
            return function(*arguments, **options)

        return call

    write = disk.BufferedFile.write

    def fragile(file: disk.BufferedFile, data: bytes) -> int:
        try:
            faults()
        except OSError as error:  # as `BufferedFile` takes it, when the call within it fails
            file.error = file.error or error
        return write(file, data)

    calls = {name: before(getattr(os, name)) for name in CALLS}
    with patch.multiple(os, **calls), patch.object(disk.BufferedFile, "write", fragile):
        yield


def nth_call_fails(folder: Path, right: Motions, first: int, forever: bool) -> bool:
    """One `hodo run` whose `first` call fails, on an old result, and one that follows it: nothing
    is lost. False if the run did not make so many calls."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "x.yaml").write_text(CONFIG)
    faults = Faults(first, forever, (errno.EIO, errno.ENOSPC)[first % 2])
    with failing(faults):
        done = hodo("run", folder / "x.yaml", "--out", folder, "--quiet")
    assert done.exit_code in (0, 2), (first, done.output, done.exception)
    assert "Traceback" not in done.output
    if done.exit_code == 2:
        assert len(done.stderr.splitlines()) == 1, done.stderr
    if (folder / "x.h5").exists():
        assert motions(folder / "x.h5").keys() == right.keys()
    again = hodo("run", folder / "x.yaml", "--out", folder, "--quiet")
    assert again.exit_code == 0, (first, again.output)
    equal(motions(folder / "x.h5"), right)
    assert sorted(os.listdir(folder)) == ["x.h5", "x.yaml"], (first, os.listdir(folder))
    return faults.count >= first


def equal(found: Motions, right: Motions) -> None:
    assert found.keys() == right.keys()
    for name, omega in right.items():
        assert np.array_equal(found[name], omega), name


# Power is lost: what was not synced is not what was written.


def power_is_lost(folder: Path, right: Motions, last: int, chance: random.Random) -> bool:
    """One `hodo run` that ends at its `last` sync, whatever was not synced by then damaged, and the
    next start. False if the run did not sync so often."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "x.yaml").write_text(CONFIG)
    log = folder.parent / "synced"
    log.write_text("")
    child = os.fork()
    if child == 0:
        _run_until(folder, last, log)
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 77
    safe = set(log.read_text().split())
    for path in [*folder.glob(".*/*"), *folder.glob("*.h5")]:
        if str(path.stat().st_ino) not in safe:
            chance.choice((flipped, zeroed, lambda path, _: os.truncate(path, 0)))(path, chance)
    disk._fits.cache_clear()
    again = hodo("run", folder / "x.yaml", "--out", folder, "--quiet")
    assert again.exit_code == 0, (last, again.output)
    equal(motions(folder / "x.h5"), right)
    return ended


def _run_until(folder: Path, last: int, log: Path) -> None:
    """A run in a process of its own that ends like one without power, at its `last` sync."""
    count = 0
    sync = os.fsync

    def note(descriptor: int) -> None:
        nonlocal count
        count += 1
        if count == last:
            os._exit(77)
        sync(descriptor)
        with log.open("a") as file:
            file.write(f"{os.fstat(descriptor).st_ino}\n")

    with suppress(BaseException), patch.object(os, "fsync", note):
        hodo("run", folder / "x.yaml", "--out", folder, "--quiet")
    os._exit(0)


# The N-th call of the operating system fails, in whatever library it is made.

COMMANDS = {
    "run": ["run", "x.yaml", "--out", ".", "--force", "--quiet"],
    "classify": ["classify", "x.h5"],
    "plot": ["plot", "x.h5", "--format", "png", "--format", "csv", "--out", "figures"],
}


def compiled(folder: Path) -> Path | None:
    """The library of `faults.c`, in a folder; None where there is no gcc."""
    if not shutil.which("gcc"):
        return None
    library, source = folder / "faults.so", Path(__file__).with_suffix(".c")
    subprocess.run(
        ["gcc", "-O1", "-Wall", "-Werror", "-shared", "-fPIC", "-o", library, source, "-ldl"],
        check=True,
    )
    return library


def preloaded(library: Path, folder: Path, most: int, step: int = 1) -> str:
    """`c_calls_fail` in a process that has the library; what it prints."""
    return subprocess.run(
        [sys.executable, __file__, library, folder, str(most), str(step)],
        env={**os.environ, "LD_PRELOAD": str(library)},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    ).stdout


def c_calls_fail(library: Path, folder: Path, most: int, step: int) -> Counter[str]:
    """Each command with its N-th call failing that reads or writes, once and for ever, for every N
    up to so many, or each `step`-th."""
    arm = ctypes.CDLL(str(library)).faults_arm
    right, count = prepared(folder / "x", SMALL), Counter[str]()
    shutil.copytree(folder / "x", folder / "plain")
    with chdir(folder / "plain"):
        assert hodo(*COMMANDS["run"]).exit_code == 0  # which takes the labels away
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
    assert not list(work.rglob(".*")), (said, os.listdir(work))
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


if __name__ == "__main__":
    library, folder, *numbers = sys.argv[1:]
    print(json.dumps(c_calls_fail(Path(library), Path(folder), *map(int, numbers))))
