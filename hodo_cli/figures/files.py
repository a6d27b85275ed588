"""Figures as files: images, tables and films, and pages of their own, which need no other file. In
a page a reader turns what is in space, comes nearer, and reads values with the pointer.

A page shows the figure as it is printed. Over each panel that shows space its script draws what the
panel's scene has kept (`sheet.Scene`), from any side.
"""

import io
import json
from base64 import b64encode
from collections.abc import Mapping
from functools import partial
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from ..cases.figure_block import FILM_FORMATS
from ..storage import replacing
from .sheet import Sheet
from .words import FormulaCanvas, every_panel, without_tex

# Without dates and versions, so that the same results give the same bytes.
UNDATED: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def save(sheet: Sheet, path: Path, about: str = "") -> None:
    """Write a figure in the format of the path's suffix, the same bytes every time; `about` is the
    caption of its page, and goes into the metadata of an image.

    Raises HodoError if the file cannot be written; an older one then stays.
    """
    suffix, film = path.suffix[1:], sheet.figure.film
    with replacing(path) as draft:
        if suffix in FILM_FORMATS:
            film.write(draft, suffix)
        elif suffix == "html":
            back = f"../index.html#{quote(path.parent.name)}-{quote(path.stem)}"
            page = film.page if film else partial(figure_page, sheet)
            draft.write_text(page(path.stem, about, back), encoding="utf-8")
        elif suffix == "csv":
            # No translation of line ends: the file has the same bytes on every system.
            draft.write_text(sheet.csv(), encoding="utf-8", newline="")
        else:
            metadata = UNDATED[suffix] | {"Subject" if suffix == "pdf" else "Description": about}
            if suffix == "png":
                # savefig would draw all of it twice, the first time for the layout alone.
                sheet.figure.set_dpi(sheet.figure.parameters["savefig.dpi"])
                canvas: Any = FormulaCanvas(sheet.figure)
                # Level 6, which is usual, costs a third more for 9 % fewer bytes.
                canvas.print_png(draft, metadata=metadata, pil_kwargs={"compress_level": 3})
            else:
                sheet.figure.savefig(draft, format=suffix, metadata=metadata)


TO_TURN = "Drag to turn, scroll to come nearer, double-click to turn back; the pointer tells"
HOW_TO = {
    "globe": f"Here the map is on the sphere itself, a dot a start. {TO_TURN} its value.",
    "space": f"{TO_TURN} times and places.",
    "plane": "The pointer tells the values of both scales.",
}
"""What a reader can do with the panels of a figure, and what differs from print."""


def own_page(
    kind: str, data: Mapping[str, Any], title: str, caption: str, back: str, **content: str
) -> str:
    """A page with the elements of `kind`.html, filled with a caption and other content, and the
    script `kind`.js, which draws the data; `back` is the address of the page of all figures."""
    names = ("shell.html", f"{kind}.html", "space.js", f"{kind}.js")
    shell, elements, *scripts = (
        (Path(__file__).parent / name).read_text(encoding="utf-8") for name in names
    )
    link = f'<p><a href="{escape(back)}">All figures</a></p><h1>{escape(title)}</h1>'
    return Template(shell).substitute(
        title=escape(title),
        head=link if back else "",
        content=Template(elements).substitute(caption=escape(caption), **content),
        # A name may hold what ends a script.
        data=json.dumps(data, default=packed32).replace("</", "<\\/"),
        script="\n".join(scripts),
    )


def packed32(values: np.ndarray) -> str:
    """Numbers as the bytes of 32-bit ones, finer than any screen."""
    return b64encode(values.astype("<f4").tobytes()).decode()


def figure_page(sheet: Sheet, title: str, caption: str, back: str) -> str:
    """The page of a figure."""
    printed = io.StringIO()
    sheet.figure.savefig(printed, format="svg", metadata=UNDATED["svg"])
    # Panels have their final places once they are drawn.
    width, height = (72 * sheet.figure.get_size_inches()).tolist()
    unit = sheet.units("time")
    data = {
        "panels": [panel_data(sheet, axes) for axes in every_panel(sheet.figure.axes)],
        "points": width,
        "height": height,
        "time": [without_tex(f"${sheet.time}$"), "" if unit == "1" else f" {unit}"],
    }
    in_space = "globe" if any(axes.name == "hammer" for axes in sheet.scenes) else "space"
    how_to = HOW_TO[in_space if sheet.scenes else "plane"]
    svg = printed.getvalue()
    return own_page(
        "figure", data, title, caption, back, figure=svg[svg.index("<svg") :], how_to=how_to
    )


def panel_data(sheet: Sheet, axes: Axes) -> dict[str, Any]:
    """A panel for the script: its place in the figure, and its scene or its two scales."""
    place = {"box": axes.get_position().bounds}
    if axes not in sheet.scenes:
        return place | {"scales": [scale_data(axes, letter) for letter in "xy"]}
    scene = sheet.scenes[axes]
    return place | {
        "angles": scene.view.angles,
        "names": [*map(without_tex, scene.names)],
        "reach": scene.reach,
        "globe": scene.globe,
        "strokes": [*map(stroke_data, scene.strokes)],
    }


def scale_data(axes: Any, letter: str) -> dict[str, Any]:
    """One scale of a plane panel; without a label if it has no ticks."""
    # Panels that share a scale have its label once.
    sharing = [axes, *getattr(axes, f"get_shared_{letter}_axes")().get_siblings(axes)]
    labels = [getattr(panel, f"get_{letter}label")() for panel in sharing]
    has_ticks = getattr(axes, f"get_{letter}ticks")().size > 0
    return {
        "label": without_tex(next(filter(None, labels), letter)) if has_ticks else "",
        "ends": getattr(axes, f"get_{letter}lim")(),
        "log": getattr(axes, f"get_{letter}scale")() == "log",
    }


def stroke_data(stroke: Mapping[str, Any]) -> dict[str, Any]:
    """A curve, marks or words in space for the script."""
    texts = {"texts": [*map(without_tex, stroke["texts"])], "name": without_tex(stroke["name"])}
    return {**stroke, **texts, "colours": [*map(to_hex, stroke["colours"])]}
