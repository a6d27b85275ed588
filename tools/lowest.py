"""Print the lowest version of each dependency that pyproject.toml allows, as pip reads it."""

import re
import tomllib
from itertools import chain
from pathlib import Path

EXTRAS = ("build", "test")
"""Those that the tests need; where two name a library, the higher floor counts."""


def floors(pyproject: str) -> dict[str, str]:
    """The floor of each dependency, with the marker that says where it is needed."""
    project = tomllib.loads(pyproject)["project"]
    extras = (project["optional-dependencies"][extra] for extra in EXTRAS)
    lowest: dict[str, str] = {}
    for wanted in chain(project["dependencies"], *extras):
        name, version, marker = re.fullmatch(r"([\w.-]+)>=([\d.]+)(;.*)?", wanted).groups()
        known = lowest.get(name, "0").partition(";")[0]
        if numbers(version) >= numbers(known):
            lowest[name] = version + (marker or "")
    return lowest


def numbers(version: str) -> tuple[int, ...]:
    """The numbers of a version, which tell the higher of two."""
    return tuple(map(int, version.split(".")))


if __name__ == "__main__":
    text = (Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8")
    print(*(f"{name}=={version}" for name, version in floors(text).items()), sep="\n")
