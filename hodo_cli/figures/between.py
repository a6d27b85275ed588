"""A motion between its samples, where each variable of the state is the cubic with the values and
the rates of both samples. The rates are those of the equations of the motion's own case, which also
show whether the cubic is the curve."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

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

SLOW = ("G", "G2", "T", "J", "D", "D/2T", "separatrix_distance", "Gz", "H", "u1", "u2", "u3")
"""The quantities that do not change with the turns of a free body."""

IN_SPACE = ("herpolhode", "axis-trace", "body")
"""The kinds of figures that draw what the body carries along."""


@dataclass(frozen=True, eq=False)
class Course(Motion):
    """A motion with places between its stored samples."""

    samples: Any = None
    """The motion as it is stored."""

    def __getitem__(self, name: str) -> np.ndarray:
        """Values over time (n,). A quantity that torques alone change gets lines between samples,
        because the small error of the cubics would make it oscillate."""
        if name not in SLOW:
            return super().__getitem__(name)
        return np.asarray(np.interp(self.time, self.samples.time, self.samples[name]))


@dataclass(frozen=True)
class Cubics:
    """The state y (k, n) of a motion at its samples, and its rates there, in the order of the
    model's `state`."""

    motion: Motion
    y: np.ndarray
    slope: np.ndarray

    @np.errstate(all="ignore")
    def rates(self, time: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The rates of states (k, ...) at times (...) by the equations; 0 where they are nan."""
        system = self.motion.case.system
        times = np.broadcast_to(time, y.shape[1:])
        found = stacked(system.equations.rhs(times, [*y], attributes(system.constants)), y)
        return np.asarray(np.nan_to_num(found, posinf=0, neginf=0))

    def terms(self, i: Any) -> tuple[np.ndarray, ...]:
        """The coefficients (k, ...) of the cubics on the intervals i (...)."""
        h, a, b = np.diff(self.motion.time)[i], self.y[:, i], self.y[:, i + 1]
        u, v = h * self.slope[:, i], h * self.slope[:, i + 1]
        return a, u, 3 * (b - a) - 2 * u - v, 2 * (a - b) + u + v

    def at(self, i: Any, s: np.ndarray) -> np.ndarray:
        """The state (k, ...) at fractions s of the intervals i, both (...)."""
        a, u, c, d = self.terms(i)
        return np.asarray(a + s * (u + s * (c + s * d)))


def cubics_of(m: Motion) -> Cubics | None:
    """The cubics of a motion; None if its state is not stored whole, as in most averaged forms."""
    known = {str(x): m.stored(x) for x, v in m.data.items() if v.dims == ("time",)}
    for name, parts in (("gamma", ("gamma1", "gamma2", "gamma3")), ("attitude", QUATERNION)):
        known |= dict(zip(parts, m.stored(name).T, strict=True)) if name in m.data else {}
    known |= dict(zip("pqr", m.principal_omega.T, strict=True)) if "omega" in m.data else {}
    if len(m.time) < 2 or not known.keys() >= {*m.case.system.equations.state}:
        return None
    y = np.array([known[name] for name in m.case.system.equations.state])
    bare = Cubics(m, y, y)
    return replace(bare, slope=bare.rates(m.time, y))


def course(m: Motion, cubics: Cubics | None) -> Course:
    """A motion with as many places between its samples as smooth curves need."""
    if cubics is None:
        return Course(m.case, m.data, m.attrs, m.label, m.path, m.has_own_labels, m)
    bow = np.abs(np.diff(m.time) * np.diff(cubics.slope, axis=1)) / 8
    y = np.abs(cubics.y)
    size = sizes(m, np.maximum(y[:, 1:], y[:, :-1]) + SMALLEST_SEEN * y.max(axis=1, keepdims=True))
    needed = np.sqrt((bow / size).max(axis=0) / VISIBLE)
    places = np.clip(np.ceil(np.nan_to_num(needed)), 1, MOST_PLACES).astype(int)
    i = np.repeat(np.arange(len(places)), places)
    s = (np.arange(len(i)) - (np.cumsum(places) - places)[i]) / places[i]
    time = np.append(m.time[i] + s * np.diff(m.time)[i], m.time[-1])
    y = np.concatenate([cubics.at(i, s), cubics.y[:, -1:]], axis=1)
    data = {
        name: interpolated(v, m.time, time) for name, v in m.data.items() if v.dims == ("time",)
    }
    data |= {name: v for name, v in m.data.items() if "time" not in v.dims}
    data |= dict(vectors_of(m, y))
    if "enclosed_axis" in data:
        follow_crossings(m, np.append(i, len(m.time) - 1), time, data["enclosed_axis"].data)
    return Course(m.case, data, m.attrs, m.label, m.path, m.has_own_labels, m)


SMALLEST_SEEN = 1e-3
"""The size, relative to the largest, below which the eye sees a variable as 0."""


def sizes(m: Motion, size: np.ndarray) -> np.ndarray:
    """Sizes (k, ...) of the components of the state; all components of a vector get the largest."""
    for name, part in (("omega", slice(0, 3)), ("attitude", slice(-4, None))):
        if name in m.data:
            size[part] = size[part].max(axis=0)
    return np.asarray(np.maximum(size, math.ulp(0)))


def interpolated(variable: Any, known: np.ndarray, time: np.ndarray) -> Variable:
    """A variable over known times at other times: numbers by lines, labels as at the sample
    before."""
    if variable.dtype.kind == "f":
        values = np.interp(time, known, variable.data)
    else:
        values = variable.data[np.searchsorted(known, time, "right") - 1]
    return Variable(("time",), values, dict(variable.attrs))


def vectors_of(m: Motion, y: np.ndarray) -> Iterator[tuple[str, Variable]]:
    """The variables that consist of the numbers (k, n) of a state."""
    names = m.case.system.equations.state
    for name in names:
        if name in m.data:
            yield name, Variable(("time",), y[names.index(name)], dict(m.data[name].attrs))
    if "omega" in m.data:
        omega = m.frame.from_principal(y[:3].T) if m.frame else y[:3].T
        yield "omega", Variable(("time", "axis"), omega, dict(m.data["omega"].attrs))
    if "gamma" in m.data:
        yield "gamma", Variable(("time", "axis"), y[3:6].T, dict(m.data["gamma"].attrs))
    if "attitude" in m.data:
        Q = y[-4:] / np.linalg.norm(y[-4:], axis=0)
        yield "attitude", Variable(("time", "quaternion"), Q.T, dict(m.data["attitude"].attrs))


def follow_crossings(m: Motion, i: np.ndarray, time: np.ndarray, labels: np.ndarray) -> None:
    """Let labels at places after the samples i change at the crossings themselves."""
    for crossing in m.crossings:
        after = np.searchsorted(m.time, crossing.time, "right") - 1
        labels[(i == after) & (time >= crossing.time)] = crossing.end


def remark(m: Motion, cubics: Cubics, kind: str, names: Sequence[str], drawn: slice) -> str:
    """The warning about a motion that visibly leaves its cubics between the samples; an empty
    string for none.

    The rates of the cubics are compared with the equations at places on the cubics.
    """
    state, n = m.case.system.equations.state, len(m.time[drawn]) - 1
    if n < 1:
        return ""
    by_time = has_formula_of_time(m.case.system)
    parts = max(16, TIMES_ASKED // n) if by_time else 4
    i, s = np.meshgrid(np.arange(n) + drawn.start, (np.arange(parts) + 0.5) / parts)
    h, (_, u, c, d) = np.diff(m.time)[i], cubics.terms(i)
    size = sizes(m, np.abs(cubics.y[:, drawn]).max(axis=1))[:, None, None]
    rates = h * cubics.rates(m.time[i] + s * h, cubics.at(i, s)) / size
    path = np.cumsum(rates - (u + s * (2 * c + 3 * s * d)) / size, axis=1) / parts
    in_space = kind in IN_SPACE or any("_space" in name or name in TURNING for name in names)
    rows = [x for x, name in enumerate(state) if name in names] or [*range(len(state))[:3]]
    rows += [*range(len(state))[-4:]] if in_space and "attitude" in m.data else []
    path, away = path[rows], np.abs(path[rows]).max(axis=(0, 1))
    if np.sort(away)[-min(JUMPS + 1, n)] <= LARGEST_ERROR:
        return ""
    worst = int(away.argmax())
    turn = float(np.abs(rates[rows, :, worst]).max())
    swings = int((np.diff(np.sign(path[:, :, worst]), axis=1) != 0).sum(axis=1).max()) * by_time
    finer = max(1.5, turn, 3 * swings, (away[worst] / VISIBLE) ** 0.25)
    return f"{m.name} is not known between its samples: {advice(m, h[0, worst] / finer)}"


TIMES_ASKED = 2**15
"""The number of times between the samples of a motion at which a torque is evaluated."""

TURNING = ("rotation", "psi", "theta", "phi")
"""The quantities that follow from the attitude, besides vectors in space."""


def advice(m: Motion, step: float) -> str:
    """The advice to take the number of samples of the whole case that makes a step of this time."""
    time = m.case.time
    instead = ", in place of its values" if time.values else ""
    samples = math.ceil(abs(time.end - time.start) / step) + 1
    return f"time: {{samples: {samples}}}{instead} draws it"
