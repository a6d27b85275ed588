"""Checks of averaging against full motions: of our own statements, which no paper makes.

The motions come in pairs, an averaged one and the full one of the same case, the weaker resistance
the later.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..claims.finding import (
    Finding,
    Undecidable,
    deviation_beyond,
    deviation_unless,
    in_groups,
    listed,
)
from ..results.motion import Motion, forms_apart

NEAR_CROSSING = 0.05
"""The part of the time of a crossing, on either side of it, in which the order of the error is not
asked for: the last turns before it and the first behind it are right to first order."""

ORDER_WITHIN = 0.15
"""By how much a fitted order may fall short: what samples miss of the largest error."""


def distance(averaged: Motion, full: Motion, margin: float = 0.0) -> float:
    """The largest relative distance of T and G^2, without the samples nearer to a crossing than
    `margin` of its time."""
    is_compared = np.ones(len(full.time), dtype=bool)
    # Not `crossing_time`: it is empty where nothing has been classified.
    for time in [crossing.time for crossing in full.crossings] if margin else ():
        is_compared &= np.abs(full.time - time) > margin * time
    return float(forms_apart(averaged, full)[is_compared].max())


def order_finding(motions: Sequence[Motion], expected: float, margin: float = 0.0) -> Finding:
    """The order of the distance in the size of the resistance, against one expected at least.
    Raises ValueError for fewer than two sizes, which have no order."""
    pairs = in_groups(motions, 2)
    small = [max(full.case.data["damping"]) for _, full in pairs]
    if len({*small}) < 2:
        raise ValueError("an order is fitted to two sizes at least")
    errors = [distance(averaged, full, margin) for averaged, full in pairs]
    # Errors at one time scatter with the phase; the largest over a motion follow the power law.
    slope = float(np.polyfit(np.log(small), np.log(errors), 1)[0])
    return Finding(
        deviation_beyond(expected - ORDER_WITHIN - slope, 0.0),
        number=slope,
        evidence=f"order {slope:.3f}, from distances {listed(errors)}",
        contradicted_by=f"an order below {expected - ORDER_WITHIN:g}",
    )


def first_order(motions: Sequence[Motion]) -> Finding:
    """Averaged motions are as near to the full ones as the first order makes them, and no
    nearer."""
    order, most = order_finding(motions, 1), 1 + ORDER_WITHIN
    return replace(
        order,
        deviation=max(order.deviation, deviation_unless(order.number < most)),
        contradicted_by=f"{order.contradicted_by} or above {most:g}",
    )


def second_order(motions: Sequence[Motion]) -> Finding:
    """Averaged motions are as near to the full ones as the second order makes them."""
    return order_finding(motions, 2)


def second_order_away_from_crossings(motions: Sequence[Motion]) -> Finding:
    """Averaged motions are as near as the second order makes them before a crossing and behind
    it."""
    return order_finding(motions, 2, NEAR_CROSSING)


def check_prediction(averaged: Motion) -> None:
    """Raises Undecidable where an averaged motion predicts neither the time of its passage nor the
    sense of rotation behind it."""
    if not averaged.stored("event_sense")[0]:
        raise Undecidable(
            f"{averaged.words} predicts nothing: its phase does not tell the half turn"
        )


def predicted_crossing(motions: Sequence[Motion]) -> Finding:
    """The error of the predicted crossing, in radians n |t - predicted|, falls from pair to pair,
    and is below that of the averaged one."""
    missed, averaged_missed = [], []
    for averaged, full in in_groups(motions, 2):
        check_prediction(averaged)
        n, time = averaged.stored("event_frequency")[0], full.crossings[0].time
        missed.append(float(n * abs(averaged.stored("event_predicted")[0] - time)))
        averaged_missed.append(float(n * abs(averaged.crossing_time[0] - time)))
    # Compared as angles: in time, even a perfect prediction's error would grow as the turns slow.
    holds = all(b < a for a, b in itertools.pairwise(missed))
    holds &= all(a < b for a, b in zip(missed, averaged_missed, strict=True))
    return Finding(
        deviation_unless(holds),
        number=missed[-1],
        evidence=f"n |t - predicted| {listed(missed)}, n |t - t*| {listed(averaged_missed)}",
        contradicted_by="an error that does not fall, "
        "or is not below that of the averaged crossing",
    )


def predicted_sense(motions: Sequence[Motion]) -> Finding:
    """The sense of rotation about the new axis is that predicted."""
    pairs = in_groups(motions, 2)
    for averaged, _ in pairs:
        check_prediction(averaged)
    complying = sum(
        int(np.sign(full.omega[-1, full.labels[-1] - 1]) == averaged.stored("event_sense")[0])
        for averaged, full in pairs
    )
    return Finding(
        deviation_unless(complying == len(pairs)),
        number=float(complying),
        evidence=f"{complying} of {len(pairs)} as predicted",
        contradicted_by="a sense that is not predicted",
    )


def steps_do_not_grow(motions: Sequence[Motion]) -> Finding:
    """The steps of motions are the same to a tenth, whatever the size of their resistance."""
    steps = [int(m.attrs["steps"]) for m in motions]
    if len(steps) < 2:
        raise ValueError("compares two motions at least")
    return Finding(
        deviation_unless(max(steps) <= 1.1 * min(steps)),
        number=float(max(steps)),
        evidence=f"steps {listed(steps)}",
        contradicted_by="steps that differ by more than a tenth",
    )
