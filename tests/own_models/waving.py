"""Models of a user's own whose equations contain functions, the time and more than omega."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from hodo_cli import functions
from hodo_cli.models import base, rigid_body
from hodo_cli.schema import kinds


def free(p: Any, q: Any, r: Any, k: Any) -> tuple[Any, Any, Any]:
    """The rates of a free body."""
    return (
        (k.A2 - k.A3) / k.A1 * q * r,
        (k.A3 - k.A1) / k.A2 * p * r,
        (k.A1 - k.A2) / k.A3 * p * q,
    )


@dataclass(frozen=True)
class Waving(rigid_body.BodyFrame):
    """Equal damping -m'/m, m = 1 + a sin(b t), from the time itself."""

    depth: float
    rate: float

    name = "waving"
    form = "full"
    keys: ClassVar[dict[str, kinds.Key]] = {
        "inertia": rigid_body.INERTIA,
        "depth": kinds.Key(kinds.Number(), "a"),
        "rate": kinds.Key(kinds.Number(), "b"),
        "initial": rigid_body.INITIAL,
    }

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r = y[:3]
        rate = k.a * k.b * functions.cos(k.b * t) / (1 + k.a * functions.sin(k.b * t))
        return tuple(f + rate * x for f, x in zip(free(p, q, r, k), y, strict=True))

    @cached_property
    def constants(self) -> base.Constants:
        return {**super().constants, "a": self.depth, "b": self.rate}


@dataclass(frozen=True)
class Oscillating(Waving):
    """The same, with sin(b t) and cos(b t) as two more variables of the state."""

    name = "oscillating"
    form = "full"
    state = ("p", "q", "r", "s", "c")
    variables: ClassVar[dict[str, base.Label]] = rigid_body.BodyFrame.variables | {
        "s": base.Label(("time",), "sine")
    }

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r, s, c = y
        rate = k.a * k.b * c / (1 + k.a * s)
        own = [f + rate * x for f, x in zip(free(p, q, r, k), (p, q, r), strict=True)]
        return (*own, k.b * c, -k.b * s)

    @property
    def start(self) -> tuple[float, ...]:
        return (*super().start, 0.0, 1.0)


@dataclass(frozen=True)
class Disguised(rigid_body.BodyFrame):
    """Damping about three axes, times functions that are 1 together."""

    damping: tuple[float, float, float]

    name = "disguised"
    form = "full"
    keys: ClassVar[dict[str, kinds.Key]] = {
        "inertia": rigid_body.INERTIA,
        "damping": kinds.Key(kinds.vector(3), "lambda"),
        "initial": rigid_body.INITIAL,
    }

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        p, q, r = y
        square = (p * p + r * r) / (p * p + q * q + r * r)
        one = (
            functions.sin(square) ** 2
            + functions.sqrt(functions.cos(square) ** 4)
            + functions.exp(functions.log(1 + square))
            - 1
            - square
        )
        terms = zip(free(p, q, r, k), k.lam, y, strict=True)
        return tuple(f - one * lam * x for f, lam, x in terms)

    @cached_property
    def constants(self) -> base.Constants:
        return {**super().constants, "lam": self.damping}


@dataclass(frozen=True)
class Driven(Waving):
    """A free body, and s = a sin(b t) beside it."""

    name = "driven"
    form = "full"
    state = ("p", "q", "r", "s")
    variables: ClassVar[dict[str, base.Label]] = rigid_body.BodyFrame.variables | {
        "s": base.Label(("time",), "sine")
    }

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        return (*free(*y[:3], k), k.a * k.b * functions.cos(k.b * t))

    @property
    def start(self) -> tuple[float, ...]:
        return (*super().start, 0.0)


@dataclass(frozen=True)
class Swing(base.Model):
    """No body: u = u0 + a sin(b t), and v, which falls beside it."""

    depth: float
    rate: float
    initial: float

    name = "swing"
    form = "full"
    keys: ClassVar[dict[str, kinds.Key]] = {
        name: kinds.Key(kinds.Number(), name) for name in ("depth", "rate", "initial")
    }
    state = ("u", "v")
    variables: ClassVar[dict[str, base.Label]] = {
        name: base.Label(("time",), name) for name in ("u", "v")
    }

    @staticmethod
    def rhs(t: Any, y: Any, k: Any) -> tuple[Any, ...]:
        return k.a * k.b * functions.cos(k.b * t), -0.1 * y[1]

    @staticmethod
    def output(t: Any, y: Any, k: Any) -> dict[str, Any]:
        return {"u": y[:, 0], "v": y[:, 1]}

    @property
    def constants(self) -> base.Constants:
        return {"a": self.depth, "b": self.rate}

    @property
    def start(self) -> tuple[float, ...]:
        return self.initial, 1.0
