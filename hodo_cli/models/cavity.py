"""A body with a cavity full of viscous fluid, under a torque that is constant in body axes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from ..arithmetic import sqrt
from ..schema.kinds import Key, Mistake, Number, Table, vector
from .base import mistake_of
from .rigid_body import INERTIA, INITIAL, complete
from .terms.body import BodyUnderTorques
from .terms.fluid import CAVITY, coefficient, kappa_instead_of
from .terms.torques import CONSTANT, FLUID, rates_under

CAVITY_INITIAL = Key(
    Table(
        {
            **cast(Table, INITIAL.kind).keys,
            "x": Key(
                Number(least=0),
                "p^2 + q^2; x and y replace p, q and r",
                unit="1/time^2",
                default=None,
            ),
            "y": Key(Number(least=0), "r^2 (then r >= 0)", unit="1/time^2", default=None),
        }
    ),
    "initial angular velocity: p, q, r, or x and y (then p = sqrt(x), q = 0, r = sqrt(y))",
)


@dataclass(frozen=True)
class Cavity(BodyUnderTorques):
    """The part that the forms share: the keys and their checks."""

    cavity: Mapping[str, float | None] | None
    kappa: float | None
    torque: tuple[float, float, float]
    epsilon: float

    name = "cavity+constant"
    keys = {
        "inertia": INERTIA,
        "cavity": CAVITY,
        "kappa": kappa_instead_of("`cavity`"),
        "torque": Key(
            vector(3),
            "constant torque M1, M2, M3",
            unit="moment of inertia / time^2",
            default=(0.0, 0.0, 0.0),
        ),
        "epsilon": Key(Number(), "small parameter, the factor of the torque", default=1.0),
        "initial": CAVITY_INITIAL,
    }

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        yield from super().check(data)
        if {"cavity", "kappa"} <= set(data):
            cavity = data["cavity"]
            yield from mistake_of(("cavity",) if cavity else (), coefficient, cavity, data["kappa"])

    @staticmethod
    def velocity(
        inertia: Sequence[float], initial: Mapping[str, float | None]
    ) -> tuple[float, ...]:
        x, y = initial.get("x"), initial.get("y")
        if x is None and y is None:
            return complete(inertia, initial)
        if x is None or y is None or any(initial.get(name) is not None for name in "pqrG"):
            raise ValueError("give x and y alone, or p, q and r")
        return sqrt(x), 0.0, sqrt(y)


@dataclass(frozen=True)
class FullCavity(Cavity):
    """A rigid body with a cavity full of a very viscous fluid, under a torque constant in body
    axes.

    A1 p' + (A3 - A2) q r = kappa/(A1 A2 A3) p [A3 (A1 - A3)(A1 + A3 - A2) r^2
                                                + A2 (A1 - A2)(A1 + A2 - A3) q^2] + epsilon M1
    and cyclically

    p, q, r: angular velocity about x1, x2, x3, 1/time (`initial`); A1, A2, A3: principal moments of
    inertia of body and fluid together (`inertia`); kappa = rho P0/nu, moment of inertia * time
    (`cavity`, or `kappa`); M1, M2, M3: constant torque (`torque`) with its factor epsilon
    (`epsilon`). Assumed: small Reynolds number, torques small beside |omega| |G|. The fluid's
    torque is internal: without M, |G| is constant and the energy falls.

    Source: D. Leshchenko and T. Kozachenko, Mechanics and Mathematical Methods V(1) (2023) 25, eq.
    (2), where A1 = A2; F. L. Chernousko 1972 for the triaxial body. Their eq. (1) has epsilon^2,
    (2) epsilon.
    """

    form = "full"
    degree = {"g": 2} | FLUID.degree | CONSTANT.degree

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        return rates_under((FLUID, CONSTANT), t, y, k)
