"""Nothing that was computed is lost or silently wrong: few trials of each class of `faults.py`
(`make stress` makes hundreds), and results that are unfinished, shared, foreign or damaged."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import faults
import h5py
import pytest
from conftest import Hodo, wait_until
from faults import BATCH, SWEEP, numbers, prepared, same, written

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks, signals and /proc")
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc compiles what watches calls")


def test_killed_runs_and_sweeps_lose_nothing(tmp_path: Path) -> None:
    assert faults.kill_runs(tmp_path, 3)["ended by the signal"]


def test_a_full_disk_loses_nothing(tmp_path: Path) -> None:
    assert faults.fill_disk(tmp_path, 8)["refused"]


def test_a_crowd_of_processes_loses_nothing(tmp_path: Path) -> None:
    faults.crowds(tmp_path, 3)


def test_changed_bytes_are_never_taken_for_numbers(tmp_path: Path) -> None:
    count = faults.change_bytes(tmp_path, 9)
    assert count["h5py: refused"], "no trial has met the arrays"
    assert count["hodo: refused"] >= 7


@needs_gcc
def test_nothing_is_lost_when_a_call_fails(tmp_path: Path) -> None:
    count = faults.fail_calls(tmp_path, 24, 36)
    assert len(count) >= 10  # of three commands, reading and writing, once and for ever
    assert count["classify: writes once"] >= 6


@needs_gcc
def test_nothing_that_was_synced_is_lost_with_the_power(tmp_path: Path) -> None:
    assert faults.lose_power(tmp_path, 2)["tried"] >= 24


@contextmanager
def running(folder: Path, config: str) -> Iterator["subprocess.Popen[str]"]:
    """A run with its result in the folder, which is killed at the end if it still runs."""
    written(folder, config)
    with faults.started(folder, "run", "x.yaml", "--out", ".", "-v") as process:
        try:
            yield process
        finally:
            process.kill()


SLOW = (
    "damping: [1.0e-9, 2.0e-9, 3.0e-9], initial: {p: 0.8, q: 0.5, r: 0.74}, error: off, "
    "time: {samples: 11"
)
LONG = BATCH + f"  mid: {{{SLOW}, end: 200000}}}}\n  last: {{{SLOW}, end: 700000}}}}\n"
"""A batch whose last case takes seconds, and the one before so long that it is stored at once."""


def finished_in(process: "subprocess.Popen[str]", many: int) -> None:
    """Wait until a run has said that so many cases are finished."""
    assert process.stderr
    while many:
        line = process.stderr.readline()
        assert line, "the run has ended"
        many -= line.rstrip().endswith(": ok")


def test_what_a_living_run_has_finished_can_be_looked_at(tmp_path: Path, hodo: Hodo) -> None:
    with running(tmp_path, LONG.replace("end: 700000", "end: 5000000")) as process:
        finished_in(process, 12)
        shown = hodo("show", "x.h5")
        assert shown.returncode == 0, shown.stderr
        assert shown.stdout.count("linear-diag") >= 12
        assert hodo("classify", "x.h5").returncode == 0
        assert process.poll() is None, "the run has ended too early"
        process.kill()
        process.wait()
    again = hodo("run", "x.yaml", "--out", ".", "-v", "--case", "c*")
    assert again.returncode == 0, again.stderr
    assert again.stderr.count(": is kept") >= 12
    labelled = ["enclosed_axis" in case for case in numbers(tmp_path / "x.h5").values()]
    assert sum(labelled) >= 12, "labels are lost"


def test_cases_that_are_added_and_changed_beside_an_unfinished_run(tmp_path, hodo):
    with running(tmp_path, LONG) as process:
        finished_in(process, 12)
    changed = LONG.replace("p: 0.8, q: 0.3", "p: 0.7, q: 0.3").partition("  mid")[0]
    new = "  new: {damping: 0.004, initial: {p: 1, q: 1, r: 1}}\n"
    (tmp_path / "x.yaml").write_text(changed + new)
    done = hodo("run", "x.yaml", "--out", ".", "-v")
    assert done.returncode == 0, done.stderr
    assert "c2: will run: its case has changed" in done.stderr
    found = numbers(tmp_path / "x.h5")
    assert {*found} - {"mid"} == {*(f"c{i}" for i in range(16)), "new"}
    assert found["c2"]["omega"][0, 0] == 0.7


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a classified result."""
    prepared(tmp_path_factory.mktemp("made") / "made")
    return tmp_path_factory.getbasetemp() / "made0" / "made"


@pytest.fixture
def result(made: Path, tmp_path: Path) -> Path:
    """A copy of it, in the folder in which `hodo` runs."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "x.h5"


def changed(result: Path, old: str, new: str) -> None:
    config = result.with_suffix(".yaml")
    text = config.read_text()
    assert old in text
    config.write_text(text.replace(old, new, 1))


RUN = ("run", "x.yaml", "--out", ".", "-v")


def test_a_failure_does_not_replace_a_good_result(result: Path, hodo: Hodo) -> None:
    before = numbers(result)
    changed(result, "a: {", "a: {max_steps: 2, ")
    done = hodo(*RUN, "--force")
    assert done.returncode == 1
    assert "its earlier result is kept" in done.stderr
    same(numbers(result), before)


def test_a_case_that_has_left_the_case_file_stays_until_it_is_pruned(result, hodo):
    changed(result, "  b: {damping: [0.03, 0.04, 0.05]}\n", "")
    changed(result, "cases: [a, b]", "cases: [a]")
    before = numbers(result)
    done = hodo(*RUN)
    assert "b: is kept" in done.stderr
    assert "--prune drops it" in done.stderr
    same(numbers(result), before)
    assert hodo(*RUN, "--prune").returncode == 0
    assert [*numbers(result)] == ["a", "s"]


def test_remarks_are_renewed_without_a_run(result: Path, hodo: Hodo) -> None:
    before = numbers(result)
    changed(result, "a: {", "a: {note: As measured., ")
    changed(result, "cases: [a, b]}", "cases: [a, b], caption: new}")
    done = hodo(*RUN)
    assert done.stderr.count(": is kept: nothing that it depends on has changed") == 3
    same(numbers(result), before)
    with h5py.File(result) as file:
        assert "As measured." in file["a"].attrs["case"]
    assert "enclosed_axis" in numbers(result)["a"]


READERS = (
    RUN,
    (*RUN, "--force"),
    *((command, "x.h5") for command in ("classify", "show", "claims", "plot")),
    ("compare", "x.h5", "x.h5"),
)


def test_a_damaged_result_is_refused_in_one_line(result: Path, hodo: Hodo) -> None:
    data = bytearray(result.read_bytes())
    place = data.index(numbers(result, ["omega"])["a"]["omega"][:1].tobytes()[:8])
    data[place] ^= 1
    result.write_bytes(data)
    for command in READERS:
        done = hodo(*command)
        assert done.returncode == 2, command
        assert done.stderr.startswith("x.h5 is damaged (its checksum does not fit)"), command
        assert "move it away" in done.stderr
        assert done.stderr.count("\n") == 1
        assert result.read_bytes() == data, command


def test_every_numeric_array_has_a_checksum_of_its_own(result: Path) -> None:
    """So that h5py and xarray notice a changed bit."""
    with h5py.File(result) as file:
        items = [item for case in file.values() for item in case.values()]
        arrays = [item for item in items if item.size and item.dtype.kind in "fiu" and item.ndim]
        stored = [item for item in arrays if "not a netCDF" not in str(item.attrs.get("NAME"))]
        assert len(stored) > 20
        assert [item.name for item in stored if not item.fletcher32] == []


def test_a_result_behind_a_link_stays_there_and_keeps_its_mode(result: Path, hodo: Hodo) -> None:
    (result.parent / "store").mkdir()
    target = result.rename(result.parent / "store" / "y.h5")
    result.symlink_to(target)
    target.chmod(0o640)
    assert hodo(*RUN, "--force").returncode == 0
    assert result.is_symlink()
    assert target.stat().st_mode & 0o777 == 0o640


def test_a_folder_that_cannot_be_written_into(result: Path, hodo: Hodo) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    result.parent.chmod(0o555)
    try:
        done = hodo(*RUN, "--force")
    finally:
        result.parent.chmod(0o755)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "permission denied" in done.stderr


def test_code_that_is_edited_during_a_run_is_noticed(tmp_path: Path) -> None:
    faults.edit_code(tmp_path, 1)


def test_workers_import_nothing_from_the_current_folder(tmp_path: Path) -> None:
    """A file of a common name, such as numpy.py, does not run in a worker."""
    written(tmp_path, BATCH)
    for name in ("numpy", "heyoka", "h5py", "random", "xarray"):
        (tmp_path / f"{name}.py").write_text("open('owned', 'w')\n")
    with faults.started(tmp_path, "run", "x.yaml", "--out", ".", "-j", "2") as process:
        said = process.communicate()[1]
    assert process.returncode == 0, said
    assert not (tmp_path / "owned").exists()


HEYOKA_THAT_IS_STOPPED = """\
import os, signal

try:
    os.kill(os.getpid(), signal.SIGINT)
except KeyboardInterrupt as error:
    raise ImportError("initialization failed") from error
"""


@pytest.mark.process
@pytest.mark.parametrize("case", ["c1", "s"])
def test_a_signal_that_meets_a_loading_library_is_no_failure_of_a_case(tmp_path, hodo, case):
    # A compiled library makes its own error of the exception that the signal raises.
    (tmp_path / "libraries" / "heyoka").mkdir(parents=True)
    (tmp_path / "libraries" / "heyoka" / "__init__.py").write_text(HEYOKA_THAT_IS_STOPPED)
    written(tmp_path, BATCH + SWEEP)
    libraries = {**os.environ, "PYTHONPATH": str(tmp_path / "libraries")}
    ended = hodo("run", "x.yaml", "--case", case, env=libraries)
    assert (ended.returncode, ended.stderr) == (130, "interrupted; finished cases are kept\n")
    assert not (tmp_path / "runs" / "x.h5").exists()


def test_a_stopped_run_ends_within_a_second_of_a_signal(tmp_path: Path, hodo: Hodo) -> None:
    with running(tmp_path, LONG) as process:
        finished_in(process, 12)
        time.sleep(0.3)  # the long case has begun
        began = time.monotonic()
        process.terminate()
        said = process.communicate()[1]
    assert process.returncode == 143, said
    assert time.monotonic() - began < 3  # a second, on a machine that has nothing else to do
    assert "interrupted" in said
    wait_until(lambda: not faults.members(process.pid))
    assert hodo("show", "x.h5").returncode == 0
    assert sys.platform != "linux" or len(numbers(tmp_path / "x.h5")) >= 12
