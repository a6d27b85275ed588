"""The averaged motion of a body with a fluid-filled cavity under a constant torque.

State: g = s sqrt(E), f = sqrt(O), both in units of the start, the phase, the side and s. E itself
would be singular where a torque reverses the spin of a symmetric body, which g passes as any other
value. With L = -h'/O, h = 2T,

    g' = t L f^2/(2 g) + sqrt((a - c)/A_e) M_e <dn>
    f' = t' L f/2,    t, t' = c, -a or -a, c
"""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..base import EventOutcome
from .capture import FREE, STOP, Region, branch, capture_shares
from .forms import EDGE, either, left_and_entered, stored_elements, with_part
from .free_turn import Body, Slow, amplitude, turn_frequency
from .means import fluid_loss, fluid_weights, turn_means
from .passage import outcome, time_in_band


def fluid_constants(
    body: Body, kappa: float, torque: Sequence[float], unit: float
) -> dict[str, float | tuple[float, ...]]:
    """The constants of the equations, for amplitudes in units of `unit` and the torque as
    sorted."""
    a, b, c = body[:3]
    outer, inner = a - b, b - c
    ratio_a, ratio_c = (inner / outer if outer else 0.0), (outer / inner if inner else 0.0)
    above, below = (fluid_weights(a, b, c, kappa * unit * unit, side) for side in (1, -1))
    return {
        "unit": unit,
        "ratio_a": ratio_a,
        "ratio_c": ratio_c,
        "root_a": math.sqrt(ratio_a),
        "root_c": math.sqrt(ratio_c),
        "weights_a": above,
        "weights_c": below,
        "last_a": above[2] / ratio_a if ratio_a else 0.0,
        "last_c": below[2] / ratio_c if ratio_c else 0.0,
        "torque_b": torque[1] / math.sqrt(b) / unit,
        "torque_a": math.sqrt((a - c) / a) * torque[0] / unit,
        "torque_c": math.sqrt((a - c) / c) * torque[2] / unit,
    }


def fluid_rates(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
    """The averaged equations; they stand in the head of this module."""
    g, f, _, side, sense = y
    # In amplitudes, so that m is a ratio of squares and never negative by rounding.
    m = either(side, k.ratio_a, k.ratio_c) * f * f / (g * g)
    mean = turn_means(m, 1 - m)
    weights = [either(side, x, z) for x, z in zip(k.weights_a, k.weights_c, strict=True)]
    loss = fluid_loss(weights, m, mean, g * g, f * f)
    to_E, to_O = either(side, k.c, -k.a), either(side, -k.a, k.c)
    torque = either(side, k.torque_a, k.torque_c) * mean.pace
    n = either(side, k.turns_a, k.turns_c) * k.unit * g
    return (
        to_E * loss * f * f / (2 * g) + torque,
        to_O * loss * f / 2,
        k.scale * n * mean.pace,
        0 * side,
        0 * sense,
    )


def fluid_distance(t: Any, y: Sequence[Any], k: Any) -> Any:
    """s g less sqrt(w_o/w_e) f, and EDGE: 0 where u = EDGE.

    In amplitudes: a torque takes g of a nearly symmetric body through 0 in no time, and a
    difference of squares would be positive again before anyone looks.
    """
    g, f, _, side, sense = y
    return (1 - EDGE / 2) * sense * g - either(side, k.root_a, k.root_c) * f


def rates_at_separatrix(k: Any, side: int, g: float, f: float) -> tuple[float, float, float]:
    """g', f' and u', each times K, at the separatrix.

    There K <cn^2 dn^2> = 2/3, the integral of sech^4; K <sn^2 dn^2> = K <sn^2 cn^2> = 1/3; and K
    <dn> = pi/2.
    """
    cd, sd, sc = k.weights_a if side > 0 else k.weights_c
    loss = (2 * cd + sd) / 3 * g * g + sc / 3 * f * f
    to_E, to_O = (k.c, -k.a) if side > 0 else (-k.a, k.c)
    torque = (k.torque_a if side > 0 else k.torque_c) * math.pi / 2
    dg, df = float(to_E * loss * f * f / (2 * g) + torque), float(to_O * loss * f / 2)
    return dg, df, 2 * (dg / g - df / f)


def drift_by_region(k: Any, side: int, g: float, f: float) -> dict[Region, float]:
    """The drift of D in the four regions about a point of the separatrix, up to one factor."""
    drift = {}
    for there in (1, -1):
        about, across = (abs(g), f) if there == side else (f, abs(g))
        for sense in (1, -1):
            drift[there, sense] = there * rates_at_separatrix(k, there, sense * about, across)[2]
    return drift


def through_with_fluid(t: Any, y: Sequence[Any], k: SimpleNamespace) -> EventOutcome:
    """The passage, from u = EDGE on one side to 2 EDGE on the other, by the formulas of `passage`.

    Without a torque the motion changes its axis. A torque makes that a matter of chance: it ends
    the motion here, or the branch is taken which the case names.
    """
    side, sense = (1 if value > 0 else -1 for value in y[3:])
    if not y[1]:  # an exact rotation about an axis, which the torque has brought to rest
        return EventOutcome(float(t), left_and_entered(k, side, 0), y)
    ratio = float(either(side, k.ratio_a, k.ratio_c))
    u = -math.log(ratio * float(y[1]) ** 2 / float(y[0]) ** 2)
    # Rounding hides u of a nearly symmetric body, whose g is as small as its errors.
    u = u if u > 0 else EDGE
    dg, df, du = rates_at_separatrix(k, side, float(y[0]), float(y[1]))
    seconds, at = time_in_band(u, -du), (y[0] - dg * u / du, y[1] - df * u / du)
    g, f = float(at[0]), float(at[1])
    n = float(either(side, k.turns_a, k.turns_c) * k.unit) * abs(g)
    time, phase = float(t) + seconds, sense * float(y[2] / k.scale) - math.pi / 2 * n * u / du
    # |G| there is sqrt(2 T b), and 2T = (E + O)/(a - c).
    momentum = float(k.unit) * math.sqrt(float(k.b) * (g * g + f * f) / float(k.a - k.c))
    details = left_and_entered(k, side, 0) | {"momentum": momentum, "frequency": n}
    place = lag = 0.0
    if k.branch == FREE:
        foreseen = outcome(-du, n, phase, time, -du)
        region, details["scatter"] = (-side, foreseen.sense or 1), foreseen.scatter
        if k.mean_start == "yes":
            details |= foreseen.details
        if k.mean_start == "yes" and math.isfinite(foreseen.place):
            place, lag = foreseen.place, foreseen.lag
    else:
        shares = capture_shares(drift_by_region(k, side, g, f), (side, sense))
        details["probability"] = shares[-side, 1] + shares[-side, -1]
        if not (chosen := branch(k.branch, shares, (side, sense))):
            scaled_phase = y[2] + k.scale * sense * math.pi / 2 * n * u / -du
            return EventOutcome(time, details, (*at, scaled_phase, *y[3:]))
        region = chosen
    details |= left_and_entered(k, side, region[0])
    onward, state = behind(k, region, side, at, n, place)
    scaled_phase = 0 * y[2] + state[2] * k.scale
    there = *state[:2], scaled_phase, *(0 * y[3] + value for value in region)
    return EventOutcome(time, details, there, t + (seconds + lag + onward))


def behind(
    k: Any, region: Region, side: int, at: tuple[Any, Any], n: float, place: float
) -> tuple[float, tuple[Any, Any, float]]:
    """The time from the separatrix to u = 2 EDGE in a region; g, f and s phi there.

    `at`: g and f at the separatrix, on the side that the motion comes from.
    """
    there, sense = region
    size, f = (at[0] if at[0] > 0 else -at[0]), at[1]
    about, across = (size, f) if there == side else (f, size)
    dg, df, du = rates_at_separatrix(k, there, sense * float(about), float(across))
    beyond = 2 * EDGE / du
    phase = math.pi * (place + 0.5) + math.pi / 2 * n * beyond
    g, f = sense * about + dg * beyond, across + df * beyond
    return time_in_band(2 * EDGE, du), (g, f, sense * phase)


def fluid_part(k: Any, slow: Slow) -> tuple[Any, Any]:
    """(E - mean E)/E and (O - mean O)/O, times `unit`, at the phase of `slow` (...); 0 where O
    is 0.

    Of sn^2 and of m sn^4 the integrals of zero mean, over n t, are -Z/m and (sn cn dn - 2 (1 + m)
    Z/m)/3, with Jacobi's zeta. sn^4 comes with a factor m everywhere: in the last term because O =
    m E/ratio. Those of dn, sn and cn, in which a constant torque comes, are am - phi, -artanh(k
    cn/dn)/k and arcsin(k sn)/k.
    """
    E, O = slow.pair
    above, m = np.asarray(slow.side) > 0, 1 - slow.m1
    am, zeta = amplitude(slow.phase, slow.m1)
    sn, cn = np.sin(am), np.cos(am)
    fourth = (sn * cn * np.sqrt(cn * cn + slow.m1 * sn * sn) - 2 * (1 + m) * zeta) / 3
    cd, sd, sc = (np.where(above, x, z) for x, z in zip(k.weights_a, k.weights_c, strict=True))
    last = np.where(above, k.last_a, k.last_c)
    total = cd * ((1 + m) * zeta + fourth) - sd * (zeta + fourth) - last * fourth
    body = Body(k.a, k.b, k.c, (0, 1, 2), 1)
    n, (w_e, w_o) = turn_frequency(body, E, slow.side), body.weight(slow.side)
    change = (E * total - sc * O * zeta) / n
    dE, dO = np.where(above, k.c, -k.a) * change * O / E, np.where(above, -k.a, k.c) * change
    # A modulus of 0 is as good as one whose square is lost beside 1.
    modulus, g, f = np.sqrt(np.maximum(m, 1e-30)), np.sqrt(E), np.sqrt(O)
    dn = np.sqrt(cn * cn + slow.m1 * sn * sn)
    swing = np.arctanh(modulus * cn / dn) / modulus * slow.sense * k.torque_b
    about = np.where(above, k.torque_a, k.torque_c)
    across = np.where(above, k.torque_c, k.torque_a)
    root = np.sqrt(w_e)
    pushed = slow.sense * about * (am - slow.phase) / g + w_o / root * f / E * swing
    aside = root * swing + across * np.arcsin(modulus * sn) / modulus
    scaled_phase = np.divide(aside, f, out=np.zeros_like(f), where=f > 0)
    return dE + 2 / n * pushed, dO + 2 / n * scaled_phase


def fluid_output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
    """The stored variables.

    The periodic part is added unless the case has named a branch: a capture by chance forgets the
    phase.
    """
    g, f, scaled_phase, side, _ = y.T
    E, O, above = g * g, f * f, side > 0
    if k.mean_start == "yes" and k.branch in (FREE, STOP):
        # Not the sense that the state has: a symmetric body's spin may have reversed since.
        ratio, sense = np.where(above, k.ratio_a, k.ratio_c), np.where(g > 0, 1, -1)
        X, Y = np.where(above, E, O), np.where(above, O, E)
        # A motion that has stopped at the separatrix does not turn any more, nor one at its end of
        # spin.
        with np.errstate(divide="ignore", invalid="ignore"):
            m1 = np.maximum((E - ratio * O) / E, EDGE / 2)
            slow = Slow(X, Y, side, m1, sense, sense * scaled_phase / k.scale)
            dE, dO = np.where(m1 > EDGE / 2, fluid_part(k, slow), 0)
        # `turn_frequency` takes E in true units, where n is larger by `unit`.
        turns = np.where(above, k.turns_a, k.turns_c) * k.unit * np.abs(g) / k.scale
        E, O = with_part(E, dE / k.unit, turns), with_part(O, dO / k.unit, turns)
    return stored_elements(k, E, O, side, k.unit)
