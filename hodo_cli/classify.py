"""Which axis the hodograph of the angular momentum encloses, and when it changes."""

import math
from dataclasses import dataclass, field

import numpy as np

from . import HodoError, rigid
from .case import Case
from .integrate import Solution, Step, extended, references, solve, stored
from .models import find

EPS = 2.0**-52


@dataclass(frozen=True)
class Crossing:
    """A passage through the separatrix: when, from which axis to which, and |G| there.

    `error` is the measured error of `time`.
    """

    time: float
    start: int
    end: int
    momentum: float
    error: float = math.nan


@dataclass(frozen=True)
class Classification:
    """Labels (n,) of a motion's samples, as in `rigid.LABELS`, its crossings, and what is to be said about them."""

    labels: np.ndarray
    crossings: tuple[Crossing, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass
class Sides:
    """Watches a motion step by step and keeps the crossings of D = 0 that are beyond doubt.

    The motion has changed sides when |D| has stood above `band` times its two terms first with one sign, then
    with the other. So neither a start on D = 0, nor a touch, nor a stretch in which D is nothing but rounding
    makes a crossing, and no root that an engine reports twice or loses between two steps changes the list.
    """

    A: np.ndarray
    order: tuple[int, int, int]
    band: float
    side: int = 0
    roots: list[tuple[float, np.ndarray, int]] = field(default_factory=list)
    crossings: list[Crossing] = field(default_factory=list)

    def __call__(self, step: Step) -> None:
        times = [hit.time for hit in step.hits]
        ends = [*times[1:], step.end]
        if step.hits or self.side == 0:
            self.look(step, step.start if not times else (step.start + times[0]) / 2)
        for hit, following in zip(step.hits, ends, strict=True):
            self.roots.append((step.at(hit.time), hit.state, step.units.size))
            self.look(step, (hit.time + following) / 2)
        self.look(step, step.end)

    def look(self, step: Step, time: float) -> None:
        """Note the side on which the motion stands at a time inside the step, if it is beyond doubt."""
        state = step.dense(time)
        outer, inner = rigid.separatrix_terms(self.A, state.astype(float), self.order)
        if not abs(outer - inner) > self.band * (outer + inner):
            return
        side = 1 if outer > inner else -1
        if side == -self.side:
            at, where, size = self.roots[len(self.roots) // 2] if self.roots else (step.at(time), state, step.units.size)
            axes = self.order[0] + 1, self.order[2] + 1
            start, end = axes if side < 0 else axes[::-1]
            momentum = float(np.sqrt(np.square(self.A * where.astype(float)).sum()))
            self.crossings.append(Crossing(at, start, end, float(np.ldexp(momentum, size))))
        self.side = side
        self.roots.clear()


def classify(case: Case, method: str, tol: float, error: float, omega: np.ndarray) -> Classification:
    """Label the stored samples of a case and find its crossings.

    `method`, `tol` and `error` are those recorded with the stored omega (n, 3). The case is integrated again,
    with events: the labels come from its scaled state, which has them even where omega is below the smallest
    double.

    Raises HodoError if the motion differs from the stored one by more than its error allows.
    """
    model = find(case.model, case.form)
    A = np.array(case.data["inertia"])
    band = 8 * max(EPS, 0.0 if math.isnan(error) else error)
    solution, crossings = cross(case, method, case.precision, tol, band)
    again = stored(case, solution.path)["omega"][: len(omega)]
    allowed = 1e-12 + (100 * tol if math.isnan(error) else 4 * error)
    apart = relative_distance(again, omega[: len(again)])
    if apart > allowed or (len(again) < len(omega) and not case.max_seconds):
        raise HodoError(
            f"{case.name}: the stored motion differs from its case by {apart:.1e}, more than the {allowed:.1e} that its "
            "error allows; run it again with --force"
        )
    labels = rigid.enclosed_axis(A, extended(solution.path.state), band)
    labels = np.append(labels, np.full(len(omega) - len(again), rigid.UNDETERMINED, dtype=np.int8))
    assert model.class_events(case.data)
    return Classification(labels, *checked(case, method, solution, crossings, band))


def cross(case: Case, method: str, precision: str, tol: float | None, band: float) -> tuple[Solution, list[Crossing]]:
    """Integrate a case with a watch on the separatrix."""
    model = find(case.model, case.form)
    sides = Sides(np.array(case.data["inertia"]), rigid.inertia_order(case.data["inertia"]), band)
    solution = solve(case, method, precision, tol, events=model.class_events(case.data), witness=sides)
    return solution, sides.crossings


def checked(
    case: Case, method: str, solution: Solution, crossings: list[Crossing], band: float
) -> tuple[tuple[Crossing, ...], tuple[str, ...]]:
    """The crossings with their errors, measured against the next precision, and warnings."""
    if case.error != "on":
        return tuple(crossings), ()
    for precision, reference_method, tol in references(case, method, solution.tol):
        reference, theirs = cross(case, reference_method, precision, tol, band)
        if reference.stop and not solution.stop:
            continue
        if [(c.start, c.end) for c in crossings] == [(c.start, c.end) for c in theirs]:
            pairs = zip(crossings, theirs, strict=True)
            return tuple(Crossing(a.time, a.start, a.end, a.momentum, abs(a.time - b.time)) for a, b in pairs), ()
        warning = f"{len(crossings)} crossings by {method}, {len(theirs)} by {reference_method} in {precision} precision"
        return tuple(theirs), (f"the crossings are beyond the precision of the data: {warning}, which is stored",)
    return tuple(crossings), ()


def relative_distance(a: np.ndarray, b: np.ndarray) -> float:
    """The largest |a - b| / |b| over the samples (n, 3); 0 where both are 0."""
    size = np.max(np.abs(b), axis=-1, initial=0, keepdims=True)
    scale = np.where(size > 0, size, 1)
    off = np.sqrt(np.square(a / scale - b / scale).sum(axis=-1))
    return float(np.max(off, initial=0))
