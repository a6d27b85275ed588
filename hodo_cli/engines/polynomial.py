"""All zeros of a step's polynomials, isolated by bounds, in the precision of their coefficients.

An engine's step is a polynomial of the time. `to_bernstein` converts it to Bernstein's basis on 0
<= x <= 1, in which a polynomial lies between its least and its largest coefficient. `isolate` finds
its zeros, and the intervals in which `rounding` hides whether it has one.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from math import comb
from typing import Any, NamedTuple

import numpy as np

from ..arithmetic import horner

TAYLOR, LEGENDRE, CHEBYSHEV = "taylor", "legendre", "chebyshev"
"""The bases of the polynomials of steps that engines return. Taylor's basis has powers of the time
since the start of the step; they become powers of x if each coefficient is multiplied by the same
power of the step's length. The polynomials of the other two are functions of x."""

HALVINGS = 64
"""Halvings after which an interval of a step is a single number even in long double."""

MOST_ITERATIONS = 80
"""The largest number of iterations for a zero, more than it ever needs: bisection alone takes 64,
one for each bit of a long double."""


class Zeros(NamedTuple):
    """Places where polynomials vanish, in order of `row` and `x`, each (k,).

    `row` is the number of the polynomial, `x` the place in [0, 1]. Around a zero that is `sure` the
    polynomial is monotone, and on both sides it is larger than its rounding. Where `sure` is False
    it is smaller than its rounding over the length `width` around x: it may vanish there any number
    of times, or never.
    """

    row: np.ndarray
    x: np.ndarray
    width: np.ndarray
    sure: np.ndarray


@lru_cache(maxsize=64)
def to_bernstein(basis: str, degree: int, dtype: np.dtype[Any]) -> np.ndarray:
    """The matrix (degree + 1, degree + 1) by which a row of coefficients in a basis is multiplied
    from the right, to give its coefficients in Bernstein's basis on [0, 1].

    It is computed in fractions and rounded once to `dtype`. For powers all its entries are in [0,
    1], so the conversion loses no digits.
    """
    terms = SCALED_BERNSTEIN[basis]
    exact = [
        [
            Fraction(
                sum(terms(k, i) * comb(degree - k, j - i) for i in range(min(j, k) + 1)),
                comb(degree, j),
            )
            for j in range(degree + 1)
        ]
        for k in range(degree + 1)
    ]
    fp = dtype.type
    return np.array([[fp(x.numerator) / fp(x.denominator) for x in row] for row in exact])


SCALED_BERNSTEIN: dict[str, Callable[[int, int], int]] = {
    TAYLOR: lambda k, i: int(i == k),
    LEGENDRE: lambda k, i: (-1) ** (k - i) * comb(k, i) ** 2,
    CHEBYSHEV: lambda k, i: (-1) ** (k - i) * comb(2 * k, 2 * i),
}
"""The integers a_i, as functions of k and i, for which polynomial k of a basis is the sum of a_i
x^i (1 - x)^(k - i). Multiplied by (x + 1 - x)^(n - k) = 1, this sum becomes one of degree n.

Source: R. T. Farouki, Journal of Computational and Applied Mathematics 119 (2000) 145; A. Rababah,
Computational Methods in Applied Mathematics 3 (2003) 608.
"""


@lru_cache(maxsize=64)
def _halves(degree: int, dtype: np.dtype[Any]) -> np.ndarray:
    """The matrices (2, degree + 1, degree + 1) that convert a row of Bernstein coefficients to the
    coefficients on each half of the interval (de Casteljau's algorithm at 1/2)."""
    # The entries of each column are positive and add up to 1, so halving amplifies no rounding.
    lower = np.array([[comb(i, j) / 2**i for i in range(degree + 1)] for j in range(degree + 1)])
    return np.array([lower, lower[::-1, ::-1]]).astype(dtype)


@lru_cache(maxsize=64)
def _binomials(degree: int, dtype: np.dtype[Any]) -> np.ndarray:
    """The binomial coefficients (degree + 1,) of a degree."""
    return np.array([comb(degree, j) for j in range(degree + 1)]).astype(dtype)


@lru_cache(maxsize=8)
def chebyshev(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """The zeros in [0, 1] of Chebyshev's polynomial of degree + 1, and the matrix (degree + 1,
    degree + 1) that converts values (m, degree + 1) of a polynomial at these zeros to its
    coefficients; in long double."""
    quarter_turn = np.arccos(np.longdouble(0))
    angles = (2 * np.arange(degree + 1) + 1) * quarter_turn / (degree + 1)
    transform = 2 * np.cos(np.outer(angles, np.arange(degree + 1))) / (degree + 1)
    transform[:, 0] /= 2
    return (np.cos(angles) + 1) / 2, transform


def weights(x: np.ndarray, degree: int) -> np.ndarray:
    """The values (..., degree + 1) of Bernstein's polynomials at places x (...); the sum of the
    values at a place is 1."""
    up, down = (np.vander(y.ravel(), degree + 1, increasing=True) for y in (x, 1 - x))
    return np.reshape(_binomials(degree, x.dtype) * up * down[:, ::-1], (*x.shape, degree + 1))


def values_and_slopes(b: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The values (n, m, k) of polynomials with Bernstein coefficients b (n, m, degree + 1), and
    their derivatives by x (n, m, k), at places x (n, k), or (1, k) if all polynomials have the same
    places."""
    degree = b.shape[2] - 1
    places, of_slope = (weights(x, n).swapaxes(1, 2) for n in (degree, degree - 1))
    return b @ places, degree * (np.diff(b, axis=2) @ of_slope)


def state_at(c: np.ndarray, length: Any, basis: str, x: Any) -> np.ndarray:
    """The state (m,) at a place x of a step of this length, from the step's coefficients c (m,
    degree + 1) in the basis of the engine, and in their precision."""
    if basis == TAYLOR:
        return np.asarray(horner(c.T, x * length))
    return np.asarray(c @ to_bernstein(basis, c.shape[1] - 1, c.dtype) @ weights(x, c.shape[1] - 1))


def rounding(c: np.ndarray, basis: str) -> np.ndarray:
    """A bound (...) on the rounding of the values of polynomials, from their coefficients (...,
    degree + 1).

    Whatever the order of its terms, a sum of n + 1 products has n + 2 roundings of half an eps,
    each relative to at most the sum of the absolute products. A product is at most a coefficient
    times the largest entry of its row of `to_bernstein`.
    """
    degree = c.shape[-1] - 1
    growth = np.abs(to_bernstein(basis, degree, c.dtype)).max(axis=1)
    return np.asarray(np.finfo(c.dtype).eps * (degree + 3) / 2 * (np.abs(c) @ growth))


def isolate(b: np.ndarray, noise: np.ndarray) -> Zeros:
    """All zeros in [0, 1] of the polynomials with the Bernstein coefficients b (n, degree + 1).

    A polynomial lies between its least and its largest coefficient, and is monotone where the
    coefficients rise or fall throughout. Intervals where neither decides are halved, until no
    coefficient in them exceeds `noise` (n,), the bound of the polynomial's rounding.

    Source: R. T. Farouki and V. T. Rajan, Computer Aided Geometric Design 4 (1987) 191.
    """
    n, degree = len(b), b.shape[1] - 1
    row, low, width, zeros = np.arange(n), np.zeros(n, dtype=b.dtype), b.dtype.type(1), []
    for halving in range(HALVINGS + 1):
        bound = noise[row][:, None]
        # The sign of a coefficient is certain if it exceeds the bound of its rounding.
        above, below = b > bound, b < -bound
        slopes = np.diff(b, axis=1)
        monotone = (slopes > 0).all(axis=1) | (slopes < 0).all(axis=1)
        single = monotone & ((above[:, 0] & below[:, -1]) | (below[:, 0] & above[:, -1]))
        undecided = ~(above.all(axis=1) | below.all(axis=1) | single)
        # In a lost interval rounding hides the sign of the whole polynomial.
        lost = undecided & ((halving == HALVINGS) | ~(above | below).any(axis=1))
        found = [row, low, np.full_like(low, width), single, b]
        zeros.append([values[single | lost] for values in found])
        split = undecided & ~lost
        if not split.any():
            break
        row, low, width = np.repeat(row[split], 2), np.repeat(low[split], 2), width / 2
        low[1::2] += width
        b = np.matmul(b[split][:, None, None, :], _halves(degree, b.dtype)).reshape(-1, degree + 1)
    row, x, widths, sure, b = (np.concatenate(column) for column in zip(*zeros, strict=True))
    # Here `x` is the left end of each interval. A sure zero moves from there to its place.
    x[sure] += widths[sure] * _refined(b[sure])
    widths[sure] = 0
    return _merged(Zeros(row, x, widths, sure))


def _merged(zeros: Zeros) -> Zeros:
    """Zeros in order of row and x. Adjacent uncertain intervals become one, with the middle as its
    x."""
    if not len(zeros.row):
        return zeros
    order = np.lexsort((zeros.x, zeros.row))
    row, low, width, sure = (column[order] for column in zeros)
    high = low + width
    # Adjacent up to rounding: the last halvings are finer than the spacing of the numbers x.
    is_adjacent = low[1:] - high[:-1] <= 4 * np.finfo(low.dtype).eps
    touching = ~sure[1:] & ~sure[:-1] & (row[1:] == row[:-1]) & is_adjacent
    first = np.flatnonzero(np.append(True, ~touching))
    last = np.append(first[1:], len(row)) - 1
    return Zeros(row[first], (low[first] + high[last]) / 2, high[last] - low[first], sure[first])


def _refined(b: np.ndarray) -> np.ndarray:
    """The one zero in [0, 1] of each monotone polynomial (n, degree + 1), to the last bits.

    Newton's method starts from the zero of the secant and keeps a bracket by the signs. Bisection
    replaces a step that leaves the bracket, and every fourth step until the bracket has become
    small.
    """
    degree = b.shape[1] - 1
    # The first and the last coefficient are the values at the ends.
    zeros = b[:, 0] / (b[:, 0] - b[:, -1])
    x, low, high = zeros.copy(), np.zeros_like(zeros), np.ones_like(zeros)
    unconverged, rising = np.arange(len(b)), b[:, -1] > 0
    c = (b * _binomials(degree, b.dtype)).T
    d = (np.diff(b, axis=1) * _binomials(degree - 1, b.dtype)).T
    for iteration in range(MOST_ITERATIONS):
        value, new = _newton(c, d, x)
        beyond = (value > 0) == rising
        low, high = np.where(beyond, low, x), np.where(beyond, x, high)
        inside = (new >= low) & (new <= high)
        # Newton's method is slow near a multiple zero: sometimes bisection halves the bracket.
        if iteration % 4 == 3:
            inside &= high - low < 0.5 ** (iteration // 2)
        new = np.where(value == 0, x, np.where(inside, new, (low + high) / 2))
        zeros[unconverged] = new
        # A converged zero is left alone, so that its last bits do not depend on other polynomials.
        moving = np.abs(new - x) > 2 * np.finfo(b.dtype).eps * new
        if not moving.any():
            break
        unconverged, x = unconverged[moving], new[moving]
        low, high = low[moving], high[moving]
        c, d, rising = c[:, moving], d[:, moving], rising[moving]
    return np.asarray(zeros)


@np.errstate(all="ignore")  # next to x = 1 powers of t overflow: `_refined` bisects
def _newton(c: np.ndarray, d: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (n,) with the signs of polynomials at x (n,), and the next places (n,) of Newton's
    method.

    With t = x/(1 - x), p = (1 - x)^n sum c_j t^j and p' = n (1 - x)^(n - 1) sum d_j t^j, where n is
    the degree. Horner's scheme on whole columns costs an eighth of Bernstein's polynomials.
    """
    rest = np.maximum(1 - x, np.finfo(x.dtype).eps / 2)
    value, slope = horner(c, x / rest), horner(d, x / rest)
    return value, x - rest * value / (len(d) * slope)
