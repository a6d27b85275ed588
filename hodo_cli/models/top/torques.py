"""The torques on a Lagrange top: coefficients that are functions of slow time, and the forms of the
torque that take them."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ...schema.kinds import Choice, Either, Key, ListOf, Number, Variant

LAW = Either(
    ListOf(Number(), alone=True, title="a number, or a polynomial in tau: [a0, a1, ...]"),
    Variant(
        "law",
        {
            "exponential": {
                "value": Key(Number(), "value at tau = 0", "moment of inertia / time"),
                "rate": Key(Number(), "the law is value exp(-rate tau)"),
            },
            "power": {
                "value": Key(Number(), "value at tau = 0", "moment of inertia / time"),
                "rate": Key(Number(least=0), "the law is value (1 + rate tau)^exponent"),
                "exponent": Key(Number(), "the law is value (1 + rate tau)^exponent"),
            },
        },
        "which law",
    ),
)
"""A function of tau: a constant, the coefficients of 1, tau, tau^2, ..., or a law of LAWS with its
parameters."""


def polynomial_law(c: Sequence[Any], tau: Any) -> Any:
    """c0 + c1 tau + c2 tau^2 + ..."""
    total = c[-1]
    for coefficient in c[-2::-1]:
        total = coefficient + tau * total
    return total


def exponential_law(c: Sequence[Any], tau: Any) -> Any:
    """value exp(-rate tau), from (value, rate, e)."""
    # e comes as a constant, because equations know + - * / and ** only, and no exp.
    value, rate, e = c
    return value * e ** (-rate * tau)


def power_law(c: Sequence[Any], tau: Any) -> Any:
    """value (1 + rate tau)^exponent, from (value, rate, exponent)."""
    value, rate, exponent = c
    return value * (1 + rate * tau) ** exponent


LAWS = {"polynomial": polynomial_law, "exponential": exponential_law, "power": power_law}


def law(given: Any) -> tuple[str, tuple[float, ...]]:
    """The name and the numbers of a law as given in a case."""
    if not isinstance(given, Mapping):
        return "polynomial", tuple(given)
    name, *numbers = (given[key] for key in ("law", "value", "rate", "exponent") if key in given)
    return name, (*numbers, math.e) if name == "exponential" else tuple(numbers)


def linear_dissipation(tau: Any, Gz: Any, H: Any, r: Any, u: Any, k: Any) -> tuple[Any, Any]:
    """M = (-a p, -a q, -b r), eq. (3.1)."""
    return -LAWS[k.a_law](k.a, tau), -LAWS[k.b_law](k.b, tau) * r


def cubic_dissipation(tau: Any, Gz: Any, H: Any, r: Any, u: Any, k: Any) -> tuple[Any, Any]:
    """M = |omega|^2 (-a p, -a q, -b r)."""
    f, M3 = linear_dissipation(tau, Gz, H, r, u, k)
    square = (2 * (H - k.mu * u) - k.C * r * r) / k.A + r * r
    return square * f, square * M3


Perturbation = Callable[..., tuple[Any, Any]]

PERTURBATIONS: dict[str, Perturbation] = {
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
