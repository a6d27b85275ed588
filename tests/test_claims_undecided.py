"""Statements about axes where a brake stops the body, or a rotor leaves no axis."""

import json

import pytest

CASES = """
cases:
  s: {model: torques, inertia: [3, 2, 1], brake: 0.1, initial: {p: 1, q: 0.6, r: 0.9},
      time: {end: 60}}
  g: {model: torques, inertia: [3, 2, 1], damping: 0.01, rotor: [0, 0, 0.5],
      initial: {p: 1, q: 0.6, r: 0.9}, time: {end: 6, samples: 61}}
  sw: {model: torques, inertia: [3, 2, 1], damping: 0.01, rotor: [0, 0, 0.5], max_steps: 9999,
      initial: {p: 1, q: 0.6, r: 0.9}, time: {end: 6}, sweep: {initial.q: {linspace: [0.1, 1, 4]}}}
claims:
"""
STATEMENTS = {
    "[s], check: {kind: axis, end: x1}, over: {brake: {values: [0.1, 0.2]}}": "reproduced",
    "[{case: s, brake: 0.11}], check: {kind: axis, start: x1, end: x1}": "reproduced",
    "[{case: s, brake: 0.11}], check: {kind: axis, end: x3}": "contradicted",
    "[g], check: {kind: crossings, most: 0}": "not tested",
    "[{case: g, damping: 0.02}], check: {kind: crossings, most: 0}": "not tested",
    "[g], check: {kind: bound, of: turns, least: 1}": "not tested",
    "[g], check: {kind: bound, of: visible_turns_x1, least: 1}": "not tested",
    "[g], check: {kind: axis, start: x1}": "not tested",
    "[sw], check: {kind: average, variable: end_axis.x1, most: 0.1}": "not tested",
    "[sw], check: {kind: average, variable: crossings, most: 0}": "not tested",
    "[sw], check: {kind: average, variable: omega.x1, least: 0}": "reproduced",
}
FIGURES = """
figures:
  axis: {kind: curve, cases: [sw], x: initial.q, variable: end_axis.x1}
"""


@pytest.fixture
def verdicts(hodo, tmp_path):
    claims = [
        f"  - {{id: c{i}, where: W, statement: S, expect: reproduced, cases: {text}}}\n"
        for i, text in enumerate(STATEMENTS)
    ]
    (tmp_path / "a.yaml").write_text(CASES + "".join(claims) + FIGURES)
    assert hodo("run", "a.yaml").returncode == 0
    assert hodo("classify", "a.yaml").returncode == 0
    return json.loads(hodo("claims", "a.yaml", "--json").stdout)["statements"]


def test_nothing_is_said_of_axes_that_a_rotor_leaves_open(verdicts, hodo):
    """And a body that a brake stops ends with the axis that it has until then."""
    assert [row["verdict"] for row in verdicts] == [*STATEMENTS.values()]
    for row in verdicts:
        if row["verdict"] == "not tested":
            assert "with a rotor D says nothing" in row["evidence"]
    drawn = hodo("plot", "a.yaml")
    assert drawn.returncode == 1
    assert "axis: case sw: with a rotor D says nothing" in drawn.stderr


def test_a_page_of_verdicts_counts_what_it_does_not_say_in_full(hodo, tmp_path):
    """Of five statements that are contradicted, three are told in full."""
    statement = "S, expect: reproduced, cases: [s], check: {kind: axis, end: x3}"
    claims = [f"  - {{id: c{i}, where: W{i}, statement: {statement}}}\n" for i in range(5)]
    (tmp_path / "a.yaml").write_text(CASES + "".join(claims))
    hodo("run", "a.yaml", "--case", "s")
    hodo("classify", "a.yaml")
    page = hodo("claims", "a.yaml", "--markdown").stdout
    assert page.startswith("5 statements: 5 contradicted.\n")
    assert page.count("**Contradicted**") == 3
    assert "\n- 2 more, in the table of every statement\n" in page
