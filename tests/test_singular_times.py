"""Formulas in t that are infinite, or no number, at a time, and narrow ones that are neither."""

import math
import re

import pytest

import hodo_cli as hodo

BODY = {"model": "torques", "inertia": [2, 1.5, 1], "initial": {"p": 0, "q": 0, "r": 1}}


def spun_up(torque):
    """The motion about x3 under a torque about it."""
    case = {**BODY, "expression": [0, 0, torque], "time": {"end": 10, "samples": 11}}
    return hodo.run(case)


@pytest.mark.parametrize(
    ("torque", "last"),
    [
        ("0.1/sqrt(abs(t-3.3333))", 3),
        ("0.1*exp(-log(abs(t-3.3333))/3)", 3),
        ("0.1/(t-5.0001234)**2", 5),
        ("0.1/(t-5)", 4),
        ("0.1*sqrt(5-t)", 4),
    ],
)
def test_motions_end_where_formulas_are_infinite_or_no_number(torque, last):
    """An integral over the place may exist: no method is right there to what hodo promises."""
    ds = spun_up(torque)
    assert ds.attrs["status"] == "failed"
    assert re.match("its formulas are not smooth near t = [35]", ds.attrs["message"])
    assert float(ds.time[-1]) == last
    assert math.isfinite(ds.omega.values.sum())


@pytest.mark.parametrize("width", [1e-3, 1e-5])
def test_motions_pass_a_narrow_peak(width):
    """A peak of a width that the rounding of the time is a billionth of."""
    ds = spun_up(f"1e-3/((t-5.0001)**2+{width**2})")
    impulse = 1e-3 / width * (math.atan(4.9999 / width) + math.atan(5.0001 / width))
    gained = float(ds.omega[-1, 2]) - 1
    assert gained == pytest.approx(impulse, rel=2 * ds.attrs["error"])
    assert ds.attrs["error"] < 1e-10
