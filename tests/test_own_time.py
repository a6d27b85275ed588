"""Models of one's own whose equations contain the time and variables of other units than omega: by
every engine, against the integers of `series`.

HODO_FUZZ sets the number of motions of each method (default 3).
"""

import json
import math
import os
import random
from collections.abc import Iterator, Mapping
from fractions import Fraction
from functools import cache
from typing import Any

import h5py
import mpmath
import numpy as np
import pytest
import series
from conftest import ROOT, run_hodo

from hodo_cli.engines import have_taylor

COUNT = int(os.environ.get("HODO_FUZZ", "3"))
TIMED = ROOT / "tests" / "own_models" / "timed.py"
LAWS = ["falling", "polynomial", "exponential"]


def random_body(seed: int, torques: bool) -> dict[str, Any]:
    """A random body that turns some times a unit of time, under a law that changes it much in ten
    to a hundred."""
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


def exactly(body: dict[str, Any], times: list[float]) -> np.ndarray:
    """The states (n, 6) at times after the start, by the integers of `series`, where the law is a
    variable x of its own."""
    A = [Fraction(a) for a in body["inertia"]]
    n, F, rate = (Fraction(body[name]) for name in ("torque", "force", "rate"))
    begin = rate * Fraction(body["time"]["start"])
    law, ruled, first = {
        "falling": ({(6, 6): Fraction(1)}, {(6, 6): -rate}, 1 / (1 + begin)),
        "polynomial": (
            {(): Fraction(1), (6,): Fraction(-1), (6, 6): Fraction(1, 2)},
            {(): rate},
            begin,
        ),
        "exponential": ({(6,): Fraction(1)}, {(6,): -rate}, None),
    }[body["law"]]
    if first is None:
        with mpmath.workprec(250):
            # The model's e is a double too.
            power = mpmath.power(mpmath.mpf(math.e), -mpmath.fraction(*begin.as_integer_ratio()))
            first = Fraction(int(mpmath.floor(mpmath.ldexp(power, 240))), 1 << 240)
            change = mpmath.log(mpmath.mpf(math.e))
            ratio = Fraction(int(mpmath.floor(mpmath.ldexp(change, 240))), 1 << 240)
        ruled = {(6,): -rate * ratio}
    system = []
    for i, lam in enumerate(map(Fraction, body["damping"])):
        j, m = (i + 1) % 3, (i + 2) % 3
        row = {tuple(sorted((j, m))): (A[j] - A[m]) / A[i]}
        for monomial, c in law.items():
            row[tuple(sorted((i, *monomial)))] = -lam * c
            row[tuple(sorted((i + 3, *monomial)))] = F * c / A[i]
            if i == 2:
                row[tuple(sorted(monomial))] = n * c / A[i]
        system.append(row)
    one = Fraction(1)
    system += [
        {(2, 4): one, (1, 5): -one},
        {(0, 5): one, (2, 3): -one},
        {(1, 3): one, (0, 4): -one},
    ]
    start = [*(body["initial"][name] for name in "pqr"), 0.0, 0.6, 0.8, first]
    found = series.states((*system, ruled), start, times, 160)
    return np.array([[float(x) for x in state[:6]] for state in found])


@cache
def known(body: str, times: tuple[Fraction, ...]) -> np.ndarray:
    """`exactly` of a body as JSON: once for all methods and sizes."""
    return exactly(json.loads(body), [*times])


def test_the_reference_is_right() -> None:
    """The row of a law of time in the torques' table: 0.005/(1 + 0.01 t)^2."""
    body = random_body(0, False) | {
        "inertia": [1, Fraction(8, 10), Fraction(6, 10)], "damping": [Fraction(5, 1000)] * 3,
        "rate": Fraction(1, 100), "law": "falling", "time": {"start": 0},
        "initial": {"p": Fraction(8, 10), "q": Fraction(1, 2), "r": Fraction(74, 100)},
    }  # fmt: skip
    known = [0.50412305006140321, 0.69766151997966874, 0.32975278857125048]
    assert exactly(body, [100])[0, :3] == pytest.approx(known, rel=1e-15)


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


def is_slow(method: str) -> bool:
    """Whether a motion, or the one in long double that its error is measured by, takes long."""
    return method in ("collocation", "Radau") or not have_taylor()


def seeds(method: str, precision: str) -> Iterator[tuple[int, int]]:
    """Those of its motions, and their sizes: each method meets each size, and each body several."""
    first = [*BOUNDS].index((method, precision))
    # Without heyoka the same methods run, of which only the measured error comes another way.
    for seed in range(COUNT if have_taylor() else max(1, COUNT // 2)):
        yield seed, SIZES[(seed + first) % len(SIZES)]


def ruled(method: str, seed: int) -> dict[str, Any]:
    """A body under a law of the time, also from a late start."""
    body = random_body(seed, torques=seed % 2 == 0)
    span = random.Random(seed).uniform(3, 6 if is_slow(method) else 30)
    body["time"] |= {"end": body["time"]["start"] + span, "samples": 3}
    return body


def cases() -> Iterator[tuple[str, dict[str, Any]]]:
    """All that is tried, by what comes before the first hyphen, and by what tells it apart."""
    for method, precision in BOUNDS:
        for seed, size in seeds(method, precision):
            options = {"method": method, "precision": precision}
            yield f"{method}-{precision}-{seed}", scaled(ruled(method, seed), size, **options)


Result = Mapping[str, h5py.Group]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Result]:
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
def test_a_law_of_time_is_that_of_the_case(result: Result, method: str, precision: str) -> None:
    """By every method: each variable is right to the bound, and no worse than the stated error
    says."""
    bound = BOUNDS[method, precision]
    for seed, size in seeds(method, precision):
        body, motion = ruled(method, seed), result[f"{method}-{precision}-{seed}"]
        start = Fraction(body["time"]["start"])
        times = tuple(Fraction(t) * Fraction(2) ** size - start for t in motion["time"][1:])
        right = known(json.dumps(body), times)
        assert motion.attrs["status"] == "ok"
        for name, columns in (("omega", slice(3)), ("gamma", slice(3, 6))):
            unit = 2.0**size if name == "omega" else 1
            seen, states = motion[name][1:] / unit, right[:, columns]
            off = np.linalg.norm(seen - states, axis=1) / np.linalg.norm(states, axis=1)
            assert off.max() < min(bound, 4 * motion[name].attrs["error"] + 2e-15), (seed, name)
