"""Error against run time: every case of a config by every method at every tolerance, judged by a
better computation."""

import math
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import product, repeat
from multiprocessing import get_context
from pathlib import Path as FilePath
from statistics import median
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from .. import HodoError
from ..cases.case import Case
from ..cases.config import Config
from ..engines.protocol import Status
from ..integration.choice import best, choose, taylor_steps
from ..integration.classify import EPS, Crossing, cross
from ..integration.driver import Path
from ..integration.error import difference, extended, measure, thinned
from ..integration.integrate import ASKED, remarks, tried
from ..integration.solve import Solution, sample_times, solve, stored
from ..models import rigid_body
from ..models.rigid_body import BodyFrame
from ..results.hdf5 import Group, Variable, create
from ..results.provenance import root_attributes, stamp
from ..text import magnitude, seconds, table

VERDICTS = (
    "accurate",
    "limited by the data",
    "inaccurate, said so",
    "failed with a message",
    "timeout",
    "SILENT",
)
SLACK, ULPS = 10, 30
"""An error may be so many times what was asked for, or so many times what one ulp in the data
does."""

AFFORDABLE = 1e4
"""The most Taylor steps that are taken in quadruple precision."""

PATIENCE = 10.0
"""Seconds that auto may take for any case."""

REPEATED = 0.2
"""Seconds above which a run is timed once."""

DIGITS = (3, 6, 9, 12)


@dataclass(frozen=True)
class Truth:
    """The motion of a case, better than any method gives it in double precision, at samples of the
    case.

    `floor` is what one ulp in the data does to it; `kept` are the positions of the quantities, of T
    and |G|, that it conserves.
    """

    path: Path
    kind: str
    floor: float
    crossings: tuple[Crossing, ...]
    kept: tuple[int, ...]


@dataclass(frozen=True)
class Trial:
    """A case by one method at one tolerance. Not a number stands for what does not apply.

    `method` is the one that auto took; times in seconds, without imports; `compile_time` is what
    the first run in the process took beyond its run time; `drift` is the largest relative change of
    what the motion conserves.
    """

    method: str = ""
    status: str = ""
    error: float = math.nan
    crossing_error: float = math.nan
    run_time: float = math.nan
    compile_time: float = math.nan
    steps: float = math.nan
    rhs_evaluations: float = math.nan
    drift: float = math.nan
    floor: float = math.nan
    message: str = ""


def truth(case: Case) -> Truth:
    """The best that can be computed of a case: in quadruple precision unless that takes too
    long."""
    every = sample_times(case)
    times = every[thinned(every)]
    method, _ = best(case, "extended")
    path, *moved = [
        solve(each, method, "extended", times=times).path for each in (case, *perturbed(case))
    ]
    floor = max(worst(difference(case, other, path)) for other in moved)
    kind = f"{method}, extended"
    if method == "taylor" and taylor_steps(case) < AFFORDABLE:
        path, kind = solve(case, method, "quadruple", times=times).path, f"{method}, quadruple"
    crossings = cross(case, method, "extended", None, 8 * EPS)[1] if classifiable(case) else []
    changes = drifts(case, path)
    kept = tuple(i for i, change in enumerate(changes) if change <= 1e-15)
    return Truth(path, kind, floor, tuple(crossings), kept)


def worst(errors: Mapping[str, float]) -> float:
    """The largest of the errors; not a number counts as infinite."""
    return max(
        (math.inf if math.isnan(error) else error for error in errors.values()), default=math.nan
    )


def classifiable(case: Case) -> bool:
    """Whether crossings are looked for: not in a motion of too many samples or steps."""
    short = case.time.samples <= AFFORDABLE and taylor_steps(case) < AFFORDABLE
    return short and not case.system.unclassifiable


def perturbed(case: Case) -> Iterator[Case]:
    """The case with every number of its data moved by one ulp: all upwards, and every other one
    downwards.

    Numbers that are equal within a list stay so, and 0 stays 0.
    """
    for signs in ((1.0, 1.0), (1.0, -1.0)):
        count = 0

        def move(value: Any, signs: tuple[float, float] = signs) -> Any:
            nonlocal count
            if isinstance(value, Mapping):
                return {key: move(item) for key, item in value.items()}
            if isinstance(value, tuple):
                return (
                    (move(value[0]),) * len(value)
                    if len(set(value)) == 1
                    else tuple(move(item) for item in value)
                )
            if not isinstance(value, float) or value == 0:
                return value
            count += 1
            return math.nextafter(value, signs[count % 2] * math.inf)

        yield replace(case, data=move(case.data))


def drifts(case: Case, path: Path) -> list[float]:
    """The largest relative changes of T and |G|, for a motion whose state is the angular
    velocity."""
    if not isinstance(case.system, BodyFrame) or not len(path.time):
        return []
    A, omega = np.array(case.data["inertia"], dtype=np.longdouble), extended(path.state)
    size = np.ldexp(np.longdouble(1), path.exponent - path.exponent[0])
    with np.errstate(all="ignore"):
        energy = rigid_body.kinetic_energy(A, omega) * size**2
        momentum = np.sqrt(np.square(rigid_body.angular_momentum(A, omega)).sum(axis=-1)) * size
        return [float(np.max(np.abs(values / values[0] - 1))) for values in (energy, momentum)]


def trial(
    case: Case, sure: Truth, method: str, tol: float | None, repeats: int, max_seconds: float
) -> Trial:
    """One case by one method at one tolerance, timed and judged."""
    case = replace(case, method=method, tol=tol, max_seconds=max_seconds)
    try:
        choose(case)  # a trial for stiffness is no part of what is timed
        began = perf_counter()
        taken, _, solution = tried(case)
        compile_time = perf_counter() - began - solution.run_time
    except HodoError as mistake:
        return Trial(method, "failed with a message", message=str(mistake), floor=sure.floor)
    times = [solution.run_time]
    while len(times) < repeats and solution.run_time < REPEATED:
        times.append(solve(case, taken, case.precision, tol).run_time)
    path = compared(solution.path)
    error = worst(difference(case, path, sure.path)) if solution.whole else math.nan
    changes = drifts(case, path)
    return Trial(
        method=taken,
        status=verdict(case, taken, solution, error, sure.floor),
        error=error,
        crossing_error=crossing_error(case, sure, taken, solution) if solution.whole else math.nan,
        run_time=median(times),
        compile_time=max(compile_time, 0.0),
        steps=solution.steps,
        rhs_evaluations=solution.evaluations or math.nan,
        drift=max((changes[i] for i in sure.kept), default=math.nan),
        floor=sure.floor,
        message=solution.message,
    )


def compared(path: Path) -> Path:
    """The samples of a motion at which its error is measured."""
    rows = thinned(path.time)
    return Path(path.time[rows], path.state[rows], path.exponent[rows], path.events)


def verdict(case: Case, method: str, solution: Solution, error: float, floor: float) -> str:
    """What a result is worth; SILENT if it is wrong and does not say so."""
    if not solution.whole:
        return "timeout" if solution.status is Status.TIMEOUT else "failed with a message"
    if error <= SLACK * max(solution.tol, ASKED):
        return "accurate"
    if error <= ULPS * floor:
        return "limited by the data"
    errors, _ = measure(case, method, solution)
    said = any(remarks(case, solution, stored(case, compared(solution.path)), errors))
    return "inaccurate, said so" if said else "SILENT"


def crossing_error(case: Case, sure: Truth, method: str, solution: Solution) -> float:
    """The largest relative error of a crossing's time; infinite if the crossings are not the true
    ones."""
    if not sure.crossings:
        return math.nan
    found = cross(case, method, case.precision, solution.tol, 8 * EPS)[1]
    if [(c.start, c.end) for c in found] != [(c.start, c.end) for c in sure.crossings]:
        return math.inf
    return max(
        abs(a.time - b.time) / abs(b.time) for a, b in zip(found, sure.crossings, strict=True)
    )


@dataclass(frozen=True)
class Bench:
    """The trials of a config, in the order case, method, tolerance; a tolerance of nan is the
    method's own."""

    verdicts: ClassVar[tuple[str, ...]] = VERDICTS
    cases: tuple[str, ...]
    methods: tuple[str, ...]
    tols: tuple[float, ...]
    trials: tuple[Trial, ...]

    def items(self) -> Iterator[tuple[tuple[str, str, float], Trial]]:
        """Case, method and tolerance with their trial."""
        return zip(product(self.cases, self.methods, self.tols), self.trials, strict=True)

    def values(self, name: str) -> np.ndarray:
        """One quantity of all trials, shape (case, method, tol)."""
        values = [getattr(trial, name) for trial in self.trials]
        shape = len(self.cases), len(self.methods), len(self.tols)
        return np.array(values, dtype=object if isinstance(values[0], str) else float).reshape(
            shape
        )

    def group(self) -> Group:
        """The trials as they are stored."""
        coordinates = {
            "case": Variable(("case",), np.array(self.cases, dtype=object), {"long_name": "case"}),
            "method": Variable(
                ("method",), np.array(self.methods, dtype=object), {"long_name": "method asked for"}
            ),
            "tol": Variable(
                ("tol",), np.array(self.tols), {"long_name": "tolerance; nan: the method's own"}
            ),
        }
        values = {
            name if name != "method" else "method_taken": Variable(
                ("case", "method", "tol"),
                self.values(name),
                {"long_name": LABELS[name][0], "units": LABELS[name][1]},
            )
            for name in LABELS
        }
        return Group({}, coordinates | values)


LABELS = {
    "method": ("method taken", "1"),
    "status": ("what the result is worth", "1"),
    "error": ("largest relative error of a stored variable", "1"),
    "crossing_error": ("largest relative error of the time of a crossing", "1"),
    "run_time": ("median time of an integration", "s"),
    "compile_time": ("time that the first integration took beyond its run time", "s"),
    "steps": ("steps", "1"),
    "rhs_evaluations": ("evaluations of the equations", "1"),
    "drift": ("largest relative change of what is conserved", "1"),
    "floor": ("error that one ulp in the data makes", "1"),
    "message": ("why it stopped", "1"),
}


def run(config: Config, globs: Sequence[str], jobs: int, say: Callable[[str], None]) -> Bench:
    """Try the cases of a config, all or those that match, by its `bench:` section; `say` is told of
    each case.

    Raises HodoError if there is no such section, or no such case.
    """
    names = tuple(
        name for name in config.cases if not globs or any(fnmatchcase(name, glob) for glob in globs)
    )
    if not names:
        raise HodoError(f"no case matches {' or '.join(globs)}")
    if config.bench is None:
        raise HodoError(
            f"{config.path}: there is no bench: section, which names the methods to be compared"
        )
    trials: list[Trial] = []
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        work = pool.map(trials_of, [config.cases[name] for name in names], repeat(config.bench))
        for name, (found, spent) in zip(names, work, strict=True):
            trials += found
            counts = ", ".join(
                f"{n} {word}" for word in VERDICTS if (n := sum(t.status == word for t in found))
            )
            say(f"{len(trials) // len(found)}/{len(names)} {name}: {counts} ({seconds(spent)})")
    tols = config.bench["tols"] or (math.nan,)
    return Bench(names, config.bench["methods"], tols, tuple(trials))


def trials_of(case: Case, given: Mapping[str, Any]) -> tuple[list[Trial], float]:
    """The trials of one case by a `bench:` section, and the seconds they took."""
    began = perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # SciPy's solvers and overflows: the verdicts say what came of them
        sure = truth(case)
        found = [
            trial(
                case,
                sure,
                method,
                tol,
                given["repeats"],
                PATIENCE if method == "auto" else given["max_seconds"],
            )
            for method in given["methods"]
            for tol in given["tols"] or (None,)
        ]
    return found, perf_counter() - began


def write(bench: Bench, config: Config, path: FilePath) -> None:
    """Store a bench as the only group, `bench`, of a result file."""
    attributes = root_attributes(
        config.title, config.references, config.text, stamp(f"hodo bench {config.path}")
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".partial")
    with create(draft, attributes) as output:
        output.write("bench", bench.group())
    os.replace(draft, path)


def let_down(bench: Bench) -> bool:
    """Whether auto was wrong without saying so, or was not done in time."""
    return any(
        trial.status in ("SILENT", "timeout") for key, trial in bench.items() if key[1] == "auto"
    )


def fastest(bench: Bench, case: int, digits: int) -> tuple[str, float, float] | None:
    """Method, tolerance and run time of the fastest trial of a case whose error is below
    10^-digits, if any is."""
    error, time = bench.values("error")[case], bench.values("run_time")[case]
    time = np.where(error <= 10.0**-digits, time, np.inf)
    m, t = np.unravel_index(np.argmin(time), time.shape)
    return (bench.methods[m], bench.tols[t], float(time[m, t])) if np.isfinite(time[m, t]) else None


def speed_table(bench: Bench) -> list[list[str]]:
    """A row per case: the fastest method, with its run time, for each number of digits."""
    rows = []
    for i, case in enumerate(bench.cases):
        found = [fastest(bench, i, digits) for digits in DIGITS]
        rows.append(
            [case, *("-" if one is None else f"{one[0]} {seconds(one[2])}" for one in found)]
        )
    return [["case", *(f"{digits} digits" for digits in DIGITS)], *rows]


def verdict_table(bench: Bench) -> list[list[str]]:
    """A row per case: what auto took, its error, floor and run time, its verdict, and the methods
    by verdict."""
    at = bench.methods.index("auto") if "auto" in bench.methods else 0
    rows = []
    for i, case in enumerate(bench.cases):
        row = bench.trials[i * len(bench.methods) : (i + 1) * len(bench.methods)]
        mine, others = row[at], [t for j, t in enumerate(row) if j != at]
        right = [t for t in others if t.error <= max(SLACK * ASKED, ULPS * t.floor)]
        good = sorted(right, key=lambda t: t.run_time)
        rival = f"{good[0].method} {seconds(good[0].run_time)}" if good else "-"
        cells = (
            mine.method,
            magnitude(mine.error),
            magnitude(mine.floor),
            seconds(mine.run_time),
            mine.status,
            rival,
        )
        rows.append([case, *cells])
    return [
        ["case", "auto takes", "error", "one ulp", "run time", "verdict", "fastest that is right"],
        *rows,
    ]


def report(bench: Bench) -> list[list[str]]:
    """The table of a bench: by tolerances where there are several, else by verdicts."""
    return speed_table(bench) if len(bench.tols) > 1 else verdict_table(bench)


def plain(rows: Sequence[Sequence[str]]) -> str:
    """A table for the terminal."""
    return table(rows[0], rows[1:])


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """A table for README."""
    lines: Iterable[Sequence[str]] = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return "\n".join("| " + " | ".join(row) + " |" for row in lines) + "\n"
