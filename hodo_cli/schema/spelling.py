"""The spelling of messages about wrong values: how they name a value, the name that was meant by
another one, and how a number is written here that is written otherwise elsewhere."""

import math
import re
from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from functools import lru_cache
from typing import Any

DECIMAL_HINT = "; decimals are written with a point, as 1.5"

OTHER_WORDS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(
        ("lambda", "lamda", "lambda1", "lambdas", "friction"), ("damping", "resistance")
    ),
    "damping": ("resistance",),
    "resistance": ("damping",),
    **dict.fromkeys(("i", "j", "a", "a1", "moments"), ("inertia",)),
    **dict.fromkeys(("omega1", "omega_1", "omega_x", "w1", "wx"), ("p",)),
    **dict.fromkeys(("omega2", "omega_2", "omega_y", "w2", "wy"), ("q",)),
    **dict.fromkeys(("omega3", "omega_3", "omega_z", "w3", "wz"), ("r",)),
    **dict.fromkeys(("formula", "formulas", "equations", "rhs", "moment"), ("expression",)),
    **dict.fromkeys(("t", "t_end", "tmax", "t_max", "tspan", "t_span"), ("time", "end")),
    **dict.fromkeys(("stop", "t1", "final"), ("end",)),
    **dict.fromkeys(("n", "dt", "step", "points"), ("samples",)),
    **dict.fromkeys(("tolerance", "tolerances", "rtol", "atol"), ("tol", "tols")),
    **dict.fromkeys(("solver", "integrator"), ("method",)),
    **{"rho": ("density",), "nu": ("viscosity",), "eps": ("epsilon",), "m": ("torque",)},
}
"""Words, in lower case, that texts and other programs have for some keys."""


LEAST_LIKENESS = 0.65
"""The likeness of two words, of 1, from which on one may be meant by the other: a wrong letter in a
word of three leaves 0.67, and `readme`, with 0.62, is no spelling of `extreme`."""


LONGEST_SEARCHED = 40
"""Names in a list that is searched by likeness, which takes some 20 us a name; a mistaken file can
have a thousand names, each compared with another thousand."""


def nearest(name: str, valid: Collection[str]) -> str:
    """'; did you mean ...?', or nothing when no name is near."""
    spelling = near(name, valid)
    return "" if spelling is None else f"; did you mean {spelling!r}?"


def near(name: str, valid: Collection[str]) -> str | None:
    """The name that is nearest, or None if none is near: in a long list, one letter off."""
    folded = _folded(tuple(valid))
    name = name[:200].casefold()
    if word := other_word(name, valid):
        return word
    if len(folded) <= LONGEST_SEARCHED:
        # A short word such as `pi` is like each of its letters, and means none of them.
        words = [word for word in folded if len(word) > 1 or {*name} == {word}]
        close = get_close_matches(name, words, n=1, cutoff=LEAST_LIKENESS)
    else:
        names = _one_letter_less(tuple(folded))
        close = [names[spelling] for spelling in _shortened(name) if spelling in names]
    return folded[close[0]] if close else None


def other_word(name: str, valid: Collection[str]) -> str:
    """The valid name that a text or another program would call by this one, or ""."""
    return next((word for word in OTHER_WORDS.get(name.lower(), ()) if word in valid), "")


@lru_cache(maxsize=8)
def _folded(names: tuple[str, ...]) -> dict[str, str]:
    """Names by their spelling without capitals."""
    return {name.casefold(): name for name in names}


@lru_cache(maxsize=8)
def _one_letter_less(names: tuple[str, ...]) -> dict[str, str]:
    """Names by their own spelling, and by each spelling that lacks one of their letters."""
    return {spelling: name for name in names for spelling in _shortened(name)}


def _shortened(name: str) -> list[str]:
    return [name, *(name[:i] + name[i + 1 :] for i in range(len(name)))]


def unknown(what: str, name: str, valid: Iterable[str]) -> str:
    """The sentence about a name that is not among the `valid` ones, with the nearest spelling."""
    names = list(valid)
    # A line of a terminal or two; beyond that a list hides the mistake.
    listed = f" (valid: {', '.join(names)})" if 0 < len(names) <= 40 else ""
    hint = DECIMAL_HINT if name.isdecimal() else nearest(name, names)
    if advice := colon_hint(name):
        hint = f"; {advice}"
    return f"unknown {what}{hint}{listed}"


def colon_hint(text: str) -> str:
    """How to write a key and its value that YAML reads as one word, {p:0.8}, else nothing."""
    colon = re.fullmatch(r"(\w+):(\S+)", text.strip())
    return f"put a space after the colon: {colon[1]}: {colon[2]}" if colon else ""


def shown(value: Any) -> str:
    """A value as a message names it, in YAML's words and shortened."""
    match value:
        case None:
            return "an empty value"
        case bool():
            return str(value).lower()
        case str():
            return repr(value if len(value) <= 60 else value[:57] + "...")
        # A message of 300 digits hides what it says.
        case int() if abs(value) >= 10**30:
            return "a huge integer"
        case int() | float():
            return repr(value)
        case list() | tuple():
            return f"a list of {len(value)}"
        case Mapping():
            return "a mapping" if value else "an empty mapping"
    return f"an object of type {type(value).__name__}"


IN_DEGREES = re.compile(r"([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?) ?(?:deg|°)", re.ASCII)
OTHER_SPELLING = re.compile(r"[-+]?\d+(?:_\d+)*(?:\.\d*|,\d+)?(?:[eEdD][-+]?\d+)?", re.ASCII)
UNITS = r"(?:1/s|k?g|m|s|ms|min|h|rad|N|Hz)\b.*"
WITH_UNIT = re.compile(rf"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)? ?{UNITS}", re.ASCII)
THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}(?!\d)", re.ASCII)
"""How numbers are written elsewhere, some with a unit; a comma before three digits may separate
thousands."""


def number_advice(value: Any) -> str:
    """How to write a number that was given in degrees, with another unit, in quotes, with a decimal
    comma, with underscores or with the exponent of Fortran; an empty string where it may mean
    another number."""
    text = value if isinstance(value, str) else ""
    if text == "pi":
        return f"; write {math.pi!r}"
    if degrees := IN_DEGREES.fullmatch(text):
        return f"; write {math.radians(float(degrees[1])):.17g}, in radians"
    if WITH_UNIT.fullmatch(text):
        return "; a number stands alone: `unit` of time and `inertia_unit` name units"
    if not OTHER_SPELLING.fullmatch(text) or THOUSANDS.match(text):
        return ""
    number = re.sub("[dD]", "e", text.replace("_", "").replace(",", "."))
    return f"; write {number}" if number != text else "; leave out the quotes"
