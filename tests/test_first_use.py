"""What somebody meets who uses hodo for the first time: one true line for each mistake, and files
that other programs have added to."""

import numpy as np
import xarray as xr

BODY = "model: torques, initial: {p: 1, q: 0.1, r: 1}, time: {end: 5, samples: 3}"
BALL = "direction: {sphere: {count: 20, seed: 1}}"


def test_a_dry_run_counts_the_members_that_a_grown_sweep_keeps(hodo, tmp_path):
    """Which are computed anew if the case has changed otherwise."""

    def write(values, q):
        sweep = f"{{damping.0: {{values: {values}}}, {BALL}}}"
        data = f"inertia: [3, 2, 1], damping: [0.1, 0.2, {q}], initial: {{p: 0, q: 0, G: 1}}"
        time = "time: {end: 2}"
        text = f"cases:\n  s: {{model: linear-diag, {data}, {time}, sweep: {sweep}}}\n"
        (tmp_path / "s.yaml").write_text(text)

    write([0.1, 0.3], 0.1)
    assert hodo("run", "s.yaml").returncode == 0
    write([0.1, 0.2, 0.3], 0.1)
    changed = "s: will run: its case has changed"
    dry = hodo("run", "s.yaml", "--dry-run").stdout
    assert dry.strip() == f"{changed}; 40 of 60 members are kept"
    write([0.1, 0.2, 0.3], 0.2)
    assert hodo("run", "s.yaml", "--dry-run").stdout.strip() == changed


def test_the_group_of_another_program_is_no_case(hodo, tmp_path):
    """Of a result that xarray has added to; its group stays."""
    text = f"cases:\n  a: {{{BODY}, inertia: [3, 2, 1], damping: 0.1}}\n"
    (tmp_path / "a.yaml").write_text(text)
    assert hodo("run", "a.yaml").returncode == 0
    file = tmp_path / "runs" / "a.h5"
    mine = xr.Dataset({"x": ("n", np.arange(3.0))})
    mine.to_netcdf(file, mode="a", group="mine", engine="h5netcdf")
    for command in ("classify", "show", "compare"):
        done = hodo(command, *[file] * (1 + (command == "compare")))
        assert done.returncode == 0
        assert "mine" not in done.stdout + done.stderr
    with xr.open_dataset(file, group="mine", engine="h5netcdf") as kept:
        assert kept.x.values.tolist() == [0, 1, 2]
