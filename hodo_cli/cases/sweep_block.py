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
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..models.attitude import ATTITUDE_KEY, keys_of_form, start_to_vary
from ..models.base import Model
from ..schema.kinds import (
    Angle,
    Each,
    Either,
    Integer,
    Key,
    KeyPath,
    Kind,
    ListOf,
    Mistake,
    Number,
    OneOf,
    Table,
    Variant,
    Wrong,
    all_right,
    check_parts,
    expected,
    mistakes_where,
    within,
)
from ..schema.spelling import unknown

MOST_SWEEP_MEMBERS = 10**9
"""Members that one sweep may have."""

DRAWN_AT_ONCE = 4096
"""Directions that are drawn from one generator, so that any part of a sphere can be drawn by
itself."""

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
"""The columns to which a member of a sweep is reduced, besides its final state, where a hodograph
encloses an axis."""

STOP_COLUMNS = ("event_time", "event_from", "event_release")
"""The columns of a member that may come to rest."""

AXIS_LABELS = ("crossing_from", "crossing_to", "start_axis", "end_axis", "event_from")
"""The reduced columns that are labels of axes, whose mean would mean nothing."""


class InDegrees(float):
    """A value of a range that was given as "5 deg", in radians: only an angle takes it."""


@dataclass(frozen=True)
class RangeValue(Number):
    """A number, or an angle as text."""

    def check(self, value: Any) -> float:
        if not isinstance(value, str):
            return super().check(value)
        try:
            angle = Angle().check(value)
        except Wrong:
            raise expected("a number, or an angle such as '60 deg'", value) from None
        return InDegrees(super().check(angle))

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [super().schema(), Angle().schema()]}


class Span(ListOf):
    """First value, last value and number of values, all in one list."""

    def check(self, value: Any) -> tuple[Any, ...]:
        first, last, _ = super().check(value)
        count = all_right(*check_parts([(2, Integer(least=1, most=MOST_SWEEP_MEMBERS), value[2])]))
        return first, last, count[2]


SPAN_WORDS = "[first, last, number of values]"
RANGES = {
    "linspace": Key(Span(RangeValue(), length=3, title=SPAN_WORDS), "", default=None),
    "logspace": Key(
        Span(RangeValue(above=0), length=3, title=f"{SPAN_WORDS}, first and last > 0"),
        "",
        default=None,
    ),
    "values": Key(ListOf(RangeValue()), "", default=None),
}
ZIPPED = Each(OneOf(RANGES), "keys to ranges")
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
        }
    ),
    "keys (damping.2) to {linspace: [first, last, number]}, logspace, values, zip or sphere",
)
"""The `sweep:` block by itself; `check_axes` holds it against the case in which it stands."""


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
        """The keys that vary along it, such as damping.2; none for a sphere."""
        return [".".join(map(str, path)) for path, _ in self.ranges]

    def values(self, key: int = 0, index: np.ndarray | None = None) -> np.ndarray:
        """The values of one of its keys at positions (n,), or all of them; none for a sphere."""
        index = np.arange(len(self)) if index is None else index
        value_range = self.ranges[key][1]
        if "linspace" in value_range:
            first, last, number = value_range["linspace"]
            # Some of numpy's linspace, to the last bit: all of 1e9 values would take 8 GB.
            step = (last - first) / max(number - 1, 1)
            is_last = (index == number - 1) & (number > 1)
            return np.asarray(np.where(is_last, last, index * step + first))
        return np.asarray(self._listed[key][index])

    @cached_property
    def _listed(self) -> list[np.ndarray]:
        """The values of each key whose range is no linspace."""
        return [
            # Its ends are the given numbers to the last bit; the ends of 10 ** linspace are not.
            np.geomspace(*value_range["logspace"])
            if "logspace" in value_range
            else np.array(value_range.get("values", ()), dtype=float)
            for _, value_range in self.ranges
        ]

    def directions(self, index: np.ndarray) -> np.ndarray:
        """The unit vectors (n, 3) of a sphere at positions (n,), uniform and independent."""
        assert self.sphere is not None
        # Seeded by the block, so that any process draws any part, and the same members whatever the
        # chunks.
        occurring, block = np.unique(index // DRAWN_AT_ONCE, return_inverse=True)
        drawn = [
            np.random.default_rng([self.sphere["seed"], number]).standard_normal((DRAWN_AT_ONCE, 3))
            for number in occurring.tolist()
        ]
        directions = np.array(drawn)[block, index % DRAWN_AT_ONCE]
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def _length(value_range: Mapping[str, Any]) -> int:
    ((word, value),) = value_range.items()
    return len(value) if word == "values" else int(value[2])


def storable(model: type[Model]) -> list[str]:
    """The variables that `store:` may name in a sweep of a model."""
    columns: tuple[str, ...] = MEMBER_COLUMNS
    if model.may_stop:
        columns += STOP_COLUMNS
    if model.no_axis_reason:
        columns = ("event_time",)
    return [*model.variables, *columns, "steps", "status", "trajectory"]


def axes_of(sweep: Mapping[str, Any]) -> list[Axis]:
    """The axes of a checked `sweep:` block, in order."""
    axes = []
    for name, entry in sweep.items():
        ranges = {} if "sphere" in entry else entry.get("zip", {name: entry})
        paths = tuple((path_of(key), value_range) for key, value_range in ranges.items())
        axes.append(Axis(name, paths, entry.get("sphere")))
    return axes


def path_of(key: str) -> KeyPath:
    """Where the value of a key such as damping.2 stands; positions count from zero."""
    return tuple(int(step) if step.isdecimal() else step for step in key.split("."))


def first_values(
    sweep: Mapping[str, Any], model: type[Model], data: Mapping[str, Any]
) -> dict[str, Any]:
    """The first values of those swept keys of a case that it does not give itself: it is then of
    the same kind as its members."""
    values = {}
    ranges = [ranged for axis in axes_of(sweep) for ranged in axis.ranges]
    if attitude := start_to_vary(model, data.get(ATTITUDE_KEY), [path for path, _ in ranges]):
        values[ATTITUDE_KEY] = attitude
    # A key that may be left out, and is, has the value None.
    absent = {(name,): key.kind for name, key in model.keys.items() if data.get(name, "") is None}
    for path, value_range in ranges:
        (span,) = value_range.values()
        first = span[0]
        if path in absent and absent[path].takes(first):
            values[str(path[0])] = absent[path].check(first)
    return values


def check_axes(
    sweep: Mapping[str, Any], model: type[Model], data: Mapping[str, Any]
) -> Iterator[Mistake]:
    """The mistakes of a checked `sweep:` block in a case with these data and other keys: keys that
    are not there or no numbers of the model, values that the keys do not take, zipped ranges of
    unequal lengths, too many members."""
    axes = axes_of(sweep)
    swept: dict[KeyPath, str] = {}
    for axis in axes:
        yield from within(("sweep", axis.name), _check_axis(axis, axes, model))
        for key, (key_path, value_range) in zip(axis.keys, axis.ranges, strict=True):
            zipped = ("zip", key) if "zip" in sweep[axis.name] else ()
            mistakes = _check_range(value_range, key, model, data)
            for known in (known for known in swept if known[: len(key_path)] == key_path):
                hint = "" if known == key_path else f"; an axis of all of {key} goes before it"
                name = ".".join(map(str, known))
                mistakes.append(((), f"{name} varies along {swept[known]} already{hint}"))
            swept[key_path] = axis.name
            yield from within(("sweep", axis.name, *zipped), mistakes)
    if math.prod(map(len, axes)) > MOST_SWEEP_MEMBERS:
        yield ("sweep",), f"more than {MOST_SWEEP_MEMBERS:.0e} members"


def _check_axis(axis: Axis, axes: Sequence[Axis], model: type[Model]) -> Iterator[Mistake]:
    """The mistakes of one of some axes, but for those of its ranges."""
    spheres = [other.name for other in axes if other.sphere is not None]
    counts = sorted({_length(value_range) for _, value_range in axis.ranges})
    return mistakes_where(
        (
            axis.name in RESERVED,
            (),
            f"{axis.name} is a dimension of every result; call the axis otherwise",
        ),
        *(
            (name in storable(model), (), f"{name} is a variable of the result: call it otherwise")
            for name in dict.fromkeys((axis.name, *axis.keys))
        ),
        (
            axis.name in spheres and not model.starts_with_omega,
            ("sphere",),
            "only the start of a body-frame model has a direction",
        ),
        (
            axis.name in spheres[1:] and model.starts_with_omega,
            ("sphere",),
            "one axis may be a sphere",
        ),
        (
            len(counts) > 1,
            ("zip",),
            f"ranges of {' and '.join(map(str, counts))} values cannot be zipped",
        ),
    )


def _check_range(
    value_range: Mapping[str, Any], key: str, model: type[Model], data: Any
) -> list[Mistake]:
    """The mistakes of one range: its key is not there or takes no number, does not take some of the
    values, or is left out by the case since others say as much."""
    keys = keys_of_form(model)
    declared, value = _declared(key, keys, data)
    if declared is None:
        return [((), _no_such_number(key, keys, data))]
    inner = _of_shape(declared, value)
    # A number stands for a vector, or for a polynomial of that constant alone.
    of_numbers = isinstance(inner, ListOf) and (inner.length is not None or len(value or ()) == 1)
    if not (isinstance(inner, Number | Angle) or of_numbers) or not declared.takes(0.0):
        return [((), "is not a number, so it cannot be swept")]
    ((word, span),) = value_range.items()
    if isinstance(inner, Integer) and word != "values":
        return [((word,), "a whole number varies through a list, {values: [...]}")]
    values = span if word == "values" else span[:2]  # a span ends with the number of values
    _, mistakes = check_parts((i, declared, item) for i, item in enumerate(values))
    if any(isinstance(item, InDegrees) for item in values) and not isinstance(inner, Angle):
        mistakes.insert(0, ((), "expected numbers, got an angle in degrees"))
    if mistakes or value is not None:
        return [*within((word,), mistakes)]
    model_data = {name: data[name] for name in model.keys if name in data}
    first = put(model_data, path_of(key), span[0])
    return [((), sentence) for _, sentence in model.check(first)]


def _declared(key: str, keys: Mapping[str, Key], data: Any) -> tuple[Kind | None, Any]:
    """The kind and the value of a swept key in the data of a case; no kind if it is not there."""
    kind: Kind | None = Table(keys)
    for step in path_of(key):
        kind, data = _part(_of_shape(kind, data), step, data)
    return kind, data


def _no_such_number(key: str, keys: Mapping[str, Key], data: Any) -> str:
    """What is wrong with a swept key that the model does not have. One of a law (`damping.rate`)
    needs the position of the law where there is a list of them."""
    head, _, name = key.partition(".")
    if head in keys:
        laws = data[head] if isinstance(data.get(head), tuple) else ()
        right = [i for i, law in enumerate(laws) if isinstance(law, Mapping) and name in law]
        hint = f"; did you mean '{head}.{right[0]}.{name}'?" if right else ""
        return f"{unknown(f'key {key!r}', head, [])}: its case has no such number{hint}"
    if head in data:
        return "is no number of the model, so it cannot be swept"
    blocks = [name for name in keys if isinstance(data.get(name), Mapping) and key in data[name]]
    if blocks:
        return f"unknown key {key!r}; did you mean '{blocks[0]}.{key}'?"
    return unknown(f"key {key!r}", head, list(keys))


def _part(kind: Kind | None, step: str | int, value: Any) -> tuple[Kind | None, Any]:
    """The kind and the value of what stands at a key or position of a value; no kind where nothing
    does."""
    if isinstance(kind, Variant):
        kind = Table(kind.tables[value[kind.tag]])
    if isinstance(kind, ListOf) and isinstance(step, int) and step < len(value or ()):
        return kind.kind, value[step]
    # One law that is given for all axes.
    if isinstance(kind, ListOf) and value and value.count(value[0]) == len(value):
        return _part(_of_shape(kind.kind, value[0]), step, value[0])
    if isinstance(kind, Table) and isinstance(value, Mapping) and step in kind.keys:
        return kind.keys[str(step)].kind, value.get(step)
    return None, None


def _of_shape(kind: Kind | None, value: Any) -> Kind | None:
    """Of several kinds that a value may have, the first one that has its shape."""
    kinds = kind.kinds if isinstance(kind, Either) else ()
    return next((option for option in kinds if option.takes(value)), kind)


def put(value: Any, path: Sequence[str | int], new: float) -> Any:
    """A copy of resolved case data with `new` at a path; where a vector or one law for all axes
    stands, in all of its components."""
    if not path:
        if isinstance(value, int) and isinstance(new, float):
            return int(new)  # a count stays one
        # A scalar key given for a vector (`damping`) means that all are equal.
        return (new,) * len(value) if isinstance(value, tuple) else new
    head, *tail = path
    if isinstance(value, Mapping):
        return {**value, head: put(value[head], tail, new)}
    if isinstance(head, str):
        return tuple(put(item, path, new) for item in value)
    return (*value[:head], put(value[head], tail, new), *value[head + 1 :])
