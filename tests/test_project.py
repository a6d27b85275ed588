"""The project's frame: heavy libraries stay where they belong, the locks are complete."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path

import pytest
from conftest import ROOT, Hodo

PACKAGE = ROOT / "hodo_cli"

# A heavy library and the only modules that may import it; netCDF4 is for those who read results.
IMPORTERS = {
    "dask": "batch.py",
    "distributed": "batch.py",
    "h5py": "storage/hdf5.py storage/store.py",
    "heyoka": "engines/taylor.py engines/taylor_batch.py",
    "matplotlib": "figures/ api.py",
    "netCDF4": "",
    "scipy": "engines/scipy_ivp.py figures/maps.py figures/space.py quantities.py",
    "tqdm": "progress.py",
    "xarray": "results/dataset.py api.py",
    "yaml": "schema/document.py",
}


def imports(path: Path) -> Iterator[str]:
    """Every dotted name that a file imports when it runs; relative ones begin with dots."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    guards = (
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    for_types = {
        node for guard in guards for statement in guard.body for node in ast.walk(statement)
    }
    for node in ast.walk(tree):
        if node in for_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            separator = "" if module.endswith(".") else "."
            yield from (f"{module}{separator}{alias.name}" for alias in node.names)


@cache
def modules() -> dict[str, list[str]]:
    """What each module of the package imports."""
    return {
        path.relative_to(PACKAGE).as_posix(): list(imports(path)) for path in PACKAGE.rglob("*.py")
    }


@pytest.mark.parametrize("library", IMPORTERS)
def test_a_heavy_library_stays_where_it_belongs(library: str) -> None:
    users = {
        name
        for name, loaded in modules().items()
        if any(f"{used}.".startswith(f"{library}.") for used in loaded)
    }
    allowed = tuple(IMPORTERS[library].split())
    assert not [name for name in users if not name.startswith(allowed)]


def test_nothing_imports_the_command_line() -> None:
    assert not [
        name
        for name, loaded in modules().items()
        if any(re.search(r"(^|\.)cli(\.|$)", used) for used in loaded)
    ]


def test_every_target_is_explained() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony
    listed = subprocess.run(
        ["make", "-s", "all-targets"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    explained = re.findall(r"^  ([a-z]+) ", listed, re.MULTILINE)
    assert ["help", "all-targets", *explained] == phony[1].split()


HEAVY = {
    "numpy",
    "scipy",
    "h5py",
    "xarray",
    "matplotlib",
    "heyoka",
    "netCDF4",
    "yaml",
    "pandas",
    "dask",
    "tqdm",
}


def loaded_by(folder: Path, *arguments: str) -> tuple[str, set[str]]:
    """What `hodo ARGUMENTS` prints in a fresh interpreter, and the heavy libraries and rooms that
    it loads."""
    heavy = (*HEAVY, "hodo_cli.sweeps", "hodo_cli.figures", "hodo_cli.claims")
    script = (
        "import sys\n"
        "from hodo_cli.cli import main\n"
        f"main({list(arguments)!r}, standalone_mode=False)\n"
        f"print('loaded:', *(name for name in {heavy!r} if sys.modules.get(name)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=True
    )
    printed, _, loaded = done.stdout.rpartition("loaded:")
    return printed, set(loaded.split())


def test_help_loads_nothing_heavy(tmp_path: Path) -> None:
    printed, loaded = loaded_by(tmp_path, "--help")
    assert printed.startswith("Usage:")
    assert loaded == set()


@pytest.mark.heyoka
def test_run_loads_what_it_uses(tmp_path: Path) -> None:
    body = "inertia: [1, 0.8, 0.6], initial: {p: 1, q: 1, r: 1}"
    case = f"{{model: linear-diag, {body}, damping: [1, 2, 3], time: {{end: 1}}}}"
    (tmp_path / "tiny.yaml").write_text(f"title: t\ncases:\n  tiny: {case}\n", encoding="utf-8")
    _, loaded = loaded_by(tmp_path, "run", "tiny.yaml")
    assert loaded == {"numpy", "h5py", "heyoka", "yaml"}
    assert (tmp_path / "runs" / "tiny.h5").exists()


@pytest.mark.process
def test_the_console_script_runs(hodo: Hodo) -> None:
    from hodo_cli import __version__

    done = hodo("--version")
    assert done.returncode == 0, done.stderr
    assert __version__ in done.stdout


def test_heyoka_can_be_hidden_from_processes() -> None:
    hidden = os.environ | {"PYTHONPATH": str(ROOT / "tests" / "without_heyoka")}
    done = subprocess.run(
        [sys.executable, "-c", "import heyoka"], env=hidden, capture_output=True, text=True
    )
    assert "import of heyoka halted" in done.stderr


LOCKS = ("requirements.lock", "requirements-dev.lock")


def pinned(lock: str) -> dict[str, set[str]]:
    """The versions of each package in a lock file; several where they depend on Python's."""
    text, found = (ROOT / lock).read_text(encoding="utf-8"), dict[str, set[str]]()
    for name, version in re.findall(r"^([a-z0-9-]+)==(.*?) \\$", text, re.MULTILINE):
        found.setdefault(name, set()).add(version.split(" ;")[0])
    return found


def wanted(*extras: str) -> set[str]:
    """The packages that the project itself asks for, with some of its extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = (project["optional-dependencies"][extra] for extra in extras)
    names = chain(project["dependencies"], *optional)
    return {re.match(r"[A-Za-z0-9-]+", name)[0].lower() for name in names}


def test_the_locks_cover_every_dependency() -> None:
    assert wanted("build") <= set(pinned("requirements.lock"))
    assert wanted("build", "dask", "test", "lint") <= set(pinned("requirements-dev.lock"))


def test_running_installs_no_tool_of_the_tests() -> None:
    tools = wanted("dask", "test", "lint") - wanted("build")
    assert not tools & set(pinned("requirements.lock"))


def test_the_locks_agree() -> None:
    running, tests = map(pinned, LOCKS)
    assert running == {name: tests[name] for name in running}


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_pins_versions_by_hash_and_names_no_host(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    for entry in re.split(r"\n(?=[a-z])", text)[1:]:
        assert re.match(r"[a-z0-9-]+==\S+( ; [^\\]+)? \\\n    --hash=sha256:", entry), entry[:80]
    assert not re.search(r"://|^-|file:", text, re.MULTILINE)
