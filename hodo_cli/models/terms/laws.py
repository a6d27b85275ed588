"""Coefficients that change with time: the laws that a case may name, their keys and their values.

A constant NAME of a model that follows a law holds its values, which carry its unit; NAME_law is
the law, and NAME_shape, where there is one, what has no part in the unit of NAME.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...arithmetic import horner
from ...schema.kinds import Either, Key, ListOf, Mistake, Number, Variant

Numbers = Sequence[Any]


def polynomial_law(c: Numbers, shape: Numbers, t: Any) -> Any:
    """c0 + c1 t + c2 t^2 + ..."""
    return horner(c, t)


def exponential_law(c: Numbers, shape: Numbers, t: Any) -> Any:
    """value exp(-rate t), from (value,) and (rate, e)."""
    # e comes as a constant, because a power with it is what every engine has known.
    rate, e = shape
    return c[0] * e ** (-rate * t)


def power_law(c: Numbers, shape: Numbers, t: Any) -> Any:
    """value (1 + rate t)^exponent, from (value,) and (rate, exponent)."""
    rate, exponent = shape
    return c[0] * (1 + rate * t) ** exponent


LAWS: Mapping[str, Callable[[Numbers, Numbers, Any], Any]] = {
    "polynomial": polynomial_law,
    "exponential": exponential_law,
    "power": power_law,
}


def law_mapping(unit: str, t: str) -> Variant:
    """The kind of a law that is given as a mapping, of a coefficient with a unit."""
    value = Key(Number(), f"value at {t} = 0", unit)
    power = f"the law is value (1 + rate {t})^exponent"
    return Variant(
        "law",
        {
            "exponential": {
                "value": value,
                "rate": Key(Number(), f"the law is value exp(-rate {t})", "1/time"),
            },
            "power": {
                "value": value,
                "rate": Key(Number(least=0), power, "1/time"),
                "exponent": Key(Number(), power),
            },
            "polynomial": {
                "coefficients": Key(ListOf(Number()), f"coefficients of 1, {t}, {t}^2, ...", unit),
            },
        },
        "which law",
    )


@dataclass(frozen=True)
class Repeated(ListOf):
    """One value that means that all are equal; no list."""

    def check(self, value: Any) -> tuple[Any, ...]:
        return (self.kind.check(value),) * (self.length or 1)

    def takes(self, value: Any) -> bool:
        return self.kind.takes(value)

    def schema(self) -> dict[str, Any]:
        return self.kind.schema()

    def __str__(self) -> str:
        return f"{self.kind}, for all axes"


def coefficient_kind(unit: str, t: str = "t", above: float | None = None) -> Either:
    """The kind of one coefficient: a number, which may have a bound, or a law of t."""
    return Either(
        Number(above=above),
        ListOf(Number(), title=f"a polynomial in {t}: [a0, a1, ...]"),
        law_mapping(unit, t),
    )


def coefficients_kind(unit: str) -> Either:
    """The kind of three coefficients, one an axis, or of one for all."""
    title = "3 numbers, polynomials in t or laws"
    return Either(
        ListOf(coefficient_kind(unit), length=3, title=title),
        Repeated(Either(Number(), law_mapping(unit, "t")), length=3),
    )


Law = tuple[str, tuple[Any, ...], tuple[Any, ...]]
"""The name of a law, its values, and its shape."""


def law(coefficient: Any) -> Law:
    """The law of a coefficient as given in a case; a number is a polynomial of one term."""
    match coefficient:
        case {"law": "exponential", "value": value, "rate": rate}:
            return "exponential", (value,), (rate, math.e)
        case {"law": "power", "value": value, "rate": rate, "exponent": exponent}:
            return "power", (value,), (rate, exponent)
        case tuple(values) | {"law": "polynomial", "coefficients": values}:
            return "polynomial", tuple(values), ()
    return "polynomial", (coefficient,), ()


def is_law(coefficient: Any) -> bool:
    """Whether a coefficient changes with time."""
    return isinstance(coefficient, tuple | Mapping)


def scaled(coefficient: Any, factor: Any) -> Any:
    """A coefficient times a factor."""
    match coefficient:
        case tuple():
            return tuple(factor * x for x in coefficient)
        case {"value": value}:
            return {**coefficient, "value": factor * value}
        case {"coefficients": values}:
            return {**coefficient, "coefficients": scaled(tuple(values), factor)}
    return factor * coefficient


def law_constants(name: str, coefficient: Any) -> dict[str, Any]:
    """The constants of a coefficient as given in a case."""
    if not is_law(coefficient):
        return {name: coefficient}
    kind, values, shape = law(coefficient)
    return {name: values, f"{name}_law": kind} | ({f"{name}_shape": shape} if shape else {})


def coefficient_at(k: Any, name: str, t: Any) -> Any:
    """The value of a coefficient at the time t, from the constants of a model."""
    values = getattr(k, name)
    if not isinstance(values, tuple):
        return values
    return LAWS[getattr(k, f"{name}_law")](values, getattr(k, f"{name}_shape", ()), t)


def slope_at(k: Any, name: str, t: Any) -> Any:
    """The derivative by time of a coefficient that follows a law."""
    values, kind = getattr(k, name), getattr(k, f"{name}_law")
    if kind == "polynomial":
        terms = [i * values[i] for i in range(1, len(values))]
        return polynomial_law(terms, (), t) if terms else 0 * t
    a, s = relative_slope((kind, values, getattr(k, f"{name}_shape")))
    return a * coefficient_at(k, name, t) / (1 + s * t)


def value_at(coefficient: Any, t: float) -> Any:
    """The value of a coefficient as given in a case; a number at any time."""
    return coefficient_at(SimpleNamespace(**law_constants("c", coefficient)), "c", t)


def least_value(coefficient: Any, start: float, end: float) -> Any:
    """The smallest value of a law between two times."""
    return min(value_at(coefficient, t) for t in times_of_all_signs(coefficient, 0.0, start, end))


def times_of_all_signs(first: Any, second: Any, start: float, end: float) -> list[float]:
    """Times between two at which the difference of two coefficients has every sign that it has
    there, and its least value, if one of them is constant; not a number where no formula tells
    them."""
    if first == second:
        return [start]
    laws = law(first), law(second)
    are_polynomials = [kind == "polynomial" for kind, _, _ in laws]
    if all(are_polynomials):
        one, other = (np.polynomial.Polynomial(values) for _, values, _ in laws)
        turns = (one - other).deriv().roots().real.tolist()
    elif any(are_polynomials) and any(len(values) > 1 for _, values, _ in laws):
        return [math.nan]  # no formula for a polynomial that changes beside another law
    else:
        # Both keep their signs, and with c' = a c/(1 + s t) their ratio turns once at most.
        (a, s), (b, u) = map(relative_slope, laws)
        turns = [(b - a) / (a * u - b * s)] if a * u != b * s else []
    return [start, *(t for t in turns if start < t < end), end]


def relative_slope(of: Law) -> tuple[float, float]:
    """a and s in c' = a c/(1 + s t) of a law c(t) that is no polynomial."""
    match of:
        case "exponential", _, (rate, _):
            return -rate, 0.0
        case "power", _, (rate, exponent):
            return rate * exponent, rate
    return 0.0, 0.0


def dimensional_values(coefficient: Any) -> tuple[Any, ...]:
    """The numbers of a law that carry the unit of its coefficient."""
    return law(coefficient)[1]


def zero_of_base(coefficient: Any) -> float:
    """The time at which the base of a power law is 0, before which it has no values; minus infinity
    for other laws."""
    kind, _, shape = law(coefficient)
    return -1 / shape[0] if kind == "power" and shape[0] else -math.inf


MOST_COEFFICIENTS = 20
"""How many a polynomial may have. A series of the least order sees no higher power of the time from
t = 0, and in powers of t few fits hold that many digits."""


def law_mistakes(
    coefficients: Mapping[str, Iterable[Any]], start: float, t: str = "t"
) -> Iterator[Mistake]:
    """The mistakes of laws, by the keys of their coefficients: those that have no value at a start
    of the time t, and polynomials that are too long."""
    for name, entries in coefficients.items():
        laws = [*entries]
        zero = max(map(zero_of_base, laws), default=-math.inf)
        if start <= zero:
            yield (name,), f"the base of its power law is 0 at {t} = {zero:.6g}: start later"
        if max((len(dimensional_values(x)) for x in laws), default=0) > MOST_COEFFICIENTS:
            yield (name,), f"its polynomial has more than {MOST_COEFFICIENTS} coefficients"
