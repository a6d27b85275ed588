"""`hodo plot`: figures from result files. A figure that would be drawn as it is already is kept.

What draws is imported late: matplotlib takes longer to load than it takes to see that
nothing is to be drawn.
"""

import json
import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import HodoError
from ..batch.pool import Pool, pool
from ..cases.config import Config, load, parse
from ..cases.figure_block import FORMATS, PIECE, SCRIPT, DrawnFigure
from ..machine import library_version
from ..progress import Progress
from ..schema.document import YAML_SUFFIXES
from ..schema.kinds import unknown
from ..storage.finished import open_batch
from ..storage.hdf5 import ResultFile
from ..storage.staging import replacing
from .resume import content_digest, result_named, warn_of_changes

if TYPE_CHECKING:
    from ..results.dataset import StoredCases

SOURCES = (".h5", *YAML_SUFFIXES)
"""What the name of a result or of its config ends with, unless that is a bare name."""

RECORD = "drawn.json"
"""What a folder of figures keeps of how each of its files was made."""

PAGE_FILE = "index.html"
"""The page of all figures."""

NOTED = {"mark", "sha256", "cases", "said"}
"""What a record has of each file."""

ABSENT = "absent"
"""Stands for the checksum of a case that a figure has asked for and the result does not hold."""


@dataclass(frozen=True)
class FigureTask:
    """A figure to be drawn: from a result file, by its entry in a config, into a folder."""

    path: Path
    config: Config
    name: str
    formats: tuple[str, ...]
    folder: Path


@dataclass(frozen=True)
class PageTask:
    """The page of all figures of a folder, and what it shows anew: results with their configs and
    figures."""

    out: Path
    runs: Sequence[tuple[Path, Config, Sequence[DrawnFigure]]]


@contextmanager
def opened(name: Path) -> Iterator[tuple[ResultFile, Config]]:
    """A result file with its config or, by the name of a config, with that as it is now.

    Raises HodoError if one of the two cannot be read.
    """
    path, config = result_named(name)
    with open_batch(path) as run:
        warn_of_changes(run, config, "plot")
        config = config or parse(run.text, str(path))
        # Cases are drawn from what is stored of them. Without them it is quick to send about.
        yield run, replace(config, cases={})


def split(names: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Which of the names are those of results or configs, the first in any case, and which those of
    figures; a figure of the first comes before a config of the same name.

    Raises HodoError if the first is to be asked for its figures, and cannot be read.
    """
    files = [name for i, name in enumerate(names) if not i or name.endswith(SOURCES)]
    if configs := [name for name in names if name not in files and _is_config(name)]:
        path, config = result_named(Path(names[0]))
        if config is None:
            with open_batch(path) as run:
                config = parse(run.text, str(path))
        files += [name for name in configs if name not in config.figures]
    return (
        [Path(name) for name in names if name in files],
        [name for name in names if name not in files],
    )


def _is_config(name: str) -> bool:
    """Whether a name is that of a config that can be read."""
    with suppress(HodoError):
        return bool(load(name))
    return False


def draw_results(
    paths: Sequence[Path],
    names: Sequence[str],
    formats: Sequence[str],
    out: Path,
    jobs: int = 1,
    force: bool = False,
) -> Iterator[tuple[str, bool]]:
    """Draw the figures of result files, all or those named, and then a page with all of them; what
    is drawn already is kept, unless `force`.

    Yields the lines to print, each with whether it tells of a problem. Raises HodoError for an
    unknown figure or format before anything is drawn, or if a file cannot be read.
    """
    for wrong in (name for name in formats if name not in FORMATS):
        raise HodoError(unknown(f"format {wrong!r}", wrong, FORMATS))
    folders: list[Folder] = []
    for path in paths:
        with opened(path) as (run, config):
            folders.append(Folder(out / run.path.stem, run, config, names, formats, force))
    with pool(jobs if any(folder.tasks for folder in folders) else 1) as workers:
        left = sum(len(folder.tasks) for folder in folders)
        kept = sum(len(folder.figures) for folder in folders)
        with Progress(left, logs=False) as progress:
            if kept:
                progress.say(f"{kept} of {kept + left} figures are kept; --force draws them anew")
            for folder in folders:
                for task, drawn in workers.map(draw_figure, folder.tasks):
                    if isinstance(drawn, Exception):
                        raise drawn
                    folder.add(drawn)
                    progress.done(task.name)
                folder.record.save()
        for drawn in (drawn for folder in folders for drawn in folder.figures):
            if drawn.problem:
                yield f"{drawn.name}: {drawn.problem}", True
            elif drawn.files:
                yield "\n".join(map(str, drawn.files)), False
        said = [line for folder in folders for drawn in folder.figures for line in drawn.warnings]
        if not names:
            said += renewed_page(out, folders, workers, force)
            yield str(out / PAGE_FILE), False
    # At the end, when all that is drawn or on the page has been read.
    for line in dict.fromkeys(said):
        warnings.warn(line, stacklevel=2)


def draw_figure(task: FigureTask) -> DrawnFigure:
    """Draw one figure; what a pool does."""
    from ..figures import render
    from ..results.dataset import open_cases

    with warnings.catch_warnings(record=True) as caught, open_cases(task.path) as cases:
        warnings.simplefilter("always")
        made = render(cases, task.config.figures, task.name, task.formats, task.folder)
        given = warnings_of(caught, cases)
    return replace(made, cases=tuple(sorted(cases.asked)), warnings=given)


def warnings_of(
    caught: Sequence[warnings.WarningMessage], *results: "StoredCases"
) -> tuple[str, ...]:
    """The warnings that reading results has given, and that cases which were read of one are not
    classified."""
    from ..results.dataset import lacks_labels

    lines = [str(warning.message) for warning in caught]
    lines += [
        f"{cases.path} is not classified: run `hodo classify {cases.path}` for labels and crossings"
        for cases in results
        if any(map(lacks_labels, (cases.kept or {}).values()))
    ]
    return tuple(dict.fromkeys(lines))


class Folder:
    """The figures of one result in a folder: those that are kept, and the tasks of the others."""

    def __init__(
        self, path: Path, run: ResultFile, config: Config,
        names: Sequence[str], formats: Sequence[str], force: bool,
    ) -> None:  # fmt: skip
        """Raises HodoError if there is no figure of one of the names."""
        self.path, self.result, self.config = path, run.path, config
        self.checksums = {
            name: "" if name in run.damaged else run.checksum(name) for name in run.groups()
        }
        self.record = Record(path)
        self._formats = tuple(dict.fromkeys(formats))
        chosen = {name: config.figure(name) for name in names or config.figures}
        self._drawn = {name: None if force else self._kept(name) for name in chosen}
        self.tasks = [
            FigureTask(run.path, config, name, self._formats, path)
            for name, drawn in self._drawn.items()
            if drawn is None
        ]

    @property
    def figures(self) -> list[DrawnFigure]:
        """The figures that were asked for, of those that are drawn."""
        return [drawn for drawn in self._drawn.values() if drawn is not None]

    def add(self, drawn: DrawnFigure) -> None:
        """Take in a figure that has just been drawn."""
        self._drawn[drawn.name] = drawn
        # What could not be drawn is tried again: its file may be of an earlier time.
        mark = "" if drawn.problem else self._mark(drawn.name, drawn.cases)
        for file in self._files(drawn.name):
            self.record.note(file, mark, drawn.cases, drawn.warnings)

    def _kept(self, name: str) -> DrawnFigure | None:
        """A figure all of whose files are as they would be drawn; None if one is not."""
        entries = {file: self.record.current(file) for file in self._files(name)}
        if not all(e and e["mark"] == self._mark(name, e["cases"]) for e in entries.values()):
            return None
        # An HTML file that stands by itself shows nothing.
        if "html" in self._formats and not (self.path.parent / SCRIPT).exists():
            return None
        # A kind that cannot be turned has no file in HTML.
        files = tuple(self.path / file for file, e in entries.items() if e and e["sha256"])
        given = dict.fromkeys(line for e in entries.values() if e for line in e["said"])
        return DrawnFigure(name, files, warnings=tuple(given))

    def _files(self, name: str) -> list[str]:
        return [f"{name}.{suffix}" for suffix in self._formats]

    def _mark(self, name: str, cases: Iterable[str]) -> str:
        """What a drawing depends on: its entry in the config, the cases that it has asked for, and
        the code that draws."""
        spec = self.config.figure(name)
        others = [self.config.figures.get(other) for other in spec.get("scale_with", ())]
        return content_digest(
            (self.checksums.get(case, ABSENT) for case in cases),
            repr((spec, others, library_version("matplotlib"), library_version("plotly"))),
        )


def renewed_page(out: Path, folders: Sequence[Folder], workers: Pool, force: bool) -> list[str]:
    """Write the page of all figures, unless it is as it would be; the warnings that it gives."""
    record = Record(out)
    entry = None if force else record.current(PAGE_FILE)
    if entry is None or entry["mark"] != page_mark(out, folders):
        task = PageTask(out, [(each.result, each.config, each.figures) for each in folders])
        for _, said in workers.map(page_written, [task]):
            if isinstance(said, Exception):
                raise said
            record.note(PAGE_FILE, page_mark(out, folders), (), said)
        record.save()
    return record.said(PAGE_FILE)


def page_mark(out: Path, folders: Sequence[Folder]) -> str:
    """What the page depends on: the results and figures that it shows, and what the folders of
    others have told it."""
    shown = [(each.config, os.path.relpath(each.result, out)) for each in folders]
    figures = [
        (each.name, [file.name for file in each.files], each.problem)
        for folder in folders
        for each in folder.figures
    ]
    pieces = [file.read_bytes() for file in sorted(out.glob(f"*/{PIECE}"))]
    checksums = [each for folder in folders for each in folder.checksums.values()]
    return content_digest(checksums, repr((shown, figures, pieces)))


def page_written(task: PageTask) -> tuple[str, ...]:
    """Write the page of all figures, and return the warnings that it gives; what a pool does."""
    from ..figures.page import PageResult, write_page
    from ..results.dataset import open_cases

    with warnings.catch_warnings(record=True) as caught, ExitStack() as stack:
        warnings.simplefilter("always")
        results = [
            PageResult(stack.enter_context(open_cases(path)), config, figures)
            for path, config, figures in task.runs
        ]
        write_page(task.out / PAGE_FILE, results)
        return warnings_of(caught, *(result.cases for result in results))


class Record:
    """How the files of a folder were made, as JSON beside them: what each depends on, and the hash
    of its content, which shows a file that something else has changed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._entries: dict[str, dict[str, Any]] = {}
        # One that is missing, unreadable or not ours costs no more than drawing anew.
        with suppress(OSError, ValueError, AttributeError):
            entries = json.loads((folder / RECORD).read_text(encoding="utf-8"))
            self._entries = {name: e for name, e in entries.items() if e.keys() == NOTED}

    def current(self, file: str) -> dict[str, Any] | None:
        """What is noted of a file that has not changed since, and can be kept."""
        entry = self._entries.get(file)
        return entry if entry and entry["mark"] and entry["sha256"] == self._hash(file) else None

    def said(self, file: str) -> list[str]:
        """The warnings that making a file gave."""
        return list(self._entries[file]["said"])

    def note(self, file: str, mark: str, cases: Sequence[str], said: Sequence[str]) -> None:
        """Note how a file was made, or that none was."""
        noted = {"mark": mark, "sha256": self._hash(file), "cases": cases, "said": said}
        self._entries[file] = noted

    def _hash(self, file: str) -> str:
        try:
            return sha256((self._folder / file).read_bytes()).hexdigest()
        except (FileNotFoundError, NotADirectoryError):
            return ""

    def save(self) -> None:
        """Write the record. Raises HodoError if that is refused."""
        with replacing(self._folder / RECORD) as draft:
            draft.write_text(json.dumps(self._entries, indent=1, sort_keys=True), encoding="utf-8")
