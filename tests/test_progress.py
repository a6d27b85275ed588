"""What is said of the work while it goes on: how far each task is, on terminals only."""

import os
import pty
import select
import sys
import termios
import time
import warnings
from pathlib import Path

import pytest
from conftest import Hodo

from hodo_cli import progress
from hodo_cli.batch.pool import pool
from hodo_cli.cases.case import Case
from hodo_cli.engines import protocol
from hodo_cli.integration.integrate import integrate
from hodo_cli.progress import Progress, listening, portion, reached, task

DATA = {
    "model": "tensor",
    "inertia": [1, 0.8, 0.6],
    # It meets new units on the way.
    "resistance": [[0.002, 0.001, 0], [0.001, 0.002, 0], [0, 0, 0.002]],
    "initial": {"p": 0.5, "q": 0.25, "r": 1},
    "time": {"end": 2000},
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
        end = time.monotonic() + 20
        while words not in self.text:
            assert time.monotonic() < end, self.text
            assert select.select([self.ours], [], [], 20)[0], self.text
            self.text += os.read(self.ours, 4096).decode()


def test_a_terminal_shows_what_runs_and_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal.file)
    monkeypatch.setattr(warnings, "showwarning", lambda said, *_: print(said, file=terminal.file))
    monkeypatch.setattr(progress, "BRIEF", 0.0)
    monkeypatch.setattr(progress, "TICK", 0.01)
    with Progress(4) as shown:
        with task("fig4"), portion(0.5, 1):
            reached(0.5)
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
    terminal = Terminal()
    termios.tcsetwinsize(terminal.file.fileno(), (0, 0))
    monkeypatch.setattr(sys, "stderr", terminal.file)
    monkeypatch.setattr(progress, "BRIEF", 0.0)
    monkeypatch.setattr(progress, "TICK", 0.01)
    with Progress(4), task("fig4"):
        reached(0.5)
        terminal.wait_for("fig4 50 %")


def test_each_item_is_a_task_of_its_own() -> None:
    heard: list[tuple[str, float]] = []
    with Progress(2, quiet=True) as shown, listening(lambda *said: heard.append(said)):
        for item in shown.each(["a", "b"], str.upper):
            reached(0.5)
            assert item.islower()
    reached(0.7)  # no task, so nobody is told
    assert heard == [("A", 0.0), ("A", 0.5), ("B", 0.0), ("B", 0.5)]


def fractions(case: Case, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What a case says of itself on its way, at every 64th step."""
    monkeypatch.setattr(protocol, "INTERVAL", -1.0)
    heard: list[float] = []
    with listening(lambda name, part: heard.append(part)), task("case"):
        integrate(case)
    return heard


@pytest.mark.parametrize(
    "method", [pytest.param("taylor", marks=pytest.mark.heyoka), "DOP853", "exact"]
)
def test_a_case_says_how_far_it_is(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    data = DATA | {"method": method}
    if method == "exact":
        del data["resistance"]
        data |= {"model": "linear-diag", "damping": 0.01, "time": {"end": 90, "samples": 200_000}}
    heard = fractions(Case.of(data), monkeypatch)
    assert heard == sorted(heard)
    assert heard[0] == 0.0
    # The motion is the first quarter, its error the rest.
    assert any(0 < part < 0.25 for part in heard)
    assert 0.5 < heard[-1] <= 1


def work(name: str) -> str:
    with task(name):
        reached(0.25)
    return name


def test_a_worker_is_heard() -> None:
    heard: list[tuple[str, float]] = []
    with listening(lambda *said: heard.append(said)), pool(2) as workers:
        assert {made for _, made in workers.map(work, ["a", "b"])} == {"a", "b"}
    assert sorted(heard) == [("a", 0.0), ("a", 0.25), ("b", 0.0), ("b", 0.25)]


def test_pipes_stay_clean(hodo: Hodo, tmp_path: Path) -> None:
    """A log has a line for each case that is run, and no other command says anything."""
    assert hodo("init", "a").returncode == 0
    assert hodo("run", "a.yaml").stderr.splitlines()[-1].endswith(": ok")
    for command in ("classify", "claims", "plot", "show"):
        done = hodo(command, "runs/a.h5")
        assert not done.stderr.replace("runs/a.h5 has no claims: or errata:\n", ""), command
