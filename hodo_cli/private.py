"""Compiled code that is kept for later processes, in a folder of the user's own."""

import hashlib
import os
import pickle
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any


def cache_folder() -> Path:
    """The folder of hodo's compiled code, which the user alone can reach.

    Raises OSError if it cannot be made, or others can reach it, and RuntimeError if there is no
    home.
    """
    parent = Path(os.environ.get("XDG_CACHE_HOME", ""))
    folder = (parent if parent.is_absolute() else Path.home() / ".cache") / "hodo"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.lstat()
    # Windows keeps a home for its user, and has no such modes.
    if os.name != "nt" and (status.st_uid, status.st_mode & 0o077) != (os.geteuid(), 0):
        raise PermissionError(f"{folder} is not used: it is no folder of yours with mode 0700")
    return folder


MOST_FILES = 250
"""Files that are kept: 256 MB of steps, or 10 times as many of the largest models."""


def cached_code(key: str, compiled: Callable[[], Any]) -> Any:
    """What `compiled` returns, from the disk if a process has stored it under this key.

    It is a pickle, which could run anything: so it lies in a folder that is the user's alone. Its
    hash stands before it, since of other bytes, such as those of another version, a pickle makes
    anything too.
    """
    try:
        file = cache_folder() / f"{key}.code"
    except (OSError, RuntimeError):
        return compiled()
    with suppress(OSError):
        stored = file.read_bytes()
        if hashlib.sha256(stored[32:]).digest() == stored[:32]:
            os.utime(file)
            return pickle.loads(stored[32:])
    code = compiled()
    with suppress(OSError):  # the disk is full
        # Its name says so, that drafts which a kill has left go with the oldest.
        draft = file.with_name(f"{file.name}.{os.getpid()}")
        data = pickle.dumps(code)
        draft.write_bytes(hashlib.sha256(data).digest() + data)
        os.replace(draft, file)
        for old in sorted(file.parent.glob("*.code*"), key=os.path.getmtime)[:-MOST_FILES]:
            old.unlink(missing_ok=True)
    return code
