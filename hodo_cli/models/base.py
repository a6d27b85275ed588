"""What every model states, and what the body-frame models share."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .. import rigid
from ..schema.kinds import Key, Number, Table, Vector

Report = Callable[[tuple[str | int, ...], str], None]
"""Called as report(path within the case, what is right) for every mistake in a case."""


Constants = Mapping[str, float | tuple[float, ...] | str]
"""Numbers and tuples of numbers by name; a string is structure, which chooses between equations."""


class Variable(NamedTuple):
    """How one stored variable is labelled in a result file."""

    dims: tuple[str, ...]
    long_name: str
    units: str = "1"


class Event(NamedTuple):
    """A zero of `function(t, y, k)`; integration ends there if it is `terminal`."""

    kind: str
    function: Callable[[Any, Sequence[Any], Any], Any]
    terminal: bool = False


class Model:
    """One form of a model: its equations, stated once, and how case data become numbers.

    `rhs(t, y, k)` and the events are written with + - * / and ** only, so that numbers, arrays and the
    symbols of an engine all pass through the same lines. `k` has the names of `constants` as attributes.

    `degree` maps a constant to the degree in the angular velocity of the terms that it multiplies. It makes
    a change of units possible: with omega = sigma W and s = rho t, every such constant becomes
    value * sigma**(degree - 1) / rho. A model with an empty `degree` is integrated in its own units.

    `unclassifiable` says why the enclosed axis does not apply; it is empty where it does. `crosses_once` is set
    where a theorem says that D changes sign at most once.
    """

    name: ClassVar[str]
    form: ClassVar[str]
    keys: ClassVar[dict[str, Key]]
    state: ClassVar[tuple[str, ...]]
    variables: ClassVar[dict[str, Variable]]
    degree: ClassVar[dict[str, int]] = {}
    crosses_once: ClassVar[bool] = False
    unclassifiable: ClassVar[str] = "the state has no angular velocity in body axes, so no axis is enclosed"

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """The time derivative of each state variable."""
        raise NotImplementedError

    @classmethod
    def check(cls, data: Mapping[str, Any], report: Report) -> None:
        """Report what is wrong with values that are each right by themselves."""

    @classmethod
    def constants(cls, data: Mapping[str, Any]) -> Constants:
        """The numbers that `rhs` uses, by name."""
        raise NotImplementedError

    @classmethod
    def start(cls, data: Mapping[str, Any]) -> tuple[float, ...]:
        """The initial state."""
        raise NotImplementedError

    @classmethod
    def output(cls, t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        """The stored variables from the times (n,) and the states (n, m), in the dtype of `y`."""
        raise NotImplementedError

    @classmethod
    def warnings(cls, data: Mapping[str, Any]) -> list[str]:
        """What the data say against the model's own assumptions."""
        return []

    @classmethod
    def run_events(cls, data: Mapping[str, Any]) -> tuple[Event, ...]:
        """Events that belong to the motion itself and are recorded whenever it is integrated."""
        return ()

    @classmethod
    def class_events(cls, data: Mapping[str, Any]) -> tuple[Event, ...]:
        """Events that only `classify` looks for."""
        return ()


SMALLEST = 1e-100
"""The smallest moment of inertia whose cube is a double, and the inverse of the largest one."""

INERTIA = Key(Vector(3, above=0), "principal moments of inertia A1, A2, A3", unit="moment of inertia")
"""Three moments in any order; `BodyFrame.check` wants the triangle inequality and the range of SMALLEST besides."""

INITIAL = Key(
    Table(
        {
            "p": Key(Number(), "angular velocity about x1", unit="1/time", default=None),
            "q": Key(Number(), "angular velocity about x2", unit="1/time", default=None),
            "r": Key(Number(), "angular velocity about x3", unit="1/time", default=None),
            "G": Key(
                Number(above=0),
                "|G|, in place of one of p, q, r (its positive root)",
                unit="moment of inertia / time",
                default=None,
            ),
        }
    ),
    "initial angular velocity in body axes",
)


def complete(inertia: Sequence[float], initial: Mapping[str, float | None]) -> tuple[float, ...] | str:
    """(p, q, r) from initial data in which |G| may stand for one of them; a sentence if that cannot be done."""
    omega = [initial.get(axis) for axis in "pqr"]
    missing = [axis for axis, value in zip("pqr", omega, strict=True) if value is None]
    momentum = initial.get("G")
    if momentum is None and not missing:
        return tuple(omega)  # type: ignore[arg-type]
    if momentum is None:
        return f"{' and '.join(missing)} missing: give p, q and r, or two of them and G"
    if len(missing) != 1:
        return "G stands for exactly one of p, q, r: leave that one out and give the other two"
    with localcontext(prec=100):  # exact but for the root, so that the result is the nearest double
        parts = (Decimal(A) * Decimal(w) for A, w in zip(inertia, omega, strict=True) if w is not None)
        known = sum((part * part for part in parts), Decimal(0))
        rest = Decimal(momentum) ** 2 - known
        if rest < 0:
            return f"|G| is at least {known.sqrt():.6g} with the two given, so G: {momentum:.6g} leaves no {missing[0]}"
        at = "pqr".index(missing[0])
        omega[at] = float(rest.sqrt() / Decimal(inertia[at]))
    return tuple(omega)  # type: ignore[arg-type]


class BodyFrame(Model):
    """A model whose state is the angular velocity (p, q, r) in principal axes.

    Its constants carry A1, A2, A3 and `g` = 1, the factor of the gyroscopic terms (of degree 2).
    """

    state = ("p", "q", "r")
    unclassifiable = ""
    variables = {"omega": Variable(("time", "axis"), "angular velocity in body axes")}

    @classmethod
    def check(cls, data: Mapping[str, Any], report: Report) -> None:
        A = data.get("inertia")
        if A is None:
            return
        if 2 * max(A) > sum(A):
            largest = A.index(max(A))
            report(
                ("inertia", largest),
                f"no body has A{largest + 1} = {A[largest]:g} larger than the sum of the other two",
            )
        for i, moment in enumerate(A):
            if not SMALLEST <= moment <= 1 / SMALLEST:
                limits = f"{SMALLEST:g} to {1 / SMALLEST:g}"
                report(("inertia", i), f"{moment:g} is out of range, {limits}: take other units")
        if "initial" in data and isinstance(problem := complete(A, data["initial"]), str):
            report(("initial",), problem)

    @classmethod
    def start(cls, data: Mapping[str, Any]) -> tuple[float, ...]:
        omega = complete(data["inertia"], data["initial"])
        assert not isinstance(omega, str), omega
        return omega

    @classmethod
    def inertia(cls, data: Mapping[str, Any]) -> dict[str, float]:
        """The constants that every body-frame model has."""
        return dict(zip(("A1", "A2", "A3"), data["inertia"], strict=True)) | {"g": 1.0}

    @classmethod
    def output(cls, t: np.ndarray, y: np.ndarray, k: SimpleNamespace) -> dict[str, np.ndarray]:
        return {"omega": y}

    @classmethod
    def class_events(cls, data: Mapping[str, Any]) -> tuple[Event, ...]:
        return (Event("separatrix", Separatrix(rigid.inertia_order(data["inertia"]))),)


@dataclass(frozen=True)
class Separatrix:
    """D as an event; its order of axes is part of its identity, so that one compilation serves one order."""

    order: tuple[int, int, int]

    def __call__(self, t: Any, y: Sequence[Any], k: Any) -> Any:
        outer, inner = rigid.separatrix_terms((k.A1, k.A2, k.A3), y, self.order)
        return outer - inner
