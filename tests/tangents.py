"""Random tensors tuned so that D touches zero almost, or passes it twice at any small distance.

`near_tangents` draws a body and a tensor, moves the start until D has an extremum at zero, and then
an entry of the tensor that is so small that its last bit moves D by less than 1e-20. All of it in
the big integers of `series`.
"""

import random
from collections.abc import Callable, Iterator
from fractions import Fraction
from operator import mul
from typing import Any, NamedTuple

import series

BITS = 160


class Extremum(NamedTuple):
    """An extremum of a linear form: when, its value and its second derivative there."""

    time: Fraction
    value: Fraction
    curvature: Fraction


class Tangent(NamedTuple):
    """A body, its tensor and start, the horizon, every crossing, and how far apart the tuned pair
    is: there is none where this is negative, and D stays as far from 0 as it would pass it by."""

    A: tuple[float, ...]
    I: tuple[tuple[float, ...], ...]
    start: tuple[float, ...]
    end: float
    crossings: list[series.Crossing]
    separation: float


def extrema(A: Any, I: Any, start: Any, end: float, side: int) -> Iterator[Extremum]:
    """The extrema of a w_l - side b w_s."""
    largest, middle, smallest = sorted(range(3), key=lambda i: -A[i])
    Al, Am, As = (Fraction(A[i]) for i in (largest, middle, smallest))
    form = [Fraction(0)] * 3
    form[largest], form[smallest] = (
        series._root(Al * (Al - Am), BITS),
        -side * series._root(As * (Am - As), BITS),
    )
    for step in series.taylor(series.tensor(A, I), start, end, BITS):
        weights = [series._fixed(w, BITS) for w in form]
        p = [sum(map(mul, weights, terms)) >> BITS for terms in zip(*step.series, strict=True)]
        slope = [n * c for n, c in enumerate(p)][1:]
        bend = [n * c for n, c in enumerate(slope)][1:]
        try:
            for s, _ in series._roots(slope, BITS):
                scale = Fraction(1 << BITS, step.h)
                unit = Fraction(1, 1 << BITS)
                yield Extremum(
                    step.time(s),
                    series._value(p, s, BITS) * unit,
                    series._value(bend, s, BITS) * unit * scale * scale,
                )
        except ArithmeticError:
            continue


def near_tangents(seed: int, separations: list[float], span: float = 12.0) -> Iterator[Tangent]:
    """One motion for each separation of its pair of crossings, or none if the draw has no extremum
    to tune."""
    rng = random.Random(seed)
    A = [1.0, rng.uniform(0.65, 0.95), 0.0]
    A[2] = rng.uniform(max(1.02 - A[1], 0.4), A[1] - 0.05)
    rng.shuffle(A)
    size = 10 ** rng.uniform(-2, -0.3)
    root = [[rng.gauss(0, 1) for _ in range(3)] for _ in range(3)]
    I = [
        [size * sum(root[i][k] * root[j][k] for k in range(3)) for j in range(3)] for i in range(3)
    ]
    if rng.random() < 0.5:
        I = [[x + size * rng.gauss(0, 0.3) for x in row] for row in I]
    largest, middle, smallest = sorted(range(3), key=lambda i: -A[i])
    side = rng.choice((1, -1))
    fine = rng.choice([(largest, middle), (smallest, middle)])
    I[fine[0]][fine[1]] = size * 1e-6
    start = [rng.uniform(0.3, 1) * rng.choice((1, -1)) for _ in range(3)]

    def extremum(near: float | None = None) -> Extremum | None:
        found = [e for e in extrema(A, I, start, span, side) if 0.5 < e.time < span - 0.5]
        if not found:
            return None
        if near is None:
            return min(found, key=lambda e: abs(e.value))
        return min(found, key=lambda e: abs(e.time - near))

    if (touch := _touching(start, smallest, extremum)) is None:
        return
    base, at = I[fine[0]][fine[1]], float(touch.time)
    I[fine[0]][fine[1]] = base * 1.5
    moved = extremum(at)
    rate = float(moved.value - touch.value) / (base / 2) if moved else 0.0
    if abs(rate) < 1e-4:  # the last bit of the entry must move D, but by less than 1e-20
        return
    for separation in separations:
        target = -float(touch.curvature) * separation * abs(separation) / 8
        I[fine[0]][fine[1]] = base
        for _ in range(3):
            if (current := extremum(at)) is None:
                return
            I[fine[0]][fine[1]] += (target - float(current.value)) / rate
        found = series.crossings(A, series.tensor(A, I), start, at + 1, BITS)
        resistance = tuple(tuple(row) for row in I)
        yield Tangent(tuple(A), resistance, tuple(start), at + 1, found, separation)


def _touching(
    start: list[float], moved: int, extremum: Callable[..., Extremum | None]
) -> Extremum | None:
    """Move a component of the start by Newton's method until an extremum is 0, to the last
    digits."""
    best = extremum()
    if best is None or abs(best.value) > 0.2:
        return None
    for _ in range(30):
        step = 1e-6
        start[moved] += step
        beside = extremum(float(best.time))
        start[moved] -= step
        if beside is None or beside.value == best.value:
            return None
        change = float(best.value) * step / float(beside.value - best.value)
        if abs(change) > 0.3:
            return None
        start[moved] -= change
        best = extremum(float(best.time))
        if best is None or abs(best.value) < 1e-14:
            return best
    return None
