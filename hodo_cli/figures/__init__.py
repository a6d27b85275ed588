"""Drawings of motions and sweeps, and the page that shows them. They read datasets and know no
command, no engine and no claim; matplotlib is loaded nowhere else.

A kind of figure is a function that draws an entry of a `figures:` block on a sheet. `DRAW` lists
them all; `cases.figure_block` declares the keys that each takes.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.style
from matplotlib.layout_engine import ConstrainedLayoutEngine

from .. import HodoError
from ..results.motion import Results
from .costs import cost, error_order, share
from .maps import sweep_curve, sweep_map
from .plane import invariants, phase, quadrant_sketch, quadrants, time_series
from .sheet import STYLE, Drawing, Rendered, Sheet, check_tex, lighten, save, title_lines
from .space import hodograph, sphere

DRAW: dict[str, Callable[[Sheet, Mapping[str, Any], Results], None]] = {
    "hodograph": hodograph,
    "sphere": sphere,
    "quadrants": quadrants,
    "quadrant-sketch": quadrant_sketch,
    "series": time_series,
    "phase": phase,
    "invariants": invariants,
    "map": sweep_map,
    "curve": sweep_curve,
    "order": error_order,
    "cost": cost,
    "share": share,
}


def draw(spec: Mapping[str, Any], results: Results) -> Sheet:
    """The figure that one entry of a `figures:` block describes.

    Raises HodoError if a case or variable is not in the file, the kind of figure has no meaning for
    it, or a text is not TeX as matplotlib knows it.
    """
    with matplotlib.style.context(["default", STYLE]):
        for text in (*spec.get("labels", ()), f"${spec.get('time', 't')}$"):
            check_tex(text, STYLE["legend.fontsize"])
        check_tex(spec["title"], STYLE["axes.titlesize"])
        sheet = Sheet(Drawing(layout=ConstrainedLayoutEngine(w_pad=0.04, h_pad=0.06)))
        DRAW[spec["kind"]](sheet, spec, results)
        lighten(sheet.figure)
        if spec["title"]:
            width, height = sheet.figure.get_size_inches()
            lines = title_lines(spec["title"], width)
            # The panels keep their size: a line of the title is a fifth of an inch high.
            sheet.figure.set_size_inches(width, height + 0.2 * len(lines))
            sheet.figure.suptitle("\n".join(lines), size=8)
    return sheet


def render(results: Results, name: str, formats: Sequence[str], out: Path) -> Rendered:
    """Draw a figure of a result file into the folder `out`; whatever goes wrong with it is its own
    problem.

    Raises HodoError for an unknown figure.
    """
    spec = results.figure(name)
    files = [out / f"{name}.{suffix}" for suffix in formats]
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
            from .interactive import STILL, write_interactive

            if spec["kind"] in STILL:
                continue
            write_interactive(sheet, spec, results, path, name)
        else:
            save(sheet, path, about=spec["caption"])
        yield path
