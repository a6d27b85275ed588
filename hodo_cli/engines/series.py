"""Power series: the Taylor coefficients of a motion, computed by the `rhs` of its model."""

from collections.abc import Callable, Sequence
from functools import partial, reduce
from operator import add
from typing import Any

from .. import arithmetic

TINY_DIVISOR = 1e-290
"""Added to a divisor that may be 0."""

CoefficientRule = Callable[[int], Any]


class Series:
    """c[0] + c[1] s + c[2] s^2 + ..., a power series whose coefficients are computed when they are
    asked for.

    A series has + - * /, ** with a constant on one side, and the functions of `arithmetic` except
    `abs`: the equations of models use no others. A coefficient may be of any type that has these
    operations too: a number, an array of one number for each motion, a symbol. The `rule` of a
    series gives its coefficient k and asks for coefficients of lower order only, so that a series
    may occur in its own rule. This solves a differential equation.

    Source: A. Jorba and M. Zou, Experimental Mathematics 14 (2005) 99, proposition 2.1.
    """

    __array_ufunc__ = None  # array * Series must not be taken apart by numpy

    def __init__(self, rule: CoefficientRule) -> None:
        self._rule, self._known = rule, list[Any]()

    def __getitem__(self, k: int) -> Any:
        # In a loop, because a rule that recursed to order 0 would exceed Python's limit for long
        # series.
        while len(self._known) <= k:
            self._known.append(self._rule(len(self._known)))
        return self._known[k]

    def _new(self, rule: CoefficientRule) -> "Series":
        return type(self)(rule)

    def _solving(self, rule: Callable[["Series", int], Any]) -> "Series":
        """The series whose coefficient k is rule(series, k), a function of its lower
        coefficients."""
        solution: Series = self._new(lambda k: rule(solution, k))
        return solution

    def __neg__(self) -> "Series":
        return self._new(lambda k: -self[k])

    def __add__(self, other: Any) -> "Series":
        if isinstance(other, Series):
            return self._new(lambda k: self[k] + other[k])
        return self._new(lambda k: self[k] if k else self[0] + other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> "Series":
        return self.__add__(-other)

    def __rsub__(self, other: Any) -> "Series":
        return (-self).__add__(other)

    def __mul__(self, other: Any) -> "Series":
        if isinstance(other, Series):
            if other is self:
                return self._new(self._square)
            return self._new(lambda k: total([self[i] * other[k - i] for i in outwards(k)]))
        return self._new(lambda k: self[k] * other)

    __rmul__ = __mul__

    def _square(self, k: int, first: int = 0) -> Any:
        """Coefficient k of the square, without products of a coefficient below `first`. By symmetry
        it takes half the products of two different series."""
        middle = [self[k // 2] * self[k // 2]] if k % 2 == 0 else []
        pairs = [self[i] * self[k - i] for i in reversed(range(first, (k + 1) // 2))]
        return total([2.0 * total(pairs), *middle] if pairs else middle)

    def __truediv__(self, other: Any) -> "Series":
        if not isinstance(other, Series):
            # One division for all coefficients: a processor divides slower than it multiplies.
            return self.__mul__(1.0 / other)

        def rule(quotient: Series, k: int) -> Any:
            # q = a/b from a = q b: the new coefficient is the only unknown of order k.
            known = [other[i] * quotient[k - i] for i in outwards(k) if i]
            return (self[k] - total(known) if known else self[k]) * (1.0 / other[0])

        return self._solving(rule)

    def __rtruediv__(self, other: Any) -> "Series":
        return self._new(partial(constant, other)).__truediv__(self)

    def __pow__(self, exponent: Any) -> "Series":
        if isinstance(exponent, float) and exponent == 0.5:
            return self.sqrt()
        if isinstance(exponent, int | float) and exponent == 0:
            return self._new(partial(constant, 1.0))
        if isinstance(exponent, int | float) and float(exponent).is_integer():
            # By products: a logarithm divides by y, which may be 0, and loses digits near 0.
            power: Series = arithmetic.whole_power(self, int(exponent))
            return power
        return self.log().__mul__(exponent).exp()

    def __rpow__(self, base: Any) -> "Series":
        return self.__mul__(arithmetic.log(base)).exp()

    def exp(self) -> "Series":
        """e to this power, from P' = y' P."""
        return self._solving(
            lambda power, k: self._slope_times(power, k) if k else arithmetic.exp(self[0])
        )

    def log(self) -> "Series":
        """The natural logarithm."""

        def rule(logarithm: Series, k: int) -> Any:
            if k == 0:
                return arithmetic.log(self[0])
            # From y' = L' y: the new coefficient is the only unknown of order k.
            known = [i / k * logarithm[i] * self[k - i] for i in outwards(k) if 0 < i < k]
            return (self[k] - total(known) if known else self[k]) * (1.0 / self[0])

        return self._solving(rule)

    def sqrt(self) -> "Series":
        """The square root."""

        def rule(root: Series, k: int) -> Any:
            if k == 0:
                return self[0] ** 0.5
            # From root^2 = y, by a third of the operations of a general power.
            rest = self[k] - root._square(k, 1) if k > 1 else self[k]
            return rest * (0.5 / root[0])

        return self._solving(rule)

    def tanh(self) -> "Series":
        """The hyperbolic tangent, from h' = (1 - h^2) y'."""
        slope: Series = self._new(lambda k: (1.0 if k == 0 else 0.0) - square[k])
        tangent: Series = self._new(
            lambda k: self._slope_times(slope, k) if k else arithmetic.tanh(self[0])
        )
        square = tangent * tangent
        return tangent

    def sin(self) -> "Series":
        """The sine."""
        return self._sine_and_cosine()[0]

    def cos(self) -> "Series":
        """The cosine."""
        return self._sine_and_cosine()[1]

    def _sine_and_cosine(self) -> tuple["Series", "Series"]:
        """The sine S and the cosine C, from S' = y' C and C' = -y' S."""
        sine: Series = self._new(
            lambda k: self._slope_times(cosine, k) if k else arithmetic.sin(self[0])
        )
        cosine: Series = self._new(
            lambda k: -self._slope_times(sine, k) if k else arithmetic.cos(self[0])
        )
        return sine, cosine

    def _slope_times(self, factor: "Series", k: int) -> Any:
        """Coefficient k > 0 of the integral of y' times a factor."""
        return total([i / k * self[i] * factor[k - i] for i in outwards(k) if i])


class Combination(Series):
    """A sum of series, each with a constant factor.

    The factors are multiplied with each other once. If every coefficient were multiplied by them,
    all later coefficients would wait: a step of tensor, whose equations divide a sum by a moment of
    inertia, took half as long again.
    """

    def __init__(self, *terms: tuple[Any, Series]) -> None:
        super().__init__(lambda k: total([factor * series[k] for factor, series in terms]))
        self.terms = terms

    def _new(self, rule: CoefficientRule) -> "Combination":
        return Combination((1.0, Series(rule)))

    def __neg__(self) -> Series:
        return self * -1.0

    def __add__(self, other: Any) -> Series:
        if isinstance(other, Series):
            return Combination(*self.terms, *terms_of(other))
        return super().__add__(other)

    __radd__ = __add__

    def __mul__(self, other: Any) -> Series:
        if not isinstance(other, Series):
            return Combination(*((factor * other, series) for factor, series in self.terms))
        if other is self or min(len(self.terms), len(terms_of(other))) > 1:
            return super().__mul__(other)
        # Multiply the terms of the longer combination by the factor of the shorter one, which has a
        # single term, before the product of the series.
        short, terms = sorted((self.terms, terms_of(other)), key=len)
        factor, series = short[0]
        if len(terms) == 1:
            return Combination((factor * terms[0][0], series * terms[0][1]))
        longer = Combination(*((factor * own, term) for own, term in terms))
        return Combination((1.0, series * Series(longer.__getitem__)))

    __rmul__ = __mul__


def terms_of(series: Series) -> tuple[tuple[Any, Series], ...]:
    """The terms (factor, series) of a series as a combination."""
    return series.terms if isinstance(series, Combination) else ((1.0, series),)


def total(terms: Sequence[Any]) -> Any:
    """The sum of one or more terms, which need not support 0 + term."""
    return reduce(add, terms)


def outwards(k: int) -> list[int]:
    """The numbers 0 to k from the middle outwards, the order in which the products of a coefficient
    are added up.

    The last terms need the coefficients just computed, and a processor adds up the others while it
    waits for these. In ascending order a step of linear-diag took a fifth longer.
    """
    return sorted(range(k + 1), key=lambda i: max(i, k - i))


def motion(
    rhs: Callable[[Any, Sequence[Any], Any], Sequence[Any]],
    t: Any,
    y: Sequence[Any],
    k: Any,
    unit: Any = 1.0,
) -> tuple[Series, list[Series]]:
    """The time and the state (m series) of a motion as power series in s, where the time is t +
    unit s and the state at s = 0 is `y` (m,)."""
    time = Series(lambda i: (t, unit)[i] if i < 2 else 0.0)

    def rates(state: list[Series]) -> list[Series]:
        of_state = rhs(time, [Combination((1.0, series)) for series in state], k)
        return [r if isinstance(r, Series) else Series(partial(constant, r)) for r in of_state]

    return time, integrals(y, rates, Series)


def integrals(
    start: Sequence[Any],
    rates: Callable[[list[Series]], list[Series]],
    new: Callable[[CoefficientRule], Series],
) -> list[Series]:
    """The solution of the differential equations y' = rates(y) from `start` (m,), as m series. The
    function `new` makes a series from a rule."""
    derivatives: list[Series] = []

    def coefficient(j: int, k: int) -> Any:
        return derivatives[j][k - 1] * (1 / k) if k else start[j]

    solution = [new(partial(coefficient, j)) for j in range(len(start))]
    derivatives += rates(solution)
    return solution


def constant(c: Any, i: int) -> Any:
    """Coefficient i of the series of a constant c."""
    return 0.0 if i else c
