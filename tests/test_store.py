"""Result files: what is written is read back by every reader, and nothing finished is ever lost.

netCDF4 brings an HDF5 library of its own, so readers other than h5py run in processes of their own.
"""

import fcntl
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import call, exit_status, in_child, wait_until

from hodo_cli import BatchError, HodoError
from hodo_cli.cli import _end
from hodo_cli.storage import writer as writing
from hodo_cli.storage.finished_cases import finished_cases
from hodo_cli.storage.group import Group, Variable
from hodo_cli.storage.hdf5 import ResultFile, open_run
from hodo_cli.storage.writer import compose, update

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "tests" / "data" / "format1.h5"
KILLS = int(os.environ.get("HODO_KILLS", "10"))
ROOT_ATTRIBUTES = {
    "Conventions": "CF-1.11",
    "title": "Körper",
    "history": "begun",
    "config": "cases: {}\n",
}
FLAGS = {
    "flag_values": np.array([-1, 0, 1, 2, 3], dtype=np.int8),
    "flag_meanings": "undetermined separatrix x1 x2 x3",
}
CONFIG = """
cases:
  fig4: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0.1,
         initial: {p: 1, q: 2, r: 3}, time: {end: 1}}
"""


def group(n: int = 5, seed: int = 0, **attributes: Any) -> Group:
    """A case with n samples that its seed tells from others."""
    omega = np.random.default_rng(seed).normal(size=(n, 3))
    return Group(
        {
            "model": "linear-diag",
            "hash": f"hash {seed}",
            "status": "ok",
            "steps": seed,
            "error": 1e-15,
            **attributes,
        },
        {
            "time": Variable(("time",), np.linspace(0, 1, n), {"long_name": "time", "units": "1"}),
            "omega": Variable(
                ("time", "axis"), omega, {"long_name": "angular velocity", "units": "1"}
            ),
            "axis": Variable(
                ("axis",), np.array(["x1", "x2", "x3"], dtype=object), {"long_name": "axis"}
            ),
        },
    )


def labels(n: int = 5, crossings: int = 1, label: int = 1) -> Group:
    """What `classify` adds to a case."""
    sides = np.full(crossings, 3, dtype=np.int8)
    return Group(
        {"warnings": "one\ntwo"},
        {
            "enclosed_axis": Variable(("time",), np.full(n, label, dtype=np.int8), FLAGS),
            "crossing_time": Variable(("crossing",), np.arange(crossings) + 0.5, {"units": "1"}),
            "crossing_to": Variable(("crossing",), sides, FLAGS),
        },
    )


def write(path: Path, groups: dict[str, Group]) -> None:
    """A result that holds these groups."""
    with compose(path, ROOT_ATTRIBUTES, list(groups)) as writer:
        for name, item in groups.items():
            writer.add(name, item)


def assert_same(a: Group, b: Group) -> None:
    """Equal to the last bit, labels and order included."""
    assert dict(a.attributes) == dict(b.attributes)
    assert list(a.variables) == list(b.variables)
    for name, variable in a.variables.items():
        other = b.variables[name]
        assert (variable.dims, variable.data.shape) == (other.dims, other.data.shape)
        assert variable.data.dtype == other.data.dtype
        np.testing.assert_array_equal(variable.data, other.data, err_msg=name)
        for key, value in variable.attrs.items():
            np.testing.assert_array_equal(other.attrs[key], value)


def alone(code: str, *arguments: object) -> Any:
    """What a fresh interpreter prints as JSON."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def left(path: Path) -> list[str]:
    """What lies in a result's folder."""
    return sorted(os.listdir(path.parent))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "paper.h5"


# Written = read back


@pytest.mark.parametrize("crossings", [0, 1, 3])
def test_read_back(path: Path, crossings: int) -> None:
    item, marks = group(note="ü\n", nothing="", error=float("inf")), labels(crossings=crossings)
    item = Group({**item.attributes, **marks.attributes}, {**item.variables, **marks.variables})
    write(path, {"fig4": item, "b": group(0), "a": group(1)})
    with open_run(path) as run:
        assert_same(run.read("fig4"), item)
        assert run.cases() == ["fig4", "b", "a"]
        assert run.attributes == {**ROOT_ATTRIBUTES, "format_version": 1}
        assert run.text == "cases: {}\n"
        assert run.summary("fig4") == item.attributes
        assert run.summary("fig4", ["steps", "status"]) == {"status": "ok", "steps": 0}


def test_strings_that_HDF5_has_not(path: Path) -> None:
    write(path, {"a": group(message="nul \0 and \udcff")})
    with open_run(path) as run:
        assert run.summary("a")["message"] == "nul \ufffd and ?"


def test_attributes_of_other_programs(path: Path) -> None:
    """Plain ones as plain values, whatever their type in the file; and arrays."""
    write(path, {"a": group()})
    text = h5py.string_dtype()
    stored = {
        "list": (np.array(["z" * 100] * 50, dtype=text), ["z" * 100] * 50),
        "list of one": (np.array(["q"], dtype=text), ["q"]),
        "numbers": (np.arange(3.0), [0.0, 1.0, 2.0]),
        "fixed": (np.bytes_(b"abc"), "abc"),
        "ascii": (np.array("hi", dtype=h5py.string_dtype("ascii")), "hi"),
        "nothing": (h5py.Empty(text), ""),
        "empty": ("", ""),
        "true": (True, True),
        "byte": (np.int8(-3), -3),
        "large": (np.uint64(2**63 + 1), 2**63 + 1),
        "big-endian": (np.array(2.5, ">f8"), 2.5),
        "half as long": (np.float32(1.5), 1.5),
    }
    with h5py.File(path, "r+") as file:
        for name, (value, _) in stored.items():
            file["a"].attrs[name] = value
    with open_run(path) as run:
        found = run.summary("a", stored)
    assert {name: np.asarray(value).tolist() for name, value in found.items()} == {
        name: plain for name, (_, plain) in stored.items()
    }


@pytest.mark.parametrize("dtype", [bool, np.float16, np.longdouble, complex])
def test_types_that_netcdf_has_not(path: Path, dtype: type) -> None:
    wrong = Group({}, {"x": Variable(("n",), np.zeros(2, dtype=dtype))})
    with pytest.raises(TypeError, match="netCDF has no type"):
        write(path, {"a": wrong})
    assert left(path) == []


def test_dimensions_must_agree(path: Path) -> None:
    wrong = {"x": Variable(("n",), np.zeros(2)), "y": Variable(("n",), np.zeros(3))}
    with pytest.raises(ValueError, match="y has 3 values along n, elsewhere 2"):
        write(path, {"a": Group({}, wrong)})


def test_everything_tracks_its_order_and_numbers_have_checksums(path: Path) -> None:
    write(path, {"b": group(), "a": group(seed=1)})
    with update(path) as changes:
        changes.write("b", labels(crossings=0))
    with h5py.File(path) as file:
        assert list(file) == ["b", "a"]
        for name in ("b", "a"):
            assert list(file[name].attrs)[:2] == ["model", "hash"]
            assert list(file[name])[:3] == ["time", "omega", "axis"]
            assert all(
                item.fletcher32 == bool(item.dtype.kind in "fiu" and item.size and key in stored)
                for key, item in file[name].items()
                for stored in [("time", "omega", "enclosed_axis")]
            )
            assert [scale.keys() for scale in file[name]["omega"].dims] == [["time"], ["axis"]]


READERS = {
    "netcdf4": """
import json, sys, xarray as xr
tree = xr.open_datatree(sys.argv[1], engine=sys.argv[2])
def plain(attributes):
    return {key: x if isinstance(x, str) else float(x) for key, x in attributes.items()}
print(json.dumps({name: {
    "attributes": plain(node.attrs),
    "variables": {key: [list(v.dims), v.values.tolist(), v.dtype.kind, str(v.attrs.get("units")),
                        str(v.attrs.get("flag_values"))] for key, v in node.variables.items()},
} for name, node in tree.children.items()}))
""",
    "plain": """
import json, sys, netCDF4
def plain(attributes):
    return {key: x if isinstance(x, str) else float(x) for key, x in attributes.items()}
def described(v):
    kind = "U" if v.dtype is str else v.dtype.kind
    own = v.__dict__
    return [list(v.dimensions), v[:].tolist(), kind, str(own.get("units")),
            str(own.get("flag_values"))]
with netCDF4.Dataset(sys.argv[1]) as file:
    print(json.dumps({name: {
        "attributes": plain(g.__dict__),
        "variables": {key: described(v) for key, v in g.variables.items()},
    } for name, g in file.groups.items()}))
""",
}
READERS["h5netcdf"] = READERS["netcdf4"]


@pytest.mark.parametrize("reader", READERS)
def test_other_readers(path: Path, reader: str) -> None:
    """A file whose groups were written, copied from pieces, copied from a file, and changed."""
    write(path, {"kept": group(message="", error=float("nan"))})
    with compose(path, ROOT_ATTRIBUTES) as writer:
        writer.keep(finished_cases(path)["kept"][0])
        writer.add("new", group(3, 1))
    with update(path) as changes:
        changes.write("new", labels(3, 0))
        changes.write("_claims", labels(2, 2))
    read = alone(READERS[reader], path, reader)
    with open_run(path) as run:
        assert list(read) == [*run.groups] == ["kept", "new", "_claims"]
        for name in read:
            item = run.read(name)
            attributes = {
                key: value if isinstance(value, str) else float(value)
                for key, value in item.attributes.items()
            }
            assert read[name]["attributes"].pop("checksum").startswith("sha256:")
            assert read[name]["attributes"].pop("listed").startswith("{")
            np.testing.assert_equal(read[name]["attributes"], attributes)
            assert read[name]["variables"] == {
                key: [
                    list(v.dims),
                    v.data.tolist(),
                    "U" if v.data.dtype.kind == "O" else v.data.dtype.kind,
                    str(v.attrs.get("units")),
                    str(v.attrs.get("flag_values")),
                ]
                for key, v in item.variables.items()
            }


@pytest.mark.parametrize("tool", ["ncdump", "h5dump"])
def test_dumps(path: Path, tool: str) -> None:
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")
    write(path, {"old": group(2, message="")})
    with update(path) as changes:
        changes.write("old", labels(2, 0))
    done = subprocess.run([tool, str(path)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for text in ("omega", "enclosed_axis", '"x1", "x2", "x3"', "undetermined separatrix x1 x2 x3"):
        assert text in done.stdout


def test_netcdf4_can_append(path: Path) -> None:
    write(path, {"a": group()})
    with update(path) as changes:
        changes.write("a", labels())
    append = """
import netCDF4, sys
with netCDF4.Dataset(sys.argv[1], "a") as file:
    file["a"].createVariable("extra", "f8", ("crossing",))[:] = 7
    file["a"].setncattr("by", "hand")
print(1)
"""
    alone(append, path)
    with open_run(path) as run:
        assert run.read("a").variables["extra"].data.tolist() == [7]
        assert run.summary("a")["by"] == "hand"


SPIN = """
cases:
  spin: {model: cavity+constant, form: averaged, inertia: [8, 8, 4], kappa: 0.6,
         torque: [0, 0, -0.1], initial: {p: 1, q: 0, r: 1}, time: {end: 600, unit: s}}
  top: {model: Lagrange-averaged, inertia: {A: 1.5, C: 1}, mu: 0.5, a: [0.1], b: [0.1],
        initial: {theta: 60 deg, r: 1.7}, time: {end: 1}}
  body: {model: tensor, inertia: [1, 0.8, 0.6], resistance: {diagonal: 0.003, off_diagonal: 0.001},
         initial: {p: 1, q: 2, r: 3}, method: RK45, tol: 1e-4, time: {end: 100, unit: s}}
"""


def test_a_case_as_a_group(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(SPIN, encoding="utf-8")
    assert call(tmp_path, "run", "a.yaml").returncode == 0
    with open_run(tmp_path / "runs" / "a.h5") as run:
        item, top, body = (run.read(name) for name in ("spin", "top", "body"))
    assert {key: item.attributes[key] for key in ("model", "form", "status")} == {
        "model": "cavity+constant", "form": "averaged", "status": "ok",
    }  # fmt: skip
    for key in ("steps", "error", "run_time", "tol", "hash", "method", "method_reason"):
        assert item.attributes[key], key
    assert {name: variable.dims for name, variable in item.variables.items()} == {
        "time": ("time",), "x": ("time",), "y": ("time",),
        "event_time": ("event",), "event_kind": ("event",), "event_error": ("event",),
    }  # fmt: skip
    assert 0 < item.variables["event_error"].data[0] < 1e-10
    assert item.variables["event_kind"].data.tolist() == ["end_of_spin"]
    assert item.variables["event_time"].data == item.variables["time"].data[-1]
    units = {
        name: str(variable.attrs.get("units"))
        for name, variable in {**item.variables, **body.variables}.items()
    }
    assert units == {
        "time": "s", "x": "1/s^2", "y": "1/s^2", "event_time": "s", "event_kind": "None",
        "event_error": "s", "omega": "1/s", "axis": "None",
    }  # fmt: skip
    assert top.variables["time"].attrs["units"] == top.variables["r"].attrs["units"] == "1"
    assert "is more than ten times the 1e-04 asked for" in str(body.attributes["warnings"])
    for stored in (item.variables["x"], top.variables["Gz"]):
        assert stored.attrs["long_name"]
        assert 0 < stored.attrs["error"] < 1e-10


@pytest.mark.filterwarnings("ignore:.*has no checksums:UserWarning")
def test_sample_of_format_1() -> None:
    with open_run(SAMPLE) as run:
        assert (run.cases(), run.attributes["format_version"]) == (["fig4", "spin"], 1)
        assert "damping: [0.005, 0.004, 0.003]" in run.text
        fig4, spin = run.read("fig4"), run.read("spin")
        assert run.read("_claims").variables["verdict"].data.tolist() == [
            "reproduced",
            "contradicted",
        ]
    assert "damping: [0.005, 0.004, 0.003]" in fig4.attributes["case"]
    assert fig4.variables["omega"].data[0].tolist() == [0.8, 0.5, 0.74]
    assert fig4.variables["enclosed_axis"].data.tolist() == [1, 1, 3, 3, 3]
    assert fig4.variables["crossing_time"].data.tolist() == [305.3589551667110]
    assert spin.variables["event_kind"].data.tolist() == ["end of spin"]


# Files that are not what they should be


def make_newer(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 2


def make_foreign(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file.attrs["format_version"]


BAD: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (lambda path: path.unlink(), "no such file or directory"),
    "folder": (lambda path: (path.unlink(), path.mkdir()), "a folder, not a file"),
    "empty": (lambda path: path.write_bytes(b""), "not an HDF5 file"),
    "text": (lambda path: path.write_text("cases:\n"), "not an HDF5 file"),
    "truncated": (
        lambda path: os.truncate(path, path.stat().st_size // 2),
        "truncated: its end is missing",
    ),
    "foreign": (make_foreign, "no format_version"),
    "newer": (make_newer, "format version 2, newer than 1: update hodo"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_give_one_line_and_stay_as_they_are(path: Path, name: str) -> None:
    write(path, {"a": group()})
    spoil, message = BAD[name]
    spoil(path)
    before = path.read_bytes() if path.is_file() else None
    actions: list[Callable[[], Any]] = [
        lambda: open_run(path).__enter__(),
        lambda: update(path).__enter__(),
    ]
    if name != "missing":
        actions += [lambda: finished_cases(path), lambda: compose(path, {}).__enter__()]
    for action in actions:
        with pytest.raises(HodoError, match=message) as caught:
            action()
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
    assert left(path) == ([] if name == "missing" else ["paper.h5"])
    assert before is None or path.read_bytes() == before


def test_locked(path: Path) -> None:
    write(path, {"a": group()})
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with (
            pytest.raises(HodoError, match="locked: another program has it open for writing"),
            open_run(path),
        ):
            pass


def test_a_folder_without_file_locks_is_named(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(path, {"a": group()})

    def refuse(*_: Any, **__: Any) -> None:
        raise OSError("Unable to synchronously open file (unable to lock file, errno = 95)")

    monkeypatch.setattr(h5py, "File", refuse)
    with pytest.raises(HodoError, match="no file locks; set HDF5_USE_FILE"):
        open_run(path).__enter__()


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_no_permission(path: Path) -> None:
    write(path, {"a": group()})
    path.chmod(0)
    with pytest.raises(HodoError, match="permission denied"), open_run(path):
        pass


def test_damage_inside(path: Path) -> None:
    write(path, {"a": group(1000), "b": group(seed=1)})
    data = path.read_bytes()
    header = data.rindex(b"OHDR") + 10
    path.write_bytes(data[:header] + b"\xff" * 20 + data[header + 20 :])
    with open_run(path) as run, pytest.raises(HodoError, match="is damaged"):
        [run.read(name) for name in run.groups]


def test_unknown_case(path: Path) -> None:
    write(path, {"a": group()})
    with open_run(path) as run:
        for name in ("b", "a/omega", "..", ""):
            with pytest.raises(HodoError, match="there is no case"):
                run.read(name)


# Making a result


def test_order_is_that_asked_for(path: Path) -> None:
    with compose(path, ROOT_ATTRIBUTES, ["a", "b", "c", "d"]) as writer:
        for name in ("x", "c", "a", "b"):
            writer.add(name, group())
    with open_run(path) as run:
        assert run.cases() == ["a", "b", "c", "x"]


def test_after_an_exception_the_old_file_stays_and_finished_cases_are_found(path: Path) -> None:
    write(path, {"a": group()})
    before = path.read_bytes()
    with suppress(KeyboardInterrupt), compose(path, ROOT_ATTRIBUTES) as writer:
        writer.add("b", group(seed=1))
        raise KeyboardInterrupt
    assert path.read_bytes() == before
    assert {name: [item.attributes["hash"] for item in items] for name,
            items in finished_cases(path).items()} == {
        "a": ["hash 0"], "b": ["hash 1"],
    }  # fmt: skip
    with compose(path, ROOT_ATTRIBUTES) as writer:
        assert all(writer.keep(items[0]) for items in finished_cases(path).values())
        writer.add("c", group(seed=2))
    with open_run(path) as run:
        assert run.cases() == ["a", "b", "c"]
        for seed, name in enumerate("abc"):
            assert_same(run.read(name), group(seed=seed))
    assert left(path) == ["paper.h5"]


def test_nothing_new_leaves_the_file_alone(path: Path) -> None:
    write(path, {"a": group(), "b": group()})
    before = path.stat()[:7], path.stat().st_mtime_ns  # reading may change the time of access
    for _ in range(2):
        with compose(path, {**ROOT_ATTRIBUTES, "history": "again"}, ["a", "b"]) as writer:
            for items in finished_cases(path).values():
                writer.keep(items[0])
    assert (path.stat()[:7], path.stat().st_mtime_ns) == before
    with compose(
        path, {**ROOT_ATTRIBUTES, "config": "other", "history": "again"}, ["a", "b"]
    ) as writer:
        writer.keep(finished_cases(path)["b"][0])
    with open_run(path) as run:
        assert (run.cases(), run.text, run.attributes["history"]) == (
            ["b"],
            "other",
            "begun\nagain",
        )


def test_labels_and_claims_when_cases_are_kept(path: Path) -> None:
    """Labels belong to a case and stay with it; claims are about all cases and go when one is
    new."""
    write(path, {"a": group()})
    with update(path) as changes:
        changes.write("a", labels())
        changes.write("_claims", labels())
    with compose(path, ROOT_ATTRIBUTES) as writer:
        writer.keep(finished_cases(path)["a"][0])
        writer.add("b", group())
    with open_run(path) as run:
        assert [*run.groups] == ["a", "b"]
        assert "enclosed_axis" in run.read("a").variables


def test_what_another_process_wrote_meanwhile_is_kept(path: Path) -> None:
    write(path, {"a": group(), "b": group(seed=1), "gone": group()})
    with compose(path, ROOT_ATTRIBUTES, ["a", "b", "c"]) as writer:
        writer.keep(finished_cases(path)["a"][0])
        writer.add("b", group(seed=1, steps=5))
        writer.add("c", group(seed=2))
        with compose(path, ROOT_ATTRIBUTES) as other:
            for name in ("a", "b", "gone"):
                other.keep(finished_cases(path)[name][0])
            other.add("c", group(seed=3))
            other.add("d", group(seed=4))
        with update(path) as changes:
            changes.write("a", labels())
            changes.write("b", labels(label=3))
    with open_run(path) as run:
        assert run.cases() == ["a", "b", "c", "d"]
        assert "enclosed_axis" in run.read("a").variables
        assert run.read("b").variables["enclosed_axis"].data[0] == 3
        assert [run.summary(name)["hash"] for name in "cd"] == ["hash 2", "hash 4"]
    assert left(path) == ["paper.h5"]


def test_a_shard_that_vanished_is_not_kept(path: Path) -> None:
    write(path, {"a": group()})
    with suppress(KeyboardInterrupt), compose(path, ROOT_ATTRIBUTES) as writer:
        writer.add("b", group())
        raise KeyboardInterrupt
    with compose(path, ROOT_ATTRIBUTES) as writer:
        (lost,) = finished_cases(path)["b"]
        lost.file.unlink()
        assert not writer.keep(lost)
        assert not writer.keep(replace(lost, file=path))
        assert writer.keep(finished_cases(path)["a"][0])


def test_two_runs_at_once(path: Path) -> None:
    """Both make all cases of one result, in different order; whoever ends last has all."""
    names = [f"c{i}" for i in range(30)]

    def run(order: list[str]) -> None:
        with compose(path, ROOT_ATTRIBUTES, names) as writer:
            for name in order:
                writer.add(name, group(seed=int(name[1:])))

    children = [in_child(lambda order=order: run(order)) for order in (names, names[::-1])]
    assert [exit_status(child) for child in children] == [0, 0]
    with open_run(path) as result:
        assert result.cases() == names
        for seed, name in enumerate(names):
            assert_same(result.read(name), group(seed=seed))
    assert left(path) == ["paper.h5"]


def test_short_cases_share_pieces(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A death costs those that are in no piece yet, which nobody was told are finished."""
    monkeypatch.setattr(writing, "SHARD_SECONDS", 1000)
    told = path.parent / "told"

    def run() -> None:
        with compose(path, ROOT_ATTRIBUTES) as writer, told.open("a") as report:
            for i in range(5):
                took = 1001.0 if i in (1, 3) else 0.0
                then = partial(print, f"c{i}", file=report, flush=True)
                writer.add(f"c{i}", group(seed=i, run_time=took), then)
            assert len([*path.parent.glob(".*/[0-9]*.h5")]) == 2
            os._exit(3)

    path.parent.mkdir()
    assert exit_status(in_child(run)) == 3
    stored = [f"c{i}" for i in range(4)]
    assert told.read_text().split() == stored
    assert sorted(finished_cases(path)) == stored


def test_a_case_does_not_wait_if_it_was_long_or_nothing_was_stored_for_long(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writing, "SHARD_SECONDS", 1000)
    told: list[str] = []
    with compose(path, ROOT_ATTRIBUTES) as writer:
        writer.add("short", group(run_time=1.0), lambda: told.append("short"))
        assert not told
        writer.add("long", group(run_time=1001.0), lambda: told.append("long"))
        assert told == ["short", "long"]
        writer.add("first", group(), lambda: told.append("first"))
        monkeypatch.setattr(writing, "SHARD_SECONDS", 0.01)
        time.sleep(0.02)
        assert told == ["short", "long"]
        writer.add("second", group(), lambda: told.append("second"))
        assert sorted(finished_cases(path)) == sorted(told) == ["first", "long", "second", "short"]


def test_parts_are_written_while_cases_are_stored(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writing, "SHARD_SECONDS", 0.0)
    many = 10
    with compose(path, ROOT_ATTRIBUTES) as writer:
        for i in range(many):
            writer.add(f"c{i}", group(seed=i))
            writer.add_chunk("stamp", i, group(200, i))
        assert writer.chunks("stamp") == set(range(many))
        for i in range(many):
            assert_same(writer.chunk("stamp", i), group(200, i))
    with open_run(path) as run:
        assert run.cases() == [f"c{i}" for i in range(many)]


def test_a_case_that_cannot_be_stored_takes_no_other_along(path: Path) -> None:
    wrong = Group({}, {"x": Variable(("n",), np.zeros(2, dtype=bool))})
    with pytest.raises(TypeError, match="netCDF"):  # noqa: PT012, SIM117
        with compose(path, ROOT_ATTRIBUTES) as writer:
            for name, item in {"a": group(), "wrong": wrong, "b": group(seed=1)}.items():
                writer.add(name, item)
    assert sorted(finished_cases(path)) == ["a", "b"]


def test_killed_at_any_moment_while_running(path: Path, tmp_path: Path) -> None:
    """Every case that was reported finished survives, and each next run takes the earlier ones'
    over."""
    log, names = tmp_path / "log", [f"c{i}" for i in range(15)]

    def run() -> None:
        def say(name: str) -> None:
            report.write(f"{name}\n")
            report.flush()

        with log.open("a") as report, compose(path, ROOT_ATTRIBUTES, names) as writer:
            finished = finished_cases(path)
            for i, name in enumerate(names):
                if name not in finished or not writer.keep(finished[name][0]):
                    writer.add(name, group(200, i), partial(say, name))
                    if i % 4 == 3:
                        writer.store()

    began = time.perf_counter()
    assert exit_status(in_child(run)) == 0
    whole, dice = time.perf_counter() - began, random.Random()
    for _ in range(KILLS):
        shutil.rmtree(path.parent)
        for least in (0, 1):
            log.write_text("")
            child = in_child(run)
            wait_until(lambda least=least: len(finished_cases(path)) >= least)
            time.sleep(dice.uniform(0, whole))
            os.kill(child, signal.SIGKILL)
            exit_status(child)
            for name in log.read_text().split():
                assert name in finished_cases(path)
        assert finished_cases(path)
        run()
        with open_run(path) as result:
            assert result.cases() == names
            for i, name in enumerate(names):
                assert_same(result.read(name), group(200, i))
        assert left(path) == ["paper.h5"]


def test_killed_at_any_moment_while_changing(path: Path) -> None:
    names = [f"c{i}" for i in range(15)]
    write(path, {name: group(200, i) for i, name in enumerate(names)})

    def label(value: int) -> None:
        with update(path) as changes:
            for name in names:
                changes.write(name, labels(200, value % 3, value))

    began = time.perf_counter()
    assert exit_status(in_child(lambda: label(0))) == 0
    whole, dice, old = time.perf_counter() - began, random.Random(), 0
    for turn in range(1, KILLS + 1):
        child = in_child(lambda turn=turn: label(turn % 100))
        time.sleep(dice.uniform(0, whole))
        os.kill(child, signal.SIGKILL)
        exit_status(child)
        with open_run(path) as run:
            found = {int(run.read(name).variables["enclosed_axis"].data[0]) for name in names}
            assert found in ({old}, {turn % 100})
            assert all(run.read(name).variables["omega"].data.shape == (200, 3) for name in names)
        (old,) = found
    label(99)
    assert left(path) == ["paper.h5"]


def test_the_folder_of_a_living_run_is_left_alone(path: Path) -> None:
    with compose(path, ROOT_ATTRIBUTES) as first:
        first.add("a", group())
        first.store()
        with compose(path, ROOT_ATTRIBUTES) as second:
            assert second.keep(finished_cases(path)["a"][0])
        first.add("b", group())
    with open_run(path) as run:
        assert run.cases() == ["a", "b"]
    assert left(path) == ["paper.h5"]


def test_a_case_that_a_run_publishes_as_its_shard_is_looked_up_is_not_lost(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(path, {"a": group()})
    with ExitStack() as running:
        first = running.enter_context(compose(path, ROOT_ATTRIBUTES))
        first.keep(finished_cases(path)["a"][0])
        first.add("b", group(seed=1))
        first.store()

        def late(*arguments: Any) -> AbstractContextManager[writing.Writer]:
            running.close()
            return compose(*arguments)

        monkeypatch.setattr(writing, "compose", late)
        writing.publish_finished(path)
    with open_run(path) as run:
        assert run.cases() == ["a", "b"]


def test_a_shard_that_goes_after_it_was_kept_is_taken_from_the_result(path: Path) -> None:
    with suppress(KeyboardInterrupt), compose(path, ROOT_ATTRIBUTES) as writer:
        writer.add("a", group())
        raise KeyboardInterrupt
    (shard,) = (item.file for item in finished_cases(path)["a"])
    kept = shard.read_bytes()
    writing.publish_finished(path)
    shard.write_bytes(kept)  # its run has published it, and not yet cleared
    with compose(path, ROOT_ATTRIBUTES) as writer:
        assert writer.keep(finished_cases(path)["a"][1])
        writer.add("b", group(seed=1))
        shard.unlink()
    with open_run(path) as run:
        assert run.cases() == ["a", "b"]


@pytest.mark.parametrize("size", [1000, 12_000, 60_000])
def test_no_space(path: Path, size: int) -> None:
    """The limit strikes in a piece, or when the pieces are joined."""
    write(path, {"a": group()})
    before = path.read_bytes()
    code = """
import resource, signal, sys
sys.path.insert(0, "tests")
from test_store import *
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
try:
    with compose(Path(sys.argv[1]), ROOT_ATTRIBUTES) as writer:
        for seed in range(30):
            writer.add(f"c{seed}", group(seed=seed))
except BatchError as error:
    print(json.dumps(str(error)))
"""
    assert (
        alone(code, path, size) == f"cannot write {path}: file too large; finished cases are kept"
    )
    assert path.read_bytes() == before
    assert set(finished_cases(path)) == (
        {"a"} if size == 1000 else {"a"} | {f"c{i}" for i in range(30)}
    )


def test_a_signal_in_a_long_case_costs_none_of_the_short_ones_before_it(path: Path) -> None:
    def outcomes() -> Iterator[str]:
        yield "a"
        os.kill(os.getpid(), signal.SIGINT)
        yield "b"

    def run() -> None:
        signal.signal(signal.SIGINT, _end)
        with compose(path, ROOT_ATTRIBUTES) as writer:
            for name in writer.between(outcomes()):
                writer.add(name, group())

    assert exit_status(in_child(run)) == 128 + signal.SIGINT
    assert set(finished_cases(path)) == {"a"}


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_read_only_folder(path: Path) -> None:
    write(path, {"a": group()})
    path.parent.chmod(0o555)
    with compose(path, ROOT_ATTRIBUTES) as writer:
        writer.keep(finished_cases(path)["a"][0])
        with pytest.raises(BatchError, match="permission denied"):
            writer.add("b", group())


# The secret that a checksum is keyed with

SECRET = "from hodo_cli.private import secret; print(secret().hex())"


def secrets(state: Path, count: int) -> list[tuple[str, str]]:
    """What so many processes that begin together take for the secret, and what they say."""
    environment = {**os.environ, "XDG_STATE_HOME": str(state)}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", SECRET], env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )
        for _ in range(count)
    ]  # fmt: skip
    return [process.communicate() for process in processes]


def test_the_secret_is_made_once_and_is_the_users_own(tmp_path: Path) -> None:
    """By processes that begin together, too."""
    ((secret, warning),) = set(secrets(tmp_path / "state", 12))
    assert (len(secret), warning) == (2 * 32 + 1, "")
    folder = tmp_path / "state" / "hodo"
    assert os.listdir(folder) == ["secret"]
    assert [path.stat().st_mode & 0o777 for path in (folder, folder / "secret")] == [0o700, 0o600]


def test_a_secret_that_others_can_reach_is_refused(tmp_path: Path) -> None:
    ((secret, _),) = secrets(tmp_path, 1)
    file = tmp_path / "hodo" / "secret"
    file.parent.chmod(0o755)
    ((other, warning),) = secrets(tmp_path, 1)
    assert other != secret
    assert "mode 0700" in warning
    file.parent.chmod(0o700)
    file.write_bytes(b"")
    ((other, warning),) = secrets(tmp_path, 1)
    assert (other != secret, "has not 32 bytes" in warning) == (True, True)


def test_without_a_home_each_process_has_a_secret_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "state").touch()
    (first, warning), (second, _) = secrets(tmp_path / "state", 2)
    assert (first != second, warning) == (True, "")


# Changing a result


def test_update_twice_changes_nothing(path: Path) -> None:
    write(path, {"a": group(), "b": group(seed=1)})
    unknown = Variable(("crossing",), np.array([float("nan"), 1e-12]))
    before = None
    for _ in range(3):
        with update(path, "classified") as changes:
            changes.write(
                "a",
                Group(
                    {"error": float("nan")}, {**labels(crossings=2).variables, "unknown": unknown}
                ),
            )
            changes.write("b", labels(crossings=0))
            changes.write("_claims", labels())
        now = path.read_bytes(), path.stat().st_mtime_ns
        before = before or now
        assert now == before
    with open_run(path) as run:
        assert run.attributes["history"] == "begun\nclassified"
        assert [*run.groups] == ["a", "b", "_claims"]


def test_update_replaces_what_it_names_and_keeps_the_rest(path: Path) -> None:
    write(path, {"a": group(), "b": group(seed=1)})
    sizes = set()
    for crossings in (3, 1, 0, 2, 3):
        with update(path) as changes:
            changes.write("a", labels(crossings=crossings))
            changes.write(
                "_claims", Group({}, {f"v{crossings}": Variable(("claim",), np.arange(crossings))})
            )
        with open_run(path) as run:
            a = run.read("a")
            assert a.variables["crossing_time"].data.tolist() == [0.5, 1.5, 2.5][:crossings]
            assert a.attributes == {**group().attributes, "warnings": "one\ntwo"}
            np.testing.assert_array_equal(
                a.variables["omega"].data, group().variables["omega"].data
            )
            assert_same(run.read("b"), group(seed=1))
            assert list(run.read("_claims").variables) == [f"v{crossings}"]
        if crossings == 3:
            sizes.add(path.stat().st_size)
    assert len(sizes) == 1
    assert left(path) == ["paper.h5"]


def test_update_of_a_result_replaced_meanwhile(path: Path) -> None:
    """Labels of a case that has been run anew would be wrong, those of an equal one are right."""
    write(path, {"a": group(), "b": group(seed=1), "c": group(seed=2)})
    with update(path) as changes:
        for name in "abc":
            changes.write(name, labels())
        path.unlink()
        write(path, {"a": group(), "b": group(seed=7), "d": group()})
    with open_run(path) as run:
        assert run.cases() == ["a", "b", "d"]
        assert ["enclosed_axis" in run.read(name).variables for name in "abd"] == [
            True,
            False,
            False,
        ]


def test_update_reads_a_case_once_unless_the_result_is_replaced(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(path, {"a": group(), "b": group(seed=1)})
    names: list[str] = []
    read = ResultFile.read

    def noted(run: ResultFile, name: str) -> Group:
        names.append(name)
        return read(run, name)

    monkeypatch.setattr(ResultFile, "read", noted)
    with update(path) as changes:
        changes.write("a", labels())
    assert names == ["a"]
    with update(path) as changes:
        changes.write("b", labels())
        with update(path) as others:
            others.write("b", Group({"warnings": "theirs"}, {"more": Variable((), np.array(1.0))}))
    with open_run(path) as run:
        assert {"more", "enclosed_axis"} <= run.read("b").variables.keys()


def test_summaries_are_the_attributes_as_they_are_stored(path: Path) -> None:
    """A copy of the short ones serves while the file vouches for it, and never one that another
    program has written."""
    odd = {"tiny": 5e-324, "none": np.nan, "many": 2**62, "text": 'a"\n\ud800\0'}
    array = {"levels": np.array([0.5, 1.0]), "count": np.int64(7), "long": "x" * 5000}
    attributes = {**group().attributes, **odd, **array}
    write(path, {"a": replace(group(), attributes=attributes), "b": group()})

    def summaries() -> list[str]:
        with open_run(path) as run:
            whole = run.summary("a")
            assert "listed" not in whole
            picked = run.summary("a", ["lacking", *reversed(whole)])
            assert [*picked] == [*reversed(whole)]
            return [repr({key: found[key] for key in whole}) for found in (whole, picked)]

    first, second = summaries()
    assert first == second
    with h5py.File(path, "r+") as file:
        assert json.loads(file["a"].attrs["listed"]).keys() >= {"tiny", "none", "many", "count"}
        file["a"].attrs["listed"] = '{"tiny": 1}'
    assert summaries() == [first, first]
    with update(path) as changes:
        changes.write("b", labels())
    with h5py.File(path) as file:
        assert "listed" not in file["a"].attrs


def test_changed_cases_keep_their_places(path: Path) -> None:
    write(path, {name: group(seed=i) for i, name in enumerate("abcd")})
    with update(path) as changes:
        for name in "bc":
            changes.write(name, labels(), changes.run.read(name))
        changes.write("_claims", labels())
    with open_run(path) as run:
        assert [*run.groups] == ["a", "b", "c", "d", "_claims"]
        for i, name in enumerate("abcd"):
            more = labels() if name in "bc" else Group({}, {})
            variables = {**group(seed=i).variables, **more.variables}
            whole = Group({**group(seed=i).attributes, **more.attributes}, variables)
            assert_same(run.read(name), whole)


def test_a_failed_update_leaves_the_file(path: Path) -> None:
    write(path, {"a": group()})
    before = path.read_bytes()
    with pytest.raises(ValueError, match="elsewhere"), update(path) as changes:
        changes.write("a", labels(n=4))
    assert path.read_bytes() == before
    assert left(path) == ["paper.h5"]


# Provenance


def test_a_file_says_what_made_it(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(CONFIG, encoding="utf-8")
    assert call(tmp_path, "run", "a.yaml").returncode == 0
    with open_run(tmp_path / "runs" / "a.h5") as run:
        made = run.attributes
    assert made["history"][10:] == f"{made['history'][10:20]} hodo run a.yaml"
    assert made["h5py_version"] == h5py.__version__
    assert made["numpy_version"] == np.__version__
    if (ROOT / ".git").exists() and shutil.which("git"):
        head = subprocess.run(
            ["git", "-C", ROOT, "rev-parse", "HEAD"], capture_output=True, text=True, check=True
        )
        assert made["git_commit"] == head.stdout.strip()
        assert made["git_dirty"] in ("yes", "no")


def test_a_package_outside_a_checkout_without_a_library_says_so(tmp_path: Path) -> None:
    """A copy, from which one library is hidden with its metadata, and another with the folder where
    these are looked for first."""
    shutil.copytree(
        ROOT / "hodo_cli", tmp_path / "hodo_cli", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "mine"\n', encoding="utf-8")
    commit = ["git", "-c", "user.name=a", "-c", "user.email=a", "commit", "-qm", "x"]
    for command in (["git", "init", "-q"], ["git", "add", "pyproject.toml"], commit):
        subprocess.run(command, cwd=tmp_path, check=True)
    code = (
        "import importlib.metadata as metadata, json\n"
        "from hodo_cli import machine\n"
        "folders = machine.metadata_folders()\n"
        "hidden = 'scipy', 'numpy'\n"
        "known = [folder for folder in folders if not folder.name.startswith(hidden)]\n"
        "machine.metadata_folders = lambda: known\n"
        "plain = metadata.version\n"
        "def version(name):\n"
        "    if name == 'scipy':\n"
        "        raise metadata.PackageNotFoundError\n"
        "    return plain(name)\n"
        "metadata.version = version\n"
        "from hodo_cli.storage.provenance import versions\n"
        "print(json.dumps(versions()))\n"
    )
    # A dask worker may have told this process to import nothing from the current folder.
    env = {key: value for key, value in os.environ.items() if key != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    versions = json.loads(done.stdout)
    assert "git_commit" not in versions  # which would be that of the checkout it is copied into
    assert (versions["scipy_version"], versions["numpy_version"]) == (
        "not installed",
        np.__version__,
    )


def test_imports() -> None:
    code = "import json, sys, hodo_cli.storage.writer\n"
    code += "print(json.dumps([n for n, module in sys.modules.items() if module]))"
    loaded = set(alone(code))
    assert not loaded & {"netCDF4", "xarray", "heyoka", "scipy", "matplotlib"}
    assert "h5py" in loaded
