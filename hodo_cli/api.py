"""The Python interface: what a notebook uses. A case is a mapping of the keys of a case file, and
every result is an `xarray.Dataset`.

    import hodo_cli as hodo
    ds = hodo.run({"model": "linear-diag", "inertia": [1, 0.8, 0.6], ...})
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from numbers import Integral
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, overload

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from . import HodoError
from .batch import check_memory
from .cases.case import Case, as_plain
from .cases.config import composed_text, parse
from .cases.figure_block import FIGURE, FIGURE_KINDS, merged_style
from .commands.classify import classified, classify_results
from .commands.run import finished_case, plans, run_plans
from .figures import draw, user_parameters
from .quantities import QUANTITIES, derivable, stored_name
from .results.dataset import (
    StoredCases,
    cases_of_file,
    dataset,
    motion_from,
    quantity_array,
    sweep_axes,
)
from .results.resume import stored_config
from .schema.document import Source, read_mapping
from .schema.kinds import Wrong, check_tagged
from .schema.spelling import nearest, shown
from .storage import open_run
from .sweeps.view import SweepView

__all__ = ["Case", "derive", "open", "plot", "run", "sweep"]

Given = Mapping[str, Any] | Case

as_usual = np.errstate(under="ignore")
"""Numbers below the smallest double become 0 here, whatever the user's own `np.seterr`."""


@overload
def run(
    case: Given, *, name: str = "case", classify: bool = True, jobs: int = 1,
    to: Path | str | None = None,
) -> xr.Dataset: ...  # fmt: skip


@overload
def run(
    case: Iterable[Given], *, name: str = "case", classify: bool = True, jobs: int = 1,
    to: Path | str | None = None,
) -> list[xr.Dataset]: ...  # fmt: skip


@as_usual
def run(
    case: Given | Iterable[Given],
    *,
    name: str = "case",
    classify: bool = True,
    jobs: int = 1,
    to: Path | str | None = None,
) -> xr.Dataset | list[xr.Dataset]:
    """Integrate a case, measure its error, and label the axis that its hodograph encloses.

    `case` has the keys of a case file, or is a `Case`; figures call it `name`. The dataset holds
    the model's variables over `time`, the events of the motion and, if an enclosed axis is defined
    and `classify` is not False, `enclosed_axis` and the separatrix crossings. `attrs` holds the
    method, the measured `error`, the status and the case itself.

    Several cases give a list of datasets, made in `jobs` processes; cases without a name of their
    own are called case1, case2 and so on. `to` names a result file that every command reads:
    unchanged cases in it are not integrated again, and other cases stay in it.

    Raises HodoError, one line a mistake, if a case is not right, is a sweep, or needs a method that
    is not installed, or if the file cannot be written. A case that fails has an `attrs["status"]`
    other than "ok".
    """
    jobs = _checked_jobs(jobs)
    if not isinstance(classify, bool | np.bool_):
        raise _wrong("classify: expected True or False", classify)
    path = None if to is None else _path("to: expected a name that ends with .h5", to)
    if is_one := isinstance(case, Case | Mapping | str) or not isinstance(case, Iterable):
        cases = [_case(case, name)]
    else:
        cases = [_case(item, f"{name}{i}") for i, item in enumerate(case, 1)]
    if any(case.sweep for case in cases):
        raise HodoError("sweep: this case is a sweep: use hodo.sweep")
    if not cases:
        return []
    if path is None and is_one:
        return _integrated(cases[0], classify)
    # Several cases run as in `hodo run`, which makes a file.
    datasets = _stored(cases, path, jobs, classify)
    return datasets[0] if is_one else datasets


def _integrated(made: Case, classify: bool) -> xr.Dataset:
    """The dataset of a case, without a file."""
    check_memory(made)
    group = finished_case(made)
    labels = classified(made.name, group, made)[0] if classify else None
    return dataset(group if labels is None else group.with_addition(labels))


def _stored(
    cases: Sequence[Case], path: Path | None, jobs: int, classify: bool
) -> list[xr.Dataset]:
    """The datasets of cases that run as in `hodo run`, into the result file `path` or, without a
    path, into a temporary one."""
    if path is None:
        with TemporaryDirectory(prefix="hodo-") as folder:
            datasets = _stored(cases, Path(folder) / "cases.h5", jobs, classify)
        for data in datasets:
            del data.encoding["source"]  # the file is gone
        return datasets
    if path.suffix != ".h5":
        raise _wrong("to: expected a name that ends with .h5", str(path))
    named = {case.name: case for case in cases}
    if len(named) < len(cases):
        raise HodoError("two of the cases have one name: make each a Case with its own")
    config = parse(extended_text(path, named), str(path), stored=True)
    run_plans(plans([config], path.parent, [*named], force=False, jobs=jobs), jobs, quiet=True)
    if classify and (problems := classify_results([path])[1]):
        raise HodoError("\n".join(problems))
    results = cases_of_file(path)
    return [results[name] for name in named]


def _wrong(what_is_right: str, value: object) -> HodoError:
    """The error for a wrong argument, in one line whatever its value is."""
    return HodoError(f"{what_is_right}, got {shown(value)}")


def _checked_jobs(jobs: object) -> int:
    """The number of processes. Raises HodoError if it is no positive whole number."""
    if isinstance(jobs, bool) or not isinstance(jobs, Integral) or jobs < 1:
        raise _wrong("jobs: expected a whole number >= 1", jobs)
    return int(jobs)  # products of jobs and bytes of memory may overflow numpy's integers


def _path(what_is_right: str, name: str | Path) -> Path:
    """The path that an argument names. Raises HodoError if no file can have that name."""
    with suppress(TypeError, ValueError):
        if b"\0" not in os.fsencode(path := Path(name)):
            return path
    raise _wrong(what_is_right, name)


@as_usual
def sweep(case: Given, *, name: str = "sweep", jobs: int = 1) -> xr.Dataset:
    """Integrate every member of a case with a `sweep:`, in `jobs` processes.

    The dataset has the sweep's axes as dimensions and, for each member, the final state, the first
    crossing, the axes enclosed at start and end, and the status.

    Raises HodoError as `run` does, or if the case is no sweep.
    """
    made = _case(case, name)
    if not made.sweep:
        raise HodoError("sweep: missing: use hodo.run for a single case")
    jobs = _checked_jobs(jobs)
    # Members are reduced chunk by chunk in files, so that no sweep has to fit into memory.
    (swept,) = _stored([made], None, jobs, classify=False)
    if "members" not in swept.attrs:
        raise HodoError(swept.attrs["message"])
    return swept


def open(path: str | Path) -> StoredCases:
    """The cases of a result file by name, each read as a dataset when it is asked for; `attrs` are
    the attributes of the file.

    Raises HodoError if the file is missing, damaged, or no result of hodo.
    """
    return cases_of_file(_path("expected the name of a result file", path))


@as_usual
def plot(data: xr.Dataset | Iterable[xr.Dataset], kind: str = "hodograph", **keys: Any) -> Figure:
    """A figure of one dataset or several, by the `kind` and `keys` of a `figures:` block.
    Parameters of matplotlib that rc_context or a style sheet have set apply where its `style` sets
    none.

    Raises HodoError if the kind or a key does not exist, or the kind has no meaning for the data.
    """
    several = [data] if isinstance(data, xr.Dataset) or not isinstance(data, Iterable) else [*data]
    if not several or not all(isinstance(item, xr.Dataset) for item in several):
        raise _wrong("expected a dataset or several, as run gives them", data)
    cases = _named(several)
    # A sketch of quadrants draws bodies and takes no cases.
    keys_of_kind = FIGURE_KINDS.get(kind, {}) if isinstance(kind, str) else {}
    cases_key = {"cases": list(cases)} if "cases" in keys_of_kind else {}
    spec, mistakes = check_tagged(FIGURE, {**cases_key, **as_plain({"kind": kind, **keys})})
    if mistakes:
        raise HodoError(str(Wrong(*mistakes)))
    spec["style"] = merged_style(spec["style"])
    return draw(spec, cases, rc=user_parameters()).figure


@as_usual
def derive(data: xr.Dataset, *names: str) -> xr.Dataset:
    """A dataset with quantities that follow from its variables, such as `T`, `G_space` or `psi`, by
    the names of docs/results.md; for a sweep, at the ends of its members. D/2T becomes the variable
    D_per_2T, as in files.

    Raises HodoError for a name that is no quantity, or for which the dataset lacks variables.
    """
    if not isinstance(data, xr.Dataset):
        raise _wrong("expected a dataset, as run or sweep gives it", data)
    if strange := [name for name in names if not isinstance(name, str)]:
        raise _wrong("expected the name of a quantity", strange[0])
    # One member of a sweep is the end of a motion, unless its trajectory is stored.
    if sweep_axes(data) or ("members" in data.attrs and "time" not in data.dims):
        swept = SweepView.of("sweep", data)
        _check_quantities(names, swept.sources)
        return data.assign({stored_name(name): swept.derived(name) for name in names})
    motion = motion_from(data, "case")
    _check_quantities(names, motion.sources)
    arrays = {
        stored_name(name): quantity_array(name, motion.quantity(name), ["time"], motion.case)
        for name in names
    }
    # With times as coordinates, because the times of the dataset may be in another order.
    return data.assign({name: x.assign_coords(time=motion.time) for name, x in arrays.items()})


def _check_quantities(names: Sequence[str], sources: set[str]) -> None:
    """Raise HodoError for a name that is no quantity; it lists the quantities that follow from
    these variables and constants."""
    for name in names:
        if name not in QUANTITIES:
            raise HodoError(
                f"unknown quantity {name!r}{nearest(name, QUANTITIES)} "
                f"(it has {', '.join(derivable(sources))})"
            )


def _case(case: Given, name: str) -> Case:
    return case if isinstance(case, Case) else Case.of(case, name)


def _named(several: Sequence[xr.Dataset]) -> dict[str, xr.Dataset]:
    """Datasets by the names of their cases; repeated names get a number."""
    named: dict[str, xr.Dataset] = {}
    for data in several:
        # A stored case begins with its name; parsing all of it would take milliseconds.
        first = next(iter(str(data.attrs.get("case", "")).splitlines()), "")
        name = first.partition(": ")[2].strip('"') or "case"
        again = sum(1 for other in named if other == name or other.startswith(f"{name} ("))
        named[f"{name} ({again + 1})" if again else name] = data
    return named


def extended_text(path: Path, cases: Mapping[str, Case]) -> str:
    """The text of a result's case file with these cases added, or in place of stored cases of the
    same names; the text of these cases alone if there is no result yet. Raises HodoError if the
    result cannot be read."""
    if not os.path.lexists(path):
        return composed_text(cases)
    with open_run(path) as run:
        document = read_mapping(run.text, Source(str(path)))
        cases = {**stored_config(run).cases, **cases}
    for section in ("cases", "defaults"):
        document.pop(section, None)
    return composed_text(cases, **document)
