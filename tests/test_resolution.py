"""A curve through too few samples is said to be a polygon, and a fine one is not."""

import json
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, call, call_apart
from drawings import Drawings

import hodo_cli
from hodo_cli import Case
from hodo_cli.cases.config import load

BODY = "{model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003], "
STARTS = {
    "fast": ("initial: {p: 8, q: 5, r: 7.4}", 1000, 1001),
    # The samples that the remark on `fast` asks for.
    "fine": ("initial: {p: 8, q: 5, r: 7.4}", 1000, 27741),
    "slow": ("initial: {p: 0.08, q: 0.05, r: 0.074}", 1000, 1001),
    # A sample in every turn or so, through which a smooth curve can be drawn.
    "aliased": ("initial: {p: 0.8, q: 0.5, r: 0.74}", 400, 20),
    "few": ("initial: {p: 0.8, q: 0.5, r: 0.74}", 1000, 4),
    "pair": ("initial: {p: 0.8, q: 0.5, r: 0.74}", 1000, 2),
    "steady": ("initial: {p: 8, q: 0, r: 0}", 1000, 101),
}
FIGURES = """
  {0}-space: {{kind: hodograph, cases: [{0}], colour: case, caption: A body.}}
  {0}-time: {{kind: series, cases: [{0}], variables: [q, G.x3]}}
  {0}-mean: {{kind: series, cases: [{0}], variables: [G, T]}}
"""


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """The folder of the figures, and what was said of each by its name."""
    folder = tmp_path_factory.mktemp("drawn")
    cases = "".join(
        f"  {name}: {BODY}{start}, error: off, time: {{end: {end}, samples: {samples}}}}}\n"
        for name, (start, end, samples) in STARTS.items()
    )
    figures = "".join(FIGURES.format(name) for name in ("fast", "fine"))
    text = f"cases:\n{cases}figures:{figures}"
    (folder / "m.yaml").write_text(text, encoding="utf-8")
    assert call(folder, "run", "m.yaml", "--quiet").returncode == 0
    done = {
        name: call(folder, "plot", "runs/m.h5", name, "--format", "svg").stderr
        for name in ("fast-space", "fast-time", "fast-mean", "fine-space", "fine-time")
    }
    assert call(folder, "classify", "runs/m.h5").returncode == 0
    return folder, done


def is_polygon(data: Any, kind: str, **keys: Any) -> bool:
    """Whether a warning says so of a figure."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        hodo_cli.plot(data, kind, **keys)
    return any("polygon" in str(warning.message) for warning in caught)


def test_a_polygon_is_said_to_be_one_in_a_line_and_in_the_caption(
    drawn: tuple[Path, dict[str, str]],
) -> None:
    folder, said = drawn
    line = next(line for line in said["fast-space"].splitlines() if "polygon" in line)
    assert re.search(r"fast turns by up to 277° .*: time: \{samples: 27741\} draws it$", line)
    assert "polygon" in said["fast-time"]
    assert "polygon" not in said["fast-mean"] + said["fine-space"] + said["fine-time"]
    assert call(folder, "plot", "runs/m.h5", "--format", "svg").returncode == 0
    page = (folder / "runs" / "figures" / "index.html").read_text(encoding="utf-8")
    assert page.count("its curve is a polygon") >= 2
    figures = folder / "runs" / "figures" / "m"
    assert "A body. fast turns by up to" in (figures / "fast-space.svg").read_text("utf-8")
    assert "polygon" not in (figures / "fine-space.svg").read_text("utf-8")


@pytest.mark.parametrize(
    ("name", "kind", "variables", "coarse"),
    [
        ("slow", "hodograph", (), False),
        ("steady", "hodograph", (), False),
        ("aliased", "hodograph", (), True),
        ("aliased", "sphere", (), True),
        ("aliased", "quadrants", (), True),
        ("aliased", "series", ("p",), True),
        ("aliased", "series", ("T", "G"), False),
        ("few", "series", ("T", "G"), True),
        ("few", "series", ("G.x1",), True),
        ("pair", "series", ("T",), False),
    ],
)
def test_what_counts_is_the_turning_between_samples(
    drawn: tuple[Path, dict[str, str]],
    name: str,
    kind: str,
    variables: tuple[str, ...],
    coarse: bool,
) -> None:
    data = hodo_cli.open(drawn[0] / "runs" / "m.h5")[name]
    assert is_polygon(data, kind, **({"variables": [*variables]} if variables else {})) is coarse


def test_marks_of_d_are_at_0_and_a_single_sample_is_seen() -> None:
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.005, 0.004, 0.003],
            "initial": {"p": 0.8, "q": 0.5, "r": 0.74}}  # fmt: skip
    thin = hodo_cli.run({**body, "time": {"end": 1000, "samples": 4}})
    single = hodo_cli.run({**body, "time": {"end": 1000, "samples": 1}})
    variables = ["D", "D/2T", "separatrix_distance", "G"]
    with warnings.catch_warnings(record=True):
        figure = hodo_cli.plot([thin, single], "series", variables=variables, passages="yes")
    for panel, name in zip(figure.axes, variables, strict=True):
        line, marks, dot, _ = panel.lines
        assert dot.get_marker() == "o"
        assert line.get_marker() == ""
        assert len(marks.get_ydata()) == 1
        assert (marks.get_ydata()[0] == 0) == (name != "G")


@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0, 1e3])
@pytest.mark.parametrize(
    "body",
    [
        "model: linear-diag, inertia: [1, 0.8, 0.6]",
        "model: linear-diag, inertia: [0.6, 1, 0.9], damping: [0.005, 0.004, 0.003]",
        "model: tensor, inertia: [8, 8, 4], resistance: {diagonal: 0.003, off_diagonal: 0.001}",
        "model: torques, inertia: [1e-9, 9e-10, 3e-10], damping: 0.004",
    ],
)
def test_samples_that_nobody_names_follow_the_motion(
    tmp_path: Path, body: str, speed: float
) -> None:
    start = f"initial: {{p: {0.8 * speed}, q: {0.5 * speed}, r: {-0.74 * speed}}}"
    end = 1000 / max(speed, 10)
    case = f"{{{body}, {start}, error: off, time: {{end: {end}}}}}"
    (tmp_path / "m.yaml").write_text(f"cases: {{a: {case}}}", encoding="utf-8")
    assert call(tmp_path, "run", "m.yaml", "--quiet").returncode == 0
    data = hodo_cli.open(tmp_path / "runs" / "m.h5")["a"]
    assert not is_polygon(data, "hodograph", colour="case")
    assert f"samples: {data.time.size}, " in data.attrs["case"]
    assert data.time.size <= 50_001


@pytest.mark.parametrize(("samples", "coarse"), [(201, True), (20_001, False)])
def test_a_top_turns_in_the_time_of_which_its_rates_are(samples: int, coarse: bool) -> None:
    top = {
        "model": "Lagrange-averaged", "form": "full", "inertia": {"A": 1.5, "C": 1}, "mu": 0.5,
        "a": 0.1, "b": 0.1, "epsilon": 0.001, "initial": {"theta": 1, "r": 2}, "attitude": "yes",
    }  # fmt: skip
    motion = hodo_cli.run(top | {"time": {"end": 1, "samples": samples}})
    assert is_polygon(motion, "axis-trace") is coarse
    assert is_polygon(motion, "series", variables=["psi"]) is coarse


def test_a_thinned_motion_is_a_polygon() -> None:
    cases = hodo_cli.open(ROOT / "runs" / "reference" / "paper1.h5")
    spec = load(ROOT / "configs" / "paper1.yaml").figure("fig4")
    assert is_polygon([cases[name] for name in spec["cases"]], spec["kind"])


@pytest.mark.parametrize("size", [2.0**-40, 8.0, 2.0**40])
def test_default_samples_are_as_many_in_all_units_of_mass(size: float) -> None:
    """Of bodies that turn fastest about their largest or about their smallest moment."""

    def samples(moments: list[float]) -> int:
        case = {"model": "linear-diag", "inertia": moments, "damping": 0.01}
        start = {"initial": {"p": 8, "q": 5, "r": 7.4}, "time": {"end": 200}}
        return Case.of(case | start).time.samples

    for moments in ([1, 0.8, 0.6], [1, 0.95, 0.3], [1, 0.55, 0.5]):
        assert samples([size * A for A in moments]) == samples(moments) > 1001


def test_default_samples_follow_a_body_in_space() -> None:
    """Where its herpolhode fills a figure, a corner of 12 degrees is seen."""
    case = {
        "model": "linear-diag", "inertia": [12.4, 9.1, 5.3], "damping": 0,
        "initial": {"p": 0.6, "q": 0.5, "r": 0.9}, "time": {"end": 200},
    }  # fmt: skip
    motion = hodo_cli.run(case | {"attitude": "yes"})
    speed = np.linalg.norm(motion.omega, axis=-1).max()
    assert np.degrees(speed * np.diff(motion.time).max()) < 6
    assert Case.of(case).time.samples < motion.sizes["time"]


@pytest.mark.parametrize("pairs", [False, True])
def test_a_slow_quantity_that_bends_between_samples_is_said_to(pairs: bool) -> None:
    # T falls like exp(-t) from one sample to the next, wherever another one stands beside each.
    times = np.linspace(0, 40, 9)
    if pairs:
        times = np.sort(np.concatenate((times, times[:-1] + 1e-3)))
    case = {
        "model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.1, 0.08, 0.06],
        "initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"values": times.tolist()},
    }  # fmt: skip
    with pytest.warns(UserWarning, match="T of case bends between its samples"):
        hodo_cli.plot(hodo_cli.run(case), kind="series", variables=["T", "enclosed_axis"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hodo_cli.plot(hodo_cli.run(case), kind="series", variables=["enclosed_axis"])


@pytest.mark.parametrize("known", ["late", "early", "ends", "none", "finite"])
def test_what_is_no_number_is_a_gap_in_a_curve_over_time(
    drawn: tuple[Path, dict[str, str]], known: str
) -> None:
    data = hodo_cli.open(drawn[0] / "runs" / "m.h5")["fine"]
    time, p = data.time, data.omega[:, 0]
    kept = {"late": time > 500, "early": time < 800, "ends": abs(time - 500) > 10}
    mine = p.where(kept.get(known, time < 0), np.inf if known == "finite" else np.nan)
    data = data.assign(mine=mine, flat=0 * mine + 1)
    for kind, keys in (
        ("series", {"variables": ["mine", "flat"]}),
        ("phase", {"x": "mine", "y": "q"}),
        ("phase", {"x": "time", "y": "flat"}),
    ):
        assert not is_polygon(data, kind, **keys)


@pytest.mark.parametrize("kind", ["hodograph", "sphere", "quadrants", "invariants"])
def test_a_sample_that_is_no_number_has_no_place_on_a_hodograph(
    drawn: tuple[Path, dict[str, str]], kind: str
) -> None:
    data = hodo_cli.open(drawn[0] / "runs" / "m.h5")["slow"]
    for missing in (data.time < 3, data.time > 997, data.time == 500, data.time >= 0):
        gaps = data.assign(omega=data.omega.where(~missing))
        first = f"{float(data.time[missing][0]):g}"
        with pytest.raises(hodo_cli.HodoError, match=rf"omega of .* is no number at {first}: "):
            hodo_cli.plot(gaps, kind)
        if (~missing).any():
            hodo_cli.plot(gaps.dropna("time"), kind)


FAST = "20*3.14159265358979*0.5*cos(20*3.14159265358979*t)"


@pytest.mark.parametrize(
    ("formula", "end", "samples", "variables", "coarse"),
    [
        # r oscillates between 0.5 and 1.5, with a sample in each period, at one phase or another.
        (FAST, 10, 101, ["r"], True),
        (FAST, 10, 101, ["T", "G"], True),
        (FAST, 10, 138, ["omega.x3"], True),
        (FAST, 10, 3601, ["r", "G"], False),
        # A component that no torque turns is a line between its samples.
        (FAST, 10, 101, ["p"], False),
        ("0.02*cos(0.2*t)", 10, 101, ["r", "T"], False),
        # A pulse is a jump for the eye, also between two samples.
        ("0.5*exp(-900*(t - 4.71)**2)", 10, 201, ["r"], False),
        ("-0.01*r", 10, 101, ["r"], False),
    ],
)
def test_a_torque_that_changes_between_the_samples_is_seen(
    formula: str, end: float, samples: int, variables: list[str], coarse: bool
) -> None:
    case = {"model": "torques", "inertia": [2, 1.5, 1], "expression": ["0", "0", formula],
            "initial": {"p": 0, "q": 0, "r": 1}, "error": "off"}  # fmt: skip
    data = hodo_cli.run({**case, "time": {"end": end, "samples": samples}})
    assert is_polygon(data, "series", variables=variables) is coarse
    if variables == ["r"]:
        assert is_polygon(data, "hodograph", colour="case") is coarse
        assert is_polygon(data, "series", variables=["r"], span=[2, 8]) is coarse


def test_what_changes_beside_or_without_a_body_is_seen(tmp_path: Path) -> None:
    """With a sample in each period; of a model of one's own whose state is more, or is no body."""
    law = "depth: 0.5, rate: 62.83185307179586, time: {end: 10, samples: 101}"
    (tmp_path / "c.yaml").write_text(
        f"""\
cases:
  driven: {{model: driven, inertia: [2, 1.5, 1], initial: {{p: 0, q: 0, r: 1}}, {law}}}
  swing: {{model: swing, initial: 1, {law}}}
figures:
  driven-s: {{kind: series, cases: driven, variables: s}}
  driven-r: {{kind: series, cases: driven, variables: r}}
  swing-u: {{kind: series, cases: swing, variables: u}}
  swing-v: {{kind: series, cases: swing, variables: v}}
  swing-both: {{kind: phase, cases: swing, x: u, y: v}}
"""
    )
    own = "--models", ROOT / "tests" / "own_models" / "waving.py"
    assert call_apart(tmp_path, *own, "run", "c.yaml").returncode == 0
    for figure, is_seen in {"driven-s": True, "driven-r": False, "swing-v": False,
                            "swing-u": True, "swing-both": True}.items():  # fmt: skip
        done = call_apart(tmp_path, *own, "plot", "c.yaml", figure, "--format", "csv")
        assert done.returncode == 0, done.stderr
        assert ("changes with the time between its samples" in done.stderr) is is_seen, figure


WITHOUT_VALUES = """
defaults: {model: linear-diag, inertia: [1.6, 1, 0.7]}
cases:
  few: {attitude: {align: G}, initial: {p: 1, q: 2, r: 0.3}, time: {end: 60, samples: 40}}
  enough: {attitude: {align: G}, initial: {p: 1, q: 2, r: 0.3}, time: {end: 60, samples: 823}}
  upright: {attitude: yes, initial: {p: 0, q: 0, r: 1}, time: {end: 10}}
figures:
  few: {kind: series, cases: [few], variables: [psi, phi]}
  upright: {kind: series, cases: [upright], variables: [psi, theta]}
  path: {kind: phase, cases: [upright], x: psi, y: theta}
  both: {kind: series, cases: [few, enough], variables: [psi]}
claims:
  - {id: a, where: b, statement: psi rises, cases: [few], expect: reproduced,
     check: {kind: monotone, of: [psi], sense: rises}}
"""


def test_what_has_no_value_says_why_and_what_would_give_it_one(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(WITHOUT_VALUES, encoding="utf-8")
    assert call(tmp_path, "run", "m.yaml").returncode == 0
    assert call(tmp_path, "classify", "m.yaml").returncode == 0
    turn = (
        "few turns by up to 211° from one sample to the next, so that its curve is a polygon: "
        "time: {samples: 823} draws it"
    )
    few, upright = (
        f"psi of case few is no number at 1.53846: {turn}",
        "psi of case upright is no number at 0: theta is 0 or pi there",
    )
    said = f"phi of case few is no number at 1.53846: {turn}", few, upright
    plotted = call(tmp_path, "plot", "m.yaml")
    assert sorted(plotted.stderr.splitlines()) == [f"no curve: {words}" for words in said]
    drawings = Drawings.of(tmp_path / "runs" / "m.h5")
    for name, panel, words in (("few", 0, few), ("upright", 0, upright), ("path", 0, upright)):
        with warnings.catch_warnings(record=True):
            axes = drawings.draw(name).figure.axes[panel]
        assert f"no curve: {words}" in [" ".join(x.get_text().split()) for x in axes.texts]
        assert not len(axes.get_yticks())
    with warnings.catch_warnings(record=True):
        (both,) = drawings.draw("both").figure.axes
    assert not both.texts
    assert len(both.get_yticks())
    (row,) = json.loads(call(tmp_path, "claims", "m.yaml", "--json").stdout)["statements"]
    assert (row["verdict"], row["evidence"]) == ("not tested", few)
