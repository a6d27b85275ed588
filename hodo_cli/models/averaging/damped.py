"""The averaged motion under linear resistance; see `Damped`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..base import Constants, Event, EventOutcome
from .capture import FREE, REGIONS, Arrival, SeparatrixRates, pass_separatrix
from .forms import (
    AveragedTurns,
    distance_to_edge,
    either,
    stored_elements,
    turning_constants,
    with_part,
)
from .free_turn import LANDEN, Body, SlowVariables, turn_frequency
from .means import damped_part, linear_rates, turn_means
from .passage import on_side

NEVER = -1e4
"""ln X_o of an exact rotation about the enclosed axis: it stays one, and exp of it is 0."""

SYMMETRIC = 1e4
"""The size of ln((a - b)/(b - c)) for two equal moments: there m is 0, and one side is missing."""


def logarithmic_offset(body: Body) -> float:
    """ln((a - b)/(b - c)), in u = side * offset + ln X_e - ln X_o."""
    outer, inner = body.a - body.b, body.b - body.c
    if outer and inner:
        return math.log(outer / inner)
    return SYMMETRIC if outer else -SYMMETRIC


def linear_band(lam: Sequence[float]) -> SeparatrixRates:
    """The rates of `linear_rates` beside the separatrix, where <dn^2> = <cn^2> = 1/K."""
    l_e, l_m, l_o = lam
    return SeparatrixRates(-2 * l_m, -2 * (l_e - l_m), -2 * (l_o - l_m))


def through_separatrix(t: Any, y: Sequence[Any], k: SimpleNamespace) -> EventOutcome:
    """The passage of a motion under linear resistance, which drives D alike in all regions."""
    ln_e, ln_o, scaled_phase, side = y
    lam = float(k.l1), float(k.l2), float(k.l3)
    bands = {region: linear_band(on_side(lam, region[0])) for region in REGIONS}
    # Without a torque nothing depends on the sense.
    region = int(side), 1
    amplitudes = math.exp(float(ln_e) / 2), math.exp(float(ln_o) / 2)
    u = float(ln_e - ln_o + side * k.turning_offset)
    arrival = Arrival(t, region, u, amplitudes, scaled_phase / k.scale)
    predictable = k.mean_start == k.predictable == "yes"
    departure = pass_separatrix(k, arrival, lambda _: bands, FREE, predictable, max(map(abs, lam)))
    pair = (
        ln + change
        for ln, change in zip(departure.in_order((ln_e, ln_o)), departure.changes, strict=True)
    )
    return departure.outcome(y, (*pair, k.scale * departure.phase, departure.region[0]))


@dataclass(frozen=True)
class Damped(AveragedTurns):
    """Linear resistance, averaged over the turns of the hodograph about the enclosed axis e.

    (ln X_e)' = -2 [l_m + (l_e - l_m) <dn^2>]
    (ln X_o)' = -2 [l_m + (l_o - l_m) <cn^2>]
    phi' = n <dn>

    k^2 = w_o X_o/(w_e X_e), with w_e, w_o = a - b, b - c or the reverse. The state is ln X_e, ln
    X_o, scale * phi and the side: it has its digits however far the motion has decayed, at both
    axes and at the separatrix.

    Source: L. D. Akulenko, D. D. Leshchenko, F. L. Chernousko, Izv. AN SSSR MTT 1982 no. 3, 5, in
    other variables.
    """

    state = ("ln_e", "ln_o", "scaled_phase", "side")

    @property
    def coefficients(self) -> tuple[float, ...]:
        """lambda about x1, x2, x3."""
        assert self.dissipation is not None
        return tuple(self.dissipation.damping)

    @property
    def predictable(self) -> bool:
        """Whether the equations know all of the torque that the phase at a passage depends on."""
        return True

    @property
    def sorted_coefficients(self) -> tuple[float, ...]:
        """lambda about the axes of largest, middle and smallest moment of inertia."""
        lam = self.coefficients
        return tuple(lam[axis] for axis in self.body.order)

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        ln_e, ln_o, _, side = y
        # The state holds logarithms: X_e and X_o themselves would be 0 long before the shape of
        # the motion is lost.
        m = k.e ** (ln_o - ln_e - side * k.turning_offset)
        mean = turn_means(m, 1 - m)
        lam = either(side, k.l1, k.l3), k.l2, either(side, k.l3, k.l1)
        n = either(side, k.turns_a, k.turns_c) * k.e ** (ln_e / 2)
        return *linear_rates(lam, mean), k.scale * n * mean.pace, 0 * side

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        ln_e, ln_o, scaled_phase, side = y.T
        # In units of X_e: the shape has its digits where X_e itself is below the smallest double.
        X_e, X_o, unit = np.ones_like(ln_e), np.exp(ln_o - ln_e), np.exp(ln_e / 2)
        if k.mean_start == "yes":
            body, square = Body(k.a, k.b, k.c, (0, 1, 2), 1), unit * unit
            X, Y = np.where(side > 0, (square, X_o * square), (X_o * square, square))
            m1 = -np.expm1(ln_o - ln_e - side * k.turning_offset)
            with np.errstate(divide="ignore", invalid="ignore"):  # nothing turns any more
                slow = SlowVariables(X, Y, side, m1, 1, scaled_phase / k.scale)
                part_e, part_o = damped_part(body, (k.l1, k.l2, k.l3), slow)
            turns = turn_frequency(body, square, side) / k.scale
            X_e, X_o = with_part(X_e, part_e, turns), with_part(X_o, part_o, turns)
        return stored_elements(k, X_e, X_o, side, unit)

    @cached_property
    def constants(self) -> Constants:
        l1, l2, l3 = self.sorted_coefficients
        # heyoka counts parameters up to the last that the equations use: that has to come last.
        return {
            **turning_constants(self.body),
            "mean_start": self.mean_start,
            "predictable": "yes" if self.predictable else "no",
            "e": math.e,
            "l1": l1,
            "l2": l2,
            "l3": l3,
            "turning_offset": logarithmic_offset(self.body),
            "scale": self.scale,
        }

    @property
    def scale(self) -> float:
        """The rate of decay, in whose unit of time the phase is of the size of the other
        variables; at most 1, as of motions that are fast because their unit of time is long."""
        return min(max(map(abs, self.coefficients)) or 1.0, 1.0)

    def periodic_start(self, slow: SlowVariables) -> tuple[np.ndarray, np.ndarray]:
        return damped_part(self.body, self.sorted_coefficients, slow)

    def states(self, slow: SlowVariables) -> np.ndarray:
        ln_e, ln_o = (
            np.log(value, out=np.full(np.shape(value), NEVER), where=value > 0)
            for value in slow.pair
        )
        return np.stack((ln_e, ln_o, self.scale * slow.phase, slow.side + 0.0))

    @property
    def rate(self) -> float:
        """How fast the resistance acts: the norm of the matrix of its rates."""
        return max(map(abs, self.coefficients))

    def smallness(self, y: np.ndarray) -> np.ndarray:
        ln_e, ln_o, _, side = y.T
        m1 = -np.expm1(ln_o - ln_e - side * logarithmic_offset(self.body))
        pace = turn_means(1 - m1, m1, LANDEN).pace
        n = turn_frequency(self.body, np.exp(ln_e), side)
        return np.asarray(self.rate * np.pi / 2 / (pace * n))

    @property
    def run_events(self) -> tuple[Event, ...]:
        l1, _, l3 = self.sorted_coefficients
        event = Event("separatrix", distance_to_edge, terminal=True, passage=through_separatrix)
        # With l1 = l3 every motion keeps its side, and a passage would divide by l1 - l3.
        return (event,) if l1 != l3 else ()
