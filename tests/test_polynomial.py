"""The isolation of zeros: every zero of polynomials whose zeros are known, in every basis."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import chebyshev, legendre

from hodo_cli.engines import polynomial

DTYPES = [np.dtype(np.float64), np.dtype(np.longdouble)]
EPS = float(np.finfo(float).eps)


def bernstein(roots: list[Fraction], degree: int = 12) -> np.ndarray:
    """The Bernstein coefficients of a positive polynomial times the product of (x - root)."""
    powers = [Fraction(1)]
    for c in [-root for root in roots] + [Fraction(3)] * (degree - len(roots)):
        pairs = zip([Fraction(0), *powers], [*powers, Fraction(0)], strict=True)
        powers = [a + c * b for a, b in pairs]  # times x + c
    parts = [c / comb(degree, k) for k, c in enumerate(powers)]
    sums = (sum(parts[k] * comb(j, k) for k in range(j + 1)) for j in range(degree + 1))
    return np.array([float(x) for x in sums])


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
@given(st.lists(st.integers(-300, 1300).map(lambda n: Fraction(n, 1000)), max_size=5, unique=True))
def test_every_zero_is_found(dtype: np.dtype, roots: list[Fraction]) -> None:
    b = bernstein(roots)
    found = polynomial.isolate(b.astype(dtype)[None], np.array([16 * EPS * np.abs(b).max()]))
    inside = sorted(float(root) for root in roots if 0 <= root <= 1)
    # A zero where the step is cut may be reported on both sides of the cut; these are 1e-3 apart.
    found_at = found.x[np.append(True, np.diff(found.x) > 1e-9)[: len(found.x)]].astype(float)
    assert len(found_at) == len(inside)
    slope = np.diff(b).max() - np.diff(b).min()
    np.testing.assert_allclose(found_at, inside, atol=1e-6 * slope)


@pytest.mark.parametrize("n", range(1, 13))
def test_a_pair_of_zeros_is_found_or_undecided(n: int) -> None:
    """The pair's depth is half of the square of its distance: 1e-7 apart it is at 2.5e-15."""
    gap = Fraction(1, 10**n)
    b = bernstein([Fraction(1, 3), Fraction(1, 3) + gap], degree=2)
    found = polynomial.isolate(b[None], np.array([4 * EPS * np.abs(b).max()]))
    if n <= 6:
        np.testing.assert_allclose(found.x, [1 / 3, 1 / 3 + 10.0**-n], rtol=0, atol=1e-16 * 10**n)
        assert found.sure.all()
    elif n >= 8:
        assert not found.sure.any()
        assert np.abs(found.x - 1 / 3).max() < 1e-6


def test_no_zero_is_made_up() -> None:
    b = bernstein([], degree=20)
    assert not len(polynomial.isolate(b[None], np.array([0.0])).x)


def test_nothing_but_rounding_is_one_place_of_doubt() -> None:
    found = polynomial.isolate(np.full((2, 9), 1e-17), np.full(2, 1e-16))
    assert found.row.tolist() == [0, 1]
    assert found.width.tolist() == [1, 1]
    assert not found.sure.any()


@pytest.mark.parametrize("dtype", DTYPES, ids=str)
def test_zeros_of_many_polynomials_are_those_of_each(dtype: np.dtype) -> None:
    rng = np.random.default_rng(1)
    b = rng.normal(size=(200, 8)).astype(dtype)
    noise = np.full(200, 1e-15)
    together = polynomial.isolate(b, noise)
    for i in range(0, 200, 7):
        alone = polynomial.isolate(b[i : i + 1], noise[:1])
        np.testing.assert_allclose(together.x[together.row == i], alone.x, atol=1e-12)


@pytest.mark.parametrize(
    ("basis", "values"),
    [
        (polynomial.TAYLOR, lambda x, n: x**n),
        (polynomial.LEGENDRE, lambda x, n: legendre.legval(2 * x - 1, np.eye(13)[n])),
        (polynomial.CHEBYSHEV, lambda x, n: chebyshev.chebval(2 * x - 1, np.eye(13)[n])),
    ],
)
def test_every_basis_becomes_the_same_polynomial(basis, values) -> None:
    x = np.linspace(0, 1, 41)
    for dtype in DTYPES:
        matrix = polynomial.to_bernstein(basis, 12, dtype)
        for n in range(13):
            # Bernstein's coefficients of T_12 reach 1e6: so much of the digits goes.
            ours = polynomial.weights(x.astype(dtype), 12) @ matrix[n]
            np.testing.assert_allclose(ours.astype(float), values(x, n), atol=1e-9)


def test_rounding_is_bounded() -> None:
    rng = np.random.default_rng(2)
    for basis in (polynomial.TAYLOR, polynomial.LEGENDRE, polynomial.CHEBYSHEV):
        c = rng.normal(size=(500, 13)) * 0.2 ** np.arange(13)
        single = (c @ polynomial.to_bernstein(basis, 12, DTYPES[0])).astype(np.longdouble)
        exact = c.astype(np.longdouble) @ polynomial.to_bernstein(basis, 12, DTYPES[1])
        assert (np.abs(single - exact).max(axis=1) <= polynomial.rounding(c, basis)).all()


@pytest.mark.parametrize("degree", [0, 1, 5, 16])
def test_a_polynomial_is_known_by_its_values_at_the_zeros_of_chebyshevs(degree: int) -> None:
    coefficients = np.random.default_rng(degree).normal(size=degree + 1)
    places, transform = polynomial.chebyshev(degree)
    assert ((places > 0) & (places < 1)).all()
    values = chebyshev.chebval(2 * places - 1, coefficients)
    assert np.abs(values @ transform - coefficients).max() < 1e-13
