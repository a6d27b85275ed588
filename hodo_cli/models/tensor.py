"""Linear resistance by a constant tensor."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..schema.kinds import Either, Key, ListOf, Number, Rule, Table, matrix
from . import rigid_body
from .averaged import AveragedTurns
from .rigid_body import INERTIA, INITIAL
from .terms.body import BodyUnderTorques
from .terms.torques import degree_under, tensor_entries
from .theory.principal_axes import is_diagonal


def resistance_key(entry: Rule, **more: Any) -> Rule:
    """The key of a tensor of resistance whose entries are of a kind."""
    unit = "moment of inertia / time"
    two = {
        "diagonal": Key(entry, "every I_ii", unit=unit),
        "off_diagonal": Key(entry, "every I_ij, i != j", unit=unit),
    }
    row = ListOf(entry, length=3, title="3 numbers or expressions in t")
    of_expressions = ListOf(row, length=3, title="3 rows of 3 numbers or expressions in t")
    rows = matrix(3) if entry.get("type") == "number" else of_expressions
    return Key(Either(rows, Table(two)), "tensor I of -I omega", unit=unit, **more)


EQUAL_RATES = 1e-12
"""Rates of decay whose ratio differs from 1, or from 0, by no more are taken to be equal, or 0:
rounding may have made the difference."""


@dataclass(frozen=True)
class Tensor(BodyUnderTorques):
    """A rigid body in a medium that resists its angular velocity through a constant tensor I.

    A1 p' + (A3 - A2) q r = -(I11 p + I12 q + I13 r)      and cyclically

    p, q, r: angular velocity about x1, x2, x3, 1/time (`initial`); A1, A2, A3: principal moments of
    inertia (`inertia`); I: tensor of resistance, moment of inertia / time (`resistance`). Assumed:
    I is constant. It takes energy out of every motion only if its symmetric part is positive
    semi-definite; a tensor that feeds energy in runs too, with a warning.

    Source: A. L. Rachinskaya, rotation of a rigid body in a resistant medium, eqs (9)-(11).
    """

    resistance: tuple[tuple[float, ...], ...] | Mapping[str, float]

    name = "tensor"
    form = "full"
    keys = {
        "inertia": INERTIA,
        "resistance": resistance_key(Number()),
        "initial": INITIAL,
    }
    terms = ("resistance",)
    degree = degree_under(terms)

    @property
    def matrix(self) -> np.ndarray:
        """I as a 3x3 array."""
        return np.reshape(tensor_entries(self.resistance), (3, 3))

    @property
    def final_axis(self) -> int | None:
        """The axis that is enclosed in the end, when the rotation has become slower than its
        damping: A omega' = -I omega then, and omega turns to the eigenvector of A^-1 I that decays
        most slowly.

        None unless I is symmetric and takes energy out of every motion; none either at rest, and
        where that eigenvector is not known from others, or lies on the separatrix, as the middle
        axis does.
        """
        A, I = np.array(self.inertia), self.matrix
        values = np.linalg.eigvalsh(I)
        # A kernel, or an eigenvalue that is rounding, stops no motion: omega x A omega decides.
        start = self.omega_at_start
        if not start.any() or (I != I.T).any() or values[0] <= EQUAL_RATES * values[-1]:
            return None
        is_steady = self.spins_steadily
        direction, error = (start, 0.0) if is_steady else slowest_direction(A, I)
        label = int(rigid_body.enclosed_axis(A, direction, error))
        if is_steady or label != rigid_body.SEPARATRIX or not is_diagonal(I):
            return label if label > 0 else None
        # D' = -2 lambda D for each of the two outer axes: what is about one decays more slowly.
        largest, _, smallest = rigid_body.inertia_order(A)
        rate = np.diag(I) / A
        if math.isclose(rate[largest], rate[smallest], rel_tol=EQUAL_RATES):
            return None
        return 1 + (largest if rate[largest] < rate[smallest] else smallest)

    @property
    def spins_steadily(self) -> bool:
        """Whether the start is a rotation about a body axis that I leaves alone: it lasts for ever,
        whatever the other rotations come to."""
        turning = np.flatnonzero(self.omega_at_start)
        others = np.delete(self.matrix, turning, axis=0)[:, turning]
        return len(turning) == 1 and not others.any()


def slowest_direction(A: np.ndarray, I: np.ndarray) -> tuple[np.ndarray, float]:
    """The direction (3,) of the solution of A omega' = -I omega that decays most slowly, with what
    rounding may turn it by; I is symmetric."""
    # A^-1 I has the eigenvalues of this symmetric matrix, and its eigenvectors times A^(1/2).
    root = np.sqrt(A)
    rates, vectors = np.linalg.eigh(I / np.outer(root, root))
    gap = max(rates[1] - rates[0], EQUAL_RATES * rates[0])
    return vectors[:, 0] / root, EQUAL_RATES * rates[2] / gap


@dataclass(frozen=True)
class AveragedTensor(AveragedTurns, Tensor):
    """The motion averaged over the turns of the free one, to first order in I/(A |omega|).

    It is the averaged form of linear-diag with lambda_i = I_ii/A_i: the means of p q, q r and p r
    are 0, so that the entries off the diagonal drop out. Close to the separatrix they do not, and
    the full motion may cross it several times where this one crosses it once.
    """

    form = "averaged"

    def mean_rates(self, side: int, v: Any) -> tuple[Any, ...]:
        return self.linear_rates((np.diag(self.matrix) / self.inertia).tolist(), side, v)

    @property
    def warnings(self) -> list[str]:
        """Besides: entries that drop out."""
        return [
            *super().warnings,
            *([] if is_diagonal(self.matrix) else ["to first order I is its diagonal alone"]),
        ]
