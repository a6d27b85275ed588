"""A motion as the group of a result file."""

from collections.abc import Mapping

import numpy as np

from ..cases.case import dump
from ..integration.trajectory import Trajectory
from .hdf5 import Attribute, Group, Variable

Labels = Mapping[str, tuple[tuple[str, ...], str, str]]
"""Dimensions, long name and units of each variable, by its name."""


def group_of(trajectory: Trajectory, labels: Labels, hash: str) -> Group:
    """A case as it is stored; a label of `time` replaces the plain one."""
    case, errors = trajectory.case, trajectory.errors
    labels = {"time": (("time",), "time", "1"), **labels}
    variables = {}
    for name, data in {"time": trajectory.time, **trajectory.variables}.items():
        dims, long_name, units = labels[name]
        error = {"error": errors[name]} if name in errors else {}
        variables[name] = Variable(dims, data, {"long_name": long_name, "units": units, **error})
    if any("axis" in variable.dims for variable in variables.values()):
        axes = np.array(["x1", "x2", "x3"], dtype=object)
        variables["axis"] = Variable(("axis",), axes, {"long_name": "principal axis of inertia"})
    if trajectory.events:
        times = np.array([event.time for event in trajectory.events])
        kinds = np.array([event.kind for event in trajectory.events], dtype=object)
        units = labels["time"][2]
        variables["event_time"] = Variable(
            ("event",), times, {"long_name": "time of the event", "units": units}
        )
        variables["event_kind"] = Variable(("event",), kinds, {"long_name": "kind of the event"})
    attributes: dict[str, Attribute] = {
        "model": case.model,
        "form": case.form,
        "case": dump(case),
        "hash": hash,
        "method": trajectory.method,
        "method_reason": trajectory.method_reason,
        "tol": trajectory.tol,
        "steps": trajectory.steps,
        "run_time": trajectory.run_time,
        "error": trajectory.error,
        "error_kind": trajectory.error_kind,
        "status": trajectory.status,
        "message": trajectory.message,
        "warnings": "\n".join(trajectory.warnings),
    }
    return Group(attributes, variables)
