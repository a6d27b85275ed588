"""What a result says of its own making: time, command, versions, commit."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from .. import HodoError, __version__
from ..machine import library_version

FORMAT_VERSION = 1
"""The version of the result files' format, which is raised when older readers would misread newer
files."""

TYPE_NAMES = {str: ("text", str), int: ("whole number", Integral), float: ("number", Real)}

STORED_VERSIONS = ("numpy", "scipy", "heyoka", "h5py")


def typed(attributes: Mapping[str, Any], kinds: Mapping[str, type], owner: str) -> dict[str, Any]:
    """The attributes of these names. Raises HodoError if one is missing or not of its kind: str,
    int or float."""
    for name, kind in kinds.items():
        words, wanted = TYPE_NAMES[kind]
        if not isinstance(attributes.get(name), wanted):
            raise HodoError(f"{owner} is damaged (its {name} is no {words})")
    return {name: attributes[name] for name in kinds}


def history_line(command: str) -> str:
    """A line of history: the time, UTC, and the command."""
    return f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {command}"


def root_attributes(title: str, references: str, config: str, history: str) -> dict[str, str | int]:
    """The root attributes of a result; `config` is the case file's text, `history` a line made by
    `history_line`."""
    return {
        "Conventions": "CF-1.11",
        "title": title,
        "source": f"hodo {__version__}",
        "references": references,
        "history": history,
        "format_version": FORMAT_VERSION,
        **versions(),
        "config": config,
    }


def versions() -> dict[str, str]:
    """The versions of Python and the libraries that count, and the commit of hodo where it
    runs from its own git checkout."""
    # Started first and read last: git takes longer than all the rest.
    git = _git_status()
    known = {"python_version": sys.version.split()[0]}
    known |= {f"{library}_version": library_version(library) for library in STORED_VERSIONS}
    status = git.communicate()[0] if git else ""
    commit = re.search(r"^# branch.oid ([0-9a-f]+)$", status, re.MULTILINE)
    if commit:
        dirty = any(not line.startswith("#") for line in status.splitlines())
        known |= {"git_commit": commit[1], "git_dirty": "yes" if dirty else "no"}
    return known


def _git_status() -> "subprocess.Popen[str] | None":
    """A process that prints the commit and the changes of the package's own checkout; None if it is
    not in one."""
    package = Path(__file__).parents[1]
    # A copy of the package may stand in a checkout of something else.
    if not (package.parent / ".git").exists() or not _is_own(package.parent / "pyproject.toml"):
        return None
    command = [
        "git",
        # Or git would refresh its index, and get in the way of the user's own git.
        "--no-optional-locks",
        "-C",
        str(package),
        "status",
        "--porcelain=v2",
        "--branch",
        "--",
        ".",
    ]
    with suppress(OSError):
        return subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
    return None


def _is_own(project: Path) -> bool:
    """Whether a pyproject.toml is that of hodo."""
    try:
        return bool(tomllib.loads(project.read_text("utf-8"))["project"]["name"] == "hodo")
    except (OSError, ValueError, KeyError):
        return False
