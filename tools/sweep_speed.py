"""The speed of sweeps beside a plain loop over heyoka's batch integrator: `make speed`.

Random starts of the body of the first paper's Fig. 4, to tau = 1000, with the first crossing.
Prints a Markdown table of the processor time of whole processes, which other work on the machine
changes less than the clock: medians over a few rounds. In each round every command runs once, so
that a machine whose speed drifts slows all of them alike, and a sweep is compared with the plain
loop of its own round. `python tools/sweep_speed.py MEMBERS` takes another number of members.
"""

import os
import statistics
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

ROUNDS = 3
MEMBERS = 200_000
FEW = 2_000
"""Members of a run that fills the compiler's cache."""

BALL = "inertia: [1, 0.8, 0.6], initial: {p: 0, q: 0, G: 1}, time: {end: 1000}, tol: 1e-12, "
BALL += "sweep: {direction: {sphere: {count: %d, seed: 1}}}"
FORMS = {
    "linear-diag": "damping: [5e-3, 4e-3, 3e-3]",
    "tensor": "resistance: [[5e-3, 1e-3, 0], [1e-3, 4e-3, 0], [0, 0, 3e-3]]",
}

# What a user of heyoka would write: batches of 8, which is faster than the width that heyoka
# recommends on some machines, the separatrix as an event whose times are kept in a list. Nothing is
# stored, and no error is relative.
PLAIN = """
import sys

import heyoka as hy
import numpy as np

hy.set_logger_level_error()
members, model, width = int(sys.argv[1]), sys.argv[2], 8
p, q, r = hy.make_vars("p", "q", "r")
A1, A2, A3, *k = (hy.par[i] for i in range(12))
pull = (k[0] * A1 * p, k[1] * A2 * q, k[2] * A3 * r)
numbers = [1, 0.8, 0.6, 0.005, 0.004, 0.003]
if model == "tensor":
    pull = [k[i] * p + k[i + 1] * q + k[i + 2] * r for i in (0, 3, 6)]
    numbers = [1, 0.8, 0.6, 0.005, 0.001, 0, 0.001, 0.004, 0, 0, 0, 0.003]
rhs = [(p, ((A2 - A3) * q * r - pull[0]) / A1), (q, ((A3 - A1) * p * r - pull[1]) / A2),
       (r, ((A1 - A2) * p * q - pull[2]) / A3)]
D = A1 * (A1 - A2) * p * p - A3 * (A2 - A3) * r * r
times = []
watch = [hy.nt_event_batch(D, lambda ta, t, *_: times.append(t))]
pars, start = np.repeat(np.array(numbers, dtype=float)[:, None], width, 1), np.zeros((3, width))
ta = hy.taylor_adaptive_batch(rhs, start, tol=1e-12, pars=pars, nt_events=watch)
G = np.random.default_rng(1).standard_normal((3, members))
start = G / np.linalg.norm(G, axis=0) / np.array([[1], [0.8], [0.6]])
for i in range(0, members - members % width, width):
    ta.state[:] = start[:, i : i + width]
    ta.set_time(0.0)
    ta.propagate_until(1000.0)
"""


def processor_time(command: list[str], folder: Path) -> float:
    """Seconds of the processors that a command takes, which leaves no process behind."""
    before = sum(os.times()[2:4])
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed:\n{done.stderr}")
    return sum(os.times()[2:4]) - before


def sweep(folder: Path, model: str, error: str, members: int) -> float:
    """The time of a sweep through the command line, into a new file."""
    case = f"model: {model}, {FORMS[model]}, {BALL % members}, error: {error}"
    text = f"title: speed of a sweep\ncases:\n  a: {{{case}}}\n"
    (folder / "sweep.yaml").write_text(text, encoding="utf-8")
    hodo = str(Path(sys.executable).with_name("hodo"))
    return processor_time([hodo, "run", "sweep.yaml", "--force", "--quiet"], folder)


def plain(folder: Path, model: str, members: int) -> float:
    """The time of the plain loop."""
    (folder / "plain.py").write_text(PLAIN, encoding="utf-8")
    return processor_time([sys.executable, "plain.py", str(members), model], folder)


def main(members: int) -> None:
    """Print the table."""
    print(
        f"| {members:,} random starts | CPU time per member, us | plain loop = 1 |\n|---|---|---|"
    )
    with tempfile.TemporaryDirectory() as name:
        # heyoka's own cache takes longer to open the more it holds: 0.3 s if it is full.
        os.environ["XDG_CACHE_HOME"] = str(Path(name, "cache"))
        for model in FORMS:
            table_rows(model, Path(name), members)


def table_rows(model: str, folder: Path, members: int) -> None:
    """Print the lines of a model."""
    commands = {
        "plain loop, events": partial(plain, folder, model),
        "`hodo run`, crossings, files": partial(sweep, folder, model, "off"),
        "`hodo run`, errors measured too": partial(sweep, folder, model, "on"),
    }
    for command in commands.values():
        command(members=FEW)
    rounds = [[command(members=members) for command in commands.values()] for _ in range(ROUNDS)]
    for what, costs in zip(commands, zip(*rounds, strict=True), strict=True):
        each = statistics.median(costs) / members * 1e6
        ratio = statistics.median(loop / own for (loop, *_), own in zip(rounds, costs, strict=True))
        print(f"| {model}: {what} | {each:.1f} | {ratio:.2f} |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else MEMBERS)
