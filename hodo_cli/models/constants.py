"""The constants of a model as flat lists of numbers, the units of its state and of its time, and
the Jacobian of its equations."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache, lru_cache
from itertools import islice
from types import SimpleNamespace
from typing import Any

import numpy as np

from .base import Bound, Constants, Event, Model

Structure = tuple[tuple[str, int | str], ...]
"""What of the constants is structure: each name with its length (0 for a plain number), or its
string."""


def structure(k: Constants) -> Structure:
    """The structure of a model's constants; integrators compiled for one structure serve all its
    numbers."""
    sizes = {name: len(value) for name, value in k.items() if isinstance(value, tuple)}
    return tuple(
        (name, value if isinstance(value, str) else sizes.get(name, 0)) for name, value in k.items()
    )


def count(of: Structure) -> int:
    """How many numbers the constants hold."""
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


def state_powers(model: type[Model]) -> np.ndarray:
    """The power of the unit of omega that each state variable carries (m,); none has one where the
    model has no units of its own."""
    powers = [model.state_degree.get(name, 1) if model.degree else 0 for name in model.state]
    # Of C's int, because ldexp takes ten times as long by a wider one.
    return np.array(powers, dtype=np.intc)


def rescaled(model: type[Model], y: np.ndarray, size: Any) -> np.ndarray:
    """States (..., m) in units of omega that are 2**size (...) times as small: as they are where
    `size` is that of their own units."""
    # Laid out in memory as columns of motions are: a view (n, m) of those stays one.
    powers = np.moveaxis(np.multiply.outer(state_powers(model), size), 0, -1)
    return np.asarray(np.ldexp(y, powers))


def moving(model: type[Model]) -> np.ndarray | slice:
    """The positions of the state variables that carry a unit of omega: those that tell how large a
    motion is."""
    powers = state_powers(model)
    return np.flatnonzero(powers) if model.degree and not powers.all() else slice(None)


def in_unit(constant: Any, size: Any) -> Any:
    """A constant of a model, a number or a tuple of them, times 2**size."""
    if isinstance(constant, tuple):
        return tuple(np.ldexp(number, size) for number in constant)
    return np.ldexp(constant, size)


def jacobian(model: type[Model], k: SimpleNamespace, t: Any, y: np.ndarray) -> np.ndarray:
    """d rhs / d y at y (m,) or (m, n), shape (m, m) or (m, m, n), exact to rounding: the imaginary
    part of the rhs at a complex step.

    Source: W. Squire and G. Trapp, SIAM Review 40 (1998) 110.
    """
    # Its square vanishes beside every double, so nothing is truncated, and no difference is taken,
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


# Equations that contain the time, as functions of the engine's time s, in units that fit the
# motion: the case's own time is t = k.time_start + s k.time_unit.

START, UNIT, VELOCITY = "time_start", "time_unit", "velocity_unit"
"""The constants by which equations in other units know the case's own: the time at which a
stretch begins, and the units of time and of velocity."""


def contains_time(model: type[Model], form: Structure, events: tuple[Event, ...] = ()) -> bool:
    """Whether the rates of a model with constants of a structure, or the functions of events,
    contain the time: they are then not a number where the time is none."""
    return _contains_time(model, form, events)  # type: ignore[arg-type]


def has_formula_of_time(system: Model) -> bool:
    """Whether equations hold a formula of a user's own, and contain the time: between two times
    they may then do anything."""
    return system.has_formulas and contains_time(type(system), structure(system.constants))


@lru_cache(maxsize=64)
def _contains_time(model: type[Model], form: Structure, events: tuple[Event, ...]) -> bool:
    # Any numbers serve that no formula makes 0 or equal.
    k = namespace(form, [1.1 + i / 7 for i in range(count(form))])
    y = [np.float64(0.3 + i / 11) for i in range(len(model.state))]
    functions = (model.rhs, *(event.function for event in events))
    with np.errstate(all="ignore"):
        return any(_is_lost(function, y, k) for function in functions)


def _is_lost(function: Callable[..., Any], y: Sequence[Any], k: Any) -> bool:
    try:
        return bool(np.isnan(np.array(function(np.float64(math.nan), y, k), dtype=complex)).any())
    except (ArithmeticError, ValueError, TypeError):
        return True  # what such a time disturbs contains it


def in_engine_time(function: Callable[..., Any], s: Any, y: Sequence[Any], k: Any) -> Any:
    """A function (t, y, k) of the case's own time as one of the engine's time."""
    return function(k.time_start + s * k.time_unit, y, k)


def in_engine_unit(rhs: Callable[..., Any], s: Any, y: Sequence[Any], k: Any) -> Any:
    """Rates by the engine's time, of equations whose constants are those of the case's own time."""
    return [rate * k.time_unit for rate in in_engine_time(rhs, s, y, k)]


def of_engine_time(
    model: type[Model], form: Structure, events: tuple[Event, ...]
) -> tuple[type[Model], Structure, tuple[Event, ...]]:
    """The same equations, constants and events, as functions of the engine's time."""
    of_engine = (
        event._replace(function=Bound(in_engine_time, (event.function,))) for event in events
    )
    form = tuple({**dict(form), START: 0, UNIT: 0}.items())
    return _of_engine_time(model), form, tuple(of_engine)  # type: ignore[arg-type]


@cache
def _of_engine_time(model: type[Model]) -> type[Model]:
    rhs = Bound(in_engine_time if model.degree else in_engine_unit, (model.rhs,))
    return type(f"{model.__name__}OfEngineTime", (model,), {"rhs": staticmethod(rhs)})
