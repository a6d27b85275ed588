"""Adaptive Taylor series through heyoka; the only module that imports it."""

from collections.abc import Callable
from functools import lru_cache, partial
from types import SimpleNamespace
from typing import Any

import heyoka as hy
import numpy as np

from ..arithmetic import SYMBOLS
from ..models.base import Constants, Event, Model
from ..models.constants import Structure, attributes, count, flatten, namespace
from .polynomial import TAYLOR
from .protocol import NORM_BAND, PRECISION, Hit, Leg, Status, StepControl
from .stepwise import zero

# heyoka warns about its cache on stdout, where commands print their data.
hy.set_logger_level_error()

SYMBOLS[hy.expression] = hy

DTYPES: dict[str, Any] = {"double": np.float64, "extended": np.longdouble}
# A heyoka built without it does all else: so are those for macOS and Windows.
if hasattr(hy, "real128"):
    DTYPES["quadruple"] = hy.real128

UNROLLED = 150
"""The largest system that is unrolled, in nodes of its expressions: beyond, unrolling takes longer
than the steps of most motions."""

OPTIMISED = 10_000
"""The largest system that the compiler optimises. Beyond are averaged systems, which take tens of
steps."""


class Taylor:
    """One compiled integrator; the constants are its runtime parameters, so that it serves every
    case."""

    band = NORM_BAND
    basis = TAYLOR

    def __init__(
        self,
        model: type[Model],
        structure: Structure,
        events: tuple[Event, ...],
        tol: float | None,
        precision: str,
    ) -> None:
        self.dtype = fp = DTYPES[precision]
        eps = PRECISION[precision]
        # heyoka's control is absolute below 1: a margin keeps the digits of small components, at no
        # cost.
        self.tol = eps / 1024 if tol is None else max(tol, eps / 2**20)
        self.hits: list[Hit] = []
        y = [hy.expression(name) for name in model.state]
        k = namespace(structure, [hy.par[i] for i in range(count(structure))])
        rhs = model.rhs(hy.time, y, k)
        size = sum(map(len, rhs))
        functions = [event.function(hy.time, y, k) for event in events]
        self.terminal = {i: event for i, event in enumerate(events) if event.terminal}
        self.stops: list[Hit] = []
        self.ta = hy.taylor_adaptive(
            list(zip(y, rhs, strict=True)),
            np.zeros(len(y)).astype(fp),
            tol=fp(self.tol),
            pars=np.zeros(count(structure)).astype(fp),
            t_events=[
                hy.t_event(functions[i], callback=self._stopper(i), fp_type=fp)
                for i in self.terminal
            ],
            nt_events=[
                hy.nt_event(functions[i], self._recorder(i), fp_type=fp)
                for i in range(len(events))
                if i not in self.terminal
            ],
            fp_type=fp,
            # Unrolled code runs a little faster and takes minutes to compile for a large system.
            compact_mode=size > UNROLLED,
            opt_level=3 if size <= OPTIMISED else 0,
        )
        self.degree = self.ta.order

    def _recorder(self, event: int) -> Callable[[Any, Any, int], None]:
        def record(ta: Any, time: Any, direction: int) -> None:
            ta.update_d_output(time)
            self.hits.append(Hit(event, time, direction, ta.d_output.copy()))

        return record

    def _stopper(self, event: int) -> Callable[[Any, int], bool]:
        # The outcome of a propagation does not name the event where the step's own callback has
        # stopped it as well.
        def stop(ta: Any, direction: int) -> bool:
            self.stops.append(Hit(event, ta.time, direction, ta.state.copy()))
            return False

        return stop

    def _find_lost(self, k: SimpleNamespace, start: Any) -> bool:
        """Find the first terminal event that heyoka has lost in the step from `start`.

        Its search gives up on a zero in the first 1e-8 of a step, with a line in its log alone.
        """
        ta = self.ta

        def state_at(t: Any) -> np.ndarray:
            ta.update_d_output(t)
            return np.asarray(ta.d_output)

        for i, event in self.terminal.items():

            def value(t: Any, event: Event = event) -> Any:
                return event.function(t, [*state_at(t)], k)

            end = self.stops[-1].time if self.stops else ta.time
            if value(start) * value(end) < 0 and (time := zero(value, start, end)) < end:
                self.stops.append(Hit(i, time, 0, state_at(time).copy()))
        return bool(self.stops)

    def leg(self, k: Constants, y: np.ndarray, grid: np.ndarray, control: StepControl) -> Leg:
        """See `Engine.leg`."""
        ta, zero = self.ta, self.dtype(0)
        ta.pars[:] = np.array(flatten(k)).astype(self.dtype)
        ta.state[:] = y
        ta.dtime = (grid[0], zero)
        if ta.with_events:
            # A cooldown of the last leg would swallow an event at the start of this one.
            ta.reset_cooldowns()
        self.hits.clear()
        self.stops.clear()
        numbers = attributes(k, self.dtype)
        state, series, observe, last = ta.state, ta.tc, control.observer, grid[0]

        def after_step(ta: Any) -> bool:
            nonlocal last
            stopped = bool(self.terminal) and self._find_lost(numbers, last)
            if observe is not None:
                observe(last, self.stops[-1].time if stopped else ta.time, series)
            last = ta.time
            return control.step(state) and not stopped

        through = partial(
            ta.propagate_grid, grid, callback=after_step, max_delta_t=self.dtype(control.longest)
        )
        outcome, _, _, steps, *_, rows = through()
        if self.stops and self.stops[-1].time == grid[0]:
            # A motion that starts at a zero does not pass through it; the event's cooldown keeps it
            # from returning.
            self.stops.clear()
            outcome, _, _, steps, *_, rows = through()
        control.evaluations += steps * ta.order
        hit = self.stops[-1] if self.stops else None
        if hit is not None:
            rows = rows[: np.searchsorted(grid, hit.time, side="right")]
        elif outcome == hy.taylor_outcome.err_nf_state:
            control.give_up(Status.FAILED, "the state became infinite or not a number")
        # What vanishes at the start does not pass through zero there.
        end = ta.time if hit is None else hit.time
        hits = tuple(event for event in self.hits if grid[0] < event.time <= end)
        return Leg(rows, ta.dtime, state.copy(), hit, hits)


def longdouble(values: np.ndarray) -> np.ndarray:
    """Quadruple values as long doubles."""
    # There is no direct conversion: the leading 53 bits first, then what they leave.
    high = values.astype(np.float64)
    return np.asarray(
        high.astype(np.longdouble) + (values - high.astype(DTYPES["quadruple"])).astype(np.float64)
    )


@lru_cache(maxsize=64)
def compiled(
    model: type[Model],
    structure: Structure,
    events: tuple[Event, ...],
    tol: float | None,
    precision: str,
) -> Taylor:
    """The compiled integrator for one model, its structure, events, tolerance and precision."""
    return Taylor(model, structure, events, tol, precision)
