"""The Python interface: cases in, datasets out; light until it is used."""

import contextlib
import gc
import json
import math
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import FIG4, ROOT, Hodo
from matplotlib.colors import to_hex

import hodo_cli as api
from hodo_cli import Case, HodoError
from hodo_cli.cases.config import load


def test_the_package_loads_nothing_until_it_is_used() -> None:
    script = (
        "import sys; before = set(sys.modules); import hodo_cli\n"
        "heavy = {'numpy', 'xarray', 'matplotlib', 'h5py', 'heyoka', 'scipy', 'yaml'}\n"
        "assert not heavy & {name for name, module in sys.modules.items() if module}\n"
        "assert {'run', 'sweep', 'open', 'plot', 'Case'} <= set(dir(hodo_cli))\n"
        "hodo_cli.run\n"
        "assert 'xarray' in sys.modules and 'netCDF4' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
    with pytest.raises(AttributeError, match="no attribute 'ran'"):
        _ = api.ran


def test_a_case_gives_what_the_command_stores(hodo: Hodo, tmp_path: Path) -> None:
    config = load(ROOT / "configs" / "paper1.yaml")
    done = hodo("run", ROOT / "configs" / "paper1.yaml", "--case", "fig4", "--quiet")
    assert done.returncode == 0, done.stderr
    assert hodo("classify", "runs/paper1.h5").returncode == 0
    opened = api.open(tmp_path / "runs" / "paper1.h5")
    assert list(opened) == ["fig4"]
    assert opened.attrs["Conventions"] == "CF-1.11"
    stored, ours = opened["fig4"], api.run(config.cases["fig4"])
    assert list(ours.data_vars) == list(stored.data_vars)
    for name, values in stored.data_vars.items():
        np.testing.assert_array_equal(ours[name], values)
        assert ours[name].dims == values.dims
    # The file has a checksum besides, and the run time is another.
    same = {name: stored.attrs[name] for name in ours.attrs}
    assert {**ours.attrs, "run_time": 0} == {**same, "run_time": 0}
    with pytest.raises(KeyError, match="did you mean 'fig4'"):
        opened["fig5"]


def test_listed_times_are_the_samples_of_a_case_and_of_members() -> None:
    every, times = api.run(FIG4), [0, 10, 300, 310, 1000]
    listed = api.run(FIG4 | {"time": {"values": times}})
    assert listed.time.values.tolist() == times
    np.testing.assert_allclose(listed.omega, every.omega.sel(time=times), rtol=0, atol=1e-15)
    assert listed.crossing_time == every.crossing_time
    sweep = {"damping.2": {"values": [0.003, 0.004]}}
    swept = api.sweep(FIG4 | {"time": {"values": times}, "store": "trajectory", "sweep": sweep})
    assert swept.time.values.tolist() == times
    np.testing.assert_allclose(swept.omega[0], listed.omega, rtol=0, atol=1e-12)
    assert '"values": [0.0, 10.0, ' in swept.attrs["case"]


def test_several_cases_give_a_list_and_a_file_that_commands_read(tmp_path, hodo):
    slow = Case.of(FIG4 | {"damping": 0.001}, "slow")
    single = api.run(FIG4)
    for options in ({}, {"jobs": 2}, {"to": tmp_path / "runs" / "mine.h5"}):
        datasets = api.run([FIG4, slow], **options)
        names = [data.attrs["case"].splitlines()[0] for data in datasets]
        assert names == ['name: "case1"', 'name: "slow"']
        xr.testing.assert_equal(datasets[0], single)
        assert datasets[1].attrs["method"] == "exact"
    for command in ("show", "classify", "claims"):
        assert hodo(command, "runs/mine.h5").returncode == 0
    before = (tmp_path / "runs" / "mine.h5").read_bytes()
    # What is there is not integrated again, and what is not named stays where it was.
    again = api.run(slow, to=tmp_path / "runs" / "mine.h5")
    assert again.attrs["run_time"] == datasets[1].attrs["run_time"]
    assert (tmp_path / "runs" / "mine.h5").read_bytes() == before


def test_a_case_added_to_a_result_comes_last_and_takes_nothing_away(tmp_path, hodo):
    figures = {"path": {"kind": "sphere", "cases": "a"}}
    text = json.dumps({"style": {"width": 100}, "cases": {"a": FIG4}, "figures": figures})
    (tmp_path / "a.yaml").write_text(text)
    assert hodo("run", "a.yaml").returncode == 0
    assert hodo("merge", "a.yaml", "--out", "runs/b.h5").returncode == 0
    for name in "ZB":
        api.run(FIG4, name=name, to=tmp_path / "runs" / "b.h5")
    assert list(api.open(tmp_path / "runs" / "b.h5")) == ["a", "Z", "B"]
    done = hodo("plot", "runs/b.h5", "path", "--format", "svg")
    assert done.stdout == f"{Path('runs/figures/b/path.svg')}\n"
    assert 'width="283.4' in (tmp_path / done.stdout.strip()).read_text()[:2000]
    with pytest.raises(HodoError, match=r"a.h5 holds the results of .*a.yaml.*: write elsewhere"):
        api.run(FIG4, to=tmp_path / "runs" / "a.h5")


def test_a_case_that_another_run_adds_after_the_plan_is_kept(tmp_path, monkeypatch):
    path, planned = tmp_path / "a.h5", api.api.run_plans

    def late(*arguments: Any, **options: Any) -> object:
        monkeypatch.undo()
        api.run(FIG4, name="b", to=path)
        return planned(*arguments, **options)

    api.run(FIG4, name="a", to=path)
    monkeypatch.setattr(api.api, "run_plans", late)
    api.run(FIG4, name="c", to=path)
    assert {*api.open(path)} == {"a", "b", "c"}


SHORT = {**FIG4, "time": {"end": 10, "samples": 11}}
RANGES = {"damping.2": {"values": [0.003, 0.007]}, "damping.0": {"values": [0.005, 0.006]}}
WRONG: list[tuple[Callable[..., object], Any, dict[str, Any], str]] = [
    (api.run, FIG4 | {"damping": [1, 2]}, {}, "damping: expected 3 numbers or one for all, got a "),
    (api.run, FIG4 | {"damping": 1 + 2j}, {}, "damping: expected a finite number, got (1+2j)"),
    (api.run, FIG4 | {"damping": len}, {}, "damping: expected a finite number, got <built-in func"),
    (Case.of, FIG4 | {"damping": np.clongdouble(1)}, {}, "damping: expected a finite number, got "),
    (Case.of, FIG4 | {"dampin": 1}, {}, "dampin: unknown key; did you mean 'damping'?"),
    (api.run, {**FIG4, 5: 1}, {}, "5: unknown key"),
    (api.run, {}, {}, "missing 'model', 'time'"),
    (api.run, FIG4 | {"sweep": RANGES}, {}, "sweep: this case is a sweep: use hodo.sweep"),
    (api.sweep, FIG4, {}, "sweep: missing: use hodo.run for a single case"),
    (api.run, [FIG4], {"to": "mine.nc"}, "to: expected a name that ends with .h5, got 'mine.nc'"),
    *((api.run, [FIG4], {"jobs": jobs}, f"jobs: expected a whole number >= 1, got {shown}")
      for jobs, shown in ((0, "0"), (-1, "-1"), ("2", "'2'"), (1.5, "1.5"), (True, "true"))),
    *((api.run, FIG4, {"classify": value}, "classify: expected True or False, got")
      for value in (7, "no", None, np.float64(1))),
    (api.run, [FIG4, 3], {}, "expected a Case or a mapping of its keys to values, got 3"),
    (api.run, 3, {}, "expected a Case or a mapping of its keys to values, got 3"),
    (api.run, "mine.yaml", {}, "expected a Case or a mapping of its keys to values, got 'mine.y"),
    (api.run, [Case.of(FIG4), Case.of(FIG4)], {}, "two of the cases have one name"),
    (api.Case, FIG4, {}, "Case.of makes a case of a mapping"),
    *((api.plot, data, {}, "expected a dataset or several, as run gives them, got")
      for data in (3, [3], [])),
]  # fmt: skip
"""Functions, their argument and options, and how the error begins."""


@pytest.mark.parametrize(("function", "given", "options", "words"), WRONG)
def test_a_wrong_argument_is_one_line(function, given, options, words):
    with pytest.raises(HodoError) as raised:
        function(given, **options)
    assert str(raised.value).startswith(words)
    assert "\n" not in str(raised.value)


def test_numbers_of_numpy_and_of_all_precisions_are_numbers() -> None:
    ranges = {"sweep": {"damping.0": {"values": range(3)}}}
    assert Case.of(FIG4 | ranges).sweep == {"damping.0": {"values": (0.0, 1.0, 2.0)}}
    for dtype in (np.longdouble, np.float32, np.float16, np.int8):
        moments = np.array([3, 2.5, 2], dtype=dtype)
        case = Case.of(FIG4 | {"inertia": moments, "damping": dtype(1)})
        assert case == Case.of(FIG4 | {"inertia": moments.astype(float).tolist(), "damping": 1.0})
    given = SHORT | {"damping": np.array([0.005, 0.004, 0.003])}
    (made,) = api.run([given], classify=np.False_, jobs=np.int64(1))  # type: ignore[call-overload]
    assert "enclosed_axis" not in made
    assert made.identical(made)
    np.testing.assert_array_equal(made.omega, api.run(SHORT).omega)
    assert api.sweep(SHORT | {"sweep": RANGES}, jobs=np.int8(1)).sizes["damping.2"] == 2  # type: ignore[arg-type]
    assert api.run([]) == []


def test_what_is_below_the_smallest_double_is_0_whatever_the_user_has_set() -> None:
    keys = {"damping": [0.5, 0.4, 0.3], "time": {"end": 3000, "samples": 301}, "error": "off"}
    usual = api.run(case := FIG4 | keys)
    with np.errstate(under="raise"):
        motion = api.run(case)
        swept = api.sweep(case | {"sweep": {"damping.0": {"values": [0.5, 0.6]}}})
        assert not api.derive(motion, "T")["T"].values[-1]
    np.testing.assert_array_equal(motion.omega, usual.omega)
    assert swept.status.values.tolist() == [0, 0]


def test_a_figure_is_drawn_of_datasets() -> None:
    made = api.run(FIG4)
    figure = api.plot([made, made], kind="series", variables=["T"], labels=["one", "two"])
    (axes,) = figure.axes
    omega = made.omega.values
    for line in axes.lines:
        drawn = np.interp(made.time, line.get_xdata(), line.get_ydata())
        np.testing.assert_allclose(drawn, (omega**2 @ [1, 0.8, 0.6]) / 2, rtol=1e-12)
    assert figure._repr_png_().startswith(b"\x89PNG")
    bare = made.drop_vars([name for name in made if "axis" in str(name) or "cross" in str(name)])
    for kind in ("hodograph", "quadrants"):
        assert "not classified" in words_of(api.plot(bare, kind=kind))
    with pytest.raises(HodoError, match=r"^the case: its attributes hold no case"):
        api.derive(made.drop_attrs(), "T")


def words_of(figure: Any) -> list[str]:
    """The words in the legend of a figure."""
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.heyoka
def test_the_examples_of_the_docs_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    api.run(FIG4, name="fig4", to="runs/paper1.h5")
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    text = text.replace("0.007, 9]", "0.007, 3]").replace("0.01, 5]", "0.01, 2]")
    made: dict[str, Any] = {}
    exec("".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL)), made)
    assert made["motion"].crossing_time.item() == pytest.approx(305.358955, abs=1e-6)
    assert (tmp_path / "flip.gif").stat().st_size > 10_000


@pytest.mark.heyoka
def test_curves_of_a_sweep_show_its_values() -> None:
    ranges = {"damping.2": {"linspace": [0.003, 0.007, 5]}, "damping.0": {"values": [0.005, 0.006]}}
    made = api.sweep({**FIG4, "sweep": ranges})
    figure = api.plot(made, kind="curve", variable="crossing_time", x="damping.2", by="damping.0")
    (axes,) = figure.axes
    curves = [line for line in axes.lines if not str(line.get_label()).startswith("_")]
    assert [line.get_label() for line in curves] == [rf"$\lambda_1 = 0.00{i}$" for i in (5, 6)]
    assert np.isnan(made.crossing_time.values).any()
    for i, line in enumerate(curves):
        np.testing.assert_array_equal(line.get_ydata(), made.crossing_time.values[:, i])
    over = {"variable": "crossing_time", "x": "damping.2", "y": "damping.0"}
    assert words_of(api.plot(made, kind="map", **over)) == ["no crossing"]
    mean = api.plot(made, kind="curve", variable="crossing_G", x="damping.2").axes[0]
    said = mean.get_ylabel().replace("\n", " ")
    assert said == r"$|G|$ at $\tau_1$, mean over damping.0 [–]"
    several = api.plot([made, made], kind="curve", variable="end_axis.x1", x="damping.2")
    shares = (made.end_axis == 1).mean("damping.0").values
    for line in several.axes[0].lines:
        np.testing.assert_allclose(line.get_ydata(), shares)
    # Colours of labels are those of the axes, and named.
    (legend,) = (figure := api.plot(made, "map", **over | {"variable": "end_axis"})).legends
    assert {*made.end_axis.values.flat} == {1, 3}
    enclosed = "axis that the hodograph encloses at the end"
    assert words_of(figure) == [f"{enclosed}: $x_{axis}$" for axis in (1, 3)]
    shown = [to_hex(handle.get_facecolor()) for handle in legend.legend_handles]
    assert shown == ["#0072b2", "#bf8200"]
    (cells,) = figure.axes[0].collections
    cells.update_scalarmappable()
    assert {*map(to_hex, cells.get_facecolor())} == {*shown}


@pytest.mark.heyoka
def test_keys_of_a_figure_that_do_not_fit_each_other_are_refused() -> None:
    """As they are in a case file, and before anything is drawn."""
    made, swept = api.run(SHORT, classify=False), api.sweep({**FIG4, "sweep": RANGES})
    across = {"kind": "curve", "variable": "crossing_time", "x": "damping.2"}
    for data, keys, message in (
        (swept, {**across, "kind": "map", "y": "damping.2"}, "y: damping.2 is the axis of"),
        (swept, {**across, "kind": "map"}, "missing 'y': a map has x and y"),
        (swept, {"kind": "curve", "variable": "crossing_time"}, "missing 'x'"),
        (swept, {**across, "x": "damping.1"},
         "sweep sweep has no axis damping.1 (its axes: damping.2, damping.0"),
        (swept, {**across, "by": "damping.0", "at": [2]},
         "the sweep has no position 2 on an axis 'damping.0'"),
        (swept, {**across, "variable": "nothing"}, "the sweep has no variable 'nothing' (it has: "),
        (swept, {**across, "variable": "end_axis"}, "end_axis is a label, without a mean: name a "),
        (made, {"labels": ["a", "b"]}, "labels: expected one for each of the cases, 1 in all, got"),
        (made, {"kind": "series", "variables": ["G"], "span": [3, 2]}, "span: expected the lower"),
        (made, {"kind": "series", "variables": ["Gz"]}, "the case has no gamma, which Gz needs"),
        (made, {"kind": "hodograf"}, "kind: expected "),
        (made, {"color": "axis"}, "color: unknown key; did you mean 'colour'"),
    ):  # fmt: skip
        with pytest.raises(HodoError, match=f"^{re.escape(message)}"):
            api.plot(data, **keys)


def test_ranges_of_an_angle_may_be_in_degrees() -> None:
    top = {"model": "Lagrange-averaged", "inertia": {"A": 1.5, "C": 1}, "mu": 0.5, "a": 0, "b": 0}
    top |= {"initial": {"theta": "60 deg", "r": 2}, "time": {"end": 0.1}}
    ranges = {"initial.theta": {"linspace": ["30 deg", "60 deg", 3]}}
    made = api.sweep({**top, "sweep": ranges})
    assert made["initial.theta"].values == pytest.approx(np.radians([30, 45, 60]), rel=1e-15)
    for value, said in (("5 deg", "only angles and angular velocities are"), ("five", "expected")):
        with pytest.raises(HodoError, match=said):
            api.sweep({**FIG4, "sweep": {"damping.2": {"values": [value]}}})


@pytest.mark.heyoka
@pytest.mark.parametrize("given", ["script.py", "-"])
def test_processes_do_not_run_the_script_that_starts_them(tmp_path: Path, given: str) -> None:
    script = f"""
import hodo_cli as hodo
print("once", flush=True)
ranges = {{"damping.2": {{"values": [0.003, 0.007]}}}}
made = hodo.sweep({{**{FIG4}, "error": "off", "sweep": ranges}}, jobs=2)
print(made.crossings.values.tolist(), flush=True)
"""
    (tmp_path / "script.py").write_text(script)
    streams = {"input": script, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, given], cwd=tmp_path, **streams)
    assert done.stdout == "once\n[1, 0]\n", done.stderr


@pytest.mark.parametrize("method", ["auto", "DOP853"])
def test_threads_get_the_numbers_that_one_gets(method: str) -> None:
    """To the last bit, of cases that one integrator serves; the process still shows warnings."""
    time = {"end": 100 if method == "auto" else 10, "samples": 101}
    drag = {"model": "torques", "space_torque": {"size": 0.02, "direction": [0, 0, 1]}}
    case = {**FIG4, **drag, "attitude": {"align": "G"}, "method": method, "time": time}
    cases = [{**case, "damping": [0.0001 * i, 0.002, 0.0005]} for i in range(1, 6)]
    with ThreadPoolExecutor(6) as threads:
        together = [*threads.map(api.run, cases)]
    assert ("ignore", None, Warning, None, 0) not in warnings.filters
    for ours, expected in zip(together, map(api.run, cases), strict=True):
        assert (ours.attrs["status"], ours.attrs["error"]) == ("ok", expected.attrs["error"])
        np.testing.assert_array_equal(ours.omega, expected.omega)
        np.testing.assert_array_equal(ours.enclosed_axis, expected.enclosed_axis)


VALUES = [None, 3, 2.5, True, "x", b"x", ["x"], [], {}, {"x": 1}, {1: 2}, Path("x"), object(), (),
          np.zeros(3), math.nan, 1j, {"x"}, iter([1]), len, "\ud800", "a\0b"]  # fmt: skip
SERIES = {"kind": "series", "variables": ["G"], "labels": ["a"], "span": [0, 1], "title": "a",
          "panels": "variable", "style": {"width": 80}, "styles": ["blue"]}  # fmt: skip


@pytest.mark.parametrize("function", ["of", "run", "sweep", "open", "plot", "derive"])
def test_an_argument_of_a_wrong_type_is_one_error(function: str, tmp_path: Path) -> None:
    """Whatever it is: of every argument of every public function."""
    case = FIG4 | {"time": {"end": 1, "samples": 3}}
    data = api.run(case)
    swept = case | {"sweep": {"damping.2": {"values": [0.1]}}}
    arguments: dict[str, tuple[Callable[..., object], dict[str, Any]]] = {
        "of": (Case.of, {"entries": case, "name": "a"}),
        "run": (api.run, {"case": case, "name": "a", "classify": True, "jobs": 1, "to": None}),
        "sweep": (api.sweep, {"case": swept, "name": "a", "jobs": 1}),
        "open": (api.open, {"path": tmp_path / "a.h5"}),
        "plot": (api.plot, {"data": data} | SERIES),
        "derive": (lambda data, name: api.derive(data, name), {"data": data, "name": "T"}),
    }
    call, given = arguments[function]
    with contextlib.chdir(tmp_path):
        for name in given:
            for value in [*VALUES, data, [data]]:
                with contextlib.suppress(HodoError):
                    call(**{**given, name: value})


@pytest.mark.parametrize(
    ("times", "given"),
    [(2, {}), (-1, {"damping": 0.01, "model": "torques"}), (0.5, {"inertia": [3, 5, 4]})],
)
def test_labels_of_another_motion_are_refused(times: float, given: dict[str, Any]) -> None:
    data = api.run({**FIG4, "time": {"end": 100}, **given})
    api.plot(data, "hodograph")
    api.plot(data.assign(omega=times * data.omega), "hodograph")
    with pytest.raises(HodoError, match="after arithmetic with a whole dataset"):
        api.plot(data * times, "hodograph")


def test_the_times_of_a_motion_are_not_kept() -> None:
    """A notebook may integrate thousands of cases with millions of times each."""
    api.run({**FIG4, "time": {"values": [i / 1000 for i in range(12345)]}})
    gc.collect()
    cases = [x for x in gc.get_objects() if isinstance(x, Case)]
    assert not any(case.time.values and len(case.time.values) == 12345 for case in cases)
