"""What a result says of its own making: time, command, versions, commit."""

import re
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from .. import HodoError, __version__
from ..machine import library_version

FORMAT_VERSION = 1
"""The version of the result files' format, which is raised when older readers would misread newer
files."""

CONTENT = "content"
"""The attribute of a file without cases that says what it holds."""

# A dataset that xarray has read from a file has numpy's numbers for attributes.
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


def result_of(config: Path | str) -> Path:
    """The result of a config, where it is not written into another folder."""
    return Path("runs") / f"{Path(config).stem}.h5"


def history_line(command: str) -> str:
    """A line of history: the time, UTC, and the command."""
    return f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {command}"


def root_attributes(
    command: str, title: str, references: str, config: str, more: Mapping[str, str]
) -> dict[str, str]:
    """The root attributes of a result that a command makes, besides the version of its format;
    `config` is the case file's text. Of `more` those are left out that are empty."""
    return {
        "Conventions": "CF-1.11",
        "title": title,
        "source": f"hodo {__version__}",
        "references": references,
        "history": history_line(command),
        **versions(),
        "config": config,
        **{name: text for name, text in more.items() if text},
    }


def versions() -> dict[str, str]:
    """The versions of Python and the libraries that count, and the commit of hodo where it
    runs from its own git checkout."""
    libraries = {f"{library}_version": library_version(library) for library in STORED_VERSIONS}
    return {"python_version": sys.version.split()[0], **libraries, **_commit()}


def _commit() -> dict[str, str]:
    """The commit of the package's own checkout, and whether it has changes; empty if the package is
    not in one."""
    project = Path(__file__).parents[2]
    # Without the option git would refresh its index, and get in the way of the user's own git.
    command = ("git", "--no-optional-locks", "status", "--porcelain=v2", "--branch", "hodo_cli")
    try:
        # A copy of the package may stand in a checkout of something else.
        is_own = 'name = "hodo"\n' in (project / "pyproject.toml").read_text("utf-8", "replace")
        if not is_own or not (project / ".git").exists():
            return {}
        done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return {}
    if not (commit := re.search(r"^# branch.oid ([0-9a-f]+)$", done.stdout, re.MULTILINE)):
        return {}
    is_dirty = any(not line.startswith("#") for line in done.stdout.splitlines())
    return {"git_commit": commit[1], "git_dirty": "yes" if is_dirty else "no"}
