"""The project's frame: heavy libraries stay where they belong, the locks are complete."""

import ast
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
    branches = (node for node in ast.walk(tree) if isinstance(node, ast.If))
    guards = (node for node in branches if ast.unparse(node.test) == "TYPE_CHECKING")
    for_types = {node for guard in guards for part in guard.body for node in ast.walk(part)}
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
    files = PACKAGE.rglob("*.py")
    return {path.relative_to(PACKAGE).as_posix(): [*imports(path)] for path in files}


@pytest.mark.parametrize("library", IMPORTERS)
def test_a_heavy_library_stays_where_it_belongs(library: str) -> None:
    inner = f"{library}."
    users = [x for x, loaded in modules().items() if any(f"{y}.".startswith(inner) for y in loaded)]
    allowed = tuple(IMPORTERS[library].split())
    assert not [name for name in users if not name.startswith(allowed)]


def test_nothing_imports_the_command_line() -> None:
    used = [name for loaded in modules().values() for name in loaded]
    assert not [name for name in used if re.search(r"(^|\.)cli(\.|$)", name)]


def test_every_target_is_explained() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)
    assert phony
    listed = subprocess.check_output(["make", "-s", "all-targets"], cwd=ROOT, text=True)
    explained = re.findall(r"^  ([a-z]+) ", listed, re.MULTILINE)
    assert ["help", "all-targets", *explained] == phony[1].split()


HEAVY = {*IMPORTERS, "numpy", "pandas"}


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
    said = subprocess.check_output([sys.executable, "-c", script], cwd=folder, text=True)
    printed, _, loaded = said.rpartition("loaded:")
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
