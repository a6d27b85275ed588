"""Sweeps: a case with a `sweep:` block is an ensemble of single cases, each reduced to a few
numbers.

The members are computed in chunks, which are the tasks of a pool. Each finished chunk is stored in
a file, so that a killed run can be continued, and only a few chunks are in memory at a time.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..batch import Pool
from ..cases.case import Case
from ..cases.keys import keys_of
from ..cases.sweep_block import axes_of, path_of
from ..engines.protocol import EPS, IVP, Status
from ..integration import excess_remark, sample_times
from ..progress import Progress
from ..results.layout import TIME, Stored, case_attributes, inner_coordinates, with_units
from ..schema.kinds import Rule
from ..storage import (
    Attribute,
    Group,
    StreamedVariables,
    Variable,
    chunk_name,
    chunks_of,
    folder_of,
    open_run,
    put_part,
)
from .chunk import LARGEST_CHUNK, Chunk, chunks, compute, lost_chunk, reason_alone
from .columns import Earlier, lengths, shape, stored_columns
from .ensemble.motions import Rejection
from .summary import ERROR_TASKS, Summary, sampled_errors


def run_sweep(
    case: Case,
    case_digest: str,
    path: Path,
    pool: Pool,
    resume: bool,
    progress: Progress,
    earlier: Earlier | None = None,
) -> Group:
    """Compute a sweep; returns the group of its result file.

    Members of an `earlier` result are kept and, with `resume`, chunks that a run with the same
    digest has stored. `progress` receives the finished share. A chunk that fails raises nothing;
    its members count as failed in the attributes.
    """
    stored = chunks_of(path, case_digest) if resume else {}
    tasks = list(chunks(case, earlier))
    problems: Counter[str] = Counter()
    lost: set[int] = set()
    if stored:
        progress.detail(f"{case.name}: {len(stored)} of {len(tasks)} chunks are kept")

    def finished(chunk: Chunk) -> Group:
        """The columns of a chunk that has been stored or lost."""
        if chunk.first in lost:
            return lost_chunk(chunk)
        file = folder_of(path) / chunk_name(case_digest, chunk.first)
        with suppress(HodoError), open_run(file) as part:
            return part.read("part")
        # Its file is missing where another run of the same sweep has ended and removed the chunks:
        # compute it again.
        return chunk.completed(compute(chunk))

    def groups() -> Iterator[tuple[Chunk, Group]]:
        """The chunks with their columns: those that are stored, then the others as they finish."""
        yield from ((chunk, finished(chunk)) for chunk in tasks if chunk.first in stored)
        missing = [chunk for chunk in tasks if chunk.first not in stored]
        for chunk, outcome in pool.map(compute, missing):
            if isinstance(outcome, Exception):
                # Only the members of this chunk are lost that no earlier result holds. The sweep
                # continues and reports their number.
                problems[str(outcome)] += int(np.count_nonzero(~chunk.taken))
                lost.add(chunk.first)
                yield chunk, lost_chunk(chunk)
            else:
                group = chunk.completed(outcome)
                put_part(path, chunk_name(case_digest, chunk.first), {"part": group})
                yield chunk, group

    summary = Summary(case, tasks[-1].last, earlier.attributes if earlier else {})
    # The share of the chunks in the progress: a task that measures errors takes about as long.
    of_chunks = len(tasks) / (len(tasks) + (ERROR_TASKS if case.error else 0))
    progress.report(case.name, 0.0)
    for i, (chunk, group) in enumerate(groups(), 1):
        summary.add(chunk, group)
        progress.report(case.name, of_chunks * i / len(tasks))

    def report(share: float) -> None:
        progress.report(case.name, of_chunks + (1 - of_chunks) * share)

    errors: Mapping[str, Attribute] = {"error": math.nan, "error_kind": "none"}
    if case.error:
        errors = sampled_errors(pool, summary, report)
    attributes = sweep_attributes(case, case_digest, summary, problems, errors)
    return group_of_columns(case, attributes, tasks, finished)


def group_of_columns(
    case: Case,
    attributes: Mapping[str, Attribute],
    tasks: Sequence[Chunk],
    finished: Callable[[Chunk], Group],
) -> Group:
    """A sweep as a group, with its axes as dimensions. The variables are read from the chunks when
    the group is written, so that memory never holds all of them; `finished` gives the columns of a
    chunk."""
    sizes, stored = shape(case), stored_columns(case)
    axes = axes_of(case.sweep or {})
    names, variables = [axis.name for axis in axes], coordinates(case)
    for name, column in stored.items():
        # A broadcast zero has the shape and type of an array without its memory.
        outline = np.broadcast_to(np.zeros((), column.dtype), (*sizes, *lengths(case, column)))
        variables[name] = Variable((*names, *column.dims), outline, column.attrs)
    variables |= inner_coordinates(variables.values())

    def fill() -> Iterator[tuple[str, Any, np.ndarray]]:
        """The blocks of the variables, as the name, the place in the variable and the values."""
        yield from directions(case)
        for task in tasks:
            where, group = box(sizes, task.first, task.last), finished(task)
            for name in stored:
                data = group.variables[name].data
                edges = [along.stop - along.start for along in where]
                yield name, where, data.reshape(*edges, *data.shape[1:])

    vectors = {f"{axis.name}_vector" for axis in axes if axis.sphere}
    late = StreamedVariables(frozenset(stored) | vectors, fill)
    return Group(attributes, with_units(variables, case), late)


def sweep_attributes(
    case: Case,
    case_digest: str,
    summary: Summary,
    problems: Mapping[str, int],
    errors: Mapping[str, Attribute],
) -> dict[str, Attribute]:
    """The attributes of the group of a sweep, including those in `errors`. `problems` counts the
    members that chunks have lost, by message."""
    ok, failed, timeout, invalid, undecided = summary.status.tolist()  # in the order of `Status`
    total = ok + failed + timeout + invalid + undecided
    status = Status.FAILED if failed or not ok + undecided else Status.OK
    if status is Status.OK and timeout:
        status = Status.TIMEOUT
    remarks = {
        "are invalid: their numbers give no body or no start, or need other equations": invalid,
        "are undecided: their error is larger than their distance from the separatrix": undecided,
        "stay at rest here although other torques would move them again: from `event_release` on, "
        "if `store` names it": summary.released,
    } | {f"have no measured error: {why}": n for why, n in summary.unmeasured.items()}
    tol = case.tol or IVP.get(case.method, EPS)
    warnings = [f"{n} of {total} members {outcome}" for outcome, n in remarks.items() if n]
    warnings += excess_remark(case, float(errors["error"]), tol)
    endings = {"failed": failed, "stopped at max_steps or max_seconds": timeout}
    messages = [f"{count} of {total} members: {message}" for message, count in problems.items()]
    messages += [f"{n} of {total} members {outcome}" for outcome, n in endings.items() if n]
    if summary.problem:
        messages.append(f"the first of them: {summary.problem}")
    if not messages and not ok + undecided:
        messages = ["no member is a body with a start under the case's equations"]
    if summary.released:  # stored, so that a grown sweep adds its own to it
        errors = {**errors, "released": summary.released}
    return case_attributes(
        case,
        case_digest,
        method=", ".join(sorted(summary.methods)) or case.method,
        method_reason=method_reason(case, summary),
        members=total,
        tol=tol,
        steps=summary.steps,
        run_time=summary.run_time,
        status=status,
        message="; ".join(messages),
        warnings="\n".join(warnings),
        **errors,
    )


def method_reason(case: Case, summary: Summary) -> str:
    """How many members of a sweep were integrated side by side and how many alone, and why."""
    total, alone = summary.status.sum(), summary.alone[1:].sum()
    named = zip(summary.alone.tolist(), Rejection, strict=True)
    why = "; ".join(f"{count}: {rejection}" for count, rejection in named if rejection and count)
    details = f" ({why})" if why else ""
    if not_together := reason_alone(case):
        reason = f"each by itself: {not_together}"
    else:
        reason = f"side by side, {alone} of {total} members by themselves{details}"
    if taken := summary.earlier.get("members", 0):
        reason = f"{taken} of {total} members from an earlier run, the others {reason}"
    return reason


def coordinates(case: Case) -> dict[str, Variable]:
    """The coordinates of a sweep by name: the values along each axis, or for a sphere only the
    shape of its directions; and the times of the samples where trajectories are stored."""
    variables: dict[str, Variable] = {}
    for axis in axes_of(case.sweep or {}):
        if axis.sphere is not None:
            vectors = Stored("direction of G at the start", (axis.name, "axis"))
            outline = np.broadcast_to(0.0, (len(axis), 3))  # see `directions`
            variables[f"{axis.name}_vector"] = vectors.holding(outline)
        else:
            for i, key in enumerate(axis.keys):
                stored = Stored(key, (axis.name,), units=stated_unit(case, key))
                variables[key] = stored.holding(axis.values(i))
    if "trajectory" in case.store:
        variables["time"] = TIME.holding(sample_times(case))
    return variables


def directions(case: Case) -> Iterator[tuple[str, slice, np.ndarray]]:
    """Yield the directions along each sphere in blocks, as the variable, a slice of the axis and an
    array (n, 3): a million drawn at once would take 100 MB."""
    spheres = [axis for axis in axes_of(case.sweep or {}) if axis.sphere]
    for axis in spheres:
        for first in range(0, len(axis), LARGEST_CHUNK):
            last = min(first + LARGEST_CHUNK, len(axis))
            yield f"{axis.name}_vector", slice(first, last), axis.directions(np.arange(first, last))


def stated_unit(case: Case, name: str) -> str:
    """The unit of a swept key, in words. For an angle it is the radian, whatever unit the case file
    has."""
    _, keys = keys_of(case.model, case.form)
    unit = "1"
    # Follow the path through nested keys. An index is no key, so an entry of a list has the unit of
    # the list.
    for name_of_key in map(str, path_of(name)):
        if key := keys.get(name_of_key):
            unit, keys = key["unit"], keys_inside(key)
    return unit


def keys_inside(rule: Rule) -> dict[str, Rule]:
    """The keys, with their rules, of all mappings that a rule allows, as a value or as an entry of
    a list."""
    tables = [rule.get("properties", {}), *rule.get("tables", {}).values()]
    inner = [*rule.get("anyOf", ()), *([rule["items"]] if "items" in rule else ())]
    return dict(chain.from_iterable(x.items() for x in (*tables, *map(keys_inside, inner))))


def box(sizes: tuple[int, ...], first: int, last: int) -> tuple[slice, ...]:
    """The box of the members `first` to `last` - 1 in an array of these sizes, as a slice of each
    axis."""
    corners = zip(np.unravel_index(first, sizes), np.unravel_index(last - 1, sizes), strict=True)
    return tuple(slice(int(low), int(high) + 1) for low, high in corners)
