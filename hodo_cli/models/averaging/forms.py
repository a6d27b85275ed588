"""The averaged forms: their state and its equations, what they store, when they apply, how they
pass the separatrix. What the torque does over a turn is a method of each form."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...arithmetic import exp
from ...schema.kinds import Key, Mistake, Switch
from ..base import (
    Constants,
    Event,
    EventOutcome,
    Label,
    attributes,
    contains_time,
    structure,
)
from ..rigid_body import BodyFrame, is_tensor, share_of
from .free_turn import (
    Body,
    Means,
    SlowVariables,
    either,
    exchanged,
    shape_distance,
    slow_elements,
    turn_means,
    turning_body,
)
from .passage import (
    EDGE_U,
    REGIONS,
    STOP,
    Arrival,
    Pair,
    RatesByRegion,
    Region,
    SeparatrixRates,
    pass_separatrix,
    sorted_roots,
)

LARGE_RATIO = 0.1
"""Where averaging's small parameter is no longer small: errors are of some per cent from there
on."""

EQUAL_MOMENTS_OFFSET = 1e4
"""The size of ln((a - b)/(b - c)) for two equal moments: there m is 0, and one side is missing."""

MEAN_START = Key(
    Switch("yes", "no"),
    "start from mean elements, and store the periodic part with them; no: the first order of"
    " the literature",
    default=True,
)

STORED = {
    "kinetic_energy": Label(("time",), "kinetic energy T", "moment of inertia / time^2"),
    "momentum": Label(("time",), "|G|", "moment of inertia / time"),
    "J": Label(("time",), "G^2/2T", "moment of inertia"),
    "k2": Label(("time",), "k^2 of the turns: 0 at an axis, 1 at the separatrix"),
    "enclosed_axis": Label(("time",), "axis that the averaged hodograph encloses"),
}


class Turn(NamedTuple):
    """A turn of the free motion: the body, its side and sense, sqrt(X_e) and sqrt(X_o), and m with
    the means over the turn."""

    body: Body
    side: Any
    sense: Any
    root_e: Any
    root_o: Any
    m: Any
    mean: Means

    @classmethod
    def of(cls, y: Sequence[Any], k: Any) -> "Turn":
        """The turn in a state."""
        ln_e, ln_o, _, side, sense = y
        # The state holds logarithms: X_e and X_o themselves would be 0 long before the shape of
        # the motion is lost.
        m = exp(ln_o - ln_e - side * k.turning_offset)
        roots = exp(ln_e / 2), exp(ln_o / 2)
        return cls(turning_body(k), side, sense, *roots, m, turn_means(m, 1 - m))

    def frequency(self, k: Any) -> Any:
        """n."""
        return either(self.side, *k.turning_n) * self.root_e


def stored_elements(body: Body, squares: Any, side: Any, unit: Any) -> dict[str, np.ndarray]:
    """The variables of STORED from X_e and X_o (2, n) in units of unit**2 and the side (n,).

    The unit may be below the smallest double: J and k^2 do not know it.
    """
    a, b, c = body[:3]
    X, Y = exchanged(side, *squares)
    double_energy, square = (X + Y) / (a - c), (a * X + c * Y) / (a - c)
    outer, inner = (a - b) * X, (b - c) * Y
    return {
        "kinetic_energy": double_energy * unit * unit / 2,
        "momentum": np.sqrt(square) * unit,
        "J": share_of(double_energy, square, of_nothing=np.nan),
        "k2": share_of(np.maximum(outer, inner), np.minimum(outer, inner)),
        "enclosed_axis": body.label(side).astype(np.int8),
    }


def squares_and_unit(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """X_e and X_o (2, n) of states (n, 5) in units of X_e, and its root (n,): the shape has its
    digits where X_e itself is below the smallest double."""
    ln_e, ln_o = y.T[:2]
    return np.array((np.ones_like(ln_e), np.exp(ln_o - ln_e))), np.exp(ln_e / 2)


def mean_elements(y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
    """The stored variables of states (n, 5) without their periodic part."""
    squares, unit = squares_and_unit(y)
    return stored_elements(turning_body(k), squares, y.T[3], unit)


def slow_of(y: np.ndarray, k: Any) -> SlowVariables:
    """The slow variables of states (n, 5)."""
    ln_e, ln_o, scaled_phase, side, sense = y.T
    u = ln_e - ln_o + side * k.turning_offset
    # A motion that has stopped at the separatrix is beside it by EDGE_U.
    m1 = np.maximum(-np.expm1(-u), EDGE_U / 2)
    phase = scaled_phase / k.turning_scale
    return SlowVariables(np.exp(ln_e), np.exp(ln_o), side, m1, sense, phase)


def distance_to_edge(t: Any, y: Sequence[Any], k: Any) -> Any:
    """u less `edge_of` the body, as an event: a signed u would change sides in one step."""
    return y[0] - y[1] + y[3] * k.turning_offset - k.turning_edge


def logarithmic_offset(body: Body) -> float:
    """ln((a - b)/(b - c)), in u = side * offset + ln X_e - ln X_o."""
    outer, inner = body.a - body.b, body.b - body.c
    if outer and inner:
        return math.log(outer / inner)
    return EQUAL_MOMENTS_OFFSET if outer else -EQUAL_MOMENTS_OFFSET


def edge_of(body: Body) -> float:
    """The u at which motions are taken through the separatrix: EDGE_U, or more of a nearly
    symmetric body. A torque takes that through both sides in so short a time that the coefficients
    of a series would overflow; and one ulp in its moments changes u by more than this."""
    outer, inner = sorted((body.a - body.b, body.b - body.c))
    return EDGE_U * max(1.0, 1e-4 * math.sqrt(inner / outer)) if outer else EDGE_U


@dataclass(frozen=True)
class AveragedTurns(BodyFrame):
    """A body-frame model averaged over the turns of its hodograph; see `free_turn` for its
    variables.

    The state is ln X_e, ln X_o, turning_scale * phi, the side and the sense: it has its digits
    however far the motion has decayed, at both axes and at the separatrix. The scale makes the
    phase of the size of the others. Only a passage changes the side and the sense, +1 or -1.
    """

    mean_start: str

    form = "averaged"
    variables = STORED
    degree = {}
    state = ("ln_e", "ln_o", "scaled_phase", "side", "sense")
    # Its equations are of high powers of the moments, in the case's own units.
    smallest = 1e-30
    steady_offset: ClassVar[float] = 1e4
    """By how much ln X_o is below ln X_e for an exact rotation about the enclosed axis: it stays
    one, and X_o is 0 beside X_e."""
    no_axis_reason = "averaged over the hodograph's turns: run stores its axis and its passages"
    class_events = ()

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        """Besides: a mean start is that of time 0, which a torque tells from any other time if it
        changes with the time."""
        yield from super().check_span(data, start, end)
        if start and data["mean_start"] and (full := getattr(cls, "full", None)):
            system = full.of({name: data[name] for name in full.keys if name in data})
            if contains_time(type(system), structure(system.constants)):
                yield (
                    ("mean_start",),
                    "is that of time 0, and the torque changes with time: take time.start 0, "
                    "or mean_start: no",
                )

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Besides: the start is one that turns, away from the separatrix."""
        yield from super().check(data)
        if not {"inertia", "initial"} <= set(data) or is_tensor(data["inertia"]):
            return
        if len(set(data["inertia"])) == 1:
            yield ("inertia",), "with three equal moments nothing turns; form full does not average"
            return
        try:
            omega = cls.velocity(data["inertia"], data["initial"])
        except ValueError:  # said by the check above
            return
        body = Body.of(data["inertia"])
        with np.errstate(all="ignore"):  # of numbers out of range, which are told next
            slow = slow_elements(body, omega)
        if any(omega) and not 0 < max(slow[:2]) < math.inf:
            yield ("initial",), "the square of the start is beyond the range of doubles"
        elif slow.m1 < 2 * edge_of(body):
            yield (
                ("initial",),
                "averaging is undefined at rest and on the separatrix or very near it: take form "
                "full",
            )

    # What the torque does over a turn; the first is the mean of (ln X_e)' and (ln X_o)', for
    # symbols too.

    @classmethod
    def rates(cls, t: Any, turn: Turn, k: Any) -> Pair:
        """<(ln X_e)'> and <(ln X_o)'>."""
        raise NotImplementedError

    @classmethod
    def separatrix_rates(cls, t: float, roots: Pair, k: Any) -> RatesByRegion:
        """The mean rates beside the separatrix in all regions, at these sqrt(X) and sqrt(Y)."""
        return {region: cls.rates_beside(t, region, roots[:: region[0]], k) for region in REGIONS}

    @classmethod
    def rates_beside(cls, t: float, region: Region, roots: Pair, k: Any) -> SeparatrixRates:
        """The mean rates beside the separatrix in a region, at these sqrt(X_e) and sqrt(X_o)."""
        raise NotImplementedError

    @classmethod
    def is_even(cls, t: float, root_x: float, k: Any) -> bool:
        """Whether R N(R omega) = N(omega), R = diag(1, -1, 1), beside the separatrix, at this
        sqrt(X): then the second order of averaging vanishes, and the phase there is known."""
        raise NotImplementedError

    @classmethod
    def part(cls, t: Any, slow: SlowVariables, k: Any) -> np.ndarray:
        """The periodic parts of X_e and X_o (2, ...) relative to them, at slow variables and times
        (...); 0 where X_o is 0."""
        raise NotImplementedError

    def constants_of_means(self) -> dict[str, str | tuple[float, ...]]:
        """The constants that `rates` has besides those of the full form."""
        return {}

    def torque_rate(self, t: Any, turn: Turn, k: Any) -> Any:
        """How fast the torque changes amplitudes, whose squares X_e and X_o are."""
        by_e, by_o = self.rates(t, turn, k)
        return np.maximum(np.abs(by_e), np.abs(by_o)) / 2

    @classmethod
    def rhs(cls, t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """The mean rates, and that of the phase, n <dn>; side and sense stay."""
        turn = Turn.of(y, k)
        turning = k.turning_scale * turn.frequency(k) * turn.mean.dn
        return *cls.rates(t, turn, k), turning, 0 * turn.side, 0 * turn.sense

    @classmethod
    def output(cls, t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        """The mean elements, with their periodic part where they are to have one; see `Model`."""
        (squares, unit), side = squares_and_unit(y), y.T[3]
        # A capture by chance forgets the phase.
        if k.turning_mean == "yes" and k.turning_branch == STOP:
            slow, numbers = slow_of(y.astype(float), k), attributes(vars(k), np.float64)
            with np.errstate(all="ignore"):  # nothing turns any more
                part = cls.part(t, slow, numbers)
            # Where the motion does not turn faster than it decays there is no part to speak of, and
            # its formula would divide rounding by n; nor where it has stopped at the separatrix.
            n = either(side, *k.turning_n) * unit
            turns = (n > k.turning_rate) & (slow.m1 > EDGE_U / 2)
            # Not by exp: X_e and X_o change together by parts that keep |G| under a fluid.
            squares *= 1 + np.where(turns & (np.abs(part) < 1), part, 0)
        return stored_elements(turning_body(k), squares, side, unit)

    @cached_property
    def slow_start(self) -> SlowVariables:
        """The slow variables of the start as it is given."""
        return slow_elements(self.body, self.omega_at_start)

    @cached_property
    def constants(self) -> Constants:
        """Those of the full form, with g = 0, and those of the turns."""
        body, slow = self.body, self.slow_start
        a, b, c = body[:3]
        constants = {
            **super().constants,
            "g": 0.0,
            "turning_axes": "".join(map(str, body.order)),
            "turning_mean": "yes" if self.mean_start else "no",
            "turning_branch": getattr(self, "at_separatrix", STOP),
            "turning_offset": logarithmic_offset(body),
            "turning_edge": edge_of(body),
            "turning_n": (math.sqrt((a - b) / (a * b * c)), math.sqrt((b - c) / (a * b * c))),
            **self.constants_of_means(),
        }
        k = attributes(constants)
        turn = Turn.of([*map(float, (*self.logarithms(slow), 0.0, slow.side, slow.sense))], k)
        rate, n = float(self.torque_rate(0.0, turn, k)), float(turn.frequency(k))
        return constants | {"turning_rate": rate, "turning_scale": rate / n or 1.0}

    @cached_property
    def body(self) -> Body:
        """The body with its axes sorted."""
        return Body.of(self.inertia)

    @cached_property
    def numbers(self) -> Any:
        """The constants as attributes."""
        return attributes(self.constants)

    def elements(self, slow: SlowVariables) -> tuple[SlowVariables, np.ndarray]:
        """The slow variables (...) that motions start from, and whether these have their mean
        elements."""
        if not self.mean_start:
            return slow, np.ones_like(slow.X_e, dtype=bool)
        return shifted(self.body, slow, self.part(0.0, slow, self.numbers))

    def starts(self, omega: np.ndarray) -> np.ndarray:
        (slow, _), k = self.elements(slow_elements(self.body, omega)), self.numbers
        scaled_phase = k.turning_scale * slow.phase
        y = np.stack([*self.logarithms(slow), scaled_phase, slow.side + 0.0, slow.sense + 0.0])
        # A start on the separatrix does not turn; `check` says so of a case.
        return np.where(slow.m1 < 2 * k.turning_edge, np.nan, y)

    @property
    def start(self) -> tuple[float, ...]:
        return tuple(self.starts(self.omega_at_start).tolist())

    @classmethod
    @np.errstate(divide="ignore", invalid="ignore")
    def logarithms(cls, slow: SlowVariables) -> Pair:
        """ln X_e and ln X_o: `steady_offset` apart in an exact rotation about the enclosed axis."""
        ln_e, ln_o = np.log(slow.X_e), np.log(slow.X_o)
        return ln_e, np.where(slow.X_o > 0, ln_o, ln_e - cls.steady_offset)

    @property
    def extended_start(self) -> np.ndarray:
        slow, _ = self.elements(self.slow_start)
        y = np.array(self.start, dtype=np.longdouble)
        if slow.m1 < 0.5 and min(slow[:2]) > 0:
            # Beside the separatrix the difference of two logarithms does not keep the digits of m1;
            # elsewhere u is of the size of the state.
            u = -np.log1p(-np.longdouble(slow.m1))
            y[1] = y[0] + y[3] * logarithmic_offset(self.body) - u
        return y

    @property
    def warnings(self) -> list[str]:
        if self.elements(self.slow_start)[1]:
            return super().warnings
        return [
            *super().warnings,
            "the start is so near the separatrix that it is taken for its own mean element",
        ]

    @np.errstate(all="ignore")  # where nothing turns any more the ratio is infinite
    def smallness(self, t: Any, y: np.ndarray) -> np.ndarray:
        """Averaging's parameter at times (n,) and states (n, 5): the perturbation's rate in
        quarter turns K/n."""
        k = self.numbers
        turn = Turn.of([*y.T], k)
        # K is pi/(2 <dn>)
        rate = self.torque_rate(t, turn, k)
        return np.asarray(rate * np.pi / 2 / (turn.frequency(k) * turn.mean.dn))

    def validity_warnings(self, t: np.ndarray, y: np.ndarray, tol: float) -> list[str]:
        ratio = self.smallness(t, y)
        large = np.flatnonzero(~(ratio <= LARGE_RATIO))
        if not len(large):
            return []
        return [
            "averaging needs a perturbation slow beside the turns: its rate times K/n is "
            f"{ratio[0]:.2g} at t = {t[0]:.6g}, "
            f"and above {LARGE_RATIO:g} from t = {t[large[0]]:.6g} on"
        ]

    @property
    def run_events(self) -> tuple[Event, ...]:
        """Those of the full form's terms, and the passage of a body that has a separatrix."""
        if self.body.is_symmetric:
            return self.averaged_events
        event = Event("separatrix", distance_to_edge, terminal=True, passage=self.passage)
        return *self.averaged_events, event

    @classmethod
    def passage(cls, t: Any, y: Sequence[Any], k: Any) -> EventOutcome:
        """The passage through the separatrix; unless the torque drives D alike in all regions it is
        a matter of chance."""
        ln_e, ln_o, scaled_phase = y[:3]
        side, sense = (1 if value > 0 else -1 for value in y[3:])
        u = float(ln_e - ln_o + side * k.turning_offset)
        arrival = Arrival(t, (side, sense), u, (ln_e, ln_o), scaled_phase / k.turning_scale)
        time, numbers = float(t), k if isinstance(t, float) else attributes(vars(k))
        root_x, _ = sorted_roots(arrival.logarithms, side)
        is_even = k.turning_mean == "yes" and cls.is_even(time, root_x, numbers)
        rates_at = partial(cls.separatrix_rates, time, k=numbers)
        outcome = pass_separatrix(numbers, arrival, rates_at, is_even)
        ln_e, ln_o, phase, *region = outcome.state
        others = (0 * scaled_phase + x for x in (k.turning_scale * phase, *region))
        return outcome._replace(state=[ln_e, ln_o, *others])


@np.errstate(all="ignore")  # of what is not turning there is no mean
def shifted(body: Body, slow: SlowVariables, part: np.ndarray) -> tuple[SlowVariables, np.ndarray]:
    """Slow variables (...) with the periodic parts of X_e and X_o, relative to them, taken off, and
    where that was done.

    It is no correction any more where it takes the motion halfway to the separatrix.
    """
    X_e, X_o = (value * (1 - share) for value, share in zip(slow[:2], part, strict=True))
    w_e, w_o = body.weights(slow.side)
    m1 = 1 - w_o * X_o / (w_e * X_e)
    # Halfway: nearer, the mean element would hang on terms that the first order leaves
    # out.
    right = (X_e >= 0) & (X_o >= 0) & (m1 > 0)
    right &= shape_distance(m1) >= shape_distance(slow.m1) / 2
    mean = slow._replace(X_e=X_e, X_o=X_o, m1=m1)
    chosen = (np.where(right, new, old) for new, old in zip(mean, slow, strict=True))
    return SlowVariables(*chosen), right
