"""Checks that are written for one text, a module for each text, listed by scanning this folder: to
add a text, add a file. Imports claims and the folders below; no other folder knows a paper."""

import pkgutil
from collections.abc import Mapping
from functools import cache
from importlib import import_module

from ..claims.finding import Check, Trend


@cache
def catalogue_of_checks() -> Mapping[str, Check | Trend]:
    """The checks of all texts by the name in a case file: that of the function, with hyphens."""
    return {
        name.replace("_", "-"): item
        for info in pkgutil.iter_modules(__path__)
        for name, item in vars(import_module(f"{__name__}.{info.name}")).items()
        if isinstance(item, Check | Trend)
    }
