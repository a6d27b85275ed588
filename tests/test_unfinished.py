"""Batches that are running, or were interrupted: what they have finished can be used at once."""

import json
import os
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from conftest import call

from hodo_cli.storage import staging
from hodo_cli.storage.finished_cases import finished_cases, open_batch
from hodo_cli.storage.group import Group
from hodo_cli.storage.hdf5 import open_run
from hodo_cli.storage.writer import Writer, compose, update

CONFIG = """\
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 1, q: 1, r: 1}, time: {end: 9}}
cases:
  first: {damping: 0.1}
  second: {damping: 0.2}
  third: {damping: 0.3}
figures:
  both: {kind: hodograph, cases: [first, second]}
  rest: {kind: hodograph, cases: [third]}
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "a.h5"


@contextmanager
def run_of(path: Path, groups: Mapping[str, Group], text: str = CONFIG) -> Iterator[Writer]:
    """A run that has finished these cases."""
    attributes = {"config": text, "history": "hodo run a.yaml"}
    with compose(path, attributes, ["first", "second", "third"]) as writer:
        for name, group in groups.items():
            writer.add(name, group)
        writer.store()
        yield writer


def interrupted(path: Path, groups: Mapping[str, Group], text: str = CONFIG) -> None:
    """A run that was interrupted when it had finished these cases."""
    with suppress(KeyboardInterrupt), run_of(path, groups, text):
        raise KeyboardInterrupt


def published(path: Path) -> None:
    """What any change of a result does first."""
    with update(path):
        pass


def stored(seed: int, status: str = "ok") -> Group:
    return Group({"hash": f"hash {seed}", "status": status, "case": "", "message": ""}, {})


def hashes(path: Path) -> dict[str, str]:
    with open_batch(path) as run:
        return {name: run.summary(name)["hash"] for name in run.cases()}


def test_cases_come_in_the_order_of_their_config(path: Path) -> None:
    """Then those that it has not."""
    interrupted(path, {name: stored(1) for name in ("other", "third", "first")})
    with pytest.warns(UserWarning, match="3 finished in a run"), open_batch(path) as run:
        assert run.cases() == ["first", "third", "other"]


@pytest.mark.filterwarnings("ignore:.*in a run that has not ended:UserWarning")
def test_the_case_file_is_stored_once_for_all_pieces(path: Path) -> None:
    text = CONFIG + "# " + 100_000 * "x"
    with run_of(path, {"first": stored(1), "second": stored(2)}, text):
        sizes = [file.stat().st_size for file in path.parent.rglob("*.h5")]
        assert 100_000 < sum(sizes) < 200_000
        with open_batch(path) as run:
            assert (run.text, run.cases()) == (text, ["first", "second"])
    # Those of a dead run are shown with the case file of the run that has taken them over.
    other = path.with_name("b.h5")
    interrupted(other, {"first": stored(1)})
    with compose(other, {"config": text}) as writer:
        assert writer.keep(finished_cases(path)["first"][0])
        texts = set()
        for file in path.parent.glob(".b.h5.*/head.h5"):
            with open_run(file) as run:
                texts.add(run.text)
        assert texts == {CONFIG, text}


@pytest.mark.parametrize("is_running", [True, False])
def test_finished_cases_are_shown_classified_and_plotted(path: Path, is_running: bool) -> None:
    (path.parent.parent / "a.yaml").write_text(CONFIG, encoding="utf-8")
    assert call(path.parent.parent, "run", "a.yaml", "--out", "whole").returncode == 0
    with open_run(path.parent.parent / "whole" / "a.h5") as run:
        groups = {name: run.read(name) for name in ("second", "first", "third")}
    last = groups.pop("third")
    with suppress(KeyboardInterrupt), run_of(path, groups) as writer:
        if not is_running:
            raise KeyboardInterrupt
        use(path)
        writer.add("third", last)
    if not is_running:
        use(path)
        return
    with open_run(path) as run:  # what was added meanwhile has stayed
        assert run.cases() == ["first", "second", "third"]
        labelled = ["enclosed_axis" in run.read(name).variables for name in run.cases()]
        assert labelled == [True, True, False]


def use(path: Path) -> None:
    folder, warning = path.parent.parent, "2 finished in a run that has not ended: first, second"
    shown = call(folder, "show", "runs/a.h5", "--json")
    assert [row["case"] for row in json.loads(shown.stdout)] == ["first", "second"]
    drawn = call(folder, "plot", "runs/a.h5", "both", "--format", "csv")
    assert "is not classified" in drawn.stderr
    assert warning in shown.stderr
    assert warning in drawn.stderr
    assert not path.exists()  # reading leaves no trace
    classified = call(folder, "classify", "runs/a.h5", "--json")
    assert [row["start"] for row in json.loads(classified.stdout)] == ["x1", "x1"]
    assert classified.returncode == 0
    drawn = call(folder, "plot", "runs/a.h5", "--format", "csv")
    assert drawn.stdout.splitlines()[0].endswith("both.csv")
    assert "rest: runs/a.h5 has no result of case third yet: run it first" in drawn.stderr


def test_a_changed_case_is_shown_and_stays_apart(path: Path) -> None:
    """The result before the change may be wanted again; a failure hides no good result."""
    with run_of(path, {"first": stored(1), "second": stored(1), "third": stored(1)}):
        pass
    interrupted(path, {"first": stored(2), "second": stored(2, "failed"), "third": stored(1)})
    with pytest.warns(UserWarning, match="a.h5: 1 finished in a run"):
        assert hashes(path) == {"first": "hash 2", "second": "hash 1", "third": "hash 1"}
    published(path)
    with open_run(path) as run:
        assert run.summary("first")["hash"] == "hash 1"
    assert [item.attributes["hash"] for item in finished_cases(path)["first"]] == [
        "hash 1",
        "hash 2",
    ]


def test_of_two_runs_that_have_not_ended_the_later_one_is_shown(path: Path) -> None:
    with run_of(path, {"first": stored(1)}):
        (earlier,) = path.parent.rglob("2.h5")
        with run_of(path, {"first": stored(2)}):
            (later,) = {*path.parent.rglob("2.h5")} - {earlier}
            for last, file in enumerate([earlier, later, earlier], 1):
                os.utime(file, ns=(0, time.time_ns() + last * 10**9))
                with pytest.warns(UserWarning, match="1 finished in a run"):
                    assert hashes(path) == {"first": f"hash {1 if file == earlier else 2}"}


def test_cases_are_added_in_the_order_of_the_config(path: Path) -> None:
    with run_of(path, {"second": stored(1)}, "cases: {}"):
        pass
    interrupted(path, {"third": stored(1), "first": stored(1)})
    published(path)
    with open_run(path) as run:
        assert run.cases() == ["first", "second", "third"]
        assert run.text == CONFIG  # which has the figures of the new cases


def test_a_changed_case_is_not_lost_when_others_are_added(path: Path) -> None:
    with run_of(path, {"first": stored(1)}):
        pass
    interrupted(path, {"first": stored(2), "second": stored(2)})
    published(path)
    with open_run(path) as run:
        assert [run.summary(name)["hash"] for name in run.cases()] == ["hash 1", "hash 2"]
    assert {case.attributes["hash"] for case in finished_cases(path)["first"]} == {
        "hash 1",
        "hash 2",
    }


def test_chunks_of_a_sweep_wait_for_the_next_run(path: Path) -> None:
    with suppress(KeyboardInterrupt), run_of(path, {"first": stored(1)}) as writer:
        writer.add_chunk("stamp", 0, stored(1))
        raise KeyboardInterrupt
    published(path)
    with open_run(path) as run:
        assert run.cases() == ["first"]
    with compose(path, {}) as writer:
        assert writer.chunks("stamp") == {0}
        writer.keep(finished_cases(path)["first"][0])
        assert [*path.parent.glob(".*/part-*.h5")]


def test_of_a_sweep_that_is_half_done_this_is_said(path: Path) -> None:
    with suppress(KeyboardInterrupt), run_of(path, {}) as writer:
        writer.add_chunk("stamp", 0, stored(1))
        raise KeyboardInterrupt
    shown = call(path.parent, "show", path)
    assert shown.returncode == 2
    assert "no case is there yet: a run has finished parts of a sweep" in shown.stderr


def test_a_result_that_is_damaged_is_left_alone(path: Path) -> None:
    with run_of(path, {"first": stored(1), "second": stored(1)}):
        pass
    content = path.read_bytes()
    path.write_bytes(content.replace(b"hash 1", b"hash 7", 1))
    interrupted(path, {"third": stored(1)})
    before = path.read_bytes()
    published(path)
    assert path.read_bytes() == before


def test_what_is_unfinished_is_as_private_as_its_result(path: Path) -> None:
    """After a kill too: whoever may not read the result may not read what it is made of."""
    with run_of(path, {"first": stored(1)}):
        pass
    path.chmod(0o600)
    interrupted(path, {"second": stored(2)})
    (folder,) = staging.staging_folders(path)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    with staging.replacing(path) as draft:
        assert stat.S_IMODE(draft.parent.stat().st_mode) == 0o700
        draft.write_bytes(path.read_bytes())
    published(path)
    assert hashes(path) == {"first": "hash 1", "second": "hash 2"}
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_change_leaves_what_dead_runs_have_finished(path: Path) -> None:
    """And takes away what they have left behind with nothing in it."""
    with run_of(path, {"first": stored(1)}):
        pass
    with suppress(KeyboardInterrupt), run_of(path, {}) as writer:
        writer.add_chunk("stamp", 0, stored(1))
        raise KeyboardInterrupt
    (path.parent / ".a.h5.dead.partial").mkdir()
    with update(path) as changes:
        changes.write("first", Group({"note": "new"}, {}))
    (folder,) = staging.staging_folders(path)
    assert [*folder.glob("part-stamp-0.h5")]


def test_a_run_that_ends_as_its_cases_are_looked_up_leaves_the_result(path: Path) -> None:
    with run_of(path, {"first": stored(1)}):
        pass
    # Its folder vanishes file by file.
    interrupted(path, {"second": stored(1)})
    for head in path.parent.glob(".a.h5.*/head.h5"):
        head.unlink()
    assert hashes(path) == {"first": "hash 1"}
    published(path)
    assert hashes(path) == {"first": "hash 1"}
