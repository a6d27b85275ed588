"""The commands as a user gives them: exit statuses, what they print and what they leave alone."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import ROOT, Hodo, call

from hodo_cli.integration import choice

CONFIG = """\
title: two cases
defaults:
  inertia: [1, 0.8, 0.6]
  time: {end: 400, samples: 101}
cases:
  turns:
    model: linear-diag
    damping: [0.005, 0.004, 0.003]
    initial: {p: 0.8, q: 0.5, r: 0.74}
  stays:
    model: linear-diag
    damping: [0.003, 0.004, 0.005]
    initial: {p: 0.8, q: 0.5, r: 0.74}
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "two.yaml"
    path.write_text(CONFIG)
    return path


def test_the_main_job(hodo: Hodo, config: Path, tmp_path: Path) -> None:
    """Twice, and by several names of one result; then a case that has changed."""
    ran = hodo("run", config)
    assert ran.returncode == 0, ran.stderr
    header, *lines = ran.stdout.splitlines()
    assert re.split("  +", header) == [
        "case", "model", "form", "method", "steps", "run time", "error", "warnings",
    ]  # fmt: skip
    assert [line.split()[0] for line in lines] == ["turns", "stays"]
    labelled = hodo("classify", "runs/two.h5")
    assert labelled.returncode == 0, labelled.stderr
    assert "305.35895516" in labelled.stdout
    before = (tmp_path / "runs" / "two.h5").read_bytes()
    twice = ("runs/two.h5", tmp_path / "runs" / "two.h5", config)
    for command, printed in (("show", ran), ("classify", labelled)):
        assert hodo(command, "runs/two.h5").stdout == hodo(command, *twice).stdout == printed.stdout
    done = hodo("claims", "runs/two.h5")
    said = "runs/two.h5 has no claims: or errata:\n"
    assert (done.returncode, done.stdout, done.stderr) == (0, "", said)
    assert "turns: is kept" in hodo("run", config, "-v").stderr
    assert (tmp_path / "runs" / "two.h5").read_bytes() == before
    config.write_text(CONFIG.replace("[0.003, 0.004, 0.005]", "[0.003, 0.004, 0.006]"))
    plan = hodo("run", config, "--dry-run").stdout
    assert "turns: is kept" in plan
    assert "stays: will run: its case has changed" in plan
    hodo("run", config)
    crossing = json.loads(hodo("classify", "runs/two.h5", "--json").stdout)[0]["crossings"]
    assert len(crossing) == 1
    # What several cases are warned of is one line below their table.
    rounded = hodo("run", config, "--set", "*.inertia=[1, 2.001, 1]").stdout.splitlines()
    assert rounded[-1].startswith("turns, stays: one moment exceeds the sum")
    assert "".join(rounded).count("exceeds") == 1


def test_show_says_what_a_case_assumes(hodo: Hodo, config: Path) -> None:
    config.write_text(CONFIG.replace("turns:\n", "turns:\n    assumes: {r0: by reading}\n", 1))
    assert hodo("run", config).returncode == 0
    rows = json.loads(hodo("show", "runs/two.h5", "--json").stdout)
    assert [row["assumes"] for row in rows] == ["r0: by reading", ""]
    *_, last = hodo("show", "runs/two.h5").stdout.splitlines()
    assert last == "turns: assumes r0: by reading"


def test_json_has_no_numbers_that_are_not_finite(hodo: Hodo, config: Path) -> None:
    """A change goes into a file of its own; a case that fails costs no other."""
    options = ("--set", "turns.max_steps=3", "--set", "*.error=off")
    ran = hodo("run", config, *options, "--json")
    again = hodo("run", config, *options[2:], *options[:2])
    assert (ran.returncode, again.returncode) == (1, 1)
    assert "timeout: max_steps: stopped after 3 steps" in again.stdout
    (path,) = (config.parent / "runs").iterdir()
    assert path.name == "two,_.error=off,turns.max_steps=3.h5"
    for done in (ran, hodo("show", path, "--json")):
        rows = json.loads(done.stdout, parse_constant=lambda constant: pytest.fail(constant))
        assert [row["error"] for row in rows] == [None, None]
        assert [row["status"] for row in rows] == ["timeout", "ok"]


def test_formulas_that_differ_in_signs_have_files_of_their_own(hodo: Hodo, tmp_path: Path) -> None:
    case = {"model": "torques", "inertia": [1, 0.8, 0.6], "initial": {"p": 1, "q": 0.1, "r": 0}}
    text = json.dumps({"cases": {"a": {**case, "time": {"end": 1}}}})
    (tmp_path / "f.yaml").write_text(text, encoding="utf-8")
    for sign in ("*", "/"):
        change = f'a.expression=["p{sign}2", "0", "0"]'
        assert hodo("run", "f.yaml", "--quiet", "--set", change).returncode == 0
    assert len([*(tmp_path / "runs").glob("f,a.expression=*.h5")]) == 2
    for pattern in ("a*", "[a]", "?", "*"):
        change = f"{pattern}.expression=[q, 0, 0]"
        assert hodo("run", "f.yaml", "--quiet", "--set", change).returncode == 0
    assert len([*(tmp_path / "runs").glob("f,*.expression=[[]q*.h5")]) == 4


def test_a_result_knows_what_was_changed_for_it(hodo: Hodo, tmp_path: Path) -> None:
    text = MERGED["a"]
    (tmp_path / "a.yaml").write_text(text)
    assert hodo("run", "a.yaml", "--set", "turns.time.end=10").returncode == 0
    result = "runs/a,turns.time.end=10.h5"
    (tmp_path / "a.yaml").write_text(f"# a remark\n{text}")
    assert hodo("show", result).stderr == ""
    assert hodo("merge", result, "--out", "runs/merged.h5").returncode == 0
    with h5py.File(tmp_path / "runs/merged.h5") as file:
        assert '"end": 10' in str(file.attrs["config"])
    (tmp_path / "a.yaml").write_text(text.replace("0.05", "0.06"))
    assert "hodo run a.yaml --set turns.time.end=10" in hodo("show", result).stderr


def test_a_config_that_is_named_twice_is_run_once(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(CONFIG)
    done = hodo("run", "a.yaml", "./a.yaml", tmp_path / "a.yaml", "a", "--dry-run")
    assert (done.returncode, done.stdout) == (0, hodo("run", "a", "--dry-run").stdout), done.stderr


def test_the_result_of_another_config_of_this_name_is_its_own(hodo, config, tmp_path):
    assert hodo("run", config).returncode == 0
    before = (tmp_path / "runs" / "two.h5").read_bytes()
    other = tmp_path / "other" / "two.yaml"
    other.parent.mkdir()
    other.write_text(CONFIG)
    assert hodo("run", other).returncode == 0  # a copy: nothing is lost
    other.write_text(CONFIG.replace("0.003", "0.002"))
    holds = "runs/two.h5 holds the results of two.yaml, not of other/two.yaml"
    for options in ([], ["--dry-run"]):
        ran = hodo("run", "other/two.yaml", *options)
        assert ran.returncode == 2
        assert ran.stderr == f"{holds}: write elsewhere (--out), or over them (--force)\n"
    for command in ("show", "classify", "plot", "claims"):
        done = hodo(command, "other/two.yaml")
        assert (done.returncode, done.stderr) == (2, f"{holds}\n")
    assert (tmp_path / "runs" / "two.h5").read_bytes() == before
    assert hodo("run", other, "--out", "other/runs").returncode == 0
    moved = tmp_path / "moved"
    moved.mkdir()
    other.parent.rename(moved / "other")  # the whole project: its paths stay as they are
    (moved / "other" / "two.yaml").write_text(CONFIG)
    again = hodo("run", "moved/other/two.yaml", "--out", "moved/other/runs")
    assert again.returncode == 0, again.stderr
    assert hodo("run", "moved/other/two.yaml", "--force").returncode == 0
    with h5py.File(tmp_path / "runs" / "two.h5") as file:
        assert file.attrs["config_path"] == "../moved/other/two.yaml"
    # Results of earlier versions do not say where their config lies.
    shutil.copy(ROOT / "tests" / "data" / "format1.h5", tmp_path / "runs" / "two.h5")
    config.write_text(CONFIG.replace("0.003", "0.001"))
    assert hodo("run", config).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "two.yaml", "-j", "0"], "hodo run: Invalid value for '-j' / '--jobs': 0 is not"),
        (["--nix"], "hodo: No such option '--nix'"),
        (["nix"], "hodo: No such command 'nix'"),
        (["run"], "hodo run: Missing argument 'CONFIGS...'"),
        (["run", "two.yaml", "--set"], "hodo run: Option '--set' requires an argument (see "),
        (["--models"], "hodo: Option '--models' requires an argument (see hodo --help)"),
        (["init", ""], ". is no name of a case file"),
        (["init", "con"], "con.yaml: con names a device on Windows: take another name"),
        *(([command, "README"], "README: no such file or directory\n")
          for command in ("show", "run", "classify")),
        (["run", "two.yaml", "--out", "y" * 300], f"cannot write {'y' * 300}/two.h5: file name"),
        (["run", "two.yaml", "--set", "turns.damping.0=x"], "--set turns.damping.0=x: cases.turns"),
        (["run", "two.yaml", "--quiet", "-v"], "--quiet and --verbose exclude each other"),
        (["run", "two.yaml", "-j", "2", "--scheduler", "tcp://127.0.0.1:9"], "-j: leave it out"),
        (["plot", "two.yaml", "--alone", "a.html", "--format", "csv"], "--alone shows all figures"),
        (["run", "two.yaml", "--case", "turn"], "no case matches turn; did you mean 'turns'?"),
        (["compare", "a.h5", "b.h5", "--rtol=-1"], "--rtol: expected a number >= 0, got -1"),
        (["compare", "a.h5", "b.h5", "--atol=nan"], "--atol: expected a number >= 0, got nan"),
    ],
)  # fmt: skip
def test_a_wrong_option_is_one_line(hodo, config, arguments, said):
    done = hodo(*arguments)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert done.stderr.startswith(said)
    assert not (config.parent / "runs").exists()


def test_the_summaries_of_the_commands_are_whole(hodo: Hodo) -> None:
    assert "..." not in hodo("--help").stdout.partition("Commands:")[2]


def test_a_motion_that_was_broken_off_says_how_far_it_goes(hodo: Hodo, tmp_path: Path) -> None:
    """Its last label is not the axis that it ends about, and its figure is not whole."""
    figures = "figures: {f: {kind: sphere, cases: [turns]}}\n"
    (tmp_path / "cut.yaml").write_text(
        CONFIG.replace("defaults:\n", "defaults:\n  max_steps: 10\n") + figures
    )
    hodo("run", "cut.yaml")
    rows = json.loads(hodo("classify", "runs/cut.h5", "--json").stdout)
    (said,) = rows[0]["warnings"]
    reached = re.fullmatch(r"timeout: to t = (\d+) only", said)
    assert reached
    assert 0 < int(reached[1]) < 100  # how far ten steps reach is the method's affair
    drawn = f"turns: timeout: drawn to t = {reached[1]} only"
    assert drawn in hodo("plot", "runs/cut.h5", "f").stderr


def test_a_file_is_named_after_the_last_override_of_each_key_in_few_letters(hodo, config):
    def names(case: str, *values: str) -> list[str]:
        changes = [word for value in values for word in ("--set", f"{case}.{value}")]
        hodo("run", config, "--case", case, "--out", "named", *changes)
        return [path.name for path in (config.parent / "named").iterdir()]

    for first, last in ("12", "21"):
        given = [f"damping.2={value}" for value in (first, last)]
        assert f"two,turns.{given[1]}.h5" in names("turns", *given)
    for end in "ab":
        found = names("stays", f"note={'é/' * 200}{end}")
    assert len(found) == 4
    assert all(len(name.encode()) < 200 for name in found)


MERGED = {
    "a": """
title: The first
cases:
  turns: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [0.05, 0.04, 0.03],
          initial: {p: 0.8, q: 0.5, r: 0.74}, time: {end: 20, samples: 21}, note: the first}
figures: {path: {kind: hodograph, cases: turns}}
claims:
  - {id: t, where: here, statement: It turns., cases: turns, expect: reproduced,
     check: {kind: axis, start: x1, end: x1}}
""",
    "b": """
title: The second
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 20, samples: 21}}
cases:
  turns: {damping: [0.05, 0.04, 0.03], initial: {p: 0.8, q: 0.5, r: 0.74}}
  swept: {damping: 0, initial: {p: 1, q: 1, r: 1},
          sweep: {damping.1: {values: [0.1, 0.2]}}}
figures: {curve: {kind: curve, cases: swept, variable: omega.x1, x: damping.1}}
""",
}


@pytest.fixture
def two_results(tmp_path: Path) -> Path:
    for name, text in MERGED.items():
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
        assert call(tmp_path, "run", f"{name}.yaml").returncode == 0
    return tmp_path


def test_json_is_printed_whatever_else_is_asked_for(two_results: Path) -> None:
    values = {"--case": "t*", "--set": "turns.note=a", "--out": "elsewhere", "--jobs": "2",
              "--rtol": "1e-3", "--atol": "1e-3"}  # fmt: skip
    for name in ("run", "classify", "show", "claims", "compare", "schema", "bench"):
        options = re.findall(r"(--[a-z-]+)(?: [A-Z]|  )", call(two_results, name, "--help").stdout)
        if "--json" not in options:
            continue
        for option in {*options} - {"--json", "--help", "--scheduler"}:
            files = ["b.yaml"] * (1 + (name == "compare"))
            more = [option, *([values[option]] if option in values else [])]
            done = call(two_results, name, *files, *more, "--json")
            assert done.returncode == 2 or json.loads(done.stdout), (name, option)


def test_a_merged_result_is_one_that_every_command_reads(two_results: Path) -> None:
    assert call(two_results, "classify", "a.yaml").returncode == 0
    done = call(two_results, "merge", "b.yaml", "runs/a.h5", "--out", "both.h5")
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["case", "turns", "swept"]
    with h5py.File(two_results / "both.h5") as file, h5py.File(two_results / "runs/a.h5") as a:
        assert file.attrs["title"] == "The second; The first"
        assert "hodo merge runs/b.h5 runs/a.h5" in file.attrs["history"]
        np.testing.assert_array_equal(file["turns/omega"], a["turns/omega"])
    assert call(two_results, "classify", "both.h5").returncode == 0
    claims = call(two_results, "claims", "both.h5", "--json")
    assert json.loads(claims.stdout)["statements"][0]["verdict"] == "reproduced"
    assert call(two_results, "plot", "both.h5").returncode == 0
    assert call(two_results, "compare", "both.h5", "runs/a.h5").returncode == 3  # swept is new
    for name in ("path.png", "curve.png"):
        assert (two_results / "runs" / "figures" / "both" / name).exists()


def test_a_case_that_is_not_run_again_is_merged_as_it_was_run(two_results: Path) -> None:
    body = "model: linear-diag, inertia: [3, 2, 1], damping: 0, initial: {p: 1, q: 0, r: 0}"
    more = f"  more: {{{body}, time: {{end: 40}}}}\nfigures:"
    text = MERGED["a"].replace("end: 20", "end: 30").replace("figures:", more)
    (two_results / "a.yaml").write_text(text)
    assert call(two_results, "run", "a.yaml", "--case", "more").returncode == 0
    done = call(two_results, "merge", "a.yaml", "--out", "runs/c.h5")
    assert done.returncode == 0, done.stderr
    with h5py.File(two_results / "runs/c.h5") as file:
        assert [*re.findall(r'"end": (\d+)', str(file.attrs["config"]))] == ["20", "40"]


def test_what_cannot_be_merged_is_one_line_and_writes_nothing(two_results: Path) -> None:
    other_cases = MERGED["b"].replace("0.03]", "0.02]")
    other_statement = MERGED["a"].replace("It turns.", "It goes on.")
    for name, text in (("c", other_cases), ("d", other_statement)):
        (two_results / f"{name}.yaml").write_text(text, encoding="utf-8")
        assert call(two_results, "run", f"{name}.yaml").returncode == 0
    for names, words in (
        (("a.yaml", "c.yaml"), "case turns is in runs/a.h5 and runs/c.h5 with different content"),
        (("a.yaml", "d.yaml"), "claims t is in runs/a.h5 and runs/d.h5 with different content"),
        (("a.yaml", "runs/e.h5"), "runs/e.h5: no such file or directory"),
    ):
        done = call(two_results, "merge", *names, "--out", "new.h5")
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr
        assert words in done.stderr
        assert not (two_results / "new.h5").exists()
    done = call(two_results, "merge", "a.yaml", "b.yaml", "--out", "new.txt")
    assert "new.txt is there already, or no name of a result: take a new one" in done.stderr
    done = call(two_results, "run", "a.yml")
    assert done.stderr == "a.yml: no such file or directory; did you mean 'a.yaml'?\n"
    with h5py.File(two_results / "bare.h5", "w") as file:
        file.attrs["format_version"] = 1
        file.create_group("turns")
    assert "bare.h5 holds no cases\n" in call(two_results, "plot", "bare.h5").stderr
    done = call(two_results, "merge", "a.yaml", "b.yaml", "--out", "runs/b.h5")
    assert done.stderr.startswith("runs/b.h5 is there already")


def test_methods_are_a_paragraph_for_a_paper(two_results: Path) -> None:
    done = call(two_results, "show", "--methods", "b.yaml")
    assert done.returncode == 0, done.stderr
    text = " ".join(done.stdout.split())
    assert text.startswith("With hodo 0.3.0")
    # A motion by itself, and a sweep of two members.
    assert "3 motions of linear-diag (full) were computed: " in text
    of_series = "2.2e-19, below the rounding of double precision"
    # Collocation, where heyoka is not installed, has the tolerance of its rounding.
    assert f"a relative tolerance of {of_series if 'Taylor' in text else '7.1e-15'}" in text
    assert re.search(r"relative errors of the stored variables are at most \d\.\de-\d+ \(", text)
    assert text.endswith("To be cited: hodo 0.3.0.")
    assert "of them" not in text  # of all
    assert max(map(len, done.stdout.splitlines())) <= 100
    body = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 1, r: 1}, time: {end: 2}"
    (two_results / "e.yaml").write_text(
        f"defaults: {{{body}}}\ncases:\n  short: {{damping: [0.1, 0, 0], max_steps: 1}}\n"
        "  free: {damping: 0}\n  damped: {damping: [0.1, 0, 0], method: DOP853, tol: 1e-9}\n"
    )
    assert call(two_results, "run", "e.yaml", "--case", "short").returncode == 1
    done = call(two_results, "show", "--methods", "e.yaml")
    assert (done.returncode, done.stderr) == (2, "runs/e.h5 holds no case that ended well\n")
    # A closed form has no tolerance.
    call(two_results, "run", "e.yaml")
    text = " ".join(call(two_results, "show", "--methods", "e.yaml").stdout.split())
    assert "were computed: 1 in closed form; 1 by DOP853 (SciPy" in text
    assert "at a relative tolerance of 1e-09. The relative errors" in text


@pytest.mark.heyoka
def test_a_paragraph_for_a_paper_says_of_how_many_members_the_error_is_measured(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "cases:\n  a: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: [5e-3, 4e-3, 3e-3],\n"
        "      initial: {p: 0, q: 0, r: 1}, time: {end: 10},\n"
        "      sweep: {direction: {sphere: {count: 500, seed: 1}}}}\n"
    )
    assert call(tmp_path, "run", "a.yaml").returncode == 0
    with h5py.File(tmp_path / "runs" / "a.h5") as file:
        measured = file["a"].attrs["error_sample"]
    assert measured < 500
    text = " ".join(call(tmp_path, "show", "--methods", "a.yaml").stdout.split())
    assert f"extended precision, for a sample of {measured} of 500" in text


def test_a_command_that_a_message_names_can_be_typed(tmp_path: Path) -> None:
    body = "{model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0, initial: {p: 1, q: 1, r: 1}"
    text = f"references: |\n  one\n  two\ncases: {{a: {body}, time: {{end: 1, samples: 3}}}}}}\n"
    (tmp_path / "my study.yaml").write_text(text, encoding="utf-8")
    assert "hodo run 'my study.yaml' makes it" in call(tmp_path, "show", "my study.yaml").stderr
    assert call(tmp_path, "run", "my study.yaml", "--quiet").returncode == 0
    said = call(tmp_path, "show", "my study.yaml", "--methods").stdout
    assert " two." in " ".join(said.split())
    (tmp_path / "my study.yaml").write_text(text.replace("p: 1", "p: 2"), encoding="utf-8")
    assert "hodo run 'my study.yaml'" in call(tmp_path, "show", "my study.yaml").stderr


def test_a_table_and_a_paragraph_for_a_paper_name_what_a_sweep_varies(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(
        "defaults: {model: torques, inertia: [5, 3, 2], inertia_unit: kg m^2, error: off}\n"
        "cases:\n  driven:\n    constants: {M: 0.02}\n    expression: [M*sin(t), 0, 0]\n"
        "    initial: {p: 0, q: 0, G: 2}\n    time: {end: 3, unit: s}\n"
        "    sweep: {constants.M: {linspace: [0, 0.1, 3]}, to: {sphere: {count: 4}}}\n"
    )
    assert call(tmp_path, "run", "a.yaml", "--quiet").returncode == 0
    table = call(tmp_path, "show", "a.yaml", "--latex").stdout
    assert (
        "inertia = (5, 3, 2) [kg m$^{2}$], constants M = 0 to 0.1 in 3 values, expression = "
        "(M*sin(t), 0, 0) [kg m$^{2}$/s$^{2}$], initial G = 2 [kg m$^{2}$/s], direction = 4 at "
        "random, t = 0 to 3 [s] &"
    ) in table
    said = " ".join(call(tmp_path, "show", "a.yaml", "--methods").stdout.split())
    assert "Sweep driven: constants.M 0 to 0.1 in 3 values, initial.direction 4 at random." in said


# Where a config and its result differ.


NAMED = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 1, r: 1}, time: {end: 9}}
cases:
  first: {damping: 0.1}
  second: {damping: [0.2, 0.1, 0.3]}
figures:
  f: {kind: hodograph, cases: [first, second]}
claims:
  - {id: c, where: w, statement: s, cases: [first], expect: reproduced,
     check: {kind: bound, of: T, most: 9}}
"""


@pytest.fixture
def named(tmp_path: Path, hodo: Hodo) -> Path:
    """A config that is run and classified."""
    (path := tmp_path / "a.yaml").write_text(NAMED)
    for command in ("run", "classify"):
        assert hodo(command, "a").returncode == 0
    return path


@pytest.mark.parametrize("command", ["show", "classify", "claims", "plot"])
def test_a_config_stands_for_its_result(named: Path, hodo: Hodo, command: str) -> None:
    anew = ["--force"] if command == "plot" else []  # a second plot would say that all is kept
    (said,) = {hodo(command, name, *anew).stdout for name in ("runs/a.h5", "a.yaml", "a")}
    assert said
    assert "has changed" not in said


def test_an_edited_caption_is_seen(named: Path, hodo: Hodo) -> None:
    named.write_text(NAMED.replace("cases: [first, second]", "cases: [first], title: other"))
    said = "runs/a.h5: the figures of a.yaml have changed since its run: hodo plot a.yaml takes"
    table = named.parent / "runs/figures/a/f.csv"
    assert said in hodo("plot", "runs/a.h5", "--format", "csv").stderr
    assert "second" in table.read_text()
    assert not hodo("plot", "a", "f", "--format", "csv").stderr
    assert "second" not in table.read_text()
    assert not hodo("claims", "runs/a.h5").stderr  # which are as they were


def test_an_edited_claim_is_checked(named: Path, hodo: Hodo) -> None:
    named.write_text(NAMED.replace("most: 9", "least: 9"))
    stored, told = hodo("claims", "runs/a.h5"), hodo("claims", "a.yaml")
    assert "the claims of a.yaml have changed since its run" in stored.stderr
    assert (stored.returncode, "reproduced" in stored.stdout) == (0, True)
    assert (told.returncode, "contradicted" in told.stdout, told.stderr) == (3, True, "")
    assert hodo("claims", "runs/a.h5").returncode == 0


@pytest.mark.parametrize("name", ["runs/a.h5", "a"])
def test_a_case_that_has_changed_since_is_named(named: Path, hodo: Hodo, name: str) -> None:
    named.write_text(NAMED.replace("damping: 0.1", "damping: 0.3").replace("[0.2", "[0.20"))
    for command in ("show", "classify", "plot"):
        said = "first has changed in a.yaml since the run; `hodo run a.yaml` runs it again\n"
        assert f"runs/a.h5: {said}" in hodo(command, name).stderr


def test_remarks_are_no_change_and_a_broken_config_is_no_mistake(named: Path, hodo: Hodo) -> None:
    named.write_text(NAMED.replace("damping: 0.1", "damping: 0.1, note: new"))
    assert not hodo("show", "a").stderr
    named.write_text("cases: []")
    assert not hodo("show", "runs/a.h5").stderr
    assert hodo("show", "a.yaml").returncode == 2


def test_a_config_without_a_result_names_the_command(tmp_path: Path, hodo: Hodo) -> None:
    (tmp_path / "a.yaml").write_text(NAMED)
    for command in ("show", "classify", "claims", "plot"):
        done = hodo(command, "a")
        assert done.returncode == 2
        assert done.stderr == "a.yaml has no result runs/a.h5: hodo run a.yaml makes it\n"


def test_a_dry_run_counts_the_members_that_a_grown_sweep_keeps(hodo, tmp_path):
    """Which are computed anew if the case has changed otherwise."""

    def write(values: list[float], damping: float) -> None:
        ball = "direction: {sphere: {count: 20, seed: 1}}"
        keys = f"damping: [0.1, 0.2, {damping}], initial: {{p: 0, q: 0, G: 1}}, time: {{end: 2}}"
        swept = f"model: linear-diag, inertia: [3, 2, 1], {keys}"
        text = f"cases:\n  s: {{{swept}, sweep: {{damping.0: {{values: {values}}}, {ball}}}}}\n"
        (tmp_path / "s.yaml").write_text(text)

    write([0.1, 0.3], 0.1)
    assert hodo("run", "s.yaml").returncode == 0
    write([0.1, 0.2, 0.3], 0.1)
    changed = "s: will run: its case has changed"
    dry = hodo("run", "s.yaml", "--dry-run").stdout
    assert dry.strip() == f"{changed}; 40 of 60 members are kept"
    write([0.1, 0.2, 0.3], 0.2)
    assert hodo("run", "s.yaml", "--dry-run").stdout.strip() == changed


# What makes a stored result stale: a line changed in what computes it, and nothing else.

COMPUTED = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], time: {end: 10, samples: 3},
           initial: {p: 0.8, q: 0.5, r: 0.74}, damping: [0.005, 0.004, 0.003]}
cases:
  single: {method: collocation}
  swept: {method: collocation, error: off, sweep: {damping.0: {values: [0.005, 0.006]}}}
"""
CODE = "will run: the code that computes it has changed"
KEPT = "is kept: nothing that it depends on has changed"


class Copy:
    """A copy of the package, with a result that it has computed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(
            ROOT / "hodo_cli", folder / "hodo_cli", ignore=shutil.ignore_patterns("__pycache__")
        )
        (folder / "a.yaml").write_text(COMPUTED)
        done = self.hodo("run", "a.yaml")
        assert done.returncode == 0, done.stderr

    def hodo(self, *arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
        # -P: not the folder of the script, which is that of this suite, but the copy comes first.
        command = [sys.executable, "-P", "-m", "hodo_cli.cli", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        return subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False
        )

    def plan(self) -> list[str]:
        done = self.hodo("run", "a.yaml", "--dry-run")
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    return Copy(tmp_path_factory.mktemp("copy"))


RERUNS = {
    "models/body.py": {"single", "swept"},
    "engines/collocation.py": {"single", "swept"},
    "integration/error.py": {"single", "swept"},
    "schema/expression.py": {"single", "swept"},
    "sweeps/columns.py": {"swept"},
    "cases/sweep_block.py": {"swept"},
    # Together.
    "cases/case.py schema/document.py progress.py results/layout.py results/resume.py "
    "claims/checks.py figures/maps.py text.py cli.py": set(),
}


@pytest.mark.parametrize("changed", RERUNS)
def test_one_line_in_a_folder_reruns_what_it_computes(copy: Copy, changed: str) -> None:
    paths = [copy.folder / "hodo_cli" / source for source in changed.split()]
    before = [path.read_text() for path in paths]
    try:
        for path, text in zip(paths, before, strict=True):
            path.write_text(text + "CHANGED = True\n")
        assert copy.plan() == [
            f"{name}: {CODE if name in RERUNS[changed] else KEPT}" for name in ("single", "swept")
        ]
    finally:
        for path, text in zip(paths, before, strict=True):
            path.write_text(text)


def test_nothing_is_integrated_to_see_what_runs(tmp_path, monkeypatch):
    def no_integration(*arguments: object) -> None:
        raise AssertionError("integrated")

    monkeypatch.setattr(choice, "solve", no_integration)
    text = COMPUTED.replace("method: collocation", "method: auto").replace("0.005, 0.004", "1e7, 1")
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    done = call(tmp_path, "run", "a.yaml", "--dry-run")
    assert done.stdout.count("will run: it has no result yet") == 2
