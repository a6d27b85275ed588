"""What the averaged forms share: what they store, when they apply, how they pass the separatrix.

Their state is (e, o, scaled_phase, side), or (..., sense) where that counts: two measures of X_e
and X_o; the phase in units of the slow time, so that it is of the size of the others; the side and
the sense of rotation, +1 or -1, which only a passage changes.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...schema.kinds import Choice, Key, Mistake
from ..base import Label
from ..rigid_body import BodyFrame, is_tensor
from .free_turn import Body, SlowVariables, slow_elements
from .passage import shape_distance

EDGE = 1e-10
"""The u at which a motion is taken through the separatrix by formula: their error is of the size of
its square, far below a double's last digit, and so much of u is left that 1 - m as a difference
costs them nothing."""

LARGE_RATIO = 0.1
"""Where averaging's small parameter is no longer small: errors are of some per cent from there
on."""

MEAN_START = Key(
    Choice("yes", "no"),
    "start from mean elements, and store the periodic part with them; no: the first order of"
    " the literature",
    default="yes",
)

STORED = {
    "kinetic_energy": Label(("time",), "kinetic energy T", "moment of inertia / time^2"),
    "momentum": Label(("time",), "|G|", "moment of inertia / time"),
    "J": Label(("time",), "G^2/2T", "moment of inertia"),
    "k2": Label(("time",), "k^2 of the turns: 0 at an axis, 1 at the separatrix"),
    "enclosed_axis": Label(("time",), "axis that the averaged hodograph encloses"),
}


def stored_elements(
    k: Any, X_e: Any, X_o: Any, side: Any, unit: Any = 1.0
) -> dict[str, np.ndarray]:
    """The variables of STORED from X_e and X_o in units of unit**2 and the side, each (n,).

    k has a, b, c and the body axes `largest` and `smallest`. The unit may be below the smallest
    double: J and k^2 do not know it.
    """
    a, b, c, above = k.a, k.b, k.c, side > 0
    X, Y = np.where(above, X_e, X_o), np.where(above, X_o, X_e)
    double_energy, square = (X + Y) / (a - c), (a * X + c * Y) / (a - c)
    outer, inner = (a - b) * X, (b - c) * Y
    most = np.maximum(outer, inner)
    return {
        "kinetic_energy": double_energy * unit * unit / 2,
        "momentum": np.sqrt(square) * unit,
        "J": np.divide(square, double_energy, out=np.full_like(square, np.nan), where=square > 0),
        "k2": np.divide(np.minimum(outer, inner), most, out=np.zeros_like(most), where=most > 0),
        "enclosed_axis": np.where(above, k.largest, k.smallest).astype(np.int8),
    }


def with_part(mean: Any, part: Any, turns: Any) -> Any:
    """Mean elements with their relative periodic part, by exp, so that they stay positive.

    Where the motion does not turn faster than it decays there is no part to speak of, and its
    formula would divide rounding by n. `turns` (n,) is n in units of the rate of decay.
    """
    return mean * np.exp(np.where((turns > 1) & (np.abs(part) < 1), part, 0))


def distance_to_edge(t: Any, y: Sequence[Any], k: Any) -> Any:
    """u less EDGE, of states with ln X_e, ln X_o and, fourth, the side that the motion is on: a
    signed u would change sides in one step."""
    return y[0] - y[1] + y[3] * k.turning_offset - EDGE


def left_and_entered(k: Any, before: int, after: int) -> dict[str, float]:
    """The body axes of the sides that a passage leaves and enters; 0 if it enters none."""
    named = {1: float(k.largest), -1: float(k.smallest), 0: 0.0}
    return {"from": named[before], "to": named[after]}


def turning_constants(body: Body) -> dict[str, float]:
    """The constants that every averaged form has: the body, and n/sqrt(X_e) on either side."""
    volume = body.a * body.b * body.c
    return {
        "a": body.a,
        "b": body.b,
        "c": body.c,
        "largest": body.order[0] + 1.0,
        "smallest": body.order[2] + 1.0,
        "turns_a": math.sqrt((body.a - body.b) / volume),
        "turns_c": math.sqrt((body.b - body.c) / volume),
    }


def either(side: Any, above: Any, below: Any) -> Any:
    """`above` on side +1, `below` on side -1; for symbols too."""
    # A choice would not pass through an engine's symbols; the side is +1 or -1 to the last digit.
    # Both weights are then 0 or 1. A mean and half a difference would lose the smaller of two
    # ratios that are each other's inverse, as of a nearly symmetric body.
    return (1 + side) / 2 * above + (1 - side) / 2 * below


@dataclass(frozen=True)
class AveragedTurns(BodyFrame):
    """A body-frame model averaged over the turns of its hodograph; see `free_turn` for its
    variables."""

    mean_start: str

    form = "averaged"
    variables = STORED
    degree = {}
    # Its equations are of high powers of the moments, in the case's own units.
    smallest, fastest = 1e-30, 1e4
    no_axis_reason = "averaged over the hodograph's turns: run stores its axis and its passages"
    class_events = ()

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
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
        with np.errstate(all="ignore"):  # of numbers out of range, which are told next
            slow = slow_elements(Body.of(data["inertia"]), omega)
        if any(omega) and not 0 < max(slow.pair) < math.inf:
            yield ("initial",), "the square of the start is beyond the range of doubles"
        elif not max(slow.pair) or slow.m1 < 2 * EDGE:
            yield (
                ("initial",),
                "nothing turns at rest, nor on the separatrix or beside it: take form full",
            )

    @property
    def body(self) -> Body:
        """The body with its axes sorted."""
        return Body.of(self.inertia)

    def periodic_start(self, slow: SlowVariables) -> tuple[np.ndarray, np.ndarray]:
        """The periodic parts (...) of X_e and X_o relative to them, at starts (...)."""
        raise NotImplementedError

    def states(self, slow: SlowVariables) -> np.ndarray:
        """The states (m, ...) with these slow variables (...)."""
        raise NotImplementedError

    def elements(self, omega: Any) -> tuple[SlowVariables, np.ndarray]:
        """The slow variables (...) that motions with angular velocities (..., 3) start from, and
        whether these have their mean elements."""
        slow = slow_elements(self.body, omega)
        if self.mean_start == "no":
            return slow, np.ones_like(slow.X, dtype=bool)
        return shifted(self.body, slow, self.periodic_start(slow))

    def starts(self, omega: np.ndarray) -> np.ndarray:
        slow, _ = self.elements(omega)
        # A start on the separatrix does not turn; `check` says so of a case.
        return np.where(slow.m1 < 2 * EDGE, np.nan, self.states(slow))

    @property
    def start(self) -> tuple[float, ...]:
        return tuple(self.starts(np.array(super().start)).tolist())

    @property
    def extended_start(self) -> np.ndarray:
        slow, _ = self.elements(np.array(super().start))
        y = np.array(self.start, dtype=np.longdouble)
        # Elsewhere u is of the size of the state, and has its digits.
        near = slow.m1 < 0.5 and min(slow.pair) > 0
        return self.at_distance(y, np.longdouble(slow.m1)) if near else y

    def at_distance(self, y: np.ndarray, m1: Any) -> np.ndarray:
        """A state with ln X_e, ln X_o and, fourth, the side, at m1 = 1 - m beside the separatrix,
        whose digits the difference of two logarithms does not keep."""
        u = -np.log1p(-m1)
        return np.array([y[0], y[0] + y[3] * self.constants["turning_offset"] - u, *y[2:]])

    @property
    def warnings(self) -> list[str]:
        if self.elements(super().start)[1]:
            return super().warnings
        near = "the start is so near the separatrix that it is taken for its own mean element"
        return [*super().warnings, near]

    def smallness(self, y: np.ndarray) -> np.ndarray:
        """Averaging's parameter at states (n, 4): the perturbation's rate in quarter turns K/n."""
        raise NotImplementedError

    def validity_warnings(self, t: np.ndarray, y: np.ndarray, tol: float) -> list[str]:
        with np.errstate(all="ignore"):  # where nothing turns any more the ratio is infinite
            ratio = self.smallness(y)
        large = np.flatnonzero(~(ratio <= LARGE_RATIO))
        if not len(large):
            return []
        return [
            "averaging needs a perturbation slow beside the turns: its rate times K/n is "
            f"{ratio[0]:.2g} at the start, and above {LARGE_RATIO:g} from t = {t[large[0]]:.6g} on"
        ]


def shifted(
    body: Body, slow: SlowVariables, part: tuple[np.ndarray, np.ndarray]
) -> tuple[SlowVariables, np.ndarray]:
    """Slow variables (...) with the periodic parts of X_e and X_o, relative to them, taken off, and
    where that was done.

    It is no correction any more where it takes the motion halfway to the separatrix.
    """
    X_e, X_o = (value * (1 - share) for value, share in zip(slow.pair, part, strict=True))
    w_e, w_o = body.weight(slow.side)
    with np.errstate(all="ignore"):  # of what is not turning there is no mean
        m1 = 1 - w_o * X_o / (w_e * X_e)
        # Halfway: nearer, the mean element would hang on terms that the first order leaves
        # out.
        right = (X_e >= 0) & (X_o >= 0) & (m1 > 0)
        right &= shape_distance(m1) >= shape_distance(slow.m1) / 2
    X, Y = np.where(slow.side > 0, (X_e, X_o), (X_o, X_e))
    mean = slow._replace(X=X, Y=Y, m1=m1)
    chosen = (np.where(right, new, old) for new, old in zip(mean, slow, strict=True))
    return SlowVariables(*chosen), right
