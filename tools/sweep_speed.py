"""The speed of sweeps: whole processes, beside plain loops over heyoka's batch integrator and over
SciPy.

Random starts of the body of the first paper's Fig. 4, to tau = 1000, with the first crossing.
Prints Markdown tables: medians over a few rounds. In each round every command runs once, so that a
machine whose speed drifts slows all of them alike. The processor time stands beside the members
per second, because other work on the machine changes it less. Run by `make speed`.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROUNDS = 3
MEMBERS = 100_000
GROWING = (1_000, 10_000, 100_000, 1_000_000)
TOL = 1e-12

CONFIG = """\
title: speed of a sweep
cases:
  a:
    model: linear-diag
    inertia: [1, 0.8, 0.6]
    damping: [0.005, 0.004, 0.003]
    initial: {p: 0, q: 0, G: 1}
    time: {end: 1000}
    tol: %g
    error: %s
    sweep: {direction: {sphere: {count: %d, seed: 1}}}
"""

# What a user of heyoka would write: batches of the recommended width, the separatrix as an event
# whose times are kept in a list, two processes with half of the starts each. Nothing is stored, and
# no error is relative.
PLAIN = """
import sys
from multiprocessing import get_context

import numpy as np


def half(members, seed, events):
    import heyoka as hy

    hy.set_logger_level_error()
    p, q, r = hy.make_vars("p", "q", "r")
    A1, A2, A3, L1, L2, L3 = (hy.par[i] for i in range(6))
    rhs = [(p, (A2 - A3) / A1 * q * r - L1 * p), (q, (A3 - A1) / A2 * p * r - L2 * q),
           (r, (A1 - A2) / A3 * p * q - L3 * r)]
    D = A1 * (A1 - A2) * p * p - A3 * (A2 - A3) * r * r
    times, width = [], hy.recommended_simd_size()
    watch = [hy.nt_event_batch(D, lambda ta, t, sign, lane: times.append(t))] if events else []
    pars = np.repeat(np.array([1, 0.8, 0.6, 0.005, 0.004, 0.003])[:, None], width, 1)
    tol, start = float(sys.argv[2]), np.zeros((3, width))
    ta = hy.taylor_adaptive_batch(rhs, start, tol=tol, pars=pars, nt_events=watch)
    G = np.random.default_rng(seed).standard_normal((3, members))
    start = G / np.linalg.norm(G, axis=0) / np.array([[1], [0.8], [0.6]])
    for i in range(0, members - members % width, width):
        ta.state[:] = start[:, i : i + width]
        ta.set_time(0.0)
        ta.propagate_until(1000.0)
    return len(times)


if __name__ == "__main__":
    members, events = int(sys.argv[1]), sys.argv[3] == "events"
    with get_context("spawn").Pool(2) as pool:
        pool.starmap(half, [(members // 2, seed, events) for seed in (1, 2)])
"""

SCIPY = """
import sys
import numpy as np
from scipy.integrate import solve_ivp
A, L = (1, 0.8, 0.6), (0.005, 0.004, 0.003)
def rhs(t, y):
    p, q, r = y
    return ((A[1] - A[2]) / A[0] * q * r - L[0] * p, (A[2] - A[0]) / A[1] * p * r - L[1] * q,
            (A[0] - A[1]) / A[2] * p * q - L[2] * r)
def D(t, y):
    return A[0] * (A[0] - A[1]) * y[0] ** 2 - A[2] * (A[1] - A[2]) * y[2] ** 2
G = np.random.default_rng(1).standard_normal((3, int(sys.argv[1])))
for start in (G / np.linalg.norm(G, axis=0) / np.array([[1], [0.8], [0.6]])).T:
    solve_ivp(rhs, (0, 1000), start, "DOP853", events=D, rtol=1e-10, atol=1e-12)
"""


class Cost(NamedTuple):
    """Seconds of a command, by the clock and of the processors, and its largest process in
    bytes."""

    wall: float
    cpu: float
    memory: int


def cost(command: list[str], folder: Path) -> Cost:
    """Run a command."""
    began = time.perf_counter()
    running = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    assert running.stderr is not None
    said = running.stderr.read()
    _, status, used = os.wait4(running.pid, 0)
    if status:
        sys.exit(f"{' '.join(command)} failed:\n{said.decode()}")
    return Cost(time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024)


def sweep(folder: Path, members: int, processes: int, error: str = "off", tol: float = TOL) -> Cost:
    """A sweep through the command line, into a new file."""
    (folder / "sweep.yaml").write_text(CONFIG % (tol, error, members), encoding="utf-8")
    hodo = str(Path(sys.executable).with_name("hodo"))
    return cost([hodo, "run", "sweep.yaml", "--force", "--quiet", "-j", str(processes)], folder)


def plain(folder: Path, members: int, events: str, tol: float = TOL) -> Cost:
    """The plain loop in two processes."""
    (folder / "plain.py").write_text(PLAIN, encoding="utf-8")
    return cost([sys.executable, "plain.py", str(members), repr(tol), events], folder)


def middle(costs: list[Cost]) -> Cost:
    """The median of each."""
    return Cost(*(statistics.median(each) for each in zip(*costs, strict=True)))  # type: ignore[arg-type]


def main(members: int, rounds: int, growing: list[int]) -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as name:
        beside(Path(name), members, rounds)
        print()
        grow(Path(name), growing)


def beside(folder: Path, members: int, rounds: int) -> None:
    """Print the table of sweeps beside plain loops."""
    (folder / "scipy_loop.py").write_text(SCIPY, encoding="utf-8")
    commands = {
        "`hodo run -j 2`, crossings, files": lambda: sweep(folder, members, 2),
        "`hodo run -j 1`, crossings, files": lambda: sweep(folder, members, 1),
        "`hodo run -j 2`, errors measured too": lambda: sweep(folder, members, 2, error="on"),
        "`hodo run -j 2`, tol 2.2e-16": lambda: sweep(folder, members, 2, tol=2.0**-52),
        "plain loop, 2 processes, events, nothing stored": lambda: plain(folder, members, "events"),
        "plain loop, 2 processes, no events": lambda: plain(folder, members, "none"),
    }
    for command in commands.values():
        command()  # fills the compiler's cache
    costs: dict[str, list[Cost]] = {what: [] for what in commands}
    for _ in range(rounds):
        for what, command in commands.items():
            costs[what].append(command())
    print(
        "| first crossing of random starts | members/s | CPU time per member, us |\n|---|---|---|"
    )
    for what, rounds_of_it in costs.items():
        row("{what} | {rate:,.0f} | {cpu:.1f}", what, middle(rounds_of_it), members)
    # SciPy is some thousand times slower, so it gets fewer members.
    few = max(members // 5000, 4)
    slow = cost([sys.executable, "scipy_loop.py", str(few)], folder)
    row("{what} | {rate:,.1f} | {cpu:,.0f}", "SciPy DOP853 at 1e-10, one process", slow, few)


def grow(folder: Path, counts: list[int]) -> None:
    """Print the table of sweeps of growing size."""
    print(
        "| members | seconds | CPU time per member, us | largest process, MB |\n|---|---|---|---|"
    )
    for count in counts:
        one = sweep(folder, count, 2)
        row("{what} | {wall:.1f} | {cpu:.1f} | {memory:.0f}", f"{count:,}", one, count)


def row(form: str, what: str, cost: Cost, members: int) -> None:
    """Print a line of a table; CPU time is per member in microseconds, memory in MB."""
    cpu, memory = cost.cpu / members * 1e6, cost.memory / 1e6
    line = form.format(what=what, rate=members / cost.wall, wall=cost.wall, cpu=cpu, memory=memory)
    print(f"| {line} |")


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else MEMBERS,
        ROUNDS,
        [n for n in GROWING if len(sys.argv) < 2],
    )
