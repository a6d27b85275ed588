"""A body with a rotor: its steady rotations against the roots of a polynomial, closed forms and
motions of the literature's kind, which know nothing of them."""

import itertools
import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp

from hodo_cli.models.theory import gyrostat
from hodo_cli.sweeps.ensemble import regions

BOTH, UNSEPARATED = 4, 5
"""The labels of a hodograph that encloses both outer axes, and where no separatrix is."""

A = np.array([1.0, 0.8, 0.6])
B = np.array([0.8, 0.5, 0.74])


def bodies(draw: np.random.Generator, n: int) -> Iterator[np.ndarray]:
    """Moments, in all orders, of bodies that exist."""
    while n:
        moments = draw.uniform(0.1, 1, 3)
        if 2 * moments.max() < moments.sum():
            n -= 1
            yield moments


def energies(A: Any, rotations: Any) -> Any:
    """2T (...) of steady rotations."""
    return rotations.s**2 * (A * rotations.G**2).sum(-1)


def kinds(rotations: Any) -> Any:
    """m, s, M (...) for a minimum, a saddle, a maximum of T on the sphere, by the sum of the
    curvatures where it is no saddle, that is where their product is not negative."""
    j, k = np.roll(rotations.c, -1, -1), np.roll(rotations.c, -2, -1)
    product, total = ((rotations.G**2 * x).sum(-1) for x in (j * k, j + k))
    return np.select([product < 0, total > 0], ["s", "m"], "M").tolist()


def region_labels(A: Any, h: Any, omega: Any, band: Any = 0.0) -> Any:
    return gyrostat.region_of(A, h, omega, band).label


def separations(A: Any, h: Any, omega: Any) -> Any:
    return gyrostat.region_of(A, h, omega)[:2]


def listed(A: Any, h: Any, momentum: float) -> list[tuple[float, float, str]]:
    """(s, 2T, kind) of every steady rotation, by s."""
    known = steady_rotations(A, h, momentum)
    return list(zip(known.s.tolist(), energies(A, known).tolist(), kinds(known), strict=True))


def test_the_steady_rotations_of_one_body() -> None:
    h = np.array([0.05, 0.1, 0.2])
    G = A * B + h
    assert (G * G).sum() == pytest.approx(1.387236, rel=1e-15)
    expected = [
        (0.94993502687524037, 1.1424188615705669, "m"),
        (1.0626095837691702, 1.3283634493689820, "m"),
        (1.1126475402527776, 1.3330514293372204, "s"),
        (1.9532476486031905, 3.2038358683241527, "M"),
    ]
    known = listed(A, h, np.sqrt(G @ G))
    assert [kind for *_, kind in known] == [kind for *_, kind in expected]
    for (s, energy, _), (true_s, true_energy, _) in zip(known, expected, strict=True):
        assert s == pytest.approx(true_s, rel=1e-15)
        assert energy == pytest.approx(true_energy, rel=2e-15)
    found = gyrostat.saddles(A, h, np.sqrt(G @ G))
    assert found.s[0] == pytest.approx([expected[2][0], math.nan], rel=1e-15, nan_ok=True)
    assert energies(A, found)[0, 0] == pytest.approx(expected[2][1], rel=2e-15)


def steady_rotations(A: Any, h: Any, momentum: float) -> gyrostat.SteadyRotations:
    """All of them, by s, of a rotor with three components: the real roots of S(s) prod (1 - s
    A_i)^2 = 0, a polynomial of degree 6, in 60 digits."""
    with mpmath.workdps(60):
        moments, rotor = ([mpmath.mpf(float(x)) for x in v] for v in (A, h))

        def times(p: list[Any], q: list[Any]) -> list[Any]:
            c = [mpmath.mpf(0)] * (len(p) + len(q) - 1)
            for (i, x), (j, y) in itertools.product(enumerate(p), enumerate(q)):
                c[i + j] += x * y
            return c

        squares = [times([1, -a], [1, -a]) for a in moments]
        whole = times(times(squares[0], squares[1]), squares[2])
        total = [-x * mpmath.mpf(float(momentum)) ** 2 for x in whole]
        for i in range(3):
            others = times(squares[i - 1], squares[i - 2])
            total = [
                x + rotor[i] ** 2 * y
                for x, y in itertools.zip_longest(total, others, fillvalue=mpmath.mpf(0))
            ]
        found = mpmath.polyroots(total[::-1], maxsteps=500, extraprec=400, asc=False)
        s = sorted(x.real for x in found if abs(x.imag) < mpmath.mpf(10) ** -30)
        e = [[1 - x * a for a in moments] for x in s]
        G = [[x / y for x, y in zip(rotor, row, strict=True)] for row in e]
        c = [[x / a for x, a in zip(row, moments, strict=True)] for row in e]
        return gyrostat.SteadyRotations(*(np.array(rows, dtype=float) for rows in (s, G, c)))


def test_saddles_are_roots_of_a_polynomial_in_four_orders_of_kinds() -> None:
    """150 bodies in all orders of the axes, with rotors of all sizes."""
    draw, orders = np.random.default_rng(1), Counter[str]()
    for moments in bodies(draw, 150):
        h = draw.normal(size=3) * 10 ** draw.uniform(-2, 0.3)
        known = listed(moments, h, 1.0)
        orders["".join(kind for *_, kind in known)] += 1
        rising = [energy for _, energy, _ in known]
        assert rising == sorted(rising)
        found = gyrostat.saddles(moments, h, 1.0)
        s = [s for s, _, kind in known if kind == "s"]
        assert found.s[0, ~np.isnan(found.s[0])] == pytest.approx(s, rel=1e-9)
        turned = np.sqrt((found.G**2).sum(-1))
        assert turned[np.isfinite(turned)] == pytest.approx(1, rel=1e-12)
    assert set(orders) == {"mM", "mmsM", "msMM", "mmssMM"}
    assert min(orders.values()) > 2


def test_what_is_steady_stays() -> None:
    """omega = s G has no rate, and a saddle is left in both directions, which a pole is not."""
    draw, seen = np.random.default_rng(2), 0
    for moments in bodies(draw, 50):
        h = draw.normal(size=3) * 0.1
        found = gyrostat.saddles(moments, h, 1.0)
        for s, G in zip(found.s[0], found.G[0], strict=True):
            if not np.isnan(s):
                omega = (G - h) / moments
                assert omega == pytest.approx(s * G, abs=1e-12)
                near = G + 1e-4 * draw.normal(size=(500, 3))
                near /= np.linalg.norm(near, axis=1, keepdims=True)
                energy = ((near - h) ** 2 / moments).sum(1) - (moments * omega * omega).sum()
                assert {True, False} == set((energy > 0).tolist())
                seen += 1
    assert seen > 40


def bodies_of_all_kinds(draw: np.random.Generator, n: int) -> Iterator[tuple[Any, Any]]:
    """Moments and rotors: some with equal moments, or without some components, or tiny ones."""
    for i, moments in enumerate(bodies(draw, n)):
        h = draw.normal(size=3) * 10 ** draw.uniform(-3, 0.3)
        kind = i % 5
        if kind == 1:
            moments[draw.integers(3)] = moments[draw.integers(3)]
        if kind in (1, 2):
            h[draw.integers(3)] = 0
        if kind == 3:
            h[draw.permutation(3)[:2]] = 0
        if kind == 4:
            h *= 10 ** draw.uniform(-9, 0, 3)
        if 2 * moments.max() < moments.sum():
            yield moments, h


def test_saddles_exist_from_a_least_momentum_on() -> None:
    draw = np.random.default_rng(12)
    for moments, h in bodies_of_all_kinds(draw, 300):
        curves = gyrostat.SaddleCurves.of(moments[None], h[None]).limited()
        least = np.sqrt(curves.least_squares())
        momentum = np.outer(np.where(np.isfinite(least), least, 1), [1 - 1e-12, 1 + 1e-12]).ravel()
        s = gyrostat.saddles(moments, h, momentum).s
        exists = ~np.isnan(s)
        assert np.array_equal(exists, momentum[:, None] > least), (moments, h)
        differ = (s[:, 0] < s[:, 1])[exists.all(1)]
        assert differ.all() or np.abs(h).min() < 1e-6, (moments, h)


@pytest.mark.parametrize("width", [0.6, 0.1, 0.0])
def test_a_cell_of_the_plane_of_energy_and_momentum_has_one_label(width: float) -> None:
    """200 bodies of all kinds, 1,000 states each, and a cell about one in ten of these: 1,000
    others are inside or not."""
    draw, held = np.random.default_rng(13), 0
    for moments, h in bodies_of_all_kinds(draw, 200):
        omega = draw.normal(size=(1000, 3)) * 10 ** draw.uniform(-1.5, 1, (1000, 1))
        omega *= np.abs(h).max() + 1e-3
        label = region_labels(moments, h, omega)
        energy, square = (moments * omega**2).sum(1), ((moments * omega + h) ** 2).sum(1)
        none = np.zeros(1000)
        steps = np.array([energy, none, none, square, none, none])
        falls = np.where(np.arange(6)[:, None] == 4, -1e-9 * square, steps)
        of_some = gyrostat.SaddleCurves.of(moments[None], h[None]).limited()
        some = np.arange(0, 1000, 10)
        curves = of_some.of_bodies(np.zeros(len(some), dtype=int))
        about = regions.cells_about(curves, falls[:, some], width)
        for cell, i in zip(np.moveaxis(about, -1, 0), some, strict=True):
            inside = regions.stays_within(cell[..., None], steps)
            if inside[i]:
                assert set(label[inside].tolist()) == {label[i]}, (moments, h, omega[i])
                held += inside.sum()
    assert held > {0.6: 1e6, 0.1: 1e6, 0.0: 2e4}[width]


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
@pytest.mark.parametrize("axis", ["x1", "x3"])
def test_a_rotor_on_an_outer_axis_has_closed_forms(axis: str, order: tuple[int, ...]) -> None:
    """The saddles stand at omega = G/A2 beside x2, then at a pole of the rotor's axis, then
    nowhere."""
    draw = np.random.default_rng(3)
    at = np.argsort(order)
    for moments in bodies(draw, 60):
        A1, A2, A3 = np.sort(moments)[::-1]
        size, sign = 10 ** draw.uniform(-2, 1), draw.choice([-1, 1])
        h = np.array([sign * size, 0, 0] if axis == "x1" else [0, 0, sign * size])[list(order)]
        gap, far, pole = (
            (A1 - A2, A3 / (A1 - A3), 1) if axis == "x1" else (A2 - A3, A1 / (A1 - A3), -1)
        )
        two, one = size * A2 / gap, size * far
        G = np.array([two * 1.001, two * 3, (two + one) / 2, one * 0.999])
        moments = np.array([A1, A2, A3])[list(order)]
        found = gyrostat.saddles(moments, h, G)
        shift = -size * size / gap if axis == "x1" else size * size / gap
        beside = G[:2] ** 2 / A2 - shift
        assert energies(moments, found)[:2] == pytest.approx(np.stack([beside] * 2, 1), rel=1e-12)
        assert (found.G[:2, :, at[1]] != 0).all()
        energy, exists = energies(moments, found)[2], ~np.isnan(found.s[2])
        assert exists.sum() == 1
        assert energy[exists] == pytest.approx(
            (G[2] + pole * size) ** 2 / (A1 if axis == "x1" else A3), rel=1e-12
        )
        assert np.isnan(found.s[3]).all()


def test_without_much_of_a_rotor_the_labels_are_those_of_D() -> None:
    draw = np.random.default_rng(4)
    for moments in bodies(draw, 40):
        omega = draw.normal(size=(200, 3))
        labels = region_labels(moments, 1e-13 * draw.normal(size=3), omega)
        a, b, c = np.sort(moments)[::-1]
        l, _, s = np.argsort(-moments)
        D = a * (a - b) * omega[:, l] ** 2 - c * (b - c) * omega[:, s] ** 2
        assert (labels == np.where(D > 0, l, s) + 1).all()
        for h in (np.zeros(3), 1e-13 * draw.normal(size=3)):
            difference, size = separations(moments, h, omega)
            assert np.abs(difference + D[:, None] / b).max() < 1e-11 * size.max()


def free_gyrostats(A: Any, h: Any, omega: Any, steps: int, dt: float = 0.1) -> Any:
    """The states (steps, n, 3) of free motions (n, 3), by a method of order 8."""
    states = []
    for _ in range(steps):
        slopes: list[Any] = []
        for row in DOP853.A[: DOP853.n_stages]:
            w = omega + dt * sum((a * k for a, k in zip(row, slopes, strict=False)), 0 * omega)
            slopes.append(np.cross(A * w + h, w) / A)
        omega = omega + dt * sum(b * k for b, k in zip(DOP853.B, slopes, strict=True))
        states.append(omega)
    return np.array(states)


def goes_round(curve: Any, pole: Any, other: Any) -> bool:
    """Whether a curve (m, 3) on the unit sphere, closed and passed many times, parts two points of
    it: by how often it winds round one on the map that has the other at infinity."""
    first = np.cross(other, [0.6, -0.64, 0.48])
    first /= np.linalg.norm(first)
    frame = np.stack([first, np.cross(other, first)], 1)
    x, y = (curve @ frame / (1 - curve @ other)[:, None] - pole @ frame / (1 - pole @ other)).T
    turned = np.unwrap(np.arctan2(y, x))
    return bool(abs(turned[-1] - turned[0]) > 4 * np.pi)


def test_hodographs_go_round_what_their_labels_say() -> None:
    """60 motions: a hodograph parts the minima, saddles and maxima as its label says."""
    draw, seen = np.random.default_rng(5), Counter[int]()
    n = 60
    A, h = np.array([*bodies(draw, n)]), 10 ** draw.uniform(-1.3, -0.2, (n, 1))
    h = h * draw.normal(size=(n, 3))
    omega = draw.normal(size=(n, 3)) / A
    omega -= h / A
    momentum = np.linalg.norm(A * omega + h, axis=1)
    h, omega = h / momentum[:, None], omega / momentum[:, None]
    states = free_gyrostats(A, h, omega, 2500)
    for i in range(n):
        label = region_labels(A[i], h[i], states[::100, i])
        assert len(set(label)) == 1
        poles = steady_rotations(A[i], h[i], 1.0)
        curve = A[i] * states[:, i] + h[i]
        curve /= np.linalg.norm(curve, axis=1, keepdims=True)
        there = list(zip(poles.G, kinds(poles), strict=True))
        infinity = next(G for G, k in there if k == "M")
        sides: tuple[list[str], list[str]] = ([], ["M"])
        for G, k in there:
            if G is not infinity:
                sides[goes_round(curve, G, infinity) is False].append(k)
        parted = {"".join(sorted(side)) for side in sides}
        l, _, s = np.argsort(-A[i]) + 1
        expected = {l: {"m"}, s: {"M"}, BOTH: {"mms", "MMs"}, UNSEPARATED: {"m", "M"}}[label[0]]
        assert expected <= parted, (i, label[0], parted)
        seen[int(label[0])] += 1
    assert {BOTH, UNSEPARATED, 1, 2, 3} <= set(seen)


def test_a_hodograph_between_two_saddles_goes_round_both_poles_of_each() -> None:
    """A fine path on the sphere from a minimum to the other minimum: below the first saddle a
    sublevel of T holds one of them, between two saddles both."""
    h = np.array([0.08, 0.05, 0.06])
    rows = listed(A, h, 1.0)
    assert [kind for *_, kind in rows] == [*"mmssMM"]
    first, last = rows[2][1], rows[3][1]
    assert first < last
    draw = np.random.default_rng(6)
    G = draw.normal(size=(20000, 3))
    G /= np.linalg.norm(G, axis=1, keepdims=True)
    omega = (G - h) / A
    energy = (A * omega * omega).sum(1)
    labels = region_labels(A, h, omega)
    assert (labels == np.select([energy < first, energy < last], [1, BOTH], 3)).all()
    assert {1, 3, BOTH} == set(labels.tolist())


def test_labels_under_damping_and_where_the_separatrix_is_lost() -> None:
    """Rotor (0, 0, .2), damping (.005, .004, .003): the true label changes once, and the saddles go
    where |G| = .5."""
    h, damping = np.array([0.0, 0.0, 0.2]), np.array([0.005, 0.004, 0.003])
    assert separations(A, h, B[None])[0][0] == pytest.approx([-0.119888 / 0.8] * 2, rel=1e-14)
    motion = solve_ivp(
        lambda t, w: (np.cross(A * w + h, w) - damping * A * w) / A, (0, 300), B, "DOP853",
        [161.139, 161.139094418748968, 161.1392, 250.518, 250.518389191375, 250.519, 300],
        rtol=1e-13, atol=1e-15,
    )  # fmt: skip
    states = motion.y.T
    assert states[-1] == pytest.approx(
        [0.23440478535149042, -0.079388459090542767, 0.29238507503116231], abs=2e-12
    )
    assert region_labels(A, h, states[[0, 2, 3, 5, 6]]).tolist() == [1, 3, 3, *[UNSEPARATED] * 2]
    difference, size = separations(A, h, states)
    assert np.nanmax(np.abs(difference[1] / size[1])) < 1e-11
    assert np.linalg.norm(A * states[1] + h) == pytest.approx(0.635386826082, abs=1e-11)
    assert np.linalg.norm(A * states[4] + h) == pytest.approx(0.5, abs=1e-11)


def test_beside_the_separatrix_no_digit_is_lost() -> None:
    """Against 50 digits, at distances down to 1e-9 from a saddle's own level: energies themselves
    would leave none of them."""
    h = np.array([0.08, 0.05, 0.06])
    top = gyrostat.saddles(A, h, 1.0)
    with mpmath.workdps(50):
        moments, rotor = ([mpmath.mpf(float(x)) for x in v] for v in (A, h))

        def steady(s: Any) -> list[Any]:
            return [x / (1 - s * a) for x, a in zip(rotor, moments, strict=True)]

        for k in range(2):
            for distance in (1e-3, 1e-6, 1e-9):
                G = top.G[0, k] + distance * np.array([0.3, -0.2, 0.9])
                omega = (G - h) / A
                exact = [mpmath.mpf(float(w)) * a + x
                         for w, a, x in zip(omega, moments, rotor, strict=True)]  # fmt: skip
                square = sum(x * x for x in exact)
                s = mpmath.findroot(
                    lambda s, square=square: sum(x * x for x in steady(s)) - square, top.s[0, k]
                )
                at = steady(s)
                c = [(1 - s * a) / a for a in moments]
                true = sum(z * (x - y) ** 2 for z, x, y in zip(c, exact, at, strict=True))
                difference, size = separations(A, h, omega[None])
                # What the rounding of omega itself makes of it.
                assert abs(difference[0, k] - true) < 1e-15 * distance + 1e-12 * size[0, k]


def test_symmetric_bodies_and_spheres() -> None:
    """An axial rotor leaves a circle of steady rotations, which is no saddle; a sphere has none.
    Without a rotor a saddle is the middle axis."""
    flat = np.array([1.0, 1.0, 0.6])
    assert np.isnan(gyrostat.saddles(flat, [0, 0, 0.1], [0.05, 1.0]).s).all()
    assert region_labels(flat, [0, 0, 0.1], B[None]).tolist() == [UNSEPARATED]
    square = np.polynomial.Polynomial([1, -1]) ** 2, np.polynomial.Polynomial([1, -0.6]) ** 2
    _, s, *_ = (square[0] * square[1] - 0.01 * square[1] - 0.0025 * square[0]).roots()
    found = gyrostat.saddles(flat, [0.1, 0, 0.05], 1.0)
    assert found.s[0] == pytest.approx([math.nan, s], rel=1e-12, nan_ok=True)
    assert np.isnan(gyrostat.saddles(np.ones(3), [0.1, 0.2, -0.2], [0.1, 1.0]).s).all()
    assert gyrostat.saddles(A, [0, 0, 0], 1.0).s.tolist() == [[1 / 0.8] * 2]


def test_many_states_at_once_and_none_without_momentum() -> None:
    h = np.array([0.05, 0.1, 0.2])
    omega = np.concatenate([np.random.default_rng(7).normal(size=(50, 3)), [-h / A, [np.nan] * 3]])
    labels = region_labels(A, h, omega)
    assert [region_labels(A, h, w[None])[0] for w in omega] == labels.tolist()
    assert labels[-2:].tolist() == [-1, -1]
    assert (region_labels(A, h, omega[:50], band=10.0) <= 0).any()
    long = gyrostat.saddles(A.astype(np.longdouble), h.astype(np.longdouble), np.longdouble(1.3))
    assert long.s.dtype == np.longdouble
    assert np.nanmax(np.abs(long.s - gyrostat.saddles(A, h, 1.3).s)) < 1e-15


@pytest.mark.parametrize("h", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.01, 0.02, 0.03)])
def test_the_separatrix_has_the_same_curves_in_all_units(h: tuple[float, ...]) -> None:
    """Two circles without a rotor, whose cone is two planes; else a curve through each saddle."""

    def curves(size: int) -> list[list[float]]:
        unit = 2.0**size
        found = gyrostat.separatrix_curves(A * unit, np.array(h) * unit, unit)
        return sorted(curve.ravel().tolist() for curve in found)

    assert len(curves(0)) == 2
    for size in (-200, 40, 200):
        np.testing.assert_allclose(curves(size), curves(0), rtol=0, atol=1e-12)


def test_the_gradient_of_a_region_is_the_slope_of_its_energies() -> None:
    """Beside a rotor, by central differences: margins and the band of the separatrix rest on it."""
    draw = np.random.default_rng(11)
    for moments in bodies(draw, 20):
        h, omega, step = draw.uniform(-0.02, 0.02, 3), draw.uniform(0.5, 1, 3), 1e-6 * np.eye(3)
        region = gyrostat.region_of(moments, h, omega[None])
        ahead, behind = (
            gyrostat.region_of(moments, h, omega + sign * step).value for sign in (1, -1)
        )
        slopes = (ahead - behind).T / 2e-6
        np.testing.assert_allclose(region.gradient[0], slopes, rtol=0, atol=1e-8)
