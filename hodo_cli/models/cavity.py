"""The averaged equations of a body with a cavity full of viscous fluid, under a torque that is
constant in body axes: of symmetric bodies, where two amplitudes say all, and of all others."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arithmetic import hypot
from ..schema.kinds import Choice, Key, Mistake
from .averaged import AveragedTurns, turn_means
from .base import Event, Label, Model
from .body import Cavity


def is_triaxial(data: Mapping[str, Any]) -> bool:
    """Whether the data are of a body with three different moments."""
    return len({*data.get("inertia", ())}) == 3


def axial_spin(t: Any, y: Sequence[Any], k: Any) -> Any:
    """r of a symmetric body, as an event."""
    return y[1]


@dataclass(frozen=True)
class SymmetricCavity(Cavity):
    """What the forms in a = sqrt(p^2 + q^2) and r share."""

    spin_reversal: str = "stop"

    keys = Cavity.keys | {
        "spin_reversal": Key(
            Choice("stop", "continue"), "what to do where r reaches 0", default="stop"
        ),
    }
    state = ("a", "r")
    degree = {"kappa": 3, "N3": 0}
    class_events = ()
    variables = {
        "x": Label(("time",), "square of the equatorial angular velocity, p^2 + q^2", "1/time^2"),
        "y": Label(("time",), "square of the axial angular velocity, r^2", "1/time^2"),
    }
    no_axis_reason = "averaged over the hodograph's turns: it circles x3, and crosses nothing"

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        a, r = y.T
        return {"x": a * a, "y": r * r}

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Besides: A1 = A2."""
        yield from super().check(data)
        A = data.get("inertia")
        if A is not None and A[0] != A[1]:
            yield (
                ("inertia",),
                f"form {cls.form} needs A1 = A2, not {A[0]} and {A[1]}; form full does not",
            )

    @property
    def start(self) -> tuple[float, ...]:
        p, q, r = super().start
        return hypot(p, q), r

    @property
    def extended_start(self) -> np.ndarray:
        # The roots of x and y have digits that a double has not, and x and y are what is stored.
        squares = [self.initial.get(name) for name in "xy"]
        if None not in squares:
            return np.sqrt(np.array(squares, dtype=np.longdouble))
        p, q, r = np.array(super().start, dtype=np.longdouble)
        return np.array([np.hypot(p, q), r])

    def starts(self, omega: np.ndarray) -> np.ndarray:
        p, q, r = np.moveaxis(omega, -1, 0)
        return np.stack((np.hypot(p, q), r))

    @property
    def warnings(self) -> list[str]:
        """Besides: M1 and M2 where the turns do not average them away."""
        A, _, C = self.inertia
        a, r = self.start
        dropped = abs(self.epsilon) * math.hypot(*self.torque[:2])
        turning = abs((C - A) * r) * a
        if not dropped:
            return super().warnings
        ratio = f"{dropped / turning:.3g}" if turning else "infinite"
        return [
            *super().warnings,
            "averaging drops M1 and M2, which is right while "
            "epsilon |(M1, M2)| / (|C - A| |r| a) is small: "
            f"it is {ratio} at the start, and grows as r falls",
        ]

    @property
    def run_events(self) -> tuple[Event, ...]:
        """The end of spin of a body that spins, or begins to."""
        event = Event("end_of_spin", axial_spin, terminal=self.spin_reversal == "stop")
        return (event,) if self.start[1] or self.constants["N3"] else ()


@dataclass(frozen=True)
class Averaged(SymmetricCavity):
    """The motion of an axisymmetric body (A1 = A2 = A, A3 = C) averaged over the turning of (p, q)
    about x3.

    a' = -kappa C (C - A) a r^2 / A^3
    r' = kappa (C - A) a^2 r / (A C) + epsilon M3 / C

    a = sqrt(p^2 + q^2) and r, 1/time; stored are x = a^2 and y = r^2; the other symbols are those
    of the full form. Without M1 and M2 this is no approximation but an identity of the full
    equations. With them it is right to first order in epsilon, until r, and with it the frequency
    |(C - A) r/A|, has become small. r reaches 0 in finite time where M3 opposes it: the end of
    spin, an event that ends the motion or is passed (`spin_reversal`). In y the equations are not
    Lipschitz there, and solvers stop or go astray.

    Source: D. Leshchenko and T. Kozachenko, Mechanics and Mathematical Methods V(1) (2023) 25, eqs
    (5), (6), with the sign of a' that follows from (2), and +epsilon M3 in r' as in (2) and (6),
    not - as in (5).

    A body with three different moments is averaged by `AveragedTriaxial`.
    """

    form = "averaged"

    @classmethod
    def form_of(cls, data: Mapping[str, Any]) -> type[Model]:
        return AveragedTriaxial if is_triaxial(data) else cls

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """A1 = A2, or three different moments."""
        yield from AveragedTriaxial.check(data) if is_triaxial(data) else super().check(data)

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        a, r = y
        return (
            -k.kappa * k.A3 * (k.A3 - k.A1) / k.A1**3 * a * r * r,
            k.kappa * (k.A3 - k.A1) / (k.A1 * k.A3) * a * a * r + k.N3 / k.A3,
        )


@dataclass(frozen=True)
class AveragedAsPrinted(SymmetricCavity):
    """The averaged equations with the sign of a' as printed in eqs (5) and (6), to reproduce the
    paper's figures.

    a' = +kappa C (C - A) a r^2 / A^3

    With this sign the fluid's torque, though internal, changes |G|: without M, x - C^2 y/A^2 is
    constant, where it should be x + C^2 y/A^2 = (G/A)^2. Everything else is as in the form
    averaged.

    Source: D. Leshchenko and T. Kozachenko, Mechanics and Mathematical Methods V(1) (2023) 25, eqs
    (5), (6).
    """

    form = "averaged-as-printed"

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        a, r = Averaged.rhs(t, y, k)
        return -a, r


@dataclass(frozen=True)
class AveragedTriaxial(AveragedTurns, Cavity):
    """The motion of a body with three different moments averaged over the turns of the free one,
    to first order and without a torque. |G| is constant, and the fluid turns the body to its axis
    of largest inertia.

    (2T)' = -(2 kappa/abc) [(a-c)^2 (a+c-b) <p^2 r^2> + (a-b)^2 (a+b-c) <p^2 q^2>
                            + (b-c)^2 (b+c-a) <q^2 r^2>]

    a >= b >= c are the moments with their axes sorted, <.> is the mean over a turn.

    Source: F. L. Chernousko 1972, averaged.
    """

    spin_reversal: str = "stop"

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Besides: no torque."""
        yield from super().check(data)
        if any(data.get("torque", ())):
            yield (
                ("torque",),
                "form averaged of a body with three different moments takes no torque; form full "
                "does",
            )

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        A_e, b, A_o = np.sort(self.moments)[::-side]
        (m, _, ss, rest), span, near = turn_means(v), abs(A_e - A_o), abs(A_e - b)
        far, square = (
            abs(b - A_o),
            float(np.exp(self.slow_start[2]) @ np.sort(self.moments)[[2, 0]]),
        )
        sscc, ratio = (ss - 2 * rest) / 3, m * near / far  # <sn^2 cn^2>, X_o/X_e
        loss = (
            (A_e + A_o - b) * (1 - ss - m * sscc) / (A_e * A_o)
            + near * (A_e + b - A_o) * (ss - m * (ss - sscc)) / (A_e * b * span)
            + m * far * (b + A_o - A_e) * sscc / (b * A_o * span)
        )
        rate = side * 2 * self.constants["kappa"] / (A_e * b * A_o) * loss
        # square = G^2 (a - c) = a X + c Y = A_e X_e + A_o X_o
        X_e = square / (A_e + A_o * ratio)
        return rate * square, *(rate * A_o * ratio * X_e, -rate * A_e * X_e)[::side]
