"""`hodo bench`: error against run time, every case of a config by every method at every
tolerance, each judged by the best that can be computed of the case.

What draws is imported late: the processes that try cases need none of it.
"""

import math
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, cycle, product, repeat
from operator import attrgetter
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any

import numpy as np

from .. import HodoError
from ..batch import Pool
from ..cases.case import Case
from ..cases.config import Config, no_case
from ..cases.keys import finds_no_stop
from ..engines import have_quadruple
from ..engines.protocol import Status
from ..integration import (
    ERROR_LIMIT_ASKED,
    Crossing,
    Trajectory,
    best,
    body_of,
    choose,
    cross,
    errors_against,
    motion_remarks,
    principal_omega,
    sample_times,
    solve,
    solved,
    taylor_steps,
    thinned,
    with_measured_error,
)
from ..models import rigid_body
from ..progress import Progress
from ..storage import CONTENT, Group, Variable, replacing, save_groups
from ..text import grouped, magnitude, markdown, seconds, table
from .resume import attributes_by

# One case by one method at one tolerance

TRIAL_VERDICTS = (
    "accurate",
    "limited by the data",
    "inaccurate, as stated",
    "failed with a message",
    "timeout",
    "SILENT",
)

NOT_TRIED = "-"
"""In the place of a verdict where a method cannot find the stop of a motion."""

ERROR_SLACK = 10
"""An error may be so many times what was asked for; from there on `remarks` warns of it."""

ULP_EFFECTS = 30
"""An error may be so many times what one ulp in the data does: hodo promises no more for motions
that magnify errors."""

QUADRUPLE_STEPS = 1e4
"""The most Taylor steps that are taken in quadruple precision, some 0.2 ms each."""

PATIENCE_OF_TRIALS = 10.0
"""Seconds that auto may take for any case; the papers' cases take milliseconds."""

SINGLE_RUN_SECONDS = 1.0
"""Seconds above which a run is timed once: what only the first one pays does not matter then."""

REPEAT_SECONDS, MAX_REPEATS = 0.05, 50
"""Seconds of repeated runs, and their number, after which the least time does not fall further."""

CONSERVED_TOL = 1e-15
"""The relative change below which a quantity counts as conserved: 1e4 steps in extended precision
round by less."""


@dataclass(frozen=True)
class ReferenceMotion:
    """The motion of a case, better than any method gives it in double precision, at samples of the
    case.

    `floor` is the change that one ulp in the data makes; `conserved` are the positions, among T and
    |G|, of the quantities that it conserves.
    """

    motion: Trajectory
    floor: float
    crossings: tuple[Crossing, ...]
    conserved: tuple[int, ...]


@dataclass(frozen=True)
class Trial:
    """A case by one method at one tolerance. Not a number stands for what does not apply.

    `method` is the one that auto took; `run_time` is the least of several, in seconds of the
    processor, without imports; `compile_time` is what the first run in the process took beyond it;
    `drift` is the largest relative change of what the motion conserves.
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


def reference_motion(case: Case) -> ReferenceMotion:
    """The best that can be computed of a case: in quadruple precision unless that takes too
    long."""
    every = sample_times(case)
    times = every[thinned(len(every))]
    method, _ = best(case, "extended")
    # In long double, where the rounding of the integration is far below one ulp of the data.
    motion, *moved = [
        solve(variant, method, "extended", times=times) for variant in (case, *perturbed(case))
    ]
    floor = max(worst(errors_against(case, perturbation, motion)) for perturbation in moved)
    if method == "taylor" and have_quadruple() and taylor_steps(case) < QUADRUPLE_STEPS:
        motion = solve(case, method, "quadruple", times=times)
    crossings = cross(case, method, "extended", None)[1] if classifiable(case) else []
    conserved = tuple(i for i, change in enumerate(drifts(motion)) if change <= CONSERVED_TOL)
    return ReferenceMotion(motion, floor, tuple(crossings), conserved)


def worst(errors: Mapping[str, float]) -> float:
    """The largest of the errors; not a number counts as infinite."""
    return max(
        (math.inf if math.isnan(error) else error for error in errors.values()), default=math.nan
    )


def classifiable(case: Case) -> bool:
    """Whether crossings are looked for: not in a motion of too many samples or steps."""
    watched, few = bool(case.system.class_events), case.time.samples <= QUADRUPLE_STEPS
    return watched and few and taylor_steps(case) < QUADRUPLE_STEPS


def perturbed(case: Case) -> Iterator[Case]:
    """The case with every number of its data moved by one ulp: all upwards, and every other one
    downwards.

    Numbers that are equal within a list stay so, and 0 stays 0.
    """
    # Moving all one way alone may cancel: a body that is scaled turns as before.
    yield replace(case, data=_moved(case.data, repeat(math.inf)))
    yield replace(case, data=_moved(case.data, cycle((-math.inf, math.inf))))


def _moved(value: Any, towards: Iterator[float]) -> Any:
    """A copy of case data in which each number goes one ulp towards the next of `towards`."""
    if isinstance(value, Mapping):
        return {key: _moved(item, towards) for key, item in value.items()}
    if isinstance(value, tuple):
        # A scalar that stands for three must stay one, and a symmetric body symmetric: its form
        # has another state.
        moved = {item: _moved(item, towards) for item in dict.fromkeys(value)}
        return tuple(moved[item] for item in value)
    if isinstance(value, float) and value != 0:
        return math.nextafter(value, next(towards))
    return value


def drifts(motion: Trajectory) -> list[float]:
    """The largest relative changes of T and |G|, for a motion whose state is the angular
    velocity."""
    if [*motion.case.system.variables] != ["omega"] or not len(motion.time):
        return []
    A, omega = body_of(motion.case).moments.astype(np.longdouble), principal_omega(motion)
    size = np.ldexp(np.longdouble(1), motion.exponent - motion.exponent[0])
    with np.errstate(all="ignore"):
        energy = rigid_body.kinetic_energy(A, omega) * size**2
        momentum = np.sqrt(np.square(rigid_body.angular_momentum(A, omega)).sum(axis=-1)) * size
        return [float(np.max(np.abs(values / values[0] - 1))) for values in (energy, momentum)]


def trial(
    case: Case,
    reference: ReferenceMotion,
    method: str,
    tol: float | None,
    repeats: int,
    max_seconds: float,
) -> Trial:
    """One case by one method at one tolerance, timed and judged."""
    if finds_no_stop(method, case.system):
        return Trial(method, NOT_TRIED, floor=reference.floor)
    case = replace(case, method=method, tol=tol, max_seconds=max_seconds)
    try:
        choose(case)  # the time does not include the trial for stiffness
        began = thread_time()
        motion = solved(case, *choose(case))
        first = thread_time() - began
    except HodoError as mistake:
        return Trial(method, "failed with a message", message=str(mistake), floor=reference.floor)
    run_time = least_time(case, motion, repeats)
    thin = compared(motion)
    error = worst(errors_against(case, thin, reference.motion)) if motion.succeeded else math.nan
    changes = drifts(thin)
    return Trial(
        method=motion.method,
        status=verdict(motion, error, reference.floor),
        error=error,
        crossing_error=error_of_crossings(motion, reference),
        run_time=run_time,
        compile_time=max(first - run_time, 0.0),
        steps=motion.steps,
        rhs_evaluations=motion.evaluations or math.nan,
        # One that ran out of time before its first sample has none.
        drift=max((changes[i] for i in reference.conserved if changes), default=math.nan),
        floor=reference.floor,
        message=motion.message,
    )


def least_time(case: Case, motion: Trajectory, repeats: int) -> float:
    """The least run time of a motion of a case and of its repeats, of which there are more than
    asked for where they are short: whatever else happens only adds to a time."""
    times = [motion.run_time]
    while motion.run_time < SINGLE_RUN_SECONDS and (
        len(times) < repeats or (sum(times) < REPEAT_SECONDS and len(times) < MAX_REPEATS)
    ):
        times.append(solve(case, motion.method, case.precision, case.tol).run_time)
    return min(times)


def compared(motion: Trajectory) -> Trajectory:
    """A motion at the samples at which its error is measured."""
    return motion.at(thinned(len(motion.time)))


def verdict(motion: Trajectory, error: float, floor: float) -> str:
    """The verdict on a result; SILENT if it is wrong and does not say so."""
    if not motion.succeeded:
        return "timeout" if motion.status is Status.TIMEOUT else "failed with a message"
    if error <= ERROR_SLACK * max(motion.tol, ERROR_LIMIT_ASKED):
        return "accurate"
    if error <= ULP_EFFECTS * floor:
        return "limited by the data"
    # Measured only now: a result that is right needs no warning.
    remarks = motion_remarks(compared(with_measured_error(motion)))
    return "inaccurate, as stated" if any(remarks) else "SILENT"


def error_of_crossings(motion: Trajectory, reference: ReferenceMotion) -> float:
    """The largest relative error of a crossing's time; infinite if the crossings are not the true
    ones, and no number where there are none to compare."""
    if not (reference.crossings and motion.succeeded):
        return math.nan
    crossings = cross(motion.case, motion.method, motion.case.precision, motion.tol)[1]
    if [(c.start, c.end) for c in crossings] != [(c.start, c.end) for c in reference.crossings]:
        # Times of crossings that are not the true ones cannot be compared.
        return math.inf
    return max(
        abs(a.time - b.time) / abs(b.time)
        for a, b in zip(crossings, reference.crossings, strict=True)
    )


def trials_of(
    case: Case, methods: Sequence[str], tols: Sequence[float], repeats: int, max_seconds: float
) -> tuple[list[Trial], float]:
    """The trials of a case, by tolerances within methods (no tolerance: each method's own), and the
    seconds they took."""
    began = perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of SciPy's solvers and overflows: the verdicts count them
        reference = reference_motion(case)
        patience = dict.fromkeys(methods, max_seconds) | {"auto": PATIENCE_OF_TRIALS}
        trials = [
            trial(case, reference, method, tol, repeats, patience[method])
            for method, tol in product(methods, tols or (None,))
        ]
    return trials, perf_counter() - began


# All cases of a config

DIGITS = (3, 6, 9, 12)
"""The numbers of right digits for which the fastest method is named."""

MEASURED = {
    "method": ("method taken", ""),
    "status": ("what the result is worth", ""),
    "error": ("largest relative error of a stored variable", "1"),
    "crossing_error": ("largest relative error of the time of a crossing", "1"),
    "run_time": ("least processor time of an integration", "s"),
    "compile_time": ("time that the first integration took beyond its run time", "s"),
    "steps": ("steps", "1"),
    "rhs_evaluations": ("evaluations of the equations", "1"),
    "drift": ("largest relative change of what is conserved", "1"),
    "floor": ("error that one ulp in the data makes", "1"),
    "message": ("why it stopped", ""),
}
"""What is stored of a trial: its meaning and unit, none of a text."""


def table_of_trials(
    cases: Sequence[str], methods: Sequence[str], tols: Sequence[float], trials: Iterable[Trial]
) -> Group:
    """Trials as they are stored, over case, method and tolerance, of which the last varies fastest;
    a tolerance of nan is the method's own."""
    axes = {
        "case": (np.array(cases, dtype=object), "case"),
        "method": (np.array(methods, dtype=object), "method asked for"),
        "tol": (np.array(tols, dtype=float), "tolerance; nan: the method's own"),
    }
    variables = {
        name: Variable((name,), values, {"long_name": words})
        for name, (values, words) in axes.items()
    }
    shape, rows = [len(values) for values, _ in axes.values()], [vars(trial) for trial in trials]
    for name, (words, unit) in MEASURED.items():
        values = np.array([row[name] for row in rows], dtype=None if unit else object)
        variables[name if name != "method" else "method_taken"] = Variable(
            tuple(axes), values.reshape(shape), {"long_name": words, "units": unit or "1"}
        )
    return Group({}, variables)


def benchmark(config: Config, globs: Sequence[str], out: Path, jobs: int, quiet: bool) -> Group:
    """Try the cases of a config, all or those that match, and store the trials and their figure.

    Raises HodoError if the config has no `bench:` section, no case matches, or a file cannot be
    written.
    """
    if config.bench is None:
        raise HodoError(
            f"{config.path}: there is no bench: section, which names the methods to be compared"
        )
    if not (names := config.matching(globs)):
        raise no_case(globs, config.cases)
    from ..figures.kinds.costs import draw_bench
    from ..figures.sheet import save

    bench = try_cases([config.cases[name] for name in names], config.bench, jobs, quiet)
    name = Path(config.path).stem
    attributes = {**attributes_by(f"bench {config.path}", config), CONTENT: "trials of methods"}
    with replacing(out / f"{name}.bench.h5") as draft:
        save_groups(draft, {"bench": bench}, attributes)
    save(draw_bench(bench, TRIAL_VERDICTS), out / "figures" / f"{name}.png")
    return bench


def try_cases(cases: Sequence[Case], settings: Mapping[str, Any], jobs: int, quiet: bool) -> Group:
    """The trials of these cases by the `bench:` section of their config; a case whose process dies
    has failed trials."""
    methods, tols = settings["methods"], settings["tols"] or (math.nan,)
    trials: dict[str, list[Trial]] = {}
    # In processes even if it is only one: a solver that takes its process down costs its own case.
    with Pool(jobs, always=True) as pool, Progress(len(cases), quiet) as progress:
        tasks = progress.starting(cases, attrgetter("name"))
        for case, outcome in pool.map(partial(trials_of, **settings), tasks):
            if isinstance(outcome, HodoError):
                # The process died with the case: all of its trials are lost, not only the one that
                # ended it.
                failed = Trial(status="failed with a message", message=str(outcome))
                trials[case.name] = [failed] * (len(methods) * len(tols))
                progress.done(case.name, str(outcome))
            elif isinstance(outcome, Exception):
                raise outcome
            else:
                trials[case.name], spent = outcome
                progress.say(f"{case.name}: {verdict_counts(trials[case.name])} ({seconds(spent)})")
                for line in messages_of_trials(trials[case.name], product(methods, tols)):
                    progress.say(line)
                progress.done(case.name)
    names = [case.name for case in cases]
    return table_of_trials(names, methods, tols, chain(*(trials[name] for name in names)))


def verdict_counts(trials: Iterable[Trial]) -> str:
    """How many trials have which verdict."""
    counts = Counter(trial.status for trial in trials)
    return ", ".join(f"{counts[word]} {word}" for word in TRIAL_VERDICTS if counts[word])


def messages_of_trials(
    trials: Sequence[Trial], asked: Iterable[tuple[str, float]]
) -> Iterator[str]:
    """Each message of a trial, behind the methods and tolerances that were asked for there."""
    tried = grouped(
        (trial.message, method if math.isnan(tol) else f"{method} at {tol:g}")
        for trial, (method, tol) in zip(trials, asked, strict=True)
        if trial.message
    )
    return (f"{', '.join(names)}: {message}" for message, names in tried.items())


def auto_failed(bench: Group) -> bool:
    """Whether auto was wrong without saying so, or was not done in time."""
    by_auto = bench.variables["method"].data == "auto"
    return not {"SILENT", "timeout"}.isdisjoint(bench.variables["status"].data[:, by_auto].flat)


def speed_table(bench: Mapping[str, np.ndarray]) -> list[list[str]]:
    """A row per case: the fastest method, with its run time, for each number of digits."""
    rows = [["case", *(f"{digits} digits" for digits in DIGITS)]]
    for case, error, run_time in zip(bench["case"], bench["error"], bench["run_time"], strict=True):
        # A comparison with nan is false, so that a trial without an error is never the fastest.
        rights = [np.where(error <= 10.0**-digits, run_time, np.inf) for digits in DIGITS]
        rows.append([case, *(fastest(bench["method"], times.min(axis=1)) for times in rights)])
    return rows


def fastest(methods: np.ndarray, times: np.ndarray) -> str:
    """The method (n,) with the least time (n,), and that time; a dash if none is finite."""
    best = times.argmin()
    return f"{methods[best]} {seconds(times[best])}" if np.isfinite(times[best]) else "-"


VERDICT_HEADER = [
    *("case", "auto takes", "error", "one ulp", "run time", "verdict", "fastest that is right")
]


def verdict_table(bench: Mapping[str, np.ndarray]) -> list[list[str]]:
    """A row per case: what auto took, its error, floor and run time, its verdict, and the methods
    by verdict."""
    rows = [VERDICT_HEADER]
    is_auto = bench["method"] == "auto"
    for i, case in enumerate(bench["case"]):
        taken, error, floor, run_time, status = (
            bench[name][i, :, 0]
            for name in ("method_taken", "error", "floor", "run_time", "status")
        )
        is_right = error <= np.fmax(ERROR_SLACK * ERROR_LIMIT_ASKED, ULP_EFFECTS * floor)
        is_right[is_auto] = False
        rival = fastest(taken, np.where(is_right, run_time, np.inf))
        by_auto = [
            [taken[j], magnitude(error[j]), magnitude(floor[j]), seconds(run_time[j]), status[j]]
            for j in np.flatnonzero(is_auto)
        ]
        rows.append([case, *(by_auto[0] if by_auto else ["-"] * 5), rival])
    return rows


def table_of_bench(bench: Group, as_markdown: bool) -> str:
    """The table of a bench, by tolerances where there are several, else by verdicts: for the
    terminal or for a document."""
    data = {name: variable.data for name, variable in bench.variables.items()}
    header, *rows = speed_table(data) if len(data["tol"]) > 1 else verdict_table(data)
    return markdown(header, rows) if as_markdown else table(header, rows)
