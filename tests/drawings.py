"""Results of the case files that come with hodo, and their figures as a notebook draws them.

Where HODO_FUZZ is set, all figures of motions, and else a chosen dozen."""

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from conftest import ROOT, call

import hodo_cli as hodo


def entries_of(config: str) -> dict[str, dict[str, Any]]:
    """The figures of a case file that comes with hodo."""
    figures = yaml.safe_load((ROOT / "configs" / f"{config}.yaml").read_text("utf-8"))["figures"]
    return {name: entry for name, entry in figures.items() if entry.get("kind") != "map"}


CHOSEN = {
    "paper1": ["fig1", "fig4", "fig4-projections", "fig4-invariants", "fig5", "fig13"],
    "paper2": ["fig1", "phase"],
    "paper3": ["figure"],
    "attitude": ["herpolhode", "body-flip", "traces"],
    "torques": ["braked-with-fluid", "symmetric"],
}
"""Figures of every kind, layout and decoration, those of sweeps excepted."""

FIGURES = [
    (config, name)
    for config, chosen in CHOSEN.items()
    for name in (entries_of(config) if "HODO_FUZZ" in os.environ else chosen)
]


@cache
def results_in(folder: Path) -> Path:
    """A folder with the results of the cases of these figures, classified."""
    for name in CHOSEN:
        config = ROOT / "configs" / f"{name}.yaml"
        result = folder / f"{name}.h5"
        entries = [entries_of(name)[figure] for of, figure in FIGURES if of == name]
        cases = {case for entry in entries for case in entry.get("cases", ())}
        asked = [word for case in sorted(cases) for word in ("--case", case)]
        for command in (
            ["run", config, "--quiet", "--out", folder, *asked],
            ["classify", result],
        ):
            done = call(folder, *command)
            assert done.returncode == 0, done.stderr
    return folder


def drawn(folder: Path, config: str, name: str, **changes: Any) -> Any:
    """A figure of a case file from its result, some of its keys changed, once it is laid out."""
    entry = {**entries_of(config)[name], **changes}
    figure = figure_of(hodo.open(folder / f"{config}.h5"), entry)
    figure.set_dpi(100)
    figure.draw_without_rendering()
    return figure


def figure_of(cases: Mapping[str, Any], entry: Mapping[str, Any]) -> Any:
    """The figure of an entry as a notebook draws it."""
    keys = {key: value for key, value in entry.items() if key not in ("cases", "scale_with")}
    named = entry.get("cases", ())
    names = [named] if isinstance(named, str) else named
    # A sketch draws bodies, and takes no cases.
    data = [cases[name] for name in names] or [cases[next(iter(cases))]]
    return hodo.plot(data, **keys)
