"""The page of one figure, which needs no other file: figures in space turn, and a moving body
plays; other figures are pictures."""

import io
import json
from base64 import b64encode
from html import escape
from pathlib import Path
from string import Template
from urllib.parse import quote

from .look import Sheet
from .space import view_matrix
from .words import without_tex


def page_of(sheet: Sheet, title: str, about: str = "", folder: str = "") -> str:
    """The page with the strokes of a sheet's scene, or with its picture if it has none, and with a
    link to the page of all figures if that is in the same folder."""
    image = ""
    if not sheet.scene:
        picture = io.BytesIO()
        sheet.figure.savefig(picture, format="svg", metadata={"Date": None, "Creator": None})
        coded = b64encode(picture.getvalue()).decode()
        image = f'<img alt="{escape(about)}" src="data:image/svg+xml;base64,{coded}">'
    view = view_matrix(sheet.spec.get("view", (24.0, 35.0))).tolist()
    time, of = without_tex(f"${sheet.spec.get('time', 't')}$"), sheet.units.get("time", "")
    scene = {"view": view, "symbol": time, "unit": of and f" {of}", **sheet.scene}
    # A name may contain the end of a script.
    data = json.dumps(scene).replace("</", "<\\/")
    place = f"../index.html#{quote(folder)}/{quote(title)}"
    back = f'<p><a href="{place}">All figures</a></p>' if folder else ""
    shell = Template(Path(__file__).with_name("viewer.html").read_text(encoding="utf-8"))
    return shell.substitute(
        title=escape(title), about=escape(about), data=data, image=image, back=back
    )
