"""A model of a user's own with laws of the time and variables of other units than omega."""

import math
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np

from hodo_cli.models import base, rigid_body
from hodo_cli.schema import kinds

LAWS = {
    "falling": lambda x, e: (1 + x) ** -2,
    "polynomial": lambda x, e: 1 - x + x * x / 2,
    "exponential": lambda x, e: e ** (-x),
}


@dataclass(frozen=True)
class Timed(rigid_body.BodyFrame):
    """A body under damping, a torque constant in it and one constant in space, all with one law of
    rate t; gamma is the direction of the torque in space."""

    damping: tuple[float, float, float]
    torque: float
    force: float
    rate: float
    law: str

    name = "timed"
    form = "full"
    keys: ClassVar[dict[str, kinds.Key]] = {
        "inertia": rigid_body.INERTIA,
        "damping": kinds.Key(kinds.vector(3), "lambda"),
        "torque": kinds.Key(kinds.Number(), "N3"),
        "force": kinds.Key(kinds.Number(), "F"),
        "rate": kinds.Key(kinds.Number(), "of the law"),
        "law": kinds.Key(kinds.Choice(*LAWS), "f(rate t)"),
        "initial": rigid_body.INITIAL,
    }
    state = ("p", "q", "r", "g1", "g2", "g3")
    variables: ClassVar[dict[str, base.Label]] = rigid_body.BodyFrame.variables | {
        "gamma": base.Label(("time", "axis"), "direction of the force")
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
    def constants(self) -> base.Constants:
        own = {"lam": self.damping, "n": self.torque, "F": self.force, "rate": self.rate}
        return {**super().constants, **own, "law": self.law, "e": math.e}
