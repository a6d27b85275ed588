"""A chunk of members, integrated: the task of a pool."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, Time
from ..engines.protocol import Status, have_taylor
from ..integration.classify import classify
from ..integration.integrate import integrate
from ..models import rigid_body
from ..models.constants import Structure, namespace
from ..results.hdf5 import Attribute, Group, Variable
from . import ensemble
from .columns import columns, shape
from .ensemble import Ensemble, Outcome
from .members import member, member_inputs, starts

CHUNK = 16384


@dataclass(frozen=True)
class Chunk:
    """The members `first` to `last` - 1 of a sweep, in the order in which the last axis varies
    fastest."""

    case: Case
    first: int
    last: int


def chunks(case: Case) -> Iterator[Chunk]:
    """The tasks of a sweep. They depend on the case alone, so that another run finds the same."""
    total = math.prod(shape(case))
    size = min(CHUNK, max(256, -(-total // 16)))
    if not carried(case) or "trajectory" in case.store:
        size = min(size, 64)
    for first in range(0, total, size):
        yield Chunk(case, first, min(first + size, total))


def carried(case: Case) -> bool:
    """Whether lanes can carry the members: the method is theirs, and the model has units and a
    separatrix."""
    system = case.system
    fit = case.method in ("auto", "taylor") and case.precision == "double" and have_taylor()
    fit &= case.max_steps is None and case.max_seconds is None  # single cases heed these
    return fit and bool(system.degree) and not system.unclassifiable and not system.run_events


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
    left = _in_lanes(chunk, values) if carried(case) else np.arange(n)
    for i in left:
        if values["status"][i] != Status.INVALID.code:
            _alone(
                case,
                chunk.first + int(i),
                {name: column[i : i + 1] for name, column in values.items()},
            )
    dims = {name: ("member", *column.dims) for name, column in columns(case).items()}
    if "trajectory" in case.store:
        values |= (paths := _trajectories(chunk, values["status"]))
        dims |= {name: ("member", "time", *dims[name][1:]) for name in paths}
    attributes: dict[str, Attribute] = {"run_time": perf_counter() - began, "alone": len(left)}
    return Group(attributes, {name: Variable(dims[name], data) for name, data in values.items()})


def _in_lanes(chunk: Chunk, values: dict[str, np.ndarray]) -> np.ndarray:
    """Fill in the members that lanes settle; returns the places of the others."""
    case, model = chunk.case, type(chunk.case.system)
    found, place, direction = member_inputs(case, np.arange(chunk.first, chunk.last))
    codes = [(Status.OK if given.start else Status.INVALID).code for given in found]
    values["status"][:] = np.array(codes)[place]
    left = values["status"] == Status.OK.code
    kinds: dict[tuple[Structure, tuple[int, int, int]], list[int]] = {}
    for i, given in enumerate(found):
        if given.start is not None:
            kinds.setdefault((given.structure, given.order), []).append(i)
    for (form, order), alike in kinds.items():
        here = np.flatnonzero(np.isin(place, alike))
        among = np.searchsorted(alike, place[here])
        constants = np.array([found[i].constants for i in alike]).T[:, among]
        start = starts(
            [found[i] for i in alike], among, None if direction is None else direction[here]
        )
        (event,) = model(**found[alike[0]].data).class_events
        span = (case.time.start, case.time.end)
        outcome = ensemble.advance(
            Ensemble(model, form, constants, start, span, order, event), case.tol
        )
        _enter(case, form, constants, order, outcome, here, values)
        left[here[outcome.settled]] = False
    return np.flatnonzero(left)


def _enter(
    case: Case, form: Structure, constants: np.ndarray, order: tuple[int, int, int], outcome: Outcome,
    here: np.ndarray, values: dict[str, np.ndarray],
) -> None:  # fmt: skip
    """Enter the settled motions of an ensemble at their places."""
    well = outcome.settled
    k = namespace(form, [row[:, None] for row in constants])
    for name, state in case.system.output(np.array([case.time.end]), outcome.state.T, k).items():
        values[name][here[well]] = np.ldexp(state, outcome.exponent[:, None])[well]
    crossings = outcome.crossings
    names = np.array([order[2] + 1, rigid_body.UNDETERMINED, order[0] + 1], dtype=np.int8)
    start_axis, end_axis = (names[side.astype(int) + 1] for side in (outcome.first, outcome.last))
    first, at = np.unique(crossings.motion, return_index=True)
    after = names[np.where(crossings.rises[at], 2, 0)]
    entries = {
        "start_axis": start_axis,
        "end_axis": end_axis,
        "crossings": np.bincount(crossings.motion, minlength=len(well)),
        "steps": outcome.steps,
        "separation": outcome.separation,
        "share": _shares(case.time, order, outcome),
    }
    for name, column in entries.items():
        values[name][here[well]] = column[well]
    for name, column in (("crossing_time", crossings.time), ("crossing_G", crossings.momentum)):
        values[name][here[first]] = column[at]
    values["crossing_to"][here[first]] = after
    values["crossing_from"][here[first]] = names[0] + names[2] - after


def _shares(time: Time, order: tuple[int, int, int], outcome: Outcome) -> np.ndarray:
    """The part of the span (n, 3) for which D > 0, for the axis of largest inertia, and D < 0, for
    the smallest."""
    span = time.end - time.start
    above = np.where(outcome.last > 0, time.end, 0) - np.where(outcome.first > 0, time.start, 0)
    turns = np.where(outcome.crossings.rises, -1, 1) * outcome.crossings.time
    above = above + np.bincount(outcome.crossings.motion, turns, minlength=len(above))
    share = np.zeros((len(above), 3))
    if span > 0:
        share[:, order[0]] = np.clip(above / span, 0, 1)
        share[:, order[2]] = 1 - share[:, order[0]]
    share[outcome.first == 0] = 0
    return share


def _alone(case: Case, number: int, values: dict[str, np.ndarray]) -> None:
    """Integrate one member as a single case, and enter it in rows of length one."""
    model, one = type(case.system), member(case, number)
    if any(model.check(one.data)):
        values["status"][0] = Status.INVALID.code
        return
    if not model.unclassifiable:
        one = replace(one, error=case.error)
    try:
        motion = integrate(one)
        values["status"][0] = motion.status.code
        values["steps"][0] = motion.steps
        if motion.status is not Status.OK:
            return
        for name, variable in motion.variables.items():
            values[name][0] = variable[-1]
        if motion.events and model.unclassifiable:
            values["event_time"][0] = motion.events[-1].time
        if not model.unclassifiable:
            found = classify(
                one, motion.method, motion.tol, motion.error, motion.variables["omega"]
            )
            _enter_one(one, found.labels, found.crossings, values)
    except HodoError:
        values["status"][0] = Status.FAILED.code


def _enter_one(
    case: Case, labels: np.ndarray, crossings: Any, values: dict[str, np.ndarray]
) -> None:
    """Enter what `classify` says of a single case."""
    values["start_axis"][0], values["end_axis"][0] = labels[0], labels[-1]
    values["crossings"][0] = len(crossings)
    ends = [case.time.start, *(c.time for c in crossings), case.time.end]
    axes = [labels[0], *(c.end for c in crossings)] if crossings else [labels[0]]
    values["share"][0] = 0
    for axis, start, end in zip(axes, ends[:-1], ends[1:], strict=True):
        if axis > 0 and case.time.end > case.time.start:
            values["share"][0, axis - 1] += (end - start) / (case.time.end - case.time.start)
    A = np.array(case.data["inertia"])[:, None]
    omega = np.stack([case.system.start, values["omega"][0]], axis=-1)
    values["separation"][0] = ensemble.sides(
        A + 0 * omega, omega, rigid_body.inertia_order(A[:, 0])
    )[1].min()
    if crossings:
        first = crossings[0]
        values["crossing_time"][0], values["crossing_G"][0] = first.time, first.momentum
        values["crossing_from"][0], values["crossing_to"][0] = first.start, first.end


def _trajectories(chunk: Chunk, status: np.ndarray) -> dict[str, np.ndarray]:
    """The stored variables at every sample (n, samples, ...); nan from where a motion ended."""
    case = chunk.case
    found: dict[str, np.ndarray] = {}
    for i in np.flatnonzero(status == Status.OK.code):
        motion = integrate(member(case, chunk.first + int(i), case.time.samples))
        for name, values in motion.variables.items():
            size = (len(status), case.time.samples, *values.shape[1:])
            found.setdefault(name, np.full(size, np.nan))[i, : len(values)] = values[
                : case.time.samples
            ]
    return found
