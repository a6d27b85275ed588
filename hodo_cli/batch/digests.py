"""What a process computes with: the sources of hodo that decide numbers, and the versions of the
libraries, all as they were when the process began."""

import hashlib
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from time import time_ns

from .. import STARTED, BatchError, models
from ..engines import have_taylor
from ..machine import library_version

PACKAGE = Path(__file__).parents[1]

CASE_SOURCES = ("models", "engines", "integration", "arithmetic.py", "schema/expression.py")
"""The sources that decide the numbers of a single case, and what its formulas mean."""

SWEEP_SOURCES = (*CASE_SOURCES, "sweeps", "cases/sweep_block.py")
"""What decides the numbers of a sweep: the members' motions, and how members are made and
reduced."""

COMPUTING_LIBRARIES = ("heyoka", "numpy", "scipy")
"""The libraries whose arithmetic ends up in results."""

CODE_CHANGED = "the code of hodo has changed since this process began: start it anew"


def _states() -> dict[str, tuple[int, int]]:
    """When each source file that decides numbers was last written, in ns since 1970, and its size,
    by its path within the package."""
    # A part is a module, or a folder of modules.
    files = [
        file for part in SWEEP_SOURCES for file in [PACKAGE / part, *(PACKAGE / part).rglob("*.py")]
    ]
    states = {file: file.stat() for file in sorted(files) if file.suffix == ".py"}
    return {
        file.relative_to(PACKAGE).as_posix(): (state.st_mtime_ns, state.st_size)
        for file, state in states.items()
    }


def _digests(names: Iterable[str]) -> dict[str, str]:
    return {name: hashlib.sha256((PACKAGE / name).read_bytes()).hexdigest() for name in names}


_LOADED, _LOADED_AT = _states(), time_ns()
"""The sources as they were when this module was loaded, which those that compute are loaded with.
Not the times at which their inodes changed: a hard link or a change of rights sets these too.
With the time of that, in ns since 1970."""


@cache
def source_digests() -> Mapping[str, str]:
    """The digest of each source file that decides numbers, by its path within the package. Raises
    BatchError if one has changed since it was loaded."""
    digests = _digests(name for name in _LOADED if (PACKAGE / name).exists())
    # Of a clock that is ahead, or of an archive, a file may have a time that is still to come.
    is_new = any(STARTED * 1e9 < written <= _LOADED_AT for written, _ in _LOADED.values())
    if is_new or _states() != _LOADED:
        raise BatchError(CODE_CHANGED)
    return digests


@cache
def _check_sources(modules: int) -> None:
    """Raise BatchError if a source has changed since this process began, which has loaded so many
    modules by now: they may be of the code before the change and of that after it."""
    # What was touched, or copied back, is the same.
    if (states := _states()) != _LOADED and _digests(states) != source_digests():
        raise BatchError(CODE_CHANGED)


@cache
def code_digest(swept: bool, model: str = "") -> str:
    """The digest of the code that computes single cases, or members of sweeps too, and of the model
    where hodo does not have it."""
    parts = SWEEP_SOURCES if swept else CASE_SOURCES
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
