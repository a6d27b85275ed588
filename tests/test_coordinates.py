"""Quantities follow from a dataset by its coordinates: reversed, permuted, cut, put together,
transposed, or read back from another program's file."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

import hodo_cli as hodo
from hodo_cli import HodoError

FIG4 = {
    "model": "linear-diag",
    "inertia": [1, 0.8, 0.6],
    "damping": [0.005, 0.004, 0.003],
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
    "time": {"end": 1000, "samples": 201},
}
GRID = {"damping.2": {"linspace": [0.001, 0.006, 6]}, "damping.0": {"values": [0.004, 0.005]}}
NAMES = ("T", "J", "tilt", "theta", "G_space", "x3_space", "rotation")

Change = Callable[[xr.Dataset], xr.Dataset]


@pytest.fixture(scope="module")
def motion() -> xr.Dataset:
    return hodo.run({**FIG4, "attitude": "yes"})


@pytest.fixture(scope="module")
def grid() -> xr.Dataset:
    return hodo.sweep({**FIG4, "sweep": GRID})


def permuted(dim: str) -> Change:
    return lambda data: data.isel({dim: np.random.default_rng(5).permutation(data.sizes[dim])})


def backward(dim: str) -> Change:
    return lambda data: data.isel({dim: slice(None, None, -1)})


def halves_exchanged(data: xr.Dataset) -> xr.Dataset:
    middle = data.sizes["time"] // 2
    halves = data.isel(time=slice(middle, None)), data.isel(time=slice(middle))
    return xr.concat(halves, "time", data_vars="minimal", coords="minimal", compat="override")


def transposed(data: xr.Dataset) -> xr.Dataset:
    return data.transpose(*reversed([*data.sizes]))


SAME_MOTION: dict[str, Change] = {
    "reversed": backward("time"),
    "permuted": permuted("time"),
    "axes reversed": backward("axis"),
    "axes permuted": lambda data: data.isel(axis=[1, 2, 0]),
    "quaternions permuted": lambda data: data.isel(quaternion=[2, 0, 3, 1]),
    "concatenated": halves_exchanged,
    "transposed": transposed,
}


@pytest.mark.parametrize("change", SAME_MOTION)
def test_the_same_motion_has_the_same_quantities(motion: xr.Dataset, change: str) -> None:
    whole = hodo.derive(motion, *NAMES)
    same = hodo.derive(SAME_MOTION[change](motion), *NAMES)
    for name in NAMES:
        xr.testing.assert_equal(same[name].sortby("time").transpose("time", ...), whole[name])


SAME_SWEEP: dict[str, Change] = {
    "reversed": backward("damping.2"),
    "both reversed": lambda data: backward("damping.0")(backward("damping.2")(data)),
    "permuted": permuted("damping.2"),
    "axes permuted": lambda data: data.isel(axis=[1, 2, 0]),
    "transposed": transposed,
}


@pytest.mark.parametrize("change", SAME_SWEEP)
def test_the_same_sweep_has_the_same_quantities(grid: xr.Dataset, change: str) -> None:
    whole = hodo.derive(grid, "T", "G")
    same = hodo.derive(SAME_SWEEP[change](grid), "T", "G")
    for name in ("T", "G"):
        of_members = same[name].sortby(["damping.2", "damping.0"])
        xr.testing.assert_equal(of_members.transpose(*whole[name].dims), whole[name])


@pytest.mark.parametrize("engine", ["netcdf4", "h5netcdf"])
def test_what_xarray_has_written_and_read_has_the_same(motion, tmp_path, engine):
    derived = hodo.derive(motion, *NAMES)
    derived.to_netcdf(tmp_path / "a.nc", engine=engine)
    read = xr.load_dataset(tmp_path / "a.nc", engine=engine)
    for name in NAMES:
        xr.testing.assert_equal(hodo.derive(read, name)[name].drop_vars("space", errors="ignore"),
                                derived[name].drop_vars("space", errors="ignore"))  # fmt: skip


def test_one_member_of_a_sweep_has_the_quantities_of_its_end(grid: xr.Dataset) -> None:
    one = {"damping.0": 1, "damping.2": 2}
    alone, all_members = (hodo.derive(data, "T") for data in (grid.isel(one), grid))
    assert alone["T"].dims == ()
    assert float(alone["T"]) == float(all_members["T"].isel(one))
    # Nothing knows of the file that has held it.
    assert not grid.encoding


def test_a_member_with_its_samples_is_a_motion_of_its_own_body() -> None:
    bodies = {"zip": {"inertia.1": {"values": [0.7, 0.9]}, "inertia.2": {"values": [0.5, 0.6]}}}
    short = {**FIG4, "time": {"end": 10, "samples": 11}, "store": ["trajectory"]}
    members = hodo.sweep({**short, "sweep": {"body": bodies}})
    for i, inertia in enumerate(([1, 0.7, 0.5], [1, 0.9, 0.6])):
        member = members.isel(body=i)
        T = (member.omega.values**2 * inertia).sum(axis=1) / 2
        np.testing.assert_allclose(hodo.derive(member, "T")["T"], T, rtol=1e-15)


def test_a_sweep_without_the_coordinate_that_its_members_vary_in_is_one_line(grid):
    with pytest.raises(HodoError, match=r"no coordinate .damping\.0"):
        hodo.derive(grid.rename({"damping.0": "d"}), "T")


def test_a_motion_without_one_of_its_axes_is_refused(motion: xr.Dataset) -> None:
    """By position x2 would be taken for x1."""
    with pytest.raises(HodoError, match="has x2, x3, and not each of x1, x2, x3 once"):
        hodo.derive(motion.isel(axis=[1, 2]), "p")
