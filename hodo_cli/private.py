"""Files that belong to the user alone: a secret, and compiled code, which of all processes of the
user one compiles."""

import hmac
import os
import pickle
import stat
import warnings
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from time import monotonic, sleep
from typing import Any, BinaryIO

HAVE_FLOCK = find_spec("fcntl") is not None
"""Whether the system locks files: Windows has other locks."""

if HAVE_FLOCK:
    import fcntl


def private_folder(variable: str, default: str) -> Path:
    """The folder `hodo` in the folder that an environment variable names, or in `default` of the
    user's home; made with mode 0700 when first asked for.

    Raises ValueError if others can reach it, OSError if it cannot be made, and RuntimeError if
    there is no home.
    """
    parent = Path(os.environ.get(variable, ""))
    folder = (parent if parent.is_absolute() else Path.home() / default) / "hodo"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not (stat.S_ISDIR((status := folder.lstat()).st_mode) and is_private(status)):
        raise ValueError(f"{folder} is not used: it is no folder of yours with mode 0700")
    return folder


def is_private(status: os.stat_result) -> bool:
    """Whether nobody else can read or change a file."""
    # Windows keeps a home for its user, and has no such modes.
    return os.name == "nt" or (
        status.st_uid == os.geteuid() and not stat.S_IMODE(status.st_mode) & 0o077
    )


SECRET_SIZE = 32


@cache
def secret() -> bytes:
    """Random bytes that only this user's processes know, on every machine that shares the home.

    Where a home cannot be written, as on many machines of a CI, they are this process's own.
    """
    try:
        file = private_folder("XDG_STATE_HOME", ".local/state") / "secret"
        if not file.exists():
            _make_secret(file)
        with open(file, "rb", opener=_opened_itself) as stream:
            content, status = stream.read(), os.fstat(stream.fileno())
        if len(content) == SECRET_SIZE and is_private(status):
            return content
        warnings.warn(f"{file} is not used: no {SECRET_SIZE} bytes with mode 0600", stacklevel=2)
    except ValueError as error:
        warnings.warn(str(error), stacklevel=2)
    except (OSError, RuntimeError):
        pass
    return os.urandom(SECRET_SIZE)


def _make_secret(file: Path) -> None:
    """Make the file of the secret whole, and once, however many processes begin together."""
    draft = file.with_name(f"secret.{os.urandom(4).hex()}")
    try:
        with open(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600), "wb") as stream:
            stream.write(os.urandom(SECRET_SIZE))
            stream.flush()
            os.fsync(stream.fileno())
        with suppress(FileExistsError):
            os.link(draft, file)
    finally:
        draft.unlink()


def _opened_itself(path: str, flags: int) -> int:
    """An opener that follows no link."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0))


MOST_CODE = 256 << 20
"""What all of it takes at most: some 25 steps of the largest models, or 250 of others."""

LOCK_PATIENCE = 30.0
"""Seconds for which a process waits for another to compile, which may have been stopped."""

LOCK_POLL = 0.02
"""Seconds between two looks whether it has."""

SEAL = 32


def kept_code(key: str, compiled: Callable[[], Any]) -> Any:
    """What `compiled` returns, from the disk if a process of this user has stored it under this
    key; while one compiles, others wait.

    It is a pickle, which could run anything: so it lies in a folder that is the user's alone, and
    is sealed with the user's secret. Where either cannot be had, it is compiled.
    """
    try:
        file = private_folder("XDG_CACHE_HOME", ".cache") / f"{key}.code"
        stream = _locked(file)
    except (OSError, RuntimeError, ValueError):
        return compiled()
    with stream:
        stored = stream.read()
        if not hmac.compare_digest(stored[:SEAL], _seal(stored[SEAL:])):
            code = compiled()
            with suppress(OSError):  # a full disk leaves what no seal fits
                _store(stream, pickle.dumps(code))
                _remove_oldest(file.parent)
            return code
    with suppress(OSError):
        os.utime(file)
    return pickle.loads(stored[SEAL:])


def _locked(file: Path) -> BinaryIO:
    """A file that no other process has here. Raises OSError if it cannot be had in time."""
    flags = os.O_CREAT | os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    with ExitStack() as failed:
        stream = failed.enter_context(open(os.open(file, flags, 0o600), "r+b"))
        deadline = monotonic() + LOCK_PATIENCE
        while HAVE_FLOCK:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if monotonic() > deadline:
                    raise
                sleep(LOCK_POLL)
        failed.pop_all()
    return stream


def _seal(content: bytes) -> bytes:
    return hmac.digest(secret(), content, "sha256")


def _store(stream: BinaryIO, content: bytes) -> None:
    """Replace what is in a file."""
    stream.seek(0)
    stream.truncate()
    stream.write(_seal(content) + content)
    stream.flush()


def _remove_oldest(folder: Path) -> None:
    """Leave the code that was used last, up to MOST_CODE."""
    total = 0
    for file in sorted(folder.glob("*.code"), key=os.path.getmtime, reverse=True):
        total += file.stat().st_size
        if total > MOST_CODE:
            file.unlink()
