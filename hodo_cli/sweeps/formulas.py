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
from .columns import shape
from .members import members_as_cases, system_of_member

CHECKED_MEMBERS = 16
"""Members drawn at random that are integrated with a check of their steps."""


@dataclass(frozen=True)
class PowerOfTime:
    """What passes for the time in equations, and tells how high a power of it they hold; all but
    sums, products, sines and cosines is a TypeError or an AttributeError. Sines count as the time:
    no point of theirs is without a trace of their rate."""

    power: int = 1

    def __add__(self, other: Any) -> "PowerOfTime":
        return PowerOfTime(max(self.power, power_in(other)))

    def __mul__(self, other: Any) -> "PowerOfTime":
        return PowerOfTime(self.power + power_in(other))

    def __truediv__(self, number: Any) -> "PowerOfTime":
        return self.__mul__(1.0 / number)

    def __neg__(self) -> "PowerOfTime":
        return self

    __radd__ = __sub__ = __rsub__ = __add__
    __rmul__, sin, cos = __mul__, __neg__, __neg__


def power_in(rate: Any) -> int:
    """The power of the time in a rate; 0 of a number."""
    return rate.power if isinstance(rate, PowerOfTime) else 0


def may_hide_in_time(system: Model) -> bool:
    """Whether a Taylor series may not know at the start of a step what a user's formulas of the
    time do within it: it knows what is linear in the time, and in sines and cosines of that. A
    pulse leaves no trace far from it, nor does t**2 in the orders that choose a step at t = 0."""
    if not has_formula_of_time(system):
        return False
    try:
        y = [0.3 + i / 11 for i in range(len(system.state))]  # nowhere special
        rates = system.rhs(PowerOfTime(), y, attributes(system.constants))
    except (TypeError, AttributeError, ValueError, ArithmeticError, HodoError):
        return True
    return max(map(power_in, rates)) > 1


@lru_cache(maxsize=16)
def formulas_may_change(case: Case) -> bool:
    """Whether the formulas in the equations of a sweep may change within steps of its members: by
    what they are as functions of the time, and by a check of some members.

    For all members alike, so that the result does not depend on their order and on the chunks.
    """
    if may_hide_in_time(case.system):
        return True
    # Seeded by the number of members, as the sample whose errors are measured.
    total = math.prod(shape(case))
    drawn = np.random.default_rng(total).choice(total, min(CHECKED_MEMBERS, total), replace=False)
    for single in members_as_cases(case, drawn, samples=2):
        with suppress(HodoError):
            if system_of_member(case, single.data) and solve(single, "taylor").restarts:
                return True
    return False
