"""What all tests share: hypothesis' profiles, what is skipped, and `hodo` run as a user runs it."""

import contextlib
import json
import os
import pickle
import resource
import subprocess
import sys
import sysconfig
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, NoReturn, cast

import pytest
from click.testing import CliRunner
from hypothesis import settings

ROOT = Path(__file__).parents[1]

BODY = {
    "model": "linear-diag",
    "inertia": [1, 0.8, 0.6],
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74},
}
FIG4 = BODY | {"damping": [0.005, 0.004, 0.003], "time": {"end": 1000, "samples": 101}}
"""The body of paper 1, and the case of its Fig 4: it crosses the separatrix at t = 305.36."""

# Two runs of the suite are alike; `pytest --hypothesis-profile explore` looks further.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=5000)
settings.load_profile("repeatable")


CACHE = ROOT / "build" / "cache"


def keep_compiled_code_here() -> None:
    """Let hodo keep what it compiles for tests in the clone; other caches stay the user's."""
    theirs = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    with contextlib.suppress(OSError):
        (CACHE / "hodo").mkdir(mode=0o700, parents=True, exist_ok=True)
        (theirs / "matplotlib").mkdir(parents=True, exist_ok=True)
        for name in {*os.listdir(theirs)} - {*os.listdir(CACHE)}:
            (CACHE / name).symlink_to(theirs / name)
    os.environ["XDG_CACHE_HOME"] = str(CACHE)


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):  # else it is that of the process that has started this
        keep_compiled_code_here()
    # Matrices of a hundred rows: the threads of several workers only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


LONG = ("sweep", "safety", "own_models", "dask", "claims", "formulas", "figures", "taylor_batch")
"""The files that take longest: they begin first, so that the workers end together."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.stem.removeprefix("test_") not in LONG)
    from hodo_cli import engines  # late: the cache has its folder now

    for marker, met in (("heyoka", engines.have_taylor), ("quadruple", engines.have_quadruple)):
        wanting = [item for item in items if item.get_closest_marker(marker)]
        if wanting and not met():
            for item in wanting:
                item.add_marker(pytest.mark.skip(reason=f"needs {marker}"))


@pytest.fixture
def quick_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of sweeps compiled without optimisation, in a third of the time; they round otherwise:
    `test_taylor_batch.py` tries the code that users run."""
    from hodo_cli import engines  # late, as above

    if engines.have_taylor():
        from hodo_cli.engines import taylor_batch as batch

        compiled = batch.compiled_function
        quick = {
            "compiled_function": lambda inputs, rows, _: compiled(inputs, rows, 0),
            # Neither kind is taken for the other, in this process or from the disk.
            "build": lru_cache(maxsize=16)(batch.TaylorStep),
            "STEP_SOURCES": [*batch.STEP_SOURCES, "not optimised"],
        }
        for name, value in quick.items():
            monkeypatch.setattr(batch, name, value)


Hodo = Callable[..., subprocess.CompletedProcess[str]]


def run_hodo(folder: Path, *arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run `hodo ARGUMENTS` as a process in a folder, with options of subprocess.run."""
    script = Path(sysconfig.get_path("scripts")) / "hodo"
    command = [str(script), *map(str, arguments)]
    return subprocess.run(
        command, **{"cwd": folder, "capture_output": True, "text": True, **options}
    )


@pytest.fixture
def hodo(request: pytest.FixtureRequest, tmp_path: Path) -> Hodo:
    """`hodo` in `tmp_path`: in this process, or, with the mark `process`, in one of its own."""
    is_apart = request.node.get_closest_marker("process")
    return partial(run_hodo if is_apart else call, tmp_path)


def call(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run `hodo ARGUMENTS` in this process, in a folder."""
    from hodo_cli.cli import main  # late, as above

    with contextlib.chdir(folder):
        done = CliRunner(catch_exceptions=False).invoke(
            main, [*map(str, arguments)], prog_name="hodo"
        )
    return subprocess.CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)


def call_apart(
    folder: Path,
    *arguments: object,
    cwd: Path | None = None,
    preexec_fn: Callable[[], object] = lambda: None,
    **options: Any,
) -> subprocess.CompletedProcess[str]:
    """`call` in a copy of this process, with which the models that it adds and its limits end."""
    if options:
        return run_hodo(folder, *arguments, cwd=cwd or folder, preexec_fn=preexec_fn, **options)
    with tempfile.TemporaryDirectory() as place:
        answer = Path(place, "answer")
        if not (child := os.fork()):
            _answer(answer, cwd or folder, arguments, preexec_fn)
        os.waitpid(child, 0)
        return cast(subprocess.CompletedProcess[str], pickle.loads(answer.read_bytes()))


def counted(function: Callable[..., Any], *arguments: object) -> tuple[Any, int]:
    """What a function returns, and how many functions are called meanwhile: its work."""
    calls = 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        return function(*arguments), calls
    finally:
        sys.setprofile(before)


def wait_until(condition: Callable[[], object]) -> None:
    """Wait for what another process does; a minute is for machines that have much else to do."""
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, "another process does not do what is waited for"
        time.sleep(0.01)


def process_state(pid: int) -> str:
    """The letter by which Linux names the state of a process; empty if there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][:1]
    except OSError:
        return ""


def limit(kind: int, most: int) -> None:
    """Set a limit of this process, which it may lift again."""
    resource.setrlimit(kind, (most, resource.getrlimit(kind)[1]))


def _answer(
    answer: Path, folder: Path, arguments: Sequence[object], preexec_fn: Callable[[], object]
) -> NoReturn:
    """Call `hodo`, store what it did, and end this process."""
    # A new process knows no models yet, for instance.
    for name in [name for name in sys.modules if name.partition(".")[0] == "hodo_cli"]:
        del sys.modules[name]
    try:
        preexec_fn()
        done = call(folder, *arguments)
    except BaseException:
        done = subprocess.CompletedProcess(arguments, 1, "", traceback.format_exc())
    for kind in (resource.RLIMIT_FSIZE, resource.RLIMIT_NOFILE):
        limit(kind, resource.getrlimit(kind)[1])
    answer.write_bytes(pickle.dumps(done))
    os._exit(0)


@cache
def schema() -> dict[str, Any]:
    """What `hodo schema` prints."""
    return dict(json.loads(call(ROOT, "schema").stdout))


def figure_kinds() -> set[str]:
    """The kinds of figure that a case file may have."""
    kinds = schema()["properties"]["figures"]["anyOf"][0]["additionalProperties"]["oneOf"]
    return {keys["properties"]["kind"]["enum"][0] for keys in kinds}


@lru_cache(maxsize=64)
def classified(case: Any) -> tuple[Any, Any]:
    """A `Case` integrated and classified: its `Trajectory` and its `Classification`, made once."""
    from hodo_cli.integration import classify, integrate  # late, as above

    motion = integrate(case)
    omega = motion.variables["omega"]
    return motion, classify(case, motion.method, motion.tol, motion.error, omega)


def exact_motion(case: Any, times: Any) -> Any:
    """The angular velocity (n, 3) at times (n,) of a `Case` with a closed form."""
    import numpy as np  # late, as it reads the number of threads when it loads

    state, exponent = case.system.exact_states(times - case.time.start)
    return np.asarray(np.ldexp(state, exponent[:, np.newaxis]))
