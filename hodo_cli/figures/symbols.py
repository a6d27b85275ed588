"""Symbols, units and labels in TeX: of the variables of a motion, and of the axes of a sweep."""

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..cases.derived import PARTS
from ..results.motion import Motion
from ..sweeps.view import SweepView
from .words import in_formula


def unit(motion: Motion, variable: str, power: int = 1) -> str:
    """The units of a variable, in brackets, those of a rate, as 1/s, raised to a power; a dash
    where the case has none, and nothing where only its time has units."""
    stored = motion.units(variable)
    if stored == "1" or motion.lacks_unit(variable):
        # With time in seconds T and G are no bare numbers, and no file says what units A has.
        return "[–]" if motion.units("time") == "1" else ""
    return f"[{with_superscripts(stored if power == 1 else f'{stored}^{power}')}]"


def with_superscripts(units: str) -> str:
    """Units with their powers set as such: m^2 as m$^{2}$."""
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", units)


VECTORS = {
    "gamma": r"\gamma",
    "omega": r"\omega",
    "total": r"(G-\kappa\dot\omega)",
    "rotation": r"\mathrm{rotation}",
}
"""The symbols of stored vectors whose name is not theirs."""


def symbol(name: str) -> str:
    """A variable's name in TeX: Gz as G_z, u1 as u_1, G.x2 as G_2."""
    special = {
        "G": "|G|",
        "G2": "G^2",
        "J": "J = G^2/2T",
        "k2": "k^2",
        "omega.x1": "p",
        "omega.x2": "q",
        "omega.x3": "r",
        "gamma.x3": r"\cos\theta",
        "psi": r"\psi",
        "theta": r"\theta",
        "phi": r"\phi",
        "speed": r"|\omega|",
    }
    if name in special:
        return special[name]
    base, _, axis = name.partition(".")
    if base == "attitude":
        return axis
    if base.endswith("_space"):
        vector = base.removesuffix("_space")
        index = f"{vector[1]},{axis}" if vector[1:].isdigit() else axis
        return rf"{{{VECTORS.get(vector, vector[0])}}}_{{{index}}}"
    if axis:
        return f"{VECTORS.get(base, base)}_{axis.removeprefix('x') or axis}"
    if re.fullmatch(r"[A-Za-z]\w{2,}", name):
        # A word, not a product of letters, nor an index.
        return rf"\mathrm{{{name}}}".replace("_", r"\ ")
    return f"{name[0]}_{{{name[1:]}}}" if re.fullmatch("[A-Za-z][a-z0-9]", name) else name


FORMULA_WORDS = {"sqrt": r"\mathrm{sqrt}", "sin": r"\sin", "cos": r"\cos", "exp": r"\exp"}

FORMULA_SIGNS = (
    (r"\*\*\s*\(([-+\d\s]+)\)", r"**\1"),
    (r"\*\*\s*([-+]?\d+)", r"^{\1}"),
    (r"(?<=[\d.])[eE]([-+]?\d+)", r"\\cdot 10^{\1}"),
    (r"\*", r"\\cdot "),
)
"""The functions of a formula in a case file, and its powers, numbers and products, in TeX."""


def formula_in_tex(text: str, time: str) -> str:
    """A formula of a case file in TeX, with a symbol of time."""
    words = FORMULA_WORDS | {"t": time}

    def word(name: re.Match[str]) -> str:
        # Of J = G^2/2T the letter alone.
        return words.get(name[0], f"{{{symbol(name[0]).partition(' = ')[0]}}}")

    text = re.sub(r"(?<![\w.])[A-Za-z]\w*(\.[A-Za-z]\w*)?", word, text)
    for sign, tex in FORMULA_SIGNS:
        text = re.sub(sign, tex, text)
    return text


def meaning_in_tex(meaning: str) -> str:
    """What a quantity is in words, or in TeX if that is a formula, as |omega| and G^2/2T - A2."""
    if not re.fullmatch(r"(omega|[ADGTpqr]|[-+^/|1-3 ])+", meaning):
        return meaning
    formula = re.sub(r"([A-Z])([1-3])", r"\1_\2", meaning).replace("omega", r"\omega")
    return f"${formula}$"


def axis_label(name: str, motion: Motion) -> str:
    """A variable's symbol and units."""
    return f"${symbol(name)}$ {unit(motion, name)}".rstrip()


def unit_after(motion: Motion, variable: str) -> str:
    """The units of a variable as they stand after a number; nothing where it has none."""
    stored = "1" if motion.lacks_unit(variable) else motion.units(variable)
    return "" if stored == "1" else f" {with_superscripts(stored)}"


def time_label(spec: Mapping[str, Any], motion: Motion) -> str:
    """The symbol of time and its units."""
    return f"${spec['time']}$ {unit(motion, 'time')}"


def value_unit(swept: SweepView, name: str, units_of: Callable[[str], str]) -> str:
    """The units of a variable of a sweep in TeX; an empty text where it has none."""
    units, motion = units_of(name), Motion(swept.case, swept.data.variables)
    is_bare = units == "1" or motion.lacks_unit(name.removeprefix("crossing_"))
    return "" if is_bare else with_superscripts(units)


def axis_words(component: str) -> str:
    """A component or label in words: x1 as $x_1$."""
    return re.sub(r"^x([123])$", r"$x_\1$", component)


def axis_name(swept: SweepView, name: str) -> str:
    """The text along an axis of a sweep: the symbol of its first key, and its unit; behind it the
    symbols of the keys that vary with it."""
    unit = with_superscripts(swept.unit(name))
    others = [f"${key_symbol(key)}$" for key in swept.numbers_along(name)[1:]]
    with_others = f", with {', '.join(others)}" if others else ""
    return f"${key_symbol(swept.key(name))}$" + (f" [{unit}]" if unit else "") + with_others


def axis_columns(swept: SweepView, name: str) -> dict[str, np.ndarray]:
    """The values (n,) along an axis by their names in tables and pages, with a unit where the
    result has another: those of each key where several vary along it."""
    keys = swept.numbers_along(name)
    units = {key: swept.unit(key) for key in (keys if len(keys) > 1 else [name])}
    return {
        key if unit in ("", "rad") else f"{key} [{unit}]": swept.ticks(key)[0]
        for key, unit in units.items()
    }


def position(swept: SweepView, name: str, i: int) -> str:
    """A position on an axis: symbol = value of each of its keys."""
    words = []
    for key in swept.numbers_along(name):
        unit = swept.unit(key)
        shown_unit = "°" if unit == "deg" else f" {with_superscripts(unit)}".rstrip()
        number = in_formula(f"{swept.ticks(key)[0][i]:.4g}")
        words.append(f"${key_symbol(swept.key(key))} = {number}${shown_unit}")
    return ", ".join(words)


KEY_SYMBOLS = {
    "initial.theta": r"\theta",
    "resistance": "I",
    "resistance.diagonal": "I_{ii}",
    "resistance.off_diagonal": "I_{ij}",
    "epsilon": r"\varepsilon",
    "kappa": r"\kappa",
    "cavity.kappa": r"\kappa",
    "mu": r"\mu",
    "damping": r"\lambda",
    "inertia": "A",
    "torque": "M",
    "quadratic": "c",
    "brake": "b",
    "rotor": "h",
    "space_torque.size": "F",
    "space_torque.direction": "e",
    "attitude.euler": r"\mathrm{Euler\ angle}",
    **{f"attitude.initial.{i}": f"{name}_0" for i, name in enumerate(PARTS["quaternion"])},
}

FROM_ONE = {
    "damping", "inertia", "torque", "quadratic", "rotor",
    "space_torque.direction", "attitude.euler",
}  # fmt: skip
"""The keys of lists of one entry an axis or a turn, whose symbols count from one."""

PARTS_OF_LAWS = frozenset(("value", "rate", "exponent"))


def key_symbol(key: str) -> str:
    """The symbol of a key in TeX: damping.2 is lambda_3, resistance.0.1 is I_12; of a number of a
    law or of another list that of the whole, and which number it is."""
    if key in KEY_SYMBOLS:
        return KEY_SYMBOLS[key]
    head, _, last = key.rpartition(".")
    if head in FROM_ONE and last.isdecimal():
        return f"{KEY_SYMBOLS[head]}_{int(last) + 1}"
    if place := re.fullmatch(r"(resistance|inertia)\.(\d)\.(\d)", key):
        matrix, row, column = place.groups()
        return f"{KEY_SYMBOLS[matrix]}_{{{int(row) + 1}{int(column) + 1}}}"
    if head and (last.isdecimal() or last in PARTS_OF_LAWS):
        # a.1 is a_1, the coefficient of t; the symbol of an entry has its own index already.
        whole, is_index = key_symbol(head), last.isdecimal()
        return (
            f"{whole}_{last}" if is_index and "_" not in whole else rf"{whole}\,[\mathrm{{{last}}}]"
        )
    return last if re.fullmatch(r"[A-Za-z]\w?", last) else rf"\mathrm{{{last}}}".replace("_", r"\_")
