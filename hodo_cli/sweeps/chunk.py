"""A chunk of members, integrated: the task of a pool."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from time import thread_time
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, Time
from ..engines import have_taylor
from ..engines.protocol import EPS, Status
from ..integration.classify import classify
from ..integration.integrate import integrate
from ..integration.trajectory import Occurrence, Trajectory
from ..models import rigid_body
from ..models.constants import UNIT, contains_time, flatten, rescaled
from ..results.layout import CROSSING_COLUMNS, columns_of
from ..storage.group import Attribute, Group, Variable
from .columns import columns, event_columns, label_columns, shape
from .ensemble.advance import advance_through, measure_crossings
from .ensemble.motions import Ensemble, Outcome, Passages
from .members import Prepared, member, prepare

LARGEST_CHUNK, SMALLEST_CHUNK = 16384, 256
"""Members of a chunk: their columns fit a processor's cache, and are long enough that what numpy
spends on each call, and HDF5 on each file, does not count."""

WORTH = 250
"""Members for each number among the constants, from which on it is worth seconds to compile the
step of averaged equations, at about a millisecond for each member by itself. The nodes of a
quadrature count among the constants."""


TURNING = 20
"""By what factor a body averaged over its turns takes longer by itself than a top does."""


@dataclass(frozen=True)
class Chunk:
    """The members `first` to `last` - 1 of a sweep, in the order in which the last axis varies
    fastest."""

    case: Case
    first: int
    last: int


def chunks(case: Case) -> Iterator[Chunk]:
    """The tasks of a sweep. They depend on the case alone, so that another run finds the same."""
    sizes = shape(case)
    most = min(LARGEST_CHUNK, max(SMALLEST_CHUNK, -(-math.prod(sizes) // 16)))
    if not fits_ensemble(case) or "trajectory" in case.store:
        most = min(most, 64)
    for first, last in boxes(sizes, most):
        yield Chunk(case, first, last)


def boxes(sizes: tuple[int, ...], most: int) -> Iterator[tuple[int, int]]:
    """The first member of each box of an array of these sizes, and the one behind its last: boxes
    of at most so many members, which are whole rows or stretches of one."""
    axis = next(i for i in range(len(sizes)) if math.prod(sizes[i + 1 :]) <= most)
    row, length = math.prod(sizes[axis + 1 :]), sizes[axis]
    count = -(-length // (most // row))
    edges = [length * i // count * row for i in range(count + 1)]  # boxes of equal size
    for begin in range(0, math.prod(sizes), length * row):
        for low, high in pairwise(edges):
            yield begin + low, begin + high


def fits_ensemble(case: Case) -> bool:
    """Whether the members of a sweep go side by side: they may, and they are worth the compilation
    of their step."""
    worth = 0 if case.system.degree else WORTH * len(flatten(case.system.constants))
    if any(event.passage for event in case.system.run_events):
        worth //= TURNING
    return goes_beside(case) and math.prod(shape(case)) >= worth


def goes_beside(case: Case) -> bool:
    """Whether the method of a case is that of `ensemble`."""
    fit = case.method in ("auto", "taylor") and case.precision == "double" and have_taylor()
    # Single cases heed these.
    return fit and case.system.batchable and case.max_steps is None and case.max_seconds is None


def compute(chunk: Chunk) -> Group:
    """The members of a chunk, reduced to a few numbers each: the task of a pool."""
    began = thread_time()
    case, n = chunk.case, chunk.last - chunk.first
    values = {
        name: np.full(
            (n, *column.shape),
            0 if column.dtype[0] == "i" else np.nan,
            dtype=column.dtype,
        )
        for name, column in columns(case).items()
    }
    unsettled = integrated_together(chunk, values) if fits_ensemble(case) else np.arange(n)
    methods = {"taylor"} if len(unsettled) < n else set()
    for i in unsettled.tolist():
        if values["status"][i] != Status.INVALID.code:
            status, method, reduced = integrated_alone(case, chunk.first + i)
            values["status"][i] = status.code
            methods.add(method)
            enter(values, [i], reduced)
    dims = {name: ("member", *column.dims) for name, column in columns(case).items()}
    if "trajectory" in case.store:
        values |= (paths := trajectories(chunk, values["status"]))
        dims |= {name: ("member", "time", *dims[name][1:]) for name in paths}
    attributes: dict[str, Attribute] = {
        "run_time": thread_time() - began,
        "alone": len(unsettled),
        "methods": " ".join(sorted(methods - {""})),
    }
    return Group(attributes, {name: Variable(dims[name], data) for name, data in values.items()})


def enter(values: Mapping[str, np.ndarray], rows: Any, reduced: Mapping[str, np.ndarray]) -> None:
    """Enter the columns of some members in their rows of those columns that their sweep has."""
    for name in values.keys() & reduced.keys():
        values[name][rows] = reduced[name]


def integrated_together(chunk: Chunk, values: dict[str, np.ndarray]) -> np.ndarray:
    """Fill in the members whose motions an ensemble accepts; returns the rows of the others."""
    case, status = chunk.case, values["status"]
    status[:] = Status.INVALID.code
    is_unsettled = np.zeros(len(status), dtype=bool)
    for group in prepare(case, np.arange(chunk.first, chunk.last)):
        status[group.positions], is_unsettled[group.positions] = Status.OK.code, True
        # One compiled step watches one event; of two or more, single cases keep the order.
        if len(group.events) <= 1:
            e = ensemble_of(case, group)
            outcome, events = advance_through(e)
            if e.event and not (e.model.no_axis_reason or e.model.always_absorbing):
                measure_crossings(e, e.event, outcome)
            accepted = group.positions[outcome.accepted]
            enter(values, accepted, reduced_ensemble(e, outcome, events, case.time))
            is_unsettled[accepted] = False
    return np.flatnonzero(is_unsettled)


def ensemble_of(case: Case, group: Prepared) -> Ensemble:
    """Members that share a compiled step, as an ensemble."""
    event, model = next(iter(group.events), None), type(case.system)
    span, tol = (case.time.start, case.time.end), case.tol or EPS
    form, constants = group.structure, group.constants
    if model.degree and contains_time(model, form, group.events) and (UNIT, 0) not in form:
        form, constants = (*form, (UNIT, 0)), np.vstack((constants, np.ones(len(group.positions))))
    return Ensemble(model, form, constants, group.start, span, event, tol)


def reduced_ensemble(
    e: Ensemble, outcome: Outcome, events: Mapping[int, list[Occurrence]], time: Time
) -> dict[str, np.ndarray]:
    """The columns of the accepted motions of an ensemble, with the `events` of those that
    went on through one."""
    accepted = np.flatnonzero(outcome.accepted)
    state = outcome.state[:, accepted].T
    if e.model.degree:
        state = rescaled(e.model, state, outcome.exponent[accepted])
    final = e.model.output(np.array([e.span[1]]), state, e.named(accepted))
    final["steps"] = outcome.steps[accepted]
    if "enclosed_axis" in final:
        begin = np.array([e.span[0]])
        start = e.model.output(begin, e.start[:, accepted].T, e.named(accepted))
        axes = start["enclosed_axis"], final["enclosed_axis"]
        return final | event_columns([events.get(i, []) for i in accepted.tolist()], axes)
    passed = outcome.accepted_passages
    row = np.searchsorted(accepted, passed.motion)
    if not e.model.no_axis_reason:
        first, last = (enclosed(e, side[accepted]) for side in (outcome.first, outcome.last))
        labels = label_columns(first, last, row, crossing_columns(e, passed), time)
        return final | labels | {"separation": least_separation(e, outcome, accepted)}
    event_time = np.full(len(accepted), np.nan)
    event_time[row] = passed.time  # of several, the last one counts
    return final | {"event_time": event_time}


def enclosed(e: Ensemble, side: np.ndarray) -> np.ndarray:
    """The axis (k,) that is enclosed where D has a sign (k,)."""
    order = rigid_body.inertia_order(e.inertia[:, 0])
    axes = np.array([order[2] + 1, rigid_body.UNDETERMINED, order[0] + 1], dtype=np.int8)
    return np.asarray(axes[side.astype(int) + 1])


def least_separation(e: Ensemble, outcome: Outcome, motions: np.ndarray) -> np.ndarray:
    """The smaller `rigid_body.separation` of start and end of some motions (k,)."""
    A, ends = e.inertia[:, motions], (e.start[:3, motions], outcome.state[:3, motions])
    order = rigid_body.inertia_order(e.inertia[:, 0])
    return np.asarray(np.minimum(*(rigid_body.separation(A, omega, order) for omega in ends)))


def crossing_columns(e: Ensemble, passed: Passages) -> dict[str, np.ndarray]:
    """Passages (k,) through the separatrix, as CROSSING_COLUMNS."""
    G = e.inertia[:, passed.motion] * passed.state[:3]
    return {
        "crossing_time": passed.time,
        "crossing_error": passed.error,
        "crossing_from": enclosed(e, -passed.direction),
        "crossing_to": enclosed(e, passed.direction),
        "crossing_G": np.ldexp(np.sqrt(np.square(G).sum(axis=0)), passed.exponent),
    }


def integrated_alone(case: Case, number: int) -> tuple[Status, str, dict[str, np.ndarray]]:
    """The status of one member that is integrated as a single case, its method, and its columns
    (1,): none where it comes to nothing."""
    model, single = type(case.system), member(case, number)
    if any(model.check(single.data)):
        return Status.INVALID, "", {}
    if not model.no_axis_reason:
        # Its crossings need the error of the motion, also where none is asked for if an ensemble
        # has not accepted it; `member` leaves it out for all others.
        single = replace(single, error="on" if fits_ensemble(case) else case.error)
    try:
        motion = integrate(single)
        if motion.status is not Status.OK:
            return motion.status, "", {}
        final = {name: values[-1:] for name, values in motion.variables.items()}
        final["steps"] = np.array([motion.steps])
        if not model.no_axis_reason:
            status, labels = classified_alone(motion)
            return status, motion.method, final | labels
    except HodoError:
        return Status.FAILED, "", {}
    axis = motion.variables.get("enclosed_axis")
    axes = None if axis is None else (axis[:1], axis[-1:])
    return Status.OK, motion.method, final | event_columns([motion.events], axes)


def classified_alone(motion: Trajectory) -> tuple[Status, dict[str, np.ndarray]]:
    """The columns (1,) of the labels of a single case, and whether they are certain."""
    case, omega = motion.case, motion.variables["omega"]
    classification = classify(case, motion.method, motion.tol, motion.error, omega)
    A = np.array(case.data["inertia"])[:, None]
    ends = np.array([case.system.start[:3], motion.omega[-1]], dtype=float).T
    nearest = rigid_body.separation(A, ends, rigid_body.inertia_order(A[:, 0])).min()
    member = np.zeros(len(classification.crossings), dtype=np.int64)
    columns = columns_of(CROSSING_COLUMNS, classification.crossings)
    crossings = {name: variable.data for name, variable in columns.items()}
    labels = label_columns(
        classification.labels[:1], classification.labels[-1:], member, crossings, case.time
    )
    status = Status.UNDECIDED if classification.hidden else Status.OK
    return status, labels | {"separation": np.array([nearest])}


def trajectories(chunk: Chunk, status: np.ndarray) -> dict[str, np.ndarray]:
    """The stored variables at every sample (n, samples, ...); nan from where a motion ended."""
    case = chunk.case
    paths: dict[str, np.ndarray] = {}
    for i in np.flatnonzero(status == Status.OK.code):
        number = chunk.first + int(i)
        motion = integrate(member(case, number, case.time.samples))
        for name, values in motion.variables.items():
            size = (len(status), case.time.samples, *values.shape[1:])
            paths.setdefault(name, np.full(size, np.nan))[i, : len(values)] = values[
                : case.time.samples
            ]
    return paths
