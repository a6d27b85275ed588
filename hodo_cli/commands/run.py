"""`hodo run`: which cases of a config run, and why; how they run, and what is stored of a case that
fails."""

import os
import re
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from .. import NOT_OF_A_CASE, HodoError
from ..batch import Pool, digest, lack_of_memory
from ..cases.case import Case, dump
from ..cases.config import Config, located, no_case
from ..integration import Trajectory, integrate
from ..models.attitude import warnings_of
from ..progress import Progress
from ..results.groups import case_group
from ..results.layout import SUMMARY
from ..results.resume import (
    CONFIG_PATH,
    FORCED,
    attributes_by,
    case_digest,
    check_origin,
    path_from,
    rerun_reason,
)
from ..storage import (
    HEAD,
    ORDER,
    FinishedCase,
    Group,
    finished_cases,
    open_run,
    part_name,
    parts_of,
    publish,
    put_part,
    tidy,
    typed,
    update,
)
from ..text import few, file_name_fault, grouped

if TYPE_CHECKING:
    from ..sweeps.columns import Earlier

CASE_KEPT = "is kept, though it is no longer in the config (--prune drops it)"
CASE_DROPPED = "is dropped: it is no longer in the config"

PART_SECONDS = 0.5
"""The seconds within which finished cases share a part: a kill may cost as much work."""

LONGEST_OVERRIDES = 150
"""The most bytes of overrides in a file name. A name has at most 255, some of which the config's
name and hidden files need."""


@dataclass(frozen=True)
class Plan:
    """The plan of `hodo run` for one config: the requested cases (`asked`), the `reasons` why some
    of them run, and the `stored` result of each case, the latest or one that is still right.

    A case that is to run again keeps its stored result if the run stops before it. `prune` drops
    the cases that are no longer in the config.
    """

    config: Config
    path: Path
    asked: Sequence[str]
    reasons: Mapping[str, str]
    stored: Mapping[str, FinishedCase]
    prune: bool = False

    @property
    def left(self) -> list[str]:
        """The stored cases that have left the config."""
        return [name for name in self.stored if name not in self.config.cases]

    def planned(self) -> list[dict[str, str]]:
        """For each requested case, why it runs or not; and for each stored case that has left the
        config, whether it stays."""
        plans = {
            name: f"will run: {self.reasons[name]}{self.members_kept(name)}"
            if name in self.reasons
            else "is kept: nothing that it depends on has changed"
            for name in self.asked
        }
        plans |= dict.fromkeys(self.left, CASE_DROPPED if self.prune else CASE_KEPT)
        return [{"run": str(self.path), "case": name, "plan": plans[name]} for name in plans]

    def members_kept(self, name: str) -> str:
        """How many members of a sweep that has grown are not computed again, in words; empty for
        other cases."""
        case = self.config.cases[name]
        earlier = self.earlier(case) if case.sweep and name in self.stored else None
        return f"; {earlier.kept} of {earlier.members} members are kept" if earlier else ""

    def execute(
        self, pool: Pool, progress: Progress, fail_fast: bool = False
    ) -> list[dict[str, Any]]:
        """Run the cases and store them. Returns a row for each requested case that was reached, in
        the order of the config.

        A case that fails, for whatever reason, is stored as failed unless it has an earlier result
        that ended well; `fail_fast` leaves out the cases after it. Raises BatchError if the result
        cannot be written.
        """
        self.announce(progress)
        attributes = attributes_by(f"run {self.config.path}", self.config)
        attributes[CONFIG_PATH] = path_from(self.config, self.path)
        publish_all = partial(
            publish,
            self.path,
            attributes,
            chosen={name: item.file for name, item in self.kept.items()},
            dropped=self.left if self.prune else (),
            order=[*self.config.cases],
        )
        reached = Reached(self.path)
        if self.reasons:
            # A folder that cannot be written shows before hours of integration, not after.
            put_part(self.path, HEAD, {}, {**attributes, ORDER: "\n".join(self.config.cases)})
        try:
            with closing(self.outcomes(pool, progress, reached)) as outcomes:
                for case, outcome in outcomes:
                    group = outcome if isinstance(outcome, Group) else failed_group(case, outcome)
                    problem = failure_words(group, outcome)
                    old = self.stored.get(case.name)
                    reached.rows[case.name] = group.attributes
                    if problem and old and old.attributes["status"] == "ok":
                        progress.done(case.name, f"{problem}; its earlier result is kept")
                    elif group.streamed:
                        publish_all(groups={case.name: group})
                        progress.done(case.name, problem)
                        self.tidy_chunks("" if problem else case_digest(case))
                    else:
                        reached.add(case.name, group, partial(progress.done, case.name, problem))
                    if problem and fail_fast:
                        break
        finally:
            reached.store()
            self.tidy_chunks()
        if parts_of(self.path) or self.is_changed(attributes):
            publish_all()
        self.renew_remarks()
        tidy(self.path)
        return self.rows(reached.rows)

    @property
    def kept(self) -> dict[str, FinishedCase]:
        """The stored results of the requested cases that are still right."""
        return {name: self.stored[name] for name in self.asked if name not in self.reasons}

    def announce(self, progress: Progress) -> None:
        """Print which results are dropped, the whole plan if verbose, and the warnings that the
        data of cases give."""
        for row in self.planned():
            show = progress.say if row["plan"] == CASE_DROPPED else progress.detail
            show(plan_lines([row]))
        # Before the run, because a motion into which the data feed energy may run to its last step.
        cases = self.config.cases
        warned = ((text, name) for name in self.reasons for text in early_warnings(cases[name]))
        for warning, names in grouped(warned).items():
            progress.say(f"{few(names)}: warning: {warning}")

    def outcomes(
        self, pool: Pool, progress: Progress, reached: "Reached"
    ) -> Generator[tuple[Case, Group | Exception], None, None]:
        """Each case that runs, with its group to be stored or the error by which it failed: first
        single cases, then sweeps."""
        cases = [self.config.cases[name] for name in self.reasons]
        single = [case for case in cases if not case.sweep]
        yield from pool.map(finished_case, progress.starting(single, attrgetter("name")))
        for case in (case for case in cases if case.sweep):
            from ..sweeps.sweep import run_sweep

            reached.store()  # finished cases may wait for others, and a sweep takes long
            resume = self.reasons[case.name] != FORCED
            try:
                earlier, hash = self.earlier(case), case_digest(case)
                yield case, run_sweep(case, hash, self.path, pool, resume, progress, earlier)
            except NOT_OF_A_CASE:
                raise
            except Exception as error:
                yield case, error

    def earlier(self, case: Case) -> "Earlier | None":
        """The stored result of a sweep that has only gained members since; None for other
        sweeps."""
        from ..sweeps.columns import earlier_result  # only sweeps need it

        stored = self.stored.get(case.name) if self.reasons[case.name] != FORCED else None
        return earlier_result(case, case_digest(case), stored)

    def tidy_chunks(self, finished: str = "") -> None:
        """Remove the chunks of a sweep that is stored whole and, with `prune`, the chunks of sweeps
        that are not in the config."""
        cases = self.config.cases.values() if self.prune else ()
        wanted = [case_digest(case) for case in cases if case.sweep]
        tidy(self.path, lambda sweep: sweep == finished or (self.prune and sweep not in wanted))

    def renew_remarks(self) -> None:
        """Store the texts of kept cases whose remarks have changed."""
        texts = {name: dump(self.config.cases[name]) for name in self.kept}
        renewed = {
            x: y for x, y in texts.items() if y != str(self.stored[x].attributes.get("case"))
        }
        if renewed:
            with update(self.path) as changes:
                for name, text in renewed.items():
                    changes.write(name, Group({"case": text}, {}))

    def is_changed(self, attributes: Mapping[str, str]) -> bool:
        """Whether an existing result has another config, or cases that are dropped."""
        if not self.path.exists():
            return False
        with open_run(self.path) as run:
            return run.text != attributes["config"] or (self.prune and bool(self.left))

    def rows(self, reached: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
        """A row for each requested case that has ended, now or when it was stored."""
        rows = {name: item.attributes for name, item in self.stored.items()} | {**reached}
        return [
            {"case": name, **typed(rows[name], SUMMARY, f"{self.path}: {name}")}
            for name in self.asked
            if name in rows
        ]


@dataclass
class Reached:
    """The cases that a run has reached: their attributes, and the groups that are not yet stored,
    each with a function to call once it is safe."""

    path: Path
    rows: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    waiting: dict[str, tuple[Group, Callable[[], object]]] = field(default_factory=dict)
    stored_at: float = field(default_factory=monotonic)

    def add(self, name: str, group: Group, then: Callable[[], object]) -> None:
        """Take a finished case. Short cases share a part, because writing a file takes as long as a
        case. Raises BatchError as `put_part` does."""
        self.waiting[name] = group, then
        took = float(group.attributes.get("run_time", 0.0))
        if max(took, monotonic() - self.stored_at) > PART_SECONDS:
            self.store()

    def store(self) -> None:
        """Store the waiting cases as one part. Raises BatchError as `put_part` does."""
        if self.waiting:
            put_part(
                self.path, part_name(), {name: group for name, (group, _) in self.waiting.items()}
            )
        self.stored_at, stored, self.waiting = monotonic(), self.waiting, {}
        for _, then in stored.values():
            then()


def plan_lines(rows: Iterable[Mapping[str, str]]) -> str:
    """The plans for cases, a line each."""
    return "\n".join(f"{row['case']}: {row['plan']}" for row in rows)


def run_plans(
    plans: Sequence[Plan],
    jobs: int,
    scheduler: str | None = None,
    quiet: bool = False,
    verbose: bool = False,
    fail_fast: bool = False,
) -> list[dict[str, Any]]:
    """Carry out the plans in `jobs` processes or on a dask scheduler. Returns the rows of
    `Plan.execute`. Raises BatchError as it does, or if no scheduler answers."""
    rows: list[dict[str, Any]] = []
    total = sum(len(plan.reasons) for plan in plans)
    with Pool(jobs, scheduler) as pool, Progress(total, quiet, verbose) as progress:
        for plan in plans:
            rows += plan.execute(pool, progress, fail_fast)
            if fail_fast and any(row["status"] != "ok" for row in rows):
                break
    return rows


def plans(
    configs: Sequence[Config],
    out: Path,
    globs: Sequence[str],
    force: bool,
    jobs: int = 1,
    prune: bool = False,
    overrides: Sequence[str] = (),
) -> list[Plan]:
    """The plan of each config with a requested case; the results go into the folder `out`, under
    the names that `result_name` gives.

    Stored cases that have left the config stay, unless `prune`.

    Raises HodoError if two configs have one name, no case is requested, an existing result is
    damaged or, without `force`, belongs to another config, or a case does not fit into the memory
    of each of `jobs` processes.
    """
    paths = [out / result_name(config, overrides) for config in configs]
    for path in paths:
        if fault := file_name_fault(path.stem, [other.stem for other in paths]):
            raise HodoError(f"{path}: {fault}")
        if (count := paths.count(path)) > 1:
            raise HodoError(f"{path} would hold the results of {count} configs: rename one")
    pairs = zip(configs, paths, strict=True)
    made = [plan_of(config, path, globs, force, prune) for config, path in pairs]
    if not any(plan.asked for plan in made):
        raise no_case(globs, [name for config in configs for name in config.cases])
    for plan in made:
        for name in plan.reasons:
            if message := lack_of_memory(plan.config.cases[name], jobs):
                raise located(plan.config, ("cases", name, "time", "samples"), message)
    return [plan for plan in made if plan.asked]


def plan_of(config: Config, path: Path, globs: Sequence[str], force: bool, prune: bool) -> Plan:
    """Which cases of a config run, and why; stored cases that `globs` leave out stay.

    Raises HodoError as `finished_cases` does, or, without `force`, as `check_origin` does.
    """
    if os.path.lexists(path) and not force:
        with open_run(path) as run:
            check_origin(config, run, ": write elsewhere (--out), or over them (--force)")
    # Everything that the table shows is read here: to read thousands of cases again takes seconds.
    done = finished_cases(path, (*SUMMARY, "hash", "case"))
    asked, reasons = config.matching(globs), {}
    stored = {name: items[0] for name, items in done.items()}
    for name in asked:
        case = config.cases[name]
        if valid := [item for item in done.get(name, ()) if not rerun_reason(case, item, force)]:
            stored[name] = valid[0]
        else:
            reasons[name] = rerun_reason(case, stored.get(name), force)
    return Plan(config, path, asked, reasons, stored, prune)


def result_name(config: Config, overrides: Sequence[str]) -> str:
    """The file of a config's results: NAME.h5 or, with overrides, NAME,CASE.KEY=VALUE.h5, so that a
    trial does not replace the results of the unchanged config."""
    # Of two overrides of one key the last counts.
    last = {text.partition("=")[0]: text for text in overrides}.values()
    exact = ",".join(sorted(last))
    changes = re.sub(r"[^\w.,=+()\[\]{}-]", "_", exact)
    # Two formulas or patterns may differ only in signs that a file name cannot have: a digest tells
    # them apart. `*.`, the pattern for all cases, needs none: it becomes `_.`, and no case has the
    # name `_`.
    has_signs = any(re.search(r"[^\w.,:=+()\[\]{}\s'\"-]", x.removeprefix("*.")) for x in last)
    if has_signs or len(changes.encode()) > LONGEST_OVERRIDES:
        beginning = changes.encode()[:LONGEST_OVERRIDES].decode(errors="ignore")
        changes = f"{beginning}-{digest(exact)[:8]}"
    return ",".join(filter(None, [Path(config.path).stem, changes])) + ".h5"


def finished_case(case: Case) -> Group:
    """The group of a case after its integration. Raises HodoError if its method is not available
    here."""
    return case_group(integrate(case), case_digest(case))


def failed_group(case: Case, error: Exception) -> Group:
    """The group of a case that could not be integrated."""
    message = str(error) if isinstance(error, HodoError) else f"{type(error).__name__}: {error}"
    return case_group(Trajectory.failed(case, message), case_digest(case))


def failure_words(group: Group, outcome: Group | Exception) -> str:
    """Why a finished case did not end well; with a traceback if the user did not cause it."""
    if isinstance(outcome, Exception) and not isinstance(outcome, HodoError):
        return "failed: " + "".join(traceback.format_exception(outcome)).rstrip()
    status = group.attributes["status"]
    return "" if status == "ok" else f"{status}: {group.attributes['message']}"


def early_warnings(case: Case) -> list[str]:
    """The warnings of a model about the data of a case or, for a sweep, about the data of the
    members at its ends."""
    if not case.sweep:
        return warnings_of(case.system)
    from ..sweeps.members import warnings_of_ends  # only sweeps need them

    return warnings_of_ends(case)
