"""Batches: several processes, failing cases, dying workers, what is said meanwhile, kills, and what
a rerun keeps."""

import itertools
import os
import pty
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import stress
from click.testing import CliRunner, Result
from conftest import Hodo, exit_status, in_child, process_state, wait_until
from tasks import stay, tell, troubled, worker

from hodo_cli import Case, HodoError
from hodo_cli.batch import memory
from hodo_cli.batch import pool as pools
from hodo_cli.batch.pool import pool
from hodo_cli.batch.processes import Processes
from hodo_cli.cases.config import parse
from hodo_cli.cli import main
from hodo_cli.commands import run as run_command
from hodo_cli.storage.group import Group
from hodo_cli.storage.writer import Writer, compose

pytestmark = pytest.mark.process

KEPT = "is kept: nothing that it depends on has changed"
DEFAULTS = (
    "defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 400, samples: 21},"
    " initial: {p: 0.8, q: 0.5, r: 0.74}}\n"
)
CONFIG = (
    DEFAULTS
    + """\
cases:
  a: {damping: [0.005, 0.004, 0.003]}
  b: {damping: [0.003, 0.004, 0.005]}
  c: {damping: [0.003, 0.003, 0.005]}
  d: {damping: 0.01}
"""
)
HUGE = "model: torques, expression: ['1e306*t', 0, 0], method: LSODA"
FAILING = CONFIG.replace("damping: [0.003, 0.004, 0.005]", HUGE).replace(
    "c: {", "c: {max_steps: 2, "
)


# The pool.


def test_every_task_comes_back_and_a_dead_worker_costs_its_own(tmp_path: Path) -> None:
    """Of its task, tried twice beside other tasks, which may have taken its memory, and once
    alone."""
    special = ["dies once", "raises", "dies", "is odd"]
    with pool(2) as workers:
        given = [(tmp_path, what) for what in [*range(10), *special, *range(10, 20)]]
        found = {what: done for (_, what), done in workers.map(troubled, given)}
        again = list(workers.map(abs, [-1]))
    assert {n: found[n] for n in range(20)} == {n: n for n in range(20)}
    assert isinstance(found["raises"], ValueError)
    assert (type(found["is odd"]), str(found["is odd"])) == (HodoError, "OddError: is odd")
    assert isinstance(found["dies"], HodoError)
    assert "died" in str(found["dies"])
    assert (tmp_path / "dies").read_text() == "xxx"
    # A worker may die with another one's task beside its own.
    assert found["dies once"] == "dies once"
    assert again == [(-1, 1)]


def test_this_process_takes_part(tmp_path: Path) -> None:
    """Beside one other, of two."""
    with pool(2, takes_part=True) as workers:
        done = [pid for _, pid in workers.map(worker, [tmp_path / "never"] * 150)]
    assert len(done) == 150
    assert len({*done}) == 2
    assert os.getpid() in done


def test_brief_tasks_are_done_here_until_a_worker_has_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    us, found, enough = os.getpid(), [], tmp_path / "enough"
    with pool(2) as workers:  # a minute's work for one process
        for _, process in workers.map_brief(worker, [enough] * 3000):
            found.append(process)
            if len(set(found)) == 3:
                enough.touch()
    assert (len(found), found[0], len(set(found))) == (3000, us, 3)
    here = found.count(us)
    assert found[:here] == [us] * here
    # They take no time, and no process.
    monkeypatch.setattr(pools, "monotonic", lambda: 0.0)
    monkeypatch.delattr(Processes, "submit")
    with pool(2) as workers:
        assert [process for _, process in workers.map_brief(worker, [enough] * 99)] == [us] * 99


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_are_taken_when_they_are_needed(jobs: int) -> None:
    taken: list[int] = []

    def supply() -> Iterator[int]:
        for task in itertools.count(10):
            taken.append(task)
            yield task

    with pool(jobs) as workers:
        for done, _ in enumerate(workers.map(abs, supply()), 1):
            assert len(taken) - done < 2 * jobs
            if done == 20:
                break


def test_what_still_runs_is_given_up_at_the_end(tmp_path: Path) -> None:
    with pool(2) as workers:
        next(workers.map(stay, [(0, tmp_path), *((120, tmp_path),) * 3]))
    for file in tmp_path.glob("process *"):
        process = int(file.name.removeprefix("process "))
        wait_until(lambda process=process: process_state(process) in ("", "Z"))
    assert [file.name for file in tmp_path.glob("after *")] == ["after 0"]


# Runs.


def plant(folder: Path) -> None:
    """Modules that take the names of the standard library's, and say in a file that they ran."""
    for name in sys.stdlib_module_names:
        (folder / f"{name}.py").write_text("open(__name__ + '.imported', 'w')\n")


def test_workers_import_nothing_from_the_current_folder(tmp_path: Path, hodo: Hodo) -> None:
    """The folder may be a stranger's, of which only the case file was asked for."""
    (tmp_path / "case.yaml").write_text(CONFIG)
    plant(tmp_path)
    done = hodo("run", "case.yaml", "-j", "2")
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.glob("*.imported")) == []


START_METHODS = {"processes": ["-j", "2"], "dask": ["--scheduler", "dask", "-j", "2"]}


def test_workers_of_a_python_that_ignores_the_environment_import_nothing_either(
    tmp_path: Path,
) -> None:
    (tmp_path / "case.yaml").write_text(CONFIG)
    plant(tmp_path)
    script = Path(sysconfig.get_path("scripts")) / "hodo"
    for method, status in (("processes", 0), ("dask", 2)):
        if method == "dask":
            pytest.importorskip("distributed")
        done = subprocess.run(
            [sys.executable, "-E", script, "run", "case.yaml", *START_METHODS[method]],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == status, done.stderr
    assert "start it with -P too" in done.stderr
    assert [path.name for path in tmp_path.glob("*.imported")] == []


def test_what_a_task_prints_is_no_answer() -> None:
    with pool(2) as workers:
        assert dict(workers.map(tell, ["said", "ready"])) == {"said": "", "ready": ""}


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "four.yaml"
    path.write_text(CONFIG)
    return path


def run(config: Path, *arguments: str) -> Result:
    """`hodo run` in this process, its results beside the config."""
    return CliRunner().invoke(main, ["run", str(config), "--out", str(config.parent), *arguments])


def everything(path: Path) -> dict[str, object]:
    """All attributes and values in a file but for times and history."""
    found: dict[str, object] = {}

    def look(name: str, item: h5py.HLObject) -> None:
        # `listed` repeats short attributes, the run time among them.
        varying = ("run_time", "listed", "history", "checksum", "DIMENSION_LIST", "REFERENCE_LIST")
        found.update(
            {f"{name}.{key}": str(value) for key, value in item.attrs.items() if key not in varying}
        )
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
        assert run(config, "--out", str(folder), "-j", jobs).exit_code == 1
    serial, parallel = (everything(folder / "four.h5") for folder in folders.values())
    assert serial == parallel
    assert serial["order"] == ["a", "b", "c", "d"]


def test_the_digits_do_not_depend_on_the_number_of_threads(config: Path, hodo: Hodo) -> None:
    """Of several processors; on one there is nothing to see."""
    config.write_text(
        "cases: {a: {model: torques, damping: 0.01, attitude: yes, method: collocation,"
        " inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 20}}}"
    )
    unset = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    for out, threads in (("any", {}), ("one", {"OPENBLAS_NUM_THREADS": "1"})):
        done = hodo("run", config, "--out", out, env={**unset, **threads})
        assert done.returncode == 0, done.stderr
    several, single = (everything(config.parent / out / "four.h5") for out in ("any", "one"))
    assert several == single


def test_failures_are_said_at_once_and_at_the_end(config: Path) -> None:
    config.write_text(FAILING)
    done = run(config, "-v")
    assert done.exit_code == 1
    lines = done.stderr.splitlines()
    assert lines[:4] == [f"{name}: will run: it has no result yet" for name in "abcd"]
    assert lines[4] == "[1/4] a: ok"
    assert lines[5].startswith("[2/4] b: failed: the state became")
    assert lines[6].startswith("[3/4] c: timeout: max_steps: stopped after 2 steps")
    assert lines[7] == "[4/4] d: ok"
    assert lines[8] == "2 of 4 cases did not end well: b (failed), c (timeout)"
    result = str(config.with_suffix(".h5"))
    methods = CliRunner().invoke(main, ["show", "--methods", result]).stdout
    assert "Left out, since they did not end well: b, c." in " ".join(methods.split())
    again = run(config, "-v")
    assert [line for line in again.stderr.splitlines()[:4] if "kept" not in line] == [
        "b: will run: its status is failed",
        "c: will run: its status is timeout",
    ]
    assert [line[:8] for line in run(config).stderr.splitlines()] == [
        "[1/2] b:",
        "[2/2] c:",
        "2 of 4 c",
    ]


def test_a_failure_says_that_the_good_result_is_kept(config: Path) -> None:
    assert run(config).exit_code == 0
    config.write_text(FAILING)
    b, c = run(config, "--quiet").stderr.splitlines()[:2]
    assert b.endswith("; its earlier result is kept")
    assert c.endswith("; its earlier result is kept")
    elsewhere = str(config.parent / "elsewhere")
    assert "kept" not in run(config, "--quiet", "--out", elsewhere).stderr


def test_a_bug_in_one_case_is_that_case_s_own(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    finish = run_command.finished_case

    def buggy(case: Case) -> Group:
        return finish(case) if case.name != "b" else 1 / 0  # type: ignore[return-value]

    monkeypatch.setattr(run_command, "finished_case", buggy)
    done = run(config)
    assert done.exit_code == 1
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
    assert done.exit_code == 1
    assert "1 of" in done.stderr
    with h5py.File(config.with_suffix(".h5")) as file:
        assert list(file) == ["a", "b", "c", "d"]
        assert np.array_equal(file["d/omega"], before)
    assert "c: will run" in run(config, "--dry-run").stdout
    if jobs == "1":
        assert "d: will run: its case has changed" in run(config, "--dry-run").stdout


def test_white_space_and_comments_change_nothing(config: Path) -> None:
    run(config)
    config.write_text(
        "# a comment\n\n" + CONFIG.replace("{damping: ", "{damping:    ").replace("0.004", "4e-3")
    )
    assert run(config, "--dry-run").stdout.splitlines() == [f"{name}: {KEPT}" for name in "abcd"]


def test_a_case_that_has_left_the_config_stays_until_it_is_pruned(config: Path) -> None:
    run(config)
    result = config.with_suffix(".h5")
    with h5py.File(result) as file:
        before = file["d/omega"][()]
    config.write_text("".join(CONFIG.splitlines(keepends=True)[:-1]))
    for options in ([], ["--force"], ["--case", "a"]):
        assert f"d: {run_command.CASE_KEPT}" in run(config, *options, "-v").stderr
        with h5py.File(result) as file:
            assert set(file) == {*"abcd"}
            np.testing.assert_array_equal(file["d/omega"], before)
    assert f"d: {run_command.CASE_DROPPED}" in run(config, "--prune").stderr
    with h5py.File(result) as file:
        assert list(file) == ["a", "b", "c"]


def test_what_an_interrupted_batch_has_finished_is_taken_in_at_once(config: Path) -> None:
    """By the name of a finished case: none of the others has to run first."""
    cases, result = parse(CONFIG, "x").cases, config.with_suffix(".h5")
    with suppress(KeyboardInterrupt), compose(result, {}) as writer:
        for name in "ab":
            writer.add(name, run_command.finished_case(cases[name]))
        raise KeyboardInterrupt
    assert not result.exists()
    done = run(config, "--case", "a", "-v")
    assert f"a: {KEPT}" in done.stderr.splitlines()
    with h5py.File(result) as file:
        assert list(file) == ["a", "b"]
    assert "c: will run" in run(config, "--dry-run").stdout


def test_a_damaged_case_that_has_left_the_config_is_dropped_and_said_to_be(config: Path) -> None:
    run(config)
    with h5py.File(config.with_suffix(".h5"), "a") as file:
        file["d/omega"][3, 0] += 1e-9
    config.write_text("".join(CONFIG.splitlines(keepends=True)[:-1]))
    done = run(config)
    assert done.exit_code == 0, done.output
    assert f"d: {run_command.CASE_DROPPED}" in done.stderr
    with h5py.File(config.with_suffix(".h5")) as file:
        assert list(file) == ["a", "b", "c"]


def test_several_configs_are_run_but_those_without_a_case_asked_for(config: Path) -> None:
    other = config.with_name("other.yaml")
    other.write_text(CONFIG.replace("  a:", "  other:"))
    assert run(config, str(other), "--case", "other").exit_code == 0
    assert not config.with_suffix(".h5").exists()
    assert run(config, str(other), "-j", "2").exit_code == 0
    assert config.with_suffix(".h5").exists()


def test_two_runs_at_once_both_end_well(config: Path, hodo: Hodo) -> None:
    script = [*stress.HODO, "run", str(config), "--out", "runs"]
    both = [
        subprocess.Popen(script, cwd=config.parent, stdout=subprocess.DEVNULL) for _ in range(2)
    ]
    assert [process.wait() for process in both] == [0, 0]
    assert os.listdir(config.parent / "runs") == ["four.h5"]
    assert everything(config.parent / "runs" / "four.h5")["order"] == ["a", "b", "c", "d"]


@pytest.mark.parametrize("bare", ["", "1"])
def test_a_terminal_shows_problems_in_colour_unless_told_not_to(config: Path, bare: str) -> None:
    config.write_text(FAILING)
    terminal, end = pty.openpty()
    environment = {**os.environ, "NO_COLOR": bare}
    command = [*stress.HODO, "run", str(config), "--out", str(config.parent)]
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


def stopped_run(config: Path) -> tuple[int, list[int]]:
    """A run in two processes, which stops when it has its first case; it, and its workers."""
    config.write_text(CONFIG.replace("samples: 21", "samples: 40001"))
    add = Writer.add

    def add_and_stop(*given: Any) -> None:
        add(*given)
        Writer.add = add  # type: ignore[method-assign]
        os.kill(os.getpid(), signal.SIGSTOP)

    def action() -> None:
        os.setsid()
        Writer.add = add_and_stop  # type: ignore[method-assign]
        assert run(config, "-j", "2").exit_code == 0

    child = in_child(action)
    assert os.WIFSTOPPED(os.waitpid(child, os.WUNTRACED)[1])
    return child, [pid for pid in stress.members(child) if b"serve()" in command_line(pid)]


def test_a_worker_that_is_killed_costs_nothing_but_time(config: Path) -> None:
    child, workers = stopped_run(config)
    os.kill(workers[0], signal.SIGKILL)
    os.kill(child, signal.SIGCONT)
    assert exit_status(child) == 0
    with h5py.File(config.with_suffix(".h5")) as file:
        assert [str(case.attrs["status"]) for case in file.values()] == ["ok"] * 4


@pytest.mark.skipif(sys.platform != "linux", reason="other systems end no process with its parent")
def test_a_worker_that_is_stopped_ends_with_its_run(config: Path) -> None:
    child, workers = stopped_run(config)
    os.kill(workers[0], signal.SIGSTOP)
    os.kill(child, signal.SIGKILL)
    assert exit_status(child) == -signal.SIGKILL
    assert stress.survivors(child) == []


COMPUTES = "from hodo_cli.batch.digests import process_digest; print(process_digest())"


@pytest.mark.heyoka
def test_a_process_that_computes_with_other_libraries_has_another_digest() -> None:
    hidden = {**os.environ, "PYTHONPATH": str(Path(__file__).parent / "without_heyoka")}
    digests = [
        subprocess.check_output([sys.executable, "-c", COMPUTES], env=environment, text=True)
        for environment in (None, None, hidden)
    ]
    assert digests[0] == digests[1] != digests[2]


def command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


# Memory.


@pytest.mark.parametrize(("jobs", "share"), [("1", ""), ("2", " for each of 2 processes")])
def test_what_does_not_fit_into_memory_is_refused_with_the_figure(
    config: Path, jobs: str, share: str
) -> None:
    done = run(config, "--set", "c.time.samples=1000000000", "-j", jobs)
    assert done.exit_code == 2
    place, _, message = done.stderr.partition(": cases.c.time.samples: ")
    assert "four.yaml:" in place
    assert message.startswith("1,000,000,000 samples would take about 450 GB of memory, and there")
    assert done.stderr.endswith(share + "\n")
    assert os.listdir(config.parent) == ["four.yaml"]


# Not getrusage: what it calls the largest size is, in a new process, that of the one that started
# it.
PEAK = """\
import re, sys
from pathlib import Path
from hodo_cli.cases.config import load
from hodo_cli.commands import classify, run
cases = load(sys.argv[1]).cases
def peak():
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1])

def integrated_and_classified(case):
    classify.classified(case.name, run.finished_case(case), case)

integrated_and_classified(cases["small"])
before = peak()
integrated_and_classified(cases["large"])
print((peak() - before) * 1024)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_estimate_of_memory_is_right_to_a_factor_of_two(tmp_path: Path) -> None:
    case = "  {}: {{damping: [0.005, 0.004, 0.003], time: {{end: 400, samples: {}}}}}\n"
    text = DEFAULTS + "cases:\n" + case.format("small", 1000) + case.format("large", 500000)
    (tmp_path / "x.yaml").write_text(text)
    done = subprocess.run(
        [sys.executable, "-c", PEAK, tmp_path / "x.yaml"],
        capture_output=True,
        text=True,
        check=True,
    )
    estimate = memory.bytes_needed(parse(text, "x").cases["large"])
    assert estimate / 2 < int(done.stdout) < estimate


# Kills; `make stress` does many more. Without heyoka they only take longer.


@pytest.mark.heyoka
def test_killed_runs_lose_nothing(tmp_path: Path) -> None:
    assert stress.kill_runs(tmp_path, 4)["files whole"] == 2


@pytest.mark.heyoka
def test_killed_classifications_lose_nothing(tmp_path: Path) -> None:
    assert stress.kill_classifications(tmp_path, 2)["files whole"] == 2
