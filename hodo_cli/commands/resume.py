"""Whether a stored case is still right, or has to run again, and why."""

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from inspect import getfile
from pathlib import Path

from .. import models
from ..cases.case import Case, dump
from ..integration.choice import choose
from ..results.writer import Finished

PACKAGE = Path(__file__).parents[1]
SHARED = (
    "models/rigid_body.py",
    "integration/driver.py",
    "integration/solve.py",
    "integration/error.py",
    "integration/integrate.py",
    "integration/trajectory.py",
    "models/base.py",
    "engines/protocol.py",
    "engines/stepwise.py",
)
ENGINES = {
    "taylor": ("engines/taylor.py", "heyoka"),
    "collocation": ("engines/collocation.py", "numpy"),
    "exact": ("models/closed_form.py", "numpy"),
}
SWEPT = (
    "cases/sweep_block.py",
    "sweeps/members.py",
    "sweeps/sweep.py",
    "sweeps/ensemble.py",
    "integration/classify.py",
    "engines/taylor_batch.py",
)
FORCED = "--force"
REASONS = (
    "its case has changed",
    "the code of its model or engine has changed",
    "its engine is another version",
)


def fingerprint(case: Case) -> str:
    """What a result depends on, as three hashes: the resolved case, the code of model and engine,
    the engine."""
    method = choose(case)[0]
    engine, library = ENGINES.get(method, ("engines/scipy_ivp.py", "scipy"))
    model = getfile(models.find(case.model, case.form))
    code = "".join(
        _code(str(PACKAGE / name))
        for name in (*SHARED, *(SWEPT if case.sweep else ()), engine, model)
    )
    return "-".join(
        hashlib.sha256(part.encode()).hexdigest()[:16]
        for part in (dump(case), code, _version(library))
    )


@cache
def _code(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@cache
def _version(library: str) -> str:
    try:
        return f"{library} {version(library)}"
    except PackageNotFoundError:
        return library


def why(case: Case, done: Finished | None, force: bool) -> str:
    """Why a case is to be run, given what is stored of it; an empty string if it need not be."""
    if done is None:
        return "it has no result yet"
    if force:
        return FORCED
    if (status := str(done.attributes.get("status"))) != "ok":
        return f"its status is {status}"
    ours, theirs = fingerprint(case).split("-"), str(done.attributes.get("hash")).split("-")
    for i, reason in enumerate(REASONS):
        if theirs[i : i + 1] != ours[i : i + 1]:
            return reason
    return ""
