"""Which method `auto` takes for a case."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..engines import exact, protocol
from ..models.constants import attributes, jacobian
from .driver import Path
from .solve import solve
from .units import Units

MANY_STEPS = 1e4
"""Beyond this many Taylor steps, some 10 ms, collocation is the faster one."""

RATIO, MOST_TRIED, ROUGH = 200, 5000, 1e-4
"""The cost of a step of collocation in Taylor steps; the most steps, and the tolerance, of a trial
of it."""


def choose(case: Case) -> tuple[str, str]:
    """The method for a case and, in words, why."""
    return best(case, case.precision) if case.method == "auto" else (case.method, "asked for")


@np.errstate(all="ignore")
def best(case: Case, precision: str) -> tuple[str, str]:
    """The fastest method that is right to the last digits in a precision, and why.

    In quadruple precision only the Taylor series is to be had.
    """
    if precision == "quadruple":
        return "taylor", "quadruple precision"
    if exact.applies(case):
        return "exact", "closed form"
    if not protocol.have_taylor():
        return "collocation", "heyoka is not installed"
    with suppress(ArithmeticError, HodoError):  # numbers out of range, as `solve` will say
        if (steps := taylor_steps(case)) > MANY_STEPS:
            times = np.linspace(case.time.start, case.time.end, 17)[1:]
            most = replace(case, max_steps=int(min(steps / RATIO, MOST_TRIED)), max_seconds=None)
            trial = solve(most, "collocation", tol=ROUGH, times=times)
            if trial.whole and (steps := taylor_steps(case, trial.path)) > max(
                MANY_STEPS, RATIO * trial.steps
            ):
                why = f"stiff: {trial.steps} steps in a trial, where a Taylor series needs some {steps:.0e}"
                return "collocation", why
    return "taylor", "not stiff"


def taylor_steps(case: Case, path: Path | None = None) -> float:
    """About how many Taylor steps a case takes if it is all the time as fast as at the start, or as
    on a path."""
    system, model, rates = case.system, type(case.system), []
    if path is None:
        path = Path(np.array([case.time.end]), np.array([system.start]), np.array([0]), ())
    for t, state, exponent in zip(
        path.time.tolist(), path.state.astype(float), path.exponent.tolist(), strict=True
    ):
        units = Units.fit(model, system.constants, state, exponent)
        k = attributes(units.constants(model, system.constants))
        slopes = jacobian(model, k, t, np.ldexp(state, exponent - units.size))
        rates.append(
            float(np.ldexp(np.abs(slopes).sum(axis=1).max(), units.rate)) if state.any() else 0.0
        )
    return float(np.mean(rates) * (path.time[-1] - case.time.start)) / 8
