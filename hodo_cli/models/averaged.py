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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..arithmetic import hypot
from ..schema.kinds import Choice, Key, Mistake
from .base import Event, EventOutcome, Label, Model, attributes
from .body import Body, Cavity, LinearDiag, Tensor
from .rigid_body import inertia_order, separatrix_terms
from .theory.exact import sum_along_mean

Rates = Callable[[int, Any], tuple[Any, ...]]
"""v', (ln X)' and (ln Y)' on a side at v."""

SEPARATRIX_Z, SLOW_Z, AXIS_Z, FIXED_POINT_Z = 40.0, 690.0, 80.0, 33.0
"""How far z goes: to a separatrix, where e^-40 is less than rounding; to one that is never reached;
to an axis, e^-40 beside the smallest difference of two moments; and to a fixed point, nearer to
which f is rounding."""

NEAREST = math.exp(-SEPARATRIX_Z)
"""The v at which a motion leaves the separatrix."""

MEAN_STEPS = 8
"""Enough for long doubles at 1 - m = e^-40."""

NODES, REFERENCE_NODES = 20, 26
"""The points of a panel of z: the integrands are analytic where |Im z| < pi/2, so that each term of
their series is 6 times as small as the one before. The second number serves long doubles."""

NEWTON_STEPS = 5
"""Enough to find a time in a panel, within which dt/dz changes by a factor of e at most."""

LARGE_RATIO = 0.1
"""Where resistance is no longer weak: the errors of averaging are some per cent from there on."""


def turn_means(v: Any) -> tuple[Any, Any, Any, Any]:
    """m, 1 - m, S = <sn^2> over a turn, and (S - 1/2)/m, at v (...): sums of positive terms, in
    which nothing cancels."""
    m, m1 = np.exp(-v), -np.expm1(-v)
    excess = sum_along_mean(m * m / 4, (1 + m1) / 2, np.sqrt(m1), MEAN_STEPS) / 4
    return m, m1, 0.5 + m * excess, excess


@lru_cache(maxsize=16)  # a case asks several times, and exact fractions take 0.2 ms
@np.errstate(all="ignore")
def slow_variables(inertia: Any, omega: Any) -> tuple[int, Any, np.ndarray]:
    """The side, v, and ln X and ln Y (2,) at a start, in long double. v follows from the exact D:
    the difference of two logarithms has lost its digits near the separatrix.

    Raises ValueError where there is no turn to average.
    """
    A, size = np.array(inertia, dtype=np.longdouble), np.abs(np.longdouble(omega)).max()
    w, order = np.longdouble(omega) / size, inertia_order(A)
    (a, b, c), (p, q, r) = A[[*order]], w[[*order]] ** 2
    outer, inner = separatrix_terms([*map(Fraction, inertia)], [*map(Fraction, omega)], order)
    side, exact = (1 if outer > inner else -1), abs(outer - inner)
    D = np.longdouble(exact.numerator) / np.longdouble(exact.denominator) / size / size
    X, Y = a * (a - c) * p + b * (b - c) * q, b * (a - b) * q + c * (a - c) * r
    v = np.log1p((a - c) * D / ((b - c) * Y if side > 0 else (a - b) * X))
    if not v > 0:
        raise ValueError("at rest, on the separatrix or as a sphere it has no turn to average")
    return side, v, np.maximum(np.log([X, Y]) + 2 * np.log(size), -1e4)


@cache
def chebyshev_fit(fp: type) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of -1..1 in a precision, and the two matrices that take values there to the Chebyshev
    coefficients of a series and of its integral from -1."""
    n = NODES if fp is np.float64 else REFERENCE_NODES
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
    return (0.0, grid[16]) if v < grid[16] else (grid[16], math.inf)


def from_line(z: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """v and dv/dz (...) at z (...), both to their last digits at both ends.

    v = low + ln [(1 + e^z)/(1 + e^(z - h))], h = high - low
    """
    part, back = -np.expm1(low - high), 1 / (1 + np.exp(z + low - high))
    return low + np.log1p(part * np.exp(z) * back), part * back / (1 + np.exp(-z))


class Path(NamedTuple):
    """An averaged motion in k panels of z, and after them at constant rates.

    Of each panel: the time `begin` (k,) at which it begins and its `side` (k,); the `series`
    (n + 1, 4, k) of time, ln X, ln Y and m in x = -1..1, by Chebyshev's polynomials, and the `pace`
    dt/dx (n, k). `end` (3,) is time, ln X and ln Y after the last one, from where ln X and ln Y go
    on at their `rates` (2,); `crossing` (3,) is the same at the separatrix, where there is one.
    """

    begin: np.ndarray
    side: np.ndarray
    series: np.ndarray
    pace: np.ndarray
    end: np.ndarray
    rates: np.ndarray
    crossing: np.ndarray | None = None

    def then(self, later: "Path") -> "Path":
        """This path as far as the separatrix, and a later one from there on."""
        begin, side, series, pace = (
            np.concatenate(both, axis=-1) for both in zip(self[:4], later[:4], strict=True)
        )
        return Path(begin, side, series, pace, later.end, later.rates, self.end)

    def at(self, t: np.ndarray) -> np.ndarray:
        """The states (n, 4) at times from the start (n,)."""
        k = np.searchsorted(self.begin, t, side="right") - 1
        series, pace, inside = self.series[..., k], self.pace[:, k], np.minimum(t, self.end[0])
        value, x = np.polynomial.chebyshev.chebval, np.zeros_like(t)
        for _ in range(NEWTON_STEPS):
            excess = value(x, series[:, 0], tensor=False) - inside
            x = np.clip(x - excess / value(x, pace, tensor=False), -1, 1)
        *logs, m = value(x, series[:, 1:], tensor=False)
        return np.array([self.side[k], m, *(logs + self.rates[:, None] * (t - inside))]).T


@np.errstate(all="ignore")
def averaged_path(rates: Rates, side: int, v: Any, begin: np.ndarray) -> Path:
    """The motion on a side from v, in its precision, where time, ln X and ln Y are `begin` (3,);
    and then on the other side, if it crosses."""
    low, high = interval(rates, side, v)
    fp, speed = v.dtype.type, rates(side, v)[0]
    z = v - low + np.log(-np.expm1(low - v)) - np.log(-np.expm1(v - high))
    limit = high if speed > 0 else low
    # About an axis, and at a fixed point, v stays as it is.
    is_steady = not (speed and np.isfinite(z))
    crosses = not is_steady and limit == 0 and rates(-side, NEAREST)[0] > 0
    to_separatrix = (SEPARATRIX_Z if crosses else SLOW_Z) - min(z, 0)
    far = to_separatrix if limit == 0 else FIXED_POINT_Z
    reach = AXIS_Z if limit == math.inf else high - low + FIXED_POINT_Z
    until = max(z + 1, reach) if speed > 0 else min(z - 1, -far)
    count = 1 if is_steady else math.ceil(abs(until - z))
    nodes, fit, integral = chebyshev_fit(fp)
    of_x = z + (until - z) * (np.arange(count) + (nodes[:, None] + 1) / 2) / count
    of_x, slope = from_line(of_x, low, high)
    if is_steady:
        limit, of_x = v, np.full_like(of_x, v)
    f, *logs = rates(side, of_x)
    pace = np.ones_like(of_x) if is_steady else slope / f * (until - z) / count / 2
    integrands = np.array([pace, *(rate * pace for rate in logs)])
    of_m = np.pad(fit @ np.exp(-of_x), ((0, 1), (0, 0)))
    series = np.stack([*(integral @ integrands), of_m], axis=1)
    growth = series[:, :3].sum(axis=0)  # every polynomial is 1 at x = 1
    end = begin[:, None] + growth.cumsum(axis=1)
    series[0, :3] += end - growth
    begins, sides, last_rates = (end - growth)[0], np.full(count, side), rates(side, fp(limit))[1:]
    path = Path(begins, sides, series, fit @ pace, end[:, -1], np.array(last_rates))
    return path.then(averaged_path(rates, -side, fp(NEAREST), path.end)) if crosses else path


class AveragedTurns(Body):
    """A body averaged over its turns, by the mean rates of its slow variables; see above."""

    state = ("side", "k2", "ln_X", "ln_Y")
    degree = {}
    class_events = ()
    is_quadrature = True
    has_closed_form = True
    variables = {
        "kinetic_energy": Label(("time",), "kinetic energy T", "moment of inertia / time^2"),
        "momentum": Label(("time",), "|G|", "moment of inertia / time"),
        "J": Label(("time",), "G^2/2T", "moment of inertia"),
        "k2": Label(("time",), "k^2 of the turns, 0 at an axis and 1 at the separatrix"),
        "enclosed_axis": Label(("time",), "axis that the hodograph of G encloses"),
    }

    mean_rates: Rates

    def linear_rates(self, decay: Sequence[float], side: int, v: Any) -> tuple[Any, ...]:
        """The mean rates under linear resistance that slows rotation about each axis at the rates l
        (3,).

        (ln X_e)' = -2 [l_b + (l_e - l_b) <dn^2>],  (ln X_o)' = -2 [l_b + (l_o - l_b) <cn^2>]
        """
        l_e, l_b, l_o = (decay[i] for i in inertia_order(self.inertia)[::side])
        m, m1, ss, _ = turn_means(v)
        dd = 1 - m * ss
        logs = -2 * (l_b + (l_e - l_b) * dd), -2 * (l_b + (l_o - l_b) * (1 - ss))
        # By <dn^2> - <cn^2> = (1 - m) <sn^2>: near the separatrix nothing cancels.
        return -2 * ((l_e - l_o) * dd + (l_o - l_b) * m1 * ss), *logs[::side]

    @classmethod
    def velocity(
        cls, inertia: Sequence[float], initial: Mapping[str, float | None]
    ) -> tuple[float, ...]:
        """(p, q, r) at the start. Raises ValueError too where there is no turn to average."""
        omega = super().velocity(inertia, initial)
        slow_variables(inertia, omega)
        return omega

    @property
    def slow_start(self) -> tuple[int, Any, np.ndarray]:
        """The `slow_variables` at the start."""
        return slow_variables(self.inertia, self.initial_velocity)

    @cached_property
    def paths(self) -> dict[type, Path]:
        """The motion computed last in each precision."""
        return {}

    def exact_states(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # The path anew each time, so that the time that it takes is counted.
        fp, (side, v, logs) = t.dtype.type, self.slow_start
        self.paths[fp] = averaged_path(self.mean_rates, side, fp(v), np.append(0, logs).astype(fp))
        return self.paths[fp].at(t), np.zeros(len(t), dtype=np.intc)

    def exact_end(self, fp: type) -> tuple[str, EventOutcome] | None:
        """The passage through the separatrix, after which the motion goes on."""
        path = self.paths.get(fp)
        if path is None or path.crossing is None:
            return None
        time, *logs = path.crossing.tolist()
        state = np.array([[self.slow_start[0], 1.0, *logs]])
        G = self.output(np.array([time]), state, attributes(self.constants))["momentum"].item()
        before, _, after = (i + 1 for i in inertia_order(self.inertia)[:: self.slow_start[0]])
        details = {"from": before, "to": after, "G": G}
        return "separatrix", EventOutcome(time, details, state[0], time)

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        A = np.array([k.A1, k.A2, k.A3])
        largest, middle, smallest = inertia_order(A)
        a, _, c = A[[largest, middle, smallest]]
        side, k2, *logs = y.T
        size = np.maximum(*logs)
        X, Y = np.exp(logs - size)
        double_energy, square, root = (X + Y) / (a - c), (a * X + c * Y) / (a - c), np.exp(size / 2)
        return {
            "kinetic_energy": double_energy / 2 * root * root,
            "momentum": np.sqrt(square) * root,
            "J": square / double_energy,
            "k2": k2,
            "enclosed_axis": np.where(side > 0, largest + 1, smallest + 1).astype(np.int8),
        }

    @property
    def warnings(self) -> list[str]:
        """Also of resistance that is not weak compared with the turns."""
        side, v, logs = self.slow_start
        A_e, b, A_o = np.sort(self.moments)[::-side]
        # One turn takes 4K/n, n^2 = |A_e - b| X_e/(A_e b A_o).
        n = math.sqrt(abs(A_e - b) / (A_e * b * A_o)) * math.exp(logs[::side][0] / 2)
        ratio = max(map(abs, self.mean_rates(side, v)[1:])) / 2 / n
        large = f"averaging needs weak resistance: its rate over that of the turns is {ratio:.2g}"
        return [*super().warnings, *([large] if ratio > LARGE_RATIO else [])]


class AveragedLinearDiag(AveragedTurns, LinearDiag):
    """The motion averaged over the turns of the free one, to first order in lambda/|omega|.

    u > 0:  (ln X)' = -2 [lambda1 <dn^2> + lambda2 (1 - <dn^2>)]
            (ln Y)' = -2 [lambda3 <cn^2> + lambda2 (1 - <cn^2>)]
    u < 0:  the same with <dn^2> and <cn^2> exchanged

    X = a(a-c) p^2 + b(b-c) q^2 and Y = b(a-b) q^2 + c(a-c) r^2, moment of inertia^2/time^2.
    a >= b >= c: the moments of inertia with their axes sorted, here A1 >= A2 >= A3; they matter in
    the start only. u = ln[(a-b) X/((b-c) Y)], positive where the axis of a is enclosed. <dn^2> and
    <cn^2>: means over a turn for k^2 = e^-|u|. The separatrix u = 0 is crossed once at most, at a
    time that errs by some turns.

    Source: L. D. Akulenko, D. D. Leshchenko, F. L. Chernousko, Izv. AN SSSR MTT 1982 no. 3, 5.
    """

    form = "averaged"

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        return self.linear_rates(self.damping, side, v)


class AveragedTensor(AveragedTurns, Tensor):
    """The motion averaged over the turns of the free one, to first order in I/(A |omega|).

    It is the averaged form of linear-diag with lambda_i = I_ii/A_i: the means of p q, q r and p r
    are 0, so that the entries off the diagonal drop out. Close to the separatrix they do not, and
    the full motion may cross it several times where this one crosses it once.
    """

    form = "averaged"

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        diagonal = np.array(self.term_coefficients["resistance"][::4])
        return self.linear_rates((diagonal / self.inertia).tolist(), side, v)


# A cavity full of viscous fluid: of symmetric bodies two amplitudes say all


def is_triaxial(data: Mapping[str, Any]) -> bool:
    """Whether the data are of a body with three different moments."""
    return len({*data.get("inertia", ())}) == 3


def axial_spin(t: Any, y: Sequence[Any], k: Any) -> Any:
    """r of a symmetric body, as an event."""
    return y[1]


@dataclass(frozen=True)
class SymmetricCavity(Cavity):
    """What the forms in a = sqrt(p^2 + q^2) and r share."""

    spin_reversal: str = "stop"

    keys = Cavity.keys | {
        "spin_reversal": Key(
            Choice("stop", "continue"), "what to do where r reaches 0", default="stop"
        ),
    }
    state = ("a", "r")
    degree = {"kappa": 3, "N3": 0}
    class_events = ()
    variables = {
        "x": Label(("time",), "square of the equatorial angular velocity, p^2 + q^2", "1/time^2"),
        "y": Label(("time",), "square of the axial angular velocity, r^2", "1/time^2"),
    }
    no_axis_reason = "averaged over the hodograph's turns: it circles x3, and crosses nothing"

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        a, r = y.T
        return {"x": a * a, "y": r * r}

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Also that A1 = A2."""
        yield from super().check(data)
        A = data.get("inertia")
        if A is not None and A[0] != A[1]:
            yield (
                ("inertia",),
                f"form {cls.form} needs A1 = A2, not {A[0]} and {A[1]}; form full does not",
            )

    @property
    def start(self) -> tuple[float, ...]:
        p, q, r = super().start
        return hypot(p, q), r

    @property
    def extended_start(self) -> np.ndarray:
        # The roots of x and y have digits that a double has not, and x and y are what is stored.
        squares = [self.initial.get(name) for name in "xy"]
        if None not in squares:
            return np.sqrt(np.array(squares, dtype=np.longdouble))
        p, q, r = np.array(super().start, dtype=np.longdouble)
        return np.array([np.hypot(p, q), r])

    def starts(self, omega: np.ndarray) -> np.ndarray:
        p, q, r = np.moveaxis(omega, -1, 0)
        return np.stack((np.hypot(p, q), r))

    @property
    def warnings(self) -> list[str]:
        """Also of M1 and M2 where the turns do not average them away."""
        A, _, C = self.inertia
        a, r = self.start
        dropped = abs(self.epsilon) * math.hypot(*self.torque[:2])
        turning = abs((C - A) * r) * a
        if not dropped:
            return super().warnings
        ratio = f"{dropped / turning:.3g}" if turning else "infinite"
        return [
            *super().warnings,
            "averaging drops M1 and M2, which is right while "
            "epsilon |(M1, M2)| / (|C - A| |r| a) is small: "
            f"it is {ratio} at the start, and grows as r falls",
        ]

    @property
    def run_events(self) -> tuple[Event, ...]:
        """The end of spin of a body that spins, or begins to."""
        event = Event("end_of_spin", axial_spin, terminal=self.spin_reversal == "stop")
        return (event,) if self.start[1] or self.constants["N3"] else ()


@dataclass(frozen=True)
class Averaged(SymmetricCavity):
    """The motion of an axisymmetric body (A1 = A2 = A, A3 = C) averaged over the turning of (p, q)
    about x3.

    a' = -kappa C (C - A) a r^2 / A^3
    r' = kappa (C - A) a^2 r / (A C) + epsilon M3 / C

    a = sqrt(p^2 + q^2) and r, 1/time; stored are x = a^2 and y = r^2. The other symbols are those
    of the full form. Without M1 and M2 this is no approximation but an identity of the full
    equations. With them it is right to first order in epsilon, until r, and with it the frequency
    |(C - A) r/A|, has become small. r reaches 0 in finite time where M3 opposes it: the end of
    spin, an event that ends the motion or is passed (`spin_reversal`). In y the equations are not
    Lipschitz there, and solvers stop or go astray.

    Source: Leshchenko and Kozachenko 2023, eqs (5), (6), with the sign of a' that follows from (2),
    and +epsilon M3 in r' as in (2) and (6), not - as in (5).

    A body with three different moments is averaged by `AveragedTriaxial`.
    """

    form = "averaged"

    @classmethod
    def form_of(cls, data: Mapping[str, Any]) -> type[Model]:
        return AveragedTriaxial if is_triaxial(data) else cls

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """A1 = A2, or three different moments."""
        yield from AveragedTriaxial.check(data) if is_triaxial(data) else super().check(data)

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        a, r = y
        return (
            -k.kappa * k.A3 * (k.A3 - k.A1) / k.A1**3 * a * r * r,
            k.kappa * (k.A3 - k.A1) / (k.A1 * k.A3) * a * a * r + k.N3 / k.A3,
        )


@dataclass(frozen=True)
class AveragedAsPrinted(SymmetricCavity):
    """The averaged equations with the sign of a' as printed in eqs (5) and (6), to reproduce the
    paper's figures.

    a' = +kappa C (C - A) a r^2 / A^3

    With this sign the fluid's torque, though internal, changes |G|: without M, x - C^2 y/A^2 is
    constant, where it should be x + C^2 y/A^2 = (G/A)^2. Everything else is as in the form
    averaged.

    Source: Leshchenko and Kozachenko 2023, eqs (5), (6).
    """

    form = "averaged-as-printed"

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        a, r = Averaged.rhs(t, y, k)
        return -a, r


@dataclass(frozen=True)
class AveragedTriaxial(AveragedTurns, Cavity):
    """The motion of a body with three different moments averaged over the turns of the free one,
    to first order and without a torque. |G| is constant, and the fluid turns the body to its axis
    of largest inertia.

    (2T)' = -(2 kappa/abc) [(a-c)^2 (a+c-b) <p^2 r^2> + (a-b)^2 (a+b-c) <p^2 q^2>
                            + (b-c)^2 (b+c-a) <q^2 r^2>]

    a >= b >= c are the moments with their axes sorted, <.> is the mean over a turn.

    Source: F. L. Chernousko 1972, averaged.
    """

    spin_reversal: str = "stop"

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Also that there is no torque."""
        yield from super().check(data)
        if any(data.get("torque", ())):
            yield (
                ("torque",),
                "form averaged of a body with three different moments takes no torque; form full "
                "does",
            )

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        A_e, b, A_o = np.sort(self.moments)[::-side]
        m, _, ss, rest = turn_means(v)
        span, near, far = abs(A_e - A_o), abs(A_e - b), abs(b - A_o)
        square = float(np.exp(self.slow_start[2]) @ np.sort(self.moments)[[2, 0]])
        sscc, ratio = (ss - 2 * rest) / 3, m * near / far  # <sn^2 cn^2>, X_o/X_e
        loss = (
            (A_e + A_o - b) * (1 - ss - m * sscc) / (A_e * A_o)
            + near * (A_e + b - A_o) * (ss - m * (ss - sscc)) / (A_e * b * span)
            + m * far * (b + A_o - A_e) * sscc / (b * A_o * span)
        )
        rate = side * 2 * self.constants["kappa"] / (A_e * b * A_o) * loss
        # square = G^2 (a - c) = a X + c Y = A_e X_e + A_o X_o
        X_e = square / (A_e + A_o * ratio)
        return rate * square, *(rate * A_o * ratio * X_e, -rate * A_e * X_e)[::side]
