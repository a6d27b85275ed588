"""What a result states about its own making: time, command, versions, commit."""

import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from .. import HodoError, __version__
from ..machine import library_version

FORMAT_VERSION = 1
"""The version of the format of result files, raised when older readers would misread new files."""

CONTENT = "content"
"""The attribute that states the content of a file without cases."""

# Datasets that xarray has read from a file have numpy's numbers as attributes.
KINDS = {str: ("text", str), int: ("whole number", Integral), float: ("number", Real)}


def typed(attributes: Mapping[str, Any], kinds: Mapping[str, type], owner: str) -> dict[str, Any]:
    """The attributes of these names. Raises HodoError if one is missing or is not of its type: str,
    int or float."""
    for name, kind in kinds.items():
        words, wanted = KINDS[kind]
        if not isinstance(attributes.get(name), wanted):
            raise HodoError(f"{owner} is damaged (its {name} is no {words})")
    return {name: attributes[name] for name in kinds}


def result_of(config: Path | str) -> Path:
    """The path of a config's result, unless another folder is given."""
    return Path("runs") / f"{Path(config).stem}.h5"


def history_line(command: str) -> str:
    """A line of history: the time, UTC, and the command."""
    return f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {command}"


def root_attributes(
    command: str, title: str, references: str, config: str, more: Mapping[str, str]
) -> dict[str, str]:
    """The root attributes of a result that a command makes of a case file with the text `config`;
    empty texts of `more` are left out."""
    libraries = ("numpy", "scipy", "heyoka", "h5py")
    return {
        "Conventions": "CF-1.11",
        "title": title,
        "source": f"hodo {__version__}",
        "references": references,
        "history": history_line(command),
        "python_version": sys.version.split()[0],
        **{f"{library}_version": library_version(library) for library in libraries},
        **commit(),
        "config": config,
        **{name: text for name, text in more.items() if text},
    }


def commit() -> dict[str, str]:
    """The commit of hodo, and whether it has changes, if hodo runs from its own git checkout."""
    project = Path(__file__).parents[2]
    command = ("git", "--no-optional-locks", "describe", "--always", "--abbrev=40", "--dirty")
    with suppress(OSError, subprocess.CalledProcessError):
        if (project / ".git").exists():
            done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=True)
            number = done.stdout.strip()
            dirty = "yes" if number.endswith("-dirty") else "no"
            return {"git_commit": number.removesuffix("-dirty").split("-g")[-1], "git_dirty": dirty}
    return {}
