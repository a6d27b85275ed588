"""A motion as an integration returns it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..cases.case import Case
from ..engines.protocol import Status
from ..models.base import Model, attributes, rescaled


@dataclass(frozen=True)
class Occurrence:
    """One event of a motion: its kind, its time, and the measured error of that."""

    kind: str
    time: float
    details: Mapping[str, float] = field(default_factory=dict)
    error: float = math.nan


@dataclass(frozen=True)
class Trajectory:
    """A case, integrated by a method at a tolerance.

    `system` is the model with the data that were integrated, which are finer than those of the case
    where the motion needed them. `time` (n,) in the case's units; `state` (n, m) in the working
    precision, scaled: a state of a model with units of its own is in units of omega of 2**exponent,
    with `exponent` (n,). `evaluations` of the equations: for a series, one for each order of each
    step. `status` and `message` say why a motion ended before its time, if it did. `errors` holds
    the measured error of each variable.
    """

    case: Case
    system: Model
    method: str
    tol: float
    time: np.ndarray
    state: np.ndarray
    exponent: np.ndarray
    events: tuple[Occurrence, ...] = ()
    steps: int = 0
    evaluations: int = 0
    run_time: float = 0.0
    status: Status = Status.OK
    message: str = ""
    method_reason: str = "asked for"
    warnings: tuple[str, ...] = ()
    errors: Mapping[str, float] = field(default_factory=dict)
    error_kind: str = "none"

    @classmethod
    def failed(cls, case: Case, message: str) -> "Trajectory":
        """A case that could not be integrated: no samples."""
        state, tol = np.empty((0, len(case.system.equations.state))), case.tol or float("nan")
        time, exponent = np.empty(0), np.empty(0, dtype=np.int64)
        return cls(
            case, case.system, case.method, tol, time, state, exponent, status=Status.FAILED,
            message=message,
        )  # fmt: skip

    @property
    def succeeded(self) -> bool:
        """Whether the motion was not given up."""
        return self.status is Status.OK

    @property
    def error(self) -> float:
        """The largest measured error, or nan."""
        return max(self.errors.values(), default=float("nan"))

    @property
    def omega(self) -> np.ndarray:
        """The angular velocity (n, 3) of an oriented model, in units of 2**exponent."""
        return self.state[:, :3]

    @cached_property
    @np.errstate(over="ignore")  # `motion_remarks` says so
    def variables(self) -> dict[str, np.ndarray]:
        """The variables (n, ...) of its model by name, in double precision and true size."""
        system = self.case.system
        state = rescaled(system.equations, self.state.astype(float), self.exponent)
        return system.equations.output(self.time, state, attributes(system.constants))

    def with_remarks(self, **remarks: Any) -> "Trajectory":
        """The same motion with another message, other warnings or the case that was asked for."""
        motion = replace(self, **remarks)
        # Of a million samples the variables would take a tenth of the integration once more.
        vars(motion)["variables"] = self.variables
        return motion

    def at(self, rows: np.ndarray | slice) -> "Trajectory":
        """The same motion at some of its samples, with all events."""
        time, state, exponent = self.time[rows], self.state[rows], self.exponent[rows]
        return replace(self, time=time, state=state, exponent=exponent)
