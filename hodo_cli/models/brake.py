"""Braking to rest: N = -b G/|G|. Without other torques |G|' = -b, and G = 0 in the end.

The equations have a corner at G = 0, which no power series passes. So the motion is integrated in
stages. In each of them |G| falls to a 64th. After the last stage the motion is so near to rest
that the sum N_0 of the other torques is constant. Then the end has a closed form: G turns towards
N_0, and is 0 after the time

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
"""The torques that may make |G| grow from rest."""

STAGES, STAGES_WITH_ROTOR, STAGE_RATIO = 7, 5, 64
"""The number of stages of braking, and the ratio by which |G| falls in each. After all of them |G|
is 2e-13 of its start. With a rotor it is 9e-10, because the rounding of h hides a smaller G."""

AS_STRONG = 1e-12
"""The relative difference up to which a torque counts as equal to the brake. Such a torque does not
move a body at rest."""


def drives(k: Any) -> bool:
    """Whether a torque beside the brake may make |G| grow from rest."""
    return not DRIVING.isdisjoint(k.terms.split())


def stop_details(G: np.ndarray, label: Any) -> dict[str, float]:
    """The stored details of a stop: the direction of G (3,), and the label of the enclosed axis."""
    direction = G / np.hypot.reduce(G)
    return dict(zip(("G1", "G2", "G3", "from"), map(float, (*direction, label)), strict=True))


def stage_end(t: Any, y: Sequence[Any], k: Any) -> Any:
    """The function of the event that ends a stage of braking: |G|^2 less its value at the end of
    the stage, in units of A1^2. It is 0, too, where another torque has increased |G| by the ratio
    of a stage: a new stage begins there.

    y[3] holds |G|/A1 at the start of the stage. It is divided by A1 because an engine's tolerance
    is relative to the largest variable, which |G| would be for a heavy body.
    """
    G = [x / k.A1 for x in angular_momentum_of(y[:3], k)]
    square, at_begin = dot(G, G), y[3] * y[3]
    left = square - at_begin / STAGE_RATIO**2
    return left * (at_begin - square / STAGE_RATIO**2) if drives(k) else left


def braked_stage(t: Any, y: Sequence[Any], k: Any) -> EventOutcome:
    """What follows a stage of braking: the next stage, or rest.

    After the last stage G turns towards N, the sum of the other torques at rest. If N is stronger
    than the brake the body does not stop: G falls to about 0 and grows again along N.
    """
    G, state = angular_momentum_of(y[:3], k), [*y]
    # In units of A1, as in `stage_end`, because |G|^2 may overflow.
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
    # From the constants and not from an object, because one event serves many bodies.
    A, omega = np.array([k.A1, k.A2, k.A3], float), np.array(y[:3], float)
    label = UNDETERMINED if hasattr(k, "h1") else enclosed_axis(A, omega, 0.0)
    details = stop_details(np.array(in_case_axes(G, k), float), label)
    state[:3], state[3] = (0 * size + x for x in omega_of((0.0, 0.0, 0.0), k)), 0 * size
    if strength > b * (1 - AS_STRONG):
        left = size / (2 * b)
    else:
        # Ratios, because momenta and torques may be of any size.
        along = sum(n / b * (x / size) for n, x in zip(N, G, strict=True))
        left = size / b * (1 + along) / (1 - (strength / b) ** 2)
    # The attitude turns with the omega of rest until the stop, too: the error is a part of 1e-7.
    spin = in_case_axes(state[:3], k) if attitude_in(y, k) else ()
    at_event = EventOutcome(float(t), details, state, math.inf, tuple(spin))
    stop = float(t + left)
    return at_event._replace(time=stop, state=at_event.states(stop, type(t)).tolist())


def attitude_in(y: Sequence[Any], k: Any) -> Sequence[Any]:
    """The quaternion of the state y, which follows omega and the variables of the torques. Empty
    without an attitude."""
    return y[3 + sum(len(TERMS[name].extra) for name in k.terms.split()) :]


def torque_at_rest(t: Any, y: Sequence[Any], k: Any) -> list[Any]:
    """The sum (3,) of all torques but the brake in a body with G = 0."""
    others = [name for name in k.terms.split() if name != "brake"]
    at_rest = omega_of((0.0, 0.0, 0.0), k)
    seen = SimpleNamespace(**vars(k) | {"attitude": attitude_in(y, k) or None})
    # N = A omega', because omega x G = 0 there.
    rates = rates_under(others, t, [*at_rest, *y[4:]], seen)[:3]
    return [A * rate for A, rate in zip((k.A1, k.A2, k.A3), rates, strict=True)]


PLACES_OF_MEMBER = 2**12
"""The number of intervals in which the time at rest of a member of a sweep is searched for stronger
torques. The integration of a member takes ten times as long as this search."""


@np.errstate(all="ignore")  # a formula may have no value at some time
def time_of_release(
    k: Any, stop: float, end: float, y: np.ndarray, places: int = PLACES_OF_MEMBER
) -> float:
    """The first time at which other torques move a body again that a brake has stopped at the time
    `stop`, in the state y (m,); nan where it stays at rest, or has not stopped before `end`.

    The time is found to one of `places` parts of the time from `stop` to `end`.
    """
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
    """omega (3,) = A^-1 (G - h) for G (3,), where h = 0 without a rotor."""
    return accelerations(vector_sum(G, [-x for x in rotor_of(k)]) if hasattr(k, "h1") else G, k)


STOPPED = Event("stopped", stage_end, True, braked_stage)
"""The event at the end of each stage of braking. After the last stage the body is at rest."""
