"""Which axis the hodograph of the angular momentum encloses, and when it changes."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..models import rigid_body
from .driver import Step
from .error import extended, references
from .solve import Solution, solve, stored

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
    """Labels (n,) of a motion's samples, as in `rigid.LABELS`, its crossings, and what is to be
    said about them."""

    labels: np.ndarray
    crossings: tuple[Crossing, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass
class Sides:
    """Watches a motion step by step and keeps the crossings of D = 0 that are beyond doubt.

    The motion has changed sides when |D| has stood first with one sign, then with the other, above
    what an error of `band` relative to |omega| makes of its two terms, which near the middle axis
    is much. So neither a start on D = 0, nor a touch, nor a stretch in which D is nothing but
    rounding makes a crossing, and no root that an engine reports twice or loses between two steps
    changes the list. At the start itself |omega| has no error.
    """

    A: np.ndarray
    order: tuple[int, int, int]
    band: float
    started: bool = False
    side: int = 0
    roots: list[tuple[float, np.ndarray, int]] = field(default_factory=list)
    crossings: list[Crossing] = field(default_factory=list)

    def __call__(self, step: Step) -> None:
        before = step.start
        if not self.started:
            self.started, self.side = True, self.label(step.dense(before).astype(float))
        elif not self.side:
            self.look(step, before)
        for hit in step.hits:
            self.look(step, (before + hit.time) / 2)
            self.roots.append((step.at(hit.time), hit.state, step.units.size))
            before = hit.time
        self.look(step, step.end)

    def label(self, omega: np.ndarray) -> int:
        """The side on which a state without error stands; 0 on the separatrix."""
        axis = int(rigid_body.enclosed_axis(self.A, omega, self.band))
        return {self.order[0] + 1: 1, self.order[2] + 1: -1}.get(axis, 0)

    def look(self, step: Step, time: float) -> None:
        """Note the side on which the motion stands at a time inside the step, if it is beyond
        doubt."""
        state = step.dense(time)
        omega = state.astype(float)
        outer, inner = rigid_body.separatrix_terms(self.A, omega, self.order)
        near = rigid_body.near_middle_axis(self.A, omega, self.order)
        if not abs(outer - inner) * np.sqrt(near) > self.band * (outer + inner):
            return
        side = 1 if outer > inner else -1
        if side == -self.side:
            here = step.at(time), state, step.units.size
            at, where, size = self.roots[len(self.roots) // 2] if self.roots else here
            axes = self.order[0] + 1, self.order[2] + 1
            start, end = axes if side < 0 else axes[::-1]
            momentum = float(np.sqrt(np.square(self.A * where.astype(float)).sum()))
            self.crossings.append(Crossing(at, start, end, float(np.ldexp(momentum, size))))
        self.side = side
        self.roots.clear()


def classify(
    case: Case, method: str, tol: float, error: float, omega: np.ndarray
) -> Classification:
    """Label the stored samples of a case and find its crossings.

    `method`, `tol` and `error` are those recorded with the stored omega (n, 3). The case is
    integrated again, with events: the labels come from its scaled state, which has them even where
    omega is below the smallest double.

    Raises HodoError if the motion differs from the stored one by more than its error allows.
    """
    A = np.array(case.data["inertia"])
    band = 8 * max(EPS, 0.0 if math.isnan(error) else error)
    solution, crossings = cross(case, method, case.precision, tol, band)
    again = stored(case, solution.path)["omega"][: len(omega)]
    allowed = 1e-12 + (100 * tol if math.isnan(error) else 4 * error)
    apart = relative_distance(again, omega[: len(again)])
    if apart > allowed or (len(again) < len(omega) and solution.whole):
        raise HodoError(
            f"{case.name}: the stored motion differs from its case by {apart:.1e}, and its error allows {allowed:.1e}; "
            "run it again with --force"
        )
    labels = np.full(len(omega), rigid_body.UNDETERMINED, dtype=np.int8)
    labels[: len(again)] = rigid_body.enclosed_axis(
        A, extended(solution.path.state[: len(omega)]), band
    )
    found, warnings = checked(case, method, solution, crossings, band)
    if len(again) < len(omega):
        warnings += (f"no labels after {len(again)} samples: {solution.message}",)
    return Classification(labels, found, warnings)


def cross(
    case: Case, method: str, precision: str, tol: float | None, band: float
) -> tuple[Solution, list[Crossing]]:
    """Integrate a case with a watch on the separatrix."""
    A = case.data["inertia"]
    sides = Sides(np.array(A), rigid_body.inertia_order(A), band)
    events = case.system.class_events
    solution = solve(case, method, precision, tol, events=events, witness=sides)
    return solution, sides.crossings


def checked(
    case: Case, method: str, solution: Solution, crossings: list[Crossing], band: float
) -> tuple[tuple[Crossing, ...], tuple[str, ...]]:
    """The crossings with their errors, measured against the next precision, and warnings."""
    if case.error != "on":
        return tuple(crossings), ()
    for precision, reference_method, tol in references(case, method, solution.tol):
        reference, theirs = cross(case, reference_method, precision, tol, band)
        if (solution.whole and not reference.whole) or (
            tol is not None and reference.tol == solution.tol
        ):
            continue
        if [(c.start, c.end) for c in crossings] == [(c.start, c.end) for c in theirs]:
            pairs = zip(crossings, theirs, strict=True)
            # No error is called smaller than the rounding of the time itself.
            return tuple(
                replace(a, error=max(abs(a.time - b.time), math.ulp(a.time) / 2)) for a, b in pairs
            ), ()
        finer = f"{reference_method} in {precision} precision"
        lists = f"{len(crossings)} by {method}, {len(theirs)} by {finer}, which are stored"
        return tuple(theirs), (f"the crossings hang on the last digits of the data: {lists}",)
    return tuple(crossings), ()


def relative_distance(a: np.ndarray, b: np.ndarray) -> float:
    """The largest |a - b| / |b| over the samples (n, 3); 0 where both are 0."""
    size = np.max(np.abs(b), axis=-1, initial=0, keepdims=True)
    scale = np.where(size > 0, size, 1)
    off = np.sqrt(np.square(a / scale - b / scale).sum(axis=-1))
    return float(np.max(off, initial=0))
