"""Motions that the data feed energy into: they end, and the data are warned of before the run."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import BODY

import hodo_cli
from hodo_cli import Case, engines
from hodo_cli.engines import protocol
from hodo_cli.integration import integrate
from hodo_cli.models.rigid_body import BodyFrame

SPINS_UP = """\
cases:
  grows:
    {model: tensor, inertia: [1, 0.8, 0.6], initial: {p: 0.5, q: 0.25, G: 1}, time: {end: 100},
     resistance: [[-0.5, 0, 0], [0.001, 0.01, 0], [0, 0, 0.01]], max_steps: 2000}
  fed: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [-0.01, 0, 0],
        initial: {p: 0.5, q: 0.25, G: 1}, time: {end: 10, samples: 3}}
  late: {model: torques, inertia: [1, 0.8, 0.6], initial: {p: 0.5, q: 0.25, G: 1},
         damping: [0.01, 0.01 - 0.002*t, 0.01],
         time: {end: 10, samples: 3}}
"""


def test_what_the_data_do_is_said_before_the_run(hodo, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(SPINS_UP)
    ran = hodo("run", "a.yaml")
    assert ran.returncode == 1
    said = [line for line in ran.stderr.splitlines() if ": warning: " in line]
    assert [line.split("warning: ")[1].split(":")[0] for line in said] == [
        "the tensor is not dissipative",
        "the tensor is not symmetric",
        "negative damping feeds energy in",
    ]
    assert "damping is negative from t = 5.00244 on: it drives the body" in ran.stdout
    assert ran.stderr.index(said[-1]) < ran.stderr.index("[1/3]")
    assert "max_steps in the case allows more" in ran.stdout


def test_what_the_ends_of_a_sweep_do_is_said_before_the_run(hodo, tmp_path: Path) -> None:
    # The value that the sweep replaces is not run, and nothing is said of it.
    ends = "of 3 members (only the first and the last are checked)"
    text = """\
cases:
  a: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [-0.5, 0, 0], time: {end: 10},
      initial: {p: 0.5, q: 0.25, G: 1}, sweep: {damping.0: {linspace: [LOW, 0.01, 3]}}}
"""
    for low, expected in (
        ("-0.01", [f"first {ends}: negative damping feeds energy in: lambda1 = -0.01"]),
        ("0", []),
    ):
        (tmp_path / "a.yaml").write_text(text.replace("LOW", low))
        ran = hodo("run", "a.yaml", "--force", "-v")
        assert ran.returncode == 0
        said = [line for line in ran.stderr.splitlines() if ": warning: " in line]
        assert [line.split("warning: ")[1] for line in said] == expected


SIZES = """\
defaults: {damping: [1e-155, 0, 0]}
cases:
  a: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1e-155, q: 0, r: -1e200},
      time: {end: 1e155}}
  b: {model: torques, inertia: [1, 0.8, 0.6], initial: {p: 0, q: 1, r: 0}, time: {end: 1},
      damping: 0, expression: ["1e-200*p", 0, 0], sweep: {initial.q: {values: [1e-154, 1e155]}}}
"""


def test_numbers_of_a_size_that_has_no_square_are_refused_with_their_places(hodo, tmp_path):
    """But 0, and those within an expression."""
    (tmp_path / "a.yaml").write_text(SIZES)
    done = hodo("run", "a.yaml")
    words = " is out of range, 1e-154 to 1e+154: take other units"
    assert done.returncode == 2
    assert [line.removesuffix(words) for line in done.stderr.splitlines()] == [
        "a.yaml:1:22: defaults.damping.0: 1e-155",
        "a.yaml:3:64: cases.a.initial.p: 1e-155",
        "a.yaml:3:81: cases.a.initial.r: 1e+200",
        "a.yaml:4:19: cases.a.time.end: 1e+155",
        "a.yaml:6:88: cases.b.sweep.initial.q.values.1: 1e+155",
    ]
    assert not (tmp_path / "runs").exists()


def test_a_motion_may_decay_below_every_size_that_data_have(hodo, tmp_path: Path) -> None:
    text = SIZES.replace("1e-155", "0.5").replace("-1e200", "1").replace("1e155", "2000")
    (tmp_path / "a.yaml").write_text(text)
    assert hodo("run", "a.yaml", "--case", "a").returncode == 0
    assert float(hodo_cli.open(tmp_path / "runs/a.h5")["a"].error) < 1e-11


DRIVEN = ("taylor", "collocation", *protocol.IVP)


@pytest.mark.parametrize("method", DRIVEN)
def test_every_method_has_a_last_step(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if method == "taylor" and not engines.have_taylor():
        pytest.skip("needs heyoka")
    assert 1e5 <= protocol.LAST_STEP[method] <= 1e7
    monkeypatch.setitem(protocol.LAST_STEP, method, 50)
    tensor = {"model": "tensor", "resistance": np.diag([-0.5, 0.01, 0.01]).tolist()}
    keys = {"time": {"end": 1000, "samples": 3}, "method": method, "error": "off"}
    motion = integrate(Case.of(BODY | tensor | keys))
    assert motion.steps == 50
    assert motion.message.startswith("max_steps: stopped after 50 steps")


@dataclass(frozen=True)
class Outflow(BodyFrame):
    """p' = -sqrt(p) from p(0) = 1, which is 0 at t = 2 and has no real rate below 0."""

    name = "outflow"
    form = "full"

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        return -(y[0] ** 0.5), 0 * y[1], 0 * y[2]


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("method", [name for name in DRIVEN if name != "taylor"])
def test_equations_that_leave_the_real_numbers_end_the_motion(method: str) -> None:
    engine = engines.engine_for(method, Outflow((1.0, 1.0, 1.0), {}), 1e-6, "double")
    control = protocol.StepControl(max_steps=10_000)
    stretch = engine.integrate({}, np.array([1.0, 0.0, 0.0]), np.linspace(0, 4, 17), control)
    assert control.status == "failed"
    assert float(stretch.time[0]) < 2.2
    times = np.linspace(0, 4, 17)[: len(stretch.rows)]
    assert stretch.rows[:, 0] == pytest.approx((1 - times / 2) ** 2, abs=1e-4)
