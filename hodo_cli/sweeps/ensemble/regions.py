"""Bodies with a rotor: where the label of their hodographs changes in the steps of an ensemble.

The label is a function of 2T and G^2. Curves part the plane of these two, one for each saddle: the
energy of the steady rotation there, convex for the lower saddle, concave for the upper one. The
lower curve is above each of its tangents and below its chords, the upper one the other way round;
both lines follow from a place on the curve, without an equation to be solved. So each motion has a
cell of the plane, between such lines, in which the label is the same, and only steps that may leave
every such cell are searched.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...integration import PLACES_VIEWED, has_turned
from ...models.base import rescaled, stacked
from ...models.theory.gyrostat import HodographRegion, SaddleCurves, region_of
from .motions import Ensemble, Passages, TakenSteps

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


def left_cells(
    e: Ensemble,
    cells: np.ndarray,
    levels: np.ndarray,
    motion: np.ndarray,
    is_under_way: np.ndarray,
) -> np.ndarray:
    """The columns (k,), of motions (n,) of the ensemble that are under way (n,), whose label may
    have changed in a step with levels (LEVEL_ROWS, n), see `stays_within`.

    The `cells` (3, 3, n), which are made anew where the step leaves them, are the factor of G^2,
    the least and the largest value of G^2, and the same of 2T - s G^2 for either saddle; not
    numbers in a column without a cell.
    """
    columns = np.flatnonzero(~stays_within(cells, levels) & is_under_way)
    for width in CELL_WIDTHS:
        if not columns.size:
            break
        curves = e.saddle_curves.of_bodies(motion[columns])
        new = cells_about(curves, levels[:, columns], width)
        is_within = stays_within(new, levels[:, columns])
        cells[..., columns] = np.where(is_within, new, np.nan)
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


ROUNDS = 60
"""Of the search for one change: more than a double has digits."""

FINEST_PART, COARSEST_PART = 4 * 2.0**-52, 4 * 2.0**-42
"""The part of a step to within which a change is found, and the same where rounding hides more: it
is allowed four times as much with every look."""

STEPS_PER_BLOCK = 256
"""Steps that are searched at once: the numbers of their PLACES_VIEWED fit a processor's cache."""


class MotionView(NamedTuple):
    """Motions (k,) at moments in steps: their positions in the ensemble, times, and how long the
    steps are, states (m, k) in units of 2**exponent, and in true size the angular velocities
    (k, 3), how fast they change, and the regions in which they stand."""

    motion: np.ndarray
    time: np.ndarray
    length: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    omega: np.ndarray
    change: np.ndarray
    region: HodographRegion

    @property
    def slope(self) -> np.ndarray:
        """The derivatives (k, 2) of `region.value` by the part of the step."""
        slope = (self.region.gradient * self.change[:, None]).sum(-1)
        return np.asarray(slope * self.length[:, None])


Viewing = Callable[[np.ndarray, np.ndarray], MotionView]
"""`view_within` an ensemble's steps, by their rows (k,) and the parts x (k,) of them."""


def true_omega(e: Ensemble, motion: np.ndarray, state: np.ndarray, exponent: Any) -> np.ndarray:
    """The angular velocities (k, 3) of some motions (k,) along the principal axes, from states (m,
    k) in units of 2**exponent."""
    return np.asarray(np.ldexp(e.principal_omega(state, motion), exponent).T)


def region_at(
    e: Ensemble, motion: np.ndarray, omega: np.ndarray, uncertainty: float = 0.0
) -> HodographRegion:
    """The regions of some motions (k,) with angular velocities (k, 3) along the principal axes."""
    with np.errstate(all="ignore"):
        return region_of(e.inertia[:, motion].T, e.rotor[:, motion].T, omega, uncertainty)


def label_at(e: Ensemble, state: np.ndarray, exponent: Any) -> np.ndarray:
    """The labels (n,) of all motions in states (m, n) in units of 2**exponent: SEPARATRIX where
    they are uncertain."""
    motion = np.arange(state.shape[1])
    return region_at(e, motion, true_omega(e, motion, state, exponent), e.error_bound).label


def view(
    e: Ensemble,
    motion: np.ndarray,
    time: np.ndarray,
    state: np.ndarray,
    k: Any,
    exponent: Any = 0,
    rate: Any = 0,
    length: Any = 1.0,
) -> MotionView:
    """Motions in states (m, k), and with constants of their equations, in units of 2**exponent and
    of time of 2**-rate, in steps of a length in that unit."""
    rates = stacked(e.model.rhs(time, [*state], k), state)
    omega = true_omega(e, motion, state, exponent)
    change = true_omega(e, motion, rates, exponent + rate)
    region = region_at(e, motion, omega)
    return MotionView(motion, time, np.ldexp(length, -rate), state, exponent, omega, change, region)


def view_within(e: Ensemble, steps: TakenSteps, row: np.ndarray, x: np.ndarray) -> MotionView:
    """Motions at parts x (k,), from 0 to 1, of the steps in `row` (k,)."""
    steps = steps.chosen(row)
    _, _, motion, exponent, rate = steps.start
    state, k = steps.states_at(e.step, x), steps.start.named(e.structure)
    return view(e, motion, steps.times_at(x), state, k, exponent, rate, steps.length)


def changes_within(e: Ensemble, steps: TakenSteps) -> tuple[Passages, np.ndarray]:
    """The changes of the label in steps that may have some, and the motions of which they are
    undecided."""
    view_at, count = partial(view_within, e, steps), len(steps.length)
    blocks = (
        np.arange(i, min(i + STEPS_PER_BLOCK, count)) for i in range(0, count, STEPS_PER_BLOCK)
    )
    viewed = [changes_seen(view_at, row, e.error_bound) for row in blocks]
    row, low, unclear = (np.concatenate(arrays) for arrays in zip(*viewed, strict=True))
    uncertain = steps.start.motion[unclear]
    if not row.size:
        return Passages.none(len(steps.start.state)), uncertain
    before, after, x, width = change_between(e, view_at, row, low, low + 1 / (PLACES_VIEWED - 1))
    at, taken = view_at(row, x), steps.start.clock[-1, row] + 2
    gradient = passing_gradient(e, at)
    # The error of a state is a part of omega, in whatever direction.
    off = np.linalg.norm(gradient, axis=-1) * np.linalg.norm(at.omega, axis=-1)
    with np.errstate(all="ignore"):
        uncertainty = e.error_bound * off / np.abs((gradient * at.change).sum(-1))
    errors = e.errors_of_times(uncertainty, at.time, taken) + width * at.length
    found = Passages(at.motion, at.time, errors, uncertainty, before, after, at.state, at.exponent)
    return found.chosen(np.lexsort((at.time, at.motion))), uncertain


def changes_seen(
    view_at: Viewing, row: np.ndarray, uncertainty: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The step (k,) of each change of the label between two neighbours of PLACES_VIEWED parts of
    the steps `row` (n,), and the first of the two; and the steps in which there may be others."""
    x = np.linspace(0, 1, PLACES_VIEWED)
    motions = view_at(np.repeat(row, PLACES_VIEWED), np.tile(x, len(row)))
    region = motions.region
    label, nearest, value, slope = (
        values.reshape(len(row), PLACES_VIEWED, *values.shape[1:])
        for values in (region.label, region.nearest, region.value, motions.slope)
    )
    unclear = (
        has_turned(value, slope).any((1, 2)) | (nearest <= uncertainty).any(1) | (label <= 0).any(1)
    )
    step, first = np.nonzero(label[:, 1:] != label[:, :-1])
    return row[step], x[first], row[unclear]


def change_between(
    e: Ensemble, view_at: Viewing, row: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The labels (k,) before and behind a change in intervals of the steps in `row` (k,), its
    position x, and how far off this may be.

    Each interval is a bracket, whose ends have either label. Newton's method for what passes 0
    there proposes where to look next, else the middle; the label found there moves one end. A
    bracket is done when it is as narrow as the noise of the method, which grows by turns.
    """
    first, last = view_at(row, low), view_at(row, high)
    begin, end = (differences(e, at)[0] for at in (first, last))
    passing = (begin * end < 0).argmax(1)
    x, low, high = (low + high) / 2, low.copy(), high.copy()
    probe, wide = x.copy(), np.arange(len(row))  # where to look next, and which are not done
    for turn in range(ROUNDS):
        if not wide.size:
            break
        at = view_at(row[wide], probe[wide])
        is_before = at.region.label == first.region.label[wide]
        low[wide] = np.where(is_before, probe[wide], low[wide])
        high[wide] = np.where(is_before, high[wide], probe[wide])
        root = probe[wide] - newton_step(e, at, passing[wide])
        noise = min(FINEST_PART * 4**turn, COARSEST_PART)
        x[wide], probe[wide] = next_places(root, low[wide], high[wide], is_before, noise)
        wide = wide[high[wide] - low[wide] > 4 * noise]
    return first.region.label, last.region.label, x, high - low


def next_places(
    root: np.ndarray, low: np.ndarray, high: np.ndarray, is_before: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where changes are (k,), as far as brackets of them and roots by Newton's method from one end
    tell, and where to look next: in the middle where the root is no help."""
    middle, is_near = (low + high) / 2, (root > low - 8 * noise) & (root < high + 8 * noise)
    # A little beyond, so that the other end of the bracket comes near as well.
    beyond = (root + np.where(is_before, noise, -noise)).clip(low + noise, high - noise)
    return np.where(is_near, root.clip(low, high), middle), np.where(is_near, beyond, middle)


def newton_step(e: Ensemble, at: MotionView, passing: np.ndarray) -> np.ndarray:
    """How far (k,), in parts of a step, motions are behind the zero of one of `differences`, which
    is `passing` (k,), by its slope."""
    value, gradient = (of[np.arange(len(passing)), passing] for of in differences(e, at))
    return np.asarray(value / ((gradient * at.change).sum(-1) * at.length))


def differences(e: Ensemble, at: MotionView) -> tuple[np.ndarray, np.ndarray]:
    """What passes 0 where a label changes (k, 4), and its derivatives by omega (k, 4, 3): 2T less
    that of either saddle, and |G|^2 less that at which it appears."""
    A, h = e.inertia[:, at.motion].T, e.rotor[:, at.motion].T
    G = A * at.omega + h
    least = e.saddle_curves.of_bodies(at.motion).least_squares().reshape(2, -1).T
    value = np.column_stack([at.region.value, (G * G).sum(-1)[:, None] - least])
    return value, np.concatenate([at.region.gradient, np.stack([2 * A * G] * 2, 1)], axis=1)


def passing_gradient(e: Ensemble, at: MotionView) -> np.ndarray:
    """The derivatives (k, 3) by omega of that of the `differences` which is 0 there."""
    value, gradient = differences(e, at)
    with np.errstate(all="ignore"):
        distance = np.abs(value) / np.linalg.norm(gradient, axis=-1)
    nearest = np.where(np.isnan(distance), np.inf, distance).argmin(1)
    return np.asarray(gradient[np.arange(len(value)), nearest])


def time_between(
    e: Ensemble, passed: Passages, state: np.ndarray, exponent: np.ndarray
) -> np.ndarray:
    """How far in time (k,) passages are from those of another integration, by its states (m, k), in
    units of 2**exponent, at the times of the passages."""
    y = rescaled(e.model, passed.state.T, passed.exponent).T
    at = view(e, passed.motion, passed.time, y, e.named(passed.motion))
    gradient, off = passing_gradient(e, at), true_omega(e, at.motion, state, exponent) - at.omega
    with np.errstate(all="ignore"):
        return np.asarray(np.abs((gradient * off).sum(-1) / (gradient * at.change).sum(-1)))
