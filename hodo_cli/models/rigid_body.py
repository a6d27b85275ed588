"""A rigid body with the principal moments A1, A2, A3, and the axis that G = A omega encircles.

    D = G^2 - 2 T A_m = A_l (A_l - A_m) w_l^2 - A_s (A_m - A_s) w_s^2

l, m, s are the axes of largest, middle and smallest inertia, w_i the components of omega, T is the
kinetic energy. Seen from the body, G goes round axis l where D > 0, and round axis s where D < 0.
D = 0 is the separatrix.

This module also has the principal axes of a full tensor, the keys `inertia` and `initial`, and the
base class of models whose state begins with omega.
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
    Constants,
    Event,
    HashablePartial,
    Label,
    Model,
    attributes,
    jacobian,
    mistake_of,
    stacked,
)
from .euler import in_case_axes, matvec

UNDETERMINED, SEPARATRIX = -1, 0
LABELS = {-1: "undetermined", 0: "separatrix", 1: "x1", 2: "x2", 3: "x3"}


def inertia_order(A: Any) -> tuple[int, int, int]:
    """The positions (0 to 2) of the largest, middle and smallest moment of inertia. Equal moments
    keep the order given."""
    # `sorted` keeps the order of equal moments.
    largest, middle, smallest = sorted(range(3), key=lambda i: -A[i])
    return largest, middle, smallest


def separatrix_terms(A: Any, omega: Any, order: tuple[int, int, int]) -> tuple[Any, Any]:
    """The two non-negative terms A_l (A_l - A_m) w_l^2 and A_s (A_m - A_s) w_s^2 of D.

    l, m, s = `order` are the positions of the largest, middle and smallest moment of A. Near the
    separatrix G^2 - 2 T A_m loses every digit by cancellation. The difference of these two terms
    loses no more digits than errors of the data do.

    Source: Rachinskaya, eqs (7)-(8), solved for D.
    """
    l, m, s = order
    outer, inner = omega[l] * omega[l], omega[s] * omega[s]
    return A[l] * (A[l] - A[m]) * outer, A[s] * (A[m] - A[s]) * inner


def separatrix_roots(A: Any, order: tuple[int, int, int]) -> tuple[Any, Any]:
    """The factors a and b of D = (a w_l)^2 - (b w_s)^2, with l, m, s = `order`."""
    l, m, s = order
    return np.sqrt(A[l] * (A[l] - A[m])), np.sqrt(A[s] * (A[m] - A[s]))


def separatrix_forms(A: Any, omega: Any, order: tuple[int, int, int]) -> Any:
    """The linear forms a w_l - b w_s and a w_l + b w_s, whose product is D. a and b are those of
    `separatrix_roots`."""
    a, b = separatrix_roots(A, order)
    outer, inner = a * omega[order[0]], b * omega[order[2]]
    return np.array([outer - inner, outer + inner])


def scaled_separatrix(A: Any, w: Any, order: tuple[int, int, int]) -> tuple[Any, Any, Any]:
    """D, the sum of its two terms, and an upper bound of this sum, for omega (3, ...) scaled to a
    size near 1."""
    # Scaled, because the squares of 1e-170 would be 0; by a power of two, which changes no digit.
    # Contiguous rows, because numpy is slow along an axis of three neighbours in memory.
    w = np.ascontiguousarray(np.ldexp(w, -np.frexp(np.abs(w).max(axis=0))[1]))
    a, b = separatrix_roots(A, order)
    minus, plus = separatrix_forms(A, w, order)
    bound = (a * a + b * b) * (w * w).sum(axis=0)
    return minus * plus, (minus * minus + plus * plus) / 2, bound


def share_of(total: Any, part: Any, of_nothing: float = 0.0) -> np.ndarray:
    """part/total, or `of_nothing` where the total is 0."""
    return np.asarray(np.divide(part, total, out=np.full_like(total, of_nothing), where=total > 0))


def separation(A: Any, omega: Any, order: tuple[int, int, int]) -> np.ndarray:
    """|D| over the sum of its two terms (n,), for omega (3, n). It is infinite for a body with
    three equal moments, which has no separatrix."""
    D, total, _ = scaled_separatrix(A, omega, order)
    return np.where(A[order[0]] == A[order[2]], np.inf, share_of(total, np.abs(D)))


def margin(A: Any, omega: np.ndarray, order: tuple[int, int, int]) -> np.ndarray:
    """The distance (...) of omega (..., 3) from the separatrix, relative to |omega|. An error of
    omega of about this size may change its side. It is positive where the axis of largest inertia
    is enclosed.

    It is D/sqrt(total bound), where total is the sum of the two terms of D, and
    bound = (a^2 + b^2) |omega|^2. Up to a factor between 1 and sqrt 2 its size is that of the
    smaller linear form of D over sqrt(bound).
    """
    A = np.asarray(A, dtype=omega.dtype)
    D, total, bound = scaled_separatrix(A, np.moveaxis(omega, -1, 0), order)
    # Two roots, because the product, with moments to the fourth power, may overflow.
    return share_of(np.sqrt(bound) * np.sqrt(total), D).astype(float)


def near_middle_axis(A: Any, omega: np.ndarray) -> np.ndarray:
    """The sum of the two terms of D at omega (..., 3) over its bound (a^2 + b^2) |omega|^2, with a
    and b of `separatrix_roots`. It is 1 for a sphere and at rest, where both are 0.

    The root of this number is roughly the angle between omega and the middle axis.
    """
    _, total, bound = scaled_separatrix(A, np.moveaxis(omega, -1, 0), inertia_order(A))
    return share_of(bound, total, of_nothing=1.0)


@np.errstate(invalid="ignore")  # an infinite omega is undetermined anyway
def enclosed_axis(A: Any, omega: np.ndarray, band: Any) -> np.ndarray:
    """The label (...) of the axis that the hodograph of G encloses, for omega (..., 3) of any size,
    as int8.

    1, 2, 3 name the body axes. 0 is the separatrix of a triaxial body, where |margin| is at most
    `band`, a number or one for each omega. -1 is undetermined: there is no rotation, or G goes
    round no axis, as in a steady rotation of a symmetric or spherical body.
    """
    order, w = inertia_order(A), np.moveaxis(omega, -1, 0)
    largest, middle, smallest = order
    signed = margin(A, omega, order)
    labels = np.where(signed > 0, largest + 1, smallest + 1)
    # Both terms of D are 0 in steady rotation of a symmetric body: G goes round no axis.
    turning = signed != 0
    if A[largest] > A[middle] > A[smallest]:
        labels, turning = np.where(np.abs(signed) <= band, SEPARATRIX, labels), (w != 0).any(axis=0)
    known = turning & np.isfinite(w).all(axis=0)
    return np.where(known, labels, UNDETERMINED).astype(np.int8)


def separatrix_circles(A: np.ndarray) -> list[np.ndarray]:
    """The two great circles of the directions of G with D = 0, each (721, 3). A body with two equal
    moments has none."""
    largest, middle, smallest = inertia_order(A)
    if A[largest] == A[middle] or A[middle] == A[smallest]:
        return []
    # D = G_l^2 (1/A_m - 1/A_l) - G_s^2 (1/A_s - 1/A_m), up to a factor.
    ratio = math.sqrt((1 / A[smallest] - 1 / A[middle]) / (1 / A[middle] - 1 / A[largest]))
    turn, (x, y, z) = np.linspace(0, 2 * np.pi, 721)[:, None], np.eye(3)[[*inertia_order(A)]]
    outward = [(sign * ratio * x + z) / math.hypot(ratio, 1) for sign in (1, -1)]
    return [np.cos(turn) * direction + np.sin(turn) * y for direction in outward]


def slope(A: Sequence[float] | np.ndarray) -> float:
    """K = A_s (A_m - A_s) / (A_l (A_l - A_m)) of the separatrix w_l^2 = K w_s^2. It is 0 where the
    smaller two moments are equal, and inf where the larger two are.

    Raises HodoError for a body with three equal moments, which has no separatrix.
    Source: Rachinskaya, eqs (7)-(8).
    """
    outer, inner = separatrix_terms(A, (1.0, 1.0, 1.0), inertia_order(A))
    if not (outer or inner):
        raise HodoError("a body with three equal moments of inertia has no quadrants")
    return inner / outer if outer else math.inf


# The principal axes of a body whose inertia is given as a full tensor

ASYMMETRY = 1e-12
"""The relative difference up to which two entries of a symmetric tensor differ by rounding."""


class PrincipalAxes(NamedTuple):
    """The principal moments (3,) of a tensor, and its principal axes (3, 3): each row is a unit
    vector along the axes of the tensor. They form a right-handed system.

    All are long doubles. Rounded to doubles they would belong to another tensor, and a motion in
    extended precision would have the error of a motion in doubles.
    """

    moments: np.ndarray
    axes: np.ndarray


def violates_triangle_inequality(moments: Sequence[Any] | np.ndarray) -> bool:
    """Whether one of three moments is larger than the sum of the others; no body has such moments.
    Equality, which a flat disc has, is allowed up to rounding."""
    return bool(2 * max(moments) > sum(moments) * (1 + 4 * np.finfo(float).eps))


def excess_of_rounding(moments: Sequence[float]) -> float:
    """The excess of the largest of three moments over the sum of the others, if it is positive and
    so small that rounding to decimals explains it: at most one unit of the last decimal. Else 0."""
    *others, largest = sorted(moments)
    excess = largest - sum(others)
    return excess if 0 < excess <= last_digit(largest) else 0.0


def last_digit(x: float) -> float:
    """One unit of the last digit of the shortest decimal of x, plus rounding. At most a hundredth
    of x, because 0.1 is no rounding of 0.2."""
    unit = 10.0 ** int(Decimal(repr(float(x))).as_tuple().exponent) * (1 + 1e-9)
    return min(unit, abs(x) / 100)


def symmetric(tensor: Sequence[Any]) -> Sequence[Any]:
    """A tensor made symmetric where rounding explains the difference: two transposed entries that
    differ by at most one unit of the last decimal both become their mean. Three moments are
    returned as they are."""
    if not all(isinstance(row, tuple) for row in tensor):
        return tensor
    rows = [list(row) for row in tensor]
    for i, j in combinations(range(3), 2):
        a, b = rows[i][j], rows[j][i]
        if a != b and abs(a - b) <= last_digit(max(a, b, key=abs)):
            rows[i][j] = rows[j][i] = (a + b) / 2
    return tuple(map(tuple, rows))


@lru_cache(maxsize=256)
def principal_axes(tensor: tuple[tuple[float, ...], ...]) -> PrincipalAxes:
    """The principal moments and axes of a tensor of inertia. Each principal axis has the number of
    the given axis to which it is near. A diagonal tensor has the given axes.

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
    if violates_triangle_inequality(moments):
        raise ValueError(
            f"no body has principal moments of {named}: one exceeds the sum of the other two"
        )
    return PrincipalAxes(moments, axes)


SWEEPS = 8
"""The number of sweeps of Jacobi's rotations. They converge quadratically: for random tensors the
sixth sweep changed nothing."""


def diagonalized(J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The principal moments (3,) and axes (3, 3) of a tensor of long doubles, by Jacobi's
    rotations. Order and signs are those that bring the axes nearest to the given ones."""
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


# The keys and the base class of models whose state begins with omega

SMALLEST_MOMENT = 1e-100
"""The smallest moment of inertia; the largest one is 1/SMALLEST_MOMENT. Cubes of both are
doubles."""

INERTIA = Key(
    vector(3, above=0)
    | {"answer": lambda _: "; a full tensor is a key of other models, as torques"},
    "principal moments of inertia A1, A2, A3",
    unit="moment of inertia",
)
"""Three moments in any order. `BodyFrame.check` checks their range and the triangle inequality."""


def components_answer(value: Any) -> str:
    """The mapping to write instead of a list [p, q, r]; empty for other values."""
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
    """Whether the key `inertia` of a case holds rows of a full tensor, and not three moments."""
    return inertia is not None and any(isinstance(row, tuple) for row in inertia)


def is_rounded(data: Mapping[str, Any]) -> bool:
    """Whether three moments violate the triangle inequality by no more than rounding to decimals
    does."""
    A = data.get("inertia")
    return isinstance(A, tuple) and not is_tensor(A) and excess_of_rounding(A) > 0


def complete(inertia: Sequence[float], initial: Mapping[str, Any]) -> tuple[float, ...]:
    """(p, q, r) from the initial data. |G| may be given instead of one component, which is then the
    positive root; or x and y instead of all, with p = sqrt(x), q = 0 and r = sqrt(y).

    Raises ValueError, with a sentence, where the data do not determine p, q and r.
    """
    given = {name for name, value in initial.items() if value is not None}
    missing = [axis for axis in "pqr" if axis not in given]
    has_G, by_squares = "G" in given, given & {"x", "y"}
    wrong = {
        "give x and y alone, or p, q and r": by_squares and given != {"x", "y"},
        "with a full tensor of inertia G replaces no component: give p, q and r": (
            has_G and is_tensor(inertia)
        ),
        f"{' and '.join(missing)} missing: give p, q and r, or two of them and G": (
            missing and not (has_G or by_squares)
        ),
        "G stands for exactly one of p, q, r: leave that one out and give the other two": (
            has_G and len(missing) != 1
        ),
    }
    if sentences := [sentence for sentence, is_so in wrong.items() if is_so]:
        raise ValueError(sentences[0])
    omega = [initial.get(axis) for axis in "pqr"]
    if by_squares:
        return sqrt(initial["x"]), 0.0, sqrt(initial["y"])
    if not missing:
        return tuple(omega)  # type: ignore[arg-type]
    with localcontext(prec=100):  # exact up to the root, so that the root is the nearest double
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
    """The constants A1, A2, A3 and g = 1, the factor of the gyroscopic terms, by name."""
    return dict(zip(("A1", "A2", "A3"), inertia, strict=True)) | {"g": 1.0}


def range_mistake(size: float, smallest: float = SMALLEST_MOMENT) -> Iterator[str]:
    """A sentence on a number that is below `smallest` or above 1/`smallest`; none on others."""
    if not smallest <= size <= 1 / smallest:
        yield f"{size:g} is out of range, {smallest:g} to {1 / smallest:g}: take other units"


@dataclass(frozen=True)
class BodyFrame(Model):
    """A model whose state begins with the angular velocity (p, q, r) along the principal axes.

    Its constants begin with A1, A2, A3 and `g` = 1, the factor of the gyroscopic terms.
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
        """omega along the axes of the case, and the stored ones of the further variables."""
        others = {name: y[:, i] for i, name in enumerate(cls.state) if name in cls.variables}
        return {"omega": np.stack(in_case_axes([*y[:, :3].T], k), axis=-1), **others}

    @classmethod
    def check(cls, data: Mapping[str, Any]) -> Iterator[Mistake]:
        """The mistakes in three moments that no body has or that are out of range, and in a start
        that does not determine omega."""
        A = data.get("inertia")
        if A is None:
            return
        sizes = [(("inertia", i), words) for i, x in enumerate(A) for words in range_mistake(x)]
        yield from sizes
        if violates_triangle_inequality(A) and not sizes:
            largest = A.index(max(A))
            yield (
                ("inertia", largest),
                f"no body has A{largest + 1} = {A[largest]:g} larger than the sum of the other two",
            )
        if "initial" in data:
            yield from mistake_of(("initial",), cls.velocity, A, data["initial"])

    @cached_property  # because it is used a dozen times, and computed in a hundred decimal places
    def initial_velocity(self) -> tuple[float, ...]:
        """(p, q, r) at the start along the axes of the case."""
        return self.velocity(self.inertia, self.initial)

    @property
    def start(self) -> tuple[float, ...]:
        return self.initial_velocity

    @property
    def omega_at_start(self) -> np.ndarray:
        """The angular velocity (3,) at the start along the principal axes."""
        return self.to_principal(np.array(self.initial_velocity))

    def attitude_at(self, start: np.ndarray) -> tuple[Any, ...]:
        """The quaternion (4,) that the key `attitude` and G at the start determine."""
        G = self.momentum(self.from_principal(start[:3]))
        return quaternion_at_start(self.attitude, G.tolist())

    def initial_states(self, omega: np.ndarray) -> np.ndarray:
        """The initial states (m, n), attitudes included, for angular velocities (n, 3) there."""
        starts = self.starts(omega)
        return np.array([*map(self.with_attitude, starts.T)]).T if self.attitude else starts

    def starts(self, omega: np.ndarray) -> np.ndarray:
        """The initial states (m, n), without attitudes, for angular velocities (n, 3) there."""
        if len(self.state) == 3:
            return omega.T.copy()
        # The state of a user's model may hold further variables that depend on omega. Only `start`
        # of this model gives them.
        others = dict.fromkeys(self.initial)
        each = (others | dict(zip("pqr", one, strict=True)) for one in omega.tolist())
        return np.array([replace(self, initial=initial).start for initial in each]).T

    @cached_property
    def constants(self) -> Constants:
        return body_constants(self.inertia)

    @property
    def frame(self) -> PrincipalAxes | None:
        """The principal axes and moments of a body given by a full tensor of inertia; else None."""
        return principal_axes(self.inertia) if is_tensor(self.inertia) else None

    @property
    def exact_moments(self) -> np.ndarray:
        """The principal moments of inertia (3,) in long double. The moments of a full tensor are no
        doubles, and a motion that touches the separatrix shows their rounding."""
        return self.frame.moments if self.frame else np.array(self.inertia, dtype=np.longdouble)

    @property
    def moments(self) -> np.ndarray:
        """The principal moments of inertia (3,), as doubles."""
        return self.exact_moments.astype(float)

    @property
    def principal_axes(self) -> np.ndarray | None:
        """The principal axes of inertia (3, 3), row by row, along the axes of the case; None where
        the case is given along the principal axes."""
        return self.frame.axes if self.frame else None

    def momentum(self, omega: np.ndarray) -> np.ndarray:
        """G (..., 3) for angular velocities (..., 3), both along the axes of the case."""
        return self.from_principal(self.moments * self.to_principal(omega))

    def velocities(self, G: np.ndarray) -> np.ndarray:
        """The angular velocities (..., 3) for given G (..., 3), both along the axes of the case."""
        return self.from_principal(self.to_principal(G) / self.moments)

    def to_principal(self, vectors: np.ndarray) -> np.ndarray:
        axes = self.principal_axes
        return vectors if axes is None else turned(axes, vectors)

    def from_principal(self, vectors: np.ndarray) -> np.ndarray:
        """The components along the axes of the case of vectors (..., 3) that are given along the
        principal axes."""
        axes = self.principal_axes
        return vectors if axes is None else turned(axes.T, vectors)

    def enclosed(self, omega: np.ndarray, band: Any = 0.0) -> np.ndarray:
        """The labels (n,) of `enclosed_axis` for angular velocities (n, 3) along the principal
        axes; undetermined where D does not show the enclosed axis."""
        labels = enclosed_axis(self.exact_moments, omega, band)
        return np.full_like(labels, UNDETERMINED) if self.no_separatrix_reason else labels

    @np.errstate(all="ignore")  # a torque may have no value where a component is 0
    def tilt_growth(self, t: float) -> np.ndarray | None:
        """The rates (3,) at which a small tilt away from steady rotation about each body axis i
        grows, on the mean over a turn. The rotation has the speed of the start, and the sense of
        its component i.

        For the rotation w about axis i let w' be the rate of its speed, and J the Jacobian of the
        equations. To first order in the torques the rate is (J_jj + J_kk)/2 - w'/w: a tilt turns
        about the axis, and the mean of its growth is half the trace. Torques across the axis have
        means of 0. Where the rate is positive the motion leaves the axis, but it need not reach
        the other one: it may end as an oscillation of constant shape on the same side.

        The rate is nan for the middle axis, about which free rotation is unstable. The result is
        None at rest, with a rotor, and under torques that are fixed in space or depend on the
        attitude.
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
        """The crossings D = 0, where D shows the enclosed axis."""
        moments = self.inertia if self.principal_axes is None else self.moments
        separatrix = HashablePartial(separatrix_function, (inertia_order(moments),))
        return () if self.no_separatrix_reason else (Event("separatrix", separatrix),)


def turned(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """The components along `axes` (3, 3), given row by row, of vectors (..., 3), in the precision
    of the vectors."""
    # numpy's product of matrices is not used: its last digits depend on the number of columns.
    rows = axes.astype(vectors.dtype).ravel()
    return np.stack(matvec([*rows], [*np.moveaxis(vectors, -1, 0)]), axis=-1)


def separatrix_function(order: tuple[int, int, int], t: Any, y: Sequence[Any], k: Any) -> Any:
    """D as the function of an event, for bodies whose moments have this order."""
    outer, inner = separatrix_terms((k.A1, k.A2, k.A3), y[:3], order)
    return outer - inner
