"""The quantities over time and the single numbers of a motion that claims compare."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from .. import HodoError
from ..cases.case import MOST_SAMPLES, Case, smooth_samples
from ..engines import extended
from ..engines.protocol import EPS
from ..integration import (
    CERTAIN_ERRORS,
    UNDECIDED,
    Crossing,
    Trajectory,
    body_of,
    choose,
    cross,
    solve,
)
from ..models import rigid_body
from ..quantities import OVER_TIME
from ..results.layout import case_variables, label_variables
from ..results.motion import Motion
from ..storage import Variable
from ..text import case_words
from .finding import ROUNDING, Undecidable


def integrated_motion(case: Case) -> Motion:
    """A case integrated and, where possible, classified; its error is not measured. Raises as
    `sampled_motion` does."""
    numerics = choose(case)[0], case.precision, case.tol
    if case.system.no_axis_reason:
        return sampled_motion(solve(case, *numerics), None)
    return sampled_motion(*cross(case, *numerics))


def followed(case: Case, steps: int = 0) -> Case:
    """A case with its whole state and with samples that follow its motion, for statements about its
    course; `steps` is the number of steps that a method has taken."""
    span = abs(case.time.end - case.time.start)
    smooth = smooth_samples(case.system, span)
    # The steps count too: a body that a torque spins up turns faster than at its start.
    wanted = max(case.time.samples, LEAST_TIMES, smooth, min(SAMPLES_A_STEP * steps, MOST_SAMPLES))
    # A round number, so that members can be integrated side by side.
    samples = wanted if wanted < 1000 else 1000 * math.ceil((wanted - 1) / 1000) + 1
    return replace(case, time=case.time.resampled(samples), store=())


LEAST_TIMES = 201
"""The fewest samples that a course needs."""

SAMPLES_A_STEP, FEWEST_A_STEP = 8, 3
"""A motion with fewer than FEWEST_A_STEP samples to a step of its method is integrated again with
SAMPLES_A_STEP samples to a step. A step is about a fifth of a turn."""


def check_followed(m: Motion) -> None:
    """Raise Undecidable where a motion has fewer than two samples to a step of its method, so that
    its course between samples is unknown."""
    if len(m.time) < 2 * (steps := m.attrs.get("steps", 0)):
        raise Undecidable(
            f"{m.words} takes {steps} steps, and {len(m.time)} samples show no course"
        )


def sampled_motion(
    trajectory: Trajectory, passed: Sequence[Crossing] | None, warnings: Sequence[str] = ()
) -> Motion:
    """A trajectory as a motion. If its crossings are given (`passed` is not None), the motion has
    them, labels, and the warnings about them. Raises Undecidable if the trajectory stops before its
    end."""
    case, events = trajectory.case, trajectory.events
    if not trajectory.succeeded:
        words = f"{case_words(case.name)}, integrated for the statement"
        raise Undecidable(f"{words}: {trajectory.status} {trajectory.message}")
    if passed is not None:  # crossings are stored with the labels, not as events
        events = tuple(e for e in events if e.kind != "separatrix")
    variables = case_variables(
        case.system.equations.variables, trajectory.time, trajectory.variables, events, {}
    )
    if passed is not None:
        axes = (
            trajectory.variables["enclosed_axis"]
            if case.system.is_quadrature
            else body_of(case).enclosed(extended(trajectory.omega), CERTAIN_ERRORS * EPS)
        )
        variables |= label_variables(axes, passed)
    attrs = {"classify_warnings": "\n".join(warnings), "steps": trajectory.steps}
    return Motion(case, variables, attrs, case.name, has_own_labels=True)


NUMBERS_KNOWN: WeakKeyDictionary[Motion, dict[str, float]] = WeakKeyDictionary()
"""The single numbers that claims have computed, by motion and name."""


def quantity(m: Motion, name: str) -> np.ndarray:
    """A quantity over time (n,); a single number as (1,).

    Raises HodoError if the motion does not have it, Undecidable if it is nan somewhere.
    """
    if name not in NUMBERS:
        return known_values(m, name, m[name])
    computed = NUMBERS_KNOWN.setdefault(m, {})
    if name not in computed:
        try:
            computed[name] = NUMBERS[name](m)
        except KeyError as missing:
            raise HodoError(f"{m.words} has no {missing}, which {name} needs") from None
    return np.array([computed[name]])


def known_values(m: Motion, name: str, values: np.ndarray) -> np.ndarray:
    """Values over time (n,) of a motion. Raises Undecidable if one of them is nan."""
    if (missing := np.isnan(values)).any():
        when = m.case.time.text(m.time[int(missing.argmax())])
        raise Undecidable(f"{name} of {m.words} has no value at {when}")
    return values


def number(m: Motion, name: str, at: str = "end") -> float:
    """A quantity that is one number, or the value at the start or the end of a quantity over time.
    Raises as `quantity` does."""
    return float(quantity(m, name)[0 if at == "start" else -1])


def check_divided(m: Motion) -> None:
    """Raise Undecidable for a motion that no separatrix divides by the sign of D, such as one with
    a rotor: its crossings and the axis that it goes round are not known."""
    if reason := m.case.system.no_separatrix_reason:
        raise Undecidable(f"{m.words}: {reason}")


def known_crossings(m: Motion) -> tuple[Crossing, ...]:
    """The crossings of a motion. Raises Undecidable where it is open whether these are all."""
    check_divided(m)
    for warning in str(m.attrs.get("classify_warnings", "")).splitlines():
        if UNDECIDED in warning:
            raise Undecidable(f"{m.words}: {warning}")
    return m.crossings


def enclosed_at(m: Motion, moment: str) -> str:
    """The axis enclosed at "start" or "end". Raises Undecidable if there is none, or if it is not
    known: a motion may be nearer to the separatrix than its error, or stop there."""
    label = m.labels_at_ends[moment == "end"]
    if label == rigid_body.SEPARATRIX:
        known_crossings(m)
    if label == rigid_body.UNDETERMINED:
        check_divided(m)
        reason = f"is at rest or rotates steadily at the {moment}: G goes round no axis"
        raise Undecidable(f"{m.words} {reason}")
    return rigid_body.LABELS[label]


def check_margin(name: str, margin: float, *motions: Motion) -> None:
    """Raise Undecidable where a margin is smaller than the summed error of the motions, and this
    error is larger than rounding."""
    error = sum(error_of(m, name) for m in motions)
    rounding = ROUNDING * max(range_of(m, name) for m in motions)
    check_known(name, error, margin, rounding, *motions)


def check_known(name: str, error: float, margin: float, least: float, *motions: Motion) -> None:
    """Raise Undecidable where the error of a quantity is above the deciding margin and above
    `least`."""
    if abs(margin) < error and error > least:
        owners = " and ".join(dict.fromkeys(m.words for m in motions))
        decides = f"a difference of {abs(margin):.2g} decides"
        raise Undecidable(f"{name} of {owners} is known to {error:.2g} only, and {decides}")


def check_reached(m: Motion, name: str, limit: float) -> None:
    """Raise Undecidable where a motion ends before a time with which the time of an event is
    compared, and the event has not happened."""
    if limit > m.time[-1] and math.isinf(number(m, name)):
        end = m.case.time.text(m.time[-1])
        raise Undecidable(f"{m.words} ends at {end}, where {name} is still to come")


def error_of(m: Motion, name: str) -> float:
    """The measured error of a quantity; 0 for a single number without one."""
    if name in OVER_TIME:
        error = float(np.nan_to_num(m.attrs.get("error", math.nan), nan=ROUNDING))
        return max(error * vector_size(m, name), moved_by(m, name, error))
    errors: list[float] = []
    if name == "first_crossing":
        errors = [crossing.error for crossing in m.crossings]
    elif name == "end_of_spin" and "event_error" in m.data:
        of_events = np.atleast_1d(m.stored("event_error")).tolist()
        ends = (name, "stopped")
        errors = [e for (kind, _), e in zip(m.events, of_events, strict=True) if kind in ends]
    return float(np.nan_to_num(next(iter(errors), 0.0)))


def vector_size(m: Motion, name: str) -> float:
    """The largest size of a quantity or, for a component, the largest length of its vector, to
    which its error is relative."""
    is_rate = name in ("p", "q", "r") and "omega" in m.data
    base, _, part = ("omega", "", name) if is_rate else name.partition(".")
    values = np.transpose(m.vector(base)) if part else [m[name]]
    return float(np.nan_to_num(np.hypot.reduce(np.abs(values), axis=0)).max(initial=0))


def moved_by(m: Motion, name: str, error: float) -> float:
    """How far a quantity moves with a relative error of omega. D near the separatrix, and a
    component of a few parts in a million, change by more than this error relative to their own
    size."""
    if "omega" not in m.data:
        return 0.0
    omega, moved = m.data["omega"], np.zeros(len(m.time))
    shift = error * np.hypot.reduce(omega.data, axis=1)
    for axis in np.eye(3):
        changed = Variable(omega.dims, omega.data + np.outer(shift, axis), omega.attrs)
        moved += np.abs(replace(m, data={**m.data, "omega": changed})[name] - m[name])
    return float(np.nan_to_num(moved).max(initial=0))


def range_of(m: Motion, name: str) -> float:
    """The range of a quantity, or the size of a single number."""
    values = quantity(m, name)
    size = abs(float(values[0])) if len(values) == 1 else float(np.ptp(values))
    # The smallest double, so that one can divide by the range of a quantity that is 0 throughout.
    return max(size, math.ulp(0))


def largest_magnitude(m: Motion, name: str) -> float:
    """The largest |value| of a quantity, at least the smallest double."""
    return max(float(np.abs(quantity(m, name)).max()), math.ulp(0))


def extremes(m: Motion, name: str) -> tuple[float, float]:
    """The least and the largest value of a quantity over its course."""
    values = quantity(m, name)
    least = 0.0 if touches_zero(values) else -peak(m.time, -values)
    return least, peak(m.time, values)


def touches_zero(values: np.ndarray) -> bool:
    """Whether values (n,) are the absolute values of a smooth function that is 0 next to the least
    of them: five values around it bend less than half as much if the sign changes there."""
    i = int(values.argmin())
    near = values[max(0, i - 2) : i + 3]
    # One row for each case: no change of sign, a change before the least value, one after it.
    signs = np.where(np.arange(5) < [[0], [2], [3]], -1, 1)
    if len(near) < 5 or near.min() < 0:
        return False
    plain, *turned = np.abs(np.diff(signs * near, 2)).max(axis=1)
    return bool(2 * min(turned) < plain)


def peak(time: np.ndarray, values: np.ndarray) -> float:
    """The largest of values (n,) at times (n,), also between samples: the peak of a polynomial
    through the samples about the highest one, if they lie on a smooth curve."""
    i = int(values.argmax())
    bends = np.diff(values[max(0, i - 2) : i + 3], 2)
    # On a smooth peak all bends are negative, and within a factor of 2. At a kink or an end of the
    # curve the largest value is a sample.
    if len(bends) < 3 or not 2 * bends.max() < bends.min() < 0:
        return float(values[i])
    curve = smooth_curve(time, values, i, float(time[i]))
    places = np.linspace(time[i - 1] - time[i], time[i + 1] - time[i], PEAK_PLACES)
    return max(float(values[i]), float(curve(places).max()))


PEAK_PLACES = 1001
"""The places between samples where a peak is looked for."""

VISIBLE_MOMENTUM = 0.1
"""The |G| above which a figure shows a turn; |G| is about 1 at the start."""


def turns_about(m: Motion, axis: int, least: float = 0.0) -> list[float]:
    """The turns that G makes about axis `axis` (0, 1, 2) in each stretch of the motion that
    encloses it with |G| of at least `least`, in order. A stretch reaches from edge to edge, which
    lie between samples."""
    check_divided(m)
    inside = np.r_[False, (m.labels == axis + 1) & (m["G"] >= least), False]
    angle, edges = angle_about(m, axis), np.flatnonzero(np.diff(inside)).tolist()
    at_edges = [smooth_value(m, angle, edge_time(m, edge, least)) for edge in edges]
    return [
        abs(end - start) / (2 * math.pi)
        for start, end in zip(at_edges[::2], at_edges[1::2], strict=True)
    ]


def edge_time(m: Motion, i: int, least: float) -> float:
    """The time at which a stretch begins or ends between the samples i - 1 and i: at a crossing,
    where |G| passes `least`, or at the stop; else at sample i - 1."""
    if i in (0, len(m.time)):
        return float(m.time[min(i, len(m.time) - 1)])
    ends = slice(i - 1, i + 1)
    first, last = m.time[ends].tolist()
    by_size = zero_times(m.time[ends], m["G"][ends] - least).tolist() if least else []
    by_label = [c.time for c in m.crossings if first <= c.time <= last]
    stops = [m.stop] if first <= m.stop <= last else []
    return float(next(iter([*by_label, *by_size, *stops]), first))


def turns_at(m: Motion, moment: str) -> float:
    """The turns that G makes in the first stretch ("start") or the last ("end") about the axis that
    it encloses there; 0 where it goes round no single axis."""
    check_divided(m)
    i = 0 if moment == "start" else -1
    axis = m.labels_at_ends[i] - 1
    turns = turns_about(m, axis) if axis in range(3) else []
    # There is no stretch where a body comes to this axis and stops between two samples.
    return turns[i] if turns else 0.0


def swept_angle(m: Motion, about: int) -> float:
    """The turns, with sign, that G makes about axis `about` (0, 1, 2) over the motion."""
    angle = angle_about(m, about)
    return float((angle[-1] - angle[0]) / (2 * math.pi)) if len(angle) else 0.0


def angle_about(m: Motion, about: int) -> np.ndarray:
    """The angle (n,) of G about axis `about` (0, 1, 2), right if G turns by less than half a turn
    from sample to sample."""
    first_axis, second_axis = (m.principal_G[:, i] for i in range(3) if i != about)
    return np.asarray(np.unwrap(np.arctan2(second_axis, first_axis)))


def in_region(m: Motion, side: int) -> np.ndarray:
    """The coordinate (n,) of region `side` in the plane of the quadrants, 0 outside of it: w_l^2 in
    A (0), where the axis of largest inertia is enclosed, K w_s^2 in B (2).

    Raises HodoError for a body without quadrants.
    """
    return np.where(m.labels == m.order[side] + 1, m.quadrants[:, side // 2], 0)


def part_of_region_filled(m: Motion, side: int) -> float:
    """The largest of `in_region`, divided by the largest coordinate of the motion, by which a
    figure is scaled. Raises HodoError as `in_region` does."""
    inside = in_region(m, side)
    coordinate, reached = m.quadrants[:, side // 2], [0.0]
    if inside.any():
        reached += [peak(m.time, inside)]
    # The coordinate may be largest where the motion enters or leaves the region, between samples.
    axis = m.order[side] + 1
    passages = [c.time for c in m.crossings if axis in (c.start, c.end)]
    reached += [smooth_value(m, coordinate, time) for time in passages]
    return max(reached) / max(peak(m.time, column) for column in m.quadrants.T)


def smooth_value(m: Motion, values: np.ndarray, time: float) -> float:
    """The value at a time of a smooth curve through values (n,) over the samples of a motion."""
    return float(smooth_curve(m.time, values, int(np.searchsorted(m.time, time)), time)(0.0))


def smooth_curve(
    time: np.ndarray, values: np.ndarray, i: int, origin: float
) -> np.polynomial.Polynomial:
    """The polynomial in the time since `origin` through the samples on either side of sample i."""
    near = slice(max(0, i - REACH), i + REACH)
    x = time[near] - origin
    return np.polynomial.Polynomial.fit(x, values[near], len(x) - 1)


REACH = 4
"""How many samples on either side of a place give the value there: peaks are missed by 1e-9 at most
where a motion turns by 12 degrees from sample to sample."""


def tilt_growth(m: Motion, side: int) -> float:
    """The rate at which a small tilt away from the axis of largest (0) or smallest (2) inertia
    grows."""
    rates = m.case.system.tilt_growth(m.case.time.start)
    if rates is None:
        raise HodoError(f"{m.words} has no medium, which the growth of a tilt needs")
    return float(rates[m.order[side]])


UNDERFLOW = 1e-290
"""The size up to which a quantity that decays may be 0 in the next sample by underflow."""


def zero_times(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The times at which values (n,) reach or pass 0."""
    # By signs: a zero may fall on a sample, and products of small numbers are 0.
    side = np.sign(values)
    passes = (side[:-1] != 0) & (side[:-1] != side[1:])
    # A quantity that decays never reaches 0, but its double becomes 0.
    passes &= (side[1:] != 0) | (np.abs(values[:-1]) > UNDERFLOW)
    return np.array([zero_between(time, values, int(i)) for i in np.flatnonzero(passes)])


def zero_between(time: np.ndarray, values: np.ndarray, i: int) -> float:
    """The time at which values (n,) pass 0 between the samples i and i + 1: by Newton's method on a
    polynomial through the samples around them or, where that leaves the interval, on a line."""
    a, b = time[i : i + 2].tolist()
    by_line = a - values[i] * (b - a) / (values[i + 1] - values[i])
    curve = smooth_curve(time, values, i + 1, by_line)
    slope, x = curve.deriv(), 0.0
    for _ in range(4):  # Newton's method converges quadratically from a place nearby
        x -= float(curve(x) / (slope(x) or math.inf))
    return by_line + x if a <= by_line + x <= b else float(by_line)


def first_time(times: Sequence[float] | np.ndarray) -> float:
    """The first of some times; infinite if there is none."""
    return float(times[0]) if len(times) else math.inf


def end_of_spin(m: Motion) -> float:
    """The time at which r reaches 0: the time of the event or, where the form has no such event,
    the time of a zero of r or of the stop by a brake, whichever is first."""
    by_event = [time for kind, time in m.events if kind == "end_of_spin"]
    if by_event or not {"omega", "r"} & m.data.keys():
        return first_time(by_event)
    r = m["r"]
    by_brake = m.stop if r[0] and not r[-1] else math.inf
    return min(first_time(zero_times(m.time, r)), by_brake)


NUMBERS: dict[str, Callable[[Motion], float]] = {
    "crossings": lambda m: len(known_crossings(m)),
    "first_crossing": lambda m: first_time([c.time for c in known_crossings(m)]),
    "turns": lambda m: turns_at(m, "start"),
    "visible_turns_x1": lambda m: max(turns_about(m, 0, VISIBLE_MOMENTUM), default=0.0),
    "visible_turns_x3": lambda m: max(turns_about(m, 2, VISIBLE_MOMENTUM), default=0.0),
    "area_largest": lambda m: part_of_region_filled(m, 0),
    "area_smallest": lambda m: part_of_region_filled(m, 2),
    "growth_largest": lambda m: tilt_growth(m, 0),
    "growth_smallest": lambda m: tilt_growth(m, 2),
    "end_of_spin": end_of_spin,
    # u3 touches 1 where |Gz| = C |r|.
    "rebound_u3": lambda m: first_time(
        zero_times(m.time, np.abs(m["Gz"]) - m.inertia[2] * np.abs(m["r"]))
    ),
}
"""The function of each of `claim_block.SINGLE_NUMBERS`."""
