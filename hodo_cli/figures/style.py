"""The style that a figure is given: the parameters of matplotlib, and the size, scales, legend and
letters of its drawn panels."""

import math
import re
from collections.abc import Mapping, Sequence
from itertools import chain, product
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import matplotlib.style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties, findfont, get_font_names
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from .. import HodoError
from ..schema.spelling import unknown
from .sheet import COLUMN, MIN_PANEL_WIDTH, PAGE, Look, Sheet, scale_words, sharing
from .words import text_lines, text_size, text_width


def filled(label: str, length: float) -> str:
    """The label of an axis in lines of a length in inches."""
    return "\n".join(text_lines(label, length, text_size("axes.labelsize")))


LOOKS = (
    *("axes", "errorbar", "font", "grid", "legend", "lines", "markers", "mathtext", "patch"),
    *("pdf", "savefig", "svg", "text", "xtick", "ytick"),
)
"""The groups of matplotlib's parameters that a user may set for a figure; the others are those of
windows and files."""

GENERIC_FONTS = ("serif", "sans-serif", "monospace")

LEGEND_PLACES = {
    "below": "outside lower center",
    "right": "outside right upper",
    "inside": "best",
}
"""matplotlib's words for places of a legend; a corner of the first panel has its own name."""


def user_parameters() -> Look:
    """The parameters of matplotlib that the user has set, by rc_context, a style or a file."""
    current: Any = matplotlib.rcParams
    default: Any = matplotlib.rcParamsDefault
    # To ask for another, such as the backend, may load it.
    names: list[Any] = [name for name in default if name.partition(".")[0] in LOOKS]
    return {name: current[name] for name in names if current[name] != default[name]}


def matplotlib_parameters(style: Mapping[str, Any]) -> Look:
    """The parameters of matplotlib that a style sets. Raises HodoError for a style sheet or a
    family of fonts that is not there."""
    given = {
        "font.size": style.get("font_size"),
        "lines.linewidth": style.get("line_width"),
        "svg.fonttype": "none" if style.get("svg_text") else None,
    }
    sheet = sheet_parameters(style["sheet"]) if "sheet" in style else {}
    font = font_parameters(style["font"]) if "font" in style else {}
    return sheet | font | {name: value for name, value in given.items() if value is not None}


RESOLUTIONS = (10, 2400)
"""The least and the most dots per inch of a picture: in fewer no number can be read, and a page in
more takes gigabytes of memory."""


def sheet_parameters(name: str) -> Look:
    """The parameters in a style sheet of matplotlib, by its name or path. Raises HodoError for one
    that is not there, for the first mistake in it, or if none of its fonts is installed."""
    sheets: Any = matplotlib.style.library
    if name.endswith(".mplstyle"):
        sheets = {name: sheet_in_file(name)}
    elif name not in sheets:
        raise HodoError(f"style.sheet: {unknown(f'style sheet {name!r}', name, sheets)}")
    # A resolution of `figure` is that which the figure has without a style.
    given = {key: value for key, value in sheets[name].items() if value != "figure"}
    looks: Look = {key: value for key, value in given.items() if key.partition(".")[0] in LOOKS}
    least, most = RESOLUTIONS
    dpi = looks.get("savefig.dpi", least)
    if not least <= dpi <= most:
        expected = f"expected a number from {least} to {most}, got {dpi:g}"
        raise HodoError(f"style.sheet: {name}: savefig.dpi: {expected}")
    if families := looks.get("font.family"):
        # What a generic family stands for may be in the sheet too.
        with matplotlib.style.context(["default", looks]):
            # matplotlib names a family that it misses at each text, and takes the next one.
            looks["font.family"] = [*filter(is_installed, families)]
        if not looks["font.family"]:
            lacking = f"no font of {', '.join(families)} is installed"
            raise HodoError(f"style.sheet: {name}: font.family: {lacking}")
    return looks


def sheet_in_file(path: str) -> Mapping[str, Any]:
    """The parameters in a file. Raises HodoError as `sheet_parameters` does."""
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
        sheet: Any = matplotlib.rc_params_from_file(path, True, use_default_template=False)
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or error).lower()
        raise HodoError(f"style.sheet: {path}: {reason}") from None
    for line in lines:
        # matplotlib logs a key that it does not know, and goes on without the line.
        key = re.split("[:#]", line)[0].strip()
        if key and key not in sheet:
            mistake = unknown(f"parameter {key!r}", key, matplotlib.rcParamsDefault)
            raise HodoError(f"style.sheet: {path}: {mistake}")
    return dict(sheet)


def is_installed(family: str) -> bool:
    """Whether there is a font of a family."""
    try:
        findfont(FontProperties(family=[family]), fallback_to_default=False)
    except ValueError:
        return False
    return True


def font_parameters(family: str) -> Look:
    """The parameters that set letters and formulas in a family of fonts. Raises HodoError if it is
    not installed."""
    if not is_installed(family):
        fonts = [*GENERIC_FONTS, *sorted(get_font_names())]
        raise HodoError(f"style.font: {unknown(f'font {family!r}', family, fonts)}")
    return {
        "font.family": [family],
        "mathtext.fontset": "custom",
        "mathtext.rm": family,
        "mathtext.it": f"{family}:italic",
        "mathtext.bf": f"{family}:bold",
        "mathtext.cal": family,
        "mathtext.fallback": "stix",
    }


def wanted_width(style: Mapping[str, Any]) -> float | None:
    """The width of a figure in inches that a style sets, if it does."""
    width: Any = style.get("width")
    known = {"column": COLUMN, "page": PAGE, None: None}
    return known[width] if width in known else width / 25.4


def finish_figure(sheet: Sheet, title: str, style: Mapping[str, Any]) -> None:
    """Give a drawn figure its size, title, scales, letters and legend.

    Raises HodoError for a text that is not TeX, or a logarithmic axis that reaches below zero.
    """
    panels = [axes for axes in sheet.figure.axes if axes.get_subplotspec() is not None]
    for axes in panels:
        set_scales(axes, style)
    if style.get("letters") and len(panels) > 1:
        pairs = map("".join, product(ascii_lowercase, repeat=2))  # behind z
        for axes, letter in zip(panels, chain(ascii_lowercase, pairs), strict=False):
            axes.set_title(f"({letter})", loc="left")
    width, height = sheet.figure.get_size_inches()
    new_width = sheet.width or width
    size = text_size("figure.titlesize")
    lines = text_lines(title, 0.97 * new_width, size) if title else []
    # The panels keep their shape: a line of the title is 1.7 times as high as its letters.
    new_height = height * new_width / width + 1.7 / 72 * size * len(lines)
    sheet.figure.set_size_inches(new_width, style.get("height", 25.4 * new_height) / 25.4)
    if lines:
        sheet.figure.suptitle("\n".join(lines))
    below = place_legend(sheet, panels, style)
    fill_labels(sheet, LINE_OF_LEGEND / 72 * text_size("legend.fontsize") * below)


LINE_OF_LEGEND = 1.65
"""How high a line of a legend is, in heights of its letters."""


def fill_labels(sheet: Sheet, below: float) -> None:
    """Break the titles of panels and the labels of axes that are longer than there is room for
    them, above a legend of some height in inches."""
    width, height = sheet.figure.get_size_inches()
    for axes in sheet.figure.axes:
        place = axes.get_subplotspec()
        rows, columns = place.get_gridspec().get_geometry() if place is not None else (1, 1)
        # A panel has its numbers to the left, a title above and a line of a legend below it.
        across, up = 0.8 * width / columns, min(0.55 * height, 0.7 * (height - below)) / rows
        fill_title(axes, across)
        for axis, length in ((axes.xaxis, across), (axes.yaxis, up)):
            if text := axis.label.get_text():
                axis.label.set_text(filled(text, length))


def fill_title(axes: Axes, length: float) -> None:
    """Break the title of a panel into lines of a length in inches, or of what the panel's letter
    leaves of it: the title stands in the middle."""
    size, letter = text_size("axes.titlesize"), axes.get_title(loc="left")
    room = length - (2 / 72 * text_width(f"{letter} ", size) if letter else 0)
    lines = axes.get_title().splitlines()
    axes.title.set_text("\n".join(piece for x in lines for piece in text_lines(x, room, size)))


LEAST_ABOVE_MARGIN = 1e-270
"""The least number below which a margin of a logarithmic axis down to it ends above zero."""


def set_scales(axes: Axes, style: Mapping[str, Any]) -> None:
    """The scales, ends and labels of a panel as a style has them."""
    for name, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        if name in style.get("log", ()):
            set_logarithmic(axes, name)
        if label := style.get(f"{name}label"):
            text_width(label, text_size("axes.labelsize"))  # which finds mistakes in its TeX
            axis.set_label_text(label if axis.get_label_text() else "")
    limits = {name: style[name] for name in ("xlim", "ylim") if name in style}
    if limits and axes.get_adjustable() == "datalim":
        # Its two scales stay equal by the shape of the panel, and not by other ends.
        axes.set_adjustable("box")
    for line in axes.lines if limits else ():
        line.set_clip_on(True)  # marks stick out of their panel, also of one that ends before them
    axes.set(**limits)


def set_logarithmic(axes: Axes, name: str) -> None:
    """Make a scale, x or y, of a panel logarithmic. Raises HodoError if it reaches below zero."""
    lowest = getattr(axes.dataLim, f"{name}0")
    if lowest < 0:
        raise HodoError(
            f"style.log: the {name} axis of {scale_words(axes, name)} reaches below zero, "
            f"down to {lowest:.4g}; leave {name} out of log, or draw values above zero only"
        )
    least = min(shared.get_minpos() for shared in sharing(axes, name))
    if least < LEAST_ABOVE_MARGIN:
        axes.set(**{f"{name}lim": (least, None)})
    # A value of 0 leads a line to the lower end, as both of a diagonal do; from a time of 0 a line
    # would come level.
    is_of_time = name == "x" and axes.get_aspect() == "auto"
    getattr(axes, f"set_{name}scale")("log", nonpositive="mask" if is_of_time else "clip")
    if getattr(axes, f"get_{name}lim")()[0] <= 0:
        # The end of a linear scale; zero lies nowhere on this one.
        axes.set(**{f"{name}lim": (least, None)})


def place_legend(sheet: Sheet, panels: Sequence[Axes], style: Mapping[str, Any]) -> int:
    """The legend of a figure, of its labelled lines and the other entries of its sheet; it is read
    row by row, at a place of `LEGEND_PLACES`, in a corner of the first panel, or nowhere. Returns
    how many lines it has below the panels."""
    lines = [line for axes in panels for line in axes.get_lines()]
    # By colour: crosses in that of a curve stand for its missing values.
    seen = {shade(line) for line in filter(is_within_panel, lines)}
    drawn = [line for line in lines if shade(line) in seen]
    # Those of several panels once; two cases may have one label.
    entries = {
        (label, shade(entry)): entry
        for entry in (*drawn, *sheet.legend)
        if (label := str(entry.get_label())) and not label.startswith("_")
        if not is_out_of_view(entry, lines)
    }
    handles, place = [*entries.values()], style.get("legend", "below")
    if not handles or place == "none":
        return 0
    added = break_labels(sheet, handles)
    is_narrow = panel_width(sheet, panels, handles) < MIN_PANEL_WIDTH
    if place == "right" and (is_narrow or column_height(handles) > sheet.figure.get_figheight()):
        place = "below"
    if place == "below" and "height" not in style:
        # A further line of an entry is as high as one of the title.
        height = 1.7 / 72 * text_size("legend.fontsize") * added
        sheet.figure.set_figheight(sheet.figure.get_figheight() + height)
    columns = legend_columns(sheet, handles) if place == "below" else 1
    # matplotlib fills column after column.
    rowwise = [handle for column in range(columns) for handle in handles[column::columns]]
    owner: Any = sheet.figure if place in ("below", "right") else panels[0]
    owner.legend(
        handles=rowwise, loc=LEGEND_PLACES.get(place, place), ncols=columns, columnspacing=1.2
    )
    return math.ceil(len(handles) / columns) if place == "below" else 0


def is_out_of_view(entry: Line2D | Patch, lines: Sequence[Line2D]) -> bool:
    """Whether an entry of a legend, among some lines, is of marks of which no panel shows any."""
    if not isinstance(entry, Line2D) or entry.get_linestyle() != "None" or not lines:
        return False
    marker = entry.get_marker()
    seen = any(is_within_panel(line) for line in lines if line.get_marker() == marker)
    return marker != "None" and not seen


def is_within_panel(line: Any) -> bool:
    """Whether any part of a line, or any of its marks, is within the ends of its panel."""
    # On the page, where it is straight on logarithmic scales too.
    panel = line.axes.viewLim.transformed(line.axes.transData).padded(1)
    path = line.get_path().transformed(line.get_transform())
    if line.get_linestyle() != "None" and path.intersects_bbox(panel, filled=False):
        return True
    return bool(((panel.min <= path.vertices) & (path.vertices <= panel.max)).all(axis=1).any())


def shade(entry: Line2D | Patch) -> str:
    """The colour of an entry of a legend."""
    return str(entry.get_color() if isinstance(entry, Line2D) else entry.get_facecolor())


AROUND_LEGEND = 4.8
"""The width of a legend of one column beside its words, in heights of its letters."""


def break_labels(sheet: Sheet, handles: Sequence[Artist]) -> int:
    """Break the labels of a legend that are longer than its figure is wide; returns how many lines
    that adds."""
    size = text_size("legend.fontsize")
    room = sheet.figure.get_figwidth() - AROUND_LEGEND * size / 72
    added = 0
    for handle in handles:
        lines = str(handle.get_label()).splitlines()
        broken = [piece for line in lines for piece in text_lines(line, room, size)]
        handle.set_label("\n".join(broken))
        added += len(broken) - len(lines)
    return added


def column_height(handles: Sequence[Artist]) -> float:
    """The height in inches of a legend of one column."""
    lines = sum(len(str(handle.get_label()).splitlines()) for handle in handles)
    return LINE_OF_LEGEND / 72 * text_size("legend.fontsize") * lines


def entry_widths(handles: Sequence[Artist]) -> list[float]:
    """The widths of the entries of a legend in points."""
    size = text_size("legend.fontsize")
    labels = (str(handle.get_label()).splitlines() for handle in handles)
    # A line with its gaps is 4.2 times as wide as the size of the letters.
    return [4.2 * size + max(text_width(line, size) for line in lines) for lines in labels]


def panel_width(sheet: Sheet, panels: Sequence[Axes], handles: Sequence[Artist]) -> float:
    """The width of each panel with its words, in inches, beside a legend of one column."""
    places = (axes.get_subplotspec() for axes in panels)
    across = max(place.get_gridspec().ncols for place in places if place is not None)
    return (sheet.figure.get_figwidth() - max(entry_widths(handles)) / 72) / across


def legend_columns(sheet: Sheet, handles: Sequence[Artist]) -> int:
    """The most columns of a legend that fit into the width of its figure, with rows as full as each
    other."""
    widths = entry_widths(handles)

    def total_width(columns: int) -> float:
        return sum(max(widths[column::columns]) for column in range(columns))

    room = 72 * sheet.figure.get_figwidth()
    most = next((n for n in range(len(widths), 1, -1) if total_width(n) <= room), 1)
    rows = math.ceil(len(widths) / most)
    return math.ceil(len(widths) / rows)
