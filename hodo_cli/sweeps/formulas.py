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
    """What passes for the time in equations, and tells the slope of what is linear in it: nan of
    all else.

    Of polynomials, and of sines, exponentials that fall and negative powers of what is linear, no
    point is without a trace of the others. What else is no sum or product is a TypeError or an
    AttributeError.
    """

    slope: float = 1.0

    def __add__(self, other: Any) -> "TimeInRates":
        return TimeInRates(self.slope + (other.slope if isinstance(other, TimeInRates) else 0.0))

    def __mul__(self, other: Any) -> "TimeInRates":
        return TimeInRates(math.nan if isinstance(other, TimeInRates) else self.slope * other)

    def __neg__(self) -> "TimeInRates":
        return self * -1.0

    def __sub__(self, other: Any) -> "TimeInRates":
        return self.__add__(-other)

    def __rsub__(self, other: Any) -> "TimeInRates":
        return self.__neg__().__add__(other)

    def __pow__(self, exponent: float) -> "TimeInRates":
        if exponent < 0:
            return self.sin()
        if exponent != int(exponent):
            raise TypeError
        return TimeInRates(math.nan)

    def __truediv__(self, other: Any) -> "TimeInRates":
        return self.__mul__(other**-1)

    def __rtruediv__(self, number: float) -> "TimeInRates":
        return self**-1 * number

    def __rpow__(self, base: float) -> "TimeInRates":
        return (self * math.log(base)).exp()

    def exp(self) -> "TimeInRates":
        if self.slope > 0:
            raise TypeError
        return self.sin()

    def sin(self) -> "TimeInRates":
        if math.isnan(self.slope):
            raise TypeError
        return TimeInRates(math.nan)

    __radd__, __rmul__, cos = __add__, __mul__, sin


def may_hide_in_time(system: Model) -> bool:
    """Whether a Taylor series may not know at the start of a step what a user's formulas of the
    time do within it: a pulse leaves no trace far from it."""
    if not has_formula_of_time(system):
        return False
    # Of a state that is no number, so that the sign of no slope follows from it.
    y, k = [math.nan] * len(system.state), attributes(system.constants)
    try:
        system.rhs(TimeInRates(), y, k)
    except (TypeError, AttributeError, ValueError, ArithmeticError, HodoError):
        return True
    return False


def has_corner(tree: Any) -> bool:
    """Whether a formula, as `parse_expression` reads it, holds |x|: the root of a square."""
    match tree:
        case ("sqrt", (_, *_) as argument) if is_square(argument):
            return True
        case (_, *arguments):
            return any(map(has_corner, arguments))
    return False


def is_square(tree: Any) -> bool:
    """Whether a formula is an even power, the product of one with itself, or of such and numbers.

    A sum of two squares is none: no motion comes to its zeros but by accident.
    """
    match tree:
        case ("**", _, exponent):
            return bool(exponent % 2 == 0)
        case ("*", first, second):
            return first == second or (is_square(first) and is_square(second))
    return isinstance(tree, float)


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
