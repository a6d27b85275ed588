"""`hodo plot`: figures from result files. A figure that would be drawn as it is already is kept.

What draws is imported late: matplotlib takes longer to load than it takes to see that
nothing is to be drawn.
"""

import gc
import json
import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from .. import HodoError
from ..batch import Pool
from ..cases.config import Config, load
from ..cases.figure_block import FILM_FORMATS, PAGE_DATA, DrawnFigure
from ..machine import library_version, relative_path
from ..progress import Progress
from ..schema.document import YAML_SUFFIXES
from ..storage import ResultFile, open_batch, replacing
from ..text import few, grouped
from .resume import (
    content_digest,
    place_of_config,
    result_named,
    results_named,
    stored_config,
    warn_of_changes,
)

if TYPE_CHECKING:
    from ..results.dataset import StoredCases

SOURCES = (".h5", *YAML_SUFFIXES)
"""The suffixes of results and of their configs; a bare name has none."""

DRAWN_RECORD = "drawn.json"
"""The file in which a folder of figures records how each of its files was made."""

PAGE_FILE = "index.html"
"""The page of all figures."""

ABSENT_CASE = "absent"
"""Stands for the checksum of a case that a figure has asked for and the result does not hold."""

UNKNOWN_CONTENT = os.urandom(8).hex()
"""Stands for the checksum of a case that has none to go by: of what only this process has drawn."""


@contextmanager
def opened_to_draw(path: Path, config: Config | None) -> Iterator[tuple[ResultFile, Config]]:
    """A result file with its config, or with that as it is now, which named it.

    Raises HodoError if one of the two cannot be read.
    """
    with open_batch(path) as run:
        warn_of_changes(run, config, "plot")
        config = config or stored_config(run)
        figures = {
            name: {**spec, "style": with_sheet(spec["style"], run, Path())}
            for name, spec in config.figures.items()
        }
        # Figures are drawn from the stored cases. A config without its own is quick to pickle.
        yield run, replace(config, cases={}, figures=figures)


def with_sheet(style: dict[str, Any], run: ResultFile, base: Path) -> dict[str, Any]:
    """The style of a figure of a result with the path of its style sheet from the folder `base`;
    its config gives it from its own folder."""
    sheet = str(style.get("sheet", ""))
    if not sheet.endswith(".mplstyle"):
        return style
    place = os.path.join(os.path.dirname(place_of_config(run)), sheet)
    return {**style, "sheet": relative_path(place, os.path.realpath(base))}


def results_and_figures(names: Sequence[str]) -> tuple[list[Path], list[str]]:
    """The names of results and configs, the first in any case, and the names of figures; a figure
    of the first comes before a config of the same name.

    Raises HodoError if the first is to be asked for its figures, and cannot be read.
    """
    files = [name for i, name in enumerate(names) if not i or name.endswith(SOURCES)]
    if configs := [name for name in names if name not in files and _is_config(name)]:
        with opened_to_draw(*result_named(Path(names[0]))) as (_, config):
            files += [name for name in configs if name not in config.figures]
    return (
        [Path(name) for name in names if name in files],
        [name for name in names if name not in files],
    )


def _is_config(name: str) -> bool:
    """Whether a name names a config that can be read."""
    with suppress(HodoError):
        return bool(load(name))
    return False


def draw_results(
    paths: Sequence[Path],
    names: Sequence[str],
    formats: Sequence[str],
    out: Path,
    jobs: int,
    force: bool,
    alone: Path | None,
) -> Iterator[tuple[str, bool]]:
    """Draw the figures of result files, all or those named, and then a page with all of them, which
    `alone` holds once more with its pictures; what is drawn already is kept, unless `force`.

    Yields the lines to print, each with whether it tells of a problem. Raises HodoError for an
    unknown figure before anything is drawn, or if a file cannot be read.
    """
    if alone is not None and (names or not {"png", "svg"} & {*formats}):
        raise HodoError(
            "--alone embeds all figures: give no figure names, and use --format png or svg"
        )
    folders = []
    for named in results_named(paths):
        with opened_to_draw(*named) as (run, config):
            folders.append(FigureFolder(out, run, config, names, formats, force))
    for path, results in grouped((folder.path, str(folder.result)) for folder in folders).items():
        if len(results) > 1:
            raise HodoError(f"{path} would hold the figures of {' and '.join(results)}: rename one")
    check_films(folders, names, formats)
    draw_missing(folders, formats, jobs)
    figures = [folder.figure(name) for folder in folders for name in folder.names]
    messages = [line for drawn in figures for line in drawn.warnings]
    for drawn in figures:
        if drawn.files and not drawn.problem:
            yield "\n".join(map(str, drawn.files)), False
    # Once for all figures that share it, as a font of the whole file that is not there.
    problems = grouped((drawn.problem, drawn.name) for drawn in figures if drawn.problem)
    for problem, names_with_it in problems.items():
        yield f"{few(names_with_it)}: {problem}", True
    if not names:
        messages += renewed_page(out, folders, force)
        yield str(out / PAGE_FILE), False
    if alone is not None:
        from ..page import write_alone

        write_alone(out / PAGE_FILE, alone)
        yield str(alone), False
    # At the end, when all that is drawn or on the page has been read.
    for line in dict.fromkeys(messages):
        warnings.warn(line, stacklevel=2)


def check_films(
    folders: Sequence["FigureFolder"], names: Sequence[str], formats: Sequence[str]
) -> None:
    """Raise HodoError where films alone are asked for, of a figure that does not move, or where
    none moves."""
    moves = {
        name: folder.config.figure(name)["kind"] == "body"
        for folder in folders
        for name in folder.names
    }
    if {*formats} <= {*FILM_FORMATS} and not (all if names else any)(moves.values()):
        still = next((f"figure {name} does not move" for name in names if not moves[name]), "")
        raise HodoError(f"{still or 'no figure moves'}: only one of kind body makes a film")


def draw_missing(folders: Sequence["FigureFolder"], formats: Sequence[str], jobs: int) -> None:
    """Draw the figures of which a file is not as it would be, in so many processes."""
    pending = sum(len(folder.to_draw) for folder in folders)
    kept = sum(len(folder.names) for folder in folders) - pending
    with Pool(jobs if pending else 1) as workers, Progress(pending) as progress:
        if kept:
            progress.say(f"{kept} of {kept + pending} figures are kept; --force draws them anew")
        for folder in folders:
            drawing = partial(draw_figure, folder.result, folder.config, formats, folder.path)
            for name, drawn in workers.map(drawing, folder.to_draw):
                if isinstance(drawn, Exception):
                    raise drawn
                folder.add(drawn)
                progress.done(name)
            save_record(folder.path, folder.record)


def draw_figure(
    path: Path, config: Config, formats: Sequence[str], folder: Path, name: str
) -> DrawnFigure:
    """Draw a figure of a result file into a folder, by its entry in a config; what a pool does."""
    from ..figures import render
    from ..results.dataset import open_cases

    # Once in each process: what draws is a hundred thousand objects that never become garbage, and
    # every full search for what figures leave behind would go through them.
    if not gc.get_freeze_count():
        gc.freeze()
    with warnings.catch_warnings(record=True) as caught, open_cases(path) as cases:
        warnings.simplefilter("always")
        made = render(cases, config.figures, name, formats, folder)
        messages = warnings_of(caught, cases)
    return replace(made, cases=tuple(sorted(cases.asked)), warnings=messages)


def warnings_of(
    caught: Sequence[warnings.WarningMessage], *results: "StoredCases"
) -> tuple[str, ...]:
    """The warnings that reading and drawing results has given, and that cases which were read of
    one are not classified."""
    from ..results.dataset import lacks_labels

    # A library that calls another by an old name says so to programmers.
    lines = [
        str(item.message) for item in caught if not issubclass(item.category, DeprecationWarning)
    ]
    unlabelled = [
        f"{cases.path} is not classified: run `hodo classify {quote(str(cases.path))}` for "
        "labels and crossings"
        for cases in results
        if any(map(lacks_labels, (cases.cache or {}).values()))
    ]
    return tuple(dict.fromkeys([*lines, *unlabelled]))


class FigureFolder:
    """The figures of one result in a folder, of which some were asked for by their names, and what
    is known of their files there: how they were made, and which are as they would be drawn now."""

    def __init__(
        self, out: Path, run: ResultFile, config: Config,
        names: Sequence[str], formats: Sequence[str], force: bool,
    ) -> None:  # fmt: skip
        """Raises HodoError if there is no figure of one of the names."""
        self.path, self.result, self.config = out / run.path.stem, run.path, config
        for name in names:
            config.figure(name)
        # Paths in it are seen from the working folder, which is nothing that a figure shows.
        figures = {name: with_content(spec) for name, spec in config.figures.items()}
        self.known_config = replace(config, path="", figures=figures)
        self.names, self.formats = [*dict.fromkeys(names or config.figures)], formats
        self.checksums = {name: run.checksum(name) or UNKNOWN_CONTENT for name in run.groups}
        self.record = read_record(self.path)
        self.problems: dict[str, str] = {}
        self.to_draw = [
            name
            for name in self.names
            if force or not all(self._is_current(name, file) for file in self._files(name))
        ]

    def figure(self, name: str, others: bool = False) -> DrawnFigure:
        """A figure that was asked for, once it is drawn: its files of the formats that were asked
        for and, with `others`, of those before."""
        # A kind that does not move has no film, and what could not be drawn has no file.
        files = [x for x in self._files(name, others) if self._is_current(name, x)]
        paths = tuple(path for path in map(self.path.joinpath, files) if path.exists())
        lines = [line for file in self._files(name) for line in self.record[file]["warnings"]]
        messages, problem = tuple(dict.fromkeys(lines)), self.problems.get(name, "")
        return DrawnFigure(name, paths, problem, (), messages)

    def shown(self) -> list[DrawnFigure]:
        """The figures as the page shows them, with their files of other formats too."""
        return [self.figure(name, others=True) for name in self.names]

    def add(self, drawn: DrawnFigure) -> None:
        """Take in a figure that has just been drawn. One that could not be is tried again; its
        files in other formats stand, as where a film lacks its encoder."""
        self.problems[drawn.name] = drawn.problem
        for file in self._files(drawn.name):
            digest = "" if drawn.problem else self._digest(drawn.name, drawn.cases, file)
            known = {"digest": digest, "cases": drawn.cases, "warnings": drawn.warnings}
            self.record[file] = known

    def _files(self, name: str, others: bool = False) -> dict[str, None]:
        """The files of a figure in the formats that were asked for and, with `others`, of those
        before."""
        asked = [f"{name}.{suffix}" for suffix in self.formats]
        recorded = [file for file in self.record if Path(file).stem == name] if others else []
        return dict.fromkeys([*asked, *recorded])

    def _is_current(self, name: str, file: str) -> bool:
        """Whether a file of a figure is as it would be drawn."""
        entry = self.record.get(file, NEVER_DRAWN)
        return bool(entry["digest"] == self._digest(name, entry["cases"], file))

    def _digest(self, name: str, cases: Iterable[str], file: str) -> str:
        """The digest of a figure's file and of all that it depends on: the figure's entry in the
        config, the cases that it has asked for, and the code that draws."""
        spec = self.known_config.figure(name)
        others = [self.known_config.figures.get(other) for other in spec.get("scale_with", ())]
        known = spec, others, library_version("matplotlib"), file_digest(self.path / file)
        return content_digest(
            (self.checksums.get(case, ABSENT_CASE) for case in cases), repr(known)
        )


def with_content(spec: dict[str, Any]) -> dict[str, Any]:
    """The entry of a figure with the digest of its style sheet in place of the path to it."""
    sheet = str(spec["style"].get("sheet", ""))
    return {**spec, "style": {**spec["style"], "sheet": file_digest(Path(sheet)) or sheet}}


def renewed_page(out: Path, folders: Sequence[FigureFolder], force: bool) -> Sequence[str]:
    """Write the page of all figures, unless it is as it would be; the warnings that it gives."""
    record = read_record(out)
    entry = record.get(PAGE_FILE, NEVER_DRAWN)
    if force or entry["digest"] != page_digest(out, folders):
        messages = page_written(out, folders)
        # Anew, since it covers the page as it is written now.
        entry = {"digest": page_digest(out, folders), "cases": (), "warnings": messages}
        save_record(out, {**record, PAGE_FILE: entry})
    return list(entry["warnings"])


def page_digest(out: Path, folders: Sequence[FigureFolder]) -> str:
    """The digest of the page and of all that it depends on: the results and figures that it shows,
    and the sections of other results."""
    shown = [(folder.known_config, relative_path(folder.result, out)) for folder in folders]
    figures = [
        (drawn.name, [file.name for file in drawn.files], drawn.problem)
        for folder in folders
        for drawn in folder.shown()
    ]
    files = [*sorted(out.glob(f"*/{PAGE_DATA}")), out / PAGE_FILE]
    checksums = [checksum for folder in folders for checksum in folder.checksums.values()]
    return content_digest(checksums, repr((shown, figures, [*map(file_digest, files)])))


def page_written(out: Path, folders: Sequence[FigureFolder]) -> tuple[str, ...]:
    """Write the page of all figures, and return the warnings that it gives."""
    from ..page import PageResult, write_page
    from ..results.dataset import open_cases

    with warnings.catch_warnings(record=True) as caught, ExitStack() as stack:
        warnings.simplefilter("always")
        results = [
            PageResult(
                stack.enter_context(open_cases(folder.result)), folder.config, folder.shown()
            )
            for folder in folders
        ]
        write_page(out / PAGE_FILE, results)
        return warnings_of(caught, *(result.cases for result in results))


def file_digest(file: Path) -> str:
    """The digest of a file's content; an empty text if there is no file."""
    return sha256(file.read_bytes()).hexdigest() if file.is_file() else ""


FileRecord = dict[str, Any]

NEVER_DRAWN: FileRecord = {"digest": None, "cases": (), "warnings": ()}
"""How a file was made: the digest of what it depends on and of its content, the cases that it has
asked for, and the warnings that it gave; here, of a file that has not been drawn."""


def read_record(folder: Path) -> dict[str, FileRecord]:
    """How the files of a folder were made, as JSON beside them says."""
    # One that is missing, unreadable or not ours costs no more than drawing anew.
    with suppress(OSError, ValueError, AttributeError, TypeError, LookupError, RecursionError):
        entries = json.loads((folder / DRAWN_RECORD).read_text(encoding="utf-8"))
        return {
            name: {
                "digest": str(entry["digest"]),
                "cases": [*map(str, entry["cases"])],
                "warnings": [*map(str, entry["warnings"])],
            }
            for name, entry in entries.items()
        }
    return {}


def save_record(folder: Path, record: dict[str, FileRecord]) -> None:
    """Write the record of a folder. Raises HodoError if that is refused."""
    with replacing(folder / DRAWN_RECORD) as draft:
        draft.write_text(json.dumps(record, indent=1, sort_keys=True), encoding="utf-8")
