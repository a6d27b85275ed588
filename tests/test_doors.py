"""What comes with a folder of the package that is imported alone, in a process of its own."""

import json
import subprocess
import sys

import pytest
from test_layers import FLOOR, LAYERS, PACKAGE

FOLDERS = sorted(path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists())

IMPORTS = """\
import contextlib, importlib, json, os, pkgutil, sys
# Libraries that no folder is asked about take most of the time: they are loaded once.
for name in ("click", "heyoka", "matplotlib.backends.backend_agg", "scipy.integrate", "xarray"):
    with contextlib.suppress(ImportError):
        importlib.import_module(name)
before = {*sys.modules}
assert not {name for name in before if name.startswith(("hodo_cli", "h5py"))}
for folder in sys.argv[1:]:
    if not os.fork():
        package = importlib.import_module("hodo_cli." + folder)
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            importlib.import_module(module.name)
        print(json.dumps([folder, sorted({*sys.modules} - before)]), flush=True)
        os._exit(0)
    os.wait()
"""


@pytest.fixture(scope="module")
def loaded() -> dict[str, set[str]]:
    """By folder, the modules that are loaded once all those of it are."""
    command = [sys.executable, "-c", IMPORTS, *FOLDERS]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return {folder: set(names) for folder, names in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_brings_only_what_is_below_it(loaded: dict[str, set[str]], folder: str) -> None:
    modules = loaded[folder]
    rooms = {name.split(".")[1] for name in modules if name.startswith("hodo_cli.")}
    assert folder in rooms
    assert {room for room in rooms - {folder} if FLOOR[room] >= FLOOR[folder]} == set()
    # What is below the results computes, and does so without files.
    if FLOOR[folder] < FLOOR["results"] and folder != "storage":
        assert not {"h5py", "hodo_cli.storage"} & modules
    if folder == "storage":
        assert rooms <= {"storage", *LAYERS[0].split()}
