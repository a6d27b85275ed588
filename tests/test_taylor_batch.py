"""Power series of the model's own equations, and the compiled step that is made of them."""

import math
import os
import subprocess
import sys
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Hodo
from test_sweep import BALL, FIG4, FIG12, HEAD, computed, one

from hodo_cli import Case, machine
from hodo_cli.engines import series as power_series
from hodo_cli.integration import integrate
from hodo_cli.models import base
from hodo_cli.models.base import Event
from hodo_cli.sweeps import chunk, members

TOP = (
    "model: Lagrange-averaged, inertia: {A: 1.5, C: 1}, mu: 0.5, b: [0.1, 1], time: {end: 2}, "
    "initial: {theta: 60 deg, r: 1.7}, error: off, tol: 1e-12"
)
CAVITY = (
    "model: cavity+constant, inertia: [8, 8, 4], kappa: 0.6048, epsilon: 0.1, "
    "error: off, tol: 1e-12"
)
FULL = f"{TOP}, a: [0.125, 1], form: full, epsilon: 0.05"

FORMS = {
    "linear-diag": "model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003], "
    "initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 100}, error: off",
    "tensor": "model: tensor, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}, "
    "resistance: [[5e-3, 1e-3, 0], [1e-3, 4e-3, 0], [0, 0, 3e-3]], time: {end: 100}, error: off",
    "cavity": f"{CAVITY}, torque: [0.01, 0, -0.1], initial: {{p: 1, q: 0.1, r: 1}}, "
    "time: {end: 9}",
    "cavity averaged": f"{CAVITY}, form: averaged, torque: [0, 0, -0.1], initial: {{x: 1, y: 1}}, "
    "time: {end: 30}",
    "top": FULL,
    "top thrown": FULL.replace("theta: 60 deg", "Gz: 1.7, H: 2"),
    "top averaged": f"{TOP}, a: [0.125, 1]",
    "top, exponential": FULL.replace("[0.125, 1]", "0.2*exp(-0.3*t)"),
    "top averaged-u": f"{TOP}, a: [0.125, 1], form: averaged-u",
}


def swept(name: str) -> Case:
    """Members of a form, which differ in their start and, in most forms, in a constant."""
    start = "x" if "x:" in FORMS[name] else "r"
    other = {"linear-diag": "inertia.1: {values: [0.8, 0.81, 0.79]}",
             "tensor": "resistance.0.1: {values: [1e-3, 2e-3, 0]}",
             "cavity": "kappa: {values: [0.6048, 0.6, 0.1]}",
             "cavity averaged": "inertia.2: {values: [4, 4.1, 3]}",
             "top": "initial.theta: {values: [60 deg, 57 deg, 30 deg]}",
             "top thrown": "initial.Gz: {values: [1.7, 1.6, 1.5]}",
             "top averaged": "inertia.C: {values: [1, 1.1, 0.9]}"}.get(name)  # fmt: skip
    numbers = f"initial.{start}: {{values: [0.9, 1, 1.1]}}" + (f", {other}" if other else "")
    return one(f"{FORMS[name]}, sweep: {{m: {{zip: {{{numbers}}}}}}}")


@pytest.fixture
def name(request: pytest.FixtureRequest) -> str:
    """A form, of which the averaged tops take 7 s to optimise: their code stays as it is."""
    if request.param.startswith("top averaged"):
        request.getfixturevalue("quick_steps")
    return str(request.param)


def coefficients(series: Any, n: int = 8) -> list[float]:
    return [series[k] for k in range(n)]


def test_series_have_the_coefficients_of_the_books() -> None:
    s = power_series.Series(lambda k: float(k == 1))
    rows = {
        "1/(1-s)": (1 / (1 - s), [1.0] * 8),
        "sqrt(1+s)": ((1 + s) ** 0.5, [1, 1 / 2, -1 / 8, 1 / 16, -5 / 128, 7 / 256, -21 / 1024]),
        "exp(2s)": (math.e ** (2 * s), [2**k / math.factorial(k) for k in range(8)]),
        "3^s": (3.0**s, [math.log(3) ** k / math.factorial(k) for k in range(8)]),
        "(1+s)/(2-s)": ((1 + s) / (2 - s), [1 / 2, *(3 / 2 ** (k + 1) for k in range(1, 8))]),
        "(1-s)^2": ((1 - s) * (1 - s), [1, -2, 1, 0, 0, 0, 0, 0]),
        "(s+1)^2, as a square": ((lambda x: x * x)(s + 1), [1, 2, 1, 0, 0, 0, 0, 0]),
        "s^2": (s**2, [0, 0, 1, 0, 0, 0, 0, 0]),
        "s^5": (s**5.0, [0, 0, 0, 0, 0, 1, 0, 0]),
        "(1e-9+s)^3": ((1e-9 + s) ** 3, [1e-27, 3e-18, 3e-9, 1, 0, 0, 0, 0]),
        "(1+s)^-2": ((1 + s) ** -2, [1, -2, 3, -4, 5, -6, 7, -8]),
        "s^0": (s**0, [1, 0, 0, 0]),
        "s^1": (s**1, [0, 1, 0, 0]),
        "5 - s/4 - (-s)": (5 - s / 4 - (-s), [5, 3 / 4, 0, 0, 0, 0, 0, 0]),
    }
    for name, (series, known) in rows.items():
        assert coefficients(series, len(known)) == pytest.approx(known, abs=1e-15), name


def test_a_motion_is_its_series() -> None:
    """y'' = -y + t: y = t + cos t - sin t + ..., for arrays of starts at other times than 0."""
    t0, c = np.array([0.0, 0.7]), np.array([1.0, -2.0])

    def rhs(t: Any, y: Any, k: Any) -> Any:
        return y[1], t - y[0]

    start = [t0 + c * np.cos(t0), 1 - c * np.sin(t0)]
    _, (position, _) = power_series.motion(rhs, t0, start, None)
    there = np.polynomial.polynomial.polyval(0.5, np.array([position[k] for k in range(24)]))
    assert there == pytest.approx(t0 + 0.5 + c * np.cos(t0 + 0.5), rel=1e-15)


@pytest.mark.heyoka
@pytest.mark.parametrize(
    ("name", "tol"),
    [*((name, 1e-12) for name in FORMS), ("tensor", 1e-6), ("top", 2.0**-52)],
    indirect=["name"],
)
def test_a_step_ends_where_heyoka_is(name: str, tol: float) -> None:
    """And it is as long as the tolerance allows: heyoka's, by the ratio of the two rules."""
    hy = pytest.importorskip("heyoka")
    from hodo_cli.engines import taylor_batch

    case = swept(name)
    model, k, y0 = case.system.equations, case.system.constants, case.system.initial_state
    y = hy.make_vars(*(f"y{i}" for i in range(len(y0))))
    numbers = [hy.par[i] for i in range(len(base.flatten(k)))]
    rates = model.rhs(hy.time, list(y), base.namespace(model.structure, numbers))
    ta = hy.taylor_adaptive([*zip(y, rates, strict=True)], list(y0), compact_mode=True)
    assert ta.order == taylor_batch.SERIES_ORDER
    ta.pars[:] = base.flatten(k)[: len(ta.pars)]
    step = members.prepare(case, np.arange(3))[0].step
    end, m, rounding = 50.0, len(y0), 1e-3
    inputs = np.tile([[*y0, end, rounding, 7.0]], (taylor_batch.WIDTH, 1)).T.copy()
    parameters = [end, *base.flatten(k), taylor_batch.stride(tol, None)]
    constants = np.tile([parameters], (taylor_batch.WIDTH, 1)).T.copy()
    out = np.empty((step.rows, taylor_batch.WIDTH))
    step(inputs, constants, out)
    assert (out == out[:, :1]).all()
    left, lost, steps, length = out[m : m + 4, 0]
    _, own = ta.step()
    rule = tol ** (1 / (ta.order - 3)) / math.exp(-2)
    # The coefficients of different orders say different radii.
    assert 0.8 < length / own / rule < 1.25
    # The time is the end, less what is left and what rounding has taken from it.
    ta.time, ta.state[:] = -rounding, y0
    ta.propagate_until(length - rounding)
    assert out[:m, 0] == pytest.approx(ta.state, rel=4 * tol, abs=4 * tol)
    # Two numbers hold the time left, and no digit of the step is lost.
    assert (steps, left) == (8, end - length)
    kept = float(Fraction(end) - Fraction(length) - Fraction(left))
    assert lost - rounding == pytest.approx(kept, rel=0, abs=2.0**-60)


@pytest.mark.heyoka
@pytest.mark.parametrize("name", FORMS, indirect=True)
def test_members_of_every_form_are_single_cases(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also that they go side by side: none is left to be integrated alone."""
    monkeypatch.setattr(chunk, "WORTH_COMPILING", 0)
    case = swept(name)
    together = chunk.compute(chunk.Chunk(case, 0, 3))
    assert together.attributes["rejections"].sum() == 0
    values = {name: variable.data for name, variable in together.variables.items()}
    for number in range(3):
        single = integrate(members.member(case, number))
        for variable, known in single.variables.items():
            assert values[variable][number] == pytest.approx(known[-1], rel=3e-12, abs=3e-12)
    assert values["status"].tolist() == [0] * 3


@pytest.mark.heyoka
def test_zeros_are_found_however_near_two_of_them_are() -> None:
    """The two crossings of Fig. 12's body part at r0 = 1.4030877: the pair before they meet."""
    text = (
        "model: tensor, inertia: [1, 0.8, 0.6], resistance: {diagonal: 0.005, off_diagonal: 0.005},"
        " initial: {p: 0.5, q: 0.25, r: 1.4}, time: {end: 1000}, error: off, tol: 1e-15"
    )
    values = "values: [1.4, 1.403087, 1.403089, 1.4031, 1.404]"
    case = one(f"{text}, sweep: {{initial.r: {{{values}}}}}")
    assert computed(case)["crossings"].tolist() == [1, 1, 3, 3, 3]


def signed(t: Any, y: Any, k: Any) -> Any:
    """An event with every sign that a majorant must turn."""
    return 2 - (3 - t) * y[0] * y[1] / (-4) - (-y[2] * y[2]) * (-1.5)


@pytest.mark.heyoka
@pytest.mark.parametrize("which", ["separatrix", "signed"])
def test_the_rest_of_an_events_series_is_bounded(which: str) -> None:
    """By no less than its terms beyond the order, and by no more than a few times as much."""
    from hodo_cli.engines import taylor_batch

    case = one(FORMS["tensor"])
    k = base.attributes(case.system.constants)
    event = case.system.class_events[0] if which == "separatrix" else Event(which, signed)
    step, order = 1.5, taylor_batch.EVENT_ORDER
    for start in np.random.default_rng(4).standard_normal((50, 3)).tolist():
        time, state = power_series.motion(case.system.equations.rhs, 0.5, start, k)
        series = event.function(time, state, k)
        rest = sum(abs(series[i]) * step**i for i in range(order + 1, taylor_batch.SERIES_ORDER))
        at = taylor_batch.SymbolicMotion([], time, state, k)
        bound = taylor_batch.majorant_beyond(order, event.function, at, step)
        assert rest <= bound
        powers = [max(abs(s[i]) * step**i for s in state) for i in range(order + 1)]
        assert bound < 100 * max(powers) ** 2


@pytest.mark.heyoka
def test_a_step_clears_no_event_that_it_meets() -> None:
    """Its bound is below |D| within the step: also of an event that divides and has no majorant."""
    from hodo_cli.engines import taylor_batch

    case = one(FORMS["tensor"])
    k = base.flatten(case.system.constants)
    (separatrix,) = case.system.class_events
    tilt = Event("tilt", lambda t, y, k: separatrix.function(t, y, k) / (2 + y[0] * y[0]))
    n = 400 * taylor_batch.WIDTH
    columns = np.zeros((6, n))
    columns[:3], columns[3] = np.random.default_rng(5).standard_normal((3, n)), 50
    stride = taylor_batch.stride(1e-12, None)
    constants = np.repeat([[number] for number in (50.0, *k, stride)], n, axis=1)
    for event in (separatrix, tilt):
        step = taylor_batch.build(case.system.equations, (event,))
        out = np.empty((step.rows, n))
        step(columns, constants, out)
        length, clear = out[-2:]
        D = step.event_series(event, columns, constants)
        at = length[:, None] * np.linspace(0, 1, 200)
        within = np.abs(np.polynomial.polynomial.polyval(at.T, D, tensor=False).T)
        assert (clear <= within.min(axis=1) * (1 + 1e-12)).all()
        assert (clear > 0.9 * np.abs(D[0])).mean() > 0.8
        assert (clear < 0).any()


@pytest.mark.heyoka
@pytest.mark.parametrize("body", ["linear-diag", "tensor", "drag", "other axes"])
def test_chunks_and_neighbours_change_no_bit(body: str) -> None:
    tensor = HEAD.replace("[1, 0.8, 0.6]", "[[1, 0.1, 0], [0.1, 0.8, 0.1], [0, 0.1, 0.6]]")
    turned = f"model: torques, {tensor}, damping: 0.005, rotor: [0.03, 0.08, 0.06]"
    texts = {
        "linear-diag": f"{FIG4}, {BALL}",
        "tensor": f"{FIG12}, {BALL}",
        "drag": f"model: torques, {HEAD}, quadratic: [0.005, 0.004, 0.003], {BALL}",
        "other axes": f"{turned}, {BALL.replace('G: 1', 'r: 1')}",
    }
    moment = "inertia.1.1" if body == "other axes" else "inertia.1"
    sweep = f"{{{moment}: {{values: [0.7, 0.8]}}, d: {{sphere: {{count: 37}}}}}}"
    case = one(f"{texts[body]}, sweep: {sweep}")
    whole = computed(case)
    cuts = [0, 1, 12, 41, 63, 74]
    parts = [computed(case, a, b) for a, b in pairwise(cuts)]
    for name, values in whole.items():
        joined = np.concatenate([part[name] for part in parts])
        np.testing.assert_array_equal(values, joined, err_msg=name)


@pytest.mark.heyoka
def test_samples_side_by_side_are_those_of_single_cases_and_neighbours_change_no_bit() -> None:
    """Half of the motions fall by e^-100 meanwhile, through several units."""
    sizes = ", ".join(f"damping.{i}: {{values: [0.004, {0.1 + 0.01 * i}]}}" for i in range(3))
    axes = f"size: {{zip: {{{sizes}}}}}, d: {{sphere: {{count: 40}}}}"
    case = one(f"{FIG4.replace('end: 1000', 'end: 1000, samples: 1234')}, {BALL}, "
               f"store: [trajectory], sweep: {{{axes}}}")  # fmt: skip
    whole, some = computed(case)["omega"], computed(case, 37, 45)["omega"]
    assert np.array_equal(whole[37:45], some)
    assert np.linalg.norm(whole[-1, -1]) < 2.0**-100
    for number in range(37, 43):
        known = integrate(members.member(case, number, samples=1234)).variables["omega"]
        off = np.linalg.norm(whole[number] - known, axis=1)
        # Each is right to 5e-13, by the reference in long double.
        assert (off <= 1e-12 * np.linalg.norm(known, axis=1)).all()


# Compiled code on the disk: the user's own, and no more than there is room for.

COMPILE = "from hodo_cli.machine import cached_code; print(cached_code('key', lambda: [1, 2]))"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the code, which is not there yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "hodo"


def test_processes_that_begin_together_store_one_code_of_the_users_own(folder: Path) -> None:
    processes = [
        subprocess.Popen([sys.executable, "-c", COMPILE], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    assert {process.communicate()[0] for process in processes} == {"[1, 2]\n"}
    assert machine.cached_code("key", lambda: "anew") == [1, 2]
    assert os.listdir(folder) == ["key.code"]
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("damage", ["cut", "empty", "of another version"])
def test_code_that_a_disk_has_torn_is_compiled_anew(folder: Path, damage: str) -> None:
    assert machine.cached_code("key", lambda: "sound") == "sound"
    file = folder / "key.code"
    sound = file.read_bytes()
    others = sound[16:] + bytes(range(128, 160))
    file.write_bytes({"cut": sound[:-1], "empty": b"", "of another version": others}[damage])
    assert machine.cached_code("key", lambda: "new") == "new"
    assert machine.cached_code("key", lambda: "other") == "new"


def test_a_folder_that_others_can_reach_is_not_used(folder: Path) -> None:
    assert machine.cached_code("key", lambda: 1) == 1
    folder.chmod(0o755)
    assert machine.cached_code("key", lambda: 2) == 2
    folder.chmod(0o700)
    assert machine.cached_code("key", lambda: 3) == 1


def test_the_code_that_was_used_last_stays(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "MOST_FILES", 2)
    for name in "ab":
        machine.cached_code(name, lambda: bytes(10))
        os.utime(folder / f"{name}.code", (1, 1 + ord(name)))
    machine.cached_code("a", bytes)  # is used, so that b is the oldest
    machine.cached_code("c", lambda: bytes(10))
    assert sorted(os.listdir(folder)) == ["a.code", "c.code"]


@pytest.mark.heyoka
@pytest.mark.parametrize("is_named", [False, True])
def test_what_heyoka_compiles_is_kept_within_bounds(tmp_path, monkeypatch, is_named):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if is_named:
        monkeypatch.setenv("HEYOKA_CACHE_DIR", str(tmp_path / "own"))
    else:
        monkeypatch.delenv("HEYOKA_CACHE_DIR", raising=False)
    code = """
import heyoka as hy
from hodo_cli.engines import taylor
x = hy.make_vars("x")
hy.taylor_adaptive([(x, -x)], [1.0])
print(hy.llvm_state.get_diskcache_limit())
"""
    limit = subprocess.check_output([sys.executable, "-c", code], text=True)
    folder = tmp_path / ("own" if is_named else "hodo/heyoka")
    assert (folder / "cache.db").stat().st_size > 0
    assert (int(limit) <= 256 << 20) != is_named
    assert os.listdir(tmp_path) == [folder.relative_to(tmp_path).parts[0]]


SWEEP = """\
cases:
  a: {model: tensor, inertia: [1, 0.8, 0.6], resistance: {diagonal: 0.003, off_diagonal: 0.001},
      time: {end: 400}, error: off, initial: {p: 0, q: 0, G: 1},
      sweep: {direction: {sphere: {count: 600, seed: 1}}}}
"""


@pytest.mark.process
@pytest.mark.heyoka
def test_a_step_from_the_disk_gives_the_same_bits(folder: Path, hodo: Hodo) -> None:
    (folder.parent / "x.yaml").write_text(SWEEP)
    columns = []
    for out in ("compiled", "loaded"):
        assert hodo("run", "x.yaml", "--out", out).returncode == 0
        stored = {path.name: path.read_bytes() for path in folder.glob("*.code")}
        with h5py.File(folder.parent / out / "x.h5") as file:
            columns.append({name: item[()] for name, item in file["a"].items()})
    assert len(stored) == 2  # the step, and its event
    assert columns[0].keys() == columns[1].keys()
    for name, values in columns[0].items():
        np.testing.assert_array_equal(values, columns[1][name], err_msg=name)
