"""Weak resistance averaged over the turns of the free motion to first order, solved by quadrature;
and the averaged forms of cavity+constant.

Let a >= b >= c be the moments of inertia, and p, q, r the components of omega about their axes. G
turns about axis a where D > 0 (side 1), and about axis c where D < 0 (side -1). e is the axis about
which G turns, o the other one of a and c. With

    X = a(a-c) p^2 + b(b-c) q^2,    Y = b(a-b) q^2 + c(a-c) r^2,    X_a = X,  X_c = Y,
    G^2 = (a X + c Y)/(a-c),    2T = (X + Y)/(a-c),    v = |ln [(a-b) X/((b-c) Y)]|,    m = e^-v

X and Y are constant in free motion, in which sn, cn and dn of the modulus k, with k^2 = m, give
omega. v = 0 is the separatrix. Under weak resistance the mean rates of v, ln X and ln Y on a side
depend on v alone. So v' = f(v) is solved by t = int dv/f, and ln X and ln Y are the integrals of
their rates times dv/f.

The integrals run over a variable z in place of v. f is 0 at the separatrix, v = 0, and at one more
v at most, a fixed point. v(z) maps the whole line to the interval between two zeros, the last of
which may be infinity. Both ends are approached exponentially in z, so all integrands are smooth,
and straight near the ends. Although f ~ 1/K(m) is 0 at the separatrix, the time until the motion is
there is finite. The motion goes on, on the other side, where the axes e and o are exchanged.

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
"""rates(side, v): the mean rates v', (ln X)' and (ln Y)' on a side at v (...)."""

SEPARATRIX_Z, SLOW_Z, AXIS_Z, FIXED_POINT_Z = 40.0, 690.0, 80.0, 33.0
"""The limits of z. SEPARATRIX_Z: to a separatrix that is crossed, because e^-40 is below rounding.
SLOW_Z: to a separatrix that is never reached. AXIS_Z: to an axis, which leaves e^-40 even for the
smallest difference of two moments. FIXED_POINT_Z: to a fixed point; nearer to it f is rounding."""

NEAREST = math.exp(-SEPARATRIX_Z)
"""The v at which a motion goes on after it has crossed the separatrix."""

MEAN_STEPS = 8
"""The steps of the arithmetic-geometric mean: enough for long doubles at 1 - m = e^-40."""

NODES, REFERENCE_NODES = 20, 26
"""The number of points in a panel of z, for doubles and for long doubles. The integrands are
analytic where |Im z| < pi/2, so that each term of their series is 6 times smaller than the one
before."""

NEWTON_STEPS = 5
"""The number of Newton's steps to find a time in a panel. It is enough, because dt/dz changes by a
factor of e at most within a panel."""

LARGE_RATIO = 0.1
"""The ratio of the rates of resistance and of the turns from which resistance is not weak: the
errors of averaging are then some per cent."""


def turn_means(v: Any) -> tuple[Any, Any, Any, Any]:
    """m = k^2 = e^-v, 1 - m, the mean S = <sn^2> over a turn, and (S - 1/2)/m, at v (...). All are
    sums of positive terms, so nothing cancels."""
    m, m1 = np.exp(-v), -np.expm1(-v)
    excess = sum_along_mean(m * m / 4, (1 + m1) / 2, np.sqrt(m1), MEAN_STEPS) / 4
    return m, m1, 0.5 + m * excess, excess


@lru_cache(maxsize=16)  # a case needs them several times, and exact fractions take 0.2 ms
@np.errstate(all="ignore")
def slow_variables(inertia: Any, omega: Any) -> tuple[int, Any, np.ndarray]:
    """The side, v, and ln X and ln Y (2,) at a start, in long double. v is computed from the exact
    D, because the difference of two logarithms loses its digits near the separatrix.

    Raises ValueError for a start without a turn to average.
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
        raise ValueError(
            "a body at rest, on the separatrix or with three equal moments has no turn to average"
        )
    return side, v, np.maximum(np.log([X, Y]) + 2 * np.log(size), -1e4)


@cache
def chebyshev_fit(fp: type) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The points of a panel in -1..1, and two matrices. They turn the values of a function at the
    points into the Chebyshev coefficients of the function and of its integral from -1."""
    n = NODES if fp is np.float64 else REFERENCE_NODES
    angle = (np.arange(n, dtype=fp) + fp(0.5)) * np.arccos(fp(-1)) / n
    weights = np.where(np.arange(n), 2, 1)[:, None] / fp(n)
    fit = np.cos(np.outer(np.arange(n), angle)) * weights
    return np.cos(angle), fit, np.polynomial.chebyshev.chebint(fit, lbnd=-1)


def interval(rates: Rates, side: int, v: Any) -> tuple[float, float]:
    """The zeros of f (or 0 and infinity) between which v lies."""
    grid = np.log1p(np.exp(np.linspace(-SEPARATRIX_Z, SEPARATRIX_Z, 513)))
    for _ in range(12):  # each round locates the zero in one interval of 32
        change = np.flatnonzero(np.diff(np.sign(rates(side, grid)[0])))
        if not change.size:
            return 0.0, math.inf
        grid = np.linspace(grid[change[0]], grid[change[0] + 1], 33)
    return (0.0, grid[16]) if v < grid[16] else (grid[16], math.inf)


def from_line(z: np.ndarray, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """v and dv/dz (...) at z (...), with v = low + ln [(1 + e^z)/(1 + e^(z - h))], h = high - low.
    Both keep their digits at both ends of the line."""
    part, back = -np.expm1(low - high), 1 / (1 + np.exp(z + low - high))
    return low + np.log1p(part * np.exp(z) * back), part * back / (1 + np.exp(-z))


class Path(NamedTuple):
    """An averaged motion: k panels of z, and constant rates after them.

    A panel has the time `begin` (k,) at its start, its `side` (k,), the Chebyshev `series`
    (n + 1, 4, k) of time, ln X, ln Y and m in x = -1..1, and the series `pace` (n, k) of dt/dx.
    `end` (3,) holds time, ln X and ln Y after the last panel. From there ln X and ln Y change at
    constant `rates` (2,). `crossing` (3,) holds time, ln X and ln Y at the separatrix, if the
    motion crosses it.
    """

    begin: np.ndarray
    side: np.ndarray
    series: np.ndarray
    pace: np.ndarray
    end: np.ndarray
    rates: np.ndarray
    crossing: np.ndarray | None = None

    def then(self, later: "Path") -> "Path":
        """This path, which ends at the separatrix, followed by the path after the crossing."""
        begin, side, series, pace = (
            np.concatenate(both, axis=-1) for both in zip(self[:4], later[:4], strict=True)
        )
        return Path(begin, side, series, pace, later.end, later.rates, self.end)

    def at(self, t: np.ndarray) -> np.ndarray:
        """The states (n, 4) of `AveragedTurns` at the times t (n,) since the start."""
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
    """The motion from v on a side, in the precision of v. It continues on the other side if it
    crosses. `begin` (3,) holds time, ln X and ln Y at v."""
    low, high = interval(rates, side, v)
    fp, speed = v.dtype.type, rates(side, v)[0]
    z = v - low + np.log(-np.expm1(low - v)) - np.log(-np.expm1(v - high))
    limit = high if speed > 0 else low
    # In a rotation about an axis, and at a fixed point, v is constant.
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
    growth = series[:, :3].sum(axis=0)  # every Chebyshev polynomial is 1 at x = 1
    end = begin[:, None] + growth.cumsum(axis=1)
    series[0, :3] += end - growth
    begins, sides, last_rates = (end - growth)[0], np.full(count, side), rates(side, fp(limit))[1:]
    path = Path(begins, sides, series, fit @ pace, end[:, -1], np.array(last_rates))
    return path.then(averaged_path(rates, -side, fp(NEAREST), path.end)) if crosses else path


class AveragedTurns(Body):
    """The base class of bodies averaged over their turns. A form states its `mean_rates`; methods
    and symbols are those of the module."""

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
        """The mean rates under linear resistance omega_i' = -l_i omega_i, with l = `decay` (3,).

        (ln X_e)' = -2 [l_b + (l_e - l_b) <dn^2>],  (ln X_o)' = -2 [l_b + (l_o - l_b) <cn^2>]

        e, b, o are the axis about which G turns, the middle one and the other one.
        """
        l_e, l_b, l_o = (decay[i] for i in inertia_order(self.inertia)[::side])
        m, m1, ss, _ = turn_means(v)
        dd = 1 - m * ss
        logs = -2 * (l_b + (l_e - l_b) * dd), -2 * (l_b + (l_o - l_b) * (1 - ss))
        # v' by <dn^2> - <cn^2> = (1 - m) <sn^2>, so that nothing cancels near the separatrix.
        return -2 * ((l_e - l_o) * dd + (l_o - l_b) * m1 * ss), *logs[::side]

    @classmethod
    def velocity(
        cls, inertia: Sequence[float], initial: Mapping[str, float | None]
    ) -> tuple[float, ...]:
        """(p, q, r) at the start. Raises ValueError also for a start without a turn to average."""
        omega = super().velocity(inertia, initial)
        slow_variables(inertia, omega)
        return omega

    @property
    def slow_start(self) -> tuple[int, Any, np.ndarray]:
        """The side, v, ln X and ln Y at the start, of `slow_variables`."""
        return slow_variables(self.inertia, self.initial_velocity)

    @cached_property
    def paths(self) -> dict[type, Path]:
        """The path that was computed last, by the type of its numbers."""
        return {}

    def exact_states(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The states (n, 4), whose units are those of the case."""
        # The path is computed anew each time, so that the measured run time includes it.
        fp, (side, v, logs) = t.dtype.type, self.slow_start
        self.paths[fp] = averaged_path(self.mean_rates, side, fp(v), np.append(0, logs).astype(fp))
        return self.paths[fp].at(t), np.zeros(len(t), dtype=np.intc)

    def exact_end(self, fp: type) -> tuple[str, EventOutcome] | None:
        """The crossing of the separatrix, after which the motion goes on."""
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
        """Energy, |G|, G^2/2T, k^2 and the enclosed axis, from the side, k^2, ln X and ln Y."""
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
        """With a sentence on resistance that is not weak compared with the turns."""
        side, v, logs = self.slow_start
        A_e, b, A_o = np.sort(self.moments)[::-side]
        # One turn takes 4K/n, n^2 = |A_e - b| X_e/(A_e b A_o).
        n = math.sqrt(abs(A_e - b) / (A_e * b * A_o)) * math.exp(logs[::side][0] / 2)
        ratio = max(map(abs, self.mean_rates(side, v)[1:])) / 2 / n
        large = f"averaging needs weak resistance: its rate over that of the turns is {ratio:.2g}"
        return [*super().warnings, *([large] if ratio > LARGE_RATIO else [])]


class AveragedLinearDiag(AveragedTurns, LinearDiag):
    """The motion averaged over the turns of the free motion, to first order in lambda/|omega|.

    u > 0:  (ln X)' = -2 [lambda1 <dn^2> + lambda2 (1 - <dn^2>)]
            (ln Y)' = -2 [lambda3 <cn^2> + lambda2 (1 - <cn^2>)]
    u < 0:  the same with <dn^2> and <cn^2> exchanged

    X = a(a-c) p^2 + b(b-c) q^2 and Y = b(a-b) q^2 + c(a-c) r^2, moment of inertia^2/time^2.
    a >= b >= c are the sorted moments of inertia, p, q, r and lambda1, lambda2, lambda3 belong to
    their axes. The rates depend on the moments through u only: u = ln[(a-b) X/((b-c) Y)] is
    positive where the axis of a is enclosed. <dn^2> and <cn^2>: means over a turn for k^2 = e^-|u|.
    The separatrix u = 0 is crossed once at most. The time of the crossing errs by some turns.

    Source: L. D. Akulenko, D. D. Leshchenko, F. L. Chernousko, Izv. AN SSSR MTT 1982 no. 3, 5.
    """

    form = "averaged"

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        """The mean rates under the damping lambda_i."""
        return self.linear_rates(self.damping, side, v)


class AveragedTensor(AveragedTurns, Tensor):
    """The motion averaged over the turns of the free motion, to first order in I/(A |omega|).

    It is the averaged form of linear-diag with lambda_i = I_ii/A_i: the entries off the diagonal
    drop out, because the means of p q, q r and p r are 0. Close to the separatrix they matter: the
    full motion may cross it several times where the averaged one crosses it once.
    """

    form = "averaged"

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        """The mean rates under the damping lambda_i = I_ii/A_i."""
        diagonal = np.array(self.term_coefficients["resistance"][::4])
        return self.linear_rates((diagonal / self.inertia).tolist(), side, v)


# A cavity full of viscous fluid. Two amplitudes are the whole state of a symmetric body


def is_triaxial(data: Mapping[str, Any]) -> bool:
    """Whether the body of a case has three different moments."""
    return len({*data.get("inertia", ())}) == 3


def axial_spin(t: Any, y: Sequence[Any], k: Any) -> Any:
    """r of a symmetric body, as the function of an event."""
    return y[1]


@dataclass(frozen=True)
class SymmetricCavity(Cavity):
    """The base class of the forms whose state is a = sqrt(p^2 + q^2) and r."""

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
        """x = a^2 and y = r^2."""
        a, r = y.T
        return {"x": a * a, "y": r * r}

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Further mistake: A1 and A2 that differ."""
        yield from super().check(data)
        A = data.get("inertia")
        if A is not None and A[0] != A[1]:
            yield (
                ("inertia",),
                f"form {cls.form} needs A1 = A2, not {A[0]} and {A[1]}; form full does not",
            )

    @property
    def start(self) -> tuple[float, ...]:
        """a = sqrt(p^2 + q^2) and r at the start."""
        p, q, r = super().start
        return hypot(p, q), r

    @property
    def extended_start(self) -> np.ndarray:
        """a and r at the start in long double."""
        # From x and y themselves, so that their squares, which are stored, are x and y again.
        squares = [self.initial.get(name) for name in "xy"]
        if None not in squares:
            return np.sqrt(np.array(squares, dtype=np.longdouble))
        p, q, r = np.array(super().start, dtype=np.longdouble)
        return np.array([np.hypot(p, q), r])

    def starts(self, omega: np.ndarray) -> np.ndarray:
        """The states (2, n) for angular velocities (n, 3) at the start."""
        p, q, r = np.moveaxis(omega, -1, 0)
        return np.stack((np.hypot(p, q), r))

    @property
    def warnings(self) -> list[str]:
        """With a sentence on M1 and M2, which averaging drops."""
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
        """The end of spin, r = 0, of a body that spins at the start or whose torque spins it up."""
        event = Event("end_of_spin", axial_spin, terminal=self.spin_reversal == "stop")
        return (event,) if self.start[1] or self.constants["N3"] else ()


@dataclass(frozen=True)
class Averaged(SymmetricCavity):
    """The motion of an axisymmetric body (A1 = A2 = A, A3 = C) averaged over the turning of (p, q)
    about x3.

    a' = -kappa C (C - A) a r^2 / A^3
    r' = kappa (C - A) a^2 r / (A C) + epsilon M3 / C

    a = sqrt(p^2 + q^2) and r, 1/time; stored are x = a^2 and y = r^2. The other symbols are those
    of the full form. Without M1 and M2 these equations follow from the full ones exactly. With M1
    and M2 they hold to first order in epsilon, until r, and with it the frequency |(C - A) r/A| of
    the turning, has become small. r reaches 0 in finite time where M3 opposes it. This is the end
    of spin, an event that ends the motion, or after which it continues (`spin_reversal`). The state
    is r and not y, because the equations in y are not Lipschitz at y = 0, where solvers stop or
    fail.

    Source: Leshchenko and Kozachenko 2023, eqs (5), (6), with the sign of a' that follows from (2),
    and +epsilon M3 in r' as in (2) and (6), not - as in (5).

    A body with three different moments is averaged by `AveragedTriaxial`.
    """

    form = "averaged"

    @classmethod
    def form_of(cls, data: Mapping[str, Any]) -> type[Model]:
        """The form for a body with three different moments is another class."""
        return AveragedTriaxial if is_triaxial(data) else cls

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """The mistakes of the form for A1 = A2, or of that for three different moments."""
        yield from AveragedTriaxial.check(data) if is_triaxial(data) else super().check(data)

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """a' and r', which do not depend on M1 and M2."""
        a, r = y
        return (
            -k.kappa * k.A3 * (k.A3 - k.A1) / k.A1**3 * a * r * r,
            k.kappa * (k.A3 - k.A1) / (k.A1 * k.A3) * a * a * r + k.N3 / k.A3,
        )


@dataclass(frozen=True)
class AveragedAsPrinted(SymmetricCavity):
    """The averaged equations with the sign of a' that eqs (5) and (6) have in print. They reproduce
    the figures of the paper.

    a' = +kappa C (C - A) a r^2 / A^3

    With this sign the fluid's torque, which is internal, changes |G|: without M,
    x - C^2 y/A^2 is constant, and not x + C^2 y/A^2 = (G/A)^2. Everything else is as in the form
    averaged.

    Source: Leshchenko and Kozachenko 2023, eqs (5), (6).
    """

    form = "averaged-as-printed"

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """a' with the printed sign, and r'."""
        a, r = Averaged.rhs(t, y, k)
        return -a, r


@dataclass(frozen=True)
class AveragedTriaxial(AveragedTurns, Cavity):
    """The motion of a body with three different moments averaged over the turns of the free motion,
    to first order and without a torque. |G| is constant, and the fluid turns the body to rotation
    about its axis of largest inertia.

    (2T)' = -(2 kappa/abc) [(a-c)^2 (a+c-b) <p^2 r^2> + (a-b)^2 (a+b-c) <p^2 q^2>
                            + (b-c)^2 (b+c-a) <q^2 r^2>]

    a >= b >= c are the sorted moments, p, q, r belong to their axes, <.> is the mean over a turn.

    Source: F. L. Chernousko 1972, averaged.
    """

    spin_reversal: str = "stop"

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Further mistake: a torque."""
        yield from super().check(data)
        if any(data.get("torque", ())):
            yield (
                ("torque",),
                "form averaged of a body with three different moments takes no torque; form full "
                "does",
            )

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        """The mean rates under the fluid's torque, for which |G| is constant."""
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
