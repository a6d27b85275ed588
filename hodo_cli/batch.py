"""Which cases of a config are to be run, why, and their running."""

import hashlib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from inspect import getfile
from pathlib import Path
from typing import Any

import numpy as np

from . import HodoError, models
from .case import Case, dump
from .integrate import choose, integrate
from .trajectory import Trajectory

PACKAGE = Path(__file__).parent
SHARED = ("rigid.py", "integrate.py", "trajectory.py", "models/base.py", "engines/__init__.py")
ENGINES = {"taylor": ("engines/taylor.py", "heyoka"), "exact": ("exact.py", "numpy")}
REASONS = ("its case has changed", "the code of its model or engine has changed", "its engine is another version")


def fingerprint(case: Case) -> str:
    """What a result depends on, as three hashes: the resolved case, the code of model and engine, the engine."""
    method = choose(case)[0]
    engine, library = ENGINES.get(method, ("engines/ivp.py", "scipy"))
    model = getfile(models.find(case.model, case.form))
    code = "".join(_code(str(PACKAGE / name)) for name in (*SHARED, engine, model))
    return "-".join(hashlib.sha256(part.encode()).hexdigest()[:16] for part in (dump(case), code, _version(library)))


@cache
def _code(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@cache
def _version(library: str) -> str:
    try:
        return f"{library} {version(library)}"
    except PackageNotFoundError:
        return library


def why(case: Case, stored: Mapping[str, Any] | None, force: bool) -> str:
    """Why a case is to be run, given the attributes of its stored group; an empty string if it need not be."""
    if stored is None:
        return "it has no result yet"
    if force:
        return "--force"
    if stored.get("status") != "ok":
        return f"its status is {stored.get('status')}"
    ours, theirs = fingerprint(case).split("-"), str(stored.get("hash", "")).split("-")
    for i, reason in enumerate(REASONS):
        if theirs[i : i + 1] != ours[i : i + 1]:
            return reason
    return ""


def run(cases: list[Case]) -> Iterator[Trajectory]:
    """The cases integrated, one after the other; one that fails comes back with status `failed`."""
    for case in cases:
        yield attempt(case)


def attempt(case: Case) -> Trajectory:
    """A case integrated; a mistake of the user's makes it a failed one."""
    try:
        return integrate(case)
    except HodoError as error:
        model = models.find(case.model, case.form)
        return Trajectory(
            case=case,
            time=np.empty(0),
            state=np.empty((0, len(model.state))),
            exponent=np.empty(0, dtype=np.int64),
            variables={
                name: np.empty((0, *[3] * (len(variable.dims) - 1))) for name, variable in model.variables.items()
            },
            method=case.method,
            method_reason="asked for",
            tol=case.tol or float("nan"),
            steps=0,
            run_time=0.0,
            status="failed",
            message=str(error),
        )
