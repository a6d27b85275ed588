"""What is stored of the members of a sweep, one column each."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..cases.case import Case
from ..cases.sweep_block import axes_of
from ..engines.protocol import Status
from ..models import rigid_body
from ..results.hdf5 import Attribute

LABEL: dict[str, Attribute] = {
    "flag_values": np.array(list(rigid_body.LABELS), dtype=np.int8),
    "flag_meanings": " ".join(rigid_body.LABELS.values()),
}
FLAG: dict[str, Attribute] = {
    "flag_values": np.arange(len(Status), dtype=np.int8),
    "flag_meanings": " ".join(Status),
}


class Column(NamedTuple):
    """One number, or one vector, of each member."""

    long_name: str
    dtype: str = "f8"
    dims: tuple[str, ...] = ()
    units: str = "1"
    attributes: Mapping[str, Attribute] = {}
    default: bool = True


CLASSIFIED = {
    "crossing_time": Column("time of the first passage through the separatrix"),
    "crossing_from": Column("axis enclosed before it", "i1", attributes=LABEL),
    "crossing_to": Column("axis enclosed after it", "i1", attributes=LABEL),
    "crossing_G": Column("|G| at it"),
    "crossings": Column("number of passages", "i4"),
    "start_axis": Column("axis that the hodograph encloses at the start", "i1", attributes=LABEL),
    "end_axis": Column("axis that the hodograph encloses at the end", "i1", attributes=LABEL),
    "share": Column(
        "part of the span in which the hodograph encloses an axis", dims=("axis",), default=False
    ),
    "separation": Column("least |D| seen, as a part of the sum of its two terms", default=False),
}
ALWAYS = {"status": Column("how the member ended", "i1", attributes=FLAG)}
STEPS = {"steps": Column("steps of the integration", "i4", default=False)}
EVENT = {"event_time": Column("time of the event that ended the motion")}


def columns(case: Case) -> dict[str, Column]:
    """Everything that a member of this sweep is reduced to."""
    model = case.system
    final = {
        name: Column(
            f"{variable.long_name}, at the end", dims=variable.dims[1:], units=variable.units
        )
        for name, variable in model.variables.items()
    }
    own = EVENT if model.unclassifiable else CLASSIFIED
    return final | own | STEPS | ALWAYS


def kept(case: Case) -> dict[str, Column]:
    """What of that is stored in the result."""
    asked = set(case.store) - {"trajectory"}
    return {
        name: column
        for name, column in columns(case).items()
        if name == "status" or (name in asked if asked else column.default)
    }


def shape(case: Case) -> tuple[int, ...]:
    """The length of each axis."""
    assert case.sweep is not None
    return tuple(len(axis) for axis in axes_of(case.sweep))
