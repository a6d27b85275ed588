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
"""The number of times besides the samples at which the error of a motion is measured, because a
case may have few samples."""

ROUNDING_TOL = 1e-13
"""The error of a motion in double precision at this tolerance, or at a smaller one, is the error of
its rounding."""

UNMEASURED_ERROR_IN_TOLS = 100.0
"""The assumed error of a motion, in tolerances, where none was measured: the worst of the solvers
reach it (DOP853 and LSODA in `hodo bench`)."""

MIN_UNMEASURED_ERROR = 1e-9
"""The least error that is assumed for a motion at first. Rounding alone does not reach it in the
steps that a motion may take. Where such an error could change a label, a reference decides."""


@dataclass(frozen=True)
class Classification:
    """Labels (n,) of a motion's samples, as in `rigid_body.LABELS`, its crossings, and warnings.

    `growth` (3,) are the rates at which a small tilt away from each axis grows, None where theory
    gives none; `predictions` are its predictions, in sentences. `hidden` is true where the error of
    the motion hides a crossing or changes the list of crossings. `events` are the motion's own
    events.
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
    integrated again, with a search for the zeros of the separatrix function D. A reference is
    integrated too, unless the motion stays on one side of the separatrix by more than any error of
    its method. The label of a sample comes from the error at its own time and from the scaled
    state, which shows the side even where omega is below the smallest double.

    Raises HodoError if the motion differs from the stored one by more than its error allows.
    """
    if case.time.runs_backward:
        rising = replace(case, time=case.time.rising)
        return in_time_of(case, classify(rising, method, tol, error, omega))
    unmeasured = UNMEASURED_ERROR_IN_TOLS * max(EPS, tol)
    expected = unmeasured if math.isnan(error) else max(EPS, error)
    # The assumed error counts even if one was measured: between few samples it may be larger.
    largest = max(MIN_UNMEASURED_ERROR, expected, unmeasured)
    dense = searched(case, method, case.precision, tol, CERTAIN_ERRORS * largest)
    motion, samples = dense.motion, dense.rows[: len(omega)]
    check_stored(motion, samples, omega, expected)
    absorbing = absorbing_axes(case)
    at_all_times, reference = labels_on_one_side(dense, largest), None
    listed = CrossingList([], [], [])
    if at_all_times is None:
        assumed = largest if math.isnan(error) else expected
        errors, reference = against_reference(dense, assumed, absorbing)
        listed = crossings_of(dense, errors, absorbing)
        at_all_times = sample_labels(motion, errors)
    labels = np.full(len(omega), rigid_body.UNDETERMINED, dtype=np.int8)
    labels[: len(samples)] = at_all_times[samples]
    labels = with_hidden_labels(labels, absorbing)
    crossings, warnings = resolve_conflicts(listed, reference)
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
    """The crossings of a motion by quadrature: its events."""
    return [
        Crossing(e.time, int(e.details["from"]), int(e.details["to"]), e.details["G"], e.error)
        for e in motion.events
    ]


def in_time_of(case: Case, found: Classification) -> Classification:
    """The classification of a case that runs backward; `found` is the classification of the same
    motion with the opposite sign of time."""
    crossings = tuple(replace(crossing, time=-crossing.time) for crossing in found.crossings)
    events = tuple(replace(event, time=-event.time) for event in found.events)
    growth = case.system.tilt_growth(case.time.start)
    # The predictions of theory hold for rising time only.
    return replace(found, growth=growth, predictions=(), crossings=crossings, events=events)


def absorbing_axes(case: Case) -> frozenset[int]:
    """The axes that a motion never leaves once it encloses them; none are known backward in
    time."""
    span = case.time.start, case.time.end
    return frozenset() if case.time.mirrored else case.system.absorbing_axes(*span)


def sample_labels(motion: Trajectory, errors: np.ndarray) -> np.ndarray:
    """The label of each sample of a motion (n,), from the errors (n,) of the samples."""
    body = body_of(motion.case)
    axes = body.enclosed(extended(motion.omega), CERTAIN_ERRORS * errors)
    resting = at_rest(extended(motion.omega), motion.exponent)
    # Where the equations have a corner at rest, a motion from rest is begun close to it instead.
    if not any(body.initial_velocity):
        resting |= motion.time == motion.case.time.start
    return np.where(resting, rigid_body.UNDETERMINED, axes)


class BetterSolution(NamedTuple):
    """A reference of a motion, its crossings, and its method and precision in words."""

    motion: Trajectory
    listed: CrossingList
    name: str


class DenseSolution(NamedTuple):
    """A motion at the samples of its case, which are its `rows`, and at further times. `signs` are
    the moments in its steps that show on which side of the separatrix it is."""

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
    """Integrate a case up to the time `until`, through its samples and ERROR_CHECKS other times,
    with a search for zeros of the separatrix function D: a `CrossingSearch` with this
    `uncertainty`."""
    samples = sample_times(case)
    times = with_checks(samples, even_times(case, ERROR_CHECKS))
    times = times[times <= until]
    body = body_of(case)
    search = CrossingSearch(body, uncertainty)
    motion = solve(case, method, precision, tol, times, search.examine)
    rows = np.searchsorted(times, samples)
    # Where an event ends the motion, its last sample replaces all later ones.
    if motion.succeeded:
        rows = distinct(np.minimum(rows, len(motion.time) - 1))
    return DenseSolution(motion, search.parts, rows[rows < len(motion.time)])


def body_of(case: Case) -> BodyFrame:
    """The system of a case whose hodographs enclose an axis."""
    assert isinstance(case.system, BodyFrame)
    return case.system


def with_checks(samples: np.ndarray, checks: np.ndarray) -> np.ndarray:
    """Samples (n,) and the times `checks` among them, in order, without checks that are too close
    to a sample."""
    after = np.searchsorted(samples, checks)
    distance = np.minimum(
        np.abs(samples[np.minimum(after, len(samples) - 1)] - checks),
        np.abs(samples[np.maximum(after - 1, 0)] - checks),
    )
    # Times that differ by their rounding only may become equal in an engine's units.
    apart = checks[distance > 1e-9 * (checks[-1] - checks[0])]
    return np.sort(np.concatenate((samples, apart)))


def check_stored(motion: Trajectory, rows: np.ndarray, omega: np.ndarray, expected: float) -> None:
    """Raise HodoError if the motion at these `rows` differs from the stored omega (n, 3) by more
    than the `expected` error allows."""
    with np.errstate(invalid="ignore"):  # infinite values have no difference
        again = motion.variables["omega"][rows]
        apart = error_of_variable(("time", "axis"), omega[: len(rows)], again)
    allowed = 1e-12 + 4 * expected
    if apart > allowed or (len(rows) < len(omega) and motion.succeeded):
        raise HodoError(
            f"{motion.case.name}: the stored motion differs from its case by {apart:.1e}, "
            f"and its error allows {allowed:.1e}; run it again with --force"
        )


def labels_on_one_side(dense: DenseSolution, expected: float) -> np.ndarray | None:
    """The labels (n,) of a motion that encloses one axis throughout, and is farther from the
    separatrix than an error of `expected` in every step reaches; None for any other motion."""
    if dense.signs:
        return None
    labels = sample_labels(dense.motion, assumed_errors(dense.motion, expected))
    return labels if ((labels > 0) & (labels == labels[:1])).all() else None


def against_reference(
    dense: DenseSolution, expected: float, absorbing: frozenset[int]
) -> tuple[np.ndarray, BetterSolution | None]:
    """The error of a motion at each of its times (n,), and its reference, or None without one.

    Without a reference the errors are assumed, from an error of `expected` in every step. A case
    with `error: off` needs no reference if such errors leave no crossing undecided.
    """
    motion, case = dense.motion, dense.motion.case
    if not case.error:
        assumed = assumed_errors(motion, expected)
        # No absorbing axes here: they may show that the motion crosses, but the time of that
        # crossing would still need an error.
        if not crossings_of(dense, assumed, frozenset()).undecided:
            return assumed, None
    end = math.inf if motion.succeeded else float(motion.time[-1])
    for by in references(case, motion.method, motion.tol):
        limited = with_step_limit(motion, by.method)
        reference = searched(limited, by.method, by.precision, by.tol, until=end)
        if not by.judges(motion, reference.motion):
            continue
        errors = distances(motion, reference.motion)
        reference_errors = errors
        if by.tol is None:  # of higher precision, so that its errors are smaller than the motion's
            reference_errors = errors_of_reference(motion, reference.motion, by.precision)
        reference_errors[:1] = errors[:1] = start_error(case)
        name = f"{by.method} in {by.precision} precision"
        listed = crossings_of(reference, reference_errors, absorbing)
        return errors, BetterSolution(reference.motion, listed, name)
    return assumed_errors(motion, expected), None


def assumed_errors(motion: Trajectory, expected: float) -> np.ndarray:
    """The errors (n,) assumed for a motion without a reference, if every step makes an error of
    `expected`."""
    errors = expected * growth_off_axis(motion)
    errors[:1] = start_error(motion.case)
    return errors


def growth_off_axis(motion: Trajectory) -> np.ndarray:
    """The factors (n,) by which the errors of a motion exceed the error of a step, because it was
    farther from the middle axis before.

    Every step makes an error in the separatrix function D relative to the terms of D at that time.
    When the terms have become small again, the error made with the largest terms is still there.
    """
    body, omega = body_of(motion.case), extended(motion.omega).astype(float)
    near = rigid_body.near_middle_axis(body.moments, omega)
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.maximum.accumulate(near) / np.sqrt(near)
    return np.maximum(1, np.where(near > 0, growth, 1))


def start_error(case: Case) -> float:
    """The error of the state at the start. Each component is right to its own last bit.

    So the separatrix function D is right to the rounding of its terms, however near the middle
    axis. A start whose D is 0 to that rounding is on neither side, in every precision. Along the
    principal axes of a full tensor each component is a sum, right to the last bit of the largest
    one.
    """
    body = body_of(case)
    if body.principal_axes is not None:
        return EPS
    A, omega = body.moments, body.omega_at_start
    return EPS * math.sqrt(float(rigid_body.near_middle_axis(A, omega)))


def errors_of_reference(motion: Trajectory, reference: Trajectory, precision: str) -> np.ndarray:
    """The errors (n,) of a reference of higher precision at its own times.

    They are the errors of a motion at the limit of its own precision, times the root of the ratio
    of the two precisions: past the middle axis an error comes out as its square root.
    """
    case = motion.case
    if motion.tol > ROUNDING_TOL:
        end = float(reference.time[-1])
        method, _ = best(case, case.precision)
        motion = searched(case, method, case.precision, None, until=end).motion
    ratio = math.sqrt(PRECISION[precision] / PRECISION[case.precision])
    return ratio * distances(reference, motion)


@np.errstate(over="ignore")  # where the reference is at rest already, the error is infinite
def distances(motion: Trajectory, reference: Trajectory) -> np.ndarray:
    """The errors |omega - omega_ref| / |omega_ref| (n,) of a motion at its times; at least its
    rounding."""
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
    """The crossings of a motion, from the error (n,) at each of its times. `absorbing` are the axes
    that it never leaves.

    The sides at these times count together with the moments in the steps, so that labels and
    crossings agree. A moment between two times has the larger of their errors.
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
        # Up to the second time the error is relative to |G| there, which a motion from rest gains
        # first.
        early = signs.time < sides.time[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            uncertainty[early] *= np.maximum(1, sides.momentum[1] / signs.momentum[early])
    listed = read_sign_changes(signs, uncertainty, absorbing)
    # A body that begins to turn from rest is on a side as soon as the time differs from the start.
    started = case.time.start + 1e-12 * (case.time.end - case.time.start)
    return listed._replace(undecided=[moment for moment in listed.undecided if moment > started])


def sample_sides(motion: Trajectory) -> SignChanges:
    """The sides of the separatrix on which a motion is at its times, up to a stop."""
    body, omega = body_of(motion.case), extended(motion.omega)
    G = body.moments * omega.astype(float)
    stop = len(G)
    if G.any():  # after a stop there is no side
        stop = np.flatnonzero(G.any(axis=1))[-1] + 1
    with np.errstate(over="ignore"):
        margins, sides = sides_of(body, omega[:stop])
        momentum = np.sqrt(np.vecdot(G, G))
        momentum = np.ldexp(momentum, motion.exponent)[:stop]
    n = len(margins)
    none_vanishes, no_rates = np.zeros(n, dtype=bool), np.zeros(n)
    return SignChanges(motion.time[:stop], margins, none_vanishes, no_rates, momentum, sides)


def with_hidden_labels(labels: np.ndarray, absorbing: frozenset[int]) -> np.ndarray:
    """Labels (n,) with the hidden ones filled in where the equations determine them: a motion never
    leaves an `absorbing` axis, and before it reached that axis it enclosed the other one."""
    if not absorbing:
        return labels
    sample, is_absorbing = np.arange(len(labels)), np.isin(labels, [*absorbing])
    # Arrays (1,) or (0,): the first sample about an absorbing axis, and the last one about another.
    first, last = sample[is_absorbing][:1], sample[(labels > 0) & ~is_absorbing][-1:]
    if (last > first).any():  # the error of the motion is larger than stated
        return labels
    # A start on the separatrix is on neither side, and keeps its label.
    hidden, filled = (labels == rigid_body.SEPARATRIX) & (sample > 0), labels.copy()
    for known in first:
        filled[hidden & (sample > known)] = labels[known]
    for known in last:
        filled[hidden & (sample < known)] = labels[known]
    return filled


def resolve_conflicts(
    listed: CrossingList, reference: BetterSolution | None
) -> tuple[list[Crossing], tuple[str, ...]]:
    """The crossings to store, and warnings, from the crossings of a motion and of its reference, if
    it has one.

    Where the two lists differ, the list of the reference is stored, with a warning, if the
    reference is undecided nowhere.
    """
    if reference is None:
        return listed.crossings, undecided_warning(listed.undecided)
    better = reference.listed
    if axes(listed) == axes(better):
        pairs = zip(listed.crossings, better.crossings, strict=True)
        crossings = [with_error(a, abs(a.time - b.time)) for a, b in pairs]
        # Where only the motion is undecided, the reference decides, and there is no warning.
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
    """The axes that each crossing leaves and enters, as pairs."""
    return [(c.start, c.end) for c in listed.crossings]


def with_error(crossing: Crossing, error: float) -> Crossing:
    """A crossing with this error of its time, plus the rounding of the time to a double."""
    return replace(crossing, error=error + math.ulp(crossing.time) / 2)


UNDECIDED = "undecided"
"""The word in warnings that the crossings of a motion are not all known."""


def undecided_warning(times: list[float]) -> tuple[str, ...]:
    """The warning that the error of a motion hides whether it crosses the separatrix near these
    times; none without times."""
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
    """The motion of a case at its samples, its crossings as far as rounding does not hide them, and
    a warning if it hides any."""
    if case.system.is_quadrature:
        motion = solve(case, method, precision, tol)
        return motion, own_crossings(motion), ()
    dense = searched(case, method, precision, tol, CERTAIN_ERRORS * EPS)
    absorbing = absorbing_axes(case)
    listed = crossings_of(dense, np.full(len(dense.motion.time), EPS), absorbing)
    warnings = undecided_warning(listed.undecided)
    return dense.motion.at(dense.rows), listed.crossings, warnings
