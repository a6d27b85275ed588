"""The statements of a text, checked against what was computed: for each a verdict, and the number that decides it.

A check yields a deviation: 0 where the statement holds, else its violation relative to the range of the quantity (as
an axis that shows it is drawn, zero included), infinite where it is not a matter of degree. Below PLOTTING_ACCURACY it
cannot be seen in a figure. Where a text leaves a value out, the check is made over a grid of it, and a statement that
holds on a part of the grid is under-determined; one that fails for a random member of its domain is contradicted.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from . import HodoError, quantities
from .cases.case import Case, Time, dump, parse_case
from .cases.claim_block import CONTRADICTED, NOT_TESTED, PLOTTING, REPRODUCED, SERIES, UNDERDETERMINED
from .cases.sweep_block import put
from .models import rigid_body
from .quantities import Motion
from .results.hdf5 import Group, Run, Variable
from .sweeps.averages import Labelled, average

PLOTTING_ACCURACY = 0.01
"""A violation, relative to a quantity's range, that a figure does not show."""

ROUNDING = 1e-12
"""A violation that the arithmetic makes."""


@dataclass(frozen=True)
class Finding:
    """What a check found: the deviation, the number that decides, and this in words."""

    deviation: float
    number: float
    words: str


@dataclass(frozen=True)
class Verdict:
    """A claim with its verdict, the number that decides it, and this in words."""

    claim: Mapping[str, Any]
    verdict: str
    number: float
    evidence: str


def judge(claim: Mapping[str, Any], run: Run) -> Verdict:
    """The verdict on one claim by the cases of a result.

    Raises HodoError if a case is not classified, or does not have what the check needs.
    """
    if claim["check"]["kind"] in SWEPT:
        return census(claim, run)
    cases: dict[str, Motion] = {}
    for name in claim["cases"]:
        ended = run.row(name, {"status": str, "message": str}) if name in run else {"status": "missing", "message": ""}
        if ended["status"] != "ok":
            return Verdict(claim, NOT_TESTED, math.nan, f"{name}: {ended['status']} {ended['message']}".rstrip())
        cases[name] = quantities.read(run.read(name))
    try:
        return measure(claim, [*cases.values()])
    except HodoError as error:
        raise HodoError(f"{run.path}: claim {claim['id']}: {error}") from error


def measure(claim: Mapping[str, Any], motions: Sequence[Motion]) -> Verdict:
    """The verdict on one claim by the motions of its cases, in order, or by variations of them. Raises as `judge`."""
    check, over = claim["check"], claim["over"]
    decide = KINDS[check["kind"]]
    if over is None:
        finding = decide(check, motions)
        return Verdict(claim, degree(finding.deviation), finding.number, finding.words)
    varied = members([each.case for each in motions], over)
    found = {member: decide(check, [motion(case) for case in cases]) for member, cases in varied}
    return sampled(claim, found) if over["random"] or over["start"] else gridded(claim, found)


def degree(deviation: float) -> str:
    """The verdict on a single deviation."""
    return REPRODUCED if deviation == 0 else PLOTTING if deviation <= PLOTTING_ACCURACY else CONTRADICTED


def beyond(violation: float, allowed: float) -> float:
    """The deviation that a violation makes; infinite for one that is not a number."""
    return 0.0 if violation <= allowed else math.inf if math.isnan(violation) else violation


def gridded(claim: Mapping[str, Any], found: Mapping[str, Finding]) -> Verdict:
    """The verdict over a grid of what the text does not print."""
    if len(found) == 1:
        (finding,) = found.values()
        return Verdict(claim, degree(finding.deviation), finding.number, finding.words)
    worst = max(found, key=lambda member: found[member].deviation)
    deviation, holds = found[worst].deviation, sum(f.deviation <= PLOTTING_ACCURACY for f in found.values())
    part = 0 < holds < len(found)
    size = f"{deviation:.2g} of the range " if deviation < math.inf else ""
    violation = f"; largest violation {size}at {worst} ({found[worst].words})" if deviation else ""
    words = f"holds on {holds} of {len(found)} members{spread(found)}{violation}"
    return Verdict(claim, UNDERDETERMINED if part else degree(deviation), found[worst].number, words)


def sampled(claim: Mapping[str, Any], found: Mapping[str, Finding]) -> Verdict:
    """The verdict over random members."""
    holds = sum(f.deviation <= PLOTTING_ACCURACY for f in found.values())
    share = holds / len(found)
    words = f"holds for {holds} of {len(found)} random members ({share:.3g}){spread(found)}"
    return Verdict(claim, REPRODUCED if share >= claim["over"]["share"] else CONTRADICTED, share, words)


def spread(found: Mapping[str, Finding]) -> str:
    """The range of the deciding number over the members, where there is one."""
    numbers = [finding.number for finding in found.values()]
    return f", {min(numbers):.6g} to {max(numbers):.6g}" if min(numbers) < max(numbers) else ""


def members(cases: Sequence[Case], over: Mapping[str, Any]) -> Iterator[tuple[str, list[Case]]]:
    """The variations of a claim's cases, all varied alike, each with a name."""
    fixed, grid = over["set"] or {}, over["grid"] or {}
    if over["random"] or over["start"]:
        random = np.random.default_rng(over["seed"])
        for i in range(over["members"]):
            limits = over["random"] or {}
            values = {path: float(random.uniform(low, high)) for path, (low, high) in limits.items()}
            varied = [changed(case, fixed | values) for case in cases]
            yield f"{i}", [thrown(case, over["start"], random) for case in varied] if over["start"] else varied
        return
    for combination in itertools.product(*grid.values()):
        values = dict(zip(grid, combination, strict=True))
        name = ", ".join(f"{path} = {value}" for path, value in values.items())
        yield name, [changed(case, fixed | values) for case in cases]


def changed(case: Case, values: Mapping[str, Any]) -> Case:
    """A case with other values at keys such as damping.2 or time.end, which it has; checked like any case.

    Raises HodoError for a value that it cannot have.
    """
    data: Any = case.data | {"time": asdict(case.time)}
    for path, value in values.items():
        data = put(data, [int(part) if part.isdecimal() else part for part in path.split(".")], value)
    time = Time(**data.pop("time"))
    return parse_case(dump(replace(case, data=data, time=time)))


def thrown(case: Case, axis: str, random: np.random.Generator) -> Case:
    """A case with a random start: G uniform on the unit sphere, or on the part of it that encloses an axis."""
    A = np.array(case.data["inertia"])
    while True:
        G = random.normal(size=3)
        omega = G / np.linalg.norm(G) / A
        if axis == "any" or rigid_body.LABELS[int(rigid_body.enclosed_axis(A, omega, ROUNDING))] == axis:
            initial = dict.fromkeys(case.data["initial"]) | dict(zip("pqr", omega.tolist(), strict=True))
            return replace(case, data=case.data | {"initial": initial})


MOTIONS: dict[str, Motion] = {}
"""The motions of variations, which several claims may share."""


def motion(case: Case) -> Motion:
    """The motion of a varied case. All variations come by here."""
    if (text := dump(case)) not in MOTIONS:
        MOTIONS[text] = quantities.integrate(case)
    return MOTIONS[text]


# Checks of sweeps, each of the one case that it names.


def census(claim: Mapping[str, Any], run: Run) -> Verdict:
    """The verdict on a claim about the members of one sweep. Raises HodoError if that has not what the check needs."""
    name, *others = claim["cases"]
    if others:
        raise HodoError(f"{run.path}: claim {claim['id']}: a check of kind {claim['check']['kind']} takes one case")
    if name not in run:
        return Verdict(claim, NOT_TESTED, math.nan, f"{name}: missing")
    group = run.read(name)
    sweep = parse_case(str(group.attributes["case"])).sweep
    if not sweep:
        raise HodoError(f"{run.path}: claim {claim['id']}: case {name} is no sweep")
    columns = {key: Labelled(each.dims, each.data, each.attributes) for key, each in group.variables.items()}
    try:
        finding = SWEPT[claim["check"]["kind"]](claim["check"], columns, list(sweep))
    except HodoError as error:
        raise HodoError(f"{run.path}: claim {claim['id']}: {error}") from error
    return Verdict(claim, degree(finding.deviation), finding.number, finding.words)


def averages(check: Mapping[str, Any], columns: Mapping[str, Labelled], axes: list[str]) -> Finding:
    """Averages over the members at some positions, their bounds and order; decided by the last of them."""
    found = [float(average(columns, axes, check["variable"], (), at)) for at in check["at"]]
    wrong = [check["least"] - x for x in found if check["least"] is not None]
    wrong += [x - check["most"] for x in found if check["most"] is not None]
    steps = [b - a for a, b in itertools.pairwise(found)]
    wrong += {"falls": steps, "rises": [-x for x in steps], "equal": [abs(x) - check["within"] for x in steps]}.get(
        check["sense"], []
    )
    size = max(map(abs, found)) or 1.0
    words = f"{check['variable']} = {', '.join(f'{x:.4g}' for x in found)}"
    return Finding(beyond(max(wrong, default=0.0) / size, ROUNDING), found[-1], words)


def extents(check: Mapping[str, Any], columns: Mapping[str, Labelled], axes: list[str]) -> Finding:
    """How much averages vary along two axes; decided by the ratio, which should exceed 1."""
    along = [average(columns, axes, check["variable"], (check[name],), {}) for name in ("larger", "smaller")]
    larger, smaller = (float(np.nanmax(values) - np.nanmin(values)) for values in along)
    ratio = larger / smaller if smaller else math.inf
    words = f"varies by {larger:.3g} along {check['larger']}, by {smaller:.3g} along {check['smaller']}"
    return Finding(beyond(1 - ratio, 0.0), ratio, words)


SWEPT = {"members": averages, "axes": extents}


# The kinds of check. Each takes its own keys and the motions of the claim's cases, in order.

Keys = Mapping[str, Any]


def axis(check: Keys, motions: Sequence[Motion]) -> Finding:
    """The axes enclosed at start and end; decided by the number of cases that comply."""
    ends = [[rigid_body.LABELS[int(label)] for label in m.enclosed[[0, -1]]] for m in motions]
    right = [all(check[at] in (None, seen) for at, seen in zip(("start", "end"), pair, strict=True)) for pair in ends]
    words = ", ".join(f"{start} to {end}" if start != end else start for start, end in ends)
    return Finding(0.0 if all(right) else math.inf, float(sum(right)), words)


def crossings(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Number and direction of the crossings of each case; decided by the largest number."""
    right, counts, words = True, [], []
    for m in motions:
        counts.append(len(m.crossings))
        right &= check["least"] <= len(m.crossings) <= (math.inf if check["most"] is None else check["most"])
        for _, start, end, _ in m.crossings:
            right &= check["from"] in (None, rigid_body.LABELS[start]) and check["to"] in (None, rigid_body.LABELS[end])
        passages = [f"{time:.12g} ({rigid_body.LABELS[a]} to {rigid_body.LABELS[b]})" for time, a, b, _ in m.crossings]
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
            worst = max(worst, beyond(differences[-1] / scale, check["within"] * (1 + ROUNDING) / scale))
    return Finding(worst, float(np.max(differences)), "; ".join(words))


def size(m: Motion, name: str) -> float:
    """The range of a quantity, zero included; of a single number its size."""
    values = m[name] if name in SERIES else np.array([m.number(name)])
    return max(float(np.max(values, initial=0) - np.min(values, initial=0)), math.ulp(0))


def listed(values: Sequence[float]) -> str:
    """Numbers to six digits."""
    return ", ".join(f"{value:.6g}" for value in values)


def bound(check: Keys, motions: Sequence[Motion]) -> Finding:
    """A quantity against a bound; decided by its value nearest to the bound, or farthest beyond."""
    name, least, most = check["of"], check["least"], check["most"]
    everywhere = check["at"] == "always" and name in SERIES
    found = [m[name] if everywhere else np.array([m.number(name, check["at"])]) for m in motions]
    low, high = float(np.min([f.min() for f in found])), float(np.max([f.max() for f in found]))
    number = high if most is not None else low
    violation = float(np.max([-math.inf if most is None else high - most, -math.inf if least is None else least - low]))
    scale = max(max(size(m, name) for m in motions), abs(most or 0), abs(least or 0))
    words = f"{name} from {low:.6g} to {high:.6g}" if everywhere else f"{name} = {listed([float(f[0]) for f in found])}"
    return Finding(beyond(violation / scale, ROUNDING), number, words)


def monotone(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Quantities that only fall or only rise; decided by the largest violation relative to the range."""
    sign = 1 if check["sense"] == "falls" else -1
    worst, words = 0.0, []
    for m in motions:
        for name in check["of"]:
            values = sign * m[name]
            back = values - np.minimum.accumulate(values)
            if violation := beyond(float(back.max()) / size(m, name), ROUNDING):
                worst = max(worst, violation)
                words.append(f"{name} goes back by {violation:.2g} of its range at {m.time[back.argmax()]:.4g}")
    return Finding(worst, worst, "; ".join(words) or f"{', '.join(check['of'])}: no step back")


def order(check: Keys, motions: Sequence[Motion]) -> Finding:
    """How values follow each other; decided by the smallest step or, for equal ones, by how far they are apart."""
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
    changes = [float(np.ptp(m[name]) / np.abs(m[name]).max()) for m in motions for name in check["of"]]
    worst = float(np.max(changes))
    words = f"{', '.join(check['of'])}: relative change {listed(changes)}"
    return Finding(beyond(worst, check["within"]), worst, words)


def closed_form(check: Keys, motions: Sequence[Motion]) -> Finding:
    """A formula beside the motion; decided by the largest difference relative to the largest value."""
    pairs = [pair for m in motions for pair in m.formula(check["form"])]
    apart = [float(np.max(np.abs(a - b), initial=0) / np.max(np.abs(a), initial=math.ulp(0))) for a, b in pairs]
    worst = float(np.max(apart))
    deviation = beyond(worst, check["within"])
    if check["differs"] == "yes":
        deviation = 0.0 if deviation else math.inf
    return Finding(deviation, worst, f"differs by {worst:.2g}")


def event(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Whether an event happens in finite time; decided by the latest time."""
    times = [next((time for kind, time in m.events if kind == check["event"]), math.inf) for m in motions]
    right = all((time < math.inf) == (check["happens"] == "yes") for time in times)
    return Finding(0.0 if right else math.inf, max(times), f"{check['event']} at {listed(times)}")


def convergence(check: Keys, motions: Sequence[Motion]) -> Finding:
    """Pairs of a limit and a case with epsilon: the power at which their difference falls; decided by the smallest."""
    powers, words = [], []
    for limit, full in zip(motions[::2], motions[1::2], strict=True):
        time = {"time": asdict(limit.case.time)}
        near = [motion(changed(full.case, time | {"epsilon": epsilon})) for epsilon in check["epsilon"]]
        for name in check["of"]:
            errors = [float(np.abs(m[name] - limit[name]).max()) for m in near]
            logs = np.diff(np.log(errors)) / np.diff(np.log(check["epsilon"]))
            powers.append(float(logs.min()))
            words.append(f"{name} {', '.join(f'{error:.3g}' for error in errors)}")
    least = min(powers)
    return Finding(0.0 if least >= 0.9 * check["order"] else math.inf, least, f"power {least:.3g}: {'; '.join(words)}")


def effect(check: Keys, motions: Sequence[Motion]) -> Finding:
    """The mean effects of two factors on a quantity; decided by the ratio of the larger, as said, to the other."""
    low, first, second, both = (m.number(check["of"], check["at"]) for m in motions)
    effects = abs(first - low + both - second) / 2, abs(second - low + both - first) / 2
    larger, other = effects if check["larger"] == "first" else effects[::-1]
    words = f"{check['of']}: {listed([low, first, second, both])}, effects {listed(effects)}"
    return Finding(0.0 if larger > other else math.inf, larger / other if other else math.inf, words)


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

COLUMNS = ("id", "where", "statement", "verdict", "expect", "evidence", "measured", "note")
"""What is stored of a claim as text, besides the number."""


def row(verdict: Verdict) -> dict[str, Any]:
    """A verdict as plain data."""
    claim = verdict.claim
    texts = {name: claim[name] for name in ("id", "where", "statement", "expect", "measured", "note")}
    found = {"verdict": verdict.verdict, "evidence": verdict.evidence, "number": verdict.number}
    return {**texts, **found, "kind": claim["check"]["kind"], "cases": list(claim["cases"])}


def group(verdicts: Sequence[Verdict]) -> Group:
    """Verdicts as they are stored: texts and `number` over the dimension `claim`, whose coordinate is the id."""
    rows = [row(verdict) for verdict in verdicts]
    names = {"claim": "id", **{name: name for name in COLUMNS[1:]}}
    texts = {
        name: Variable(("claim",), np.array([row[key] for row in rows], dtype=object), {"long_name": name})
        for name, key in names.items()
    }
    numbers = np.array([row["number"] for row in rows], dtype=float)
    return Group({}, {**texts, "number": Variable(("claim",), numbers, {"long_name": "the number that decides"})})
