"""Bodies with a rotor, many at once: where the label of their hodographs changes.

The label is a function of 2T and G^2. Curves part the plane of these two, one for each saddle: the
energy of the steady rotation there, whose slope by G^2 is its s. As G^2 grows, s only rises or only
falls, and a saddle that has appeared stays. So each motion has a cell about its place in the plane
in which the label is the same, and only steps that may leave every such cell are searched.
"""

import numpy as np

from ...models.theory.gyrostat import saddles
from .motions import Ensemble

WIDEST, NARROWEST, BACK = 0.25, 2.0, 1 / 8
"""How far G^2 may go from where a cell is made: at most this part of it, and at least so many times
what the step changes of it; and the part of that by which it may go the other way."""

NARROWINGS = 2
"""Of one cell; the last one is the narrowest."""

LEVEL_ROWS = 6
"""What a step puts out of 2T and of G^2."""

OFF_CURVE = 1e-6
"""The part of its terms by which 2T - s G^2 stays away from the curve of a saddle in a cell: far
above the errors of motions."""


class RegionCells:
    """The cells of the columns of a batch, as rows (8, n): the least and the largest G^2, and for
    each saddle the slope s, the least and the largest 2T - s G^2. A column without one has
    numbers that are none."""

    def __init__(self, e: Ensemble, n: int) -> None:
        self.e, self.rows = e, np.full((8, n), np.nan)

    def left(self, levels: np.ndarray, number: np.ndarray, is_under_way: np.ndarray) -> np.ndarray:
        """The columns (k,) of motions `number` (n,) under way (n,) whose label may have changed in
        a step with levels (LEVEL_ROWS, n), see `stays_within`; cells that are left are renewed."""
        columns = np.flatnonzero(~stays_within(self.rows, levels) & is_under_way)
        if columns.size:
            A, h = (x[:, number[columns]].T for x in (self.e.inertia, self.e.rotor))
            self.rows[:, columns] = cells_about(A, h, levels[:, columns])
        return np.asarray(columns[np.isnan(self.rows[0, columns])])


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


@np.errstate(all="ignore")
def cells_about(A: np.ndarray, h: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Cells (8, n) that hold steps with levels (LEVEL_ROWS, n) of bodies A, h (n, 3); no numbers
    where a change of the label within the step is not excluded."""
    n, square = levels.shape[1], levels[3]
    cells, least = np.full((8, n), np.nan), NARROWEST * (np.abs(levels[4]) + levels[5]) / square
    width, open_ = np.full(n, WIDEST), np.arange(n)
    for narrowings in range(NARROWINGS + 1):
        if not open_.size:
            break
        some, room = cells_of_width(A[open_], h[open_], levels[:, open_], width[open_])
        held = stays_within(some, levels[:, open_])
        cells[:, open_[held]] = some[:, held]
        # A curve leaves its tangent with the square of the width.
        factor = np.where(room > 0, np.clip(np.sqrt(room / 2), 1 / 16, 1 / 2), 1 / 4)[~held]
        open_ = open_[~held]
        is_last = narrowings + 1 == NARROWINGS
        width[open_] = np.where(is_last, 0, factor * width[open_]).clip(min=least[open_])
    return cells


def cells_of_width(
    A: np.ndarray, h: np.ndarray, levels: np.ndarray, width: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cells (8, n) in which G^2 goes on by a part `width` (n,) of it, and back by BACK of that;
    with how many times (n,) as far as the nearest curve leaves its tangent 2T is from that, no
    number where saddles appear or vanish."""
    energy, square, loss = levels[0], levels[3], levels[4]
    on, back = (1 + np.copysign(part * width, sign * loss) for part, sign in ((1, 1), (BACK, -1)))
    squares = square * np.array([np.ones_like(on), np.minimum(on, back), np.maximum(on, back)])
    found = saddles(np.tile(A, (3, 1)), np.tile(h, (3, 1)), np.sqrt(squares.ravel()))
    s, G = found.s.reshape(3, -1, 2), found.G.reshape(3, -1, 2, 3)
    exists = ~np.isnan(s)
    # Between two places with the same saddles none appears or vanishes.
    same = (exists == exists[0]) & ((s[..., :1] == s) == (s[0, :, :1] == s[0]))
    slope = np.where(exists[0], s[0], 0)
    # 2T of the saddles less that of the tangent, whose slope by G^2 only rises or only falls.
    curve = (A[:, None] * (s[..., None] * G) ** 2).sum(-1) - slope * squares[..., None]
    terms = energy[:, None] + np.abs(slope) * square[:, None]
    line = energy[:, None] - slope * square[:, None]
    above, below = (exists[0] & side for side in (line > curve[0], line <= curve[0]))
    least = np.where(above, curve.max(0) + OFF_CURVE * terms, -np.inf)
    most = np.where(below, curve.min(0) - OFF_CURVE * terms, np.inf)
    cells = np.empty((8, len(square)))
    cells[:2] = np.where(same.all((0, 2)), squares[1:], np.nan)
    cells[2::3], cells[3::3], cells[4::3] = slope.T, least.T, most.T
    room = np.abs(line - curve[0]) / (np.ptp(curve, axis=0) + OFF_CURVE * terms)
    return cells, np.where(exists[0], room, np.inf).min(-1)
