"""A rigid body under a sum of torques: what follows from the coefficients that its case gives."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...text import grouped, time_text
from ..base import CONSTANTS_FIELD, REST_BITS, Constants
from ..rigid_body import BodyFrame, body_constants, is_tensor
from ..theory.closed_form import AlongMomentum, free_motion, scaled_motion
from ..theory.dissipation import Dissipation, axes_never_left, tilt_growth_rates
from ..theory.principal_axes import excess_of_rounding, is_diagonal
from .time_laws import (
    CaseConstants,
    first_negative,
    is_law,
    law_constants,
    named_constants,
    resolved,
    scaled,
)
from .torques import TERMS, cavity_warnings, coefficient, rates_under, weak

TENSOR_ROUNDING = 1e-13
"""The part of the largest entry of a tensor below which one is the rounding of a change of axes."""

ZEROS = (0.0, 0.0, 0.0)

RESISTING = ("damping", "quadratic", "kappa", "brake")
"""The terms of which negative coefficients drive the body."""

PLACES = 4097
"""The times at which coefficients are looked at for negative values."""

NOT_COVERED = frozenset({"rotor", "space_torque", "expression"})
"""The terms of which the theorems on crossings and tilts say nothing."""


def terms_named(data: Mapping[str, Any]) -> tuple[str, ...]:
    """The terms that a case names, in the order of TERMS."""
    given = {"kappa" if name == "cavity" else name for name, x in data.items() if x is not None}
    return tuple(name for name in TERMS if name in given)


def coefficients_of(
    data: Mapping[str, Any], constants: CaseConstants
) -> dict[str, tuple[Any, ...]]:
    """The coefficients of each term that a case names, numbers or laws, in the order of the term's
    constants; those of `torque` times epsilon."""
    if data.get("cavity") is not None:
        data = {**data, "kappa": coefficient(data["cavity"])}
    named = {name: TERMS[name].coefficients(data[name]) for name in terms_named(data)}
    given = {name: tuple(resolved(x, constants) for x in values) for name, values in named.items()}
    if "torque" in given:
        given["torque"] = tuple(scaled(x, data.get("epsilon", 1.0)) for x in given["torque"])
    return given


def rounding_warnings(inertia: Any) -> list[str]:
    """The warning of moments of which one exceeds the sum of the others as rounding makes it."""
    excess = 0.0 if is_tensor(inertia) else excess_of_rounding(inertia)
    says = f"one moment exceeds the sum of the other two by {excess:.3g}, as rounding may make it"
    return [says] if excess else []


def damping_warnings(damping: Sequence[Any]) -> list[str]:
    """Warnings of coefficients that no medium has; of laws nothing is said here."""
    negative = ", ".join(
        f"lambda{i} = {x:g}" for i, x in enumerate(damping, 1) if not is_law(x) and x < 0
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
        return coefficients_of(vars(self), vars(self).get(CONSTANTS_FIELD, ()))

    @cached_property
    def constants(self) -> Constants:
        constants: dict[str, Any] = {}
        for term, entries in self.term_coefficients.items():
            for name, entry in zip(TERMS[term].degree, entries, strict=True):
                constants |= law_constants(name, entry)
        names = named_constants(vars(self).get(CONSTANTS_FIELD, ())) if self.has_expressions else {}
        return constants | body_constants(self.inertia) | names

    @property
    def changing_terms(self) -> frozenset[str]:
        """The terms that have a coefficient under a law of time."""
        return frozenset(
            term for term, entries in self.term_coefficients.items() if any(map(is_law, entries))
        )

    @property
    def has_expressions(self) -> bool:
        """Whether its equations hold expressions, which may name constants of the case."""
        return bool(self.changing_terms) or "expression" in self.terms

    @property
    def momentum_at_start(self) -> float:
        """|G| at the start."""
        return float(np.hypot.reduce(self.momentum(self.omega_at_start)))

    def dissipations(self, start: float, end: float) -> tuple[Dissipation, ...]:
        """The torques as the theorems on crossings and tilts take them; empty where they are not
        constant, or not covered. A brake has no part in them."""
        given = self.term_coefficients
        if not NOT_COVERED.isdisjoint(given) or self.changing_terms - {"brake"}:
            return ()
        terms = Dissipation(
            self.moments,
            damping=given.get("damping", ZEROS),
            quadratic=given.get("quadratic", ZEROS),
            kappa=given.get("kappa", ZEROS)[0],
            torque=self.to_principal(np.array(given.get("torque", ZEROS))),
        )
        if "resistance" not in given:
            return (terms,)
        I, axes = np.reshape(given["resistance"], (3, 3)), self.principal_axes
        if axes is not None:
            I = axes @ I @ axes.T
            I = np.where(np.abs(I) > TENSOR_ROUNDING * np.abs(I).max(), I, 0)
        damping = tuple((np.array(terms.damping) + np.diag(I) / self.moments).tolist())
        return (terms._replace(damping=damping, covered=is_diagonal(I)),)

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

    def warnings_within(self, start: float, end: float) -> list[str]:
        """Which coefficients under a law of time are negative, and from when on."""
        times, constants = np.linspace(start, end, PLACES), vars(self).get(CONSTANTS_FIELD, ())
        laws = ((k, x) for k, c in self.term_coefficients.items() for x in c if is_law(x))
        first = [(k, first_negative(x, times, constants)) for k, x in laws if k in RESISTING]
        return [
            f"{term} is negative from t = {time_text(min(when), start)} on: it drives the body"
            for term, when in grouped((k, t) for k, t in first if t is not None).items()
        ]

    @property
    def warnings(self) -> list[str]:
        """What no medium has, and torques for which a theory does not hold."""
        # Of what changes with time only the damping is judged, coefficient by coefficient.
        coefficients, changing = self.term_coefficients.items(), self.changing_terms
        given = {term: entries for term, entries in coefficients if term not in changing}
        omega = self.to_principal(self.omega_at_start)
        (kappa,), torque = given.get("kappa", (0.0,)), given.get("torque", ZEROS)
        return [
            *rounding_warnings(vars(self)["inertia"]),
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
