"""One rigid body under a sum of torques, A omega' + omega x G = N, and the tables of keys of the
models with such sums: `linear-diag`, `tensor`, `cavity+constant` and `torques`."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..schema.expression import Expression
from ..schema.kinds import (
    Either,
    Key,
    ListOf,
    Mistake,
    Number,
    Rule,
    Table,
    matrix,
    mistakes_where,
    vector,
)
from ..text import grouped, time_text
from .base import CONSTANTS_KEY, REST_BITS, TERMS_NAME, Constants, Event, EventOutcome, mistake_of
from .brake import STOPPED, stop_details
from .euler import TERMS, composed, rates_under
from .rigid_body import (
    INERTIA,
    INITIAL,
    BodyFrame,
    body_constants,
    complete,
    excess_of_rounding,
    is_tensor,
    principal_axes,
    symmetric,
)
from .terms.fluid import CAVITY, cavity_warnings, coefficient, weak
from .terms.time_laws import (
    CONSTANTS,
    VELOCITIES,
    CaseConstants,
    coefficient_kind,
    coefficients_kind,
    expressions_of,
    first_negative,
    is_law,
    law_constants,
    named_constants,
    resolved,
    scaled,
    value_mistakes,
)
from .theory.exact import (
    AlongMomentum,
    free_attitude,
    free_motion,
    scaled_motion,
    turn_of_hodograph,
)
from .theory.theorems import (
    Dissipation,
    axes_never_left,
    crossing_predictions,
)

ROUNDING_OF_G = 4 * float(np.finfo(float).eps)
"""The largest ratio |G|/|A omega| at which G = A omega + h counts as 0, because the sum of A omega
and h = -A omega leaves a rounding. The largest one of random tensors was an eighth of this
bound."""

TENSOR_ROUNDING = 1e-13
"""An entry of a tensor that is smaller than the largest one by this factor counts as 0: a change of
axes leaves such roundings."""

ZEROS = (0.0, 0.0, 0.0)

RESISTING = ("damping", "quadratic", "kappa", "brake")
"""The torques that drive the body where their coefficients are negative."""

PLACES = 4097
"""The number of times at which the sign of changing coefficients is checked."""

NOT_COVERED = frozenset({"rotor", "space_torque", "expression"})
"""The torques that the theorems on crossings do not cover."""


def terms_named(data: Mapping[str, Any]) -> tuple[str, ...]:
    """The torques that a case names, in the order of TERMS."""
    given = {"kappa" if name == "cavity" else name for name, x in data.items() if x is not None}
    return tuple(name for name in TERMS if name in given)


def coefficients_of(
    data: Mapping[str, Any], constants: CaseConstants
) -> dict[str, tuple[Any, ...]]:
    """The coefficients of each torque that a case names, in the order of the torque's constants and
    of TERMS. A coefficient is a number or a law of time. Those of `torque` include epsilon."""
    if data.get("cavity") is not None:
        data = {**data, "kappa": coefficient(data["cavity"])}
    named = {name: TERMS[name].coefficients(data[name]) for name in terms_named(data)}
    given = {name: tuple(resolved(x, constants) for x in values) for name, values in named.items()}
    if "torque" in given:
        given["torque"] = tuple(scaled(x, data.get("epsilon", 1.0)) for x in given["torque"])
    return given


@dataclass(frozen=True)
class Body(BodyFrame):
    """A rigid body under any sum of torques.

    A omega' + omega x G = N
    G = A omega + h

    omega = (p, q, r): angular velocity, 1/time (`initial`). A: principal moments of inertia
    (`inertia`), or the full tensor along any body axes. With a full tensor all vectors are given
    and stored along these axes, and the labels x1, x2, x3 name principal axes. h: angular momentum
    of a rotor that turns at constant speed in the body (`rotor`).

    N is the sum of the torques that the case names: -lambda_i A_i omega_i (`damping`), -I omega
    with a tensor I (`resistance`), -c_i |omega| A_i omega_i (`quadratic`), epsilon M, constant in
    the body (`torque`, `epsilon`), -b G/|G| (`brake`), F e, where e is fixed in space
    (`space_torque`), the fluid's torque of cavity+constant (`kappa` or `cavity`), and three
    expressions in p, q, r and t (`expression`). Each coefficient may be an expression in t and
    constants, except for `cavity` and `rotor`.

    A brake brings G to 0 (event `stopped`). From then on omega is 0, or -A^-1 h with a rotor, and
    no axis is enclosed. An expression may jump or have corners: each step is compared with the
    equations, and a step that misses them is cut. The motion ends at a pole of an expression, and
    where an expression holds a component of omega at 0, as dry friction does.

    A torque along G changes the clock of the free motion and not its path. Such torques are equal
    damping, equal quadratic drag and a brake. Under constant damping, a constant brake, or both,
    the clock has a closed form, and so has the motion (method exact).
    """

    damping: Any = None
    resistance: Any = None
    quadratic: Any = None
    cavity: Any = None
    kappa: Any = None
    torque: Any = None
    epsilon: float = 1.0
    brake: Any = None
    rotor: Any = None
    space_torque: Any = None
    expression: Any = None

    degree = {"g": 2} | {name: n for term in TERMS.values() for name, n in term.degree.items()}
    resisting = frozenset({"brake"})
    fixed_in_space = tuple(TERMS["space_torque"].extra)
    has_fluid: ClassVar[bool] = False
    """Whether a case has to give `cavity` or `kappa`."""

    says_crossings: ClassVar[bool] = False
    """Whether `predictions` say which crossings the torques allow."""

    @staticmethod
    def rhs(t: Any, y: Sequence[Any], k: Any) -> tuple[Any, ...]:
        """The rates by Euler's equations under the torques that k names."""
        return rates_under(k.terms.split(), t, y, k)

    @cached_property
    def term_coefficients(self) -> dict[str, tuple[Any, ...]]:
        """The coefficients of each torque that acts, numbers or laws of time, in the order of
        TERMS."""
        return coefficients_of(vars(self), self.case_constants)

    @cached_property
    def constants(self) -> Constants:
        """The body, the names of its torques, their coefficients, and the constants of the case."""
        terms = self.term_coefficients
        named = ((TERMS[term].degree, values) for term, values in terms.items())
        given = {k: x for names, values in named for k, x in zip(names, values, strict=True)}
        constants: dict[str, Any] = law_constants(given) | {TERMS_NAME: " ".join(terms)}
        if self.expression is not None:
            constants |= {f"expression{i}": text for i, text in enumerate(self.expression, 1)}
            constants |= {"velocity_unit": 1.0, "time_unit": 1.0}
        if self.brake is not None:
            constants["momentum_at_start"] = self.momentum_at_start
        if self.changing_terms or self.expression is not None:
            constants |= named_constants(self.case_constants)
        if (frame := self.frame) is None:
            return constants | body_constants(self.inertia)
        axes = tuple(frame.axes.ravel())
        return constants | body_constants([*frame.moments]) | {"principal_axes": axes}

    # The body and its start

    @property
    def momentum_at_start(self) -> float:
        """|G| at the start."""
        return float(np.hypot.reduce(self.momentum(np.array(self.initial_velocity))))

    def momentum(self, omega: np.ndarray) -> np.ndarray:
        """G = A omega + h (..., 3), where h = 0 without a rotor."""
        G = super().momentum(omega)
        if self.rotor is None:
            return G
        # For omega = -A^-1 h, where G is 0, rounding leaves a small G with a meaningless direction.
        rounding = ROUNDING_OF_G * self.moments.max() * np.abs(omega).max(axis=-1, keepdims=True)
        G = G + np.array(self.rotor)
        return np.where(np.abs(G).max(axis=-1, keepdims=True) > rounding, G, 0)

    def velocities(self, G: np.ndarray) -> np.ndarray:
        """The angular velocities A^-1 (G - h) (..., 3), where h = 0 without a rotor."""
        return super().velocities(G if self.rotor is None else G - np.array(self.rotor))

    def starts(self, omega: np.ndarray) -> np.ndarray:
        """The torques' own variables follow omega."""
        w = self.to_principal(omega)
        e = self.direction if self.attitude else self.to_principal(self.direction)
        extra = {
            "brake": [np.hypot.reduce(self.momentum(omega), axis=-1) / self.moments[0]],
            "space_torque": [np.full(w.shape[:-1], x) for x in e],
        }
        columns = (x for name in self.term_coefficients for x in extra.get(name, ()))
        return np.stack([*np.moveaxis(w, -1, 0), *columns])

    @cached_property
    def start(self) -> tuple[float, ...]:
        """omega along the principal axes, followed by the torques' own variables."""
        omega = self.initial_velocity
        # Along the principal axes already unless the body has a frame, which turns omega to them.
        only_omega = self.frame is None and not any(TERMS[k].extra for k in self.term_coefficients)
        return omega if only_omega else tuple(self.starts(np.array(omega)).tolist())

    @property
    def extended_start(self) -> np.ndarray:
        """The start with omega turned to the principal axes in long double."""
        y = super().extended_start
        y[:3] = self.to_principal(np.array(self.initial_velocity, dtype=np.longdouble))
        return y

    @property
    def direction(self) -> np.ndarray:
        """The direction e of the torque fixed in space (3,), of length 1; any without one."""
        direction = np.array(self.space_torque["direction"] if self.space_torque else (1.0, 0, 0))
        unit = direction / np.abs(direction).max()
        return np.asarray(unit / np.linalg.norm(unit))

    @property
    def run_events(self) -> tuple[Event, ...]:
        """The stop by a brake."""
        return () if self.brake is None else (STOPPED,)

    # Mistakes in the data, and warnings

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """Further mistakes: combinations of torques, body and start that make no motion."""
        named, inertia, fluid = terms_named(data), data.get("inertia"), data.get("cavity")
        space, h = data.get("space_torque"), data.get("rotor")
        has_G = (data.get("initial") or {}).get("G") is not None
        yield from mistakes_of_tensor(data) if is_tensor(inertia) else super().check(data)
        if fluid is not None or (cls.has_fluid and {"cavity", "kappa"} <= data.keys()):
            at = ("cavity",) if fluid else ()
            yield from mistake_of(at, coefficient, fluid, data.get("kappa"))
        yield from negative_coefficients(data)
        yield from mistakes_where(
            (
                not named and data.keys() >= TERMS.keys(),
                (),
                f"no torque is named ({', '.join(TERMS)}); damping: 0 is free motion",
            ),
            (
                space and not any(space["direction"]),
                ("space_torque", "direction"),
                "a direction has a length, and this one has none",
            ),
            (
                h and has_G,
                ("initial",),
                "with a rotor |G| does not determine the missing component: give p, q and r",
            ),
            (
                "brake" in named and is_at_rest(data),
                ("brake",),
                f"a body {'whose G is 0' if h else 'at rest'} has no direction to brake in",
            ),
        )

    @classmethod
    def check_span(cls, data: Mapping[str, Any], start: float, end: float) -> Iterator[Mistake]:
        """The expressions that have no finite value at the start, or at rest where a brake
        leads."""
        given = (data.get("initial") or {}).items()
        known = {name: w for name, w in given if name in VELOCITIES and w is not None}
        known |= {"t": start, **(data.get(CONSTANTS_KEY) or {})}
        expressions = [*expressions_of({name: data[name] for name in TERMS if name in data})]
        mistakes = [*value_mistakes(expressions, known)]
        if data.get("brake") is not None and data.get("rotor") is None and not mistakes:
            at_rest = known | dict.fromkeys(VELOCITIES, 0.0)
            mistakes += value_mistakes(expressions, at_rest, "at rest, to which the brake leads")
        yield from mistakes

    @property
    def warnings(self) -> list[str]:
        """Sentences on coefficients that no medium has, and on torques outside a theory's
        limits."""
        # A torque with a coefficient that changes is left out. Damping is judged all the same, by
        # its constant coefficients.
        coefficients, changing = self.term_coefficients.items(), self.changing_terms
        given = {term: entries for term, entries in coefficients if term not in changing}
        damping = self.term_coefficients.get("damping", ())
        feeding = [
            f"lambda{i} = {x:g}" for i, x in enumerate(damping, 1) if not is_law(x) and x < 0
        ]
        (kappa,), torque = given.get("kappa", (0.0,)), given.get("torque", ZEROS)
        I, omega = np.reshape(given.get("resistance", np.zeros(9)), (3, 3)), self.omega_at_start
        values = np.linalg.eigvalsh(I / 2 + I.T / 2)
        named = ", ".join(f"{value:.6g}" for value in values)
        excess = 0.0 if is_tensor(self.inertia) else excess_of_rounding(self.inertia)
        sentences = {
            f"one moment exceeds the sum of the other two by {excess:.3g}, which rounding may "
            "have caused": excess > 0,
            f"negative damping feeds energy in: {', '.join(feeding)}": bool(feeding),
            f"the tensor is not dissipative: its symmetric part has the eigenvalues {named}": (
                values[0] < -1e-12 * abs(values[-1])
            ),
            # A symmetric tensor that is turned into other axes and printed in decimals is symmetric
            # to these digits only.
            "the tensor is not symmetric": np.abs(I - I.T).max() > 1e-9 * np.abs(I).max(),
        }
        return [
            *(sentence for sentence, applies in sentences.items() if applies),
            *weak(self.moments, omega, kappa, torque),
            *cavity_warnings(self.cavity, self.moments, omega),
        ]

    def warnings_within(self, start: float, end: float) -> list[str]:
        """A sentence on each torque that drives the body where its changing coefficient becomes
        negative, with the first time."""
        times, constants = np.linspace(start, end, PLACES), self.case_constants
        laws = ((k, x) for k, c in self.term_coefficients.items() for x in c if is_law(x))
        first = [(k, first_negative(x, times, constants)) for k, x in laws if k in RESISTING]
        return [
            f"{term} is negative from t = {time_text(min(when), start)} on: it drives the body"
            for term, when in grouped((k, t) for k, t in first if t is not None).items()
        ]

    @property
    def changing_terms(self) -> frozenset[str]:
        """The torques that have a coefficient that changes with time."""
        return frozenset(
            term for term, entries in self.term_coefficients.items() if any(map(is_law, entries))
        )

    # Theory on the motion

    @property
    def dissipation(self) -> Dissipation | None:
        """The torques as the theorems on crossings take them. A brake is left out, because it does
        not change D/G^2. None where a torque changes with time or no theorem covers it."""
        given = self.term_coefficients
        if not NOT_COVERED.isdisjoint(given) or self.changing_terms - {"brake"}:
            return None
        I = np.reshape(given.get("resistance", np.zeros(9)), (3, 3))
        if self.frame:
            I = self.to_principal(self.to_principal(I).T)
            I = np.where(np.abs(I) > TENSOR_ROUNDING * np.abs(I).max(), I, 0)
        return Dissipation(
            self.moments,
            damping=tuple(np.add(given.get("damping", ZEROS), np.diag(I) / self.moments).tolist()),
            quadratic=given.get("quadratic", ZEROS),
            kappa=given.get("kappa", ZEROS)[0],
            torque=self.to_principal(np.array(given.get("torque", ZEROS))),
            covered=not (I - np.diag(np.diag(I))).any(),
        )

    def absorbing_axes(self, start: float, end: float) -> frozenset[int]:
        """The axes that the theorems on crossings give."""
        terms = self.dissipation
        return axes_never_left(terms) if terms else frozenset()

    def predictions(self, start: float, end: float) -> list[str]:
        """Sentences on the crossings that are possible, on a rotor, beside which no axis is
        enclosed, and on the turn of a free body with an attitude."""
        terms = self.dissipation if self.says_crossings else None
        crossings = crossing_predictions(terms) if terms else []
        return [*crossings, *filter(None, [self.no_separatrix_reason]), *(self.turn or ())[2:]]

    # The motion in closed form

    @property
    def along_momentum(self) -> AlongMomentum | None:
        """The constant rates of equal damping, of a brake, or of both; None under other torques."""
        given = self.term_coefficients
        damping, (brake,) = given.get("damping", (0.0,)), given.get("brake", (0.0,))
        others = given.keys() - {"damping", "brake"} or self.changing_terms
        if others or len(set(damping)) > 1:
            return None
        G = self.momentum(np.array(self.initial_velocity, dtype=np.longdouble))
        return AlongMomentum(damping[0], np.longdouble(brake) / (np.hypot.reduce(G) or 1))

    @property
    def has_closed_form(self) -> bool:
        """Whether the motion is free or under equal damping, a brake, or both, all constant; with
        an attitude, whether it is free."""
        along = self.along_momentum
        return along is not None and not (self.attitude and any(along))

    def exact_states(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Free motion in the time s of a clock, which torques along G slow down or speed up."""
        A, omega = self.moments, self.omega_at_start
        along = self.along_momentum
        assert along is not None
        if not along.brake:
            state, exponent = scaled_motion(A, omega, along.damping, t)
        else:
            g, s = along.clock(t)
            slowed, exponent = np.frexp(g)
            state = slowed[:, np.newaxis] * free_motion(A, omega, s)
            exponent = np.where(slowed > 0, exponent, -REST_BITS)
        # The state variable of a brake, |G| at the start of a stage, is 0: there are no stages
        # here.
        stages = np.zeros((int("brake" in self.term_coefficients), len(t)), dtype=state.dtype)
        rows = [*state.T, *stages]
        if self.attitude:
            Q = free_attitude(A, omega, t)
            Q[:, 1:] = self.from_principal(Q[:, 1:])
            rows += composed(np.array(self.initial_state[-4:], dtype=Q.dtype), Q.T)
        return np.column_stack(rows), exponent

    def exact_end(self, fp: type) -> tuple[str, EventOutcome] | None:
        """The stop of the body by a brake; None where it never stops."""
        along = self.along_momentum
        if along is None or np.isinf(along.stop):
            return None
        _, s = along.clock(np.array([along.stop], dtype=fp))
        omega = free_motion(self.moments, self.omega_at_start, s)
        momentum = self.from_principal(self.moments * omega)
        details = stop_details(momentum[0], self.enclosed(omega)[0])
        return "stopped", EventOutcome(float(along.stop), details, ())

    @property
    def turn(self) -> tuple[float, float, str] | None:
        """`turn_of_hodograph` of a free body with an attitude; None for other motions."""
        is_free = self.attitude and self.has_closed_form
        return turn_of_hodograph(self.moments, self.omega_at_start) if is_free else None


def mistakes_of_tensor(data: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes in a full tensor of inertia, in a start beside it, and in torques that act about
    principal axes."""
    inertia = data["inertia"]
    if not all(isinstance(row, tuple) for row in inertia):
        yield ("inertia",), "expected 3 positive numbers, or 3 rows of 3 numbers, got some of each"
        return
    yield from mistake_of(("inertia",), principal_axes, inertia)
    if "initial" in data:
        yield from mistake_of(("initial",), complete, inertia, data["initial"])
    says = "acts about principal axes: give the three moments as `inertia`, or `resistance`"
    terms = {name: data.get(name) or (0.0,) for name in ("damping", "quadratic")}
    yield from (((name,), says) for name, x in terms.items() if any(one != x[0] for one in x))


def is_at_rest(data: Mapping[str, Any]) -> bool:
    """Whether G is 0 at the start; False for data in which another check finds a mistake."""
    with suppress(KeyError, ValueError):
        body = Body(data["inertia"], data["initial"], rotor=data.get("rotor"))
        return not body.momentum(np.array(body.initial_velocity)).any()
    return False


def negative_coefficients(data: Mapping[str, Any]) -> Iterator[Mistake]:
    """The mistakes of negative constant coefficients of quadratic drag, a fluid or a brake."""
    says = "a negative coefficient drives the body: write that as an expression"
    with suppress(KeyError, ArithmeticError, ValueError):  # other checks find these mistakes
        given = coefficients_of(data, data.get(CONSTANTS_KEY) or ())
        entries = [(k, i, x) for k in RESISTING[1:] for i, x in enumerate(given.get(k, ()))]
        negative = [(k, i) for k, i, x in entries if not is_law(x) and x < 0]
        # The path to a torque with one coefficient has no position after the key.
        yield from ((at[: len(TERMS[at[0]].degree)], says) for at in negative)


# The key tables

RATE, TORQUE = "1/time", "moment of inertia / time^2"
RESISTANCE, FLUID = "moment of inertia / time", "moment of inertia * time"


def resistance_key(entry: Rule, rows: Rule, **more: Any) -> Rule:
    """The key of a tensor of resistance. It takes `rows` of entries, or two numbers of the kind
    `entry`."""
    two = {
        "diagonal": Key(entry, "every I_ii", unit=RESISTANCE),
        "off_diagonal": Key(entry, "every I_ij, i != j", unit=RESISTANCE),
    }
    return Key(Either(rows, Table(two)), "tensor I of -I omega", unit=RESISTANCE, **more)


class LinearDiag(Body):
    """A rigid body in a medium that resists each component of the angular momentum linearly.

    A1 p' + (A3 - A2) q r = -lambda1 A1 p
    A2 q' + (A1 - A3) p r = -lambda2 A2 q
    A3 r' + (A2 - A1) p q = -lambda3 A3 r

    p, q, r: angular velocity about x1, x2, x3, 1/time (`initial`). A1, A2, A3: principal moments of
    inertia (`inertia`). lambda1, lambda2, lambda3: coefficients of resistance, 1/time (`damping`),
    all zero for free motion. Assumed: the coefficients are constant, and the medium has the
    principal axes of the inertia.

    The criterion D = G^2 - 2 T A_m changes its sign at most once. Let l, m, s be the axes of
    largest, middle and smallest inertia: where D = 0 its rate -2 (lambda_l - lambda_s) A_l
    (A_l - A_m) w_l^2 has one sign throughout.

    Source: A. L. Rachinskaya, rotation of a rigid body in a resistant medium, eqs (1)-(4).
    """

    name = "linear-diag"
    form = "full"
    keys = {
        "inertia": INERTIA,
        "damping": Key(
            vector(3, scalar=True),
            "coefficients of resistance lambda_i; a scalar means all three equal",
            unit=RATE,
            default=ZEROS,
        ),
        "initial": INITIAL,
    }
    always_absorbing = True


class Tensor(Body):
    """A rigid body in a medium that resists the angular velocity through a constant tensor I.

    A1 p' + (A3 - A2) q r = -(I11 p + I12 q + I13 r)      and cyclically

    p, q, r: angular velocity about x1, x2, x3, 1/time (`initial`). A1, A2, A3: principal moments of
    inertia (`inertia`). I: tensor of resistance, moment of inertia / time (`resistance`). Assumed:
    I is constant. It takes energy out of every motion only if its symmetric part is positive
    semi-definite. A tensor that feeds energy into some motions is allowed, with a warning.

    Source: A. L. Rachinskaya, rotation of a rigid body in a resistant medium, eqs (9)-(11).
    """

    name = "tensor"
    form = "full"
    keys = {
        "inertia": INERTIA,
        "resistance": resistance_key(Number(), matrix(3)),
        "initial": INITIAL,
    }


class Cavity(Body):
    """A rigid body with a cavity full of a very viscous fluid, under a torque constant in body
    axes.

    A1 p' + (A3 - A2) q r = kappa/(A1 A2 A3) p [A3 (A1 - A3)(A1 + A3 - A2) r^2
                                                + A2 (A1 - A2)(A1 + A2 - A3) q^2] + epsilon M1
    and cyclically

    p, q, r: angular velocity about x1, x2, x3, 1/time (`initial`). A1, A2, A3: principal moments of
    inertia of body and fluid together (`inertia`). kappa = rho P0/nu, moment of inertia * time
    (`cavity`, or `kappa`). M1, M2, M3: constant torque (`torque`) with its factor epsilon
    (`epsilon`). Assumed: the Reynolds number is small, and so are the torques compared with
    |omega| |G|. The fluid's torque is internal: without M, |G| is constant and the energy falls.

    Source: D. Leshchenko and T. Kozachenko, Mechanics and Mathematical Methods V(1) (2023) 25, eq.
    (2), for A1 = A2; F. L. Chernousko 1972 for a triaxial body. The factor of M is epsilon^2 in eq.
    (1) of the former, and epsilon, as here, in eq. (2).
    """

    name = "cavity+constant"
    form = "full"
    keys = {
        "inertia": INERTIA,
        "cavity": CAVITY,
        "kappa": Key(Number(least=0), "rho P0/nu, instead of `cavity`", FLUID, default=None),
        "torque": Key(vector(3), "constant torque M1, M2, M3", unit=TORQUE, default=ZEROS),
        "epsilon": Key(Number(), "small parameter, the factor of the torque", default=1.0),
        "initial": Key(
            Table(
                {
                    **INITIAL["properties"],
                    "x": Key(
                        Number(least=0),
                        "p^2 + q^2; x and y replace p, q and r",
                        unit="1/time^2",
                        default=None,
                    ),
                    "y": Key(Number(least=0), "r^2 (then r >= 0)", unit="1/time^2", default=None),
                }
            ),
            "initial angular velocity: p, q, r, or x and y (then p = sqrt(x), q = 0, r = sqrt(y))",
        ),
    }
    has_fluid = True


class Torques(Body):  # noqa: D101
    __doc__ = Body.__doc__

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
            coefficients_kind(), "coefficients lambda_i of -lambda_i A_i omega_i", RATE, None
        ),
        "resistance": resistance_key(
            coefficient_kind(),
            ListOf(
                ListOf(coefficient_kind(), length=3, title="3 numbers or expressions in t"),
                length=3,
                title="3 rows of 3 numbers or expressions in t",
            ),
            default=None,
        ),
        "quadratic": Key(
            coefficients_kind(), "coefficients c_i of -c_i |omega| A_i omega_i", default=None
        ),
        "cavity": CAVITY,
        "kappa": Key(
            coefficient_kind(),
            "rho P0/nu of a fluid, instead of `cavity`",
            FLUID,
            None,
        ),
        "torque": Key(
            coefficients_kind(),
            "torque M1, M2, M3, constant in the body",
            TORQUE,
            None,
        ),
        "epsilon": Key(Number(), "small parameter, the factor of `torque`", default=1.0),
        "brake": Key(
            coefficient_kind(),
            "b of -b G/|G|, which brings a free body to rest in the shortest time",
            TORQUE,
            None,
        ),
        "rotor": Key(
            vector(3),
            "h in G = A omega + h, the angular momentum of a rotor beside the body's",
            unit=RESISTANCE,
            default=None,
        ),
        "space_torque": Key(
            Table(
                {
                    "size": Key(coefficient_kind(), "F of the torque F e", TORQUE),
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
            TORQUE,
            None,
        ),
        "initial": INITIAL,
    }
    says_crossings = True
