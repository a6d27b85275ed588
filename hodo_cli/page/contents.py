"""The section of one result as plain data: texts, numbers and names of files, and no HTML."""

import struct
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import HodoError
from ..cases.case import Case
from ..cases.claim_block import cases_of
from ..cases.config import Config
from ..cases.figure_block import DrawnFigure
from ..cases.sweep_block import axes_of
from ..machine import relative_path
from ..models.rigid_body import LABELS
from ..results.dataset import StoredCases, motion_from
from ..results.motion import Motion
from ..results.resolution import OF_SAMPLES, coarse_curves
from ..sweeps.view import ANGLES, round_degrees
from ..text import counted, magnitude
from .stored import Section


@dataclass(frozen=True)
class PageResult:
    """What the page shows of one result: its cases, its config, and the figures just drawn."""

    cases: StoredCases
    config: Config
    figures: Sequence[DrawnFigure]


def section_of(result: PageResult, folder: Path) -> Section:
    """The section of a result in the shape of `stored.SECTION`, with files relative to the folder
    of the page. Warns of damaged cases and verdicts, which it leaves out."""
    cases, config, motions = result.cases, result.config, dict[str, Motion]()
    for name in cases:
        with left_out_if_damaged():
            motions[name] = motion_from(cases[name], name)
    return {
        "name": cases.path.stem,
        "title": config.title or cases.path.name,
        "references": config.references,
        "file": relative_path(cases.path, folder),
        # The misprints that a case file lists are those of a paper.
        "paper": bool(config.errata),
        "figures": [
            figure_entry(figure, config.figures[figure.name], motions, folder)
            for figure in result.figures
        ],
        "statements": [*judged_entries(cases, "_claims", config.claims)],
        "errata": [*judged_entries(cases, "_errata", config.errata)],
        "cases": [case_entry(motion) for motion in motions.values()],
    }


@contextmanager
def left_out_if_damaged() -> Iterator[None]:
    """Warn of a group that cannot be read, and go on without it."""
    try:
        yield
    except HodoError as error:
        warnings.warn(str(error), stacklevel=3)


def figure_entry(
    figure: DrawnFigure, spec: Mapping[str, Any], motions: Mapping[str, Motion], folder: Path
) -> Section:
    """A figure with its caption, its files, and the cases that it shows."""
    shown = [motions[name] for name in spec.get("cases", ()) if name in motions]
    assumed = [f"{key}: {text}" for motion in shown for key, text in motion.case.assumes.items()]
    singles = [motion for motion in shown if motion.sampled and not motion.case.sweep]
    remarks = coarse_curves(spec, singles) if spec["kind"] in OF_SAMPLES else []
    pictures = [file for file in figure.files if file.suffix == ".png"]
    return {
        "name": figure.name,
        "caption": " ".join(filter(None, [spec["caption"], *remarks])),
        "about": described_by_kind(spec, shown),
        "problem": figure.problem,
        "files": [relative_path(file, folder) for file in figure.files],
        "size": picture_size(pictures[0]) if pictures else (),
        "assumed": [*dict.fromkeys(assumed)],
        "cases": [*spec.get("cases", ())],
    }


def picture_size(picture: Path) -> tuple[int, int]:
    """Width and height of a PNG, in pixels."""
    # The first chunk of every PNG begins with its size, so that no library has to decode it.
    with open(picture, "rb") as file:
        width, height = struct.unpack(">II", file.read(24)[16:])
    return int(width), int(height)


KINDS_IN_WORDS = {
    "hodograph": "Hodograph of the angular momentum in body axes",
    "sphere": "Curves of the direction of angular momentum on the unit sphere",
    "herpolhode": "Curve of the angular velocity in space, across the angular momentum",
    "axis-trace": "Curves of the directions of body axes in space, on the unit sphere",
    "body": "The body in space at some moments, with its angular momentum and velocity",
    "quadrants": "Squares of two angular velocities, with the regions of both enclosed axes",
    "quadrant-sketch": "Sketch of the regions of both enclosed axes",
    "series": "Curves over time",
    "phase": "One variable against another",
    "invariants": "Energy, squared momentum and D/2T over time, within their bounds",
    "map": "Map of a sweep",
    "curve": "Curves of a sweep",
}
"""What each kind of figure shows, for a reader who cannot see it."""


def described_by_kind(spec: Mapping[str, Any], shown: Sequence[Motion]) -> str:
    """What a picture shows, in words: its kind, variables, cases and crossings."""
    parts = [KINDS_IN_WORDS[spec["kind"]]]
    if names := spec.get("variables") or spec.get("variable"):
        parts.append(names if isinstance(names, str) else ", ".join(names))
    if spec["kind"] == "phase":
        parts.append(f"{spec['y']} over {spec['x']}")
    if spec.get("cases"):
        parts.append(f"case{'s' * (len(spec['cases']) > 1)} {', '.join(spec['cases'])}")
    if len(shown) == 1 and (ends := end_axes(shown[0])):
        crossings = counted(len(shown[0].crossings), "crossing")
        parts.append(
            f"encloses {ends[0]} first and {ends[1]} last, with {crossings} of the separatrix"
        )
    return "; ".join(parts)


def end_axes(motion: Motion) -> list[str]:
    """The axes enclosed at start and end; none of a motion without labels."""
    labels = motion.labels if motion.classified else ()
    return [LABELS[int(labels[i])] for i in (0, -1)] if len(labels) else []


VERDICT_COLUMNS = (
    *("claim", "where", "statement", "original", "printed", "should_be", "verdict", "evidence"),
    *("contradicted_by", "theorem", "measured", "note"),
)


def judged_entries(
    cases: StoredCases, group: str, entries: Iterable[Mapping[str, Any]]
) -> Iterator[Section]:
    """The statements or misprints that `hodo claims` has judged, with their verdicts as a group
    holds them, and their entries in the config; none before `hodo claims`."""
    if group not in cases:
        return
    with left_out_if_damaged():
        stored, about = cases[group].variables, {entry["id"]: cases_of(entry) for entry in entries}
        for i in range(stored["claim"].size):
            # Verdicts of an earlier version have fewer texts, and those of misprints others.
            texts = {
                name: str(stored[name].data[i]) if name in stored else ""
                for name in VERDICT_COLUMNS
            }
            notes = [*filter(None, (texts.pop(key) for key in ("theorem", "measured", "note")))]
            name, text = texts.pop("claim"), texts.pop("statement") or texts.pop("printed")
            yield {
                **texts,
                "name": name,
                "text": text,
                "notes": notes,
                "cases": [*about.get(name, ())],
            }


def case_entry(motion: Motion) -> Section:
    """A case with its parameters, errors, enclosed axes and crossings."""
    attrs, ends = motion.attrs, end_axes(motion)
    notes = [
        "" if attrs["status"] == "ok" else f"{attrs['status']}: {attrs['message']}",
        *(f"assumed {key}: {text}" for key, text in motion.case.assumes.items()),
        *(motion.case.note, *str(attrs["warnings"]).splitlines()),
    ]
    return {
        "name": motion.name,
        "model": f"{attrs['model']}, {attrs['form']}",
        "method": str(attrs["method"]),
        "steps": str(attrs["steps"]),
        "error": float(attrs["error"]),
        "error_kind": str(attrs["error_kind"]),
        "run_time": float(attrs["run_time"]),
        "parameters": parameters(motion.case),
        "notes": [*filter(None, notes)],
        "ends": ends,
        "crossings": [
            [
                f"{crossing.time:.15g}",
                magnitude(crossing.error),
                LABELS[crossing.start],
                LABELS[crossing.end],
                f"{crossing.momentum:.6g}",
            ]
            for crossing in (motion.crossings if ends else ())
        ],
    }


def parameters(case: Case) -> str:
    """The data of a case in one line, without the keys that it leaves out; those of the first
    member of a sweep, and what varies."""
    words = [f"{key} {_plain(value)}" for key, value in case.data.items() if value is not None]
    words.append(f"time {case.time.start:g} to {case.time.end:g}")
    for axis in axes_of(case.sweep or {}):
        words.append(f"{counted(len(axis), 'value')} of {' with '.join(axis.keys) or axis.name}")
    return "; ".join(words)


def _plain(value: Any, key: str = "") -> str:
    """A value as text: numbers to 12 digits, lists in brackets, mappings as key = value."""
    if isinstance(value, Mapping):
        return ", ".join(
            f"{key} = {_plain(item, key)}" for key, item in value.items() if item is not None
        )
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_plain, value))})"
    if key in ANGLES and isinstance(value, float):
        degrees = round_degrees(value)
        return f"{value:.12g}" if degrees is None else f"{degrees:g} deg"
    return f"{value:.12g}" if isinstance(value, float) else str(value)
