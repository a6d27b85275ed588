"""Attitude: against numbers of twenty digits, and what is constant in space."""

import json
import math
import re
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import BODY, FIG4, classified, run_hodo
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_own_models import TIMED, random_body, scaled

from hodo_cli import Case, HodoError, derive, sweep
from hodo_cli import run as run_case
from hodo_cli.integration import Trajectory, integrate, solve
from hodo_cli.models.theory import exact
from hodo_cli.results.dataset import motion_from

A, B = BODY["inertia"], BODY["initial"]
C = {"p": 0.5, "q": 0.25, "r": 1.4}


def made(end: float, **others: Any) -> Case:
    """A case of the body (1, 0.8, 0.6) with an attitude."""
    return Case.of(BODY | {"attitude": "yes", "time": {"end": end, "samples": 11}} | others)


def attitudes(motion: Trajectory) -> np.ndarray:
    return motion.variables["attitude"]


def in_space(motion: Trajectory) -> np.ndarray:
    """G (n, 3) in space axes."""
    G = np.array(motion.case.data["inertia"]) * motion.variables["omega"]
    return Rotation.from_quat(np.roll(attitudes(motion), -1, axis=1)).apply(G)


def apart(ours: Any, theirs: Any) -> float:
    """The largest angle between attitudes (..., 4), Q and -Q being the same."""
    ours, theirs = (Q / np.linalg.norm(Q, axis=-1, keepdims=True) for Q in (ours, theirs))
    nearer = np.minimum(*(np.linalg.norm(ours - s * theirs, axis=-1) for s in (1, -1)))
    return float(4 * np.arcsin(np.minimum(nearer / 2, 1)).max())


ROWS = [
    pytest.param(
        {}, 10,
        [0.56955723473855153391, -0.72489590132231562546, -0.20328572236371156884,
         0.32985664111269024347], [0.8, 0.4, 0.444], id="4",
    ),
    pytest.param(
        {}, 60,
        [0.12698308853587673657, 0.79580935588116954962, 0.58412108883004895820,
         0.096774572599861047843], [0.8, 0.4, 0.444], id="5",
    ),
    pytest.param(
        {"initial": C}, 10,
        [-0.043661193544819301563, 0.068937388871441016580, 0.36031944879821930051,
         0.92925305025680543607], [0.5, 0.2, 0.84], id="6",
    ),
    pytest.param(
        {"damping": 0.005}, 60,
        [-0.69145252676692817984, -0.12590778341870389353, 0.31649323682464784326,
         -0.63708136399244688333], [x * math.exp(-0.3) for x in (0.8, 0.4, 0.444)], id="7-8",
    ),
    pytest.param(
        {"damping": [0.005, 0.004, 0.003]}, 100,
        [0.40860214439426154591, 0.85737426549658524020, -0.24947788801244546279,
         0.18898264431814407650],
        [0.518970229719882129, 0.259184866711061475, 0.287391088734303382], id="11",
    ),
    pytest.param(
        {"model": "cavity+constant", "initial": C, "kappa": 0.03}, 60,
        [-0.77958698908911575141, -0.17068693435600069404, 0.50103896623463938060,
         0.33476865324824116060],
        [0.492874149324440957, 0.211834460750612912, 0.841309238131975890], id="12",
    ),
]  # fmt: skip


BOUNDS = {"exact": 2e-14, "taylor": 2e-14, "collocation": 6e-14, "DOP853": 1e-10}
"""How far attitudes by a method may be off; collocation depends on a processor's rounding."""


@pytest.mark.parametrize(
    "method", ["auto", *(pytest.param(m, marks=pytest.mark.heyoka) for m in BOUNDS if m != "exact")]
)
@pytest.mark.parametrize(("given", "end", "Q", "G"), ROWS)
def test_known_attitudes(given, end, Q, G, method):
    """Fig 4 passes near the middle axis, where the rounding of its data counts 600 times."""
    motion, _ = classified(made(end, method=method, **given))
    rounding = 2e-13 if "damping" in given and end == 100 else 0.0
    bound = BOUNDS[motion.method]
    assert apart(attitudes(motion)[-1], Q) < bound + rounding
    assert apart(attitudes(motion)[-1], Q) < 4 * motion.errors["attitude"] + 3e-15 + rounding
    # The branch too: the quaternions are continuous in time.
    assert attitudes(motion)[-1] == pytest.approx(Q, abs=bound + rounding)
    assert in_space(motion)[-1] == pytest.approx(G, abs=2 * bound + rounding)


@pytest.mark.heyoka
def test_nothing_drifts() -> None:
    """|Q| and G in space stay to t = 1e5; nothing norms the quaternion."""
    motion = solve(made(1e5), "taylor")
    assert np.linalg.norm(attitudes(motion), axis=1) == pytest.approx(1, abs=1e-12)
    assert in_space(motion) == pytest.approx(np.tile([0.8, 0.4, 0.444], (11, 1)), abs=2e-12)


def test_a_model_of_ones_own_has_it(tmp_path: Path) -> None:
    """Under a couple F e fixed in space G is G(0) + F t e, and e in the body is what is stored."""
    body = random_body(4, torques=True) | {"damping": [0.0] * 3, "torque": 0.0, "rate": 0.0}
    body |= {"law": "polynomial", "time": {"end": 40.0, "samples": 5}}
    cases = {f"size{size}": scaled(body, size, attitude="yes") for size in (0, 150)}
    (tmp_path / "a.yaml").write_text(json.dumps({"cases": cases}), encoding="utf-8")
    done = run_hodo(tmp_path, "--models", TIMED, "run", "a.yaml", "-j", "2")
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "runs" / "a.h5") as file:
        for name, case in cases.items():
            motion = file[name]
            assert {"omega", "gamma", "attitude"} <= set(motion)
            e, t = np.array([0, 0.6, 0.8]), motion["time"][()][:, None]
            turned = Rotation.from_quat(np.roll(motion["attitude"], -1, axis=1))
            G = turned.apply(np.array(case["inertia"]) * motion["omega"])
            moved = G - G[0] - case["force"] * t * e
            assert np.abs(moved).max() < 1e-13 * np.abs(G).max()
            assert turned.apply(motion["gamma"]) == pytest.approx(np.tile(e, (5, 1)), abs=1e-13)


TOP = {
    "model": "Lagrange-averaged", "form": "full", "epsilon": 0.05, "inertia": {"A": 1.5, "C": 1},
    "mu": 0.5, "a": [0.125, 1], "b": [0.1, 1], "attitude": "yes",
    "initial": {"theta": "60 deg", "r": 1.7320508075688772}, "time": {"end": 1, "samples": 101},
}  # fmt: skip


def test_the_vertical_of_a_top_is_z() -> None:
    motion = integrate(Case.of(TOP))
    turned = Rotation.from_quat(np.roll(attitudes(motion), -1, axis=1))
    vertical = turned.apply(motion.variables["gamma"])
    assert vertical == pytest.approx(np.tile([0, 0, 1], (101, 1)), abs=1e-13)
    assert attitudes(motion)[0] == pytest.approx([math.cos(math.pi / 6), 0.5, 0, 0])
    seen = motion_from(run_case(TOP), "top")
    gamma = motion.variables["gamma"]
    assert seen["theta"] == pytest.approx(np.arccos(gamma[:, 2]), abs=1e-12)
    phi = np.unwrap(np.arctan2(gamma[:, 0], gamma[:, 1]))
    assert seen["phi"] == pytest.approx(phi, abs=1e-12)
    p, q = motion.variables["omega"][:, :2].T
    rate = (p * gamma[:, 0] + q * gamma[:, 1]) / (1 - gamma[:, 2] ** 2) / 0.05
    steps = np.diff(motion.time) * (rate[1:] + rate[:-1]) / 2
    assert np.diff(seen["psi"]) == pytest.approx(steps, abs=2e-3)


def test_a_brake_stops_an_attitude_too() -> None:
    """It keeps where it points, which is where a free body is at s = |G|/(2 b)."""
    case = made(120, model="torques", brake=0.01, time={"end": 120, "samples": 3})
    motion, _ = classified(case)
    known = [-0.50777394114154784400, -0.69016956218159228341, -0.46937390273278554229,
             -0.21335355532318345970]  # fmt: skip
    assert attitudes(motion)[1] == pytest.approx(known, abs=1e-13)
    G = [0.319311160018074273, 0.159655580009037137, 0.177217693810031222]
    assert in_space(motion)[1] == pytest.approx(G, abs=1e-13)
    s = np.array([math.hypot(0.8, 0.4, 0.444) / 0.02])
    rest = exact.free_attitude(np.array(A), np.array([*B.values()]), s)
    assert attitudes(motion)[2] == pytest.approx(rest[0], abs=1e-12)
    assert motion.errors["attitude"] < 1e-12


@pytest.mark.parametrize("attitude", ["yes", {"align": "G"}, {"euler": [1, 2, 3]}])
def test_a_couple_fixed_in_space(attitude: Any) -> None:
    """G in space is G(0) + F t e, with e in the space axes of the attitude."""
    torque = {"size": 0.002, "direction": [1, 2, 2]}
    motion = integrate(made(100, model="torques", space_torque=torque, attitude=attitude))
    G, t = in_space(motion), motion.time[:, None]
    assert G - G[0] == pytest.approx(0.002 * t * np.array([1, 2, 2]) / 3, abs=1e-12)


@pytest.mark.heyoka
def test_the_flip_about_the_middle_axis_is_known_in_closed_form() -> None:
    """Where a series is off by 2e-8: against the integral of the third kind in 50 digits."""
    flip = {"p": 1e-4, "q": 1, "r": 1e-4}
    motion = integrate(made(120, initial=flip))
    assert motion.method == "exact"
    known = [-0.41684344655267340, 0.21350098319565982, 0.66125136238786571, -0.58600811170219017]
    assert apart(attitudes(motion)[-1], known) < 4 * motion.errors["attitude"] < 2e-13
    assert apart(attitudes(solve(made(120, initial=flip), "taylor"))[-1], known) > 1e-9
    for terms in ({"damping": 0.01}, {"model": "torques", "brake": 0.001}):
        assert integrate(made(10, **terms)).method == "taylor"
    with pytest.raises(HodoError, match="and none with an attitude"):
        made(10, damping=0.01, method="exact")


SEQUENCES = [
    "".join(axes)
    for letters in ("XYZ", "xyz")
    for axes in product(letters, repeat=3)
    if axes[0] != axes[1] != axes[2]
]


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_angles_are_those_of_scipy(sequence: str) -> None:
    euler = [0.3, -1.1, 2.9]
    case = made(1, attitude={"euler": euler, "sequence": sequence})
    known = Rotation.from_euler(sequence, euler).as_quat(scalar_first=True)
    assert apart(case.system.initial_state[3:], known) < 1e-15


@pytest.mark.parametrize("G", [(0, 0, 2), (0, 0, -2), (1e-9, 0, -1), (0.3, -0.4, -0.1), (1, 2, 3)])
def test_aligned_with_momentum(G: tuple[float, ...]) -> None:
    """z lies along G, by the shortest turn: about an axis across both, by the angle between."""
    initial = {name: x / a for name, x, a in zip("pqr", G, A, strict=True)}
    case = made(1, initial=initial, attitude={"align": "G"})
    turn = Rotation.from_quat(np.roll(case.system.initial_state[3:], -1))
    assert turn.apply(G) == pytest.approx([0, 0, np.linalg.norm(G)], abs=1e-14)
    angle = math.atan2(math.hypot(*G[:2]), G[2])
    assert turn.magnitude() == pytest.approx(angle, abs=1e-14)


REFUSED = [
    ({"attitude": "maybe"}, "attitude: expected yes or no, got 'maybe'"),
    ({"attitude": {"initial": [0, 0, 0, 0]}}, "attitude.initial: a quaternion of length 0"),
    ({"attitude": {"initial": [1, 0, 0]}}, "attitude.initial: expected 4 numbers"),
    ({"attitude": {}}, "attitude: give one of initial, euler and align, not none"),
    ({"attitude": {"align": "G", "initial": [1, 0, 0, 0]}},
     "attitude: give one of initial, euler and align, not initial and align"),
    ({"attitude": {"euler": [1, 2, 3], "sequence": "XXZ"}}, "attitude.sequence: expected three of"),
    ({"attitude": {"euler": [1, 2, 3], "sequence": "XyZ"}}, "attitude.sequence: expected three of"),
    ({"attitude": "yes", "model": "Lagrange-averaged", "form": "averaged", "mu": 1},
     "attitude: is a key of form full, and this is form averaged"),
    ({"attitude": "yes", "store": "attitud"}, "store.0: unknown variable 'attitud'; did you mean"),
    (TOP | {"attitude": {"align": "G"}}, "attitude: the start of a top says where it points"),
    ({"store": "attitude"}, "store.0: this case has no attitude: write `attitude: yes`"),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "message"), REFUSED)
def test_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(HodoError) as refusal:
        Case.of(BODY | {"time": {"end": 1}} | wrong)
    assert any(line.startswith(message) for line in str(refusal.value).splitlines()), refusal.value


@pytest.mark.parametrize(
    ("attitude", "words"),
    [
        ({"initial": [2, 0, 0, 0]}, "the attitude at the start has length 2: it is made 1"),
        ({"initial": [0.6, 0, 0.8, 0]}, ""),
        ({"euler": [1, 0, 2]}, "the start is at a pole of the sequence ZXZ"),
        ({"euler": [1, "90 deg", 2], "sequence": "xyz"}, "the start is at a pole of the sequence"),
        ({"euler": [1, "90 deg", 2]}, ""),
        ({"euler": [0, 60, 0]}, "euler: 60 is more than a turn: degrees are written as '60 deg'"),
        ({"euler": ["-360 deg", 1, 0]}, ""),
    ],
)
def test_warned(attitude: dict[str, Any], words: str) -> None:
    warnings = integrate(made(1, attitude=attitude)).warnings
    assert [warning[: len(words)] for warning in warnings] == ([words] if words else [])


def test_a_case_without_it_is_as_before() -> None:
    """`attitude: no` is the case without the key."""
    plain = made(1, attitude="no")
    assert "attitude" not in plain.entries
    assert plain.system.equations.state == ("p", "q", "r")
    named = made(1, attitude={"euler": ["60 deg", 1, 2]})
    assert Case.of(named.entries) == named


@pytest.mark.parametrize("key", ["euler.1", "eulr.1"])
def test_a_sweep_of_no_number_of_the_attitude_is_refused(key: str) -> None:
    with pytest.raises(HodoError, match="the case has no such number: attitude"):
        made(1, attitude={"align": "G"}, sweep={f"attitude.{key}": {"values": [1]}})


@pytest.mark.heyoka
def test_members_have_it() -> None:
    """At the end of each, and along each: as of single cases; aligned with the G of each."""
    case = FIG4 | {"attitude": {"align": "G"}, "time": {"end": 60, "samples": 4}}
    swept = sweep(case | {"sweep": {"start": {"sphere": {"count": 40, "seed": 3}}}})
    assert swept.attitude.shape == (40, 4)
    assert re.search(r"side by side(, [01] of 40|$)", swept.attrs["method_reason"])
    size = np.linalg.norm([A[i] * w for i, w in enumerate(B.values())])
    for i in (0, 7, 23):
        omega = (swept.start_vector.values[i] * size / A).tolist()
        motion, _ = classified(Case.of(case | {"initial": dict(zip("pqr", omega, strict=True))}))
        assert apart(swept.attitude.values[i], attitudes(motion)[-1]) < 1e-13
        assert in_space(motion)[0, :2] == pytest.approx([0, 0], abs=1e-14)


@pytest.mark.parametrize(("kappa", "bound"), [("0.02*exp(-0.05*t)", 8e-4), (0.03, 2.3e-4)])
def test_the_momentum_of_body_and_fluid_stays(kappa: Any, bound: float) -> None:
    """To O(kappa^2), that of the body to O(kappa); under a law by the kappa of each moment."""
    start, time = (B, 40) if isinstance(kappa, str) else (C, 60)
    given = {"kappa": kappa, "initial": start, "time": {"end": time, "samples": 401}}
    motion = run_case(made(time, model="torques", **given), classify=False)
    derived = derive(motion, "total_space", "G_space")
    total, G = derived.total_space.values, derived.G_space.values
    assert np.linalg.norm(total - total[0], axis=1).max() < bound
    assert np.linalg.norm(G - G[0], axis=1).max() > 5 * bound


@pytest.mark.parametrize("rotor", [[0.1, -0.2, 0.15], None])
@pytest.mark.parametrize("inertia", [[1, 0.8, 0.6], [[1, 0.1, 0], [0.1, 0.8, 0], [0, 0, 0.6]]])
def test_a_body_with_a_rotor_turns_on_where_a_brake_has_stopped_G(inertia, rotor):
    """At the constant omega of G = 0; before the stop a motion without corners, here of SciPy."""
    tensor = np.diag(inertia) if np.ndim(inertia) == 1 else np.array(inertia)
    h, brake = np.array(rotor or [0, 0, 0]), 0.03

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        G = tensor @ y[:3] + h
        torque = -brake * G / np.linalg.norm(G) - np.cross(y[:3], G)
        Q = Rotation.from_quat(y[3:], scalar_first=True)
        spin = Rotation.from_quat([0, *y[:3]], scalar_first=True)
        quaternion_rate = np.linalg.norm(y[:3]) / 2 * (Q * spin).as_quat(scalar_first=True)
        return np.r_[np.linalg.solve(tensor, torque), quaternion_rate]

    start = np.array([0.8, 0.5, 0.74])
    given = {"inertia": inertia, "brake": brake, **({"rotor": rotor} if rotor else {})}
    end = np.linalg.norm(tensor @ start + h) / brake
    times = [0.0, 0.5 * end, *(end + np.array([1.0, 5.0, 60.0]))]
    motion, _ = classified(made(times[-1], model="torques", time={"values": times}, **given))
    y0, bounds = [*start, 1, 0, 0, 0], {"rtol": 1e-12, "atol": 1e-13}
    before = solve_ivp(rates, (0, end - 1e-6), y0, "DOP853", **bounds)
    rest = -np.linalg.solve(tensor, h)
    at_stop = Rotation.from_quat(before.y[3:, -1], scalar_first=True)
    expected = [
        (at_stop * Rotation.from_rotvec(rest * (t - end + 1e-6))).as_quat(scalar_first=True)
        for t in times[2:]
    ]
    assert apart(attitudes(motion)[2:], np.array(expected)) < 1e-9  # SciPy's own, far from rest
    assert motion.errors["attitude"] < 1e-12
