"""Whole processes, from the shell's point of view: what `hodo run` costs above its imports, and
beside SciPy.

Prints a Markdown table of medians over a few rounds; in each round every command runs once, so that
a machine whose speed drifts slows all of them alike. Run by `make bench`.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROUNDS = 5
ROOT = Path(__file__).parents[1]
CONFIGS = [ROOT / "configs" / f"{name}.yaml" for name in ("paper1", "paper2", "paper3")]

IMPORTS = "import numpy, h5py, heyoka"

# DOP853 at the tightest tolerance that SciPy accepts: about as accurate as it can be, yet 10 to 100
# times less so than the Taylor series. It writes nothing.
SCIPY = """
import sys, time
import numpy as np
from scipy.integrate import solve_ivp
from hodo_cli.cases.config import load
from hodo_cli.models import find
from types import SimpleNamespace
total = 0.0
for case in load(sys.argv[1]).cases.values():
    model = find(case.model, case.form)
    k = SimpleNamespace(**model.constants(case.data))
    times = np.linspace(case.time.start, case.time.end, case.time.samples)
    began = time.perf_counter()
    solve_ivp(lambda t, y: model.rhs(t, y, k), times[[0, -1]], model.start(case.data), "DOP853", times,
              rtol=2.3e-14, atol=1e-16)
    total += time.perf_counter() - began
print(total)
"""

RUN_TIME = "import json, sys; print(sum(row['run_time'] for row in json.load(sys.stdin)))"


def clocked(command: list[str], cache: Path) -> tuple[float, str]:
    """Seconds that a command takes, and what it prints."""
    began = time.perf_counter()
    done = subprocess.run(
        command,
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return time.perf_counter() - began, done.stdout


def measure(config: Path) -> dict[str, float]:
    """The median seconds of each way to run one config; with SciPy for the first paper only."""
    python, hodo = sys.executable, str(Path(sys.executable).with_name("hodo"))
    found: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        with tempfile.TemporaryDirectory() as folder:
            cache, out = Path(folder) / "cache", Path(folder) / "runs"
            command = [hodo, "run", str(config), "--quiet", "--json", "--force", "--out", str(out)]
            imports, _ = clocked([python, "-c", IMPORTS], cache)
            empty, _ = clocked(command, cache)
            filled, rows = clocked(command, cache)
            alone = subprocess.run(
                [python, "-c", RUN_TIME], input=rows, capture_output=True, text=True, check=True
            )
            row = {"imports": imports, "empty": empty - imports, "filled": filled - imports}
            row["alone"] = float(alone.stdout)
            if config is CONFIGS[0]:
                whole, inside = clocked([python, "-c", SCIPY, str(config)], cache)
                row |= {"scipy": whole, "scipy alone": float(inside), "whole": filled}
            for name, value in row.items():
                found.setdefault(name, []).append(value)
    return {name: statistics.median(values) for name, values in found.items()}


def main() -> None:
    """Measure every config and print the table."""
    print(
        "| config | imports | above them, empty cache | above them, filled cache | integration alone |"
    )
    print("|---|---:|---:|---:|---:|")
    first = None
    for config in CONFIGS:
        row = measure(config)
        first = first or row
        print(
            f"| {config.stem} | {row['imports']:.2f} s | {row['empty']:.2f} s | {row['filled']:.2f} s "
            f"| {1e3 * row['alone']:.1f} ms |"
        )
    print(
        f"\nSciPy DOP853 at its tightest tolerance on {CONFIGS[0].stem}: {first['scipy']:.2f} s in all "
        f"({first['scipy'] / first['whole']:.1f} times `hodo run`, which measures errors and writes besides), "
        f"{first['scipy alone']:.2f} s for the integration alone ({first['scipy alone'] / first['alone']:.0f} times)."
    )


if __name__ == "__main__":
    main()
