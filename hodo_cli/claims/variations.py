"""The motions of a claim that no result stores: the members of its `over:`, and its cases with
other values."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, FrozenDict, variation
from ..cases.sweep_block import Axis, axes_of, first_values
from ..integration import body_of
from ..models import rigid_body
from ..results.motion import Motion
from ..schema.kinds import Wrong
from ..sweeps.members import members_as_cases
from ..sweeps.single_cases import side_by_side
from ..text import grouped
from .finding import ROUNDING
from .quantities import integrated_motion, sampled_motion


@lru_cache(maxsize=16)
def members(
    cases: tuple[Case, ...], over: FrozenDict, start: str | None
) -> Mapping[str, Sequence[Case]]:
    """The members of a sweep of several cases, which vary alike, by their names; kept for the next
    claim about them.

    With `start`, only the members in which every case starts about this axis. Raises HodoError for
    a member whose data no body can have.
    """
    axes = axes_of(over)
    shape = tuple(map(len, axes))
    numbers = np.arange(math.prod(shape))
    by_case = []
    for case in cases:
        data = {**case.data, **first_values(over, type(case.system), case.data)}
        varied = replace(case, sweep=over, data=data)
        by_case.append([*members_as_cases(varied, numbers, None)])
    for case in itertools.chain(*by_case):
        for mistake in type(case.system).check(case.data):
            raise HodoError(f"member {case.name}: {mistake}")
    labels = [starting_axes(varied) for varied in by_case if start]
    return {
        member_name(axes, np.unravel_index(i, shape)): varied
        for i, varied in enumerate(zip(*by_case, strict=True))
        if all(of_case[i] == start for of_case in labels)
    }


def member_name(axes: Sequence[Axis], index: Sequence[Any]) -> str:
    """The name of a member: its values, and its number on a sphere."""
    words = []
    for axis, i in zip(axes, index, strict=True):
        values = [
            f"{key} = {axis.values(j, np.array([i]))[0]:g}" for j, key in enumerate(axis.keys)
        ]
        words += values or [f"{axis.name} {i}"]
    return ", ".join(words)


def starting_axes(cases: Sequence[Case]) -> list[str]:
    """The axes that the hodographs of body-frame cases enclose at the start."""
    names = [""] * len(cases)
    bodies = ((case.data["inertia"], case.data.get("rotor")) for case in cases)
    # All cases of one body at once.
    for of_body in grouped((body, i) for i, body in enumerate(bodies)).values():
        body = body_of(cases[of_body[0]])
        omega = np.array([cases[i].system.start[:3] for i in of_body])
        labels = body.enclosed(body.to_principal(omega), ROUNDING)
        for i, label in zip(of_body, labels.tolist(), strict=True):
            names[i] = rigid_body.LABELS[label]
    return names


def changed_case(case: Case, changes: Mapping[str, Any]) -> Case:
    """A case with other values at some keys. Raises HodoError for a value that it cannot have."""
    try:
        return variation(case, changes)
    except Wrong as error:
        raise HodoError(f"a variation of case {case.name}: {error}") from None


MOST_VARIED_SAMPLES = 5_000_000
"""Samples that are integrated side by side, and kept for the next claim: some 500 MB."""


@dataclass
class Motions:
    """The motions of varied cases, each integrated once for the claims that share it, as far as
    memory allows."""

    _known: dict[Case, Motion] = field(default_factory=dict)

    def of(self, members: Sequence[Sequence[Case]]) -> Iterator[list[Motion]]:
        """The motions of each member's cases. Raises HodoError if one stops before its end."""
        size = max(1, MOST_VARIED_SAMPLES // sum(case.time.samples for case in members[0]))
        for i in range(0, len(members), size):
            if sum(len(m.time) for m in self._known.values()) > MOST_VARIED_SAMPLES:
                self._known.clear()
            block = members[i : i + size]
            self._integrate(dict.fromkeys(itertools.chain(*block)))
            yield from ([self._known[case] for case in cases] for cases in block)

    def _integrate(self, cases: Iterable[Case]) -> None:
        """Integrate the cases that are not known, side by side where that is possible."""
        new = [case for case in cases if case not in self._known]
        for case, followed in zip(new, side_by_side(new), strict=True):
            self._known[case] = sampled_motion(*followed) if followed else integrated_motion(case)
