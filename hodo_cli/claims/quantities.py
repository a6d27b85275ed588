"""What claims measure on a motion: quantities over time, and single numbers."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from .. import HodoError
from ..cases.case import Case, parse_case
from ..engines.protocol import extended
from ..integration.choice import choose
from ..integration.classify import EPS, cross
from ..integration.crossings import Crossing
from ..integration.solve import solve, stored
from ..models import rigid_body
from ..models.lagrange import first_integrals
from ..models.rigid_body import slope
from ..results.hdf5 import Group
from ..results.provenance import typed


@dataclass(frozen=True)
class Motion:
    """A motion as claims see it: its case, times (n,), stored variables, labels (n,), crossings and events.

    A passage of the separatrix is (time, axis before, axis after, |G|), an event (kind, time). There are no labels
    where the enclosed axis does not apply, or the case has not been classified.
    """

    case: Case
    time: np.ndarray
    variables: Mapping[str, np.ndarray]
    labels: np.ndarray | None
    passages: tuple[tuple[float, int, int, float], ...]
    events: tuple[tuple[str, float], ...]

    @property
    def enclosed(self) -> np.ndarray:
        """The labels (n,). Raises HodoError if there are none."""
        if self.labels is None:
            raise HodoError(
                f"case {self.case.name} has no labels of the enclosed axis: run `hodo classify` first"
            )
        return self.labels

    @property
    def crossings(self) -> tuple[tuple[float, int, int, float], ...]:
        """The separatrix crossings. Raises as `enclosed` does."""
        return self.passages if len(self.enclosed) else ()

    @property
    def omega(self) -> np.ndarray:
        """Angular velocity (n, 3) in body axes."""
        return self.variables["omega"]

    @property
    def inertia(self) -> np.ndarray:
        """Principal moments of inertia (3,)."""
        given = self.case.data["inertia"]
        return np.array(
            [given["A"], given["A"], given["C"]] if isinstance(given, Mapping) else given
        )

    @property
    def order(self) -> tuple[int, int, int]:
        """The positions of the largest, middle and smallest moment of inertia."""
        return rigid_body.inertia_order(self.inertia)


LABELLED = ("enclosed_axis", "crossing_time", "crossing_from", "crossing_to", "crossing_G")
"""What `classify` adds to a case."""


def read(group: Group) -> Motion:
    """The motion in a stored case. Raises HodoError if it is damaged."""
    data = {name: variable.data for name, variable in group.variables.items()}
    case = parse_case(typed(group.attributes, {"case": str}, "a case")["case"])
    wanted = [
        "time",
        *(name for name in LABELLED if "crossing_time" in data),
        *(["omega"] if "omega" in data else []),
    ]
    if any(name not in data or data[name].dtype.kind not in "fi" for name in wanted):
        raise HodoError(f"{case.name} is damaged (it lacks one of {', '.join(wanted)})")
    if data["time"].ndim != 1 or (
        "omega" in data and data["omega"].shape != (len(data["time"]), 3)
    ):
        raise HodoError(f"{case.name} is damaged (its times and its omega do not fit together)")
    crossings = [
        data[f"crossing_{name}"].tolist()
        for name in ("time", "from", "to", "G")
        if "crossing_time" in data
    ]
    if len({len(column) for column in crossings}) > 1:
        raise HodoError(f"{case.name} is damaged (its crossings are not complete)")
    events = [data[name].tolist() for name in ("event_kind", "event_time") if name in data]
    return Motion(
        case,
        data["time"],
        data,
        data.get("enclosed_axis"),
        tuple(zip(*crossings, strict=True)),
        tuple(zip(*events, strict=True)),
    )


def integrate(case: Case) -> Motion:
    """A case integrated and, where that applies, classified; its error is not measured.

    Raises HodoError if it stops before its end.
    """
    method, _ = choose(case)
    labels, found = None, list[Crossing]()
    if case.system.unclassifiable:
        solution = solve(case, method, case.precision, case.tol)
    else:
        solution, found = cross(case, method, case.precision, case.tol)
        labels = rigid_body.enclosed_axis(
            np.array(case.data["inertia"]), extended(solution.path.state), 8 * EPS
        )
    if not solution.whole:
        raise HodoError(f"a variation of case {case.name} {solution.status}: {solution.message}")
    crossings = tuple((c.time, c.start, c.end, c.momentum) for c in found)
    events = tuple(
        (event.kind, event.time) for event in solution.path.events if event.kind != "separatrix"
    )
    return Motion(case, solution.path.time, stored(case, solution.path), labels, crossings, events)


def series(m: Motion, name: str) -> np.ndarray:
    """A quantity over time (n,); of one that is a single number that number (1,).

    Raises HodoError if the motion does not have it.
    """
    try:
        return SERIES[name](m) if name in SERIES else np.array([NUMBERS[name](m)])
    except KeyError as missing:
        raise HodoError(f"case {m.case.name} has no {missing}, which {name} needs") from None


def number(m: Motion, name: str, at: str = "end") -> float:
    """A quantity that is one number; of one over time its first or last value. Raises as `series` does."""
    return float(series(m, name)[0 if at == "start" else -1])


def momentum(m: Motion) -> np.ndarray:
    """|G| over time (n,)."""
    if "omega" in m.variables:
        return np.asarray(np.linalg.norm(m.inertia * m.omega, axis=-1))
    return np.asarray(
        np.sqrt(m.inertia[0] ** 2 * m.variables["x"] + m.inertia[2] ** 2 * m.variables["y"])
    )


def separatrix_distance(m: Motion) -> np.ndarray:
    """|D|/G^2 over time (n,)."""
    outer, inner = rigid_body.separatrix_terms(m.inertia, m.omega.T, m.order)
    return np.asarray(np.abs(outer - inner) / momentum(m) ** 2)


def integral(m: Motion, name: str) -> np.ndarray:
    """Gz or H of a top, in any form."""
    if name in m.variables:
        return m.variables[name]
    vertical = [*m.variables["gamma"].T]
    k = SimpleNamespace(**m.case.data["inertia"], mu=m.case.data["mu"])
    return np.asarray(first_integrals([*m.omega.T], vertical, k)[("Gz", "H").index(name)])


SERIES: dict[str, Callable[[Motion], np.ndarray]] = {
    "p": lambda m: m.omega[:, 0],
    "q": lambda m: m.omega[:, 1],
    "r": lambda m: m.omega[:, 2] if "omega" in m.variables else m.variables["r"],
    "G": momentum,
    "T": lambda m: rigid_body.kinetic_energy(m.inertia, m.omega),
    "x1_direction": lambda m: np.abs(m.inertia[0] * m.omega[:, 0]) / momentum(m),
    "separatrix_distance": separatrix_distance,
    "x": lambda m: (
        m.omega[:, 0] ** 2 + m.omega[:, 1] ** 2 if "omega" in m.variables else m.variables["x"]
    ),
    "y": lambda m: m.omega[:, 2] ** 2 if "omega" in m.variables else m.variables["y"],
    "Gz": lambda m: integral(m, "Gz"),
    "H": lambda m: integral(m, "H"),
    "u1": lambda m: m.variables["u1"],
    "u2": lambda m: m.variables["u2"],
    "u3": lambda m: m.variables["u3"],
}
"""The quantities of `claim_block.QUANTITIES` over time."""


def entry_momentum(m: Motion) -> float:
    """The largest |G| at a crossing to the axis of smallest inertia; 0 without one."""
    return max((G for _, _, after, G in m.crossings if after == m.order[2] + 1), default=0.0)


def swept_angle(m: Motion, about: int, where: slice | np.ndarray = slice(None)) -> float:
    """The turns that G makes about axis `about` (0, 1, 2) over the samples `where`, with their sign."""
    one, other = ((m.inertia * m.omega)[where, i] for i in range(3) if i != about)
    angle = np.unwrap(np.arctan2(other, one))
    return float((angle[-1] - angle[0]) / (2 * math.pi)) if len(angle) else 0.0


def reach(m: Motion, side: int) -> float:
    """The largest w_i^2 while axis i is enclosed, in the quadrants' scale; `side` 0 is x_largest, 2 x_smallest."""
    axis = m.order[side]
    scale = slope(m.inertia.tolist()) if side == 2 else 1.0
    return float(np.max(scale * m.omega[m.enclosed == axis + 1, axis] ** 2, initial=0))


def zeros(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The times at which values (n,) change sign, by linear interpolation between the samples."""
    i = np.flatnonzero(values[:-1] * values[1:] < 0)
    return np.asarray(time[i] - values[i] * (time[i + 1] - time[i]) / (values[i + 1] - values[i]))


def first(times: np.ndarray) -> float:
    """The first of some times; infinite if there is none."""
    return float(times[0]) if len(times) else math.inf


def end_of_spin(m: Motion) -> float:
    """The time at which r reaches 0: by the event, or by the change of sign of r where the form has no event."""
    by_event = [time for kind, time in m.events if kind == "end_of_spin"]
    by_sign = zeros(m.time, m.omega[:, 2]) if "omega" in m.variables else np.empty(0)
    return by_event[0] if by_event else first(by_sign)


def rebound(m: Motion) -> float:
    """The time at which u3 touches 1, which it does where |Gz| = C |r|."""
    return first(zeros(m.time, np.abs(integral(m, "Gz")) - m.inertia[2] * np.abs(series(m, "r"))))


NUMBERS: dict[str, Callable[[Motion], float]] = {
    "crossings": lambda m: len(m.crossings),
    "first_crossing": lambda m: m.crossings[0][0] if m.crossings else math.inf,
    "entry_momentum": entry_momentum,
    "turns": lambda m: abs(swept_angle(m, int(m.enclosed[0]) - 1)),
    "reach_largest": lambda m: reach(m, 0),
    "reach_smallest": lambda m: reach(m, 2),
    "end_of_spin": end_of_spin,
    "rebound_u3": rebound,
}
"""The quantities of `claim_block.QUANTITIES` that are one number."""
