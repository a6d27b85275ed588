"""Faults made on purpose, seen through commands and files alone: processes that are killed, calls
that fail, a disk that loses its power or fills, processes that meet, bytes that have changed.

Each trial takes an empty folder and a number of tries, raises AssertionError where something
finished is lost or a number is wrong, and returns what it counted. `test_safety.py` tries a few of
each, `stress.py` hundreds.
"""

import ctypes
import errno
import json
import os
import pickle
import random
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from conftest import call, limit, wait_until

PAIR = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74},
           time: {end: 40, samples: 41}, error: off}
cases:
  a: {damping: [0.05, 0.04, 0.03]}
  b: {damping: [0.03, 0.04, 0.05]}
  s: {damping: [0.03, 0.04, 0.05], sweep: {damping.0: {linspace: [0.01, 0.05, 300]}}}
figures:
  both: {kind: phase, x: p, y: q, cases: [a, b]}
claims:
  - {id: start, where: here, statement: It is damped., cases: [a], expect: reproduced,
     check: {kind: axis, start: x1, end: x3}}
"""
SINGLE = PAIR.partition("  b:")[0] + "figures:" + PAIR.partition("figures:")[2]
SINGLE = SINGLE.replace("[a, b]", "[a]")
"""The first case alone, where a trial takes long."""

BODY = "model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 1000, samples: 2001}"
MOVES = "initial: {p: 0.8, q: 0.%s, r: 0.74}"
BATCH = f"defaults: {{{BODY}}}\ncases:\n" + "".join(
    f"  c{i}: {{damping: [0.005, 0.004, 0.00{i % 9 + 1}], {MOVES % (i + 1)}}}\n" for i in range(16)
)
SWEEP = f"""\
  s: {{damping: [0.005, 0.004, 0.003], {MOVES % 5}, time: {{end: 100}}, error: off, sweep: {{
      damping.2: {{linspace: [0.001, 0.009, 60]}}, damping.0: {{linspace: [0.004, 0.006, 50]}}}}}}
"""
"""One more case of `BATCH`: 3,000 members in some chunks."""

Numbers = dict[str, dict[str, np.ndarray]]
Count = Counter[str]


def written(folder: Path, config: str) -> Path:
    """A case file `x.yaml` in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "x.yaml").write_text(config)
    return folder


def prepared(folder: Path, config: str = PAIR, classify: bool = True) -> Numbers:
    """A result `x.h5` of `x.yaml` in a folder, with labels if need be; its numbers."""
    written(folder, config)
    for command in (["run", "x.yaml", "--out", "."], *[["classify", "x.h5"]] * classify):
        done = call(folder, *command)
        assert done.returncode == 0, done.stderr
    return numbers(folder / "x.h5")


def numbers(path: Path, only: Sequence[str] = ()) -> Numbers:
    """The numeric arrays of every case in a result, or of those named, by h5py alone."""
    with h5py.File(path, "r") as file:
        return {
            name: {
                key: item[()]
                for key, item in case.items()
                if item.ndim and item.dtype.kind in "fiu" and (not only or key in only)
            }
            for name, case in file.items()
            if not name.startswith("_")
        }


MOTIONS = {"omega", "time", "end_axis", "crossings", "status"}


def same(found: Numbers, right: Numbers, every: bool = False) -> None:
    """The motions that were found are the right ones, all of them, to the bit; or every array."""
    assert found.keys() == right.keys()
    for name, arrays in right.items():
        assert not every or found[name].keys() == arrays.keys()
        for key in arrays.keys() if every else arrays.keys() & MOTIONS:
            is_same = np.array_equal(found[name][key], arrays[key], equal_nan=True)
            assert is_same, f"{name}: {key}"


def nothing_waits(folder: Path, *names: str) -> None:
    """A folder holds these files and nothing else that takes room."""
    visible = sorted(name for name in os.listdir(folder) if not name.startswith("."))
    hidden = [path for path in folder.rglob(".*") if path.is_file() and path.stat().st_size]
    assert (visible, hidden) == (sorted(names), []), (visible, hidden)


def is_left_right(folder: Path, right: Numbers, *said: object) -> None:
    """The next run ends with the right motions, whatever went before, and nothing waits."""
    again = call(folder, "run", "x.yaml", "--out", ".", "--quiet")
    assert again.returncode == 0, (*said, again.stderr)
    same(numbers(folder / "x.h5"), right)
    nothing_waits(folder, "x.h5", "x.yaml")


def copies(source: Path, tries: int) -> Iterator[tuple[int, Path]]:
    """Copies of a folder beside it, one for each trial, which are removed where it ends well."""
    for i in range(tries):
        out = source.with_name(f"try{i}")
        shutil.copytree(source, out)
        yield i, out
        shutil.rmtree(out)


# Kills.

SIGNALS = {signal.SIGKILL: (-9,), signal.SIGTERM: (143, -15), signal.SIGINT: (130, -2)}
"""What a command returns that a signal ended: a process that has not come so far as to catch it
dies of it."""


def started(folder: Path, *arguments: object) -> subprocess.Popen[str]:
    """A command as a process and session of its own."""
    command = [str(Path(sysconfig.get_path("scripts")) / "hodo"), *map(str, arguments)]
    pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, cwd=folder, start_new_session=True, text=True, **pipes)


def killed(folder: Path, kill: signal.Signals, after: float, *arguments: str) -> tuple[bool, str]:
    """A command that gets a signal after so many seconds: whether this was its end, and what it has
    said. Ctrl-C goes to its workers too, as on a terminal; the other signals to the command alone.
    """
    with started(folder, *arguments) as process:
        time.sleep(after)
        (os.killpg if kill == signal.SIGINT else os.kill)(process.pid, kill)
        said = process.communicate()[1]
    assert process.returncode in (0, *SIGNALS[kill]), (process.returncode, said)
    if process.returncode >= 0:
        assert "Traceback" not in said, said
        assert ("interrupted" in said) == (process.returncode > 0), said
    wait_until(lambda: not members(process.pid))
    return process.returncode != 0, said


def members(session: int) -> list[int]:
    """The living processes of a session."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            pid, fields = stat.parent.name, stat.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(pid))
    return found


def kill_runs(folder: Path, tries: int) -> Count:
    """Kill runs of cases and a sweep, in one process and in two, three times in a row from nothing;
    the fourth is left to finish the work. What was said to be finished is kept, chunks of the sweep
    too, and all ends to the bit as without kills."""
    written(folder, BATCH + SWEEP)
    began = time.monotonic()
    with started(folder, "run", "x.yaml", "--out", "right") as process:
        said = process.communicate()[1]
    assert process.returncode == 0, said
    took, chance = time.monotonic() - began, random.Random(1)
    right, count, finished = numbers(folder / "right" / "x.h5"), Count(), set[str]()
    for i, kill in enumerate(islice(cycle(SIGNALS), tries)):
        out, jobs = f"run{i // 3}", ("-j", "2") if i % 2 else ()
        after = took * chance.uniform(0.2, 1.1)
        command = ("run", "x.yaml", "--out", out, "-v")
        ended, said = killed(folder, kill, after, *command, *jobs)
        finished |= {*re.findall(r"^\[\d+/\d+\] (\w+): ok$", said, re.MULTILINE)}
        count.update({"tried": 1, kill.name: 1, "ended by the signal": ended})
        if i % 3 == 2 or i == tries - 1:
            done = call(folder, *command)
            assert done.returncode == 0, done.stderr
            kept = {*re.findall(r"^(\w+): is kept", done.stderr, re.MULTILINE)}
            assert finished <= kept, f"{finished - kept} had finished"
            parts = re.search(r"(\d+) of \d+ chunks are kept", done.stderr)
            found = numbers(folder / out / "x.h5")
            assert [*found] == [*right], "not in the order of the case file"
            same(found, right)
            nothing_waits(folder / out, "x.h5")
            count["finished cases kept"] += len(kept)
            count["chunks kept"] += int(parts[1]) if parts else 0
            finished = set()
            shutil.rmtree(folder / out)
    return count


# A command in a fork of this process, which has all libraries already.


class Fork(NamedTuple):
    """A process that does something, and the pipe on which it returns that."""

    process: int
    pipe: int

    @classmethod
    def of(cls, action: Callable[[], Any]) -> "Fork":
        """A fork of this process that calls a function without arguments."""
        reader, writer = os.pipe()
        if child := os.fork():
            os.close(writer)
            return cls(child, reader)
        try:
            answer = action()
        except BaseException as error:
            answer = error if isinstance(error, AssertionError) else OSError(repr(error))
        with os.fdopen(writer, "wb") as pipe:
            pickle.dump(answer, pipe)
        os._exit(0)

    def answer(self, seconds: float = 600) -> Any:
        """What the function returns, or the exception that it raises; None if the process dies or
        takes longer. HDF5 may do either on a damaged file."""
        with os.fdopen(self.pipe, "rb") as pipe:
            has_answer = select.select([pipe], [], [], seconds)[0]
            if not has_answer:
                os.kill(self.process, signal.SIGKILL)
            data = pipe.read() if has_answer else b""
        os.waitpid(self.process, 0)
        return pickle.loads(data) if data else None


Ended = tuple[int, list[str], int]
"""The exit status of a command, the lines that it said, and a number that was asked for then."""


def started_fork(
    folder: Path,
    arguments: Sequence[object],
    before: Callable[[], object] = lambda: None,
    after: Callable[[], int] = lambda: 0,
) -> Fork:
    """A command in a process, which `ended` awaits."""

    def command() -> Ended:
        before()
        done = call(folder, *arguments)
        return done.returncode, done.stderr.splitlines(), after()

    return Fork.of(command)


def ended(fork: Fork) -> Ended:
    """How a command in a fork has ended; the status is -1 if its process died."""
    answer = fork.answer()
    if answer is None:
        return -1, [], sys.maxsize
    assert not isinstance(answer, Exception), answer
    assert "Traceback" not in str(answer[1]), answer
    return answer


# A disk that is full.


def fill_disk(folder: Path, tries: int) -> Count:
    """Let no file grow beyond a size, which stands for a full disk: one line, nothing half there,
    and the next run ends."""
    right, count, chance = prepared(folder / "x", classify=False), Count(), random.Random(8)
    size = (folder / "x" / "x.h5").stat().st_size
    for i, out in copies(folder / "x", tries):
        if i % 2:
            (out / "x.h5").unlink()
        most = chance.randrange(500, int(1.3 * size))
        status, said, _ = ended(
            started_fork(out, COMMANDS["run"], partial(limit, resource.RLIMIT_FSIZE, most))
        )
        assert status in (0, 2), said
        assert status == 0 or (len(said) == 1 and "too large" in said[0]), said
        if i % 2 == 0 or status == 0:
            same(numbers(out / "x.h5"), right)
        is_left_right(out, right)
        count.update({"tried": 1, "refused" if status else "ended well": 1})
    return count


# Processes that meet.


def crowds(folder: Path, tries: int) -> Count:
    """Two to twenty commands on one result at once: a run that replaces the cases, and runs,
    classifications and claims, each some time after the first."""
    count, chance = Count(), random.Random(5)
    right = prepared(folder / "right")
    kinds = {
        "run --force": COMMANDS["run"],
        "run": ["run", "x.yaml", "--out", ".", "--quiet"],
        "classify": COMMANDS["classify"],
        "claims": ["claims", "x.h5"],
    }
    for i, out in copies(folder / "right", tries):
        names = ["run --force", *chance.choices([*kinds], k=1 + i % 19)]
        delays = [0.0, *(chance.uniform(0, 0.3) for _ in names[1:])]
        forks = [
            started_fork(out, kinds[name], partial(time.sleep, delay))
            for name, delay in zip(names, delays, strict=True)
        ]
        for name, fork in zip(names, forks, strict=True):
            status, said, _ = ended(fork)
            # A run may end before claims are judged; the labels have gone with the old cases.
            is_late = name == "claims" and "has no labels" in str(said)
            assert status == 0 or is_late, (name, said)
        same(numbers(out / "x.h5"), right)
        nothing_waits(out, "x.h5", "x.yaml")
        size = "2 to 9 processes" if len(names) < 10 else "10 to 20 processes"
        count.update(["tried", size, *names])
    return count


# Bytes that have changed.


def spoil(data: bytearray, how: str, chance: random.Random) -> None:
    """Turn one bit, clear one block of 512 bytes, or cut the end off."""
    place = chance.randrange(len(data))
    if how == "flip":
        data[place] ^= 1 << chance.randrange(8)
    elif how == "clear":
        block = slice(place // 512 * 512, place // 512 * 512 + 512)
        data[block] = bytes(len(data[block]))
    else:
        del data[place:]


def by_xarray(path: Path, names: Sequence[str]) -> Numbers:
    """The numeric arrays of cases in a result, by xarray on netCDF4 or, where h5py is loaded, on
    h5netcdf."""
    import xarray

    found = {}
    for name in names:
        with xarray.open_dataset(path, group=name, engine="h5netcdf", decode_cf=False) as case:
            found[name] = {
                str(key): variable.values
                for key, variable in case.variables.items()
                if variable.ndim and variable.dtype.kind in "fiu"
            }
    return found


def change_bytes(folder: Path, tries: int) -> Count:
    """Flip a bit of a result, clear a block or cut the end off: hodo refuses it in one line, leaves
    it alone and says the way out, or what it prints is right; h5py and xarray never read a number
    that is silently wrong, but zeros of a chunk that is cleared with its checksum."""
    right = prepared(folder / "right")
    # What readers and the command load is loaded here, once for all children.
    by_xarray(folder / "right" / "x.h5", [*right])
    call(folder, "compare", "right/x.h5", "right/x.h5")
    count, chance, spoilt = Count(), random.Random(3), folder / "spoilt.h5"
    readers = {"h5py": numbers, "xarray": partial(by_xarray, names=[*right])}
    for _, how in zip(range(tries), cycle(("flip", "flip", "clear", "cut")), strict=False):
        damaged = bytearray((folder / "right" / "x.h5").read_bytes())
        spoil(damaged, how, chance)
        spoilt.write_bytes(damaged)
        done = Fork.of(partial(call, folder, "compare", "spoilt.h5", "right/x.h5")).answer(20)
        assert isinstance(done, subprocess.CompletedProcess), f"hodo dies or hangs: {done}"
        assert done.returncode in (0, 2), (done.stdout, done.stderr)
        if done.returncode == 2:
            assert len(done.stderr.splitlines()) == 1, done.stderr
            assert "spoilt.h5" in done.stderr, done.stderr
        assert spoilt.read_bytes() == damaged
        count.update(["tried", f"hodo: {'refused' if done.returncode else 'right'}"])
        for reader, read in readers.items():
            found = Fork.of(partial(read, spoilt)).answer(20)
            is_read = isinstance(found, dict)
            for name, arrays in right.items() if is_read else ():
                for key, data in arrays.items():
                    values = found.get(name, {}).get(key)
                    is_same = values is None or np.array_equal(values, data, equal_nan=True)
                    # Of a chunk that is cleared with its checksum: that of zeros is 0.
                    is_cleared = how == "clear" and not (is_same or values[values != data].any())
                    count[f"{reader}: cleared chunks"] += is_cleared
                    says = f"{reader}: {name}/{key} is wrong in silence ({how})"
                    assert is_same or is_cleared, says
            count[f"{reader}: {'right' if is_read else 'refused'}"] += 1
    return count


# The N-th call of the operating system fails, in whatever library it is made.

COMMANDS = {
    "run": ["run", "x.yaml", "--out", ".", "--force", "--quiet"],
    "classify": ["classify", "x.h5"],
    "plot": ["plot", "x.h5", "--format", "png", "--format", "csv", "--out", "figures"],
}


def preloaded(trial: str, folder: Path, *limits: int) -> Count:
    """A trial (`PRELOADED`) in a process in which the library of `faults.c` stands before all
    others."""
    library, source = folder / "faults.so", Path(__file__).with_suffix(".c")
    build = ["gcc", "-O1", "-Wall", "-Werror", "-shared", "-fPIC", "-o", library, source, "-ldl"]
    subprocess.run(build, check=True)
    done = subprocess.run(
        [sys.executable, __file__, trial, library, folder, *map(str, limits)],
        env={**os.environ, "LD_PRELOAD": str(library), "PYTHONPATH": str(source.parent)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    count = Count(json.loads(done.stdout))
    return count + Count({"tried": count.total()})


def fail_calls(folder: Path, most: int, step: int = 1) -> Count:
    """Let the N-th call that reads or writes fail in a run, a classification or figures, once and
    for ever, for every N up to so many, or each `step`-th."""
    return preloaded("calls", folder, most, step)


def lose_power(folder: Path, tries: int) -> Count:
    """Lose the power at so many moments of a first run, of another and of a classification."""
    return preloaded("power", folder, tries)


def calls_fail(library: Path, folder: Path, most: int, step: int) -> Count:
    arm = ctypes.CDLL(str(library)).faults_arm
    before, count = prepared(folder / "plain", SINGLE, classify=False), Count()
    shutil.copytree(folder / "plain", folder / "x")
    for command in ("classify", "plot"):
        assert call(folder / "x", *COMMANDS[command]).returncode == 0
    states = before, numbers(folder / "x" / "x.h5")
    for name in COMMANDS:
        for kind in range(4):
            reads, forever = divmod(kind, 2)
            what = f"{name}: {'reads' if reads else 'writes'} {'for ever' if forever else 'once'}"
            # What a classification writes is looked at most closely: it takes the least time.
            each = max(1, step // 12) if what == "classify: writes once" else step
            for first in range(max(1, each // 2), most + 1, each):
                number = errno.EIO if reads or first % 2 else errno.ENOSPC
                fault = partial(arm, bytes(folder / "work"), first, forever, reads, number)
                calls = one_fails(folder, name, states, fault)
                if calls < first:
                    break
                # HDF5 2.0 ends the process itself where a copy of a group fails.
                count[f"{name}: HDF5 died" if calls == sys.maxsize else what] += 1
            arm(b"", 0, 0, 0, 0)
    return count


def one_fails(
    folder: Path, name: str, states: tuple[Numbers, Numbers], arm: Callable[[], object]
) -> int:
    """One command of which a call fails, and the same that follows it: nothing is lost, or half
    there; `states` are the numbers of the result without labels, and with them. The number of its
    calls."""
    work = folder / "work"
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(folder / "plain", work)
    if name == "plot":
        shutil.copy(folder / "x" / "x.h5", work)
    status, said, count = ended(
        started_fork(work, COMMANDS[name], arm, ctypes.CDLL(None).faults_count)
    )
    assert status in (-1, 0, 2) or (status == 1 and name != "run"), (status, said)
    assert status != 2 or len(said) == 1 or name == "plot", said  # a figure has a line too
    # Without labels, or with all of them; a command that ended well has made them.
    found = numbers(work / "x.h5")
    is_labelled = "enclosed_axis" in found["a"]
    assert is_labelled or name != "classify" or status
    same(found, states[is_labelled], every=True)
    drawn = files_of(folder / "x" / "figures")
    half = [path for path, data in files_of(work / "figures").items() if drawn[path] != data]
    assert not half, half
    again = call(work, *COMMANDS[name])
    assert again.returncode == 0, (said, again.stderr)
    same(numbers(work / "x.h5"), states[0])
    nothing_waits(work, "x.h5", "x.yaml", *(["figures"] * (name == "plot")))
    assert name != "plot" or files_of(work / "figures") == drawn
    return count


def files_of(folder: Path) -> dict[Path, bytes]:
    """The pictures and tables below a folder."""
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix in (".png", ".csv")
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
            self.names[path] = names_after(*self.names[path]), []
        elif call.what == "sync":
            self.bytes[call.inode] = bytes_after(*self.bytes[call.inode]), []
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
        for name, inode in names_after(synced, of_names(changes)).items():
            if inode in self.folders:
                self.start_again(target / name, of_names, of_bytes, self.folders[inode])
            else:
                synced_bytes, writes = self.bytes[inode]
                (target / name).write_bytes(bytes_after(synced_bytes, of_bytes(writes)))


def names_after(names: dict[str, int], changes: list[tuple[str, int | None]]) -> dict[str, int]:
    """The names in a folder after some changes."""
    new: dict[str, int | None] = {**names, **dict(changes)}
    return {name: inode for name, inode in new.items() if inode is not None}


def bytes_after(content: bytes, writes: list[Call]) -> bytes:
    """What is in a file after some writes."""
    data = bytearray(content)
    for write in writes:
        end = write.offset + len(write.data)
        data.extend(bytes(max(end - len(data), 0)))
        if write.what == "cut":
            del data[write.offset :]
        data[write.offset : end] = write.data
    return bytes(data)


def power_fails(library: Path, folder: Path, tries: int) -> Count:
    """Lose the power after so many random calls of a command and, each time, all that was not
    synced, all but names, nothing, or what chance takes: the next run gives the right result, and a
    result that was there is never gone. At the end of a command its result is on the disk."""
    right, count = prepared(folder / "x", SINGLE, classify=False), Count()
    written(folder / "new", SINGLE)
    chance = random.Random(7)
    for start, command in (("new", "run"), ("x", "run"), ("x", "classify")):
        work, log, after = (folder / name for name in ("work", "log", "after"))
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(folder / start, work)
        log.write_bytes(b"")
        disk, begin = PowerlessDisk(work), ctypes.CDLL(str(library)).faults_log
        before = partial(begin, bytes(work), bytes(log))
        assert ended(started_fork(work, COMMANDS[command], before))[0] == 0
        calls = [*calls_in(log.read_bytes())]
        last = {*chance.sample(range(len(calls)), min(tries, len(calls))), len(calls)}
        for number in range(len(calls) + 1):
            for state, choices in states(chance).items() if number in last else ():
                shutil.rmtree(after, ignore_errors=True)
                disk.start_again(after, *choices)
                is_done = number == len(calls)
                case = f"{command} on {start}, {state} after {number} of {len(calls)} calls"
                if start != "new" or is_done:
                    same(numbers(after / "x.h5"), right)
                if command == "classify" and is_done:
                    assert "enclosed_axis" in numbers(after / "x.h5")["a"], case
                is_left_right(after, right, case)
                count[f"{command} on {start}: {state}"] += 1
            for one in calls[number : number + 1]:
                disk.apply(one)
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


# Sources that change during a run.

EDIT = """
_before = LinearDiag.rhs
LinearDiag.rhs = staticmethod(lambda t, y, k: tuple(1.25 * v for v in _before(t, y, k)))
"""
"""What is added to the source of a model, so that it computes other numbers."""


def edit_code(folder: Path, tries: int) -> Count:
    """Edit the source of a model at a random moment of a run: every case that is stored has the
    numbers that belong to its hash, and the next run has those of the new source."""
    package = Path(__file__).parents[1] / "hodo_cli"
    shutil.copytree(package, folder / "hodo_cli", ignore=shutil.ignore_patterns("__pycache__"))
    source = folder / "hodo_cli" / "models" / "body.py"
    written(folder, PAIR)
    old, count, chance = source.read_text(), Count(), random.Random(6)

    def run(out: str, edited_after: float = 0.0, jobs: int = 1) -> int:
        command = [sys.executable, "-m", "hodo_cli.cli", "run", "x.yaml", "--quiet", "--out", out]
        options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen([*command, "-j", str(jobs)], cwd=folder, **options) as process:
            if edited_after:
                time.sleep(edited_after)
                source.write_text(old + EDIT)
            said = process.communicate()[1]
        assert process.returncode in (0, 2), said
        assert len(said.splitlines()) == (process.returncode == 2), said
        return process.returncode

    motions: dict[str, np.ndarray] = {}
    for text in (old, old + EDIT):
        source.write_text(text)
        began = time.monotonic()
        assert run("right") == 0
        took, newest = time.monotonic() - began, by_hash(folder / "right" / "x.h5")
        motions |= newest
    for i in range(tries):
        source.write_text(old)
        status = run(f"run{i}", took * chance.uniform(0.1, 1), 1 + i % 2)
        result = folder / f"run{i}" / "x.h5"
        stored = by_hash(result) if result.exists() else {}
        for mark, omega in stored.items():
            assert np.array_equal(omega, motions[mark]), f"run{i}: stale"
        count.update(["tried", "refused" if status else "ended well"])
        assert run(f"run{i}") == 0
        assert by_hash(result).keys() == newest.keys()
    return count


def by_hash(path: Path) -> dict[str, np.ndarray]:
    """The motions in a result by the hashes of their cases."""
    with h5py.File(path) as file:
        return {str(x.attrs["hash"]): x["omega"][()] for x in file.values() if "omega" in x}


PRELOADED = {"calls": calls_fail, "power": power_fails}

if __name__ == "__main__":
    trial, library, folder, *limits = sys.argv[1:]
    print(json.dumps(PRELOADED[trial](Path(library), Path(folder), *map(int, limits))))
