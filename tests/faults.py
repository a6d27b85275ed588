"""Faults made on purpose: I/O calls that fail from the N-th on, data that were never synced, bytes
that have changed. What `test_damage.py` tries by sample, and `make stress` all over."""

import errno
import os
import random
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest.mock import patch

import numpy as np
from click.testing import CliRunner, Result

from hodo_cli import HodoError
from hodo_cli.cli import main
from hodo_cli.results import disk
from hodo_cli.results.hdf5 import open_run

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

Motions = dict[str, np.ndarray]


def hodo(*arguments: object) -> Result:
    """A command in this process."""
    return CliRunner().invoke(main, [str(word) for word in arguments])


def prepared(folder: Path) -> Motions:
    """A classified result `x.h5` of `x.yaml` in a folder; its motions."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "x.yaml").write_text(CONFIG)
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

    write = disk.Disk.write

    def fragile(file: disk.Disk, data: bytes) -> int:
        try:
            faults()
        except OSError as error:  # as `Disk` takes it, when the call within it fails
            file.error = file.error or error
        return write(file, data)

    calls = {name: before(getattr(os, name)) for name in CALLS}
    with patch.multiple(os, **calls), patch.object(disk.Disk, "write", fragile):
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
