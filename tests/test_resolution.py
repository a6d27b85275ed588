"""The samples that a case takes by itself follow its motion."""

import re
from typing import Any

import numpy as np
import pytest

import hodo_cli
from hodo_cli import Case

BODIES: list[dict[str, Any]] = [
    {"model": "linear-diag", "inertia": [1, 0.8, 0.6]},
    {"model": "linear-diag", "inertia": [0.6, 1, 0.9], "damping": [0.005, 0.004, 0.003]},
    {"model": "tensor", "inertia": [8, 8, 4],
     "resistance": {"diagonal": 0.003, "off_diagonal": 0.001}},
    {"model": "torques", "inertia": [1e-9, 9e-10, 3e-10], "damping": 0.004},
]  # fmt: skip


@pytest.mark.parametrize("speed", [0.1, 10.0, 1e3])
@pytest.mark.parametrize("body", BODIES)
def test_samples_that_nobody_names_follow_the_motion(body: dict[str, Any], speed: float) -> None:
    """G turns by less than 15 degrees in the body from one to the next."""
    start = {"p": 0.8 * speed, "q": 0.5 * speed, "r": -0.74 * speed}
    time = {"end": 1000 / max(speed, 10)}
    data = hodo_cli.run({**body, "initial": start, "error": "off", "time": time}, classify=False)
    G = data.omega.data * body["inertia"]
    G /= np.linalg.norm(G, axis=1, keepdims=True)
    turns = np.arccos(np.clip((G[1:] * G[:-1]).sum(axis=1), -1, 1))
    assert np.degrees(turns.max()) < 15
    assert re.search(rf"samples\"?: {data.time.size}, ", data.attrs["case"])
    assert data.time.size <= 50_001


@pytest.mark.parametrize("size", [2.0**-40, 8.0, 2.0**40])
def test_default_samples_are_as_many_in_all_units_of_mass(size: float) -> None:
    """Of bodies that turn fastest about their largest or about their smallest moment."""

    def samples(moments: list[float]) -> int:
        case = {"model": "linear-diag", "inertia": moments, "damping": 0.01}
        start = {"initial": {"p": 8, "q": 5, "r": 7.4}, "time": {"end": 200}}
        return Case.of(case | start).time.samples

    for moments in ([1, 0.8, 0.6], [1, 0.95, 0.3], [1, 0.55, 0.5]):
        assert samples([size * A for A in moments]) == samples(moments) > 1001


def test_default_samples_follow_a_body_in_space() -> None:
    """Where its herpolhode fills a figure, a corner of 12 degrees is seen."""
    case = {
        "model": "linear-diag", "inertia": [12.4, 9.1, 5.3], "damping": 0,
        "initial": {"p": 0.6, "q": 0.5, "r": 0.9}, "time": {"end": 200},
    }  # fmt: skip
    motion = hodo_cli.run(case | {"attitude": "yes"})
    speed = np.linalg.norm(motion.omega, axis=-1).max()
    assert np.degrees(speed * np.diff(motion.time).max()) < 6
    assert Case.of(case).time.samples < motion.sizes["time"]
