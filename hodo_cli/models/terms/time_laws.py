"""Coefficients that change with time: polynomials in the slow time of a top, and expressions in t
and in constants that the case names.

A model holds such a coefficient among its constants. For a polynomial the constant NAME is the
tuple of its coefficients. For an expression NAME is a factor, which carries the unit, and NAME_law
is the text. The constants of the case are then constants of the model too, so that one compilation
serves all their values.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic import evaluate, horner, isfinite
from ...schema.expression import FUNCTIONS, LONGEST, Expression, names_in, parse_expression
from ...schema.kinds import (
    Each,
    Either,
    Key,
    KeyPath,
    ListOf,
    Mistake,
    Number,
    Rule,
    Wrong,
    WrongKey,
    check,
    check_parts,
    expected,
    is_list,
    leaves,
    within,
    words,
)

EPOCH, EPOCH_NAME = "epoch", "time.epoch"
"""The name, among the constants of a model, of the time from which t counts in expressions and
polynomials; and its name among the constants of a case, which no expression can contain."""

MOST_COEFFICIENTS = 20
"""The largest number of coefficients of a polynomial. A Taylor step of the lowest order from t = 0
would miss higher powers of the time, and few fits in powers of t have that many digits."""

VELOCITIES = ("p", "q", "r")
SPACE_COMPONENTS = ("y1", "y2", "y3", "z1", "z2", "z3")
"""The names in expressions of the components along body axes of the space axes y and z."""

CONSTANT_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}")
TAKEN_NAMES = {*VELOCITIES, "t", *SPACE_COMPONENTS, "e", "pi", *FUNCTIONS}
"""The names that a constant may not have, because they mean something else in an expression."""

CaseConstants = Mapping[str, Any] | Iterable[tuple[str, Any]]
"""The constants that a case names, as a mapping or as pairs of a name and a number."""


class Formula(NamedTuple):
    """A coefficient that is an expression in t and constants, times a factor."""

    factor: Any
    text: str


def as_expression(value: Any) -> str:
    """Advice: the expression to write instead of a polynomial as a list of coefficients, or of a
    mapping with `law`, which earlier versions took. Empty for other values."""
    match value:
        case {"law": "exponential", "value": a, "rate": rate}:
            text = f"{a}*exp(-{rate}*t)"
        case {"law": "power", "value": a, "rate": rate, "exponent": n}:
            is_whole = isinstance(n, int | float) and not n % 1
            base = f"(1 + {rate}*t)"
            text = f"{a}*{base}**{n:.0f}" if is_whole else f"{a}*exp({n}*log{base})"
        case {"law": "polynomial", "coefficients": [*numbers]} | [*numbers] if numbers:
            powers = ["", "*t", *(f"*t**{i}" for i in range(2, len(numbers)))]
            terms = [f"{a}{power}" for a, power in zip(numbers, powers, strict=False) if a != 0]
            text = " + ".join(terms) or "0"
        case _:
            return ""
    text = text.replace("--", "").replace("+ -", "- ")
    return f'; write "{text}"' if "{" not in text and len(text) < 200 else ""


POLYNOMIAL = ListOf(
    Number(),
    title=f"a polynomial in tau: [a0, a1, ...], {MOST_COEFFICIENTS} at most",
    maxItems=MOST_COEFFICIENTS,
)


def coefficient_kind(*others: Rule, repeat: int = 0) -> Rule:
    """The rule of one coefficient: a number, an expression in t, or a list by one of the `others`.
    With `repeat` a number becomes a tuple that holds it `repeat` times."""
    text = {"type": "string", "maxLength": LONGEST}
    title = ", or ".join(["a number", *map(words, others), "an expression in t"])

    def coefficient(value: Any) -> Any:
        """The coefficient as the model takes it: a number, a checked list, or the text of an
        expression. Raises Wrong for other kinds of values."""
        if others and is_list(value):
            return check(Either(*others), value)
        resolved = parse_expression(value) if isinstance(value, str) else value
        if isinstance(value, str) and not isinstance(resolved, float):
            return value  # names occur in it, whose values are not known here
        if not isinstance(resolved, float | int):
            raise expected(rule, value)
        number = check(Number(), resolved)
        return (number,) * repeat if repeat else number

    rule = Either(Number(), *others, text, title=title, whole=coefficient, answer=as_expression)
    return rule


def coefficients_kind() -> Rule:
    """The rule of three coefficients, one for each axis, or of one for all axes."""
    title = "3 numbers or expressions in t, or one for all"
    of_each = ListOf(coefficient_kind(), length=3, title=title)
    return Either(of_each, coefficient_kind(), repeat=3, title=title, answer=as_expression)


def _named(values: Mapping[str, float]) -> Mapping[str, float]:
    """The constants of a case, checked. Raises Wrong for names that a constant may not have."""
    taken = "means something else in an expression"
    rule = "the name of a constant is a letter, then letters, digits and _, 40 in all"
    mistakes: list[Mistake] = [
        ((WrongKey(name),), taken if name in TAKEN_NAMES else rule)
        for name in values
        if name in TAKEN_NAMES or not CONSTANT_NAME.fullmatch(name)
    ]
    if mistakes:
        raise Wrong(*mistakes)
    return values


CONSTANTS = Key(
    Each(Number(), "names to numbers", least=0, convert=_named),
    "numbers that expressions may name; merged with those of `defaults` name by name, and swept as "
    "`constants.NAME`",
    default=None,
)


def expressions_of(value: Any) -> Iterator[tuple[KeyPath, str]]:
    """The expressions in the data of a case, each with its path."""
    return ((path, x) for path, x in leaves(value) if isinstance(x, str))


def name_mistakes(
    expressions: Iterable[tuple[KeyPath, str]],
    constants: Mapping[str, float],
    has_attitude: bool,
) -> Iterator[Mistake]:
    """The mistakes of expressions with a name that is no variable or constant of their case."""
    for path, text in expressions:
        is_torque = path[0] == "expression"
        own, space = (VELOCITIES, SPACE_COMPONENTS) if is_torque else ((), ())
        known = (*own, "t", *(space if has_attitude else ()), *constants)
        _, mistakes = check_parts([(path[-1], Expression(known, ""), text)])
        needed = names_in(parse_expression(text)) & {*space} - {*known}
        if needed:
            yield path, f"{min(needed)} needs attitude: yes"
        else:
            yield from within(path[:-1], mistakes)


def is_law(coefficient: Any) -> bool:
    """Whether a coefficient changes with time."""
    return isinstance(coefficient, tuple | Formula)


def resolved(coefficient: Any, constants: CaseConstants) -> Any:
    """A coefficient of a case as a number, a polynomial or a Formula. An expression without t
    becomes the number that is its value."""
    if not isinstance(coefficient, str):
        return coefficient
    tree = parse_expression(coefficient)
    return Formula(1.0, coefficient) if "t" in names_in(tree) else evaluate(tree, dict(constants))


def scaled(coefficient: Any, factor: Any) -> Any:
    """A coefficient, which is a number or a Formula, times a factor."""
    if isinstance(coefficient, Formula):
        return coefficient._replace(factor=factor * coefficient.factor)
    return factor * coefficient


def law_constants(coefficients: Mapping[str, Any]) -> dict[str, Any]:
    """The constants of a model that hold these coefficients, which are given by name: NAME and, for
    an expression, NAME_law."""
    formulas = {name: x for name, x in coefficients.items() if isinstance(x, Formula)}
    texts = {f"{name}_law": x.text for name, x in formulas.items()}
    return {**coefficients} | {name: x.factor for name, x in formulas.items()} | texts


def named_constants(constants: CaseConstants) -> dict[str, Any]:
    """The constants of a model that hold the constants of its case: their numbers, their names, and
    the epoch."""
    named = dict(constants)
    epoch = {EPOCH: named.pop(EPOCH_NAME)} if EPOCH_NAME in named else {}
    if not named:
        return epoch
    return epoch | {"constants": (*named.values(),), "constant_names": " ".join(named)}


def since_epoch(k: Any, t: Any) -> Any:
    """The time t less the epoch, as expressions and polynomials count it."""
    return t - getattr(k, EPOCH) if hasattr(k, EPOCH) else t


def values_of_names(k: Any, t: Any) -> dict[str, Any]:
    """The values of t and of the constants of a case by name, at the case's time t."""
    names = getattr(k, "constant_names", "").split()
    constants = zip(names, getattr(k, "constants", ()), strict=True)
    return {"t": since_epoch(k, t), **dict(constants)}


def coefficient_at(k: Any, name: str, t: Any) -> Any:
    """The value at the time t of the coefficient `name`, from the constants k of a model."""
    value, text = getattr(k, name), getattr(k, f"{name}_law", None)
    if text is not None:
        return value * evaluate(parse_expression(text), values_of_names(k, t))
    return horner(value, since_epoch(k, t)) if isinstance(value, tuple) else value


def slope_at(k: Any, name: str, t: Any) -> Any:
    """The time derivative at the time t of the coefficient `name`, which is a polynomial."""
    terms = [i * c for i, c in enumerate(getattr(k, name))][1:]
    return horner(terms, since_epoch(k, t)) if terms else 0 * t


def least_value(polynomial: Sequence[float], start: float, end: float) -> float:
    """The smallest value of a polynomial from one time to another."""
    start, end = sorted((start, end))
    turns = np.polynomial.Polynomial(polynomial).deriv().roots().real.tolist()
    return float(min(horner(polynomial, t) for t in (start, *turns, end) if start <= t <= end))


def first_negative(coefficient: Any, times: np.ndarray, constants: CaseConstants) -> float | None:
    """The first of the times (n,) at which a coefficient is negative; None if there is none."""
    k = SimpleNamespace(**law_constants({"c": coefficient}), **named_constants(constants))
    with np.errstate(all="ignore"):
        is_negative = np.broadcast_to(coefficient_at(k, "c", times) < 0, times.shape)
    return float(times[is_negative.argmax()]) if is_negative.any() else None


def value_mistakes(
    expressions: Iterable[tuple[KeyPath, str]],
    variables: Mapping[str, Any],
    where: str = "at the start of the motion",
) -> Iterator[Mistake]:
    """The mistakes of expressions that have no finite value for these values of their variables."""
    for path, text in expressions:
        tree = parse_expression(text)
        # An expression is passed over where a variable is unknown, as a component that G replaces.
        if names_in(tree) <= variables.keys() and not _has_value(tree, variables):
            yield path, f"has no finite value {where}"


def _has_value(tree: Any, variables: Mapping[str, Any]) -> bool:
    """Whether an expression has a finite value for these values of its variables."""
    try:
        return isfinite(evaluate(tree, variables))
    except (ValueError, ArithmeticError):
        return False
