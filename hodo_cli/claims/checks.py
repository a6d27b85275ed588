"""The statements of a text, checked against what was computed: for each a verdict, and the number
that decides it.

A check yields a deviation: 0 where the statement holds, else its violation relative to the range of
the quantity (as an axis that shows it is drawn, zero included), infinite where it is not a matter
of degree. Below PLOTTING_ACCURACY it cannot be seen in a figure. Where a text leaves a value out,
the check is made over a grid of it, and a statement that holds on a part of the grid is
under-determined; one that fails for a random member of its domain is contradicted.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..cases.claim_block import SERIES
from ..models import rigid_body
from .finding import ROUNDING, Finding, beyond, listed
from .quantities import Motion
from .variations import changed, motion

# The kinds of check. Each takes its own keys and the motions of the claim's cases, in order.

Keys = Mapping[str, Any]


def axis(check: Keys, motions: Sequence[Motion]) -> Finding:
    """The axes enclosed at start and end; decided by the number of cases that comply."""
    ends = [[rigid_body.LABELS[int(label)] for label in m.enclosed[[0, -1]]] for m in motions]
    right = [
        all(check[at] in (None, seen) for at, seen in zip(("start", "end"), pair, strict=True))
        for pair in ends
    ]
    words = ", ".join(f"{start} to {end}" if start != end else start for start, end in ends)
    return Finding(0.0 if all(right) else math.inf, float(sum(right)), words)


def crossings(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Number and direction of the crossings of each case; decided by the largest number."""
    right, counts, words = True, [], []
    for m in motions:
        counts.append(len(m.crossings))
        right &= (
            check["least"]
            <= len(m.crossings)
            <= (math.inf if check["most"] is None else check["most"])
        )
        for _, start, end, _ in m.crossings:
            right &= check["from"] in (None, rigid_body.LABELS[start]) and check["to"] in (
                None,
                rigid_body.LABELS[end],
            )
        passages = [
            f"{time:.12g} ({rigid_body.LABELS[a]} to {rigid_body.LABELS[b]})"
            for time, a, b, _ in m.crossings
        ]
        words.append(", ".join(passages) or "no crossing")
    return Finding(0.0 if right else math.inf, float(max(counts)), "; ".join(words))


def value(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Values at start or end against those given; decided by the largest difference."""
    worst, differences, words = 0.0, [0.0], []
    for name, given in check["values"].items():
        found = [m.number(name, check["at"]) for m in motions]
        words.append(f"{name} = {listed(found)} (said: {listed(given)})")
        for m, ours, theirs in zip(motions, found, given, strict=True):
            differences.append(abs(ours - theirs))
            scale = size(m, name)
            worst = max(
                worst, beyond(differences[-1] / scale, check["within"] * (1 + ROUNDING) / scale)
            )
    return Finding(worst, float(np.max(differences)), "; ".join(words))


def size(m: Motion, name: str) -> float:
    """The range of a quantity, zero included; of a single number its size."""
    values = m[name] if name in SERIES else np.array([m.number(name)])
    return max(float(np.max(values, initial=0) - np.min(values, initial=0)), math.ulp(0))


def bound(check: Keys, motions: Sequence[Motion]) -> Finding:
    """A quantity against a bound; decided by its value nearest to the bound, or farthest beyond."""
    name, least, most = check["of"], check["least"], check["most"]
    everywhere = check["at"] == "always" and name in SERIES
    found = [m[name] if everywhere else np.array([m.number(name, check["at"])]) for m in motions]
    low, high = float(np.min([f.min() for f in found])), float(np.max([f.max() for f in found]))
    number = high if most is not None else low
    violation = float(
        np.max(
            [
                -math.inf if most is None else high - most,
                -math.inf if least is None else least - low,
            ]
        )
    )
    scale = max(max(size(m, name) for m in motions), abs(most or 0), abs(least or 0))
    words = (
        f"{name} from {low:.6g} to {high:.6g}"
        if everywhere
        else f"{name} = {listed([float(f[0]) for f in found])}"
    )
    return Finding(beyond(violation / scale, ROUNDING), number, words)


def monotone(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Quantities that only fall or only rise; decided by the largest violation relative to the
    range."""
    sign = 1 if check["sense"] == "falls" else -1
    worst, words = 0.0, []
    for m in motions:
        for name in check["of"]:
            values = sign * m[name]
            back = values - np.minimum.accumulate(values)
            if violation := beyond(float(back.max()) / size(m, name), ROUNDING):
                worst = max(worst, violation)
                words.append(
                    f"{name} goes back by {violation:.2g} of its range at {m.time[back.argmax()]:.4g}"
                )
    return Finding(worst, worst, "; ".join(words) or f"{', '.join(check['of'])}: no step back")


def order(check: Keys, motions: Sequence[Motion]) -> Finding:
    """How values follow each other; decided by the smallest step or, for equal ones, by how far
    they are apart."""
    names = check["of"]
    if len(names) > 1:
        groups = [[m.number(name, check["at"]) for name in names] for m in motions]
    else:
        values, by = [m.number(names[0], check["at"]) for m in motions], check["by"] or len(motions)
        groups = [values[i : i + by] for i in range(0, len(values), by)]
    words = f"{', '.join(names)}: {'; '.join(listed(group) for group in groups)}"
    steps = [b - a for group in groups for a, b in itertools.pairwise(group)]
    if check["sense"] == "equal":
        apart = float(np.max(np.ptp(groups, axis=1)) / max(np.max(np.abs(groups)), math.ulp(0)))
        return Finding(beyond(apart, ROUNDING), apart, words)
    right = all(step < 0 if check["sense"] == "falls" else step > 0 for step in steps)
    return Finding(0.0 if right else math.inf, min(map(abs, steps)), words)


def conserved(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Constants of the motion; decided by the largest relative change."""
    changes = [
        float(np.ptp(m[name]) / np.abs(m[name]).max()) for m in motions for name in check["of"]
    ]
    worst = float(np.max(changes))
    words = f"{', '.join(check['of'])}: relative change {listed(changes)}"
    return Finding(beyond(worst, check["within"]), worst, words)


def closed_form(check: Keys, motions: Sequence[Motion]) -> Finding:
    """A formula beside the motion; decided by the largest difference relative to the largest
    value."""
    pairs = [pair for m in motions for pair in m.formula(check["form"])]
    apart = [
        float(np.max(np.abs(a - b), initial=0) / np.max(np.abs(a), initial=math.ulp(0)))
        for a, b in pairs
    ]
    worst = float(np.max(apart))
    deviation = beyond(worst, check["within"])
    if check["differs"] == "yes":
        deviation = 0.0 if deviation else math.inf
    return Finding(deviation, worst, f"differs by {worst:.2g}")


def event(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Whether an event happens in finite time; decided by the latest time."""
    times = [
        next((time for kind, time in m.events if kind == check["event"]), math.inf) for m in motions
    ]
    right = all((time < math.inf) == (check["happens"] == "yes") for time in times)
    return Finding(0.0 if right else math.inf, max(times), f"{check['event']} at {listed(times)}")


def convergence(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Pairs of a limit and a case with epsilon: the power at which their difference falls; decided
    by the smallest."""
    powers, words = [], []
    for limit, full in zip(motions[::2], motions[1::2], strict=True):
        time = {"time": asdict(limit.case.time)}
        near = [
            motion(changed(full.case, time | {"epsilon": epsilon})) for epsilon in check["epsilon"]
        ]
        for name in check["of"]:
            errors = [float(np.abs(m[name] - limit[name]).max()) for m in near]
            logs = np.diff(np.log(errors)) / np.diff(np.log(check["epsilon"]))
            powers.append(float(logs.min()))
            words.append(f"{name} {', '.join(f'{error:.3g}' for error in errors)}")
    least = min(powers)
    return Finding(
        0.0 if least >= 0.9 * check["order"] else math.inf,
        least,
        f"power {least:.3g}: {'; '.join(words)}",
    )


def effect(check: Keys, motions: Sequence[Motion]) -> Finding:
    """The mean effects of two factors on a quantity; decided by the ratio of the larger, as said,
    to the other."""
    low, first, second, both = (m.number(check["of"], check["at"]) for m in motions)
    effects = abs(first - low + both - second) / 2, abs(second - low + both - first) / 2
    larger, other = effects if check["larger"] == "first" else effects[::-1]
    words = f"{check['of']}: {listed([low, first, second, both])}, effects {listed(effects)}"
    return Finding(
        0.0 if larger > other else math.inf, larger / other if other else math.inf, words
    )


KINDS: dict[str, Callable[[Keys, Sequence[Motion]], Finding]] = {
    "axis": axis,
    "crossings": crossings,
    "value": value,
    "bound": bound,
    "monotone": monotone,
    "order": order,
    "conserved": conserved,
    "closed-form": closed_form,
    "event": event,
    "convergence": convergence,
    "effect": effect,
}
"""The kinds of `statements.KINDS`."""
