"""The Lagrange top: means over the nutation, the roots, full against averaged, wrong data."""

import itertools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
import series
import xarray as xr
from numpy.polynomial import Polynomial, chebyshev

import hodo_cli as hodo
from hodo_cli import Case, HodoError
from hodo_cli.cases.config import load, parse
from hodo_cli.engines import have_taylor
from hodo_cli.integration import integrate
from hodo_cli.models import catalogue
from hodo_cli.models import top as lagrange

HERE = Path(__file__).parent
PAPER3 = load(HERE.parent / "configs" / "paper3.yaml").cases
FORMS = catalogue()["Lagrange-averaged"]
AVERAGED = ("averaged", "averaged-u")
CLOSE = 1e-13 if have_taylor() else 1e-9
"""What a motion is right to, by Taylor series and by collocation."""


def case(**given: str) -> Case:
    """The paper's top at 60 degrees with the keys given, in YAML."""
    keys = {
        "inertia": "{A: 1.5, C: 1}", "mu": "0.5", "a": "[0.125, 1]", "b": "[0.1, 1]",
        "initial": "{theta: 60 deg, r: 1.7320508075688772}", "time": "{end: 4, samples: 41}",
        "error": "off",
    } | given  # fmt: skip
    lines = "".join(f"    {key}: {value}\n" for key, value in keys.items() if value)
    return parse(f"cases:\n  c:\n    model: Lagrange-averaged\n{lines}", "test").cases["c"]


def constants(case: Case) -> SimpleNamespace:
    return SimpleNamespace(**case.system.constants)


def start(case: Case) -> tuple[float, ...]:
    return case.system.start


def first(case: Case) -> dict[str, float]:
    """The stored variables at the start."""
    stored = case.system.output(np.zeros(1), np.array([start(case)]), constants(case))
    return {name: float(values[0]) for name, values in stored.items()}


MOTIONS = [
    {"initial": "{theta: 5 deg, r: 1.7}", "a": "[0.1]"},
    {"initial": "{theta: 60 deg, r: -2}", "a": "[0.2, 0.3]"},
    {"initial": "{theta: 2.6, r: 0.4}", "a": "[3]"},
    {"initial": "{Gz: 0.7, H: 1.1, r: 1.3}", "a": "0.3*exp(-0.5*log(1 + 1*t))"},
]
"""Tops of several kinds, at several phases of their lives."""


@pytest.mark.parametrize("m1", [1 - 1e-9, 0.5, 1e-3, 1e-12])
def test_the_mean_by_the_arithmetic_geometric_mean_is_that_by_elliptic_integrals(m1: float) -> None:
    e, w = 1 - m1, 1 + m1  # u3 - u1 = 2, so that 1 - k^2 = m1
    with mpmath.workdps(40):
        e_, w_ = mpmath.mpf(e), mpmath.mpf(w)
        m = 2 * e_ / (w_ + e_)
        expected = w_ - (w_ + e_) * mpmath.ellipe(m) / mpmath.ellipk(m)
        # w - e has only the digits that two doubles leave it; the mean depends on its logarithm.
        off = abs(e * e * lagrange.mean_cosine(e, w) - expected)
        assert off < 1e-15 * max(1, 1e-3 / m1) * abs(expected)


def slopes(case: Case, t: float) -> tuple[mpmath.matrix, mpmath.matrix, series.LagrangeAveraged]:
    """(Gz, H, r) at the start, and their derivatives by the reference, in 40 digits."""
    k = constants(case)
    a = k.a if isinstance(k.a, tuple) else [0.3 / mpmath.sqrt(1 + mpmath.mpf(t))]
    reference = series.LagrangeAveraged(k.A, k.C, k.mu, a, k.b)
    values = first(case)
    y = mpmath.matrix([values[name] for name in ("Gz", "H", "r")])
    return y, reference.slope(mpmath.mpf(t), y), reference


@pytest.mark.parametrize("given", MOTIONS, ids=lambda given: given["initial"])
@pytest.mark.parametrize("form", AVERAGED)
def test_the_right_hand_sides_are_the_derivatives_of_integrals_and_roots(form, given):
    top = case(form=form, **given)
    k, y, t, h = constants(top), np.array(start(top)), 0.3, 1e-6
    with mpmath.workdps(40):
        z, dz, reference = slopes(top, t)
        ahead, behind = (reference.roots(*(z + side * mpmath.mpf(h) * dz)) for side in (1, -1))
        roots = [(p - q) / (2 * h) for p, q in zip(ahead, behind, strict=True)]
        expected = [float(value) for value in (*dz, *roots)]
    dy, output = np.array(FORMS[form].rhs(t, y, k)), FORMS[form].output
    ahead, behind = (output(np.zeros(1), (y + side * h * dy)[None], k) for side in (1, -1))
    # Central differences of 1e-6 in doubles: 1e-10.
    found = [(ahead[name] - behind[name])[0] / (2 * h) for name in ahead]
    assert found == pytest.approx(expected, rel=1e-8, abs=3e-9)


SPINS = {
    "eq. (3.3)": ({}, lambda t: 0.1 * t + t * t / 2),
    "square": ({"b": "[0.1, 0.2, 0.3]"}, lambda t: 0.1 * t + 0.1 * t**2 + 0.1 * t**3),
    "exponential": ({"b": "0.3*exp(-0.7*t)"}, lambda t: 0.3 * -np.expm1(-0.7 * t) / 0.7),
    "power": ({"b": "0.3*exp(-1.5*log(1 + 2*t))"}, lambda t: 0.3 * (1 - (1 + 2 * t) ** -0.5)),
    "driven": ({"a": "0", "b": "0", "m": "0.2"}, lambda t: -np.log(1 + 0.2 * t / math.sqrt(3))),
}  # fmt: skip


@pytest.mark.parametrize(
    ("form", "spin"), [*itertools.product(("averaged", "full"), SPINS), ("averaged-u", "eq. (3.3)")]
)
def test_r_decays_as_the_closed_form_says(form: str, spin: str) -> None:
    """And grows, under a torque m alone, at m/C."""
    keys, integral = SPINS[spin]
    motion = integrate(case(form=form, epsilon="0.05" if form == "full" else "", **keys))
    t, v = motion.time, motion.variables
    r = v["omega"][:, 2] if form == "full" else v["r"]
    assert np.abs(r - math.sqrt(3) * np.exp(-integral(t))).max() < CLOSE


@pytest.mark.parametrize("theta", ["5 deg", "150 deg", "0", "1e-5", "3.141592652589793", "180 deg"])
def test_a_start_by_integrals_is_that_by_the_angle(theta: str) -> None:
    values = first(case(initial=f"{{theta: {theta}, r: 2}}"))
    initial = f"{{Gz: {values['Gz']!r}, H: {values['H']!r}, r: 2}}"
    again = first(case(initial=initial))
    # The rounding of Gz and H moves a double root by the root of 1e-16.
    assert [again[name] for name in values] == pytest.approx(list(values.values()), abs=3e-8)
    assert_full_start_has(initial, values["Gz"], values["H"])


def assert_full_start_has(initial: str, Gz: float, H: float) -> None:
    full = case(form="full", epsilon="0.1", initial=initial)
    p, q, r, *gamma = start(full)
    assert math.hypot(*gamma) == pytest.approx(1, rel=1e-15)
    found = lagrange.first_integrals((p, q, r), gamma, constants(full))
    assert found == pytest.approx((Gz, H), rel=1e-14)


def test_a_full_start_may_pass_through_the_vertical() -> None:
    # Gz = C r: u2 = 1, and it moves there.
    assert_full_start_has("{Gz: 2, H: 3.3, r: 2}", 2, 3.3)
    still = integrate(case(form="full", epsilon="0.05", initial="{theta: 0, r: 1}"))
    assert np.array_equal(still.variables["gamma"], np.tile([0.0, 0.0, 1.0], (41, 1)))


@pytest.mark.parametrize("theta", [1e-9, math.pi - 1e-9])
def test_the_spread_of_a_nearly_vertical_top_keeps_its_digits(theta: float) -> None:
    # The other roots of (1.4) obey u^2 - k2 u + k2 u0 - 1 = 0, k2 = C^2 r^2/(2 A mu) = 8/3.
    e = start(case(initial=f"{{theta: {theta!r}, r: 2}}"))[3]
    with mpmath.workdps(60):
        u0, k2 = mpmath.cos(mpmath.mpf(theta)), mpmath.mpf(8) / 3
        expected = (u0 - (k2 - mpmath.sqrt(k2**2 - 4 * (k2 * u0 - 1))) / 2) / 2
        assert abs(e / expected - 1) < 1e-14


def test_regular_precession_stays_regular() -> None:
    k = constants(case())
    # u1 = u2 = 1/2 and u3 = 2, by eqs (1.5).
    X, y, Amu = 0.5, 1.0, k.A * k.mu
    U = -X * math.sqrt(2 * Amu * y)
    c = (-U + math.sqrt(U * U - 4 * Amu * (2 * (2 * X - y - 2) - X * X + 2 * X * y))) / 2
    state = (U, 2 * X - y - 2 + c * c / (2 * Amu), c / k.C, 0.0)
    assert lagrange.nutation(state, k) == pytest.approx((X, X + y), rel=1e-13)
    rates = FORMS["averaged"].rhs(0.3, state, k)
    assert rates[3] == 0
    near = FORMS["averaged"].rhs(0.3, (*state[:3], 1e-8), k)
    assert near[:3] == pytest.approx(rates[:3], rel=1e-12)
    # e' is proportional to e: what (3.5) divides by zero for is a factor like any other.
    nearer = FORMS["averaged"].rhs(0.3, (*state[:3], 1e-12), k)
    assert near[3] == pytest.approx(1e4 * nearer[3], rel=1e-6)


@pytest.mark.heyoka
def test_a_sleeping_top_sleeps_until_it_is_unstable() -> None:
    motion = integrate(case(initial="{theta: 0, r: 2}"))
    (end,) = motion.events
    # C^2 r^2 = 4 A mu = 3 with r = 2 exp(-(tau/10 + tau^2/2)).
    expected = math.sqrt(0.01 + 2 * math.log(2 / math.sqrt(3))) - 0.1
    assert (end.kind, motion.status) == ("upright_unstable", "ok")
    assert end.time == motion.time[-1] == pytest.approx(expected, rel=1e-14)
    assert all(np.abs(motion.variables[name] - 1).max() < 1e-14 for name in ("u1", "u2"))
    assert motion.variables["u3"][-1] == pytest.approx(1, abs=1e-7)


def test_a_hanging_top_hangs() -> None:
    motion = integrate(case(initial="{theta: 180 deg, r: 2}"))
    assert np.abs(motion.variables["u2"] + 1).max() < 1e-14
    assert motion.variables["Gz"][0] == pytest.approx(-2, rel=1e-15)
    assert np.abs(motion.variables["Gz"] + motion.variables["r"]).max() < CLOSE


@pytest.mark.heyoka
@pytest.mark.parametrize("form", ["averaged", "full"])
def test_a_constant_is_swept_by_its_name(form: str) -> None:
    """As a number, and as the first coefficient that it stands for."""
    keys = {"model": "Lagrange-averaged", "form": form, "inertia": {"A": 1.5, "C": 1}, "mu": 1,
            "a": 0.2, "b": 1, "initial": {"theta": 1, "r": 2}, "time": {"end": 1}}  # fmt: skip
    keys |= {"epsilon": 0.1} if form == "full" else {}
    for name in ("a", "b"):
        values = {"values": [0.2, 1, 2]}
        by_name, by_place = (
            hodo.sweep(keys | {"sweep": {key: values}}) for key in (name, f"{name}.0")
        )
        assert by_name[name].values.tolist() == [0.2, 1, 2]
        xr.testing.assert_equal(by_name, by_place.rename({f"{name}.0": name}))
        with pytest.raises(HodoError, match=f"sweep.{name}: {name} is not a number"):
            hodo.sweep(keys | {name: [1, 0.1], "sweep": {name: values}})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"inertia": "{A: 1, C: 2.5}"}, r"inertia\.C: no body has C = 2.5 larger than 2 A"),
        ({"mu": "0"}, "mu: expected a positive number"),
        ({"initial": "{theta: 1}"}, "missing 'r'"),
        ({"initial": "{theta: 60, r: 1}"}, "degrees are written as '60 deg'"),
        ({"initial": "{theta: 190 deg, r: 1}"}, "expected an angle from 0 to pi"),
        ({"sweep": "{initial.theta: {values: [1, 60]}}"},
         r"values\.1: expected an angle from 0 to pi .* degrees are written as '60 deg'"),
        ({"sweep": "{initial.theta: {linspace: [0 deg, 181 deg, 9]}}"},
         r"linspace\.1: expected an angle from 0 to pi"),
        ({"initial": "{theta: 1, r: 1, H: 1}"}, "give theta and r, or Gz, H and r"),
        ({"initial": "{r: 1, H: 1}"}, "give theta and r, or Gz, H and r"),
        ({"initial": "{r: 2, Gz: 1, H: 1.9}"}, "no motion has these"),
        # Its u1 and u2 are by 1e-7 and more above 1.
        ({"inertia": "{A: 1.5, C: 2.5}", "initial": "{r: 2.2, Gz: 5.501, H: 2}"},
         "no motion has these"),
        ({"initial": "{r: 1e100, Gz: 1, H: 1e150}"}, "initial: "),
        ({"initial": "{theta: 1, r: 1e200}"}, "out of range"),
        ({"initial": "{theta: 0, r: 1.7320508075688772}"}, "u2 = u3"),
        ({"initial": "{theta: 0, r: 2}", "form": "averaged-u"}, "divides by r and by u2 - u1"),
        ({"initial": "{theta: 1, r: 0}", "form": "averaged-u"}, "divides by r and by u2 - u1"),
        ({"form": "full"}, "missing 'epsilon'"),
        ({"mu": "[0.5, -1]"}, "mu: mu falls to -3.5 in the span"),
        ({"mu": "[0.5, 0.1]", "form": "averaged-u"}, "mu: form averaged-u takes a constant mu"),
        ({"m": "0.1", "form": "averaged-u"}, "m: form averaged-u has no m"),
        ({"mu": "[0.5, 0.1]", "time": "{start: 1, end: 2}"},
         "mu: a polynomial of mu begins with the initial data"),
        ({"a": "[]"}, r"a: expected a polynomial in tau: \[a0, a1, ...\]"),
        ({"a": "much"}, "a: column 1 of the expression: unknown name 'much'"),
        ({"form": "full", "epsilon": "0.1", "perturbation": "linear-dissipation"},
         "perturbation: unknown key"),
    ],
)  # fmt: skip
def test_wrong_data_are_refused(given: dict[str, str], message: str) -> None:
    with pytest.raises(HodoError, match=message):
        case(**given)


def test_what_makes_the_averages_doubtful_is_said() -> None:
    assert not any(top.system.warnings for top in PAPER3.values())
    (negative,) = case(b="[1, -0.1]").system.warnings
    assert "b has a negative coefficient" in negative
    (near,) = case(initial="{theta: 1e-5, r: 1}").system.warnings
    assert "1 - k^2 = 5.6e-11" in near


@pytest.mark.parametrize(
    ("theta", "spin", "mu", "a", "least"),
    [
        (3.117785438509107, 0.0700816655652691, 0.855, "[0.437, 0.74]", 1e-13),
        (2.9044158204366, -1.0425217736524961e-05, 0.12, "[0.442]", 1e-6),
    ],
)
def test_the_rounding_of_the_roots_at_the_start_is_part_of_their_error(theta, spin, mu, a, least):
    """Gz is a sum of products of the roots, over r: a slow spin leaves few of its digits."""
    given = {"initial": f"{{theta: {theta}, r: {spin}}}", "mu": str(mu), "a": a, "error": "on"}
    given |= {"time": "{end: 1, samples: 5}", "inertia": "{A: 1.53, C: 0.9}"}
    roots, plain = (integrate(case(form=form, **given)) for form in ("averaged-u", "averaged"))
    off = np.abs(roots.variables["Gz"] - plain.variables["Gz"]).max()
    off /= np.abs(plain.variables["Gz"]).max()
    assert off > least
    assert roots.errors["Gz"] == pytest.approx(off, rel=0.1)


# On [0, 2], to the last digit.
_IN_TAU_LESS_1 = chebyshev.cheb2poly(chebyshev.chebinterpolate(lambda x: 0.5 / (1.3 + 0.3 * x), 18))
FALLING = str(Polynomial(_IN_TAU_LESS_1)(Polynomial([-1, 1])).coef.tolist())
"""0.5/(1 + 0.3 tau) as a polynomial."""

LAWS_OF_TIME = {
    "axial torque": ({"m": "0.2", "a": "0.125", "b": "0.1", "mu": "0.5"},
        (7.14615158788087723e-5, -0.483421185149415059, 1.75754954455580245),
        (-0.448675351253786695, -0.886842219122204261, 0.110459529057910492)),
    "falling mu": ({"mu": FALLING, "a": "0", "b": "0"},
        (0.0728953513394852740, -0.501290446981690064, 1.73205080756887729),
        (0.0595182228060932324, -0.996188403105960674, 0.0637671284534613974)),
    "both": ({"m": "0.2/(1 + t)", "mu": "[0.5, 0.15]", "a": "0.125", "b": "0.1"},
        (0.428277629153334897, -0.282365071105278370, 1.69839359908822709),
        (0.442736113796192254, -0.891876926990276199, 0.0924136388366275793)),
}  # fmt: skip
"""Of the full top omega and gamma at tau = 1, by a Taylor series in 176 to 224 bits."""


@pytest.mark.parametrize(("keys", "omega", "gamma"), LAWS_OF_TIME.values(), ids=LAWS_OF_TIME)
def test_the_full_top_follows_laws_of_m_and_mu(keys: Any, omega: Any, gamma: Any) -> None:
    end = {"time": "{end: 1, samples: 5}"}
    motion = integrate(case(form="full", epsilon="0.02", **keys, **end)).variables
    assert motion["omega"][-1] == pytest.approx(omega, abs=5e-14)
    assert motion["gamma"][-1] == pytest.approx(gamma, abs=5e-14)


def test_the_averaged_top_follows_laws_of_m_and_mu() -> None:
    keys, _, _ = LAWS_OF_TIME["falling mu"]
    falling = integrate(case(**keys, time="{end: 2, samples: 5}")).variables
    at_end = [falling[name][-1] for name in ("Gz", "H", "r")]
    assert at_end == pytest.approx([0.86602540378, 1.69309225147, math.sqrt(3)], abs=1e-11)
    keys = LAWS_OF_TIME["both"][0] | {"time": "{end: 1, samples: 5}"}
    averaged, apart = integrate(case(**keys)).variables, []
    for epsilon in ("0.02", "0.005"):
        full = integrate(case(form="full", epsilon=epsilon, **keys)).variables
        (p, q, r), (g1, g2, g3) = full["omega"][-1], full["gamma"][-1]
        H = (1.5 * (p * p + q * q) + r * r) / 2 + 0.65 * g3
        Gz = 1.5 * (p * g1 + q * g2) + r * g3
        assert r == pytest.approx(averaged["r"][-1], abs=1e-13)
        apart.append([abs(H - averaged["H"][-1]), abs(Gz - averaged["Gz"][-1])])
    # The error of averaging is of the order of epsilon.
    assert np.array(apart[0]) / apart[1] == pytest.approx([4, 4], rel=0.1)
