"""The driver of the engines: from a start through the sample times, in units that fit the motion at
every moment."""

import math
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..engines.protocol import Engine, Hit, Status, Watch
from ..models.base import Constants, Event, Model, Passed
from ..models.constants import attributes
from .trajectory import Occurrence
from .units import Calendar, Clock, Units

BLOCK = 1 << 16
"""Samples handed to an engine at once."""

LIMIT = 2**12
"""Binary orders of magnitude below 1 at which a motion is called at rest: 1e-1233, far below the
smallest double."""

LARGEST, OUTGROWN = 1024, "the motion has outgrown the largest number"
"""The binary order of magnitude of the largest double, and what is said of a motion beyond it."""


class Path(NamedTuple):
    """A motion at the times passed: state (n, m) in units of 2**exponent (n,), and the events
    met."""

    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    events: tuple[Occurrence, ...]


class Witness(Protocol):
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
    watch: Watch,
    witness: Witness | None = None,
    events: tuple[Event, ...] = (),
) -> Path:
    """Integrate a system from `start` through `times`, changing units whenever the motion has
    outgrown them.

    Ends early at a terminal event, whose time and state are then the last ones, or when `watch`
    says so.
    """
    model, k, y0, fp = type(system), system.constants, system.start, engine.dtype
    units = Units.fit(model, k, np.array(y0))
    # In double, which is exact: a power of two.
    y = np.ldexp(np.array(y0), -units.size).astype(fp)
    clock = (Clock if model.degree else Calendar)(fp(start), fp(0))
    rows, exponent = np.empty((len(times), len(y0)), dtype=fp), np.full(len(times), units.size)
    # The start itself is a sample that no step reaches.
    done = int(np.searchsorted(times, start, side="right"))
    rows[:done] = y
    found: list[Occurrence] = []
    # A torque keeps a body from decaying, and its units were fitted to it at the start.
    forced = any(k[name] for name, degree in model.degree.items() if degree == 0)
    watch.band = engine.band if model.degree and any(y0) and not forced else None

    def occurrence(hit: Hit) -> Occurrence:
        return Occurrence(events[hit.event].kind, clock.true(hit.time))

    watch.observer = witness
    while done < len(times) and watch.status is Status.OK:
        clock.factor = float(np.ldexp(1.0, units.rate))
        grid = clock.grid(times[done : done + BLOCK].astype(fp))
        # In the units of a very fast motion the end may be beyond the largest double.
        if not math.isfinite(float(grid[-1])):
            raise OverflowError
        if witness is not None:
            witness.begin(engine, clock, units)
        leg = engine.leg(units.constants(model, k), y, grid, watch)
        if witness is not None:
            witness.flush()
        found += [occurrence(hit) for hit in leg.hits]
        passed = len(leg.rows) - 1
        rows[done : done + passed], exponent[done : done + passed] = leg.rows[1:], units.size
        done += passed
        if leg.hit is not None:
            end, way = occurrence(leg.hit), passed_through(events, leg.hit, k, fp)
            if way is not None:
                end = Occurrence(end.kind, way.time, way.details)
            if way is not None and way.state is not None:
                found.append(end)
                y, clock = np.array(way.state, dtype=fp), Calendar(fp(way.onward), fp(0))
                # Samples that the passage has leapt over are taken behind it.
                here = done + int(np.searchsorted(times[done:], float(way.onward), side="right"))
                rows[done:here], done = y, here
                continue
            return Path(
                np.append(times[:done], end.time),
                np.concatenate((rows[:done], leg.hit.state[None])),
                np.append(exponent[:done], units.size),
                (*found, end),
            )
        clock.advance(leg.time)
        new = Units.fit(model, k, leg.state.astype(float), units.size)
        # At rest for good: what follows is 0 in any precision, and would take steps for nothing.
        if new.size < -LIMIT:
            rows[done:], exponent[done:], done = 0, -LIMIT, len(times)
        elif new.size > LARGEST:
            watch.give_up(Status.FAILED, f"{OUTGROWN} at {clock.true(fp(0)):.6g}")
        y, units = leg.state * fp(2.0 ** (units.size - new.size)), new
    return Path(times[:done], rows[:done], exponent[:done], tuple(found))


def passed_through(events: tuple[Event, ...], hit: Hit, k: Constants, fp: Any) -> Passed | None:
    """How the motion goes on after a terminal event, in numbers of the type fp; None if it ends."""
    passage = events[hit.event].passage
    return passage(hit.time, [*hit.state], attributes(k, fp)) if passage else None
