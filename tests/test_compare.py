"""Comparing results: every difference is found; the stored reference is right."""

import csv
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import series
import xarray as xr
from conftest import ROOT, call

import hodo_cli
from hodo_cli.cases.case import parse_case
from hodo_cli.cases.config import load

pytestmark = pytest.mark.filterwarnings("ignore:.*has no checksum:UserWarning")
REFERENCE = ROOT / "runs" / "reference"

BODY = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}"
CONFIG = f"""
cases:
  damped: {{{BODY}, damping: [0.05, 0.04, 0.03], time: {{end: 60, samples: 61, unit: s}}}}
  free: {{{BODY}, time: {{end: 10, samples: 11}}}}
  spun: {{model: cavity+constant, inertia: [8, 8, 4], kappa: 0.1, epsilon: 1, form: averaged,
          torque: [0, 0, -0.1], initial: {{x: 1, y: 1}}, time: {{end: 60, samples: 31}}}}
  swept: {{{BODY}, damping: [0.05, 0.04, 0.03], time: {{end: 60}},
           sweep: {{damping.0: {{values: [0.03, 0.05, 0.06]}}}}}}
"""

OTHER = f"cases: {{b: {{{BODY}, time: {{end: 1}}}}}}"
Row = dict[str, Any]
Change = Callable[[h5py.File], object]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a result, which is labelled."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "c.yaml").write_text(CONFIG, encoding="utf-8")
    for command in ("run", "classify"):
        assert call(folder, command, "c.yaml").returncode == 0
    return folder


def compared(made: Path, change: Change, *options: str, reference: Change = len) -> list[Row]:
    """The lines of `hodo compare --json` for the result, changed, against itself, changed too."""
    for name, of_file in (("a.h5", change), ("b.h5", reference)):
        shutil.copy(made / "runs" / "c.h5", made / name)
        with h5py.File(made / name, "r+") as file:
            of_file(file)
    done = call(made, "compare", "a.h5", "b.h5", "--json", *options)
    rows = json.loads(done.stdout)
    assert done.returncode == (3 if differing(rows) else 0)
    return list(rows)


def differing(rows: list[Row]) -> list[tuple[str, str]]:
    return [(row["case"], row["variable"]) for row in rows if row["differs"]]


def shifted(path: str, at: Any, by: float) -> Change:
    """One number moved by a part of the largest of its variable."""

    def change(file: h5py.File) -> None:
        file[path][at] += by * np.abs(file[path][()]).max()

    return change


def with_value(path: str, at: Any, value: Any) -> Change:
    def change(file: h5py.File) -> None:
        file[path][at] = value

    return change


def with_attribute(path: str, **attributes: Any) -> Change:
    return lambda file: file[path].attrs.update(attributes)


def with_text(old: str, new: str) -> Change:
    """Another setting in the text of a case."""

    def change(file: h5py.File) -> None:
        text = file["damped"].attrs["case"]
        assert old in text
        file["damped"].attrs["case"] = text.replace(old, new)

    return change


def without(*paths: str) -> Change:
    def change(file: h5py.File) -> None:
        for path in paths:
            del file[path]

    return change


def test_a_result_equals_itself(made: Path) -> None:
    rows = compared(made, len)
    assert {row["place"] for row in rows} == {"equal"}
    assert {row["scaled"] for row in rows} == {0}
    done = call(made, "compare", "a.h5", "b.h5")
    assert re.search(r"^damped +all 9 variables +0 +equal", done.stdout, re.MULTILINE)
    assert done.stdout.count("\n") == 5  # a line for each case


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (shifted("damped/omega", (17, 1), 2e-9), ("damped", "omega")),
        (shifted("damped/omega", (-1, 1), 2e-9), ("damped", "omega")),
        (shifted("damped/crossing_time", 0, 2e-9), ("damped", "crossing_time")),
        (shifted("spun/x", 5, 2e-9), ("spun", "x")),
        (shifted("spun/event_time", 0, 2e-9), ("spun", "event_time")),
        (shifted("swept/omega", (1, 2), 2e-9), ("swept", "omega")),
        (with_value("damped/omega", (3, 0), np.nan), ("damped", "omega")),
        (with_value("damped/enclosed_axis", 3, 3), ("damped", "enclosed_axis")),
        (with_value("damped/crossing_to", 0, 1), ("damped", "crossing_to")),
        (with_value("spun/event_kind", 0, "other"), ("spun", "event_kind")),
        (with_value("swept/status", 1, 2), ("swept", "status")),
        (without("free"), ("free", "")),
        (without("free/omega"), ("free", "omega")),
        (with_attribute("damped/omega", units="deg/s"), ("damped", "omega:units")),
        (with_attribute("damped/omega", long_name="momentum"), ("damped", "omega:long_name")),
        (with_attribute("damped/enclosed_axis", flag_meanings="a b c d e"),
         ("damped", "enclosed_axis:flag_meanings")),
        (with_attribute("damped", status="failed"), ("damped", "status")),
        (with_attribute("damped", model="tensor"), ("damped", "model")),
        (with_attribute("damped", form="averaged"), ("damped", "form")),
        (with_text("0.05", "0.051"), ("damped", "damping.0")),
        (with_text('"unit": "s"', '"unit": "h"'), ("damped", "time.unit")),
        (with_text("model: ", "modle: "), ("damped", "case")),
    ],
)  # fmt: skip
def test_a_difference_is_found_in_its_place(made, change, found):
    assert found in differing(compared(made, change))


@pytest.mark.parametrize(
    "change",
    [
        shifted("damped/omega", (17, 1), 5e-10),
        shifted("damped/crossing_time", 0, 5e-10),
        # How it was computed.
        with_attribute("damped", error=1e-3, tol=1e-5, method="DOP853", steps=7, run_time=1.0),
        with_attribute("damped/omega", error=1e-3),
        with_value("damped/crossing_error", 0, 1e-3),
        with_text('method: "auto"', 'method: "DOP853"'),
        with_text('note: ""', 'note: "other"'),
    ],
)
def test_what_is_no_difference_is_none(made: Path, change: Change) -> None:
    assert not differing(compared(made, change))


def test_a_difference_is_given_in_units_of_what_is_allowed_with_its_place(made: Path) -> None:
    rows = compared(made, shifted("damped/omega", (17, 1), 2e-9))
    (row,) = (row for row in rows if row["differs"])
    assert row["scaled"] == pytest.approx(2, rel=1e-3)
    assert row["place"].startswith("time = 17, axis = x2: ")
    rows = compared(made, with_value("damped/enclosed_axis", 3, 3))
    assert [row["place"] for row in rows if row["differs"]] == ["time = 3: x3, not x1"]


def test_a_time_may_be_off_by_ten_times_its_stated_error(made: Path) -> None:
    stated = with_value("damped/crossing_error", 0, 1e-6)
    with h5py.File(made / "runs" / "c.h5") as file:
        time = file["damped/crossing_time"][0]
    for off, differs in ((9e-6, False), (12e-6, True)):
        change = with_value("damped/crossing_time", 0, time + off)
        assert bool(differing(compared(made, change, reference=stated))) == differs


def test_tolerances_are_those_asked_for_or_the_variable_s_own(made: Path) -> None:
    change = shifted("damped/omega", (17, 1), 1e-6)
    assert differing(compared(made, change))
    assert not differing(compared(made, change, "--rtol", "1e-5"))
    assert not differing(compared(made, change, "--atol", "1e-5"))
    loose = with_attribute("damped/omega", rtol=1e-5)
    assert not differing(compared(made, change, reference=loose))


def test_samples_are_compared_at_the_reference_s_times(made: Path) -> None:
    """Labels that a result lacks are one line, and results of other experiments are refused."""
    thin = CONFIG.replace("samples: 61", "samples: 7")
    for name, text in (("thin", thin), ("bare", CONFIG), ("other", OTHER)):
        (made / f"{name}.yaml").write_text(text, encoding="utf-8")
        assert call(made, "run", f"{name}.yaml").returncode == 0
    call(made, "classify", "thin.yaml")
    assert call(made, "compare", "c.yaml", "thin.yaml").returncode == 0
    assert call(made, "compare", "thin.yaml", "c.yaml").returncode == 3
    rows = json.loads(call(made, "compare", "bare.yaml", "c.yaml", "--json").stdout)
    (line,) = [row for row in rows if row["differs"] and row["case"] == "damped"]
    assert "enclosed_axis, crossing_time" in line["variable"]
    assert line["place"] == "missing"
    done = call(made, "compare", "other.yaml", "c.yaml")
    assert done.returncode == 2
    assert done.stderr == "runs/other.h5 and runs/c.h5 have no case in common\n"


def test_the_reference_is_small_and_covers_every_case_of_the_papers() -> None:
    assert sum(path.stat().st_size for path in REFERENCE.iterdir()) < 1_500_000
    for config in ROOT.glob("configs/paper*.yaml"):
        cases = hodo_cli.open(REFERENCE / f"{config.stem}.h5")
        assert [*cases] == [*load(config).cases]
        assert "quadruple precision" in cases.attrs["reference"]
        for data in cases.values():
            assert parse_case(data.attrs["case"]).precision == "quadruple"


def check(values: np.ndarray, exact: list[object]) -> None:
    """Values (n,) that were rounded to doubles, against numbers of many digits."""
    truth = np.array([float(x) for x in exact])  # type: ignore[arg-type]
    assert np.abs(values - truth).max() <= 4e-16 * np.abs(truth).max()


NAMES = [*("fig1-1", "fig2-2", "fig3-2", "fig4", "fig8", "fig12", "fig12-all-entries", "fig18")]
STATES = [
    *(("paper1", name, [3, -1]) for name in NAMES), ("paper2", "internal-triaxial", [5, -1]),
    ("paper3", "case2-full", [7, -1]), *(("paper3", f"case{i}", [10]) for i in (1, 2, 3)),
]  # fmt: skip
"""Papers, cases, and the samples that are compared."""


def exact_states(case: Any, times: list[float]) -> list[list[object]]:
    """States at some times by the independent reference, of many digits."""
    given, start = case.data, case.system.start
    if case.model == "linear-diag":
        return series.states(series.diagonal(given["inertia"], given["damping"]), start, times)
    if case.model == "tensor":
        rows = given["resistance"]
        if isinstance(rows, Mapping):
            on, off = rows["diagonal"], rows["off_diagonal"]
            rows = [[on if i == j else off for j in range(3)] for i in range(3)]
        return series.states(series.tensor(given["inertia"], rows), start, times)
    if case.model == "cavity+constant":
        k = case.system.constants
        system = series.cavity(given["inertia"], k["kappa"], [k["N1"], k["N2"], k["N3"]])
        return series.states(system, start, times)
    if case.form == "averaged":
        motion, start = series.paper3(case.name)
        return motion.states(start, times)
    A, C = (given["inertia"][name] for name in "AC")
    system = series.lagrange(A, C, *(given[name] for name in ("mu", "epsilon", "a", "b")))
    return [row[:6] for row in series.states(system, (*start, 0), times)]


@pytest.mark.parametrize(("paper", "name", "samples"), STATES)
def test_states_of_the_papers_agree_with_the_series(paper, name, samples):
    data = hodo_cli.open(REFERENCE / f"{paper}.h5")[name]
    names = next(x for x in (("Gz", "H", "r"), ("omega", "gamma"), ("omega",)) if {*x} <= {*data})
    stored = [data[x].values[samples].reshape(len(samples), -1) for x in names]
    exact = exact_states(parse_case(data.attrs["case"]), data.time.values[samples].tolist())
    for row, truth in zip(np.hstack(stored), exact, strict=True):
        check(row, truth)


def spelled(paper: int, name: str) -> str:
    """A case as the table of the series calls it."""
    if paper == 1:
        return f"P1 {re.sub('-r(?=[0-9])', ' from r = ', name)}"
    figure, _, form = name.partition("-")
    return f"P2 {figure} averaged-{form}".removesuffix("-")


@pytest.mark.parametrize(("paper", "events"), [(1, 24), (2, 8)])
def test_events_of_every_figure_agree_with_the_series(paper: int, events: int) -> None:
    with open(ROOT / "tests" / "data" / "crossings.csv", encoding="utf-8") as file:
        table = [row for row in csv.DictReader(file) if "ulp" not in row["case"]]
    cases = hodo_cli.open(REFERENCE / f"paper{paper}.h5")
    stored = {spelled(paper, name): data for name, data in cases.items()}
    assert sum(row["case"] in stored for row in table) == events
    for case, data in stored.items():
        exact = [row for row in table if row["case"] == case]
        if not exact:
            continue
        time = data["crossing_time" if paper == 1 else "event_time"]
        value = data["crossing_G"].values if paper == 1 else data["x"].values[-1:]
        # To the rounding of a double.
        times = [float(row["time"]) for row in exact]
        assert time.values == pytest.approx(times, rel=3e-16, abs=0)
        assert value == pytest.approx([float(row["value"]) for row in exact], rel=4e-16, abs=0)
        if paper == 1:
            ends = zip(data["crossing_from"].values, data["crossing_to"].values, strict=True)
            assert [f"x{a} to x{b}" for a, b in ends] == [row["event"] for row in exact]


def test_the_table_of_crossings_lists_what_the_datasets_hold() -> None:
    with open(REFERENCE / "crossings.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for path in REFERENCE.glob("*.h5"):
        for name, data in hodo_cli.open(path).items():
            keys = [key for key in ("crossing_time", "event_time") if key in data]
            stored = [time for key in keys for time in data[key].values.tolist()]
            mine = (row for row in rows if (row["paper"], row["case"]) == (path.stem, name))
            assert [float(row["time"]) for row in mine] == stored


@pytest.mark.quadruple
def test_a_reference_is_made_as_it_is_stored(tmp_path: Path) -> None:
    """`make reference`, of one case: what it writes is what the repository holds."""
    config, change = ROOT / "configs" / "paper1.yaml", "fig4.precision=quadruple"
    ran = call(tmp_path, "run", config, "--case", "fig4", "--set", change, "--out", "r")
    assert ran.returncode == 0
    (run,) = (tmp_path / "r").glob("*.h5")
    assert call(tmp_path, "classify", run).returncode == 0
    tool = [sys.executable, ROOT / "tools" / "reference.py", tmp_path / "made", run]
    subprocess.run(tool, check=True, cwd=ROOT)
    made = hodo_cli.open(tmp_path / "made" / "paper1.h5")
    assert list(made) == ["fig4"]
    stored = hodo_cli.open(REFERENCE / "paper1.h5")
    ours, theirs = (cases["fig4"].drop_attrs(deep=False) for cases in (made, stored))
    xr.testing.assert_identical(ours, theirs)
