"""Figures in pages of their own, which need no other file. A reader turns what is in space, comes
nearer, and reads values with the pointer.

A page shows the figure as it is printed. Over each panel that shows space its script draws what the
panel's scene has kept (`sheet.Scene`), from any side.
"""

import io
import json
from base64 import b64encode
from collections.abc import Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from .sheet import UNDATED, Sheet, Stroke, every_panel, without_tex

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
    link = f'<p><a href="{escape(back)}">All figures</a> <b>{escape(title)}</b></p>'
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
    globe = any(axes.name == "hammer" for axes in sheet.scenes)
    how_to = HOW_TO["globe" if globe else "space" if sheet.scenes else "plane"]
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


def stroke_data(stroke: Stroke) -> dict[str, Any]:
    """A curve, marks or words in space for the script."""
    return {
        "points": stroke.points,
        "colours": [*map(to_hex, stroke.colours)],
        "code": stroke.code if len(stroke.colours) > 1 else None,
        "texts": [*map(without_tex, stroke.texts)],
        "look": stroke.look,
        "name": without_tex(stroke.name),
        "time": stroke.time,
    }
