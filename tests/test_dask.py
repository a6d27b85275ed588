"""Runs on a dask scheduler with two worker processes, one of them killed on the way."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from conftest import Hodo, call, wait_until

pytestmark = pytest.mark.process

pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")

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

    # Its last character comes last; a file that is half written is no JSON yet.
    wait_until(lambda: file.exists() and file.read_text().endswith("}"))
    found = str(json.loads(file.read_text())["address"])
    assert found.startswith("tcp://127.0.0.1:")
    with Client(found, timeout=60) as client:
        client.wait_for_workers(2, timeout=60)
    return found


@pytest.fixture
def cluster_with_certificates(tmp_path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The address of a scheduler with a worker, and what the environment must hold to use it."""
    from distributed import LocalCluster, Security

    pytest.importorskip("cryptography")  # makes the certificates
    security = Security.temporary()
    names = {}
    for name, text in {
        "CA_FILE": security.tls_ca_file,
        "CLIENT__CERT": security.tls_client_cert,
        "CLIENT__KEY": security.tls_client_key,
    }.items():
        (tmp_path / f"{name}.pem").write_text(text)
        names[f"DASK_DISTRIBUTED__COMM__TLS__{name}"] = str(tmp_path / f"{name}.pem")
    with LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, security=security
    ) as there:
        yield there.scheduler_address, names


def equal(a: Path, b: Path) -> None:
    with h5py.File(a) as ours, h5py.File(b) as theirs:
        assert list(ours) == list(theirs)
        for case in ours:
            assert ours[case].attrs["status"] == "ok"
            for name, values in ours[case].items():
                if values.dtype.kind in "if":
                    known = theirs[case][name][...]
                    np.testing.assert_array_equal(values[...], known, err_msg=f"{case}/{name}")


@pytest.mark.heyoka
def test_a_worker_that_is_killed_costs_only_a_retry(tmp_path: Path, cluster: Cluster) -> None:
    (tmp_path / "a.yaml").write_text(SWEEP.replace("COUNT", "6000"), encoding="utf-8")
    command = [sys.executable, "-m", "hodo_cli.cli", "run", "a.yaml", "--out", "far"]
    command += ["--scheduler", cluster.address]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as far:
        wait_until(lambda: len([*tmp_path.glob("far/.a.h5.parts/chunk-*.h5")]) >= 2)  # of 8
        os.kill(cluster.workers[0].pid, signal.SIGKILL)
        said = far.communicate()[1]
    assert (far.returncode, said) == (0, "")
    here = call(tmp_path, "run", "a.yaml", "--out", "here")
    assert here.returncode == 0, here.stderr
    assert cluster.workers[0].wait() == -signal.SIGKILL
    assert cluster.workers[1].poll() is None
    equal(tmp_path / "far" / "a.h5", tmp_path / "here" / "a.h5")


def test_a_scheduler_with_certificates_takes_who_has_them(
    tmp_path: Path, hodo: Hodo, cluster_with_certificates: tuple[str, dict[str, str]]
) -> None:
    """By the variables, or files, with which dask itself is told of them."""
    address, certificates = cluster_with_certificates
    (tmp_path / "a.yaml").write_text(SWEEP.replace("COUNT", "6"), encoding="utf-8")
    command = ["run", "a.yaml", "--scheduler", address]
    bare = hodo(*command, timeout=120)
    assert bare.returncode == 2
    assert bare.stderr.startswith(f"no dask scheduler answers at {address}: ")
    assert len(bare.stderr.splitlines()) == 1
    done = hodo(*command, env={**os.environ, **certificates}, timeout=120)
    assert done.returncode == 0, done.stderr
    assert hodo("run", "a.yaml", "--out", "here").returncode == 0
    equal(tmp_path / "runs" / "a.h5", tmp_path / "here" / "a.h5")


@pytest.mark.parametrize("wrong", ["nonsense", "tcp://127.0.0.1:1"])
def test_a_scheduler_that_does_not_answer_is_bad_input(tmp_path, monkeypatch, wrong):
    import distributed

    class Impatient(distributed.Client):
        """A client that does not wait for ten seconds."""

        def __init__(self, address: str, **keys: Any) -> None:
            super().__init__(address, **{**keys, "timeout": 0.3})

    monkeypatch.setattr(distributed, "Client", Impatient)
    (tmp_path / "a.yaml").write_text(SWEEP.replace("COUNT", "6"), encoding="utf-8")
    done = call(tmp_path, "run", "a.yaml", "--scheduler", wrong)
    assert done.returncode == 2
    assert done.stderr.startswith(f"no dask scheduler answers at {wrong}: ")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "runs").exists()
