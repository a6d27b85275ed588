"""Figures that a reader can turn and zoom, in a page of their own. The only importer of plotly,
whose script shows them.

Nothing is drawn twice: what the panels of the printed figure hold, its curves, marks, areas, texts
and scales, becomes the traces of plotly, at the places where it is printed. Panels that show space
have kept their points in three dimensions (`sheet.Scene`).
"""

import json
import math
import re
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, QuadMesh
from matplotlib.colors import to_hex, to_rgb, to_rgba, to_rgba_array
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Annotation, Text
from matplotlib.ticker import FixedFormatter
from plotly.offline import get_plotlyjs

from .. import HodoError
from ..cases.figure_block import SCRIPT, SWEPT_KINDS
from ..models.rigid_body import LABELS
from ..results.dataset import Cases, motions_of
from ..results.motion import Motion
from ..storage.staging import replacing
from .geometry import stretches
from .sheet import DrawnCurve, Look, Scene, Sheet, Stroke, every_panel, without_tex

Trace = dict[str, Any]

HOVER = ("G", "T", "D")
"""The quantities of the point under the pointer, besides its coordinates, time and axis."""

LAYOUT = {
    # Above, because beside the panels it would leave a telephone half of its width.
    "legend": {
        "itemsizing": "constant", "orientation": "h", "x": 0, "y": 1.04, "yanchor": "bottom",
    },
    "hovermode": "closest",
}  # fmt: skip

MARKERS = {"o": "circle", ".": "circle", "s": "square", "D": "diamond", "x": "x", "+": "cross"}

PIXELS = 1.6
"""Pixels of a screen for a point of print, so that lines are as heavy beside letters."""


@dataclass(frozen=True)
class Samples:
    """The motions of a figure by their labels, and the values that it shows: what the pointer tells
    of a point is found by its values."""

    motions: Mapping[str, Motion]
    records: Sequence[DrawnCurve]

    def record(self, points: np.ndarray) -> DrawnCurve | None:
        """The record that has each column of points (n, k) among its values; None without any."""
        for record in self.records:
            values = [v for v in record.values.values() if v.shape == points[:, 0].shape]
            if all(
                any(np.array_equal(column, v, equal_nan=True) for v in values)
                for column in points.T
            ):
                return record
        return None

    def pointer(self, record: DrawnCurve | None, index: np.ndarray) -> Trace:
        """What the pointer shows at samples (n,) of a record, -1 for a gap: time, |G|, T, D and the
        enclosed axis of a motion, else the coordinates."""
        if record is None:
            return {"hoverinfo": "skip"}
        motion, name = self.motions.get(record.curve), {"name": without_tex(record.curve)}
        if motion is None or "time" not in record.values:
            return name
        at = np.searchsorted(motion.time, record.values["time"][index])
        columns = {"time": motion.time[at]}
        for quantity in HOVER:
            with suppress(HodoError):
                columns[quantity] = motion[quantity][at]
        lines = [f"{key} = %{{customdata[{i}]:.6g}}" for i, key in enumerate(columns)]
        shown: Trace = {**name, "customdata": np.stack([*columns.values()], axis=-1).astype("f4")}
        if motion.classified:
            lines.append("encloses %{text}")
            shown["text"] = [LABELS[int(label)] for label in motion.labels[at]]
        return shown | {"hovertemplate": "<br>".join(lines)}


def write_interactive(
    sheet: Sheet, spec: Mapping[str, Any], cases: Cases, path: Path, name: str
) -> None:
    """Write the page of one figure, whose printed form is `sheet`, and the script that it needs.

    Raises HodoError if a file cannot be written.
    """
    caption = " ".join(filter(None, [spec["caption"], *sheet.remarks]))
    back = f"../index.html#{quote(path.parent.name)}-{quote(name)}"
    if sheet.figure.film:
        with replacing(path) as draft:
            draft.write_text(sheet.figure.film.page(name, caption, back), encoding="utf-8")
        return
    script = path.parent.parent / SCRIPT
    # Once for all figures: it has 5 MB, and nothing is fetched from elsewhere when a page opens.
    if not script.exists():
        with replacing(script) as draft:
            draft.write_text(get_plotlyjs(), encoding="utf-8")
    shell = Template((Path(__file__).parent / "figure.html").read_text(encoding="utf-8"))
    page = shell.substitute(
        name=escape(name),
        title=escape(without_tex(spec["title"])),
        caption=escape(caption),
        how_to=how_to(sheet),
        script=f"../{SCRIPT}",
        back=back,
        # A caption or label may hold what ends a script.
        figure=json.dumps(interactive(sheet, spec, cases), default=packed).replace("</", "<\\/"),
    )
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def how_to(sheet: Sheet) -> str:
    """What a reader can do with the panels of a figure, and what differs from print."""
    legend = "a click on a name in the legend hides it."
    if any(axes.name == "hammer" for axes in sheet.scenes):
        return f"Here the map is on the sphere itself, a dot a start. Drag to turn; {legend}"
    turns = "Drag to turn, scroll to come nearer"
    return f"{turns if sheet.scenes else 'Drag to enlarge, double-click to see all'}; {legend}"


def packed(values: np.ndarray) -> dict[str, str]:
    """An array as plotly reads it: the bytes of its numbers, which are shorter than digits."""
    shape = ",".join(map(str, values.shape))
    kind = f"f{values.dtype.itemsize}"
    data = b64encode(values.astype(f"<{kind}").tobytes()).decode()
    return {"dtype": kind, "bdata": data, "shape": shape}


def interactive(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> dict[str, Any]:
    """The data and layout of plotly for a printed figure; `packed` turns its arrays into JSON."""
    names = () if spec["kind"] in SWEPT_KINDS else spec.get("cases", ())
    motions = motions_of(cases, names, spec.get("labels", ()) if names else ())
    samples = Samples({motion.label: motion for motion in motions}, sheet.shown)
    sheet.figure.draw_without_rendering()  # which gives every panel its place
    bars = [axes for axes in sheet.figure.axes if hasattr(axes, "_colorbar")]
    panels = [axes for axes in every_panel(sheet.figure.axes) if axes not in bars]
    # Below the panels is room for their scale of colours.
    margin = {"l": 60, "r": 20, "t": 90, "b": 120 if bars else 50}
    layout = {**LAYOUT, "margin": margin}
    traces: list[Trace] = []
    notes: list[Trace] = []
    for i, (axes, domain) in enumerate(zip(panels, domains(panels), strict=True)):
        scene = sheet.scenes.get(axes)
        strokes = scene.strokes if scene else [*plane_strokes(axes)]
        drawn = [trace for stroke in strokes for trace in stroke_traces(stroke, samples)]
        if not scene:
            drawn = [*shaded_traces(axes), *drawn]
            notes += annotations(axes, numbered("x", i), numbered("y", i))
        layout |= scene_layout(scene, i, domain) if scene else axis_layouts(axes, i, domain)
        place = {"scene": "scene"} if scene else {"xaxis": "x", "yaxis": "y"}
        place = {key: numbered(name, i) for key, name in place.items()}
        notes.append(panel_title(axes, domain))
        traces += [{"showlegend": False, **trace, **place} for trace in drawn]
    blank = blank_like(traces[0])
    for i, bar in enumerate(bars):
        axis = numbered("coloraxis", i)
        layout[axis] = colour_scale(bar)
        marker = {"color": np.zeros(1), "coloraxis": axis}
        traces.append({**blank, "mode": "markers", "marker": marker, "showlegend": False})
    traces += [{**blank, **entry} for entry in legend_entries(sheet)]
    return {"data": traces, "layout": {**layout, "annotations": notes}}


def numbered(name: str, i: int) -> str:
    """plotly's name of the axes, scene or scale in place i; the first has no number."""
    return f"{name}{i + 1}" if i else name


def blank_like(trace: Trace) -> Trace:
    """A trace without a point in the panel of another one, for entries of the legend."""
    place: Trace = {key: trace[key] for key in ("scene", "xaxis", "yaxis") if key in trace}
    return {**point_coordinates(np.full((1, 3 if "scene" in place else 2), np.nan)), **place}


def domains(panels: Sequence[Axes]) -> Iterator[dict[str, list[float]]]:
    """The place of each panel, as parts of the width and height of all."""
    boxes = np.array([axes.get_window_extent().extents for axes in panels]).reshape(-1, 2, 2)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    for x, y in ((boxes - low) / (high - low)).transpose(0, 2, 1).tolist():
        yield {"x": x, "y": y}


def point_coordinates(points: np.ndarray) -> Trace:
    """A trace of points (n, 2) or (n, 3)."""
    kind = "scatter" if points.shape[1] == 2 else "scatter3d"
    return {"type": kind, **dict(zip("xyz", points.T, strict=False))}


# What is drawn


def stroke_traces(stroke: Stroke, samples: Samples) -> Iterator[Trace]:
    """The traces of a curve, one a colour with gaps where it has others, of marks, or of words."""
    trace, texts = point_coordinates(stroke.points), [*map(without_tex, stroke.texts)]
    shades = [colour_name(colour) for colour in stroke.colours]
    if stroke.look.get("ls") == "":
        trace |= line_look(stroke.look) | {"hoverinfo": "text" if texts else "skip", "text": texts}
        if len(shades) > 1:
            trace["marker"] = trace["marker"] | {"color": [shades[i] for i in stroke.code]}
        yield trace
        return
    if texts:
        words = {"mode": "lines+text", "text": texts, "hoverinfo": "skip"}
        yield trace | line_look(stroke.look) | words
        return
    record, pieces = samples.record(stroke.points), stretches(stroke.code)
    for code in np.unique(stroke.code):
        # A piece of another colour leaves a gap, which is sample -1.
        own = [piece for piece in pieces if stroke.code[piece.start] == code]
        index = np.concatenate([[*range(len(stroke.code))[piece], -1] for piece in own])[:-1]
        points = np.where(index[:, np.newaxis] < 0, np.nan, stroke.points[index])
        look = line_look({**stroke.look, "color": shades[code]})
        yield point_coordinates(points) | look | samples.pointer(record, index)


def line_look(look: Mapping[str, Any]) -> Trace:
    """The line and marks of a trace, and the group of its legend, by the names of `Line2D`."""
    colour, dash = colour_name(look.get("color", "black")), dash_of(look.get("ls", "-"))
    line = {"color": colour, "dash": dash, "width": PIXELS * look.get("lw", 1.0)}
    symbol = MARKERS.get(look.get("marker", ""), "")
    if not symbol:
        return {"mode": "lines", "line": line, "legendgroup": f"{colour} {dash}"}
    fill, edge = (colour_name(look.get(key, colour)) for key in ("mfc", "mec"))
    size, rim = PIXELS * look.get("ms", 3), {"color": edge, "width": 1}
    return {
        "mode": "markers" if look.get("ls") == "" else "lines+markers",
        "line": line,
        "marker": {"symbol": symbol, "size": size, "color": fill, "line": rim},
        "legendgroup": f"{fill} {symbol}",
    }


def dash_of(line: str | tuple[float, Sequence[float] | None]) -> str:
    """plotly's name of a line of matplotlib's."""
    pattern = line[1] if isinstance(line, tuple) else ()
    if not pattern:
        return "solid"
    return "dashdot" if len(pattern) > 2 else "dash" if pattern[0] > pattern[1] else "dot"


def colour_name(colour: Any) -> str:
    """A colour of matplotlib's by the name that plotly knows."""
    return to_hex(colour)


def plane_strokes(axes: Axes) -> Iterator[Stroke]:
    """The curves and marks of a plane panel."""
    for collection in axes.collections:
        if not isinstance(collection, QuadMesh) and len(collection.get_paths()):
            yield stroke_of_pieces(collection)
    for line in axes.lines:
        points, look = np.asarray(line.get_xydata(), dtype=float), look_of(line)
        if line.get_transform() != axes.transData:
            pixels = line.get_transform().transform(points)
            points = axes.transData.inverted().transform(pixels)
        colours = np.array([to_rgb(look["color"])])
        yield Stroke(points, colours, np.zeros(len(points), dtype=int), look)


def look_of(line: Line2D) -> Look:
    """The look of a line by the names that it was drawn with."""
    # matplotlib keeps the dashes, and tells no more than that there are some.
    dashes = getattr(line, "_unscaled_dash_pattern", "-")
    without_line = line.get_linestyle() in ("", "None")
    return {
        "color": line.get_color(), "lw": line.get_linewidth(), "marker": line.get_marker(),
        "ls": "" if without_line else dashes, "ms": line.get_markersize(),
        "mfc": line.get_markerfacecolor(), "mec": line.get_markeredgecolor(),
    }  # fmt: skip


def stroke_of_pieces(collection: Collection) -> Stroke:
    """A curve that is drawn in pieces, each of a colour and beginning where the last one ends; with
    gaps if they do not."""
    pieces = [path_points(path) for path in collection.get_paths()]
    joined = all(np.array_equal(a[-1], b[0]) for a, b in pairwise(pieces))
    # A piece reaches to the first point of the next, whose colour begins there.
    gap = np.full((1, 2), np.nan)
    parts = [piece[:-1] if joined else np.concatenate([piece, gap]) for piece in pieces[:-1]]
    parts.append(pieces[-1])
    shades = np.resize(to_rgba_array(collection.get_edgecolor())[:, :3], (len(pieces), 3))
    colours, codes = np.unique(shades, axis=0, return_inverse=True)
    code = np.repeat(codes.ravel(), [len(part) for part in parts])
    width = float(np.atleast_1d(collection.get_linewidth())[0])
    return Stroke(np.concatenate(parts), colours, code, {"lw": width})


def path_points(path: Any) -> np.ndarray:
    """The points (n, 2) of a path, with a gap where it begins anew."""
    codes = path.codes if path.codes is not None else np.zeros(len(path.vertices))
    breaks = np.flatnonzero(codes == path.MOVETO)
    return np.insert(np.asarray(path.vertices, dtype=float), breaks[breaks > 0], np.nan, axis=0)


def shaded_traces(axes: Axes) -> Iterator[Trace]:
    """The areas and the cells of a plane panel."""
    for patch in axes.patches:
        yield area_trace(axes, patch)
    for mesh in axes.collections:
        if isinstance(mesh, QuadMesh):
            yield from cell_traces(mesh)


def area_trace(axes: Axes, patch: Patch) -> Trace:
    """A shaded area."""
    outline = patch.get_transform().transform_path(patch.get_path()).vertices
    points = axes.transData.inverted().transform(outline)
    *colour, alpha = to_rgba(patch.get_facecolor())
    shades = ",".join(str(round(255 * part)) for part in colour)
    look = {"fill": "toself", "fillcolor": f"rgba({shades},{alpha:g})", "line": {"width": 0}}
    return {**point_coordinates(points), **look, "mode": "lines", "hoverinfo": "skip"}


def cell_traces(mesh: QuadMesh) -> Iterator[Trace]:
    """The cells of a map between their edges, those without a value in their own colour."""
    corners = np.asarray(mesh.get_coordinates())
    values: np.ndarray = np.ma.filled(np.ma.asarray(mesh.get_array()), np.nan)
    cells = {"type": "heatmap", "x": corners[0, :, 0], "y": corners[:, 0, 1], "showscale": False}
    gap = colour_name(mesh.cmap.get_bad())
    missing = np.where(np.isnan(values), 0.0, np.nan)
    yield {**cells, "z": missing, "colorscale": [[0, gap], [1, gap]], "hoverinfo": "skip"}
    yield {**cells, "z": values, **scale_of(mesh, "z")}


def scale_of(mappable: Any, letter: str) -> Trace:
    """The colours of values, with the values at both ends of their scale."""
    shades = mappable.cmap(np.linspace(0, 1, 16))
    low, high = mappable.norm.vmin, mappable.norm.vmax
    stops = [[i / 15, colour_name(shade)] for i, shade in enumerate(shades)]
    return {"colorscale": stops, f"{letter}min": float(low), f"{letter}max": float(high)}


# Scales, texts and the legend


def scene_layout(scene: Scene, i: int, domain: Mapping[str, Any]) -> Trace:
    """The axes of space, of one scale, seen as they are printed."""
    # Without numbers at its axes it needs less room.
    away = (2.2 if scene.names else 1.5) * scene.view.matrix[2]
    eye = dict(zip("xyz", away.tolist(), strict=True))
    axes: Trace = {f"{letter}axis": {"visible": False} for letter in "xyz"}
    for letter, name in zip("xyz", scene.names, strict=False):
        axes[f"{letter}axis"] = {"title": {"text": without_tex(name)}}
        if scene.reach is not None:
            axes[f"{letter}axis"]["range"] = [-scene.reach, scene.reach]
    look = {"aspectmode": "data", "domain": domain, "camera": {"eye": eye}}
    return {numbered("scene", i): {**look, **axes}}


def axis_layouts(axes: Axes, i: int, domain: Mapping[str, list[float]]) -> Trace:
    """Both axes of a plane panel: their scales, ends, labels and place."""
    layouts: Trace = {}
    for letter, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        log = axis.get_scale() == "log"
        ends = np.log10(axis.get_view_interval()) if log else axis.get_view_interval()
        other = "y" if letter == "x" else "x"
        shown = axis.get_tick_params().get("label" + ("bottom" if letter == "x" else "left"), True)
        layouts[numbered(f"{letter}axis", i)] = {
            "title": {"text": words_of(axis.get_label_text()), "standoff": 6},
            "type": "log" if log else "linear",
            "range": [*map(float, ends)],
            "domain": domain[letter],
            "anchor": numbered(other, i),
            "showticklabels": bool(shown and len(axis.get_majorticklocs())),
            # Powers of ten, where plotly would write 10µ for 1e-5.
            "exponentformat": "power",
            "showline": True, "mirror": True, "linecolor": "#000000", "zeroline": False,
        }  # fmt: skip
    if axes.get_aspect() != "auto":
        layouts[numbered("yaxis", i)]["scaleanchor"] = numbered("x", i)
        for layout in layouts.values():
            layout["constrain"] = "domain"
    return layouts


def annotations(axes: Axes, across: str, up: str) -> list[Trace]:
    """The texts in a plane panel, at its values and as far beside them as in print; its axes are
    given."""
    return [
        {"xref": across, "yref": up, **annotation(axes, text)}
        for text in axes.texts
        if text.get_text()
    ]


def annotation(axes: Axes, text: Text) -> Trace:
    """A text of a plane panel, without the names of its axes."""
    box, ha, va = (
        text.get_window_extent(),
        text.get_horizontalalignment(),
        text.get_verticalalignment(),
    )
    right = {"left": box.x0, "center": (box.x0 + box.x1) / 2, "right": box.x1}[ha]
    top = {"bottom": box.y0, "top": box.y1}.get(va, (box.y0 + box.y1) / 2)
    aside = isinstance(text, Annotation) and text.anncoords == "offset points"
    beyond = np.array(text.get_position() if aside else (0.0, 0.0))
    pixels = np.array([right, top]) - beyond * axes.figure.dpi / 72
    place = axes.transData.inverted().transform(pixels)
    scales = (axes.get_xscale(), axes.get_yscale())
    x, y = (math.log10(v) if scale == "log" else v for v, scale in zip(place, scales, strict=True))
    xshift, yshift = (PIXELS * beyond).tolist()
    return {
        "x": float(x), "y": float(y), "xshift": xshift, "yshift": yshift, "xanchor": ha,
        "yanchor": va if va in ("top", "bottom") else "middle", "text": words_of(text.get_text()),
        "font": {"size": PIXELS * float(text.get_fontsize()),
                 "color": colour_name(text.get_color())},
        "showarrow": False,
    }  # fmt: skip


def panel_title(axes: Axes, domain: Mapping[str, list[float]]) -> Trace:
    """The title above a panel."""
    place = {"xref": "paper", "yref": "paper", "x": sum(domain["x"]) / 2, "y": domain["y"][1]}
    words = words_of(axes.get_title())
    return {**place, "yanchor": "bottom", "text": words, "showarrow": False}


def colour_scale(axes: Axes) -> Trace:
    """A printed bar of colours with its label, and its words if it has any."""
    bar = axes._colorbar  # type: ignore[attr-defined]
    scale: Trace = {
        "title": {"text": without_tex(axes.get_xlabel()), "side": "bottom"},
        "orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom", "len": 0.6,
        "thickness": 12,
    }  # fmt: skip
    if isinstance(bar.formatter, FixedFormatter):
        words = [label.get_text() for label in axes.get_xticklabels()]
        scale |= {"tickvals": [*map(float, bar.get_ticks())], "ticktext": words}
    return {"colorbar": scale, **scale_of(bar, "c")}


def legend_entries(sheet: Sheet) -> Iterator[Trace]:
    """The entries of the printed legend; each stands for the traces of its look."""
    for handle in sheet.legend:
        if isinstance(handle, Line2D):
            look = line_look(look_of(handle))
        else:
            fill = handle.get_facecolor()
            look = line_look({"ls": "", "marker": "s", "ms": 6, "mfc": fill, "mec": fill})
        yield {**look, "name": words_of(str(handle.get_label())), "showlegend": True}


def words_of(text: str) -> str:
    """A text without TeX, its powers raised and its lines broken as plotly does."""
    plain = without_tex(text).replace("\n", "<br>")
    return re.sub(r"\^(-?\w)", r"<sup>\1</sup>", plain)
