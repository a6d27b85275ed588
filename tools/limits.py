"""Try the limits that no text gives at both ends of the ranges that docs/papers.md states for them:
no verdict on the papers may change.

Run as `python tools/limits.py FOLDER`; the results of the papers come into FOLDER.
Exit status 1 where a verdict is another, or the document states another range.
"""

import contextlib
import os
import shutil
import sys
from pathlib import Path
from unittest import mock

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


def hodo(*arguments: str) -> bool:
    """Whether a command ends well; what it says is printed where it does not."""
    done = CliRunner().invoke(main, arguments)
    print(done.output if done.exit_code else "", end="")
    return done.exit_code == 0


def is_kept(paper: str, limit: str, end: float, decided: str) -> bool:
    """Whether the statements that a limit decides have their verdicts at an end of its range."""
    sections = yaml.safe_load((ROOT / "configs" / f"{paper}.yaml").read_text(encoding="utf-8"))
    claims = [claim for claim in sections["claims"] if claim["id"] in decided.split()]
    is_key = "." not in limit
    for claim in claims if is_key else ():
        claim["check"][limit] = end
    named = {claim.get("erratum") for claim in claims}
    errata = [erratum for erratum in sections["errata"] if erratum["id"] in named]
    text = yaml.safe_dump({**sections, "claims": claims, "errata": errata}, sort_keys=False)
    Path(f"{paper}.yaml").write_text(text, encoding="utf-8")
    with contextlib.nullcontext() if is_key else mock.patch(limit, end):
        return hodo("claims", f"{paper}.yaml")


def try_all(folder: Path) -> None:
    """Try each limit in a folder, a line for each."""
    page = " ".join((ROOT / "docs" / "papers.md").read_text(encoding="utf-8").split())
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)  # `hodo claims` looks for a result in runs/
    for paper in ("paper1", "paper2", "paper3"):
        shutil.copy(ROOT / "configs" / f"{paper}.yaml", ".")
        hodo("run", f"{paper}.yaml", "--quiet")
        hodo("classify", f"{paper}.yaml")
    right = []
    for paper, limit, ends, decided in LIMITS:
        right.append("| {:g} to {:g}".format(*ends) in page)
        right[-1] &= all(is_kept(paper, limit, end, decided) for end in ends)
        print(f"{paper}: {limit} from {ends[0]:g} to {ends[1]:g}: {right[-1]}")
    sys.exit(not all(right))


if __name__ == "__main__":
    try_all(Path(sys.argv[1]))
