"""Verdicts over one motion, a grid, a random sample or a sweep."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import parse_case
from ..cases.claim_block import CONTRADICTED, NOT_TESTED, REPRODUCED, UNDERDETERMINED
from ..results.hdf5 import Run
from ..sweeps.averages import Labelled, average
from .checks import KINDS
from .finding import PLOTTING_ACCURACY, ROUNDING, Finding, Verdict, beyond, degree
from .quantities import Motion
from .variations import members, motion


def measure(claim: Mapping[str, Any], motions: Sequence[Motion]) -> Verdict:
    """The verdict on one claim by the motions of its cases, in order, or by variations of them.
    Raises as `judge`."""
    check, over = claim["check"], claim["over"]
    decide = KINDS[check["kind"]]
    if over is None:
        finding = decide(check, motions)
        return Verdict(claim, degree(finding.deviation), finding.number, finding.words)
    varied = members([each.case for each in motions], over)
    found = {member: decide(check, [motion(case) for case in cases]) for member, cases in varied}
    return sampled(claim, found) if over["random"] or over["start"] else gridded(claim, found)


def gridded(claim: Mapping[str, Any], found: Mapping[str, Finding]) -> Verdict:
    """The verdict over a grid of what the text does not print."""
    if len(found) == 1:
        (finding,) = found.values()
        return Verdict(claim, degree(finding.deviation), finding.number, finding.words)
    worst = max(found, key=lambda member: found[member].deviation)
    deviation, holds = (
        found[worst].deviation,
        sum(f.deviation <= PLOTTING_ACCURACY for f in found.values()),
    )
    part = 0 < holds < len(found)
    size = f"{deviation:.2g} of the range " if deviation < math.inf else ""
    violation = f"; largest violation {size}at {worst} ({found[worst].words})" if deviation else ""
    words = f"holds on {holds} of {len(found)} members{spread(found)}{violation}"
    return Verdict(
        claim, UNDERDETERMINED if part else degree(deviation), found[worst].number, words
    )


def sampled(claim: Mapping[str, Any], found: Mapping[str, Finding]) -> Verdict:
    """The verdict over random members."""
    holds = sum(f.deviation <= PLOTTING_ACCURACY for f in found.values())
    share = holds / len(found)
    words = f"holds for {holds} of {len(found)} random members ({share:.3g}){spread(found)}"
    return Verdict(
        claim, REPRODUCED if share >= claim["over"]["share"] else CONTRADICTED, share, words
    )


def spread(found: Mapping[str, Finding]) -> str:
    """The range of the deciding number over the members, where there is one."""
    numbers = [finding.number for finding in found.values()]
    return f", {min(numbers):.6g} to {max(numbers):.6g}" if min(numbers) < max(numbers) else ""


# Checks of sweeps, each of the one case that it names.


def census(claim: Mapping[str, Any], run: Run) -> Verdict:
    """The verdict on a claim about the members of one sweep. Raises HodoError if that has not what
    the check needs."""
    name, *others = claim["cases"]
    if others:
        raise HodoError(
            f"{run.path}: claim {claim['id']}: a check of kind {claim['check']['kind']} takes one case"
        )
    if name not in run:
        return Verdict(claim, NOT_TESTED, math.nan, f"{name}: missing")
    group = run.read(name)
    sweep = parse_case(str(group.attributes["case"])).sweep
    if not sweep:
        raise HodoError(f"{run.path}: claim {claim['id']}: case {name} is no sweep")
    columns = {
        key: Labelled(each.dims, each.data, each.attributes)
        for key, each in group.variables.items()
    }
    try:
        finding = SWEPT[claim["check"]["kind"]](claim["check"], columns, list(sweep))
    except HodoError as error:
        raise HodoError(f"{run.path}: claim {claim['id']}: {error}") from error
    return Verdict(claim, degree(finding.deviation), finding.number, finding.words)


def averages(check: Mapping[str, Any], columns: Mapping[str, Labelled], axes: list[str]) -> Finding:
    """Averages over the members at some positions, their bounds and order; decided by the last of
    them."""
    found = [float(average(columns, axes, check["variable"], (), at)) for at in check["at"]]
    wrong = [check["least"] - x for x in found if check["least"] is not None]
    wrong += [x - check["most"] for x in found if check["most"] is not None]
    steps = [b - a for a, b in itertools.pairwise(found)]
    wrong += {
        "falls": steps,
        "rises": [-x for x in steps],
        "equal": [abs(x) - check["within"] for x in steps],
    }.get(check["sense"], [])
    size = max(map(abs, found)) or 1.0
    words = f"{check['variable']} = {', '.join(f'{x:.4g}' for x in found)}"
    return Finding(beyond(max(wrong, default=0.0) / size, ROUNDING), found[-1], words)


def extents(check: Mapping[str, Any], columns: Mapping[str, Labelled], axes: list[str]) -> Finding:
    """How much averages vary along two axes; decided by the ratio, which should exceed 1."""
    along = [
        average(columns, axes, check["variable"], (check[name],), {})
        for name in ("larger", "smaller")
    ]
    larger, smaller = (float(np.nanmax(values) - np.nanmin(values)) for values in along)
    ratio = larger / smaller if smaller else math.inf
    words = (
        f"varies by {larger:.3g} along {check['larger']}, by {smaller:.3g} along {check['smaller']}"
    )
    return Finding(beyond(1 - ratio, 0.0), ratio, words)


SWEPT = {"members": averages, "axes": extents}
