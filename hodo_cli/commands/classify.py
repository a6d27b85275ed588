"""`hodo classify`: labels and crossings of stored cases."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import HodoError
from ..batch import check_memory
from ..cases.case import Case, dump
from ..cases.config import Config
from ..cases.keys import METHODS
from ..engines.protocol import Status
from ..integration import Classification, classify, label_at_start
from ..models import rigid_body
from ..progress import Progress
from ..quantities import MOMENTUM
from ..results.groups import label_group
from ..results.layout import RECORDED, sentence_of_case, units_of_case, without_old_labels
from ..results.motion import Motion, case_of
from ..results.resume import package_digest, results_named, warn_of_changes
from ..storage import Group, Update, history_line, typed, update
from ..text import abridged, few, grouped, magnitude, table, to_error


def classify_results(paths: Iterable[Path]) -> tuple[list[dict[str, Any]], list[str]]:
    """Label the cases of result files, or of the results of configs. Returns the lines of the table
    and a sentence for each case that cannot be labelled; the other cases are labelled all the same.

    Raises HodoError if a file cannot be read or replaced.
    """
    rows, problems = [], []
    for path, config in results_named(paths):
        with (
            update(path, history_line(f"hodo classify {path}")) as changes,
            Progress(len(changes.run.cases())) as progress,
        ):
            warn_of_changes(changes.run, config)
            for name in progress.through(changes.run.cases()):
                try:
                    rows.append({"run": str(path), **labelled_case(name, changes, config)})
                except HodoError as error:
                    # Refusals of the file itself begin with its path.
                    words = str(error).removeprefix(f"{path}: ")
                    owner = "" if words.startswith(name) else f"{name}: "
                    problems.append(f"{path}: {owner}{words}")
                except (LookupError, RuntimeError, ValueError) as error:
                    problems.append(f"{path}: {name} is damaged ({error!r})")
    return rows, problems


def labelled_case(name: str, changes: Update, config: Config | None) -> dict[str, Any]:
    """The line of a stored case, which is labelled if it is not yet. Raises HodoError as
    `classified` does."""
    stored_row = changes.run.report(name, package_digest())
    if stored_row is not None:
        return dict(stored_row)
    group = changes.run.read(name)
    case = config.cases.get(name) if config else None
    # Parsing a short case takes a tenth of the time of labelling it.
    if case is None or dump(case) != group.attributes.get("case"):
        case = case_of(group.attributes, name)
    labels, row = classified(name, group, case)
    changes.write(name, (labels or Group({}, {})).with_report(package_digest(), row))
    return row


def classified(name: str, group: Group, case: Case) -> tuple[Group | None, dict[str, Any]]:
    """The group that `classify` adds to a stored case (None if the case has no labels of its own),
    and the line of the table.

    Raises HodoError as `integration.classify` does.
    """
    recorded = typed(group.attributes, RECORDED, name)
    if case.sweep:
        return None, row_of_sweep(case, group)
    message = str(group.attributes.get("message", ""))
    ended_early = [message] if message and group.attributes.get("status") == Status.OK else []
    if remark := why_unlabelled(case, group):
        unlabelled = {"case": name, "start": "-", "end": "-", "unlabelled": remark}
        return None, unlabelled | {"crossings": [], "warnings": [remark, *ended_early]}
    if recorded["method"] not in METHODS:
        raise HodoError(f"{name}: this hodo has no method {recorded['method']!r}: run it again")
    motion = Motion(case, group.variables, label=name)
    labelled = classification_of(motion, recorded)
    row = row_of_motion(motion, labelled) | {"events": events_of(motion, labelled)}
    if (status := group.attributes.get("status")) != Status.OK:
        # An interrupted motion does not end with its last label.
        row["warnings"].append(f"{status}: to t = {case.time.text(motion.time[-1])} only")
    return label_group(labelled, case), row


def classification_of(motion: Motion, recorded: Mapping[str, Any]) -> Classification:
    """The labels and crossings of a stored motion: a quadrature has stored them; any other motion
    is integrated again, as it was `recorded`. Raises HodoError if its samples are no vectors."""
    if motion.case.system.is_quadrature:
        return Classification(motion.labels, motion.crossings)
    omega = motion.data["omega"].data
    if omega.dtype.kind != "f" or omega.shape != (len(motion.time), 3):
        raise HodoError(f"{motion.label} is damaged (its omega holds no vectors)")
    # Classifying may take five times the memory of integrating: labels and crossings are found in
    # long double.
    check_memory(motion.case)
    return classify(
        motion.case, recorded["method"], recorded["tol"], recorded["error"], np.asarray(omega)
    )


def events_of(motion: Motion, labelled: Classification) -> list[dict[str, Any]]:
    """The events of a stored motion for the table. Each has its stored error or, if no error is
    stored, the one that the classification has measured."""
    errors = np.full(len(motion.events), math.nan)
    if "event_error" in motion.data:
        errors = np.atleast_1d(motion.stored("event_error"))
    if np.isnan(errors).all() and len(labelled.events) == len(errors):
        errors = np.array([event.error for event in labelled.events])
    return [
        {"kind": kind, "time": time, "error": error}
        for (kind, time), error in zip(motion.events, errors.tolist(), strict=True)
    ]


def row_of_motion(motion: Motion, labelled: Classification) -> dict[str, Any]:
    """The line of a labelled motion in the table."""
    case, names = motion.case, rigid_body.LABELS
    start = label_at_start(case, motion.time[0], labelled.labels, labelled.crossings)
    rates = () if labelled.growth is None else labelled.growth.tolist()
    crossings = [
        {
            "time": c.time,
            "error": c.error,
            "from": names[c.start],
            "to": names[c.end],
            "G": c.momentum,
        }
        for c in labelled.crossings
    ]
    return {
        "case": motion.label,
        "start": names[start],
        "end": names[int(labelled.labels[-1])],
        # There is no rate about the middle axis, nor for a body that does not turn.
        "growth": {names[i]: rate for i, rate in enumerate(rates, 1) if math.isfinite(rate)},
        "predictions": [sentence_of_case(words, case) for words in labelled.predictions],
        "crossings": crossings,
        "units": {
            "time": units_of_case("time", case),
            "G": units_of_case(MOMENTUM, case),
        },
        "warnings": list(labelled.warnings),
    }


def why_unlabelled(case: Case, group: Group) -> str:
    """Why a stored case has nothing to label; an empty string if it has."""
    if reason := case.system.no_axis_reason:
        return reason
    needed = "enclosed_axis" if case.system.is_quadrature else "omega"
    if needed not in group.variables:
        return f"{needed} is not stored"
    return "" if len(group.variables[needed].data) else "no samples are stored"


def row_of_sweep(case: Case, group: Group) -> dict[str, Any]:
    """The line of a stored sweep in the table of `classify`."""
    row: dict[str, Any] = {"case": case.name, "start": "-", "end": "-", "crossings": []}
    columns = {name: x.data for name, x in without_old_labels(group.variables).items()}
    if "status" not in columns:  # the sweep failed as a whole
        return {**row, "warnings": [f"{group.attributes['status']}: {group.attributes['message']}"]}
    ok = columns["status"] == Status.OK.code
    ends = {
        x: _shares(columns[f"{x}_axis"][ok]) for x in ("start", "end") if f"{x}_axis" in columns
    }
    return {**row, **ends, "warnings": [remark_on_crossings(case, columns, ok)]}


def remark_on_crossings(case: Case, columns: Mapping[str, np.ndarray], ok: np.ndarray) -> str:
    """How many members of a sweep that ended well cross, how often and when."""
    if "crossings" not in columns:
        return case.system.no_axis_reason or '"crossings", their number, is not stored'
    if reason := case.system.no_separatrix_reason:
        return reason
    counts = columns["crossings"]
    crossing = ok & (counts > 0)
    remark = f"{crossing.sum()} of {ok.sum()} members cross"
    if (most := counts[ok].max(initial=0)) > 1:
        remark += f", up to {most} times"
    if "crossing_time" in columns and crossing.any():
        quantiles = np.quantile(columns["crossing_time"][crossing], (0, 0.5, 1))
        first, median, last = map(case.time.text, quantiles)
        unit = "" if case.time.unit == "1" else f" {case.time.unit}"
        remark += f", first at {first} to {last}, median {median}{unit}"
    return remark


def _shares(labels: np.ndarray) -> str:
    """The fractions of the labels in percent, in words."""
    return ", ".join(
        f"{rigid_body.LABELS[label]} {100 * np.mean(labels == label):.3g} %"
        for label in (1, 2, 3, 0, -1)
        if (labels == label).any()
    )


def table_of_crossings(rows: Sequence[Mapping[str, Any]]) -> str:
    """A table of cases with the axes enclosed at start and end, the growth rates of a small tilt
    away from an axis, the axis that theory predicts for the end, and the crossings; below it, once
    for each reason, the cases without labels."""
    header = ("case", "start", "end", "growth of a tilt", "predicted", "crossings")
    lines = [crossings_line(row) for row in rows if row["warnings"] != [row.get("unlabelled")]]
    names = grouped((row["unlabelled"], row["case"]) for row in rows if "unlabelled" in row)
    paragraphs = [table(header, lines, optional=header[3:])] if lines else []
    paragraphs += [f"no labels: {reason}: {few(cases)}" for reason, cases in names.items()]
    return "\n".join(paragraphs)


CROSSINGS_SHOWN = 5
"""The most crossings that the table shows of a case, which may have hundreds."""


def crossings_line(row: Mapping[str, Any]) -> tuple[str, ...]:
    """The line of a case in the table of crossings; of many crossings it has the first ones and the
    last."""
    growth = [f"{axis} {rate:+.6g}" for axis, rate in row.get("growth", {}).items()]
    predicted = "; ".join(row.get("predictions", ()))
    time_unit = row.get("units", {}).get("time", "1")
    unit = "" if time_unit == "1" else f" {time_unit}"
    crossings = [crossing_words(crossing, unit) for crossing in row["crossings"]]
    events = [event_words(event, unit) for event in row.get("events", ())]
    remarks = [remark for remark in row["warnings"] if remark != row.get("unlabelled")]
    passages = abridged(crossings, CROSSINGS_SHOWN, " (--json lists them)")
    return (
        *(row["case"], row["start"], row["end"], ", ".join(growth), predicted),
        "; ".join([*passages, *events, *remarks]),
    )


def event_words(event: Mapping[str, Any], unit: str) -> str:
    """One event of the motion itself: its time, with its error."""
    error = event["error"]
    error_words = "not measured" if math.isnan(error) else f"{magnitude(error)}{unit}"
    return f"{event['kind']} at {to_error(event['time'], error, 15)}{unit} (error {error_words})"


def crossing_words(crossing: Mapping[str, Any], unit: str) -> str:
    """One crossing: its time with its error, and the axes that it leaves and enters."""
    error, ends = magnitude(crossing["error"]), f"{crossing['from']} -> {crossing['to']}"
    return f"{crossing['time']:.15g}{unit} ({ends}, error {error}{unit})"
