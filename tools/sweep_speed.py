"""The speed of sweeps: whole processes, beside plain loops over heyoka's batch integrator and over
SciPy.

Random starts of the body of the first paper's Fig. 4, to tau = 1000, with the first crossing.
Prints Markdown tables of processor time, which other work on the machine changes less than the
clock: medians over a few rounds. In each round every command runs once, so that a machine whose
speed drifts slows all of them alike, and a sweep is compared with the plain loop of its own round.
Run by `make speed`.
"""

import ctypes
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial, reduce
from pathlib import Path
from typing import NamedTuple

import h5py
import heyoka as hy
import numpy as np

from hodo_cli.cases.config import parse
from hodo_cli.engines import taylor_batch
from hodo_cli.sweeps.members import prepare

PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h
ROUNDS = 3
MEMBERS = 200_000
FEW = 2_000
COLUMNS = 8_000
SHORT, WHOLE = 2_000, 20_000
CHAINS, CHAIN = 10, 100
GROWING = (1_000, 10_000, 100_000, 1_000_000)
TOL = 1e-12

# Members of every form that vary in one number, over the time of the papers' figures.
TOP = "model: Lagrange-averaged, inertia: {A: 1.5, C: 1}, mu: 0.5, a: [0.125, 1], b: [0.1, 1], "
TOP += "initial: {theta: 60 deg, r: 1.7320508}, sweep: {initial.r: {linspace: [1.5, 2, %d]}}"
CAVITY = "model: cavity+constant, inertia: [8, 8, 4], kappa: 0.6048, torque: [0, 0, -0.1], "
CAVITY += "epsilon: 0.1, initial: {p: 1, q: 0, r: 1}, sweep: {initial.r: {linspace: [.5, 1.5, %d]}}"
BALL = "inertia: [1, 0.8, 0.6], initial: {p: 0, q: 0, G: 1}, time: {end: 1000}, "
BALL += "sweep: {direction: {sphere: {count: %d, seed: 1}}}"
RESISTANCE = "[[5e-3, 1e-3, 0], [1e-3, 4e-3, 0], [0, 0, 3e-3]]"
FORMS = {
    "linear-diag": f"model: linear-diag, damping: [5e-3, 4e-3, 3e-3], {BALL}",
    "tensor": f"model: tensor, resistance: {RESISTANCE}, {BALL}",
    "linear-diag, 101 samples kept": f"model: linear-diag, damping: [5e-3, 4e-3, 3e-3], "
    f"store: [trajectory], {BALL.replace('end: 1000', 'end: 1000, samples: 101')}",
    "torques, full tensor of inertia": "model: torques, damping: 4e-3, kappa: 0.01, "
    + BALL.replace("[1, 0.8, 0.6]", "[[1, 0.05, 0], [0.05, 0.8, 0.02], [0, 0.02, 0.6]]").replace(
        "p: 0, q: 0, G: 1", "p: 0, q: 0, r: 1"
    ),
    "torques, rotor": "model: torques, damping: [5e-3, 4e-3, 3e-3], rotor: [0.1, 0.05, 0.2], "
    + BALL.replace("G: 1", "r: 1"),
    "torques, drag by axes": f"model: torques, quadratic_axes: [5e-3, 4e-3, 3e-3], {BALL}",
    "torques, from rest": "model: torques, damping: 0.01, torque: [0.01, 0.001, 0.002], "
    "inertia: [1, 0.8, 0.6], initial: {p: 0, q: 0, r: 0}, time: {end: 1000}, "
    "sweep: {torque.1: {linspace: [1e-3, 1e-2, %d]}}",
    "torques, one fixed in space": "model: torques, damping: [5e-3, 4e-3, 3e-3], "
    f"space_torque: {{size: 1e-4, direction: [1, 0, 2]}}, {BALL}",
    "cavity, full": f"{CAVITY}, time: {{end: 10}}",
    "cavity, full, spin that reverses": f"{CAVITY}, time: {{end: 30}}",
    "cavity, averaged": f"{CAVITY}, form: averaged, time: {{end: 60}}",
    "top, full (epsilon 0.02)": f"{TOP}, form: full, epsilon: 0.02, time: {{end: 4}}",
    "top, averaged": f"{TOP}, time: {{end: 4}}",
    "top, averaged-u": f"{TOP}, form: averaged-u, time: {{end: 1}}",
    "top, averaged-quadrature (32 nodes)": f"{TOP}, form: averaged-quadrature, time: {{end: 4}}",
}

# What a user of heyoka would write: batches of 8, which is faster than the width that heyoka
# recommends on some machines, the separatrix as an event whose times are kept in a list. Nothing is
# stored, and no error is relative.
PLAIN = """
import sys

import heyoka as hy
import numpy as np

hy.set_logger_level_error()
members, tol, model, events, width = int(sys.argv[1]), float(sys.argv[2]), *sys.argv[3:], 8
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
watch = [hy.nt_event_batch(D, lambda ta, t, *_: times.append(t))] if events == "events" else []
pars, start = np.repeat(np.array(numbers, dtype=float)[:, None], width, 1), np.zeros((3, width))
ta = hy.taylor_adaptive_batch(rhs, start, tol=tol, pars=pars, nt_events=watch)
G = np.random.default_rng(1).standard_normal((3, members))
start = G / np.linalg.norm(G, axis=0) / np.array([[1], [0.8], [0.6]])
for i in range(0, members - members % width, width):
    ta.state[:] = start[:, i : i + width]
    ta.set_time(0.0)
    ta.propagate_until(1000.0)
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


# The motion of one case and its reference, as a user of heyoka would write them.
SCRIPT = """
import heyoka as hy
import numpy as np

p, q, r = hy.make_vars("p", "q", "r")
rhs = [(p, 0.2 * q * r - 0.005 * p), (q, -0.5 * p * r - 0.004 * q), (r, p * q / 3 - 0.003 * r)]
times, motions = np.linspace(0, 1000, 1001), []
for fp in (np.float64, np.longdouble):
    ta = hy.taylor_adaptive(rhs, np.array([0.8, 0.5, 0.74], dtype=fp), fp_type=fp)
    motions.append(ta.propagate_grid(times.astype(fp))[-1])
np.save("motion.npy", motions[0])
print(np.abs(motions[0] - motions[1]).max())
"""

CASES = """
title: short cases
defaults:
  model: linear-diag
  inertia: [1, 0.8, 0.6]
  damping: [0.005, 0.004, 0.003]
cases:
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
    wall = time.perf_counter() - began
    if status:
        sys.exit(f"{' '.join(command)} failed:\n{said.decode()}")
    processes = [used, *orphans()]
    cpu = sum(process.ru_utime + process.ru_stime for process in processes)
    return Cost(wall, cpu, max(process.ru_maxrss for process in processes) * 1024)


def orphans() -> Iterator[resource.struct_rusage]:
    """What the workers have used that a command has left behind."""
    with suppress(ChildProcessError):
        while True:
            yield os.wait4(-1, 0)[2]


def sweep(
    folder: Path, form: str, members: int, jobs: int = 1, error: str = "off", tol: float = TOL
) -> Cost:
    """A sweep through the command line, into a new file."""
    case = f"{FORMS[form] % members}, tol: {tol:g}, error: {error}"
    text = f"title: speed of a sweep\ncases:\n  a: {{{case}}}\n"
    (folder / "sweep.yaml").write_text(text, encoding="utf-8")
    return hodo(folder, "run", "sweep.yaml", "--force", "--quiet", "-j", str(jobs))


def hodo(folder: Path, *arguments: str) -> Cost:
    """A command of hodo."""
    return cost([str(Path(sys.executable).with_name("hodo")), *arguments], folder)


def plain(folder: Path, model: str, members: int, events: str) -> Cost:
    """The plain loop in one process."""
    (folder / "plain.py").write_text(PLAIN, encoding="utf-8")
    return cost([sys.executable, "plain.py", str(members), repr(TOL), model, events], folder)


def middle(costs: list[Cost]) -> Cost:
    """The median of each."""
    return Cost(*(statistics.median(each) for each in zip(*costs, strict=True)))  # type: ignore[arg-type]


def main(members: int, rounds: int, growing: list[int]) -> None:
    """Print the tables."""
    # Workers that outlive their command are then those of this process.
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)
    with tempfile.TemporaryDirectory() as name:
        # heyoka's own cache takes longer to open the more it holds: 0.3 s if it is full.
        os.environ["XDG_CACHE_HOME"] = str(Path(name, "cache"))
        processes(Path(name), rounds)
        print()
        beside(Path(name), members, rounds)
        print()
        peak(Path(name), members)
        print()
        forms(Path(name), max(members // 5, 20_000))
        print()
        grow(Path(name), growing)


def beside(folder: Path, members: int, rounds: int) -> None:
    """Print the table of sweeps beside plain loops."""
    (folder / "scipy_loop.py").write_text(SCIPY, encoding="utf-8")
    commands: dict[str, Callable[..., Cost]] = {}
    for model in ("linear-diag", "tensor"):
        commands |= {
            f"{model}: `hodo run -j 1`, crossings, files": partial(sweep, folder, model),
            f"{model}: `hodo run -j 2`, the same": partial(sweep, folder, model, jobs=2),
            f"{model}: plain loop, events": partial(plain, folder, model, events="events"),
            f"{model}: plain loop, no events": partial(plain, folder, model, events="none"),
        }
    full = 2.0**-52
    commands |= {
        "linear-diag: `hodo run -j 1`, errors measured too": partial(
            sweep, folder, "linear-diag", error="on"
        ),
        "linear-diag: `hodo run -j 1`, tol 2.2e-16": partial(
            sweep, folder, "linear-diag", tol=full
        ),
    }
    for command in commands.values():
        command(members=FEW)  # fills the compiler's cache
    costs: dict[str, list[Cost]] = {what: [] for what in commands}
    for _ in range(rounds):
        for what, command in commands.items():
            costs[what].append(command(members=members))
    print(f"| {members:,} random starts | members/s | CPU time per member, us | plain loop = 1 |")
    print("|---|---|---|---|")
    for what, rounds_of_it in costs.items():
        loops = costs[f"{what.partition(':')[0]}: plain loop, events"]
        ratios = [loop.cpu / own.cpu for loop, own in zip(loops, rounds_of_it, strict=True)]
        form = f"{{what}} | {{rate:,.0f}} | {{cpu:.1f}} | {statistics.median(ratios):.2f}"
        row(form, what, middle(rounds_of_it), members)
    # SciPy is some thousand times slower, so it gets fewer members.
    few = max(members // 5000, 4)
    slow = cost([sys.executable, "scipy_loop.py", str(few)], folder)
    row("{what} | {rate:,.1f} | {cpu:,.0f} |", "linear-diag: SciPy DOP853 at 1e-10", slow, few)


def forms(folder: Path, members: int) -> None:
    """Print the table of every form, one process each."""
    print(f"| {members:,} members | members/s | CPU time per member, us |\n|---|---|---|")
    for form in FORMS:
        sweep(folder, form, members)  # fills the compiler's cache
        row("{what} | {rate:,.0f} | {cpu:.1f}", form, sweep(folder, form, members), members)


def processes(folder: Path, rounds: int) -> None:
    """Print the table of whole processes: one case beside a script, many short ones, and a sweep
    whose step is compiled first."""
    span, start = "time: {end: 1000, samples: 1001}", "initial: {p: 0.8, q: 0.5, r: 0.74}"
    (folder / "one.yaml").write_text(f"{CASES}  a: {{{start}, {span}}}\n", encoding="utf-8")
    (folder / "script.py").write_text(SCRIPT, encoding="utf-8")
    starts = np.random.default_rng(1).uniform(-1, 1, (SHORT, 3)).tolist()
    lines = [
        f"  c{i}: {{initial: {{p: {p}, q: {q}, r: {r}}}, time: {{end: 100, samples: 101}}}}\n"
        for i, (p, q, r) in enumerate(starts)
    ]
    (folder / "many.yaml").write_text(CASES + "".join(lines), encoding="utf-8")
    script = partial(cost, [sys.executable, "script.py"], folder)
    single = partial(hodo, folder, "run", "one.yaml", "--force", "--quiet")
    top = partial(sweep, folder, "top, averaged-quadrature (32 nodes)", WHOLE)
    cold = top()
    for command in (script, single):
        command()  # fills the compiler's cache
    pairs = [(script(), single()) for _ in range(rounds)]
    ratio = statistics.median(own.cpu / other.cpu for other, own in pairs)
    costs = {
        "one case and its error: a script of heyoka alone": middle([pair[0] for pair in pairs]),
        f"one case and its error: `hodo run`, {ratio:.2f} times": middle(
            [pair[1] for pair in pairs]
        ),
        f"top, averaged-quadrature: {WHOLE:,} members, nothing compiled yet": cold,
        f"top, averaged-quadrature: {WHOLE:,} members, compiled before": top(),
        f"{SHORT:,} short cases: `hodo run`": hodo(folder, "run", "many.yaml", "--quiet"),
        f"{SHORT:,} short cases: `hodo run`, nothing to do": hodo(
            folder, "run", "many.yaml", "--quiet"
        ),
        f"{SHORT:,} short cases: `hodo classify`": hodo(folder, "classify", "many.yaml"),
        f"{SHORT:,} short cases: `hodo classify`, nothing to do": hodo(
            folder, "classify", "many.yaml"
        ),
    }
    print("| whole processes | CPU time, s |\n|---|---|")
    for what, spent in costs.items():
        print(f"| {what} | {spent.cpu:.2f} |")


def peak(folder: Path, members: int) -> None:
    """Print the table of floating-point operations, beside what one core can do.

    Its peak is that of chains of x a + b, enough of them to hide each other's latency, compiled as
    a step is. An operation of a step is a sum of two, a product, a root, a comparison or a choice.
    """
    x, a, b = hy.make_vars("x", "a", "b")
    chains = [reduce(lambda y, _: y * a + b, range(CHAIN), x + float(i)) for i in range(CHAINS)]
    fused = hy.cfunc(chains, vars=[x, a, b], batch_size=taylor_batch.WIDTH)
    given, out = np.full((3, COLUMNS), 0.5), np.empty((CHAINS, COLUMNS))
    alone = partial(fused, given, outputs=out, batch_parallel=False)
    best = 2 * CHAIN * CHAINS / seconds(alone)
    print("| one core | operations | ns | of the peak |\n|---|---|---|---|")
    print(f"| the peak, {best / 1e9:.0f} operations in a ns | | | 100 % |")
    for model in ("linear-diag", "tensor"):
        text = f"title: t\ncases:\n  a: {{{FORMS[model] % COLUMNS}}}\n"
        case = parse(text, "sweep.yaml").cases["a"]
        (some,) = prepare(case, np.arange(COLUMNS))
        (event,) = some.events
        step = taylor_batch.build(type(case.system), some.structure, (event,))
        columns, after = np.zeros((6, COLUMNS)), np.empty((step.rows, COLUMNS))
        columns[:3], columns[3] = some.start, 1000
        ends = np.full((2, COLUMNS), [[1000.0], [taylor_batch.stride(TOL, event)]])
        k = np.concatenate((ends[:1], some.constants, ends[1:]))
        alone = seconds(partial(step, columns, k, after))
        cpu = sweep(folder, model, members).cpu
        with h5py.File(folder / "runs" / "sweep.h5") as file:
            whole = cpu / float(file["a"].attrs["steps"])
        compiled = step._step
        operations = len(compiled.dc) - compiled.nvars - compiled.nouts
        for what, each in ((f"{model}: a step", alone), (f"{model}: `hodo run -j 1`", whole)):
            part = operations / each / best
            print(f"| {what} | {operations:,} | {each * 1e9:.0f} | {100 * part:.0f} % |")


def seconds(call: Callable[[], object]) -> float:
    """Processor time of a call for each of COLUMNS: the median of many."""
    found = []
    for _ in range(200):
        began = time.process_time()
        call()
        found.append(time.process_time() - began)
    return statistics.median(found) / COLUMNS


def grow(folder: Path, counts: list[int]) -> None:
    """Print the table of sweeps of growing size."""
    print(
        "| members | seconds | CPU time per member, us | largest process, MB |\n|---|---|---|---|"
    )
    for count in counts:
        one = sweep(folder, "linear-diag", count, 2)
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
