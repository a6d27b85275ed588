"""What a check found, and the verdict that it makes."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..cases.claim_block import CONTRADICTED, PLOTTING, REPRODUCED

PLOTTING_ACCURACY = 0.01
"""A violation, relative to a quantity's range, that a figure does not show."""

ROUNDING = 1e-12
"""A violation that the arithmetic makes."""


@dataclass(frozen=True)
class Finding:
    """What a check found: the deviation, the number that decides, and this in words."""

    deviation: float
    number: float
    words: str


@dataclass(frozen=True)
class Verdict:
    """A claim with its verdict, the number that decides it, and this in words."""

    claim: Mapping[str, Any]
    verdict: str
    number: float
    evidence: str


def degree(deviation: float) -> str:
    """The verdict on a single deviation."""
    return (
        REPRODUCED
        if deviation == 0
        else PLOTTING
        if deviation <= PLOTTING_ACCURACY
        else CONTRADICTED
    )


def beyond(violation: float, allowed: float) -> float:
    """The deviation that a violation makes; infinite for one that is not a number."""
    return 0.0 if violation <= allowed else math.inf if math.isnan(violation) else violation


def listed(values: Sequence[float]) -> str:
    """Numbers to six digits."""
    return ", ".join(f"{value:.6g}" for value in values)
