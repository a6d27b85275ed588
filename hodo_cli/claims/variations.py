"""The members of a claim's `over:`, each as a motion."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, Time, dump, parse_case
from ..cases.sweep_block import Axis, axes_of, path_of, put
from ..integration.crossings import Crossing
from ..models import rigid_body
from ..results.motion import Array, Motion
from ..sweeps.chunk import side_by_side
from ..sweeps.members import members_as_cases
from .finding import ROUNDING
from .quantities import integrated_motion, sampled_motion


def members(
    cases: Sequence[Case], over: Mapping[str, Any], start: str | None
) -> Iterator[tuple[str, list[Case]]]:
    """The members of a sweep of several cases, which vary alike, each with a name.

    With `start`, only those in which every case starts about this axis. Raises HodoError for a
    member that is no body.
    """
    axes = axes_of(over)
    shape = tuple(map(len, axes))
    numbers = np.arange(math.prod(shape))
    swept = [replace(case, sweep=dict(over)) for case in cases]
    each = [[*members_as_cases(case, numbers, case.time.samples)] for case in swept]
    for case in itertools.chain(*each):
        for wrong in type(case.system).check(case.data):
            raise HodoError(f"member {case.name}: {wrong}")
    about = [starting_axes(of_case) for of_case in each if start]
    for i, varied in enumerate(zip(*each, strict=True)):
        if all(axis[i] == start for axis in about):
            yield named(axes, np.unravel_index(i, shape)), [*varied]


def named(axes: Sequence[Axis], index: Sequence[Any]) -> str:
    """What tells a member from the others: its values, and its number on a sphere."""
    words = []
    for axis, i in zip(axes, index, strict=True):
        values = [
            f"{key} = {axis.values(j, np.array([i]))[0]:g}" for j, key in enumerate(axis.keys)
        ]
        words += values or [f"{axis.name} {i}"]
    return ", ".join(words)


def starting_axes(cases: Sequence[Case]) -> list[str]:
    """The axes that the hodographs of body-frame cases enclose at the start."""
    found = [""] * len(cases)
    bodies: dict[Any, list[int]] = {}
    for i, case in enumerate(cases):
        bodies.setdefault(case.data["inertia"], []).append(i)
    for inertia, at in bodies.items():
        omega = np.array([cases[i].system.start for i in at])
        labels = rigid_body.enclosed_axis(np.array(inertia), omega, ROUNDING)
        for i, label in zip(at, labels.tolist(), strict=True):
            found[i] = rigid_body.LABELS[label]
    return found


def changed(case: Case, values: Mapping[str, Any]) -> Case:
    """A case with other values at keys such as damping.2 or time.end, which it has; checked like
    any case.

    Raises HodoError for a value that it cannot have.
    """
    data: Any = {**case.data, "time": asdict(case.time)}
    for key, value in values.items():
        data = put(data, path_of(key), value)
    time = Time(**data.pop("time"))
    # Through the text, so that a changed value meets every check that a case file meets.
    return parse_case(dump(replace(case, data=data, time=time)))


class Motions:
    """The motions of varied cases, each integrated once, however many claims share it, and not
    before a claim asks for it."""

    def __init__(self) -> None:
        self._known: dict[Case, Motion] = {}

    def of(self, cases: Sequence[Case]) -> list[Motion]:
        """The motions of cases, which are integrated side by side.

        What is asked of a motion raises HodoError if it stops before its end.
        """
        # A member's name is its number in one sweep; the same motion may have another elsewhere.
        unnamed = [replace(case, name="variation") for case in cases]
        new = [i for i, case in enumerate(unnamed) if case not in self._known]
        beside = Together([cases[i] for i in new])
        for n, i in enumerate(new):
            self._known[unnamed[i]] = Varied(cases[i], Variables(beside, n), label=cases[i].name)
        return [self._known[case] for case in unnamed]


class Together:
    """Cases that go side by side when something is asked of one: through their samples, or without
    them if it is only when they cross. A case in doubt is integrated by itself."""

    def __init__(self, cases: Sequence[Case]) -> None:
        self._cases = cases

    def variables(self, n: int) -> Mapping[str, Array]:
        """Those of the n-th case. Raises HodoError if it stops before its end."""
        # A property is in `vars` when it has been asked for.
        in_doubt = "_crossings" in vars(self) and self._crossings[n] is None
        found = None if in_doubt else self._motions[n]
        return (found or integrated_motion(self._cases[n])).data

    def crossings(self, n: int) -> tuple[Crossing, ...] | None:
        """The crossings of the n-th case; None where its variables hold them."""
        return None if "_motions" in vars(self) else self._crossings[n]

    @cached_property
    def _motions(self) -> list[Motion | None]:
        found = side_by_side(self._cases, sampled=True)
        return [
            one and sampled_motion(case, *one) for case, one in zip(self._cases, found, strict=True)
        ]

    @cached_property
    def _crossings(self) -> list[tuple[Crossing, ...] | None]:
        return [one and one[1] for one in side_by_side(self._cases, sampled=False)]


class Variables(Mapping[str, Array]):
    """The variables of one of some cases, which is integrated when they are first asked for."""

    def __init__(self, beside: Together, n: int) -> None:
        self._beside, self._n = beside, n

    @property
    def crossings(self) -> tuple[Crossing, ...] | None:
        """See `Together.crossings`."""
        return self._beside.crossings(self._n)

    @cached_property
    def _known(self) -> Mapping[str, Array]:
        return self._beside.variables(self._n)

    def __getitem__(self, name: str) -> Array:
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)


class Varied(Motion):
    """A motion whose crossings may be known before its variables are."""

    data: Variables

    @cached_property
    def crossings(self) -> tuple[Crossing, ...]:
        """See `Motion.crossings`."""
        known = self.data.crossings
        return super().crossings if known is None else known
