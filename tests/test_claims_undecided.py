"""Statements about motions that stop, and about bodies without an enclosed axis."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import Hodo

BODY = "model: torques, inertia: [3, 2, 1], initial: {p: 1, q: 0.6, r: 0.9}, time: {end: 60}"
BRAKED = f"{{{BODY}, brake: 0.1}}"
ROTOR = f"{{{BODY}, damping: 0.1, rotor: [0, 0, 0.5]}}"
SWEPT = f"{ROTOR[:-1]}, sweep: {{initial.q: {{values: [0.1, 0.6]}}}}}}"


@pytest.fixture
def judged(hodo: Hodo, tmp_path: Path) -> Callable[..., Any]:
    """What `hodo claims` prints of statements about the case `s`, and its exit status."""

    def judge(case: str, *claims: str, more: str = "", flags: str = "") -> Any:
        entries = "".join(
            f"  - {{id: c{i}, where: s, statement: text {i}, {claim}}}\n"
            for i, claim in enumerate(claims)
        )
        (tmp_path / "s.yaml").write_text(f"cases:\n  s: {case}\n{more}claims:\n{entries}")
        assert hodo("run", "s.yaml").returncode == 0
        assert hodo("classify", "runs/s.h5").returncode == 0
        return hodo("claims", "s.yaml", *flags.split())

    return judge


def test_a_motion_that_a_brake_stops_has_an_axis_where_a_statement_declares_it(judged: Any) -> None:
    keys = [
        "cases: [{case: s, brake: 0.11}], check: {kind: axis, end: x1}",
        "cases: [{case: s, damping: [0.1, 0.2, 0.1]}], check: {kind: axis, start: x1}",
        "cases: [s], over: {brake: {values: [0.1, 0.2]}}, check: {kind: axis, end: x1}",
        "cases: [s], over: {brake: {values: [0.1]}}, check: {kind: axis, start: x1, turns: 0.1}",
    ]
    done = judged(BRAKED, *(f"{key}, expect: reproduced" for key in keys))
    assert (done.returncode, done.stderr) == (0, "")
    assert "4 statements: 4 reproduced" in done.stdout


def test_a_rotor_decides_nothing_about_axes_crossings_and_turns(judged: Any) -> None:
    checks = [
        "{kind: axis, start: x1}",
        "{kind: crossings, most: 0}",
        "{kind: bound, of: crossings, most: 0}",
        "{kind: bound, of: turns, least: 1}",
        "{kind: bound, of: visible_turns_x3, most: 1}",
    ]
    keys = (f"cases: [s], check: {check}, expect: not tested" for check in checks)
    done = judged(ROTOR, *keys)
    assert done.returncode == 0
    assert done.stdout.count("with a rotor D says nothing") == len(checks)


def test_a_rotor_leaves_averages_and_maps_of_axes_undecided(judged: Any, hodo: Hodo) -> None:
    checks = [
        "{kind: average, variable: end_axis.x1, most: 0.1}",
        "{kind: average, variable: start_axis.x3, least: 0.9}",
        "{kind: average, variable: crossings, most: 0}",
    ]
    keys = (f"cases: [s], check: {check}, expect: not tested" for check in checks)
    drawn = "{kind: curve, cases: s, variable: end_axis.x1, x: initial.q}"
    done = judged(SWEPT, *keys, more=f"figures: {{m: {drawn}}}\n")
    assert done.returncode == 0
    assert done.stdout.count("with a rotor D says nothing") == len(checks)
    plotted = hodo("plot", "s.yaml")
    assert plotted.returncode == 1
    assert "no separatrix to be drawn: with a rotor D says nothing" in plotted.stderr


def test_a_share_of_an_axis_leaves_out_members_without_one(judged: Any) -> None:
    # At rest G goes round nothing; the other member stays about x1.
    at_rest = (
        "{model: torques, inertia: [3, 2, 1], damping: 0, initial: {p: 1, q: 0, r: 0},"
        " time: {end: 1}, sweep: {initial.p: {values: [0, 1]}}}"
    )
    check = "{kind: average, variable: end_axis.x1, least: 1}"
    done = judged(at_rest, f"cases: [s], check: {check}, expect: reproduced")
    assert done.returncode == 0
    assert "end_axis.x1 = 1, 1 of 2 members have none" in done.stdout


def test_the_page_drops_no_verdict(judged: Any) -> None:
    check = "cases: [s], check: {kind: conserved, of: [T]}, expect:"
    claims = [f"{check} {word}" for word in (*["contradicted"] * 4, "reproduced")]
    page = judged(BRAKED, *claims, flags="--markdown").stdout
    assert page.startswith("5 statements: 5 contradicted.\n")
    told = page.partition("<details>")[0]
    assert all(f"text {i} **Contradicted" in told for i in range(5))
    assert "text 4 **Contradicted (expected: reproduced)**" in told
