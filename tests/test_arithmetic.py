"""Columns pass for one number: same digits, same ways, and nothing that mixes members."""

import math
import operator
from collections.abc import Callable
from operator import add, mul, sub, truediv
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hodo_cli import arithmetic, functions

NUMBERS = st.lists(st.floats(0.1, 1e3), min_size=9, max_size=9)


@given(x=NUMBERS, y=NUMBERS)
@pytest.mark.parametrize(
    "function",
    [add, sub, mul, truediv, operator.pow, arithmetic.hypot, arithmetic.power],
)
def test_columns_have_the_digits_of_numbers(function, x, y):
    x[0], y[0] = 0.3, 2.5  # so that no power is too large
    x, y = ([min(each, 30.0) for each in values] for values in (x, y))
    a, b = arithmetic.Column(np.array(x)), arithmetic.Column(np.array(y))
    assert function(a, b).values.tolist() == list(map(function, x, y))
    assert function(a, 3).values.tolist() == [function(each, 3) for each in x]
    assert function(0.7, b).values.tolist() == [function(0.7, each) for each in y]
    assert function(np.float64(0.7), b).values.tolist() == [function(0.7, each) for each in y]


@given(x=NUMBERS)
def test_functions_of_columns_are_those_of_numbers(x: list[float]) -> None:
    a = arithmetic.Column(np.array(x))
    for name in ("sqrt", "sin", "cos"):
        of, same = getattr(arithmetic, name), getattr(math, name)
        assert of(a).values.tolist() == list(map(same, x))
        assert of(x[0]) == same(x[0])
    assert (-a).values.tolist() == [-each for each in x]
    assert abs(-a).values.tolist() == x
    assert arithmetic.isfinite(a)
    assert not arithmetic.isfinite(math.inf)
    assert (np.float64(1) * a).values.tolist() == x


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        (lambda x: x < 2, [True, False, False]),
        (lambda x: x >= 2, [False, True, True]),
        (lambda x: np.float64(2) > x, [True, False, False]),
        (lambda x: x == 3, [False, False, True]),
        (lambda x: max(x, 1.5), [False, True, True]),
        (lambda x: bool(x - 1), [False, True, True]),
        (lambda x: sorted((x, 2.5)), [False, False, True]),
    ],
)
def test_a_column_parts_where_its_members_go_two_ways(way, expected):
    with pytest.raises(arithmetic.BranchDivergence) as parted:
        way(arithmetic.Column(np.array([1.0, 2.0, 3.0])))
    assert parted.value.where.tolist() in (expected, [not each for each in expected])


WAYS = [lambda x: 1 / x, arithmetic.sqrt, lambda x: x**-1.5, lambda x: 10 ** (500 * x)]


@pytest.mark.parametrize("way", WAYS)
@np.errstate(all="ignore")
def test_a_column_parts_from_what_is_not_finite(way: Callable[[Any], Any]) -> None:
    with pytest.raises(arithmetic.BranchDivergence):
        way(arithmetic.Column(np.array([-1.0, 0.0, 1.0, 2.0])))
    with pytest.raises(TypeError, match="finite"):
        arithmetic.Column(np.array([1.0, 2.0])) * math.nan


@pytest.mark.parametrize(
    "way",
    [
        lambda x: np.array([1.0, 2.0, 3.0]) * x,
        lambda x: x * np.array([1.0, 2.0, 3.0]),
        lambda x: np.longdouble(2) * x,
        lambda x: [1] * x,
        lambda x: x + "1",
        lambda x: x < None,
        *(float, math.sin, np.sin, hash, len, list),
        lambda x: f"{x:g}",
        lambda x: np.isfinite(np.array([x, 1.0])),
        lambda x: np.linalg.norm([x, 1.0]),
        lambda x: np.array([x, 1.0], dtype=float),
    ],
)
def test_what_would_mix_members_is_refused(way: Callable[[Any], Any]) -> None:
    with pytest.raises(TypeError):
        way(arithmetic.Column(np.array([1.0, 2.0, 3.0])))


@pytest.mark.parametrize("number", [0.3, np.float64(0.3), np.longdouble(0.3), np.full(3, 0.3)])
def test_functions_of_numbers_and_arrays(number: Any) -> None:
    """Those that a model of a user's own has."""
    for name in ("sin", "cos", "exp", "log", "sqrt"):
        value = getattr(functions, name)(number)
        assert np.allclose(np.asarray(value, float), getattr(math, name)(0.3), rtol=1e-15)
        assert np.asarray(value).dtype == np.asarray(number).dtype
    assert np.all(functions.abs(-number) == number)
