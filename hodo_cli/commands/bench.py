"""`hodo bench`: error against run time, for every case of a config by every method at every
tolerance, each compared with the best computation of the case."""

import math
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, cycle, product, repeat
from operator import attrgetter
from pathlib import Path
from time import perf_counter
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
    Trajectory,
    best,
    choose,
    errors_against,
    motion_remarks,
    sample_times,
    solve,
    solved,
    taylor_steps,
    thinned,
    with_measured_error,
)
from ..models.base import Model
from ..progress import Progress
from ..results.resume import attributes_by
from ..storage import CONTENT, Group, Variable, replacing, save_groups
from ..text import grouped, magnitude, markdown, seconds, table

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
"""The verdict on a method that cannot find the stop of a motion."""

ERROR_SLACK = 10
"""The largest error relative to the tolerance; `remarks` warns of more."""

ULP_EFFECTS = 30
"""The largest error relative to the effect of one ulp in the data, for motions that magnify
errors."""

QUADRUPLE_STEPS = 1e4
"""The most Taylor steps in quadruple precision, some 0.2 ms each."""

PATIENCE_OF_TRIALS = 10.0
"""The seconds that auto may take for any case; the papers' cases take milliseconds."""

SINGLE_RUN_SECONDS = 1.0
"""The seconds above which a run is timed once: the extra cost of a first run does not matter
then."""

REPEAT_SECONDS, MAX_REPEATS = 0.05, 50
"""The seconds of repeated runs, and their number, after which the least time no longer falls."""


@dataclass(frozen=True)
class Trial:
    """A case by one method at one tolerance; nan where a number does not apply.

    `method` is the one that auto took; `run_time` is the least of several runs, in seconds of the
    processor, without imports; `floor` is the error that one ulp in the data makes.
    """

    method: str = ""
    status: str = ""
    error: float = math.nan
    run_time: float = math.nan
    steps: float = math.nan
    floor: float = math.nan
    message: str = ""


def reference_motion(case: Case) -> tuple[Trajectory, float]:
    """The motion of a case at samples, more accurate than in double precision, and the error that
    one ulp in the data makes.

    It is integrated in quadruple precision unless that takes too long.
    """
    all_times = sample_times(case)
    times = all_times[thinned(len(all_times))]
    method, _ = best(case, "extended")
    # In long double the rounding of the integration is far below one ulp of the data.
    motion, *moved = [
        solve(variant, method, "extended", times=times) for variant in (case, *perturbed(case))
    ]
    floor = max(worst(errors_against(case, perturbation, motion)) for perturbation in moved)
    if method == "taylor" and have_quadruple() and taylor_steps(case) < QUADRUPLE_STEPS:
        motion = solve(case, method, "quadruple", times=times)
    return motion, floor


def worst(errors: Mapping[str, float]) -> float:
    """The largest of the errors; nan counts as infinite. It is nan if there are none."""
    sizes = (math.inf if math.isnan(error) else error for error in errors.values())
    return float(max(sizes, default=math.nan))  # of long doubles too


def perturbed(case: Case) -> Iterator[Case]:
    """The case with every number of its data moved by one ulp, upwards and downwards alternately.

    Equal numbers within a list stay equal, and 0 stays 0.
    """
    # Moves all in one direction may cancel: a scaled body turns as before.
    yield replace(case, data=_moved(case.data, repeat(math.inf)))
    yield replace(case, data=_moved(case.data, cycle((-math.inf, math.inf))))


def _moved(value: Any, towards: Iterator[float]) -> Any:
    """A copy of case data in which each number goes one ulp towards the next of `towards`."""
    if isinstance(value, Mapping):
        return {key: _moved(item, towards) for key, item in value.items()}
    if isinstance(value, tuple):
        # Three equal components stay equal, and a symmetric body symmetric: else the form has
        # another state.
        moved = {item: _moved(item, towards) for item in dict.fromkeys(value)}
        return tuple(moved[item] for item in value)
    if isinstance(value, float) and value != 0:
        return math.nextafter(value, next(towards))
    return value


def trial(
    case: Case,
    reference: tuple[Trajectory, float],
    method: str,
    tol: float | None,
    repeats: int,
    max_seconds: float,
) -> Trial:
    """One case by one method at one tolerance, timed, and compared with its reference and with the
    effect of one ulp."""
    true_motion, floor = reference
    if finds_no_stop(method, case.system) or not suits(case.system, method):
        return Trial(method, NOT_TRIED, floor=floor)
    case = replace(case, method=method, tol=tol, max_seconds=max_seconds)
    try:
        choose(case)  # kept for the next call: the time includes no trial for stiffness
        motion = solved(case, *choose(case))
    except HodoError as mistake:
        return Trial(method, "failed with a message", message=str(mistake), floor=floor)
    errors = errors_against(case, compared(motion), true_motion) if motion.succeeded else {}
    error = worst(errors)
    return Trial(
        method=motion.method,
        status=verdict(motion, error, floor),
        error=error,
        run_time=least_time(case, motion, repeats),
        steps=motion.steps,
        floor=floor,
        message=motion.message,
    )


def suits(system: Model, method: str) -> bool:
    """Whether a method can integrate these equations."""
    if system.is_quadrature:
        return method in ("auto", "quadrature")
    return method != "quadrature" and (method != "exact" or system.has_closed_form)


def least_time(case: Case, motion: Trajectory, repeats: int) -> float:
    """The least run time of a motion and of its repeats; short runs are repeated more often. It is
    the least because other processes can only add to a time."""
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
    """The verdict on a result; SILENT if it is wrong and has no warning."""
    if not motion.succeeded:
        return "timeout" if motion.status is Status.TIMEOUT else "failed with a message"
    if error <= ERROR_SLACK * max(motion.tol, ERROR_LIMIT_ASKED):
        return "accurate"
    if error <= ULP_EFFECTS * floor:
        return "limited by the data"
    # The error is measured only here, because a right result needs no warning.
    remarks = motion_remarks(compared(with_measured_error(motion)))
    return "inaccurate, as stated" if any(remarks) else "SILENT"


def trials_of(
    case: Case, methods: Sequence[str], tols: Sequence[float], repeats: int, max_seconds: float
) -> tuple[list[Trial], float]:
    """The trials of a case by each method at each tolerance (without `tols`, the method's own), and
    their duration in seconds."""
    began = perf_counter()
    with warnings.catch_warnings():
        # SciPy's warnings, and those of overflows, are not shown: the verdicts count their causes.
        warnings.simplefilter("ignore")
        reference = reference_motion(case)
        patience = dict.fromkeys(methods, max_seconds) | {"auto": PATIENCE_OF_TRIALS}
        trials = [
            trial(case, reference, method, tol, repeats, patience[method])
            for method, tol in product(methods, tols or (None,))
        ]
    return trials, perf_counter() - began


# All cases of a config

DIGITS = (3, 6, 9, 12)
"""The numbers of right digits for which the table names the fastest method."""

MEASURED = {
    "method": ("method taken", ""),
    "status": ("what the result is worth", ""),
    "error": ("largest relative error of a stored variable", "1"),
    "run_time": ("least processor time of an integration", "s"),
    "steps": ("steps", "1"),
    "floor": ("error that one ulp in the data makes", "1"),
    "message": ("why it stopped", ""),
}
"""How a column of trials is stored: its meaning and unit, none for text."""


def table_of_trials(
    cases: Sequence[str], methods: Sequence[str], tols: Sequence[float], trials: Iterable[Trial]
) -> Group:
    """The group of trials over case, method and tolerance. In `trials` the tolerance varies
    fastest, and the case slowest; nan is the method's own tolerance."""
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
    """Try the cases of a config, or those that match, and store the trials.

    Raises HodoError if the config has no `bench:` section, no case matches, or a file cannot be
    written.
    """
    if config.bench is None:
        raise HodoError(
            f"{config.path}: there is no bench: section, which names the methods to be compared"
        )
    if not (names := config.matching(globs)):
        raise no_case(globs, config.cases)
    bench = try_cases([config.cases[name] for name in names], config.bench, jobs, quiet)
    name = Path(config.path).stem
    attributes = {**attributes_by(f"bench {config.path}", config), CONTENT: "trials of methods"}
    with replacing(out / f"{name}.bench.h5") as draft:
        save_groups(draft, {"bench": bench}, attributes)
    if len(bench.variables["tol"].data) > 1:
        from ..figures.plane import draw_bench  # late: the processes that try cases draw nothing

        draw_bench(bench, out / "figures" / f"{name}.bench.svg")
    return bench


def try_cases(cases: Sequence[Case], settings: Mapping[str, Any], jobs: int, quiet: bool) -> Group:
    """The trials of these cases by the `bench:` section of their config; a case whose process dies
    has failed trials."""
    methods, tols = settings["methods"], settings["tols"] or (math.nan,)
    trials: dict[str, list[Trial]] = {}
    # Even a single case runs in another process: a solver that crashes it fails this case alone.
    with Pool(jobs, always=True) as pool, Progress(len(cases), quiet) as progress:
        tasks = progress.starting(cases, attrgetter("name"))
        for case, outcome in pool.map(partial(trials_of, **settings), tasks):
            if isinstance(outcome, HodoError):
                # The process died with the case, so all of its trials are lost.
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
    """The number of trials of each verdict."""
    counts = Counter(trial.status for trial in trials)
    return ", ".join(f"{counts[word]} {word}" for word in TRIAL_VERDICTS if counts[word])


def messages_of_trials(
    trials: Sequence[Trial], asked: Iterable[tuple[str, float]]
) -> Iterator[str]:
    """Each message of a trial, after its methods and tolerances."""
    tried = grouped(
        (trial.message, method if math.isnan(tol) else f"{method} at {tol:g}")
        for trial, (method, tol) in zip(trials, asked, strict=True)
        if trial.message
    )
    return (f"{', '.join(names)}: {message}" for message, names in tried.items())


def auto_failed(bench: Group) -> bool:
    """Whether auto was wrong without a warning, or took too long."""
    by_auto = bench.variables["method"].data == "auto"
    return not {"SILENT", "timeout"}.isdisjoint(bench.variables["status"].data[:, by_auto].flat)


def speed_table(bench: Mapping[str, np.ndarray]) -> list[list[str]]:
    """The header, and a row for each case: the fastest method for each number of right digits, with
    its run time."""
    rows = [["case", *(f"{digits} digits" for digits in DIGITS)]]
    for case, error, run_time in zip(bench["case"], bench["error"], bench["run_time"], strict=True):
        # The run times (methods, tolerances), infinite where the digits are not right. A comparison
        # with nan is false, so that a trial without an error is never the fastest.
        rights = [np.where(error <= 10.0**-digits, run_time, np.inf) for digits in DIGITS]
        rows.append([case, *(fastest(bench["method"], times.min(axis=1)) for times in rights)])
    return rows


def fastest(methods: np.ndarray, times: np.ndarray) -> str:
    """The method (n,) with the least time (n,), and that time; a dash if no time is finite."""
    best = times.argmin()
    return f"{methods[best]} {seconds(times[best])}" if np.isfinite(times[best]) else "-"


VERDICT_HEADER = [
    *("case", "auto takes", "error", "one ulp", "run time", "verdict", "fastest that is right")
]


def verdict_table(bench: Mapping[str, np.ndarray]) -> list[list[str]]:
    """The header, and a row for each case: the method that auto took, its error, the error that one
    ulp in the data makes, run time and verdict, and the fastest other method that is right."""
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
    """The table of a bench: by tolerances if there are several, else by verdicts; for the terminal
    or in Markdown."""
    data = {name: variable.data for name, variable in bench.variables.items()}
    header, *rows = speed_table(data) if len(data["tol"]) > 1 else verdict_table(data)
    return markdown(header, rows) if as_markdown else table(header, rows)
