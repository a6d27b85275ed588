"""The driver of the engines: from a start through the sample times, in units that fit the motion at
every moment."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..engines.protocol import Engine, Hit, Status, StepControl, uneven
from ..models.base import Event, EventOutcome, Model, Passage
from ..models.constants import attributes, moving, rescaled, state_powers
from .trajectory import Occurrence
from .units import (
    AbsoluteClock,
    Clock,
    TimeWindow,
    Units,
    is_falling,
    is_timed,
    longest_step,
    units_at_start,
)

SAMPLES_AT_ONCE = 1 << 16
"""Samples handed to an engine at once."""

REST_BITS = 2**12
"""Binary orders of magnitude below 1 at which a motion is called at rest: 1e-1233, far below the
smallest double."""

LARGEST_EXPONENT, OVERFLOW_MESSAGE = 1024, "the motion exceeds the largest number"
"""The binary order of magnitude of the largest double, and the message of a motion beyond it."""


def at_rest(omega: np.ndarray, exponent: Any) -> np.ndarray:
    """Whether (...) angular velocities (..., 3), in units of 2**exponent (...), are below
    REST_BITS: a case and a member of a sweep have no label then."""
    largest = np.abs(omega).max(axis=-1).astype(float)
    return np.asarray((largest == 0) | (np.frexp(largest)[1] + exponent < -REST_BITS))


@dataclass
class SampleBuffer:
    """The samples of a motion under way: states (n, m) at `time` (n,), each in units of omega of
    2**exponent, of which the first `done` are known; and the events met."""

    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    done: int = 0
    events: list[Occurrence] = field(default_factory=list)

    def add(self, states: np.ndarray, size: int | np.ndarray) -> None:
        """Enter the states at the next times, in units of 2**size."""
        new = slice(self.done, self.done + len(states))
        self.state[new], self.exponent[new] = states, size
        self.done += len(states)

    def end(self, time: float, state: np.ndarray, size: int) -> None:
        """Put the state (m,) in which the motion ends behind the known samples, as the last one."""
        known = slice(self.done)
        self.time = np.append(self.time[known], time)
        self.state = np.concatenate((self.state[known], state[None]))
        self.exponent = np.append(self.exponent[known], size)
        self.done += 1


class StepObserver:
    """Sees every step of a motion, as an `Observer` that knows in which units the step is."""

    def begin(self, engine: Engine, clock: Clock, units: Units) -> None:
        """The steps from here on are in these units, their times those of the clock."""
        self.engine, self.clock, self.units = engine, clock, units

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        """See `Observer`."""
        raise NotImplementedError

    def flush(self) -> None:
        """The units are about to change, or the motion has ended."""


def propagate(
    engine: Engine,
    system: Model,
    start: float,
    times: np.ndarray,
    control: StepControl,
    observer: StepObserver | None,
    events: tuple[Event, ...],
) -> SampleBuffer:
    """Integrate a system from `start` through `times`, changing units whenever the motion has
    outgrown them.

    Ends early at a terminal event, whose time and state are then the last ones, or when
    `control` says so.
    """
    model, k, y0, fp = type(system), system.constants, system.start, engine.dtype
    timed, rows = is_timed(system, events), moving(model)
    moment = TimeWindow(start, float(times[-1]) - start) if timed and len(times) else None
    units = units_at_start(system, moment)
    exact = system.extended_start if fp is np.longdouble else np.array(y0)
    y = rescaled(model, exact, -units.size).astype(fp)
    clock = (Clock if model.degree or timed else AbsoluteClock)(fp(start), fp(0))
    samples = SampleBuffer(
        times,
        np.empty((len(times), len(y0)), dtype=fp),
        # Of C's int, because ldexp takes four times as long by a wider one.
        np.empty(len(times), dtype=np.intc),
    )
    at_start = int(np.searchsorted(times, start, side="right"))
    samples.add(np.broadcast_to(y, (at_start, len(y))), units.size)
    # On a clock of its own such a model has a phase that is far smaller than its other variables.
    is_uneven = bool(model.degree) or not timed
    falling = bool(model.degree) and bool(is_falling(model, k, np.array(y0)))
    control.band, control.observer = norm_band(engine, system, falling), observer
    control.rows = None if isinstance(rows, slice) else rows
    while samples.done < len(times) and control.status is Status.OK:
        clock.factor = float(np.ldexp(1.0, units.rate))
        grid = clock.grid(times[samples.done : samples.done + SAMPLES_AT_ONCE].astype(fp))
        if not math.isfinite(float(grid[-1])):
            raise OverflowError
        if observer is not None:
            observer.begin(engine, clock, units)
        constants = units.constants(model, k)
        # Asked until it is not so: what becomes small on the way stays so, since it decays.
        is_uneven = is_uneven and uneven(y[rows].astype(float))
        control.longest = (
            longest_step(model, constants, float(clock.high), y.astype(float))
            if is_uneven
            else math.inf
        )
        leg = engine.leg(constants | clock.constants if timed else constants, y, grid, control)
        if observer is not None:
            observer.flush()
        samples.events += [
            Occurrence(events[hit.event].kind, clock.true(hit.time)) for hit in leg.hits
        ]
        samples.add(leg.rows[1:], units.size)  # the first row is where the leg began
        if leg.hit is not None:
            event = events[leg.hit.event]
            if event.passage is None:
                samples.events.append(Occurrence(event.kind, clock.true(leg.hit.time)))
                samples.end(samples.events[-1].time, leg.hit.state, units.size)
                break
            outcome = passed(system, event.passage, leg.hit, clock, units)
            if outcome.details is not None:
                samples.events.append(Occurrence(event.kind, outcome.time, outcome.details))
            y, size = np.array(outcome.state, dtype=fp), 0
            if outcome.onward is None:
                samples.end(outcome.time, y, size)
                break
            clock.restart(fp(outcome.onward))
            # Samples that the passage skips are taken behind it.
            reached = int(np.searchsorted(times, float(outcome.onward), side="right"))
            skipped = max(reached - samples.done, 0)
            rest = 0 if y[rows].any() or not model.degree else -REST_BITS
            samples.add(np.broadcast_to(y, (skipped, len(y))), rest)
        else:
            clock.advance(leg.time)
            y, size = leg.state, units.size
        if samples.done == len(times) and size < LARGEST_EXPONENT // 2:
            break  # no leg is to follow, and this one was far from the largest number
        if timed:
            moment = TimeWindow(float(clock.high), float(times[-1]) - start)
        new = Units.fit(model, k, y.astype(float), size, moment, falling) if model.degree else units
        if new.size < -REST_BITS:
            end = np.where(state_powers(model), 0, y)
            samples.add(np.broadcast_to(end, (len(times) - samples.done, len(y))), -REST_BITS)
        elif new.size > LARGEST_EXPONENT:
            control.give_up(Status.FAILED, f"{OVERFLOW_MESSAGE} at {clock.true(fp(0)):.6g}")
        y, units = scaled_by(model, y, size - new.size), new
    return samples


def passed(system: Model, passage: Passage, hit: Hit, clock: Clock, units: Units) -> EventOutcome:
    """The outcome of a terminal event that lets the motion through."""
    state = scaled_by(type(system), hit.state, units.size)
    numbers = attributes(system.constants, hit.state.dtype.type)
    return passage(clock.exact(hit.time), [*state], numbers)


def scaled_by(model: type[Model], y: np.ndarray, size: int) -> np.ndarray:
    """A state (m,) in units of omega that are 2**size times as small, in any precision."""
    factors = [2.0 ** (size * power) for power in state_powers(model).tolist()]
    return np.asarray(y * np.array(factors).astype(y.dtype))


def norm_band(engine: Engine, system: Model, falling: bool) -> tuple[float, float] | None:
    """Where the norm of the state may stay before it gets new units; None for anywhere.

    New units serve a motion that decays or grows. A model without degrees has none, a body at rest
    needs none, and under a torque that is constant the motion settles at a size of its own, unless
    it begins far above it.
    """
    constant = {name for name, degree in system.degree.items() if degree == 0} - system.resisting
    forced = any(np.any(system.constants[name]) for name in constant)
    turning = np.array(system.start)[moving(type(system))].any()
    return engine.band if system.degree and turning and (falling or not forced) else None
