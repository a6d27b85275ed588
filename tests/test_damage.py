"""Faults of disks, files and processes, by sample: damage is named and never drawn, finished work
is never lost. `make stress` tries each class hundreds of times."""

import fcntl
import json
import os
import random
import re
import resource
import shutil
import signal
import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import faults
import h5py
import numpy as np
import pytest
from conftest import counted, process_state, wait_until
from faults import CONFIG, Motions, hodo
from tasks import dies_while_it_answers

from hodo_cli import BatchError, HodoError
from hodo_cli.batch.pool import pool
from hodo_cli.storage import disk, hdf5, staging, writer
from hodo_cli.storage.finished_cases import finished_cases
from hodo_cli.storage.group import Group, Variable
from hodo_cli.storage.hdf5 import open_run
from hodo_cli.storage.writer import compose, update


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Motions]:
    folder = tmp_path_factory.mktemp("sound")
    return folder, faults.prepared(folder)


@pytest.fixture
def result(sound: tuple[Path, Motions], tmp_path: Path) -> Path:
    """A copy of a classified result, with its case file beside it."""
    shutil.copytree(sound[0], tmp_path, dirs_exist_ok=True)
    return tmp_path / "x.h5"


# Bytes that have changed.


@pytest.mark.parametrize("spoil", [faults.flipped, faults.zeroed])
def test_changed_bytes_are_never_taken_for_a_motion(
    result: Path,
    sound: tuple[Path, Motions],
    spoil: Callable[[Path, random.Random], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hdf5, "PATIENCE_OF_READER", 1.0)  # some of these hang the reader
    before, chance = result.read_bytes(), random.Random(4)
    for _ in range(12):
        result.write_bytes(before)
        spoil(result, chance)
        faults.right_or_named(result, sound[1])


def test_a_damaged_case_is_named_by_every_command_and_run_anew(
    result: Path, sound: tuple[Path, Motions]
) -> None:
    with h5py.File(result, "r+") as file:
        file["a/omega"][7, 1] += 1e-9
    said = "a is damaged (its checksum does not fit)"
    shutil.copy(sound[0] / "x.h5", result.with_name("right.h5"))
    for command in (
        ["show", result], ["classify", result], ["claims", result],
        ["compare", result, result.with_name("right.h5")],
        ["plot", result, "--format", "csv", "--out", result.parent / "figures"],
    ):  # fmt: skip
        done = hodo(*command)
        assert done.exit_code in (1, 2), command
        assert said in done.stderr, command
    again = hodo("run", result.with_suffix(".yaml"), "--out", result.parent, "-v")
    assert "a: will run: its stored result is damaged (its checksum does not fit)" in again.stderr
    assert "b: is kept" in again.stderr
    faults.equal(faults.motions(result), sound[1])


def wrong_number(path: Path, name: str) -> None:
    with h5py.File(path, "r+") as file:
        data = file[name]["number" if name == "_claims" else "omega"]
        data[...] = data[...] + 1e-9


def unreadable(path: Path, name: str) -> None:
    with h5py.File(path) as file:
        start = h5py.h5o.get_info(file[name].id).addr
    data = bytearray(path.read_bytes())
    data[start + 8] ^= 1  # within the object's header, which HDF5 then refuses
    path.write_bytes(data)


@pytest.mark.parametrize("damage", [wrong_number, unreadable])
def test_the_labels_of_other_cases_are_stored_beside_a_damaged_one(
    result: Path, damage: Callable[[Path, str], None]
) -> None:
    config = result.with_suffix(".yaml")
    right = faults.motions(result)
    result.unlink()
    assert hodo("run", config, "--out", result.parent).exit_code == 0
    damage(result, "a")
    for _ in range(2):  # the second time, nothing is left to store
        done = hodo("classify", result)
        assert done.exit_code == 1
        (line,) = done.stderr.splitlines()
        assert "a is damaged (" in line
    with open_run(result) as run:
        assert set(run.cases()) == {"a", "b", "s"}
        assert [line.split()[2] for line in run.attributes["history"].splitlines()[-2:]] == [
            "run",
            "classify",
        ]
        assert "enclosed_axis" in run.read("b").variables
        with pytest.raises(HodoError, match=r"a is damaged \("):
            run.read("a")
    again = hodo("run", config, "--out", result.parent, "-v")
    assert again.exit_code == 0
    assert "b: is kept" in again.stderr
    faults.equal(faults.motions(result), right)


@pytest.mark.parametrize("damage", [wrong_number, unreadable])
def test_damaged_verdicts_are_given_again(
    result: Path, damage: Callable[[Path, str], None]
) -> None:
    assert hodo("claims", result).exit_code == 0
    damage(result, "_claims")
    assert hodo("claims", result).exit_code == 0
    with open_run(result) as run:
        assert not run.damaged
        assert list(run.read("_claims").variables["verdict"].data) == ["reproduced"]


@pytest.mark.parametrize("damage", [wrong_number, unreadable])
def test_the_page_leaves_out_what_is_damaged(
    result: Path, damage: Callable[[Path, str], None]
) -> None:
    assert hodo("claims", result).exit_code == 0
    damage(result, "a")
    damage(result, "_claims")
    done = hodo("plot", result, "--format", "svg", "--out", result.parent)
    assert done.exit_code == 1  # the figure that needs the case, in one line
    (figure, *others) = done.stderr.splitlines()
    assert figure.startswith(f"both: {result}: a is damaged (")
    assert {line.split()[1] for line in others} == {"a", "_claims"}
    page = json.loads((result.parent / "x" / "page.json").read_text())
    assert [case["name"] for case in page["cases"]] == ["b", "s"]
    assert (result.parent / "index.html").exists()


@pytest.mark.parametrize("damage", [wrong_number, unreadable])
def test_damaged_verdicts_beside_a_damaged_case_are_given_until_they_can_be_stored(
    result: Path, damage: Callable[[Path, str], None]
) -> None:
    assert hodo("claims", result).exit_code == 0
    damage(result, "_claims")
    wrong_number(result, "b")
    for _ in range(2):
        done = hodo("claims", result)
        assert done.exit_code == 0, done.stderr
        assert "reproduced" in done.stdout
        with open_run(result) as run:
            assert set(run.damaged) == {"b", "_claims"}
    assert hodo("run", result.with_suffix(".yaml"), "--out", result.parent).exit_code == 0
    assert hodo("claims", result).exit_code == 0
    with open_run(result) as run:
        assert not run.damaged
        assert list(run.read("_claims").variables["verdict"].data) == ["reproduced"]


def test_a_reader_that_hangs_or_dies_costs_its_case_and_a_limited_time() -> None:
    def look_at(name: str) -> str:
        if name == "hangs":
            # As if nearly all of its time were over; no time was given if none is left.
            signal.setitimer(signal.ITIMER_REAL, signal.getitimer(signal.ITIMER_REAL)[0] / 1000)
            time.sleep(60)
        if name == "dies":
            os.kill(os.getpid(), signal.SIGKILL)
        return "wrong" if name == "bad\n" else ""

    names = ["good", "hangs", "bad\n", "dies", "fine"]
    parts = {name: partial(look_at, name) for name in names}
    found = disk.inspect_in_child(lambda: parts, 60, 1 << 30)
    assert found == {
        "hangs": disk.READER_SILENT, "bad\n": "wrong", "dies": disk.READER_SILENT,
    }  # fmt: skip


def test_a_damaged_piece_is_run_anew(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    with pytest.raises(KeyboardInterrupt), compose(path, {}) as first:  # noqa: PT012
        for name in "ab":
            first.add(name, Group({"status": "ok"}, {"v": Variable(("t",), np.arange(999.0))}))
            first.store()
        raise KeyboardInterrupt
    (folder,) = staging.staging_folders(path)
    faults.zeroed(sorted(folder.iterdir())[1], random.Random(1), 4096)
    assert list(finished_cases(path)) == ["a"]


# What the operating system refuses.


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc compiles what makes calls fail")
def test_nothing_is_lost_when_a_call_of_a_library_fails(tmp_path: Path) -> None:
    counts = faults.preloaded(faults.compiled(tmp_path), "calls", tmp_path, 60, 29)
    assert len(counts) == 12  # three commands, reading and writing, once and for ever
    assert all(count in (1, 2, 3) for count in counts.values())


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc compiles what logs calls")
def test_nothing_that_was_synced_is_lost_with_the_power(tmp_path: Path) -> None:
    counts = faults.preloaded(faults.compiled(tmp_path), "power", tmp_path, 2)
    assert [*counts.values()] == 12 * [3]  # three commands, of which four things are left


def test_what_a_dead_run_has_finished_is_used_where_it_lies_until_it_is_published(
    tmp_path: Path,
) -> None:
    """A run that dies as well leaves it to the next one."""
    group = Group({"status": "ok"}, {"v": Variable(("t",), np.arange(9.0))})
    path = tmp_path / "x.h5"
    with pytest.raises(KeyboardInterrupt), compose(path, {}) as first:  # noqa: PT012
        first.add("a", group)
        for number in (0, 1):
            first.add_chunk("stamp", number, group)
        raise KeyboardInterrupt
    (folder,) = staging.staging_folders(path)
    faults.zeroed(folder / "part-stamp-1.h5", random.Random(1), 4096)
    for ends_well in (False, True):
        with suppress(KeyboardInterrupt), compose(path, {}) as second:
            assert second.keep(finished_cases(path)["a"][0])
            assert second.chunks("stamp") == {0}
            if not ends_well:
                raise KeyboardInterrupt
    with open_run(path) as run:
        assert run.cases() == ["a"]
    assert os.listdir(tmp_path) == ["x.h5"]


def test_a_case_of_another_run_that_has_ended_meanwhile_is_in_its_result(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    group = Group({"hash": "1", "status": "ok"}, {"v": Variable(("t",), np.arange(9.0))})
    composed = compose(path, {})
    first = composed.__enter__()
    first.add("a", group)
    first.store()
    with compose(path, {}) as second:
        assert second.keep(finished_cases(path)["a"][0])
        second.add("b", group)
        composed.__exit__(None, None, None)
    with open_run(path) as run:
        assert run.cases() == ["a", "b"]


def test_a_failure_does_not_replace_a_good_result(result: Path) -> None:
    config = result.with_suffix(".yaml")
    config.write_text(config.read_text().replace("a: {", "a: {max_steps: 2, ", 1))
    done = hodo("run", config, "--out", result.parent, "--force")
    assert done.exit_code == 1
    assert "a (timeout)" in done.stderr
    with open_run(result) as run:
        assert run.row("a", {"status": str}) == {"status": "ok"}


def test_a_part_that_another_program_changes_before_it_is_joined_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though this process has written it; the next run computes it anew."""
    config = tmp_path / "x.yaml"
    config.write_text(CONFIG)
    add = writer.Writer.add_chunk

    def add_and_spoil(of: writer.Writer, sweep: str, number: int, group: Group) -> None:
        add(of, sweep, number, group)
        (part,) = tmp_path.glob(f".x.h5.*.partial/part-*-{number}.h5")
        data = bytearray(part.read_bytes())
        data[data.index(group.variables["omega"].data.tobytes())] ^= 1
        time.sleep(0.02)  # the system's own clock ticks in milliseconds
        part.write_bytes(data)

    monkeypatch.setattr(writer.Writer, "add_chunk", add_and_spoil)
    done = hodo("run", config, "--out", tmp_path)
    assert done.exit_code == 2
    assert "part is damaged (its checksum does not fit)" in done.stderr
    assert not (tmp_path / "x.h5").exists()
    monkeypatch.undo()
    assert hodo("run", config, "--out", tmp_path).exit_code == 0
    assert sorted(os.listdir(tmp_path)) == ["x.h5", "x.yaml"]


def test_the_parts_of_a_sweep_that_has_not_ended_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also when other cases are run meanwhile."""
    config = tmp_path / "x.yaml"
    config.write_text(CONFIG)
    add, count = writer.Writer.add_chunk, iter(range(100))

    def full(*arguments: object) -> None:
        if next(count):
            raise BatchError("cannot write x.h5: no space left on device")
        add(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(writer.Writer, "add_chunk", full)
    done = hodo("run", config, "--out", tmp_path)
    assert done.exit_code == 2
    assert "no space left" in done.stderr
    monkeypatch.undo()
    assert hodo("run", config, "--out", tmp_path, "--case", "a").exit_code == 0
    assert hodo("show", tmp_path / "x.h5").exit_code == 0
    again = hodo("run", config, "--out", tmp_path, "-v")
    assert again.exit_code == 0
    assert re.search(r"^s: 1 of \d+ chunks are kept$", again.stderr, re.MULTILINE)
    assert sorted(os.listdir(tmp_path)) == ["x.h5", "x.yaml"]


def test_a_result_that_is_half_sent_costs_a_retry(tmp_path: Path) -> None:
    with pool(2) as workers:
        ((_, found),) = workers.map(dies_while_it_answers, [tmp_path])
    assert isinstance(found, np.ndarray)


# Results from strangers.


def soft_link(file: h5py.File, folder: Path) -> None:
    file["a/omega2"] = h5py.SoftLink("/b/omega")


def external_link(file: h5py.File, folder: Path) -> None:
    file["a/omega2"] = h5py.ExternalLink("other.h5", "/x")


def external_storage(file: h5py.File, folder: Path) -> None:
    (folder / "secret").write_bytes(bytes(800))
    file["a"].create_dataset("other", (100,), "f8", external=[(str(folder / "secret"), 0, 800)])


def virtual(file: h5py.File, folder: Path) -> None:
    layout = h5py.VirtualLayout((41, 3), "f8")
    layout[:] = h5py.VirtualSource(str(folder / "right.h5"), "b/omega", (41, 3))
    file["a"].create_virtual_dataset("other", layout)


def cycle(file: h5py.File, folder: Path) -> None:
    file["a/self"] = file["a"]


def never_written(file: h5py.File, folder: Path) -> None:
    file["a"].create_dataset("other", (10**9,), "f8", chunks=(1000,))


def records(file: h5py.File, folder: Path) -> None:
    file["a"].create_dataset("other", data=np.zeros(5, [("x", "f8"), ("y", "i4")]))


def references(file: h5py.File, folder: Path) -> None:
    file["a"].create_dataset("other", (5,), h5py.ref_dtype)


def lists(file: h5py.File, folder: Path) -> None:
    file["a"].create_dataset("other", (5,), h5py.vlen_dtype("f8"))


def many_datasets(file: h5py.File, folder: Path) -> None:
    for i in range(1001):
        file["a"].create_dataset(f"z{i}", data=0.0)


def many_attributes(file: h5py.File, folder: Path) -> None:
    for i in range(1001):
        file["a"].attrs[f"z{i}"] = 0.0


def two_lines(file: h5py.File, folder: Path) -> None:
    file["a"].create_dataset("two\nlines", data=0.0)


def one_text_many_times(file: h5py.File, folder: Path) -> None:
    """Each element of such a dataset is an address, and all of them may be the same."""
    texts = file["a"].create_dataset("other", (20_000,), h5py.string_dtype())
    texts[0], path = "x" * 1_000_000, Path(file.filename)
    file.flush()
    start = texts.id.get_offset()
    file.close()
    data = bytearray(path.read_bytes())
    data[start : start + 16 * 20_000] = data[start : start + 16] * 20_000
    path.write_bytes(data)


@pytest.mark.parametrize(
    "how",
    [
        *(soft_link, external_link, external_storage, virtual, cycle, never_written),
        *(records, references, lists, many_datasets, many_attributes, two_lines),
        one_text_many_times,
    ],
)
def test_a_case_that_is_more_than_plain_datasets_is_refused(
    result: Path, how: Callable[[h5py.File, Path], None]
) -> None:
    with h5py.File(result, "r+") as file:
        how(file, result.parent)
    for checked in (False, True):
        if checked:
            faults.sealed_by_a_stranger(result)
        done = hodo("plot", result, "--format", "csv", "--out", result.parent / "figures")
        assert done.exit_code in (1, 2)
        assert "a is damaged (" in done.stderr
        assert not (result.parent / "figures" / "x" / "both.csv").exists()
        labelled = hodo("classify", result)
        assert labelled.exit_code == 1
        assert "a is damaged (" in labelled.stderr


def test_a_group_whose_name_is_no_word_is_refused(result: Path) -> None:
    with h5py.File(result, "r+") as file:
        file.create_group("two\nlines")
    done = hodo("show", result)
    assert (done.exit_code, done.stderr) == (
        2,
        f"{result} is damaged (a group is named 'two\\nlines')\n",
    )


def text_for_an_error(file: h5py.File) -> None:
    file["a"].attrs["error"] = "none"
    del file["a"].attrs["listed"]  # the copy, which is what is read where it is there


STRANGE_LABELS = "holds labels that are none, as after arithmetic with a whole dataset"


def label_of_no_axis(file: h5py.File) -> None:
    file["a/enclosed_axis"][3] = 7


def label_of_no_axis_in_a_sweep(file: h5py.File) -> None:
    file["s/end_axis"][3] = 7


@pytest.mark.parametrize(
    ("how", "said"),
    [
        (text_for_an_error, "a is damaged (its error is no number)"),
        (label_of_no_axis, f"a is damaged (its enclosed_axis {STRANGE_LABELS})"),
        (label_of_no_axis_in_a_sweep, f"s is damaged (its end_axis {STRANGE_LABELS})"),
    ],
)
def test_compare_names_what_cannot_be_under_a_checksum_that_fits(
    result: Path, how: Callable[[h5py.File], None], said: str
) -> None:
    right = shutil.copy(result, result.with_name("right.h5"))
    with h5py.File(result, "r+") as file:
        how(file)
    with open(result, "r+b", buffering=0) as raw:
        disk.append_checksum(raw)  # type: ignore[arg-type]
    done = hodo("compare", result, right)
    assert (done.exit_code, done.stderr) == (2, f"{result}: {said}\n")


def test_a_line_on_a_damaged_case_names_its_file_once(result: Path) -> None:
    with h5py.File(result, "r+") as file:
        label_of_no_axis(file)
    (unchecked,) = hodo("classify", result).stderr.splitlines()
    with open(result, "r+b", buffering=0) as raw:
        disk.append_checksum(raw)  # type: ignore[arg-type]
    (checked,) = hodo("claims", result).stderr.splitlines()
    for line in (unchecked, checked):
        assert "a is damaged (" in line
        assert line.count(str(result)) == 1


# Results that a stranger has made, or that come from another machine.


def test_a_case_at_which_hdf5_hangs_is_named_under_a_strangers_checksum(
    result: Path, sound: tuple[Path, Motions], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hdf5, "PATIENCE_OF_READER", 0.5)
    whole = result.read_bytes()
    for start in range(0, 8 * 512, 512):  # the first blocks hold what HDF5 follows
        result.write_bytes(whole[:start] + bytes(512) + whole[start + 512 : -disk.TRAILER])
        faults.sealed_by_a_stranger(result)
        faults.right_or_named(result, sound[1])


def test_a_signal_ends_a_reading_that_hangs(tmp_path: Path) -> None:
    """And the process that reads is gone too."""

    def end(*_: object) -> None:
        raise InterruptedError

    def hang(name: str) -> str:
        (tmp_path / name).write_text(str(os.getpid()))
        # Python ignores what is raised while it forks.
        wait_until(lambda: process_state(os.getppid()) == "S")
        os.kill(os.getppid(), signal.SIGUSR1)
        time.sleep(60)
        return ""

    before = signal.signal(signal.SIGUSR1, end)
    with pytest.raises(InterruptedError):
        disk.inspect_in_child(lambda: {"a": partial(hang, "a")}, 100, 1 << 30)
    signal.signal(signal.SIGUSR1, before)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "a").read_text()), 0)


def inflated(file: h5py.File, name: str, megabytes: int) -> None:
    """A dataset of zeros that takes some kB of the file."""
    shape, chunk = (megabytes, 1 << 20), (16, 1 << 20)
    data = file[name.partition("/")[0]].create_dataset(
        name.partition("/")[2], shape, "i1", chunks=chunk, compression="gzip"
    )
    zeros = zlib.compress(bytes(16 << 20))
    for start in range(0, megabytes, 16):
        data.id.write_direct_chunk((start, 0), zeros)


@pytest.mark.parametrize("sizes", [[512], [96, 96, 96, 96]])
def test_a_small_file_that_fills_the_memory_is_refused(result: Path, sizes: list[int]) -> None:
    """By one dataset, or by many of which each alone would be taken."""
    with h5py.File(result, "r+") as file:
        for name in "ab":
            for i, size in enumerate(sizes):
                inflated(file, f"{name}/z{i}", size)
    faults.sealed_by_a_stranger(result)
    assert result.stat().st_size < 2_000_000
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    done = hodo("show", result)
    assert done.exit_code == 1
    assert "does not fit" in done.stderr
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_a_forged_line_of_the_table_is_computed_anew(result: Path) -> None:
    """Also after another command has written the file again."""
    right = hodo("classify", result).stdout
    with h5py.File(result, "r+") as file:
        for name in "ab":
            forged = file[name].attrs["told"].replace('"crossings": [', '"crossings": [[1.5], ')
            file[name].attrs["told"] = forged.replace("x1", "x3")
    faults.sealed_by_a_stranger(result)
    assert hodo("classify", result).stdout == right
    assert hodo("claims", result).exit_code == 0
    with open_run(result) as run:
        assert run.intact
    assert hodo("classify", result).stdout == right


@pytest.mark.parametrize("value", [np.void(b"ab"), 1 + 1j, np.zeros(2, [("x", "f8")])])
def test_an_attribute_that_is_neither_number_nor_text_is_named(result: Path, value: object) -> None:
    with h5py.File(result, "r+") as file:
        file.attrs["odd"] = value
    for command in ("show", "classify", "claims"):
        done = hodo(command, result)
        assert done.exit_code == 2
        (line,) = done.stderr.splitlines()
        assert line == f"{result} is damaged (its attribute 'odd' is neither a number nor a text)"


def test_truths_of_another_program_outlive_a_command(result: Path) -> None:
    with h5py.File(result, "r+") as file:
        file.attrs["seen"], file["a"].attrs["masks"] = True, np.array([True, False])
    hodo("run", result.with_suffix(".yaml"), "--out", result.parent, "--force")
    with h5py.File(result, "r+") as file:
        file["b"].attrs["seen"] = True
    assert hodo("classify", result).exit_code == 0
    with open_run(result) as run:
        assert run.summary("b", ["seen"]) == {"seen": 1}


def test_a_result_is_used_on_a_machine_with_another_secret(result: Path, tmp_path: Path) -> None:
    """Without a word, the same table, and nothing runs again."""
    config = result.with_suffix(".yaml")
    here = [hodo(command, result) for command in ("show", "classify")]
    before = result.read_bytes()
    result.write_bytes(before[: -disk.TRAILER])
    faults.sealed_by_a_stranger(result)
    moved = result.read_bytes()
    there = [hodo(command, result) for command in ("show", "classify")]
    assert [(d.exit_code, d.stdout, d.stderr) for d in there] == [
        (d.exit_code, d.stdout, d.stderr) for d in here
    ]
    assert hodo("run", config, "--out", result.parent, "-v").stderr.count("is kept") == 3
    assert result.read_bytes() == moved


def test_a_pipe_is_no_result(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.h5")
    done = hodo("show", tmp_path / "x.h5")
    assert (done.exit_code, done.stderr) == (
        2,
        f"{tmp_path / 'x.h5'} is a pipe or a device, not a file\n",
    )


def test_figures_cannot_go_into_a_file(result: Path) -> None:
    done = hodo("plot", result, "--format", "csv", "--out", result.with_suffix(".yaml"))
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert "cannot write" in line


# Names, modes and races.


def test_a_result_behind_a_link_stays_there_and_keeps_its_mode(result: Path) -> None:
    (result.parent / "real").mkdir()
    real = result.rename(result.parent / "real" / "data.h5")
    result.symlink_to(real)
    real.chmod(0o600)
    done = hodo("run", result.with_suffix(".yaml"), "--out", result.parent, "--force")
    assert done.exit_code == 0
    assert result.is_symlink()
    assert real.stat().st_mode & 0o777 == 0o600
    assert os.listdir(real.parent) == ["data.h5"]


def test_a_read_only_result_is_replaced_by_force_alone(result: Path) -> None:
    config = result.with_suffix(".yaml")
    result.chmod(0o444)
    config.write_text(CONFIG.replace("0.05, 0.04, 0.03", "0.05, 0.04, 0.02"))
    done = hodo("run", config, "--out", result.parent)
    assert done.exit_code == 2
    assert "is read-only (mode 444)" in done.stderr
    assert hodo("run", config, "--out", result.parent, "--force").exit_code == 0
    assert result.stat().st_mode & 0o777 == 0o444


def test_verdicts_on_motions_that_are_gone_are_not_stored(result: Path) -> None:
    config = result.with_suffix(".yaml")
    verdicts = Group({"by": "test"}, {})
    with update(result) as changes:
        changes.write("_claims", verdicts)
        config.write_text(CONFIG.replace("0.05, 0.04, 0.03", "0.05, 0.04, 0.02"))
        assert hodo("run", config, "--out", result.parent).exit_code == 0
    with open_run(result) as run:
        assert "_claims" not in run


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "f.csv"
    path.write_text("old")
    with pytest.raises(BatchError, match="no space left"), staging.replacing(path) as draft:  # noqa: PT012
        draft.write_text("half")
        raise OSError(28, "No space left on device")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["f.csv"]


def test_drafts_of_the_dead_go_and_those_of_the_living_stay(tmp_path: Path) -> None:
    dead, living = (tmp_path / f".f.csv.{name}.partial" for name in ("dead", "living"))
    for folder in (dead, living):
        folder.mkdir()
        (folder / "draft").touch()
    descriptor = os.open(living, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with staging.replacing(tmp_path / "f.csv") as draft:
        draft.write_text("new")
    os.close(descriptor)
    assert {path.name for path in tmp_path.iterdir()} == {"f.csv", living.name}


# Limits.


def test_the_history_does_not_grow_without_bound(result: Path) -> None:
    with open_run(result) as run:
        history = str(run.attributes["history"])
        for count in range(len(history.splitlines()) + 1, 300):
            run.attributes["history"] = history
            history = writer.longer(run, f"line {count}")
            assert len(history.splitlines()) == min(count, writer.MAX_HISTORY_LINES)
            assert ("..." in history.splitlines()) == (count > writer.MAX_HISTORY_LINES)
    assert history.splitlines()[-1] == "line 299"


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError("write failed: errno = 28, error message = 'No space left on device', buf = 0x1"),
         "no space left on device"),
        (PermissionError(13, "Permission denied"), "permission denied"),
        (OSError("bad magic number"), ""),
    ],
)  # fmt: skip
def test_the_reason_of_a_refusal_is_that_of_the_system(error: OSError, reason: str) -> None:
    assert disk.refusal(error) == reason


def test_what_does_not_fit_on_the_disk_is_refused(tmp_path: Path) -> None:
    text = CONFIG.replace("linspace: [0.01, 0.05, 300]}}", "linspace: [0.01, 0.05, 999999999]}}")
    (tmp_path / "x.yaml").write_text(text)
    done = hodo("run", tmp_path / "x.yaml", "--out", tmp_path)
    assert done.exit_code == 2
    assert "on the disk of" in done.stderr


def test_max_seconds_holds_for_the_closed_form(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(
        "cases: {a: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0.01, method: exact, "
        "max_seconds: 1e-9, initial: {p: 1, q: 1, r: 1}, time: {end: 9, samples: 999999}}}"
    )
    done = hodo("run", tmp_path / "x.yaml", "--out", tmp_path)
    assert done.exit_code == 1
    assert "a: timeout: max_seconds: stopped after 1e-09 s" in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("p: 0.8", "p: 1e-400", "1e-400"),
        ("cases: [a, b]}", "cases: []}", "figures.both.cases: names no case"),
        ("cases: [a], ", "cases: [a], over: {damping.0: {linspace: [1, 2, 200000]}}, ", "100,000"),
    ],
)
def test_what_a_case_file_cannot_mean(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "x.yaml").write_text(CONFIG.replace(old, new))
    done = hodo("run", tmp_path / "x.yaml", "--out", tmp_path)
    assert done.exit_code == 2
    assert message in done.stderr


def test_a_thousand_wrong_names_show_the_first_twenty_at_once(tmp_path: Path) -> None:
    """With work in proportion to them: no name is compared with every other one."""

    def refused(n: int) -> None:
        cases = "".join(f"  name{i}: {{damping: 1}}\n" for i in range(n))
        head = CONFIG.partition("cases:\n")[0]
        names = ", ".join(f"nane{i}" for i in range(n))
        figure = f"figures: {{f: {{kind: hodograph, cases: [{names}]}}}}"
        (tmp_path / "x.yaml").write_text(f"{head}cases:\n{cases}{figure}")
        lines = hodo("run", tmp_path / "x.yaml", "--out", tmp_path).stderr.splitlines()
        assert len(lines) < 25
        assert "did you mean 'name0'?" in lines[0]

    refused(200)  # what is loaded and made once
    few, many = (counted(refused, n)[1] for n in (200, 1000))
    assert few < many < 6 * few


def test_a_digest_is_that_of_every_process(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(faults.SMALL)
    run = ["run", tmp_path / "x.yaml", "--out", tmp_path]
    assert hodo(*run, "-j", "2").exit_code == 0
    assert "a: is kept" in hodo(*run, "--dry-run").stdout


def test_what_a_disk_holds_and_what_it_refused_is_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # HDF5 reads its own file while it writes: the count of bytes must be that of the buffer.
    buffered = disk.BufferedFile(tmp_path / "a")
    buffered.write(b"abcdef")
    buffered.seek(2)
    buffer = bytearray(3)
    assert buffered.readinto(buffer) == 3
    assert buffer == b"cde"
    monkeypatch.setattr(buffered, "error", OSError(28, "No space left on device"))
    buffered.seek(6)
    assert buffered.write(b"gh") == 2  # kept in memory
    buffered.seek(4)
    buffer = bytearray(6)
    assert buffered.readinto(buffer) == 6
    assert buffer == b"efgh\0\0"
    with pytest.raises(OSError, match="No space"), buffered:
        pass
