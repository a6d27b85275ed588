"""Units of omega and time that fit a motion at every moment, and the clock that counts in them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..models.base import (
    START,
    UNIT,
    VELOCITY,
    Constants,
    Equations,
    Model,
    attributes,
    contains_time,
    in_unit,
    jacobian,
    moving,
    rescaled,
    state_powers,
)
from . import extended

SLOWEST_EXPONENT = -1000
"""The binary order of magnitude of the slowest rate to which the unit of time is fitted. For slower
rates the unit would leave the range of doubles."""


LEAST_EXPONENT = -960
"""The least binary order of magnitude of omega at which a user's formulas are evaluated. For a
smaller omega they are evaluated at this order, and their torques taken to be proportional to omega:
in the case's own units both would leave the range of doubles."""


class TimeWindow(NamedTuple):
    """A time, and the length of the span of motions whose equations contain the time: numbers, or
    arrays (n,) for n motions."""

    time: Any
    span: Any


@dataclass(frozen=True)
class Units:
    """Units of omega and time that fit a motion: omega = 2**exponent W and s = 2**rate (t -
    origin), where exponent and rate are whole numbers or arrays (n,) for n motions.

    The series of an engine controls its error against max(1, |y|), so that a motion far below 1
    would be right only absolutely. With W near 1, and a unit of time in which no rate exceeds 1, it
    is right relatively at every scale. Powers of two make the change of units exact.
    """

    exponent: Any = 0
    rate: Any = 0

    @classmethod
    def fit(
        cls,
        model: Equations,
        k: Mapping[str, Any],
        y: np.ndarray,
        exponent: Any = 0,
        moment: TimeWindow | None = None,
        falling: Any = False,
    ) -> "Units":
        """The units for a model with constants k in the state `y` (m,) or (m, n), given in units of
        2**exponent, and at a `moment` if its equations contain the time. For a `falling` motion the
        state alone determines the unit of omega, and the torques do not."""
        if not model.degree:
            return cls(0, int(clock_rates(model, attributes(k), y)))
        orders = orders_of_constants(model, k)
        # A number of numpy's, because Python's own raise an error where a formula divides by 0.
        t = np.asarray(moment.time if moment else 0.0)[()]
        units = cls.of_exponent(
            model, orders, fitting_exponent(model, orders, y, exponent, falling)
        )
        if VELOCITY in k:
            # The rates of a user's formulas are unknown. In the long unit of time of a slow motion
            # they may exceed the largest double.
            units = cls(units.exponent, np.maximum(units.rate, 0))
        speed, turn = units.speeds(model, k, y, exponent, t)
        # The rate from the constants may be far above the real rates: the state of a body that
        # turns steadily about an axis does not change at all.
        slower = np.frexp(np.where(speed > 0, np.maximum(speed, turn), 0.0))[1]
        rate = units.rate + np.maximum(slower, SLOWEST_EXPONENT)
        if moment:  # a motion that is slow now may follow a torque that soon changes
            rate = np.maximum(rate, -np.frexp(moment.span)[1])
        return cls(units.exponent, rate)

    @classmethod
    def of_exponent(cls, model: Equations, orders: Mapping[str, Any], exponent: Any) -> "Units":
        """The units with 2**exponent as the unit of omega, and with a unit of time in which no term
        of the model is faster than about 1. `orders` are the binary orders of magnitude of the
        model's constants."""
        rate = exponent
        for name, degree in model.degree.items():
            if name != "g":  # the gyroscopic terms are of rate |omega|, which is 2**exponent
                rate = np.maximum(rate, orders[name] + (degree - 1) * exponent)
        # As C's int, because ldexp takes ten times as long with a wider type.
        return cls(np.asarray(exponent).astype(np.intc)[()], np.ceil(rate).astype(np.intc)[()])

    def speeds(
        self, model: Equations, k: Mapping[str, Any], y: np.ndarray, exponent: Any, t: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rates at which motions, and their derivatives, change in these units, at the time t
        and the state y in units of 2**exponent: two numbers for y (m,), two arrays (n,) for y (m,
        n).

        They are 0 for a steady rotation about an axis, however fast it is. In a unit of time that
        is 1e15 times too short the coefficients of a series would be 0.
        """
        scaled = SimpleNamespace(**self.constants(model, k))
        y = rescaled(model, y.T, exponent - self.exponent).T
        rate = np.array(np.broadcast_arrays(*model.rhs(t, [*y], scaled)))
        speed = np.abs(rate).max(axis=0)
        along = np.divide(rate, speed, out=np.zeros_like(rate), where=speed > 0)
        # The second derivative shows a turn at constant speed. It comes from a complex step, as in
        # `jacobian`, but of 1e-20: a formula gets it in the case's own units, where a shorter step
        # would vanish.
        second = np.array(np.broadcast_arrays(*model.rhs(t, [*(y + 1e-20j * along)], scaled)))
        return speed, np.abs(second.imag / 1e-20).max(axis=0)

    def constants(self, model: Equations, k: Mapping[str, Any]) -> dict[str, Any]:
        """The constants of the equations in these units, by name, from their values k in the case's
        units."""
        scaled = {
            name: in_unit(k[name], (degree - 1) * self.exponent - self.rate)
            for name, degree in model.degree.items()
        }
        units = {VELOCITY: np.maximum(self.exponent, LEAST_EXPONENT), UNIT: -self.rate}
        return {**k} | scaled | {name: np.ldexp(1.0, units[name]) for name in units if name in k}


def orders_of_constants(model: Equations, k: Mapping[str, Any]) -> dict[str, Any]:
    """The binary orders of magnitude (...) of a model's constants divided by the smallest moment of
    inertia, by name. They are logarithms, because the quotients may leave the range of doubles."""
    with np.errstate(divide="ignore"):  # log2(0) = -inf: a term that is absent sets no unit
        lightest = np.log2(np.minimum(np.minimum(k["A1"], k["A2"]), k["A3"]))
        return {name: np.log2(largest_of(k[name])) - lightest for name in model.degree}


def fitting_exponent(
    model: Equations, orders: Mapping[str, Any], y: np.ndarray, exponent: Any, falling: Any
) -> Any:
    """The binary order of magnitude (...) of the unit of omega that fits the larger of two: states
    y (m, ...) in units of 2**exponent, and the omega that torques produce. For a `falling` motion
    the state alone counts, unless it is at rest."""
    of_state = order_of_magnitude(model, y) + exponent
    larger = np.maximum(of_state, order_by_torques(model, orders))
    fitting = np.where(falling & (of_state > -np.inf), of_state, larger)
    return np.where(np.isfinite(fitting), fitting, 0)  # neither motion nor torque: any unit serves


def order_by_torques(model: Equations, orders: Mapping[str, Any]) -> Any:
    """The binary order of magnitude (...) of the omega that torques N produce from rest on a moment
    of inertia A: about sqrt(N/A), in the time 1/sqrt(N/A). It is minus infinity without torques."""
    constant = [name for name, degree in model.degree.items() if degree == 0]
    torques = (orders[name] for name in constant if name not in model.form.resisting)
    return np.ceil(reduce(np.maximum, torques, -np.inf) / 2)


FALLING_BITS = 16
"""A motion is falling if it starts this many binary orders of magnitude above the omega that its
torques produce."""


def is_falling(model: Equations, k: Mapping[str, Any], y: np.ndarray) -> np.ndarray:
    """Whether (...) motions with starts y (m, ...) decay by many orders of magnitude: under a
    brake, or from a start far above the omega that constant torques produce, to which the motion
    settles. They would lose digits in units of that omega."""
    made = order_by_torques(model, orders_of_constants(model, k))
    is_far = np.isfinite(made) & (order_of_magnitude(model, y) > made + FALLING_BITS)
    return np.asarray(is_far | model.may_stop)


def largest_of(constant: Any) -> Any:
    """The size of a model's constant; for a tuple, the size of its largest number."""
    return np.abs(constant).max(axis=0) if isinstance(constant, tuple) else np.abs(constant)


def order_of_magnitude(model: Equations, y: np.ndarray) -> np.ndarray:
    """The binary order of magnitude of the unit of omega that fits states (m,) or (m, n); minus
    infinity at rest."""
    # Each variable of the state goes with a power of omega.
    rows = moving(model)
    size, powers = np.abs(y[rows]), state_powers(model)[rows].reshape(-1, *[1] * (y.ndim - 1))
    orders = np.where(size > 0, np.ceil(np.frexp(size)[1] / powers), -np.inf)
    return np.asarray(orders.max(axis=0))


RESOLVED_STEP = 1.5
"""The longest step that resolves a small component, in units of the time of its fastest growth or
turn. A series of order 20 or more is then right to the last digit of the component."""


def longest_step(model: Equations, k: Constants, t: float, y: np.ndarray) -> float:
    """The longest step that resolves the small components of a state y (m,) at the time t; infinite
    if they only decay, which needs no limit. An infinitesimal change of the state grows or turns at
    the rates of the Jacobian's eigenvalues."""
    slopes = jacobian(model, attributes(k), t, y)
    if not np.isfinite(slopes).all():
        return math.inf
    rates = np.linalg.eigvals(slopes)
    fastest = max(float(rates.real.max()), float(np.abs(rates.imag).max()))
    return RESOLVED_STEP / fastest if fastest > 0 else math.inf


MODERATE_BITS = 16
"""A model without degrees keeps the case's unit of time as long as its rates are within these
binary orders of magnitude of 1."""


def clock_rates(model: Equations, k: SimpleNamespace, y: np.ndarray) -> np.ndarray:
    """The binary exponents (...) of the rate of the engine's clock, for motions with starts y (m,
    ...) of a model without degrees; 0 for the case's own unit of time.

    The coefficients of a series go with powers of its rates. For a body that slows down in a
    million years, in seconds, all coefficients from the third on are below the smallest double, and
    no event would be found.
    """
    with np.errstate(all="ignore"):
        rates = np.array(np.broadcast_arrays(*model.rhs(0.0, [*y], k)), dtype=float)
        mantissa, order = np.frexp(np.abs(rates).max(axis=0))
    return np.where(np.isfinite(mantissa) & (np.abs(order) > MODERATE_BITS), order, 0)


def is_timed(system: Model) -> bool:
    """Whether the equations of a motion have to convert the engine's time to the case's: they
    contain the time, or they have no degrees by which they convert to another unit of time."""
    no_degree = not system.equations.degree
    return contains_time(system.equations) or bool(no_degree and units_at_start(system).rate)


@lru_cache(maxsize=64)
def units_at_start(system: Model, moment: TimeWindow | None = None) -> Units:
    """The units that fit a motion at its start. They are cached, because the motion itself, its
    reference and a trial of the method all ask for them."""
    return Units.fit(
        system.equations, system.constants, np.array(system.initial_state), moment=moment
    )


@dataclass
class Clock:
    """The time at which a stretch of integration begins, and the unit of the engine's time in it.

    The time is the sum of two numbers, so that many changes of units cost it no digits.
    """

    high: Any
    low: Any
    factor: float = 1.0

    def until(self, times: Any) -> Any:
        """The time from the start of the stretch to the case's `times`, in the case's unit."""
        return (times - self.high) - self.low

    def grid(self, times: np.ndarray) -> np.ndarray:
        """The engine's times (n + 1,) of the start of the stretch, which is 0, and of the case's
        `times` (n,)."""
        later = self.until(times) * type(self.high)(self.factor)
        return np.concatenate(([self.high * 0], later))

    def exact(self, s: Any) -> Any:
        """The case's time at the time s of the engine, in the working precision."""
        return self.high + (self.low + s / type(self.high)(self.factor))

    def restart(self, time: Any) -> None:
        """Continue from another time of the case."""
        self.high, self.low = time, time * 0

    def exact_times(self, s: np.ndarray) -> np.ndarray:
        """The case's times (...) at times s (...) of the engine, as long doubles."""
        high, low = extended(np.array([self.high, self.low]))
        return np.asarray(high + (low + s / np.longdouble(self.factor)))

    @property
    def constants(self) -> dict[str, Any]:
        """The constants from which equations compute the case's time at the engine's time."""
        return {START: self.high, UNIT: 1 / self.factor}

    def advance(self, elapsed: tuple[Any, Any]) -> None:
        """Move the start on by a time of the engine, given as the sum of two numbers."""
        for part in elapsed:
            step = part / type(self.high)(self.factor)
            total = self.high + step
            # Knuth's two-sum: `low` receives the rounding error of `total`.
            carried = total - self.high
            self.low += (self.high - (total - carried)) + (step - carried)
            self.high = total
