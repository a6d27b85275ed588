"""Adaptive Taylor series through heyoka, which only this module and `taylor_batch` import."""

import math
import os
from contextlib import suppress
from functools import lru_cache
from threading import Lock
from typing import Any

import heyoka as hy
import numpy as np

from ..arithmetic import SYMBOLS
from ..machine import cache_folder
from ..models.base import Constants, Equations, count, flatten, namespace
from .polynomial import TAYLOR
from .protocol import NORM_BAND, PRECISION, Status, StepControl, Stretch

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

    def __init__(self, model: Equations, tol: float | None, precision: str) -> None:
        self.dtype = fp = DTYPES[precision]
        eps = PRECISION[precision]
        # heyoka's control is absolute below 1: a smaller tolerance keeps the digits of small
        # components, at no cost.
        self.tol = eps / 1024 if tol is None else max(tol, eps / 2**20)
        # The integrator keeps its state and parameters: it serves one stretch at a time.
        self.lock = Lock()
        y = [hy.expression(name) for name in model.state]
        k = namespace(model.structure, [hy.par[i] for i in range(count(model.structure))])
        rhs = model.rhs(hy.time, y, k)
        size = sum(map(len, rhs))
        self.ta = hy.taylor_adaptive(
            list(zip(y, rhs, strict=True)),
            np.zeros(len(y)).astype(fp),
            tol=fp(self.tol),
            fp_type=fp,
            # Unrolled code runs a little faster and takes minutes to compile for a large system.
            compact_mode=size > UNROLLED_NODES,
            opt_level=3 if size <= OPTIMISED_NODES else 0,
        )
        self.degree = self.ta.order

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
        ta, longest = self.ta, control.longest
        state, series, observe, last = ta.state, ta.tc, control.observer, grid[0]
        # heyoka counts parameters up to the last that the equations use.
        ta.pars[:] = list(map(self.dtype, flatten(k)))[: len(ta.pars)]
        # Only the first step of a motion is checked: a later one begins at the zero of a power of
        # the time by chance alone.
        is_first, is_blind = control.steps == 0, False

        def after_step(ta: Any) -> bool:
            """Call the observer; returns whether to go on."""
            nonlocal last, is_first, is_blind
            begin, now = last, ta.time
            if is_first and now - begin > BLIND_RATIO * self._visible_step():
                is_blind = True
                return False
            last, is_first = now, False
            if observe is not None and not observe(begin, now, series, state):
                return False
            return control.step(state) and not is_blind

        def through() -> tuple[Any, int, Any]:
            ta.state[:] = y
            ta.dtime = (grid[0], self.dtype(0))
            outcome, _, _, steps, *_, rows = ta.propagate_grid(
                grid, callback=after_step, max_delta_t=self.dtype(longest)
            )
            return outcome, steps, rows

        outcome, steps, rows = through()
        if is_blind:
            # After one short step the next ones begin away from the zero, so that their last two
            # coefficients suffice.
            longest, is_first = min(self._visible_step(), longest), False
            outcome, steps, rows = through()
        control.evaluations += steps * ta.order
        if outcome == hy.taylor_outcome.err_nf_state:
            control.give_up(Status.FAILED, "the state became infinite or not a number")
        return Stretch(rows, ta.dtime, state.copy())


def longdouble(values: np.ndarray) -> np.ndarray:
    """Quadruple values (...) as long doubles (...)."""
    # There is no direct conversion: the leading 53 bits are converted first, then the rest.
    high = values.astype(np.float64)
    return np.asarray(
        high.astype(np.longdouble) + (values - high.astype(DTYPES["quadruple"])).astype(np.float64)
    )


compiled = lru_cache(maxsize=64)(Taylor)
"""The compiled integrator for one model, its structure, tolerance and precision."""
