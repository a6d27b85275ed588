"""Quantities that follow from what is stored: named in case files, asked of datasets, in
statements and of sweeps."""

import json
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import hodo_cli
from hodo_cli import HodoError
from hodo_cli.cases.config import parse

BODY: dict[str, Any] = {
    "model": "torques",
    "inertia": [1, 0.8, 0.6],
    "damping": 0.003,
    "kappa": 0.02,
    "attitude": "yes",
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
    "time": {"end": 20, "samples": 101, "unit": "s"},
    "inertia_unit": "kg m^2",
    "error": "off",
}
TOP = {
    "model": "Lagrange-averaged", "form": "full", "inertia": {"A": 2.3, "C": 1.1}, "a": 0, "b": 0,
    "mu": 2, "epsilon": 0.1, "initial": {"theta": 0.5, "r": 6}, "time": {"end": 2, "samples": 401},
    "error": "off",
}  # fmt: skip


def derivable(case: dict[str, Any]) -> list[str]:
    """The quantities that a motion has, as the message on an unknown one lists them."""
    with pytest.raises(HodoError) as raised:
        hodo_cli.derive(hodo_cli.run(case), "Gspac")
    return str(raised.value).partition("(it has ")[2].rstrip(")").split(", ")


OF_BODY, OF_TOP = derivable(BODY), derivable(TOP)


@pytest.mark.parametrize(("case", "names"), [(BODY, OF_BODY), (TOP, OF_TOP)])
def test_what_is_stored_is_what_is_derived(tmp_path, case, names):
    """Every name, in a file too; a name there holds no slash."""
    path = tmp_path / "a.h5"
    whole, stored = hodo_cli.run(case), hodo_cli.run({**case, "store": names}, to=path)
    derived = hodo_cli.derive(whole, *names)
    from_file = hodo_cli.open(path)["case"]
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
            hodo_cli.plot(stored, kind="series", variables=[component])


def test_quantities_in_space_are_those_of_the_definitions() -> None:
    whole = hodo_cli.derive(hodo_cli.run(BODY), *OF_BODY)
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
    swept = hodo_cli.derive(hodo_cli.sweep({**case, "sweep": ranges}), *names)
    for i, j, k in ((0, 0, 1), (1, 2, 0), (1, 1, 1)):
        values = [entry["values"][n] for entry, n in zip(ranges.values(), (i, j, k), strict=True)]
        one = {
            **case,
            "inertia": [1, 0.8, values[0]],
            "initial": {**case["initial"], "p": values[1]},
            "kappa": values[2],
        }
        single = hodo_cli.derive(hodo_cli.run(one, classify=False), *names).isel(time=-1)
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
    free = hodo_cli.run({**BODY, "attitude": "no"})
    with pytest.raises(HodoError, match=r"^the case has no attitude, which psi needs: write"):
        hodo_cli.derive(free, "psi")
    with pytest.raises(HodoError, match="unknown quantity 'Gspace'; did you mean 'G_s"):
        hodo_cli.derive(free, "Gspace")
    few = hodo_cli.run({**BODY, "store": ["T"]})
    with pytest.raises(HodoError, match=r"^the `store:` of the case leaves out omega, which G"):
        hodo_cli.derive(few, "G")


def plotted_unit(data: xr.Dataset, variable: str) -> str:
    return str(hodo_cli.plot(data, kind="series", variables=[variable]).axes[0].get_ylabel())


def test_a_variable_of_the_user_s_own_has_no_unit_but_its_own() -> None:
    """Whatever quantity has its name."""
    motion = hodo_cli.run(BODY)
    assert "kg" in plotted_unit(motion, "T")
    own = motion.assign(T=("time", np.linspace(280.0, 300.0, motion.sizes["time"])))
    assert "kg" not in plotted_unit(own, "T")
    own["T"].attrs["units"] = "K"
    assert "[K]" in plotted_unit(own, "T")


# psi and phi

ANGLES = ("psi", "phi")


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
            return hodo_cli.derive(hodo_cli.run(case, classify=False), *ANGLES)

        fine = angles_at(12001)
        for samples in (31, 121, 601):
            few = angles_at(samples)
            for name in ANGLES:
                apart = np.abs(few[name].values - fine[name].values[:: 12000 // (samples - 1)])
                assert not (apart > 1e-6).any()
                given, missing = given + 1, missing + np.isnan(few[name].values).any()
    assert missing < given / 4


@pytest.mark.parametrize("initial", [{"theta": 2, "r": 0}, {"Gz": 0, "H": 9, "r": 0}])
def test_a_plane_pendulum_steps_by_half_a_turn_at_the_vertical(initial: dict[str, float]) -> None:
    """A top that does not spin swings in a plane, or goes over the top: psi and phi have one of two
    values each."""
    top = TOP | {"attitude": "yes", "initial": initial, "time": {"end": 1, "samples": 1001}}
    found = hodo_cli.derive(hodo_cli.run(top), "psi", "phi", "theta")
    assert found.theta.max() > 3.1
    for name in ("psi", "phi"):
        values = found[name].values
        known = np.isfinite(values)
        assert known.sum() >= len(values) - 3
        steps = np.unique(np.round((values[known] - values[known][0]) / np.pi, 9))
        assert len(steps) == 2
        assert abs(steps).sum() == 1


# Statements


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


# Tops


@pytest.mark.parametrize(
    "initial",
    [
        {"theta": 0.5, "r": 6},
        {"theta": 2.9, "r": 200},
        {"theta": 1e-5, "r": 5},
        {"Gz": 2, "H": 9, "r": -3},
    ],
)
def test_the_roots_of_a_top_are_where_its_nutation_turns(initial: dict[str, float]) -> None:
    top = TOP | {"initial": initial, "time": {"end": 2, "samples": 4001}}
    found = hodo_cli.derive(hodo_cli.run(top), "u1", "u2", "u3")
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
