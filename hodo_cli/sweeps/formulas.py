"""Whether formulas of a user's own may change within steps that are taken side by side, where no
step is compared with its equations."""

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..integration import solve
from ..models.base import Model, attributes, has_formula_of_time
from ..models.terms.torques import VARIABLES
from ..schema.expression import parse_expression
from .columns import shape
from .members import members_as_cases, system_of_member

CHECKED_MEMBERS = 16
"""Members drawn at random that are integrated with a check of their steps."""


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

    def __add__(self, other: Any) -> "TimeInRates":
        of_other = as_time(other)
        return TimeInRates(max(self.power, of_other.power), self.slope + of_other.slope)

    def __mul__(self, other: Any) -> "TimeInRates":
        if isinstance(other, TimeInRates):
            return TimeInRates(self.power + other.power, math.nan)
        return TimeInRates(self.power, self.slope * other)

    def __neg__(self) -> "TimeInRates":
        return self * -1.0

    def __sub__(self, other: Any) -> "TimeInRates":
        return self.__add__(-other)

    def __rsub__(self, other: Any) -> "TimeInRates":
        return self.__neg__().__add__(other)

    def __pow__(self, exponent: float) -> "TimeInRates":
        if math.isnan(self.slope) or exponent > 1:
            raise TypeError
        return self.sin()

    def __truediv__(self, other: Any) -> "TimeInRates":
        return self.__mul__(other**-1)

    def __rtruediv__(self, number: float) -> "TimeInRates":
        return self**-1 * number

    def __rpow__(self, base: float) -> "TimeInRates":
        return (self * math.log(base)).exp()

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
    y, k = [math.nan] * len(system.state), attributes(system.constants)
    try:
        return max(as_time(rate).power for rate in system.rhs(TimeInRates(), y, k)) > 1
    except (TypeError, AttributeError, ValueError, ArithmeticError, HodoError):
        return True


def has_corner(tree: Any) -> bool:
    """Whether a formula, as `parse_expression` reads it, holds |x|: the root of a square.

    A sum of two squares is none: no motion comes to its zeros but by accident.
    """
    match tree:
        case ("sqrt", (_, *_) as argument) if not odd_factors(argument):
            return True
        case (_, *arguments):
            return any(map(has_corner, arguments))
    return False


def odd_factors(tree: Any) -> set[Any]:
    """The factors of a formula, besides numbers, that it holds to an odd power."""
    match tree:
        case ("*" | "/", first, second):
            return odd_factors(first) ^ odd_factors(second)
        case ("**", base, exponent):
            return odd_factors(base) if exponent % 2 else set()
        case ("neg", argument):
            return odd_factors(argument)
    return set() if isinstance(tree, float) else {tree}


@lru_cache(maxsize=16)
def formulas_may_change(case: Case) -> bool:
    """Whether the formulas in the equations of a sweep may change within steps of its members: by
    what they are as functions of the time, by a corner that they name, which few members may come
    to, and by a check of some members.

    For all members alike, so that the result does not depend on their order and on the chunks.
    """
    texts = case.data.get("expression") or ()
    if may_hide_in_time(case.system) or any(
        has_corner(parse_expression(text, VARIABLES)) for text in texts
    ):
        return True
    # Seeded by the number of members, as the sample whose errors are measured.
    total = math.prod(shape(case))
    drawn = np.random.default_rng(total).choice(total, min(CHECKED_MEMBERS, total), replace=False)
    for single in members_as_cases(case, drawn, samples=2):
        with suppress(HodoError):
            if system_of_member(case, single.data) and solve(single, "taylor").restarts:
                return True
    return False
