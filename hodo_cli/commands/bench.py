"""`hodo bench`: error against run time, every case of a config by every method at every
tolerance."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain, product
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..batch.pool import Pool
from ..batch.processes import Processes
from ..cases.case import Case
from ..cases.config import Config, no_case
from ..figures.files import save
from ..figures.kinds.costs import draw_bench
from ..integration import ERROR_LIMIT_ASKED
from ..progress import Progress
from ..results.trials import ERROR_SLACK, TRIAL_VERDICTS, ULP_EFFECTS, Trial, trials_of
from ..storage import Group, Variable, create, replacing
from ..text import grouped, magnitude, markdown, seconds, table
from .resume import attributes_by

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
    bench = try_cases([config.cases[name] for name in names], config.bench, jobs, quiet)
    name = Path(config.path).stem
    attributes = attributes_by(f"bench {config.path}", config)
    with replacing(out / f"{name}.bench.h5") as draft, create(draft, attributes) as output:
        output.write("bench", bench)
    save(draw_bench(bench, TRIAL_VERDICTS), out / "figures" / f"{name}.png")
    return bench


def try_cases(cases: Sequence[Case], settings: Mapping[str, Any], jobs: int, quiet: bool) -> Group:
    """The trials of these cases by the `bench:` section of their config; a case whose process dies
    has failed trials."""
    methods, tols = settings["methods"], settings["tols"] or (math.nan,)
    trials: dict[str, list[Trial]] = {}
    # In processes even if it is only one: a solver that takes its process down costs its own case.
    with Pool(Processes(jobs), jobs) as pool, Progress(len(cases), quiet) as progress:
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
    verdicts = bench.variables["status"].data[:, by_auto]
    return bool(np.isin(verdicts.astype(str), ("SILENT", "timeout")).any())


def speed_table(bench: Mapping[str, np.ndarray]) -> list[list[str]]:
    """A row per case: the fastest method, with its run time, for each number of digits."""
    rows = [["case", *(f"{digits} digits" for digits in DIGITS)]]
    for case, error, run_time in zip(bench["case"], bench["error"], bench["run_time"], strict=True):
        winners = []
        for digits in DIGITS:
            # A comparison with nan is false, so that a trial without an error is never the fastest.
            times = np.where(error <= 10.0**-digits, run_time, np.inf).min(axis=1)
            method, time = bench["method"][times.argmin()], times.min()
            winners.append(f"{method} {seconds(time)}" if np.isfinite(time) else "-")
        rows.append([case, *winners])
    return rows


def verdict_table(bench: Mapping[str, np.ndarray]) -> list[list[str]]:
    """A row per case: what auto took, its error, floor and run time, its verdict, and the methods
    by verdict."""
    header = ["case", "auto takes", "error", "one ulp", "run time", "verdict"]
    rows = [[*header, "fastest that is right"]]
    is_auto = bench["method"] == "auto"
    for i, case in enumerate(bench["case"]):
        taken, error, floor, run_time, status = (
            bench[name][i, :, 0]
            for name in ("method_taken", "error", "floor", "run_time", "status")
        )
        is_right = error <= np.fmax(ERROR_SLACK * ERROR_LIMIT_ASKED, ULP_EFFECTS * floor)
        is_right[is_auto] = False
        times = np.where(is_right, run_time, np.inf)
        best = times.argmin()
        rival = f"{taken[best]} {seconds(times[best])}" if is_right.any() else "-"
        by_auto = ["-"] * 5
        for j in np.flatnonzero(is_auto):
            numbers = magnitude(error[j]), magnitude(floor[j]), seconds(run_time[j])
            by_auto = [taken[j], *numbers, status[j]]
        rows.append([case, *by_auto, rival])
    return rows


def table_of_bench(bench: Group, as_markdown: bool) -> str:
    """The table of a bench, by tolerances where there are several, else by verdicts: for the
    terminal or for a document."""
    data = {name: variable.data for name, variable in bench.variables.items()}
    header, *rows = speed_table(data) if len(data["tol"]) > 1 else verdict_table(data)
    return markdown(header, rows) if as_markdown else table(header, rows)
