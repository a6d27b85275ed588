"""Models of a user's own: the two examples of the documents, mistakes in them, and one with a law
of time."""

import json
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import ROOT, Hodo, call_apart, run_hodo
from scipy.spatial.transform import Rotation
from test_docs import snippets

import hodo_cli
from hodo_cli.engines import have_taylor

EXAMPLE, HEAVY = (text for text in snippets("docs/own-models.md", "python") if "class " in text)
CONFIG = """\
defaults: {inertia: [1, 0.8, 0.6], time: {end: 10, samples: 3}, method: collocation,
           initial: {p: 0.8, q: 0.5, r: 0.74}}
cases:
  one: {model: quadratic-drag, error: off, drag: 0.1}
  two: {model: quadratic-drag, error: off, drag: 0.2}
  swept: {model: quadratic-drag, drag: 0.2, error: off, sweep: {drag: {values: [0, 0.1]}}}
  known: {model: linear-diag, error: off}
"""


@pytest.fixture
def hodo(tmp_path: Path) -> Hodo:
    return partial(call_apart, tmp_path)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "drag.py").write_text(EXAMPLE, encoding="utf-8")
    (tmp_path / "a.yaml").write_text(CONFIG, encoding="utf-8")
    return tmp_path


def run(hodo: Hodo, file: str, *commands: str) -> None:
    """Commands on `a.yaml` with the models of a file, all of which end well."""
    for command in commands or ("run", "classify"):
        done = hodo("--models", file, command, "a.yaml")
        assert done.returncode == 0, done.stdout + done.stderr


def test_a_model_of_ones_own_runs_and_is_hashed(hodo: Hodo, folder: Path) -> None:
    """Its members too, and only its own cases depend on its source."""
    assert "quadratic-drag" not in hodo("schema").stdout
    schema = hodo("--models", "drag.py", "schema").stdout
    assert "quadratic-drag" in json.dumps(json.loads(schema))
    done = hodo("--models", "drag.py", "run", "a.yaml")
    assert done.returncode == 0, done.stderr
    run(hodo, "drag.py", "classify")
    with h5py.File(folder / "runs" / "a.h5") as file:
        speeds = [sum(file[name]["omega"][-1] ** 2) for name in ("known", "one", "two")]
        assert speeds[0] > speeds[1] > speeds[2] > 0
        assert list(file["one/enclosed_axis"]) == [1] * 3
        assert list(file["swept/status"]) == [0, 0]
        assert file["one"].attrs["model_source"] == f"# drag.py\n{EXAMPLE}"
    assert hodo_cli.open(folder / "runs" / "a.h5")["swept"]["drag"].values.tolist() == [0, 0.1]
    # What is stored can be shown without its file; what computes says how to name it.
    assert hodo("show", "runs/a.h5").returncode == 0
    for command in ("run", "classify"):
        lines = hodo(command, "a.yaml").stderr.splitlines()
        assert lines
        assert all("got 'quadratic-drag' (from a file of your own: hodo --" in x for x in lines)
    # A typo in the word itself leaves a case without a model.
    (folder / "b.yaml").write_text("cases: {a: {modle: tensor, nodes: 3, x: 1}}", encoding="utf-8")
    said = hodo("run", "b.yaml").stderr
    assert "did you mean 'model'?" in said
    assert "cases.a.x: unknown key" in said
    planned = hodo("--models", "drag.py", "run", "a.yaml", "--dry-run").stdout
    assert planned.count("is kept") == 4
    (folder / "drag.py").write_text(EXAMPLE + "CHANGED = True\n", encoding="utf-8")
    lines = hodo("--models", "drag.py", "run", "a.yaml", "--dry-run").stdout.splitlines()
    changed = [line for line in lines if "the code that computes it has changed" in line]
    assert [line.split(":")[0] for line in changed] == ["one", "two", "swept"]


HELPER = "def drag(k, w):\n    return k.c * w\n"


def with_helper(folder: Path) -> None:
    """The example, with a factor from a file beside it."""
    helped = EXAMPLE.replace("k.c * w *", "drag(k, w) *")
    (folder / "drag.py").write_text(f"from laws.drag import drag\n{helped}", encoding="utf-8")
    (folder / "laws").mkdir()
    (folder / "laws" / "__init__.py").touch()
    (folder / "laws" / "drag.py").write_text(HELPER, encoding="utf-8")
    (folder / "other.py").write_text("not imported = 1", encoding="utf-8")


PROGRAM = """\
import laws.drag, utilities, hodo_cli, json
case = hodo_cli.run({'model': 'quadratic-drag', 'drag': 0.1, 'inertia': [1, 0.8, 0.6],
    'initial': {'p': 0.8, 'q': 0.5, 'r': 0.74}, 'time': {'end': 10, 'samples': 3},
    'method': 'collocation', 'error': False})
print(json.dumps(case.attrs['model_source']))
"""
MISTAKES_IN_HELPER = [
    ("def drag(k, w):\n    return k.e * w\n", ":2: AttributeError: 'types.SimpleNamespace' "),
    ("def drag(k, w:\n    return 1\n", ":1: SyntaxError: '(' was never closed"),
    ("raise ValueError('no')", ":1: ValueError: no"),
    ("from math import sin\ndef drag(k, w):\n    return sin(w)", ":3: TypeError: must be real"),
]


def test_what_a_model_imports_from_its_folder_is_stored_and_hashed(hodo, folder):
    """Whatever a program has imported from there before; mistakes are named there."""
    with_helper(folder)
    elsewhere, helper = folder / "elsewhere", folder / "laws" / "drag.py"
    elsewhere.mkdir()
    command = ("--models", folder / "drag.py", "run", "../a.yaml", "--out", "../runs")
    done = hodo(*command, "-j", "2", cwd=elsewhere)
    assert done.returncode == 0, done.stderr
    with h5py.File(folder / "runs" / "a.h5") as file:
        for name in ("one", "swept"):
            source = file[name].attrs["model_source"]
            assert source.index("class QuadraticDrag") < source.index("# laws/drag.py\n" + HELPER)
            assert "other" not in source
        assert "model_source" not in file["known"].attrs
    assert hodo(*command, "--dry-run", cwd=elsewhere).stdout.count("is kept") == 4
    (folder / "utilities.py").write_text("x = 1\n", encoding="utf-8")
    (folder / "program.py").write_text(PROGRAM, encoding="utf-8")
    environment = {**os.environ, "HODO_MODELS": str(folder / "drag.py")}
    asked = [sys.executable, str(folder / "program.py")]
    done = subprocess.run(asked, capture_output=True, text=True, env=environment, check=True)
    assert json.loads(done.stdout) == source
    helper.write_text(HELPER.replace("k.c", "2 * k.c"), encoding="utf-8")
    planned = hodo(*command, "--dry-run", cwd=elsewhere).stdout
    assert planned.count("the code that computes it has changed") == 3
    for wrong, said in MISTAKES_IN_HELPER:
        helper.write_text(wrong, encoding="utf-8")
        done = hodo("--models", "drag.py", "run", "a.yaml")
        assert (done.returncode, done.stdout) == (2, "")
        assert f"{helper}{said}" in done.stderr.splitlines()[0]


OF_HEAVY = """
figures:
  energy:
    kind: series
    cases: [kovalevskaya]
    variables: [T, vertical.x1]
    formula: {T: 1.06 - vertical.x1}
claims:
  - {id: energy, where: a, statement: T + L.z is conserved, cases: [kovalevskaya],
     check: {kind: formula, of: T, formula: 1.06 - 1*vertical.x1}, expect: reproduced}
  - {id: sphere, where: b, statement: the vertical is a direction, cases: [kovalevskaya],
     check: {kind: bound, of: vertical.x3, at: always, least: -1, most: 1}, expect: reproduced}
  - {id: half, where: c, statement: it stays in the upper half, cases: [kovalevskaya],
     check: {kind: bound, of: vertical.x3, at: always, least: 0}, expect: contradicted}
"""


def test_the_heavy_body_of_the_documents_keeps_its_integrals(hodo: Hodo, tmp_path: Path) -> None:
    """Of Kovalevskaya's body; the vertical is where the quaternion has it, of members too."""
    config = next(text for text in snippets("docs/own-models.md", "yaml") if "model: heavy" in text)
    (tmp_path / "heavy.py").write_text(HEAVY, encoding="utf-8")
    body = config.removeprefix("cases:\n")
    tilts = "    sweep: {attitude.euler.1: {values: [0.3, 1.0471975511965976]}}\n"
    alone = body.replace("end: 50", "end: 5, samples: 3") + "    error: off\n"
    alone += "    method: collocation\n"  # a step for its members takes 6 s to compile
    swept = alone.replace("kovalevskaya", "swept") + tilts
    ball = "    store: [trajectory]\n    sweep: {d: {sphere: {count: 5, seed: 1}}}\n"
    swept += alone.replace("kovalevskaya", "random") + ball
    (tmp_path / "a.yaml").write_text(f"cases:\n{body}{swept}{OF_HEAVY}", encoding="utf-8")
    run(hodo, "heavy.py", "run", "claims", "plot")
    data = hodo_cli.open(tmp_path / "runs" / "a.h5")
    (p, q, r), z = data["kovalevskaya"].omega.values.T, data["kovalevskaya"].vertical.values.T
    energy = p * p + q * q + r * r / 2 + z[0]
    vertical_momentum = 2 * p * z[0] + 2 * q * z[1] + r * z[2]
    fourth = (p * p - q * q - z[0]) ** 2 + (2 * p * q - z[1]) ** 2
    for integral in (energy, vertical_momentum, fourth):
        assert np.ptp(integral) < 1e-13
        assert abs(integral[0]) > 0.01
    for name in ("kovalevskaya", "random"):
        attitudes = data[name].attitude.values.reshape(-1, 4)
        verticals = data[name].vertical.values.reshape(-1, 3)
        turned = Rotation.from_quat(attitudes, scalar_first=True).apply(verticals)
        assert np.abs(turned - [0, 0, 1]).max() < 1e-13
    last = data["swept"].isel({"attitude.euler.1": 1})
    assert np.abs(last.omega - data["kovalevskaya"].omega.sel(time=5)).max() < 1e-11


EVENTED = (
    "from hodo_cli.models.base import Event\n"
    + EXAMPLE
    + """
    @property
    def run_events(self):
        return (
            Event("level", lambda t, y, k: y[2] - 0.5),
            Event("slowest", lambda t, y, k: y[0]**2 + y[1]**2 + y[2]**2 - 0.36, terminal=True),
        )
"""
)


@pytest.mark.parametrize("method", ["auto", "collocation"])
def test_a_motion_that_an_event_ends_is_labelled_to_its_end(hodo, folder, method):
    """Whether samples stand near the end or not, and as a member of a sweep."""
    (folder / "drag.py").write_text(EVENTED, encoding="utf-8")
    given = f"model: quadratic-drag, drag: 0.05, method: {method}"
    cases = "".join(f"  n{n}: {{{given}, time: {{end: 60, samples: {n}}}}}\n" for n in (3, 2000))
    swept = f"  all: {{{given}, time: {{end: 60}}, sweep: {{drag: {{values: [0.05, 0.1]}}}}}}\n"
    (folder / "a.yaml").write_text(f"{CONFIG.partition('  one')[0]}{cases}{swept}", "utf-8")
    run(hodo, "drag.py")
    data = hodo_cli.open(folder / "runs" / "a.h5")
    for n in (3, 2000):
        case = data[f"n{n}"]
        assert {*case.event_kind.values.tolist()} == {"level", "slowest"}
        assert case.event_kind.values[-1] == "slowest"
        assert np.linalg.norm(case.omega[-1]) == pytest.approx(0.6, rel=1e-9)
        assert case.time.values[-1] == case.event_time.values[-1] < 60
        assert {*case.enclosed_axis.values.tolist()} == {1}
    assert data["all"].status.values.tolist() == [0, 0]
    # A method of SciPy's would pass the end.
    (folder / "b.yaml").write_text(CONFIG.replace("drag: 0.1", "drag: 0.1, method: RK45"), "utf-8")
    done = hodo("--models", "drag.py", "run", "b.yaml")
    assert done.returncode == 2
    assert "one.method: RK45 finds no stop: method auto, taylor or collocation" in done.stderr


def test_crossings_are_found_in_single_cases_and_sweeps_by_any_method(hodo, folder):
    """By a method of SciPy's too: at zeros of D along its steps, with errors."""
    text = EXAMPLE.replace("k.c * w * p", "20 * k.c * w * p")
    (folder / "drag.py").write_text(text, encoding="utf-8")
    keys = "model: quadratic-drag, drag: 0.02, time: {end: 20}, initial: {p: 0.8, q: 0.5, r: 0.5}"
    sweep = "sweep: {drag: {values: [0.01, 0.02]}}"
    cases = "".join(
        f"  {name}-{kind}: {{{keys}, {more}, method: {method}}}\n"
        for name, method in (("judged", "DOP853, tol: 1e-6"), ("best", "collocation, error: off"))
        for kind, more in (("case", "note: one"), ("sweep", sweep))
    )
    (folder / "a.yaml").write_text(CONFIG.partition("  one:")[0] + cases, encoding="utf-8")
    run(hodo, "drag.py")
    data = hodo_cli.open(folder / "runs" / "a.h5")
    judged, best = (data[f"{name}-sweep"] for name in ("judged", "best"))
    assert judged.crossings.values.tolist() == best.crossings.values.tolist() == [1, 1]
    off = np.abs(judged.crossing_time.values - best.crossing_time.values)
    assert judged.attrs["crossing_error_quantiles"][-1] == pytest.approx(off.max(), rel=0.05)
    judged, best = (data[f"{name}-case"] for name in ("judged", "best"))
    ((time,), (true,)) = judged.crossing_time.values, best.crossing_time.values
    assert judged.crossing_error.values[0] == pytest.approx(abs(time - true), rel=0.05)
    assert true == pytest.approx(float(data["best-sweep"].crossing_time[1]), rel=1e-12)


@pytest.mark.heyoka
def test_its_powers_keep_their_digits_where_a_component_passes_zero(hodo, folder):
    """The squares of the example, side by side, against the same drag of `torques`."""
    text = (
        "defaults: {inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}, tol: 1e-12,\n"
        "           time: {end: 1000}, sweep: {initial.p: {linspace: [0.5, 0.8, 8]}}}\n"
        "cases: {a: {model: quadratic-drag, drag: 0.001}}\n"
    )
    (folder / "a.yaml").write_text(text)
    (folder / "b.yaml").write_text(text.replace("quadratic-drag, drag", "torques, quadratic"))
    run(hodo, "drag.py", "run")
    assert hodo("run", "b.yaml").returncode == 0
    with h5py.File(folder / "runs" / "a.h5") as own, h5py.File(folder / "runs" / "b.h5") as known:
        assert own["a"].attrs["method_reason"].startswith("side by side")
        assert abs(own["a/omega"][:] - known["a/omega"][:]).max() <= 1e-10
        assert own["a"].attrs["error"] <= 1e-10


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, ":1: FileNotFoundError: "),
        ("x = 1\ny = (\n", ":2: SyntaxError: '(' was never closed"),
        ("x = 1\nraise ValueError('no\\nno')\n", ":2: ValueError: no"),
        ("x = 1\nexit(0)\n", ":2: SystemExit: 0"),
        ("x = 1\n", ": there is no model in it (a class with `name` and `form`)"),
        ("from hodo_cli.models.body import Tensor\n", ": there is no model in it (a class with"),
        (EXAMPLE.replace('"quadratic-drag"', '"linear-diag"'),
         ": QuadraticDrag: there is already a model 'linear-diag'"),
        (EXAMPLE.replace("    drag: float\n", ""), ": QuadraticDrag: expected a field for each of"),
        (EXAMPLE.replace("@dataclass(frozen=True)\n", ""),
         ": QuadraticDrag: expected a frozen dataclass"),
        (EXAMPLE.replace("drag", "momentum"),
         ": QuadraticDrag: its key momentum is an attribute of BodyFrame: name it otherwise"),
    ],
)  # fmt: skip
def test_a_bad_file_is_one_line(hodo: Hodo, folder: Path, text: str | None, said: str) -> None:
    if text is not None:
        (folder / "bad.py").write_text(text, encoding="utf-8")
    done = hodo("--models", "bad.py", "schema")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{folder / 'bad.py'}{said}")
    assert done.stderr.count("\n") == 1


BEFORE = "    @cached_property"  # where the example goes on after its rhs
EQUATION_MISTAKES = [
    ("k.c * w * q", "kk.c * w * q", ":28: NameError: name 'kk' is not defined"),
    ("k.c * w * q", "k.d * w * q", ":28: AttributeError: 'types.SimpleNamespace' object has"),
    ("self.drag}", "self.drug}", ":34: AttributeError: 'QuadraticDrag' object has no"),
    ("return (\n", "return (\n0,", ": rhs has the size 4, expected 3"),
    ("w = (p**2", "w = __import__('math').sqrt(p**2", ":25: TypeError: must be real number"),
    ("w = (p**2", "w = __import__('numpy').exp(p**2", ":25: TypeError: operand 'Symbol'"),
    ("w = (p**2", "exit(0)\n        w = (p**2", ":25: SystemExit: 0"),
    ("k.c * w * q", "1j * w * q", ":1: TypeError: "),
    ("self.drag}", "self.drag * 1j}", ":1: TypeError: "),
    ("w = (p**2", "w = abs(p**2", ":25: TypeError: bad operand type for abs()"),
    ("w = (p**2", "w = p if p > 0 else q\n        w = (p**2", ":25: TypeError: '>' not"),
    ("w = (p**2", "w = p if p else q\n        w = (p**2", ":25: TypeError: "),
    ("w = (p**2", "w = 2**p * (p**2", ":25: TypeError: unsupported operand type(s) for **"),
    ("p, q, r = y", "y[0] = p = y[1]; q, r = y[1:]", ":24: TypeError: 'tuple' object does not"),
    ("def rhs(t, y, k)", "def rates(t, y, k)", ":1: NotImplementedError: the model states no"),
    ('"c": self', '"time_unit": 1.0, "c": self', ": the constant time_unit is an engine's"),
    (BEFORE,
     "    @staticmethod\n    def output(t, y, k):\n        return {'omega': y[:, :2]}\n\n" + BEFORE,
     ": omega has the size (2, 2), expected (2, 3)"),
    (BEFORE, f"    start = (1.0, 2.0)\n\n{BEFORE}", ":24: ValueError: not enough values to unpack"),
    (BEFORE,
     "    @property\n    def run_events(self):\n        e = __import__('hodo_cli').models\n"
     "        return (e.base.Event('level', lambda t, y, k: 1 if y[2] > 0 else 0),)\n\n" + BEFORE,
     ":35: TypeError: '>' not supported"),
]  # fmt: skip
"""What stands in the example, what in its place, and what is said of that."""


def test_mistakes_in_equations_are_one_line_each_before_the_run(hodo: Hodo, folder: Path) -> None:
    cases, options = "", list[str]()
    for i, (right, wrong, _) in enumerate(EQUATION_MISTAKES):
        assert right in EXAMPLE
        text = EXAMPLE.replace(right, wrong).replace("quadratic-drag", f"bad{i}")
        (folder / f"bad{i}.py").write_text(text, encoding="utf-8")
        cases += f"  case{i}: {{model: bad{i}, drag: 0.1}}\n"
        options += ["--models", f"bad{i}.py"]
    (folder / "a.yaml").write_text(CONFIG.partition("  one:")[0] + cases, encoding="utf-8")
    done = hodo(*options, "run", "a.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert not (folder / "runs").exists()
    lines = done.stderr.splitlines()
    for i, ((_, _, said), line) in enumerate(zip(EQUATION_MISTAKES, lines, strict=True)):
        assert f"cases.case{i}.model: {folder / f'bad{i}.py'}{said}" in line


# A model with a law of time, by every engine, against a series in integers.

TIMED = ROOT / "tests" / "own_models" / "timed.py"
LAWS = ["falling", "polynomial", "exponential"]


def random_body(seed: int, torques: bool) -> dict[str, Any]:
    """A random body that turns some times a unit of time, under a slower law."""
    draw = random.Random(seed)
    moments = [draw.uniform(0.55, 1) for _ in range(3)]
    return {
        "inertia": moments,
        "damping": [draw.uniform(0, 0.02) for _ in range(3)],
        "torque": draw.uniform(-0.01, 0.01) * torques,
        "force": draw.uniform(-0.01, 0.01) * torques,
        "rate": draw.uniform(0.01, 0.03),
        "law": LAWS[seed % len(LAWS)],
        "initial": {name: draw.uniform(-1, 1) for name in "pqr"},
        "time": {"start": draw.choice([0.0, draw.uniform(0, 200)])},
    }


def scaled(body: dict[str, Any], size: int, **others: Any) -> dict[str, Any]:
    """The same motion 2**size times as fast: its data change by powers of two, exactly."""
    s = 2.0**size
    return {
        "model": "timed",
        **body,
        "damping": [x * s for x in body["damping"]],
        **{name: body[name] * s * s for name in ("torque", "force")},
        "rate": body["rate"] * s,
        "initial": {name: x * s for name, x in body["initial"].items()},
        "time": {name: x if name == "samples" else x / s for name, x in body["time"].items()},
        **others,
    }


KNOWN = json.loads((ROOT / "tests" / "data" / "own_time.json").read_text("utf-8"))
"""omega and gamma (6,) at the second and the third sample of each motion, in 160 bits."""

SIZES = [0, 3, 7]
BOUNDS = {
    ("taylor", "double"): 3e-13,
    ("taylor", "extended"): 1e-15,
    ("collocation", "double"): 3e-13,
    ("collocation", "extended"): 1e-15,
    ("DOP853", "double"): 1e-9,
    ("Radau", "double"): 1e-4,
}
"""What each method is right to, by its precision."""


def seeds(method: str, precision: str) -> Iterator[tuple[int, int]]:
    """Those of its motions, and their sizes: each method meets each size."""
    first = [*BOUNDS].index((method, precision))
    for seed in range(3 if have_taylor() else 1):
        yield seed, SIZES[(seed + first) % len(SIZES)]


def ruled(method: str, seed: int) -> dict[str, Any]:
    """A body under a law of the time, also from a late start."""
    body = random_body(seed, torques=seed % 2 == 0)
    is_slow = method in ("collocation", "Radau") or not have_taylor()
    span = random.Random(seed).uniform(3, 6 if is_slow else 30)
    body["time"] |= {"end": body["time"]["start"] + span, "samples": 3}
    return body


def timed_cases() -> Iterator[tuple[str, dict[str, Any]]]:
    """All that is tried, by method, precision and seed."""
    for method, precision in BOUNDS:
        for seed, size in seeds(method, precision):
            options = {"method": method, "precision": precision}
            yield f"{method}-{precision}-{seed}", scaled(ruled(method, seed), size, **options)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Iterator[h5py.File]:
    """The motions, integrated as a user does it."""
    folder = tmp_path_factory.mktemp("timed")
    given = {name: case for name, case in timed_cases() if have_taylor() or name[:6] != "taylor"}
    (folder / "a.yaml").write_text(json.dumps({"cases": given}), encoding="utf-8")
    done = run_hodo(folder, "--models", TIMED, "run", "a.yaml")
    assert done.returncode == 0, done.stderr
    assert "invalid value" not in done.stderr
    with h5py.File(folder / "runs" / "a.h5") as file:
        yield file


@pytest.mark.parametrize(
    ("method", "precision"),
    [pytest.param(*key, marks=[pytest.mark.heyoka] * (key[0] == "taylor")) for key in BOUNDS],
)
def test_a_law_of_time_is_that_of_the_case(result: h5py.File, method: str, precision: str) -> None:
    """To the bound of the method, and to the stated error."""
    bound = BOUNDS[method, precision]
    for seed, size in seeds(method, precision):
        name = f"{method}-{precision}-{seed}"
        motion, right = result[name], np.array(KNOWN[name])
        assert motion.attrs["status"] == "ok"
        for name, columns in (("omega", slice(3)), ("gamma", slice(3, 6))):
            unit = 2.0**size if name == "omega" else 1
            seen, states = motion[name][1:] / unit, right[:, columns]
            off = np.linalg.norm(seen - states, axis=1) / np.linalg.norm(states, axis=1)
            assert off.max() < min(bound, 4 * motion[name].attrs["error"] + 2e-15), (seed, name)
