"""The members of a sweep: their data, each as a single case, and many as an ensemble of motions;
and single cases of one kind, integrated as an ensemble."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import HodoError, models
from ..arithmetic import BranchDivergence, Column, exp, member_values
from ..cases.case import Case
from ..cases.sweep_block import axes_of, with_number
from ..engines import have_taylor
from ..engines.protocol import EPS
from ..integration import Crossing, Trajectory, sample_times
from ..models.attitude import check_attitude, warnings_of
from ..models.base import (
    UNIT,
    Model,
    attributes,
    contains_time,
    flatten,
    has_formula_of_time,
)
from ..models.rigid_body import BodyFrame, is_rounded
from ..schema.kinds import KeyPath
from ..text import grouped
from .columns import (
    crossing_columns,
    shape,
)
from .ensemble.advance import advance
from .ensemble.motions import Ensemble


def ensemble_of(case: Case, system: Model, members: np.ndarray, start: Iterable[Any]) -> Ensemble:
    """The ensemble of members (n,) with the equations of one system. `start` has an entry for each
    variable of the state: a number, or an array (n,) or a `Column` of n numbers."""
    model, events = system.equations, (*system.run_events, *system.class_events)
    numbers = [*flatten(system.constants)]
    # In units that fit the motions, the equations need the unit of time for the case's time.
    if model.degree and contains_time(model, events) and UNIT not in model.names:
        model, numbers = replace(model, structure=(*model.structure, (UNIT, 0))), [*numbers, 1.0]
    n, span = len(members), (case.time.start, case.time.end)
    constants, starts = as_rows(numbers, n), as_rows(tuple(start), n)
    return Ensemble(members, model, constants, starts, span, events, case.tol or EPS)


def as_rows(numbers: Sequence[Any], n: int) -> np.ndarray:
    """Numbers, `Column`s of n numbers or arrays (n,) as the rows of an array (rows, n)."""
    array = np.empty((len(numbers), n))
    for i, number in enumerate(numbers):
        array[i] = number if isinstance(number, np.ndarray) else member_values(number)
    return array


DataAndSystem = tuple[Mapping[str, Any], Model | None]
"""The data of members with one combination of swept values, or with a `Column` of many, without the
direction on a sphere; and the system that the data describe, None where they describe no body or no
start."""


def data_and_system(case: Case, paths: Sequence[KeyPath], values: Sequence[Any]) -> DataAndSystem:
    """The data and the system of members with these values at the `paths` that vary: numbers for
    one combination, columns for many."""
    data = case.data
    for path, new in zip(paths, values, strict=True):
        data = with_number(data, path, new)
    return data, system_of_member(case, data)


def system_of_member(case: Case, data: Mapping[str, Any]) -> Model | None:
    """The equations of a member with these data; None where the data describe no body or no start,
    are not valid over the whole span, or need other equations than the case."""
    form, epoch = type(case.system), case.time.epoch
    span = (case.time.start - (epoch or 0.0), case.time.end - (epoch or 0.0))
    # Moments that violate the triangle inequality by rounding only are accepted from the case
    # itself, not from a swept value.
    is_own = data.get("inertia") is case.data.get("inertia") and is_rounded(data)
    wrong = (x for x in form.check(data) if not is_own or x[0][:1] != ("inertia",))
    if any(wrong) or any(check_attitude(form, data)) or any(form.check_span(data, *span)):
        return None
    # With other terms there are other variables, for which the sweep has no columns.
    system = models.find(case.model, case.form).of(data, epoch)
    is_alike = system.equations.terms == case.system.equations.terms
    return system if is_alike and type(system) is form else None


def combinations(
    case: Case, members: np.ndarray
) -> tuple[list[KeyPath], np.ndarray, np.ndarray, np.ndarray | None]:
    """The combinations of swept values that occur among members (n,).

    Returns the p paths that vary, the values (p, k) there of k combinations, the position (n,) of
    each member's combination, and the directions (n, 3) of members on a sphere, or None.
    """
    axes = axes_of(case.sweep or {})
    index = np.unravel_index(members, shape(case))
    plain = [(axis, i) for axis, i in zip(axes, index, strict=True) if axis.sphere is None]
    directions = [
        axis.directions(i) for axis, i in zip(axes, index, strict=True) if axis.sphere is not None
    ]
    # With a sphere as the only axis, nothing else varies and there is one combination.
    sizes = [len(axis) for axis, _ in plain] or [1]
    number = np.ravel_multi_index([i for _, i in plain] or [np.zeros_like(members)], sizes)
    # All directions of a sphere share one combination.
    occurring, combination = np.unique(number, return_inverse=True)
    positions = np.unravel_index(occurring, sizes)  # along each plain axis
    varying = [
        (path, axis.values(j, along))
        for (axis, _), along in zip(plain, positions, strict=bool(plain))
        for j, (path, _) in enumerate(axis.ranges)
    ]
    paths = [path for path, _ in varying]
    values = np.array([numbers for _, numbers in varying]).reshape(len(paths), len(occurring))
    return paths, values, combination, directions[0] if directions else None


def prepare(case: Case, members: np.ndarray) -> list[Ensemble]:
    """The ensembles of members (n,), where an ensemble numbers its motions by their positions among
    these. Members whose data describe no body or no start are left out."""
    paths, values, combination, direction = combinations(case, members)
    if direction is None:
        every = np.arange(len(members))
        return joined_by_kind(prepared_by_branch(case, paths, values[:, combination], every))
    sets = [data_and_system(case, paths, row) for row in values.T.tolist()]
    omega = velocities(sets, combination, direction)
    bodies = [
        (np.flatnonzero(combination == i), system)
        for i, (_, system) in enumerate(sets)
        if isinstance(system, BodyFrame)
    ]
    return joined_by_kind(
        ensemble_of(case, body, positions, body.initial_states(omega[positions]))
        for positions, body in bodies
    )


def prepared_by_branch(
    case: Case, paths: Sequence[KeyPath], values: np.ndarray, positions: np.ndarray
) -> Iterator[Ensemble]:
    """The ensembles of the members at some positions, with the values (p, n) of all members at p
    paths. Members for which the model takes the same branches are prepared together; members are
    prepared one by one if they are invalid together, or if the model takes plain numbers only."""
    try:
        with np.errstate(all="ignore"):  # columns refuse numbers that are not finite
            _, system = data_and_system(case, paths, [*map(Column, values[:, positions])])
        if system is not None:
            yield ensemble_of(case, system, positions, system.initial_state)
            return
    except BranchDivergence as branches:
        for branch in (branches.where, ~branches.where):
            yield from prepared_by_branch(case, paths, values, positions[branch])
        return
    except (TypeError, AttributeError):  # numpy's functions of two objects raise the latter
        pass
    for position, row in zip(positions[:, None], values[:, positions].T.tolist(), strict=True):
        _, system = data_and_system(case, paths, row)
        if system is not None:
            yield ensemble_of(case, system, position, system.initial_state)


def joined_by_kind(ensembles: Iterable[Ensemble]) -> list[Ensemble]:
    """The same motions in fewer ensembles: ensembles that can share a compiled step are joined."""
    kinds = grouped(((e.model, e.events), e) for e in ensembles)
    return [joined(kind) for kind in kinds.values()]


def joined(kind: Sequence[Ensemble]) -> Ensemble:
    """One ensemble of the motions of several, which differ in members, constants and starts
    only."""
    arrays = zip(*((e.members, e.constants, e.start) for e in kind), strict=True)
    members, constants, start = (np.concatenate(parts, axis=-1) for parts in arrays)
    return replace(kind[0], members=members, constants=constants, start=start)


def velocities(
    sets: Sequence[DataAndSystem], combination: np.ndarray, direction: np.ndarray
) -> np.ndarray:
    """The angular velocities (n, 3) at the start for these directions (n, 3) of G. |G| comes from
    the data of each member's combination (n,); nan where these data describe no body or no
    start."""
    omega = np.full(direction.shape, np.nan)
    for i, (_, system) in enumerate(sets):
        if system is None:
            continue
        assert isinstance(system, BodyFrame)
        G = system.momentum(np.array(system.initial_velocity))
        is_own = combination == i
        omega[is_own] = system.velocities(np.linalg.norm(G) * direction[is_own])
    return omega


def member(case: Case, number: int, samples: int | None = 2) -> Case:
    """One member as a single case."""
    return next(members_as_cases(case, np.array([number]), samples))


def members_as_cases(case: Case, numbers: np.ndarray, samples: int | None) -> Iterator[Case]:
    """Members as single cases, with this number of evenly spaced samples, or with the case's own
    samples if `samples` is None."""
    paths, values, combination, direction = combinations(case, numbers)
    sets = [data_and_system(case, paths, row) for row in values.T.tolist()]
    time = case.time if samples is None else case.time.resampled(samples)
    common = replace(case, time=time, sweep=None, store=(), error=False)
    omega = None if direction is None else velocities(sets, combination, direction)
    for i, number in enumerate(numbers):
        data, system = sets[combination[i]]
        if omega is not None and system is not None:
            # p, q, r replace the other keys of a start (|G|, x and y), which become None.
            start = dict.fromkeys(data["initial"]) | dict(
                zip("pqr", omega[i].tolist(), strict=True)
            )
            data = {**data, "initial": start}
        yield replace(common, name=f"{case.name}.{number}", data=data)


def warnings_of_ends(case: Case) -> list[str]:
    """The warnings of the models of the first and the last member about their data.

    The case's own data may belong to no member. Values along an axis mostly rise or fall, so that
    on one axis a warning of any member is mostly one of the first or the last too.
    """
    total = math.prod(shape(case))
    ends = {0: "first", total - 1: "last"} if total > 1 else {0: "first"}
    systems = {end: system_of_member(case, member(case, i).data) for i, end in ends.items()}
    given = grouped(
        (warning, end)
        for end, system in systems.items()
        if system
        for warning in warnings_of(system)
    )
    whose = f"of {total} members (only the first and the last are checked)"
    return [f"{' and '.join(by)} {whose}: {warning}" for warning, by in given.items()]


def other_method(case: Case) -> str:
    """Why the compiled steps of an ensemble cannot integrate a case; empty if they can."""
    reasons = {
        f"method {case.method}": case.method not in ("auto", "taylor"),
        f"{case.precision} precision": case.precision != "double",
        f"form {case.form} is a quadrature": case.system.is_quadrature,
        "heyoka is not installed": not have_taylor(),
        "limits of each member": case.max_steps is not None or case.max_seconds is not None,
    }
    return next((reason for reason, applies in reasons.items() if applies), "")


# Formulas of the time whose changes an ensemble may miss, because it compares its steps with the
# equations at few places


@dataclass(frozen=True)
class TimeInRates:
    """A substitute for the time in equations. Each term computed from it records the highest
    `power` of the time in the term, and the `slope` of the term if it is linear in the time, else
    nan.

    Sines, falling exponentials and negative powers of a linear term count as numbers, because their
    series at any point shows the whole function. All other functions raise TypeError or
    AttributeError.
    """

    power: int = 1
    slope: float = 1.0
    __array_ufunc__ = None  # number * TimeInRates must not be taken apart by numpy

    def __add__(self, other: Any) -> "TimeInRates":
        of_other = as_time(other)
        return TimeInRates(max(self.power, of_other.power), self.slope + of_other.slope)

    def __mul__(self, other: Any) -> "TimeInRates":
        if isinstance(other, TimeInRates):
            return TimeInRates(self.power + other.power, math.nan)
        return TimeInRates(self.power, self.slope * other)

    def __pow__(self, exponent: float) -> "TimeInRates":
        if math.isnan(self.slope) or exponent > 1:
            raise TypeError
        return self.sin()

    def exp(self) -> "TimeInRates":
        if not self.slope <= 0:
            raise TypeError
        return self.sin()

    def sin(self) -> "TimeInRates":
        if self.power > 1:
            raise TypeError
        return TimeInRates(0, math.nan)  # counts as a number, but its slope is not constant

    __radd__, __rmul__, cos = __add__, __mul__, sin
    __neg__, __pos__ = (lambda x: x * -1.0), (lambda x: x)
    __sub__, __rsub__ = (lambda x, y: x + -y), (lambda x, y: -x + y)
    __truediv__, __rtruediv__ = (lambda x, y: x * y**-1), (lambda x, y: x**-1 * y)
    __rpow__ = lambda x, base: exp(x * math.log(base))  # noqa: E731


def as_time(rate: Any) -> TimeInRates:
    """A rate as it is; a number as a rate that does not contain the time."""
    return rate if isinstance(rate, TimeInRates) else TimeInRates(0, 0.0)


def may_hide_in_time(system: Model) -> bool:
    """Whether the Taylor series of a step may miss a change of a user's formulas within the step. A
    pulse leaves no trace in a series far from it, nor does t**2 at t = 0 in the orders that
    determine a step."""
    if not has_formula_of_time(system):
        return False
    # With nan for the state, no slope that depends on the state counts as falling.
    y, k = [math.nan] * len(system.equations.state), attributes(system.constants)
    try:
        return max(as_time(rate).power for rate in system.equations.rhs(TimeInRates(), y, k)) > 1
    except (TypeError, AttributeError, ValueError, ArithmeticError, HodoError):
        return True


# Single cases

FEWEST_CASES = 32
"""The fewest single cases of one kind that are integrated as an ensemble. Fewer cases take less
time one by one than the step takes to compile."""

CrossedMotion = tuple[Trajectory, tuple[Crossing, ...]]
"""A motion and its separatrix crossings."""


def side_by_side(cases: Sequence[Case]) -> list[CrossedMotion | None]:
    """The motions of single cases, integrated as an ensemble where there are enough of one kind;
    None for a case that has to be integrated alone."""
    motions: list[CrossedMotion | None] = [None] * len(cases)
    for e in ensembles_of(cases):
        times = sample_times(cases[e.members[0]])
        outcome = advance(replace(e, times=times))
        passed = outcome.accepted_passages
        columns = (column.tolist() for column in crossing_columns(e, passed).values())
        crossings = grouped(
            (n, Crossing(time, start, end, momentum, error))
            for n, time, error, start, end, momentum in zip(passed.motion, *columns, strict=True)
        )
        for n in np.flatnonzero(outcome.accepted):
            case, state = cases[e.members[n]], outcome.samples[:, n].T
            motion = Trajectory(
                case, "taylor", e.tol, times, state, outcome.sample_exponent[n],
                steps=int(outcome.steps[n]),
            )  # fmt: skip
            motions[e.members[n]] = motion, tuple(crossings.get(n, ()))
    return motions


def ensembles_of(cases: Sequence[Case]) -> Iterator[Ensemble]:
    """The ensembles of single cases of one kind, with at least FEWEST_CASES each."""
    kinds = grouped(
        (
            (case.system.equations, case.time, case.tol),
            ensemble_of(case, case.system, np.array([i]), case.system.initial_state),
        )
        for i, case in enumerate(cases)
        if watches_separatrix(case)
    )
    for singles in kinds.values():
        yield from (e for e in joined_by_kind(singles) if len(e.members) >= FEWEST_CASES)


def watches_separatrix(case: Case) -> bool:
    """Whether an ensemble can find the crossings of a case, with a step that compiles in a short
    time."""
    system = case.system
    is_body = bool(system.equations.degree) and not system.no_axis_reason
    return is_body and not other_method(case) and not system.run_events
