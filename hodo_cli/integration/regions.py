"""Where a motion stands among the regions that separatrices part: every change of its label along
its steps, for a body with a rotor.

Its separatrices are the hodographs through saddles whose place depends on |G|: no polynomial of the
state. Each step is looked at in places so near to each other that the distance from a saddle's
hodograph has one extremum between two of them at most; there its slope shows it.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..engines import extended
from ..engines.polynomial import weights
from ..models.rigid_body import UNSEPARATED, BodyFrame, inertia_order, margin
from ..models.theory.gyrostat import region_labels, region_margins, separations
from .crossings import CrossingSearch, SignChanges

PLACES = 17
"""Places in a step, its ends among them. A step is a part of a turn, in which the distance has few
extrema."""

HALVINGS = 64
"""Halvings of an interval in search of a change: beyond the digits of a long double."""


def standing(system: BodyFrame, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The margin (n,) of angular velocities (n, 3) along the principal axes, and the label (n,) of
    the side on which they stand."""
    A, h = system.moments, system.rotor_momentum
    if h is not None:
        labels = region_labels(A, h, omega)
        return nearest_margin(region_margins(A, h, omega)), labels
    order = inertia_order(A)
    signed = margin(A, omega, order)
    return signed, np.where(signed > 0, order[0] + 1, order[2] + 1)


def nearest_margin(margins: np.ndarray) -> np.ndarray:
    """The size (n,) of the smaller margin (n, 2); infinite without a saddle."""
    sizes = np.abs(margins).astype(float)
    return np.asarray(np.where(np.isnan(sizes), np.inf, sizes).min(-1))


class View(NamedTuple):
    """Places of steps, each (k,): label, margin, |G|, and the rate by x at which the nearest
    boundary comes nearer, relative to |omega|; the value and the slope by x for both saddles
    (k, 2)."""

    label: np.ndarray
    margin: np.ndarray
    momentum: np.ndarray
    rate: np.ndarray
    value: np.ndarray
    slope: np.ndarray


@dataclass
class RegionSearch(CrossingSearch):
    """The `StepObserver` that searches the steps of a body with a rotor for changes of its label.

    It notes no moment of a step in which every margin stays above `uncertainty` all along.
    """

    h: np.ndarray = None  # type: ignore[assignment]

    def flush(self) -> None:
        """Search the steps noted, in double precision or in long double."""
        n, self.filled = self.filled, 0
        if not n:
            return
        series, times = extended(self.series[:n]), extended(self.times[:n])
        b, _ = self._bernstein(self.along_axes(series), times)
        row, x = np.repeat(np.arange(n), PLACES), np.tile(np.linspace(0, 1, PLACES), n)
        # In double for all: long double is ten times slower.
        view = self._view(b.astype(float), row, x)
        clear = (view.margin > self.uncertainty).reshape(n, PLACES).all(1)
        labels = view.label.reshape(n, PLACES)
        clear &= (labels == labels[:, :1]).all(1) & ~self._turns(view, n).any((1, 2))
        if not clear.all():
            self._search_steps(b[~clear], times[~clear])

    def _turns(self, view: View, n: int) -> np.ndarray:
        """Whether (n, PLACES - 1, 2) the value of a saddle comes nearer to 0 after one place, and
        goes away from it before the next, without a change of sign."""
        value = view.value.reshape(n, PLACES, 2)
        nearing = value * view.slope.reshape(n, PLACES, 2)
        same_side = value[:, :-1] * value[:, 1:] > 0
        return np.asarray((nearing[:, :-1] < 0) & (nearing[:, 1:] > 0) & same_side)

    def _search_steps(self, b: np.ndarray, times: np.ndarray) -> None:
        """Note the places of steps, the extrema between them, and where the label changes."""
        n, fp = len(b), b.dtype
        row, x = np.repeat(np.arange(n), PLACES), np.tile(np.linspace(0, 1, PLACES, dtype=fp), n)
        turns = np.argwhere(self._turns(self._view(b, row, x), n))
        low, saddle = turns[:, 1] / fp.type(PLACES - 1), turns[:, 2]

        def sign(row: np.ndarray, x: np.ndarray) -> np.ndarray:
            view, at = self._view(b, row, x), np.arange(len(row))
            return np.asarray(view.value[at, saddle] * view.slope[at, saddle] < 0)

        extrema = bisected(sign, turns[:, 0], low, low + 1 / fp.type(PLACES - 1))
        row, x = np.concatenate((row, turns[:, 0])), np.concatenate((x, extrema))
        order = np.lexsort((x, row))
        row, x = row[order], x[order]
        label = self._view(b, row, x).label
        change = np.flatnonzero((label[1:] != label[:-1]) & (row[1:] == row[:-1]))

        def unchanged(rows: np.ndarray, x: np.ndarray) -> np.ndarray:
            return np.asarray(self._view(b, rows, x).label == label[change])

        places = bisected(unchanged, row[change], x[change], x[change + 1])
        vanishes = np.repeat((False, True), (len(x), len(places)))
        row, x = np.concatenate((row, row[change])), np.concatenate((x, places))
        order = np.lexsort((x, row))
        self._note_places(b, row[order], x[order], vanishes[order], times)

    def _view(self, b: np.ndarray, row: np.ndarray, x: np.ndarray) -> View:
        """The motion at places x (k,) in steps with Bernstein coefficients b (n, 3, degree + 1)."""
        degree = b.shape[2] - 1
        w = np.matmul(b[row], weights(x, degree)[:, :, None])[:, :, 0]
        change = degree * np.matmul(np.diff(b[row], axis=2), weights(x, degree - 1)[:, :, None])
        # A rotor has a momentum of its own, so that nothing is homogeneous in omega.
        w, change = np.ldexp(w, self.size), np.ldexp(change[:, :, 0], self.size)
        A, h = self.A.astype(b.dtype), self.h.astype(b.dtype)
        label, margins = region_labels(A, h, w), region_margins(A, h, w)
        apart = separations(A, h, w)
        slope = (apart.gradient * change[:, None]).sum(-1)
        G = A * w + h
        square = (G * G).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.linalg.norm(apart.gradient, axis=-1) * np.linalg.norm(w, axis=-1)[:, None]
            sizes = np.where(np.isnan(margins), np.inf, np.abs(margins))
            nearest = np.take_along_axis(np.abs(slope) / size, sizes.argmin(-1)[:, None], 1)[:, 0]
            falling = np.abs((G * A * change).sum(-1)) / square
        rate = np.where(label == UNSEPARATED, falling, nearest)
        momentum = np.sqrt(square)
        return View(label, nearest_margin(margins), momentum, rate, apart.value, slope)

    def _note_places(
        self, b: np.ndarray, row: np.ndarray, x: np.ndarray, vanishes: np.ndarray, times: np.ndarray
    ) -> None:
        view = self._view(b, row, x)
        start, end = self.clock.true_times(times[:, 0]), self.clock.true_times(times[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = np.nan_to_num(view.rate / (end - start)[row]).astype(float)
        time = self.clock.true_times(times[row, 0] + x * (times[row, 1] - times[row, 0]))
        margins = np.where(vanishes, 0, view.margin)
        momentum = view.momentum.astype(float)
        self.parts.append(SignChanges(time, margins, vanishes, rate, momentum, view.label))


def bisected(holds: Any, row: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Where (k,) between two places of rows a property of (row, x) ends that holds at the first."""
    for _ in range(HALVINGS if len(row) else 0):
        middle = (low + high) / 2
        still = holds(row, middle)
        low, high = np.where(still, middle, low), np.where(still, high, middle)
    return high
