"""Figures of averaging: its error and its cost against the small parameter, and how many starts
cross the separatrix by a time."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .. import HodoError
from ..models.averaging.free_turn import Body
from ..models.averaging.passage import share_that_crosses
from ..results.dataset import Results
from ..results.motion import Motion
from ..sweeps.swept import Swept
from .artists import COLUMN, PAGE, case_handles, legend, styles
from .sheet import Sheet

MONTE_CARLO: dict[str, Any] = {"ls": "", "marker": "o", "ms": 2.5, "mfc": "white", "mew": 0.7}
"""How shares that are counted look, on the line of those that are calculated."""


def error_order(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """The largest relative distance of T and G^2 between two forms of a motion, against the small
    parameter, with the order of each group as the slope of its fit."""
    against = [results.motion(name) for name in spec["against"]]
    if len(against) != len(spec["cases"]):
        raise HodoError("`against` wants one case for each of `cases`, in their order")
    sheet.figure.set_size_inches(COLUMN, 0.85 * COLUMN)
    axes, names = sheet.figure.subplots(), []
    for label, small, motions in groups(spec, results):
        errors = np.array([forms_apart(m, against.pop(0)) for m in motions])
        # The order of an error is the slope of its logarithm.
        slope, start = np.polyfit(np.log(small), np.log(errors), 1)
        names.append(f"{label}, order {slope:.2f}")
        style = styles(len(names))[-1]
        axes.loglog(small, errors, marker="o", ms=3, color=style["color"], ls="")
        axes.loglog(small, np.exp(start) * small**slope, **style)
        sheet.record("error", label, {"small": small, "error": errors})
    axes.set(xlabel=f"${spec['parameter']}$", ylabel="largest relative error of $T$ and $G^2$")
    legend(sheet, case_handles(names), 1)


def groups(
    spec: Mapping[str, Any], results: Results
) -> Iterator[tuple[str, np.ndarray, list[Motion]]]:
    """Label, small parameters (n,) and motions of each group of a figure's cases.

    Raises HodoError unless the groups and the parameters have as many entries as there are cases.
    """
    motions = [results.motion(name) for name in spec["cases"]]
    if not sum(spec["groups"]) == len(spec["small"]) == len(motions):
        raise HodoError("`groups` wants sizes that add up to the cases, `small` a number for each")
    # A line is a run of cases, so that a figure reads them in the order in which it names them.
    ends = np.cumsum(spec["groups"])
    for i, (begin, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        label = spec["labels"][i] if i < len(spec["labels"]) else motions[begin].name
        yield label, np.array(spec["small"][begin:end]), motions[begin:end]


def forms_apart(motion: Motion, other: Motion) -> float:
    """The largest relative distance of T and of G^2 between two motions at the same times."""
    if not np.array_equal(motion.time, other.time):
        raise HodoError(f"cases {motion.name} and {other.name} are not stored at the same times")
    # G enters squared, as T does: then both have the same order and much the same size.
    return max(
        float(np.abs(motion["T"] / other["T"] - 1).max()),
        float(np.abs((motion["G"] / other["G"]) ** 2 - 1).max()),
    )


def cost(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """Steps and run time of groups of cases against the small parameter."""
    sheet.figure.set_size_inches(PAGE, 0.42 * PAGE)
    steps, seconds = sheet.figure.subplots(1, 2)
    names = []
    for label, small, motions in groups(spec, results):
        names.append(label)
        style = styles(len(names))[-1]
        taken = {what: np.array([m.attrs[what] for m in motions]) for what in ("steps", "run_time")}
        for axes, values in zip((steps, seconds), taken.values(), strict=True):
            axes.loglog(small, values, marker="o", ms=3, **style)
        sheet.record("cost", label, {"small": small, **taken})
    for axes, what in ((steps, "steps"), (seconds, "run time, s")):
        axes.set(xlabel=f"${spec['parameter']}$", ylabel=what)
    legend(sheet, case_handles(names), len(names))


def share(sheet: Sheet, spec: Mapping[str, Any], results: Results) -> None:
    """The share of starts that have crossed the separatrix by a time: the averaged closed form as
    lines, the starts of a sweep of full motions as points."""
    swept = Swept.of(spec["cases"][0], results.cases)
    body, sphere = swept.body(), swept.sphere()
    if body is None or not sphere or "crossing_time" not in swept.data or len(swept.axes) != 2:
        raise HodoError(
            "a figure of shares wants a sweep of one body with a sphere of starts, another axis, "
            "and crossing_time stored"
        )
    other = next(name for name in swept.axes if name != sphere)
    end = swept.case.time.end
    sheet.figure.set_size_inches(COLUMN, 0.95 * COLUMN)
    axes, names = sheet.figure.subplots(), []
    line, points = np.linspace(0, end, 101), np.linspace(0, end, 11)
    found = swept.values("crossing_time", [other, sphere], {})
    for i, times in enumerate(found):
        lam = damping_of(swept, other, i)
        names.append(rf"$10^3\lambda = {', '.join(f'{1e3 * x:g}' for x in lam)}$")
        style = styles(len(names))[-1]
        turning = Body.of(body.tolist())
        foreseen = share_that_crosses(turning, [lam[axis] for axis in turning.order], line)
        # A start that never crosses has no time, and no comparison with nan holds.
        counted = np.array([np.mean(times <= t) for t in points])
        axes.plot(line, foreseen, **style)
        axes.plot(points, counted, mec=style["color"], **MONTE_CARLO)
        sheet.record("share", names[-1], {"time": line, "averaged": foreseen})
        sheet.record("share", names[-1], {"time": points, "full": counted})
    axes.set(xlabel=f"${spec['time']}$", ylabel="share of starts that have crossed")
    axes.margins(x=0)
    legend(sheet, case_handles(names), 2)


def damping_of(swept: Swept, axis: str, i: int) -> list[float]:
    """lambda_1, lambda_2, lambda_3 at a position of an axis."""
    lam = list(swept.case.data["damping"])
    varied = swept.axis(axis)
    for of, (path, _) in enumerate(varied.ranges):
        if path[0] == "damping":
            lam[int(path[1])] = float(varied.values(of)[i])
    return lam
