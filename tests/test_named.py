"""Commands that take a result or the config of one, and what they say where the two differ."""

import subprocess
from pathlib import Path

import pytest
from conftest import call

CONFIG = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 1, r: 1}, time: {end: 9}}
cases:
  first: {damping: 0.1}
  second: {damping: [0.2, 0.1, 0.3]}
figures:
  f: {kind: hodograph, cases: [first, second]}
claims:
  - id: c
    where: w
    statement: s
    cases: [first]
    check: {kind: bound, of: T, most: 9}
    expect: reproduced
"""


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A config in the working folder, run and classified."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a.yaml"
    path.write_text(CONFIG)
    assert hodo("run", "a").returncode == 0
    assert hodo("classify", "a").returncode == 0
    return path


def hodo(*arguments: str) -> subprocess.CompletedProcess[str]:
    return call(Path(), *arguments)


@pytest.mark.parametrize("command", ["show", "classify", "claims", "plot"])
def test_a_config_stands_for_its_result(config: Path, command: str) -> None:
    anew = ["--force"] if command == "plot" else []  # a second plot would say that all is kept
    lines = [hodo(command, name, *anew).stdout for name in ("runs/a.h5", "a.yaml", "a")]
    assert lines[0]
    assert lines[0] == lines[1] == lines[2]
    assert "has changed" not in lines[0]


def test_an_edited_caption_is_seen(config: Path) -> None:
    config.write_text(CONFIG.replace("cases: [first, second]", "cases: [first], title: other"))
    said = (
        "runs/a.h5: the figures of a.yaml have changed since its run: hodo plot a.yaml takes them"
    )
    assert said in hodo("plot", "runs/a.h5", "--format", "csv").stderr
    assert "second" in Path("runs/figures/a/f.csv").read_text()
    assert not hodo("plot", "a", "f", "--format", "csv").stderr
    assert "second" not in Path("runs/figures/a/f.csv").read_text()
    assert not hodo("claims", "runs/a.h5").stderr  # which are as they were


def test_an_edited_claim_is_checked(config: Path) -> None:
    config.write_text(CONFIG.replace("most: 9", "least: 9"))
    stored, told = hodo("claims", "runs/a.h5"), hodo("claims", "a.yaml")
    assert "the claims of a.yaml have changed since its run" in stored.stderr
    assert (stored.returncode, "reproduced" in stored.stdout) == (0, True)
    assert (told.returncode, "contradicted" in told.stdout) == (3, True)
    assert not told.stderr
    assert hodo("claims", "runs/a.h5").returncode == 0


@pytest.mark.parametrize("name", ["runs/a.h5", "a"])
def test_a_case_that_has_changed_since_is_named(config: Path, name: str) -> None:
    config.write_text(CONFIG.replace("damping: 0.1", "damping: 0.3").replace("[0.2", "[0.20"))
    for command in ("show", "classify", "plot"):
        said = "first has changed in a.yaml since the run; `hodo run a.yaml` runs it again\n"
        assert f"runs/a.h5: {said}" in hodo(command, name).stderr


def test_remarks_are_no_change_and_a_broken_config_is_no_mistake(config: Path) -> None:
    config.write_text(CONFIG.replace("damping: 0.1", "damping: 0.1, note: new"))
    assert not hodo("show", "a").stderr
    config.write_text("cases: []")
    assert not hodo("show", "runs/a.h5").stderr
    assert hodo("show", "a.yaml").returncode == 2


def test_a_config_without_a_result_names_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(CONFIG)
    for command in ("show", "classify", "claims", "plot"):
        done = hodo(command, "a")
        assert done.returncode == 2
        assert done.stderr == "a.yaml has no result runs/a.h5: hodo run a.yaml makes it\n"
