"""How finely the samples follow a motion: whether a line through them is the curve, for the eye."""

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..cases.derived import BODY_AXES, COMPONENTS
from ..cases.figure_block import KINDS_IN_SPACE
from ..models.base import attributes, has_formula_of_time, stacked
from ..models.rigid_body import vector_product, vector_sum
from .motion import (
    ANGLES_THAT_TURN,
    EULER_ANGLES,
    OF_ATTITUDE,
    Motion,
    euler_angle,
    time_factor,
)

# A polygon of 24 sides is a circle to within 0.9 % of its radius, some widths of a line.
LARGEST_TURN = math.radians(15)
"""The largest angle by which a hodograph may turn from one sample to the next."""

OSCILLATION_ANGLE = math.radians(30)
"""The largest such angle for a component over time, whose peaks are read: 3 % of them is lost."""

VISIBLE_CHORD = 0.02
"""The shortest chord that the eye sees, as a part of the size of a curve."""

LARGEST_LOSS = 0.03
"""The part of its height that a line between samples may leave out, as that of an
OSCILLATION_ANGLE."""

SMALLEST_CHORD = 1e-6
"""The shortest chord that counts where numbers decide and not the eye."""

STEADY_CHANGE = 1e-6
"""The part of a quantity by which it changes where it is constant for the eye."""

PROPOSED_ANGLE = math.radians(10)
"""The angle between neighbours for which samples are proposed."""


def turns(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """The angle (n,) by which the hodograph turns within the longer of the intervals beside each
    sample, and the distance (n,) that it covers there; by the rates, since samples that miss whole
    turns look smooth.

    The rates belong to a free body, beside which a torque turns G slowly.
    """
    # Of components (3, n): numpy is slow along an axis of three whose numbers lie together.
    omega, A = np.ascontiguousarray(motion.principal_omega.T), motion.inertia[:, None]
    size = np.abs(omega).max(initial=0) or 1.0
    w = omega / size
    G = A * w
    rate = vector_product([*G], [*w])
    bend = vector_sum(vector_product(rate, [*w]), vector_product([*G], [*(rate / A)]))
    speed = np.linalg.norm(rate, axis=0)
    with np.errstate(all="ignore"):  # where G stands still it turns by no angle
        curl = np.linalg.norm(vector_product(rate, bend), axis=0) / speed**2
    wide = longer_intervals(motion) * size
    return np.where(speed > 0, np.nan_to_num(curl), 0) * wide, speed * wide * size


def turns_in_space(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """As `turns`, of what the body carries along: it turns by |omega| times the time."""
    angle = np.linalg.norm(motion.omega, axis=-1) * longer_intervals(motion)
    return angle, angle * np.abs(motion.G).max(initial=0)


def longer_intervals(motion: Motion) -> np.ndarray:
    """The longer of the intervals (n,) beside each sample, in the time of which omega is a rate."""
    time = motion.time
    steps = np.diff(time, prepend=time[:1], append=time[-1:])
    return np.asarray(np.maximum(steps[:-1], steps[1:]) * time_factor(motion))


def turn_remark(
    motion: Motion, drawn: slice, limit: float, in_space: bool, chord: float = VISIBLE_CHORD
) -> str:
    """The remark on a motion whose samples are too few for a curve of G, or for one in space; an
    empty text if they are enough. Chords shorter than `chord` times the largest |G| do not
    count."""
    angle, distance = turns_in_space(motion) if in_space else turns(motion)
    is_seen = distance[drawn] > chord * np.abs(motion.G[drawn]).max(initial=0)
    worst = float(angle[drawn][is_seen].max(initial=0))
    if worst <= limit:
        return ""
    turned = f"turns by up to {math.degrees(worst):.0f}° from one sample to the next"
    return f"{motion.name} {turned}, {polygon(motion, worst / PROPOSED_ANGLE)}"


def polygon(motion: Motion, finer: float) -> str:
    """The end of a remark on a curve of too few samples: that so many times as many draw it."""
    samples, time = math.ceil((len(motion.time) - 1) * finer) + 1, motion.case.time
    instead = ", in place of its values" * bool(time.values) or ", in place of steps" * time.steps
    return f"so that its curve is a polygon: time: {{samples: {samples}}}{instead} draws it"


def bend_remark(motion: Motion, name: str, drawn: slice) -> str:
    """The remark on a quantity that a line through its samples leaves between them by more than the
    eye sees, as a parabola through three neighbours does; an empty text without."""
    time, values = motion.time[drawn], motion[name][drawn]
    if values.dtype.kind == "i":  # a label has no values between
        return ""
    values = np.where(np.isfinite(values), values, np.nan)  # no number is a gap in the line
    known = values[~np.isnan(values)]
    height = float(np.ptp(known)) if len(known) > 2 else 0.0
    # Of what is constant the rounding alone would be seen.
    if height <= STEADY_CHANGE * np.abs(known).max(initial=0):
        return ""
    before, after = np.diff(time)[:-1], np.diff(time)[1:]
    chord = (after * values[:-2] + before * values[2:]) / (before + after)
    # A parabola is that far from its chord in the middle of the longer interval.
    apart = np.abs(values[1:-1] - chord) * np.maximum(before, after) / np.minimum(before, after) / 4
    apart = float(np.fmax.reduce(apart, initial=0)) / height
    if apart <= LARGEST_LOSS:
        return ""
    ending = polygon(motion, math.sqrt(4 * apart / LARGEST_LOSS))
    return f"{name} of {motion.name} bends between its samples, {ending}"


def no_number_remark(motion: Motion, name: str, values: np.ndarray) -> str:
    """Where values (n,) of a quantity first are no number, and why as far as that is known; an
    empty text if all are numbers."""
    if not (missing := np.isnan(values)).any():
        return ""
    i = int(missing.argmax())
    when = motion.case.time.text(motion.time[i])
    words = f"{name} of {motion.words} is no number at {when}"
    return ": ".join(filter(None, [words, reason_of_gap(motion, name, i)]))


def reason_of_gap(motion: Motion, name: str, i: int) -> str:
    """Why a quantity is no number at sample i; an empty text where that is not known."""
    if not turns_in_body(motion) or name not in COMPONENTS:
        return ""
    if name not in ANGLES_THAT_TURN:
        size = np.abs(motion.omega[i]).max()
        words = "omega has lost its digits there" if size else "the body is at rest there"
        return words if size < sys.float_info.min else ""
    if np.isnan(euler_angle(name, motion)[i]):
        return "theta is 0 or pi there"
    return turn_remark(motion, slice(None), LARGEST_TURN, in_space=True)


def gap_remark(motion: Motion, name: str, drawn: slice) -> str:
    """The remark on a quantity of which a line through its samples shows nothing; an empty text if
    two neighbours are numbers, or the only sample is."""
    known = np.isfinite(values := motion[name])[drawn]
    is_seen = (known[1:] & known[:-1]).any() if len(known) > 1 else known.all()
    remark = "" if is_seen else no_number_remark(motion, name, values)
    return f"no curve: {remark}" if remark else ""


TIMES_ASKED, LEAST_TIMES = 2**16, 16
"""The times at which a torque is asked between the samples of a motion, and in an interval at
least."""

JUMPS = 2
"""Intervals that may each hold a jump of omega, which the eye sees whatever the samples are."""


def sampled_states(motion: Motion, drawn: slice) -> dict[str, np.ndarray]:
    """The variables of the state (n,) that a motion stores, by their names: omega, and what is
    stored under a name of its own. Of an average over the turns there is none."""
    names = motion.case.system.state
    known = [name for name in names if getattr(motion.data.get(name), "dims", ()) == ("time",)]
    if motion.frame and not turns_in_body(motion):
        return {}
    omega = motion.omega[drawn].T if motion.frame else ()
    own = {name: motion.stored(name)[drawn] for name in known}
    return dict(zip(names, omega, strict=False)) | own


def path_beside_samples(motion: Motion, known: Mapping[str, np.ndarray], drawn: slice) -> Any:
    """How far variables of the state leave the line through their samples by formulas of the time
    in the equations, (m, times, intervals), at times within each interval.

    Their rates are compared with those at both ends for one and the same state, so that what a
    body does by itself, which `turns` shows, does not count.
    """
    system, time = motion.case.system, motion.time[drawn]
    n = max(TIMES_ASKED // len(time), LEAST_TIMES)
    part = ((np.arange(n) + 0.5) / n)[:, None]
    lines = {name: x[:-1] + part * np.diff(x) for name, x in known.items()}
    if motion.frame:
        y = system.starts(np.stack([*lines.values()][:3], axis=-1))
    else:
        y = np.array(system.start)[:, None, None] + 0 * next(iter(lines.values()))
    rows = [system.state.index(name) for name in lines]
    y[rows] = [*lines.values()]

    def rates(t: np.ndarray) -> np.ndarray:
        times = np.broadcast_to(t, y.shape[1:])
        return stacked(system.rhs(times, [*y], attributes(system.constants)), y)[rows]

    with np.errstate(all="ignore"):
        by_line = (1 - part) * rates(time[:-1]) + part * rates(time[1:])
        beside = rates(time[:-1] + part * np.diff(time)) - by_line
    path = np.cumsum(np.nan_to_num(beside), axis=1) * np.diff(time) / n
    # The line goes through the samples at both ends.
    return path - (part + 0.5 / n) * path[:, -1:]


def torque_remark(motion: Motion, names: Sequence[str], drawn: slice) -> str:
    """The remark on a motion whose rates change with the time between the samples by so much that
    the eye would see it, in the variables of the state among `names`, or else in all; an empty
    text without."""
    intervals = len(motion.time[drawn]) - 1
    if intervals < 1 or not has_formula_of_time(motion.case.system):
        return ""
    if not (known := sampled_states(motion, drawn)):
        return ""
    path, values = path_beside_samples(motion, known, drawn), np.array([*known.values()])
    away, size = np.abs(path).max(axis=1), np.abs(values).max(axis=1)
    height = np.ptp(values, axis=1) + away.max(axis=1)
    vectors = {f"omega.{axis}": name for axis, name in zip(BODY_AXES, "pqr", strict=True)}
    asked = {vectors.get(name, name) for name in names}
    named = [i for i, name in enumerate(known) if name in asked]
    if motion.frame:
        size[:3] = size[:3].max()
        if not named:
            named, height[:3] = [0, 1, 2], height[:3].max()
    named = named or [*range(len(known))]
    height = np.maximum(height, STEADY_CHANGE * size / LARGEST_LOSS)
    bent = (away > LARGEST_LOSS * height[:, None])[named]
    if bent.any(axis=0).sum() <= min(JUMPS, intervals - 1):
        return ""
    changes = f"{'a torque' if motion.frame else 'a rate'} of {motion.name} changes with the time"
    return f"{changes} between its samples, {polygon(motion, finer_by(path[named]))}"


def finer_by(path: np.ndarray) -> float:
    """How many times as many samples show what leaves the line through them by a path (m, times,
    intervals): of each oscillation, which has two changes of sign, as many as of a turn."""
    signs = np.sign(path[:, :-1].transpose(0, 2, 1).reshape(len(path), -1))
    changes = int((np.diff(signs, axis=1) != 0).sum(axis=1).max())
    return float(max(2.0, changes * math.pi / PROPOSED_ANGLE / path.shape[-1]))


CURVES = ("hodograph", "sphere", "quadrants", *KINDS_IN_SPACE)
"""The kinds of figures that draw curves of G or omega, whatever they name."""

OF_SAMPLES = (*CURVES, "phase", "series")
"""The kinds whose curves are lines through samples."""

OSCILLATING = ("p", "q", "r", "x", "y", "x1_direction")
"""The quantities that oscillate with the turns, as the components of vectors do."""


def oscillates(name: str) -> bool:
    """Whether a quantity oscillates with the turns, and does not follow their mean."""
    return name in OSCILLATING or name in EULER_ANGLES or "." in name


def coarse_curves(spec: Mapping[str, Any], motions: Sequence[Motion]) -> list[str]:
    """The warnings about the motions of a figure whose samples are too few for its curves, or of
    which it shows no curve."""
    kind = spec["kind"]
    names = [spec["x"], spec["y"]] if kind == "phase" else spec.get("variables", ())
    slow = [name for name in names if kind == "series" and not oscillates(name)]
    drawn = [(motion, samples_within(motion, spec.get("span"))) for motion in motions]
    bends = [bend_remark(motion, name, samples) for motion, samples in drawn for name in slow]
    turning = kind in CURVES or any(map(oscillates, names))
    limit = OSCILLATION_ANGLE if kind == "series" else LARGEST_TURN
    # The angles count the turns of the body in space, of which few samples lose whole ones.
    in_space = kind in KINDS_IN_SPACE or any(name in EULER_ANGLES for name in names)
    remarks = [
        turn_remark(motion, samples, limit, in_space)
        for motion, samples in drawn
        if turning and turns_in_body(motion) and len(motion.time[samples]) > 2
    ]
    torques = [torque_remark(motion, names, samples) for motion, samples in drawn]
    gaps = [gap_remark(motion, name, samples) for motion, samples in drawn for name in names]
    # Of too few turns a gap says the same.
    others = [x for x in (*remarks, *bends, *torques) if not any(x in gap for gap in gaps)]
    return list(dict.fromkeys(filter(None, [*gaps, *others])))


def turns_in_body(motion: Motion) -> bool:
    """Whether its samples are of the turns themselves, and not of an average over them."""
    return "omega" in motion.vectors and len(motion.axes) == 3


def course_remark(motion: Motion, names: Sequence[str]) -> str:
    """Why the samples of a motion do not show the course of quantities, which between them may do
    anything, also where they are equal; an empty text if they do."""
    everywhere = slice(None)
    if turns_in_body(motion):
        in_space = {False, any(name.partition(".")[0] in OF_ATTITUDE for name in names)}
        remarks = [
            turn_remark(motion, everywhere, OSCILLATION_ANGLE, seen, SMALLEST_CHORD)
            for seen in sorted(in_space)
        ]
    else:
        few = f"{motion.name} has fewer than 3 samples" if len(motion.time) < 3 else ""
        remarks = [few, *(bend_remark(motion, name, everywhere) for name in names)]
    return next(filter(None, remarks), "")


def samples_within(motion: Motion, span: tuple[float, float] | None) -> slice:
    """The samples of a motion within a span of time; all without one."""
    if span is None:
        return slice(None)
    first = int(np.searchsorted(motion.time, span[0]))
    return slice(first, int(np.searchsorted(motion.time, span[1], "right")))
