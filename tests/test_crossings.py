"""The crossings that the program finds, against every root of the reference series."""

from pathlib import Path

import numpy as np
import pytest
import series
from conftest import classified
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hodo_cli import Case
from hodo_cli.cases.case import Time
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


EACH_MODEL = ["fig4", "fig12"]


@pytest.mark.parametrize(
    "name",
    [*EACH_MODEL, *(name for name in PAPER1 if name not in EACH_MODEL)],
)
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


thousandths = st.integers(-1000, 1000).map(lambda n: n / 1000)
bodies = st.tuples(*[st.integers(200, 1000).map(lambda n: n / 1000)] * 3).filter(
    lambda A: 2 * max(A) <= sum(A)
)
dampings = st.tuples(*[st.integers(0, 200).map(lambda n: n / 10000)] * 3)


@pytest.mark.heyoka
@settings(max_examples=40)
@given(A=bodies, lam=dampings, start=st.tuples(*[thousandths] * 3))
def test_one_crossing_at_most_and_its_direction(A, lam, start):
    """Where D = 0, dD/dt = -2 (lambda_l - lambda_s) A_l (A_l - A_m) w_l^2, l and s of largest and
    smallest inertia."""
    largest, middle, smallest = sorted(range(3), key=lambda i: -A[i])
    outer = A[largest] * (A[largest] - A[middle]) * start[largest] ** 2
    inner = A[smallest] * (A[middle] - A[smallest]) * start[smallest] ** 2
    assume(abs(outer - inner) > 1e-9 * (outer + inner))  # else the first digit of the data decides
    data = {
        "inertia": A,
        "damping": lam,
        "initial": dict(zip("pqr", start, strict=True)) | {"G": None},
    }
    case = Case("random", "linear-diag", "full", data, Time(end=200.0, samples=11))
    crossings, tolerance = by_program(case)
    expected = by_reference(A, series.diagonal(A, lam), max(lam), start, 200)
    assert axes(crossings) == [(c.before, c.after) for c in expected]
    if crossings:
        (crossing,), (exact,) = crossings, expected
        ends = (
            (largest + 1, smallest + 1)
            if lam[largest] > lam[smallest]
            else (smallest + 1, largest + 1)
        )
        assert (crossing.start, crossing.end) == ends
        assert lam[largest] != lam[smallest]
        error = abs(crossing.time - exact.time)
        assert error <= tolerance * exact.time or error <= 30 * floor(A, lam, start)


def floor(A, lam, start):
    """What one ulp in each of the data does to the time of the one crossing, all told."""

    def time(*data):
        (crossing,) = by_reference(data[:3], data[3:6], data[6:], 200)
        return [crossing.time]

    return np.abs(series.one_ulp(time, (*A, *lam, *start))).sum()
