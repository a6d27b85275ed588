"""What makes a stored result stale: a line changed anywhere in what computes it, and nothing
else."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, call

from hodo_cli import BatchError
from hodo_cli.batch import digests, pool
from hodo_cli.cases.config import parse
from hodo_cli.commands import run
from hodo_cli.commands.resume import case_digest
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


@pytest.mark.parametrize(
    ("source", "reruns"),
    [
        ("models/cavity.py", {"single", "swept"}),
        ("engines/collocation.py", {"single", "swept"}),
        ("integration/error.py", {"single", "swept"}),
        ("schema/expression.py", {"single", "swept"}),
        ("sweeps/columns.py", {"swept"}),
        ("cases/sweep_block.py", {"swept"}),
        ("cases/case.py", set()),
        ("schema/document.py", set()),
        ("progress.py", set()),
        ("results/layout.py", set()),
        ("claims/checks.py", set()),
        ("figures/kinds/maps.py", set()),
        ("text.py", set()),
        ("cli.py", set()),
    ],
)
def test_one_line_in_a_folder_reruns_what_it_computes(
    copy: Copy, source: str, reruns: set[str]
) -> None:
    path = copy.folder / "hodo_cli" / source
    before = path.read_text()
    try:
        path.write_text(before + "CHANGED = True\n")
        assert copy.plan() == [
            f"{name}: {CODE if name in reruns else KEPT}" for name in ("single", "swept")
        ]
    finally:
        path.write_text(before)


def test_a_source_of_a_time_that_is_still_to_come_is_as_good_as_another(copy: Copy) -> None:
    source = copy.folder / "hodo_cli" / "models" / "cavity.py"
    before = source.stat()
    try:
        os.utime(source, (before.st_atime, before.st_mtime + 1e6))
        assert copy.plan() == [f"{name}: {KEPT}" for name in ("single", "swept")]
    finally:
        os.utime(source, (before.st_atime, before.st_mtime))


def test_every_folder_that_computes_is_hashed(tmp_path: Path) -> None:
    """A file that is new in one of the folders counts as well as one that is there."""
    assert {name.partition("/")[0] for name in digests.source_digests()} == {
        *("arithmetic.py", "cases", "engines", "integration", "models", "schema", "sweeps")
    }
    for folder in digests.CASE_SOURCES:
        files = {f"{folder}/{path.name}" for path in (digests.PACKAGE / folder).glob("*.py")}
        assert files <= digests.source_digests().keys()


CHANGES = """\
import os, shutil, sys
from hodo_cli.batch.digests import PACKAGE, process_digest
process_digest()
source = PACKAGE / "models" / "cavity.py"
before, mode = source.stat(), source.stat().st_mode
{change}
import wave  # looked at again only when more is loaded
process_digest()
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no time of an inode's change")
@pytest.mark.parametrize(
    ("change", "ends"),
    [
        ('os.link(source, "link.py")', False),
        ("source.chmod(mode & ~0o022); source.chmod(mode)", False),
        ("os.utime(source)", False),
        ('source.replace("moved.py"); shutil.copy("moved.py", source)', False),
        ('source.write_text(source.read_text() + "# new\\n")', True),
        (
            'source.write_text(source.read_text() + "# new\\n"); '
            "os.utime(source, ns=(before.st_atime_ns, before.st_mtime_ns))",
            True,
        ),
        ("source.unlink()", True),
    ],
)
def test_a_process_ends_if_its_code_changes_not_if_only_its_inodes_do(
    tmp_path: Path, change: str, ends: bool
) -> None:
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "hodo_cli", tmp_path / "hodo_cli", ignore=ignored)
    done = subprocess.run(
        [sys.executable, "-P", "-c", CHANGES.format(change=change)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == int(ends), done.stderr
    assert ("has changed since this process began" in done.stderr) == ends


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


def test_another_version_of_a_library_reruns(monkeypatch: pytest.MonkeyPatch) -> None:
    case = parse(CONFIG, "x").cases["single"]
    before = case_digest(case)
    for name in digests.COMPUTING_LIBRARIES:
        digests.library_digest.cache_clear()
        monkeypatch.setattr(
            digests, "library_version", lambda library, new=name: str(library == new)
        )
        assert case_digest(case) != before
        monkeypatch.undo()
    digests.library_digest.cache_clear()
    assert case_digest(case) == before


def test_nothing_is_integrated_to_see_what_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_integration(*arguments: object) -> None:
        raise AssertionError("integrated")

    monkeypatch.setattr(choice, "solve", no_integration)
    text = CONFIG.replace("method: collocation", "method: auto").replace("0.005, 0.004", "1e7, 1")
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    done = call(tmp_path, "run", "a.yaml", "--dry-run")
    assert done.stdout.count("will run: it has no result yet") == 2


def test_a_result_of_another_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers are processes of their own: they have the digest of the sources, this process
    another."""
    monkeypatch.setattr(pool, "process_digest", lambda: "another")
    with pool.pool(2) as workers, pytest.raises(BatchError, match="computes with other code"):
        next(workers.map(abs, [1]))


def test_the_labels_that_a_run_drops_are_looked_for_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = CONFIG.split("  swept")[0] + "  again: {method: collocation}\n"
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    asked: list[list[str]] = []

    def labelled(path: Path, names: Iterable[str]) -> list[str]:
        asked.append([*names])
        return found(path, asked[-1])

    found = run.labelled
    monkeypatch.setattr(run, "labelled", labelled)
    for _ in range(2):
        assert call(tmp_path, "run", "a.yaml", "--force", "-j", "1").returncode == 0
        rows = json.loads(call(tmp_path, "classify", "a.yaml", "--json").stdout)
    assert len(rows) == 2
    # Before and after each run, not for each case.
    assert asked == [[], [], ["single", "again"], ["single", "again"]]
