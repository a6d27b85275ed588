"""Models that are not hodo's: the example of the documents in a file, and in a package."""

import json
import math
import os
import re
from functools import partial
from itertools import product
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import ROOT, Hodo, call_apart
from scipy.spatial.transform import Rotation
from test_docs import snippets

import hodo_cli

EXAMPLE = next(text for text in snippets("docs/models.md", "python") if "class " in text)
CONFIG = """\
defaults: {inertia: [1, 0.8, 0.6], time: {end: 10, samples: 3},
           initial: {p: 0.8, q: 0.5, r: 0.74}}
cases:
  one: {model: quadratic-drag, drag: 0.1}
  two: {model: quadratic-drag, drag: 0.2}
  swept: {model: quadratic-drag, drag: 0.2, error: off, sweep: {drag: {values: [0, 0.1]}}}
  known: {model: linear-diag}
"""


@pytest.fixture
def hodo(tmp_path: Path) -> Hodo:
    return partial(call_apart, tmp_path)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "drag.py").write_text(EXAMPLE, encoding="utf-8")
    (tmp_path / "a.yaml").write_text(CONFIG, encoding="utf-8")
    return tmp_path


def test_a_model_of_ones_own_runs_in_processes_and_is_hashed(hodo: Hodo, folder: Path) -> None:
    """It slows the body, its members run too, and only its own cases depend on its source."""
    done = hodo("--models", "drag.py", "run", "a.yaml", "-j", "2")
    assert done.returncode == 0, done.stderr
    assert hodo("--models", "drag.py", "classify", "runs/a.h5").returncode == 0
    with h5py.File(folder / "runs" / "a.h5") as file:
        speeds = [sum(file[name]["omega"][-1] ** 2) for name in ("known", "one", "two")]
        assert speeds[0] > speeds[1] > speeds[2] > 0
        assert list(file["swept/status"]) == [0, 0]
    stored = hodo_cli.open(folder / "runs" / "a.h5")
    assert stored["swept"]["drag"].values.tolist() == [0, 0.1]
    assert {name: [*stored[name].coords] for name in ("one", "swept")} == {
        "one": ["time", "axis"],
        "swept": ["drag", "axis"],
    }
    # To run it, the file has to be named; what is stored can be shown without.
    assert hodo("show", "runs/a.h5").returncode == 0
    assert "got 'quadratic-drag' (from a file of your own: hodo --models" in hodo("run", "a").stderr
    planned = hodo("--models", "drag.py", "run", "a.yaml", "--dry-run").stdout
    assert planned.count("is kept") == 4
    (folder / "drag.py").write_text(EXAMPLE + "CHANGED = True\n", encoding="utf-8")
    lines = hodo("--models", "drag.py", "run", "a.yaml", "--dry-run").stdout.splitlines()
    changed = [line for line in lines if "the code that computes it has changed" in line]
    assert [line.split(":")[0] for line in changed] == ["one", "two", "swept"]
    # What is stored is shown, with a word that it is of the file as it was.
    for command in ("show", "plot", "claims", "classify"):
        assert "changed since its run: drag.py" in hodo("--models", "drag.py", command, "a").stderr
        assert "since" not in hodo(command, "a").stderr


def test_a_result_is_shown_and_drawn_without_naming_its_model_again(
    hodo: Hodo, folder: Path
) -> None:
    assert hodo("--models", "drag.py", "run", "a.yaml").returncode == 0
    # As it was when the result was made, whatever becomes of the file.
    (folder / "drag.py").write_text("raise SystemExit(7)")
    assert hodo("merge", "a.yaml", "--out", "b.h5").returncode == 0
    for command, name in product(("show", "classify", "plot"), ("a.yaml", "b.h5")):
        done = hodo(command, name)
        assert done.returncode == 0, done.stderr
    # A result may name no file that the user has not once named himself.
    with h5py.File(folder / "runs" / "a.h5", "a") as file:
        del file.attrs["checksum"]  # as a stranger's file has none
        file.attrs["own_models"] = f"{folder / 'drag.py'}\n../models/../secret"
    done = hodo("plot", "runs/a.h5")
    assert done.returncode == 2
    assert "got 'quadratic-drag' (from a file of your own: hodo --models" in done.stderr
    # In Python too it is read without; what computes with the model says how to name it.
    swept = hodo_cli.open(folder / "b.h5")["swept"]
    curve = {"kind": "curve", "variable": "crossings", "x": "drag"}
    for use in (lambda: hodo_cli.derive(swept, "T"), lambda: hodo_cli.plot(swept, **curve)):
        with pytest.raises(hodo_cli.HodoError, match=r"in Python HODO_MODELS=FILE\.py before it"):
            use()


def test_the_schema_has_it_and_the_environment_names_it(hodo: Hodo, folder: Path) -> None:
    assert "quadratic-drag" not in hodo("schema").stdout
    schema = hodo("--models", "drag.py", "schema").stdout
    assert "quadratic-drag" in json.dumps(json.loads(schema))
    assert hodo("schema", env={**os.environ, "HODO_MODELS": "drag.py"}).stdout == schema
    assert "quadratic-drag" in hodo("--models", "drag.py", "schema", "--table").stdout


def test_only_a_class_with_a_form_and_a_name_is_one_that_cases_can_name(
    hodo: Hodo, folder: Path
) -> None:
    helpers = (
        "class Nameless(BodyFrame):\n    form = 'full'\nclass Below(QuadraticDrag):\n    pass\n"
    )
    (folder / "more.py").write_text(EXAMPLE + helpers, encoding="utf-8")
    done = hodo("--models", "more.py", "schema")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == hodo("--models", "drag.py", "schema").stdout


def test_a_package_names_its_models_as_entry_points(hodo: Hodo, folder: Path) -> None:
    site = folder / "site"
    info = site / "dragging-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: dragging\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[hodo.models]\ndrag = dragging\n")
    (site / "dragging.py").write_text(EXAMPLE, encoding="utf-8")
    known = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")]))
    installed = {**os.environ, "PYTHONPATH": known}
    done = hodo("run", "a.yaml", "-j", "2", env=installed)
    assert done.returncode == 0, done.stderr
    (site / "dragging.py").write_text(EXAMPLE + "CHANGED = True\n", encoding="utf-8")
    planned = hodo("run", "a.yaml", "--dry-run", env=installed).stdout
    assert planned.count("the code that computes it has changed") == 3
    (site / "dragging.py").write_text("import nothing_of_this_name\n")
    done = hodo("schema", env=installed)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("dragging (entry point drag): ModuleNotFoundError: No module")


HELPER = "def drag(k, w):\n    return k.c * w\n"


def with_helper(folder: Path) -> None:
    """The example, with a factor from a file beside it."""
    helped = EXAMPLE.replace("k.c * w *", "drag(k, w) *")
    (folder / "drag.py").write_text(f"from laws.drag import drag\n{helped}", encoding="utf-8")
    (folder / "laws").mkdir()
    (folder / "laws" / "__init__.py").touch()
    (folder / "laws" / "drag.py").write_text(HELPER, encoding="utf-8")
    (folder / "other.py").write_text("not imported = 1", encoding="utf-8")


def test_what_a_model_imports_from_its_folder_is_stored_and_hashed(
    hodo: Hodo, folder: Path
) -> None:
    with_helper(folder)
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    run = ("--models", folder / "drag.py", "run", "../a.yaml", "--out", "../runs")
    done = hodo(*run, "-j", "2", cwd=elsewhere)
    assert done.returncode == 0, done.stderr
    with h5py.File(folder / "runs" / "a.h5") as file:
        for name in ("one", "swept"):
            source = file[name].attrs["model_source"]
            assert source.index("class QuadraticDrag") < source.index("# laws/drag.py\n" + HELPER)
            assert "other" not in source
        assert "model_source" not in file["known"].attrs
    assert hodo(*run, "--dry-run", cwd=elsewhere).stdout.count("is kept") == 4
    (folder / "laws" / "drag.py").write_text(HELPER.replace("k.c", "2 * k.c"), encoding="utf-8")
    planned = hodo(*run, "--dry-run", cwd=elsewhere).stdout
    assert planned.count("the code that computes it has changed") == 3


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("def drag(k, w):\n    return k.e * w\n", ":2: there is no constant 'e'"),
        ("def drag(k, w:\n    return 1\n", ":1: '(' was never closed"),
        ("raise ValueError('no')", ":1: ValueError: no"),
        ("from math import sin\ndef drag(k, w):\n    return sin(w)", ":3: TypeError: must be real"),
    ],
)
def test_a_mistake_in_what_it_imports_is_named_there(
    hodo: Hodo, folder: Path, wrong: str, said: str
) -> None:
    with_helper(folder)
    (folder / "laws" / "drag.py").write_text(wrong, encoding="utf-8")
    done = hodo("--models", "drag.py", "run", "a.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert f"{folder / 'laws' / 'drag.py'}{said}" in done.stderr.splitlines()[0]


FIVE = (
    EXAMPLE.replace("p, q, r = y", "p, q, r, s, c = y")
    .replace("- k.c * w * r,", "- k.c * w * r * (2 + s) / 2, k.v * c, -k.v * s,")
    .replace('"c": 2,', '"c": 2, "v": 1,')
    .replace('"c": self.drag}', '"c": self.drag, "v": 0.7}')
    .replace(
        "    @staticmethod",
        """    state = ("p", "q", "r", "s", "c")
    state_degree = {"s": 0, "c": 0}
    variables = BodyFrame.variables | {"s": Label(("time",), "sine of the phase")}

    @property
    def start(self):
        return (*super().start, 0.0, super().start[0] / 0.8)

    @staticmethod""",
    )
)
"""The example with two more variables of the state, one of which is stored."""


def test_a_state_may_hold_more_than_the_velocity(hodo: Hodo, folder: Path) -> None:
    """From its run to its pictures, by itself and in sweeps."""
    label = "from hodo_cli.models.base import Label\n"
    (folder / "five.py").write_text(label + FIVE, encoding="utf-8")
    random = "sweep: {d: {sphere: {count: 5, seed: 1}}}"
    starts = f"  starts: {{model: quadratic-drag, drag: 0.2, {random}}}\n"
    figures = """figures:
  path: {kind: hodograph, cases: [one]}
  phase: {kind: series, cases: [one, two], variables: [s, omega.x1]}
"""
    (folder / "a.yaml").write_text(CONFIG + starts + figures, encoding="utf-8")
    for command in (["run", "a.yaml"], ["classify", "runs/a.h5"], ["plot", "runs/a.h5"]):
        done = hodo("--models", "five.py", *command)
        assert done.returncode == 0, done.stderr
    with h5py.File(folder / "runs" / "a.h5") as file:
        assert file["one/omega"].shape == (3, 3)
        assert file["one/s"].shape == (3,)
        assert file["one/s"][-1] == pytest.approx(math.sin(7), abs=1e-12)
        assert list(file["starts/status"]) == [0] * 5
        # The cosine starts with p/0.8, another one of each member.
        p = math.hypot(0.8, 0.4, 0.444) * file["starts/d_vector"][:, 0]
        assert file["starts/s"][:] == pytest.approx(p * math.sin(7) / 0.8, abs=1e-12)
    assert {path.name for path in (folder / "runs" / "figures" / "a").glob("*.png")} == {
        "path.png",
        "phase.png",
    }


WITH_EVENT = """
    @property
    def run_events(self):
        return (Event("half", lambda t, y, k: t - 5.5, terminal=ENDS),)
"""


@pytest.mark.heyoka
@pytest.mark.parametrize("ends", [False, True])
def test_a_motion_has_labels_until_its_end_and_beyond_an_event_that_does_not_end_it(
    hodo: Hodo, folder: Path, ends: bool
) -> None:
    """Of a case the last sample is that of the event which ends it, of a member the share."""
    event = "from hodo_cli.models.base import Event\n"
    text = event + EXAMPLE + WITH_EVENT.replace("ENDS", str(ends))
    (folder / "drag.py").write_text(text, encoding="utf-8")
    swept = "store: [share], sweep: {drag: {values: [0, 0.1]}}"
    config = f"{CONFIG}  shares: {{model: quadratic-drag, drag: 0.2, {swept}}}\n"
    (folder / "a.yaml").write_text(config, encoding="utf-8")
    for command in (["run", "a.yaml"], ["classify", "runs/a.h5"]):
        done = hodo("--models", "drag.py", *command)
        assert done.returncode == 0, done.stderr
    with h5py.File(folder / "runs" / "a.h5") as file:
        assert list(file["one/enclosed_axis"]) == [1] * 3
        assert file["one/time"][-1] == pytest.approx(5.5 if ends else 10, rel=1e-12)
        share = 0.55 if ends else 1
        assert file["shares/share"][:].sum(1) == pytest.approx([share] * 2, rel=1e-12)


APPROXIMATE = (
    EXAMPLE.replace("    drag: float\n", "    drag: float\n    terms: int\n")
    .replace(
        '        "initial"', '        "terms": Key(Integer(), "of a series"),\n        "initial"'
    )
    .replace("import Key, Number", "import Integer, Key, Number")
    .replace('"c": self.drag', '"c": self.drag * (1 - 0.5**self.terms), "rest": 0.5**self.terms')
    .replace('"c": 2,', '"c": 2, "rest": 0,')
    + """
    @property
    def refined_data(self):
        return {"terms": 2 * self.terms}

    @staticmethod
    def is_accurate(y, k, tol):
        return y[0] * 0 + k.rest <= tol
"""
)
COARSE_AND_FINE = """\
defaults: {model: quadratic-drag, drag: 0.005, inertia: [1, 0.8, 0.6],
           initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 150, samples: 51}}
cases:
  coarse: {terms: 15, METHOD}
  fine: {terms: 60, METHOD}
  coarse-steps: {terms: 15, METHOD, time: {end: 150, steps: yes}}
  fine-steps: {terms: 60, METHOD, time: {end: 150, steps: yes}}
"""


# What a model of one's own stores serves in statements and formulas as it does in figures.
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
    """Of Kovalevskaya's body, T + L.z, G.z and her own; the vertical is where the quaternion has
    it, of members with random starts too, and a member of a sweep over the tilt is the single
    case."""
    source, config = (
        next(text for text in snippets("docs/models.md", language) if word in text)
        for language, word in (("python", "class Heavy"), ("yaml", "model: heavy"))
    )
    (tmp_path / "heavy.py").write_text(source, encoding="utf-8")
    body = config.removeprefix("cases:\n")
    tilts = "    sweep: {attitude.euler.1: {values: [0.3, 1.0471975511965976]}}\n"
    swept = body.replace("kovalevskaya", "swept") + tilts
    ball = "    store: [trajectory]\n    sweep: {d: {sphere: {count: 5, seed: 1}}}\n"
    swept += body.replace("kovalevskaya", "random").replace("end: 50", "end: 5, samples: 3") + ball
    (tmp_path / "a.yaml").write_text(f"cases:\n{body}{swept}{OF_HEAVY}", encoding="utf-8")
    commands = ["--models heavy.py run a.yaml", "claims runs/a.h5", "plot runs/a.h5"]
    for command in commands:
        done = hodo(*command.split())
        assert done.returncode == 0, done.stdout + done.stderr
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
    assert np.abs(last.omega.values - [p[-1], q[-1], r[-1]]).max() < 1e-11


@pytest.mark.engines
@pytest.mark.parametrize("method", ["auto", pytest.param("DOP853", marks=pytest.mark.heyoka)])
def test_labels_and_steps_are_those_of_the_refined_equations(
    hodo: Hodo, folder: Path, method: str
) -> None:
    """A motion is refined whatever looks at its steps besides."""
    (folder / "drag.py").write_text(APPROXIMATE, encoding="utf-8")
    text = COARSE_AND_FINE.replace("METHOD", f"method: {method}")
    (folder / "a.yaml").write_text(text, encoding="utf-8")
    for command in (["run", "a.yaml"], ["classify", "a.yaml"]):
        done = hodo("--models", "drag.py", *command)
        assert done.returncode == 0, done.stderr
    with h5py.File(folder / "runs" / "a.h5") as file:
        for end in ("", "-steps"):
            coarse, fine = file["coarse" + end], file["fine" + end]
            assert coarse["time"][:] == pytest.approx(fine["time"][:], rel=1e-6)
            assert coarse["omega"][-1] == pytest.approx(fine["omega"][-1], rel=1e-7)
            assert list(coarse["enclosed_axis"]) == list(fine["enclosed_axis"])
        assert len(file["coarse-steps/time"]) == file["coarse-steps"].attrs["steps"] + 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, ": no such file or directory"),
        ("x = 1\ny = (\n", ":2: '(' was never closed"),
        ("x = 1\nraise ValueError('no\\nno')\n", ":2: ValueError: no"),
        ("x = 1\nexit(0)\n", ":2: exit(0) would end hodo: raise an error instead"),
        ("x = 1\n", ": there is no model in it (a class with `name` and `form`)"),
        ("from hodo_cli.models.tensor import Tensor\n", ": there is no model in it (a class with"),
        (
            EXAMPLE.replace('"quadratic-drag"', '"linear-diag"'),
            ": there is already a model 'linear-diag' with the form 'full'",
        ),
    ],
)
def test_a_bad_file_is_one_line(hodo: Hodo, folder: Path, text: str | None, said: str) -> None:
    if text is not None:
        (folder / "bad.py").write_text(text, encoding="utf-8")
    for command in (["schema"], ["run", ROOT / "configs" / "paper1.yaml", "--dry-run"]):
        done = hodo("--models", "bad.py", *command)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(f"{folder / 'bad.py'}{said}")
        assert done.stderr.count("\n") == 1


def test_keys_of_a_model_that_is_not_there_are_no_mistakes_of_their_own(
    hodo: Hodo, folder: Path
) -> None:
    assert hodo("--models", "drag.py", "run", "a.yaml").returncode == 0
    for command in (("run", "a.yaml"), ("classify", "runs/a.h5")):
        elsewhere = {**os.environ, "XDG_STATE_HOME": str(folder)}  # where no model has been named
        lines = hodo(*command, env=elsewhere).stderr.splitlines()
        assert lines
        assert all("expected" in line and "hodo --models FILE.py" in line for line in lines)
    # A typo in the word itself leaves a case without a model.
    (folder / "b.yaml").write_text("cases: {a: {modle: tensor, nodes: 3, x: 1}}", encoding="utf-8")
    said = hodo("run", "b.yaml").stderr
    assert "did you mean 'model'?" in said
    assert "cases.a.x: unknown key" in said


@pytest.mark.engines
def test_its_equations_may_have_functions(hodo: Hodo, folder: Path) -> None:
    """By every method, averaged and in sweeps: functions that amount to the example's own root."""
    root = "w = (p**2 + q**2 + r**2) ** 0.5"
    functions = "w = exp(log(p**2 + q**2 + r**2) / 2) * (sin(q) ** 2 + sqrt(cos(q) ** 4))"
    assert root in EXAMPLE
    imported = "from hodo_cli.arithmetic import cos, exp, log, sin, sqrt\n"
    (folder / "f.py").write_text(imported + EXAMPLE.replace(root, functions), encoding="utf-8")
    cases = "".join(
        f"  {name}: {{model: quadratic-drag, drag: 0.1, {keys}}}\n"
        for name, keys in {
            "auto": "error: on",
            "collocation": "error: off, method: collocation",
            "DOP853": "error: off, method: DOP853, tol: 1e-12",
            "averaged": "error: off, form: averaged",
            "swept": "error: off, sweep: {drag: {values: [0, 0.1]}}",
        }.items()
    )
    (folder / "a.yaml").write_text(CONFIG.partition("  one:")[0] + cases, encoding="utf-8")
    for models, out in (("drag.py", "plain"), ("f.py", "functions")):
        done = hodo("--models", models, "run", "a.yaml", "--out", out)
        assert done.returncode == 0, done.stderr
    compared = hodo("--models", "f.py", "compare", "plain/a.h5", "functions/a.h5", "--rtol", "1e-9")
    assert compared.returncode == 0, compared.stdout


@pytest.mark.parametrize("degree", [0, 1, 2, None])
def test_a_frequency_beside_the_time_has_no_degree(
    hodo: Hodo, folder: Path, degree: int | None
) -> None:
    """The time of rhs is the case's own in all units, and so is a frequency then."""
    text = EXAMPLE.replace("- k.c * w * r", "- k.c * w * r * (1 + sin(k.n * t) / 2)")
    text = text.replace('"c": self.drag', '"c": self.drag, "n": 0.7')
    if degree is not None:
        text = text.replace('"c": 2,', f'"c": 2, "n": {degree},')
    (folder / "drag.py").write_text("from hodo_cli.functions import sin\n" + text)
    done = hodo("--models", "drag.py", "run", "a.yaml", "--case", "one")
    assert done.returncode == (0 if degree is None else 2)
    assert ("`degree` does not fit rhs" in done.stderr) == (degree is not None)


SUMS = EXAMPLE.replace(
    '"c": self.drag}',
    """"c": self.drag, "v": 0.5}

    variables = BodyFrame.variables | {
        "excess": Label(("time",), "T less c"), "offset": Label(("time", "axis"), "omega less v")
    }

    @staticmethod
    def output(t, y, k):
        return {"omega": y, "excess": (y * y).sum(1) / 2 - k.c * t, "offset": y - k.v}""",
)
"""The example with stored variables that are not homogeneous in omega."""


@pytest.mark.engines
def test_the_error_of_a_sum_is_that_of_what_is_stored(hodo: Hodo, folder: Path) -> None:
    """Of terms that grow otherwise with omega, at every scale."""
    text = "from hodo_cli.models.base import Label\n" + SUMS
    (folder / "sums.py").write_text(text, encoding="utf-8")
    scales = [1, 2**-10, 2**10, 2**-500]
    cases = "".join(
        f"  s{i}{method}: {{model: quadratic-drag, {keys}, drag: 0.1, inertia: [1, 0.8, 0.6],\n"
        f"       time: {{end: {20 / s}, samples: 5}},\n"
        f"       initial: {{p: {0.8 * s}, q: {0.5 * s}, r: {0.74 * s}}}}}\n"
        for i, s in enumerate(scales)
        for method, keys in (("", "method: RK45, tol: 1e-5"), ("best", "error: off"))
    )
    (folder / "a.yaml").write_text(f"cases:\n{cases}", encoding="utf-8")
    done = hodo("--models", "sums.py", "run", "a.yaml")
    assert done.returncode == 0, done.stderr
    data = hodo_cli.open(folder / "runs" / "a.h5")
    for i in range(len(scales)):
        for name in ("omega", "excess", "offset") if i < 3 else ("omega", "excess"):
            seen, better = (data[f"s{i}{method}"][name].values for method in ("", "best"))
            size = np.abs(better).max() if better.ndim == 1 else np.linalg.norm(better, axis=1)
            off = np.abs(seen - better) if seen.ndim == 1 else np.linalg.norm(seen - better, axis=1)
            stated = data[f"s{i}"][name].attrs["error"]
            assert stated == pytest.approx((off / size).max(), rel=1e-3, abs=1e-15), (i, name)


@pytest.mark.engines
@pytest.mark.engines
def test_a_torque_without_a_value_at_zero_gives_no_warning(hodo: Hodo, folder: Path) -> None:
    """Where a component of omega is 0, as those of rotation about an axis are."""
    text = EXAMPLE.replace("k.c * w * p", "k.c * w * p * sqrt(p * p) / sqrt(p * p)")
    text = f"from hodo_cli.functions import sqrt\n{text}"
    (folder / "drag.py").write_text(text, encoding="utf-8")
    strict = {**os.environ, "PYTHONWARNINGS": "error::RuntimeWarning"}
    for command in (["run", "a.yaml", "--case", "one"], ["classify", "a.yaml"]):
        done = hodo("--models", "drag.py", *command, env=strict)
        assert (done.returncode, "Warning" in done.stderr) == (0, False), done.stderr


@pytest.mark.heyoka
@pytest.mark.parametrize(
    "size",
    [
        "sqrt(p * p)",
        "(p * q / q * p) ** 0.5",
        "sqrt(sqrt(p**4))",
        "sum([p * p]) ** 0.5",
        "sqrt(0.36 * p**2 + 0.64 * p * p)",
        "exp(log(p * p) / 2)",
        "sqrt(p * p - 2 * p * r / 99 + r * r / 9801)",
    ],
)
def test_a_corner_is_seen_that_no_member_drawn_at_random_comes_to(
    size: str, hodo: Hodo, folder: Path
) -> None:
    """As of a formula in a case file: only the equations tell it."""
    imports = "from hodo_cli.functions import exp, log, sqrt\n"
    text = imports + EXAMPLE.replace("k.c * w * p", f"k.c * {size} * p")
    (folder / "drag.py").write_text(text, "utf-8")
    drawn = np.random.default_rng(60).choice(60, 16, replace=False)
    odd = min({*range(60)} - {*drawn.tolist()})
    values = [0.05 if i == odd else 0.9 + i / 1000 for i in range(60)]  # about x3, where p turns
    keys = "model: quadratic-drag, drag: 0.02, inertia: [1, 0.8, 0.6], time: {end: 20}"
    (folder / "a.yaml").write_text(
        f"cases:\n  one: {{{keys}, initial: {{p: 0.05, q: 0.1, r: 0.6}}}}\n"
        f"  all: {{{keys}, initial: {{p: 1, q: 0.1, r: 0.6}}, error: off,\n"
        f"    sweep: {{initial.p: {{values: {values}}}}}}}\n",
        encoding="utf-8",
    )
    assert hodo("--models", "drag.py", "run", "a.yaml").returncode == 0
    with h5py.File(folder / "runs" / "a.h5") as file:
        assert np.abs(file["all/omega"][odd] - file["one/omega"][-1]).max() < 1e-13


def test_crossings_of_a_model_without_degrees_have_errors(hodo: Hodo, folder: Path) -> None:
    """In a sweep too."""
    start = EXAMPLE.index("    degree = {")
    text = EXAMPLE[:start] + EXAMPLE[EXAMPLE.index("}", start) :].partition("\n")[2]
    text = text.replace("k.c * w * p", "20 * k.c * w * p")
    (folder / "drag.py").write_text(text, encoding="utf-8")
    cases = "".join(
        f"  {name}: {{model: quadratic-drag, drag: 0, inertia: [1, 0.8, 0.6], {keys},\n"
        "    time: {end: 20}, sweep: {drag: {values: [0.01, 0.02]}},\n"
        "    initial: {p: 0.8, q: 0.5, r: 0.5}}\n"
        for name, keys in (("judged", "method: DOP853, tol: 1e-6"), ("best", "method: DOP853"))
    )
    (folder / "a.yaml").write_text(f"cases:\n{cases}", encoding="utf-8")
    done = hodo("--models", "drag.py", "run", "a.yaml")
    assert done.returncode == 0, done.stderr
    judged, best = (hodo_cli.open(folder / "runs" / "a.h5")[name] for name in ("judged", "best"))
    assert judged.crossings.values.tolist() == [1, 1]
    off = np.abs(judged.crossing_time.values - best.crossing_time.values)
    stated = judged.attrs["crossing_error_quantiles"][-1]
    assert stated == pytest.approx(off.max(), rel=0.05)


EVENTED = (
    "from hodo_cli.models.base import Event\n\n\n"
    "def level(t, y, k):\n    return y[2] - k.least / (1 + 0 * t)\n\n\n"
    "def middle(t, y, k):\n    return y[1]\n\n\n"
    "def slowest(t, y, k):\n    return y[0]**2 + y[1]**2 + y[2]**2 - k.slowest**2 * k.c / k.c\n\n\n"
    + EXAMPLE.replace(
        '"c": self.drag}',
        '"c": self.drag, "least": self.least, "slowest": self.slowest}\n\n    @property\n'
        "    def run_events(self):\n        return (Event('level', level), "
        "Event('middle', middle), Event('slowest', slowest, terminal=True))",
    )
    .replace("    drag: float\n", "    drag: float\n    least: float\n    slowest: float\n")
    .replace(
        '        "initial"',
        '        "least": Key(Number(), "r"),\n        "slowest": Key(Number(), "omega"),\n'
        '        "initial"',
    )
)
"""The example with an event at a value of r, one at 0, and an end at a value of |omega|."""


@pytest.mark.engines
@pytest.mark.parametrize("degree", ["", '"least": 1, "slowest": 1'])
@pytest.mark.parametrize("method", ["auto", "DOP853", "collocation"])
def test_an_event_at_a_level_is_that_of_the_case_at_every_scale(
    hodo: Hodo, folder: Path, method: str, degree: str
) -> None:
    """In the case's own units, with an attitude and without, whatever `degree` says of levels."""
    text = EVENTED.replace('"c": 2,', f'"c": 2, {degree}')
    (folder / "evented.py").write_text(text, encoding="utf-8")
    cases = "".join(
        f"  s{i}: {{model: quadratic-drag, method: {method}, drag: 0.05, inertia: [1, 0.8, 0.6],\n"
        f"       least: {0.75 * s}, slowest: {0.6 * s}, time: {{end: {60 / s}, samples: 5}},\n"
        f"       initial: {{p: {0.8 * s}, q: {0.5 * s}, r: {0.74 * s}}}, {attitude}}}\n"
        for i, (s, attitude) in enumerate([(1, ""), (2**-6, "attitude: yes"), (2**9, "")])
    )
    (folder / "a.yaml").write_text(f"cases:\n{cases}", encoding="utf-8")
    done = hodo("--models", "evented.py", "run", "a.yaml")
    assert done.returncode == 0, done.stderr
    data = hodo_cli.open(folder / "runs" / "a.h5")
    kinds = data["s0"].event_kind.values.tolist()
    assert {*kinds} == {"level", "middle", "slowest"}
    assert kinds[-1] == "slowest"
    assert np.linalg.norm(data["s0"].omega[-1]) == pytest.approx(0.6, rel=1e-9)
    for i, s in enumerate([1, 2**-6, 2**9]):
        assert data[f"s{i}"].event_kind.values.tolist() == kinds
        times = data[f"s{i}"].event_time.values * s
        assert times == pytest.approx(data["s0"].event_time.values, rel=1e-8)


@pytest.mark.engines
@pytest.mark.parametrize("method", ["auto", "collocation"])
def test_a_model_without_degrees_may_be_slow(hodo: Hodo, folder: Path, method: str) -> None:
    """At rates of radians a day its steps meet its equations as at those of radians a second."""
    text = re.sub(
        r"    degree = \{.*?\}[^\n]*\n", "", EXAMPLE.replace("k.g * ", ""), flags=re.DOTALL
    )
    (folder / "drag.py").write_text(text, encoding="utf-8")
    cases = "".join(
        f"  s{i}: {{model: quadratic-drag, drag: 0.05, inertia: [1, 0.8, 0.6], method: {method},\n"
        f"       initial: {{p: {0.8 * s}, q: {0.5 * s}, r: {0.74 * s}}},\n"
        f"       time: {{end: {60 / s}, samples: 5}}}}\n"
        for i, s in enumerate((1, 2**-8, 2**-20))
    )
    (folder / "a.yaml").write_text(f"cases:\n{cases}", encoding="utf-8")
    done = hodo("--models", "drag.py", "run", "a.yaml")
    assert done.returncode == 0, done.stderr
    data = hodo_cli.open(folder / "runs" / "a.h5")
    for i, s in enumerate((1, 2**-8, 2**-20)):
        assert data[f"s{i}"].attrs["steps"] <= data["s0"].attrs["steps"]
        omega = data[f"s{i}"].omega.values / s
        assert omega == pytest.approx(data["s0"].omega.values, abs=1e-12)


@pytest.mark.engines
def test_a_motion_that_an_event_ends_is_labelled_to_its_end(hodo: Hodo, folder: Path) -> None:
    """Whether samples stand near the end or not, and as a member of a sweep."""
    (folder / "evented.py").write_text(EVENTED, encoding="utf-8")
    given = "model: quadratic-drag, drag: 0.05, inertia: [1, 0.8, 0.6], least: 5, slowest: 0.6"
    start = "initial: {p: 0.8, q: 0.5, r: 0.74}"
    cases = "".join(
        f"  n{n}: {{{given}, {start}, time: {{end: 60, samples: {n}}}}}\n" for n in (3, 40, 2000)
    )
    swept = "time: {end: 60}, sweep: {drag: {values: [0.05, 0.1]}}"
    swept = f"  all: {{{given}, {start}, {swept}}}\n"
    (folder / "a.yaml").write_text(f"cases:\n{cases}{swept}", encoding="utf-8")
    for command in ("run", "classify"):
        done = hodo("--models", "evented.py", command, "a.yaml")
        assert done.returncode == 0, done.stderr
    data = hodo_cli.open(folder / "runs" / "a.h5")
    for n in (3, 40, 2000):
        case = data[f"n{n}"]
        assert case.time.values[-1] == case.event_time.values[-1] < 60
        assert set(case.enclosed_axis.values.tolist()) == {1}
    assert data["all"].status.values.tolist() == [0, 0]


@pytest.mark.heyoka
def test_its_powers_keep_their_digits_where_a_component_passes_zero(
    hodo: Hodo, folder: Path
) -> None:
    """The squares of the example, side by side, against the same drag of `torques`."""
    swept = "initial.p: {linspace: [0.5, 0.8, 8]}"
    (folder / "a.yaml").write_text(
        "defaults: {inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}, tol: 1e-12,\n"
        f"           time: {{end: 1000}}, sweep: {{{swept}}}}}\n"
        "cases: {a: {model: quadratic-drag, drag: 0.001}}\n"
    )
    (folder / "b.yaml").write_text(
        (folder / "a.yaml").read_text().replace("quadratic-drag, drag", "torques, quadratic")
    )
    assert hodo("--models", "drag.py", "run", "a.yaml").returncode == 0
    assert hodo("run", "b.yaml").returncode == 0
    with h5py.File(folder / "runs" / "a.h5") as own, h5py.File(folder / "runs" / "b.h5") as known:
        expected = known["a/omega"][:]
        assert abs(own["a/omega"][:] - expected).max() <= 1e-10
        assert own["a"].attrs["error"] <= 1e-10


def refusal_of(hodo: Hodo, folder: Path, right: str, wrong: str) -> list[str]:
    """The lines that a run is refused with, of the example with a mistake in it."""
    assert right in EXAMPLE
    (folder / "bad.py").write_text(EXAMPLE.replace(right, wrong), encoding="utf-8")
    done = hodo("--models", "bad.py", "run", "a.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert not (folder / "runs").exists()
    return done.stderr.splitlines()


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("k.c * w * q", "kk.c * w * q", ":32: NameError: name 'kk' is not defined"),
        (
            "k.c * w * q",
            "k.d * w * q",
            ":32: there is no constant 'd' (`constants` has: A1, A2, A3, g, c)",
        ),
        (
            "self.drag}",
            "self.drug}",
            ":38: AttributeError: 'QuadraticDrag' object has no attribute",
        ),
        ("return (\n", "return (\n0,", ": rhs gives 4 rates for 3 variables of the state"),
        ("w = (p**2", "w = __import__('math').sqrt(p**2", ":29: TypeError: must be real number"),
        ("w = (p**2", "w = __import__('numpy').exp(p**2", ":29: TypeError: operand 'Symbol'"),
        ("w = (p**2", "exit(0)\n        w = (p**2", ":29: exit(0) would end hodo: raise an error"),
        (
            "w = (p**2",
            "return 1, q, 1j\n        w = (p**2",
            ": rhs gives complex rates at the start",
        ),
        ("k.c * w * q", "1j * w * q", ":32: TypeError: a complex number is no coefficient"),
        ("self.drag}", "self.drag * 1j}", ": `constants` gives a complex 'c'"),
        ("w = (p**2", "w = abs(p**2", ":29: TypeError: bad operand type for abs()"),
        ("w = (p**2", "w = p if p > 0 else q\n        w = (p**2", ":29: TypeError: which of two"),
        (
            "    @cached_property",
            "    @staticmethod\n    def output(t, y, k):\n        return {'omega': y[:, :2]}\n\n"
            "    @cached_property",
            ": output gives omega of the shape (2, 2) for 2 times: expected (time, axis)",
        ),
        (
            "    @cached_property",
            "    @staticmethod\n    def output(t, y, k):\n        return {'w': y}\n\n"
            "    @cached_property",
            ": output gives w, but `variables` has: omega",
        ),
        (
            "    @cached_property",
            "    start = (1.0, 2.0)\n\n    @cached_property",
            ": start gives 2 numbers for 3 variables of the state",
        ),
        ('"c": 2,', '"cc": 2,', ": `degree` names 'cc', but `constants` has: A1, A2, A3, g, c"),
        (
            '"c": 2,',
            '"c": 1,',
            ": `degree` does not fit rhs: with the constants of other units it gives other rates "
            "of p, q, r",
        ),
        # A term that is 0 at the start shows its degree later.
        ("- k.c * w * r,", "- k.c * w * r + k.c * t * r,", ": `degree` does not fit rhs: with"),
        ("w = (p**2", "w = 2**p * (p**2", ":29: TypeError: unsupported operand type(s) for **"),
        ("p, q, r = y", "y[0] = p = y[1]; q, r = y[1:]", ":28: TypeError: 'tuple' object does not"),
        *(
            (
                "    @cached_property",
                f"    @property\n    def run_events(self):\n"
                f"        return (__import__('hodo_cli').models.base.Event('level', {event}),)\n\n"
                "    @cached_property",
                said,
            )
            for event, said in (
                ("lambda t, y, k: y[2] - k.levv", ":38: there is no constant 'levv' (`constants`"),
                ("lambda t, y, k: __import__('math').sin(y[2])", ":38: TypeError: must be real"),
                ("lambda t, y, k: 1 if y[2] > 0 else 0", ":38: TypeError: which of two"),
                ("lambda t, y, k: 0.5", ": the function of the event 'level' is the same at all"),
                ("lambda t, y, k: 0 * y[2]", ": the function of the event 'level' is the same"),
                ("lambda t, y, k: None", ":1: TypeError: float() argument must be"),
            )
        ),
        ("def rhs(t, y, k)", "def rates(t, y, k)", ": the model quadratic-drag states no rhs"),
    ],
)
def test_a_mistake_in_the_equations_is_one_line_before_the_run(
    hodo: Hodo, folder: Path, right: str, wrong: str, said: str
) -> None:
    first, *others = refusal_of(hodo, folder, right, wrong)
    assert f"model: {folder / 'bad.py'}{said}" in first
    assert all(line.startswith("a.yaml:") for line in others)


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("    drag: float\n", "", "only one of both: drag"),
        ("@dataclass(frozen=True)\n", "", "only one of both: drag"),
        ('name = "quadratic-drag"', "name = 5", "its name is no text: 5"),
        *(
            ("drag", name, f"key {name!r} is an attribute of {of}: name it otherwise")
            for name, of in (
                ("momentum", "BodyFrame"),
                ("start", "BodyFrame"),
                ("levels", "Model"),
            )
        ),
    ],
)
def test_what_a_class_states_wrongly_is_one_line(
    hodo: Hodo, folder: Path, right: str, wrong: str, said: str
) -> None:
    (line,) = refusal_of(hodo, folder, right, wrong)
    assert "bad.py: QuadraticDrag: " in line
    assert said in line


@pytest.mark.heyoka
def test_the_command_itself_computes_chunks_beside_one_process_less(
    hodo: Hodo, folder: Path
) -> None:
    note = "\nimport os\nwith open('processes', 'a') as file:\n    print(os.getpid(), file=file)\n"
    (folder / "drag.py").write_text(EXAMPLE + note, encoding="utf-8")
    case = "model: quadratic-drag, drag: 0.1, inertia: [1, 0.8, 0.6], time: {end: 1}, error: off"
    start, swept = "initial: {p: 1, q: 0, r: 1}", "sweep: {drag: {linspace: [0.1, 0.2, 50001]}}"
    text = f"cases: {{a: {{{case}, {start}, {swept}}}}}\n"
    (folder / "many.yaml").write_text(text, encoding="utf-8")
    done = hodo("--models", "drag.py", "run", "many.yaml", "-j", "3")
    assert done.returncode == 0, done.stderr
    assert len({*(folder / "processes").read_text().split()}) == 3
    with h5py.File(folder / "runs" / "many.h5") as file:
        assert not file["a/status"][:].any()


def test_what_processes_finish_waits_for_no_member_that_the_command_computes(
    hodo: Hodo, folder: Path
) -> None:
    """Members by themselves, which may take minutes, are left to two processes beside it."""
    note = "def note():\n    with open('pids', 'a') as file:\n        print(getpid(), file=file)\n"
    text = EXAMPLE.replace("    def constants(self):", "    def constants(self):\n        note()")
    (folder / "drag.py").write_text(f"from os import getpid\n{text}\n\n{note}", encoding="utf-8")
    case = "model: quadratic-drag, drag: 0.1, inertia: [1, 0.8, 0.6], time: {end: 1}, error: off"
    start, swept = "initial: {p: 1, q: 0, r: 1}", "sweep: {drag: {linspace: [0.1, 0.2, 320]}}"
    (folder / "many.yaml").write_text(
        f"cases: {{a: {{{case}, {start}, max_seconds: 60, {swept}}}}}\n", encoding="utf-8"
    )
    done = hodo("--models", "drag.py", "run", "many.yaml", "-j", "2")
    assert done.returncode == 0, done.stderr
    processes = (folder / "pids").read_text().split()
    assert len({*processes}) == 3
