"""The columns that a sweep stores of its members, from an ensemble of motions or from single
motions. If a sweep has grown since an earlier result, the members in that result are copied, and
only the others are computed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, Time, dump, parse_case
from ..cases.sweep_block import Axis, axes_of
from ..integration import Occurrence
from ..models import rigid_body
from ..models.base import LENGTHS, rescaled
from ..models.brake import time_of_release
from ..models.rigid_body import UNDETERMINED
from ..results.layout import (
    MEMBER,
    MEMBER_CLASSIFIED,
    MEMBER_EVENT,
    MEMBER_STOPPED,
    ON_REQUEST,
    Stored,
)
from ..storage import FinishedCase, Group, open_run
from .ensemble.motions import Ensemble, Outcome, Passages


def columns(case: Case) -> dict[str, Stored]:
    """All columns of the members of a sweep, by name. They include the variables of the model: at
    every sample where trajectories are stored, otherwise at the end."""
    model, is_sampled = case.system.equations, "trajectory" in case.store
    # Without samples a variable has no first dimension, which is the time.
    words, first = ("", 0) if is_sampled else (", at the end", 1)
    final = {
        name: Stored(f"{variable.long_name}{words}", variable.dims[first:], units=variable.units)
        for name, variable in model.variables.items()
        if is_sampled or name != "enclosed_axis"  # its label at the end is the column `end_axis`
    }
    reduced = MEMBER_CLASSIFIED | (MEMBER_STOPPED if model.may_stop else {})
    if model.form.no_axis_reason:
        reduced = dict(MEMBER_EVENT)
    return final | reduced | MEMBER


def stored_columns(case: Case) -> dict[str, Stored]:
    """The columns that the result stores, by name: `status` and the columns named in `store`, or
    all that are not in ON_REQUEST if `store` names none."""
    available, named = columns(case), set(case.store) - {"trajectory"}
    if named and "trajectory" in case.store:
        named |= set(case.system.equations.variables)  # their samples are the trajectory
    wanted = {"status"} | (named or available.keys() - ON_REQUEST)
    return {name: column for name, column in available.items() if name in wanted}


def lengths(case: Case, column: Stored) -> tuple[int, ...]:
    """The lengths of a column's dimensions, for one member."""
    return tuple(case.time.samples if dim == "time" else LENGTHS[dim] for dim in column.dims)


def blank_array(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """An array without values: nan, or 0 for whole numbers."""
    return np.full(shape, 0 if np.dtype(dtype).kind == "i" else np.nan, dtype)


def shape(case: Case) -> tuple[int, ...]:
    """The lengths of the axes of a sweep, in order."""
    return tuple(len(axis) for axis in axes_of(case.sweep or {}))


def event_columns(events: Mapping[int, Sequence[Occurrence]], n: int) -> dict[str, np.ndarray]:
    """The time (n,) of the last event of each of n members, and the axis (n,) that it leaves.
    `events` are the events of members, by their positions; members without events may be absent."""
    times, axes = np.full(n, math.nan), np.full(n, UNDETERMINED)
    for row, of_member in events.items():
        for last in of_member[-1:]:
            times[row], axes[row] = last.time, last.details.get("from", UNDETERMINED)
    return {"event_time": times, "event_from": axes}


def label_columns(
    start: np.ndarray,
    end: np.ndarray,
    member: np.ndarray,
    crossings: Mapping[str, np.ndarray],
    stop: np.ndarray,
    time: Time,
) -> dict[str, np.ndarray]:
    """The columns of the labels of n members: the axes at start and end, the first crossing of each
    member, and the share of the span in which each axis is enclosed.

    `start` and `end` (n,) are the enclosed axes at both ends. `crossings` are the columns (k,) of
    all crossings by name, in order of time, and `member` (k,) the positions of their members.
    `stop` (n,) are the times at which members stop, nan where they do not.
    """
    n = len(start)
    # The members that cross, and the position of the first crossing of each.
    crossed, first = np.unique(member, return_index=True)
    # A motion that starts on the separatrix leaves it at once. It then encloses the axis that its
    # first crossing leaves or, without a crossing, the axis at its end.
    after_start = end.copy()
    after_start[crossed] = crossings["crossing_from"][first]
    # Each interval in which a member encloses one axis begins at its start or at a crossing, and
    # ends where the next one begins or, for the last one, at the stop or the end.
    owner = np.concatenate((np.arange(n), member))
    axis = np.concatenate((np.where(start == 0, after_start, start), crossings["crossing_to"]))
    begin = np.concatenate((np.full(n, time.start), crossings["crossing_time"]))
    order = np.lexsort((begin, owner))
    owner, axis, begin = owner[order], axis[order], begin[order]
    is_last = np.diff(owner, append=n) != 0
    until = np.where(is_last, np.fmin(stop, time.end)[owner], np.roll(begin, -1))
    share = np.zeros((n, 3))
    counts = (axis > 0) & (axis <= 3) & (time.end > time.start)
    np.add.at(share, (owner[counts], axis[counts] - 1), (until - begin)[counts])
    filled = {
        "start_axis": start,
        "end_axis": end,
        "crossings": np.bincount(member, minlength=n),
        "share": share / max(time.end - time.start, math.ulp(0.0)),
    }
    for name, values in crossings.items():
        filled[name] = blank_array((n,), values.dtype)
        filled[name][crossed] = values[first]
    return filled


def reduced_ensemble(e: Ensemble, outcome: Outcome, time: Time) -> dict[str, np.ndarray]:
    """The columns (k,) of the k accepted motions of an ensemble, by name."""
    is_accepted, passed = outcome.accepted, outcome.accepted_passages
    # The numbers of the accepted motions, and the position of each of them among these.
    accepted, row = np.flatnonzero(is_accepted), np.cumsum(is_accepted) - 1
    # The ends are output as samples at a single time, which is `until`.
    end, exponent = outcome.state[:, accepted, None], outcome.exponent[accepted, None]
    member, until = row[passed.motion], np.full(len(accepted), float(e.span[1]))
    if e.event and e.event.terminal:
        until[member] = passed.time
    ends = output_of(e, accepted, until[:, None], end, exponent)
    final = {name: values[:, 0] for name, values in ends.items()}
    if e.times.size:
        samples, exponent = outcome.samples[:, accepted], outcome.sample_exponent[accepted]
        final |= output_of(e, accepted, e.times, samples, exponent)
    events = {int(row[i]): met for i, met in outcome.events.items() if is_accepted[i]}
    final |= event_columns(events, len(accepted)) | {"steps": outcome.steps[accepted]}
    if e.model.form.no_axis_reason:
        final["event_time"][member] = passed.time  # of several, the last one counts
        return final
    start_axis = enclosed(e, outcome.start_side[accepted])
    end_axis = enclosed(e, outcome.end_side[accepted])
    start_axis[e.at_rest[accepted]] = rigid_body.UNDETERMINED
    crossings = crossing_columns(e, passed)
    at_start = separation_at(e, accepted, e.start)
    at_end = separation_at(e, accepted, outcome.state)
    final["separation"] = np.minimum(at_start, at_end)
    if e.model.may_stop and e.is_timed:
        final["event_release"] = np.array([
            time_of_release(e.named(i), stop, e.span[1], outcome.state[:, i])
            for i, stop in zip(accepted, final["event_time"], strict=True)
        ])  # fmt: skip
    # Only the event of a brake stops a body; after any other event the motion goes on.
    stop = np.where(e.model.may_stop, final["event_time"], math.nan)
    return final | label_columns(start_axis, end_axis, member, crossings, stop, time)


def output_of(
    e: Ensemble, motions: np.ndarray, times: np.ndarray, states: np.ndarray, exponent: np.ndarray
) -> dict[str, np.ndarray]:
    """The variables (n, s, ...) by name of some motions (n,) at s times each, from their states (m,
    n, s) in units of 2**exponent (n, s). The `times` are (s,) for all motions or (n, s)."""
    y = rescaled(e.model, np.moveaxis(states, 0, -1), exponent)
    n, s = exponent.shape
    k, times = e.named(np.repeat(motions, s)), np.broadcast_to(times, (n, s)).ravel()
    flat = e.model.output(times, y.reshape(n * s, y.shape[-1]), k)
    return {name: values.reshape(n, s, *values.shape[1:]) for name, values in flat.items()}


def enclosed(e: Ensemble, side: np.ndarray) -> np.ndarray:
    """The axes (k,) that motions enclose on these sides (k,) of the separatrix; a side is the sign
    of the separatrix function D."""
    # An ensemble has one event at the separatrix, and so one order of the moments of inertia.
    order = rigid_body.inertia_order(e.inertia[:, 0])
    # For the sides -1, 0 and 1.
    axes = np.array([order[2] + 1, rigid_body.UNDETERMINED, order[0] + 1], dtype=np.int8)
    return np.asarray(axes[side.astype(int) + 1])


def separation_at(e: Ensemble, motions: np.ndarray, states: np.ndarray) -> np.ndarray:
    """The separations (k,) of some motions (k,) from the separatrix, from the states (m, n) of all
    n motions. It is a ratio, so the units of omega do not matter."""
    order = rigid_body.inertia_order(e.inertia[:, 0])
    apart = rigid_body.separation(e.inertia[:, motions], states[:3, motions], order)
    # With a rotor no surface separates the motions, and the value is infinite as for a sphere.
    return np.full_like(apart, np.inf) if "rotor" in e.model.terms else apart


def crossing_columns(e: Ensemble, passed: Passages) -> dict[str, np.ndarray]:
    """The columns (k,) of passages through the separatrix, by the names of CROSSING_COLUMNS."""
    G = e.inertia[:, passed.motion] * passed.state[:3]
    return {
        "crossing_time": passed.time,
        "crossing_error": passed.error,
        "crossing_from": enclosed(e, passed.before),
        "crossing_to": enclosed(e, passed.after),
        "crossing_G": np.ldexp(np.sqrt(np.square(G).sum(axis=0)), passed.exponent),
    }


@dataclass(frozen=True)
class Earlier:
    """An earlier result of a sweep that has grown since: its file, its name there, its attributes,
    and the present lengths of the axes.

    `indices` has an entry for each axis: the positions (n,) of its present values in the earlier
    result, -1 for new values; for a sphere the number of directions in the earlier result, which
    come first among the present ones.
    """

    file: Path
    name: str
    attributes: Mapping[str, Any]
    sizes: tuple[int, ...]
    indices: tuple[np.ndarray | int, ...]

    @property
    def members(self) -> int:
        """The number of members now."""
        return math.prod(self.sizes)

    @property
    def kept(self) -> int:
        """The number of present members that are in the earlier result."""
        return math.prod(
            before if isinstance(before, int) else int((before >= 0).sum())
            for before in self.indices
        )

    def positions(self, first: int, last: int) -> np.ndarray:
        """The positions (axes, n) in the earlier result of the members `first` to `last` - 1, with
        -1 on each axis whose value is new."""
        index = np.unravel_index(np.arange(first, last), self.sizes)
        return np.array([
            np.where(i < before, i, -1) if isinstance(before, int) else before[i]
            for before, i in zip(self.indices, index, strict=True)
        ])  # fmt: skip

    def holds(self, first: int, last: int) -> np.ndarray:
        """Whether (n,) each of the members `first` to `last` - 1 is in the earlier result."""
        return np.asarray((self.positions(first, last) >= 0).all(axis=0))

    def completed(self, case: Case, first: int, last: int, group: Group) -> Group:
        """The group of a chunk, filled in with the stored columns of the members that the earlier
        result holds. Raises HodoError if that result cannot be read or has been replaced."""
        taken = self.holds(first, last)
        if not taken.any():
            return group
        positions = self.positions(first, last)[:, taken]
        # The smallest box of the earlier result that has all these members.
        corner = positions.min(axis=1)
        box = tuple(map(slice, corner, positions.max(axis=1) + 1))
        variables = dict(group.variables)
        with open_run(self.file) as run:
            # Another run may have replaced the result, with members at other positions.
            if run.summary(self.name, ("hash",))["hash"] != self.attributes["hash"]:
                raise HodoError(f"{self.file}: another run has replaced {self.name}: run it again")
            for name, values in run.blocks(self.name, stored_columns(case), box):
                data = variables[name].data.copy()
                data[taken] = values[tuple(positions - corner[:, None])]
                variables[name] = replace(variables[name], data=data)
        return replace(group, variables=variables)


def earlier_result(case: Case, case_digest: str, stored: FinishedCase | None) -> Earlier | None:
    """The stored result of a sweep if its members can be copied, else None. They can if it has
    ended well, if its code and libraries are the present ones, and if its case differs only in the
    values along its axes, of which some are the same."""
    if stored is None or stored.attributes.get("status") != "ok":
        return None
    # A hash joins the digests of code, libraries and case; the first two must agree.
    code, stored_code = (
        digests.split("-")[:2] for digests in (case_digest, str(stored.attributes.get("hash")))
    )
    if code != stored_code:
        return None
    before = parse_case(str(stored.attributes["case"]))
    if before.sweep is None or case.sweep is None or [*before.sweep] != [*case.sweep]:
        return None
    if dump(replace(before, sweep=case.sweep), remarks=False) != dump(case, remarks=False):
        return None
    pairs = zip(axes_of(case.sweep), axes_of(before.sweep), strict=True)
    indices = [earlier_indices(*axes) for axes in pairs]
    known = tuple(of_axis for of_axis in indices if of_axis is not None)
    if len(known) < len(indices):
        return None
    with open_run(stored.file) as run:
        attributes = dict(run.summary(stored.name))
    earlier = Earlier(stored.file, stored.name, attributes, shape(case), known)
    if earlier.kept < attributes["members"]:
        if attributes.get("released"):
            return None  # of the members that would move again only the number is stored
        # Both include the costs of members that this sweep no longer has.
        left = {k: x for k, x in attributes.items() if k not in ("steps", "run_time")}
        return replace(earlier, attributes=left | {"members": earlier.kept})
    return earlier


def earlier_indices(axis: Axis, before: Axis) -> np.ndarray | int | None:
    """The entry of `Earlier.indices` for an axis; None if the earlier axis has other keys, or no
    value in common."""
    if axis.sphere is not None and before.sphere is not None:
        is_prefix = axis.sphere["seed"] == before.sphere["seed"] and len(before) <= len(axis)
        return len(before) if is_prefix else None
    if axis.sphere or before.sphere or axis.keys != before.keys:
        return None
    # Values must agree to the last bit: a linspace with a third of the step repeats many exactly.
    positions = {values: i for i, values in enumerate(values_along(before))}
    indices = np.array([positions.get(values, -1) for values in values_along(axis)])
    return indices if (indices >= 0).any() else None


def values_along(axis: Axis) -> Iterator[tuple[float, ...]]:
    """The values of all keys of an axis, one tuple for each position."""
    return zip(*(axis.values(i).tolist() for i in range(len(axis.keys))), strict=True)
