"""Braking to rest: N = -b G/|G|, so that |G|' = -b without other torques, and G = 0 in the end.

The equations have a corner at G = 0, which no series passes. So the motion is integrated in stages,
in each of which |G| falls to a 64th. After the last of them the torques beside the brake are
constant, and the rest has a closed form: G turns towards their sum N_0, and is 0 after the time

    |G| (1 + N_0.G/(b |G|)) / (b (1 - |N_0|^2/b^2)).
"""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from .base import Event, EventOutcome
from .euler import (
    TERMS,
    accelerations,
    angular_momentum_of,
    dot,
    in_case_axes,
    rates_under,
    rotor_of,
    vector_sum,
)
from .rigid_body import UNDETERMINED, enclosed_axis
from .terms.time_laws import coefficient_at

DRIVING = frozenset({"torque", "space_torque", "expression"})
"""The torques under which |G| may grow from rest, and fall again."""

STAGES, STAGES_WITH_ROTOR, STAGE_RATIO = 7, 5, 64
"""How often |G| falls by a ratio, a stage of braking each time, before a brake has all but stopped
the body: to 2e-13 of it, with a rotor, whose h hides what is left of G, to 9e-10."""

AS_STRONG = 1e-12
"""The relative difference up to which a torque counts as equal to a brake: a body that comes to
rest against such a torque stays at rest."""


def drives(k: Any) -> bool:
    """Whether |G| may grow from rest."""
    return not DRIVING.isdisjoint(k.terms.split())


def stop_details(G: np.ndarray, label: Any) -> dict[str, float]:
    """The details of a stop as they are stored: the direction of G (3,), and the label."""
    direction = G / np.hypot.reduce(G)
    return dict(zip(("G1", "G2", "G3", "from"), map(float, (*direction, label)), strict=True))


def stage_end(t: Any, y: Sequence[Any], k: Any) -> Any:
    """|G|^2 less its value at the end of a stage of braking, in units of A1^2; 0 too where a torque
    has increased |G| by the same ratio: a new stage begins there.

    y[3] holds |G|/A1 as the stage began: an engine's tolerance is a part of the largest variable or
    event, and |G| itself would be the largest by far of a heavy body.
    """
    G = [x / k.A1 for x in angular_momentum_of(y[:3], k)]
    square, at_begin = dot(G, G), y[3] * y[3]
    left = square - at_begin / STAGE_RATIO**2
    return left * (at_begin - square / STAGE_RATIO**2) if drives(k) else left


def braked_stage(t: Any, y: Sequence[Any], k: Any) -> EventOutcome:
    """The passage at the end of a stage of braking: to the next stage, or to rest.

    After the last stage G pursues the direction of N, the sum of the other torques at rest. A body
    that comes near to rest against a stronger torque turns round: G goes through 0.
    """
    G, state = angular_momentum_of(y[:3], k), [*y]
    # In units of A1, as in `stage_end`: |G|^2 need not be a double.
    per_A1 = [x / k.A1 for x in G]
    size = k.A1 * dot(per_A1, per_A1) ** 0.5
    stages = STAGES_WITH_ROTOR if hasattr(k, "h1") else STAGES
    if size > 2 * k.momentum_at_start / STAGE_RATIO**stages:
        state[3] = size / k.A1
        return EventOutcome(float(t), None, state, t)
    b = float(coefficient_at(k, "brake", t))
    N = [*map(float, torque_at_rest(t, y, k))]
    strength = math.hypot(*N)
    if strength > b * (1 + AS_STRONG):
        state[:3] = omega_of([x * (size / strength) for x in N], k)
        state[3] = size / k.A1
        turned = size / (strength + b) + size / (strength - b)
        return EventOutcome(float(t), None, state, t + turned)
    # By the constants: one event serves many bodies.
    A, omega = np.array([k.A1, k.A2, k.A3], float), np.array(y[:3], float)
    label = UNDETERMINED if hasattr(k, "h1") else enclosed_axis(A, omega, 0.0)
    details = stop_details(np.array(in_case_axes(G, k), float), label)
    state[:3], state[3] = (0 * size + x for x in omega_of((0.0, 0.0, 0.0), k)), 0 * size
    if strength > b * (1 - AS_STRONG):
        left = size / (2 * b)
    else:
        # By ratios, since momenta and torques may be of any size.
        along = sum(n / b * (x / size) for n, x in zip(N, G, strict=True))
        left = size / b * (1 + along) / (1 - (strength / b) ** 2)
    # From the event on it turns as after the stop, but for a part of 1e-7.
    spin = in_case_axes(state[:3], k) if attitude_in(y, k) else ()
    at_event = EventOutcome(float(t), details, state, math.inf, tuple(spin))
    stop = float(t + left)
    return at_event._replace(time=stop, state=at_event.states(stop, type(t)).tolist())


def attitude_in(y: Sequence[Any], k: Any) -> Sequence[Any]:
    """The quaternion of a state, which comes after the variables of the torques; empty without an
    attitude."""
    return y[3 + sum(len(TERMS[name].extra) for name in k.terms.split()) :]


def torque_at_rest(t: Any, y: Sequence[Any], k: Any) -> list[Any]:
    """The sum of all torques but the brake (3,) where G is 0."""
    others = [name for name in k.terms.split() if name != "brake"]
    at_rest = omega_of((0.0, 0.0, 0.0), k)
    seen = SimpleNamespace(**vars(k) | {"attitude": attitude_in(y, k) or None})
    # A omega', since -omega x G is 0 there.
    rates = rates_under(others, t, [*at_rest, *y[4:]], seen)[:3]
    return [A * rate for A, rate in zip((k.A1, k.A2, k.A3), rates, strict=True)]


PLACES_OF_MEMBER = 2**12
"""The number of intervals of a member's time at rest that are searched for stronger torques: its
motion takes ten times as long as this search."""


@np.errstate(all="ignore")  # of a formula that has no value at a time
def time_of_release(
    k: Any, stop: float, end: float, y: np.ndarray, places: int = PLACES_OF_MEMBER
) -> float:
    """The time at which other torques would move a body with these constants again, which a brake
    has stopped in a state (m,), to one of `places` parts of the time until the end; nan where it
    has not stopped, or stays."""
    if not (stop < end and drives(k)):
        return math.nan
    t = np.linspace(stop, end, places + 1)
    N = torque_at_rest(t, [*y], k)
    strength = np.sqrt(sum(x * x for x in N))
    is_stronger = np.broadcast_to(
        strength > coefficient_at(k, "brake", t) * (1 + AS_STRONG), t.shape
    )
    return float(t[is_stronger.argmax()]) if is_stronger.any() else math.nan


def omega_of(G: Sequence[Any], k: Any) -> Sequence[Any]:
    """omega (3,) from an angular momentum (3,), which includes h of a rotor."""
    return accelerations(vector_sum(G, [-x for x in rotor_of(k)]) if hasattr(k, "h1") else G, k)


STOPPED = Event("stopped", stage_end, True, braked_stage)
"""The end of each stage of braking; the body is at rest after the last of them."""
