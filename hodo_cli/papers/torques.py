"""Checks of sums of torques against theory: of our own statements, which no paper makes."""

from collections.abc import Sequence

import numpy as np

from ..claims.finding import Check, Finding, beyond
from ..models.rigid_body import BodyFrame
from ..results.motion import Motion

CLOSED_FORM = 1e-11
"""What a tilt may differ by from its closed form, relative to its range."""


@Check
def tilt_of_symmetric_body(motions: Sequence[Motion]) -> Finding:
    """The tilt of G from the axis of a symmetric body, under fluid and equal damping, is ln tan
    tilt = ln tan tilt(0) + kappa (A - C) G(0)^2 (1 - exp(-2 lambda t))/(2 lambda A^3 C)."""
    worst = 0.0
    for m in motions:
        assert isinstance(m.case.system, BodyFrame)
        terms, (A, _, C) = m.case.system.dissipation, m.inertia
        assert terms is not None
        lam, t = terms.damping[0], m.time - m.time[0]
        growth = terms.kappa * (A - C) * m["G"][0] ** 2 / (2 * lam * A**3 * C)
        tangent = np.tan(m["tilt"][0]) * np.exp(-growth * np.expm1(-2 * lam * t))
        apart = np.abs(m["tilt"] - np.arctan(tangent)).max() / np.ptp(m["tilt"])
        worst = max(worst, float(apart))
    words = f"off by {worst:.1e} of its range at the most"
    return Finding(beyond(worst, CLOSED_FORM), worst, words, "another tilt than the formula's")
