"""The driver of the engines: from a start through the sample times, in units that fit the motion at
every moment."""

import bisect
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..engines.protocol import Engine, EventRoot, Status, StepControl, uneven
from ..engines.units import (
    AbsoluteClock,
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
from .step_checks import NO_BREAK, Break, Gap, StepBuffer

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


class Propagation:
    """A motion from a start through sample times: its state `y`, in `units` that fit it, at the
    time of the `clock`."""

    def __init__(
        self,
        engine: Engine,
        system: Model,
        start: float,
        times: np.ndarray,
        events: tuple[Event, ...],
    ) -> None:
        model = system.equations
        self.engine, self.system, self.model, self.events = engine, system, model, events
        self.start, self.times = start, times
        self.span = float(times[-1]) - start if len(times) else 0.0
        self.is_timed, self.moving = is_timed(system, events), moving(model)
        y0 = np.array(system.initial_state)
        self.is_falling = bool(model.degree) and bool(is_falling(model, system.constants, y0))

    def begin(self) -> None:
        """Put the motion at its start, where the first samples may lie."""
        system, fp = self.system, self.engine.dtype
        kind = Clock if self.model.degree or self.is_timed else AbsoluteClock
        self.clock = kind(fp(self.start), fp(0))
        self.units = units_at_start(system, self.window)
        exact = np.array(system.initial_state) if fp is np.float64 else system.extended_start
        y = rescaled(self.model, exact, -self.units.exponent)
        # From long doubles to a quadruple there is no way but by doubles.
        high = y.astype(float)
        self.y = high.astype(fp) + (y - high).astype(float).astype(fp)
        self.samples = SampleBuffer.empty(self.times, len(exact), fp)
        self.samples.fill(self.start, self.y, self.units.exponent)
        # Whether small components may need shorter steps, see `longest_step`: not those of a model
        # without degrees on a clock of its own, whose phase is far smaller than all else.
        self.is_uneven = bool(self.model.degree) or not self.is_timed

    @property
    def window(self) -> TimeWindow | None:
        """The time of the motion, and how long it lasts, where its equations contain the time."""
        return TimeWindow(float(self.clock.high), self.span) if self.is_timed else None

    def run(
        self, control: StepControl, observer: StepBuffer | None, breaks: list[Break]
    ) -> SampleBuffer:
        """Integrate through the sample times, with new units whenever the motion has outgrown them,
        and over the `breaks`, in order, of which the observer may add some.

        Ends early at a terminal event, whose time and state are then the last ones, or when the
        control says so.
        """
        self.begin()
        self.control, self.observer = control, observer or StepBuffer()
        control.band = norm_band(self.engine, self.system, self.is_falling)
        control.rows = None if isinstance(self.moving, slice) else self.moving
        control.observer = observer
        clock, fp = self.clock, self.engine.dtype
        while not self.samples.is_complete and self.control.status is Status.OK:
            clock.factor = float(np.ldexp(1.0, self.units.rate))
            ahead = breaks[bisect.bisect_left(breaks, Break(float(clock.high), -math.inf)) :]
            at = next((at for at in ahead if clock.until(fp(at.onward)) > 0), NO_BREAK)
            # Already from so near to it that its time may be that of the present, rounded.
            if 4 * clock.until(fp(at.time)) < clock.until(fp(at.onward)):
                self.go_straight_on(at.onward)
                continue
            exponent = self.integrate(at.time)
            if not self.observer.is_cut:
                self.change_units(exponent)
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
        self.control.is_over = False
        self.observer.begin(self.engine, clock, units)
        k = k | clock.constants if self.is_timed else k
        spent = self.control.steps, self.control.evaluations
        stretch = self.engine.integrate(k, self.y, grid, self.control)
        self.observer.flush()
        if self.observer.is_cut:
            self.control.take_back(*spent)
            if self.observer.verdict[0] is not Status.OK:
                self.control.give_up(*self.observer.verdict)
            return int(units.exponent)
        samples.events += [
            Occurrence(self.events[root.event].kind, float(clock.exact(root.time)))
            for root in stretch.roots
        ]
        # The first row is where it began, and one after the samples is at a break.
        samples.add(stretch.rows[1 : len(block) + 1], units.exponent)
        if stretch.stop:
            return self.pass_event(stretch.stop)
        clock.advance(stretch.time)
        self.y = stretch.state
        return int(units.exponent)

    def pass_event(self, root: EventRoot) -> int:
        """Go on after a terminal event, or end there; the exponent of the unit of omega in which
        the state is then."""
        event, exponent, fp = self.events[root.event], int(self.units.exponent), self.engine.dtype
        time = self.clock.exact(root.time)
        outcome = EventOutcome(float(time), {}, [*root.state])
        if event.passage:
            state, exponent = scaled_by(self.model, root.state, exponent), 0
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

    New units serve a motion that decays or grows. A model without degrees has none, a body at rest
    needs none, and under a torque that is constant the motion settles at a size of its own, unless
    it begins far above it.
    """
    constant = {
        name for name, degree in system.equations.degree.items() if degree == 0
    } - system.resisting
    forced = any(np.any(system.constants[name]) for name in constant)
    turning = np.array(system.initial_state)[moving(system.equations)].any()
    return engine.band if system.equations.degree and turning and (falling or not forced) else None
