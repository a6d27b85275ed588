"""Try the limits that no text gives at both ends of the ranges that docs/papers.md states for them:
no verdict on the papers may change.

Run as `python tools/limits.py FOLDER`; the results of the papers come into FOLDER.
Exit status 1 where a verdict is another, or the document states another range.
"""

import contextlib
import importlib
import shutil
import sys
from pathlib import Path
from typing import Any

import yaml
from click.testing import CliRunner

from hodo_cli.cli import main

ROOT = Path(__file__).parents[1]
VISIBLE = "hodo_cli.claims.measures.VISIBLE_MOMENTUM"
LIMITS = [
    ("paper1", "most", [0.075, 0.168], "fig10-area fig16-area"),
    ("paper1", "least", [0.075, 0.168], "fig11-area fig18-area"),
    ("paper1", "most", [0.0003, 0.04], "fig1-curves-3-4"),
    ("paper1", VISIBLE, [0.01, 0.3], "fig14-character x1-start-never-explicitly-x3"),
    ("paper1", VISIBLE, [0.01, 0.15], "fig16-turns"),
    ("paper1", VISIBLE, [0.1, 0.3], "fig18-turns"),
    ("paper2", "within", [0.008, 0.2], "limits"),
    ("paper2", "hodo_cli.papers.paper2.SMALL_NUMBER", [0.003, 0.5], "small-Reynolds-number"),
    ("paper3", "hodo_cli.papers.paper3.NEAR_LIMIT", [0.002, 0.05],
     "case1-u3-quickly case3-H-quickly"),
    ("paper3", "hodo_cli.claims.finding.PLOTTING_ACCURACY", [0.001, 0.05],
     "case1-u1-u2 case2-Gz-r-limit case2-H-limit case3-Gz case3-fall"),
]  # fmt: skip
"""A paper, a limit, by key of a check or by constant, its range, and what it decides."""


def hodo(folder: Path, *arguments: str) -> bool:
    """Whether a command ends well in a folder; what it says is printed where it does not."""
    with contextlib.chdir(folder):
        done = CliRunner().invoke(main, arguments)
    print(done.output if done.exit_code else "", end="")
    return done.exit_code == 0


def verdicts_as_expected(folder: Path, paper: str, sections: dict[str, Any]) -> bool:
    """Whether each claim of a case file has the verdict that it expects."""
    text = yaml.safe_dump(sections, allow_unicode=True, sort_keys=False)
    (folder / f"{paper}.yaml").write_text(text, encoding="utf-8")
    return hodo(folder, "claims", f"{paper}.yaml")


def try_limit(folder: Path, paper: str, limit: str, end: float, decided: str) -> bool:
    """Whether the statements that a limit decides have their verdicts at an end of its range."""
    sections = yaml.safe_load((ROOT / "configs" / f"{paper}.yaml").read_text(encoding="utf-8"))
    claims = [claim for claim in sections["claims"] if claim["id"] in decided.split()]
    sections["claims"] = claims
    named = {claim.get("erratum") for claim in claims}
    sections["errata"] = [erratum for erratum in sections["errata"] if erratum["id"] in named]
    if "." not in limit:
        for claim in claims:
            claim["check"][limit] = end
        return verdicts_as_expected(folder, paper, sections)
    module, _, name = limit.rpartition(".")
    owner = importlib.import_module(module)
    ours = getattr(owner, name)
    setattr(owner, name, end)
    try:
        return verdicts_as_expected(folder, paper, sections)
    finally:
        setattr(owner, name, ours)


def main_of_tool(folder: Path) -> None:
    """Try all limits, a line for each."""
    page = " ".join((ROOT / "docs" / "papers.md").read_text(encoding="utf-8").split())
    wrong = 0
    folder.mkdir(parents=True, exist_ok=True)
    for paper in sorted({paper for paper, *_ in LIMITS}):
        shutil.copy(ROOT / "configs" / f"{paper}.yaml", folder)
        hodo(folder, "run", f"{paper}.yaml", "--quiet")
        hodo(folder, "classify", f"{paper}.yaml")
    for paper, limit, ends, decided in LIMITS:
        stated = "| {:g} to {:g}".format(*ends) in page
        kept = [try_limit(folder, paper, limit, end, decided) for end in ends]
        print(f"{paper}: {limit} from {ends[0]:g} to {ends[1]:g}: {stated and all(kept)}")
        wrong += not (stated and all(kept))
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main_of_tool(Path(sys.argv[1]))
