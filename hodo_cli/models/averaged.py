"""Weak resistance, averaged over the turns of the free motion to first order, as a quadrature.

Moments a >= b >= c. D > 0 is a turn about axis a (side 1), D < 0 about axis c (side -1); e is that
axis and o the other outer one. With

    X = a(a-c) p^2 + b(b-c) q^2,    Y = b(a-b) q^2 + c(a-c) r^2,    X_a = X,  X_c = Y,
    G^2 = (a X + c Y)/(a-c),    2T = (X + Y)/(a-c),    v = |ln [(a-b) X/((b-c) Y)]|,    m = e^-v

p, q and r are sn, cn and dn of the modulus k^2 = m, and v = 0 is the separatrix. The mean rates of
v, ln X_e and ln X_o depend on m alone, so that v' = f(v) is solved by t = int dv/f, and the
logarithms are int rate dv/f.

The integrals run over z in the place of v. One zero of f at most, a fixed point, lies between 0 and
infinity; v(z) takes the whole line to the interval between two zeros. Each end is then reached
exponentially: all integrands are smooth, and at the ends they are straight. At the separatrix
f ~ 1/K(m) is 0 too, and yet t is finite there: the motion goes on, on the other side, with X_e and
X_o exchanged. No step, event or engine has a part in it.

Source: L. D. Akulenko, D. D. Leshchenko, F. L. Chernousko, Izv. AN SSSR MTT 1982 no. 3, 5.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from ..schema.kinds import Mistake
from .base import TO_FIRST_ORDER, EventOutcome, Label, attributes, mistake_of
from .rigid_body import inertia_order, separatrix_terms
from .terms.body import BodyUnderTorques

Rates = Callable[[int, Any], tuple[Any, Any, Any]]
"""v', (ln X_e)' and (ln X_o)' on a side at v."""

SEPARATRIX_Z, SLOW_Z = 40.0, 690.0
"""How far z goes to a separatrix, where e^-40 is less than rounding, and to one that is never
reached."""

AXIS_Z = 80.0
"""How far z goes to an axis: e^-40 beside the smallest difference of two moments."""

FIXED_POINT_Z = 30.0
"""How far z goes to a fixed point: nearer to it f is rounding."""

NEAREST = math.exp(-SEPARATRIX_Z)
"""The v at which a motion leaves the separatrix."""

NODES, REFERENCE_NODES = 20, 26
"""The points of a panel of z: the integrands are analytic where |Im z| < pi/2, so that each term of
their series is 6 times as small as the one before. The second number is that of long doubles."""

LARGE_RATIO = 0.1
"""Where resistance is no longer weak: the errors of averaging are some per cent from there on."""

NEWTON_STEPS = 5
"""Enough to find a time in a panel, within which dt/dz changes by a factor of e at most."""

NOTHING_TURNS = (
    "form averaged needs a turn to average: not at rest, not on the separatrix (D = 0), no "
    "rotation about an axis of symmetry, no three equal moments"
)


def turn_means(v: Any) -> tuple[Any, Any, Any, Any]:
    """m, 1 - m, S = <sn^2> over a turn, and (S - 1/2)/m, at v (...): by the arithmetic-geometric
    mean, as sums of positive terms, in which nothing cancels."""
    m, m1 = np.exp(-v), -np.expm1(-v)
    root = np.sqrt(m1)
    a, b, c = (1 + root) / 2, np.sqrt(root), m / (2 + 2 * root)
    term = total = 1 / (2 + 2 * root) ** 2
    while np.any(term > 1e-20 * total):
        a, b = (a + b) / 2, np.sqrt(a * b)
        term, c = term * c * c / (8 * a * a), c * c / (4 * a)
        total = total + term
    return m, m1, 0.5 + m * total, total


class Start(NamedTuple):
    """Side, v, and ln X_e and ln X_o (2,) at a start."""

    side: int
    v: Any
    logs: np.ndarray

    @classmethod
    @np.errstate(all="ignore")
    def of(cls, inertia: Any, omega: Any) -> "Start":
        """In long double, and v from D itself: the difference of two logarithms has lost its
        digits. Raises ValueError where nothing turns."""
        A, w = (np.array(x, dtype=np.longdouble) for x in (inertia, omega))
        order, size = inertia_order(A), np.abs(w).max()
        (a, b, c), w = A[[*order]], w / size
        p, q, r = w[[*order]] ** 2
        outer, inner = separatrix_terms(A, w, order)
        side, D = (1 if outer > inner else -1), np.abs(outer - inner)
        X, Y = a * (a - c) * p + b * (b - c) * q, b * (a - b) * q + c * (a - c) * r
        v = np.log1p((a - c) * D / ((b - c) * Y if side > 0 else (a - b) * X))
        if not v > 0:
            raise ValueError(NOTHING_TURNS)
        return cls(side, v, np.maximum(np.log([X, Y][::side]) + 2 * np.log(size), -1e4))


@cache
def chebyshev_fit(n: int, fp: type) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """n points of -1..1; what makes of values there the coefficients of a series; and of its
    integral from -1."""
    angle = (np.arange(n, dtype=fp) + fp(0.5)) * np.arccos(fp(-1)) / n
    weights = np.where(np.arange(n), 2, 1)[:, None] / fp(n)
    fit = np.cos(np.outer(np.arange(n), angle)) * weights
    return np.cos(angle), fit, np.polynomial.chebyshev.chebint(fit, lbnd=-1)


def interval(rates: Rates, side: int, v: Any) -> tuple[float, float]:
    """The two zeros of f between which v lies."""
    grid = np.log1p(np.exp(np.linspace(-SEPARATRIX_Z, SEPARATRIX_Z, 513)))
    for _ in range(12):  # a zero within one interval of 32 each time
        change = np.flatnonzero(np.diff(np.sign(rates(side, grid)[0])))
        if not change.size:
            return 0.0, math.inf
        grid = np.linspace(grid[change[0]], grid[change[0] + 1], 33)
    fixed = float(grid[16])
    return (0.0, fixed) if v < fixed else (fixed, math.inf)


def on_line(v: Any, low: float, high: float) -> Any:
    """The z of a v in an interval, the inverse of `from_line`."""
    if high < math.inf:
        return np.log((v - low) / (high - v))
    return v - low + np.log(-np.expm1(low - v))


def from_line(z: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """v and dv/dz (...) at z (...)."""
    logistic = 1 / (1 + np.exp(-z))
    if high < math.inf:
        return low + (high - low) * logistic, (high - low) * logistic / (1 + np.exp(z))
    return low + np.logaddexp(0, z), logistic


class Path(NamedTuple):
    """An averaged motion in k panels of z, and behind them at constant rates.

    Of each panel: its `side` (k,); time, ln X_e and ln X_o (3, k) where it begins, their `growth`
    within it, as Chebyshev series in x = -1..1, (n + 1, 3, k), and dt/dx (n, k). `end` (3,) is the
    end of the last, behind which the logarithms have their `rates` (2,); `crossing` (3,) is the
    end of the panels before the separatrix, where there is one.
    """

    side: np.ndarray
    begin: np.ndarray
    growth: np.ndarray
    pace: np.ndarray
    end: np.ndarray
    rates: np.ndarray
    crossing: np.ndarray | None = None

    def behind(self, first: "Path") -> "Path":
        """This path after one that ends at the separatrix."""
        shift = first.end[[0, 2, 1]]
        own = self.side, self.begin + shift[:, None], self.growth, self.pace
        side, begin, growth, pace = (
            np.concatenate(both, axis=-1) for both in zip(first[:4], own, strict=True)
        )
        return Path(side, begin, growth, pace, self.end + shift, self.rates, first.end)

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The sides (n,) and the logarithms (2, n) at times from the start (n,)."""
        k = np.searchsorted(self.begin[0], t, side="right") - 1
        begin, growth, pace = self.begin[:, k], self.growth[..., k], self.pace[:, k]
        series, x = np.polynomial.chebyshev.chebval, np.zeros_like(t)
        for _ in range(NEWTON_STEPS):
            excess = series(x, growth[:, 0], tensor=False) - (t - begin[0])
            x = np.clip(x - excess / series(x, pace, tensor=False), -1, 1)
        inside = begin[1:] + series(x, growth[:, 1:], tensor=False)
        over = np.maximum(t - self.end[0], 0)
        behind = self.end[1:, None] + self.rates[:, None] * over
        return self.side[k], np.where(over > 0, behind, inside)


@np.errstate(all="ignore")
def averaged_path(rates: Rates, start: Start, fp: type) -> Path:
    """The motion from a start, in a precision."""
    side, v = start.side, fp(start.v)
    low, high = interval(rates, side, v)
    speed, z = rates(side, v)[0], on_line(v, low, high)
    limit = high if speed > 0 else low
    crosses = limit == 0 and rates(-side, NEAREST)[0] > 0
    until = last_z(z, limit, speed, crosses)
    # About an axis, and at a fixed point, v stays as it is: one panel, of no length.
    is_steady = not (speed and np.isfinite(z) and until != z)
    count = 1 if is_steady else math.ceil(abs(until - z))
    nodes, fit, integral = chebyshev_fit(NODES if fp is np.float64 else REFERENCE_NODES, fp)
    width = (until - z) / count
    of_x, slope = from_line(z + width * (np.arange(count) + (nodes[:, None] + 1) / 2), low, high)
    f, *logs = rates(side, of_x)
    pace = slope / f * width / 2
    integrands = np.array([pace, *(rate * pace for rate in logs)])
    if is_steady:
        integrands, pace, limit = np.zeros_like(integrands), np.ones_like(pace), v
    growth = (integral @ integrands).swapaxes(0, 1)
    total = growth.sum(axis=0)
    end = np.append(0.0, start.logs)[:, None].astype(fp) + np.cumsum(total, axis=1)
    last_rates = np.array(rates(side, fp(limit))[1:])
    path = Path(np.full(count, side), end - total, growth, fit @ pace, end[:, -1], last_rates)
    if is_steady or not crosses:
        return path
    return averaged_path(rates, Start(-side, NEAREST, np.zeros(2)), fp).behind(path)


def last_z(z: Any, limit: float, speed: Any, crosses: bool) -> Any:
    """How far z goes from a start to reach a limit of v; beyond the start where that is beside a
    separatrix already."""
    if limit == 0:
        return min(z, 0) - (SEPARATRIX_Z if crosses else SLOW_Z)
    reach = AXIS_Z if limit == math.inf else FIXED_POINT_Z
    return max(z, reach) if speed > 0 else min(z, -reach)


def stored(meaning: str, units: str = "1") -> Label:
    """How a number over time is stored."""
    return Label(("time",), f"{meaning}{TO_FIRST_ORDER}", units)


class AveragedTurns(BodyUnderTorques):
    """A body averaged over its turns, by the mean rates of its slow variables; see above."""

    state = ("ln_X", "ln_Y")
    degree = {}
    class_events = ()
    is_quadrature = True
    has_closed_form = True
    variables = {
        "kinetic_energy": stored("kinetic energy T", "moment of inertia / time^2"),
        "momentum": stored("|G|", "moment of inertia / time"),
        "J": stored("G^2/2T", "moment of inertia"),
        "k2": stored("k^2 of the turns, 0 at an axis and 1 at the separatrix"),
    }

    shape_rates: Rates

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Besides: something turns at the start."""
        mistakes = [*super().check(data)]
        yield from mistakes
        if not mistakes and {"inertia", "initial"} <= data.keys():
            A = data["inertia"]
            yield from mistake_of(("initial",), Start.of, A, cls.velocity(A, data["initial"]))

    @cached_property
    def slow_start(self) -> Start:
        """The start in the slow variables."""
        return Start.of(self.inertia, self.initial_velocity)

    @cached_property
    def paths(self) -> dict[type, Path]:
        """The motions that have been computed last, by precision."""
        return {}

    def exact_states(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # The path anew each time, so that the time that it takes is counted.
        path = averaged_path(self.shape_rates, self.slow_start, t.dtype.type)
        self.paths[t.dtype.type] = path
        side, logs = path.at(t)
        return np.where(side > 0, logs, logs[::-1]).T, np.zeros(len(t), dtype=np.intc)

    def exact_end(self, fp: type) -> tuple[str, EventOutcome] | None:
        """The passage through the separatrix, behind which the motion goes on."""
        path = self.paths.get(fp)
        if path is None or path.crossing is None:
            return None
        time, *logs = path.crossing.tolist()
        largest, _, smallest = inertia_order(self.inertia)
        before, after = (largest + 1, smallest + 1)[:: self.slow_start.side]
        state = np.array([logs[:: self.slow_start.side]])
        there = self.output(np.array([time]), state, attributes(self.constants))
        details = {"from": before, "to": after, "G": float(there["momentum"][0])}
        return "separatrix", EventOutcome(time, details, state[0], time)

    @staticmethod
    @np.errstate(all="ignore")  # of a symmetric body X or Y is 0
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        A = np.array([k.A1, k.A2, k.A3])
        a, b, c = A[[*inertia_order(A)]]
        size = np.exp(y.max(axis=1) / 2)
        X, Y = np.exp(y - y.max(axis=1, keepdims=True)).T
        double_energy, square = (X + Y) / (a - c), (a * X + c * Y) / (a - c)
        return {
            "kinetic_energy": double_energy / 2 * size * size,
            "momentum": np.sqrt(square) * size,
            "J": square / double_energy,
            "k2": np.exp(-np.abs(y[:, 0] - y[:, 1] + np.log((a - b) / (b - c)))),
        }

    @np.errstate(all="ignore")
    def own_labels(self, y: np.ndarray) -> np.ndarray:
        largest, middle, smallest = inertia_order(self.inertia)
        a, b, c = self.moments[[largest, middle, smallest]]
        encloses_largest = y[:, 0] - y[:, 1] + np.log((a - b) / (b - c)) > 0
        return np.where(encloses_largest, largest + 1, smallest + 1).astype(np.int8)


class LinearTurns(AveragedTurns):
    """Averaged turns under linear resistance about each axis, at the rates l.

    (ln X_e)' = -2 [l_b + (l_e - l_b) <dn^2>],  (ln X_o)' = -2 [l_b + (l_o - l_b) <cn^2>]
    """

    @property
    def decay(self) -> tuple[float, ...]:
        """The rates (3,) at which resistance slows rotation about each axis."""
        raise NotImplementedError

    def shape_rates(self, side: int, v: Any) -> tuple[Any, Any, Any]:
        l_e, l_b, l_o = (self.decay[i] for i in inertia_order(self.inertia)[::side])
        m, m1, ss, _ = turn_means(v)
        dd = 1 - m * ss
        # By <dn^2> - <cn^2> = (1 - m) <sn^2>: beside the separatrix nothing cancels.
        return (
            -2 * ((l_e - l_o) * dd + (l_o - l_b) * m1 * ss),
            -2 * (l_b + (l_e - l_b) * dd),
            -2 * (l_b + (l_o - l_b) * (1 - ss)),
        )

    @property
    def warnings(self) -> list[str]:
        """Besides: resistance that is not weak beside the turns."""
        A_e, b, A_o = np.sort(self.moments)[:: -self.slow_start.side]
        # One turn takes 4K/n, n^2 = |A_e - b| X_e/(A_e b A_o).
        n = math.sqrt(abs(A_e - b) / (A_e * b * A_o)) * math.exp(self.slow_start.logs[0] / 2)
        ratio = max(map(abs, self.decay)) / n
        large = f"averaging needs weak resistance: its rate over that of the turns is {ratio:.2g}"
        return [*super().warnings, *([large] if ratio > LARGE_RATIO else [])]
