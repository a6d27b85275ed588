"""The general kinds of check, for statements of any text on motions and on sweeps.

Each takes its own keys and the motions of the claim's cases, in order, and returns a Finding.
"""

import contextlib
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..cases.claim_block import SINGLE_NUMBERS
from ..integration import Crossing
from ..models import rigid_body
from ..results.motion import Motion, formula_values
from ..text import grouped
from .finding import (
    PLOTTING_ACCURACY,
    ROUNDING,
    Finding,
    Undecidable,
    deviation_beyond,
    deviation_unless,
    digits_to_show,
    in_groups,
    in_percent,
    listed,
)
from .measures import (
    check_known,
    check_margin,
    check_reached,
    enclosed_at,
    error_of,
    extremes,
    known_crossings,
    known_values,
    largest_magnitude,
    number,
    quantity,
    range_of,
    turns_at,
    vector_size,
)

if TYPE_CHECKING:
    from ..sweeps.view import SweepView

Keys = Mapping[str, Any]


def axis(check: Keys, motions: Sequence[Motion]) -> Finding:
    """The axes enclosed at start and end, and the turns that G makes about each of them; decided by
    the number of cases that comply."""
    wanted = {moment: check[moment] for moment in ("start", "end") if check[moment]}
    complying, words = 0, []
    for m in motions:
        axes = {moment: enclosed_at(m, moment) for moment in wanted}
        turns = [turns_at(m, moment) for moment in wanted] if check["turns"] else []
        complying += wanted == axes and all(turn >= check["turns"] for turn in turns)
        labels = dict.fromkeys(rigid_body.LABELS[label] for label in m.labels_at_ends)
        until = ", until G is 0" if math.isfinite(m.stop) else ""
        made = f" ({listed(dict.fromkeys(turns), 3)} turns)" if turns else ""
        words.append(f"{' to '.join(labels)}{until}{made}")
    moments = grouped((axis, moment) for moment, axis in wanted.items())
    contrary = [
        f"an axis other than {axis}" + (f" at the {at[0]}" if len(moments) > 1 else "")
        for axis, at in moments.items()
    ]
    contrary += [f"fewer turns about it than {check['turns']:g}"] if check["turns"] else []
    return Finding(
        deviation_unless(complying == len(motions)),
        number=float(complying),
        evidence=", ".join(words),
        contradicted_by=" or ".join(contrary),
    )


def crossings(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Number and direction of the crossings of each case; decided by the largest number."""
    # At least one, unless `most` alone is given: a direction needs a crossing.
    least, most = check["least"] or int(check["most"] is None), check["most"]
    counts = [len(m.crossings) for m in motions]
    asked = {side: check[side] for side in ("from", "to") if check[side]}
    goes_astray = any(asked.items() - ends_of(c).items() for m in motions for c in m.crossings)
    fails = goes_astray or (most is not None and max(counts) > most)
    lacks_some = min(counts) < least
    # An unknown crossing may be the missing one, or one too many.
    if not fails and (lacks_some or most is not None or asked):
        for m in motions:
            known_crossings(m)
    fewer = "no crossing" if least == 1 else f"fewer crossings than {least}"
    more = f"more crossings than {most}" if most else "a crossing"
    astray = f"a crossing that is not {' '.join(map(' '.join, asked.items()))}"
    contrary = ((fewer, least), (more, most is not None), (astray, asked))
    of_motions = (
        [f"{m.case.time.text(c.time, 4)} ({' to '.join(ends_of(c).values())})" for c in m.crossings]
        for m in motions
    )
    return Finding(
        deviation_unless(not (fails or lacks_some)),
        number=float(max(counts)),
        evidence="; ".join(", ".join(words) or "no crossing" for words in of_motions),
        contradicted_by=" or ".join(words for words, is_contrary in contrary if is_contrary),
    )


def ends_of(crossing: Crossing) -> dict[str, str]:
    """The axes enclosed before and after a crossing, by the keys of a check."""
    return {"from": rigid_body.LABELS[crossing.start], "to": rigid_body.LABELS[crossing.end]}


def printed_values(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Values at start or end compared with the printed values; decided by the largest
    difference."""
    deviations, differences, words = [0.0], [0.0], []
    # `within`, such as half a unit of the last digit, is itself rounded: one rounding is allowed.
    allowed = check["within"] * (1 + ROUNDING)
    for name, printed in check["values"].items():
        values = [number(m, name, check["at"]) for m in motions]
        digits = max(digits_to_show(value, check["within"]) for value in values)
        words.append(f"{name} = {listed(values, digits)} (printed: {listed(printed, digits)})")
        for m, measured, expected in zip(motions, values, printed, strict=True):
            differences.append(abs(measured - expected))
            check_reached(m, name, expected)
            if check["at"] == "end":
                check_margin(name, differences[-1] - check["within"], m)
            scale = range_of(m, name)
            deviations.append(deviation_beyond(differences[-1] / scale, allowed / scale))
    return Finding(
        max(deviations),
        number=float(np.max(differences)),
        evidence="; ".join(words),
        contradicted_by=f"a difference above {check['within']:g}"
        " that is more than 1 % of the range",
    )


def bound(check: Keys, motions: Sequence[Motion]) -> Finding:
    """A quantity compared with a bound; decided by its value nearest to the bound, or farthest
    beyond it."""
    name, everywhere = check["of"], check["at"] == "always"
    of_motions = [
        extremes(m, name) if everywhere else (number(m, name, check["at"]),) * 2 for m in motions
    ]
    signs = {"most": 1, "least": -1}
    bounds = [(sign, check[key]) for key, sign in signs.items() if check[key] is not None]
    # The value that is nearest to a bound, or farthest beyond it, and how far that is.
    nearest = [
        (sign * (ends[sign > 0] - bound), ends[sign > 0], m)
        for m, ends in zip(motions, of_motions, strict=True)
        for sign, bound in bounds
    ]
    for m, (_, bound) in itertools.product(motions, bounds):
        check_reached(m, name, bound)
    _, decisive, of_case = max(nearest, key=itemgetter(0))
    digits = max(digits_to_show(value, violation) for violation, value, _ in nearest)
    lows, highs = zip(*of_motions, strict=True)
    range_words = f"from {min(lows):.{digits}g} to {max(highs):.{digits}g}"
    of_course = f"{name} {range_words}{among(motions, of_case)}"
    deviation_of = number_deviation if name in SINGLE_NUMBERS else course_deviation
    return Finding(
        max(deviation_of(m, name, violation) for violation, _, m in nearest),
        number=decisive,
        evidence=of_course if everywhere else f"{name} = {listed(lows, digits)}",
        contradicted_by=" or ".join(
            f"a value {'above' if sign > 0 else 'below'} {bound:g}" for sign, bound in bounds
        ),
    )


def number_deviation(m: Motion, name: str, violation: float) -> float:
    """The deviation of a single number of a motion, relative to its size. Raises Undecidable where
    it is nearer to its bound than its error."""
    check_margin(name, violation, m)
    # A bound that is met needs no scale: an infinite time has none.
    return 0.0 if violation <= 0 else deviation_beyond(violation / range_of(m, name), ROUNDING)


def course_deviation(
    m: Motion, name: str, difference: float, allowed: float = 0.0, scale: float | None = None
) -> float:
    """The deviation of a difference in the course of a quantity beyond the allowed one, relative to
    `scale` (default: its range).

    It is 0 up to 1e-12 of the largest |value| of the quantity, and up to the quantity's error.
    Raises Undecidable where that error decides and is above plotting accuracy and above the error
    of any good result.
    """
    scale = range_of(m, name) if scale is None else scale
    violation = difference - allowed
    if abs(violation) <= ROUNDING * largest_magnitude(m, name):
        return 0.0
    error = error_of(m, name)
    hidden = max(PLOTTING_ACCURACY * scale, ROUNDING * vector_size(m, name))
    check_known(name, error, violation, hidden, m)
    return 0.0 if violation <= error else deviation_beyond(difference / scale, 0.0)


def among(motions: Sequence[Motion], m: Motion) -> str:
    """The name of the case that decides a check of several cases, as the end of a sentence; empty
    for one case."""
    return f", {m.words}" if len(motions) > 1 else ""


def monotone(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Quantities that only fall or only rise; decided by the largest violation relative to the
    range."""
    sign = 1 if check["sense"] == "falls" else -1
    violations: dict[str, tuple[float, str, str]] = {}
    for name, m in itertools.product(check["of"], motions):
        values = sign * quantity(m, name)
        # How far each value is above the least one before it, so that a slow climb counts too.
        climb = values - np.minimum.accumulate(values)
        if violation := course_deviation(m, name, float(climb.max())):
            when = m.case.time.text(m.time[climb.argmax()], 4)
            largest = violation, when, among(motions, m)
            violations[name] = max(violations.get(name, largest), largest)
    words = "; ".join(
        f"{name} goes back by {in_percent(violation)} of its range at {when}{of_case}"
        for name, (violation, when, of_case) in violations.items()
    )
    worst = max((violation for violation, *_ in violations.values()), default=0.0)
    return Finding(
        worst,
        number=worst,
        evidence=words or f"{', '.join(check['of'])}: no step back",
        contradicted_by=f"a step back above {PLOTTING_ACCURACY:.0%} of the range",
    )


def order(check: Keys, motions: Sequence[Motion]) -> Finding:
    """The order of values from case to case; decided by the smallest step or, for equal values, by
    the largest distance."""
    name = check["of"]
    groups = in_groups(motions, check["by"] or len(motions))
    values = np.array([[number(m, name, check["at"]) for m in group] for group in groups])
    for group, of_group in zip(groups, values.tolist(), strict=True):
        for i, j in itertools.permutations(range(len(group)), 2):
            # An event that has not happened by the end of its motion is later than that end.
            check_reached(group[i], name, of_group[j])
    sizes = np.maximum(np.abs(values).max(axis=1, keepdims=True), math.ulp(0))
    steps = np.diff(values)
    pairs = zip(values[:, 1:].flat, steps.flat, strict=True)
    digits = max(itertools.starmap(digits_to_show, pairs))
    words = f"{name}: {'; '.join(listed(of_group, digits) for of_group in values.tolist())}"
    is_decided = (check["sense"] == "equal") & (np.abs(steps) <= ROUNDING * sizes)
    if check["at"] == "end":
        for i, j in np.argwhere(~is_decided).tolist():
            check_margin(name, steps[i, j], *groups[i][j : j + 2])
    if check["sense"] == "equal":
        apart = float(np.max(np.ptp(values, axis=1, keepdims=True) / sizes))
        return Finding(
            deviation_beyond(apart, ROUNDING),
            number=apart,
            evidence=words,
            contradicted_by="two values that differ",
        )
    sign, contrary = (-1, "rises") if check["sense"] == "falls" else (1, "falls")
    # The smallest step is the nearest to the other verdict.
    return Finding(
        deviation_unless(bool((sign * steps > 0).all())),
        number=float(np.abs(steps).min()),
        evidence=words,
        contradicted_by=f"a value that {contrary} or stays",
    )


def conserved(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Constants of the motion; decided by the largest relative change."""
    changes = [
        (m, name, float(np.ptp(quantity(m, name))))
        for m, name in itertools.product(motions, check["of"])
    ]
    worst, deviation, of_case = relative_differences(changes, check["within"], motions)
    return Finding(
        deviation,
        number=worst,
        evidence=f"{', '.join(check['of'])}: relative change at most {worst:.2g}{of_case}",
        contradicted_by=f"a relative change above {max(check['within'], PLOTTING_ACCURACY):g}",
    )


def formula(check: Keys, motions: Sequence[Motion]) -> Finding:
    """A quantity compared with a law; decided by the largest difference over its largest value."""
    name, law = check["of"], check["formula"]
    apart = (quantity(m, name) - known_values(m, law, formula_values(m, law)) for m in motions)
    differences = [(m, name, float(np.abs(x).max())) for m, x in zip(motions, apart, strict=True)]
    worst, deviation, of_case = relative_differences(differences, check["within"], motions)
    return Finding(
        deviation,
        number=worst,
        evidence=f"{name} and {law}: at most {worst:.2g} apart, relative to the largest {name}"
        + of_case,
        contradicted_by=f"a relative difference above {max(check['within'], PLOTTING_ACCURACY):g}",
    )


def relative_differences(
    differences: Sequence[tuple[Motion, str, float]], within: float, motions: Sequence[Motion]
) -> tuple[float, float, str]:
    """The largest difference relative to the largest |value| of its quantity, or the first that is
    nan; the largest deviation; and the words of `among` for its case. `differences` are rows of a
    motion, the name of a quantity, and a difference of it."""
    sizes = [largest_magnitude(m, name) for m, name, _ in differences]
    ratios = [x / size for (*_, x), size in zip(differences, sizes, strict=True)]
    deviations = [
        course_deviation(m, name, x, within * size, size)
        for (m, name, x), size in zip(differences, sizes, strict=True)
    ]
    i = int(np.argmax(ratios))
    return ratios[i], max(deviations), among(motions, differences[i][0])


MOTION_CHECKS: dict[str, Callable[[Keys, Sequence[Motion]], Finding]] = {
    "axis": axis,
    "crossings": crossings,
    "value": printed_values,
    "bound": bound,
    "monotone": monotone,
    "order": order,
    "conserved": conserved,
    "formula": formula,
}
"""The kinds of `claim_block.CHECK_KINDS` that take motions."""


OF_EACH_MOTION = frozenset(MOTION_CHECKS) - {"value", "order"}
"""The kinds that judge each motion by itself. Others compare cases: printed values belong to cases
by position, and an order is of several cases."""


def motion_finding(check: Keys, motions: Sequence[Motion]) -> Finding:
    """The finding of a check of motions.

    A statement about the course of quantities that holds at samples has to hold between them too,
    where a quantity has its peaks and a torque may change. Raises Undecidable where samples are too
    few to show the course. A contradiction at samples, or in one motion, decides whatever else is
    unknown.
    """
    find = MOTION_CHECKS[check["kind"]]
    try:
        return find(check, motions)
    except Undecidable:
        if check["kind"] not in OF_EACH_MOTION:
            raise
        for m in motions:
            with contextlib.suppress(Undecidable):
                alone = find(check, [m])
                if not alone.holds:
                    return replace(alone, evidence=alone.evidence + among(motions, m))
        raise


def averages(check: Keys, swept: "SweepView") -> Finding:
    """Averages over the members of a sweep (all, or at positions), or their range along axes,
    compared with bounds or in order; decided by the last average."""
    name = check["variable"]
    everywhere: Sequence[Mapping[str, int]] = [] if check["along"] else [{}]
    at = check["at"] or everywhere
    means = [float(swept.values(name, (), position)) for position in at]
    for along in check["along"]:
        values = swept.values(name, (along,), {})
        means.append(float(np.nanmax(values) - np.nanmin(values)))
    if np.isnan(means).any():
        raise Undecidable(f"{name} has no average: {listed(means)}")
    least, most, steps = check["least"], check["most"], np.diff(means)
    violations_by_sense = {
        "falls": steps,
        "rises": -steps,
        "equal": np.abs(steps) - check["within"],
    }
    violations = [
        *(least - x for x in means if least is not None),
        *(x - most for x in means if most is not None),
        *violations_by_sense.get(check["sense"], ()),
    ]
    scale = max(map(abs, means)) or 1.0
    spreads = zip(means[len(at) :], check["along"], strict=True)
    apart = [(x, x - limit) for x in means for limit in (least, most) if limit is not None]
    pairs = itertools.chain(apart, zip(means[1:], steps.tolist(), strict=True))
    digits = max(itertools.starmap(digits_to_show, pairs), default=4)
    words = [f"{name} = {listed(means[: len(at)], digits)}"] if at else []
    words += [f"varies by {spread:.3g} along {along}" for spread, along in spreads]
    positions = (*at, {}) if check["along"] else at
    for lacking, total in {swept.left_out(name, position) for position in positions}:
        words += [f"{lacking} of {total} members have none"] if lacking else []
    return Finding(
        deviation_beyond(float(max(violations, default=0.0)) / scale, ROUNDING),
        number=means[-1],
        evidence=", ".join(words),
        contradicted_by="an average beyond its bounds, or a step the other way",
    )
