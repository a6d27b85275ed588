"""The `sweep:` block of a case: which keys vary, through which values, and the case data of each
member.

    sweep:
      damping.2: {linspace: [0, 0.005, 51]}                       # first, last, number of values
      resistance.diagonal: {logspace: [1e-4, 1e-1, 31]}           # the same in even ratios
      initial.p: {values: [0.5, 0.6, 0.8]} body: {zip: {inertia.1: {values: [0.7, 0.8]}, inertia.2:
      {values: [0.6, 0.5]}}}      # vary together, as one axis direction: {sphere: {count: 1000,
      seed: 1}}                 # of G at the start, uniform; |G| stays the case's

Every entry is one dimension of the result, in the order given; the last varies fastest. Positions
count from zero.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..schema.kinds import (
    REQUIRED,
    Either,
    Integer,
    Key,
    Kind,
    Matrix,
    Number,
    Path,
    Report,
    Table,
    Variant,
    Vector,
    shown,
    unknown,
)
from ..schema.kinds import Sequence as ListOf

MOST = 10**9
"""Members that one sweep may have."""

BLOCK = 4096
"""Directions that are drawn from one generator, so that any part of a sphere can be drawn by
itself."""

RESERVED = ("time", "axis", "member")

REDUCED = (
    "crossing_time", "crossing_from", "crossing_to", "crossing_G", "crossings", "start_axis", "end_axis", "share",
    "separation",
)  # fmt: skip
"""What a member of a sweep is reduced to, besides its final state, where a hodograph encloses an
axis."""


@dataclass(frozen=True)
class Span:
    """First value, last value and number of values, all in one list."""

    positive: bool = False

    def check(self, value: Any, at: Path, report: Report) -> tuple[float, float, int]:
        if not isinstance(value, list | tuple) or len(value) != 3:
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return 0.0, 0.0, 1
        number = Number(above=0 if self.positive else None)
        first, last = (number.check(value[i], (*at, i), report) for i in (0, 1))
        return first, last, Integer(1, MOST).check(value[2], (*at, 2), report)

    def schema(self) -> dict[str, Any]:
        number = Number(above=0 if self.positive else None).schema()
        return {"type": "array", "items": number, "minItems": 3, "maxItems": 3}

    def describe(self) -> str:
        return "[first, last, number of values]" + (", first and last > 0" if self.positive else "")


RANGES: dict[str, Kind] = {
    "linspace": Span(),
    "logspace": Span(positive=True),
    "values": ListOf(Number()),
}
SPHERE = Table(
    {
        "count": Key(Integer(1, MOST), "number of directions"),
        "seed": Key(Integer(0, 2**63), "seed of the generator", default=0),
    }
)


@dataclass(frozen=True)
class Ranges:
    """The `sweep:` block by itself; `check_axes` holds it against the case that it stands in."""

    def check(self, value: Any, at: Path, report: Report) -> dict[str, Any]:
        if not isinstance(value, Mapping) or not value:
            report(at, f"wants {self.describe()}, not {shown(value)}")
            return {}
        return {name: _entry(entry, (*at, name), report) for name, entry in value.items()}

    def schema(self) -> dict[str, Any]:
        each = [_one(name, kind.schema()) for name, kind in RANGES.items()]
        together = {"type": "object", "minProperties": 1, "additionalProperties": {"oneOf": each}}
        entries = [*each, _one("zip", together), _one("sphere", SPHERE.schema())]
        return {"type": "object", "minProperties": 1, "additionalProperties": {"oneOf": entries}}

    def describe(self) -> str:
        return "a mapping of keys (damping.2) to {linspace: [first, last, number]}, logspace, values, zip or sphere"


def _one(name: str, schema: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": {name: schema},
        "required": [name],
        "additionalProperties": False,
    }


def _entry(entry: Any, at: Path, report: Report, inner: bool = False) -> dict[str, Any]:
    """One axis, or one of the keys that are zipped to an axis."""
    words = [*RANGES, *([] if inner else ["zip", "sphere"])]
    if not isinstance(entry, Mapping) or len(entry) != 1:
        report(at, f"wants one of {', '.join(words)}, not {shown(entry)}")
        return {}
    ((word, value),) = entry.items()
    if word not in words:
        report((*at, word), unknown("range", word, words))
    elif word == "sphere":
        return {word: SPHERE.check(value, (*at, word), report)}
    elif word in RANGES:
        return {word: RANGES[word].check(value, (*at, word), report)}
    elif not isinstance(value, Mapping) or not value:
        report((*at, word), f"wants a mapping of keys to ranges, not {shown(value)}")
    else:
        return {
            word: {
                key: _entry(each, (*at, word, key), report, inner=True)
                for key, each in value.items()
            }
        }
    return {}


@dataclass(frozen=True)
class Axis:
    """One dimension of a sweep: the paths of the keys that vary along it with their ranges, or a
    sphere."""

    name: str
    ranges: tuple[tuple[tuple[str | int, ...], Mapping[str, Any]], ...]
    sphere: Mapping[str, int] | None = None

    def __len__(self) -> int:
        if self.sphere is not None:
            return self.sphere["count"]
        return _length(self.ranges[0][1])

    @cached_property
    def values(self) -> list[np.ndarray]:
        """The values (len,) of each key; none for a sphere."""
        return [_values(each) for _, each in self.ranges]

    def directions(self, index: np.ndarray) -> np.ndarray:
        """The unit vectors (n, 3) of a sphere at positions (n,), uniform and independent."""
        assert self.sphere is not None
        found = np.empty((len(index), 3))
        blocks = index // BLOCK
        for block in np.unique(blocks):
            here = blocks == block
            # Seeded by the block, so that any process draws any part, and the same members whatever
            # the chunks.
            vectors = np.random.default_rng([self.sphere["seed"], int(block)]).standard_normal(
                (BLOCK, 3)
            )
            found[here] = vectors[index[here] % BLOCK]
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _length(given: Mapping[str, Any]) -> int:
    ((word, value),) = given.items()
    return len(value) if word == "values" else int(value[2])


def _values(given: Mapping[str, Any]) -> np.ndarray:
    ((word, value),) = given.items()
    if word == "values":
        return np.array(value, dtype=float)
    first, last, number = value
    return (
        # Its ends are the numbers given, to the last bit, which those of 10 ** linspace are not.
        np.geomspace(first, last, number)
        if word == "logspace"
        else np.linspace(first, last, number)
    )


def storable(variables: Iterable[str], classifiable: bool) -> list[str]:
    """What `store:` may name in a sweep of a model with these variables."""
    return [
        *variables,
        *(REDUCED if classifiable else ("event_time",)),
        "steps",
        "status",
        "trajectory",
    ]


def axes_of(sweep: Mapping[str, Any]) -> list[Axis]:
    """The axes of a checked `sweep:` block, in order."""
    found = []
    for name, entry in sweep.items():
        ((word, value),) = entry.items()
        if word == "sphere":
            found.append(Axis(name, (), value))
        else:
            ranges = value if word == "zip" else {name: entry}
            found.append(Axis(name, tuple((_path(key), each) for key, each in ranges.items())))
    return found


def _path(key: str) -> tuple[str | int, ...]:
    return tuple(int(part) if part.isdecimal() else part for part in key.split("."))


def check_axes(
    sweep: Mapping[str, Any],
    keys: Mapping[str, Key],
    data: Mapping[str, Any],
    oriented: bool,
    report: Report,
) -> None:
    """Report what a checked `sweep:` block says against the case: keys that are not there or no
    numbers, values that the keys do not take, zipped ranges of unequal lengths, too many members.

    `keys` and `data` are the keys and values of the case's model, `oriented` says whether its start
    has a direction.
    """
    swept: dict[tuple[str | int, ...], str] = {}
    spheres = 0
    for axis in axes_of(sweep):
        at: Path = ("sweep", axis.name)
        if axis.name in RESERVED:
            report(at, f"{axis.name} is a dimension of every result; call the axis otherwise")
        if axis.sphere is not None:
            spheres += 1
            if not oriented or spheres > 1:
                why = (
                    "one axis may be a sphere"
                    if oriented
                    else "only the start of a body-frame model has a direction"
                )
                report((*at, "sphere"), why)
            continue
        lengths = {_length(given) for _, given in axis.ranges}
        if len(lengths) > 1:
            report(
                (*at, "zip"),
                f"ranges of {' and '.join(map(str, sorted(lengths)))} values cannot be zipped",
            )
        for path, given in axis.ranges:
            key = ".".join(map(str, path))
            place: Path = at if "zip" not in sweep[axis.name] else (*at, "zip", key)
            if path in swept:
                report(place, f"{key} varies along {swept[path]} already")
            swept[path] = axis.name
            _check_range(given, path, place, Table(keys), data, report)
    if math.prod(map(len, axes_of(sweep))) > MOST:
        report(("sweep",), f"more than {MOST:.0e} members")


def _check_range(
    given: Mapping[str, Any],
    path: tuple[str | int, ...],
    at: Path,
    kind: Kind,
    data: Any,
    report: Report,
) -> None:
    """Report a key that is not there or takes no number, or the values of a range that it does not
    take."""
    inner = kind
    for i, part in enumerate(path):
        found, data = _within(inner, part, data)
        if found is None:
            known = list(kind.keys) if i == 0 and isinstance(kind, Table) else []
            report(at, unknown(f"key {'.'.join(map(str, path))!r}", str(path[0]), known))
            return
        inner = found
    if not (isinstance(inner, Number | Integer) or type(inner).__name__ == "Angle" or
            isinstance(inner, Vector) and inner.scalar):  # fmt: skip
        report(at, "is not a number, so it cannot be swept")
        return
    ((word, value),) = given.items()
    for i in range(len(value)) if word == "values" else (0, 1):
        inner.check(value[i], (*at, word, i), report)


def _within(kind: Kind, part: str | int, data: Any) -> tuple[Kind | None, Any]:
    """The kind and value of one part of a value; no kind where there is no such part."""
    if isinstance(kind, Either):
        nested = Table | Variant if isinstance(data, Mapping) else Vector | Matrix | ListOf
        kind = next((each for each in kind.kinds if isinstance(each, nested)), kind)
    if isinstance(kind, Variant):
        kind = Table(kind.tables[data[kind.tag]])
    if isinstance(kind, ListOf) and isinstance(part, int) and part < len(data):
        return kind.kind, data[part]
    if isinstance(kind, Table) and part in kind.keys:
        key = kind.keys[str(part)]
        given = data.get(part) if isinstance(data, Mapping) else None
        if isinstance(data, Mapping) or key.default is not REQUIRED:
            return key.kind, given
    if isinstance(kind, Vector | Matrix) and isinstance(part, int) and part < kind.n:
        return (Number(kind.above) if isinstance(kind, Vector) else Vector(kind.n)), data[part]
    return None, None


def put(value: Any, path: Sequence[str | int], new: float) -> Any:
    """A copy of resolved case data with `new` at a path; where a vector stands, all of its
    components."""
    if not path:
        # A scalar key given for a vector (`damping`) means that all are equal.
        return (new,) * len(value) if isinstance(value, tuple) else new
    head, *rest = path
    if isinstance(value, Mapping):
        return {**value, head: put(value[head], rest, new)}
    assert isinstance(value, tuple)
    assert isinstance(head, int)
    return (*value[:head], put(value[head], rest, new), *value[head + 1 :])
