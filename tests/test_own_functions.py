"""Models of one's own whose equations contain functions, the time and more than omega: by every
engine, averaged and side by side, against motions that are known.

A body with equal damping at the rate -m'/m, where m(t) = 1 + a sin(b t) is never 0, moves as a free
one at the time t + a (1 - cos b t)/b, m times as fast. HODO_FUZZ sets the number of motions of each
kind (default 5).
"""

import math
import os
import random
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import pytest
from conftest import classified, exact_motion

from hodo_cli import Case, functions, models
from hodo_cli.cases import keys
from hodo_cli.cases.case import Time
from hodo_cli.engines import have_taylor
from hodo_cli.functions import abs, cos, exp, log, sin, sqrt
from hodo_cli.models.base import Constants, Label
from hodo_cli.models.rigid_body import INERTIA, INITIAL, BodyFrame
from hodo_cli.schema.kinds import Key, Number, vector
from hodo_cli.sweeps import chunk

pytestmark = pytest.mark.engines

COUNT = int(os.environ.get("HODO_FUZZ", "5"))

METHODS = [*(["taylor"] if have_taylor() else []), "collocation", "DOP853"]


def free(p: Any, q: Any, r: Any, k: Any) -> tuple[Any, Any, Any]:
    """The rates of a free body."""
    return (
        k.g * (k.A2 - k.A3) / k.A1 * q * r,
        k.g * (k.A3 - k.A1) / k.A2 * p * r,
        k.g * (k.A1 - k.A2) / k.A3 * p * q,
    )


@dataclass(frozen=True)
class Waving(BodyFrame):
    """Equal damping -m'/m, m = 1 + a sin(b t), from the time itself."""

    depth: float
    rate: float

    name = "waving"
    form = "full"
    keys: ClassVar[dict[str, Key]] = {
        "inertia": INERTIA,
        "depth": Key(Number(), "a"),
        "rate": Key(Number(), "b"),
        "initial": INITIAL,
    }
    degree: ClassVar[dict[str, int]] = {"g": 2, "unit": 1}

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r = y[:3]
        rate = k.unit * k.a * k.b * cos(k.b * t) / (1 + k.a * sin(k.b * t))
        return tuple(f + rate * x for f, x in zip(free(p, q, r, k), y, strict=True))

    @cached_property
    def constants(self) -> Constants:
        return {**super().constants, "a": self.depth, "b": self.rate, "unit": 1.0}


@dataclass(frozen=True)
class Oscillating(Waving):
    """The same, with sin(b t) and cos(b t) as two more variables of the state."""

    name = "oscillating"
    form = "full"
    state = ("p", "q", "r", "s", "c")
    state_degree: ClassVar[dict[str, int]] = {"s": 0, "c": 0}
    variables: ClassVar[dict[str, Label]] = BodyFrame.variables | {"s": Label(("time",), "sine")}

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r, s, c = y
        rate = k.unit * k.a * k.b * c / (1 + k.a * s)
        own = [f + rate * x for f, x in zip(free(p, q, r, k), (p, q, r), strict=True)]
        return (*own, k.unit * k.b * c, -k.unit * k.b * s)

    @property
    def start(self) -> tuple[float, ...]:
        return (*super().start, 0.0, 1.0)


@dataclass(frozen=True)
class Disguised(BodyFrame):
    """Damping about three axes, times functions that are 1 together."""

    damping: tuple[float, float, float]

    name = "disguised"
    form = "full"
    keys: ClassVar[dict[str, Key]] = {
        "inertia": INERTIA,
        "damping": Key(vector(3), "lambda"),
        "initial": INITIAL,
    }
    degree: ClassVar[dict[str, int]] = {"g": 2, "lam": 1}

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r = y
        square = (p * p + r * r) / (p * p + q * q + r * r)
        one = sin(square) ** 2 + sqrt(cos(square) ** 4) + exp(log(1 + square)) - 1 - square
        terms = zip(free(p, q, r, k), k.lam, y, strict=True)
        return tuple(f - one * lam * x for f, lam, x in terms)

    @cached_property
    def constants(self) -> Constants:
        return {**super().constants, "lam": self.damping}


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The models, as if they were hodo's own."""
    for model in (Waving, Oscillating, Disguised):
        forms: dict[str, Any] = {"full": model}
        models.add_averaged(forms)
        monkeypatch.setitem(models.catalogue(), model.name, forms)
    yield
    keys.keys_of.cache_clear()
    keys.all_keys.cache_clear()


def body(draw: random.Random) -> dict[str, Any]:
    """A random body at a random start."""
    return {
        "inertia": [draw.uniform(0.55, 1) for _ in range(3)],
        "initial": {name: draw.uniform(-1, 1) for name in "pqr"},
    }


def waving(seed: int) -> dict[str, Any]:
    draw = random.Random(seed)
    law = {"depth": draw.uniform(-0.6, 0.6), "rate": draw.uniform(0.05, 2)}
    return body(draw) | law | {"time": {"end": draw.uniform(1, 60), "samples": 13}}


def truth(data: dict[str, Any], times: np.ndarray) -> np.ndarray:
    """omega (n, 3) at times (n,) of a waving body."""
    a, b = data["depth"], data["rate"]
    inner = times + a * (1 - np.cos(b * times)) / b
    still = {key: data[key] for key in ("inertia", "initial")}
    case = Case.of({"model": "linear-diag", "damping": 0, **still, "time": {"end": 1}})
    return (1 + a * np.sin(b * times))[:, None] * exact_motion(case, inner)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("model", ["waving", "oscillating"])
def test_its_motions_are_right_to_their_stated_errors(model: str, method: str) -> None:
    for seed in range(COUNT):
        data = waving(seed)
        given = {"model": model, "method": method, **data}
        if method == "DOP853":
            given["tol"] = 1e-10
        motion, _ = classified(Case.of(given))
        assert motion.status == "ok", (seed, motion.message)
        true = truth(data, motion.time)
        off = np.linalg.norm(motion.variables["omega"] - true, axis=1)
        # The closed form has its own rounding, and the start that of the data.
        worst = (off / np.linalg.norm(true, axis=1)).max()
        assert worst < 3 * motion.error + 3e-13, seed
        if model == "oscillating":
            sine = np.sin(data["rate"] * motion.time)
            assert np.abs(motion.variables["s"] - sine).max() < 3 * motion.error + 1e-13


@pytest.mark.heyoka
@pytest.mark.parametrize("model", ["waving", "oscillating"])
def test_members_of_a_sweep_are_its_motions(model: str) -> None:
    for seed in range(COUNT):
        data = waving(seed)
        depths = [data["depth"], data["depth"] / 2, 0.0]
        given = {"model": model, **data, "sweep": {"depth": {"values": depths}}}
        given["time"] = {"end": data["time"]["end"]}
        case = Case.of(given | {"store": ["omega"]})
        group = chunk.compute(chunk.Chunk(case, 0, 3))
        for i, depth in enumerate(depths):
            true = truth(data | {"depth": depth}, np.array([case.time.end]))[0]
            off = np.linalg.norm(group.variables["omega"].data[i] - true)
            assert off < 1e-11 * np.linalg.norm(true), (seed, i)


def test_functions_that_are_1_change_no_motion() -> None:
    """In full and averaged, with the labels and crossings."""
    forms = ("full", "averaged") if have_taylor() else ("full",)
    for seed in range(COUNT):
        draw = random.Random(seed)
        data = body(draw) | {"damping": [draw.uniform(0.001, 0.005) for _ in range(3)]}
        for form in forms:
            both = [
                classified(Case.of({"model": model, "form": form, **data, "time": {"end": 200.0}}))
                if form == "full"
                else (integrated(model, data), None)
                for model in ("disguised", "linear-diag")
            ]
            (ours, labelled), (theirs, expected) = both
            if form == "full":
                apart = np.linalg.norm(ours.variables["omega"] - theirs.variables["omega"], axis=1)
                sizes = np.linalg.norm(theirs.variables["omega"], axis=1)
                assert (apart / sizes).max() < 10 * (ours.error + theirs.error), seed
                crossings = zip(labelled.crossings, expected.crossings, strict=True)
                for a, b in crossings:
                    assert abs(a.time - b.time) < 10 * (a.error + b.error) + 1e-11, seed
                assert labelled.growth == pytest.approx(expected.growth, nan_ok=True, abs=1e-12)
            else:
                assert close(ours, theirs), seed


def integrated(model: str, data: dict[str, Any]) -> Any:
    """The averaged form of the first order, which is that of the equations alone."""
    from hodo_cli.integration.integrate import integrate

    given = {"model": model, "form": "averaged", **data, "mean_start": "no"}
    return integrate(Case.of({**given, "time": {"end": 200.0}}))


def close(ours: Any, theirs: Any) -> bool:
    """Whether two averaged motions agree to their stated errors."""
    n = min(len(ours.time), len(theirs.time))
    a, b = (motion.variables["momentum"][:n] for motion in (ours, theirs))
    return bool(np.abs(a - b).max() < (10 * (ours.error + theirs.error) + 1e-10) * b.max())


@pytest.mark.parametrize("seed", range(3))
def test_a_tilt_grows_by_the_equations_as_by_the_formula(seed: int) -> None:
    draw = random.Random(seed)
    A, rates = [draw.uniform(0.55, 1) for _ in range(3)], [draw.uniform(0, 0.1) for _ in range(3)]
    start = {"p": 0.3, "q": 0.4, "r": -0.5, "G": None}
    system = Disguised(inertia=tuple(A), initial=start, damping=tuple(rates))
    known = {"inertia": tuple(A), "initial": start, "damping": tuple(rates)}
    expected = Case("known", "linear-diag", "full", known, Time(end=1.0)).system.tilt_growth(0.0)
    assert system.dissipation is None
    assert system.tilt_growth(0.0) == pytest.approx(expected, nan_ok=True, rel=1e-9, abs=1e-14)


def test_no_growth_is_told_where_it_changes_with_the_time() -> None:
    start = {"p": 0.3, "q": 0.4, "r": -0.5, "G": None}
    for model in (Waving, Oscillating):
        system = model(inertia=(1.0, 0.8, 0.6), initial=start, depth=0.1, rate=1.0)
        assert system.tilt_growth(0.0) is None


@pytest.mark.parametrize("number", [0.3, np.float64(0.3), np.longdouble(0.3), np.full(3, 0.3)])
def test_functions_of_numbers_and_arrays(number: Any) -> None:
    for name in ("sin", "cos", "exp", "log", "sqrt"):
        value = getattr(functions, name)(number)
        assert np.allclose(np.asarray(value, float), getattr(math, name)(0.3), rtol=1e-15)
        assert np.asarray(value).dtype == np.asarray(number).dtype
    assert np.all(abs(-number) == number)
