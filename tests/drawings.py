"""Results of the case files that come with hodo, and their figures as a notebook draws them."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from conftest import ROOT, call

import hodo_cli as hodo

CASES = {"paper1": "*", "paper2": "*", "paper3": "*", "attitude": "*", "torques": "[!c]*"}
"""The case files whose figures tests draw, and their cases: a sweep takes seconds."""


def entries_of(config: str) -> dict[str, dict[str, Any]]:
    """The figures of a case file that comes with hodo."""
    figures = yaml.safe_load((ROOT / "configs" / f"{config}.yaml").read_text("utf-8"))["figures"]
    return {name: entry for name, entry in figures.items() if entry.get("kind") != "map"}


FIGURES = [(config, name) for config in CASES for name in entries_of(config)]


@cache
def results_in(folder: Path) -> Path:
    """A folder with the results of these case files, classified."""
    for name, cases in CASES.items():
        config = ROOT / "configs" / f"{name}.yaml"
        result = folder / f"{name}.h5"
        for command in (
            ["run", config, "--quiet", "--out", folder, "--case", cases],
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
