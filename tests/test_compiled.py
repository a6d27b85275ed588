"""Compiled code on the disk: the user's own, and no more than there is room for."""

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Hodo

from hodo_cli import machine

COMPILE = "from hodo_cli.machine import cached_code; print(cached_code('key', lambda: [1, 2]))"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the code, which is not there yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "hodo"


def test_processes_that_begin_together_store_one_code_of_the_users_own(folder: Path) -> None:
    processes = [
        subprocess.Popen([sys.executable, "-c", COMPILE], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    assert {process.communicate()[0] for process in processes} == {"[1, 2]\n"}
    assert machine.cached_code("key", lambda: "anew") == [1, 2]
    assert os.listdir(folder) == ["key.code"]
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("damage", ["cut", "empty", "of another version"])
def test_code_that_a_disk_has_torn_is_compiled_anew(folder: Path, damage: str) -> None:
    assert machine.cached_code("key", lambda: "sound") == "sound"
    file = folder / "key.code"
    sound = file.read_bytes()
    others = sound[16:] + bytes(range(128, 160))
    file.write_bytes({"cut": sound[:-1], "empty": b"", "of another version": others}[damage])
    assert machine.cached_code("key", lambda: "new") == "new"
    assert machine.cached_code("key", lambda: "other") == "new"


def test_a_folder_that_others_can_reach_is_not_used(folder: Path) -> None:
    assert machine.cached_code("key", lambda: 1) == 1
    folder.chmod(0o755)
    assert machine.cached_code("key", lambda: 2) == 2
    folder.chmod(0o700)
    assert machine.cached_code("key", lambda: 3) == 1


def test_the_code_that_was_used_last_stays(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "MOST_FILES", 2)
    for name in "ab":
        machine.cached_code(name, lambda: bytes(10))
        os.utime(folder / f"{name}.code", (1, 1 + ord(name)))
    machine.cached_code("a", bytes)  # is used, so that b is the oldest
    machine.cached_code("c", lambda: bytes(10))
    assert sorted(os.listdir(folder)) == ["a.code", "c.code"]


@pytest.mark.heyoka
@pytest.mark.parametrize("is_named", [False, True])
def test_what_heyoka_compiles_is_kept_within_bounds(tmp_path, monkeypatch, is_named):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if is_named:
        monkeypatch.setenv("HEYOKA_CACHE_DIR", str(tmp_path / "own"))
    else:
        monkeypatch.delenv("HEYOKA_CACHE_DIR", raising=False)
    code = """
import heyoka as hy
from hodo_cli.engines import taylor
x = hy.make_vars("x")
hy.taylor_adaptive([(x, -x)], [1.0])
print(hy.llvm_state.get_diskcache_limit())
"""
    limit = subprocess.check_output([sys.executable, "-c", code], text=True)
    folder = tmp_path / ("own" if is_named else "hodo/heyoka")
    assert (folder / "cache.db").stat().st_size > 0
    assert (int(limit) <= 256 << 20) != is_named
    assert os.listdir(tmp_path) == [folder.relative_to(tmp_path).parts[0]]


SWEEP = """\
cases:
  a: {model: tensor, inertia: [1, 0.8, 0.6], resistance: {diagonal: 0.003, off_diagonal: 0.001},
      time: {end: 400}, error: off, initial: {p: 0, q: 0, G: 1},
      sweep: {direction: {sphere: {count: 600, seed: 1}}}}
"""


@pytest.mark.process
@pytest.mark.heyoka
def test_a_step_from_the_disk_gives_the_same_bits(folder: Path, hodo: Hodo) -> None:
    (folder.parent / "x.yaml").write_text(SWEEP)
    columns = []
    for out in ("compiled", "loaded"):
        assert hodo("run", "x.yaml", "--out", out).returncode == 0
        stored = {path.name: path.read_bytes() for path in folder.glob("*.code")}
        with h5py.File(folder.parent / out / "x.h5") as file:
            columns.append({name: item[()] for name, item in file["a"].items()})
    assert len(stored) == 2  # the step, and its event
    assert columns[0].keys() == columns[1].keys()
    for name, values in columns[0].items():
        np.testing.assert_array_equal(values, columns[1][name], err_msg=name)
