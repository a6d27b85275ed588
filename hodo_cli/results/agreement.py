"""How far a value may be from that of a reference: one rule for each kind of variable, and one for
each attribute that carries meaning."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .. import HodoError
from ..engines.protocol import EPS
from ..storage import Group, Variable

# Looser than the results' 1e-12, so that another machine's compiler changes no verdict, and tighter
# than any figure shows.
RTOL = 1e-9
"""The relative tolerance of a variable that has none of its own."""

# A time is worse conditioned than the state: 20 to 30 times on Fig 4 of paper 1, up to 1,000 times
# on Fig 12, whose states agree far better than RTOL asks.
EVENT_CONDITION = 100.0
"""The factor by which the time of an event, and a value measured at that time, may be further off
than the state."""

EVENT_VARIABLES = ("event_time", "crossing_time", "crossing_G")
"""The variables to which `EVENT_CONDITION` applies."""

STATED_ERRORS = 10.0
"""A time may be off by so many times its stated error, which holds one compiler's rounding."""

ERROR_RATIO = 30.0
"""The factor by which errors of one method may differ from one compiler's rounding to another."""

LUCKY_ERROR = 8 * EPS
"""The largest relative error in place of which another machine may meet none at all."""

GIVEN_TOL = 4 * EPS
"""By how much times and swept data may be off, relative to the largest: by the order of two
roundings, since they are given and not integrated."""

SUBNORMAL = 2.0**-1060
"""A few thousand times the smallest double, below which a number has fewer digits than any
tolerance."""


@dataclass(frozen=True)
class Tolerance:
    """The difference that is allowed: atol + rtol |b|. None: the variable's own, or the default.
    Raises HodoError for a negative or infinite one."""

    rtol: float | None = None
    atol: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            # An infinite one would call all values equal, and nan none.
            if value is not None and not 0 <= value < math.inf:
                raise HodoError(f"--{name}: expected a number >= 0, got {value:g}")


class ReferenceValues(NamedTuple):
    """A variable of the reference, whose group is given, with the tolerance that was asked for."""

    name: str
    group: Group
    tolerance: Tolerance

    @property
    def variable(self) -> Variable:
        """The variable itself."""
        return self.group.variables[self.name]

    @property
    def size(self) -> np.ndarray:
        """|b|, and 0 where b is not finite."""
        b = self.variable.data
        return np.where(np.isfinite(b), np.abs(b), 0)

    def of_size(self, size: Any, condition: float = 1.0) -> np.ndarray:
        """atol + rtol size, by the tolerances asked for, or else the variable's own."""
        attrs, asked = self.variable.attrs, self.tolerance
        stated = float(attrs["rtol"]) if "rtol" in attrs else RTOL * condition
        rtol = stated if asked.rtol is None else asked.rtol * condition
        atol = float(attrs.get("atol", 0.0)) if asked.atol is None else asked.atol
        return np.asarray(atol + np.maximum(rtol * size, SUBNORMAL))


def equal(b: ReferenceValues) -> np.ndarray:
    """Labels, counts and texts are equal or not."""
    return np.zeros(b.variable.data.shape)


def input_agreement(b: ReferenceValues) -> np.ndarray:
    """Times and swept data come from the case; the last time of a motion that an event ended is as
    good as the time of the event."""
    allowed = np.full(b.size.shape, GIVEN_TOL * float(np.max(b.size, initial=0)))
    events = b.group.variables.get("event_time")
    if b.name != "time" or events is None:
        return allowed
    return np.where(np.isin(b.variable.data, events.data), located_difference(b), allowed)


def located_difference(b: ReferenceValues) -> np.ndarray:
    """A time may be off by the error of the state, magnified, and by its own stated error; where
    the user or the variable names a tolerance, by that, magnified."""
    if b.tolerance.rtol is not None or "rtol" in b.variable.attrs:
        return b.of_size(b.size, EVENT_CONDITION)
    error = float(b.group.attributes.get("error", math.nan))
    if not math.isfinite(error):
        of_state = b.of_size(b.size, EVENT_CONDITION)
    else:
        # A stated error below some ulps is luck, and another machine has less of it.
        of_state = b.of_size(0.0) + EVENT_CONDITION * max(error, 1e-14) * b.size
    error_name = next((name for name, of in ERRORS.items() if of == b.name), "")
    stated = b.group.variables.get(error_name)
    return of_state + (0.0 if stated is None else STATED_ERRORS * np.nan_to_num(stated.data))


def vector_agreement(b: ReferenceValues) -> np.ndarray:
    """A vector is judged by its largest component at its own time, so that the late samples of a
    decayed motion count as much as the early ones."""
    return b.of_size(b.size.max(axis=b.variable.dims.index("axis"), keepdims=True, initial=0))


def series_agreement(b: ReferenceValues) -> np.ndarray:
    """A scalar of the time is judged by its size about that time: the smaller of the largest values
    until then and from then on, which is the amplitude of an oscillation, growing or decaying; and
    no less than the size of its neighbours, for an end at 0."""
    size = np.moveaxis(b.size, b.variable.dims.index("time"), 0)
    about = np.minimum(
        np.maximum.accumulate(size), np.flip(np.maximum.accumulate(np.flip(size, 0)), 0)
    )
    about[1:] = np.maximum(about[1:], size[:-1])
    about[:-1] = np.maximum(about[:-1], size[1:])
    return b.of_size(np.moveaxis(about, 0, b.variable.dims.index("time")))


def number_agreement(b: ReferenceValues) -> np.ndarray:
    """A number for each member, axis or event is judged by its own size; by the largest if they
    have both signs, since one that may vanish has no relative error."""
    values = b.variable.data[np.isfinite(b.variable.data)]
    one_sign = (values > 0).all() or (values < 0).all()
    return b.of_size(b.size if one_sign else np.full(b.size.shape, np.max(b.size, initial=0)))


Rule = tuple[Callable[[str, Variable], bool], Callable[[ReferenceValues], np.ndarray]]
"""A kind of variable, by name and variable, and the difference that is allowed in it."""

RULES: Sequence[Rule] = (
    (lambda name, b: b.data.dtype.kind != "f", equal),
    # A range that is swept is named by the key that it changes.
    (lambda name, b: name in b.dims or b.attrs.get("long_name") == name, input_agreement),
    (lambda name, b: name in EVENT_VARIABLES, located_difference),
    (lambda name, b: "axis" in b.dims and b.data.ndim > 1, vector_agreement),
    (lambda name, b: "time" in b.dims, series_agreement),
    (lambda name, b: True, number_agreement),
)
"""The kinds of variables; the first that holds counts."""


def allowed_difference(name: str, group: Group, tolerance: Tolerance) -> np.ndarray:
    """The difference allowed in a variable of the reference, of its shape or one that is spread to
    it."""
    variable = group.variables[name]
    allowed = next(allowed for holds_for, allowed in RULES if holds_for(name, variable))
    return allowed(ReferenceValues(name, group, tolerance))


# Errors

ERRORS = {"crossing_error": "crossing_time", "event_error": "event_time"}
"""The variables that are errors themselves, with those whose errors they are: they agree to their
order of magnitude."""


def same_errors(name: str, a: Group, b: Group) -> bool:
    """Whether the variables of a name, which are errors, are alike in two cases."""
    ours, theirs = a.variables[name].data, b.variables[name].data
    values = b.variables.get(ERRORS[name])
    sized = values is not None and values.data.shape == theirs.shape
    return same_magnitude(ours, theirs, values.data if values and sized else 1.0)


def same_magnitude(ours: Any, theirs: Any, size: Any = 1.0) -> bool:
    """Whether two stated errors, of values of some size, are alike."""
    a, b = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
        return False
    low, high, size = np.minimum(a, b), np.maximum(a, b), np.abs(size)
    with np.errstate(invalid="ignore"):
        close = np.isnan(a) | (a == b) | (high <= ERROR_RATIO * np.maximum(low, EPS / 64 * size))
        return bool((close | ((low == 0) & (high <= LUCKY_ERROR * size))).all())


# Attributes


def same(ours: Any, theirs: Any) -> bool:
    """Whether two attributes are equal."""
    return bool(np.array_equal(np.asarray(ours, dtype=object), np.asarray(theirs, dtype=object)))


def same_words(a: Any, b: Any) -> bool:
    """Whether two texts are equal but for the numbers in them, which are measured."""
    ours, theirs = (re.sub(r"[-+\d.]+(e[-+]?\d+)?", "#", str(text)) for text in (a, b))
    return ours == theirs


MEANING = ("units", "flag_values", "flag_meanings")
"""The attributes of a variable that say what its numbers mean."""

OF_CASE: Mapping[str, Callable[[Any, Any], bool]] = {
    "model": same,
    "form": same,
    "status": same,
    "members": same,
    "message": same_words,
    "warnings": same_words,
    "classify_warnings": same_words,
    "predictions": same_words,
}
"""The attributes of a case that carry meaning, and when two of them agree."""

OF_METHOD: Mapping[str, Callable[[Any, Any], bool]] = {
    "error": same_magnitude,
    "error_kind": same,
    "error_levels": same,
    "error_quantiles": same_magnitude,
    "crossing_error_quantiles": same_magnitude,
}
"""The attributes that have a reason to agree where both cases are computed by one method at one
tolerance."""


def values_alike(a: Group, b: Group) -> bool:
    """Whether two cases are computed by one method at one tolerance."""
    return all(a.attributes.get(key) == b.attributes.get(key) for key in ("method", "tol"))


def differing_attributes(a: Group, b: Group) -> Iterator[tuple[str, str]]:
    """The attributes in which `a` and its variables do not agree with the reference `b`: name and
    both values."""
    for key, agree in {**OF_CASE, **(OF_METHOD if values_alike(a, b) else {})}.items():
        ours, theirs = (group.attributes.get(key) for group in (a, b))
        if theirs is not None and (ours is None or not agree(ours, theirs)):
            yield key, difference_in_words(ours, theirs)
    for name in b.variables.keys() & a.variables.keys():
        ours_attrs, attrs = a.variables[name].attrs, b.variables[name].attrs
        for key in MEANING:
            if not same(ours_attrs.get(key), attrs.get(key)):
                yield f"{name}:{key}", difference_in_words(ours_attrs.get(key), attrs.get(key))
        errors = [float(of.get("error", math.nan)) for of in (ours_attrs, attrs)]
        if values_alike(a, b) and not same_magnitude(*errors):
            yield f"{name}:error", difference_in_words(*errors)


def difference_in_words(*values: Any) -> str:
    """Two values that differ, in words."""
    ours, theirs = (
        f"{value:.1e}" if isinstance(value, float) else "; ".join(str(value).splitlines()) or "none"
        for value in values
    )
    return f"{ours}, not {theirs}"
