"""Equations that contain the time, as functions of the time s of a leg, whose units fit the motion:
the case's own time is t = k.time_start + s k.time_unit."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np

from .base import Event, Model
from .constants import Structure, count, namespace

START, UNIT, VELOCITY = "time_start", "time_unit", "velocity_unit"
"""The constants by which equations in other units know the case's own: the time at which a leg
begins, and the units of time and of velocity."""


def contains_time(model: type[Model], form: Structure, events: tuple[Event, ...] = ()) -> bool:
    """Whether the rates of a model with constants of a structure, or the functions of events,
    contain the time: they are then not a number where the time is none."""
    return _contains_time(model, form, events)  # type: ignore[arg-type]


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


@dataclass(frozen=True)
class OfLegTime:
    """A function (t, y, k) of the case's own time as one of the time of a leg."""

    function: Callable[[Any, Sequence[Any], Any], Any]

    def __call__(self, s: Any, y: Sequence[Any], k: Any) -> Any:
        return self.function(k.time_start + s * k.time_unit, y, k)


@cache
def of_leg_time(model: type[Model]) -> type[Model]:
    """The same equations as a model whose rates are functions of the time of a leg."""
    rhs = staticmethod(OfLegTime(model.rhs))
    return type(f"{model.__name__}OfLegTime", (model,), {"rhs": rhs})


def events_of_leg_time(events: tuple[Event, ...]) -> tuple[Event, ...]:
    """The same events as functions of the time of a leg."""
    return tuple(event._replace(function=OfLegTime(event.function)) for event in events)


def structure_of_leg_time(form: Structure) -> Structure:
    """The structure of the constants that such equations take."""
    named = {name for name, _ in form}
    return form + tuple((name, 0) for name in (START, UNIT) if name not in named)
