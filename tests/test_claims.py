"""What the papers say: the kinds of check, the verdicts, and that every claim gets the one
expected."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, Hodo

from hodo_cli import HodoError
from hodo_cli.cases import claim_block
from hodo_cli.cases.case import Case
from hodo_cli.cases.claim_block import (
    AS_PRINTED,
    BY_READING,
    CONTRADICTED,
    NOT_TESTED,
    PLOTTING,
    REPRODUCED,
    UNDERDETERMINED,
    readings,
)
from hodo_cli.cases.config import load, parse
from hodo_cli.cases.sweep_block import SWEEP
from hodo_cli.claims import quantities, variations
from hodo_cli.claims.checks import MOTION_CHECKS
from hodo_cli.claims.finding import Finding, Verdict, erratum
from hodo_cli.claims.quantities import number
from hodo_cli.claims.variations import Motions, changed, members
from hodo_cli.claims.verdicts import Judge, gridded, sampled, together
from hodo_cli.commands import claims
from hodo_cli.engines import have_taylor
from hodo_cli.integration.crossings import Crossing
from hodo_cli.integration.trajectory import Occurrence
from hodo_cli.papers import catalogue_of_checks, paper1, paper2
from hodo_cli.results import layout
from hodo_cli.results.motion import QUANTITIES, Motion, forms_apart
from hodo_cli.storage.group import Variable
from hodo_cli.storage.hdf5 import open_run
from hodo_cli.sweeps.members import member

PAPERS = ("paper1", "paper2", "paper3")
TOP = load(ROOT / "configs" / "paper3.yaml").cases["case1"]
BODY = load(ROOT / "configs" / "paper1.yaml").cases["fig4"]


def motion(
    labels: list[int] | None = None, passages: Any = (), events: Any = (), **series: Any
) -> Motion:
    """A motion of the top whose variables are made up."""
    n = max([len(values) for values in series.values()], default=2)
    variables = {"time": layout.TIME.holding(np.arange(n))}
    variables |= {name: Variable(("time",), np.array(v, float)) for name, v in series.items()}
    if labels:
        found = [Crossing(*passage) for passage in passages]
        variables |= layout.label_variables(np.array(labels), found)
    occurrences = [Occurrence(kind, time) for kind, time in events]
    return Motion(TOP, variables | layout.columns_of(layout.EVENT_COLUMNS, occurrences))


def test_two_forms_of_a_motion_are_compared_at_the_same_times() -> None:
    one = motion(kinetic_energy=[1, 3], momentum=[2, 1])
    other = motion(kinetic_energy=[1, 2], momentum=[1, 1])
    # Of G^2, (2/1)^2 - 1; of T, 3/2 - 1.
    assert forms_apart(one, other).tolist() == [3, 0.5]
    with pytest.raises(HodoError, match="not stored at the same times"):
        forms_apart(one, motion(kinetic_energy=[1, 1, 1], momentum=[1, 1, 1]))


def verdict(check: Mapping[str, Any], *motions: Motion) -> tuple[str, float]:
    """Verdict and deciding number of a check, given as in a case file."""
    found = claim_block.CLAIM["check"].kind.check(check)
    claim = {
        "id": "test",
        "cases": ("a",) * len(motions),
        "check": found,
        "over": None,
        "expect": REPRODUCED,
    }
    decided = Judge(None, catalogue_of_checks()).measure(claim, motions)  # type: ignore[arg-type]
    return decided.verdict, decided.number


def test_every_quantity_and_kind_is_computed_once() -> None:
    assert list(claim_block.CHECK_KINDS) == [*MOTION_CHECKS, "average", "paper"]
    assert set(claim_block.QUANTITY_NAMES) <= {
        *QUANTITIES,
        *quantities.NUMBERS,
        *TOP.system.variables,
    }
    assert not set(QUANTITIES) & set(quantities.NUMBERS)


def test_every_check_of_a_paper_is_used_and_says_what_it_checks() -> None:
    configs = [load(path) for path in (ROOT / "configs").glob("*.yaml")]
    claims = [claim for config in configs for claim in config.claims]
    under = [reading for claim in claims for reading in readings(claim).values()]
    errata = [erratum for config in configs for erratum in config.errata]
    checks = [entry["check"] for entry in (*under, *errata) if entry["check"]]
    named = {check["name"] for check in checks if check["kind"] == "paper"}
    assert named == catalogue_of_checks().keys()
    assert all(own.judge.__doc__ for own in catalogue_of_checks().values())


def test_monotone_is_judged_by_the_step_back_in_units_of_the_range() -> None:
    falls = {"kind": "monotone", "of": ["H"], "sense": "falls"}
    assert verdict(falls, motion(H=[2, 1, 0.5])) == (REPRODUCED, 0)
    assert verdict(falls, motion(H=[2, 1, 1.01])) == (PLOTTING, pytest.approx(0.005))
    assert verdict(falls, motion(H=[2, 1, 1.05, 0])) == (CONTRADICTED, pytest.approx(0.025))
    assert verdict({**falls, "sense": "rises"}, motion(H=[0, 1, 2]))[0] == REPRODUCED
    assert (
        verdict({**falls, "of": ["H", "u1"]}, motion(H=[2, 1, 0], u1=[0, 1, 2]))[0] == CONTRADICTED
    )


def test_a_value_may_be_off_by_its_own_digits_or_by_what_a_figure_shows() -> None:
    check = {"kind": "value", "values": {"H": [0.5]}, "within": 0.01}
    assert verdict(check, motion(H=[10, 0.509]))[0] == REPRODUCED
    assert verdict(check, motion(H=[10, 0.55])) == (PLOTTING, pytest.approx(0.05))
    assert verdict(check, motion(H=[10, 0.65]))[0] == CONTRADICTED
    assert verdict({**check, "at": "start"}, motion(H=[10, 0.5]))[0] == CONTRADICTED


def test_bounds() -> None:
    check = {"kind": "bound", "of": "H", "at": "always", "least": 0}
    assert verdict(check, motion(H=[1, 0, 1])) == (REPRODUCED, 0)
    assert verdict(check, motion(H=[1, -0.5, 1])) == (CONTRADICTED, -0.5)
    assert (
        verdict({"kind": "bound", "of": "H", "most": 1}, motion(H=[9, 1]), motion(H=[9, 0]))[0]
        == REPRODUCED
    )
    assert verdict({"kind": "bound", "of": "H", "most": 1}, motion(H=[9, 0]), motion(H=[9, 2])) == (
        CONTRADICTED,
        2,
    )


@pytest.mark.parametrize(
    "check",
    [
        {"kind": "monotone", "of": ["H"], "sense": "falls"},
        {"kind": "value", "values": {"H": [1, 1]}, "within": 1},
        {"kind": "bound", "of": "H", "at": "always", "most": 9},
        {"kind": "bound", "of": "H", "at": "always", "least": -9},
        {"kind": "order", "of": "H", "sense": "falls"},
        {"kind": "order", "of": "H", "sense": "equal"},
        {"kind": "conserved", "of": ["H"], "within": 9},
    ],
)
def test_what_is_not_a_number_bears_nothing_out(check: Mapping[str, Any]) -> None:
    assert verdict(check, motion(H=[2, 1]), motion(H=[2, math.nan]))[0] == CONTRADICTED
    assert verdict(check, motion(H=[2, math.nan]), motion(H=[2, 1]))[0] == CONTRADICTED


def test_order_over_cases_in_groups() -> None:
    a, b, c = (motion(H=[0, value]) for value in (1, 2, 3))
    check = {"kind": "order", "of": "H", "sense": "rises"}
    assert verdict(check, a, b, c)[0] == REPRODUCED
    assert verdict(check, a, c, b)[0] == CONTRADICTED
    assert verdict(check, a, a)[0] == CONTRADICTED
    assert verdict({**check, "by": 2}, a, c, a, b)[0] == REPRODUCED
    assert verdict({**check, "sense": "falls"}, c, b, a)[0] == REPRODUCED
    assert verdict({**check, "sense": "equal"}, b, b)[0] == REPRODUCED
    assert verdict({**check, "sense": "equal"}, a, b) == (CONTRADICTED, 0.5)


def test_conserved() -> None:
    assert verdict({"kind": "conserved", "of": ["H"]}, motion(H=[1, 1 + 1e-15]))[0] == REPRODUCED
    assert verdict({"kind": "conserved", "of": ["H"]}, motion(H=[1, 1.001]))[0] == PLOTTING
    assert verdict({"kind": "conserved", "of": ["H"]}, motion(H=[2, 1])) == (CONTRADICTED, 0.5)


def test_axes_and_crossings() -> None:
    turns = motion(labels=[1, 1, 3], passages=((305.4, 1, 3, 0.27),))
    assert verdict({"kind": "axis", "start": "x1", "end": "x3"}, turns)[0] == REPRODUCED
    assert verdict({"kind": "axis", "start": "x3"}, turns)[0] == CONTRADICTED
    assert verdict(
        {"kind": "crossings", "least": 1, "most": 1, "from": "x1", "to": "x3"}, turns
    ) == (REPRODUCED, 1)
    assert verdict({"kind": "crossings", "from": "x3"}, turns)[0] == CONTRADICTED
    assert verdict({"kind": "crossings", "most": 0}, turns)[0] == CONTRADICTED
    assert verdict({"kind": "crossings", "least": 2}, turns)[0] == CONTRADICTED
    with pytest.raises(HodoError, match="run `hodo classify RUN` first"):
        verdict({"kind": "crossings", "most": 0}, motion())


def test_the_end_of_spin_is_the_event_or_the_change_of_sign_of_r() -> None:
    stopped = motion(events=(("end_of_spin", 40.0),))
    assert number(stopped, "end_of_spin") == 40
    assert number(motion(), "end_of_spin") == math.inf
    passing = motion(omega=[[1, 0, 1], [1, 0, -1]])
    assert number(passing, "end_of_spin") == 0.5
    assert paper2.never_at_zero.judge([stopped]).deviation == math.inf
    assert paper2.never_at_zero.judge([motion()]).deviation == 0


def test_the_effects_of_two_factors() -> None:
    assert paper1.factorial_effects([1, 4, 2, 5]) == (3, 1)
    assert paper1.factorial_effects([1, 2, 4, 5]) == (1, 3)


def paper_verdict(name: str, *motions: Motion) -> str:
    return verdict({"kind": "paper", "name": name}, *motions)[0]


def test_a_closed_form_holds_or_is_denied() -> None:
    case = changed(
        load(ROOT / "configs" / "paper1.yaml").cases["fig2-1"], {"time.end": 10, "time.samples": 11}
    )
    free = quantities.integrated_motion(case)
    assert paper_verdict("free-rotation", free) == REPRODUCED
    assert paper_verdict("no-closed-form", free) == CONTRADICTED
    assert paper_verdict("free-rotation-from-q0", free) == REPRODUCED
    with pytest.raises(HodoError, match="case fig2-1 has no 'gamma', which Gz needs"):
        paper_verdict("inverse", free)
    with pytest.raises(HodoError, match="unknown check 'invers'; did you mean 'inverse'"):
        paper_verdict("invers", free)


def test_what_holds_on_a_part_of_the_grid_is_under_determined() -> None:
    good, fair, bad = Finding(0.0, 1.0, ""), Finding(0.005, 2.0, ""), Finding(0.5, 3.0, "")
    assert gridded({}, {"a": good, "b": good}).verdict == REPRODUCED
    assert gridded({}, {"a": good, "b": fair}).verdict == PLOTTING
    assert gridded({}, {"a": good, "b": bad}).verdict == UNDERDETERMINED
    assert gridded({}, {"a": bad, "b": bad}).verdict == CONTRADICTED
    part = gridded({}, {"a": good, "b": bad})
    assert part.number == 3
    assert part.evidence.startswith(
        "holds on 1 of 2 members, 1 to 3; largest violation 0.5 of the range at b"
    )


def test_readings_that_disagree_leave_a_statement_under_determined() -> None:
    def over(*verdicts: str, erratum: str = "") -> str:
        found = {str(i): Verdict({}, verdict, 0.0, "") for i, verdict in enumerate(verdicts)}
        return together({"erratum": erratum}, found)

    assert over(REPRODUCED, REPRODUCED) == REPRODUCED
    assert over(REPRODUCED, PLOTTING) == PLOTTING
    assert over(REPRODUCED, CONTRADICTED) == UNDERDETERMINED
    assert over(CONTRADICTED, CONTRADICTED) == CONTRADICTED
    assert over(CONTRADICTED, UNDERDETERMINED) == UNDERDETERMINED
    assert over(REPRODUCED, NOT_TESTED) == NOT_TESTED
    # A statement that inherits an erratum holds of the printed form alone.
    assert over(PLOTTING, CONTRADICTED, erratum="sign") == AS_PRINTED
    assert over(CONTRADICTED, REPRODUCED, erratum="sign") == UNDERDETERMINED
    assert over(REPRODUCED, REPRODUCED, erratum="sign") == REPRODUCED


def test_a_reading_takes_the_check_and_the_members_of_its_claim_unless_it_has_its_own() -> None:
    own, common = {"kind": "axis"}, {"kind": "crossings"}
    found = readings(
        {
            "check": common,
            "over": "all",
            "cases": (),
            "readings": {
                "a": {"cases": ("x",), "check": None, "over": None},
                "b": {"cases": ("y",), "check": own, "over": "some"},
            },
        }
    )
    assert [(each["cases"], each["check"], each["over"]) for each in found.values()] == [
        (("x",), common, "all"),
        (("y",), own, "some"),
    ]


def test_an_erratum_wants_the_printed_form_wrong_and_the_corrected_one_right() -> None:
    assert erratum(0.5, 1e-15, 1e-12).deviation == 0
    assert erratum(1e-15, 1e-15, 1e-12).deviation == math.inf
    assert erratum(0.5, 0.4, 1e-12).deviation == math.inf
    assert erratum(0.5, math.nan, 1e-12).deviation == math.inf


def test_one_member_of_a_sample_contradicts_what_is_said_of_all() -> None:
    found = {str(i): Finding(0.0 if i else math.inf, 0.0, "") for i in range(10)}
    assert sampled({"share": 0.9}, found).verdict == REPRODUCED
    assert sampled({"share": 1.0}, found).verdict == CONTRADICTED
    assert sampled({"share": 1.0}, found).number == 0.9


def varied(cases: list[Case], over: Mapping[str, Any], start: str | None = None) -> dict[str, Any]:
    return dict(members(cases, SWEEP.check(over), start))


def test_the_members_are_those_of_a_sweep_and_change_every_case() -> None:
    over = {"a.0": {"values": [0.1, 0.2]}, "b.0": {"linspace": [0.3, 0.4, 2]}}
    found = varied([TOP, TOP], over)
    assert len(found) == 4
    first, second = found["a.0 = 0.1, b.0 = 0.4"]
    assert first == second
    assert (first.data["a"], first.data["b"], first.time) == ((0.1, 1.0), (0.4, 1.0), TOP.time)
    for i, (case, _) in enumerate(found.values()):
        assert case.data == member(replace(TOP, sweep=over), i).data
    with pytest.raises(HodoError, match="inertia"):
        varied([BODY], {"inertia.0": {"values": [2.0]}})


def test_members_on_a_sphere_keep_the_momentum_and_start_about_the_axis_asked_for() -> None:
    A = np.array([1.0, 0.8, 0.6])
    counts = []
    for axis, sign in (("x1", 1), ("x3", -1)):
        found = varied([BODY], {"direction": {"sphere": {"count": 50, "seed": 1}}}, axis)
        counts.append(len(found))
        for (case,) in found.values():
            w, own = (
                np.array([each.data["initial"][name] for name in "pqr"]) for each in (case, BODY)
            )
            assert np.linalg.norm(A * w) == pytest.approx(np.linalg.norm(A * own), rel=1e-14)
            # D = G^2 - 2 T A2
            assert sign * ((A * w) @ (A * w) - 0.8 * (A @ (w * w))) > 0
    assert sum(counts) == 50


def test_a_motion_is_integrated_once_for_all_claims(monkeypatch: pytest.MonkeyPatch) -> None:
    known, another = Motions(), changed(TOP, {"a.0": 0.2})
    ((one, two),) = known.of([[TOP, another]])
    ((again,), (renamed,)) = known.of([[TOP], [replace(TOP, name="another")]])
    assert again is renamed is one
    # Of motions that would fill the memory those of former claims are let go.
    monkeypatch.setattr(variations, "SAMPLES_AT_ONCE", 1)
    assert [m is n for (m,), n in zip(known.of([[TOP], [another]]), (one, two), strict=True)] == [
        False,
        False,
    ]


@pytest.mark.skipif(not have_taylor(), reason="needs heyoka")
def test_members_are_integrated_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    over = {"direction": {"sphere": {"count": 100, "seed": 1}}}
    cases = [case for (case,) in varied([BODY], over, None).values()]
    singles = [quantities.integrated_motion(case) for case in cases]
    assert any(motion.crossings for motion in singles)
    monkeypatch.setattr(variations, "integrated_motion", None)
    for (ours,), single in zip(Motions().of([[case] for case in cases]), singles, strict=True):
        assert len(ours.crossings) == len(single.crossings)
        for a, b in zip(ours.crossings, single.crossings, strict=True):
            assert (a.start, a.end) == (b.start, b.end)
            # As far as the two integrations of the crossing's own state agree.
            assert a.time == pytest.approx(b.time, rel=1e-11)
            assert a.momentum == pytest.approx(b.momentum, rel=1e-11)
        assert ours.labels.tolist() == single.labels.tolist()
        # Near the separatrix each is right to 2e-12, by the reference in long double.
        np.testing.assert_allclose(ours.omega, single.omega, rtol=0, atol=2e-12)


def test_quantities_of_a_known_motion() -> None:
    # Free rotation about x1 and x3 in turn: a body that starts with q = 0 turns about the axis it
    # encloses.
    case = changed(
        BODY,
        {"damping": 0.0, "initial": {"p": 0.1, "q": 0.0, "r": 1.0, "G": None}, "time.end": 40.0},
    )
    free = quantities.integrated_motion(case)
    # Libration of (G1, G2) about x3: the rate of small oscillations is r sqrt((A1-A3)(A2-A3)/(A1
    # A2)).
    rate = math.sqrt(0.4 * 0.2 / 0.8)
    assert number(free, "turns") == pytest.approx(40 * rate / (2 * math.pi), rel=0.01)
    assert number(free, "area_largest") == 0
    K = 0.6 * 0.2 / (1 * 0.2)
    assert quantities.reach(free, 2) == pytest.approx(K * np.max(free.omega[:, 2] ** 2))
    assert number(free, "crossings") == 0
    assert number(free, "first_crossing") == math.inf
    assert number(free, "area_smallest") == 1
    damped = quantities.integrated_motion(changed(case, {"damping": 0.01}))
    assert paper1.decay_rate(damped) == pytest.approx(0.01, rel=1e-9)


def test_the_rebound_of_u3_is_where_the_reference_has_it() -> None:
    found = quantities.integrated_motion(changed(TOP, {"time.samples": 4001}))
    # tests/data/crossings.csv; the interpolation between samples costs the rest.
    assert number(found, "rebound_u3") == pytest.approx(0.40076030988, abs=1e-6)


CONFIG = """
cases:
  turning:
    model: linear-diag
    inertia: [1, 0.8, 0.6]
    damping: [0.05, 0.04, 0.03]
    initial: {p: 0.8, q: 0.5, r: 0.74}
    time: {end: 100, samples: 101}
  given-up:
    model: linear-diag
    inertia: [1, 0.8, 0.6]
    initial: {p: 0.8, q: 0.5, r: 0.74}
    time: {end: 1000, samples: 11}
    method: DOP853
    max_steps: 3
claims:
  - {id: turns, where: Fig 1, statement: It turns., cases: turning,
     check: {kind: crossings, least: 1}, expect: EXPECT}
  - {id: lost, where: Fig 2, statement: It turns., cases: given-up,
     check: {kind: axis, end: x3}, expect: not tested}
"""


def test_a_verdict_that_is_not_the_expected_one_is_exit_status_3(
    hodo: Hodo, tmp_path: Path
) -> None:
    path = tmp_path / "runs" / "c.h5"
    for expect, status in ((REPRODUCED, 0), (CONTRADICTED, 3)):
        (tmp_path / "c.yaml").write_text(CONFIG.replace("EXPECT", expect), encoding="utf-8")
        assert hodo("run", "c.yaml").returncode == 1  # given-up
        assert hodo("classify", path).returncode == 0
        done = hodo("claims", path, "--json")
        assert done.returncode == status, done.stderr
        rows = json.loads(done.stdout)["statements"]
        assert [(row["id"], row["verdict"]) for row in rows] == [
            ("turns", REPRODUCED),
            ("lost", NOT_TESTED),
        ]
        assert rows[0]["number"] == 1
        assert rows[1]["number"] is None
        with open_run(path) as run:
            stored = run.read("_claims").variables
        assert stored["claim"].data.tolist() == ["turns", "lost"]
        assert stored["verdict"].data.tolist() == [REPRODUCED, NOT_TESTED]
        assert stored["expect"].data.tolist() == [expect, NOT_TESTED]
        assert stored["number"].data[0] == 1
        assert "(x1 to x3)" in stored["evidence"].data[0]
    table = hodo("claims", path).stdout
    assert "reproduced (EXPECTED: contradicted)" in table


def test_verdicts_are_given_once_until_what_they_rest_on_changes(
    hodo: Hodo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG.replace("EXPECT", REPRODUCED), encoding="utf-8")
    path = tmp_path / "runs" / "c.h5"
    hodo("run", "c.yaml")
    hodo("classify", path)
    given: list[int] = []

    def judged(*of: Any) -> Any:
        given.append(1)
        return really(*of)

    really = claims.judged
    monkeypatch.setattr(claims, "judged", judged)
    (first, _), (again, _) = claims.judge_results([path]), claims.judge_results([path])
    for key in ("id", "verdict", "evidence"):
        assert [row[key] for row in again] == [row[key] for row in first]
    assert len(given) == 1
    hodo("run", "c.yaml", "--set", "turning.time.end=90", "--out", "other")
    hodo("classify", *(tmp_path / "other").glob("*.h5"))
    (other,) = (tmp_path / "other").glob("*.h5")
    path.write_bytes(other.read_bytes())
    claims.judge_results([path])
    assert len(given) == 2


def test_claims_and_errata_are_judged_and_counted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    errata = "errata:\n  - {id: a, where: (1), printed: x, should_be: y}\n"
    config = parse(CONFIG.replace("EXPECT", REPRODUCED) + errata, "c.yaml")
    counted: list[int] = []

    class Counted(claims.Progress):
        def __init__(self, total: int, **options: bool) -> None:
            counted.append(total)
            super().__init__(total, **options)

    monkeypatch.setattr(claims, "Progress", Counted)
    statements, misprints = claims.judged(config, {})  # type: ignore[arg-type]
    assert [row.verdict for row in statements] == [NOT_TESTED, NOT_TESTED]
    assert [row.verdict for row in misprints] == [BY_READING]
    assert counted == [3]


def test_the_page_of_figures_shows_the_verdicts(hodo: Hodo, tmp_path: Path) -> None:
    figure = "figures: {a: {kind: hodograph, cases: turning}}\n"
    (tmp_path / "c.yaml").write_text(
        CONFIG.replace("EXPECT", REPRODUCED) + figure, encoding="utf-8"
    )
    for command in (
        "run c.yaml",
        "classify runs/c.h5",
        "claims runs/c.h5",
        "plot runs/c.h5 --out page",
    ):
        hodo(*command.split())
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert "What the text says" in page
    assert "<td class=n>reproduced</td>" in page.replace('"', "")
    assert "(x1 to x3)" in page


def test_claims_want_labels(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG.replace("EXPECT", REPRODUCED), encoding="utf-8")
    hodo("run", "c.yaml")
    done = hodo("claims", "runs/c.h5")
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "runs/c.h5: claim turns: case turning has no labels of the enclosed axis: run `hodo "
        "classify runs/c.h5` first"
    ]


def test_figures_without_labels_and_labels_that_a_rerun_drops_name_the_command(
    hodo: Hodo, tmp_path: Path
) -> None:
    (tmp_path / "c.yaml").write_text(CONFIG.replace("EXPECT", REPRODUCED), encoding="utf-8")
    assert "are gone" not in hodo("run", "c.yaml").stderr
    said = "runs/c.h5 is not classified: run `hodo classify runs/c.h5` for labels and crossings"
    assert said in hodo("plot", "runs/c.h5", "--out", "page").stderr.splitlines()
    hodo("classify", "runs/c.h5")
    assert "is not classified" not in hodo("plot", "runs/c.h5", "--out", "page").stderr
    # The other case has not ended well, so it runs again.
    assert "the labels of given-up are gone" in hodo("run", "c.yaml").stderr
    again = hodo("run", "c.yaml", "--case", "turning", "--force").stderr.splitlines()
    said = "the labels of turning are gone with the old results: hodo classify runs/c.h5"
    assert said in again
    assert said not in hodo("run", "c.yaml", "--force").stderr


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (
            "cases: turnin",
            "17:60: cases.0: unknown case 'turnin'; did you mean 'turning'? (valid: turning, "
            "given-up)",
        ),
        (
            "cases: turning, over: {damping.3: {values: [1]}}",
            "17:87: over.damping.3: unknown key 'damping.3'",
        ),
        (
            "cases: [turning, turning], over: {damping.0: {values: [-.inf]}}",
            "17:108: over.damping.0.values.0: expected a finite number, got -inf",
        ),
        (
            "cases: turning, over: {damping.0: {values: []}}",
            "17:96: over.damping.0.values: expected a list of one or more: number, got a list of 0",
        ),
        (
            "cases: turning, seed: 3",
            f"17:69: seed: unknown key (valid: {', '.join(claim_block.CLAIM)})",
        ),
    ],
)
def test_a_wrong_claim_is_named_with_its_place(wrong: str, line: str) -> None:
    with pytest.raises(HodoError) as raised:
        parse(CONFIG.replace("EXPECT", REPRODUCED).replace("cases: turning", wrong, 1), "c.yaml")
    place, _, message = line.partition(": ")
    assert str(raised.value) == f"c.yaml:{place}: claims.0.{message}"


# The papers.


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, dict[str, Any]]]:
    """The verdicts on every claim of the papers, by paper and id; made by the commands, as a user
    would."""
    import subprocess
    import sysconfig

    folder = tmp_path_factory.mktemp("papers")
    script = Path(sysconfig.get_path("scripts")) / "hodo"
    found = {}
    for paper in PAPERS:
        for command in (
            ("run", ROOT / "configs" / f"{paper}.yaml", "--quiet"),
            ("classify", f"runs/{paper}.h5"),
        ):
            subprocess.run([script, *command], cwd=folder, check=True, capture_output=True)
        done = subprocess.run(
            [script, "claims", f"runs/{paper}.h5", "--json"],
            cwd=folder,
            capture_output=True,
            text=True,
        )
        tables = json.loads(done.stdout)
        found[paper] = {row["id"]: row for row in tables["statements"]}
        found[f"{paper} errata"] = {row["id"]: row for row in tables["errata"]}
    return found


@pytest.mark.heyoka
def test_every_claim_of_the_papers_has_the_verdict_expected(
    judged: Mapping[str, Mapping[str, Any]],
) -> None:
    for paper in PAPERS:
        rows, config = judged[paper], load(ROOT / "configs" / f"{paper}.yaml")
        assert [*rows] == [claim["id"] for claim in config.claims]
        assert not {name for name, row in rows.items() if row["verdict"] != row["expect"]}


@pytest.mark.heyoka
def test_every_erratum_of_the_papers_is_confirmed(
    judged: Mapping[str, Mapping[str, Any]],
) -> None:
    for paper in PAPERS:
        rows = judged[f"{paper} errata"]
        errata = load(ROOT / "configs" / f"{paper}.yaml").errata
        assert [*rows] == [each["id"] for each in errata]
        for each in errata:
            expected = "confirmed" if each["check"] else "by reading"
            assert rows[each["id"]]["verdict"] == expected


@pytest.mark.heyoka
def test_the_numbers_that_decide_are_those_found_by_other_means(
    judged: Mapping[str, Mapping[str, Any]],
) -> None:
    one, two, three = (judged[paper] for paper in PAPERS)
    assert one["fig4-separatrix"]["evidence"] == "305.358955167 (x1 to x3)"
    assert judged["paper1 errata"]["curve-3"]["number"] == pytest.approx(
        0.0535 / 1.0777**2, rel=1e-3
    )
    assert one["fig10-area"]["number"] == pytest.approx(0.064, abs=0.0005)
    assert one["fig11-area"]["number"] == pytest.approx(0.113, abs=0.0005)
    areas = {name: each["number"] for name, each in one["fig16-area"]["readings"].items()}
    assert areas["|omega(0)| = 1"] == pytest.approx(0.074, abs=0.0005)
    areas = {name: each["number"] for name, each in one["fig18-area"]["readings"].items()}
    assert areas["|omega(0)| = 1"] == pytest.approx(0.169, abs=0.0005)
    stays = {name: each["number"] for name, each in one["x1-stays"]["readings"].items()}
    assert stays["entries 1 and 3"] == 1
    # Two standard deviations of 129 starts.
    assert stays["all entries"] == pytest.approx(0.47, abs=0.09)
    growth = [each["number"] for each in one["x3-growth"]["readings"].values()]
    assert growth == pytest.approx([0.0058333333, 0.0027083333], rel=1e-7)
    trend = one["larger-difference-sooner-for-any"]
    assert trend["number"] == pytest.approx(-0.90, abs=0.02)
    printed, corrected = (each["evidence"] for each in two["limits"]["readings"].values())
    assert printed.startswith("x = 0.766997, 0.792158, 0.502956, 0.600701 (said")
    assert corrected.startswith("x = 1.23706, 1.21575, 1.53762, 1.45569 (said")
    assert "x off by 0.799, 0.568, 0.363, 0.228, 0.135" in two["M1-M2-vanish"]["evidence"]
    assert "0.0576, 0.0195 (p by 2)" in two["slow-variables"]["evidence"]
    # b^2 |omega|/nu with b^7 = 525 P0/(8 pi) and |omega| = sqrt(2).
    assert two["small-Reynolds-number"]["number"] == pytest.approx(
        (525 * 0.48 / (8 * math.pi)) ** (2 / 7) * math.sqrt(2) / 1000, rel=1e-12
    )
    turns = [each["evidence"] for each in one["fig14-character"]["readings"].values()]
    assert turns[0] == "7.09 turns about x3 in Fig 12, 0 in Fig 14"
    assert turns[2] == "6.78 turns about x3 in Fig 12, 0 in Fig 14"
    assert three["case3-Gz"]["number"] == pytest.approx(0.0012, rel=0.02)
    assert three["error-of-order-epsilon"]["number"] == pytest.approx(1, abs=0.01)
    assert "at 0.400752, 1.75678, 4.19675" in three["signs-change"]["evidence"]


def test_a_claim_concerns_the_cases_of_all_its_readings() -> None:
    """The page links each figure to the statements about its motions."""
    readings = {"one": {"cases": ["a", "b"]}, "other": {"cases": ["b", "c"]}}
    claim = {"cases": [], "readings": readings}
    assert claim_block.cases_of(claim) == ["a", "b", "c"]
    assert claim_block.cases_of({"cases": ["a"], "readings": {}}) == ["a"]


def test_the_document_on_the_papers_has_every_statement_and_misprint() -> None:
    """What `make docs` prints of the verdicts is that of the case files as they are now."""
    text = (ROOT / "docs" / "papers.md").read_text(encoding="utf-8").replace("\\", "")
    for paper in PAPERS:
        config = load(ROOT / "configs" / f"{paper}.yaml")
        for claim in config.claims:
            said = " ".join(claim["statement"].split())
            rows = [line for line in text.splitlines() if f"| {said}" in line]
            assert any(f"| {claim['expect']} |" in row for row in rows), said
        for each in config.errata:
            assert f"| {each['printed']} | {each['should_be']} |" in text


def test_the_literal_tensor_crosses_once_at_most_and_to_x1_alone() -> None:
    """dD/dt = -2 c (p + r) [(A1 - A2) p - (A2 - A3) r] is 0.16 c r^2 where D = 0, for this body."""
    A, c = np.array([1.0, 0.8, 0.6]), 0.005
    generator = np.random.default_rng(1)
    for r in generator.normal(size=100):
        # D = 0: A1 (A1 - A2) p^2 = A3 (A2 - A3) r^2.
        for p in np.sqrt(0.6) * r * np.array([1, -1]):
            w = np.array([p, generator.normal(), r])
            damping = c * np.array([p + r, 0, p + r])
            rate = np.cross(A * w, w) - damping
            rate /= A
            dD = 2 * A[0] * (A[0] - A[1]) * p * rate[0] - 2 * A[2] * (A[1] - A[2]) * r * rate[2]
            assert dD == pytest.approx(0.16 * c * r * r, rel=1e-9)


@pytest.mark.parametrize(
    ("check", "said"),
    [
        ("{kind: bound, of: G}", "claims.0.check: needs least or most: without, every motion"),
        ("{kind: axis}", "claims.0.check: needs start or end: without, every motion meets it"),
        ("{kind: bound, of: G, least: 5, most: 1}", "claims.0.check.most: expected at least 5"),
        ("{kind: crossings, least: 3, most: 2}", "claims.0.check.most: expected at least 3"),
    ],
)
def test_a_check_that_decides_nothing_is_refused(check: str, said: str) -> None:
    case = "{model: linear-diag, inertia: [1, 0.8, 0.6], damping: 1, initial: {p: 1, q: 1, r: 1}}"
    claim = f"{{id: a, where: here, statement: so, cases: a, check: {check}}}"
    with pytest.raises(HodoError, match=re.escape(said)):
        parse(
            f"defaults: {{time: {{end: 1}}}}\ncases: {{a: {case}}}\nclaims: [{claim}]\n", "c.yaml"
        )
