"""Sums of torques, at the door: a case and what it comes to."""

import math
import re
from decimal import Decimal, localcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import call
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp

import hodo_cli as hodo

pytestmark = pytest.mark.usefixtures("quick_steps")

BODY = [1, 0.8, 0.6]
B = {"p": 0.8, "q": 0.5, "r": 0.74}
C = {"p": 0.5, "q": 0.25, "r": 1.4}
MEDIUM = [0.005, 0.004, 0.003]


def run(start: Any, end: float, **terms: Any) -> Any:
    """The motion of the body under a sum of torques."""
    time = {"end": end, "samples": 11}
    return hodo.run({"model": "torques", "inertia": BODY, "initial": start, "time": time, **terms})


DRAG_ALONG_G = "-0.01 * sqrt(p**2 + (0.8*q)**2 + (0.6*r)**2)"
# By a Taylor series of order 30 to 40 in 176 to 224 bits that shares no code with hodo.
END_STATES = {
    "brake": ((B, 60, {"brake": 0.01}),
        (0.25529394140312088, 0.36302827209964620, 0.16103259471969840)),
    "brake and damping": ((B, 60, {"brake": 0.01, "damping": 0.004}),
        (0.18526945894296346, 0.17909106057615755, -0.15534488424796164)),
    "drag along G": (
        (B, 60, {"expression": [f"{DRAG_ALONG_G} * {w}" for w in ("p", "0.8*q", "0.6*r")]}),
        (0.49262375296093774, -0.34166966632732990, 0.44887090573771592)),
    "equal quadratic drag": ((B, 60, {"quadratic": 0.01}),
        (0.50174687565290028, 0.022111284469152339, 0.49280645675851389)),
    "law of time": ((B, 100, {"damping": "0.005*(1 + 0.01*t)**-2"}),
        (0.50412305006140321, 0.69766151997966874, 0.32975278857125048)),
    "damping and quadratic drag": (
        (B, 500, {"damping": [0.003, 0.004, 0.005], "quadratic": [0.02, 0.016, 0.012]}),
        (0.019746153712525053, -0.021847686463398807, -0.013182758600857741)),
    "five terms": (
        (C, 100, {"resistance": {"diagonal": 0.003, "off_diagonal": 0.001}, "kappa": 0.02,
                  "quadratic": [0.01, 0.008, 0.006], "torque": [0.001, -0.002, 0.0015],
                  "brake": 0.0005}),
        (-0.043192630017708354, 0.34257111407898779, 0.44437383302053825),
    ),
    "fixed in space, and damping": (
        (B, 300, {"space_torque": {"size": 0.002, "direction": [0, 0, 2]}, "damping": MEDIUM}),
        (0.043961123015849125, 0.65960590090568003, -0.060932042879763240)),
}  # fmt: skip


@pytest.mark.parametrize("name", END_STATES)
def test_sums_of_torques_end_where_a_reference_does(name: str) -> None:
    (start, end, terms), omega = END_STATES[name]
    motion = run(start, end, **terms)
    off = np.abs(motion["omega"].values[-1] - omega).max()
    assert motion.attrs["status"] == "ok"
    assert off < 1e-13
    assert motion.attrs["error"] < 1e-12
    if name in ("brake", "brake and damping"):  # torques along G have a closed form
        assert motion.attrs["method"] == "exact"
        assert max(off, motion.attrs["error"]) < 1e-14


CROSSINGS = {
    "quadratic drag": (B, 400, {"quadratic": [0.01, 0.008, 0.006]}, [264.98501410324524]),
    "there and back": (
        C, 1500, {"damping": MEDIUM, "kappa": 0.03}, [57.802497615733104, 1230.8189247068045]
    ),
    "brake and fluid": (C, 300, {"brake": 0.002, "kappa": 0.01}, [196.96634479644304]),
    "too much damping": (C, 900, {"damping": 0.006, "kappa": 0.01}, []),
}  # fmt: skip


@pytest.mark.parametrize(("start", "end", "terms", "times"), CROSSINGS.values(), ids=CROSSINGS)
def test_sums_of_torques_cross_when_a_reference_does(start, end, terms, times):
    motion = run(start, end, **terms, error="off")
    assert motion["crossing_time"].values == pytest.approx(times, abs=1e-11)


STOPS = {
    "alone": ((B, 120, {"brake": 0.01}), 99.856697321711977,
        (0.576436209452822, -0.809786879333248, 0.109391528426027)),
    "damping": ((B, 300, {"brake": 0.002, "damping": MEDIUM}), 267.05497187079620,
        (0.565873229298389, -0.718051219516283, -0.405203571695254)),
    "fluid": ((C, 120, {"brake": 0.01, "kappa": 0.01}), 99.779757466131376,
        (0.529850422480799, -0.382363545638915, 0.757005052006495)),
}  # fmt: skip


@pytest.mark.parametrize("method", ["auto", "collocation"])
@pytest.mark.parametrize(("case", "time", "direction"), STOPS.values(), ids=STOPS)
def test_a_brake_stops_the_body(case: Any, time: float, direction: Any, method: str) -> None:
    start, end, terms = case
    motion = run(start, end, **terms, method=method)
    assert list(motion["event_kind"].values) == ["stopped"]
    assert motion["event_time"].values[0] == pytest.approx(time, abs=1e-12)
    at_stop = [motion[f"event_G{i}"].values[0] for i in (1, 2, 3)]
    assert at_stop == pytest.approx(direction, abs=2e-13)
    stopped = motion["time"].values > time
    assert stopped.any()
    assert not motion["omega"].values[stopped].any()
    assert (motion["enclosed_axis"].values[stopped] == -1).all()
    assert (motion["enclosed_axis"].values[~stopped] > 0).all()
    assert motion.attrs["classify_warnings"] == ""
    assert motion.attrs["status"] == "ok"
    assert motion.attrs["error"] < 1e-12


def test_a_torque_puts_the_stop_off() -> None:
    """In units of the omega that the torque makes, the last of G would have lost its digits."""
    N = np.array([0.001, -0.002, 0.0015])
    motion = run(B, 120, brake=0.01, torque=N.tolist())
    assert motion["event_time"].values[0] == pytest.approx(113.1118867766, abs=1e-9)

    # Of u = G/|G| over s = -ln |G|, in which nothing is singular at the stop.
    G = BODY * np.array([*B.values()])
    size = np.linalg.norm(G)

    def rates(s: float, u: np.ndarray) -> np.ndarray:
        slowed = size * math.exp(-s)
        turned = slowed**2 * np.cross(u, u / BODY) + N - (N @ u) * u
        return turned / (0.01 - N @ u)

    along = solve_ivp(rates, (0, 14 * math.log(8)), G / size, "DOP853", rtol=1e-13, atol=1e-14)
    stated = motion["event_G_error"].values[0]
    off = math.dist([motion[f"event_G{i}"].values[0] for i in (1, 2, 3)], along.y[:, -1])
    assert off < max(1.5 * stated, 1e-14)
    assert stated < 1e-12


@pytest.mark.parametrize("left", [1e-3, 1e-9])
def test_the_closed_form_knows_its_error_beside_a_stop(left: float) -> None:
    with localcontext(prec=50):
        momenta = [Decimal(a) * Decimal(w) for a, w in zip(BODY, B.values(), strict=True)]
        size, brake = sum(x * x for x in momenta).sqrt(), Decimal.from_float(0.0041)
        motion = run(B, float(size / brake * (1 - Decimal(left))), brake=0.0041)
        omega, t = motion["omega"].values[-1].tolist(), motion["time"].values[-1].item()
        found = sum((Decimal(a) * Decimal(w)) ** 2 for a, w in zip(BODY, omega, strict=True))
        off = abs(found.sqrt() / (size - brake * Decimal(t)) - 1)
    assert motion.attrs["method"] == "exact"
    assert off < 1.1 * motion.attrs["error"] < 1e-13 / left


SPIN = {"p": 1, "q": 0, "r": 0}
AXIAL = {"model": "torques", "inertia": [3, 2, 1], "initial": SPIN}


def braked(end: float, **keys: Any) -> Any:
    """A rotation about x1, G1 = 3, under a brake of 0.1 beside a torque."""
    time = {"end": end, "samples": 31}
    return hodo.run({**AXIAL, "brake": 0.1, "time": time, **keys})


TURNED = {
    "constant": ({"torque": [-0.3, 0, 0]}, -4.5),
    "ramp": ({"torque": ["-0.02*t", 0, 0]}, -5.605551275463989),
    "rotor": ({"torque": [-0.3, 0, 0], "rotor": [0.6, 0, 0]}, -4.2),
}


@pytest.mark.parametrize("method", ["auto", "collocation"])
@pytest.mark.parametrize(("terms", "momentum"), TURNED.values(), ids=TURNED)
def test_a_torque_stronger_than_the_brake_turns_a_body_round(terms, momentum, method):
    # G1' = -0.1 sign(G1) + N1(t) from G1 = 3, or 3.6 with the rotor, until t = 30.
    motion = braked(30, method=method, **terms)
    assert motion.attrs["status"] == "ok"
    G = 3 * motion["omega"].values[-1, 0] + terms.get("rotor", [0])[0]
    assert abs(G - momentum) < 2 * motion.attrs["error"] * abs(G) + 1e-11


@pytest.mark.parametrize("method", ["auto", "collocation"])
def test_a_body_that_has_turned_round_stops_as_precisely(method: str) -> None:
    """G1' = N1(t) - 0.1 sign(G1) from G1 = 3 and back to 0, where |G| has grown without a stage."""
    motion = braked(50, method=method, torque=["-0.3 + 0.02*t - 0.0003*t**2", 0, 0])
    turned = Polynomial([3, -0.4, 0.01, -0.0001]).roots()
    first = turned[abs(turned.imag) < 1e-9].real.min()
    behind = Polynomial([-0.2, 0.02, -0.0003]).integ(lbnd=first).roots()
    second = behind[(abs(behind.imag) < 1e-9) & (behind.real > first + 1)].real.min()
    assert motion["event_time"].values == pytest.approx([second], abs=1e-12)
    assert motion.attrs["error"] < 1e-12


def test_a_body_stops_beside_a_torque_that_is_no_stronger_than_the_brake() -> None:
    motion = braked(30, torque=[-0.1, 0, 0])
    assert motion["event_time"].values == pytest.approx([15], abs=1e-12)
    motion = run(B, 200, brake=0.001, torque=[0.01, 0, 0])
    assert "event_time" not in motion
    assert motion["omega"].values[-1].any()


def test_a_body_that_would_move_again_is_told_of() -> None:
    """A torque that grows beyond the brake after the stop: at t = 25."""
    for end, torque, told in (
        (24, {"torque": ["-0.004*t", 0, 0]}, ""),
        (100, {"torque": ["-0.004*t", 0, 0]}, "the body would move again"),
        (100, {"expression": ["-0.004*t", 0, 0]}, "from t = 25.0"),
        (100, {"torque": [-0.09, 0, 0]}, ""),
    ):
        motion = braked(end, error="off", **torque)
        assert motion.attrs["status"] == "ok"
        assert told in motion.attrs["warnings"]
        assert bool(told) == bool(motion.attrs["warnings"])


@pytest.mark.parametrize("samples", [1, 3])
def test_few_samples_do_not_change_when_a_body_would_move_again(samples: int) -> None:
    """A torque that exceeds the brake between the samples only: 0.008 t - 0.00008 t^2 = 0.1."""
    keys = {"initial": {**SPIN, "p": 0.5}, "time": {"end": 100, "samples": samples}}
    motion = braked(0, **keys, torque=["-0.008*t + 8e-05*t**2", 0, 0], error="off")
    told = re.search(r"from t = (\S+) on", motion.attrs["warnings"])
    assert told
    assert float(told[1]) == pytest.approx(50 - 1250**0.5, abs=0.01)


@pytest.mark.parametrize("alone", [{}, {"method": "collocation"}], ids=["together", "alone"])
def test_members_that_would_move_again_are_counted(alone: dict[str, str]) -> None:
    """G1' = -c t - b from G1 = 3, of which all members stop, and move again from b/c on."""
    case = {**AXIAL, "torque": ["-0.004*t", 0, 0], "time": {"end": 40}, "error": "off", **alone}
    case |= {"store": ["event_time", "event_release"]}
    members = hodo.sweep({**case, "sweep": {"brake": {"linspace": [0.1003, 0.2003, 3]}}})
    b, stop, release = (members[name].values for name in ("brake", *case["store"]))
    assert stop == pytest.approx((np.sqrt(b * b + 0.024) - b) / 0.004, abs=1e-12)
    assert (np.isfinite(release) == (b < 0.16)).all()
    late = release[b < 0.16] - b[b < 0.16] / 0.004
    assert (abs(late) < (40 - stop[b < 0.16]) / 2**12).all()
    assert members.attrs["released"] == 2
    assert members.attrs["warnings"].startswith("2 of 3 members stay at rest")


BRAKED = [{"torque": [0.002, -0.003, 0.0025]}, {"kappa": 0.02, "damping": 0.004},
          {"rotor": [0.0, 0.0, 0.1]}]  # fmt: skip
UNITS = [(1e-95, 1e-28), (1e95, 1e29), (1, 1e-70), (2.0**20, 1), (2.0**300, 1)]


@pytest.mark.parametrize(("others", "unit"), [*zip(BRAKED * 2, UNITS, strict=False)])
def test_a_body_stops_alike_in_units_of_any_size(others: Any, unit: tuple[float, float]) -> None:
    """Also in those in which the square of its momentum is no double."""

    def stopped(m: float, u: float) -> Any:
        powers = {"torque": (1, 2), "kappa": (1, -1), "damping": (0, 1), "rotor": (1, 1)}
        scaled = {
            name: (np.array(x) * m ** powers[name][0] * u ** powers[name][1]).tolist()
            for name, x in others.items()
        }
        case = {"inertia": [2 * m, 1.5 * m, m], "brake": 0.02 * m * u * u, **scaled}
        case |= {"initial": {"p": 0.3 * u, "q": 0.7 * u, "r": -0.9 * u}, "max_steps": 10_000}
        return hodo.run({"model": "torques", **case, "time": {"end": 120 / u, "samples": 13}})

    plain, motion, u = stopped(1, 1), stopped(*unit), unit[1]
    assert motion["event_time"].values * u == pytest.approx(plain["event_time"].values, rel=1e-13)
    assert motion["event_from"].values == plain["event_from"].values != 0
    assert motion["omega"].values / u == pytest.approx(plain["omega"].values, abs=1e-12)
    assert motion.attrs["error"] < 1e-11
    digits = 1e-9 if "rotor" in others else 1e-12  # its h hides the last of G
    for name in ("event_G1", "event_G2", "event_G3"):
        assert motion[name].values == pytest.approx(plain[name].values, abs=digits)


@pytest.mark.parametrize("method", ["taylor", "collocation"])
def test_a_body_stops_alike_beside_a_torque_with_t_in_a_coefficient(method: str) -> None:
    """The time is from DOP853 and the closed form of the last 1e-9 of G."""
    brake = {"brake": 0.1, "method": method, "error": "off"}
    start = {"p": 0.01, "q": 0.04, "r": 0.09}
    by_key, by_expression = (run(start, 1, **{key: ["0.05*t", 0, 0]}, **brake)
                             for key in ("torque", "expression"))  # fmt: skip
    assert by_key.attrs["status"] == "ok"
    assert by_key["event_time"].values == pytest.approx([0.6848433190442809], abs=1e-13)
    assert by_key["event_time"].values == pytest.approx(by_expression["event_time"].values)


@pytest.mark.parametrize(("key", "power"), [("damping", 2), ("torque", 5)])
def test_a_law_that_is_a_power_of_the_time_is_not_stepped_over(key: str, power: int) -> None:
    """The rate about an axis is a series in t**3, or its angle one in t**7: from t = 0 the law
    leaves no trace in the orders by which a series chooses its steps. Closed forms."""
    end, p = 5.0, np.linspace(0, 1, 41)
    case = {
        "model": "torques", "inertia": [3, 2.5, 1.3], key: [f"0.1*t**{power}", 0, 0],
        "time": {"end": end, "samples": 2}, "error": "off", "initial": {"p": 0.5, "q": 0, "r": 0},
        "attitude": key == "torque",
    }  # fmt: skip
    through = 0.1 * end ** (power + 1) / (power + 1)
    omega = {"damping": p * np.exp(-through), "torque": p + through / 3}[key]
    members = hodo.sweep({**case, "sweep": {"initial.p": {"values": p.tolist()}}})
    alone = hodo.run(case)
    assert members.omega.values[:, 0] == pytest.approx(omega, rel=2e-11)
    assert alone.omega.values[-1, 0] == pytest.approx(omega[20], rel=2e-11)
    if key == "torque":
        half = (p * end + through * end / (power + 2) / 3) / 2
        assert members.attitude.values[:, 0] == pytest.approx(np.cos(half), abs=1e-11)
        assert alone.attitude.values[-1, 0] == pytest.approx(np.cos(half[20]), abs=1e-11)


@pytest.mark.quadruple
def test_a_first_step_beyond_the_doubles_is_taken_anew() -> None:
    """A series from next to rest, in units of the start; what measures its error is quadruple."""
    case = {
        "model": "torques", "inertia": BODY, "expression": ["0.01*t**5", "0.001*t**5", 0],
        "initial": {"p": 1e-154, "q": 0, "r": 0}, "time": {"end": 5, "samples": 2},
        "precision": "extended",
    }  # fmt: skip
    ivp = solve_ivp(
        lambda t, w: np.add(np.cross(BODY * w, w), [0.01 * t**5, 0.001 * t**5, 0]) / BODY,
        (0, 5), [0, 0, 0], "DOP853", rtol=3e-14, atol=1e-16,
    )  # fmt: skip
    omega = hodo.run(case, classify=False).omega[-1].values
    assert omega == pytest.approx(ivp.y[:, -1], rel=1e-11)


OLD_NAMES = {
    "linear-diag": {"damping": MEDIUM},
    "tensor": {"resistance": {"diagonal": 0.003, "off_diagonal": 0.001}},
    "cavity+constant": {"kappa": 0.02, "torque": [0.001, -0.002, 0.0015], "epsilon": 0.5},
}


def test_a_tensor_of_resistance_follows_its_laws() -> None:
    """A case, and members of a sweep over one of its constants."""
    rates = ["0.005*exp(-k*t)", "0.002 + 1e-5*t", "0.003"]
    rows = np.diag([f"{A}*({rate})" for rate, A in zip(rates, BODY, strict=True)]).astype(object)
    terms = {"resistance": np.where(rows == "", 0.0, rows).tolist(), "error": "off"}
    damped = run(B, 100, damping=rates, constants={"k": 0.01}, error="off").omega.values
    alone = run(B, 100, constants={"k": 0.01}, **terms).omega.values
    assert alone == pytest.approx(damped, abs=1e-14)
    case = {"model": "torques", "inertia": BODY, "initial": B, "time": {"end": 100}, **terms}
    axis = {"constants.k": {"values": [0.01, 0.1]}}
    ends = hodo.sweep(case | {"constants": {"k": 0.01}, "sweep": axis}).omega.values
    assert ends[0] == pytest.approx(damped[-1], abs=1e-13)
    assert np.abs(np.diff(ends, axis=0)).max() > 0.01


@pytest.mark.parametrize(("model", "terms"), OLD_NAMES.items(), ids=OLD_NAMES)
def test_the_models_of_one_torque_are_sums_of_one(model: str, terms: Any) -> None:
    case = {"inertia": BODY, "initial": C, "time": {"end": 100, "samples": 11}, "error": "off"}
    case |= terms
    alone, summed = (hodo.run({"model": name, **case}) for name in (model, "torques"))
    assert np.array_equal(alone["omega"].values, summed["omega"].values)


@pytest.mark.parametrize("method", ["auto", "collocation"])
def test_any_coefficient_may_vary(method: str) -> None:
    case: dict[str, Any] = {
        "model": "torques", "inertia": BODY, "initial": C, "error": "off", "method": method,
        "damping": [0.005, 0.002, 0.003], "kappa": 0.02, "quadratic": 0.01, "brake": 0.0001,
        "torque": ["0.001*exp(-k*t)", 0.0, 0.001], "constants": {"k": 0.0},
        "time": {"end": 60, "samples": 2},
    }  # fmt: skip
    keys = ("damping.1", "kappa", "quadratic", "constants.k", "brake")
    zipped = dict(
        zip(keys, ({"values": [x]} for x in (0.004, 0.03, 0.02, 0.1, 0.0005)), strict=True)
    )
    swept = hodo.sweep({**case, "sweep": {"all": {"zip": zipped}}})
    member = {"damping": [0.005, 0.004, 0.003], "kappa": 0.03, "quadratic": 0.02}
    alone = hodo.run({**case, **member, "constants": {"k": 0.1}, "brake": 0.0005})
    assert swept["omega"].values[-1] == pytest.approx(alone["omega"].values[-1], abs=1e-13)


def fading(value: float, rate: float = 0.01) -> str:
    return f"{value}*exp(-({rate})*t)"


@pytest.mark.parametrize(
    ("terms", "predictions"),
    [
        ({"damping": MEDIUM, "kappa": 0.03},
         ["only x3 to x1 above .G. = 0.261861, only x1 to x3 below 0.244949; .* at 0.250217"]),
        ({"damping": MEDIUM}, ["one crossing at most, x1 to x3"]),
        ({"kappa": 0.03}, ["one crossing at most, x3 to x1"]),
        ({"brake": 0.01, "kappa": 0.01}, ["one crossing at most, x3 to x1"]),
        ({"brake": 0.01, "damping": 0.004}, ["no crossing is possible"]),
        ({"brake": 0.002, "damping": MEDIUM}, ["one crossing at most, x1 to x3"]),
        ({"damping": MEDIUM, "torque": [0, 0.001, 0.001]}, []),
        ({"damping": MEDIUM, "brake": fading(0.002)}, ["one crossing at most, x1 to x3"]),
        # The diagonal of a tensor bounds no |G|' where it has other entries.
        ({"resistance": {"diagonal": 0.003, "off_diagonal": 0.0029}, "brake": 0.002}, []),
        # Under laws of time nothing is foretold.
        ({"damping": fading(0.01), "brake": 0.002}, []),
        ({"resistance": {"diagonal": fading(0.01), "off_diagonal": 0}}, []),
        ({"damping": 0.01, "torque": ["-0.1*t", 0, 0]}, []),
    ],
)  # fmt: skip
def test_classify_says_what_theory_foretells(terms: Any, predictions: list[str]) -> None:
    told = run(C, 120, **terms, error="off").attrs["predictions"].splitlines()
    assert len(told) == len(predictions)
    for sentence, pattern in zip(told, predictions, strict=True):
        assert re.match(pattern, sentence)


def test_predictions_carry_the_units_of_the_case() -> None:
    keys = {"time": {"end": 10, "samples": 11, "unit": "s"}, "inertia_unit": "kg m^2"}
    free = run(C, 10, damping=0, attitude=True, **keys).attrs["predictions"].splitlines()
    assert free[-1].endswith(" s")
    turning = run(C, 10, kappa=0.03, damping=MEDIUM, **keys).attrs["predictions"]
    assert turning.count(" kg m^2/s") == 3


def test_the_stop_of_a_body_is_printed_and_drawn(tmp_path: Path) -> None:
    (tmp_path / "braked.yaml").write_text("""
cases:
  braked: {model: torques, inertia: [2, 1.5, 1], quadratic: 0.01, kappa: 0.02, brake: 0.004,
           initial: {p: 0.3, q: 0.7, r: -0.9}, time: {end: 300}}
figures: {braked: {kind: hodograph, cases: [braked]}}
""")
    ran = call(tmp_path, "run", "braked")
    assert (ran.returncode, "ends at t = 204.428: stopped" in ran.stdout) == (0, True)
    printed = call(tmp_path, "classify", "runs/braked.h5").stdout
    assert "one crossing at most, x3 to x1" in printed
    assert "stopped at 204.4278912504" in printed
    assert call(tmp_path, "plot", "runs/braked.h5", "--format", "svg").returncode == 0
    svg = (tmp_path / "runs/figures/braked/braked.svg").read_text()
    assert "204.428" in svg
    assert "undetermined" not in svg


@pytest.mark.heyoka
@pytest.mark.parametrize(("torque", "in_space"), [(1e-11, True), (1e-60, False)])
def test_a_torque_that_is_tiny_beside_the_start_costs_no_digit(torque, in_space):
    """The motion falls by up to 60 orders of magnitude to where the torque and the damping are in
    balance: in the body at N/(A lambda), in space as a torque twice as large says, beside which
    the gyroscopic terms are nothing either. A sweep falls as its cases do."""

    def case(torque: float) -> dict[str, Any]:
        in_body, of_space = [torque] * 3, {"size": torque, "direction": [1, 2, 3]}
        term = {"space_torque": of_space} if in_space else {"torque": in_body}
        body = {"model": "torques", "inertia": BODY, "damping": [0.15, 0.12, 0.1], "initial": B}
        return {**body, **term, "time": {"end": 2000}}

    motion = hodo.run(case(torque))
    assert motion.attrs["error"] < 1e-13
    end = motion["omega"].values[-1]
    settled, within = np.array([1 / 0.15, 1 / 0.096, 1 / 0.06]), 1e-6
    if in_space:
        settled, within = hodo.run(case(2 * torque))["omega"].values[-1] / (2 * torque), 1e-3
    assert end / torque == pytest.approx(settled, rel=within)
    sweep = hodo.sweep(case(torque) | {"sweep": {"initial.r": {"linspace": [0.7, 0.78, 40]}}})
    assert sweep.attrs["error"] < 1e-13
    if not in_space:
        assert sweep["omega"].values == pytest.approx(np.tile(end, (40, 1)), rel=1e-12)


ALL_TORQUES: dict[str, Any] = {
    "damping": 0.01, "resistance": [[0.01, 0.001, 0], [0.001, 0.02, 0], [0, 0, 0.01]],
    "quadratic": 0.01, "kappa": 0.01, "brake": 0.02,
    "torque": [0.01, 0.02, 0.01], "rotor": [0, 0.1, 0.2],
    "space_torque": {"size": 0.01, "direction": [0, 0, 1]},
    "expression": ["-0.01*p", "0", "0.002*cos(0.1*t)"],
}  # fmt: skip


TOGETHER = ["damping resistance torque", "space_torque expression", "brake rotor",
            "kappa quadratic rotor"]  # fmt: skip


@pytest.mark.heyoka
@pytest.mark.parametrize("names", TOGETHER)
def test_a_body_under_every_torque_has_an_attitude(names: str) -> None:
    """A series against a Runge-Kutta method, alone and beside a rotor."""
    torques = {key: ALL_TORQUES[key] for key in names.split()}
    case = {"model": "torques", "inertia": BODY, "initial": B, "time": {"end": 20, "samples": 21}}
    plain, turned, other = (
        hodo.run(case | torques | {"error": "off"} | keys)
        for keys in ({}, {"attitude": "yes"}, {"attitude": "yes", "method": "collocation"})
    )
    np.testing.assert_allclose(turned.omega, plain.omega, atol=1e-13)
    np.testing.assert_allclose(turned.omega, other.omega, atol=1e-9)
    np.testing.assert_allclose(turned.attitude, other.attitude, atol=1e-9)


@pytest.mark.parametrize("precision", ["double", "extended"])
def test_the_crossing_of_a_full_tensor_errs_by_no_more_than_it_states(precision: str) -> None:
    # Beside a touch of the separatrix, where one ulp in a principal moment moves the crossing by
    # 4.7e-15. The true time is that of a Taylor series in 200 bits that shares no code with hodo.
    inertia = [[1.7, 0.25, -0.01], [0.25, 0.58, 0.05], [-0.01, 0.05, 1.78]]
    start = {"p": -2.14, "q": -0.16, "r": -0.9}
    ds = run(start, 30, inertia=inertia, kappa=0.045, precision=precision)
    (time,), (error,) = ds.crossing_time.values.tolist(), ds.crossing_error.values.tolist()
    assert abs(float(Decimal(time) - Decimal("0.532815565650707653645"))) <= 2 * error
    assert error < 1e-14


def test_a_brake_stops_a_body_under_a_torque_that_hangs_on_its_attitude() -> None:
    terms = {"brake": 0.05, "expression": ["0.01*z1", "-0.02*y2", 0], "attitude": True}
    ds = run(C, 60, **terms)
    assert ds.attrs["status"] == "ok"
    assert not ds.omega.values[-1].any()
    assert ds.attrs["error"] < 1e-13


def test_a_start_along_the_middle_axis_of_a_full_tensor_stands_on_no_side() -> None:
    # Its components along the other axes are rounding, which is as large as they are.
    inertia = [
        [0.9429504720292667, -0.014318834801310954, 0.13438143593915208],
        [-0.014318834801310954, 0.7775784870607602, 0.0632787863921575],
        [0.13438143593915208, 0.0632787863921575, 0.6794710409099731],
    ]
    start = {"p": 0.1619507948751688, "q": -0.8432005295425412, "r": -0.26212394155222163}
    ds = run(start, 1e-3, inertia=inertia, damping=0, method="taylor")
    assert ds.enclosed_axis.values[0] == 0
