"""The members of a sweep: their data, and any one of them as a single case."""

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..arithmetic import BranchDivergence, Column, of_members
from ..cases.case import Case
from ..cases.sweep_block import axes_of, put
from ..models.base import Event, Model
from ..models.constants import Structure, flatten, structure
from ..schema.kinds import KeyPath
from .columns import shape

FEWEST_COLUMN = 16
"""Members below which each by itself takes less time to prepare than all at once."""


class Inputs(NamedTuple):
    """One combination of the values that vary otherwise than over a sphere, or a column of many:
    the data, and what they amount to.

    `start` is None, and so is all but the data, where they describe no body or no start.
    """

    data: Mapping[str, Any]
    structure: Structure = ()
    constants: tuple[Any, ...] = ()
    start: tuple[Any, ...] | None = None
    events: tuple[Event, ...] = ()
    system: Model | None = None


class Prepared(NamedTuple):
    """Members that can share a compiled step: their places (k,), what they have in common, and
    their constants (c, k) and starts (m, k)."""

    at: np.ndarray
    structure: Structure
    events: tuple[Event, ...]
    constants: np.ndarray
    start: np.ndarray

    @classmethod
    def of(cls, given: Inputs, at: np.ndarray, start: Iterable[Any]) -> "Prepared":
        """The members `at` with these inputs, and with a start of their own."""
        constants, begin = (rows(numbers, len(at)) for numbers in (given.constants, tuple(start)))
        return cls(at, given.structure, given.events, constants, begin)


def rows(numbers: Sequence[Any], n: int) -> np.ndarray:
    """Numbers, columns of them or arrays (n,) as the rows of an array."""
    array = np.empty((len(numbers), n))
    for i, number in enumerate(numbers):
        array[i] = number if isinstance(number, np.ndarray) else of_members(number)
    return array


def inputs(case: Case, paths: Sequence[KeyPath], values: Sequence[Any]) -> Inputs:
    """The data of members with one combination of values, or columns of many, at the paths that
    vary."""
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


def combinations(
    case: Case, members: np.ndarray
) -> tuple[list[KeyPath], np.ndarray, np.ndarray, np.ndarray | None]:
    """The paths that vary and the values there (p, k) of each combination that occurs among members
    (n,), the place of each member's, and its direction (n, 3), if any."""
    assert case.sweep is not None
    axes = axes_of(case.sweep)
    index = np.unravel_index(members, shape(case))
    plain = [(axis, i) for axis, i in zip(axes, index, strict=True) if axis.sphere is None]
    sizes = [len(axis) for axis, _ in plain] or [1]
    flat = np.ravel_multi_index([i for _, i in plain] or [np.zeros_like(members)], sizes)
    # The members of a sphere have their data in common.
    which, place = np.unique(flat, return_inverse=True)
    varying = [
        (path, axis.values(j, at))
        for (axis, _), at in zip(plain, np.unravel_index(which, sizes), strict=bool(plain))
        for j, (path, _) in enumerate(axis.ranges)
    ]
    paths = [path for path, _ in varying]
    values = np.array([numbers for _, numbers in varying]).reshape(len(paths), len(which))
    sphere = next(
        ((axis, i) for axis, i in zip(axes, index, strict=True) if axis.sphere is not None), None
    )
    return paths, values, place, sphere[0].directions(sphere[1]) if sphere else None


def member_inputs(
    case: Case, members: np.ndarray
) -> tuple[list[Inputs], np.ndarray, np.ndarray | None]:
    """The combinations that occur among members (n,), each by itself, the place of each member's,
    and its direction (n, 3), if any."""
    paths, values, place, direction = combinations(case, members)
    return [inputs(case, paths, row) for row in values.T.tolist()], place, direction


def prepare(case: Case, members: np.ndarray) -> list[Prepared]:
    """Members (n,) as their motions begin; those without a body or a start are left out."""
    paths, values, place, direction = combinations(case, members)
    if direction is None:
        return alike(in_parts(case, paths, values[:, place], np.arange(len(members))))
    given = [inputs(case, paths, row) for row in values.T.tolist()]
    omega = velocities(given, place, direction)
    return alike(
        Prepared.of(shared, at, shared.system.starts(omega[at]))
        for shared, at in ((shared, np.flatnonzero(place == i)) for i, shared in enumerate(given))
        if shared.system is not None
    )


def in_parts(
    case: Case, paths: Sequence[KeyPath], values: np.ndarray, at: np.ndarray
) -> Iterator[Prepared]:
    """The members `at`, with values (p, n) at paths: as many at once as their model prepares
    alike."""
    try:
        some = at_once(case, paths, values, at)
    except BranchDivergence as branches:
        for part in (branches.where, ~branches.where):
            yield from in_parts(case, paths, values, at[part])
        return
    if some is not None:
        yield some
        return
    for place, row in zip(at[:, None], values[:, at].T.tolist(), strict=True):
        single = inputs(case, paths, row)
        if single.start is not None:
            yield Prepared.of(single, place, single.start)


def at_once(
    case: Case, paths: Sequence[KeyPath], values: np.ndarray, at: np.ndarray
) -> Prepared | None:
    """The same, for members whose model takes one branch; None if they are to be prepared one by
    one: they are few, refused, or their model takes plain numbers only."""
    if len(at) < FEWEST_COLUMN:
        return None
    try:
        with np.errstate(all="ignore"):  # columns refuse what is not finite
            shared = inputs(case, paths, [Column(row) for row in values[:, at]])
        return None if shared.start is None else Prepared.of(shared, at, shared.start)
    except TypeError:
        return None


def alike(parts: Iterable[Prepared]) -> list[Prepared]:
    """The same members, with those together that can share a compiled step."""
    kinds: dict[Hashable, list[Prepared]] = {}
    for part in parts:
        kinds.setdefault((part.structure, part.events), []).append(part)
    return [
        Prepared(
            np.concatenate([part.at for part in same]),
            *same[0][1:3],
            *(
                np.concatenate(arrays, axis=1)
                for arrays in zip(*(p[3:] for p in same), strict=True)
            ),
        )
        for same in kinds.values()
    ]


def velocities(given: list[Inputs], place: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The angular velocities (n, 3) at the start that have these directions (n, 3) of G, and |G| of
    the data; nan for data that describe no body or no start."""
    A, omega = (
        np.array([shared.data["inertia"] for shared in given]),
        np.full((len(given), 3), np.nan),
    )
    for row, shared in zip(omega, given, strict=True):
        if shared.system is not None:
            row[:] = shared.system.velocity(shared.data["inertia"], shared.data["initial"])
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
        shared = given[place[i]]
        data = shared.data
        if omega is not None and shared.start is not None:
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
    numbers: dict[str, int] = {}
    for number in sorted({0, last}):
        (given,), _, _ = member_inputs(case, np.array([number]))
        if given.start is not None:
            for warning in member(case, number).system.warnings:
                numbers.setdefault(warning, number)
    return [f"member {number} of {last + 1}: {warning}" for warning, number in numbers.items()]
