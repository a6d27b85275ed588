"""hodo without heyoka, as pip installs it on macOS and Windows: everything runs by collocation."""

import json
import os
from collections.abc import Sequence

import pytest
from conftest import ROOT, Hodo

pytestmark = pytest.mark.process

RTOL = 1e-8
"""A fault shows, and the other order of rounding of a long motion does not."""

PAPERS = [
    ("paper1", ["fig4", "fig16"]),
    ("paper2", ["fig[12]-as-printed", "internal-triaxial"]),
    ("paper3", ["case?", "case1-full"]),
]

CASES = """\
defaults: {inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 50}}
cases:
  tensor:
    model: torques
    inertia: [[1, 0.05, 0], [0.05, 0.8, 0], [0, 0, 0.6]]
    damping: 0.004
    attitude: yes
    time: {end: 20}
  swept:
    model: linear-diag
    damping: [0.005, 0.004, 0.003]
    sweep: {damping.2: {linspace: [0.001, 0.009, 2]}}
"""


WITHOUT = {"env": {**os.environ, "PYTHONPATH": str(ROOT / "tests" / "without_heyoka")}}
"""What a process gets that finds no heyoka."""


def all_went_well(hodo: Hodo, *commands: Sequence[str], **options: object) -> list[str]:
    """What commands print, each of which ends with status 0."""
    done = [hodo(*command, **options) for command in commands]
    assert [each.returncode for each in done] == [0] * len(commands), done
    return [each.stdout for each in done]


@pytest.mark.parametrize(("paper", "cases"), PAPERS)
def test_papers_are_those_of_the_references(hodo, paper, cases):
    chosen = [word for case in cases for word in ("--case", case)]
    run = ["run", paper, "--quiet", "--json", *chosen]
    ran, _ = all_went_well(hodo, run, ["classify", f"runs/{paper}.h5"], **WITHOUT)
    methods = {row["method"] for row in json.loads(ran)}
    assert "collocation" in methods <= {"collocation", "exact"}
    reference = ROOT / "runs" / "reference" / f"{paper}.h5"
    found = hodo("compare", f"runs/{paper}.h5", reference, "--rtol", RTOL, "--json")
    rows = [row for row in json.loads(found.stdout) if not row["place"].startswith("missing in")]
    assert len(rows) >= len(cases)
    assert not [row for row in rows if row["differs"]]


def test_a_full_tensor_an_attitude_and_a_sweep_are_those_of_the_series(hodo, tmp_path):
    (tmp_path / "few.yaml").write_text(CASES, encoding="utf-8")
    run = ["run", "few.yaml", "--quiet", "--json", "--out"]
    (ran,) = all_went_well(hodo, [*run, "here"], **WITHOUT)
    assert [row["method"] for row in json.loads(ran)] == ["collocation"] * 2
    compare = ["compare", "here/few.h5", "there/few.h5", "--rtol", str(RTOL)]
    all_went_well(hodo, [*run, "there"], compare)
