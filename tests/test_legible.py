"""Words and marks of figures are on no others, and say which case they are of."""

import re
import warnings
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from drawings import Drawings, drawings_of
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex

from hodo_cli import HodoError, derive, plot, run, sweep

CASES = """
defaults:
  {inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 100, samples: 501}}
cases:
  slow: {model: torques, damping: 0.003, brake: 0.02, time: {end: 100, unit: s}}
  fast: {model: torques, damping: 0.003, brake: 0.022, time: {end: 100, unit: s}}
  round-x1: {model: linear-diag, damping: [0.005, 0.004, 0.003], time: {end: 300, samples: 3001}}
  crossing: {model: linear-diag, damping: [0.015, 0.004, 0.003]}
  flat: {model: linear-diag, inertia: [1, 0.7, 0.4], damping: [0.005, 0.004, 0.003]}
  grown:
    model: linear-diag
    damping: [0.015, 0.004, 0.003]
    sweep: {damping.0: {linspace: [0.005, 0.015, 30]}, initial.q: {values: [0.5, 0.3, 0.4]}}
  zipped:
    model: linear-diag
    damping: [0.015, 0.004, 0.003]
    sweep:
      damping.1: {values: [0.003, 0.004, 0.005]}
      z: {zip: {damping.0: {values: [0.001, 0.005]}, damping.2: {values: [0.005, 0.001]}}}
  starts:
    model: torques
    inertia_unit: kg m^2
    sweep: {kappa: {linspace: [0, 80, 5]}, direction: {sphere: {count: 10, seed: 3}}}
    damping: [0.005, 0.004, 0.002]
    initial: {p: 0, q: 0, G: 1}
  tilted:
    {model: Lagrange-averaged, form: full, inertia: {A: 1.5, C: 1}, epsilon: 0.1, mu: 0.5,
     a: [0.1, 1], b: [0.1, 1], attitude: yes, initial: {theta: 60 deg, r: 1.7}, time: {end: 1},
     sweep: {initial.theta: {values: [30 deg, 60 deg]}, mu: {values: [0.3, 0.5]}}}
  back: {model: tensor, resistance: {diagonal: 0.005, off_diagonal: 0.005}, attitude: yes,
         initial: {p: 0.5, q: 0.25, G: 1}, time: {end: 500, samples: 5001}}
  again: {model: tensor, resistance: {diagonal: 0.005, off_diagonal: 0.005}, attitude: yes,
          initial: {p: 0.5, q: 0.2501, G: 1}, time: {end: 500, samples: 5001}}
  late: {model: linear-diag, damping: [0.005, 0.004, 0.003],
         time: {values: [7.1, 8.3, 20, 90, 400]}}
  kicked: {model: torques, damping: 0.003, brake: 0.02, attitude: yes,
           time: {end: 100, unit: s}}
figures:
  column: {kind: series, cases: [slow, kicked], variables: [omega.x1, omega.x2, omega.x3],
           panels: case, style: {width: column, font_size: 8, letters: yes}}
  space: {kind: body, cases: [kicked], style: {width: column}}
  angles: {kind: map, cases: [tilted], variable: theta, x: initial.theta, y: mu}
  bare: {kind: curve, cases: [tilted], variable: theta, x: initial.theta}
  stops: {kind: series, cases: [slow, fast], variables: [G], style: {log: [y]}}
  narrow: {kind: series, cases: [round-x1], variables: [G, T],
           columns: 2, style: {log: [x, y], width: column}}
  laws: {kind: series, cases: [round-x1, late], variables: [G, T],
         formula: {G: "exp(-0.004*t)", T: "G2/1.7"}}
  law: {kind: series, cases: [round-x1], variables: [G, T], formula: {G: "exp(-0.004*t)"}}
  ball: {kind: sphere, cases: [crossing, flat]}
  ends: {kind: hodograph, cases: [round-x1, crossing], zoom: 0.9, projections: [x1x2]}
  sides: {kind: invariants, cases: [round-x1, crossing]}
  regions: {kind: quadrants, cases: [round-x1, crossing]}
  across: {kind: herpolhode, cases: [back, again]}
  alone: {kind: hodograph, cases: [crossing]}
  times: {kind: map, cases: [grown], variable: crossing_time, x: damping.0, y: initial.q}
  lines: {kind: curve, cases: [grown], variable: crossing_time, x: damping.0, by: initial.q}
  together: {kind: curve, cases: [zipped], variable: T, x: damping.1, by: z}
  squares: {kind: map, cases: [zipped], variable: T, x: z, y: damping.1}
  listed: {kind: curve, cases: [grown], variable: crossing_time, x: damping.0,
           by: initial.q, at: [0, 1]}
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawings:
    return drawings_of(CASES, tmp_path_factory.mktemp("legible"))


def boxes(texts: Any) -> list[Any]:
    """The places of texts that are shown."""
    return [text.get_window_extent() for text in texts if text.get_text() and text.get_visible()]


def legend(sheet: Any) -> list[str]:
    return legend_words(sheet.figure)


def legend_words(figure: Any) -> list[str]:
    return [text.get_text() for box in figure.legends for text in box.get_texts()]


def test_names_of_stops_on_a_logarithmic_axis_stand_apart(drawn: Drawings) -> None:
    figure = drawn.draw("stops").figure
    figure.draw_without_rendering()
    first, second = boxes(figure.axes[0].texts)
    assert not first.overlaps(second)


def test_the_name_of_a_stop_stands_once_within_a_narrow_panel(drawn: Drawings) -> None:
    figure = drawn.draw("column").figure
    figure.draw_without_rendering()
    for axes in figure.axes:
        (name,) = axes.texts
        when = drawn.cases["slow"].event_time.item()
        assert " ".join(name.get_text().split()) == f"$p = q = r = 0$ at $t = {when:#.4g}$ s"
        assert name.get_path_effects()
        (box,) = boxes([name])
        assert axes.bbox.x0 <= box.x0 < box.x1 <= axes.bbox.x1
        assert axes.bbox.y0 <= box.y0 < box.y1 <= axes.bbox.y1
        assert axes.bbox.height > 0.5 * axes.bbox.width


def test_narrow_pictures_of_a_body_stand_below_each_other(drawn: Drawings) -> None:
    for width in (84.0, 30.0):
        figure = drawn.draw("space", style={"width": width}).figure
        figure.draw_without_rendering()
        sides = [axes.bbox.width / figure.dpi * 25.4 for axes in figure.axes]
        assert len(sides) == 3
        assert min(sides) > min(width, 40) - 8


@pytest.mark.parametrize(
    ("count", "style", "is_right"),
    [
        (2, {"width": "page"}, True),
        (4, {"width": "page"}, False),
        (4, {"width": 300.0}, True),
        (1, {"width": "column"}, True),
        (1, {"width": 50.0}, False),
    ],
)
def test_a_legend_beside_panels_leaves_each_its_width(
    drawn: Drawings, count: int, style: dict[str, Any], is_right: bool
) -> None:
    variables = ("omega.x1", "omega.x2", "omega.x3", "G")[:count]
    spec = {"variables": variables, "columns": 4, "cases": ("round-x1", "crossing")}
    figure = drawn.draw("narrow", **spec, style={**style, "legend": "right"}).figure
    figure.draw_without_rendering()
    (box,) = [words.get_window_extent() for words in figure.legends]
    panels = [axes.bbox for axes in figure.axes]
    assert (box.x0 > max(panel.x1 for panel in panels)) == is_right
    assert is_right or box.y1 < min(panel.y0 for panel in panels)
    assert min(panel.width for panel in panels) / figure.dpi * 25.4 > 24


def test_a_figure_without_room_for_its_words_is_refused(drawn: Drawings) -> None:
    style = {"width": 40.0, "height": 20.0, "font_size": 20.0}
    with pytest.raises(HodoError, match="40 mm by 20 mm have no room for the panels"):
        drawn.draw("column", style=style).figure.draw_without_rendering()


def test_larger_letters_take_fewer_panels_of_a_hodograph_in_a_row(drawn: Drawings) -> None:
    style = {"width": "column", "font": "DejaVu Sans", "font_size": 14.0}
    for keys, panels in (({"projections": ("x1x2", "x2x3")}, 3), ({"zoom": 0.45}, 2)):
        figure = drawn.draw("alone", **keys, style=style).figure
        figure.draw_without_rendering()
        assert len({axes.get_subplotspec().rowspan.start for axes in figure.axes}) == panels
        assert min(axes.bbox.width for axes in figure.axes) / figure.dpi * 25.4 > 25
        check_labels(figure)


@pytest.mark.parametrize(
    "keys",
    [{"kind": "hodograph", "projections": ["x1x2"]}, {"kind": "series", "variables": ["p", "q"]}],
)
def test_panels_that_are_too_small_for_their_words_are_refused(
    drawn: Drawings, keys: dict[str, Any]
) -> None:
    figure = plot(drawn.cases["crossing"], **keys, style={"width": 30, "font_size": 14})
    with pytest.raises(HodoError, match=r"30 mm by .* have no room for the panels beside"):
        figure.draw_without_rendering()


@pytest.mark.parametrize("width", ["column", "page"])
def test_words_of_quadrants_stay_in_their_panels_and_regions(drawn: Drawings, width: str) -> None:
    figure = drawn.draw("regions", cases=("slow", "fast"), zoom=0.05, style={"width": width}).figure
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.get_xlabel() == "$p^2$ [1/s$^{2}$]"
        numbers = boxes(axes.get_xticklabels())
        # Not side by side, where they would read as one.
        assert min(b.x0 - a.x1 for a, b in pairwise(numbers)) > 3
        assert [text.get_text()[0] for text in axes.texts] == ["A", "B"]
        for text, box in zip(axes.texts, boxes(axes.texts), strict=True):
            assert axes.bbox.x0 <= box.x0 < box.x1 <= axes.bbox.x1
            # D > 0 is below the diagonal.
            assert (text.xy[0] > text.xy[1]) == (text.get_text()[0] == "A")


def test_curves_on_one_side_of_the_quadrants_differ_in_line_and_are_in_the_legend(
    drawn: Drawings,
) -> None:
    sheet = drawn.draw("regions", cases=("slow", "fast"))
    lines = {str(line.get_label()): line for line in sheet.legend}
    curves = [x for x in sheet.figure.axes[0].collections if isinstance(x, LineCollection)]
    (solid,), (dashed,) = (curve.get_linestyles() for curve in curves)
    assert solid[1] is None
    assert dashed[1]
    assert curves[0].get_colors()[0].tolist() == curves[1].get_colors()[0].tolist()
    assert lines["slow"].get_linestyle() == "-" != lines["fast"].get_linestyle()


def test_long_names_stay_on_the_sheet(drawn: Drawings) -> None:
    names = ["a" * 79, "m23456789-" * 7 + "end"]
    cases = [drawn.cases["crossing"], drawn.cases["round-x1"]]
    for kind in ("sphere", "hodograph"):
        figure = plot(cases, kind=kind, labels=names)
        figure.draw_without_rendering()
        words = {text.get_text().replace("\n", ""): text for text in figure.axes[0].texts}
        for name in names:
            (box,) = boxes([words[name]])
            assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1


@pytest.mark.heyoka
def test_a_formula_is_set_as_one_in_the_label_of_a_sweep(drawn: Drawings) -> None:
    labels = {"speed": r"$|\omega|$", "x": "$p^2 + q^2$", "D/2T": "$G^2/2T - A_2$",
              "T": "kinetic energy"}  # fmt: skip
    for name, label in labels.items():
        figure = plot(drawn.cases["grown"], kind="curve", variable=name, x="damping.0")
        assert figure.axes[0].get_ylabel().startswith(label), name


@pytest.mark.heyoka
def test_a_map_of_which_no_member_balances_says_so_and_no_more() -> None:
    swept = sweep({
        "model": "torques", "inertia": [3, 2.6, 1], "torque": [0, 0, 0.001], "kappa": 0.005,
        "initial": {"p": 0.15, "q": 0, "r": 2}, "time": {"end": 10},
        "sweep": {"torque.0": {"values": [0.001, 0.002]}, "kappa": {"values": [0.01, 0.02]}},
    })  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = plot(swept, kind="map", variable="G", x="torque.0", y="kappa", theory="turning")
    assert any("nowhere" in text or "no " in text for text in legend_words(figure))


def test_curves_of_one_colour_differ_in_line(drawn: Drawings) -> None:
    """Nine curves are more than there are colours, and a named style may take one."""
    cases = [drawn.cases[name] for name in ("back", "again", "back")]
    keys = {"axes": ["x1", "x2", "x3"], "colour": "case"}
    trace = plot(cases, kind="axis-trace", **keys)
    entries = [x for x in trace.legends[0].get_lines() if str(x.get_label()).startswith("$x_")]
    assert len({(line.get_color(), str(line._dash_pattern)) for line in entries}) == 9
    (dashed,) = (to_hex(line.get_color()) for line in entries if line.is_dashed())
    on_globe = [line for line in trace.axes[0].lines if line.is_dashed()]
    assert dashed in {to_hex(line.get_color()) for line in on_globe}
    # The second colour of the palette is red, and dashed.
    for kind in ("hodograph", "herpolhode"):
        figure = plot(cases[:2], kind=kind, colour="case", styles=["red dashed"])
        entries = [x for x in figure.legends[0].get_lines() if x.get_label() in ("back", "again")]
        assert len({(line.get_color(), str(line._dash_pattern)) for line in entries}) == 2
        curves = [x for x in figure.axes[0].collections if isinstance(x, LineCollection)]
        assert any(curve.get_linestyles()[0][1] for curve in curves)


def test_crossings_of_two_cases_that_lie_together_are_numbered_once(drawn: Drawings) -> None:
    """In a herpolhode, where the numbers of one case fell on those of the other."""
    pair = drawn.draw("across")
    numbers = [text for text in pair.figure.axes[0].texts if text.get_text()[0].isdigit()]
    pair.figure.draw_without_rendering()
    assert numbers
    assert not any(a.overlaps(b) for a, b in combinations(boxes(numbers), 2))


def test_the_level_of_a_map_has_its_unit(drawn: Drawings) -> None:
    middle = float(np.degrees(derive(drawn.cases["tilted"], "theta").theta.mean()))
    assert legend(drawn.draw("angles", level=middle))[0] == f"{middle:g} deg"


def test_a_level_that_no_value_reaches_has_no_line_in_the_legend(drawn: Drawings) -> None:
    for level, number in ((-1, "\N{MINUS SIGN}1"), (1e9, "1e+09")):
        words = legend(drawn.draw("angles", level=level))[0]
        assert words == f"no line where {number} deg is not reached"


def test_numbers_at_logarithmic_ticks_have_room_in_narrow_panels(drawn: Drawings) -> None:
    figure = drawn.draw("narrow").figure
    figure.draw_without_rendering()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            ends = sorted(axis.get_view_interval())
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            inside = [tick.label1 for tick in ticks if ends[0] <= tick.get_loc() <= ends[1]]
            assert len(shown := boxes(inside)) > 1
            assert not any(a.overlaps(b) for a, b in combinations(shown, 2))


def test_a_law_and_its_curve_are_in_the_legend_with_the_time_of_the_axis(drawn: Drawings) -> None:
    assert legend(drawn.draw("law")) == ["round-x1", r"$|G| = \exp(-0.004\cdot \tau)$"]
    law = "-2.5e-3*sqrt(1 + t**2)/G2**(-2) + sin(p)*J"
    factors = r"-2.5\cdot 10^{-3}\cdot \mathrm{sqrt}(1 + \tau^{2})/{G^2}^{-2}"
    words = legend(drawn.draw("law", formula={"G": law}))[1]
    assert words == rf"$|G| = {factors} + \sin({{p}})\cdot {{J}}$"


@pytest.mark.filterwarnings("ignore:.*so that its curve is a polygon:UserWarning")
def test_a_law_of_the_time_is_drawn_once_and_hides_no_curve(drawn: Drawings) -> None:
    """Dashes of two lines that are one law fill each other's gaps."""
    figure = drawn.draw("laws").figure
    in_time, of_each = (
        # Behind the curves of the two cases.
        [np.array(line.get_data()) for line in axes.lines[2:]]
        for axes in figure.axes
    )
    ((t, law),) = in_time
    assert (t[0], t[-1]) == (0, 400)
    assert np.diff(t).max() < 0.5  # smooth where the samples of `late` are few
    np.testing.assert_allclose(law, np.exp(-0.004 * t), rtol=1e-12)
    # A law of other quantities is one of each motion.
    assert [len(t) for t, _ in of_each] == [3001, 5]


@pytest.mark.parametrize("gap", [(0, 1), (1, 3), (2, 3), (0, 3)])
def test_one_curve_without_fractions_takes_no_ticks_from_others(
    drawn: Drawings, gap: tuple[int, int]
) -> None:
    """Whether it is missing or whole numbers: the axis is that of all curves."""
    swept = drawn.cases["grown"]
    values = 0.1 + 0.8 * np.arange(90).reshape(30, 3) / 90
    for no_fractions in (np.nan, 1.0):
        values[:, slice(*gap)] = no_fractions
        shown = swept.assign(mine=(("damping.0", "initial.q"), values))
        if np.isnan(values).all():
            with pytest.raises(HodoError, match=r"has no value of mine to draw"):
                plot(shown, "curve", variable="mine", x="damping.0", by="initial.q")
            continue
        figure = plot(shown, "curve", variable="mine", x="damping.0", by="initial.q")
        figure.draw_without_rendering()
        (axes,) = figure.axes
        low, high = axes.get_ylim()
        ticks = [tick for tick in axes.get_yticks() if low <= tick <= high]
        assert (len(ticks) >= 2) == (gap != (0, 3))


def test_cases_of_one_label_and_curves_of_several_panels_are_in_the_legend(drawn: Drawings) -> None:
    two = {"cases": ("slow", "fast"), "variables": ("G", "T"), "style": {}}
    assert legend(drawn.draw("stops", **two)) == ["slow", "fast", "stopped"]
    assert legend(drawn.draw("stops", **two, labels=("a", "a"))) == ["a", "a", "stopped"]


def test_bodies_on_a_sphere_have_their_separatrices_in_their_colours(drawn: Drawings) -> None:
    sheet = drawn.draw("ball")
    words = ["separatrix of crossing", "separatrix of flat"]
    assert [text for text in legend(sheet) if "separatrix" in text] == words
    names = {text.get_text(): text.get_color() for text in sheet.figure.axes[0].texts}
    lines = {str(line.get_label()): line.get_color() for line in sheet.legend}
    assert lines[words[0]] == names["crossing"] != lines[words[1]] == names["flat"]
    by_axis = legend(drawn.draw("ball", colour="axis"))
    assert {text for text in by_axis if "separatrix" in text} == {*words}
    assert "separatrix, $D = 0$" in legend(drawn.draw("ball", cases=("crossing", "round-x1")))


def test_cases_whose_colours_show_axes_are_named(drawn: Drawings) -> None:
    axes = drawn.draw("ends").figure.axes
    assert len(axes) == 3
    for panel in axes:
        names = [text.get_text() for text in panel.texts]
        assert {"round-x1", "crossing"} <= {*names}
    assert "crossing" not in [text.get_text() for text in drawn.draw("alone").figure.axes[0].texts]


@pytest.mark.parametrize("name", ["times", "lines"])
def test_labels_of_axes_end_within_the_figure_whatever_its_width(
    drawn: Drawings, name: str
) -> None:
    figure = drawn.draw(name, style={"width": 60}).figure
    check_labels(figure)


def check_labels(figure: Any) -> None:
    """Check that the labels of axes are within a figure."""
    figure.draw_without_rendering()
    for axes in figure.axes:
        for label in (axes.xaxis.label, axes.yaxis.label):
            for box in boxes([label]):
                assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
                assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1


@pytest.mark.filterwarnings("ignore:.* bends between its samples")
def test_marks_of_events_between_samples_have_the_values_of_the_events() -> None:
    """A body that stops at 14.53 has no momentum there, and at the separatrix J is A2 and k^2 is 1:
    a line between samples, which bends there, has other values."""
    body = {"model": "torques", "inertia": [1, 0.8, 0.6]}
    made = run(
        {**body, "brake": 0.04, "initial": {"p": 0.2, "q": 0.1, "r": 0.9}, "time": {"end": 100}}
    )
    figure = plot(made, kind="series", variables=["G", "speed"])
    figure.draw_without_rendering()
    for axes in figure.axes:
        (words,) = [text.get_text() for text in axes.texts]
        assert re.search(r"\| = 0\$? at .* = 14.53", words.replace("\n", " ")), words
    made = run(
        {
            **body, "model": "linear-diag", "form": "averaged", "damping": [0.015, 0.004, 0.003],
            "initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 100, "samples": 11},
        }
    )  # fmt: skip
    names, values = ["J", "k2", "D/2T"], [0.8, 1, 0]
    figure = plot(made, kind="series", variables=names, passages=True)
    for axes, value in zip(figure.axes, values, strict=True):
        (mark,) = [line for line in axes.lines if line.get_marker() == "D"]
        assert mark.get_ydata() == pytest.approx([value])


def test_crossings_that_a_legend_numbers_have_their_numbers_in_invariants_too() -> None:
    torque = ["0.05*sin(0.1*t)", "0", "0.06*cos(0.07*t)"]
    made = run(
        {
            "model": "torques", "inertia": [1, 0.8, 0.6], "expression": torque,
            "initial": {"p": 0.3, "q": 0.1, "r": 0.4}, "time": {"end": 150},
        }
    )  # fmt: skip
    figure = plot(made, kind="invariants")
    figure.draw_without_rendering()
    ratio = figure.axes[-1]
    times = {str(i): when for i, when in enumerate(made["crossing_time"].values, 1)}
    numbers = {x.get_text(): x.xy for x in ratio.texts if x.get_text() in times}
    assert {text: place[0] for text, place in numbers.items()} == pytest.approx(times)
    assert "(4)" in "".join(legend_words(figure))


def test_the_mark_of_a_single_sample_is_whole() -> None:
    made = run(
        {
            "model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": 0.01,
            "initial": {"p": 0.3, "q": 0.1, "r": 0.4}, "time": {"end": 30, "samples": 1},
        }
    )  # fmt: skip
    figure = plot(made, kind="series", variables=["G"])
    figure.draw_without_rendering()
    (axes,) = figure.axes
    (mark,) = axes.lines
    assert axes.get_xlim()[0] == mark.get_xdata()[0]
    assert not mark.get_clip_on()


@pytest.mark.filterwarnings("ignore:.* bends between its samples")
def test_a_legend_names_the_curves_and_marks_that_are_seen(drawn: Drawings) -> None:
    """|G| falls from 1 to 0.28 at 300, where `round-x1` ends, and of `late` on to 0.19 at 400,
    without a sample from 90 on."""
    series = {**drawn.figures["laws"], "variables": ["G"], "formula": {}}
    for style, words in (
        ({}, ["round-x1", "late"]),
        ({"xlim": (310, 350)}, ["late"]),
        ({"ylim": (0.9, 1.1)}, ["round-x1", "late"]),
        ({"ylim": (0.98, 1.1)}, ["round-x1"]),
        ({"log": ["x", "y"], "xlim": (310, 350)}, ["late"]),
    ):
        sheet = drawn.draw(series, style=style)
        sheet.figure.draw_without_rendering()
        assert legend(sheet) == words, style
    rest = run(
        {
            "model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": 0.1,
            "initial": {"p": 0, "q": 0, "r": 0}, "time": {"end": 9},
        }
    )  # fmt: skip
    assert legend_words(plot(rest, kind="sphere")) == ["separatrix, $D = 0$"]


def test_a_body_at_rest_has_no_arrows_and_goes_round_no_axis() -> None:
    body = {"inertia": [1, 0.8, 0.6], "initial": {"p": 0.8, "q": 0.1, "r": 0.2}}
    keys = {"model": "torques", "brake": 0.04, "attitude": True, "time": {"end": 40}}
    figure = plot(run({**body, **keys}), kind="body", moments=[0, 30])
    figure.draw_without_rendering()
    turning, resting = ({text.get_text() for text in axes.texts} for axes in figure.axes)
    assert turning - resting == {"$G$", r"$ω$"}
    keys = {"model": "linear-diag", "initial": {"p": 0, "q": 0, "r": 0}, "time": {"end": 40}}
    rest = run({**body, **keys})
    for kind in ("hodograph", "quadrants"):
        assert legend_words(plot(rest, kind=kind)) == ["start", r"end, $\tau = 40$"], kind


def test_quadrants_of_a_body_with_two_smallest_moments_have_no_region_b() -> None:
    """K is 0, and D > 0 wherever the body turns about an axis across the equal ones."""
    body = {"inertia": [0.6, 1, 0.6], "initial": {"p": 0.8, "q": 0.5, "r": 0.7}}
    made = run({**body, "model": "linear-diag", "damping": 0.01, "time": {"end": 100}})
    assert (plot(made, kind="series", variables=["D"]).axes[0].lines[0].get_ydata() > 0).all()
    figure = plot(made, kind="quadrants")
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.texts] == ["A (about $x_2$)"]
    assert len(axes.patches) == 1


def test_times_of_four_and_six_digits_end_without_a_point() -> None:
    body = {"inertia": [1, 0.8, 0.6], "initial": {"p": 0.001, "q": 0.0005, "r": 0.001}}
    stopped = run({**body, "model": "torques", "brake": 4e-7, "time": {"end": 6000}})
    figure = plot(stopped, kind="series", variables=["G"])
    figure.draw_without_rendering()
    (words,) = [text.get_text() for text in figure.axes[0].texts]
    assert words.endswith(f"= {stopped['event_time'].item():.0f}$")
    damped = [5e-6, 4e-6, 3e-6]
    crossing = run({**body, "model": "linear-diag", "damping": damped, "time": {"end": 6e5}})
    (when,) = crossing["crossing_time"].values
    assert 100_000 < when < 1_000_000
    figure = plot(crossing, kind="quadrants")
    assert rf"$D = 0$ at $\tau$ = {when:.0f}" in legend_words(figure)


@pytest.mark.parametrize(("samples", "words"), [(2, "constant .*at 2 samples"), (51, "")])
def test_few_equal_samples_do_not_pass_for_a_constant(samples: int, words: str) -> None:
    """r = 0.01 t - 1: T is 40 at both ends, and 0 between them."""
    made = run(
        {
            "model": "torques", "inertia": [120, 100, 80], "torque": [0, 0, 0.8],
            "initial": {"p": 0, "q": 0, "r": -1}, "time": {"end": 200, "samples": samples},
        }
    )  # fmt: skip
    (panel,) = plot(made, kind="series", variables=["T"]).axes
    (said,) = [text.get_text() for text in panel.texts] or [""]
    assert re.fullmatch(words, said)


def test_the_factor_of_a_colour_scale_is_not_on_its_label() -> None:
    """The times of a motion that takes years, in seconds."""
    data = sweep(
        {
            "model": "linear-diag",
            "inertia": [1, 0.8, 0.6],
            "damping": [5e-9, 4e-9, 3e-9],
            "initial": {"p": 8e-7, "q": 5e-7, "r": 7.4e-7},
            "time": {"end": 1e9, "unit": "s"},
            "sweep": {
                "damping.0": {"linspace": [5e-9, 9e-9, 3]},
                "initial.q": {"values": [0, 5e-7]},
            },
        }
    )
    figure = plot(data, kind="map", variable="crossing_time", x="damping.0", y="initial.q")
    figure.draw_without_rendering()
    axis = figure.axes[-1].xaxis
    factor, label = axis.get_offset_text(), axis.get_label()
    assert "10^{8}" in factor.get_text()
    assert not factor.get_window_extent().overlaps(label.get_window_extent())


@pytest.mark.parametrize("value", [1.0, 0.3, -20.0])
def test_a_map_of_values_that_are_equal_to_rounding_has_one_colour(
    drawn: Drawings, value: float
) -> None:
    grown = drawn.cases["grown"]
    apart = np.random.default_rng(1).integers(-4, 5, grown["crossing_time"].shape)
    figure = plot(
        grown.assign(crossing_time=(grown["crossing_time"].dims, value * (1 + 2e-16 * apart))),
        kind="map", variable="crossing_time", x="damping.0", y="initial.q",
    )  # fmt: skip
    figure.draw_without_rendering()
    panel, bar = figure.axes
    (image,) = panel.collections
    assert len(np.unique(image.get_facecolors(), axis=0)) == 1
    assert [float(text.get_text().replace("\u2212", "-")) for text in bar.get_xticklabels()] == [
        pytest.approx(value)
    ]


@pytest.mark.parametrize(("variable", "value", "ticks"), [
    ("omega.x1", 5.0, [5]), ("omega.x1", 5.5, [5.5]), ("share.x1", 0.25, [0, 0.25, 0.5, 0.75, 1]),
])  # fmt: skip
def test_a_component_that_is_one_number_has_it_on_its_scale(
    drawn: Drawings, variable: str, value: float, ticks: list[float]
) -> None:
    """As a share of the time would have the scale from no to yes."""
    grown, name = drawn.cases["grown"], variable.partition(".")[0]
    same = grown.assign({name: grown["omega"].copy(data=np.full(grown["omega"].shape, value))})
    figure = plot(same, kind="map", variable=variable, x="damping.0", y="initial.q")
    figure.draw_without_rendering()
    _, bar = figure.axes
    shown = [float(text.get_text().replace("\u2212", "-")) for text in bar.get_xticklabels()]
    assert shown == pytest.approx(ticks)


def test_a_map_of_uneven_values_has_logarithmic_axes(drawn: Drawings) -> None:
    """Its edges half way between them, below 0.001 at -0.0035, are none there."""
    uneven = drawn.cases["grown"].isel({"damping.0": [0, 1, 2]})
    uneven = uneven.assign_coords({"damping.0": [0.001, 0.01, 0.0101]})
    keys = {"kind": "map", "variable": "end_axis.x1", "x": "damping.0", "y": "initial.q"}
    figure = plot(uneven, **keys, style={"log": ["x"]})
    figure.draw_without_rendering()
    (mesh,) = figure.axes[0].collections
    np.testing.assert_allclose(
        mesh.get_coordinates()[0, 1:3, 0], [0.001 * 10**0.5, 0.01 * 1.01**0.5]
    )
    with pytest.raises(HodoError, match="reaches below zero"):
        plot(uneven.assign_coords({"damping.0": [-1.0, 1, 2]}), **keys, style={"log": ["x"]})


def test_the_sides_of_the_separatrix_are_named_once(drawn: Drawings) -> None:
    names = [text.get_text() for text in drawn.draw("sides").figure.axes[2].texts]
    assert sorted(names) == ["about $x_1$", "about $x_3$"]


def test_long_names_of_curves_stay_in_their_panel(drawn: Drawings) -> None:
    labels = ("a case with quite a long name", "another one that has no short name")
    figure = drawn.draw("ends", projections=(), zoom=None, labels=labels).figure
    figure.draw_without_rendering()
    (axes,) = figure.axes
    names = [text for text in axes.texts if text.get_text() in labels]
    edges = axes.bbox
    assert len(names) == 2
    for box in boxes(names):
        assert edges.x0 <= box.x0 < box.x1 <= edges.x1


def test_curves_over_a_grown_axis_are_listed_in_order(drawn: Drawings) -> None:
    assert legend(drawn.draw("lines"))[:3] == ["$q = 0.3$", "$q = 0.4$", "$q = 0.5$"]
    # Positions and labels count along the axis as it is stored.
    assert legend(drawn.draw("listed"))[:2] == ["$q = 0.5$", "$q = 0.3$"]
    labelled = drawn.draw("lines", labels=("first",))
    assert legend(labelled)[:3] == ["first", "$q = 0.3$", "$q = 0.4$"]


def test_keys_that_vary_together_are_all_named(drawn: Drawings) -> None:
    keys = {"kind": "curve", "variable": "T", "x": "damping.1", "by": "z"}
    figure = plot(drawn.cases["zipped"], **keys)
    values = ((0.001, 0.005), (0.005, 0.001))
    named = [text.get_text() for box in figure.legends for text in box.get_texts()]
    assert named == [rf"$\lambda_1 = {a}$, $\lambda_3 = {b}$" for a, b in values]
    across = plot(drawn.cases["zipped"], **keys | {"x": "z", "by": "damping.1"}).axes[0]
    assert across.get_xlabel() == r"$\lambda_1$, with $\lambda_3$"
    rows = drawn.draw("together").csv().splitlines()
    assert rows[0] == "curve,damping.1,T,damping.0,damping.2"
    assert rows[1].startswith('"damping.0 = 0.001, damping.2 = 0.005",')
    assert rows[1].endswith(",0.001,0.005")
    rows = drawn.draw("squares").csv()
    assert rows.startswith("curve,damping.0,damping.2,damping.1,T\nzipped,0.001,0.005,0.003,")


def test_crosses_of_members_without_a_value_are_on_no_others(drawn: Drawings) -> None:
    figure = drawn.draw("lines").figure
    figure.draw_without_rendering()
    (axes,) = figure.axes
    rows = [line for line in axes.lines if line.get_marker() == "x" and len(line.get_ydata())]
    assert len(rows) == len({float(np.ravel(line.get_ydata())[0]) for line in rows}) == 3
    for line in rows:
        places = line.get_transform().transform(np.array(line.get_data()).T)[:, 0]
        assert np.diff(places).min() > line.get_markersize() * figure.dpi / 72


def test_crosses_of_many_curves_stand_below_all_values() -> None:
    swept = sweep(
        {
            "model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.005, 0.004, 0.003],
            "initial": {"p": 0.8, "q": 0.5, "G": 1}, "time": {"end": 600},
            "sweep": {
                "damping.0": {"linspace": [0.002, 0.008, 7]},
                "damping.2": {"logspace": [0.001, 0.01, 5]},
            },
        }
    )  # fmt: skip
    keys = {"kind": "curve", "variable": "crossing_time", "x": "damping.0"}
    for more in ({"by": "damping.2"}, {}):
        figure = plot(swept, **keys, **more)
        figure.draw_without_rendering()
        (axes,) = figure.axes
        heights: dict[str, list[float]] = {"x": [], ".": []}
        for line in axes.lines:
            places = line.get_transform().transform(np.array(line.get_data(), dtype=float).T)
            heights[str(line.get_marker())] += places[np.isfinite(places).all(axis=1), 1].tolist()
        half = 2 * figure.dpi / 72  # of a cross, and of a mark
        assert max(heights["x"]) + half < min(heights["."]) - half, more
        # The last curve has crosses alone.
        assert ("$\\lambda_3 = 0.01$" in legend_words(figure)) == bool(more)


def test_a_curve_of_values_that_are_equal_to_rounding_has_their_scale(drawn: Drawings) -> None:
    """Of one value too, whose stated error is as small."""
    grown = drawn.cases["grown"]
    few = grown.isel({"damping.0": [20, 21], "initial.q": [1]})
    few = few.assign(
        crossing_time=(few["crossing_time"].dims, np.full((2, 1), 86.27487730540250)),
        crossing_error=(few["crossing_time"].dims, np.full((2, 1), 5e-12)),
    )
    figure = plot(few, kind="curve", variable="crossing_time", x="damping.0")
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert np.ptp(axes.get_ylim()) == pytest.approx(0.2 * 86.27, rel=1e-3)
    assert all(len(text.get_text()) < 6 for text in axes.get_yticklabels())


def test_an_angle_over_degrees_is_in_degrees(drawn: Drawings) -> None:
    """In the picture and its table; in the result angles are radians, and say so."""
    angle = drawn.cases["tilted"]["initial.theta"]
    assert angle.attrs["units"] == "rad"
    np.testing.assert_allclose(angle, np.radians([30, 60]))
    theta = derive(drawn.cases["tilted"], "theta").theta
    sheet = drawn.draw("angles")
    assert sheet.figure.axes[-1].get_xlabel() == r"$\theta$ [deg]"
    head, *rows = sheet.csv().splitlines()
    assert head == "curve,initial.theta [deg],mu,theta [deg]"
    last = [float(row.rpartition(",")[2]) for row in rows]
    np.testing.assert_allclose(last, np.degrees(theta.values.ravel()), rtol=1e-12)
    curve = drawn.draw("bare")
    assert curve.figure.axes[0].get_ylabel().endswith("[deg]")
    (values,) = [item.values["theta"] for item in curve.shown]
    np.testing.assert_allclose(values, np.degrees(theta.mean("mu")), rtol=1e-12)


IN_SPACE = {"sphere": "x", "axis-trace": "", "hodograph": "G", "body": ""}
"""The kinds of figures in space, and the letter of the names of their axes, if these are of the
body."""


@pytest.mark.parametrize("kind", IN_SPACE)
@pytest.mark.parametrize(
    ("view", "away"),
    [((24, 215), {0, 1}), ((-40, 35), {2}), ((-90, 0), {2}), ((90, 0), set()), ((0, 270), {1})],
)
def test_axes_that_point_away_have_pale_names(
    drawn: Drawings, kind: str, view: tuple[float, float], away: set[int]
) -> None:
    """Else a frame would look like its mirror image. Two axes lie in the page but for rounding
    where the angles are multiples of 90 degrees."""
    figure = plot(drawn.cases["again"], kind=kind, view=view)
    shade = {text.get_text(): text.get_color() for text in figure.axes[0].texts}
    letter = IN_SPACE[kind]
    names = [f"${letter}_{i}$" for i in (1, 2, 3)] if letter else ["$x$", "$y$", "$z$"]
    grey = "black" if kind != "body" else "#666666"
    pale = {i for i, name in enumerate(names) if to_hex(shade[name]) != to_hex(grey)}
    assert pale == away


@pytest.mark.parametrize("elevation", [24, 60, 75, 90, -90])
def test_all_arms_of_a_globe_end_within_the_figure(drawn: Drawings, elevation: float) -> None:
    figure = plot(drawn.cases["again"], kind="sphere", view=(elevation, 0))
    figure.draw_without_rendering()
    panel = figure.axes[0]
    names = [text for text in panel.texts if text.get_text() in ("$x_1$", "$x_2$", "$x_3$")]
    for name in names:
        # The tip and, beyond a tip below the globe, its name.
        low = panel.transData.transform(name.points[0])[1]
        assert panel.bbox.y0 < low
        box = name.get_window_extent()
        assert panel.bbox.y0 <= box.y0
        assert name.points[0][1] > -1 or box.y1 < low


@pytest.mark.parametrize("view", [(0, 0), (90, 0), (0, 90), (-90, 0), (10, 80), (24, 35)])
def test_numbers_of_the_axes_of_a_hodograph_stand_apart(
    drawn: Drawings, view: tuple[float, float]
) -> None:
    """Of an axis that is looked at along it there is none: all would stand at the origin."""
    figure = plot(drawn.cases["round-x1"], kind="hodograph", view=view)
    figure.draw_without_rendering()
    numbers = [text for text in figure.axes[0].texts if re.fullmatch("0\\.[0-9]+", text.get_text())]
    along = [np.divide(text.xy, float(text.get_text())) for text in numbers]
    assert min(np.hypot(*step) for step in along) > 0.5
    assert len({tuple(step.round(6)) for step in along}) == (3 if view == (24, 35) else 2)
    for first, second in combinations(boxes(numbers), 2):
        assert not first.overlaps(second)


@pytest.mark.parametrize(
    ("name", "said"), [("D/2T", "D/2T [kg m^2]"), ("rotation.z", "rotationz [rad]")]
)
def test_a_message_names_an_axis_without_tex(name: str, said: str) -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "inertia_unit": "kg m^2",
            "attitude": "yes", "initial": {"p": 0.1, "q": 0.1, "r": 0.74}}  # fmt: skip
    made = run({**body, "time": {"end": 30, "unit": "s"}})
    with pytest.raises(HodoError, match=f"style.log: the y axis of {re.escape(said)} reaches"):
        plot(made, kind="series", variables=[name], style={"log": "y"})


TURNING = {
    "model": "torques", "inertia": [2, 1.5, 1], "attitude": "yes",
    "initial": {"p": 0.3, "q": 0.7, "r": -0.9},
}  # fmt: skip


def test_a_rotation_vector_that_goes_on_from_its_other_end_leaves_a_gap() -> None:
    made = run(TURNING | {"damping": 0, "time": {"end": 20, "samples": 401}})
    names = ["rotation.x", "rotation.z"]
    series = plot(made, "series", variables=names).axes
    for panel in (*series, *plot(made, "phase", x=names[0], y=names[1]).axes):
        x, y = panel.lines[0].get_data()
        gaps = np.isnan(x)
        assert 0 < gaps.sum() == np.isnan(y).sum() < 9
        # Each gap parts the two samples that lie farther apart than any others.
        steps = np.abs(np.diff(y[~gaps]))
        apart = steps[np.flatnonzero(gaps) - np.arange(gaps.sum()) - 1]
        assert panel is series[0] or apart.min() > 10 * np.median(steps)


def test_colours_by_time_end_where_the_body_comes_to_rest() -> None:
    made = run(TURNING | {"brake": 0.01, "time": {"end": 400, "samples": 4001}})
    stop = float(made.event_time.item())
    assert 100 < stop < 200
    _, bar = plot(made, "hodograph", colour="time").axes
    assert bar.get_xlim() == pytest.approx((0, stop))
    plot(made.sel(time=slice(200, 400)), "sphere", colour="time").draw_without_rendering()


def test_numbers_in_a_legend_have_the_minus_of_ticks(drawn: Drawings) -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.005, 0.004, 0.003],
            "initial": {"p": 0.8, "q": 0.5, "r": 0.74}}  # fmt: skip
    made = run({**body, "time": {"start": -500, "end": 100, "unit": "s"}})
    words = legend_words(plot(made, "hodograph"))
    assert "$D = 0$ at $t$ = \N{MINUS SIGN}194.641 s" in words
    assert not [text for text in words if "-" in text.replace("$t = -", "")]
    level = drawn.draw("times", variable="omega.x3", level=-0.1)
    assert legend(level) == ["\N{MINUS SIGN}0.1"]


def test_the_legend_of_a_map_names_axes_as_others_do(drawn: Drawings) -> None:
    words = legend(drawn.draw("times", variable="end_axis"))
    assert [text.rpartition(": ")[2] for text in words] == ["$x_1$", "$x_3$"]
