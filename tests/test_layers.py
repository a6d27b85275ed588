"""The layers of the package: imports go down only, and every folder is small."""

import ast
import json
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT

PACKAGE = ROOT / "hodo_cli"

# From the ground up; what stands in one row does not see its neighbours.
LAYERS = (
    "text schema progress arithmetic machine",
    "models storage",
    "quantities",
    "cases",
    "engines",
    "integration batch",
    "results",
    "sweeps",
    "claims figures",
    "papers",
    "commands",
    "api cli functions",
)
FLOOR = {name: floor for floor, names in enumerate(LAYERS) for name in names.split()}
# The package itself hands on the Python interface, by name, and loads it at first use.
FLOOR["__init__"] = len(LAYERS)

MODULES = sorted(PACKAGE.rglob("*.py"))


def room(path: Path) -> str:
    """The folder of the package, or the module beside them, that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def rooms_used(path: Path) -> Iterator[str]:
    """The rooms that a file imports from, in functions and for types too."""
    package = ("hodo_cli", *path.relative_to(PACKAGE).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1] + tuple((node.module or "").split("."))
            inner = base if base[-1] else base[:-1]
            names = [(*inner, alias.name) for alias in node.names]
            yield from (parts[1] for parts in names if len(parts) > 1 and parts[1] in FLOOR)


def test_imports_go_down_and_storage_and_integration_are_entered_by_their_doors() -> None:
    for path in MODULES:
        here = room(path)
        for used in rooms_used(path):
            assert used == here or FLOOR[used] < FLOOR.get(here, 0), f"{path} imports {used}"
        text = path.read_text(encoding="utf-8")
        inner = re.findall(r"^ *from \.+(storage|integration)\.", text, re.MULTILINE)
        assert {*inner} <= {here}, path


def test_only_the_scan_of_its_folder_knows_a_paper() -> None:
    folder = PACKAGE / "papers"
    papers = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    for path in MODULES:
        imported = {
            name
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.ImportFrom)
            for name in [*(node.module or "").split("."), *(alias.name for alias in node.names)]
        }
        if path.parent == folder or "papers" in imported:
            assert not imported & papers, f"{path.name} imports {imported & papers}"


def test_every_folder_has_a_floor_and_says_what_it_is() -> None:
    for folder in PACKAGE.iterdir():
        if not folder.is_dir() or folder.name == "__pycache__":
            continue
        assert folder.name in FLOOR
        assert ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
        assert 3 <= len({path.name for path in folder.glob("*.py")} - {"__init__.py"}) <= 9


def test_every_public_name_belongs_to_one_module() -> None:
    """A name that stands in two is read as the same thing, which it is not."""
    modules: dict[str, set[str]] = defaultdict(set)
    for path in MODULES:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names = [node.name]
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = [target.id for target in targets if isinstance(target, ast.Name)]
            else:
                continue
            for name in names:
                if not name.startswith("_"):
                    modules[name].add(path.relative_to(PACKAGE).as_posix())
    assert not {name: files for name, files in modules.items() if len(files) > 1}


FOLDERS = sorted(path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists())

ALONE = """\
import contextlib, importlib, json, os, pkgutil, sys
# Libraries that no folder is asked about take most of the time: they are loaded once.
for name in "click heyoka jinja2 mpl_toolkits.mplot3d scipy.integrate xarray yaml".split():
    with contextlib.suppress(ImportError):
        importlib.import_module(name)
before = {*sys.modules}
assert not {name for name in before if name.startswith(("hodo_cli", "h5py"))}
for folder in sys.argv[1:]:
    if not os.fork():
        package = importlib.import_module("hodo_cli." + folder)
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            importlib.import_module(module.name)
        new = [name.split(".") for name in {*sys.modules} - before]
        rooms = {name[1] for name in new if name[0] == "hodo_cli" and name[1:]}
        names = [folder, *rooms, *{name[0] for name in new} & {"h5py"}]
        os.write(1, f"{json.dumps(names)}\\n".encode())  # at once, beside the others
        os._exit(0)
for _ in sys.argv[1:]:
    os.wait()
"""


@pytest.fixture(scope="module")
def loaded() -> dict[str, set[str]]:
    """By folder, the rooms that are loaded once all its modules are, and h5py."""
    command = [sys.executable, "-c", ALONE, *FOLDERS]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return {folder: set(names) for folder, *names in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_brings_only_what_is_below_it(loaded: dict[str, set[str]], folder: str) -> None:
    rooms = loaded[folder] - {"h5py"}
    assert folder in rooms
    assert {room for room in rooms - {folder} if FLOOR[room] >= FLOOR[folder]} == set()
    # What is below the results computes, and does so without files.
    if FLOOR[folder] < FLOOR["results"] and folder != "storage":
        assert not {"h5py", "storage"} & loaded[folder]
    if folder == "storage":
        assert rooms <= {"storage", *LAYERS[0].split()}
