"""Linear resistance proportional to the angular momentum, component by component."""

from dataclasses import dataclass
from typing import Any

from ..schema.kinds import Key, vector
from .averaged import AveragedTurns
from .rigid_body import INERTIA, INITIAL
from .terms.body import BodyUnderTorques
from .terms.torques import degree_under


@dataclass(frozen=True)
class LinearDiag(BodyUnderTorques):
    """A rigid body in a medium that resists each component of its angular momentum linearly.

    A1 p' + (A3 - A2) q r = -lambda1 A1 p
    A2 q' + (A1 - A3) p r = -lambda2 A2 q
    A3 r' + (A2 - A1) p q = -lambda3 A3 r

    p, q, r: angular velocity about x1, x2, x3, 1/time (`initial`); A1, A2, A3: principal moments of
    inertia (`inertia`); lambda1, lambda2, lambda3: coefficients of resistance, 1/time (`damping`),
    all zero for free motion. Assumed: constant coefficients, about the same axes as the inertia.

    D changes sign at most once: with l and s the axes of largest and smallest inertia, where D = 0
    dD/dt = -2 (lambda_l - lambda_s) A_l (A_l - A_m) w_l^2, which never changes sign.

    Source: A. L. Rachinskaya, rotation of a rigid body in a resistant medium, eqs (1)-(4).
    """

    damping: tuple[float, float, float]

    name = "linear-diag"
    form = "full"
    keys = {
        "inertia": INERTIA,
        "damping": Key(
            vector(3, scalar=True),
            "coefficients of resistance lambda_i; a scalar means all three equal",
            unit="1/time",
            default=(0.0, 0.0, 0.0),
        ),
        "initial": INITIAL,
    }
    terms = ("damping",)
    degree = degree_under(terms)
    always_absorbing = True


@dataclass(frozen=True)
class AveragedLinearDiag(AveragedTurns, LinearDiag):
    """The motion averaged over the turns of the free one, to first order in lambda/|omega|.

    u > 0:  (ln X)' = -2 [lambda1 <dn^2> + lambda2 (1 - <dn^2>)]
            (ln Y)' = -2 [lambda3 <cn^2> + lambda2 (1 - <cn^2>)]
    u < 0:  the same with <dn^2> and <cn^2> exchanged

    X = a(a-c) p^2 + b(b-c) q^2 and Y = b(a-b) q^2 + c(a-c) r^2, moment of inertia^2/time^2;
    a >= b >= c: the moments of inertia with their axes sorted, here A1 >= A2 >= A3;
    u = ln[(a-b) X/((b-c) Y)], positive where axis a is enclosed; <dn^2> and <cn^2>: means over a
    turn for k^2 = e^-|u|; the other symbols are those of the full form. The moments have a part in
    the start only. The separatrix u = 0 is crossed once at most, at a time that errs by some turns.

    Source: L. D. Akulenko, D. D. Leshchenko, F. L. Chernousko, Izv. AN SSSR MTT 1982 no. 3, 5.
    """

    form = "averaged"

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        return self.linear_rates(self.damping, side, v)
