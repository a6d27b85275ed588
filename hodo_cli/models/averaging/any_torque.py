"""The averaged form of any body-frame model, from the equations of its full form alone; see
`AnyTorque`."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from ...schema.kinds import Integer, Key, Mistake
from ..base import Constants, Event, EventOutcome, LookedUp
from ..constants import attributes
from ..rigid_body import BodyFrame
from .capture import (
    AT_SEPARATRIX,
    FREE,
    REGIONS,
    STOP,
    Arrival,
    Region,
    SeparatrixRates,
    drift_by_region,
    pass_separatrix,
)
from .damped import logarithmic_offset
from .forms import (
    EDGE,
    MEAN_START,
    AveragedTurns,
    distance_to_edge,
    either,
    stored_elements,
    turning_constants,
    with_part,
)
from .free_turn import (
    LANDEN,
    Body,
    SlowVariables,
    free_motion_by_phase,
    slow_elements,
    turn_frequency,
    turning_body,
)
from .means import NODES, Torque, mean_rates, nodes_for, periodic_part, turn_means

STEADY = 1200.0
"""By how much ln X_o is below ln X_e for an exact rotation about the enclosed axis: the transverse
velocities, e^-600 of the other, then add nothing to it, and their own rates are no 0/0."""

NEAR, NEARER = 1e-9, 1e-13
"""Two values of 1 - m whose mean rates tell those at the separatrix: both are r0 + r1/K there."""

SAME_DRIFT = 1e-9
"""The difference, relative to the larger, up to which two drifts are equal."""

AT_ONCE = 2048
"""Samples whose periodic parts are computed at once: each takes a row of nodes."""

NODES_KEY = Key(
    Integer(least=16, most=1024),
    "nodes of the mean over a turn, a power of two",
    default=NODES,
)

Rhs = Callable[[Any, Sequence[Any], Any], Sequence[Any]]
PeriodicPart = Callable[[Any, SlowVariables, SimpleNamespace], tuple[np.ndarray, np.ndarray]]


def quarter_turn(m1: Any, halvings: int) -> list[tuple[Any, Any, Any]]:
    """sn, cn and dn at 0, K/2^halvings, ... K for m1 = 1 - m; with + - * / and ** only.

    By half arguments from those at K, in forms without a difference. Source: M. Abramowitz and I.
    A. Stegun, 16.18.
    """
    unity = 1 + 0 * m1
    nodes = [(0 * m1, unity, unity), (unity, 0 * m1, m1**0.5)]
    for _ in range(halvings):
        last = len(nodes) - 1
        between = []
        for i in range(last):
            # Half of an odd place, which is known; beyond K by its mirror image, where cn < 0.
            odd = 2 * i + 1
            sn, cn, dn = nodes[min(odd, 2 * last - odd)]
            if odd <= last:
                both = cn + dn
                half = (
                    sn / ((1 + cn) * (1 + dn)) ** 0.5,
                    (both / (1 + dn)) ** 0.5,
                    (both / (1 + cn)) ** 0.5,
                )
            else:
                ratio = m1 / (cn + dn)
                half = (
                    ((1 + cn) / (1 + dn)) ** 0.5,
                    sn * (ratio / (1 + dn)) ** 0.5,
                    (ratio * (1 + cn)) ** 0.5,
                )
            between.append(half)
        nodes = [node for pair in zip(nodes, between, strict=False) for node in pair] + nodes[-1:]
    return nodes


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


def averaged_rates(full: Rhs, t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
    """The averaged equations: the mean of (ln X_e)' and (ln X_o)' over the nodes of a turn."""
    ln_e, ln_o, _, side, sense = y
    body = turning_body(k)
    a, b, c = body[:3]
    m = k.turning_e ** (ln_o - ln_e - side * k.turning_offset)
    w_e, w_o = either(side, a - b, b - c), either(side, b - c, a - b)
    outer, inner = either(side, a, c), either(side, c, a)
    root_e, root_o = k.turning_e ** (ln_e / 2), k.turning_e ** (ln_o / 2)
    about, middle = (outer * (a - c)) ** 0.5, (b * w_e) ** 0.5
    across = (inner * (a - c)) ** 0.5
    sum_e = sum_o = 0
    turn = whole_turn(1 - m, int(k.turning_nodes))
    for sn, cn, dn in turn:
        w = sense * root_e / about * dn, -sense * root_o / middle * sn, root_o / across * cn
        rate = about_axes(full, t, w, k, side)
        sum_e += sense * (about * dn * rate[0] - w_o * b / middle * root_o / root_e * sn * rate[1])
        sum_o += across * cn * rate[2] - sense * middle * sn * rate[1]
    n = either(side, a - b, b - c) ** 0.5 / (a * b * c) ** 0.5 * root_e
    pace = turn_means(m, 1 - m).pace
    weight = 2 / len(turn)
    rates = weight * sum_e / root_e, weight * sum_o / root_o
    return *rates, k.turning_scale * n * pace, 0 * side, 0 * sense


def about_axes(full: Rhs, t: Any, w: Sequence[Any], k: Any, side: Any) -> tuple[Any, ...]:
    """The torque's part of omega' about the enclosed, the middle and the other axis, for omega
    about these."""
    body = turning_body(k)
    about, middle, across = w
    sorted_w = either(side, about, across), middle, either(side, across, about)
    components: list[Any] = [0, 0, 0]
    for axis, component in zip(body.order, sorted_w, strict=True):
        components[axis] = body.parity * component
    rates = full(t, components, k)
    p, q, r = (body.parity * rates[axis] for axis in body.order)
    return either(side, p, r), q, either(side, r, p)


def torque_of(full: Rhs, t: Any, k: Any) -> Torque:
    """The torque along the sorted axes as `quadrature` takes it, at a time or times (n,)."""
    body = turning_body(k)

    def torque(omega: np.ndarray) -> np.ndarray:
        time = np.asarray(t)[..., None] if np.ndim(t) else t
        rates = full(time, [*np.moveaxis(body.unsort(omega), -1, 0)], k)
        spread = np.stack(np.broadcast_arrays(*rates, omega[..., 0])[:3], axis=-1)
        return np.asarray(body.sort(spread) * np.array(body[:3]))

    return torque


def band_of(body: Body, torque: Torque, region: Region, X_e: float) -> SeparatrixRates:
    """The mean rates beside the separatrix, where X_e is given: by the means at two moduli."""
    side, sense = region
    w_e, w_o = body.weight(side)
    rates = []
    for m1 in (NEAR, NEARER):
        X_o = (1 - m1) * float(w_e / w_o) * X_e
        X, Y = (X_e, X_o) if side > 0 else (X_o, X_e)
        slow = SlowVariables(X, Y, np.asarray(side), np.asarray(m1), np.asarray(sense), 0.0)
        dX, dY = mean_rates(body, torque, slow, nodes_for(m1))
        dX_e, dX_o = (dX, dY) if side > 0 else (dY, dX)
        # <dn> is pi/(2 K)
        rates.append((dX_e / X_e, dX_o / X_o, 2 / math.pi * turn_means(1 - m1, m1, LANDEN).pace))
    (e1, o1, inverse), (e2, o2, nearer) = rates
    by_e, by_o = (e1 - e2) / (inverse - nearer), (o1 - o2) / (inverse - nearer)
    return SeparatrixRates(float(e1 - by_e * inverse), float(by_e), float(by_o))


def is_even(body: Body, torque: Torque, slow: SlowVariables) -> bool:
    """Whether R N(R omega) = N(omega), R = diag(1, -1, 1), on a motion: then the second order of
    averaging vanishes, and the phase at the separatrix is known."""
    omega = free_motion_by_phase(body, slow, np.linspace(0, 2 * np.pi, 17))
    mirror = np.array([1.0, -1.0, 1.0])
    N = torque(omega)
    return bool(np.abs(mirror * torque(mirror * omega) - N).max() <= SAME_DRIFT * np.abs(N).max())


def in_doubles(k: SimpleNamespace) -> SimpleNamespace:
    """The constants of a form with their numbers as Python's own."""

    def plain(value: Any) -> Any:
        if isinstance(value, str):
            return value
        return tuple(map(float, value)) if isinstance(value, tuple) else float(value)

    return SimpleNamespace(**{name: plain(value) for name, value in vars(k).items()})


def through_with_torque(full: Rhs, t: Any, y: Sequence[Any], k: SimpleNamespace) -> EventOutcome:
    """The passage under any torque; unless that drives D alike in all regions it is a matter of
    chance."""
    ln_e, ln_o, scaled_phase = y[:3]
    side, sense = (1 if value > 0 else -1 for value in y[3:])
    numbers = in_doubles(k)
    body, torque = turning_body(numbers), torque_of(full, float(t), numbers)
    X_e, X_o = math.exp(float(ln_e)), math.exp(float(ln_o))
    bands = {
        region: band_of(body, torque, region, X_e if region[0] == side else X_o)
        for region in REGIONS
    }
    branch, predictable = k.turning_branch, False
    if drives_alike(drift_by_region(bands)):
        X, Y = (X_e, X_o) if side > 0 else (X_o, X_e)
        slow = SlowVariables(X, Y, np.asarray(side), np.asarray(NEARER), np.asarray(sense), 0.0)
        branch, predictable = FREE, k.turning_mean == "yes" and is_even(body, torque, slow)
    arrival = Arrival(
        t,
        (side, sense),
        float(ln_e - ln_o + side * k.turning_offset),
        (math.sqrt(X_e), math.sqrt(X_o)),
        scaled_phase / k.turning_scale,
    )
    # The bands are right to NEAR, and on the way to the separatrix they change by EDGE only.
    view = SimpleNamespace(**turning_constants(body))
    departure = pass_separatrix(view, arrival, lambda _: bands, branch, predictable)
    pair = (
        ln + change
        for ln, change in zip(departure.in_order((ln_e, ln_o)), departure.changes, strict=True)
    )
    return departure.outcome(y, (*pair, k.turning_scale * departure.phase, *departure.region))


def drives_alike(drift: Mapping[Region, float]) -> bool:
    """Whether D drifts by the same in both senses of rotation on either side."""
    most = max(map(abs, drift.values()))
    return all(abs(drift[side, 1] - drift[side, -1]) <= SAME_DRIFT * most for side in (1, -1))


def slow_of(y: np.ndarray, k: SimpleNamespace) -> SlowVariables:
    """The slow variables of states (n, 5)."""
    ln_e, ln_o, scaled_phase, side, sense = y.T
    X_e, X_o = np.exp(ln_e), np.exp(ln_o)
    X, Y = np.where(side > 0, (X_e, X_o), (X_o, X_e))
    m1 = np.maximum(-np.expm1(ln_o - ln_e - side * k.turning_offset), EDGE / 2)
    return SlowVariables(X, Y, side, m1, sense, scaled_phase / k.turning_scale)


def mean_elements(y: Sequence[Any], k: SimpleNamespace) -> dict[str, np.ndarray]:
    """The stored variables of one state without their periodic part."""
    ln_e, ln_o, _, side, _ = (np.array(float(value)) for value in y)
    view = SimpleNamespace(**turning_constants(turning_body(in_doubles(k))))
    return stored_elements(view, np.array(1.0), np.exp(ln_o - ln_e), side, np.exp(ln_e / 2))


def stored_with_part(
    part: PeriodicPart, t: np.ndarray, y: np.ndarray, k: SimpleNamespace
) -> dict[str, np.ndarray]:
    """The stored variables, with the periodic part unless the case has named a branch."""
    body = turning_body(k)
    ln_e, ln_o, _, side, _ = (column.astype(float) for column in y.T)
    X_e, X_o, unit = np.ones_like(ln_e), np.exp(ln_o - ln_e), np.exp(ln_e / 2)
    if k.turning_mean == "yes" and k.turning_branch == STOP:
        numbers, slow = in_doubles(k), slow_of(y.astype(float), k)
        part_e, part_o = np.empty((2, len(t)))
        for i in range(0, len(t), AT_ONCE):
            rows = slice(i, i + AT_ONCE)
            slow_rows = SlowVariables(*(column[rows] for column in slow))
            with np.errstate(all="ignore"):  # nothing turns any more
                part_e[rows], part_o[rows] = part(t[rows], slow_rows, numbers)
        turning = slow.m1 > EDGE / 2
        turns = turn_frequency(body, unit * unit, side) / float(k.turning_scale)
        X_e, X_o = (
            with_part(v, part * turning, turns) for v, part in ((X_e, part_e), (X_o, part_o))
        )
    return stored_elements(SimpleNamespace(**turning_constants(body)), X_e, X_o, side, unit)


def part_by_quadrature(
    full: Rhs, t: Any, slow: SlowVariables, k: SimpleNamespace
) -> tuple[np.ndarray, np.ndarray]:
    """(X_e - mean X_e)/X_e and (X_o - mean X_o)/X_o (n,) of slow variables (n,) at times t; 0 where
    X_o is 0."""
    X, Y = periodic_part(turning_body(k), torque_of(full, t, k), slow, int(k.turning_nodes))
    X_e, X_o = slow.pair
    part_e, part_o = np.where(slow.side > 0, (X, Y), (Y, X))
    return part_e / X_e, np.divide(part_o, X_o, out=np.zeros_like(part_o), where=X_o > 0)


@dataclass(frozen=True)
class AnyTorque(AveragedTurns, LookedUp):
    """A body-frame model averaged over the turns of its hodograph by quadrature.

    (ln X_e)' and (ln X_o)' are the means over `nodes` even steps of a turn of the exact free
    motion. The full equations are evaluated there with g = 0, which leaves the torque alone. Of the
    equations nothing is known but their numbers: so what the torque does at the separatrix, and
    whether the second order vanishes, is found there by trying.
    """

    full: ClassVar[type[BodyFrame]]

    state = ("ln_e", "ln_o", "scaled_phase", "side", "sense")
    batchable = False

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        yield from super().check(data)
        nodes = data.get("nodes", NODES)
        if nodes & (nodes - 1):
            yield ("nodes",), f"expected a power of two, got {nodes}"

    @cached_property
    def equations(self) -> dict[str, Any]:
        """The constants of the equations, but for the unit of slow time."""
        body = self.body
        turning = {
            "turning_axes": "".join(map(str, body.order)),
            "turning_nodes": str(self.nodes),  # type: ignore[attr-defined]
            "turning_mean": self.mean_start,
            "turning_branch": self.at_separatrix,  # type: ignore[attr-defined]
            "turning_e": math.e,
            "turning_offset": logarithmic_offset(body),
        }
        constants = {**super().constants, "g": 0.0, **turning}
        # Those of the full form have been kept under the name of ours.
        vars(self).pop("constants")
        return constants

    @cached_property
    def constants(self) -> Constants:
        slow, still = slow_elements(self.body, self.velocity(self.inertia, self.initial)), 0.0
        y = [*logarithms(slow), still, slow.side, slow.sense]
        k = attributes(self.equations | {"turning_scale": 1.0})
        # How fast the torque changes amplitudes at the start; 1 if it does not.
        pace = max(abs(float(x)) for x in self.rhs(0.0, y, k)[:2]) / 2
        # heyoka counts parameters up to the last that the equations use: that has to come last.
        return self.equations | {"turning_scale": min(pace or 1.0, 1.0)}

    def periodic_start(self, slow: SlowVariables) -> tuple[np.ndarray, np.ndarray]:
        part: PeriodicPart = type(self).__dict__["part"].__func__
        return part(0.0, slow, attributes(self.equations))

    def states(self, slow: SlowVariables) -> np.ndarray:
        scaled_phase = self.constants["turning_scale"] * slow.phase
        return np.stack((*logarithms(slow), scaled_phase, slow.side + 0.0, slow.sense + 0.0))

    def smallness(self, y: np.ndarray) -> np.ndarray:
        k = attributes(self.constants)
        by_e, by_o, turning, _, _ = self.rhs(0.0, [*y.T], k)
        # turning is scale n <dn>, and K is pi/(2 <dn>)
        # Of amplitudes, whose squares X_e and X_o are.
        fastest = np.maximum(np.abs(by_e), np.abs(by_o)) / 2
        return np.asarray(fastest * np.pi / 2 * k.turning_scale / np.abs(turning))

    @property
    def refined_data(self) -> dict[str, Any]:
        # What the nodes miss of a mean, which falls as exp(-c nodes), is seen with twice as many.
        return {"nodes": 2 * int(self.equations["turning_nodes"])}

    @property
    def run_events(self) -> tuple[Event, ...]:
        if len(set(self.inertia)) < 3:
            return self.averaged_events
        passage = type(self).__dict__["passage"].__func__
        return (
            *self.averaged_events,
            Event("separatrix", distance_to_edge, terminal=True, passage=passage),
        )


def logarithms(slow: SlowVariables) -> tuple[Any, Any]:
    """ln X_e and ln X_o; of an exact rotation about the enclosed axis, STEADY apart."""
    X_e, X_o = slow.pair
    with np.errstate(divide="ignore"):
        ln_e, ln_o = np.log(X_e), np.log(X_o)
    return ln_e, np.where(X_o > 0, ln_o, ln_e - STEADY)


@cache
def averaged_form(
    full: type[BodyFrame], rates: Rhs | None = None, part: PeriodicPart | None = None
) -> type[BodyFrame]:
    """The averaged form of a model that states only its full one: by quadrature, or by the rates of
    the same state and the periodic part where these are known."""
    part = part or partial(part_by_quadrature, full.rhs)
    attributes_of = {
        "__module__": full.__module__,
        "__doc__": f"{full.__name__} averaged over the turns of its hodograph.",
        "__annotations__": {"at_separatrix": str, "nodes": int},
        "form": "averaged",
        "full": full,
        "keys": full.keys
        | {"mean_start": MEAN_START, "at_separatrix": AT_SEPARATRIX, "nodes": NODES_KEY},
        "rhs": staticmethod(rates or partial(averaged_rates, full.rhs)),
        "part": staticmethod(part),
        "output": staticmethod(partial(stored_with_part, part)),
        "passage": staticmethod(partial(through_with_torque, full.rhs)),
    }
    averaged = type(f"{full.__name__}Averaged", (AnyTorque, full), attributes_of)
    return dataclass(frozen=True)(averaged)
