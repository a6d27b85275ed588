"""Adaptive Taylor series through heyoka, which only this module and `taylor_batch` import."""

import math
import os
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from threading import Lock
from types import SimpleNamespace
from typing import Any

import heyoka as hy
import numpy as np

from ..arithmetic import SYMBOLS
from ..machine import cache_folder
from ..models.base import (
    Constants,
    Equations,
    Event,
    attributes,
    count,
    flatten,
    namespace,
)
from .polynomial import TAYLOR
from .protocol import NORM_BAND, PRECISION, EventRoot, Status, StepControl, Stretch
from .stepwise import zero

# heyoka warns about its cache on stdout, where commands print their data.
hy.set_logger_level_error()

CODE_LIMIT = 128 << 20
"""The most bytes of compiled code that heyoka keeps on the disk; the papers' cases take 8 MB. Its
own limit is 20 GB, and it reads all of them before its first compilation in a process, which takes
0.2 s a GB."""

if "HEYOKA_CACHE_DIR" not in os.environ:
    # Where the user's folder cannot be made, or is not private, heyoka keeps its own.
    with suppress(OSError, RuntimeError, ValueError):
        hy.llvm_state.set_diskcache_path(cache_folder() / "heyoka")
        hy.llvm_state.set_diskcache_limit(CODE_LIMIT)

SYMBOLS[hy.expression] = hy

DTYPES: dict[str, Any] = {"double": np.float64, "extended": np.longdouble}
# heyoka can be built without real128, as for macOS and Windows; all else works.
if hasattr(hy, "real128"):
    DTYPES["quadruple"] = hy.real128

UNROLLED_NODES = 150
"""The largest system whose code is unrolled, in nodes of its expressions. For larger ones unrolling
takes longer than the steps of most motions."""

OPTIMISED_NODES = 10_000
"""The largest system that the compiler optimises, in nodes. Only averaged tops are larger, and they
take tens of steps."""

BLIND_RATIO = 1.35
"""The largest ratio of a step to the length by the rule from all its later coefficients. At this
ratio its error is 400 times the tolerance of a step, which is less than rounding."""


class Taylor:
    """One compiled integrator. The constants are its runtime parameters, so that it serves all
    cases of one structure."""

    band = NORM_BAND
    basis = TAYLOR

    def __init__(
        self,
        model: Equations,
        events: tuple[Event, ...],
        tol: float | None,
        precision: str,
    ) -> None:
        self.dtype = fp = DTYPES[precision]
        eps = PRECISION[precision]
        # heyoka's control is absolute below 1: a smaller tolerance keeps the digits of small
        # components, at no cost.
        self.tol = eps / 1024 if tol is None else max(tol, eps / 2**20)
        self.roots: list[EventRoot] = []
        # The integrator keeps its state, parameters and roots: it serves one stretch at a time.
        self.lock = Lock()
        y = [hy.expression(name) for name in model.state]
        k = namespace(model.structure, [hy.par[i] for i in range(count(model.structure))])
        rhs = model.rhs(hy.time, y, k)
        size = sum(map(len, rhs))
        functions = [event.function(hy.time, y, k) for event in events]
        self.events = events
        self.ta = hy.taylor_adaptive(
            list(zip(y, rhs, strict=True)),
            np.zeros(len(y)).astype(fp),
            tol=fp(self.tol),
            t_events=[
                hy.t_event(
                    functions[i],
                    callback=self._stopper(i),
                    fp_type=fp,
                )
                for i, event in enumerate(events)
                if event.terminal
            ],
            nt_events=[
                hy.nt_event(functions[i], self._recorder(i), fp_type=fp)
                for i, event in enumerate(events)
                if not event.terminal
            ],
            fp_type=fp,
            # Unrolled code runs a little faster and takes minutes to compile for a large system.
            compact_mode=size > UNROLLED_NODES,
            opt_level=3 if size <= OPTIMISED_NODES else 0,
        )
        self.degree = self.ta.order

    # heyoka copies its callbacks, and would copy a bound method together with its object.
    def _recorder(self, event: int) -> Callable[[Any, Any, int], None]:
        return lambda ta, time, direction: self._record(event, time)

    def _record(self, event: int, time: Any) -> None:
        self.ta.update_d_output(time)
        self.roots.append(EventRoot(event, time, self.ta.d_output.copy()))

    def _stopper(self, event: int) -> Callable[[Any, int], bool]:
        # The outcome of a propagation does not name the event if the callback of the step has
        # stopped it too.
        def stop(ta: Any, direction: int) -> bool:
            self.roots.append(EventRoot(event, ta.time, ta.state.copy()))
            return False

        return stop

    def _values(self, t: Any, y: np.ndarray, k: SimpleNamespace) -> list[Any]:
        return [event.function(t, [*y], k) for event in self.events]

    def _record_lost(
        self, k: SimpleNamespace, start: Any, before: list[Any], after: list[Any]
    ) -> None:
        """Record the events that heyoka has lost in a step, found by the signs of their values
        before and after it.

        Its search gives up on a zero in the first 1e-8 of a step, and reports that in its log only.
        """
        ta = self.ta
        recorded = {root.event for root in self.roots if root.time > start}
        for i, (first, last) in enumerate(zip(before, after, strict=True)):
            if first * last < 0 and i not in recorded:

                def value(t: Any, event: Event = self.events[i]) -> Any:
                    ta.update_d_output(t)
                    return event.function(t, [*ta.d_output], k)

                self._record(i, zero(value, start, ta.time))

    @property
    def _first_stop(self) -> EventRoot | None:
        stops = [root for root in self.roots if self.events[root.event].terminal]
        return min(stops, key=lambda root: root.time, default=None)

    def _begin(self, k: Constants, y: np.ndarray, time: Any) -> None:
        """Put the integrator at the start of a stretch."""
        ta, self.numbers = self.ta, attributes(k, self.dtype)
        # heyoka counts parameters up to the last that the equations use.
        ta.pars[:] = flatten(vars(self.numbers))[: len(ta.pars)]
        ta.state[:] = y
        ta.dtime = (time, self.dtype(0))
        if ta.with_events:
            # After an event heyoka ignores it for a while, and would so miss one at the start of
            # this stretch.
            ta.reset_cooldowns()
        self.roots.clear()

    def _visible_step(self) -> float:
        """The length of the last step by heyoka's rule, from all coefficients of the later half
        instead of the last two.

        Under a torque that is a power of the time, the last two coefficients of a series from t = 0
        may be 0 or small, as in a series in powers of t**3.
        """
        # In the engine's precision: its coefficients may be beyond the range of doubles.
        size, first = np.abs(self.ta.tc).max(axis=0), self.degree // 2
        norm = max(size[0], self.dtype(1))
        later = enumerate(size[first:], first)
        radii = [(norm / c) ** self.dtype(1 / order) for order, c in later if c]
        return float(min(radii, default=self.dtype(math.inf))) * math.exp(-2)

    def integrate(
        self, k: Constants, y: np.ndarray, grid: np.ndarray, control: StepControl
    ) -> Stretch:
        """See `Engine.integrate`."""
        with self.lock:
            return self._integrate(k, y, grid, control)

    def _integrate(
        self, k: Constants, y: np.ndarray, grid: np.ndarray, control: StepControl
    ) -> Stretch:
        ta = self.ta
        self._begin(k, y, grid[0])
        state, series, observe, last = ta.state, ta.tc, control.observer, grid[0]
        values, is_blind = self._values(last, state, self.numbers), False
        # Only the first step of a motion is checked: a later one begins at the zero of a power of
        # the time by chance alone.
        is_first = control.steps == 0

        def after_step(ta: Any) -> bool:
            """Record events that heyoka has lost, and call the observer; returns whether to go
            on."""
            nonlocal last, values, is_first, is_blind
            now = ta.time
            if is_first and now - last > BLIND_RATIO * self._visible_step():
                is_blind = True
                return False
            is_first, stop = False, None
            if self.events:
                before, values = values, self._values(now, state, self.numbers)
                self._record_lost(self.numbers, last, before, values)
                stop = self._first_stop
            if observe is not None:
                observe(last, now if stop is None else stop.time, series)
            last = now
            return control.step(state) and stop is None and not is_blind

        longest = control.longest

        def through() -> tuple[Any, int, Any]:
            outcome, _, _, steps, *_, rows = ta.propagate_grid(
                grid, callback=after_step, max_delta_t=self.dtype(longest)
            )
            return outcome, steps, rows

        outcome, steps, rows = through()
        if is_blind:
            # After a short first step the next ones begin away from the zero, so that their last
            # two coefficients suffice.
            longest, is_first = min(self._visible_step(), longest), False
            self._begin(k, y, grid[0])
            outcome, steps, rows = through()
        if (stop := self._first_stop) is not None and stop.time == grid[0]:
            # A motion that starts at a zero does not pass through it. heyoka ignores the event for
            # a while after it, so it does not stop the motion again.
            self.roots.clear()
            outcome, steps, rows = through()
            stop = self._first_stop
        control.evaluations += steps * ta.order
        end = ta.time if stop is None else stop.time
        if stop is not None:
            rows = rows[: np.searchsorted(grid, end, side="right")]
        elif outcome == hy.taylor_outcome.err_nf_state:
            control.give_up(Status.FAILED, "the state became infinite or not a number")
        # A function that vanishes at the start does not pass through zero there.
        others = [root for root in self.roots if not self.events[root.event].terminal]
        passed = tuple(root for root in others if grid[0] < root.time <= end)
        return Stretch(rows, ta.dtime, state.copy(), stop, passed)


def longdouble(values: np.ndarray) -> np.ndarray:
    """Quadruple values (...) as long doubles (...)."""
    # There is no direct conversion: the leading 53 bits are converted first, then the rest.
    high = values.astype(np.float64)
    return np.asarray(
        high.astype(np.longdouble) + (values - high.astype(DTYPES["quadruple"])).astype(np.float64)
    )


compiled = lru_cache(maxsize=64)(Taylor)
"""The compiled integrator for one model, its structure, events, tolerance and precision."""
