"""Make the stored datasets, which `make compare` compares with, out of results computed in
quadruple precision.

`python tools/reference.py OUT RUN...` writes a thinned copy of each classified RUN to OUT, under
the name of its paper (the part before the comma that `--set` appends), with the tolerance of each
variable, and every event of every case to OUT/crossings.csv.
"""

import csv
import sys
from pathlib import Path
from typing import Any

import numpy as np

from hodo_cli.storage import Group, ResultFile, Variable, history_line, open_run, save_groups

SAMPLES = 41
"""About how many samples of a motion are kept."""

RTOL = {"averaged-u": 1e-11}
"""The error that a result in double precision may have, relative to the largest value, by form;
else 1e-12.

The form averaged-u divides by u2 - u1, to which it loses digits. Its Gz, H and r come from the
roots by (2.5), so that their error is a part of their largest value, however small they become: it
is allowed as `atol` too.
"""

CONDITION = 10.0
"""The error of the time of an event, and of what is measured there, by the error of the state."""

AXES = {1: "x1 (quadrant A)", 3: "x3 (quadrant B)"}
"""The axes that a body with A1 > A2 > A3 can go round, and the quadrant in which paper 1 draws
each."""

DROPPED = ("hash", "method_reason", "classify_warnings", "told", "told_mark")

HOW = (
    "Values computed by Taylor series in quadruple precision (113 bits), rounded to double and "
    "thinned. The tests check states, crossings and events against an independent Taylor series in "
    "integers of 192 bits (tests/series.py), which shares no line with the program. rtol of a "
    "variable is the error allowed, relative to its largest value."
)


def thinned(group: Group) -> Group:
    """A case with about SAMPLES samples, evenly spaced and with the last one, and the tolerance of
    each variable."""
    n, rtol = len(group.variables["time"].data), RTOL.get(str(group.attributes["form"]), 1e-12)
    rows = np.unique(np.r_[0 : n : max((n - 1) // (SAMPLES - 1), 1), n - 1])
    variables = {}
    for name, variable in group.variables.items():
        data = variable.data[rows] if variable.dims[:1] == ("time",) else variable.data
        if data.dtype.kind == "f" and name not in ("crossing_error", "event_error"):
            located = name == "event_time" or name.startswith("crossing_")
            tolerance = {"rtol": rtol * CONDITION if located else rtol}
            if group.attributes["form"] in RTOL:
                tolerance["atol"] = rtol * float(np.max(np.abs(variable.data), initial=0))
        else:
            tolerance = {}
        attributes = {key: value for key, value in variable.attrs.items() if key != "error"}
        variables[name] = Variable(variable.dims, data, attributes | tolerance)
    return Group(
        {key: value for key, value in group.attributes.items() if key not in DROPPED}, variables
    )


def write(run: ResultFile, path: Path) -> None:
    """The thinned copy of a result. Exits if a case of it has not come out well, or not in
    quadruple precision."""
    root = {
        key: value
        for key, value in run.attributes.items()
        if key not in ("config", "config_path", "history", "format_version")
    }
    groups = {name: run.read(name) for name in run.cases()}
    for name, group in groups.items():
        has_digits = 'precision: "quadruple"' in group.attributes["case"]
        if group.attributes["status"] != "ok" or not has_digits:
            sys.exit(f"{run.path}: {name} is no reference: {group.attributes['message']}")
    root |= {"history": history_line("make reference"), "reference": HOW}
    save_groups(path, {name: thinned(group) for name, group in groups.items()}, root)


def events(run: ResultFile) -> list[dict[str, Any]]:
    """Every separatrix crossing and every event of every case, in order."""
    rows = []
    for name in run.cases():
        data = {key: variable.data for key, variable in run.read(name).variables.items()}
        columns = [data.get(f"crossing_{key}", ()) for key in ("time", "from", "to", "G")]
        for time, before, after, G in zip(*columns, strict=True):
            words = f"separatrix, from {AXES[before]} to {AXES[after]}"
            rows.append(
                {
                    "case": name,
                    "time": repr(float(time)),
                    "event": words,
                    "value": f"|G| = {G:.12g}",
                }
            )
        for kind, time in zip(data.get("event_kind", ()), data.get("event_time", ()), strict=True):
            value = f"x = {data['x'][-1]:.12g}" if time == data["time"][-1] else ""
            words = {"end_of_spin": "end of spin, y = 0"}.get(kind, kind)
            rows.append({"case": name, "time": repr(float(time)), "event": words, "value": value})
    return rows


def main(out: Path, runs: list[Path]) -> None:
    """Write the datasets and the table."""
    out.mkdir(parents=True, exist_ok=True)
    with open(out / "crossings.csv", "w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(
            file, ["paper", "case", "time", "event", "value"], lineterminator="\n"
        )
        table.writeheader()
        for path in runs:
            with open_run(path) as run:
                paper = path.stem.partition(",")[0]
                write(run, out / f"{paper}.h5")
                table.writerows({"paper": paper, **row} for row in events(run))


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]])
