"""The bench: its verdicts, and what it stores."""

import json
import math
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Hodo

import hodo_cli
from hodo_cli.cases.config import parse
from hodo_cli.commands import bench
from hodo_cli.integration import solve

CONFIG = """
title: t
bench: {methods: [auto, DOP853, exact], tols: [1e-4, 1e-8]}
cases:
  a: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.05, 0.04, 0.03],
      initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 40, samples: 11}}
  b: {model: linear-diag, inertia: [1, 0.8, 0.6],
      initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 10, samples: 11}}
"""
CASES = parse(CONFIG, "x.yaml").cases


def test_each_verdict() -> None:
    motion = solve(replace(CASES["a"], tol=1e-4), "DOP853", tol=1e-4)
    assert bench.verdict(motion, 9e-4, 0.0) == "accurate"
    assert bench.verdict(motion, 1e-2, 1e-3) == "limited by the data"
    for status, words in (("timeout", "timeout"), ("failed", "failed with a message")):
        ended = replace(motion, status=type(motion.status)(status))
        assert bench.verdict(ended, 0.0, 0.0) == words
    # Its own measuring finds an error of some 1e-4, as it is, which is what was asked for: a larger
    # one is silent.
    assert bench.verdict(motion, 1e-2, 0.0) == "SILENT"
    wrong = replace(motion, state=motion.state * 1.1)
    assert bench.verdict(wrong, 0.1, 0.0) == "inaccurate, as stated"


def test_one_ulp_moves_every_number_that_is_not_zero() -> None:
    up, mixed = bench.perturbed(CASES["a"])
    for moved in (up, mixed):
        assert all(
            a != b for a, b in zip(moved.data["inertia"], CASES["a"].data["inertia"], strict=True)
        )
        assert moved.data["initial"]["p"] == pytest.approx(0.8, rel=3e-16)
    assert up != mixed
    assert next(bench.perturbed(CASES["b"])).data["damping"] == (0.0, 0.0, 0.0)


def test_a_trial_that_has_no_time_for_a_sample_is_named() -> None:
    case = CASES["b"]
    tried = bench.trial(case, bench.reference_motion(case), "exact", None, 1, 1e-9)
    assert (tried.status, np.isnan(tried.drift)) == ("timeout", True)


def test_a_symmetric_body_stays_symmetric_when_its_numbers_are_moved() -> None:
    body = replace(CASES["a"], data={**CASES["a"].data, "inertia": (8.0, 8.0, 4.0)})
    for moved in bench.perturbed(body):
        A, B, C = moved.data["inertia"]
        assert A == B != 8
        assert C != 4


def test_the_floor_is_that_of_the_phase() -> None:
    # An ulp in the data turns the motion by about its angle of 10 times 1e-16.
    assert 1e-16 < bench.reference_motion(CASES["b"]).floor < 1e-14


def test_a_trial_measures_the_true_error_and_the_drift() -> None:
    tried = bench.trial(CASES["b"], bench.reference_motion(CASES["b"]), "DOP853", 1e-6, 3, 10.0)
    assert 1e-7 < tried.error < 1e-4
    assert 1e-9 < tried.drift < tried.error
    assert tried.rhs_evaluations >= 12 * tried.steps
    # It crosses the separatrix once, and is damped.
    crossing = bench.trial(
        CASES["a"], bench.reference_motion(CASES["a"]), "DOP853", 1e-6, 1, math.inf
    )
    assert 0 < crossing.crossing_error < 1e-3
    assert np.isnan(tried.crossing_error)
    assert np.isnan(crossing.drift)


def test_a_time_is_the_least_of_the_repeats_and_the_processor_s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Sleeper:
        change = None

        def begin(self, *_: object) -> None:
            time.sleep(0.2)

        def __call__(self, *_: object) -> None: ...

        def flush(self) -> None: ...

    case, began = CASES["b"], time.perf_counter()
    motion = solve(case, "DOP853", observer=Sleeper())
    assert motion.run_time + 0.2 < time.perf_counter() - began
    # As if the first had compiled; a long one is not repeated.
    monkeypatch.setattr(bench, "SINGLE_RUN_SECONDS", 1e9)
    assert bench.least_time(case, replace(motion, run_time=0.9e9), 3) < 0.9e9
    assert bench.least_time(case, replace(motion, run_time=2e9), 3) == 2e9


def test_a_method_that_finds_no_stop_has_a_dash(hodo: Hodo, tmp_path: Path) -> None:
    """In the map of verdicts too, and it is no failure."""
    (tmp_path / "a.yaml").write_text(
        "bench: {methods: [auto, DOP853]}\n"
        "cases:\n"
        "  spin: {model: cavity+constant, form: averaged, inertia: [8, 8, 4], kappa: 1,\n"
        "         torque: [0, 0, -0.1], initial: {x: 1, y: 1}, time: {end: 20, samples: 11}}\n"
    )
    done = hodo("bench", "a.yaml")
    assert done.returncode == 0, done.stderr
    assert "spin: 1 accurate (" in done.stderr
    assert done.stdout.splitlines()[1].split()[-1] == "-"
    trials = hodo_cli.open(tmp_path / "runs" / "a.bench.h5")["bench"]
    assert trials.status.values.ravel().tolist() == ["accurate", "-"]
    assert np.isnan(trials.error.values[0, 1, 0])


def test_an_averaged_motion_is_tried_too() -> None:
    text = CONFIG.replace("damping: [0.05, 0.04, 0.03],", "damping: 0.001, form: averaged,")
    averaged = parse(text, "x.yaml").cases["a"]
    reference = bench.reference_motion(averaged)
    tried = bench.trial(averaged, reference, "quadrature", None, 1, math.inf)
    assert tried.error < 1e-14
    assert bench.trial(averaged, reference, "DOP853", 1e-6, 1, math.inf).status != "ok"
    assert np.isnan(tried.drift)


def test_the_fastest_is_taken_among_those_that_are_right() -> None:
    tried = tuple(
        bench.Trial(error=e, run_time=t)
        for e, t in [(1e-4, 1.0), (1e-8, 3.0), (1e-7, 2.0), (np.nan, 0.1)]
    )
    made = bench.table_of_trials(["a"], ["m", "n"], [1e-4, 1e-8], tried)
    assert bench.table_of_bench(made, as_markdown=True).splitlines()[2:] == [
        "| a | m 1 s | n 2 s | - | - |"
    ]
    for method, status, is_failure in (
        ("auto", "SILENT", True),
        ("auto", "accurate", False),
        ("DOP853", "timeout", False),
    ):
        made = bench.table_of_trials(["a"], [method], [np.nan], [bench.Trial(status=status)])
        assert bench.auto_failed(made) == is_failure


def test_one_tolerance_gives_a_table_of_verdicts_and_several_one_of_speeds() -> None:
    tried = tuple(
        bench.Trial(status="accurate", error=e, run_time=t, method=m)
        for m, e, t in [
            ("taylor", 1e-14, 0.5),
            ("m", 1e-14, 0.3),
            ("exact", 1e-15, 0.25),
            ("m", 1, 0.1),
        ]
    )
    several = bench.table_of_trials(["a", "b"], ["auto", "m"], [np.nan], tried)
    verdicts = bench.table_of_bench(several, as_markdown=False)
    rows = [line.split() for line in verdicts.splitlines()]
    assert rows[0][:3] == ["case", "auto", "takes"]
    assert [(row[0], row[1]) for row in rows[1:]] == [("a", "taylor"), ("b", "exact")]
    assert [row[-2:] for row in rows[1:]] == [["300", "ms"], ["accurate", "-"]]
    by_tolerance = bench.table_of_trials(["a"], ["auto", "m"], [1e-4, 1e-8], tried)
    speeds = bench.table_of_bench(by_tolerance, as_markdown=True)
    assert speeds.startswith("| case | 3 digits | ")


def test_the_command_writes_a_labelled_dataset_a_table_and_a_figure(
    hodo: Hodo, tmp_path: Path
) -> None:
    (tmp_path / "small.yaml").write_text(CONFIG, encoding="utf-8")
    done = hodo("bench", "small.yaml")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].split() == [
        "case",
        *["3", "digits", "6", "digits", "9", "digits", "12", "digits"],
    ]
    assert done.stderr.startswith("a: 4 accurate, 2 failed with a message (")
    needs = "a: method exact needs torques along G"
    assert f"\nexact at 0.0001, exact at 1e-08: {needs}" in done.stderr
    assert (tmp_path / "runs" / "figures" / "small.png").stat().st_size > 10_000
    script = (
        "import json, xarray\n"
        "data = xarray.open_dataset('runs/small.bench.h5', group='bench', engine='netcdf4')\n"
        "print(json.dumps([dict(data.sizes), sorted(data.data_vars), "
        "str(data.status.sel(case='b').values[2, 0])]))"
    )
    read = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    sizes, names, status = json.loads(read.stdout)
    assert sizes == {"case": 2, "method": 3, "tol": 2}
    assert {
        "error",
        "crossing_error",
        "run_time",
        "compile_time",
        "steps",
        "rhs_evaluations",
        "drift",
    } <= set(names)
    assert status == "accurate"
    result = "runs/small.bench.h5"
    assert str(hodo_cli.open(tmp_path / result)["bench"].status.values[1, 2, 0]) == "accurate"
    for command in ("show", "classify", "claims", "plot", "compare", "merge"):
        more = {"compare": [result], "merge": ["--out", "runs/new.h5"]}.get(command, [])
        refused = hodo(command, result, *more)
        assert refused.stderr == f"{result} holds no cases, but trials of methods\n"
        assert refused.returncode == 2
    missing = hodo("bench", "small.yaml", "--case", "zzz")
    assert (missing.returncode, missing.stderr) == (2, "no case matches zzz (valid: a, b)\n")


def test_a_bench_without_auto_says_nothing_of_it(hodo: Hodo, tmp_path: Path) -> None:
    text = CONFIG.replace("auto, DOP853, exact", "collocation").replace(", tols: [1e-4, 1e-8]", "")
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    done = hodo("bench", str(tmp_path / "a.yaml"))
    assert done.returncode == 0, done.stderr
    for row in done.stdout.splitlines()[1:]:
        _, *by_auto, method, _, _ = row.split()
        assert (by_auto, method) == (["-"] * 5, "collocation")
