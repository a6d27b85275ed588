"""The driver of the engines: from a start through the sample times, in units that fit the motion at
every moment."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..engines.protocol import Engine, Hit, Status, StepControl, uneven
from ..models.base import Constants, Event, EventOutcome, Model
from ..models.constants import attributes
from .trajectory import Occurrence
from .units import Calendar, Clock, Units, longest_step, units_at_start

SAMPLES_AT_ONCE = 1 << 16
"""Samples handed to an engine at once."""

LIMIT = 2**12
"""Binary orders of magnitude below 1 at which a motion is called at rest: 1e-1233, far below the
smallest double."""

LARGEST, OVERFLOW_MESSAGE = 1024, "the motion has outgrown the largest number"
"""The binary order of magnitude of the largest double, and what is said of a motion beyond it."""


class Sampled(NamedTuple):
    """A motion at the times passed: state (n, m) in units of 2**exponent (n,), and the events
    met."""

    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    events: tuple[Occurrence, ...]

    def at(self, rows: np.ndarray | slice) -> "Sampled":
        """Some of the samples, with all events."""
        return Sampled(self.time[rows], self.state[rows], self.exponent[rows], self.events)


@dataclass
class Samples:
    """The states (n, m) at the sample times (n,), of which the first `done` are known; each in
    units of 2**exponent."""

    times: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    done: int = 0

    def add(self, states: np.ndarray, size: int) -> None:
        """The states at the next times, in units of 2**size."""
        here = slice(self.done, self.done + len(states))
        self.state[here], self.exponent[here] = states, size
        self.done += len(states)

    def path(self, events: Iterable[Occurrence]) -> Sampled:
        """What is known."""
        every = Sampled(self.times, self.state, self.exponent, tuple(events))
        return every.at(slice(self.done))

    def ended(self, events: Iterable[Occurrence], state: np.ndarray, size: int) -> Sampled:
        """What is known, and as the last sample the state (m,) at the last of the events."""
        time, before, exponent, events = self.path(events)
        time = np.append(time, events[-1].time)
        return Sampled(
            time, np.concatenate((before, state[None])), np.append(exponent, size), events
        )


class StepObserver(Protocol):
    """Sees every step of a motion, as an `Observer` that knows in which units the step is."""

    def begin(self, engine: Engine, clock: Clock, units: Units) -> None:
        """The steps from here on are in these units, their times those of the clock."""

    def __call__(self, start: Any, end: Any, series: np.ndarray) -> None:
        """See `Observer`."""

    def flush(self) -> None:
        """The units are about to change, or the motion has ended."""


def propagate(
    engine: Engine,
    system: Model,
    start: float,
    times: np.ndarray,
    watch: StepControl,
    witness: StepObserver | None = None,
    events: tuple[Event, ...] = (),
) -> Sampled:
    """Integrate a system from `start` through `times`, changing units whenever the motion has
    outgrown them.

    Ends early at a terminal event, whose time and state are then the last ones, or when `watch`
    says so.
    """
    model, k, y0, fp = type(system), system.constants, system.start, engine.dtype
    units = units_at_start(system)
    exact = system.extended_start if fp is np.longdouble else np.array(y0)
    y = np.ldexp(exact, -units.size).astype(fp)
    clock = (Clock if model.degree else Calendar)(fp(start), fp(0))
    shape = len(times), len(y0)
    # Of C's int, because ldexp takes four times as long by a wider one.
    samples = Samples(times, np.empty(shape, dtype=fp), np.empty(len(times), dtype=np.intc))
    at_start = int(np.searchsorted(times, start, side="right"))
    samples.add(np.broadcast_to(y, (at_start, len(y))), units.size)
    found: list[Occurrence] = []
    is_uneven = True
    watch.band, watch.observer = norm_band(engine, system), witness
    while samples.done < len(times) and watch.status is Status.OK:
        clock.factor = float(np.ldexp(1.0, units.rate))
        next_times = times[samples.done : samples.done + SAMPLES_AT_ONCE]
        grid = clock.grid(next_times.astype(fp))
        if not math.isfinite(float(grid[-1])):
            raise OverflowError
        if witness is not None:
            witness.begin(engine, clock, units)
        constants = units.constants(model, k)
        # Asked until it is not so: what becomes small on the way stays so, since it decays.
        is_uneven = is_uneven and uneven(y.astype(float))
        watch.longest = (
            longest_step(model, constants, float(grid[0]), y.astype(float))
            if is_uneven
            else math.inf
        )
        leg = engine.leg(constants, y, grid, watch)
        if witness is not None:
            witness.flush()
        found += [Occurrence(events[hit.event].kind, clock.true(hit.time)) for hit in leg.hits]
        samples.add(leg.rows[1:], units.size)  # the first row is where the leg began
        if leg.hit is not None:
            way = passed(events[leg.hit.event], leg.hit, clock, k)
            found.append(Occurrence(events[leg.hit.event].kind, way.time, way.details))
            if way.onward is None:
                state = np.array(way.state, dtype=fp)
                return samples.ended(found, state, units.size)
            y, clock = np.array(way.state, dtype=fp), Calendar(fp(way.onward), fp(0))
            # Samples that the passage has leapt over are taken behind it.
            leapt = int(np.searchsorted(times, float(way.onward), side="right")) - samples.done
            samples.add(np.broadcast_to(y, (max(leapt, 0), len(y))), units.size)
            continue
        clock.advance(leg.time)
        if samples.done == len(times) and units.size < LARGEST // 2:
            break  # no leg is to follow, and this one was far from the largest number
        new = Units.fit(model, k, leg.state.astype(float), units.size)
        if new.size < -LIMIT:
            samples.add(np.zeros((len(times) - samples.done, len(y0))), -LIMIT)
        elif new.size > LARGEST:
            watch.give_up(Status.FAILED, f"{OVERFLOW_MESSAGE} at {clock.true(fp(0)):.6g}")
        y, units = leg.state * fp(2.0 ** (units.size - new.size)), new
    return samples.path(found)


def passed(event: Event, hit: Hit, clock: Clock, k: Constants) -> EventOutcome:
    """What becomes of the motion at a terminal event: it ends, unless the event lets it through.

    A model with such an event has units of its own, so that the time and the state are its own too.
    """
    if event.passage is None:
        return EventOutcome(clock.true(hit.time), {}, [*hit.state])
    numbers = attributes(k, hit.state.dtype.type)
    return event.passage(hit.time, [*hit.state], numbers)


def norm_band(engine: Engine, system: Model) -> tuple[float, float] | None:
    """Where the norm of the state may stay before it gets new units; None for anywhere.

    New units serve a motion that decays or grows. A model without degrees has none, a body at rest
    needs none, and under a torque that is constant the motion settles at a size of its own.
    """
    constant = [name for name, degree in system.degree.items() if degree == 0]
    forced = any(system.constants[name] for name in constant)
    return engine.band if system.degree and any(system.start) and not forced else None
