"""A motion as figures and claims see it: the view of one dataset, by its coordinates, with every
quantity that follows from its samples.

The quantities of `cases.derived`, as |G|, T and D, are computed here alone, when asked for.
"""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from shlex import quote
from typing import Any

import numpy as np

from .. import HodoError
from ..arithmetic import evaluate
from ..cases.case import Case, parse_case
from ..cases.derived import (
    BODY_AXES,
    COMPONENTS,
    DERIVED,
    PARTS,
    SPACE_AXES,
    component_names,
    constants_of,
    derivable_numbers,
    lack_of,
)
from ..cases.figure_block import FORMULA, quantities_in
from ..cases.sweep_block import AXIS_LABELS
from ..integration import Crossing, label_at_start
from ..models import rigid_body
from ..models.base import attributes
from ..models.terms.laws import coefficient_at
from ..models.top.nutation import first_integrals, roots_of_motion, with_mu
from ..schema.expression import names_in, parse_expression
from ..storage import Attribute, Variable, dimension_sizes, typed
from ..text import case_words
from .layout import CROSSING_COLUMNS, EVENT_COLUMNS, INERTIA, units_of_case

Variables = Mapping[Any, Any]
"""Labelled arrays by name, with `dims`, `data` and `attrs`: those of an `xarray.Dataset`, or of a
`Group` where loading xarray would cost more than the work."""

LABELS_COMPARED, MIN_MARGIN_COMPARED, MIN_SIZE_COMPARED = 32, 0.1, 1e-290
"""How many labels are compared with the angular velocities beside them; how far these are from the
separatrix, as a part of the terms of D, and how large at least."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A case, its variables over ascending times, the attributes that are stored with them, what a
    figure calls it, its file, and whether its labels are known to be those of its omega."""

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
        """The case in messages."""
        return case_words(self.name)

    def __getitem__(self, variable: str) -> np.ndarray:
        """Values over time (n,): a stored variable, a quantity of `DERIVED`, or a component such as
        "omega.x1".

        Raises HodoError if the case has no such variable.
        """
        if self._over_time(variable):
            return self.stored(variable)
        name, _, part = variable.partition(".")
        if part in BODY_AXES and name in self.vectors:
            return self.component(name, part)
        # The parts of a stored variable, such as an attitude, before those of a quantity.
        dims: Sequence[str] = self.data[name].dims if name in self.data else ()
        dim = dims[1] if len(dims) == 2 and dims[0] == "time" else ""
        if part in PARTS.get(dim, ()):
            values = self.stored(name)
        elif variable in COMPONENTS:
            values, dim = self.quantity(name), DERIVED[name].dim
        else:
            raise HodoError(f"{self.words} has no variable {variable!r}: {self._hint(name)}")
        return values[:, PARTS[dim].index(part)] if part else values

    def largest(self, variable: str) -> float:
        """The largest size of a variable or quantity where it is a number; of a component, the
        length of its vector. It is no less than the smallest double, so that one that is 0
        throughout can be divided by."""
        name, dot, part = variable.rpartition(".")
        # Of body axes those that a selection has left.
        axes = self.axes if part in BODY_AXES else SPACE_AXES
        of_vector = axes if dot and part in axes else ()
        parts = [self[f"{name}.{part}"] for part in of_vector] or [self[variable]]
        # hypot scales by itself; the squares of 1e-170 are 0, and those of 1e170 infinite.
        sizes = np.hypot.reduce(np.abs(parts), axis=0)
        return max(float(sizes[np.isfinite(sizes)].max(initial=0)), math.ulp(0))

    def quantity(self, name: str) -> np.ndarray:
        """A quantity of `DERIVED` (n,), or (n, 3) where it has components, from what is stored;
        angles that turn on go on from sample to sample, see `continued`.

        Raises HodoError if the case lacks what it needs.
        """
        if message := lack_of(self.case, name, self.sources, name):
            raise HodoError(message)
        values = QUANTITIES[name](self)
        return continued(self, name, values) if name in ANGLES_THAT_TURN else values

    def derived_variable(self, name: str) -> Variable:
        """A quantity of `DERIVED` as it is stored."""
        quantity = DERIVED[name]
        words: dict[str, Attribute] = {"long_name": quantity.long_name, "units": quantity.units}
        return Variable(quantity.dims, self.quantity(name), words)

    def stored(self, name: str) -> np.ndarray:
        """The values of a stored variable. Raises KeyError if it is not stored."""
        if name not in self.data:  # xarray's own error would list all that there is
            raise KeyError(name)
        return np.asarray(self.data[name].data)

    def component(self, name: str, axis: str) -> np.ndarray:
        """The component of a vector along a body axis, by its coordinate (n,).

        Raises KeyError if there is no such vector, HodoError if it lacks the component.
        """
        if name not in self.vectors:
            if name in self.data:
                raise HodoError(f"{self.words} has {name} without its components")
            raise KeyError(name)
        if axis not in self.axes:
            raise HodoError(
                f"{self.words} has no component {axis} of {name}, only {', '.join(self.axes)}"
            )
        return self.vectors[name][:, self.axes.index(axis)]

    def vector(self, name: str) -> np.ndarray:
        """A stored vector (n, 3). Raises as `component` does, if it lacks one."""
        for axis in BODY_AXES:
            self.component(name, axis)
        return self.vectors[name]

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """The body axes of the components of vectors, in the order in which they are stored."""
        if "axis" not in self.data:
            raise HodoError(
                f"{self.words} has no coordinate 'axis', which tells the components of "
                "its vectors apart"
            )
        return tuple(map(str, np.atleast_1d(self.stored("axis"))))

    def units(self, variable: str) -> str:
        """The units of a variable or quantity in the units of the case; "1" for a number."""
        name = variable.partition(".")[0]
        attrs = self.data[name].attrs if name in self.data else {}
        return units_of_case(str(attrs.get("units", units_in_words(name))), self.case)

    def lacks_unit(self, variable: str) -> bool:
        """Whether nothing says what units a quantity has: it carries a moment of inertia, and only
        the time of its case has a unit."""
        name, case = variable.partition(".")[0], self.case
        label = case.system.variables.get(name)
        words = label.units if label else units_in_words(name)
        return INERTIA in words and case.inertia_unit == "1" and case.time.unit != "1"

    @cached_property
    def vectors(self) -> Mapping[str, np.ndarray]:
        """The variables over the `axes`, (n, 3) if these are all: those stored, and the angular
        momentum G."""
        vectors = {
            str(name): np.asarray(variable.data)
            for name, variable in self.data.items()
            if variable.dims == ("time", "axis")
        }
        if "omega" not in vectors or not self.case.data.get("inertia"):
            return vectors
        if self.axes == BODY_AXES and self.frame:
            return vectors | {"G": self.frame.momentum(vectors["omega"])}
        if self.frame and self.frame.principal_axes is not None:
            return vectors  # each component of G needs all of omega
        moments = self.inertia[[BODY_AXES.index(axis) for axis in self.axes]]
        return vectors | {"G": rigid_body.angular_momentum(moments, vectors["omega"])}

    @property
    def frame(self) -> rigid_body.BodyFrame | None:
        """The body, where its model is one of a body that turns freely in its own axes."""
        return self.case.system if isinstance(self.case.system, rigid_body.BodyFrame) else None

    @property
    def body(self) -> tuple[Any, ...]:
        """The numbers that tell one body from another."""
        return *self.inertia.tolist(), *self.principal_axes.ravel().tolist()

    @cached_property
    def principal_axes(self) -> np.ndarray:
        """The principal axes, row by row (3, 3), in the axes of vectors."""
        axes = self.frame.principal_axes if self.frame else None
        return np.eye(3) if axes is None else axes

    @property
    def principal_G(self) -> np.ndarray:
        """Angular momentum (n, 3) along the principal axes."""
        return self.frame.to_principal(self.G) if self.frame else self.G

    @cached_property
    def principal_omega(self) -> np.ndarray:
        """Angular velocity (n, 3) along the principal axes."""
        return self.frame.to_principal(self.omega) if self.frame else self.omega

    def check_separatrix(self) -> None:
        """Raise HodoError for a body whose motions no separatrix divides by the sign of D."""
        if reason := self.case.system.no_separatrix_reason:
            raise HodoError(f"{self.words} has no separatrix to be drawn: {reason}")

    @property
    def quadrants(self) -> np.ndarray:
        """(w_l^2, K w_s^2) (n, 2): the separatrix is the diagonal, and D > 0 below it.

        Raises HodoError for a body with a rotor, and where K is infinite.
        """
        self.check_separatrix()
        K = rigid_body.slope(self.inertia)
        if math.isinf(K):
            raise HodoError(
                f"{self.words} has no quadrants: its two larger moments of inertia are equal"
            )
        largest, _, smallest = self.order
        return np.asarray(self.principal_omega[:, [largest, smallest]] ** 2 * [1, K])

    def _over_time(self, name: str) -> bool:
        return name in self.data and self.data[name].dims == ("time",)

    def _hint(self, name: str) -> str:
        """The names that stand for variables, for the message about one that does not."""
        if name in self.vectors:
            return f"{name} is a vector of components {', '.join(component_names(name, 'axis'))}"
        has = [
            *(f"{vector}.{axis}" for vector in self.vectors for axis in BODY_AXES),
            *(str(name) for name in self.data if name != "time" and self._over_time(str(name))),
            *derivable_numbers(self.sources),
        ]
        return f"it has {', '.join(dict.fromkeys(has))}"

    @cached_property
    def sources(self) -> set[str]:
        """The variables and constants that it has for quantities to follow from."""
        return {*map(str, self.data)} | constants_of(self.case.system, self.case.data)

    @cached_property
    def time(self) -> np.ndarray:
        """Times (n,)."""
        return self.stored("time")

    @property
    def sampled(self) -> bool:
        """Whether there is any sample."""
        return "time" in self.data and bool(self.data["time"].data.size)

    @property
    def omega(self) -> np.ndarray:
        """Angular velocity (n, 3) in body axes. Raises KeyError for a case without it."""
        return self.vector("omega")

    @cached_property
    def inertia(self) -> np.ndarray:
        """Principal moments of inertia (3,)."""
        if self.frame:
            return self.frame.moments
        moments = self.case.data["inertia"]
        if isinstance(moments, Mapping):  # a top gives A, twice, and C
            moments = (moments["A"], moments["A"], moments["C"])
        return np.array(moments, dtype=float)

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """The positions of the largest, middle and smallest moment of inertia."""
        return rigid_body.inertia_order(self.inertia)

    @cached_property
    def G(self) -> np.ndarray:
        """Angular momentum (n, 3) in body axes. Raises HodoError for a case without it."""
        if "G" not in self.vectors:
            if "omega" in self.data:
                self.component("omega", "x1")
            raise HodoError(
                f"{self.words} ({self.case.model}, {self.case.form}) has no angular momentum "
                "in body axes"
            )
        return self.vector("G")

    @property
    def classified(self) -> bool:
        """Whether `classify` has stored an enclosed axis for each sample."""
        return self._over_time("enclosed_axis")

    @property
    def lacks_labels(self) -> bool:
        """Whether `classify` would label this motion, and has not."""
        return not (
            self.classified
            or self.case.sweep
            or self.case.system.no_axis_reason
            or "omega" not in self.vectors
            or not self.sampled
        )

    @cached_property
    def labels(self) -> np.ndarray:
        """The enclosed axis (n,). Raises HodoError if there is none, or if all that are far from
        the separatrix are those of another motion."""
        if not self.classified:
            command = f"hodo classify {quote(self.path)}"
            how = f"run `{command}` first" if self.path else "classify it first"
            raise HodoError(f"{self.words} has no labels of the enclosed axis: {how}")
        labels = self.stored("enclosed_axis")
        if self.has_own_labels:
            return labels
        if self.frame and "omega" in self.vectors and self._contradicts(self.frame, labels):
            raise HodoError(
                f"{self.words} has labels of another motion, as after arithmetic with a whole "
                "dataset: name the variable, as ds.assign(omega=2 * ds.omega)"
            )
        return labels

    def _contradicts(self, frame: rigid_body.BodyFrame, labels: np.ndarray) -> bool:
        """Whether omega contradicts every label, of some of the samples, that is beyond doubt."""
        count = min(len(labels), LABELS_COMPARED)
        few = np.linspace(0, max(len(labels) - 1, 0), count).astype(int)
        omega = self.omega[few]
        expected = frame.enclosed(frame.to_principal(omega), MIN_MARGIN_COMPARED)
        # Of the smallest numbers only the scaled state has a label.
        is_clear = (expected > 0) & (np.abs(omega).max(axis=1) > MIN_SIZE_COMPARED)
        return bool(is_clear.any() and (labels[few] != expected)[is_clear].all())

    @cached_property
    def crossings(self) -> tuple[Crossing, ...]:
        """The separatrix crossings. Raises as `labels` does: none known is not none there."""
        if not len(self.labels):
            return ()
        fields = {
            field: np.atleast_1d(self.stored(name)).tolist()
            if name in self.data
            else [math.nan] * self.data["crossing_time"].data.size
            for name, (field, _) in CROSSING_COLUMNS.items()
        }
        return tuple(
            Crossing(**dict(zip(fields, values, strict=True)))
            for values in zip(*fields.values(), strict=True)
        )

    @property
    def labels_at_ends(self) -> tuple[int, int]:
        """The labels with which it starts and ends; a body that a brake stops ends with the one
        that it has until then. Raises as `labels` does."""
        start = label_at_start(self.case, self.time[0], self.labels, self.crossings)
        has_stopped = self.labels[-1] == rigid_body.UNDETERMINED and math.isfinite(self.stop)
        return start, int((self.stored("event_from") if has_stopped else self.labels)[-1])

    @property
    def crossing_time(self) -> np.ndarray:
        """Times (m,) of the separatrix crossings from the first sample to the last; none in a case
        that is not classified."""
        crossings = self.crossings if self.classified else ()
        times = np.array([crossing.time for crossing in crossings])
        return times[(times >= self.time[:1]) & (times <= self.time[-1:])]

    @property
    def events(self) -> tuple[tuple[str, float], ...]:
        """Kind and time of each event of the motion itself, such as the end of spin."""
        if "event_time" not in self.data or "event_kind" not in self.data:
            return ()
        kinds, times = (np.atleast_1d(self.stored(f"event_{of}")) for of in ("kind", "time"))
        return tuple(zip(map(str, kinds), times.tolist(), strict=True))

    @property
    def stop(self) -> float:
        """The time at which a brake has brought the body to rest; infinite without."""
        return dict(self.events).get("stopped", math.inf)

    def at_crossings(self, values: np.ndarray) -> np.ndarray:
        """Values over time (n, k) at the crossings (m, k), interpolated between samples."""
        return np.stack(
            [np.interp(self.crossing_time, self.time, column) for column in values.T], axis=-1
        )


@np.errstate(all="ignore")  # what is no number is a gap in a curve, and meets no bound
def formula_values(motion: Motion, text: str) -> np.ndarray:
    """The values (n,) of a formula in the time `t` and the variables of a motion.

    Raises HodoError if the motion does not have one of them.
    """
    tree = parse_expression(text, FORMULA.names)
    values = {name: motion.time if name == "t" else motion[name] for name in names_in(tree)}
    return np.broadcast_to(np.asarray(evaluate(tree, values), float), motion.time.shape)


def is_of_time(text: str) -> bool:
    """Whether a formula is one in the time alone."""
    return not quantities_in(text)


LATER_COLUMNS = ("crossing_error", "crossing_G")
"""The columns that early files of format 1 lack; they are nan in a crossing."""


def motion_of(data: Variables, attrs: Mapping[str, Any], owner: str, path: str = "RUN") -> Motion:
    """The motion in a stored case, whose variables and attributes these are; `path` is its file.

    Raises HodoError, which begins with `owner`, if what is stored does not fit together.
    """
    case = case_of(attrs, owner)
    check_whole(data, owner, is_sweep=bool(case.sweep))
    return Motion(case, data, attrs, case.name, path)


def check_whole(data: Variables, owner: str, is_sweep: bool) -> None:
    """Raise HodoError, which begins with `owner`, if the variables of a motion or of a sweep are
    damaged."""
    if problem := wrong_labels(data) if is_sweep else damage(data):
        raise HodoError(f"{owner} is damaged ({problem})")


def case_of(attrs: Mapping[str, Any], owner: str) -> Case:
    """The case in the attributes of a stored one. Raises HodoError as `motion_of` does."""
    return parsed(typed(attrs, {"case": str}, owner)["case"])


# Most cases stand in several figures and on the page, and to parse one takes milliseconds.
parsed = lru_cache(maxsize=256)(parse_case)


def damage(data: Variables) -> str:
    """The damage to the variables of a single motion; an empty string if there is none."""
    required = required_dims(data)
    for name, dims in required.items():
        if name not in data or data[name].data.dtype.kind not in "fi":
            return f"its {name} is no array of numbers"
        if data[name].dims != dims:
            return f"its {name} has dimensions {', '.join(data[name].dims) or 'none'}"
    if problem := wrong_labels(data):
        return problem
    # A component for each of the body axes that are stored.
    axes = data["axis"].data.shape if "axis" in data else None
    if "omega" in required and data["omega"].data.shape[1:] != axes:
        return "its omega holds no vectors"
    names = [*required, *(name for name in EVENT_COLUMNS if name in data)]
    try:
        dimension_sizes({name: data[name] for name in names})
    except ValueError as error:
        return f"its {error}"
    return ""


def required_dims(data: Variables) -> dict[str, tuple[str, ...]]:
    """The dimensions that the variables of a single motion must have, those of the variables that
    it lacks too."""
    required: dict[str, tuple[str, ...]] = {"time": ("time",)}
    # A selection of one component leaves a number over time.
    if "omega" in data and data["omega"].dims != ("time",):
        required["omega"] = ("time", "axis")
    if "enclosed_axis" in data:  # labels and crossings are stored together
        required["enclosed_axis"] = ("time",)
        columns = (name for name in CROSSING_COLUMNS if name not in LATER_COLUMNS or name in data)
        required |= dict.fromkeys(columns, ("crossing",))
    return required


def wrong_labels(data: Variables) -> str:
    """Which variable of a case or of a sweep holds numbers that are labels of no axis; an empty
    string if none does."""
    for name in ("enclosed_axis", *AXIS_LABELS):
        if name in data and not np.isin(data[name].data, list(rigid_body.LABELS)).all():
            return (
                f"its {name} holds labels that are none, as after arithmetic with a whole dataset"
            )
    return ""


# What follows from the samples


def _momentum(m: Motion) -> np.ndarray:
    """|G|, right also where G^2 underflows; of the averaged cavity's x = p^2 + q^2 and y = r^2."""
    if "omega" in m.data:
        # hypot scales by itself; the square of 1e-170 is 0.
        return np.asarray(np.hypot.reduce(m.G, axis=-1))
    if "momentum" in m.data:
        return m.stored("momentum")
    x, y = m.stored("x"), m.stored("y")
    return np.asarray(np.sqrt(m.inertia[0] ** 2 * x + m.inertia[2] ** 2 * y))


def _energy(m: Motion) -> np.ndarray:
    if "kinetic_energy" in m.data:
        return m.stored("kinetic_energy")
    return rigid_body.kinetic_energy(m.inertia, m.principal_omega)


def _separatrix(m: Motion) -> np.ndarray:
    """D = G^2 - 2 T A_middle, without the cancellation of this difference."""
    m.check_separatrix()
    outer, inner = rigid_body.separatrix_terms(m.inertia, m.principal_omega.T, m.order)
    return np.asarray(outer - inner)


# A body at rest has no ratio, and its curve a gap.
_ratio = partial(rigid_body.share_of, of_nothing=np.nan)


def _of_direction(quantity: Callable[[Motion], np.ndarray], m: Motion) -> np.ndarray:
    """A quantity that knows only the direction of omega, of omega at a size near 1: the squares of
    1e-160 have lost their digits. It is no number where omega itself has lost its own."""
    if "omega" not in m.data or m.case.system.no_separatrix_reason:  # h has a size of its own
        return quantity(m)
    size = np.abs(m.omega).max(axis=1, keepdims=True)
    near_1 = np.ldexp(m.omega, -np.frexp(size)[1])
    near_1[size[:, 0] < sys.float_info.min] = np.nan
    return quantity(replace(m, data={**m.data, "omega": Variable(("time", "axis"), near_1)}))


def _separatrix_ratio(m: Motion) -> np.ndarray:
    if "omega" not in m.data:  # of an averaged form
        return np.asarray(m["J"] - m.inertia[m.order[1]])
    return _ratio(2 * _energy(m), _separatrix(m))


def _momentum_over_energy(m: Motion) -> np.ndarray:
    """J = G^2/2T."""
    return _ratio(2 * _energy(m), _momentum(m) ** 2)


def _tilt(m: Motion) -> np.ndarray:
    """The angle between G and x3; none without a G."""
    across, along = np.hypot(m.G[:, 0], m.G[:, 1]), m.G[:, 2]
    return np.where(m.G.any(axis=1), np.arctan2(across, along), np.nan)


def _x1_direction(m: Motion) -> np.ndarray:
    return _ratio(_momentum(m), np.abs(m.G[:, 0]))


def _separatrix_distance(m: Motion) -> np.ndarray:
    return _ratio(_momentum(m) ** 2, np.abs(_separatrix(m)))


def directions_of_momentum(m: Motion) -> np.ndarray:
    """G/|G| (n, 3) in body axes, nan where the body is at rest."""

    def directions(m: Motion) -> np.ndarray:
        size = _momentum(m)[:, None]
        return np.asarray(m.G / np.where(size > 0, size, np.nan))

    return _of_direction(directions, m)


def _of_top(of_state: Callable[..., Sequence[np.ndarray]], i: int, m: Motion) -> np.ndarray:
    """One of the quantities that follow from omega and the vertical of a top, with mu as it is at
    each time."""
    k = with_mu(attributes(m.case.system.constants), m.time)
    return np.asarray(of_state([*m.omega.T], [*m.vector("gamma").T], k)[i])


# What follows from a stored attitude

POLE_SINE = 1e-7
"""The sine of theta below which phi and psi have lost half of their digits: they are not numbers
there."""


def rotations(m: Motion) -> Any:
    """The attitudes as SciPy's rotations. Raises KeyError where none are stored, HodoError where
    they lack a part."""
    from scipy.spatial.transform import Rotation  # late: it takes longer than most pictures

    quaternions = m.stored("attitude")
    if quaternions.shape[1:] != (4,):
        raise HodoError(f"{m.words} has an attitude that lacks a part")
    return Rotation.from_quat(np.roll(quaternions, -1, axis=1))


def in_space(m: Motion, vectors: np.ndarray) -> np.ndarray:
    """Vectors of the body, (n, 3) or one that it carries along (3,), in space axes (n, 3)."""
    return np.asarray(rotations(m).apply(vectors))


def momentum_with_fluid(m: Motion) -> np.ndarray:
    """G - kappa omega' (n, 3) in body axes, omega' that of the free body: the momentum of body and
    fluid together, to first order in kappa. Raises KeyError for a body without a fluid."""
    axes, k = m.principal_axes, attributes(m.case.system.constants)
    acceleration = (np.cross(m.G, m.omega) @ axes.T / m.inertia) @ axes
    kappa = np.reshape(coefficient_at(k, "kappa", m.time), (-1, 1))
    return np.asarray(m.G - kappa * acceleration)


def euler_angle(name: str, m: Motion) -> np.ndarray:
    """psi, theta or phi (n,) of the turns by psi about z, theta about x1 and phi about x3, one
    after another: precession, nutation and spin. psi and phi are at most half a turn, and no
    numbers where theta is 0 or pi."""
    turned = rotations(m)
    axis = turned.apply(np.eye(3)[2])
    sine = np.hypot(axis[:, 0], axis[:, 1])
    if name == "theta":
        return np.asarray(np.arctan2(sine, axis[:, 2]))
    vertical = turned.inv().apply(np.eye(3)[2])
    x, y = (axis[:, 0], -axis[:, 1]) if name == "psi" else (vertical[:, 0], vertical[:, 1])
    return np.where(sine > POLE_SINE, np.arctan2(x, y), np.nan)


EULER_ANGLES = ("psi", "theta", "phi")
ANGLES_THAT_TURN = ("psi", "phi")

SAFE_CHANGE, SAFE_TURN = math.pi / 2, 1.0
"""The change of an angle from one sample to the next, and the turn of the body, up to which no
whole turn can be lost."""

PLACES_OF_PATH, PATH_ERROR = 33, 1 / 50
"""The places of a path between two samples, and how far it may be off in the fourth power of the
turn: eight times what a cubic misses of a circle."""


def continued(m: Motion, name: str, values: np.ndarray) -> np.ndarray:
    """psi or phi (n,) as it goes on from sample to sample; no number from where samples are too few
    to tell on which side x3 passes the vertical: whole turns are lost then."""
    known = np.flatnonzero(np.isfinite(values))
    values[known] = np.unwrap(values[known])
    if "omega" not in m.data or len(m.axes) < 3:
        return values
    turned, omega, time = rotations(m)[known], m.omega[known] * time_factor(m), m.time[known]
    # psi is an azimuth of x3 in space; phi one of the vertical in the body, the other way round.
    sense, path = 1, turned.apply(np.eye(3)[2])
    slope = np.cross(turned.apply(omega), path)
    if name == "phi":
        sense, path = -1, turned.inv().apply(np.eye(3)[2])
        slope = np.cross(path, omega)
    speed = np.linalg.norm(omega, axis=1)
    turn, changes = np.maximum(speed[1:], speed[:-1]) * np.diff(time), np.diff(values[known])
    unsafe = np.flatnonzero((np.abs(changes) > SAFE_CHANGE) | (turn > SAFE_TURN))
    by_path, nearest = turned_azimuth(path, slope, time, unsafe)
    whole = np.zeros(len(changes))
    whole[unsafe] = np.round((sense * by_path - changes[unsafe]) / math.tau)
    values[known[1:]] += math.tau * np.cumsum(whole)
    lost = unsafe[nearest < PATH_ERROR * turn[unsafe] ** 4]
    if lost.size:
        values[known[lost[0]] + 1 :] = np.nan
    return values


def turned_azimuth(
    path: np.ndarray, slope: np.ndarray, time: np.ndarray, after: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The changes (k,) of the azimuth along a path of unit vectors (n, 3) with known slopes (n, 3)
    at times (n,), each from one of the samples `after` (k,) to the next, by a cubic between the
    two; and how near (k,) it comes to the pole."""
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


def time_factor(m: Motion) -> float:
    """The factor from the case's time to that of which omega is a rate: of a full top, whose time
    is the slow one, 1 over its small parameter."""
    system = m.case.system
    factor = system.quaternion_factor
    return float(factor(attributes(system.constants))) if factor else 1.0


OF_ATTITUDE: dict[str, Callable[[Motion], np.ndarray]] = {
    "G_space": lambda m: in_space(m, m.G),
    "total_space": lambda m: in_space(m, momentum_with_fluid(m)),
    "omega_space": lambda m: in_space(m, m.omega),
    **{f"x{i}_space": partial(in_space, vectors=axis) for i, axis in enumerate(np.eye(3), 1)},
    **{name: partial(euler_angle, name) for name in EULER_ANGLES},
    # The same along the axes of body and of space.
    "rotation": lambda m: np.asarray(rotations(m).as_rotvec()),
}
"""The quantities of `cases.derived` that follow from a stored attitude."""


QUANTITIES: dict[str, Callable[[Motion], np.ndarray]] = {
    "p": lambda m: m.component("omega", "x1"),
    "q": lambda m: m.component("omega", "x2"),
    "r": lambda m: m.component("omega", "x3"),
    "G": _momentum,
    "G2": lambda m: np.asarray((m.G * m.G).sum(axis=-1)),
    "T": _energy,
    "J": partial(_of_direction, _momentum_over_energy),
    "D": _separatrix,
    "D/2T": partial(_of_direction, _separatrix_ratio),
    "x1_direction": partial(_of_direction, _x1_direction),
    "tilt": partial(_of_direction, _tilt),
    "separatrix_distance": partial(_of_direction, _separatrix_distance),
    "speed": lambda m: np.hypot.reduce(m.omega, axis=-1),
    "x": lambda m: m.component("omega", "x1") ** 2 + m.component("omega", "x2") ** 2,
    "y": lambda m: m.component("omega", "x3") ** 2,
    "Gz": partial(_of_top, first_integrals, 0),
    "H": partial(_of_top, first_integrals, 1),
    "u1": partial(_of_top, roots_of_motion, 0),
    "u2": partial(_of_top, roots_of_motion, 1),
    "u3": partial(_of_top, roots_of_motion, 2),
    **OF_ATTITUDE,
}
"""How each quantity of `DERIVED` follows from a motion that has what it needs: (n,), or (n, 3)
where it has components."""


def units_in_words(name: str) -> str:
    """The units of the time, which sweeps do not store, of a quantity of `DERIVED`, or of a
    component of one; "1" for any other name."""
    return DERIVED[name].units if name in DERIVED else {"time": "time"}.get(name, "1")
