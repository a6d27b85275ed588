"""A check of the steps of a motion whose equations hold formulas of a user's own."""

import bisect
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..engines.polynomial import bernstein_coefficients, values_and_slopes
from ..engines.protocol import Engine, Status, StepControl
from ..engines.units import Clock, Units
from ..models.base import Model, attributes, kinds_of_variables, stacked
from ..text import time_text
from .driver import StepBuffer

POINTS_CHECKED, POINTS_AT_ONCE = 1 << 15, 1 << 13
"""Places of a span, evenly spaced, at which steps are compared with formulas, since what is shorter
may be overlooked; and those that are compared together."""

DEFECT = 1e-12
"""By how much a step may miss its equations at least, relative to the size of the state: far above
the rounding of the comparison, far below what a pulse of a formula makes of a motion."""

GRAINS = 16
"""And by how many rounding errors of the time, as parts of the longest step: that is a few times as
long as a formula takes to change."""

SIZE_AT_REST = 1e-150
"""The least size of a state to which it is relative: a body at rest has none. Its square is a
double."""

UNRESOLVED, MISSED_THERE = 4, 1e-9
"""The length, in rounding errors of the time, of a step that is not to be cut, and what it may miss
its equations by: as much as a jump makes whose time is rounded, and no pole."""

PARTS, ROUNDS = 128, 3
"""The parts of an interval in which a step begins to miss its equations, and how often one of them
is divided again: a second step then ends within 1e-6 of that place."""

MOST_CUTS, MOST_AT_ONE_PLACE, ONE_PLACE = 10_000, 64, 2.0**-30
"""How many steps of a motion may be cut, and how many of them within this part of its span."""

SHORTEST = 2.0**-60
"""The part of the span below which a step is too short, where as many follow each other: they are
of a motion that comes ever nearer to a place where its rates jump."""

HELD, NOT_SMOOTH = "held at ", "its formulas are not smooth near t = "
"""How the message begins of a motion whose steps would be cut for ever: no method leads it on."""


@dataclass
class StepCheck(StepBuffer):
    """Compares the polynomials of steps with their equations all along, and cuts a step where it
    begins to miss them: at a time of `breaks`, from which the motion begins anew.

    A series knows a formula by its derivatives at the start of a step, and other methods by its
    values at some points: they pass a short pulse, and a series a corner too, without a trace. Cut
    again and again, a step is so short in the end that it misses nothing by a jump.
    """

    system: Model
    span: float
    tol: float
    control: StepControl
    breaks: list[float] = field(default_factory=list)
    too_short: int = 0

    def begin(self, engine: Engine, clock: Clock, units: Units) -> None:
        super().begin(engine, clock, units)
        self.longest, self.at_once, self.is_cut = 0.0, 512, False
        self.kinds = kinds_of_variables(type(self.system))

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        length = float(end - start)
        self.longest = max(self.longest, length)
        self.enough = self.at_once / self.points
        super().__call__(start, end, series)
        is_short = length < SHORTEST * self.span * self.clock.factor
        self.too_short = self.too_short + 1 if is_short else 0
        if self.too_short == MOST_AT_ONE_PLACE:
            self._give_up(start, series[:, 0])

    @property
    def points(self) -> int:
        """The number of places at which each of the steps noted is compared."""
        return 8 + int(POINTS_CHECKED * self.longest / self.clock.factor / self.span)

    def examine(self, ends: np.ndarray, series: np.ndarray) -> None:
        """Compare steps; those behind a cut are of another motion."""
        if self.is_cut:
            return
        # Nearer to each other towards the ends, where collocation has no points of its own.
        x = (1 - np.cos(np.pi * np.arange(self.points + 1) / self.points)) / 2
        missed = ~(self._excess(ends.astype(float), x, series.astype(float)) <= 1)
        if missed.any():
            step, first = np.argwhere(missed)[0]
            only = slice(step, step + 1)
            self._cut(ends[only], series[only], x[max(first - 1, 0)], x[first])
        self.longest = 0.0
        self.at_once = min(2 * self.at_once, POINTS_AT_ONCE)

    def _cut(self, ends: np.ndarray, series: np.ndarray, low: float, high: float) -> None:
        """Let a step end where it begins to miss its equations, between two parts of it; halfway
        to the later one if it misses them from its start."""
        for _ in range(ROUNDS):
            places = np.linspace(low, high, PARTS + 1)
            first = (~(self._excess(ends, places, series)[0] <= 1)).argmax()
            low, high = places[max(first - 1, 0)], places[first]
        start, length = ends[0, 0], ends[0, 1] - ends[0, 0]
        begin, at, end = self.clock.exact_times(start + np.array([0, low or high / 2, 1]) * length)
        cut = max(float(at), np.nextafter(float(begin), np.inf))
        bisect.insort(self.breaks, cut)
        self.is_cut = self.control.is_over = True
        here = bisect.bisect(self.breaks, cut + ONE_PLACE * self.span)
        here -= bisect.bisect(self.breaks, cut - ONE_PLACE * self.span)
        if not cut < end or here > MOST_AT_ONE_PLACE or len(self.breaks) > MOST_CUTS:
            self._give_up(start, series[0, :, 0])

    def _give_up(self, s: Any, y: np.ndarray) -> None:
        """End the motion in the state y (m,) at the time s of the engine: its steps would be cut
        for ever."""
        time = float(self.clock.exact_times(np.array(s)))
        when = time_text(time, time - self.span)
        held = [f"omega_{i + 1}" for i in range(3) if self._is_held(i, time, y.astype(float))]
        cause = f"{HELD}{' = '.join(held)} = 0 by its expression at t = " if held else NOT_SMOOTH
        self.is_cut = self.control.is_over = True
        self.verdict = Status.FAILED, f"{cause}{when}"

    def _is_held(self, i: int, time: float, y: np.ndarray) -> bool:
        """Whether the rates in a state y (m,) lead a component of the angular velocity back to 0
        from both sides of it, however near."""
        if not self.system.starts_with_omega:
            return False
        aside = max(4 * abs(y[i]), 2.0**-40 * np.abs(y).max()) * np.array([1, 1 / 16, -1 / 16, -1])
        beside = np.repeat(y[:, None], 4, axis=1)
        beside[i] = aside
        outer, inner, behind, beyond = self._rates(np.full(4, time), beside)[i]
        return bool(2 * inner < outer < inner / 2 < 0 < behind / 2 < beyond < 2 * behind)

    @np.errstate(all="ignore")
    def _excess(self, ends: np.ndarray, x: np.ndarray, series: np.ndarray) -> np.ndarray:
        """How far steps miss their equations (n, k) at places x (k,): beyond 1 something has
        changed."""
        length = np.diff(ends)
        b = bernstein_coefficients(series, length[:, 0], self.engine.basis)
        state, slope = (part.swapaxes(0, 1) for part in values_and_slopes(b, x[None]))
        times = self.clock.exact_times(ends[:, :1] + x * length).astype(float)
        missed = np.abs(slope - length * self._rates(times, state))
        # Between the ends of a step its polynomial has half of the digits at worst, and formulas
        # of seconds since an epoch, which are rounded, have fewer.
        grain = np.spacing(np.abs(times).max()) * self.clock.factor
        parts = max(self.tol**0.5, GRAINS * grain / self.longest) * length / self.longest
        allowed = np.maximum(parts, max(DEFECT, 100 * self.tol))
        allowed = np.where(length < UNRESOLVED * grain, MISSED_THERE, allowed)
        # Without units of its own a motion has the error of one of size 1, however small it is.
        least = SIZE_AT_REST if self.system.degree else 1.0
        sizes = [np.abs(b[:, kind]).max(axis=(1, 2)).clip(least)[:, None] for kind in self.kinds]
        pairs = zip(self.kinds, sizes, strict=True)
        excess = [missed[kind].max(axis=0) / (allowed * size) for kind, size in pairs]
        return np.asarray(np.max(excess, axis=0))

    @np.errstate(all="ignore")
    def _rates(self, times: np.ndarray, state: np.ndarray) -> np.ndarray:
        """The rates of states (m, ...) by the engine's time, at times (...) of the case."""
        k = attributes(self.units.constants(type(self.system), self.system.constants))
        rates = stacked(self.system.rhs(times, [*state], k), state)
        # The degrees of constants give rates by the engine's time; without them it is told.
        return np.asarray(rates if self.system.degree else rates / self.clock.factor)
