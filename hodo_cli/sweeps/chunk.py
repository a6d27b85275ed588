"""A chunk of members, integrated: the task of a pool."""

import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import perf_counter

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..engines import have_taylor
from ..engines.protocol import EPS, Status
from ..integration.classify import classify
from ..integration.crossings import Crossing
from ..integration.integrate import integrate
from ..integration.solve import sample_times
from ..integration.trajectory import Occurrence, Trajectory
from ..models import rigid_body
from ..models.constants import flatten
from ..storage.group import Attribute, Group, Variable
from . import ensemble
from .columns import (
    Classified,
    Crossings,
    Reduction,
    columns,
    enter,
    event_columns,
    shape,
)
from .ensemble import Ensemble, Outcome, Passages
from .members import Prepared, alike, member, of_system, prepare

MOST_MEMBERS, LEAST_MEMBERS = 16384, 256
"""Members of a chunk: their columns fit a processor's cache, and are long enough that what numpy
spends on each call, and HDF5 on each file, does not count."""

WORTH = 250
"""Members for each number among the constants, from which on it is worth seconds to compile the
step of averaged equations, at about a millisecond for each member by itself. The nodes of a
quadrature count among the constants."""


FEWEST = 32
"""Single cases of one kind, below which each by itself takes less time than compiling the step."""

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
    most = min(MOST_MEMBERS, max(LEAST_MEMBERS, -(-math.prod(sizes) // 16)))
    if not fits_ensemble(case) or "trajectory" in case.store:
        most = min(most, 64)
    for first, last in boxes(sizes, most):
        yield Chunk(case, first, last)


def boxes(sizes: tuple[int, ...], most: int) -> Iterator[tuple[int, int]]:
    """The members of an array of these sizes in parts, each of which is a box of it and of at most
    so many: whole rows, or parts of one."""
    axis = next(i for i in range(len(sizes)) if math.prod(sizes[i + 1 :]) <= most)
    row, length = math.prod(sizes[axis + 1 :]), sizes[axis]
    parts = -(-length // (most // row))
    edges = [length * i // parts * row for i in range(parts + 1)]  # parts of equal size
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


Followed = tuple[Trajectory, tuple[Crossing, ...]]
"""A motion and its separatrix crossings."""


def side_by_side(cases: Sequence[Case]) -> list[Followed | None]:
    """The motions of single cases, integrated side by side where there are enough of one kind; None
    for a case that is left to `classify`."""
    found: list[Followed | None] = [None] * len(cases)
    for at, e in ensembles_of(cases):
        times = sample_times(cases[at[0]])
        outcome, met = ensemble.advance_through(replace(e, times=times))
        labels = _reduced(e, outcome, met).classified
        assert labels is not None
        well = np.flatnonzero(outcome.accepted)
        crossings: list[list[Crossing]] = [[] for _ in at]
        columns = [column.tolist() for column in labels.crossings[1:]]
        for n, *values in zip(well[labels.crossings.member], *columns, strict=True):
            time, error, start, end, momentum = values
            crossings[n].append(Crossing(time, start, end, momentum, error))
        for n in well:
            case, state = cases[at[n]], outcome.samples[:, n].T
            motion = Trajectory(
                case, case.system, "taylor", e.tol, times, state, outcome.sample_exponent[n]
            )
            found[at[n]] = motion, tuple(crossings[n])
    return found


def ensembles_of(cases: Sequence[Case]) -> Iterator[tuple[np.ndarray, Ensemble]]:
    """The ensembles that single cases make, where there are enough of one kind, with the places
    (n,) of their motions among the cases."""
    kinds: dict[Hashable, list[Prepared]] = {}
    for i, case in enumerate(cases):
        if watches_separatrix(case):
            one = of_system(case.data, case.system)
            alone = Prepared.of(one, np.array([i]), one.start or ())
            kinds.setdefault((type(case.system), case.time, case.tol), []).append(alone)
    for some in (some for parts in kinds.values() for some in alike(parts)):
        if len(some.at) >= FEWEST:
            yield some.at, _ensemble(cases[some.at[0]], some)


def watches_separatrix(case: Case) -> bool:
    """Whether an ensemble finds the crossings of a case, with a step that is soon compiled."""
    system = case.system
    is_small = bool(system.degree) and not system.no_axis_reason
    return is_small and goes_beside(case) and not system.run_events


def compute(chunk: Chunk) -> Group:
    """The members of a chunk, reduced; what a pool does."""
    began = perf_counter()
    case, n = chunk.case, chunk.last - chunk.first
    values = {
        name: np.full(
            (n, *(3 for _ in column.dims)),
            0 if column.dtype[0] == "i" else np.nan,
            dtype=column.dtype,
        )
        for name, column in columns(case).items()
    }
    left = _together(chunk, values) if fits_ensemble(case) else np.arange(n)
    methods = {"taylor"} if len(left) < n else set()
    for i in left:
        if values["status"][i] != Status.INVALID.code:
            number = chunk.first + int(i)
            status, of = _alone(case, number)
            values["status"][i] = status.code
            if of is not None:
                methods.add(of.method)
                enter(values, np.array([i]), of, case.time)
    dims = {name: ("member", *column.dims) for name, column in columns(case).items()}
    if "trajectory" in case.store:
        values |= (paths := _trajectories(chunk, values["status"]))
        dims |= {name: ("member", "time", *dims[name][1:]) for name in paths}
    attributes: dict[str, Attribute] = {
        "run_time": perf_counter() - began,
        "alone": len(left),
        "methods": " ".join(sorted(methods)),
    }
    return Group(attributes, {name: Variable(dims[name], data) for name, data in values.items()})


def _together(chunk: Chunk, values: dict[str, np.ndarray]) -> np.ndarray:
    """Fill in the members that an ensemble settles; returns the places of the others."""
    case = chunk.case
    status = values["status"]
    status[:] = Status.INVALID.code
    left = np.zeros(len(status), dtype=bool)
    for some in prepare(case, np.arange(chunk.first, chunk.last)):
        status[some.at], left[some.at] = Status.OK.code, True
        # One compiled step watches one event; of two or more, single cases keep the order.
        if len(some.events) <= 1:
            e = _ensemble(case, some)
            outcome, met = ensemble.advance_through(e)
            if not (e.model.no_axis_reason or e.model.always_absorbing):
                ensemble.measure_crossings(e, outcome)
            accepted = some.at[outcome.accepted]
            enter(values, accepted, _reduced(e, outcome, met), case.time)
            left[accepted] = False
    return np.flatnonzero(left)


def _ensemble(case: Case, some: Prepared) -> Ensemble:
    """Members that share a compiled step, as an ensemble."""
    event = next(iter(some.events), None)
    span, tol = (case.time.start, case.time.end), case.tol or EPS
    return Ensemble(type(case.system), some.structure, some.constants, some.start, span, event, tol)


def _reduced(e: Ensemble, outcome: Outcome, met: dict[int, list[Occurrence]]) -> Reduction:
    """The accepted motions of an ensemble, with the events that have taken them on."""
    well = np.flatnonzero(outcome.accepted)
    state, exponent = outcome.state[:, well], outcome.exponent[well]
    final = e.model.output(np.array([e.span[1]]), state.T, e.named(well))
    if e.model.degree:
        final = {name: np.ldexp(values, exponent[:, None]) for name, values in final.items()}
    if "enclosed_axis" in final:
        start = e.model.output(np.array([0.0]), e.start[:, well].T, e.named(well))
        axes = start["enclosed_axis"], final["enclosed_axis"]
        events = event_columns([met.get(i, []) for i in well.tolist()], *axes)
        return Reduction(final, outcome.steps[well], None, events)
    sure = outcome.accepted[outcome.passages.motion]
    passed = Passages(*(column[..., sure] for column in outcome.passages))
    passed = passed._replace(motion=np.searchsorted(well, passed.motion))
    event_time = np.full(len(well), np.nan)
    event_time[passed.motion] = passed.time  # of several, the last one counts
    labels = None if e.model.no_axis_reason else _labelled(e, outcome, well, passed)
    return Reduction(final, outcome.steps[well], labels, {"event_time": event_time})


def _labelled(e: Ensemble, outcome: Outcome, well: np.ndarray, passed: Passages) -> Classified:
    """The labels of accepted motions, whose event is the separatrix."""
    k = e.named()
    A = np.array([k.A1, k.A2, k.A3])
    order, A = rigid_body.inertia_order(A[:, 0]), A[:, well]
    axes = np.array([order[2] + 1, rigid_body.UNDETERMINED, order[0] + 1], dtype=np.int8)
    start, end = (axes[side[well].astype(int) + 1] for side in (outcome.first, outcome.last))
    ends = e.start[:, well], outcome.state[:, well]
    part = np.minimum(*(rigid_body.separation(A, omega, order) for omega in ends))
    G = A[:, passed.motion] * passed.state
    size = np.ldexp(np.sqrt(np.square(G).sum(axis=0)), passed.exponent)
    to, from_ = axes[passed.direction + 1], axes[1 - passed.direction]
    crossings = Crossings(passed.motion, passed.time, passed.error, from_, to, size)
    return Classified(start, end, part, crossings)


def _alone(case: Case, number: int) -> tuple[Status, Reduction | None]:
    """How one member ends that is integrated as a single case, and what it comes to if it does."""
    model, single = type(case.system), member(case, number)
    if any(model.check(single.data)):
        return Status.INVALID, None
    if not model.no_axis_reason:
        # Its crossings need the error of the motion, also where none is asked for if an ensemble
        # has left it in doubt; `member` leaves it out for all others.
        single = replace(single, error="on" if fits_ensemble(case) else case.error)
    try:
        motion = integrate(single)
        if motion.status is not Status.OK:
            return motion.status, None
        final = {name: values[-1:] for name, values in motion.variables.items()}
        axis = motion.variables.get("enclosed_axis")
        ends = (None, None) if axis is None else (axis[:1], axis[-1:])
        events = event_columns([motion.events], *ends)
        status, labels = Status.OK, None
        if not model.no_axis_reason:
            status, labels = _classified(single, motion)
    except HodoError:
        return Status.FAILED, None
    return status, Reduction(final, np.array([motion.steps]), labels, events, motion.method)


def _classified(case: Case, motion: Trajectory) -> tuple[Status, Classified]:
    """The labels of a single case, as those of an ensemble of one, and whether they are certain."""
    omega = motion.variables["omega"]
    found = classify(case, motion.method, motion.tol, motion.error, omega)
    A = np.array(case.data["inertia"])[:, None]
    order = rigid_body.inertia_order(A[:, 0])
    ends = np.array([case.system.start, omega[-1]])
    part = rigid_body.separation(A, ends.T, order).min()
    passed = found.crossings
    crossings = Crossings(
        np.zeros(len(passed), dtype=np.int64),
        np.array([c.time for c in passed]),
        np.array([c.error for c in passed]),
        np.array([c.start for c in passed], dtype=np.int8),
        np.array([c.end for c in passed], dtype=np.int8),
        np.array([c.momentum for c in passed]),
    )
    labels = Classified(found.labels[:1], found.labels[-1:], np.array([part]), crossings)
    return Status.UNDECIDED if found.hidden else Status.OK, labels


def _trajectories(chunk: Chunk, status: np.ndarray) -> dict[str, np.ndarray]:
    """The stored variables at every sample (n, samples, ...); nan from where a motion ended."""
    case = chunk.case
    found: dict[str, np.ndarray] = {}
    for i in np.flatnonzero(status == Status.OK.code):
        number = chunk.first + int(i)
        motion = integrate(member(case, number, case.time.samples))
        for name, values in motion.variables.items():
            size = (len(status), case.time.samples, *values.shape[1:])
            found.setdefault(name, np.full(size, np.nan))[i, : len(values)] = values[
                : case.time.samples
            ]
    return found
