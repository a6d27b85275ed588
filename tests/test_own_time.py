"""Models of one's own whose equations contain the time and variables of other units than omega: by
every engine, at every scale, as single cases and side by side, against the integers of `series`.

HODO_FUZZ sets the number of motions of each engine (default 6).
"""

import math
import os
import random
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

import mpmath
import numpy as np
import pytest
import series
from conftest import classified

from hodo_cli import Case, models
from hodo_cli.cases import keys
from hodo_cli.engines import have_taylor
from hodo_cli.models.base import Constants, Label
from hodo_cli.models.rigid_body import INERTIA, INITIAL, BodyFrame
from hodo_cli.schema.kinds import Choice, Key, Number, vector
from hodo_cli.sweeps import chunk

pytestmark = pytest.mark.engines

COUNT = int(os.environ.get("HODO_FUZZ", "6"))

LAWS = {
    "falling": lambda x, e: (1 + x) ** -2,
    "polynomial": lambda x, e: 1 - x + x * x / 2,
    "exponential": lambda x, e: e ** (-x),
}


@dataclass(frozen=True)
class Timed(BodyFrame):
    """A body under damping, a torque constant in it and one constant in space, all with one law of
    rate t; gamma is the direction of the torque in space."""

    damping: tuple[float, float, float]
    torque: float
    force: float
    rate: float
    law: str

    name = "timed"
    form = "full"
    keys: ClassVar[dict[str, Key]] = {
        "inertia": INERTIA,
        "damping": Key(vector(3), "lambda"),
        "torque": Key(Number(), "N3"),
        "force": Key(Number(), "F"),
        "rate": Key(Number(), "of the law"),
        "law": Key(Choice(*LAWS), "f(rate t)"),
        "initial": INITIAL,
    }
    degree: ClassVar[dict[str, int]] = {"g": 2, "lam": 1, "n": 0, "F": 0}
    state = ("p", "q", "r", "g1", "g2", "g3")
    state_degree: ClassVar[dict[str, int]] = {"g1": 0, "g2": 0, "g3": 0}
    variables: ClassVar[dict[str, Label]] = BodyFrame.variables | {
        "gamma": Label(("time", "axis"), "direction of the force")
    }

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r, g1, g2, g3 = y
        f = LAWS[k.law](k.rate * t, k.e)
        return (
            (k.g * (k.A2 - k.A3) * q * r + k.F * f * g1) / k.A1 - k.lam[0] * f * p,
            (k.g * (k.A3 - k.A1) * p * r + k.F * f * g2) / k.A2 - k.lam[1] * f * q,
            (k.g * (k.A1 - k.A2) * p * q + k.F * f * g3 + k.n * f) / k.A3 - k.lam[2] * f * r,
            k.g * (g2 * r - g3 * q),
            k.g * (g3 * p - g1 * r),
            k.g * (g1 * q - g2 * p),
        )

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        return {"omega": y[:, :3], "gamma": y[:, 3:]}

    @property
    def start(self) -> tuple[float, ...]:
        return (*super().start, 0.0, 0.6, 0.8)

    @cached_property
    def constants(self) -> Constants:
        own = {"lam": self.damping, "n": self.torque, "F": self.force, "rate": self.rate}
        return {**super().constants, **own, "law": self.law, "e": math.e}


@pytest.fixture(autouse=True)
def timed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The model, known as one of hodo's own."""
    monkeypatch.setitem(models.catalogue(), "timed", {"full": Timed})
    yield
    keys.keys_of.cache_clear()
    keys.all_keys.cache_clear()


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
        "law": draw.choice([*LAWS]),
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


def test_the_reference_is_right() -> None:
    """The row of a law of time in the torques' table: 0.005/(1 + 0.01 t)^2."""
    body = random_body(0, False) | {
        "inertia": [1, Fraction(8, 10), Fraction(6, 10)],
        "damping": [Fraction(5, 1000)] * 3,
        "rate": Fraction(1, 100),
        "law": "falling",
        "initial": {"p": Fraction(8, 10), "q": Fraction(1, 2), "r": Fraction(74, 100)},
        "time": {"start": 0},
    }
    known = [0.50412305006140321, 0.69766151997966874, 0.32975278857125048]
    assert exactly(body, [100])[0, :3] == pytest.approx(known, rel=1e-15)


@pytest.mark.parametrize("size", [0, 7, -20, 500, -500])
@pytest.mark.parametrize(
    ("method", "precision", "bound"),
    [
        pytest.param("taylor", "double", 3e-13, marks=pytest.mark.heyoka),
        pytest.param("taylor", "extended", 1e-15, marks=pytest.mark.heyoka),
        ("collocation", "double", 3e-13),
        ("collocation", "extended", 1e-15),
        ("DOP853", "double", 1e-9),
        ("Radau", "double", 1e-4),
    ],
)
def test_a_law_of_time_is_that_of_the_case(
    method: str, precision: str, bound: float, size: int
) -> None:
    """At every scale, by every method, also from a late start: each variable is right to the bound,
    and no worse than the stated error says."""
    slow = method in ("collocation", "Radau")
    for seed in range(COUNT // 3 if slow else COUNT):
        body = random_body(seed, torques=seed % 2 == 0)
        start = body["time"]["start"]
        end = start + random.Random(seed).uniform(5, 15 if slow else 60)
        body["time"] |= {"end": end, "samples": 3}
        case = Case.of(scaled(body, size, method=method, precision=precision))
        motion, _ = classified(case)
        times = [Fraction(t) * Fraction(2) ** size - Fraction(start) for t in motion.time[1:]]
        right = exactly(body, times)
        assert motion.status == "ok"
        for name, columns in (("omega", slice(3)), ("gamma", slice(3, 6))):
            unit = 2.0**size if name == "omega" else 1
            seen, known = motion.variables[name][1:] / unit, right[:, columns]
            off = np.linalg.norm(seen - known, axis=1) / np.linalg.norm(known, axis=1)
            assert off.max() < min(bound, 4 * motion.errors[name] + 2e-15), (seed, name)


@pytest.mark.heyoka
@pytest.mark.parametrize("size", [0, 12, -16, 400])
@pytest.mark.parametrize("torques", [False, True])
def test_members_know_the_time_too(size: int, torques: bool) -> None:
    """Side by side, in spans of 1e-2 to 1e6 and at a far scale, with crossings."""
    assert have_taylor()
    for seed in range(COUNT // 2):
        body = random_body(seed, torques)
        start = body["time"]["start"]
        body["time"] |= {"end": start + 40, "samples": 2}
        values = np.linspace(0, 0.05, 32) * 2.0**size
        case = Case.of(scaled(body, size, sweep={"damping.1": {"values": values.tolist()}}))
        group = chunk.compute(chunk.Chunk(case, 0, len(values)))
        columns = {name: variable.data for name, variable in group.variables.items()}
        assert group.attributes["rejections"].sum() <= 2
        for i in (0, 13, 31):
            own = body | {
                "damping": [body["damping"][0], values[i] / 2.0**size, body["damping"][2]]
            }
            _, found = classified(Case.of(scaled(own, size)))
            right = exactly(own, [Fraction(body["time"]["end"]) - Fraction(start)])[0]
            seen = np.array([*columns["omega"][i] / 2.0**size, *columns["gamma"][i]])
            assert seen == pytest.approx(right, rel=0, abs=3e-13), (seed, i)
            assert columns["crossings"][i] == len(found.crossings)
            for crossing in found.crossings[:1]:
                allowed = 2 * (columns["crossing_error"][i] + crossing.error)
                assert abs(columns["crossing_time"][i] - crossing.time) <= allowed


def test_a_variable_without_a_unit_keeps_its_value_at_rest() -> None:
    """Of a body that has stopped, beyond the smallest number that a motion may have, the direction
    stays."""
    body = random_body(1, False) | {"damping": [3.0, 3.0, 3.0], "law": "polynomial", "rate": 0.0}
    body["time"] = {"end": 2000.0, "samples": 5}
    motion, _ = classified(Case.of(scaled(body, 0)))
    assert not motion.variables["omega"][-1].any()
    gamma = motion.variables["gamma"]
    # Collocation takes 1,789 steps in the place of the series' few, each right to 32 ulps.
    bound = 1e-13 if have_taylor() else 1e-12
    assert np.linalg.norm(gamma, axis=1) == pytest.approx(1, abs=bound)
    assert gamma[-1] == pytest.approx(gamma[1], abs=bound)
    assert motion.error < bound
