"""What comes with a folder of the package that is imported alone, in an interpreter of its own."""

import subprocess
import sys

import pytest
from test_layers import FLOOR, LAYERS, PACKAGE

FOLDERS = sorted(path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists())

IMPORT = """\
import importlib, pkgutil, sys
package = importlib.import_module("hodo_cli." + sys.argv[1])
for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
    importlib.import_module(module.name)
print(*sys.modules)
"""


def loaded_with(folder: str) -> set[str]:
    """The modules that are loaded once all those of a folder are."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORT, folder], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_folder_brings_only_what_is_below_it(folder: str) -> None:
    modules = loaded_with(folder)
    rooms = {name.split(".")[1] for name in modules if name.startswith("hodo_cli.")}
    assert folder in rooms
    assert {room for room in rooms - {folder} if FLOOR[room] >= FLOOR[folder]} == set()
    # What is below the results computes, and does so without files.
    if FLOOR[folder] < FLOOR["results"] and folder != "storage":
        assert not {"h5py", "hodo_cli.storage"} & modules
    if folder == "storage":
        assert rooms <= {"storage", *LAYERS[0].split()}
