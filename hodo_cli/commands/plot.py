"""`hodo plot`: figures from result files."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from operator import itemgetter
from pathlib import Path
from typing import Any

from .. import HodoError
from ..figures import draw, page
from ..figures.sheet import FORMATS, Rendered, save
from ..progress import Progress
from ..results.dataset import Results, results_of
from ..results.writer import open_batch
from ..schema.kinds import nearest
from .resume import CONFIGS, named, warn_of_changes

SOURCES = (".h5", *CONFIGS)
"""What the name of a result or of its config ends with; any other name is that of a figure."""


@contextmanager
def results_named(name: Path) -> Iterator[Results]:
    """A result file, or that of a config, with the figures of the config as it is now.

    Raises HodoError if one of the two cannot be read.
    """
    path, config = named(name)
    with open_batch(path) as run:
        warn_of_changes(run, config, "plot")
        yield results_of(run, config)


def split(names: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Which of the names are those of results or configs, the first in any case, and which those of
    figures."""
    files = [name for i, name in enumerate(names) if not i or name.endswith(SOURCES)]
    return [Path(name) for name in files], [name for name in names if name not in files]


def draw_results(
    files: Sequence[Path], names: Sequence[str], formats: Sequence[str], out: Path
) -> Iterator[tuple[str, bool]]:
    """Draw the figures of result files, all or those named, and then a page with all of them.

    Yields the lines to print, each with whether it tells of a problem. Raises HodoError as `render`
    does, or if a file cannot be read.
    """
    with ExitStack() as stack:
        opened = [stack.enter_context(results_named(path)) for path in files]
        drawn = [
            (results, render(results, names, formats, out / results.path.stem))
            for results in opened
        ]
        for figure in (figure for _, figures in drawn for figure in figures):
            if figure.problem:
                yield f"{figure.name}: {figure.problem}", True
            else:
                yield "\n".join(map(str, figure.files)), False
        if not names:
            page.write_page(out / "index.html", drawn)
            yield str(out / "index.html"), False
        # At the end, when all that is drawn or on the page has been read.
        for results in opened:
            if results.lacks_labels:
                said = f"run `hodo classify {results.path}` for labels and crossings"
                warnings.warn(f"{results.path} is not classified: {said}", stacklevel=2)


def render(
    results: Results, names: Sequence[str], formats: Sequence[str], out: Path
) -> list[Rendered]:
    """Draw the named figures of a result file (all, if none is named) into the folder `out`.

    A figure that cannot be drawn does not keep the others: its `problem` says why. Raises
    HodoError, before anything is drawn, for an unknown figure or format.
    """
    chosen = [(name, results.figure(name)) for name in names or results.figures]
    for wrong in (name for name in formats if name not in FORMATS):
        raise HodoError(
            f"unknown format {wrong!r}{nearest(wrong, FORMATS)} (valid: {', '.join(FORMATS)})"
        )
    with Progress(len(chosen), logs=False) as progress:
        return [
            _rendered(results, name, spec, [out / f"{name}.{suffix}" for suffix in formats])
            for name, spec in progress.each(chosen, itemgetter(0))
        ]


def _rendered(
    results: Results, name: str, spec: Mapping[str, Any], files: Sequence[Path]
) -> Rendered:
    """Draw one figure into files; whatever goes wrong with it is its own problem."""
    try:
        return Rendered(name, tuple(_files(results, name, spec, files)))
    except HodoError as error:
        return Rendered(name, problem=str(error))
    except ModuleNotFoundError:
        raise
    except Exception as error:
        # A mistake of ours in one figure shall not cost the others; it is no traceback then, so
        # the kind of the error is part of what is said.
        return Rendered(name, problem=f"{type(error).__name__}: {error}")


def _files(
    results: Results, name: str, spec: Mapping[str, Any], files: Sequence[Path]
) -> Iterator[Path]:
    """The files of one figure, each when it is written."""
    sheet = draw(spec, results)
    for path in files:
        if path.suffix == ".html":
            # Late, because plotly need not be installed where no figure is to be turned.
            from ..figures.interactive import STILL, write_interactive

            if spec["kind"] in STILL:
                continue
            write_interactive(sheet, spec, results, path, name)
        else:
            save(sheet, path, about=spec["caption"])
        yield path
