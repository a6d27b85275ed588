"""What every model states, and what the body-frame models share."""

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..schema.kinds import Key, KeyPath, Mistake

OWN_FOLDER = str(Path(__file__).parents[1])
"""The folder of the package, with the models that are its own."""

Constants = Mapping[str, float | tuple[float, ...] | str]
"""Numbers and tuples of numbers by name; a string is structure, which chooses between equations."""


LENGTHS = {"axis": 3, "quaternion": 4, "principal": 3, "space": 3}
"""The lengths of the dimensions that a variable of a motion may have besides its time."""


class Label(NamedTuple):
    """How one stored variable is labelled in a result file."""

    dims: tuple[str, ...]
    long_name: str
    units: str = "1"

    @property
    def width(self) -> int:
        """How many numbers it has at a time."""
        return math.prod(LENGTHS.get(dim, 1) for dim in self.dims)


class EventOutcome(NamedTuple):
    """What an event does to a motion: it goes on from the time `onward` in another state, or ends
    in that state where `onward` is None.

    `time` is what is stored as the event's time, with the numbers of `details`; nothing is stored
    of an event whose `details` are None. `onward` may lie before the time of the event: the motion
    then goes on as if it had passed sooner. Where it lies behind, `rates` lead to the state there,
    and none mean that it is the state all the time. A state that lasts has `onward` infinite.
    """

    time: float
    details: Mapping[str, float] | None
    state: Sequence[Any]
    onward: Any = None
    rates: Sequence[float] = ()


Passage = Callable[[Any, Sequence[Any], Any], EventOutcome]


class Event(NamedTuple):
    """A zero of `function(t, y, k)`; integration ends there if it is `terminal`.

    A terminal event with a `passage` ends only one stretch: `passage(t, y, k)`, whose time, state
    and constants are numbers of the working precision in the case's own units, says how the motion
    goes on.

    At a corner of the equations the passage does no more than turn over a sign, in row `sign` of
    the state, and the function is that sign times what changes its own. Only terms with the square
    of the function have the sign.
    """

    kind: str
    function: Callable[[Any, Sequence[Any], Any], Any]
    terminal: bool = False
    passage: Passage | None = None
    sign: int | None = None

    @property
    def interrupts(self) -> bool:
        """Whether a motion goes on behind it, and not as at a corner."""
        return self.passage is not None and self.sign is None


Level = Callable[[Any, Sequence[Any], Any], Any]
"""A function (t, y, k) as that of an event, of which the value itself counts."""


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
    an engine compiles them once for all cases.

    `t` is the case's own time in `rhs`, in events and in `output`, whatever the units.
    """

    name: ClassVar[str]
    form: ClassVar[str]
    keys: ClassVar[dict[str, Key]]
    state: ClassVar[tuple[str, ...]]
    variables: ClassVar[dict[str, Label]]

    degree: ClassVar[dict[str, int]] = {}
    """The degree in the angular velocity of the terms that a constant multiplies.

    It makes a change of units possible: with omega = sigma W and s = rho t, every such constant
    becomes value * sigma**(degree - 1) / rho. A constant of degree 0 is a torque that spins a body
    up, and so sets a least unit of omega. What of a rate has no degree finds the units where
    `constants` names them: `velocity_unit` (sigma) and `time_unit` (1/rho), both 1 in the case's
    own units. A model without degrees is integrated in its own units.
    """

    state_degree: ClassVar[dict[str, int]] = {}
    """The power d >= 0 of the unit of omega that a variable of the state carries: 1 where it is not
    named, as for p, q and r; 0 for what has a size of its own, such as a quaternion, a direction or
    a sign.

    The degree of a constant in the rate of such a variable is 1 - d more than the power of omega in
    its terms: the factor of Q' = Q (0, omega)/2 is of degree 2, as `g`, since W = omega/sigma and s
    change it alike.
    """

    resisting: ClassVar[frozenset[str]] = frozenset()
    """Constants of degree 0 that resist every rotation, and so set no unit."""

    quaternion_factor: ClassVar[Any] = None
    """The factor of Q' = Q (0, omega)/2 as a function of k, of a model whose motions may have an
    attitude Q."""

    start_attitude: ClassVar[Any] = None
    """Q at the start as a function of the start, where the start says it."""

    fixed_in_space: ClassVar[tuple[str, ...]] = ()
    """Three variables of the state: the components along body axes of a vector that is fixed in
    space, where its components are those of the start, if an attitude says how the two differ."""

    starts_with_omega: ClassVar[bool] = False
    """Whether its motions start with an angular velocity in body axes."""

    why_one_by_one: ClassVar[str] = ""
    """Why its motions cannot be integrated side by side; empty where they can."""

    always_absorbing: ClassVar[bool] = False
    """Whether it has `absorbing_axes` whatever the data: no motion crosses the separatrix twice,
    and errors do not grow beside it."""

    slow_time: ClassVar[bool] = False
    """Whether its time is tau = epsilon t."""

    may_stop: ClassVar[bool] = False
    """Whether an event may bring its motions to rest, where no axis is enclosed any more."""

    no_axis_reason: ClassVar[str] = (
        "the state has no angular velocity in body axes, so no axis is enclosed"
    )
    """Why the enclosed axis does not apply; empty where it does."""

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """The time derivative of each state variable."""
        raise NotImplementedError

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        """The stored variables from the times (n,) and the states (n, m), in the dtype of `y`.

        The states of a motion of any scale are given in units of omega of their own where their
        errors are judged, so that each variable should be homogeneous in it.
        """
        raise NotImplementedError

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """What is wrong with values that are each right by themselves.

        Keys whose values are wrong by themselves are missing from `data`.
        """
        yield from ()

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        """What is wrong with right values in a motion from one time to another."""
        yield from ()

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> "Model":
        """The object with these data, of this class or of one that stands in for it."""
        return cls(**data)

    @cached_property
    def constants(self) -> Constants:
        """The numbers that `rhs` uses, by name."""
        raise NotImplementedError

    @property
    def start(self) -> tuple[float, ...]:
        """The initial state."""
        raise NotImplementedError

    @staticmethod
    def velocity(
        inertia: Sequence[float], initial: Mapping[str, float | None]
    ) -> tuple[float, ...]:
        """The angular velocity (3,) that the data of a model say that starts with one.

        Raises ValueError, with a sentence, unless they say it in exactly one way.
        """
        raise NotImplementedError

    def starts(self, omega: np.ndarray) -> np.ndarray:
        """The states (m, ...) of such a model for angular velocities (..., 3) at the start."""
        raise NotImplementedError

    @property
    def extended_start(self) -> np.ndarray:
        """The start (m,) in long double, where its rounding to doubles costs digits: a reference
        begins from it."""
        return np.array(self.start, dtype=np.longdouble)

    def tilt_growth(self, t: float) -> np.ndarray | None:
        """The rates (3,) at which a small tilt away from each body axis grows at a time; None where
        theory gives none."""
        return None

    def predictions(self, start: float, end: float) -> list[str]:
        """What theory says of the motion between two times, from the data alone: sentences, with
        units in words behind their numbers, as in "stops after 12.5 [time]"."""
        return []

    @property
    def has_closed_form(self) -> bool:
        """Whether `exact_states` has the motion."""
        return False

    def exact_states(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The states (n, m) of size about 1 at times t (n,) from the start, in the precision of t,
        and the exponents (n,) of their units."""
        raise NotImplementedError

    @property
    def exact_end(self) -> tuple[str, EventOutcome] | None:
        """The event that ends a motion in closed form, at its time from the start, and its kind."""
        return None

    @property
    def final_axis(self) -> int | None:
        """The axis enclosed in the end, where theory predicts it from the data alone."""
        return None

    def absorbing_axes(self, start: float, end: float) -> frozenset[int]:
        """The axes that the hodograph does not leave between two times once it encloses them, by
        the equations alone."""
        return frozenset()

    @property
    def warnings(self) -> list[str]:
        """What the data say against the model's own assumptions."""
        return []

    def validity_warnings(self, t: np.ndarray, y: np.ndarray, tol: float) -> list[str]:
        """What a motion (n,), (n, m), right to a tolerance, says against the model's own
        assumptions."""
        return []

    @property
    def has_formulas(self) -> bool:
        """Whether its equations hold formulas of a user's own, in which anything may happen within
        a step: those of a model from outside the package do."""
        modules = (sys.modules[cls.__module__] for cls in type(self).__mro__[:-1])
        return any(not str(module.__file__).startswith(OWN_FOLDER) for module in modules)

    @property
    def refined_data(self) -> dict[str, Any]:
        """The data of this model that approximate its equations, as a reference takes them."""
        return {}

    @staticmethod
    def is_accurate(y: np.ndarray, k: Any, tol: float) -> Any:
        """For each state y (m, n), whether the approximation in the equations is right to a
        tolerance (n,); a motion for which it is not is integrated again with `refined_data`."""
        return np.full(y.shape[1:], True)

    @property
    def run_events(self) -> tuple[Event, ...]:
        """Events that belong to the motion itself and are recorded whenever it is integrated."""
        return ()

    @property
    def class_events(self) -> tuple[Event, ...]:
        """Events that only `classify` looks for."""
        return ()

    @property
    def levels(self) -> tuple[Level, ...]:
        """Functions that tell which axis is enclosed, where the zeros of `class_events` do not."""
        return ()


def mistake_of(at: KeyPath, function: Callable[..., object], *arguments: Any) -> Iterator[Mistake]:
    """The sentence of the ValueError that a function of the data raises, as a mistake at a path."""
    try:
        function(*arguments)
    except ValueError as error:
        yield at, str(error)
