"""The steps of an ensemble's motions, in columns, and the states and zeros within them."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...engines.polynomial import TAYLOR, Zeros, isolate, to_bernstein
from ...models.base import Event
from ...models.constants import Structure, namespace
from .motions import exact_difference

if TYPE_CHECKING:
    from ...engines.taylor_batch import TaylorStep

CLOCK_ROWS = 3
"""Rows of a column after its state: the time left until its end, what rounding has taken from that,
and the steps taken."""


class Columns(NamedTuple):
    """Motions under way, a column each (n,): what a compiled step takes, and whose it is.

    `rows` (m + CLOCK_ROWS, n) hold the state, in units of omega of 2**size and of time of 2**-rate,
    and the `clock` in this unit of time. `params` (c + 2, n) are the time of the end in the case's
    own unit, the constants in these units, and the `stride` of the steps. `motion` is the position
    in the ensemble; of a column without a motion it is -1.
    """

    rows: np.ndarray
    params: np.ndarray
    motion: np.ndarray
    size: np.ndarray
    rate: np.ndarray

    @property
    def state(self) -> np.ndarray:
        """The states (m, n)."""
        return self.rows[:-CLOCK_ROWS]

    @property
    def clock(self) -> np.ndarray:
        """The time left, what rounding has taken from it, and the steps taken (CLOCK_ROWS, n)."""
        return self.rows[-CLOCK_ROWS:]

    @property
    def constants(self) -> np.ndarray:
        """The constants of the equations (c, n)."""
        return self.params[1:-1]

    def named(self, structure: Structure) -> SimpleNamespace:
        """The constants by name."""
        return namespace(structure, [*self.constants])

    @property
    def time_and_correction(self) -> tuple[np.ndarray, np.ndarray]:
        """The case's own times (n,), as sums of two numbers: early in a long span the time left has
        fewer digits than the time itself."""
        remaining, lost, _ = self.clock
        time, correction = exact_difference(self.params[0], np.ldexp(remaining, -self.rate))
        return time, correction - np.ldexp(lost, -self.rate)

    @property
    def time(self) -> np.ndarray:
        """The case's own times (n,)."""
        return np.asarray(sum(self.time_and_correction))

    def chosen(self, index: np.ndarray) -> "Columns":
        """Copies of some columns, by position."""
        # From a list: at every step some are chosen, and a generator takes half as long again.
        return Columns(*[values.take(index, axis=-1) for values in self])


class TakenSteps(NamedTuple):
    """Steps (k,): the columns at their start, and their lengths in the columns' units of time."""

    start: Columns
    length: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence["TakenSteps"]) -> "TakenSteps":
        """The steps of several batches."""
        starts, lengths = zip(*parts, strict=True)
        columns = (np.concatenate(arrays, axis=-1) for arrays in zip(*starts, strict=True))
        return cls(Columns(*columns), np.concatenate(lengths))

    def chosen(self, index: np.ndarray) -> "TakenSteps":
        """Some of the steps, by position."""
        return TakenSteps(self.start.chosen(index), self.length[index])

    def times_at(self, x: np.ndarray) -> np.ndarray:
        """The case's own times (k,) at parts x (k,) of the steps."""
        time, correction = self.start.time_and_correction
        return np.asarray(time + (correction + np.ldexp(x * self.length, -self.start.rate)))

    def states_at(self, step: "TaylorStep", x: np.ndarray) -> np.ndarray:
        """The states (m, k) at parts x (k,) of the steps."""
        return states_after(step, self.start, x * self.length)

    def powers(self, step: "TaylorStep", event: Event) -> np.ndarray:
        """The series (k, order + 1) of an event's function, in powers of the part of each step."""
        rows, params = padded(self.start.rows), padded(self.start.params)
        series = step.event_series(event, rows, params)[:, : len(self.length)]
        return np.asarray(series.T * self.length[:, None] ** np.arange(len(series)))


def states_after(step: "TaylorStep", columns: Columns, elapsed: np.ndarray) -> np.ndarray:
    """The states (m, n) in a step of columns, some time (n,) behind its start, in their units: at
    the end of a step of this length."""
    n, rows, params = len(elapsed), padded(columns.rows), padded(columns.params)
    remaining = rows[-CLOCK_ROWS, :n]
    # The step begins when it did: at the end of the motion less the time that remains.
    params[0, :n] += np.ldexp(elapsed - remaining, -columns.rate)
    remaining[:] = elapsed
    out = np.empty((step.rows, rows.shape[1]))
    step(rows, params, out)
    return out[: len(columns.state), :n]


def padded(columns: np.ndarray) -> np.ndarray:
    """A copy of columns (..., n), with more of the last one up to a multiple of the engine's
    width."""
    from ...engines.taylor_batch import WIDTH  # heyoka may be missing

    copies = np.repeat(columns[..., -1:], -columns.shape[-1] % WIDTH, axis=-1)
    return np.concatenate((columns, copies), axis=-1)


def zeros_of(powers: np.ndarray, noise: np.ndarray) -> Zeros:
    """The zeros in [0, 1] of series (k, order + 1), with the bounds (k,) of their rounding."""
    # Row by row: one product of all would round as the number of rows happens to be.
    matrix = to_bernstein(TAYLOR, powers.shape[1] - 1, powers.dtype)
    return isolate(np.matmul(powers[:, None], matrix)[:, 0], noise)
