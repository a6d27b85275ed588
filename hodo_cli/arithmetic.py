"""Functions for everything that equations take as a number, and columns of numbers, which prepare
many cases at once by the code for one.

A model takes `sin`, `cos`, `exp`, `log`, `sqrt` and `abs` from here, so that numbers, arrays in any
precision, complex steps, power series and an engine's symbols all pass through its equations.
"""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from . import HodoError

SYMBOLS: dict[type, ModuleType | SimpleNamespace] = {}
"""The functions of an engine's symbols, by the symbols' type; the engine adds them."""


class BranchDivergence(Exception):
    """The members of a column take two branches; `where` (n,) is True for the first branch."""

    def __init__(self, where: np.ndarray) -> None:
        super().__init__()
        self.where = where


def _common_answer(answers: np.ndarray) -> bool:
    """The answer that all members give. Raises BranchDivergence if they differ."""
    if answers.any() and not answers.all():
        raise BranchDivergence(answers)
    return bool(answers.all())


def _finite_column(values: np.ndarray) -> "Column":
    """A column of results, all of which must be finite, because plain numbers may raise an
    exception where they are not. Raises BranchDivergence if only some are finite, and TypeError if
    none is."""
    if not _common_answer(np.isfinite(values)):
        raise TypeError("a column holds finite numbers only")
    return Column(values)


OPERATORS = {
    *(np.add, np.subtract, np.multiply, np.divide, np.negative, np.absolute),
    *(np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal),
}
"""The operators of numpy that give the digits of Python's operators; numpy's power does not."""


class Column(np.lib.mixins.NDArrayOperatorsMixin):
    """One finite number for each of n members, which can be used as a single number.

    Its arithmetic is that of Python's floats, bit for bit. BranchDivergence is raised where a
    comparison has two answers, or where some members have no finite result: the members then have
    to be taken in two groups. Every other use, which would count or mix members, is a TypeError,
    and arrays refuse a column.
    """

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def __array_ufunc__(self, operation: np.ufunc, method: str, *operands: Any, **_: Any) -> Any:
        # A number on the left of a comparison arrives as an array without dimensions.
        numbers = [x[()] if isinstance(x, np.ndarray) else x for x in operands]
        if not all(isinstance(x, Column | float | int) for x in numbers):
            return NotImplemented
        if operation is np.power:
            return power(*numbers)
        if operation not in OPERATORS or method != "__call__":
            return NotImplemented
        result = operation(*map(member_values, numbers))
        return _common_answer(result) if result.dtype == bool else _finite_column(result)

    def __bool__(self) -> bool:
        return _common_answer(self.values != 0)


def member_values(x: Any) -> Any:
    """The numbers (n,) of a column; a plain number as a float."""
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
        numbers = (column.tolist() for column in np.broadcast_arrays(*map(member_values, x)))
        return _finite_column(np.array(list(map(number, *numbers))))

    return applied


def at_once(function: Callable[..., Sequence[Any]], *x: Any) -> Sequence[Any]:
    """The results of a function of numbers or arrays, for numbers or for columns; it is called
    once, with an array (n,) of the members for each column."""
    if not any(isinstance(value, Column) for value in x):
        return function(*x)
    return [*map(_finite_column, function(*map(member_values, x)))]


hypot, power = _elementwise(math.hypot), _elementwise(math.pow)


def _function(name: str) -> Callable[[Any], Any]:
    """The function of this name for any type of number."""
    of_number, of_array = _elementwise(getattr(math, name)), getattr(np, name)

    def applied(x: Any) -> Any:
        # Before the plain numbers: a float64 is one, but has infinite results and no exceptions.
        if isinstance(x, np.ndarray | np.generic | complex):
            return of_array(x)
        if isinstance(x, Column | float | int):
            try:
                return of_number(x)
            except ValueError:  # nan as of an array, so that only the motion that comes there fails
                return math.nan
            except OverflowError:  # only exp overflows; 1/(1 + exp(x)) has its limit, 0, there
                return math.inf
        # An engine's symbol is taken by its library's functions; a power series has methods.
        functions = SYMBOLS.get(type(x))
        return getattr(functions, name)(x) if functions else getattr(x, name)()

    return applied


sin, cos, exp, log, sqrt, tanh = map(_function, ("sin", "cos", "exp", "log", "sqrt", "tanh"))


def abs(x: Any) -> Any:
    """|x| of a number, a column or an array; of a complex step x or -x, by the sign of its real
    part.

    Raises HodoError for a power series and for an engine's symbol, because a series passes a corner
    without any sign of it, and the motion after it is wrong.
    """
    if np.iscomplexobj(x):
        return np.where(np.real(x) < 0, -x, x)
    if hasattr(x, "__abs__"):
        return operator.abs(x)
    raise HodoError(
        "abs has a corner, which no Taylor series passes: write it without abs, or let a state"
        " variable of rate 0 have the sign, which an event reverses"
    )


def evaluate(tree: Any, values: Mapping[str, Any]) -> Any:
    """The value of an expression's tree, as `schema.expression` reads it, with these values of its
    variables: numbers of any type.

    A whole power is a product, because a series with first coefficient 0 has no other power.
    """
    match tree:
        case str():
            return values[tree]
        case (name, *arguments):
            return OPERATIONS[name](*(evaluate(argument, values) for argument in arguments))
    return tree


def whole_power(x: Any, n: int) -> Any:
    """x to the power of a whole number, by squaring."""
    if n < 0:
        return 1.0 / whole_power(x, -n)
    if n < 2:
        return x if n else 1.0
    half = whole_power(x, n // 2)
    return half * half * x if n % 2 else half * half


def size_of(x: Any) -> Any:
    """|x| in an expression; for a series and an engine's symbol it is sqrt(x x), which has no
    series at the corner itself."""
    is_plain = isinstance(x, Column | float | int | np.ndarray | np.generic)
    return abs(x) if is_plain else sqrt(x * x)


OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": whole_power,
    "neg": operator.neg,
    "sqrt": sqrt,
    "sin": sin,
    "cos": cos,
    "exp": exp,
    "log": log,
    "abs": size_of,
    "tanh": tanh,
}
"""The operations of an expression, by the words of its tree."""


def isfinite(x: Any) -> bool:
    """Whether a number is finite; all numbers of a column are."""
    return isinstance(x, Column) or math.isfinite(x)


def horner(c: Sequence[Any] | np.ndarray, x: Any) -> Any:
    """c[0] + c[1] x + ... by Horner's scheme."""
    result = c[-1]
    for coefficient in c[-2::-1]:
        result = coefficient + x * result
    return result
