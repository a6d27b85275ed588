"""What need not be done again: whether a stored case is still right, and what a command has told of
stored data. While the data and hodo itself are the same, that is told again and not computed
anew."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np

from .. import models
from ..batch.mark import PACKAGE, code, digest, libraries
from ..cases.case import Case, dump
from ..results.hdf5 import Attribute, Group
from ..results.writer import Finished

FORCED = "--force"

MARK, TOLD = "told_mark", "told"
"""The attributes of a group: what it was told of, as a hash, and what was told, as JSON."""

# In this order, because another version of hodo may write the same case in other words.
REASONS = (
    "the code that computes it has changed",
    "heyoka, numpy or scipy is another version",
    "its case has changed",
)


def fingerprint(case: Case) -> str:
    """What a result depends on, as three hashes: the code of models, engines and integration (of
    sweeps too, where the case is one), the libraries, and the case without its remarks.

    Nothing is integrated for it: the method that `auto` takes follows from the three.
    """
    return "-".join(
        (code(bool(case.sweep), case.model), libraries(), digest(dump(case, remarks=False)))
    )


def why(case: Case, done: Finished | None, force: bool) -> str:
    """Why a case is to be run, given what is stored of it; an empty string if it need not be."""
    if done is None:
        return "it has no result yet"
    if done.damage:
        return f"its stored result is damaged ({done.damage})"
    if force:
        return FORCED
    # A timeout may be due to another program's work, so what did not end well is tried again.
    if (status := str(done.attributes.get("status"))) != "ok":
        return f"its status is {status}"
    ours, theirs = fingerprint(case).split("-"), str(done.attributes.get("hash")).split("-")
    for i, reason in enumerate(REASONS):
        if theirs[i : i + 1] != ours[i : i + 1]:
            return reason
    return ""


@cache
def package_mark() -> str:
    """The hash of all sources of hodo, of models that are not its own, and of the libraries that
    compute."""
    sources = hashlib.sha256((libraries() + models.foreign_mark()).encode())
    for file in sorted(PACKAGE.rglob("*.py")):
        sources.update(file.read_bytes())
    return sources.hexdigest()


def content_mark(groups: Iterable[Group], text: str = "") -> str:
    """The hash of stored groups, of a text, and of the code that would compute from them."""
    content = hashlib.sha256((package_mark() + text).encode())
    for group in groups:
        content.update(_words({k: v for k, v in group.attributes.items() if k not in (MARK, TOLD)}))
        for name, variable in sorted(group.variables.items()):
            content.update(_words({"name": name, "dims": variable.dims}))
            data = np.ascontiguousarray(variable.data)
            numbers = data.dtype.kind in "fiu"
            content.update(data.data if numbers and data.size else _words({"data": data}))
    return content.hexdigest()


def _words(values: Mapping[str, Any]) -> bytes:
    # As plain lists and numbers, because a file gives back numpy's where Python's were written.
    return repr(sorted((k, np.asarray(v).tolist()) for k, v in values.items())).encode()


def told(group: Group, mark: str) -> Any:
    """What was told of a group at the same mark; None if nothing was."""
    if group.attributes.get(MARK) != mark:
        return None
    return json.loads(str(group.attributes[TOLD]))


def telling(mark: str, what: Any) -> dict[str, Attribute]:
    """What is told at a mark, as attributes."""
    return {MARK: mark, TOLD: json.dumps(what)}
