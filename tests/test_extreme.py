"""Stiff and extreme cases: `auto` is right or says so, with little work."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import BODY, exact_motion
from numpy.polynomial.legendre import legvander

from hodo_cli import Case, engines
from hodo_cli.cases.case import Time
from hodo_cli.cases.config import load
from hodo_cli.commands import bench
from hodo_cli.engines import collocation
from hodo_cli.integration import choice, integrate, solve
from hodo_cli.models import base

CASES = load(Path(__file__).parents[1] / "configs" / "extreme.yaml").cases
LONG = {"samples-1e7", "damping-1e6-in-all", "tensor-skew-fast", "top-epsilon-1e-6",
        "horizon-1e5-weak"}  # fmt: skip

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")


def test_there_are_enough_cases_and_each_says_what_is_extreme() -> None:
    assert len(CASES) >= 25
    assert all(case.note for case in CASES.values())


@pytest.mark.heyoka
@pytest.mark.parametrize("name", [name for name in CASES if name not in LONG])
def test_auto_is_right_or_says_so(name: str) -> None:
    case = CASES[name]
    result = bench.trial(case, bench.reference_motion(case), "auto", None, 1, math.inf)
    assert result.status not in ("SILENT", "timeout"), result
    # No number with a closed form; the most is 9,321 steps of the series.
    assert not result.steps > 15_000, result
    if name == "middle-axis":  # it comes back to the axis, where rounding is left
        assert result.error < 1e-9
    elif name != "tensor-explosive":  # it outgrows the largest double, and says when
        assert result.status in ("accurate", "limited by the data"), result


@pytest.mark.parametrize(
    "name", ["damping-1e9", "separatrix-1e-15", "horizon-1e8", "cavity-1e6-triaxial", "top-b-1e6"]
)
def test_auto_needs_no_taylor_series(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "have_taylor", lambda: False)
    trajectory = integrate(CASES[name])
    assert trajectory.method in ("exact", "collocation")
    assert trajectory.status == "ok"
    assert trajectory.error < (1e-7 if name == "horizon-1e8" else 1e-11)
    assert trajectory.evaluations < 5000


def test_ten_million_samples_do_not_cost_ten_million_comparisons() -> None:
    case = replace(CASES["samples-1e7"], time=Time(end=10.0, samples=300_000))
    trajectory = integrate(case)
    assert trajectory.variables["omega"].shape == (300_000, 3)
    assert trajectory.error < 1e-12


def test_what_is_stiff_only_for_a_moment_is_left_to_the_series() -> None:
    if engines.have_taylor():
        assert choice.choose(CASES["cavity-averaged-1e6"])[0] == "taylor"
        assert choice.choose(CASES["top-sleeping"])[0] == "taylor"
    assert choice.choose(CASES["cavity-1e6-triaxial"])[0] == "collocation"


def test_the_tableau_meets_its_order_conditions() -> None:
    # B(2s - 1) and C(s).
    points, integrals, transform = collocation.tableau(np.dtype(np.longdouble))
    n = np.arange(1, 2 * collocation.STAGES)[:, None]
    assert np.abs((points ** (n - 1)) @ integrals[:, -1] - 1 / n[:, 0]).max() < 1e-15
    n = n[: collocation.STAGES]
    assert np.abs((points ** (n - 1)) @ integrals - points**n / n).max() < 1e-15
    assert points[-1] == 1
    legendre = legvander(2 * points.astype(float) - 1, collocation.STAGES - 1).T
    assert np.abs(legendre @ transform - np.eye(collocation.STAGES)).max() < 1e-13


@pytest.mark.heyoka
def test_collocation_agrees_with_the_series_where_both_can() -> None:
    # Of 1e4 decay times the series takes every one.
    case = replace(CASES["damping-1e4"], time=Time(start=0.0, end=1.0, samples=101))
    series = solve(case, "taylor", "extended")
    ours = solve(case, "collocation")
    scaled = np.ldexp(ours.state, (ours.exponent - series.exponent)[:, None])
    apart = np.abs(scaled - series.state).max(axis=1)
    assert (apart / np.abs(series.state).max(axis=1)).max() < 1e-14


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long double is double here")
@pytest.mark.quadruple
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_the_closed_form_in_long_double_is_right_to_its_last_digits(damping: float) -> None:
    case = Case.of(BODY | {"damping": damping, "time": {"end": 100, "samples": 101}})
    path, series = solve(case, "exact", "extended"), solve(case, "taylor", "quadruple")
    theirs = engines.extended(series.state)
    apart = np.ldexp(path.state, (path.exponent - series.exponent)[:, None]) - theirs
    assert np.linalg.norm((apart / np.abs(theirs).max()).astype(float), axis=1).max() < 1e-17
    assert np.array_equal(exact_motion(case, path.time).dtype, np.float64)


class Decay(base.Model):
    """y' = -y beside what stays."""

    state = ("y", "c")

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        return -y[0], 0 * y[1]


def steps_of_decay(end: float) -> collocation.RadauSolver:
    equations, start, span = base.Equations(Decay), np.ones(2), (np.float64(0), np.float64(end))
    return collocation.RadauSolver(equations, SimpleNamespace(), start, *span, 1e-14)


def test_collocation_does_not_pass_over_a_decay_that_it_has_to_resolve() -> None:
    # At a step of 1e16 decay times only the start shows that something is missed.
    steps = steps_of_decay(1e18)
    steps.h = np.float64(1e16)
    assert steps.step() is None
    times = np.linspace(0, steps.t, 50)
    assert steps.t < 10
    assert np.abs(steps.dense_output()(times)[0] - np.exp(-times)).max() < 1e-13


def test_collocation_takes_a_shorter_step_where_its_equations_are_singular(monkeypatch):
    solve, asked = np.linalg.solve, []

    def singular_at_first(*of: np.ndarray) -> np.ndarray:
        asked.append(1)
        if len(asked) == 1:
            raise np.linalg.LinAlgError
        return solve(*of)

    monkeypatch.setattr(np.linalg, "solve", singular_at_first)
    steps = steps_of_decay(1)
    assert steps.step() is None
    assert steps.t == 1 / 4
    assert steps.y[0] == pytest.approx(np.exp(-1 / 4), rel=1e-14)
