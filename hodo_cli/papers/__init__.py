"""Checks that are written for one text, a module for each text, listed in `checks.yaml`. Imports
claims and the folders below; no other folder knows a paper."""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from ..cases.claim_block import checks_of_papers
from ..claims.finding import Finding


def finding_of(name: str, motions: Sequence[Any]) -> Finding:
    """The finding of the check that case files call by this name; its function has the same name
    with underscores for hyphens."""
    module = import_module(f"{__name__}.{checks_of_papers()[name][0]}")
    check: Callable[[Sequence[Any]], Finding] = getattr(module, name.replace("-", "_"))
    return check(motions)
