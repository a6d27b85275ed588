"""The geometry of figures of curves in space and of the quadrants: views, the sphere, regions.
Numbers only."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .. import HodoError
from ..models import rigid_body


@dataclass(frozen=True)
class View:
    """An orthographic view, so that all axes have one scale, from an elevation above the x1 x2
    plane and an azimuth from x1, degrees."""

    angles: tuple[float, float]

    @cached_property
    def matrix(self) -> np.ndarray:
        """The directions right, up and toward the reader (3, 3), in body axes."""
        e, a = map(math.radians, self.angles)
        right = (-math.sin(a), math.cos(a), 0)
        up = (-math.sin(e) * math.cos(a), -math.sin(e) * math.sin(a), math.cos(e))
        near = (math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e))
        return np.array([right, up, near])

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) in body axes as (right, up, toward the reader)."""
        return np.asarray(points @ self.matrix.T)


def stretches(*keys: np.ndarray) -> list[slice]:
    """The stretches of a curve on which all keys (n,) are constant, each reaching to the next one's
    first sample."""
    # Each stretch reaches the next, or a line would have gaps where its colour changes.
    table = np.stack(keys, axis=-1)
    cuts = (np.flatnonzero((table[1:] != table[:-1]).any(axis=-1)) + 1).tolist()
    return [slice(a, b + 1) for a, b in zip([0, *cuts], [*cuts, len(table)], strict=True)]


def windings(curve: np.ndarray) -> float:
    """The length of a curve (n, 3) in units of its size: about 2 pi for one turn."""
    size = max(float(np.abs(curve).max()), math.ulp(0))
    return float(np.linalg.norm(np.diff(curve / size, axis=0), axis=-1).sum())


def round_step(size: float) -> float:
    """A round spacing, 1, 2 or 5 times a power of ten, of two to five marks up to `size` > 0."""
    power = 10.0 ** math.floor(math.log10(size / 2))
    return max(m * power for m in (1, 2, 5) if m * power <= size / 2)


NAMES_WITHIN = 0.93
"""How far from the middle of the unit sphere or square a name may stand, so that all of it is
within."""


def places_beside(
    curves: Sequence[np.ndarray],
    lines: Sequence[np.ndarray],
    away: float = 0.09,
    norm: float = 2,
) -> Iterator[np.ndarray]:
    """For each curve in view (n, 3) a place (2,) for its name: `away` from its point farthest from
    the others, on the reader's side if it can be, and on the side of that point where no curve,
    none of the other lines (n, 3), and no name of another curve is near. The names stay within a
    circle or, by the norm `inf`, a square.
    """
    # 200 points of each curve place a name as well as 20,000 would.
    thinned = [curve[:: max(1, len(curve) // 200)] for curve in curves]
    taken = np.concatenate([line[:: max(1, len(line) // 400)] for line in (*curves, *lines)])[:, :2]
    names: list[np.ndarray] = []
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = away * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    for i, curve in enumerate(thinned):
        near = curve[curve[:, 2] > 0] if (curve[:, 2] > 0).any() else curve
        # Names side by side would read as one.
        apart = [p for p in near if all(math.dist(p[:2], name) > 3 * away for name in names)]
        near = np.array(apart or near)
        others = np.concatenate([*thinned[:i], *thinned[i + 1 :]] or [curve[:1]])
        point = near[clearest(others, near), :2]
        around = point + ring
        size = np.linalg.norm(around, norm, axis=1)
        inside = around[size <= max(NAMES_WITHIN, size.min())]
        place = inside[clearest(taken, inside)]
        taken = np.concatenate([taken, [place]])
        names.append(place)
        yield place


def check_zoom(zoom: float, nearest: float) -> None:
    """Raise HodoError if curves that come no nearer to the origin than `nearest` are not in a panel
    that ends at `zoom`."""
    if nearest >= zoom:
        raise HodoError(
            f"zoom: {zoom:g} shows nothing: the curves come no nearer to the origin than "
            f"{nearest:.4g}"
        )


def clearest(points: np.ndarray, candidates: np.ndarray, enough: float = math.inf) -> int:
    """The number of the candidate among (m, 2) that is farthest from all points (n, 2), or of the
    first that is far enough; coordinates beyond two do not count.
    """
    # Every point is compared with every candidate: so many take some hundredths of a second.
    thinned = points[:: max(1, len(points) * len(candidates) // 2_000_000)]
    thinned, candidates = thinned[:, :2], candidates[:, :2]
    # |c - p|^2 = |c|^2 + (|p|^2 - 2 c p), by one product of matrices.
    terms = np.stack([-2 * thinned[:, 0], -2 * thinned[:, 1], (thinned**2).sum(axis=-1)])
    nearest = (np.column_stack([candidates, np.ones(len(candidates))]) @ terms).min(axis=1)
    apart = np.sqrt(np.maximum(nearest + (candidates**2).sum(axis=-1), 0))
    return int(np.minimum(apart, enough).argmax())


def edges(values: np.ndarray, ratios: bool) -> np.ndarray:
    """The edges (n + 1,) of cells about values (n,), half way between them, in even ratios or
    not."""
    x = np.log(values) if ratios else values
    if len(x) == 1:
        x = np.array([x[0] - 0.5, x[0] + 0.5])
    else:
        # The outer edges mirror the inner ones, so that the first and last cell are as wide as
        # their neighbours.
        middle = (x[1:] + x[:-1]) / 2
        x = np.concatenate([[2 * x[0] - middle[0]], middle, [2 * x[-1] - middle[-1]]])
    return np.asarray(np.exp(x) if ratios else x)


def graticule() -> list[np.ndarray]:
    """Parallels and meridians of the unit sphere about x3, 30 degrees apart, (181, 3) each."""
    turn = np.linspace(0, 2 * np.pi, 181)
    c, s = np.cos(turn), np.sin(turn)
    latitudes, longitudes = np.radians(np.arange(-60, 90, 30)), np.radians(np.arange(0, 180, 30))
    parallels = [
        np.stack([math.cos(b) * c, math.cos(b) * s, math.sin(b) + 0 * c], axis=-1)
        for b in latitudes
    ]
    meridians = [np.stack([math.cos(a) * c, math.sin(a) * c, s], axis=-1) for a in longitudes]
    return parallels + meridians


def within_separatrix(directions: np.ndarray, A: np.ndarray | None) -> np.ndarray:
    """Whether D > 0 for directions (..., 3) of G of a body with moments A (3,); False without a
    body."""
    if A is None:
        return np.zeros(directions.shape[:-1], dtype=bool)
    omega = np.moveaxis(directions / A, -1, 0)
    outer, inner = rigid_body.separatrix_terms(A, omega, rigid_body.inertia_order(A))
    return np.asarray(outer > inner)
