"""The method that `auto` takes for a case."""

from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from .. import HodoError, engines
from ..cases.case import Case
from ..engines.units import TimeWindow, Units, is_timed, units_at_start
from ..models.base import Model, attributes, jacobian, rescaled
from .solve import Trajectory, even_times, solve

AUTOMATIC = ("exact", "quadrature", "taylor", "collocation")
"""The methods that `auto` takes: those that are right to the last digits."""

MIN_STIFF_STEPS = 1e4
"""Collocation may be faster only beyond this many Taylor steps, some 10 ms."""

COLLOCATION_COST = 200
"""The cost of a step of collocation in Taylor steps: 1.2 ms against 6.5 us, on a stiff motion."""

MAX_TRIAL_STEPS = 5000
"""The most steps of a trial of collocation, which then takes a few seconds at worst."""

TRIAL_TOL = 1e-4
"""The tolerance of a trial. It counts steps, and a stiff motion takes nearly as many at any
tolerance."""


def choose(case: Case) -> tuple[str, str]:
    """The method for a case, and the reason for it in words."""
    return best(case, case.precision) if case.method == "auto" else (case.method, "asked for")


@np.errstate(all="ignore")
def best(case: Case, precision: str) -> tuple[str, str]:
    """The fastest method that is right to the last digits in a precision, and the reason in words.

    Only the Taylor series works in quadruple precision.
    """
    if precision == "quadruple":
        return "taylor", "quadruple precision"
    if case.system.has_closed_form:
        is_averaged = case.system.is_quadrature
        return (
            ("quadrature", "averaged to first order") if is_averaged else ("exact", "closed form")
        )
    if not engines.have_taylor():
        return "collocation", "heyoka is not installed"
    if case.time.values:  # the cache of `stiffness` would keep them, and there may be millions
        case = replace(case, time=case.time.resampled(2))
    with suppress(ArithmeticError, HodoError):  # numbers out of range, which `solve` will report
        if reason := stiffness(case):
            return "collocation", reason
    return "taylor", "not stiff"


@lru_cache(maxsize=1024)  # claims integrate a case several times, and a trial may take seconds
def stiffness(case: Case) -> str:
    """Why a case is stiff, so that collocation is faster than a Taylor series; empty if it is not
    stiff."""
    steps = taylor_steps(case)
    if not steps > MIN_STIFF_STEPS:  # most cases are not stiff at their start, and end here
        return ""
    # A trial shows the rates along the path, because the motion may become slow or fast later.
    times = even_times(case, 17)[1:]
    # Where it does not end within the steps and seconds of the case, collocation to the tolerance
    # of the case would not end either.
    most = min(steps / COLLOCATION_COST, MAX_TRIAL_STEPS, case.max_steps or MAX_TRIAL_STEPS)
    trial = solve(replace(case, max_steps=int(most)), "collocation", tol=TRIAL_TOL, times=times)
    least = max(MIN_STIFF_STEPS, COLLOCATION_COST * trial.steps)
    if trial.succeeded and (steps := taylor_steps(case, trial)) > least:
        needs = f"where a Taylor series needs some {steps:.0e}"
        return f"stiff: {trial.steps} steps in a trial, {needs}"
    return ""


def taylor_steps(case: Case, path: Trajectory | None = None) -> float:
    """An estimate of the number of Taylor steps that a case takes: from the fastest rate at its
    start, with laws of time as at its end, or from the rates along a path."""
    system, end = case.system, case.time.end
    span = end - case.time.start if is_timed(system) else None
    if path is None:
        moment = None if span is None else TimeWindow(case.time.start, span)
        units, state = units_at_start(system, moment), np.array(system.initial_state)
        rates = [fastest_rate(system, end, state, 0, units)]
    else:
        end, rates = float(path.time[-1]), []
        for t, state, exponent in zip(
            path.time.tolist(), path.state.astype(float), path.exponent.tolist(), strict=True
        ):
            moment = None if span is None else TimeWindow(t, span)
            units = Units.fit(system.equations, system.constants, state, exponent, moment)
            rates.append(fastest_rate(system, t, state, exponent, units))
    # A Taylor step at full precision covers some 8 units of the fastest rate. The estimate is right
    # to 25 % for a stiff motion, whose method it decides; other motions take three times as many.
    return float(np.mean(rates) * (end - case.time.start)) / 8


def fastest_rate(system: Model, t: float, state: np.ndarray, exponent: int, units: Units) -> float:
    """The fastest rate of change in a state (m,), given in units of omega of 2**exponent, at the
    time t. The `units` fit the state, so that no number leaves the range of doubles."""
    model, k = system.equations, attributes(units.constants(system.equations, system.constants))
    y = rescaled(model, state, exponent - units.exponent)
    slopes, moving = jacobian(model, k, t, y), np.array(model.rhs(t, [*y], k), dtype=float) != 0
    # A variable that keeps its value, such as a side, changes no other variable, however much they
    # depend on it.
    slopes[:, ~moving & ~slopes.any(axis=1)] = 0
    fastest = np.ldexp(np.abs(slopes).sum(axis=1).max(), units.rate if model.degree else 0)
    return float(fastest) if state.any() else 0.0
