"""Sweeps: a case with a `sweep:` block, as an ensemble of single cases that are reduced to a few numbers each.

The members go in chunks, which are the tasks of a pool. Each finished chunk is stored by itself, so that a run that
is killed goes on from there, and no more than a few of them are in memory at a time.
"""

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .batch.pool import Pool
from .cases.case import Case, dump
from .cases.sweep_block import axes_of
from .integration.driver import Path
from .integration.error import difference, references
from .integration.solve import solve
from .members import FAILED, OK, STATUS, Chunk, carried, chunks, columns, compute, kept, member, shape
from .models import find, rigid_body
from .models.constants import flatten, namespace, structure
from .results.hdf5 import Attribute, Group, Late, Variable
from .results.writer import Writer

SAMPLE, NEAREST = 256, 64
"""Members whose error is measured: drawn at random, and nearest to the separatrix."""

LEVELS = (0.5, 0.9, 0.99, 1.0)
"""Of the errors, these quantiles are stored."""


class Probe(NamedTuple):
    """Members whose error is to be measured, with what is stored of them."""

    case: Case
    members: list[int]
    omega: np.ndarray
    crossing_time: np.ndarray


def probe(task: Probe) -> list[tuple[float, float, str]]:
    """The error of the final state and of the first crossing of each member, and against what they are measured."""
    return [_probe(task.case, *each) for each in zip(*task[1:], strict=True)]


def _probe(case: Case, number: int, omega: np.ndarray, crossing: float) -> tuple[float, float, str]:
    """The error of a crossing is |D / (dD/dt)| where the reference stands at that time: a step of Newton's method."""
    one = member(case, number)
    end = np.array([case.time.end])
    times = np.append(crossing, end) if crossing < case.time.end else end
    for precision, method, tol in references(one, "taylor", case.tol or 2.0**-52):
        reference = solve(one, method, precision, tol, times)
        if reference.stop:
            continue
        path = reference.path
        theirs = Path(end, path.state[-1:], path.exponent[-1:], ())
        error = difference(one, Path(end, omega[None], np.zeros(1, dtype=np.int64), ()), theirs)["omega"]
        off = math.nan if len(times) == 1 else _newton(one, path.state[0], int(path.exponent[0]))
        return error, off, precision if tol is None else "refined"
    return math.nan, math.nan, "none"


def _newton(case: Case, state: np.ndarray, exponent: int) -> float:
    """|D / (dD/dt)| at a state in units of 2**exponent."""
    model = find(case.model, case.form)
    A = np.array(case.data["inertia"])
    constants = model.constants(case.data)
    order = rigid_body.inertia_order(A)
    (outer, inner), k = rigid_body.separatrix_terms(A, state, order), namespace(structure(constants), flatten(constants))
    omega = np.ldexp(state.astype(float), exponent)
    rate = np.ldexp(np.array(model.rhs(0.0, list(omega), k)), -exponent)
    w = state.astype(float)
    faster, slower = (np.subtract(*rigid_body.separatrix_terms(A, w + sign * rate, order)) for sign in (1, -1))
    return abs(float(outer - inner) / (float(faster - slower) / 2))


Say = Callable[[str], None]


def run(case: Case, mark: str, pool: Pool, writer: Writer, resume: bool, say: Say) -> Group:
    """All members of a sweep; the chunks of an earlier run with the same `mark` are taken over if `resume`.

    Raises HodoError if no member came to anything.
    """
    stamp = hashlib.sha256(mark.encode()).hexdigest()[:16]
    parts = writer.parts(stamp) if resume else set()
    tasks = list(chunks(case))
    problems: dict[str, int] = {}
    if parts:
        say(f"{case.name}: {len(parts)} of {len(tasks)} chunks are kept")
    for chunk, outcome in pool.map(compute, [task for task in tasks if task.first not in parts]):
        if isinstance(outcome, Exception):
            problems[str(outcome)] = problems.get(str(outcome), 0) + chunk.last - chunk.first
        else:
            writer.add_part(stamp, chunk.first, outcome)
    done = writer.parts(stamp)

    @contextmanager
    def read(chunk: Chunk) -> Iterator[Part]:
        if chunk.first not in done:
            lost = _lost(chunk)
            yield Part(lost.attributes, lambda name: lost.variables[name].data)
        else:
            with writer.part(stamp, chunk.first) as part:
                yield Part(part.summary("part"), partial(part.array, "part"))

    summary = _summary(case, tasks, read)
    errors = _errors(case, pool, summary) if case.error == "on" and carried(case) else {}
    return _group(case, mark, tasks, read, summary, errors, problems)


class Part(NamedTuple):
    """A finished chunk: its attributes, and each of its variables when it is asked for."""

    attributes: Mapping[str, Any]
    variable: Callable[[str], np.ndarray]


Read = Callable[[Chunk], AbstractContextManager[Part]]


def _lost(chunk: Chunk) -> Group:
    """A chunk whose worker failed."""
    found = {}
    for name, column in columns(chunk.case).items():
        fill = FAILED if name == "status" else 0 if column.dtype[0] == "i" else np.nan
        data = np.full((chunk.last - chunk.first, *(3 for _ in column.dims)), fill, dtype=column.dtype)
        found[name] = Variable(("member", *column.dims), data)
    return Group({"run_time": 0.0, "alone": 0}, found)


@dataclass
class Summary:
    """What is gathered from the chunks as they lie on the disk, and the members to be probed."""

    status: np.ndarray
    steps: int
    run_time: float
    alone: int
    members: list[int]
    omega: list[np.ndarray]
    crossing_time: list[float]
    changes: dict[str, int]


def _summary(case: Case, tasks: list[Chunk], read: Read) -> Summary:
    total = tasks[-1].last
    found = Summary(np.zeros(len(STATUS), dtype=np.int64), 0, 0.0, 0, [], [], [], {})
    drawn = np.sort(np.random.default_rng(total).choice(total, min(SAMPLE, total), replace=False))
    near: list[tuple[float, int, np.ndarray, float]] = []
    for task in tasks:
        with read(task) as part:
            status = part.variable("status")
            found.status += np.bincount(status, minlength=len(STATUS))
            found.steps += int(part.variable("steps").sum())
            found.run_time += part.attributes["run_time"]
            found.alone += part.attributes["alone"]
            if not carried(case):
                continue
            omega, crossing = part.variable("omega"), part.variable("crossing_time")
            separation = np.where(status == OK, part.variable("separation"), np.inf)
        omega = omega[:, -1] if omega.ndim == 3 else omega
        nearest = [i for i in np.argsort(separation)[:NEAREST] if separation[i] < np.inf]
        near += [(float(separation[i]), task.first + int(i), omega[i], float(crossing[i])) for i in nearest]
        near = sorted(near, key=lambda one: one[:2])[:NEAREST]
        for i in drawn[(drawn >= task.first) & (drawn < task.last)] - task.first:
            if status[i] == OK:
                _add(found, task.first + int(i), omega[i], crossing[i])
    for _, number, omega, time in near:
        if number not in found.members:
            _add(found, number, omega, time)
    return found


def _add(found: Summary, number: int, omega: np.ndarray, time: float) -> None:
    if np.abs(omega).max() > 1e-290:
        found.members.append(number)
        found.omega.append(omega)
        found.crossing_time.append(float(time))


def _errors(case: Case, pool: Pool, summary: Summary) -> dict[str, Any]:
    """Quantiles of the measured errors."""
    step = 16
    tasks = [
        Probe(case, summary.members[i : i + step], np.array(summary.omega[i : i + step]),
              np.array(summary.crossing_time[i : i + step]))
        for i in range(0, len(summary.members), step)
    ]  # fmt: skip
    found: list[tuple[float, float, str]] = []
    for _, outcome in pool.map(probe, tasks):
        if isinstance(outcome, Exception):
            raise outcome
        found += outcome
    states = [one[0] for one in found if not math.isnan(one[0])]
    times = [one[1] for one in found if not math.isnan(one[1])]
    kinds = sorted({one[2] for one in found} - {"none"})
    return {
        "error": max(states, default=math.nan),
        "error_kind": kinds[0] if kinds else "none",
        "error_sample": len(states),
        "error_levels": np.array(LEVELS),
        "error_quantiles": np.quantile(states or [math.nan], LEVELS),
        "crossing_error_quantiles": np.quantile(times or [math.nan], LEVELS),
    }


def _group(
    case: Case, mark: str, tasks: list[Chunk], read: Read, summary: Summary,
    errors: Mapping[str, Any], problems: Mapping[str, int],
) -> Group:  # fmt: skip
    """The sweep as it is stored; its variables are filled in from the chunks when it is written."""
    ok, failed, timeout, invalid = summary.status.tolist()
    total = tasks[-1].last
    words = [f"{count} of {total} members: {message}" for message, count in problems.items()]
    words += [f"{n} of {total} members {what}" for n, what in ((failed, "failed"), (timeout, "ran out of time")) if n]
    lanes = carried(case)
    attributes: dict[str, Attribute] = {
        "model": case.model,
        "form": case.form,
        "case": dump(case),
        "hash": mark,
        "method": "taylor" if lanes else case.method,
        "method_reason": f"in lanes, {summary.alone} of {total} members by themselves" if lanes else "each by itself",
        "members": total,
        "tol": case.tol or 2.0**-52,
        "steps": summary.steps,
        "run_time": summary.run_time,
        "error": math.nan,
        "error_kind": "none",
        "status": "failed" if failed or not ok else "timeout" if timeout else "ok",
        "message": "; ".join(words) or ("" if ok else "no member is a body with a start"),
        "warnings": f"{invalid} of {total} members are no body or have no start" if invalid else "",
    }
    sizes = shape(case)
    names = [axis.name for axis in axes_of(case.sweep or {})]
    variables = coordinates(case)
    for name, column in kept(case).items():
        inner = tuple(3 for _ in column.dims)
        dims = column.dims
        if "trajectory" in case.store and name in find(case.model, case.form).variables:
            inner, dims = (case.time.samples, *inner), ("time", *dims)
        outline = np.broadcast_to(np.zeros((), dtype=column.dtype), (*sizes, *inner))
        labels = {"long_name": column.long_name, "units": column.units, **column.attributes}
        variables[name] = Variable((*names, *dims), outline, labels)
    if any("axis" in variable.dims for variable in variables.values()):
        axes = np.array(["x1", "x2", "x3"], dtype=object)
        variables["axis"] = Variable(("axis",), axes, {"long_name": "principal axis of inertia"})

    def fill() -> Iterator[tuple[str, Any, np.ndarray]]:
        for task in tasks:
            boxes = list(slabs(sizes, task.first, task.last))
            with read(task) as part:
                for name in kept(case):
                    data = part.variable(name)
                    for where, rows in boxes:
                        yield name, where, data[rows].reshape(*(s.stop - s.start for s in where), *data.shape[1:])

    return Group({**attributes, **errors}, variables, Late(frozenset(kept(case)), fill))


def coordinates(case: Case) -> dict[str, Variable]:
    """The values along each axis; of a sphere, the directions."""
    found: dict[str, Variable] = {}
    for axis in axes_of(case.sweep or {}):
        numbers = np.arange(len(axis))
        if axis.sphere is not None:
            label = {"long_name": "direction of G at the start", "units": "1"}
            found[f"{axis.name}_vector"] = Variable((axis.name, "axis"), axis.directions(numbers), label)
        elif len(axis.ranges) == 1 and axis.name == ".".join(map(str, axis.ranges[0][0])):
            found[axis.name] = Variable((axis.name,), axis.values[0], {"long_name": axis.name, "units": "1"})
        else:
            for (path, _), values in zip(axis.ranges, axis.values, strict=True):
                key = ".".join(map(str, path))
                found[key] = Variable((axis.name,), values, {"long_name": key, "units": "1"})
    if "trajectory" in case.store:
        time = case.time
        times = np.linspace(time.start, time.end, time.samples) if time.samples > 1 else np.array([time.end])
        found["time"] = Variable(("time",), times, {"long_name": "time", "units": "1"})
    return found


def slabs(sizes: tuple[int, ...], first: int, last: int) -> Iterator[tuple[tuple[slice, ...], slice]]:
    """Members `first` to `last` - 1 as boxes of an array of these sizes, each with its part of the members."""

    def cut(sizes: tuple[int, ...], a: int, b: int) -> Iterator[tuple[tuple[slice, ...], int, int]]:
        if len(sizes) == 1:
            yield (slice(a, b),), a, b
            return
        row = math.prod(sizes[1:])
        while a < b:
            i, inside = divmod(a, row)
            if inside == 0 and b - a >= row:
                rows = (b - a) // row
                yield (slice(i, i + rows), *(slice(0, size) for size in sizes[1:])), a, a + rows * row
                a += rows * row
            else:
                stop = min(b, (i + 1) * row)
                for where, c, d in cut(sizes[1:], inside, inside + stop - a):
                    yield (slice(i, i + 1), *where), i * row + c, i * row + d
                a = stop

    for where, a, b in cut(sizes, first, last):
        yield where, slice(a - first, b - first)
