"""A model of a user's own with laws of the time and variables of other units than omega."""

import math
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from hodo_cli.models.base import Constants, Label
from hodo_cli.models.rigid_body import INERTIA, INITIAL, BodyFrame
from hodo_cli.schema.kinds import Choice, Key, Number, vector

LAWS = {
    "falling": lambda x, e: (1 + x) ** -2,
    "polynomial": lambda x, e: 1 - x + x * x / 2,
    "exponential": lambda x, e: e ** (-x),
}


@dataclass(frozen=True)
class Timed(BodyFrame):
    """A body under damping, a torque constant in it and one constant in space, all with one law of
    rate t; gamma is the direction of the torque in space."""

    damping: tuple[float, float, float]
    torque: float
    force: float
    rate: float
    law: str

    name = "timed"
    form = "full"
    keys: ClassVar[dict[str, Key]] = {
        "inertia": INERTIA,
        "damping": Key(vector(3), "lambda"),
        "torque": Key(Number(), "N3"),
        "force": Key(Number(), "F"),
        "rate": Key(Number(), "of the law"),
        "law": Key(Choice(*LAWS), "f(rate t)"),
        "initial": INITIAL,
    }
    state = ("p", "q", "r", "g1", "g2", "g3")
    variables: ClassVar[dict[str, Label]] = BodyFrame.variables | {
        "gamma": Label(("time", "axis"), "direction of the force")
    }

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r, g1, g2, g3 = y
        f = LAWS[k.law](k.rate * t, k.e)
        return (
            ((k.A2 - k.A3) * q * r + k.F * f * g1) / k.A1 - k.lam[0] * f * p,
            ((k.A3 - k.A1) * p * r + k.F * f * g2) / k.A2 - k.lam[1] * f * q,
            ((k.A1 - k.A2) * p * q + k.F * f * g3 + k.n * f) / k.A3 - k.lam[2] * f * r,
            (g2 * r - g3 * q),
            (g3 * p - g1 * r),
            (g1 * q - g2 * p),
        )

    @staticmethod
    def output(t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        return {"omega": y[:, :3], "gamma": y[:, 3:]}

    @property
    def start(self) -> tuple[float, ...]:
        return (*super().start, 0.0, 0.6, 0.8)

    @cached_property
    def constants(self) -> Constants:
        own = {"lam": self.damping, "n": self.torque, "F": self.force, "rate": self.rate}
        return {**super().constants, **own, "law": self.law, "e": math.e}
