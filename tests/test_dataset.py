"""Result files as xarray datasets, and what follows from the samples of a motion."""

import os
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import ROOT

import hodo_cli
from hodo_cli import HodoError
from hodo_cli.cases.config import load
from hodo_cli.results.dataset import motion_from

SAMPLE = ROOT / "tests" / "data" / "format1.h5"
pytestmark = pytest.mark.filterwarnings("ignore:.*format1.h5 has no checksums:UserWarning")


FIG4: dict[str, Any] = {
    "model": "linear-diag",
    "inertia": [1, 0.8, 0.6],
    "damping": [0.005, 0.004, 0.003],
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
    "time": {"end": 400, "samples": 3},
}


def sample(name: str, **changed: Any) -> Any:
    """A case of the committed sample of the format, with other variables; its `spin` names no
    model, and takes that of `fig4` here."""
    cases = hodo_cli.open(SAMPLE)
    data = cases[name].assign_attrs(case=cases["fig4"].attrs["case"])
    return motion_from(data.assign(changed), name)


def test_cases_of_the_sample() -> None:
    cases = hodo_cli.open(SAMPLE)
    assert list(cases) == ["fig4", "spin"]
    assert len(cases) == 2
    assert "_claims" in cases
    assert "fig5" not in cases
    with pytest.raises(KeyError, match="fig5"):
        cases["fig5"]
    assert "fig4:" in cases.attrs["config"]
    fig4, spin = cases["fig4"], cases["spin"]
    assert fig4["omega"].dims == ("time", "axis")
    assert fig4["axis"].values.tolist() == ["x1", "x2", "x3"]
    assert fig4["omega"].sel(time=0.0, axis="x3") == 0.74
    assert fig4["enclosed_axis"].dtype == np.int8
    assert fig4["enclosed_axis"].values.tolist() == [1, 1, 3, 3, 3]
    assert fig4["enclosed_axis"].attrs["flag_values"].tolist() == [-1, 0, 1, 2, 3]
    assert fig4["crossing_time"].dims == ("crossing",)
    assert "crossing" not in fig4.coords
    assert fig4.attrs["steps"] == 296
    assert fig4.attrs["warnings"] == "first\nsecond"
    assert spin["event_kind"].values.tolist() == ["end of spin"]
    assert np.isnan(spin.attrs["error"])


def test_every_column_of_a_sweep_that_a_case_may_ask_for_is_declared() -> None:
    swept = FIG4 | {"sweep": {"damping.0": {"values": [0.005, 0.006]}}}
    with pytest.raises(HodoError) as refusal:
        hodo_cli.Case.of(swept | {"store": ["none"]})
    declared = re.search(r"\(valid: (.*)\)", str(refusal.value))
    assert declared
    names = set(declared[1].split(", ")) - {"trajectory"}
    assert set(hodo_cli.sweep(swept | {"store": [*names]}).data_vars) == names
    assert names - {"steps", "share", "separation"} == set(hodo_cli.sweep(swept).data_vars)


def test_what_x_and_y_of_the_averaged_cavity_determine() -> None:
    case = load(ROOT / "configs" / "paper2.yaml").cases["fig1"]
    data = hodo_cli.run(case)
    A, _, C = case.data["inertia"]
    assert data.x[0] == data.y[0] == 1
    G = np.hypot(A * np.sqrt(data.x), C * np.sqrt(data.y))
    np.testing.assert_allclose(motion_from(data, "fig1")["G"], G, rtol=2e-15)


def test_what_omega_determines() -> None:
    """Against the definitions, D as G^2 - 2 T A2."""
    m = sample("fig4")
    p, q, r = m.stored("omega").T
    np.testing.assert_allclose(m.G.T, [p, 0.8 * q, 0.6 * r], rtol=1e-15)
    for axis, component in zip(("x1", "x2", "x3"), m.G.T, strict=True):
        assert (m[f"G.{axis}"] == component).all()
    G2, T = p**2 + 0.64 * q**2 + 0.36 * r**2, (p**2 + 0.8 * q**2 + 0.6 * r**2) / 2
    for name, expected in {
        "G2": G2,
        "G": np.sqrt(G2),
        "T": T,
        "p": p,
        "r": r,
        "x": p**2 + q**2,
        "y": r**2,
        "x1_direction": np.abs(p) / np.sqrt(G2),
    }.items():
        np.testing.assert_allclose(m[name], expected, rtol=2e-15, err_msg=name)
    np.testing.assert_allclose(m["D"], G2 - 2 * T * 0.8, atol=1e-15)
    np.testing.assert_allclose(m["D/2T"], G2 / (2 * T) - 0.8, atol=1e-15)
    np.testing.assert_allclose(m["separatrix_distance"], np.abs(m["D"]) / G2, rtol=1e-14)
    assert (np.sign(m["D"]) == np.where(m.labels == 1, 1, -1)).all()


def test_the_momentum_is_right_where_its_square_is_lost() -> None:
    m = sample("fig4")
    tiny = sample("fig4", omega=(("time", "axis"), m.omega * 2.0**-1000))
    assert (tiny["G"] == m["G"] * 2.0**-1000).all()
    assert (tiny["G2"] == 0).all()
    with pytest.raises(HodoError, match=r"unknown variable 'speeed'; did you mean 'speed'\?"):
        m["speeed"]
    with pytest.raises(HodoError, match="case fig4 has no gamma, which Gz needs"):
        m["Gz"]
    with pytest.raises(HodoError, match="case spin has no labels of the enclosed axis: run"):
        _ = sample("spin").crossings


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_no_permission(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_bytes(SAMPLE.read_bytes())
    (tmp_path / "a.h5").chmod(0)
    with pytest.raises(HodoError, match="permission denied"):
        hodo_cli.open(tmp_path / "a.h5")


@pytest.mark.filterwarnings("ignore:.*has no checksums:UserWarning")
def test_labels_of_motions_with_a_rotor_in_files_of_0_2_are_read_as_undetermined(tmp_path):
    """About both outer axes they were 4, and without a separatrix 5."""
    body = {"model": "torques", "inertia": [1, 0.8, 0.6], "rotor": [0, 0, 0.2], "damping": 0.01}
    motion = hodo_cli.run(
        {**body, "initial": {"p": 1, "q": 2, "r": 3}, "time": {"values": [1, 2, 3]}}
    )
    old = motion.assign(enclosed_axis=motion.enclosed_axis.copy(data=np.array([1, 4, 5], "i1")))
    path = tmp_path / "old.h5"
    old.to_netcdf(path, group="case", engine="netcdf4")
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 1
    with pytest.warns(UserWarning, match="labels 4 and 5, of motions with a rotor, are read as -1"):
        again = hodo_cli.open(path)["case"]
    assert again.enclosed_axis.values.tolist() == [1, -1, -1]
