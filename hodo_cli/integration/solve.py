"""Case -> Trajectory: the motion of a case by one method."""

import math
from dataclasses import dataclass, field, replace
from time import perf_counter, thread_time
from typing import Any

import numpy as np

from .. import HodoError, engines
from ..cases.case import Case
from ..cases.keys import NO_CLOSED_FORM, wrong_precision
from ..engines import extended
from ..engines.polynomial import (
    TAYLOR,
    bernstein_coefficients,
    values_and_slopes,
)
from ..engines.protocol import EPS, LAST_STEP, Engine, Status, StepControl
from ..models.base import Model, attributes, stacked
from .driver import (
    LARGEST_EXPONENT,
    OVERFLOW_MESSAGE,
    SAMPLES_AT_ONCE,
    Propagation,
    SampleBuffer,
    StepBuffer,
    StepObserver,
)
from .trajectory import Occurrence, Trajectory
from .units import Clock, Units, is_timed

REFINEMENTS, OTHER_REFINEMENTS = {"taylor": 5}, 2
"""How often what approximates equations is refined: it takes twice as long each time, and seconds
already by methods whose steps are taken in Python."""


def sample_times(case: Case) -> np.ndarray:
    """The times (n,) at which a case is stored; a single sample is the end."""
    time = case.time
    if time.values:
        return np.array(time.values)
    few = time.samples == 1
    return np.array([time.end]) if few else np.linspace(time.start, time.end, time.samples)


@dataclass
class AccuracyMonitor(StepObserver):
    """Checks at the start of each step whether what approximates the equations is right to a
    tolerance; `everywhere` tells whether it always was."""

    system: Model
    tol: float
    everywhere: bool = True

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        """Check the state at the start of a step; see `Observer`."""
        order = np.arange(self.engine.degree + 1)
        # At the start of a step only the first power is left, and polynomials of Legendre or
        # Chebyshev are 1 and -1 by turns.
        at_start = np.where(order, 0.0, 1.0) if self.engine.basis == TAYLOR else (-1.0) ** order
        state = engines.extended(series).astype(float) @ at_start
        k = attributes(self.system.constants)
        self.everywhere &= bool(self.system.is_accurate(state[:, np.newaxis], k, self.tol).all())


POINTS_CHECKED, POINTS_AT_ONCE = 1 << 15, 1 << 13
"""Places of a span, evenly spaced, at which steps are compared with formulas, since what is shorter
may be overlooked; and those that are compared together."""

DEFECT = 1e-12
"""By how much a step may miss its equations at least, relative to the size of the state: far above
the rounding of the comparison, far below what a pulse of a formula makes of a motion."""

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
        self.longest, self.change, self.at_begin = 0.0, None, {**vars(self.control)}
        self.enough = 512

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        self.longest = max(self.longest, float(end - start))
        super().__call__(start, end, series)

    @property
    def is_full(self) -> bool:
        return len(self.ends) * self.points >= self.enough

    @property
    def points(self) -> int:
        """The number of places at which each of the steps noted is compared."""
        return 8 + int(POINTS_CHECKED * self.longest / self.clock.factor / self.span)

    def flush(self) -> None:
        super().flush()
        control = self.control
        is_at_begin = control.steps == self.at_begin["steps"]
        if control.status is Status.FAILED and is_at_begin and self.change is None:
            # A series that begins at a corner has no number.
            self.note(extended(np.array([self.clock.high, self.clock.low])).sum())

    def examine(self, ends: np.ndarray, series: np.ndarray) -> None:
        """Compare steps; those behind the first change of a stretch are of another motion."""
        if self.pole is not None and self.clock.exact_times(ends[0, 0]) > self.changes[-1][1]:
            self.change, self.control.is_over = np.full(3, self.pole), True
            self.control.give_up(Status.FAILED, f"{POLE}{float(self.pole):.6g}")
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
        self.enough = min(2 * self.enough, POINTS_AT_ONCE)

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
        vars(self.control).update(self.at_begin, is_over=True)
        aside = self._aside(at)
        is_beyond = not self.changes or at > self.changes[-1][1] + NEARBY * aside
        self.at_one_place = 0 if is_beyond else self.at_one_place + 1
        # Begun anew it may miss its equations sooner than before.
        while self.changes and self.changes[-1][1] >= at:
            self.changes.pop()
        self.change = np.array([at - aside, at, at + aside])
        self.changes.append(self.change)
        if self.at_one_place > MOST_AT_ONE_PLACE:
            self.control.give_up(Status.FAILED, "its formulas change ever again within its steps")
        if len(self.changes) > MOST_CHANGES:
            message = f"stopped: its formulas change more than {MOST_CHANGES} times"
            self.control.give_up(Status.TIMEOUT, message)

    def _aside(self, at: Any) -> Any:
        """How far from a change at some time steps end and begin."""
        # A series that begins at a corner overflows, and the formula may be no number there.
        gap = MIN_GAP * min(1 / self.clock.factor, self.span)
        return np.maximum(gap, MIN_ULPS * np.spacing(float(at)))

    def _place(self, ends: np.ndarray, b: np.ndarray, low: Any, high: Any, is_onset: bool) -> Any:
        """Where between two places a step begins to miss its equations or, if that is no `onset`,
        its rates have their sharpest bend."""
        low, width, length = b.dtype.type(low), high - low, ends[0, 1] - ends[0, 0]
        for _ in range(ROUNDS):
            places = low + width * np.linspace(0, 1, PARTS + 1)
            if is_onset:
                excess = self._excess(ends, places, b)[0]
                first, parts = max((~(excess <= 1)).argmax() - 1, 0), 1
            else:
                bend = np.abs(np.diff(self._slopes(ends, places, b)[1], 2)).max(axis=0)
                first, parts = bend.argmax(), 2
            low, width = places[first], width * parts / PARTS
            if is_onset and width * length < MIN_GAP / 8 and excess[first + 1] < MAX_CORNER:
                break
        return low + width / 2

    def _bernstein(self, series: np.ndarray, ends: np.ndarray) -> np.ndarray:
        length = (ends[:, 1] - ends[:, 0]).astype(series.dtype)
        return bernstein_coefficients(series.copy(), length, self.engine.basis)

    def _slopes(self, ends: np.ndarray, x: np.ndarray, b: np.ndarray) -> tuple[Any, Any]:
        """The slopes of steps by x, and those of their equations, each (m, n, k), at places x
        (k,)."""
        length = ends[:, 1:] - ends[:, :1]
        t = self.clock.exact_times(ends[:, :1] + x * length).astype(b.dtype)
        state, slope = (part.swapaxes(0, 1) for part in values_and_slopes(b, x[None]))
        return slope, length * self._rates(t, state)

    def _rates(self, t: np.ndarray, state: np.ndarray) -> np.ndarray:
        """The rates of states (m, ...) by the engine's time, at times (...) of the case."""
        k = self.units.constants(type(self.system), self.system.constants)
        return stacked(self.system.rhs(t, [*state], attributes(k, state.dtype.type)), state)

    def _excess(self, ends: np.ndarray, x: np.ndarray, b: np.ndarray) -> np.ndarray:
        """How far steps miss their equations (n, k) at places x (k,): beyond 1 something has
        changed."""
        slope, rates = self._slopes(ends, x, b)
        # Between the ends of a step its polynomial has half of the digits at worst.
        parts = self.tol**0.5 * (ends[:, 1] - ends[:, 0]) / self.longest
        allowed = np.maximum(parts, max(DEFECT, 100 * self.tol)) * np.abs(b).max(axis=(1, 2))
        return np.asarray(np.abs(slope - rates).max(axis=0) / allowed[:, None])


@dataclass
class StepTimes(StepObserver):
    """Notes when each step ends."""

    times: list[float]

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        """See `Observer`."""
        self.times.append(self.clock.true(end))


def step_times(case: Case, method: str) -> np.ndarray:
    """The start of a case, the ends (n,) of the steps that a method takes, and the end of the
    case; of a method that takes steps, which the closed form does not."""
    observer, span = StepTimes([]), (case.time.start, case.time.end)
    solve(case, method, case.precision, case.tol, np.array(span[1:]), observer)
    inner = [time for time in observer.times if span[0] < time < span[1]]
    return np.unique([*inner, *span])


@np.errstate(all="ignore")  # what overflows ends a motion, and its status says so
def solve(
    case: Case,
    method: str,
    precision: str = "double",
    tol: float | None = None,
    times: np.ndarray | None = None,
    observer: StepObserver | None = None,
    refine: bool = True,
) -> Trajectory:
    """The motion of a case by one method; the run time is the processor's, without imports and
    compilation.

    With `refine`, what approximates the equations is refined until it meets the tolerance all along
    the motion. Raises HodoError if the method is not available here, or numbers of the case are out
    of range.
    """
    times = sample_times(case) if times is None else times
    # A case with such a method is refused when it is read; a comparison of methods may ask for one.
    if message := wrong_precision(method, precision):
        raise HodoError(message)
    if method == "exact":
        return closed_form(case, times, precision)
    if not (refine and case.system.refined_data):
        return attempted(case, method, precision, tol, times, observer)[0]
    motion = accurate_motion(case, method, precision, tol, times)
    if observer:
        # It sees the steps of the motion that is stored, and of no attempt at it.
        motion, _ = attempted(motion.case, method, precision, tol, times, observer)
    return replace(motion, case=case)


def accurate_motion(
    case: Case, method: str, precision: str, tol: float | None, times: np.ndarray
) -> Trajectory:
    """The motion of a case whose data are refined until what approximates its equations is right to
    the tolerance, or as far as they can be; it is of the case with these data."""
    motion, is_accurate = attempted(case, method, precision, tol, times)
    for _ in range(REFINEMENTS.get(method, OTHER_REFINEMENTS)):
        if is_accurate or not motion.succeeded:
            break
        # As many steps as before, unless it is a singularity that ever finer data show the clearer.
        case = with_seconds_left(case, motion)
        finer = refined(case, motion.system, max(100, 4 * motion.steps))
        better, is_accurate = attempted(finer, method, precision, tol, times)
        if not better.succeeded:
            break
        motion = better
    return motion


def with_seconds_left(case: Case, motion: Trajectory) -> Case:
    """A case with what a motion has left of its seconds."""
    if case.max_seconds is None:
        return case
    return replace(case, max_seconds=max(case.max_seconds - motion.run_time, math.ulp(0)))


def refined(case: Case, system: Model, limit: int | None = None) -> Case:
    """A case with the finer data of a system of its own, and so many steps at most."""
    limits = filter(None, (case.max_steps, limit))
    return replace(
        case, data={**case.data, **system.refined_data}, max_steps=min(limits, default=None)
    )


def attempted(
    case: Case,
    method: str,
    precision: str,
    tol: float | None,
    times: np.ndarray,
    observer: StepObserver | None = None,
) -> tuple[Trajectory, bool]:
    """The motion of a case as it is, and whether what approximates its equations met the
    tolerance."""
    system = case.system
    # What begins at 0 and stays there has no sign, and would meet its event all the time.
    events = tuple(
        event for event in system.run_events if event.sign is None or system.start[event.sign]
    )
    engine = engines.engine_for(method, system, events, tol, precision, is_timed(system, events))
    # Both times from here on, since compiling and imports are paid once for all cases of a model: a
    # case must not run into its limit for being the first. `began` is of this thread's processor,
    # since the clock counts what else the machine does.
    began = thread_time()
    monitor = AccuracyMonitor(system, max(engine.tol, EPS)) if system.refined_data else None
    limits = case.max_steps or LAST_STEP[method], case.max_seconds or math.inf
    control = StepControl(*limits)
    # What begins and ends at one time has no steps.
    is_checked = system.has_formulas and not monitor and bool((times > case.time.start).any())
    try:
        propagation = Propagation(engine, system, case.time.start, times, events)
        changes = np.empty((0, 3))
        if is_checked:
            check = StepCheck(system, times[-1], propagation.span, engine.tol, control)
            samples = propagation.run(control, check, changes)
            changes = np.reshape(check.changes, (-1, 3))
        if observer or not is_checked:
            control = StepControl(*limits)
            samples = propagation.run(control, observer or monitor, changes)
    except ArithmeticError as error:
        raise HodoError(f"{case.name}: its numbers exceed the range of doubles") from error
    motion = trajectory(case, method, engine.tol, samples, control, began)
    motion = replace(motion, restarts=len(changes))
    return motion, monitor is None or monitor.everywhere


def trajectory(
    case: Case, method: str, tol: float, samples: SampleBuffer, control: StepControl, began: float
) -> Trajectory:
    """The motion that ends now: its known samples and what they cost since `began`."""
    spent, known = thread_time() - began, slice(samples.done)
    return Trajectory(
        case, case.system, method, tol,
        samples.time[known], samples.state[known], samples.exponent[known], tuple(samples.events),
        control.steps, control.evaluations, spent, control.status, control.message,
    )  # fmt: skip


def closed_form(case: Case, times: np.ndarray, precision: str) -> Trajectory:
    """The motion of a case from its closed form, in double or extended precision.

    Raises HodoError if the case has none.
    """
    if not case.system.has_closed_form:
        raise HodoError(f"{case.name}: {NO_CLOSED_FORM}")
    control = StepControl(max_seconds=case.max_seconds or math.inf)
    began, fp = thread_time(), np.longdouble if precision == "extended" else np.float64
    samples = SampleBuffer(
        times,
        np.empty((len(times), len(case.system.state)), dtype=fp),
        np.empty(len(times), dtype=np.int64),
    )
    take_exact_samples(case, samples, control)
    if end := case.system.exact_end:
        kind, outcome = end
        time = case.time.start + outcome.time
        if time <= case.time.end:
            samples.events.append(Occurrence(kind, time, outcome.details or {}))
    return trajectory(case, "exact", float(np.finfo(fp).eps), samples, control, began)


def take_exact_samples(case: Case, samples: SampleBuffer, control: StepControl) -> None:
    """Enter the exact states of a case at the times of its samples, until they exceed the largest
    number, or its seconds are over."""
    times = samples.time
    # In blocks, for the memory: the closed form makes a dozen arrays of its times.
    for i in range(0, len(times), SAMPLES_AT_ONCE):
        if perf_counter() > control.deadline:
            control.give_up(Status.TIMEOUT, f"max_seconds: stopped after {case.max_seconds:g} s")
            break
        block: np.ndarray = times[i : i + SAMPLES_AT_ONCE].astype(samples.state.dtype)
        samples.add(*case.system.exact_states(block - case.time.start))
    known = slice(samples.done)
    outgrown = samples.exponent[known] > LARGEST_EXPONENT
    lost = np.flatnonzero(outgrown | ~np.isfinite(samples.state[known]).all(axis=1))
    if len(lost):
        samples.done = int(lost[0])
        control.give_up(Status.FAILED, f"{OVERFLOW_MESSAGE} at {times[lost[0]]:.6g}")
