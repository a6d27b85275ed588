"""The checks that are written for one paper, by name: what `check: {kind: paper, name: ...}` finds.

A function's name, with hyphens, is the check's; its docstring says what it checks.
"""

from collections.abc import Callable, Sequence

from ..results.motion import Motion
from .finding import Finding

Check = Callable[[Sequence[Motion]], Finding]
"""From the motions of a claim's cases, in order, or of one member of its `over:`."""

Trend = Callable[[Sequence[Sequence[Motion]]], Finding]
"""From the motions of all members of `over:` at once."""

PAPER_CHECKS: dict[str, Check] = {}
PAPER_TRENDS: dict[str, Trend] = {}


def check(function: Check) -> Check:
    """Register a check of one set of motions."""
    PAPER_CHECKS[function.__name__.replace("_", "-")] = function
    return function


def trend(function: Trend) -> Trend:
    """Register a check of all members of a sweep together."""
    PAPER_TRENDS[function.__name__.replace("_", "-")] = function
    return function


def in_pairs(motions: Sequence[Motion]) -> list[tuple[Motion, Motion]]:
    """Motions two by two, where a check compares the cases of a claim in pairs."""
    return [*zip(motions[::2], motions[1::2], strict=True)]
