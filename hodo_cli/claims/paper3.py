"""Checks for L. D. Akulenko et al., Evolution of motions of a rigid body close to the Lagrange case under a non-stationary
torque (2017).

Equation numbers are the paper's. The time of every motion is tau = epsilon t.
"""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from ..results.motion import Motion
from .finding import Finding, Pair, agreement, beyond, if_true, listed
from .paper import check
from .quantities import integrate, series
from .variations import changed


@check
def ordering(motions: Sequence[Motion]) -> Finding:
    """-1 <= u1 <= u2 <= 1 <= u3 throughout, to rounding; decided by the least of the four distances."""
    least = np.inf
    for m in motions:
        u1, u2, u3 = (series(m, name) for name in ("u1", "u2", "u3"))
        least = min(least, float(np.min([u1 + 1, u2 - u1, 1 - u2, u3 - 1])))
    return Finding(beyond(-least, 1e-12), least, f"the least distance is {least:.2g}")


def from_roots(m: Motion, frozen: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gz, H and r from u1, u2, u3 by (2.5).

    The signs of R and delta are those at the start, or follow sign(Gz^2 - C^2 r^2) and sign(1 + u1u2 + u1u3 + u2u3).
    chi has the sign of r.
    """
    Gz, r, u1, u2, u3 = (series(m, name) for name in ("Gz", "r", "u1", "u2", "u3"))
    A, C, mu = m.inertia[0], m.inertia[2], m.case.data["mu"]
    sign = np.sign(Gz**2 - (C * r) ** 2)
    delta = np.sign(1 + u1 * u2 + u1 * u3 + u2 * u3)
    sign, delta = (np.full(len(u1), s[0]) if frozen else s for s in (sign, delta))
    R = sign * np.sqrt(np.maximum((1 - u1**2) * (1 - u2**2) * (u3**2 - 1), 0))
    total, product = u1 + u2 + u3, u1 * u2 * u3
    chi = np.sign(r) * np.sqrt(A * mu)
    Gz = chi * delta * np.sqrt(np.maximum(total + product + R, 0))
    H = mu / 2 * (total * (1 + A / C) + (R - product) * (1 - A / C))
    return Gz, H, chi / C * np.sqrt(np.maximum(total + product - R, 0))


def by_2_5(m: Motion, frozen: bool) -> list[Pair]:
    """Gz, H and r of a motion, each beside its value by (2.5)."""
    return [
        (series(m, name), values)
        for name, values in zip(("Gz", "H", "r"), from_roots(m, frozen), strict=True)
    ]


@check
def inverse(motions: Sequence[Motion]) -> Finding:
    """(2.5) gives Gz, H and r from u1, u2, u3, with the signs of R and delta followed in time.

    Half the digits are lost where a square root of (2.5) is 0.
    """
    return agreement([pair for m in motions for pair in by_2_5(m, frozen=False)], 1e-6)


@check
def inverse_with_initial_signs(motions: Sequence[Motion]) -> Finding:
    """The same with the signs of R and delta at the start."""
    return agreement([pair for m in motions for pair in by_2_5(m, frozen=True)], 1e-6)


@check
def equation_3_3(motions: Sequence[Motion]) -> Finding:
    """r from u1, u2, u3 by (2.5) is r by (3.3)."""
    return agreement([(from_roots(m, frozen=False)[2], r_by_3_3(m)) for m in motions], 1e-6)


def r_by_3_3(m: Motion) -> np.ndarray:
    """r by (3.3) with (3.4)."""
    integral = sum(c * m.time ** (n + 1) / (n + 1) for n, c in enumerate(m.case.data["b"]))
    return np.asarray(series(m, "r")[0] * np.exp(-integral / m.inertia[2]))


@check
def error_of_order_epsilon(motions: Sequence[Motion]) -> Finding:
    """Gz and H of the full equations tend to those of the averaged ones as epsilon; cases in pairs, averaged first.

    Decided by the smallest power, which must be 0.9 of 1 at least.
    """
    epsilons = (0.02, 0.005, 0.00125)
    powers, words = [], []
    for limit, full in zip(motions[::2], motions[1::2], strict=True):
        time = {"time": asdict(limit.case.time)}
        near = [integrate(changed(full.case, time | {"epsilon": epsilon})) for epsilon in epsilons]
        for name in ("Gz", "H"):
            errors = [float(np.abs(series(m, name) - series(limit, name)).max()) for m in near]
            powers.append(float((np.diff(np.log(errors)) / np.diff(np.log(epsilons))).min()))
            words.append(f"{name} {', '.join(f'{error:.3g}' for error in errors)}")
    least = min(powers)
    return Finding(if_true(least >= 0.9), least, f"power {least:.3g}: {'; '.join(words)}")


def roughness(m: Motion) -> float:
    """The largest second derivative of Gz, H, u1, u2, u3, in units of the range and of the time for 9/10 of it."""

    def one(values: np.ndarray) -> float:
        way = np.abs(values - values[0])
        span = m.time[np.argmax(way >= 0.9 * np.ptp(values))] - m.time[0]
        return float(
            np.abs(np.diff(values, 2)).max()
            * (span / (m.time[1] - m.time[0])) ** 2
            / np.ptp(values)
        )

    return max(one(series(m, name)) for name in ("Gz", "H", "u1", "u2", "u3"))


@check
def smoothing(motions: Sequence[Motion]) -> Finding:
    """Coefficients that grow make the motion smoother; cases in pairs, constant coefficients first."""
    values = [roughness(m) for m in motions]
    pairs = [*zip(values[::2], values[1::2], strict=True)]
    steps = [growing - constant for constant, growing in pairs]
    words = f"roughness {'; '.join(listed(pair) for pair in pairs)}"
    return Finding(if_true(max(steps) < 0), min(map(abs, steps)), words)
