"""Averages of a sum of torques each of which has a closed mean: the rates add up, and so do the
periodic parts."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..base import Event
from ..terms.body import BodyUnderTorques
from ..terms.laws import coefficient_at
from ..terms.torques import TERMS
from .forms import AveragedTurns, Turn
from .free_turn import (
    Body,
    Means,
    SlowVariables,
    amplitude,
    either,
    exchanged,
    turn_frequency,
    turning_body,
)
from .passage import Pair, Region, SeparatrixRates

BESIDE_SEPARATRIX = Means(1 - 1j, 1 - 4j / 3, 1j, 1j, math.pi / 2 * 1j)
"""The means beside the separatrix, where K <cn^2> = K <dn^2> = 1, K <sn^2 cn^2> = 1/3 and K <dn> =
pi/2. Each is x + y/K, written as the complex number x + iy: the rates are sums of means by real
factors, so that theirs come out in the same form."""

UNEVEN = (*TERMS["torque"].degree, "I12", "I13", "I21", "I23", "I31", "I32")
"""The constants of torques that are not even; see `AveragedTurns.is_even`."""


def fluid_loss(weights: Sequence[Any], m: Any, mean: Means) -> Any:
    """-h'/(X_e X_o) of the fluid's torque, h = 2T, with the weights of cn^2 dn^2, sn^2 dn^2 and m
    sn^2 cn^2.

    X_o is a factor of h': a steady rotation about the enclosed axis loses nothing. G is kept:
    X' = -c h', Y' = a h'.
    """
    cd, sd, sc = weights
    # <sn^2 cn^2> and <sn^2 dn^2>, by sn^2 + cn^2 = 1 and dn^2 = 1 - m sn^2.
    ss_cc, ss_dd = mean.ss - mean.ssss, mean.ss - m * mean.ssss
    return cd * (mean.cc - m * ss_cc) + sd * ss_dd + sc * m * ss_cc


def fluid_weights(body: Body) -> tuple[float, float, float]:
    """The weights of `fluid_loss` on side +1, for kappa = 1; on side -1 the last two are exchanged.

    -h' = (2 kappa/abc) [(a-c)^2 (a+c-b) <p^2 r^2> + (a-b)^2 (a+b-c) <p^2 q^2>
                         + (b-c)^2 (b+c-a) <q^2 r^2>], and X_o (b-c) = m X_e (a-b) on side +1

    Source: the power N.omega of Chernousko's torque, an identity in p, q, r.
    """
    a, b, c = body[:3]
    pr, pq, qr = (
        (a + c - b) / (a * c),
        (a - b) * (a + b - c) / (a * b * (a - c)),
        (b - c) * (b + c - a) / (b * c * (a - c)),
    )
    unit = 2 / (a * b * c)
    return unit * pr, unit * pq, unit * qr


def damping_rates(t: Any, k: Any) -> Sequence[Any]:
    """The rates of damping about the body axes."""
    return [coefficient_at(k, name, t) for name in TERMS["damping"].degree]


def resistance_rates(t: Any, k: Any) -> Sequence[Any]:
    """The rates of a tensor of resistance: the means of p q, q r and p r are 0."""
    diagonal = (coefficient_at(k, name, t) for name in ("I11", "I22", "I33"))
    return [entry / moment for entry, moment in zip(diagonal, (k.A1, k.A2, k.A3), strict=True)]


def linear_mean(rates: Callable[[Any, Any], Sequence[Any]], t: Any, turn: Turn, k: Any) -> Pair:
    """(ln X_e)' and (ln X_o)' under linear resistance at rates about the body axes. No moment of
    inertia occurs."""
    l_e, l_m, l_o = turn.body.enclosed_first(turn.side, rates(t, k))
    return -2 * (l_m + (l_e - l_m) * turn.mean.dd), -2 * (l_m + (l_o - l_m) * turn.mean.cc)


def linear_part(
    rates: Callable[[Any, Any], Sequence[Any]], t: Any, slow: SlowVariables, k: Any
) -> np.ndarray:
    """The periodic parts under linear resistance.

    (X_e - mean X_e)/X_e = -2 (l_e - l_m) Z/n,  (X_o - mean X_o)/X_o = -2 (l_o - l_m) Z/(m n), Z
    Jacobi's zeta at the phase.
    """
    body = turning_body(k)
    l_e, l_m, l_o = body.enclosed_first(slow.side, rates(t, k))
    _, zeta = amplitude(slow.phase, slow.m1)
    swing = -2 * zeta / turn_frequency(body, slow.X_e, slow.side)
    return np.array(((l_e - l_m) * (1 - slow.m1) * swing, (l_o - l_m) * swing))


def fluid_mean(t: Any, turn: Turn, k: Any) -> Pair:
    """(ln X_e)' and (ln X_o)' under the torque of a fluid, which keeps G."""
    a, _, c = turn.body[:3]
    cd, above, below = k.turning_weights
    weights = cd, *exchanged(turn.side, above, below)
    loss = coefficient_at(k, "kappa", t) * fluid_loss(weights, turn.m, turn.mean)
    to_e, to_o = exchanged(turn.side, c, -a)
    return to_e * (loss * turn.root_o * turn.root_o), to_o * (loss * turn.root_e * turn.root_e)


def fluid_part(t: Any, slow: SlowVariables, k: Any) -> np.ndarray:
    """The periodic parts under the torque of a fluid.

    Of sn^2 and of m sn^4 the integrals of zero mean, over n t, are -Z/m and (sn cn dn - 2 (1 + m)
    Z/m)/3, with Jacobi's zeta. sn^4 comes with a factor m everywhere.
    """
    body, X_e, X_o, m = turning_body(k), slow.X_e, slow.X_o, 1 - slow.m1
    am, zeta = amplitude(slow.phase, slow.m1)
    sn, cn = np.sin(am), np.cos(am)
    # The integral of m sn^4.
    fourth = (sn * cn * np.sqrt(cn * cn + slow.m1 * sn * sn) - 2 * (1 + m) * zeta) / 3
    # The weights of cn^2 dn^2, sn^2 dn^2 and sn^2 cn^2 in the loss of energy.
    cd, above, below = k.turning_weights
    sd, sc = exchanged(slow.side, above, below)
    total = cd * ((1 + m) * zeta + fourth) - sd * (zeta + fourth) - sc * (fourth + m * zeta)
    change = coefficient_at(k, "kappa", t) * total / turn_frequency(body, X_e, slow.side)
    to_e, to_o = exchanged(slow.side, body.c, -body.a)
    return np.array((to_e * change * X_o, to_o * change * X_e))


def constant_torque(t: Any, k: Any) -> Sequence[Any]:
    """A torque constant in the body, along the sorted axes a, b and c, in such units that X' = 2
    sqrt(X) N_a about axis a."""
    body = turning_body(k)
    N = [body.parity * coefficient_at(k, name, t) for name in TERMS["torque"].degree]
    lever_a, lever_c = k.turning_levers
    a, b, c = body.order
    return lever_a * N[a], N[b] / body.b**0.5, lever_c * N[c]


def constant_mean(t: Any, turn: Turn, k: Any) -> Pair:
    """(ln X_e)' and (ln X_o)' under a torque constant in the body: its component about the
    enclosed axis acts."""
    above, _, below = constant_torque(t, k)
    about = either(turn.side, above, below)
    return 2 * turn.sense * about * turn.mean.dn / turn.root_e, 0 * turn.m


def constant_part(t: Any, slow: SlowVariables, k: Any) -> np.ndarray:
    """The periodic parts under a torque constant in the body.

    The integrals of zero mean of dn, sn and cn are am - phi, -artanh(k cn/dn)/k and arcsin(k sn)/k.
    """
    body, X_e, X_o = turning_body(k), slow.X_e, slow.X_o
    am, _ = amplitude(slow.phase, slow.m1)
    sn, cn = np.sin(am), np.cos(am)
    # A modulus of 0 is as good as one whose square is lost beside 1.
    modulus = np.sqrt(np.maximum(1 - slow.m1, 1e-30))
    dn = np.sqrt(cn * cn + slow.m1 * sn * sn)
    N_a, N_b, N_c = constant_torque(t, k)
    about, across = exchanged(slow.side, N_a, N_c)
    swing = np.arctanh(modulus * cn / dn) / modulus * slow.sense * N_b
    root_e, root_o, (w_e, w_o) = np.sqrt(X_e), np.sqrt(X_o), body.weights(slow.side)
    root = np.sqrt(w_e)
    part_e = slow.sense * about * (am - slow.phase) / root_e + w_o / root * root_o / X_e * swing
    aside = root * swing + across * np.arcsin(modulus * sn) / modulus
    part_o = np.divide(aside, root_o, out=np.zeros_like(aside), where=root_o > 0)
    return np.asarray(np.array((part_e, part_o)) * 2 / turn_frequency(body, X_e, slow.side))


def brake_mean(t: Any, turn: Turn, k: Any) -> Pair:
    """(ln X_e)' and (ln X_o)' under a brake, which keeps the shape of the hodograph."""
    a, _, c = turn.body[:3]
    A_e, A_o = exchanged(turn.side, a, c)
    square = A_e * turn.root_e * turn.root_e + A_o * turn.root_o * turn.root_o
    rate = -2 * coefficient_at(k, "brake", t) / (square / (a - c)) ** 0.5
    return rate, rate


def brake_part(t: Any, slow: SlowVariables, k: Any) -> np.ndarray:
    """No periodic parts: |G| is constant over a turn."""
    return np.zeros((2, *np.shape(slow.X_e)))


class ClosedAverage(NamedTuple):
    """What a torque does over a turn: the mean rates of ln X_e and ln X_o, and the periodic parts
    of X_e and X_o, relative to them."""

    mean: Callable[[Any, Turn, Any], Pair]
    part: Callable[[Any, SlowVariables, Any], np.ndarray]


CLOSED: Mapping[str, ClosedAverage] = {
    "damping": ClosedAverage(
        partial(linear_mean, damping_rates), partial(linear_part, damping_rates)
    ),
    "resistance": ClosedAverage(
        partial(linear_mean, resistance_rates), partial(linear_part, resistance_rates)
    ),
    "kappa": ClosedAverage(fluid_mean, fluid_part),
    "torque": ClosedAverage(constant_mean, constant_part),
    "brake": ClosedAverage(brake_mean, brake_part),
}
"""The terms of a sum whose averages are known in closed form."""


class ClosedMeans(AveragedTurns, BodyUnderTorques):
    """An averaged form whose mean rates are those of a sum of terms of CLOSED."""

    def constants_of_means(self) -> dict[str, str | tuple[float, ...]]:
        a, _, c = self.body[:3]
        constants = {
            "kappa": ("turning_weights", fluid_weights(self.body)),
            "torque": ("turning_levers", (math.sqrt((a - c) / a), math.sqrt((a - c) / c))),
        }
        named = [constants[name] for name in self.terms if name in constants]
        return super().constants_of_means() | dict(named)

    @classmethod
    def rates(cls, t: Any, turn: Turn, k: Any) -> Pair:
        means = (CLOSED[name].mean(t, turn, k) for name in cls.terms)
        by_e, by_o = map(sum, zip(*means, strict=True))
        return by_e, by_o

    def torque_rate(self, t: Any, turn: Turn, k: Any) -> Any:
        """That of the means, and under a constant torque that of its components without a mean."""
        rate = super().torque_rate(t, turn, k)
        if "torque" not in self.terms:
            return rate
        # About the other two axes a constant torque has no mean, and averaging needs it weak too.
        above, middle, below = constant_torque(t, k)
        _, w_o = self.body.weights(turn.side)
        others = np.sqrt(w_o) * middle, either(turn.side, below, above)
        return np.maximum.reduce(np.broadcast_arrays(rate, *(np.abs(others) / turn.root_e)))


class ClosedTurns(ClosedMeans):
    """An averaged form in closed form throughout."""

    @classmethod
    def rates_beside(cls, t: float, region: Region, roots: Pair, k: Any) -> SeparatrixRates:
        """From the means at m = 1, in the form x + y/K."""
        turn = Turn(turning_body(k), *region, *roots, m=1.0, mean=BESIDE_SEPARATRIX)
        by_e, by_o = cls.rates(t, turn, k)
        return SeparatrixRates(by_e.real, by_e.imag, by_o.imag)

    @classmethod
    def is_even(cls, t: float, root_x: float, k: Any) -> bool:
        return all(getattr(k, name, 0.0) == 0.0 for name in UNEVEN)

    @classmethod
    def part(cls, t: Any, slow: SlowVariables, k: Any) -> np.ndarray:
        return np.array(sum(CLOSED[name].part(t, slow, k) for name in cls.terms))

    @property
    def run_events(self) -> tuple[Event, ...]:
        """No passage where the torques never change the side of a motion."""
        largest, _, smallest = self.body.order
        # Motions keep their side where nothing distinguishes the two outer axes, and a passage
        # would divide by the difference. Laws of time that agree in any span agree always.
        moments = self.dissipations(0.0, 1.0)
        is_alike = all(
            not (torques.kappa or any(torques.torque))
            and torques.damping[largest] == torques.damping[smallest]
            for torques in moments
        )
        return self.averaged_events if moments and is_alike else super().run_events
