"""Figures that a reader can turn and zoom, drawn by plotly in a page of their own. The only
importer of plotly, which is optional.

Every curve has the values that its printed figure shows (`Sheet.shown`): that figure is drawn
first, and nothing is computed twice.
"""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

import numpy as np
import plotly.graph_objects as go
from matplotlib.axes import Axes
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from .. import HodoError
from ..cases.figure_block import SCRIPT
from ..models.rigid_body import LABELS
from ..results.dataset import Cases, motions_of
from ..results.motion import Motion
from ..storage.staging import replacing
from .artists import AREA_END, AXIS_COLOUR, CURVE_END, CYCLE, YELLOW, hues, styles
from .geometry import graticule, stretches
from .maps import GAP, STORED_ERRORS
from .sheet import DrawnCurve, Sheet, without_tex
from .space import common_circles

HOVER = ("G", "T", "D")
"""The quantities of the point under the pointer, besides its coordinates, time and axis."""

MARGIN = {"l": 60, "r": 20, "t": 90, "b": 50}

LEGEND_PLACE = {
    "itemsizing": "constant",
    "orientation": "h",
    "x": 0,
    "y": 1.04,
    "yanchor": "bottom",
}
"""Where the legend stands: above, because beside it would leave a telephone half of its width."""

DASHES = dict(
    zip([line for _, line in CYCLE[:4]], ("solid", "dash", "dashdot", "dot"), strict=True)
)
"""The lines of printed curves, by plotly's names."""

OF_SWEEPS = ("curve", "share")
"""Kinds that show sweeps, which have no samples for the pointer to tell of."""

STILL = ("quadrant-sketch",)
"""Kinds that show nothing to turn or to zoom, and have no page of their own."""


def write_interactive(
    sheet: Sheet, spec: Mapping[str, Any], cases: Cases, path: Path, name: str
) -> None:
    """Write the page of one figure, whose printed form is `sheet`, and the script that it needs.

    Raises HodoError if a file cannot be written.
    """
    figure = interactive(sheet, spec, cases)
    script = path.parent.parent / SCRIPT
    # Once for all figures: it has 5 MB, and nothing is fetched from elsewhere when a page opens.
    if not script.exists():
        with replacing(script) as draft:
            draft.write_text(get_plotlyjs(), encoding="utf-8")
    shell = Template((Path(__file__).parent / "figure.html").read_text(encoding="utf-8"))
    page = shell.substitute(
        title=escape(name),
        caption=escape(spec["caption"]),
        script=f"../{SCRIPT}",
        back=f"../index.html#{quote(path.parent.name)}-{quote(name)}",
        # A caption or label may hold what ends a script.
        figure=str(figure.to_json()).replace("</", "<\\/"),
    )
    with replacing(path) as draft:
        draft.write_text(page, encoding="utf-8")


def interactive(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> go.Figure:
    """The figure of plotly for an entry of a `figures:` block, with the values of its printed
    form."""
    if spec["kind"] in ("hodograph", "sphere"):
        return turnable(sheet, spec, cases)
    if spec["kind"] == "map":
        return turnable_map(sheet, spec) if spec["x"] is None else images(sheet, spec)
    if spec["kind"] in OF_SWEEPS:
        figure = panels(sheet, spec, {})
        if spec["kind"] == "curve":
            mark_gaps(figure, sheet.shown, spec["variable"])
        return figure
    motions = {motion.label: motion for motion in motions_of(cases, spec["cases"], spec["labels"])}
    return panels(sheet, spec, motions)


def turnable(sheet: Sheet, spec: Mapping[str, Any], cases: Cases) -> go.Figure:
    """Hodographs, or curves on the unit sphere, in three dimensions of one scale."""
    figure = go.Figure()
    motions = motions_of(cases, spec["cases"], spec["labels"])
    ball = spec["kind"] == "sphere"
    if ball:
        for line in graticule():
            figure.add_trace(_space(line, "", line={"color": "#C8C8C8", "width": 1}))
        for i, circle in enumerate(common_circles(motions)):
            name = "" if i else "D = 0"
            figure.add_trace(_space(circle, name, line={"color": "#777777", "width": 3}))
    for place, (shown, motion) in enumerate(zip(sheet.shown, motions, strict=True)):
        points = np.stack([v for key, v in shown.values.items() if key != "time"], axis=-1)
        colour = spec["colour"] if motion.classified or spec["colour"] != "axis" else "case"
        own = styles(len(motions), spec["styles"])[place]["color"]
        for name, where, look in _parts(motion, colour, own, place, len(motions)):
            # A gap and no shorter curve, so that a point keeps the number under which its hover
            # text is found.
            part = np.where(where[:, None], points, np.nan)
            figure.add_trace(_space(part, name, line=look, **hover(motion)))
        if not ball and motion.crossing_time.size:
            crossings = motion.at_crossings(points)
            figure.add_trace(_marks(crossings, motion, sheet.time))
        ends = {"size": 4, "color": "#FFFFFF", "line": {"color": "#444444", "width": 2}}
        start = "" if place else "start"
        figure.add_trace(_space(points[:1], start, mode="markers", marker=ends))
    figure.update_layout(scene=_scene(ball), margin=MARGIN, legend=LEGEND_PLACE)
    return figure


def turnable_map(sheet: Sheet, spec: Mapping[str, Any]) -> go.Figure:
    """The directions of a sweep on the unit sphere, coloured by a variable, a sphere a panel."""
    columns = min(3, len(sheet.shown))
    rows = -(-len(sheet.shown) // columns)
    kind = [[{"type": "scene"}] * columns] * rows
    titles = [without_tex(shown.curve) for shown in sheet.shown]
    figure = make_subplots(rows, columns, specs=kind, subplot_titles=titles)
    every = np.concatenate([shown.values[spec["variable"]] for shown in sheet.shown])
    low, high = spec["range"] or (float(np.nanmin(every)), float(np.nanmax(every)))
    for i, shown in enumerate(sheet.shown):
        values = shown.values[spec["variable"]]
        points = np.stack([shown.values[f"G.x{axis}/|G|"] for axis in (1, 2, 3)], axis=-1)
        scale = {"colorscale": _scale(), "cmin": low, "cmax": high, "showscale": i == 0}
        there = np.isfinite(values)
        text = np.array([f"{spec['variable']} = {v:.6g}" for v in values])
        text[~there] = "none"
        # Apart, because plotly has no colour for what is not a number.
        for part, look in ((there, {"color": values[there], **scale}), (~there, {"color": GAP})):
            cloud = {"mode": "markers", "marker": {"size": 4, **look}, "text": text[part]}
            trace = _space(points[part], "", hoverinfo="text", **cloud)
            figure.add_trace(trace, row=i // columns + 1, col=i % columns + 1)
    figure.update_scenes(**_scene(ball=True))
    figure.update_layout(margin=MARGIN, showlegend=False)
    return figure


def images(sheet: Sheet, spec: Mapping[str, Any]) -> go.Figure:
    """A variable of a sweep over two axes, an image a panel, all of one scale."""
    shown = sheet.shown
    columns = min(2, len(shown))
    rows = -(-len(shown) // columns)
    figure = make_subplots(
        rows, columns, subplot_titles=[without_tex(curve.curve) for curve in shown]
    )
    for i, curve in enumerate(shown):
        (across, x), (up, y), (_, z) = curve.values.items()
        place = {"row": i // columns + 1, "col": i % columns + 1}
        figure.add_trace(go.Heatmap(x=x, y=y, z=z, coloraxis="coloraxis"), **place)
        label_axes(figure, place, (across, up), sheet.figure.axes[i])
    limits = dict(zip(("cmin", "cmax"), spec["range"] or (None, None), strict=True))
    figure.update_layout(margin=MARGIN, coloraxis={"colorscale": _scale(), **limits})
    return figure


def label_axes(
    figure: go.Figure, place: Mapping[str, int], names: tuple[str, str], printed: Axes | None
) -> None:
    """Give a panel the scales of the printed one and its labels; names where it has none."""
    axes = (printed.xaxis, printed.yaxis) if printed else (None, None)
    updates = (figure.update_xaxes, figure.update_yaxes)
    for update, name, axis in zip(updates, names, axes, strict=True):
        label = without_tex((axis and axis.get_label_text()) or name).replace("\n", "<br>")
        scale = axis.get_scale() if axis else "linear"
        # Powers of ten, where plotly would write 10µ for 1e-5.
        update(title_text=label, type=scale, exponentformat="power", **place)


def panels(sheet: Sheet, spec: Mapping[str, Any], motions: Mapping[str, Motion]) -> go.Figure:
    """Plane panels, one for each of the printed figure, or for each variable over time."""
    curves = [curve for shown in sheet.shown for curve in _curves(shown, spec)]
    names = list(dict.fromkeys(panel for panel, *_ in curves))
    columns = 1 if len(names) == 1 else 2
    rows = -(-len(names) // columns)
    figure = make_subplots(rows, columns, subplot_titles=[without_tex(name) for name in names])
    labels = list(dict.fromkeys(label for _, label, *_ in curves))
    # In panels of cases, colours tell variables apart.
    given = () if spec.get("panels") == "case" else spec.get("styles", ())
    looks = [
        {"color": look["color"], "dash": DASHES[look["ls"]]} for look in styles(len(labels), given)
    ]
    # The panels of a series are others: an inset is one of its own.
    printed = {} if spec["kind"] == "series" else dict(zip(names, sheet.figure.axes, strict=False))
    for panel, label, x, y, values in curves:
        row, column = divmod(names.index(panel), columns)
        look = {**looks[labels.index(label)], "width": 2}
        motion = motions.get(label)
        pointer = hover(motion) if motion and len(motion.time) == len(values[x]) else {}
        if (error := STORED_ERRORS.get(y, "")) in values:
            pointer["error_y"] = {"array": values[error]}
        trace = go.Scatter(
            x=values[x],
            y=values[y],
            name=without_tex(label),
            mode="lines+markers" if spec["kind"] == "curve" else "lines",
            line=look,
            legendgroup=label,
            showlegend=panel == next(p for p, other, *_ in curves if other == label),
            **pointer,
        )
        place = {"row": row + 1, "col": column + 1}
        figure.add_trace(trace, **place)
        label_axes(figure, place, (x, y), printed.get(panel))
        _mark_crossings(figure, motion, x, values, y, (row + 1, column + 1))
    figure.update_layout(margin=MARGIN, legend=LEGEND_PLACE)
    return figure


def mark_gaps(figure: go.Figure, shown: Sequence[DrawnCurve], variable: str) -> None:
    """Crosses below the curves of sweeps at the members that have no value."""
    every = np.concatenate([curve.values[variable] for curve in shown])
    low, high = float(np.nanmin(every)), float(np.nanmax(every))
    below = low - 0.05 * ((high - low) or abs(low) or 1.0)
    marked = False
    for i, curve in enumerate(shown):
        (across, places), *_ = curve.values.items()
        x = places[np.isnan(curve.values[variable])]
        if not x.size:
            continue
        trace = go.Scatter(
            x=x,
            y=np.full(len(x), below),
            mode="markers",
            marker={"symbol": "x", "size": 7, "color": styles(i + 1)[i]["color"]},
            text=[f"{across} = {value:.6g}: none" for value in x],
            hoverinfo="text",
            name="none",
            legendgroup="none",
            showlegend=not marked,
        )
        figure.add_trace(trace)
        marked = True


def _curves(
    shown: DrawnCurve, spec: Mapping[str, Any]
) -> list[tuple[str, str, str, str, Mapping[str, np.ndarray]]]:
    """Panel, curve, and the names on both axes of what one record shows."""
    names = list(shown.values)
    if spec["kind"] == "phase":
        return [(shown.panel, shown.curve, spec["x"], spec["y"], shown.values)]
    if spec["kind"] in ("quadrants", "curve"):
        x, y = [name for name in names if name != "time"][:2]
        return [(shown.panel, shown.curve, x, y, shown.values)]
    across = "time" if "time" in names else names[0]
    by_case = spec.get("panels") == "case"
    return [
        (
            shown.curve if by_case else name,
            name if by_case else shown.curve,
            across,
            name,
            shown.values,
        )
        # Time itself may be the variable that is drawn.
        for name in [name for name in names if name != across] or [across]
    ]


def hover(motion: Motion) -> dict[str, Any]:
    """What the pointer shows of each sample: time, |G|, T, D and the enclosed axis."""
    quantities: dict[str, np.ndarray] = {"time": motion.time}
    for name in HOVER:
        try:
            quantities[name] = motion[name]
        except HodoError:
            continue
    lines = [f"{name} = %{{customdata[{i}]:.6g}}" for i, name in enumerate(quantities)]
    columns: list[Any] = list(quantities.values())
    if motion.classified:
        lines.append(f"encloses %{{customdata[{len(columns)}]}}")
        columns.append(np.array([LABELS[int(label)] for label in motion.labels], dtype=object))
    data = np.stack([np.asarray(column, dtype=object) for column in columns], axis=-1)
    return {"customdata": data, "hovertemplate": "<br>".join(lines)}


def _parts(
    motion: Motion, colour: str, own: str, place: int, several: int
) -> list[tuple[str, np.ndarray, dict[str, Any]]]:
    """A curve in the parts that differ in colour: name, samples (n,), and look of each."""
    n = len(motion.time)
    if colour == "time":
        scale = {
            "color": motion.time,
            "colorscale": _scale(CURVE_END),
            "showscale": place == 0,
            "width": 4,
        }
        return [(motion.label, np.ones(n, dtype=bool), scale)]
    if colour == "case":
        look = {"color": own, "width": 4}
        return [(motion.label, np.ones(n, dtype=bool), look)]
    parts = []
    for label in np.unique(motion.labels):
        where = np.zeros(n, dtype=bool)
        for piece in stretches(motion.labels):
            if motion.labels[piece.start] == label:
                where[piece] = True
        axis = LABELS[int(label)]
        name = f"{motion.label}: {axis}" if several > 1 else f"about {axis}"
        parts.append((without_tex(name), where, {"color": AXIS_COLOUR[int(label)], "width": 4}))
    return parts


def _space(points: np.ndarray, name: str, mode: str = "lines", **look: Any) -> go.Scatter3d:
    """A curve or points (n, 3) in body axes; without a name it is no entry of the legend."""
    x, y, z = points.T
    quiet = {} if "hovertemplate" in look or "hoverinfo" in look else {"hoverinfo": "skip"}
    return go.Scatter3d(
        x=x, y=y, z=z, mode=mode, name=without_tex(name), showlegend=bool(name), **quiet, **look
    )


def _marks(points: np.ndarray, motion: Motion, symbol: str) -> go.Scatter3d:
    """The crossings (m, 3) with their times."""
    look = {"size": 5, "symbol": "diamond", "color": YELLOW, "line": {"color": "#000000"}}
    letter = without_tex(f"${symbol}$")
    text = [f"crossing of D = 0 at {letter} = {when}" for when in _times(motion)]
    return _space(points, "D = 0", mode="markers", marker=look, text=text, hoverinfo="text")


def _times(motion: Motion) -> list[str]:
    """The times of the crossings with their unit."""
    unit = motion.units("time")
    return [f"{time:.12g}{'' if unit == '1' else f' {unit}'}" for time in motion.crossing_time]


def _mark_crossings(
    figure: go.Figure,
    motion: Motion | None,
    x: str,
    values: Mapping[str, np.ndarray],
    y: str,
    place: tuple[int, int],
) -> None:
    """The crossings of a plane curve, interpolated between its samples."""
    if motion is None or not motion.crossing_time.size or len(motion.time) != len(values[x]):
        return
    at = motion.at_crossings(np.stack([values[x], values[y]], axis=-1))
    text = [f"crossing of D = 0 at {when}" for when in _times(motion)]
    marker = {"symbol": "diamond", "size": 9, "color": YELLOW, "line": {"width": 1}}
    trace = go.Scatter(
        x=at[:, 0],
        y=at[:, 1],
        mode="markers",
        marker=marker,
        text=text,
        hoverinfo="text",
        name="D = 0",
        showlegend=False,
    )
    figure.add_trace(trace, row=place[0], col=place[1])


def _scene(ball: bool) -> dict[str, Any]:
    """Axes of one scale, named after the body axes."""
    names = [f"G{i}/|G|" if ball else f"G{i}" for i in (1, 2, 3)]
    axes = {
        f"{letter}axis": {"title": {"text": name}}
        for letter, name in zip("xyz", names, strict=True)
    }
    return {"aspectmode": "data", **axes}


def _scale(end: float = AREA_END) -> list[list[Any]]:
    """The scale of colours of the printed figures, for plotly."""
    colours = (255 * np.asarray(hues(16, end).colors)[:, :3]).astype(int)
    return [[i / 15, f"rgb({r},{g},{b})"] for i, (r, g, b) in enumerate(colours.tolist())]
