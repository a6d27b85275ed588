"""Bodies with a rotor, and bodies that are given by a full tensor of inertia, at the door."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from conftest import BODY as BODY_OF_P1
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import hodo_cli as hodo
from hodo_cli import HodoError

BODY, B = BODY_OF_P1["inertia"], BODY_OF_P1["initial"]
ROTOR = np.array([0.05, 0.1, 0.2])
TURN = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()


def run(end: float, **terms: Any) -> Any:
    """The motion of a body under a sum of torques."""
    time = {"end": end, "samples": 301}
    return hodo.run({"model": "torques", "inertia": BODY, "initial": B, "time": time, **terms})


TURNS: dict[str, Callable[[Any], np.ndarray]] = {
    "torque": lambda N: TURN @ N,
    "rotor": lambda h: TURN @ h,
    "resistance": lambda tensor: TURN @ np.array(tensor) @ TURN.T,
}


def turned_case(**terms: Any) -> dict[str, Any]:
    """A case in the principal axes as one of other axes."""
    tensor, start = TURN @ np.diag(BODY) @ TURN.T, (TURN @ [*B.values()]).tolist()
    turned = {name: TURNS[name](x).tolist() if name in TURNS else x for name, x in terms.items()}
    body = {"inertia": ((tensor + tensor.T) / 2).tolist()}
    return body | {"initial": dict(zip("pqr", start, strict=True)), **turned}


@pytest.mark.parametrize(
    ("end", "rotor", "damping", "omega"),
    [
        pytest.param(
            60, ROTOR.tolist(), 0, [1.0499167946853625, 0.056006466803144380, 0.32589708185917879],
            marks=pytest.mark.heyoka,
        ),
        (300, [0, 0, 0.2], [0.005, 0.004, 0.003],
         [0.23440478535149042, -0.079388459090542767, 0.29238507503116231]),
    ],
)  # fmt: skip
def test_a_body_with_a_rotor_ends_where_a_reference_does_and_encloses_no_axis(
    end: float, rotor: Any, damping: Any, omega: list[float]
) -> None:
    ds = run(end, rotor=rotor, damping=damping)
    assert ds.omega.data[-1] == pytest.approx(omega, abs=1e-14 if damping else 2e-15)
    assert not ds.crossing_time.size
    assert (ds.enclosed_axis.data == -1).all()
    if not damping:
        G = ds.omega.data * BODY + ROTOR
        assert np.ptp((G * G).sum(1)) < 1e-14


def test_a_brake_stops_G_and_not_the_body() -> None:
    ds = run(200, rotor=ROTOR.tolist(), brake=0.01)
    G = np.linalg.norm(np.array([0.8, 0.4, 0.444]) + ROTOR)
    assert ds.event_kind.data.tolist() == ["stopped"]
    assert ds.event_time.data[0] == pytest.approx(G / 0.01, rel=1e-13)
    assert ds.omega.data[-1] == pytest.approx(-ROTOR / BODY, abs=1e-15)
    after = ds.time.data > ds.event_time.data[0]
    assert (ds.enclosed_axis.data[after] == -1).all()
    assert after.sum() > 100


def test_the_rounding_of_a_G_that_a_brake_has_stopped_has_no_direction() -> None:
    case = turned_case(rotor=ROTOR, brake=0.01)
    ds = hodo.derive(run(200, **case), "G", "tilt", "x1_direction")
    after = ds.time.data > ds.event_time.data[0]
    assert (ds.G.data[after] == 0).all()
    assert (ds.G.data[~after] > 0).all()
    for name in ("tilt", "x1_direction"):
        assert (np.isnan(ds[name].data) == after).all()


def time_of_stop(brake: float, rotor: Any, torque: Callable[[float, np.ndarray], Any]) -> float:
    """When a brake stops G beside another torque, in the time sigma: dt = |G| dsigma."""
    A, h = np.array(BODY), np.array(rotor)

    def rates(sigma: float, y: np.ndarray) -> np.ndarray:
        u, size = y[:3], np.exp(y[3])
        w = (size * u - h) / A
        N = torque(y[4], w)
        return np.array([*(N - (N @ u) * u - size * np.cross(w, u)), N @ u - brake, size])

    G = A * [*B.values()] + h
    start = [*(G / np.linalg.norm(G)), np.log(np.linalg.norm(G)), 0.0]
    ivp = solve_ivp(rates, (0, 80 / brake), start, "DOP853", rtol=3e-14, atol=1e-16)
    assert ivp.y[3, -1] < -36
    return float(ivp.y[4, -1])


@pytest.mark.parametrize("h", [(0.1, 0.2, -0.3), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("term", ["damping", "expression"])
def test_the_stop_beside_other_torques_is_known_to_its_stated_error(term: str, h: Any) -> None:
    terms = {"damping": [0.01, 0.02, 0.03], "expression": ["0.005*sin(t)", "0", "0.001"]}
    torques = {
        "damping": lambda t, w: -np.array(BODY) * terms["damping"] * w,
        "expression": lambda t, w: np.array([0.005 * np.sin(t), 0, 0.001]),
    }
    rotor = {"rotor": list(h)} if any(h) else {}
    stop = run(90, brake=0.02, **rotor, **{term: terms[term]})
    off = abs(stop.event_time.item() - time_of_stop(0.02, h, torques[term]))
    # The other method is right to some 1e-13.
    assert off < 2 * stop.event_error.item() + 3e-13


def test_the_fluid_of_a_gyrostat_is_that_of_its_free_motion() -> None:
    A, h, kappa = np.array(BODY), ROTOR, 0.02

    def rates(t: float, w: np.ndarray) -> np.ndarray:
        G = A * w + h
        first = np.cross(G, w) / A
        second = (np.cross(A * first, w) + np.cross(G, first)) / A
        return first + kappa * (second + np.cross(w, first)) / A

    sure = solve_ivp(rates, (0, 100), [0.8, 0.5, 0.74], method="DOP853", rtol=1e-13, atol=1e-14)
    ds = run(100, rotor=h.tolist(), kappa=kappa)
    assert ds.omega.data[-1] == pytest.approx(sure.y[:, -1], abs=1e-10)


@pytest.mark.parametrize(
    "terms",
    [
        {"rotor": ROTOR},
        {"quadratic": 0.01, "kappa": 0.02, "brake": 0.0005, "torque": [0.001, -0.002, 0.0015]},
        {"resistance": [[0.003, 0.001, 0], [0.001, 0.003, 0.001], [0, 0.001, 0.002]],
         "kappa": 0.01},
        {"rotor": ROTOR, "kappa": 0.02, "damping": 0.004, "brake": 0.001},
        {"damping": "0.01*exp(-0.02*t)"},
        {"resistance": np.diag([0.01, 0.0064, 0.0036]).tolist()},
        # In closed form.
        {"damping": 0.004, "brake": 0.002, "attitude": "yes"},
    ],
)  # fmt: skip
def test_a_full_tensor_tells_the_same_in_other_axes(terms: Any) -> None:
    plain = {name: x.tolist() if isinstance(x, np.ndarray) else x for name, x in terms.items()}
    ours, theirs = (run(150, error="off", **keys) for keys in (turned_case(**terms), plain))
    assert ours.omega.data @ TURN == pytest.approx(theirs.omega.data, abs=2e-13)
    assert ours.crossing_time.data == pytest.approx(theirs.crossing_time.data, rel=1e-11)
    assert ours.enclosed_axis.data.tolist() == theirs.enclosed_axis.data.tolist()
    assert ours.attrs["predictions"] == theirs.attrs["predictions"]
    for name in {"growth_rate"} & {*theirs}:
        assert ours[name].data == pytest.approx(theirs[name].data, nan_ok=True, rel=1e-12)
    assert ours.principal_moments.data == pytest.approx(BODY, rel=1e-14)
    assert ours.principal_axes.data @ TURN == pytest.approx(np.eye(3), abs=1e-14)
    assert ours.method == theirs.method
    if "attitude" in terms:  # from either body's axes to space, which are those of the start
        space = Rotation.from_quat(theirs.attitude.data, scalar_first=True).as_matrix()
        turned = Rotation.from_quat(ours.attitude.data, scalar_first=True).as_matrix()
        assert turned == pytest.approx(TURN @ space @ TURN.T, abs=2e-13)


def test_the_attitude_of_a_gyrostat_keeps_its_whole_momentum_in_space() -> None:
    case = turned_case(rotor=ROTOR)
    ds = run(60, **case, attitude={"align": "G"})
    J, h = np.array(case["inertia"]), np.array(case["rotor"])
    body_to_space = Rotation.from_quat(ds.attitude.data, scalar_first=True)
    G = body_to_space.apply(ds.omega.data @ J + h)
    size = np.linalg.norm(G[0])
    assert np.abs(G - [0, 0, size]).max() < 1e-13


def test_starts_on_a_sphere_have_the_momentum_of_body_and_rotor() -> None:
    case = turned_case(rotor=ROTOR)
    given = {"model": "torques", "time": {"end": 0.001}, "store": ["omega"], "error": "off"}
    ball = {"sweep": {"direction": {"sphere": {"count": 20, "seed": 1}}}}
    omega = hodo.sweep(given | case | ball).omega.data
    J, h = np.array(case["inertia"]), np.array(case["rotor"])
    start = np.array([case["initial"][name] for name in "pqr"])
    G = np.linalg.norm(omega @ J + h, axis=-1)
    assert pytest.approx(np.linalg.norm(J @ start + h), rel=1e-12) == G


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ({"inertia": [[1, 0.1, 0], [0.2, 0.8, 0], [0, 0, 0.6]]}, "symmetric"),
        ({"inertia": [[1, 0, 0], [0, -0.8, 0], [0, 0, 0.6]]}, "not all positive: 1, -0.8, 0.6"),
        ({"inertia": [[1, 0, 0], [0, 0.3, 0], [0, 0, 0.6]]}, "no body has principal moments"),
        ({"inertia": [[1, 0, 0], 0.8, 0.6]}, "some of each"),
        ({"inertia": [[1, 0], [0, 1], [0, 0]]}, "expected 3"),
        ({"inertia": np.diag(BODY).tolist(), "damping": [0.1, 0.2, 0.3]},
         "acts about principal axes"),
        ({"rotor": [0.3, 0.24, -0.18], "brake": 0.1, "initial": {"p": -0.3, "q": -0.3, "r": 0.3}},
         "brake: a body whose G is 0 has no direction to brake in"),
        ({"rotor": [0, 0, 0.1], "initial": {"p": 0.1, "q": 0.1, "G": 1}}, "does not determine"),
        ({"rotor": [0, 0]}, "3 numbers"),
    ],
)  # fmt: skip
def test_what_no_body_has_is_refused(terms: Any, message: str) -> None:
    with pytest.raises(HodoError, match=message):
        run(1, **{"damping": 0.01, **terms})


def test_D_of_a_body_with_a_rotor_is_refused() -> None:
    ds = run(10, rotor=[0, 0, 0.2])
    said = "no separatrix to be drawn: with a rotor D says nothing"
    for kind, keys in (("series", {"variables": ["D"]}), ("quadrants", {}), ("sphere", {})):
        with pytest.raises(HodoError, match=said):
            hodo.plot(ds, kind=kind, **keys)
    hodo.plot(ds, kind="hodograph", colour="axis")
    case = {"model": "torques", "inertia": BODY, "initial": B, "rotor": [0, 0, 0.2], "damping": 0.1}
    case |= {"time": {"end": 1}, "method": "collocation", "error": "off"}
    swept = hodo.sweep(case | {"sweep": {"initial.q": {"values": [0.1, 0.6]}}})
    with pytest.raises(HodoError, match=said):
        hodo.plot(swept, kind="curve", variable="end_axis.x1", x="initial.q")


def long_double_motion(tensor: np.ndarray, resistance: np.ndarray, start: Any) -> np.ndarray:
    """omega (321, 3) to t = 40, by Taylor series of order 30 in long doubles."""
    J, I = tensor.astype(np.longdouble), resistance.astype(np.longdouble)
    inverse = np.linalg.inv(tensor).astype(np.longdouble)
    for _ in range(3):  # Newton's iteration
        inverse = inverse @ (2 * np.eye(3) - J @ inverse)
    omega = np.array(start, np.longdouble)
    rows = [omega]
    for _ in range(320):
        w = np.zeros((31, 3), np.longdouble)
        w[0] = omega
        for n in range(30):
            turned = np.cross(w[: n + 1] @ J.T, w[n::-1]).sum(axis=0)
            w[n + 1] = inverse @ (turned - I @ w[n]) / (n + 1)
        omega = sum(c * np.longdouble(1 / 8) ** n for n, c in enumerate(w))
        rows.append(omega)
    return np.array(rows)


@pytest.mark.heyoka
@pytest.mark.parametrize(
    "terms", [{"resistance": 1}, {"damping": 0.0}, {"damping": 0.005}], ids=str
)
def test_the_error_of_a_body_in_other_axes_is_what_is_stated(terms: Any) -> None:
    """Axes that are rounded to doubles belong to another body, for motion and reference alike."""
    tensor = np.array([[10.2, 1.1, -0.4], [1.1, 8.7, 0.6], [-0.4, 0.6, 5.9]])
    unequal = np.array([[0.05, 0.01, 0.0], [0.01, 0.03, 0.0], [0.0, 0.0, 0.07]])
    resisting = "resistance" in terms
    resistance = unequal if resisting else terms["damping"] * tensor
    sure = long_double_motion(tensor, resistance, (0.7, -0.3, 0.5))
    given = {"resistance": unequal.tolist()} if resisting else terms
    body = {"inertia": tensor.tolist(), "initial": {"p": 0.7, "q": -0.3, "r": 0.5}, **given}
    for keys in ({}, {"precision": "extended"}, {"method": "taylor"}):
        ds = run(40, **body, time={"end": 40, "samples": 321}, **keys)
        apart = np.linalg.norm((ds.omega.data - sure).astype(float), axis=1)
        true = (apart / np.linalg.norm(sure.astype(float), axis=1)).max()
        assert true < 1.5 * ds.attrs["error"] < 1e-12, keys
