"""The measured error of a motion: its distance from a better computation."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest
from math import hypot, inf, ulp
from typing import Any, NamedTuple

import numpy as np

from .. import engines
from ..cases.case import Case
from ..engines import extended
from ..engines.protocol import EPS
from ..models.attitude import angle_apart
from ..models.base import REST_BITS, Model, attributes, rescaled
from .choice import AUTOMATIC, MIN_STIFF_STEPS, best
from .driver import Occurrence
from .solve import Trajectory, sample_times, solve, with_seconds_left

SAMPLES_COMPARED = 100_000
"""The approximate number of samples, evenly spaced, at which an error is measured."""

LIMIT_OF_SAME_METHOD, LIMIT_OF_OTHER_METHOD = (1000, 20), (2 * int(MIN_STIFF_STEPS), 500)
"""The limits of a reference by the method of the motion, and of one by another method: a number of
steps, and a multiple of the motion's steps. A reference is given up after the larger of the two. A
Taylor series may take COLLOCATION_COST times the steps of an implicit method, and MIN_STIFF_STEPS
in any case."""

HAS_EXTENDED = np.finfo(np.longdouble).eps < 1e-18
"""Whether long double is more precise than double here."""


def with_measured_error(motion: Trajectory) -> Trajectory:
    """A motion with the errors of its variables and events against a better computation, if one
    succeeds. They are the largest errors over the samples, or over some SAMPLES_COMPARED of them if
    there are more."""
    case, n = motion.case, len(motion.time)
    # Where an event ends the motion, its reference may end later, after further samples.
    may_end = motion.succeeded and any(event.terminal for event in case.system.run_events)
    times = sample_times(case) if may_end else motion.time
    positions = thinned(len(times))
    # The motion at the same samples, and at its last one, which may be at an event.
    rows = np.append(positions[positions < n - 1], n - 1) if n else positions[:0]
    thin_motion = motion.at(rows) if len(rows) < n else motion
    left = case  # with the seconds that the references so far have left
    for by in references(case, motion.method, motion.tol):
        limited = replace(with_step_limit(motion, by.method), max_seconds=left.max_seconds)
        reference = solve(limited, by.method, by.precision, by.tol, times[positions])
        left = with_seconds_left(left, reference)
        if by.judges(motion, reference):
            return replace(
                motion,
                errors=errors_against(case, thin_motion, reference),
                error_kind=by.kind,
                events=judged_events(motion, reference),
            )
    return motion


def with_step_limit(motion: Trajectory, reference: str) -> Case:
    """The case of a motion, with a limit of steps for a reference by some method. The reference is
    given up if it takes very much longer than the motion, as a series in long double does at a
    singularity."""
    is_same = motion.method == reference
    least, most = LIMIT_OF_SAME_METHOD if is_same else LIMIT_OF_OTHER_METHOD
    limit = max(least, most * motion.steps)
    return replace(motion.case, max_steps=min(filter(None, (motion.case.max_steps, limit))))


def thinned(n: int) -> np.ndarray:
    """The positions of some SAMPLES_COMPARED of n samples, evenly spaced, and of the last one."""
    positions = np.arange(0, n, -(-n // SAMPLES_COMPARED) or 1)
    return np.append(positions, n - 1) if n and positions[-1] != n - 1 else positions


class Reference(NamedTuple):
    """The precision and method of a computation against which an error is measured. Without `tol`
    it is as exact as its precision allows."""

    precision: str
    method: str
    tol: float | None = None

    @property
    def kind(self) -> str:
        """The kind of the reference, as files name it."""
        if self.tol is not None:
            return "refined"
        return self.method if self.method in ("exact", "quadrature") else self.precision

    def judges(self, motion: Trajectory, reference: Trajectory) -> bool:
        """Whether `reference`, a result of this computation, shows the error of a motion."""
        # An engine may limit both tolerances to one value: both integrations are then the same.
        is_same = self.tol is not None and reference.tol == motion.tol
        # A reference that stops early still judges a motion that stopped as well.
        return not is_same and (reference.succeeded or not motion.succeeded)


def references(case: Case, method: str, tol: float) -> Iterator[Reference]:
    """The computations against which an error can be measured, best first.

    1. The method that `auto` takes, in the next higher precision.
    2. The method of the motion at a hundredth of the tolerance, if 1 is not available or fails.
    3. The same at a hundred times the tolerance, if the method is at its limit already.
    """
    # A quadrature in extended precision has more nodes, even where its numbers are doubles.
    has_extended = HAS_EXTENDED or case.system.is_quadrature
    finer = {"double": "extended" if has_extended else "quadruple", "extended": "quadruple"}.get(
        case.precision
    )
    numerical = "taylor" if engines.have_taylor() else "collocation"
    if finer and (finer != "quadruple" or engines.have_quadruple()):
        # What `auto` took for the motion it takes for long doubles too. This saves another trial,
        # and the series is not tried again where it has failed.
        is_known = case.method == "auto" and finer == "extended" and method in AUTOMATIC
        better = method if is_known else best(case, finer)[0]
        # A closed form has the principal axes of a full tensor in doubles only.
        in_other_axes = getattr(case.system, "principal_axes", None) is not None
        yield Reference(finer, numerical if better == "exact" and in_other_axes else better)
    if method == "exact":
        # A closed form has no tolerance, and the same formula again would show no error.
        method = numerical
    yield Reference(case.precision, method, tol / 100)
    yield Reference(case.precision, method, tol * 100)


def errors_against(case: Case, motion: Trajectory, reference: Trajectory) -> dict[str, float]:
    """The error of each stored variable, the largest over the samples that both motions have.

    A vector is judged sample by sample, relative to its length (see `comparable_lengths`); an
    attitude by the angle to turn it into the other; a scalar relative to its largest value; the
    time of an event relative to the time since the start. A motion at rest (REST_BITS) has no
    error. The values of the motion are judged as they are stored, in double precision.
    """
    errors = {}
    if apart := events_apart(motion, reference):
        errors["event_time"] = max(
            error_over_span(error, time, case.time.start) for time, error in apart
        )
    judged, better, resting = outputs_compared(case.system, motion, reference)
    for name, variable in case.system.equations.variables.items():
        if case.rests_on(name) and judged[name].dtype.kind != "i":  # a label has no error
            errors[name] = error_of_variable(variable.dims, judged[name], better[name], resting)
    return errors


def outputs_compared(
    system: Model, motion: Trajectory, reference: Trajectory
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """The variables (n, ...) of a motion and of its reference, in the units of the reference, at
    the samples that both have; and whether (n,) the motion is at rest there."""
    n = min(len(motion.time), len(reference.time))
    # Where an event ends both, their last states are compared, though their times differ.
    has_end = n and motion.time[n - 1] != reference.time[n - 1]
    rows = np.r_[0 : n - 1, -1] if has_end else slice(n)
    motion, reference = motion.at(rows), reference.at(rows)
    sizes = motion.exponent, reference.exponent
    # One of the two may count as at rest a step before the other. A body that can stop rests where
    # either of the two does: between two different stops only the error of the event counts.
    moving = inf if system.equations.may_stop else -REST_BITS / 2
    resting = (np.minimum(*sizes) <= -REST_BITS) & (np.maximum(*sizes) < moving)
    shift = np.where(resting, 0, sizes[0] - sizes[1])
    judged = variables_in_units(system, motion, shift, float)
    better = variables_in_units(system, reference, 0, np.longdouble)
    return judged, better, resting


def variables_in_units(
    system: Model, motion: Trajectory, shift: Any, fp: Any
) -> dict[str, np.ndarray]:
    """The variables (n, ...) of a motion in doubles or long doubles, from its states in a unit of
    omega that is 2**shift (n,) times smaller than its own."""
    state = motion.state.astype(float) if fp is float else extended(motion.state)
    if system.equations.degree and np.any(shift):
        state = rescaled(system.equations, state, shift)
    return system.equations.output(motion.time, state, attributes(system.constants, fp))


def error_of_variable(
    dims: Sequence[str],
    judged: np.ndarray,
    better: np.ndarray,
    resting: np.ndarray | slice = slice(0),
) -> float:
    """The largest error of the doubles of a variable (n, ...) against better values, by the rules
    of `errors_against`. `resting` are the rows in which the motion is at rest, by default none."""
    # Mostly in doubles: the arithmetic of long doubles takes ten times as long.
    high = better.astype(float)
    distance, size = (judged - high) - (better - high).astype(float), np.abs(high)
    if "quaternion" in dims:
        distance, scale = angle_apart(distance, high), np.ones(1)
    elif len(dims) > 1:
        # hypot scales by itself; the square of 1e-170 is 0.
        distance, size = (np.hypot.reduce(x, axis=-1) for x in (distance, size))
        distance[resting], scale = 0, comparable_lengths(size)
    else:
        distance, scale = np.abs(distance), np.max(size, initial=0)
    relative = np.divide(distance, scale, out=distance.copy(), where=scale > 0)
    return float(np.max(relative, initial=0))


LARGEST_REMAINDER = 1e-12
"""A vector passes through 0 at a sample where its length is less than this part of both lengths
next to it."""


def comparable_lengths(lengths: np.ndarray) -> np.ndarray:
    """The lengths (n, ...) to which the errors of a vector are relative, from its lengths at
    successive samples. They are the vector's own lengths, however small after a decay. Where the
    vector passes through 0, what is left of it is rounding, and the smaller of the two lengths next
    to it counts instead."""
    neighbour, scale = np.minimum(lengths[:-2], lengths[2:]), lengths.copy()
    scale[1:-1] = np.where(lengths[1:-1] < LARGEST_REMAINDER * neighbour, neighbour, lengths[1:-1])
    return scale


def error_over_span(error: float, time: float, start: float) -> float:
    """The error of a time relative to the time since the start."""
    return error / max(time - start, ulp(time))


def events_apart(motion: Trajectory, reference: Trajectory) -> list[tuple[float, float]]:
    """The time of each event of two motions, and the distance between its times in the two. Where
    only one of them has an event, the other may have it after its own end: this end is then its
    time."""
    apart = []
    for ours, theirs in zip_longest(motion.events, reference.events):
        time = ours.time if ours else float(motion.time[-1])
        better = theirs.time if theirs else float(reference.time[-1])
        are_others = ours and theirs and ours.kind != theirs.kind
        apart.append((max(time, better), inf if are_others else time_error(time, better)))
    return apart


def judged_events(motion: Trajectory, reference: Trajectory) -> tuple[Occurrence, ...]:
    """The events of a motion with the errors of their times and, where a body stops in both
    motions, with the error of the direction of G."""
    better = {event.kind: event.details for event in reference.events}
    judged = []
    for event, (_, error) in zip(motion.events, events_apart(motion, reference), strict=False):
        ours, theirs = dict(event.details), better.get(event.kind, {})
        if "G1" in ours.keys() & theirs.keys():
            apart = (ours[name] - theirs[name] for name in ("G1", "G2", "G3"))
            ours["G_error"] = hypot(*apart) + EPS / 2
        judged.append(replace(event, error=error, details=ours))
    return tuple(judged)


def time_error(time: float, better: float) -> float:
    """The error of a time against a better one, plus the rounding of the better one to a double."""
    return abs(time - better) + ulp(better) / 2
