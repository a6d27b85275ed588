"""What goes wrong outside the program: bad files, no space, missing packages. One line each, and
nothing is lost."""

import fcntl
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Hodo, call

CONFIG = """\
defaults:
  model: linear-diag
  inertia: [1, 0.8, 0.6]
  time: {end: 400, samples: 21}
  initial: {p: 0.8, q: 0.5, r: 0.74}
cases:
  a: {damping: [0.005, 0.004, 0.003]}
  b: {damping: [0.003, 0.004, 0.005]}
figures:
  both: {kind: hodograph, cases: [a, b]}
claims:
  - id: start
    where: here
    statement: It begins about x1 and is damped.
    cases: [a]
    check: {kind: axis, start: x1, end: x3}
    expect: reproduced
"""

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
    "omega is whole": dataset("omega", data=np.zeros((21, 3), dtype="i4")),
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


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a config and its classified result."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "two.yaml").write_text(CONFIG)
    for command in (("run", "two.yaml", "--out", "."), ("classify", "two.h5")):
        assert call(folder, *command).returncode == 0
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    """A copy of that folder."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    return tmp_path


def is_plain(said: str, status: int) -> bool:
    """Whether a command that did not end well said why, briefly and without what a terminal
    obeys."""
    lines = said.splitlines()
    return (
        (status == 0 or bool(lines))
        and len(lines) <= 6
        and all(line.isprintable() for line in lines)
    )


@pytest.mark.parametrize("how", TAMPERINGS)
def test_commands_on_a_result_that_was_tampered_with(folder: Path, how: str) -> None:
    right = shutil.copy(folder / "two.h5", folder / "right.h5")
    path = folder / "two.h5"
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
        (("run", folder / "two.yaml", "--out", folder), (0, 2)),
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
    with open(folder / "two.h5", "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        for command in (
            ("run", "two.yaml", "--out", "."),
            ("classify", "two.h5"),
            ("show", "two.h5"),
        ):
            done = hodo(*command)
            assert done.returncode == 2
            assert done.stderr == "two.h5: locked: another program has it open for writing\n"


def test_a_folder_that_cannot_be(folder: Path, hodo: Hodo) -> None:
    for out in ("two.yaml", "two.yaml/runs", "/proc/runs"):
        done = hodo("run", "two.yaml", "--out", out, "--quiet")
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
    long = folder / f"{'n' * 250}.yaml"
    shutil.copy(folder / "two.yaml", long)
    assert "file name too long" in hodo("run", long).stderr


def test_a_package_that_is_missing(folder: Path) -> None:
    script = "import sys; sys.modules['matplotlib'] = None\n"
    script += "from hodo_cli.cli import main\nmain(['plot', 'two.h5'])"
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
    done = hodo("run", "two.yaml", "--set", "a.method=taylor", env=hiding("without_heyoka"))
    assert done.returncode == 1
    assert "a: failed: method taylor needs heyoka, which is not installed" in done.stderr
    assert "1 of 2 cases did not end well: a (failed)" in done.stderr


@pytest.mark.process
@pytest.mark.heyoka
def test_heyoka_without_quadruple_precision_does_all_else(folder: Path, hodo: Hodo) -> None:
    env = hiding("without_real128")
    taylor = hodo("run", "two.yaml", "--set", "*.method=taylor", env=env)
    assert (taylor.returncode, taylor.stderr) == (0, "")
    quadruple = hodo("run", "two.yaml", "--set", "a.precision=quadruple", env=env)
    assert quadruple.returncode == 1
    assert "a: failed: precision quadruple needs heyoka with real128" in quadruple.stderr
    assert "1 of 2 cases did not end well: a (failed)" in quadruple.stderr
