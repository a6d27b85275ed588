"""Sweeps: a case with a `sweep:` block, as an ensemble of single cases that are reduced to a few
numbers each.

The members go in chunks, which are the tasks of a pool. Each finished chunk is stored by itself, so
that a run that is killed goes on from there, and no more than a few of them are in memory at a
time.
"""

from ..batch.digests import digest
from ..batch.pool import Pool
from ..cases.case import Case
from ..progress import Progress
from ..storage.group import Group
from ..storage.writer import Writer
from .chunk import Chunk, chunks, compute
from .grid import group_of_columns
from .summary import PROBES, Summary, lost_chunk, sampled_errors


def run_sweep(
    case: Case, case_digest: str, pool: Pool, writer: Writer, resume: bool, progress: Progress
) -> Group:
    """All members of a sweep as the group of a result file; with `resume`, the chunks that an
    earlier run with the same digest has stored are kept."""
    sweep_id = digest(case_digest)
    stored = writer.chunks(sweep_id) if resume else set()
    tasks = list(chunks(case))
    problems: dict[str, int] = {}
    lost: set[int] = set()
    if stored:
        progress.detail(f"{case.name}: {len(stored)} of {len(tasks)} chunks are kept")

    def finished(chunk: Chunk) -> Group:
        return lost_chunk(chunk) if chunk.first in lost else writer.chunk(sweep_id, chunk.first)

    summary = Summary(case, tasks[-1].last)
    kept = [chunk for chunk in tasks if chunk.first in stored]
    for chunk in kept:
        summary.add(chunk, finished(chunk))
    # A chunk and a task of measuring errors take about as long as each other.
    members = len(tasks) / (len(tasks) + (PROBES if case.error == "on" else 0))
    progress.report(case.name, members * len(kept) / len(tasks))
    missing = [chunk for chunk in tasks if chunk.first not in stored]
    for i, (chunk, outcome) in enumerate(pool.map_brief(compute, missing), len(kept) + 1):
        progress.report(case.name, members * i / len(tasks))
        if isinstance(outcome, Exception):
            # A chunk that fails costs its own members; the sweep goes on and says how many.
            problems[str(outcome)] = problems.get(str(outcome), 0) + chunk.last - chunk.first
            lost.add(chunk.first)
            summary.add(chunk, finished(chunk))
        else:
            writer.add_chunk(sweep_id, chunk.first, outcome)
            summary.add(chunk, outcome)

    def report(share: float) -> None:
        progress.report(case.name, members + (1 - members) * share)

    errors = sampled_errors(pool, summary, report) if case.error == "on" else {}
    return group_of_columns(case, case_digest, tasks, finished, summary, errors, problems)
