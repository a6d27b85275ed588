"""A motion between its samples, where each variable of the state is the cubic with the values and
the rates of both samples. The equations of the motion's own case give the rates, and show whether
the cubic is the curve."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import HodoError
from ..models.base import QUATERNION, attributes, has_formula_of_time, stacked
from ..results.motion import Motion
from ..storage import Variable

VISIBLE = 0.0015
"""How far a line may be from a curve, relative to its size: 0.06 mm in a column."""

LARGEST_ERROR = 0.03
"""How far a cubic may be from its curve, relative to its size, so that the eye still reads the
values."""

MOST_PLACES = 24
"""The most lines between two samples; where more are needed, the cubic is not the curve."""

JUMPS = 2
"""The most intervals with a jump, which the eye sees however many samples there are."""

SMALLEST_SEEN = 1e-3
"""The size, relative to the largest, below which the eye sees a variable as 0."""

TIMES_ASKED = 2**15
"""The number of times between the samples of a motion at which a torque is evaluated."""

SLOW = ("G", "G2", "T", "J", "D", "D/2T", "separatrix_distance", "Gz", "H", "u1", "u2", "u3")
"""The quantities that do not change with the turns of a free body."""

TURNING = ("rotation", "psi", "theta", "phi")
"""The quantities that follow from the attitude, besides vectors in space."""


VECTORS_OF_STATE = {
    "omega": ("p", "q", "r"), "gamma": ("gamma1", "gamma2", "gamma3"), "attitude": QUATERNION,
}  # fmt: skip
"""The components of stored vectors by their names in a state."""


@dataclass(frozen=True)
class Cubics:
    """The state y (k, n) of a motion at its samples, in the order of the model's `state`, and its
    rates there."""

    motion: Motion
    y: np.ndarray
    slope: np.ndarray

    def terms(self, i: Any) -> tuple[np.ndarray, ...]:
        """The four coefficients (k, ...) of the cubics on the intervals i (...), in the fraction s
        of an interval, from the power 0 upwards."""
        h, a, b = np.diff(self.motion.time)[i], self.y[:, i], self.y[:, i + 1]
        u, v = h * self.slope[:, i], h * self.slope[:, i + 1]
        return a, u, 3 * (b - a) - 2 * u - v, 2 * (a - b) + u + v

    def at(self, i: Any, s: np.ndarray) -> np.ndarray:
        """The state (k, ...) at fractions s of the intervals i, both (...)."""
        a, u, c, d = self.terms(i)
        return np.asarray(a + s * (u + s * (c + s * d)))


@dataclass(frozen=True, eq=False)
class Course(Motion):
    """A motion with places between its stored samples, by its cubics if it has any."""

    samples: Any = None
    """The motion as it is stored."""

    cubics: Cubics | None = None

    def __getitem__(self, name: str) -> np.ndarray:
        """Values over time (n,). A quantity that torques alone change gets lines between samples,
        because the small error of the cubics would make it oscillate."""
        if name not in SLOW:
            return super().__getitem__(name)
        return np.asarray(np.interp(self.time, self.samples.time, self.samples[name]))


def course(m: Motion) -> Course:
    """A motion with as many places between its samples as smooth curves need."""
    data, cubics = m.data, cubics_of(m)
    if cubics:
        data = between_samples(m, cubics)
    return Course(m.case, data, m.attrs, m.label, m.path, m.has_own_labels, m, cubics)


def cubics_of(m: Motion) -> Cubics | None:
    """The cubics of a motion; None if its state is not stored whole, as in most averaged forms."""
    components = {str(x): m.stored(x) for x, v in m.data.items() if v.dims == ("time",)}
    for name, parts in VECTORS_OF_STATE.items():
        if name in m.data and m.stored(name).shape == (len(m.time), len(parts)):
            values = m.principal_omega if name == "omega" else m.stored(name)
            components |= dict(zip(parts, values.T, strict=True))
    if len(m.time) < 2 or not components.keys() >= {*m.case.system.equations.state}:
        return None
    y = np.array([components[name] for name in m.case.system.equations.state])
    return Cubics(m, y, slopes_at(m, m.time, y))


@np.errstate(all="ignore")
def slopes_at(m: Motion, time: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The rates of states y (k, ...) at times (...) by the equations of a motion; 0 where they are
    not finite."""
    system = m.case.system
    times = np.broadcast_to(time, y.shape[1:])
    rates = stacked(system.equations.rhs(times, [*y], attributes(system.constants)), y)
    return np.asarray(np.nan_to_num(rates, posinf=0, neginf=0))


def between_samples(m: Motion, cubics: Cubics) -> dict[Any, Any]:
    """The variables of a motion at its samples and at places between them: by its cubics where they
    follow from the state, else numbers by lines, and labels as at the sample before."""
    # How far the cubic bends from its chord, h^2 |y''|/8; n lines are n^2 times nearer to it.
    bow = np.abs(np.diff(m.time) * np.diff(cubics.slope, axis=1)) / 8
    y = np.abs(cubics.y)
    size = sizes(m, np.maximum(y[:, 1:], y[:, :-1]) + SMALLEST_SEEN * y.max(axis=1, keepdims=True))
    needed = np.sqrt((bow / size).max(axis=0) / VISIBLE)
    places = np.clip(np.ceil(np.nan_to_num(needed)), 1, MOST_PLACES).astype(int)
    i = np.repeat(np.arange(len(places)), places)
    s = (np.arange(len(i)) - (np.cumsum(places) - places)[i]) / places[i]
    time = np.append(m.time[i] + s * np.diff(m.time)[i], m.time[-1])
    before = np.append(i, len(m.time) - 1)
    y = np.concatenate([cubics.at(i, s), cubics.y[:, -1:]], axis=1)
    if "attitude" in m.data:
        y[-4:] /= np.linalg.norm(y[-4:], axis=0)
    system = m.case.system
    values = system.equations.output(time, y.T, attributes(system.constants))
    for name, v in ((x, v) for x, v in m.data.items() if x not in values):
        if v.dims == ("time",):
            is_number = v.dtype.kind == "f"
            values[name] = np.interp(time, m.time, v.data) if is_number else v.data[before]
        elif "time" not in v.dims:
            values[name] = v.data
    for crossing in m.crossings if "enclosed_axis" in values else ():
        passed = (m.time[before] <= crossing.time) & (crossing.time <= time)
        values["enclosed_axis"][passed] = crossing.end
    return {x: Variable(v.dims, values[x], dict(v.attrs)) for x, v in m.data.items() if x in values}


def sizes(m: Motion, size: np.ndarray) -> np.ndarray:
    """Sizes (k, ...) of the components of the state; all components of a vector get the largest."""
    for name, part in (("omega", slice(0, 3)), ("attitude", slice(-4, None))):
        if name in m.data:
            size[part] = size[part].max(axis=0)
    return np.asarray(np.maximum(size, math.ulp(0)))


def samples_in(m: Motion, span: Sequence[float] | None) -> slice:
    """The places of a motion within a span of time. Raises HodoError if there are none."""
    low, high = span or (-math.inf, math.inf)
    first, end = np.searchsorted(m.time, low), np.searchsorted(m.time, high, "right")
    if first == end:
        raise HodoError(f"span: holds no sample of {m.name}, from {m.time[0]:g} to {m.time[-1]:g}")
    return slice(int(first), int(end))


def remark(m: Course, names: Sequence[str], drawn: slice) -> str:
    """The warning about a motion that visibly leaves its cubics between the samples `drawn`, in a
    figure of the variables `names`; an empty string if it does not.

    The rates of the cubics are compared with the equations at places on the cubics.
    """
    motion, cubics, n = m.samples, m.cubics, drawn.stop - drawn.start - 1
    by_time = has_formula_of_time(m.case.system)
    # A quantity that torques alone change has lines between samples.
    if cubics is None or n < 1 or ({*names} <= {*SLOW} and not by_time):
        return ""
    state = m.case.system.equations.state
    parts = max(16, TIMES_ASKED // n) if by_time else 4
    i, s = np.meshgrid(np.arange(n) + drawn.start, (np.arange(parts) + 0.5) / parts)
    h, (_, u, c, d) = np.diff(motion.time)[i], cubics.terms(i)
    size = sizes(m, np.abs(cubics.y[:, drawn]).max(axis=1))[:, None, None]
    turned = h * slopes_at(motion, motion.time[i] + s * h, cubics.at(i, s)) / size
    path = np.cumsum(turned - (u + s * (2 * c + 3 * s * d)) / size, axis=1) / parts
    in_space = any("_space" in name or name.partition(".")[0] in TURNING for name in names)
    rows = [x for x, name in enumerate(state) if name in names] or [*range(len(state))[:3]]
    rows += [*range(len(state))[-4:]] if in_space and "attitude" in m.data else []
    # The largest distance of the cubic from the curve in each interval; JUMPS intervals may have a
    # larger one.
    away = np.abs(path[rows]).max(axis=(0, 1))
    if np.sort(away)[-min(JUMPS + 1, n)] <= LARGEST_ERROR:
        return ""
    worst = int(away.argmax())
    turn = float(np.abs(turned[rows, :, worst]).max())
    swings = int((np.diff(np.sign(path[rows, :, worst]), axis=1) != 0).sum(axis=1).max()) * by_time
    # The error of a cubic falls with the fourth power of the step.
    step = h[0, worst] / max(1.5, turn, 3 * swings, (away[worst] / VISIBLE) ** 0.25)
    time = m.case.time
    instead = ", in place of its values" if time.values else ""
    samples = math.ceil(abs(time.end - time.start) / step) + 1
    advice = f"time: {{samples: {samples}}}{instead} draws it"
    return f"{m.name} is not known between its samples: {advice}"
