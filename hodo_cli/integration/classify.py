"""Which axis the hodograph of the angular momentum encloses, and when it changes."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..engines import extended
from ..engines.protocol import EPS, PRECISION
from ..models import rigid_body
from ..models.rigid_body import BodyFrame
from .choice import best
from .crossings import (
    CERTAIN_ERRORS,
    Crossing,
    CrossingList,
    CrossingSearch,
    SignChanges,
    has_sides,
    read_sign_changes,
    sides_of,
)
from .driver import Occurrence, at_rest
from .error import error_of_variable, judged_events, references, with_step_limit
from .solve import Trajectory, distinct, even_times, sample_times, solve

ERROR_CHECKS = 513
"""Times besides the samples at which the error of a motion is measured: a case may have few."""

ROUNDING_TOL = 1e-13
"""Up to this tolerance the error of a motion in double precision is that of its rounding."""

UNMEASURED_ERROR_IN_TOLS = 100.0
"""The error of a motion, in tolerances, where none was measured: what the worst of the solvers
reach, see DOP853 and LSODA in `hodo bench`."""

MIN_UNMEASURED_ERROR = 1e-9
"""The least error at which a motion is judged where its error is not measured: rounding alone does
not reach it in the steps that a motion may take. Where it would decide, a reference is asked."""


@dataclass(frozen=True)
class Classification:
    """Labels (n,) of a motion's samples, as in `rigid_body.LABELS`, its crossings, and warnings.

    `growth` (3,) are the rates at which a small tilt away from each axis grows, None where none can
    be told; `predictions` are sentences of theory. `hidden` is set where the error of the motion
    hides a crossing, or which list of them is right. `events` are those of the motion itself.
    """

    labels: np.ndarray
    crossings: tuple[Crossing, ...] = ()
    warnings: tuple[str, ...] = ()
    growth: np.ndarray | None = None
    hidden: bool = False
    predictions: tuple[str, ...] = ()
    events: tuple[Occurrence, ...] = ()


def classify(
    case: Case, method: str, tol: float, error: float, omega: np.ndarray
) -> Classification:
    """Label the stored samples of a case and find its crossings.

    `method`, `tol` and `error` are those recorded with the stored omega (n, 3). The case is
    integrated again, with a search for the zeros of D, and so is the reference of its error, unless
    the motion stays beyond any error of its method on one side. The labels come from the scaled
    state, which has them even where omega is below the smallest double, and from the error at their
    own time.

    Raises HodoError if the motion differs from the stored one by more than its error allows.
    """
    if case.time.runs_backward:
        rising = replace(case, time=case.time.rising)
        return in_time_of(case, classify(rising, method, tol, error, omega))
    unmeasured = UNMEASURED_ERROR_IN_TOLS * max(EPS, tol)
    expected = unmeasured if math.isnan(error) else max(EPS, error)
    # Also of an error that was measured, because between few samples it may be larger.
    largest = max(MIN_UNMEASURED_ERROR, expected, unmeasured)
    dense = searched(case, method, case.precision, tol, CERTAIN_ERRORS * largest)
    motion, samples = dense.motion, dense.rows[: len(omega)]
    check_stored(motion, samples, omega, expected)
    absorbing = absorbing_axes(case)
    everywhere, reference = labels_on_one_side(dense, largest), None
    listed = CrossingList([], [], [])
    if everywhere is None:
        assumed = largest if math.isnan(error) else expected
        errors, reference = against_reference(dense, assumed, absorbing)
        listed, everywhere = crossings_of(dense, errors, absorbing), sample_labels(motion, errors)
    labels = np.full(len(omega), rigid_body.UNDETERMINED, dtype=np.int8)
    labels[: len(samples)] = everywhere[samples]
    labels = with_hidden_labels(labels, absorbing)
    crossings, warnings = (
        resolve_conflicts(listed, reference)
        if reference
        else (listed.crossings, undecided_warning(listed.undecided))
    )
    hidden = bool(warnings)
    if len(samples) < len(omega):
        warnings += (f"no labels after {len(samples)} samples: {motion.message}",)
    system, time = case.system, case.time
    return Classification(
        labels=labels,
        crossings=tuple(crossings),
        warnings=warnings,
        growth=system.tilt_growth(time.start),
        hidden=hidden,
        predictions=tuple(system.predictions(time.start, time.end)),
        events=judged_events(motion, reference.motion) if reference else motion.events,
    )


def own_crossings(motion: Trajectory) -> list[Crossing]:
    """The crossings of a motion by quadrature, which are its events."""
    return [
        Crossing(e.time, int(e.details["from"]), int(e.details["to"]), e.details["G"], e.error)
        for e in motion.events
    ]


def in_time_of(case: Case, found: Classification) -> Classification:
    """What was found of a motion that runs backward, by a time with another sign, in that of its
    case."""
    crossings = tuple(replace(crossing, time=-crossing.time) for crossing in found.crossings)
    events = tuple(replace(event, time=-event.time) for event in found.events)
    growth = case.system.tilt_growth(case.time.start)
    # What theory says of the motion forward does not count.
    theory = replace(found, growth=growth, predictions=())
    return replace(theory, crossings=crossings, events=events)


def absorbing_axes(case: Case) -> frozenset[int]:
    """The axes that a motion never leaves once it encloses them."""
    span = case.time.start, case.time.end
    return frozenset() if case.time.mirrored else case.system.absorbing_axes(*span)


def sample_labels(motion: Trajectory, errors: np.ndarray) -> np.ndarray:
    """The label of each sample of a motion (n,), with these errors (n,)."""
    body = body_of(motion.case)
    axes = body.enclosed(extended(motion.omega), CERTAIN_ERRORS * errors)
    resting = at_rest(extended(motion.omega), motion.exponent)
    # Where the equations have a corner at rest, the motion begins beside it.
    if not any(body.initial_velocity):
        resting |= motion.time == motion.case.time.start
    return np.where(resting, rigid_body.UNDETERMINED, axes)


class BetterSolution(NamedTuple):
    """A reference of a motion, its crossings, and the name of how it was computed."""

    motion: Trajectory
    listed: CrossingList
    name: str


class DenseSolution(NamedTuple):
    """A motion at its case's samples, which are its `rows`, and at other times, with the moments
    that show on which side of the separatrix it is."""

    motion: Trajectory
    signs: list[SignChanges]
    rows: np.ndarray


def searched(
    case: Case,
    method: str,
    precision: str,
    tol: float | None,
    uncertainty: float = 0.0,
    until: float = math.inf,
) -> DenseSolution:
    """Integrate a case with a search for zeros of D, through its samples and ERROR_CHECKS other
    times.

    The `CrossingSearch` has this `uncertainty`. The motion ends at the time `until`.
    """
    samples = sample_times(case)
    times = with_checks(samples, even_times(case, ERROR_CHECKS))
    times = times[times <= until]
    body = body_of(case)
    search = CrossingSearch(body, uncertainty)
    motion = solve(case, method, precision, tol, times, search.examine)
    rows = np.searchsorted(times, samples)
    if motion.succeeded:  # an event that ends it is its last sample, whatever times follow
        rows = distinct(np.minimum(rows, len(motion.time) - 1))
    return DenseSolution(motion, search.parts, rows[rows < len(motion.time)])


def body_of(case: Case) -> BodyFrame:
    """The system of a case whose hodographs enclose an axis."""
    assert isinstance(case.system, BodyFrame)
    return case.system


def with_checks(samples: np.ndarray, checks: np.ndarray) -> np.ndarray:
    """Samples (n,) with the times `checks` among them, but for those that are beside a sample."""
    after = np.searchsorted(samples, checks)
    nearest = np.minimum(
        np.abs(samples[np.minimum(after, len(samples) - 1)] - checks),
        np.abs(samples[np.maximum(after - 1, 0)] - checks),
    )
    # Times a rounding apart would be one in an engine's own units.
    apart = checks[nearest > 1e-9 * (checks[-1] - checks[0])]
    return np.sort(np.concatenate((samples, apart)))


def check_stored(motion: Trajectory, rows: np.ndarray, omega: np.ndarray, expected: float) -> None:
    """Raise HodoError where these rows of a motion are not the stored omega (n, 3)."""
    with np.errstate(invalid="ignore"):  # of what has outgrown the largest double
        again = motion.variables["omega"][rows]
        apart = error_of_variable(("time", "axis"), omega[: len(rows)], again)
    allowed = 1e-12 + 4 * expected
    if apart > allowed or (len(rows) < len(omega) and motion.succeeded):
        raise HodoError(
            f"{motion.case.name}: the stored motion differs from its case by {apart:.1e}, "
            f"and its error allows {allowed:.1e}; run it again with --force"
        )


def labels_on_one_side(dense: DenseSolution, expected: float) -> np.ndarray | None:
    """The labels (n,) of a motion that encloses one axis all along, farther from the separatrix
    than an error of `expected` in every step reaches; None of any other."""
    if dense.signs:
        return None
    labels = sample_labels(dense.motion, assumed_errors(dense.motion, expected))
    return labels if ((labels > 0) & (labels == labels[:1])).all() else None


def against_reference(
    dense: DenseSolution, expected: float, absorbing: frozenset[int]
) -> tuple[np.ndarray, BetterSolution | None]:
    """The error of a motion at each of its times (n,), and its reference.

    Without a reference the error is `expected` everywhere but at the start. Where a case has
    `error: off` that will do, unless such an error leaves anything undecided.
    """
    motion, case = dense.motion, dense.motion.case
    if not case.error:
        assumed = assumed_errors(motion, expected)
        # Also where the equations tell the axes: a time needs an error.
        if not crossings_of(dense, assumed, frozenset()).undecided:
            return assumed, None
    end = math.inf if motion.succeeded else float(motion.time[-1])
    for by in references(case, motion.method, motion.tol):
        limited = with_step_limit(motion, by.method)
        reference = searched(limited, by.method, by.precision, by.tol, until=end)
        if not by.judges(motion, reference.motion):
            continue
        errors = distances(motion, reference.motion)
        reference_errors = (
            errors_of_reference(motion, reference.motion, by.precision)
            if by.tol is None
            else errors
        )
        reference_errors[:1] = errors[:1] = start_error(case)
        name = f"{by.method} in {by.precision} precision"
        listed = crossings_of(reference, reference_errors, absorbing)
        return errors, BetterSolution(reference.motion, listed, name)
    return assumed_errors(motion, expected), None


def assumed_errors(motion: Trajectory, expected: float) -> np.ndarray:
    """The errors (n,) of a motion that has no reference: `expected` of every step."""
    errors = expected * growth_off_axis(motion)
    errors[:1] = start_error(motion.case)
    return errors


def growth_off_axis(motion: Trajectory) -> np.ndarray:
    """How much larger an error is than that of a step (n,), after a motion left the middle axis.

    Every step errs in D by a part of what its terms are then. Where these have become small again,
    the error of the largest terms so far is still there.
    """
    body, omega = body_of(motion.case), extended(motion.omega).astype(float)
    near = rigid_body.near_middle_axis(body.moments, omega)
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.maximum.accumulate(near) / np.sqrt(near)
    return np.maximum(1, np.where(near > 0, growth, 1))


def start_error(case: Case) -> float:
    """The error of a start: each of its components is right to its own last bit.

    So D is right to the rounding of its terms, however near the middle axis. A start whose D is 0
    to that rounding is on neither side, in every precision. Along the principal axes of a full
    tensor each component is a sum, right to the last bit of the largest one.
    """
    body = body_of(case)
    if body.principal_axes is not None:
        return EPS
    A, omega = body.moments, body.omega_at_start
    return EPS * math.sqrt(float(rigid_body.near_middle_axis(A, omega)))


def errors_of_reference(motion: Trajectory, reference: Trajectory, precision: str) -> np.ndarray:
    """The errors (n,) of a reference of higher precision at its own times.

    The errors of a motion that is at the limit of its own precision, times the root of the ratio of
    the two precisions: past the middle axis an error comes out as its square root.
    """
    case = motion.case
    if motion.tol > ROUNDING_TOL:
        end = float(reference.time[-1])
        method, _ = best(case, case.precision)
        motion = searched(case, method, case.precision, None, until=end).motion
    ratio = math.sqrt(PRECISION[precision] / PRECISION[case.precision])
    return ratio * distances(reference, motion)


@np.errstate(over="ignore")  # where the reference rests already, a motion is infinitely wrong
def distances(motion: Trajectory, reference: Trajectory) -> np.ndarray:
    """|omega - omega_ref| / |omega_ref| (n,) at the times of a motion; at least its rounding."""
    n = min(len(motion.time), len(reference.time))
    shift = (motion.exponent[:n] - reference.exponent[:n])[:, None]
    judged, better = extended(motion.omega[:n]), extended(reference.omega[:n])
    # Only the difference needs the digits of a long double.
    apart = (np.ldexp(judged, shift) - better).astype(float)
    distance, size = (np.sqrt(np.vecdot(x, x)) for x in (apart, better.astype(float)))
    errors = np.divide(distance, size, out=np.zeros_like(distance), where=size > 0)
    least = EPS if motion.state.dtype == np.float64 else PRECISION["extended"]
    # The two may have ended at different times; beyond the earlier end the last error holds.
    return np.pad(np.maximum(errors, least), (0, len(motion.time) - n), mode="edge")


def crossings_of(
    dense: DenseSolution, errors: np.ndarray, absorbing: frozenset[int]
) -> CrossingList:
    """The crossings of a motion with the error (n,) at each of its times.

    `absorbing` are the axes that it never leaves.

    The times themselves are sign changes too, so that labels and crossings tell the same. A moment
    between two of them has the larger of their errors.
    """
    motion, case = dense.motion, dense.motion.case
    body, time = body_of(case), motion.time
    if not (has_sides(body) and len(time)):
        return CrossingList([], [], [])
    sides = sample_sides(motion)
    signs = SignChanges.joined([*dense.signs, sides])
    after = np.searchsorted(time, signs.time).clip(max=len(time) - 1)
    before = np.where(time[after] == signs.time, after, np.maximum(after - 1, 0))
    uncertainty = CERTAIN_ERRORS * np.maximum(errors[before], errors[after])
    if len(sides.time) > 1:
        # From rest an error is a part of what the motion gains in a step, not of what it has.
        early = signs.time < sides.time[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            uncertainty[early] *= np.maximum(1, sides.momentum[1] / signs.momentum[early])
    listed = read_sign_changes(signs, uncertainty, absorbing)
    # A body set going from rest is on a side as soon as the time differs from the start.
    started = case.time.start + 1e-12 * (case.time.end - case.time.start)
    return listed._replace(undecided=[moment for moment in listed.undecided if moment > started])


def sample_sides(motion: Trajectory) -> SignChanges:
    """The sides on which a motion is at its times, up to a stop."""
    body, omega = body_of(motion.case), extended(motion.omega)
    G = body.moments * omega.astype(float)
    is_turning = G.any(axis=1)  # after a stop there is no side
    turning = slice(np.flatnonzero(is_turning)[-1] + 1 if is_turning.any() else len(G))
    with np.errstate(over="ignore"):
        margins, sides = sides_of(body, omega[turning])
        momentum = np.sqrt(np.vecdot(G, G))
        momentum = np.ldexp(momentum, motion.exponent)[turning]
    n = len(margins)
    none_vanishes, no_rates = np.zeros(n, dtype=bool), np.zeros(n)
    return SignChanges(motion.time[turning], margins, none_vanishes, no_rates, momentum, sides)


def with_hidden_labels(labels: np.ndarray, absorbing: frozenset[int]) -> np.ndarray:
    """Labels (n,) with those that the error of a motion hides, where its equations tell them: it
    never leaves the axes that are `absorbing`, and before that it enclosed the other axis."""
    if not absorbing:
        return labels
    sample, is_absorbing = np.arange(len(labels)), np.isin(labels, [*absorbing])
    # The first sample about an absorbing axis, and the last one about another: one each, or none.
    first, last = sample[is_absorbing][:1], sample[(labels > 0) & ~is_absorbing][-1:]
    if (last > first).any():  # its error is larger than stated
        return labels
    # A start on D = 0 is on neither side, wherever it leads.
    hidden, filled = (labels == rigid_body.SEPARATRIX) & (sample > 0), labels.copy()
    for known in first:
        filled[hidden & (sample > known)] = labels[known]
    for known in last:
        filled[hidden & (sample < known)] = labels[known]
    return filled


def resolve_conflicts(
    listed: CrossingList, reference: BetterSolution
) -> tuple[list[Crossing], tuple[str, ...]]:
    """The crossings to store, and warnings, from the crossings of a motion and of its reference.

    Where the two lists differ, the list of the reference is stored, with a warning, if the
    reference is undecided nowhere.
    """
    better = reference.listed
    if axes(listed) == axes(better):
        pairs = zip(listed.crossings, better.crossings, strict=True)
        crossings = [with_error(a, abs(a.time - b.time)) for a, b in pairs]
        # Where only the motion is undecided, the reference decides: no warning.
        return crossings, undecided_warning(listed.undecided if better.undecided else [])
    counts = len(listed.crossings), len(better.crossings)
    lists = f"the motion has {counts[0]}, that by {reference.name} has {counts[1]}"
    if better.undecided:
        undecided = undecided_warning(listed.undecided or better.undecided)
        return listed.crossings, (*undecided, f"the crossings are {UNDECIDED}: {lists}")
    crossings = [with_error(c, w) for c, w in zip(better.crossings, better.widths, strict=True)]
    return crossings, (
        f"the crossings depend on the integration error: {lists}; the latter counts",
    )


def axes(listed: CrossingList) -> list[tuple[int, int]]:
    """The axes that each crossing leaves and enters."""
    return [(c.start, c.end) for c in listed.crossings]


def with_error(crossing: Crossing, error: float) -> Crossing:
    """A crossing with the error of its time, and what its rounding to a double adds to that."""
    return replace(crossing, error=error + math.ulp(crossing.time) / 2)


UNDECIDED = "undecided"
"""The word by which a warning says that the crossings of a motion are not all known."""


def undecided_warning(times: list[float]) -> tuple[str, ...]:
    """The warning that the error of a motion hides whether it crosses the separatrix."""
    if not times:
        return ()
    named = ", ".join(f"{time:.6g}" for time in times[:3]) + (", ..." if len(times) > 3 else "")
    return (
        f"it is {UNDECIDED} whether the motion crosses the separatrix near {named}: "
        "its error there is larger than its distance from the separatrix",
    )


def cross(
    case: Case, method: str, precision: str, tol: float | None
) -> tuple[Trajectory, list[Crossing], tuple[str, ...]]:
    """A case integrated through its samples, its crossings, as far as they are beyond rounding, and
    the warning that some are not."""
    if case.system.is_quadrature:
        motion = solve(case, method, precision, tol)
        return motion, own_crossings(motion), ()
    dense = searched(case, method, precision, tol, CERTAIN_ERRORS * EPS)
    absorbing = absorbing_axes(case)
    listed = crossings_of(dense, np.full(len(dense.motion.time), EPS), absorbing)
    warnings = undecided_warning(listed.undecided)
    return dense.motion.at(dense.rows), listed.crossings, warnings
