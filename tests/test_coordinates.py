"""A picture shows what its datasets hold, by their coordinates: reversed, permuted, cut, put
together, transposed, or read back from another program's file."""

import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import figure_kinds
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.figure import Figure

import hodo_cli as hodo
from hodo_cli import HodoError

# What is drawn is compared, not looked at.
pytestmark = pytest.mark.filterwarnings("ignore:.*so that its curve is a polygon:UserWarning")

FIG4 = {
    "model": "linear-diag",
    "inertia": [1, 0.8, 0.6],
    "damping": [0.005, 0.004, 0.003],
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
    "time": {"end": 1000, "samples": 201},
}
GRID = {"damping.2": {"linspace": [0.001, 0.006, 6]}, "damping.0": {"values": [0.004, 0.005]}}
BALL = {"damping.2": {"values": [0.001, 0.006]}, "direction": {"sphere": {"count": 30, "seed": 1}}}

Change = Callable[[xr.Dataset], xr.Dataset]


@pytest.fixture(scope="module")
def motion() -> xr.Dataset:
    return hodo.run({**FIG4, "attitude": "yes"})


@pytest.fixture(scope="module")
def grid() -> xr.Dataset:
    return hodo.sweep({**FIG4, "sweep": GRID})


@pytest.fixture(scope="module")
def ball() -> xr.Dataset:
    return hodo.sweep({**FIG4, "initial": {"p": 0, "q": 0, "G": 1}, "sweep": BALL})


def together(*parts: xr.Dataset, dim: str) -> xr.Dataset:
    return xr.concat(parts, dim, data_vars="minimal", coords="minimal", compat="override")


def permuted(dim: str) -> Change:
    return lambda data: data.isel({dim: np.random.default_rng(5).permutation(data.sizes[dim])})


def backward(dim: str) -> Change:
    return lambda data: data.isel({dim: slice(None, None, -1)})


def halves_exchanged(dim: str) -> Change:
    def change(data: xr.Dataset) -> xr.Dataset:
        middle = data.sizes[dim] // 2
        halves = data.isel({dim: slice(middle, None)}), data.isel({dim: slice(middle)})
        return together(*halves, dim=dim)

    return change


def transposed(data: xr.Dataset) -> xr.Dataset:
    return data.transpose(*reversed([*data.sizes]))


def as_other_programs_have_it(data: xr.Dataset) -> xr.Dataset:
    """Names of axes as bytes, numbers of attributes as numpy's."""
    data = data.assign_coords(axis=np.array([name.encode() for name in data["axis"].values]))
    numbers = {k: np.asarray(v)[()] for k, v in data.attrs.items() if not isinstance(v, str)}
    return data.assign_attrs(numbers)


SAME_MOTION: dict[str, Change] = {
    "reversed": backward("time"),
    "permuted": permuted("time"),
    "axes reversed": backward("axis"),
    "axes permuted": lambda data: data.isel(axis=[1, 2, 0]),
    "quaternions permuted": lambda data: data.isel(quaternion=[2, 0, 3, 1]),
    "concatenated": halves_exchanged("time"),
    "transposed": transposed,
    "foreign": as_other_programs_have_it,
}

MOTION_FIGURES: dict[str, dict[str, Any]] = {
    "hodograph": {"projections": ["x1x3"], "zoom": 0.2},
    "sphere": {},
    "quadrants": {"zoom": 0.1},
    "series": {"variables": ["p", "omega.x3", "G", "D/2T", "enclosed_axis"], "span": [100, 600]},
    "phase": {"x": "q", "y": "G.x3"},
    "invariants": {},
    "herpolhode": {},
    "axis-trace": {},
    "body": {},
}

# Several motions each, or none; and sweeps.
OTHER_FIGURES = {"map", "curve", "quadrant-sketch"}


def test_every_kind_is_tried() -> None:
    assert {*MOTION_FIGURES, *OTHER_FIGURES} == figure_kinds()


def artists(figure: Figure) -> list[np.ndarray]:
    """What a figure shows as numbers: the points of its curves and marks, and its texts."""
    drawn = []
    for axes in figure.axes:
        drawn += [np.asarray(line.get_xydata(), dtype=float) for line in axes.lines]
        for curves in axes.collections:
            if isinstance(curves, LineCollection):
                drawn += [*curves.get_segments(), curves.get_colors()]
    words = [text.get_text() for text in figure.findobj(lambda item: hasattr(item, "get_text"))]
    return [*drawn, np.array(words)]


@pytest.fixture(scope="module")
def drawn(motion: xr.Dataset) -> dict[str, list[np.ndarray]]:
    """What each kind of figure shows of the motion."""
    return {kind: artists(hodo.plot(motion, kind, **keys)) for kind, keys in MOTION_FIGURES.items()}


@pytest.mark.parametrize("change", SAME_MOTION)
@pytest.mark.parametrize("kind", MOTION_FIGURES)
def test_the_same_motion_is_drawn_the_same(
    motion: xr.Dataset, drawn: dict[str, list[np.ndarray]], kind: str, change: str
) -> None:
    changed = SAME_MOTION[change](motion)
    assert not changed.identical(motion)
    shown, expected = artists(hodo.plot(changed, kind, **MOTION_FIGURES[kind])), drawn[kind]
    assert len(shown) == len(expected) > 3
    for ours, theirs in zip(shown, expected, strict=True):
        if ours.dtype.kind == "f":  # a sum over axes is rounded in their order
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-15)
        else:
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("change", SAME_MOTION)
def test_curves_are_those_of_the_dataset(motion: xr.Dataset, change: str) -> None:
    """Against the dataset's own values, by labels and in the order of time."""
    data = SAME_MOTION[change](motion).assign(Q=lambda data: 2 * data["time"] + 1)
    figure = hodo.plot(data, "series", variables=["q", "G", "Q"])
    names = [str(name) for name in motion["axis"].values]
    omega = motion.omega.sel(axis=names).values
    G = np.sqrt(((omega * [1, 0.8, 0.6]) ** 2).sum(axis=1))
    expected = (omega[:, names.index("x2")], G, 2 * motion["time"].values + 1)
    for axes, values in zip(figure.axes, expected, strict=False):
        np.testing.assert_array_equal(axes.lines[0].get_xdata(), motion["time"].values)
        np.testing.assert_allclose(axes.lines[0].get_ydata(), values, rtol=2e-15)


def test_a_part_is_drawn_as_that_part(motion: xr.Dataset) -> None:
    """Its start is the start of what is left, and a crossing beyond it is none."""
    (time,) = motion["crossing_time"].values
    for part, crosses in (
        (motion.sel(time=slice(0, 200)), False),
        (motion.isel(time=[9, 99]), True),
    ):
        assert bool(part.time[0] <= time <= part.time[-1]) == crosses
        curve, start, end, crossing = hodo.plot(part, "phase", x="p", y="r").axes[0].lines
        np.testing.assert_array_equal(curve.get_ydata(), part.omega.sel(axis="x3"))
        assert start.get_xdata().tolist() == [float(part.omega.sel(axis="x1")[0])]
        assert end.get_xdata().tolist() == [float(part.omega.sel(axis="x1")[-1])]
        assert len(crossing.get_xdata()) == crosses


def test_the_components_that_are_left_are_drawn_by_their_names(motion: xr.Dataset) -> None:
    left = motion.isel(axis=[2, 0])
    figure = hodo.plot(left, "series", variables=["omega.x3", "p", "G.x3"])
    for axes, (name, scale) in zip(figure.axes, (("x3", 1), ("x1", 1), ("x3", 0.6)), strict=False):
        expected = scale * motion.omega.sel(axis=name)
        np.testing.assert_array_equal(axes.lines[0].get_ydata(), expected)


SAME_SWEEP: dict[str, Change] = {
    "reversed": lambda data: backward("damping.2")(data),
    "both reversed": lambda data: backward(other_axis(data))(backward("damping.2")(data)),
    "permuted": permuted("damping.2"),
    "other permuted": lambda data: permuted(other_axis(data))(data),
    "concatenated": halves_exchanged("damping.2"),
    "transposed": transposed,
    "axes reversed": backward("axis"),
    "foreign": as_other_programs_have_it,
}


def other_axis(data: xr.Dataset) -> str:
    """The axis of a sweep beside damping.2."""
    return next(name for name in ("damping.0", "direction") if name in data.dims)


@pytest.mark.parametrize("variable", ["crossing_time", "omega.x3", "end_axis.x1", "Q"])
@pytest.mark.parametrize("change", SAME_SWEEP)
def test_curves_of_a_sweep_are_those_of_its_dataset(
    grid: xr.Dataset, change: str, variable: str
) -> None:
    data = SAME_SWEEP[change](grid.assign(Q=grid.crossing_time**2))
    figure = hodo.plot(data, "curve", variable=variable, x="damping.2", by="damping.0")
    name, _, part = variable.partition(".")
    values = data[name]
    if part:
        values = values == 1 if name == "end_axis" else values.sel(axis=wanted(data, part))
    curves = [line for line in figure.axes[0].lines if not str(line.get_label()).startswith("_")]
    assert len(curves) == 2
    for line, rate in zip(curves, data["damping.0"].values, strict=True):
        assert line.get_label() == rf"$\lambda_1 = {rate:g}$"
        for x, y in np.asarray(line.get_xydata()):
            np.testing.assert_array_equal(y, values.sel({"damping.0": rate, "damping.2": x}))
    assert np.diff(figure.axes[0].get_xlim()) > 0


def wanted(data: xr.Dataset, axis: str) -> object:
    """The name of a body axis as a dataset has it."""
    return axis.encode() if data["axis"].dtype.kind == "S" else axis


@pytest.mark.parametrize("change", SAME_SWEEP)
def test_maps_are_those_of_their_dataset(grid: xr.Dataset, change: str) -> None:
    data = SAME_SWEEP[change](grid)
    axes = hodo.plot(data, "map", variable="crossing_time", x="damping.2", y="damping.0").axes[0]
    (mesh,) = [each for each in axes.collections if isinstance(each, QuadMesh)]
    corners = mesh.get_coordinates()
    middles = (corners[1:, 1:] + corners[:-1, :-1]) / 2
    drawn = np.ma.filled(mesh.get_array().astype(float), np.nan).reshape(middles.shape[:2])
    assert drawn.shape == (2, 6)
    times = data.crossing_time.sortby(["damping.2", "damping.0"])
    for (x, y), value in zip(middles.reshape(-1, 2), drawn.ravel(), strict=True):
        at = {"damping.2": x, "damping.0": y}
        np.testing.assert_array_equal(value, times.sel(at, method="nearest"))


@pytest.mark.parametrize("change", SAME_SWEEP)
def test_maps_of_directions_are_the_same(ball: xr.Dataset, change: str) -> None:
    changed = SAME_SWEEP[change](ball)
    for kind, keys in (("map", {"variable": "crossing_time", "panels": "damping.2"}),):
        shown, expected = (panels(hodo.plot(data, kind, **keys)) for data in (changed, ball))
        assert shown.keys() == expected.keys()
        for name, values in expected.items():
            np.testing.assert_array_equal(shown[name], values, err_msg=name)


def panels(figure: Figure) -> dict[str, np.ndarray]:
    """The images of a figure by their titles, and the curves and points by their names."""
    found = {}
    for axes in figure.axes[: 2 if len(figure.axes) > 1 else 1]:
        for mesh in axes.collections:
            if isinstance(mesh, QuadMesh):
                found[axes.get_title()] = np.ma.filled(mesh.get_array().astype(float), np.nan)
        if not found:
            words = [text.get_text() for text in figure.legends[0].get_texts()]
            names = [word for word in words if word.startswith("$")]
            lines, points = axes.lines[::2], axes.lines[1::2]
            for name, line, counted in zip(names, lines, points, strict=True):
                found[name] = np.concatenate([line.get_ydata(), counted.get_ydata()])
    return found


def test_a_part_of_a_sweep_is_drawn_at_its_own_values(grid: xr.Dataset) -> None:
    part = grid.isel({"damping.2": [1, 3, 4], "damping.0": 1})
    (line, *_) = hodo.plot(part, "curve", variable="crossing_G", x="damping.2").axes[0].lines
    np.testing.assert_array_equal(line.get_xdata(), part["damping.2"])
    np.testing.assert_array_equal(line.get_ydata(), part.crossing_G)
    half = part.assign_coords({"damping.2": ("damping.2", [1.0, 10.0, 100.0], {"units": "1/s"})})
    axes = hodo.plot(half, "curve", variable="crossing_G", x="damping.2").axes[0]
    assert (axes.get_xscale(), axes.get_xlabel()) == ("log", r"$\lambda_3$ [1/s]")


def test_the_key_of_an_axis_is_the_first_that_varies_along_it() -> None:
    both = {
        "zip": {"damping.1": {"values": [0.003, 0.004]}, "damping.0": {"values": [0.001, 0.002]}}
    }
    data = hodo.sweep({**FIG4, "sweep": {"both": both}})
    axes = hodo.plot(backward("both")(data), "curve", variable="omega.x1", x="both").axes[0]
    assert axes.get_xlabel() == r"$\lambda_2$, with $\lambda_1$"
    assert axes.lines[0].get_xdata().tolist() == [0.004, 0.003]


def test_a_member_with_its_samples_is_a_motion_of_its_own_body() -> None:
    bodies = {"zip": {"inertia.1": {"values": [0.7, 0.9]}, "inertia.2": {"values": [0.5, 0.6]}}}
    short = {**FIG4, "time": {"end": 10, "samples": 11}, "store": ["trajectory"]}
    members = hodo.sweep({**short, "sweep": {"body": bodies}})
    assert set(members.coords) == {"inertia.1", "inertia.2", "time", "axis"}
    for i, inertia in enumerate(([1, 0.7, 0.5], [1, 0.9, 0.6])):
        member = members.isel(body=i)
        (line, *_) = hodo.plot(member, "series", variables=["T"]).axes[0].lines
        expected = (member.omega.values**2 * inertia).sum(axis=1) / 2
        np.testing.assert_allclose(line.get_ydata(), expected, rtol=1e-15)


@pytest.mark.parametrize("engine", ["netcdf4", "h5netcdf", "scipy"])
def test_what_xarray_has_written_and_read_is_drawn_the_same(
    motion: xr.Dataset, grid: xr.Dataset, tmp_path: Path, engine: str
) -> None:
    """In a process of its own, since netCDF4 brings an HDF5 library beside that of h5py."""
    script = """
import pickle, sys, xarray
folder, engine = sys.argv[1:]
for name, data in pickle.load(sys.stdin.buffer).items():
    data.to_netcdf(f"{folder}/{name}.nc", engine=engine)
read = {name: xarray.load_dataset(f"{folder}/{name}.nc", engine=engine) for name in ("one", "many")}
sys.stdout.buffer.write(pickle.dumps(read))
"""
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path), engine],
        input=pickle.dumps({"one": motion, "many": grid}), capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr.decode()
    read = pickle.loads(done.stdout)
    keys = {"kind": "map", "variable": "crossing_time", "x": "damping.2", "y": "damping.0"}
    for ours, theirs, of in (
        (motion, read["one"], {"kind": "hodograph"}),
        (motion, read["one"], {"kind": "invariants"}),
        (grid, read["many"], keys),
        (grid, read["many"], keys | {"variable": "end_axis"}),
    ):
        for expected, shown in zip(
            artists(hodo.plot(ours, **of)), artists(hodo.plot(theirs, **of)), strict=True
        ):
            np.testing.assert_array_equal(shown, expected)


def test_what_is_left_without_a_meaning_is_refused_in_one_line(
    motion: xr.Dataset, grid: xr.Dataset
) -> None:
    across = {"kind": "curve", "variable": "crossing_time", "x": "damping.2"}
    ball = {"kind": "map", "variable": "crossing_time"}
    for data, keys, said in (
        (together(motion, motion, dim="time"), {}, "its coordinate 'time' has 0 twice"),
        (together(motion, motion, dim="axis"), {}, "its coordinate 'axis' has x1, x2, x3, x1, x2"),
        (
            xr.concat([motion, motion], "run", data_vars="all"),
            {},
            "several motions: select one along",
        ),
        (motion.isel(axis=[0, 2]), {}, "no component x2 of G, only x1, x3"),
        (motion.isel(axis=0), {}, "stores no angular velocity in body axes"),
        (motion.isel(time=3), {}, "is a motion at one time"),
        (motion.isel(time=slice(0)), {}, "has no samples"),
        (motion.drop_vars("time"), {}, "has no coordinate 'time'"),
        (motion.drop_vars("axis"), {}, "has no coordinate 'axis'"),
        (motion.drop_vars("crossing_time"), {}, "its crossing_time is no array of numbers"),
        (motion.assign(omega=motion.omega.astype(str)), {}, "its omega is no array of numbers"),
        (motion.drop_attrs(), {}, "its attributes hold no case"),
        (motion.assign_coords(time=motion.time.astype(str)), {}, "holds more than finite numbers"),
        (motion.assign_coords(axis=["a", "b", "c"]), {}, "'a' along 'axis' is none of x1, x2, x3"),
        (motion, across, "the case is no sweep"),
        (grid, {}, "case sweep is a sweep, which only map and curve draw"),
        (grid.isel({"damping.2": 0}), across, "unknown axis 'damping.2'"),
        (grid.isel({"damping.2": 0, "damping.0": 0}), across, "case sweep is no sweep"),
        (grid.drop_vars("damping.2"), across, "no coordinate of finite numbers"),
        (together(grid, grid, dim="damping.2"), across, "has 0.001 twice, out of order"),
        (grid, ball, "sweep sweep has no sphere"),
        (grid, {**across, "by": "damping.0", "at": [2]}, "has positions 0 to 1, not 2"),
        (grid, {**across, "variable": "Q"}, "unknown variable 'Q'"),
        (motion, {"kind": "series", "variables": ["Q"]}, "unknown variable 'Q'"),
        (motion, {"kind": "quadrants", "scale_with": ["other"]}, "unknown figure 'other'"),
    ):
        with pytest.raises(HodoError) as raised:
            hodo.plot(data, **keys)
        assert said in str(raised.value)
        assert "\n" not in str(raised.value)


def test_counts_have_a_colour_each_where_a_member_has_none(grid: xr.Dataset) -> None:
    """The scale is that of the counts beside what has no value."""
    counts = xr.zeros_like(grid["crossings"], dtype=float) + np.arange(6)[:, None] % 3
    keys = {"kind": "map", "variable": "crossings", "x": "damping.2", "y": "damping.0"}

    def colours(values: xr.DataArray) -> int:
        figure = hodo.plot(grid.assign(crossings=values), **keys)
        return next(x.cmap.N for x in figure.axes[0].collections if isinstance(x, QuadMesh))

    assert colours(counts) == 3
    assert colours(counts.where(counts["damping.2"] > 0.0015)) == 3


def test_one_member_of_a_sweep_has_the_quantities_of_its_end(grid: xr.Dataset) -> None:
    one = {"damping.0": 1, "damping.2": 2}
    alone, all_members = (hodo.derive(data, "T") for data in (grid.isel(one), grid))
    assert alone["T"].dims == ()
    assert float(alone["T"]) == float(all_members["T"].isel(one))
    # Nothing knows of the file that has held it.
    assert not grid.encoding


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda m, s: hodo.derive(s.rename({"damping.0": "d"}), "T"), "no coordinate 'damping.0'"),
        (lambda m, s: hodo.derive(m.sel(axis="x2"), "G"), "has omega without its components"),
        (lambda m, s: hodo.plot(m.isel(time=5)), "is a motion at one time: select several"),
    ],
)
def test_a_selection_that_lacks_what_a_quantity_needs_is_one_line(
    motion: xr.Dataset, grid: xr.Dataset, made: Callable[..., object], message: str
) -> None:
    with pytest.raises(HodoError, match=message):
        made(motion, grid)


def test_an_angle_needs_no_component_of_omega(motion: xr.Dataset) -> None:
    whole, part = (hodo.derive(m, "psi")["psi"].values for m in (motion, motion.sel(axis="x2")))
    known = np.isfinite(whole)
    assert known.any()
    # Nothing tells where samples are too few to count whole turns.
    assert np.abs(np.sin((whole - part)[known] / 2)).max() < 1e-12
