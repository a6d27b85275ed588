"""The `sweep:` block of a case: which keys vary, through which values, and the case data of each
member.

    sweep:
      damping.2: {linspace: [0, 0.005, 51]}              # first, last, number of values
      resistance.diagonal: {logspace: [1e-4, 1e-1, 31]}  # the same in even ratios
      initial.p: {values: [0.5, 0.6, 0.8]}
      body: {zip: {inertia.1: {values: [0.7, 0.8]}, inertia.2: {values: [0.6, 0.5]}}}  # one axis
      direction: {sphere: {count: 1000, seed: 1}}        # of G at the start, uniform; |G| stays

Every entry is one dimension of the result, in the order given; the last varies fastest. Positions
count from zero.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..models.attitude import keys_of_form
from ..models.base import Equations, Model
from ..schema.kinds import (
    Each,
    Integer,
    Key,
    KeyPath,
    ListOf,
    Mistake,
    Number,
    OneOf,
    Rate,
    Rule,
    Table,
    Wrong,
    all_right,
    check,
    check_parts,
    expected,
    is_list,
    mistakes_where,
    within,
    words,
)
from ..schema.spelling import unknown

MOST_SWEEP_MEMBERS = 10**9
"""The most members of one sweep."""

SPAN_WORDS = "[first, last, number of values]"

DRAWN_AT_ONCE = 4096
"""How many directions one generator draws, so that any part of a sphere can be drawn by itself."""

RESERVED = ("time", "axis", "quaternion", "space", "principal", "member")

MEMBER_COLUMNS = (
    "crossing_time",
    "crossing_error",
    "crossing_from",
    "crossing_to",
    "crossing_G",
    "crossings",
    "start_axis",
    "end_axis",
    "share",
    "separation",
)
"""The columns of a member besides its final state, in models where a hodograph encloses an axis."""

STOP_COLUMNS = ("event_time", "event_from", "event_release")
"""The columns of a member that may come to rest."""


class InDegrees(float):
    """A number in radians that a case gives as text in degrees."""

    text: str


def Ranged(above: float | None = None) -> Rule:
    """A value of a swept key: a number or, for an angle or a rate, text in degrees."""

    def value_of(value: Any) -> float:
        """The number, which remembers text in degrees. Raises Wrong."""
        if not isinstance(value, str):
            return float(check(Number(above), value))
        number = InDegrees(check(Rate(), value))
        number.text = value
        return number

    return Rate() | {"title": words(Number(above)), "whole": value_of}


def _of_one_kind(values: tuple[float, ...]) -> tuple[float, ...]:
    """The values themselves. Raises Wrong unless all of them, or none, are given in degrees."""
    if len({isinstance(value, InDegrees) for value in values}) > 1:
        raise Wrong(((), "expected all values in degrees, or none"))
    return values


def Span(above: float | None = None, more: str = "") -> Rule:
    """The rule of a range [first value, last value, number of values]."""
    title = f"{SPAN_WORDS}{more}"
    count = Integer(least=1, most=MOST_SWEEP_MEMBERS)

    def span(value: Any) -> tuple[Any, ...]:
        if not is_list(value) or len(value) != 3:
            raise expected(rule, value)
        kinds = (Ranged(above), Ranged(above), count)
        parts = ((i, *pair) for i, pair in enumerate(zip(kinds, value, strict=True)))
        first, last, number = all_right(*check_parts(parts)).values()
        return *_of_one_kind((first, last)), number

    rule = ListOf(Ranged(), length=3, title=title, whole=span)
    return rule


RANGES = {
    "linspace": Key(Span(), "", default=None),
    "logspace": Key(Span(0, ", first and last > 0"), "", default=None),
    "values": Key(ListOf(Ranged(), convert=_of_one_kind), "", default=None),
}


def _values_answer(value: Any) -> str:
    """What to write instead of values without the word `values`."""
    is_numbers = is_list(value) and all(isinstance(x, int | float) for x in value)
    listed = ", ".join(f"{x:g}" for x in value) if is_numbers else ""
    return f"; write {{values: [{listed}]}}" if 0 < len(listed) < 60 else ""


ZIPPED = Each(OneOf(RANGES, answer=_values_answer), "keys to ranges")
DIRECTIONS = Table(
    {
        "count": Key(Integer(least=1, most=MOST_SWEEP_MEMBERS), "number of directions"),
        "seed": Key(Integer(least=0, most=2**63), "seed of the generator", default=0),
    }
)
SWEEP = Each(
    OneOf(
        {
            **RANGES,
            "zip": Key(ZIPPED, "", default=None),
            "sphere": Key(DIRECTIONS, "", default=None),
        },
        answer=_values_answer,
    ),
    "keys (damping.2) to {linspace: [first, last, number]}, logspace, values, zip or sphere",
    definition="sweep",
)
"""The rule of the `sweep:` block by itself; `check_axes` compares it with its case."""


@dataclass(frozen=True)
class Axis:
    """One dimension of a sweep: the paths of the keys that vary along it with their ranges, or a
    sphere."""

    name: str
    ranges: tuple[tuple[KeyPath, Mapping[str, Any]], ...]
    sphere: Mapping[str, int] | None = None

    def __len__(self) -> int:
        return self.sphere["count"] if self.sphere is not None else _length(self.ranges[0][1])

    @property
    def keys(self) -> list[str]:
        """The keys that vary along the axis, such as damping.2; none for a sphere."""
        return [".".join(map(str, path)) for path, _ in self.ranges]

    def values(self, key: int = 0, index: np.ndarray | None = None) -> np.ndarray:
        """The values of one of its keys at positions (n,), or all of them; none for a sphere."""
        index = np.arange(len(self)) if index is None else index
        value_range = self.ranges[key][1]
        if "linspace" in value_range:
            first, last, number = value_range["linspace"]
            # Single elements of numpy's linspace, equal to the last bit: all 1e9 values would take
            # 8 GB.
            step = (last - first) / max(number - 1, 1)
            is_last = (index == number - 1) & (number > 1)
            return np.asarray(np.where(is_last, last, index * step + first))
        return np.asarray(self._listed[key][index])

    @cached_property
    def _listed(self) -> list[np.ndarray]:
        """The values of each key whose range is not a linspace."""
        return [
            # geomspace keeps the given ends to the last bit; 10 ** linspace does not.
            np.geomspace(*value_range["logspace"])
            if "logspace" in value_range
            else np.array(value_range.get("values", ()), dtype=float)
            for _, value_range in self.ranges
        ]

    def directions(self, index: np.ndarray) -> np.ndarray:
        """The unit vectors (n, 3) of a sphere at positions (n,), uniform and independent."""
        assert self.sphere is not None
        # The seed includes the block's number: any process draws any part, and chunks do not
        # matter.
        occurring, block = np.unique(index // DRAWN_AT_ONCE, return_inverse=True)
        drawn = [
            np.random.default_rng([self.sphere["seed"], number]).standard_normal((DRAWN_AT_ONCE, 3))
            for number in occurring.tolist()
        ]
        directions = np.array(drawn)[block, index % DRAWN_AT_ONCE]
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _length(value_range: Mapping[str, Any]) -> int:
    """The number of values of a range."""
    ((word, value),) = value_range.items()
    return len(value) if word == "values" else int(value[2])


def storable(model: Equations) -> list[str]:
    """The variables that `store:` may name in a sweep of a model."""
    columns = MEMBER_COLUMNS + (STOP_COLUMNS if model.may_stop else ())
    # Where no axis is enclosed there are neither labels nor crossings.
    columns = ("event_time",) if model.form.no_axis_reason else columns
    return [*model.variables, *columns, "steps", "status", "trajectory"]


def axes_of(sweep: Mapping[str, Any]) -> list[Axis]:
    """The axes of a checked `sweep:` block, in order."""
    axes = []
    for name, entry in sweep.items():
        ranges = {} if "sphere" in entry else entry.get("zip", {name: entry})
        paths = tuple((path_of(key), value_range) for key, value_range in ranges.items())
        axes.append(Axis(name, paths, entry.get("sphere")))
    return axes


def swept_path(path: Sequence[str]) -> list[str]:
    """A path within `sweep:`, split at its points, as keys, which may contain points:
    damping.2.values is (damping.2, values)."""
    words = {*RANGES, "zip", "sphere"}
    # A key ends where one of these words begins; the first part is a key in any case.
    n = next((i for i, part in enumerate(path) if part in words), len(path)) or 1
    within_axis = [*path[n + 1 :]]
    rest = swept_path(within_axis) if path[n : n + 1] == ["zip"] and within_axis else within_axis
    return [".".join(path[:n]), *path[n : n + 1], *rest]


def path_of(key: str) -> KeyPath:
    """The path of a key such as damping.2 in a case's data; positions count from zero."""
    return tuple(int(step) if step.isdecimal() else step for step in key.split("."))


def first_values(
    sweep: Mapping[str, Any], model: type[Model], data: Mapping[str, Any]
) -> dict[str, Any]:
    """The first values of the swept keys that the case does not give itself. With them the case
    has the same terms as its members."""
    values = {}
    for path, value_range in (ranged for axis in axes_of(sweep) for ranged in axis.ranges):
        ((first, *_),) = value_range.values()
        if len(path) == 1 and path[0] in model.keys and data.get(str(path[0]), "") is None:
            with suppress(Wrong):
                values[str(path[0])] = check(model.keys[str(path[0])], first)
    return values


def check_axes(
    sweep: Mapping[str, Any], model: Equations, data: Mapping[str, Any]
) -> Iterator[Mistake]:
    """The mistakes of a checked `sweep:` block in a case with these data, which must be right with
    every value of each range. A span is checked at its ends, because every bound is an interval."""
    axes, keys = axes_of(sweep), keys_of_form(model.form)
    swept: list[KeyPath] = []
    for axis in axes:
        yield from within(("sweep", axis.name), _check_axis(axis, axes, model))
        for name, (path, value_range) in zip(axis.keys, axis.ranges, strict=True):
            at = ("sweep", axis.name, *(("zip", name) if "zip" in sweep[axis.name] else ()))
            if path[0] not in keys:
                yield at, _unknown_path(name, path, keys, data)
                continue
            if any(known[: len(path)] == path for known in swept):
                yield at, f"{name} varies along another axis already, or a part of it does"
            swept.append(path)
            yield from within(
                at, _check_range(value_range, path, keys[str(path[0])], model.form, data)
            )
    if math.prod(map(len, axes)) > MOST_SWEEP_MEMBERS:
        yield ("sweep",), f"more than {MOST_SWEEP_MEMBERS:.0e} members"


def _unknown_path(
    name: str, path: KeyPath, keys: Mapping[str, Rule], data: Mapping[str, Any]
) -> str:
    """What is wrong with a swept key that the model does not have."""
    if path[0] in data:
        return f"{name} is not a number of the model, and cannot be swept"
    # For example p of `initial.p`.
    inner = [
        f"{key}.{path[0]}" for key, rule in keys.items() if path[0] in rule.get("properties", ())
    ]
    answer = f"; did you mean {inner[0]!r}?" if inner else ""
    return unknown(f"key {name!r}", str(path[0]), keys, answer)


def _check_range(
    value_range: Mapping[str, Any],
    path: KeyPath,
    rule: Rule,
    model: type[Model],
    data: Any,
) -> Iterator[Mistake]:
    """The mistakes in the range of a swept key; `path` is the path of the key in the data of its
    case, and `rule` the rule of the first key in it."""
    name = ".".join(map(str, path))
    present: Any = data
    try:
        for step in path:
            is_there = isinstance(present, Mapping if isinstance(step, str) else tuple)
            if not is_there:
                raise LookupError
            present = present[step]
    except LookupError:
        yield (), f"the case has no such number: {name}"
        return
    # One number may stand for three equal ones, but not for a polynomial of several coefficients.
    if isinstance(present, tuple) and (path[1:] or rule.get("repeat", 1) != len(present)):
        yield (), f"{name} is not a number: name one of its places, such as {name}.0"
        return
    ((word, span),) = value_range.items()
    mistakes: list[Mistake] = []
    for i, value in enumerate(span if word == "values" else span[:2]):
        new = value.text if isinstance(value, InDegrees) else value
        try:
            check(rule, given(with_number(data[path[0]], path[1:], new)))
        except Wrong as error:
            mistakes += (((word, i), sentence) for _, sentence in error.mistakes)
    if present is None and not mistakes:
        # The key may contradict others of the case, as initial.G contradicts p, q and r.
        of_model = {key: data[key] for key in model.keys if key in data}
        of_first = model.check(with_number(of_model, path, span[0]))
        mistakes = [((), sentence) for _, sentence in of_first]
    yield from mistakes


def _check_axis(axis: Axis, axes: Sequence[Axis], model: Equations) -> Iterator[Mistake]:
    """The mistakes of an axis except those of its ranges; `axes` are all axes of the sweep."""
    spheres = [other.name for other in axes if other.sphere is not None]
    counts = sorted({_length(value_range) for _, value_range in axis.ranges})
    taken = {axis.name, *axis.keys} & {*RESERVED, *storable(model)}
    return mistakes_where(
        (taken, (), f"{min(taken, default='')} is a name in every result: call the axis otherwise"),
        (
            axis.name in spheres and not model.form.starts_with_omega,
            ("sphere",),
            "only the start of a body-frame model has a direction",
        ),
        (axis.name in spheres[1:], ("sphere",), "one axis may be a sphere"),
        (
            len(counts) > 1,
            ("zip",),
            f"ranges of {' and '.join(map(str, counts))} values cannot be zipped",
        ),
    )


def given(data: Any) -> Any:
    """Resolved data without the optional keys that are not given."""
    if not isinstance(data, Mapping):
        return data
    return {key: given(value) for key, value in data.items() if value is not None}


def with_number(value: Any, path: Sequence[Any], new: Any) -> Any:
    """A copy of resolved case data with `new` at a path; a vector at this path gets `new` in all
    its components."""
    if not path:
        if isinstance(value, int) and isinstance(new, float):
            return int(new)  # a count stays a whole number
        # A scalar given for a vector (`damping`) means that all components are equal.
        return (new,) * len(value) if isinstance(value, tuple) else new
    head, *tail = path
    if isinstance(value, Mapping):
        return {**value, head: with_number(value[head], tail, new)}
    return (*value[:head], with_number(value[head], tail, new), *value[head + 1 :])
