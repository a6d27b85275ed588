"""What makes a stored result stale: a line changed in what computes it, and nothing else."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, call

from hodo_cli.integration import choice

CONFIG = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 10, samples: 3},
           initial: {p: 0.8, q: 0.5, r: 0.74}, damping: [0.005, 0.004, 0.003]}
cases:
  single: {method: collocation}
  swept: {method: collocation, error: off, sweep: {damping.0: {values: [0.005, 0.006]}}}
"""
CODE = "will run: the code that computes it has changed"
KEPT = "is kept: nothing that it depends on has changed"


class Copy:
    """A copy of the package, with a result that it has computed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(
            ROOT / "hodo_cli", folder / "hodo_cli", ignore=shutil.ignore_patterns("__pycache__")
        )
        (folder / "a.yaml").write_text(CONFIG)
        done = self.hodo("run", "a.yaml")
        assert done.returncode == 0, done.stderr

    def hodo(self, *arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
        # -P: not the folder of the script, which is that of this suite, but the copy comes first.
        command = [sys.executable, "-P", "-m", "hodo_cli.cli", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        return subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False
        )

    def plan(self) -> list[str]:
        done = self.hodo("run", "a.yaml", "--dry-run")
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    return Copy(tmp_path_factory.mktemp("copy"))


RERUNS = {
    "models/body.py": {"single", "swept"},
    "engines/collocation.py": {"single", "swept"},
    "integration/error.py": {"single", "swept"},
    "schema/expression.py": {"single", "swept"},
    "sweeps/columns.py": {"swept"},
    "cases/sweep_block.py": {"swept"},
    # Together.
    "cases/case.py schema/document.py progress.py results/layout.py results/resume.py "
    "claims/checks.py figures/maps.py text.py cli.py": set(),
}


@pytest.mark.parametrize("changed", RERUNS)
def test_one_line_in_a_folder_reruns_what_it_computes(copy: Copy, changed: str) -> None:
    paths = [copy.folder / "hodo_cli" / source for source in changed.split()]
    before = [path.read_text() for path in paths]
    try:
        for path, text in zip(paths, before, strict=True):
            path.write_text(text + "CHANGED = True\n")
        assert copy.plan() == [
            f"{name}: {CODE if name in RERUNS[changed] else KEPT}" for name in ("single", "swept")
        ]
    finally:
        for path, text in zip(paths, before, strict=True):
            path.write_text(text)


def test_remarks_and_captions_rerun_nothing(copy: Copy) -> None:
    try:
        (copy.folder / "a.yaml").write_text(
            "title: another\n"
            + CONFIG.replace("single: {", "single: {note: remark, ")
            + "figures: {f: {kind: hodograph, cases: [single], caption: new}}\n"
        )
        assert copy.plan() == [f"single: {KEPT}", f"swept: {KEPT}"]
        (copy.folder / "a.yaml").write_text(CONFIG.replace("0.003", "0.0031"))
        assert copy.plan() == [
            f"{name}: will run: its case has changed" for name in ("single", "swept")
        ]
    finally:
        (copy.folder / "a.yaml").write_text(CONFIG)


def test_nothing_is_integrated_to_see_what_runs(tmp_path, monkeypatch):
    def no_integration(*arguments: object) -> None:
        raise AssertionError("integrated")

    monkeypatch.setattr(choice, "solve", no_integration)
    text = CONFIG.replace("method: collocation", "method: auto").replace("0.005, 0.004", "1e7, 1")
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    done = call(tmp_path, "run", "a.yaml", "--dry-run")
    assert done.stdout.count("will run: it has no result yet") == 2
