"""A model of one's own with a law of time, by every engine, against a series in integers."""

import json
import random
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import ROOT, run_hodo

from hodo_cli.engines import have_taylor

COUNT = 3
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
    for seed in range(COUNT if have_taylor() else max(1, COUNT // 2)):
        yield seed, SIZES[(seed + first) % len(SIZES)]


def ruled(method: str, seed: int) -> dict[str, Any]:
    """A body under a law of the time, also from a late start."""
    body = random_body(seed, torques=seed % 2 == 0)
    is_slow = method in ("collocation", "Radau") or not have_taylor()
    span = random.Random(seed).uniform(3, 6 if is_slow else 30)
    body["time"] |= {"end": body["time"]["start"] + span, "samples": 3}
    return body


def cases() -> Iterator[tuple[str, dict[str, Any]]]:
    """All that is tried, by method, precision and seed."""
    for method, precision in BOUNDS:
        for seed, size in seeds(method, precision):
            options = {"method": method, "precision": precision}
            yield f"{method}-{precision}-{seed}", scaled(ruled(method, seed), size, **options)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Iterator[h5py.File]:
    """The motions, integrated as a user does it."""
    folder = tmp_path_factory.mktemp("timed")
    given = {name: case for name, case in cases() if have_taylor() or name[:6] != "taylor"}
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
