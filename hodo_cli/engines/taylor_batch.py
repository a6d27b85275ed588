"""Many motions at once: heyoka's batch integrator, in which each lane of a SIMD register carries
one motion.

The lanes have steps of their own and do not influence each other, bit for bit: what stands beside a
motion, and how an ensemble is cut into parts, does not change it.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import heyoka as hy
import numpy as np

from ..models.base import Event, Model
from ..models.constants import Structure, count, namespace
from .protocol import Passages

hy.set_logger_level_error()


class Lanes:
    """One compiled integrator in double precision, with or without an event."""

    def __init__(
        self, model: type[Model], structure: Structure, event: Event | None, tol: float | None
    ) -> None:
        self.tol = 2.0**-52 if tol is None else max(tol, 2.0**-62)
        self.width = hy.recommended_simd_size()
        self._found: list[tuple[int, float, int, np.ndarray]] = []
        self._first = 0
        y = [hy.expression(name) for name in model.state]
        k = namespace(structure, [hy.par[i] for i in range(count(structure))])
        watched = (
            []
            if event is None
            else [hy.nt_event_batch(event.function(hy.time, y, k), self._recorder())]
        )
        self._ta = hy.taylor_adaptive_batch(
            list(zip(y, model.rhs(hy.time, y, k), strict=True)),
            np.zeros((len(y), self.width)),
            tol=self.tol,
            pars=np.zeros((count(structure), self.width)),
            nt_events=watched,
        )

    def _recorder(self) -> Callable[[Any, float, int, int], None]:
        """What heyoka calls at a zero: a function, not a method, since it copies what a method is
        bound to."""

        def record(ta: Any, time: float, direction: int, lane: int) -> None:
            ta.update_d_output(np.full(self.width, time))
            self._found.append((self._first + lane, time, direction, ta.d_output[:, lane].copy()))

        return record

    def leg(
        self, k: np.ndarray, y: np.ndarray, spans: np.ndarray, most: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Passages]:
        """Motions with the constants k (c, n) from the states y (m, n), each over its own span of
        time (n,).

        Returns the states reached (m, n), the steps taken (n,), whether each has reached its end
        (n,) in at most `most` steps, and the zeros of the event, in order of motion and time.
        """
        n, width = y.shape[1], self.width
        states, constants, ends = (
            _lanes(y, width),
            _lanes(k, width),
            _lanes(spans[None], width)[:, 0],
        )
        self._found.clear()
        done: list[tuple[Any, ...]] = []
        ta = self._ta
        state, pars = ta.state, ta.pars
        for i in range(len(states)):
            self._first = i * width
            state[:], pars[:] = states[i], constants[i]
            ta.set_time(0.0)
            if ta.with_events:
                ta.reset_cooldowns()
            ta.propagate_until(ends[i], max_steps=most)
            states[i] = state
            done += ta.propagate_res
        outcomes, _, _, steps = zip(*done[:n], strict=True)
        well = np.array([outcome == hy.taylor_outcome.time_limit for outcome in outcomes])
        reached = states.transpose(1, 0, 2).reshape(len(y), -1)[:, :n]
        return reached, np.array(steps), well, self._passages(n, len(y))

    def _passages(self, n: int, m: int) -> Passages:
        found = sorted((one for one in self._found if one[0] < n), key=lambda one: one[:2])
        return Passages(
            np.array([one[0] for one in found], dtype=np.int64),
            np.array([one[1] for one in found]),
            np.array([one[2] for one in found], dtype=np.int64),
            np.array([one[3] for one in found]).reshape(-1, m).T,
        )


def _lanes(values: np.ndarray, width: int) -> np.ndarray:
    """Values (m, n) as batches (n / width, m, width), the last filled with copies of the last
    column."""
    padded = np.pad(values, ((0, 0), (0, -values.shape[1] % width)), mode="edge")
    return np.ascontiguousarray(padded.reshape(len(values), -1, width).transpose(1, 0, 2))


@lru_cache(maxsize=16)
def build(
    model: type[Model], structure: Structure, event: Event | None, tol: float | None
) -> Lanes:
    """The compiled integrator for one model, its structure, event and tolerance."""
    return Lanes(model, structure, event, tol)
