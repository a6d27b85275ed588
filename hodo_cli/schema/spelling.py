"""How messages name wrong values, and guess the name that was meant."""

import re
from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Any

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
    **dict.fromkeys(("parameters", "params", "coefficients"), ("constants",)),
    **dict.fromkeys(("t", "t_end", "tmax", "t_max", "tspan", "t_span"), ("time", "end")),
    **dict.fromkeys(("stop", "t1", "final"), ("end",)),
    **dict.fromkeys(("n", "dt", "step", "steps", "points"), ("samples",)),
    **dict.fromkeys(("t0", "reference"), ("epoch", "start")),
    **dict.fromkeys(("tolerance", "tolerances", "rtol", "atol"), ("tol", "tols")),
    **dict.fromkeys(("solver", "integrator"), ("method",)),
    **dict.fromkeys(("energy", "kinetic_energy"), ("T", "H")),
    "momentum": ("G",),
    "polhode": ("hodograph",),
    "timeseries": ("series",),
    **{"rho": ("density",), "nu": ("viscosity",), "eps": ("epsilon",), "m": ("torque",)},
}
"""Words, in lower case, that texts and other programs use for some names of hodo."""

WORDS_FOR_OMEGA = ("omega", "w", "velocity")
"""Words for the angular velocity as a whole."""

DECIMAL_HINT = "; decimals are written with a point, as 1.5"

NUMBERS_ELSEWHERE = {
    r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?": "; leave out the quotes",
    r"[-+]?\d+,\d+([eE][-+]?\d+)?": DECIMAL_HINT,
    r"[-+]?[\d.,]+[dD][-+]?\d+": "; an exponent is written with e, as 1e-3",
    r"[-+]?\d+(_\d+)+(\.\d*)?": "; digits stand together, without _",
    r"[-+]?[\d.]+ ?(deg|°)": "; only angles and angular velocities are given in degrees",
    r"[-+]?[\d.]+ ?[A-Za-z].*": "; a number stands alone: `unit` of time and `inertia_unit` name "
    "units",
}
"""How to write a number, by the look of the text that was written instead."""


def nearest(name: Any, valid: Collection[str]) -> str:
    """'; did you mean ...?' with the nearest valid name, or an empty string if none is near."""
    spelling = near(name, valid) if isinstance(name, str) else None
    return "" if spelling is None else f"; did you mean {spelling!r}?"


def other_word(name: str, valid: Collection[str]) -> str:
    """The valid name for a word of a text or another program, or an empty string."""
    return next((word for word in OTHER_WORDS.get(name.lower(), ()) if word in valid), "")


def near(name: str, valid: Collection[str]) -> str | None:
    """The valid name nearest to a name, or None if none is near."""
    # A valid name of one letter is near to that letter only, repeated or in the other case: a word
    # such as `pi` resembles each of its letters, and means none of them.
    folded = {x.casefold(): x for x in valid if len(x) > 1 or {*name.casefold()} == {x.casefold()}}
    close = get_close_matches(name[:100].casefold(), folded, n=1, cutoff=0.65)
    similar = folded[close[0]] if close else None
    return other_word(name, valid) or similar


def unknown(what: str, name: str, valid: Iterable[str], answer: str = "") -> str:
    """The message about a name that is not among the `valid` ones, with what to write instead, if
    that is known, or with the nearest valid name."""
    names = list(valid)
    listed = f" (valid: {', '.join(names)})" if 0 < len(names) <= 40 else ""
    if name.isdecimal():
        answer = DECIMAL_HINT
    elif name.lower() in WORDS_FOR_OMEGA and {*"pqr"} <= {*names} and not near(name, names):
        answer = "; its components are p, q and r"
    elif colon := re.fullmatch(r"(\w+):(\S+)", name):
        answer = f"; put a space after the colon: {colon[1]}: {colon[2]}"
    return f"unknown {what}{answer or nearest(name, names)}{listed}"


def shown(value: Any) -> str:
    """A value as a message names it: in YAML's words, shortened."""
    match value:
        case None:
            return "an empty value"
        case bool():
            return str(value).lower()
        case list() | tuple():
            rows = value and all(isinstance(item, list | tuple) for item in value)
            return f"{len(value)} rows" if rows else f"a list of {len(value)}"
        case Mapping():
            return "a mapping" if value else "an empty mapping"
        case int() if abs(value) >= 10**60:
            return "a huge integer"  # Python refuses to write one out
    text = repr(value)
    # A shortened text keeps its closing quote.
    return text if len(text) <= 62 else f"{text[:58]}...{text[:1].strip('0123456789')}"


def number_advice(value: Any) -> str:
    """How to write a number that was written as in another program or language."""
    if not isinstance(value, str):
        return ""
    advice = (says for looks, says in NUMBERS_ELSEWHERE.items() if re.fullmatch(looks, value))
    return next(advice, "")
