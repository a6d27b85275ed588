"""Bodies with a rotor, many at once: where the label of their hodographs changes.

The label is a function of 2T and G^2. Curves part the plane of these two, one for each saddle: the
energy of the steady rotation there, convex for the lower saddle, concave for the upper one. The
lower curve is above each of its tangents and below its chords, the upper one the other way round;
both lines follow from a place on the curve, without an equation to be solved. So each motion has a
cell of the plane, between such lines, in which the label is the same, and only steps that may leave
every such cell are searched.
"""

from typing import NamedTuple

import numpy as np

from ...models.theory.gyrostat import SaddleCurves
from .motions import Ensemble

WIDTHS = 0.6, 0.1, 0.0
"""How far G^2 may go from where a cell is made, as a part of it; tried by turns."""

NARROWEST, BACK = 2.0, 1 / 8
"""How many times what the step changes of G^2 it may go at least, and the part of the width by
which it may go the other way."""

APPROACHES = 5
"""Of the place on a curve where G^2 is so and so: what is left of it makes a cell smaller only."""

LEVEL_ROWS = 6
"""What a step puts out of 2T and of G^2."""

OFF_CURVE = 1e-6
"""The part of its terms by which 2T - s G^2 stays away from the curve of a saddle in a cell, and
G^2 from where a saddle appears: far above the errors of motions."""


class RegionCells:
    """The cells of the columns of a batch, as rows (8, n): the least and the largest G^2, and for
    each saddle a slope s, the least and the largest 2T - s G^2. A column without one has
    numbers that are none."""

    def __init__(self, e: Ensemble, n: int) -> None:
        self.e, self.rows = e, np.full((8, n), np.nan)

    def left(self, levels: np.ndarray, number: np.ndarray, is_under_way: np.ndarray) -> np.ndarray:
        """The columns (k,) of motions `number` (n,) under way (n,) whose label may have changed in
        a step with levels (LEVEL_ROWS, n), see `stays_within`; cells that are left are renewed."""
        columns = np.flatnonzero(~stays_within(self.rows, levels) & is_under_way)
        open_ = columns
        for width in WIDTHS:
            if not open_.size:
                break
            curves = self.e.saddle_curves.of_bodies(number[open_])
            some = cells_about(curves, levels[:, open_], width)
            held = stays_within(some, levels[:, open_])
            self.rows[:, open_] = np.where(held, some, np.nan)
            open_ = open_[~held]
        return open_


def stays_within(cells: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Whether (n,) steps stay within cells (8, n): by 2T, how much it changes at its slope, and at
    most besides, and the same of G^2 (LEVEL_ROWS, n)."""
    (energy, square), (fall, loss), (rest, more) = levels.reshape(2, 3, -1).swapaxes(0, 1)
    slope = cells[2::3]
    # Both mostly fall together, and their difference changes much less.
    line, turn, besides = energy - slope * square, fall - slope * loss, rest + np.abs(slope) * more
    between = is_between(line, turn, besides, cells[3::3], cells[4::3])
    return np.asarray(is_between(square, loss, more, cells[0], cells[1]) & between.all(0))


def is_between(
    value: np.ndarray, change: np.ndarray, rest: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Whether (...) values stay between limits, which change by `change`, and by `rest` besides."""
    lowest, highest = np.minimum(change, 0) - rest, np.maximum(change, 0) + rest
    return np.asarray((value + lowest > low) & (value + highest < high))


class CurvePlaces(NamedTuple):
    """Places on the curves of saddles: the slope s, 2T and G^2 (2, n)."""

    s: np.ndarray
    energy: np.ndarray
    square: np.ndarray

    @classmethod
    def near(cls, curves: SaddleCurves, square: np.ndarray) -> "CurvePlaces":
        """Those where G^2 is a little larger than `square` (n,), or the beginnings of the
        curves."""
        square = np.concatenate([square, square])
        u = curves.nearest(np.sqrt(square))
        for _ in range(APPROACHES):
            u = np.fmin(np.maximum(curves.ahead(u, np.sqrt(square)), u), curves.limit)
        # At the pole itself a saddle leaves G^2 open.
        square = np.maximum(curves.square(u), square)
        rows = curves.s(u), curves.tangent(u, square), square
        return cls(*(row.reshape(2, -1) for row in rows))


@np.errstate(all="ignore")
def cells_about(curves: SaddleCurves, levels: np.ndarray, width: float) -> np.ndarray:
    """Cells (8, n) about the beginning of steps with levels (LEVEL_ROWS, n), in which G^2 may go on
    by a part `width` of it. Not all hold the step, or its beginning."""
    energy, square, loss = levels[0], levels[3], levels[4]
    part = np.maximum(width, NARROWEST * (np.abs(loss) + levels[5]) / square)
    on, back = (
        CurvePlaces.near(curves, square * (1 + np.copysign(share * part, sign * loss)))
        for share, sign in ((1, 1), (BACK, -1))
    )
    margin = OFF_CURVE * (energy + np.abs(on.s) * square)
    appears = curves.least_squares().reshape(on.s.shape)
    side, exists = curves.side.reshape(on.s.shape), square > appears
    # Beyond a tangent of its curve a saddle decides alone: the other one is farther off.
    tangent = on.energy + on.s * (square - on.square)
    decides = exists & (side * (energy - tangent) < -margin)
    bounds = exists & ~decides[::-1]
    chord = (back.energy - on.energy) / (back.square - on.square)
    slope = np.where(bounds, np.where(decides, on.s, chord), 0)
    line = on.energy - slope * on.square
    is_below = decides == (side > 0)
    least, most = np.minimum(on.square, back.square), np.maximum(on.square, back.square)
    least = np.maximum(np.where(decides, 0, least), (1 + OFF_CURVE) * appears)
    most = np.where(exists, most, (1 - OFF_CURVE) * appears)
    cells = np.empty((8, len(square)))
    cells[0] = np.where(bounds, least, 0).max(0)
    cells[1] = np.where(decides.any(0), np.inf, most).min(0)
    cells[2::3] = slope
    cells[3::3] = np.where(bounds & ~is_below, line + margin, -np.inf)
    cells[4::3] = np.where(bounds & is_below, line - margin, np.inf)
    return cells
