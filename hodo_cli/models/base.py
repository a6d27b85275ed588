"""The base class of all models, and what engines need of a model.

A model states its equations y' = rhs(t, y, k), the start and the stored variables. An engine needs
the constants k as a flat list of numbers, the Jacobian, and other units of omega and of time.

Other units: with omega = sigma W and the engine's time s = rho t, a constant whose term is of
degree d in omega becomes value * sigma**(d - 1) / rho. With a fitting sigma the state W stays near
1 however far a motion decays.
"""

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..schema.kinds import KeyPath, Mistake, Rule
from .euler import TERMS, about, composed, in_case_axes, quaternion_rates, turned_back
from .terms.time_laws import EPOCH, EPOCH_NAME, CaseConstants

ATTITUDE_KEY, CONSTANTS_KEY = "attitude", "constants"
"""The keys of a case for the attitude at the start, and for the constants that expressions name."""

OWN_FOLDER = str(Path(__file__).parents[1])
"""The folder of this package. A model outside it is a user's own."""

Constants = Mapping[str, float | tuple[float, ...] | str]
"""The constants of a model by name: numbers, tuples of numbers, and strings. A string chooses
between equations."""

Structure = tuple[tuple[str, int | str], ...]
"""Constants without their numbers: each name with its length (0 for a plain number) or its
string."""

LENGTHS = {"axis": 3, "quaternion": 4, "principal": 3, "space": 3}
"""The lengths of the dimensions of stored variables, besides time."""

REST_BITS = 2**12
"""A motion whose size is 2**-REST_BITS = 1e-1233 is at rest. That is far below the smallest
double."""


class Label(NamedTuple):
    """The dimensions, the long name and the unit of one variable in a result file."""

    dims: tuple[str, ...]
    long_name: str
    units: str = "1"

    @property
    def width(self) -> int:
        """The number of its components at one time."""
        return math.prod(LENGTHS.get(dim, 1) for dim in self.dims)


QUATERNION = ("attitude_a", "attitude_b", "attitude_c", "attitude_d")
"""The state variables of an attitude."""

ATTITUDE_VARIABLE = {
    ATTITUDE_KEY: Label(("time", "quaternion"), "attitude, from body to space axes")
}


class EventOutcome(NamedTuple):
    """What an event does to a motion.

    The motion goes on from the time `onward` with the state `state`; where `onward` is None it ends
    with that state. An infinite `onward` means that the state lasts; the attitude then turns at the
    constant angular velocity `spin` (3,) in the axes of the case.

    The result file stores `time` and the numbers of `details`. It stores nothing of an event whose
    `details` are None.
    """

    time: float
    details: Mapping[str, float] | None
    state: Sequence[Any]
    onward: Any = None
    spin: Sequence[Any] = ()

    def states(self, times: Any, fp: Any = float) -> np.ndarray:
        """The states (..., m) at times (...) between the event and `onward`, of the number type
        `fp`."""
        state, omega = np.array(self.state, dtype=fp), np.array(self.spin, dtype=fp)
        states = np.broadcast_to(state, (*np.shape(times), len(state)))
        if (omega != 0).any():
            # Only by operations that numbers of quadruple precision, no type of numpy's, have too.
            peak = np.abs(omega).max()
            speed = peak * np.sqrt(np.square(omega / peak).sum())
            angle = (np.asarray(times, dtype=fp) - fp(self.time)) * speed
            turned = composed(state[-4:], about(omega / speed, angle))
            states = np.concatenate((states[..., :-4], np.stack(turned, axis=-1)), axis=-1)
        return states


class Event(NamedTuple):
    """A zero of `function(t, y, k)`. The integration ends at a `terminal` event.

    A model with `degree` gives the function states in units that fit the motion, so the function
    has to be homogeneous in the unit of omega.

    After a terminal event with a `passage` the motion may go on: `passage(t, y, k)` says how. Its
    arguments are numbers of the working precision, in the case's own units.
    """

    kind: str
    function: Callable[[Any, Sequence[Any], Any], Any]
    terminal: bool = False
    passage: Callable[[Any, Sequence[Any], Any], EventOutcome] | None = None


@dataclass(frozen=True)
class HashablePartial:
    """A function with its first arguments given, as by `functools.partial`. But two with the same
    function and arguments are equal, so that one compilation serves both."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __call__(self, *others: Any) -> Any:
        return self.function(*self.arguments, *others)


@dataclass(frozen=True)
class Model:
    """One form of a model. The class states the equations, an object holds the data of one case.

    The fields of a form are its `keys`: `LinearDiag(inertia=..., damping=..., initial=...)` is a
    body, and `start`, `constants`, `warnings` and the events follow from these fields. An object
    takes its data as right; `check` finds their mistakes before it is made.

    `rhs(t, y, k)` and the functions of events use + - * / and ** and the functions of `arithmetic`
    only, so that numbers, arrays and the symbols of an engine all pass through the same lines. `k`
    has the names of `constants` as attributes. These functions do not use the object, because an
    engine compiles them once for all cases with equal `Equations`.

    In `rhs`, events and `output` the time t is the case's own, whatever the units of the state. The
    state of an event ends with the quaternion where a motion has an attitude.
    """

    attitude: Any = field(default=None, kw_only=True)
    """The key `attitude` of the case: where the body points at the start. None or False where the
    motion has no attitude."""

    case_constants: CaseConstants = field(default=(), kw_only=True)
    """The constants that the expressions of the case name, as pairs of a name and a number. An
    epoch, from which expressions count t, is among them. (`constants` holds the numbers of the
    equations.)"""

    is_backward: bool = field(default=False, kw_only=True)
    """Whether the case runs backward. The time of its motion, which always rises, is minus the
    time of the case."""

    name: ClassVar[str]
    form: ClassVar[str]
    keys: ClassVar[dict[str, Rule]]
    state: ClassVar[tuple[str, ...]]
    variables: ClassVar[dict[str, Label]]

    degree: ClassVar[dict[str, int]] = {}
    """For each constant, the degree in omega of the terms that it multiplies.

    Degrees make other units possible: with omega = sigma W and s = rho t a constant becomes
    value * sigma**(degree - 1) / rho. A constant of degree 0 is a torque that spins a body up, so
    it limits the unit sigma from below. A term without a degree converts by the constants
    `velocity_unit` (sigma) and `time_unit` (1/rho), which are 1 in the case's own units. A model
    without degrees is integrated in the case's own units.
    """

    resisting: ClassVar[frozenset[str]] = frozenset()
    """The constants of degree 0 that resist every rotation, as a brake does. They do not limit the
    unit of omega."""

    quaternion_factor: ClassVar[Any] = None
    """quaternion_factor(k) is the factor f of Q' = f Q (0, omega)/2 for the attitude Q. None for a
    model whose motions have no attitude."""

    fixed_in_space: ClassVar[tuple[str, ...]] = ()
    """The names of three state variables: the components along body axes of a vector that is fixed
    in space. With an attitude, `start` holds the components of this vector along space axes."""

    starts_with_omega: ClassVar[bool] = False
    """Whether the initial data are an angular velocity in body axes."""

    always_absorbing: ClassVar[bool] = False
    """Whether all data give `absorbing_axes`: no motion crosses the separatrix twice, and errors do
    not grow near it."""

    slow_time: ClassVar[bool] = False
    """Whether the time of the model is the slow time tau = epsilon t."""

    is_quadrature: ClassVar[bool] = False
    """Whether the motion is a quadrature: a closed form without an rhs, so that no other method can
    integrate it. The stored variables then include `enclosed_axis`, and the one event is a
    crossing."""

    no_axis_reason: ClassVar[str] = (
        "the state has no angular velocity in body axes, so no axis is enclosed"
    )
    """Why the hodograph of this model encloses no axis; empty where it may enclose one."""

    output: ClassVar[Callable[..., dict[str, np.ndarray]]]
    """output(t, y, k): the stored variables at times (n,), from the states y (n, m) there and in
    their dtype.

    Errors of a model with `degree` are judged in other units of omega, so each stored variable has
    to be homogeneous in this unit.
    """

    attitude_at: ClassVar[Callable[..., tuple[Any, ...]]]
    """self.attitude_at(start): the quaternion (4,) of the attitude at a start (m,)."""

    exact_states: ClassVar[Callable[..., tuple[np.ndarray, np.ndarray]]]
    """self.exact_states(t), where there is a closed form: states y (n, m) of size about 1 and
    exponents e (n,) at the times t (n,) since the start, in the precision of t. The unit of omega
    in y is 2**e."""

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """The time derivative of each state variable."""
        raise NotImplementedError("the model states no rhs")

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """The mistakes in `data`, the values of the keys of a case, each of which is valid alone.

        A key is missing from `data` where its value is wrong by itself.
        """
        yield from ()

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        """The mistakes that valid data make in a motion from `start` to `end`."""
        yield from ()

    @classmethod
    def of(
        cls, data: Mapping[str, Any], epoch: float | None = None, is_backward: bool = False
    ) -> "Model":
        """The model with the data of a case. Expressions in the data count t from the `epoch`."""
        own, sign = dict(data), -1.0 if is_backward else 1.0
        of_epoch = {EPOCH_NAME: sign * epoch} if epoch else {}
        # Pairs and not a mapping, because the object has a hash.
        named = (*(own.pop(CONSTANTS_KEY, None) or {}).items(), *of_epoch.items())
        return cls.form_of(data)(**own, case_constants=named, is_backward=is_backward)

    @classmethod
    def form_of(cls, data: Mapping[str, Any]) -> "type[Model]":
        """The class that integrates these data: this one, or another one in its place."""
        return cls

    @cached_property
    def constants(self) -> Constants:
        """The numbers that `rhs` uses, by name."""
        raise NotImplementedError

    @property
    def start(self) -> tuple[float, ...]:
        """The initial state."""
        raise NotImplementedError

    @cached_property
    def equations(self) -> "Equations":
        """The equations of this case without their numbers."""
        return Equations(
            type(self), structure(self.constants), bool(self.attitude), self.is_backward
        )

    @property
    def no_separatrix_reason(self) -> str:
        """Why D does not show which axis is enclosed; empty where it does."""
        says = "with a rotor D says nothing, and the enclosed axis is undetermined"
        return says if "rotor" in self.equations.terms else ""

    @cached_property
    def initial_state(self) -> tuple[float, ...]:
        """The start, followed by the attitude there if the case has one."""
        return self.with_attitude(np.array(self.start)) if self.attitude else self.start

    def with_attitude(self, start: np.ndarray) -> tuple[Any, ...]:
        """A start followed by the attitude there. The components of a vector that is fixed in space
        become those along the axes of the state."""
        Q = self.attitude_at(start)
        rows = [i for i, name in enumerate(self.equations.state) if name in self.fixed_in_space]
        if rows:
            start[rows] = self.to_principal(np.array(turned_back(Q, [*start[rows]])))
        return *start.tolist(), *Q

    def to_principal(self, vectors: np.ndarray) -> np.ndarray:
        """The components along the axes of the state of vectors (..., 3), which are given along the
        axes of the case. The precision is that of the vectors."""
        return vectors

    @property
    def extended_start(self) -> np.ndarray:
        """The initial state (m,) in long double, from which a reference begins. It has more digits
        than `initial_state` where rounding to doubles loses some."""
        return np.array(self.initial_state, dtype=np.longdouble)

    def tilt_growth(self, t: float) -> np.ndarray | None:
        """The rates (3,) at which a small tilt away from each body axis grows at the time t; None
        where no such rate exists."""
        return None

    def predictions(self, start: float, end: float) -> list[str]:
        """Sentences of theory about the motion between two times. The unit of a number stands after
        it in words, as in "turns in 12.5 [time]"."""
        return []

    @property
    def has_closed_form(self) -> bool:
        """Whether `exact_states` gives the motion."""
        return False

    def exact_end(self, fp: type) -> tuple[str, EventOutcome] | None:
        """The kind and the outcome of the event of a motion in closed form, computed with numbers
        of the type `fp`; None without an event. Its time counts from the start."""
        return None

    def absorbing_axes(self, start: float, end: float) -> frozenset[int]:
        """The axes (1 to 3) that the hodograph encloses until `end` once it encloses them, for
        every start. They follow from the equations alone."""
        return frozenset()

    @property
    def warnings(self) -> list[str]:
        """Sentences on data for which the assumptions of the model do not hold."""
        return []

    def warnings_within(self, start: float, end: float) -> list[str]:
        """Sentences on data for which the assumptions fail at some time from `start` to `end`."""
        return []

    @property
    def run_events(self) -> tuple[Event, ...]:
        """The events of the motion itself: every integration records them."""
        return ()

    @property
    def class_events(self) -> tuple[Event, ...]:
        """The further events that `classify` looks for."""
        return ()


@dataclass(frozen=True)
class Equations:
    """The equations of all cases with the same form and the same structure of constants. They are
    compiled once. In the state the quaternion of an attitude follows the variables of the form.

    Where `time_start` and `time_unit` are among the constants, the equations are functions of the
    engine's time s: the case's own time is t = time_start + s time_unit.
    """

    form: type[Model]
    structure: Structure = ()
    has_attitude: bool = False
    is_backward: bool = False

    @cached_property
    def names(self) -> frozenset[str]:
        """The names of the constants."""
        return frozenset(name for name, _ in self.structure)

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """The names of the torques, if the structure names any."""
        return tuple(str(dict(self.structure).get(TERMS_NAME, "")).split())

    @cached_property
    def rows(self) -> dict[str, int]:
        """The variables of the state, each with the power d >= 0 of the unit of omega that it
        carries. d is 0 for a direction, which has a size of its own.

        In the rate of a variable the degree of a constant is 1 - d more than the power of omega in
        its terms. So the factor of Q' = Q (0, omega)/2, with d = 0, is of degree 2, as `g` is in
        Euler's equations.
        """
        extra = {row: power for name in self.terms for row, power in TERMS[name].extra.items()}
        turning = dict.fromkeys(QUATERNION * self.has_attitude, 0)
        return dict.fromkeys(self.form.state, 1) | extra | turning

    @cached_property
    def state(self) -> tuple[str, ...]:
        """The names of the state variables."""
        return tuple(self.rows)

    @cached_property
    def degree(self) -> dict[str, int]:
        """For each of these constants, the degree in omega of the terms that it multiplies."""
        return {name: n for name, n in self.form.degree.items() if name in self.names}

    @property
    def variables(self) -> dict[str, Label]:
        """The stored variables."""
        return self.form.variables | (ATTITUDE_VARIABLE if self.has_attitude else {})

    @property
    def may_stop(self) -> bool:
        """Whether a brake may bring the motion to rest: G is then 0 and encloses no axis."""
        return "brake" in self.terms

    @property
    def always_absorbing(self) -> bool:
        """As in the form. Theory holds for motions forward in time only."""
        return self.form.always_absorbing and not self.is_backward

    @cached_property
    def has_formulas(self) -> bool:
        """Whether the equations hold a user's formula: an expression of the case, or a model of the
        user's own. A formula may change at any rate within a step."""
        forms = (sys.modules[x.__module__] for x in self.form.__mro__ if issubclass(x, Model))
        is_own = not all(str(module.__file__).startswith(OWN_FOLDER) for module in forms)
        has_laws = any(name.endswith("_law") for name in self.names)
        return has_laws or is_own or "expression" in self.terms

    def rhs(self, t: Any, y: Sequence[Any], k: Any) -> Sequence[Any]:
        """The time derivative of each state variable."""
        t, k = self.in_case_time(t, k)
        rates: Sequence[Any] = ()
        if self.has_attitude:
            y, Q, factor = y[:-4], y[-4:], self.form.quaternion_factor(k)
            rates = quaternion_rates(in_case_axes(y[:3], k), Q, factor)
            k = SimpleNamespace(**vars(k), attitude=Q) if "expression" in self.terms else k
        rates = (*self.form.rhs(t, y, k), *rates)
        rates = [-rate for rate in rates] if self.is_backward else rates
        # Constants with degrees are in the engine's units, and so are these rates. Without degrees
        # the rates are by the case's time, and the engine's unit of time is a constant.
        is_own_unit = self.degree or START not in self.names
        return rates if is_own_unit else [rate * k.time_unit for rate in rates]

    def output(self, t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        """The stored variables at the times t (n,) from the states y (n, m), in their dtype."""
        t, k = self.in_case_time(t, k)
        if not self.has_attitude:
            return self.form.output(t, y, k)
        return self.form.output(t, y[:, :-4], k) | dict.fromkeys(ATTITUDE_VARIABLE, y[:, -4:])

    def in_case_time(self, t: Any, k: Any) -> tuple[Any, Any]:
        """The time t that the form's `rhs` takes, and its constants, from the time and constants of
        an engine."""
        if START in self.names:
            t, k = from_engine_time(t, k)
        if self.is_backward:
            t, k = -t, with_epoch(k, -k.epoch) if hasattr(k, EPOCH) else k
        return t, k


def mistake_of(at: KeyPath, function: Callable[..., object], *arguments: Any) -> Iterator[Mistake]:
    """The mistake that a function finds: the message of the ValueError that it raises, with the
    path `at` in the case. No mistake where it raises none."""
    try:
        function(*arguments)
    except ValueError as error:
        yield at, str(error)


def structure(k: Constants) -> Structure:
    """The structure of constants. Code that is compiled for one structure serves all numbers."""
    sizes = {name: len(value) for name, value in k.items() if isinstance(value, tuple)}
    return tuple(
        (name, value if isinstance(value, str) else sizes.get(name, 0)) for name, value in k.items()
    )


def count(of: Structure) -> int:
    """The number of numbers in constants of this structure."""
    return sum(max(size, 1) for _, size in of if isinstance(size, int))


def flatten(k: Constants) -> list[float]:
    """The numbers of the constants as a list, in order."""
    numbers = [value for value in k.values() if not isinstance(value, str)]
    return [x for value in numbers for x in (value if isinstance(value, tuple) else (value,))]


def attributes(k: Constants, number: Callable[[float], Any] = float) -> SimpleNamespace:
    """The constants as attributes of an object, each number converted by `number`."""
    return namespace(structure(k), [number(value) for value in flatten(k)])


def namespace(of: Structure, numbers: Iterable[Any]) -> SimpleNamespace:
    """Constants of a structure as attributes of an object. Their numbers, or the symbols in place
    of numbers, are taken in order."""
    supply = iter(numbers)

    def constant(length: int | str) -> Any:
        if isinstance(length, int):
            return tuple(islice(supply, length)) if length else next(supply)
        return length  # the constant is a string, and its structure is the string itself

    return SimpleNamespace(**{name: constant(length) for name, length in of})


def state_powers(model: Equations) -> np.ndarray:
    """The power of the unit of omega that each state variable carries (m,). All are 0 for a model
    without degrees, whose units stay those of the case."""
    powers = [power if model.degree else 0 for power in model.rows.values()]
    # C's int, because np.ldexp takes ten times as long with wider integers.
    return np.array(powers, dtype=np.intc)


def rescaled(model: Equations, y: np.ndarray, exponent: Any) -> np.ndarray:
    """States y (..., m) in a unit of omega that is smaller by the factor 2**exponent (...)."""
    # The variables are the first axis in memory, as in columns of motions, so that it stays so.
    powers = np.moveaxis(np.multiply.outer(state_powers(model), exponent), 0, -1)
    return np.asarray(np.ldexp(y, powers))


def moving(model: Equations) -> np.ndarray | slice:
    """The positions of the state variables that carry a unit of omega. Their size is the size of a
    motion."""
    powers = state_powers(model)
    # All positions as a slice, because it makes a view where an array of positions makes a copy.
    return np.flatnonzero(powers) if model.degree and not powers.all() else slice(None)


def kinds_of_variables(model: Equations) -> list[np.ndarray]:
    """The positions of the state variables that carry a unit of omega, and the positions of the
    others; an empty list is left out. Each of these kinds has a size of its own, because omega may
    decay by any factor while a direction does not."""
    powers = state_powers(model)
    kinds = np.flatnonzero(powers), np.flatnonzero(powers == 0)
    return [rows for rows in kinds if rows.size]


def in_unit(constant: Any, exponent: Any) -> Any:
    """A constant of a model, which is a number or a tuple of numbers, times 2**exponent."""
    if isinstance(constant, tuple):
        return tuple(np.ldexp(number, exponent) for number in constant)
    return np.ldexp(constant, exponent)


def jacobian(model: Equations, k: SimpleNamespace, t: Any, y: np.ndarray) -> np.ndarray:
    """The matrix d rhs_i/d y_j at y (m,) or (m, n), of shape (m, m) or (m, m, n). It is exact to
    rounding: the imaginary part of rhs_i, divided by h, at the state with ih added to y_j.

    Source: W. Squire and G. Trapp, SIAM Review 40 (1998) 110.
    """
    # Terms of the order of tiny**2 are far below rounding, so that the series is not truncated. No
    # difference is taken, so nothing cancels.
    tiny, unit_steps = 1e-100, np.eye(len(y)).reshape(len(y), len(y), *[1] * (y.ndim - 1))
    steps = y[:, None] + 1j * tiny * unit_steps
    return (stacked(model.rhs(t, list(steps), k), steps).imag / tiny).astype(float)


def stacked(rates: Sequence[Any], y: np.ndarray) -> np.ndarray:
    """The rates of the state variables (m, ...) as an array of the shape of the states y. A rate
    may also be one number for all states."""
    rows = np.empty_like(y)
    for i, rate in enumerate(rates):
        rows[i] = rate
    return rows


TERMS_NAME = "terms"
"""The constant of a body that names its torques, as a string."""

START, UNIT, VELOCITY = "time_start", "time_unit", "velocity_unit"
"""The constants of equations in an engine's units: the case's time at which a stretch of the motion
begins, and the engine's units of time and of angular velocity in those of the case."""


@lru_cache(maxsize=64)
@np.errstate(all="ignore")
def contains_time(model: Equations, events: tuple[Event, ...] = ()) -> bool:
    """Whether the rates of a model or the functions of events contain the time. They do if they are
    nan at the time nan."""
    # Constants and a state of no special value, so that no term is 0 and hides the time.
    k = namespace(model.structure, [1.1 + i / 7 for i in range(count(model.structure))])
    y = [np.float64(0.3 + i / 11) for i in range(len(model.state))]
    functions = (model.rhs, *(event.function for event in events))
    try:
        values = [np.ravel(function(np.float64(math.nan), y, k)) for function in functions]
        return bool(np.isnan(np.concatenate(values).astype(complex)).any())
    except (ArithmeticError, ValueError, TypeError):
        return True  # the time nan has caused the exception


def has_formula_of_time(system: Model) -> bool:
    """Whether the equations hold a user's formula and contain the time: the rates may then change
    at any speed between two times."""
    return system.equations.has_formulas and contains_time(system.equations)


def with_epoch(k: Any, epoch: Any) -> SimpleNamespace:
    """The constants k with another epoch."""
    return SimpleNamespace(**vars(k) | {EPOCH: epoch})


def from_engine_time(s: Any, k: Any) -> tuple[Any, Any]:
    """The case's own time at the engine's time s, and the constants.

    With an epoch the returned time counts from the epoch, and the returned epoch is 0. The start of
    the stretch and the epoch, which are near each other, are subtracted first to lose no digit.
    """
    if not hasattr(k, EPOCH):
        return k.time_start + s * k.time_unit, k
    return (k.time_start - k.epoch) + s * k.time_unit, with_epoch(k, 0.0)


def of_engine_time(model: Equations) -> Equations:
    """The same equations as functions of the engine's time."""
    return replace(model, structure=tuple({**dict(model.structure), START: 0, UNIT: 0}.items()))
