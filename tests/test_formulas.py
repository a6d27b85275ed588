"""Torques by formulas that jump, have corners or short pulses, against pieces between these."""

import math
import re
from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import BODY, run_hodo
from scipy.integrate import solve_ivp
from test_own_models import EXAMPLE

import hodo_cli as hodo

A = (2.0, 1.4, 3.0)
START, END = (0.09, 0.062, 0.031), 100.0
METHODS = [pytest.param("auto", marks=pytest.mark.heyoka), "collocation", "DOP853"]


def switched(first: float, last: float) -> str:
    """0.05 between two times, else 0."""
    return f"0.05*((t-{first})/sqrt((t-{first})**2)-(t-{last})/sqrt((t-{last})**2))/2"


Torque = Callable[[float, np.ndarray], Sequence[float]]

# Each with the torque itself, and the times between which a series is right.
FORMULAS: dict[str, tuple[list[str], Torque, list[float]]] = {
    "thruster": (["0", "0", switched(40.5, 41.25)], lambda t, w: (0, 0, 0.05 * (40.5 < t < 41.25)),
        [40.5, 41.25]),
    "at a sample": (["0", "0", switched(40, 41)], lambda t, w: (0, 0, 0.05 * (40 < t < 41)),
        [40.0, 41.0]),
    "pulse": (["0", "0.5*exp(-((t-60.3)/0.03)**2)", "0"], lambda t,
        w: (0, 0.5 * math.exp(-(((t - 60.3) / 0.03) ** 2)), 0), [60.0, 60.6]),
    "ramp": (["0", "0.001*((t-50)+sqrt((t-50)**2))/2", "0"], lambda t,
        w: (0, 0.001 * max(0, t - 50), 0), [50.0]),
    # At its start the series is no number.
    "rectified from the start": (["0", "0.002*sqrt(sin(0.3*t)**2)", "0"], lambda t,
        w: (0, 0.002 * abs(math.sin(0.3 * t)), 0), [n * math.pi / 0.3 for n in range(1, 10)]),
}  # fmt: skip


def pieces(torque: Torque, ends: list[float], end: float = END) -> np.ndarray:
    """omega (3,) at the end, by steps of another method from one change to the next."""

    def rates(t: float, w: np.ndarray) -> np.ndarray:
        N, (A1, A2, A3) = torque(t, w), A
        gyroscopic = (A2 - A3) * w[1] * w[2], (A3 - A1) * w[2] * w[0], (A1 - A2) * w[0] * w[1]
        return np.array([(g + n) / a for g, n, a in zip(gyroscopic, N, A, strict=True)])

    w = np.array(START)
    for first, last in pairwise([0.0, *ends, end]):
        inside = np.nextafter(first, last), np.nextafter(last, first)
        step = (last - first) / 50
        w = solve_ivp(rates, inside, w, "DOP853", rtol=1e-13, atol=1e-16, max_step=step).y[:, -1]
    return w


def case(formula: list[str], **others: Any) -> dict[str, Any]:
    start = {"initial": dict(zip("pqr", START, strict=True)), "time": {"end": END, "samples": 101}}
    return {"model": "torques", "inertia": A, "expression": formula, **start, **others}


def motion(formula: list[str], **others: Any) -> Any:
    return hodo.run(case(formula, **others))


@cache
def end_of(name: str) -> np.ndarray:
    """`pieces` of a formula, without whose torque the motion is another one."""
    _, torque, ends = FORMULAS[name]
    true = pieces(torque, ends)
    assert np.linalg.norm(pieces(lambda t, w: (0, 0, 0), []) - true) > 0.01
    return true


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", FORMULAS)
def test_what_is_short_is_not_stepped_over(name: str, method: str) -> None:
    ds, true = motion(FORMULAS[name][0], method=method), end_of(name)
    error = np.linalg.norm(ds.omega[-1] - true) / np.linalg.norm(true)
    assert ds.attrs["status"] == "ok"
    assert error < (1e-9 if method != "DOP853" else 1e-6)
    # The pieces themselves are right to some 1e-12.
    assert error < 2 * ds.attrs["error"] + 5e-12


@pytest.mark.heyoka
def test_a_sample_beside_a_jump_is_of_its_own_time() -> None:
    formula, torque, _ = FORMULAS["at a sample"]
    times = [40.0, 40 + 1e-9, 40 + 1e-8, 41 - 1e-9, 41.0, 50.0]
    ds = motion(formula, time={"values": times})
    for time, omega in zip(times, ds.omega.values, strict=True):
        ends = [change for change in (40.0, 41.0) if change < time]
        assert omega == pytest.approx(pieces(torque, ends, time), rel=1e-11, abs=1e-13)


@pytest.mark.heyoka
def test_corners_of_time_and_state_are_met_alike_by_each_method() -> None:
    """|p|, max(0, r) and max(0, sin t), whose corners a method has to find within its step."""
    formula = ["-0.1*sqrt(p**2)", "0.3*(r+sqrt(r**2))/2-0.1*q", "-0.2*(sin(t)+sqrt(sin(t)**2))*p"]
    keys = BODY | {"model": "torques", "expression": formula, "time": {"end": 10, "samples": 11}}
    by_series, by_points = (hodo.run({**keys, "method": x}) for x in ("auto", "collocation"))
    assert by_series.attrs["method"] == "taylor"
    assert {ds.attrs["status"] for ds in (by_series, by_points)} == {"ok"}
    assert by_points.omega.values == pytest.approx(by_series.omega.values, rel=1e-10, abs=1e-11)
    assert by_series.attrs["error"] < 1e-12


def between_switches(case: dict[str, Any], torque: Callable[[np.ndarray], Any]) -> np.ndarray:
    """omega (3,) at the end, by another method from one zero of p or r to the next."""
    A, end = np.array(case["inertia"]), case["time"]["end"]
    w, time = np.array([*case["initial"].values()]), 0.0
    signs = np.sign(w[[0, 2]])
    zeros = [lambda t, w, N: w[0], lambda t, w, N: w[2]]
    for zero in zeros:
        vars(zero)["terminal"] = True
    while time < end:
        ivp = solve_ivp(
            lambda t, w, N: (np.cross(A * w, w) + N) / A, (time, end), w, "DOP853",
            events=zeros, args=(torque(signs),), rtol=3e-14, atol=1e-16,
        )  # fmt: skip
        time, w = ivp.t[-1], ivp.y[:, -1].copy()
        met = np.array([len(times) > 0 for times in ivp.t_events])
        signs = np.where(met, -signs, signs)
        w[[0, 2]] = np.where(met, 1e-18 * signs, w[[0, 2]])
    return w


@pytest.mark.parametrize("method", METHODS[:2])
def test_a_jump_that_the_motion_itself_switches_leaves_no_more_than_rounding(method: str) -> None:
    keys = BODY | {"model": "torques", "method": method, "time": {"end": 40, "samples": 41}}
    keys["expression"] = ["-0.02*p/sqrt(p**2)", "0", "0.01*r/sqrt(r**2)"]
    true = between_switches(keys, lambda signs: np.array([-0.02 * signs[0], 0, 0.01 * signs[1]]))
    assert hodo.run(keys).omega.values[-1] == pytest.approx(true, rel=1e-11, abs=3e-12)


@pytest.mark.heyoka
@pytest.mark.parametrize("precision", ["double", "extended"])
def test_seconds_since_an_epoch_cost_the_digits_that_are_stated(precision: str) -> None:
    """Each time is rounded by 2e-7, and the formulas of it with it: that is no change of theirs."""
    start, end = 1.7e9, 20

    def phase(angle: float) -> float:
        return math.atan2(math.sin(angle), math.cos(angle))

    formula = ["0.05*sin(t)", "0.03*cos(t/2)", "0"]
    late = {"start": start, "end": start + end, "samples": 21}
    moved = [f"0.05*sin(t+{phase(start)})", f"0.03*cos(t/2+{phase(start / 2)})", "0"]
    ds = motion(formula, time=late, precision=precision)
    true = motion(moved, time={"end": end, "samples": 21}).omega.values
    error = (np.linalg.norm(ds.omega - true, axis=1) / np.linalg.norm(true, axis=1)).max()
    assert ds.attrs["status"] == "ok"
    assert error < 2 * ds.attrs["error"] + 1e-13
    assert ds.attrs["error"] < {"double": 1e-6, "extended": 1e-9}[precision]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("formula", "start", "pole"),
    [("1e-9/(5.5 - t)", 0, 5.5), ("p/(5.5 - t)", 0, 5.5), ("1/t", -3, 0)],
)
def test_a_pole_is_named_after_few_steps(formula, start, pole, method):
    motion = hodo.run(torqued(formula, start, method), classify=False)
    assert motion.attrs["status"] == "failed"
    words, _, time = motion.attrs["message"].rpartition(" ")
    assert words == "its formulas are not smooth near t ="
    # "Near": the steps towards a pole end before it.
    assert float(time) == pytest.approx(pole, abs=1e-4)
    assert motion.attrs["steps"] < 1000
    # Steps are examined together, and samples of those that are taken back are lost.
    assert pole - 1 < motion.time.values[-1] < pole


@pytest.mark.parametrize(
    ("formula", "method"),
    [
        pytest.param("sin(5.5-t)/(5.5-t)", "auto", marks=pytest.mark.heyoka),
        pytest.param("1/(1e-4+(5.5-t)**2)", "auto", marks=pytest.mark.heyoka),
        ("1/(1e-4+(5.5-t)**2)", "collocation"),
        ("1/(20.001-t)", "collocation"),
        ("1/(20.001-t)", "DOP853"),
    ],
)
def test_what_is_no_pole_on_the_way_is_passed(formula: str, method: str) -> None:
    """Rates that grow to a bound; and a pole behind the end."""
    motion = hodo.run(torqued(formula, 0, method), classify=False)
    assert (motion.attrs["status"], motion.time.values[-1]) == ("ok", 20)


def torqued(formula: str, start: float, method: str) -> dict[str, Any]:
    time = {"start": start, "end": 20, "samples": 1001}
    return case([formula, "0", "0"], time=time, method=method, error="off")


@pytest.mark.heyoka
def test_the_members_of_a_sweep_see_it(tmp_path: Path) -> None:
    formula = FORMULAS["thruster"][0]
    ds = hodo.sweep(case(formula, sweep={"initial.p": {"values": [0.08, 0.09]}}))
    assert ds.omega[1].values == pytest.approx(motion(formula).omega[-1], rel=1e-12)
    assert "formulas that may change within a step" in ds.attrs["method_reason"]


def assert_members_are_single(given: dict[str, Any], q: list[float]) -> str:
    """That members which differ in q end as they do alone; how they were computed."""
    ds = hodo.sweep({**given, "sweep": {"initial.q": {"values": q}}})
    for i, start in enumerate(q):
        alone = hodo.run({**given, "initial": {"p": 0.6, "q": start, "r": 0}})
        assert ds.omega[i].values == pytest.approx(alone.omega[-1].values, rel=1e-11, abs=1e-12)
    return str(ds.attrs["method_reason"])


SEVERAL = {"initial": {"p": 0.6, "q": 0.3, "r": 0}, "error": "off"}


@pytest.mark.heyoka
@pytest.mark.parametrize("order", [1, -1])
def test_members_see_a_pulse_that_the_first_of_them_has_not(order: int) -> None:
    """One that q multiplies, where q stays 0 in one of them."""
    pulse = ["50*q*exp(-(200*(t - 10.1))**2)", "0", "0"]
    given = case(pulse, damping=0.001, **SEVERAL, time={"end": 20, "samples": 2})
    assert_members_are_single(given, [0, 0.2, 0.4][::order])


@pytest.mark.heyoka
@pytest.mark.parametrize(
    ("formula", "is_alone"),
    [
        ("(p/3 - sqrt(p*p + q*q + r*r))*cos(2*t - 1)/4 + 0.01*t*q", False),
        ("0.01*exp(-t/3)*cos(t) + 0.01*t/(2 + t)", False),
        *(("0.01/exp(-t)", True), ("p*t**2", True), ("0.1*sin(t*t)", True)),
    ],
)
def test_formulas_that_no_series_oversteps_let_members_go_side_by_side(formula, is_alone):
    """From t = 0 a series of p' = p t^2 has no term of the orders 19 and 20, by which heyoka
    chooses a step."""
    given = case([formula, "0", "0"], **SEVERAL, time={"end": 2, "samples": 2})
    assert ("each by itself" in assert_members_are_single(given, [0, 0.2])) == is_alone


@pytest.mark.heyoka
def test_a_high_power_of_the_time_costs_members_no_digits() -> None:
    """Its terms are beyond those by which steps side by side choose their length."""
    end, start, body = 6, [0.01, 0.02, 0.015], np.array([1, 0.8, 0.7])
    initial, law = dict(zip("pqr", start, strict=True)), ["1e-14*t**16*t**2", "0", "0"]
    given = case(law, inertia=[1, 0.8, 0.6], initial=initial, time={"end": end})
    ds = hodo.sweep({**given, "sweep": {"inertia.2": {"values": [0.6, body[2]]}}})
    ivp = solve_ivp(
        lambda t, w: np.add(np.cross(body * w, w), [1e-14 * t**18, 0, 0]) / body,
        (0, end), start, "DOP853", rtol=3e-14, atol=1e-18, max_step=0.02,
    )  # fmt: skip
    assert ds.omega[1].values == pytest.approx(ivp.y[:, -1], rel=1e-12)


@pytest.mark.parametrize("method", METHODS[:2])
def test_an_own_model_sees_it(tmp_path: Path, method: str) -> None:
    """The example of the documents, without its drag, under the pulse about x2."""
    pulse = "0.5 / k.A2 * f.exp(-((t - 60.3) / 0.03) * ((t - 60.3) / 0.03))"
    text = EXAMPLE.replace("k.c * w * q", f"k.c * w * q + {pulse}")
    (tmp_path / "own.py").write_text(f"from hodo_cli import functions as f\n{text}", "utf-8")
    (tmp_path / "a.yaml").write_text(
        f"cases: {{a: {{model: quadratic-drag, inertia: {[*A]}, drag: 0, method: {method},"
        f" initial: {{p: {START[0]}, q: {START[1]}, r: {START[2]}}},"
        f" time: {{end: {END}, samples: 101}}}}}}",
        encoding="utf-8",
    )
    assert run_hodo(tmp_path, "--models", "own.py", "run", "a.yaml", "--quiet").returncode == 0
    omega = hodo.open(tmp_path / "runs" / "a.h5")["a"].omega[-1].values
    _, torque, ends = FORMULAS["pulse"]
    assert omega == pytest.approx(pieces(torque, ends), rel=1e-10)


def test_a_formula_that_is_0_at_rest_leaves_a_body_there() -> None:
    ds = motion(["0.1*p", "0", "0"], initial=dict.fromkeys("pqr", 0), time={"end": 5})
    assert ds.attrs["status"] == "ok"
    assert not ds.omega.any()


@pytest.mark.heyoka
@pytest.mark.parametrize("formula", [["-100*p", "-100*q", "-100*r"], ["0", "0", "-100*r*(1+r**2)"]])
def test_a_motion_that_dies_out_ends_at_rest(formula: list[str]) -> None:
    start = {"p": 0, "q": 0, "r": 1}
    ds = motion(formula, initial=start, time={"end": 24, "samples": 25})
    assert (ds.attrs["status"], ds.attrs["error"] < 1e-12) == ("ok", True)
    assert (ds.omega[-1] == 0).all()


@pytest.mark.parametrize(
    ("start", "drag", "end", "method"),
    [
        ({"p": 0, "q": 0, "r": 1}, 0, 20, "auto"),
        ({"p": 0.2, "q": 0, "r": 1}, 0, 20, "auto"),
        ({"p": 0, "q": 0, "r": 0.6}, 0.02, 11.469160652, "collocation"),
    ],
)
def test_dry_friction_ends_at_once_with_one_cause(start, drag, end, method):
    """A formula that is no number where r = 0, where r stays."""
    keys = {"inertia": [2, 2, 2], "quadratic": drag, "initial": start, "method": method}
    ds = motion(["0", "0", "-0.1*r/sqrt(r**2)"], **keys, time={"end": 40, "samples": 41})
    assert ds.attrs["status"] == "failed"
    assert ds.attrs["message"] == f"held at omega_3 = 0 by its expression at t = {end:.6g}"
    assert ds.attrs["steps"] < 500
    assert end - 1 <= ds.time.values[-1] <= end
    assert np.isfinite(ds.omega).all()


def spun_up(torque: str) -> Any:
    """The motion about x3 under a torque about it."""
    case = {"model": "torques", "inertia": [2, 1.5, 1], "expression": [0, 0, torque]}
    start = {"initial": {"p": 0, "q": 0, "r": 1}, "time": {"end": 10, "samples": 11}}
    return hodo.run(case | start)


@pytest.mark.parametrize(
    ("torque", "last"),
    [
        *(("0.1/sqrt(abs(t-3.3333))", 3), ("0.1*exp(-log(abs(t-3.3333))/3)", 3)),
        *(("0.1/(t-5.0001234)**2", 5), ("0.1/(t-5)", 4), ("0.1*sqrt(5-t)", 4)),
    ],
)
def test_motions_end_where_formulas_are_infinite_or_no_number(torque, last):
    """An integral over the place may exist: no method is right there to what hodo promises."""
    ds = spun_up(torque)
    assert ds.attrs["status"] == "failed"
    assert re.match("its formulas are not smooth near t = [35]", ds.attrs["message"])
    assert float(ds.time[-1]) == last
    assert math.isfinite(ds.omega.values.sum())


@pytest.mark.parametrize("width", [1e-3, 1e-5])
def test_motions_pass_a_narrow_peak(width):
    """A peak of a width that the rounding of the time is a billionth of."""
    ds = spun_up(f"1e-3/((t-5.0001)**2+{width**2})")
    impulse = 1e-3 / width * (math.atan(4.9999 / width) + math.atan(5.0001 / width))
    gained = float(ds.omega[-1, 2]) - 1
    assert gained == pytest.approx(impulse, rel=2 * ds.attrs["error"])
    assert ds.attrs["error"] < 1e-10


EVENT = """\
    @property
    def run_events(self):
        return (Event("passing", passing),)


def passing(t, y, k):
    return y[0]
"""


@pytest.mark.parametrize("method", ["auto", "collocation"])
def test_events_after_a_jump_are_where_the_motion_has_them(method: str, tmp_path: Path) -> None:
    """p falls from 0.8 at the rate 0.3, and rises at it from t = 5.5 on."""
    jump = "0.3 * (t - 5.5) / ((t - 5.5) ** 2) ** 0.5"
    text = EXAMPLE.replace("(k.A2 - k.A3) / k.A1 * q * r - k.c * w * p", jump)
    text = "from hodo_cli.models.base import Event\n" + text + EVENT
    (tmp_path / "rising.py").write_text(text)
    (tmp_path / "jump.yaml").write_text(f"""\
cases: {{a: {{model: quadratic-drag, method: {method}, inertia: [1, 0.8, 0.6], drag: 0,
             initial: {{p: 0.8, q: 0, r: 0}}, time: {{end: 40, samples: 41}}}}}}
""")
    assert run_hodo(tmp_path, "--models", "rising.py", "run", "jump.yaml").returncode == 0
    passings = hodo.open(tmp_path / "runs" / "jump.h5")["a"]["event_time"].values
    assert passings == pytest.approx([0.8 / 0.3, 11 - 0.8 / 0.3], abs=1e-13)
