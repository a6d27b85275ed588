"""Times at which formulas of a user's own change at once, over which a motion goes straight on."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..engines.units import Clock, Units
from ..models.base import Model, attributes, stacked
from ..text import time_text

CHANGE_PARTS, CHANGE_ROUNDS = 64, 5
"""The parts of a gap in which formulas change at once, and how often one of them is divided again,
to find where."""

MOST_GROWTH = 1.25
"""How much larger rates may be eight times as near to that place: at a jump they are not, at a pole
eight times."""

HELD_WITHIN = 1e-9
"""The part of a state beside which a component of it is at 0."""

HELD, NOT_SMOOTH = "held at ", "its formulas are not smooth near t = "
"""How the messages begin of motions that no method leads on, because of what their formulas do."""


class Break(NamedTuple):
    """A time near to which formulas change at once, by where the motion goes straight on and from
    where on."""

    onward: float
    time: float


NO_BREAK = Break(math.inf, math.inf)


def rates(system: Model, units: Units, clock: Clock, t: Any, y: np.ndarray) -> np.ndarray:
    """The rates by the engine's time of states y (m, ...) in some units, at times (...) of the
    case."""
    equations = system.equations
    k = attributes(units.constants(equations, system.constants), y.dtype.type)
    by_time = stacked(equations.rhs(t, [*y], k), y)
    # The degrees of constants give rates by the engine's time; without them it is told.
    return np.asarray(by_time if equations.degree else by_time / y.dtype.type(clock.factor))


def not_smooth(time: float, start: float) -> str:
    """The message of a motion whose steps no method leads on from some time."""
    return f"{NOT_SMOOTH}{time_text(time, start)}"


@dataclass
class Gap:
    """A short time `length` of the engine from a state y (m,) on, within which formulas change at
    once: the motion goes on by the rates `before`, and `behind` the change by others."""

    system: Model
    units: Units
    clock: Clock
    y: np.ndarray
    length: Any

    def rates_at(self, parts: Any, slope: np.ndarray) -> np.ndarray:
        """The rates (m, k) at parts (k,) of the gap, if the motion goes along a slope (m,)."""
        s = self.length * np.atleast_1d(parts).astype(self.y.dtype)
        along = self.y[:, None] + np.outer(slope, s)
        return rates(self.system, self.units, self.clock, self.clock.exact(s), along)

    @cached_property
    def before(self) -> np.ndarray:
        """The rates (m,) of the present, or those behind the change: at the change itself, as a
        motion may begin, a formula may be no number."""
        present, later = self.rates_at([0, 1], 0 * self.y).T
        return np.asarray(present if np.isfinite(present.astype(float)).all() else later)

    @cached_property
    def behind(self) -> np.ndarray:
        """The rates (m,) at the end."""
        return self.rates_at(1, self.before)[:, 0]

    @cached_property
    def change(self) -> Any:
        """The part of the gap at which the rates change from those before to those behind."""
        at, width = self.y.dtype.type(0), 1.0
        for _ in range(CHANGE_ROUNDS):
            parts = at + width * np.linspace(0, 1, CHANGE_PARTS + 1).astype(self.y.dtype)
            along = self.rates_at(parts, self.before)
            new, old = (np.abs(along - r[:, None]).sum(axis=0) for r in (self.behind, self.before))
            at, width = parts[max(int((new < old).argmax()) - 1, 0)], width / CHANGE_PARTS
        return at

    def states_after(self, elapsed: np.ndarray) -> np.ndarray:
        """The states (n, m) some times (n,) of the engine behind the start of the gap."""
        earlier = np.minimum(elapsed, self.length * self.change)
        later = np.outer(elapsed - earlier, self.behind)
        return np.asarray(self.y + np.outer(earlier, self.before) + later)

    def problem(self, start: float) -> str:
        """Why no motion goes on from here, in words that count the time from a start; an empty
        string if one does."""
        time = float(self.clock.high)
        if held := self.held():
            return f"{HELD}{held} = 0 by its expression at t = {time_text(time, start)}"
        sides = (float(self.change) + d * np.array([-1, 1]) for d in (1 / 16, 1 / 2))
        near, far = (np.abs(self.rates_at(x, self.before).astype(float)) for x in sides)
        if np.nanmax(near) <= MOST_GROWTH * np.nanmax(far):
            return ""
        place = float(self.clock.exact(self.length * self.change))
        grain = float(self.length) / self.clock.factor / CHANGE_PARTS
        return not_smooth(grain * round(place / grain), start)

    def held(self) -> str:
        """The components of the angular velocity, or all of it, that the rates lead back to 0 from
        both sides; an empty string if there are none."""
        if not self.system.starts_with_omega:
            return ""
        y = self.y.astype(float)
        ways = np.maximum(4 * np.abs(y), HELD_WITHIN * np.abs(y).max()) * np.eye(len(y))
        names = [f"omega_{i + 1}" for i in range(3) if self.leads_back(ways[i])]
        whole = np.where(np.arange(len(y)) < 3, 4 * y, 0)
        return " = ".join(names or ["omega"] * self.leads_back(whole))

    def leads_back(self, way: np.ndarray) -> bool:
        """Whether the rates lead the state back to 0 along a way (m,), from both sides of it and
        however near."""
        y = self.y.astype(float)
        beside = np.where(way == 0, y, 0)[:, None] + np.outer(way, [1, 1 / 16, -1 / 16, -1])
        times = np.full(4, self.clock.high, dtype=float)
        outer, inner, inner_behind, outer_behind = way @ rates(
            self.system, self.units, self.clock, times, beside
        )
        is_jump = 2 * inner < outer < inner / 2 < 0 < inner_behind / 2 < outer_behind
        is_near = abs(way @ y) <= 2 * float(self.length) * abs(inner)
        return bool(is_jump and is_near and outer_behind < 2 * inner_behind)
