"""Averages of a sum of torques each of which has a closed mean: the rates add up."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..terms import torques as terms
from ..terms.laws import coefficient_at
from .fluid import fluid_constants, fluid_part
from .forms import either
from .free_turn import Body, SlowVariables, turning_body
from .means import Means, damped_part, fluid_loss, fluid_weights, linear_rates, turn_means

Rates = tuple[Any, Any]
"""(ln X_e)' and (ln X_o)'."""


class MeanTurn(NamedTuple):
    """A turn of the free motion: the body, its side and sense, m with its means, X_e and X_o."""

    body: Body
    side: Any
    sense: Any
    m: Any
    mean: Means
    X_e: Any
    X_o: Any


def linear_means(lam: Sequence[Any], turn: MeanTurn) -> Rates:
    """The rates under linear resistance at rates lam about the body axes."""
    l1, l2, l3 = (lam[axis] for axis in turn.body.order)
    return linear_rates((either(turn.side, l1, l3), l2, either(turn.side, l3, l1)), turn.mean)


def damping_means(t: Any, turn: MeanTurn, k: Any) -> Rates:
    """The rates under damping."""
    return linear_means([coefficient_at(k, name, t) for name in terms.DAMPING.degree], turn)


def resistance_means(t: Any, turn: MeanTurn, k: Any) -> Rates:
    """The rates under a tensor of resistance: the means of p q, q r and p r are 0."""
    return linear_means((k.I11 / k.A1, k.I22 / k.A2, k.I33 / k.A3), turn)


def fluid_means(t: Any, turn: MeanTurn, k: Any) -> Rates:
    """The rates under the torque of a fluid, which keeps G."""
    a, _, c = turn.body[:3]
    pairs = zip(k.turning_weights_a, k.turning_weights_c, strict=True)
    weights = [either(turn.side, above, below) for above, below in pairs]
    loss = fluid_loss(weights, turn.m, turn.mean, turn.X_e, turn.X_o)
    loss = coefficient_at(k, "kappa", t) * loss
    return either(turn.side, c, -a) * loss * turn.X_o / turn.X_e, either(turn.side, -a, c) * loss


def constant_means(t: Any, turn: MeanTurn, k: Any) -> Rates:
    """The rates under a torque constant in the body, of its component about the enclosed axis."""
    a, _, c, order, parity = turn.body
    M = [parity * coefficient_at(k, name, t) for name in terms.CONSTANT.degree]
    about = either(
        turn.side, M[order[0]] * ((a - c) / a) ** 0.5, M[order[2]] * ((a - c) / c) ** 0.5
    )
    return 2 * turn.sense * about * turn.mean.pace / turn.X_e**0.5, 0 * turn.m


def brake_means(t: Any, turn: MeanTurn, k: Any) -> Rates:
    """The rates under a brake, without a periodic part: |G| is constant over a turn."""
    a, _, c = turn.body[:3]
    outer, inner = either(turn.side, a, c), either(turn.side, c, a)
    momentum = ((outer * turn.X_e + inner * turn.X_o) / (a - c)) ** 0.5
    rate = -2 * coefficient_at(k, "brake", t) / momentum
    return rate, rate


CLOSED: Mapping[str, Callable[[Any, MeanTurn, Any], Rates]] = {
    "damping": damping_means,
    "resistance": resistance_means,
    "kappa": fluid_means,
    "torque": constant_means,
    "brake": brake_means,
}
"""The terms of a sum whose means are known in closed form."""


def rates_of_sum(names: Iterable[str], t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
    """The averaged equations of `any_torque`, for a sum of terms of these names."""
    ln_e, ln_o, _, side, sense = y
    body = turning_body(k)
    a, b, c = body[:3]
    m = k.turning_e ** (ln_o - ln_e - side * k.turning_offset)
    mean = turn_means(m, 1 - m)
    turn = MeanTurn(body, side, sense, m, mean, k.turning_e**ln_e, k.turning_e**ln_o)
    rates = [CLOSED[name](t, turn, k) for name in names]
    n = (either(side, a - b, b - c) * turn.X_e / (a * b * c)) ** 0.5
    rate_e, rate_o = sum(rate[0] for rate in rates), sum(rate[1] for rate in rates)
    return rate_e, rate_o, k.turning_scale * n * mean.pace, 0 * side, 0 * sense


def part_of_sum(
    names: Iterable[str], t: Any, slow: SlowVariables, k: Any
) -> tuple[np.ndarray, np.ndarray]:
    """(X_e - mean X_e)/X_e and (X_o - mean X_o)/X_o (n,) at times t, of a sum of such terms."""
    body, total = turning_body(k), np.zeros((2, *np.shape(slow.X)))
    a, b, c = body[:3]
    if "damping" in names:
        lam = [coefficient_at(k, name, t) for name in terms.DAMPING.degree]
        total += damped_part(body, [lam[axis] for axis in body.order], slow)
    # The fluid's and a constant torque's are linear in kappa and in each component.
    strengths = [coefficient_at(k, "kappa", t) if "kappa" in names else 0.0]
    torque = [
        coefficient_at(k, name, t) if "torque" in names else 0.0 for name in ("N1", "N2", "N3")
    ]
    strengths += [body.parity * torque[axis] for axis in body.order]
    for strength, unit in zip(strengths, np.eye(4), strict=False):
        if np.any(strength):
            constants = fluid_constants(body, unit[0], unit[1:].tolist(), 1.0)
            total += strength * np.array(
                fluid_part(SimpleNamespace(a=a, b=b, c=c, **constants), slow)
            )
    return total[0], total[1]


def weights_of_fluid(body: Body) -> dict[str, tuple[float, ...]]:
    """The constants of a fluid's means, for kappa = 1."""
    above, below = (fluid_weights(*body[:3], 1.0, side) for side in (1, -1))
    return {"turning_weights_a": above, "turning_weights_c": below}
