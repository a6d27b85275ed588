"""What every model states: y' = rhs(t, y, k), a start and the stored variables. And what engines
need of it: the constants k as flat lists of numbers, units of omega and of time, the Jacobian.

With omega = sigma W and s = rho t, a constant of degree d, whose term is of degree d in omega,
becomes value * sigma**(d - 1) / rho: so the state stays near 1 however far a motion decays.
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
"""The keys of a case for where the body points, and for the constants that its expressions name."""

OWN_FOLDER = str(Path(__file__).parents[1])
"""The folder of the package, with the models that are its own."""

Constants = Mapping[str, float | tuple[float, ...] | str]
"""Numbers and tuples of numbers by name; a string is structure, which chooses between equations."""

Structure = tuple[tuple[str, int | str], ...]
"""The structure of constants: each name with its length (0 for a plain number), or its string."""


LENGTHS = {"axis": 3, "quaternion": 4, "principal": 3, "space": 3}
"""The lengths of the other dimensions, besides time, of a motion's variables."""


REST_BITS = 2**12
"""Binary orders of magnitude below 1 at which a motion is called at rest: 1e-1233, far below the
smallest double."""


class Label(NamedTuple):
    """How one stored variable is labelled in a result file."""

    dims: tuple[str, ...]
    long_name: str
    units: str = "1"

    @property
    def width(self) -> int:
        """How many numbers it has at a time."""
        return math.prod(LENGTHS.get(dim, 1) for dim in self.dims)


QUATERNION = ("attitude_a", "attitude_b", "attitude_c", "attitude_d")
"""The variables that an attitude adds to the state."""

ATTITUDE_VARIABLE = {
    ATTITUDE_KEY: Label(("time", "quaternion"), "attitude, from body to space axes")
}


class EventOutcome(NamedTuple):
    """What an event does to a motion: it goes on from the time `onward` in another state, or ends
    in that state where `onward` is None.

    `time` is what is stored as the event's time, with the numbers of `details`; nothing is stored
    of an event whose `details` are None. A state that lasts has `onward` infinite; a body with an
    attitude turns on in it at `spin` (3,), along the axes of the quaternion that ends the state.
    """

    time: float
    details: Mapping[str, float] | None
    state: Sequence[Any]
    onward: Any = None
    spin: Sequence[Any] = ()

    def states(self, times: Any, fp: Any = float) -> np.ndarray:
        """The states (..., m) at times (...) from the event to `onward`, in a precision."""
        state, omega = np.array(self.state, dtype=fp), np.array(self.spin, dtype=fp)
        states = np.broadcast_to(state, (*np.shape(times), len(state)))
        if (omega != 0).any():
            # By what a quadruple has too, which is no type of numpy's.
            peak = np.abs(omega).max()
            speed = peak * np.sqrt(np.square(omega / peak).sum())
            angle = (np.asarray(times, dtype=fp) - fp(self.time)) * speed
            turned = composed(state[-4:], about(omega / speed, angle))
            states = np.concatenate((states[..., :-4], np.stack(turned, axis=-1)), axis=-1)
        return states


Passage = Callable[[Any, Sequence[Any], Any], EventOutcome]


class Event(NamedTuple):
    """A zero of `function(t, y, k)`; integration ends there if it is `terminal`.

    In an event of a model with `degree` the state is in units that fit the motion, so that the
    function has to be homogeneous in them.

    A terminal event with a `passage` ends only one stretch: `passage(t, y, k)`, whose time, state
    and constants are numbers of the working precision in the case's own units, says how the motion
    goes on.
    """

    kind: str
    function: Callable[[Any, Sequence[Any], Any], Any]
    terminal: bool = False
    passage: Passage | None = None


@dataclass(frozen=True)
class Bound:
    """A function with its first arguments: as `functools.partial`, but equal to another one of the
    same function and arguments, so that one compilation serves both."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]

    def __call__(self, *others: Any) -> Any:
        return self.function(*self.arguments, *others)


@dataclass(frozen=True)
class Model:
    """One form of a model: the class states its equations, an object of it the numbers of one case.

    The fields of a form are its `keys`: `LinearDiag(inertia=..., damping=..., initial=...)` is a
    body, and `start`, `constants`, `warnings` and the events follow from them. The data are taken
    as right; `check` says beforehand whether they are.

    `rhs(t, y, k)` and the events are written with + - * / and **, and with the functions of
    `arithmetic`, so that numbers, arrays and the symbols of an engine all pass through the same
    lines. `k` has the names of `constants` as attributes. They are functions of the class, because
    an engine compiles them once for all cases of one `Equations`.

    `t` is the case's own time in `rhs`, in events and in `output`, whatever the units. An event
    gets the quaternion of an attitude after the variables of `state`.
    """

    attitude: Any = field(default=None, kw_only=True)
    """Where the body points at the start, as its case says; nothing where no attitude is wanted."""

    case_constants: CaseConstants = field(default=(), kw_only=True)
    """The constants that its expressions name, as pairs, and the epoch from which they count t:
    `constants` are the numbers of its equations."""

    is_backward: bool = field(default=False, kw_only=True)
    """Whether the motion's time, which rises, is the case's time with the other sign."""

    name: ClassVar[str]
    form: ClassVar[str]
    keys: ClassVar[dict[str, Rule]]
    state: ClassVar[tuple[str, ...]]
    variables: ClassVar[dict[str, Label]]

    degree: ClassVar[dict[str, int]] = {}
    """The degree in the angular velocity of the terms that a constant multiplies.

    It makes a change of units possible: with omega = sigma W and s = rho t, every such constant
    becomes value * sigma**(degree - 1) / rho. A constant of degree 0 is a torque that spins a body
    up, and so sets a least unit of omega. A term without a degree converts by the constants
    `velocity_unit` (sigma) and `time_unit` (1/rho), both 1 in the case's own units. A model without
    degrees is integrated in its own units.
    """

    resisting: ClassVar[frozenset[str]] = frozenset()
    """Constants of degree 0 that resist every rotation, and so set no unit."""

    quaternion_factor: ClassVar[Any] = None
    """The factor of Q' = Q (0, omega)/2 as a function of k, of a model whose motions may have an
    attitude Q."""

    fixed_in_space: ClassVar[tuple[str, ...]] = ()
    """Three variables of the state: the components along body axes of a vector that is fixed in
    space. With an attitude `start` gives its components in space."""

    starts_with_omega: ClassVar[bool] = False
    """Whether its motions start with an angular velocity in body axes."""

    always_absorbing: ClassVar[bool] = False
    """Whether it has `absorbing_axes` whatever the data: no motion crosses the separatrix twice,
    and errors do not grow near it."""

    slow_time: ClassVar[bool] = False
    """Whether its time is tau = epsilon t."""

    is_quadrature: ClassVar[bool] = False
    """Whether its motions are a quadrature: a closed form without rates, which no other method can
    integrate. Its variables then hold the label, and its one event is a crossing."""

    no_axis_reason: ClassVar[str] = (
        "the state has no angular velocity in body axes, so no axis is enclosed"
    )
    """Why the enclosed axis does not apply; empty where it does."""

    output: ClassVar[Callable[..., dict[str, np.ndarray]]]
    """output(t, y, k): the stored variables from the times (n,) and the states (n, m), in the dtype
    of `y`.

    Where their errors are judged the states of a model with `degree` are in units of omega of their
    own, so that each variable has to be homogeneous in it.
    """

    attitude_at: ClassVar[Callable[..., tuple[Any, ...]]]
    """self.attitude_at(start): the quaternion at a start (m,)."""

    exact_states: ClassVar[Callable[..., tuple[np.ndarray, np.ndarray]]]
    """self.exact_states(t), with a closed form: the states (n, m) of size about 1 at times t (n,)
    from the start, in the precision of t, and the exponents (n,) of their units."""

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """The time derivative of each state variable."""
        raise NotImplementedError("the model states no rhs")

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """The mistakes of values that are each valid alone.

        Keys whose values are wrong by themselves are missing from `data`.
        """
        yield from ()

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        """The mistakes of valid values in a motion from one time to another."""
        yield from ()

    @classmethod
    def of(
        cls, data: Mapping[str, Any], epoch: float | None = None, is_backward: bool = False
    ) -> "Model":
        """The object with the data of a case, whose expressions count t from an epoch."""
        own, sign = dict(data), -1.0 if is_backward else 1.0
        of_epoch = {EPOCH_NAME: sign * epoch} if epoch else {}
        # As pairs, which can be hashed.
        named = (*(own.pop(CONSTANTS_KEY, None) or {}).items(), *of_epoch.items())
        return cls.form_of(data)(**own, case_constants=named, is_backward=is_backward)

    @classmethod
    def form_of(cls, data: Mapping[str, Any]) -> "type[Model]":
        """The class for these data: this one, or its replacement."""
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
        """Its equations without their numbers."""
        return Equations(
            type(self), structure(self.constants), bool(self.attitude), self.is_backward
        )

    @property
    def no_separatrix_reason(self) -> str:
        """The reason of its equations."""
        return self.equations.no_separatrix_reason

    @cached_property
    def initial_state(self) -> tuple[float, ...]:
        """The start, and the attitude there."""
        return self.with_attitude(np.array(self.start)) if self.attitude else self.start

    def with_attitude(self, start: np.ndarray) -> tuple[Any, ...]:
        """A start and the attitude there; a vector fixed in space turns into the state's axes."""
        Q = self.attitude_at(start)
        rows = [i for i, name in enumerate(self.equations.state) if name in self.fixed_in_space]
        if rows:
            start[rows] = self.to_principal(np.array(turned_back(Q, [*start[rows]])))
        return *start.tolist(), *Q

    def to_principal(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) in the axes of the case, turned into the axes of the state, in their own
        precision."""
        return vectors

    @property
    def extended_start(self) -> np.ndarray:
        """The initial state (m,) in long double, where its rounding to doubles costs digits: a
        reference begins from it."""
        return np.array(self.initial_state, dtype=np.longdouble)

    def tilt_growth(self, t: float) -> np.ndarray | None:
        """The rates (3,) at which a small tilt away from each body axis grows at a time; None where
        theory gives none."""
        return None

    def predictions(self, start: float, end: float) -> list[str]:
        """What theory says of the motion between two times, from the data: sentences, with
        units in words after their numbers, as in "turns in 12.5 [time]"."""
        return []

    @property
    def has_closed_form(self) -> bool:
        """Whether `exact_states` has the motion."""
        return False

    def exact_end(self, fp: type) -> tuple[str, EventOutcome] | None:
        """The kind of the event of a motion in closed form, and the event at its time from the
        start, in a precision; None without an event."""
        return None

    def absorbing_axes(self, start: float, end: float) -> frozenset[int]:
        """The axes that the hodograph does not leave between two times once it encloses them, by
        the equations alone."""
        return frozenset()

    @property
    def warnings(self) -> list[str]:
        """What the data say against the model's own assumptions."""
        return []

    def warnings_within(self, start: float, end: float) -> list[str]:
        """What the data say against the assumptions between two times."""
        return []

    @property
    def run_events(self) -> tuple[Event, ...]:
        """Events that belong to the motion itself and are recorded whenever it is integrated."""
        return ()

    @property
    def class_events(self) -> tuple[Event, ...]:
        """Events that only `classify` looks for."""
        return ()


@dataclass(frozen=True)
class Equations:
    """The equations of all motions of a form that have one structure: they are compiled once. The
    quaternion of an attitude follows the form's own variables.

    With the constants `time_start` and `time_unit` they are functions of an engine's time s, in
    units that fit the motion: the case's own is t = time_start + s time_unit.
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
        """The torques, of a form whose structure names them."""
        return tuple(str(dict(self.structure).get(TERMS_NAME, "")).split())

    @cached_property
    def rows(self) -> dict[str, int]:
        """The variables of the state, and the power d >= 0 of the unit of omega that each carries:
        0 for a variable with a size of its own, such as a direction.

        The degree of a constant in the rate of such a variable is 1 - d more than the power of
        omega in its terms: the factor of Q' = Q (0, omega)/2 is of degree 2, as `g`, since
        W = omega/sigma and s change it alike.
        """
        extra = {row: power for name in self.terms for row, power in TERMS[name].extra.items()}
        turning = dict.fromkeys(QUATERNION * self.has_attitude, 0)
        return dict.fromkeys(self.form.state, 1) | extra | turning

    @cached_property
    def state(self) -> tuple[str, ...]:
        """The variables of the state."""
        return tuple(self.rows)

    @cached_property
    def degree(self) -> dict[str, int]:
        """The degree in the angular velocity of the terms that each constant multiplies."""
        return {name: n for name, n in self.form.degree.items() if name in self.names}

    @property
    def variables(self) -> dict[str, Label]:
        """What is stored."""
        return self.form.variables | (ATTITUDE_VARIABLE if self.has_attitude else {})

    @property
    def may_stop(self) -> bool:
        """Whether a brake may bring a motion to rest, where no axis is enclosed any more."""
        return "brake" in self.terms

    @property
    def no_separatrix_reason(self) -> str:
        """Why the enclosed axis is undetermined all along, and D says nothing; empty where it
        does."""
        says = "with a rotor D says nothing, and the enclosed axis is undetermined"
        return says if "rotor" in self.terms else ""

    @property
    def always_absorbing(self) -> bool:
        """As the form says; theory holds for motions forward only."""
        return self.form.always_absorbing and not self.is_backward

    @cached_property
    def has_formulas(self) -> bool:
        """Whether they hold formulas of a user's own, in which anything may happen within a step;
        the equations of a model from outside the package do."""
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
        # The degrees of constants give rates by the engine's time; else its unit is a constant.
        is_own_unit = self.degree or START not in self.names
        return rates if is_own_unit else [rate * k.time_unit for rate in rates]

    def output(self, t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        """The stored variables from the times (n,) and the states (n, m), in the dtype of `y`."""
        t, k = self.in_case_time(t, k)
        if not self.has_attitude:
            return self.form.output(t, y, k)
        return self.form.output(t, y[:, :-4], k) | dict.fromkeys(ATTITUDE_VARIABLE, y[:, -4:])

    def in_case_time(self, t: Any, k: Any) -> tuple[Any, Any]:
        """The time of the form's own equations, and the constants."""
        if START in self.names:
            t, k = from_engine_time(t, k)
        if self.is_backward:
            t, k = -t, with_epoch(k, -k.epoch) if hasattr(k, EPOCH) else k
        return t, k


def mistake_of(at: KeyPath, function: Callable[..., object], *arguments: Any) -> Iterator[Mistake]:
    """The sentence of the ValueError that a function of the data raises, as a mistake at a path."""
    try:
        function(*arguments)
    except ValueError as error:
        yield at, str(error)


def structure(k: Constants) -> Structure:
    """The structure of a model's constants; integrators compiled for one structure serve all its
    numbers."""
    sizes = {name: len(value) for name, value in k.items() if isinstance(value, tuple)}
    return tuple(
        (name, value if isinstance(value, str) else sizes.get(name, 0)) for name, value in k.items()
    )


def count(of: Structure) -> int:
    """The number of values that the constants hold."""
    return sum(max(size, 1) for _, size in of if isinstance(size, int))


def flatten(k: Constants) -> list[float]:
    """The numbers among the constants, in order."""
    numbers = [value for value in k.values() if not isinstance(value, str)]
    return [x for value in numbers for x in (value if isinstance(value, tuple) else (value,))]


def attributes(k: Constants, number: Callable[[float], Any] = float) -> SimpleNamespace:
    """The constants as attributes, each of their numbers converted by `number`."""
    return namespace(structure(k), [number(value) for value in flatten(k)])


def namespace(of: Structure, numbers: Iterable[Any]) -> SimpleNamespace:
    """The constants as attributes, their numbers (or symbols) taken in order."""
    supply = iter(numbers)

    def constant(length: int | str) -> Any:
        if isinstance(length, int):
            return tuple(islice(supply, length)) if length else next(supply)
        return length  # where the constant is a string, its structure is this string

    return SimpleNamespace(**{name: constant(length) for name, length in of})


def state_powers(model: Equations) -> np.ndarray:
    """The power of the unit of omega that each state variable carries (m,); none has one where the
    model has no units of its own."""
    powers = [power if model.degree else 0 for power in model.rows.values()]
    # Of C's int, because ldexp takes ten times as long by a wider one.
    return np.array(powers, dtype=np.intc)


def rescaled(model: Equations, y: np.ndarray, exponent: Any) -> np.ndarray:
    """States (..., m) in units of omega that are 2**exponent (...) times as small."""
    # Laid out in memory as columns of motions are: a view (n, m) of those stays one.
    powers = np.moveaxis(np.multiply.outer(state_powers(model), exponent), 0, -1)
    return np.asarray(np.ldexp(y, powers))


def moving(model: Equations) -> np.ndarray | slice:
    """The positions of the state variables that carry a unit of omega: they give the size of a
    motion."""
    powers = state_powers(model)
    # A slice gives a view, and no copy.
    return np.flatnonzero(powers) if model.degree and not powers.all() else slice(None)


def kinds_of_variables(model: Equations) -> list[np.ndarray]:
    """The positions of the state variables that carry a unit of omega, and of those that carry
    none, if there are any. One kind may decay by any factor while the other does not: each has its
    own size."""
    powers = state_powers(model)
    kinds = np.flatnonzero(powers), np.flatnonzero(powers == 0)
    return [rows for rows in kinds if rows.size]


def in_unit(constant: Any, exponent: Any) -> Any:
    """A constant of a model, a number or a tuple of them, times 2**exponent."""
    if isinstance(constant, tuple):
        return tuple(np.ldexp(number, exponent) for number in constant)
    return np.ldexp(constant, exponent)


def jacobian(model: Equations, k: SimpleNamespace, t: Any, y: np.ndarray) -> np.ndarray:
    """d rhs / d y at y (m,) or (m, n), shape (m, m) or (m, m, n), exact to rounding: the imaginary
    part of the rhs at a complex step.

    Source: W. Squire and G. Trapp, SIAM Review 40 (1998) 110.
    """
    # The square of `tiny` is lost in every double, so nothing is truncated; no difference is taken,
    # so nothing cancels.
    tiny, unit_steps = 1e-100, np.eye(len(y)).reshape(len(y), len(y), *[1] * (y.ndim - 1))
    steps = y[:, None] + 1j * tiny * unit_steps
    return (stacked(model.rhs(t, list(steps), k), steps).imag / tiny).astype(float)


def stacked(rates: Sequence[Any], y: np.ndarray) -> np.ndarray:
    """The rates of the variables in states y (m, ...), of the same shape: one may be a number for
    all states."""
    rows = np.empty_like(y)
    for i, rate in enumerate(rates):
        rows[i] = rate
    return rows


TERMS_NAME = "terms"
"""The constant, a string, that names the torques of a body."""

START, UNIT, VELOCITY = "time_start", "time_unit", "velocity_unit"
"""The constants by which equations in other units know the case's own: the time at which a
stretch begins, and the units of time and of velocity."""


@lru_cache(maxsize=64)
@np.errstate(all="ignore")
def contains_time(model: Equations, events: tuple[Event, ...] = ()) -> bool:
    """Whether the rates of a model, or the functions of events, contain the time: with a time that
    is not a number they are not numbers then."""
    # Any numbers serve that no formula makes 0 or equal.
    k = namespace(model.structure, [1.1 + i / 7 for i in range(count(model.structure))])
    y = [np.float64(0.3 + i / 11) for i in range(len(model.state))]
    functions = (model.rhs, *(event.function for event in events))
    try:
        values = [np.ravel(function(np.float64(math.nan), y, k)) for function in functions]
        return bool(np.isnan(np.concatenate(values).astype(complex)).any())
    except (ArithmeticError, ValueError, TypeError):
        return True  # what such a time disturbs contains it


def has_formula_of_time(system: Model) -> bool:
    """Whether equations hold a user's formula and contain the time: between two times anything may
    happen then."""
    return system.equations.has_formulas and contains_time(system.equations)


def with_epoch(k: Any, epoch: Any) -> SimpleNamespace:
    """Constants with another epoch."""
    return SimpleNamespace(**vars(k) | {EPOCH: epoch})


def from_engine_time(s: Any, k: Any) -> tuple[Any, Any]:
    """The case's own time from the engine's, and the constants. With an epoch the time counts from
    there: two numbers near each other are subtracted first."""
    if not hasattr(k, EPOCH):
        return k.time_start + s * k.time_unit, k
    return (k.time_start - k.epoch) + s * k.time_unit, with_epoch(k, 0.0)


def in_engine_time(function: Callable[..., Any], s: Any, y: Sequence[Any], k: Any) -> Any:
    """A function (t, y, k) of the case's own time as one of the engine's time."""
    t, k = from_engine_time(s, k)
    return function(t, y, k)


def of_engine_time(
    model: Equations, events: tuple[Event, ...]
) -> tuple[Equations, tuple[Event, ...]]:
    """The same equations, and events, as functions of the engine's time."""
    of_engine = (
        event._replace(function=Bound(in_engine_time, (event.function,))) for event in events
    )
    form = tuple({**dict(model.structure), START: 0, UNIT: 0}.items())
    return replace(model, structure=form), tuple(of_engine)
