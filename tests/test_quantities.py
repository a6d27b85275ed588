"""Quantities that follow from what is stored: named in case files, asked of datasets, in
statements and of sweeps."""

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from conftest import FIG4, ROOT
from scipy.spatial.transform import Rotation

import hodo_cli as hodo
from hodo_cli import HodoError
from hodo_cli.cases.config import load, parse
from hodo_cli.results.dataset import motion_from

BODY: dict[str, Any] = FIG4 | {
    "model": "torques", "damping": 0.003, "kappa": 0.02, "attitude": "yes", "error": "off",
    "time": {"end": 20, "samples": 101, "unit": "s"}, "inertia_unit": "kg m^2",
}  # fmt: skip
TOP = {
    "model": "Lagrange-averaged", "form": "full", "inertia": {"A": 2.3, "C": 1.1}, "a": 0, "b": 0,
    "mu": 2, "epsilon": 0.1, "initial": {"theta": 0.5, "r": 6}, "time": {"end": 2, "samples": 401},
    "error": "off",
}  # fmt: skip


def derivable(case: dict[str, Any]) -> list[str]:
    """The quantities that a motion has, as the message on an unknown one lists them."""
    with pytest.raises(HodoError) as raised:
        hodo.derive(hodo.run(case), "Gspac")
    return str(raised.value).partition("(it has ")[2].rstrip(")").split(", ")


OF_BODY, OF_TOP = derivable(BODY), derivable(TOP)


@pytest.mark.parametrize(("case", "names"), [(BODY, OF_BODY), (TOP, OF_TOP)])
def test_what_is_stored_is_what_is_derived(tmp_path, case, names):
    """Every name, in a file too; a name there holds no slash."""
    path = tmp_path / "a.h5"
    whole, stored = hodo.run(case), hodo.run({**case, "store": names}, to=path)
    derived = hodo.derive(whole, *names)
    from_file = hodo.open(path)["case"]
    with h5py.File(path) as file:
        assert all(isinstance(item, h5py.Dataset) for item in file["case"].values())
    for name in names:
        kept = name.replace("/", "_per_")
        for data in (stored, from_file):
            np.testing.assert_array_equal(data[kept], derived[kept])
            assert data[kept].dims == derived[kept].dims
            meaning = {key: data[kept].attrs[key] for key in ("long_name", "units")}
            assert meaning == derived[kept].attrs
        # What is stored alone is drawn alone, by the name of case files.
        component = {("time",): name, ("time", "space"): f"{name}.z"}[stored[kept].dims]
        if not name.startswith("u"):
            hodo.plot(stored, kind="series", variables=[component])


def test_quantities_in_space_are_those_of_the_definitions() -> None:
    whole = hodo.derive(hodo.run(BODY), *OF_BODY)
    turned = Rotation.from_quat(whole.attitude.data, scalar_first=True)
    G = turned.apply(whole.omega.data * BODY["inertia"])
    np.testing.assert_allclose(whole.G_space, G, atol=1e-15)
    # With that of the fluid: G - kappa omega', of the free body.
    momentum = whole.omega.data * BODY["inertia"]
    fluid = BODY["kappa"] * np.cross(momentum, whole.omega.data) / BODY["inertia"]
    np.testing.assert_allclose(whole.total_space, turned.apply(momentum - fluid), atol=1e-15)
    np.testing.assert_allclose(
        Rotation.from_rotvec(whole.rotation.data).as_matrix(), turned.as_matrix(), atol=1e-14
    )
    assert [*whole.space.data] == ["x", "y", "z"]
    assert whole.G_space.attrs["units"] == "kg m^2/s"
    angles = turned.as_euler("ZXZ")
    for name, column in zip(("psi", "theta", "phi"), angles.T, strict=True):
        # The body starts at the vertical, where psi and phi are no numbers.
        np.testing.assert_allclose(np.cos(whole[name])[1:], np.cos(column)[1:], atol=1e-12)


def test_of_a_sweep_they_are_those_of_its_members() -> None:
    """Over bodies, whose momenta differ, and over starts."""
    ranges = {
        "inertia.2": {"values": [0.6, 0.7]},
        "initial.p": {"values": [0.5, 0.8, 0.9]},
        "kappa": {"values": [0.01, 0.02]},
    }
    case = {**BODY, "attitude": {"align": "G"}}
    names = ["total_space", "x3_space", "psi", "T", "rotation"]
    swept = hodo.derive(hodo.sweep({**case, "sweep": ranges}), *names)
    for i, j, k in ((0, 0, 1), (1, 2, 0), (1, 1, 1)):
        values = [entry["values"][n] for entry, n in zip(ranges.values(), (i, j, k), strict=True)]
        one = case | {"inertia": [1, 0.8, values[0]], "kappa": values[2]}
        one["initial"] = {**case["initial"], "p": values[1]}
        single = hodo.derive(hodo.run(one, classify=False), *names).isel(time=-1)
        member = swept.isel({"inertia.2": i, "initial.p": j, "kappa": k})
        for name in names:
            off = np.asarray(member[name] - single[name])
            # An angle of a member is at most half a turn.
            off = np.angle(np.exp(1j * off)) if name == "psi" else off
            assert np.abs(off).max() < 1e-12, name


@pytest.mark.parametrize(("case", "message"), [
    ("store: [psi]", "case.store.0: psi is not stored: it needs attitude: write `attitude: yes`"),
    ("attitude: yes, store: [omega, total_space]",
     "case.store.1: total_space is not stored: it needs kappa"),
    ("attitude: yes, store: [G_spac]", "unknown variable 'G_spac'; did you mean 'G_space'?"),
    ("attitude: yes, store: [psi], sweep: {initial.p: {values: [1, 2]}}",
     "case.store.0: psi is not stored: figures and averages derive it"),
])  # fmt: skip
def test_what_cannot_be_stored_is_named_when_the_file_is_read(case: str, message: str) -> None:
    body = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 2, r: 3}, time: {end: 1}"
    with pytest.raises(HodoError) as raised:
        parse(f"cases:\n  case: {{{body}, {case}}}\n", "a.yaml")
    assert message in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1


def test_a_dataset_that_lacks_what_is_asked_of_it_says_so() -> None:
    free = hodo.run({**BODY, "attitude": "no"})
    with pytest.raises(HodoError, match=r"^the case has no attitude, which psi needs: write"):
        hodo.derive(free, "psi")
    with pytest.raises(HodoError, match="unknown quantity 'Gspace'; did you mean 'G_s"):
        hodo.derive(free, "Gspace")
    few = hodo.run({**BODY, "store": ["T"]})
    with pytest.raises(HodoError, match=r"^the `store:` of the case leaves out omega, which G"):
        hodo.derive(few, "G")


def plotted_unit(data: xr.Dataset, variable: str) -> str:
    return str(hodo.plot(data, kind="series", variables=[variable]).axes[0].get_ylabel())


def test_a_variable_of_the_user_s_own_has_no_unit_but_its_own() -> None:
    """Whatever quantity has its name."""
    motion = hodo.run(BODY)
    assert "kg" in plotted_unit(motion, "T")
    own = motion.assign(T=("time", np.linspace(280.0, 300.0, motion.sizes["time"])))
    assert "kg" not in plotted_unit(own, "T")
    own["T"].attrs["units"] = "K"
    assert "[K]" in plotted_unit(own, "T")


def test_angles_count_whole_turns_or_say_that_they_cannot() -> None:
    """psi and phi of few samples against those of many, where x3 passes close to the vertical."""
    chance, given, missing = np.random.default_rng(7), 0, 0
    for _ in range(5):
        longest = chance.uniform(1, 2)
        moments = longest * np.array([1, chance.uniform(0.7, 1), chance.uniform(0.4, 0.7)])
        omega, Q = dict(zip("pqr", chance.normal(size=3), strict=True)), chance.normal(size=4)
        body = {"model": "linear-diag", "inertia": moments.tolist(), "initial": omega,
                "attitude": {"initial": Q / np.linalg.norm(Q)}}  # fmt: skip

        def angles_at(samples: int, body: dict[str, Any] = body) -> xr.Dataset:
            time = {"end": 30, "samples": samples}
            case = {**body, "time": time, "error": "off"}
            return hodo.derive(hodo.run(case, classify=False), "psi", "phi")

        fine = angles_at(12001)
        for samples in (31, 121, 601):
            few = angles_at(samples)
            for name in ("psi", "phi"):
                apart = np.abs(few[name].values - fine[name].values[:: 12000 // (samples - 1)])
                assert not (apart > 1e-6).any()
                given, missing = given + 1, missing + np.isnan(few[name].values).any()
    assert missing < given / 4


@pytest.mark.parametrize("initial", [{"theta": 2, "r": 0}, {"Gz": 0, "H": 9, "r": 0}])
def test_a_plane_pendulum_steps_by_half_a_turn_at_the_vertical(initial: dict[str, float]) -> None:
    """A top that does not spin swings in a plane: psi and phi have one of two values each."""
    top = TOP | {"attitude": "yes", "initial": initial, "time": {"end": 1, "samples": 1001}}
    found = hodo.derive(hodo.run(top), "psi", "phi", "theta")
    assert found.theta.max() > 3.1
    for name in ("psi", "phi"):
        values = found[name].values
        known = np.isfinite(values)
        assert known.sum() >= len(values) - 3
        steps = np.unique(np.round((values[known] - values[known][0]) / np.pi, 9))
        assert len(steps) == 2
        assert abs(steps).sum() == 1


FREE = {
    "model": "linear-diag", "inertia": [3, 2.2, 1], "initial": {"p": 0.3, "q": 0.2, "r": 0.9},
    "attitude": {"align": "G"}, "time": {"end": 60, "samples": 12},
}  # fmt: skip
STOPPED = {
    "model": "torques", "inertia": [120, 100, 80], "brake": 0.05,
    "initial": {"p": 0.05, "q": 0.01, "r": 0.3}, "time": {"end": 600, "samples": 121},
}  # fmt: skip
BRAKED, ONE_STOPPED = ({**STOPPED, "sweep": {"brake": {"values": x}}}
                       for x in ([0.05, 0.06], [0.05, 0.01]))  # fmt: skip
STATEMENTS: list[tuple[dict[str, Any], str, str]] = [
    # Two components of G, which lies along z, are rounding.
    (FREE, "kind: conserved, of: [G_space.x, G_space.y, G_space.z]", "reproduced"),
    (FREE, "kind: formula, of: G_space.x, formula: '0'", "reproduced"),
    (FREE, "kind: bound, of: theta, at: always, least: 0, most: 3.15", "reproduced"),
    (FREE, "kind: monotone, of: [phi], sense: rises", "reproduced"),
    # At rest there is no direction; the last average is over a member that turns, and one at rest.
    (STOPPED, "kind: bound, of: tilt, at: end, most: 0.001", "not tested"),
    (BRAKED, "kind: average, variable: tilt, most: 0.001", "not tested"),
    (ONE_STOPPED, "kind: average, variable: J, at: [{brake: 0}, {brake: 1}], least: 0",
     "not tested"),
]  # fmt: skip


def test_statements_take_no_rounding_for_a_change_and_no_rest_for_a_direction(tmp_path, hodo):
    cases = {f"c{i}": case for i, (case, *_) in enumerate(STATEMENTS)}
    claims = "".join(
        f"  - {{id: c{i}, where: x, statement: s, cases: [c{i}], check: {{{check}}}, "
        f"expect: {verdict}}}\n"
        for i, (_, check, verdict) in enumerate(STATEMENTS)
    )
    text = f"cases: {json.dumps(cases)}\nclaims:\n{claims}"
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    for command in ("run", "classify", "claims"):
        done = hodo(command, "m.yaml" if command == "run" else "runs/m.h5")
        assert done.returncode == 0, done.stdout + done.stderr


TOPS = [{"theta": angle, "r": r} for angle, r in ((0.5, 6), (2.9, 200), (1e-5, 5))]


@pytest.mark.parametrize("initial", [*TOPS, {"Gz": 2, "H": 9, "r": -3}])
def test_the_roots_of_a_top_are_where_its_nutation_turns(initial: dict[str, float]) -> None:
    top = TOP | {"initial": initial, "time": {"end": 2, "samples": 4001}}
    found = hodo.derive(hodo.run(top), "u1", "u2", "u3")
    cosine = found.gamma.sel(axis="x3").data
    # Free, it keeps them; cos theta runs over all that lies between the first two, and u3 is that
    # with which the three make the sum of eq. (1.5).
    size = max(1, abs(initial["r"]) ** 2 / 100)
    for name in ("u1", "u2", "u3"):
        assert np.ptp(found[name].data) < 1e-12 * size
    u1, u2, u3 = (float(found[name][0]) for name in ("u1", "u2", "u3"))
    width = u2 - u1
    assert cosine.min() == pytest.approx(u1, abs=1e-4 * width + 1e-15)
    assert cosine.max() == pytest.approx(u2, abs=1e-4 * width + 1e-15)
    p, q, r = found.omega.data[0]
    H = (2.3 * (p * p + q * q) + 1.1 * r * r) / 2 + 2 * cosine[0]
    total = (H - 1.1 * r * r / 2) / 2 + (1.1 * r) ** 2 / (2 * 2.3 * 2)
    assert u1 + u2 + u3 == pytest.approx(total, rel=1e-13)


# By the coordinates of a dataset, whatever was done to it.


GRID = {"damping.2": {"linspace": [0.001, 0.006, 6]}, "damping.0": {"values": [0.004, 0.005]}}
NAMES = ("T", "J", "tilt", "theta", "G_space", "x3_space", "rotation")

Change = Callable[[xr.Dataset], xr.Dataset]


@pytest.fixture(scope="module")
def motion() -> xr.Dataset:
    return hodo.run({**FIG4, "attitude": "yes", "time": {"end": 1000, "samples": 201}})


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
        ours, theirs = hodo.derive(read, name)[name], derived[name]
        xr.testing.assert_equal(*(x.drop_vars("space", errors="ignore") for x in (ours, theirs)))


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


# Datasets of result files.

SAMPLE = ROOT / "tests" / "data" / "format1.h5"
pytestmark = pytest.mark.filterwarnings("ignore:.*has no checksum:UserWarning")


def stored_sample(name: str, **changed: Any) -> Any:
    """A case of the committed sample, with other variables; `spin` takes the model of `fig4`."""
    cases = hodo.open(SAMPLE)
    data = cases[name].assign_attrs(case=cases["fig4"].attrs["case"])
    return motion_from(data.assign(changed), name)


def test_cases_of_the_sample() -> None:
    cases = hodo.open(SAMPLE)
    assert list(cases) == ["fig4", "spin"]
    assert "_claims" in cases
    assert "fig5" not in cases
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
        hodo.Case.of(swept | {"store": ["none"]})
    declared = re.search(r"\(valid: (.*)\)", str(refusal.value))
    assert declared
    names = set(declared[1].split(", ")) - {"trajectory"}
    assert set(hodo.sweep(swept | {"store": [*names]}).data_vars) == names
    assert names - {"steps", "share", "separation"} == set(hodo.sweep(swept).data_vars)


def test_what_x_and_y_of_the_averaged_cavity_determine() -> None:
    case = load(ROOT / "configs" / "paper2.yaml").cases["fig1"]
    data = hodo.run(case)
    A, _, C = case.data["inertia"]
    assert data.x[0] == data.y[0] == 1
    G = np.hypot(A * np.sqrt(data.x), C * np.sqrt(data.y))
    np.testing.assert_allclose(motion_from(data, "fig1")["G"], G, rtol=2e-15)


def test_what_omega_determines() -> None:
    """Against the definitions, D as G^2 - 2 T A2."""
    m = stored_sample("fig4")
    p, q, r = m.stored("omega").T
    np.testing.assert_allclose(m.G.T, [p, 0.8 * q, 0.6 * r], rtol=1e-15)
    for axis, component in zip(("x1", "x2", "x3"), m.G.T, strict=True):
        assert (m[f"G.{axis}"] == component).all()
    G2, T = p**2 + 0.64 * q**2 + 0.36 * r**2, (p**2 + 0.8 * q**2 + 0.6 * r**2) / 2
    known = {"G2": G2, "G": np.sqrt(G2), "T": T, "p": p, "r": r, "x": p**2 + q**2, "y": r**2}
    known["x1_direction"] = np.abs(p) / np.sqrt(G2)
    for name, expected in known.items():
        np.testing.assert_allclose(m[name], expected, rtol=2e-15, err_msg=name)
    np.testing.assert_allclose(m["D"], G2 - 2 * T * 0.8, atol=1e-15)
    np.testing.assert_allclose(m["D/2T"], G2 / (2 * T) - 0.8, atol=1e-15)
    np.testing.assert_allclose(m["separatrix_distance"], np.abs(m["D"]) / G2, rtol=1e-14)
    assert (np.sign(m["D"]) == np.where(m.labels == 1, 1, -1)).all()


def test_the_momentum_is_right_where_its_square_is_lost() -> None:
    m = stored_sample("fig4")
    tiny = stored_sample("fig4", omega=(("time", "axis"), m.omega * 2.0**-1000))
    assert (tiny["G"] == m["G"] * 2.0**-1000).all()
    assert (tiny["G2"] == 0).all()
    with pytest.raises(HodoError, match=r"unknown variable 'speeed'; did you mean 'speed'\?"):
        m["speeed"]
    with pytest.raises(HodoError, match="case fig4 has no gamma, which Gz needs"):
        m["Gz"]
    with pytest.raises(HodoError, match="case spin has no labels of the enclosed axis: run"):
        _ = stored_sample("spin").crossings


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may read everything")
def test_no_permission(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_bytes(SAMPLE.read_bytes())
    (tmp_path / "a.h5").chmod(0)
    with pytest.raises(HodoError, match="permission denied"):
        hodo.open(tmp_path / "a.h5")


def test_labels_of_motions_with_a_rotor_in_files_of_0_2_are_read_as_undetermined(tmp_path):
    """About both outer axes they were 4, and without a separatrix 5."""
    rotor = {"model": "torques", "rotor": [0, 0, 0.2], "damping": 0.01}
    motion = hodo.run(FIG4 | rotor | {"time": {"values": [1, 2, 3]}})
    old = motion.assign(enclosed_axis=motion.enclosed_axis.copy(data=np.array([1, 4, 5], "i1")))
    path = tmp_path / "old.h5"
    old.to_netcdf(path, group="case", engine="netcdf4")
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 1
    with pytest.warns(UserWarning, match="labels 4 and 5, of motions with a rotor, are read as -1"):
        again = hodo.open(path)["case"]
    assert again.enclosed_axis.values.tolist() == [1, -1, -1]
