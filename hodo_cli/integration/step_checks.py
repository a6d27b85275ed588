"""Checks of the steps of a motion: whether they meet its equations, whose formulas may change or
have a pole within them, and whether what approximates these is accurate."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..engines import extended
from ..engines.polynomial import bernstein_coefficients, values_and_slopes
from ..engines.protocol import EPS, Engine, Status, StepControl
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

MIN_GAP, MIN_ULPS = 1e-9, 4
"""How far from a change steps end and begin: in the time in which a motion changes by its own size,
so that its square is below the rounding of a double, and in rounding errors of the time."""

PARTS, ROUNDS, MAX_CORNER = 128, 9, 2.0
"""Parts of an interval in search of a change, and how often one or two of them are divided again:
to the rounding of a long double, since a jump is gone over by the rates on both sides. Of a corner,
from which an excess grows gradually to no more than this, a part of MIN_GAP will do."""

MOST_CHANGES = 10_000
"""How many changes of its formulas a motion may have."""

MOST_AT_ONE_PLACE, NEARBY = 64, 16
"""How many of them may follow each other within so many MIN_GAP."""

POLE = "the equations have a pole at t = "
"""How the message of a motion begins that comes to one: no method leads it on from there."""

SHORT_STEP, AHEAD = 1e7, 1e5
"""The length of a step, in rounding errors of the time, below which a pole is looked for, and how
many such steps ahead: collocation takes short ones, since the rounding of a time near a pole makes
much of its rates."""

BESIDE, FARTHER = 4, 1024
"""A distance from a pole, in rounding errors of the time, and how many times farther from it the
rates are smaller by as much."""


@dataclass
class StepCheck(StepBuffer):
    """Compares the polynomials of steps with their equations all along, and notes where they begin
    to differ.

    A series knows a formula by its derivatives at the start of a step, and other methods by its
    values at some points: they pass a short pulse, and a series a corner too, without a trace.
    `changes` are the times of such places, each with one before and one behind it, between which
    the motion is to go straight on: begun anew there, it misses nothing.
    """

    system: Model
    end: float
    span: float
    tol: float
    control: StepControl
    changes: list[np.ndarray] = field(default_factory=list)
    at_one_place: int = 0
    pole: Any = None

    def begin(self, engine: Engine, clock: Clock, units: Units) -> None:
        super().begin(engine, clock, units)
        self.longest, self.change, self.at_once = 0.0, None, 512
        self.at_begin = self.control.steps, self.control.evaluations
        self.verdict = Status.OK, ""
        self.kinds = kinds_of_variables(self.system.equations)

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        self.longest = max(self.longest, float(end - start))
        self.enough = self.at_once / self.points
        super().__call__(start, end, series)

    @property
    def points(self) -> int:
        """The number of places at which each of the steps noted is compared."""
        return 8 + int(POINTS_CHECKED * self.longest / self.clock.factor / self.span)

    def flush(self) -> None:
        super().flush()
        control = self.control
        is_at_begin = control.steps == self.at_begin[0]
        if control.status is Status.FAILED and is_at_begin and self.change is None:
            # A series that begins at a corner has no number.
            self.note(extended(np.array([self.clock.high, self.clock.low])).sum())
        if self.change is not None:
            control.take_back(*self.at_begin)
            if self.verdict[0] is not Status.OK:
                control.give_up(*self.verdict)

    def examine(self, ends: np.ndarray, series: np.ndarray) -> None:
        """Compare steps; those behind the first change of a stretch are of another motion."""
        if self.pole is not None and self.clock.exact_times(ends[0, 0]) > self.changes[-1][1]:
            self.change = np.full(3, self.pole)
            pole = time_text(float(self.pole), self.end - self.span)
            self.verdict = Status.FAILED, f"{POLE}{pole}"
            return
        # Nearer to each other towards the ends, where collocation has no points of its own.
        x = (1 - np.cos(np.pi * np.arange(self.points + 1) / self.points)) / 2
        b = self._bernstein(series.astype(float), ends)
        missed = ~(self._excess(ends.astype(float), x, b) <= 1)
        if self.change is None and missed.any():
            step, first = np.argwhere(missed)[0]
            ends, b = ends[step : step + 1], self._bernstein(series, ends)[step : step + 1]
            # A series is right up to a corner; what goes over it by some points is wrong all along.
            low, high = (x[first - 1], x[first]) if first else (0, 1)
            place = self._place(ends, b, low, high, is_onset=first > 0)
            self.note(self.clock.exact_times(ends[0, 0] + place * (ends[0, 1] - ends[0, 0])))
        self.look_for_pole(ends, b)
        self.longest = 0.0
        self.at_once = min(2 * self.at_once, POINTS_AT_ONCE)

    def look_for_pole(self, ends: np.ndarray, b: np.ndarray) -> None:
        """Note a pole of the equations, towards which steps become ever shorter: the motion is to
        begin anew before the first short one, and to end there."""
        times = self.clock.exact_times(ends)
        grain = EPS * (np.abs(times[:, 0]) + self.span)
        is_short = np.diff(times)[:, 0] < SHORT_STEP * grain
        if self.pole is None and is_short.any():
            step = is_short.argmax()
            self.pole = self._pole(ends[step], b[step, :, 0], grain[step])
            if self.pole is None:
                return
            before = min(times[step, 0], self.pole - 2 * self._aside(self.pole))
            if self.change is None or self.change[1] > before:
                self.note(before)

    def _pole(self, ends: np.ndarray, y: np.ndarray, grain: Any) -> Any:
        """The time of a pole of the equations soon behind the start of a step with the state y, or
        None: their rates grow by the inverse of the distance at least, down to the rounding."""

        def rates(s: np.ndarray) -> np.ndarray:
            state = np.repeat(y[:, None], len(s), axis=1)
            return np.asarray(np.abs(self._rates(self.clock.exact_times(s), state)).max(axis=0))

        start, width = extended(ends[:1])[0], AHEAD * (ends[1] - ends[0])
        for _ in range(ROUNDS):
            places = start + width * np.linspace(0, 1, PARTS + 1)
            largest = rates(places).argmax()
            start, width = places[max(largest - 1, 0)], 2 * width / PARTS
        beside = BESIDE * grain * self.clock.factor
        near, farther = rates(places[largest] + beside * np.array([1, FARTHER]))
        pole = grain * np.round(self.clock.exact_times(places[largest]) / grain) + 0.0
        return pole if 2 * near > FARTHER * farther and pole <= self.end else None

    def note(self, at: Any) -> None:
        """Note a change at some time: the stretch ends, to be begun anew."""
        aside = self._aside(at)
        is_beyond = not self.changes or at > self.changes[-1][1] + NEARBY * aside
        self.at_one_place = 0 if is_beyond else self.at_one_place + 1
        # Begun anew it may miss its equations sooner than before.
        while self.changes and self.changes[-1][1] >= at:
            self.changes.pop()
        self.change = np.array([at - aside, at, at + aside])
        self.changes.append(self.change)
        if self.at_one_place > MOST_AT_ONE_PLACE:
            self.verdict = Status.FAILED, "its formulas change ever again within its steps"
        if len(self.changes) > MOST_CHANGES:
            message = f"stopped: its formulas change more than {MOST_CHANGES} times"
            self.verdict = Status.TIMEOUT, message

    def _aside(self, at: Any) -> Any:
        """How far from a change at some time steps end and begin."""
        # A series that begins at a corner overflows, and the formula may be no number there.
        gap = MIN_GAP * min(1 / self.clock.factor, self.span)
        return np.maximum(gap, MIN_ULPS * np.spacing(float(at)))

    def _place(self, ends: np.ndarray, b: np.ndarray, low: Any, high: Any, is_onset: bool) -> Any:
        """Where between two places a step begins to miss its equations; where it misses them from
        its start, which is no `onset`, where the rates have their sharpest bend."""
        low, width, length = b.dtype.type(low), high - low, ends[0, 1] - ends[0, 0]
        for _ in range(ROUNDS):
            places = low + width * np.linspace(0, 1, PARTS + 1)
            if is_onset:
                excess = self._excess(ends, places, b)[0]
                first, parts = max((~(excess <= 1)).argmax() - 1, 0), 1
            else:
                bend = np.abs(np.diff(self._slopes(ends, places, b)[2], 2)).max(axis=0)
                first, parts = bend.argmax(), 2
            low, width = places[first], width * parts / PARTS
            if is_onset and width * length < MIN_GAP / 8 and excess[first + 1] < MAX_CORNER:
                break
        return low + width / 2

    def _bernstein(self, series: np.ndarray, ends: np.ndarray) -> np.ndarray:
        length = (ends[:, 1] - ends[:, 0]).astype(series.dtype)
        return bernstein_coefficients(series.copy(), length, self.engine.basis)

    def _slopes(self, ends: np.ndarray, x: np.ndarray, b: np.ndarray) -> tuple[Any, Any, Any]:
        """The states in steps at places x (k,), the slopes of these by x, and those of their
        equations, each (m, n, k)."""
        length = ends[:, 1:] - ends[:, :1]
        t = self.clock.exact_times(ends[:, :1] + x * length).astype(b.dtype)
        state, slope = (part.swapaxes(0, 1) for part in values_and_slopes(b, x[None]))
        return state, slope, length * self._rates(t, state)

    def _rates(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        """The rates of states (m, ...) by the engine's time, at times (...) of the case."""
        k = self._constants(state.dtype.type)
        rates = stacked(self.system.equations.rhs(t, [*state], k), state)
        # The degrees of constants give rates by the engine's time; without them it is told.
        return np.asarray(rates if self.system.equations.degree else rates / self.clock.factor)

    def _constants(self, number: Any) -> SimpleNamespace:
        constants = self.units.constants(self.system.equations, self.system.constants)
        return attributes(constants, number)

    def _excess(self, ends: np.ndarray, x: np.ndarray, b: np.ndarray) -> np.ndarray:
        """How far steps miss their equations (n, k) at places x (k,): beyond 1 something has
        changed."""
        _, slope, rates = self._slopes(ends, x, b)
        # Between the ends of a step its polynomial has half of the digits at worst, and formulas
        # of seconds since an epoch, which are rounded, have fewer.
        latest = np.abs(self.clock.exact_times(ends)).max().astype(b.dtype)
        grain = GRAINS * np.spacing(latest) * self.clock.factor / self.longest
        parts = max(self.tol**0.5, grain) * (ends[:, 1] - ends[:, 0]) / self.longest
        allowed = np.maximum(parts, max(DEFECT, 100 * self.tol))
        # Without units of its own a motion has the error of one of size 1, however small it is.
        least = SIZE_AT_REST if self.system.equations.degree else 1.0
        sizes = [np.abs(b[:, kind]).max(axis=(1, 2)).clip(least) for kind in self.kinds]
        missed = [np.abs(slope - rates)[kind].max(axis=0) for kind in self.kinds]
        pairs = zip(missed, sizes, strict=True)
        excess = np.max([part / (allowed * size)[:, None] for part, size in pairs], axis=0)
        return np.asarray(excess)
