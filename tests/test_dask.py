"""Runs on a dask scheduler with two worker processes, all on the loopback interface, one of them
killed on the way."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pytest
from conftest import Hodo

pytest.importorskip("distributed")

SWEEP = """\
title: t
defaults: {inertia: [1, 0.8, 0.6], time: {end: 1000, samples: 5}}
cases:
  ball:
    model: linear-diag
    damping: [0.005, 0.004, 0.003]
    initial: {p: 0, q: 0, G: 1}
    error: off
    sweep: {direction: {sphere: {count: COUNT, seed: 1}}}
  single:
    model: tensor
    resistance: {diagonal: 0.003, off_diagonal: 0.001}
    initial: {p: 0.5, q: 0.25, G: 1}
"""


class Cluster(NamedTuple):
    address: str
    workers: list[subprocess.Popen[bytes]]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler and two workers, each a process of its own that ends with the test."""
    file = tmp_path / "scheduler.json"
    common = ["--host", "127.0.0.1", "--scheduler-file", str(file), "--no-dashboard"]

    def start(what: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{what}", *common, *options]
        return subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=tmp_path
        )

    running = [start("dask_scheduler", "--port", "0")]
    try:
        running += [start("dask_worker", "--nthreads", "1", "--no-nanny") for _ in range(2)]
        yield Cluster(address(file), running[1:])
    finally:
        for process in running:
            process.kill()
            process.wait()


def address(file: Path) -> str:
    """The scheduler's address, once both workers have joined it."""
    from distributed import Client

    deadline = time.monotonic() + 60
    # Its last character comes last; a file that is half written is no JSON yet.
    while not (file.exists() and file.read_text().endswith("}")) and time.monotonic() < deadline:
        time.sleep(0.05)
    found = str(json.loads(file.read_text())["address"])
    assert found.startswith("tcp://127.0.0.1:")
    with Client(found, timeout=30) as client:
        client.wait_for_workers(2, timeout=60)
    return found


def equal(a: Path, b: Path) -> None:
    with h5py.File(a) as ours, h5py.File(b) as theirs:
        assert list(ours) == list(theirs)
        for case in ours:
            assert ours[case].attrs["status"] == "ok"
            for name, values in ours[case].items():
                if values.dtype.kind in "if":
                    assert np.array_equal(values[...], theirs[case][name][...], equal_nan=True), (
                        f"{case}/{name}"
                    )


@pytest.mark.heyoka
def test_a_worker_that_is_killed_costs_only_a_retry(
    tmp_path: Path, hodo: Hodo, cluster: Cluster
) -> None:
    (tmp_path / "a.yaml").write_text(SWEEP.replace("COUNT", "24000"), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "hodo_cli.cli",
        "run",
        "a.yaml",
        "--scheduler",
        cluster.address,
        "--out",
        "far",
    ]
    running = subprocess.Popen(
        command, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while (
        len(list(tmp_path.glob("far/.a.h5.*.partial/part-*.h5"))) < 2
        and time.monotonic() < deadline
    ):
        assert running.poll() is None
        time.sleep(0.01)
    os.kill(cluster.workers[0].pid, signal.SIGKILL)
    parts = len(list(tmp_path.glob("far/.a.h5.*.partial/part-*.h5")))
    assert 2 <= parts < 16  # it was under way
    _, said = running.communicate(timeout=120)
    assert running.returncode == 0, said.decode()
    assert cluster.workers[0].wait() == -signal.SIGKILL
    assert cluster.workers[1].poll() is None
    here = hodo("run", "a.yaml", "--out", "here")
    assert here.returncode == 0, here.stderr
    equal(tmp_path / "far" / "a.h5", tmp_path / "here" / "a.h5")


@pytest.mark.heyoka
def test_a_cluster_of_this_machine(tmp_path: Path, hodo: Hodo) -> None:
    (tmp_path / "a.yaml").write_text(SWEEP.replace("COUNT", "600"), encoding="utf-8")
    for out, options in (("far", ["--scheduler", "dask", "-j", "2"]), ("here", [])):
        done = hodo("run", "a.yaml", "--out", out, *options, timeout=120)
        assert done.returncode == 0, done.stderr
    equal(tmp_path / "far" / "a.h5", tmp_path / "here" / "a.h5")


@pytest.mark.parametrize("wrong", ["nonsense", "tcp://127.0.0.1:1"])
def test_a_scheduler_that_does_not_answer_is_bad_input(
    tmp_path: Path, hodo: Hodo, wrong: str
) -> None:
    (tmp_path / "a.yaml").write_text(SWEEP.replace("COUNT", "6"), encoding="utf-8")
    done = hodo("run", "a.yaml", "--scheduler", wrong, timeout=120)
    assert done.returncode == 2
    assert done.stderr.startswith(f"no dask scheduler answers at {wrong}: ")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "runs").exists()
