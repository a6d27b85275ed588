"""The files of a figure: pictures, its table, and its page, which needs no other file: figures in
space turn, and a moving body plays; other figures are pictures."""

import io
import json
from base64 import b64encode
from collections.abc import Iterator
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex

from .. import HodoError
from ..storage import replacing
from .look import Sheet
from .words import in_html, without_tex


def save(sheet: Sheet, path: Path, about: str = "") -> None:
    """Write a figure in the format of the path's suffix, the same bytes every time; `about` is its
    caption. Raises HodoError if the file cannot be written, or a text is not TeX."""
    suffix = path.suffix[1:]
    # Without dates and versions.
    undated: dict[str, dict[str, Any]] = {
        "png": {"Software": None, "Description": about},
        "svg": {"Date": None, "Creator": None, "Description": about},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None, "Subject": about},
    }
    with replacing(path) as draft:
        try:
            if suffix == "gif":
                sheet.figure.film(draft)
            elif suffix == "csv":
                draft.write_text(sheet.csv(), encoding="utf-8", newline="")
            elif suffix == "html":
                page = page_of(sheet, path.stem, about, path.parent.name)
                draft.write_text(page, encoding="utf-8")
            elif suffix == "png":  # savefig would draw all twice, first for the layout alone
                sheet.figure.set_dpi(sheet.figure.parameters["savefig.dpi"])
                canvas: Any = FigureCanvasAgg(sheet.figure)
                # The usual level 6 takes a third longer and saves 9 % of the bytes.
                look = {"compress_level": 3}
                canvas.print_png(draft, metadata=undated["png"], pil_kwargs=look)
            else:
                sheet.figure.savefig(draft, format=suffix, metadata=undated[suffix])
        except ValueError as error:  # of matplotlib, about TeX
            raise HodoError(str(error).strip().splitlines()[-1]) from None


LETTERS_OF_MARKS = {"o": "○", "s": "■", "D": "◇"}
"""The marks of a legend as letters."""


def legend_of(sheet: Sheet) -> Iterator[str]:
    """The entries of the legend of a figure's picture, in HTML."""
    for words, handle in {handle.get_label(): handle for handle in sheet.handles}.items():
        line = "━━" if handle.get_linestyle() == "-" else "╍╍"
        shape = LETTERS_OF_MARKS.get(handle.get_marker(), line)
        colour = handle.get_markeredgecolor()
        yield f'<span><i style="color: {to_hex(colour)}">{shape}</i> {in_html(words)}</span>'


def page_of(sheet: Sheet, title: str, about: str = "", folder: str = "") -> str:
    """The page of one figure: the strokes of a sheet's scene, or its picture if it has no scene.
    With the name of the figure's `folder`, it links to the page of all figures."""
    image = ""
    if not sheet.scene:
        picture = io.BytesIO()
        sheet.figure.savefig(picture, format="svg", metadata={"Date": None, "Creator": None})
        coded = b64encode(picture.getvalue()).decode()
        image = f'<img alt="{escape(about)}" src="data:image/svg+xml;base64,{coded}">'
    time, unit = without_tex(f"${sheet.spec.get('time', 't')}$"), sheet.units.get("time", "1")
    scene = {
        "view": sheet.view.tolist(),
        "symbol": time,
        "unit": "" if unit == "1" else f" {unit}",
        **sheet.scene,
    }
    # A name may hold </script>, which would end the script that holds the data.
    data = json.dumps(scene).replace("</", "<\\/")
    back = f'<a href="../index.html#{quote(folder)}/{quote(title)}">All figures</a>'
    shell = Template(Path(__file__).with_name("viewer.html").read_text(encoding="utf-8"))
    return shell.substitute(
        title=escape(title), heading=in_html(sheet.spec["title"] or title), about=escape(about),
        legend="".join(legend_of(sheet)) if sheet.scene else "", data=data, image=image,
        back=back if folder else "",
    )  # fmt: skip
