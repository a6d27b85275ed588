"""`hodo plot`: figures from result files. A figure that would not change is kept; the drawing
modules are imported late."""

import json
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from hashlib import sha256
from pathlib import Path
from shlex import quote
from typing import Any, NamedTuple

from .. import NOT_OF_A_CASE, HodoError
from ..batch import Pool
from ..cases.config import Config
from ..machine import library_version, relative_path
from ..progress import Progress
from ..results.resume import content_digest, results_named, stored_config, warn_of_changes
from ..schema.document import YAML_SUFFIXES
from ..storage import open_batch, replacing
from ..text import few, grouped

FILMS = ("gif",)
PAGE_FILE, DRAWN_RECORD = "index.html", "drawn.json"

FigureRecord = dict[str, Any]
"""How a figure was drawn: its problem, its warnings, and the digest of each of its files."""

EMPTY: FigureRecord = {"problem": "", "warnings": [], "files": {}, "digest": ""}


class ToDraw(NamedTuple):
    """A result, its config, the digest of each requested figure, and the folder to draw into."""

    path: Path
    config: Config
    digests: dict[str, str]
    folder: Path


def results_and_figures(names: Sequence[str]) -> tuple[list[Path], list[str]]:
    """The arguments of `hodo plot` that name results or configs, and the names of figures. The
    first argument is no figure."""
    is_file = [not i or name.endswith((".h5", *YAML_SUFFIXES)) for i, name in enumerate(names)]
    files = [Path(name) for name, known in zip(names, is_file, strict=True) if known]
    return files, [name for name, known in zip(names, is_file, strict=True) if not known]


def draw_results(
    paths: Sequence[Path], names: Sequence[str], formats: Sequence[str], out: Path, jobs: int,
    force: bool, alone: Path | None,
) -> Iterator[tuple[str, bool]]:  # fmt: skip
    """Draw the figures of result files: those of these names or, without names, all, and then a
    page that shows them. A second page `alone`, if it is given, holds its pictures itself. Figures
    that would not change are kept, unless `force`.

    Yields the lines to print, each with whether it is a problem. Raises HodoError for an unknown
    figure before anything is drawn, or if a file cannot be read.
    """
    if alone and (names or not {"png", "svg"} & {*formats}):
        raise HodoError("--alone shows all figures: give no names, and --format png or svg")
    results, problems = [*results_to_draw(paths, names, out)], []
    check_request(results, formats)
    for result in results:
        record = draw_changed(result, formats, jobs, force)
        for name in result.digests:
            drawn = record[name]
            problems += [(drawn["problem"], name)] if drawn["problem"] else []
            for line in drawn["warnings"]:
                warnings.warn(line, stacklevel=2)
            for file in (file for file in drawn["files"] if file.endswith((*formats,))):
                yield str(result.folder / file), False
    # A problem that several figures share is printed once.
    yield from ((f"{few(of)}: {problem}", True) for problem, of in grouped(problems).items())
    if names:
        return
    from .page import sections_of, write_page  # late, because it loads jinja2

    page = out / PAGE_FILE
    if is_older(page, results):
        write_page(page, [*sections_of(out)], alone=False)
    yield str(page), False
    if alone:
        write_page(alone, [*sections_of(out, alone=True)], alone=True)
        yield str(alone), False


def results_to_draw(paths: Sequence[Path], names: Sequence[str], out: Path) -> Iterator[ToDraw]:
    """The results that paths name, with the figures of these names, or all figures. Raises
    HodoError for a missing figure."""
    for path, config in results_named(paths):
        with open_batch(path) as run:
            warn_of_changes(run, config, "plot")
            config = config or stored_config(run)
            checksums = {name: run.checksum(name) for name in run.groups}
            wanted = dict.fromkeys(names or config.figures)
            digests = {name: figure_digest(config, name, checksums) for name in wanted}
            yield ToDraw(run.path, config, digests, out / run.path.stem)


def check_request(results: Sequence[ToDraw], formats: Sequence[str]) -> None:
    """Raise HodoError if two results have one folder, or if films alone are requested of figures
    that do not move."""
    for stem, of in grouped((result.path.stem, str(result.path)) for result in results).items():
        if len(of) > 1:
            raise HodoError(f"{' and '.join(of)} would both draw into {stem}: rename one")
    figures = [(result.config.figures[name], name) for result in results for name in result.digests]
    if not figures:
        paths = ", ".join(str(result.path) for result in results)
        raise HodoError(f"{paths}: no figures: the case file has no block `figures`")
    if not any(files_of(spec, name, formats) for spec, name in figures):
        raise HodoError(f"no figure moves: only one of kind body makes a film ({', '.join(FILMS)})")


def files_of(spec: Mapping[str, Any], name: str, formats: Sequence[str]) -> list[str]:
    """The files of a figure in these formats; only a body moves and makes a film."""
    return [f"{name}.{x}" for x in formats if x not in FILMS or spec["kind"] == "body"]


def figure_digest(config: Config, name: str, checksums: Mapping[str, str]) -> str:
    """The digest of everything on which a figure depends: its entry, its cases, and the code that
    draws."""
    spec = config.figure(name)
    others = [config.figures.get(other, {}) for other in spec.get("scale_with", ())]
    cases = [case for entry in (spec, *others) for case in entry.get("cases", ())]
    text = repr((spec, others, library_version("matplotlib")))
    return content_digest([checksums.get(case, "absent") for case in cases], text)


def read_record(folder: Path) -> dict[str, FigureRecord]:
    """How the figures of a folder were drawn, by name; empty if the folder has no readable
    record."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        record = json.loads((folder / DRAWN_RECORD).read_text(encoding="utf-8"))["figures"]
        return {name: entry for name, entry in record.items() if {*EMPTY} <= entry.keys()}
    return {}


def is_kept(result: ToDraw, name: str, drawn: FigureRecord, formats: Sequence[str]) -> bool:
    """Whether a figure need not be drawn again: its digest is the same, there was no problem, and
    its files are unchanged."""
    wanted = files_of(result.config.figures[name], name, formats)
    intact = all(drawn["files"].get(x) == file_digest(result.folder / x) != "" for x in wanted)
    return drawn["digest"] == result.digests[name] and not drawn["problem"] and intact


def file_digest(file: Path) -> str:
    """The digest of a file's content; an empty string if there is no file."""
    return sha256(file.read_bytes()).hexdigest() if file.is_file() else ""


def draw_changed(
    result: ToDraw, formats: Sequence[str], jobs: int, force: bool
) -> dict[str, FigureRecord]:
    """Draw the figures of a result that would change, or with `force` all, in `jobs` processes.
    Write the record of all figures, and return it."""
    record, digests = read_record(result.folder), result.digests
    kept = [x for x in digests if not force and is_kept(result, x, record.get(x, EMPTY), formats)]
    if kept:
        words = f"{len(kept)} of {len(digests)} figures are kept; --force draws them anew"
        Progress(0).say(words)
    pending = [name for name in digests if name not in kept]
    if not pending:
        return record
    drawing = partial(draw_figure, result.path, result.config.figures, formats, result.folder)
    with Progress(len(pending)) as progress:
        for name, drawn in Pool(jobs).map(drawing, pending):
            if isinstance(drawn, Exception):
                raise drawn
            old, digest = record.get(name, EMPTY), digests[name]
            others = old["files"] if old["digest"] == digest else {}
            record[name] = {**drawn, "digest": digest, "files": {**others, **drawn["files"]}}
            progress.done(name)
    place = relative_path(result.path, result.folder.parent)
    with replacing(result.folder / DRAWN_RECORD) as draft:
        text = json.dumps({"result": place, "figures": record}, indent=1)
        draft.write_text(text, encoding="utf-8")
    return record


def draw_figure(
    path: Path, figures: Mapping[str, Any], formats: Sequence[str], folder: Path, name: str
) -> FigureRecord:
    """Draw a figure of a result file into a folder, in a process of the pool. Any failure is
    returned as the problem of this figure."""
    from ..figures import draw, save
    from ..results.dataset import lacks_labels, open_cases

    spec, files, problem, caught = figures[name], {}, "", []
    try:
        with warnings.catch_warnings(record=True) as caught, open_cases(path) as cases:
            warnings.simplefilter("always")
            sheet = draw(spec, cases, figures)
            if any(map(lacks_labels, (cases.cache or {}).values())):
                how = f"run `hodo classify {quote(str(path))}` for labels and crossings"
                warnings.warn(f"{path} is not classified: {how}", stacklevel=2)
            for file in files_of(spec, name, formats):
                save(sheet, folder / file, spec["caption"])
                files[file] = file_digest(folder / file)
    except HodoError as error:
        problem = "; ".join(str(error).splitlines())
    except NOT_OF_A_CASE:
        raise
    except Exception as error:  # a fault of hodo in one figure shall not cost the others
        problem = f"{type(error).__name__}: {error}"
    # Warnings of deprecated calls inside libraries are for programmers.
    texts = [str(w.message) for w in caught if not issubclass(w.category, DeprecationWarning)]
    return {**EMPTY, "problem": problem, "warnings": [*dict.fromkeys(texts)], "files": files}


def is_older(page: Path, results: Sequence[ToDraw]) -> bool:
    """Whether a page is missing, or older than a result or its figures."""
    read = [file for x in results for file in (x.path, x.folder / DRAWN_RECORD) if file.exists()]
    return not page.exists() or max(map(os.path.getmtime, read)) > os.path.getmtime(page)
