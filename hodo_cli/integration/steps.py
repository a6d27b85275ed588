"""The steps of a motion under way: one record of them for all that reads them, and the search for
the motion's events."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..engines.polynomial import (
    CHEBYSHEV,
    TAYLOR,
    chebyshev,
    isolate,
    rounding,
    to_bernstein,
    weights,
)
from ..engines.units import Clock, Units
from ..models.base import Event, attributes


@dataclass(frozen=True)
class Steps:
    """Consecutive steps of a motion in fixed units: their `ends` (n, 2) in the engine's time, and
    the coefficients `series` (n, m, degree + 1) of their polynomials in a basis; doubles, or long
    doubles where the engine is finer.

    The clock is that of the motion under way, so that steps are read before it goes on.
    """

    ends: np.ndarray
    series: np.ndarray
    basis: str
    clock: Clock
    units: Units

    def __len__(self) -> int:
        return len(self.ends)

    @cached_property
    def lengths(self) -> np.ndarray:
        """The lengths (n,) in the engine's time."""
        return np.diff(self.ends)[:, 0]

    def chosen(self, index: Any) -> "Steps":
        """Some of the steps."""
        return replace(self, ends=self.ends[index], series=self.series[index])

    def in_double(self) -> "Steps":
        """The same steps in doubles."""
        return replace(self, ends=self.ends.astype(float), series=self.series.astype(float))

    @cached_property
    def coefficients(self) -> np.ndarray:
        """The coefficients (n, m, degree + 1) of the polynomials of the place x in [0, 1]. Those of
        a Taylor series, which are of the time since the start, change by powers of the length."""
        if self.basis != TAYLOR:
            return self.series
        c, order = self.series.copy(), self.series.shape[2] - 1
        c[:, :, 1:] *= np.cumprod(np.repeat(self.lengths[:, None], order, axis=1), axis=1)[:, None]
        return c

    @cached_property
    def bernstein(self) -> np.ndarray:
        """The Bernstein coefficients (n, m, degree + 1) of the polynomials."""
        c = self.coefficients
        return np.asarray(c @ to_bernstein(self.basis, c.shape[2] - 1, c.dtype))

    def times_at(self, x: np.ndarray) -> np.ndarray:
        """The case's times (n, k), as long doubles, at places x (k,) or (n, k) of the steps."""
        return self.clock.exact_times(self.ends[:, :1] + x * self.lengths[:, None])

    def until(self, x: Any) -> "Steps":
        """A single step up to its place x."""
        if x == 1:
            return self
        degree = self.series.shape[2] - 1
        nodes, _, transform = chebyshev_values(degree, self.series.dtype)
        series = self.bernstein @ weights(x * nodes, degree).T @ transform
        start = self.ends[0, 0]
        ends = np.array([[start, start + x * self.lengths[0]]])
        return replace(self, ends=ends, series=series, basis=CHEBYSHEV)


class EventRoot(NamedTuple):
    """A zero of an event's function, at a place x of a step."""

    event: Event
    step: int
    x: Any


class EventSearch:
    """Finds the zeros of the functions of a motion's events in its steps."""

    def __init__(self, events: tuple[Event, ...]) -> None:
        self.events = events

    def begin(self, clock: Clock, k: Mapping[str, Any], y: np.ndarray) -> None:
        """The steps from here on start from the state y (m,), under constants k of their units."""
        if not self.events:
            return
        self.clock, self.k, self.numbers = clock, k, attributes(k, y.dtype.type)
        self.values = [self.values_of(y[0] * 0, y)]

    def values_of(self, time: Any, y: np.ndarray) -> list[float]:
        """The values of the functions in a state y (m,) at a time of the engine."""
        t = self.clock.exact(time)
        return [float(event.function(t, [*y], self.numbers)) for event in self.events]

    def note(self, time: Any, y: np.ndarray) -> bool:
        """Keep the values in the state y (m,) at the end of a step; returns whether an event that
        ends the motion has changed its sign in it."""
        if not self.events:
            return False
        self.values.append(self.values_of(time, y))
        changes = zip(self.events, *self.values[-2:], strict=True)
        return any(event.terminal and before * after < 0 for event, before, after in changes)

    def roots(self, steps: Steps) -> list[EventRoot]:
        """The zeros within the steps noted, in order of time, up to the first that ends the
        motion."""
        if not self.events:
            return []
        signs, self.values = np.sign(self.values).T, self.values[-1:]
        found = [
            EventRoot(event, row, x)
            for event, of_event in zip(self.events, signs, strict=True)
            for row, x in self.zeros(event, steps, of_event)
        ]
        found.sort(key=lambda root: (root.step, root.x))
        last = next((i for i, root in enumerate(found) if root.event.terminal), len(found))
        return found[: last + 1]

    def zeros(self, event: Event, steps: Steps, signs: np.ndarray) -> list[tuple[int, Any]]:
        """The steps and the places in them where an event's function changes its sign, from its
        signs (n + 1,) in the states between the steps.

        The signs decide: a motion that starts at a zero does not pass through it, and one that
        comes to a zero at the end of a step does so there.
        """
        changes = np.flatnonzero(signs[:-1] * signs[1:] < 0).tolist()
        degree, fp = steps.series.shape[2] - 1, steps.series.dtype
        nodes, at_nodes, transform = chebyshev_values(degree, fp)
        state, times = steps.bernstein @ at_nodes, steps.times_at(nodes).astype(fp)
        values = event.function(times, [*state.swapaxes(0, 1)], attributes(self.k, fp.type))
        c = np.broadcast_to(values, times.shape) @ transform
        b = c @ to_bernstein(CHEBYSHEV, degree, fp)
        zeros, found = isolate(b, rounding(c, CHEBYSHEV)), []
        for row in {*zeros.row.tolist(), *changes}:
            is_own = zeros.row == row
            x, half = zeros.x[is_own], zeros.width[is_own] / 2
            if not x.size:  # the zero is so near to the end of the step that its series has none
                x, half = np.ones(1, fp), np.zeros(1, fp)
            # Between two zeros, and away from the intervals in which rounding hides the sign.
            inner = ((x + half)[:-1] + (x - half)[1:]) / 2
            ordered = np.sign([signs[row], *(weights(inner, degree) @ b[row]), signs[row + 1]])
            found += [(row, x[j]) for j in np.flatnonzero(ordered[:-1] * ordered[1:] < 0)]
            if ordered[-1] == 0 != ordered[-2]:
                found.append((row, fp.type(1)))
        return found


@lru_cache(maxsize=8)
def chebyshev_values(degree: int, fp: np.dtype[Any]) -> tuple[np.ndarray, ...]:
    """Chebyshev's nodes, and the matrices that convert Bernstein coefficients to values there, and
    values there to Chebyshev's coefficients."""
    nodes, transform = (c.astype(fp) for c in chebyshev(degree))
    return nodes, weights(nodes, degree).T, transform
