"""Mistakes in a case file: where each stands, and all of them as one error.

`document` notes the places as it reads; `document.locate` finds the place of a key.
"""

from typing import NamedTuple

from .. import HodoError
from .kinds import KeyPath

# A file that is no case file at all has a mistake in every line; nobody reads a thousand.
MAX_MISTAKES = 1000

# So many are listed one by one; of more, the first few show what is wrong with the file.
LISTED, FIRST = 100, 20


class Place(NamedTuple):
    """Where a value stands: line and column of the file from 1, or in the text of an override."""

    line: int
    column: int
    override: str = ""


class Mistakes:
    """The mistakes found in a file, each once, to be raised together."""

    def __init__(self, name: str) -> None:
        self.name = name
        # A dict keeps each once: what is wrong in `defaults` is met again in every case that
        # inherits it. The flag sorts overrides behind the file's own mistakes.
        self.noted: dict[tuple[bool, Place, str], None] = {}

    def add(self, place: Place, message: str, path: KeyPath = ()) -> None:
        """Note a mistake; raises them all when there are too many to go on."""
        # An empty key would be a point without a name.
        where = ".".join(str(key) for key in path if key != "")
        self.noted[bool(place.override), place, f"{where}: {message}" if where else message] = None
        if len(self.noted) >= MAX_MISTAKES:
            raise self.error(f"\n{_one_line(self.name)}: stopped at {MAX_MISTAKES} mistakes")

    def fatal(self, place: Place, message: str, path: KeyPath = ()) -> HodoError:
        """The error to raise for a mistake after which reading cannot go on, with all mistakes so
        far."""
        self.add(place, message, path)
        return self.error()

    def error(self, end: str = "") -> HodoError:
        """One line for each mistake, by line and column; mistakes of overrides last."""
        shown = sorted(self.noted)[: len(self.noted) if len(self.noted) <= LISTED else FIRST]
        lines = [self._line(place, text) for _, place, text in shown]
        if len(self.noted) > len(shown):
            lines.append(
                f"{_one_line(self.name)}: and {len(self.noted) - len(shown)} more mistakes"
            )
        return HodoError("\n".join(lines) + end)

    def raise_any(self) -> None:
        """Raise what was noted, if anything was."""
        if self.noted:
            raise self.error()

    def _line(self, place: Place, text: str) -> str:
        start = (
            f"--set {place.override}"
            if place.override
            else f"{self.name}:{place.line}:{place.column}"
        )
        return _one_line(f"{start}: {text}")


# Names of files and values may hold line breaks, and terminals obey control characters.
def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
