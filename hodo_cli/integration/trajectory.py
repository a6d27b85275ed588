"""What an integration returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..cases.case import Case
from ..engines.protocol import Status


@dataclass(frozen=True)
class Occurrence:
    """One event of a motion: what, and when."""

    kind: str
    time: float
    details: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Trajectory:
    """A case, integrated.

    `time` (n,) in the case's units; `state` (n, m) in the working precision, scaled: a state of a
    model with units of its own is state * 2**exponent, with `exponent` (n,). `variables` are what
    is stored, in double precision and true size. `errors` holds the measured error of each
    variable, `error` the largest of them, or nan where none was measured.
    """

    case: Case
    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    variables: dict[str, np.ndarray]
    method: str
    method_reason: str
    tol: float
    steps: int
    run_time: float
    status: Status = Status.OK
    message: str = ""
    warnings: tuple[str, ...] = ()
    events: tuple[Occurrence, ...] = ()
    errors: dict[str, float] = field(default_factory=dict)
    error_kind: str = "none"

    @property
    def error(self) -> float:
        """The largest measured error, or nan."""
        return max(self.errors.values(), default=float("nan"))
