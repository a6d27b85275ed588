"""Try each class of faults many times: nothing finished is lost, nothing is silently wrong.

`python tests/stress.py [TRIES [CLASS...]]` tries each class so often (default 150), or those named.
"""

import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import faults

CLASSES: dict[Callable[[Path, int], Counter[str]], int] = {
    faults.kill_runs: 1,
    faults.fill_disk: 1,
    faults.crowds: 1,
    faults.change_bytes: 4,
    faults.fail_calls: 10,
    faults.lose_power: 1,
    faults.edit_code: 1,
}
"""The classes of faults, and the trials of each for one that is asked for."""


def row(name: str, tries: int) -> tuple[bool, str]:
    """Whether a class of faults cost nothing, and its line of the table."""
    function = getattr(faults, name)
    began, problem, count = time.monotonic(), "", Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        try:
            count = function(Path(folder), CLASSES[function] * tries)
        except (AssertionError, subprocess.CalledProcessError) as error:
            traceback.print_exc()
            problem = str(error).partition("\n")[0] or "a failed assertion"
    trials, seconds = count.pop("tried", 0), time.monotonic() - began
    kinds = ", ".join(f"{number} {kind}" for kind, number in count.items())
    title = name.replace("_", " ")
    return not problem, f"| {title} | {trials} | {problem or 0} | {kinds} | {seconds:.0f} |"


if __name__ == "__main__":
    tries = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    print("| class | tried | lost or wrong | of which | s |\n|---|---|---|---|---|")
    rows = []
    for name in sys.argv[2:] or [function.__name__ for function in CLASSES]:
        rows.append(row(name, tries))
        print(rows[-1][1], flush=True)
    sys.exit(not all(is_sound for is_sound, _ in rows))
