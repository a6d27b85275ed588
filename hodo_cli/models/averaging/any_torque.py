"""The averaged form of any body-frame model, from the equations of its full form alone; see
`QuadratureTurns`. The means over a turn are by the trapezoid, and so are the periodic parts of X
and Y."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from ...schema.kinds import Integer, Key, Mistake
from ..rigid_body import BodyFrame
from .forms import MEAN_START, AveragedTurns, Turn
from .free_turn import (
    LANDEN,
    SMALLEST_M1,
    Body,
    SlowVariables,
    exchanged,
    free_motion_by_phase,
    turn_frequency,
    turn_means,
    turning_body,
)
from .passage import AT_SEPARATRIX, Pair, Region, SeparatrixRates

NEAR_SEPARATRIX, NEARER_SEPARATRIX = 1e-9, 1e-13
"""Two values of 1 - m whose mean rates tell those at the separatrix: both are r0 + r1/K there."""

EVEN_TOL = 1e-9
"""The part of a torque up to which two of its values are equal."""

PHASES_SEEN = 16
"""Phases of a turn at which the size of a torque is looked at, for a warning."""

ROWS_AT_ONCE = 2048
"""Samples whose periodic parts are computed at once: each takes a row of nodes."""

NODES = 128
"""Nodes over a turn. So little time is spent nearer the separatrix than they resolve that a
crossing time is right to 2e-13; `nodes_for` says how many a single rate takes."""

NODES_KEY = Key(
    Integer(least=16, most=1024),
    "nodes of the mean over a turn, a power of two",
    default=NODES,
)

Torque = Callable[[np.ndarray], np.ndarray]
"""The perturbing torque (..., 3) of an angular velocity (..., 3), both along the sorted axes."""

Rhs = Callable[[Any, Sequence[Any], Any], Sequence[Any]]


def nodes_for(m1: float) -> int:
    """The nodes that bring the mean over a turn to 1e-16 for m1 = 1 - m: its error is exp(-pi N
    K'/(2 K))."""
    m1 = min(max(m1, SMALLEST_M1), 1 - SMALLEST_M1)
    K, other = (
        math.pi / 2 / turn_means(1 - x, x, LANDEN).dn for x in (m1, max(1 - m1, SMALLEST_M1))
    )
    # From exp(-pi N K'/(2 K)) = 1e-16, that is N = 23.4 K/K'; whole quarters of a turn, so that the
    # nodes share the symmetry of sn and cn.
    return max(24, 4 * math.ceil(float(23.4 * K / other) / 4))


def rates_over_turn(body: Body, torque: Torque, slow: SlowVariables, nodes: int) -> np.ndarray:
    """X_e' and X_o' (2, ..., nodes) at the phases 2 pi j/nodes of the free motion with these slow
    variables (...)."""
    wide = SlowVariables(*(np.asarray(value)[..., None] for value in slow))
    omega = free_motion_by_phase(body, wide, 2 * np.pi * np.arange(nodes) / nodes)
    p, q, r = np.moveaxis(omega, -1, 0)
    N1, N2, N3 = np.moveaxis(torque(omega), -1, 0)
    a, b, c = body[:3]
    X, Y = 2 * ((a - c) * p * N1 + (b - c) * q * N2), 2 * ((a - b) * q * N2 + (a - c) * r * N3)
    return np.where(wide.side > 0, (X, Y), (Y, X))


def periodic_part(body: Body, torque: Torque, slow: SlowVariables, nodes: int) -> np.ndarray:
    """X_e and X_o (2, ...) less their mean elements, at the phase of the slow variables, for any
    torque.

    They are the integrals, of zero mean, of the rates less their means: a Fourier coefficient of
    the rates, divided by i times its frequency, each.
    """
    mean = turn_means(1 - slow.m1, np.maximum(slow.m1, SMALLEST_M1), LANDEN)
    turning = turn_frequency(body, slow.X_e, slow.side) * mean.dn
    # Without the constant, which averaging keeps, and the last frequency, whose phase the nodes
    # cannot tell.
    k = np.arange(1, nodes // 2)
    wave = np.exp(1j * k * np.asarray(slow.phase)[..., None]) / (
        1j * k * np.asarray(turning)[..., None]
    )
    amplitudes = np.fft.fft(rates_over_turn(body, torque, slow, nodes))[..., 1 : nodes // 2]
    return np.asarray(2 / nodes * (amplitudes * wave).sum(-1).real)


AVERAGED_BY_TURNS = """averaged over the turns of its hodograph.

X' = 2 <(G - A_s omega) . N>,        Y' = 2 <(A_l omega - G) . N>

X = G^2 - 2 T A_s and Y = 2 T A_l - G^2, A_l and A_s the largest and the smallest moment of inertia,
T the kinetic energy, G = A omega (`initial`); N is the torque of the full form, and < > the mean
over a turn of the free motion with these X and Y: a formula, or the mean of `nodes` even steps of
its phase. Assumed: the torque changes X and Y little in a turn. `mean_start` and `at_separatrix`
are explained under "Averaging the turns".

Source of the method: L. D. Akulenko, D. D. Leshchenko, F. L. Chernousko, Izv. AN SSSR MTT 1982
no. 3, 5."""
"""What the averaged form of every model says of itself after its name."""


def quarter_turn(m1: Any, halvings: int) -> list[tuple[Any, Any, Any]]:
    """sn, cn and dn at 0, K/2^halvings, ... K for m1 = 1 - m; with + - * / and ** only."""
    unity = 1 + 0 * m1
    nodes = [(0 * m1, unity, unity), (unity, 0 * m1, m1**0.5)]
    for _ in range(halvings):
        last = len(nodes) - 1
        # Between two nodes u is half of an odd place from 0 to 2 K, which beyond K has a mirror
        # image at a node.
        between = [
            half_argument(*nodes[odd])
            if odd <= last
            else half_of_mirrored(m1, *nodes[2 * last - odd])
            for odd in range(1, 2 * last, 2)
        ]
        nodes = [node for pair in zip(nodes, between, strict=False) for node in pair] + nodes[-1:]
    return nodes


def half_argument(sn: Any, cn: Any, dn: Any) -> tuple[Any, Any, Any]:
    """sn, cn and dn at u/2 from those at u, between 0 and K; nothing cancels.

    Source: M. Abramowitz and I. A. Stegun, 16.18.
    """
    both = cn + dn
    return (
        sn / ((1 + cn) * (1 + dn)) ** 0.5,
        (both / (1 + dn)) ** 0.5,
        (both / (1 + cn)) ** 0.5,
    )


def half_of_mirrored(m1: Any, sn: Any, cn: Any, dn: Any) -> tuple[Any, Any, Any]:
    """The same at (2 K - u)/2 from those at u: 2 K - u has -cn in place of cn."""
    ratio = m1 / (cn + dn)
    return (
        ((1 + cn) / (1 + dn)) ** 0.5,
        sn * (ratio / (1 + dn)) ** 0.5,
        (ratio * (1 + cn)) ** 0.5,
    )


def whole_turn(m1: Any, count: int) -> list[tuple[Any, Any, Any]]:
    """sn, cn and dn at `count` even steps of a turn."""
    up = quarter_turn(m1, round(math.log2(count / 4)))
    down = up[:0:-1]
    return [
        *up[:-1],
        *((sn, -cn, dn) for sn, cn, dn in down),
        *((-sn, -cn, dn) for sn, cn, dn in up[:-1]),
        *((-sn, cn, dn) for sn, cn, dn in down),
    ]


def about_axes(full: Rhs, t: Any, w: Sequence[Any], k: Any, side: Any) -> tuple[Any, ...]:
    """omega' about the enclosed, the middle and the other axis, for omega about these: the torque's
    part, since in `k` the gyroscopic terms have the factor g = 0."""
    body = turning_body(k)
    about, middle, across = w
    about_a, about_c = exchanged(side, about, across)
    sorted_w = about_a, middle, about_c
    rates = full(t, [body.parity * sorted_w[body.order.index(axis)] for axis in range(3)], k)
    return body.enclosed_first(side, [body.parity * rate for rate in rates[:3]])


def torque_of(full: Rhs, t: Any, k: Any) -> Torque:
    """The torque along the sorted axes as `quadrature` takes it, at a time or times (n,)."""
    body = turning_body(k)

    def torque(omega: np.ndarray) -> np.ndarray:
        time = np.asarray(t)[..., None] if np.ndim(t) else t
        rates = full(time, [*np.moveaxis(body.unsort(omega), -1, 0)], k)
        # A rate may be one number for all omega.
        arrays = np.broadcast_arrays(*rates[:3], omega[..., 0])[:3]
        return np.asarray(body.sort(np.stack(arrays, axis=-1)) * np.array(body[:3]))

    return torque


def beside(body: Body, region: Region, root_e: float, m1: float) -> SlowVariables:
    """The slow variables of a motion at 1 - m beside the separatrix, with this sqrt(X_e)."""
    side, sense = region
    w_e, w_o = body.weights(side)
    X_o = (1 - m1) * float(w_e / w_o) * root_e**2
    return SlowVariables(root_e**2, X_o, np.asarray(side), np.asarray(m1), np.asarray(sense), 0.0)


class QuadratureTurns(AveragedTurns):
    """A body-frame model averaged over the turns of its hodograph by quadrature.

    (ln X_e)' and (ln X_o)' are the means over `nodes` even steps of a turn of the exact free
    motion. The full equations are evaluated there with g = 0, which leaves the torque alone. Of the
    equations nothing is known but their numbers: so what the torque does at the separatrix, and
    whether the second order vanishes, is found there by trying.
    """

    full: ClassVar[type[BodyFrame]]
    why_one_by_one = "averages by quadrature are too large to be compiled for many motions"
    # The transverse velocities, e^-600 of the other, add nothing to it, and their own rates are no
    # 0/0.
    steady_offset = 1200.0

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Besides: the nodes are a power of two."""
        yield from super().check(data)
        nodes = data.get("nodes", NODES)
        if nodes & (nodes - 1):
            yield ("nodes",), f"expected a power of two, got {nodes}"

    def constants_of_means(self) -> dict[str, str | tuple[float, ...]]:
        return {"turning_nodes": str(self.nodes)}  # type: ignore[attr-defined]

    @classmethod
    def rates(cls, t: Any, turn: Turn, k: Any) -> Pair:
        """The means over `nodes` even steps of a turn; for symbols too.

        (ln X_e)' = 2 <A_e (a - c) omega_e omega_e' + b w_o omega_m omega_m'>/X_e
        (ln X_o)' = 2 <A_o (a - c) omega_o omega_o' + b w_e omega_m omega_m'>/X_o
        """
        body, side, sense, root_e, root_o, m, _ = turn
        a, b, c = body[:3]
        (w_e, w_o), (A_e, A_o) = body.weights(side), exchanged(side, a, c)
        about, middle, across = A_e * (a - c), b * w_e, A_o * (a - c)
        # omega_e = unit_e sqrt(X_e) dn, and so on. No X_o divides: it may underflow.
        unit_e, unit_m, unit_o = sense / about**0.5, -sense / middle**0.5, 1 / across**0.5
        size_e, size_m, size_o = unit_e * root_e, unit_m * root_o, unit_o * root_o
        e_by_e, e_by_m = about * unit_e, w_o * b * (root_o / root_e) * unit_m
        o_by_o, o_by_m = across * unit_o, middle * unit_m
        sum_e = sum_o = 0
        nodes = whole_turn(1 - m, int(k.turning_nodes))
        for sn, cn, dn in nodes:
            omega = size_e * dn, size_m * sn, size_o * cn
            rate_e, rate_m, rate_o = about_axes(cls.full.rhs, t, omega, k, side)
            sum_e += e_by_e * dn * rate_e + e_by_m * sn * rate_m
            sum_o += o_by_o * cn * rate_o + o_by_m * sn * rate_m
        weight = 2 / len(nodes)
        return weight * sum_e / root_e, weight * sum_o / root_o

    def torque_rate(self, t: Any, turn: Turn, k: Any) -> Any:
        """That of the torque itself at some phases: what has no mean has to be weak too."""
        X_e, X_o = turn.root_e**2, turn.root_o**2
        slow = SlowVariables(X_e, X_o, turn.side, 1 - turn.m, turn.sense, 0 * turn.side)
        rates = rates_over_turn(turning_body(k), torque_of(self.full.rhs, t, k), slow, PHASES_SEEN)
        return np.abs(rates).max(axis=(0, -1)) / (2 * X_e)

    @classmethod
    def rates_beside(cls, t: float, region: Region, roots: Pair, k: Any) -> SeparatrixRates:
        """By the means at two moduli near 1, since the rates are r0 + r1/K there."""
        body, torque, rates = turning_body(k), torque_of(cls.full.rhs, t, k), []
        for m1 in (NEAR_SEPARATRIX, NEARER_SEPARATRIX):
            slow = beside(body, region, roots[0], m1)
            changes = rates_over_turn(body, torque, slow, nodes_for(m1)).mean(-1)
            # <dn> is pi/(2 K)
            inverse = 2 / math.pi * turn_means(1 - m1, m1, LANDEN).dn
            rates.append((*(changes / slow[:2]), inverse))
        (e1, o1, inverse), (e2, o2, nearer) = rates
        by_e, by_o = (e1 - e2) / (inverse - nearer), (o1 - o2) / (inverse - nearer)
        return SeparatrixRates(float(e1 - by_e * inverse), float(by_e), float(by_o))

    @classmethod
    def is_even(cls, t: float, root_x: float, k: Any) -> bool:
        """By trying, at the phases of a turn."""
        body, torque = turning_body(k), torque_of(cls.full.rhs, t, k)
        slow = beside(body, (1, 1), root_x, NEARER_SEPARATRIX)
        omega = free_motion_by_phase(body, slow, np.linspace(0, 2 * np.pi, 17))
        mirror, N = np.array([1.0, -1.0, 1.0]), torque(omega)
        return bool(np.abs(mirror * torque(mirror * omega) - N).max() <= EVEN_TOL * np.abs(N).max())

    @classmethod
    def part(cls, t: Any, slow: SlowVariables, k: Any) -> np.ndarray:
        times, *columns = (np.ravel(value) for value in np.broadcast_arrays(t, *slow))
        parts = np.zeros((2, len(times)))
        for i in range(0, len(times), ROWS_AT_ONCE):
            rows = slice(i, i + ROWS_AT_ONCE)
            some = SlowVariables(*(column[rows] for column in columns))
            torque, squares = torque_of(cls.full.rhs, times[rows], k), np.array(some[:2])
            changes = periodic_part(turning_body(k), torque, some, int(k.turning_nodes))
            np.divide(changes, squares, out=parts[:, rows], where=squares > 0)
        return parts.reshape(2, *np.shape(slow.X_e))

    @property
    def refined_data(self) -> dict[str, Any]:
        # What the nodes miss of a mean, which falls as exp(-c nodes), is seen with twice as many.
        return {"nodes": 2 * self.nodes}  # type: ignore[attr-defined]


@cache
def averaged_form(full: type[BodyFrame], *bases: type[AveragedTurns]) -> type[BodyFrame]:
    """The averaged form of a model that states only its full one: by quadrature, or as the bases
    have it for a sum of torques."""
    attributes_of = {
        "__module__": full.__module__,
        "__doc__": f"{full.__name__} {AVERAGED_BY_TURNS}",
        "__annotations__": {"at_separatrix": str, "nodes": int},
        "full": full,
        "keys": full.keys
        | {"mean_start": MEAN_START, "at_separatrix": AT_SEPARATRIX, "nodes": NODES_KEY},
    }
    classes = *(bases or (QuadratureTurns,)), full
    return dataclass(frozen=True)(type(f"{full.__name__}Averaged", classes, attributes_of))
