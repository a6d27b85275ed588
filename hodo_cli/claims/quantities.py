"""The measures that claims take of a motion: quantities over time, and single numbers."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..cases.derived import OVER_TIME
from ..engines.protocol import EPS
from ..integration import (
    CERTAIN_ERRORS,
    UNDECIDED,
    Crossing,
    Occurrence,
    Trajectory,
    body_of,
    choose,
    cross,
    distinct,
    principal_omega,
    solve,
)
from ..models import rigid_body
from ..results.layout import case_variables, label_variables
from ..results.motion import Motion, formula_values
from ..results.resolution import (
    SMALLEST_CHORD,
    course_remark,
    no_number_remark,
    turn_remark,
    turns_in_body,
)
from ..storage import Variable
from ..text import case_words
from .finding import ROUNDING, Undecidable


def integrated_motion(case: Case) -> Motion:
    """A case integrated and, where that applies, classified; its error is not measured. Raises as
    `sampled_motion` does."""
    numerics = choose(case)[0], case.precision, case.tol
    if case.system.no_axis_reason:
        return sampled_motion(solve(case, *numerics), None)
    return sampled_motion(*cross(case, *numerics))


def sampled_motion(
    trajectory: Trajectory, passed: Sequence[Crossing] | None, warnings: Sequence[str] = ()
) -> Motion:
    """A trajectory with labels where its crossings are known, and the warnings about these. Raises
    Undecidable if it stops before its end."""
    case, events = trajectory.case, trajectory.events
    if not trajectory.succeeded:
        words = f"{case_words(case.name)}, integrated for the statement"
        raise Undecidable(f"{words}: {trajectory.status} {trajectory.message}")
    if passed is not None:  # a crossing is an event too, of which the labels tell more
        events = tuple(Occurrence(e.kind, e.time) for e in events if e.kind != "separatrix")
    variables = case_variables(
        case.system.variables, trajectory.time, trajectory.variables, events, {}
    )
    if passed is not None:
        axes = (
            trajectory.variables["enclosed_axis"]
            if case.system.is_quadrature
            else body_of(case).enclosed(principal_omega(trajectory), CERTAIN_ERRORS * EPS)
        )
        variables |= label_variables(axes, passed)
    attrs = {"classify_warnings": "\n".join(warnings)}
    return Motion(case, variables, attrs, case.name, has_own_labels=True)


LEAST_PLACES, LEAST_TIMES = 2, 200
"""Places within each interval between samples, and within all intervals, at least."""

GOLDEN_PART = (3 - math.sqrt(5)) / 2

MOST_FINER_SAMPLES = 1_000_000
"""Samples that `between_samples` keeps for the next claim about the same motions: some 100 MB."""

FINER: WeakKeyDictionary[Motion, Motion] = WeakKeyDictionary()
NUMBERS_KNOWN: WeakKeyDictionary[Motion, dict[str, float]] = WeakKeyDictionary()
"""What a claim has computed of motions, for the next that asks: motions with samples between their
own, and single numbers by their names."""


def between_samples(m: Motion) -> Motion:
    """The same motion with samples at places within each interval as well.

    Raises Undecidable if it stops before its end.
    """
    intervals = np.arange(len(m.time) - 1)
    if not len(intervals):
        return m
    if m in FINER:
        return FINER[m]
    places = max(LEAST_PLACES, math.ceil(LEAST_TIMES / len(intervals)))
    # Irrational parts, so that an oscillation of which each sample meets the same phase shows
    # itself; those of the golden section lie apart, however many they are.
    finer = cut(m, intervals, np.arange(1, places + 1) * GOLDEN_PART % 1)
    if sum(len(kept.time) for kept in FINER.values()) > MOST_FINER_SAMPLES:
        FINER.clear()
    FINER[m] = finer
    return finer


def cut(m: Motion, intervals: np.ndarray, places: np.ndarray) -> Motion:
    """The same motion with samples at places, between 0 and 1, within some of its intervals too.
    Raises Undecidable if it stops before its end."""
    within = m.time[intervals] + np.outer(places, np.diff(m.time)[intervals])
    times = np.setdiff1d(distinct(within.ravel()), m.time, assume_unique=True)
    if not len(times):
        return m
    if m.case.store:  # which need not name the state, from which all else follows
        times = distinct(np.concatenate((times, m.time)))
    trajectory = solve(m.case, choose(m.case)[0], m.case.precision, m.case.tol, times)
    added = sampled_motion(trajectory, m.crossings if m.classified else None)
    if m.case.store:
        return replace(added, attrs=m.attrs)
    in_order = np.argsort(np.concatenate((m.time, times)))
    data = dict(m.data)
    for name, variable in added.data.items():
        if variable.dims[:1] == ("time",):
            values = np.concatenate((m.data[name].data, variable.data))
            data[name] = replace(variable, data=values[in_order])
    return replace(m, data=data, has_own_labels=True)


MOST_PEAKS = 64
"""Peaks of a quantity that are looked at more closely, the highest of all."""

PARTS_OF_ALL = 8
"""Parts of each interval in search of the highest peaks."""

PASSES = ((25, 0.1), (400, 1e-3))
"""How `closer` looks, first and then: into how many parts it cuts an interval, and by how much of
its range a quantity may be above its highest sample before. Samples that are 30 degrees apart leave
out 7 % of a square, a 25th of that 0.01 %, and in the end 1e-9 is left out; of an oscillation in
PARTS_OF_ALL 1e-11."""


def near_extremes(m: Motion, name: str) -> Motion:
    """The same motion with samples close to the largest and the smallest values of a quantity over
    time. Raises as `quantity` and `cut` do."""
    finer = cut(m, np.arange(len(m.time) - 1), np.arange(1, PARTS_OF_ALL) / PARTS_OF_ALL)

    def intervals_of(finer: Motion, missed: float) -> np.ndarray:
        values = quantity(finer, name)
        return distinct(np.r_[beside_peaks(values, missed), beside_peaks(-values, missed)])

    return closer(finer, intervals_of)


def closer(m: Motion, intervals_of: Callable[[Motion, float], np.ndarray]) -> Motion:
    """The same motion with samples close to what is read off it, in PASSES: within the intervals
    that hold it, by what the samples may have missed. Raises as `cut` does."""
    for parts, missed in PASSES:
        intervals = intervals_of(m, missed)
        if not len(intervals):
            break
        m = cut(m, intervals, np.arange(1, parts) / parts)
    return m


def beside_peaks(heights: np.ndarray, missed: float) -> np.ndarray:
    """The intervals beside those peaks of heights (n,), an end among them, that may be the highest
    if the samples have missed so much of the range; beside MOST_PEAKS at most."""
    rise = np.diff(heights, prepend=-np.inf, append=-np.inf)
    peaks = np.flatnonzero((rise[:-1] >= 0) & (rise[1:] <= 0))
    peaks = peaks[heights[peaks] >= heights.max() - missed * np.ptp(heights)]
    highest = peaks[np.argsort(heights[peaks])[-MOST_PEAKS:]]
    intervals = np.concatenate((highest - 1, highest))
    return intervals[(intervals >= 0) & (intervals < len(heights) - 1)]


def quantity(m: Motion, name: str) -> np.ndarray:
    """A quantity over time (n,); of one that is a single number that number (1,).

    Raises HodoError if the motion does not have it, Undecidable if it is no number somewhere.
    """
    if name not in NUMBERS:
        return known_values(m, name, m[name])
    if name in READ_OFF_SAMPLES:
        check_start(m)
    known = NUMBERS_KNOWN.setdefault(m, {})
    if name not in known:
        try:
            known[name] = NUMBERS[name](m)
        except KeyError as missing:
            raise HodoError(f"{m.words} has no {missing}, which {name} needs") from None
    return np.array([known[name]])


def known_values(m: Motion, name: str, values: np.ndarray) -> np.ndarray:
    """Values over time (n,) of a motion. Raises Undecidable where one of them is no number."""
    decides_unless(no_number_remark(m, name, values))
    return values


def law_values(m: Motion, law: str) -> np.ndarray:
    """The values (n,) of a law in the time and the quantities of a motion. Raises as `quantity`
    does."""
    return known_values(m, law, formula_values(m, law))


def number(m: Motion, name: str, at: str = "end") -> float:
    """A quantity that is one number; of one over time its value at the start or at the end. Raises
    as `quantity` and `quantity_from_start` do."""
    return float(quantity_from_start(m, name)[0] if at == "start" else quantity(m, name)[-1])


def quantity_from_start(m: Motion, name: str) -> np.ndarray:
    """A quantity over time (n,) from the start of the motion on. Raises as `quantity` does, and
    Undecidable where the samples begin later."""
    if name not in NUMBERS:
        check_start(m)
    return quantity(m, name)


def check_start(m: Motion) -> None:
    """Raises Undecidable where the samples of a motion begin after its start."""
    if m.time[0] > m.case.time.start:
        when = m.case.time.text(m.time[0])
        raise Undecidable(f"the samples of {m.words} begin after its start, at {when}")


def undecided_crossings(m: Motion) -> str:
    """Why it is open whether a motion crosses the separatrix; an empty text if it is known."""
    warnings = str(m.attrs.get("classify_warnings", "")).splitlines()
    remarks = [f"{m.words}: {warning}" for warning in warnings if UNDECIDED in warning]
    return next(iter(remarks), "")


def known_crossings(m: Motion) -> tuple[Crossing, ...]:
    """The crossings of a motion. Raises Undecidable where it is open whether these are all."""
    decides_unless(undecided_crossings(m))
    return m.crossings


def enclosed_at(m: Motion, moment: str) -> str:
    """The axis enclosed at "start" or "end". Raises Undecidable where there is none, or where it is
    open: a motion may stand nearer to the separatrix than its error, or stop there."""
    label = m.labels_at_ends[moment == "end"]
    if label == rigid_body.SEPARATRIX:
        decides_unless(undecided_crossings(m))
    if label == rigid_body.UNDETERMINED:
        decides_unless(
            f"{m.words} is at rest or rotates steadily at the {moment}: G goes round no axis"
        )
    return rigid_body.LABELS[label]


def decides_unless(remark: str) -> None:
    """Raises Undecidable with a remark, unless it is empty."""
    if remark:
        raise Undecidable(remark)


def check_course(m: Motion, names: Sequence[str]) -> None:
    """Raises Undecidable where the samples of a motion are too few to show the course of
    quantities."""
    decides_unless(course_remark(m, names))


def check_margin(name: str, margin: float, *motions: Motion) -> None:
    """Raises Undecidable where a quantity is nearer to what decides than its error, or the values
    of several motions to each other than their errors, and this is more than any result may
    have."""
    error = sum(error_of(m, name) for m in motions)
    if abs(margin) < error and error > ROUNDING * max(range_of(m, name) for m in motions):
        owners = " and ".join(dict.fromkeys(m.words for m in motions))
        raise Undecidable(
            f"{name} of {owners} is known to {error:.2g} only, and a difference of "
            f"{abs(margin):.2g} decides"
        )


def check_reached(m: Motion, name: str, limit: float) -> None:
    """Raises Undecidable where a motion ends before the time with which that of something is
    compared that has not happened until then."""
    if limit > m.time[-1] and math.isinf(number(m, name)):
        end = m.case.time.text(m.time[-1])
        raise Undecidable(f"{m.words} ends at {end}, where {name} is still to come")


def error_of(m: Motion, name: str) -> float:
    """The measured error of a quantity, as far as it is known; else 0."""
    errors: list[float] = []
    if name == "first_crossing":
        errors = [crossing.error for crossing in m.crossings]
    elif name == "end_of_spin" and "event_error" in m.data:
        of_events = np.atleast_1d(m.stored("event_error")).tolist()
        ends = (name, "stopped")
        errors = [e for (kind, _), e in zip(m.events, of_events, strict=True) if kind in ends]
    elif name in OVER_TIME:
        error = float(np.nan_to_num(m.attrs.get("error", 0)))
        errors = [max(error * m.largest(name), moved_by(m, name, error))]
    return float(np.nan_to_num(next(iter(errors), 0.0)))


def moved_by(m: Motion, name: str, error: float) -> float:
    """How far a quantity moves with an error of omega, relative to |omega|: D near the separatrix,
    and a component of a few parts in a million, by more than that part of its own size."""
    if "omega" not in m.data:
        return 0.0
    omega, moved = m.data["omega"], np.zeros(len(m.time))
    shift = error * np.hypot.reduce(omega.data, axis=1)
    for axis in np.eye(len(m.axes)):
        changed = Variable(omega.dims, omega.data + np.outer(shift, axis), omega.attrs)
        moved += np.abs(replace(m, data={**m.data, "omega": changed})[name] - m[name])
    return float(np.nan_to_num(moved).max(initial=0))


def range_of(m: Motion, name: str) -> float:
    """The range of a quantity; of a single number its size."""
    values = quantity(m, name)
    size = abs(float(values[0])) if len(values) == 1 else float(np.ptp(values))
    # The smallest double, so that a quantity that is 0 throughout can be divided by.
    return max(size, math.ulp(0))


VISIBLE_MOMENTUM = 0.1
"""The |G|, of about 1 at the start, above which a turn can be seen in a figure of the motion."""


FOLLOWED_ANGLE = math.pi / 2
"""The angle by which a hodograph may turn between samples that count turns: half of what would lose
one."""


def is_about(m: Motion, axis: int, least: float) -> np.ndarray:
    """Whether samples (n,) enclose axis `axis` (0, 1, 2) with |G| of `least` or more."""
    return np.asarray((m.labels == axis + 1) & (m["G"] >= least))


def turns_about(m: Motion, axis: int, least: float = 0.0) -> list[float]:
    """The turns that G makes about an axis in each stretch of the motion that `is_about` it, in
    order. Raises Undecidable where the samples do not count them, and as `cut` does."""
    # What is turned between a sample and the end of a stretch counts too.
    m = closer(m, lambda finer, _: np.flatnonzero(np.diff(is_about(finer, axis, least))))
    # Where they begin and where they end, by turns.
    edges = np.flatnonzero(np.diff(np.r_[False, is_about(m, axis, least), False])).tolist()
    return [
        abs(swept_angle(m, axis, slice(first, end)))
        for first, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def turns_at(m: Motion, moment: str) -> float:
    """The turns that G makes in the stretch of "start" or "end" about the axis that it encloses
    there; 0 where it goes round no single axis. Raises Undecidable as `check_start` does."""
    check_start(m)
    i = 0 if moment == "start" else -1
    axis = m.labels_at_ends[i] - 1
    turns = turns_about(m, axis) if axis in range(3) else []
    # None where a body comes to this axis, and stops, between two samples.
    return turns[i] if turns else 0.0


def swept_angle(m: Motion, about: int, samples: slice = slice(None)) -> float:
    """The turns that G makes about axis `about` (0, 1, 2) over some samples, with their sign."""
    decides_unless(turn_remark(m, samples, FOLLOWED_ANGLE, False, SMALLEST_CHORD))
    first_axis, second_axis = (m.principal_G[samples, i] for i in range(3) if i != about)
    # Right while G turns by less than half a turn between two samples.
    angle = np.unwrap(np.arctan2(second_axis, first_axis))
    return float((angle[-1] - angle[0]) / (2 * math.pi)) if len(angle) else 0.0


def in_region(m: Motion, side: int) -> np.ndarray:
    """The coordinate (n,) of region `side` in the plane of the quadrants: w_l^2 in A (0), where the
    axis of largest inertia is enclosed, K w_s^2 in B (2); 0 elsewhere.

    Raises HodoError where a body has no quadrants.
    """
    return np.where(m.labels == m.order[side] + 1, m.quadrants[:, side // 2], 0)


def part_of_region_filled(m: Motion, side: int) -> float:
    """The largest of `in_region` by the largest coordinate of the motion, by which a figure is
    scaled. Raises as that and `cut` do, and Undecidable where the samples do not follow the
    motion."""
    of_samples = in_region(m, side)
    if not of_samples.any() and m.order[side] + 1 not in [x.end for x in m.crossings]:
        return 0.0
    check_course(m, ())

    def intervals_of(finer: Motion, missed: float) -> np.ndarray:
        coordinates = in_region(finer, side), finer.quadrants.max(axis=1)
        return distinct(np.concatenate([beside_peaks(x, missed) for x in coordinates]))

    m = closer(m, intervals_of)
    return float(in_region(m, side).max() / m.quadrants.max())


def tilt_growth(m: Motion, side: int) -> float:
    """The rate at which a small tilt away from the axis of largest (0) or smallest (2) inertia
    grows."""
    rates = m.case.system.tilt_growth(m.case.time.start)
    if rates is None:
        raise HodoError(f"{m.words} has no medium, which the growth of a tilt needs")
    return float(rates[m.order[side]])


UNDERFLOW = 1e-290
"""The size from which on a quantity that decays may be 0 in the next sample."""


def zero_intervals(values: np.ndarray) -> np.ndarray:
    """The intervals in which values (n,) reach or pass 0."""
    # By signs: a zero may fall on a sample, and products of small numbers are 0.
    side = np.sign(values)
    passes = (side[:-1] != 0) & (side[:-1] != side[1:])
    # What decays never reaches 0, but for doubles that end before it.
    return np.flatnonzero(passes & ((side[1:] != 0) | (np.abs(values[:-1]) > UNDERFLOW)))


def zero_times(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The times at which values (n,) reach or pass 0, by linear interpolation between the
    samples."""
    i = zero_intervals(values)
    return np.asarray(time[i] - values[i] * (time[i + 1] - time[i]) / (values[i + 1] - values[i]))


def first_zero(m: Motion, values_of: Callable[[Motion], np.ndarray]) -> float:
    """The time at which a quantity (n,) of a motion first reaches or passes 0; infinite if it does
    not. Raises as `check_start` and `cut` do, and Undecidable where the samples do not count its
    turns."""
    check_start(m)
    if turns_in_body(m):
        decides_unless(turn_remark(m, slice(None), FOLLOWED_ANGLE, False, SMALLEST_CHORD))
    m = closer(between_samples(m), lambda finer, _: zero_intervals(values_of(finer))[:1])
    return first_time(zero_times(m.time, values_of(m)))


def first_time(times: Sequence[float] | np.ndarray) -> float:
    """The first of some times; infinite if there is none."""
    return float(times[0]) if len(times) else math.inf


def end_of_spin(m: Motion) -> float:
    """The time at which r reaches 0: by the event or, where the form has none, by the zeros of r
    and by the brake that stops the body. Raises as `first_zero` does, and Undecidable where there
    is no r."""
    by_event = [time for kind, time in m.events if kind == "end_of_spin"]
    has_r = {"omega", "r"} & m.data.keys()
    if not (by_event or has_r or "y" in m.data):
        raise Undecidable(f"{m.words} is averaged over the turns of its hodograph, and has no r")
    if by_event or not has_r:
        return first_time(by_event)
    by_zero, r = first_zero(m, lambda finer: finer["r"]), m["r"]
    # Behind the stop of a body with a rotor G is 0, and not r.
    by_brake = m.stop if r[0] and not r[-1] else math.inf
    return min(by_zero, by_brake)


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
    "rebound_u3": lambda m: first_zero(
        m, lambda finer: np.abs(finer["Gz"]) - finer.inertia[2] * np.abs(finer["r"])
    ),
}
"""What computes each of `claim_block.SINGLE_NUMBERS`."""

READ_OFF_SAMPLES = {
    "visible_turns_x1",
    "visible_turns_x3",
    "area_largest",
    "area_smallest",
}
"""Those of them that are read off the samples of the whole motion."""
