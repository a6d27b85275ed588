"""What a process computes with: the sources of hodo that decide numbers, and the versions of the
libraries, all as they were when the process began."""

import hashlib
from functools import cache
from pathlib import Path

from .. import models
from ..engines import have_taylor
from ..machine import library_version

PACKAGE = Path(__file__).parents[1]

SINGLE = ("models", "engines", "integration", "arithmetic.py")
"""The sources that decide the numbers of a single case."""

SWEPT = (*SINGLE, "sweeps", "cases/sweep_block.py")
"""What decides the numbers of a sweep: the members' motions, and how members are made and
reduced."""

COMPUTING_LIBRARIES = ("heyoka", "numpy", "scipy")
"""The libraries whose arithmetic ends up in results."""


def _sources() -> dict[str, str]:
    """The digest of each source file that decides numbers, by its path within the package."""
    files = [file for part in SWEPT for file in [PACKAGE / part, *(PACKAGE / part).rglob("*.py")]]
    return {
        str(file.relative_to(PACKAGE)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(files)
        if file.suffix == ".py"
    }


# Read while the modules themselves are being imported: a source that is edited later, during a run,
# is not what this process computes with.
SOURCES_AT_START = _sources()


@cache
def code_digest(swept: bool, model: str = "") -> str:
    """The digest of the code that computes single cases, or members of sweeps too, and of the model
    where hodo does not have it."""
    parts = SWEPT if swept else SINGLE
    lines = [
        f"{name} {hash}\n" for name, hash in SOURCES_AT_START.items() if name.startswith(parts)
    ]
    return digest("".join(lines) + (models.added_models_digest(model) if model else ""))


@cache
def library_digest() -> str:
    """The digest of the versions of the libraries that compute."""
    lines = [f"{name} {library_version(name)}\n" for name in COMPUTING_LIBRARIES]
    # `auto` takes other methods where heyoka is hidden or its wheel does not load.
    return digest("".join(lines) + ("" if have_taylor() else "without heyoka"))


def process_digest() -> str:
    """What this process computes with; it travels with every result."""
    return f"{code_digest(swept=True)}-{library_digest()}{models.added_models_digest()}"


def digest(text: str) -> str:
    """A hash, short enough to be read and long enough that no two texts share it by chance."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]
