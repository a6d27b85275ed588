"""The constants of a model as flat lists of numbers, and the Jacobian of its equations."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from .base import Constants, Model

Structure = tuple[tuple[str, int | str], ...]
"""What of the constants is structure: each name with its length (0 for a plain number), or its
string."""


def structure(k: Constants) -> Structure:
    """The structure of a model's constants; integrators compiled for one structure serve all its
    numbers."""
    sizes = {name: len(value) for name, value in k.items() if isinstance(value, tuple)}
    return tuple(
        (name, value if isinstance(value, str) else sizes.get(name, 0)) for name, value in k.items()
    )


def count(of: Structure) -> int:
    """How many numbers the constants hold."""
    return sum(max(size, 1) for _, size in of if isinstance(size, int))


def flatten(k: Constants) -> list[float]:
    """The numbers among the constants, in order."""
    flat: list[float] = []
    for value in k.values():
        if isinstance(value, tuple):
            flat.extend(value)
        elif not isinstance(value, str):
            flat.append(value)
    return flat


def attributes(k: Constants, number: Callable[[float], Any] = float) -> SimpleNamespace:
    """The constants as attributes, each of their numbers converted by `number`."""
    return namespace(structure(k), [number(value) for value in flatten(k)])


def namespace(of: Structure, numbers: Sequence[Any]) -> SimpleNamespace:
    """The constants as attributes, their numbers (or symbols) taken in order."""
    supply = iter(numbers)
    k = SimpleNamespace()
    for name, size in of:
        if isinstance(size, str):
            setattr(k, name, size)
        else:
            setattr(k, name, tuple(next(supply) for _ in range(size)) if size else next(supply))
    return k


def jacobian(model: type[Model], k: SimpleNamespace, t: Any, y: np.ndarray) -> np.ndarray:
    """d rhs / d y at y (m,) or (m, n), shape (m, m) or (m, m, n), exact to rounding: the imaginary
    part of the rhs at a complex step.

    Source: W. Squire and G. Trapp, SIAM Review 40 (1998) 110.
    """
    # Its square vanishes beside every double, so nothing is truncated, and no difference is taken,
    # so nothing cancels.
    tiny, unit_steps = 1e-100, np.eye(len(y)).reshape(len(y), len(y), *[1] * (y.ndim - 1))
    rows = model.rhs(t, list(y[:, None] + 1j * tiny * unit_steps), k)
    return (np.array([np.broadcast_to(row, y.shape) for row in rows]).imag / tiny).astype(float)
