"""A chunk of members, integrated: the task of a pool."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from time import thread_time
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..engines.protocol import Status
from ..integration import (
    Classification,
    Trajectory,
    body_of,
    classify,
    integrate,
    label_at_start,
    own_crossings,
    sample_times,
)
from ..models.base import attributes, flatten
from ..models.brake import time_of_release
from ..models.rigid_body import inertia_order, separation
from ..results.layout import CROSSING_COLUMNS, columns_of
from ..storage import Attribute, Group, Variable
from .columns import (
    Earlier,
    blank_array,
    columns,
    event_columns,
    label_columns,
    lengths,
    reduced_ensemble,
    shape,
)
from .ensemble.advance import advance, measure_crossings
from .ensemble.motions import Rejection
from .members import (
    may_hide_in_time,
    member,
    other_method,
    prepare,
    system_of_member,
)

LARGEST_CHUNK, SMALLEST_CHUNK = 32768, 256
"""The numbers of members of a chunk. The columns of the largest chunk fit a processor's cache. The
columns of the smallest are so long that the costs of a call of numpy and of a file of HDF5 do not
count."""

MEMBERS_ALONE = 64
"""The most members of a chunk if each is integrated alone, which takes milliseconds each."""

MOST_SAMPLED = 1 << 21
"""The most numbers in the samples of a chunk that stores trajectories: some five copies of them are
in memory at once."""

WORTH_COMPILING = 250
"""The step of averaged equations is compiled only for at least this many members per constant.
Compiling takes seconds, and a member alone takes about a millisecond."""


@dataclass(frozen=True)
class Chunk:
    """The members `first` to `last` - 1 of a sweep, in the order in which the last axis varies
    fastest. Members that an `earlier` result holds are not computed."""

    case: Case
    first: int
    last: int
    earlier: Earlier | None = None

    @property
    def taken(self) -> np.ndarray:
        """Which of its members (n,) an earlier result holds."""
        if self.earlier is None:
            return np.zeros(self.last - self.first, dtype=bool)
        return self.earlier.holds(self.first, self.last)

    def completed(self, computed: Group) -> Group:
        """The computed columns, filled in with the members that an earlier result holds. Raises
        HodoError if that result cannot be read any more."""
        if self.earlier is None:
            return computed
        return self.earlier.completed(self.case, self.first, self.last, computed)


def chunks(case: Case, earlier: Earlier | None = None) -> Iterator[Chunk]:
    """The chunks of a sweep. Their limits depend on the case alone, so that another run finds the
    same chunks."""
    sizes = shape(case)
    # Rounded up. Chunks of a sixteenth of the members are enough for several processes.
    sixteenth = -(-math.prod(sizes) // 16)
    most = min(LARGEST_CHUNK, max(SMALLEST_CHUNK, sixteenth))
    if reason_alone(case):  # its members are integrated one by one
        most = min(most, MEMBERS_ALONE)
    if "trajectory" in case.store:
        numbers_of_member = case.time.samples * len(case.system.equations.state)
        most = min(most, max(1, MOST_SAMPLED // numbers_of_member))
    for first, last in boxes(sizes, most):
        yield Chunk(case, first, last, earlier)


def boxes(sizes: tuple[int, ...], most: int) -> Iterator[tuple[int, int]]:
    """Cut an array of these sizes into boxes of at most `most` members, each a number of whole rows
    or a part of one row. Yields the first member of each box and the one after its last."""
    # A row of an axis holds the members at one position along it. Boxes are cut along the first
    # axis of which at least one row fits into a box.
    axis = next(i for i in range(len(sizes)) if math.prod(sizes[i + 1 :]) <= most)
    row, length = math.prod(sizes[axis + 1 :]), sizes[axis]
    count = -(-length // (most // row))
    # Boxes of equal size, as far as whole rows allow.
    edges = [length * i // count * row for i in range(count + 1)]
    for begin in range(0, math.prod(sizes), length * row):
        for low, high in pairwise(edges):
            yield begin + low, begin + high


def reason_alone(case: Case) -> str:
    """Why each member of a sweep is integrated alone: its method or its model requires it, or the
    members are too few to be worth the compilation of a step. Empty if they are integrated side by
    side."""
    if other := other_method(case):
        return other
    if may_hide_in_time(case.system):
        return "formulas that may change within a step"
    # The step of a body compiles in a short time.
    is_body = case.system.starts_with_omega
    fewest = 0 if is_body else WORTH_COMPILING * len(flatten(case.system.constants))
    too_few = math.prod(shape(case)) < fewest
    return f"fewer than {fewest} members are not worth compiling their step" if too_few else ""


def compute(chunk: Chunk) -> Group:
    """The columns of the members of a chunk: the task of a pool. The attribute `rejections` counts,
    by `Rejection`, the members that were integrated alone."""
    began = thread_time()
    case, taken = chunk.case, chunk.taken
    group = blank_group(case, len(taken), Status.INVALID)
    values = {name: variable.data for name, variable in group.variables.items()}
    # Where no ensemble is tried, the code of each member to compute is 1, which then names no
    # `Rejection`.
    rejection = np.where(taken, 0, 1) if reason_alone(case) else integrate_together(chunk, values)
    # An ensemble integrates by Taylor series.
    methods = {"taylor"} if (values["status"] == Status.OK.code).any() else set()
    alone, problem = np.flatnonzero(rejection), ""
    for i in alone.tolist():
        status, method, reduced = integrated_alone(case, chunk.first + i)
        values["status"][i] = status.code
        if reduced:
            methods.add(method)
        else:
            problem = problem or method
        fill_rows(values, [i], reduced)
    attributes: dict[str, Attribute] = {
        "run_time": thread_time() - began,
        "rejections": np.bincount(rejection[alone], minlength=len(Rejection)),
        "methods": " ".join(sorted(methods)),
        "problem": problem,
    }
    return replace(group, attributes=attributes)


def lost_chunk(chunk: Chunk) -> Group:
    """The columns of a chunk whose worker failed: all its members count as failed, except members
    of an earlier result."""
    return chunk.completed(blank_group(chunk.case, chunk.last - chunk.first, Status.FAILED))


def blank_group(case: Case, n: int, status: Status) -> Group:
    """The columns of n members of one status, without any other values."""
    variables = {
        name: Variable(
            ("member", *column.dims), blank_array((n, *lengths(case, column)), column.dtype)
        )
        for name, column in columns(case).items()
    }
    variables["status"].data[:] = status.code
    none = np.zeros(len(Rejection), dtype=int)
    return Group({"run_time": 0.0, "rejections": none, "methods": "", "problem": ""}, variables)


def fill_rows(
    values: Mapping[str, np.ndarray], rows: Any, reduced: Mapping[str, np.ndarray]
) -> None:
    """Copy the `reduced` columns of some members to their `rows` of the sweep's columns `values`,
    for the columns that the sweep has."""
    for name in values.keys() & reduced.keys():
        values[name][rows] = reduced[name]


def integrate_together(chunk: Chunk, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Fill in `values` for the members whose motions an ensemble accepts. Returns the code (n,) of
    the `Rejection` of each member, 0 for an accepted member and for one without a body or a
    start."""
    case, rejection = chunk.case, np.zeros(chunk.last - chunk.first, dtype=np.int64)
    computed = np.flatnonzero(~chunk.taken)
    if not computed.size:
        return rejection
    times = sample_times(case) if "trajectory" in case.store else np.empty(0)
    for group in prepare(case, chunk.first + computed):
        positions = computed[group.members]
        # Only some groups have an event with a passage: the events depend on the members' data.
        if times.size and group.passage_event:
            rejection[positions] = Rejection.SAMPLES.code
            continue
        e = replace(group, times=times)
        outcome = advance(e)
        measure_crossings(e, outcome)
        accepted = positions[outcome.accepted]
        values["status"][accepted] = Status.OK.code
        if accepted.size:
            fill_rows(values, accepted, reduced_ensemble(e, outcome, case.time))
        rejection[positions] = outcome.rejection
    return rejection


def integrated_alone(case: Case, number: int) -> tuple[Status, str, dict[str, np.ndarray]]:
    """The status, the method and the columns (1,) of one member, integrated as a single case. If
    its data describe no body or no start, or if the integration does not reach its end, there are
    no columns, and the reason takes the place of the method."""
    samples = None if "trajectory" in case.store else 2
    single = member(case, number, samples)
    if not system_of_member(case, single.data):
        return Status.INVALID, "", {}
    if not (case.system.no_axis_reason or case.system.is_quadrature):
        # Its crossings need the error of the motion. If an ensemble has rejected it, the error is
        # measured even where the case does not ask for one; `member` asks for none.
        is_rejected = not reason_alone(case)
        single = replace(single, error=case.error or is_rejected)
    try:
        motion = integrate(single)
        if motion.status is not Status.OK:
            return motion.status, motion.message, {}
        status, columns = labels_alone(motion)
    except HodoError as error:
        return Status.FAILED, str(error), {}
    if "trajectory" in case.store:
        columns |= sampled(motion)
    return status, motion.method, columns | {"steps": np.array([motion.steps])}


def labels_alone(motion: Trajectory) -> tuple[Status, dict[str, np.ndarray]]:
    """The status `ok`, or `undecided` if labels are uncertain, and the columns (1,) of a single
    case: its variables at the end, its last event, its labels and its crossings."""
    case, variables = motion.case, motion.variables
    columns = {name: values[-1:] for name, values in variables.items()}
    columns |= event_columns({0: motion.events}, 1)
    if case.system.equations.may_stop:
        k, stop = attributes(case.system.constants), columns["event_time"][0]
        release = time_of_release(k, stop, case.time.end, motion.state[-1].astype(float))
        columns["event_release"] = np.array([release])
    if case.system.no_axis_reason:
        return Status.OK, columns
    if case.system.is_quadrature:
        found = Classification(variables["enclosed_axis"], tuple(own_crossings(motion)))
    else:
        found = classify(case, motion.method, motion.tol, motion.error, variables["omega"])
        columns["separation"] = least_separation_alone(motion)
    labels, crossings = found.labels, [*found.crossings]
    start = np.array([label_at_start(case, motion.time[0], labels, crossings)])
    member = np.zeros(len(crossings), dtype=np.int64)
    arrays = {name: x.data for name, x in columns_of(CROSSING_COLUMNS, crossings).items()}
    # A body that a brake has stopped has samples at rest after its stop.
    stop = columns["event_time"] if case.system.equations.may_stop else motion.time[-1:]
    columns |= label_columns(start, labels[-1:], member, arrays, stop, case.time)
    return Status.UNDECIDED if found.hidden else Status.OK, columns


def least_separation_alone(motion: Trajectory) -> np.ndarray:
    """The separation (1,) from the separatrix at the start or the end of a single case, the smaller
    of the two; infinite where there is no separatrix."""
    body = body_of(motion.case)
    ends = np.array([body.initial_state[:3], motion.state[-1, :3].astype(float)])
    apart = separation(body.moments, ends.T, inertia_order(body.moments)).min(keepdims=True)
    return np.full(1, np.inf) if body.no_separatrix_reason else apart


def sampled(motion: Trajectory) -> dict[str, np.ndarray]:
    """The variables (1, s, ...) of a motion at the s samples of its case; blank after an event has
    ended it."""
    times = sample_times(motion.case)
    # Which sample times the motion has reached, and which of its times are sample times.
    reached, asked = np.isin(times, motion.time), np.isin(motion.time, times)
    filled = {}
    for name, values in motion.variables.items():
        filled[name] = blank_array((1, len(times), *values.shape[1:]), values.dtype)
        filled[name][0, reached] = values[asked]
    return filled
