"""The crossings that the program finds, against every root of the reference series."""

from pathlib import Path

import pytest
import series
from conftest import classified

from hodo_cli.cases.config import load

PAPER1 = load(Path(__file__).parents[1] / "configs" / "paper1.yaml").cases


def by_program(case):
    """The crossings, and the relative error that their times may have."""
    motion, classification = classified(case)
    # Without heyoka DOP853 is right to some 1e-11, and a time is up to a thousand times worse
    # conditioned than a state.
    return classification.crossings, 1e-12 if motion.method in ("taylor", "exact") else 1e-8


def by_reference(A, system, largest, start, end):
    """The crossings, with as many bits as the decay at the `largest` rate costs besides."""
    return series.crossings(A, system, start, end, bits=128 + round(1.5 * largest * end))


def rows(resistance):
    """The tensor that a case file gives in full or by its two different entries."""
    if isinstance(resistance, tuple):
        return resistance
    entries = resistance["diagonal"], resistance["off_diagonal"]
    return [[entries[i != j] for j in range(3)] for i in range(3)]


def axes(crossings):
    return [(crossing.start, crossing.end) for crossing in crossings]


@pytest.mark.parametrize("name", PAPER1)
def test_crossings_of_the_figures(name):
    case = PAPER1[name]
    A, start = case.data["inertia"], case.system.start
    if "damping" in case.data:
        damping = case.data["damping"]
        system, largest = series.diagonal(A, damping), max(damping)
    else:
        tensor = rows(case.data["resistance"])
        system, largest = series.tensor(A, tensor), max(map(max, tensor))
    expected = by_reference(A, system, largest, start, case.time.end)
    crossings, tolerance = by_program(case)
    assert axes(crossings) == [(c.before, c.after) for c in expected]
    for crossing, exact in zip(crossings, expected, strict=True):
        assert abs(crossing.time - exact.time) <= tolerance * exact.time
        assert abs(crossing.momentum - exact.momentum) <= 10 * tolerance * exact.momentum
