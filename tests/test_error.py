"""The measured error: of what is stored, at the samples that both motions have."""

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import conftest
import numpy as np
import pytest
from conftest import Hodo

import hodo_cli
from hodo_cli import Case, engines
from hodo_cli.cases.case import Time
from hodo_cli.integration import Trajectory, driver, error, integrate

SPIN = Case.of(
    {
        "model": "cavity+constant", "form": "averaged", "inertia": [8, 8, 4], "kappa": 0.6048,
        "torque": [0, 0, -0.1], "epsilon": 0.1, "initial": {"x": 1, "y": 1}, "time": {"end": 60},
    }
)  # fmt: skip
FIG4 = Case.of(conftest.FIG4 | {"time": {"end": 100, "samples": 101}})


@pytest.mark.parametrize("samples", [100_001, 150_001])  # thinned to 100,000
def test_an_event_that_ends_a_thinned_motion_costs_no_digits(samples: int) -> None:
    """Thinned by themselves, the motion and its reference would keep different samples."""
    motion = integrate(replace(SPIN, time=Time(end=60.0, samples=samples)))
    assert len(motion.time) < samples
    assert motion.errors
    assert motion.error < 1e-12


@pytest.mark.heyoka
@pytest.mark.parametrize(
    "precision", ["extended", pytest.param("quadruple", marks=pytest.mark.quadruple)]
)
def test_the_error_is_that_of_the_stored_doubles(precision: str) -> None:
    motion = integrate(replace(FIG4, precision=precision))
    rounded = np.array(motion.variables["omega"])
    assert rounded.dtype == np.float64
    assert 2**-60 < motion.error < 2**-52


def test_without_the_next_precision_the_reference_is_another_tolerance_or_method(monkeypatch):
    """A heyoka without quadruple precision, and at last a long double that is a double."""
    monkeypatch.setattr(engines, "have_quadruple", lambda: False)
    assert integrate(FIG4).error_kind == "extended"
    extended = integrate(replace(FIG4, precision="extended"))
    assert (extended.error_kind, extended.error < 2**-52) == ("refined", True)
    monkeypatch.setattr(error, "HAS_EXTENDED", False)
    known = integrate(replace(FIG4, data=FIG4.data | {"damping": (0.005,) * 3}))
    assert (known.method, known.error_kind) == ("exact", "refined")
    for motion in (integrate(FIG4), known):
        assert motion.error_kind == "refined"
        assert 0 < motion.error < 1e-12


def test_what_has_no_next_precision_is_compared_at_a_finer_tolerance_first() -> None:
    quadruple = replace(FIG4, precision="quadruple")
    assert [*error.references(quadruple, "taylor", 1e-20)] == [
        ("quadruple", "taylor", pytest.approx(1e-22, rel=1e-12, abs=0)),
        ("quadruple", "taylor", pytest.approx(1e-18, rel=1e-12, abs=0)),
    ]


def test_a_motion_that_is_called_at_rest_a_step_early_has_no_error() -> None:
    time, moving = np.array([0.0, 1.0]), np.array([[1.0, 0, 0], [0.5, 0, 0]])
    sizes = np.array([0, -driver.REST_BITS + 1]), np.array([0, -driver.REST_BITS])
    ours = Trajectory(FIG4, "", 0.0, time, moving * [[1], [0]], sizes[1])
    theirs = replace(ours, state=moving.astype(np.longdouble), exponent=sizes[0])
    assert error.errors_against(FIG4, ours, theirs) == {"omega": 0}
    # Far above that limit a motion that has stopped is wrong.
    moving_on = replace(theirs, exponent=np.array([0, -9]))
    assert error.errors_against(FIG4, ours, moving_on) == {"omega": 1}


def test_what_rounding_leaves_of_a_motion_that_passes_through_rest_is_no_error() -> None:
    """r = 0.01 t - 1 is 0 at the sample at 100."""
    body = {"model": "torques", "inertia": [120, 100, 80], "torque": [0, 0, 0.8]}
    start = {"initial": {"p": 0, "q": 0, "r": -1}, "time": {"end": 200}}
    motion = integrate(Case.of(body | start))
    assert abs(motion.variables["omega"][500, 2]) < 1e-15
    assert motion.error < 1e-12


@pytest.mark.parametrize(
    ("lengths", "error_of_second"),
    [((1, 1e-14, 2), 1e-14), ((1, 1e-14, 1e-28), 1), ((1, 1e-5, 1), 1), ((1e-300, 1e-14, 1), 1)],
)
def test_only_a_motion_that_passes_through_rest_has_the_scale_of_its_neighbours(
    lengths: tuple[float, ...], error_of_second: float
) -> None:
    """A sample that is off by all of itself."""
    better = np.outer(lengths, [1.0, 0, 0])
    judged = better * [[1], [2], [1]]
    assert error.error_of_variable(("time", "axis"), judged, better) == error_of_second


BODY = {
    "inertia": [1.4, 3, 2], "initial": {"p": 0.9, "q": 0.05, "r": 1.1},
    "time": {"start": 5, "end": 125, "samples": 241},
}  # fmt: skip
STOPPING: dict[str, dict[str, Any]] = {
    "drag": {"model": "torques", "brake": 0.02, "quadratic": [0.01, 0.2, 0.02], "kappa": 0.1},
    "turned": {"model": "torques", "brake": 0.02, "damping": [0.01, 0.02, 0.03], "attitude": "yes"},
    "free": {"model": "torques", "brake": 0.03},
    "spin": {"model": "cavity+constant", "form": "averaged", "inertia": [8, 8, 4], "kappa": 1,
             "torque": [0, 0, -0.1], "initial": {"x": 1, "y": 1}},
}  # fmt: skip


@cache
def true_stop(name: str) -> float:
    """When a body stops, in long double: once for all methods."""
    case = {**BODY, **STOPPING[name], "precision": "extended", "error": "off"}
    return float(hodo_cli.run(case).event_time[-1])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", STOPPING)
@pytest.mark.parametrize(
    ("method", "tol"),
    [pytest.param("taylor", 1e-4, marks=pytest.mark.heyoka), ("collocation", 1e-5), ("auto", None)],
)
def test_the_error_of_an_event_is_its_true_one(name: str, method: str, tol: float | None) -> None:
    data = {**BODY, **STOPPING[name]}
    true = true_stop(name)
    motion = hodo_cli.run({**data, "method": method} | ({"tol": tol} if tol else {}))
    off, stated = abs(float(motion.event_time[-1]) - true), float(motion.event_error[-1])
    # The last digit of either time.
    assert off <= 1.01 * stated + 2 * math.ulp(true)
    assert stated <= 1.01 * off + 2e-12
    assert motion.event_error.attrs["units"] == "1"
    # An error of a time is one of the motion, and no infinite one.
    assert stated / (true - 5) <= 1.001 * motion.attrs["error"] < math.inf


def test_an_event_is_printed_to_its_error(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "stops.yaml").write_text("""\
defaults: {model: torques, inertia: [1.4, 3, 2], initial: {p: 0.9, q: 0.05, r: 1.1}, brake: 0.02,
           damping: [0.01, 0.02, 0.03], time: {end: 120}}
cases:
  loose: {method: collocation, tol: 1e-3}
  asked: {method: collocation, tol: 1e-3, error: off}
  unmeasured: {error: off}
""")
    assert hodo("run", "stops.yaml").returncode == 0
    table = hodo("classify", "runs/stops.h5").stdout
    # Where no error was measured, the classification asks a reference about the time next to rest.
    lines = re.findall(r"stopped at 67\.14876\d{6} \(error \d\.\de-11\)$", table, re.MULTILINE)
    assert len(lines) == 2, table
    assert "stopped at 67.1488 (error not measured)" in table


@pytest.mark.parametrize("tol", [1e-3, 1e-4])  # with the first it ends too early, then too late
def test_the_time_at_which_an_event_ends_a_motion_has_its_error(tol: float) -> None:
    loose = replace(SPIN, method="collocation", tol=tol, time=Time(end=60.0, samples=61))
    motion = integrate(loose)
    end = integrate(replace(loose, method="auto", tol=None)).time[-1]
    assert motion.errors["event_time"] == pytest.approx(abs(motion.time[-1] / end - 1), rel=1e-3)


STARTS = {
    "model": "torques", "inertia": [3.22, 2.5, 1], "kappa": 0.02, "brake": 0.01,
    "initial": {"p": 0, "q": 0, "G": 1}, "time": {"end": 40},
    "sweep": {"direction": {"sphere": {"count": 60, "seed": 4}}},
}  # fmt: skip


def test_the_worst_members_are_among_those_measured():
    """The errors of the worst end and of the worst crossing are those by long doubles."""
    many = hodo_cli.sweep(STARTS)
    better = hodo_cli.sweep({**STARTS, "precision": "extended", "error": "off"})
    assert many.attrs["error_sample"] == 60
    apart = np.linalg.norm(many.omega - better.omega, axis=-1)
    start = np.linalg.norm(many.direction_vector / STARTS["inertia"], axis=-1)
    size = np.fmax(np.linalg.norm(better.omega, axis=-1), start)
    times = np.abs(many.crossing_time - better.crossing_time).values
    for errors, true in (
        (many.attrs["error_quantiles"], (apart / size).max()),
        (many.attrs["crossing_error_quantiles"], np.nanmax(times)),
    ):
        assert true / 2 < errors[-1] < 2 * true


def test_errors_of_averaged_members_are_known_with_and_without_a_crossing():
    """Whose crossings are no zeros of a function that has an error of its own."""
    averaged = {key: STARTS[key] for key in ("inertia", "initial", "time")}
    averaged |= {"model": "linear-diag", "form": "averaged", "damping": [0.02, 0.05, 0.03]}
    ball = {"direction": {"sphere": {"count": 40, "seed": 1}}}
    balls = hodo_cli.sweep(averaged | {"sweep": ball})
    crossing = np.isfinite(balls.crossing_time.values)
    assert 0 < crossing.sum() < crossing.size
    assert balls.attrs["error_sample"] == 40
    assert "no measured error" not in balls.attrs["warnings"]
