"""Break the package at random places, one at a time, and see whether a test notices.

`python tools/mutants.py --count 300 --seed 1` clones the last commit, maps once which test calls
which function, draws mutants (an operator, a comparison, a condition, a returned number) and runs
for each the tests that call its function, shortest first. It prints the fate of each with the test
that noticed it; a survivor wants a test or a sentence why it changes nothing, and with one the
status is 1. What was mapped or tried before, by this seed or another, is not done again until
`--map` begins anew from the last commit.

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
from multiprocessing import Process
from pathlib import Path
from typing import NamedTuple

import calls
import pytest

ROOT = Path(__file__).parents[1]
WORK = ROOT / "build" / "mutants"
TREE = WORK / "tree"
"""A clone: mutants never touch the code being worked on, and tests that ask git find a checkout."""

MAP, FATES = WORK / "map.jsonl", WORK / "fates.jsonl"

NOTES = WORK / "called"
"""What `calls.py` notes while a test runs."""

WATCHED = str(TREE / "hodo_cli"), str(NOTES)

HOOK = WORK / "hook"
"""What processes load that are watched."""

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


def processor_time() -> float:
    """Seconds of this process and those that it has waited for: other work on the machine does not
    count."""
    return sum(os.times()[:4])


class Recorder:
    """A plugin of pytest: adds to the map each test that passes, its seconds, and the functions of
    the package that it calls, in this process and in those that it starts."""

    def __init__(self, known: set[str]) -> None:
        self.known = known
        self.made: dict[str, float] = {}
        self.began = 0.0
        self.failed: set[str] = set()

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = [item for item in items if item.nodeid not in self.known]

    def pytest_runtest_logstart(self) -> None:
        NOTES.write_text("")
        calls.seen.clear()

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
        began = processor_time()
        made = yield
        self.made[fixturedef.argname] = processor_time() - began
        return made

    def pytest_runtest_call(self) -> None:
        self.began = processor_time()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed.add(report.nodeid)

    def pytest_runtest_teardown(self, item: pytest.Function) -> None:
        # By itself a test pays for every fixture, here only the first that asks for it.
        seconds = processor_time() - self.began + sum(map(self.made_in, item.fixturenames))
        functions = sorted(set(NOTES.read_text(encoding="utf-8").splitlines()))
        # What fails without a mutant notices none.
        if item.nodeid not in self.failed:
            with MAP.open("a", encoding="utf-8") as file:
                print(json.dumps([item.nodeid, round(seconds, 3), functions]), file=file)

    def made_in(self, fixture: str) -> float:
        return self.made.get(fixture, 0.0)


def record(tests: list[str], known: set[str]) -> None:
    """Map these tests but for those that are."""
    # Before the tests load the package: both are to come from the clone.
    os.chdir(TREE)
    # Python imports a module of this name when it starts, so processes that are spawned note too.
    HOOK.mkdir(exist_ok=True)
    lines = f"import sys\nsys.path.append({str(ROOT / 'tools')!r})\n"
    lines += f"import calls\ncalls.begin(*{WATCHED!r})\n"
    (HOOK / "sitecustomize.py").write_text(lines, encoding="utf-8")
    os.environ["PYTHONPATH"] = os.pathsep.join((str(HOOK), str(TREE)))
    # What is compiled with notes stays apart.
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix = str(HOOK)
    sys.path.insert(0, str(TREE))
    calls.begin(*WATCHED)
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    ended = pytest.main([*options, *tests], plugins=[Recorder(known)])
    nothing_new = known and ended == pytest.ExitCode.NO_TESTS_COLLECTED
    if ended > pytest.ExitCode.TESTS_FAILED and not nothing_new:
        sys.exit("the tests could not be mapped")


def tests_by_function() -> dict[str, list[tuple[float, str]]]:
    """The tests of each function, by the map, shortest first."""
    tests: dict[str, list[tuple[float, str]]] = defaultdict(list)
    for test, seconds, functions in mapped():
        for function in functions:
            tests[function.removeprefix(f"{TREE}/")].append((seconds, test))
    return {function: sorted(of) for function, of in tests.items()}


def mapped() -> list[tuple[str, float, list[str]]]:
    """The lines of the map: a test, its seconds, the functions that it calls."""
    return [json.loads(line) for line in MAP.open(encoding="utf-8")] if MAP.exists() else []


def places(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int]]:
    """What can be changed: a node, how it would read, and the first line of its function."""

    def walk(node: ast.AST, function: int) -> Iterator[tuple[ast.AST, str, int]]:
        if isinstance(node, ast.FunctionDef):
            function = calls.first_line(node)
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
    """Every change that can be made in these folders and modules; in all of them without names."""
    changes = []
    package = TREE / "hodo_cli"
    if unknown := set(rooms) - {path.stem for path in package.iterdir()}:
        sys.exit(f"no folders or modules of the package: {', '.join(sorted(unknown))}")
    for path in sorted(package.rglob("*.py")):
        if rooms and path.relative_to(package).parts[0].removesuffix(".py") not in rooms:
            continue
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
        # Many times what they take of a processor: what is still running then hangs.
        output, _ = process.communicate(timeout=60 + 10 * spent)
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


def begin() -> None:
    """Clone the last commit, in place of what was tried before."""
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(TREE)], check=True)


def main() -> int:
    """Try a sample; see the head of this file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--map", action="store_true", help="begin anew: clone and map the tests")
    parser.add_argument("--rooms", default="", help="folders and modules to break, with commas")
    parser.add_argument("tests", nargs="*", default=["tests"], help="those to be mapped")
    options = parser.parse_args()
    if options.map or not TREE.exists():
        begin()
    # A test has the process that reads for it signal its parent, which may be this one by a mutant.
    signal.signal(signal.SIGUSR1, lambda *_: None)
    # An interruption may have left a mutant in the clone.
    subprocess.run(["git", "checkout", "--quiet", "."], cwd=TREE, check=True)
    # In a process of its own: it loads the package, and what it starts later would note too.
    recorder = Process(target=record, args=(options.tests, {test for test, *_ in mapped()}))
    recorder.start()
    recorder.join()
    if recorder.exitcode:
        return recorder.exitcode
    tests = tests_by_function()
    FATES.touch()
    known = {tuple(key): end for *key, end in map(json.loads, FATES.open(encoding="utf-8"))}
    every = mutants(list(filter(None, options.rooms.split(","))))
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
