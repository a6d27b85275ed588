"""The command line: one short function a command. Each imports what it needs, so that `--help`
loads nothing heavy."""

import gc
import json
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import click
from click.shell_completion import CompletionItem

from . import BatchError, HodoError, __version__
from .machine import RESOURCES

# Before numpy loads. The largest matrices have some hundred rows: several threads take longer than
# one, and the last digits would depend on the number of processors.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


_received: list[int] = []
"""The signals that end the command."""


def _end(number: int, frame: object) -> NoReturn:
    """End the command at a signal, by an exception, so that finished work is stored first."""
    _received.append(number)
    raise KeyboardInterrupt(number)


def _end_at_once(lost: Any) -> None:
    """End the process at a signal whose exception Python has `lost`, as in a destructor."""
    if isinstance(lost.exc_value, KeyboardInterrupt):
        os.write(2, b"interrupted\n")
        os._exit(128 + next(iter(lost.exc_value.args), signal.SIGINT))
    sys.__unraisablehook__(lost)


NEW_OBJECTS = 20_000
"""After how many new objects Python looks for garbage. With its usual number, 700, searches that
find nothing take a sixth of the time of reading thousands of cases."""


class Hodo(click.Group):
    """Turns the user's mistakes into one line and exit status 2, Ctrl-C into 130, and SIGTERM into
    143. A command returns its exit status, or None for 0."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except (click.NoSuchOption, click.BadOptionUsage) as error:
            _refuse(ctx, misused(error))

    def invoke(self, ctx: click.Context) -> Any:
        _received.clear()
        try:
            self._invoke(ctx)
        except click.exceptions.Exit:
            raise
        except BaseException as error:
            # A signal that meets a compiled library may cause any error there.
            if not (_received or isinstance(error, KeyboardInterrupt)):
                raise
            is_run = ctx.invoked_subcommand == "run"
            _say("interrupted" + "; finished cases are kept" * is_run)
            ctx.exit(128 + next(iter(_received), signal.SIGINT))

    def _invoke(self, ctx: click.Context) -> None:
        """Invoke the command with handlers of signals, and show its warnings and errors in a line
        each."""
        with ExitStack() as afterwards:
            for number in (signal.SIGINT, signal.SIGTERM):
                afterwards.callback(signal.signal, number, signal.signal(number, _end))
            afterwards.callback(setattr, sys, "unraisablehook", sys.unraisablehook)
            sys.unraisablehook = _end_at_once
            afterwards.callback(gc.set_threshold, *gc.get_threshold())
            gc.set_threshold(NEW_OBJECTS)
            try:
                with warnings.catch_warnings():
                    say_once = cache(_say)  # a command may open a file twice
                    warnings.showwarning = lambda message, *details: say_once(str(message))
                    with _output():
                        status = super().invoke(ctx)
                    ctx.exit(status or 0)
            except SHOWN_IN_A_LINE as error:
                if _received:
                    raise
                # click does not name the command whose option lacks its value.
                if isinstance(error, click.BadOptionUsage) and (name := ctx.invoked_subcommand):
                    error.ctx = click.Context(self.commands[name], ctx, name)
                if not (line := error_line(error)):
                    raise
                if ctx.params["traceback"]:
                    traceback.print_exc()
                _refuse(ctx, line)


@contextmanager
def _output() -> Iterator[None]:
    """A context in which a command prints; an error of its output, such as a full device, is raised
    at the end of the context, and not lost when Python ends."""
    _open_standard_files()
    try:
        yield
    finally:
        try:
            sys.stderr.flush()
        except (OSError, ValueError):  # the unwritten text would decide the exit status
            sys.stderr = open(os.devnull, "w")  # noqa: SIM115
        sys.stdout.flush()


EXTRAS = dict.fromkeys(("dask", "distributed"), "dask distributed")
"""How to install the libraries that only some users need."""


SHOWN_IN_A_LINE = (
    *(HodoError, BatchError, click.UsageError),
    *(ModuleNotFoundError, MemoryError, OSError),
)
"""The errors that `error_line` may show as one line."""


def error_line(error: Exception) -> str:
    """The line for an error that the user can mend; an empty string for an error that keeps its
    traceback, such as a missing module of hodo itself."""
    match error:
        case HodoError() | BatchError():
            return str(error)
        case click.UsageError():
            return misused(error)
        case ModuleNotFoundError(name=str(name)) if name.partition(".")[0] != __package__:
            package = name.partition(".")[0]
            wanted = EXTRAS.get(package, package)
            return f"this needs {package}, which is not installed: pip install {wanted}"
        case MemoryError():
            return "the memory is exhausted, or the limit on it (ulimit -v) too low"
        # Errors of files are reported where files are written. Here it is an error of the output,
        # or of a limit on descriptors or processes.
        case OSError(errno=number) if number in RESOURCES:
            return f"the operating system refuses it: {os.strerror(number).lower()}"
    return ""


def misused(error: click.UsageError) -> str:
    """A wrong option or argument in one line: click's own message takes four."""
    command = error.ctx.command_path if error.ctx else "hodo"
    return f"{command}: {error.format_message().rstrip('.')} (see {command} --help)"


def _open_standard_files() -> None:
    """Make sure that input, output and messages have their descriptors. Otherwise the first opened
    result would take the descriptor of a closed one, and a message would be written into it.

    Raises HodoError if there is no output to print to.
    """
    while (free := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(free)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
        raise HodoError("the standard output is closed")


def _refuse(ctx: click.Context, line: str) -> NoReturn:
    """Print the reason, if that is still possible, and end with status 2."""
    _say(line)
    try:
        sys.stdout.flush()
    except (OSError, ValueError):  # the unwritten text would cause a traceback at the exit
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
    ctx.exit(2)


def _say(message: object) -> None:
    """Print one line on stderr, if it is open."""
    with suppress(OSError, ValueError):
        click.echo(str(message), err=True)


@click.group(cls=Hodo, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="hodo")
@click.option("--traceback", is_flag=True, help="Show the traceback of an error.")
@click.option(
    "--models",
    "own",
    multiple=True,
    metavar="FILE.py",
    help="Add the models of a file of yours (repeatable).",
)
def main(traceback: bool, own: tuple[str, ...]) -> None:
    """Run rigid-body rotation experiments from case files; classify, plot and check the results.

    Exit status: 0 all went well, 1 a case failed or a figure cannot be drawn, 2 bad input, 3 a
    difference from what was expected, 130 interrupted. Completion in bash:
    eval "$(_HODO_COMPLETE=bash_source hodo)".
    """
    # Through the environment, because the processes of -j N and of dask on this machine inherit it.
    # It is read when models are first imported, which no command has done yet.
    if own:
        os.environ["HODO_MODELS"] = os.pathsep.join(map(os.path.abspath, own))


Command = TypeVar("Command", bound=Callable[..., Any])


def _named_in(section: str) -> Callable[..., list[Any]]:
    """The completion of a name of this section, `cases` or `figures`, for a shell: names in the
    configs and results given so far, or file names where none fits."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        from .cases.config import load, parse
        from .storage import open_run

        names: list[str] = []
        # After an option without a value click leaves the arguments in `args`.
        for given in ctx.params.get("runs") or ctx.args:
            # A shell shows no mistakes, and not every word is a file.
            with suppress(HodoError), warnings.catch_warnings(action="ignore"):
                if given.endswith(".h5"):
                    with open_run(given) as result:
                        names += getattr(parse(result.text, given, stored=True), section)
                else:
                    names += getattr(load(given), section)
        items = [CompletionItem(name) for name in names if name.startswith(incomplete)]
        return items or _configs(ctx, param, incomplete)

    return complete


def _configs(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """The case files that come with hodo, for a shell to complete; the user's own files if one
    begins with these letters."""
    from glob import escape, glob

    from .cases.config import BUNDLED_CONFIGS

    names = sorted(path.stem for path in BUNDLED_CONFIGS.glob("*.yaml"))
    items = [CompletionItem(name) for name in names if incomplete and name.startswith(incomplete)]
    if not items or glob(f"{escape(incomplete)}*"):
        return [CompletionItem(incomplete, type="file")]
    return items


def _files(name: str, **how: Any) -> Callable[[Command], Command]:
    """An argument for the names of results or configs."""
    return click.argument(name, type=click.Path(path_type=Path), shell_complete=_configs, **how)


FORMATS = ("png", "svg", "pdf", "csv", "html", "gif")
"""The formats in which a figure can be written."""

RUNS = _files("runs", nargs=-1, required=True)
JSON = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON value instead of a table."
)
GLOBS = click.option(
    "--case",
    "globs",
    multiple=True,
    metavar="GLOB",
    shell_complete=_named_in("cases"),
    help="Only cases whose name matches (repeatable).",
)


def _jobs(doc: str) -> Callable[[Command], Command]:
    """The option for the number of processes."""
    return click.option("-j", "--jobs", type=click.IntRange(1), default=1, metavar="N", help=doc)


def _folder(default: str) -> Callable[[Command], Command]:
    """The option for the folder into which a command writes."""
    return click.option(
        "--out",
        type=click.Path(path_type=Path),
        default=default,
        show_default=True,
        help="Folder to write into.",
    )


@main.command("init")
@click.argument("name", type=click.Path(path_type=Path))
def _init(name: Path) -> None:
    """Write a commented case file NAME.yaml to begin with."""
    from .cases.config import write_new

    click.echo(write_new(name))


@main.command("run")
@_files("configs", nargs=-1, required=True)
@GLOBS
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="CASE.KEY=VALUE",
    help="Change a value: fig4.damping.2=0.002 (repeatable).",
)
@_folder("runs")
@click.option(
    "--force",
    is_flag=True,
    help="Run finished cases again, and replace the result of another config of this name.",
)
@click.option(
    "--prune",
    is_flag=True,
    help="Drop stored cases, and chunks of sweeps, that are no longer in the config.",
)
@_jobs("Run in N processes.")
@click.option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Run on the workers of a dask scheduler.",
)
@click.option("--dry-run", is_flag=True, help="Print what would run, and why; run nothing.")
@click.option("--fail-fast", is_flag=True, help="Start no case after the first that fails.")
@click.option("--quiet", is_flag=True, help="No progress and no warnings on stderr, only failures.")
@click.option(
    "-v", "--verbose", is_flag=True, help="Print why each case runs or is kept, and its end."
)
@JSON
def _run(
    configs: tuple[Path, ...],
    globs: tuple[str, ...],
    overrides: tuple[str, ...],
    out: Path,
    force: bool,
    prune: bool,
    jobs: int,
    scheduler: str | None,
    dry_run: bool,
    fail_fast: bool,
    quiet: bool,
    verbose: bool,
    as_json: bool,
) -> int:
    """Integrate the cases of CONFIGS into runs/NAME.h5.

    A bare NAME is NAME.yaml in this folder, or a case file that comes with hodo, such as paper1.
    Finished cases are kept unless they have changed; cases that have left the config are kept too.
    With --set, the result is runs/NAME,CASE.KEY=VALUE.h5.
    """
    from .cases.config import load
    from .commands import run, show

    if quiet and verbose:
        raise HodoError("--quiet and --verbose exclude each other")
    if jobs > 1 and scheduler:
        raise HodoError(f"-j: leave it out, the workers are those of {scheduler}")
    loaded = [load(path, overrides) for path in configs]
    # A file that is named twice runs once.
    once = {os.path.abspath(config.path): config for config in loaded}
    plans = run.plans([*once.values()], out, globs, force, jobs, prune, overrides)
    if dry_run:
        return _report([row for plan in plans for row in plan.planned()], run.plan_lines, as_json)
    rows = run.run_plans(plans, jobs, scheduler, quiet, verbose, fail_fast)
    failed = [f"{row['case']} ({row['status']})" for row in rows if row["status"] != "ok"]
    count = f"{len(failed)} of {len(rows)} cases did not end well"
    problems = [f"{count}: {', '.join(failed)}"] if failed else []
    return _report(rows, show.case_table, as_json, problems)


def _report(
    rows: Any, table: Callable[[Any], str], as_json: bool = False, problems: Iterable[str] = ()
) -> int:
    """Print rows as a table or as JSON, then problems; return the exit status, 1 if there is a
    problem."""
    from .text import as_json as json_of

    text = json_of(rows) if as_json else table(rows)
    click.echo(text, nl=bool(text))
    for problem in problems:
        _say(problem)
    return int(bool(problems))


@main.command("classify")
@RUNS
@JSON
def _classify(runs: tuple[Path, ...], as_json: bool) -> int:
    """Label the enclosed axes, and find every separatrix crossing.

    The label of each sample and the crossings are added to RUNS: results (*.h5), or configs with a
    result in runs/.
    """
    from .commands import classify

    rows, problems = classify.classify_results(runs)
    return _report(rows, classify.table_of_crossings, as_json, problems)


@main.command("claims")
@RUNS
@JSON
@click.option("--markdown", is_flag=True, help="Print a page in Markdown.")
def _claims(runs: tuple[Path, ...], as_json: bool, markdown: bool) -> int:
    """Check the statements of RUNS against their results.

    The statements are the `claims:` and `errata:` of the case file. The verdicts go into RUNS:
    results (*.h5), or configs with a result in runs/; a config's statements are read anew.
    Exit status 3 if a verdict is not the expected one.
    """
    from .commands import claims

    rows = claims.judge_results(runs)
    text_of = partial(claims.verdict_page, runs) if markdown else claims.verdict_tables
    _report(rows, text_of, as_json)
    return 0 if all(claims.as_expected(row) for part in rows.values() for row in part) else 3


@main.command("plot")
@click.argument(
    "runs",
    nargs=-1,
    required=True,
    metavar="RUN... [FIGURE]...",
    shell_complete=_named_in("figures"),
)
@click.option(
    "--format",
    "formats",
    type=click.Choice(FORMATS),
    multiple=True,
    default=("png",),
    show_default=True,
    help="Format to write (repeatable); gif is a film, of figures of kind body.",
)
@_folder("runs/figures")
@click.option("--force", is_flag=True, help="Draw unchanged figures again too.")
@click.option(
    "--alone",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the page once more, with its pictures in it: one file to send.",
)
@_jobs("Draw in N processes.")
def _plot(
    runs: tuple[str, ...],
    formats: tuple[str, ...],
    out: Path,
    force: bool,
    alone: Path | None,
    jobs: int,
) -> int:
    """Draw the figures of each RUN.

    Without FIGURE all figures are drawn, and a page that shows them. A figure is drawn again when
    its entry in the case file, its cases or hodo have changed. RUN is a result (*.h5), or a config
    with a result in runs/; a config's figures are read anew. A second RUN is named with its ending
    (*.h5, *.yaml). A figure that cannot be drawn (because its case failed, say) is reported in one
    line; the others are drawn, and the exit status is 1.
    """
    from .commands import plot

    files, names = plot.results_and_figures(runs)
    status = 0
    for line, is_problem in plot.draw_results(files, names, formats, out, jobs, force, alone):
        (_say if is_problem else click.echo)(line)
        status |= is_problem
    return status


@main.command("compare")
@_files("a")
@_files("b")
@click.option(
    "--rtol", type=float, help="Relative tolerance (default: the reference's own, else 1e-9)."
)
@click.option(
    "--atol", type=float, help="Absolute tolerance (default: the reference's own, else 0)."
)
@JSON
def _compare(a: Path, b: Path, rtol: float | None, atol: float | None, as_json: bool) -> int:
    """Compare the result A with the reference B.

    A and B are results (*.h5), or configs with a result in runs/. Every case and every variable of
    B is compared: |a - b| <= atol + rtol max|b|, and times may also be off by ten times their
    stated errors. Labels, units, how a case ended and its numbers have to be equal; how it was
    computed is not compared. Exit status 3 if anything differs.
    """
    from .commands import compare

    rows = compare.compare_results(a, b, compare.Tolerance(rtol, atol))
    _report(rows, compare.comparison_table, as_json)
    return 3 if any(row["differs"] for row in rows) else 0


@main.command("bench")
@_files("config")
@GLOBS
@_folder("runs")
@_jobs("Try N cases at once.")
@click.option("--markdown", is_flag=True, help="Print the table in Markdown.")
@click.option("--quiet", is_flag=True, help="No progress on stderr.")
def _bench(
    config: Path, globs: tuple[str, ...], out: Path, jobs: int, markdown: bool, quiet: bool
) -> int:
    """Measure error against run time for every case of CONFIG.

    Its bench: section names the methods and tolerances. The trials go into NAME.bench.h5 as
    one labelled dataset, and a figure of the trials into figures/.
    Exit status 1 if auto gave a wrong result without a warning, or took longer than 10 s.
    """
    from .cases.config import load
    from .commands import bench

    trials = bench.benchmark(load(config), globs, out, jobs, quiet)
    click.echo(bench.table_of_bench(trials, markdown))
    return int(bench.auto_failed(trials))


@main.command("show")
@RUNS
@click.option("--methods", is_flag=True, help="Print a paragraph for a paper on each instead.")
@click.option("--latex", is_flag=True, help="Print the table of cases in LaTeX (with booktabs).")
@JSON
def _show(runs: tuple[Path, ...], methods: bool, latex: bool, as_json: bool) -> int:
    """List the cases in RUNS.

    RUNS are results (*.h5), or configs with a result in runs/. A line says how a case was
    integrated, how it ended, its error and its run time.
    """
    from .commands import show

    if methods:
        return _report(
            [*map(show.methods_of, dict.fromkeys(runs))], show.methods_paragraphs, as_json
        )
    rows = show.stored_cases(runs, with_data=latex)
    return _report(rows, show.latex_table if latex else show.case_table, as_json)


@main.command("merge")
@RUNS
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="C.h5", help="The new result."
)
def _merge(runs: tuple[Path, ...], out: Path) -> None:
    """Write the cases of RUNS into a new result.

    RUNS are results (*.h5), or configs with a result in runs/. The new one has their figures and
    statements too. What has one name in several results must be equal.
    """
    from .commands import merge, show

    merge.merge_results(runs, out)
    _report(show.stored_cases([out]), show.case_table)


@main.command("schema")
@click.option("--table", is_flag=True, help="Print every key in Markdown tables instead.")
def _schema(table: bool) -> None:
    """Print the JSON Schema of case files."""
    from .cases.key_tables import json_schema, key_tables

    click.echo(key_tables() if table else json.dumps(json_schema(), indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
