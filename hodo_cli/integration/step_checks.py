"""A check of the steps of a motion where a user's formulas are in the equations; and the gaps that
lead a motion over the times at which such formulas change at once."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..engines.polynomial import TAYLOR, values_and_slopes
from ..engines.units import Clock, Units
from ..models.base import Model, attributes, kinds_of_variables, stacked
from ..text import time_text
from .steps import Steps

PARTS, ROUNDS = 128, 9
"""The parts of an interval in which a place is searched for, and how often one of them is divided
again: to the rounding of the time."""

MOST_GROWTH = 1.25
"""The largest growth of the rates from a place to one eight times as near to the change: it is 1 at
a jump, and 8 at a pole."""

HELD_WITHIN = 1e-9
"""The part of a state below which a component of it counts as 0."""

HELD, NOT_SMOOTH = "held at ", "its formulas are not smooth near t = "
"""The beginnings of the messages of motions that no method continues, because of their formulas."""


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


def narrowed(
    pick: Callable[[np.ndarray], Any], low: Any, width: Any, kept: int
) -> tuple[np.ndarray, int]:
    """The last places (PARTS + 1,) into which an interval is divided, and the number of the one
    that `pick` chooses among them. Each time the interval shrinks to the parts before and, if two
    are `kept`, after that place."""
    for _ in range(ROUNDS):
        places = low + width * np.linspace(0, 1, PARTS + 1).astype(np.result_type(low, 1.0))
        number = int(pick(places))
        low, width = places[max(number - 1, 0)], kept * width / PARTS
    return places, number


@dataclass
class Gap:
    """A short time `length` of the engine from a state y (m,) on, within which formulas change at
    once: the motion goes on by the rates `before`, and after the change by the rates `behind`."""

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
        """The rates (m,) of the present, or after the change: at the change itself, as a motion may
        begin, a formula may be no number."""
        present, later = self.rates_at([0, 1], 0 * self.y).T
        return np.asarray(present if np.isfinite(present.astype(float)).all() else later)

    @cached_property
    def behind(self) -> np.ndarray:
        """The rates (m,) at the end."""
        return self.rates_at(1, self.before)[:, 0]

    @cached_property
    def change(self) -> Any:
        """The part of the gap at which the rates change from `before` to `behind`."""

        def first_changed(parts: np.ndarray) -> Any:
            along = self.rates_at(parts, self.before)
            new, old = (np.abs(along - r[:, None]).sum(axis=0) for r in (self.behind, self.before))
            return (new < old).argmax()

        places, first = narrowed(first_changed, self.y.dtype.type(0), 1.0, 1)
        return places[max(first - 1, 0)]

    @cached_property
    def peak(self) -> Any:
        """The part of the gap at which the rates are largest, or first no number."""

        def largest(parts: np.ndarray) -> Any:
            return np.abs(self.rates_at(parts, self.before)).max(axis=0).argmax()

        places, at = narrowed(largest, self.y.dtype.type(0), 1.0, 2)
        return places[at]

    def states_after(self, elapsed: np.ndarray) -> np.ndarray:
        """The states (n, m) some times (n,) of the engine after the start of the gap."""
        earlier = np.minimum(elapsed, self.length * self.change)
        later = np.outer(elapsed - earlier, self.behind)
        return np.asarray(self.y + np.outer(earlier, self.before) + later)

    def problem(self, start: float) -> str:
        """Why no motion goes on from here, in words that count the time from a start; an empty
        string if one does."""
        time = float(self.clock.high)
        if held := self.held():
            return f"{HELD}{held} = 0 by its expression at t = {time_text(time, start)}"
        sides = (float(self.peak) + d * np.array([-1, 1]) for d in (1 / 16, 1 / 2))
        near, far = (np.abs(self.rates_at(x, self.before).astype(float)) for x in sides)
        # Rates that are no numbers at a place count for nothing.
        largest, before = (np.fmax.reduce(x, axis=None, initial=0) for x in (near, far))
        if largest <= MOST_GROWTH * before and np.isfinite(self.behind.astype(float)).all():
            return ""
        place = float(self.clock.exact(self.length * self.peak))
        grain = float(self.length) / self.clock.factor / PARTS
        return not_smooth(grain * round(place / grain), start)

    def held(self) -> str:
        """The components of the angular velocity, or all of it, that the rates lead back to 0 from
        both sides; an empty string if there are none."""
        if not self.system.starts_with_omega or "brake" in self.system.equations.terms:
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


POINTS_CHECKED, POINTS_AT_FIRST, POINTS_AT_ONCE = 1 << 15, 1 << 9, 1 << 13
"""Places of a span, evenly spaced, at which steps are compared with formulas, since what is shorter
may be overlooked; and those that are compared together, at first and at most."""

DEFECT = 1e-12
"""The least tolerance for the difference between the slopes of a step and the equations, relative
to the size of the state: far above the rounding of the comparison, far below the effect of a
pulse."""

GRAINS = 16
"""The same tolerance in rounding errors of the time, as parts of the longest step."""

ULPS_OF_TIME = 2
"""The error of the time within a step, in roundings."""

MOST_BREAKS, MOST_AT_ONE_PLACE, ONE_PLACE = 10_000, 64, 2.0**-16
"""How many breaks a motion may have, and how many of them within this part of its span."""

NEAR_POLE, AHEAD, FARTHER = 2.0**-27, 1e5, 1024
"""A step shorter than NEAR_POLE times the time since the start may lead to a pole, which is looked
for up to AHEAD such steps ahead. There the rates must fall by half of FARTHER at a distance FARTHER
times as large."""

SHORT, SHORT_STEPS, BESIDE, ULPS_BESIDE = 2.0**-46, 64, 2.0**-40, 8
"""A step is short if it is below SHORT times the time since the start. SHORT_STEPS of them approach
a place where the rates change at once: the motion is then led straight over that place, from BESIDE
times that time, or from ULPS_BESIDE roundings of the time."""


@dataclass
class StepCheck:
    """Compares the polynomials of steps with their equations all along. Where one begins to miss
    them the motion ends its stretch, and goes on to the gap `ahead`.

    A series knows a formula by its derivatives at the start of a step, and other methods by its
    values at some points: they pass a short pulse, and a series a corner too, without a trace. Cut
    again and again, a step is so short in the end that it misses nothing by a jump.
    """

    system: Model
    start: float
    span: float
    tol: float
    least_size: float
    """The least size of a state to which the error allowed is relative."""
    gaps: list[Break] = field(default_factory=list)
    short_steps: int = 0
    problem: str = ""
    """Why no method leads the motion on; empty as long as one does."""

    def begin(self) -> None:
        """The steps from here on are in other units."""
        self.longest, self.at_once = 0.0, POINTS_AT_FIRST

    @property
    def ahead(self) -> Break:
        """The gap that was found last."""
        return self.gaps[-1] if self.gaps else NO_BREAK

    def enough(self, length: float, elapsed: float) -> float:
        """How many steps are examined at once after one more of this length, in the case's time,
        which ends this time after the start."""
        self.longest = max(self.longest, length)
        self.short_steps = self.short_steps + 1 if length < SHORT * elapsed else 0
        return 0 if self.has_short_steps else self.at_once / self.points

    @property
    def has_short_steps(self) -> bool:
        """Whether steps have become so short that the rates change at once nearby."""
        return self.short_steps >= SHORT_STEPS

    @property
    def points(self) -> int:
        """The number of places at which each of the steps noted is compared."""
        return 8 + int(POINTS_CHECKED * self.longest / self.span)

    def examine(self, steps: Steps) -> int:
        """Compare steps with their equations; returns how many of them the motion takes."""
        # Nearer to each other towards the ends, where collocation has no points of its own.
        x = (1 - np.cos(np.pi * np.arange(self.points + 1) / self.points)) / 2
        missed = np.argwhere(~(self._excess(steps.in_double(), x) <= 1))
        right = int(missed[0, 0]) if missed.size else len(steps)
        elapsed = steps.times_at(np.ones(1))[:, 0] - self.start
        is_near = steps.lengths < NEAR_POLE * elapsed * steps.clock.factor
        for step in np.flatnonzero(is_near[: right + 1])[:1]:
            if self._meets_pole(steps, step):
                return int(step)
        if missed.size or self.has_short_steps:
            at = steps.ends[-1, 1]
            if missed.size:
                places = x[max(missed[0, 1] - 1, 0)], x[missed[0, 1]]
                at = self._onset(steps.chosen([right]), *places)
            starts = steps.times_at(np.zeros(1))[:, 0].astype(float)
            return self.pass_over(starts, float(steps.clock.exact_times(np.array([at]))[0]))
        self.longest = 0.0
        self.at_once = min(2 * self.at_once, POINTS_AT_ONCE)
        return right

    def _onset(self, step: Steps, low: float, high: float) -> Any:
        """The engine's time at which a step begins to miss its equations, between two parts of it.
        For a step by points, or one that misses them from its start, it is the time at which the
        rates bend most sharply: points on both sides of a change spoil the whole step."""

        def first_missed(places: np.ndarray) -> Any:
            return (~(self._excess(step, places)[0] <= 1)).argmax()

        def sharpest_bend(places: np.ndarray) -> Any:
            slopes = self._along(step, places)[2][:, 0]
            return np.abs(np.diff(slopes, 2)).max(axis=0).argmax() + 1

        is_onset = step.basis == TAYLOR and low < high
        places, at = (
            narrowed(first_missed, low, high - low, 1)
            if is_onset
            else narrowed(sharpest_bend, 0.0, 1.0, 2)
        )
        return step.ends[0, 0] + places[at] * step.lengths[0]

    def _meets_pole(self, steps: Steps, step: int) -> bool:
        """Whether the equations have a pole soon after a step begins. Near a pole the rates grow as
        the inverse of the distance, down to its rounding. A gap then leads over the pole."""
        clock, y = steps.clock, steps.chosen([step]).bernstein[0, :, :1].astype(float)

        def size(s: np.ndarray) -> Any:
            state, times = np.repeat(y, len(s), axis=1), clock.exact_times(s)
            return np.abs(rates(self.system, steps.units, clock, times, state)).max(axis=0)

        begin, width = steps.ends[step, 0], AHEAD * steps.lengths[step]
        places, largest = narrowed(lambda s: size(s).argmax(), begin, width, 2)
        ends = np.array([begin, places[largest]])
        first, pole = clock.exact_times(ends).astype(float)
        beside = 4 * np.spacing(abs(pole) + self.span) * clock.factor
        near, farther = size(places[largest] + beside * np.array([1, FARTHER]))
        is_pole = 2 * near > FARTHER * farther and pole <= self.start + self.span
        # Once: the steps up to the gap may be as short.
        if not is_pole or any(gap.time < pole < gap.onward for gap in self.gaps):
            return False
        self._note(Break(2 * pole - first, first))
        return True

    def pass_over(self, starts: np.ndarray, place: float) -> int:
        """Lead the motion straight over a time, in a short gap around it; returns how many steps
        with these `starts` (n,), in the case's time, are taken before."""
        near = BESIDE * ((place - self.start) or self.span)
        near = max(near, ULPS_BESIDE * np.spacing(abs(place)))
        taken = max(int(np.searchsorted(starts, place - near / 2, side="right")) - 1, 0)
        self._note(Break(place + near / 2, max([place - near / 2, *starts[taken : taken + 1]])))
        return taken

    def _note(self, gap: Break) -> None:
        """Let the motion go straight on over a gap."""
        self.gaps.append(gap)
        self.short_steps = 0
        aside = ONE_PLACE * self.span
        at_one_place = sum(abs(other.time - gap.time) < aside for other in self.gaps)
        if at_one_place > MOST_AT_ONE_PLACE or len(self.gaps) > MOST_BREAKS:
            self.problem = not_smooth(gap.time, self.start)

    @np.errstate(all="ignore")
    def _excess(self, steps: Steps, x: np.ndarray) -> np.ndarray:
        """How far steps miss their equations (n, k) at places x (k,): beyond 1 something has
        changed."""
        b, times, rated, slope = self._along(steps, x)
        missed = np.abs(slope - rated)
        # Between the ends of a step its polynomial has half of the digits at worst, and formulas
        # of seconds since an epoch, which are rounded, have fewer.
        grain = np.spacing(np.abs(times).max()) * steps.clock.factor
        longest = max(self.longest * steps.clock.factor, 1.0)
        parts = max(self.tol**0.5, GRAINS * grain / longest) * steps.lengths[:, None] / longest
        allowed = np.maximum(parts, max(DEFECT, 100 * self.tol))
        kinds, least = self.kinds, self.least_size
        sizes = [np.abs(b[:, kind]).max(axis=(1, 2)).clip(least)[:, None] for kind in kinds]

        def relative(missed: np.ndarray) -> np.ndarray:
            pairs = zip(kinds, sizes, strict=True)
            each = [missed[kind].max(axis=0) / (allowed * size) for kind, size in pairs]
            return np.asarray(np.max(each, axis=0))

        excess = relative(missed)
        if not (excess > 1).any():
            return excess
        # What the rounding of the time makes of a formula that changes fast is no miss.
        later = self._along(steps, x, ULPS_OF_TIME)[2]
        return relative(missed - np.abs(later - rated))

    @cached_property
    def kinds(self) -> list[np.ndarray]:
        """The positions of the state variables that have a size of their own together."""
        return kinds_of_variables(self.system.equations)

    def _along(self, steps: Steps, x: np.ndarray, later: int = 0) -> tuple[Any, ...]:
        """The Bernstein coefficients of steps, and at places x (k,) of these the times (n, k) of
        the case, some ulps `later`, and by x the slopes (m, n, k) of the equations and of the
        steps."""
        b = steps.bernstein
        state, slope = (part.swapaxes(0, 1) for part in values_and_slopes(b, x[None]))
        times = steps.times_at(x).astype(float)
        times += later * np.spacing(times)
        by_time = rates(self.system, steps.units, steps.clock, times, state)
        return b, times, steps.lengths[:, None] * by_time, slope
