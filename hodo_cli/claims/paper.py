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

CHECKS: dict[str, Check] = {}
TRENDS: dict[str, Trend] = {}


def check(function: Check) -> Check:
    """Register a check of one set of motions."""
    CHECKS[function.__name__.replace("_", "-")] = function
    return function


def trend(function: Trend) -> Trend:
    """Register a check of all members of a sweep together."""
    TRENDS[function.__name__.replace("_", "-")] = function
    return function
