"""What goes wrong outside the program, in files and machines: one line each, nothing is lost."""

import ast
import fcntl
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import chdir
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner, Result
from conftest import Hodo, call, call_apart, limit

from hodo_cli import NOT_OF_A_CASE, BatchError, HodoError
from hodo_cli.cli import main

CONFIG = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 400, samples: 21},
           initial: {p: 0.8, q: 0.5, r: 0.74}, error: off}
cases:
  a: {damping: [0.005, 0.004, 0.003]}
  b: {damping: [0.003, 0.004, 0.005]}
figures:
  both: {kind: hodograph, cases: [a, b]}
claims:
  - {id: start, where: here, statement: It is damped., cases: [a], expect: reproduced,
     check: {kind: axis, start: x1, end: x3}}
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


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a config and its classified result."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "x.yaml").write_text(CONFIG)
    for command in (("run", "x.yaml", "--out", "."), ("classify", "x.h5")):
        assert call(folder, *command).returncode == 0
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy of that folder, as the current one."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    with chdir(tmp_path):
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
    assert hodo("run", "x.yaml", "--out", ".", "--force").exit_code == 0
    little = partial(limit, resource.RLIMIT_FSIZE, 4000)
    full = call_apart(folder, "classify", "x.h5", preexec_fn=little)
    assert (full.returncode, full.stderr) == (2, "cannot write x.h5: file too large\n")
    (folder / "x.h5").chmod(0o444)
    marked = hodo("classify", "x.h5")
    said = "x.h5 is read-only (mode 444): chmod u+w\n"
    assert (marked.exit_code, marked.stderr) == (2, said)


def test_too_few_descriptors_are_one_line(folder: Path) -> None:
    assert hodo("run", "x.yaml", "--out", ".", "--force").exit_code == 0
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
    """Another editor may have saved the config, and a stranger's result may name any file."""
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


Tampering = Callable[[h5py.Group], object]


def attribute(name: str, value: object) -> Tampering:
    return lambda case: case.attrs.__setitem__(name, value)


def without(name: str) -> Tampering:
    return lambda case: case.attrs.__delitem__(name)


def dataset(name: str, **made: object) -> Tampering:
    def tamper(case: h5py.Group) -> None:
        del case[name]
        if made:
            case.create_dataset(name, **made)

    return tamper


def instead(make: Callable[[h5py.File], object]) -> Tampering:
    def tamper(case: h5py.Group) -> None:
        file = case.file
        del file["a"]
        make(file)

    return tamper


def replaced(old: str, new: str) -> Tampering:
    return lambda case: case.attrs.__setitem__("case", case.attrs["case"].replace(old, new))


TAMPERINGS: dict[str, Tampering] = {
    "case is no YAML": attribute("case", "]["),
    "case is another shape": attribute("case", "- 1\n- 2"),
    "case is an object of Python": attribute(
        "case", "!!python/object/apply:os.system ['touch owned']"
    ),
    "case is a number": attribute("case", 7),
    "case is empty": attribute("case", h5py.Empty("f")),
    "case is gone": without("case"),
    "case of 10^12 samples": replaced("samples: 21", "samples: 1000000000000"),
    "case of an unknown model": replaced("linear-diag", "lunar"),
    "case with another motion": replaced("0.005", "0.009"),
    "hash is a number": attribute("hash", 1.5),
    "status is an array": attribute("status", np.arange(2)),
    "status is gone": without("status"),
    "steps is text": attribute("steps", "many"),
    "error is text": attribute("error", "none"),
    "error is negative": attribute("error", -1.0),
    "tol is gone": without("tol"),
    "method is a path": attribute("method", "../../etc/passwd"),
    "warnings is a number": attribute("warnings", 3),
    "message has escape sequences": attribute("message", "\x1b[2J\x07"),
    "omega is gone": dataset("omega"),
    "omega is text": dataset("omega", data=["a", "b"]),
    "omega is claimed": dataset("omega", data=np.zeros((21, 3), dtype="i4")),
    "omega is complex": dataset("omega", data=np.zeros((21, 3), dtype="c16")),
    "omega has no dimensions": dataset("omega", data=np.zeros((21, 3))),
    "omega is vast": dataset("omega", shape=(10**13, 3), dtype="f8", chunks=(1000, 3)),
    "time is gone": dataset("time"),
    "time is short": dataset("time", data=np.zeros(3)),
    "crossing_from is gone": dataset("crossing_from"),
    "crossing_to is short": dataset("crossing_to", data=np.zeros(0, dtype="i1")),
    "enclosed_axis is text": dataset("enclosed_axis", data=["x1"] * 21),
    "time is a group": lambda case: (case.__delitem__("time"), case.create_group("time")),
    "the group is a dataset": instead(lambda file: file.create_dataset("a", data=1)),
    "the group is empty": instead(lambda file: file.create_group("a")),
    "the group is a link to nowhere": instead(
        lambda file: file.__setitem__("a", h5py.ExternalLink("/etc/passwd", "/"))
    ),
    "the config is garbage": lambda case: case.file.attrs.__setitem__("config", "]["),
    "the config is gone": lambda case: case.file.attrs.__delitem__("config"),
    "the history is an array": lambda case: case.file.attrs.__setitem__("history", np.arange(3)),
}


def is_plain(said: str, status: int) -> bool:
    """Whether a command that did not end well said why, briefly, in what a terminal prints."""
    lines = said.splitlines()
    return (not status or bool(lines)) and len(lines) <= 6 and all(map(str.isprintable, lines))


@pytest.mark.parametrize("how", TAMPERINGS)
def test_commands_on_a_result_that_was_tampered_with(folder: Path, how: str) -> None:
    right = shutil.copy(folder / "x.h5", folder / "right.h5")
    path = folder / "x.h5"
    with h5py.File(path, "r+") as file:
        TAMPERINGS[how](file["a"])
    before = path.read_bytes()
    for command, statuses in (
        (("compare", path, right), (0, 2, 3)),
        (("compare", right, path), (0, 2, 3)),
        (("claims", path), (0, 2, 3)),
        (("plot", path, "--out", folder / "figures", "--format", "csv"), (0, 1, 2)),
        (("show", path), (0, 1, 2)),
        (("classify", path), (0, 1, 2)),
        (("run", folder / "x.yaml", "--out", folder), (0, 2)),
    ):
        path.write_bytes(before)  # which a command before may have given its labels
        done = call(folder, *command)
        assert done.returncode in statuses, command
        assert is_plain(done.stderr, 0 if done.returncode == 3 else done.returncode), command
        assert "Traceback" not in done.stdout + done.stderr, command
        # Status 1 is one case's own: the labels of the other are stored.
        assert done.returncode != 2 or path.read_bytes() == before, command
    assert not Path("owned").exists()


def test_a_locked_file(folder: Path, hodo: Hodo) -> None:
    with open(folder / "x.h5", "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        for command in (("run", "x.yaml", "--out", "."), ("classify", "x.h5"), ("show", "x.h5")):
            done = hodo(*command)
            assert done.returncode == 2
            assert done.stderr == "x.h5: locked: another program has it open for writing\n"


def test_a_package_that_is_missing(folder: Path) -> None:
    script = "import sys; sys.modules['matplotlib'] = None\n"
    script += "from hodo_cli.cli import main\nmain(['plot', 'x.h5'])"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "this needs matplotlib, which is not installed: pip install matplotlib\n"


def hiding(what: str) -> dict[str, str]:
    """The environment of a process that lacks what a folder of the tests hides."""
    path = os.pathsep.join([str(Path(__file__).parent / what), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path}


@pytest.mark.process
def test_taylor_without_heyoka(folder: Path, hodo: Hodo) -> None:
    done = hodo("run", "x.yaml", "--set", "a.method=taylor", env=hiding("without_heyoka"))
    assert done.returncode == 1
    assert "a: failed: method taylor needs heyoka, which is not installed" in done.stderr
    assert "1 of 2 cases did not end well: a (failed)" in done.stderr


@pytest.mark.process
@pytest.mark.heyoka
def test_heyoka_without_quadruple_precision_does_all_else(folder: Path, hodo: Hodo) -> None:
    env = hiding("without_real128")
    taylor = hodo("run", "x.yaml", "--set", "*.method=taylor", env=env)
    assert (taylor.returncode, taylor.stderr) == (0, "")
    quadruple = hodo("run", "x.yaml", "--set", "a.precision=quadruple", env=env)
    assert quadruple.returncode == 1
    assert "a: failed: precision quadruple needs heyoka with real128" in quadruple.stderr
    assert "1 of 2 cases did not end well: a (failed)" in quadruple.stderr
