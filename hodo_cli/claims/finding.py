"""The finding of a check, its verdict, and functions that several checks use."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from .. import HodoError
from ..cases.claim_block import CONTRADICTED, PLOTTING, REPRODUCED
from ..results.motion import Motion

PLOTTING_ACCURACY = 0.01
"""A violation, relative to a quantity's range, that no figure shows: half the width of a line."""

ROUNDING = 1e-12
"""A violation by rounding alone: the error that a good result may have."""


@dataclass(frozen=True)
class Finding:
    """The result of a check: the deviation, the number that decides, the evidence in words, and the
    contrary evidence, which would have contradicted the statement.

    The deviation is 0 where the statement holds, else its violation relative to the range of the
    quantity; it is infinite for a yes/no statement that fails.
    """

    deviation: float
    _: KW_ONLY
    number: float
    evidence: str
    contradicted_by: str = ""

    @property
    def holds(self) -> bool:
        """Whether the statement holds, to plotting accuracy at least."""
        return self.deviation <= PLOTTING_ACCURACY

    @property
    def degree(self) -> str:
        """The verdict of the finding by itself."""
        if self.deviation == 0:
            return REPRODUCED
        return PLOTTING if self.holds else CONTRADICTED


@dataclass(frozen=True)
class Verdict:
    """The verdict on a claim or an erratum in a word, and the finding that decides it; `readings`
    holds the verdicts under each reading of the text, by its name."""

    word: str
    finding: Finding
    readings: Mapping[str, "Verdict"] = field(default_factory=dict)


def deviation_beyond(violation: float, allowed: float) -> float:
    """The deviation of a violation; infinite if the violation is nan."""
    if violation <= allowed:
        return 0.0
    return math.inf if math.isnan(violation) else violation


def deviation_unless(holds: bool) -> float:
    """The deviation of a yes/no statement: 0 if it holds, else infinite."""
    return 0.0 if holds else math.inf


def listed(values: Iterable[float], digits: int = 4) -> str:
    """Numbers as text, to `digits` digits; numbers that are rounding errors of larger ones are
    0."""
    numbers = [*values]
    least = 1e-15 * max((abs(x) for x in numbers if math.isfinite(x)), default=0.0)
    return ", ".join(f"{0 if abs(x) <= least else x:.{digits}g}" for x in numbers)


def digits_to_show(number: float, difference: float) -> int:
    """How many digits of a number, at least 4, show a difference: half a unit of the last digit is
    at most as large as the difference."""
    if not (ROUNDING * abs(number) < abs(difference) < abs(number)):
        return 4
    return max(4, 1 + place_of_first_digit(number) - place_of_first_digit(2 * difference))


def place_of_first_digit(number: float) -> int:
    """The power of ten of a number's first digit."""
    return math.floor(math.log10(abs(number)))


def in_percent(ratio: float) -> str:
    """A fraction in percent, in words."""
    return f"{100 * ratio:.3g} %"


class Undecidable(HodoError):
    """Why a motion decides nothing: a quantity is nan somewhere, or is not known well enough, or
    there is nothing to compare."""


ValuePair = tuple[np.ndarray, np.ndarray]
"""Values of a motion and of a formula for them, of one shape."""


def difference(pairs: Sequence[ValuePair]) -> float:
    """The largest difference of any pair, relative to the largest value of the motion. Raises
    Undecidable for a pair with nan."""
    if any(not a.size for a, _ in pairs):
        raise Undecidable("nothing to compare: a motion is too short, or has other sample times")
    return float(
        np.max([np.max(np.abs(a - b)) / np.max(np.abs(a), initial=math.ulp(0)) for a, b in pairs])
    )


def agreement(pairs: Sequence[ValuePair], within: float) -> Finding:
    """A formula compared with motions; decided by the largest relative difference."""
    worst = difference(pairs)
    return Finding(
        deviation_beyond(worst, within),
        number=worst,
        evidence=f"differs by {worst:.2g}",
        contradicted_by=f"a relative difference above {max(within, PLOTTING_ACCURACY):g}",
    )


def in_groups(motions: Sequence[Motion], size: int) -> list[Sequence[Motion]]:
    """The motions in groups of `size`, for a check that compares cases in groups."""
    return [motions[i : i + size] for i in range(0, len(motions), size)]
