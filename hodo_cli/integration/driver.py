"""The driver of the engines: from a start through the sample times, in units that fit the motion at
every moment."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..engines import extended
from ..engines.polynomial import state_at
from ..engines.protocol import Engine, Status, StepControl, uneven
from ..engines.units import (
    Clock,
    TimeWindow,
    Units,
    is_falling,
    is_timed,
    longest_step,
    units_at_start,
)
from ..models.base import (
    REST_BITS,
    Equations,
    Event,
    EventOutcome,
    Model,
    attributes,
    moving,
    rescaled,
    state_powers,
)
from .step_checks import NO_BREAK, Gap, StepCheck
from .steps import EventRoot, EventSearch, Steps

SAMPLES_AT_ONCE = 1 << 16
"""Samples handed to an engine at once."""

LARGEST_EXPONENT, OVERFLOW_MESSAGE = 1024, "the motion exceeds the largest number"
"""The binary order of magnitude of the largest double, and the message of a motion beyond it."""


def at_rest(omega: np.ndarray, exponent: Any) -> np.ndarray:
    """Whether (...) angular velocities (..., 3), in units of 2**exponent (...), are below
    REST_BITS: a case and a member of a sweep have no label then."""
    largest = np.abs(omega).max(axis=-1).astype(float)
    return np.asarray((largest == 0) | (np.frexp(largest)[1] + exponent < -REST_BITS))


@dataclass(frozen=True)
class Occurrence:
    """One event of a motion: its kind, its time, and the measured error of that."""

    kind: str
    time: float
    details: Mapping[str, float] = field(default_factory=dict)
    error: float = math.nan


@dataclass
class SampleBuffer:
    """The samples of a motion under way: states (n, m) at `time` (n,), each in units of omega of
    2**exponent, of which the first `done` are known; and the events met."""

    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    done: int = 0
    events: list[Occurrence] = field(default_factory=list)

    @classmethod
    def empty(cls, time: np.ndarray, m: int, fp: Any) -> "SampleBuffer":
        """States (m,) of a precision at such times, none of them known."""
        # Of C's int, because ldexp takes four times as long by a wider one.
        return cls(time, np.empty((len(time), m), dtype=fp), np.empty(len(time), dtype=np.intc))

    def add(self, states: np.ndarray, exponent: int | np.ndarray) -> None:
        """Enter the states at the next times, in units of 2**exponent."""
        new = slice(self.done, self.done + len(states))
        self.state[new], self.exponent[new] = states, exponent
        self.done += len(states)

    @property
    def is_complete(self) -> bool:
        """Whether all samples are known."""
        return self.done == len(self.time)

    def ahead(self, until: float) -> np.ndarray:
        """The times (k,) of the next samples, up to one."""
        return self.time[self.done : np.searchsorted(self.time, until, side="right")]

    def fill(self, until: float, state: np.ndarray, exponent: int) -> None:
        """Enter one state (m,) at all further times up to one, in units of 2**exponent."""
        self.add(np.broadcast_to(state, (len(self.ahead(until)), len(state))), exponent)

    def end(self, time: float, state: np.ndarray, exponent: int) -> None:
        """Put the state (m,) in which the motion ends after the known samples, as the last one."""
        known = slice(self.done)
        self.time = np.append(self.time[known], time)
        self.state = np.concatenate((self.state[known], state[None]))
        self.exponent = np.append(self.exponent[known], exponent)
        self.done += 1


STEPS_AT_ONCE = 512
"""Steps that are examined together: numpy's overhead, some 0.1 ms, is then 0.2 us a step."""


Reader = Callable[[Steps], object]
"""What looks at the steps of a motion, many at once and in order."""


class StretchEnd(NamedTuple):
    """Where a stretch ends that its engine goes on beyond: the time of the engine and the state
    (m,) there, and the event that it comes to, or None."""

    time: Any
    state: np.ndarray
    event: Event | None = None


class StepBuffer:
    """The `Observer` of a motion: notes its steps, and shows many at once to the search for events,
    to the check of formulas, and to a further reader."""

    def __init__(
        self, engine: Engine, control: StepControl, events: EventSearch, check: StepCheck | None,
        reader: Reader | None,
    ) -> None:  # fmt: skip
        self.engine, self.control = engine, control
        self.events, self.check, self.reader = events, check, reader
        self.occurrences: list[Occurrence] = []

    def begin(self, clock: Clock, units: Units, k: Mapping[str, Any], y: np.ndarray) -> None:
        """A stretch begins in the state y (m,), with the constants k in these units."""
        self.clock, self.units, self.taken = clock, units, self.control.steps
        self.end: StretchEnd | None = None
        self.ends, self.series = list[tuple[Any, Any]](), list[np.ndarray]()
        # The states between the steps, and the time of the last of them.
        self.states, self.last = [y.copy()], self.engine.dtype(0)
        self.events.begin(clock, k, y)
        if self.check:
            self.check.begin()

    def __call__(self, start: Any, end: Any, series: np.ndarray, state: np.ndarray) -> bool:
        """See `Observer`."""
        self.ends.append((start, end))
        self.series.append(series.copy())
        self.states.append(state.copy())
        self.last, enough = end, float(STEPS_AT_ONCE)
        if self.check:
            elapsed = float(self.clock.exact(end)) - self.check.start
            enough = self.check.enough(float(end - start) / self.clock.factor, elapsed)
        if self.events.note(end, state) or len(self.ends) >= enough:
            self.flush()
        return self.end is None

    def flush(self) -> None:
        """Examine the steps noted: the stretch ends at the first event that ends it, or at the
        start of the first step that misses its equations."""
        if not self.ends:
            return
        ends, series = np.array(self.ends, dtype=self.engine.dtype), np.array(self.series)
        if self.engine.dtype is not np.float64:
            ends, series = extended(ends), extended(series)
        steps = Steps(ends, series, self.engine.basis, self.clock, self.units)
        roots = self.events.roots(steps)
        stop = roots[-1] if roots and roots[-1].event.terminal else None
        whole = stop.step + 1 if stop else len(steps)
        taken = self._examined(steps, stop) if self.check or self.reader else whole
        self.occurrences += [
            Occurrence(root.event.kind, float(steps.chosen([root.step]).times_at(root.x)[0, 0]))
            for root in roots
            if not root.event.terminal and root.step < taken
        ]
        if taken < whole:
            self._end(taken, 0.0)
        elif stop:
            self._end(stop.step, stop.x, stop.event)
        self.taken += len(self.ends)
        self.ends.clear()
        self.series.clear()
        del self.states[:-1]

    def _examined(self, steps: Steps, stop: EventRoot | None) -> int:
        """How many steps, up to an event that ends the motion, meet their equations. The reader
        sees these steps, the last one up to the event."""
        parts, taken = [steps], 0
        if stop:
            parts = [steps.chosen(slice(stop.step)), steps.chosen([stop.step]).until(stop.x)]
        for part in filter(len, parts):
            right = self.check.examine(part) if self.check else len(part)
            taken += right
            if self.reader:
                self.reader(part.chosen(slice(right)))
            if right < len(part):
                break
        return taken

    def _end(self, step: int, x: Any, event: Event | None = None) -> None:
        """End the stretch at a place x of one of the steps noted."""
        (start, end), x = self.ends[step], of_precision(x, self.engine.dtype)
        state = self.states[step + int(x)]
        if 0 < x < 1:
            state = state_at(self.series[step], end - start, self.engine.basis, x)
        self.end = StretchEnd(start + x * (end - start), state, event)
        self.control.take_back(self.taken + step + bool(event))
        if not event:
            self.control.has_time()  # or steps might be cut for ever

    def finish(self) -> StretchEnd | None:
        """Examine the last steps of the stretch. Returns where it ends, if not where its engine
        does; a motion with formulas that its engine leads on no farther goes straight on from its
        last state."""
        self.flush()
        if self.check and not self.end and self.control.status is Status.FAILED:
            self.check.pass_over(np.empty(0), float(self.clock.exact(self.last)))
            self.end = StretchEnd(self.last, self.states[0])
            self.control.take_back(self.taken)
        return self.end


def of_precision(values: Any, fp: Any) -> Any:
    """Doubles or long doubles (...) in the precision of an engine."""
    # From long doubles to a quadruple there is no way but by doubles.
    high = np.asarray(values).astype(float)
    return (high.astype(fp) + np.asarray(values - high).astype(float).astype(fp))[()]


SIZE_AT_REST = 1e-150
"""The least size of a state to which the error of its steps is relative where it gets new units: a
body at rest has none. Its square is a double."""


class Propagation:
    """A motion from a start through sample times: its state `y`, in `units` that fit it, at the
    time of the `clock`."""

    def __init__(
        self,
        engine: Engine,
        system: Model,
        start: float,
        times: np.ndarray,
        control: StepControl,
        reader: Reader | None = None,
    ) -> None:
        self.engine, self.system, self.model = engine, system, system.equations
        self.start, self.times, self.control = start, times, control
        self.span = float(times[-1]) - start if len(times) else 0.0
        self.is_timed, self.moving = is_timed(system), moving(self.model)
        y0, k = np.array(system.initial_state), system.constants
        self.is_falling = bool(self.model.degree) and bool(is_falling(self.model, k, y0))
        band = norm_band(engine, system, self.is_falling)
        is_turning = y0[self.moving].any()  # a body at rest needs no new units
        control.band = band if is_turning else None
        control.rows = None if isinstance(self.moving, slice) else self.moving
        events, self.check = EventSearch(system.run_events), None
        # What begins and ends at one time has no steps.
        if self.model.has_formulas and (times > start).any():
            # Without new units the error of a motion is absolute, however small it becomes.
            is_relative = bool(self.model.degree) and (band or not is_turning)
            least = SIZE_AT_REST if is_relative else 1.0
            self.check = StepCheck(system, start, self.span, engine.tol, least)
        self.buffer = StepBuffer(engine, control, events, self.check, reader)
        if events.events or self.check or reader:
            control.observer = self.buffer

    def begin(self) -> None:
        """Put the motion at its start, where the first samples may lie."""
        system, fp = self.system, self.engine.dtype
        self.clock = Clock(fp(self.start), fp(0))
        self.units = units_at_start(system, self.window)
        exact = np.array(system.initial_state) if fp is np.float64 else system.extended_start
        self.y = of_precision(rescaled(self.model, exact, -self.units.exponent), fp)
        self.samples = SampleBuffer.empty(self.times, len(exact), fp)
        self.samples.events = self.buffer.occurrences
        self.samples.fill(self.start, self.y, self.units.exponent)
        # Whether small components may need shorter steps, see `longest_step`: not those of a model
        # without degrees on a clock of its own, whose phase is far smaller than all else.
        self.is_uneven = bool(self.model.degree or not self.units.rate)

    @property
    def window(self) -> TimeWindow | None:
        """The time of the motion, and how long it lasts, where its equations contain the time."""
        return TimeWindow(float(self.clock.high), self.span) if self.is_timed else None

    def run(self) -> SampleBuffer:
        """Integrate through the sample times, with new units whenever the motion has outgrown them,
        and straight over the gaps that the check of formulas finds.

        Ends early at a terminal event, whose time and state are then the last ones, or when the
        control says so.
        """
        self.begin()
        clock, fp = self.clock, self.engine.dtype
        while not self.samples.is_complete and self.control.status is Status.OK:
            clock.factor = float(np.ldexp(1.0, self.units.rate))
            gap = self.check.ahead if self.check else NO_BREAK
            gap = gap if clock.until(fp(gap.onward)) > 0 else NO_BREAK  # it may lie behind
            # Whether the motion has arrived at the gap. By rounding it may be a little before it.
            if 4 * clock.until(fp(gap.time)) < clock.until(fp(gap.onward)):
                self.go_straight_on(gap.onward)
            else:
                self.change_units(self.integrate(gap.time))
        return self.samples

    def go_straight_on(self, end: float) -> None:
        """Go straight on to a time over a change of formulas, or end where none leads on."""
        clock, fp = self.clock, self.engine.dtype
        times = np.append(self.samples.ahead(end).astype(fp), fp(end))
        elapsed = clock.until(times) * fp(clock.factor)
        gap = Gap(self.system, self.units, clock, self.y, elapsed[-1])
        if problem := gap.problem(self.start):
            self.control.give_up(Status.FAILED, problem)
            return
        *states, self.y = gap.states_after(elapsed)
        self.samples.add(np.reshape(states, (-1, len(self.y))), self.units.exponent)
        clock.restart(fp(end))

    def integrate(self, stop: float) -> int:
        """Integrate in the present units, through as many samples as these serve, to a time at
        most; the exponent of the unit of omega in which the state is then."""
        samples, units, clock = self.samples, self.units, self.clock
        block = samples.time[samples.done :][:SAMPLES_AT_ONCE].astype(self.engine.dtype)
        times = block
        if stop < block[-1]:
            block = block[block < stop]
            times = np.append(block, self.engine.dtype(stop))
        grid = clock.grid(times)
        if not math.isfinite(float(grid[-1])):
            raise OverflowError
        k = units.constants(self.model, self.system.constants)
        # Asked until it is not so: what becomes small on the way stays so, since it decays.
        self.is_uneven = self.is_uneven and bool(uneven(self.y[self.moving].astype(float)))
        self.control.longest = (
            longest_step(self.model, k, float(clock.high), self.y.astype(float))
            if self.is_uneven
            else math.inf
        )
        self.buffer.begin(clock, units, k, self.y)
        k = k | clock.constants if self.is_timed else k
        rows, time, self.y = self.engine.integrate(k, self.y, grid, self.control)
        if end := self.buffer.finish():
            rows = rows[: np.searchsorted(grid, end.time, side="right")]
            time, self.y = (end.time, end.time * 0), end.state
        if self.check and self.check.problem:
            self.control.give_up(Status.FAILED, self.check.problem)
        # The first row is where it began, and one after the samples is at a break.
        samples.add(rows[1 : len(block) + 1], units.exponent)
        if end and end.event:
            return self.pass_event(end.event, clock.exact(end.time))
        clock.advance(time)
        return int(units.exponent)

    def pass_event(self, event: Event, time: Any) -> int:
        """Go on after a terminal event at a time, or end there; the exponent of the unit of omega
        in which the state is then."""
        exponent, fp = int(self.units.exponent), self.engine.dtype
        outcome = EventOutcome(float(time), {}, [*self.y])
        if event.passage:
            state, exponent = scaled_by(self.model, self.y, exponent), 0
            numbers = attributes(self.system.constants, fp)
            outcome = event.passage(time, [*state], numbers)
        if outcome.details is not None:
            self.samples.events.append(Occurrence(event.kind, outcome.time, outcome.details))
        self.y = np.array(outcome.state, dtype=fp)
        if outcome.onward is None:
            self.samples.end(outcome.time, self.y, exponent)
        else:
            self.clock.restart(fp(outcome.onward))
            # The samples that the passage skips.
            is_moving = self.y[self.moving].any() or not self.model.degree
            skipped = outcome.states(self.samples.ahead(float(outcome.onward)), fp)
            self.samples.add(skipped, 0 if is_moving else -REST_BITS)
        return exponent

    def change_units(self, exponent: int) -> None:
        """Give the state, in units of omega of 2**exponent, units that fit it. The motion ends
        where it comes to rest, or exceeds the largest number."""
        # After the last sample new units would show only whether the motion exceeds all numbers.
        is_over = self.samples.is_complete and exponent < LARGEST_EXPONENT // 2
        if is_over or not self.model.degree:
            return
        state, k = self.y.astype(float), self.system.constants
        self.units = Units.fit(self.model, k, state, exponent, self.window, self.is_falling)
        if self.units.exponent < -REST_BITS:
            at_rest = np.where(state_powers(self.model), 0, self.y)
            self.samples.fill(math.inf, at_rest, -REST_BITS)
        elif self.units.exponent > LARGEST_EXPONENT:
            time = float(self.clock.exact(self.engine.dtype(0)))
            self.control.give_up(Status.FAILED, f"{OVERFLOW_MESSAGE} at {time:.6g}")
        self.y = scaled_by(self.model, self.y, exponent - self.units.exponent)


def scaled_by(model: Equations, y: np.ndarray, exponent: int) -> np.ndarray:
    """A state (m,) in units of omega that are 2**exponent times as small, in any precision."""
    factors = [2.0 ** (exponent * power) for power in state_powers(model).tolist()]
    return np.asarray(y * np.array(factors).astype(y.dtype))


def norm_band(engine: Engine, system: Model, falling: bool) -> tuple[float, float] | None:
    """Where the norm of the state may stay before it gets new units; None for anywhere.

    New units serve a motion that decays or grows. A model without degrees has none, and under a
    torque that is constant the motion settles at a size of its own, unless it begins far above it.
    """
    constant = {
        name for name, degree in system.equations.degree.items() if degree == 0
    } - system.resisting
    forced = any(np.any(system.constants[name]) for name in constant)
    return engine.band if system.equations.degree and (falling or not forced) else None
