"""Models of one's own whose equations contain functions, the time and more than omega: by every
engine and side by side, against motions that are known.

A body with equal damping at the rate -m'/m, where m(t) = 1 + a sin(b t) is never 0, moves as a free
one at the time t + a (1 - cos b t)/b, m times as fast. HODO_FUZZ sets the number of motions of each
kind (default 1).
"""

import json
import math
import os
import random
from collections import ChainMap
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import ROOT, exact_motion, run_hodo

from hodo_cli import Case, functions
from hodo_cli.engines import have_taylor

COUNT = int(os.environ.get("HODO_FUZZ", "1"))
OWN = ROOT / "tests" / "own_models" / "waving.py"

METHODS = [*(["taylor"] if have_taylor() else []), "collocation", "DOP853"]
WAVING = ("waving", "oscillating")


def body(draw: random.Random) -> dict[str, Any]:
    """A random body at a random start."""
    return {
        "inertia": [draw.uniform(0.55, 1) for _ in range(3)],
        "initial": {name: draw.uniform(-1, 1) for name in "pqr"},
    }


def waving(seed: int) -> dict[str, Any]:
    draw = random.Random(seed)
    law = {"depth": draw.uniform(-0.6, 0.6), "rate": draw.uniform(0.05, 2)}
    return body(draw) | law | {"time": {"end": draw.uniform(1, 30), "samples": 13}}


def depths(seed: int) -> list[float]:
    """Of the members of a sweep."""
    depth = waving(seed)["depth"]
    return [depth, depth / 2, 0.0]


def disguised(seed: int, most: float) -> dict[str, Any]:
    draw = random.Random(seed)
    return body(draw) | {"damping": [draw.uniform(0.001, most) for _ in range(3)]}


def cases() -> Iterator[tuple[str, dict[str, Any]]]:
    """All that is tried, by names of model, method or form, and seed."""
    for seed in range(COUNT):
        data = waving(seed)
        for model in WAVING:
            for method in METHODS:
                tol = {"tol": 1e-10} if method == "DOP853" else {}
                yield f"{model}-{method}-{seed}", {"model": model, "method": method, **data, **tol}
            swept = {"sweep": {"depth": {"values": depths(seed)}}, "store": ["omega"]}
            swept |= {"time": {"end": data["time"]["end"]}, "error": "off"}
            yield f"{model}-members-{seed}", {"model": model, **data, **swept}
        for model in ("disguised", "linear-diag"):
            data = {"model": model, **disguised(seed, 0.005), "time": {"end": 200.0}}
            yield f"{model}-full-{seed}", data
            data = {"model": model, **disguised(seed, 0.1), "time": {"end": 1.0, "samples": 3}}
            yield f"{model}-tilting-{seed}", data


Result = Mapping[str, h5py.Group]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Result]:
    """The motions, integrated as a user does it; those whose crossings are looked at classified
    too."""
    folder = tmp_path_factory.mktemp("own")
    apart = {} if have_taylor() else {"members"}
    given: dict[str, dict[str, Any]] = {"crossing": {}, "others": {}}
    for name, case in cases():
        if (kind := name.split("-")[-2]) not in apart:
            given["crossing" if kind in ("full", "tilting") else "others"][name] = case
    for file, of in given.items():
        (folder / f"{file}.yaml").write_text(json.dumps({"cases": of}), encoding="utf-8")
    for words in (("run", "crossing.yaml", "others.yaml"), ("classify", "crossing.yaml")):
        done = run_hodo(folder, "--models", OWN, *words)
        assert done.returncode == 0, done.stderr
    with ExitStack() as files:
        results = sorted((folder / "runs").glob("*.h5"))
        yield ChainMap(*(files.enter_context(h5py.File(path)) for path in results))


def truth(data: dict[str, Any], times: np.ndarray) -> np.ndarray:
    """omega (n, 3) at times (n,) of a waving body."""
    a, b = data["depth"], data["rate"]
    inner = times + a * (1 - np.cos(b * times)) / b
    still = {key: data[key] for key in ("inertia", "initial")}
    case = Case.of({"model": "linear-diag", "damping": 0, **still, "time": {"end": 1}})
    return (1 + a * np.sin(b * times))[:, None] * exact_motion(case, inner)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("model", WAVING)
def test_its_motions_are_right_to_their_stated_errors(
    result: Result, model: str, method: str
) -> None:
    for seed in range(COUNT):
        data, motion = waving(seed), result[f"{model}-{method}-{seed}"]
        assert motion.attrs["status"] == "ok", (seed, motion.attrs["message"])
        time, error = motion["time"][()], motion.attrs["error"]
        true = truth(data, time)
        off = np.linalg.norm(motion["omega"] - true, axis=1)
        # The closed form has its own rounding, and the start that of the data.
        worst = (off / np.linalg.norm(true, axis=1)).max()
        assert worst < 3 * error + 3e-13, seed
        if model == "oscillating":
            assert np.abs(motion["s"] - np.sin(data["rate"] * time)).max() < 3 * error + 1e-13


@pytest.mark.heyoka
@pytest.mark.parametrize("model", WAVING)
def test_members_of_a_sweep_are_its_motions(result: Result, model: str) -> None:
    for seed in range(COUNT):
        data = waving(seed)
        for i, depth in enumerate(depths(seed)):
            true = truth(data | {"depth": depth}, np.array([data["time"]["end"]]))[0]
            off = np.linalg.norm(result[f"{model}-members-{seed}/omega"][i] - true)
            assert off < 1e-11 * np.linalg.norm(true), (seed, i)


def test_functions_that_are_1_change_no_motion(result: Result) -> None:
    """Nor its crossings."""
    for seed in range(COUNT):
        ours, theirs = (result[f"{model}-full-{seed}"] for model in ("disguised", "linear-diag"))
        errors = ours.attrs["error"] + theirs.attrs["error"]
        apart = np.linalg.norm(ours["omega"] - theirs["omega"][()], axis=1)
        assert (apart / np.linalg.norm(theirs["omega"], axis=1)).max() < 10 * errors, seed
        assert len(ours["crossing_time"]) == len(theirs["crossing_time"])
        allowed = 10 * (ours["crossing_error"] + theirs["crossing_error"][()]) + 1e-11
        assert (abs(ours["crossing_time"] - theirs["crossing_time"][()]) < allowed).all(), seed


@pytest.mark.parametrize("kind", ["full", "tilting"])
def test_a_tilt_grows_by_the_equations_as_by_the_formula(result: Result, kind: str) -> None:
    for seed in range(COUNT):
        ours, theirs = (
            result[f"{model}-{kind}-{seed}/growth_rate"][()]
            for model in ("disguised", "linear-diag")
        )
        assert ours == pytest.approx(theirs, nan_ok=True, rel=1e-9, abs=1e-14)


def test_no_growth_is_told_where_it_changes_with_the_time(result: Result) -> None:
    assert not [name for name in result if "growth_rate" in result[name] and "-full-" not in name
                and "-tilting-" not in name]  # fmt: skip


@pytest.mark.parametrize("number", [0.3, np.float64(0.3), np.longdouble(0.3), np.full(3, 0.3)])
def test_functions_of_numbers_and_arrays(number: Any) -> None:
    for name in ("sin", "cos", "exp", "log", "sqrt"):
        value = getattr(functions, name)(number)
        assert np.allclose(np.asarray(value, float), getattr(math, name)(0.3), rtol=1e-15)
        assert np.asarray(value).dtype == np.asarray(number).dtype
    assert np.all(functions.abs(-number) == number)
