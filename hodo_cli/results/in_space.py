"""What follows from a stored attitude: the body's vectors in space, and Euler angles."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..models.base import attributes

if TYPE_CHECKING:
    from .motion import Motion

POLE_SINE = 1e-7
"""The sine of theta below which phi and psi have lost half of their digits: they are not numbers
there."""


def rotations(m: "Motion") -> Any:
    """The attitudes as SciPy's rotations. Raises KeyError where none are stored."""
    from scipy.spatial.transform import Rotation  # late: it takes longer than most pictures

    return Rotation.from_quat(np.roll(m.stored("attitude"), -1, axis=1))


def in_space(m: "Motion", vectors: np.ndarray) -> np.ndarray:
    """Vectors of the body, (n, 3) or one that it carries along (3,), in space axes (n, 3)."""
    return np.asarray(rotations(m).apply(vectors))


def momentum_with_fluid(m: "Motion") -> np.ndarray:
    """G - kappa omega' (n, 3) in body axes, omega' that of the free body: the momentum of body and
    fluid together, to first order in kappa. Raises KeyError for a body without a fluid."""
    axes = m.principal_axes
    acceleration = (np.cross(m.G, m.omega) @ axes.T / m.inertia) @ axes
    return np.asarray(m.G - m.case.system.constants["kappa"] * acceleration)


def euler_angle(name: str, m: "Motion") -> np.ndarray:
    """psi, theta or phi (n,) of the turns by psi about z, theta about x1 and phi about x3, one
    after another: precession, nutation and spin. psi and phi are at most half a turn, and no
    numbers where theta is 0 or pi."""
    turned = rotations(m)
    axis = turned.apply(np.eye(3)[2])
    sine = np.hypot(axis[:, 0], axis[:, 1])
    if name == "theta":
        return np.asarray(np.arctan2(sine, axis[:, 2]))
    vertical = turned.inv().apply(np.eye(3)[2])
    x, y = (axis[:, 0], -axis[:, 1]) if name == "psi" else (vertical[:, 0], vertical[:, 1])
    return np.where(sine > POLE_SINE, np.arctan2(x, y), np.nan)


EULER_ANGLES = ("psi", "theta", "phi")
ANGLES_THAT_TURN = ("psi", "phi")

POLE_REGION_SINE = 0.1
"""The sine of theta below which x3 passes the vertical, where psi and phi step by up to half a
turn."""


def continued(m: "Motion", name: str, values: np.ndarray) -> np.ndarray:
    """psi or phi (n,) as it goes on from sample to sample by less than half a turn; no number from
    where its rate at a sample, if x3 is not `POLE_REGION_SINE` the vertical there, would turn it by
    more: whole turns are lost then."""
    known = np.flatnonzero(np.isfinite(values))
    values[known] = np.unwrap(values[known])
    if "omega" not in m.data or len(m.axes) < 3:
        return values
    vertical = rotations(m).inv().apply(np.eye(3)[2])[known]
    p, q, r = (m.omega[known] * time_factor(m)).T
    x, y, z = vertical.T
    square = x * x + y * y
    rate = (p * x + q * y) / square
    rate = np.abs(
        np.where(square > POLE_REGION_SINE**2, rate if name == "psi" else r - rate * z, 0)
    )
    lost = np.maximum(rate[1:], rate[:-1]) * np.diff(m.time[known]) > np.pi
    if lost.any():
        values[known[np.argmax(lost) + 1] :] = np.nan
    return values


def time_factor(m: "Motion") -> float:
    """The factor from the case's time to that of which omega is a rate: of a full top, whose time
    is the slow one, 1 over its small parameter."""
    system = m.case.system
    factor = system.quaternion_factor
    return float(factor(attributes(system.constants))) if factor else 1.0


OF_ATTITUDE: dict[str, Callable[["Motion"], np.ndarray]] = {
    "G_space": lambda m: in_space(m, m.G),
    "total_space": lambda m: in_space(m, momentum_with_fluid(m)),
    "omega_space": lambda m: in_space(m, m.omega),
    **{f"x{i}_space": partial(in_space, vectors=axis) for i, axis in enumerate(np.eye(3), 1)},
    **{name: partial(euler_angle, name) for name in EULER_ANGLES},
    # The same along the axes of body and of space.
    "rotation": lambda m: np.asarray(rotations(m).as_rotvec()),
}
"""The quantities of `cases.derived` that follow from a stored attitude."""
