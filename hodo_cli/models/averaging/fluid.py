"""The averaged motion of a body with a fluid-filled cavity under a constant torque.

State: g = s sqrt(X_e), f = sqrt(X_o), both in units of the start, the phase, the side and s. X_e
itself would be singular where a torque reverses the spin of a symmetric body, which g passes as any
other value. With L = -h'/X_o, h = 2T,

    g' = t L f^2/(2 g) + sqrt((a - c)/A_e) M_e <dn>
    f' = t' L f/2,    t, t' = c, -a or -a, c
"""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..base import EventOutcome
from .capture import (
    FREE,
    REGIONS,
    STOP,
    Arrival,
    Bands,
    Pair,
    Region,
    SeparatrixRates,
    pass_separatrix,
)
from .forms import EDGE, either, left_and_entered, stored_elements, with_part
from .free_turn import Body, SlowVariables, amplitude, turn_frequency
from .means import fluid_loss, fluid_weights, turn_means


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
    to_e, to_o = either(side, k.c, -k.a), either(side, -k.a, k.c)
    torque = either(side, k.torque_a, k.torque_c) * mean.pace
    n = either(side, k.turns_a, k.turns_c) * k.unit * g
    return (
        to_e * loss * f * f / (2 * g) + torque,
        to_o * loss * f / 2,
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


def fluid_band(k: Any, region: Region, amplitudes: Pair) -> SeparatrixRates:
    """The mean rates beside the separatrix, at amplitudes of a region in units of `unit`.

    There K <cn^2 dn^2> = 2/3, the integral of sech^4; K <sn^2 dn^2> = K <sn^2 cn^2> = 1/3; and K
    <dn> = pi/2.
    """
    (side, sense), (g, f) = region, amplitudes
    cd, sd, sc = k.weights_a if side > 0 else k.weights_c
    loss = (2 * cd + sd) / 3 * g * g + sc / 3 * f * f
    to_e, to_o = (k.c, -k.a) if side > 0 else (-k.a, k.c)
    torque = sense * (k.torque_a if side > 0 else k.torque_c) * math.pi
    return SeparatrixRates(
        0.0, float(to_e * loss * f * f / (g * g) + torque / g), float(to_o * loss)
    )


def fluid_bands(k: Any, side: int, amplitudes: Pair) -> Bands:
    """The mean rates in the four regions, at amplitudes on a side."""
    by_side = {side: amplitudes, -side: amplitudes[::-1]}
    return {region: fluid_band(k, region, by_side[region[0]]) for region in REGIONS}


def through_with_fluid(t: Any, y: Sequence[Any], k: SimpleNamespace) -> EventOutcome:
    """The passage of a body with a fluid; a torque makes it a matter of chance."""
    g, f, scaled_phase = y[:3]
    side, sense = (1 if value > 0 else -1 for value in y[3:])
    if not f:  # an exact rotation about an axis, which the torque has brought to rest
        return EventOutcome(float(t), left_and_entered(k, side, 0), y)
    ratio = float(either(side, k.ratio_a, k.ratio_c))
    u = -math.log(ratio * float(f) ** 2 / float(g) ** 2)
    # Rounding hides u of a nearly symmetric body, whose g is as small as its errors.
    u = u if u > 0 else EDGE
    unit, g = float(k.unit), abs(g)
    arrival = Arrival(
        t, (side, sense), u, (unit * float(g), unit * float(f)), sense * scaled_phase / k.scale
    )

    def bands(amplitudes: Pair) -> Bands:
        return fluid_bands(k, side, (amplitudes[0] / unit, amplitudes[1] / unit))

    departure = pass_separatrix(k, arrival, bands, k.branch, k.mean_start == "yes")
    # Without a lag the changes are so small that their squares are below every precision.
    g, f = (
        x * (1 + change / 2)
        for x, change in zip(departure.in_order((g, f)), departure.changes, strict=True)
    )
    sense = departure.region[1]
    return departure.outcome(
        y, (sense * g, f, sense * k.scale * departure.phase, *departure.region)
    )


def fluid_part(k: Any, slow: SlowVariables) -> tuple[Any, Any]:
    """(X_e - mean X_e)/X_e and (X_o - mean X_o)/X_o, times `unit`, at the phase of `slow` (...); 0
    where X_o is 0.

    Of sn^2 and of m sn^4 the integrals of zero mean, over n t, are -Z/m and (sn cn dn - 2 (1 + m)
    Z/m)/3, with Jacobi's zeta. sn^4 comes with a factor m everywhere: in the last term because X_o
    = m X_e/ratio. Those of dn, sn and cn, in which a constant torque comes, are am - phi, -artanh(k
    cn/dn)/k and arcsin(k sn)/k.
    """
    X_e, X_o = slow.pair
    above, m = np.asarray(slow.side) > 0, 1 - slow.m1
    am, zeta = amplitude(slow.phase, slow.m1)
    sn, cn = np.sin(am), np.cos(am)
    fourth = (sn * cn * np.sqrt(cn * cn + slow.m1 * sn * sn) - 2 * (1 + m) * zeta) / 3
    cd, sd, sc = (np.where(above, x, z) for x, z in zip(k.weights_a, k.weights_c, strict=True))
    last = np.where(above, k.last_a, k.last_c)
    total = cd * ((1 + m) * zeta + fourth) - sd * (zeta + fourth) - last * fourth
    body = Body(k.a, k.b, k.c, (0, 1, 2), 1)
    n, (w_e, w_o) = turn_frequency(body, X_e, slow.side), body.weight(slow.side)
    change = (X_e * total - sc * X_o * zeta) / n
    part_e = np.where(above, k.c, -k.a) * change * X_o / X_e
    part_o = np.where(above, -k.a, k.c) * change
    # A modulus of 0 is as good as one whose square is lost beside 1.
    modulus, g, f = np.sqrt(np.maximum(m, 1e-30)), np.sqrt(X_e), np.sqrt(X_o)
    dn = np.sqrt(cn * cn + slow.m1 * sn * sn)
    swing = np.arctanh(modulus * cn / dn) / modulus * slow.sense * k.torque_b
    about = np.where(above, k.torque_a, k.torque_c)
    across = np.where(above, k.torque_c, k.torque_a)
    root = np.sqrt(w_e)
    pushed_e = slow.sense * about * (am - slow.phase) / g + w_o / root * f / X_e * swing
    aside = root * swing + across * np.arcsin(modulus * sn) / modulus
    pushed_o = np.divide(aside, f, out=np.zeros_like(f), where=f > 0)
    return part_e + 2 / n * pushed_e, part_o + 2 / n * pushed_o


def fluid_output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
    """The stored variables.

    The periodic part is added unless the case has named a branch: a capture by chance forgets the
    phase.
    """
    g, f, scaled_phase, side, _ = y.T
    X_e, X_o, above = g * g, f * f, side > 0
    if k.mean_start == "yes" and k.branch in (FREE, STOP):
        # Not the sense that the state has: a symmetric body's spin may have reversed since.
        ratio, sense = np.where(above, k.ratio_a, k.ratio_c), np.where(g > 0, 1, -1)
        X, Y = np.where(above, X_e, X_o), np.where(above, X_o, X_e)
        # A motion that has stopped at the separatrix does not turn any more, nor one at its end of
        # spin.
        with np.errstate(divide="ignore", invalid="ignore"):
            m1 = np.maximum((X_e - ratio * X_o) / X_e, EDGE / 2)
            slow = SlowVariables(X, Y, side, m1, sense, sense * scaled_phase / k.scale)
            part_e, part_o = np.where(m1 > EDGE / 2, fluid_part(k, slow), 0)
        # `turn_frequency` takes X_e in true units, where n is larger by `unit`.
        turns = np.where(above, k.turns_a, k.turns_c) * k.unit * np.abs(g) / k.scale
        X_e, X_o = with_part(X_e, part_e / k.unit, turns), with_part(X_o, part_o / k.unit, turns)
    return stored_elements(k, X_e, X_o, side, k.unit)
