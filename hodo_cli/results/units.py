"""The units of stored and derived variables: products of powers of the units that a case gives."""

import re
from collections import Counter

from ..cases.case import Case

INERTIA, TIME_WORD = "moment of inertia", "time"
"""The words for the units of a case in the units that models, keys and stored names state."""

FACTOR = re.compile(r"([^\W\d_]+|°|%)(?:\^?(-?\d+))?")
"""A unit and its power: s, m^2, m2."""


def units_of_case(stated: str, case: Case) -> str:
    """Units stated in words, such as "moment of inertia / time^2", in the units of a case, such as
    "kg m^2/s^2"; other units stay as they are."""
    case_units = {"inertia": case.inertia_unit, TIME_WORD: case.time.unit}
    powers = factors(stated.replace(INERTIA, "inertia"))
    if not powers.keys() & case_units.keys():
        return stated
    if len(powers) == 1 and 1 in powers.values():
        return case_units[next(iter(powers))]  # as it is spelled
    total: Counter[str] = Counter()
    for word, power in powers.items():
        for unit, of_unit in factors(case_units.get(word, word)).items():
            total[unit] += power * of_unit
    return product_text(total)


STATED_UNITS = re.compile(rf" \[((?:{INERTIA}|{TIME_WORD})[^\]]*)\]")
"""Units in words behind a number of a sentence: "stops after 12.5 [time]"."""


def sentence_of_case(sentence: str, case: Case) -> str:
    """A sentence of a model with the units behind its numbers in the units of a case."""

    def unit(match: re.Match[str]) -> str:
        units = units_of_case(match[1], case)
        return "" if units == "1" else f" {units}"

    return STATED_UNITS.sub(unit, sentence)


def factors(text: str) -> dict[str, int]:
    """The units in a product such as "kg m^2/s" with their powers; none in "1". A text that is no
    such product counts as one unit."""
    powers: Counter[str] = Counter()
    for position, product in enumerate(text.split("/")):
        for word in re.split(r"[\s*·.]+", product.strip()):
            if word == "1":
                continue
            if not (factor := FACTOR.fullmatch(word)):
                return {f"({text})": 1}
            powers[factor[1]] += (-1 if position else 1) * int(factor[2] or 1)
    return powers


def product_text(powers: dict[str, int]) -> str:
    """A product of units as UDUNITS reads it, with a single divisor at the most: "kg m^2/s"."""
    above = [power_text(unit, power) for unit, power in powers.items() if power > 0]
    below = [(unit, -power) for unit, power in powers.items() if power < 0]
    if len(below) == 1:
        return f"{' '.join(above) or '1'}/{power_text(*below[0])}"
    return " ".join([*above, *(power_text(unit, -power) for unit, power in below)]) or "1"


def power_text(unit: str, power: int) -> str:
    """A unit to a power."""
    return unit if power == 1 else f"{unit}^{power}"
