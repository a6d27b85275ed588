"""The averaged forms of the body with a fluid-filled cavity: symmetric bodies, where two amplitudes
say all, and all others."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..arithmetic import hypot
from ..schema.kinds import Choice, Key, Mistake
from .averaging.capture import AT_SEPARATRIX, FREE
from .averaging.fluid import (
    fluid_constants,
    fluid_distance,
    fluid_output,
    fluid_part,
    fluid_rates,
    through_with_fluid,
)
from .averaging.forms import MEAN_START, AveragedTurns, either, turning_constants
from .averaging.free_turn import SlowVariables
from .base import Constants, Event, Label, Model
from .cavity import Cavity
from .constants import attributes
from .terms.fluid import coefficient


def axial_spin(t: Any, y: Sequence[Any], k: Any) -> Any:
    """r of a symmetric body, as an event."""
    return y[1]


def enclosed_amplitude(t: Any, y: Sequence[Any], k: Any) -> Any:
    """g, the amplitude about the enclosed axis with the sense of rotation, as an event."""
    return y[0]


@dataclass(frozen=True)
class SymmetricCavity(Cavity):
    """What the forms in a = sqrt(p^2 + q^2) and r share."""

    spin_reversal: str

    name = "cavity+constant"
    keys = Cavity.keys | {
        "spin_reversal": Key(
            Choice("stop", "continue"), "what to do where r reaches 0", default="stop"
        ),
    }
    state = ("a", "r")
    smallest, fastest = AveragedTurns.smallest, AveragedTurns.fastest
    class_events = ()
    variables = {
        "x": Label(("time",), "square of the equatorial angular velocity, p^2 + q^2", "1/time^2"),
        "y": Label(("time",), "square of the axial angular velocity, r^2", "1/time^2"),
    }
    no_axis_reason = "averaged over the hodograph's turns: it circles x3, and crosses nothing"

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        a, r = y.T
        return {"x": a * a, "y": r * r}

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        yield from super().check(data)
        A = data.get("inertia")
        if A is not None and A[0] != A[1]:
            unequal = f"{A[0]:.17g} and {A[1]:.17g}"
            yield (
                ("inertia",),
                f"form {cls.form} needs A1 = A2, not {unequal}; form full does not",
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

    @cached_property
    def constants(self) -> Constants:
        A, _, C = self.inertia
        kappa = coefficient(self.cavity, self.kappa)
        return {"A": A, "C": C, "kappa": kappa, "N3": self.applied[2]}

    @property
    def warnings(self) -> list[str]:
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
        if not (self.start[1] or self.constants["N3"]):
            return ()
        return (Event("end_of_spin", axial_spin, terminal=self.spin_reversal == "stop"),)


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

    A body with A1 and A2 different is averaged by `AveragedTriaxial`.
    """

    mean_start: str
    at_separatrix: str

    form = "averaged"
    keys = SymmetricCavity.keys | {
        "mean_start": MEAN_START,
        "at_separatrix": AT_SEPARATRIX,
    }

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        a, r = y
        return (
            -k.kappa * k.C * (k.C - k.A) / k.A**3 * a * r * r,
            k.kappa * (k.C - k.A) / (k.A * k.C) * a * a * r + k.N3 / k.C,
        )

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        inertia = data.get("inertia", (1.0, 1.0, 1.0))
        symmetric = inertia[0] == inertia[1]
        yield from super().check(data) if symmetric else AveragedTriaxial.check(data)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Model:
        symmetric = data["inertia"][0] == data["inertia"][1]
        return cls(**data) if symmetric else AveragedTriaxial(**data)


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
    """The motion of a body with three different moments of inertia, averaged over the turns of its
    hodograph.

    (2T)' = -(2 kappa/(a b c)) [(a-c)^2 (a+c-b) <p^2 r^2> + (a-b)^2 (a+b-c) <p^2 q^2>
                                + (b-c)^2 (b+c-a) <q^2 r^2>] + 2 epsilon M.<omega>
    (G^2)' = 2 epsilon M.<A omega>

    a >= b >= c are the moments with their axes sorted, <.> the mean over a turn of the free motion,
    whose <omega> lies along the enclosed axis; the other symbols are those of the full form.
    Without M every motion ends about the axis of the largest moment, and the passage through the
    separatrix is foreseen as under linear resistance. With M it is a matter of chance which of four
    regions a motion enters there: it stops, with the probability of the other axis, or takes the
    branch of `at_separatrix`. Right to first order; with `mean_start: yes` to
    second, unless M has parts about both axes that are not enclosed.

    Source: F. L. Chernousko 1972, averaged; the probabilities after A. I. Neishtadt 1986.
    """

    spin_reversal: str
    at_separatrix: str

    state = ("g", "f", "scaled_phase", "side", "sense")
    rhs = staticmethod(fluid_rates)
    output = staticmethod(fluid_output)

    @property
    def sorted_torque(self) -> np.ndarray:
        """epsilon M along the axes of largest, middle and smallest moment of inertia."""
        return self.body.sort(self.applied)

    @property
    def unit(self) -> float:
        """|G| sqrt((a - c)/a) at the start: the size of g or f, whatever its direction."""
        body, omega = self.body, self.velocity(self.inertia, self.initial)
        G = np.linalg.norm(np.array(self.inertia) * omega)
        return float(G * math.sqrt((body.a - body.c) / body.a))

    @cached_property
    def constants(self) -> Constants:
        body, kappa = self.body, coefficient(self.cavity, self.kappa)
        torque, unit = self.sorted_torque.tolist(), self.unit
        pace = kappa * unit * unit / (body.a * body.b * body.c)
        # heyoka counts parameters up to the last that the equations use: that has to come last.
        return {
            **turning_constants(body),
            "mean_start": self.mean_start,
            "branch": self.at_separatrix if any(torque) else FREE,
            **fluid_constants(body, kappa, torque, unit),
            "scale": max(pace, math.hypot(*torque) / unit) or 1.0,
        }

    def periodic_start(self, slow: SlowVariables) -> tuple[np.ndarray, np.ndarray]:
        square = self.unit**2
        small = slow._replace(X=slow.X / square, Y=slow.Y / square)
        part_e, part_o = fluid_part(attributes(self.constants), small)
        return part_e / self.unit, part_o / self.unit

    def states(self, slow: SlowVariables) -> np.ndarray:
        unit, scale = self.unit, self.constants["scale"]
        assert isinstance(scale, float)
        g, f = (np.sqrt(value) / unit for value in slow.pair)
        scaled_phase = slow.sense * scale * slow.phase
        return np.stack((slow.sense * g, f, scaled_phase, slow.side + 0.0, slow.sense + 0.0))

    def at_distance(self, y: np.ndarray, m1: Any) -> np.ndarray:
        k = attributes(self.constants, np.longdouble)
        f = np.abs(y[0]) * np.sqrt((1 - m1) / either(y[3], k.ratio_a, k.ratio_c))
        return np.array([y[0], f, *y[2:]])

    def smallness(self, y: np.ndarray) -> np.ndarray:
        g, f = y.T[:2]
        k = attributes(self.constants)
        dg, df, turning, _, _ = fluid_rates(0.0, [*y.T], k)
        # f of an exact rotation about the enclosed axis is 0, and stays so.
        fall = np.divide(np.abs(df), f, out=np.zeros_like(f), where=f > 0)
        # turning is scale n <dn>, and K is pi/(2 <dn>)
        return np.asarray(np.maximum(np.abs(dg / g), fall) * np.pi / 2 * k.scale / np.abs(turning))

    @property
    def run_events(self) -> tuple[Event, ...]:
        passage = Event("separatrix", fluid_distance, terminal=True, passage=through_with_fluid)
        end = Event("end_of_spin", enclosed_amplitude, terminal=self.spin_reversal == "stop")
        # Only a symmetric body can lose its spin before it comes to a separatrix.
        return (end,) if len(set(self.inertia)) == 2 else (passage,)
