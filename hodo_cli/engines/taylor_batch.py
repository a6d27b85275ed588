"""Many motions at once: one Taylor step of a model, compiled for arrays of motions.

The coefficients come from the model's own `rhs`, called with truncated power series of heyoka's
symbols. The motions do not influence each other: no bit of a motion depends on the other motions of
an array, or on how an ensemble is cut into parts.
"""

import hashlib
import math
import pickle
from collections.abc import Callable, Sequence
from functools import lru_cache, partial, reduce
from pathlib import Path
from time import thread_time
from typing import Any, NamedTuple

import heyoka as hy
import numpy as np

from .. import arithmetic
from ..arithmetic import horner
from ..machine import cached_code, processor
from ..models.base import (
    UNIT,
    Equations,
    Event,
    count,
    kinds_of_variables,
    namespace,
)
from . import series as series_module
from .series import TINY_DIVISOR, Series, constant, motion, total
from .taylor import BLIND_RATIO, OPTIMISED_NODES


def has_avx512() -> bool:
    """Whether this processor has registers of 512 bits, by what numpy finds: heyoka recommends 4
    numbers even on some processors that have them."""
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    return any(name.startswith("AVX512") or name == "X86_V4" for name in found)


WIDTH = 8 if has_avx512() else hy.recommended_simd_size()
"""The number of motions in one register of this processor. More motions would leave no room for the
other numbers of a step: for linear-diag a step of a motion took 33 ns at 8, 46 at 4 and 55 at 16
with AVX-512, and 64 at 4, 96 at 8 and 121 at 2 with AVX2. The width changes no bit of a result."""


SERIES_ORDER = 20
"""The order of every step, which heyoka takes too when the tolerance is the rounding of a double.
At 1e-12 heyoka takes 15, which needs the fewest operations for the coefficients; with the other
costs of a step, 18 to 20 are cheapest there."""

ROOT_ORDER = 16
"""The order of the coefficients that determine the length of a step. A root of this order is four
square roots; a logarithm and an exponential instead took a third of a step."""

LATER_ORDER = 10
"""The lowest order of the coefficients that are compared with the radius if equations contain the
time. The coefficients that determine the radius may then be 0 or small by chance, as in a series in
powers of t**3. Half of the coefficients compared are of orders below 16, so that the eighth root of
an excess corrects the radius enough."""

MOST_EXCESS = 2.0**32
"""The excess above which a motion is integrated as a single case, because its steps would be far
too short."""

PASSAGE_STRIDE = 0.1
"""The longest step, in radii of convergence, of a motion that continues after an event. Such a
motion approaches a logarithmic singularity, which fewer coefficients show, and no step may pass it:
at 0.135 two of five did."""

EVENT_ORDER = 6
"""The order up to which the series of an event is computed; bounds from the state's series cover
its later terms. At order 20 the event took a third of a step; at 4 five times as many steps would
be candidates for a zero."""

SUM_CHAINS = 4
"""The parts of a polynomial that are summed in parallel. In a single sum the processor waits for
each product, which took a third of a step."""

PLACES_CHECKED, MOST_MISSED = 8, 8
"""The number of places of a step, evenly spaced, at which its series are compared with a user's
formulas; and the largest error allowed there, as a power of the `stride`. It is far above the
rounding and the truncation of the series; at the tolerance of rounding it is 1e-8 of the motion, as
for single cases."""

BOUND_ROUNDING = 2.0**-40
"""The relative margin that covers rounding in the bound on the later terms of an event's series."""


class Majorant(Series):
    """A series whose coefficients are at least as large as the absolute values of the coefficients
    of another series.

    Raises NotImplementedError for a function or a power of a series, or a division by one.
    """

    def __neg__(self) -> "Majorant":
        return self

    def __add__(self, other: Any) -> Series:
        return super().__add__(absolute(other))

    __radd__ = __sub__ = __rsub__ = __add__

    def __mul__(self, other: Any) -> Series:
        return super().__mul__(absolute(other))

    __rmul__ = __mul__

    def _without_majorant(self, *_: Any) -> Series:
        raise NotImplementedError

    __rtruediv__ = __pow__ = __rpow__ = _without_majorant
    exp = log = sqrt = tanh = sin = cos = _without_majorant

    def __truediv__(self, other: Any) -> Series:
        if isinstance(other, Series):
            raise NotImplementedError
        return super().__truediv__(other)


class TaylorStep:
    """One step of a model, as a function of columns, each of which is a motion.

    Rows of the input: the state, the time left, the rounding error of that time, and the number of
    steps taken. Rows of the output: the same after the step, the length of the step, and for each
    event a number that is negative where its function may have zeros within the step. This number
    is a lower bound on the function's distance from 0. For a crossing of the separatrix, in a model
    whose motions cross it once at most, it is the product of the function's values at both ends.
    """

    def __init__(self, model: Equations, events: tuple[Event, ...]) -> None:
        self.model, self.structure = model, model.structure
        self.events = events
        self._key, self._series = self._digest(), dict[int, Any]()
        self._step = cached_code(f"{self._key}-step", self._compiled_step)
        self.rows: int = self._step.nouts

    def __call__(self, columns: np.ndarray, k: np.ndarray, out: np.ndarray) -> None:
        """Write columns (m + 3, n) after a step to `out` (rows, n). The parameters k (c + 2, n) are
        the time of the end, the constants, and the `stride`.

        n must be a multiple of WIDTH: the remaining columns would go through other machine code,
        with other rounding. It runs in one thread, because the chunks of a sweep run in parallel.
        """
        self._step(columns, pars=k, outputs=out, batch_parallel=False)

    def event_series(self, event: Event, columns: np.ndarray, k: np.ndarray) -> np.ndarray:
        """The coefficients (order + 1, n) of an event's function in powers of the time since the
        start of the step. The arguments are as for a step."""
        # By its function, because the caller's event may be terminal, and no event of a step is.
        index = [own.function for own in self.events].index(event.function)
        if index not in self._series:
            compiled_series = partial(self._compiled_series, self.events[index])
            self._series[index] = cached_code(f"{self._key}-event{index}", compiled_series)
        series = self._series[index]
        pars = k[: series.nparams]  # the series does not contain the last parameters
        return np.asarray(series(columns, pars=pars, batch_parallel=False))

    def _digest(self) -> str:
        """A digest of all that the compiled code depends on: the equations, the sources of hodo
        that make a step of them, the compiler and the processor."""
        t, y, k = self._symbols()
        functions = [event.function for event in self.events]
        # Pickled, because the text of a long expression is cut.
        equations = pickle.dumps([*self.model.rhs(t, y, k), *(of(t, y, k) for of in functions)])
        kinds = [event.passage is None for event in self.events]
        model = self.structure, kinds, self.model.always_absorbing, self.model.has_formulas
        compiler = WIDTH, hy.__version__, processor(), STEP_SOURCES
        return hashlib.sha256(equations + repr((model, *compiler)).encode()).hexdigest()[:32]

    def _symbols(self) -> tuple[Any, list[Any], Any]:
        """Symbols for the time left, the state and the constants of the equations."""
        # The first parameter is the time of the end, the last one the stride.
        _, *numbers, _ = (hy.par[i] for i in range(count(self.structure) + 2))
        y = [hy.make_vars(f"y{i}") for i in range(len(self.model.state))]
        return hy.make_vars("remaining"), y, namespace(self.structure, numbers)

    def _motion(self) -> "SymbolicMotion":
        """The motion of a step in symbols, as series from its start."""
        remaining, y, k = self._symbols()
        lost, steps = hy.make_vars("lost", "steps")
        # The start is the time of the end, in the case's own unit, less the time left, which is in
        # a unit that fits the motion.
        unit = getattr(k, UNIT, 1.0)
        begin = (hy.par[0] - remaining * unit) - lost * unit
        time, state = motion(self.model.rhs, begin, y, k, unit)
        return SymbolicMotion([*y, remaining, lost, steps], time, state, k)

    def _compiled_step(self) -> Any:
        """The compiled function from the rows of the input to the rows of the output."""
        at = self._motion()
        *_, remaining, lost, steps = at.inputs
        y = [coefficients(series, SERIES_ORDER) for series in at.state]
        # The last parameter is the `stride`, so that the code serves every tolerance.
        R, excessive = radius(y), hy.expression(1.0)
        if hasattr(at.k, UNIT):
            # With the time in the equations, the coefficients in `radius` may be small by chance.
            # Without it they are so only near rest.
            excessive = excess(y, R)
            R = R / hy.sqrt(hy.sqrt(hy.sqrt(excessive)))
        longest = hy.par[count(self.structure) + 1] * R
        step = smaller(longest, remaining)
        # The last step takes exactly the time left, so that 0 is left and no rounding error.
        after = remaining - step
        # Keep the rounding error of the subtraction: the time loses no digits in many steps.
        lost = lost + ((remaining - after) - step)
        steps = steps + hy.select(hy.gt(remaining, 0.0), hy.expression(1.0), hy.expression(0.0))
        after = hy.select(hy.gt(excessive, MOST_EXCESS), hy.expression(math.nan), after)
        # Large equations, as of averaged tops, take too long to optimise, and are not checked.
        is_large = sum(map(len, self.model.rhs(*self._symbols()))) > OPTIMISED_NODES
        if self.model.has_formulas and not is_large:
            is_met = hy.lte(self._missed(at, y, step), 0.0)
            after = hy.select(is_met, after, hy.expression(math.nan))
        end = [total_of_powers(c, step) for c in y]
        events = (self._event_row(event, at, end, step) for event in self.events)
        rows = [*end, after, lost, steps, step, *events]
        return compiled_function(at.inputs, rows, 1 if is_large else 3)

    def _missed(self, at: "SymbolicMotion", y: Sequence[Sequence[Any]], step: Any) -> Any:
        """The largest error of the series y in the equations within a step, less the error allowed.
        Without this check a series passes over a corner of a formula unnoticed."""
        slopes = [[i * c for i, c in enumerate(series)][1:] for series in y]
        part = hy.par[count(self.structure) + 1] ** MOST_MISSED
        excess = hy.expression(-math.inf)
        for place in range(1, PLACES_CHECKED + 1):
            s = step * (place / PLACES_CHECKED)
            state, rates_by_series = ([total_of_powers(c, s) for c in of] for of in (y, slopes))
            rates = self.model.rhs(at.time[0] + s * at.time[1], state, at.k)
            for rows in kinds_of_variables(self.model):
                size = total([absolute(y[i][0]) + step * absolute(y[i][1]) for i in rows])
                off = total([absolute(rates_by_series[i] - rates[i]) for i in rows])
                excess = larger(off * step - part * size, excess)
        return excess

    def _event_row(self, event: Event, at: "SymbolicMotion", end: list[Any], step: Any) -> Any:
        """The row of an event in the output of a step that ends in the state `end`."""
        if event.passage or not self.model.always_absorbing:
            return least_distance(event.function, at, step)
        # Of a motion that crosses once at most, the signs at both ends of a step decide.
        begin, unit = at.time[0], at.time[1]
        before = event.function(begin, [series[0] for series in at.state], at.k)
        return before * event.function(begin + step * unit, end, at.k)

    def _compiled_series(self, event: Event) -> Any:
        """The compiled function from the rows of the input to the series of an event."""
        at = self._motion()
        rows = coefficients(event.function(at.time, at.state, at.k), SERIES_ORDER)
        # Few steps need the series, so it is not worth the optimiser's time.
        return compiled_function(at.inputs, rows, 1)


STEP_SOURCES = [
    Path(str(module)).read_text("utf-8")
    for module in (__file__, series_module.__file__, arithmetic.__file__)
]
"""The sources of the modules that make a step of equations."""


class SymbolicMotion(NamedTuple):
    """The motion of a step in symbols: the inputs of the step, the time and the state as series
    from its start, and the constants."""

    inputs: list[Any]
    time: Series
    state: list[Series]
    k: Any


def compiled_function(inputs: list[Any], rows: list[Any], opt_level: int) -> Any:
    """A compiled function from the inputs to the rows."""
    # Without fast_math: it would change the order of sums, and remove the rounding errors that a
    # step keeps, because these are 0 in exact arithmetic.
    return hy.cfunc(rows, vars=inputs, batch_size=WIDTH, opt_level=opt_level)


ALIGNMENT_DEPTHS, ALIGNMENT_TRIALS = 4, 8
"""The number of depths of a call, which give the stack its different alignments; and the number of
first steps, which try each depth twice."""


class AlignedCalls:
    """Calls of one step, from the depth of the stack at which it is fastest.

    A step keeps on the stack the numbers for which its registers have no room. The code that heyoka
    compiles takes the stack as it comes, aligned to 16 bytes. In three of four cases each store of
    64 bytes then touches two lines of the cache, and a step takes 1.25 times as long (tensor: 49 ns
    instead of 39). The stack begins at a random place in each process. A call through `map` moves
    it by a multiple of 64 bytes plus or minus 16, so that one of four depths is right; the first
    steps are timed to find it. (A call of a method moves it by twice as much, which reaches two of
    the four alignments.)
    """

    def __init__(self, step: TaylorStep) -> None:
        self.step, self.calls = step, 0
        self.seconds = [math.inf] * ALIGNMENT_DEPTHS

    def __call__(self, columns: np.ndarray, k: np.ndarray, out: np.ndarray) -> None:
        """See `TaylorStep`."""
        if self.calls == ALIGNMENT_TRIALS:
            nested(self.seconds.index(min(self.seconds)), self.step, columns, k, out)
            return
        depth, began = self.calls % ALIGNMENT_DEPTHS, thread_time()
        nested(depth, self.step, columns, k, out)
        self.seconds[depth] = min(self.seconds[depth], (thread_time() - began) / out.shape[1])
        self.calls += 1


def nested(depth: int, step: TaylorStep, *arguments: np.ndarray) -> None:
    """Take a step through `depth` nested calls of `map`."""
    if depth:
        next(map(nested, (depth - 1,), (step,), *((argument,) for argument in arguments)))
    else:
        step(*arguments)


def stride(tol: float, passage_event: Event | None, tol_factor: float = 1.0) -> float:
    """The longest step, in radii of convergence (`radius`), with an error of `tol_factor`
    tolerances. Motions that continue after an event with a passage take shorter steps. A larger
    `tol_factor` shortens these further, so that a second integration has other steps."""
    longest = math.exp((math.log(max(tol_factor * tol, 2.0**-62)) - 0.7) / (SERIES_ORDER - 3))
    return longest if passage_event is None else min(longest, PASSAGE_STRIDE / tol_factor**0.05)


def coefficients(series: Series, order: int) -> list[Any]:
    """The coefficients of a series up to an order."""
    return [series[i] for i in range(order + 1)]


def total_of_powers(c: Sequence[Any], s: Any) -> Any:
    """The sum c[0] + c[1] s + c[2] s^2 + ..., of more than SUM_CHAINS terms."""
    chains = [horner(c[1 + i :: SUM_CHAINS], (s * s) * (s * s)) for i in range(SUM_CHAINS)]
    # The largest term is added last, so that all roundings but one are relative to the change in a
    # step.
    return c[0] + s * horner(chains, s)


def radius(y: Sequence[Sequence[Any]]) -> Any:
    """The radius of convergence R of a state's series: (max(1, |y|) / |y_k|)^(1/k), where k is
    ROOT_ORDER and y_k the coefficient of order k.

    In a series of odd powers this coefficient is 0, and the geometric mean of its neighbours
    replaces it. heyoka's rule, for any order n, is a step h = R tol^(1/(n - 1)) times the safety
    factor exp(-0.7/(n - 1)), which keeps the error below the tolerance. Here R comes from fewer
    than n coefficients, and n - 3 replaces n - 1: with n - 1, times of late crossings were off by
    up to 24 times the error that their members state.

    Source: A. Jorba and M. Zou, Experimental Mathematics 14 (2005) 99, section 3.2, where n is
    chosen such that tol^(1/(n - 1)) is 1/e^2; F. Biscani and D. Izzo, Monthly Notices of the RAS
    504 (2021) 2614.
    """
    norm, lower, highest, higher = (
        largest_size(y, i) for i in (0, ROOT_ORDER - 1, ROOT_ORDER, ROOT_ORDER + 1)
    )
    # TINY_DIVISOR is for a steady rotation, whose coefficients are 0. ROOT_ORDER is a power of 2,
    # so that its root is a sequence of square roots: heyoka's symbols have no other root.
    coefficient = larger(highest, hy.sqrt(lower * higher)) + TINY_DIVISOR
    power = larger(norm, hy.expression(1.0)) / coefficient
    return reduce(lambda x, _: hy.sqrt(x), range(int(math.log2(ROOT_ORDER))), power)


def excess(y: Sequence[Sequence[Any]], R: Any) -> Any:
    """The largest coefficient of a state's series, from LATER_ORDER on, relative to the size that
    it should have by the radius of convergence R/BLIND_RATIO; at least 1."""
    x = smaller(R, hy.expression(2.0**40)) / BLIND_RATIO
    norm, power = larger(largest_size(y, 0), hy.expression(1.0)), x**LATER_ORDER
    most = norm
    for order in range(LATER_ORDER, SERIES_ORDER + 1):
        most, power = larger(most, largest_size(y, order) * power), power * x
    return most / norm


def largest_size(y: Sequence[Sequence[Any]], order: int) -> Any:
    """The largest absolute value of a state's coefficients of an order."""
    return reduce(larger, [absolute(c[order]) for c in y])


def least_distance(function: Callable[..., Any], at: SymbolicMotion, step: Any) -> Any:
    """A lower bound on |D(s)| for s from 0 to `step`, where D is a function of a motion. Where the
    bound is negative D may vanish.

    With D_k the coefficients of D, |D| is at least |D_0| + min(0, s sign(D_0) D_1), less the sum of
    |D_k| s^k from k = 2. A bound on the terms beyond EVENT_ORDER is the same function of majorants,
    less its terms up to that order.
    """
    order = EVENT_ORDER
    try:
        rest = majorant_beyond(order, function, at, step)
    except NotImplementedError:
        order, rest = SERIES_ORDER, hy.expression(0.0)
    D = coefficients(function(at.time, at.state, at.k), order)
    curved = rest + step * step * total_of_powers([absolute(c) for c in D[2:]], step)
    towards_0 = hy.select(hy.lt(D[0], 0.0), -D[1], D[1])
    return absolute(D[0]) + step * smaller(towards_0, hy.expression(0.0)) - curved


def majorant_beyond(order: int, function: Callable[..., Any], at: SymbolicMotion, step: Any) -> Any:
    """A bound on the sum of the terms beyond an order, in the series of a function of a motion
    within a step.

    Raises NotImplementedError where the function has no majorant.
    """
    inputs = [Majorant(partial(term_size, series)) for series in (at.time, *at.state)]
    sums = [total_of_powers(coefficients(series, SERIES_ORDER), step) for series in inputs]
    whole = [Majorant(partial(constant, total)) for total in sums]
    of_series, of_sums = (function(y[0], y[1:], at.k) for y in (inputs, whole))
    # The margin covers the rounding of both sums.
    own = total_of_powers(coefficients(of_series, order), step)
    return (1 + BOUND_ROUNDING) * of_sums[0] - own


def term_size(series: Series, k: int) -> Any:
    """The absolute value |c_k| of a coefficient of a series."""
    return absolute(series[k])


def absolute(x: Any) -> Any:
    """The absolute value of an expression or a number; a series is returned as it is."""
    if isinstance(x, Series):
        return x
    return hy.select(hy.lt(x, 0.0), -x, x) if isinstance(x, hy.expression) else abs(x)


def larger(a: Any, b: Any) -> Any:
    """The larger of two expressions."""
    return hy.select(hy.gt(a, b), a, b)


def smaller(a: Any, b: Any) -> Any:
    """The smaller of two expressions."""
    return hy.select(hy.lt(a, b), a, b)


build = lru_cache(maxsize=16)(TaylorStep)
"""The compiled step for one model, its structure and events."""
