"""Bodies with a rotor, many at once: where the label of their hodographs changes.

The label is a function of 2T and G^2. Curves part the plane of these two, one for each saddle: the
energy of the steady rotation there, convex for the lower saddle, concave for the upper one. The
lower curve is above each of its tangents and below its chords, the upper one the other way round;
both lines follow from a place on the curve, without an equation to be solved. So each motion has a
cell of the plane, between such lines, in which the label is the same, and only steps that may leave
every such cell are searched.
"""

import numpy as np

from ...models.theory.gyrostat import SaddleCurves
from .motions import Ensemble

CELL_WIDTHS, LARGEST_WIDTH = (0.6, 0.1, 0.0), 0.99
"""The widths of cells, by turns: how far G^2 may go on from where a cell is made, as a part of it.
It may go STEPS_WITHIN times as far as in the step, up to LARGEST_WIDTH."""

STEPS_WITHIN = 2.0
"""How many steps such as the one for which it is made a cell has room for, in G^2."""

BACKWARD_PART = 1 / 8
"""The part of its width by which a cell has room the other way."""

NEWTON_STEPS = 3
"""Steps towards the point on a curve with a given G^2: what they leave makes a cell smaller
only."""

LEVEL_ROWS = 6
"""What a step puts out of 2T and of G^2."""

OFF_CURVE = 1e-6
"""The part of its terms by which 2T - s G^2 keeps away from the curve of a saddle in a cell, and
G^2 from where a saddle appears: far above the errors of motions."""


class RegionCells:
    """The cells of the columns of a batch (3, 3, n): the factor of G^2, the least and the largest
    value of G^2, and the same of 2T - s G^2 for either saddle. A column without one has numbers
    that are none."""

    def __init__(self, e: Ensemble, n: int) -> None:
        self.e, self.bounds = e, np.full((3, 3, n), np.nan)

    def left(self, levels: np.ndarray, motion: np.ndarray, is_under_way: np.ndarray) -> np.ndarray:
        """The columns (k,), of motions (n,) of the ensemble that are under way (n,), whose label
        may have changed in a step with levels (LEVEL_ROWS, n), see `stays_within`; cells that the
        step leaves are made anew."""
        columns = np.flatnonzero(~stays_within(self.bounds, levels) & is_under_way)
        for width in CELL_WIDTHS:
            if not columns.size:
                break
            curves = self.e.saddle_curves.of_bodies(motion[columns])
            cells = cells_about(curves, levels[:, columns], width)
            is_within = stays_within(cells, levels[:, columns])
            self.bounds[..., columns] = np.where(is_within, cells, np.nan)
            columns = columns[~is_within]
        return columns


def stays_within(cells: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Whether (n,) steps stay within cells (3, 3, n): by 2T, how much it changes at its slope, and
    at most besides, and the same of G^2 (LEVEL_ROWS, n)."""
    factor, lower, upper = cells
    energy, square = levels.reshape(2, 3, -1)
    # Both mostly fall together, and their difference changes much less.
    value, change, bound = factor * square[0], factor * square[1], np.abs(factor) * square[2]
    for of_square, of_energy in zip((value, change, bound), energy, strict=True):
        of_square[1:] += of_energy
    middle, reach = value + change / 2, np.abs(change) / 2 + bound
    return np.asarray(((middle - reach > lower) & (middle + reach < upper)).all(0))


def points_near(curves: SaddleCurves, squares: np.ndarray) -> np.ndarray:
    """s, 2T and G^2 (3, p, 2, n) at points on the curves of saddles where G^2 is a little larger
    than `squares` (p, n), or where the curves begin."""
    curves = curves.chosen(np.tile(np.arange(len(curves.limit)), len(squares)))
    square = np.repeat(squares, 2, axis=0).ravel()
    momentum = np.sqrt(square)
    u = curves.nearest(momentum)
    for _ in range(NEWTON_STEPS):
        u = np.fmin(np.maximum(curves.ahead(u, momentum), u), curves.limit)
    # At the pole itself a saddle leaves G^2 open.
    square = np.maximum(curves.square(u), square)
    rows = np.array([curves.s(u), curves.tangent(u, square), square])
    return rows.reshape(3, len(squares), 2, -1)


@np.errstate(all="ignore")
def cells_about(curves: SaddleCurves, levels: np.ndarray, width: float) -> np.ndarray:
    """Cells (3, 3, n) about the beginning of steps with levels (LEVEL_ROWS, n), in which G^2 may go
    on by a part `width` of it. Not all hold the step, or its beginning."""
    (energy, _, _), (square, change, bound) = levels.reshape(2, 3, -1)
    part = np.clip(STEPS_WITHIN * (np.abs(change) + bound) / square, width, LARGEST_WIDTH)
    ahead = np.copysign(part * square, change)
    s, T, G = points_near(curves, np.stack([square + ahead, square - BACKWARD_PART * ahead]))
    distance = OFF_CURVE * (energy + np.abs(s[0]) * square)
    begins, side = (x.reshape(2, -1) for x in (curves.least_squares(), curves.side))
    exists, tangent = square > begins, T[0] + s[0] * (square - G[0])
    # Beyond a tangent of its curve a saddle decides alone: the other one is farther off.
    decides = exists & (side * (energy - tangent) < -distance)
    bounds = exists & ~decides[::-1]
    slope = np.where(bounds, np.where(decides, s[0], (T[1] - T[0]) / (G[1] - G[0])), 0)
    line, is_below = T[0] - slope * G[0], decides == (side > 0)
    lowest = np.maximum(np.where(decides, 0, G.min(0)), (1 + OFF_CURVE) * begins)
    highest = np.where(exists, G.max(0), (1 - OFF_CURVE) * begins)
    lower = np.where(bounds & ~is_below, line + distance, -np.inf)
    upper = np.where(bounds & is_below, line - distance, np.inf)
    return np.array([
        [np.ones_like(square), *-slope],
        [np.where(bounds, lowest, -np.inf).max(0), *lower],
        [np.where(decides.any(0), np.inf, highest).min(0), *upper],
    ])  # fmt: skip
