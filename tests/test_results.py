"""Result files as other programs see them, in processes of their own as netCDF4 brings an HDF5
library, and what `hodo` does with files that are none."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from conftest import ROOT, Hodo, call

import hodo_cli
from hodo_cli import HodoError

CONFIG = """\
title: Körper
references: "Somebody (2020)"
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}}
cases:
  fig4: {damping: [0.005, 0.004, 0.003], time: {end: 400, samples: 41, unit: s}}
  never: {damping: [0.003, 0.004, 0.005], time: {end: 20, samples: 21}}
  swept: {damping: 0.004, time: {end: 20}, error: off, sweep: {damping.2: {values: [0.001, 0.009]}}}
claims:
  - {id: crosses, where: here, statement: It crosses., cases: [fig4], expect: reproduced,
     check: {kind: axis, start: x1, end: x3}}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result with labels and verdicts, of which groups were written, copied and changed."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "a.yaml").write_text(CONFIG, encoding="utf-8")
    for command in ("run", "classify", "claims"):
        done = call(folder, command, "a.yaml")
        assert done.returncode == 0, done.stderr
    return folder / "runs" / "a.h5"


@pytest.fixture
def result(made: Path, tmp_path: Path) -> Path:
    """A copy of it, in the folder in which `hodo` runs."""
    return Path(shutil.copy(made, tmp_path / "a.h5"))


GROUPS = ["fig4", "never", "swept", "_claims", "_errata"]


def test_a_file_says_what_made_it(made: Path) -> None:
    with h5py.File(made) as file:
        root = dict(file.attrs)
    assert [*root][:2] == ["format_version", "Conventions"]
    assert (root["format_version"], root["Conventions"]) == (1, "CF-1.11")
    assert (root["title"], root["references"]) == ("Körper", "Somebody (2020)")
    assert (root["config"], root["config_path"]) == (CONFIG, "../a.yaml")
    commands = [line.split(" ", 1)[1] for line in root["history"].splitlines()]
    assert commands == [
        "hodo run a.yaml", "hodo classify runs/a.h5", "hodo claims runs/a.h5",
    ]  # fmt: skip
    for library in ("numpy", "scipy", "h5py"):
        assert root[f"{library}_version"][0].isdigit()
    assert root["python_version"] == sys.version.split()[0]


def test_groups_arrays_and_attributes_have_their_order(made: Path) -> None:
    with h5py.File(made) as file:
        assert [*file] == GROUPS
        case = file["fig4"]
        assert [*case][:3] == ["time", "omega", "axis"]
        assert [scale.keys() for scale in case["omega"].dims] == [["time"], ["axis"]]
        assert [scale.keys() for scale in case["enclosed_axis"].dims] == [["time"]]
        assert [*file["never/crossing_time"].shape] == [0]
        assert case["enclosed_axis"].attrs["flag_meanings"].split()[:2] == [
            "undetermined", "separatrix",
        ]  # fmt: skip
        assert file["_claims/verdict"].asstr()[()].tolist() == ["reproduced"]
        units = {name: item.attrs.get("units") for name, item in case.items()}
    assert (units["time"], units["omega"], units["axis"]) == ("s", "1/s", None)


def test_a_file_ends_with_the_hash_of_what_is_before(made: Path) -> None:
    from hashlib import sha256

    data = made.read_bytes()
    head, _, digest = data.rpartition(b"\nhodo sha256 ")
    assert sha256(head).hexdigest().encode() == digest


READERS = {
    "netcdf4": """
import json, sys, xarray as xr
tree = xr.open_datatree(sys.argv[1], engine=sys.argv[2])
print(json.dumps({name: {key: [list(v.dims), v.values.tolist(), str(v.attrs.get("units"))]
                         for key, v in node.variables.items()}
                  for name, node in tree.children.items()}))
""",
    "plain": """
import json, sys, netCDF4
with netCDF4.Dataset(sys.argv[1]) as file:
    file.set_auto_mask(False)
    print(json.dumps({name: {key: [list(v.dimensions), v[:].tolist(),
                                   str(v.__dict__.get("units"))]
                             for key, v in group.variables.items()}
                      for name, group in file.groups.items()}))
""",
}
READERS["h5netcdf"] = READERS["netcdf4"]


def alone(code: str, *arguments: object) -> Any:
    """What a fresh interpreter prints as JSON."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("reader", READERS)
def test_other_readers_find_the_same(made: Path, reader: str) -> None:
    read = alone(READERS[reader], made, reader)
    assert [*read] == GROUPS
    with h5py.File(made) as file:
        for name, group in file.items():
            for key, item in group.items():
                if b"not a netCDF variable" in item.attrs.get("NAME", b""):
                    continue
                dims, values, units = read[name][key]
                assert len(dims) == item.ndim
                assert units == str(item.attrs.get("units"))
                is_text = h5py.check_string_dtype(item.dtype)
                np.testing.assert_array_equal(values, item.asstr()[()] if is_text else item[()])


@pytest.mark.parametrize("tool", ["ncdump", "h5dump"])
def test_tools_print_it(made: Path, tool: str) -> None:
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")
    done = subprocess.run([tool, str(made)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for text in ("omega", "enclosed_axis", '"x1", "x2", "x3"', "undetermined separatrix x1 x2 x3"):
        assert text in done.stdout


APPEND = """
import netCDF4, sys
with netCDF4.Dataset(sys.argv[1], "a") as file:
    file["fig4"].createVariable("extra", "f8", ("crossing",))[:] = 7
    file["fig4"].setncattr("by", "hand")
print(1)
"""


def test_what_netcdf4_appends_stays(result: Path, hodo: Hodo) -> None:
    alone(APPEND, result)
    done = hodo("classify", "a.h5")
    assert done.returncode == 0, done.stderr
    assert done.stderr == "a.h5 has no checksum: damage to it would not show\n"
    with h5py.File(result) as file:
        assert file["fig4/extra"][()].tolist() == [7]
        assert file["fig4"].attrs["by"] in ("hand", b"hand")
    assert hodo("show", "a.h5").stderr == ""  # it has been written anew


def test_a_file_of_the_first_format_is_read(hodo: Hodo, tmp_path: Path) -> None:
    shutil.copy(ROOT / "tests" / "data" / "format1.h5", tmp_path / "old.h5")
    rows = json.loads(hodo("show", "old.h5", "--json").stdout)
    assert [row["case"] for row in rows] == ["fig4", "spin"]


def test_the_group_of_another_program_is_no_case_and_stays(result: Path, hodo: Hodo) -> None:
    mine = xr.Dataset({"x": ("n", np.arange(3.0))})
    mine.to_netcdf(result, mode="a", group="mine", engine="h5netcdf")
    for command in ("classify", "show", "compare"):
        done = hodo(command, *["a.h5"] * (1 + (command == "compare")))
        assert done.returncode == 0
        assert "mine" not in done.stdout + done.stderr
    with xr.open_dataset(result, group="mine", engine="h5netcdf") as kept:
        assert kept.x.values.tolist() == [0, 1, 2]


# Files that are not what they should be.


def with_version(path: Path, version: int | None) -> None:
    with h5py.File(path, "r+") as file:
        if version is None:
            del file.attrs["format_version"]
        else:
            file.attrs["format_version"] = version


BAD: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (lambda path: path.unlink(), "no such file or directory"),
    "dangling": (lambda path: (path.unlink(), path.symlink_to("nowhere")), "no such file or dir"),
    "folder": (lambda path: (path.unlink(), path.mkdir()), "a folder, not a file"),
    "empty": (lambda path: path.write_bytes(b""), "not an HDF5 file"),
    "text": (lambda path: path.write_text("cases:\n"), "not an HDF5 file"),
    "truncated": (lambda path: os.truncate(path, path.stat().st_size // 2), "truncated"),
    "foreign": (lambda path: with_version(path, None), "not a result of hodo"),
    "newer": (lambda path: with_version(path, 2), "newer format than this hodo reads: update hodo"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_files_give_one_line_and_stay_as_they_are(result: Path, hodo: Hodo, kind: str) -> None:
    spoil, message = BAD[kind]
    spoil(result)
    (result.parent / "a.yaml").write_text(CONFIG, encoding="utf-8")
    before = result.read_bytes() if result.is_file() else None
    commands = [(command, "a.h5") for command in ("show", "classify", "plot")]
    # A run makes what is missing, and replaces nothing that it cannot read.
    commands += [("run", "a.yaml", "--out", ".")] * (kind != "missing")
    for command in commands:
        done = hodo(*command)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert done.stderr.startswith("a.h5")
        assert message in done.stderr
    with pytest.raises(HodoError, match=rf"\A[^\n]*a\.h5[^\n]*{re.escape(message)}[^\n]*\Z"):
        hodo_cli.open(result)
    assert before is None or result.read_bytes() == before
    assert {path.name for path in result.parent.iterdir()} - {"a.h5"} == {"a.yaml"}


def test_damage_in_a_file_without_its_mark_is_named(result: Path, hodo: Hodo) -> None:
    """Each array has a checksum of its own."""
    with h5py.File(result) as file:
        place = result.read_bytes().index(file["fig4/omega"][:1].tobytes())
    data = bytearray(result.read_bytes().rpartition(b"\nhodo sha256 ")[0])
    data[place] ^= 1
    result.write_bytes(data)
    done = hodo("compare", "a.h5", "a.h5")
    assert done.returncode == 2
    assert "a.h5: fig4 is damaged" in done.stderr
