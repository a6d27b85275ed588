"""Do what `make figures` does, in one process: four would load the same libraries four times, which
takes longer than to see that nothing is to be done.

`python tools/figures.py CONFIG...` runs the configs, classifies their results, checks their claims
and draws their figures. The first command that fails ends it, with its exit status.
"""

import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from hodo_cli.cli import main

UNEXPECTED = 3
"""The exit status of `hodo claims` for a verdict that is not the expected one, which keeps no
figure from being drawn."""


def figures(configs: list[str]) -> int:
    """The exit status of all commands together."""
    runs = [f"runs/{Path(config).stem}.h5" for config in configs]
    status = hodo("run", *configs) or hodo("classify", *runs)
    if status == 0:
        with redirect_stdout(StringIO()):  # the table is long, and `make claims` prints it
            status = hodo("claims", *runs)
    return hodo("plot", *runs, "-j", "2") if status in (0, UNEXPECTED) else status


def hodo(*arguments: str) -> int:
    """The exit status of a command."""
    try:
        main(arguments, prog_name="hodo")
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


# The processes that draw load this file too.
if __name__ == "__main__":
    sys.exit(figures(sys.argv[1:]))
