"""Whether formulas of a user's own may hide what they do in time from steps that are taken side by
side, of which few places are compared with the equations."""

import math
from dataclasses import dataclass
from typing import Any

from .. import HodoError
from ..arithmetic import exp
from ..models.base import Model, attributes, has_formula_of_time


@dataclass(frozen=True)
class TimeInRates:
    """What passes for the time in equations, and tells how high a power of it they hold, and the
    slope of what is linear in it: nan of all else.

    Sines, exponentials that fall and negative powers of what is linear count as numbers, since no
    point of theirs is without a trace of the others. What else is no sum or product is a TypeError
    or an AttributeError.
    """

    power: int = 1
    slope: float = 1.0
    __array_ufunc__ = None  # number * TimeInRates must not be taken apart by numpy

    def __add__(self, other: Any) -> "TimeInRates":
        of_other = as_time(other)
        return TimeInRates(max(self.power, of_other.power), self.slope + of_other.slope)

    def __mul__(self, other: Any) -> "TimeInRates":
        if isinstance(other, TimeInRates):
            return TimeInRates(self.power + other.power, math.nan)
        return TimeInRates(self.power, self.slope * other)

    def __pow__(self, exponent: float) -> "TimeInRates":
        if math.isnan(self.slope) or exponent > 1:
            raise TypeError
        return self.sin()

    def exp(self) -> "TimeInRates":
        if not self.slope <= 0:
            raise TypeError
        return self.sin()

    def sin(self) -> "TimeInRates":
        if self.power > 1:
            raise TypeError
        return TimeInRates(0, math.nan)

    __radd__, __rmul__, cos = __add__, __mul__, sin
    __neg__, __pos__ = (lambda x: x * -1.0), (lambda x: x)
    __sub__, __rsub__ = (lambda x, y: x + -y), (lambda x, y: -x + y)
    __truediv__, __rtruediv__ = (lambda x, y: x * y**-1), (lambda x, y: x**-1 * y)
    __rpow__ = lambda x, base: exp(x * math.log(base))  # noqa: E731


def as_time(rate: Any) -> TimeInRates:
    """A rate, or a number, which holds no time."""
    return rate if isinstance(rate, TimeInRates) else TimeInRates(0, 0.0)


def may_hide_in_time(system: Model) -> bool:
    """Whether a Taylor series may not know at the start of a step what a user's formulas of the
    time do within it: a pulse leaves no trace far from it, nor does t**2 in the orders that choose
    a step at t = 0."""
    if not has_formula_of_time(system):
        return False
    # Of a state that is no number, so that the sign of no slope follows from it.
    y, k = [math.nan] * len(system.equations.state), attributes(system.constants)
    try:
        return max(as_time(rate).power for rate in system.equations.rhs(TimeInRates(), y, k)) > 1
    except (TypeError, AttributeError, ValueError, ArithmeticError, HodoError):
        return True
