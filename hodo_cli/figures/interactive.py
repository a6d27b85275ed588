"""Figures that a reader can turn and zoom, in a page of their own. The only importer of plotly,
whose script shows them.

Nothing is drawn twice: what the panels of the printed figure hold, its curves, marks, areas, texts
and scales, becomes the traces of plotly, at the places where it is printed. Panels that show space
have kept their points in three dimensions (`sheet.Scene`).
"""

import json
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
from matplotlib.text import Annotation
from matplotlib.ticker import FixedFormatter
from plotly.offline import get_plotlyjs

from .. import HodoError
from ..cases.figure_block import SCRIPT, SWEPT_KINDS
from ..models.rigid_body import LABELS
from ..results.dataset import Cases, motions_of
from ..results.motion import Motion
from ..storage.staging import replacing
from .artists import CROSSING
from .geometry import View, stretches
from .sheet import DrawnCurve, Look, Scene, Sheet, every_panel, without_tex

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

SYMBOLS = {"o": "circle", ".": "circle", "s": "square", "D": "diamond", "x": "x", "+": "cross"}

PIXELS = 1.6
"""Pixels of a screen for a point of print, so that lines are as heavy beside letters."""


@dataclass(frozen=True)
class Curve:
    """A curve of a panel: points (n, k), the place (n,) of each one's colour among colours (m, 3),
    and its look by the names of `Line2D`."""

    points: np.ndarray
    code: np.ndarray
    colours: np.ndarray
    look: Mapping[str, Any]


@dataclass(frozen=True)
class Samples:
    """The motions of a figure by their labels, the values that it shows, and its symbol of time:
    what the pointer tells of a point is found by its values."""

    motions: Mapping[str, Motion]
    records: Sequence[DrawnCurve]
    time: str

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

    def pointer(self, record: DrawnCurve | None, sample: np.ndarray) -> Trace:
        """What the pointer shows at samples (n,) of a record: time, |G|, T, D and the enclosed
        axis of a motion, else its coordinates. A gap is sample -1."""
        if record is None:
            return {"hoverinfo": "skip"}
        name = {"name": without_tex(record.curve)}
        motion = self.motions.get(record.curve)
        if motion is None or "time" not in record.values:
            return name
        at = np.searchsorted(motion.time, record.values["time"][sample])
        columns = {"time": motion.time[at]}
        for quantity in HOVER:
            with suppress(HodoError):
                columns[quantity] = motion[quantity][at]
        lines = [f"{key} = %{{customdata[{i}]:.6g}}" for i, key in enumerate(columns)]
        shown: Trace = {"customdata": np.stack([*columns.values()], axis=-1)}
        if motion.classified:
            lines.append("encloses %{text}")
            shown["text"] = [LABELS[int(label)] for label in motion.labels[at]]
        return {**name, **shown, "hovertemplate": "<br>".join(lines)}

    def crossing_texts(self, marks: np.ndarray, curves: Sequence[Curve]) -> list[str]:
        """The times of the crossings that marks (m, k) in a panel of curves stand for."""
        times: list[tuple[np.ndarray, str]] = []
        for curve in curves:
            record = self.record(curve.points)
            motion = self.motions.get(record.curve) if record else None
            if motion and len(motion.time) == len(curve.points):
                unit = motion.units("time")
                of = "" if unit == "1" else f" {unit}"
                at = motion.at_crossings(curve.points)
                moments = (f"{when:.12g}{of}" for when in motion.crossing_time)
                times += zip(at, moments, strict=True)
        letter = without_tex(f"${self.time}$")
        nearest = [min(times, key=lambda item: np.abs(item[0] - mark).max()) for mark in marks]
        return [f"crossing of D = 0 at {letter} = {moment}" for _, moment in nearest]


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
        title=escape(name),
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
    """What a reader can do with the panels of a figure here, and what differs from print."""
    maps = [axes for axes in sheet.figure.axes if axes.name == "hammer"]
    if maps:
        return "Here the map is on the sphere itself, a dot a start: drag to turn it."
    if sheet.scenes:
        return "Drag to turn, scroll to come nearer; a click on a name in the legend hides it."
    return "Drag to enlarge, double-click to see all; a click on a name in the legend hides it."


def packed(values: np.ndarray) -> dict[str, str]:
    """An array as plotly reads it: the bytes of its numbers, which are shorter than digits."""
    shape = {"shape": ",".join(map(str, values.shape))} if values.ndim > 1 else {}
    kind = {"f": "f8", "i": "i4"}[values.dtype.kind]
    return {
        "dtype": kind,
        "bdata": b64encode(values.astype(f"<{kind}").tobytes()).decode(),
        **shape,
    }


def interactive(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> dict[str, Any]:
    """The data and layout of plotly for a printed figure; `packed` turns its arrays into JSON."""
    names = () if spec["kind"] in SWEPT_KINDS else spec.get("cases", ())
    motions = motions_of(cases, names, spec.get("labels", ()) if names else ())
    samples = Samples({motion.label: motion for motion in motions}, sheet.shown, sheet.time)
    sheet.figure.draw_without_rendering()  # which gives every panel its place
    bars = [axes for axes in sheet.figure.axes if hasattr(axes, "_colorbar")]
    panels = [axes for axes in every_panel(sheet.figure.axes) if axes not in bars]
    # Below the panels is room for their scale of colours.
    margin = {"l": 60, "r": 20, "t": 90, "b": 120 if bars else 50}
    layout = {**LAYOUT, "margin": margin, "title": {"text": without_tex(spec["title"])}}
    traces: list[Trace] = []
    notes: list[Trace] = []
    for i, (axes, domain) in enumerate(zip(panels, domains(panels), strict=True)):
        scene = sheet.scenes.get(axes)
        if axes.name == "hammer":
            drawn, scene = [*globe_traces(axes, sheet.shown[i])], Scene(MIDDLE_OF_MAPS)
        elif scene:
            drawn = [*space_traces(scene, samples)]
        else:
            drawn = [*plane_traces(axes, samples)]
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
    return {**coordinates(np.full((1, 3 if "scene" in place else 2), np.nan)), **place}


MIDDLE_OF_MAPS = View.toward((0, 0))
"""A sphere turned as its printed map has it: x1 in the middle, x3 on top."""


def domains(panels: Sequence[Axes]) -> Iterator[dict[str, list[float]]]:
    """The place of each panel, as parts of the width and height of all."""
    boxes = np.array([axes.get_window_extent().extents for axes in panels]).reshape(-1, 2, 2)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    for x, y in ((boxes - low) / (high - low)).transpose(0, 2, 1).tolist():
        yield {"x": x, "y": y}


def coordinates(points: np.ndarray) -> Trace:
    """A trace of points (n, 2) or (n, 3)."""
    kind = "scatter" if points.shape[1] == 2 else "scatter3d"
    return {"type": kind, **dict(zip("xyz", points.T, strict=False))}


# What is drawn


def curve_traces(curve: Curve, samples: Samples) -> Iterator[Trace]:
    """The traces of a curve, one a colour, with gaps where it has others."""
    record = samples.record(curve.points)
    pieces = stretches(curve.code)
    for code in np.unique(curve.code):
        own = [piece for piece in pieces if curve.code[piece.start] == code]
        index = np.concatenate([[*range(len(curve.code))[piece], -1] for piece in own])[:-1]
        points = np.where(index[:, np.newaxis] < 0, np.nan, curve.points[index])
        look = line_look({**curve.look, "color": curve.colours[code]})
        yield {**coordinates(points), **look, **samples.pointer(record, index)}


def line_look(look: Mapping[str, Any]) -> Trace:
    """The line and marks of a trace, and the group of its legend, by the names of `Line2D`."""
    colour = colour_name(look.get("color", "black"))
    dash, width = dash_of(look.get("ls", "-")), PIXELS * look.get("lw", 1.0)
    trace: Trace = {"mode": "lines", "line": {"color": colour, "dash": dash, "width": width}}
    symbol = SYMBOLS.get(look.get("marker", ""), "")
    if symbol:
        only = look.get("ls") in ("", "None")
        fill, edge = (look.get(key, colour) for key in ("mfc", "mec"))
        edge_line = {"color": colour_name(edge), "width": 1}
        size = PIXELS * look.get("ms", 3)
        trace["mode"] = "markers" if only else "lines+markers"
        trace["marker"] = {
            "symbol": symbol,
            "size": size,
            "color": colour_name(fill),
            "line": edge_line,
        }
        colour = colour_name(fill)
    return {**trace, "legendgroup": f"{colour} {dash} {symbol}"}


def dash_of(line: str | tuple[float, Sequence[float] | None]) -> str:
    """plotly's name of a line of matplotlib's."""
    pattern = line[1] if isinstance(line, tuple) else ()
    if not pattern:
        return "solid"
    return "dashdot" if len(pattern) > 2 else "dash" if pattern[0] > pattern[1] else "dot"


def colour_name(colour: Any) -> str:
    """A colour of matplotlib's by the name that plotly knows."""
    return to_hex(colour)


def space_traces(scene: Scene, samples: Samples) -> Iterator[Trace]:
    """The traces of a panel that shows space."""
    curves = [Curve(item.points, item.code, item.colours, item.look) for item in scene.items]
    for item, curve in zip(scene.items, curves, strict=True):
        if item.look.get("ls", "-") == "":
            yield mark_trace(item.points, item.look, curves, samples)
        elif item.texts:
            texts = {"text": [*map(without_tex, item.texts)], "hoverinfo": "skip"}
            look = line_look(item.look)
            yield {**coordinates(item.points), **look, "mode": "lines+text", **texts}
        else:
            yield from curve_traces(curve, samples)


def mark_trace(
    points: np.ndarray, look: Mapping[str, Any], curves: Sequence[Curve], samples: Samples
) -> Trace:
    """Marks without a line; those of crossings tell their times."""
    trace: Trace = {**coordinates(points), **line_look(look), "hoverinfo": "skip"}
    is_crossing = look.get("mfc") == CROSSING["mfc"] and len(points)
    if is_crossing:
        trace |= {"text": samples.crossing_texts(points, curves), "hoverinfo": "text"}
    return trace


def plane_traces(axes: Axes, samples: Samples) -> Iterator[Trace]:
    """The traces of a plane panel: areas, cells, then curves and marks."""
    for patch in axes.patches:
        yield area_trace(axes, patch)
    curves = []
    for collection in axes.collections:
        if isinstance(collection, QuadMesh):
            yield from cell_traces(collection)
        elif len(collection.get_paths()):
            curves.append(collection_curve(collection))
            yield from curve_traces(curves[-1], samples)
    for line in axes.lines:
        points = np.asarray(line.get_xydata(), dtype=float)
        if line.get_transform() != axes.transData:
            pixels = line.get_transform().transform(points)
            points = axes.transData.inverted().transform(pixels)
        look = look_of(line)
        if look["ls"] in ("", "None"):
            yield mark_trace(points, look, curves, samples)
        elif len(points):
            code, colours = np.zeros(len(points), dtype=int), np.array([to_rgb(look["color"])])
            curves.append(Curve(points, code, colours, look))
            yield from curve_traces(curves[-1], samples)


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


def collection_curve(collection: Collection) -> Curve:
    """A curve that is drawn in pieces, each of a colour and beginning where the last one ends; with
    gaps if they do not."""
    pieces = [path_points(path) for path in collection.get_paths()]
    joined = all(np.array_equal(a[-1], b[0]) for a, b in pairwise(pieces))
    first, *rest = pieces
    gap = np.full((1, 2), np.nan)
    parts = [first, *(part[1:] if joined else np.concatenate([gap, part]) for part in rest)]
    shades = np.resize(to_rgba_array(collection.get_edgecolor())[:, :3], (len(pieces), 3))
    colours, codes = np.unique(shades, axis=0, return_inverse=True)
    # A piece reaches to the first point of the next, whose colour begins there.
    sizes = [len(part) for part in parts]
    code = np.repeat(codes.ravel(), sizes)
    if joined:
        code = np.append(code[1:], code[-1:])
    look = {"lw": float(np.atleast_1d(collection.get_linewidth())[0])}
    return Curve(np.concatenate(parts), code, colours, look)


def path_points(path: Any) -> np.ndarray:
    """The points (n, 2) of a path, with a gap where it begins anew."""
    codes = path.codes if path.codes is not None else np.zeros(len(path.vertices))
    breaks = np.flatnonzero(codes == path.MOVETO)
    return np.insert(np.asarray(path.vertices, dtype=float), breaks[breaks > 0], np.nan, axis=0)


def area_trace(axes: Axes, patch: Patch) -> Trace:
    """A shaded area."""
    outline = patch.get_transform().transform_path(patch.get_path()).vertices
    points = axes.transData.inverted().transform(outline)
    *colour, alpha = to_rgba(patch.get_facecolor())
    shades = ",".join(str(round(255 * part)) for part in colour)
    look = {"fill": "toself", "fillcolor": f"rgba({shades},{alpha:g})", "line": {"width": 0}}
    return {**coordinates(points), **look, "mode": "lines", "hoverinfo": "skip"}


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


def globe_traces(axes: Axes, record: DrawnCurve) -> Iterator[Trace]:
    """A map of directions on the sphere itself: each start as a dot, and the separatrix."""
    *directions, (variable, values) = record.values.items()
    points = np.stack([column for _, column in directions], axis=-1)
    (mesh,) = [item for item in axes.collections if isinstance(item, QuadMesh)]
    known = np.isfinite(values)
    # Apart, because plotly has no colour for what is not a number.
    looks = ((known, {"color": values[known], **scale_of(mesh, "c")}),
             (~known, {"color": colour_name(axes.get_facecolor())}))  # fmt: skip
    for part, look in looks:
        text = [f"{variable} = {v:.6g}" if np.isfinite(v) else "none" for v in values[part]]
        dots = {"mode": "markers", "marker": {"size": 4, **look}, "text": text}
        yield {**coordinates(points[part]), **dots, "hoverinfo": "text"}
    for line in axes.lines:
        circle = on_globe(np.asarray(line.get_xydata(), dtype=float))
        yield {**coordinates(circle), **line_look(look_of(line)), "hoverinfo": "skip"}
    for note in axes.texts:
        if isinstance(note, Annotation):
            words = {"mode": "text", "text": [words_of(note.get_text())], "hoverinfo": "skip"}
            yield {**coordinates(1.1 * on_globe(np.array([note.xy]))), **words}


def on_globe(angles: np.ndarray) -> np.ndarray:
    """The directions (n, 3) of longitudes and latitudes (n, 2)."""
    longitude, latitude = angles.T
    flat = np.cos(latitude)
    return np.stack([flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)], axis=-1)


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
    """The texts in a plane panel, at its values where they are printed; its axes are given."""
    texts = [text for text in axes.texts if text.get_text()]
    notes = []
    for text in texts:
        box = text.get_window_extent()
        x, y = axes.transData.inverted().transform(((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2))
        x, y = (np.log10(v) if scale == "log" else v
                for v, scale in ((x, axes.get_xscale()), (y, axes.get_yscale())))  # fmt: skip
        words = words_of(text.get_text())
        font = {"size": PIXELS * float(text.get_fontsize()), "color": colour_name(text.get_color())}
        place = {"xref": across, "yref": up, "x": float(x), "y": float(y)}
        notes.append({**place, "text": words, "font": font, "showarrow": False})
    return notes


def panel_title(axes: Axes, domain: Mapping[str, list[float]]) -> Trace:
    """The title above a panel."""
    place = {"xref": "paper", "yref": "paper", "x": sum(domain["x"]) / 2, "y": domain["y"][1]}
    words = words_of(axes.title.get_text())
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
    """A text without TeX, in lines as plotly breaks them."""
    return without_tex(text).replace("\n", "<br>")
