"""A body under any sum of torques."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar

import numpy as np

from ..schema.expression import Expression
from ..schema.kinds import Either, Key, ListOf, Mistake, Number, Table, vector
from .base import (
    CONSTANTS_FIELD,
    CONSTANTS_KEY,
    Bound,
    Constants,
    Event,
    EventOutcome,
    Model,
    mistake_of,
)
from .rigid_body import (
    INITIAL,
    body_constants,
    complete,
    dot,
    is_tensor,
    range_mistake,
)
from .tensor import resistance_key
from .terms.body import BodyUnderTorques, coefficients_of, terms_named
from .terms.events import (
    DRIVING,
    braked_stage,
    first_release,
    stage_end,
    stop_details,
)
from .terms.time_laws import (
    CONSTANTS,
    VELOCITIES,
    coefficient_kind,
    coefficients_kind,
    expressions_of,
    is_law,
    value_mistakes,
)
from .terms.torques import CAVITY, TERMS, coefficient, degree_under
from .theory.closed_form import AlongMomentum, free_motion
from .theory.dissipation import Dissipation, crossing_predictions, spin_predictions
from .theory.principal_axes import PrincipalAxes, principal_axes, symmetric

ROTOR_REASON = "with a rotor D says nothing, and the enclosed axis is undetermined"

ROUNDING_OF_G = 4 * float(np.finfo(float).eps)
"""The part of A omega up to which G = A omega + h is what rounding leaves of the sum. Of bodies at
rest with random tensors it was an eighth of that."""

NEGATIVE_COEFFICIENT = "a negative coefficient drives the body: write that as an expression"


@dataclass(frozen=True)
class Torques(BodyUnderTorques):
    """A rigid body under any sum of torques.

    A omega' + omega x G = N, the sum of what the case names:

    -lambda_i A_i omega_i (`damping`), -I omega (`resistance`), -c_i |omega| A_i omega_i
    (`quadratic`), the fluid's torque of
    cavity+constant (`kappa` or `cavity`), epsilon M, constant in the body (`torque`, `epsilon`), -b
    G/|G| (`brake`), F e, e fixed in space (`space_torque`), and three formulas in p, q, r and t
    (`expression`).

    omega = (p, q, r): angular velocity, 1/time (`initial`); A: principal moments of inertia
    (`inertia`), or the full tensor in any body axes, in which all else is then given and stored,
    while labels name the principal axes; G = A omega + h, with the angular momentum h of a rotor
    (`rotor`), which turns at constant speed in the body. Each coefficient but those of `cavity`,
    `rotor` and `expression` may be a law of time. Only the terms named are part of the equations. A
    brake brings G to 0 (event `stopped`): from there on omega is 0, or -A^-1 h, and no axis is
    enclosed. With a rotor the enclosed axis is undetermined all along. A formula may jump, have
    corners or short pulses: steps are compared with the equations at 32,768 places of the span, and
    begin anew on both sides of what they miss. What is shorter than that may be overlooked. A
    motion ends at a pole of a formula.

    A torque along G, as of equal damping, equal quadratic drag or a brake, changes the clock of the
    free motion and not its path. Under constant damping, a constant brake, or both, the clock has a
    closed form, and so has the motion (method exact).
    """

    damping: Any
    resistance: Any
    quadratic: Any
    cavity: Any
    kappa: Any
    torque: Any
    epsilon: float
    brake: Any
    rotor: Any
    space_torque: Any
    expression: Any
    case_constants: Any

    has_laws: ClassVar[bool] = False

    name = "torques"
    form = "full"
    keys = {
        "inertia": Key(
            ListOf(
                Either(Number(above=0), vector(3)),
                length=3,
                title="3 positive numbers, or 3 rows of 3 numbers",
                convert=symmetric,
            ),
            "principal moments of inertia A1, A2, A3; or the full tensor, in the axes of all else",
            unit="moment of inertia",
        ),
        "constants": CONSTANTS,
        "damping": Key(
            coefficients_kind(), "coefficients lambda_i of -lambda_i A_i omega_i", "1/time", None
        ),
        "resistance": resistance_key(coefficient_kind(), default=None),
        "quadratic": Key(
            coefficients_kind(), "coefficients c_i of -c_i |omega| A_i omega_i", default=None
        ),
        "cavity": CAVITY,
        "kappa": Key(
            coefficient_kind(),
            "rho P0/nu of a fluid, instead of `cavity`",
            "moment of inertia * time",
            None,
        ),
        "torque": Key(
            coefficients_kind(),
            "torque M1, M2, M3, constant in the body",
            "moment of inertia / time^2",
            None,
        ),
        "epsilon": Key(Number(), "small parameter, the factor of `torque`", default=1.0),
        "brake": Key(
            coefficient_kind(),
            "b of -b G/|G|, which brings a free body to rest in the shortest time",
            "moment of inertia / time^2",
            None,
        ),
        "rotor": Key(
            vector(3),
            "h in G = A omega + h, the angular momentum of a rotor beside the body's",
            unit="moment of inertia / time",
            default=None,
        ),
        "space_torque": Key(
            Table(
                {
                    "size": Key(
                        coefficient_kind(), "F of the torque F e", "moment of inertia / time^2"
                    ),
                    "direction": Key(
                        vector(3),
                        "e, of any length, in the space axes of `attitude`, else the body's at the"
                        " start",
                    ),
                }
            ),
            "a torque fixed in space",
            default=None,
        ),
        "expression": Key(
            ListOf(
                Expression(None, "an expression in p, q, r, t and constants"),
                length=3,
                title="3 expressions in p, q, r, t and constants",
            ),
            "torque N1, N2, N3: decimals, names, + - * / **, sqrt, sin, cos, exp, log, abs, tanh; "
            "with `attitude` also y1 to y3 and z1 to z3, the space axes y and z in the body",
            "moment of inertia / time^2",
            None,
        ),
        "initial": INITIAL,
    }

    @staticmethod
    def velocity(inertia: Sequence[Any], initial: Mapping[str, float | None]) -> tuple[float, ...]:
        """As of any body; G stands for no component beside a full tensor."""
        if is_tensor(inertia) and initial.get("G") is not None:
            raise ValueError("with a full tensor of inertia G stands for no component: give all")
        return complete(inertia, initial)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Model:
        """The object of the form whose equations have just the terms that the data name."""
        given = coefficients_of(data, data[CONSTANTS_FIELD])
        has_laws = any(is_law(x) for entries in given.values() for x in entries)
        return sum_of(terms_named(data), has_laws)(**data)

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Besides: what the terms ask of each other, of the body and of the start."""
        named = terms_named(data)
        is_given_as_tensor = is_tensor(data.get("inertia"))
        yield from mistakes_of_tensor(data) if is_given_as_tensor else super().check(data)
        if not named and data.keys() >= TERMS.keys():
            yield (), f"no torque is named ({', '.join(TERMS)}); damping: 0 is free motion"
        yield from negative_coefficients(data)
        if data.get("cavity") is not None:
            yield from mistake_of(("cavity",), coefficient, data["cavity"], data.get("kappa"))
        if (space := data.get("space_torque")) and not any(space["direction"]):
            yield ("space_torque", "direction"), "a direction has a length, and this one has none"
        yield from mistakes_of_start(data)

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        """Besides: laws with values, no drive and no poles from the start on."""
        given = (data.get("initial") or {}).items()
        known = {name: w for name, w in given if name in VELOCITIES and w is not None}
        known |= {"t": start, **(data.get(CONSTANTS_KEY) or {})}
        yield from value_mistakes(expressions_of(data), known)

    @classmethod
    def has_formulas(cls) -> bool:
        return "expression" in cls.terms or cls.has_laws or super().has_formulas()

    @cached_property
    def constants(self) -> Constants:
        constants: dict[str, Any] = {}
        if self.expression is not None:
            constants |= {f"expression{i}": text for i, text in enumerate(self.expression, 1)}
            constants |= {"velocity_unit": 1.0, "time_unit": 1.0}
        if self.brake is not None:
            constants["momentum_at_start"] = self.momentum_at_start
        constants |= super().constants
        if (frame := self.frame) is None:
            return constants
        matrices = {"principal_axes": frame.axes, "tensor": frame.tensor, "inverse": frame.inverse}
        return (
            constants
            | body_constants([*frame.moments])
            | {name: tuple(matrix.ravel()) for name, matrix in matrices.items()}
        )

    @property
    def frame(self) -> PrincipalAxes | None:
        """The principal axes of a body that is given by its full tensor of inertia."""
        return principal_axes(self.inertia) if is_tensor(self.inertia) else None

    @property
    def moments(self) -> np.ndarray:
        return super().moments if self.frame is None else self.frame.moments.astype(float)

    @property
    def principal_axes(self) -> np.ndarray | None:
        return None if self.frame is None else self.frame.axes.astype(float)

    def momentum(self, omega: np.ndarray) -> np.ndarray:
        frame = self.frame
        G = super().momentum(omega) if frame is None else omega @ frame.tensor.astype(float)
        if self.rotor is None:
            return G
        # Of a body that turns at -A^-1 h rounding leaves a G, whose direction would be drawn.
        rounding = ROUNDING_OF_G * self.moments.max() * np.abs(omega).max(axis=-1, keepdims=True)
        G = G + np.array(self.rotor)
        return np.where(np.abs(G).max(axis=-1, keepdims=True) > rounding, G, 0)

    def starts(self, omega: np.ndarray) -> np.ndarray:
        """With the terms' own variables behind omega."""
        w = np.moveaxis(omega, -1, 0)
        extra = {
            "brake": [np.hypot.reduce(self.momentum(omega), axis=-1) / self.moments[0]],
            "space_torque": [np.full(w.shape[1:], x) for x in self.direction],
        }
        columns = (x for name in self.terms for x in extra.get(name, ()))
        return np.stack([*w, *columns])

    @cached_property
    def start(self) -> tuple[float, ...]:
        omega = super().start
        if not any(TERMS[name].extra for name in self.terms):
            return omega
        return tuple(Torques.starts(self, np.array(omega)).tolist())  # not those with an attitude

    @classmethod
    def braked_terms(cls) -> tuple[str, ...]:
        """The terms beside a brake."""
        return tuple(name for name in cls.terms if name != "brake")

    @property
    def run_events(self) -> tuple[Event, ...]:
        """The stages of braking."""
        if self.brake is None:
            return ()
        row = self.state.index("stage_momentum")
        stop = Bound(braked_stage, (row, self.braked_terms()))
        end = Bound(stage_end, (row, not DRIVING.isdisjoint(self.terms)))
        return (Event("stopped", end, True, stop),)

    @property
    def direction(self) -> np.ndarray:
        """e of the torque fixed in space (3,), of length 1."""
        direction = np.array(self.space_torque["direction"] if self.space_torque else (1.0, 0, 0))
        unit = direction / np.abs(direction).max()
        return np.asarray(unit / np.linalg.norm(unit))

    def exact_end(self, fp: type) -> tuple[str, EventOutcome] | None:
        """When and how a brake stops a body of closed form; None without a stop."""
        along = self.along_momentum
        if along is None or np.isinf(along.stop):
            return None
        _, s = along.clock(np.array([along.stop], dtype=fp))
        omega = free_motion(self.moments, self.to_principal(self.omega_at_start), s)
        momentum = self.momentum(self.from_principal(omega))
        details = stop_details(momentum[0], self.enclosed(omega)[0])
        return "stopped", EventOutcome(float(along.stop), details, ())

    def predictions(self, start: float, end: float) -> list[str]:
        """Which crossings are possible, which rotation is held, and when a brake stops the body."""
        dissipations = self.dissipations(start, end)
        predictions = crossing_predictions(dissipations)
        if dissipations and not self.changing_terms:
            of_which = spin_predictions if self.brake is None else self.stop_predictions
            predictions += of_which(dissipations[0])
        return [*predictions, *filter(None, [self.no_separatrix_reason])]

    def stop_predictions(self, terms: Dissipation) -> list[str]:
        """When the brake stops the body, or between which times: fluid does not change |G|."""
        others = self.quadratic, any(terms.torque)
        if not self.brake or not terms.covered or any(others):
            return []
        rate = np.longdouble(self.brake / self.momentum_at_start)
        first, last = (AlongMomentum(of(terms.damping), rate).stop for of in (max, min))
        if first == last:
            return [f"stops after {first:.15g} [time]"] if math.isfinite(first) else []
        return [f"stops after {first:.6g} to {last:.6g} [time]"]

    @classmethod
    def release(cls, t: np.ndarray, y: Sequence[Any], k: Any) -> float:
        if DRIVING.isdisjoint(cls.terms):
            return math.nan
        return first_release(cls.state.index("stage_momentum"), cls.braked_terms(), t, y, k)


def mistakes_of_tensor(data: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes of a body that is given by a full tensor of inertia, and of its start."""
    inertia = data["inertia"]
    if not all(isinstance(row, tuple) for row in inertia):
        yield ("inertia",), "expected 3 positive numbers, or 3 rows of 3 numbers, got some of each"
        return
    wrong = [*mistake_of(("inertia",), principal_axes, inertia)]
    moments = () if wrong else principal_axes(inertia).moments
    sizes = [(("inertia",), words) for A in moments for words in range_mistake(float(A))]
    yield from [*wrong, *sizes[:1]]
    if "initial" in data:
        yield from mistake_of(("initial",), Torques.velocity, inertia, data["initial"])
    for name in ("damping", "quadratic"):
        entries = data.get(name) or (0.0,)
        if any(x != entries[0] for x in entries):
            yield (
                (name,),
                "acts about principal axes: give the three moments as `inertia`, or `resistance`",
            )


def mistakes_of_start(data: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes of a start with which a rotor or a brake has no meaning."""
    named, inertia, initial = terms_named(data), data.get("inertia"), data.get("initial")
    if not initial:
        return
    if "rotor" in named and initial.get("G") is not None:
        yield (
            ("initial",),
            "with a rotor |G| does not determine the missing component: give p, q and r",
        )
    if "brake" in named and inertia:
        with suppress(ValueError):  # another check says so
            omega, h = Torques.velocity(inertia, initial), data.get("rotor") or (0.0, 0.0, 0.0)
            products = (
                (dot(row, omega) for row in inertia)
                if is_tensor(inertia)
                else (A * x for A, x in zip(inertia, omega, strict=True))
            )
            G = [x + y for x, y in zip(products, h, strict=True)]
            if all(abs(x) <= ROUNDING_OF_G * max(map(abs, h)) for x in G):
                which = "whose G is 0" if any(h) else "at rest"
                yield ("brake",), f"a body {which} has no direction to brake in"


def negative_coefficients(data: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes of constant coefficients of which only positive ones resist."""
    with suppress(KeyError, ArithmeticError, ValueError):  # of expressions, which others see
        given = coefficients_of(data, data.get(CONSTANTS_KEY) or ())
        for name in ("quadratic", "kappa", "brake"):
            for i, entry in enumerate(given.get(name, ())):
                if not is_law(entry) and entry < 0:
                    is_one = len(TERMS[name].degree) == 1
                    yield (name,) if is_one else (name, i), NEGATIVE_COEFFICIENT


@cache
def sum_of(names: tuple[str, ...], has_laws: bool = False) -> type[Torques]:
    """The form of `Torques` whose equations have the terms of these names only, with coefficients
    that change with time or without: a class for each sum, since an engine compiles the equations
    of a class once for all its cases."""
    extra = {row: power for name in names for row, power in TERMS[name].extra.items()}
    attributes_of = {
        "__module__": __name__,
        "__doc__": Torques.__doc__,
        "terms": names,
        "has_laws": has_laws,
        "state": ("p", "q", "r", *extra),
        "state_degree": {name: power for name, power in extra.items() if power != 1},
        "degree": degree_under(names),
        "fixed_in_space": tuple(TERMS["space_torque"].extra) if "space_torque" in names else (),
        "resisting": frozenset({"brake"}),
        "may_stop": "brake" in names,
        "no_separatrix_reason": ROTOR_REASON if "rotor" in names else "",
    }
    return dataclass(frozen=True)(type("Torques", (Torques,), attributes_of))
