"""Result files as xarray datasets.

netCDF4 brings an HDF5 library of its own and must not meet that of h5py, which other tests load:
what is tested here runs in fresh interpreters, on the committed sample of the format and files made
from it.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "tests" / "data" / "format1.h5"
HEAD = f"""
import sys
import numpy as np
from hodo_cli import HodoError
from hodo_cli.results.dataset import derive, open_case, open_cases, open_root
SAMPLE = {str(SAMPLE)!r}
"""


def alone(code: str, *arguments: object) -> str:
    """What a fresh interpreter prints when it runs the code."""
    command = [sys.executable, "-c", HEAD + code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_cases_of_the_sample() -> None:
    alone("""
with open_cases(SAMPLE) as cases:
    assert list(cases) == ["fig4", "spin"] and len(cases) == 2 and "_claims" in cases
    fig4, spin = cases["fig4"], cases["spin"]
assert fig4.identical(open_case(SAMPLE, "fig4"))
assert fig4["omega"].dims == ("time", "axis") and fig4["axis"].values.tolist() == ["x1", "x2", "x3"]
assert fig4["omega"].sel(time=0.0, axis="x3") == 0.74
assert fig4["enclosed_axis"].dtype == np.int8 and fig4["enclosed_axis"].values.tolist() == [1, 1, 3, 3, 3]
assert fig4["enclosed_axis"].attrs["flag_values"].tolist() == [-1, 0, 1, 2, 3]
assert fig4["crossing_time"].dims == ("crossing",) and "crossing" not in fig4.coords
assert fig4.attrs["steps"] == 296 and fig4.attrs["warnings"] == "first\\nsecond"
assert spin["event_kind"].values.tolist() == ["end of spin"] and np.isnan(spin.attrs["error"])
root = open_root(SAMPLE)
assert root.attrs["Conventions"] == "CF-1.11" and root.attrs["format_version"] == 1
assert "cases:" in root.attrs["config"]
assert "h5py" not in sys.modules and "matplotlib" not in sys.modules
""")


def test_what_omega_determines() -> None:
    """Against the definitions, D as G^2 - 2 T A2; at 1e-200 its square is lost, |G| is not."""
    alone("""
case = derive(open_case(SAMPLE, "fig4"))
p, q, r = case["omega"].values.T
np.testing.assert_allclose(case["G"].values.T, [p, 0.8 * q, 0.6 * r], rtol=1e-15)
assert case["G"].dims == ("time", "axis") and case["G_norm"].dims == case["D"].dims == ("time",)
G2, T = p**2 + 0.64 * q**2 + 0.36 * r**2, (p**2 + 0.8 * q**2 + 0.6 * r**2) / 2
np.testing.assert_allclose(case["G2"], G2, rtol=1e-15)
np.testing.assert_allclose(case["G_norm"], np.sqrt(G2), rtol=1e-15)
np.testing.assert_allclose(case["T"], T, rtol=1e-15)
np.testing.assert_allclose(case["D"], G2 - 2 * T * 0.8, atol=1e-15)
assert (np.sign(case["D"]) == np.where(case["enclosed_axis"] == 1, 1, -1)).all()
tiny = open_case(SAMPLE, "fig4")
tiny["omega"] = tiny["omega"] * 2.0**-1000
assert (derive(tiny)["G_norm"] == case["G_norm"] * 2.0**-1000).all() and (derive(tiny)["G2"] == 0).all()
ensemble = open_case(SAMPLE, "fig4").expand_dims(member=2, axis=-1)
assert derive(ensemble)["T"].dims == ("time", "member") and (derive(ensemble)["T"].isel(member=1) == case["T"]).all()
spin = open_case(SAMPLE, "spin")
assert derive(spin).identical(spin)
""")


def test_bad_files_give_one_line(tmp_path: Path) -> None:
    data = SAMPLE.read_bytes()
    (tmp_path / "truncated.h5").write_bytes(data[: len(data) // 2])
    (tmp_path / "text.h5").write_text("cases:\n")
    (tmp_path / "folder.h5").mkdir()
    (tmp_path / "damaged.h5").write_bytes(data[: data.rindex(b"OHDR") + 10] + b"\xff" * 20)
    lines = alone(
        """
import netCDF4
from pathlib import Path
folder = Path(sys.argv[1])
netCDF4.Dataset(folder / "foreign.h5", "w").close()
with netCDF4.Dataset(folder / "newer.h5", "w") as newer:
    newer.format_version = np.int64(2)
for path in (*sorted(folder.iterdir()), folder / "missing.h5", Path(SAMPLE)):
    try:
        open_case(path, "fig5")
    except HodoError as error:
        print(error)
""",
        tmp_path,
    ).splitlines()
    expected = {
        "damaged": "truncated, or open for writing elsewhere",
        "folder": "a folder, not a file",
        "foreign": "no format_version",
        "newer": "format version 2, newer than 1: update hodo",
        "text": "not an HDF5 file",
        "truncated": "truncated, or open for writing elsewhere",
        "missing": "no such file or directory",
        "format1": "there is no case 'fig5'",
    }
    assert len(lines) == len(expected)
    for line, (name, message) in zip(lines, expected.items(), strict=True):
        assert f"{name}.h5" in line
        assert message in line


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_no_permission(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_bytes(SAMPLE.read_bytes())
    (tmp_path / "a.h5").chmod(0)
    code = "try: open_root(sys.argv[1])\nexcept HodoError as error: print(error)"
    assert "permission denied" in alone(code, tmp_path / "a.h5").lower()
