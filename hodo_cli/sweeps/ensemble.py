"""Many motions of one model side by side: their ends, the sides of the separatrix they stand on,
their crossings.

What `integrate` and `classify` do for one case is done here for arrays of them. A motion about
which anything is in doubt (too near the separatrix, too stiff, at rest, hits that do not alternate)
is left unsettled, for these two to decide by themselves.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..engines.protocol import Passages
from ..integration.choice import MANY_STEPS
from ..integration.units import Units
from ..models import rigid_body
from ..models.base import Event, Model
from ..models.constants import Structure, namespace

if TYPE_CHECKING:
    from ..engines.taylor_batch import Lanes

FOLD = 16.0
"""The factor by which |omega| may change before it gets new units."""

MOST_LEGS = 2000
"""Changes of units beyond which a motion is left to the driver of single cases."""

MOST_STEPS = int(4 * MANY_STEPS)
"""Steps after which a motion is left to that driver too."""

ROUNDS, TANGENT = 60, 1e-8
"""Of Newton's method: the most steps, and the size of a step whose square is nothing where all
rates are at most 1."""

DOUBT = 1e-9
"""Where |D| is a smaller part of the sum of its two terms, its sign may be that of an error."""

APART = 1e-4
"""Zeros of D that are nearer to each other, in units of the fastest time, may be one touch without
a crossing."""


@dataclass(frozen=True)
class Ensemble:
    """n motions: the constants of their equations (c, n), flat as `structure` says, states at the
    start (m, n), span.

    All have one `order` of the axes by inertia, and the separatrix as their `event`.
    """

    model: type[Model]
    structure: Structure
    constants: np.ndarray
    start: np.ndarray
    span: tuple[float, float]
    order: tuple[int, int, int]
    event: Event

    @property
    def inertia(self) -> np.ndarray:
        """A1, A2, A3 of each motion (3, n)."""
        rows = [
            name
            for name, size in self.structure
            if not isinstance(size, str)
            for _ in range(max(size, 1))
        ]
        return self.constants[[rows.index(name) for name in ("A1", "A2", "A3")]]

    def degrees(self) -> np.ndarray:
        """The degree in omega of the terms that each row of the constants multiplies; nan for the
        other rows."""
        found: list[float] = []
        for name, size in self.structure:
            if not isinstance(size, str):
                found += [self.model.degree.get(name, math.nan)] * max(size, 1)
        return np.array(found)

    def units(self, at: Any, y: np.ndarray, size: Any = 0) -> Units:
        """The units for the motions `at`, in states y (m, n) in units of 2**size."""
        k = namespace(self.structure, list(self.constants[:, at]))
        return Units.fit(self.model, vars(k), y, size)

    def decay(self) -> np.ndarray:
        """A bound (n,) on the relative rate at which the linear terms change the energy's square
        root.

        In the coordinates sqrt(A) omega the energy is half the squared length, and its rate of
        change lies between the extreme eigenvalues of the symmetric part of the linear terms:
        within Gershgorin's discs.
        """
        m = len(self.start)
        linear = np.where(
            (self.degrees() == 1)[:, None] | np.isnan(self.degrees())[:, None], self.constants, 0.0
        )
        k = namespace(self.structure, list(linear))
        zero = np.zeros(self.start.shape[1])
        columns = [self.model.rhs(0.0, [zero + (i == j) for i in range(m)], k) for j in range(m)]
        matrix = np.array(
            [[np.broadcast_to(entry, zero.shape) for entry in column] for column in columns]
        )
        root = np.sqrt(self.inertia)
        weighted = matrix * root[None, :] / root[:, None]
        return np.asarray(np.abs(weighted + weighted.swapaxes(0, 1)).sum(axis=1).max(axis=0) / 2)


class Crossings(NamedTuple):
    """Passages through the separatrix, in order of motion and time, (k,) each: `rises` where D > 0
    from then on."""

    motion: np.ndarray
    time: np.ndarray
    rises: np.ndarray
    momentum: np.ndarray


@dataclass
class Outcome:
    """What became of n motions: states at the end (m, n) in units of 2**exponent (n,), and their
    crossings.

    `first` and `last` are the sign of D at both ends (0: a spherical body), `separation` the least
    part of its two terms that |D| was at the start, the end and the changes of units. Where
    `settled` is False nothing here counts.
    """

    state: np.ndarray
    exponent: np.ndarray
    steps: np.ndarray
    first: np.ndarray
    last: np.ndarray
    separation: np.ndarray
    settled: np.ndarray
    crossings: Crossings


def sides(
    A: np.ndarray, omega: np.ndarray, order: tuple[int, int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """The sign of D (n,), and |D| as a part of the sum of its two terms (infinite for a spherical
    body)."""
    outer, inner = rigid_body.separatrix_terms(A, omega, order)
    total = outer + inner
    part = np.divide(np.abs(outer - inner), total, out=np.zeros_like(total), where=total > 0)
    spherical = A[order[0]] == A[order[2]]
    return np.sign(outer - inner), np.where(spherical, np.inf, part)


def advance(e: Ensemble, tol: float | None) -> Outcome:
    """All motions of an ensemble through their span.

    Each motion goes in legs of its own, at whose ends its units are renewed, so that it is right
    relative to its size however far it decays. For a model that crosses the separatrix at most
    once, D is looked for only in the legs at whose ends its signs differ.
    """
    begin, end = e.span
    A, n = e.inertia, e.start.shape[1]
    units = e.units(slice(None), e.start)
    size, rate = units.size, units.rate
    y = np.ldexp(e.start, -size)
    first, separation = sides(A, y, e.order)
    leg, settled = _legs(e, rate, (end - begin))
    settled &= (separation > DOUBT) & (y != 0).any(axis=0)
    side, t, steps = first.copy(), np.full(n, begin), np.zeros(n, dtype=np.int64)
    forced = bool(np.any(e.constants[e.degrees() == 0]))
    found: list[Crossings] = []
    while (active := np.flatnonzero(settled & (t < end))).size:
        target = np.minimum(t[active] + leg[active], end)
        passed = _Leg(
            e,
            active,
            size[active],
            rate[active],
            target - t[active],
            y[:, active],
            side[active],
            tol,
        )
        well = passed.well & (
            forced | (np.abs(np.log2(np.abs(passed.end).max(axis=0) + 1e-300)) < 6)
        )
        settled[active] = well
        found.append(passed.crossings(t[active]))
        side[active], t[active], y[:, active] = passed.side, target, passed.end
        separation[active] = np.minimum(separation[active], passed.separation)
        steps[active] += passed.steps
        units = e.units(active, passed.end, size[active])
        y[:, active] = np.ldexp(passed.end, size[active] - units.size)
        size[active], rate[active] = units.size, units.rate
    return Outcome(y, size, steps, first, side, separation, settled, _joined(found, settled))


def _legs(e: Ensemble, rate: np.ndarray, span: float) -> tuple[np.ndarray, np.ndarray]:
    """The length of each motion's legs (n,), and whether they are few and short enough to be taken
    here."""
    decay = e.decay()
    with np.errstate(divide="ignore"):
        leg = np.minimum(_rounded(math.log(FOLD) / decay), max(span, 1e-300))
    steps = span * np.maximum(decay / 8.8, np.ldexp(0.5, rate))
    return leg, (steps < MANY_STEPS) & (span / leg < MOST_LEGS)


def _rounded(values: np.ndarray) -> np.ndarray:
    """Values cut to four bits, so that small multiples of them are exact."""
    fraction, power = np.frexp(np.minimum(values, 1e300))
    return np.asarray(np.ldexp(np.floor(fraction * 16), power - 4))


def _lanes(e: Ensemble, watching: bool, tol: float | None) -> "Lanes":
    from ..engines import taylor_batch  # heyoka may be missing

    return taylor_batch.build(e.model, e.structure, e.event if watching else None, tol)  # type: ignore[arg-type]


def _root(
    e: Ensemble, A: np.ndarray, k: np.ndarray, y: np.ndarray, spans: np.ndarray, guess: np.ndarray, side: np.ndarray,
    tol: float | None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """When D = 0 (n,) in motions that leave their `side` once within their spans, and the states
    there (m, n).

    Newton's method from a guess, kept within the bracket that the signs of D leave; nan where it
    does not converge. The last of its steps, whose square does not count, is taken along the
    tangent.
    """
    engine, left = _lanes(e, False, tol), np.arange(len(spans))
    at, there = np.full(len(spans), np.nan), y.copy()
    low, high, t = np.zeros_like(spans), spans.copy(), guess
    state, *_ = engine.leg(k, y, t, MOST_STEPS)
    for _ in range(ROUNDS):
        rate = np.array(e.model.rhs(0.0, list(state), namespace(e.structure, list(k[:, left]))))
        value, faster, slower = (
            np.subtract(*rigid_body.separatrix_terms(A[:, left], w, e.order))
            for w in (state, state + rate, state - rate)
        )
        before = value * side[left] > 0
        low[left], high[left] = np.where(before, t, low[left]), np.where(before, high[left], t)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = t - 2 * value / (faster - slower)
        new = np.where((new >= low[left]) & (new <= high[left]), new, (low[left] + high[left]) / 2)
        step = new - t
        done = np.abs(step) < TANGENT
        at[left[done]], there[:, left[done]] = new[done], (state + step * rate)[:, done]
        left, t, step, state = left[~done], new[~done], step[~done], state[:, ~done]
        if not left.size:
            break
        state, *_ = engine.leg(k[:, left], state, step, MOST_STEPS)
    return at, there


class _Leg:
    """One leg of the motions `active`, each in its own units and over its own time."""

    def __init__(
        self, e: Ensemble, active: np.ndarray, size: np.ndarray, rate: np.ndarray, time: np.ndarray, y: np.ndarray,
        side: np.ndarray, tol: float | None,
    ) -> None:  # fmt: skip
        self.active, self.size, self.rate = active, size, rate
        self.A = e.inertia[:, active]
        degree = e.degrees()[:, None]
        shift = np.where(np.isnan(degree), 0, np.nan_to_num(degree - 1) * size - rate).astype(
            np.int64
        )
        k, spans = np.ldexp(e.constants[:, active], shift), np.ldexp(time, rate)
        plain = _lanes(e, not e.model.crosses_once, tol)
        self.end, self.steps, self.well, self.found = plain.leg(k, y, spans, MOST_STEPS)
        self.side, self.separation = sides(self.A, self.end, e.order)
        self.well &= (self.separation > DOUBT) & np.isfinite(self.end).all(axis=0)
        if e.model.crosses_once and (turned := np.flatnonzero(self.side * side < 0)).size:
            before = sides(self.A, y, e.order)[1]
            guess = (spans * before / (before + self.separation))[turned]
            at, state = _root(
                e,
                self.A[:, turned],
                k[:, turned],
                y[:, turned],
                spans[turned],
                guess,
                side[turned],
                tol,
            )
            self.found = Passages(turned, at, self.side[turned].astype(np.int64), state)
            self.well[turned] &= np.isfinite(at)
        self.well &= ~self._doubtful(side)

    def _doubtful(self, side: np.ndarray) -> np.ndarray:
        """The motions whose passages do not lead, in turns, from the side before the leg to the
        side after it."""
        motion, time, direction, _ = self.found
        wrong = np.zeros(len(side), dtype=bool)
        new = np.diff(motion, prepend=-1) != 0
        before = np.where(new, side[motion], np.roll(direction, 1))
        apart = np.where(new, np.inf, np.diff(time, prepend=-np.inf))
        wrong[motion[(direction != -before) | (apart < APART)]] = True
        reached = side.copy()
        reached[motion] = direction  # of several, the last one counts
        return np.asarray(wrong | (reached != self.side))

    def crossings(self, start: np.ndarray) -> Crossings:
        """The passages in true units; `start` is the time at which the leg began (n,)."""
        motion, time, direction, state = self.found
        momentum = np.ldexp(
            np.sqrt(np.square(self.A[:, motion] * state).sum(axis=0)), self.size[motion]
        )
        at = start[motion] + np.ldexp(time, -self.rate[motion])
        return Crossings(self.active[motion], at, direction > 0, momentum)


def _joined(found: list[Crossings], settled: np.ndarray) -> Crossings:
    """The crossings of all legs, of the settled motions only, in order."""
    if not found:
        return Crossings(
            np.empty(0, dtype=np.int64), np.empty(0), np.empty(0, dtype=bool), np.empty(0)
        )
    motion, time, rises, momentum = (np.concatenate(each) for each in zip(*found, strict=True))
    order = np.lexsort((time, motion))
    order = order[settled[motion[order]]]
    return Crossings(motion[order], time[order], rises[order], momentum[order])
