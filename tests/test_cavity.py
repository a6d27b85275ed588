"""The body with a fluid-filled cavity: the end of spin, full against averaged, wrong data."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import series
from conftest import classified

from hodo_cli import Case, HodoError
from hodo_cli.cases.config import load, parse
from hodo_cli.engines import have_taylor
from hodo_cli.integration import integrate

HERE = Path(__file__).parent
PAPER2 = load(HERE.parent / "configs" / "paper2.yaml").cases


def changed(name: str, **changes: Any) -> Case:
    """A case of the paper with other values; the form full has no `spin_reversal`."""
    entries = PAPER2[name].entries | changes
    dropped = {"spin_reversal"} if entries["form"] == "full" else set()
    return Case.of({key: x for key, x in entries.items() if key not in dropped}, name)


KAPPA = 1260 * 0.48 / 1000
CLOSE = 1e-13 if have_taylor() else 1e-9
"""What a motion is right to, by Taylor series and by collocation."""


def case(text: str = "", **given: str) -> Case:
    """A case of a symmetric body with the keys given, in YAML."""
    keys = {"inertia": "[1.3, 1.3, 1]", "kappa": "0.6", "initial": "{x: 1, y: 1}"}
    keys |= {"time": "{end: 10}"} | given
    lines = "".join(f"    {key}: {value}\n" for key, value in keys.items() if value)
    return parse(f"cases:\n  c:\n    model: cavity+constant\n{lines}", "test").cases["c"]


@pytest.mark.parametrize("figure", ["fig1", "fig4"])
def test_without_M1_and_M2_averaging_is_an_identity(figure: str) -> None:
    averaged, full = integrate(PAPER2[figure]), integrate(changed(figure, form="full"))
    before = len(averaged.time) - 1
    assert np.array_equal(averaged.time[:before], full.time[:before])
    p, q, r = full.variables["omega"][:before].T
    # y goes to 0, so both are judged by their size at the start, 1.
    assert np.abs(averaged.variables["x"][:before] - (p * p + q * q)).max() < 10 * CLOSE
    assert np.abs(averaged.variables["y"][:before] - r * r).max() < 10 * CLOSE


def test_with_M1_and_M2_full_and_averaged_differ_in_proportion_to_epsilon() -> None:
    distances = []
    small = [0.02, 0.005]
    for epsilon in small:
        # Well before the end of spin.
        given = {"epsilon": str(epsilon), "kappa": str(epsilon), "torque": "[0.1, 0.3, -0.1]"}
        given["time"] = f"{{end: {1 / epsilon}, samples: 1001}}"
        omega = integrate(case(**given)).variables["omega"]
        slow = integrate(case(form="averaged", **given)).variables
        x, y = np.square(omega[:, :2]).sum(axis=1), np.square(omega[:, 2])
        distances.append(max(np.abs(x - slow["x"]).max(), np.abs(y - slow["y"]).max()))
    order = np.polyfit(np.log(small), np.log(distances), 1)[0]
    assert order == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("name", ["fig3-reversal", "fig3-reversal-as-printed"])
def test_the_motion_may_go_on_through_the_end_of_spin(name: str) -> None:
    motion = integrate(PAPER2[name])
    (end,) = motion.events
    assert end.kind == "end_of_spin"
    assert motion.time[-1] == 300
    system = series.cavity_averaged(1.3, 1.0, KAPPA, 0.1 * -0.1, printed=name.endswith("printed"))
    expected = series.states(system, (1, 1), motion.time[::60].tolist(), bits=128)
    assert expected[-1][1] < 0
    found = motion.variables["x"][::60], motion.variables["y"][::60]
    assert np.abs(found[0] - [float(x) for x, _ in expected]).max() < 100 * CLOSE
    assert np.abs(found[1] - [float(r * r) for _, r in expected]).max() < 100 * CLOSE
    assert min(values.min() for values in motion.variables.values()) >= 0


def test_a_triaxial_body_turns_to_its_axis_of_largest_inertia() -> None:
    given = PAPER2["internal-triaxial"]
    _, found = classified(given)
    A, start = given.data["inertia"], given.system.start
    system = series.cavity(A, KAPPA, (0, 0, 0))
    (expected,) = series.crossings(A, system, start, given.time.end, bits=128)
    (crossing,) = found.crossings
    assert (crossing.start, crossing.end) == (expected.before, expected.after) == (3, 1)
    assert crossing.time == pytest.approx(float(expected.time), rel=30 * CLOSE)
    assert (found.labels[0], found.labels[-1]) == (3, 1)


def test_the_ways_to_give_the_cavity_agree() -> None:
    radius = (525 * 0.48 / (8 * math.pi)) ** (1 / 7)
    ways = [
        case(kappa="0.6048"),
        case(kappa="", cavity="{kappa: 0.6048}"),
        case(kappa="", cavity="{density: 1260, viscosity: 1000, P0: 0.48}"),
        case(kappa="", cavity=f"{{density: 1260, viscosity: 1000, radius: {radius}}}"),
    ]
    assert [way.system.constants["kappa"] for way in ways] == pytest.approx([0.6048] * 4, rel=1e-15)


def test_the_ways_to_give_the_start_agree() -> None:
    assert case(initial="{x: 4, y: 9}").system.start == (2, 0, 3)
    averaged = case(form="averaged", initial="{p: 3, q: 4, r: -2}")
    assert averaged.system.start == (5, -2)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"cavity": "{kappa: 1}"}, "cavity: kappa is given"),
        ({"kappa": ""}, "none of them is given"),
        ({"kappa": "", "cavity": "{density: 1, P0: 1}"}, "cavity: .*not density, P0"),
        ({"kappa": "", "cavity": "{density: 1, viscosity: 1, P0: 1, radius: 1}"}, "P0 or radius"),
        ({"kappa": "", "cavity": "{density: 1, viscosity: 1e-300, radius: 1e50}"}, "too large"),
        ({"kappa": "-1"}, "kappa: expected a number >= 0"),
        ({"initial": "{x: 1}"}, "initial: give x and y"),
        ({"initial": "{x: 1, y: 1, p: 0}"}, "initial: give x and y alone"),
        ({"initial": "{x: -1, y: 1}"}, r"initial\.x: expected a number >= 0"),
        ({"initial": "{p: 1, q: 1}"}, "r missing"),
        ({"inertia": "[3, 1, 1]"}, "larger than the sum"),
        ({"inertia": "[1.3, 1.2, 1]", "form": "averaged-as-printed"},
         "inertia: form averaged-as-printed needs A1 = A2, not 1.3 and 1.2;"),
        ({"spin_reversal": "stop"}, "spin_reversal"),
    ],
)  # fmt: skip
def test_wrong_data_are_refused(given: dict[str, str], message: str) -> None:
    with pytest.raises(HodoError, match=message):
        case(**given)


@pytest.mark.parametrize(
    ("doubted", "words"),
    [
        (PAPER2["fig1"],
         "b = 1.39, and its fluid a mass of 14175 and a moment of inertia of 10956"),
        (PAPER2["fig1"], "of 10956, more than the 4 of body and fluid"),
        (PAPER2["fig3-as-printed"], "more than the 1 of body and fluid"),
        (changed("fig4", form="full"), "more than the 1 of body and fluid"),
        (case(kappa="", cavity="{density: 1e-3, viscosity: 10, radius: 1}",
              initial="{p: 3, q: 0, r: 4}"), "b^2 |omega|/nu is 0.5 "),
        (case(kappa="6"), "torque of the fluid is not small: 0.753 of"),
        (case(torque="[0, 0, 1]"), "torque epsilon M is not small"),
        (case(form="averaged", torque="[0.03, 0, 0]"), "it is 0.1 at the start"),
    ],
)  # fmt: skip
def test_what_contradicts_the_theory_is_said(doubted: Case, words: str) -> None:
    (warning,) = doubted.system.warnings
    assert words in warning


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("method", ["auto", "collocation"])
@pytest.mark.parametrize(("torque", "reversal"), [(-0.1, "stop"), (0, "stop"), (0.1, "continue")])
def test_a_start_without_spin_is_no_end_of_it(method: str, torque: float, reversal: str) -> None:
    given = {"method": method, "torque": f"[0, 0, {torque}]", "spin_reversal": reversal}
    motion = integrate(case(form="averaged", initial="{x: 1, y: 0}", **given))
    assert (motion.status, motion.time[-1], motion.events) == ("ok", 10.0, ())
    assert (motion.variables["y"][1:] > 0).all() == (torque != 0)


def test_the_error_of_an_end_of_spin_does_not_depend_on_the_origin_of_time() -> None:
    # r falls from 1 to 0 in the time 10; the error of 0 relative to itself would have no bound.
    given = {"form": "averaged", "initial": "{x: 0, y: 1}", "torque": "[0, 0, -0.1]"}
    motion = integrate(case(**given, time="{start: -10, end: 10}"))
    assert abs(motion.time[-1]) < 1e-13
    assert motion.errors.get("time", 0) < 1e-13


@pytest.mark.filterwarnings("error")
def test_doubts_about_bodies_of_any_size() -> None:
    given = {"initial": "{x: 1e154, y: 1e154}", "torque": "[0, 0, 1]"}
    assert case(inertia="[1e-99, 1e-99, 0.8e-99]", **given).system.warnings
    heavy = case(inertia="[1e100, 1e100, 0.8e100]", kappa="0.01", **given)
    assert not [*heavy.system.warnings, *case(torque="[0.03, 0, 0]").system.warnings]
