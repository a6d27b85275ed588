"""The variations of a claim's cases."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ..cases.case import Case, Time, dump, parse_case
from ..cases.sweep_block import put
from ..models import rigid_body
from . import quantities
from .finding import ROUNDING
from .quantities import Motion


def members(cases: Sequence[Case], over: Mapping[str, Any]) -> Iterator[tuple[str, list[Case]]]:
    """The variations of a claim's cases, all varied alike, each with a name."""
    fixed, grid = over["set"] or {}, over["grid"] or {}
    if over["random"] or over["start"]:
        random = np.random.default_rng(over["seed"])
        for i in range(over["members"]):
            limits = over["random"] or {}
            values = {
                path: float(random.uniform(low, high)) for path, (low, high) in limits.items()
            }
            varied = [changed(case, fixed | values) for case in cases]
            yield (
                f"{i}",
                [thrown(case, over["start"], random) for case in varied]
                if over["start"]
                else varied,
            )
        return
    for combination in itertools.product(*grid.values()):
        values = dict(zip(grid, combination, strict=True))
        name = ", ".join(f"{path} = {value}" for path, value in values.items())
        yield name, [changed(case, fixed | values) for case in cases]


def changed(case: Case, values: Mapping[str, Any]) -> Case:
    """A case with other values at keys such as damping.2 or time.end, which it has; checked like
    any case.

    Raises HodoError for a value that it cannot have.
    """
    data: Any = case.data | {"time": asdict(case.time)}
    for path, value in values.items():
        data = put(
            data, [int(part) if part.isdecimal() else part for part in path.split(".")], value
        )
    time = Time(**data.pop("time"))
    return parse_case(dump(replace(case, data=data, time=time)))


def thrown(case: Case, axis: str, random: np.random.Generator) -> Case:
    """A case with a random start: G uniform on the unit sphere, or on the part of it that encloses
    an axis."""
    A = np.array(case.data["inertia"])
    while True:
        G = random.normal(size=3)
        omega = G / np.linalg.norm(G) / A
        if (
            axis == "any"
            or rigid_body.LABELS[int(rigid_body.enclosed_axis(A, omega, ROUNDING))] == axis
        ):
            initial = dict.fromkeys(case.data["initial"]) | dict(
                zip("pqr", omega.tolist(), strict=True)
            )
            return replace(case, data=case.data | {"initial": initial})


MOTIONS: dict[str, Motion] = {}
"""The motions of variations, which several claims may share."""


def motion(case: Case) -> Motion:
    """The motion of a varied case. All variations come by here."""
    if (text := dump(case)) not in MOTIONS:
        MOTIONS[text] = quantities.integrate(case)
    return MOTIONS[text]
