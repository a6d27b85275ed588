"""The members of a sweep: their data, and any one of them as a single case."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..cases.case import Case
from ..cases.sweep_block import axes_of, put
from ..models.base import Event, Model
from ..models.constants import Structure, flatten, structure
from ..schema.kinds import KeyPath
from .columns import shape


class Inputs(NamedTuple):
    """One combination of the values that vary otherwise than over a sphere: the data, and what they
    amount to.

    `start` is None, and so is all but the data, where they describe no body or no start.
    """

    data: Mapping[str, Any]
    structure: Structure = ()
    constants: tuple[float, ...] = ()
    start: tuple[float, ...] | None = None
    events: tuple[Event, ...] = ()
    system: Model | None = None


def inputs(case: Case, paths: Sequence[KeyPath], values: Sequence[float]) -> Inputs:
    """The data of members with one combination of values at the paths that vary."""
    data = case.data
    for path, new in zip(paths, values, strict=True):
        data = put(data, path, new)
    model = type(case.system)
    if any(model.check(data)):
        return Inputs(data)
    return of_system(data, model(**data))


def of_system(data: Mapping[str, Any], system: Model) -> Inputs:
    """What data of which a model makes this system amount to."""
    k, events = system.constants, (*system.run_events, *system.class_events)
    return Inputs(data, structure(k), tuple(flatten(k)), system.start, events, system)


def member_inputs(
    case: Case, members: np.ndarray
) -> tuple[list[Inputs], np.ndarray, np.ndarray | None]:
    """The combinations that occur among members (n,), the place of each member's, and its direction
    (n, 3), if any."""
    assert case.sweep is not None
    axes = axes_of(case.sweep)
    index = np.unravel_index(members, shape(case))
    plain = [(axis, i) for axis, i in zip(axes, index, strict=True) if axis.sphere is None]
    sizes = [len(axis) for axis, _ in plain] or [1]
    flat = np.ravel_multi_index([i for _, i in plain] or [np.zeros_like(members)], sizes)
    # Checking the data in Python takes longer than a member's integration, so equal data are
    # checked once.
    which, place = np.unique(flat, return_inverse=True)
    varying = [
        (path, axis.values(j, at))
        for (axis, _), at in zip(plain, np.unravel_index(which, sizes), strict=bool(plain))
        for j, (path, _) in enumerate(axis.ranges)
    ]
    paths = [path for path, _ in varying]
    values = np.array([each for _, each in varying]).reshape(len(paths), len(which))
    found = [inputs(case, paths, each) for each in values.T.tolist()]
    sphere = next(
        ((axis, i) for axis, i in zip(axes, index, strict=True) if axis.sphere is not None), None
    )
    return found, place, sphere[0].directions(sphere[1]) if sphere else None


def starts(given: list[Inputs], place: np.ndarray, direction: np.ndarray | None) -> np.ndarray:
    """The states at the start (m, n), from the combination at each place (n,); with a direction (n,
    3) of G, its |G| is that of the data."""
    if direction is None:
        return np.array([one.start for one in given]).T[:, place]
    omega = velocities(given, place, direction)
    start = np.empty((len(given[0].start or ()), len(place)))
    for i, one in enumerate(given):
        assert one.system is not None
        start[:, place == i] = one.system.starts(omega[place == i])
    return start


def velocities(given: list[Inputs], place: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The angular velocities (n, 3) at the start that have these directions (n, 3) of G, and |G| of
    the data; nan for data that describe no body or no start."""
    A, omega = np.array([one.data["inertia"] for one in given]), np.full((len(given), 3), np.nan)
    for row, one in zip(omega, given, strict=True):
        if one.system is not None:
            row[:] = one.system.velocity(one.data["inertia"], one.data["initial"])
    G = np.linalg.norm(A * omega, axis=1)
    return np.asarray(G[place, None] * direction / A[place])


def member(case: Case, number: int, samples: int = 2) -> Case:
    """One member as a case of its own."""
    return next(members_as_cases(case, np.array([number]), samples))


def members_as_cases(case: Case, numbers: np.ndarray, samples: int) -> Iterator[Case]:
    """Members as cases of their own."""
    given, place, direction = member_inputs(case, numbers)
    time = replace(case.time, samples=samples)
    common = replace(case, time=time, sweep=None, store=(), error="off")
    omega = None if direction is None else velocities(given, place, direction)
    for i, number in enumerate(numbers):
        of = given[place[i]]
        data = of.data
        if omega is not None and of.start is not None:
            # The other ways to give the start (|G|, x and y) make way for the components.
            start = dict.fromkeys(data["initial"]) | dict(
                zip("pqr", omega[i].tolist(), strict=True)
            )
            data = {**data, "initial": start}
        yield replace(common, name=f"{case.name}.{number}", data=data)


def warnings_of_ends(case: Case) -> list[str]:
    """What the data of the first and of the last member say against their model.

    The data of the case itself may never be run. Values on an axis mostly rise or fall, so that
    what is said of any member is said of one of these two.
    """
    last = math.prod(shape(case)) - 1
    found: dict[str, int] = {}
    for number in sorted({0, last}):
        (given,), _, _ = member_inputs(case, np.array([number]))
        if given.start is not None:
            for warning in member(case, number).system.warnings:
                found.setdefault(warning, number)
    return [f"member {number} of {last + 1}: {warning}" for warning, number in found.items()]
