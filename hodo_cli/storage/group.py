"""Groups of labelled arrays, and the checksum that a group is stored with."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .disk import GroupChecksum, ValuesChecksum, checksum_of_values

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
    late: StreamedVariables | None = None
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


def checksum_of(group: Group, checksums: Mapping[str, ValuesChecksum]) -> str:
    """The checksum that a group is stored with; `checksums` are those of variables that were
    written block by block."""
    checksum = GroupChecksum(as_stored(group.attributes))
    for key, variable in group.variables.items():
        values = str(checksums[key]) if key in checksums else checksum_of_values(variable.data)
        checksum.add(key, variable.dims, values, as_stored(variable.attrs))
    return str(checksum)
