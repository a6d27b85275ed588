"""What is foreseen of a sum of torques against HODO_SUMS motions (default 100) of each test, by a
method of Runge and Kutta from the equations as they are printed."""

import itertools
import os
from typing import Any

import numpy as np
import pytest
from scipy.integrate import DOP853

from hodo_cli import Case
from hodo_cli.models.theory import theorems as theory

MEMBERS = int(os.environ.get("HODO_SUMS", "100"))
P1 = (1.0, 0.8, 0.6)

NONE, TO_LARGEST, TO_SMALLEST, THERE_AND_BACK = map(frozenset, ((), (1,), (-1,), (1, -1)))


def cross(a: Any, b: Any) -> Any:
    """The products (n, 3) of vectors, in half the time of numpy's."""
    (a1, a2, a3), (b1, b2, b3) = a.T, b.T
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1]).T


def rates(A: Any, terms: theory.Dissipation, brake: Any, torque: Any, w: Any) -> Any:
    """omega' (n, 3): the fluid's torque as kappa (w'' + w x w') of free motion."""
    G = A * w
    free = cross(G, w) / A
    second = (cross(A * free, w) + cross(G, free)) / A
    N = np.asarray(terms.kappa)[..., None] * (second + cross(w, free))
    speed = np.sqrt((w * w).sum(-1, keepdims=True))
    damping = terms.damping + terms.quadratic * speed
    N = N - damping * G - brake * G / np.sqrt((G * G).sum(-1, keepdims=True)) + torque
    return free + N / A


SLOWEST = 0.08
"""The |omega| at which a motion is held: beside a brake there is soon nothing left of it."""


def stepped(A: Any, terms: theory.Dissipation, brake: Any, torque: Any, w: Any, h: Any) -> Any:
    """The state (n, 3) after a step."""
    slopes: list[Any] = []
    for row in DOP853.A[: DOP853.n_stages]:
        inner = w + h * sum((a * k for a, k in zip(row, slopes, strict=False)), 0 * w)
        slopes.append(rates(A, terms, brake, torque, inner))
    return w + h * sum(b * k for b, k in zip(DOP853.B, slopes, strict=True))


def motions(A: Any, terms: theory.Dissipation, brake: Any, w: Any, steps: int) -> Any:
    """The states (m, n, 3) at steps of length 0.3/|omega|."""
    states = [w]
    for _ in range(steps):
        speed = np.sqrt((w * w).sum(-1, keepdims=True))
        w = np.where(speed > SLOWEST, stepped(A, terms, brake, 0, w, 0.3 / speed), w)
        states.append(w)
    return np.array(states)


def bodies(draw: np.random.Generator, n: int) -> np.ndarray:
    """Moments (n, 3) of bodies that exist and whose separatrix is not all but the whole sphere."""
    A = draw.uniform(0.3, 1, (40 * n, 3))
    ordered = np.sort(A)
    fit = (ordered[:, 0] + ordered[:, 1] > ordered[:, 2]) & (np.diff(ordered).min(1) > 0.03)
    assert len({tuple(order) for order in np.argsort(A[fit][:n])}) == 6
    return A[fit][:n]


def starts(draw: np.random.Generator, n: int) -> np.ndarray:
    w = draw.normal(size=(n, 3))
    return w / np.linalg.norm(w, axis=1, keepdims=True) * draw.uniform(0.3, 2, (n, 1))


def member(terms: theory.Dissipation, n: int) -> theory.Dissipation:
    """One of many sums."""
    spread = terms._asdict() | {"torque": np.zeros((n + 1, 3)), "covered": [True] * (n + 1)}
    return theory.Dissipation(**{name: values[n] for name, values in spread.items()})


def outer_axes(A: Any) -> tuple[int, int]:
    """The axes of the largest and the smallest moment."""
    return int(np.argmax(A)), int(np.argmin(A))


def sides(A: Any, states: Any) -> Any:
    """1 (m, n) where D > 0, -1 where D < 0, and 0 where its sign might be an error."""
    largest, smallest = np.array([outer_axes(body) for body in A]).T
    at = np.arange(len(A))
    a, b, c = -np.sort(-A).T
    outer = a * (a - b) * states[:, at, largest] ** 2
    inner = c * (b - c) * states[:, at, smallest] ** 2
    clear = np.abs(outer - inner) > 1e-5 * (a * a * (states**2).sum(-1))
    return np.where(clear, np.sign(outer - inner), 0)


def passages(A: Any, states: Any) -> list[list[tuple[int, float, float]]]:
    """For each member its crossings: the side after, and |G| before and after."""
    found = []
    clear, G = sides(A, states), np.sqrt(((A * states) ** 2).sum(-1))
    for n in range(len(A)):
        at = np.flatnonzero(clear[:, n])
        turned = np.flatnonzero(np.diff(clear[at, n]))
        found.append([(int(clear[at[i + 1], n]), G[at[i], n], G[at[i + 1], n]) for i in turned])
    return found


def assert_there_and_back(passed: list[tuple[int, float, float]], turning: Any) -> None:
    """That a motion crosses at most once under the fluid, and then at most once under damping."""
    fluid, damping, _ = turning
    assert [side for side, _, after in passed if after > fluid] in ([], [1])
    assert [side for side, before, _ in passed if before < damping] in ([], [-1])


def random_terms(draw: np.random.Generator, n: int, *names: str) -> theory.Dissipation:
    size = {"damping": 0.02, "quadratic": 0.02}
    given: dict[str, Any] = {
        name: scale * draw.uniform(0, 1, (n, 3)) * (name in names) for name, scale in size.items()
    }
    A = bodies(draw, n)
    # As strong as the damping at |G| near 1.
    a, b, c = -np.sort(-A).T
    beside = (a - c) * (b * (a + c - b) + 2 * a * c) / (3 * (a * b * c) ** 2)
    kappa = 0.02 * draw.uniform(0, 1, n) / beside * ("kappa" in names)
    return theory.Dissipation(A, **given, kappa=kappa)


SUMS = ["damping", "quadratic", "damping quadratic", "kappa", "kappa damping", "kappa quadratic",
        "kappa damping quadratic"]  # fmt: skip


@pytest.mark.parametrize("names", SUMS)
def test_no_motion_crosses_otherwise(names: str) -> None:
    draw = np.random.default_rng(SUMS.index(names))
    terms = random_terms(draw, MEMBERS, *names.split())
    brake = 0.002 * draw.integers(0, 2, (MEMBERS, 1))
    w = starts(draw, MEMBERS)
    A = np.asarray(terms.inertia)
    crossed = 0
    for n, passed in enumerate(passages(A, motions(A, terms, brake, w, 800))):
        one = member(terms, n)
        allowed, turning = theory.possible_crossings(one), theory.turning_momenta(one)
        senses = [sense for sense, *_ in passed]
        crossed += len(senses)
        expected = {NONE: [[]], TO_LARGEST: [[], [1]], TO_SMALLEST: [[], [-1]]}
        assert senses in expected.get(allowed, [senses])
        # An axis that is kept is entered, if at all, by the last crossing.
        for side, axis in zip((1, -1), outer_axes(A[n]), strict=True):
            kept = theory.axes_never_left(one)
            assert axis + 1 not in kept or side not in senses[:-1]
        if allowed == THERE_AND_BACK:
            assert_there_and_back(passed, turning)
    assert crossed > MEMBERS / 20


def test_fluid_with_equal_quadratic_drag_goes_there_and_back() -> None:
    """Where the drag's coefficients are the same for the outer axes, only |G| is touched by it."""
    draw, many = np.random.default_rng(9), 2 * MEMBERS
    terms = random_terms(draw, many, "kappa", "damping")
    terms = terms._replace(quadratic=np.full((many, 3), 0.003))
    A, each = np.asarray(terms.inertia), [member(terms, n) for n in range(many)]
    allowed = [theory.possible_crossings(sum_of) for sum_of in each]
    assert allowed.count(THERE_AND_BACK) > many / 3
    both = 0
    for n, passed in enumerate(passages(A, motions(A, terms, 0, starts(draw, many), 1500))):
        if allowed[n] == THERE_AND_BACK:
            assert_there_and_back(passed, theory.turning_momenta(each[n]))
            both += len(passed) == 2
    assert both


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
def test_the_axes_are_those_of_the_body_in_any_order(order: tuple[int, ...]) -> None:
    def given(values: tuple[float, ...]) -> np.ndarray:
        return np.array(values)[list(order)]

    def places(chosen: Any) -> frozenset[int]:
        return frozenset((np.flatnonzero(chosen) + 1).tolist())

    A = given(P1)
    to_smallest = theory.Dissipation(A, given((0.005, 0.004, 0.003)), given((0.01, 0.008, 0.006)))
    assert theory.possible_crossings(to_smallest) == TO_SMALLEST
    assert theory.axes_never_left(to_smallest) == places(A == 0.6)
    to_largest = theory.Dissipation(A, given((0.003, 0.004, 0.005)), kappa=0.01)
    assert theory.axes_never_left(to_largest) == places(A == 1)
    equal = theory.Dissipation(A, (0.01,) * 3, (0.02,) * 3)
    assert theory.axes_never_left(equal) == places(A != 0.8)


@pytest.mark.parametrize(
    ("terms", "expected"),
    [
        (theory.Dissipation(P1), NONE),
        (theory.Dissipation((1.0, 1.0, 0.6), (0.1, 0, 0), kappa=1.0), NONE),
        (theory.Dissipation((1.0, 0.6, 0.6), (0, 0, 0.1)), NONE),
        (theory.Dissipation(P1, (-0.01, 0, 0)), TO_LARGEST),
        (theory.Dissipation(P1, (0.02, 0, 0), (0.01, 0, 0.02)), None),
        (theory.Dissipation(P1, kappa=0.1, quadratic=(0.02, 0, 0)), None),
        # Where |omega| counts beside |G|, the sense turns at no one size.
        (theory.Dissipation(P1, (0.02, 0, 0), (0.02, 0, 0), kappa=0.1), None),
        # Negative damping may make G grow, so that the sense turns more than once.
        (theory.Dissipation(P1, (0.02, -0.1, 0), kappa=0.1), None),
        (theory.Dissipation((1e-100, 0.8e-100, 0.6e-100), (0.02, 0, 0), kappa=1e-250),
         THERE_AND_BACK),
    ],
)  # fmt: skip
def test_single_sums(terms: theory.Dissipation, expected: frozenset[int] | None) -> None:
    assert theory.possible_crossings(terms) == expected


def test_moments_of_any_size_turn_at_the_same_shape() -> None:
    plain = theory.turning_momenta(theory.Dissipation(P1, (0.005, 0, 0.003), kappa=1.0))
    for size in (1e-100, 1e100):
        A = np.array(P1) * size
        scaled = theory.turning_momenta(theory.Dissipation(A, (0.005, 0, 0.003), kappa=size))
        assert [float(x) / size for x in scaled] == pytest.approx([float(x) for x in plain])


def growth_of_a_tilt(terms: theory.Dissipation, omega: Any, **more: Any) -> Any:
    """The rates (3,) at which a tilt grows from each axis at the speed of omega (3,)."""
    rows = {key: np.asarray(x).tolist() for key, x in terms._asdict().items() if key != "covered"}
    initial = dict(zip("pqr", np.asarray(omega, float).tolist(), strict=True))
    common = {"model": "torques", "initial": initial, "time": {"end": 1}}
    return Case.of({**common, **rows, **more}).system.tilt_growth(0.0)


@pytest.mark.parametrize("outer", [0, 1])
def test_a_tilt_grows_at_the_rate_of_the_sum(outer: int) -> None:
    """The growth of the distance of the hodograph from the axis, under sums of all terms."""
    draw = np.random.default_rng(3 + outer)
    A = bodies(draw, 250)
    A = A[np.diff(np.sort(A)).min(1) > 0.12][:25]
    n, at = len(A), np.arange(len(A))
    axis = np.array([outer_axes(body)[outer] for body in A])
    media, kappa = draw.uniform(0, 5e-5, (2, n, 3)), draw.uniform(0, 5e-5, n) * A.prod(1)
    torque = np.zeros((n, 3))
    torque[at, axis] = draw.uniform(-5e-5, 5e-5, n)
    terms = theory.Dissipation(A, *media, kappa=kappa, torque=torque)
    w = np.full((n, 3), 1e-6)
    w[at, axis] = draw.uniform(0.5, 1.5, n) * draw.choice([-1, 1], n)
    weights = np.abs(A[at, axis][:, None] - A) * A

    def distance(w: Any) -> Any:
        return np.sqrt((weights * w * w).sum(-1)) / np.abs(w[at, axis])

    first, steps, h = w, 1500, 0.3
    for _ in range(steps):
        w = stepped(A, terms, 5e-5, torque, w, h)
    measured = np.log(distance(w) / distance(first)) / (h * steps)
    # The speed changes by some per cent meanwhile: that of the middle stands for all.
    speeds = np.eye(3)[axis] * ((first + w) / 2)[at, axis][:, None]
    sums = (member(terms, i)._replace(torque=torque[i]) for i in range(n))
    rates = [growth_of_a_tilt(x, w, brake=5e-5) for x, w in zip(sums, speeds, strict=True)]
    assert np.abs(measured - np.array(rates)[at, axis]).max() < 5e-6


def test_equal_rates_cancel_and_the_middle_axis_has_none() -> None:
    growth = growth_of_a_tilt(theory.Dissipation(P1, (0.1 + 0.2, 0.3, 0.3)), np.ones(3))
    assert growth[[0, 2]].tolist() == [0, 0]
    assert np.isnan(growth[1])
    symmetric = growth_of_a_tilt(theory.Dissipation((1, 1, 0.6)), np.ones(3))
    assert np.isnan(symmetric).tolist() == [True, True, False]
