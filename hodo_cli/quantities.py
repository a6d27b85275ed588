"""The quantities that follow from the stored variables of a motion: one table of their names,
symbols, meanings, units and formulas. Case files, `store:`, figures, statements, sweeps and
`derive` all read it. Imports models and the folders below."""

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from . import HodoError
from .models import added_variables, rigid_body
from .models.base import Label, Model, attributes
from .models.terms.time_laws import coefficient_at
from .models.top import first_integrals, roots_of_motion, with_mu
from .text import case_words

BODY_AXES = ("x1", "x2", "x3")
SPACE_AXES = ("x", "y", "z")

PARTS = {"axis": BODY_AXES, "space": SPACE_AXES, "quaternion": ("a", "b", "c", "d")}
"""The dimensions of variables with several numbers at a time, and the names of their components."""


@dataclass(frozen=True, eq=False)
class Samples:
    """A case and its variables over times, as the formulas below take them. The variables are those
    of an `xarray.Dataset` or of a `Group`; both have `dims`, `data` and `attrs`."""

    case: Any  # a Case, which a module above this one defines
    data: Mapping[Any, Any]

    def stored(self, name: str) -> np.ndarray:
        """The values of a stored variable. Raises KeyError if it is not stored."""
        if (key := stored_name(name)) not in self.data:  # xarray's own error lists all variables
            raise KeyError(name)
        # The digits of a sum depend on the order of its terms in memory, which exchanged axes
        # change.
        return np.asarray(self.data[key].data, order="C")

    @cached_property
    def time(self) -> np.ndarray:
        """Times (n,)."""
        return self.stored("time")

    @cached_property
    def omega(self) -> np.ndarray:
        """Angular velocity (n, 3) in body axes. Raises KeyError for a case without it."""
        return self.stored("omega")

    @cached_property
    def G(self) -> np.ndarray:
        """Angular momentum (n, 3) in body axes. Raises KeyError for a case without it."""
        if self.frame:
            return self.frame.momentum(self.omega)
        return np.asarray(self.inertia * self.omega)

    @cached_property
    def principal_omega(self) -> np.ndarray:
        """Angular velocity (n, 3) along the principal axes."""
        return self.frame.to_principal(self.omega) if self.frame else self.omega

    @property
    def frame(self) -> rigid_body.BodyFrame | None:
        """The body, if the model is one of a body that turns freely in its own axes."""
        return self.case.system if isinstance(self.case.system, rigid_body.BodyFrame) else None

    @property
    def principal_axes(self) -> np.ndarray:
        """The principal axes (3, 3), row by row, in the axes of the vectors."""
        axes = self.frame.principal_axes if self.frame else None
        return np.eye(3) if axes is None else axes.astype(float)

    @cached_property
    def inertia(self) -> np.ndarray:
        """Principal moments of inertia (3,)."""
        moments: Any = self.frame.moments if self.frame else self.case.data["inertia"]
        if isinstance(moments, Mapping):  # a top gives A, which counts twice, and C
            moments = (moments["A"], moments["A"], moments["C"])
        return np.array([*moments], dtype=float)

    def check_separatrix(self) -> None:
        """Raise HodoError for a body whose motions no separatrix divides by the sign of D."""
        if reason := self.case.system.no_separatrix_reason:
            words = case_words(self.case.name)
            raise HodoError(f"{words} has no separatrix to be drawn: {reason}")

    @cached_property
    def order(self) -> tuple[int, int, int]:
        """The positions of the largest, middle and smallest moment of inertia."""
        return rigid_body.inertia_order(self.inertia)

    @cached_property
    def rotations(self) -> Any:
        """The attitudes as SciPy's rotations from body to space."""
        from scipy.spatial.transform import Rotation  # late: it takes longer than most pictures

        return Rotation.from_quat(np.roll(self.stored("attitude"), -1, axis=1))


# The formulas


def _momentum(m: Samples) -> np.ndarray:
    """|G|, right also where G^2 underflows; for the averaged cavity from x = p^2 + q^2 and y =
    r^2."""
    if "omega" in m.data:
        # hypot scales by itself; the square of 1e-170 is 0.
        return np.asarray(np.hypot.reduce(m.G, axis=-1))
    if "momentum" in m.data:
        return m.stored("momentum")
    square = m.inertia[0] ** 2 * m.stored("x") + m.inertia[2] ** 2 * m.stored("y")
    return np.asarray(np.sqrt(square))


def _energy(m: Samples) -> np.ndarray:
    if "kinetic_energy" in m.data:
        return m.stored("kinetic_energy")
    return np.asarray((m.inertia * m.principal_omega * m.principal_omega).sum(axis=-1) / 2)


def _separatrix(m: Samples) -> np.ndarray:
    """D = G^2 - 2 T A_middle, without the cancellation of this difference."""
    m.check_separatrix()
    outer, inner = rigid_body.separatrix_terms(m.inertia, m.principal_omega.T, m.order)
    return np.asarray(outer - inner)


# A body at rest has no ratio, and its curve a gap.
_ratio = partial(rigid_body.share_of, of_nothing=np.nan)


def _of_direction(formula: Callable[[Samples], np.ndarray], m: Samples) -> np.ndarray:
    """A formula in which the size of omega cancels, for omega scaled to a size near 1: the squares
    of 1e-160 have lost their digits. It is nan where omega has lost its own."""
    if "omega" not in m.data or m.case.system.no_separatrix_reason:  # h has a size of its own
        return formula(m)
    size = np.abs(m.omega).max(axis=-1, keepdims=True)
    near_1 = np.ldexp(m.omega, -np.frexp(size)[1])
    known = np.where(size < sys.float_info.min, np.nan, near_1)
    return formula(Samples(m.case, {"omega": SimpleNamespace(data=known)}))


def _momentum_over_energy(m: Samples) -> np.ndarray:
    """J = G^2/2T, which an averaged form stores."""
    return m.stored("J") if "J" in m.data else _ratio(2 * _energy(m), _momentum(m) ** 2)


def _separatrix_ratio(m: Samples) -> np.ndarray:
    """D/2T; for an averaged form from its J."""
    if "omega" not in m.data:
        return np.asarray(_momentum_over_energy(m) - m.inertia[m.order[1]])
    return _ratio(2 * _energy(m), _separatrix(m))


def direction(m: Samples) -> np.ndarray:
    """G/|G| (n, 3) in body axes, nan where the body is at rest or G has lost its digits."""
    size = _momentum(m)[:, None]
    return np.asarray(m.G / np.where(size >= sys.float_info.min, size, np.nan))


def _tilt(m: Samples) -> np.ndarray:
    """The angle between G and x3; nan where G has no direction."""
    across, along = np.hypot(m.G[:, 0], m.G[:, 1]), m.G[:, 2]
    return np.where(_momentum(m) < sys.float_info.min, np.nan, np.arctan2(across, along))


def _of_top(of_state: Callable[..., Any], i: int, m: Samples) -> np.ndarray:
    """One of the quantities that follow from omega and the vertical of a top, with mu at each
    time."""
    k = with_mu(attributes(m.case.system.constants), m.time)
    return np.asarray(of_state([*m.omega.T], [*m.stored("gamma").T], k)[i])


def _with_fluid(m: Samples) -> np.ndarray:
    """G - kappa omega' (n, 3) in body axes, with omega' of the free body: the momentum of body and
    fluid together, to first order in kappa."""
    axes, k = m.principal_axes, attributes(m.case.system.constants)
    acceleration = (np.cross(m.G, m.omega) @ axes.T / m.inertia) @ axes
    kappa = np.reshape(coefficient_at(k, "kappa", m.time), (-1, 1))
    return np.asarray(m.G - kappa * acceleration)


def angle_turned(time: np.ndarray, omega: np.ndarray) -> float:
    """The angle in radians by which a body turns in space, from its angular velocity (n, 3) at
    times (n,)."""
    return abs(float(np.trapezoid(np.linalg.norm(omega, axis=1), time)))


POLE_SINE = 1e-7
"""The sine of theta below which phi and psi have lost half of their digits, and are nan."""


def _euler_angle(name: str, m: Samples) -> np.ndarray:
    """psi, theta or phi (n,) of the turns by psi about z, theta about x1 and phi about x3, one
    after another: precession, nutation and spin. psi and phi are at most half a turn, and nan where
    theta is 0 or pi."""
    axis = m.rotations.apply(np.eye(3)[2])
    sine = np.hypot(axis[:, 0], axis[:, 1])
    if name == "theta":
        return np.asarray(np.arctan2(sine, axis[:, 2]))
    vertical = m.rotations.inv().apply(np.eye(3)[2])
    x, y = (axis[:, 0], -axis[:, 1]) if name == "psi" else (vertical[:, 0], vertical[:, 1])
    return np.where(sine > POLE_SINE, np.arctan2(x, y), np.nan)


# The table


class Quantity(NamedTuple):
    """A quantity over time: its symbol in TeX, its meaning, its units in words, the `sources` that
    it needs (any of several sets), its formula, and the dimension of its components. The formula
    gives (n,), or (n, 3) if there are components."""

    symbol: str
    long_name: str
    units: str
    needs: Sequence[Sequence[str]]
    formula: Callable[[Samples], np.ndarray]
    dim: str = ""

    @property
    def dims(self) -> tuple[str, ...]:
        """Its dimensions."""
        return ("time", self.dim) if self.dim else ("time",)


RATE, MOMENTUM, ENERGY = "1/time", "moment of inertia / time", "moment of inertia / time^2"
MOMENT, MOMENTUM2 = "moment of inertia", "moment of inertia^2 / time^2"
OMEGA, BODY, ATTITUDE = (("omega",),), (("omega", "inertia"),), (("attitude",),)
AVERAGED = ("momentum", "kinetic_energy")
TOP, MOVES = (("omega", "gamma"),), ("attitude", "omega", "inertia")

QUANTITIES = {
    "p": Quantity("p", "angular velocity about x1", RATE, OMEGA, lambda m: m.omega[:, 0]),
    "q": Quantity("q", "angular velocity about x2", RATE, OMEGA, lambda m: m.omega[:, 1]),
    "r": Quantity("r", "angular velocity about x3", RATE, OMEGA, lambda m: m.omega[:, 2]),
    "G": Quantity("|G|", "|G|", MOMENTUM, (*BODY, ("momentum",), ("x", "y")), _momentum),
    "G2": Quantity("G^2", "G^2", MOMENTUM2, BODY, lambda m: (m.G * m.G).sum(axis=-1)),
    "T": Quantity("T", "kinetic energy", ENERGY, (*BODY, ("kinetic_energy",)), _energy),
    "J": Quantity(
        "G^2/2T", "G^2/2T", MOMENT, (*BODY, AVERAGED),
        partial(_of_direction, _momentum_over_energy),
    ),
    "D": Quantity("D", "G^2 - 2 T A2, A2 the middle moment", MOMENTUM2, BODY, _separatrix),
    "D/2T": Quantity(
        "D/2T", "G^2/2T - A2", MOMENT, (*BODY, (*AVERAGED, "inertia")),
        partial(_of_direction, _separatrix_ratio),
    ),
    "x1_direction": Quantity(
        "|G_1|/|G|", "|G1|/|G|, 1 where G lies along x1", "1", BODY,
        lambda m: np.abs(direction(m)[:, 0]),
    ),
    "tilt": Quantity(r"\mathrm{tilt}", "angle between G and x3, in radians", "rad", BODY, _tilt),
    "separatrix_distance": Quantity(
        "|D|/G^2", "|D|/G^2", "1", BODY,
        partial(_of_direction, lambda m: _ratio(_momentum(m) ** 2, np.abs(_separatrix(m)))),
    ),
    "speed": Quantity(
        r"|\omega|", "|omega|", RATE, OMEGA, lambda m: np.hypot.reduce(m.omega, axis=-1)
    ),
    "x": Quantity(
        "x", "p^2 + q^2", "1/time^2", OMEGA, lambda m: m.omega[:, 0] ** 2 + m.omega[:, 1] ** 2
    ),
    "y": Quantity("y", "r^2", "1/time^2", OMEGA, lambda m: m.omega[:, 2] ** 2),
    "Gz": Quantity(
        "G_z", "vertical angular momentum", MOMENTUM, TOP, partial(_of_top, first_integrals, 0)
    ),
    "H": Quantity("H", "energy", ENERGY, TOP, partial(_of_top, first_integrals, 1)),
    "u1": Quantity(
        "u_1", "first root of the cubic of cos theta", "1", TOP,
        partial(_of_top, roots_of_motion, 0),
    ),
    "u2": Quantity("u_2", "second root", "1", TOP, partial(_of_top, roots_of_motion, 1)),
    "u3": Quantity("u_3", "third root", "1", TOP, partial(_of_top, roots_of_motion, 2)),
    "G_space": Quantity(
        "G", "G along the axes of space", MOMENTUM, (MOVES,),
        lambda m: np.asarray(m.rotations.apply(m.G)), "space",
    ),
    "total_space": Quantity(
        r"(G-\kappa\dot\omega)",
        "G - kappa omega' of the free body, the momentum of body and fluid to first order in "
        "kappa, along the axes of space",
        MOMENTUM, ((*MOVES, "kappa"),),
        lambda m: np.asarray(m.rotations.apply(_with_fluid(m))), "space",
    ),
    "omega_space": Quantity(
        r"\omega", "angular velocity along the axes of space", RATE, (("attitude", "omega"),),
        lambda m: np.asarray(m.rotations.apply(m.omega)), "space",
    ),
    "x1_space": Quantity(
        "x_1", "the axis x1 in space", "1", ATTITUDE,
        lambda m: np.asarray(m.rotations.apply(np.eye(3)[0])), "space",
    ),
    "x2_space": Quantity(
        "x_2", "the axis x2 in space", "1", ATTITUDE,
        lambda m: np.asarray(m.rotations.apply(np.eye(3)[1])), "space",
    ),
    "x3_space": Quantity(
        "x_3", "the axis x3 in space", "1", ATTITUDE,
        lambda m: np.asarray(m.rotations.apply(np.eye(3)[2])), "space",
    ),
    "rotation": Quantity(
        r"\mathrm{rotation}",
        "rotation vector from body to space: the axis times the angle, at most pi", "rad",
        ATTITUDE, lambda m: np.asarray(m.rotations.as_rotvec()), "space",
    ),
    "psi": Quantity(
        r"\psi", "precession, the turn about z, in radians", "rad", ATTITUDE,
        partial(_euler_angle, "psi"),
    ),
    "theta": Quantity(
        r"\theta", "nutation, the angle between z and x3, in radians", "rad", ATTITUDE,
        partial(_euler_angle, "theta"),
    ),
    "phi": Quantity(
        r"\phi", "spin, the turn about x3, in radians", "rad", ATTITUDE,
        partial(_euler_angle, "phi"),
    ),
}  # fmt: skip
"""Every quantity by its name in case files."""


def stored_name(name: str) -> str:
    """The name of a variable or quantity in files and datasets: D_per_2T for D/2T, because a slash
    names a group in HDF5."""
    return name.replace("/", "_per_")


STORED_SYMBOLS = {
    "time": "t", "omega": r"\omega", "gamma": r"\gamma", "omega.x1": "p", "omega.x2": "q",
    "omega.x3": "r", "gamma.x3": r"\cos\theta", "k2": "k^2",
}  # fmt: skip


def symbol(name: str) -> str:
    """The symbol of a variable or quantity in TeX; for a component its vector's symbol with an
    index."""
    base, _, part = name.partition(".")
    if name in STORED_SYMBOLS:
        return STORED_SYMBOLS[name]
    words = rf"\mathrm{{{base}}}".replace("_", r"\ ")
    of_base = QUANTITIES[base].symbol if base in QUANTITIES else STORED_SYMBOLS.get(base, words)
    if not part:
        return of_base
    if base[1:2].isdigit():  # an axis of the body: x_{3,z}
        return f"{base[0]}_{{{base[1]},{part}}}"
    return f"{{{'G' if base == 'G' else of_base}}}_{{{part.removeprefix('x') or part}}}"


def component_names(name: str, dim: str) -> list[str]:
    """The names of the numbers of a variable or quantity: its own, or those of its components."""
    return [f"{name}.{part}" for part in PARTS[dim]] if dim else [name]


STORED_VARIABLES = {
    "omega": Label(("time", "axis"), "angular velocity in body axes"),
    "attitude": Label(("time", "quaternion"), "quaternion from body to space axes"),
    "gamma": Label(("time", "axis"), "the vertical in the axes of a top"),
    "momentum": Label(("time",), "|G| of an averaged form"),
    **added_variables(),
}
"""The variables that some model stores and that are no quantities, also of the user's own
models."""

OVER_TIME = {
    number: of.long_name
    for table in (QUANTITIES, STORED_VARIABLES)
    for name, of in table.items()
    for number in component_names(name, "".join(of.dims[1:]))
}
"""The numbers over time that a statement or a formula may name, with their meanings: `T`,
`G_space.z`."""


# What a quantity needs


def constants_of(system: Model, data: Mapping[str, Any]) -> set[str]:
    """The constants of a body that quantities need."""
    names = {"inertia"} if data.get("inertia") else set()
    has_fluid = system.attitude and "kappa" in system.constants
    return names | {"kappa"} if has_fluid else names


def missing(name: str, sources: Collection[str], known: Collection[str] = ()) -> list[str]:
    """What a quantity needs besides these stored variables and constants; an empty list if it
    follows from them. A variable needs itself.

    A quantity may follow from any of several sets. The answer is about a set that lacks nothing or,
    if there is none, about the first that lacks `known` variables only.
    """
    sets = QUANTITIES[name].needs if name in QUANTITIES else ((name,),)
    lacks_of_sets = [[need for need in needs if need not in sources] for needs in sets]
    return min(lacks_of_sets, key=lambda lacks: (bool(lacks), not {*lacks} <= {*known}))


def derivable(sources: Collection[str]) -> list[str]:
    """The quantities that follow from these stored variables and constants."""
    return [name for name in QUANTITIES if not missing(name, sources)]


def lack_of(case: Any, name: str, sources: Collection[str], user: str) -> str:
    """What is wrong with a case that lacks what a variable or quantity, which the `user` names,
    needs besides these variables and constants, and what to do; an empty string if nothing is
    missing."""
    known = case.system.equations.variables
    if not (lacks := missing(name, sources, known)):
        return ""
    variables = " and ".join(lacks)
    if case.leaves_out(lacks):
        where = " at the ends of members" if case.sweep else ""
        words = case_words(case.name)
        return f"the `store:` of {words} leaves out {variables}{where}, which {user} needs"
    remedy = remedy_of([x for x in lacks if x not in known])
    if remedy and case.store:
        remedy += f", and {variables} in its `store:`"
    return f"{case_words(case.name)} has no {variables}, which {user} needs{remedy}"


def remedy_of(lacks: Sequence[str]) -> str:
    """What to write in a case that lacks these variables and constants."""
    return ": write `attitude: yes`" if "attitude" in lacks else ""
