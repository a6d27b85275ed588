"""Attitude: a unit quaternion Q with v_space = Q (0, v_body) Q* and Q' = Q (0, omega)/2.

This module has the key `attitude` of a case, and Q at the start: 1, or a quaternion that the case
gives, or three Euler angles, or the attitude with G along the space axis z.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..arithmetic import hypot
from ..schema.kinds import (
    Angle,
    Choice,
    Either,
    Key,
    ListOf,
    Mistake,
    Rule,
    Switch,
    Table,
    Text,
    mistakes_where,
    vector,
)
from .base import ATTITUDE_KEY, Model
from .euler import about, composed

AXIS_SEQUENCES = r"(?!.*(.)\1)([XYZ]{3}|[xyz]{3})"
"""The sequences of axes of Euler's angles: body axes or space axes, no two neighbours equal."""

SEQUENCE = "ZXZ"
"""The sequence of Euler's angles where a case names none: precession, nutation, spin."""

ATTITUDE = Key(
    Either(
        Switch("yes", "no"),
        Table(
            {
                "initial": Key(vector(4), "quaternion a, b, c, d at the start", default=None),
                "euler": Key(
                    ListOf(Angle(), length=3, title="3 angles in radians, or such as '60 deg'"),
                    "angles of the `sequence` at the start",
                    "rad",
                    None,
                ),
                "sequence": Key(
                    Text(),
                    "axes of the angles: capitals are body axes, small letters space axes, as of"
                    " SciPy's Rotation",
                    default=SEQUENCE,
                ),
                "align": Key(
                    Choice("G"), "G: the space axis z lies along G at the start", default=None
                ),
            }
        ),
        definition="attitude",
    ),
    "where the body points, stored as a quaternion: yes (body and space axes coincide at the start;"
    " of a top: z is the vertical), or how it starts",
    default=None,
)

CONVENTION = (
    "unit quaternion (a, b, c, d), scalar first: Q (0, v) Q* is a body's vector v in space, and"
    " dQ/dt = Q (0, omega)/2; Q and -Q are one attitude, and the branch is the continuous one"
)

UNIT_LENGTH_TOL = 1e-6
"""The difference from 1 up to which the length of a given quaternion causes no warning."""


def takes_attitude(form: type[Model]) -> bool:
    """Whether the motions of a form may have an attitude. Averaged motions have none."""
    return form.quaternion_factor is not None and form.state[:3] == ("p", "q", "r")


def keys_of_form(form: type[Model]) -> dict[str, Rule]:
    """The keys of a form, with `attitude` where its motions may have one."""
    return {**form.keys, ATTITUDE_KEY: ATTITUDE} if takes_attitude(form) else form.keys


def check_attitude(form: type[Model], data: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes in the key `attitude`, whose entries are each valid alone."""
    attitude = data.get(ATTITUDE_KEY)
    if not isinstance(attitude, Mapping):
        return
    initial, euler, sequence = attitude["initial"], attitude["euler"], attitude["sequence"]
    ways = [name for name in ("initial", "euler", "align") if attitude[name] is not None]
    is_top, is_sequence = not form.starts_with_omega, re.fullmatch(AXIS_SEQUENCES, sequence)
    named = " and ".join(ways) or "none"
    yield from mistakes_where(
        (
            is_top,
            (ATTITUDE_KEY,),
            "the start of a top says where it points: write `attitude: yes`",
        ),
        (
            not is_top and len(ways) != 1,
            (ATTITUDE_KEY,),
            f"give one of initial, euler and align, not {named}",
        ),
        (
            initial is not None and not any(initial),
            (ATTITUDE_KEY, "initial"),
            "a quaternion of length 0 is no attitude",
        ),
        (
            euler is None and sequence != SEQUENCE,
            (ATTITUDE_KEY, "sequence"),
            "orders the angles of `euler`, which is missing",
        ),
        (
            not is_sequence,
            (ATTITUDE_KEY, "sequence"),
            f"expected three of X, Y, Z or of x, y, z, no two neighbours equal, got {sequence!r}",
        ),
    )


def of_euler(axes: Sequence[int], angles: Sequence[Any]) -> tuple[Any, ...]:
    """The quaternion of three rotations one after another, each by an angle about an axis (0 to 2)
    of the body as it stands then."""
    first, second, third = (
        about(np.eye(3)[i].tolist(), angle) for i, angle in zip(axes, angles, strict=True)
    )
    return composed(composed(first, second), third)


def aligned(G: Sequence[Any]) -> tuple[Any, ...]:
    """The quaternion of the smallest rotation that turns the direction of G to the axis z; 1 for
    G = 0."""
    x, y, z = G
    across = hypot(x, y)
    if not across:
        return (1.0, 0.0, 0.0, 0.0) if z >= 0 else (0.0, 1.0, 0.0, 0.0)
    size = hypot(across, z)
    # The quaternion is proportional to (|G| + z, y, -x, 0). `ahead` is |G| + z; where z is negative
    # it is written so that nothing cancels.
    ahead = size + z if z >= 0 else across * (across / (size - z))
    length = hypot(ahead, across)
    return ahead / length, y / length, -(x / length), 0.0


def quaternion_at_start(attitude: Any, G: Sequence[Any]) -> tuple[Any, ...]:
    """The quaternion (4,) at the start, from the key `attitude` and from G (3,) there."""
    if not isinstance(attitude, Mapping):
        return 1.0, 0.0, 0.0, 0.0
    if attitude["euler"] is not None:
        axes = ["xyz".index(letter) for letter in attitude["sequence"].lower()]
        # Rotations about space axes are those about body axes in the opposite order.
        order = slice(None, None, 1 if attitude["sequence"].isupper() else -1)
        return of_euler(axes[order], attitude["euler"][order])
    if attitude["align"] is not None:
        return aligned(G)
    length = math.hypot(*attitude["initial"])
    return tuple(x / length for x in attitude["initial"])


def angle_apart(difference: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """The angle (...) between the attitudes Q and Q + difference (..., 4), which are quaternions of
    about the same size: 2 asin |vector part of Q* (Q + difference)|. Q and -Q are one attitude."""
    a, v, d = Q[..., :1], Q[..., 1:], difference
    across = a * d[..., 1:] - d[..., :1] * v - np.cross(v, d[..., 1:])
    size = np.linalg.norm(Q, axis=-1) * np.linalg.norm(Q + difference, axis=-1)
    sine = np.divide(np.linalg.norm(across, axis=-1), size, out=np.zeros_like(size), where=size > 0)
    return np.asarray(2 * np.arcsin(np.minimum(sine, 1)))


def warnings_of(system: Model) -> list[str]:
    """The warnings of a model, followed by those on its attitude at the start."""
    attitude = system.attitude
    if not isinstance(attitude, Mapping):
        return system.warnings
    is_still = not (any(system.start[:3]) or system.no_separatrix_reason)
    initial, euler, sequence = attitude["initial"], attitude["euler"], attitude["sequence"]
    length, widest = math.hypot(*(initial or (1.0,))), max(euler or (0.0,), key=abs)
    _, middle, _ = euler or (0.0, 1.0, 0.0)
    pole = math.sin(middle) if sequence[0] == sequence[2] else math.cos(middle)
    sentences = {
        f"the attitude at the start has length {length:.9g}: it is made 1": (
            abs(length - 1) > UNIT_LENGTH_TOL
        ),
        f"euler: {widest:.9g} is more than a turn: degrees are written as '{widest:.9g} deg'": (
            abs(widest) > 2 * math.pi
        ),
        f"the start is at a pole of the sequence {sequence}: its first and last angle turn about "
        "one axis there, and the attitude shows no more than their sum or difference": (
            abs(pole) <= UNIT_LENGTH_TOL
        ),
        "G is 0 at the start, so z is made to lie along x3 there": attitude["align"] and is_still,
    }
    return [*system.warnings, *(words for words, applies in sentences.items() if applies)]
