"""Figures of unusual data and looks: motions that have died down, single samples, gaps, ends of
axes that are given, large letters and long legends."""

import warnings
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from drawings import drawings_of
from matplotlib.figure import Figure
from matplotlib.text import Text

import hodo_cli as hodo
from hodo_cli import HodoError

BODY: dict[str, Any] = {
    "model": "linear-diag",
    "inertia": [1, 0.8, 0.6],
    "damping": 1,
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
    "time": {"end": 900, "samples": 901},
}
STARTS = {
    **BODY,
    "damping": [0.005, 0.004, 0.003],
    "initial": {"p": 0, "q": 0, "G": 1},
    "time": {"end": 300},
}
# In it the first value of damping lets no start cross.
GRID = {
    **STARTS,
    "initial": BODY["initial"],
    "sweep": {
        "damping.0": {"linspace": [0.003, 0.007, 5]},
        "inertia.2": {"values": [0.6, 0.9]},
        "damping.2": {"values": [0.001, 0.002]},
    },
}
LARGE = {"font_size": 20}
CASES = """
defaults: {{model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0, time: {{end: 1}},
  initial: {{p: 0, q: 0, G: 1}}}}
cases:
  a: {{}}
  b: {{damping: 0.1}}
  c: {{initial: {{p: 0, r: 0, G: 1}}}}
  starts: {{sweep: {{direction: {{sphere: {{count: 3}}}}}}}}
  line: {{sweep: {{damping.0: {{values: [1, 2]}}}}}}
figures: {{f: {}}}
"""


@pytest.fixture(scope="module")
def dying() -> xr.Dataset:
    """A body whose omega ends below the smallest double, while its direction is known: under equal
    damping it goes the way of the free body."""
    return hodo.run(BODY)


@pytest.fixture(scope="module")
def turning() -> xr.Dataset:
    return hodo.run({**BODY, "damping": [0.005, 0.004, 0.003], "time": {"end": 1000}})


@pytest.fixture(scope="module")
def grid() -> xr.Dataset:
    return hodo.sweep(GRID)


def drawn(*args: Any, **keys: Any) -> Figure:
    """A figure that is drawn without a warning but for those about samples."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*so that its curve is a polygon")
        figure = hodo.plot(*args, **keys)
        figure.draw_without_rendering()
    return figure


def test_a_direction_keeps_its_digits_until_omega_has_none(dying: xr.Dataset) -> None:
    """The squares of omega lose theirs from 1e-154 on, twice as early."""
    omega, A = np.array([0.8, 0.5, 0.74]), np.array([1, 0.8, 0.6])
    G2, energy = np.sum((A * omega) ** 2), np.sum(A * omega**2) / 2
    names = ("J", "D/2T", "separatrix_distance", "tilt", "x1_direction")
    values = hodo.derive(dying, *names)
    is_normal = np.abs(dying.omega).max("axis").values > 2.3e-308
    assert 700 < is_normal.sum() < 720
    J = G2 / (2 * energy)
    # Constants of the free motion.
    for name, constant in (("J", J), ("D/2T", J - 0.8), ("separatrix_distance", 1 - 0.8 / J)):
        np.testing.assert_allclose(values[name][is_normal], constant, rtol=1e-12)
    # The stretched time, and with it the direction, stands still from 50 on.
    for name in ("tilt", "x1_direction"):
        there = values[name].values
        np.testing.assert_allclose(there[50:700], there[50], rtol=1e-12)
    for name in names:
        assert np.isnan(values[name][720:]).all()


def test_a_direction_of_a_huge_motion_has_its_digits() -> None:
    scale = {key: 1e100 * value for key, value in BODY["initial"].items()}
    fast = hodo.run({**BODY, "damping": 0, "initial": scale, "time": {"end": 1e-99, "samples": 9}})
    np.testing.assert_allclose(hodo.derive(fast, "D/2T")["D/2T"], 0.0533032107893475, rtol=1e-12)


def test_a_sphere_shows_no_direction_of_lost_digits(dying: xr.Dataset) -> None:
    figure = drawn(dying, "sphere")
    (end,) = (x for x in figure.axes[0].lines if x.get_marker() == "s")
    moving = hodo.run({**BODY, "time": {"values": [100]}})
    (mark,) = (x for x in drawn(moving, "sphere").axes[0].lines if x.get_marker() == "s")
    np.testing.assert_allclose(end.get_xydata(), mark.get_xydata(), atol=1e-9)


def test_names_of_curves_with_one_start_are_no_heap_in_a_page(tmp_path: Path) -> None:
    sheet = drawings_of(CASES.format("{kind: sphere, cases: [a, b, c]}"), tmp_path).draw("f")
    (scene,) = sheet.scenes.values()
    names = [stroke["texts"] for stroke in scene.strokes if stroke["look"].get("lw") == 0]
    assert names == [["a, b"], ["c"]]


def test_curves_of_one_name_have_a_row_each_in_a_table(tmp_path: Path) -> None:
    figure = "{kind: series, cases: [a, b], variables: [G, T], labels: [same, same]}"
    results = drawings_of(CASES.format(figure), tmp_path)
    lines = results.draw("f").csv().splitlines()
    assert lines[0] == "curve,time,G,T"
    assert len(lines) == 1 + 2 * results.cases["a"].sizes["time"]
    assert all("" not in line.split(",") for line in lines)


def test_huge_and_tiny_constants_are_said_to_be_constant() -> None:
    for size in (1e85, 1e-85):
        start = {key: size * value for key, value in BODY["initial"].items()}
        time = {"end": 100 / size, "samples": 101}
        free = hodo.run({**BODY, "damping": 0, "initial": start, "time": time})
        figure = drawn(free, "series", variables=["T"])
        assert [text.get_text()[:8] for text in figure.axes[0].texts] == ["constant"]


def test_a_single_sample_is_marked() -> None:
    one = hodo.run({**BODY, "damping": 0, "time": {"end": 10, "samples": 1}})
    for figure in (drawn(one, "invariants"), drawn(one, "series", variables=["G", "T", "D"])):
        assert [axes.lines[0].get_marker() for axes in figure.axes] == ["o"] * 3


@pytest.mark.parametrize(
    ("inertia", "sides"), [([1, 1, 0.6], ["about $x_3$"]), ([1, 0.8, 0.8], ["about $x_1$"])]
)
def test_a_side_that_a_body_lacks_is_not_named(inertia: list[float], sides: list[str]) -> None:
    body = hodo.run({**BODY, "inertia": inertia, "time": {"end": 1}})
    texts = drawn(body, "invariants").axes[2].texts
    assert [text.get_text() for text in texts] == sides


def test_a_logarithmic_axis_takes_the_smallest_numbers(dying: xr.Dataset) -> None:
    figure = drawn(dying, "series", variables=["G2", "speed"], style={"log": "y"})
    for axes in figure.axes:
        assert axes.get_ylim()[0] <= 5e-324


def test_panels_of_one_logarithmic_time_begin_with_the_earliest_sample() -> None:
    early, late = (
        hodo.run({**BODY, "time": {"end": 100, "samples": samples}}) for samples in (1001, 11)
    )
    keys = {"variables": ["G"], "panels": "case", "style": {"log": "x"}}
    for pair in ([early, late], [late, early]):
        figure = drawn(pair, "series", **keys)
        assert all(axes.get_xlim()[0] <= 0.1 for axes in figure.axes)
    # From a time of 0, which lies nowhere, a line would come level.
    assert not np.isfinite(figure.axes[0].transData.transform((0, 1))[0])


def test_the_diagonal_of_logarithmic_quadrants_is_seen(turning: xr.Dataset) -> None:
    (axes,) = drawn(turning, "quadrants", style={"log": ["x", "y"]}).axes
    diagonal = axes.lines[0]
    ends = axes.transData.transform(diagonal.get_xydata())
    slope = np.diff(ends, axis=0)[0]
    assert slope[1] == pytest.approx(slope[0], rel=1e-3)
    # Each region has its name within it, seen from the diagonal.
    for text, side in zip(axes.texts, (-1, 1), strict=True):
        box = text.get_window_extent().transformed(axes.transAxes.inverted())
        assert (np.array([box.y0 - box.x1, box.y1 - box.x0]) * side > 0).all(), text


@pytest.mark.parametrize("values", ["x", 1j])
def test_what_is_no_number_is_no_variable(turning: xr.Dataset, values: Any) -> None:
    named = turning.assign(mine=("time", np.full(turning.sizes["time"], values)))
    with pytest.raises(HodoError, match="unknown variable 'mine' of the case"):
        hodo.plot(named, "series", variables=["mine"])


def test_a_message_about_a_logarithmic_axis_names_it_in_every_panel() -> None:
    early = hodo.run({**BODY, "time": {"start": -5, "end": 5}})
    with pytest.raises(HodoError, match=r"the x axis of τ \[–\] reaches below zero, down to -5"):
        hodo.plot(early, "series", variables=["G", "T", "D"], style={"log": "x"})


@pytest.mark.parametrize("ends", [{"xlim": [0, 0.2]}, {"xlim": [0, 0.2], "ylim": [-0.1, 1]}])
def test_given_ends_of_equal_scales_are_kept(turning: xr.Dataset, ends: dict[str, Any]) -> None:
    (axes,) = drawn(turning, "phase", x="p", y="q", style=ends).axes
    for name, limits in ends.items():
        assert list(getattr(axes, f"get_{name}")()) == limits
    across, up = (np.ptp(limits) for limits in (axes.get_xlim(), axes.get_ylim()))
    assert axes.bbox.width / across == pytest.approx(axes.bbox.height / up, rel=0.01)
    # The start, at p = 0.8, is no mark beside the panel.
    assert all(line.get_clip_on() for line in axes.lines)


def test_regions_of_quadrants_reach_the_given_ends(turning: xr.Dataset) -> None:
    (axes,) = drawn(turning, "quadrants", style={"xlim": [0, 9], "ylim": [0, 9]}).axes
    below, above = ({*map(tuple, patch.get_xy())} for patch in axes.patches)
    assert below == {(0, 0), (9, 9), (9, 0)}
    assert above == {(0, 0), (9, 9), (0, 9)}
    drawn(turning, "quadrants", style={"width": "column"})  # without ends


def test_two_constant_components_have_equal_scales(caplog: pytest.LogCaptureFixture) -> None:
    steady = hodo.run({**BODY, "damping": 0, "initial": {"p": 0, "q": 0, "r": 1}})
    drawn(steady, "phase", x="p", y="r")
    assert not caplog.records  # matplotlib tells of ends that it cannot keep


def test_every_panel_has_a_letter(turning: xr.Dataset) -> None:
    short = [turning.isel(time=slice(0, 9))] * 28
    keys: dict[str, Any] = {"variables": ["G"], "panels": "case", "columns": 4}
    figure = hodo.plot(short, "series", **keys, style={"letters": "yes"})
    assert [axes.get_title(loc="left") for axes in figure.axes][25:] == ["(z)", "(aa)", "(ab)"]


@pytest.mark.parametrize(
    ("kind", "keys", "labels"),
    [
        ("hodograph", {"zoom": 0.5}, [""]),
        ("series", {"variables": ["G"], "panels": "case"}, 2 * ["a body with a name in words"]),
    ],
)
def test_letters_and_titles_of_narrow_panels_are_on_no_others(
    turning: xr.Dataset, kind: str, keys: dict[str, Any], labels: list[str]
) -> None:
    keys["style"] = {"width": "column", "letters": "yes", "height": 50}
    figure = drawn([turning] * len(labels), kind, labels=labels, **keys)
    boxes = []
    for axes in figure.axes:
        titles = {axes.get_title(), axes.get_title(loc="left")} - {""}
        texts = (x for x in axes.get_children() if isinstance(x, Text) and x.get_text() in titles)
        boxes += [text.get_window_extent() for text in texts]
    assert len(boxes) > 2
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert min(box.x0 for box in boxes) > figure.bbox.x0


def test_a_tiny_time_is_written_as_a_power() -> None:
    start = {key: 1e60 * value for key, value in BODY["initial"].items()}
    fast = hodo.run({**BODY, "damping": 0, "initial": start, "time": {"end": 2e-59}})
    figure = drawn(fast, "hodograph")
    ends = [text.get_text() for text in figure.legends[0].texts if "end" in text.get_text()]
    assert ends == [r"end, $\tau = 2 \cdot 10^{-59}$"]


@pytest.mark.parametrize(
    ("count", "style"),
    [
        (2, {}),
        (2, {"font_size": 16}),
        (2, {"width": 30}),
        (30, {}),
        (30, {"legend": "right", "width": "page"}),
    ],
)
def test_a_legend_is_within_its_figure(
    turning: xr.Dataset, count: int, style: dict[str, Any]
) -> None:
    words = "a label in words that is longer than the column of a journal is wide, wanted by one"
    labels = [words if count == 2 else "case", *(f"c{i}" for i in range(1, count))]
    figure = drawn([turning] * count, "series", variables=["G"], labels=labels, style=style)
    (box,) = (legend.get_window_extent() for legend in figure.legends)
    assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
    assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1


def test_panels_with_large_letters_stand_below_each_other(
    turning: xr.Dataset, grid: xr.Dataset, tmp_path: Path
) -> None:
    swept: dict[str, Any] = {"variable": "T", "x": "damping.0", "y": "inertia.2"}
    sketched = drawings_of(
        CASES.format("{kind: quadrant-sketch, bodies: [[3, 2, 2], [2, 2, 1]]}"), tmp_path
    )
    for style, columns in (({}, 2), (LARGE, 1)):
        for figure in (
            drawn(turning, "quadrants", zoom=0.1, style=style),
            drawn(grid, "map", panels="damping.2", **swept, style=style),
            sketched.draw("f", style=style).figure,
        ):
            grid_of_panels = figure.axes[0].get_subplotspec().get_gridspec()
            assert grid_of_panels.ncols == columns


def test_numbers_along_an_axis_are_not_on_each_other() -> None:
    one = hodo.sweep({**STARTS, "sweep": {"damping.2": {"values": [0.003]}}})
    figure: Any = drawn(one, "curve", variable="T", x="damping.2", style=LARGE)
    axes = figure.axes[0]
    with figure.styled():
        boxes = [x.get_window_extent() for x in axes.get_xticklabels() if x.get_text()]
    seen = [box for box in boxes if axes.bbox.x0 <= (box.x0 + box.x1) / 2 <= axes.bbox.x1]
    assert seen
    assert all(a.x1 < b.x0 for a, b in pairwise(seen))
    # Outside of its parameters too, as a user asks for them.
    assert axes.get_xticklabels()


def test_lowest_panels_of_a_map_have_numbers_and_a_label(grid: xr.Dataset) -> None:
    keys: dict[str, Any] = {"variable": "T", "x": "inertia.2", "y": "damping.2"}
    figure = drawn(grid, "map", panels="damping.0", **keys)
    labels = [axes.get_xlabel() != "" for axes in figure.axes[:5]]
    numbers = [any(x.get_visible() for x in axes.get_xticklabels()) for axes in figure.axes[:5]]
    assert labels == numbers == [False, False, True, True, True]


def test_a_panel_of_a_map_may_lack_values(grid: xr.Dataset) -> None:
    keys: dict[str, Any] = {"variable": "crossing_time", "x": "inertia.2", "y": "damping.2"}
    by_damping = [
        bool(np.isfinite(x).any()) for x in grid.crossing_time.transpose("damping.0", ...)
    ]
    assert not all(by_damping)
    assert any(by_damping)
    figure = drawn(grid, "map", panels="damping.0", **keys)
    shown = [
        not np.ma.getmaskarray(axes.collections[0].get_array()).all() for axes in figure.axes[:5]
    ]
    assert shown == by_damping
    with pytest.raises(HodoError, match=r"^sweep sweep has no value of crossing_time to draw$"):
        hodo.plot(grid, "map", panels="damping.0", at=[by_damping.index(False)], **keys)


def test_a_map_of_the_status_shows_every_status() -> None:
    """Members of another status than ok have no values but this one."""
    moments = {"inertia.0": {"values": [1, 2.5]}, "inertia.2": {"values": [0.6, 0.7]}}
    swept = hodo.sweep({**STARTS, "initial": BODY["initial"], "sweep": moments})
    assert swept.status.values.tolist() == [[0, 0], [3, 3]]
    figure = drawn(swept, "map", variable="status", x="inertia.0", y="inertia.2")
    words = [text.get_text().rpartition(": ")[2] for text in figure.legends[0].texts]
    assert words == ["ok", "invalid"]


@pytest.mark.parametrize(
    ("figure", "mistake"),
    [
        (
            "{kind: quadrant-sketch, bodies: [[1, 0.8, 0.6], [5, 1, 1]]}",
            "figures.f.bodies.1: no body",
        ),
        (
            "{kind: quadrant-sketch, bodies: [[1, 1, 1]]}",
            "figures.f.bodies.0: a body with three eq",
        ),
        (
            "{kind: quadrants, cases: [a], style: {log: x}}",
            "figures.f.style.log: expected both x and",
        ),
        (
            "{kind: series, cases: [a], variables: [G], insets: [{panel: G, case: a, "
            "variables: [G], box: [0, 0, -0.2, 0.3]}]}",
            "figures.f.insets.0.box: expected a positive width and height",
        ),
    ],
)
def test_what_no_figure_can_show_is_refused_with_its_place(
    figure: str, mistake: str, tmp_path: Path
) -> None:
    with pytest.raises(AssertionError) as refused:
        drawings_of(CASES.format(figure), tmp_path)
    assert mistake in str(refused.value)
