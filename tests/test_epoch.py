"""Seconds since an epoch: the digits that all times have in common tell nothing."""

import re
from pathlib import Path

import pytest
from conftest import BODY, call

import hodo_cli as hodo

START = 1_700_000_000
CONFIG = f"""
defaults:
  model: torques
  inertia: [1, 0.8, 0.6]
  initial: {{p: 0.8, q: 0.5, r: 0.74}}
  time: {{start: {START}, end: {START + 600}, samples: 1201, unit: s}}
cases:
  turning: {{damping: [0.005, 0.004, 0.003]}}
  pole: {{expression: [0.001/(t - 30), 0, 0], time: {{epoch: {START}}}}}
  braked: {{brake: 0.01, damping: 0.001}}
  broken: {{damping: [0.005, 0.004, 0.003], max_steps: 20}}
  starts:
    damping: [0.005, 0.004, 0.003]
    initial: {{p: 0, q: 0, G: 1}}
    sweep: {{direction: {{sphere: {{count: 200}}}}}}
figures:
  turning: {{kind: hodograph, cases: turning}}
  broken: {{kind: hodograph, cases: broken}}
claims:
  - {{id: wrong, where: here, statement: p falls., cases: [turning], expect: contradicted,
      check: {{kind: monotone, of: [p], sense: falls}}}}
  - {{id: crosses, where: here, statement: It crosses., cases: [turning], expect: reproduced,
      check: {{kind: crossings, from: x1, to: x3}}}}
"""
EPOCH = re.compile(r"\b1\.7e\+0?9|\b1700000\d{3}(?:\.\d+)?")


def seconds(text: str) -> list[float]:
    """How long after the start each of the times in a text is; nan for one without the digits."""
    times = [float(time) - START for time in EPOCH.findall(text)]
    assert times, text
    return times


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("epoch")
    (folder / "c.yaml").write_text(CONFIG, encoding="utf-8")
    assert call(folder, "run", "c.yaml", "--quiet").returncode == 1
    assert call(folder, "classify", "c.yaml").returncode == 0
    return folder


def test_commands_tell_times_since_an_epoch_apart(folder: Path) -> None:
    shown = call(folder, "show", "c.yaml").stdout
    pole, stop = seconds(shown)
    assert pole == pytest.approx(30, abs=0.05)  # "near", by doubles of 1.7e9 s
    assert 0 < stop < 600
    labelled = call(folder, "classify", "c.yaml").stdout
    crossing, broken_at_pole, exact_stop, broken, first, last, median = seconds(labelled)
    assert stop == pytest.approx(exact_stop, abs=1e-3)
    assert 0 < broken_at_pole < 30
    assert 0 < broken < 600
    assert crossing == pytest.approx(305.358955, abs=1e-3)  # as that from t = 0
    assert 0 < first < median < last < 600
    verdicts = call(folder, "claims", "c.yaml").stdout
    assert seconds(verdicts)[-1] == pytest.approx(crossing, abs=0.1)
    assert 0 < seconds(verdicts)[0] < 600
    assert seconds(call(folder, "plot", "c.yaml").stderr) == [broken]


def test_figures_tell_times_since_an_epoch_apart(folder: Path) -> None:
    motion = hodo.open(folder / "runs" / "c.h5")["turning"]
    (crossing,) = motion.crossing_time.data - START
    (legend,) = hodo.plot(motion).legends
    words = " ".join(text.get_text() for text in legend.get_texts())
    assert seconds(words) == [pytest.approx(crossing, abs=1e-3), 600]
    time = {"start": START, "end": START + 60, "samples": 601}
    body = hodo.run(BODY | {"attitude": True, "time": time})
    figure = hodo.plot(body, kind="body")
    assert [seconds(axes.get_title()) for axes in figure.axes] == [[0], [30], [60]]


def test_a_stop_whose_error_is_not_measured_is_told_as_well(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG.replace("damping: 0.001", "error: off"))
    assert call(tmp_path, "run", "c.yaml", "--case", "braked", "--quiet").returncode == 0
    (stop,) = seconds(call(tmp_path, "show", "c.yaml").stdout)
    assert 0 < stop < 600
