"""A rigid body with the principal moments A1, A2, A3: G = A omega, and the axis that G encircles.

    D = G^2 - 2 T A_m = A_l (A_l - A_m) w_l^2 - A_s (A_m - A_s) w_s^2

l, m, s are the axes of largest, middle and smallest inertia. Seen from the body, G goes round axis
l where D > 0, and round axis s where D < 0. Further the principal axes of a full tensor, the keys
`inertia` and `initial`, and the class that models with a state of omega share.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, localcontext
from functools import cached_property, lru_cache
from itertools import combinations, permutations
from operator import attrgetter
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .. import HodoError
from ..arithmetic import sqrt
from ..schema.kinds import Key, Mistake, Number, Rate, Table, is_list, vector
from .attitude import quaternion_at_start
from .base import (
    Bound,
    Constants,
    Event,
    Label,
    Model,
    attributes,
    jacobian,
    mistake_of,
    stacked,
)
from .euler import in_case_axes, times

UNDETERMINED, SEPARATRIX = -1, 0
LABELS = {-1: "undetermined", 0: "separatrix", 1: "x1", 2: "x2", 3: "x3"}


def inertia_order(A: Any) -> tuple[int, int, int]:
    """The positions of the largest, middle and smallest moment of inertia; ties keep the order
    given."""
    # A stable sort, so that ties keep the order given.
    largest, middle, smallest = sorted(range(3), key=lambda i: -A[i])
    return largest, middle, smallest


def separatrix_terms(A: Any, omega: Any, order: tuple[int, int, int]) -> tuple[Any, Any]:
    """The two non-negative terms A_l (A_l - A_m) w_l^2 and A_s (A_m - A_s) w_s^2 of D.

    The difference G^2 - 2 T A_m itself loses every digit near the separatrix; this form loses no
    more than the data's own conditioning.

    Source: Rachinskaya, eqs (7)-(8), solved for D.
    """
    l, m, s = order
    outer, inner = omega[l] * omega[l], omega[s] * omega[s]
    return A[l] * (A[l] - A[m]) * outer, A[s] * (A[m] - A[s]) * inner


def separatrix_roots(A: Any, order: tuple[int, int, int]) -> tuple[Any, Any]:
    """a and b of D = (a w_l)^2 - (b w_s)^2."""
    l, m, s = order
    return np.sqrt(A[l] * (A[l] - A[m])), np.sqrt(A[s] * (A[m] - A[s]))


def separatrix_forms(A: Any, omega: Any, order: tuple[int, int, int]) -> Any:
    """The two linear forms a w_l - b w_s and a w_l + b w_s, whose product is D."""
    a, b = separatrix_roots(A, order)
    outer, inner = a * omega[order[0]], b * omega[order[2]]
    return np.array([outer - inner, outer + inner])


def scaled_separatrix(A: Any, w: Any, order: tuple[int, int, int]) -> tuple[Any, Any, Any]:
    """D, the sum of its two terms, and a bound of that sum, for omega (3, ...) brought to a size
    near 1."""
    # By a power of two, which changes no digit: of 1e-170 the squares would be 0. Contiguous, since
    # numpy is slow along an axis of three whose numbers lie together.
    w = np.ascontiguousarray(np.ldexp(w, -np.frexp(np.abs(w).max(axis=0))[1]))
    a, b = separatrix_roots(A, order)
    minus, plus = separatrix_forms(A, w, order)
    bound = (a * a + b * b) * (w * w).sum(axis=0)
    return minus * plus, (minus * minus + plus * plus) / 2, bound


def share_of(total: Any, part: Any, of_nothing: float = 0.0) -> np.ndarray:
    """part/total, `of_nothing` where the total is 0."""
    return np.asarray(np.divide(part, total, out=np.full_like(total, of_nothing), where=total > 0))


def separation(A: Any, omega: Any, order: tuple[int, int, int]) -> np.ndarray:
    """|D| as a part of the sum of its two terms (n,), for omega (3, n); infinite for a spherical
    body, which has no separatrix."""
    D, total, _ = scaled_separatrix(A, omega, order)
    return np.where(A[order[0]] == A[order[2]], np.inf, share_of(total, np.abs(D)))


def margin(A: Any, omega: np.ndarray, order: tuple[int, int, int]) -> np.ndarray:
    """How far omega (..., 3) is from the separatrix, relative to |omega|: an error of about that
    size may change its side. Positive where the axis of largest inertia is enclosed.

    It is D sqrt(near) over the sum of the two terms of D, with `near` of `near_middle_axis`: up to
    a factor between 1 and sqrt 2, the smaller of the two forms over sqrt(a^2 + b^2) |omega|.
    """
    A = np.asarray(A, dtype=omega.dtype)
    D, total, bound = scaled_separatrix(A, np.moveaxis(omega, -1, 0), order)
    # Moments to the fourth leave the doubles.
    return share_of(np.sqrt(bound) * np.sqrt(total), D).astype(float)


def near_middle_axis(A: Any, omega: np.ndarray) -> np.ndarray:
    """The sum of the two terms of D at omega (..., 3) over its bound, the sum of their weights
    times |omega|^2; 1 for a sphere and at rest, where D has no terms.

    Its root is, roughly, the angle between the rotation and the middle axis of a triaxial body.
    """
    _, total, bound = scaled_separatrix(A, np.moveaxis(omega, -1, 0), inertia_order(A))
    return share_of(bound, total, of_nothing=1.0)


@np.errstate(invalid="ignore")  # what is infinite is undetermined anyway
def enclosed_axis(A: Any, omega: np.ndarray, band: Any) -> np.ndarray:
    """The axis that the hodograph of G encloses, for omega (..., 3) at any scale, as int8.

    1, 2, 3 name the body axes; 0 is the separatrix, where |margin| is at most `band`, a number or
    one for each omega; -1 is undetermined: no rotation, or no axis to go round (steady rotation of
    a symmetric or spherical body).
    """
    order, w = inertia_order(A), np.moveaxis(omega, -1, 0)
    largest, middle, smallest = order
    signed = margin(A, omega, order)
    labels = np.where(signed > 0, largest + 1, smallest + 1)
    # In steady rotation about an axis of symmetry both terms are 0: G goes round nothing.
    turning = signed != 0
    if A[largest] > A[middle] > A[smallest]:
        labels, turning = np.where(np.abs(signed) <= band, SEPARATRIX, labels), (w != 0).any(axis=0)
    known = turning & np.isfinite(w).all(axis=0)
    return np.where(known, labels, UNDETERMINED).astype(np.int8)


def separatrix_circles(A: np.ndarray) -> list[np.ndarray]:
    """The two great circles D = 0 of the directions of G (721, 3); none of a symmetric body."""
    largest, middle, smallest = inertia_order(A)
    if A[largest] == A[middle] or A[middle] == A[smallest]:
        return []
    # D = G_l^2 (1/A_m - 1/A_l) - G_s^2 (1/A_s - 1/A_m), up to a factor.
    ratio = math.sqrt((1 / A[smallest] - 1 / A[middle]) / (1 / A[middle] - 1 / A[largest]))
    turn, (x, y, z) = np.linspace(0, 2 * np.pi, 721)[:, None], np.eye(3)[[*inertia_order(A)]]
    outward = [(sign * ratio * x + z) / math.hypot(ratio, 1) for sign in (1, -1)]
    return [np.cos(turn) * direction + np.sin(turn) * y for direction in outward]


def slope(A: Sequence[float] | np.ndarray) -> float:
    """K = A_s (A_m - A_s) / (A_l (A_l - A_m)): zero where the smaller two moments are equal, inf
    where the larger two.

    The separatrix is w_l^2 = K w_s^2. Raises HodoError for a spherical body, which has none.
    Source: Rachinskaya, eqs (7)-(8).
    """
    outer, inner = separatrix_terms(A, (1.0, 1.0, 1.0), inertia_order(A))
    if not (outer or inner):
        raise HodoError("a body with three equal moments of inertia has no quadrants")
    return inner / outer if outer else math.inf


# The principal axes of a body whose inertia is given as a full tensor

ASYMMETRY = 1e-12
"""The relative difference of two entries of a symmetric tensor that is rounding."""


class PrincipalAxes(NamedTuple):
    """The principal moments of a tensor (3,), and its axes, row by row (3, 3), as unit vectors in
    the axes of the tensor: a right-handed system.

    All are of long doubles: rounded to doubles, moments and axes belong to another tensor, along
    which a motion in extended precision goes astray as one in double does.
    """

    moments: np.ndarray
    axes: np.ndarray


def one_exceeds_others(moments: Sequence[Any] | np.ndarray) -> bool:
    """Whether one of three moments is larger than the sum of the others, which no body has.
    Equality is allowed, of a flat disc, to the rounding of the moments."""
    return bool(2 * max(moments) > sum(moments) * (1 + 4 * np.finfo(float).eps))


def excess_of_rounding(moments: Sequence[float]) -> float:
    """The excess of one of three moments over the sum of the others, if it is at most one unit of
    the last decimal, which rounding explains; else 0."""
    *others, largest = sorted(moments)
    excess = largest - sum(others)
    return excess if 0 < excess <= last_digit(largest) else 0.0


def last_digit(x: float) -> float:
    """One unit of the last digit of the shortest decimal of a number, and its rounding; at most a
    hundredth of it, since 0.1 is not the rounding of 0.2."""
    unit = 10.0 ** int(Decimal(repr(float(x))).as_tuple().exponent) * (1 + 1e-9)
    return min(unit, abs(x) / 100)


def symmetric(tensor: Sequence[Any]) -> Sequence[Any]:
    """The symmetric part of a tensor whose entries differ from their transposes by at most one unit
    of the last decimal, which rounding explains; other values as they are."""
    if not all(isinstance(row, tuple) for row in tensor):
        return tensor
    rows = [list(row) for row in tensor]
    for i, j in combinations(range(3), 2):
        a, b = rows[i][j], rows[j][i]
        if a != b and abs(a - b) <= last_digit(max(a, b, key=abs)):
            rows[i][j] = rows[j][i] = (a + b) / 2
    return tuple(map(tuple, rows))


def is_diagonal(tensor: np.ndarray) -> bool:
    """Whether a tensor has no entries off its diagonal."""
    return not (tensor - np.diag(np.diag(tensor))).any()


@lru_cache(maxsize=256)
def principal_axes(tensor: tuple[tuple[float, ...], ...]) -> PrincipalAxes:
    """The principal axes of a tensor of inertia, each with the number of the given axis that it is
    near. A diagonal tensor has the given axes.

    Raises ValueError, with a sentence, for a tensor that no body has.
    """
    J = np.array(tensor, dtype=float)
    i, j = np.unravel_index(np.abs(J - J.T).argmax(), J.shape)
    if abs(J[i, j] - J[j, i]) > ASYMMETRY * np.abs(J).max():
        raise ValueError(
            f"a tensor of inertia is symmetric, and this one has {J[i, j]:g} in row {i + 1}, "
            f"column {j + 1}, and {J[j, i]:g} in the transpose"
        )
    moments, axes = diagonalized(((J + J.T) / 2).astype(np.longdouble))
    named = ", ".join(f"{moment:.6g}" for moment in moments)
    if not moments.min() > 0:
        raise ValueError(f"the principal moments of this tensor are not all positive: {named}")
    for words in (words for A in moments for words in range_mistake(float(A))):
        raise ValueError(words)
    if one_exceeds_others(moments):
        raise ValueError(
            f"no body has principal moments of {named}: one exceeds the sum of the other two"
        )
    return PrincipalAxes(moments, axes)


SWEEPS = 8
"""The sweeps of Jacobi's rotations, which converge quadratically: the sixth of random tensors
changed nothing."""


def diagonalized(J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The moments and axes of a tensor of long doubles, by Jacobi's rotations; in the order and
    with the signs that bring the axes nearest to the given ones."""
    axes = np.eye(3, dtype=np.longdouble)
    for i, j in [*combinations(range(3), 2)] * SWEEPS:
        turned = axes @ J @ axes.T
        if turned[i, j]:
            ratio = (turned[j, j] - turned[i, i]) / (2 * turned[i, j])
            tangent = (1 if ratio >= 0 else -1) / (abs(ratio) + np.hypot(1, ratio))
            cosine = 1 / np.hypot(1, tangent)
            axes[[i, j]] = cosine * np.array([[1, -tangent], [tangent, 1]]) @ axes[[i, j]]
    order = max(permutations(range(3)), key=lambda p: np.abs(axes[p, range(3)]).sum())
    axes = axes[[*order]] * np.where(np.diag(axes[[*order]]) < 0, -1, 1)[:, None]
    if np.linalg.det(axes.astype(float)) < 0:
        axes[np.abs(np.diag(axes)).argmin()] *= -1
    return np.diag(axes @ J @ axes.T), axes


# What the models share

SMALLEST_MOMENT = 1e-100
"""The smallest moment of inertia whose cube is a double, and the inverse of the largest one."""

INERTIA = Key(
    vector(3, above=0)
    | {"answer": lambda _: "; a full tensor is a key of other models, as torques"},
    "principal moments of inertia A1, A2, A3",
    unit="moment of inertia",
)
"""Three moments in any order; `BodyFrame.check` checks the triangle inequality and the range of
SMALLEST_MOMENT."""


def components_answer(value: Any) -> str:
    """The mapping to write instead of a list of p, q and r."""
    if not is_list(value) or len(value) != 3 or not all(isinstance(w, int | float) for w in value):
        return ""
    p, q, r = value
    return f"; write {{p: {p:g}, q: {q:g}, r: {r:g}}}"


INITIAL = Key(
    Table(
        {
            "p": Key(Rate(), "angular velocity about x1", unit="1/time", default=None),
            "q": Key(Rate(), "angular velocity about x2", unit="1/time", default=None),
            "r": Key(Rate(), "angular velocity about x3", unit="1/time", default=None),
            "G": Key(
                Number(above=0),
                "|G|, instead of one of p, q, r, which is then the positive root",
                unit="moment of inertia / time",
                default=None,
            ),
        },
        answer=components_answer,
    ),
    "initial angular velocity in body axes",
)


def is_tensor(inertia: Any) -> bool:
    """Whether moments of inertia, as a case gives them, are a full tensor or have a row of one."""
    return inertia is not None and any(isinstance(row, tuple) for row in inertia)


def is_rounded(data: Mapping[str, Any]) -> bool:
    """Whether moments of inertia that no body has are a body's moments, rounded to decimals."""
    A = data.get("inertia")
    return isinstance(A, tuple) and not is_tensor(A) and excess_of_rounding(A) > 0


def complete(inertia: Sequence[float], initial: Mapping[str, Any]) -> tuple[float, ...]:
    """(p, q, r) from initial data in which |G| may stand for one of them, or x and y for all: p =
    sqrt(x), q = 0 and r = sqrt(y).

    Raises ValueError, with a sentence, if that cannot be done.
    """
    given = {name for name, value in initial.items() if value is not None}
    missing = [axis for axis in "pqr" if axis not in given]
    has_G, by_squares = "G" in given, given & {"x", "y"}
    wrong = {
        "give x and y alone, or p, q and r": by_squares and given != {"x", "y"},
        "with a full tensor of inertia G stands for no component: give all": (
            has_G and is_tensor(inertia)
        ),
        f"{' and '.join(missing)} missing: give p, q and r, or two of them and G": (
            missing and not (has_G or by_squares)
        ),
        "G stands for exactly one of p, q, r: leave that one out and give the other two": (
            has_G and len(missing) != 1
        ),
    }
    for sentence in (sentence for sentence, is_so in wrong.items() if is_so):
        raise ValueError(sentence)
    omega = [initial.get(axis) for axis in "pqr"]
    if by_squares:
        return sqrt(initial["x"]), 0.0, sqrt(initial["y"])
    if not missing:
        return tuple(omega)  # type: ignore[arg-type]
    with localcontext(prec=100):  # exact but for the root, so that the result is the nearest double
        pairs = [(Decimal(A), w) for A, w in zip(inertia, omega, strict=True)]
        square = sum((A * Decimal(w)) ** 2 for A, w in pairs if w is not None)
        remainder = Decimal(initial["G"]) ** 2 - square
        if remainder < 0:
            raise ValueError(
                f"|G| is at least {Decimal(square).sqrt():.6g} with the two given, "
                f"so G: {initial['G']:.6g} leaves no {missing[0]}"
            )
        roots = [float(remainder.sqrt() / A) if w is None else w for A, w in pairs]
    return tuple(roots)


def body_constants(inertia: Sequence[float]) -> dict[str, float]:
    """A1, A2, A3 and g by name, as every body-frame model has them."""
    return dict(zip(("A1", "A2", "A3"), inertia, strict=True)) | {"g": 1.0}


def range_mistake(size: float, smallest: float = SMALLEST_MOMENT) -> Iterator[str]:
    """The sentence about the size of a number that is not from `smallest` to 1/`smallest`."""
    if not smallest <= size <= 1 / smallest:
        yield f"{size:g} is out of range, {smallest:g} to {1 / smallest:g}: take other units"


@dataclass(frozen=True)
class BodyFrame(Model):
    """A model whose state begins with the angular velocity (p, q, r) in principal axes.

    Its constants are A1, A2, A3 and `g` = 1, the factor of the gyroscopic terms (of degree 2), and
    what a form adds.
    """

    inertia: tuple[float, float, float]
    initial: Mapping[str, float | None]

    state: ClassVar[tuple[str, ...]] = ("p", "q", "r")
    quaternion_factor = staticmethod(attrgetter("g"))
    starts_with_omega = True
    no_axis_reason = ""
    velocity = staticmethod(complete)
    variables = {"omega": Label(("time", "axis"), "angular velocity in body axes", "1/time")}

    @classmethod
    def output(cls, t: np.ndarray, y: np.ndarray, k: Any) -> dict[str, np.ndarray]:
        others = {name: y[:, i] for i, name in enumerate(cls.state) if name in cls.variables}
        return {"omega": np.stack(in_case_axes([*y[:, :3].T], k), axis=-1), **others}

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """What no body, or no start of a form, can be; its moments are from `smallest` to
        1/`smallest`."""
        A = data.get("inertia")
        if A is None:
            return
        sizes = [(("inertia", i), words) for i, x in enumerate(A) for words in range_mistake(x)]
        yield from sizes
        if one_exceeds_others(A) and not sizes:
            largest = A.index(max(A))
            yield (
                ("inertia", largest),
                f"no body has A{largest + 1} = {A[largest]:g} larger than the sum of the other two",
            )
        if "initial" in data:
            yield from mistake_of(("initial",), cls.velocity, A, data["initial"])

    @cached_property  # in a hundred decimal places, and asked for a dozen times
    def initial_velocity(self) -> tuple[float, ...]:
        """(p, q, r) at the start."""
        return self.velocity(self.inertia, self.initial)

    @property
    def start(self) -> tuple[float, ...]:
        return self.initial_velocity

    @property
    def omega_at_start(self) -> np.ndarray:
        """The angular velocity (3,) at the start along the principal axes."""
        return self.to_principal(np.array(self.initial_velocity))

    def attitude_at(self, start: np.ndarray) -> tuple[Any, ...]:
        G = self.momentum(self.from_principal(start[:3]))
        return quaternion_at_start(self.attitude, G.tolist())

    def initial_states(self, omega: np.ndarray) -> np.ndarray:
        """The states (m, n), with an attitude, for angular velocities (n, 3) at the start."""
        starts = self.starts(omega)
        return np.array([*map(self.with_attitude, starts.T)]).T if self.attitude else starts

    def starts(self, omega: np.ndarray) -> np.ndarray:
        """The states (m, n) for angular velocities (n, 3) at the start."""
        if len(self.state) == 3:
            return omega.T.copy()
        # A user's state may hold further variables that depend on omega: only its own `start` gives
        # them.
        others = dict.fromkeys(self.initial)
        each = (others | dict(zip("pqr", one, strict=True)) for one in omega.tolist())
        return np.array([replace(self, initial=initial).start for initial in each]).T

    @cached_property
    def constants(self) -> Constants:
        return body_constants(self.inertia)

    @property
    def frame(self) -> PrincipalAxes | None:
        """The principal axes of a body that is given by its full tensor of inertia."""
        return principal_axes(self.inertia) if is_tensor(self.inertia) else None

    @property
    def exact_moments(self) -> np.ndarray:
        """The principal moments of inertia (3,) in long double: the moments of a full tensor are no
        doubles, and a touch of the separatrix shows their rounding."""
        return self.frame.moments if self.frame else np.array(self.inertia, dtype=np.longdouble)

    @property
    def moments(self) -> np.ndarray:
        """The principal moments of inertia (3,)."""
        return self.exact_moments.astype(float)

    @property
    def principal_axes(self) -> np.ndarray | None:
        """The principal axes of inertia, row by row (3, 3), in the axes in which a case gives its
        data; None where they are these."""
        return self.frame.axes if self.frame else None

    def momentum(self, omega: np.ndarray) -> np.ndarray:
        """G (..., 3) of angular velocities (..., 3), both in the axes of the case."""
        return self.from_principal(self.moments * self.to_principal(omega))

    def velocities(self, G: np.ndarray) -> np.ndarray:
        """The inverse of `momentum`."""
        return self.from_principal(self.to_principal(G) / self.moments)

    def to_principal(self, vectors: np.ndarray) -> np.ndarray:
        axes = self.principal_axes
        return vectors if axes is None else turned(axes, vectors)

    def from_principal(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) along the principal axes in the axes of the case."""
        axes = self.principal_axes
        return vectors if axes is None else turned(axes.T, vectors)

    def enclosed(self, omega: np.ndarray, band: Any = 0.0) -> np.ndarray:
        """The label (n,) of angular velocities (n, 3) along the principal axes, as of
        `enclosed_axis`."""
        labels = enclosed_axis(self.exact_moments, omega, band)
        return np.full_like(labels, UNDETERMINED) if self.no_separatrix_reason else labels

    @np.errstate(all="ignore")  # a torque may have no value where a component is 0
    def tilt_growth(self, t: float) -> np.ndarray | None:
        """The rates (3,) at which a small tilt away from each body axis grows on the mean over a
        turn, at the start's speed and in the sense of its components; not a number for the middle
        axis, about which free rotation is unstable. None at rest, with a rotor, and under torques
        that are fixed in space or depend on the attitude.

        With w_i' the rate of the speed w, and J the Jacobian of the equations there, it is
        (J_jj + J_kk)/2 - w_i'/w to first order in the torques: a tilt turns, and the mean of its
        growth is half the trace. Torques across the axis have means of 0. Where the rate is
        positive the motion leaves the axis, though not always for the other one: it may end as an
        oscillation of constant shape on the same side.
        """
        model, omega, k = self.equations, self.omega_at_start, attributes(self.constants)
        others = {*self.fixed_in_space} & {*model.state} or self.no_separatrix_reason
        if others or (self.attitude and model.has_formulas) or not omega.any():
            return None
        speed = np.copysign(np.linalg.norm(omega), omega)
        y = np.repeat(np.array(self.initial_state)[:, None], 3, axis=1)
        y[:3] = np.diag(speed)
        own = np.diagonal(jacobian(model, k, t, y)[:3, :3]).T  # J_ii (i, axis)
        along = np.diag(stacked(model.rhs(t, [*y], k), y)[:3]) / speed
        growth = (own.sum(axis=0) - np.diag(own)) / 2 - along
        scale = np.maximum(np.abs(own).max(axis=0), np.abs(along))
        growth = np.where(np.abs(growth) <= 4 * np.finfo(float).eps * scale, 0, growth)
        growth = np.where(np.sort(self.moments)[1] == self.moments, np.nan, growth)
        return growth if np.isfinite(growth).any() else None

    @property
    def class_events(self) -> tuple[Event, ...]:
        moments = self.inertia if self.principal_axes is None else self.moments
        separatrix = Bound(separatrix_function, (inertia_order(moments),))
        return () if self.no_separatrix_reason else (Event("separatrix", separatrix),)


def turned(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) along axes, row by row (3, 3), in their own precision."""
    # Not by a product of matrices, whose last digits depend on the number of columns.
    rows = axes.astype(vectors.dtype).ravel()
    return np.stack(times([*rows], [*np.moveaxis(vectors, -1, 0)]), axis=-1)


def separatrix_function(order: tuple[int, int, int], t: Any, y: Sequence[Any], k: Any) -> Any:
    """D of bodies with one order of the moments, as an event."""
    outer, inner = separatrix_terms((k.A1, k.A2, k.A3), y[:3], order)
    return outer - inner
