"""A rigid body under a sum of torques: what follows from the coefficients that its case gives."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..base import REST_BITS, Constants
from ..rigid_body import BodyFrame, body_constants, inertia_order
from ..theory.closed_form import AlongMomentum, free_motion, scaled_motion
from ..theory.dissipation import (
    Dissipation,
    axes_never_left,
    axis_weights,
    tilt_growth_rates,
)
from ..theory.principal_axes import is_diagonal
from .laws import (
    dimensional_values,
    is_law,
    law_constants,
    scaled,
    times_of_all_signs,
    value_at,
)
from .torques import TERMS, cavity_warnings, coefficient, rates_under, weak

TENSOR_ROUNDING = 1e-13
"""The part of the largest entry of a tensor below which one is the rounding of a change of axes."""

ZEROS = (0.0, 0.0, 0.0)

NOT_COVERED = frozenset({"rotor", "space_torque", "expression"})
"""The terms of which the theorems on crossings and tilts say nothing."""


def terms_named(data: Mapping[str, Any]) -> tuple[str, ...]:
    """The terms that a case names, in the order of TERMS."""
    given = {"kappa" if name == "cavity" else name for name, x in data.items() if x is not None}
    return tuple(name for name in TERMS if name in given)


def coefficients_of(data: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """The coefficients of each term that a case names, numbers or laws, in the order of the term's
    constants; those of `torque` times epsilon."""
    if data.get("cavity") is not None:
        data = {**data, "kappa": coefficient(data["cavity"])}
    given = {name: TERMS[name].coefficients(data[name]) for name in terms_named(data)}
    if "torque" in given:
        given["torque"] = tuple(scaled(x, data.get("epsilon", 1.0)) for x in given["torque"])
    return given


def damping_warnings(damping: Sequence[Any]) -> list[str]:
    """Warnings of coefficients, numbers or laws, that no medium has."""
    negative = ", ".join(
        f"lambda{i}(t) where it is below 0" if is_law(x) else f"lambda{i} = {x:g}"
        for i, x in enumerate(damping, 1)
        if min(dimensional_values(x)) < 0
    )
    return [f"negative damping feeds energy in: {negative}"] if negative else []


def tensor_warnings(I: np.ndarray) -> list[str]:
    """Warnings of a tensor that no medium has."""
    values = np.linalg.eigvalsh(I / 2 + I.T / 2)
    messages = []
    if values[0] < -1e-12 * abs(values[-1]):
        named = ", ".join(f"{value:.6g}" for value in values)
        messages.append(
            f"the tensor is not dissipative: its symmetric part has the eigenvalues {named}"
        )
    # A tensor given in decimals, turned into other axes, is symmetric to its last digits.
    if np.abs(I - I.T).max() > 1e-9 * np.abs(I).max():
        messages.append("the tensor is not symmetric")
    return messages


class BodyUnderTorques(BodyFrame):
    """A rigid body under a sum of the torques that its fields name by the keys of TERMS.

    Its constants are the coefficients, by the names that their terms give them, and those of every
    body. Under equal damping, a brake, or both, all constant, only the clock of the free motion
    changes: such a motion is known in closed form.
    """

    terms: ClassVar[tuple[str, ...]]
    """The names of the torques that the equations of its full form have."""

    @classmethod
    def rhs(cls, t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        return rates_under(cls.terms, t, y, k)

    @property
    def term_coefficients(self) -> dict[str, tuple[Any, ...]]:
        """The coefficients of each term, numbers or laws."""
        return coefficients_of(vars(self))

    @cached_property
    def constants(self) -> Constants:
        constants: dict[str, Any] = {}
        for term, entries in self.term_coefficients.items():
            for name, entry in zip(TERMS[term].degree, entries, strict=True):
                constants |= law_constants(name, entry)
        return constants | body_constants(self.inertia)

    @property
    def changing_terms(self) -> frozenset[str]:
        """The terms that have a coefficient under a law of time."""
        return frozenset(
            term for term, entries in self.term_coefficients.items() if any(map(is_law, entries))
        )

    @property
    def momentum_at_start(self) -> float:
        """|G| at the start."""
        return float(np.hypot.reduce(self.momentum(self.omega_at_start)))

    def dissipations(self, start: float, end: float) -> tuple[Dissipation, ...]:
        """The torques as the theorems on crossings and tilts take them, at such times between two
        that what excludes a crossing at these excludes it always: one time where they are
        constant. Empty where the theorems do not cover them."""
        times = self.decisive_times(start, end)
        if self.term_coefficients.keys() & NOT_COVERED or any(map(math.isnan, times)):
            return ()
        return tuple(map(self.dissipation_at, times))

    def absorbing_axes(self, start: float, end: float) -> frozenset[int]:
        return axes_never_left(self.dissipations(start, end))

    def tilt_growth(self, t: float) -> np.ndarray | None:
        """By the theorem where it covers the torques, else by the equations alone."""
        if not (dissipations := self.dissipations(t, t)):
            return super().tilt_growth(t)
        omega = self.to_principal(self.omega_at_start)
        # As fast as at the start about each axis in turn, in the sense of the component there.
        rates = tilt_growth_rates(dissipations[0], np.copysign(np.linalg.norm(omega), omega))
        return rates if np.isfinite(rates).any() else None

    def dissipation_at(self, t: float) -> Dissipation:
        """The torques at a time, all of them covered by the theorems."""
        coefficients = self.term_coefficients.items()
        given = {term: tuple(value_at(x, t) for x in entries) for term, entries in coefficients}
        terms = Dissipation(
            self.moments,
            damping=given.get("damping", ZEROS),
            quadratic=given.get("quadratic", ZEROS),
            kappa=given.get("kappa", ZEROS)[0],
            torque=self.to_principal(np.array(given.get("torque", ZEROS))),
        )
        if "resistance" not in given:
            return terms
        I, axes = np.reshape(given["resistance"], (3, 3)), self.principal_axes
        if axes is not None:
            I = axes @ I @ axes.T
            I = np.where(np.abs(I) > TENSOR_ROUNDING * np.abs(I).max(), I, 0)
        damping = tuple((np.array(terms.damping) + np.diag(I) / self.moments).tolist())
        return terms._replace(damping=damping, covered=is_diagonal(I))

    def decisive_times(self, start: float, end: float) -> set[float]:
        """Times between two at which the coefficients that the theorems compare have every order
        that they have there; not a number where no formula tells them."""
        # A brake has no part in the theorems.
        given, changing = self.term_coefficients, self.changing_terms - {"brake"}
        if not changing or start == end:
            return {start}
        across = [x for i, x in enumerate(given.get("resistance", ())) if i % 4]
        is_turned = self.principal_axes is not None and "resistance" in changing
        is_summed = {"damping", "resistance"} <= given.keys()
        if is_turned or is_summed or "torque" in changing or any(map(is_law, across)):
            return {math.nan}
        order, weights = inertia_order(self.moments), axis_weights(self.moments)
        pairs = [(given["kappa"][0], 0.0)] if "kappa" in given else []
        for name in given.keys() & weights.keys():
            entries = given[name][::4] if name == "resistance" else given[name]
            first, _, last = (scaled(entries[i], weights[name][i]) for i in order)
            pairs.append((first, last))
        return {t for pair in pairs for t in times_of_all_signs(*pair, start, end)}

    @property
    def warnings(self) -> list[str]:
        """What no medium has, and torques for which a theory does not hold."""
        # Of what changes with time only the damping is judged, coefficient by coefficient.
        coefficients, changing = self.term_coefficients.items(), self.changing_terms
        given = {term: entries for term, entries in coefficients if term not in changing}
        omega = self.to_principal(self.omega_at_start)
        (kappa,), torque = given.get("kappa", (0.0,)), given.get("torque", ZEROS)
        return [
            *damping_warnings(self.term_coefficients.get("damping", ())),
            *tensor_warnings(np.reshape(given.get("resistance", np.zeros(9)), (3, 3))),
            *weak(self.moments, omega, kappa, torque),
            *cavity_warnings(vars(self).get("cavity"), self.moments, omega),
        ]

    def constant_damping(self, *others: str) -> tuple[float, ...] | None:
        """The rates lambda_i of constant linear damping, where besides it no torques act but those
        of these names; else None."""
        given = self.term_coefficients
        acting = {term for term, entries in given.items() if term in NOT_COVERED or any(entries)}
        damping = given.get("damping", ZEROS)
        is_alone = acting <= {"damping", *others} and not any(map(is_law, damping))
        return damping if is_alone else None

    @property
    def along_momentum(self) -> AlongMomentum | None:
        """The rates of equal damping, a brake, or both, all constant; None for other sums, and
        where a brake has nothing to brake."""
        given = self.term_coefficients
        damping, brake = given.get("damping", (0.0,)), given.get("brake", (0.0,))
        others = given.keys() - {"damping", "brake"} or self.changing_terms
        if others or len(set(damping)) > 1:
            return None
        if "brake" not in given:
            return AlongMomentum(damping[0], np.longdouble(0))
        momentum = np.hypot.reduce(self.momentum(self.omega_at_start.astype(np.longdouble)))
        return AlongMomentum(damping[0], brake[0] / momentum) if momentum else None

    @property
    def has_closed_form(self) -> bool:
        return self.along_momentum is not None

    def exact_states(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        A, omega = self.moments, self.to_principal(self.omega_at_start)
        along = self.along_momentum
        assert along is not None
        if not along.brake:
            state, exponent = scaled_motion(A, omega, along.damping, t)
        else:
            g, s = along.clock(t)
            slowed, exponent = np.frexp(g)
            state = slowed[:, np.newaxis] * free_motion(A, omega, s)
            exponent = np.where(slowed > 0, exponent, -REST_BITS)
        # The variable of a brake: there are no stages of braking here.
        braked = np.zeros((len(t), int("brake" in self.term_coefficients)), dtype=state.dtype)
        return np.hstack((self.from_principal(state), braked)), exponent
