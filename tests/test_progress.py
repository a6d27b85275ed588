"""What is said of the work while it goes on: how far each task is, on terminals only."""

import os
import pty
import select
import subprocess
import sys
import termios
import time
import warnings
from pathlib import Path

import pytest
from conftest import Hodo, call

import hodo_cli
from hodo_cli import progress

pytestmark = pytest.mark.process

SWEEP = {
    "model": "linear-diag",
    "inertia": [1, 0.8, 0.6],
    "damping": [0.005, 0.004, 0.003],
    "initial": {"p": 0, "q": 0, "G": 1},
    "time": {"end": 10, "samples": 2},
    "sweep": {"from": {"sphere": {"count": 600}}},
}


class Terminal:
    """A terminal that stands for stderr, and what has come to it."""

    def __init__(self) -> None:
        self.ours, theirs = pty.openpty()
        termios.tcsetwinsize(theirs, (24, 80))
        self.file = os.fdopen(theirs, "w")
        self.text = ""

    def wait_for(self, words: str) -> None:
        """Read until these words have come."""
        end = time.monotonic() + 60
        while words not in self.text:
            assert time.monotonic() < end, self.text
            assert select.select([self.ours], [], [], 60)[0], self.text
            self.text += os.read(self.ours, 4096).decode()


def shown_on_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """The terminal of this process, with what a bar shows shown at once."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal.file)
    monkeypatch.setattr(progress, "SECONDS_HIDDEN", 0.0)
    monkeypatch.setattr(progress, "TICK_SECONDS", 0.01)
    return terminal


def test_a_terminal_shows_what_runs_and_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = shown_on_terminal(monkeypatch)
    monkeypatch.setattr(warnings, "showwarning", lambda said, *_: print(said, file=terminal.file))
    with progress.Progress(4) as shown:
        shown.report("fig4", 0.75)
        terminal.wait_for("| 19 %, ")
        terminal.wait_for("fig4 75 %")
        shown.done("fig4")
        terminal.wait_for("1/4")
        shown.say("a line of its own")
        terminal.wait_for("\ra line of its own")
        warnings.warn("mind this", stacklevel=1)
        terminal.wait_for("\rmind this")
        shown.done("fig5", "it failed")
        terminal.wait_for("\r[2/4] fig5: \x1b[31mit failed")
        terminal.wait_for("2/4 |")
    print("end", file=terminal.file, flush=True)
    terminal.wait_for("end")
    *_, cleared, end = terminal.text.split("\r")[:-1]
    assert (cleared.strip(" "), end) == ("", "end")


def test_a_terminal_of_unknown_width_shows_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = shown_on_terminal(monkeypatch)
    termios.tcsetwinsize(terminal.file.fileno(), (0, 0))
    with progress.Progress(4) as shown:
        assert list(shown.starting(["fig4", "fig5"])) == ["fig4", "fig5"]
        terminal.wait_for("fig4, fig5")


class Heard(progress.Progress):
    """Notes what is reported."""

    def __init__(self, total: int) -> None:
        super().__init__(total, quiet=True)
        self.heard: list[tuple[str, float]] = []

    def report(self, name: str, share: float) -> None:
        self.heard.append((name, share))


def test_each_item_is_a_task_of_its_own() -> None:
    shown = Heard(2)
    for item in shown.through(["a", "b"], str.upper):
        assert item.islower()
        assert shown.heard[-1] == (item.upper(), 0.0)
    assert shown.heard == [("A", 0.0), ("B", 0.0)]


def test_a_sweep_says_how_far_it_is_chunk_by_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Heard(1)
    monkeypatch.setattr(progress.Progress, "report", lambda _, *said: shown.report(*said))
    hodo_cli.sweep(SWEEP | {"error": "off"}, name="ball")
    assert shown.heard == [("ball", i / 3) for i in range(4)]
    shown.heard.clear()
    hodo_cli.sweep(SWEEP, name="ball")
    shares = [share for _, share in shown.heard]
    assert len(shares) > 4  # measuring errors has tasks of its own
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


def test_pipes_stay_clean(hodo: Hodo, tmp_path: Path) -> None:
    """Nothing but the table; a log of what ran is there for the asking."""
    assert call(tmp_path, "init", "a").returncode == 0
    done = hodo("run", "a.yaml")
    assert (done.stderr, len(done.stdout.splitlines())) == ("", 3)
    why, *_, end = call(tmp_path, "run", "a.yaml", "--force", "-v").stderr.splitlines()
    assert why.endswith("will run: --force")
    assert end.endswith(": ok")
    assert not call(tmp_path, "classify", "runs/a.h5").stderr
    assert not hodo("plot", "runs/a.h5").stderr


def test_a_log_that_takes_nothing_stops_nothing(hodo: Hodo, tmp_path: Path) -> None:
    """Messages are lost with it, results and exit status are not."""
    assert call(tmp_path, "init", "a").returncode == 0
    broken = ("--set", "staying.method=taylor", "--set", "staying.max_steps=1", "--out", ".")
    with open("/dev/full", "w") as full:
        streams = {"capture_output": False, "stdout": subprocess.PIPE, "stderr": full}
        done = hodo("run", "-v", "a.yaml", *broken, **streams)
        assert (done.returncode, len(done.stdout.splitlines())) == (1, 3)
        (result,) = tmp_path.glob("a,*.h5")
        done = hodo("classify", result, **streams)
        assert (done.returncode, len(done.stdout.splitlines())) == (0, 3)
