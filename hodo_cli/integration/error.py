"""The measured error of a motion: its distance from a better computation."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .. import engines
from ..cases.case import Case
from ..engines import extended
from ..models.attitude import angle_apart
from ..models.constants import attributes, rescaled
from .choice import AUTOMATIC, MANY_STEPS, best
from .driver import LIMIT
from .solve import refined, sample_times, solve
from .trajectory import Trajectory

COMPARED = 100_000
"""About how many samples, evenly spaced, an error is measured at."""

LIMIT_OF_SAME_METHOD, LIMIT_OF_OTHER_METHOD = (1000, 20), (2 * int(MANY_STEPS), 500)
"""Steps after which a reference is given up that is by the method of the motion, or by another: so
many, or so many times those of the motion. A Taylor series may take `choice.RATIO` times the steps
of an implicit method, and MANY_STEPS in any case."""

EXTENDED = np.finfo(np.longdouble).eps < 1e-18
"""Whether long double is more precise than double here."""


def measured_error(motion: Trajectory) -> tuple[dict[str, float], str]:
    """The error of each stored variable against a better computation, and what that was.

    It is the largest over the samples, or over some COMPARED of them where there are more.
    """
    case, times, n = motion.case, motion.time, len(motion.time)
    if motion.whole and any(event.terminal for event in case.system.run_events):
        times = sample_times(case)
    positions = thinned(len(times))
    times = times[positions]
    # Both motions are thinned alike, and where an event ends one before the other, it counts too.
    rows = np.append(positions[positions < n - 1], n - 1) if n else positions[:0]
    thin_motion = motion.at(rows) if len(rows) < n else motion
    for by in references(case, motion.method, motion.tol):
        limited = with_step_limit(motion, by.method)
        reference = solve(limited, by.method, by.precision, by.tol, times, refine=False)
        # The engine has cut the tolerance at its limit: the same integration again would show no
        # error.
        if by.tol is not None and reference.tol == motion.tol:
            continue
        # A reference that stops early still judges a motion that stopped as well.
        if reference.whole or not motion.whole:
            return errors_against(case, thin_motion, reference), by.kind
    return {}, "none"


def with_step_limit(motion: Trajectory, reference: str) -> Case:
    """The case of a motion for a reference by some method: with the data that the motion needed.
    The reference gives up where it takes very much longer, as a series in long double does that a
    singularity stops."""
    is_same = motion.method == reference
    least, most = LIMIT_OF_SAME_METHOD if is_same else LIMIT_OF_OTHER_METHOD
    return refined(motion.case, motion.system, max(least, most * motion.steps))


def thinned(n: int) -> np.ndarray:
    """The positions of some COMPARED of n samples, evenly spaced, and of the last one."""
    positions = np.arange(0, n, -(-n // COMPARED) or 1)
    return np.append(positions, n - 1) if n and positions[-1] != n - 1 else positions


class Reference(NamedTuple):
    """How a computation is made that an error is measured against; without `tol` as exactly as its
    precision allows."""

    precision: str
    method: str
    tol: float | None = None

    @property
    def kind(self) -> str:
        """What files call it."""
        if self.tol is not None:
            return "refined"
        return "exact" if self.method == "exact" else self.precision


def references(case: Case, method: str, tol: float) -> Iterator[Reference]:
    """The computations that an error can be measured against, best first.

    1. What `auto` takes, in the next precision.
    2. The same method at a hundredth of the tolerance, if that is not available or fails.
    3. The same at a hundred times the tolerance, if the method is at its limit already.
    """
    finer = {"double": "extended" if EXTENDED else "quadruple", "extended": "quadruple"}.get(
        case.precision
    )
    numerical = "taylor" if engines.have_taylor() else "collocation"
    if finer and (finer != "quadruple" or engines.have_quadruple()):
        # The method that `auto` took for the motion it takes for long doubles too: without another
        # trial, and not the series where that has failed.
        is_known = case.method == "auto" and finer == "extended" and method in AUTOMATIC
        better = method if is_known else best(case, finer)[0]
        # The closed form has the principal axes of a full tensor in doubles, whatever it computes.
        in_other_axes = getattr(case.system, "principal_axes", None) is not None
        yield Reference(finer, numerical if better == "exact" and in_other_axes else better)
    if method == "exact":
        # A closed form has no tolerance, and the same formula again would show no error.
        method = numerical
    yield Reference(case.precision, method, tol / 100)
    yield Reference(case.precision, method, tol * 100)


def errors_against(case: Case, motion: Trajectory, reference: Trajectory) -> dict[str, float]:
    """The error of each stored variable, the largest over the samples that both motions have.

    A vector is judged sample by sample, relative to its length; an attitude by the angle to turn it
    into the other; a scalar relative to its largest value; the time of a terminal event relative to
    the time since the start. A motion at rest (LIMIT) has no error. The values of the motion are
    judged as they are stored, in double precision.
    """
    system = case.system
    n = min(len(motion.time), len(reference.time))
    errors: dict[str, float] = {}
    if n and motion.time[n - 1] != reference.time[n - 1]:
        end = float(reference.time[-1])
        errors["time"] = abs(motion.time[-1] - end) / max(end - case.time.start, math.ulp(end))
    rows = np.r_[0 : n - 1, -1] if errors else slice(n)
    if event_error := passages_apart(motion, reference):
        errors["event_time"] = event_error
    sizes = motion.exponent[rows], reference.exponent[rows]
    state, shift = motion.state[rows].astype(float), sizes[0] - sizes[1]
    if system.degree and shift.any():
        state = rescaled(type(system), state, shift)
    judged = system.output(motion.time[rows], state, attributes(system.constants))
    k = attributes(system.constants, np.longdouble)
    better = system.output(reference.time[rows], extended(reference.state[rows]), k)
    # One of the two may be called at rest a step before the other.
    resting = (np.minimum(*sizes) <= -LIMIT) & (np.maximum(*sizes) < -LIMIT / 2)
    for name, variable in system.variables.items():
        if not case.rests_on(name):
            continue
        a, b = judged[name], better[name]
        if a.dtype.kind == "i":  # a label has no error
            continue
        distance, size = subtracted(a, b), np.abs(b.astype(float))
        if "quaternion" in variable.dims:
            distance, scale = angle_apart(distance, b.astype(float)), 1
        elif len(variable.dims) > 1:
            distance, scale = (np.sqrt(np.vecdot(x, x)) for x in (distance, size))
            distance[resting] = 0
        else:
            distance, scale = np.abs(distance), np.max(size, initial=0)
        relative = np.divide(distance, scale, out=distance.copy(), where=scale > 0)
        errors[name] = float(np.max(relative, initial=0))
    return errors


def passages_apart(motion: Trajectory, reference: Trajectory) -> float:
    """The largest difference of the times at which two motions pass on through an event, relative
    to the time since the start."""
    times = [[e.time for e in path.events if e.details] for path in (motion, reference)]
    if len(times[0]) != len(times[1]):
        return math.inf
    start = motion.case.time.start
    return max((time_error(a, b, start) for a, b in zip(*times, strict=True)), default=0.0)


def time_error(time: float, better: float, start: float) -> float:
    """The error of a time against a better one, relative to the time since the start; no less than
    what rounding to a double may cost, where both are the same double."""
    return max(abs(time - better), math.ulp(better) / 2) / (better - start)


def subtracted(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a - b for doubles a and long doubles b, as doubles: b is taken apart into two, because the
    arithmetic of long doubles takes ten times as long."""
    high = b.astype(float)
    return np.asarray((a - high) - (b - high).astype(float))
