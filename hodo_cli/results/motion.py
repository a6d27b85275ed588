"""A motion as figures and claims see it: a case with its samples, and every quantity that follows
from them.

`QUANTITIES` is the one table of what is derived from stored variables: |G|, T, D and the others are
computed when they are asked for, from the samples, and by nobody else.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from .. import HodoError
from ..cases.case import Case, parse_case
from ..cases.config import Config, parse
from ..cases.figure_block import BODY_AXES
from ..cases.sweep_block import AXIS_LABELS
from ..integration.crossings import Crossing
from ..models import rigid_body
from ..models.top.nutation import first_integrals
from ..storage.finished import open_batch
from ..storage.group import Group
from ..storage.hdf5 import ResultFile
from ..storage.provenance import typed
from .layout import CROSSING_COLUMNS, EVENT_COLUMNS, SHOWN


class Array(Protocol):
    """A labelled array: xarray's, or a `Variable` where loading xarray would cost more than the
    work."""

    @property
    def dims(self) -> tuple[Any, ...]:
        """The names of the dimensions."""

    @property
    def data(self) -> Any:
        """The values."""

    @property
    def attrs(self) -> Any:
        """The attributes, such as `units`."""


@dataclass(frozen=True)
class Motion:
    """A case, its variables by name (an `xarray.Dataset`, or those of a `Group`), the
    attributes that are stored with them, what a figure calls it, and the file that holds it."""

    case: Case
    data: Mapping[Any, Array]
    attrs: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    path: str = "RUN"

    @property
    def name(self) -> str:
        """The case's name in the file."""
        return self.case.name

    def __getitem__(self, variable: str) -> np.ndarray:
        """Values over time (n,): a name of `QUANTITIES`, a stored variable, or a component such as
        "omega.x1".

        Raises HodoError if the case has no such variable.
        """
        if variable in QUANTITIES:
            try:
                return QUANTITIES[variable](self)
            except KeyError as missing:
                raise HodoError(
                    f"case {self.name} has no {missing}, which {variable} needs"
                ) from None
        name, _, axis = variable.partition(".")
        if axis in BODY_AXES and name in self.vectors:
            return self.vectors[name][:, BODY_AXES.index(axis)]
        if not axis and "." not in variable and self._over_time(variable):
            return self.stored(variable)
        raise HodoError(f"case {self.name} has no variable {variable!r}: {self._hint(name)}")

    def stored(self, name: str) -> np.ndarray:
        """The values of a stored variable. Raises KeyError if it is not stored."""
        if name not in self.data:  # xarray's own error would list all that there is
            raise KeyError(name)
        return np.asarray(self.data[name].data)

    def columns(self, *variables: str) -> dict[str, np.ndarray]:
        """Several variables by name."""
        return {name: self[name] for name in variables}

    def units(self, variable: str) -> str:
        """The stored units of a variable; "1" where none are stored."""
        name = variable.partition(".")[0]
        return str(self.data[name].attrs.get("units", "1")) if name in self.data else "1"

    @cached_property
    def vectors(self) -> Mapping[str, np.ndarray]:
        """The variables (n, 3) over the body axes: those stored, and the angular momentum G."""
        found = {
            str(name): np.asarray(variable.data)
            for name, variable in self.data.items()
            if variable.dims == ("time", "axis")
        }
        return found | ({"G": self.G} if "omega" in found and self.case.data.get("inertia") else {})

    def _over_time(self, name: str) -> bool:
        return name in self.data and self.data[name].dims == ("time",)

    def _hint(self, name: str) -> str:
        """What to write instead of a name that is none."""
        if name in self.vectors:
            return (
                f"it is a vector, name a component: {', '.join(f'{name}.{x}' for x in BODY_AXES)}"
            )
        has = [f"{vector}.{axis}" for vector in self.vectors for axis in BODY_AXES]
        has += [str(name) for name in self.data if name != "time" and self._over_time(str(name))]
        return f"it has {', '.join([*has, *self._derived()])}"

    def _derived(self) -> list[str]:
        """The names of `QUANTITIES` that this case has what they need for."""
        found = []
        for name, quantity in QUANTITIES.items():
            try:
                quantity(self)
            except (KeyError, HodoError):
                continue
            found.append(name)
        return [name for name in found if not self._over_time(name)]

    @cached_property
    def time(self) -> np.ndarray:
        """Times (n,)."""
        return self.stored("time")

    @property
    def omega(self) -> np.ndarray:
        """Angular velocity (n, 3) in body axes. Raises KeyError for a case without it."""
        return self.stored("omega")

    @cached_property
    def inertia(self) -> np.ndarray:
        """Principal moments of inertia (3,)."""
        given = self.case.data["inertia"]
        if isinstance(given, Mapping):  # a top gives A, twice, and C
            given = (given["A"], given["A"], given["C"])
        return np.array(given, dtype=float)

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """The positions of the largest, middle and smallest moment of inertia."""
        return rigid_body.inertia_order(self.inertia)

    @cached_property
    def G(self) -> np.ndarray:
        """Angular momentum (n, 3) in body axes. Raises HodoError for a case without it."""
        if "omega" not in self.data:
            what = f"{self.case.model}, {self.case.form}"
            raise HodoError(f"case {self.name} ({what}) has no angular momentum in body axes")
        return rigid_body.angular_momentum(self.inertia, self.omega)

    @property
    def classified(self) -> bool:
        """Whether `classify` has stored an enclosed axis for each sample."""
        return self._over_time("enclosed_axis")

    @property
    def lacks_labels(self) -> bool:
        """Whether `classify` would label this motion, and has not."""
        return not (
            self.classified
            or self.case.sweep
            or self.case.system.no_axis_reason
            or "omega" not in self.data
            or not len(self.omega)
        )

    @property
    def labels(self) -> np.ndarray:
        """The enclosed axis (n,). Raises HodoError if there is none."""
        if not self.classified:
            how = f"run `hodo classify {self.path}` first" if self.path else "classify it first"
            raise HodoError(f"case {self.name} has no labels of the enclosed axis: {how}")
        return self.stored("enclosed_axis")

    @cached_property
    def crossings(self) -> tuple[Crossing, ...]:
        """The separatrix crossings. Raises as `labels` does: none known is not none there."""
        if not len(self.labels):
            return ()
        fields = {
            field: self.stored(name).tolist()
            if name in self.data
            else [math.nan] * len(self.data["crossing_time"].data)
            for name, (field, _) in CROSSING_COLUMNS.items()
        }
        return tuple(
            Crossing(**dict(zip(fields, values, strict=True)))
            for values in zip(*fields.values(), strict=True)
        )

    @property
    def crossing_time(self) -> np.ndarray:
        """Times (m,) of the separatrix crossings; none in a case that is not classified."""
        crossings = self.crossings if self.classified else ()
        return np.array([crossing.time for crossing in crossings], dtype=float)

    @property
    def events(self) -> tuple[tuple[str, float], ...]:
        """Kind and time of each event of the motion itself, such as the end of spin."""
        if "event_time" not in self.data or "event_kind" not in self.data:
            return ()
        kinds, times = self.stored("event_kind"), self.stored("event_time")
        return tuple(zip(map(str, kinds), times.tolist(), strict=True))

    def at_crossings(self, values: np.ndarray) -> np.ndarray:
        """Values over time (n, k) at the crossings (m, k), interpolated between samples."""
        return np.stack(
            [np.interp(self.crossing_time, self.time, column) for column in values.T], axis=-1
        )


def forms_apart(motion: Motion, other: Motion) -> np.ndarray:
    """The relative distance (n,) of two forms of a motion at each time: of T or of G^2, whichever
    is larger. Raises HodoError if they are stored at other times."""
    if not np.array_equal(motion.time, other.time):
        raise HodoError(f"cases {motion.name} and {other.name} are not stored at the same times")
    # G enters squared, as T does: then both have the same order and much the same size.
    ratios = motion["T"] / other["T"], (motion["G"] / other["G"]) ** 2
    return np.asarray(np.max(np.abs(np.subtract(ratios, 1)), axis=0))


LATER = ("crossing_error", "crossing_G")
"""What early files of format 1 do not have; it is nan in a crossing."""


def motion_of(
    data: Mapping[Any, Array], attrs: Mapping[str, Any], owner: str, path: str = "RUN"
) -> Motion:
    """The motion in a stored case, whose variables and attributes these are; `path` is its file.

    Raises HodoError, which begins with `owner`, if what is stored does not fit together.
    """
    case = case_of(attrs, owner)
    if problem := wrong_labels(data) if case.sweep else damage(data):
        raise HodoError(f"{owner} is damaged ({problem})")
    return Motion(case, data, attrs, case.name, path)


def case_of(attrs: Mapping[str, Any], owner: str) -> Case:
    """The case in the attributes of a stored one. Raises HodoError as `motion_of` does."""
    return parse_case(typed(attrs, {"case": str}, owner)["case"])


def damage(data: Mapping[Any, Array]) -> str:
    """What is wrong with the variables of a single motion; an empty string if nothing is."""
    dims = {"time": ("time",), "omega": ("time", "axis"), "enclosed_axis": ("time",)}
    dims |= dict.fromkeys(CROSSING_COLUMNS, ("crossing",))
    present = [
        name for name in ("time", "omega", "enclosed_axis") if name in data or name == "time"
    ]
    if "enclosed_axis" in data:
        # Labels and crossings are stored together.
        present += [name for name in CROSSING_COLUMNS if name not in LATER or name in data]
    for name in present:
        if name not in data or data[name].data.dtype.kind not in "fi":
            return f"its {name} is no array of numbers"
        if data[name].dims != dims[name]:
            return f"its {name} has dimensions {', '.join(data[name].dims) or 'none'}"
    if problem := wrong_labels(data):
        return problem
    if "omega" in data and data["omega"].data.shape[1:] != (3,):
        return "its omega holds no vectors"
    sizes: dict[str, int] = {}
    for name in [*present, *(name for name in EVENT_COLUMNS if name in data)]:
        for dim, size in zip(data[name].dims, data[name].data.shape, strict=True):
            if sizes.setdefault(dim, size) != size:
                return f"its {name} has {size} values along {dim}, elsewhere {sizes[dim]}"
    return ""


def wrong_labels(data: Mapping[Any, Array]) -> str:
    """Which variable of a case or of a sweep holds numbers that are labels of no axis; an empty
    string if none does."""
    for name in ("enclosed_axis", *AXIS_LABELS):
        if name in data and not np.isin(data[name].data, list(rigid_body.LABELS)).all():
            return f"its {name} holds labels that are none"
    return ""


# The motions of a result file


UNSAVED = Path("data")
"""Stands for a result file where the datasets at hand are drawn."""


class StoredCases(Mapping[str, Group]):
    """The cases of an open result file by name, each read when it is asked for; `asked` notes for
    which, whether they are there or not."""

    def __init__(self, run: ResultFile) -> None:
        self._run = run
        self.asked: set[str] = set()

    def __getitem__(self, name: str) -> Group:
        """A case, in memory; groups that are no cases have names that begin with `_`.

        Raises KeyError if it is not there, HodoError if it is damaged or too large.
        """
        if name not in self:
            raise KeyError(name)
        return self._run.read(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._run.cases())

    def __len__(self) -> int:
        return len(self._run.cases())

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return isinstance(name, str) and name in self._run


@dataclass
class Results:
    """A result file that is open for reading: its cases, and the config that it was made from."""

    path: Path
    cases: Mapping[str, Group]
    config: Config
    _motions: dict[str, Motion] = field(default_factory=dict)

    @property
    def figures(self) -> Mapping[str, Mapping[str, Any]]:
        """The entries of the `figures:` block, resolved."""
        return self.config.figures

    def motion(self, name: str, label: str = "") -> Motion:
        """One case. Raises HodoError if the file does not hold it, or it is damaged."""
        if name not in self._motions:
            if name not in self.cases:
                raise HodoError(f"{self.path} has no result of case {name} yet: run it first")
            owner, group = f"{self.path}: {name}", self.cases[name]
            typed(group.attributes, SHOWN, owner)
            time = group.variables.get("time")
            status = group.attributes["status"]
            if status != "ok" and time is not None and time.data.size:
                end = float(time.data[-1])
                warnings.warn(f"{name}: {status}: drawn to t = {end:.6g} only", stacklevel=2)
            # Kept, because most cases stand in several figures and on the page.
            path = "" if self.path == UNSAVED else str(self.path)
            self._motions[name] = motion_of(group.variables, group.attributes, owner, path)
        return replace(self._motions[name], label=label or name)

    @property
    def lacks_labels(self) -> bool:
        """Whether a case that has been read would be labelled by `classify`, and is not."""
        return any(motion.lacks_labels for motion in self._motions.values())

    def motions(self, spec: Mapping[str, Any]) -> list[Motion]:
        """The cases of a figure, in order, under the labels that it gives them.

        Raises HodoError if the file does not hold one of them, or has no samples of it.
        """
        labels = [*spec["labels"], *[""] * len(spec["cases"])]
        motions = [
            self.motion(name, label) for name, label in zip(spec["cases"], labels, strict=False)
        ]
        for motion in motions:
            if "time" not in motion.data or not len(motion.time):
                status = motion.attrs.get("status")
                why = "" if status == "ok" else f", its status is {status}"
                raise HodoError(f"case {motion.name} has no samples{why}")
        return motions

    def figure(self, name: str) -> Mapping[str, Any]:
        """One entry of the `figures:` block. Raises HodoError if there is none of this name."""
        return self.config.figure(name)


@contextmanager
def open_results(path: Path | str, config: Config | None = None) -> Iterator[Results]:
    """A result file, open for reading, with its own config or another. Raises HodoError as
    `writer.open_batch` does."""
    with open_batch(path) as run:
        yield Results(run.path, StoredCases(run), config or parse(run.text, str(path)))


# What follows from the samples


def _momentum(m: Motion) -> np.ndarray:
    """|G|, right also where G^2 underflows; of the averaged cavity's x = p^2 + q^2 and y = r^2."""
    if "omega" in m.data:
        # hypot scales by itself; the square of 1e-170 is 0.
        return np.asarray(np.hypot.reduce(m.G, axis=-1))
    if "momentum" in m.data:
        return m.stored("momentum")
    x, y = m.stored("x"), m.stored("y")
    return np.asarray(np.sqrt(m.inertia[0] ** 2 * x + m.inertia[2] ** 2 * y))


def _energy(m: Motion) -> np.ndarray:
    if "kinetic_energy" in m.data:
        return m.stored("kinetic_energy")
    return rigid_body.kinetic_energy(m.inertia, m.omega)


def _separatrix(m: Motion) -> np.ndarray:
    """D = G^2 - 2 T A_middle, without the cancellation of this difference."""
    outer, inner = rigid_body.separatrix_terms(m.inertia, m.omega.T, m.order)
    return np.asarray(outer - inner)


def _separatrix_ratio(m: Motion) -> np.ndarray:
    with np.errstate(invalid="ignore"):  # a body at rest has no ratio, and its curve a gap
        return np.asarray(m["D"] / (2 * m["T"]))


def _first_integral(m: Motion, name: str) -> np.ndarray:
    """Gz or H of a top, in any form."""
    if name in m.data:
        return m.stored(name)
    vertical = [*m.stored("gamma").T]
    k = SimpleNamespace(**m.case.data["inertia"], mu=m.case.data["mu"])
    return np.asarray(first_integrals([*m.omega.T], vertical, k)[("Gz", "H").index(name)])


def _stored_or(name: str, of_omega: Callable[[np.ndarray], np.ndarray]) -> "Derive":
    """A variable that some forms store, and others have by their angular velocity (n, 3)."""
    return lambda m: m.stored(name) if name in m.data else of_omega(m.omega)


Derive = Callable[[Motion], np.ndarray]

QUANTITIES: dict[str, Derive] = {
    "p": lambda m: m.omega[:, 0],
    "q": lambda m: m.omega[:, 1],
    "r": _stored_or("r", lambda omega: omega[:, 2]),
    "G": _momentum,
    "G2": lambda m: np.asarray((m.G * m.G).sum(axis=-1)),
    "T": _energy,
    "J": lambda m: m.stored("J") if "J" in m.data else np.asarray(m["G"] ** 2 / (2 * m["T"])),
    "D": _separatrix,
    "D/2T": _separatrix_ratio,
    "x1_direction": lambda m: np.abs(m.inertia[0] * m["p"]) / m["G"],
    "separatrix_distance": lambda m: np.abs(m["D"]) / m["G"] ** 2,
    "x": _stored_or("x", lambda omega: omega[:, 0] ** 2 + omega[:, 1] ** 2),
    "y": _stored_or("y", lambda omega: omega[:, 2] ** 2),
    "Gz": lambda m: _first_integral(m, "Gz"),
    "H": lambda m: _first_integral(m, "H"),
}
"""Quantities over time (n,) by name, from what is stored of a motion. Each raises KeyError with the
stored variable that it needs and the case does not have."""
