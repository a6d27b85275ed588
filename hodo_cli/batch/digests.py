"""What a process computes with: the sources of hodo that decide numbers, and the versions of the
libraries, all as they were when the process began."""

import hashlib
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from .. import STARTED, BatchError, models
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


@cache
def source_digests() -> Mapping[str, str]:
    """The digest of each source file that decides numbers, by its path within the package."""
    files = [file for part in SWEPT for file in [PACKAGE / part, *(PACKAGE / part).rglob("*.py")]]
    return {
        str(file.relative_to(PACKAGE)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(files)
        if file.suffix == ".py"
    }


@cache
def _check_sources(modules: int) -> None:
    """Raise BatchError if a source has changed since this process began, which has loaded so many
    modules by now: they may be of the code before the change and of that after it."""
    # A file that is replaced may keep the time of its modification, and Windows does not know that
    # of its change.
    states = [(PACKAGE / name).stat() for name in source_digests()]
    if any(max(state.st_mtime, state.st_ctime) > STARTED for state in states):
        raise BatchError("the code of hodo has changed since this process began: start it anew")


@cache
def code_digest(swept: bool, model: str = "") -> str:
    """The digest of the code that computes single cases, or members of sweeps too, and of the model
    where hodo does not have it."""
    parts = SWEPT if swept else SINGLE
    lines = [
        f"{name} {hash}\n" for name, hash in source_digests().items() if name.startswith(parts)
    ]
    return digest("".join(lines) + (models.added_models_digest(model) if model else ""))


@cache
def library_digest() -> str:
    """The digest of the versions of the libraries that compute."""
    lines = [f"{name} {library_version(name)}\n" for name in COMPUTING_LIBRARIES]
    # `auto` takes other methods where heyoka is hidden or its wheel does not load.
    return digest("".join(lines) + ("" if have_taylor() else "without heyoka"))


def process_digest() -> str:
    """The digest of the code, the libraries and the added models of this process; it travels with
    every result. Raises BatchError if the code has changed meanwhile."""
    # The count is the key of a cache: only modules that were loaded since can be newer.
    _check_sources(len(sys.modules))
    return f"{code_digest(swept=True)}-{library_digest()}{models.added_models_digest()}"


def digest(text: str) -> str:
    """A hash, short enough to be read and long enough that no two texts share it by chance."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]
