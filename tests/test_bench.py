"""The bench: its verdicts, and what it stores, prints and draws."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Hodo, call

import hodo_cli
from hodo_cli.commands import bench

CONFIG = """
title: t
bench: {methods: [auto, DOP853, exact], tols: [1e-4, 1e-8]}
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}}
cases:
  a: {damping: [0.05, 0.04, 0.03], time: {end: 40, samples: 11}}
  b: {time: {end: 10, samples: 11}}
"""


def test_the_fastest_is_taken_among_those_that_are_right() -> None:
    made = [(1e-4, 1.0), (1e-8, 3.0), (1e-7, 2.0), (np.nan, 0.1)]
    tried = tuple(bench.Trial(error=error, run_time=time) for error, time in made)
    made = bench.table_of_trials(["a"], ["m", "n"], [1e-4, 1e-8], tried)
    rows = bench.table_of_bench(made, as_markdown=True).splitlines()[2:]
    assert rows == ["| a | m 1 s | n 2 s | - | - |"]
    for method, status, is_failure in (
        ("auto", "SILENT", True),
        ("auto", "accurate", False),
        ("DOP853", "timeout", False),
    ):
        made = bench.table_of_trials(["a"], [method], [np.nan], [bench.Trial(status=status)])
        assert bench.auto_failed(made) == is_failure


@pytest.fixture(scope="module")
def benched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """A folder with the trials of a case file, and what the command did."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "small.yaml").write_text(CONFIG, encoding="utf-8")
    return folder, call(folder, "bench", "small.yaml")


def test_the_command_writes_a_labelled_dataset_a_table_and_a_figure(benched):
    folder, done = benched
    assert done.returncode == 0, done.stderr
    head = done.stdout.splitlines()[0]
    assert " ".join(head.split()) == "case 3 digits 6 digits 9 digits 12 digits"
    # Of case a the motion has no closed form, so that exact is not tried.
    assert done.stderr.startswith("a: 4 accurate (")
    drawn = (folder / "runs" / "figures" / "small.bench.svg").read_text(encoding="utf-8")
    for words in ("DOP853", "run time [s]", "largest relative error", "one ulp in the data"):
        assert f">{words}</text>" in drawn
    script = (
        "import json, xarray\n"
        "data = xarray.open_dataset('runs/small.bench.h5', group='bench', engine='netcdf4')\n"
        "print(json.dumps([dict(data.sizes), sorted(data.data_vars)]))"
    )
    read = subprocess.check_output([sys.executable, "-c", script], cwd=folder)
    sizes, names = json.loads(read)
    assert sizes == {"case": 2, "method": 3, "tol": 2}
    assert {"error", "run_time", "steps", "floor", "status", "method_taken"} <= set(names)
    data = hodo_cli.open(folder / "runs/small.bench.h5")["bench"]
    assert str(data.status.sel({"case": "b", "method": "exact"}).values[0]) == "accurate"
    assert {*data.status.sel({"case": "a", "method": "exact"}).values.tolist()} == {"-"}
    # An error of DOP853 is the true one: it falls with the tolerance, and the data know no more.
    loose, fine = data.error.sel({"case": "b", "method": "DOP853"}).values
    assert 1e-10 < fine < 1e-6 < loose < 1e-2
    # An ulp in the data turns the motion by about its angle of 10 times 1e-16.
    assert 1e-16 < data.floor.sel(case="b").values.max() < 1e-14


def test_trials_are_no_cases(benched):
    result = "runs/small.bench.h5"
    for command in ("show", "classify", "claims", "plot", "compare"):
        more = [result] if command == "compare" else []
        refused = call(benched[0], command, result, *more)
        said = refused.stderr.splitlines()[-1]
        assert said == f"{result} holds no cases, but trials of methods"
        assert refused.returncode == 2
    missing = call(benched[0], "bench", "small.yaml", "--case", "zzz")
    assert (missing.returncode, missing.stderr) == (2, "no case matches zzz (valid: a, b)\n")


def test_a_bench_without_auto_says_nothing_of_it(hodo: Hodo, tmp_path: Path) -> None:
    text = CONFIG.replace("auto, DOP853, exact", "collocation").replace(", tols: [1e-4, 1e-8]", "")
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    done = hodo("bench", str(tmp_path / "a.yaml"))
    assert done.returncode == 0, done.stderr
    for row in done.stdout.splitlines()[1:]:
        _, *by_auto, method, _, _ = row.split()
        assert (by_auto, method) == (["-"] * 5, "collocation")


LIMITED = """
bench: {methods: [auto, DOP853], max_seconds: 0.001}
cases:
  # Its rotation about the middle axis magnifies an ulp in the data.
  unstable: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 200, samples: 11},
             initial: {p: 1.0e-9, q: 1, r: 1.0e-9}}
  # DOP853 finds no stop, which is no failure.
  spin: {model: cavity+constant, form: averaged, inertia: [8, 8, 4], kappa: 1,
         torque: [0, 0, -0.1], initial: {x: 1, y: 1}, time: {end: 20, samples: 11}}
"""


def test_verdicts_name_what_limits_a_result(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(LIMITED, encoding="utf-8")
    done = hodo("bench", "a.yaml")
    assert done.returncode == 0, done.stderr
    assert "spin: 1 accurate (" in done.stderr
    assert done.stdout.splitlines()[2].split()[-1] == "-"
    trials = hodo_cli.open(tmp_path / "runs" / "a.bench.h5")["bench"]
    (by_auto, by_dop853), spin = trials.status.values[:, :, 0].tolist()
    assert by_auto in ("accurate", "limited by the data")
    assert by_dop853 == "timeout"
    assert spin == ["accurate", "-"]
    assert np.isnan(trials.error.values[1, 1, 0])


def test_an_averaged_motion_is_tried_by_its_quadrature(hodo, tmp_path):
    """Whose crossing errs by one ulp in long double, which is stored as a double."""
    (tmp_path / "m.yaml").write_text(
        "cases:\n  m: {model: linear-diag, form: averaged, inertia: [1, 0.8, 0.6],\n"
        "      damping: [0.005, 0.004, 0.003], initial: {p: 0.8, q: 0.5, r: 0.74},\n"
        "      time: {end: 400}}\n"
        "bench: {methods: [auto, quadrature, DOP853]}\n"
    )
    done = hodo("bench", "m.yaml")
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith("m: 2 accurate (")
