"""Kills `hodo run` and `hodo classify` at random moments, and runs many cases: nothing finished is
lost, nothing slow.

`python tests/stress.py [KILLS [CLASS...]]` does so many kills of each command (default 150), and as
many trials of the other classes of faults, and prints a table of what it counted.
"""

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle, islice
from pathlib import Path
from unittest.mock import patch

import faults
import h5py
import numpy as np

from hodo_cli.storage import hdf5

HODO = [sys.executable, "-m", "hodo_cli.cli"]
CASES = 16
CASE = "  c{0}: {{damping: [0.005, 0.004, 0.00{1}], initial: {{p: 0.8, q: 0.{2}, r: 0.74}}}}\n"
CONFIG = (
    "defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 1000, samples: 2001}}\n"
    "cases:\n"
) + "".join(CASE.format(i, i % 9 + 1, i + 1) for i in range(CASES))
SIGNALS = {signal.SIGKILL: (-9,), signal.SIGTERM: (143, -15), signal.SIGINT: (130, -2)}
"""What a command returns that a signal ended: a process that has not come so far as to catch it
dies of it."""

QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
PACKAGE = Path(faults.__file__).parents[1] / "hodo_cli"

READ_BY_XARRAY = """\
import sys, xarray
for path in sys.argv[1:]:
    with xarray.open_datatree(path, engine="netcdf4") as tree:
        tree.load()
"""


def hodo(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A command that is not killed, and ends well."""
    done = subprocess.run(
        [*HODO, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


def killed(folder: Path, kill: signal.Signals, after: float, *arguments: str) -> tuple[bool, str]:
    """A command that gets a signal after so many seconds: whether this was its end, and what it has
    said.

    Ctrl-C goes to its workers too, as on a terminal; the other signals to the command alone.
    """
    with subprocess.Popen(
        [*HODO, *arguments], cwd=folder, start_new_session=True, **QUIET
    ) as process:
        time.sleep(after)
        (os.killpg if kill == signal.SIGINT else os.kill)(process.pid, kill)
        said = process.communicate()[1]
    assert process.returncode in (0, *SIGNALS[kill]), (process.returncode, said)
    if process.returncode >= 0:
        assert "Traceback" not in said, said
        assert ("interrupted" in said) == (process.returncode > 0), said
    assert not survivors(process.pid), "workers outlive the command"
    return process.returncode != 0, said


def survivors(session: int) -> list[int]:
    """The processes of a session that are still there after a minute."""
    deadline = time.monotonic() + 60
    while (alive := members(session)) and time.monotonic() < deadline:
        time.sleep(0.01)
    return alive


def members(session: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            pid, fields = stat.parent.name, stat.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(pid))
    return found


def content(path: Path) -> dict[str, np.ndarray]:
    """The motions in a result file, all of it read."""
    with h5py.File(path, "r") as file:
        file.visititems(lambda name, item: item[()] if isinstance(item, h5py.Dataset) else None)
        return {name: case["omega"][()] for name, case in file.items()}


def whole(folder: Path, motions: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The finished cases in a folder, published or not, each of which must be one of these
    motions."""
    found = {}
    for path in [*folder.glob(".*.partial/[0-9]*.h5"), *folder.glob("*.h5")]:
        for name, omega in content(path).items():
            assert np.array_equal(omega, motions[name]), f"{path}: {name} is not what it was"
            found[name] = omega
    return found


def read_by_xarray(paths: list[Path]) -> None:
    """Read whole files with xarray, in a process that does not load h5py."""
    subprocess.run([sys.executable, "-c", READ_BY_XARRAY, *map(str, paths)], check=True)


def prepared(folder: Path) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """The right result in folder/right, and the seconds that each command takes when it is left
    alone."""
    (folder / "right").mkdir()
    (folder / "many.yaml").write_text(CONFIG)
    took = {}
    for name, arguments in {
        "run": ["run", "many.yaml", "--out", "right"],
        "classify": ["classify", "c.h5"],
    }.items():
        if name == "classify":
            shutil.copy(folder / "right" / "many.h5", folder / "c.h5")
        began = time.monotonic()
        hodo(folder, *arguments)
        took[name] = time.monotonic() - began
    return content(folder / "right" / "many.h5"), took


def moments(kills: int, took: float) -> Iterator[tuple[signal.Signals, float]]:
    """Signals in turn, at random moments from the time when a command has loaded its modules to its
    end."""
    chance = random.Random(1)
    return ((kill, took * chance.uniform(0.2, 1.1)) for kill in islice(cycle(SIGNALS), kills))


def kill_runs(folder: Path, kills: int) -> Counter[str]:
    """Kill runs, serial and parallel, three times in a row from nothing; each fourth is left to
    finish the work."""
    motions, took = prepared(folder)
    count: Counter[str] = Counter()
    finished: set[str] = set()
    published = []
    for i, (kill, after) in enumerate(moments(kills, took["run"])):
        out = folder / f"run{i // 3}"
        out.mkdir(exist_ok=True)
        ended, said = killed(
            folder,
            kill,
            after,
            "run",
            "many.yaml",
            "--out",
            out.name,
            "-v",
            *(("-j", "2") if i % 2 else ()),
        )
        finished |= set(re.findall(r"^\[\d+/\d+\] (\w+): ok$", said, re.MULTILINE))
        found = whole(out, motions)
        assert finished <= set(found), f"{finished - set(found)} had finished"
        count.update(
            {
                **{"tried": 1, kill.name: 1, "ended by the signal": ended},
                "finished cases found again": len(found),
            }
        )
        if i % 3 == 2 or i == kills - 1:
            said = hodo(folder, "run", "many.yaml", "--out", out.name, "-v").stderr
            assert all(f"{name}: is kept" in said for name in found), said
            assert os.listdir(out) == ["many.h5"], "something is left over"
            assert list(content(out / "many.h5")) == list(motions)
            published.append(out / "many.h5")
            finished = set()
    read_by_xarray(published)
    return count + Counter({"files whole": len(published)})


def kill_classifications(folder: Path, kills: int) -> Counter[str]:
    """Kill `classify` on a file of finished cases; every third time it is left to finish."""
    motions, took = prepared(folder)
    count: Counter[str] = Counter()
    files = []
    for i, (kill, after) in enumerate(moments(kills, took["classify"])):
        out = folder / f"classify{i}"
        shutil.copytree(folder / "right", out)
        ended, _ = killed(folder, kill, after, "classify", f"{out.name}/many.h5")
        assert list(whole(out, motions)) == list(motions)
        count.update({"tried": 1, kill.name: 1, "ended by the signal": ended, "files whole": 1})
        shutil.copy(out / "many.h5", folder / f"after{i}.h5")
        files.append(folder / f"after{i}.h5")
        if i % 3 == 2:
            hodo(folder, "classify", f"{out.name}/many.h5")
            assert os.listdir(out) == ["many.h5"], "something is left over"
            with h5py.File(out / "many.h5") as file:
                assert all("crossing_time" in case for case in file.values())
        shutil.rmtree(out)
    read_by_xarray(files)
    return count


def many_cases(folder: Path, many: int = 10000) -> Counter[str]:
    """Time of this machine's processors for each of many cases in one file and of a hundred, and to
    show them."""
    chance = random.Random(2)
    each = {}
    for count in (1, 101, many):
        lines = (
            f"  c{i}: {{damping: [{chance.uniform(1, 5) / 1000}, 0.004, 0.003]}}\n"
            for i in range(count)
        )
        defaults = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}"
        text = f"defaults: {{{defaults}, time: {{end: 400, samples: 101}}}}\ncases:\n" + "".join(
            lines
        )
        (folder / f"x{count}.yaml").write_text(text)
        each[count] = processor_time(folder, "run", f"x{count}.yaml", "--quiet")
    few, all_of_them = (each[101] - each[1]) / 100, (each[many] - each[1]) / many
    show = processor_time(folder, "show", f"runs/x{many}.h5")
    again = processor_time(folder, "run", f"x{many}.yaml", "--quiet")
    assert all_of_them < 2 * few, (all_of_them, few)
    # A line takes some 1.3 ms: of HDF5, to find a group and read ten attributes, two thirds.
    assert show < 0.002 * many, show
    figures = {"us a case of 100": few * 1e6, f"us a case of {many}": all_of_them * 1e6}
    figures |= {"ms to show them": show * 1e3, "ms to find nothing to do": again * 1e3}
    return Counter({"tried": many} | {name: round(figure) for name, figure in figures.items()})


def processor_time(folder: Path, *arguments: str) -> float:
    """Seconds of processor time that a command takes: unlike the time on the wall, other work does
    not change it."""
    before = os.times()
    hodo(folder, *arguments)
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


def change_bytes(folder: Path, tries: int, sealed: bool = False) -> Counter[str]:
    """Flip a bit of a result, clear a block of 512 bytes or cut the end off, so often each; a
    `sealed` file has a stranger's checksum, which fits."""
    right, count = faults.prepared(folder), Counter[str]()
    sound, chance = (folder / "x.h5").read_bytes(), random.Random(3)
    with patch.object(hdf5, "PATIENCE_OF_READER", 1.0):  # some hang the reader
        for spoil in (faults.flipped, faults.zeroed, faults.truncated):
            for _ in range(tries):
                (folder / "x.h5").write_bytes(sound)
                spoil(folder / "x.h5", chance)
                if sealed:
                    faults.sealed_by_a_stranger(folder / "x.h5")
                kind = f"{spoil.__name__}: {faults.right_or_named(folder / 'x.h5', right)}"
                count.update({"tried": 1, kind: 1})
    return count


def strangers_files(folder: Path, tries: int) -> Counter[str]:
    """As `change_bytes`, under a checksum that a stranger has made."""
    return change_bytes(folder, tries, sealed=True)


def fail_calls(folder: Path, most: int) -> Counter[str]:
    """Let the N-th call of a run, a classification or figures fail, once and for ever, for every N
    up to so many, in whatever library it is made."""
    return tried(faults.preloaded(faults.compiled(folder), "calls", folder, most))


def lose_power(folder: Path, tries: int) -> Counter[str]:
    """Lose the power at so many moments of a first run, of another and of a classification."""
    return tried(faults.preloaded(faults.compiled(folder), "power", folder, tries))


def tried(counts: dict[str, int]) -> Counter[str]:
    """Counts of trials by their kinds, with their sum."""
    return Counter({"tried": sum(counts.values()), **counts})


def crowds(folder: Path, tries: int) -> Counter[str]:
    """Two to twenty commands on one result at once: a run that replaces the cases, and runs,
    classifications and claims, each some time after the first."""
    count, chance = Counter[str](), random.Random(5)
    right = faults.prepared(folder / "right")
    for i in range(tries):
        shutil.copytree(folder / "right", out := folder / f"crowd{i}")
        run = ["run", out / "x.yaml", "--out", out, "--quiet"]
        kinds = {
            "run --force": [*run, "--force"],
            "run": run,
            "classify": ["classify", out / "x.h5"],
            "claims": ["claims", out / "x.h5"],
        }
        names = ["run --force", *chance.choices([*kinds], k=1 + i % 19)]
        reports = [folder / f"said{j}" for j in range(len(names))]
        delays = [0.0, *(chance.uniform(0, 0.3) for _ in names[1:])]
        children = [
            faults.forked(report, kinds[name], partial(time.sleep, delay))
            for report, name, delay in zip(reports, names, delays, strict=True)
        ]
        for child, name, report in zip(children, names, reports, strict=True):
            status, said, _ = faults.ended(child, report)
            # A run may end before claims are judged; the labels have gone with the old cases.
            is_late = name == "claims" and "has no labels" in str(said)
            assert status == 0 or is_late, said
        faults.equal(faults.motions(out / "x.h5"), right)
        assert sorted(os.listdir(out)) == ["x.h5", "x.yaml"]
        shutil.rmtree(out)
        count.update(
            ["tried", "2 to 9 processes" if len(names) < 10 else "10 to 20 processes", *names]
        )
    return count


EDIT = """
_before = LinearDiag.rhs
LinearDiag.rhs = staticmethod(lambda t, y, k: tuple(1.25 * v for v in _before(t, y, k)))
"""
"""What is added to the source of a model, so that it computes other numbers."""


def edit_code(folder: Path, tries: int) -> Counter[str]:
    """Edit the source of a model at a random moment of a run: every case that is stored has the
    numbers that belong to its hash, and the next run has those of the new source."""
    shutil.copytree(PACKAGE, folder / "hodo_cli", ignore=shutil.ignore_patterns("__pycache__"))
    source = folder / "hodo_cli" / "models" / "linear_diag.py"
    (folder / "x.yaml").write_text(faults.SMALL)
    command = [*HODO, "run", "x.yaml", "--quiet", "--out"]

    def run(out: str, edited_after: float = 0.0, jobs: int = 1) -> tuple[int, str]:
        with subprocess.Popen([*command, out, "-j", str(jobs)], cwd=folder, **QUIET) as process:
            if edited_after:
                time.sleep(edited_after)
                source.write_text(new)
            said = process.communicate()[1]
        assert process.returncode in (0, 2), said
        assert len(said.splitlines()) == (process.returncode == 2), said
        return process.returncode, said

    count, chance = Counter[str](), random.Random(6)
    old = source.read_text()
    new = old + EDIT
    motions: dict[str, dict[str, np.ndarray]] = {}
    for text in (old, new):
        source.write_text(text)
        began = time.monotonic()
        assert run("right")[0] == 0
        took = time.monotonic() - began
        motions |= by_hash(folder / "right")
    newest = by_hash(folder / "right")
    for i in range(tries):
        source.write_text(old)
        status, _ = run(f"run{i}", took * chance.uniform(0.1, 1), 1 + i % 2)
        stored = by_hash(folder / f"run{i}")
        for mark, omega in stored.items():
            assert np.array_equal(omega, motions[mark]), f"run{i}: stale"
        count["tried"] += 1
        which = "none" if not stored else "new" if stored.keys() & newest.keys() else "old"
        count[f"{'refused' if status else 'ended'}, {which} stored"] += 1
        if i % 4 == 3:
            assert run(f"run{i}")[0] == 0
            assert by_hash(folder / f"run{i}").keys() == newest.keys()
    return count


def by_hash(folder: Path) -> dict[str, np.ndarray]:
    """The motions that are stored in a folder, published or not, by the hashes of their cases."""
    found = {}
    for path in [*folder.glob(".*.partial/[0-9]*.h5"), *folder.glob("*.h5")]:
        with h5py.File(path) as file:
            found |= {str(case.attrs["hash"]): case["omega"][()] for case in file.values()}
    return found


CLASSES: dict[Callable[[Path, int], Counter[str]], int] = {
    **{kill_runs: 1, kill_classifications: 1, change_bytes: 1, strangers_files: 1},
    **{fail_calls: 10, lose_power: 1, crowds: 1, edit_code: 1, many_cases: 67},
}
"""What goes wrong, and how many trials there are of it for one kill."""


def row(name: str, kills: int) -> tuple[bool, str]:
    """Whether a class of faults cost nothing, and its line of the table."""
    function = next(function for function in CLASSES if function.__name__ == name)
    began, problem, count = time.monotonic(), "", Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        try:
            count = function(Path(folder), CLASSES[function] * kills)
        except (AssertionError, subprocess.CalledProcessError) as error:
            traceback.print_exc()
            problem = str(error).partition("\n")[0] or "a failed assertion"
    trials, seconds = count.pop("tried", 0), time.monotonic() - began
    kinds = ", ".join(f"{number} {kind}" for kind, number in count.items())
    return not problem, (
        f"| {name.replace('_', ' ')} | {trials} | {problem or 0} | {kinds} | {seconds:.0f} |"
    )


if __name__ == "__main__":
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    print("| class | tried | lost or wrong | of which | s |\n|---|---|---|---|---|")
    names = sys.argv[2:] or [function.__name__ for function in CLASSES]
    with tempfile.TemporaryDirectory() as state:
        os.environ["XDG_STATE_HOME"] = state  # where the secret is
        rows = []
        for name in names:
            rows.append(row(name, kills))
            print(rows[-1][1], flush=True)
    sys.exit(not all(is_sound for is_sound, _ in rows))
