"""Break the package at random places, one at a time, and see whether a test notices.

`python tools/mutants.py --count 300 --seed 1` clones the last commit, maps once which test calls
which function, draws mutants (an operator, a comparison, a condition, a returned number) and runs
for each the tests that call its function, shortest first. It prints the fate of each with the test
that noticed it; a survivor wants a test or a sentence why it changes nothing, and with one the
status is 1. What was tried before is not tried again, by this seed or another, until `--map`
begins anew from the last commit.

Tools for this exist, but those that choose tests by coverage draw no sample by a seed, and those
that draw one run the whole suite for each mutant: ten minutes, times 300, are two days.
"""

import argparse
import ast
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from time import perf_counter
from types import CodeType
from typing import NamedTuple

import calls
import pytest

ROOT = Path(__file__).parents[1]
WORK = ROOT / "build" / "mutants"
TREE = WORK / "tree"
"""A clone: mutants never touch the code being worked on, and tests that ask git find a checkout."""

MAP, FATES = WORK / "map.json", WORK / "fates.jsonl"

NOTES = WORK / "called"
"""What `calls.py` notes of other processes and threads while a test runs."""

WATCHED = str(TREE / "hodo_cli"), str(NOTES)

ROOMS = ("engines", "integration", "models", "sweeps", "results", "storage", "batch", "commands")
"""The folders of the package that hold numeric, storage and command code."""

SECONDS = 20.0
"""What the tests of one mutant may take together by the map; the longer ones are left out."""

SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.And: ast.Or, ast.Or: ast.And, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


class Mutant(NamedTuple):
    """A change: of the n-th place that can be changed, in a function that begins at a line."""

    path: str
    n: int
    function: int
    line: int
    words: str


class Recorder:
    """A plugin of pytest: the functions of the package that each test calls, in this process and in
    those that it starts, and its seconds."""

    def __init__(self) -> None:
        self.called: dict[str, set[str]] = {}
        self.codes: set[CodeType] = set()
        self.made: dict[str, float] = {}
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: set[str] = set()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        codes = self.codes = set()
        NOTES.write_text("")

        # Nothing else is done here: what each call costs, a test pays a million times.
        def watch(frame: object, event: str, argument: object) -> None:
            codes.add(frame.f_code)  # type: ignore[attr-defined]

        calls.begin(*WATCHED)  # in threads
        sys.setprofile(watch)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
        began = perf_counter()
        made = yield
        self.made[fixturedef.argname] = perf_counter() - began
        return made

    def pytest_runtest_teardown(self, item: pytest.Function) -> None:
        # By itself a test pays for every fixture, here only the first that asks for it.
        self.seconds[item.nodeid] += sum(self.made.get(name, 0) for name in item.fixturenames)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration if report.when == "call" else 0
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        sys.setprofile(None)
        here = (f"{code.co_filename}:{code.co_firstlineno}" for code in self.codes)
        package = f"{TREE}/"
        self.called[nodeid] = {
            place.removeprefix(package)
            for place in {*here, *NOTES.read_text(encoding="utf-8").splitlines()}
            if place.startswith(package)
        }


def recorded(tests: list[str]) -> dict[str, list[tuple[float, str]]]:
    """The tests of each function, shortest first."""
    # Before the tests load the package: both are to come from the clone.
    os.chdir(TREE)
    hook = WORK / "hook"
    hook.mkdir()
    # Python imports a module of this name when it starts, so processes that are spawned note too.
    lines = f"import sys\nsys.path.append({str(ROOT / 'tools')!r})\n"
    lines += f"import calls\ncalls.begin(*{WATCHED!r})\n"
    (hook / "sitecustomize.py").write_text(lines, encoding="utf-8")
    os.environ["PYTHONPATH"] = os.pathsep.join((str(hook), str(TREE)))
    sys.path.insert(0, str(TREE))
    os.register_at_fork(after_in_child=partial(calls.begin, *WATCHED))
    recorder = Recorder()
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    if pytest.main([*options, *tests], plugins=[recorder]) > pytest.ExitCode.TESTS_FAILED:
        sys.exit("the tests could not be mapped")
    tests_of: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for test, functions in recorder.called.items():
        # What fails without a mutant notices none.
        for function in functions if test not in recorder.failed else ():
            tests_of[function].append((round(recorder.seconds[test], 3), test))
    return {function: sorted(of) for function, of in tests_of.items()}


def places(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int]]:
    """What can be changed: a node, how it would read, and the first line of its function."""

    def walk(node: ast.AST, function: int) -> Iterator[tuple[ast.AST, str, int]]:
        if isinstance(node, ast.FunctionDef):
            # As the interpreter counts: from the first decorator.
            function = min([node.lineno, *(item.lineno for item in node.decorator_list)])
        operator = next(iter(getattr(node, "ops", [])), getattr(node, "op", None))
        if function and type(operator) in SWAPS:
            yield node, f"{type(operator).__name__} -> {SWAPS[type(operator)].__name__}", function
        if function and isinstance(node, ast.If | ast.While | ast.IfExp):
            yield node, "condition reversed", function
        if function and isinstance(node, ast.Return) and node.value is not None:
            yield node, "returns 0", function
        for child in ast.iter_child_nodes(node):
            yield from walk(child, function)

    yield from walk(tree, 0)


def mutants(rooms: list[str]) -> list[Mutant]:
    """Every change that can be made in these folders."""
    changes = []
    if unknown := set(rooms) - {path.name for path in (TREE / "hodo_cli").iterdir()}:
        sys.exit(f"no folders of the package: {', '.join(sorted(unknown))}")
    for path in sorted(p for room in rooms for p in (TREE / "hodo_cli" / room).rglob("*.py")):
        name = str(path.relative_to(TREE))
        every = places(ast.parse(path.read_text(encoding="utf-8")))
        for n, (node, words, function) in enumerate(every):
            line = node.lineno  # type: ignore[attr-defined]
            changes.append(Mutant(name, n, function, line, words))
    return changes


def changed(mutant: Mutant) -> str:
    """The text of its module with the mutant in it."""
    tree = ast.parse((TREE / mutant.path).read_text(encoding="utf-8"))
    node = list(places(tree))[mutant.n][0]
    if mutant.words == "condition reversed":
        node.test = ast.UnaryOp(ast.Not(), node.test)  # type: ignore[attr-defined]
    elif isinstance(node, ast.Return):
        node.value = ast.Constant(0)
    elif isinstance(node, ast.Compare):
        node.ops[0] = SWAPS[type(node.ops[0])]()  # type: ignore[assignment]
    else:
        node.op = SWAPS[type(node.op)]()  # type: ignore[attr-defined]
    return ast.unparse(ast.fix_missing_locations(tree))


def fate(mutant: Mutant, tests: list[tuple[float, str]]) -> tuple[str, str]:
    """How the tests take a mutant, and the first that fails."""
    chosen, spent = [], 0.0
    for seconds, test in tests:
        if not chosen or spent + seconds < SECONDS:
            chosen, spent = [*chosen, test], spent + seconds
    if not chosen:
        return "not covered", ""
    target = TREE / mutant.path
    whole = target.read_text(encoding="utf-8")
    target.write_text(changed(mutant), encoding="utf-8")
    # A group of its own, so that what hangs ends with the processes it has begun.
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *chosen], cwd=TREE,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(TREE), "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    try:
        # Several times what they take at rest: what is still running then hangs.
        output, _ = process.communicate(timeout=60 + 4 * spent)
    except subprocess.TimeoutExpired:
        return "hung", ""
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        target.write_text(whole, encoding="utf-8")
    failed = re.search("^(?:FAILED|ERROR) (.*?)(?: - |$)", output, re.MULTILINE)
    # Without a last line a test process has ended before its time, whatever its status says.
    whole_run = process.returncode == 0 and re.search(
        r"^\d+ (passed|skipped)", output, re.MULTILINE
    )
    return "survived" if whole_run else "killed", failed[1] if failed else ""


def begin(tests: list[str]) -> None:
    """Clone the last commit and map its tests, in place of what was tried before."""
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(TREE)], check=True)
    MAP.write_text(json.dumps(recorded(tests)), encoding="utf-8")


def main() -> int:
    """Try a sample; see the head of this file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--map", action="store_true", help="begin anew: clone and map the tests")
    parser.add_argument("--rooms", default=",".join(ROOMS), help="folders to break, with commas")
    parser.add_argument("tests", nargs="*", default=["tests"], help="those to be mapped")
    options = parser.parse_args()
    if options.map or not MAP.exists():
        begin(options.tests)
    # An interruption may have left a mutant in the clone.
    subprocess.run(["git", "checkout", "--quiet", "."], cwd=TREE, check=True)
    tests = json.loads(MAP.read_text(encoding="utf-8"))
    FATES.touch()
    known = {tuple(key): end for *key, end in map(json.loads, FATES.open(encoding="utf-8"))}
    every = mutants(options.rooms.split(","))
    drawn = random.Random(options.seed).sample(every, min(options.count, len(every)))
    fates: Counter[str] = Counter()
    for mutant in drawn:
        key, test = (mutant.path, mutant.n), "known before"
        if key not in known:
            known[key], test = fate(mutant, tests.get(f"{mutant.path}:{mutant.function}", []))
            if known[key] != "not covered":
                with FATES.open("a", encoding="utf-8") as file:
                    print(json.dumps([*key, known[key]]), file=file)
        fates[known[key]] += 1
        print(
            f"{fates.total()}/{len(drawn)} {mutant.path}:{mutant.line}: {mutant.words}:",
            known[key], test, flush=True,
        )  # fmt: skip
    print(f"{len(every)} mutants; tried, seed {options.seed}: {dict(fates)}")
    return 1 if fates["survived"] else 0


if __name__ == "__main__":
    sys.exit(main())
