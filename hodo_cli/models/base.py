"""What every model states, and what the body-frame models share."""

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..schema.kinds import Key

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

    `rhs(t, y, k)` and the events are written with + - * / and ** only, so that numbers, arrays and
    the symbols of an engine all pass through the same lines. `k` has the names of `constants` as
    attributes.

    `degree` maps a constant to the degree in the angular velocity of the terms that it multiplies.
    It makes a change of units possible: with omega = sigma W and s = rho t, every such constant
    becomes value * sigma**(degree - 1) / rho. A model with an empty `degree` is integrated in its
    own units.

    `unclassifiable` says why the enclosed axis does not apply; it is empty where it does.
    `crosses_once` is set where a theorem says that D changes sign at most once.
    """

    name: ClassVar[str]
    form: ClassVar[str]
    keys: ClassVar[dict[str, Key]]
    state: ClassVar[tuple[str, ...]]
    variables: ClassVar[dict[str, Variable]]
    degree: ClassVar[dict[str, int]] = {}
    crosses_once: ClassVar[bool] = False
    unclassifiable: ClassVar[str] = (
        "the state has no angular velocity in body axes, so no axis is enclosed"
    )

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
