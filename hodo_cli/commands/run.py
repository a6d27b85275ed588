"""Which cases of a config are run, and why; their running, and what becomes of a case that
fails."""

import os
import re
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from math import prod
from operator import attrgetter
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from .. import NOT_OF_A_CASE, HodoError
from ..batch.digests import digest
from ..batch.memory import check_disk, lack_of_memory
from ..batch.pool import Pool, pool
from ..cases.case import Case, dump
from ..cases.config import Config, located, no_case
from ..integration import Trajectory, integrate
from ..progress import Progress
from ..results.groups import case_group
from ..results.layout import SUMMARY
from ..storage import (
    FinishedCase,
    Group,
    Writer,
    check_writable,
    chunks_in,
    compose,
    finished_cases,
    open_run,
    staging_folders,
    typed,
)
from ..text import few, file_name_fault, grouped
from .resume import (
    CONFIG_PATH,
    FORCED,
    attributes_by,
    case_digest,
    check_origin,
    has_all_of,
    path_from,
    rerun_reason,
)

if TYPE_CHECKING:
    from ..sweeps.columns import Earlier

CASE_KEPT = "is kept, though it is no longer in the config (--prune drops it)"
CASE_DROPPED = "is dropped: it is no longer in the config"

LONGEST_OVERRIDES = 150
"""Bytes of overrides in the name of a file. Names have at most 255, of which the config's own and
those of the hidden folder beside the file need some."""


@dataclass(frozen=True)
class Plan:
    """What `hodo run` does with one config: the cases asked for, the reasons why some of them run,
    and the results that are `stored`: of a case that is kept the one that is still right.

    The stored results of cases to be rerun are kept if the run stops before them. `prune` drops
    those that are no longer in the config.
    """

    config: Config
    path: Path
    asked: Sequence[str]
    reasons: dict[str, str]
    stored: dict[str, FinishedCase]
    prune: bool = False

    @cached_property
    def outdated(self) -> dict[str, FinishedCase]:
        """The stored results of cases to be rerun."""
        return {name: item for name, item in self.stored.items() if name in self.reasons}

    @property
    def dropped(self) -> set[str]:
        """The stored cases that go: those that have left the config, with `prune`, and any of them
        that is damaged, which cannot be copied into the new file."""
        left = self.stored.keys() - self.config.cases
        return {name for name in left if self.prune or self.stored[name].damage}

    def planned(self) -> list[dict[str, str]]:
        """For each case that is asked for, why it runs or not; and for each stored one that has
        left the config, whether it stays."""
        plans = {
            name: f"will run: {self.reasons[name]}{self._parts_kept(name)}"
            if name in self.reasons
            else "is kept: nothing that it depends on has changed"
            for name in self.asked
        }
        left = (name for name in self.stored if name not in self.config.cases)
        plans |= {name: CASE_DROPPED if name in self.dropped else CASE_KEPT for name in left}
        return [{"run": str(self.path), "case": name, "plan": plans[name]} for name in plans]

    def _parts_kept(self, name: str) -> str:
        """The chunks of a sweep that an interrupted run has left, or the members that its stored
        result holds, counted in words; "" for none."""
        if self.reasons[name] == FORCED:
            return ""
        kept = {
            chunk.name
            for folder in staging_folders(self.path)
            for sweep_id in self._sweep_ids([name])
            for chunk in chunks_in(folder, sweep_id)
        }
        if kept:
            from ..sweeps.chunk import chunks

            return f"; {len(kept)} of its {len([*chunks(self.config.cases[name])])} chunks are kept"
        if (earlier := self.earlier(name)) is None:
            return ""
        members = earlier.attributes["members"]
        return f"; {members} of its {prod(earlier.sizes)} members are kept"

    def earlier(self, name: str) -> "Earlier | None":
        """The stored result of a sweep that has only grown since."""
        case = self.config.cases[name]
        if self.reasons.get(name) in (None, FORCED) or not case.sweep or name not in self.stored:
            return None
        from ..sweeps.columns import earlier_result

        return earlier_result(case, case_digest(case), self.stored[name])

    def execute(
        self, pool: Pool, progress: Progress, fail_fast: bool = False
    ) -> list[dict[str, Any]]:
        """Run and store; the attributes of each case that was asked for and reached, in the order
        of the config.

        A case that fails, for whatever reason, is stored as failed unless it has ended well before;
        `fail_fast` leaves out the cases after it. A case with the numbers that are stored already
        keeps its labels, and no statement or figure has to be made again. Raises HodoError if the
        result cannot be written.
        """
        self._announce(progress)
        labelled_before = labelled(self.path, self.outdated)
        attributes = attributes_by(f"run {self.config.path}", self.config)
        attributes[CONFIG_PATH] = path_from(self.config, self.path)
        rows: dict[str, dict[str, Any]] = {}
        with compose(self.path, attributes, tuple(self.config.cases)) as writer:
            cases = [self.config.cases[name] for name in self._take_over(writer)]
            for case, outcome in outcomes(cases, pool, writer, self, progress):
                group = failed_group(case, outcome) if isinstance(outcome, Exception) else outcome
                rows[case.name] = {key: group.attributes[key] for key in SUMMARY}
                self._store(writer, case.name, group, failure_words(group, outcome), progress)
                if fail_fast and group.attributes["status"] != "ok":
                    break
            # Cases that the batch has not reached keep the results that they had.
            for name in self.outdated.keys() - rows.keys():
                writer.keep(self.outdated[name])
        labelled_now = labelled(self.path, labelled_before)
        if lost := [name for name in labelled_before if name not in labelled_now]:
            progress.say(
                f"the labels of {few(lost)} are gone with the old results: "
                f"hodo classify {quote(str(self.path))}"
            )
        return self._rows(rows)

    def _store(
        self, writer: Writer, name: str, group: Group, problem: str, progress: Progress
    ) -> None:
        """Store a case that has ended; in its place an earlier result that is as good, or that
        ended well where this one has a problem."""
        done, old = partial(progress.done, name), self.outdated.get(name)
        if problem and old and old.attributes.get("status") == "ok":
            writer.keep(old)
            done(f"{problem}; its earlier result is kept")
        elif old and self._equals(old, group) and self._keep(writer, old):
            done(problem)
        else:
            writer.add(name, group, partial(done, problem))
        if not problem:
            writer.unfinished -= self._sweep_ids([name])

    def _take_over(self, writer: Writer) -> list[str]:
        """Hand the results that are kept to the writer; the names of the cases that run."""
        gone = self.reasons.keys() | self.dropped
        kept = {name: item for name, item in self.stored.items() if name not in gone}
        if not self.prune:
            writer.keep_all_chunks()
        writer.unfinished |= self._sweep_ids(self.config.cases.keys() - kept.keys())
        # Chunks of a sweep that is stored whole may be left from a loss of power.
        writer.unfinished -= self._sweep_ids(self.config.cases.keys() & kept.keys())
        # Removed by another process since the plan was made: they have to run after all, unless
        # they have left the config.
        lost = [name for name, item in kept.items() if not self._keep(writer, item)]
        writer.keep_others(gone)
        return [*self.reasons, *(name for name in lost if name in self.config.cases)]

    def _announce(self, progress: Progress) -> None:
        """Print which results go and, if asked, what runs; and the warnings that the data give."""
        for row in self.planned():
            tell = progress.say if row["plan"] == CASE_DROPPED else progress.detail
            tell(plan_lines([row]))
        # Before the run: a motion that the data feed energy into may take until its last step.
        cases = self.config.cases
        warned = ((text, name) for name in self.reasons for text in early_warnings(cases[name]))
        for warning, names in grouped(warned).items():
            progress.say(f"{few(names)}: warning: {warning}")

    def _rows(self, reached: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
        """How the cases asked for have ended: now, or when they were stored."""
        rows = {name: item.attributes for name, item in self.stored.items() if not item.damage}
        rows |= reached
        return [
            {"case": name, **typed(rows[name], SUMMARY, f"{self.path}: {name}")}
            for name in self.asked
            if name in rows
        ]

    def _keep(self, writer: Writer, done: FinishedCase) -> bool:
        """Take over a result, with the remarks that the case has now."""
        case = self.config.cases.get(done.name)
        # To compare texts takes less time than to hash a case.
        if case is None or (text := dump(case)) == done.attributes.get("case"):
            return writer.keep(done)
        is_same = done.attributes.get("hash") == case_digest(case)
        return writer.keep(done, text if is_same else "")

    def _sweep_ids(self, names: Iterable[str]) -> set[str]:
        """The digests by which the stored chunks of the sweeps among these cases are known."""
        cases = [self.config.cases[name] for name in names]
        return {digest(case_digest(case)) for case in cases if case.sweep}

    def _equals(self, old: FinishedCase, group: Group) -> bool:
        """Whether an earlier result of a case has the numbers, the hash and the config of a new
        one."""
        if old.damage or group.streamed or old.attributes.get("hash") != group.attributes["hash"]:
            return False
        with suppress(HodoError), open_run(old.file) as run:
            is_ours = run.attributes.get(CONFIG_PATH) == path_from(self.config, self.path)
            return is_ours and has_all_of(run.read(old.name), group)
        return False


def plan_lines(rows: Iterable[Mapping[str, str]]) -> str:
    """What is planned for cases, a line each."""
    return "\n".join(f"{row['case']}: {row['plan']}" for row in rows)


def run_plans(
    plans: Sequence[Plan],
    jobs: int,
    scheduler: str | None = None,
    quiet: bool = False,
    verbose: bool = False,
    fail_fast: bool = False,
) -> list[dict[str, Any]]:
    """Carry out the plans, in so many processes or on a dask scheduler; the attributes of each case
    that was asked for and reached.

    Raises HodoError as `Plan.execute` does, or if no scheduler answers.
    """
    rows: list[dict[str, Any]] = []
    total = sum(len(plan.reasons) for plan in plans)
    takes_part = all(
        is_side_by_side(plan.config.cases[name]) for plan in plans for name in plan.reasons
    )
    workers = pool(jobs, scheduler, takes_part)
    with workers, Progress(total, quiet, verbose) as progress:
        for plan in plans:
            rows += plan.execute(workers, progress, fail_fast)
            if fail_fast and any(row["status"] != "ok" for row in rows):
                break
    return rows


def is_side_by_side(case: Case) -> bool:
    """Whether a case is a sweep whose chunks take equally long. A single case, and a member by
    itself, may take minutes, and what other processes have finished would wait for it."""
    if not case.sweep:
        return False
    from ..sweeps.chunk import reason_alone  # only sweeps need it

    return not reason_alone(case)


def plans(
    configs: Sequence[Config],
    out: Path,
    globs: Sequence[str],
    force: bool,
    jobs: int = 1,
    prune: bool = False,
    overrides: Sequence[str] = (),
) -> list[Plan]:
    """The plan of each config with a case that is asked for; its results go into the folder `out`,
    under the name that `result_name` gives.

    Stored cases that have left the config stay, unless `prune`.

    Raises HodoError if two configs have one name, no case is asked for, a result that is there is
    not whole or, without `force`, that of another config, or a case does not fit into the memory
    that each of so many jobs can have.
    """
    paths = [out / result_name(config, overrides) for config in configs]
    for path in paths:
        if fault := file_name_fault(path.stem, [other.stem for other in paths]):
            raise HodoError(f"{path}: {fault}")
        if (count := paths.count(path)) > 1:
            raise HodoError(f"{path} would hold the results of {count} configs: rename one")
    made = [
        plan_of(config, path, globs, force, prune)
        for config, path in zip(configs, paths, strict=True)
    ]
    if not any(plan.asked for plan in made):
        raise no_case(globs, [name for config in configs for name in config.cases])
    for plan in made:
        check_resources(plan, jobs)
        if (plan.reasons or plan.dropped) and not force:
            check_writable(plan.path, f", or run {FORCED}")
    return [plan for plan in made if plan.asked]


def check_resources(plan: Plan, jobs: int) -> None:
    """Raise HodoError if a case that is to run does not fit into the memory that each of so many
    jobs can have, or on the disk."""
    for case in (plan.config.cases[name] for name in plan.reasons):
        if message := lack_of_memory(case, jobs):
            raise located(plan.config, ("cases", case.name, "time", "samples"), message)
        if case.sweep:
            from ..sweeps.columns import stored_bytes  # only sweeps need it

            check_disk(case, stored_bytes(case), plan.path.parent)


def labelled(path: Path, names: Iterable[str]) -> list[str]:
    """The cases, among some of a result, that `hodo classify` has labelled."""
    if not os.path.lexists(path):
        return []
    with open_run(path) as run:
        return [
            name
            for name in names
            if name in run and name not in run.damaged and run.summary(name, ("classify_warnings",))
        ]


def result_name(config: Config, overrides: Sequence[str]) -> str:
    """The file of a config's results: NAME.h5 or, with overrides, NAME,CASE.KEY=VALUE.h5, so that a
    trial does not replace the results of the config as it is."""
    # Of two for one key the last counts.
    last = {text.partition("=")[0]: text for text in overrides}.values()
    exact = ",".join(sorted(last))
    changes = re.sub(r"[^\w.,=+()\[\]{}-]", "_", exact)
    # Two formulas or patterns may differ in signs alone that no name of a file has; that of all
    # cases becomes `_.`, with which the name of no case begins.
    has_signs = any(re.search(r"[^\w.,:=+()\[\]{}\s'\"-]", x.removeprefix("*.")) for x in last)
    if has_signs or len(changes.encode()) > LONGEST_OVERRIDES:
        beginning = changes.encode()[:LONGEST_OVERRIDES].decode(errors="ignore")
        changes = f"{beginning}-{digest(exact)[:8]}"
    return ",".join(filter(None, [Path(config.path).stem, changes])) + ".h5"


def plan_of(config: Config, path: Path, globs: Sequence[str], force: bool, prune: bool) -> Plan:
    """Which cases of a config run, and why; those that `globs` leave out stay as they are stored.

    Raises HodoError as `finished_cases` does, or, without `force`, as `check_origin` does.
    """
    remedy = ": write elsewhere (--out), or over them (--force)"
    check = partial(check_origin, config, remedy=remedy) if not force else lambda run: None
    # With all that the table shows: to read a file of thousands of cases again takes seconds.
    done = finished_cases(path, check, SUMMARY)
    asked, reasons = config.matching(globs), {}
    stored = {name: items[0] for name, items in done.items()}
    for name in asked:
        case = config.cases[name]
        if valid := [item for item in done.get(name, ()) if not rerun_reason(case, item, force)]:
            stored[name] = valid[0]
        else:
            reasons[name] = rerun_reason(case, stored.get(name), force)
    return Plan(config, path, asked, reasons, stored, prune)


def outcomes(
    cases: Sequence[Case], pool: Pool, writer: Writer, plan: Plan, progress: Progress
) -> Iterator[tuple[Case, Group | Exception]]:
    """Each case with its group to be stored, or the error that left none: single cases, then the
    sweeps."""
    single = [case for case in cases if not case.sweep]
    computed = pool.map(finished_case, progress.starting(single, attrgetter("name")))
    yield from writer.between(computed)
    for case in cases:
        if case.sweep:
            from ..sweeps import sweep

            writer.store()  # sweeps take long, and short cases wait for others
            resume = plan.reasons.get(case.name) != FORCED
            try:
                id, earlier = case_digest(case), plan.earlier(case.name)
                yield case, sweep.run_sweep(case, id, pool, writer, resume, progress, earlier)
            except NOT_OF_A_CASE:
                raise
            except Exception as error:
                yield case, error


def finished_case(case: Case) -> Group:
    """A case integrated, as it is stored. Raises HodoError if its method is not available here."""
    return case_group(integrate(case), case_digest(case))


def failed_group(case: Case, error: Exception) -> Group:
    """A case that could not be integrated, as it is stored."""
    message = str(error) if isinstance(error, HodoError) else f"{type(error).__name__}: {error}"
    return case_group(Trajectory.failed(case, message), case_digest(case))


def failure_words(group: Group, outcome: Group | Exception) -> str:
    """Why a finished case did not end well; with a traceback if the user did not cause it."""
    if isinstance(outcome, Exception) and not isinstance(outcome, HodoError):
        return "failed: " + "".join(traceback.format_exception(outcome)).rstrip()
    status = group.attributes["status"]
    return "" if status == "ok" else f"{status}: {group.attributes['message']}"


def early_warnings(case: Case) -> list[str]:
    """The objections to its model that the data of a case raise, or those of the members at the
    ends of a sweep."""
    if not case.sweep:
        return case.system.warnings
    from ..sweeps.members import warnings_of_ends  # only sweeps need them

    return warnings_of_ends(case)
