"""What is stored of the members of a sweep, one column each."""

from ..cases.case import Case
from ..cases.sweep_block import axes_of
from ..results.layout import (
    MEMBER_CLASSIFIED,
    MEMBER_EVENT,
    MEMBER_STATUS,
    MEMBER_STEPS,
    UNASKED,
    Stored,
)


def columns(case: Case) -> dict[str, Stored]:
    """Everything that a member of this sweep is reduced to."""
    model = case.system
    final = {
        name: Stored(f"{variable.long_name}, at the end", variable.dims[1:], units=variable.units)
        for name, variable in model.variables.items()
    }
    own = MEMBER_EVENT if model.unclassifiable else MEMBER_CLASSIFIED
    return final | own | MEMBER_STEPS | MEMBER_STATUS


def kept(case: Case) -> dict[str, Stored]:
    """What of that is stored in the result."""
    asked = set(case.store) - {"trajectory"}
    return {
        name: column
        for name, column in columns(case).items()
        if name == "status" or (name in asked if asked else name not in UNASKED)
    }


def shape(case: Case) -> tuple[int, ...]:
    """The length of each axis."""
    assert case.sweep is not None
    return tuple(len(axis) for axis in axes_of(case.sweep))
