"""What claims measure on a motion: quantities over time, single numbers, closed forms beside what
they stand for."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from scipy.special import ellipj

from .. import HodoError
from ..cases.case import Case, parse_case
from ..engines import exact
from ..engines.protocol import have_taylor
from ..integration.choice import choose
from ..integration.classify import EPS, Crossing, cross
from ..integration.error import extended
from ..integration.solve import solve, stored
from ..models import closed_form, find, rigid_body
from ..models.lagrange import first_integrals
from ..models.rigid_body import slope
from ..results.hdf5 import Group
from ..results.provenance import typed


@dataclass(frozen=True)
class Motion:
    """A motion as claims see it: its case, times (n,), stored variables, labels (n,), crossings and
    events.

    A passage of the separatrix is (time, axis before, axis after, |G|), an event (kind, time).
    There are no labels where the enclosed axis does not apply, or the case has not been classified.
    """

    case: Case
    time: np.ndarray
    variables: Mapping[str, np.ndarray]
    labels: np.ndarray | None
    passages: tuple[tuple[float, int, int, float], ...]
    events: tuple[tuple[str, float], ...]

    def __getitem__(self, name: str) -> np.ndarray:
        """A quantity over time (n,), by its name in `SERIES`. Raises HodoError if the motion does
        not have it."""
        with self._needed_for(name):
            return SERIES[name](self)

    def number(self, name: str, at: str = "end") -> float:
        """A quantity that is one number; of one over time its first or last value. Raises as for a
        quantity."""
        if name not in NUMBERS:
            return float(self[name][0 if at == "start" else -1])
        with self._needed_for(name):
            return float(NUMBERS[name](self))

    def formula(self, name: str) -> "list[Pair]":
        """Values of the motion, and of a formula of `FORMS` for them. Raises as for a quantity."""
        with self._needed_for(name):
            return FORMS[name](self)

    @contextmanager
    def _needed_for(self, name: str) -> Iterator[None]:
        try:
            yield
        except KeyError as missing:
            raise HodoError(f"case {self.case.name} has no {missing}, which {name} needs") from None

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
    model, labels = find(case.model, case.form), None
    found: list[Crossing] = []
    if model.unclassifiable:
        solution = solve(case, method, case.precision, case.tol)
    else:
        solution, found = cross(case, method, case.precision, case.tol, 8 * EPS)
        labels = rigid_body.enclosed_axis(
            np.array(case.data["inertia"]), extended(solution.path.state), 8 * EPS
        )
    if solution.stop:
        raise HodoError(f"a variation of case {case.name} {solution.stop}: {solution.message}")
    crossings = tuple((c.time, c.start, c.end, c.momentum) for c in found)
    events = tuple(
        (event.kind, event.time) for event in solution.path.events if event.kind != "separatrix"
    )
    return Motion(case, solution.path.time, stored(case, solution.path), labels, crossings, events)


def _momentum(m: Motion) -> np.ndarray:
    if "omega" in m.variables:
        return np.asarray(np.linalg.norm(m.inertia * m.omega, axis=-1))
    return np.asarray(np.sqrt(m.inertia[0] ** 2 * m["x"] + m.inertia[2] ** 2 * m["y"]))


def _separatrix_distance(m: Motion) -> np.ndarray:
    outer, inner = rigid_body.separatrix_terms(m.inertia, m.omega.T, m.order)
    return np.asarray(np.abs(outer - inner) / m["G"] ** 2)


def _integral(m: Motion, name: str) -> np.ndarray:
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
    "G": _momentum,
    "T": lambda m: rigid_body.kinetic_energy(m.inertia, m.omega),
    "x1_direction": lambda m: np.abs(m.inertia[0] * m["p"]) / m["G"],
    "separatrix_distance": _separatrix_distance,
    "x": lambda m: m["p"] ** 2 + m["q"] ** 2 if "omega" in m.variables else m.variables["x"],
    "y": lambda m: m["r"] ** 2 if "omega" in m.variables else m.variables["y"],
    "Gz": lambda m: _integral(m, "Gz"),
    "H": lambda m: _integral(m, "H"),
    **{name: lambda m, name=name: m.variables[name] for name in ("u1", "u2", "u3")},  # type: ignore[misc]
    "order_of_roots": lambda m: np.min(
        [m["u1"] + 1, m["u2"] - m["u1"], 1 - m["u2"], m["u3"] - 1], axis=0
    ),
}
"""How the quantities of `statements.SERIES` are had."""


def _entry_momentum(m: Motion) -> float:
    return max((G for _, _, after, G in m.crossings if after == m.order[2] + 1), default=0.0)


def _turns(m: Motion) -> float:
    """The angle that the two other components of G/|G| sweep about the axis enclosed at the
    start."""
    about = int(m.enclosed[0]) - 1
    one, other = ((m.inertia * m.omega)[:, i] for i in range(3) if i != about)
    angle = np.unwrap(np.arctan2(other, one))
    return float(abs(angle[-1] - angle[0]) / (2 * math.pi))


def _reach(m: Motion, side: int) -> float:
    """The largest w_i^2 while axis i is enclosed, in the quadrants' scale; `side` 0 is x_largest, 2
    x_smallest."""
    axis = m.order[side]
    scale = slope(m.inertia.tolist()) if side == 2 else 1.0
    return float(np.max(scale * m.omega[m.enclosed == axis + 1, axis] ** 2, initial=0))


def _sign_changes(m: Motion, name: str) -> np.ndarray:
    """The times at which a quantity changes sign, by linear interpolation."""
    return _zeros(m.time, m[name])


def _zeros(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    i = np.flatnonzero(values[:-1] * values[1:] < 0)
    return np.asarray(time[i] - values[i] * (time[i + 1] - time[i]) / (values[i + 1] - values[i]))


def _first(times: np.ndarray) -> float:
    return float(times[0]) if len(times) else math.inf


def _end_of_spin(m: Motion) -> float:
    """By the event, or by the first change of sign of r where the form has none."""
    by_event = [time for kind, time in m.events if kind == "end_of_spin"]
    return (
        by_event[0]
        if by_event
        else _first(_sign_changes(m, "r"))
        if "omega" in m.variables
        else math.inf
    )


def _rate_per_turn(m: Motion) -> float:
    """By the averaged equations, at the start: |x'|/x and |y'|/y times the period of (p, q)."""
    A, _, C = m.inertia
    model, y = find(m.case.model, m.case.form), (math.sqrt(m["x"][0]), math.sqrt(m["y"][0]))
    rates = model.rhs(0.0, y, SimpleNamespace(**model.constants(m.case.data)))
    period = 2 * math.pi / abs((C - A) / A * y[1])
    return float(max(abs(2 * rate / value) * period for rate, value in zip(rates, y, strict=True)))


def _rebound(m: Motion) -> float:
    C = m.inertia[2]
    return _first(_zeros(m.time, np.abs(m["Gz"]) - C * np.abs(m["r"])))


def _roughness(m: Motion) -> float:
    """The second derivative in units of the range and of the time in which nine tenths of the way
    are made."""

    def one(values: np.ndarray) -> float:
        way = np.abs(values - values[0])
        span = m.time[np.argmax(way >= 0.9 * np.ptp(values))] - m.time[0]
        return float(
            np.abs(np.diff(values, 2)).max()
            * (span / (m.time[1] - m.time[0])) ** 2
            / np.ptp(values)
        )

    return max(one(m[name]) for name in ("Gz", "H", "u1", "u2", "u3"))


NUMBERS: dict[str, Callable[[Motion], float]] = {
    "crossings": lambda m: len(m.crossings),
    "first_crossing": lambda m: m.crossings[0][0] if m.crossings else math.inf,
    "entry_momentum": _entry_momentum,
    "turns": _turns,
    "reach_largest": lambda m: _reach(m, 0),
    "reach_smallest": lambda m: _reach(m, 2),
    "decay": lambda m: math.log(m["G"][0] / m["G"][-1]) / (m.time[-1] - m.time[0]),
    "last_sign_change_r": lambda m: float(np.max(_sign_changes(m, "r"), initial=-math.inf)),
    "first_sign_change_p": lambda m: _first(_sign_changes(m, "p")),
    "end_of_spin": _end_of_spin,
    "x_at_end_of_spin": lambda m: float(np.interp(_end_of_spin(m), m.time, m["x"])),
    "rate_per_turn": _rate_per_turn,
    "rebound_u3": _rebound,
    "roughness": _roughness,
}
"""How the quantities of `statements.NUMBERS` are had."""

Pair = tuple[np.ndarray, np.ndarray]
"""Values of the motion and of the formula, of one shape."""


def _integrated(m: Motion) -> np.ndarray:
    """omega (n, 3) by numerical integration: a closed form shall not be compared with itself."""
    solution = solve(
        m.case, "taylor" if have_taylor() else "DOP853", m.case.precision, times=m.time
    )
    return stored(m.case, solution.path)["omega"]


def _free_rotation(m: Motion) -> list[Pair]:
    return [(_integrated(m), exact.solve(m.case, m.time))]


def _free_rotation_from_q0(m: Motion) -> list[Pair]:
    """Free motion that passes q = 0 at a time t0 is the closed form for q0 = 0 with the time
    counted from t0."""
    A, start = m.inertia, m.omega[0]
    near = _first(_sign_changes(m, "q")) if m["q"][0] else float(m.time[0])
    for _ in range(60):
        here = closed_form.free_motion(A, start, np.array([near - m.time[0]]))[0]
        near -= here[1] * A[1] / ((A[2] - A[0]) * here[0] * here[2])
    passage = closed_form.free_motion(A, start, np.array([near - m.time[0]]))[0] * (1, 0, 1)
    return [(_integrated(m), closed_form.free_motion(A, passage, m.time - near))]


def _equation_6(m: Motion) -> list[Pair]:
    """P1 eqs (5)-(6) as printed, for D < 0 or D > 0; p, q are given with two signs, of which the
    better is taken."""
    A1, A2, A3 = A = m.inertia
    start = m.omega[0]
    lam = m.case.data["damping"][0]
    h, G2 = (A * start * start).sum(), (A * A * start * start).sum()
    X, Y = G2 - h * A3, h * A1 - G2
    about_x3 = h * A2 > G2
    n = math.sqrt(((A2 - A3) * Y if about_x3 else (A1 - A2) * X) / (A1 * A2 * A3))
    modulus = (A1 - A2) * X / ((A2 - A3) * Y)
    decay = np.exp(-lam * (m.time - m.time[0]))
    sn, cn, dn, _ = ellipj(n * decay / lam, modulus if about_x3 else 1 / modulus)
    size1, size3 = math.sqrt(X / (A1 * (A1 - A3))), math.sqrt(Y / (A3 * (A1 - A3)))
    size2 = math.sqrt(X / (A2 * (A2 - A3)) if about_x3 else Y / (A2 * (A1 - A2)))
    outer, inner = (cn, dn) if about_x3 else (dn, cn)
    signs = [(s, -s, 1) if about_x3 else (1, s, -s) for s in (1, -1)]
    shapes = [
        np.stack([a * size1 * outer, b * size2 * sn, c * size3 * inner], axis=-1)
        for a, b, c in signs
    ]
    motions = [decay[:, None] * shape for shape in shapes]
    omega = _integrated(m)
    return [(omega, min(motions, key=lambda motion: float(np.abs(motion - omega).max())))]


def _turning_axis(m: Motion) -> list[Pair]:
    """A free motion goes round the axis whose component of G never changes sign; the other two and
    the label."""
    largest, _, smallest = m.order
    keeps = [(m.omega[:, i] > 0).all() or (m.omega[:, i] < 0).all() for i in (largest, smallest)]
    seen = largest + 1 if keeps == [True, False] else smallest + 1 if keeps == [False, True] else 0
    return [(m.enclosed[:1].astype(float), np.array([float(seen)]))]


def _inequality_7(m: Motion) -> list[Pair]:
    """In units of |omega|, so that no size matters."""
    w = m.omega / np.abs(m.omega).max(axis=1, keepdims=True)
    A1, A2, A3 = m.inertia
    G2, h = (m.inertia**2 * w * w).sum(axis=1), (m.inertia * w * w).sum(axis=1)
    clear = np.abs(G2 - h * A2) > 64 * EPS * G2
    K = A3 * (A2 - A3) / (A1 * (A1 - A2))
    return [(np.sign(G2 - h * A2)[clear], np.sign(w[:, 0] ** 2 - K * w[:, 2] ** 2)[clear])]


def _from_roots(m: Motion, frozen: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gz, H and r from u1, u2, u3 by P3 eq (2.5).

    The signs of R and delta are those at the start, or follow sign(Gz^2 - C^2 r^2) and sign(1 +
    u1u2 + u1u3 + u2u3). chi has the sign of r.
    """
    u1, u2, u3 = m["u1"], m["u2"], m["u3"]
    A, C, mu = m.inertia[0], m.inertia[2], m.case.data["mu"]
    sign = np.sign(m["Gz"] ** 2 - (C * m["r"]) ** 2)
    delta = np.sign(1 + u1 * u2 + u1 * u3 + u2 * u3)
    sign, delta = (np.full(len(u1), s[0]) if frozen else s for s in (sign, delta))
    R = sign * np.sqrt(np.maximum((1 - u1**2) * (1 - u2**2) * (u3**2 - 1), 0))
    total, product = u1 + u2 + u3, u1 * u2 * u3
    chi = np.sign(m["r"]) * math.sqrt(A * mu)
    Gz = chi * delta * np.sqrt(np.maximum(total + product + R, 0))
    H = mu / 2 * (total * (1 + A / C) + (R - product) * (1 - A / C))
    return Gz, H, chi / C * np.sqrt(np.maximum(total + product - R, 0))


def _equation_25(m: Motion, frozen: bool) -> list[Pair]:
    return list(zip((m["Gz"], m["H"], m["r"]), _from_roots(m, frozen), strict=True))


def _equation_33(m: Motion) -> list[Pair]:
    b, C = m.case.data["b"], m.inertia[2]
    integral = sum(c * m.time ** (n + 1) / (n + 1) for n, c in enumerate(b))
    return [(_from_roots(m, frozen=False)[2], m["r"][0] * np.exp(-integral / C))]


FORMS: dict[str, Callable[[Motion], list[Pair]]] = {
    "free-rotation": _free_rotation,
    "free-rotation-from-q0": _free_rotation_from_q0,
    "equation-6": _equation_6,
    "turning-axis": _turning_axis,
    "inequality-7": _inequality_7,
    "equation-2.5": lambda m: _equation_25(m, frozen=False),
    "equation-2.5-frozen": lambda m: _equation_25(m, frozen=True),
    "equation-3.3": _equation_33,
}
"""The formulas of `statements.FORMS`."""
