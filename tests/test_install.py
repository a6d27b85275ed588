"""hodo beyond a clone: what comes with the package, and where parts of it are missing."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT, Hodo, call
from test_docs import snippets


def test_a_new_case_file_runs_and_is_never_replaced(hodo: Hodo, tmp_path: Path) -> None:
    done = hodo("init", "mine")
    assert (done.returncode, done.stdout) == (0, "mine.yaml\n")
    text = (tmp_path / "mine.yaml").read_text(encoding="utf-8")
    told = [line.removeprefix("#     hodo ") for line in text.splitlines() if "#     hodo" in line]
    assert [line.split()[0] for line in told] == ["run", "classify", "plot"]
    for line in told:
        done = hodo(*line.split())
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "figures" / "mine" / "turning.png").exists()
    done = hodo("init", "mine.yaml")
    assert (done.returncode, done.stderr) == (2, "mine.yaml is there already: take another name\n")
    assert (tmp_path / "mine.yaml").read_text(encoding="utf-8") == text
    done = hodo("init", "none/mine")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_a_file_of_the_working_folder_goes_before_what_is_brought(hodo, tmp_path):
    planned = hodo("run", "paper1", "--dry-run").stdout
    assert "fig4: will run" in planned
    assert hodo("run", "paper1", "--case", "fig4").returncode == 0
    assert (tmp_path / "runs" / "paper1.h5").exists()
    hodo("init", "paper1")
    assert "staying: will run" in hodo("run", "paper1", "--dry-run", "--out", "own").stdout
    done = hodo("run", "papr2", "--dry-run")
    assert done.stderr == "papr2: no such file or directory; did you mean 'paper2'?\n"


SHIPPED = ("pyproject.toml", "README.md", "LICENSE")
"""The files beside the package that a wheel is made of."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of a clone where a user saves a case file in `configs`, unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    clone = folder / "clone"
    shutil.copytree(ROOT, clone, ignore=lambda _, names: {*names} - {*SHIPPED})
    for part in ("hodo_cli", "configs"):
        shutil.copytree(ROOT / part, clone / part, ignore=shutil.ignore_patterns("__pycache__"))
    (clone / "configs" / "mine.yaml").write_text("cases: {}", encoding="utf-8")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=clone, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_the_wheel_brings_the_case_files(installed: Path, tmp_path: Path) -> None:
    for command in (["run", "paper3", "--dry-run"], ["init", "mine"], ["run", "mine", "--dry-run"]):
        words = [sys.executable, "-P", "-m", "hodo_cli.cli", *command]
        environment = {**os.environ, "PYTHONPATH": str(installed)}
        streams = {"cwd": tmp_path, "capture_output": True, "text": True}
        done = subprocess.run(words, env=environment, **streams)
        assert done.returncode == 0, done.stderr
        assert done.stdout
    brought = {path.name for path in (installed / "hodo_cli" / "configs").iterdir()}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    build = project["tool"]["hatch"]["build"]["targets"]
    named = [*build["wheel"]["force-include"]]
    assert brought == {Path(name).name for name in named}
    if (ROOT / ".git").exists():
        listed = ["git", "ls-files", "configs"]
        known = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True)
        assert sorted(named) == known.stdout.split()


@pytest.mark.process
def test_hodo_works_without_what_windows_lacks(hodo: Hodo, tmp_path: Path) -> None:
    """In processes too; and what it locked is given up and gone."""
    pytest.importorskip("filelock")
    lacking = {**os.environ, "PYTHONPATH": str(ROOT / "tests" / "without_fcntl")}
    hidden = subprocess.run([sys.executable, "-c", "import fcntl"], env=lacking, check=False)
    assert hidden.returncode == 1
    call(tmp_path, "init", "mine")
    for line in ("run mine.yaml -j 2", "classify runs/mine.h5"):
        done = hodo(*line.split(), env=lacking)
        assert done.returncode == 0, done.stderr
    assert "turning: is kept" in hodo("run", "mine", "--dry-run", env=lacking).stdout
    left = {path.name for path in (tmp_path / "runs").iterdir()}
    assert left - {".hodo.lock"} == {"mine.h5"}


@pytest.mark.parametrize("file", ["environment.yml", "conda-recipe/meta.yaml"])
def test_conda_installs_every_dependency(file: str) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    text = (ROOT / file).read_text(encoding="utf-8").lower().replace(" >=", ">=")
    # conda-forge calls these two otherwise.
    called = {"heyoka": "heyoka.py", "matplotlib": "matplotlib-base"}
    for wanted in project["dependencies"]:
        name, least = re.match(r"([A-Za-z0-9-]+)(>=[0-9.]+)", wanted).groups()
        name = called.get(name.lower(), name.lower())
        assert re.search(rf"^ +- {re.escape(name + least)}(?= |$)", text, re.MULTILINE), wanted


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_as_documented(hodo: Hodo, tmp_path: Path) -> None:
    (line,) = snippets("docs/case-files.md", "bash")
    assert line.strip() in " ".join(hodo("--help").stdout.split())
    scripts = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    shown = f"{line}complete -p hodo\n"
    assert hodo("init", "mine").returncode == 0
    for words in ("hodo cla", "hodo run --dr", "hodo run mine.yaml --case sta",
                  "hodo plot mine sp", "hodo run pap", "hodo plot --format s"):  # fmt: skip
        shown += f"COMP_WORDS=({words}); COMP_CWORD={words.count(' ')}; COMPREPLY=()\n"
        shown += '_hodo_completion hodo; echo "${COMPREPLY[@]}"\n'
    streams = {"cwd": tmp_path, "capture_output": True, "text": True}
    done = subprocess.run(["bash", "-c", shown], env={**os.environ, "PATH": scripts}, **streams)
    found = done.stdout.splitlines()[-6:]
    assert found[:4] == ["claims classify", "--dry-run", "staying", "speeds"], done.stderr
    assert found[4:] == ["paper1 paper2 paper3", "svg"], done.stderr


FIGURES = """
cases:
  turning: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.005, 0.004, 0.003],
            initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 5}}
figures:
  drawn: {kind: hodograph, cases: [turning]}
claims:
  - {id: wrong, where: nowhere, statement: It turns round x3., cases: [turning],
     expect: reproduced, check: {kind: axis, start: x3, end: x3}}
"""


def figures(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    """What `make figures` does with a config."""
    (folder / "all.yaml").write_text(text, encoding="utf-8")
    tool = [sys.executable, ROOT / "tools" / "figures.py", "all.yaml"]
    return subprocess.run(tool, cwd=folder, capture_output=True, text=True)


def test_one_process_makes_all_that_there_is_of_a_config(hodo: Hodo, tmp_path: Path) -> None:
    assert (done := figures(tmp_path, FIGURES)).returncode == 0, done.stderr
    made = [tmp_path / "runs" / "all.h5", *(tmp_path / "runs" / "figures").glob("all/*.png")]
    times = [file.stat().st_mtime_ns for file in made]
    assert len(made) == 2
    # A claim with another verdict than expected keeps no figure from being drawn.
    assert hodo("claims", "runs/all.h5").returncode == 3
    assert figures(tmp_path, FIGURES).returncode == 0
    assert [file.stat().st_mtime_ns for file in made] == times


def test_a_case_that_fails_keeps_the_rest_from_being_made(tmp_path: Path) -> None:
    done = figures(tmp_path, FIGURES.replace("{end: 5}", "{end: 500}, max_steps: 1"))
    assert done.returncode == 1
    assert "figures" not in done.stdout
