"""The page of one figure, which needs no other file: figures in space turn, and a moving body
plays; other figures are pictures."""

import io
import json
from base64 import b64encode
from collections.abc import Iterator
from html import escape
from pathlib import Path
from string import Template
from urllib.parse import quote

from matplotlib.colors import to_hex

from .look import Sheet
from .space import view_matrix
from .words import in_html, without_tex

LETTERS_OF_MARKS = {"o": "○", "s": "■", "D": "◇"}
"""The marks of a legend as letters."""


def legend_of(sheet: Sheet) -> Iterator[str]:
    """The entries of the legend of a figure's picture, in HTML."""
    for words, handle in {handle.get_label(): handle for handle in sheet.handles}.items():
        line = "━━" if handle.get_linestyle() == "-" else "╍╍"
        shape, colour = (
            LETTERS_OF_MARKS.get(handle.get_marker(), line),
            handle.get_markeredgecolor(),
        )
        yield f'<span><i style="color: {to_hex(colour)}">{shape}</i> {in_html(words)}</span>'


def page_of(sheet: Sheet, title: str, about: str = "", folder: str = "") -> str:
    """The page with the strokes of a sheet's scene, or with its picture if it has none, and with a
    link to the page of all figures if that is in the same folder."""
    image = ""
    if not sheet.scene:
        picture = io.BytesIO()
        sheet.figure.savefig(picture, format="svg", metadata={"Date": None, "Creator": None})
        coded = b64encode(picture.getvalue()).decode()
        image = f'<img alt="{escape(about)}" src="data:image/svg+xml;base64,{coded}">'
    time, of = without_tex(f"${sheet.spec.get('time', 't')}$"), sheet.units.get("time", "")
    view = view_matrix(sheet.spec.get("view", (24.0, 35.0)))
    scene = {"view": view.tolist(), "symbol": time, "unit": of and f" {of}", **sheet.scene}
    # A name may hold what ends a script.
    data = json.dumps(scene).replace("</", "<\\/")
    back = f'<a href="../index.html#{quote(folder)}/{quote(title)}">All figures</a>'
    shell = Template(Path(__file__).with_name("viewer.html").read_text(encoding="utf-8"))
    return shell.substitute(
        title=escape(title), heading=in_html(sheet.spec["title"] or title), about=escape(about),
        legend="".join(legend_of(sheet)) if sheet.scene else "", data=data, image=image,
        back=back if folder else "",
    )  # fmt: skip
