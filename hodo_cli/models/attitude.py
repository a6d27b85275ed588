"""Attitude: any model whose state begins with the angular velocity in body axes, with a quaternion
from body to space beside it."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from types import SimpleNamespace
from typing import Any, ClassVar, cast

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
    vector,
)
from .base import (
    CONSTANTS_KEY,
    Bound,
    Event,
    EventOutcome,
    Label,
    Model,
    Passage,
    backward,
    fields_of,
)
from .rigid_body import BodyFrame
from .theory.attitude import about, composed, free_attitude, of_euler, turn_of_hodograph

ATTITUDE_KEY = "attitude"

SEQUENCE = "ZXZ"
"""The sequence of Euler's angles where none is named: precession, nutation, spin."""

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

QUATERNION = ("attitude_a", "attitude_b", "attitude_c", "attitude_d")
"""The variables of the state."""

VARIABLE = {ATTITUDE_KEY: Label(("time", "quaternion"), "attitude, from body to space axes")}

CONVENTION = (
    "unit quaternion (a, b, c, d), scalar first: Q (0, v) Q* is a body's vector v in space, and"
    " dQ/dt = Q (0, omega)/2; Q and -Q are one attitude, and the branch is the continuous one"
)

UNIT_LENGTH_TOL = 1e-6
"""How far from 1 the length of a quaternion may be without a word."""


def takes_attitude(form: type[Model]) -> bool:
    """Whether the motions of a form have an attitude: a mean over turns has none."""
    return form.quaternion_factor is not None and form.state[:3] == ("p", "q", "r")


def keys_of_form(form: type[Model]) -> dict[str, Rule]:
    """The keys of a form's cases, its own and what any of its kind takes."""
    return {**form.keys, ATTITUDE_KEY: ATTITUDE} if takes_attitude(form) else form.keys


def system_of(
    form: type[Model], data: Mapping[str, Any], epoch: float | None = None, mirrored: bool = False
) -> Model:
    """The object of a form with these data, with an attitude where they name one; expressions count
    t from an epoch, and a `mirrored` motion runs backward."""
    if CONSTANTS_KEY in form.keys:
        data = {CONSTANTS_KEY: None, **data}
    data = fields_of(data, -epoch if epoch and mirrored else epoch)
    if not mirrored:
        return _plain_system(form, data)
    system = _plain_system(form, data)
    values = {field.name: getattr(system, field.name) for field in fields(system)}
    form_backward: type[Model] = backward(type(system))  # type: ignore[arg-type]
    return form_backward(**values)


def _plain_system(form: type[Model], data: dict[str, Any]) -> Model:
    system = form.of({name: value for name, value in data.items() if name != ATTITUDE_KEY})
    if not data.get(ATTITUDE_KEY):
        return system
    return with_attitude(type(system))(**data)  # type: ignore[arg-type]


def check_attitude(form: type[Model], data: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes of a start whose entries are each right by themselves."""
    attitude = data.get(ATTITUDE_KEY)
    if not isinstance(attitude, Mapping):
        return
    ways = [name for name in ("initial", "euler", "align") if attitude[name] is not None]
    if form.start_attitude is not None:
        yield (ATTITUDE_KEY,), "the start of a top says where it points: write `attitude: yes`"
    elif len(ways) != 1:
        named = " and ".join(ways) or "none"
        yield (ATTITUDE_KEY,), f"give one of initial, euler and align, not {named}"
    if attitude["initial"] is not None and not any(attitude["initial"]):
        yield (ATTITUDE_KEY, "initial"), "a quaternion of length 0 is no attitude"
    elif attitude["euler"] is None and attitude["sequence"] != SEQUENCE:
        yield (ATTITUDE_KEY, "sequence"), "orders the angles of `euler`, which is not there"
    if not re.fullmatch(r"(?!.*(.)\1)([XYZ]{3}|[xyz]{3})", attitude["sequence"]):
        yield (
            (ATTITUDE_KEY, "sequence"),
            "expected three of X, Y, Z or of x, y, z, no two neighbours equal, "
            f"got {attitude['sequence']!r}",
        )


def quaternion_rates(omega: Sequence[Any], Q: Sequence[Any], factor: Any) -> tuple[Any, ...]:
    """Q' = factor Q (0, omega)/2."""
    p, q, r = (factor * x / 2 for x in omega)
    a, b, c, d = Q
    return (
        -(b * p) - c * q - d * r,
        a * p + c * r - d * q,
        a * q + d * p - b * r,
        a * r + b * q - c * p,
    )


def turned_back(Q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors in space v (3, ...) in the axes of bodies with the attitudes Q (4, ...)."""
    a, b, c, d = Q
    return np.array(composed(composed((a, -b, -c, -d), (0 * a, *v)), Q)[1:])


def aligned(G: Sequence[Any]) -> tuple[Any, ...]:
    """The shortest rotation that brings the direction G to the axis z; 1 for G = 0."""
    x, y, z = G
    across = hypot(x, y)
    if not across:
        return (1.0, 0.0, 0.0, 0.0) if z >= 0 else (0.0, 1.0, 0.0, 0.0)
    size = hypot(across, z)
    # Along the middle of G and z; |G| + z without the cancellation where z is negative.
    ahead = size + z if z >= 0 else across * (across / (size - z))
    length = hypot(ahead, across)
    return ahead / length, y / length, -(x / length), 0.0


def quaternion_at_start(attitude: Any, G: Sequence[Any]) -> tuple[Any, ...]:
    """The quaternion (4,) at the start, which the key `attitude` and G (3,) say."""
    if not isinstance(attitude, Mapping):
        return 1.0, 0.0, 0.0, 0.0
    if attitude["euler"] is not None:
        axes = ["xyz".index(letter) for letter in attitude["sequence"].lower()]
        # About axes of space each turn is seen from those after it.
        order = slice(None, None, 1 if attitude["sequence"].isupper() else -1)
        return of_euler(axes[order], attitude["euler"][order])
    if attitude["align"] is not None:
        return aligned(G)
    length = math.hypot(*attitude["initial"])
    return tuple(x / length for x in attitude["initial"])


def angle_apart(difference: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """The angle (...) by which an attitude Q + difference (..., 4) is turned from another, Q, of
    about the same size: 2 asin |vector part of Q* (Q + difference)|. Q and -Q are one attitude."""
    a, v, d = Q[..., :1], Q[..., 1:], difference
    across = a * d[..., 1:] - d[..., :1] * v - np.cross(v, d[..., 1:])
    size = np.linalg.norm(Q, axis=-1) * np.linalg.norm(Q + difference, axis=-1)
    sine = np.divide(np.linalg.norm(across, axis=-1), size, out=np.zeros_like(size), where=size > 0)
    return np.asarray(2 * np.arcsin(np.minimum(sine, 1)))


def without_attitude(function: Callable[..., Any], t: Any, y: Sequence[Any], k: Any) -> Any:
    """A function of the state of a model, of the state with an attitude."""
    return function(t, y[:-4], k)


class Turning(EventOutcome):
    """An outcome in whose state, which lasts, the body turns at a constant angular velocity."""

    def states(self, times: Any, fp: Any = float) -> np.ndarray:
        states = super().states(times, fp).copy()
        omega, Q = (np.array(rows, dtype=fp) for rows in (self.state[:3], self.state[-4:]))
        speed = np.hypot.reduce(omega)
        turned = about(omega / (speed or 1), (np.asarray(times, dtype=fp) - fp(self.time)) * speed)
        states[..., -4:] = np.stack(composed(Q, turned), axis=-1)
        return states


def beside_turning(passage: Passage, t: Any, y: Sequence[Any], k: Any) -> EventOutcome:
    """A passage of a model, of the state with an attitude. Behind the stop of a body with a rotor
    it is G that rests, and the body turns on."""
    outcome = passage(t, y[:-4], k)
    outcome = outcome._replace(state=[*outcome.state, *y[-4:]])
    if outcome.onward != math.inf:
        return outcome
    # As it turns behind the stop it has turned from the event on, but for a part of 1e-7.
    lasting = Turning(*outcome._replace(time=float(t)))
    return lasting._replace(time=outcome.time, state=lasting.states(outcome.time, type(t)).tolist())


def beside_attitude(event: Event) -> Event:
    """An event of a model as one of the model with an attitude."""
    passage = event.passage and Bound(beside_turning, (event.passage,))
    return event._replace(function=Bound(without_attitude, (event.function,)), passage=passage)


class Oriented(Model):
    """The class before a form's own where its cases name an attitude."""

    attitude: Any
    plain: ClassVar[type[Model]]

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        yield from super().check(data)
        # For the members of a sweep over numbers of the attitude.
        yield from check_attitude(cls.plain, data)

    @property
    def start(self) -> tuple[Any, ...]:
        return tuple(self._with_attitude(np.array(super().start)).tolist())

    def starts(self, omega: np.ndarray) -> np.ndarray:
        # Of the form itself: the start of this one has what is fixed in space turned already.
        own = {field.name: getattr(self, field.name) for field in fields(self.plain)}
        return self._with_attitude(self.plain(**own).starts(omega))

    def _with_attitude(self, starts: np.ndarray) -> np.ndarray:
        """Starts (m + 4, ...) from the model's own, what is fixed in space in the body's axes."""
        starts = starts[: len(self.plain.state)]
        attitudes = [self._attitude_at(y) for y in starts.reshape(len(starts), -1).T.tolist()]
        Q = np.array(attitudes).T.reshape(4, *starts.shape[1:])
        rows = [self.plain.state.index(name) for name in self.plain.fixed_in_space]
        if rows:
            starts[rows] = turned_back(Q, starts[rows])
        return np.concatenate((starts, Q))

    def _attitude_at(self, start: Sequence[Any]) -> tuple[Any, ...]:
        if self.plain.start_attitude is not None:
            return tuple(self.plain.start_attitude(start))
        G = cast(BodyFrame, self).momentum(np.array(start[:3]))
        return quaternion_at_start(self.attitude, G.tolist())

    @property
    def run_events(self) -> tuple[Event, ...]:
        return tuple(map(beside_attitude, super().run_events))

    @property
    def has_closed_form(self) -> bool:
        """That of the attitude is known of free motion alone."""
        along = getattr(self, "along_momentum", None)
        return super().has_closed_form and along is not None and not any(along)

    def exact_states(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        states, exponent = super().exact_states(t)
        body, start = cast(BodyFrame, self), np.array(self.start)
        Q = free_attitude(body.moments, body.to_principal(start[:3]), t)
        Q[:, 1:] = body.from_principal(Q[:, 1:])
        return np.column_stack((states, *composed(start[-4:].astype(Q.dtype), Q.T))), exponent

    @property
    def turn(self) -> tuple[float, float, str] | None:
        """What `turn_of_hodograph` says of a free body; None of any other."""
        body = cast(BodyFrame, self)
        omega = body.to_principal(body.omega_at_start)
        return turn_of_hodograph(body.moments, omega) if self.has_closed_form else None

    def predictions(self, start: float, end: float) -> list[str]:
        return [*super().predictions(start, end), *(self.turn or ())[2:]]

    @property
    def class_events(self) -> tuple[Event, ...]:
        return tuple(map(beside_attitude, super().class_events))

    @property
    def warnings(self) -> list[str]:
        warnings = [*super().warnings, *attitude_warnings(self.attitude)]
        is_aligned = isinstance(self.attitude, Mapping) and self.attitude["align"]
        if is_aligned and not cast(BodyFrame, self).momentum(np.array(self.start[:3])).any():
            warnings.append("without a G at the start, z lies along x3 there")
        return warnings


def attitude_warnings(attitude: Any) -> list[str]:
    """Warnings of the start of an attitude."""
    if not isinstance(attitude, Mapping):
        return []
    initial, euler, sequence = attitude["initial"], attitude["euler"], attitude["sequence"]
    if initial is not None and abs(math.hypot(*initial) - 1) > UNIT_LENGTH_TOL:
        return [f"the attitude at the start has length {math.hypot(*initial):.9g}: it is made 1"]
    if euler is not None and abs(angle := max(euler, key=abs)) > 2 * math.pi:
        return [f"euler: {angle:.9g} is more than a turn: degrees are written as '{angle:.9g} deg'"]
    if euler is not None:
        pole = math.sin(euler[1]) if sequence[0] == sequence[2] else math.cos(euler[1])
        if abs(pole) <= UNIT_LENGTH_TOL:
            return [
                f"the start is at a pole of the sequence {sequence}: its first and last angle turn "
                "about one axis there, and the attitude shows no more than their sum or difference"
            ]
    return []


@cache
def with_attitude(plain: type[Model]) -> type[Model]:
    """A form whose state has the quaternion besides: Q' = Q (0, omega)/2."""

    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        seen = SimpleNamespace(**vars(k), attitude=y[-4:]) if hasattr(k, "expression1") else k
        return (
            *plain.rhs(t, y[:-4], seen),
            *quaternion_rates(y[:3], y[-4:], plain.quaternion_factor(k)),
        )

    def output(t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        return {**plain.output(t, y[:, :-4], k), ATTITUDE_KEY: y[:, -4:]}

    attributes_of = {
        "__module__": plain.__module__,
        "__doc__": f"{plain.__name__} with an attitude.",
        "__annotations__": {ATTITUDE_KEY: Any},
        "plain": plain,
        "keys": plain.keys | {ATTITUDE_KEY: ATTITUDE},
        "state": plain.state + QUATERNION,
        "variables": plain.variables | VARIABLE,
        # By g, which is of the degree of what turns with omega.
        "degree": plain.degree and plain.degree | {"g": 2},
        "state_degree": plain.state_degree | dict.fromkeys(QUATERNION, 0),
        "rhs": staticmethod(rhs),
        "output": staticmethod(output),
    }
    return dataclass(frozen=True)(
        type(f"{plain.__name__}WithAttitude", (Oriented, plain), attributes_of)
    )
