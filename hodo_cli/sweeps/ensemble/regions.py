"""Bodies with a rotor: where the label of their hodographs changes in the steps of an ensemble."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...integration import VIEWED, has_turned
from ...models.constants import namespace, rescaled
from ...models.rigid_body import UNSEPARATED
from ...models.theory.gyrostat import HodographRegion, region_of
from .batch import (
    END,
    NUMBER,
    STRIDE,
    CandidateSteps,
    call_padded,
    shortened,
    split_params,
    states_after,
    time_reached,
)
from .motions import Ensemble, Passages

if TYPE_CHECKING:
    from ...engines.taylor_batch import TaylorStep

ROUNDS = 60
"""Of the search for one change: more than a double has digits."""

PLACED = 4 * 2.0**-52
"""The part of a step to which the place of a change is found."""

BLOCK = 2048
"""Steps that are searched at once."""


class MotionView(NamedTuple):
    """Motions at places (k,) in steps: their numbers, times, and how long the steps are, states (m,
    k) in units of 2**size, the regions in which they stand, in true size, and how fast they change
    there (k, 3)."""

    motion: np.ndarray
    time: np.ndarray
    length: np.ndarray
    state: np.ndarray
    size: np.ndarray
    region: HodographRegion
    change: np.ndarray

    @property
    def slope(self) -> np.ndarray:
        """The derivatives (k, 2) of `region.value` by the part of the step."""
        slope = (self.region.gradient * self.change[:, None]).sum(-1)
        return np.asarray(slope * self.length[:, None])


Viewing = Callable[[np.ndarray, np.ndarray], MotionView]
"""`view` of an ensemble's steps, by step and place."""


def true_omega(e: Ensemble, motion: np.ndarray, state: np.ndarray, size: Any) -> np.ndarray:
    """The angular velocities (k, 3) of some motions (k,) along the principal axes, from states (m,
    k) in units of 2**size."""
    return np.asarray(np.ldexp(e.principal_omega(state, motion), size).T)


def region_at(
    e: Ensemble, motion: np.ndarray, state: np.ndarray, size: Any, band: float = 0.0
) -> HodographRegion:
    """The regions of some motions (k,) in states (m, k) in units of 2**size."""
    omega = true_omega(e, motion, state, size)
    A, h = e.inertia[:, motion].T, e.rotor[:, motion].T
    with np.errstate(all="ignore"):
        return region_of(A, h, omega, np.full(len(motion), band))


def label_at(e: Ensemble, state: np.ndarray, size: Any) -> np.ndarray:
    """The labels (n,) of all motions in states (m, n) in units of 2**size: SEPARATRIX where they
    are uncertain."""
    motion = np.arange(state.shape[1])
    return np.asarray(region_at(e, motion, state, size, e.error_bound).label)


def changes_of(e: Ensemble, motion: np.ndarray, t: Any, state: np.ndarray, k: Any) -> np.ndarray:
    """The rates (3, k) of omega along the principal axes, of motions in states (m, k) at times."""
    rates = np.array(np.broadcast_arrays(*e.model.rhs(t, [*state], k), state[0])[:3])
    return e.principal_omega(rates, motion)


def view(
    e: Ensemble, step: "TaylorStep", steps: CandidateSteps, row: np.ndarray, x: np.ndarray
) -> MotionView:
    """Motions at places x (k,), from 0 to 1, of the steps in `row` (k,)."""
    m, before, params = len(e.start), steps.before[:, row], steps.params[:, row]
    motion, size, rate = split_params(params)
    k = namespace(e.structure, list(params[1:STRIDE]))
    begin, rest = time_reached(params[END], before[m], before[m + 1], rate)
    place = x * steps.length[row]
    time, length = begin + (rest + np.ldexp(place, -rate)), np.ldexp(steps.length[row], -rate)
    shorter = shortened(before, params[:NUMBER].copy(), place, rate)
    state = call_padded(partial(states_after, step), *shorter)
    change = np.ldexp(changes_of(e, motion, time, state, k), size + rate)
    region = region_at(e, motion, state, size)
    return MotionView(motion, time, length, state, size, region, change.T)


def changes_within(
    e: Ensemble, steps: CandidateSteps, step: "TaylorStep"
) -> tuple[Passages | None, np.ndarray]:
    """The changes of the label in steps that may have some, and the motions of which they are
    undecided."""
    look, count = partial(view, e, step, steps), len(steps.length)
    blocks = (np.arange(i, min(i + BLOCK, count)) for i in range(0, count, BLOCK))
    seen = [changes_seen(look, row, e.error_bound) for row in blocks]
    row, low, unclear = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    uncertain = steps.params[NUMBER, unclear].astype(np.int64)
    if not row.size:
        return None, uncertain
    before, after, x = change_between(look, row, low, low + 1 / (VIEWED - 1))
    at, taken = look(row, x), steps.before[len(e.start) + 2, row] + 2
    omega = true_omega(e, at.motion, at.state, at.size)
    gradient = gradient_at(e, at.motion, omega, at.region, before, after)
    # The error of a state is a part of omega, in whatever direction.
    off = np.linalg.norm(gradient, axis=-1) * np.linalg.norm(omega, axis=-1)
    with np.errstate(all="ignore"):
        uncertainty = e.error_bound * off / np.abs((gradient * at.change).sum(-1))
    errors = e.errors_of_times(uncertainty, at.time, taken) + PLACED * at.length
    found = Passages(at.motion, at.time, errors, uncertainty, before, after, at.state, at.size)
    return found.chosen(np.lexsort((at.time, at.motion))), uncertain


def changes_seen(
    look: Viewing, row: np.ndarray, band: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The step (k,) of each change of the label between neighbouring places in the steps `row`
    (n,), and the first of the two places; and those of the steps in which there may be others."""
    places = np.linspace(0, 1, VIEWED)
    seen = look(np.repeat(row, VIEWED), np.tile(places, len(row)))
    label, near, value, slope = (
        values.reshape(len(row), VIEWED, *values.shape[1:])
        for values in (seen.region.label, seen.region.nearest, seen.region.value, seen.slope)
    )
    unclear = has_turned(value, slope).any((1, 2)) | (near <= band).any(1) | (label <= 0).any(1)
    change, place = np.nonzero(label[:, 1:] != label[:, :-1])
    return row[change], places[place], row[unclear]


def change_between(
    look: Viewing, row: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The labels (k,) before and behind a change in intervals of the steps in `row` (k,), and its
    place: by Newton's method where 2T passes a curve, kept between places of either label, else by
    halving."""
    first, last = look(row, low), look(row, high)
    before, after = first.region.label, last.region.label
    passes = first.region.value * last.region.value < 0
    saddle, by_newton = passes.argmax(1), passes.any(1)
    x, open_ = (low + high) / 2, np.arange(len(row))
    low, high = low.copy(), high.copy()
    for _ in range(ROUNDS):
        if not open_.size:
            break
        at = look(row[open_], x[open_])
        same = at.region.label == before[open_]
        low[open_], high[open_] = (
            np.where(same, x[open_], low[open_]), np.where(same, high[open_], x[open_])
        )  # fmt: skip
        pick = np.arange(len(open_)), saddle[open_]
        ahead = x[open_] - at.region.value[pick] / at.slope[pick]
        middle = (low[open_] + high[open_]) / 2
        newton = by_newton[open_] & (ahead >= low[open_]) & (ahead <= high[open_])
        following = np.where(newton, ahead, middle)
        moving = np.abs(following - x[open_]) > PLACED
        x[open_] = following
        open_ = open_[moving]
    return before, after, x


def gradient_at(
    e: Ensemble,
    motion: np.ndarray,
    omega: np.ndarray,
    region: HodographRegion,
    before: np.ndarray,
    after: np.ndarray,
) -> np.ndarray:
    """The derivatives (k, 3) by omega (k, 3) of what is 0 where a label changes: of the distance
    from the nearest saddle's curve, or of |G|^2 where a saddle appears or vanishes."""
    A, h = e.inertia[:, motion].T, e.rotor[:, motion].T
    nearest = np.abs(region.margin).argmin(-1)
    of_saddle = region.gradient[np.arange(len(motion)), nearest]
    vanishes = (before == UNSEPARATED) | (after == UNSEPARATED)
    return np.asarray(np.where(vanishes[:, None], 2 * A * (A * omega + h), of_saddle))


def time_between(e: Ensemble, passed: Passages, state: np.ndarray, size: np.ndarray) -> np.ndarray:
    """How far in time (k,) passages are from those of another integration, by its states (m, k), in
    units of 2**size, at the times of the passages."""
    motion, k = passed.motion, e.named(passed.motion)
    omega = true_omega(e, motion, passed.state, passed.exponent)
    region = region_at(e, motion, passed.state, passed.exponent)
    gradient = gradient_at(e, motion, omega, region, passed.before, passed.after)
    y = rescaled(e.model, passed.state.T, passed.exponent).T
    change = changes_of(e, motion, passed.time, y, k).T
    off = true_omega(e, motion, state, size) - omega
    with np.errstate(all="ignore"):
        return np.asarray(np.abs((gradient * off).sum(-1) / (gradient * change).sum(-1)))
