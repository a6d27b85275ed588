"""The members of a claim's `over:`, each integrated as a motion of its own."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, Time, dump, parse_case
from ..cases.sweep_block import Axis, axes_of, put
from ..models import rigid_body
from ..results.motion import Motion
from ..sweeps.members import member
from .finding import ROUNDING
from .quantities import integrated_motion


def members(
    cases: Sequence[Case], over: Mapping[str, Any], start: str | None
) -> Iterator[tuple[str, list[Case]]]:
    """The members of a sweep of several cases, which vary alike, each with a name.

    With `start`, only those in which every case starts about this axis. Raises HodoError for a
    member that is no body.
    """
    axes = axes_of(over)
    shape = tuple(map(len, axes))
    for i in range(math.prod(shape)):
        varied = [varied_case(case, over, i) for case in cases]
        if start is None or all(starting_axis(case) == start for case in varied):
            yield named(axes, np.unravel_index(i, shape)), varied


def varied_case(case: Case, over: Mapping[str, Any], index: int) -> Case:
    """One member of a sweep of a case, with the samples of the case. Raises HodoError if it is no
    body, or has no start.
    """
    found = member(replace(case, sweep=dict(over)), index, case.time.samples)

    for wrong in type(found.system).check(found.data):
        raise HodoError(f"member {index} of {case.name}: {wrong}")
    return found


def named(axes: Sequence[Axis], index: Sequence[Any]) -> str:
    """What tells a member from the others: its values, and its number on a sphere."""
    words = []
    for axis, i in zip(axes, index, strict=True):
        values = [
            f"{'.'.join(map(str, path))} = {axis.values(j, np.array([i]))[0]:g}"
            for j, (path, _) in enumerate(axis.ranges)
        ]
        words += values or [f"{axis.name} {i}"]
    return ", ".join(words)


def starting_axis(case: Case) -> str:
    """The axis that the hodograph of a body-frame case encloses at the start."""
    A, omega = np.array(case.data["inertia"]), np.array(case.system.start)
    return rigid_body.LABELS[int(rigid_body.enclosed_axis(A, omega, ROUNDING))]


def changed(case: Case, values: Mapping[str, Any]) -> Case:
    """A case with other values at keys such as damping.2 or time.end, which it has; checked like
    any case.

    Raises HodoError for a value that it cannot have.
    """
    data: Any = {**case.data, "time": asdict(case.time)}
    for path, value in values.items():
        data = put(
            data, [int(part) if part.isdecimal() else part for part in path.split(".")], value
        )
    time = Time(**data.pop("time"))
    # Through the text, so that a changed value meets every check that a case file meets.
    return parse_case(dump(replace(case, data=data, time=time)))


class Motions:
    """The motions of varied cases, each integrated once, however many claims share it."""

    def __init__(self) -> None:
        self._known: dict[Case, Motion] = {}

    def __call__(self, case: Case) -> Motion:
        # A member's name is its number in one sweep; the same motion may have another elsewhere.
        unnamed = replace(case, name="variation")
        if unnamed not in self._known:
            self._known[unnamed] = integrated_motion(case)
        return self._known[unnamed]
