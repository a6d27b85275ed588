"""Where a motion passes the separatrix: every zero of D along its steps, and which are certain.

With a^2 = A_l (A_l - A_m) and b^2 = A_s (A_m - A_s)

    D = (a w_l - b w_s)(a w_l + b w_s),

where l, m, s are the axes of largest, middle and smallest moment A, and w is the angular velocity.
So the zeros of D are the zeros of two linear forms of the state. The forms have the degree of the
engine's polynomial, half the degree of D, and lose no digits near the middle axis, where both
vanish.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..cases.case import Case
from ..engines.polynomial import isolate, rounding, values_and_slopes
from ..engines.protocol import EPS
from ..engines.units import Units
from ..models import rigid_body
from ..models.base import Equations, Event, rescaled
from ..models.rigid_body import UNDETERMINED, BodyFrame, inertia_order, margin
from .steps import Steps

CERTAIN_ERRORS = 8.0
"""The sign of D is certain where the margin is this many times the error of the state. The error
can shift the margin by twice its own size, once for each term of D; the rest is a reserve for an
error that is measured near the crossing instead of at it."""


@dataclass(frozen=True)
class Crossing:
    """A passage through the separatrix: its time, the axes that it leaves and enters, and |G|
    there.

    `error` is the measured error of `time`, nan where none was measured.
    """

    time: float
    start: int
    end: int
    momentum: float
    error: float = math.nan


def label_at_start(
    case: Case, first_sample: float, labels: np.ndarray, crossings: Sequence[Crossing]
) -> int:
    """The label at the start of a motion: the label of the first sample, unless the motion has
    crossed or the body has stopped before that sample."""
    if crossings and crossings[0].time <= first_sample:
        return crossings[0].start
    body, label = case.system, int(labels[0])
    if label != UNDETERMINED or first_sample == case.time.start or not isinstance(body, BodyFrame):
        return label
    # The body has no side any more at its first sample, where a brake has stopped it.
    omega = np.array([body.start[:3]], dtype=float)
    return int(body.enclosed(omega, CERTAIN_ERRORS * EPS)[0])


class SignChanges(NamedTuple):
    """Moments (k,) of a motion, in order of time, that show on which side of the separatrix it is.

    `margin` is `rigid_body.margin`, or 0 where the separatrix function `vanishes`; `rate` is how
    fast the margin changes with time, `momentum` is |G|, and `axis` the label of the side.
    """

    time: np.ndarray
    margin: np.ndarray
    vanishes: np.ndarray
    rate: np.ndarray
    momentum: np.ndarray
    axis: np.ndarray

    @classmethod
    def joined(cls, parts: list["SignChanges"]) -> "SignChanges":
        """The moments of several stretches, in order of time."""
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        order = np.argsort(columns[0], kind="stable")
        return cls(*(column[order] for column in columns))


class CrossingList(NamedTuple):
    """The certain crossings, the half-widths of the intervals to which the error of the motion
    confines their times, and the times at which it is undecided whether the motion crosses."""

    crossings: list[Crossing]
    widths: list[float]
    undecided: list[float]


@dataclass
class CrossingSearch:
    """Searches the steps of a motion for zeros of D, and notes the moments that it finds in
    `parts`.

    It notes nothing in a step in which |margin| is certainly larger than `uncertainty` throughout.
    """

    body: BodyFrame
    uncertainty: float
    parts: list[SignChanges] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.A = self.body.exact_moments
        self.order = inertia_order(self.A)

    def examine(self, steps: Steps) -> None:
        """Search steps: all of them in double precision, then the few in which the separatrix
        function may vanish in their own precision."""
        if not (len(steps) and has_sides(self.body)):
            return
        steps = replace(steps, series=steps.series[:, :3])
        # Few steps come near the separatrix, and long double is several times slower.
        near = self._near(*self._bernstein(steps.in_double()))
        if near.size:
            self._search(steps.chosen(near))

    def _bernstein(self, steps: Steps) -> tuple[np.ndarray, np.ndarray]:
        """The Bernstein coefficients (n, 3, degree + 1) of steps, and a bound (n,) on the rounding
        of the two linear factors of the separatrix function."""
        b = steps.bernstein
        outer, inner = rigid_body.separatrix_roots(self.A.astype(b.dtype), self.order)
        noise = rounding(steps.coefficients, steps.basis)
        return b, outer * noise[:, self.order[0]] + inner * noise[:, self.order[2]]

    def _near(self, b: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """The positions (k,) of the steps in which |margin|, the distance from the separatrix
        relative to |omega|, may be `uncertainty` or less. The steps have the Bernstein coefficients
        b (n, 3, degree + 1), and the linear factors of the separatrix function the rounding
        (n,)."""
        A = self.A.astype(b.dtype)
        # |margin| is at least the smaller |form| over sqrt(a^2 + b^2) |omega|. The
        # `separatrix_roots` are a and b.
        scale = np.hypot(*rigid_body.separatrix_roots(A, self.order))
        most = scale * np.sqrt(np.square(np.abs(b).max(axis=2)).sum(axis=1))
        bound = np.maximum(self.uncertainty * most, noise)[:, None]
        forms = rigid_body.separatrix_forms(A, b.swapaxes(0, 1), self.order)
        clear = (forms > bound).all(axis=2) | (forms < -bound).all(axis=2)
        return np.flatnonzero(~clear.all(axis=0))

    def _search(self, near: Steps) -> None:
        """Note moments in steps: the ends, and the zeros and extrema of the two linear factors
        (forms) of the separatrix function. At an extremum between two zeros the margin shows
        whether the pair is a touch."""
        b, noise = self._bernstein(near)
        steps, fp = np.arange(len(b)), b.dtype
        forms = np.concatenate(
            rigid_body.separatrix_forms(self.A.astype(fp), b.swapaxes(0, 1), self.order)
        )
        zeros = isolate(forms, np.tile(noise, 2))
        # A difference of two coefficients has the rounding of both.
        extrema = isolate(np.diff(forms, axis=1), np.tile(2 * noise, 2))
        of_zeros = zeros.row % len(b), zeros.x
        places = (
            # Both ends are noted too: a step with a certain side at one end needs no more.
            (steps, np.zeros(len(b), dtype=fp)),
            (steps, np.ones(len(b), dtype=fp)),
            of_zeros,
            (extrema.row % len(b), extrema.x),
            # Between zeros of the two forms, as on both sides of the middle axis, neither has an
            # extremum.
            middles(*of_zeros),
        )
        row, x = map(np.concatenate, zip(*places, strict=True))
        vanishes = np.repeat((False, False, True, False, False), [len(of) for of, _ in places])
        self._note(row, x, vanishes, b, near)

    @np.errstate(divide="ignore", invalid="ignore")
    def _note(
        self, row: np.ndarray, x: np.ndarray, vanishes: np.ndarray, b: np.ndarray, steps: Steps
    ) -> None:
        """Note the motion at places x (k,), in any order, of the steps numbered `row` (k,), and
        whether D `vanishes` (k,) there. The steps have the Bernstein coefficients b (n, 3, degree +
        1)."""
        order = np.lexsort((x, row))
        row, x, vanishes = row[order], x[order], vanishes[order]
        A, motion = self.A.astype(b.dtype), values_and_slopes(b[row], x[:, None])
        omega, slope = (values[:, :, 0] for values in motion)
        # The sizes of the two forms, and of their derivatives by x.
        sizes, changes = (
            np.abs(rigid_body.separatrix_forms(A, w.T, self.order)) for w in (omega, slope)
        )
        # Near the separatrix the margin is the smaller form, up to a factor of at most sqrt 2.
        change = np.where(sizes[0] < sizes[1], *changes)
        scale = np.hypot(*rigid_body.separatrix_roots(A, self.order))
        relative = change / (scale * np.sqrt(np.square(omega).sum(axis=1)))
        momentum = np.sqrt(np.square(A * omega).sum(axis=1))
        momentum = np.ldexp(momentum.astype(float), steps.units.exponent)
        margin, label = sides_of(self.body, omega)
        times = steps.ends
        start, end = steps.clock.exact_times(times.T).astype(float)
        rate = np.nan_to_num(relative / (end - start)[row]).astype(float)
        within = times[row, 0] + x * (times[row, 1] - times[row, 0])
        time = steps.clock.exact_times(within).astype(float)
        margin = np.where(vanishes, 0, margin).astype(float)
        self.parts.append(SignChanges(time, margin, vanishes, rate, momentum, label))


@np.errstate(all="ignore")
def time_to_zero(
    event: Event,
    model: Equations,
    k: Mapping[str, Any],
    t: Any,
    y: np.ndarray,
    exponent: np.ndarray,
) -> np.ndarray:
    """The distances (n,) in time of motions from a zero of an event's function D, |D / (dD/dt)|, by
    a step of Newton's method from states y (m, n) in units of 2**exponent (n,) at the time t.

    The distance is infinite where D is not 0 and does not change. The precision of D is that of y.
    """
    # In units that fit, because the rates of a motion at 1e-160 are below the smallest double. A
    # model without degrees is taken in the case's own unit of time.
    units = Units.fit(model, k, y.astype(float), exponent) if model.degree else Units()
    scaled = rescaled(model, y.T, exponent - units.exponent).T
    constants = SimpleNamespace(**units.constants(model, k))
    rates = np.array(np.broadcast_arrays(*model.rhs(t, [*scaled.astype(float)], constants)))
    # The derivative by a complex step, for which the rates may be of any size.
    ahead = event.function(t, [*(scaled + 1e-100j * rates)], constants)
    steps = np.abs(ahead.real / (ahead.imag / 1e-100)).astype(float)
    return np.asarray(np.where(ahead.real == 0, 0.0, np.ldexp(steps, -units.rate)))


def middles(row: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middles between neighbouring places x (k,) of one row, in any order, as their rows and
    places."""
    order = np.lexsort((x, row))
    row, x = row[order], x[order]
    pair = np.flatnonzero(row[1:] == row[:-1])
    return row[pair], (x[pair] + x[pair + 1]) / 2


def read_sign_changes(
    signs: SignChanges,
    uncertainty: np.ndarray,
    absorbing: frozenset[int] = frozenset(),
) -> CrossingList:
    """The crossings that moments show, where the margin of a moment is certain if it exceeds its
    `uncertainty` (k,). `absorbing` are the axes that the hodograph never leaves.

    The motion has crossed where its margin is certain first on one side, then on the other. So
    neither a start on the separatrix nor a touch is a crossing, and a zero that is reported twice
    changes nothing. It is undecided whether the motion has crossed where the margin becomes
    uncertain and then is certain on the same side again, or does not become certain any more.
    """
    # A zero is on neither side, so only the moments between zeros show a change of side. Where G
    # vanishes there is no side.
    is_sure = ~signs.vanishes & (np.abs(signs.margin) > uncertainty)
    sure = np.flatnonzero(is_sure & (signs.axis != UNDETERMINED))
    sure, certain = deciding_moments(sure, signs.axis[sure], absorbing)
    axes = signs.axis[sure].tolist()
    verdict = CrossingList([], [], [])
    for n in np.flatnonzero((np.diff(sure) > 1) | (np.diff(axes) != 0)):
        first, last = sure[n], sure[n + 1]
        if axes[n] == axes[n + 1]:
            verdict.undecided.append(_nearest(signs, first + 1, last))
            continue
        moment, spread = _moment_of_crossing(signs, first, last)
        time, momentum = float(signs.time[moment]), float(signs.momentum[moment])
        verdict.crossings.append(Crossing(time, axes[n], axes[n + 1], momentum))
        width = uncertainty[last] / signs.rate[moment] if signs.rate[moment] else math.inf
        verdict.widths.append(float(max(width, spread)))
    if sure.size and sure[-1] < len(signs.time) - 1 and not certain:
        verdict.undecided.append(_nearest(signs, sure[-1] + 1, len(signs.time)))
    return verdict


def deciding_moments(
    sure: np.ndarray, axis: np.ndarray, absorbing: frozenset[int]
) -> tuple[np.ndarray, bool]:
    """The moments that decide where a motion crosses, from its sure moments (k,) and their axes
    (k,); and whether the motion is known to stay on the side of the last moment.

    A motion comes to an absorbing axis once at most: its last moment before that and its first one
    there decide.
    """
    if not absorbing:
        return sure, False
    there = np.isin(axis, [*absorbing])
    first = int(np.argmax(there)) if there.any() else len(sure)
    if (axis[first:] != axis[first : first + 1]).any():
        return sure, False  # its error is larger than stated, and its crossings are listed as seen
    return sure[max(first - 1, 0) : first + 1], first < len(sure)


def _moment_of_crossing(signs: SignChanges, first: int, last: int) -> tuple[int, float]:
    """The moment at which a motion crosses between two sure moments, and half of the time between
    the first and the last zero there.

    It is the middle one of the zeros. Where two steps meet, rounding may leave no zero; then it is
    the second of the sure moments.
    """
    roots = np.arange(first, last)[signs.vanishes[first:last]]
    if not roots.size:
        return last, (signs.time[last] - signs.time[first]) / 2
    return roots[len(roots) // 2], (signs.time[roots[-1]] - signs.time[roots[0]]) / 2


def _nearest(signs: SignChanges, first: int, last: int) -> float:
    """The time of the moment nearest to the separatrix, where the margin is smallest, among the
    moments `first` to `last` - 1."""
    return float(signs.time[first + np.argmin(np.abs(signs.margin[first:last]))])


def has_sides(body: BodyFrame) -> bool:
    """Whether the hodographs of a body may enclose different axes. With two equal moments of
    inertia the separatrix function has one sign only."""
    return not body.no_separatrix_reason and len(set(body.moments.tolist())) == 3


def sides_of(body: BodyFrame, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The margin (n,) of angular velocities (n, 3) along the principal axes, and the label (n,) of
    the axis that the hodograph encloses on this side of the separatrix."""
    A = body.exact_moments
    order = inertia_order(A)
    signed = margin(A, omega, order)
    return signed, np.where(signed > 0, order[0] + 1, order[2] + 1)
