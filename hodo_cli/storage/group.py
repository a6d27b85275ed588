"""Groups of labelled arrays, and the checksum that a group is stored with."""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

Attribute = str | int | float | np.ndarray


@dataclass(frozen=True)
class Variable:
    """A labelled array: numbers that netCDF knows (not bool, half or long double), or strings."""

    dims: tuple[str, ...]
    data: np.ndarray
    attrs: dict[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class StreamedVariables:
    """Variables too large for memory: their arrays carry only shape and dtype, and the values come
    from `blocks()` as (name, where, block) when the group is written."""

    names: frozenset[str]
    blocks: Callable[[], Iterator[tuple[str, Any, np.ndarray]]]


@dataclass(frozen=True)
class Report:
    """What a command has found from stored data, as JSON, and the digest of what that depends on
    besides the group that it is stored with. The checksum of the group does not cover it."""

    digest: str
    json: str


@dataclass(frozen=True)
class Group:
    """What a group holds. A variable that is named as its only dimension is that dimension's
    coordinate."""

    attributes: Mapping[str, Attribute]
    variables: Mapping[str, Variable]
    streamed: StreamedVariables | None = None
    report: Report | None = None

    def with_addition(self, addition: "Group") -> "Group":
        """This group with what another adds to it or replaces, and with its report."""
        attributes = {**self.attributes, **addition.attributes}
        return Group(attributes, {**self.variables, **addition.variables}, report=addition.report)


def as_stored(attributes: Mapping[str, Attribute]) -> dict[str, Attribute]:
    """Attributes without what HDF5 cannot store: a text of a foreign program may hold half a
    surrogate, or a zero, at which C readers would stop."""
    return {
        name: value.encode("utf-8", "replace").decode().replace("\0", "\ufffd")
        if isinstance(value, str)
        else value
        for name, value in attributes.items()
    }


def is_number(dtype: np.dtype) -> bool:
    """Whether netCDF has a type of number: no records, references or lists either."""
    return dtype.kind in "iuf" and dtype.itemsize <= 8 and dtype != np.float16


def dimension_sizes(variables: Mapping[str, Variable]) -> dict[str, int]:
    """The sizes of the dimensions of variables. Raises ValueError for one that has two."""
    sizes: dict[str, int] = {}
    for name, variable in variables.items():
        for dim, size in zip(variable.dims, variable.data.shape, strict=True):
            if sizes.setdefault(dim, size) != size:
                raise ValueError(f"{name} has {size} values along {dim}, elsewhere {sizes[dim]}")
    return sizes


class ValuesChecksum:
    """The checksum of an array's values, which may come block by block, in their order."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._kind = ""

    def add(self, values: np.ndarray) -> Self:
        """Take in some values; text by its characters, numbers by their bits."""
        if values.dtype.kind in "OU":
            self._hash.update("\0".join([*map(str, values.ravel()), ""]).encode("utf-8", "replace"))
        else:
            self._kind = values.dtype.str
            self._hash.update(np.ascontiguousarray(values).data.cast("B") if values.size else b"")
        return self

    def __str__(self) -> str:
        return f"{self._kind}{self._hash.hexdigest()}"


def checksum_of(group: Group, streamed: Mapping[str, ValuesChecksum] | None = None) -> str:
    """The checksum that a group is stored with: of its attributes and variables, in their order.
    What is added to the group later is not covered, and does not disturb it.

    `streamed` are the checksums of variables that were written block by block.
    """
    lines = [_described(group.attributes)]
    for name, variable in group.variables.items():
        values = (streamed or {}).get(name) or ValuesChecksum().add(variable.data)
        lines.append(f"{name} {variable.dims} {values} {_described(variable.attrs)}")
    hashed = hashlib.sha256("\n".join(lines).encode("utf-8", "replace"))
    return f"sha256:{len(group.variables)}:{hashed.hexdigest()[:32]}"


def _described(attributes: Mapping[str, Attribute]) -> str:
    """Attributes in a form that is the same before they are written and after they are read."""
    items = as_stored(attributes).items()
    return "\n".join(f"{name}={np.asarray(value).tolist()!r}" for name, value in items)
