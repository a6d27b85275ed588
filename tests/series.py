"""An independent reference: Taylor series in big integers, from the papers' equations alone.

It shares no line with `hodo_cli`. Systems are integrated with `bits` binary places, so an error is
absolute, about 2**(50 - bits). Floats are taken for exactly what they are (0.8 is the double 0.8).
`python tests/series.py` prints tests/data/crossings.csv.
"""

import csv
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from operator import mul
from typing import Any, NamedTuple

import mpmath

Polynomial = dict[tuple[int, ...], Fraction]
"""Coefficients by monomial; (1, 2) is y1 y2, (0, 0) is y0**2, () is 1."""
System = tuple[Polynomial, ...]
"""The right-hand side of y' = f(y), one polynomial for each variable."""
Data = Sequence[float | Fraction]


# P1: Rachinskaya; P2: Leshchenko, Kozachenko 2023; P3: Akulenko, Zinkevich, Kozachenko,
# Leshchenko 2017.


def tensor(A: Data, I: Sequence[Data]) -> System:
    """A w' + w x A w = -I w, for (p, q, r). P1 eqs (1) and (9)-(10)."""
    A1, A2, A3 = map(Fraction, A)
    gyroscopic = ((1, 2), A2 - A3), ((0, 2), A3 - A1), ((0, 1), A1 - A2)
    return tuple(
        {product: k / Fraction(a)} | {(j,): -Fraction(x) / Fraction(a) for j, x in enumerate(row)}
        for a, (product, k), row in zip(A, gyroscopic, I, strict=True)
    )


def diagonal(A: Data, lam: Data) -> System:
    """A1 p' + (A3 - A2) q r = -lambda1 A1 p and cyclically. P1 eq (3)."""
    moments = [Fraction(x) * Fraction(a) for x, a in zip(lam, A, strict=True)]
    return tensor(
        A, [[moment if i == j else 0 for j in range(3)] for i, moment in enumerate(moments)]
    )


def cavity(inertia: Data, kappa: float | Fraction, torque: Data) -> System:
    """P2 eq (2); `torque` is eps M, that of the fluid kappa (w'' + w x w'), w' free."""
    A, B, C = map(Fraction, inertia)
    k = Fraction(kappa) / (A * B * C)

    def row(A: Any, B: Any, C: Any, q: int, r: int, p: int, M: float | Fraction) -> Polynomial:
        return {
            tuple(sorted((q, r))): (B - C) / A,
            tuple(sorted((p, r, r))): k * C * (A - C) * (A + C - B) / A,
            tuple(sorted((p, q, q))): k * B * (A - B) * (A + B - C) / A,
            (): Fraction(M) / A,
        }

    M1, M2, M3 = torque
    return row(A, B, C, 1, 2, 0, M1), row(B, C, A, 2, 0, 1, M2), row(C, A, B, 0, 1, 2, M3)


def cavity_averaged(
    A: float, C: float, kappa: float | Fraction, torque3: float | Fraction, printed: bool
) -> System:
    """P2 eq (6) for (x, sqrt(y)), `torque3` = eps M3; as printed, or with the sign by (2)."""
    A, C, k, M3 = map(Fraction, (A, C, kappa, torque3))
    sign = 1 if printed else -1
    return {(0, 1, 1): sign * 2 * k * C * (C - A) / A**3}, {
        (0, 1): k * (C - A) / (A * C),
        (): M3 / C,
    }


def lagrange(A: float, C: float, mu: float, eps: float, a: Data, b: Data) -> System:
    """P3 eqs (1.1), (3.1) for (p, q, r, g1, g2, g3, tau) in tau = eps t, g being the vertical;
    a and b are the coefficients of polynomials in tau."""
    A, C, mu, eps = map(Fraction, (A, C, mu, eps))

    def damped(variable: int, law: Data, inertia: Fraction) -> Polynomial:
        return {(variable, *[6] * n): -Fraction(value) / inertia for n, value in enumerate(law)}

    return (
        {(1, 2): (A - C) / A / eps, (4,): mu / A / eps} | damped(0, a, A),
        {(0, 2): (C - A) / A / eps, (3,): -mu / A / eps} | damped(1, a, A),
        damped(2, b, C),
        {(2, 4): 1 / eps, (1, 5): -1 / eps},
        {(0, 5): 1 / eps, (2, 3): -1 / eps},
        {(1, 3): 1 / eps, (0, 4): -1 / eps},
        {(): Fraction(1)},
    )


class Step(NamedTuple):
    """y_i = sum of series[i][n] s**n, time = t + h s, 0 <= s <= 1, all in units of 2**-bits."""

    t: int
    h: int
    series: list[list[int]]
    bits: int

    def at(self, s: int) -> list[Fraction]:
        return [Fraction(_value(y, s, self.bits), 1 << self.bits) for y in self.series]

    def time(self, s: int) -> Fraction:
        return Fraction((self.t << self.bits) + self.h * s, 1 << 2 * self.bits)


def taylor(system: System, start: Data, end: float, bits: int = 192) -> Iterator[Step]:
    """The steps from time 0 to `end`, whose order and length follow Jorba and Zou (2005)."""
    spare = 32
    order = round((bits - spare) * math.log(2) / 2)
    expand = _expander(system, order, bits)
    y, t, h, last = [_fixed(v, bits) for v in start], 0, 1 << bits, _fixed(end, bits)
    while t < last:
        h = min(h, last - t)
        series = expand(y, h)
        stretch = min(
            (spare - abs(s[n]).bit_length()) / n
            for s in series
            for n in range(order - 2, order + 1)
        )
        if stretch < 0:
            shrink = _fixed(2.0**stretch, bits)
            powers = [1 << bits]
            for _ in range(order):
                powers.append(powers[-1] * shrink >> bits)
            series = [[c * x >> bits for c, x in zip(s, powers, strict=True)] for s in series]
            h = h * shrink >> bits
        yield Step(t, h, series, bits)
        y, t = [sum(s) for s in series], t + h
        h = h * _fixed(2.0 ** min(max(stretch, 0), 1), bits) >> bits


def _expander(system: System, order: int, bits: int) -> Callable[[list[int], int], list[list[int]]]:
    """The function (y, h) -> Taylor coefficients of the solution from y in units of the step h."""
    size = len(system)
    node: dict[tuple[int, ...], int] = {(i,): i for i in range(size)}
    products: list[tuple[int, int]] = []
    for monomial in sorted(
        {m[:n] for row in system for m in row for n in range(2, len(m) + 1)}, key=len
    ):
        node[monomial] = size + len(products)
        products.append((node[monomial[:-1]], monomial[-1]))
    linear = [[(node[m], _fixed(k, bits)) for m, k in row.items() if m] for row in system]
    constant = [_fixed(row.get((), 0), bits) for row in system]

    def expand(y: list[int], h: int) -> list[list[int]]:
        series = [[v] for v in y] + [[] for _ in products]
        for n in range(order):
            for s, (i, j) in zip(series[size:], products, strict=True):
                s.append(sum(map(mul, series[i], reversed(series[j]))) >> bits)
            for s, row, k in zip(series, linear, constant, strict=False):
                slope = sum(k * series[i][n] for i, k in row) + (k << bits if n == 0 else 0)
                s.append((slope * h >> 2 * bits) // (n + 1))
        return series[:size]

    return expand


def states(
    system: System, start: Data, times: Sequence[float], bits: int = 192
) -> list[list[Fraction]]:
    """The states at the given times, which rise from 0 on."""
    rest = list(times)
    found = []
    for step in taylor(system, start, max(rest), bits):
        while rest and (local := _fixed(rest[0], bits) - step.t) <= step.h:
            found.append(step.at((local << bits) // step.h))
            rest.pop(0)
    return found


class Zero(NamedTuple):
    """Where a linear form of the state changes sign, and its sign after that."""

    time: Fraction
    state: list[Fraction]
    sign: int


def zeros(steps: Iterator[Step], form: Data) -> Iterator[Zero]:
    """Every change of sign of sum(form_i y_i) after the start, by Descartes' rule."""
    for step in steps:
        weights = [_fixed(w, step.bits) for w in form]
        polynomial = [
            sum(map(mul, weights, terms)) >> step.bits for terms in zip(*step.series, strict=True)
        ]
        if any(polynomial) and max(map(abs, polynomial)) < 1 << 40:
            raise ArithmeticError("the form is lost in rounding: more bits, or it is always zero")
        if abs(polynomial[0]) > sum(map(abs, polynomial[1:])):
            continue
        for s, sign in _roots(polynomial, step.bits):
            yield Zero(step.time(s), step.at(s), sign)


def _roots(polynomial: list[int], bits: int) -> Iterator[tuple[int, int]]:
    """The roots in 0 < s < 1, each with the sign after it: an interval is halved until its
    coefficients in Bernstein's basis change sign once at most."""
    order = len(polynomial) - 1
    basis = [c // math.comb(order, n) for n, c in enumerate(polynomial)]
    for k in range(order):
        for n in range(order, k, -1):
            basis[n] += basis[n - 1]
    stack = [(0, 1 << bits, basis)]
    while stack:
        low, high, basis = stack.pop()
        signs = [b > 0 for b in basis if b]
        changes = sum(a != b for a, b in pairwise(signs))
        if any(basis) and basis[-1] == 0 or changes > 1 and high - low < 1 << bits // 2:
            raise ArithmeticError("a root at the end of an interval, or a double root")
        if changes == 1:
            yield _bisect(polynomial, low, high, signs[-1], bits), 1 if signs[-1] else -1
        elif changes > 1:
            left, right, middle = [], [], (low + high) // 2
            while basis:
                left.append(basis[0])
                right.insert(0, basis[-1])
                basis = [a + b >> 1 for a, b in pairwise(basis)]
            stack += [(middle, high, right), (low, middle, left)]


def _bisect(polynomial: list[int], low: int, high: int, above: bool, bits: int) -> int:
    """The one root between low and high, where the polynomial is positive at high if `above`."""
    while high - low > 1:
        middle = (low + high) // 2
        if (_value(polynomial, middle, bits) > 0) == above:
            high = middle
        else:
            low = middle
    return high


def _value(polynomial: list[int], s: int, bits: int) -> int:
    total = 0
    for c in reversed(polynomial):
        total = (total * s >> bits) + c
    return total


def _fixed(value: float | Fraction, bits: int) -> int:
    return math.floor(Fraction(value) * (1 << bits))


class Crossing(NamedTuple):
    """One crossing of the separatrix: when, from which axis (1, 2, 3) to which, and |G| there."""

    time: Fraction
    before: int
    after: int
    momentum: Fraction
    state: list[Fraction]


def crossings(A: Data, system: System, start: Data, end: float, bits: int = 192) -> list[Crossing]:
    """Every crossing of D = A_l (A_l - A_m) w_l^2 - A_s (A_m - A_s) w_s^2 = 0, in order of time.

    l, m, s are the axes of largest, middle and smallest inertia; G goes round l where D > 0, the
    product of two linear forms, (a w_l - b w_s)(a w_l + b w_s).
    """
    largest, middle, smallest = sorted(range(3), key=lambda i: -A[i])
    Al, Am, As = (Fraction(A[i]) for i in (largest, middle, smallest))
    a, b = _root(Al * (Al - Am), bits), _root(As * (Am - As), bits)
    if not a * b:
        return []
    steps = list(taylor(system, start, end, bits))
    found = []
    for side in (1, -1):
        form = [Fraction(0)] * len(start)
        form[largest], form[smallest] = a, -side * b
        for time, state, sign in zeros(iter(steps), form):
            outer = sign * (a * state[largest] + side * b * state[smallest]) > 0
            axes = (smallest + 1, largest + 1) if outer else (largest + 1, smallest + 1)
            found.append(Crossing(time, *axes, momentum(A, state, bits), state))
    return sorted(found)


def momentum(A: Data, omega: Sequence[Fraction], bits: int = 192) -> Fraction:
    """|G|."""
    return _root(sum((Fraction(a) * w) ** 2 for a, w in zip(A, omega, strict=True)), bits)


def completed(p: float | Fraction, q: float | Fraction, A: Data, G: float = 1.0) -> Fraction:
    """The positive r with |G(0)| = G, given p and q."""
    A1, A2, A3 = map(Fraction, A)
    return _root(Fraction(G) ** 2 - (A1 * Fraction(p)) ** 2 - (A2 * Fraction(q)) ** 2, 192) / A3


def _root(value: Fraction, bits: int) -> Fraction:
    """The square root, rounded down at 2**-bits; exact if it has no more places."""
    return Fraction(math.isqrt(math.floor(value * (1 << 2 * bits))), 1 << bits)


class LagrangeAveraged(NamedTuple):
    """P3 eq (3.2) averaged over the nutation, for (Gz, H, r) by the slow time; in `mpmath`."""

    A: float
    C: float
    mu: float
    a: Data
    b: Data

    def states(self, start: Data, times: Sequence[float], digits: int = 24) -> list[mpmath.matrix]:
        """(Gz, H, r) at the given times, which rise from 0 on."""
        found = []
        with mpmath.workdps(digits + 12):
            t, y = mpmath.mpf(0), mpmath.matrix(start)
            for end in map(mpmath.mpf, times):
                while t < end:
                    h = min(mpmath.mpf(0.125), end - t)
                    t, y = t + h, self._advance(t, y, h, digits)
                found.append(y)
        return found

    def when(
        self, start: Data, near: float, gap: Callable[..., mpmath.mpf], digits: int = 24
    ) -> mpmath.mpf:
        """The time near `near` where gap(Gz, H, r) = 0."""
        (y,) = self.states(start, [near], digits)
        with mpmath.workdps(digits + 12):
            return near + mpmath.findroot(
                lambda h: gap(*self._advance(mpmath.mpf(near), y, h, digits)),
                (0, 1e-3),
                solver="secant",
                tol=mpmath.mpf(10) ** (-2 * digits),
            )

    def _advance(self, t: Any, y: mpmath.matrix, h: Any, digits: int) -> mpmath.matrix:
        """A step by Gragg, Bulirsch and Stoer: the midpoint rule, extrapolated in h**2."""
        table: list[mpmath.matrix] = []
        for k in range(1, 13):
            new = [self._midpoint(t, y, h, 2 * k)]
            for j, old in enumerate(table, 1):
                new.append(new[-1] + (new[-1] - old) / (mpmath.mpf(k) ** 2 / (k - j) ** 2 - 1))
            if table and mpmath.norm(new[-1] - table[-1]) < mpmath.mpf(10) ** -digits:
                return new[-1]
            table = new
        return self._advance(t + h / 2, self._advance(t, y, h / 2, digits), h / 2, digits)

    def _midpoint(self, t: Any, y: mpmath.matrix, h: Any, parts: int) -> mpmath.matrix:
        h = h / parts
        z = [y, y + h * self.slope(t, y)]
        for k in range(1, parts + 1):
            z.append(z[-2] + 2 * h * self.slope(t + k * h, z[-1]))
        return (z[-3] + 2 * z[-2] + z[-1]) / 4

    def slope(self, t: mpmath.mpf, y: mpmath.matrix) -> mpmath.matrix:
        """The derivatives of (Gz, H, r) by the slow time."""
        Gz, H, r = y
        a, b = (sum(c * t**n for n, c in enumerate(law)) for law in (self.a, self.b))
        v = self.mean_cosine(Gz, H, r)
        horizontal = (Gz - self.C * r * v) / self.A
        transverse = (2 * H - self.C * r**2 - 2 * self.mu * v) / self.A
        return mpmath.matrix(
            [-a * horizontal - b * r * v, -a * transverse - b * r**2, -b * r / self.C]
        )

    def mean_cosine(self, Gz: mpmath.mpf, H: mpmath.mpf, r: mpmath.mpf) -> mpmath.mpf:
        """<u> = u3 - (u3 - u1) E/K, by (1.3)."""
        u1, u2, u3 = self.roots(Gz, H, r)
        m = (u2 - u1) / (u3 - u1)
        return u3 - (u3 - u1) * mpmath.ellipe(m) / mpmath.ellipk(m)

    def roots(self, Gz: mpmath.mpf, H: mpmath.mpf, r: mpmath.mpf) -> list[mpmath.mpf]:
        """u1 <= u2 <= u3 of (1.4), with twice the digits, half of which go where u1 = u2."""
        with mpmath.workdps(2 * mpmath.mp.dps):
            A, C, mu = self.A, self.C, self.mu
            s1 = (H - C * r**2 / 2 + (C * r) ** 2 / (2 * A)) / mu
            s2 = Gz * r * C / A / mu - 1
            s3 = (C * r**2 / 2 - H + Gz**2 / (2 * A)) / mu
            third = s1 / 3
            radius = mpmath.sqrt(third**2 - s2 / 3)
            angle = mpmath.acos(min(1, (third**3 - third * s2 / 2 + s3 / 2) / radius**3)) / 3
            return sorted(
                third + 2 * radius * mpmath.cos(angle + k * 2 * mpmath.pi / 3) for k in range(3)
            )


# The figures' cases, and their events.

Number = Callable[[float], float | Fraction]


def as_printed(value: float) -> Fraction:
    """The decimal number that is printed, not the double nearest to it."""
    return Fraction(repr(value))


INERTIA = (1.0, 0.8, 0.6)
LITERAL = (0.005, 0.0, 0.005, 0.0, 0.0, 0.0, 0.005, 0.0, 0.005)
UNIT_OMEGA = (0.5, 0.25, 0.82915619758885)
LOWER = (0.5, 0.25, math.sqrt(1 - 0.29) / 0.6)
PAPER1 = {
    "fig4": ((0.005, 0.004, 0.003), (0.8, 0.5, 0.74), 1000),
    "fig8": ((0.003, 0.004, 0.005), (0.8, 0.5, 0.74), 1000),
    "fig9": ((0.005, 0.004, 0.005), (0.8, 0.5, 0.74), 1000),
    "fig11": ((0.005, 0.004, 0.002), (0.8, 0.5, 0.74), 1000),
    "fig12": (LITERAL, (0.5, 0.25, None), 1000),
    "fig12-unit-omega": (LITERAL, UNIT_OMEGA, 1000),
    "fig12-all-entries": ((0.005, 0.005), (0.5, 0.25, None), 1000),
    "fig12-all-entries-unit-omega": ((0.005, 0.005), UNIT_OMEGA, 1000),
    "fig12 from r = 1.404": ((0.005, 0.005), (0.5, 0.25, 1.404), 1000),
    "fig12 from r = 1.4": ((0.005, 0.005), (0.5, 0.25, 1.4), 1000),
    "fig14": (LITERAL, (0.8, 0.5, 0.74), 1200),
    "fig14-all-entries": ((0.005, 0.005), (0.8, 0.5, 0.74), 1200),
    "fig14-all-entries-small-r": ((0.005, 0.005), (0.5, 0.25, 0.4), 1200),
    "fig16": ((0.003, 0.001), (0.5, 0.25, None), 1000),
    "fig16-unit-omega": ((0.003, 0.001), UNIT_OMEGA, 1000),
    "fig18": ((0.001, 0.003), (0.5, 0.25, None), 3000),
    "fig18-unit-omega": ((0.001, 0.003), UNIT_OMEGA, 1000),
    "fig12 from r one ulp lower": ((0.005, 0.005), LOWER, 1000),
    "fig16 from r one ulp lower": ((0.003, 0.001), LOWER, 1000),
    "fig18 from r one ulp lower": ((0.001, 0.003), LOWER, 3000),
}
"""(lambda1, lambda2, lambda3), (diagonal, off-diagonal) or all nine entries; p, q, r at the start;
horizon. r = None is the double nearest to the root of |G(0)| = 1, and `LOWER` an ulp below it."""

PAPER2 = {
    "fig1": (8.0, 4.0, -0.1),
    "fig2": (8.0, 4.0, -0.3),
    "fig3": (1.3, 1.0, -0.1),
    "fig4": (1.3, 1.0, -0.3),
}
"""A, C, M3; kappa = 1260 * 0.48 / 1000, eps = 0.1, x(0) = y(0) = 1."""

PAPER3 = {"case1": (5.0, 0.4), "case2": (60.0, 1.756), "case3": (150.0, 4.196)}
"""theta(0) in degrees, and about when |Gz| = C |r|; the constants of a and b are not printed."""


def paper1(name: str, number: Number = float) -> tuple[Data, System, Data, float]:
    """A case of P1 as (A, system, start, end): what `crossings` takes."""
    resistance, start, end = PAPER1[name]
    A, I = ([number(x) for x in values] for values in (INERTIA, resistance))
    p, q = map(number, start[:2])
    r = number(start[2]) if start[2] is not None else completed(p, q, A)
    rows = [[I[0] if i == j else I[1] for j in range(3)] for i in range(3)]
    if len(I) == 9:
        rows = [I[:3], I[3:6], I[6:]]
    system = diagonal(A, I) if len(I) == 3 else tensor(A, rows)
    return A, system, (p, q, r if number is as_printed else float(r)), end


def end_of_spin(name: str, printed: bool, number: Number = float, bits: int = 192) -> Zero:
    """Where r of P2's averaged system reaches 0."""
    A, C, M3, eps, density, P0, viscosity = (
        Fraction(number(x)) for x in (*PAPER2[name], 0.1, 1260.0, 0.48, 1000.0)
    )
    system = cavity_averaged(A, C, density * P0 / viscosity, eps * M3, printed)
    return next(zeros(taylor(system, (1, 1), 60, bits), (0, 1)))


def paper3(name: str, number: Number = float) -> tuple[LagrangeAveraged, Data]:
    """A case of P3, and its (Gz, H, r) at the start, in floats or in 40 digits."""
    with mpmath.workdps(40):
        functions = mpmath if number is as_printed else math
        r, u = functions.sqrt(3), functions.cos(functions.radians(PAPER3[name][0]))
        b0 = mpmath.mpf(1) / 10 if number is as_printed else 0.1
        return LagrangeAveraged(1.5, 1.0, 0.5, (0.125, 1), (b0, 1)), (r * u, r * r / 2 + u / 2, r)


def events(number: Number = float, bits: int = 192) -> Iterator[tuple[str, str, Any, Any]]:
    """(case, event, time, |G| or x or r there) for every event of the figures' cases."""
    for name in PAPER1:
        for c in crossings(*paper1(name, number), bits):
            yield f"P1 {name}", f"x{c.before} to x{c.after}", c.time, c.momentum
    for name in PAPER2:
        for form, printed in (("averaged-as-printed", True), ("averaged", False)):
            zero = end_of_spin(name, printed, number, bits)
            yield f"P2 {name} {form}", "end of spin", zero.time, zero.state[0]
    for name, (_, near) in PAPER3.items():
        motion, start = paper3(name, number)
        yield f"P3 {name}", "u3 = 1", motion.when(start, near, lambda Gz, H, r: Gz**2 - r**2), ""

    motion, start = paper3("case3", number)
    yield "P3 case3", "Gz = 0", motion.when(start, 3.67, lambda Gz, H, r: Gz), ""


def digits(value: Any, places: int = 22) -> str:
    """A Fraction or an mpmath number to so many significant digits."""
    if isinstance(value, Fraction):
        with mpmath.workdps(2 * places):
            value = mpmath.mpf(value.numerator) / value.denominator
    return mpmath.nstr(value, places, strip_zeros=False) if value != "" else ""


def main() -> None:
    """Print the table: times for the doubles of a case file, and for the printed decimals."""
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["case", "event", "time", "value", "time_of_decimals"])
    for (case, event, time, value), (*_, decimal, _) in zip(
        events(), events(as_printed), strict=True
    ):
        table.writerow([case, event, digits(time), digits(value), digits(decimal)])


if __name__ == "__main__":
    main()
