"""Comparing results: every kind of difference is found, and nothing else; the stored datasets are
right."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import series
from conftest import ROOT, call

from hodo_cli.cases.case import parse_case
from hodo_cli.cases.config import load
from hodo_cli.storage import Group, Variable, open_run, save_groups

REFERENCE = ROOT / "runs" / "reference"
CASES = ("fig1-1", "fig4", "fig12-all-entries")

Change = Callable[[dict[str, Group]], object]


def groups(names: tuple[str, ...] = CASES) -> dict[str, Group]:
    """Some cases of paper 1's reference, free to be changed."""
    with open_run(REFERENCE / "paper1.h5") as run:
        cases = {name: run.read(name) for name in names}
    return {
        name: Group(dict(group.attributes), dict(group.variables)) for name, group in cases.items()
    }


def write(path: Path, cases: dict[str, Group]) -> Path:
    save_groups(path, cases)
    return path


Row = dict[str, Any]


def compared(
    folder: Path, change: Change = len, *options: str, reference: Change = len
) -> list[Row]:
    """The lines of `hodo compare --json` for the reference, changed, against the reference."""
    ours, theirs = groups(), groups()
    change(ours)
    reference(theirs)
    paths = write(folder / "a.h5", ours), write(folder / "b.h5", theirs)
    done = call(folder, "compare", *paths, "--json", *options)
    rows = json.loads(done.stdout)
    assert done.returncode == (3 if differing(rows) else 0)
    return list(rows)


def differing(rows: list[Row]) -> list[tuple[str, str]]:
    return [(row["case"], row["variable"]) for row in rows if row["differs"]]


def places(rows: list[Row]) -> set[str]:
    return {row["place"] for row in rows if row["differs"]}


def put(group: Group, name: str, data: np.ndarray) -> None:
    old = group.variables[name]
    group.variables[name] = replace(old, data=data)  # type: ignore[index]


def shifted(case: str, name: str, at: tuple[int, ...], by: float) -> Change:
    """One vector or number moved by `by` times the tolerance of its variable."""

    def change(cases: dict[str, Group]) -> None:
        variable = cases[case].variables[name]
        data = variable.data.copy()
        size = np.abs(data[at[0]]).max()
        data[at] += by * variable.attrs["rtol"] * size
        put(cases[case], name, data)

    return change


def test_a_result_equals_itself(tmp_path: Path) -> None:
    lines = compared(tmp_path)
    assert all(row["scaled"] == 0 for row in lines)
    assert {row["case"] for row in lines} == set(CASES)
    assert {row["variable"] for row in lines if row["case"] == "fig4"} == {
        "time", "omega", "axis", "enclosed_axis", "crossing_time", "crossing_from", "crossing_to",
        "crossing_G", "growth_rate",
    }  # fmt: skip


def test_twice_the_tolerance_in_one_sample_is_found_and_half_of_it_is_not(tmp_path: Path) -> None:
    lines = compared(tmp_path, shifted("fig4", "omega", (17, 1), 2))
    assert differing(lines) == [("fig4", "omega")]
    (row,) = (row for row in lines if row["differs"])
    assert row["scaled"] == pytest.approx(2, rel=1e-3)
    assert row["place"].startswith("time = 425, axis = x2: ")
    assert not differing(compared(tmp_path, shifted("fig4", "omega", (17, 1), 0.5)))


def test_a_crossing_has_a_tolerance_of_its_own(tmp_path: Path) -> None:
    assert differing(
        compared(tmp_path, shifted("fig12-all-entries", "crossing_time", (1,), 2))
    ) == [("fig12-all-entries", "crossing_time")]
    lines = compared(tmp_path, shifted("fig12-all-entries", "crossing_time", (1,), 0.5))
    assert not differing(lines)
    assert max(row["scaled"] for row in lines) == pytest.approx(0.5, rel=1e-3)


def test_a_swapped_label_is_found(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        labels = cases["fig4"].variables["enclosed_axis"].data.copy()
        labels[3] = 3
        put(cases["fig4"], "enclosed_axis", labels)

    lines = compared(tmp_path, change)
    assert differing(lines) == [("fig4", "enclosed_axis")]
    assert [row["place"] for row in lines if row["differs"]] == ["time = 75: x3, not x1"]


def test_a_lost_crossing_is_found(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        for name, variable in cases["fig12-all-entries"].variables.items():
            if variable.dims == ("crossing",):
                put(cases["fig12-all-entries"], name, variable.data[1:])

    lines = compared(tmp_path, change)
    assert ("fig12-all-entries", "crossing_time") in differing(lines)
    assert {row["place"] for row in lines if row["differs"]} == {"2 along crossing, not 3"}


def test_a_dropped_case_an_extra_one_and_a_failed_one_are_found(tmp_path: Path) -> None:
    assert differing(compared(tmp_path, lambda cases: cases.pop("fig4"))) == [("fig4", "")]
    assert differing(compared(tmp_path, reference=lambda cases: cases.pop("fig4"))) == [
        ("fig4", "")
    ]
    assert differing(
        compared(tmp_path, lambda cases: cases["fig4"].attributes.update(status="failed"))
    ) == [("fig4", "status")]


def test_a_value_that_is_no_number_is_found_and_equals_its_like(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        shifted("fig1-1", "omega", (5, 0), np.nan)(cases)

    assert differing(compared(tmp_path, change)) == [("fig1-1", "omega")]
    assert differing(compared(tmp_path, reference=change)) == [("fig1-1", "omega")]
    assert not differing(compared(tmp_path, change, reference=change))

    def infinite(sign: float) -> Change:
        return shifted("fig1-1", "omega", (5, 0), sign * np.inf)

    assert not differing(compared(tmp_path, infinite(1), reference=infinite(1)))
    assert differing(compared(tmp_path, infinite(1), reference=infinite(-1))) == [
        ("fig1-1", "omega")
    ]


def test_a_variable_that_is_gone_is_found(tmp_path: Path) -> None:
    assert differing(compared(tmp_path, lambda cases: cases["fig4"].variables.pop("omega"))) == [
        ("fig4", "omega")
    ]


def test_tolerances_given_replace_the_stored_ones(tmp_path: Path) -> None:
    change = shifted("fig4", "omega", (17, 1), 2)
    assert not differing(compared(tmp_path, change, "--rtol", "1e-11"))
    assert not differing(compared(tmp_path, change, "--atol", "1e-11"))
    assert differing(compared(tmp_path, change, "--rtol", "1e-13"))


def test_what_varies_from_run_to_run_is_left_out(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        cases["fig4"].attributes.update(run_time=77.0, steps=3)

    assert not differing(compared(tmp_path, change))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda fig4: fig4.attributes.update(error=1.0), "error"),
        (lambda fig4: fig4.attributes.update(error=float("nan")), "error"),
        (lambda fig4: fig4.attributes.update(method="BDF"), "method"),
        (lambda fig4: put(fig4, "crossing_error", np.array([1e-3])), "crossing_error"),
        (
            lambda fig4: fig4.attributes.update(
                case=str(fig4.attributes["case"]).replace("0.004", "0.0045")
            ),
            "damping.1",
        ),
        (lambda fig4: fig4.attributes.update(case="nothing"), "case"),
    ],
)
def test_what_is_forged_is_found(
    tmp_path: Path, change: Callable[[Group], object], said: str
) -> None:
    lines = compared(tmp_path, lambda cases: change(cases["fig4"]))
    assert differing(lines) == [("fig4", said)]


ALIKE = {
    "a": "{form: averaged, damping: [0.5, 0.4, 0.3], time: {end: 200, samples: 201}}",
    "b": "{damping: [0.005, 0.004, 0.003], tol: 1e-9, time: {end: 400, unit: s}}",
    "c": """{time: {end: 400}, damping: [0.005, 0.004, 0.003],
        sweep: {damping.0: {linspace: [0.004, 0.006, 5]}}}""",
}


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Group]:
    """A decayed averaged motion, a full one at 1e-9 and a sweep, as the program stores them."""
    folder = tmp_path_factory.mktemp("computed")
    body = "defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: .8, q: .5, r: .74}}"
    cases = "\n".join(f"  {name}: {text}" for name, text in ALIKE.items())
    (folder / "m.yaml").write_text(f"{body}\ncases:\n{cases}\n", encoding="utf-8")
    assert call(folder, "run", "m.yaml", "--quiet").returncode == 0
    assert call(folder, "classify", "runs/m.h5").returncode == 0
    with open_run(folder / "runs" / "m.h5") as run:
        return {name: run.read(name) for name in run.cases()}


def scaled_attribute(name: str, factor: float) -> Callable[[Group], object]:
    return lambda group: group.attributes.update({name: group.attributes[name] * factor})  # type: ignore[attr-defined]


def scaled_variable(name: str, factor: float) -> Callable[[Group], object]:
    return lambda group: put(group, name, group.variables[name].data * factor)


def attribute_of(name: str, **attributes: object) -> Callable[[Group], object]:
    return lambda group: group.variables[name].attrs.update(attributes)


def negated_tail(group: Group) -> None:
    energy = group.variables["kinetic_energy"].data.copy()
    tail = energy < 1e-12 * energy[0]
    assert tail.sum() > 100
    put(group, "kinetic_energy", np.where(tail, -energy, energy))


def in_degrees(group: Group) -> None:
    scaled_variable("omega", 180 / np.pi)(group)
    attribute_of("omega", units="deg/s")(group)


FORGED: list[tuple[str, Callable[[Group], object], str]] = [
    ("b", attribute_of("enclosed_axis", flag_meanings="undetermined separatrix x3 x2 x1"),
     "enclosed_axis:flag_meanings"),
    ("b", attribute_of("crossing_to", flag_values=np.array([-1, 0, 3, 2, 1], dtype=np.int8)),
     "crossing_to:flag_values"),
    ("c", attribute_of("status", flag_meanings="failed ok timeout invalid undecided"),
     "status:flag_meanings"),
    ("a", negated_tail, "kinetic_energy"),
    ("b", lambda b: put(b, "time", b.variables["time"].data + 9e-7), "time"),
    ("b", lambda b: put(b, "time", b.variables["time"].data * (1 + 2e-15)), "time"),
    ("c", scaled_variable("damping.0", 1 + 2e-15), "damping.0"),
    ("b", in_degrees, "omega:units"),
    ("b", attribute_of("omega", units="deg/s"), "omega:units"),
    ("a", lambda a: a.attributes.update(warnings="careful"), "warnings"),
    ("b", lambda b: b.attributes.update(message="ends early"), "message"),
    ("b", lambda b: b.attributes.update(error_kind="exact"), "error_kind"),
    ("c", lambda c: c.attributes.update(members=4), "members"),
    *[
        (case, change(name, factor), said)
        for factor in (900.0, 1 / 900)
        for case, change, name, said in (
            ("a", scaled_attribute, "error", "error"),
            ("b", scaled_attribute, "error", "error"),
            ("b", scaled_variable, "crossing_error", "crossing_error"),
            ("c", scaled_attribute, "error_quantiles", "error_quantiles"),
            ("c", scaled_attribute, "crossing_error_quantiles", "crossing_error_quantiles"),
            ("c", scaled_attribute, "error_levels", "error_levels"),
        )
    ],
]  # fmt: skip


@pytest.mark.parametrize(("case", "change", "said"), FORGED, ids=[said for *_, said in FORGED])
def test_what_a_number_means_and_how_good_it_is_is_compared(
    tmp_path: Path, computed: dict[str, Group], case: str, change: Callable[[Group], object],
    said: str,
) -> None:  # fmt: skip
    def copied() -> dict[str, Group]:
        return {
            name: Group(
                dict(group.attributes),
                {
                    key: replace(variable, attrs=dict(variable.attrs))
                    for key, variable in group.variables.items()
                },
            )
            for name, group in computed.items()
        }

    forged = copied()
    change(forged[case])
    paths = write(tmp_path / "a.h5", forged), write(tmp_path / "b.h5", copied())
    done = call(tmp_path, "compare", *paths, "--json")
    rows = json.loads(done.stdout)
    assert done.returncode == 3
    assert (case, said) in differing(rows)
    assert {name for name, _ in differing(rows)} == {case}


def test_emptied_warnings_are_found(tmp_path: Path) -> None:
    warned = lambda cases: cases["fig4"].attributes.update(warnings="the error 3e-9 is large")  # noqa: E731
    assert differing(compared(tmp_path, reference=warned)) == [("fig4", "warnings")]
    other = lambda cases: cases["fig4"].attributes.update(warnings="the error 4.5e-9 is large")  # noqa: E731
    assert not differing(compared(tmp_path, other, reference=warned))


def test_the_axes_of_a_text_are_no_numbers(tmp_path: Path) -> None:
    def passage(words: str) -> Change:
        return lambda cases: cases["fig4"].attributes.update(predictions=words)

    reference = passage("one crossing, from x3 to x1, at t = -2.5e-3.")
    others = {
        "one crossing, from x1 to x3, at t = -2.5e-3.": [("fig4", "predictions")],
        "one crossing, from x3 to x1, at t = 7.": [],
    }
    for words, found in others.items():
        assert differing(compared(tmp_path, passage(words), reference=reference)) == found


@pytest.mark.parametrize(
    "values",
    [
        np.sin(np.linspace(0, 30, 400)),
        np.exp(-np.linspace(0, 300, 400)) * np.cos(np.linspace(0, 40, 400)),
        np.linspace(0, 1, 50) ** 2,
        np.linspace(1, 0, 50),
    ],
    ids=["oscillating", "decaying", "growing from 0", "ending at 0"],
)
def test_a_scalar_is_judged_by_its_amplitude_about_each_time(
    tmp_path: Path, values: np.ndarray
) -> None:
    rounding = np.random.default_rng(1).uniform(-1, 1, len(values))
    envelope = np.abs(values)
    near = np.maximum.accumulate(envelope[::-1])[::-1]
    amplitude = np.minimum(np.maximum.accumulate(envelope), near)

    def stored(off: np.ndarray) -> Change:
        def change(cases: dict[str, Group]) -> None:
            time = Variable(("time",), np.arange(float(len(values))))
            cases["fig4"] = Group(
                cases["fig4"].attributes,
                {"time": time, "height": Variable(("time",), values + off)},
            )

        return change

    alike = compared(
        tmp_path, stored(0.9e-9 * rounding * amplitude), reference=stored(0 * rounding)
    )
    assert not differing(alike)
    off = np.zeros(len(values))
    off[-len(values) // 4] = 2.5e-9 * amplitude[-len(values) // 4]
    assert differing(compared(tmp_path, stored(off), reference=stored(0 * off)))


def test_parameters_that_differ_come_first(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        text = str(cases["fig4"].attributes["case"])
        cases["fig4"].attributes.update(case=text.replace("0.004", "0.0045"))
        shifted("fig4", "omega", (17, 1), 2)(cases)

    lines = [row for row in compared(tmp_path, change) if row["case"] == "fig4"]
    assert (lines[0]["variable"], lines[0]["place"]) == ("damping.1", "0.0045, not 0.004")


def test_how_a_case_was_computed_is_named_where_its_values_differ(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        text = str(cases["fig4"].attributes["case"])
        cases["fig4"].attributes.update(case=f"{text}tol: 1e-9\n")

    def both(cases: dict[str, Group]) -> None:
        change(cases)
        shifted("fig4", "omega", (17, 1), 2)(cases)

    reference = groups()["fig4"].attributes["tol"]
    tol, *_ = [row for row in compared(tmp_path, both) if row["case"] == "fig4"]
    assert (tol["variable"], tol["place"]) == ("tol", f"1e-09, not {reference}")
    assert not differing(compared(tmp_path, change))


def test_the_tail_of_a_decayed_motion_counts_as_its_start_does(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        omega = cases["fig4"].variables["omega"].data.copy()
        assert np.abs(omega[-1]).max() < 0.1 * np.abs(omega[0]).max()
        omega[-1] = -omega[-1, ::-1]
        put(cases["fig4"], "omega", omega)

    (row,) = (row for row in compared(tmp_path, change) if row["differs"])
    assert (row["variable"], row["scaled"] > 1e8) == ("omega", True)


def without_tolerances(cases: dict[str, Group]) -> None:
    """No tolerance of its own, and errors that are known."""
    for name, variable in cases["fig4"].variables.items():
        attrs = {key: value for key, value in variable.attrs.items() if key != "rtol"}
        cases["fig4"].variables[name] = replace(variable, attrs=attrs)  # type: ignore[index]
    cases["fig4"].attributes.update(error=1e-14)
    put(cases["fig4"], "crossing_error", np.array([1e-12]))


@pytest.mark.parametrize(
    ("name", "at", "allowed"),
    [
        ("omega", (17, 1), 1e-9),
        # Ten times the error that it states, and 100 times that of the state.
        ("crossing_time", (0,), (1e-11 + 305.358955167 * 1e-12) / 305.358955167),
        ("crossing_G", (0,), 1e-12),
    ],
)
def test_a_variable_without_a_tolerance_has_the_default_one_and_a_time_its_stated_error(
    tmp_path: Path, name: str, at: tuple[int, ...], allowed: float
) -> None:
    def off(factor: float) -> Change:
        def change(cases: dict[str, Group]) -> None:
            without_tolerances(cases)
            data = cases["fig4"].variables[name].data.copy()
            data[at] += factor * allowed * np.abs(data[at[0]]).max()
            put(cases["fig4"], name, data)

        return change

    assert not differing(compared(tmp_path, off(0.9), reference=without_tolerances))
    assert differing(compared(tmp_path, off(1.1), reference=without_tolerances)) == [("fig4", name)]


def keeping(rows: slice) -> Change:
    """Some samples of fig4 alone."""

    def change(cases: dict[str, Group]) -> None:
        for name, variable in cases["fig4"].variables.items():
            if variable.dims[:1] == ("time",):
                put(cases["fig4"], name, variable.data[rows])

    return change


def test_samples_are_compared_at_the_reference_s_times(tmp_path: Path) -> None:
    assert not differing(compared(tmp_path, reference=keeping(slice(None, None, 10))))
    for few in (slice(3, 4), slice(0, 0)):
        assert ("fig4", "time") in differing(compared(tmp_path, keeping(few)))


def test_a_missing_sample_is_found(tmp_path: Path) -> None:
    def change(cases: dict[str, Group]) -> None:
        for name, variable in cases["fig4"].variables.items():
            if variable.dims[:1] == ("time",):
                put(cases["fig4"], name, np.delete(variable.data, 17, axis=0))

    assert ("fig4", "time") in differing(compared(tmp_path, change))


def test_results_without_times_are_compared_too(tmp_path: Path) -> None:
    def untimed(shift: float) -> Change:
        def change(cases: dict[str, Group]) -> None:
            share = Variable(("direction",), np.array([0.25, 0.5 + shift]), {"rtol": 1e-9})
            cases["fig4"] = Group(cases["fig4"].attributes, {"share": share})

        return change

    assert not differing(compared(tmp_path, untimed(0.0), reference=untimed(0.0)))
    assert differing(compared(tmp_path, untimed(1e-9), reference=untimed(0.0))) == [
        ("fig4", "share")
    ]


def test_results_of_other_experiments_are_refused(tmp_path: Path) -> None:
    one, other = (groups((name,)) for name in CASES[:2])
    paths = write(tmp_path / "a.h5", one), write(tmp_path / "b.h5", other)
    done = call(tmp_path, "compare", *paths)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "have no case in common" in done.stderr


@pytest.mark.heyoka
def test_the_program_meets_the_reference_and_a_damping_off_by_1e_9_does_not(
    tmp_path: Path,
) -> None:
    config = ROOT / "configs" / "paper1.yaml"
    change = "fig4.damping.0=0.005000000005"
    runs = {"same": "same/paper1.h5", "off": f"off/paper1,{change}.h5"}
    for name, options in (("same", []), ("off", ["--set", change])):
        only = ("--case", "fig4", "--out", name, "--quiet", *options)
        assert call(tmp_path, "run", config, *only).returncode == 0
        assert call(tmp_path, "classify", runs[name]).returncode == 0
    differing = {}
    for name in ("same", "off"):
        done = call(tmp_path, "compare", runs[name], REFERENCE / "paper1.h5", "--json")
        assert done.returncode == 3, done.stderr  # the other cases are missing
        rows = [row for row in json.loads(done.stdout) if row["case"] == "fig4"]
        differing[name] = {row["variable"] for row in rows if row["differs"]}
    assert differing == {
        "same": set(),
        "off": {"damping.0", "omega", "crossing_time", "crossing_G", "growth_rate"},
    }


def test_labels_that_a_result_lacks_are_one_line_a_case(tmp_path: Path) -> None:
    body = "inertia: [1, 0.8, 0.6], initial: {p: .8, q: .5, r: .74}, time: {end: 1, samples: 2}"
    cases = "free: {model: linear-diag}, averaged: {model: linear-diag, form: averaged, damping: 1}"
    (tmp_path / "a.yaml").write_text(f"defaults: {{{body}}}\ncases: {{{cases}}}\n", "utf-8")
    assert call(tmp_path, "run", "a.yaml", "--quiet").returncode == 0
    (tmp_path / "runs" / "bare.h5").write_bytes((tmp_path / "runs" / "a.h5").read_bytes())
    assert call(tmp_path, "classify", "a.yaml").returncode == 0
    done = call(tmp_path, "compare", "runs/bare.h5", "runs/a.h5")
    lines = done.stdout.splitlines()[1:]
    # The averaged motion brings its labels with it.
    assert [line.split()[:2] for line in lines] == [["free", "labels"], ["averaged", "crossing_G"]]
    assert lines[0].endswith("inf  DIFFERS  missing: not classified")
    assert done.returncode == 3


def test_two_forms_of_a_motion_differ_in_their_form_once_and_both_have_labels(
    tmp_path: Path,
) -> None:
    body = "inertia: [1, 0.8, 0.6], initial: {p: .8, q: .5, r: .74}, time: {end: 1, samples: 2}"
    for form in ("full", "averaged"):
        case = f"cases: {{x: {{model: linear-diag, form: {form}, damping: 1, {body}}}}}"
        (tmp_path / f"{form}.yaml").write_text(case, "utf-8")
        assert call(tmp_path, "run", f"{form}.yaml", "--quiet").returncode == 0
        assert call(tmp_path, "classify", f"{form}.yaml").returncode == 0
    done = call(tmp_path, "compare", "runs/averaged.h5", "runs/full.h5", "--json")
    names = [row["variable"] for row in json.loads(done.stdout)]
    assert names.count("form") == 1
    assert "labels" not in names


def test_compare_prints_the_worst_of_each_case_and_says_0_or_3(tmp_path: Path) -> None:
    path = REFERENCE / "paper3.h5"
    same = call(tmp_path, "compare", path, path)
    assert same.returncode == 0, same.stderr
    with open_run(path) as run:
        assert [line.split()[0] for line in same.stdout.splitlines()[1:]] == run.cases()
    assert call(tmp_path, "compare", path, REFERENCE / "paper2.h5").returncode == 2


def test_a_config_stands_for_its_result(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    shutil.copy(REFERENCE / "paper3.h5", tmp_path / "runs")
    done = call(tmp_path, "compare", "paper3", REFERENCE / "paper3.h5")
    assert done.returncode == 0, done.stderr
    assert (
        done.stdout == call(tmp_path, "compare", "runs/paper3.h5", REFERENCE / "paper3.h5").stdout
    )
    lacking = call(tmp_path, "compare", "runs/paper3.h5", "paper2")
    assert lacking.returncode == 2
    assert lacking.stderr.startswith("paper2 has no result runs/paper2.h5: hodo run paper2")
    assert lacking.stderr.count("\n") == 1


# The reference itself.


def test_the_reference_is_small_and_covers_every_case_of_the_papers() -> None:
    assert sum(path.stat().st_size for path in REFERENCE.iterdir()) < 1_500_000
    for config in ROOT.glob("configs/paper*.yaml"):
        with open_run(REFERENCE / f"{config.stem}.h5") as run:
            assert run.cases() == list(load(config).cases)
            assert "quadruple precision" in run.attributes["reference"]
            for name in run.cases():
                assert parse_case(run.summary(name)["case"]).precision == "quadruple"


def sampled(paper: str, name: str, times: list[int]) -> tuple[Group, list[float]]:
    with open_run(REFERENCE / f"{paper}.h5") as run:
        group = run.read(name)
    return group, group.variables["time"].data[times].tolist()


def check(values: np.ndarray, exact: list[list[object]]) -> None:
    """Values (n, m) that were rounded to doubles, against numbers of many digits."""
    truth = np.array([[float(x) for x in row] for row in exact])  # type: ignore[arg-type]
    assert np.abs(values - truth).max() <= 4e-16 * np.abs(truth).max()


@pytest.mark.parametrize(
    "name",
    [
        "fig1-1",
        "fig1-4",
        "fig2-2",
        "fig3-2",
        "fig4",
        "fig6",
        "fig7",
        "fig8",
        "fig11",
        "fig12",
        "fig12-all-entries",
        "fig14-all-entries",
        "fig16-unit-omega",
        "fig18",
    ],
)
def test_states_of_paper_1_agree_with_the_series(name: str) -> None:
    group, times = sampled("paper1", name, [3, -1])
    case = parse_case(group.attributes["case"])
    A, start = case.data["inertia"], case.system.start
    if case.model == "tensor":
        system = series.tensor(A, case.system.matrix.tolist())
    else:
        system = series.diagonal(A, case.data["damping"])
    exact = series.states(system, start, times)
    omega = group.variables["omega"].data[[3, -1]]
    for row, truth in zip(omega, exact, strict=True):
        check(row[None], [truth])


def spelled(paper: int, name: str) -> str:
    """A case as the table of the series calls it."""
    if paper == 1:
        return f"P1 {re.sub('-r(?=[0-9])', ' from r = ', name)}"
    figure, _, form = name.partition("-")
    return f"P2 {figure} averaged-{form}".removesuffix("-")


@pytest.mark.parametrize(("paper", "events"), [(1, 24), (2, 8)])
def test_events_of_every_figure_agree_with_the_series(paper: int, events: int) -> None:
    with open(ROOT / "tests" / "data" / "crossings.csv", encoding="utf-8") as file:
        table = [row for row in csv.DictReader(file) if "ulp" not in row["case"]]
    with open_run(REFERENCE / f"paper{paper}.h5") as run:
        stored = {spelled(paper, name): run.read(name).variables for name in run.cases()}
    assert sum(row["case"] in stored for row in table) == events
    for case, data in stored.items():
        exact = [row for row in table if row["case"] == case]
        if not exact:
            continue
        prefix, value = (
            ("crossing", data["crossing_G"].data) if paper == 1 else ("event", data["x"].data[-1:])
        )
        # To the rounding of a double.
        assert data[f"{prefix}_time"].data == pytest.approx(
            [float(row["time"]) for row in exact], rel=3e-16, abs=0
        )
        assert value == pytest.approx([float(row["value"]) for row in exact], rel=4e-16, abs=0)
        if paper == 1:
            ends = zip(data["crossing_from"].data, data["crossing_to"].data, strict=True)
            assert [f"x{a} to x{b}" for a, b in ends] == [row["event"] for row in exact]


def test_states_of_paper_2_agree_with_the_series() -> None:
    group, times = sampled("paper2", "internal-triaxial", [5, -1])
    case = parse_case(group.attributes["case"])
    k = case.system.constants
    system = series.cavity(case.data["inertia"], k["kappa"], [k["N1"], k["N2"], k["N3"]])
    exact = series.states(system, case.system.start, times)
    check(group.variables["omega"].data[[5, -1]], exact)


def test_states_of_paper_3_agree_with_the_series() -> None:
    group, times = sampled("paper3", "case2-full", [7, -1])
    case = parse_case(group.attributes["case"])
    data, start = case.data, case.system.start
    system = series.lagrange(
        data["inertia"]["A"],
        data["inertia"]["C"],
        data["mu"],
        data["epsilon"],
        data["a"],
        data["b"],
    )
    exact = series.states(system, (*start, 0), times)
    stored = np.hstack([group.variables[name].data[[7, -1]] for name in ("omega", "gamma")])
    check(stored, [row[:6] for row in exact])


def test_the_average_of_paper_3_agrees_with_elliptic_integrals() -> None:
    group, times = sampled("paper3", "case2", [10])
    motion, start = series.paper3("case2")
    exact = motion.states(start, times)
    check(np.array([[group.variables[name].data[10] for name in ("Gz", "H", "r")]]), exact)


def test_the_table_of_crossings_lists_what_the_datasets_hold() -> None:
    with open(REFERENCE / "crossings.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for path in REFERENCE.glob("*.h5"):
        with open_run(path) as run:
            for name in run.cases():
                data = run.read(name).variables
                stored = [
                    *(
                        data[key].data.tolist()
                        for key in ("crossing_time", "event_time")
                        if key in data
                    )
                ]
                listed = [
                    float(row["time"])
                    for row in rows
                    if (row["paper"], row["case"]) == (path.stem, name)
                ]
                assert listed == [time for times in stored for time in times]


def test_equal_values_are_called_equal(tmp_path: Path) -> None:
    assert {row["place"] for row in compared(tmp_path)} == {"equal"}


def test_differences_of_meaning_are_listed_in_the_order_of_the_reference(tmp_path: Path) -> None:
    names = ["omega", "crossing_time", "crossing_G", "growth_rate"]

    def change(cases: dict[str, Group]) -> None:
        for name in names:
            old = cases["fig4"].variables[name]
            other = replace(old, attrs={**old.attrs, "units": "furlong"})
            cases["fig4"].variables[name] = other  # type: ignore[index]

    listed = [name for _, name in differing(compared(tmp_path, change))]
    assert listed == [f"{name}:units" for name in names]
