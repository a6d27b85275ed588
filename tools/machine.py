"""Print the date and the machine of a measurement, in one sentence."""

import datetime
import os
import platform
from importlib.metadata import version
from pathlib import Path


def processor() -> str:
    """The processor's name, as Linux gives it, or its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


if __name__ == "__main__":
    cores, load = os.cpu_count(), os.getloadavg()[0]
    versions = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "heyoka"))
    print(
        f"Measured on {datetime.date.today()} on {processor()}, {cores} cores (load {load:.1f}), "
        f"with Python {platform.python_version()}, {versions}.\n"
    )
