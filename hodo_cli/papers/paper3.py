"""Checks for L. D. Akulenko et al., Evolution of motions of a rigid body close to the Lagrange case
under a non-stationary torque (2017).

Equation numbers are the paper's. The time of every motion is tau = epsilon t.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ..claims.finding import (
    Finding,
    Undecidable,
    ValuePair,
    agreement,
    deviation_beyond,
    deviation_unless,
    difference,
    in_groups,
    listed,
)
from ..claims.measures import integrated_motion, number, quantity
from ..integration import distinct
from ..models.base import attributes
from ..models.theory.exact import sn_cn_dn
from ..models.top import mean_cosine
from ..results.motion import Motion

ROOTS = ("u1", "u2", "u3")
INTEGRALS = ("Gz", "H", "r")
HALF_THE_DIGITS = 1e-6
"""The accuracy of (2.5): half the digits are lost where one of its square roots is 0."""


def equation_1_3(motions: Sequence[Motion]) -> Finding:
    """Without perturbation cos theta of the full equations is (1.3), with beta = K(k) for a top
    that is let go at u2, where theta' = 0."""
    pairs = []
    for m in motions:
        (u1, u2, _), alpha, modulus1 = nutation_of_1_3(m)
        _, cn, dn = sn_cn_dn(alpha * (m.time - m.time[0]), modulus1)
        # sn(v + K) = cn v/dn v.
        pairs.append((m.stored("gamma")[:, 2], u1 + (u2 - u1) * (cn / dn) ** 2))
    # sn^2 runs through several periods, which carry the rounding of the roots along.
    return agreement(pairs, 1e-9)


def nutation_of_1_3(m: Motion) -> tuple[np.ndarray, float, float]:
    """The roots u1, u2, u3 (3,) at the start of a motion, and alpha and the complementary modulus
    k' of (1.3)."""
    roots = roots_of_1_5(m, integrals_at_start(m))
    u1, u2, u3 = roots
    alpha = math.sqrt(m.case.data["mu"] * (u3 - u1) / (2 * m.inertia[0]))
    return roots, alpha, math.sqrt((u3 - u2) / (u3 - u1))


def equation_2_7(motions: Sequence[Motion]) -> Finding:
    """The coefficients V_ij of (2.7) are the derivatives of the roots of (1.5) by Gz, H and r."""
    # Much smaller than the distance of two roots, over which their derivatives change.
    step, pairs = 1e-6, []
    for m in motions:
        start = integrals_at_start(m)
        sides = [
            roots_of_1_5(m, start + step * row) - roots_of_1_5(m, start - step * row)
            for row in np.eye(3)
        ]
        pairs.append((np.stack(sides, axis=-1) / (2 * step), coefficients_2_7(m, start)))
    # The relative error of a central difference is about the square of the step over that distance.
    return agreement(pairs, 1e-6)


def integrals_at_start(m: Motion) -> np.ndarray:
    """Gz, H and r (3,) at the start of a motion."""
    return np.array([quantity(m, name)[0] for name in INTEGRALS])


def roots_of_1_5(m: Motion, integrals: np.ndarray) -> np.ndarray:
    """u1, u2, u3 (3,) by (1.5) from Gz, H and r."""
    A, C, mu = m.inertia[0], m.inertia[2], m.case.data["mu"]
    Gz, H, r = integrals
    total = H / mu - C * r**2 / (2 * mu) + C**2 * r**2 / (2 * A * mu)
    product = -H / mu + C * r**2 / (2 * mu) + Gz**2 / (2 * A * mu)
    return np.asarray(np.sort(np.roots([1.0, -total, Gz * C * r / (A * mu) - 1, -product]).real))


def coefficients_2_7(m: Motion, integrals: np.ndarray) -> np.ndarray:
    """V_ij (3, 3) by (2.7) from Gz, H and r."""
    A, C, mu = m.inertia[0], m.inertia[2], m.case.data["mu"]
    Gz, _, r = integrals
    u = roots_of_1_5(m, integrals)
    delta = mu * (u - np.roll(u, -1)) * (u - np.roll(u, -2))
    by_r = C * ((C / A - 1) * r * u**2 - Gz / A * u + r)
    by_integral = np.stack([(Gz - C * r * u) / A, u**2 - 1, by_r], axis=-1)
    return np.asarray(by_integral / delta[:, None])


def ordering(motions: Sequence[Motion]) -> Finding:
    """-1 <= u1 <= u2 <= 1 <= u3 throughout, to rounding; decided by the least of the four
    distances. Down to -0.01 the order holds to plotting accuracy.
    """
    of_motions = ([quantity(m, name) for name in ROOTS] for m in motions)
    least = min(float(np.min([u1 + 1, u2 - u1, 1 - u2, u3 - 1])) for u1, u2, u3 in of_motions)
    return Finding(
        deviation_beyond(-least, 1e-12),
        number=least,
        evidence=f"the least distance is {least:.2g}",
        contradicted_by="a distance below -0.01",
    )


def signs(m: Motion) -> tuple[np.ndarray, np.ndarray]:
    """The signs over time (n,) of R, which is the sign of Gz^2 - C^2 r^2, and of r."""
    Gz, r = quantity(m, "Gz"), quantity(m, "r")
    return np.sign(Gz**2 - (m.inertia[2] * r) ** 2), np.sign(r)


def from_roots(m: Motion, u: Any, sign_R: Any, sign_r: Any) -> tuple[Any, Any, Any]:
    """Gz, H and r by (2.5) from the roots u = (u1, u2, u3) and the signs of `signs`."""
    u1, u2, u3 = u
    A, C, mu = m.inertia[0], m.inertia[2], m.case.data["mu"]
    # Rounding may make the expression under a root negative where it vanishes.
    R = sign_R * np.sqrt(np.maximum((1 - u1**2) * (1 - u2**2) * (u3**2 - 1), 0))
    delta = np.sign(1 + u1 * u2 + u1 * u3 + u2 * u3)
    total, product = u1 + u2 + u3, u1 * u2 * u3
    chi = sign_r * math.sqrt(A * mu)
    Gz = chi * delta * np.sqrt(np.maximum(total + product + R, 0))
    H = mu / 2 * (total * (1 + A / C) + (R - product) * (1 - A / C))
    return Gz, H, chi / C * np.sqrt(np.maximum(total + product - R, 0))


def by_2_5(m: Motion, frozen: bool) -> list[ValuePair]:
    """Gz, H and r of a motion, each with its value by (2.5), with the signs of R and r at each
    moment or, if they are `frozen`, at the start."""
    followed = signs(m)
    in_use = tuple(np.full(len(s), s[0]) for s in followed) if frozen else followed
    values = from_roots(m, [quantity(m, name) for name in ROOTS], *in_use)
    return [(quantity(m, name), value) for name, value in zip(INTEGRALS, values, strict=True)]


def inverse(motions: Sequence[Motion]) -> Finding:
    """(2.5) gives Gz, H and r from u1, u2, u3, with the signs of R and r followed in time."""
    return agreement([pair for m in motions for pair in by_2_5(m, frozen=False)], HALF_THE_DIGITS)


def signs_change(motions: Sequence[Motion]) -> Finding:
    """The signs in (2.5) may change in mid-motion: in every motion R changes sign, where |Gz| = C
    |r|. Until then (2.5) holds with the signs at the start, and after it does not. Decided by the
    first time."""
    before, after = [], []
    for m in motions:
        sign, _ = signs(m)
        until = int(np.argmax(sign != sign[0])) or len(sign)
        pairs = by_2_5(m, frozen=True)
        before.append(difference([(a[:until], b[:until]) for a, b in pairs]))
        after.append(difference(pairs))
    times = [number(m, "rebound_u3") for m in motions]
    words = (
        f"R changes its sign at {listed(times)}; with the signs at the start (2.5) is off by "
        f"{max(before):.1g} until then, and by {listed(after, 1)} after it"
    )
    return Finding(
        deviation_unless(max(before) < HALF_THE_DIGITS < min(after) and max(times) < math.inf),
        number=min(times),
        evidence=words,
        contradicted_by=f"no change of sign, or a difference above {HALF_THE_DIGITS:g} before it",
    )


RUNGE_KUTTA_STEPS = 250
"""Runge-Kutta steps of a motion: their error in r, 3e-8, is far below HALF_THE_DIGITS."""


def r_by_2_5(motions: Sequence[Motion]) -> Finding:
    """r found as in the text agrees with the exact (3.3): (3.5) is integrated, with Gz, H and r by
    (2.5), up to nine tenths of the time at which R changes its sign."""
    pairs = []
    for m in motions:
        end = min(0.9 * number(m, "rebound_u3"), float(m.time[-1]))
        times, r = integrate_3_5(m, end)
        integral = sum(c * times ** (n + 1) / (n + 1) for n, c in enumerate(m.case.data["b"]))
        exact = quantity(m, "r")[0] * np.exp(-integral / m.inertia[2])
        pairs.append((exact, r))
    return agreement(pairs, HALF_THE_DIGITS)


def integrate_3_5(m: Motion, end: float) -> tuple[np.ndarray, np.ndarray]:
    """The times (n,) of the steps of (3.5) closed by (2.5), and r (n,) there, by the classical
    Runge-Kutta method.
    """
    times, h = np.linspace(0, end, RUNGE_KUTTA_STEPS + 1), end / RUNGE_KUTTA_STEPS
    fixed = tuple(s[0] for s in signs(m))
    u = np.array([quantity(m, name)[0] for name in ROOTS])
    r = [from_roots(m, u, *fixed)[2]]
    for t in times[:-1]:
        k1 = rates_3_5(m, t, u, fixed)
        k2 = rates_3_5(m, t + h / 2, u + h / 2 * k1, fixed)
        k3 = rates_3_5(m, t + h / 2, u + h / 2 * k2, fixed)
        k4 = rates_3_5(m, t + h, u + h * k3, fixed)
        u = u + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        r.append(from_roots(m, u, *fixed)[2])
    return times, np.array(r)


def rates_3_5(m: Motion, t: float, u: np.ndarray, fixed: tuple[Any, Any]) -> np.ndarray:
    """du/dtau (3,) by (3.5), with Gz, H and r by (2.5)."""
    A, C, mu = m.inertia[0], m.inertia[2], m.case.data["mu"]
    a, b = (np.polyval(m.case.data[name][::-1], t) for name in "ab")
    Gz, H, r = from_roots(m, u, *fixed)
    s, e = (u[0] + u[1]) / 2, (u[1] - u[0]) / 2
    v = s + e * e * mean_cosine(e, u[2] - s)
    delta = mu * (u - np.roll(u, -1)) * (u - np.roll(u, -2))
    equatorial = (Gz - C * r * u) * (Gz - C * r * v) / A
    equatorial += (u**2 - 1) * (2 * H - C * r**2 - 2 * mu * v)
    return np.asarray(-(a * equatorial + b * r * (Gz - C * r * u) * (v - u)) / (A * delta))


SAMPLES_OF_2_8, PHASES = 20, 500
"""At how many samples of a motion the mean (2.8) is taken, and at how many places of a half turn of
the nutation: the sum is right to rounding where u3 - u2 is at least 1e-3 of u2 - u1."""


def equation_2_8(motions: Sequence[Motion]) -> Finding:
    """The rates of Gz, H and r by the averaged equations are the mean (2.8), over a nutation, of
    the rates under the torques (3.1)."""
    pairs = []
    for m in motions:
        rows = np.linspace(0, len(m.time) - 1, SAMPLES_OF_2_8).astype(int)
        by_mean = np.transpose([mean_rates_2_8(m, i) for i in rows])
        averaged = np.transpose([averaged_rates(m, i) for i in rows])
        pairs += list(zip(by_mean, averaged, strict=True))
    return agreement(pairs, 1e-10)


def mean_rates_2_8(m: Motion, row: int) -> list[float]:
    """dGz/dtau, dH/dtau and dr/dtau at a sample by (2.8): the mean over the time of half a
    nutation, dt ~ dphi/sqrt(u3 - u), u = (u1 + u2)/2 + (u2 - u1)/2 cos phi."""
    A, C, mu, t = m.inertia[0], m.inertia[2], m.case.data["mu"], m.time[row]
    a, b = (np.polyval(m.case.data[name][::-1], t) for name in "ab")
    Gz, H, r, u1, u2, u3 = (quantity(m, name)[row] for name in (*INTEGRALS, *ROOTS))
    # Midpoints with equal weights are the best for an integrand that is even and periodic.
    u = (u1 + u2) / 2 + (u2 - u1) / 2 * np.cos((np.arange(PHASES) + 0.5) * np.pi / PHASES)
    of_Gz, of_H = -a * (Gz - C * r * u) / A - b * r * u, -a * (2 * H - C * r * r - 2 * mu * u) / A
    rates = [of_Gz, of_H - b * r * r, np.full(PHASES, -b * r / C)]
    return [float(np.average(rate, weights=1 / np.sqrt(u3 - u))) for rate in rates]


def averaged_rates(m: Motion, row: int) -> list[float]:
    """dGz/dtau, dH/dtau and dr/dtau at a sample by the equations of the form averaged."""
    k = attributes(m.case.system.constants)
    Gz, H, r, u1, u2 = (float(quantity(m, name)[row]) for name in (*INTEGRALS, *ROOTS[:2]))
    state = Gz - k.C * r, 1 - (2 * H - k.C * r * r) / (2 * k.mu), r, (u2 - u1) / 2
    U, Z, spin, _ = m.case.system.rhs(float(m.time[row]), state, k)
    return [U + k.C * spin, k.C * r * spin - k.mu * Z, spin]


def averaged_alike(motions: Sequence[Motion]) -> Finding:
    """Cases in pairs, by (3.5) and by the equations for Gz, H and r that do not divide by u1 - u2,
    are the same motion."""
    pairs = in_groups(motions, 2)
    # (3.5) loses digits as u1 and u2 meet.
    return agreement([(quantity(a, n), quantity(b, n)) for a, b in pairs for n in INTEGRALS], 1e-9)


def error_of_order_epsilon(motions: Sequence[Motion]) -> Finding:
    """Gz and H of the full equations differ from Gz and H of the averaged equations by the order of
    epsilon. Cases come in fours: first the averaged one, then three in which epsilon falls.

    Decided by the smallest power, which must be at least 0.9.
    """
    powers, words = [], []
    for limit, *near in in_groups(motions, 4):
        epsilons = [m.case.data["epsilon"] for m in near]
        for name in ("Gz", "H"):
            errors = [float(np.abs(quantity(m, name) - quantity(limit, name)).max()) for m in near]
            powers.append(float((np.diff(np.log(errors)) / np.diff(np.log(epsilons))).min()))
            words.append(f"{name} by {listed(errors, 3)}")
    least = min(powers)
    # The second order still bends the power at these epsilons.
    return Finding(
        deviation_unless(least >= 0.9),
        number=least,
        evidence=f"off, for epsilon = {listed(epsilons)}: {'; '.join(words)}: power {least:.3g}",
        contradicted_by="a power below 0.9",
    )


def H_quickly(motions: Sequence[Motion]) -> Finding:
    """H comes within 1 % of -mu, -0.5, sooner in the last case than in the others; decided by the
    time.
    """
    return sooner(motions[::-1], "H", -0.5)


NEAR_LIMIT = 0.01
"""A quantity is near a limit within this fraction of it."""


def sooner(motions: Sequence[Motion], name: str, limit: float, for_good: bool = False) -> Finding:
    """Whether a quantity comes within NEAR_LIMIT of a limit, for the first time or to stay, sooner
    in the first motion than in the others."""
    times, good = [], " for good" if for_good else ""
    for m in motions:
        near = np.abs(quantity(m, name) - limit) <= NEAR_LIMIT * abs(limit)
        # For good: True at samples from which on all are near.
        stays = np.logical_and.accumulate(near[::-1])[::-1] if for_good else near
        times.append(float(m.time[np.argmax(stays)]) if stays.any() else math.inf)
    return Finding(
        deviation_unless(times[0] < min(times[1:])),
        number=times[0],
        evidence=f"within {NEAR_LIMIT:.0%} of {limit:g}{good} at {listed(times)}",
        contradicted_by="an earlier time in another case",
    )


u3_quickly = partial(sooner, name="u3", limit=1.0)
"""u3 comes within 1 % of 1 sooner in the first case than in the others; decided by the time."""

u3_quickly_for_good = partial(sooner, name="u3", limit=1.0, for_good=True)
"""u3 comes within 1 % of 1, and stays there, sooner in the first case than in the others; decided
by the time."""


def roughness(m: Motion) -> float:
    """The largest second derivative of Gz, H, u1, u2, u3, each in units of its range and of the
    time in which it covers 9/10 of that; the samples are evenly spaced."""

    def of_series(values: np.ndarray) -> float:
        samples = np.argmax(np.abs(values - values[0]) >= 0.9 * np.ptp(values))
        return float(np.abs(np.diff(values, 2)).max() * samples**2 / np.ptp(values))

    return max(of_series(quantity(m, name)) for name in ("Gz", "H", *ROOTS))


def smoothing(motions: Sequence[Motion]) -> Finding:
    """Coefficients that grow make the motion smoother; cases in pairs, constant coefficients
    first.
    """
    pairs = [(roughness(a), roughness(b)) for a, b in in_groups(motions, 2)]
    steps = [growing - constant for constant, growing in pairs]
    return Finding(
        deviation_unless(max(steps) < 0),
        number=min(map(abs, steps)),
        evidence=f"roughness {'; '.join(map(listed, pairs))}",
        contradicted_by="a rougher motion with coefficients that grow",
    )


def comes_back(motions: Sequence[Motion], multiple: int) -> Finding:
    """Whether u after a multiple of K(k)/alpha is u again, by the full equations for a top that is
    let go at u2."""
    pairs = []
    for m in motions:
        shift = multiple * half_period(m) * m.case.data["epsilon"]  # in tau = epsilon t
        earlier = m.time[m.time + shift <= m.time[-1]]
        times = distinct([*earlier, *(earlier + shift)])
        if not times.size:
            raise Undecidable(f"{m.words} is shorter than {multiple} K(k)/alpha")
        motion = integrated_motion(replace(m.case, time=m.case.time.listed(times)))
        u = motion.stored("gamma")[:, 2]
        pairs.append(tuple(u[np.searchsorted(times, t)] for t in (earlier, earlier + shift)))
    # The limit covers the rounding of the roots u1, u2, u3, from which K(k)/alpha follows.
    return agreement(pairs, 1e-9)


period_as_printed = partial(comes_back, multiple=1)
"""Without perturbation u = cos theta has the period K(k)/alpha."""

period = partial(comes_back, multiple=2)
"""Without perturbation u = cos theta has the period 2 K(k)/alpha."""


def half_period(m: Motion) -> float:
    """K(k)/alpha by (1.3) at the start of a motion."""
    _, alpha, modulus1 = nutation_of_1_3(m)
    # K by the arithmetic-geometric mean.
    a, b = 1.0, modulus1
    while abs(a - b) > 1e-15:
        a, b = (a + b) / 2, math.sqrt(a * b)
    return float(math.pi / (2 * a * alpha))
