"""Whether formulas of a user's own may change within steps that are taken side by side, where no
step is compared with its equations."""

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from .. import HodoError
from ..arithmetic import exp
from ..cases.case import Case
from ..integration import solve
from ..models.base import Model, attributes, has_formula_of_time
from .columns import shape
from .members import members_as_cases, system_of_member

CHECKED_MEMBERS = 16
"""Members drawn at random that are integrated with a check of their steps."""


class Traced:
    """What passes for a number in equations, to tell how these hold it: by its sum, product, power
    and exponential."""

    __array_ufunc__ = None  # number * Traced must not be taken apart by numpy

    def __pos__(self: Any) -> Any:
        return self

    def __neg__(self: Any) -> Any:
        return self * -1.0

    def __sub__(self: Any, other: Any) -> Any:
        return self + -other

    def __rsub__(self: Any, other: Any) -> Any:
        return -self + other

    def __truediv__(self: Any, other: Any) -> Any:
        return self * other**-1

    def __rtruediv__(self: Any, number: float) -> Any:
        return self**-1 * number

    def __rpow__(self: Any, base: float) -> Any:
        return exp(self * math.log(base))


@dataclass(frozen=True)
class TimeInRates(Traced):
    """What passes for the time in equations, and tells how high a power of it they hold, and the
    slope of what is linear in it: nan of all else.

    Sines, exponentials that fall and negative powers of what is linear count as numbers, since no
    point of theirs is without a trace of the others. What else is no sum or product is a TypeError
    or an AttributeError.
    """

    power: int = 1
    slope: float = 1.0

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


class Corner(Exception):
    """Equations hold |x|."""


@dataclass(frozen=True)
class Factors(Traced):
    """What passes for a variable in equations: its value at one place, and the exponent of each of
    its factors that may change sign, by the size of that factor there.

    Raises Corner for |x|: for a power of an even power of x that is no even one.
    """

    value: float
    exponents: Mapping[float, float]

    @property
    def is_square(self) -> bool:
        """Whether no place is known where it is negative."""
        return self.value >= 0 and all(n % 2 == 0 for n in self.exponents.values())

    def __add__(self, other: Any) -> "Factors":
        of_other = as_factors(other)
        # What is nothing here, as the 0 with which `sum` begins, brings no factor.
        if not self.value or not of_other.value:
            return self if self.value else of_other
        value = self.value + of_other.value
        a, b = self.exponents, of_other.exponents
        lower = {size: min(a.get(size, 0), b.get(size, 0)) for size in a.keys() | b.keys()}
        common = Factors(value, {size: n for size, n in lower.items() if n})
        # No motion comes to the zeros of a sum of two squares but by accident.
        if self.is_square and of_other.is_square:
            return common
        rest = value / math.prod(size**n for size, n in common.exponents.items())
        return common * Factors(1.0, {abs(rest): 1})

    def __mul__(self, other: Any) -> "Factors":
        of_other = as_factors(other)
        a, b = self.exponents, of_other.exponents
        exponents = {size: a.get(size, 0) + b.get(size, 0) for size in a.keys() | b.keys()}
        return Factors(self.value * of_other.value, exponents)

    def __pow__(self, exponent: float) -> "Factors":
        if any(n % 2 == 0 and n * exponent % 2 for n in self.exponents.values()):
            raise Corner
        size = abs(self.value) ** exponent
        value = math.copysign(size, self.value) if exponent % 2 else size
        return Factors(value, {of: n * exponent for of, n in self.exponents.items()})

    def sqrt(self) -> "Factors":
        return self**0.5

    def exp(self) -> "Factors":
        return Factors(math.exp(math.sin(self.value)), {})  # any value that tells it from others

    def sin(self) -> "Factors":
        return factor(math.sin(self.value))

    def cos(self) -> "Factors":
        return factor(math.cos(self.value))

    def log(self) -> "Factors":
        if any(n and n % 2 == 0 for n in self.exponents.values()):
            raise Corner  # half of log(p**2) is the logarithm of |p|
        return factor(math.log(abs(self.value)))

    __radd__, __rmul__ = __add__, __mul__


def factor(value: float) -> Factors:
    """What is no product, by its value."""
    return Factors(value, {abs(value): 1})


def as_factors(x: Any) -> Factors:
    """What passes for a variable, or a number."""
    return x if isinstance(x, Factors) else Factors(float(x), {})


def may_have_corner(system: Model) -> bool:
    """Whether equations hold |x|, written as the root of a square, or something of which that is
    not known."""
    # Any numbers serve that no formula makes equal; sums of these are exact in any order.
    values = (
        np.random.default_rng(0).integers(2**18, 2**20, 1 + len(system.equations.state)) / 2**20
    )
    t, *y = map(factor, values.tolist())
    try:
        system.equations.rhs(t, y, attributes(system.constants))
    except (Corner, TypeError, AttributeError, ValueError, ArithmeticError, HodoError):
        return True
    return False


@lru_cache(maxsize=16)
def formulas_may_change(case: Case) -> bool:
    """Whether the formulas in the equations of a sweep may change within steps of its members: by
    what they are as functions of the time, by a corner that they name, which few members may come
    to, and by a check of some members.

    For all members alike, so that the result does not depend on their order and on the chunks.
    """
    if may_hide_in_time(case.system) or may_have_corner(case.system):
        return True
    # Seeded by the number of members, as the sample whose errors are measured.
    total = math.prod(shape(case))
    drawn = np.random.default_rng(total).choice(total, min(CHECKED_MEMBERS, total), replace=False)
    for single in members_as_cases(case, drawn, samples=2):
        with suppress(HodoError):
            if system_of_member(case, single.data) and solve(single, "taylor").restarts:
                return True
    return False
