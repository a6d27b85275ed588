"""The groups that `run` and `classify` store for a case."""

from ..cases.case import Case
from ..integration import Classification, Trajectory, own_crossings
from ..models.rigid_body import BodyFrame
from ..quantities import stored_name
from ..storage import Group, Variable
from .layout import (
    INNER_COORDINATES,
    Stored,
    case_attributes,
    case_variables,
    inner_coordinates,
    label_variables,
    sentence_of_case,
    with_units,
)
from .motion import Motion

PRINCIPAL = {
    "principal_axes": Stored(
        "principal axis of inertia, in the axes of the case", ("principal", "axis")
    ),
    "principal_moments": Stored(
        "principal moment of inertia", ("principal",), units="moment of inertia"
    ),
}
"""The variables stored for a full tensor of inertia; labels name these axes."""

TURN = {
    "turn_period": Stored("time of a turn of the hodograph", units="time"),
    "turn_angle": Stored(
        "angle by which the enclosed axis goes round G in a turn of the hodograph", units="rad"
    ),
}
"""The variables stored for the hodograph of a free body with an attitude."""

GROWTH_RATE = Stored(
    "rate at which a small tilt away from the axis grows, on the mean over a turn",
    ("axis",),
    units="1/time",
)


def principal_variables(case: Case) -> dict[str, Variable]:
    """The principal axes and moments of a body that is given by its full tensor of inertia."""
    body = case.system
    if not isinstance(body, BodyFrame) or body.principal_axes is None:
        return {}
    values = body.principal_axes.astype(float), body.moments
    stored = {
        name: kind.holding(x) for (name, kind), x in zip(PRINCIPAL.items(), values, strict=True)
    }
    # Components of other vectors are along the axes of the case, not along the principal axes.
    axis, names = INNER_COORDINATES["axis"]
    axis = axis._replace(long_name="axis of the body, as the case gives it")
    return stored | inner_coordinates(stored.values()) | {"axis": axis.holding(names)}


def case_group(trajectory: Trajectory, digest: str) -> Group:
    """The group of an integrated case, with `digest` for its hash."""
    case = trajectory.case
    attributes = case_attributes(
        case,
        digest,
        method=trajectory.method,
        method_reason=trajectory.method_reason,
        tol=trajectory.tol,
        steps=trajectory.steps,
        run_time=trajectory.run_time,
        error=trajectory.error,
        error_kind=trajectory.error_kind,
        status=trajectory.status,
        message=trajectory.message,
        warnings="\n".join(trajectory.warnings),
    )
    labels, values, store = case.system.equations.variables, trajectory.variables, case.store
    kept = {name: data for name, data in values.items() if not store or name in store}
    events = [event for event in trajectory.events if event.kind != "separatrix"]
    variables = case_variables(labels, trajectory.time, kept, events, trajectory.errors)
    if case.system.is_quadrature:  # the quadrature itself gives labels and crossings
        variables |= label_variables(values["enclosed_axis"], own_crossings(trajectory))
    # `store:` may name quantities too, which follow from the whole state.
    if derived := [name for name in store if name not in labels]:
        motion = Motion(case, case_variables(labels, trajectory.time, values, (), {}))
        variables |= {stored_name(name): motion.derived_variable(name) for name in derived}
        variables |= inner_coordinates(variables.values())
    variables |= principal_variables(case)
    turn = getattr(case.system, "turn", None) or ()
    variables |= {
        name: kind.holding(x) for (name, kind), x in zip(TURN.items(), turn, strict=False)
    }
    return Group(attributes, with_units(variables, case))


def label_group(labelled: Classification, case: Case) -> Group:
    """The group that `classify` adds to a stored case."""
    variables = label_variables(labelled.labels, labelled.crossings)
    if labelled.growth is not None:
        variables["growth_rate"] = GROWTH_RATE.holding(labelled.growth)
        variables |= inner_coordinates(variables.values())
    texts = {
        "classify_warnings": "\n".join(labelled.warnings),
        "predictions": "\n".join(sentence_of_case(words, case) for words in labelled.predictions),
    }
    return Group(texts, with_units(variables, case))
