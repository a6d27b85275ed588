"""Batches: several processes, failing cases, dying workers, and what is said meanwhile."""

import itertools
import json
import os
import pty
import select
import subprocess
import sys
import termios
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import BODY, FIG4, Hodo, call, process_state, wait_until
from tasks import stay, tell, troubled

import hodo_cli
from hodo_cli import Case, HodoError, progress
from hodo_cli.batch import Pool
from hodo_cli.commands import run as run_command
from hodo_cli.storage import Group

pytestmark = pytest.mark.process


CONFIG = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 400, samples: 21},
           initial: {p: 0.8, q: 0.5, r: 0.74}}
cases:
  a: {damping: [0.005, 0.004, 0.003]}
  b: {damping: [0.003, 0.004, 0.005]}
  c: {damping: [0.003, 0.003, 0.005]}
  d: {damping: 0.01}
"""
POLE = "model: torques, expression: ['p/(5 - t)', 0, 0]"
FAILING = CONFIG.replace("c: {", "c: {max_steps: 2, ").replace(
    "damping: [0.003, 0.004, 0.005]", POLE
)


def test_every_task_comes_back_and_a_dead_worker_costs_its_own(tmp_path: Path) -> None:
    """Of its task, tried twice beside other tasks and once alone."""
    special = ["dies once", "raises", "dies", "is odd"]
    with Pool(2) as workers:
        given = [(tmp_path, what) for what in [*range(10), *special, *range(10, 20)]]
        found = {what: done for (_, what), done in workers.map(troubled, given)}
        again = list(workers.map(abs, [-1]))
    assert {n: found[n] for n in range(20)} == {n: n for n in range(20)}
    assert isinstance(found["raises"], ValueError)
    assert isinstance(found["is odd"], Exception)
    assert isinstance(found["dies"], HodoError)
    assert "died" in str(found["dies"])
    # A worker may die with another one's task beside its own, before that has begun.
    assert (tmp_path / "dies").read_text() in ("xx", "xxx")
    assert found["dies once"] == "dies once"
    assert again == [(-1, 1)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_are_taken_when_they_are_needed(jobs: int) -> None:
    taken: list[int] = []

    def supply() -> Iterator[int]:
        for task in itertools.count(10):
            taken.append(task)
            yield task

    with Pool(jobs) as workers:
        for done, _ in enumerate(workers.map(abs, supply()), 1):
            assert len(taken) - done < 2 * jobs
            if done == 20:
                break


def test_what_still_runs_is_given_up_at_the_end(tmp_path: Path) -> None:
    with Pool(2) as workers:
        next(workers.map(stay, [(0, tmp_path), *((120, tmp_path),) * 3]))
    for file in tmp_path.glob("process *"):
        process = int(file.name.removeprefix("process "))
        wait_until(lambda process=process: process_state(process) in ("", "Z"))
    assert [file.name for file in tmp_path.glob("after *")] == ["after 0"]


ENDED_EARLY = """\
from hodo_cli.batch import Pool
from tasks import large

with Pool(2) as pool:
    next(pool.map(large, range(8)))
"""


def test_a_pool_ends_while_its_workers_write_their_results() -> None:
    """In a process of its own, which a pool that waits for ever does not hold."""
    subprocess.run(
        [sys.executable, "-c", ENDED_EARLY], cwd=Path(__file__).parent, timeout=60, check=True
    )


def test_what_a_task_prints_is_no_answer(capfd: pytest.CaptureFixture[str]) -> None:
    """Nor a part of a table or of JSON, which go to the output of the command."""
    with Pool(2) as workers:
        assert dict(workers.map(tell, ["said", "ready"])) == {"said": "", "ready": ""}
    printed = capfd.readouterr()
    assert printed.out == ""
    assert "said" in printed.err


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "four.yaml"
    path.write_text(CONFIG)
    return path


def run(config: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`hodo run` in this process, its results beside the config."""
    return call(config.parent, "run", config, "--out", config.parent, *arguments)


def everything(path: Path) -> dict[str, object]:
    """All attributes and values in a file but for times and history."""
    found: dict[str, object] = {}

    def look(name: str, item: h5py.HLObject) -> None:
        # `listed` repeats short attributes, the run time among them.
        varying = {"run_time", "listed", "stamp", "history", "DIMENSION_LIST", "REFERENCE_LIST"}
        found.update({f"{name}.{key}": str(item.attrs[key]) for key in {*item.attrs} - varying})
        if isinstance(item, h5py.Dataset):
            found[name] = item[()].tolist(), item.dtype.str

    with h5py.File(path) as file:
        look("", file)
        file.visititems(look)
        found["order"] = list(file)
    return found


def test_processes_give_what_one_gives(config: Path) -> None:
    config.write_text(FAILING)
    folders = {jobs: config.parent / jobs for jobs in "12"}
    for jobs, folder in folders.items():
        assert run(config, "--out", str(folder), "-j", jobs).returncode == 1
    serial, parallel = (everything(folder / "four.h5") for folder in folders.values())
    assert serial == parallel
    assert serial["order"] == ["a", "b", "c", "d"]


def test_the_digits_do_not_depend_on_the_number_of_threads(config: Path, hodo: Hodo) -> None:
    """Of several processors; on one there is nothing to see."""
    keys = {"model": "torques", "damping": 0.01, "attitude": "yes", "method": "collocation"}
    config.write_text(json.dumps({"cases": {"a": BODY | keys | {"time": {"end": 20}}}}))
    unset = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    for out, threads in (("any", {}), ("one", {"OPENBLAS_NUM_THREADS": "1"})):
        done = hodo("run", config, "--out", out, env={**unset, **threads})
        assert done.returncode == 0, done.stderr
    several, single = (everything(config.parent / out / "four.h5") for out in ("any", "one"))
    assert several == single


def test_failures_are_said_at_once_and_at_the_end(config: Path) -> None:
    config.write_text(FAILING)
    done = run(config, "-v")
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert lines[:4] == [f"{name}: will run: it has no result yet" for name in "abcd"]
    assert lines[4] == "[1/4] a: ok"
    assert lines[5].startswith("[2/4] b: failed: its formulas are not smooth near t = ")
    assert lines[6].startswith("[3/4] c: timeout: max_steps: stopped after 2 steps")
    assert lines[7] == "[4/4] d: ok"
    assert lines[8] == "2 of 4 cases did not end well: b (failed), c (timeout)"
    methods = call(config.parent, "show", "--methods", config.with_suffix(".h5")).stdout
    assert "Left out, since they did not end well: b, c." in " ".join(methods.split())
    again = run(config, "-v")
    planned = [line for line in again.stderr.splitlines()[:4] if "kept" not in line]
    expected = {"b": "failed", "c": "timeout"}.items()
    assert planned == [f"{name}: will run: its status is {status}" for name, status in expected]
    said = [line[:8] for line in run(config).stderr.splitlines()]
    assert said == ["[1/2] b:", "[2/2] c:", "2 of 4 c"]


def test_a_bug_in_one_case_is_that_case_s_own(config, monkeypatch):
    finish = run_command.finished_case

    def buggy(case: Case) -> Group:
        return finish(case) if case.name != "b" else 1 / 0  # type: ignore[return-value]

    monkeypatch.setattr(run_command, "finished_case", buggy)
    done = run(config)
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    with h5py.File(config.with_suffix(".h5")) as file:
        assert [str(case.attrs["status"]) for case in file.values()] == ["ok", "failed", "ok", "ok"]
        assert file["b"].attrs["message"] == "ZeroDivisionError: division by zero"


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_fail_fast_leaves_what_it_does_not_reach(config: Path, jobs: str) -> None:
    run(config)
    with h5py.File(config.with_suffix(".h5")) as file:
        before = file["d/omega"][()]
    config.write_text(FAILING.replace("d: {", "d: {tol: 1e-14, "))
    done = run(config, "--fail-fast", "-j", jobs)
    assert done.returncode == 1
    assert "1 of" in done.stderr
    with h5py.File(config.with_suffix(".h5")) as file:
        assert list(file) == ["a", "b", "c", "d"]
        assert np.array_equal(file["d/omega"], before)
    assert "c: will run" in run(config, "--dry-run").stdout
    if jobs == "1":
        assert "d: will run: its case has changed" in run(config, "--dry-run").stdout


def test_several_configs_are_run_but_those_without_a_case_asked_for(config: Path) -> None:
    other = config.with_name("other.yaml")
    other.write_text(CONFIG.replace("  a:", "  other:"))
    assert run(config, str(other), "--case", "other").returncode == 0
    assert not config.with_suffix(".h5").exists()
    assert run(config, str(other), "-j", "2").returncode == 0
    assert config.with_suffix(".h5").exists()


@pytest.mark.parametrize("bare", ["", "1"])
def test_a_terminal_shows_problems_in_colour_unless_told_not_to(config: Path, bare: str) -> None:
    config.write_text(FAILING)
    terminal, end = pty.openpty()
    environment = {**os.environ, "NO_COLOR": bare}
    command = [sys.executable, "-m", "hodo_cli.cli", "run", config, "--out", config.parent]
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=end, env=environment, check=False)
    os.close(end)
    said = b"".join(iter(lambda: read(terminal), b"")).decode()
    os.close(terminal)
    assert "a: ok" not in said  # as a pipe would get
    assert ("\x1b[31m" in said) == (not bare)


def read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 1 << 16)
    except OSError:  # Linux's end of file
        return b""


@pytest.mark.parametrize(("jobs", "share"), [("1", ""), ("2", " for each of 2 processes")])
def test_what_does_not_fit_into_memory_is_refused_with_the_figure(config, jobs, share):
    done = run(config, "--set", "c.time.samples=1000000000", "-j", jobs)
    assert done.returncode == 2
    place, _, message = done.stderr.partition(": cases.c.time.samples: ")
    assert place == "--set c.time.samples=1000000000"
    assert message.startswith("1,000,000,000 samples would take about 450 GB of memory, and there")
    assert done.stderr.endswith(share + "\n")
    assert os.listdir(config.parent) == ["four.yaml"]


# What is said of the work while it goes on.


class Terminal:
    """A terminal that stands for stderr, and what has come to it."""

    def __init__(self) -> None:
        self.ours, theirs = pty.openpty()
        termios.tcsetwinsize(theirs, (24, 80))
        self.file = os.fdopen(theirs, "w")
        self.text = ""

    def wait_for(self, words: str) -> None:
        """Read until these words have come."""
        end = time.monotonic() + 60
        while words not in self.text:
            assert time.monotonic() < end, self.text
            assert select.select([self.ours], [], [], 60)[0], self.text
            self.text += os.read(self.ours, 4096).decode()


def shown_on_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """The terminal of this process, with what a bar shows shown at once."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal.file)
    monkeypatch.setattr(progress, "SECONDS_HIDDEN", 0.0)
    monkeypatch.setattr(progress, "TICK_SECONDS", 0.01)
    return terminal


def test_a_terminal_shows_what_runs_and_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = shown_on_terminal(monkeypatch)
    monkeypatch.setattr(warnings, "showwarning", lambda said, *_: print(said, file=terminal.file))
    with progress.Progress(4) as shown:
        shown.report("fig4", 0.75)
        terminal.wait_for("| 19 %, ")
        terminal.wait_for("fig4 75 %")
        shown.done("fig4")
        terminal.wait_for("1/4")
        shown.say("a line of its own")
        terminal.wait_for("\ra line of its own")
        warnings.warn("mind this", stacklevel=1)
        terminal.wait_for("\rmind this")
        shown.done("fig5", "it failed")
        terminal.wait_for("\r[2/4] fig5: \x1b[31mit failed")
        terminal.wait_for("2/4 |")
    print("end", file=terminal.file, flush=True)
    terminal.wait_for("end")
    *_, cleared, end = terminal.text.split("\r")[:-1]
    assert (cleared.strip(" "), end) == ("", "end")


def test_a_terminal_of_unknown_width_shows_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = shown_on_terminal(monkeypatch)
    termios.tcsetwinsize(terminal.file.fileno(), (0, 0))
    with progress.Progress(4) as shown:
        assert list(shown.starting(["fig4", "fig5"])) == ["fig4", "fig5"]
        terminal.wait_for("fig4, fig5")


class Heard(progress.Progress):
    """Notes what is reported."""

    def __init__(self, total: int) -> None:
        super().__init__(total, quiet=True)
        self.heard: list[tuple[str, float]] = []

    def report(self, name: str, share: float) -> None:
        self.heard.append((name, share))


def test_each_item_is_a_task_of_its_own() -> None:
    shown = Heard(2)
    for item in shown.through(["a", "b"], str.upper):
        assert item.islower()
        assert shown.heard[-1] == (item.upper(), 0.0)
    assert shown.heard == [("A", 0.0), ("B", 0.0)]


def test_a_sweep_says_how_far_it_is_chunk_by_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Heard(1)
    monkeypatch.setattr(progress.Progress, "report", lambda _, *said: shown.report(*said))
    case = FIG4 | {"initial": {"p": 0, "q": 0, "G": 1}, "time": {"end": 10, "samples": 2}}
    case["sweep"] = {"from": {"sphere": {"count": 600}}}
    hodo_cli.sweep(case | {"error": "off"}, name="ball")
    assert shown.heard == [("ball", i / 3) for i in range(4)]
    shown.heard.clear()
    hodo_cli.sweep(case, name="ball")
    shares = [share for _, share in shown.heard]
    assert len(shares) > 4  # measuring errors has tasks of its own
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


def test_pipes_stay_clean(hodo: Hodo, tmp_path: Path) -> None:
    assert call(tmp_path, "init", "a").returncode == 0
    done = hodo("run", "a.yaml")
    assert (done.stderr, len(done.stdout.splitlines())) == ("", 3)
    why, *_, end = call(tmp_path, "run", "a.yaml", "--force", "-v").stderr.splitlines()
    assert why.endswith("will run: --force")
    assert end.endswith(": ok")
    assert not call(tmp_path, "classify", "runs/a.h5").stderr
    assert not hodo("plot", "runs/a.h5").stderr


def test_a_log_that_takes_nothing_stops_nothing(hodo: Hodo, tmp_path: Path) -> None:
    assert call(tmp_path, "init", "a").returncode == 0
    broken = ("--set", "staying.method=taylor", "--set", "staying.max_steps=1", "--out", ".")
    with open("/dev/full", "w") as full:
        streams = {"capture_output": False, "stdout": subprocess.PIPE, "stderr": full}
        done = hodo("run", "-v", "a.yaml", *broken, **streams)
        assert (done.returncode, len(done.stdout.splitlines())) == (1, 3)
        (result,) = tmp_path.glob("a,*.h5")
        done = hodo("classify", result, **streams)
        assert (done.returncode, len(done.stdout.splitlines())) == (0, 3)
