"""`hodo bench`: error against run time, every case of a config by every method at every
tolerance."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from operator import attrgetter
from pathlib import Path

import numpy as np

from .. import HodoError
from ..batch.pool import Pool
from ..batch.processes import Processes
from ..cases.case import Case
from ..cases.config import Config, no_case
from ..figures.costs import draw_bench
from ..figures.sheet import save
from ..integration.integrate import ASKED
from ..progress import Progress
from ..results.trials import SLACK, TRIAL_VERDICTS, ULPS, Trial, trials_of
from ..storage.group import Group, Variable
from ..storage.output import create
from ..storage.provenance import history_line, root_attributes
from ..storage.staging import replacing
from ..text import magnitude, seconds, table

DIGITS = (3, 6, 9, 12)
"""The numbers of right digits for which the fastest method is named."""

MEASURED = {
    "method": ("method taken", "1"),
    "status": ("what the result is worth", "1"),
    "error": ("largest relative error of a stored variable", "1"),
    "crossing_error": ("largest relative error of the time of a crossing", "1"),
    "run_time": ("least processor time of an integration", "s"),
    "compile_time": ("time that the first integration took beyond its run time", "s"),
    "steps": ("steps", "1"),
    "rhs_evaluations": ("evaluations of the equations", "1"),
    "drift": ("largest relative change of what is conserved", "1"),
    "floor": ("error that one ulp in the data makes", "1"),
    "message": ("why it stopped", "1"),
}


@dataclass(frozen=True)
class Bench:
    """The trials of a config, in the order case, method, tolerance; a tolerance of nan is the
    method's own."""

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
                {"long_name": MEASURED[name][0], "units": MEASURED[name][1]},
            )
            for name in MEASURED
        }
        return Group({}, coordinates | values)


def benchmark(config: Config, globs: Sequence[str], out: Path, jobs: int, quiet: bool) -> Bench:
    """Try the cases of a config, all or those that match, and store the trials and their figure.

    Raises HodoError if the config has no `bench:` section, no case matches, or a file cannot be
    written.
    """
    bench = try_cases(config, chosen(config, globs), jobs, quiet)
    name = Path(config.path).stem
    store(bench, config, out / f"{name}.bench.h5")
    save(draw_bench(bench.group(), TRIAL_VERDICTS), out / "figures" / f"{name}.png")
    return bench


def chosen(config: Config, globs: Sequence[str]) -> list[Case]:
    """The cases whose names match; all if no glob is given. Raises HodoError if none does."""
    if not (names := config.matching(globs)):
        raise no_case(globs, config.cases)
    return [config.cases[name] for name in names]


def try_cases(config: Config, cases: Sequence[Case], jobs: int, quiet: bool) -> Bench:
    """The trials of these cases by the `bench:` section of their config.

    Raises HodoError if there is no such section; a case whose process dies has failed trials.
    """
    if (settings := config.bench) is None:
        raise HodoError(
            f"{config.path}: there is no bench: section, which names the methods to be compared"
        )
    methods, tols = settings["methods"], settings["tols"] or (math.nan,)
    work = partial(
        trials_of,
        methods=methods,
        tols=settings["tols"],
        repeats=settings["repeats"],
        max_seconds=settings["max_seconds"],
    )
    trials: dict[str, list[Trial]] = {}
    # In processes even if it is only one: a solver that takes its process down costs its own case.
    with Pool(partial(Processes, jobs), jobs) as pool, Progress(len(cases), quiet) as progress:
        for case, outcome in pool.map(work, progress.starting(cases, attrgetter("name"))):
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
                progress.say(
                    f"{case.name}: {count_of_trials(trials[case.name])} ({seconds(spent)})"
                )
                progress.done(case.name)
    names = tuple(case.name for case in cases)
    return Bench(names, methods, tols, tuple(trial for name in names for trial in trials[name]))


def count_of_trials(trials: Sequence[Trial]) -> str:
    """How many of the trials have each verdict."""
    counts = {word: sum(trial.status == word for trial in trials) for word in TRIAL_VERDICTS}
    return ", ".join(f"{count} {word}" for word, count in counts.items() if count)


def store(bench: Bench, config: Config, path: Path) -> None:
    """Store a bench as the only group, `bench`, of a result file."""
    attributes = root_attributes(
        config.title, config.references, config.text, history_line(f"hodo bench {config.path}")
    )
    with replacing(path) as draft, create(draft, attributes) as output:
        output.write("bench", bench.group())


def auto_failed(bench: Bench) -> bool:
    """Whether auto was wrong without saying so, or was not done in time."""
    return any(
        trial.status in ("SILENT", "timeout") for key, trial in bench.items() if key[1] == "auto"
    )


def fastest(bench: Bench, case: int, digits: int) -> tuple[str, float, float] | None:
    """Method, tolerance and run time of the fastest trial of a case whose error is below
    10^-digits, if any is."""
    error, time = bench.values("error")[case], bench.values("run_time")[case]
    # A comparison with nan is false, so that a trial without an error is never the fastest.
    time = np.where(error <= 10.0**-digits, time, np.inf)
    m, t = np.unravel_index(np.argmin(time), time.shape)
    return (bench.methods[m], bench.tols[t], float(time[m, t])) if np.isfinite(time[m, t]) else None


def speed_table(bench: Bench) -> list[list[str]]:
    """A row per case: the fastest method, with its run time, for each number of digits."""
    rows = []
    for i, case in enumerate(bench.cases):
        winners = [fastest(bench, i, digits) for digits in DIGITS]
        rows.append([case, *("-" if w is None else f"{w[0]} {seconds(w[2])}" for w in winners)])
    return [["case", *(f"{digits} digits" for digits in DIGITS)], *rows]


def verdict_table(bench: Bench) -> list[list[str]]:
    """A row per case: what auto took, its error, floor and run time, its verdict, and the methods
    by verdict."""
    auto = bench.methods.index("auto") if "auto" in bench.methods else 0
    rows = []
    for i, case in enumerate(bench.cases):
        row = bench.trials[i * len(bench.methods) : (i + 1) * len(bench.methods)]
        mine, others = row[auto], [t for j, t in enumerate(row) if j != auto]
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


def printed(bench: Bench, markdown: bool) -> str:
    """The table of a bench, by tolerances where there are several, else by verdicts: for the
    terminal or for a document."""
    header, *rows = speed_table(bench) if len(bench.tols) > 1 else verdict_table(bench)
    if not markdown:
        return table(header, rows)
    lines: Iterable[Sequence[str]] = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(row) + " |" for row in lines) + "\n"
