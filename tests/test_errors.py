"""One rule for errors: what the machine refuses belongs to no case, and ends the command in one
line; and a result never needs its config."""

import ast
import os
import resource
from collections.abc import Iterator
from contextlib import chdir
from functools import partial
from pathlib import Path

import h5py
import pytest
from click.testing import CliRunner, Result
from conftest import call_apart, limit

from hodo_cli import NOT_OF_A_CASE, BatchError, HodoError
from hodo_cli.cli import main

CONFIG = """\
defaults:
  model: linear-diag
  inertia: [1, 0.8, 0.6]
  time: {end: 40, samples: 801}
  initial: {p: 0.8, q: 0.5, r: 0.74}
  error: off
cases:
  a: {damping: [0.05, 0.04, 0.03]}
  b: {damping: [0.03, 0.04, 0.05]}
  s: {damping: [0.03, 0.04, 0.05], sweep: {damping.0: {linspace: [0.01, 0.05, 300]}}}
figures:
  both: {kind: phase, cases: [a, b], x: p, y: r}
"""

PACKAGE = Path(__file__).parents[1] / "hodo_cli"

MAY_TAKE_ALL = {
    "cli.py": 1,  # a signal comes out of a compiled library as any error
    "batch.py": 2,  # dask raises anything; and what a task raises is handed on as its result
    "models/own.py": 2,  # a user's own file may raise anything
}
"""How many handlers of every exception a module has that are right without `NOT_OF_A_CASE`."""


def hodo(*arguments: object) -> Result:
    """A command in this process."""
    return CliRunner().invoke(main, [str(word) for word in arguments])


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder with a config and its result, as the current one."""
    (tmp_path / "x.yaml").write_text(CONFIG)
    with chdir(tmp_path):
        assert hodo("run", "x.yaml", "--out", ".", "--case", "[ab]").exit_code == 0
        yield tmp_path


def broad_handlers(tree: ast.AST) -> int:
    """The handlers of every exception that follow none for `NOT_OF_A_CASE`."""

    def is_broad(kind: ast.expr | None) -> bool:
        name = kind.id if isinstance(kind, ast.Name) else ""
        return kind is None or "Exception" in name or name == "MISTAKES"

    count = 0
    for node in ast.walk(tree):
        if isinstance(node, ast.Try):
            kinds = [handler.type for handler in node.handlers]
            names = [kind.id for kind in kinds if isinstance(kind, ast.Name)]
            count += any(map(is_broad, kinds)) and "NOT_OF_A_CASE" not in names
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "suppress":
            count += any(map(is_broad, node.args))
    return count


def test_who_takes_every_exception_lets_those_of_no_case_pass() -> None:
    found = {
        str(file.relative_to(PACKAGE).as_posix()): broad_handlers(ast.parse(file.read_bytes()))
        for file in PACKAGE.rglob("*.py")
    }
    assert {name: count for name, count in found.items() if count} == MAY_TAKE_ALL


def test_who_takes_a_mistake_of_the_user_takes_nothing_else() -> None:
    assert not [kind for kind in NOT_OF_A_CASE if issubclass(kind, HodoError)]
    assert not [kind for kind in NOT_OF_A_CASE if issubclass(HodoError, kind)]


@pytest.mark.parametrize("command", ["run", "plot", "merge"])
@pytest.mark.parametrize("out", ["file", "file/deeper"])
def test_a_file_is_no_folder_to_write_into(folder: Path, command: str, out: str) -> None:
    (folder / "file").write_text("mine")
    of = "x.yaml" if command == "run" else "x.h5"
    done = hodo(command, of, "--out", f"{out}/new.h5" if command == "merge" else out)
    assert done.exit_code == 2
    assert done.stderr.startswith("cannot write file/")
    assert done.stderr.endswith(": file is a file, not a folder\n")
    assert (folder / "file").read_text() == "mine"


def test_labels_that_cannot_be_stored_are_one_line(folder: Path) -> None:
    little = partial(limit, resource.RLIMIT_FSIZE, 4000)
    full = call_apart(folder, "classify", "x.h5", preexec_fn=little)
    assert (full.returncode, full.stderr) == (2, "cannot write x.h5: file too large\n")
    (folder / "x.h5").chmod(0o444)
    marked = hodo("classify", "x.h5")
    said = "x.h5 is read-only (mode 444): chmod u+w\n"
    assert (marked.exit_code, marked.stderr) == (2, said)


def test_too_few_descriptors_are_one_line(folder: Path) -> None:
    said = set()
    # With each one more it comes further; from ten on, one writes as with any number below 40.
    for most in range(3, 12):

        def few(most: int = most) -> None:
            os.closerange(3, 1000)  # those of the tests
            limit(resource.RLIMIT_NOFILE, most)

        done = call_apart(folder, "classify", "x.h5", preexec_fn=few)
        of_libraries = "site-packages" in done.stderr or "importlib" in done.stderr
        if done.returncode and not of_libraries:
            said.add(done.stderr)
    assert said
    assert all(line.count("\n") == 1 for line in said), said


@pytest.mark.parametrize("content", ["latin", "binary", "long name"])
def test_a_result_needs_no_config_that_can_be_read(folder: Path, content: str) -> None:
    """The config may have been saved by another editor since, and a stranger's result may name any
    file as its config."""
    given = {"latin": CONFIG.encode() + b"# \xe9t\xe9\n", "binary": os.urandom(1 << 16)}
    (folder / "x.yaml").write_bytes(given.get(content, b""))
    if content not in given:
        with h5py.File(folder / "x.h5", "r+") as result:
            result.attrs["config_path"] = "n" * 5000
    for command in ("show", "classify", "plot", "claims"):
        done = hodo(command, "x.h5")
        assert done.exit_code == 0, done.output
        assert "Traceback" not in done.output


def test_a_bug_of_the_machine_in_a_task_ends_the_batch() -> None:
    from hodo_cli.batch import Pool

    with Pool(1) as workers, pytest.raises(BatchError, match="No such file"):
        list(workers.map(open, ["/no/such/file"]))


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("f", "F"), "f and F are one file on systems that ignore case"),
        (("con",), "con names a device on Windows"),
        (("Lpt1.old",), "Lpt1.old names a device on Windows"),
        (("dot.",), "dot. ends with a dot"),
    ],
)
def test_names_that_are_no_files_elsewhere_are_refused(folder, names, message):
    """For what becomes a file: figures and case files; a case is a group, and free."""
    figure = "{kind: phase, cases: [a], x: p, y: r}"
    lines = "".join(f"  {name}: {figure}\n" for name in names)
    (folder / "x.yaml").write_text(CONFIG.partition("figures:")[0] + "figures:\n" + lines)
    refused = hodo("run", "x.yaml", "--dry-run")
    assert refused.exit_code == 2
    assert message in refused.stderr
    (folder / "x.yaml").write_text(
        CONFIG.replace("  a:", "".join(f"  {n}: {{damping: 1}}\n" for n in names) + "  a:")
    )
    assert hodo("run", "x.yaml", "--dry-run").exit_code == 0
    for name in names:
        (folder / f"{name}.yaml").write_text(CONFIG)
    files = [f"{name}.yaml" for name in names]
    configs = hodo("run", *files, "--dry-run")
    assert (configs.exit_code, message in configs.stderr) == (2, True), configs.output


def test_a_method_that_is_none_is_one_line(folder: Path) -> None:
    with h5py.File(folder / "x.h5", "r+") as result:
        result["a"].attrs["method"] = "magic"
    done = hodo("classify", "x.h5")
    assert done.exit_code == 1
    assert "x.h5: a: this hodo has no method 'magic': run it again" in done.stderr
