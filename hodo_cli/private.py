"""Files that belong to the user alone: a secret, compiled code, and models that were used."""

import hmac
import os
import pickle
import stat
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any


def private_folder(variable: str, default: str) -> Path:
    """The folder `hodo` in the folder that an environment variable names, or in `default` of the
    user's home; made with mode 0700 when first asked for.

    Raises ValueError if others can reach it, OSError if it cannot be made, and RuntimeError if
    there is no home.
    """
    parent = Path(os.environ.get(variable, ""))
    folder = (parent if parent.is_absolute() else Path.home() / default) / "hodo"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.lstat()
    # Windows keeps a home for its user, and has no such modes.
    is_private = os.name == "nt" or (status.st_uid, status.st_mode & 0o077) == (os.geteuid(), 0)
    if not (stat.S_ISDIR(status.st_mode) and is_private):
        raise ValueError(f"{folder} is not used: it is no folder of yours with mode 0700")
    return folder


STATE_FOLDER, CACHE_FOLDER = ("XDG_STATE_HOME", ".local/state"), ("XDG_CACHE_HOME", ".cache")
"""Where the private folders are, as `private_folder` takes them."""

SECRET_SIZE = 32


@cache
def secret() -> bytes:
    """Random bytes that only this user's processes know, on every machine that shares the home.

    Where a home cannot be written, as on many machines of a CI, they are this process's own.
    """
    with suppress(OSError, RuntimeError):
        try:
            return _stored_secret()
        except ValueError as error:
            warnings.warn(str(error), stacklevel=2)
    return os.urandom(SECRET_SIZE)


def _stored_secret() -> bytes:
    """The content of the user's file, which is made when first asked for. Raises ValueError if it
    has another size, and as `private_folder`."""
    file = private_folder(*STATE_FOLDER) / "secret"
    if not file.exists():
        draft = _draft(file, os.urandom(SECRET_SIZE))
        try:
            # Whole, and once, however many processes begin together.
            with suppress(FileExistsError):
                os.link(draft, file)
        finally:
            draft.unlink()
    content = file.read_bytes()
    if len(content) != SECRET_SIZE:
        raise ValueError(f"{file} is not used: it has not {SECRET_SIZE} bytes")
    return content


def _draft(file: Path, content: bytes) -> Path:
    """A new file beside another, whole on the disk and with mode 0600."""
    draft = file.with_name(f"{file.name}.{os.urandom(4).hex()}")
    with open(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    return draft


MOST_CODE = 256 << 20
"""What all of it takes at most: some 25 steps of the largest models, or 250 of others."""

SEAL_BYTES = 32


def cached_code(key: str, compiled: Callable[[], Any]) -> Any:
    """What `compiled` returns, from the disk if a process of this user has stored it under this
    key.

    It is a pickle, which could run anything: so it lies in a folder that is the user's alone, and
    is sealed with the user's secret. Where either cannot be had, it is compiled.
    """
    try:
        file = private_folder(*CACHE_FOLDER) / f"{key}.code"
    except (OSError, RuntimeError, ValueError):
        return compiled()
    stored = b""
    with suppress(OSError):
        stored = file.read_bytes()
        os.utime(file)
    if hmac.compare_digest(stored[:SEAL_BYTES], _seal(stored[SEAL_BYTES:])):
        return pickle.loads(stored[SEAL_BYTES:])
    code = compiled()
    with suppress(OSError):  # the disk is full
        content = pickle.dumps(code)
        os.replace(_draft(file, _seal(content) + content), file)
        _remove_oldest(file.parent)
    return code


def _seal(content: bytes) -> bytes:
    return hmac.digest(secret(), content, "sha256")


def _remove_oldest(folder: Path) -> None:
    """Leave the code that was used last, up to MOST_CODE; drafts that a kill has left count too."""
    total = 0
    for file in sorted(folder.glob("*.code*"), key=os.path.getmtime, reverse=True):
        total += file.stat().st_size
        if total > MOST_CODE:
            file.unlink()
