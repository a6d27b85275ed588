"""The torques on a Lagrange top, whose coefficients are functions of slow time."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

from ...schema.kinds import Choice, Either, Key, ListOf, Number
from ..terms.laws import coefficient_at, law_mapping

LAW = Either(
    ListOf(Number(), alone=True, title="a number, or a polynomial in tau: [a0, a1, ...]"),
    law_mapping("moment of inertia / time", "tau"),
)
"""A coefficient of resistance as a function of tau."""


def axial_torque(tau: Any, r: Any, k: Any, factor: Any = 1) -> Any:
    """M3 = m - b r, with a factor of the resistance; where a case gives no m it is 0."""
    resistance = -coefficient_at(k, "b", tau) * r * factor
    return resistance + coefficient_at(k, "m", tau) if hasattr(k, "m") else resistance


def with_mu(k: Any, tau: Any) -> Any:
    """The constants of a top with mu as it is at tau."""
    changes = hasattr(k, "mu_law")
    return SimpleNamespace(**vars(k) | {"mu": coefficient_at(k, "mu", tau)}) if changes else k


def linear_dissipation(tau: Any, Gz: Any, H: Any, r: Any, u: Any, k: Any) -> tuple[Any, Any]:
    """M = (-a p, -a q, m - b r); eq. (3.1) where m = 0."""
    return -coefficient_at(k, "a", tau), axial_torque(tau, r, k)


def cubic_dissipation(tau: Any, Gz: Any, H: Any, r: Any, u: Any, k: Any) -> tuple[Any, Any]:
    """M = |omega|^2 (-a p, -a q, -b r) + (0, 0, m)."""
    square = (2 * (H - k.mu * u) - k.C * r * r) / k.A + r * r
    return -square * coefficient_at(k, "a", tau), axial_torque(tau, r, k, square)


PERTURBATIONS: Mapping[str, Callable[..., tuple[Any, Any]]] = {
    "linear-dissipation": linear_dissipation,
    "cubic-dissipation": cubic_dissipation,
}
"""Torques epsilon (p f, q f, M3), eq. (2.3): each returns (f, M3), both functions of tau, Gz, H, r
and u = cos theta.

To add one, write it with + - * / and ** and name it here; the forms averaged-quadrature and full
take it.
"""

PERTURBATION = Key(
    Choice(*PERTURBATIONS), "form of the torque M = (p f, q f, M3)", default="linear-dissipation"
)
