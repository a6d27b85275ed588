"""The kinds of figures, a function each, which draws an entry of a `figures:` block on a sheet;
`cases.figure_block` declares the keys that each takes."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ...results.dataset import Cases
from ...results.motion import Motion
from ..sheet import Sheet
from .body import body
from .costs import cost, error_order, share
from .maps import sweep_curve, sweep_map
from .plane import invariants, phase, quadrant_sketch, quadrants, time_series
from .space import axis_trace, herpolhode, hodograph, sphere

DRAW: dict[str, Callable[[Sheet, Mapping[str, Any], Sequence[Motion]], None]] = {
    "hodograph": hodograph,
    "sphere": sphere,
    "herpolhode": herpolhode,
    "axis-trace": axis_trace,
    "body": body,
    "quadrants": quadrants,
    "quadrant-sketch": quadrant_sketch,
    "series": time_series,
    "phase": phase,
    "invariants": invariants,
    "order": error_order,
    "cost": cost,
}
"""The kinds of figures of motions."""

DRAW_SWEEPS: dict[str, Callable[[Sheet, Mapping[str, Any], Cases], None]] = {
    "map": sweep_map,
    "curve": sweep_curve,
    "share": share,
}
"""The kinds of figures of sweeps."""
