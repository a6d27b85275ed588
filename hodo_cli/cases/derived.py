"""The quantities that follow from what is stored of a motion: the one table of their names, of
what they mean and need, and of their units. `results.motion` computes them."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

from ..models import added_variables
from ..models.base import Label, Model
from ..text import case_words

BODY_AXES = ("x1", "x2", "x3")
SPACE_AXES = ("x", "y", "z")

PARTS = {"axis": BODY_AXES, "space": SPACE_AXES, "quaternion": ("a", "b", "c", "d")}
"""The dimensions of what has several numbers at a time, and the names of these."""


class Derived(NamedTuple):
    """A quantity over time: its meaning, its units in words, the `sources` that it needs, any of
    several sets, and the dimension of its components; a number has none."""

    long_name: str
    units: str
    needs: Sequence[Sequence[str]]
    dim: str = ""

    @property
    def dims(self) -> tuple[str, ...]:
        """Its dimensions."""
        return ("time", self.dim) if self.dim else ("time",)


OMEGA, BODY, ATTITUDE = (("omega",),), (("omega", "inertia"),), (("attitude",),)
MOMENTUM, ENERGY = "moment of inertia / time", "moment of inertia / time^2"
OF_TOP = (("omega", "gamma"),)
OF_BODY = ("attitude", "omega", "inertia")

DERIVED = {
    "p": Derived("angular velocity about x1", "1/time", OMEGA),
    "q": Derived("angular velocity about x2", "1/time", OMEGA),
    "r": Derived("angular velocity about x3", "1/time", OMEGA),
    "G": Derived("|G|", MOMENTUM, (*BODY, ("momentum",), ("x", "y"))),
    "G2": Derived("G^2", "moment of inertia^2 / time^2", BODY),
    "T": Derived("kinetic energy", ENERGY, (*BODY, ("kinetic_energy",))),
    "J": Derived("G^2/2T", "moment of inertia", (*BODY, ("momentum", "kinetic_energy"))),
    "D": Derived("G^2 - 2 T A2, A2 the middle moment", "moment of inertia^2 / time^2", BODY),
    "D/2T": Derived(
        "G^2/2T - A2",
        "moment of inertia",
        (*BODY, ("momentum", "kinetic_energy", "inertia")),
    ),
    "x1_direction": Derived("|G1|/|G|, 1 where G lies along x1", "1", BODY),
    "tilt": Derived("angle between G and x3, in radians", "rad", BODY),
    "separatrix_distance": Derived("|D|/G^2", "1", BODY),
    "speed": Derived("|omega|", "1/time", OMEGA),
    "x": Derived("p^2 + q^2", "1/time^2", OMEGA),
    "y": Derived("r^2", "1/time^2", OMEGA),
    "Gz": Derived("vertical angular momentum", MOMENTUM, OF_TOP),
    "H": Derived("energy", ENERGY, OF_TOP),
    "u1": Derived("first root of the cubic of cos theta", "1", OF_TOP),
    "u2": Derived("second root", "1", OF_TOP),
    "u3": Derived("third root", "1", OF_TOP),
    "G_space": Derived("G along the axes of space", MOMENTUM, (OF_BODY,), "space"),
    "total_space": Derived(
        "G - kappa omega' of the free body, the momentum of body and fluid to first order in "
        "kappa, along the axes of space",
        MOMENTUM,
        ((*OF_BODY, "kappa"),),
        "space",
    ),
    "omega_space": Derived(
        "angular velocity along the axes of space", "1/time", (("attitude", "omega"),), "space"
    ),
    "x1_space": Derived("the axis x1 in space", "1", ATTITUDE, "space"),
    "x2_space": Derived("the axis x2 in space", "1", ATTITUDE, "space"),
    "x3_space": Derived("the axis x3 in space", "1", ATTITUDE, "space"),
    "rotation": Derived(
        "rotation vector from body to space: the axis times the angle, at most pi",
        "rad",
        ATTITUDE,
        "space",
    ),
    "psi": Derived("precession, the turn about z, in radians", "rad", ATTITUDE),
    "theta": Derived("nutation, the angle between z and x3, in radians", "rad", ATTITUDE),
    "phi": Derived("spin, the turn about x3, in radians", "rad", ATTITUDE),
}


def component_names(name: str, dim: str) -> list[str]:
    """The names of the numbers of a variable or quantity: its own, or those of its components."""
    return [f"{name}.{part}" for part in PARTS[dim]] if dim else [name]


COMPONENTS = {
    component: quantity.long_name
    for name, quantity in DERIVED.items()
    for component in component_names(name, quantity.dim)
}
"""What each quantity, and each component of one, is in words: `T`, `G_space.z`."""

STORED_VARIABLES = {
    "omega": Label(("time", "axis"), "angular velocity in body axes"),
    "attitude": Label(("time", "quaternion"), "quaternion from body to space axes"),
    "gamma": Label(("time", "axis"), "the vertical in the axes of a top"),
    "momentum": Label(("time",), "|G| of an averaged form"),
    **added_variables(),
}
"""The variables that some model stores and no quantity stands for, those of the user's own models
among them."""

OVER_TIME = COMPONENTS | {
    number: label.long_name
    for name, label in STORED_VARIABLES.items()
    for number in component_names(name, "".join(label.dims[1:]))
}
"""The numbers over time that a statement or a formula may name, in words."""


def constants_of(system: Model, data: Mapping[str, Any]) -> set[str]:
    """The constants of a body on which quantities rest."""
    names = {"inertia"} if data.get("inertia") else set()
    # Only of a body that has an attitude: the constants of a mean take long to compute.
    has_fluid = "attitude" in system.variables and "kappa" in system.constants
    return names | {"kappa"} if has_fluid else names


def missing(name: str, sources: Collection[str], known: Collection[str] = ()) -> list[str]:
    """What a quantity needs besides these stored variables and constants; an empty list where it
    follows from them. A variable needs itself.

    A quantity may follow from any of several sets: what is lacking is of a set that lacks nothing
    or, if there is none, of the first that lacks `known` variables only.
    """
    sets = DERIVED[name].needs if name in DERIVED else ((name,),)
    lacks_of_sets = [[need for need in needs if need not in sources] for needs in sets]
    return min(lacks_of_sets, key=lambda lacks: (bool(lacks), not {*lacks} <= {*known}))


def derivable(sources: Collection[str]) -> list[str]:
    """The quantities that follow from these stored variables and constants."""
    return [name for name in DERIVED if not missing(name, sources)]


def derivable_numbers(sources: Collection[str]) -> list[str]:
    """These quantities by their components."""
    return [
        part for name in derivable(sources) for part in component_names(name, DERIVED[name].dim)
    ]


class LeftOut(str):
    """A message on a case whose `store:` leaves out what is needed: in a case file it is a mistake
    there, wherever the need arises."""

    case: str

    def __new__(cls, case: str, needed: str) -> "LeftOut":
        message = super().__new__(cls, f"the `store:` of {case_words(case)} leaves out {needed}")
        message.case = case
        return message


def lack_of(case: Any, name: str, sources: Collection[str], user: str) -> str:
    """What is wrong with a case that lacks what a variable or quantity, which the `user` names,
    needs besides these variables and constants, and what mends it; an empty string if it has all.
    """
    known = case.system.variables
    if not (lacks := missing(name, sources, known)):
        return ""
    variables = " and ".join(lacks)
    if case.leaves_out(lacks):
        where = " at the ends of members" if case.sweep else ""
        return LeftOut(case.name, f"{variables}{where}, which {user} needs")
    remedy = remedy_of([x for x in lacks if x not in known])
    if remedy and case.store:
        remedy += f", and {variables} in its `store:`"
    return f"{case_words(case.name)} has no {variables}, which {user} needs{remedy}"


def remedy_of(lacks: Sequence[str]) -> str:
    """What to write in a case without these variables and constants."""
    return ": write `attitude: yes`" if "attitude" in lacks else ""
