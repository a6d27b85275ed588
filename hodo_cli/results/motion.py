"""A motion for figures and claims: the variables of one dataset or group, and every quantity that
follows from its samples, computed when it is needed."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from shlex import quote
from typing import Any

import numpy as np

from .. import HodoError
from ..arithmetic import evaluate
from ..cases.case import Case, parse_case
from ..cases.figure_block import FORMULA_NAMES
from ..integration import Crossing, label_at_start
from ..models import rigid_body
from ..models.base import attributes
from ..quantities import PARTS, QUANTITIES, Samples, constants_of, lack_of, stored_name
from ..schema.expression import names_in, parse_expression
from ..schema.spelling import unknown
from ..storage import Attribute, Variable, dimension_sizes, typed
from ..text import case_words
from .layout import AXIS_LABELS, CROSSING_COLUMNS, EVENT_COLUMNS, units_of_case

Variables = Mapping[Any, Any]
"""Labelled arrays by name, with `dims`, `data` and `attrs`: an `xarray.Dataset`, or a `Group` where
loading xarray would cost more than the work."""

LABELS_COMPARED, MIN_MARGIN_COMPARED, MIN_SIZE_COMPARED = 32, 0.1, 1e-290
"""How many labels are compared with the angular velocities of their samples; how far these have to
be from the separatrix, relative to the terms of D, and the least size that they have to have."""


@dataclass(frozen=True, eq=False)
class Motion(Samples):
    """A case with its variables over ascending times, their attributes, its label in figures, its
    file, and whether its labels are known to belong to its omega."""

    case: Case
    data: Variables
    attrs: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    path: str = "RUN"
    has_own_labels: bool = False

    @property
    def name(self) -> str:
        """The case's name in the file."""
        return self.case.name

    @property
    def words(self) -> str:
        """The name of the case in messages."""
        return case_words(self.name)

    def __getitem__(self, name: str) -> np.ndarray:
        """Values over time (n,): a stored variable, a quantity, or a component such as "omega.x1".

        Raises HodoError if the case has no such variable.
        """
        base, _, part = name.partition(".")
        try:
            if part:
                dim = next(dim for dim, parts in PARTS.items() if part in parts)
                return self.vector(base)[:, PARTS[dim].index(part)]
            return self.stored(name) if self._over_time(name) else self.number(name)
        except (KeyError, AttributeError, IndexError, StopIteration):
            known = [*map(str, self.data), *QUANTITIES]
            words = f"{self.words}: {unknown(f'variable {name!r}', name, known)}"
            lack = lack_of(self.case, base, self.sources, name) if base in QUANTITIES else ""
            raise HodoError(lack or words) from None

    def number(self, name: str) -> np.ndarray:
        """A number over time (n,) that follows from the stored variables; psi and phi as in
        `continued`."""
        values = np.asarray(QUANTITIES[name].formula(self))
        return continued(self, name, values) if name in ("psi", "phi") else values

    def vector(self, name: str) -> np.ndarray:
        """A vector (n, 3), or a quaternion (n, 4). Raises KeyError if there is none."""
        if stored_name(name) in self.data:
            return self.stored(name)
        return self.G if name == "G" else QUANTITIES[name].formula(self)

    def quantity(self, name: str) -> np.ndarray:
        """A quantity of the table, (n,) or (n, 3) for its components. Raises HodoError if the case
        lacks what it needs."""
        if message := lack_of(self.case, name, self.sources, name):
            raise HodoError(message)
        return self.vector(name) if QUANTITIES[name].dim else self.number(name)

    def derived_variable(self, name: str) -> Variable:
        """A quantity as a variable that can be stored."""
        quantity = QUANTITIES[name]
        words: dict[str, Attribute] = {"long_name": quantity.long_name, "units": quantity.units}
        return Variable(quantity.dims, self.quantity(name), words)

    def units(self, name: str) -> str:
        """The units of a variable or quantity in the units of the case; "1" for a number."""
        return units_of_case(units_in_words(self, name), self.case)

    @property
    def sources(self) -> set[str]:
        """The variables and constants from which quantities can follow."""
        return {*map(str, self.data)} | constants_of(self.case.system, self.case.data)

    def _over_time(self, name: str) -> bool:
        found = self.data.get(stored_name(name))
        return found is not None and found.dims == ("time",) and found.data.dtype.kind in "biuf"

    @property
    def sampled(self) -> bool:
        """Whether there is any sample."""
        return "time" in self.data and bool(self.data["time"].data.size)

    @property
    def principal_G(self) -> np.ndarray:
        """The angular momentum (n, 3) along the principal axes."""
        return self.frame.to_principal(self.G) if self.frame else self.G

    @property
    def quadrants(self) -> np.ndarray:
        """The points (w_l^2, K w_s^2) (n, 2), of which D = 0 is the diagonal and D > 0 lies below
        it.

        Raises HodoError for a body with a rotor, and where K is infinite.
        """
        self.check_separatrix()
        K = rigid_body.slope(self.inertia)
        if math.isinf(K):
            raise HodoError(f"{self.words} has no quadrants: its two larger moments are equal")
        return np.asarray(self.principal_omega[:, [self.order[0], self.order[2]]] ** 2 * [1, K])

    @property
    def classified(self) -> bool:
        """Whether `classify` has stored an enclosed axis for each sample."""
        return self._over_time("enclosed_axis")

    @property
    def lacks_labels(self) -> bool:
        """Whether the motion has no labels although `classify` would find them."""
        needs_none = self.classified or self.case.sweep or self.case.system.no_axis_reason
        return not needs_none and "omega" in self.data and self.sampled

    @cached_property
    def labels(self) -> np.ndarray:
        """The enclosed axis (n,). Raises HodoError if `classify` was not run, or finds no axes."""
        if not self.classified:
            command = f"run `hodo classify {quote(self.path)}` first"
            how = self.case.system.no_axis_reason
            how = how or (command if self.path else "classify it first")
            raise HodoError(f"{self.words} has no labels of the enclosed axis: {how}")
        labels = self.stored("enclosed_axis")
        if self.has_own_labels:
            return labels
        if self.frame and "omega" in self.data and self._contradicts(self.frame, labels):
            raise HodoError(
                f"{self.words} has labels of another motion, as after arithmetic with a whole "
                "dataset: name the variable, as ds.assign(omega=2 * ds.omega)"
            )
        return labels

    def _contradicts(self, frame: rigid_body.BodyFrame, labels: np.ndarray) -> bool:
        """Whether omega contradicts every one of some labels that are beyond doubt."""
        count = min(len(labels), LABELS_COMPARED)
        few = np.linspace(0, max(len(labels) - 1, 0), count).astype(int)
        omega = self.omega[few]
        expected = frame.enclosed(frame.to_principal(omega), MIN_MARGIN_COMPARED)
        # The smallest numbers have a label only by the scaled state.
        is_clear = (expected > 0) & (np.abs(omega).max(axis=1) > MIN_SIZE_COMPARED)
        return bool(is_clear.any() and (labels[few] != expected)[is_clear].all())

    @cached_property
    def crossings(self) -> tuple[Crossing, ...]:
        """The separatrix crossings. Raises as `labels` does: a motion without labels may still
        cross."""
        if not len(self.labels):
            return ()
        columns = [self.stored(name).tolist() for name in CROSSING_COLUMNS]
        fields = [field for field, _ in CROSSING_COLUMNS.values()]
        return tuple(
            Crossing(**dict(zip(fields, row, strict=True))) for row in zip(*columns, strict=True)
        )

    @property
    def crossing_time(self) -> np.ndarray:
        """The times (m,) of the separatrix crossings from the first sample to the last; none in a
        case that is not classified."""
        crossings = self.crossings if self.classified else ()
        times = np.sort([crossing.time for crossing in crossings])
        return times[(times >= self.time[:1]) & (times <= self.time[-1:])]

    @property
    def labels_at_ends(self) -> tuple[int, int]:
        """The labels at the start and at the end; a body that a brake stops ends with its last
        label before the stop. Raises as `labels` does."""
        start = label_at_start(self.case, self.time[0], self.labels, self.crossings)
        has_stopped = self.labels[-1] == rigid_body.UNDETERMINED and math.isfinite(self.stop)
        return start, int((self.stored("event_from") if has_stopped else self.labels)[-1])

    @property
    def events(self) -> tuple[tuple[str, float], ...]:
        """Kind and time of each event of the motion itself, such as the end of spin."""
        if "event_time" not in self.data or "event_kind" not in self.data:
            return ()
        kinds, times = (np.atleast_1d(self.stored(f"event_{of}")) for of in ("kind", "time"))
        return tuple(zip(map(str, kinds), times.tolist(), strict=True))

    @property
    def stop(self) -> float:
        """The time at which a brake has stopped the body; infinite if none has."""
        return dict(self.events).get("stopped", math.inf)

    def at(self, times: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Values over time (n, k) at some times (m, k), interpolated between samples."""
        return np.stack([np.interp(times, self.time, column) for column in values.T], axis=-1)


@np.errstate(all="ignore")  # nan is a gap in a curve, and meets no bound
def formula_values(motion: Motion, text: str) -> np.ndarray:
    """The values (n,) of a formula in the time `t` and the variables of a motion.

    Raises HodoError if the motion lacks one of them.
    """
    tree = parse_expression(text, FORMULA_NAMES)
    values = {name: motion.time if name == "t" else motion[name] for name in names_in(tree)}
    return np.broadcast_to(np.asarray(evaluate(tree, values), float), motion.time.shape)


LATER_COLUMNS = ("crossing_error", "crossing_G")
"""The columns that early files of format 1 lack; their crossings have nan there."""


def motion_of(data: Variables, attrs: Mapping[str, Any], owner: str, path: str = "RUN") -> Motion:
    """The motion of a stored case with these variables and attributes; `path` is its file.

    Raises HodoError, which begins with `owner`, if they do not fit together.
    """
    case = case_of(attrs, owner)
    check_whole(data, owner, is_sweep=bool(case.sweep))
    return Motion(case, data, attrs, case.name, path)


def check_whole(data: Variables, owner: str, is_sweep: bool) -> None:
    """Raise HodoError, which begins with `owner`, if the variables of a motion or of a sweep are
    damaged."""
    for problem in wrong_labels(data) if is_sweep else damage(data):
        raise HodoError(f"{owner} is damaged ({problem})")


def case_of(attrs: Mapping[str, Any], owner: str) -> Case:
    """The case in the attributes of a stored group. Raises HodoError as `motion_of` does."""
    return parsed(typed(attrs, {"case": str}, owner)["case"])


# Most cases are used by several figures and the page, and parsing one takes milliseconds.
parsed = lru_cache(maxsize=256)(parse_case)


def damage(data: Variables) -> Iterator[str]:
    """What is damaged in the variables of a single motion, the first fault that hides others
    first."""
    required = required_dims(data)
    for name, dims in required.items():
        if name not in data or data[name].data.dtype.kind not in "fi":
            yield f"its {name} is no array of numbers"
        if data[name].dims != dims:
            yield f"its {name} has dimensions {', '.join(data[name].dims) or 'none'}"
    yield from wrong_labels(data)
    # One component for each of the stored body axes.
    axes = data["axis"].data.shape if "axis" in data else None
    if "omega" in required and data["omega"].data.shape[1:] != axes:
        yield "its omega holds no vectors"
    names = [*required, *(name for name in EVENT_COLUMNS if name in data)]
    try:
        dimension_sizes({name: data[name] for name in names})
    except ValueError as error:
        yield f"its {error}"


def required_dims(data: Variables) -> dict[str, tuple[str, ...]]:
    """The dimensions that each variable of a single motion must have, missing variables
    included."""
    required: dict[str, tuple[str, ...]] = {"time": ("time",)}
    # A selection of one component leaves a number over time.
    if "omega" in data and data["omega"].dims != ("time",):
        required["omega"] = ("time", "axis")
    if "enclosed_axis" in data:  # labels and crossings are stored together
        required["enclosed_axis"] = ("time",)
        columns = (name for name in CROSSING_COLUMNS if name not in LATER_COLUMNS or name in data)
        required |= dict.fromkeys(columns, ("crossing",))
    return required


def wrong_labels(data: Variables) -> Iterator[str]:
    """What is wrong with each variable of labels that holds other numbers."""
    for name in ("enclosed_axis", *AXIS_LABELS):
        if name in data and not np.isin(data[name].data, list(rigid_body.LABELS)).all():
            yield f"its {name} holds labels that are none, as after arithmetic with a whole dataset"


SAFE_CHANGE, SAFE_TURN = math.pi / 2, 1.0
"""The change of an angle and the turn of the body between two samples up to which no whole turn can
be lost."""

PLACES_OF_PATH, PATH_ERROR = 33, 1 / 50
"""At how many places a path between two samples is computed, and how far it may be off, relative to
the fourth power of the turn: eight times the distance of a cubic from a circle."""

THROUGH_POLE = 1e-9
"""The sine of theta below which x3 passes the vertical itself, as in a plane pendulum: the rounding
of a long motion is less."""


def continued(m: Motion, name: str, values: np.ndarray) -> np.ndarray:
    """psi or phi (n,), continuous from sample to sample.

    Where x3 passes through the vertical itself, both step by pi, up and down alternately. From the
    first gap on in which the samples do not show on which side x3 passes the vertical the values
    are nan, because whole turns may be lost.
    """
    known = np.flatnonzero(np.isfinite(values))
    values[known] = np.unwrap(values[known])
    if "omega" not in m.data:
        return values
    # phi turns against the azimuth of the vertical in the body.
    sense = 1 if name == "psi" else -1
    path, slope, speed = path_of_azimuth(m, name, known)
    time = m.time[known]
    turn, changes = np.maximum(speed[1:], speed[:-1]) * np.diff(time), np.diff(values[known])
    unsafe = np.flatnonzero((np.abs(changes) > SAFE_CHANGE) | (turn > SAFE_TURN))
    by_path, nearest = turned_azimuth(path, slope, time, unsafe)
    steps = nearest < THROUGH_POLE
    by_path[steps] = sense * math.pi * (-1) ** np.arange(np.count_nonzero(steps))
    whole = np.zeros(len(changes))
    whole[unsafe] = np.round((sense * by_path - changes[unsafe]) / math.tau)
    values[known[1:]] += math.tau * np.cumsum(whole)
    lost = unsafe[~steps & (nearest < PATH_ERROR * turn[unsafe] ** 4)]
    if lost.size:
        values[known[lost[0]] + 1 :] = np.nan
    return values


def path_of_azimuth(m: Motion, name: str, known: np.ndarray) -> tuple[np.ndarray, ...]:
    """The unit vectors (n, 3) whose azimuth is psi or phi (x3 in space, or the vertical in the
    body), their rates (n, 3), and the speed of the body (n,), at the samples `known`."""
    of_time = m.case.system.quaternion_factor  # of a full top, whose time is the slow one
    factor = of_time(attributes(m.case.system.constants)) if of_time else 1.0
    turned, omega = m.rotations[known], m.omega[known] * factor
    if name == "psi":
        path = turned.apply(np.eye(3)[2])
        slope = np.cross(turned.apply(omega), path)
    else:
        path = turned.inv().apply(np.eye(3)[2])
        slope = np.cross(path, omega)
    return path, slope, np.linalg.norm(omega, axis=1)


def turned_azimuth(
    path: np.ndarray, slope: np.ndarray, time: np.ndarray, after: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The changes (k,) of the azimuth from each of the samples `after` (k,) to the next, along a
    cubic path, and the least distance (k,) of each path from the pole. `path` (n, 3) are unit
    vectors with slopes `slope` (n, 3) at times (n,)."""
    x, length = np.linspace(0, 1, PLACES_OF_PATH)[:, None, None], np.diff(time)[after, None]
    a, b = path[after, :2], path[after + 1, :2]
    u, v = slope[after, :2] * length, slope[after + 1, :2] * length
    places = a + x * (u + x * (3 * (b - a) - 2 * u - v + x * (2 * (a - b) + u + v)))
    azimuth = np.unwrap(np.arctan2(places[..., 1], places[..., 0]), axis=0)
    sides = np.diff(places, axis=0)
    square = np.maximum((sides * sides).sum(-1), math.ulp(0))
    foot = np.clip(-(places[:-1] * sides).sum(-1) / square, 0, 1)[..., None]
    nearest = np.linalg.norm(places[:-1] + foot * sides, axis=-1).min(axis=0)
    return azimuth[-1] - azimuth[0], nearest


def units_in_words(m: Motion, name: str) -> str:
    """The units of a variable or quantity in words, such as "moment of inertia / time". A stored
    variable has its own units or none, even if a quantity has the same name."""
    base = name.partition(".")[0]
    if (key := stored_name(base)) in m.data:
        return str(m.data[key].attrs.get("units", "1"))
    return QUANTITIES[base].units if base in QUANTITIES else "1"
