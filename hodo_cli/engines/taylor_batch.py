"""Many motions at once: one Taylor step of a model, compiled, for arrays of them.

The coefficients come from the model's own equations, on truncated power series of heyoka's symbols.
The motions do not influence each other, bit for bit: what stands beside a motion, and how an
ensemble is cut into parts, does not change it.
"""

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache, reduce
from typing import Any

import heyoka as hy
import numpy as np

from ..models.base import Event, Model
from ..models.constants import Structure, count, namespace
from .series import TINY, Series, motion, value
from .taylor import OPTIMISED

WIDTH = hy.recommended_simd_size()
"""Motions in one register of this processor, which holds no more with what a step needs: for
linear-diag a step of a motion took 37 ns at 8, 62 at 4 and 55 at 16 with AVX-512, and 64 at 4, 96
at 8 and 121 at 2 with AVX2."""


class Symbols(Series):
    """A power series whose coefficients are expressions of heyoka."""

    log = staticmethod(hy.log)


class TaylorStep:
    """One step of a model, as a function of columns that are one motion each.

    Rows of the input: the state, and the time left. Rows of the output: the state after the step,
    the time left then, the length of the step, and for an event a lower bound on how far its
    function stays from 0 within the step: where it is negative, there may be zeros.
    """

    def __init__(
        self, model: type[Model], structure: Structure, event: Event | None, tol: float | None
    ) -> None:
        self.tol = 2.0**-52 if tol is None else max(tol, 2.0**-62)
        # The order that reaches a tolerance at least cost: Jorba and Zou 2005, section 3.2.
        self.order = math.ceil(1 - math.log(self.tol) / 2)
        start = hy.make_vars(*(f"y{i}" for i in range(len(model.state))))
        left = hy.expression("left")
        # The first parameter is the time of the end, from which the time left is counted.
        end, *numbers = (hy.par[i] for i in range(count(structure) + 1))
        k = namespace(structure, numbers)
        time, state = motion(model.rhs, end - left, start, k, Symbols)
        y = [self.coefficients(series) for series in state]
        step = smaller(step_size(y), left)
        # The last step takes exactly the time left, so that it leaves 0 and no rounding.
        rows = [*(value(c, step) for c in y), left - step, step]
        self._inputs, self._event_series = [*start, left], list[Any]()
        if event is not None:
            self._event_series = self.coefficients(event.function(time, state, k))
            rows.append(clearance(self._event_series, step))
        self.rows = len(rows)
        large = sum(map(len, model.rhs(end - left, start, k))) > OPTIMISED
        self._step = self._compiled(rows, 1 if large else 3)

    def coefficients(self, series: Series) -> list[Any]:
        """Those of a series up to the order of the step."""
        return [series[i] for i in range(self.order + 1)]

    def _compiled(self, rows: list[Any], opt_level: int) -> Any:
        # fast_math lets the compiler contract and reorder sums: a tenth faster, and the same for
        # every motion.
        return hy.cfunc(
            rows, vars=self._inputs, batch_size=WIDTH, fast_math=True, opt_level=opt_level
        )

    def __call__(self, columns: np.ndarray, k: np.ndarray, out: np.ndarray) -> None:
        """Step columns (m + 1, n) with the end's time and the constants k (c + 1, n) to `out`.

        n must be a multiple of WIDTH: what remains would go through other machine code, of other
        rounding. One thread only: the chunks of a sweep are what runs in parallel.
        """
        k = k[: self._step.nparams]  # the last constants may not occur in the equations
        self._step(columns, pars=k, outputs=out, batch_parallel=False)

    @cached_property
    def _event(self) -> Any:
        # Few steps need it, so that it is not worth the optimiser's time.
        return self._compiled(self._event_series, 1)

    def event_series(self, columns: np.ndarray, k: np.ndarray) -> np.ndarray:
        """The coefficients (order + 1, n) of the event's function in powers of the time from the
        columns' own, for arguments as of a step."""
        k = k[: self._event.nparams]
        return np.asarray(self._event(columns, pars=k, batch_parallel=False))


def step_size(y: Sequence[Sequence[Any]]) -> Any:
    """The step that keeps the error of a series below the tolerance: heyoka's rule.

    With R_k = (max(1, |y|) / |y_k|)^(1/k) from the last two coefficients, by whose logarithms the
    rule is written here with one root in place of two: R_n < R_{n-1} where (R_n^n/R_{n-1}^{n-1})^n
    < R_n^n.

    Source: A. Jorba and M. Zou, Experimental Mathematics 14 (2005) 99, section 3.2; F. Biscani and
    D. Izzo, Monthly Notices of the RAS 504 (2021) 2614.
    """
    n = len(y[0]) - 1
    size, last, before = (reduce(larger, [absolute(c[i]) for c in y]) for i in (0, n, n - 1))
    # A steady rotation has coefficients of 0, and a fast compiler may assume that nothing is
    # infinite.
    size, last, before = larger(size, hy.expression(1.0)), last + TINY, before + TINY
    by_last = hy.lt(power(before / last, n) * last, size)
    coefficient = hy.select(by_last, last, before)
    root = hy.select(by_last, hy.expression(1 / n), hy.expression(1 / (n - 1)))
    return hy.exp(root * hy.log(size / coefficient)) * math.exp(-2 - 0.7 / (n - 1))


def clearance(D: Sequence[Any], step: Any) -> Any:
    """A lower bound on |D(s)| for s from 0 to `step`; negative where it shows nothing.

    |D| is at least |D_0| + min(0, s sign(D_0) D_1), less the sum of |D_k| s^k from k = 2.
    """
    towards_0 = hy.select(hy.lt(D[0], 0.0), -D[1], D[1])
    rest = step * value([absolute(c) for c in D[2:]], step)
    return absolute(D[0]) + step * (smaller(towards_0, hy.expression(0.0)) - rest)


def larger(a: Any, b: Any) -> Any:
    """The larger of two expressions."""
    return hy.select(hy.gt(a, b), a, b)


def smaller(a: Any, b: Any) -> Any:
    """The smaller of two expressions."""
    return hy.select(hy.lt(a, b), a, b)


def absolute(x: Any) -> Any:
    """|x| of an expression."""
    return hy.select(hy.lt(x, 0.0), -x, x)


def power(x: Any, n: int) -> Any:
    """x^n by squaring: heyoka's own power goes through a logarithm."""
    if n == 1:
        return x
    return power(x * x, n // 2) * (x if n % 2 else 1.0)


@lru_cache(maxsize=16)
def build(
    model: type[Model], structure: Structure, event: Event | None, tol: float | None
) -> TaylorStep:
    """The compiled step for one model, its structure, event and tolerance."""
    return TaylorStep(model, structure, event, tol)
