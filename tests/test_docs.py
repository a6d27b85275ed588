"""The documents say what the program does: their tables, commands, links and snippets are tried."""

import re
import subprocess
import sys
from pathlib import Path

import h5py
import pytest
from conftest import ROOT, Hodo, call

from hodo_cli.cases.config import parse
from hodo_cli.cli import main
from hodo_cli.models import catalogue
from hodo_cli.results import layout
from hodo_cli.schema import expression

README = (ROOT / "README.md").read_text(encoding="utf-8")
DOCUMENTS = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md"))
}
documents = pytest.mark.parametrize("name", DOCUMENTS)


def quoted(document: str, name: str) -> str:
    """What stands between a document's markers."""
    pattern = rf"<!-- begin: {name} -->\n(.*?)<!-- end: {name} -->"
    match = re.search(pattern, DOCUMENTS[document], re.DOTALL)
    assert match, f"{document} has no markers for {name}"
    return match[1].strip()


def snippets(document: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", DOCUMENTS[document], re.DOTALL)


def section(document: str, heading: str) -> str:
    """The text under a heading, up to the next one of its level."""
    level = heading.split()[0]
    return DOCUMENTS[document].partition(f"\n{heading}\n")[2].partition(f"\n{level} ")[0]


def test_readme_is_short_lists_the_commands_and_starts_with_figures_and_tests() -> None:
    assert len(README.splitlines()) <= 130
    assert {*re.findall(r"^\| `hodo ([a-z]+)", README, re.MULTILINE)} == {*main.commands}
    assert re.findall(r"^ {4}make ([a-z]+)", README, re.MULTILINE) == ["figures", "test"]


@documents
def test_commands_options_targets_and_files_that_are_named_exist(name: str) -> None:
    text = DOCUMENTS[name]
    written = re.sub(r"<!-- begin: (.*?) -->.*?<!-- end: \1 -->", "", text, flags=re.DOTALL)
    assert {*re.findall(r"\bhodo ([a-z]+)\b(?!-)(?=[^`\n]*`)", written)} <= {*main.commands}
    every = (main, *main.commands.values())
    options = {option for x in every for parameter in x.params for option in parameter.opts}
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    named = {*re.findall(r"(?<=[` ])--[a-z][a-z-]*", prose)}
    named -= {"--strict", "--tls-ca-file", "--tls-cert", "--tls-key"}  # of mypy, and of dask
    assert named <= options | {"--help", "--version"}
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = {*re.findall(r"^([a-z-]+):", makefile, re.MULTILINE)}
    assert {*re.findall(r"(?:`|^ {4})make ([a-z-]+)", text, re.MULTILINE)} <= targets
    files = re.findall(r"`((?:hodo_cli|configs|tests|tools)/[\w/.]+\w)/?`", text)
    if name == "docs/architecture.md":  # which names rooms
        rooms = re.findall(r"`([a-z_]+/[a-z_0-9]*(?:\.py)?)`", text)
        files += [room if (ROOT / room).exists() else f"hodo_cli/{room}" for room in rooms]
        assert len(rooms) > 5
    # `mine` and `NAME` stand for the reader's own files.
    missing = {file for file in files if not (ROOT / file).exists()}
    assert {file for file in missing if not re.search(r"/(mine|NAME)\.", file)} == set()
    for code in snippets(name, "python"):
        compile(code, name, "exec")


def test_the_case_of_the_readme_comes_with_the_package() -> None:
    assert snippets("README.md", "yaml") == [(ROOT / "configs/satellite.yaml").read_text("utf-8")]


@documents
def test_links_lead_somewhere(name: str) -> None:
    here = (ROOT / name).parent
    for target in re.findall(r"\]\((?!https?:)([^)]*)\)", DOCUMENTS[name]):
        file, _, heading = target.partition("#")
        path = (here / file).resolve() if file else ROOT / name
        assert path.exists(), target
        if heading:
            titles = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
            assert heading in slugs, target


def test_the_picture_of_the_layers_is_the_one_that_is_tested() -> None:
    from test_layers import LAYERS

    picture = snippets("docs/architecture.md", "text")[0]
    rows = [re.split(r" {2,}", row.strip())[0] for row in picture.strip().splitlines()]
    assert [set(row.split(" | ")) for row in rows] == [set(row.split()) for row in LAYERS[::-1]]


def test_every_key_is_documented() -> None:
    tables = call(ROOT, "schema", "--table").stdout
    for name in ("case-files", "figures", "claims"):
        part = quoted(f"docs/{name}.md", "keys")
        assert part.startswith("## Keys of ")
        assert tables.startswith(part), f"{name}.md: run `make docs`"
        tables = tables.removeprefix(part).lstrip()
    assert not tables


def test_every_model_is_documented() -> None:
    tool = [sys.executable, "tools/models.py"]
    printed = subprocess.check_output(tool, cwd=ROOT, text=True)
    assert quoted("docs/models.md", "models") == printed.strip(), "run `make docs`"


@documents
def test_case_files_are_right(name: str) -> None:
    for text in snippets(name, "yaml"):
        # Models of one's own, which test_own_models.py defines.
        if "quadratic-drag" in text or "model: heavy" in text:
            continue
        body = "model: linear-diag, inertia: [1, 1, 1], initial: {G: 1, p: 0, q: 0}"
        case = f"{{{body}, time: {{end: 1}}}}"
        cases = "\n".join(f"  {known}: {case}" for known in ("turning", "printed", "corrected"))
        alone = text if "cases:\n" in text else f"cases:\n{cases}\n{text}"
        config = parse(alone, name)
        assert config.cases
        named = {claim["erratum"] for claim in config.claims if claim["erratum"]}
        assert named == {erratum["id"] for erratum in config.errata}


@pytest.mark.heyoka
def test_readme_can_be_followed(hodo: Hodo, tmp_path: Path) -> None:
    """Its case, its commands with what they print, and its snippets, one after the other."""
    case = snippets("README.md", "yaml")[0]
    (tmp_path / "mine.yaml").write_text(case, encoding="utf-8")
    for session in snippets("README.md", "console"):
        for step in session.split("$ hodo ")[1:]:
            line, _, promised = step.partition("\n")
            done = hodo(*line.split())
            assert done.returncode == 0, done.stderr
            printed = done.stderr.split("[1/1]")[0] + done.stdout
            assert vague(printed) == vague(promised)
    for code in snippets("README.md", "python"):
        environment = {"MPLBACKEND": "agg", "PATH": ""}
        subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)


def vague(printed: str) -> list[list[str]]:
    """The words that were printed, without run times and the last digits of numbers."""
    times = re.sub(r"\d+(\.\d+)? (us|ms|s)\b", "TIME", printed)
    errors = re.sub(r"\d(\.\d)?e-\d+", "ERROR", times)
    return [line.split() for line in re.sub(r"(\d+\.\d{6})\d+", r"\1", errors).splitlines()]


def test_the_result_format_is_documented_whole(tmp_path: Path) -> None:
    """Every name in the files of single cases, sweeps and verdicts stands in results.md."""
    head = "    inertia: [1, 0.8, 0.6]\n    time: {end: 5, samples: 3}\n"
    body = f"    model: linear-diag\n{head}    initial: {{p: 0.8, q: 0.5, r: 0.74}}\n"
    ends = (
        "    model: cavity+constant\n    form: averaged\n    inertia: [8, 8, 4]\n"
        "    kappa: 1\n    torque: [0, 0, -10]\n    initial: {x: 1, y: 1}\n    time: {end: 5}\n"
    )
    store = "    store: [omega, crossing_time, crossings, start_axis, share, separation, steps]\n"
    sweep = "    sweep: {direction: {sphere: {count: 3}}, damping.0: {values: [0, 1]}}\n"
    claim = snippets("docs/claims.md", "yaml")[0].replace("[turning]", "[plain]")
    claim += "errata: [{id: sign, where: eq. 1, printed: +, should_be: -}]\n"
    text = f"cases:\n  plain:\n{body}  ends:\n{ends}  swept:\n{body}{sweep}  stored:\n{body}{store}"
    (tmp_path / "all.yaml").write_text(f"{text}{sweep}{claim}", encoding="utf-8")
    for command in ("run all.yaml", "classify runs/all.h5", "claims runs/all.h5"):
        done = call(tmp_path, *command.split())
        assert done.returncode in (0, 3), done.stderr
    named = set(re.findall(r"`(\w+)`", DOCUMENTS["docs/results.md"]))
    for form in (form for forms in catalogue().values() for form in forms.values()):
        assert set(form.variables) <= named
    declared = {*layout.ATTRIBUTES, *layout.CROSSING_COLUMNS, *layout.EVENT_COLUMNS}
    declared |= {f"event_{name}" for name in layout.EVENT_DETAILS}
    declared |= {*layout.MEMBER, *layout.MEMBER_EVENT, *layout.MEMBER_CLASSIFIED}
    declared |= {"growth_rate"}
    assert declared <= named
    own = {"turning", "crossing", "claim", "event", "time", "damping.0", "direction"}
    with h5py.File(tmp_path / "runs" / "all.h5") as file:
        assert set(file.attrs) - named == {"_NCProperties"} & set(file.attrs)
        for group in file.values():
            assert set(group.attrs) <= named
            assert {name for name in group if name not in own} <= named
    assert {"verdict", "crossing_error_quantiles", "classify_warnings", "event_kind"} <= named


def test_a_case_goes_into_other_programs_with_units_and_errors(hodo: Hodo, tmp_path: Path) -> None:
    """pandas, MATLAB and netCDF, as the document writes it."""
    assert hodo("run", "paper1", "--case", "fig4").returncode == 0
    assert hodo("classify", "runs/paper1.h5").returncode == 0
    code = "".join(snippets("docs/results.md", "python"))
    said = subprocess.check_output([sys.executable, "-c", code], cwd=tmp_path, text=True)
    assert "'units': '1', 'error': " in said.splitlines()[-1]
    names, start = (tmp_path / "fig4.csv").read_text().splitlines()[:2]
    assert re.fullmatch(r'time,"x1 in 1, error \de-\d\d",.*', names)
    assert start == "0.0,0.8,0.5,0.74"
    from scipy.io import loadmat

    fields = loadmat(tmp_path / "fig4.mat", simplify_cells=True)["fig4"]
    assert fields["omega"]["value"].shape == (5001, 3)
    assert (fields["crossing_time"]["units"], 0 < fields["omega"]["error"] < 1e-12) == ("1", True)


def test_the_limits_of_an_expression_are_those_of_its_reader() -> None:
    text = section("docs/case-files.md", "## Torques of your own")
    most, deepest = expression.LARGEST_EXPONENT, expression.DEEPEST
    size = f"at most {expression.LONGEST} characters, {expression.MOST_NODES} numbers"
    for words in (f"whole exponents from -{most} to {most}", size, f"and {deepest} levels"):
        assert words in text
    assert all(f"`{name}`" in text for name in expression.FUNCTIONS)


def test_the_version_is_open_and_the_last_one_closed() -> None:
    from hodo_cli import __version__

    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    sections = re.findall(r"^## \[(.*?)\](.*)$", changes, re.MULTILINE)
    assert sections[0] == ("Unreleased", "")
    assert all(re.fullmatch(r" - \d{4}-\d\d-\d\d", date) for _, date in sections[1:])
    assert __version__.endswith(".dev0") == (__version__ != sections[1][0])
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    version, date = sections[1][0], sections[1][1].removeprefix(" - ")
    assert f"\nversion: {version}\ndate-released: {date}\n" in cited


def test_the_licence_is_one_everywhere() -> None:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["license"] == "BSD-3-Clause"
    assert "license: BSD-3-Clause\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    licence = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert licence.startswith("BSD 3-Clause License")
    assert f", {project['authors'][0]['name']}\n" in licence
