"""Columns of numbers that pass for one number: the functions that prepare a case from its data
prepare many cases at once."""

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np


class BranchDivergence(Exception):
    """The members of a column take two branches; `where` (n,) is True of the first."""

    def __init__(self, where: np.ndarray) -> None:
        super().__init__()
        self.where = where


def _agreed(answers: np.ndarray) -> bool:
    """The answer that all members give."""
    if answers.any() and not answers.all():
        raise BranchDivergence(answers)
    return bool(answers.all())


def _kept(values: np.ndarray) -> "Column":
    """A column of results. Where one is not finite, a plain number may raise an exception."""
    if not _agreed(np.isfinite(values)):
        raise TypeError("a column holds finite numbers only")
    return Column(values)


def _operator(operation: Callable[[Any, Any], Any], then: Callable[[np.ndarray], Any]) -> Any:
    """An operator with a column on its left, and with one on its right."""

    def result(left: Any, right: Any) -> Any:
        if not all(isinstance(x, Column | float | int) for x in (left, right)):
            return NotImplemented
        return then(operation(of_members(left), of_members(right)))

    return result, lambda right, left: result(left, right)


class Column:
    """A finite number of each of n members, which passes for a number of one.

    Its arithmetic is that of Python's floats, bit for bit. BranchDivergence is raised where a
    comparison has two answers, or where some members have no finite result: the members are then to
    be taken in two parts. Nothing else can be done with it, and arrays refuse it: what would count
    or mix members is a TypeError.
    """

    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    __add__, __radd__ = _operator(operator.add, _kept)
    __sub__, __rsub__ = _operator(operator.sub, _kept)
    __mul__, __rmul__ = _operator(operator.mul, _kept)
    __truediv__, __rtruediv__ = _operator(operator.truediv, _kept)
    # Python turns a comparison round where the column is on its right.
    __lt__ = _operator(operator.lt, _agreed)[0]
    __le__ = _operator(operator.le, _agreed)[0]
    __gt__ = _operator(operator.gt, _agreed)[0]
    __ge__ = _operator(operator.ge, _agreed)[0]
    __eq__ = _operator(operator.eq, _agreed)[0]
    __ne__ = _operator(operator.ne, _agreed)[0]

    def __pow__(self, exponent: Any) -> Any:
        return power(self, exponent)

    def __rpow__(self, base: Any) -> Any:
        return power(base, self)

    def __neg__(self) -> "Column":
        return Column(-self.values)

    def __abs__(self) -> "Column":
        return Column(np.abs(self.values))

    def __bool__(self) -> bool:
        return _agreed(self.values != 0)


def of_members(x: Any) -> Any:
    """The numbers (n,) of a column; a plain number as it is."""
    return x.values if isinstance(x, Column) else float(x)


def _elementwise(function: Callable[..., float]) -> Callable[..., Any]:
    """A function of numbers that takes columns too."""

    def number(*x: float) -> float:
        try:
            return function(*x)
        except (ValueError, ArithmeticError):
            return math.nan

    def applied(*x: Any) -> Any:
        if not any(isinstance(value, Column) for value in x):
            return function(*x)
        # Number by number: numpy's own functions differ from these in the last bit.
        numbers = (column.tolist() for column in np.broadcast_arrays(*map(of_members, x)))
        return _kept(np.array(list(map(number, *numbers))))

    return applied


sqrt, sin, cos = _elementwise(math.sqrt), _elementwise(math.sin), _elementwise(math.cos)
hypot, power = _elementwise(math.hypot), _elementwise(math.pow)


def isfinite(x: Any) -> bool:
    """Whether a number is finite, as all of a column are."""
    return isinstance(x, Column) or math.isfinite(x)


def as_numpy_float(x: Any) -> Any:
    """A number whose arithmetic has infinite results where Python's raises exceptions."""
    return x if isinstance(x, Column) else np.float64(x)


def as_float(x: Any) -> Any:
    """The same as a plain number again."""
    return x if isinstance(x, Column) else float(x)
